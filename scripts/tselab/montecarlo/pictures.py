"""Draw the pictures of `tselab demo` and of the paper's figures with matplotlib, and
write the files of a study."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
from scipy import stats

from tse.estimation.estimate import write_table
from tse.estimation.verdict import NAMES, UNITS
from tse.library import __version__
from tse.library.core import STIFFNESS, library
from tse.library.files import write_atomically
from tse.report.plots import BLUE, GREEN, GREY, INK, ORANGE, open_picture
from tselab.montecarlo import summary
from tselab.montecarlo.case import CaseDrive
from tselab.montecarlo.engine import StudyPlan, trace_run
from tselab.montecarlo.summary import HEADS, Table, make_overview, select_runs, summarise

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def draw_demo(path: Path, est: pd.DataFrame, truth: pd.DataFrame, log: pd.DataFrame) -> None:
    """Draw over time: for each stiffness the truth, and the estimate with its 95 %
    interval; below them steering angle and speed."""
    with open_picture(path) as plt:
        figure, axes = plt.subplots(
            4, 1, figsize=(9, 7.6), dpi=200, sharex=True, height_ratios=[1, 1, 1, 0.62], layout="constrained"
        )
        time = est["time"].to_numpy()
        for axis, key in zip(axes, STIFFNESS, strict=False):
            mean, sd = est[key].to_numpy() / 1000, est[f"{key}_sd"].to_numpy() / 1000
            valid = est[f"{key}_valid"].to_numpy() == 1
            true = truth[f"true_{key}"].to_numpy()[: len(time)] / 1000
            axis.fill_between(
                time, mean - 1.96 * sd, mean + 1.96 * sd, color=BLUE, alpha=0.22, lw=0, label="95 % interval"
            )
            axis.fill_between(
                time,
                0,
                1,
                where=~valid,
                transform=axis.get_xaxis_transform(),
                color=GREY,
                alpha=0.16,
                lw=0,
                label="not valid",
            )
            axis.plot(time, true, color=ORANGE, lw=1.8, ls=(0, (5, 2)), label="truth")
            axis.plot(time, mean, color=BLUE, lw=1.6, label="estimate")
            axis.set_ylim(0.35 * true.max(), 1.4 * true.max())
            axis.set_ylabel(UNITS[key])
            axis.set_title(NAMES[key], loc="left", fontsize=11, fontweight="bold", pad=4)
        handles, labels = axes[0].get_legend_handles_labels()
        order = [labels.index(x) for x in ("truth", "estimate", "95 % interval", "not valid")]
        figure.legend(
            [handles[i] for i in order],
            [labels[i] for i in order],
            loc="outside upper right",
            ncols=4,
            frameon=False,
        )
        axes[3].plot(time, 1000 * log["steer_angle"].to_numpy()[: len(time)], color=INK, lw=1.1)
        axes[3].set_ylabel("steering\n[mrad]")
        speed = axes[3].twinx()
        speed.plot(time, truth["true_vel_x"].to_numpy()[: len(time)], color="#1a7f5a", lw=1.5)
        speed.set_ylabel("speed\n[m/s]", color="#1a7f5a")
        speed.spines[["top", "left"]].set_visible(False)
        axes[3].set_xlabel("time [s]")
        for axis in axes:
            axis.grid(color="#edf0f3", lw=0.8)
            axis.set_axisbelow(True)
            axis.spines[["top", "right"]].set_visible(False)
            axis.set_xlim(time[0], time[-1] if len(time) > 1 else 1)
        level = truth["road_level"].to_numpy()[: len(time)]
        for i in np.flatnonzero(np.diff(level)):
            axes[0].annotate(
                f"road level {level[i]:g} → {level[i + 1]:g}",
                (time[i + 1], 0.96),
                xycoords=("data", "axes fraction"),
                xytext=(6, 0),
                textcoords="offset points",
                fontsize=10,
                color="#52606d",
                va="top",
            )
            for axis in axes:
                axis.axvline(time[i + 1], color=GREY, lw=0.9)


# ---- the paper's figures


RED, EDGE = "#c0392b", "#c8ced4"  # colours of the estimates (red, as in the paper) and of the axes
TITLES = {"printed": "as printed", "paper": "as printed", "robust": "robust", "tse": "default filter"}
DRAWN_STATES = (("vel_x", "vX, m/s", 1.0), ("yaw_rate", "yaw rate, deg/s", 180 / np.pi))
ERROR = "% of the truth"
PAPER_STYLE = {
    "font.size": 10,
    "font.family": "DejaVu Sans",
    "axes.edgecolor": EDGE,
    "text.color": INK,
    "axes.labelcolor": INK,
    "xtick.color": "#52606d",
    "ytick.color": "#52606d",
    "axes.grid": True,
    "grid.color": "#edf0f3",
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.titlelocation": "left",
    "axes.titlesize": 10,
    "axes.titleweight": "bold",
    "lines.linewidth": 1.6,
    "legend.frameon": False,
}


def draw_paper(plan: StudyPlan, runs: pd.DataFrame, path: Path) -> bool:
    """Draw the paper's figures to a file. Return False if matplotlib is not installed."""
    if importlib.util.find_spec("matplotlib") is None:
        return False
    with open_picture(path, PAPER_STYLE):
        figure = _draw_figures(plan, runs)
        named = {n: h for axis in figure.axes for h, n in zip(*axis.get_legend_handles_labels(), strict=True)}
        columns = max(1, min(len(named), int(14 * figure.get_figwidth() / (max(map(len, named)) + 8))))
        figure.legend(named.values(), named.keys(), loc="outside upper right", ncols=columns)
    return True


