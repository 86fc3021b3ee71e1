"""Estimate longitudinal stiffness with and without brake switch and wheel torques.

    python -m tests.cars.pedals --drives DIR [--out FILE]

DIR: driven cars (tests.cars.study). The switch is on from 50 N of brake force. Torques
have a scale error (sd 7 % for a model of the engine, 10 % for the brakes of each axle),
5 .. 20 N m of noise, and up to 60 ms of latency. *Not said*: the vehicle file has no
driven axle, as for a car whose other axle is driven on demand.
"""

import argparse
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from tests.cars.logs import PEDALS
from tests.cars.sensors import make_pedals
from tests.cars.study import RESULTS, ROADS, estimate_log, format_shares, read_drive, score
from tse.car.vehicle import read_vehicle
from tse.report.tables import format_markdown_table

WAYS = {"none": (), "brake switch": PEDALS[:1], "wheel torques": PEDALS[1:], "both": PEDALS}
KEY = "cx_front"


def score_runs(car: Path) -> list[dict[str, Any]]:
    """Return the scores of a calibrated car on its test drives, a line for each road
    and way."""
    truth, found = json.loads((car / "test" / "truth.json").read_text(encoding="utf-8")), []
    for n, road in enumerate(ROADS):
        log, table, true = read_drive(car / "test", road)
        reference = {c: table[c].to_numpy(float) for c in table}
        logged = make_pedals(truth["sensors"], reference, np.random.default_rng(n))
        axle = truth["driven_axle"]
        for said in (axle,) if axle == "both" else (axle, "not said"):
            options = {"driven_axle": 0} if said == "not said" else None
            for way, names in WAYS.items():
                out, config = estimate_log(
                    car / "calibrated.toml", log, {c: logged[c] for c in names}, options
                )
                found.append({"driven": said, "road": road, "way": way, **score(out, config, log, true)})
    return found


def make_line(name: list[str], group: pd.DataFrame) -> list[str]:
    """Return a group of runs as a row of the table."""
    parts = [
        format_shares(group, what, of, keys=[KEY])
        for what, of in (("valid", "rows"), ("off", "valid"), ("held", "rows"))
    ]
    error = f"{100 * np.nanmedian(group[f'{KEY} error']):.1f}"
    return [*name, str(len(group)), error, *parts, f"{group['changes'].sum():.0f}"]


def main(arguments: list[str]) -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--drives", type=Path, required=True, help="cars as tests.cars.study --keep leaves them"
    )
    parser.add_argument("--first", type=int, default=0, help="leave out cars before this one")
    parser.add_argument("--out", type=Path, default=RESULTS / "pedals.md", help="the table")
    given = parser.parse_args(arguments)
    cars = sorted(p for p in given.drives.glob("car*") if (p / "found.json").is_file())
    table = pd.DataFrame([r for car in cars if int(car.name[3:]) >= given.first for r in score_runs(car)])
    head = (
        "driven axle|road|given|drives|median error [%]|valid [% of rows]|error > 10 % [% of valid rows]|"
        "95 % interval contains truth [% of rows]|changes reported"
    )
    rows = [
        make_line(list(key), group)
        for parts in (table.assign(road="all"), table)
        for key, group in parts.groupby(["driven", "road", "way"], sort=False)
    ]
    lines = format_markdown_table(head.split("|"), rows, 3)
    who = read_vehicle(cars[0] / "fit" / "car.toml").name
    text = f"""# Longitudinal stiffness with brake switch and wheel torques

`python -m tests.cars.study --keep DIR`, `python -m tests.cars.pedals --drives DIR`

{len(cars)} calibrated cars of tests/cars from {who} on. Errors: front longitudinal stiffness compared
with the secant of the row. Rows after 20 s and above 3 m/s are counted.

- Brake switch: on from 50 N of braking force.
- Wheel torques: scale errors with an sd of 7 % (engine) and 10 % (brakes of each axle), 5 .. 20 N m
  of noise, up to 60 ms late.
- driven axle *not said*: the vehicle file does not state the one driven axle, as for a car that
  drives its second axle on demand.
- driven axle *both*: each axle has the share of the torque that it has of the load, within a tenth.
- A car with rear-wheel drive shows the front longitudinal stiffness only while it brakes, when the
  front load is larger than at rest.

"""
    given.out.write_text(text + "\n".join(lines) + "\n", encoding="utf-8")
    print(f"{given.out}: {len(table)} runs")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
