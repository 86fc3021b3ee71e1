#!/usr/bin/env python3
"""Measure how results change if a constant of the filter is halved or doubled.

    .venv/bin/python scripts/dev/sweep.py --cars DIR [--runs N]
        change, one at a time, each constant of src/tables/constants.toml whose `test` is
        not "-"; write scripts/results/constants.md
    .venv/bin/python scripts/dev/sweep.py --cars DIR [--runs N] NAME ...
        change these constants only; print the table

For each halved or doubled constant, a library is built and run on the same drives as the
unchanged library. On simulated cases, the table has the RMS error of the stiffnesses
with the changed constant / RMS error with the unchanged constant. The ratio is marked by
`*` if its 95 % interval does not contain 1. DIR is the folder to which `tests.cars.study
--keep DIR` and then `tests.cars.events --calibrated DIR` have written the drives of
calibrated cars.
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
from tselab.montecarlo.case import INITIAL_SETTINGS, Case, CaseDrive, simulate_case
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
# columns of the table with results on calibrated cars
ON_CARS = (
    "cornering error > 10 % [% of valid rows]",
    "longitudinal error > 10 % [% of valid rows]",
    "false changes per hour",
    "valid, cornering error > 20 %, after an event [s]",
)
FACTORS = (0.5, 2.0)  # factors by which each constant is multiplied, one after the other


def read_constants() -> list[tuple[str, float, str, str, str]]:
    """Return name, value, unit, reason and test of each constant."""
    sections = tables.read("constants").values()
    return [
        (n, r["value"], r["unit"], r["why"], r["test"]) for section in sections for n, r in section.items()
    ]


def build_library(name: str, factor: float) -> Library:
    """Build and load the library with one constant multiplied by a factor."""
    folder = ROOT / "build" / "sweep"
    folder.mkdir(parents=True, exist_ok=True)
    value = next(r[1] for r in read_constants() if r[0] == name)
    header = (ROOT / "src" / "tables" / "constants.h").read_text(encoding="utf-8")
    changed = header.replace(f" {name} TSE_R({value!r})", f" {name} TSE_R({value * factor!r})")
    assert changed != header, name
    # The compiler option -include inserts the changed header before each source. Its
    # include guard is that of the original header, which the compiler therefore skips.
    first = folder / "constants.h"
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
    """Run the filter on a drive. Return RMS error and coverage of each stiffness.

    The RMS error is in % of the true stiffness. The coverage [%] is the share of rows
    whose 95 % interval contains the true stiffness. Both are computed from the rows
    within `case.windows`, the time intervals in which the case is scored. `lib`: None is
    the unchanged library.
    """
    settings = {**INITIAL_SETTINGS, **d.about}
    config = Config.exact(settings, lib=lib)
    out = estimators.run_estimator("tse", d, config)
    here = find_rows_inside(d.time, case.windows)
    error = np.column_stack([out[s] for s in STIFFNESS])[here] / d.stiffness[here] - 1
    sd = np.column_stack([out[f"{s}_sd"] for s in STIFFNESS])[here] / d.stiffness[here]
    return 100 * np.sqrt((error**2).mean(0)), 100 * (np.abs(error) < 1.96 * sd).mean(0)


def compare_rms(base: np.ndarray, now: np.ndarray) -> str:
    """Return RMS error of `now` / RMS error of `base`, with `*` if significantly not 1.

    `base`, `now`: RMS errors with the unchanged and with the changed constant, (runs, 3
    stiffnesses). All runs and stiffnesses are pooled. The ratio differs significantly
    from 1 if its 95 % interval, from a bootstrap over the runs, does not contain 1.
    """
    a, b = np.sqrt((base**2).mean(1)), np.sqrt((now**2).mean(1))
    rng = np.random.default_rng(1)
    picks = rng.integers(len(a), size=(2000, len(a)))
    ratios = np.sqrt((b[picks] ** 2).mean(1) / (a[picks] ** 2).mean(1))
    low, high = np.quantile(ratios, (0.025, 0.975))
    ratio = np.sqrt((b**2).mean() / (a**2).mean())
    return f"{ratio:.2f}" + ("" if low <= 1 <= high else " *")


class Cars:
    """Test drives of calibrated cars, as an earlier study has written them to a folder.

    `calm`: drives without an event. `events`: drives with an event, such as ice."""

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
        """Run the filter of `lib` on all drives. None is the unchanged library.

        Return the values of the columns ON_CARS as cells of a Markdown row."""
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
    """For each constant, measure how results change if it is halved or doubled. Write the
    table of these changes."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("names", nargs="*", help="constants to change (all that name a test)")
    parser.add_argument("--runs", type=int, default=4, help="drives of each simulated case (4)")
    parser.add_argument(
        "--cars", type=Path, required=True, help="folder with the calibrated cars of tests.cars.study --keep"
    )
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
            simulate_case(c, seed, lambda about: Config.exact({**INITIAL_SETTINGS, **about}), {})
            for seed in range(1, args.runs + 1)
        ]
        for c in cases
    ]
    base = [np.array([compute_rms(c, d, None)[0] for d in ds]) for c, ds in zip(cases, drives, strict=True)]
    cars = Cars(args.cars)
    columns = [*(c.name for c in cases), *ON_CARS]
    head = f"""# Effect of halving and doubling a constant

`.venv/bin/python scripts/dev/sweep.py --cars DIR --runs {args.runs}`

- Simulated cases (columns {cases[0].name} .. {cases[-1].name}): RMS error over the RMS error with the
  unchanged constant, {args.runs} runs of each case on the same drives, three stiffnesses pooled. `*`:
  the 95 % interval of the ratio (bootstrap over runs) does not contain 1.
- Calibrated cars with 14 degrees of freedom (last four columns): {len(cars.calm)} drives without and
  {len(cars.events)} with an event. Last column: mean time in the minute after an event for which a
  cornering stiffness is valid and has an error above 20 %."""
    lines = [
        head,
        "",
        "| constant | value | unit | factor | " + " | ".join(columns) + " |",
        "|---|---:|---|---:|" + "---:|" * len(columns),
    ]
    lines.append("| unchanged | | | 1 | " + "1 | " * len(cases) + cars.format_scores(None) + " |")
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
