"""The estimator on ordinary cars: logs of the generator, which shares no code with tse, of a car that does what no model was told.

    python -m tests.gap.ordinary [--seeds N] [--first SEED] [--minutes M] [--only CAR ...] [--out FILE]

Every car drives every road; nothing but its nominal values is told: an ordinary car of its class that nobody has calibrated. The
table says how far off, how sure and how often a change of the road was reported that was none.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

import numpy as np
import pandas as pd

from tests.gap.generator import Spec, make_cases
from tests.gap.runs import in_processes
from tselab import regimes
from tselab.config import make_config
from tselab.core import STIFFNESS, Config, Filter
from tselab.log import read_log
from tselab.vehicle import read_vehicle

RESULTS = Path(__file__).resolve().parents[2] / "scripts" / "results"
ROADS = ("highway", "urban", "slalom", "sine_sweep", "steps_fast", "brake_throttle")
CARS: dict[str, dict] = {
    "as modelled": {},
    "body rolls": {"body_roll": 1.0},
    "tyres relax, steering lags": {"relaxation": 1.0, "steering_lag": 1.0},
    "IMU late": {"imu_delay": 1.0},
    "steering late": {"steering_delay": 1.0},
    "all of these": {
        "body_roll": 1.0,
        "relaxation": 1.0,
        "steering_lag": 1.0,
        "imu_delay": 1.0,
        "lateral_load_transfer": 1.0,
    },
}
OFF = 0.1  # relative error from which a valid estimate is wrong
SETTLED = 10.0  # s from which errors count

NOMINAL_OF = dict(
    zip(
        STIFFNESS,
        ("longitudinal_stiffness_front", "cornering_stiffness_front", "cornering_stiffness_rear"),
        strict=True,
    )
)


def score(rows: np.ndarray, config: Config, truth: dict[str, float]) -> dict[str, float]:
    """What one estimator makes of a log: rows; per stiffness those valid, of these those OFF and those whose band holds the truth,
    and the median error; false changes."""
    filter_ = Filter(config)
    out = filter_.outputs(len(rows))
    filter_.step_into(rows, out)
    time = np.cumsum(rows["dt"])
    late = time > SETTLED
    found: dict[str, float] = {"rows": float(late.sum())}
    for key in STIFFNESS:
        nominal = getattr(config, NOMINAL_OF[key])
        error = out[key] * nominal / truth[key] - 1
        sd = out[f"{key}_sd"] * nominal / truth[key]
        valid = (out[f"{key}_valid"] == 0) & late
        found[f"{key} valid"] = float(valid.sum())
        found[f"{key} off"] = float((valid & (np.abs(error) > OFF)).sum())
        found[f"{key} held"] = float((valid & (np.abs(error) < 1.96 * sd)).sum())
        found[f"{key} error"] = np.median(error[late])
    if "change_age" in out.dtype.names:
        told = [*regimes.COLUMNS, *sorted(regimes.SDS)]
        events = pd.DataFrame({"time": time, **{name: out[name] for name in told if name in out.dtype.names}})
        found["changes"] = len(regimes.changes(events))
    return found


def one(job: tuple[str, int, float]) -> list[dict]:
    """A car of a seed on every road."""
    name, seed, minutes = job
    case = next(make_cases([Spec(name, CARS[name], seed, manoeuvres=ROADS, hold_out=(), duration=60 * minutes)]))
    truth = {key: case.car[column] for key, column in NOMINAL_OF.items()}
    done = []
    with tempfile.TemporaryDirectory() as folder:
        case.write(Path(folder))
        for road in ROADS:
            vehicle = read_vehicle(Path(folder) / "car.toml")
            log = read_log(Path(folder) / f"log_{road}.csv")
            config, _ = make_config(vehicle, log)
            rows, given = Filter(config).inputs(len(log)), log.rows()
            for column in rows.dtype.names:
                rows[column] = given[column]
            done.append({"car": name, "seed": seed, "road": road, "who": "tse", **score(rows, config, truth)})
    return done


def table(runs: pd.DataFrame) -> str:
    """The runs as Markdown: a line per car, road and estimator, triples of STIFFNESS."""
    titles = (
        "car",
        "road",
        "estimator",
        "median error [%]",
        "valid [%]",
        "off [%]",
        "interval holds [%]",
        "false changes in 10 min",
    )
    lines = ["| " + " | ".join(titles) + " |", "|" + "---|" * len(titles)]

    def three(values: list[float]) -> str:
        return " / ".join(f"{100 * v:.0f}" if np.isfinite(v) else "-" for v in values)

    def share(group: pd.DataFrame, what: str, of: str) -> str:
        total = [group[of.format(key)].sum() for key in STIFFNESS]
        return three(
            [group[f"{key} {what}"].sum() / n if n else np.nan for key, n in zip(STIFFNESS, total, strict=True)]
        )

    for (car, road, who), group in runs.groupby(["car", "road", "who"], sort=False):
        told = f"{10 * group['changes'].sum() / group['minutes'].sum():.1f}" if group["changes"].notna().any() else "-"
        error = three([group[f"{key} error"].mean() for key in STIFFNESS])
        of = [share(group, what, of) for what, of in (("valid", "rows"), ("off", "{} valid"), ("held", "{} valid"))]
        cells = [car, road, who, error, *of, told]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def main(arguments: list[str]) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=3, help="cars of each kind (default: 3)")
    parser.add_argument("--first", type=int, default=301, help="the first seed (default: 301)")
    parser.add_argument("--minutes", type=float, default=1.0, help="length of each log (default: 1)")
    parser.add_argument("--only", nargs="+", choices=CARS, default=list(CARS), help="these cars")
    parser.add_argument("--jobs", type=int, default=2, help="processes (default: 2)")
    parser.add_argument("--out", type=Path, help="the table; default: the committed one, if no car is left out")
    given = parser.parse_args(arguments)
    jobs = [(car, given.first + i, given.minutes) for car in given.only for i in range(given.seeds)]
    found = in_processes(one, jobs, given.jobs, "car")
    if found is None:
        return 130
    data = pd.DataFrame([row for rows in found for row in rows]).assign(minutes=given.minutes)
    head = f"""# Ordinary cars

`python -m tests.gap.ordinary`: {given.seeds} cars of each kind (seeds from {given.first}), {given.minutes:g} minutes on each road
at 100 Hz; front longitudinal / front cornering / rear cornering; after {SETTLED:g} s. *Valid*: share of the rows; *off*: share of
these that are more than {100 * OFF:.0f} % wrong; *interval holds*: share of these
whose 95 % interval holds the truth. A change of the road counts as `tselab estimate` reports it; there was none.
The error is the mean over the runs. Nobody has calibrated them: all that is not nominal is that of the class.

"""
    text = head + table(data.assign(road="all")) + "\nBy road:\n\n" + table(data)
    out = given.out or (None if len(given.only) < len(CARS) else RESULTS / "ordinary.md")
    if out is None:
        print(text)
        return 0
    out.write_text(text, encoding="utf-8")
    print(f"{out}: {len(data)} runs")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
