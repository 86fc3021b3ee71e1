"""Calibrate ordinary cars, and estimate them on other drives (README.md).

    python -m tests.cars.study [--cars N] [--first SEED] [--minutes M] [--jobs J]
        [--keep DIR] [--out FILE]

Only the vehicle file of `cars.py` is known. Truth: axle force over slip of the row,
median over two seconds.
"""

import argparse
import json
import multiprocessing
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from tqdm import tqdm

from tests.cars import ROADS, make_cars, make_logs
from tests.cars.cars import Car
from tests.cars.logs import MIN_ANGLE
from tse.calibration import output, workflow
from tse.calibration.result import CalibrationResult
from tse.car.config import make_config
from tse.car.vehicle import read_vehicle
from tse.channels.log import read_log
from tse.identify.unknowns import LATENCY_SUFFIX
from tse.library.core import NOMINAL, STIFFNESS, Config, Library, NativeFilter
from tse.log.rows import CheckedLog
from tse.report.tables import format_markdown_table

RESULTS = Path(__file__).resolve().parents[2] / "scripts" / "results"
TRUTH = {"cx_front": "cx_front_tyre", "cy_front": "cy_front_steered", "cy_rear": "cy_rear_axle"}
OFF, SETTLED, SLOW, SMOOTH = 0.1, 20.0, 3.0, 201  # relative error; s; m/s; rows
MIN_RELAXATION_SPEED = 0.5  # m/s: no relaxation is slower
PRIOR = {"cx_front": "cx", "cy_front": "cy_front", "cy_rear": "cy_rear"}
CONSTANT = "constant of the calibration"
BEST = "best constant, from the truth"
TYRES = "calibrated, rear tyres alone"
AT_REST = "calibrated, beside the stiffness at no slip"
RELAXED = "calibrated, beside the secant without relaxation"
SEEN = 0.1  # share of the rows of SMOOTH that must have a truth


# What a calibration finds, and what that is in truth.json; sensors' scales and places
# stand there, too.
PHYSICAL = {
    "yaw_inertia": "yaw_inertia",
    "relaxation_length": "relaxation_y",
    "wheel_radius_front": "radius_front",
    "wheel_radius_rear": "radius_rear",
    "imu_lever_arm_x": "imu_x",
    "imu_lever_arm_y": "imu_y",
    "imu_misalignment_angle": "imu_yaw",
    "imu_scale_ax_error": "accel_x_scale",
    "imu_scale_ay_error": "accel_y_scale",
    "gyro_scale_error": "yaw_rate_scale",
}
RELATIVE = ("yaw_inertia", "relaxation_length", "wheel_radius_front", "wheel_radius_rear")
STIFF = {  # of an axle with steering and suspension: linear_stiffness of truth.json
    "longitudinal_stiffness_front": "cx_front", "longitudinal_stiffness_rear": "cx_rear",
    "cornering_stiffness_front": "cy_front_effective", "cornering_stiffness_rear": "cy_rear_effective",
}  # fmt: skip


def compute_truth(reference: dict[str, np.ndarray], smooth: int = SMOOTH) -> dict[str, np.ndarray]:
    """Return the secant stiffness of each row, a running median; NaN: no slip."""
    least = round(SEEN * smooth)
    return {
        key: pd.Series(reference[column]).rolling(smooth, center=True, min_periods=least).median().to_numpy()
        for key, column in TRUTH.items()
    }


def relax_truth(reference: pd.DataFrame, truth: dict[str, Any]) -> dict[str, np.ndarray]:
    """Return the secants of compute_truth() over the relaxed slip angle of the tyres.

    Over the slip angle of the wheels, the force is late by relaxation length over speed.
    In a corner of a town this is a tenth of a second, and no stiffness.

    truth: truth.json of the drive
    """
    made = {column: reference[column].to_numpy(float) for column in TRUTH.values()}
    time, speed = (
        reference["time"].to_numpy(float),
        np.maximum(reference["vel_x"].to_numpy(float), MIN_RELAXATION_SPEED),
    )
    for axle, column in (("front", TRUTH["cy_front"]), ("rear", TRUTH["cy_rear"])):
        force, known = reference[f"fy_{axle}"].to_numpy(float), np.isfinite(made[column])
        angle = np.interp(time, time[known], force[known] / made[column][known])
        stiff = truth["linear_stiffness"]  # compliance beside the tyre acts at once
        length = truth["parameters"]["relaxation_y"] * stiff[f"cy_{axle}_effective"] / stiff[f"cy_{axle}"]
        share = -np.expm1(-np.diff(time, prepend=time[0]) * speed / length)
        late = np.zeros(len(angle))
        for k in range(1, len(angle)):
            late[k] = late[k - 1] + share[k] * (angle[k] - late[k - 1])
        large = known & (np.abs(late) > MIN_ANGLE)
        made[column] = np.where(large, force / np.where(large, late, 1.0), np.nan)
    return compute_truth(made)


