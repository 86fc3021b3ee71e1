"""README is short, states what scripts/results holds, its program runs, and every path and command it names exists."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np

import tse

ROOT = Path(__file__).resolve().parent.parent
README = (ROOT / "README.md").read_text()


RESULTS = ROOT / "scripts" / "results"


def cells(name: str, row: str) -> list[str]:
    """The first row of a table of scripts/results that begins so."""
    return [
        c.strip() for c in re.search(rf"^\| {re.escape(row)}(.*)\|$", (RESULTS / name).read_text(), re.M)[1].split("|")
    ]


def test_it_can_be_read_in_five_minutes():
    assert README.count("\n") <= 120


def test_its_numbers_are_those_of_scripts_results():
    facts = README.split("| measured |")[1].split("\n\n")[0]
    rms = cells("accuracy.md", "RMS error |")
    assert f"RMS error {', '.join(rms)} %" in facts and "24 runs" in (RESULTS / "accuracy.md").read_text()
    error, valid, off, band = (
        [x.strip() for x in c.split("/")][1:] for c in cells("cars-fresh.md", "all | calibrated |")[:4]
    )
    stated = "cornering {} and {} % off, {} and {} % of rows valid, of these {} and {} % more than 10 % off; {} and {} % within"
    assert stated.format(*error, *valid, *off, *band) in facts
    delay, longest = re.match(r"([\d.]+) \(([\d.]+)\)", cells("regimes-road.md", "road-0.7 | tse | 30 s |")[0]).groups()
    hours, _, false = cells("as-told.md", "as-told | tse |")[:3]
    assert f"detected after {delay} s (longest {longest}); {false} false alarms in {float(hours):.0f} hours" in facts
    time, memory = cells("bench.md", "default |")[0], cells("sizes.md", "`tse_filter`: the default form |")[0]
    assert (
        f"{int(time.split()[0]) / 1000:.0f} us and {int(memory.split()[0].replace(',', '')) / 1000:.0f} kB in double"
        in facts
    )
    gap = (RESULTS / "gap.md").read_text()
    of, share = re.search(r"of (\d+) cases.*?right id in (\d+) %", gap).groups()
    assert f"named in {round(int(of) * int(share) / 100)} of {of} cases" in facts
    assert re.search(r"No name on (12 of 12 clean cars)", gap)[1] in facts


def test_its_program_runs_on_a_log_as_it_says(tmp_path):
    cc = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
    assert cc, "a C compiler is needed"
    shutil.copy(ROOT / "scripts" / "examples" / "first.c", tmp_path)
    two = [sys.executable, ROOT / "scripts" / "amalgamate.py", "--out", "two/tse"]
    subprocess.run(two, cwd=tmp_path, check=True, stdout=subprocess.DEVNULL)
    how = re.search(r"`cc (-O2 -Itwo first.c two/tse/tse.c -lm)`", README)[1]
    subprocess.run([cc, "-o", "first", "-Wall", "-Wextra", "-Werror", *how.split()], cwd=tmp_path, check=True)
    log, truth = tse.simulate("double-lane-change", duration=40)
    log.loc[100:110, "accel_y"] = np.nan  # empty cells are missing, and the header is no row
    log = log.drop(index=range(500, 505))  # nor is the step always the same
    rows = log.to_csv(index=False)
    done = subprocess.run([tmp_path / "first"], input=rows, capture_output=True, text=True, check=True)
    mean, band = map(float, re.match(r"(\d+) \+- (\d+) N/rad: ", done.stdout).groups())
    assert abs(mean - truth["true_cy_front"].iloc[-1]) < band < 0.5 * mean and not done.stderr
    nothing = subprocess.run(
        [tmp_path / "first"], input="time,steer_angle\n", capture_output=True, text=True, check=False
    )
    assert (nothing.returncode, nothing.stdout, nothing.stderr) == (2, "", "no row was used\n")


def test_every_ctest_it_names_exists():
    named = set(re.findall(r"`((?:test_)?[a-z_]+)`", "".join(re.findall(r"ctest (.+?)\|", README))))
    cmake = (ROOT / "tests" / "CMakeLists.txt").read_text()
    assert named >= {"symbols", "test_replay"}
    for name in named - {"release"}:
        assert name in cmake or any((ROOT / "tests" / "unit").rglob(f"{name}.c")), name
