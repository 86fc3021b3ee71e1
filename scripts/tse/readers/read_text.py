"""Read CSV files with any separator, decimal sign, encoding and preamble."""

import itertools
import re
import warnings
from collections import Counter
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd

from tse.library.errors import UserError
from tse.log.units import is_known_unit
from tse.readers.readers import FORMATS
from tse.readers.recording import CHUNK_ROWS, Channel, ReadOptions, Recording, check_table_width, split_cells
from tse.readers.table import (
    TIME_WORDS,
    Column,
    can_be_time,
    convert_numbers,
    convert_to_seconds,
    find_unit_suffix,
    make_recording,
    split_unit,
    split_words,
)

# largest number of rows directly above the data that may hold names, units, or sources of
# the channels (e.g. gps, obd)
MAX_HEADERS = 4
HEAD_LINES = 400  # number of lines at the beginning of a file that are read to find its layout
DELIMITERS = (",", ";", "\t", "|")
NUMBER_CELL = re.compile(r"[-+]?(\d+([.,]\d*)?|[.,]\d+)([eE][-+]?\d+)?")
CLOCK_CELL = re.compile(
    r"(\d{1,4}[-./]\d{1,2}[-./]\d{1,4}[ T]?)?\d{1,2}:\d{2}(:\d{2}([.,]\d+)?)?(Z|[+-]\d{2}:?\d{2})?"
    r"|\d{4}-\d{2}-\d{2}.*"
)
# contents of a cell, in lower case, that a row of data may have in place of a number
EMPTY_CELLS = {"", "nan", "na", "n/a", "null", "-", "none", "#n/a", "inf", "-inf", "true", "false"}


def read(path: Path, how: ReadOptions) -> Recording:
    """Read a CSV file whose layout is found from its first lines."""
    encoding, errors = detect_encoding(path, how)
    with open(path, encoding=encoding, errors=errors, newline="") as file:
        head = file.read(1 << 20)
    if "\0" in head[:65536]:
        raise UserError(BINARY_MESSAGE.format(path))
    lines = head.splitlines()[:HEAD_LINES]
    if not any(x.strip() for x in lines):
        raise UserError(f"{path}: is empty")
    separator = _find_separator(path, lines, how)
    cells = [_split_line(path, x, separator) for x in lines]
    header, units, first = _find_layout(path, cells, how, separator)
    width = len(cells[first]) if first < len(cells) else 0
    names = _take_names(path, cells[header] if header is not None else None, width, lines, header)
    check_table_width(path, names)
    decimal = how.decimal or _find_decimal(cells[first:])
    if decimal is None and separator != ",":  # the first rows have integers only: search the next rows
        with open(path, encoding=encoding, errors=errors, newline="") as file:
            decimal = _find_first_decimal(path, itertools.islice(file, first, None), separator)
    decimal = decimal or "."
    of = dict(zip(names, units or [""] * len(names), strict=False))
    long = _find_long_table(names, cells[first:])
    needed = list(long)
    if not long:
        needed = [i for i, name in enumerate(names) if name and _is_needed(i, name, of.get(name, ""), how)]
    with open(path, encoding=encoding, errors=errors, newline="") as file, translate_parser_errors(path):
        parts = pd.read_csv(
            file,
            sep=r"\s+" if separator == " " else separator,
            decimal=decimal,
            names=range(len(names)),
            header=None,
            skiprows=first,
            index_col=False,
            skipinitialspace=True,
            low_memory=False,
            chunksize=CHUNK_ROWS,
        )
        table = pd.concat([part[needed] for part in parts], ignore_index=True)
    if table.empty:
        raise UserError(f"{path}: has a header but no rows")
    if long:
        return _pivot(path, [names[i] for i in long], [table[i] for i in long], how)
    columns = [
        Column(name, table[i] if i in table else np.full(len(table), np.nan), of.get(name, ""))
        for i, name in enumerate(names)
        if name
    ]
    notes = []
    if separator != "," or decimal != "." or (header or 0) > 0 or units:
        parts = [f"separator {separator!r}", f"decimal {decimal!r}"]
        parts += [f"names in line {header + 1}"] if header else []
        notes.append(f"read as CSV with {', '.join(parts)}{', a row of units' if units else ''}")
    return make_recording(path, "CSV", columns, how, notes)


