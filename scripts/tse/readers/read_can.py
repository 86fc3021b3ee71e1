"""Read logs of a CAN bus by python-can: BLF, ASC, TRC, candump, tables of frames."""

import contextlib
import logging
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from tse.library.errors import NoFile, UserError
from tse.log.clock import straighten_time
from tse.readers.bus_text import (
    DETECTION_BYTES,
    AscText,
    CanFrame,
    Lines,
    TrcText,
    detect_bus_text,
    read_frames,
)
from tse.readers.databases import DATABASE_SUFFIXES, IDENTIFIER_MASK, MAX_STANDARD_IDENTIFIER, read_database
from tse.readers.recording import (
    CHUNK_ROWS,
    MIN_FRAME_BYTES,
    Channel,
    Growing,
    ReadOptions,
    Recording,
    check_rows,
    find_unused_name,
    import_optional,
    list_names,
)

# ---- Decoding: a signal is extracted from many frames with one numpy operation. The
# database (DBC, ARXML, KCD, SYM) defines which bits of its message the signal occupies.

# Key of a message: bits 0 to 28 are the identifier, bit 29 marks an extended identifier,
# bits from 32 on are the index of the bus
EXTENDED_SHIFT, BUS_SHIFT = 29, 32


def find_databases(path: Path, how: ReadOptions, required: bool) -> list[Path]:
    """Return the databases that the options name; else those in the folder of the log.

    Parameters
    ----------
    path : Path
        The log.
    how : ReadOptions
        Options of the reader. Their member `databases` is used.
    required : bool
        True: raise an error if there is no database.

    Raises
    ------
    UserError
        A database that the options name does not exist; or `required` is True, and there
        is no database.
    """
    if how.databases:
        for p in how.databases:
            if not p.is_file():
                raise NoFile(f"{p}: no such file (database of the bus, for {path.name})")
        return list(how.databases)
    found = sorted(p for p in path.parent.iterdir() if p.suffix.lower() in DATABASE_SUFFIXES)
    if not found and required:
        raise UserError(
            f"{path}: holds frames of a bus, and its folder has no database that describes them "
            f"({', '.join(DATABASE_SUFFIXES)}): "
            'name one with --database FILE, or in signals.toml: [log] databases = ["car.dbc"]'
        )
    return found


@dataclass
class _Kept:
    """Decoded values of one message on one bus.

    A frame may lack a signal: the frame is too short, or the signal is multiplexed. So
    the indices, in the log, of the frames that contain a signal are stored. Signals with
    the same pattern (key from _make_pattern()) are in the same frames, and share these
    indices."""

    message: Any
    signals: list[Any]  # needed signals of the message
    value: dict[str, Growing] = field(default_factory=dict)  # name of a signal -> its values
    # pattern of signals -> indices, in the log, of the frames that contain these signals
    frames: dict[tuple[object, ...], Growing] = field(default_factory=dict)


