"""Calibrate and estimate the real logs in ../shared/data, if they are there.

    python -m tests.cars.real [--data DIR] [--keep DIR] [--out FILE]

Each log is calibrated whole, and by its first and its second half. Then it is estimated
with each of these, with the vehicle file as it was, and with the calibration of the other
log of the same car, if there is one. The truth of these tyres is unknown: the comparison
is with the measured lateral velocity, if there is one, and between the estimates.
"""

import argparse
import multiprocessing
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from tests.cars.study import RESULTS, count_changes, estimate_log
from tse.calibration import output, workflow
from tse.car.config import make_config
from tse.car.vehicle import read_vehicle
from tse.channels.log import read_log
from tse.library.core import NOMINAL, Config

DATA = Path(__file__).resolve().parents[3] / "shared" / "data"
SAME_CAR = (("genesis_cpg_fast", "genesis_rfs"),)
# whose ref_vel_y is that of the car: the RAV4's is a phone's, as it was mounted
ALIGNED = (*SAME_CAR[0], "stanford_250lm_a")
SETTLED, FAST = 20.0, 8.0  # s, m/s: rows that count
CORNERING = ("cy_front", "cy_rear")


def split_log(path: Path, folder: Path) -> dict[str, Path]:
    """Return the log, and both halves of it as logs."""
    table = pd.read_csv(path)
    parts = {"whole": path}
    for name, rows in (
        ("first half", table.iloc[: len(table) // 2]),
        ("second half", table.iloc[len(table) // 2 :]),
    ):
        parts[name] = folder / f"{path.parent.name}_{name.replace(' ', '_')}.csv"
        rows.to_csv(parts[name], index=False)
    return parts


def calibrate_log(job: tuple[str, Path, str, Path]) -> tuple[str, str, Path, bool]:
    """Return the calibrated vehicle file of a log or half, and whether the search
    converged."""
    name, log, part, folder = job
    result = workflow.run([log], DATA / name / "vehicle.toml", [], 1, lambda _: None)
    path = folder / f"{name}_{part.replace(' ', '_')}.toml"
    output.write(path, result, [log.name])
    return name, part, path, result.fit.converged


def read_posterior(vehicle: Path) -> tuple[str, str]:
    """Return the posterior sd of both cornering stiffnesses, %, and the conditional one.

    The conditional sd is that with all other unknowns known. Both are larger for shorter
    logs and a worse fit of the model.
    """
    known = read_vehicle(vehicle).calibration
    if not known:
        return "-", "-"
    covariance = np.array(known["covariance"])
    at = [known["names"].index(key) for key in CORNERING]
    rest_known = np.linalg.inv(np.linalg.pinv(covariance)[np.ix_(at, at)])
    return tuple(
        " / ".join(f"{100 * np.sqrt(v):.0f}" for v in np.diag(c))
        for c in (covariance[np.ix_(at, at)], rest_known)
    )


def compute_steady_sideslip(config: Config, out: np.ndarray) -> np.ndarray:
    """Return the sideslip of a steady turn without a filter, rad: l_r r/v - F_r/C_r.

    With the stiffness of the vehicle file.
    """
    v, r = np.maximum(out["vel_x"], 1.0), out["yaw_rate"]
    share = config.mass * config.lf / (config.lf + config.lr) / config.cornering_stiffness_rear
    return config.lr * r / v - share * v * r


def find_lively_rows(time: np.ndarray, out: np.ndarray) -> np.ndarray:
    """Return the rows with a lateral acceleration above 1 m/s2 within their last 20 s."""
    across = np.abs(out["vel_x"] * out["yaw_rate"]) > 1.0
    last = np.maximum.accumulate(np.where(across, time, -np.inf))
    return time - last < SETTLED


def make_row(name: str, told: str, vehicle: Path, converged: str) -> dict[str, Any]:
    """Return the estimates of a log with a vehicle file, as a row."""
    log = read_log(DATA / name / "data.csv")
    out, config = estimate_log(vehicle, log)
    handbook, _ = make_config(read_vehicle(DATA / name / "vehicle.toml"), log)
    time = log.time - log.time[0]
    counts = (time > SETTLED) & (out["vel_x"] > FAST)
    end, excited = counts & (time > time[-1] * 2 / 3), counts & find_lively_rows(time, out)
    found: dict[str, Any] = {"log": name, "told": told, "converged": converged}
    found["posterior"], found["rest known"] = read_posterior(vehicle)
    for key in CORNERING:
        nominal = getattr(config, NOMINAL[key]) / 1000.0
        mean, interval = np.median(out[key][end]), 1.96 * np.median(out[f"{key}_sd"][end])
        found[key] = f"{nominal * mean:.0f} +- {nominal * interval:.0f}"
        share = np.mean(out[f"{key}_valid"][excited] == 0) if excited.any() else np.nan
        found[f"{key} valid"] = f"{100 * share:.0f}" if np.isfinite(share) else "-"
    found["changes"] = f"{count_changes(out, time > SETTLED)}"
    found["sideslip"] = found["formula"] = found["interval"] = "-"
    if name in ALIGNED:
        true = np.interp(time - out["estimate_age"], time, log.ref["ref_vel_y"].to_numpy(float))
        counts &= np.isfinite(true)
        off, v = (out["vel_y"] - true)[counts], out["vel_x"][counts]
        found["sideslip"] = f"{np.degrees(np.sqrt(np.mean((off / v) ** 2))):.2f}"
        plain = compute_steady_sideslip(handbook, out)[counts] - true[counts] / v
        found["formula"] = f"{np.degrees(np.sqrt(np.mean(plain**2))):.2f}"
        found["interval"] = f"{100 * np.mean(np.abs(off) < 1.96 * out['vel_y_sd'][counts]):.0f}"
    return found


def main(arguments: list[str]) -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--keep", type=Path, help="keep the calibrated files in this directory")
    parser.add_argument("--jobs", type=int, default=2, help="processes (default: 2)")
    parser.add_argument("--out", type=Path, default=RESULTS / "real.md", help="the table")
    given = parser.parse_args(arguments)
    names = sorted(p.parent.name for p in DATA.glob("*/data.csv"))
    if not names:
        print(f"no logs in {DATA}")
        return 0
    with tempfile.TemporaryDirectory() as scratch, multiprocessing.Pool(given.jobs) as pool:
        folder = given.keep or Path(scratch)
        folder.mkdir(parents=True, exist_ok=True)
        jobs = [
            (n, path, part, folder)
            for n in names
            for part, path in split_log(DATA / n / "data.csv", folder).items()
        ]
        files = {(n, part): (path, done) for n, part, path, done in pool.imap(calibrate_log, jobs)}
        rows = []
        for n in names:
            rows.append(make_row(n, "as in the file", DATA / n / "vehicle.toml", "-"))
            others = [
                other for pair in SAME_CAR if n in pair for other in pair if other != n and other in names
            ]
            parts = [
                (n, "whole", "the log itself"),
                (n, "first half", "its first half"),
                (n, "second half", "its second half"),
            ]
            for of, part, told in [*parts, *((other, "whole", other) for other in others)]:
                path, done = files[of, part]
                rows.append(make_row(n, told, path, "yes" if done else "no"))
    heads = {
        "log": "log", "told": "calibrated on", "converged": "converged",
        "posterior": "sd of the calibration [%]", "rest known": "sd if the rest were known [%]",
        "cy_front": "front [kN/rad]", "cy_front valid": "front valid [%]",
        "cy_rear": "rear [kN/rad]", "cy_rear valid": "rear valid [%]", "changes": "changes reported",
        "sideslip": "rms error of sideslip [deg]", "formula": "rms error of the formula [deg]",
        "interval": "95 % interval of vel_y contains truth [% of rows]",
    }  # fmt: skip
    lines = ["| " + " | ".join(heads.values()) + " |", "|---|---|---" + "|---:" * (len(heads) - 3) + "|"]
    lines += ["| " + " | ".join(r[key] for key in heads) + " |" for r in rows]
    text = f"""# Real logs

`python -m tests.cars.real`

The logs in ../shared/data, estimated with four kinds of vehicle file: *as in the file* (an ordinary
car of its class), and calibrated on the whole log, on each half, and on another log of the same
car. No road changes on these logs.

- sd of the calibration: posterior sd of front / rear cornering stiffness, with the mass of the file.
- sd if the rest were known: the same sd if latencies, steering ratio, inertia and all other fitted
  parameters were known exactly.
- front, rear: cornering stiffness at zero slip with 95 % interval, medians of the last third of the
  log above {FAST:g} m/s.
- valid: share of the rows after {SETTLED:g} s in whose last {SETTLED:g} s the lateral acceleration
  exceeded 1 m/s2.
- formula: sideslip l_r r/v - F_r/C_r with the stiffness of the vehicle file or of the class.
- The reference of vel_y depends on the alignment of its sensor, which was fitted: an error of the
  heading of 0.3 deg is an error of the sideslip of 0.3 deg.

Reference for the 250 LM: a regression with measured sideslip gives front 82 [78 92], rear 121 [114
162] kN/rad (95 % interval in brackets).

"""
    given.out.write_text(text + "\n".join(lines) + "\n", encoding="utf-8")
    print(f"{given.out}: {len(names)} logs")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