# ---- Long tables: each row has one value and the name of its channel
NAME_TITLE = re.compile(
    r"(?:^|[_ .])"
    r"(name|signal|channel|parameter|variable|metric|key|tag|measurement|sensor|kanal|messgroesse)$",
    re.I,
)
VALUE_TITLE = re.compile(r"(?:^|[_ .])(value|val|reading|wert|messwert)$", re.I)
CAR_TITLE = re.compile(r"(?:^|[_ .])(vehicle|car|device|vin|fahrzeug)(?:[_ .]?(id|name|number))?$", re.I)
MAX_LONG_NAMES = 2000  # largest number of channels of a long table


def _find_long_table(names: list[str], rows: list[list[str]]) -> tuple[int, ...]:
    """Return the indices of the columns time, name, value and, if there is one, car.

    These are the columns of a long table, in which each row has one value and the name of
    its channel. For a table that is not long, i.e. has one column per channel, return
    ()."""
    titles = [n.strip().lower() for n in names]
    name, value = ([i for i, n in enumerate(titles) if p.search(n)] for p in (NAME_TITLE, VALUE_TITLE))
    value = [i for i in value if i not in name]
    time = [
        i
        for i, n in enumerate(titles)
        if i not in (*name, *value) and can_be_time(i, n, "") and any(w in TIME_WORDS for w in split_words(n))
    ]
    good = [r for r in rows if len(r) == len(names)]
    if not value or not time or len(good) < 2:
        return ()
    cars = [i for i, n in enumerate(titles) if CAR_TITLE.search(n)]
    texts = [i for i in name if i not in cars and all(r[i] and not NUMBER_CELL.fullmatch(r[i]) for r in good)]
    numbers_ = [i for i in value if sum(_is_data(r[i]) for r in good) > 0.5 * len(good)]
    if not texts or not numbers_ or len({r[texts[0]] for r in good}) > 0.5 * len(good):
        return ()
    return (time[0], texts[0], numbers_[0], *cars[:1])


def _pivot(path: Path, titles: list[str], columns: list[pd.Series], how: ReadOptions) -> Recording:
    """Return the channels of a long table, each with its own times."""
    notes = [f"one value per row: the channel's name is in column {titles[1]}, its value in {titles[2]}"]
    time = convert_to_seconds(path, Column(titles[0], columns[0]), notes, how)
    value, _ = convert_numbers(pd.to_numeric(columns[2], errors="coerce"))
    if value is None:
        raise UserError(
            f"{path}: has one value per row, but its column of values, {titles[2]}, has no numbers"
        )
    name = columns[1].astype("string").str.strip()
    if len(columns) > 3 and columns[3].nunique() > 1:
        name = columns[3].astype("string").str.strip() + "." + name
        cars = columns[3].nunique()
        notes.append(f"the file has {cars} cars: channels are named CAR.NAME, CAR from column {titles[3]}")
    if (count := name.nunique()) > MAX_LONG_NAMES:
        raise UserError(
            f"{path}: column {titles[1]} is taken as the names of channels, but has {count:,} different "
            f"names; allowed: up to {MAX_LONG_NAMES:,}; remove the rows of channels that are not needed"
        )
    channels: dict[str, Channel] = {}
    for given, rows in name.groupby(name).indices.items():
        plain, unit = split_unit(str(given))
        if how.wanted and not how.wanted(plain):
            continue
        order = rows[np.argsort(time[rows], kind="stable")]
        channels[plain] = Channel(plain, time[order], value[order], unit or find_unit_suffix(plain))
    shared: dict[bytes, np.ndarray] = {}
    channels = {n: replace(c, time=shared.setdefault(c.time.tobytes(), c.time)) for n, c in channels.items()}
    return Recording(path, "CSV", channels, notes)


def _is_needed(place: int, name: str, unit: str, how: ReadOptions) -> bool:
    """Return whether a column is read: it is a needed channel, or may be the time."""
    plain, own = split_unit(name)
    if how.wanted is None or how.wanted(plain) or plain == how.time:
        return True
    return can_be_time(place, plain, unit or own)


@contextmanager
def translate_parser_errors(path: Path) -> Iterator[None]:
    """Convert errors of pandas' parser to UserError."""
    try:
        with warnings.catch_warnings():
            # if the first row of a chunk has too many cells, pandas only warns
            warnings.simplefilter("error", pd.errors.ParserWarning)
            warnings.simplefilter("ignore", pd.errors.DtypeWarning)
            yield
    except pd.errors.EmptyDataError:
        raise UserError(f"{path}: has a header but no rows") from None
    except (pd.errors.ParserError, pd.errors.ParserWarning) as error:
        detail = str(error).replace("Error tokenizing data. C error: ", "").strip()
        raise UserError(
            f"{path}: is not a well-formed CSV: {detail}; every row needs as many cells as there are names"
        ) from None
    except UserError:
        raise
    except ValueError as error:
        raise UserError(f"{path}: is not a well-formed CSV: {str(error)[:150]}") from None