def read_drive(
    folder: Path, road: str, smooth: int = SMOOTH
) -> tuple[CheckedLog, pd.DataFrame, dict[str, np.ndarray]]:
    """Return a kept drive: log, reference, and secants of compute_truth()."""
    reference = pd.read_csv(folder / f"reference_{road}.csv")
    truth = compute_truth({c: reference[c].to_numpy(float) for c in TRUTH.values()}, smooth)
    return read_log(folder / f"log_{road}.csv"), reference, truth


def estimate_log(
    vehicle_path: Path,
    log: CheckedLog,
    columns: dict[str, np.ndarray] | None = None,
    options: dict[str, float] | None = None,
    lib: Library | None = None,
) -> tuple[np.ndarray, Config]:
    """Return the estimates of a log by row, and the settings, as `tselab estimate` has
    them.

    columns: optional ones, in place of the log's own; lib: another build.
    """
    if columns is not None:
        log = replace(log, extra=pd.DataFrame(columns))
    config, _ = make_config(read_vehicle(vehicle_path), log, options=options)
    if lib:
        config = Config.exact(config.as_dict(), lib=lib)
    return NativeFilter(config).estimate_rows(log.rows()), config


def make_constant_estimates(vehicle_path: Path, log: CheckedLog) -> tuple[np.ndarray, Config]:
    """Return estimates that are the stiffness of the vehicle file in every row.

    They are always valid, with the sd of the prior.
    """
    out, config = estimate_log(vehicle_path, log)
    for key in STIFFNESS:
        out[key] = out[f"{key}_secant"] = 1.0
        out[f"{key}_sd"] = getattr(config, f"initial_{PRIOR[key]}_sd")
        out[f"{key}_valid"] = 0
    out["change_kind"] = out["change_age"] = out["p_fault"] = 0
    return out, config


def find_best_constant(
    vehicle_path: Path, log: CheckedLog, stiffness: dict[str, float]
) -> tuple[np.ndarray, Config]:
    """Return the best constant: the median of the car's true secants, without an
    interval.

    Its error is the change of the secant with slip, load and the lag of the steering.
    """
    out, config = make_constant_estimates(vehicle_path, log)
    for key, true in stiffness.items():
        out[key] = out[f"{key}_secant"] = true / getattr(config, NOMINAL[key])
        out[f"{key}_sd"] = np.nan
    return out, config


def count_changes(out: np.ndarray, counts: np.ndarray) -> int:
    """Return the number of reported changes of road or axle."""
    age = out["change_age"][counts]  # 0 before the first
    return int(((age[1:] > 0) & ((age[:-1] == 0) | (age[1:] < age[:-1]))).sum())


def score(
    out: np.ndarray, config: Config, log: CheckedLog, truth: dict[str, np.ndarray], of: str = "_secant"
) -> dict[str, float]:
    """Score estimates by stiffness.

    Counts of rows: with a truth, valid, valid and wrong, inside their interval. Also
    changes and rows at fault.

    of: "_secant" for a truth that is a secant, "" for the stiffness at no slip
    """
    time = log.time - log.time[0]
    counts = (time > SETTLED) & (out["vel_x"] > SLOW)
    found: dict[str, float] = {
        "hours": float(counts.mean() * time[-1] / 3600),
        "changes": count_changes(out, counts),
    }
    found["fault"] = float((out["p_fault"][counts] > 0.5).mean())
    for key in STIFFNESS:
        true = np.interp(time - out["estimate_age"], time, truth[key])
        nominal = getattr(config, NOMINAL[key])
        known = np.isfinite(true) & counts
        value = out[f"{key}{of}"] * nominal / true
        error = value - 1
        valid = known & (out[f"{key}_valid"] == 0)
        interval = 1.96 * out[f"{key}_sd"] / out[key] * value
        found[f"{key} rows"] = float(known.sum())
        found[f"{key} valid"] = float(valid.sum())
        found[f"{key} off"] = float((valid & (np.abs(error) > OFF)).sum())
        found[f"{key} held"] = (
            float((known & (np.abs(error) < interval)).sum()) if np.isfinite(interval).any() else np.nan
        )
        found[f"{key} error"] = float(np.median(np.abs(error[known]))) if known.any() else np.nan
    return found


