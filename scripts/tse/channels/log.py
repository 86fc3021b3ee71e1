"""Read and check a log: a file (read_log()) or a data frame (read_frame()).

A CSV with the library's column names is read directly. For other files, a signals.toml
assigns the signals to channels. tse.readers.readers lists the formats. tse.log.rows
checks the values, e.g. their range.
"""

import re
import shlex
from collections.abc import Collection, Mapping
from dataclasses import replace
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from tse.car.vehicle import Vehicle
from tse.channels.mapping import Series, map_signals
from tse.channels.raster import resample_channels
from tse.channels.signals import MAX_RATE, MIN_RATE, SignalsFile, SignalSource, find_signals, list_channels
from tse.library.core import INPUT, library
from tse.library.errors import NoFile, UserError
from tse.log.rows import (
    MAX_OUTSIDE,
    MEASURES,
    OPTIONAL_COLUMNS,
    SIDES,
    CheckedLog,
    Reading,
    SlowChannel,
    check_log,
    find_absent_channels,
    find_signals_file,
    list_columns,
    straighten_log_time,
)
from tse.readers.read_text import translate_parser_errors
from tse.readers.readers import read_recording
from tse.readers.recording import (
    CHUNK_ROWS,
    MIN_ROW_BYTES,
    Recording,
    check_rows,
    check_table_width,
    limit_memory,
    limit_time,
    list_names,
    split_cells,
)
from tse.readers.table import PACKED_NOTE, Column, convert_to_seconds, is_packed, unpack_times

_CLOCK = re.compile(r"\d{1,2}:\d{2}")
_DECIMAL_COMMA = re.compile(r"[-+]?\d*,\d+([eE][-+]?\d+)?")
# A log needs no signals.toml if it has columns named steer_angle and wheel_speed_front
# (or wheel_speed_rear): its columns are then assigned to the channels of the same names.
# Two columns, of left and right wheel, may replace the column of an axle.
NEEDED = ("steer_angle", "wheel_speed_front", "wheel_speed_rear")


def read_log(path: Path, spare: Collection[str] = MEASURES, reading: Reading | None = None) -> CheckedLog:
    """Read and check a log.

    Parameters
    ----------
    path : Path
        The file.
    spare : collection of str
        Channels that may be missing. The column of a missing channel is NaN, and a note
        of the log (CheckedLog.notes) states that the channel is missing.
    reading : Reading, optional
        Options of reading. If they include a car (`car`), its wheel radii are used to
        convert wheel speeds from m/s or km/h to rad/s, and to compute the missing wheel
        speed of one axle from that of the other axle.

    Raises
    ------
    UserError
        The log is invalid. The message states file, row, column and the allowed values.
    """
    path, reading = Path(path), reading or Reading()
    with limit_memory(path), limit_time(path):
        log = _read_plain(path, spare) if _is_plain(path, reading) else read_any(path, spare, reading)
    if reading.car is not None:
        log = adapt_to_car(log, reading.car)
    if reading.strict and log.warnings:
        raise UserError(f"{path}: option --strict: {log.warnings[0]}; without --strict, this is a warning")
    return log


def adapt_to_car(log: CheckedLog, car: Vehicle) -> CheckedLog:
    """Scale a substituted wheel speed to the wheel radii of this car; return the log.

    If a log lacks the wheel speed of one axle, check_log() substitutes the wheel speed of
    the other axle. For a car with different wheel radii at both axles, this function
    scales the substitute by (radius at the other axle / radius at the axle without wheel
    speed), so that wheel speed x wheel radius is the same at both axles. log.stands_by is
    the factor by which the substitute was scaled before. If the log has the wheel speeds
    of both axles, it is returned unchanged."""
    if log.stand_in is None:
        return log
    front, rear = (car.values[f"wheel_radius_{a}"] for a in ("front", "rear"))
    by = rear / front if log.stand_in.endswith("front") else front / rear
    data = log.data.assign(**{log.stand_in: log.data[log.stand_in] * (by / log.stands_by)})
    return replace(log, data=data, stands_by=by)