BINARY_MESSAGE = "{}: is a binary file of an unknown format; a log as text, MF4, BLF ... is needed"


def detect_encoding(path: Path, how: ReadOptions | None = None) -> tuple[str, str]:
    """Return the encoding of a text file and the error handler for invalid bytes.

    Raises
    ------
    UserError
        The file is binary, or cannot be decoded by the encoding of the options.
    """
    how = how or ReadOptions()
    with open(path, "rb") as file:
        start = file.read(4096)
    if how.encoding:
        try:
            _check_encoding(path, how.encoding)
        except (LookupError, UnicodeDecodeError) as error:
            raise UserError(f"{path}: [log] encoding = {how.encoding!r}: {error}") from None
        return how.encoding, "strict"
    for beginning, encoding in (
        (b"\xef\xbb\xbf", "utf-8-sig"),
        (b"\xff\xfe", "utf-16"),
        (b"\xfe\xff", "utf-16"),
    ):
        if start.startswith(beginning):
            return encoding, "replace"
    try:
        _check_encoding(path, "utf-8")
    except UnicodeDecodeError:
        if sum(c < 32 and c not in (9, 10, 13, 12, 26, 27) for c in start) > 8:
            raise UserError(BINARY_MESSAGE.format(path)) from None
        return "cp1252", "replace"
    return "utf-8", "strict"


def _check_encoding(path: Path, encoding: str) -> None:
    """Decode a file completely, to check its encoding.

    Raises
    ------
    UnicodeDecodeError
        The file contains bytes that are invalid in this encoding.
    LookupError
        Python has no encoding of this name.
    """
    with open(path, encoding=encoding, newline="") as file:
        while file.read(1 << 20):
            pass


