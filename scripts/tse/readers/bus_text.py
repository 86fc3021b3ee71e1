"""Read frames of a CAN bus from text files.

Logs of candump and BUSMASTER and tables (CSV) are parsed here. ASC and TRC are parsed by
python-can: this module only changes the lines that python-can would misread, see AscText
and TrcText."""

import base64
import binascii
import csv
import itertools
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from tse.library.errors import UserError
from tse.log.clock import DAY
from tse.readers.databases import IDENTIFIER_MASK

# [bytes] length of the first part of a file that is read to detect its format
DETECTION_BYTES = 1 << 16
MAX_LINE_LENGTH = 1 << 14  # [characters] a longer line is read in parts of this length
# Number of frames at the beginning of a file from which these are detected. In a log of
# candump: whether each time is the difference from the frame before. In a table: the unit
# of the times, the base (10 or 16) of the identifiers and the coding of the data
DETECTION_LINES = 2000
MAX_LISTED_LINES = 3  # a note names at most this many of the lines that cannot be parsed
ERROR_FRAME = 0x20000000  # bit that candump sets in the identifier of an error frame


class CanFrame(NamedTuple):
    """One frame of a CAN bus."""

    time: float  # [s] as in the log
    identifier: int
    extended: bool
    bus: str  # name of the bus in the log
    data: bytes


class Lines:
    """Yields the lines of a text file in UTF-8, UTF-16 or cp1252, with their numbers.

    The functions that parse the lines store in this object which lines they cannot parse,
    and how many error frames the log contains."""

    def __init__(self, path: Path):
        self._path = path
        self.number = 0  # number of the line that was read last; the first line is 1
        self.odd: list[int] = []  # numbers of the lines that cannot be parsed
        self.errors = 0  # number of error frames

    def __iter__(self) -> Iterator[tuple[int, str]]:
        with open(self._path, encoding=_detect_encoding(self._path), errors="replace") as file:
            for number, line in enumerate(iter(lambda: file.readline(MAX_LINE_LENGTH), ""), 1):
                self.number = number
                yield number, line

    def note(self) -> str:
        """Return a note about the lines that cannot be parsed."""
        first = ", ".join(str(n) for n in self.odd[:MAX_LISTED_LINES])
        more = f" and {len(self.odd) - MAX_LISTED_LINES} more" if len(self.odd) > MAX_LISTED_LINES else ""
        return f"{len(self.odd)} lines cannot be parsed as frames and are left out: line {first}{more}"


def _detect_encoding(path: Path) -> str:
    """Detect the encoding of a text file from its first bytes.

    Return utf-16, utf-8-sig or cp1252."""
    with open(path, "rb") as file:
        start = file.read(DETECTION_BYTES)
    if start.startswith((b"\xff\xfe", b"\xfe\xff")):
        return "utf-16"
    try:
        start.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        return "utf-8-sig" if error.start > len(start) - 4 else "cp1252"
    return "utf-8-sig"


# ---- Detection of the tool that wrote the text

STAMP_PATTERN = r"\(\s*[-+]?[\d.:/ -]+\)"
CANDUMP_START = re.compile(rf"\s*{STAMP_PATTERN}\s+\S+\s+[0-9A-Fa-f]{{3,8}}#", re.ASCII)
CONSOLE_START = re.compile(
    rf"\s*(?:{STAMP_PATTERN}\s+)?[A-Za-z]\S*\s+(?:(?:RX|TX)\s+\S+\s+\S+\s+)?"
    r"[0-9A-Fa-f]{3,8}\s+\[\d{1,2}\](?:\s|$)",
    re.ASCII,
)
ASC_HEADER = re.compile(r"\s*base\s+(hex|dec)\b", re.IGNORECASE)
TRC_HEADER = re.compile(r";\$FILEVERSION|;.*PCAN", re.IGNORECASE)
BUSMASTER_HEADER = re.compile(r"\*\*\*.*(BUSMASTER|<Time><Tx/Rx>|PROTOCOL CAN)", re.IGNORECASE)
TITLE_PATTERNS = {  # column -> pattern; _simplify_title(title of the column) must match it
    "time": r"time|timestamp|timestamps|timestampepoch|timeoffset|timestampus|timestampms|zeit|zeitstempel|ts"
    r"|timeabs|timerel",
    "identifier": r"id|arbitrationid|canid|identifier|addr|address|messageid|msgid|frameid|idhex",
    "data": r"data|databytes|databyte|payload|d0|d1|byte0|byte1|data0|data1|b0|b1|datahex|datafield|bytes",
}
BYTE_TITLE = re.compile(r"(?:d|b|byte|data|databyte)(\d)\Z")


