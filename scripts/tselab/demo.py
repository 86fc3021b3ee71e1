"""The command `tselab demo`. First, it simulates a drive, estimates the tyre stiffness
from the log, and compares the estimates with the truth. Second, it writes the same drive
as an MF4, with signal names, units, rates and latencies as on the bus of a car, and
estimates the stiffness from this file. Third, it simulates a second car with body roll,
which is not in the vehicle file, and finds this effect."""

from __future__ import annotations

import contextlib
import importlib.util
import os
from collections.abc import Callable
from pathlib import Path

import click
import numpy as np
import pandas as pd

import tse
from tse.errors import Error
from tse.files import make_directory, write_atomically
from tse.tables import STIFFNESS_NAMES, simulated_vehicle
from tselab.montecarlo.pictures import draw_demo
from tselab.options import FILE, PROGRESS, show_progress, silence_warnings


@click.command()
@click.option(
    "--out",
    metavar="DIR",
    type=FILE,
    default=Path("demo"),
    show_default=True,
    help="Directory; created if needed.",
)
@click.option("--seed", type=int, default=1, show_default=True, help="Seed of the random numbers.")
@PROGRESS
def demo(out: Path, seed: int, progress: bool | None) -> None:
    """Demonstrate tselab on simulated drives: estimate the tyre stiffness,
    read an MF4, find an effect that the vehicle file lacks.

    First, double lane changes are simulated, the tyre stiffness is estimated from the
    log, and the estimates are compared with the truth. During the drive the road surface
    changes: every stiffness drops to 70 % of nominal. Files: vehicle.toml, filter.toml,
    log.csv, truth.csv, est.csv, report.html and, with matplotlib, demo.png.

    Second, the same drive is written as an MF4 with signal names, units, rates and
    latencies as on the bus of a car, and the stiffness is estimated from this file. Files
    in the folder logger: drive.mf4, car.toml, est.csv, and signals.toml, which 'tselab
    signals' proposes. This part needs the Python package asammdf.

    Third, a car is simulated with body roll, an effect that its vehicle file lacks, and
    'tselab gap' finds this effect. Files in the folder gap: the logs, and all files of
    'tselab gap'.
    """
    show = show_progress(progress)
    with silence_warnings():
        log, table = show_estimate(out, seed, show)
        try:
            show_mf4(out / "logger", log, table)
        except Error as error:
            click.echo(f"\nskipped: {error}")
        show_gap(
            out / "gap",
            seed,
            (lambda text: click.echo(f"gap: {text}", err=True)) if show else (lambda _: None),
        )


DRIVE_TIME = 72.0  # [s] duration of the drive
ROAD_CHANGE = (36.0, 0.7)  # time [s] of the change of the road, and factor on every stiffness from then on
SETTLED = 10.0  # [s] the printed errors are computed without the rows before this time
LAST = 12.0  # [s] duration of the last part of the drive, whose errors are printed separately
INITIAL_RATIO = 0.8  # ratio of the initial estimate of every stiffness to its nominal value


# Id of the effect that `tselab gap` has to find: the logs of a second car are simulated
# with it, but the vehicle file lacks it. The body rolls on its springs, so accel_y
# contains a component of gravity
HIDDEN = "body_roll"
HIDDEN_SETTINGS = {
    "body_roll_gain": 0.009,
    "body_roll_frequency": 1.5,
    "body_roll_damping": 0.3,
    "body_roll_height": 0.15,
    "body_roll_coupling": 0.3,
}
GAP_DRIVES = (  # manoeuvre, duration [s], speed [m/s], amplitude [rad], whether the log is held out
    ("sine-sweep", 30.0, 20.0, 0.03, False),
    ("double-lane-change", 36.0, 22.0, 0.04, False),
    ("square-waves", 30.0, 12.0, 0.06, False),
    ("square-waves", 30.0, 28.0, 0.02, True),
)
# [1] sd / mean of each stiffness, which the simulator draws at random anew in each row
STIFFNESS_SPREAD = 0.02
STEER_NOISE, WHEEL_NOISE = 2e-4, 0.02  # sd of the steering angle [rad] and of the wheel speeds [rad/s]


