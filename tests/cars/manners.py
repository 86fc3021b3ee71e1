"""Cars that nobody has calibrated, and rows that come late: is what is called valid right, and inside its interval?

    python -m tests.cars.manners [--seeds N] [--first SEED] [--calibrated DIR] [--out FILE]

Not calibrated: every manoeuvre of the simulator, whose tyres relax over a length and whose body rolls; the vehicle file says
mass, axles, radii and driven axle. Late rows: mountain drives of the cars that `tests.cars.study --keep DIR` has calibrated, of
whose rows a share comes 0.12 s after the one before instead of 0.02 s, or all come 0.1 s apart with 2 % jitter.
"""

from __future__ import annotations

import argparse
import sys
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from tqdm import tqdm

from tests.cars.study import RESULTS, TRUTH, estimated, truth_of
from tse.impl import maneuvers
from tse.impl.config import make_config
from tse.impl.core import NOMINAL, STIFFNESS, Config, Filter, SimConfig
from tse.impl.logs.log import read_log
from tse.impl.rows import Log
from tse.impl.simulate import simulate
from tse.impl.tables import markdown_table
from tse.impl.vehicle import make_vehicle

RELAXATION, ROLL = (0.0, 0.3, 0.6), (0.0, 0.006, 0.012)  # m; rad s2/m
OFF, SETTLED, SLOW = 0.1, 20.0, 3.0  # relative error; s; m/s
LATE, SHARES = 0.12, (0.0, 0.1, 0.2, 0.3)  # s; of the rows
TENTH, JITTER = 0.1, 0.02  # s between rows; its relative sd


def unknown(name: str, relaxation: float, roll: float, seed: int) -> list[dict[str, Any]]:
    """Return what a filter that knows mass and axles alone makes of a manoeuvre, a row per stiffness."""
    truth = Config({"relaxation_length": relaxation, "body_roll_gain": roll})
    plan = maneuvers.build(name, truth, sample_time=0.01, seed=seed)
    spread = {f"spread_{s}": 0.02 for s in STIFFNESS}
    made = simulate(plan, truth, SimConfig({**spread, "seed": seed, "speed": plan.speed}), "front")
    about = ("mass", "lf", "lr", "wheel_radius_front", "wheel_radius_rear")
    vehicle = make_vehicle({key: getattr(truth, key) for key in about} | {"driven_axle": "front"}, Path("car.toml"))
    config, _ = make_config(vehicle, None)
    filter_ = Filter(config)
    rows = filter_.inputs(len(made.log))
    time = made.log["time"].to_numpy()
    rows["dt"] = np.diff(time, prepend=time[0] - 0.01)
    for column in rows.dtype.names or ():
        if column in made.log:
            rows[column] = made.log[column]
    out = filter_.outputs(len(rows))
    filter_.step_into(rows, out)
    found = []
    for key in STIFFNESS:
        true = getattr(truth, NOMINAL[key])
        error = out[key] * getattr(config, NOMINAL[key]) / true - 1
        interval = 1.96 * out[f"{key}_sd"] * getattr(config, NOMINAL[key]) / true
        valid = out[f"{key}_valid"] == 0
        found.append({"maneuver": name, "stiffness": key, "rows": len(rows), "valid": int(valid.sum()),
                      "off": int((valid & (np.abs(error) > OFF)).sum()), "outside": int((valid & (np.abs(error) > interval)).sum()),
                      "held": int((np.abs(error) < interval).sum())})  # fmt: skip
    return found


def thinned(time: np.ndarray, share: float | None, rng: np.random.Generator) -> np.ndarray:
    """Return the indices of rows that come: at 50 Hz, a share of them late; None: at 10 Hz with jitter."""
    step = float(np.median(np.diff(time)))
    keep, at = [0], 0.0
    while True:
        at += (
            TENTH * (1 + JITTER * rng.standard_normal())
            if share is None
            else LATE
            if rng.random() < share
            else 2 * step
        )
        index = round(at / step)
        if index >= len(time):
            return np.unique(keep)
        keep.append(index)


def late(folder: Path, share: float | None, rng: np.random.Generator, scratch: Path) -> list[dict[str, Any]]:
    """Return the bias of a car's cornering stiffness when rows come late."""
    table = pd.read_csv(folder / "test" / "log_mountain.csv")
    reference = pd.read_csv(folder / "test" / "reference_mountain.csv")
    truth = truth_of({c: reference[c].to_numpy(float) for c in TRUTH.values()})
    table.iloc[thinned(table["time"].to_numpy(), share, rng)].to_csv(scratch, index=False)
    log: Log = read_log(scratch)
    out, config = estimated(folder / "calibrated.toml", log)
    found = []
    for key in ("cy_front", "cy_rear"):
        true = np.interp(log.time - out["estimate_age"], table["time"], truth[key])
        nominal = getattr(config, NOMINAL[key])
        counts = np.isfinite(true) & (log.time > SETTLED) & (out["vel_x"] > SLOW)
        error = (out[key] * nominal / true - 1)[counts]
        interval = (1.96 * out[f"{key}_sd"] * nominal / true)[counts]
        found.append({"rows": "10 Hz, 2 % jitter" if share is None else f"50 Hz, {100 * share:.0f} % late", "stiffness": key,
                      "bias": float(np.median(error)), "valid": float((out[f"{key}_valid"][counts] == 0).mean()),
                      "held": float((np.abs(error) < interval).mean())})  # fmt: skip
    return found


