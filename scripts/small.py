#!/usr/bin/env python3
"""The default form with few hypotheses, as small microcontrollers have room for: writes scripts/results/small.md.

    .venv/bin/python scripts/small.py [--runs R]

Every drive is simulated once, in double; the fixed-point build reads it with each number of hypotheses. What counts, and when a run
has diverged, is as in every study (tselab montecarlo). A quarter of an hour for 20 runs on one free core.
"""

from __future__ import annotations

import argparse
import sys

import fixed
import numpy as np
import pandas as pd

from tselab.core import STIFFNESS, Config, Library
from tselab.montecarlo import scores, studies
from tselab.montecarlo.case import Case
from tselab.study import START

OUT = fixed.ROOT / "scripts" / "results" / "small.md"
MANY = 6  # the setting's default
COUNTS = (2, 3, 4, MANY)
OTHERS = {"stress": ("road-0.3", "stuck-steer_angle"), "regimes": ("slow-20",)}  # what hypotheses are for


def cases() -> list[Case]:
    return [*fixed.CASES, *(case for name, some in OTHERS.items() for case in studies.study(name, some).cases)]


def study(lib: Library, runs: int, only: str) -> pd.DataFrame:
    """One row a case, number of hypotheses and seed."""
    rows = []
    for case in (c for c in cases() if only in c.name):
        for seed in range(1, runs + 1):
            d = fixed.simulated(case, seed)
            known = scores.knowable(d, case)
            for count in COUNTS:
                estimate = fixed.estimated(d, Config({**START, **d.about, "hypotheses": count}, lib=lib))
                row = {"case": case.name, "title": case.title, "hypotheses": count, "seed": seed}
                rows.append(row | scores.score(d, case, known, estimate) | fixed.validity(d, estimate))
            print(f"{case.name} {seed}", file=sys.stderr, flush=True)
    return pd.DataFrame(rows)


def table(runs: pd.DataFrame) -> list[str]:
    columns = [
        "case",
        "hypotheses",
        "RMS %",
        "worst over that of 6",
        "settled after s",
        "valid %",
        "false valid %",
        "diverged",
    ]
    lines = [f"| {' | '.join(columns)} |", "|---|---:|---|---:|---|---|---:|---:|"]
    for name, of_case in runs.groupby("case", sort=False):
        parts = dict(list(of_case.groupby("hypotheses")))
        rms = {n: [float(np.sqrt(x[f"{s}_mean_square"].mean())) for s in STIFFNESS] for n, x in parts.items()}
        event = (
            "1" if f"{STIFFNESS[0]}_settle_1" in of_case and of_case[f"{STIFFNESS[0]}_settle_1"].notna().any() else "0"
        )
        for n, x in parts.items():
            worst = max(100 * (a / b - 1) for a, b in zip(rms[n], rms[MANY], strict=True))
            settled = ", ".join(f"{x[f'{s}_settle_{event}'].median():.1f}" for s in STIFFNESS)
            valid = ", ".join(f"{x[f'{s}_valid'].mean():.1f}" for s in STIFFNESS)
            false = max(
                100 * float(x[f"{s}_false_valid"].sum() / max(x[f"{s}_false_valid_of"].sum(), 1)) for s in STIFFNESS
            )
            told = ", ".join(f"{v:.2f}" for v in rms[n])
            over = "" if n == MANY else f"{worst:+.1f} %"
            lines.append(
                f"| {name} | {n} | {told} | {over} | {settled} | {valid} | {false:.2f} | {int(x.diverged.sum())} |"
            )
    return lines


HEAD = """\
# The default form with few hypotheses, in fixed point

Written by `.venv/bin/python scripts/small.py --runs {runs}`: seeds 1 .. {runs} of each case, every drive simulated once (in
double) and read by the fixed-point build with each number of hypotheses (setting `hypotheses`; a build with TSE_HYPOTHESES=2 has
room for two). RMS of the relative errors of cx_front, cy_front, cy_rear in the window of the case; settled: median time from the
change of road, else from the start, until all errors stay below 10 % for 1 s; valid: rows after 5 s so called; false valid: of
these, with an error above 20 %, of the worst stiffness.

"""


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", default="", metavar="TEXT", help="cases with this in their name; no table is written")
    parser.add_argument("--runs", type=int, default=20, help="of each case, one seed each")
    options = parser.parse_args()
    runs = study(fixed.library("fixed"), options.runs, options.only)
    text = HEAD.format(runs=options.runs) + "\n".join(table(runs)) + "\n"
    if not options.only:
        OUT.write_text(text, encoding="utf-8")
    print(text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
