"""Compare longitudinal stiffness by calibration, straight rows and class.

    python -m tests.cars.along [--cars N] [--first SEED] [--seeds S] [--straight D]
        [--out FILE]

Three parts: calibrations on simulated manoeuvres, calibrations on driven cars
(tests.cars), and valid rows of the filter on straight roads with a known car.
--cars 0 and --straight 0 leave the last two out.
"""

import argparse
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

import tse
from tests.cars import ROADS, make_logs
from tests.cars.study import RESULTS
from tse.car.vehicle import SHAPE, Vehicle, fill_sensors, get_ordinary_car, make_vehicle
from tse.channels.log import read_frame
from tse.identify.slip import estimate_longitudinal
from tse.library.core import Config, NativeFilter
from tse.log.rows import CheckedLog
from tse.report.tables import format_markdown_table

OFF, SMOOTH, MIN_LINE_ROWS = 0.1, 61, 500  # relative error; rows; rows
SHOWN = 0.2  # ln: sd below which a log has shown the stiffness
MANOEUVRES = (
    "square-waves",
    "double-lane-change",
    "step-steer",
    "sine-sweep",
    "constant-radius",
    "straight",
    "stop-and-go",
)
SECONDS = 120.0
# The simulator's manoeuvres drive the front axle
CARS: dict[str, dict[str, Any]] = {
    "small": {
        "mass": 1200, "lf": 1.0, "lr": 1.45, "wheel_radius_front": 0.29, "wheel_radius_rear": 0.29,
        "longitudinal_stiffness_front": 115e3, "longitudinal_stiffness_rear": 80e3,
        "cornering_stiffness_front": 75e3, "cornering_stiffness_rear": 85e3, "driven_axle": "front",
    },
    "family": {
        "mass": 1650, "lf": 1.2, "lr": 1.55, "wheel_radius_front": 0.32, "wheel_radius_rear": 0.32,
        "longitudinal_stiffness_front": 240e3, "longitudinal_stiffness_rear": 200e3,
        "cornering_stiffness_front": 105e3, "cornering_stiffness_rear": 130e3, "driven_axle": "front",
    },
    "van": {
        "mass": 2500, "lf": 1.6, "lr": 1.6, "wheel_radius_front": 0.34, "wheel_radius_rear": 0.34,
        "longitudinal_stiffness_front": 230e3, "longitudinal_stiffness_rear": 230e3,
        "cornering_stiffness_front": 150e3, "cornering_stiffness_rear": 170e3, "driven_axle": "front",
    },
}  # fmt: skip


def fit_line(log: CheckedLog, vehicle: Vehicle) -> float:
    """Return mass over the slope of slip over accel_x, N; NaN: none.

    Least squares over straight rows above 4 m/s without brakes, as means of 0.6 s.
    """
    front, rear = (
        vehicle.values[f"wheel_radius_{a}"] * log.data[f"wheel_speed_{a}"] for a in ("front", "rear")
    )
    free, driven = (front, rear) if vehicle.driven_axle == "rear" else (rear, front)
    mean = [
        pd.Series(x).rolling(SMOOTH, center=True, min_periods=1).mean()
        for x in (free, driven - free, log.data["accel_x"])
    ]
    v, ahead, pull = (x.to_numpy(float) for x in mean)
    turns = np.abs(
        v * log.data["yaw_rate"].rolling(SMOOTH, center=True, min_periods=1).mean().to_numpy(float)
    )
    use = (v > 4.0) & (pull > -0.1) & (turns < 1.0) & (np.abs(log.data["steer_angle"].to_numpy(float)) < 0.03)
    if use.sum() < MIN_LINE_ROWS:
        return np.nan
    slope = np.polyfit(pull[use], ahead[use] / v[use], 1)[0]
    return float(vehicle.values["mass"] / slope) if slope > 0 else np.nan


def make_start_config(vehicle: Vehicle, log: CheckedLog) -> Config:
    """Return the settings at the start of a calibration."""
    stated = dict(vehicle.values)
    fill_sensors(vehicle, log)
    config = Config.exact(vehicle.values)
    vehicle.values = stated
    setattr(config, SHAPE, get_ordinary_car(config)[SHAPE])
    return config


def calibrate_cars(cars: int, first: int, minutes: float) -> list[list[str]]:
    """Return a row of the table for each car: a calibration on all its drives."""
    drives = [make_logs(road, minutes, cars, first) for road in ROADS]
    rows, errors = [], []
    for i, of_car in enumerate(zip(*drives, strict=True)):
        axle = of_car[0].car.driven_axle
        if axle == "both":
            continue
        vehicle = make_vehicle(dict(of_car[0].vehicle), Path("car.toml"))
        logs = [read_frame(pd.DataFrame(x.log)) for x in of_car]
        config = make_start_config(vehicle, logs[0])
        true = of_car[0].truth["linear_stiffness"][f"cx_{axle}"]
        before = getattr(config, f"longitudinal_stiffness_{axle}")
        mean, sd = estimate_longitudinal(config, {}, logs, vehicle)
        line = np.nanmean([fit_line(log, vehicle) for log in logs])
        found = np.array([before, line, before * np.exp(mean)]) / true - 1.0
        errors.append([*found, abs(np.log1p(found[2])) < 1.96 * sd])
        rows.append([str(i), axle, *(f"{100 * x:+.0f}" for x in found), f"{100 * sd:.0f}"])
    e = np.array(errors, float)
    rms = [f"{100 * x:.1f}" for x in np.sqrt(np.mean(e[:, :3] ** 2, axis=0))]
    return [*rows, ["rms", "", *rms, f"holds {int(e[:, 3].sum())} of {len(e)}"]]