def _is_plain(path: Path, reading: Reading) -> bool:
    """Return whether a file is a CSV with commas and the library's column names.

    The columns of such a file are read without mapping and resampling. Return False, so
    that read_any() reads the file, also in these cases:
      - an option states a signals.toml or the rate of the rows
      - a signals.toml next to the file assigns columns of the file
      - the times are dates or times of day
      - decimals are written with a comma"""
    if reading.signals is not None or reading.rate is not None or (path.exists() and not path.is_file()):
        return False
    try:
        with open(path, encoding="utf-8-sig", newline="") as file:
            head = file.read(65536)
    except (OSError, UnicodeDecodeError):
        return False
    lines = [split_cells(path, x) for x in head.splitlines()[:2]] if "\0" not in head else []
    names = [c.strip() for c in lines[0]] if lines else []
    wanted = {*list_columns(), *(c for pair in SIDES.values() for c in pair)}
    beside = find_signals_file(path)
    if beside is not None and any(
        f'"{n}"' in beside.read_text(encoding="utf-8", errors="replace") for n in names if n
    ):
        return False  # signals.toml assigns these columns
    first = dict(zip(names, lines[1], strict=False)) if len(lines) > 1 else {}
    if _CLOCK.search(first.get("time", "")):
        return False  # its times are dates or times of day
    cells = [c.strip() for c in first.values()]
    if any(_DECIMAL_COMMA.fullmatch(c) for c in cells) and not any("." in c for c in cells):
        return False  # decimals are written with a comma, in quotes
    return "time" in names and len(wanted & {n.lower() for n in names}) > 3


def _read_plain(path: Path, spare: Collection[str]) -> CheckedLog:
    """Read and check a CSV with commas and the library's column names."""
    head, whole = _read_head(path)
    header = [c.strip() for c in (split_cells(path, head[0]) if head else [])]
    check_table_width(path, header)
    wanted = list_columns()
    sides = {
        axle: pair for axle, pair in SIDES.items() if axle not in header and all(c in header for c in pair)
    }
    absent = find_absent_channels(header, sides, spare)
    needed = [c for name in wanted if name not in absent for c in sides.get(name, (name,))]
    missing = [c for c in needed if c not in header]
    if missing:
        raise UserError(_describe_missing(path, header, missing, needed))
    twice = sorted({c for c in header if header.count(c) > 1 and (c in needed or _is_optional(c))})
    if twice:
        raise UserError(f"{path}: column {', '.join(twice)} appears more than once in the header (line 1)")
    notes: list[str] = []
    table, line, skipped = _read_numbers(path, header, head[1:], whole, needed, notes)
    if whole is not None:
        notes.append(
            f"line {whole + 2}, the last, has no line break: it may be cut inside a number and is left out"
        )
    if skipped:
        notes.append(f"column {', '.join(skipped)} is not numeric: not used")
    time = table.pop("time")
    if is_packed(time):
        notes.append(PACKED_NOTE)
        time = unpack_times(time)
    time, keep = straighten_log_time(path, time, line, notes)
    if not keep.all():
        table, line = {c: x[keep] for c, x in table.items()}, line[keep]
    return check_log(path, time, table, line, notes, spare)


def read_frame(frame: Mapping[str, Any] | pd.DataFrame, name: str = "log") -> CheckedLog:
    """Make a checked log from columns in memory: a data frame, or a dict of arrays.

    Parameters
    ----------
    frame : mapping of str to array, or DataFrame
        The columns, with the library's names. Column `time` is in s, or holds dates,
        times of day or time differences. If a data frame has no column `time`, its index
        may hold the times.
    name : str
        Name of the log in messages. Messages count rows from 0.

    Raises
    ------
    UserError
        The columns are invalid. The message states row, column and the allowed values.
    """
    if (
        isinstance(frame, pd.DataFrame)
        and "time" not in frame
        and (frame.index.name == "time" or isinstance(frame.index, pd.DatetimeIndex | pd.TimedeltaIndex))
    ):
        frame = frame.assign(time=frame.index)
    labels = (
        [x.index for x in frame.values() if isinstance(x, pd.Series)] if isinstance(frame, Mapping) else []
    )
    if not all(labels[0].equals(x) for x in labels[1:]):
        raise UserError(
            f"{name}: the columns are Series with different indices, so their rows cannot be matched: give a "
            "data frame"
        )
    needed = _check_frame_header(frame, name)
    notes: list[str] = []
    table = _convert_frame(frame, name, needed, notes)
    rows = table["time"].shape[:1]
    for column, values in table.items():
        if values.shape != rows:
            raise UserError(
                f"{name}: column {column} has shape {values.shape}; needed: one number per row, the shape of "
                f"time: {rows}"
            )
    if rows == (0,):
        raise UserError(f"{name}: has no rows")
    row = np.arange(rows[0])
    time, keep = straighten_log_time(Path(name), table.pop("time"), row, notes, "row")
    return check_log(Path(name), time, {c: x[keep] for c, x in table.items()}, row[keep], notes, place="row")