def detect_bus_text(head: bytes, suffix: str) -> str:
    """Detect the format of a text file with frames of a CAN bus.

    Parameters
    ----------
    head : bytes
        Beginning of the file.
    suffix : str
        Suffix of the file name, in lower case.

    Returns
    -------
    str
        candump, asc, trc, busmaster or table; "" for a file without frames.
    """
    if b"\0" in head[:256] and not head.startswith((b"\xff\xfe", b"\xfe\xff")):
        return ""
    encoding = "utf-16" if head.startswith((b"\xff\xfe", b"\xfe\xff")) else "latin-1"
    text = head.decode(encoding, errors="replace").lstrip("\ufeffï»¿")
    lines = [x for x in text.splitlines() if x.strip()][:60]
    if any(CANDUMP_START.match(x) or CONSOLE_START.match(x) for x in lines[:5]):
        return "candump"
    if any(BUSMASTER_HEADER.match(x) for x in lines[:20]):
        return "busmaster"
    if suffix == ".trc" or any(TRC_HEADER.match(x) for x in lines[:20]):
        return "trc"
    if suffix == ".asc" or any(ASC_HEADER.match(x) for x in lines[:20]):
        return "asc"
    return "table" if any(_find_columns(x) for x in lines[:40]) else ""


def read_frames(path: Path, kind: str, lines: Lines, knows: Callable[[int], bool]) -> Iterator[CanFrame]:
    """Return the frames of a text file in the order of the file.

    Parameters
    ----------
    path : Path
        The file. Only its name is used, in error messages.
    kind : str
        candump, busmaster or table, as detect_bus_text() returns it.
    lines : Lines
        Lines of the file. Receives the numbers of the lines that cannot be parsed.
    knows : callable
        Function that returns whether a database contains an identifier. It serves to
        decide whether the identifiers of a table are decimal or hexadecimal numbers.

    Raises
    ------
    UserError
        The file is a log of candump whose frames have no times.
    """
    if kind == "candump":
        return _read_candump(path, lines)
    return _read_busmaster(lines) if kind == "busmaster" else _read_table(lines, knows)


# ---- candump: its log file, and its output on the console

CANDUMP_LINE = re.compile(
    r"\s*\(([^)]*)\)\s+(\S+)\s+([0-9A-Fa-f]{3,8})#(?:#([0-9A-Fa-f]))?"
    r"(R[0-9A-Fa-f]?|[0-9A-Fa-f.]*)(?:_[0-9A-Fa-f])?(?:\s+[RTrt])?\s*\Z",
    re.ASCII,
)
CONSOLE_LINE = re.compile(
    r"\s*(?:\(([^)]*)\)\s+)?(\S+)\s+(?:(?:RX|TX)\s+\S+\s+\S+\s+)?"
    r"([0-9A-Fa-f]{3,8})\s+\[(\d{1,2})\]\s*(.*)",
    re.ASCII | re.DOTALL,
)


def _read_candump(path: Path, lines: Lines) -> Iterator[CanFrame]:
    """Yield the frames of candump.

    If the times are differences from frame to frame (candump -td), they are summed up."""
    found = (f for number, line in lines if (f := _parse_candump_line(number, line, lines)) is not None)
    first = list(itertools.islice(found, DETECTION_LINES))
    if first and all(f[0] == "" for f in first):
        raise UserError(
            f"{path}: its frames have no times: record with candump -l or candump -ta, which write times"
        )
    stamps = np.array([_parse_stamp(f[0]) for f in first])
    differences = (
        len(stamps) > 10 and float(np.nanmean(np.diff(stamps) < 0)) > 0.1 and float(np.nanmax(stamps)) < 100.0
    )
    total = 0.0
    for part in (first, found):
        for stamp, bus, identifier, data in part:
            time = _parse_stamp(stamp)
            total += time if differences and np.isfinite(time) else 0.0
            number, is_long = int(identifier, 16), len(identifier) > 3
            if number & ERROR_FRAME and is_long:
                lines.errors += 1
                continue
            yield CanFrame(total if differences else time, number & IDENTIFIER_MASK, is_long, bus, data)


