"""Logs of a CAN bus by python-can: BLF, ASC, TRC, candump; their frames by the databases."""

from __future__ import annotations

import logging
from pathlib import Path

import numpy as np

from tselab.errors import UserError
from tselab.logs.clock import straight
from tselab.logs.extras import need
from tselab.logs.frames import Bus, databases_for
from tselab.logs.recording import How, Recording
from tselab.room import PIECE, Room

TITLES = {".blf": "BLF", ".asc": "ASC", ".trc": "TRC"}


def read(path: Path, how: How) -> Recording:
    """Signals of all messages that the databases know, named message.signal."""
    can = need("can", "can", str(path))
    logging.getLogger("can").setLevel(logging.CRITICAL)
    databases = databases_for(path, how, required=True)
    room = Room()
    bus, times = Bus(path, databases, how, room), room.growing()
    time: list[float] = []
    ids: list[int] = []
    data: list[bytes] = []

    def decode() -> None:
        times.extend(np.array(time))
        bus.add(np.array(ids, np.int64), data)
        for each in (time, ids, data):
            each.clear()

    notes: list[str] = []
    errors = 0
    suffix = path.suffix.lower()
    try:
        with open(path, "rb") as file:
            blf = file.read(4) == b"LOGG"
        named = TITLES.get(suffix)  # all else that comes here is candump's, whatever its suffix
        reader = can.BLFReader(str(path)) if blf else can.LogReader(str(path)) if named else can.CanutilsLogReader(str(path))
        for message in reader:
            if message.is_error_frame or message.is_remote_frame:
                errors += message.is_error_frame
                continue
            time.append(message.timestamp)
            ids.append(message.arbitration_id)
            data.append(bytes(message.data))
            if len(time) == PIECE:
                decode()
    except Exception as error:  # its parsers stumble over damage in many ways
        if not time and not len(times):
            raise UserError(
                f"{path}: is damaged, or not {TITLES.get(suffix, 'a log of candump')} as its maker writes it: {str(error)[:120]}"
            ) from None
        notes.append(f"the file is damaged after {len(times) + len(time)} frames ({str(error)[:80]}): what is before is used")
    if time:
        decode()
    if not len(times):
        raise UserError(f"{path}: has no frames")
    if errors:
        notes.append(f"{errors} error frames on the bus")
    clock, keep, said = straight(times.array(), together=True)  # one clock for all messages: before they are told apart
    notes += [f"frames: {s}" for s in said]
    clock = room.keep(clock)
    channels = bus.channels(clock, keep, notes)
    return Recording(path, TITLES.get(suffix, "CAN log"), channels, notes, room=room)