class Bus:
    """Decodes the needed signals in the frames of a log. add() receives the frames."""

    def __init__(self, path: Path, databases: Sequence[Path], how: ReadOptions):
        self._path, self._databases, self._how = path, databases, how
        self.notes: list[str] = []
        self._messages = read_messages(databases, self.notes)
        self._kept: dict[int, _Kept] = {}
        self._unknown: set[int] = set()
        self._buses: dict[str, int] = {}
        self._count = 0

    def knows(self, identifier: int) -> bool:
        """Return whether a database contains a message with this identifier.

        An identifier of at most 11 bits is taken as a standard identifier."""
        return make_key(identifier, False) in self._messages

    def add(self, ids: np.ndarray, extended: np.ndarray, buses: Sequence[str], data: Sequence[bytes]) -> None:
        """Decode the next frames of the file.

        Parameters
        ----------
        ids : ndarray of int, (frames,)
            Identifier of each frame.
        extended : ndarray of bool, (frames,)
            Whether the identifier is an extended one.
        buses : sequence of str, (frames,)
            Name of the bus of each frame.
        data : sequence of bytes, (frames,)
            Data of each frame.
        """
        bus = np.array([self._buses.setdefault(b, len(self._buses)) for b in buses])
        ids = make_key(ids, extended) | bus << BUS_SHIFT
        seen, order = np.unique(ids), np.argsort(ids, kind="stable")
        bounds = [*np.searchsorted(ids[order], seen).tolist(), len(ids)]
        for k, key in enumerate(seen.tolist()):
            kept = self._kept.get(key) or self._add_message(key)
            if kept is None:
                continue
            rows = order[bounds[k] : bounds[k + 1]]
            for s, have, value in decode_signals(kept.message, kept.signals, [data[i] for i in rows]):
                if s.name not in kept.value:
                    kept.value[s.name] = Growing()
                frames = kept.frames.get(_make_pattern(s))
                if frames is None:
                    frames = kept.frames[_make_pattern(s)] = Growing()
                # signals with the same pattern are in the same frames: the first signal
                # stores the indices of these frames for all
                if len(frames) == len(kept.value[s.name]):
                    frames.extend(self._count + rows[have])
                kept.value[s.name].extend(value)
        self._count += len(ids)

    def _add_message(self, key: int) -> _Kept | None:
        """Prepare the decoding of a message; return None if no database contains it."""
        message = self._messages.get(key & ((1 << BUS_SHIFT) - 1))
        if message is None:
            self._unknown.add(key & IDENTIFIER_MASK)
            return None
        wanted = self._how.wanted
        signals = [
            s for s in message.signals if not wanted or wanted(s.name) or wanted(f"{message.name}.{s.name}")
        ]
        self._kept[key] = _Kept(message, signals)
        return self._kept[key]

    def channels(self, time: np.ndarray, keep: np.ndarray | None, notes: list[str]) -> dict[str, Channel]:
        """Return the signals of all frames, named message.signal, in physical units.

        Parameters
        ----------
        time : ndarray, (kept frames,)
            [s] Times of the kept frames, in the order in which add() received the frames.
        keep : ndarray of bool, (frames,), or None
            True for the kept frames, whose times must not decrease. None: all frames are
            kept, and each signal is sorted by time.
        notes : list of str
            Receives notes about repeated messages, invalid values and unknown
            identifiers.

        Raises
        ------
        UserError
            The databases contain none of the messages.
        """
        notes += self.notes
        channels: dict[str, Channel] = {}
        place = None if keep is None or keep.all() else np.cumsum(keep) - 1
        bus = list(self._buses)
        # If a message is on several buses, its channels from the second bus on are named
        # NAME#2 and so on. Sort by the name of the bus (shorter first, so 2 before 10),
        # which is the same in all logs. The index of a bus is not: the buses are numbered
        # in the order of their first frames.
        for key in sorted(self._kept, key=lambda k: (len(bus[k >> BUS_SHIFT]), bus[k >> BUS_SHIFT], k)):
            kept = self._kept[key]
            message = kept.message.name
            renamed = ""
            clocks: dict[tuple[object, ...], tuple[np.ndarray, np.ndarray | slice]] = {}
            for s in kept.signals:
                if s.name not in kept.value:
                    continue
                pattern = _make_pattern(s)
                if pattern not in clocks:
                    frames = kept.frames[pattern].array().astype(np.int64)
                    times, chosen = self._select_times(frames, time, keep, place)
                    # signals with equal times share one array
                    times = next((t for t, _ in clocks.values() if np.array_equal(t, times)), times)
                    clocks[pattern] = times, chosen
                times, chosen = clocks[pattern]
                states = read_states(s)
                plain = f"{message}.{s.name}"
                value = drop_codes(plain, s, kept.value[s.name].array()[chosen], states, notes)
                name = find_unused_name(plain, channels)
                renamed = name if name != plain else renamed
                channels[name] = Channel(name, times, value, s.unit or "", (s.comment or "")[:200], states)
            if renamed:
                notes.append(
                    f"message {message} appears more than once: signals of identifier "
                    f"{key & IDENTIFIER_MASK:#x} on bus {bus[key >> BUS_SHIFT]} are named like {renamed}"
                )
        unknown = [f"{i:#x}" for i in sorted(self._unknown)]
        if not channels and not self._how.wanted:
            raise UserError(
                f"{self._path}: none of its {len(unknown) + len(self._kept)} identifiers "
                f"({list_names(unknown)}) is in {', '.join(p.name for p in self._databases)}: "
                "the databases describe a different bus"
            )
        if unknown and not self._how.wanted:
            notes.append(f"{len(unknown)} identifiers are in no database: {list_names(unknown)}")
        return channels

    @staticmethod
    def _select_times(
        frames: np.ndarray, time: np.ndarray, keep: np.ndarray | None, place: np.ndarray | None
    ) -> tuple[np.ndarray, np.ndarray | slice]:
        """Return the times [s] of the values of a signal, and an index into its values.

        The values are those of all frames with the signal. values[index] belong to the
        returned times. The index is a mask if some frames are not kept, a permutation if
        the times had to be sorted, else slice(None). `frames`: indices, in the log, of
        the frames with the signal. `time`, `keep`: as in channels(). `place`: for each
        frame of the log, its index in `time` (only valid if the frame is kept); None: all
        frames are kept."""
        if place is not None and keep is not None:
            chosen = keep[frames]
            return time[place[frames[chosen]]], chosen
        own = time[frames]
        if keep is None and (np.diff(own) < 0).any():
            order = np.argsort(own, kind="stable")
            return own[order], order
        return own, slice(None)


