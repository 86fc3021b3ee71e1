"""Draw the PNG pictures of docs/pages/method/ten-minutes.md into docs/pages/pictures.

    .venv/bin/python -m docsite.pictures

The curves are simulated logs (seed 1) and estimates, both computed with the current
sources. The sketch of the car, sketch.svg, was drawn by hand and is not written here.
"""

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import pandas as pd

import tse
from tse.library.core import library

matplotlib.use("Agg")
import matplotlib.pyplot as plt

ROOT = Path(__file__).resolve().parents[2]
PICTURES_FOLDER = ROOT / "docs" / "pages" / "pictures"
MAX_PICTURE_BYTES = 100_000  # [bytes] max size of a picture in git
COLOURS = 64  # max number of colours of a picture in git
INKS = {"ink": "#1f2933", "grey": "#8a94a0", "a": "#0b5fa5", "b": "#c4570a", "c": "#3d8b37"}
PICTURE_STYLE = {
    "axes.spines.top": False,
    "axes.spines.right": False,
    "font.size": 10,
    "figure.autolayout": True,
    "axes.titlesize": 10,
}
EXACT_CAR = dict.fromkeys(library().uncertainties, 0.0)  # sds of 0: all parameters are known exactly
# the car of the simulator
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
    "uncertainty": EXACT_CAR,
}
Inks = dict[str, str]


def run_drive(**options: Any) -> tuple[tse.Simulated, pd.DataFrame]:
    """Simulate a drive with square waves of the steering angle, and estimate it with the
    true parameters of the car. Return drive and estimates.

    `options`: arguments of tse.simulate()."""
    drive = tse.simulate("square-waves", **options)
    return drive, tse.estimate(drive.log, CAR).table


def draw_interval(
    axis: Any, t: np.ndarray, table: pd.DataFrame, key: str, c: Inks, colour: str = "a"
) -> None:
    """Draw the estimate `key` in kN/rad, with its 95 % interval."""
    mean, sd = table[key].to_numpy() / 1e3, table[f"{key}_sd"].to_numpy() / 1e3
    axis.fill_between(
        t, mean - 1.96 * sd, mean + 1.96 * sd, color=c[colour], alpha=0.25, lw=0, label="95 % interval"
    )
    axis.plot(t, mean, color=c[colour], lw=1.5, label="estimate")


def draw_slope(c: Inks) -> Any:
    """Draw the lateral force of the front axle against its slip angle.

    The points are samples before and after a road change. The slope of the line through
    each set of points is the cornering stiffness.
    """
    drive, _ = run_drive(duration=40, road_changes=[(20.0, 0.5)])
    log, truth = drive
    vx, vy, r = (truth[f"true_{n}"].to_numpy() for n in ("vel_x", "vel_y", "yaw_rate"))
    alpha = log["steer_angle"].to_numpy() - np.arctan2(vy + CAR["lf"] * r, vx)
    dr = np.gradient(r, truth["time"].to_numpy())
    force = (CAR["lr"] * CAR["mass"] * log["accel_y"].to_numpy() + CAR["yaw_inertia"] * dr) / (
        CAR["lf"] + CAR["lr"]
    )
    figure, axis = plt.subplots(figsize=(8, 3.6))
    t = log["time"].to_numpy()
    for mask, colour, name, factor in (
        (t < 19.5, "a", "dry", 1.0),
        (t > 20.5, "b", "another road: half as stiff", 0.5),
    ):
        axis.plot(
            np.rad2deg(alpha[mask])[::3], force[mask][::3] / 1e3, ".", ms=2.5, color=c[colour], alpha=0.45
        )
        x = np.array([np.rad2deg(alpha).min(), np.rad2deg(alpha).max()])
        axis.plot(
            x,
            factor * CAR["cornering_stiffness_front"] * np.deg2rad(x) / 1e3,
            color=c[colour],
            lw=1.6,
            label=name,
        )
    axis.set(xlabel="slip angle of the front axle [deg]", ylabel="side force [kN]")
    axis.legend(frameon=False)
    return figure


def draw_change(c: Inks) -> Any:
    """Draw a stiffness and the probability of a road change, from 1 s before to 3 s after
    such a change."""
    drive, est = run_drive(duration=30, road_changes=[(20.0, 0.7)])
    t = est["time"].to_numpy()
    figure, (above, below) = plt.subplots(2, 1, figsize=(8, 4.4), sharex=True, height_ratios=[3, 2])
    draw_interval(above, t, est, "cy_front", c)
    above.plot(t, drive.truth["true_cy_front"] / 1e3, color=c["ink"], lw=1, ls="--", label="truth")
    above.set(ylabel="cornering stiffness,\nfront [kN/rad]", ylim=(60, 150))
    above.legend(frameon=False, ncols=3)
    for name, colour in (("steady", "grey"), ("changed", "b")):
        below.plot(t, est[f"p_{name}"], color=c[colour], label=name, lw=1.5)
    below.set(ylabel="probability", xlabel="time [s]", ylim=(-0.05, 1.05), xlim=(19, 23))
    below.legend(frameon=False, ncols=3, loc="center", bbox_to_anchor=(0.5, 0.6))
    return figure


