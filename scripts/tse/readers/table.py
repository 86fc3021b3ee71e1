"""Convert tables to recordings: find the time column, and the units of the columns."""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd

from tse.library.errors import UserError
from tse.log.clock import DAY
from tse.log.units import is_known_unit, unit_factor, unit_kind
from tse.readers.recording import (
    Channel,
    ReadOptions,
    Recording,
    check_table_width,
    find_unused_name,
    last_part,
    list_names,
    suggest_channels,
)

# Words that mark a time column if its name contains one of them. If several columns are
# marked, the column with the word that stands first in this list is tried first
TIME_WORDS = (
    "time", "t", "timestamp", "timestamps", "zeit", "zeitstempel", "temps", "tiempo", "tempo", "datetime",
    "date", "stamp", "uhrzeit", "index", "clock", "sec", "secs", "seconds", "elapsed", "logmonotime", "utc",
)  # fmt: skip
# Max share of the filled cells of a column that are neither a number nor one of
# MISSING_WORDS. A column with a larger share is not used
MAX_WRONG = 0.05
# Guess of the unit of a time column from the median step between its rows. Each entry is:
# max step in this unit, unit, length of the unit [s]. The first entry whose max is not
# exceeded gives the unit. It is right for steps up to 1 s in s, above 1 ms up to 2 s in
# ms, above 2 ms up to 2 s in us, and above 2 ms in ns. For example, a step of 2 is taken
# as 2 ms (500 rows per s), not as 2 s.
TICK_UNITS = ((1.0, "s", 1.0), (2e3, "ms", 1e-3), (2e6, "us", 1e-6), (np.inf, "ns", 1e-9))


@dataclass
class Column:
    """A column of a table. The values are in memory, or read() gets them from a file."""

    name: str
    values: pd.Series | np.ndarray | Callable[[], pd.Series | np.ndarray]
    unit: str = ""  # as in the file; "": the file states none
    text: str = ""  # description in the file
    rows: int | None = None  # number of rows; None: the length of `values`
    dates: bool = False  # True: the function `values` returns dates or durations; unused for arrays

    def read(self) -> pd.Series | np.ndarray:
        """Return all values."""
        return self.values() if callable(self.values) else self.values

    def __len__(self) -> int:
        return self.rows if self.rows is not None else len(self.values)  # type: ignore[arg-type]

    def is_dates(self) -> bool:
        """Return whether the values are dates or durations."""
        return self.dates or (isinstance(self.values, pd.Series | np.ndarray) and _are_dates(self.values))


def _are_dates(x: pd.Series | np.ndarray) -> bool:
    """Return whether the values are dates or durations."""
    return pd.api.types.is_datetime64_any_dtype(x) or pd.api.types.is_timedelta64_dtype(x)


def make_recording(
    path: Path, format_: str, columns: Sequence[Column], how: ReadOptions, notes: Sequence[str] = ()
) -> Recording:
    """Return a table as a recording, with a channel for each column except the time.

    Parameters
    ----------
    path : Path
        The file, for error messages.
    format_ : str
        Name of the file's format.
    columns : sequence of Column
        All columns.
    how : ReadOptions
        Options: name and unit of the time column, step between rows if there is no time
        column, and which channels are needed.
    notes : sequence of str
        Notes for the user that the reader of the format has already written. The notes of
        this function are appended.

    Raises
    ------
    UserError
        The table has no rows, too many columns, or no time column.
    """
    said = list(notes)
    check_table_width(path, [str(c.name) for c in columns])
    named = []
    for c in columns:
        name, unit = split_unit(str(c.name))
        named.append(replace(c, name=name or str(c.name), unit=c.unit or unit))
    rows = max((len(c) for c in named), default=0)
    if not rows:
        raise UserError(f"{path}: has a header but no rows")
    at = _find_time_column(path, named, how)
    if at is None:
        time = np.arange(rows) * float(how.step or 0.0)
        said.append(f"no column is a time: rows are taken as {how.step:g} s apart ([log] step)")
    else:
        time = convert_to_seconds(path, named[at], said, how)
    channels: dict[str, Channel] = {}
    skipped = []
    for i, c in enumerate(named):
        if i == at or (how.wanted and not how.wanted(c.name)):
            continue
        value, note = convert_numbers(c.read())
        if value is None:
            skipped.append(c.name)
            continue
        if note:
            said.append(f"column {c.name}: {note}")
        name = find_unused_name(c.name, channels)
        if name != c.name:
            said.append(f"column {c.name} appears more than once: its next occurrence is named {name}")
        channels[name] = Channel(name, time, value, c.unit or find_unit_suffix(name), c.text)
    if skipped and not how.wanted:
        said.append(f"columns without numbers are not used: {list_names(skipped)}")
    return Recording(path, format_, channels, said)