def drive(folder: Path, cars: list[Car], minutes: float, first: int) -> None:
    """Write logs of all cars, side by side: FOLDER/car<k>/fit and test, one for each
    road."""
    for n, road in enumerate(ROADS):
        for what, seed in (("fit", 2 * n), ("test", 2 * n + 1)):
            print(f"driving: {road}, {what}", file=sys.stderr)
            for k, made in enumerate(make_logs(road, minutes, cars=cars, seed=1000 * first + seed)):
                made.write(folder / f"car{k}" / what, road)


def compare_numbers(car: str, result: CalibrationResult, truth: dict[str, Any]) -> list[dict[str, Any]]:
    """Return found less true numbers of the car, in units of the truth where RELATIVE."""
    rows, true = [], truth["parameters"] | truth["sensors"]
    for f in (f for f in result.findings if f.name in PHYSICAL):
        by = true[PHYSICAL[f.name]] if f.name in RELATIVE else 1.0
        off = (f.value - true[PHYSICAL[f.name]]) / by
        before = (f.prior - true[PHYSICAL[f.name]]) / by
        rows.append(
            {"car": car, "name": f.name, "off": off, "before": before, "sd": f.sd / by, "shown": f.shown}
        )
    found = output.collect_settings(result)
    for name, key in STIFF.items():
        both = truth["linear_stiffness"][key]
        before = getattr(result.config, name) / both - 1
        rows.append(
            {
                "car": car,
                "name": name,
                "off": found[name] / both - 1,
                "before": before,
                "sd": None,
                "shown": True,
            }
        )
    return rows


def calibrate(folder: Path) -> dict[str, Any]:
    """Calibrate a car on FOLDER/fit; write calibrated.toml, and found and true in
    found.json."""
    logs = sorted((folder / "fit").glob("log_*.csv"))
    result = workflow.run(logs, folder / "fit" / "car.toml", [], 1, lambda _: None)
    output.write(folder / "calibrated.toml", result, [p.name for p in logs])
    truth_of_car = json.loads((folder / "fit" / "truth.json").read_text(encoding="utf-8"))
    drives = truth_of_car["logs"].values()
    latencies = []
    for f in (f for f in result.findings if f.name.endswith(LATENCY_SUFFIX)):
        channel = f.name.removesuffix(LATENCY_SUFFIX)
        true = float(np.mean([d["latency"][channel] - d["latency"]["yaw_rate"] for d in drives]))
        latencies.append(
            {
                "car": folder.name,
                "channel": channel,
                "true": true,
                "found": f.value,
                "sd": f.sd,
                "shown": bool(f.shown),
            }
        )
    found = {
        "converged": bool(result.fit.converged),
        "latencies": latencies,
        "physical": compare_numbers(folder.name, result, truth_of_car),
    }
    (folder / "found.json").write_text(json.dumps(found, default=float), encoding="utf-8")
    return found


def run_car(
    job: tuple[Path, bool],
) -> tuple[list[dict[str, Any]], list[dict[str, Any]], list[dict[str, Any]]]:
    """Calibrate a car, or take an earlier calibration, and estimate its drives in
    FOLDER/test."""
    folder, again = job
    before = folder / "found.json"
    found = json.loads(before.read_text(encoding="utf-8")) if again and before.exists() else calibrate(folder)
    assumed, calibrated = folder / "fit" / "car.toml", folder / "calibrated.toml"
    scores, logs, truths, alone, late = [], {}, {}, {}, {}
    truth_of_car = json.loads((folder / "test" / "truth.json").read_text(encoding="utf-8"))
    for road in ROADS:
        logs[road], reference, truths[road] = read_drive(folder / "test", road)
        alone[road] = reference["cy_rear_tyre"].to_numpy(float)
        late[road] = relax_truth(reference, truth_of_car)
    linear = truth_of_car["linear_stiffness"]
    middle = {
        key: float(np.nanmedian(np.concatenate([t[key] for t in truths.values()]))) for key in STIFFNESS
    }
    for road, log in logs.items():
        for who, (out, config) in (
            (BEST, find_best_constant(calibrated, log, middle)),
            (CONSTANT, make_constant_estimates(calibrated, log)),
            ("not calibrated", estimate_log(assumed, log)),
            ("calibrated", estimate_log(calibrated, log)),
        ):
            run = {"car": folder.name, "road": road, "who": who, "converged": found["converged"]}
            scores.append({**run, **score(out, config, log, truths[road])})
        tyres = truths[road] | {
            "cy_rear": compute_truth(dict.fromkeys(TRUTH.values(), alone[road]))["cy_rear"]
        }
        scores.append({**run, "who": TYRES, **score(out, config, log, tyres)})
        scores.append({**run, "who": RELAXED, **score(out, config, log, late[road])})
        rest = {
            k: np.where(np.isfinite(t), linear[STIFF[NOMINAL[k]]], np.nan) for k, t in truths[road].items()
        }
        scores.append({**run, "who": AT_REST, **score(out, config, log, rest, "")})
    return scores, found["latencies"], found["physical"]


