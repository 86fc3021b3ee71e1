"""Read VBOX files of Racelogic (.vbo): text in sections, times packed as HHMMSS.ss."""

import io
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from tse.library.errors import UserError
from tse.readers.read_text import detect_encoding, translate_parser_errors
from tse.readers.recording import (
    RECEIVER_TEXT,
    Channel,
    ReadOptions,
    Recording,
    check_rows,
    check_table_width,
    find_unused_name,
    list_names,
)
from tse.readers.table import convert_numbers, find_unit_suffix, split_unit, unpack_times

SECTION = re.compile(r"\[([^\]\[]*)\]\s*$")
MAX_HEAD_BYTES = 1 << 20  # largest number of characters before section [data]
# Short name of each column that the GNSS receiver measures -> unit of the values that
# read() returns for it. The units of all other columns are in section [channel units].
RECEIVER_UNITS = {
    "sats": "1",
    "time": "",  # no channel: read() converts it to the times [s] of the channels
    "lat": "deg",
    "long": "deg",
    "velocity": "km/h",
    "heading": "deg",
    "height": "m",
    "vert-vel": "km/h",
}
SYNONYMS = {  # name in the file -> short name
    "satellites": "sats",
    "latitude": "lat",
    "longitude": "long",
    "speed": "velocity",
    "altitude": "height",
    "vertical_velocity": "vert-vel",
}
SPEED_UNITS = {  # unit in a title of section [header] -> unit in a Recording
    "kmh": "km/h",
    "km/h": "km/h",
    "kph": "km/h",
    "mph": "mph",
    "knots": "knots",
    "m/s": "m/s",
    "mps": "m/s",
}
MINUTES_PER_DEGREE = 60.0
SATELLITES_MASK = 0x3F  # bits with the number of satellites; higher bits are flags (brake, DGPS)
MIN_SATELLITES = 4  # min number of satellites that a receiver needs to compute a position
# columns whose values are invalid in rows with fewer than MIN_SATELLITES satellites
NEEDS_FIX = ("lat", "long", "velocity", "heading", "height", "vert-vel")


def read(path: Path, how: ReadOptions) -> Recording:
    """Return the columns of a VBOX file as channels.

    Parameters
    ----------
    path : Path
        The file.
    how : ReadOptions
        Options: the needed channels.

    Returns
    -------
    Recording
        Times are in s since midnight. Latitude and longitude are in degrees, positive
        north and east. Other columns are as in the file: yaw rate, lateral acceleration
        and lateral velocity of a VBOX are positive to the right.

    Raises
    ------
    UserError
        The file has no section [data], no names of columns, or no column time.
    """
    sections, first = _read_sections(path)
    names = _find_names(path, sections)
    check_table_width(path, names)
    notes: list[str] = []
    table = _read_table(path, first, names, notes)
    short = [SYNONYMS.get(n.lower(), n.lower()) for n in names]
    if "time" not in short:
        raise UserError(f"{path}: has no column time; its columns are {list_names(names)}")
    units = _find_units(names, short, sections)
    column = {s: i for i, s in reversed(list(enumerate(short)))}
    time = unpack_times(pd.to_numeric(table[column["time"]], errors="coerce").to_numpy(float))
    lost = _find_lost_fix(table, column, notes)
    channels: dict[str, Channel] = {}
    for i, name in enumerate(names):
        if short[i] == "time" or (how.wanted and not how.wanted(name)):
            continue
        value, note = convert_numbers(_strip_letters(table[i]) if short[i] in ("lat", "long") else table[i])
        if value is None:
            continue
        if note:
            notes.append(f"column {name}: {note}")
        if short[i] == "sats":
            value = np.where(np.isfinite(value), np.nan_to_num(value).astype(int) & SATELLITES_MASK, np.nan)
        elif short[i] in ("lat", "long"):
            # a VBOX writes minutes of arc, and longitudes that are positive to the west
            value = value / (MINUTES_PER_DEGREE if short[i] == "lat" else -MINUTES_PER_DEGREE)
        if short[i] in NEEDS_FIX and lost.any():
            value = np.where(lost, np.nan, value)
        free = find_unused_name(name, channels)
        text = RECEIVER_TEXT if short[i] in RECEIVER_UNITS else ""
        channels[free] = Channel(free, time, value, units[i], text)
    return Recording(path, "VBOX", channels, notes)


def _read_sections(path: Path) -> tuple[dict[str, list[str]], int]:
    """Return the lines of each section before [data], and the line number of [data]."""
    encoding, errors = detect_encoding(path)
    found: dict[str, list[str]] = {}
    now: list[str] = []
    read = 0
    with open(path, encoding=encoding, errors=errors) as file:
        for count, line in enumerate(iter(lambda: file.readline(MAX_HEAD_BYTES), ""), 1):
            read += len(line)
            if head := SECTION.match(line.strip()):
                if head[1].strip().lower() == "data":
                    return found, count
                now = found.setdefault(head[1].strip().lower(), [])
            else:
                now.append(line.rstrip("\r\n"))
            if read > MAX_HEAD_BYTES:
                break
    raise UserError(
        f"{path}: has no section [data], which every VBOX file has: it is cut off, or has a different format"
    )


def _find_names(path: Path, sections: dict[str, list[str]]) -> list[str]:
    """Return the names of the columns from [column names], else from [header]."""
    words = " ".join(sections.get("column names", [])).split()
    names = words or [_shorten_title(x.strip()) for x in sections.get("header", []) if x.strip()]
    if not names:
        raise UserError(f"{path}: has neither [column names] nor [header], so its columns have no names")
    return names