def _parse_candump_line(number: int, line: str, lines: Lines) -> tuple[str, str, str, bytes] | None:
    """Return time, bus, identifier and data of a line of candump.

    If the line is empty, is a remote frame, or cannot be parsed, return None. The number
    of a line that cannot be parsed is added to lines.odd."""
    if not line.strip():
        return None
    if logged := CANDUMP_LINE.match(line):
        stamp, bus, identifier, _, text = logged.groups()
        if text.startswith("R"):
            return None
        text = text.replace(".", "")
    elif shown := CONSOLE_LINE.match(line):
        stamp, bus, identifier, length, text = shown.groups()
        if text.startswith("remote"):
            return None
        cells = text.split()[: int(length)]
        text = "".join(cells) if all(len(c) == 2 for c in cells) and len(cells) == int(length) else "x"
    else:
        lines.odd.append(number)
        return None
    try:
        return stamp or "", bus, identifier, bytes.fromhex(text)
    except ValueError:
        lines.odd.append(number)
        return None


def _parse_stamp(text: str) -> float:
    """Convert a time of candump, a number or a date, to s. Other strings give NaN."""
    try:
        return float(text)
    except ValueError:
        pass
    try:
        return pd.Timestamp(text.strip()).timestamp() if text.strip() else np.nan
    except (ValueError, OverflowError):
        return np.nan


# ---- BUSMASTER

BUSMASTER_LINE = re.compile(
    r"\s*(\d+):(\d+):(\d+):(\d+)\s+(?:Rx|Tx)\s+(\S+)\s+(?:0[xX])?([0-9A-Fa-f]+)\s+(\w+)\s+(\d+)"
    r"((?:\s+[0-9A-Fa-f]+)*)\s*\Z",
    re.ASCII | re.IGNORECASE,
)
# Key: mode of the times, as the header names it. Value: True if each time is the
# difference from the frame before
BUSMASTER_MODES = {"RELATIVE MODE": True, "SYSTEM MODE": False, "ABSOLUTE MODE": False}


def _read_busmaster(lines: Lines) -> Iterator[CanFrame]:
    """Yield the frames of a log of BUSMASTER.

    In RELATIVE MODE the times are differences, which are summed up. In all other modes
    the times may restart from 0 at midnight. After each restart, one more day is added to
    all further times, so that the times keep increasing."""
    base, relative, total, before, days = 16, False, 0.0, 0.0, 0.0
    for number, line in lines:
        text = line.strip()
        if text.startswith("***"):
            word = text.strip("*").strip().upper()
            base = {"HEX": 16, "DEC": 10}.get(word, base)
            relative = BUSMASTER_MODES.get(word, relative)
            continue
        found = BUSMASTER_LINE.match(line)
        if found is None:
            if text:
                lines.odd.append(number)
            continue
        hours, minutes, whole, part, bus, identifier, kind, length, data = found.groups()
        time = 3600.0 * int(hours) + 60.0 * int(minutes) + int(whole) + int(part) / 10.0 ** len(part)
        if relative:
            total += time
            time = total
        elif time < before - 0.5 * DAY:
            days += DAY
        before = before if relative else time
        if kind.lower().endswith("r"):
            continue
        try:
            cells = bytes(int(c, base) for c in data.split()[: int(length)])
            is_long = kind.lower().startswith("x")
            yield CanFrame(time + days, int(identifier, base) & IDENTIFIER_MASK, is_long, bus, cells)
        except ValueError:
            lines.odd.append(number)


# ---- Tables with one frame per row


def _simplify_title(title: str) -> str:
    """Reduce a title to letters and digits: "Time Stamp (ms)" gives timestamp."""
    return re.sub(r"[^a-z0-9]", "", re.sub(r"[\[(].*?[\])]", "", title.strip().strip("\"'").lower()))


