"""Read MDF 3 and MDF 4 files by asammdf, and decode the bus frames in the files."""

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
    """Read the channels in physical units, and decode the frames of buses.

    Values that the file marks as invalid become NaN."""
    asammdf = import_optional("asammdf", "mf4", str(path))
    logging.getLogger("asammdf").setLevel(logging.CRITICAL)
    notes: list[str] = []
    damage = ""
    _check_chains(path)
    hook = sys.unraisablehook
    sys.unraisablehook = lambda _: None  # suppresses messages of __del__() if the file is damaged
    try:
        with open(path, "rb") as file, asammdf.MDF(file if _is_finished(file) else str(path)) as mdf:
            channels = correct_time_units(_read_channels(path, mdf, how), how, notes)
            channels |= _decode_frames(path, mdf, how, bool(channels), notes)
            version = mdf.version
    except (UserError, MemoryError):
        raise
    except Exception as error:  # a parser may raise any error
        damage = f"{type(error).__name__}: {str(error)[:120]}"
    finally:
        gc.collect()
        sys.unraisablehook = hook
    # Raise only here: an error raised in the except block keeps asammdf's objects alive
    # until the hook is restored, and then their __del__() prints messages
    if damage:
        raise UserError(
            f"{path}: is damaged or cut off: {damage}; its content cannot be read: "
            "copy it again, or repair it by the tool of the recorder"
        )
    return Recording(path, f"MDF {version}", channels, notes)


# An MDF 4 file consists of blocks. Kinds of blocks: data group (DG), channel group (CG),
# channel (CN), list of data blocks (DL), header of a list of DL (HL), file history (FH).
# A link is the position [bytes] of a block. The position 0 means that there is no block.
# The link with index 0 of a block leads to the next block of its list (in an HL: to the
# first DL), other links lead to the first blocks of sublists.
# Kind of a block -> for each checked sublist: index of its link, kinds of its first block
CHILD_BLOCKS = {
    b"##DG": ((1, (b"##CG",)), (2, (b"##DL", b"##HL"))),
    b"##CG": ((1, (b"##CN",)),),
    b"##CN": ((1, (b"##CN",)),),
    b"##FH": (),
    b"##DL": (),
    b"##HL": ((0, (b"##DL",)),),
}
MAX_BLOCKS = 5_000_000  # blocks that _check_chains() visits; a file with more is refused
# A file is damaged if a list of DG, CG or FH begins with a block of a different kind. In
# place of a list of CN, DL or HL, a block of a different kind is allowed, e.g. a single
# data block (DT). Such a block is not checked
LISTED_BLOCKS = (b"##DG", b"##CG", b"##FH")


def _check_chains(path: Path) -> None:
    """Refuse an MDF 4 whose lists of groups, channels or data blocks form a circle.

    asammdf would follow such a list for ever."""
    with open(path, "rb") as file:
        if not file.read(8).startswith((b"MDF     ", b"UnFinMF ")):
            return
        start = _read_links(path, file, 64, b"##HD")
        chains_left = [(b"##DG", at) for at in start[:1]] + [(b"##FH", at) for at in start[1:2]]
        met: set[tuple[bytes, int]] = set()  # (expected kind, position [bytes]) of each visited block
        while chains_left:
            kind, at = chains_left.pop()
            chain: set[int] = set()
            while 0 < at < 1 << 62:
                if at in chain or len(met) > MAX_BLOCKS:
                    raise UserError(
                        f"{path}: is damaged: its list of {kind[2:].decode()} blocks forms a circle "
                        f"at byte {at}, or the file has more than 5 million blocks; copy it again"
                    )
                chain.add(at)
                if (kind, at) in met:
                    break
                met.add((kind, at))
                found = _read_links(path, file, at, kind, kind in LISTED_BLOCKS or len(chain) > 1)
                for link, kinds in CHILD_BLOCKS[kind]:
                    if link < len(found) and found[link]:
                        chains_left += [(k, found[link]) for k in kinds]
                at = found[0] if found and kind != b"##HL" else 0


def _read_links(path: Path, file: BinaryIO, at: int, kind: bytes, required: bool = False) -> list[int]:
    """Return the links of the block at byte `at`, at most the first 8.

    If no block of kind `kind` is there, return [], or raise UserError if `required`. If
    the file ends within the links, return []. A block begins with its kind, its length
    and its number of links."""
    file.seek(at)
    head = file.read(24)
    if len(head) < 24 or head[:4] != kind:
        if required:
            raise UserError(
                f"{path}: is damaged or cut off: there is no {kind[2:].decode()} block at byte {at}; "
                "copy it again"
            )
        return []
    count = min(struct.unpack("<Q", head[16:])[0], 8)
    part = file.read(8 * count)
    return list(struct.unpack(f"<{count}Q", part)) if len(part) == 8 * count else []