def draw_quiet(c: Inks) -> Any:
    """Draw the estimates in two drives: a straight one, and one with steering.

    On the straight drive, no cornering stiffness is observable: its interval is wide."""
    drive = tse.simulate("straight", duration=12, amplitude=0.0)
    lively = tse.simulate("square-waves", duration=12)
    figure, axes = plt.subplots(1, 2, figsize=(8, 3.0), sharey=True)
    for axis, sim, title in zip(
        axes, (drive, lively), ("straight on, the wheel held still", "steering to and fro"), strict=True
    ):
        est = tse.estimate(sim.log, CAR).table
        t, valid = est["time"].to_numpy(), est["cy_front_valid"].to_numpy(bool)
        draw_interval(axis, t, est, "cy_front", c)
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


def draw_fault(c: Inks) -> Any:
    """Draw the estimate and the probabilities while the gyro is frozen for five seconds.

    The filter detects a sensor fault, and no road change."""
    drive = tse.simulate("square-waves", duration=30)
    log = drive.log.copy()
    frozen = log["time"].between(15, 20)
    log.loc[frozen, "yaw_rate"] = log.loc[frozen, "yaw_rate"].iloc[0]
    est = tse.estimate(log, CAR).table
    t = est["time"].to_numpy()
    figure, (above, middle, below) = plt.subplots(
        3, 1, figsize=(8, 4.6), sharex=True, height_ratios=[1.3, 2, 1.3]
    )
    above.plot(t, log["yaw_rate"], color=c["ink"], lw=1)
    above.set(ylabel="yaw rate,\nlogged [rad/s]")
    draw_interval(middle, t, est, "cy_front", c)
    middle.plot(t, drive.truth["true_cy_front"] / 1e3, color=c["ink"], lw=1, ls="--", label="truth")
    middle.set(ylabel="cornering\nstiffness [kN/rad]", ylim=(80, 160))
    below.plot(t, est["p_fault"], color=c["b"], label="p_fault", lw=1.5)
    below.plot(t, est["p_changed"], color=c["c"], label="p_changed", lw=1.5)
    below.set(ylabel="probability", xlabel="time [s]", ylim=(-0.05, 1.05), xlim=(13, 23))
    below.legend(frameon=False, loc="center right")
    return figure


PICTURES: dict[str, Callable[[Inks], Any]] = {
    "slope": draw_slope,
    "bank": draw_change,
    "quiet": draw_quiet,
    "fault": draw_fault,
}


def shrink_picture(path: Path) -> None:
    """Reduce the number of colours of a PNG to COLOURS, and then its width and height
    until the file has at most MAX_PICTURE_BYTES.

    The palette has the most frequent colours, not means of similar colours, because means
    would change the colour of large areas.
    """
    from PIL import Image

    picture, scale = Image.open(path).convert("RGB"), 1.0
    while scale == 1.0 or path.stat().st_size > MAX_PICTURE_BYTES:
        size = (int(picture.width * scale), int(picture.height * scale))
        now = picture.resize(size, Image.Resampling.LANCZOS)
        colours, which, count = np.unique(
            np.asarray(now).reshape(-1, 3), axis=0, return_inverse=True, return_counts=True
        )
        palette = colours[np.argsort(-count, kind="stable")[:COLOURS]].astype(int)
        nearest = np.array([np.abs(palette - c).sum(axis=1).argmin() for c in colours.astype(int)], np.uint8)
        reduced = Image.fromarray(nearest[which].reshape(now.height, now.width), "P")
        reduced.putpalette(palette.astype(np.uint8).tobytes())
        reduced.save(path, optimize=True)
        scale -= 0.1


def draw(names: Iterable[str] = PICTURES, out: Path = PICTURES_FOLDER) -> list[Path]:
    """Draw the pictures `names` to out/NAME.png. Return their paths."""
    made = []
    with plt.rc_context(PICTURE_STYLE):
        for name in names:
            figure = PICTURES[name](INKS)
            made.append(out / f"{name}.png")
            figure.savefig(made[-1], dpi=110, facecolor="white")
            plt.close(figure)
            shrink_picture(made[-1])
    return made


if __name__ == "__main__":
    for path in draw():
        print(path.relative_to(ROOT))
    # pictures of `tselab montecarlo`, which may be too large for git
    for path in (ROOT / "scripts" / "results").glob("*.png"):
        if path.stat().st_size > MAX_PICTURE_BYTES:
            shrink_picture(path)
