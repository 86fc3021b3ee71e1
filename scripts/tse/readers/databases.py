"""Read databases of a CAN bus by cantools.

If cantools refuses a DBC, its faulty lines are repaired or left out, and the rest is
read. A note for the user lists the faulty lines."""

import importlib
import io
import logging
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from tse.library.errors import UserError
from tse.readers.recording import import_optional

DATABASE_SUFFIXES = (".dbc", ".arxml", ".kcd", ".sym")
MAX_DATABASE_BYTES = 512 << 20  # the ARXML of a whole car has 200 MB
MAX_NOTED_LINES = 4  # number of faulty lines that one note describes
# IDENTIFIER_MASK: the 29 bits of an identifier. MAX_STANDARD_IDENTIFIER: the largest
# identifier of 11 bits; larger ones are extended. EXTENDED_BIT: set in a DBC if the
# identifier is an extended one
IDENTIFIER_MASK, MAX_STANDARD_IDENTIFIER, EXTENDED_BIT = 0x1FFFFFFF, 0x7FF, 1 << 31
# identifier of the message in which Vector's tools put signals that belong to no message
ORPHAN_IDENTIFIER = 0xC0000000
VALID_NAME = re.compile(r"[A-Za-z_]\w*\Z", re.ASCII)
KEYWORD = re.compile(
    r"\s*(VERSION|NS_|BS_|BU_|BO_|SG_|SG_MUL_VAL_|SIG_VALTYPE_|VAL_|VAL_TABLE_|CM_|BA_\w*|EV_|EV_DATA_"
    r"|ENVVAR_\w*|BO_TX_BU_|SIG_GROUP_|SGTYPE_\w*|SIG_TYPE_\w*|BU_\w+|CAT_\w*|FILTER)\b\s*:?"
)
MESSAGE_LINE = re.compile(r"\s*BO_\s+(\d+)\s+([^\s:]+)\s*:\s*(\d+)\s*(\S*)")
NUMBER_PATTERN = r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*"
SIGNAL_LINE = re.compile(
    r"\s*SG_\s+([^\s:]+)\s*(M|m\d+M?)?\s*:\s*(\d+)\s*\|\s*(\d+)\s*@\s*([01])\s*([-+])\s*"
    rf"\({NUMBER_PATTERN},{NUMBER_PATTERN}\)\s*"
    rf'(?:\[{NUMBER_PATTERN}\|{NUMBER_PATTERN}\])?\s*(?:"([^"]*)")?\s*(.*)'
)
SIGNAL_DETAIL_LINE = re.compile(
    r"\s*(VAL_|SIG_VALTYPE_|SG_MUL_VAL_|CM_\s+SG_)\s+(\d+)\s+([^\s:]+)([\s:].*)", re.DOTALL
)
LONG_NAME_LINE = re.compile(
    r'\s*BA_(?:DEF_|DEF_DEF_)?\s+(?:SG_\s+|BO_\s+)?"System(?:Signal|Message)LongSymbol"'
)
VALUES_TEXT = re.compile(r'(?:\s*-?\d+\s+"[^"]*")+\s*;?\s*\Z')
COMMENT_TEXT = re.compile(r'\s*"[^"]*"\s*;?\s*\Z')


@dataclass
class _Message:
    """A message of a DBC.

    A clean name is a valid name in a DBC, see _clean_name()."""

    line: int  # number of the line with its statement BO_
    identifier: int  # EXTENDED_BIT is set if the identifier is an extended one
    name: str  # clean name of the message
    length: int  # [bytes] -1: the message is left out
    sender: str
    signals: dict[str, str] = field(default_factory=dict)  # clean name of a signal -> repaired statement SG_
    called: dict[str, str] = field(default_factory=dict)  # name of a signal in the file -> clean name

    def text(self, names: Iterable[str]) -> str:
        """Return the statements of the message with the named signals."""
        head = f"BO_ {self.identifier} {self.name}: {self.length} {self.sender}"
        return "\n".join([head, *(self.signals[n] for n in names)])


