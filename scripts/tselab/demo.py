"""The demonstration: simulate, estimate, compare; everything left in one directory."""

from __future__ import annotations

import contextlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from tselab import maneuvers
from tselab.config import make_config
from tselab.core import STIFFNESS, Config, SimConfig
from tselab.errors import UserError
from tselab.estimate import Estimate, estimate, write_table
from tselab.files import atomic
from tselab.log import read_log
from tselab.report import write_report
from tselab.simulate import simulate, with_references
from tselab.tables import example_vehicle
from tselab.vehicle import read_vehicle
from tselab.verdict import NAMES

DURATION, ROAD_CHANGE = 72.0, (36.0, 0.7)
SETTLED, LAST = 10.0, 12.0  # s: what the summary looks at
START = 0.8  # of nominal
FORGETTING = 0.98


@dataclass
class Demo:
    est: Estimate
    truth: pd.DataFrame
    files: list[str]


def run_demo(out: Path, seed: int = 1, progress: bool = False) -> Demo:
    """Write vehicle, filter settings, log, truth, estimates, report and picture."""
    out.mkdir(parents=True, exist_ok=True)
    with atomic(out / "vehicle.toml") as file:
        file.write(example_vehicle())
    with atomic(out / "filter.toml") as file:
        file.write("# a wrong start, to see it being found\n" + "".join(f"initial_{s} = {START}\n" for s in STIFFNESS))
        file.write("\n# half the default memory: follows the road sooner, knows a steady one less well\n")
        file.write(f"forgetting = {FORGETTING}\n")
    vehicle = read_vehicle(out / "vehicle.toml")
    config = Config(vehicle.values)
    maneuver = maneuvers.build(
        "double-lane-change", config, sample_time=config.sample_time, duration=DURATION, road=[ROAD_CHANGE]
    )
    simulation = simulate(maneuver, config, SimConfig({"seed": seed}), vehicle.driven_axle, progress)
    write_table(with_references(simulation), out / "log.csv")
    write_table(simulation.truth, out / "truth.csv")

    log = read_log(out / "log.csv")
    config, notes = make_config(vehicle, log, out / "filter.toml", {"seed": seed})
    est = estimate(log, config, progress)
    write_table(est.table, out / "est.csv")
    write_report(out / "report.html", est, log, vehicle, config, notes + log.notes)
    files = ["vehicle.toml", "filter.toml", "log.csv", "truth.csv", "est.csv", "report.html"]
    with contextlib.suppress(UserError):  # matplotlib is optional
        from tselab.figures import demo_picture

        demo_picture(out / "demo.png", est.table, simulation.truth, simulation.log)
        files.append("demo.png")
    return Demo(est, simulation.truth, files)


def summary(demo: Demo, out: Path) -> str:
    """Five lines."""
    table = demo.est.table
    time, end = table["time"].to_numpy(), table["time"].iloc[-1]
    lines = [
        f"Double lane changes, {end:.0f} s; at {ROAD_CHANGE[0]:g} s all stiffness drops to {100 * ROAD_CHANGE[1]:.0f} %."
    ]
    parts = {
        f"from {SETTLED:g} s to the change": (time >= SETTLED) & (time < ROAD_CHANGE[0]),
        f"in the last {LAST:g} s": time > end - LAST,
    }
    for key in STIFFNESS:
        true = demo.truth[f"true_{key}"].to_numpy()[: len(table)]
        valid = table[f"{key}_valid"].to_numpy() == 1
        error = table[key].to_numpy() / true - 1
        texts = [
            f"{100 * np.sqrt(np.mean(error[p & valid] ** 2)):.1f} % {name}"
            for name, p in parts.items()
            if (p & valid).any()
        ]
        lines.append(
            f"{NAMES[key]}: RMS error {', '.join(texts) or 'unknown'}; valid {100 * valid.mean():.0f} % of the time"
        )
    lines.append(f"Written to {out}: {', '.join(demo.files)}")
    return "\n".join(lines)
