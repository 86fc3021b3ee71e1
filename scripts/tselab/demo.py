"""The demonstration: simulate, estimate, compare; everything left in one directory. Then the same drive as an MF4 of other names,
units, rates and latencies."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable
from pathlib import Path

import click
import numpy as np
import pandas as pd

from tse.car.config import make_config
from tse.car.vehicle import read_vehicle
from tse.channels.log import read_log
from tse.channels.proposal import format_signals, propose
from tse.estimation.estimate import estimate, estimate_to, write_estimates, write_table
from tse.estimation.verdict import NAMES
from tse.gaps.run.output import write_all
from tse.gaps.run.workflow import run
from tse.library.core import STIFFNESS, Config, SimConfig
from tse.library.errors import UserError
from tse.library.files import make_directory, write_atomically
from tse.log.rows import Reading
from tse.readers.readers import read_recording
from tse.readers.recording import import_optional
from tse.report.report import write_report
from tse.report.tables import simulated_vehicle
from tse.runs.single import prepare
from tse.simulation import maneuvers
from tse.simulation.simulate import add_references, simulate
from tselab.montecarlo.pictures import demo_picture
from tselab.options import FILE, PROGRESS, show_progress


@click.command()
@click.option(
    "--out",
    metavar="DIR",
    type=FILE,
    default=Path("demo"),
    show_default=True,
    help="Directory; made if needed.",
)
@click.option("--seed", type=int, default=1, show_default=True, help="Seed of the random numbers.")
@PROGRESS
def demo(out: Path, seed: int, progress: bool | None) -> None:
    """Simulate double lane changes with a road change, estimate, compare; do it again from an MF4 of other names, units, rates
    and latencies; then find a hidden effect.

    Writes vehicle.toml, filter.toml, log.csv, truth.csv, est.csv, report.html and, with matplotlib, demo.png; in
    the folder logger the same drive as an MF4, where the library for it is, and the proposed signals.toml; and in the folder gap
    the logs of a car with a hidden effect, and all that 'tselab gap' makes of them.
    """
    show = show_progress(progress)
    log, table = estimated(out, seed, show)
    try:
        logged(out / "logger", log, table)
    except UserError as error:
        click.echo(f"\nleft out: {error}")
    closed(
        out / "gap", seed, (lambda text: click.echo(f"gap: {text}", err=True)) if show else (lambda _: None)
    )


DURATION, ROAD_CHANGE = 72.0, (36.0, 0.7)
SETTLED, LAST = 10.0, 12.0  # s: what the summary looks at
START = 0.8  # of nominal


# A second car, with something that the model does not have, for `tselab gap`: it rolls on its springs, and gravity leaks into
# accel_y. The logs are of the simulator with wheels, torques and a stiffness that scatters; the workflow has the plain car.
HIDDEN = "body_roll"
HIDDEN_SETTINGS = {
    "body_roll_gain": 0.009, "body_roll_frequency": 1.5, "body_roll_damping": 0.3, "body_roll_height": 0.15,
    "body_roll_coupling": 0.3,
}  # fmt: skip
GAP_DRIVES = (  # manoeuvre, seconds, speed, amplitude, held out
    ("sine-sweep", 30.0, 20.0, 0.03, False),
    ("double-lane-change", 36.0, 22.0, 0.04, False),
    ("square-waves", 30.0, 12.0, 0.06, False),
    ("square-waves", 30.0, 28.0, 0.02, True),
)
SPREAD = 0.02  # of the stiffness from sample to sample, share of its mean
STEER_NOISE, WHEEL_NOISE = 2e-4, 0.02  # rad, rad/s


def estimated(out: Path, seed: int, progress: bool) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Write vehicle, filter settings, log, truth, estimates, report and picture; say how far off they are. Return the log, and the
    estimates."""
    make_directory(out)
    with write_atomically(out / "vehicle.toml") as file:
        file.write(simulated_vehicle())
    with write_atomically(out / "filter.toml") as file:
        file.write(
            "# a wrong start, to see it being found\n"
            + "".join(f"initial_{s} = {START}\n" for s in STIFFNESS)
        )
    vehicle = read_vehicle(out / "vehicle.toml")
    config = Config.exact(vehicle.values)
    maneuver = maneuvers.build(
        "double-lane-change", config, sample_time=config.sample_time, duration=DURATION, road=[ROAD_CHANGE]
    )
    sensors = SimConfig(
        {"seed": seed, "wheel_speed_sd": WHEEL_NOISE}
    )  # wheels that repeat a number exactly are a fault
    simulation = simulate(maneuver, config, sensors, vehicle.driven_axle, progress)
    write_table(add_references(simulation), out / "log.csv")
    write_table(simulation.truth, out / "truth.csv")

    log = read_log(out / "log.csv")
    config, notes = make_config(vehicle, log, out / "filter.toml", {"seed": seed})
    est = estimate(log, config, progress)
    write_estimates(est.table, out / "est.csv")
    write_report(out / "report.html", est, log, vehicle, config, notes + log.notes)
    files = ["vehicle.toml", "filter.toml", "log.csv", "truth.csv", "est.csv", "report.html"]
    with contextlib.suppress(UserError):  # matplotlib is optional
        demo_picture(out / "demo.png", est.table, simulation.truth, simulation.log)
        files.append("demo.png")

    table, time = est.table, est.table["time"].to_numpy()
    click.echo(
        f"Double lane changes, {time[-1]:.0f} s; at {ROAD_CHANGE[0]:g} s all stiffness drops to {100 * ROAD_CHANGE[1]:.0f} %."
    )
    parts = {
        f"from {SETTLED:g} s to the change": (time >= SETTLED) & (time < ROAD_CHANGE[0]),
        f"in the last {LAST:g} s": time > time[-1] - LAST,
    }
    for key in STIFFNESS:
        valid = table[f"{key}_valid"].to_numpy() == 1
        error = table[key].to_numpy() / simulation.truth[f"true_{key}"].to_numpy()[: len(table)] - 1
        texts = [
            f"{100 * np.sqrt(np.mean(error[p & valid] ** 2)):.1f} % {name}"
            for name, p in parts.items()
            if (p & valid).any()
        ]
        click.echo(
            f"{NAMES[key]}: RMS error {', '.join(texts) or 'unknown'}; valid {100 * valid.mean():.0f} % of the time"
        )
    click.echo(f"Written to {out}: {', '.join(files)}")
    return simulation.log, table