def _check_frame_header(frame: Mapping[str, Any] | pd.DataFrame, name: str) -> list[str]:
    """Return the names of the columns that the estimation needs from this frame.

    These are time and the channels, except those that the frame lacks and need not have.
    The columns of left and right wheel may replace the column of their axle. Raise an
    error if a needed column is missing, or if any column appears twice."""
    header = [str(c) for c in frame]
    sides = {
        axle: pair for axle, pair in SIDES.items() if axle not in header and all(c in header for c in pair)
    }
    absent = find_absent_channels(header, sides, MEASURES)
    needed = [c for wanted in list_columns() if wanted not in absent for c in sides.get(wanted, (wanted,))]
    if missing := [c for c in needed if c not in header]:
        also = (
            "; instead of the column of an axle, those of its left and right wheel may be given"
            if any(c in SIDES for c in missing)
            else ""
        )
        there = f"\n  needed: {', '.join(needed)}\n  found: {', '.join(header)[:300]}"
        raise UserError(f"{name}: column {', '.join(missing)} is missing{also}{there}")
    twice = sorted({c for c in header if header.count(c) > 1})
    if twice:
        raise UserError(f"{name}: column {', '.join(twice)} appears more than once")
    return needed


def _convert_frame(
    frame: Mapping[str, Any] | pd.DataFrame, name: str, needed: list[str], notes: list[str]
) -> dict[str, np.ndarray]:
    """Return the columns of a frame as numbers.

    Optional columns that are not numeric are left out, with a note."""
    table: dict[str, np.ndarray] = {}
    for column in map(str, frame):
        if column in needed or _is_optional(column):
            try:
                table[column] = _convert_column(name, column, frame[column])
            except (TypeError, ValueError, OverflowError):
                if column in needed:
                    what = _describe_range(column)
                    raise UserError(
                        f"{name}: column {column} is not numeric; allowed: {what}, or NaN for missing"
                    ) from None
                notes.append(f"column {column} is not numeric: not used")
    return table


def _convert_column(name: str, column: str, values: Any) -> np.ndarray:
    """Return a column of a frame as numbers.

    Raises
    ------
    UserError, TypeError, ValueError, OverflowError
        The column is not numeric.
    """
    kind = getattr(getattr(values, "dtype", None), "kind", "O")
    if kind == "c" or (kind == "b" and column not in OPTIONAL_COLUMNS):
        raise TypeError("complex or Boolean values cannot be a measurement")
    if column == "time" and kind not in "fiub":
        series = (
            values.reset_index(drop=True) if isinstance(values, pd.Series) else pd.Series(np.asarray(values))
        )
        if isinstance(next(iter(series), None), str | datetime | timedelta):
            return convert_to_seconds(Path(name), Column(column, series.infer_objects()), [])
    elif kind in "mM":
        # refuse dates and durations: np.array(values, float) would return nanoseconds
        raise TypeError("times cannot be a measurement")
    return (
        np.ma.filled(np.ma.asarray(values, float), np.nan)
        if np.ma.isMaskedArray(values)
        else np.array(values, float)
    )


def _is_optional(column: str) -> bool:
    """Return whether a column is optional: read if present, but not needed."""
    return column.startswith("ref_") or column in OPTIONAL_COLUMNS