def score_manoeuvre(car: str, name: str, seed: int) -> dict[str, Any]:
    """Return errors of class, line and calibration on a simulated manoeuvre, and the
    sd."""
    about = CARS[car]
    made = tse.simulate(name, make_vehicle(dict(about), Path("car.toml")), seed=seed, duration=SECONDS)
    vehicle = make_vehicle({k: v for k, v in about.items() if "stiffness" not in k}, Path("car.toml"))
    log = read_frame(made.log)
    config = make_start_config(vehicle, log)
    true, before = about["longitudinal_stiffness_front"], config.longitudinal_stiffness_front
    mean, sd = estimate_longitudinal(config, {}, [log], vehicle)
    off = {
        "class": before / true,
        "line": fit_line(log, vehicle) / true,
        "calibrate": before * np.exp(mean) / true,
    }
    held = abs(np.log(off["calibrate"])) < 1.96 * sd
    return {"car": car, "manoeuvre": name, **{k: x - 1.0 for k, x in off.items()}, "sd": sd, "held": held}


def score_straight_road(seed: int) -> list[float]:
    """Return the share of valid rows on ten straight minutes, and of these those 10 %
    off.

    The car is known exactly.
    """
    made = tse.simulate("straight", seed=seed, duration=600.0)
    config = Config.exact({"driven_axle": 1})
    out = NativeFilter(config).estimate_rows(read_frame(made.log).rows())
    valid, error = out["cx_front_valid"] == 0, np.abs(out["cx_front"] - 1.0)
    return [float(valid.mean()), float((error[valid] > OFF).mean()) if valid.any() else 0.0, float(error[-1])]


def main(arguments: list[str]) -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--cars", type=int, default=12)
    parser.add_argument("--first", type=int, default=611, help="seed of the driven cars")
    parser.add_argument("--minutes", type=float, default=6.0, help="of each road")
    parser.add_argument("--seeds", type=int, default=2, help="of each manoeuvre and car")
    parser.add_argument("--straight", type=int, default=20, help="straight drives")
    parser.add_argument("--out", type=Path, default=RESULTS / "along.md")
    given = parser.parse_args(arguments)
    called = f"python -m tests.cars.along {' '.join(arguments)}".strip()
    parts = [
        f"# Longitudinal stiffness\n\n`{called}`\n\n"
        "Errors of the longitudinal stiffness of the driven axle, in %:\n\n"
        "- class: the stiffness of an ordinary car of this mass and these axle distances.\n"
        "- line: a least-squares line through slip over accel_x in straight rows without braking. The\n"
        "  stiffness is the mass over its slope.\n"
        "- calibrate: the regression of `tselab calibrate`. All other parameters keep their prior.\n"
        "- sd: posterior sd of *calibrate*, in %. An sd of 50 is the prior: the log does not show the\n"
        "  stiffness. A dash: no line, or an error above 100 %."
    ]
    runs = [score_manoeuvre(c, m, s) for c in CARS for m in MANOEUVRES for s in range(1, given.seeds + 1)]
    rows = [
        [
            r["car"],
            r["manoeuvre"],
            *(format_error(r[k]) for k in ("class", "line", "calibrate")),
            f"{100 * r['sd']:.0f}",
        ]
        for r in runs
    ]
    shown = [r for r in runs if r["sd"] < SHOWN]
    parts.append(
        f"Simulated manoeuvres of {SECONDS:g} s. The simulated tyres are linear and there is no load "
        "transfer;\nthe vehicle file does not state this. "
        f"{len(shown)} of {len(runs)} drives show the stiffness (sd below {100 * SHOWN:.0f} %).\n"
        f"On these the median error is {100 * np.median([abs(r['calibrate']) for r in shown]):.1f} %, that "
        f"of the line {100 * np.median([abs(r['line']) for r in shown]):.1f} %. The 95 % interval\n"
        f"contains the truth in {sum(r['held'] for r in runs)} of {len(runs)} drives."
    )
    parts.append(
        "\n".join(format_markdown_table(["car", "manoeuvre", "class", "line", "calibrate", "sd"], rows, 2))
    )
    if given.cars:
        table = calibrate_cars(given.cars, given.first, given.minutes)
        parts.append(
            f"Cars of tests/cars from seed {given.first}, calibrated on {given.minutes:g} minutes on each "
            "road:"
        )
        parts.append(
            "\n".join(format_markdown_table(["car", "driven", "class", "line", "calibrate", "sd"], table, 2))
        )
    if given.straight:
        valid, off, last = np.array([score_straight_road(seed) for seed in range(1, given.straight + 1)]).T
        parts.append(
            f"The filter on {given.straight} straight drives of ten minutes, with a car that is known "
            f"exactly: {100 * valid.min():.0f} .. {100 * valid.max():.0f} %\nof the rows are valid. Of the "
            f"valid rows {100 * off.mean():.1f} % have an error above 10 % (worst drive "
            f"{100 * off.max():.0f} %). The\nrms error in the last row is "
            f"{100 * np.sqrt(np.mean(last**2)):.1f} %."
        )
    given.out.write_text("\n\n".join(parts) + "\n", encoding="utf-8")
    print(given.out.read_text(encoding="utf-8"))
    return 0


def format_error(x: float) -> str:
    """Return an error in percent; -: unknown, or above 200 %."""
    return f"{100 * x:+.0f}" if abs(x) < 1.0 else "-"


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
