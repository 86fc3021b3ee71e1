"""Propose a signals.toml for a log, and format the proposal as text, table or TOML."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tse.channels.candidates import find_nearest_candidates
from tse.channels.group_clocks import align_clocks
from tse.channels.guesses import make_guesses
from tse.channels.look import Guess, Look, Proposal, find_companions, warn_of_counting_wheels
from tse.channels.mapping import Series
from tse.channels.raster import find_rate, select_entries
from tse.channels.scales import find_units
from tse.channels.velocities import find_velocities
from tse.channels.wheels import compute_speed, find_pedals, find_roles, find_sides, find_speed, find_wheels
from tse.log.clock import straighten_time
from tse.log.units import is_unknown_unit
from tse.readers.recording import Channel, ReadOptions, Recording, list_names


@dataclass(frozen=True)
class Line:
    """One signal in the list of all signals of a log."""

    name: str
    unit: str
    rate: float  # [Hz] new values per second
    low: float  # min value
    high: float  # max value
    missing: float  # [1] share of missing values
    used: str  # channel for which the signal is proposed; "": none


def list_signals(recording: Recording, proposal: Proposal) -> list[Line]:
    """Return a Line for each signal, in the order of the file."""
    used = {n: g.channel for g in proposal.guesses for n in g.name}
    return [_describe_signal(c, used.get(c.name, "")) for c in recording]


def _describe_signal(c: Channel, used: str) -> Line:
    """Return the Line of a signal. `used`: channel for which it is proposed; "": none."""
    there = np.isfinite(c.value)
    time, keep, _ = straighten_time(c.time)
    rate = find_rate(select_entries(Series(c.name, time, c.value[keep]))[0]) if there.sum() > 2 else 0.0
    low, high = (
        (float(np.min(c.value[there])), float(np.max(c.value[there]))) if there.any() else (np.nan, np.nan)
    )
    return Line(c.name, c.unit, rate, low, high, float(1 - there.mean()) if len(there) else 1.0, used)


def format_headline(g: Guess) -> str:
    """Return a guess as a string of one line."""
    more = (
        [f"{g.unit} ({g.unit_from})"]
        + (["sign -1"] if g.sign < 0 else [])
        + ([f"ratio {g.ratio:g}"] if g.ratio else [])
    )
    more += [f"latency {1e3 * g.latency:.0f} ms"] if g.latency else []
    more += [f"its clock is {g.clock:+g} s ahead"] if g.clock else []
    more += [f"on above {g.above:g}"] if g.above is not None else []
    more += [f"and {g.add}"] if g.add else []
    more += [f"valid if {g.valid[0]} is {g.valid[1]:g}"] if g.valid else []
    more += [f"counter {g.counter[0]}"] if g.counter else []
    return f"{g.channel} = {' and '.join(g.name)}: {', '.join(more)}; {g.confidence}"


def format_signals(
    recording: Recording, proposal: Proposal, how: ReadOptions | None = None, folder: Path = Path()
) -> str:
    """Return the proposal as a signals.toml, with the evidence as comments.

    `how`: options with which the log was read; they are written to the table [log].
    `folder`: paths of databases inside this folder are written relative to it."""
    lines = [
        f"# Proposed by tselab signals for {recording.path.name}: guesses, each with its evidence. "
        "Check and correct them."
    ]
    lines += [f"# warning: {w}" for w in proposal.warnings]
    said = {k: v for k, v in vars(how or ReadOptions()).items() if v and k != "wanted"}
    if "databases" in said:
        said["databases"] = [_make_relative(p, folder) for p in said["databases"]]
    lines += (
        ["", "[log]", *(f"{k} = {json.dumps(v, ensure_ascii=False)}" for k, v in said.items())]
        if said
        else []
    )
    for g in proposal.guesses:
        name = json.dumps(list(g.name) if len(g.name) > 1 else g.name[0], ensure_ascii=False)
        lines += [
            "",
            f"[signals.{g.channel}]  # {g.confidence}",
            *(f"# {f}" for f in g.figures),
            f"name = {name}",
        ]
        lines.append(f"unit = {json.dumps(g.unit, ensure_ascii=False)}  # {g.unit_from}")
        unsure = _quote_string(", ".join(g.unsure))
        more = {
            "sign": "-1" if g.sign < 0 else "",
            "add": _quote_string(g.add),
            "sign_bit": _quote_string(g.sign_bit),
            "ratio": f"{g.ratio:g}" if g.ratio else "",
            "latency": f"{g.latency:g}" if g.latency else "",
            "clock": f"{g.clock:.12g}" if g.clock else "",
            "above": "" if g.above is None else f"{g.above:g}",
            "valid": f"{{name = {_quote_string(g.valid[0])}, is = [{g.valid[1]:g}]}}" if g.valid else "",
            "counter": f"{{name = {_quote_string(g.counter[0])}, modulo = {g.counter[1]}}}"
            if g.counter
            else "",
            "unsure": f"{unsure}  # after you have checked it, delete this line" if g.unsure else "",
        }
        lines += [f"{key} = {value}" for key, value in more.items() if value]
    for channel in proposal.missing:
        lines += ["", f"# [signals.{channel}]", *(f"# {x}" for x in proposal.nearest.get(channel, ()))]
        lines += ['# name = "..."  # not found; if left out, the channel is missing']
    return "\n".join(lines) + "\n"


def _warn_of_strange_units(recording: Recording, guesses: list[Guess]) -> list[str]:
    """Return a warning for each unknown unit of a proposed signal."""
    found: dict[tuple[str, str], list[str]] = {}
    for g in guesses:
        for n in g.name:
            if is_unknown_unit(unit := recording.channels[n].unit):
                found.setdefault((unit, g.unit), []).append(n)
    return [
        f"the unit {unit!r} of {list_names(names)} is unknown: {own} is proposed, from the size of its "
        "values; check it"
        for (unit, own), names in found.items()
    ]


def _quote_string(text: str | None) -> str:
    """Return `text` in quotes for TOML, escaped as in JSON. If `text` is None or empty,
    return an empty string without quotes."""
    return json.dumps(text, ensure_ascii=False) if text else ""


def _make_relative(path: Path, folder: Path) -> str:
    """Return the path relative to the folder if it is inside, otherwise absolute."""
    path = path.resolve()
    try:
        return path.relative_to(folder.resolve()).as_posix()
    except ValueError:
        return path.as_posix()


# ---- The proposal.
#
# A role is a quantity that a signal may measure. The score of a signal for a role is the
# sum of three scores: of its name (vocabulary.py), of its unit, and of its agreement with
# the other channels (physics.py). Since the other channels are not known either, the
# agreement is computed in ROLE_PASSES passes. Each pass compares the signals with the
# signals that the pass before has chosen.

__all__ = ["Guess", "Proposal", "propose"]
ROLE_PASSES = 3


def propose(recording: Recording, car: Any | None = None) -> Proposal:
    """Propose a signal of the recording for each channel.

    `car`: a Vehicle. If given, its wheel radii, wheelbase and steering ratio are used
    instead of those of an average car."""
    warnings: list[str] = []
    recording, moved = align_clocks(recording, warnings)
    look = Look(recording)
    wheels = find_wheels(look) or find_speed(look)
    chosen: dict[str, str] = {}
    worth: dict[str, dict[str, float]] = {}
    for _ in range(ROLE_PASSES):
        raw, before = compute_speed(look, wheels), (chosen, wheels)
        chosen, worth = find_roles(look, wheels, raw, chosen)
        if raw is None:
            break
        wheels = find_sides(look, wheels, chosen)
        if (chosen, wheels) == before:  # converged
            break
    scale = find_units(look, wheels, chosen, car, warnings)
    guesses = make_guesses(look, wheels, chosen, worth, scale, car, warnings)
    for g in guesses:
        if len(g.name) == 1 and g.name[0] in look.sign_bit:
            g.sign_bit = look.sign_bit[g.name[0]]
            g.figures.append(f"its sign is the bit {g.sign_bit}, which changes while its value is about 0")
    raw = compute_speed(look, wheels)
    v = None if raw is None else raw * scale.per["wheel"]
    guesses += find_velocities(look, guesses, v, recording.format)
    guesses += find_pedals(recording, look, v)
    find_companions(recording, guesses)
    warnings += _warn_of_strange_units(recording, guesses)
    warnings += warn_of_counting_wheels(recording) if not wheels else []
    for g in guesses:
        g.clock = round(moved.get(g.name[0], 0.0), 2)
    have = {g.channel for g in guesses}
    missing = [
        c
        for c in ("steer_angle", "wheel_speed_front", "wheel_speed_rear", "accel_x", "accel_y", "yaw_rate")
        if c not in have
    ]
    return Proposal(guesses, warnings, missing, find_nearest_candidates(recording, look, guesses, missing, v))
