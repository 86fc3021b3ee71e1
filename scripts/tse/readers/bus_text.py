"""Frames of a CAN bus as many tools write them into text: what python-can reads is handed to it line by line, put into its form;
what it does not read is read here."""

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

DETECTION_BYTES = 1 << 16  # bytes from which a kind is recognised
MAX_LINE_LENGTH = 1 << 14  # characters of a line of a log
DETECTION_LINES = 2000  # lines from which stamps and identifiers are understood
MAX_LISTED_LINES = 3  # odd lines that a note names
ERROR_FRAME, IDENTIFIER_MASK = 0x20000000, 0x1FFFFFFF
DAY = 86400.0  # s


class Frame(NamedTuple):
    """One frame. `time`, s, as its log has it; `bus`: its name there."""

    time: float
    identifier: int
    extended: bool
    bus: str
    data: bytes


class Lines:
    """The lines of a text, and which of them are odd. UTF-8 where it is that, else cp1252."""

    def __init__(self, path: Path):
        self._path = path
        self.number = 0  # of the line that was read last
        self.odd: list[int] = []
        self.errors = 0  # error frames

    def __iter__(self) -> Iterator[tuple[int, str]]:
        with open(self._path, encoding=_detect_encoding(self._path), errors="replace") as file:
            for number, line in enumerate(iter(lambda: file.readline(MAX_LINE_LENGTH), ""), 1):
                self.number = number
                yield number, line

    def note(self) -> str:
        """What is said of odd lines."""
        first = ", ".join(str(n) for n in self.odd[:MAX_LISTED_LINES])
        more = f" and {len(self.odd) - MAX_LISTED_LINES} more" if len(self.odd) > MAX_LISTED_LINES else ""
        return f"{len(self.odd)} lines are no frames of their format and are left out: line {first}{more}"


def _detect_encoding(path: Path) -> str:
    with open(path, "rb") as file:
        start = file.read(DETECTION_BYTES)
    if start.startswith((b"\xff\xfe", b"\xfe\xff")):
        return "utf-16"
    try:
        start.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        return "utf-8-sig" if error.start > len(start) - 4 else "cp1252"
    return "utf-8-sig"


# ---- Which tool wrote it

STAMP = r"\(\s*[-+]?[\d.:/ -]+\)"
CANDUMP = re.compile(rf"\s*{STAMP}\s+\S+\s+[0-9A-Fa-f]{{3,8}}#", re.ASCII)
CONSOLE = re.compile(
    rf"\s*(?:{STAMP}\s+)?[A-Za-z]\S*\s+(?:(?:RX|TX)\s+\S+\s+\S+\s+)?[0-9A-Fa-f]{{3,8}}\s+\[\d{{1,2}}\](?:\s|$)",
    re.ASCII,
)
ASC = re.compile(r"\s*base\s+(hex|dec)\b", re.IGNORECASE)
TRC = re.compile(r";\$FILEVERSION|;.*PCAN", re.IGNORECASE)
BUSMASTER = re.compile(r"\*\*\*.*(BUSMASTER|<Time><Tx/Rx>|PROTOCOL CAN)", re.IGNORECASE)
TITLE_PATTERNS = {  # columns of a table with a frame per row, by their titles without blanks, units and signs
    "time": r"time|timestamp|timestamps|timestampepoch|timeoffset|timestampus|timestampms|zeit|zeitstempel|ts|timeabs|timerel",
    "identifier": r"id|arbitrationid|canid|identifier|addr|address|messageid|msgid|frameid|idhex",
    "data": r"data|databytes|databyte|payload|d0|d1|byte0|byte1|data0|data1|b0|b1|datahex|datafield|bytes",
}
BYTE_TITLE = re.compile(r"(?:d|b|byte|data|databyte)(\d)\Z")


def detect_bus_text(head: bytes, suffix: str) -> str:
    """Return which tool's frames a text has.

    Parameters
    ----------
    head : bytes
        Its beginning.
    suffix : str
        Of its name, in lower case.

    Returns
    -------
    str
        candump, asc, trc, busmaster, table; "" where it has no frames of a bus.
    """
    if b"\0" in head[:256] and not head.startswith((b"\xff\xfe", b"\xfe\xff")):
        return ""
    text = head.decode(
        "utf-16" if head.startswith((b"\xff\xfe", b"\xfe\xff")) else "latin-1", errors="replace"
    ).lstrip("\ufeffï»¿")
    lines = [x for x in text.splitlines() if x.strip()][:60]
    if any(CANDUMP.match(x) or CONSOLE.match(x) for x in lines[:5]):
        return "candump"
    if any(BUSMASTER.match(x) for x in lines[:20]):
        return "busmaster"
    if suffix == ".trc" or any(TRC.match(x) for x in lines[:20]):
        return "trc"
    if suffix == ".asc" or any(ASC.match(x) for x in lines[:20]):
        return "asc"
    return "table" if any(_find_columns(x) for x in lines[:40]) else ""


