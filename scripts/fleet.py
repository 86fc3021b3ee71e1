#!/usr/bin/env python3
"""What tselab fleet takes beside single runs.

    .venv/bin/python scripts/fleet.py [--logs 24] [--minutes 10] [--cars 4] [--jobs 2]

writes scripts/results/fleet.md. Logs are made in a temporary folder. 24 logs of 10 minutes take some minutes; 600 are 100 hours.
That a cluster gives the same table, and loses no log with a worker: tests/lab/test_fleet.py. An hour of log: scripts/long_logs.py.
"""

import argparse
import os
import shutil
import subprocess
import tempfile
from pathlib import Path

import pandas as pd
from measured import ENV, TSELAB, measured

ROOT = Path(__file__).resolve().parent.parent
RESULT = ROOT / "scripts" / "results" / "fleet.md"


def write_drive(path: Path, minutes: float, seed: int, rate: float = 100.0) -> None:
    """Double lane changes in the built-in car."""
    from tse.impl import maneuvers
    from tse.impl.core import Config, SimConfig
    from tse.impl.estimate import write_table
    from tse.impl.simulate import simulate

    path.parent.mkdir(parents=True, exist_ok=True)
    plan = maneuvers.build("double-lane-change", Config(), sample_time=1.0 / rate, duration=60.0 * minutes)
    write_table(simulate(plan, Config(), SimConfig({"seed": seed})).log, path)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--logs", type=int, default=24)
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--cars", type=int, default=4)
    parser.add_argument("--jobs", type=int, default=2)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        lines = measure(Path(scratch), asked)
    RESULT.write_text("\n".join(lines) + "\n", encoding="utf-8")
    print("\n".join(lines))


def measure(folder: Path, asked: argparse.Namespace) -> list[str]:
    car = folder / "car.toml"
    car.write_text(subprocess.run([*TSELAB, "vehicle", "--simulated"], env=ENV, capture_output=True, text=True, check=True).stdout)
    first = folder / "first.csv"
    write_drive(first, asked.minutes, 1)
    logs = [folder / "logs" / f"car{i % asked.cars}" / f"2024-05-01_{i:04d}.csv" for i in range(asked.logs)]
    for path in logs:  # one drive, as often as asked: what is measured does not depend on what is driven
        path.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(first, path)
    half = asked.logs // 2
    wall = busy = 0.0
    for i in range(half):
        more = measured(
            *TSELAB, "estimate", logs[i], "--vehicle", car, "--out", folder / "e.parquet", "--report", folder / "r.html"
        )
        wall, busy = wall + more.clock, busy + more.busy
    fleet = [*TSELAB, "fleet", folder / "logs", "--vehicle", car]
    _, fleet_wall, fleet_busy, _ = measured(*fleet, "--out", folder / "one", "--jobs", asked.jobs, "--estimates")
    again = measured(*fleet, "--out", folder / "one", "--jobs", asked.jobs, "--estimates").clock
    table = pd.read_parquet(folder / "one" / "fleet.parquet")
    if table["log"].nunique() != asked.logs or table["error"].notna().any():
        raise SystemExit("a log is missing")
    load = os.getloadavg()[0]
    return [
        f"<!-- Written by `scripts/fleet.py --logs {asked.logs} --minutes {asked.minutes:g} --cars {asked.cars} "
        f"--jobs {asked.jobs}`. -->",
        "",
        f"Logs of {asked.minutes:g} min at 100 Hz of {asked.cars} cars, each with its report and its estimates as Parquet; "
        f"{os.cpu_count()} cores, load {load:.1f} at the end: above {asked.jobs} others worked there, too, and times by the clock "
        "are longer than alone.",
        "",
        "| What | clock | processor |",
        "|---|---:|---:|",
        f"| `tselab estimate` of {half} logs, one after the other | {wall:.0f} s | {busy:.0f} s |",
        f"| `tselab fleet` of {asked.logs} logs, {asked.jobs} processes | {fleet_wall:.0f} s | {fleet_busy:.0f} s |",
        f"| ... over that | {fleet_wall / wall:.2f} | {fleet_busy / busy:.2f} |",
        f"| `tselab fleet` again, nothing to do | {again:.1f} s | |",
    ]


if __name__ == "__main__":
    main()
