"""Reading a log: CSV in, checked arrays out. Every refusal names file, row, column and allowed range."""

from __future__ import annotations

import csv
from collections.abc import Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from tselab.core import CONFIG, INPUT, Field, library
from tselab.errors import UserError

DRIVES = ("steer_angle", "wheel_speed_front", "wheel_speed_rear")  # out of range: refused
MEASURES = ("accel_x", "accel_y", "yaw_rate")  # out of range: treated as missing
SIDES = {axle: (f"{axle}_left", f"{axle}_right") for axle in DRIVES[1:]}  # in place of the axle's mean
OPTIONAL = {  # columns that a log may have besides: unit, range, text, hint; `tselab gap` compares them, the estimator does not
    "vehicle_speed": ("m/s", -60.0, 120.0, "speed over ground of the centre of gravity: GNSS, optical", "km/h: divide by 3.6"),
    "wheel_torque_front": ("Nm", -20000.0, 20000.0, "drive less brake torque of both front wheels", "kNm: multiply by 1000"),
    "wheel_torque_rear": ("Nm", -20000.0, 20000.0, "drive less brake torque of both rear wheels", "kNm: multiply by 1000"),
}
FEW_OUTSIDE = 0.05  # share of values outside the range above which it is the column that is wrong
HINTS = {
    "steer_angle": "if the column holds degrees, multiply by pi/180; if it is the steering-wheel angle, divide by the "
    "steering ratio",
    "wheel_speed_front": "if the column holds rpm, multiply by 2 pi/60; if km/h or m/s, convert to m/s and divide by the "
    "wheel radius",
}
HINTS["yaw_rate"] = "if the column holds deg/s, multiply by pi/180"
HINTS["wheel_speed_rear"] = HINTS["wheel_speed_front"]
LONGEST_STEP = 3600.0  # s, the library's limit
PART = 1 << 15  # rows of the file read at a time, so that its text is never all in memory
SLOWEST = 1.0  # s: median step above this is refused


@dataclass
class Log:
    """A checked log. `data` has the channels of the library, NaN = missing; `line` is the line in the file, or the row (`word`)."""

    path: Path
    time: np.ndarray
    data: pd.DataFrame
    ref: pd.DataFrame
    line: np.ndarray
    sample_time: float | None
    notes: list[str] = field(default_factory=list)
    averaged: int = 1  # rows of the file in one of these, usually
    extra: pd.DataFrame = field(default_factory=pd.DataFrame)  # of OPTIONAL those that are there; NaN = missing
    word: str = "line"  # what `line` counts: lines of a file, or rows of a table

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
        return rows

    def steers_beyond(self, limit: float) -> np.ndarray:
        with np.errstate(invalid="ignore"):
            return np.abs(self.data["steer_angle"].to_numpy()) > limit


def columns() -> list[str]:
    return ["time", *(f.name for f in library().channels)]


def read_log(path: Path, spare: Collection[str] = ()) -> Log:
    """Read and check a log. `spare`: channels that may be missing altogether; they are NaN then, and a note says so."""
    path = Path(path)
    header = _header(path)
    wanted = columns()
    sides = {axle: pair for axle, pair in SIDES.items() if axle not in header and all(c in header for c in pair)}
    absent = [c for c in wanted if c in spare and c not in header]
    needed = [c for name in wanted if name not in absent for c in sides.get(name, (name,))]
    missing = [c for c in needed if c not in header]
    if missing:
        raise UserError(_missing_text(path, header, missing, needed))
    twice = sorted({c for c in header if header.count(c) > 1 and (c in needed or _beside(c))})
    if twice:
        raise UserError(f"{path}: column {_list(twice)} appears more than once in the header (line 1)")
    notes: list[str] = []
    table, line, skipped = _numbers(path, header, needed)
    if skipped:
        notes.append(f"column {_list(skipped)} is not numeric: not used")
    return _checked(path, table, line, _Wanted(sides, absent, needed, spare), notes)