def read_frames(path: Path, kind: str, lines: Lines, knows: Callable[[int], bool]) -> Iterator[Frame]:
    """Return the frames of a text.

    Parameters
    ----------
    path : Path
        The file.
    kind : str
        As kind_of() says.
    lines : Lines
        Its lines; odd ones are kept there.
    knows : callable
        Says whether a database has an identifier.

    Returns
    -------
    iterator of Frame
        In the order of the file.

    Raises
    ------
    UserError
        The frames have no times.
    """
    if kind == "candump":
        return _read_candump(path, lines)
    return _read_busmaster(lines) if kind == "busmaster" else _read_table(path, lines, knows)


# ---- candump: of its log, and of what it writes to the console

LOGGED = re.compile(
    r"\s*\(([^)]*)\)\s+(\S+)\s+([0-9A-Fa-f]{3,8})#(?:#([0-9A-Fa-f]))?(R[0-9A-Fa-f]?|[0-9A-Fa-f.]*)(?:_[0-9A-Fa-f])?(?:\s+[RTrt])?\s*\Z",
    re.ASCII,
)
SHOWN = re.compile(
    r"\s*(?:\(([^)]*)\)\s+)?(\S+)\s+(?:(?:RX|TX)\s+\S+\s+\S+\s+)?([0-9A-Fa-f]{3,8})\s+\[(\d{1,2})\]\s*(.*)",
    re.ASCII | re.DOTALL,
)


def _read_candump(path: Path, lines: Lines) -> Iterator[Frame]:
    found = (f for number, line in lines if (f := _parse_candump_line(number, line, lines)) is not None)
    first = list(itertools.islice(found, DETECTION_LINES))
    if first and all(f[0] == "" for f in first):
        raise UserError(
            f"{path}: its frames have no times: record with candump -l, or candump -ta, which write them"
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
            number = int(identifier, 16)
            if number & ERROR_FRAME and len(identifier) > 3:
                lines.errors += 1
                continue
            yield Frame(
                total if differences else time, number & IDENTIFIER_MASK, len(identifier) > 3, bus, data
            )


def _parse_candump_line(number: int, line: str, lines: Lines) -> tuple[str, str, str, bytes] | None:
    """Return stamp, bus, identifier and data of a line; None: it is no frame, or one without data."""
    if not line.strip():
        return None
    if logged := LOGGED.match(line):
        stamp, bus, identifier, _, text = logged.groups()
        if text.startswith("R"):
            return None
        text = text.replace(".", "")
    elif shown := SHOWN.match(line):
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
    """Return a time as candump writes it, s: a number, or a date. NaN: it is neither."""
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
    r"\s*(\d+):(\d+):(\d+):(\d+)\s+(?:Rx|Tx)\s+(\S+)\s+(?:0[xX])?([0-9A-Fa-f]+)\s+(\w+)\s+(\d+)((?:\s+[0-9A-Fa-f]+)*)\s*\Z",
    re.ASCII | re.IGNORECASE,
)


def _read_busmaster(lines: Lines) -> Iterator[Frame]:
    base, relative, total, before, days = 16, False, 0.0, 0.0, 0.0
    for number, line in lines:
        text = line.strip()
        if text.startswith("***"):
            word = text.strip("*").strip().upper()
            base = {"HEX": 16, "DEC": 10}.get(word, base)
            relative = {"RELATIVE MODE": True, "SYSTEM MODE": False, "ABSOLUTE MODE": False}.get(
                word, relative
            )
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
            yield Frame(
                time + days, int(identifier, base) & IDENTIFIER_MASK, kind.lower().startswith("x"), bus, cells
            )
        except ValueError:
            lines.odd.append(number)


# ---- Tables with a frame per row


def _simplify_title(title: str) -> str:
    """Return a title without what stands in brackets, blanks and signs: "Time Stamp (ms)" is timestamp."""
    return re.sub(r"[^a-z0-9]", "", re.sub(r"[\[(].*?[\])]", "", title.strip().strip("\"'").lower()))


