"""Read a log: a CSV with the names of the library, a frame, or any format of readers.py. tse.impl.rows checks what comes."""

import re
import shlex
from collections.abc import Collection, Mapping
from dataclasses import replace
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from tse.impl.core import INPUT, library
from tse.impl.errors import NoFile, UserError
from tse.impl.logs.mapping import Series, series
from tse.impl.logs.raster import on_raster
from tse.impl.logs.read_text import parsing
from tse.impl.logs.readers import read_recording
from tse.impl.logs.recording import PIECE, ROW, Recording, cells_of, check_columns, check_rows, in_room, in_time, listed
from tse.impl.logs.signals import FASTEST, SLOWEST, Signal, Signals, find_signals, known_channels
from tse.impl.logs.table import PACKED, Column, is_packed, of_packed, seconds
from tse.impl.rows import (
    FEW_OUTSIDE,
    MEASURES,
    OPTIONAL,
    SIDES,
    Log,
    Reading,
    Slower,
    beside_of,
    checked,
    columns,
    lacking,
    straightened,
)
from tse.impl.vehicle import Vehicle

_CLOCK = re.compile(r"\d{1,2}:\d{2}")
_DECIMAL_COMMA = re.compile(r"[-+]?\d*,\d+([eE][-+]?\d+)?")
NEEDED = ("steer_angle", "wheel_speed_front", "wheel_speed_rear")


def read_log(path: Path, spare: Collection[str] = MEASURES, reading: Reading | None = None) -> Log:
    """Read and check a log. `spare`: channels that may be missing altogether; they are NaN then, and a note says so."""
    path, reading = Path(path), reading or Reading()
    with in_room(path), in_time(path):
        log = _read_plain(path, spare) if _is_plain(path, reading) else read_any(path, spare, reading)
    if reading.car is not None:
        log = of_car(log, reading.car)
    if reading.strict and log.warnings:
        raise UserError(f"{path}: option --strict: {log.warnings[0]}")
    return log


def of_car(log: Log, car: Vehicle) -> Log:
    """Return the log with the wheel speed that stands in for an axle's by the radii of this car."""
    if log.stand_in is None:
        return log
    front, rear = (car.values[f"wheel_radius_{a}"] for a in ("front", "rear"))
    by = rear / front if log.stand_in.endswith("front") else front / rear
    data = log.data.assign(**{log.stand_in: log.data[log.stand_in] * (by / log.stands_by)})
    return replace(log, data=data, stands_by=by)


def _is_plain(path: Path, reading: Reading) -> bool:
    """A CSV with commas and the library's names, of which nobody says that it is to be read otherwise."""
    if reading.signals is not None or reading.rate is not None or (path.exists() and not path.is_file()):
        return False
    try:
        with open(path, encoding="utf-8-sig", newline="") as file:
            head = file.read(65536)
    except (OSError, UnicodeDecodeError):
        return False
    lines = [cells_of(path, x) for x in head.splitlines()[:2]] if "\0" not in head else []
    names = [c.strip() for c in lines[0]] if lines else []
    wanted = {*columns(), *(c for pair in SIDES.values() for c in pair)}
    beside = beside_of(path)
    if beside is not None and any(f'"{n}"' in beside.read_text(encoding="utf-8", errors="replace") for n in names if n):
        return False  # a file that speaks of these columns
    first = dict(zip(names, lines[1], strict=False)) if len(lines) > 1 else {}
    if _CLOCK.search(first.get("time", "")):
        return False  # dates or times of day
    cells = [c.strip() for c in first.values()]
    if any(_DECIMAL_COMMA.fullmatch(c) for c in cells) and not any("." in c for c in cells):
        return False  # decimals are written with a comma, in quotes
    return "time" in names and len(wanted & {n.lower() for n in names}) > 3


def _read_plain(path: Path, spare: Collection[str]) -> Log:
    head, whole = _head(path)
    header = [c.strip() for c in (cells_of(path, head[0]) if head else [])]
    check_columns(path, header)
    wanted = columns()
    sides = {axle: pair for axle, pair in SIDES.items() if axle not in header and all(c in header for c in pair)}
    absent = lacking(header, sides, spare)
    needed = [c for name in wanted if name not in absent for c in sides.get(name, (name,))]
    missing = [c for c in needed if c not in header]
    if missing:
        raise UserError(_missing_text(path, header, missing, needed))
    twice = sorted({c for c in header if header.count(c) > 1 and (c in needed or _beside(c))})
    if twice:
        raise UserError(f"{path}: column {', '.join(twice)} appears more than once in the header (line 1)")
    notes: list[str] = []
    table, line, skipped = _numbers(path, header, head[1:], whole, needed, notes)
    if whole is not None:
        notes.append(f"line {whole + 2}, the last, does not end: it may be cut inside a number and is left out")
    if skipped:
        notes.append(f"column {', '.join(skipped)} is not numeric: not used")
    time = table.pop("time")
    if is_packed(time):
        notes.append(PACKED)
        time = of_packed(time)
    time, keep = straightened(path, time, line, notes)
    if not keep.all():
        table, line = {c: x[keep] for c, x in table.items()}, line[keep]
    return checked(path, time, table, line, notes, spare)