def _is_finished(file: BinaryIO) -> bool:
    """Return whether the recorder has finished and closed a file.

    asammdf receives a finished file as an open file: given the path, it would map the
    file into memory, and the pages it reads would count as memory of this process. An
    unfinished file is given by its path, because asammdf copies it and completes the
    copy."""
    finished = file.read(8) == b"MDF     "
    file.seek(0)
    return finished


def _read_channels(path: Path, mdf: Any, how: ReadOptions) -> dict[str, Channel]:
    """Return the channels that the options need, without frames of buses.

    If several channels have the same name, each is named TITLE.NAME, where TITLE is the
    title of its channel group."""
    found: list[tuple[str, str, Channel]] = []
    for g, group in enumerate(mdf.groups):
        check_rows(path, f"channel group {g + 1}", int(getattr(group.channel_group, "cycles_nr", 0)))
        master = mdf.masters_db.get(g)
        time = np.zeros(0)
        head = group.channel_group
        title = getattr(head, "acq_name", None) or getattr(head, "comment", "") or ""
        for c, channel in enumerate(group.channels):
            if c == master or channel.name.startswith("CAN_DataFrame"):
                continue
            if how.wanted and not how.wanted(channel.name):
                continue
            if (signal := _read_samples(mdf, g, c)) is None:
                continue
            value, bad = signal.samples.astype(float), signal.invalidation_bits
            if bad is not None and len(np.atleast_1d(bad)) == len(value):
                value = np.where(np.asarray(bad, bool), np.nan, value)
            if len(time) != len(value):  # at the first channel; all channels of a group share `time`
                time = np.asarray(signal.timestamps, float)
            text = str(signal.comment or "")[:200]
            made = Channel(channel.name, time, value, str(signal.unit or ""), text)
            found.append((channel.name, str(title), made))
    often = Counter(name for name, _, _ in found)
    channels: dict[str, Channel] = {}
    for name, title, c in found:
        full = find_unused_name(f"{title}.{name}" if often[name] > 1 and title else name, channels)
        channels[full] = Channel(full, c.time, c.value, c.unit, c.text)
    return channels


def _read_samples(mdf: Any, group: int, index: int) -> Any | None:
    """Return the samples of a channel in physical units, as a Signal of asammdf.

    If the conversion to physical units gives strings, return the raw numbers. If the raw
    values are not numbers, or there are no samples, return None."""
    for raw in (False, True):
        signal = mdf.get(group=group, index=index, raw=raw, ignore_invalidation_bits=True)
        if len(signal.samples) and signal.samples.dtype.kind in "biuf" and signal.samples.ndim == 1:
            return signal
    return None


def _read_chunks(mdf: Any, group: int, index: int) -> Iterator[Any]:
    """Yield the frames of a channel in Signals of at most CHUNK_ROWS frames."""
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
    """Return the signals in the frames of all buses, sorted by time.

    `others`: True if the file has channels besides the frames. It decides what happens if
    there is no database for the frames. If `others` is True, the frames are skipped,
    because the file is usable without them. If `others` is False, UserError is raised."""
    bus, times = None, Growing()
    for g, group in enumerate(mdf.groups):
        for c, channel in enumerate(group.channels):
            if channel.name != FRAME_CHANNELS[0]:
                continue
            for frame in _read_chunks(mdf, g, c):
                columns = _read_frame_columns(frame.samples)
                if columns is None:
                    break
                if bus is None:
                    databases = find_databases(path, how, required=not others)
                    if not databases:
                        return {}
                    bus = Bus(path, databases, how)
                times.extend(np.asarray(frame.timestamps, float))
                bus.add(*columns)
    return bus.channels(times.array(), None, notes) if bus is not None else {}


def _read_frame_columns(samples: np.ndarray) -> tuple[np.ndarray, np.ndarray, list[str], list[bytes]] | None:
    """Return identifiers, extended flags, buses and data of frames, for Bus.add().

    If the samples are no frames, return None."""
    names = samples.dtype.names or ()
    if not all(n in names for n in FRAME_CHANNELS[1:]):
        return None
    ids = np.asarray(samples[FRAME_CHANNELS[1]], np.int64)
    raw = samples[FRAME_CHANNELS[2]]
    length, extended, bus = np.full(len(raw), raw.shape[1]), ids >> 31 > 0, np.zeros(len(ids), int)
    if "CAN_DataFrame.DataLength" in names:
        length = samples["CAN_DataFrame.DataLength"]
    if "CAN_DataFrame.IDE" in names:
        extended = np.asarray(samples["CAN_DataFrame.IDE"], bool)
    if "CAN_DataFrame.BusChannel" in names:
        bus = samples["CAN_DataFrame.BusChannel"]
    data = [bytes(r[: int(n)]) for r, n in zip(raw, length, strict=True)]
    return ids, extended, [str(b) for b in bus], data