def _find_columns(line: str) -> dict[str, int]:
    """Return the places of time, identifier and data in a line of titles; {} where it is none."""
    if len(line) > MAX_LINE_LENGTH:
        return {}
    names = [_simplify_title(n) for n in _split_titles(line)]
    found = {
        what: next((i for i, n in enumerate(names) if re.fullmatch(pattern, n)), -1)
        for what, pattern in TITLE_PATTERNS.items()
    }
    return found if len(names) >= 3 and min(found.values()) >= 0 else {}


def _find_separator(line: str) -> str:
    return max(",;\t", key=line.count)


def _split_titles(line: str) -> list[str]:
    return next(csv.reader([line.lstrip(";").rstrip("\r\n")], delimiter=_find_separator(line)), [])


HEXADECIMAL = re.compile(r"(0x)?[0-9a-f]*\Z", re.IGNORECASE)


def _read_table(path: Path, lines: Lines, knows: Callable[[int], bool]) -> Iterator[Frame]:
    """Frames of a CSV: time, identifier, bytes in one column (hexadecimal, or python-can's base 64) or in one each.

    Identifiers are hexadecimal, unless more of them are in the databases as decimal ones. Times are in s, or as the title
    says; whole numbers are us, as SavvyCAN's, or what their size and distance says."""
    source = iter(lines)
    title = next(((number, line) for number, line in source if _find_columns(line)), None)
    if title is None:
        return
    at, separator = _find_columns(title[1]), _find_separator(title[1])
    names = [_simplify_title(n) for n in _split_titles(title[1])]
    heads = [n.lower() for n in _split_titles(title[1])]
    each = (
        [i for i, n in enumerate(names) if BYTE_TITLE.match(n)] if BYTE_TITLE.match(names[at["data"]]) else []
    )
    length = next((i for i, n in enumerate(names) if n in ("datalength", "len", "length")), -1)
    length = length if length >= 0 else next((i for i, n in enumerate(names) if n == "dlc"), -1)
    extended = next(
        (i for i, n in enumerate(names) if n in ("extended", "isextendedid", "ide", "isextended")), -1
    )
    bus = next((i for i, n in enumerate(names) if n in ("bus", "channel", "buschannel", "can", "port")), -1)
    remote = next((i for i, n in enumerate(names) if n in ("rtr", "isremoteframe", "remote")), -1)
    cut = (part for part in ((n, _split_row(line, separator)) for n, line in source) if part[1])
    begin = list(itertools.islice(cut, DETECTION_LINES))
    good = [row for _, row in begin if len(row) > max(at.values())]
    decimal = _is_decimal({row[at["identifier"]] for row in good}, knows)
    per = _make_time_parser(heads[at["time"]], [row[at["time"]] for row in good])
    coded = not each and not all(HEXADECIMAL.match(_strip_hex(row[at["data"]])) for row in good)

    def frame(row: list[str]) -> Frame | None:
        if remote >= 0 and row[remote].strip().lower() in ("1", "true"):
            return None
        identifier = row[at["identifier"]].strip()
        is_long = identifier[-1:].lower() == "x" or (
            extended >= 0 and row[extended].strip().lower() in ("true", "1", "x")
        )
        number = int(identifier.rstrip("xXhH") or "x", 10 if decimal else 16)
        if each:
            count = int(row[length]) if length >= 0 and row[length].strip().isdigit() else len(each)
            cells = [row[i].strip() for i in each if i < len(row)]
            cells += (
                [c.strip() for c in row[each[-1] + 1 :]] if count > len(each) else []
            )  # titles end before the bytes do
            data = bytes(int(c, 16) for c in cells[:count] if c)
        else:
            text = _strip_hex(row[at["data"]])
            data = (
                base64.b64decode(row[at["data"]], validate=True)
                if coded
                else bytes.fromhex(text.removeprefix("0x"))
            )
        return Frame(
            per(row[at["time"]]),
            number & IDENTIFIER_MASK,
            is_long,
            row[bus].strip() if bus >= 0 else "0",
            data,
        )

    for part in (begin, cut):
        for number, row in part:
            try:
                made = frame(row)
            except (ValueError, IndexError, binascii.Error):
                lines.odd.append(number)
                continue
            if made is not None:
                yield made


def _split_row(line: str, separator: str) -> list[str]:
    if not line.strip() or line.startswith(("#", "//")):
        return []
    if '"' in line:
        return next(csv.reader([line.rstrip("\r\n")], delimiter=separator), [])
    return line.rstrip("\r\n").split(separator)


def _strip_hex(text: str) -> str:
    return re.sub(r"[\s:_-]|0[xX](?=[0-9A-Fa-f]{1,2}\b)", "", text.strip().strip("\"'")).replace("0X", "0x")