def read_frame(frame: Mapping[str, Any] | pd.DataFrame, name: str = "log") -> Log:
    """The same of columns in memory: a data frame, or arrays by their names. `name` stands in messages; rows are counted from 0."""
    header = [str(c) for c in frame]
    sides = {axle: pair for axle, pair in SIDES.items() if axle not in header and all(c in header for c in pair)}
    needed = [c for wanted in columns() for c in sides.get(wanted, (wanted,))]
    if missing := [c for c in needed if c not in header]:
        also = "; left and right wheel may stand in place of an axle, both" if any(c in SIDES for c in missing) else ""
        there = f"\n  needed: {_list(needed)}\n  found: {_list(header)[:300]}"
        raise UserError(f"{name}: column {_list(missing)} is missing{also}{there}")
    twice = sorted({c for c in header if header.count(c) > 1})
    if twice:
        raise UserError(f"{name}: column {_list(twice)} appears more than once")
    notes: list[str] = []
    table: dict[str, np.ndarray] = {}
    for column in header:
        if column in needed or _beside(column):
            try:
                table[column] = np.array(frame[column], float)
            except (TypeError, ValueError):
                if column in needed:
                    what = _allowed(column)
                    raise UserError(f"{name}: column {column} is not numeric; allowed: {what}, or NaN for missing") from None
                notes.append(f"column {column} is not numeric: not used")
    rows = table["time"].shape
    for column, values in table.items():
        if values.shape != rows or values.ndim != 1:
            raise UserError(f"{name}: column {column} has shape {values.shape}; all need that of time, one number a row: {rows}")
    if rows == (0,):
        raise UserError(f"{name}: has no rows")
    return _checked(Path(name), table, np.arange(rows[0]), _Wanted(sides, [], needed, ()), notes, "row")


@dataclass(frozen=True)
class _Wanted:
    """Which columns a log is read from."""

    sides: dict[str, tuple[str, str]]  # axles that are given as two wheels
    absent: list[str]  # channels that may be missing, and are
    needed: list[str]
    spare: Collection[str]  # channels that may be missing


def _checked(
    path: Path, table: dict[str, np.ndarray], line: np.ndarray, w: _Wanted, notes: list[str], word: str = "line"
) -> Log:
    """A log of columns of numbers; `line` and `word` say where a row is to be found."""
    wanted, sides, absent, needed, spare = columns(), w.sides, w.absent, w.needed, w.spare
    time = table.pop("time")
    _check_time(path, time, line, word)
    data = pd.DataFrame({name: table.pop(name) for name in needed[1:]})
    for f in library().channels:
        if f.name in absent or (f.name in spare and data[f.name].isna().all()):
            data[f.name] = np.nan
            notes.append(f"{f.name} is not in the log")
            continue
        for name in sides.get(f.name, (f.name,)):
            _check_channel(path, data, line, f, notes, name, word)
    for axle, pair in sides.items():
        data[axle] = _axle(axle, *(data.pop(c).to_numpy(float) for c in pair), data["yaw_rate"].to_numpy(float), notes)
    data = data[wanted[1:]]
    sample_time = float(np.median(np.diff(time))) if len(time) > 1 else None
    if sample_time is not None and sample_time > SLOWEST:
        hint = _time_hint(sample_time)
        raise UserError(
            f"{path}: column time: rows are {sample_time:g} s apart (median); allowed: up to {SLOWEST:g} s{hint}"
        )
    for name in data:
        if 0 < (count := int(data[name].isna().sum())) < len(data):
            where = f"first in {word} {line[data[name].isna().to_numpy().argmax()]}"
            notes.append(f"{name}: {count} of {len(data)} cells are missing or not usable ({where})")
    ref = pd.DataFrame({c: table.pop(c) for c in list(table) if c.startswith("ref_")}, index=data.index)
    extra = pd.DataFrame({c: x for c in OPTIONAL if c in table and (x := _optional(c, table[c], line, notes, word)) is not None})
    return Log(path, time, data, ref, line, sample_time, notes, extra=extra, word=word)


