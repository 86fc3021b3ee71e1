"""Pictures for the README (matplotlib)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from tselab.core import STIFFNESS
from tselab.errors import UserError
from tselab.files import atomic
from tselab.verdict import NAMES, UNITS

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


def estimator_icon(path: Path) -> None:
    """What importers show for TireStiffnessEstimator: force over slip, samples, the line through them and their spread."""
    figure, axis = _icon()
    slip = np.linspace(0.0, 1.0, 2)
    axis.fill_between(slip, 0.62 * slip, 1.02 * slip, color=BLUE, alpha=0.22, lw=0)
    axis.plot(slip, 0.82 * slip, color=BLUE, lw=10, solid_capstyle="round")
    for x, share in ((0.24, 0.6), (0.4, 1.02), (0.57, 0.68), (0.74, 0.97), (0.9, 0.72)):
        axis.plot(x, share * x, "o", color=ORANGE, ms=20, mec="white", mew=3)
    for tip in ((1.08, 0.0), (0.0, 1.04)):
        axis.annotate("", tip, (0.0, 0.0), arrowprops={"arrowstyle": "-|>", "color": INK, "lw": 4, "mutation_scale": 28,
                                                       "shrinkA": 0, "shrinkB": 0})  # fmt: skip
    axis.text(0.07, 0.91, "F", fontsize=40, style="italic", va="center")
    axis.text(1.03, 0.13, "α", fontsize=40, style="italic", ha="center", va="center")
    axis.set(xlim=(-0.12, 1.2), ylim=(-0.1, 1.12))
    _save_icon(figure, path)


def vehicle_icon(path: Path) -> None:
    """What importers show for SingleTrackVehicle: the single track from above, steered to the left."""
    from matplotlib.patches import Arc, FancyBboxPatch
    from matplotlib.transforms import Affine2D

    figure, axis = _icon()
    rear, cog, front, steer = (0.6, 1.35), (2.0, 1.35), (3.2, 1.35), np.radians(30)

    def arrow(start: tuple[float, float], angle: float, length: float, colour: str) -> None:
        tip = (start[0] + length * np.cos(angle), start[1] + length * np.sin(angle))
        axis.annotate("", tip, start, arrowprops={"arrowstyle": "-|>", "color": colour, "lw": 5, "mutation_scale": 32,
                                                  "shrinkA": 0, "shrinkB": 0})  # fmt: skip

    axis.plot(*zip(rear, front, strict=True), color=INK, lw=9, solid_capstyle="round", zorder=1)
    for (x, y), angle in ((rear, 0.0), (front, steer)):
        wheel = FancyBboxPatch(
            (-0.36, -0.13), 0.72, 0.26, boxstyle="round,pad=0,rounding_size=0.09", fc="#cbd2d9", ec=INK, lw=4
        )
        wheel.set_transform(Affine2D().rotate(angle).translate(x, y) + axis.transData)
        axis.add_patch(wheel)
    arrow(front, np.radians(115), 1.1, "#1a7f5a")
    arrow(rear, np.radians(90), 1.1, "#1a7f5a")
    arrow(cog, np.radians(12), 0.85, BLUE)
    axis.add_patch(Arc(cog, 1.5, 1.5, theta1=205, theta2=330, color=ORANGE, lw=5))
    end = np.radians(330)
    tip = (cog[0] + 0.75 * np.cos(end), cog[1] + 0.75 * np.sin(end))
    arrow((tip[0] - 0.03, tip[1] - 0.05), np.radians(59), 0.3, ORANGE)
    axis.plot(*cog, "o", ms=20, mfc="white", mec=INK, mew=5)
    axis.set(xlim=(0.0, 4.0), ylim=(0.0, 3.0))
    _save_icon(figure, path)


def _icon() -> tuple[Any, Any]:
    """400 x 300 pixels without axes; strokes are thick enough for 64 pixels."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    plt.rcParams.update({"font.family": "DejaVu Sans", "text.color": INK})
    figure = plt.figure(figsize=(4, 3), dpi=100, facecolor="white")
    axis = figure.add_axes((0, 0, 1, 1))
    axis.set_axis_off()
    return figure, axis


def _save_icon(figure: Any, path: Path) -> None:
    import matplotlib.pyplot as plt

    with atomic(path, "wb") as file:
        figure.savefig(file, format="png", metadata={"Software": None})
    plt.close(figure)
