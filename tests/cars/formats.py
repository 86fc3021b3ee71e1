"""Compare float and fixed point with double, on the same calibrated cars (README.md).

    python -m tests.cars.formats --keep DIR --first SEED [--cars N] [--out FILE]

DIR: that of `python -m tests.cars.study --keep DIR`. Each build reads the same logs with
the same settings.
"""

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from tqdm import tqdm

from scripts.dev.fixed import build_library
from tests.cars import ROADS
from tests.cars.study import OFF, estimate_log, format_shares, make_parser, read_drive, score
from tse.library.core import STIFFNESS, Library
from tse.report.tables import format_markdown_table

REALS = ("double", "float", "fixed")


def score_builds(car: Path, road: str, builds: dict[str, Library]) -> list[dict[str, Any]]:
    """Return a row for each build: its score, and its difference from double in sd."""
    log, _, truth = read_drive(car / "test", road)
    rows, first = [], None
    for real, lib in builds.items():
        out, config = estimate_log(car / "calibrated.toml", log, lib=lib)
        first = out if first is None else first
        row: dict[str, Any] = {"car": car.name, "road": road, "real": real, **score(out, config, log, truth)}
        for key in STIFFNESS:
            apart = (out[key].astype(float) - first[key]) / first[f"{key}_sd"]
            row[f"{key} apart"] = float(np.sqrt(np.mean(apart**2)))
        rows.append(row)
    return rows


def make_table(runs: pd.DataFrame) -> list[str]:
    """Return a line for each build."""

    def three(values: list[float], digits: int) -> str:
        return " / ".join(f"{v:.{digits}f}" for v in values)

    rows = []
    for real, g in runs.groupby("real", sort=False):
        cells = [str(real), three([100 * float(g[f"{k} error"].median()) for k in STIFFNESS], 2)]
        cells += [
            format_shares(g, what, of, 1)
            for what, of in (("valid", "rows"), ("off", "valid"), ("held", "rows"))
        ]
        rows.append([*cells, three([float(np.sqrt(np.mean(g[f"{k} apart"] ** 2))) for k in STIFFNESS], 3)])
    head = (
        f"build|median error [%]|valid [% of rows]|error > {100 * OFF:.0f} % [% of valid rows]|"
        "95 % interval contains truth [% of rows]|difference from double, rms [sd of the estimate]"
    )
    return format_markdown_table(head.split("|"), rows, 6)


def main(arguments: list[str]) -> int:
    """Write the table."""
    parser = make_parser(__doc__, "cars-formats.md")
    given = parser.parse_args(arguments)
    builds = {real: build_library(real) for real in REALS}
    jobs = [(given.keep / f"car{k}", road) for k in range(given.cars) for road in ROADS]
    runs = pd.DataFrame(
        [row for car, road in tqdm(jobs, file=sys.stderr) for row in score_builds(car, road, builds)]
    )
    head = f"""# Float and fixed point compared with double, on cars

`python -m tests.cars.formats --keep DIR --cars {given.cars} --first {given.first}` after `python -m
tests.cars.study --cars {given.cars} --first {given.first} --keep DIR`

{len(jobs)} drives of {given.cars} calibrated cars with 14 degrees of freedom. Each build reads the
same logs with the same settings. Cells with three numbers: front longitudinal / front cornering /
rear cornering stiffness. The columns are explained in [cars](cars-fresh.md).

"""
    given.out.write_text(head + "\n".join(make_table(runs)) + "\n", encoding="utf-8")
    print(f"{given.out}: {len(jobs)} drives")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
