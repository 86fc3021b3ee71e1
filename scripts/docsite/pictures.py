"""Pictures and example reports of the site, from runs of the library: build/site-parts, which the site takes in.

    .venv/bin/python -m docsite.pictures

Each picture is made twice, for light and for dark pages. Nothing in them is drawn by hand but the sketch of the car: all curves are
logs and estimates of the simulator and the filter of this checkout, seed 1.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import pandas as pd

import tse
from tselab.core import library

matplotlib.use("Agg")
import matplotlib.pyplot as plt

ROOT = Path(__file__).resolve().parents[2]
OUT = ROOT / "build" / "site-parts"
INKS = {
    "light": {"ink": "#1f2933", "paper": "none", "grey": "#8a94a0", "a": "#0b5fa5", "b": "#c4570a", "c": "#3d8b37"},
    "dark": {"ink": "#dde3ea", "paper": "none", "grey": "#8a94a0", "a": "#6db3f2", "b": "#f0975a", "c": "#7ccf75"},
}
EXACT = dict.fromkeys(library().uncertainties, 0.0)
CAR: dict[str, Any] = {
    "mass": 1900,
    "yaw_inertia": 3000,
    "lf": 1.25,
    "lr": 1.5,
    "wheel_radius_front": 0.33,
    "wheel_radius_rear": 0.33,
    "cornering_stiffness_front": 1.2e5,
    "cornering_stiffness_rear": 1.4e5,
    "longitudinal_stiffness_front": 1.6e5,
    "longitudinal_stiffness_rear": 1.6e5,
    "uncertainty": EXACT,
}
Inks = dict[str, str]


def run(**options: Any) -> tuple[tse.Simulated, pd.DataFrame]:
    drive = tse.simulate("square-waves", **options)
    return drive, tse.estimate(drive.log, CAR).table


def band(axis: Any, t: np.ndarray, table: pd.DataFrame, key: str, c: Inks, colour: str = "a") -> None:
    mean, sd = table[key].to_numpy() / 1e3, table[f"{key}_sd"].to_numpy() / 1e3
    axis.fill_between(t, mean - 1.96 * sd, mean + 1.96 * sd, color=c[colour], alpha=0.25, lw=0, label="95 % band")
    axis.plot(t, mean, color=c[colour], lw=1.5, label="estimate")


def sketch(c: Inks) -> Any:
    """Single-track model: one wheel an axle, slip angle between where it points and where it goes."""
    figure, axis = plt.subplots(figsize=(8, 1.9))
    axis.plot([0, 7], [0, 0], color=c["grey"], lw=3, solid_capstyle="round", zorder=1)
    axis.plot(3.3, 0, "o", color=c["ink"], ms=7)
    axis.annotate("centre of gravity", (3.3, 0), (3.3, -0.75), ha="center", color=c["ink"])
    for x, wheel, goes, name in ((0.0, 0.0, -8.0, "rear"), (7.0, 22.0, 7.0, "front")):
        a, g = np.deg2rad(wheel), np.deg2rad(goes)
        u = np.array([np.cos(a), np.sin(a)])
        axis.plot(
            *zip(np.array([x, 0]) - 0.55 * u, np.array([x, 0]) + 0.55 * u, strict=True),
            color=c["ink"],
            lw=9,
            solid_capstyle="butt",
            zorder=2,
        )
        axis.plot([x, x + 2.0 * u[0]], [0, 2.0 * u[1]], color=c["ink"], lw=1, ls=":")
        axis.annotate(
            "",
            (x + 2.0 * np.cos(g), 2.0 * np.sin(g)),
            (x, 0),
            arrowprops={"arrowstyle": "->", "color": c["a"], "lw": 1.6},
        )
        axis.annotate(
            "",
            (x - 1.3 * np.sin(a) * np.sign(wheel - goes), 1.3 * np.cos(a) * np.sign(wheel - goes)),
            (x, 0),
            arrowprops={"arrowstyle": "->", "color": c["b"], "lw": 2},
        )
        axis.text(
            x - 0.75 if x else x - 0.2, -0.62 if x else 0.5, f"{name} axle", color=c["ink"], ha="right", va="center"
        )
    axis.text(9.15, 0.72, "points", color=c["ink"], va="center")
    axis.text(9.15, 0.2, "goes: slip angle between them", color=c["a"], va="center")
    axis.text(6.35, 1.2, "side force", color=c["b"], ha="right", va="center")
    axis.set(xlim=(-2.1, 12.4), ylim=(-1.15, 1.45), aspect="equal")
    axis.axis("off")
    return figure


def slope(c: Inks) -> Any:
    """Side force of the front axle over its slip angle, before and after a change of the road: the slope is the stiffness."""
    drive, _ = run(duration=40, road_changes=[(20.0, 0.5)])
    log, truth = drive
    vx, vy, r = (truth[f"true_{n}"].to_numpy() for n in ("vel_x", "vel_y", "yaw_rate"))
    alpha = log["steer_angle"].to_numpy() - np.arctan2(vy + CAR["lf"] * r, vx)
    dr = np.gradient(r, truth["time"].to_numpy())
    force = (CAR["lr"] * CAR["mass"] * log["accel_y"].to_numpy() + CAR["yaw_inertia"] * dr) / (CAR["lf"] + CAR["lr"])
    figure, axis = plt.subplots(figsize=(8, 3.6))
    t = log["time"].to_numpy()
    for mask, colour, name, factor in (
        (t < 19.5, "a", "dry", 1.0),
        (t > 20.5, "b", "another road: half as stiff", 0.5),
    ):
        axis.plot(np.rad2deg(alpha[mask])[::3], force[mask][::3] / 1e3, ".", ms=2.5, color=c[colour], alpha=0.45)
        x = np.array([np.rad2deg(alpha).min(), np.rad2deg(alpha).max()])
        axis.plot(
            x, factor * CAR["cornering_stiffness_front"] * np.deg2rad(x) / 1e3, color=c[colour], lw=1.6, label=name
        )
    axis.set(xlabel="slip angle of the front axle [deg]", ylabel="side force [kN]")
    axis.legend(frameon=False)
    return figure


def change(c: Inks) -> Any:
    """A change of the road: when the filter believes it, and the estimate."""
    drive, est = run(duration=30, road_changes=[(20.0, 0.7)])
    t = est["time"].to_numpy()
    figure, (above, below) = plt.subplots(2, 1, figsize=(8, 4.4), sharex=True, height_ratios=[3, 2])
    band(above, t, est, "cy_front", c)
    above.plot(t, drive.truth["true_cy_front"] / 1e3, color=c["ink"], lw=1, ls="--", label="truth")
    above.set(ylabel="cornering stiffness,\nfront [kN/rad]", ylim=(60, 150))
    above.legend(frameon=False, ncols=3)
    for name, colour in (("steady", "grey"), ("changed", "b")):
        below.plot(t, est[f"p_{name}"], color=c[colour], label=name, lw=1.5)
    below.set(ylabel="probability", xlabel="time [s]", ylim=(-0.05, 1.05), xlim=(19, 23))
    below.legend(frameon=False, ncols=3, loc="center", bbox_to_anchor=(0.5, 0.6))
    return figure


def quiet(c: Inks) -> Any:
    """Straight driving shows no cornering stiffness; the band says so."""
    drive = tse.simulate("straight", duration=12, amplitude=0.0)
    lively = tse.simulate("square-waves", duration=12)
    figure, axes = plt.subplots(1, 2, figsize=(8, 3.0), sharey=True)
    for axis, sim, title in zip(
        axes, (drive, lively), ("straight on, the wheel held still", "steering to and fro"), strict=True
    ):
        est = tse.estimate(sim.log, CAR).table
        t, valid = est["time"].to_numpy(), est["cy_front_valid"].to_numpy(bool)
        band(axis, t, est, "cy_front", c)
        axis.plot(t, sim.truth["true_cy_front"] / 1e3, color=c["ink"], lw=1, ls="--", label="truth")
        axis.fill_between(
            t,
            0,
            1,
            where=~valid,
            transform=axis.get_xaxis_transform(),
            color=c["grey"],
            alpha=0.18,
            lw=0,
            label="not valid",
        )
        axis.set(title=title, xlabel="time [s]")
    axes[0].set(ylabel="cornering stiffness,\nfront [kN/rad]", ylim=(0, 260))
    axes[1].legend(frameon=False, ncols=2)
    return figure


def fault(c: Inks) -> Any:
    """A gyro that is stuck for five seconds: a fault of a sensor, not another road."""
    drive = tse.simulate("square-waves", duration=30)
    log = drive.log.copy()
    stuck = log["time"].between(15, 20)
    log.loc[stuck, "yaw_rate"] = log.loc[stuck, "yaw_rate"].iloc[0]
    est = tse.estimate(log, CAR).table
    t = est["time"].to_numpy()
    figure, (above, middle, below) = plt.subplots(3, 1, figsize=(8, 4.6), sharex=True, height_ratios=[1.3, 2, 1.3])
    above.plot(t, log["yaw_rate"], color=c["ink"], lw=1)
    above.set(ylabel="yaw rate,\nlogged [rad/s]")
    band(middle, t, est, "cy_front", c)
    middle.plot(t, drive.truth["true_cy_front"] / 1e3, color=c["ink"], lw=1, ls="--", label="truth")
    middle.set(ylabel="cornering\nstiffness [kN/rad]", ylim=(80, 160))
    below.plot(t, est["p_fault"], color=c["b"], label="p_fault", lw=1.5)
    below.plot(t, est["p_changed"], color=c["c"], label="p_changed", lw=1.5)
    below.set(ylabel="probability", xlabel="time [s]", ylim=(-0.05, 1.05), xlim=(13, 23))
    below.legend(frameon=False, loc="center right")
    return figure


PICTURES: dict[str, Callable[[Inks], Any]] = {
    "sketch": sketch,
    "slope": slope,
    "bank": change,
    "quiet": quiet,
    "fault": fault,
}


def draw(out: Path = OUT) -> list[Path]:
    """All pictures, for light and dark pages: out/assets/NAME-light.svg."""
    (out / "assets").mkdir(parents=True, exist_ok=True)
    made = []
    for name, make in PICTURES.items():
        for scheme, c in INKS.items():
            style = {
                "text.color": c["ink"],
                "axes.labelcolor": c["ink"],
                "xtick.color": c["ink"],
                "ytick.color": c["ink"],
                "axes.edgecolor": c["grey"],
                "axes.spines.top": False,
                "axes.spines.right": False,
                "font.size": 10,
                "svg.hashsalt": "tse",
                "svg.fonttype": "path",
                "figure.autolayout": True,
                "axes.titlesize": 10,
            }
            with plt.rc_context(style):
                figure = make(c)
                path = out / "assets" / f"{name}-{scheme}.svg"
                figure.savefig(path, transparent=True, metadata={"Date": None})
                plt.close(figure)
                made.append(path)
    return made


def reports(out: Path = OUT) -> list[Path]:
    """What `tselab estimate --report` writes of a drive on which the road changes: examples/report.html."""
    import subprocess

    folder = out / "examples"
    folder.mkdir(parents=True, exist_ok=True)
    drive = tse.simulate("double-lane-change", duration=40, road_changes=[(20.0, 0.7)])
    drive.log.to_csv(folder / "log.csv", index=False)
    (folder / "car.toml").write_text(
        subprocess.run(
            [sys.executable, "-m", "tselab", "vehicle", "--simulated"], capture_output=True, text=True, check=True
        ).stdout
    )
    command = [
        sys.executable,
        "-m",
        "tselab",
        "estimate",
        "log.csv",
        "--vehicle",
        "car.toml",
        "--out",
        "log.est.csv",
        "--report",
        "report.html",
    ]
    subprocess.run(command, cwd=folder, check=True, capture_output=True)
    return [folder / "report.html"]


if __name__ == "__main__":
    for path in (*draw(), *reports()):
        print(path.relative_to(ROOT))
