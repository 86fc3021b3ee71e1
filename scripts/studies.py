#!/usr/bin/env python3
"""Run the Monte-Carlo studies whose tables README quotes and put tables and pictures into scripts/results.

    .venv/bin/python scripts/studies.py [--jobs J] [STUDY ...]     all of them

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
PICTURES = ("paper",)

# what is run under another name: all of a study, or some of its cases
PART: dict[str, tuple[str, str]] = {
    "false-alarms": ("false-alarms", "false-alarms"),
    "regimes-road": ("regimes", "road-0.7,road-0.3"),
}

# study: runs of each case
STUDIES: dict[str, int] = {
    "accuracy": 24,
    "stress": 24,
    "peers": 20,
    "regimes-road": 24,
    "false-alarms": 24,
    "paper": 200,
    "robust": 16,
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
