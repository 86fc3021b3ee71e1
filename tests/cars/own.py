"""Estimate an uncalibrated car with and without a calibration on the log itself.

    python -m tests.cars.own --keep DIR --first SEED [--cars N] [--out FILE]

The calibration is that of tse/calibration/own.py, on cars of a study and on real logs.
The manoeuvres of the simulator (uncalibrated.py) are too short or too straight for it.
DIR: that of `python -m tests.cars.study --keep DIR`. Only the vehicle file of `cars.py`
is known.
"""

import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from tqdm import tqdm

from tests.cars import ROADS
from tests.cars.real import DATA
from tests.cars.real import make_row as real_row
from tests.cars.study import SETTLED, make_parser, make_table, read_drive, score
from tse.calibration import own
from tse.car.config import make_config
from tse.car.vehicle import Vehicle, make_filter_values, read_vehicle
from tse.channels.log import read_log
from tse.library.core import Config, NativeFilter
from tse.log.rows import CheckedLog
from tse.report.tables import format_markdown_table

CLASS, ITSELF, OTHERS = "not calibrated", "on the log itself", "on other logs"
# of the posterior sd: what the prior of the stiffness could be; inf: the sd of the class
SHARES = (0.5, 0.7, np.inf)
AXLES = ("cy_front", "cy_rear")


def calibrate_on_log(vehicle: Vehicle, log: CheckedLog) -> Vehicle:
    """Return the car of `tselab estimate`: calibrated on the log, or of its class."""
    return own.calibrate_once(vehicle, [log]).apply_to(vehicle)


def make_config_with_share(vehicle: Vehicle, log: CheckedLog, share: float) -> Config:
    """Return settings with a share of the posterior sd as prior, up to that of the
    class."""
    config, _ = make_config(vehicle, log)
    ordinary = make_filter_values(Vehicle(None, "", dict(vehicle.values), dict(vehicle.facts)))
    for key in AXLES:
        name = f"initial_{key}_sd"
        config.set(name, min(share * getattr(config, name), ordinary[name]))
    return config


def format_share(share: float) -> str:
    """Return the name of a share of the posterior sd."""
    return "... with the sd of the class" if share == np.inf else f"... with {share:g} of its sd"


def score_cars(folder: Path, count: int) -> pd.DataFrame:
    """Return a row for each drive and way of calibration."""
    rows: list[dict[str, Any]] = []
    others = sum((folder / f"car{k}" / "calibrated.toml").exists() for k in range(count))
    for k, road in tqdm([(k, r) for k in range(count) for r in ROADS], unit="log", file=sys.stderr):
        car = folder / f"car{k}"
        log, _, truth = read_drive(car / "test", road)
        stated = read_vehicle(car / "fit" / "car.toml")
        itself = calibrate_on_log(stated, log)
        ways: dict[str, Callable[[], Config]] = {
            CLASS: lambda stated=stated, log=log: make_config(stated, log)[0],
            ITSELF: lambda itself=itself, log=log: make_config(itself, log)[0],
            **{
                format_share(s): lambda v=itself, log=log, s=s: make_config_with_share(v, log, s)
                for s in SHARES
            },
        }
        if (other := car / "calibrated.toml").exists():
            ways[f"{OTHERS}, {others} cars"] = lambda other=other, log=log: make_config(
                read_vehicle(other), log
            )[0]
        for who, made in ways.items():
            config = made()
            rows.append(
                {
                    "car": k,
                    "road": road,
                    "who": who,
                    "used": bool(itself.calibration),
                    **score(NativeFilter(config).estimate_rows(log.rows()), config, log, truth),
                }
            )
    return pd.DataFrame(rows)


def make_real_table(scratch: Path) -> list[str]:
    """Return the real logs as Markdown, before and after."""
    lines = []
    for name in sorted(p.parent.name for p in DATA.glob("*/data.csv")):
        path = DATA / name / "vehicle.toml"
        stated, log = read_vehicle(path), read_log(DATA / name / "data.csv")
        made = own.calibrate_once(stated, [log])
        files = {CLASS: path}
        if made.text:
            files[ITSELF] = scratch / f"{name}.toml"
            files[ITSELF].write_text(made.text, encoding="utf-8")
        for who, file in files.items():
            r = real_row(name, who, file, "")
            found = made.found.get("stiffness", {}) if who == ITSELF else {}
            said = ", ".join(
                f"{s['value'] / 1e3:.0f} ({s['low'] / 1e3:.0f} .. {s['high'] / 1e3:.0f})"
                for s in found.values()
            )
            if who == CLASS and not made.text:
                said = made.found["why"]
            keys = ("cy_front", "cy_front valid", "cy_rear", "cy_rear valid", "changes", "sideslip")
            lines.append([name, who, *(r[key] for key in keys), said])
    head = (
        "log|calibrated on|front [kN/rad]|front valid [%]|rear [kN/rad]|rear valid [%]|changes reported|"
        "rms error of sideslip [deg]"
    )
    return format_markdown_table(
        [*head.split("|"), "calibrated stiffness at zero slip, front, rear [kN/rad]"], lines, 2
    )


def main(arguments: list[str]) -> int:
    parser = make_parser(__doc__, "own.md")
    given = parser.parse_args(arguments)
    runs = score_cars(given.keep, given.cars)
    with tempfile.TemporaryDirectory() as scratch:
        real = make_real_table(Path(scratch))
    used = int(runs[runs["who"] == ITSELF]["used"].sum())
    text = f"""# Calibrated on the log itself

`python -m tests.cars.own --keep DIR --cars {given.cars} --first {given.first}` after
`python -m tests.cars.study --cars {given.cars} --first {given.first} --keep DIR`

Estimates of `tselab estimate` for cars of which only mass, axle distances, wheel radii and driven
axle are known.

- *{CLASS}*: option `--no-calibrate`, an ordinary car of its class.
- *{ITSELF}*: the default. The posterior of the calibration is the prior of the cornering
  stiffness.
- *... with 0.5 of its sd*: the prior has this share of the posterior sd. *... with the sd of the
  class*: the prior has the posterior mean and the sd of the class.
- *{OTHERS}*: `tselab calibrate` on one drive on each road, for comparison, with the first cars.

A prior that is narrower than the posterior makes the intervals too narrow. With a wider prior the
filter estimates the stiffness again from the same rows, and adds errors of its own.

## Cars with 14 degrees of freedom

{given.cars} cars, one drive on each of {", ".join(ROADS)}. The calibration was used in {used} of
{given.cars * len(ROADS)} drives. Cells with three numbers: front longitudinal / front cornering /
rear cornering stiffness. Rows after {SETTLED:g} s are counted. The columns are explained in
[cars](cars-fresh.md); errors are relative to the secant.

"""
    text += "\n".join(make_table(runs.assign(road="all"))) + "\n\nBy road:\n\n" + "\n".join(make_table(runs))
    text += """

## Real logs

Cells as in [real logs](real.md). Valid: share of the rows in whose last 20 s the lateral
acceleration exceeded 1 m/s2. Reference for the 250 LM: a regression with measured sideslip gives
front 82 [78 92], rear 121 [114 162] kN/rad (95 % interval in brackets).

"""
    text += "\n".join(real)
    given.out.write_text(text + "\n", encoding="utf-8")
    print(f"{given.out}: {given.cars} cars")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