def _find_columns(line: str) -> dict[str, int]:
    """Return the indices of the columns time, identifier and data of a table of frames.

    `line` may be the line with the titles of the table. If it lacks one of the three
    titles, return {}."""
    if len(line) > MAX_LINE_LENGTH:
        return {}
    names = [_simplify_title(n) for n in _split_titles(line)]
    found = {
        what: next((i for i, n in enumerate(names) if re.fullmatch(pattern, n)), -1)
        for what, pattern in TITLE_PATTERNS.items()
    }
    return found if len(names) >= 3 and min(found.values()) >= 0 else {}


def _find_separator(line: str) -> str:
    """Return the separator of a line of titles."""
    return max(",;\t", key=line.count)


def _split_titles(line: str) -> list[str]:
    """Return the titles in a line."""
    return next(csv.reader([line.lstrip(";").rstrip("\r\n")], delimiter=_find_separator(line)), [])


HEXADECIMAL = re.compile(r"(0x)?[0-9a-f]*\Z", re.IGNORECASE)


class _FrameTable:
    """The layout of a CSV with one frame per row.

    The data of a frame are in one column per byte, or all in one column as hexadecimal
    digits or (from python-can) in base 64. Identifiers are decimal or hexadecimal, see
    _is_decimal(). Times are times of day, dates or numbers, see _make_time_parser()."""

    def __init__(self, titles: str):
        self.separator = _find_separator(titles)
        self._columns = _find_columns(titles)
        self._heads = [n.lower() for n in _split_titles(titles)]
        self._names = names = [_simplify_title(n) for n in self._heads]
        per_byte = bool(BYTE_TITLE.match(names[self._columns["data"]]))
        self._bytes = [i for i, n in enumerate(names) if per_byte and BYTE_TITLE.match(n)]
        self._length = self._find("datalength", "len", "length")
        if self._length < 0:
            self._length = self._find("dlc")
        self._extended = self._find("extended", "isextendedid", "ide", "isextended")
        self._bus = self._find("bus", "channel", "buschannel", "can", "port")
        self._remote = self._find("rtr", "isremoteframe", "remote")

    def _find(self, *titles: str) -> int:
        """Return the index of the first column with one of these titles; -1: none."""
        return next((i for i, n in enumerate(self._names) if n in titles), -1)

    def learn(self, rows: list[list[str]], knows: Callable[[int], bool]) -> None:
        """Detect the base of the identifiers, the unit of the times and the coding of the
        data (hexadecimal or base 64).

        `rows` are the first rows of the table. `knows` is as in read_frames()."""
        at = self._columns
        good = [row for row in rows if len(row) > max(at.values())]
        self._base = 10 if _is_decimal({row[at["identifier"]] for row in good}, knows) else 16
        times = [row[at["time"]] for row in good]
        self._seconds = _make_time_parser(self._heads[at["time"]], times)
        data = (_strip_hex(row[at["data"]]) for row in good)
        self._is_base64 = not self._bytes and not all(HEXADECIMAL.match(x) for x in data)

    def parse(self, row: list[str]) -> CanFrame | None:
        """Return the frame of a row; None for a remote frame.

        Raises
        ------
        ValueError, IndexError, binascii.Error
            The row cannot be parsed.
        """
        if self._remote >= 0 and row[self._remote].strip().lower() in ("1", "true"):
            return None
        identifier = row[self._columns["identifier"]].strip()
        is_long = identifier[-1:].lower() == "x"
        if self._extended >= 0:
            is_long = is_long or row[self._extended].strip().lower() in ("true", "1", "x")
        number = int(identifier.rstrip("xXhH") or "x", self._base)
        data = self._parse_data(row)
        time = self._seconds(row[self._columns["time"]])
        bus = row[self._bus].strip() if self._bus >= 0 else "0"
        return CanFrame(time, number & IDENTIFIER_MASK, is_long, bus, data)

    def _parse_data(self, row: list[str]) -> bytes:
        """Return the data bytes of the frame in a row."""
        if not self._bytes:
            text = row[self._columns["data"]]
            if self._is_base64:
                return base64.b64decode(text, validate=True)
            return bytes.fromhex(_strip_hex(text).removeprefix("0x"))
        count = len(self._bytes)
        if self._length >= 0 and row[self._length].strip().isdigit():
            count = int(row[self._length])
        cells = [row[i].strip() for i in self._bytes if i < len(row)]
        if count > len(self._bytes):  # the frame has more bytes than there are titles
            cells += [c.strip() for c in row[self._bytes[-1] + 1 :]]
        return bytes(int(c, 16) for c in cells[:count] if c)