def read_messages(databases: Sequence[Path], notes: list[str]) -> dict[int, Any]:
    """Return the messages of all databases. Key: from make_key(). Value: the message.

    If two messages have the same key, the first one is used."""
    messages: dict[int, Any] = {}
    for p in databases:
        for message in read_database(p, notes):
            messages.setdefault(make_key(message.frame_id, message.is_extended_frame), message)
    return messages


MIN_MEASUREMENT_BITS = 8  # a signal with fewer bits is taken as a state, not as a measurement
# names of values that mean "not available"
NO_VALUE = re.compile(
    r"\b(sna|snv|inval\w*|not ?(avail\w*|valid|def\w*|present|init\w*)|no ?(value|data|signal)|n/a|init\w*"
    r"|error|err|fault\w*|failure|fehler\w*|ung(ue|ü)ltig\w*|nicht ?(verf\w*|def\w*)|unbef\w*|undef\w*"
    r"|unknown|unplausi\w*|implaus\w*|reserv\w*)\b",
    re.IGNORECASE,
)


def read_states(s: Any) -> dict[float, str]:
    """Return the names that a database gives to single values: physical value -> name."""
    return {
        float(raw) * float(s.scale) + float(s.offset): str(text) for raw, text in (s.choices or {}).items()
    }


def drop_codes(
    name: str, s: Any, value: np.ndarray, states: dict[float, str], notes: list[str]
) -> np.ndarray:
    """Replace by NaN the values that mean "not available" according to the database."""
    codes = {v: t for v, t in states.items() if NO_VALUE.search(t.replace("_", " "))}
    if s.length < MIN_MEASUREMENT_BITS or not codes:
        return value
    near = 0.25 * abs(float(s.scale))
    bad = np.any([np.abs(value - v) <= near for v in codes], axis=0)
    if not bad.any():
        return value
    said = list_names(dict.fromkeys(t for v, t in codes.items() if (np.abs(value - v) <= near).any()))
    notes.append(f"{name}: {bad.sum()} values that the database calls {said} are treated as missing")
    return np.where(bad, np.nan, value)


def make_key(identifier: Any, extended: Any) -> Any:
    """Return the key of a message, with 0 as index of the bus.

    An identifier of more than 11 bits counts as extended, whatever `extended` is."""
    identifier = identifier & IDENTIFIER_MASK
    return identifier | (extended | (identifier > MAX_STANDARD_IDENTIFIER)) << EXTENDED_SHIFT