def show_estimate(out: Path, seed: int, progress: bool) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Simulate and estimate a drive, write all files, and print the
    errors of the estimates.

    Returns
    -------
    tuple
        The log, and the estimates.
    """
    make_directory(out)
    with write_atomically(out / "vehicle.toml") as file:
        file.write(simulated_vehicle())
    with write_atomically(out / "filter.toml") as file:
        file.write(
            "# wrong initial values, to show that the filter finds the true ones\n"
            + "".join(f"initial_{s} = {INITIAL_RATIO}\n" for s in tse.STIFFNESS)
        )
    drive = tse.simulate(
        "double-lane-change",
        out / "vehicle.toml",
        seed=seed,
        duration=DRIVE_TIME,
        road_changes=[ROAD_CHANGE],
        # without noise, a wheel speed repeats the same value while the car drives
        # straight, and the filter would report this signal as frozen
        settings={"wheel_speed_sd": WHEEL_NOISE},
        bar=progress,
    )
    drive.write(out / "log.csv", out / "truth.csv", with_ref=True)
    result = tse.estimate(out / "log.csv", out / "vehicle.toml", config=out / "filter.toml", bar=progress)
    result.to_csv(out / "est.csv")
    result.report(out / "report.html")
    files = ["vehicle.toml", "filter.toml", "log.csv", "truth.csv", "est.csv", "report.html"]
    with contextlib.suppress(Error):  # matplotlib is optional
        draw_demo(out / "demo.png", result.table, drive.truth, drive.log)
        files.append("demo.png")

    table, time = result.table, result.time
    start, level = ROAD_CHANGE
    click.echo(
        f"Double lane changes, {time[-1]:.0f} s; at {start:g} s every stiffness drops to "
        f"{100 * level:.0f} % of nominal."
    )
    parts = {
        f"from {SETTLED:g} s to the change": (time >= SETTLED) & (time < start),
        f"in the last {LAST:g} s": time > time[-1] - LAST,
    }
    for key in tse.STIFFNESS:
        valid = table[f"{key}_valid"].to_numpy(bool)
        error = table[key].to_numpy() / drive.truth[f"true_{key}"].to_numpy()[: len(table)] - 1
        texts = [
            f"{100 * np.sqrt(np.mean(error[p & valid] ** 2)):.1f} % {name}"
            for name, p in parts.items()
            if (p & valid).any()
        ]
        click.echo(
            f"{STIFFNESS_NAMES[key]}: RMS error {', '.join(texts) or 'unknown'}; "
            f"valid {100 * valid.mean():.0f} % of the time"
        )
    click.echo(f"Written to {out}: {', '.join(files)}")
    return drive.log, table


def show_gap(out: Path, seed: int, show: Callable[[str], None]) -> None:
    """Write logs of a car with the effect HIDDEN, and run the workflow of `tselab gap` on
    these logs. Print HIDDEN and the effect that the workflow finds."""
    make_directory(out)
    path = out / "car.toml"
    with write_atomically(path) as file:
        file.write(simulated_vehicle())
    spread = {f"spread_{s}": STIFFNESS_SPREAD for s in tse.STIFFNESS}
    noise = {
        "steer_angle_sd": STEER_NOISE,
        "wheel_speed_sd": WHEEL_NOISE,
        "true_bias_accel_y": 0.05,
        "true_cy_rear": 1.05,
    }
    paths: dict[bool, list[Path]] = {False: [], True: []}
    show("simulating a car with a hidden effect")
    for i, (name, duration, speed, amplitude, is_held) in enumerate(GAP_DRIVES):
        drive = tse.simulate(
            name,
            path,
            seed=seed + i,
            duration=duration,
            speed=speed,
            amplitude=amplitude,
            settings=HIDDEN_SETTINGS | spread | noise,
        )
        title = f"{'held_out' if is_held else 'log'}_{i + 1}_{name.replace('-', '_')}"
        paths[is_held].append(drive.write(out / f"{title}.csv"))
    found = tse.gap(
        paths[False], path, hold_out=paths[True], out=out, jobs=os.cpu_count() or 1, progress=show
    )
    click.echo(
        f"\nA second car, with a hidden effect ({HIDDEN}, {HIDDEN_SETTINGS['body_roll_gain']} rad s2/m). "
        "The verdict of tselab gap:"
    )
    for line in found.words:
        click.echo(f"  {line}")
    (before, after), (held_before, held_after) = (found.rms[part]["accel_y"] for part in ("fit", "held_out"))
    click.echo(
        f"Ratio of the accel_y residual to the sensor noise: {before:.2f} without the named effect, "
        f"{after:.2f} with it; in the held-out manoeuvre {held_before:.2f} and {held_after:.2f}.\n"
        f"Written to {out}: gap.png, report.html, verdict.json, vehicle_improved.toml, effects.h ..."
    )


# ---- The same drive as an MF4 of a data logger: find the signal of each channel. A
# channel is a quantity that the filter reads, such as yaw_rate; a signal is a series in
# the MF4.


RATIO = 15.3  # steering ratio
TRACK = 1.55  # [m] track width
DEG_PER_RAD, STANDARD_GRAVITY = 180 / np.pi, 9.80665  # degrees per radian; standard gravity [m/s2]
# Channel groups of the MF4. Key: name. Value: (n, latency [s], {signal: unit}). The group
# has every n-th row of the log
GROUPS = {
    "LWI": (4, 0.030, {"LWI_Lenkradwinkel": "deg"}),
    "ESP_wheels": (2, 0.040, dict.fromkeys(("ESP_VL", "ESP_VR", "ESP_HL", "ESP_HR"), "km/h")),
    "IMU": (1, 0.010, {"Gierrate": "deg/s", "Querbeschl": "g", "Laengsbeschl": "m/s2"}),
}


def show_mf4(out: Path, log: pd.DataFrame, clean: pd.DataFrame) -> None:
    """Write the drive as an MF4. Find in the MF4 the signal of each channel (quantity
    that the filter reads, such as yaw_rate), and estimate the stiffness. Print the
    differences to the estimates from the CSV log.

    Parameters
    ----------
    out
        Folder for the files.
    log
        The log in SI units.
    clean
        The estimates from this log.

    Raises
    ------
    Error
        The Python package for MF4 is not installed.
    """
    if importlib.util.find_spec("asammdf") is None:
        raise Error("the demo of an MF4 needs the Python package asammdf: pip install 'tse[mf4]'")
    make_directory(out)
    with write_atomically(out / "car.toml") as file:
        file.write(f"steering_ratio = {RATIO}\n{simulated_vehicle()}")
    car = tse.read_vehicle(out / "car.toml")
    write_mf4(out / "drive.mf4", log, car.values)
    signals = tse.signals(out / "drive.mf4", car)
    signals.write(out / "signals.toml")
    result = tse.estimate(out / "drive.mf4", out / "car.toml", out=out / "est.csv")

    def mean_of_end(table: pd.DataFrame) -> pd.Series:
        return table[table["time"] > table["time"].iloc[-1] - LAST][list(tse.STIFFNESS)].mean()

    off = mean_of_end(result.table) / mean_of_end(clean) - 1
    wheels = signals.to_dict()["proposal"].get("wheel_speed_rear")
    click.echo(
        "\nThe same drive as an MF4 of a data logger: four wheel speeds in km/h, angle of the steering wheel "
        "in degrees, three sample rates, latencies.\n"
        f"tselab signals finds {len(signals.guesses)} of 6 channels, and a delay of the wheel speeds "
        f"relative to the gyro of {1e3 * wheels['latency'] if wheels else np.nan:.0f} ms "
        f"(true: {1e3 * (GROUPS['ESP_wheels'][1] - GROUPS['IMU'][1]):.0f} ms).\n"
        f"Difference to the estimates from log.csv, mean of the last {LAST:g} s: "
        f"{', '.join(f'{STIFFNESS_NAMES[key].lower()} {100 * x:+.1f} %' for key, x in off.items())}.\n"
        f"Written to {out}: car.toml, drive.mf4, signals.toml, est.csv"
    )


def write_mf4(path: Path, log: pd.DataFrame, car: dict[str, float]) -> None:
    """Write the log as an MF4 with the names, units, rates and latencies of GROUPS."""
    from asammdf import MDF, Signal

    d = {name: log[name].to_numpy(float) for name in log}
    side = 0.5 * TRACK * d["yaw_rate"]
    front, rear = (d[f"wheel_speed_{a}"] * car[f"wheel_radius_{a}"] for a in ("front", "rear"))
    value = {
        "LWI_Lenkradwinkel": DEG_PER_RAD * RATIO * d["steer_angle"],
        "ESP_VL": 3.6 * (front - side),
        "ESP_VR": 3.6 * (front + side),
        "ESP_HL": 3.6 * (rear - side),
        "ESP_HR": 3.6 * (rear + side),
        "Gierrate": DEG_PER_RAD * d["yaw_rate"],
        "Querbeschl": d["accel_y"] / STANDARD_GRAVITY,
        "Laengsbeschl": d["accel_x"],
    }
    with MDF(version="4.10") as mdf:
        for group, (every, latency, units) in GROUPS.items():
            time = d["time"][::every] + latency
            mdf.append(
                [Signal(value[n][::every], time, unit=u, name=n) for n, u in units.items()], acq_name=group
            )
        mdf.save(path, overwrite=True)