def _shorten_title(title: str) -> str:
    """Return the name of a column from its title in section [header]: without the unit
    ("velocity kmh" gives velocity), and with a synonym replaced (SYNONYMS)."""
    plain = re.sub(rf"\s+({'|'.join(map(re.escape, SPEED_UNITS))})$", "", title, flags=re.IGNORECASE)
    name = re.sub(r"\s+", "_", plain)
    return SYNONYMS.get(name.lower(), name)


def _find_units(names: Sequence[str], short: Sequence[str], sections: dict[str, list[str]]) -> list[str]:
    """Return the unit of each column; "" if it has none.

    Columns of the receiver have the units in RECEIVER_UNITS. Only the title of a speed in
    [header] may state a different unit, as "velocity mph". Any other column has the unit
    in section [channel units], else the unit in its title or name.

    [channel units] has a line for each column of the file, or only for the last columns.
    So its last line belongs to the last column, the line before it to the column before,
    and so on. A line that belongs to a column of the receiver is ignored.

    A blank line at the end belongs to a column without unit, or only ends the section.
    The expected number of lines decides which. This number is the number of all columns
    if there are at least as many lines and the line of the column time is "s" or blank.
    Otherwise it is the number of columns that are not of the receiver. If there are more
    lines than expected, surplus blank lines at the end are removed. If there are fewer,
    one blank line at the end is removed."""
    said = [_clean_unit(x) for x in sections.get("channel units", [])]
    others = [i for i, s in enumerate(short) if s not in RECEIVER_UNITS]
    has_all = len(said) >= len(names) and "time" in short and said[short.index("time")] in ("", "s")
    complete = len(names) if has_all else len(others)
    while said and not said[-1] and len(said) > complete:
        said.pop()
    if said and not said[-1] and len(said) < complete:
        said.pop()  # a blank line that only ends the section
    units = [RECEIVER_UNITS.get(s, "") for s in short]
    if said:
        for i, unit in zip(reversed(range(len(names))), reversed(said), strict=False):
            if short[i] not in RECEIVER_UNITS:
                units[i] = unit
    titles = [x.strip() for x in sections.get("header", []) if x.strip()]
    if len(titles) == len(names):
        for i, title in enumerate(titles):
            if short[i] in ("velocity", "vert-vel"):
                units[i] = SPEED_UNITS.get(title.split()[-1].lower(), units[i])
            else:
                units[i] = units[i] or split_unit(title)[1] or find_unit_suffix(title)
    return [u or find_unit_suffix(n) for u, n in zip(units, names, strict=True)]


def _clean_unit(line: str) -> str:
    """Return the unit in a line of [channel units]; "" if it contains none."""
    unit = line.strip()
    return "" if unit.lower() in ("(null)", "null", "none", "n/a") else unit


def _read_table(path: Path, first: int, names: Sequence[str], notes: list[str]) -> pd.DataFrame:
    """Return the rows of [data] with a column for each name. Missing cells are NaN."""
    encoding, errors = detect_encoding(path)
    with open(path, encoding=encoding, errors=errors, newline="") as file:
        for _ in range(first):
            file.readline(MAX_HEAD_BYTES)
        text = file.read()
    if not text.strip():
        raise UserError(f"{path}: has a section [data] without rows")
    begin = text[:4096]
    check_rows(path, "[data]", text.count("\n"), 5)
    decimal = "," if "," in begin and "." not in begin else "."
    source = io.StringIO(text)
    # pandas takes the number of cells from the first row that it reads. So rows at the
    # beginning that have more cells than there are names are skipped
    skipped = next((i for i, x in enumerate(source) if 0 < len(x.split()) <= len(names)), None)
    if skipped is None:
        raise UserError(
            f"{path}: every row of [data] has more cells than [column names] has names ({len(names)})"
        )
    source.seek(0)
    with translate_parser_errors(path):
        table = pd.read_csv(
            source,
            sep=r"\s+",
            skiprows=skipped,
            names=range(len(names)),
            header=None,
            index_col=False,
            decimal=decimal,
            low_memory=False,
            on_bad_lines="skip",
            quoting=3,
        )
    rows = sum(1 for x in text.splitlines() if x.strip())
    if len(table) < rows:
        notes.append(
            f"{rows - len(table)} rows of [data] have more cells than there are names of columns "
            f"({len(names)}): left out"
        )
    if not text.endswith("\n") and len(table) > 1:
        notes.append("the last row has no line break: it may be cut inside a number and is left out")
        table = table.iloc[:-1]
    return table


def _strip_letters(cells: pd.Series) -> pd.Series:
    """Return coordinates without the letter that some loggers append.

    The letter is M (minutes), N (north) or E (east)."""
    if pd.api.types.is_numeric_dtype(cells):
        return cells
    return cells.astype("string").str.rstrip("MmNnEe")


def _find_lost_fix(table: pd.DataFrame, column: dict[str, int], notes: list[str]) -> np.ndarray:
    """Mark the rows with too few satellites for a position.

    If all rows have too few, the column of satellites is taken as wrong, and no row is
    marked."""
    if "sats" not in column:
        return np.zeros(len(table), bool)
    said = pd.to_numeric(table[column["sats"]], errors="coerce").fillna(0).to_numpy(float)
    count = np.clip(np.nan_to_num(said), 0, 1 << 20).astype(int) & SATELLITES_MASK
    lost = count < MIN_SATELLITES
    if lost.all() or not lost.any():
        return np.zeros(len(table), bool)
    notes.append(
        f"the receiver had fewer than {MIN_SATELLITES} satellites in {lost.sum()} rows: "
        "its position and velocity are treated as missing there"
    )
    return lost
