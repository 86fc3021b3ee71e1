"""`tselab gap selftest`: an effect hidden in the user's own inputs, and looked for as if it were not known."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from tse.impl.core import similar
from tse.impl.errors import UserError
from tse.impl.estimate import write_table
from tse.impl.gap import workflow
from tse.impl.gap.catalogue import catalogue
from tse.impl.gap.data import Prepared, prepare_all
from tse.impl.gap.plan import typical
from tse.impl.gap.problem import Problem
from tse.impl.gap.simulate import simulate
from tse.impl.rows import MEASURES, Log, Reading
from tse.impl.vehicle import read_vehicle


@dataclass(frozen=True)
class Selftest:
    """How it ended."""

    found: bool
    words: list[str]
    result: workflow.Result
    logs: list[Path]


def selftest(
    logs: Sequence[Path],
    vehicle_path: Path,
    effect: str,
    size: float,
    out: Path,
    seed: int = 1,
    jobs: int = 1,
    say: Callable[[str], None] = lambda _: None,
    reading: Reading | None = None,
) -> Selftest:
    """Make logs, run the workflow on them, compare."""
    known = catalogue()
    if effect not in known:
        raise UserError(f"option --hide: there is no effect '{effect}'{similar(effect, known)}".split(";")[0])
    if size == 0:
        raise UserError("option --size: 0 hides nothing")
    e = known[effect]
    say("reading the logs")
    read, config = workflow.read(logs, read_vehicle(vehicle_path), reading)
    prepared = prepare_all(read, config)
    problem = Problem(prepared, config, jobs)
    if not problem.logs:
        raise UserError("; ".join(n for p in prepared for n in p.notes) or "no log can be used")
    values = typical(problem, e, size)
    made = make(problem, read, values, out, seed)
    result = workflow.run(made, vehicle_path, (), jobs, say)

    sizes = {p.name: values[p.name] for p in e.strengths if p.name in values}
    hidden = (
        ", ".join(f"{p.key} {sizes[p.name]:.3g} {p.unit}" for p in e.strengths if p.name in sizes) or "a road's profile"
    )
    words = [f"Hidden: {e.title} ({e.id}), {hidden}, in {len(made)} log{'s' if len(made) > 1 else ''}."]
    named = {n.effect.id: n for n in result.naming.named}
    alike = [n.effect.id for n in named.values() if e.id in n.look_alikes]
    if e.id in named:
        n = named[e.id]
        back = ", ".join(f"{p.key} {n.values[p.name]:.3g} {p.unit} (95 %: {n.ci95[p.name][0]:.3g} .. {n.ci95[p.name][1]:.3g})"
                         for p in e.strengths if p.name in n.values)  # fmt: skip
        words.append(f"Found again: {back}.")
    elif alike:
        words.append(f"Found as a look-alike of {', '.join(alike)}: these logs cannot tell them apart.")
    else:
        words.append("Not found.")
        words += _why(result, e.id)
    if extra := sorted(set(named) - {e.id} - set(alike)):
        words.append(f"Named besides: {', '.join(extra)}.")
    return Selftest(e.id in named or bool(alike), words, result, made)


def _why(result: workflow.Result, effect: str) -> list[str]:
    """What the workflow says of an effect that it did not find."""
    words = list(result.words)
    for d in result.detectable:
        if d.id == effect and not d.visible:
            size = (
                f"from {d.parameter} = {d.smallest:.2g} {d.unit} on"
                if np.isfinite(d.smallest)
                else "at no size that there is"
            )
            words.append(f"These logs would show it {size}.")
    mine = [p for p in result.naming.possible if p["id"] == effect]
    words += [f"Its probability is {100 * p['probability']:.0f} %: {p['why']}." for p in mine]
    return words


def make(problem: Problem, read: Sequence[Log], values: dict[str, float], out: Path, seed: int) -> list[Path]:
    """The logs: steering and wheel speeds as they were logged, the rest simulated from what is smooth of them, with the noise and
    a bias of the vehicle file's sensors. Where the workflow cannot simulate, cells are empty."""
    rng = np.random.default_rng(seed)
    by_path = {log.path: log for log in read}
    paths = []
    for i, log in enumerate(problem.logs):
        raw = by_path[log.path]
        columns = {"time": log.time} | {k: raw.data[k].to_numpy(float) for k in log.inputs}
        columns |= measurements(problem, i, log, values, rng)
        path = out / f"selftest_{i + 1}_{log.name}.csv"
        write_table(pd.DataFrame(columns), path)
        paths.append(path)
    return paths


def measurements(
    problem: Problem, i: int, log: Prepared, values: dict[str, float], rng: np.random.Generator
) -> dict[str, np.ndarray]:
    """What the sensors would read."""
    config = problem.model(values)
    stiffness, profiles = problem.stiffness(values, i), problem.profiles(values, i)
    simulated = simulate(config, log, log.channels, stiffness, profiles, problem.later(values))
    found = {}
    for c, x in simulated.items():
        sd = getattr(config, f"{c}_sd") if c in MEASURES else log.noise[c]
        bias = getattr(config, f"{c}_bias_sd") * rng.standard_normal() if c in MEASURES else 0.0
        found[c] = np.where(np.isfinite(log.measured[c]), x + bias + sd * rng.standard_normal(len(x)), np.nan)
    return found
