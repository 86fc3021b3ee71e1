#!/usr/bin/env python3
"""Run the Monte-Carlo studies whose tables README quotes and put tables and pictures into scripts/results.

    .venv/bin/python scripts/studies.py [--jobs J] [STUDY ...]     all of them: about six hours on two busy cores

Each study goes on where it was interrupted (build/studies/NAME); after a change of the library start with --restart.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
RESULTS = ROOT / "scripts" / "results"
TSELAB = ROOT / ".venv" / "bin" / "tselab"
PICTURES = ("fig1", "fig2", "fig3-4", "particles", "bound")

# what is run under another name: all of a study, or some of its cases
PART: dict[str, tuple[str, str]] = {
    "nominal": ("stress", "nominal"),
    "as-told": ("as-told", "as-told"),
    "stress": (
        "stress",
        "nominal,paper-prior,vy-start,noise-3x,noise-third,wheel-noise-told,wheel-noise-untold,outliers,"
        "imu-bias,low-excitation,low-excitation-250,highway,road-0.3,spread-1,spread-5,spread-15,"
        "forgetting-0.98,forgetting-0.99,forgetting-0.995,forgetting-0.999,dropout-steer_angle,"
        "dropout-wheel_speed_front,dropout-wheel_speed_rear,dropout-accel_x,dropout-accel_y,dropout-yaw_rate,"
        "stuck-steer_angle,stuck-wheel_speed_front,stuck-wheel_speed_rear",
    ),
    "stress-more": (
        "stress",
        "stuck-accel_x,stuck-accel_y,stuck-yaw_rate,stop-and-go,reverse,wheel-lock,wheel-spin,mass+10,mass-10,"
        "sample-5ms,sample-10ms,sample-20ms,sample-40ms",
    ),
    "regimes-road": ("regimes", "road-0.7,road-0.3"),
}

# study: runs of each case
STUDIES: dict[str, int] = {
    "nominal": 1000,
    "stress": 50,
    "stress-more": 50,
    "peers": 20,
    "departures": 50,
    "regimes": 10,
    "regimes-road": 100,
    "as-told": 600,
    "bound": 24,
    "particles": 4,
    "fig1": 1,
    "fig2": 100,
    "fig3-4": 1,
}


def run(name: str, runs: int, jobs: int, restart: bool) -> None:
    out = ROOT / "build" / "studies" / name
    study, cases = PART.get(name, (name, ""))
    only = ["--cases", cases] if cases else []
    command = [TSELAB, "montecarlo", "--study", study, "--runs", str(runs), "--jobs", str(jobs), "--out", out, *only]
    subprocess.run([*command, *(["--restart"] if restart else [])], check=True, stdout=subprocess.DEVNULL)
    shutil.copy(out / f"{study}.md", RESULTS / f"{name}.md")
    if name in PICTURES:
        shutil.copy(out / f"{study}.png", RESULTS / f"{name}.png")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("studies", nargs="*", choices=[*STUDIES, []], metavar="STUDY", help=", ".join(STUDIES))
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--restart", action="store_true", help="discard runs made with another library")
    options = parser.parse_args()
    for name in options.studies or STUDIES:
        print(f"{name}: {STUDIES[name]} runs of each case", flush=True)
        run(name, STUDIES[name], options.jobs, options.restart)
    return 0


if __name__ == "__main__":
    sys.exit(main())
