"""Frames of a CAN bus into signals: the bits of all frames of a message at once, as its database (DBC, ARXML, KCD, SYM) says."""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from tselab.errors import UserError
from tselab.logs.extras import need
from tselab.logs.recording import Channel, How, listed

SUFFIXES = (".dbc", ".arxml", ".kcd", ".sym")
EXTENDED = 0x1FFFFFFF


def databases_for(path: Path, how: How, required: bool) -> list[Path]:
    """Those that were named, or all beside the log."""
    if how.databases:
        for p in how.databases:
            if not p.is_file():
                raise UserError(f"{p}: no such file (database of the bus, for {path.name})")
        return list(how.databases)
    found = sorted(p for p in path.parent.iterdir() if p.suffix.lower() in SUFFIXES)
    if not found and required:
        raise UserError(
            f"{path}: holds frames of a bus, and there is no database ({', '.join(SUFFIXES)}) beside it that says what they mean: "
            f"name it "
            'with --database FILE, or in signals.toml: [log] databases = ["car.dbc"]'
        )
    return found


def decode(
    path: Path,
    time: np.ndarray,
    ids: np.ndarray,
    data: Sequence[bytes],
    databases: Sequence[Path],
    how: How,
    notes: list[str],
) -> dict[str, Channel]:
    """Signals by message.signal, s and physical units. `time`, `ids`: (frames,); values that the database calls invalid stay."""
    cantools = need("cantools", "can", str(path))
    logging.getLogger("cantools").setLevel(logging.ERROR)  # two messages of one name are no matter: they go by identifier
    messages: dict[int, Any] = {}
    for p in databases:
        try:
            database = cantools.database.load_file(p, strict=False)
        except Exception as error:  # its parsers raise what they like
            raise UserError(
                f"{p}: is no database of a bus that can be read: {str(error).splitlines()[0][:150]}"
            ) from None
        for message in getattr(database, "messages", []):
            messages.setdefault(message.frame_id & EXTENDED, message)
    if not databases:
        return {}
    channels: dict[str, Channel] = {}
    seen, order = np.unique(ids & EXTENDED), np.argsort(ids & EXTENDED, kind="stable")
    bounds = [*np.searchsorted((ids & EXTENDED)[order], seen).tolist(), len(ids)]
    unknown = []
    for k, identifier in enumerate(seen):
        rows = order[bounds[k] : bounds[k + 1]]
        message = messages.get(int(identifier))
        if message is None:
            unknown.append(f"{identifier:#x}")
            continue
        wanted = [
            s for s in message.signals if not how.wanted or how.wanted(s.name) or how.wanted(f"{message.name}.{s.name}")
        ]
        if wanted:
            for name, at, value, unit, text in _signals(message, wanted, time[rows], [data[i] for i in rows]):
                channels[f"{message.name}.{name}"] = Channel(f"{message.name}.{name}", at, value, unit, text)
    if not channels and not how.wanted:
        raise UserError(
            f"{path}: none of its {len(seen)} identifiers ({listed(unknown)}) is in {', '.join(p.name for p in databases)}: it is "
            f"the "
            "database of another bus"
        )
    if unknown and not how.wanted:
        notes.append(f"{len(unknown)} identifiers are in no database: {listed(unknown)}")
    return channels


def _signals(
    message: Any, signals: Sequence[Any], time: np.ndarray, data: Sequence[bytes]
) -> Iterator[tuple[str, np.ndarray, np.ndarray, str, str]]:
    width = max(message.length, 1)
    long = np.array([len(d) for d in data])
    whole = long >= width
    table = np.frombuffer(b"".join(d[:width].ljust(width, b"\0") for d in data), np.uint8).reshape(len(data), width)
    bits = np.unpackbits(table, axis=1, bitorder="little")  # bit 8 b + i: bit i of byte b, counted from its least
    clocks: dict[bytes, np.ndarray] = {}
    by_name = {s.name: s for s in message.signals}
    for s in signals:
        rows = whole | (long * 8 > _last_bit(s))
        if s.multiplexer_ids and s.multiplexer_signal in by_name:
            selector = _number(by_name[s.multiplexer_signal], bits, raw=True)
            rows = rows & np.isin(selector, s.multiplexer_ids)
        if not rows.any():
            continue
        with contextlib.suppress(ValueError):
            value = _number(s, bits[rows])
            yield s.name, clocks.setdefault(rows.tobytes(), time[rows]), value, s.unit or "", (s.comment or "")[:200]


def _positions(s: Any) -> np.ndarray:
    """Bits of a signal, least first, as unpackbits counts them."""
    if s.byte_order == "little_endian":
        return s.start + np.arange(s.length)
    at, found = s.start, []
    for _ in range(s.length):  # Motorola: from the highest bit down, then the highest of the next byte
        found.append(at)
        at = at - 1 if at % 8 else at + 15
    return np.array(found[::-1])


def _last_bit(s: Any) -> int:
    return int(_positions(s).max() // 8 * 8)


def _number(s: Any, bits: np.ndarray, raw: bool = False) -> np.ndarray:
    """Values of one signal, (frames,)."""
    at = _positions(s)
    if at.max() >= bits.shape[1] or s.length > 64:
        raise ValueError(s.name)
    part = bits[:, at].astype(np.uint64)
    whole = (part << np.arange(s.length, dtype=np.uint64)).sum(axis=1, dtype=np.uint64)
    if s.is_float:
        kind = {16: np.float16, 32: np.float32, 64: np.float64}[s.length]
        number = whole.astype({16: np.uint16, 32: np.uint32, 64: np.uint64}[s.length]).view(kind).astype(float)
    elif s.is_signed:
        number = whole.astype(np.int64).astype(float)
        if s.length < 64:
            number = np.where(part[:, -1] > 0, number - 2.0**s.length, number)
    else:
        number = whole.astype(float)
    return number if raw else number * float(s.scale) + float(s.offset)