def closed(out: Path, seed: int, say: Callable[[str], None]) -> None:
    """Write logs of a car with a hidden effect, and what the gap workflow makes of them; say what was hidden, what was found."""
    make_directory(out)
    path = out / "car.toml"
    with write_atomically(path) as file:
        file.write(simulated_vehicle())
    vehicle = read_vehicle(path)
    car = Config.exact(vehicle.values)
    truth = Config.exact(vehicle.values | HIDDEN_SETTINGS)
    spread = {f"spread_{s}": SPREAD for s in STIFFNESS}
    noise = {
        "steer_angle_sd": STEER_NOISE,
        "wheel_speed_sd": WHEEL_NOISE,
        "true_bias_accel_y": 0.05,
        "true_cy_rear": 1.05,
    }
    paths: dict[bool, list[Path]] = {False: [], True: []}
    say("simulating a car with a hidden effect")
    for i, (name, duration, speed, amplitude, is_held) in enumerate(GAP_DRIVES):
        maneuver = maneuvers.build(
            name,
            car,
            sample_time=car.sample_time,
            duration=duration,
            speed=speed,
            amplitude=amplitude,
            seed=seed + i,
        )
        log = simulate(
            maneuver,
            truth,
            SimConfig(spread | noise | {"seed": seed + i, "speed": speed}),
            vehicle.driven_axle,
        ).log
        paths[is_held].append(
            out / f"{'held_out' if is_held else 'log'}_{i + 1}_{name.replace('-', '_')}.csv"
        )
        write_table(log, paths[is_held][-1])
    jobs = os.cpu_count() or 1
    result = run(paths[False], path, paths[True], jobs, say)
    write_all(out, result, path, jobs, say)
    held = result.held_out["accel_y"]
    click.echo(
        f"\nA second car, with a hidden effect ({HIDDEN}, {HIDDEN_SETTINGS['body_roll_gain']} rad s2/m). tselab gap says:"
    )
    for line in result.words:
        click.echo(f"  {line}")
    click.echo(
        f"accel_y against the simulation: {result.fit_before['accel_y']:.2f} times the sensor's noise before, "
        f"{result.fit_after['accel_y']:.2f} after; in a manoeuvre that the fit has not seen {held.before:.2f} before, "
        f"{held.after:.2f} after.\nWritten to {out}: gap.png, report.html, verdict.json, vehicle_improved.toml, effects.h ..."
    )