def _draw_figures(plan: StudyPlan, runs: pd.DataFrame) -> Figure:
    """Return Fig. 1 .. 4 of the paper, with a column for each filter."""
    import matplotlib.pyplot as plt

    cases = {c.name: c for c in plan.study.cases}
    waves, lanes = cases.get("iv-a"), cases.get("iv-b-20")
    rows = 2 * bool(waves) + 5 * bool(lanes)
    figure, axes = plt.subplots(
        rows, 3, figsize=(10.8, 2.8 * rows + 0.6), dpi=130, layout="constrained", squeeze=False
    )
    for column in range(3):
        row = iter(axes[:, column])
        if waves:
            name = waves.estimators[column]
            _draw_fig1(next(row), name, *trace_run(plan, waves, plan.first_seed, name))
            _draw_fig2(next(row), name, select_runs(runs, waves.name, name)["cy_front_bias_w0"].to_numpy())
        if lanes:
            name = lanes.estimators[column]
            d, y = trace_run(plan, lanes, plan.first_seed, name)
            for key in STIFFNESS:
                _draw_fig3(next(row), key, name, d, y)
            for state, label, unit in DRAWN_STATES:
                axis = next(row)
                axis.plot(d.time, unit * d.truth[f"true_{state}"], color=INK, lw=1.0, label="truth")
                axis.plot(d.time, unit * y[state], color=RED, label="estimate")
                axis.set(title=f"Fig. 4, {TITLES[name]}", xlabel="time, s", ylabel=label)
    return figure


def _draw_fig1(axis: Axes, name: str, d: CaseDrive, y: np.ndarray) -> None:
    """Draw true and estimated longitudinal stiffness relative to nominal, and the true
    and estimated sd of the stiffness from sample to sample. The default filter does not
    estimate this sd: the sd of its estimate of the mean stiffness is drawn instead."""
    axis.plot(d.time, d.stiffness[:, 0], color=INK, lw=1.0, label="truth")
    axis.plot(d.time, y["cx_front"], color=RED, label="stiffness")
    axis.plot(d.time, d.sim.spread_cx_front * d.stiffness[:, 0], color=INK, lw=1.0)
    if d.config.form or name != "tse":
        axis.plot(d.time, y["cx_front_spread"], color=GREEN, label="standard deviation")
    else:
        axis.plot(d.time, y["cx_front_sd"], color=GREEN, ls="--", label="sd of the mean")
    axis.axvline(30.0, color=GREY, lw=0.9)
    axis.set(title=f"Fig. 1, {TITLES[name]}: Cx", xlabel="time, s", ylabel="normalised", ylim=(0.0, 1.4))


def _draw_fig2(axis: Axes, name: str, x: np.ndarray) -> None:
    """Draw a histogram over the runs. The value of a run is the mean error of the front
    cornering stiffness in the first window of the case (Case.windows). Also draw the
    normal distribution with the same mean and sd as these values.

    `x`: the value of each run, in percent."""
    n, mean, sd = len(x), x.mean(), max(x.std(ddof=1) if len(x) > 1 else 0.0, 1e-9)
    edges = np.linspace(-4.0, 4.0, 33)
    height = np.histogram(np.clip(x, -4.0, 4.0), edges)[0] / n
    axis.bar(
        edges[:-1],
        height,
        np.diff(edges),
        align="edge",
        color=BLUE,
        alpha=0.55,
        edgecolor="white",
        label="runs",
    )
    axis.stairs(
        np.diff(stats.norm.cdf(edges, mean, sd)), edges, color=ORANGE, lw=1.6, label="normal distribution"
    )
    axis.set(title=f"Fig. 2, {TITLES[name]}: Cy front", xlabel=f"mean error, {ERROR}", ylabel="probability")