def convert_numbers(values: pd.Series | np.ndarray) -> tuple[np.ndarray | None, str]:
    """Return a column as floats, and a note about cells that are no numbers ("": none).

    Missing cells and cells that are no numbers become NaN. If the column has dates,
    return None instead of floats. For a column of strings, also return None if no cell is
    a number, or if too many cells are neither numbers nor MISSING_WORDS (MAX_WRONG)."""
    if isinstance(values, np.ndarray) and values.dtype == np.float64:
        return values, ""
    x = values if isinstance(values, pd.Series) else pd.Series(values)
    if _are_dates(x):
        return None, ""
    if pd.api.types.is_bool_dtype(x) or pd.api.types.is_numeric_dtype(x):
        return x.to_numpy(dtype=float, na_value=np.nan), ""
    there = x.notna()
    if x.dtype == object and there.any() and x[there].map(lambda v: isinstance(v, bool)).all():
        return x.astype(float).to_numpy(), ""
    found = pd.to_numeric(x, errors="coerce")
    wrong = (
        found.isna()
        & there
        & (x.astype(str).str.strip() != "")
        & ~x.astype(str).str.strip().str.lower().isin(MISSING_WORDS)
    ).to_numpy()
    if not found.notna().any():
        return None, ""
    if wrong.sum() > MAX_WRONG * there.sum():
        return None, ""
    note = ""
    if wrong.any():
        i = int(wrong.argmax())
        note = (
            f"{wrong.sum()} cells that are no numbers are treated as missing "
            f"(first: {str(x.iloc[i])[:20]!r} in row {i + 1})"
        )
    return found.to_numpy(dtype=float, na_value=np.nan), note


# Contents of a cell, in lower case, that mean a missing value. The cell becomes NaN, and
# the user gets no note about it
MISSING_WORDS = {
    "nan", "na", "n/a", "null", "none", "-", "--", "---", "#n/a", "#nv", "nan(ind)", "-nan(ind)", "1.#qnan",
    "-1.#ind", "inval", "invalid", "sna", "init", "missing", "nil", ".",
}  # fmt: skip


def can_be_time(place: int, name: str, unit: str) -> bool:
    """Return whether a column may be the time, because of its name or unit, or because it
    is the first column of the table (`place` = 0)."""
    return place == 0 or any(w in TIME_WORDS for w in split_words(name)) or unit_kind(unit) == "time"


def _find_time_column(path: Path, columns: Sequence[Column], how: ReadOptions) -> int | None:
    """Return the index of the time column. If there is none, return None if the option
    how.step gives the time between rows, otherwise raise UserError."""
    names = [c.name for c in columns]
    if how.time is not None:
        if how.time not in names:
            raise UserError(
                f"{path}: there is no column {how.time!r}{suggest_channels(how.time, names)}: "
                "correct [log] time in signals.toml"
            )
        return names.index(how.time)
    ranked = []
    for i, c in enumerate(columns):
        if c.is_dates():
            ranked.append((0, i))
            continue
        w = split_words(c.name)
        said = [TIME_WORDS.index(x) for x in w if x in TIME_WORDS]
        if said and len(w) <= 3:
            ranked.append((1 + min(said) + 10 * (len(w) > 1), i))
        elif unit_kind(c.unit) == "time":
            ranked.append((60, i))
    for _, i in sorted(ranked):
        if _is_increasing(columns[i]):
            return i
    if ranked:
        return sorted(ranked)[0][1]
    if how.step is not None:
        return None
    if columns and _is_increasing(columns[0], strictly=True):
        return 0
    raise UserError(
        f"{path}: no column is a time; columns of this file: {list_names(names)}. Name the time column in "
        'signals.toml: [log] time = "NAME", or, for rows at a constant step, [log] step = 0.01 (seconds)'
    )


