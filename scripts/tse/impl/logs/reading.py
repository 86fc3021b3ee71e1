"""Any log into rows of the library: reader, mapping, raster, check."""

from __future__ import annotations

import shlex
from collections.abc import Collection
from dataclasses import replace
from pathlib import Path

import numpy as np

from tse.impl.errors import UserError
from tse.impl.logs.mapping import Series, series
from tse.impl.logs.raster import on_raster
from tse.impl.logs.readers import read_recording
from tse.impl.logs.recording import How, Recording, listed
from tse.impl.logs.signals import FASTEST, SLOWEST, Signal, Signals, known_channels, read_signals
from tse.impl.room import Room
from tse.impl.rows import MEASURES, OPTIONAL, SIDES, Log, Reading, Slower, beside_of, checked, columns

NEEDED = ("steer_angle", "wheel_speed_front", "wheel_speed_rear")


def read_any(path: Path, spare: Collection[str], reading: Reading) -> Log:
    """A log of any format. UserError: what is missing, and what helps."""
    if reading.rate is not None and not SLOWEST <= reading.rate <= FASTEST:
        raise UserError(f"option --rate: {reading.rate:g} is outside its range {SLOWEST:g} .. {FASTEST:g} Hz")
    file = reading.signals or beside_of(path)
    signals = read_signals(file) if file is not None else None
    how = signals.how if signals is not None else How()
    how = replace(how, databases=(*reading.databases, *how.databases))
    recording = read_recording(path, replace(how, wanted=signals.wants) if signals is not None else how)
    if signals is not None and not all(recording.has(n) for s in signals.signals.values() for n in s.name):
        recording = read_recording(path, how)  # with all names, to say which is meant
    if reading.signals is None and (
        signals is None or not any(recording.has(n) for s in signals.signals.values() for n in s.name)
    ):
        own = by_own_names(recording)
        if own is None and signals is None:
            raise UserError(_unnamed(path, recording))
        signals = own or signals
    notes = list(recording.notes)
    if signals.path is not None:
        notes.append(f"signals by {signals.path}")
    found = series(recording, signals, reading.car, notes)
    _speed_for_wheels(path, found, reading, notes)
    room = recording.room
    del recording  # what is not asked for need not stay
    rows = on_raster(found, reading.rate or signals.rate, room)
    notes += rows.notes
    line = room.keep(np.arange(1, len(rows.time) + 1))
    log = checked(path, rows.time, dict(rows.value), line, notes, spare, place="row", room=room)
    guessed = [f"{s.channel} ({s.unsure})" for s in signals.signals.values() if s.unsure]
    if guessed:
        log.warnings.append(
            f"guessed, and believed: {'; '.join(guessed)}: look at {signals.path}, and take the key unsure out"
        )
        log.notes.insert(0, log.warnings[-1])
    log.slower = _slower(rows.native, rows.rate, room)
    log.let_go()
    return log


def _speed_for_wheels(path: Path, found: dict[str, Series], reading: Reading, notes: list[str]) -> None:
    """A log without any wheel speed: they roll as the car goes, and tell no slip."""
    if "vehicle_speed" not in found or any(c.startswith("wheel_speed") for c in found):
        return
    if reading.car is None:
        raise UserError(
            f"{path}: has no wheel speeds; for vehicle_speed to stand in, the radius of the wheels is needed: --vehicle CAR.toml"
        )
    speed = found["vehicle_speed"]
    found["wheel_speed_front"] = replace(
        speed, channel="wheel_speed_front", value=speed.value / reading.car.values["wheel_radius_front"]
    )
    notes.append("no wheel speed is in the log: vehicle_speed stands in for them")


def by_own_names(recording: Recording) -> Signals | None:
    """A log whose channels have the library's names, in whatever format; None where it does not."""
    names = [n for n in known_channels() if recording.has(n)]
    names += [c.name for c in recording if c.short.startswith("ref_") and c.name not in names]
    full = all(n in names or all(s in names for s in SIDES.get(n, ("-",))) for n in NEEDED[:1]) and any(
        n in names or all(s in names for s in SIDES[n]) for n in NEEDED[1:]
    )
    if not full:
        return None
    whole = {n: Signal(n if n in known_channels() else recording.find(n, "").short, (n,)) for n in names}
    sided = {s for axle, pair in SIDES.items() if axle in names for s in pair}
    return Signals(None, {s.channel: s for s in whole.values() if s.channel not in sided})


def _slower(native: dict[str, tuple[np.ndarray, np.ndarray, float]], rate: float, room: Room) -> dict[str, Slower]:
    """By channel; of an axle that of its wheels."""
    found = {n: Slower(t, x, rate / own) for n, (t, x, own) in native.items()}
    for axle, pair in SIDES.items():
        if axle not in found and all(s in found for s in pair):
            left, right = (found.pop(s) for s in pair)
            mean = 0.5 * (left.value + np.interp(left.time, right.time, right.value))
            found[axle] = Slower(left.time, room.keep(mean), left.rows)
    return {n: s for n, s in found.items() if n in {*columns(), *MEASURES} and n not in OPTIONAL}


def _unnamed(path: Path, recording: Recording) -> str:
    own = [n for n in known_channels() if recording.has(n)]
    missing = [n for n in NEEDED if n not in own and not all(s in own for s in SIDES.get(n, ("-",)))]
    has = f"; of tse's names it has {listed(own)}, not {listed(missing)}" if own else ""
    name = shlex.quote(path.name)
    return (
        f"{path}: a file must say which of its {len(recording.channels)} signals are which "
        f"({listed(c.name for c in recording)}){has}\n"
        f"  'tselab signals {name} --write signals.toml' proposes one; beside the log, or with --signals, it is used"
    )