def _read_head(path: Path) -> tuple[list[str], int | None]:
    """Return the first two lines of a log, and the number of its complete rows.

    If the file ends with a line break, all rows are complete, and None is returned
    instead of their number. Otherwise, the last row is not counted, since it may be cut
    off."""
    if path.is_dir():
        raise UserError(f"{path}: is a directory, not a log")
    try:
        with open(path, encoding="utf-8-sig") as file:
            head = last = file.read(1 << 20)
            ends = head.count("\n")
            while part := file.read(1 << 20):  # read all, to check that the whole file is text
                ends, last = ends + part.count("\n"), part
    except FileNotFoundError:
        raise NoFile(f"{path}: no such file") from None
    except UnicodeDecodeError as error:
        raise UserError(
            f"{path}: is not a text file in UTF-8 ({error.reason} at byte {error.start}); "
            "save it as a CSV in UTF-8"
        ) from None
    except OSError as error:
        raise UserError(f"{path}: cannot be read: {error.strerror}") from None
    if "\0" in head:
        raise UserError(f"{path}: is a binary file; a CSV is needed")
    if not head.strip():
        raise UserError(f"{path}: is empty")
    whole = ends - 1 if ends and not last.endswith("\n") else None
    if whole == 0:
        raise UserError(
            f"{path}: has one row, without a line break: it may be cut inside a number; if it is complete, "
            "add a line break"
        )
    return head.split("\n", 2)[:2], whole


def _describe_missing(path: Path, header: list[str], missing: list[str], needed: list[str]) -> str:
    """Return the message about missing columns, with a hint at the probable cause."""
    text = f"{path}: column {', '.join(missing)} is missing in the header (line 1)"
    if len(header) == 1 and any(s in header[0] for s in ";\t|"):
        text += "; the columns must be separated by commas"
    elif all(np.isfinite(_convert_cell(c)) for c in header):
        text += "; the first line must name the columns"
    else:
        lower = {c.lower(): c for c in header}
        if close := [f"{lower[m]} -> {m}" for m in missing if m in lower]:
            text += f"; names are lower case: {', '.join(close)}"
    text += (
        "; instead of the column of an axle, those of its left and right wheel may be given"
        if any(c in SIDES for c in missing)
        else ""
    )
    return f"{text}\n  needed: {','.join(needed)}\n  found:  {','.join(header)[:300]}"


def _read_numbers(
    path: Path, header: list[str], first: list[str], whole: int | None, needed: list[str], notes: list[str]
) -> tuple[dict[str, np.ndarray], np.ndarray, list[str]]:
    """Read the columns of a CSV as numbers.

    Cells of a needed column that are not numeric become NaN, and a note counts them. If
    their share exceeds MAX_OUTSIDE, an error is raised. An optional column with such a
    cell is left out. A row is dropped if its cells in all needed columns are empty.

    Parameters
    ----------
    path : Path
        The file.
    header : list of str
        Names of all columns.
    first : list of str
        A list with one string, the first line after the header; [] if there is none.
    whole : int or None
        Number of complete rows, from _read_head(). Only these are read. None: all rows
        are complete.
    needed : list of str
        Columns that the log must have. All other columns are optional.
    notes : list of str
        The function appends its notes.

    Returns
    -------
    dict of str to ndarray
        The columns in the order of the file.
    ndarray
        Line number of each row in the file.
    list of str
        Optional columns that were left out.
    """
    _check_first_row(path, header, first)
    names = [f"{c}\0{i}" if header.count(c) > 1 else c for i, c in enumerate(header)]
    options: dict[str, Any] = {
        "names": names,
        "header": None,
        "skiprows": 1,
        "index_col": False,
        "skip_blank_lines": False,
        "skipinitialspace": True,
        "encoding": "utf-8-sig",
        "nrows": whole,
        "chunksize": CHUNK_ROWS,  # reading all rows at once needs twice the memory
    }
    with translate_parser_errors(path), pd.read_csv(path, **options) as pieces:
        parts, rows = [], 0
        for piece in pieces:
            parts.append(piece[piece[needed].notna().any(axis=1)])
            rows += len(parts[-1])
            check_rows(path, "it", rows, MIN_ROW_BYTES)
        table = pd.concat(parts)
    if table.empty:
        raise UserError(f"{path}: has a header but no rows")
    line = table.index.to_numpy() + 2
    columns, skipped = _convert_cells(path, header, table, line, needed, notes)
    return columns, line, skipped


