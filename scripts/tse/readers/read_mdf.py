"""MDF 3 and 4 by asammdf; frames of a bus in them by the databases."""

import gc
import logging
import struct
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from tse.library.errors import UserError
from tse.readers.read_can import Bus, find_databases
from tse.readers.recording import (
    CHUNK_ROWS,
    Channel,
    Growing,
    ReadOptions,
    Recording,
    check_rows,
    find_unused_name,
    import_optional,
)
from tse.readers.table import correct_time_units

FRAME_CHANNELS = ("CAN_DataFrame", "CAN_DataFrame.ID", "CAN_DataFrame.DataBytes")


def read(path: Path, how: ReadOptions) -> Recording:
    """Channels with their conversions; values that are marked invalid are missing. Frames are decoded and their messages named."""
    asammdf = import_optional("asammdf", "mf4", str(path))
    logging.getLogger("asammdf").setLevel(logging.CRITICAL)
    notes: list[str] = []
    damage = ""
    _check_chains(path)
    hook = sys.unraisablehook
    sys.unraisablehook = lambda _: None  # what asammdf drops of a damaged file complains on its way out
    try:
        with open(path, "rb") as file, asammdf.MDF(file if _is_finished(file) else str(path)) as mdf:
            channels = correct_time_units(_read_channels(path, mdf, how), how, notes)
            channels |= _decode_frames(path, mdf, how, bool(channels), notes)
            version = mdf.version
    except (UserError, MemoryError):
        raise
    except Exception as error:  # asammdf's parsers stumble over damage in many ways
        damage = f"{type(error).__name__}: {str(error)[:120]}"
    finally:
        gc.collect()
        sys.unraisablehook = hook
    if damage:  # outside of the above, for an error keeps alive what it was raised beside
        raise UserError(
            f"{path}: is damaged or cut off: {damage}; what an MDF holds is described in blocks all over the file, and some are "
            "missing: copy it again, or have the recorder's own tool repair it"
        )
    return Recording(path, f"MDF {version}", channels, notes)


CHILD_BLOCKS = {
    b"##DG": (b"##CG", b"##DL"),
    b"##CG": (b"##CN",),
    b"##CN": (b"##CN",),
    b"##FH": (),
    b"##DL": (),
    b"##HL": (b"##DL",),
}
MAX_BLOCKS = 5_000_000  # that are followed


def _check_chains(path: Path) -> None:
    """Refuse an MDF 4 whose lists of groups, channels or data lead in a circle: its reader would follow them for ever.

    A block begins with its kind, its length and the number of its links. The first link of those in CHAINS is the next of
    its list."""
    with open(path, "rb") as file:

        def links(at: int, kind: bytes, of_list: bool = False) -> list[int]:
            file.seek(at)
            head = file.read(24)
            if len(head) < 24 or head[:4] != kind:
                if of_list:
                    raise UserError(
                        f"{path}: is damaged or cut off: there is no {kind[2:].decode()} block at byte {at}; copy it again"
                    )
                return []  # data of another kind
            count = min(struct.unpack("<Q", head[16:])[0], 8)
            return (
                list(struct.unpack(f"<{count}Q", part))
                if len(part := file.read(8 * count)) == 8 * count
                else []
            )

        if not file.read(8).startswith((b"MDF     ", b"UnFinMF ")):
            return
        start = links(64, b"##HD")
        todo: list[tuple[bytes, int]] = [(b"##DG", at) for at in start[:1]] + [
            (b"##FH", at) for at in start[1:2]
        ]
        met: set[int] = set()
        while todo:
            kind, at = todo.pop()
            chain: set[int] = set()
            while 0 < at < 1 << 62:
                if at in chain or len(met) > MAX_BLOCKS:
                    raise UserError(
                        f"{path}: is damaged: its list of {kind[2:].decode()} blocks leads in a circle at byte {at}; copy it again"
                    )
                chain.add(at)
                if at in met:
                    break
                met.add(at)
                found = links(at, kind, kind in (b"##DG", b"##CG", b"##FH") or len(chain) > 1)
                for other in found[1:3] if kind == b"##DG" else found[1:2]:
                    todo += [(k, other) for k in CHILD_BLOCKS[kind] if other]
                at = found[0] if found else 0


def _is_finished(file: BinaryIO) -> bool:
    """A file that was closed in order: asammdf reads it as it is. Given its name, it would map it, and all of it stay in memory;
    of one that was not it makes a copy that it completes, and that needs the name."""
    finished = file.read(8) == b"MDF     "
    file.seek(0)
    return finished


