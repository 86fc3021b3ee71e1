"""What the picture of each study shows."""

from __future__ import annotations

import numpy as np
import pandas as pd
from scipy import stats

from tselab.core import STIFFNESS
from tselab.montecarlo.case import Drive
from tselab.montecarlo.engine import Plan, trace
from tselab.montecarlo.panels import COLOURS, Bars, Dots, Line, Panel, Picture
from tselab.montecarlo.summary import HEADS, of
from tselab.plots import GREEN, INK, ORANGE

MOST_POINTS = 2000  # of a line
ERROR = "% of the truth"


def picture(plan: Plan, runs: pd.DataFrame, summary: pd.DataFrame) -> Picture:
    """The picture of the study."""
    return (_paper if plan.study.base == "paper" else _dots)(plan, runs, summary)


def _thin(n: int) -> slice:
    return slice(None, None, max(1, -(-n // MOST_POINTS)))


RED = "#c0392b"  # as the paper's figures
TITLES = {"printed": "as printed", "paper": "as printed", "robust": "robust", "tse": "default filter"}


def _paper(plan: Plan, runs: pd.DataFrame, summary: pd.DataFrame) -> Picture:
    """The paper's Fig. 1 .. 4, a column per filter."""
    cases = {c.name: c for c in plan.study.cases}
    waves, lanes = cases.get("iv-a"), cases.get("iv-b-20")
    panels = []
    if waves:
        drawn = {name: trace(plan, waves, plan.first_seed, name) for name in waves.estimators}
        panels += [_fig1(name, *drawn[name]) for name in waves.estimators]
        panels += [_fig2(name, of(runs, waves.name, name)["cy_front_bias_w0"].to_numpy()) for name in waves.estimators]
    if lanes:
        drawn = {name: trace(plan, lanes, plan.first_seed, name) for name in lanes.estimators}
        panels += [_fig3(key, name, *drawn[name]) for key in STIFFNESS for name in lanes.estimators]
        panels += [_fig4(*state, name, *drawn[name]) for state in STATES for name in lanes.estimators]
    return Picture(panels, 3)


STATES = (("vel_x", "vX, m/s", 1.0), ("yaw_rate", "yaw rate, deg/s", 180 / np.pi))


def _fig1(name: str, d: Drive, y: np.ndarray) -> Panel:
    """Normalised longitudinal stiffness and its standard deviation from sample to sample."""
    pick = _thin(len(y))
    t, spread = d.time[pick], y["cx_front_spread"][pick]
    marks = [
        Line(t, d.stiffness[pick, 0], "truth", INK, width=1.0),
        Line(t, y["cx_front"][pick], "stiffness", RED),
        Line(t, d.sim.spread_cx_front * d.stiffness[pick, 0], width=1.0, colour=INK),
    ]
    if d.config.form or name != "tse":
        marks.append(Line(t, spread, "standard deviation", GREEN))
    else:  # the default filter has none: that of the mean instead
        marks.append(Line(t, y["cx_front_sd"][pick], "sd of the mean", GREEN, dash=True))
    return Panel(f"Fig. 1, {TITLES[name]}: Cx", "time, s", "normalised", marks, at=(30.0,), y_range=(0.0, 1.4))


def _fig2(name: str, x: np.ndarray) -> Panel:
    """Probability of the mean error of the front lateral stiffness, with the normal distribution of its mean and sd."""
    n, mean, sd = len(x), x.mean(), max(x.std(ddof=1) if len(x) > 1 else 0.0, 1e-9)
    edges = np.linspace(-4.0, 4.0, 33)
    wide = np.repeat(edges, 2)[1:-1]
    normal = np.diff(stats.norm.cdf(edges, mean, sd))
    return Panel(f"Fig. 2, {TITLES[name]}: Cy front", f"mean error, {ERROR}", "probability", [
        Bars(edges, np.histogram(np.clip(x, -4.0, 4.0), edges)[0] / n, "runs"),
        Line(wide, np.repeat(normal, 2), "normal distribution", ORANGE),
    ])  # fmt: skip


def _fig3(key: str, name: str, d: Drive, y: np.ndarray) -> Panel:
    """Normalised stiffness and its sd, with the prior 20 % too low."""
    pick = _thin(len(y))
    t, mean, sd = d.time[pick], y[key][pick], y[f"{key}_sd"][pick]
    return Panel(f"Fig. 3, {TITLES[name]}: {HEADS[key]}", "time, s", "normalised", [
        Line(t, d.stiffness[pick, STIFFNESS.index(key)], "truth", INK, width=1.0),
        Line(t, mean, "stiffness", RED),
        Line(t, mean - sd, "standard deviation", GREEN, width=1.0), Line(t, mean + sd, colour=GREEN, width=1.0),
    ], y_range=(0.5, 1.5))  # fmt: skip


def _fig4(state: str, label: str, unit: float, name: str, d: Drive, y: np.ndarray) -> Panel:
    """Velocity and yaw rate, estimated and true."""
    pick = _thin(len(y))
    t = d.time[pick]
    return Panel(f"Fig. 4, {TITLES[name]}", "time, s", label, [
        Line(t, unit * d.truth[f"true_{state}"][pick], "truth", INK, width=1.0), Line(t, unit * y[state][pick], "estimate", RED),
    ])  # fmt: skip


def _rms(lines: pd.DataFrame, key: str) -> tuple[np.ndarray, ...]:
    return tuple(lines[f"{key}_rms{end}"].to_numpy(float) for end in ("", "_low", "_high"))


def _share(lines: pd.DataFrame) -> tuple[np.ndarray, ...]:
    low, high = (lines[f"diverged_{end}"].to_numpy(float) for end in ("low", "high"))
    return (100 * lines["diverged"] / lines["runs"]).to_numpy(float), low, high


def _dots(plan: Plan, runs: pd.DataFrame, summary: pd.DataFrame) -> Picture:
    """A line per case, a dot per estimator: RMS error of each stiffness, and divergence."""
    cases = tuple(c.name for c in plan.study.cases)
    names = list(dict.fromkeys(summary["estimator"]))
    panels = [Panel(f"RMS error: {HEADS[key]}", ERROR, "", log_x=True, categories=cases) for key in STIFFNESS]
    panels.append(Panel("Diverged", "% of runs", "", categories=cases))
    for i, (name, colour) in enumerate(zip(names, COLOURS, strict=False)):
        lines = summary[summary["estimator"] == name]
        at = np.array([cases.index(c) for c in lines["case"]]) + 0.6 * ((i + 0.5) / len(names) - 0.5)
        for panel, key in zip(panels, (*STIFFNESS, None), strict=True):
            value, low, high = _share(lines) if key is None else _rms(lines, key)
            panel.marks.append(Dots(at, value, low, high, name if len(names) > 1 else "", colour))
    return Picture(panels, 4, max(200, (16 + 8 * len(names)) * len(cases) + 60))