def _convert_cells(
    path: Path, header: list[str], table: pd.DataFrame, line: np.ndarray, needed: list[str], notes: list[str]
) -> tuple[dict[str, np.ndarray], list[str]]:
    """Return the columns of a CSV as numbers, and the names of the optional columns that
    are left out because they are not numeric."""
    columns: dict[str, np.ndarray] = {}
    skipped = []
    for name in (c for c in header if c in needed or _is_optional(c)):
        cells = table[name]
        numbers = pd.Series(np.nan, cells.index) if cells.dtype == bool else convert_to_numbers(cells)
        bad = (numbers.isna() & cells.notna()).to_numpy()
        if bad.any() and name not in needed:
            skipped.append(name)
            continue
        if bad.any():
            count, at, wrong = int(bad.sum()), line[bad.argmax()], str(cells.iloc[int(bad.argmax())])
            if count > MAX_OUTSIDE * len(table):
                hint = "; decimals are written with a point" if "," in wrong else ""
                raise UserError(
                    f"{path}: line {at}, column {name}: {wrong[:40]!r} is not a number; allowed: "
                    f"{_describe_range(name)}, or empty for missing{hint}"
                )
            said = f"{count} cells that are no numbers are" if count > 1 else "a cell that is no number is"
            notes.append(f"{name}: {said} treated as missing (first in line {at}: {wrong[:20]!r})")
        columns[name] = numbers.to_numpy(float)
    return columns, skipped


def _check_first_row(path: Path, header: list[str], first: list[str]) -> None:
    """Raise an error if the first row of a CSV is longer than the header.

    pandas would only warn and drop the surplus cells."""
    row = split_cells(path, first[0]) if first else []
    cells = len(row)
    if cells <= len(header):
        return
    hint = ""
    if cells > 1.5 * len(header) and all(c.strip().lstrip("+-").isdigit() for c in row):
        hint = (
            "\n  hint: the comma is both separator of columns and decimal mark: write decimals with a point"
        )
    raise UserError(
        f"{path}: line 2: {cells} cells, but the header (line 1) names {len(header)} columns{hint}"
    )


def convert_to_numbers(column: pd.Series) -> pd.Series:
    """Return cells as numbers, NaN where they are not numeric."""
    try:
        return pd.to_numeric(column, errors="coerce")
    except OverflowError:  # the column has strings, and an integer beyond the range of a float
        return pd.Series([_convert_cell(cell) for cell in column], column.index, float)


def _convert_cell(cell: object) -> float:
    """Return a cell as a number, NaN if it is not numeric."""
    try:
        return float(str(cell))
    except ValueError:
        return np.nan


def _describe_range(name: str) -> str:
    """Return the allowed values of a column, for messages."""
    channel = next((axle for axle, pair in SIDES.items() if name in pair), name)
    return "seconds, increasing" if name == "time" else library().field(INPUT, channel).range_text


# ---- Logs of any format: read, map signals to channels, resample, check


def read_any(path: Path, spare: Collection[str], reading: Reading) -> CheckedLog:
    """Read and check a log of any format.

    Raises
    ------
    UserError
        The log cannot be used. The message states the reason, e.g. a missing channel, and
        the remedy.
    """
    if reading.rate is not None and not MIN_RATE <= reading.rate <= MAX_RATE:
        raise UserError(
            f"option --rate: {reading.rate:g} is outside its range {MIN_RATE:g} .. {MAX_RATE:g} Hz"
        )
    signals, how = find_signals(path, reading.signals, reading.databases)
    recording = read_recording(path, replace(how, wanted=signals.wants) if signals is not None else how)
    if signals is not None and not all(recording.has(n) for s in signals.signals.values() for n in s.name):
        recording = read_recording(path, how)  # read all signals: the error message lists them
    if reading.signals is None and (
        signals is None or not any(recording.has(n) for s in signals.signals.values() for n in s.name)
    ):
        own = map_own_names(recording)
        if own is None and signals is None:
            raise UserError(_describe_unnamed(path, recording))
        signals = own or signals
    notes = list(recording.notes)
    if signals.path is not None:
        notes.append(f"signals are assigned by {signals.path}")
    found = map_signals(recording, signals, reading.car, notes)
    _substitute_speed(path, found, reading, notes)
    del recording  # frees the memory of unused signals
    rows = resample_channels(found, reading.rate or signals.rate, path)
    notes += rows.notes
    line = np.arange(1, len(rows.time) + 1)
    log = check_log(path, rows.time, dict(rows.value), line, notes, spare, place="row")
    guessed = [f"{s.channel} ({s.unsure})" for s in signals.signals.values() if s.unsure]
    if guessed:
        log.warnings.append(
            f"guessed, not tested: {'; '.join(guessed)}: check them in {signals.path}, then delete their key "
            "unsure"
        )
        log.notes.insert(0, log.warnings[-1])
    log.slower = _join_slow_channels(rows.native, rows.rate)
    return log


