"""Estimate an uncalibrated car in the simulator's manoeuvres: errors and intervals.

    python -m tests.cars.uncalibrated [--seeds N] [--first SEED] [--jobs J] [--out FILE]

The car is one of its class (tse_config_default) with relaxation and roll of the table,
and a stiffness of each axle that differs from that of the class. Or it is the car of the
default settings, whose yaw inertia differs, too. Truth: stiffness at no slip of the
simulator.
"""

import argparse
import sys
from concurrent.futures import ProcessPoolExecutor
from itertools import product
from pathlib import Path

import numpy as np
import pandas as pd
from tqdm import tqdm

from tests.cars.study import OFF, RESULTS, SETTLED, SLOW, format_shares
from tse.car.config import make_config
from tse.car.vehicle import make_filter_values, make_vehicle
from tse.channels.log import read_frame
from tse.library.core import NOMINAL, STIFFNESS, Config, NativeFilter, SimConfig
from tse.report.tables import format_markdown_table
from tse.simulation import maneuvers
from tse.simulation.simulate import simulate

RELAXATION, ROLL = (0.0, 0.3, 0.6), (0.0, 0.006, 0.012)  # m; rad per m/s2
CAR = {
    "mass": 1500.0,
    "lf": 1.2,
    "lr": 1.5,
    "wheel_radius_front": 0.32,
    "wheel_radius_rear": 0.32,
    "driven_axle": "front",
}
SPREAD = 0.2  # sd of ln of the true stiffness over that of the class
MIN_MANEUVER_TIME = 40.0  # s: what a shorter manoeuvre lasts here


CARS = ("one of its class", "the car of the default settings")
FACTS = ("mass", "lf", "lr", "wheel_radius_front", "wheel_radius_rear")


def score_manoeuvre(job: tuple[str, float, float, int, str]) -> dict[str, float | str]:
    """Simulate a manoeuvre; count rows with an estimate, valid, wrong, outside the
    interval."""
    maneuver, relaxation, roll, seed, which = job
    effects, rng = (
        {"relaxation_length": relaxation, "body_roll_gain": roll},
        np.random.default_rng([seed, 71]),
    )
    of_class = which == CARS[0]
    facts = (
        CAR if of_class else {key: getattr(Config.exact(), key) for key in FACTS} | {"driven_axle": "front"}
    )
    vehicle = make_vehicle(dict(facts), Path("car.toml"))
    car = Config.exact((make_filter_values(vehicle) if of_class else {}) | effects)
    factor = {key: float(np.exp(SPREAD * rng.standard_normal())) if of_class else 1.0 for key in STIFFNESS}
    sim = SimConfig({f"true_{key}": value for key, value in factor.items()} | {"seed": seed})
    duration = max(MIN_MANEUVER_TIME, maneuvers.MANEUVERS[maneuver].duration)
    plan = maneuvers.build(maneuver, car, sample_time=0.01, duration=duration, seed=seed)
    log = read_frame(simulate(plan, car, sim).log)
    config, _ = make_config(vehicle, log)
    out = NativeFilter(config).estimate_rows(log.rows())
    counts = (log.time > SETTLED) & (out["vel_x"] > SLOW)
    found: dict[str, float | str] = {
        "car": which,
        "maneuver": maneuver,
        "relaxation": relaxation,
        "roll": roll,
    }
    for key in STIFFNESS:
        true = factor[key] * getattr(car, NOMINAL[key]) / getattr(config, NOMINAL[key])
        error = out[key][counts] - true
        valid = out[f"{key}_valid"][counts] == 0
        outside = np.abs(error) > 1.96 * out[f"{key}_sd"][counts]
        found |= {f"{key} rows": counts.sum(), f"{key} valid": valid.sum(), f"{key} outside": outside.sum()}
        found |= {f"{key} off": (valid & (np.abs(error) > OFF * true)).sum()}
        found |= {f"{key} valid outside": (valid & outside).sum()}
    return found


def make_table(runs: pd.DataFrame, by: str) -> list[str]:
    """Return Markdown, a line for each value of `by`."""
    pairs = (("valid", "rows"), ("off", "valid"), ("valid outside", "valid"), ("outside", "rows"))
    rows = [
        [str(v), *(format_shares(g, what, of) for what, of in pairs)] for v, g in runs.groupby(by, sort=False)
    ]
    title = {"relaxation": "relaxation length [m]", "roll": "roll gain [rad per m/s2]"}.get(by, by)
    head = (
        f"{title}|valid [% of rows]|error > {100 * OFF:.0f} % [% of valid rows]|"
        "truth outside 95 % interval [% of valid rows]|truth outside 95 % interval [% of rows]"
    )
    return format_markdown_table(head.split("|"), rows, 5)


def main(arguments: list[str]) -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=10, help="of each case (default: 10)")
    parser.add_argument("--first", type=int, default=1, help="the first seed (default: 1)")
    parser.add_argument("--jobs", type=int, default=2, help="processes (default: 2)")
    parser.add_argument("--out", type=Path, default=RESULTS / "cars-uncalibrated.md", help="the table")
    given = parser.parse_args(arguments)
    seeds = range(given.first, given.first + given.seeds)
    jobs = list(product(maneuvers.MANEUVERS, RELAXATION, ROLL, seeds, CARS))
    with ProcessPoolExecutor(given.jobs) as pool:
        runs = pd.DataFrame(
            tqdm(pool.map(score_manoeuvre, jobs, chunksize=4), total=len(jobs), unit="run", file=sys.stderr)
        )
    lengths, rolls = (", ".join(map(str, x)) for x in (RELAXATION, ROLL))
    head = f"""# Not calibrated

`python -m tests.cars.uncalibrated --seeds {given.seeds} --first {given.first}`

{len(runs)} runs of the simulator of tse: {len(maneuvers.MANEUVERS)} manoeuvres x relaxation length
{lengths} m x roll gain {rolls} rad per m/s2 x {given.seeds} seeds x two cars:

- *{CARS[0]}*: each stiffness is that of the class times its own random factor (sd of the
  logarithm: {SPREAD:g}).
- *{CARS[1]}*: stiffness and yaw inertia differ from those of the class.

The filter has mass, axle distances, wheel radii and driven axle. All other parameters are those of
the class. Cells with three numbers: front longitudinal / front cornering / rear cornering
stiffness. Rows after {SETTLED:g} s and above {SLOW:g} m/s are counted.
"""
    text = head
    for which, mine in runs.groupby("car", sort=False):
        parts = ("all", "maneuver", "relaxation", "roll")
        text += f"\n## {which[0].upper()}{which[1:]}\n"
        text += "".join("\n" + "\n".join(make_table(mine.assign(all="all"), by)) + "\n" for by in parts)
    given.out.write_text(text, encoding="utf-8")
    print(f"{given.out}: {len(runs)} runs")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
