"""What the picture of each study shows."""

from __future__ import annotations

import numpy as np
import pandas as pd
from scipy import stats

from tselab.core import STIFFNESS
from tselab.montecarlo.engine import Plan, trace
from tselab.montecarlo.panels import COLOURS, Band, Bars, Dots, Line, Panel, Picture
from tselab.montecarlo.summary import HEADS, of, root_mean
from tselab.plots import BLUE, GREEN, GREY, INK, ORANGE

BAND = 1.96
MOST_POINTS = 2000  # of a line
RELATIVE = "% of nominal"
ERROR = "% of the truth"


def picture(plan: Plan, runs: pd.DataFrame, summary: pd.DataFrame) -> Picture:
    """The picture of the study."""
    special = {"fig1": _fig1, "fig2": _fig2, "fig3-4": _fig34, "bound": _bound, "particles": _particles}
    return special.get(plan.study.base, _dots)(plan, runs, summary)


def _thin(n: int) -> slice:
    return slice(None, None, max(1, -(-n // MOST_POINTS)))


def _fig1(plan: Plan, runs: pd.DataFrame, summary: pd.DataFrame) -> Picture:
    case = plan.study.cases[0]
    d, y = trace(plan, case, plan.first_seed, case.estimators[0])
    pick = _thin(len(y))
    t, y, true = d.time[pick], y[pick], 100 * d.stiffness[pick]
    panels = []
    for i, key in enumerate(STIFFNESS):
        mean, sd, spread = (100 * y[f"{key}{end}"].astype(float) for end in ("", "_sd", "_spread"))
        panels.append(Panel(HEADS[key], "time, s", RELATIVE, [
            Band(t, mean - BAND * spread, mean + BAND * spread, "95 % of samples", BLUE, 0.10),
            Band(t, mean - BAND * sd, mean + BAND * sd, "95 % band of the mean", BLUE, 0.28),
            Line(t, true[:, i], "truth", ORANGE, dash=True),
            Line(t, mean, "estimate", BLUE),
        ], at=case.events, y_range=(30, 150)))  # fmt: skip
        scatter = getattr(d.sim, f"spread_{key}") * true[:, i]
        panels.append(Panel(f"{HEADS[key]}: spread", "time, s", RELATIVE, [
            Line(t, scatter, "truth", ORANGE, dash=True), Line(t, spread, "estimate", BLUE),
        ], at=case.events, y_range=(0, 20)))  # fmt: skip
    return Picture(panels, 2)


def _fig2(plan: Plan, runs: pd.DataFrame, summary: pd.DataFrame) -> Picture:
    panels = []
    for key in STIFFNESS:
        x = np.sort(runs[f"{key}_bias"].to_numpy())
        n, mean, sd = len(x), x.mean(), max(x.std(ddof=1) if len(x) > 1 else 0.0, 1e-9)
        edges = np.histogram_bin_edges(x, "fd" if n > 10 else 5)
        if len(edges) > 60:  # single runs far off
            edges = np.linspace(x[0], x[-1], 60)
        share = np.diff(stats.norm.cdf(edges, mean, sd))
        low, high = (stats.binom.ppf(q, n, share) for q in (0.025, 0.975))
        wide = np.repeat(edges, 2)[1:-1]
        panels.append(Panel(HEADS[key], f"mean error, {ERROR}", "runs", [
            Bars(edges, np.histogram(x, edges)[0], "runs"),
            Band(wide, np.repeat(low, 2), np.repeat(high, 2), "95 % of bins, were it normal", ORANGE, 0.25),
            Line(wide, np.repeat(n * share, 2), "normal distribution", ORANGE),
        ]))  # fmt: skip
        grid = np.linspace(x[0] - sd, x[-1] + sd, 300)
        share = np.searchsorted(x, grid, side="right") / n
        half = np.sqrt(np.log(2 / 0.05) / (2 * n))  # Dvoretzky, Kiefer, Wolfowitz
        panels.append(Panel(f"{HEADS[key]}: distribution", f"mean error, {ERROR}", "share of runs", [
            Band(grid, np.clip(share - half, 0, 1), np.clip(share + half, 0, 1), "95 % band of the distribution", BLUE),
            Line(grid, share, "runs", BLUE), Line(grid, stats.norm.cdf(grid, mean, sd), "normal distribution", ORANGE),
        ]))  # fmt: skip
    return Picture(panels, 2)


def _seconds(part: pd.DataFrame, key: str, kind: str, count: int) -> np.ndarray:
    """RMS over the runs of each second."""
    return root_mean(part[[f"{key}_{kind}_{b}" for b in range(count)]].to_numpy().T)


def _fig34(plan: Plan, runs: pd.DataFrame, summary: pd.DataFrame) -> Picture:
    cases = plan.study.cases
    drawn = [trace(plan, case, plan.first_seed, case.estimators[0]) for case in cases]
    panels = []
    for i, key in enumerate(STIFFNESS):
        for case, (d, y) in zip(cases, drawn, strict=True):
            pick = _thin(len(y))
            true = d.stiffness[pick, i]
            error = 100 * (y[key][pick] / true - 1)
            sd = 100 * y[f"{key}_sd"][pick] / true
            t, middle = d.time[pick], np.arange(case.bins) + 0.5
            panels.append(Panel(f"{case.name}: {HEADS[key]}", "time, s", f"error, {ERROR}", [
                Band(t, error - BAND * sd, error + BAND * sd, "95 % band, one run", BLUE),
                Line(t, np.zeros_like(t), "truth", INK, width=1.0), Line(t, error, "error, one run", BLUE),
                Line(middle, _seconds(of(runs, case.name, case.estimators[0]), key, "ms", case.bins),
                     "RMS error, all runs", ORANGE, dash=True),
            ], y_range=(-60, 60)))  # fmt: skip
    return Picture(panels, len(cases))


def _bound(plan: Plan, runs: pd.DataFrame, summary: pd.DataFrame) -> Picture:
    case = plan.study.cases[0]
    t = np.arange(case.bins) + 0.5
    panels = []
    for key in STIFFNESS:
        lines = [
            Line(t, _seconds(of(runs, case.name, e), key, kind, case.bins), name, colour, dash)
            for e, kind, name, colour, dash in (
                ("tse", "ms", "tse, RMS error", BLUE, False),
                ("tse", "vs", "tse, its own sd", BLUE, True),
                ("ekf", "ms", "EKF, RMS error", GREEN, False),
                ("bound", "vs", "linear forgetting bound", ORANGE, False),
                ("crb", "vs", "Cramer-Rao, no forgetting", GREY, False),
            )
        ]
        panels.append(Panel(HEADS[key], "time, s", ERROR, lines, log_y=True))
    return Picture(panels, 1)


def _particles(plan: Plan, runs: pd.DataFrame, summary: pd.DataFrame) -> Picture:
    panels = [Panel(f"RMS error: {HEADS[key]}", "particles", ERROR, log_x=True, log_y=True) for key in STIFFNESS]
    panels.append(Panel("Diverged", "particles", "% of runs", log_x=True))
    for colour, case in zip(COLOURS, plan.study.cases, strict=False):
        lines = summary[summary["case"] == case.name]
        n = np.array([int(e.rpartition("-")[2]) for e in lines["estimator"]])
        for panel, key in zip(panels, (*STIFFNESS, None), strict=True):
            value, low, high = _share(lines) if key is None else _rms(lines, key)
            panel.marks.append(Dots(n, value, low, high, case.name, colour, joined=True))
    return Picture(panels, 2, 300)


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