def make_table(runs: pd.DataFrame) -> list[str]:
    """Return runs as Markdown, a line for each road and estimator."""

    lines = []
    for (road, who), group in runs.groupby(["road", "who"], sort=False):
        medians = [100 * float(np.nanmedian(group[f"{k} error"])) for k in STIFFNESS]
        cells = [road, who, " / ".join(f"{m:.1f}" for m in medians)]
        cells += [
            format_shares(group, what, of)
            for what, of in (("valid", "rows"), ("off", "valid"), ("held", "rows"))
        ]
        lines.append(
            [
                *cells,
                f"{group['changes'].sum() / group['hours'].sum():.1f}",
                f"{100 * group['fault'].mean():.1f}",
            ]
        )
    head = (
        f"road|estimator|median error [%]|valid [% of rows]|error > {100 * OFF:.0f} % [% of valid rows]|"
        "95 % interval contains truth [% of rows]|false changes per hour|rows with sensor fault [%]"
    )
    return format_markdown_table(head.split("|"), lines, 6)


def format_shares(
    group: pd.DataFrame, what: str, of: str, digits: int = 0, keys: Sequence[str] = STIFFNESS
) -> str:
    """Return the percentage of the rows `of` that are `what`, by stiffness; a dash: no
    rows."""
    parts = [(group[f"{k} {what}"].sum(min_count=1), group[f"{k} {of}"].sum()) for k in keys]
    return " / ".join(f"{100 * a / b:.{digits}f}" if b and np.isfinite(a) else "-" for a, b in parts)


def make_latency_table(found: pd.DataFrame) -> list[str]:
    """Return the errors of latencies, a line for each channel."""
    rows = []
    for channel, group in found.groupby("channel", sort=False):
        shown = group[group["shown"]]
        error = (shown["found"] - shown["true"]).abs()
        holds = 100 * float((error < 1.96 * shown["sd"]).mean())
        within = [f"{100 * float((error < limit).mean()):.0f}" for limit in (0.002, 0.005)]
        count, middle = f"{len(shown)} of {len(group)}", f"{1000 * float(error.median()):.1f}"
        rows.append([channel, count, middle, *within, f"{holds:.0f}"])
    head = (
        "channel|determined in|median error [ms]|error < 2 ms [%]|error < 5 ms [%]|"
        "95 % interval contains truth [%]"
    )
    return format_markdown_table(head.split("|"), rows)


def make_physical_table(found: pd.DataFrame) -> list[str]:
    """Return the errors of the car, a line for each number."""
    rows = []
    for name, group in found.groupby("name", sort=False):
        percent = name in RELATIVE or name in STIFF
        cells = [f"{name}{' [%]' if percent else ''}", f"{int(group['shown'].sum())} of {len(group)}"]
        for what in ("before", "off"):
            off = group[what].abs() * (100 if percent else 1)
            cells.append(f"{off.median():.2g}, {off.max():.2g}")
        holds = (group["off"].abs() < 1.96 * group["sd"])[group["sd"].notna()]
        rows.append([*cells, f"{100 * float(holds.mean()):.0f}" if len(holds) else "-"])
    head = (
        "parameter|determined in|error before: median, max|error after: median, max|"
        "95 % interval contains truth [%]"
    )
    return format_markdown_table(head.split("|"), rows)