@dataclass
class _OddLines:
    """Faulty lines of a DBC, which were left out or changed."""

    said: list[tuple[int, str]] = field(default_factory=list)  # number of the line, what is wrong

    def add(self, line: int, what: str) -> None:
        """Record a faulty line, with a description of its fault."""
        self.said.append((line, what))

    def note(self, path: Path) -> str:
        """Return one note: the faults of the first MAX_NOTED_LINES faulty lines, and the
        number of all other faulty lines."""
        self.said.sort()
        first = "; ".join(f"line {line}: {what}" for line, what in self.said[:MAX_NOTED_LINES])
        more = len(self.said) - MAX_NOTED_LINES
        return f"{path.name}: {first}{f'; and {more} more such lines' if more > 0 else ''}"


def read_database(path: Path, notes: list[str]) -> list[Any]:
    """Return the messages of a database.

    Parameters
    ----------
    path : Path
        A DBC, ARXML, KCD or SYM file.
    notes : list of str
        Receives a note about lines that were left out or changed.

    Returns
    -------
    list of cantools.database.can.Message
        Messages that can be read.

    Raises
    ------
    UserError
        No message can be read.
    """
    cantools = import_optional("cantools", "can", str(path))
    # If several messages have the same name, cantools logs a warning. The warning is
    # suppressed, because read_can.py finds messages by their identifiers, so that equal
    # names do no harm
    logging.getLogger("cantools").setLevel(logging.CRITICAL)
    try:
        size = path.stat().st_size
        if size > MAX_DATABASE_BYTES:
            raise UserError(
                f"{path}: has {size >> 20:,} MB; allowed for a database: up to "
                f"{MAX_DATABASE_BYTES >> 20} MB; export only the needed buses"
            )
        if path.suffix.lower() != ".dbc":
            return list(getattr(cantools.database.load_file(path, strict=False), "messages", []))
        text = _read_text(path)
        return list(cantools.database.load_string(text, "dbc", strict=False).messages)
    except (UserError, MemoryError):
        raise
    except OSError as error:
        raise UserError(f"{path}: cannot be read: {error.strerror}") from None
    except Exception as error:  # a parser may raise any error
        first = (str(error).splitlines() or [type(error).__name__])[0][:150]
        refused = UserError(f"{path}: cannot be read as a database of a bus (DBC, ARXML, KCD, SYM): {first}")
    if path.suffix.lower() != ".dbc":
        text = _convert_by_canmatrix(path)
        notes += [f"{path.name}: read by canmatrix, because cantools fails ({first})"] if text else []
    if not re.search(r"^\s*BO_\s+\d+", text, re.MULTILINE):
        raise refused
    odd = _OddLines()
    messages = _load_leniently(cantools, text, odd)
    if not messages:
        raise refused
    if odd.said:
        notes.append(odd.note(path))
    return messages


def _convert_by_canmatrix(path: Path) -> str:
    """Convert a database to the text of a DBC by canmatrix; return "" if that fails."""
    try:
        formats = importlib.import_module("canmatrix.formats")
        logging.getLogger("canmatrix").setLevel(logging.CRITICAL)
        made = io.BytesIO()
        formats.dump(formats.loadp_flat(str(path)), made, "dbc")
        return made.getvalue().decode("cp1252", errors="replace")
    except MemoryError:
        raise
    except Exception:  # a parser may raise any error
        return ""


def _read_text(path: Path) -> str:
    """Return the text of a DBC, decoded as UTF-8 or else as cp1252 (Vector's tools)."""
    raw = path.read_bytes()
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError:
        return raw.decode("cp1252", errors="replace")