TIME_OF_DAY = re.compile(r"(?:(\d{1,3}):)?(\d{1,3}):(\d{1,2}(?:[.,]\d+)?)", re.ASCII)


def _make_time_parser(title: str, stamps: list[str]) -> Callable[[str], float]:
    """Return what makes seconds of a stamp."""
    unit = re.search(r"[\[(]\s*(ms|us|µs|ns|s)\s*[\])]", title) or re.search(
        r"(?<![a-z])(ms|us|ns)$|_(ms|us|ns)$", title.strip()
    )
    scale = {"ms": 1e-3, "us": 1e-6, "µs": 1e-6, "ns": 1e-9}.get(
        next((g for g in unit.groups() if g), "s") if unit else "", 1.0
    )
    texts = [s.strip().strip("\"'") for s in stamps]
    if texts and sum(bool(re.search(r"\d:\d\d", t)) for t in texts) > 0.5 * len(texts):
        before, days = -DAY, 0.0

        def of_clock(text: str) -> float:
            nonlocal before, days
            found = TIME_OF_DAY.fullmatch(text.strip().strip("\"'"))
            if found is None:
                return _parse_stamp(text.strip().strip("\"'").replace(",", "."))
            time = 3600.0 * int(found[1] or 0) + 60.0 * int(found[2]) + float(found[3].replace(",", "."))
            days += DAY * (time < before - 0.5 * DAY)
            before = time
            return time + days

        return of_clock
    whole = bool(texts) and all(re.fullmatch(r"\d+", t) for t in texts)
    if whole and not unit:
        number = np.array([float(t) for t in texts])
        step = np.diff(number)
        usual = float(np.median(step[step > 0])) if (step > 0).any() else 1e3
        # by an epoch, or how far frames are apart: one takes 0.05 ms at least, and some come each ms
        scale = (
            1e-9
            if number[0] > 1e17 or (number[0] < 1e14 and usual > 1e5)
            else 1e-6
            if number[0] > 1e14 or usual > 20
            else 1e-3
        )

    def of_number(text: str) -> float:
        return scale * float(text.strip().strip("\"'").replace(",", "."))

    return of_number


def _is_decimal(ids: set[str], knows: Callable[[int], bool]) -> bool:
    ids = {i.strip() for i in ids}
    if not ids or not all(i.isdigit() for i in ids) or any(i.startswith("0") and len(i) > 1 for i in ids):
        return False
    as_decimal, as_hexadecimal = (sum(knows(int(i, base)) for i in ids) for base in (10, 16))
    return as_decimal > as_hexadecimal


# ---- ASC and TRC for python-can, whose readers stop at the first line that is none


class _GeneratedText:
    """Lines that are made while they are read, for readers of python-can, which ask for a file."""

    def __init__(self, made: Iterator[str]):
        self._made = made

    def read(self, size: int = -1) -> str:
        """Only so that python-can takes it for a file."""
        return "".join(self._made)

    def write(self, text: str) -> int:
        """Never called."""
        raise OSError(text)

    def close(self) -> None:
        """Nothing is open."""

    def __iter__(self) -> Iterator[str]:
        return self._made


class AscText(_GeneratedText):
    """The lines of an ASC for python-can's reader: stamps that are relative are summed up, those below 0 counted from the first."""

    EVENT = re.compile(r"\s*([-+]?\d+[.,]\d+)(\s.*)\Z", re.DOTALL)

    def __init__(self, lines: Lines, notes: list[str]):
        self._lines, self._notes = lines, notes
        super().__init__(self._generate())

    def _generate(self) -> Iterator[str]:
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
                    self._notes.append(f"the stamps begin at {stamp:g} s: times are counted from there")
                if relative:
                    self._notes.append("the stamps are relative, each to the one before: they are summed up")
            total = total + stamp if relative else stamp + ahead
            yield f"{max(total, 0.0):.9f}{event[2]}"


class TrcText(_GeneratedText):
    """The lines of a TRC for python-can's reader, which does not know version 1.2."""

    def __init__(self, lines: Lines):
        super().__init__(self._generate(lines))

    @staticmethod
    def _generate(lines: Lines) -> Iterator[str]:
        between = False
        for _, line in lines:
            if re.match(r"\s*;\$FILEVERSION\s*=\s*1\.2\b", line):
                between = True
                line = ";$FILEVERSION=1.3\n"
            elif between and not line.lstrip().startswith(";"):
                cells = line.split()
                line = " ".join([*cells[:5], "-", *cells[5:]]) + "\n"
            yield line
