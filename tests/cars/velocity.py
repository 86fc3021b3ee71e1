"""Estimate with and without a measured velocity: real logs, and driven cars.

    python -m tests.cars.velocity [--data DIR] [--drives DIR] [--out FILE]

A real log has the velocity of its INS, or GNSS speed and course derived from it. The
sideslip is compared with the same INS, so its noise and mounting are in both. The truth
of a driven car (tests.cars.study) is known. A GNSS comes ten times a second, 0.1 s behind
the gyro, with noise of 0.1 m/s and 0.5 deg; an INS in every row with noise of 0.03 m/s.
"""

import argparse
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from tests.cars.real import DATA
from tests.cars.study import (
    RESULTS,
    ROADS,
    SETTLED,
    count_changes,
    estimate_log,
    format_shares,
    read_drive,
    score,
)
from tse.channels.log import read_log
from tse.library.core import NOMINAL
from tse.log.rows import CheckedLog
from tse.report.tables import format_markdown_table

LATE, RATE, SPEED_SD, COURSE_SD, INS_SD = 0.1, 10.0, 0.1, np.radians(0.5), 0.03
REAL = ("stanford_250lm_a", "genesis_cpg_fast", "genesis_rfs")
CORNERING = ("cy_front", "cy_rear")
WAYS = ("none", "GNSS course", "GNSS speed, course", "INS")
FAST = {"real": 8.0, "car": 3.0}  # m/s: rows that count


def make_columns(
    way: str, log: CheckedLog, vx: np.ndarray, vy: np.ndarray, rate: np.ndarray, clock: float, seed: int
) -> dict[str, np.ndarray]:
    """Return the columns of a velocity sensor.

    vx, vy, rate: true, (rows,). clock: latency of the gyro, s.
    """
    t, random = log.time - log.time[0], np.random.default_rng(seed)
    if way == "none":
        return {}
    if way == "INS":
        noise = INS_SD * random.standard_normal((2, len(t)))
        return {
            "ins_vel_x": np.interp(t - clock, t, vx) + noise[0],
            "ins_vel_y": np.interp(t - clock, t, vy) + noise[1],
        }
    heading = np.append(0.0, np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(t)))
    course = heading + np.arctan2(vy, vx) + random.uniform(-np.pi, np.pi)
    at = np.unique(np.searchsorted(t, np.arange(LATE + clock, t[-1], 1.0 / RATE)))
    then = t[at] - LATE - clock
    found = {name: np.full(len(t), np.nan) for name in ("gnss_speed", "gnss_course")}
    angle = np.interp(then, t, course) + COURSE_SD * random.standard_normal(len(at))
    speed = np.interp(then, t, np.hypot(vx, vy)) + SPEED_SD * random.standard_normal(len(at))
    found["gnss_course"][at], found["gnss_speed"][at] = (
        (angle + np.pi) % (2 * np.pi) - np.pi,
        np.maximum(speed, 0.0),
    )
    return found if way != "GNSS course" else {"gnss_course": found["gnss_course"]}


def make_latencies(columns: dict[str, np.ndarray]) -> dict[str, float]:
    """Return the settings for these columns."""
    return {"velocity_latency": LATE} if "gnss_course" in columns else {}


def score_sideslip(
    out: np.ndarray, log: CheckedLog, vx: np.ndarray, vy: np.ndarray, least: float
) -> dict[str, float]:
    """Return the rms error of the sideslip, deg, and the coverage of the interval of
    vel_y."""
    t = log.time - log.time[0]
    x, y = (np.interp(t - out["estimate_age"], t, v) for v in (vx, vy))
    counts = (t > SETTLED) & (out["vel_x"] > least) & np.isfinite(x) & np.isfinite(y)
    off = (out["vel_y"] - y)[counts]
    slip = np.degrees(off / x[counts])
    holds = np.mean(np.abs(off) < 1.96 * out["vel_y_sd"][counts])
    left_out = np.mean(out["fault_channel"][counts] > 0)
    return {"sideslip": float(np.sqrt(np.mean(slip**2))), "holds": float(holds), "left out": float(left_out)}


