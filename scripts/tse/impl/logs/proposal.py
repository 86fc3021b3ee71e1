"""A proposal in words, as a table, and as signals.toml."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tse.impl.clock import straight
from tse.impl.logs.look import Guess, Proposal
from tse.impl.logs.mapping import Series
from tse.impl.logs.raster import entries, rate_of
from tse.impl.logs.recording import Channel, Recording


@dataclass(frozen=True)
class Line:
    """What the list says of one signal."""

    name: str
    unit: str
    rate: float  # Hz of new values
    low: float
    high: float
    missing: float  # share
    used: str  # channel it is proposed for


def listing(recording: Recording, proposal: Proposal) -> list[Line]:
    """A line per signal, in the order of the file."""
    used = {n: g.channel for g in proposal.guesses for n in g.name}
    return [_line(c, used.get(c.name, "")) for c in recording]


def _line(c: Channel, used: str) -> Line:
    there = np.isfinite(c.value)
    time, keep, _ = straight(c.time)
    rate = rate_of(entries(Series(c.name, time, c.value[keep]))[0]) if there.sum() > 2 else 0.0
    low, high = (float(np.min(c.value[there])), float(np.max(c.value[there]))) if there.any() else (np.nan, np.nan)
    return Line(c.name, c.unit, rate, low, high, float(1 - there.mean()) if len(there) else 1.0, used)


def headline(g: Guess) -> str:
    """Return a guess in a line."""
    more = (
        [f"{g.unit} ({g.unit_from})"]
        + (["sign -1"] if g.sign < 0 else [])
        + ([f"ratio {g.ratio:g}"] if g.ratio else [])
    )
    more += [f"latency {1e3 * g.latency:.0f} ms"] if g.latency else []
    more += [f"on above {g.above:g}"] if g.above is not None else []
    more += [f"and {g.add}"] if g.add else []
    more += [f"valid where {g.valid[0]} is {g.valid[1]:g}"] if g.valid else []
    more += [f"counter {g.counter[0]}"] if g.counter else []
    return f"{g.channel} = {' and '.join(g.name)}: {', '.join(more)}; {g.confidence}"


def toml_text(recording: Recording, proposal: Proposal, databases: tuple[Path, ...] = (), folder: Path = Path()) -> str:
    """signals.toml, with what speaks for each guess as comments."""
    lines = [
        f"# Proposed by tselab signals for {recording.path.name}: guesses, each with what speaks for it. Look through, and edit."
    ]
    lines += [f"# warning: {w}" for w in proposal.warnings]
    if databases:
        lines += [
            "",
            "[log]",
            f"databases = {json.dumps([_relative(p, folder) for p in databases], ensure_ascii=False)}",
        ]
    for g in proposal.guesses:
        name = json.dumps(list(g.name) if len(g.name) > 1 else g.name[0], ensure_ascii=False)
        lines += ["", f"[signals.{g.channel}]  # {g.confidence}", *(f"# {f}" for f in g.figures), f"name = {name}"]
        lines.append(f"unit = {json.dumps(g.unit, ensure_ascii=False)}  # {g.unit_from}")
        if g.sign < 0:
            lines.append("sign = -1")
        if g.add:
            lines.append(f"add = {json.dumps(g.add, ensure_ascii=False)}")
        if g.sign_bit:
            lines.append(f"sign_bit = {json.dumps(g.sign_bit, ensure_ascii=False)}")
        if g.ratio:
            lines.append(f"ratio = {g.ratio:g}")
        if g.latency:
            lines.append(f"latency = {g.latency:g}")
        if g.above is not None:
            lines.append(f"above = {g.above:g}")
        if g.valid:
            lines.append(f"valid = {{name = {json.dumps(g.valid[0], ensure_ascii=False)}, is = [{g.valid[1]:g}]}}")
        if g.counter:
            lines.append(
                f"counter = {{name = {json.dumps(g.counter[0], ensure_ascii=False)}, modulo = {g.counter[1]}}}"
            )
        if g.unsure:
            what = json.dumps(", ".join(g.unsure), ensure_ascii=False)
            lines.append(f"unsure = {what}  # when you have looked, take this line out")
    for channel in proposal.missing:
        lines += ["", f"# [signals.{channel}]", '# name = "..."  # not found; left out, it is used as missing']
    return "\n".join(lines) + "\n"


def _relative(path: Path, folder: Path) -> str:
    path = path.resolve()
    try:
        return path.relative_to(folder.resolve()).as_posix()
    except ValueError:
        return path.as_posix()
