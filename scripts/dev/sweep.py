#!/usr/bin/env python3
"""Measure how much results of a study change if a constant of the filter is halved or
doubled.

    .venv/bin/python scripts/dev/sweep.py --cars DIR [--runs N] [NAME ...]
        by default all constants of src/tables/constants.toml;
        table: scripts/results/constants.md

Each value is compiled into a library of its own with a changed copy of
tables/constants.h. This library and the one in use run on the same drives. A result
counts as changed if the 95 % interval of the ratio of the RMS errors, run by run, does
not contain 1. DIR: output of `tests.cars.study --keep DIR` and `tests.cars.events
--calibrated DIR`.
"""

import argparse
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
from tqdm import tqdm

import tables
from tse.channels.log import read_log
from tse.library.core import STIFFNESS, Config, Library, find_library
from tse.library.files import write_atomically
from tselab.montecarlo import estimators, studies
from tselab.montecarlo.case import START, Case, CaseDrive, simulate_case
from tselab.montecarlo.scores import find_rows_inside

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))
from tests.cars import ROADS, events, study  # noqa: E402

TABLE = ROOT / "scripts" / "results" / "constants.md"
CASES = (
    ("stress", "nominal"),
    ("stress", "noise-3x"),
    ("stress", "road-0.3"),
    ("stress", "stuck-accel_y"),
    ("regimes", "slow-20"),
)
ON_CARS = ("cornering off [%]", "longitudinal off [%]", "false changes an hour", "wrong after an event [s]")
FACTORS = (0.5, 2.0)


def read_constants() -> list[tuple[str, float, str, str, str]]:
    """Return name, value, unit, reason and test of each constant."""
    sections = tables.read("constants").values()
    return [
        (n, r["value"], r["unit"], r["why"], r["test"]) for section in sections for n, r in section.items()
    ]


def build_library(name: str, factor: float) -> Library:
    """Return the library with one constant scaled."""
    folder = ROOT / "build" / "sweep"
    folder.mkdir(parents=True, exist_ok=True)
    value = next(r[1] for r in read_constants() if r[0] == name)
    header = (ROOT / "src" / "tables" / "constants.h").read_text(encoding="utf-8")
    changed = header.replace(f" {name} TSE_R({value!r})", f" {name} TSE_R({value * factor!r})")
    assert changed != header, name
    first = folder / "constants.h"  # its guard hides the file of src/tables
    first.write_text(changed, encoding="utf-8")
    flags = f"-include {first}"
    options = [
        "-DCMAKE_BUILD_TYPE=Release",
        "-DBUILD_SHARED_LIBS=ON",
        "-DTSE_MAX_PARTICLES=4096",
        "-DTSE_BUILD_TESTS=OFF",
        "-DTSE_BUILD_FMU=OFF",
        f"-DCMAKE_C_FLAGS={flags}",
    ]
    for command in (
        ["cmake", "-S", ROOT, "-B", folder, *options],
        ["cmake", "--build", folder, "--parallel", "2"],
    ):
        subprocess.run([str(c) for c in command], check=True, capture_output=True)
    made = next(f for f in folder.rglob(find_library().name) if f.is_file())
    kept = folder / f"{name}-{factor:g}{made.suffix}"
    kept.write_bytes(made.read_bytes())
    return Library(kept)


def compute_rms(case: Case, d: CaseDrive, lib: Library | None) -> tuple[np.ndarray, np.ndarray]:
    """Return RMS error and coverage of the three stiffnesses in the windows of a case.

    The error is in %; coverage is the share of rows within the 95 % interval, %.
    """
    settings = {**START, **d.about}
    config = Config.exact(settings, lib=lib)
    out = estimators.run_estimator("tse", d, config)
    here = find_rows_inside(d.time, case.windows)
    error = np.column_stack([out[s] for s in STIFFNESS])[here] / d.stiffness[here] - 1
    sd = np.column_stack([out[f"{s}_sd"] for s in STIFFNESS])[here] / d.stiffness[here]
    return 100 * np.sqrt((error**2).mean(0)), 100 * (np.abs(error) < 1.96 * sd).mean(0)


def compare_rms(base: np.ndarray, now: np.ndarray) -> str:
    """Return the ratio of the pooled RMS errors, with a mark if it differs from 1.

    The interval of the ratio is a bootstrap over the runs.
    """
    a, b = np.sqrt((base**2).mean(1)), np.sqrt((now**2).mean(1))
    rng = np.random.default_rng(1)
    picks = rng.integers(len(a), size=(2000, len(a)))
    ratios = np.sqrt((b[picks] ** 2).mean(1) / (a[picks] ** 2).mean(1))
    low, high = np.quantile(ratios, (0.025, 0.975))
    ratio = np.sqrt((b**2).mean() / (a**2).mean())
    return f"{ratio:.2f}" + ("" if low <= 1 <= high else " *")


