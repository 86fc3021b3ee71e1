"""Pictures for the README (matplotlib)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from tse.impl.core import STIFFNESS
from tse.impl.errors import UserError
from tse.impl.files import atomic
from tse.impl.verdict import NAMES, UNITS

INK, BLUE, ORANGE, GREY = "#1f2933", "#0b5fa5", "#c4570a", "#8a94a0"


def demo_picture(path: Path, est: pd.DataFrame, truth: pd.DataFrame, log: pd.DataFrame) -> None:
    """True and estimated stiffness with band, above what the driver does."""
    try:
        import matplotlib
    except ImportError:
        raise UserError("the picture needs matplotlib: pip install 'tse[figures]'") from None
    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    plt.rcParams.update({"font.size": 11, "font.family": "DejaVu Sans", "axes.edgecolor": "#c8ced4", "axes.linewidth": 0.8,
                         "text.color": INK, "axes.labelcolor": INK, "xtick.color": "#52606d",
                         "ytick.color": "#52606d"})  # fmt: skip
    figure, axes = plt.subplots(
        4, 1, figsize=(9, 7.6), dpi=200, sharex=True, height_ratios=[1, 1, 1, 0.62], layout="constrained"
    )
    time = est["time"].to_numpy()
    for axis, key in zip(axes, STIFFNESS, strict=False):
        mean, sd = est[key].to_numpy() / 1000, est[f"{key}_sd"].to_numpy() / 1000
        valid = est[f"{key}_valid"].to_numpy() == 1
        true = truth[f"true_{key}"].to_numpy()[: len(time)] / 1000
        axis.fill_between(time, mean - 1.96 * sd, mean + 1.96 * sd, color=BLUE, alpha=0.22, lw=0, label="95 % interval")
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
        axes[0].annotate(f"road level {level[i]:g} → {level[i + 1]:g}", (time[i + 1], 0.96), xycoords=("data", "axes fraction"),
                         xytext=(6, 0), textcoords="offset points", fontsize=10, color="#52606d", va="top")  # fmt: skip
        for axis in axes:
            axis.axvline(time[i + 1], color=GREY, lw=0.9)
    with atomic(path, "wb") as file:
        figure.savefig(file, format="png", metadata={"Software": None})
    plt.close(figure)