def _is_increasing(c: Column, strictly: bool = False) -> bool:
    """Return whether a column increases as a time does.

    The values must rise or stay equal in more than 90 % of the rows, and rise in more
    than 10 %. If `strictly`, the values must rise in every row. A column of strings
    counts as increasing if the strings are numbers or times of day."""
    if c.is_dates():
        return True
    values = c.read()
    x = values if isinstance(values, pd.Series) else pd.Series(values)
    if x.dtype == object or pd.api.types.is_string_dtype(x):
        x = x.dropna()
        if not len(x):
            return False
        is_clock = bool(_CLOCK_TIME.search(str(x.iloc[0])))
        return is_clock or pd.to_numeric(x.iloc[:50], errors="coerce").notna().all()
    step = np.diff(x.to_numpy(dtype=float, na_value=np.nan))
    step = step[np.isfinite(step)]
    if not len(step):
        return not strictly
    return bool((step > 0).all()) if strictly else bool((step >= 0).mean() > 0.9 and (step > 0).mean() > 0.1)


_CLOCK_TIME = re.compile(r"\d{1,2}:\d{2}(:\d{2})?")


def convert_to_seconds(path: Path, c: Column, notes: list[str], how: ReadOptions | None = None) -> np.ndarray:
    """Return a time column in s. Missing times are NaN.

    Parameters
    ----------
    path : Path
        The file, for error messages.
    c : Column
        Numbers, dates (converted to s since 1970), times of day, or durations.
    notes : list of str
        Receives a note if the unit is guessed.
    how : ReadOptions, optional
        Options: time_unit is the unit of the time. If it is None, the unit is taken from
        the column's unit or name, or guessed from the median step (TICK_UNITS).

    Raises
    ------
    UserError
        The column holds no times, or the unit of the options is no unit of time.
    """
    how = how or ReadOptions()
    values = c.read()
    x = values if isinstance(values, pd.Series) else pd.Series(values)
    if pd.api.types.is_datetime64_any_dtype(x):
        return _convert_dates(x)
    if pd.api.types.is_timedelta64_dtype(x):
        return (x / pd.Timedelta(seconds=1)).to_numpy(float)
    if not pd.api.types.is_numeric_dtype(x):
        text = x.astype("string").str.strip()
        found = pd.to_numeric(text, errors="coerce")
        if found.notna().mean() < 0.5:
            return _parse_times(path, c.name, text)
        x = found
    time = x.to_numpy(dtype=float, na_value=np.nan)
    unit = how.time_unit or (c.unit if unit_kind(c.unit) == "time" else "") or _find_time_unit(c.name)
    if unit in ("", "s") and how.time_unit is None and is_packed(time):
        notes.append(PACKED_NOTE)
        return unpack_times(time)
    if unit:
        per = unit_factor(unit, "s")
        if per is None:
            raise UserError(
                f"{path}: signals.toml, [log] time_unit: {unit!r} is no unit of time; allowed: s, ms, us, ns"
            )
        return time * per
    step = np.diff(time)
    step = step[np.isfinite(step) & (step > 0)]
    usual = float(np.median(step)) if len(step) else 0.01
    _, name, per = next(t for t in TICK_UNITS if usual <= t[0])
    if name != "s":
        notes.append(
            f"time: rows are {usual:g} apart, so the unit is taken as {name} "
            "([log] time_unit sets a different one)"
        )
    return time * per


# Limits of correct_time_units(). A group is the channels that share one array of times.

# Max median step between the times of a group that are in s. If the median step is
# larger, the times are probably in ms, us or ns
MAX_GROUP_STEP = 2.0
MIN_GROUP_ENTRIES = 100  # a group with fewer times is ignored when the unit is guessed
# All groups of a log have about the same duration (last time - first time). So the unit
# of a group is found by trial: its duration is converted to s from ms, from us and from
# ns. A unit is accepted if the converted duration differs from the median duration of the
# groups in s by less than this share of the median duration
DURATION_TOLERANCE = 0.03


def correct_time_units(
    channels: dict[str, Channel], how: ReadOptions, notes: list[str]
) -> dict[str, Channel]:
    """Return channels with their times in s, for a format that prescribes s.

    Some recorders write ms, us or ns although the format prescribes s. A group is the
    channels that share one array of times. A group is suspect if its median step exceeds
    2 (MAX_GROUP_STEP), because logs have a row at least every 2 s.

    If all groups are suspect, TICK_UNITS gives one unit for all times, from the smallest
    of the median steps. If only some are suspect, the other groups are in s. A suspect
    group is in ms, us or ns if its duration (last time - first time) is 1e3, 1e6 or 1e9
    times the median duration of the groups in s (+- DURATION_TOLERANCE). For a different
    ratio, its times are not changed.

    Parameters
    ----------
    channels : dict of str to Channel
        By name.
    how : ReadOptions
        Options: time_unit, if set, is the unit of all times, and nothing is guessed.
    notes : list of str
        Receives notes about guessed units.

    Returns
    -------
    dict of str to Channel
        The channels by name.
    """
    times = {id(c.time): c.time for c in channels.values()}
    per: dict[int, float] = dict.fromkeys(times, 1.0)
    if how.time_unit:
        per = dict.fromkeys(times, unit_factor(how.time_unit, "s") or 1.0)
    else:
        per |= _guess_units(times, channels, notes)
    if all(p == 1.0 for p in per.values()):
        return channels
    scaled = {i: t * per[i] for i, t in times.items()}
    return {n: replace(c, time=scaled[id(c.time)]) for n, c in channels.items()}


