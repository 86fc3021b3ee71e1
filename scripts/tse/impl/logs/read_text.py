"""Text tables, CSV of any dialect: delimiter, decimal comma, encoding, a preamble, a row of units, dates."""

import csv
import itertools
import re
import warnings
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pandas as pd

from tse.impl.errors import UserError
from tse.impl.logs.readers import FORMATS
from tse.impl.logs.recording import PIECE, How, Recording
from tse.impl.logs.table import Column, may_be_time, recording_of, with_unit
from tse.impl.units import known

HEAD = 400  # lines that are looked at
DELIMITERS = (",", ";", "\t", "|")
NUMBER = re.compile(r"[-+]?(\d+([.,]\d*)?|[.,]\d+)([eE][-+]?\d+)?")
CLOCK = re.compile(
    r"(\d{1,4}[-./]\d{1,2}[-./]\d{1,4}[ T]?)?\d{1,2}:\d{2}(:\d{2}([.,]\d+)?)?(Z|[+-]\d{2}:?\d{2})?|\d{4}-\d{2}-\d{2}.*"
)
EMPTY = {"", "nan", "na", "n/a", "null", "-", "none", "#n/a", "inf", "-inf", "true", "false"}


def read(path: Path, how: How) -> Recording:
    """A table of text."""
    encoding, errors = text_encoding(path, how)
    with open(path, encoding=encoding, errors=errors, newline="") as file:
        head = file.read(1 << 20)
    if "\0" in head[:65536]:
        raise UserError(BINARY.format(path))
    lines = head.splitlines()[:HEAD]
    if not any(x.strip() for x in lines):
        raise UserError(f"{path}: is empty")
    separator = _separator(path, lines, how)
    cells = [_cells(x, separator) for x in lines]
    header, units, first = _layout(path, cells, how, separator)
    width = len(cells[first]) if first < len(cells) else 0
    names = _names(path, cells[header] if header is not None else None, width, lines, header)
    decimal = how.decimal or _decimal(cells[first:])
    if decimal is None and separator != ",":  # whole numbers as far as was looked: a car that stands
        with open(path, encoding=encoding, errors=errors, newline="") as file:
            further = (_decimal([_cells(x, separator)]) for x in itertools.islice(file, first, None) if "," in x or "." in x)
            decimal = next(filter(None, further), None)
    decimal = decimal or "."
    of = dict(zip(names, units or [""] * len(names), strict=False))
    needed = [i for i, name in enumerate(names) if name and _is_needed(i, name, of.get(name, ""), how)]
    with open(path, encoding=encoding, errors=errors, newline="") as file, parsing(path):
        parts = pd.read_csv(
            file, sep=r"\s+" if separator == " " else separator, decimal=decimal, names=range(len(names)), header=None,
            skiprows=first, index_col=False, skipinitialspace=True, low_memory=False, chunksize=PIECE,
        )  # fmt: skip
        table = pd.concat([part[needed] for part in parts], ignore_index=True)
    if table.empty:
        raise UserError(f"{path}: has a header but no rows")
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
    return recording_of(path, "CSV", columns, how, notes)


def _is_needed(place: int, name: str, unit: str, how: How) -> bool:
    """Is it a channel that is wanted, or may it be the time? Others are read only when they are asked for."""
    plain, own = with_unit(name)
    return how.wanted is None or how.wanted(plain) or plain == how.time or may_be_time(place, plain, unit or own)


@contextmanager
def parsing(path: Path) -> Iterator[None]:
    """Errors of pandas' parser in our words."""
    try:
        with warnings.catch_warnings():
            # the first row of each part may have more cells than there are columns, and pandas only warns of it
            warnings.simplefilter("error", pd.errors.ParserWarning)
            warnings.simplefilter("ignore", pd.errors.DtypeWarning)
            yield
    except pd.errors.EmptyDataError:
        raise UserError(f"{path}: has a header but no rows") from None
    except (pd.errors.ParserError, pd.errors.ParserWarning) as error:
        detail = str(error).replace("Error tokenizing data. C error: ", "").strip()
        raise UserError(f"{path}: is not a well-formed CSV: {detail}; every row needs as many cells as there are names") from None
    except UserError:
        raise
    except ValueError as error:
        raise UserError(f"{path}: is not a well-formed CSV: {str(error)[:150]}") from None


BINARY = "{}: is a binary file of no format that is known here; a log as text, MF4, BLF ... is needed"


def text_encoding(path: Path, how: How | None = None) -> tuple[str, str]:
    """Return the encoding of a text, and what becomes of bytes that are none of it. UserError: it is binary."""
    how = how or How()
    with open(path, "rb") as file:
        start = file.read(4096)
    if how.encoding:
        try:
            _decode(path, how.encoding)
        except (LookupError, UnicodeDecodeError) as error:
            raise UserError(f"{path}: [log] encoding = {how.encoding!r}: {error}") from None
        return how.encoding, "strict"
    for beginning, encoding in ((b"\xef\xbb\xbf", "utf-8-sig"), (b"\xff\xfe", "utf-16"), (b"\xfe\xff", "utf-16")):
        if start.startswith(beginning):
            return encoding, "replace"
    try:
        _decode(path, "utf-8")
    except UnicodeDecodeError:
        if sum(c < 32 and c not in (9, 10, 13, 12, 26, 27) for c in start) > 8:
            raise UserError(BINARY.format(path)) from None
        return "cp1252", "replace"
    return "utf-8", "strict"