def _axle(axle: str, left: np.ndarray, right: np.ndarray, yaw_rate: np.ndarray, notes: list[str]) -> np.ndarray:
    """The middle of an axle, rad/s, of its two wheels. Where one is missing, the other less half of what they differ by in a turn:
    track over radius times the yaw rate, found from the rows that have both."""
    difference, mean = right - left, 0.5 * (left + right)
    both = np.isfinite(difference) & np.isfinite(yaw_rate)
    turned = float(np.sum(yaw_rate[both] ** 2))
    per_turn = float(np.sum(difference[both] * yaw_rate[both])) / turned if turned > 0 else 0.0
    alone = np.isnan(mean) & (np.isfinite(left) | np.isfinite(right)) & np.isfinite(yaw_rate) & bool(turned > 0)
    if alone.any():
        half = 0.5 * per_turn * yaw_rate
        mean[alone] = np.where(np.isfinite(left), left + half, right - half)[alone]
        notes.append(f"{axle}: one of both wheels is missing in {alone.sum()} rows: taken from the other and the yaw rate")
    return mean


def _beside(column: str) -> bool:
    """A column that is read, though the estimator does not need it."""
    return column.startswith("ref_") or column in OPTIONAL


def _optional(name: str, column: np.ndarray, line: np.ndarray, notes: list[str], word: str) -> np.ndarray | None:
    """One of OPTIONAL, checked; None, and a note why, if it cannot be used. It refuses no log: the estimator needs none."""
    unit, low, high, _, hint = OPTIONAL[name]
    value = column.copy()
    with np.errstate(invalid="ignore"):
        bad = (value < low) | (value > high)
    there = int(np.isfinite(value).sum())
    if not there or bad.sum() > FEW_OUTSIDE * there:
        where = f"; {value[bad.argmax()]:g} in {word} {line[bad.argmax()]} is outside; hint: {hint}" if there else "; it is empty"
        notes.append(f"column {name} is not used: allowed are {low:g} .. {high:g} {unit}{where}")
        return None
    if bad.any():
        notes.append(f"{name}: {bad.sum()} values outside {low:g} .. {high:g} {unit} are treated as missing")
        value[bad] = np.nan
    return value


MOST_MISSING = 0.5  # of a block's rows: a channel of which more is missing is missing; a block of which more is, too


def average(log: Log, seconds: float) -> Log:
    """The log in blocks of so many seconds: every channel and reference its mean over the block, at the block's mean time,
    whatever the sampling. Noise that is white falls with the root of the rows in a block."""
    f = library().field(CONFIG, "sample_time")
    if not f.low <= seconds <= f.high:
        raise UserError(f"option --average: {seconds:g} is outside its range {f.low:g} .. {f.high:g} s")
    if log.sample_time is None or seconds < 1.5 * log.sample_time:
        have = f"are {log.sample_time:.3g} s apart" if log.sample_time else "are one"
        raise UserError(f"option --average: {seconds:g} s is no block of several rows: the rows of the log {have}")
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
    data = pd.DataFrame({name: means(log.data[name].to_numpy(float)) for name in log.data})
    ref = pd.DataFrame({name: means(log.ref[name].to_numpy(float)) for name in log.ref}, index=data.index)
    extra = pd.DataFrame({name: means(log.extra[name].to_numpy(float)) for name in log.extra}, index=data.index)
    step = float(np.median(np.diff(time))) if len(time) > 1 else None
    notes = [*log.notes, f"averaged over {seconds:g} s: {len(log)} rows became {len(time)}, of {usual:g} rows each"]
    return Log(log.path, time, data, ref, log.line[starts[keep]], step, notes, max(1, round(usual)), extra, log.word)


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
            f"{log.word} {log.line[1 + int(dt.argmax())]}): states restarted there, stiffness kept"
        )
    return notes