def read_frame(frame: Mapping[str, Any] | pd.DataFrame, name: str = "log") -> Log:
    """The same of columns in memory: a data frame, or arrays by their names. `name` stands in messages; rows are counted from 0.
    Times may be dates, times of day or differences of time, too, and stand in the index of a data frame."""
    if (
        isinstance(frame, pd.DataFrame)
        and "time" not in frame
        and (frame.index.name == "time" or isinstance(frame.index, pd.DatetimeIndex | pd.TimedeltaIndex))
    ):
        frame = frame.assign(time=frame.index)
    labels = [x.index for x in frame.values() if isinstance(x, pd.Series)] if isinstance(frame, Mapping) else []
    if not all(labels[0].equals(x) for x in labels[1:]):
        raise UserError(f"{name}: the columns are Series with different indices: which rows go together? Make a data frame of them")
    header = [str(c) for c in frame]
    sides = {axle: pair for axle, pair in SIDES.items() if axle not in header and all(c in header for c in pair)}
    absent = lacking(header, sides, MEASURES)
    needed = [c for wanted in columns() if wanted not in absent for c in sides.get(wanted, (wanted,))]
    if missing := [c for c in needed if c not in header]:
        also = "; left and right wheel may stand in place of an axle, both" if any(c in SIDES for c in missing) else ""
        there = f"\n  needed: {', '.join(needed)}\n  found: {', '.join(header)[:300]}"
        raise UserError(f"{name}: column {', '.join(missing)} is missing{also}{there}")
    twice = sorted({c for c in header if header.count(c) > 1})
    if twice:
        raise UserError(f"{name}: column {', '.join(twice)} appears more than once")
    notes: list[str] = []
    table: dict[str, np.ndarray] = {}
    for column in header:
        if column in needed or _beside(column):
            try:
                table[column] = _array(name, column, frame[column])
            except (TypeError, ValueError, OverflowError):
                if column in needed:
                    what = _allowed(column)
                    raise UserError(f"{name}: column {column} is not numeric; allowed: {what}, or NaN for missing") from None
                notes.append(f"column {column} is not numeric: not used")
    rows = table["time"].shape[:1]
    for column, values in table.items():
        if values.shape != rows:
            raise UserError(f"{name}: column {column} has shape {values.shape}; all need that of time, one number a row: {rows}")
    if rows == (0,):
        raise UserError(f"{name}: has no rows")
    row = np.arange(rows[0])
    time, keep = straightened(Path(name), table.pop("time"), row, notes, "row")
    return checked(Path(name), time, {c: x[keep] for c, x in table.items()}, row[keep], notes, place="row")


def _array(name: str, column: str, values: Any) -> np.ndarray:
    """A column of a frame as numbers. UserError, TypeError, ValueError, OverflowError: it has none."""
    kind = getattr(getattr(values, "dtype", None), "kind", "O")
    if kind == "c" or (kind == "b" and column not in OPTIONAL):
        raise TypeError("complex numbers, or truths, where a measurement is needed")
    if column == "time" and kind not in "fiub":
        series = values.reset_index(drop=True) if isinstance(values, pd.Series) else pd.Series(np.asarray(values))
        if isinstance(next(iter(series), None), str | datetime | timedelta):
            return seconds(Path(name), Column(column, series.infer_objects()), [])
    elif kind in "mM":
        raise TypeError("times where a measurement is needed")  # as numbers they would be nanoseconds
    return np.ma.filled(np.ma.asarray(values, float), np.nan) if np.ma.isMaskedArray(values) else np.array(values, float)


def _beside(column: str) -> bool:
    """A column that is read, though the estimator does not need it."""
    return column.startswith("ref_") or column in OPTIONAL