def _load_leniently(cantools: Any, text: str, odd: _OddLines) -> list[Any]:
    """Return the messages of a DBC that cantools refuses as a whole.

    Try these, until cantools accepts one:

    1. all statements, as repaired by _split_parts();
    2. only the statements that define messages and signals;
    3. each message alone. Of a refused message, try each signal alone, and keep the
       message with the accepted signals.

    `odd` receives what is left out."""
    messages, others = _split_parts(text, odd)
    whole = [m.text(m.signals) for m in messages]
    if (found := _load(cantools, [*whole, *(x for _, x in others)])) is not None:
        return found
    if others:
        odd.add(others[0][0], f"{len(others)} lines of values and comments are left out")
    if (found := _load(cantools, whole)) is not None:
        return found
    kept: list[Any] = []
    for m in messages:
        found = _load(cantools, [m.text(m.signals)])
        if found is None:
            good = [n for n in m.signals if _load(cantools, [m.text([n])]) is not None]
            found = _load(cantools, [m.text(good)]) if good else None
            lost = [n for n in m.signals if n not in good]
            what = f"signals {', '.join(lost[:3])} of message {m.name}" if lost else f"message {m.name}"
            odd.add(m.line, f"{what} cannot be read: left out")
        kept += found or []
    return kept


def _load(cantools: Any, parts: Sequence[str]) -> list[Any] | None:
    """Return the messages of a DBC made of `parts`; None if cantools cannot read it."""
    try:
        text = "\n\n".join(['VERSION ""\n\nNS_ :\n\nBS_:\n\nBU_:', *parts, ""])
        return list(cantools.database.load_string(text, "dbc", strict=False).messages)
    except Exception:  # a parser may raise any error
        return None


def _split_parts(text: str, odd: _OddLines) -> tuple[list[_Message], list[tuple[int, str]]]:
    """Split the text of a DBC; return its messages with their signals, and its details.

    A detail is a statement with a signal's comment, number type, multiplexer values or
    names of values, or with the long name of a signal or message. It is returned as
    (number of its first line, text), unless it is faulty or its signal does not exist.
    `odd` receives the faults."""
    messages: list[_Message] = []
    later: list[tuple[int, str]] = []
    for line, part in _split_statements(text):
        kind = KEYWORD.match(part)
        word = kind[1] if kind else ""
        if word == "BO_":
            if (message := _parse_message(line, part, odd)) is not None:
                messages.append(message)
            elif not messages or messages[-1].length >= 0:
                messages.append(_Message(line, -1, "", -1, ""))  # its signals are left out, too
        elif word == "SG_":
            _add_signal(messages, line, part, odd)
        elif word in ("VAL_", "SIG_VALTYPE_", "SG_MUL_VAL_", "CM_") or LONG_NAME_LINE.match(part):
            later.append((line, part))
    messages = [m for m in messages if m.length >= 0]
    by_number: dict[int, _Message] = {}
    for m in messages:
        by_number.setdefault(m.identifier & IDENTIFIER_MASK, m)
    return messages, [(line, x) for line, part in later if (x := _rename_signal(by_number, line, part, odd))]


def _split_statements(text: str) -> Iterator[tuple[int, str]]:
    """Yield the statements of a DBC with the numbers of their first lines.

    A quoted string may have several lines. If its closing quote is missing, the statement
    ends before the next message or signal."""
    now, first, open_ = "", 0, False
    for number, line in enumerate(text.splitlines(), 1):
        begins = KEYWORD.match(line)
        if begins and (not open_ or begins[1] in ("BO_", "SG_")):
            if now:
                yield first, now
            now, first, open_ = line, number, False
        elif now and line.strip():
            now += "\n" + line
        if line.count('"') % 2:
            open_ = not open_
    if now:
        yield first, now


def _parse_message(line: int, part: str, odd: _OddLines) -> _Message | None:
    """Return the message of a statement BO_; None if the message cannot be used."""
    found = MESSAGE_LINE.match(part)
    if found is None:
        odd.add(line, f"{part.strip()[:40]!r} cannot be parsed as a message: left out")
        return None
    identifier, name, length = int(found[1]), found[2], int(found[3])
    if identifier == ORPHAN_IDENTIFIER:
        return None
    plain = identifier & ~EXTENDED_BIT
    if plain > IDENTIFIER_MASK or length > 64:
        what = f"its length is {length} bytes, allowed: up to 64"
        if plain > IDENTIFIER_MASK:
            what = f"its identifier {identifier} has more than 29 bits"
        odd.add(line, f"message {name[:40]}: {what}: left out")
        return None
    if plain > MAX_STANDARD_IDENTIFIER and identifier == plain:
        what = "its identifier has more than 11 bits, so it is taken as extended"
        odd.add(line, f"message {name[:40]}: {what}")
        identifier |= EXTENDED_BIT
    sender = found[4] if VALID_NAME.match(found[4]) else "Vector__XXX"
    return _Message(line, identifier, _clean_name(line, name, odd), length, sender)