def _decode(path: Path, encoding: str) -> None:
    """The whole file must be text of that encoding. UnicodeDecodeError: it is not; LookupError: there is none of that name."""
    with open(path, encoding=encoding, newline="") as file:
        while file.read(1 << 20):
            pass


def _separator(path: Path, lines: list[str], how: How) -> str:
    """The one that cuts most lines into equally many cells, more than one."""
    if how.separator:
        return {"tab": "\t", "\\t": "\t", "space": " "}.get(how.separator, how.separator)
    filled = [x for x in lines if x.strip()]
    tail = filled[len(filled) // 3 :] or filled
    best, worth = ",", 0.0
    for d in (*DELIMITERS, " "):
        counts = Counter(len(_cells(x, d)) for x in tail)
        width, often = counts.most_common(1)[0]
        # of a decimal comma that is taken as a separator the cells are whole numbers; prefer what cuts into numbers
        numeric = sum(_is_data(c) for x in tail[:50] for c in _cells(x, d)) / max(1, sum(len(_cells(x, d)) for x in tail[:50]))
        value = (width > 1) * often / len(tail) * (0.2 + numeric) * (1.0 if d != "," else 0.9) + 1e-3 * width * (width > 1)
        if d == "," and any(";" in x or "\t" in x for x in tail[:3]):
            value *= 0.5
        if value > worth:
            best, worth = d, value
    if worth == 0.0 and len(lines) > 1 and not any(_is_data(x.strip()) for x in tail):
        raise UserError(
            f"{path}: is no table: no character separates its lines into columns; if one does: [log] separator in signals.toml"
        )
    return best


def _cells(line: str, separator: str) -> list[str]:
    if separator == " ":
        return line.split()
    return [c.strip() for c in next(csv.reader([line], delimiter=separator, skipinitialspace=True), [])]


def _is_data(cell: str) -> bool:
    return bool(NUMBER.fullmatch(cell) or CLOCK.fullmatch(cell)) or cell.lower() in EMPTY


def _layout(path: Path, cells: list[list[str]], how: How, separator: str) -> tuple[int | None, list[str] | None, int]:
    """Line of the names, the units of the row below it if there is one, first line of data; all from 0."""
    widths = Counter(len(c) for c in cells if sum(_is_data(x) for x in c) >= 0.5 * len(c) and any(NUMBER.fullmatch(x) for x in c))
    if not widths:
        if max((len(c) for c in cells), default=0) > 1 and sum(bool(c) for c in cells) <= 2 and separator != " ":
            raise UserError(f"{path}: has a header but no rows")
        raise UserError(f"{path}: is no table: no line of it is numbers; read are {FORMATS}")
    width = widths.most_common(1)[0][0]
    good = [len(c) == width and sum(_is_data(x) for x in c) >= 0.5 * width and any(NUMBER.fullmatch(x) for x in c) for c in cells]
    first = next(
        (i for i in range(len(good)) if good[i] and (i + 1 >= len(good) or good[i + 1] or not cells[i + 1])), good.index(True)
    )
    if how.header is not None:
        if not 1 <= how.header <= len(cells):
            raise UserError(f"{path}: [log] header = {how.header}: allowed: 1 .. {len(cells)}, the line of the names")
        header = how.header - 1
        first = max(first, header + 1)
    else:
        above = [i for i in range(first) if any(cells[i])]
        if not above:
            return None, None, first
        full = [i for i in above if len(cells[i]) in (width, width + 1)] or above[-1:]
        header = full[-1]
        if len(full) > 1 and _are_units(cells[header]) and not _are_units(cells[full[-2]]):
            header = full[-2]
    between = [i for i in range(header + 1, first) if any(cells[i])]
    units = next((cells[i] for i in between if _are_units(cells[i])), None)
    return header, [u.strip("[]()") for u in units] if units else None, first


def _are_units(cells: list[str]) -> bool:
    filled = [c for c in cells if c]
    return bool(filled) and sum(known(c) or c in ("-", "1", "[-]", "[]") for c in filled) > 0.6 * len(filled)


def _names(path: Path, cells: list[str] | None, width: int, lines: list[str], header: int | None) -> list[str]:
    if cells is None:
        raise UserError(f"{path}: the first line must name the columns; it is {lines[0][:60]!r}")
    if len(cells) < width:
        raise UserError(
            f"{path}: line {(header or 0) + 1} has {len(cells)} names, the rows have {width} cells: one name per column is needed"
        )
    return [c.strip().strip('"') for c in cells[: max(width, 1)]]


def _decimal(rows: list[list[str]]) -> str | None:
    """A comma, where cells are numbers with one and none with a point; None: of neither."""
    comma = sum(bool(re.fullmatch(r"[-+]?\d*,\d+([eE][-+]?\d+)?", c)) for r in rows for c in r)
    point = sum(bool(re.fullmatch(r"[-+]?\d*\.\d+([eE][-+]?\d+)?", c)) for r in rows for c in r)
    return "," if comma > point else "." if point else None