def make_real_table(data: Path) -> list[str]:
    head = (
        "log|velocity|front [kN/rad]|rear [kN/rad]|front / rear valid [% of rows]|"
        "rms error of sideslip [deg]|95 % interval of vel_y contains truth [% of rows]"
    )
    lines = []
    for name in (n for n in REAL if (data / n / "data.csv").is_file()):
        log = read_log(data / name / "data.csv")
        known = {c: log.ref[c].to_numpy(float) for c in ("ref_vel_x", "ref_vel_y")} | {
            "r": log.data["yaw_rate"].to_numpy(float)
        }
        vx, vy, rate = (
            np.interp(log.time, log.time[np.isfinite(x)], x[np.isfinite(x)]) for x in known.values()
        )
        t = log.time - log.time[0]
        for way in WAYS:
            # the gyro is what the heading is made of; its bias is in both, and so in
            # neither
            columns = make_columns(way, log, vx, vy, rate, 0.0, 1)
            out, config = estimate_log(data / name / "vehicle.toml", log, columns, make_latencies(columns))
            end = (t > t[-1] * 2 / 3) & (out["vel_x"] > FAST["real"])
            settled = (t > SETTLED) & (out["vel_x"] > FAST["real"])
            cells = [name, way]
            for key in CORNERING:
                nominal = getattr(config, NOMINAL[key]) / 1000.0
                mean, interval = np.median(out[key][end]), 1.96 * np.median(out[f"{key}_sd"][end])
                cells.append(f"{nominal * mean:.0f} +- {nominal * interval:.0f}")
            found = score_sideslip(out, log, known["ref_vel_x"], known["ref_vel_y"], FAST["real"])
            cells += [" / ".join(f"{100 * np.mean(out[f'{k}_valid'][settled] == 0):.0f}" for k in CORNERING)]
            cells += [
                f"{found['sideslip']:.2f}",
                f"{100 * found['holds']:.0f}",
                f"{count_changes(out, t > SETTLED)}",
            ]
            lines.append(cells)
    return format_markdown_table([*head.split("|"), "changes reported"], lines, 2)


def make_car_table(drives: Path) -> list[str]:
    head = (
        "road|vehicle file|velocity|rms error of sideslip [deg]|95 % interval of vel_y contains truth [%]|"
        "median error, front / rear [%]|valid [% of rows]|error > 10 % [% of valid rows]|"
        "95 % interval contains truth [% of rows]|channel at fault [% of rows]"
    )
    found: list[dict[str, Any]] = []
    for car in sorted(p for p in drives.glob("car*") if (p / "calibrated.toml").is_file()):
        clocks = json.loads((car / "test" / "truth.json").read_text(encoding="utf-8"))["logs"]
        for road in ROADS:
            log, reference, truth = read_drive(car / "test", road)
            vx, vy, rate = (
                np.interp(log.time, reference["time"], reference[c]) for c in ("vel_x", "vel_y", "yaw_rate")
            )
            for who, path in (
                ("calibrated", car / "calibrated.toml"),
                ("of its class", car / "fit" / "car.toml"),
            ):
                for way in WAYS:
                    columns = make_columns(way, log, vx, vy, rate, clocks[road]["latency"]["yaw_rate"], 1)
                    out, config = estimate_log(path, log, columns, make_latencies(columns))
                    found.append({"road": road, "who": who, "way": way, **score(out, config, log, truth),
                                  **score_sideslip(out, log, vx, vy, FAST["car"])})  # fmt: skip
    if not found:
        return []
    lines = []
    for (road, who, way), group in pd.DataFrame(found).groupby(["road", "who", "way"], sort=False):
        errors = " / ".join(f"{100 * np.nanmedian(group[f'{k} error']):.1f}" for k in CORNERING)
        sideslips = f"{np.sqrt(np.mean(group['sideslip'] ** 2)):.2f}", f"{100 * group['holds'].mean():.0f}"
        parts = [
            format_shares(group, *of, keys=CORNERING)
            for of in (("valid", "rows"), ("off", "valid"), ("held", "rows"))
        ]
        lines.append([road, who, way, *sideslips, errors, *parts, f"{100 * group['left out'].mean():.1f}"])
    return format_markdown_table(head.split("|"), lines, 3)


def main(arguments: list[str]) -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--data", type=Path, default=DATA, help="the real logs")
    parser.add_argument(
        "--drives", type=Path, help="cars as tests.cars.study --keep leaves them; default: none"
    )
    parser.add_argument("--out", type=Path, default=RESULTS / "velocity.md", help="the table")
    given = parser.parse_args(arguments)
    parts = [make_real_table(given.data), make_car_table(given.drives) if given.drives else []]
    text = """# With and without a measured velocity

`python -m tests.cars.velocity --drives DIR`

Cars are ordinary cars of their class, unless they are marked calibrated.

- GNSS: ten values per second, 0.1 s late, noise sd 0.1 m/s and 0.5 deg. INS: a value in every row,
  noise sd 0.03 m/s.
- Real logs: the velocity is made from the INS of the log. The sideslip is compared with the same
  INS. front, rear: cornering stiffness at zero slip with 95 % interval, medians of the last third.
- If both wheel speeds are copies of one signal, as on the real logs, the filter does not use the
  longitudinal speed.

References for the 250 LM, from measured sideslip:

- regression, brush tyre, at zero slip: front 82 [78 92], rear 121 [114 162] kN/rad (95 % interval in
  brackets);
- linear regression below 4 m/s2: front 68 [64 73], rear 105 [99 113] kN/rad.

An extended Kalman filter of 40 lines with brush tyres and friction 1, for comparison: 75, 125 kN/rad
and an rms error of the sideslip of 0.66 deg; with GNSS course 86, 151 kN/rad and 0.35 deg.

"""
    given.out.write_text(text + "\n\n".join("\n".join(p) for p in parts if p) + "\n", encoding="utf-8")
    print(f"{given.out}: written")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