def _find_separator(path: Path, lines: list[str], how: ReadOptions) -> str:
    """Return the separator that splits most lines into the same number of cells."""
    if how.separator:
        return {"tab": "\t", "\\t": "\t", "space": " "}.get(how.separator, how.separator)
    filled = [x for x in lines if x.strip()]
    tail = filled[len(filled) // 3 :] or filled
    best, worth = ",", 0.0
    for d in (*DELIMITERS, " "):
        rows = [_split_line(path, x, d, tried=True) for x in tail]
        width, often = Counter(map(len, rows)).most_common(1)[0]
        # Prefer the separator that splits the lines into numbers. The comma has a lower
        # weight (factor 0.9): a decimal comma, too, splits a line into numbers
        numeric = sum(_is_data(c) for r in rows[:50] for c in r) / max(1, sum(map(len, rows[:50])))
        several = width > 1
        value = several * often / len(tail) * (0.2 + numeric) * (1.0 if d != "," else 0.9)
        value += 1e-3 * width * several
        if d == "," and any(";" in x or "\t" in x for x in tail[:3]):
            value *= 0.5
        if value > worth:
            best, worth = d, value
    if worth == 0.0 and len(lines) > 1 and not any(_is_data(x.strip()) for x in tail):
        raise UserError(
            f"{path}: is no table: none of the usual separators splits its lines into columns; "
            "if the file has a different separator, set it in signals.toml: [log] separator"
        )
    return best


def _split_line(path: Path, line: str, separator: str, tried: bool = False) -> list[str]:
    """Return the cells of a line, without blanks around them.

    `tried`: True if the separator is only tried. Long cells are then no error."""
    if separator == " ":
        return line.split()
    return [c.strip() for c in split_cells(path, line, separator, True, tried)]


def _is_data(cell: str) -> bool:
    """Return whether a cell holds a number, a time or nothing."""
    return bool(NUMBER_CELL.fullmatch(cell) or CLOCK_CELL.fullmatch(cell)) or cell.lower() in EMPTY_CELLS


def _find_layout(
    path: Path, cells: list[list[str]], how: ReadOptions, separator: str
) -> tuple[int | None, list[str] | None, int]:
    """Find the lines with the names of the columns, with their units, and with data.

    Returns
    -------
    int or None
        Index of the line of the names. None: no line has names.
    list of str or None
        Units, from a line between names and data. None: there is no such line.
    int
        Index of the first line of data.
    """

    def is_row(c: list[str]) -> bool:
        return sum(_is_data(x) for x in c) >= 0.5 * len(c) and any(NUMBER_CELL.fullmatch(x) for x in c)

    widths = Counter(len(c) for c in cells if is_row(c))
    if not widths:
        is_table = max((len(c) for c in cells), default=0) > 1 and separator != " "
        if is_table and sum(bool(c) for c in cells) <= 2:
            raise UserError(f"{path}: has a header but no rows")
        raise UserError(f"{path}: is no table: no line holds numbers; readable: {FORMATS}")
    width = widths.most_common(1)[0][0]
    good = [len(c) == width and is_row(c) for c in cells]
    # The data begin at the first of two successive rows of numbers (blank lines do not
    # count): a single row of numbers may belong to the preamble
    filled = [i for i, c in enumerate(cells) if c]
    first = next(
        (
            i
            for i, after in zip(filled, [*filled[1:], -1], strict=True)
            if good[i] and (after < 0 or good[after])
        ),
        good.index(True),
    )
    if how.header is not None:
        if not 1 <= how.header <= len(cells):
            raise UserError(
                f"{path}: [log] header = {how.header} is out of range: it is the number of the line with the "
                f"names; allowed: 1 .. {len(cells)}"
            )
        header = how.header - 1
        first = max(first, header + 1)
    else:
        above = [i for i in range(first) if any(cells[i])]
        if not above:
            return None, None, first
        full = [i for i in above if len(cells[i]) in (width, width + 1)] or above[-1:]
        header = _find_names_row(cells, full)
    between = [i for i in range(header + 1, first) if any(cells[i])]
    units = next((cells[i] for i in between if _are_units(cells[i])), None)
    return header, [u.strip("[]()") for u in units] if units else None, first


def _find_names_row(cells: list[list[str]], full: list[int]) -> int:
    """Return the index of the row with the names of the columns, which is above the data.

    Between names and data there may be a row of units, which is skipped, and a row of
    sources, e.g. gps or obd. Sources repeat, names hardly do. So the row with the most
    different cells has the names. If several rows have equally many different cells, the
    last of these rows has the names.

    `full`: indices of the rows above the data that have as many cells as a row of data,
    or one cell more (e.g. an empty cell after a separator at the end of the line). If no
    row has so many cells, `full` is the index of the last row above the data."""
    block = full[-1:]
    while len(block) < MAX_HEADERS and len(full) > len(block) and full[-len(block) - 1] == block[0] - 1:
        block = [block[0] - 1, *block]
    if len(block) == 1:
        return block[0]
    different = {i: len({c for c in cells[i] if c}) for i in block if not _are_units(cells[i])}
    if not different:
        return block[0]
    most = max(different.values())
    return max(i for i, n in different.items() if n == most)


def _are_units(cells: list[str]) -> bool:
    """Return whether more than 60 % of the cells are units."""
    filled = [c for c in cells if c]
    units = sum(is_known_unit(c) or c in ("-", "1", "[-]", "[]") for c in filled)
    return bool(filled) and units > 0.6 * len(filled)


def _take_names(
    path: Path, cells: list[str] | None, width: int, lines: list[str], header: int | None
) -> list[str]:
    """Return the names of the columns. Fewer names than cells in a row are an error."""
    if cells is None:
        raise UserError(f"{path}: the first line must name the columns; it is {lines[0][:60]!r}")
    if len(cells) < width:
        raise UserError(
            f"{path}: line {(header or 0) + 1} has {len(cells)} names, but the rows have {width} cells: "
            "one name per column is needed"
        )
    return [c.strip().strip('"') for c in cells[: max(width, 1)]]


def _find_first_decimal(path: Path, lines: Iterable[str], separator: str) -> str | None:
    """Return the decimal sign of the first line that has one; None if no line has one."""
    further = (_find_decimal([_split_line(path, x, separator)]) for x in lines if "," in x or "." in x)
    return next(filter(None, further), None)


def _find_decimal(rows: list[list[str]]) -> str | None:
    """Return the decimal sign of most numbers; None if all are integers."""
    comma = sum(bool(re.fullmatch(r"[-+]?\d*,\d+([eE][-+]?\d+)?", c)) for r in rows for c in r)
    point = sum(bool(re.fullmatch(r"[-+]?\d*\.\d+([eE][-+]?\d+)?", c)) for r in rows for c in r)
    return "," if comma > point else "." if point else None