# ---- the same drive as an MF4 of a measuring system, and what a user does with it


RATIO, TRACK = 15.3, 1.55  # m
DEG, G = 180 / np.pi, 9.80665
GROUPS = {  # group of the MF4: rows of the clean log per entry, latency in s, channels with their units
    "LWI": (4, 0.030, {"LWI_Lenkradwinkel": "deg"}),
    "ESP_wheels": (2, 0.040, dict.fromkeys(("ESP_VL", "ESP_VR", "ESP_HL", "ESP_HR"), "km/h")),
    "IMU": (1, 0.010, {"Gierrate": "deg/s", "Querbeschl": "g", "Laengsbeschl": "m/s2"}),
}


def logged(out: Path, log: pd.DataFrame, clean: pd.DataFrame) -> None:
    """Write car.toml and drive.mf4, have signals.toml proposed, estimate, and say how far that is from what was estimated from the
    clean rows. UserError: no library for MF4."""
    import_optional("asammdf", "mf4", "the demonstration of an MF4")
    make_directory(out)
    with write_atomically(out / "car.toml") as file:
        file.write(f"steering_ratio = {RATIO}\n{simulated_vehicle()}")
    car = read_vehicle(out / "car.toml")
    write_mf4(out / "drive.mf4", log, car.values)
    recording = read_recording(out / "drive.mf4")
    proposal = propose(recording, car)
    with write_atomically(out / "signals.toml") as file:
        file.write(format_signals(recording, proposal))
    prepared = prepare(out / "drive.mf4", out / "car.toml", None, None, {}, "default", {}, Reading())
    est = estimate_to(out / "est.csv", prepared.log, prepared.config)

    def end(table: pd.DataFrame) -> pd.Series:
        return table[table["time"] > table["time"].iloc[-1] - LAST][list(STIFFNESS)].mean()

    off = end(est.table) / end(clean) - 1
    wheels = proposal["wheel_speed_rear"]
    click.echo(
        "\nThe same drive as a measuring system logs it: an MF4, four wheels in km/h, steering wheel in degrees, three rates, "
        f"latencies.\ntselab signals finds {len(proposal.guesses)} of 6 channels; the wheels "
        f"{1e3 * wheels.latency if wheels else np.nan:.0f} ms behind the gyro "
        f"({1e3 * (GROUPS['ESP_wheels'][1] - GROUPS['IMU'][1]):.0f} ms are true).\n"
        f"Against the estimates from the clean log, last {LAST:g} s: "
        f"{', '.join(f'{NAMES[key].lower()} {100 * x:+.1f} %' for key, x in off.items())}.\n"
        f"Written to {out}: car.toml, drive.mf4, signals.toml, est.csv"
    )


def write_mf4(path: Path, log: pd.DataFrame, car: dict[str, float]) -> None:
    """The log as that of a measuring system."""
    from asammdf import MDF, Signal

    d = {name: log[name].to_numpy(float) for name in log}
    side = 0.5 * TRACK * d["yaw_rate"]
    front, rear = (d[f"wheel_speed_{a}"] * car[f"wheel_radius_{a}"] for a in ("front", "rear"))
    value = {
        "LWI_Lenkradwinkel": DEG * RATIO * d["steer_angle"],
        "ESP_VL": 3.6 * (front - side), "ESP_VR": 3.6 * (front + side),
        "ESP_HL": 3.6 * (rear - side), "ESP_HR": 3.6 * (rear + side),
        "Gierrate": DEG * d["yaw_rate"], "Querbeschl": d["accel_y"] / G, "Laengsbeschl": d["accel_x"],
    }  # fmt: skip
    with MDF(version="4.10") as mdf:
        for group, (every, latency, units) in GROUPS.items():
            time = d["time"][::every] + latency
            mdf.append(
                [Signal(value[n][::every], time, unit=u, name=n) for n, u in units.items()], acq_name=group
            )
        mdf.save(path, overwrite=True)