def _head(path: Path) -> tuple[list[str], int | None]:
    """The first two lines of a log; where the last line does not end, how many rows do: its writer was perhaps stopped there, and a
    number that is cut is a number still."""
    if path.is_dir():
        raise UserError(f"{path}: is a directory, not a log")
    try:
        with open(path, encoding="utf-8-sig") as file:
            head = last = file.read(1 << 20)
            ends = head.count("\n")
            while part := file.read(1 << 20):  # the whole file must be text
                ends, last = ends + part.count("\n"), part
    except FileNotFoundError:
        raise NoFile(f"{path}: no such file") from None
    except UnicodeDecodeError as error:
        raise UserError(f"{path}: is not a text file in UTF-8 ({error.reason} at byte {error.start}); a CSV is needed") from None
    except OSError as error:
        raise UserError(f"{path}: cannot be read: {error.strerror}") from None
    if "\0" in head:
        raise UserError(f"{path}: is a binary file; a CSV is needed")
    if not head.strip():
        raise UserError(f"{path}: is empty")
    whole = ends - 1 if ends and not last.endswith("\n") else None
    if whole == 0:
        raise UserError(f"{path}: has one row, and its line does not end: it may be cut inside a number")
    return head.split("\n", 2)[:2], whole


def _missing_text(path: Path, header: list[str], missing: list[str], needed: list[str]) -> str:
    text = f"{path}: column {', '.join(missing)} is missing in the header (line 1)"
    if len(header) == 1 and any(s in header[0] for s in ";\t|"):
        text += "; the columns must be separated by commas"
    elif all(np.isfinite(_number(c)) for c in header):
        text += "; the first line must name the columns"
    else:
        lower = {c.lower(): c for c in header}
        if close := [f"{lower[m]} -> {m}" for m in missing if m in lower]:
            text += f"; names are lower case: {', '.join(close)}"
    text += "; left and right wheel may stand in place of an axle, both" if any(c in SIDES for c in missing) else ""
    return f"{text}\n  needed: {','.join(needed)}\n  found:  {','.join(header)[:300]}"


def _numbers(
    path: Path, header: list[str], first: list[str], whole: int | None, needed: list[str], notes: list[str]
) -> tuple[dict[str, np.ndarray], np.ndarray, list[str]]:
    """Every column that is read as numbers, in the file's order; the lines in the file; columns that are left out. A few cells that
    are no numbers are missing, and a note says so; many are an error, or in a column that is not needed the end of that column.
    Rows without any of what is needed are blank. `whole`: rows to read, where not all; `first`: the line of the first."""
    if (cells := len(row := cells_of(path, first[0]) if first else [])) > len(header):  # of which pandas only warns
        wide = cells > 1.5 * len(header) and all(c.strip().lstrip("+-").isdigit() for c in row)
        hint = "\n  hint: commas separate the columns and are in the numbers, too: write decimals with a point" if wide else ""
        raise UserError(f"{path}: line 2: {cells} cells, but the header (line 1) names {len(header)} columns{hint}")
    names = [f"{c}\0{i}" if header.count(c) > 1 else c for i, c in enumerate(header)]
    with parsing(path), pd.read_csv(
        path, names=names, header=None, skiprows=1, index_col=False, skip_blank_lines=False, skipinitialspace=True,
        encoding="utf-8-sig", nrows=whole, chunksize=PIECE,  # all at once take twice the memory
    ) as pieces:  # fmt: skip
        parts, rows = [], 0
        for piece in pieces:
            parts.append(piece[piece[needed].notna().any(axis=1)])
            rows += len(parts[-1])
            check_rows(path, "it", rows, ROW)
        table = pd.concat(parts)
    if table.empty:
        raise UserError(f"{path}: has a header but no rows")
    line = table.index.to_numpy() + 2
    columns: dict[str, np.ndarray] = {}
    skipped = []
    for name in (c for c in header if c in needed or _beside(c)):
        cells = table[name]
        numbers = pd.Series(np.nan, cells.index) if cells.dtype == bool else to_numbers(cells)
        bad = (numbers.isna() & cells.notna()).to_numpy()
        if bad.any() and name not in needed:
            skipped.append(name)
            continue
        if bad.any():
            count, at, wrong = int(bad.sum()), line[bad.argmax()], str(cells.iloc[int(bad.argmax())])
            if count > FEW_OUTSIDE * len(table):
                hint = "; decimals are written with a point" if "," in wrong else ""
                raise UserError(
                    f"{path}: line {at}, column {name}: {wrong[:40]!r} is not a number; allowed: {_allowed(name)}, or empty for "
                    f"missing{hint}"
                )
            said = f"{count} cells that are no numbers are" if count > 1 else "a cell that is no number is"
            notes.append(f"{name}: {said} treated as missing (first in line {at}: {wrong[:20]!r})")
        columns[name] = numbers.to_numpy(float)
    return columns, line, skipped


def to_numbers(column: pd.Series) -> pd.Series:
    """Cells as numbers, NaN where they are none."""
    try:
        return pd.to_numeric(column, errors="coerce")
    except OverflowError:  # a whole number of more digits than a float has, beside text
        return pd.Series([_number(cell) for cell in column], column.index, float)


def _number(cell: object) -> float:
    try:
        return float(str(cell))
    except ValueError:
        return np.nan


