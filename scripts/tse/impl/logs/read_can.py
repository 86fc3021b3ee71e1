"""Logs of a CAN bus by python-can: BLF, ASC, TRC, candump; their frames by the databases."""

from __future__ import annotations

import base64
import csv
import itertools
import logging
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from tse.impl.clock import straight
from tse.impl.errors import UserError
from tse.impl.logs.frames import Bus, databases_for
from tse.impl.logs.recording import PIECE, Growing, How, Recording, need

FIRST = 2000  # rows of a table from which its identifiers and times are understood
TITLES = {".blf": "BLF", ".asc": "ASC", ".trc": "TRC"}


IDENTIFIERS = ("id", "arbitration_id", "arbitrationid", "can_id", "canid", "identifier")
HEXADECIMAL = re.compile(r"(0x)?[0-9a-f]+$", re.IGNORECASE)


def _is_table(path: Path) -> bool:
    with open(path, "rb") as file:
        return not file.read(64).lstrip().startswith(b"(")


def _table(path: Path, can: Any, bus: Bus) -> Iterator[Any]:
    """Frames of a CSV with a frame per row: time, identifier, bytes in one column (hexadecimal, or python-can's base 64) or in one
    each. Identifiers are hexadecimal, unless more of them are in the databases as decimal ones. Times are in s, whole numbers in
    us, as SavvyCAN's."""
    with open(path, encoding="utf-8-sig", newline="") as file:
        first = file.readline()
        separator = max(",;\t", key=first.count)
        names = [n.strip().strip("\"'").lower().replace(" ", "_") for n in first.rstrip("\r\n").split(separator)]
        rows = csv.reader(file, delimiter=separator)
        time = next(i for i, n in enumerate(names) if n.startswith("time"))
        ident = next(i for i, n in enumerate(names) if n in IDENTIFIERS)
        one = next((i for i, n in enumerate(names) if n == "data"), None)
        each = [i for i, n in enumerate(names) if re.fullmatch(r"(d|byte_?|data_?)\d", n)]
        length = next((i for i, n in enumerate(names) if n in ("len", "dlc", "length")), None)
        begin = [row for row, _ in zip(rows, range(FIRST), strict=False) if len(row) > max(time, ident)]
        decimal = _decimal({row[ident].strip() for row in begin}, bus)
        whole = all(re.fullmatch(r"\d+", row[time].strip()) for row in begin)
        coded = one is not None and not all(
            HEXADECIMAL.match(row[one].replace(" ", "") or "0") for row in begin if len(row) > one
        )
        for row in itertools.chain(begin, rows):
            if not row:
                continue
            if one is not None:
                data = base64.b64decode(row[one]) if coded else bytes.fromhex(row[one].replace("0x", ""))
            else:
                count = int(row[length]) if length is not None else len(each)
                data = bytes(int(row[i], 16) for i in each[:count] if i < len(row) and row[i].strip())
            stamp = row[time].strip().replace(",", ".")
            yield can.Message(timestamp=1e-6 * int(stamp) if whole else float(stamp),
                              arbitration_id=int(row[ident].strip(), 10 if decimal else 16), data=data, check=False,
                              is_extended_id=True, is_fd=len(data) > 8)  # fmt: skip


def _decimal(ids: set[str], bus: Bus) -> bool:
    if not all(i.isdigit() for i in ids) or any(i.startswith("0") and len(i) > 1 for i in ids):
        return False
    as_decimal, as_hexadecimal = (sum(bus.knows(int(i, base)) for i in ids) for base in (10, 16))
    return as_decimal > as_hexadecimal


def read(path: Path, how: How) -> Recording:
    """Signals of all messages that the databases know, named message.signal."""
    can = need("can", "can", str(path))
    logging.getLogger("can").setLevel(logging.CRITICAL)
    databases = databases_for(path, how, required=True)
    bus, times = Bus(path, databases, how), Growing()
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
    kind = TITLES.get(suffix, "a log of candump")
    try:
        with open(path, "rb") as file:
            blf = file.read(4) == b"LOGG"
        named = TITLES.get(suffix)  # all else that comes here is candump's, whatever its suffix
        table = not blf and not named and _is_table(path)
        kind = "a table of frames" if table else kind
        reader = (
            can.BLFReader(str(path)) if blf else can.LogReader(str(path)) if named
            else _table(path, can, bus) if table else can.CanutilsLogReader(str(path))
        )  # fmt: skip
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
            raise UserError(f"{path}: is damaged, or not {kind} as its maker writes it: {str(error)[:120]}") from None
        notes.append(
            f"the file is damaged after {len(times) + len(time)} frames ({str(error)[:80]}): what is before is used"
        )
    if time:
        decode()
    if not len(times):
        raise UserError(f"{path}: has no frames")
    if errors:
        notes.append(f"{errors} error frames on the bus")
    clock, keep, said = straight(times.array(), together=True)  # one clock for all messages: before they are separated
    notes += [f"frames: {s}" for s in said]
    channels = bus.channels(clock, keep, notes)
    return Recording(path, TITLES.get(suffix, "CAN log"), channels, notes)