def _make_pattern(s: Any) -> tuple[object, ...]:
    """Return a key that is equal for signals that occur in the same frames."""
    return _find_last_byte(s), s.multiplexer_signal, tuple(s.multiplexer_ids or ())


def decode_signals(
    message: Any, signals: Sequence[Any], data: Sequence[bytes]
) -> Iterator[tuple[Any, np.ndarray, np.ndarray]]:
    """Decode the needed signals in frames of a message.

    Parameters
    ----------
    message : cantools.database.can.Message
        The message.
    signals : sequence of cantools.database.can.Signal
        Needed signals of the message.
    data : sequence of bytes, (frames,)
        Data of each frame.

    Yields
    ------
    signal
        One of `signals`. Signals that no frame contains are skipped.
    ndarray of int, (n,)
        Indices in `data` of the n frames that contain the signal.
    ndarray, (n,)
        Physical values of the signal in these frames.
    """
    width = max(message.length, 1)
    long = np.array([len(d) for d in data])
    whole = long >= width
    padded = b"".join(d[:width].ljust(width, b"\0") for d in data)
    table = np.frombuffer(padded, np.uint8).reshape(len(data), width)
    # column 8 b + i: bit i of byte b, where bit 0 is the least significant one
    bits = np.unpackbits(table, axis=1, bitorder="little")
    by_name = {s.name: s for s in message.signals}
    for s in signals:
        rows = whole | (long * 8 > _find_last_byte(s))
        if s.multiplexer_ids and s.multiplexer_signal in by_name:
            selector = _decode_number(by_name[s.multiplexer_signal], bits, raw=True)
            rows = rows & np.isin(selector, s.multiplexer_ids)
        if not rows.any():
            continue
        with contextlib.suppress(ValueError):
            yield s, np.flatnonzero(rows), _decode_number(s, bits if rows.all() else bits[rows])


def _find_bits(s: Any) -> np.ndarray:
    """Return the columns of `bits` in decode_signals() that contain the bits of a signal.

    The first column contains the least significant bit."""
    if s.byte_order == "little_endian":
        return s.start + np.arange(s.length)
    at, found = s.start, []
    for _ in range(s.length):  # Motorola: down to bit 0, then on at bit 7 of the next byte
        found.append(at)
        at = at - 1 if at % 8 else at + 15
    return np.array(found[::-1])