def unknown_table(found: pd.DataFrame) -> list[str]:
    """Return a line per manoeuvre."""
    rows = []

    def of(groups: list[pd.DataFrame], what: str, among: str) -> str:
        shares = [(g[what].sum(), g[among].sum()) for g in groups]
        return " / ".join(f"{100 * a / b:.0f}" if b else "-" for a, b in shares)

    for name, group in [*found.groupby("maneuver", sort=False), ("all", found)]:
        by = [group[group["stiffness"] == key] for key in STIFFNESS]
        pairs = (("valid", "rows"), ("off", "valid"), ("outside", "valid"), ("held", "rows"))
        rows.append([str(name), *(of(by, *pair) for pair in pairs)])
    head = (
        "manoeuvre|valid [%]|valid and > 10 % off [%]|valid and outside the interval [%]|interval holds, all rows [%]"
    )
    return markdown_table(head.split("|"), rows, 5)


def late_table(found: pd.DataFrame) -> list[str]:
    """Return a line per pattern of rows; front / rear, medians of the cars."""
    lines = []
    base = found[found["rows"] == found["rows"].iloc[0]].set_index(["car", "stiffness"])["bias"]
    for name, group in found.groupby("rows", sort=False):
        cells = [str(name)]
        for what in ("bias", "valid", "held"):
            values = []
            for key in ("cy_front", "cy_rear"):
                rows = group[group["stiffness"] == key]
                x = rows[what] - [base[car, key] if what == "bias" else 0.0 for car in rows["car"]]
                values.append(f"{100 * float(x.iloc[np.argmax(np.abs(x))] if what == 'bias' else x.mean()):+.1f}"
                              if what == "bias" else f"{100 * float(x.mean()):.0f}")  # fmt: skip
            cells.append(" / ".join(values))
        lines.append(cells)
    return markdown_table(
        ["rows", "bias less that of all rows in time [%]", "valid [%]", "interval holds [%]"], lines, 4
    )


def main(arguments: list[str]) -> int:
    """Run both studies and write the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=10, help="of each manoeuvre and car (default: 10)")
    parser.add_argument("--first", type=int, default=1, help="the first seed (default: 1)")
    parser.add_argument("--calibrated", type=Path, help="what tests.cars.study --keep has left")
    parser.add_argument("--out", type=Path, default=RESULTS / "manners.md", help="the tables")
    given = parser.parse_args(arguments)
    jobs = list(product(maneuvers.KINDS, RELAXATION, ROLL, range(given.first, given.first + given.seeds)))
    rows = [row for job in tqdm(jobs, unit="run", file=sys.stderr) for row in unknown(*job)]
    text = f"""# Cars that nobody has calibrated, and rows that come late

`python -m tests.cars.manners --seeds {given.seeds} --first {given.first} --calibrated DIR` after
`python -m tests.cars.study --keep DIR`.

## Not calibrated

{len(maneuvers.KINDS)} manoeuvres of the simulator, relaxation {RELAXATION} m, roll {ROLL} rad s2/m, {given.seeds} seeds:
{len(jobs)} runs. The filter knows mass, axles, radii and the driven axle, the rest is of the class. Front longitudinal / front
cornering / rear cornering.

"""
    text += "\n".join(unknown_table(pd.DataFrame(rows))) + "\n"
    if given.calibrated:
        rng, delays = np.random.default_rng(given.first), []
        cars = sorted(p.parent for p in given.calibrated.glob("car*/calibrated.toml"))
        scratch = given.calibrated / "late.csv"
        for folder, share in tqdm(list(product(cars, (*SHARES, None))), unit="drive", file=sys.stderr):
            delays += [{"car": folder.name, **row} for row in late(folder, share, rng, scratch)]
        scratch.unlink()
        text += f"""
## Late rows

{len(cars)} calibrated cars on a mountain road. Front / rear cornering stiffness; bias: the largest of the cars.

"""
        text += "\n".join(late_table(pd.DataFrame(delays))) + "\n"
    given.out.write_text(text, encoding="utf-8")
    print(f"{given.out}: {len(jobs)} runs")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