def _add_signal(messages: list[_Message], line: int, part: str, odd: _OddLines) -> None:
    """Add the signal that the statement SG_ in `part` defines to the last message of
    `messages`. If the statement is faulty, record it in `odd` and add nothing.
    """
    found = SIGNAL_LINE.match(part.replace("\n", " "))
    if not messages or messages[-1].length < 0:
        return  # the message of this signal is left out, so the signal is left out, too
    if found is None:
        odd.add(line, f"{part.strip()[:60]!r} cannot be parsed as a signal: left out")
        return
    given, mux, start, length, order, sign, scale, offset, low, high, unit, _ = found.groups()
    name = _clean_name(line, given, odd)
    if not 1 <= int(length) <= 64 or name in messages[-1].signals:
        what = "occurs twice" if name in messages[-1].signals else f"has {length} bits, allowed: 1 .. 64"
        odd.add(line, f"signal {name[:40]}: {what}: left out")
        return
    numbers = [f"{float(x):.17g}" for x in (scale, offset, low or "0", high or "0")]
    messages[-1].called[given] = name
    messages[-1].signals[name] = (
        f" SG_ {name}{f' {mux}' if mux else ''} : {start}|{length}@{order}{sign} "
        f"({numbers[0]},{numbers[1]}) "
        f'[{numbers[2]}|{numbers[3]}] "{unit or ""}" Vector__XXX'
    )


def _clean_name(line: int, name: str, odd: _OddLines) -> str:
    """Return a valid name for a DBC: letters, digits and _, with no digit in front."""
    if VALID_NAME.match(name):
        return name
    plain = re.sub(r"\W", "_", name, flags=re.ASCII)
    plain = plain if VALID_NAME.match(plain) else f"_{plain}"
    odd.add(line, f"the name {name[:40]!r} is read as {plain[:41]}")
    return plain


def _rename_signal(messages: dict[int, _Message], line: int, part: str, odd: _OddLines) -> str:
    """Return a detail (see _split_parts()) with the valid signal name of _clean_name().

    The statement of a long name is returned unchanged. Return "" if the detail cannot be
    parsed, its message or signal does not exist, or it is a comment on anything but a
    signal."""
    if LONG_NAME_LINE.match(part):
        of = re.search(r"(?:SG_|BO_)\s+(\d+)", part)
        return part if of is None or int(of[1]) & IDENTIFIER_MASK in messages else ""
    found = SIGNAL_DETAIL_LINE.match(part)
    if found is None:
        if re.match(r"\s*CM_\s+(SG_\b(?!\s+\d+\s+[^\s\"]+\s+\")|(?!BO_|BU_|EV_|SG_|\"))", part):
            odd.add(line, f"{' '.join(part.split())[:40]!r} is a comment that names no object: left out")
        return ""
    word, number, name, rest = found.groups()
    message = messages.get(int(number) & IDENTIFIER_MASK)
    if name.startswith('"'):
        odd.add(line, f"{' '.join(part.split())[:40]!r} is a comment that names no object: left out")
        return ""
    if message is None or name not in message.called:
        what = "a comment" if word.startswith("CM_") else "values" if word == "VAL_" else word
        odd.add(line, f"{what} of signal {name[:40].strip()}, which does not exist: left out")
        return ""
    good = {"VAL_": VALUES_TEXT, "SIG_VALTYPE_": re.compile(r"\s*:\s*[0-3]\s*;?\s*\Z")}.get(
        word, COMMENT_TEXT if word.startswith("CM_") else None
    )
    if good is not None and not good.match(rest):
        odd.add(line, f"{' '.join(part.split())[:40]!r} is not well-formed: left out")
        return ""
    rest = rest.rstrip()
    return f"{word} {message.identifier} {message.called[name]}{rest}{'' if rest.endswith(';') else ';'}"