def _read_table(lines: Lines, knows: Callable[[int], bool]) -> Iterator[CanFrame]:
    """Yield the frames of a CSV with one frame per row."""
    source = iter(lines)
    titles = next((line for _, line in source if _find_columns(line)), None)
    if titles is None:
        return
    table = _FrameTable(titles)
    rows = (part for part in ((n, _split_row(line, table.separator)) for n, line in source) if part[1])
    first = list(itertools.islice(rows, DETECTION_LINES))
    table.learn([row for _, row in first], knows)
    for number, row in itertools.chain(first, rows):
        try:
            frame = table.parse(row)
        except (ValueError, IndexError, binascii.Error):
            lines.odd.append(number)
            continue
        if frame is not None:
            yield frame


def _split_row(line: str, separator: str) -> list[str]:
    """Return the cells of a row; [] for an empty line or a comment."""
    if not line.strip() or line.startswith(("#", "//")):
        return []
    if '"' in line:
        return next(csv.reader([line.rstrip("\r\n")], delimiter=separator), [])
    return line.rstrip("\r\n").split(separator)


def _strip_hex(text: str) -> str:
    """Remove separators, quotes and the 0x of single bytes from hexadecimal digits."""
    return re.sub(r"[\s:_-]|0[xX](?=[0-9A-Fa-f]{1,2}\b)", "", text.strip().strip("\"'")).replace("0X", "0x")


TIME_OF_DAY = re.compile(r"(?:(\d{1,3}):)?(\d{1,3}):(\d{1,2}(?:[.,]\d+)?)", re.ASCII)


def _make_time_parser(title: str, stamps: list[str]) -> Callable[[str], float]:
    """Return a function that converts the text of a time in a table to s.

    `title`: title of the column of times. `stamps`: the times of the first rows. If most
    of them contain a colon, the times are times of day or dates. Otherwise they are
    numbers. Their unit is the unit in the title. If the title has no unit, integers are
    in ms, us or ns, see _guess_tick(), and all other numbers are in s."""
    unit = re.search(r"[\[(]\s*(ms|us|µs|ns|s)\s*[\])]", title) or re.search(
        r"(?<![a-z])(ms|us|ns)$|_(ms|us|ns)$", title.strip()
    )
    name = next((g for g in unit.groups() if g), "s") if unit else ""
    scale = {"ms": 1e-3, "us": 1e-6, "µs": 1e-6, "ns": 1e-9}.get(name, 1.0)
    texts = [s.strip().strip("\"'") for s in stamps]
    if texts and sum(bool(re.search(r"\d:\d\d", t)) for t in texts) > 0.5 * len(texts):
        before, days = -DAY, 0.0

        def parse_clock(text: str) -> float:
            """Convert a date to s since 1970, or a time of day to s since the midnight
            before the first frame.

            A time of day more than 12 h below the one before it begins a new day."""
            nonlocal before, days
            found = TIME_OF_DAY.fullmatch(text.strip().strip("\"'"))
            if found is None:
                return _parse_stamp(text.strip().strip("\"'").replace(",", "."))
            time = 3600.0 * int(found[1] or 0) + 60.0 * int(found[2]) + float(found[3].replace(",", "."))
            days += DAY * (time < before - 0.5 * DAY)
            before = time
            return time + days

        return parse_clock
    whole = bool(texts) and all(re.fullmatch(r"\d+", t) for t in texts)
    if whole and not unit:
        scale = _guess_tick(np.array([float(t) for t in texts]))

    def parse_number(text: str) -> float:
        return scale * float(text.strip().strip("\"'").replace(",", "."))

    return parse_number


def _guess_tick(stamps: np.ndarray) -> float:
    """Guess the unit of integer times: ms, us or ns. Return its length [s].

    Times since 1970 are about 2e15 in us and 2e18 in ns. So a first time above 1e17 means
    ns, one of 1e14 to 1e17 means us. Below 1e14, the median step between frames decides,
    which is 0.1 to 20 ms on a bus: above 1e5 it is in ns, from 20 to 1e5 in us, and up to
    20 in ms."""
    step = np.diff(stamps)
    usual = float(np.median(step[step > 0])) if (step > 0).any() else 1e3
    if stamps[0] > 1e17 or (stamps[0] < 1e14 and usual > 1e5):
        return 1e-9
    return 1e-6 if stamps[0] > 1e14 or usual > 20 else 1e-3