def _substitute_speed(path: Path, found: dict[str, Series], reading: Reading, notes: list[str]) -> None:
    """If the log has no wheel speeds, add a wheel speed of the front axle to `found`.

    `found`: channels of the log. The added wheel speed is vehicle_speed / wheel radius,
    i.e. that of a wheel that rolls without slip. It therefore contains no information on
    the real slip."""
    if "vehicle_speed" not in found or any(c.startswith("wheel_speed") for c in found):
        return
    if reading.car is None:
        raise UserError(
            f"{path}: has no wheel speeds; to use vehicle_speed instead, the radius of the wheels is needed: "
            "--vehicle CAR.toml"
        )
    speed = found["vehicle_speed"]
    found["wheel_speed_front"] = replace(
        speed, channel="wheel_speed_front", value=speed.value / reading.car.values["wheel_radius_front"]
    )
    notes.append("the log has no wheel speed: vehicle_speed is used instead")


def map_own_names(recording: Recording) -> SignalsFile | None:
    """Return a SignalsFile that assigns to each channel the signal of the same name.

    Return None if the log does not have the steering angle and at least one wheel speed
    under the names of the channels."""
    names = [n for n in list_channels() if recording.has(n)]
    names += [c.name for c in recording if c.short.startswith("ref_") and c.name not in names]
    full = all(n in names or all(s in names for s in SIDES.get(n, ("-",))) for n in NEEDED[:1]) and any(
        n in names or all(s in names for s in SIDES[n]) for n in NEEDED[1:]
    )
    if not full:
        return None
    whole = {n: SignalSource(n if n in list_channels() else recording.find(n, "").short, (n,)) for n in names}
    is_sided = {s for axle, pair in SIDES.items() if axle in names for s in pair}
    return SignalsFile(None, {s.channel: s for s in whole.values() if s.channel not in is_sided})


def _join_slow_channels(
    native: dict[str, tuple[np.ndarray, np.ndarray, float]], rate: float
) -> dict[str, SlowChannel]:
    """Return times and values, as logged, of the channels that are slower than the rows.

    The rows are the common times to which all channels are resampled. Interpolation
    smooths the noise of a slow channel, so the noise is estimated from the logged values.
    If the channels of both wheels of an axle are slower than the rows, the mean of the
    two wheel speeds is returned under the name of the channel of the axle.

    `native`: channel -> (times [s], values, rate [Hz]), as logged. `rate`: [Hz] rate of
    the rows."""
    found = {n: SlowChannel(t, x, rate / own) for n, (t, x, own) in native.items()}
    for axle, pair in SIDES.items():
        if axle not in found and all(s in found for s in pair):
            left, right = (found.pop(s) for s in pair)
            mean = 0.5 * (left.value + np.interp(left.time, right.time, right.value))
            found[axle] = SlowChannel(left.time, mean, left.rows)
    return {n: s for n, s in found.items() if n in {*list_columns(), *MEASURES} and n not in OPTIONAL_COLUMNS}


def _describe_unnamed(path: Path, recording: Recording) -> str:
    """Return the error message for a log that needs a signals.toml."""
    own = [n for n in list_channels() if recording.has(n)]
    missing = [n for n in NEEDED if n not in own and not all(s in own for s in SIDES.get(n, ("-",)))]
    has = f"; of tse's names it has {list_names(own)}, not {list_names(missing)}" if own else ""
    name = shlex.quote(str(path))
    return (
        f"{path}: needs a signals.toml that assigns its {len(recording.channels)} signals to channels "
        f"({list_names(c.name for c in recording)}){has}\n"
        f"  'tselab signals {name} --write signals.toml' proposes one; it is used if it is next to the log"
    )
