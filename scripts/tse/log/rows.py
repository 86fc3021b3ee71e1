"""Check the channels of a log, and convert them to rows for the C library.

An unusable log raises a UserError that names file, row, column and allowed range. If at
most the share MAX_OUTSIDE of the values of a column is outside the allowed range, these
values become missing values, and a note reports them."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tse.library.core import CONFIG, INPUT, Field, library
from tse.library.errors import UserError
from tse.log.clock import MAX_TIME_GAP, straighten_time

if TYPE_CHECKING:
    import pandas as pd

DRIVES = ("steer_angle", "wheel_speed_front", "wheel_speed_rear")  # inputs of the model
MEASURES = ("accel_x", "accel_y", "yaw_rate")  # measured outputs of the model
# column of an axle -> columns of its two wheels, which a log may have instead
SIDES = {axle: (f"{axle}_left", f"{axle}_right") for axle in DRIVES[1:]}
# Optional column of a log -> unit, lowest and highest value, description, hint for a
# column in a wrong unit. The C library gets the columns in src/tables/input.toml. It does
# not get gnss_latitude and gnss_longitude (they locate the car on a road) and
# vehicle_speed (it checks units, and replaces wheel speeds that the log lacks).
OPTIONAL_COLUMNS = {
    "vehicle_speed": ("m/s", -60.0, 120.0,
        "speed over ground of the centre of gravity: GNSS, optical", "km/h: divide by 3.6"),
    "ins_vel_x": ("m/s", -120.0, 120.0,
        "longitudinal velocity of the reference point of an INS or an optical sensor",
        "km/h: divide by 3.6"),
    "ins_vel_y": ("m/s", -60.0, 60.0,
        "lateral velocity of the reference point of an INS or an optical sensor, positive left",
        "km/h: divide by 3.6"),
    "gnss_speed": ("m/s", 0.0, 120.0,
        "speed over ground", "km/h: divide by 3.6"),
    "gnss_course": ("rad", -7.0, 7.0,
        "direction of the motion over ground, positive left, from any zero",
        "degrees clockwise from north: multiply by -pi/180"),
    "brake": ("1", 0.0, 1.0,
        "1: the car brakes, 0: it does not",
        "a pressure: name it in signals.toml, with above = the pressure from which the car brakes"),
    "wheel_torque_front": ("Nm", -20000.0, 20000.0,
        "drive torque minus brake torque, sum of both front wheels", "kNm: multiply by 1000"),
    "wheel_torque_rear": ("Nm", -20000.0, 20000.0,
        "drive torque minus brake torque, sum of both rear wheels", "kNm: multiply by 1000"),
    "bank": ("rad", -0.35, 0.35,
        "bank of the road, positive if the left side is higher, with that of its curves",
        "degrees: multiply by pi/180"),
    "grade": ("rad", -0.35, 0.35,
        "grade of the road, positive uphill", "percent: divide by 100"),
    "gnss_latitude": ("deg", -90.0, 90.0,
        "latitude, positive north; locates the car on a road", "radians: multiply by 180/pi"),
    "gnss_longitude": ("deg", -180.0, 180.0,
        "longitude, positive east", "radians: multiply by 180/pi"),
}  # fmt: skip
VELOCITY_COLUMNS = ("ins_vel_x", "ins_vel_y", "gnss_speed", "gnss_course")
ROAD_COLUMNS = ("bank", "grade")
TORQUE_COLUMNS = ("wheel_torque_front", "wheel_torque_rear")
_SPEED_HINT = (
    "if the column holds rpm, multiply by 2 pi/60; if km/h or m/s, convert to m/s and divide by the "
    "wheel radius"
)
COLUMN_HINTS = {
    "steer_angle": "if the column holds degrees, multiply by pi/180; if it is the steering-wheel angle, "
    "divide by the steering ratio",
    "yaw_rate": "if the column holds deg/s, multiply by pi/180",
    "wheel_speed_front": _SPEED_HINT,
    "wheel_speed_rear": _SPEED_HINT,
}

# Limits of a time column
# [s] min and max of the median step between rows. Messages state this range, but a log is
# refused only below MIN_ROW_STEP / 2 or above MAX_ROW_STEP
MIN_ROW_STEP, MAX_ROW_STEP = 0.001, 1.0
# share of rows whose time falls. Above it the log is refused: its rows are not sorted by
# time
MAX_SHUFFLED = 0.2
# share of rows whose time is below or equal to the time of the row before. Above it the
# log is refused: the column does not hold times
MAX_BACK = 0.5

# Limits of a channel
MAX_OUTSIDE = 0.05  # share of values outside the range; above it the column is refused
# [1] right - left wheel speed of an axle is fitted by a constant times the yaw rate. If
# the fit explains less than this share of the mean square, the constant is discarded.
MIN_TURN_SHARE = 0.5
# [1] accel_y is fitted by a constant times wheel speed x yaw rate. If rms of the residual
# / rms of accel_y is below this limit, accel_y was computed, not measured, and is treated
# as missing. A measured accel_y has at least 0.04, even in a simulation without noise.
MAX_COMPUTED_MISFIT = 0.015
# A logger may write zeros for missing values. A run of successive zeros is suspicious if
# the values before and after it have the same sign and magnitudes above ZERO_JUMP_STEPS
# times the 95 % quantile of |change from row to row| (without changes from or to 0). All
# zeros of a channel are treated as missing if at least MIN_ZERO_RUNS runs, and at least
# the share MIN_ZERO_SHARE of all runs, are suspicious.
MIN_ZERO_RUNS, ZERO_JUMP_STEPS, MIN_ZERO_SHARE = 10, 4.0, 0.2
# A bus may send a fixed value that means "not available". The value of a channel with the
# largest magnitude is taken as such a code, and treated as missing, under three
# conditions. Its magnitude is more than MIN_CODE_RATIO times that of any other value. It
# appears in at least MIN_CODE_ROWS rows, but in less than the share MAX_BACK of all rows.
# The other rows have at least MIN_OTHER_VALUES different magnitudes.
MIN_CODE_RATIO, MIN_CODE_ROWS, MIN_OTHER_VALUES = 1.5, 5, 10
# A channel with fewer rows is not tested for being stuck or computed.
MIN_STUCK_ROWS = 200
MAX_WITNESS_ROWS = 100000  # if a log has more rows, only every n-th row is used for WITNESSES
# A measurement is stuck if it has the same value in all rows although the motion of the
# car changes. The motion changes if the range (95 % minus 5 % quantile) of a second
# channel, the witness, exceeds a limit. Columns: measurement; witness; limit in the unit
# of the witness.
WITNESSES = (
    ("accel_x", "wheel_speed_rear", 5.0),  # [rad/s] 1.5 m/s of speed
    ("accel_y", "yaw_rate", 0.05),  # [rad/s] 0.5 m/s2 at 10 m/s
    ("yaw_rate", "accel_y", 0.5),  # [m/s2]
)
# [1] share for average(). The mean of a channel over a block of rows is NaN if at least
# this share of the values is missing. A block is dropped if it has at most this share of
# the median number of rows per block.
MAX_MISSING = 0.5


@dataclass(frozen=True)
class Reading:
    """Options of all commands that read a log."""

    signals: Path | None = None  # signals.toml; None: the file next to the log, if there is one
    rate: float | None = None  # [Hz] rate to resample to; None: that in signals.toml, else that of the log
    strict: bool = False  # True: warnings become errors
    databases: tuple[Path, ...] = ()  # databases of the bus
    car: Any | None = None  # vehicle.Vehicle, for wheel radii and steering ratio; None: unknown

    def files(self, log: Path) -> list[Path]:
        """Return the files, apart from the log, that determine its rows."""
        beside = find_signals_file(log) if self.signals is None else self.signals
        return [p for p in (beside, *self.databases) if p is not None and p.is_file()]


@dataclass(frozen=True)
class SlowChannel:
    """Original samples of a channel whose rate is below the rate of the rows.

    In the rows, the channel is interpolated, which smooths its noise. The noise is
    therefore estimated from the original samples, which are called entries."""

    time: np.ndarray  # [s]
    value: np.ndarray
    rows: float  # number of rows per entry


def fill_optional(rows: np.ndarray, columns: Mapping[str, np.ndarray]) -> None:
    """Write the finite values of `columns` to the optional channels of `rows`.

    `rows` is an array of tse_input, the input struct of the C library. Where a value is
    finite, its bit in rows["given"] is set; elsewhere, 0 is written. gnss_course is
    wrapped to -pi .. pi rad."""
    for bit, f in enumerate(library().optional):
        if f.name not in columns:
            continue
        value = columns[f.name]
        if f.name == "gnss_course":
            value = (value + np.pi) % (2 * np.pi) - np.pi
        given = np.isfinite(value)
        rows[f.name] = np.where(given, value, 0.0)
        rows["given"] |= np.where(given, 1 << bit, 0).astype(rows["given"].dtype)


@dataclass
class CheckedLog:
    """A checked log in SI units."""

    path: Path
    time: np.ndarray  # [s] increasing
    data: pd.DataFrame  # channels of the library; missing values are NaN
    ref: pd.DataFrame  # reference values: columns ref_...
    line: np.ndarray  # number by which messages name each row, see `place`
    sample_time: float | None  # [s] median step between rows; None: there is a single row
    notes: list[str] = field(default_factory=list)
    averaged: int = 1  # median number of rows of the file that one row averages
    extra: pd.DataFrame = field(default_factory=lambda: _make_frame({}, 0))  # optional columns
    # what `line` counts: "line" (of the file) or "row" (of a data frame or resampled log)
    place: str = "line"
    # Axle whose wheel speeds are not in the file. It gets the wheel speeds of the other
    # axle, so longitudinal slip is not observable. None: both axles are in the file.
    stand_in: str | None = None
    # factor from the wheel speed of the other axle to that of the axle `stand_in`: wheel
    # radius of the other axle / wheel radius of the axle `stand_in`
    stands_by: float = 1.0
    slower: dict[str, SlowChannel] = field(default_factory=dict)  # channels interpolated to the rows
    # axle whose two wheel speeds are in the file -> (right - left wheel speed) / yaw rate
    # = track width / wheel radius; 0: unknown (see MIN_TURN_SHARE)
    turn: dict[str, float] = field(default_factory=dict)
    warnings: list[str] = field(default_factory=list)  # notes that Reading.strict makes errors

    def __len__(self) -> int:
        return len(self.time)

    @property
    def dt(self) -> np.ndarray:
        """Time since the previous row [s]; for the first row, the sample time."""
        return np.diff(self.time, prepend=self.time[0] - (self.sample_time or 0.01))

    def rows(self, first: int = 0, last: int | None = None) -> np.ndarray:
        """Return rows `first` to `last` - 1 as an array of the library's input struct.
        `last` None: to the end of the log."""
        part = slice(first, last)
        rows = np.zeros(len(self.time[part]), library().dtype(INPUT))
        before = self.time[first - 1] if first else self.time[0] - (self.sample_time or 0.01)
        rows["dt"] = np.diff(self.time[part], prepend=before)
        for name in self.data:
            rows[name] = self.data[name].to_numpy()[part]
        fill_optional(rows, {name: self.extra[name].to_numpy(float)[part] for name in self.optional})
        return rows

    @property
    def optional(self) -> list[str]:
        """Optional channels of input.toml that the log has."""
        return [f.name for f in library().optional if f.name in self.extra]

    def steers_beyond(self, limit: float) -> np.ndarray:
        """Mark the rows whose steering angle exceeds `limit` [rad] on either side."""
        with np.errstate(invalid="ignore"):
            return np.abs(self.data["steer_angle"].to_numpy()) > limit


def list_columns() -> list[str]:
    """Return "time" and the names of the channels that the C library receives."""
    return ["time", *(f.name for f in library().channels)]


def list_log_files(path: Path) -> list[Path]:
    """Return the files of a log: the log itself or, if the log is a folder, all files in
    it and its subfolders."""
    path = Path(path)
    return sorted(p for p in path.rglob("*") if p.is_file()) if path.is_dir() else [path]


def find_signals_file(path: Path) -> Path | None:
    """Return LOG.signals.toml in the folder of a log, else signals.toml, else None."""
    path = Path(path)
    for name in (f"{path.stem}.signals.toml", "signals.toml"):
        if (path.parent / name).is_file():
            return path.parent / name
    return None


def find_absent_channels(names: Collection[str], sides: Collection[str], spare: Collection[str]) -> list[str]:
    """Return the missing channels without which a log can still be used.

    If any other channel is missing, the caller refuses the log.

    Parameters
    ----------
    names : collection of str
        Columns of the log.
    sides : collection of str
        wheel_speed_front, wheel_speed_rear or both: channels for which the log has two
        columns, one for each wheel, instead of one column for the axle.
    spare : collection of str
        Channels that the log may lack. It may also lack the wheel speed of one axle if it
        has that of the other axle.
    """
    # A column "Yaw_Rate" is a misspelt yaw_rate. yaw_rate is then not returned, so that
    # the caller refuses the log and suggests the right name.
    misspelt = {n.lower() for n in names} - {*names}
    gone = [c for c in list_columns() if c not in names and c not in sides and c not in misspelt]
    axles = [c for c in gone if c in SIDES]
    # The wheel speed of one axle may be missing: that of the other axle replaces it. But
    # if the log has one wheel of the missing axle, its second wheel was probably
    # forgotten: the axle is not returned, and the caller refuses the log.
    alone = axles if len(axles) == 1 and not any(s in names for s in SIDES[axles[0]]) else []
    return [c for c in gone if c in spare or c in alone]


def check_log(
    path: Path,
    time: np.ndarray,
    table: dict[str, np.ndarray],
    line: np.ndarray,
    notes: list[str],
    spare: Collection[str] = MEASURES,
    place: str = "line",
) -> CheckedLog:
    """Check the columns of a log, and return them as a CheckedLog.

    Parameters
    ----------
    path : Path
        The log, for messages.
    time : ndarray, (rows,)
        [s] Increasing times.
    table : dict of str to ndarray, (rows,)
        Columns in SI units: channels (or the two wheels of an axle), reference values
        (ref_...) and optional columns. The function removes the channels and the
        reference values from `table`.
    line : ndarray of int, (rows,)
        Number of each row in messages. It counts the lines of a text file, the rows of a
        data frame or the rows of a resampled log.
    notes : list of str
        Receives notes about missing and unusable values.
    spare : collection of str
        Channels that may be missing.
    place : str
        Word for messages that states what `line` counts: line or row.

    Raises
    ------
    UserError
        A required column is missing, or has too many values outside its range.
    """
    wanted = list_columns()[1:]
    sides = {
        axle: pair for axle, pair in SIDES.items() if axle not in table and all(c in table for c in pair)
    }
    parts = {name: sides.get(name, (name,)) for name in wanted}
    filled = [c for c, own in parts.items() if any(s in table and np.isfinite(table[s]).any() for s in own)]
    absent = find_absent_channels(filled, [], spare)
    needed = [c for name in wanted if name not in absent for c in parts[name]]
    missing = [c for c in needed if c not in table]
    if missing:
        raise UserError(f"{path}: {', '.join(missing)} is missing{_suggest_remedy(missing)}")
    data = {name: table.pop(name) for name in needed}
    _check_channels(path, data, parts, absent, line, notes, place)
    per_turn = _join_wheels(data, {a: pair for a, pair in sides.items() if a not in absent}, notes)
    _drop_computed(data, notes)
    stand_in = next((c for c in absent if c in SIDES), None)
    if stand_in:
        _replace_axle(data, stand_in, notes)
    sample_time = float(np.median(np.diff(time))) if len(time) > 1 else None
    if sample_time is not None:
        _check_sample_time(path, sample_time)
    for name in wanted:
        gone = np.isnan(data[name])
        if 0 < (count := int(gone.sum())) < len(time):
            where = f"first in {place} {line[gone.argmax()]}"
            notes.append(f"{name}: {count} of {len(time)} cells are missing or not usable ({where})")
    frame = _make_frame({name: data[name] for name in wanted}, len(time))
    ref = _make_frame({c: table.pop(c) for c in list(table) if c.startswith("ref_")}, len(time))
    optional = {c: _check_optional(c, table[c], line, notes, place) for c in OPTIONAL_COLUMNS if c in table}
    some = {c: x for c, x in optional.items() if x is not None}
    return CheckedLog(
        path,
        time,
        frame,
        ref,
        line,
        sample_time,
        notes,
        extra=_make_frame(some, len(time) if some else 0),
        place=place,
        stand_in=stand_in,
        turn=per_turn,
    )


def _check_channels(
    path: Path,
    data: dict[str, np.ndarray],
    parts: Mapping[str, Sequence[str]],
    absent: Collection[str],
    line: np.ndarray,
    notes: list[str],
    place: str,
) -> None:
    """Check the values of all channels, and replace unusable values by NaN.

    A column with too many values outside its range raises a UserError (see MAX_OUTSIDE).
    NaN replaces a few values outside the range, bus codes for "not available", zeros that
    stand for missing values, and all values of a stuck measurement. `parts`: channel ->
    its column, or its two columns (left and right wheel). `absent`: channels that the log
    lacks; each becomes a column of NaN."""
    for f in library().channels:
        if f.name in absent:
            data[f.name] = np.full(len(line), np.nan)
            if f.name not in SIDES:
                notes.append(
                    f"{f.name} is not in the log: quantities that only {f.name} shows are not estimated"
                )
            continue
        for name in parts[f.name]:
            _check_channel(path, data, line, f, notes, name, place)
    for name in data:
        _drop_code(data, name, notes)
        _drop_written_zeros(data, name, notes)
    _drop_stuck(data, parts, notes)
    if all(np.isnan(data[c]).all() for c in ("accel_y", "yaw_rate")):
        raise UserError(
            f"{path}: accel_y and yaw_rate are missing: the tyres cannot be estimated without one of them"
        )


def _join_wheels(
    data: dict[str, np.ndarray], sides: Mapping[str, Sequence[str]], notes: list[str]
) -> dict[str, float]:
    """Replace the columns of the two wheels of an axle by one column, their mean.

    Return the turn ratios, see _average_axle(): axle -> (right - left wheel speed) / yaw
    rate. `sides`: axle -> columns of its two wheels."""
    per_turn = {}
    for axle, pair in sides.items():
        mean, per_turn[axle] = _average_axle(axle, *(data.pop(c) for c in pair), data["yaw_rate"], notes)
        data[axle] = mean
    return per_turn


def _replace_axle(data: dict[str, np.ndarray], axle: str, notes: list[str]) -> None:
    """Replace the missing wheel speeds of an axle by those of the other axle.

    Longitudinal slip is then unknown. Without the slip, accel_x does not determine the
    longitudinal stiffness, so accel_x is discarded."""
    other = next(c for c in SIDES if c != axle)
    data[axle] = data[other].copy()
    data["accel_x"] = np.full(len(data[axle]), np.nan)
    notes.append(
        f"{axle} is not in the log: {other} stands in for it; slip is not known, so accel_x is not used and "
        "cx_front not estimated"
    )


def _check_sample_time(path: Path, step: float) -> None:
    """Refuse a log whose median step [s] between rows is too long or too short."""
    if step > MAX_ROW_STEP:
        raise UserError(
            f"{path}: column time: rows are {step:g} s apart (median); allowed: at most {MAX_ROW_STEP:g} s"
            f"{_hint_at_time_unit(step)}"
        )
    if step < 0.5 * MIN_ROW_STEP:
        raise UserError(
            f"{path}: column time: rows are {step:.3g} s apart (median); allowed: at least {MIN_ROW_STEP:g} s"
            f"{_hint_at_time_unit(step)}"
        )


def _drop_stuck(data: dict[str, np.ndarray], parts: Mapping[str, Sequence[str]], notes: list[str]) -> None:
    """Discard a measurement that is stuck, i.e. equal in all rows although the motion of
    the car changes (see WITNESSES).

    The filter also detects a stuck measurement, but only after some rows. The estimates
    of these rows would be wrong."""
    for name, witness, threshold in WITNESSES:
        value = data[name]
        first = int(np.isfinite(value).argmax())
        if np.isfinite(value).sum() < MIN_STUCK_ROWS or np.nanmin(value) != np.nanmax(value):
            continue
        other = next((data[c] for c in parts.get(witness, ()) if c in data), np.zeros(0))
        other = other[:: max(1, len(other) // MAX_WITNESS_ROWS)]
        other = other[np.isfinite(other)]
        if len(other) and np.subtract(*np.quantile(other, [0.95, 0.05])) > threshold:
            notes.append(
                f"{name} is {value[first]:g} in every row, while {witness} changes: "
                "it is stuck and is treated as missing"
            )
            data[name] = np.full(len(value), np.nan)


def _drop_code(data: dict[str, np.ndarray], name: str, notes: list[str]) -> None:
    """Replace by NaN a bus code for "not available", see MIN_CODE_RATIO.

    The code is the value of largest magnitude, if this magnitude occurs in many rows and
    is much larger than all others."""
    size = np.abs(data[name])
    top = float(np.nanmax(size)) if np.isfinite(size).any() else 0.0
    rows = size == top
    if not MIN_CODE_ROWS <= rows.sum() < MAX_BACK * len(rows):
        return
    others = size[np.isfinite(size) & ~rows]
    if not len(others) or not top > MIN_CODE_RATIO * others.max():
        return
    if len(np.unique(others)) < MIN_OTHER_VALUES:
        return
    value = data[name][rows.argmax()]
    notes.append(
        f"{name} is {value:g} in {rows.sum()} rows and at most {others.max():.3g} in the others: "
        'it is a code for "not available" and is treated as missing'
    )
    data[name] = np.where(rows, np.nan, data[name])


def _drop_written_zeros(data: dict[str, np.ndarray], name: str, notes: list[str]) -> None:
    """Replace by NaN the zeros that a logger wrote for missing values.

    All zeros of the channel are replaced, or none: see MIN_ZERO_RUNS."""
    value = data[name]
    zero = value == 0.0
    edges = np.flatnonzero(np.diff(np.concatenate([[0], zero.astype(np.int8), [0]])))
    first, after = edges[::2], edges[1::2]
    inner = (first > 0) & (after < len(value))
    first, after = first[inner], after[inner]
    if len(first) < MIN_ZERO_RUNS:
        return
    steps = np.abs(np.diff(value))[~(zero[1:] | zero[:-1])]
    steps = steps[np.isfinite(steps)]
    moves = ZERO_JUMP_STEPS * float(np.quantile(steps, 0.95)) if len(steps) else np.inf
    before, then = value[first - 1], value[after]
    written = (before * then > 0) & (np.minimum(np.abs(before), np.abs(then)) > moves)
    if written.sum() < MIN_ZERO_RUNS or written.sum() < MIN_ZERO_SHARE * len(first):
        return
    notes.append(
        f"{name} is 0 in {zero.sum()} rows, between values that are far from 0: "
        "these zeros are treated as missing"
    )
    data[name] = np.where(zero, np.nan, value)


def _drop_computed(data: dict[str, np.ndarray], notes: list[str]) -> None:
    """Discard accel_y if it was computed as speed times yaw rate."""
    y = data["accel_y"]
    for wheel in SIDES:
        x = data[wheel] * data["yaw_rate"] if wheel in data else np.full(len(y), np.nan)
        both = np.isfinite(x) & np.isfinite(y)
        across, turned = float(np.sum(y[both] ** 2)), float(np.sum(x[both] ** 2))
        if both.sum() < MIN_STUCK_ROWS or not np.std(y[both]) > 0 or not turned > 0:
            continue
        explained = float(np.sum(x[both] * y[both])) ** 2 / (turned * across)
        if 1.0 - explained < MAX_COMPUTED_MISFIT**2:
            notes.append(
                "accel_y equals speed times yaw_rate: it is computed, not measured, and is treated as missing"
            )
            data["accel_y"] = np.full(len(y), np.nan)
            return


def _make_frame(columns: dict[str, np.ndarray], rows: int) -> pd.DataFrame:
    """Return a data frame that shares memory with the columns: a copy of a log of 10 h
    would take 200 MB."""
    import pandas as pd  # not at the top: estimation row by row needs numpy only

    return pd.DataFrame(columns, index=range(rows), copy=False)


def select_liveliest(log: CheckedLog, rows: int) -> CheckedLog:
    """Return the part of a log in which the car turns most, for checks of its sensors.

    The part has at most `rows` rows, and lasts at most `rows` x 0.01 s. A shorter log is
    returned completely."""
    rows = max(1, int(rows * min(1.0, 0.01 / log.sample_time))) if log.sample_time else rows
    if len(log) <= rows:
        return log
    step = max(1, rows // 4)
    channel = "yaw_rate" if log.data["yaw_rate"].notna().any() else "steer_angle"
    turned = [
        float(np.nansum(np.abs(log.data[channel].to_numpy()[i : i + step]))) for i in range(0, len(log), step)
    ]
    starts = range(0, len(log) - rows + 1, step)
    first = max(starts, key=lambda i: sum(turned[i // step : (i + rows) // step]))
    part = slice(first, first + rows)
    begin, end = log.time[first], log.time[first + rows - 1]
    slower = {
        name: SlowChannel(s.time[inside], s.value[inside], s.rows)
        for name, s in log.slower.items()
        for inside in ((s.time >= begin) & (s.time <= end),)
    }
    data, ref, extra = (t.iloc[part].reset_index(drop=True) for t in (log.data, log.ref, log.extra))
    return replace(
        log, time=log.time[part], data=data, ref=ref, extra=extra, line=log.line[part], slower=slower
    )


def _suggest_remedy(missing: Collection[str]) -> str:
    """Return the end of the message about missing columns, which states the remedy."""
    if any(c.endswith(("_left", "_right")) for c in missing):
        return ": both wheels of an axle are needed, or the axle's mean"
    if "steer_angle" in missing:
        return ": without the steering angle the tyres cannot be estimated; name its signal in signals.toml"
    return ": name its signal in signals.toml"


def _average_axle(
    axle: str, left: np.ndarray, right: np.ndarray, yaw_rate: np.ndarray, notes: list[str]
) -> tuple[np.ndarray, float]:
    """Return the mean wheel speed [rad/s] of an axle, and the turn ratio.

    The turn ratio is (right - left wheel speed) / yaw rate, i.e. track width / wheel
    radius, fitted to the rows that have both wheels. In a row with only one wheel, the
    mean is left + h or right - h, with h = turn ratio x yaw rate / 2. If the fit is poor
    (see MIN_TURN_SHARE), 0 is returned as turn ratio."""
    difference = right - left
    both = np.isfinite(difference) & np.isfinite(yaw_rate)
    rate = yaw_rate if both.all() else yaw_rate[both]
    turned = float(np.sum(rate**2))
    difference = difference if both.all() else difference[both]
    differed = float(np.sum(difference**2))
    # The product and, below, the mean are computed in place, to save memory: a column of
    # 10 h takes 30 MB.
    difference *= rate
    per_turn = float(np.sum(difference)) / turned if turned > 0 else 0.0
    del difference, rate
    mean = left + right
    mean *= 0.5
    one_only = np.isnan(mean) & (np.isfinite(left) | np.isfinite(right))
    one_only &= np.isfinite(yaw_rate) & bool(turned > 0)
    if one_only.any():
        half = 0.5 * per_turn * yaw_rate
        mean[one_only] = np.where(np.isfinite(left), left + half, right - half)[one_only]
        notes.append(
            f"{axle}: one of both wheels is missing in {one_only.sum()} rows: "
            "its speed is computed from the other wheel and the yaw rate"
        )
    # `shown` is False if the fit is poor, e.g. on a straight road, where the difference
    # of the wheel speeds is only noise
    shown = bool(per_turn**2 * turned > MIN_TURN_SHARE * differed)
    return mean, per_turn if shown else 0.0


def _check_optional(
    name: str, column: np.ndarray, line: np.ndarray, notes: list[str], place: str = "line"
) -> np.ndarray | None:
    """Return a checked optional column. If it cannot be used, add a note, return None."""
    unit, low, high, _, hint = OPTIONAL_COLUMNS[name]
    value = column.copy()
    with np.errstate(invalid="ignore"):
        bad = (value < low) | (value > high)
    there = int(np.isfinite(value).sum())
    limits = f"{low:g} .. {high:g}" + (f" {unit}" if unit != "1" else "")
    if not there or bad.sum() > MAX_OUTSIDE * there:
        why = "it is empty"
        if there:
            why = f"{value[bad.argmax()]:g} in {place} {line[bad.argmax()]} is outside the allowed range "
            why += f"{limits}; hint: {hint}"
        notes.append(f"column {name} is not used: {why}")
        return None
    if bad.any():
        notes.append(f"{name}: {bad.sum()} values outside {limits} are treated as missing")
        value[bad] = np.nan
    return value


def _unwrap_course(name: str, column: pd.Series) -> np.ndarray:
    """Return a column as floats. Remove jumps by 2 pi from a course, before averaging.

    CheckedLog.rows() wraps a course to -pi .. pi again."""
    value = column.to_numpy(float).copy()
    if name == "gnss_course":
        there = np.isfinite(value)
        value[there] = np.unwrap(value[there])
    return value


def average(log: CheckedLog, seconds: float) -> CheckedLog:
    """Return the log averaged over blocks: one row per block, the mean of its rows.

    Parameters
    ----------
    log : CheckedLog
        The log. Its steps between rows may differ.
    seconds : float
        [s] Length of a block.

    Returns
    -------
    CheckedLog
        One row per block: the means of its times, channels, reference values and optional
        columns. If a block has n rows, the sd of white noise is divided by sqrt(n).

    Raises
    ------
    UserError
        `seconds` is out of range, or is shorter than 1.5 times the median step between
        rows.
    """
    f = library().field(CONFIG, "sample_time")
    if not f.low <= seconds <= f.high:
        raise UserError(f"option --average: {seconds:g} is outside its range {f.low:g} .. {f.high:g} s")
    if log.sample_time is None or seconds < 1.5 * log.sample_time:
        have = "the log has a single row"
        if log.sample_time:
            have = f"the rows of the log are {log.sample_time:.3g} s apart; allowed: at least 1.5 times this"
        raise UserError(f"option --average: {seconds:g} s is too short for blocks of several rows: {have}")
    block = np.floor((log.time - log.time[0]) / seconds + 1e-6).astype(np.int64)
    starts = np.flatnonzero(np.diff(block, prepend=-1))
    count = np.diff(np.append(starts, len(log)))
    usual = float(np.median(count))
    keep = count > MAX_MISSING * usual if len(count) > 1 else np.ones(1, bool)

    def average_blocks(x: np.ndarray) -> np.ndarray:
        """Return the means of x over the kept blocks; NaN where too many are missing."""
        good = np.isfinite(x)
        present = np.add.reduceat(good.astype(float), starts)
        total = np.add.reduceat(np.where(good, x, 0.0), starts)
        return np.where(present > (1 - MAX_MISSING) * count, total / np.maximum(present, 1), np.nan)[keep]

    time = average_blocks(log.time)
    data = {name: average_blocks(log.data[name].to_numpy(float)) for name in log.data}
    ref = {name: average_blocks(log.ref[name].to_numpy(float)) for name in log.ref}
    extra = {name: average_blocks(_unwrap_course(name, log.extra[name])) for name in log.extra}
    step = float(np.median(np.diff(time))) if len(time) > 1 else None
    notes = [
        *log.notes,
        f"averaged over {seconds:g} s: {len(log)} rows became {len(time)}, each the mean of {usual:g}",
    ]
    slower = {
        name: SlowChannel(x.time, x.value, x.rows / usual) for name, x in log.slower.items() if x.rows > usual
    }
    return replace(
        log,
        time=time,
        data=_make_frame(data, len(time)),
        ref=_make_frame(ref, len(time)),
        line=log.line[starts[keep]],
        sample_time=step,
        notes=notes,
        averaged=max(1, round(usual)),
        extra=_make_frame(extra, len(time)),
        slower=slower,
    )


def describe_sampling(log: CheckedLog, max_gap: float) -> list[str]:
    """Return notes about irregular steps, and about gaps longer than `max_gap` [s]."""
    if len(log) < 2 or log.sample_time is None:
        return ["the log has a single row"]
    dt = np.diff(log.time)
    notes = []
    off = np.abs(dt - log.sample_time) > 0.1 * log.sample_time
    if off.mean() > 0.01:
        notes.append(
            f"irregular sampling: {100 * off.mean():.0f} % of the steps differ "
            "from the median by more than 10 %"
        )
    gaps = np.flatnonzero(dt > max_gap)
    if len(gaps):
        notes.append(
            f"{len(gaps)} gap{'s' if len(gaps) > 1 else ''} longer than {max_gap:g} s "
            f"(the longest {dt.max():.3g} s, before {log.place} {log.line[1 + int(dt.argmax())]}): "
            "after each, states restart and stiffness is kept"
        )
    return notes


def describe_steering(log: CheckedLog, max_steer: float) -> list[str]:
    """Return a note about rows with steering angles too large for the model."""
    large = log.steers_beyond(max_steer)
    if not large.any():
        return []
    return [
        f"steering beyond {max_steer:g} rad in {large.sum()} rows "
        f"(first in {log.place} {log.line[large.argmax()]}): the model holds for small angles only, "
        "so statistics are not updated in these rows (max_steer)"
    ]


def straighten_log_time(
    path: Path, time: np.ndarray, line: np.ndarray, notes: list[str], place: str = "line"
) -> tuple[np.ndarray, np.ndarray]:
    """Repair the time column of a log; return increasing times and a mask of kept rows.

    Parameters
    ----------
    path : Path
        The log, for messages.
    time : ndarray, (rows,)
        [s] The time column.
    line : ndarray of int, (rows,)
        Number of each row in messages. It counts the lines of a text file, the rows of a
        data frame or the rows of a resampled log.
    notes : list of str
        Receives notes about the repairs.
    place : str
        Word for messages that states what `line` counts: line or row.

    Raises
    ------
    UserError
        The column holds no times; its rows are not sorted (see MAX_SHUFFLED); more than
        half of the rows would be dropped; or the median step is above MAX_TIME_GAP.
    """
    if np.isfinite(time).sum() > 1 and (np.diff(time[np.isfinite(time)]) <= 0).mean() > MAX_BACK:
        check_time(path, time, line, place)
    step = np.diff(time[np.isfinite(time)])
    if len(step) > 1 and ((step < 0).mean() > MAX_SHUFFLED or np.median(step) > MAX_TIME_GAP):
        check_time(path, time[np.isfinite(time)], line[np.isfinite(time)], place)
    fixed, keep, said = straighten_time(time)
    if keep.sum() < MAX_BACK * len(time):
        check_time(path, time, line, place)
    notes += [f"time: {text}" for text in said]
    return fixed, keep


def check_time(path: Path, time: np.ndarray, line: np.ndarray, place: str = "line") -> None:
    """Raise an error if times are not finite, do not increase, or have too long gaps."""
    bad = ~np.isfinite(time)
    if bad.any():
        raise UserError(
            f"{path}: {place} {line[bad.argmax()]}, column time: is empty or not finite; "
            "every row needs a time in s"
        )
    step = np.diff(time)
    bad = step <= 0
    if bad.any():
        i = int(bad.argmax())
        what = "the same time as" if step[i] == 0 else "earlier than"
        hint = "\n  hint: sort the rows by time" if (step < 0).mean() > MAX_SHUFFLED else ""
        raise UserError(
            f"{path}: {place} {line[i + 1]}, column time: {time[i + 1]:.10g} is {what} {place} {line[i]} "
            f"({time[i]:.10g}); time must increase from row to row "
            f"({bad.sum()} such row{'s' if bad.sum() > 1 else ''}){hint}"
        )
    bad = step > MAX_TIME_GAP
    if bad.any():
        i = int(bad.argmax())
        raise UserError(
            f"{path}: {place} {line[i + 1]}, column time: {step[i]:g} s after the previous row; "
            f"allowed: at most {MAX_TIME_GAP:g} s{_hint_at_time_unit(float(np.median(step)))}"
        )


def _check_channel(
    path: Path,
    data: dict[str, np.ndarray],
    line: np.ndarray,
    f: Field,
    notes: list[str],
    name: str,
    place: str,
) -> None:
    """Refuse a column that is empty or has too many values outside its range. Otherwise
    replace the values outside the range by NaN.

    Too many is more than the share MAX_OUTSIDE. `name`: column to check, f.name or the
    column of one wheel of axle f.name."""
    value = data[name]
    if np.isnan(value).all():
        raise UserError(f"{path}: column {name}: every cell is empty; allowed: {f.range_text}")
    with np.errstate(invalid="ignore"):
        bad = (value < f.low) | (value > f.high)
    if not bad.any():
        return
    i = int(bad.argmax())
    if bad.mean() > MAX_OUTSIDE:
        more = f" ({bad.sum()} such rows)" if bad.sum() > 1 else ""
        raise UserError(
            f"{path}: {place} {line[i]}, column {name}: {value[i]:g} is outside the allowed range "
            f"{f.range_text}{more}\n"
            f"  hint: {COLUMN_HINTS.get(f.name, 'the column must be in SI units')}"
        )
    data[name] = np.where(bad, np.nan, value)
    notes.append(
        f"{name}: {bad.sum()} values outside {f.range_text} are treated as missing "
        f"(first in {place} {line[i]})"
    )


def _hint_at_time_unit(step: float) -> str:
    """Return a hint if the median step [s] suggests that times are not in s; else ""."""
    if step < 0.5 * MIN_ROW_STEP:
        return "\n  hint: if the column holds minutes, multiply by 60; days: by 86400"
    if 1.0 <= step <= 200.0:
        return "\n  hint: if the column holds milliseconds, divide by 1000"
    if step > 200:
        return "\n  hint: if the column holds microseconds or nanoseconds, convert to seconds"
    return ""