def _find_last_byte(s: Any) -> int:
    """Return the number of bits before the last byte that a signal uses.

    Example: 24 for a signal in bytes 2 and 3, counted from 0. A frame consists of whole
    bytes. So if it has more than 24 bits, it has at least 32, and contains the signal."""
    return int(_find_bits(s).max() // 8 * 8)


def _decode_number(s: Any, bits: np.ndarray, raw: bool = False) -> np.ndarray:
    """Return the value of a signal in each frame. `raw`: do not apply scale and offset.

    Raises
    ------
    ValueError
        The frames are too short for the signal, or it has more than 64 bits.
    """
    at = _find_bits(s)
    if at.max() >= bits.shape[1] or s.length > 64:
        raise ValueError(s.name)
    part = bits[:, at].astype(np.uint64)
    whole = (part << np.arange(s.length, dtype=np.uint64)).sum(axis=1, dtype=np.uint64)
    if s.is_float:
        of_bits = {16: (np.uint16, np.float16), 32: (np.uint32, np.float32), 64: (np.uint64, np.float64)}
        unsigned, real = of_bits[s.length]
        number = whole.astype(unsigned).view(real).astype(float)
    elif s.is_signed:
        number = whole.astype(np.int64).astype(float)
        if s.length < 64:
            number = np.where(part[:, -1] > 0, number - 2.0**s.length, number)
    else:
        number = whole.astype(float)
    return number if raw else number * float(s.scale) + float(s.offset)


FORMAT_NAMES = {"blf": "BLF", "asc": "ASC", "trc": "TRC"}
KIND_NAMES = {
    "asc": "an ASC",
    "trc": "a TRC",
    "candump": "a log of candump",
    "table": "a table of frames",
    "busmaster": "a log of BUSMASTER",
}


def read(path: Path, how: ReadOptions) -> Recording:
    """Read the signals of all messages in the databases, named message.signal."""
    can = import_optional("can", "can", str(path))
    logging.getLogger("can").setLevel(logging.CRITICAL)
    databases = find_databases(path, how, required=True)
    bus, times = Bus(path, databases, how), Growing()
    frames: list[CanFrame] = []

    def decode() -> None:
        check_rows(path, "the bus", len(times) + len(frames), MIN_FRAME_BYTES)
        times.extend(np.array([f.time for f in frames]))
        bus.add(
            np.array([f.identifier for f in frames], np.int64),
            np.array([f.extended for f in frames], bool),
            [f.bus for f in frames],
            [f.data for f in frames],
        )
        frames.clear()

    notes: list[str] = []
    lines = Lines(path)
    with open(path, "rb") as file:
        head = file.read(DETECTION_BYTES)
    kind = "blf" if head.startswith(b"LOGG") else detect_bus_text(head, path.suffix.lower()) or "candump"
    try:
        if kind in ("candump", "table", "busmaster"):
            source = read_frames(path, kind, lines, bus.knows)
        else:
            source = _convert_frames(_make_reader(can, path, kind, lines, notes), lines)
        for frame in source:
            frames.append(frame)
            if len(frames) == CHUNK_ROWS:
                decode()
    except (UserError, MemoryError):
        raise
    except Exception as error:  # a parser may raise any error
        if not frames and not len(times):
            what = KIND_NAMES.get(kind, "a BLF")
            raise UserError(
                f"{path}: cannot be read as {what}: it is damaged, or its format is a different one "
                f"({str(error)[:120]}); copy or record it again"
            ) from None
        notes.append(
            f"the file is damaged after {len(times) + len(frames)} frames ({str(error)[:80]}): "
            "the part before is used"
        )
    if frames:
        decode()
    if not len(times):
        raise UserError(f"{path}: has no frames")
    if lines.odd:
        notes.append(lines.note())
    if lines.errors:
        notes.append(f"{lines.errors} error frames on the bus")
    # repair the times of all frames together, before they are separated by message
    clock, keep, said = straighten_time(times.array(), together=True)
    notes += [f"frames: {s}" for s in said]
    channels = bus.channels(clock, keep, notes)
    return Recording(path, FORMAT_NAMES.get(kind, "CAN log"), channels, notes)


def _convert_frames(reader: Any, lines: Lines) -> Iterator[CanFrame]:
    """Yield the data frames of a reader of python-can; count error frames in `lines`."""
    for m in reader:
        if m.is_error_frame or m.is_remote_frame:
            lines.errors += m.is_error_frame
            continue
        yield CanFrame(m.timestamp, m.arbitration_id, m.is_extended_id, str(m.channel or 0), bytes(m.data))


def _make_reader(can: Any, path: Path, kind: str, lines: Lines, notes: list[str]) -> Any:
    """Return a reader of python-can that skips lines that it cannot parse.

    The numbers of these lines are added to lines.odd."""
    if kind == "blf":
        return can.BLFReader(str(path))

    def skip_odd(parse: Callable[..., Any]) -> Callable[..., Any]:
        def try_parse(*args: Any) -> Any:
            try:
                return parse(*args)
            except (ValueError, IndexError, TypeError):
                lines.odd.append(lines.number)
                return None

        return try_parse

    reader = can.ASCReader(AscText(lines, notes)) if kind == "asc" else can.TRCReader(TrcText(lines))
    for name in ("_process_classic_can_frame", "_process_fd_can_frame", "_parse_line"):
        if hasattr(reader, name):
            setattr(reader, name, skip_odd(getattr(reader, name)))
    return reader