def steering_notes(log: Log, max_steer: float) -> list[str]:
    """The model takes angles as small: what is done where they are not."""
    large = log.steers_beyond(max_steer)
    if not large.any():
        return []
    return [
        f"steering beyond {max_steer:g} rad in {large.sum()} rows (first in {log.word} {log.line[large.argmax()]}): the model is "
        "made for small angles, so statistics are held there (max_steer)"
    ]


def _header(path: Path) -> list[str]:
    if path.is_dir():
        raise UserError(f"{path}: is a directory, not a log")
    try:
        with open(path, encoding="utf-8-sig", newline="") as file:
            head = file.read(65536)
            while file.read(1 << 20):  # the whole file must be text
                pass
    except FileNotFoundError:
        raise UserError(f"{path}: no such file") from None
    except UnicodeDecodeError as error:
        raise UserError(
            f"{path}: is not a text file in UTF-8 ({error.reason} at byte {error.start}); a CSV is needed"
        ) from None
    except OSError as error:
        raise UserError(f"{path}: cannot be read: {error.strerror}") from None
    if "\0" in head:
        raise UserError(f"{path}: is a binary file; a CSV is needed")
    if not head.strip():
        raise UserError(f"{path}: is empty")
    first = next(csv.reader(head.splitlines()[:1]), [])
    return [c.strip() for c in first]


def _missing_text(path: Path, header: list[str], missing: list[str], needed: list[str]) -> str:
    text = f"{path}: column {_list(missing)} is missing in the header (line 1)"
    if len(header) == 1 and any(s in header[0] for s in ";\t|"):
        text += "; the columns must be separated by commas"
    elif all(_is_number(c) for c in header):
        text += "; the first line must name the columns"
    else:
        lower = {c.lower(): c for c in header}
        if close := [f"{lower[m]} -> {m}" for m in missing if m in lower]:
            text += f"; names are lower case: {', '.join(close)}"
    text += "; left and right wheel may stand in place of an axle, both" if any(c in SIDES for c in missing) else ""
    return f"{text}\n  needed: {','.join(needed)}\n  found:  {','.join(header)[:300]}"


def _table(path: Path, header: list[str]) -> pd.DataFrame:
    with _parsing(path):
        return pd.read_csv(path, **_arguments(header))


def _arguments(header: list[str]) -> dict[str, Any]:
    """How a log is read by pandas."""
    return {
        "names": [f"{c}\0{i}" if header.count(c) > 1 else c for i, c in enumerate(header)],
        "header": None,
        "skiprows": 1,
        "index_col": False,
        "skip_blank_lines": False,
        "skipinitialspace": True,
        "encoding": "utf-8-sig",
        "low_memory": False,
    }


@contextmanager
def _parsing(path: Path) -> Iterator[None]:
    """Errors of the parser in our words."""
    try:
        yield
    except pd.errors.EmptyDataError:
        raise UserError(f"{path}: has a header but no rows") from None
    except pd.errors.ParserError as error:
        detail = str(error).replace("Error tokenizing data. C error: ", "").strip()
        raise UserError(f"{path}: is not a well-formed CSV: {detail}") from None


