"""A log as it is used: channels, rows that are checked whoever has read them, and what may be asked of them. Every refusal names
file, row, column and allowed range; a few bad cells are missing, and a note says so."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tse.library.core import CONFIG, INPUT, Field, library
from tse.library.errors import UserError
from tse.log.clock import LONGEST_GAP, straight

if TYPE_CHECKING:
    import pandas as pd

DRIVES = ("steer_angle", "wheel_speed_front", "wheel_speed_rear")  # drive the model
MEASURES = ("accel_x", "accel_y", "yaw_rate")  # are compared with it
SIDES = {axle: (f"{axle}_left", f"{axle}_right") for axle in DRIVES[1:]}  # in place of the axle's mean
# columns that a log may have besides: unit, range, text, hint. The estimator uses those of the library (input.toml);
# vehicle_speed checks the units of the others
OPTIONAL = {
    "vehicle_speed": (
        "m/s",
        -60.0,
        120.0,
        "speed over ground of the centre of gravity: GNSS, optical",
        "km/h: divide by 3.6",
    ),
    "ins_vel_x": (
        "m/s",
        -120.0,
        120.0,
        "velocity along the car, of an INS or an optical sensor",
        "km/h: divide by 3.6",
    ),
    "ins_vel_y": ("m/s", -60.0, 60.0, "velocity across the car, positive left", "km/h: divide by 3.6"),
    "gnss_speed": ("m/s", 0.0, 120.0, "speed over ground", "km/h: divide by 3.6"),
    "gnss_course": (
        "rad",
        -7.0,
        7.0,
        "direction over ground, positive left, from any zero",
        "degrees clockwise from north: multiply by -pi/180",
    ),
    "brake": (
        "1",
        0.0,
        1.0,
        "the car brakes: 1 yes, 0 no",
        "a pressure: name it in signals.toml, with above = the pressure from which the car brakes",
    ),
    "wheel_torque_front": (
        "Nm",
        -20000.0,
        20000.0,
        "drive less brake torque of both front wheels",
        "kNm: multiply by 1000",
    ),
    "wheel_torque_rear": (
        "Nm",
        -20000.0,
        20000.0,
        "drive less brake torque of both rear wheels",
        "kNm: multiply by 1000",
    ),
    "bank": ("rad", -0.35, 0.35, "whole bank of the road, left side high > 0", "degrees: multiply by pi/180"),
    "grade": ("rad", -0.35, 0.35, "whole slope of the road, uphill > 0", "percent: divide by 100"),
    "gnss_latitude": (
        "deg",
        -90.0,
        90.0,
        "latitude, positive north; finds the place on a road",
        "radians: multiply by 180/pi",
    ),
    "gnss_longitude": ("deg", -180.0, 180.0, "longitude, positive east", "radians: multiply by 180/pi"),
}
VELOCITIES = ("ins_vel_x", "ins_vel_y", "gnss_speed", "gnss_course")  # of OPTIONAL
ROAD = ("bank", "grade")
TORQUES = ("wheel_torque_front", "wheel_torque_rear")
SHUFFLED = (
    0.2  # share of rows that are earlier than the one before, above which they are in another order than time
)
MOST_BACK = 0.5  # share of rows that are not later than the one before, above which the column is no time
FEW_OUTSIDE = 0.05  # share of values outside the range above which it is the column that is wrong
HINTS = {
    "steer_angle": "if the column holds degrees, multiply by pi/180; if it is the steering-wheel angle, divide by the "
    "steering ratio",
    "wheel_speed_front": "if the column holds rpm, multiply by 2 pi/60; if km/h or m/s, convert to m/s and divide by the "
    "wheel radius",
}
HINTS["yaw_rate"] = "if the column holds deg/s, multiply by pi/180"
HINTS["wheel_speed_rear"] = HINTS["wheel_speed_front"]
FASTEST, SLOWEST = 0.001, 1.0  # s: rows of a log are so far apart; a median step above is refused
TURN_SHOWN = (
    0.5  # share of right less left wheel that must be the yaw rate for it to say how wide the track is
)
COMPUTED = 0.015  # of accel_y, that speed times yaw rate leaves of it: less, and it was computed from them; 0.04 without any noise
# zeros that are no values: times in the log, so many steps of a row off, share of all times that it is 0
WRITTEN_RUNS, WRITTEN_STEPS, WRITTEN_SHARE = 10, 4.0, 0.2
ALONE, ALONE_ROWS, ALONE_VALUES = 1.5, 5, 10  # of the next value; rows; values that the others have at least
STUCK_ROWS = 200  # rows with one and the same value, from which a channel is said to be stuck
MOST_WITNESS = 100000  # rows of a longer log that are looked at for it
# a measurement, what it goes with, and by how much that has to change (5 .. 95 %) for it to change, too
WITNESSES = (
    ("accel_x", "wheel_speed_rear", 5.0),  # rad/s: 1.5 m/s of speed
    ("accel_y", "yaw_rate", 0.05),  # rad/s: 0.5 m/s2 at 10 m/s
    ("yaw_rate", "accel_y", 0.5),  # m/s2
)


@dataclass(frozen=True)
class Reading:
    """How a log is to be read: the options of every command that takes one."""

    signals: Path | None = None  # signals.toml; None: the one beside the log, if there is one
    rate: float | None = None  # Hz of the rows; None: as they are, or as signals.toml says
    strict: bool = False  # refuse what otherwise is a warning
    databases: tuple[Path, ...] = ()  # of the bus
    car: Any | None = None  # vehicle.Vehicle: radii of the wheels, steering ratio

    def files(self, log: Path) -> list[Path]:
        """The files beside the log on which its rows depend."""
        beside = beside_of(log) if self.signals is None else self.signals
        return [p for p in (beside, *self.databases) if p is not None and p.is_file()]


@dataclass(frozen=True)
class Slower:
    """The entries of a channel that was interpolated: their time, s, and values; and rows per entry."""

    time: np.ndarray
    value: np.ndarray
    rows: float


def give_optional(rows: np.ndarray, columns: Mapping[str, np.ndarray]) -> None:
    """Fill the optional channels of rows for the library, where they have a value; a course within -pi .. pi rad."""
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
class Log:
    """A checked log. `data` has the channels of the library, NaN = missing; `line` is the line in the file."""

    path: Path
    time: np.ndarray
    data: pd.DataFrame
    ref: pd.DataFrame
    line: np.ndarray
    sample_time: float | None
    notes: list[str] = field(default_factory=list)
    averaged: int = 1  # rows of the file in one of these, usually
    extra: pd.DataFrame = field(
        default_factory=lambda: _frame({}, 0)
    )  # of OPTIONAL those that are there; NaN = missing
    place: str = "line"  # what `line` counts, for people: lines of the file, or rows of the raster
    stand_in: str | None = (
        None  # an axle without wheel speeds: it has the other's, and slip is not observable
    )
    stands_by: float = 1.0  # ... times that, which depends on the radii of the car: adapt_to_car()
    slower: dict[str, Slower] = field(
        default_factory=dict
    )  # channels whose entries are further apart than the rows
    # of an axle with two wheels: right less left over the yaw rate, track/radius
    turn: dict[str, float] = field(default_factory=dict)
    warnings: list[str] = field(default_factory=list)  # of `notes` those that --strict refuses

    def __len__(self) -> int:
        return len(self.time)

    @property
    def dt(self) -> np.ndarray:
        """Time since the previous row; the first is the sample time."""
        return np.diff(self.time, prepend=self.time[0] - (self.sample_time or 0.01))

    def rows(self, first: int = 0, last: int | None = None) -> np.ndarray:
        """The rows as the library takes them; all, or those from `first` to before `last`."""
        part = slice(first, last)
        rows = np.zeros(len(self.time[part]), library().dtype(INPUT))
        before = self.time[first - 1] if first else self.time[0] - (self.sample_time or 0.01)
        rows["dt"] = np.diff(self.time[part], prepend=before)
        for name in self.data:
            rows[name] = self.data[name].to_numpy()[part]
        give_optional(rows, {name: self.extra[name].to_numpy(float)[part] for name in self.optional})
        return rows

    @property
    def optional(self) -> list[str]:
        """Return the channels of input.toml that are optional, that the log has."""
        return [f.name for f in library().optional if f.name in self.extra]

    def steers_beyond(self, limit: float) -> np.ndarray:
        with np.errstate(invalid="ignore"):
            return np.abs(self.data["steer_angle"].to_numpy()) > limit


def columns() -> list[str]:
    return ["time", *(f.name for f in library().channels)]


def files_of(path: Path) -> list[Path]:
    """The files of a log: itself, or those of the folder that it is."""
    path = Path(path)
    return sorted(p for p in path.rglob("*") if p.is_file()) if path.is_dir() else [path]


def beside_of(path: Path) -> Path | None:
    """The signals.toml that stands beside a log: of its own name, or of its folder."""
    path = Path(path)
    for name in (f"{path.stem}.signals.toml", "signals.toml"):
        if (path.parent / name).is_file():
            return path.parent / name
    return None


def lacking(names: Collection[str], sides: Collection[str], spare: Collection[str]) -> list[str]:
    """Channels that the log does not have and that may be missing: `spare`, and one of both axles."""
    other = {n.lower() for n in names} - {*names}  # written otherwise: not missing, misspelt
    gone = [c for c in columns() if c not in names and c not in sides and c not in other]
    axles = [c for c in gone if c in SIDES]
    # one wheel of an axle that is there is an oversight, and refused
    alone = axles if len(axles) == 1 and not any(s in names for s in SIDES[axles[0]]) else []
    return [c for c in gone if c in spare or c in alone]


def checked(
    path: Path,
    time: np.ndarray,
    table: dict[str, np.ndarray],
    line: np.ndarray,
    notes: list[str],
    spare: Collection[str] = MEASURES,
    place: str = "line",
) -> Log:
    """A log from columns in SI units, (rows,), with the library's names; wheels also by their side. `line`: of each row, in the
    file (`place`: what it counts). UserError: a column that cannot be what it is called."""
    wanted = columns()[1:]
    sides = {
        axle: pair for axle, pair in SIDES.items() if axle not in table and all(c in table for c in pair)
    }
    parts = {name: sides.get(name, (name,)) for name in wanted}
    empty = []
    for c, mine in parts.items():
        if not any(s in table and np.isfinite(table[s]).any() for s in mine):
            empty.append(c)
    absent = lacking([c for c in wanted if c not in empty], [], spare)
    needed = [c for name in wanted if name not in absent for c in parts[name]]
    missing = [c for c in needed if c not in table]
    if missing:
        raise UserError(f"{path}: {', '.join(missing)} is missing{_remedy(missing)}")
    data = {name: table.pop(name) for name in needed}
    for f in library().channels:
        if f.name in absent:
            data[f.name] = np.full(len(time), np.nan)
            if f.name not in SIDES:
                notes.append(f"{f.name} is not in the log: what only it shows is not known")
            continue
        for name in parts[f.name]:
            _check_channel(path, data, line, f, notes, name, place)
    for name in data:
        _not_code(data, name, notes)
        _not_written(data, name, notes)
    _not_stuck(data, parts, notes)
    if all(np.isnan(data[c]).all() for c in ("accel_y", "yaw_rate")):
        raise UserError(
            f"{path}: accel_y and yaw_rate are missing: without either nothing can be said about the tyres"
        )
    per_turn: dict[str, float] = {}
    for axle, pair in sides.items():
        if axle not in absent:
            mean, per_turn[axle] = _axle(axle, *(data.pop(c) for c in pair), data["yaw_rate"], notes)
            data[axle] = mean
            del mean
    _not_computed(data, notes)
    stand_in = next((c for c in absent if c in SIDES), None)
    if stand_in:
        other = next(c for c in SIDES if c != stand_in)
        data[stand_in] = data[other].copy()
        data["accel_x"] = np.full(len(time), np.nan)  # what it tells is a force at a slip that nobody knows
        notes.append(
            f"{stand_in} is not in the log: {other} stands in for it; slip is not known, so accel_x is not used and "
            f"cx_front not estimated"
        )
    sample_time = float(np.median(np.diff(time))) if len(time) > 1 else None
    if sample_time is not None and sample_time > SLOWEST:
        hint = _time_hint(sample_time)
        raise UserError(
            f"{path}: column time: rows are {sample_time:g} s apart (median); allowed: up to {SLOWEST:g} s{hint}"
        )
    if sample_time is not None and sample_time < 0.5 * FASTEST:
        hint = _time_hint(sample_time)
        raise UserError(
            f"{path}: column time: rows are {sample_time:.3g} s apart (median); allowed: from {FASTEST:g} s{hint}"
        )
    for name in wanted:
        gone = np.isnan(data[name])
        if 0 < (count := int(gone.sum())) < len(time):
            where = f"first in {place} {line[gone.argmax()]}"
            notes.append(f"{name}: {count} of {len(time)} cells are missing or not usable ({where})")
    frame = _frame({name: data[name] for name in wanted}, len(time))
    ref = _frame({c: table.pop(c) for c in list(table) if c.startswith("ref_")}, len(time))
    some = {
        c: x for c in OPTIONAL if c in table and (x := _optional(c, table[c], line, notes, place)) is not None
    }
    extra = _frame(some, len(time) if some else 0)
    return Log(
        path,
        time,
        frame,
        ref,
        line,
        sample_time,
        notes,
        extra=extra,
        place=place,
        stand_in=stand_in,
        turn=per_turn,
    )


def _not_stuck(data: dict[str, np.ndarray], parts: Mapping[str, Sequence[str]], notes: list[str]) -> None:
    """A measurement that has one value all the time, while the car does what it should show, measures nothing: it is missing.
    The filter would find it at fault, but only row by row, and what it says before that is lost."""
    for name, witness, least in WITNESSES:
        value = data[name]
        first = int(np.isfinite(value).argmax())
        if np.isfinite(value).sum() < STUCK_ROWS or np.nanmin(value) != np.nanmax(value):
            continue
        other = next((data[c] for c in parts.get(witness, ()) if c in data), np.zeros(0))
        other = other[:: max(1, len(other) // MOST_WITNESS)]
        other = other[np.isfinite(other)]
        if len(other) and np.subtract(*np.quantile(other, [0.95, 0.05])) > least:
            notes.append(
                f"{name} is {value[first]:g} in every row, while {witness} changes: it measures nothing and is taken as missing"
            )
            data[name] = np.full(len(value), np.nan)


def _not_code(data: dict[str, np.ndarray], name: str, notes: list[str]) -> None:
    """A value far from all others, of many rows to the last digit, is none: a bus says so that there is no value."""
    size = np.abs(data[name])
    top = float(np.nanmax(size)) if np.isfinite(size).any() else 0.0
    rows = size == top
    if not ALONE_ROWS <= rows.sum() < MOST_BACK * len(rows):
        return
    others = size[np.isfinite(size) & ~rows]
    if not len(others) or not top > ALONE * others.max() or len(np.unique(others)) < ALONE_VALUES:
        return
    value = data[name][rows.argmax()]
    notes.append(
        f"{name} is {value:g} in {rows.sum()} rows and at most {others.max():.3g} in the others: no value, and missing"
    )
    data[name] = np.where(rows, np.nan, data[name])


def _not_written(data: dict[str, np.ndarray], name: str, notes: list[str]) -> None:
    """A zero between two values of one sign, both further from it than the channel moves in a row, was written for a missing one;
    where many are, all are."""
    value = data[name]
    zero = value == 0.0
    edges = np.flatnonzero(np.diff(np.concatenate([[0], zero.astype(np.int8), [0]])))
    first, after = edges[::2], edges[1::2]
    inner = (first > 0) & (after < len(value))
    first, after = first[inner], after[inner]
    if len(first) < WRITTEN_RUNS:
        return
    steps = np.abs(np.diff(value))[~(zero[1:] | zero[:-1])]
    steps = steps[np.isfinite(steps)]
    moves = WRITTEN_STEPS * float(np.quantile(steps, 0.95)) if len(steps) else np.inf
    before, then = value[first - 1], value[after]
    written = (before * then > 0) & (np.minimum(np.abs(before), np.abs(then)) > moves)
    if written.sum() < WRITTEN_RUNS or written.sum() < WRITTEN_SHARE * len(first):
        return
    notes.append(
        f"{name} is 0 in {zero.sum()} rows, between values far from it: written where there is none, and missing"
    )
    data[name] = np.where(zero, np.nan, value)


def _not_computed(data: dict[str, np.ndarray], notes: list[str]) -> None:
    """An accel_y that is speed times yaw rate, but for the last digits, was not measured: it says nothing that they do not."""
    y = data["accel_y"]
    for wheel in SIDES:
        x = data[wheel] * data["yaw_rate"] if wheel in data else np.full(len(y), np.nan)
        both = np.isfinite(x) & np.isfinite(y)
        across, turned = float(np.sum(y[both] ** 2)), float(np.sum(x[both] ** 2))
        if both.sum() < STUCK_ROWS or not np.std(y[both]) > 0 or not turned > 0:
            continue
        explained = float(np.sum(x[both] * y[both])) ** 2 / (turned * across)
        if 1.0 - explained < COMPUTED**2:
            notes.append(
                "accel_y is speed times yaw_rate to the digit: computed, not measured, and taken as missing"
            )
            data["accel_y"] = np.full(len(y), np.nan)
            return


def _frame(columns: dict[str, np.ndarray], rows: int) -> pd.DataFrame:
    """The columns as they are: a copy of ten hours is another 200 MB. A filter for rows that come one at a time has no frames, and
    needs no pandas."""
    import pandas as pd

    return pd.DataFrame(columns, index=range(rows), copy=False)


def liveliest(log: Log, rows: int) -> Log:
    """Of a log that is longer the part of so many rows in which the car turns most: enough to say what its sensors are like. Of
    rows that are further apart than 0.01 s as much time."""
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
        name: Slower(s.time[inside], s.value[inside], s.rows)
        for name, s in log.slower.items()
        for inside in ((s.time >= begin) & (s.time <= end),)
    }
    data, ref, extra = (t.iloc[part].reset_index(drop=True) for t in (log.data, log.ref, log.extra))
    return replace(
        log, time=log.time[part], data=data, ref=ref, extra=extra, line=log.line[part], slower=slower
    )


def _remedy(missing: Collection[str]) -> str:
    if any(c.endswith(("_left", "_right")) for c in missing):
        return ": both wheels of an axle are needed, or the axle's mean"
    if "steer_angle" in missing:
        return ": without the steering angle nothing can be said about the tyres; name its signal in signals.toml"
    return ": name its signal in signals.toml"


def _axle(
    axle: str, left: np.ndarray, right: np.ndarray, yaw_rate: np.ndarray, notes: list[str]
) -> tuple[np.ndarray, float]:
    """The middle of an axle, rad/s, of its two wheels. Where one is missing, the other less half of what they differ by in a turn:
    track over radius times the yaw rate, found from the rows that have both, which is returned, too."""
    difference = right - left
    both = np.isfinite(difference) & np.isfinite(yaw_rate)
    rate = yaw_rate if both.all() else yaw_rate[both]
    turned = float(np.sum(rate**2))
    difference = difference if both.all() else difference[both]
    differed = float(np.sum(difference**2))
    difference *= rate  # in place, as the mean below: a column of ten hours is 30 MB
    per_turn = float(np.sum(difference)) / turned if turned > 0 else 0.0
    del difference, rate
    mean = left + right
    mean *= 0.5
    alone = (
        np.isnan(mean) & (np.isfinite(left) | np.isfinite(right)) & np.isfinite(yaw_rate) & bool(turned > 0)
    )
    if alone.any():
        half = 0.5 * per_turn * yaw_rate
        mean[alone] = np.where(np.isfinite(left), left + half, right - half)[alone]
        notes.append(
            f"{axle}: one of both wheels is missing in {alone.sum()} rows: taken from the other and the yaw rate"
        )
    # on a straight road both are noise, and do not show units
    shown = bool(per_turn**2 * turned > TURN_SHOWN * differed)
    return mean, per_turn if shown else 0.0


def _optional(
    name: str, column: np.ndarray, line: np.ndarray, notes: list[str], place: str = "line"
) -> np.ndarray | None:
    """One of OPTIONAL, checked; None, and a note why, if it cannot be used. It refuses no log: the estimator needs none."""
    unit, low, high, _, hint = OPTIONAL[name]
    value = column.copy()
    with np.errstate(invalid="ignore"):
        bad = (value < low) | (value > high)
    there = int(np.isfinite(value).sum())
    if not there or bad.sum() > FEW_OUTSIDE * there:
        where = (
            f"; {value[bad.argmax()]:g} in {place} {line[bad.argmax()]} is outside; hint: {hint}"
            if there
            else "; it is empty"
        )
        notes.append(f"column {name} is not used: allowed are {low:g} .. {high:g} {unit}{where}")
        return None
    if bad.any():
        notes.append(f"{name}: {bad.sum()} values outside {low:g} .. {high:g} {unit} are treated as missing")
        value[bad] = np.nan
    return value


def _straight_angle(name: str, column: pd.Series) -> np.ndarray:
    """Return a column without the steps of an angle that wraps; `Log.rows` wraps it again."""
    value = column.to_numpy(float).copy()
    if name == "gnss_course":
        there = np.isfinite(value)
        value[there] = np.unwrap(value[there])
    return value


MOST_MISSING = (
    0.5  # of a block's rows: a channel of which more is missing is missing; a block of which more is, too
)


def average(log: Log, seconds: float) -> Log:
    """The log in blocks of so many seconds: every channel and reference its mean over the block, at the block's mean time,
    whatever the sampling. Noise that is white falls with the root of the rows in a block."""
    f = library().field(CONFIG, "sample_time")
    if not f.low <= seconds <= f.high:
        raise UserError(f"option --average: {seconds:g} is outside its range {f.low:g} .. {f.high:g} s")
    if log.sample_time is None or seconds < 1.5 * log.sample_time:
        have = f"are {log.sample_time:.3g} s apart" if log.sample_time else "are one"
        raise UserError(
            f"option --average: {seconds:g} s is no block of several rows: the rows of the log {have}"
        )
    block = np.floor((log.time - log.time[0]) / seconds + 1e-6).astype(np.int64)
    starts = np.flatnonzero(np.diff(block, prepend=-1))
    count = np.diff(np.append(starts, len(log)))
    usual = float(np.median(count))
    keep = count > MOST_MISSING * usual if len(count) > 1 else np.ones(1, bool)

    def means(x: np.ndarray) -> np.ndarray:
        good = np.isfinite(x)
        present = np.add.reduceat(good.astype(float), starts)
        total = np.add.reduceat(np.where(good, x, 0.0), starts)
        return np.where(present > (1 - MOST_MISSING) * count, total / np.maximum(present, 1), np.nan)[keep]

    time = means(log.time)
    data = _frame({name: means(log.data[name].to_numpy(float)) for name in log.data}, len(time))
    ref = _frame({name: means(log.ref[name].to_numpy(float)) for name in log.ref}, len(time))
    extra = _frame({name: means(_straight_angle(name, log.extra[name])) for name in log.extra}, len(time))
    step = float(np.median(np.diff(time))) if len(time) > 1 else None
    notes = [
        *log.notes,
        f"averaged over {seconds:g} s: {len(log)} rows became {len(time)}, of {usual:g} rows each",
    ]
    slower = {
        name: Slower(x.time, x.value, x.rows / usual) for name, x in log.slower.items() if x.rows > usual
    }
    return replace(log, time=time, data=data, ref=ref, line=log.line[starts[keep]], sample_time=step, notes=notes,
                   averaged=max(1, round(usual)), extra=extra, slower=slower)  # fmt: skip


def sampling_notes(log: Log, max_gap: float) -> list[str]:
    """What is odd about the sampling, in words."""
    if len(log) < 2 or log.sample_time is None:
        return ["the log has a single row"]
    dt = np.diff(log.time)
    notes = []
    off = np.abs(dt - log.sample_time) > 0.1 * log.sample_time
    if off.mean() > 0.01:
        notes.append(
            f"irregular sampling: {100 * off.mean():.0f} % of the steps differ from the median by more than 10 %"
        )
    gaps = np.flatnonzero(dt > max_gap)
    if len(gaps):
        notes.append(
            f"{len(gaps)} gap{'s' if len(gaps) > 1 else ''} longer than {max_gap:g} s (the longest {dt.max():.3g} s, before "
            f"{log.place} {log.line[1 + int(dt.argmax())]}): states restarted there, stiffness kept"
        )
    return notes


def steering_notes(log: Log, max_steer: float) -> list[str]:
    """The model takes angles as small: what is done where they are not."""
    large = log.steers_beyond(max_steer)
    if not large.any():
        return []
    return [
        f"steering beyond {max_steer:g} rad in {large.sum()} rows (first in {log.place} {log.line[large.argmax()]}): the model is "
        "made for small angles, so statistics are held there (max_steer)"
    ]


def straightened(
    path: Path, time: np.ndarray, line: np.ndarray, notes: list[str], place: str = "line"
) -> tuple[np.ndarray, np.ndarray]:
    """A time that increases, and which rows are kept. UserError: it is no time."""
    if np.isfinite(time).sum() > 1 and (np.diff(time[np.isfinite(time)]) <= 0).mean() > MOST_BACK:
        check_time(path, time, line, place)
    step = np.diff(time[np.isfinite(time)])
    if len(step) > 1 and ((step < 0).mean() > SHUFFLED or np.median(step) > LONGEST_GAP):
        check_time(path, time[np.isfinite(time)], line[np.isfinite(time)], place)
    fixed, keep, said = straight(time)
    if keep.sum() < MOST_BACK * len(time):
        check_time(path, time, line, place)
    notes += [f"time: {text}" for text in said]
    return fixed, keep


def check_time(path: Path, time: np.ndarray, line: np.ndarray, place: str = "line") -> None:
    bad = ~np.isfinite(time)
    if bad.any():
        raise UserError(
            f"{path}: {place} {line[bad.argmax()]}, column time: empty or not finite; every row needs a time in s"
        )
    step = np.diff(time)
    bad = step <= 0
    if bad.any():
        i = int(bad.argmax())
        what = "the same time as" if step[i] == 0 else "earlier than"
        hint = "\n  hint: sort the rows by time" if (step < 0).mean() > SHUFFLED else ""
        raise UserError(
            f"{path}: {place} {line[i + 1]}, column time: {time[i + 1]:.10g} is {what} {place} {line[i]} ({time[i]:.10g}); "
            f"time must increase from row to row ({bad.sum()} such row{'s' if bad.sum() > 1 else ''}){hint}"
        )
    bad = step > LONGEST_GAP
    if bad.any():
        i = int(bad.argmax())
        raise UserError(
            f"{path}: {place} {line[i + 1]}, column time: {step[i]:g} s after the row before; allowed: up to {LONGEST_GAP:g} s"
            f"{_time_hint(float(np.median(step)))}"
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
    """`name`: of the column, which may be one side of the channel f. A few values that nothing can have are missing."""
    value = data[name]
    if np.isnan(value).all():
        raise UserError(f"{path}: column {name}: every cell is empty; allowed: {f.range_text}")
    with np.errstate(invalid="ignore"):
        bad = (value < f.low) | (value > f.high)
    if not bad.any():
        return
    i = int(bad.argmax())
    if bad.mean() > FEW_OUTSIDE:
        more = f" ({bad.sum()} such rows)" if bad.sum() > 1 else ""
        raise UserError(
            f"{path}: {place} {line[i]}, column {name}: {value[i]:g} is outside the allowed range {f.range_text}{more}\n"
            f"  hint: {HINTS.get(f.name, 'the column must be in SI units')}"
        )
    data[name] = np.where(bad, np.nan, value)
    notes.append(
        f"{name}: {bad.sum()} values outside {f.range_text} are treated as missing (first in {place} {line[i]})"
    )


def _time_hint(step: float) -> str:
    if step < 0.5 * FASTEST:
        return "\n  hint: if the column holds minutes, multiply by 60; days: by 86400"
    if 1.0 <= step <= 200.0:
        return "\n  hint: if the column holds milliseconds, divide by 1000"
    return (
        "\n  hint: if the column holds microseconds or nanoseconds, convert to seconds" if step > 200 else ""
    )