def _guess_units(
    times: dict[int, np.ndarray], channels: dict[str, Channel], notes: list[str]
) -> dict[int, float]:
    """Guess which arrays of times are not in s. Return the length [s] of the unit of each
    of these arrays, e.g. 0.001 for an array in ms.

    `times` has the arrays by their id(). The keys of the result are such ids as well.
    Arrays in s are not in the result."""
    steps = {
        i: float(np.median(d[d > 0]))
        for i, t in times.items()
        if len(t) >= MIN_GROUP_ENTRIES and (d := np.diff(t))[d > 0].size
    }
    if not steps:
        return {}
    shortest = min(steps.values())
    if shortest > MAX_GROUP_STEP:
        _, unit, per = next(t for t in TICK_UNITS if shortest <= t[0])
        notes.append(
            f"time seems to be in {unit}, because entries are {shortest:g} apart: it is converted "
            "([log] time_unit sets a different unit)"
        )
        return dict.fromkeys(times, per)
    spans = {i: float(np.ptp(times[i][np.isfinite(times[i])])) for i in steps}
    usual = np.median([spans[i] for i, step in steps.items() if step <= MAX_GROUP_STEP])
    found: dict[int, float] = {}
    for i in (i for i, step in steps.items() if step > MAX_GROUP_STEP):
        for unit, per in (("ms", 1e-3), ("us", 1e-6), ("ns", 1e-9)):
            if abs(spans[i] * per / usual - 1) < DURATION_TOLERANCE:
                found[i] = per
                named = list_names(c.name for c in channels.values() if id(c.time) == i)
                notes.append(
                    f"time of {named} seems to be in {unit}, that of the other channels in s: it is converted"
                )
    return found


PACKED_NOTE = (
    "time: the numbers are taken as times of day HHMMSS.ss and converted to s "
    '([log] time_unit = "s" prevents this)'
)


def unpack_times(time: np.ndarray) -> np.ndarray:
    """Convert times of day that are packed as HHMMSS.ss to s.

    Parameters
    ----------
    time : ndarray, (rows,)
        10000 hours + 100 minutes + seconds. NaN: missing.

    Returns
    -------
    ndarray, (rows,)
        [s] Time since the midnight before the first row. After the next midnight, it goes
        on above 86400 s.
    """
    with np.errstate(invalid="ignore"):
        whole = np.floor(time)
        hours, minutes = np.floor(whole / 1e4), np.floor(whole / 100) % 100
        found = 3600 * hours + 60 * minutes + (time - 100 * np.floor(whole / 100))
    there = np.flatnonzero(np.isfinite(found))
    if len(there) > 1:
        days = np.cumsum(np.diff(found[there]) < -0.5 * DAY)
        found[there[1:]] += DAY * days
    return found