def _numbers(path: Path, header: list[str], needed: list[str]) -> tuple[dict[str, np.ndarray], np.ndarray, list[str]]:
    """Every column that is read as numbers, in the file's order; the lines in the file; columns that are left out. A cell that
    is not a number is an error, or in a column that is not needed the end of that column. Rows without any of what is needed
    are blank."""
    wanted = [c for c in header if c in needed or _beside(c)]
    columns: dict[str, list[np.ndarray]] = {name: [] for name in wanted}
    lines: list[np.ndarray] = []
    wrong: dict[str, tuple[int, str]] = {}  # column -> line and text of its first cell that is not a number
    with _parsing(path), pd.read_csv(path, **_arguments(header), chunksize=PART) as parts:
        for part in parts:
            line = part.index.to_numpy() + 2
            filled = part[needed].notna().any(axis=1).to_numpy()
            lines.append(line[filled])
            for name in wanted:
                column = part[name] if filled.all() else part[name][filled]
                numbers = pd.to_numeric(column, errors="coerce")
                if column.dtype == bool:
                    numbers = pd.Series(np.nan, index=column.index)
                bad = (numbers.isna() & column.notna()).to_numpy()
                if bad.any() and name not in wrong:
                    wrong[name] = int(lines[-1][bad.argmax()]), str(column.iloc[int(bad.argmax())])
                columns[name].append(numbers.to_numpy(float))
    if not sum(map(len, lines)):
        raise UserError(f"{path}: has a header but no rows")
    for name in wanted:
        if name in needed and name in wrong:
            at, text = wrong[name]
            hint = "; decimals are written with a point" if "," in text else ""
            raise UserError(
                f"{path}: line {at}, column {name}: {text[:40]!r} is not a number; allowed: {_allowed(name)}, or empty for "
                f"missing{hint}"
            )
    skipped = [name for name in wanted if name in wrong]
    return {c: np.concatenate(columns.pop(c)) for c in wanted if c not in wrong}, np.concatenate(lines), skipped


def _check_time(path: Path, time: np.ndarray, line: np.ndarray, word: str) -> None:
    bad = ~np.isfinite(time)
    if bad.any():
        raise UserError(
            f"{path}: {word} {line[bad.argmax()]}, column time: empty or not finite; every row needs a time in s"
        )
    step = np.diff(time)
    bad = step <= 0
    if bad.any():
        i = int(bad.argmax())
        what = "the same time as" if step[i] == 0 else "earlier than"
        raise UserError(
            f"{path}: {word} {line[i + 1]}, column time: {time[i + 1]:.10g} is {what} {word} {line[i]} ({time[i]:.10g}); time must "
            f"increase from row to row ({bad.sum()} such row{'s' if bad.sum() > 1 else ''})"
        )
    bad = step > LONGEST_STEP
    if bad.any():
        i = int(bad.argmax())
        raise UserError(
            f"{path}: {word} {line[i + 1]}, column time: {step[i]:g} s after the row before; allowed: up to {LONGEST_STEP:g} s"
            f"{_time_hint(float(np.median(step)))}"
        )


def _check_channel(path: Path, data: pd.DataFrame, line: np.ndarray, f: Field, notes: list[str], name: str, word: str) -> None:
    """`name`: of the column, which may be one side of the channel f."""
    value = data[name].to_numpy(copy=True)
    if np.isnan(value).all():
        raise UserError(f"{path}: column {name}: every cell is empty; allowed: {f.range_text}")
    with np.errstate(invalid="ignore"):
        bad = (value < f.low) | (value > f.high)
    if not bad.any():
        return
    i = int(bad.argmax())
    if f.name in DRIVES or bad.mean() > 0.05:
        more = f" ({bad.sum()} such rows)" if bad.sum() > 1 else ""
        raise UserError(
            f"{path}: {word} {line[i]}, column {name}: {value[i]:g} is outside the allowed range {f.range_text}{more}\n"
            f"  hint: {HINTS.get(f.name, 'the column must be in SI units')}"
        )
    value[bad] = np.nan
    data[name] = value
    notes.append(
        f"{name}: {bad.sum()} values outside {f.range_text} are treated as missing (first in {word} {line[i]})"
    )


def _allowed(name: str) -> str:
    channel = next((axle for axle, pair in SIDES.items() if name in pair), name)
    return "seconds, increasing" if name == "time" else library().field(INPUT, channel).range_text


def _time_hint(step: float) -> str:
    if 1.0 <= step <= 200.0:
        return "\n  hint: if the column holds milliseconds, divide by 1000"
    return "\n  hint: if the column holds microseconds or nanoseconds, convert to seconds" if step > 200 else ""


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _list(names: Iterable[str]) -> str:
    return ", ".join(names)