def _allowed(name: str) -> str:
    channel = next((axle for axle, pair in SIDES.items() if name in pair), name)
    return "seconds, increasing" if name == "time" else library().field(INPUT, channel).range_text


# ---- any log: reader, mapping, raster, check


def read_any(path: Path, spare: Collection[str], reading: Reading) -> Log:
    """A log of any format. UserError: what is missing, and what helps."""
    if reading.rate is not None and not SLOWEST <= reading.rate <= FASTEST:
        raise UserError(f"option --rate: {reading.rate:g} is outside its range {SLOWEST:g} .. {FASTEST:g} Hz")
    signals, how = find_signals(path, reading.signals, reading.databases)
    recording = read_recording(path, replace(how, wanted=signals.wants) if signals is not None else how)
    if signals is not None and not all(recording.has(n) for s in signals.signals.values() for n in s.name):
        recording = read_recording(path, how)  # with all names, to say which is meant
    if reading.signals is None and (signals is None or not any(recording.has(n) for s in signals.signals.values() for n in s.name)):
        own = by_own_names(recording)
        if own is None and signals is None:
            raise UserError(_unnamed(path, recording))
        signals = own or signals
    notes = list(recording.notes)
    if signals.path is not None:
        notes.append(f"signals by {signals.path}")
    found = series(recording, signals, reading.car, notes)
    _speed_for_wheels(path, found, reading, notes)
    del recording  # what is not asked for need not stay
    rows = on_raster(found, reading.rate or signals.rate, path)
    notes += rows.notes
    line = np.arange(1, len(rows.time) + 1)
    log = checked(path, rows.time, dict(rows.value), line, notes, spare, place="row")
    guessed = [f"{s.channel} ({s.unsure})" for s in signals.signals.values() if s.unsure]
    if guessed:
        log.warnings.append(f"guessed, and believed: {'; '.join(guessed)}: look at {signals.path}, and take the key unsure out")
        log.notes.insert(0, log.warnings[-1])
    log.slower = _slower(rows.native, rows.rate)
    return log


def _speed_for_wheels(path: Path, found: dict[str, Series], reading: Reading, notes: list[str]) -> None:
    """A log without any wheel speed: they roll as the car goes, and tell no slip."""
    if "vehicle_speed" not in found or any(c.startswith("wheel_speed") for c in found):
        return
    if reading.car is None:
        raise UserError(
            f"{path}: has no wheel speeds; for vehicle_speed to stand in, the radius of the wheels is needed: --vehicle CAR.toml"
        )
    speed = found["vehicle_speed"]
    found["wheel_speed_front"] = replace(
        speed, channel="wheel_speed_front", value=speed.value / reading.car.values["wheel_radius_front"]
    )
    notes.append("no wheel speed is in the log: vehicle_speed stands in for them")


def by_own_names(recording: Recording) -> Signals | None:
    """A log whose channels have the library's names, in whatever format; None where it does not."""
    names = [n for n in known_channels() if recording.has(n)]
    names += [c.name for c in recording if c.short.startswith("ref_") and c.name not in names]
    full = all(n in names or all(s in names for s in SIDES.get(n, ("-",))) for n in NEEDED[:1]) and any(
        n in names or all(s in names for s in SIDES[n]) for n in NEEDED[1:]
    )
    if not full:
        return None
    whole = {n: Signal(n if n in known_channels() else recording.find(n, "").short, (n,)) for n in names}
    sided = {s for axle, pair in SIDES.items() if axle in names for s in pair}
    return Signals(None, {s.channel: s for s in whole.values() if s.channel not in sided})


def _slower(native: dict[str, tuple[np.ndarray, np.ndarray, float]], rate: float) -> dict[str, Slower]:
    """By channel; of an axle that of its wheels."""
    found = {n: Slower(t, x, rate / own) for n, (t, x, own) in native.items()}
    for axle, pair in SIDES.items():
        if axle not in found and all(s in found for s in pair):
            left, right = (found.pop(s) for s in pair)
            mean = 0.5 * (left.value + np.interp(left.time, right.time, right.value))
            found[axle] = Slower(left.time, mean, left.rows)
    return {n: s for n, s in found.items() if n in {*columns(), *MEASURES} and n not in OPTIONAL}


def _unnamed(path: Path, recording: Recording) -> str:
    own = [n for n in known_channels() if recording.has(n)]
    missing = [n for n in NEEDED if n not in own and not all(s in own for s in SIDES.get(n, ("-",)))]
    has = f"; of tse's names it has {listed(own)}, not {listed(missing)}" if own else ""
    name = shlex.quote(str(path))
    return (
        f"{path}: a file must say which of its {len(recording.channels)} signals are which "
        f"({listed(c.name for c in recording)}){has}\n"
        f"  'tselab signals {name} --write signals.toml' proposes one, beside the log, where it is used"
    )