def make_parser(about: str | None, table_file: str) -> argparse.ArgumentParser:
    """Return the parser of a study on kept cars. about: docstring; table_file: default
    output."""
    parser = argparse.ArgumentParser(description=about, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--keep", type=Path, required=True, help="that of python -m tests.cars.study")
    parser.add_argument("--cars", type=int, default=4, help="so many of its cars (default: 4)")
    parser.add_argument("--first", type=int, required=True, help="the first seed of those cars")
    parser.add_argument("--out", type=Path, default=RESULTS / table_file, help="the table")
    return parser


def main(arguments: list[str]) -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--cars", type=int, default=8, help="how many (default: 8)")
    parser.add_argument("--first", type=int, default=501, help="the first seed (default: 501)")
    parser.add_argument("--minutes", type=float, default=4.0, help="length of each log (default: 4)")
    parser.add_argument("--jobs", type=int, default=2, help="processes (default: 2)")
    parser.add_argument(
        "--keep", type=Path, help="keep the logs in this directory; those of an earlier run are used again"
    )
    parser.add_argument(
        "--again", action="store_true", help="with --keep: the calibrations of an earlier run"
    )
    parser.add_argument("--out", type=Path, default=RESULTS / "cars-fresh.md", help="the table")
    given = parser.parse_args(arguments)
    scores, latencies, cars_found = [], [], []
    with tempfile.TemporaryDirectory() as scratch, multiprocessing.Pool(given.jobs) as pool:
        folder = given.keep or Path(scratch)
        cars = make_cars(given.cars, given.first)
        if not (folder / "car0").exists():
            drive(folder, cars, given.minutes, given.first)
        jobs = [(folder / f"car{k}", given.again) for k in range(given.cars)]
        for rows, late, found in tqdm(pool.imap(run_car, jobs), total=len(jobs), unit="car", file=sys.stderr):
            scores += rows
            latencies += late
            cars_found += found
            print(
                "",
                *make_table(pd.DataFrame(rows)),
                *make_latency_table(pd.DataFrame(late)),
                sep="\n",
                file=sys.stderr,
            )
    runs, late = pd.DataFrame(scores), pd.DataFrame(latencies)
    converged = int(runs.groupby("car")["converged"].first().sum())
    head = f"""# Ordinary cars with 14 degrees of freedom, calibrated

`python -m tests.cars.study --cars {given.cars} --first {given.first} --minutes {given.minutes:g}`

{given.cars} simulated cars. Each is calibrated on one drive of {given.minutes:g} minutes on each of
{", ".join(ROADS)}, and estimated on another drive on each road. {converged} of {given.cars}
calibrations converged. Cells with three numbers: front longitudinal / front cornering / rear
cornering stiffness. Rows after {SETTLED:g} s and above {SLOW:g} m/s are counted.

- Truth: force over the slip angle (or slip) of the wheels in the same row (*secant*). Some
  estimators below are compared with another truth.
- median error: median of the absolute error over the rows of a log, then over the logs.
- valid: share of the rows whose true stiffness is known.
- error > {100 * OFF:.0f} %: share of the valid rows.
- 95 % interval contains truth: share of the rows whose true stiffness is known.
- false changes, rows with sensor fault: nothing happens on these drives, so that every reported
  change and fault is false.
- *{CONSTANT}*: no filter. The stiffness of the calibrated vehicle file in every row.
- *{BEST}*: no filter. The median of the true secants of the car in every row. Its error is the
  variation of the secant.
- *{TYRES}*: truth: the rear tyres without the compliance of the suspension. It differs from the
  secant of the axle by -5 .. 10 %. No sensor shows this difference.
- *{AT_REST}*: output `stiffness`; truth: the axle at static load and zero slip.
- *{RELAXED}*: truth: force over the slip angle after relaxation.

"""
    text = (
        head
        + "\n".join(make_table(runs.assign(road="all")))
        + "\n\nBy road:\n\n"
        + "\n".join(make_table(runs))
    )
    text += "\n\nLatencies relative to the gyro, over the cars whose logs determine them:\n\n" + "\n".join(
        make_latency_table(late)
    )
    text += (
        "\n\nErrors of the parameters before the calibration (values of the vehicle file or of the class) "
        "and after it,\nmedian and maximum of all cars, in SI units or %. Stiffness: of an axle at static "
        "load and zero slip.\n\n"
    )
    given.out.write_text(
        text + "\n".join(make_physical_table(pd.DataFrame(cars_found))) + "\n", encoding="utf-8"
    )
    print(f"{given.out}: {given.cars} cars")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