class Cars:
    """Calibrated cars of an earlier study, on drives without and with an event."""

    def __init__(self, folder: Path):
        self.calm, self.events = [], []
        for car in sorted(folder.glob("car*")):
            for road in ROADS:
                log = read_log(car / "test" / f"log_{road}.csv")
                reference = pd.read_csv(car / "test" / f"reference_{road}.csv")
                truth = study.compute_truth({c: reference[c].to_numpy(float) for c in study.TRUTH.values()})
                self.calm.append((car / "calibrated.toml", log, truth))
        for job in events.drive(folder, len(list(folder.glob("car*"))), 0, 0.0):
            self.events.append(job)

    def format_scores(self, lib: Library | None) -> str:
        """Return ON_CARS as cells of a table."""
        runs = [
            study.score(*study.estimate_log(path, log, lib=lib), log, truth) for path, log, truth in self.calm
        ]
        total = {key: sum(run[key] for run in runs) for key in runs[0]}
        across = [total[f"{k} {what}"] for what in ("off", "valid") for k in STIFFNESS[1:]]
        along = [total[f"{STIFFNESS[0]} {what}"] for what in ("off", "valid")]
        found = [row for job in self.events for row in events.score_event(job, lib)]
        wrong = [row["wrong"] for row in found if row["stiffness"] != STIFFNESS[0]]
        cells = [100 * sum(across[:2]) / max(sum(across[2:]), 1), 100 * along[0] / max(along[1], 1)]
        cells += [total["changes"] / total["hours"], float(np.mean(wrong)) if wrong else np.nan]
        return " | ".join(f"{c:.1f}" for c in cells)


def main() -> int:
    """Sweep and write the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("names", nargs="*", help="constants (default: all that name a test)")
    parser.add_argument("--runs", type=int, default=4)
    parser.add_argument("--cars", type=Path, required=True, help="kept cars, calibrated")
    args = parser.parse_args()
    table = {r[0]: r for r in read_constants()}
    if unknown := [n for n in args.names if n not in table]:
        print(
            f"sweep: no constant is named {', '.join(unknown)}; see src/tables/constants.toml",
            file=sys.stderr,
        )
        return 2
    names = args.names or [n for n, row in table.items() if row[4] != "-"]
    cases = [studies.make_study(s).case(c) for s, c in CASES]
    drives = [
        [
            simulate_case(c, seed, lambda about: Config.exact({**START, **about}), {})
            for seed in range(1, args.runs + 1)
        ]
        for c in cases
    ]
    base = [np.array([compute_rms(c, d, None)[0] for d in ds]) for c, ds in zip(cases, drives, strict=True)]
    cars = Cars(args.cars)
    columns = [*(c.name for c in cases), *ON_CARS]
    head = f"""# What halving and doubling a constant does

Simulated cases: ratio of the RMS error (three stiffnesses pooled) to that with the value
as it is, {args.runs} runs of each on the same drives; `*`: the 95 % interval of the ratio
(bootstrap over runs) does not contain 1. Calibrated cars with 14 degrees of freedom,
{len(cars.calm)} drives without and {len(cars.events)} with an event: share of the valid rows
that are more than 10 % off; false changes; mean time in the minute after an event for which
a cornering stiffness is valid and more than 20 % off, s.
Command: `.venv/bin/python scripts/dev/sweep.py --cars DIR --runs {args.runs}`."""
    lines = [
        head,
        "",
        "| constant | value | unit | by | " + " | ".join(columns) + " |",
        "|---|---:|---|---:|" + "---:|" * len(columns),
    ]
    lines.append("| as it is | | | 1 | " + "1 | " * len(cases) + cars.format_scores(None) + " |")
    for name in tqdm(names, desc="sweep", file=sys.stderr, leave=False):
        for factor in FACTORS:
            lib = build_library(name, factor)
            cells = []
            for c, ds, b in zip(cases, drives, base, strict=True):
                cells.append(compare_rms(b, np.array([compute_rms(c, d, lib)[0] for d in ds])))
            cells.append(cars.format_scores(lib))
            lines.append(
                f"| {name} | {table[name][1]} | {table[name][2]} | {factor:g} | " + " | ".join(cells) + " |"
            )
    if args.names:
        print("\n".join(lines))
    else:
        with write_atomically(TABLE) as file:
            file.write("\n".join(lines) + "\n")
        print(TABLE)
    return 0


if __name__ == "__main__":
    sys.exit(main())