def _draw_fig3(axis: Axes, key: str, name: str, d: CaseDrive, y: np.ndarray) -> None:
    """Draw a true stiffness, its estimate, and the estimate minus and plus its sd, all
    relative to nominal."""
    mean, sd = y[key], y[f"{key}_sd"]
    axis.plot(d.time, d.stiffness[:, STIFFNESS.index(key)], color=INK, lw=1.0, label="truth")
    axis.plot(d.time, mean, color=RED, label="stiffness")
    axis.plot(d.time, mean - sd, color=GREEN, lw=1.0, label="standard deviation")
    axis.plot(d.time, mean + sd, color=GREEN, lw=1.0)
    axis.set(
        title=f"Fig. 3, {TITLES[name]}: {HEADS[key]}", xlabel="time, s", ylabel="normalised", ylim=(0.5, 1.5)
    )


# ---- Files of a study: NAME.csv, NAME.md and, for the study "paper", NAME.png


def write_study(plan: StudyPlan, runs: pd.DataFrame, out: Path) -> tuple[str, list[Path]]:
    """Write all files of a study. Return the text of NAME.md, and the paths."""
    lines = summarise(plan, runs)
    tables = summary.make_findings(plan, runs, lines)
    # for the studies "paper" and "robust", the tables of make_findings() replace those of
    # make_overview() and tabulate_changes()
    if plan.study.base not in ("paper", "robust"):
        tables += [make_overview(plan, lines), *summary.tabulate_changes(plan, lines)]
    facts = list_run_facts(plan, lines)
    text = format_markdown(plan, facts, tables)
    path = {end: out / f"{plan.study.name}.{end}" for end in ("csv", "md", "png")}
    write_table(lines, path["csv"])
    with write_atomically(path["md"]) as file:
        file.write(text)
    if plan.study.base != "paper" or not draw_paper(plan, runs, path["png"]):
        del path["png"]
    return text, list(path.values())


def format_command(plan: StudyPlan) -> str:
    """Return the command line that reproduces the study."""
    parts = [f"tselab montecarlo --study {plan.study.name} --runs {plan.runs}"]
    if plan.study.name == "paper":
        parts = [f"tselab paper --runs {plan.runs}"]
    parts += [f"--first-seed {plan.first_seed}"] if plan.first_seed != 1 else []
    parts += [f"--form {plan.form}"] if plan.form != "default" else []
    parts += [f"--set {k}={v:g}" for k, v in {**plan.settings, **plan.sim_settings}.items()]
    parts += [f"--cases {','.join(plan.cases)}"] if plan.cases else []
    return " ".join(parts)


def list_run_facts(plan: StudyPlan, lines: pd.DataFrame) -> list[tuple[str, str]]:
    """Return facts about the study as pairs of name and text: runs, settings, command,
    library, and computing time."""
    lib, first = library(), lines.iloc[0]
    seeds = f"seeds {plan.seeds[0]} .. {plan.seeds[-1]}" if plan.runs > 1 else f"seed {plan.first_seed}"
    settings = [f"{k} = {v:g}" for k, v in {**plan.settings, **plan.sim_settings}.items()]
    return [
        ("Runs", f"{plan.runs} of each case, {seeds}"),
        ("Settings", f"form {plan.form}" + "".join(f", {s}" for s in settings)),
        ("Command", f"`{format_command(plan)}`"),
        ("Library", f"tse {lib.version}, {lib.format}; tselab {__version__}"),
        (
            "Cost",
            f"{first['simulate_s'] + first['estimate_s']:.2f} s for a run of case {first['case']} with "
            f"estimator {first['estimator']}, of which simulation and scores take "
            f"{first['simulate_s']:.2f} s",
        ),
    ]


def format_markdown(plan: StudyPlan, facts: list[tuple[str, str]], tables: list[Table]) -> str:
    """Return the result of a study as Markdown."""
    lines = [f"# {plan.study.title}", "", *(f"- {name}: {value}" for name, value in facts)]
    for table in tables:
        lines += ["", table.markdown()]
    files = (
        f"The command also writes {plan.study.name}.csv (intervals of all values) and runs.csv (scores of "
        "each run)."
    )
    return "\n".join([*lines, "", files, ""])