def _is_decimal(ids: set[str], knows: Callable[[int], bool]) -> bool:
    """Return whether identifiers are decimal numbers, not hexadecimal ones.

    If any identifier has a letter or a leading 0, all identifiers are hexadecimal.
    Otherwise every identifier is converted both as a decimal and as a hexadecimal number.
    If the databases contain more of the decimal results than of the hexadecimal results,
    the identifiers are decimal."""
    ids = {i.strip() for i in ids}
    if not ids or not all(i.isdigit() for i in ids) or any(i.startswith("0") and len(i) > 1 for i in ids):
        return False
    as_decimal, as_hexadecimal = (sum(knows(int(i, base)) for i in ids) for base in (10, 16))
    return as_decimal > as_hexadecimal


# ---- Repairs of ASC and TRC for the readers of python-can


class _GeneratedText:
    """Generated lines that readers of python-can accept as a file."""

    def __init__(self, made: Iterator[str]):
        self._made = made

    def read(self, size: int = -1) -> str:
        """Return the remaining lines. To python-can, an object with read() is a file."""
        return "".join(self._made)

    def write(self, text: str) -> int:
        """Refuse to write; python-can does not call it."""
        raise OSError(text)

    def close(self) -> None:
        """Do nothing: no file is open."""

    def __iter__(self) -> Iterator[str]:
        return self._made


class AscText(_GeneratedText):
    """The lines of an ASC file, changed such that python-can reads their times correctly.

    python-can takes every time as the time since the start of the log, and skips lines
    with negative times. So times relative to the frame before are summed up, and absolute
    times that begin below 0 are shifted to begin at 0."""

    EVENT = re.compile(r"\s*([-+]?\d+[.,]\d+)(\s.*)\Z", re.DOTALL)

    def __init__(self, lines: Lines, notes: list[str]):
        self._lines, self._notes = lines, notes
        super().__init__(self._generate())

    def _generate(self) -> Iterator[str]:
        """Yield a header and the lines with events, with repaired times."""
        base, relative, total, ahead, began = "hex", False, 0.0, 0.0, False
        for _, line in self._lines:
            if said := re.match(
                r"\s*base\s+(hex|dec)\b(?:.*timestamps\s+(absolute|relative))?", line, re.IGNORECASE
            ):
                base, relative = said[1].lower(), (said[2] or "").lower() == "relative"
                continue
            event = self.EVENT.match(line)
            if event is None:
                continue
            stamp = float(event[1].replace(",", "."))
            if re.match(r"\s*Start of measurement", event[2], re.IGNORECASE):
                total += stamp if relative else 0.0
                continue
            if not began:
                began = True
                yield f"base {base}  timestamps absolute\n"
                yield "internal events logged\n"
                if stamp < 0 and not relative:
                    ahead = -stamp
                    self._notes.append(f"times begin at {stamp:g} s: they are shifted to begin at 0")
                if relative:
                    self._notes.append("each time is relative to the frame before: times are summed up")
            total = total + stamp if relative else stamp + ahead
            yield f"{max(total, 0.0):.9f}{event[2]}"


class TrcText(_GeneratedText):
    """The lines of a TRC file, changed such that python-can can read them.

    python-can reads version 1.3 of the format, but not version 1.2. A file of version 1.2
    is therefore converted to version 1.3."""

    def __init__(self, lines: Lines):
        super().__init__(self._generate(lines))

    @staticmethod
    def _generate(lines: Lines) -> Iterator[str]:
        """Yield the lines of the file, converted from version 1.2 to 1.3 if necessary.

        Version 1.3 has one column more than version 1.2: the sixth column, which is
        reserved. In files of version 1.2, it is inserted with the content "-"."""
        between = False
        for _, line in lines:
            if re.match(r"\s*;\$FILEVERSION\s*=\s*1\.2\b", line):
                between = True
                line = ";$FILEVERSION=1.3\n"
            elif between and not line.lstrip().startswith(";"):
                cells = line.split()
                line = " ".join([*cells[:5], "-", *cells[5:]]) + "\n"
            yield line