def _read_channels(path: Path, mdf: Any, how: ReadOptions) -> dict[str, Channel]:
    found: list[tuple[str, str, Channel]] = []
    for g, group in enumerate(mdf.groups):
        check_rows(path, f"channel group {g + 1}", int(getattr(group.channel_group, "cycles_nr", 0)))
        master = mdf.masters_db.get(g)
        time = np.zeros(0)
        title = (
            getattr(group.channel_group, "acq_name", None)
            or getattr(group.channel_group, "comment", "")
            or ""
        )
        for c, channel in enumerate(group.channels):
            if (
                c == master
                or channel.name.startswith("CAN_DataFrame")
                or (how.wanted and not how.wanted(channel.name))
            ):
                continue
            if (signal := _read_samples(mdf, g, c)) is None:
                continue
            value, bad = signal.samples.astype(float), signal.invalidation_bits
            if bad is not None and len(np.atleast_1d(bad)) == len(value):
                value = np.where(np.asarray(bad, bool), np.nan, value)
            if len(time) != len(value):  # of the group
                time = np.asarray(signal.timestamps, float)
            text = str(signal.comment or "")[:200]
            found.append(
                (channel.name, str(title), Channel(channel.name, time, value, str(signal.unit or ""), text))
            )
    often = Counter(name for name, _, _ in found)
    channels: dict[str, Channel] = {}
    for name, title, c in found:
        full = find_unused_name(f"{title}.{name}" if often[name] > 1 and title else name, channels)
        channels[full] = Channel(full, c.time, c.value, c.unit, c.text)
    return channels


def _read_samples(mdf: Any, group: int, index: int) -> Any | None:
    """A channel as asammdf's Signal of numbers; of a table of texts the numbers below it. None: there are none."""
    for raw in (False, True):
        signal = mdf.get(group=group, index=index, raw=raw, ignore_invalidation_bits=True)
        if len(signal.samples) and signal.samples.dtype.kind in "biuf" and signal.samples.ndim == 1:
            return signal
    return None


def _read_chunks(mdf: Any, group: int, index: int) -> Iterator[Any]:
    """Frames as asammdf's Signals of so many records each, until there are none."""
    done = 0
    while True:
        signal = mdf.get(
            group=group,
            index=index,
            raw=True,
            ignore_invalidation_bits=True,
            record_offset=done,
            record_count=CHUNK_ROWS,
        )
        if not len(signal.samples):
            return
        yield signal
        done += CHUNK_ROWS
        if len(signal.samples) < CHUNK_ROWS:
            return


def _decode_frames(
    path: Path, mdf: Any, how: ReadOptions, others: bool, notes: list[str]
) -> dict[str, Channel]:
    """Signals of the frames of all buses, in order of time. `others`: the file has other channels, too."""
    bus, times = None, Growing()
    for g, group in enumerate(mdf.groups):
        for c, channel in enumerate(group.channels):
            if channel.name != FRAME_CHANNELS[0]:
                continue
            for frame in _read_chunks(mdf, g, c):
                samples = frame.samples
                names = samples.dtype.names or ()
                if not all(n in names for n in FRAME_CHANNELS[1:]):
                    break
                if bus is None:
                    databases = find_databases(path, how, required=not others)
                    if not databases:
                        return {}
                    bus = Bus(path, databases, how)
                raw = samples[FRAME_CHANNELS[2]]
                length = (
                    samples["CAN_DataFrame.DataLength"]
                    if "CAN_DataFrame.DataLength" in names
                    else np.full(len(raw), raw.shape[1])
                )
                data = [bytes(r[: int(n)]) for r, n in zip(raw, length, strict=True)]
                times.extend(np.asarray(frame.timestamps, float))
                ids = np.asarray(samples[FRAME_CHANNELS[1]], np.int64)
                extended = (
                    np.asarray(samples["CAN_DataFrame.IDE"], bool)
                    if "CAN_DataFrame.IDE" in names
                    else ids >> 31 > 0
                )
                channel_ = (
                    samples["CAN_DataFrame.BusChannel"]
                    if "CAN_DataFrame.BusChannel" in names
                    else np.zeros(len(ids), int)
                )
                bus.add(ids, extended, [str(b) for b in channel_], data)
    return bus.channels(times.array(), None, notes) if bus is not None else {}
