#!/usr/bin/env python3
"""Write the golden estimates anew from drive.csv and the present core.

    python3 tests/replay/update.py            prints what moved, and by how much
    python3 tests/replay/update.py --drive    also records a new drive with the simulator

The files are golden_double.csv, golden_float.csv and golden_fixed.csv. Only a C compiler
is needed ($CC, else cc). A new drive is rarely wanted.

drive.csv is a recorded drive of 30 s at 10 ms from the simulator: standstill,
acceleration with torque steps, two lane changes, braking to a stop, a little backwards.
It has lost channels, lost inputs, lost rows and one reading out of range. The golden
files hold the filter's output. They have a hash of every bit of every output for each
form (default, robust, paper, the default of an uncalibrated car) and resampling scheme,
and every 25th row of the default in digits.

tests/unit/estimator/test_replay.c compares. The hash must be the same for every compiler,
optimisation level, vector width and sanitizer. The digits show what moved and where. A
change that is meant to move the estimates updates the golden files, and its commit
message states why and by how much.
"""

import argparse
import os
import shlex
import subprocess
import tempfile
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
FLAGS = "-std=c99 -O2 -ffp-contract=off -fno-math-errno -fno-trapping-math -Wall -Wextra"


def compile_program(real, folder):
    program = Path(folder) / f"update_{real}"
    sources = [HERE / "update.c", *sorted((ROOT / "src").rglob("*.c"))]
    command = [*shlex.split(os.environ.get("CC", "cc")), *FLAGS.split(), f"-DTSE_REAL_{real.upper()}=1"]
    command += [f"-I{ROOT / 'include'}", f"-I{ROOT / 'src'}", *map(str, sources), "-o", str(program), "-lm"]
    subprocess.run(command, check=True)
    return program


def get_output(*command):
    return subprocess.run([str(c) for c in command], check=True, capture_output=True, text=True).stdout


def read_table(text):
    lines = [line.split(",") for line in text.splitlines() if line and not line.startswith("#")]
    return lines[0][1:], [[float(x) for x in line[1:]] for line in lines[1:]]


def report_changes(name, before, after):
    if before == after:
        print(f"{name}: unchanged")
        return
    print(f"{name}: changed")
    if not before:
        return
    (names, old), (new_names, new) = read_table(before), read_table(after)
    if names != new_names or len(old) != len(new):
        print("  other columns or rows")
        return
    moved = [max(abs(a[k] - b[k]) for a, b in zip(old, new, strict=True)) for k in range(len(names))]
    for column, most in zip(names, moved, strict=True):
        if most:
            print(f"  {column:18s} by up to {most:.3g}")
    if not any(moved):
        print("  in its comments or hashes only: no printed digit moved")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--drive", action="store_true", help="record a new drive.csv first")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        programs = {real: compile_program(real, folder) for real in ("double", "float", "fixed")}
        if args.drive:
            (HERE / "drive.csv").write_text(get_output(programs["double"], "drive"))
        for real, program in programs.items():
            path = HERE / f"golden_{real}.csv"
            before = path.read_text() if path.exists() else ""
            after = get_output(program, "golden", HERE / "drive.csv")
            path.write_text(after)
            report_changes(path.name, before, after)


if __name__ == "__main__":
    main()
