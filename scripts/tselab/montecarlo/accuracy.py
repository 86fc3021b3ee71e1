"""Accuracy study: the paper's Sec. IV-A set-up, many seeds."""

from __future__ import annotations

import contextlib
import functools
import sys
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy import stats
from tqdm import tqdm

from tse.impl import maneuvers
from tse.impl.config import filter_text
from tse.impl.core import STIFFNESS, Config, Filter, SimConfig
from tse.impl.processes import each
from tse.impl.rows import columns
from tse.impl.simulate import simulate
from tse.impl.tables import markdown_table

DURATION, WINDOW = 40.0, (20.0, 40.0)  # s
# Torque is on the front axle in all manoeuvres; the car is that of the paper, (1)-(4).
START = {**{f"initial_{s}": 0.7 for s in STIFFNESS}, "driven_axle": 1, "exact_kinematics_share": 0.0}
DIVERGED_ERROR, DIVERGED_FOR, DIVERGED_AFTER = 0.20, 2.0, 10.0  # share of the mean stiffness, s, s


@dataclass
class Accuracy:
    """One row per run, and the settings they shared."""

    runs: pd.DataFrame
    config: Config

    @property
    def diverged(self) -> int:
        return int(self.runs["diverged"].sum())


def one_run(seed: int, settings: Mapping[str, float], sim_settings: Mapping[str, float]) -> dict[str, float]:
    """Simulate with a seed, estimate with the same seed, compare."""
    config = Config({**START, **settings, "seed": seed})
    sim_config = SimConfig({**sim_settings, "seed": seed})
    maneuver = maneuvers.build("square-waves", config, sample_time=config.sample_time, duration=DURATION)
    simulation = simulate(maneuver, config, sim_config)
    filter_ = Filter(config)
    rows, outputs = filter_.inputs(len(maneuver.time)), filter_.outputs(len(maneuver.time))
    rows["dt"] = config.sample_time
    for name in columns()[1:]:
        rows[name] = simulation.log[name]
    filter_.step_into(rows, outputs)

    time = maneuver.time
    window = (time >= WINDOW[0]) & (time <= WINDOW[1])
    result: dict[str, float] = {"seed": seed}
    diverged = 0.0
    for key in STIFFNESS:
        truth = getattr(sim_config, f"true_{key}")
        error = outputs[key].astype(float) / truth - 1
        sd = outputs[f"{key}_sd"].astype(float) / truth
        result[f"{key}_mean_error"] = 100 * error[window].mean()
        result[f"{key}_mean_square"] = 1e4 * np.mean(error[window] ** 2)
        result[f"{key}_covered"] = 100 * np.mean(np.abs(error[window]) <= 1.96 * sd[window])
        result[f"{key}_spread"] = 100 * outputs[f"{key}_spread"][window].astype(float).mean() / truth
        late = ~(np.abs(error[time >= DIVERGED_AFTER]) <= DIVERGED_ERROR)
        diverged = max(diverged, _longest(late) * config.sample_time)
    result["diverged"] = int(diverged > DIVERGED_FOR)
    result["recoveries"] = int((outputs["status"] == filter_.lib.status("TSE_W_RECOVERED")).sum())
    return result


def accuracy(
    runs: int,
    jobs: int,
    settings: Mapping[str, float],
    sim_settings: Mapping[str, float],
    first_seed: int = 1,
    progress: bool = False,
) -> Accuracy:
    """All runs, in `jobs` processes."""
    seeds = range(first_seed, first_seed + runs)
    config = Config({**START, **settings})
    results = []
    with tqdm(total=runs, unit="run", disable=not progress, file=sys.stderr, leave=False, desc="accuracy") as bar:
        do = functools.partial(one_run, settings=dict(settings), sim_settings=dict(sim_settings))
        with contextlib.closing(each(do, seeds, jobs)) as done:
            for _, result in done:
                results.append(result())
                bar.update()
    return Accuracy(pd.DataFrame(results).sort_values("seed", ignore_index=True), config)


def markdown(study: Accuracy) -> str:
    """The result as a Markdown table with what is needed to repeat it."""
    runs, n = study.runs, len(study.runs)
    heads = {"cx_front": "Cx front", "cy_front": "Cy front", "cy_rear": "Cy rear"}
    rows = [
        ("RMS error", [f"{np.sqrt(runs[f'{k}_mean_square'].mean()):.2f}" for k in STIFFNESS]),
        ("RMS error, median run", [f"{np.sqrt(runs[f'{k}_mean_square'].median()):.2f}" for k in STIFFNESS]),
        ("mean error over all runs (95 % interval)", [_interval(runs[f"{k}_mean_error"]) for k in STIFFNESS]),
        ("absolute mean error, mean of the runs", [f"{runs[f'{k}_mean_error'].abs().mean():.2f}" for k in STIFFNESS]),
        ("95 % interval holds the truth", [f"{runs[f'{k}_covered'].mean():.0f}" for k in STIFFNESS]),
    ]  # fmt: skip
    if study.config.form:
        rows.append(("spread estimated", [f"{runs[f'{k}_spread'].mean():.1f}" for k in STIFFNESS]))
    low, high = clopper_pearson(study.diverged, n)
    seeds = f"{runs['seed'].min()} .. {runs['seed'].max()}"
    lines = [
        f"Square waves, {n} runs (seeds {seeds}), {filter_text(study.config)}, start at 70 %; "
        f"{WINDOW[0]:g} .. {WINDOW[1]:g} s, in % of the true mean stiffness.",
        "",
        *markdown_table(["", *heads.values()], ([name, *cells] for name, cells in rows)),
        "",
        f"Diverged: {study.diverged} of {n} (95 % interval {100 * low:.1f} .. {100 * high:.1f} %). "
        f"Recoveries: {int(runs['recoveries'].sum())}.",
    ]
    return "\n".join(lines)


def clopper_pearson(k: int, n: int, level: float = 0.95) -> tuple[float, float]:
    """Exact interval of a share."""
    interval = stats.binomtest(k, n).proportion_ci(level, method="exact")
    return float(interval.low), float(interval.high)


def _interval(x: pd.Series) -> str:
    if len(x) < 2:
        return f"{x.mean():+.2f}"
    half = stats.t.ppf(0.975, len(x) - 1) * x.std() / np.sqrt(len(x))
    return f"{x.mean():+.2f} ± {half:.2f}"


def _longest(flags: np.ndarray) -> int:
    """Length of the longest run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(int), [0]])))
    return int((edges[1::2] - edges[::2]).max(initial=0))