def is_packed(time: np.ndarray) -> bool:
    """Return whether numbers are times of day packed as HHMMSS.ss.

    The last two digits (seconds) and the two before (minutes) of packed times are below
    60, so the number jumps from 59 to 100 at the end of a minute. A count of seconds
    passes 60 without a jump."""
    t = time[np.isfinite(time)]
    if len(t) < 10 or t.min() < 0 or t.max() >= 240000:
        return False
    if (t % 100 >= 60).any() or (t // 100 % 100 >= 60).any() or t[0] // 100 == t[-1] // 100:
        return False
    step = np.diff(t)
    usual = float(np.median(step))
    minute = np.diff(t // 100) != 0
    if not 0 < usual <= 1.0 or not minute.any():
        return False
    after = np.diff(unpack_times(t))
    return bool((step[minute] > 39).all() and np.median(after[minute]) < 5 * usual + 1e-3)


_TIME_SUFFIXES = {  # last word of a name -> unit
    "ms": "ms",
    "millis": "ms",
    "msec": "ms",
    "milliseconds": "ms",
    "us": "us",
    "micros": "us",
    "usec": "us",
    "microseconds": "us",
    "ns": "ns",
    "nanos": "ns",
    "nsec": "ns",
    "nanoseconds": "ns",
    "logmonotime": "ns",
}


def _find_time_unit(name: str) -> str:
    """Return the unit of time in the name of a column, or "" if there is none.

    The last word of the name may be a unit: time_ms gives ms. Otherwise, the whole name,
    without the path before it, is looked up in _TIME_SUFFIXES: logMonoTime, the time in
    logs of openpilot, gives ns."""
    return _TIME_SUFFIXES.get(
        (split_words(name) or [""])[-1], _TIME_SUFFIXES.get(last_part(name).lower(), "")
    )


def _convert_dates(x: pd.Series) -> np.ndarray:
    """Return dates in s since 1970. Missing dates are NaN."""
    x = x.dt.tz_convert("UTC").dt.tz_localize(None) if getattr(x.dt, "tz", None) is not None else x
    ns = x.to_numpy("datetime64[ns]")
    return np.where(np.isnat(ns), np.nan, ns.astype(np.int64) * 1e-9)


def _parse_times(path: Path, name: str, text: pd.Series) -> np.ndarray:
    """Return dates in s since 1970, or times of day in s since midnight.

    The first string decides between the two. Strings that cannot be read become NaN.
    Raise UserError if no more than half of the strings are dates."""
    text = text.str.replace(r"(\d{1,2}:\d{2}:\d{2}),(\d)", r"\1.\2", regex=True)
    first = str(text.dropna().iloc[0]) if text.notna().any() else ""
    if re.fullmatch(r"\d{1,3}:\d{2}(:\d{2})?(\.\d+)?", first):
        part = text.str.extract(r"^(?:(\d+):)?(\d{1,3}):(\d{1,2}(?:\.\d+)?)$").astype(float)
        return (part[0].fillna(0) * 3600 + part[1] * 60 + part[2]).to_numpy(float)
    for guess in ({"format": "ISO8601"}, {"dayfirst": "." in first.split(" ")[0], "format": "mixed"}):
        try:
            found = pd.to_datetime(text, errors="coerce", utc=True, **guess)
        except (ValueError, TypeError):
            continue
        if found.notna().mean() > 0.5:
            return _convert_dates(found)
    raise UserError(
        f"{path}: column {name}: {first[:30]!r} is no time; allowed: seconds, a date as "
        "2024-05-01 12:00:00.010, a time of day as 12:00:00.010; if the time is in a different column, "
        "name it in signals.toml: [log] time"
    )


# ---- Names of channels that contain a unit, in brackets or as their last word


_BRACKETS = re.compile(r"^(.*?)\s*[\[\(\{<]\s*([^\[\]\(\)\{\}<>]*)\s*[\]\)\}>]\s*$")
_AT_END = {  # last word of a name -> unit
    "kmh": "km/h",
    "kph": "km/h",
    "mph": "mph",
    "mps": "m/s",
    "rpm": "rpm",
    "rads": "rad/s",
    "radps": "rad/s",
    "radpers": "rad/s",
    "degs": "deg/s",
    "degps": "deg/s",
    "dps": "deg/s",
    "deg": "deg",
    "degrees": "deg",
    "rad": "rad",
    "mps2": "m/s2",
    "mpss": "m/s2",
    "ms2": "m/s2",
    "g": "g",
}


def split_unit(name: str) -> tuple[str, str]:
    """Split "Speed [km/h]" into name and unit. If there are no brackets at the end, or no
    unit in the brackets, return the whole name and the unit ""."""
    found = _BRACKETS.match(name.strip())
    if found and found[1]:
        unit = found[2].strip()
        if is_known_unit(unit) or unit in ("", "-", "1"):
            return found[1].strip(), unit
    return name.strip(), ""


def find_unit_suffix(name: str) -> str:
    """Return the unit in the last word of a name (vx_kmh, steeringAngleDeg), or ""."""
    last = (split_words(name) or [""])[-1]
    return _AT_END.get(last, "") if len(split_words(name)) > 1 else ""


def split_words(name: str) -> list[str]:
    """Return the words of a name in lower case.

    ESP_v_Signal_VL gives esp, v, signal, vl; wheelSpeedFL gives wheel, speed, fl."""
    text = re.sub(r"([a-z0-9])([A-Z])", r"\1 \2", name)
    text = re.sub(r"([A-Z]+)([A-Z][a-z])", r"\1 \2", text)
    return [w for w in re.split(r"[^a-zäöüß0-9]+", text.lower()) if w]
