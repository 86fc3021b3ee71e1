"""Measure bias and coverage of stiffnesses when rows come late.

    python -m tests.cars.late --calibrated DIR [--seed SEED] [--out FILE]

Mountain drives of the cars of `tests.cars.study --keep DIR`. Some rows come 0.12 s after
the one before instead of 0.02 s, or all rows come every 0.1 s with 2 % jitter.
"""

import argparse
import sys
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from tqdm import tqdm

from tests.cars.study import RESULTS, SETTLED, SLOW, TRUTH, compute_truth, estimate_log
from tse.channels.log import read_log
from tse.library.core import NOMINAL
from tse.log.rows import CheckedLog
from tse.report.tables import format_markdown_table

LATE, SHARES = 0.12, (0.0, 0.1, 0.2, 0.3)  # s; of the rows
TENTH, JITTER = 0.1, 0.02  # s between rows; its relative sd


def select_rows(time: np.ndarray, share: float | None, rng: np.random.Generator) -> np.ndarray:
    """Return the indices of the rows that come: 50 Hz with late ones, or None: 10 Hz,
    jitter."""
    step = float(np.median(np.diff(time)))
    keep, at = [0], 0.0
    while True:
        at += (
            TENTH * (1 + JITTER * rng.standard_normal())
            if share is None
            else LATE
            if rng.random() < share
            else 2 * step
        )
        index = round(at / step)
        if index >= len(time):
            return np.unique(keep)
        keep.append(index)


def measure_bias(
    folder: Path, share: float | None, rng: np.random.Generator, scratch: Path
) -> list[dict[str, Any]]:
    """Return the bias of a car's cornering stiffness with late rows."""
    table = pd.read_csv(folder / "test" / "log_mountain.csv")
    reference = pd.read_csv(folder / "test" / "reference_mountain.csv")
    truth = compute_truth({c: reference[c].to_numpy(float) for c in TRUTH.values()})
    table.iloc[select_rows(table["time"].to_numpy(), share, rng)].to_csv(scratch, index=False)
    log: CheckedLog = read_log(scratch)
    out, config = estimate_log(folder / "calibrated.toml", log)
    found = []
    for key in ("cy_front", "cy_rear"):
        true = np.interp(log.time - out["estimate_age"], table["time"], truth[key])
        nominal = getattr(config, NOMINAL[key])
        counts = np.isfinite(true) & (log.time > SETTLED) & (out["vel_x"] > SLOW)
        error = (out[key] * nominal / true - 1)[counts]
        interval = (1.96 * out[f"{key}_sd"] * nominal / true)[counts]
        found.append(
            {
                "rows": "10 Hz, 2 % jitter" if share is None else f"50 Hz, {100 * share:.0f} % late",
                "stiffness": key,
                "bias": float(np.median(error)),
                "valid": float((out[f"{key}_valid"][counts] == 0).mean()),
                "held": float((np.abs(error) < interval).mean()),
            }
        )
    return found


def make_table(found: pd.DataFrame) -> list[str]:
    """Return a line for each pattern of rows: medians over the cars, front / rear."""
    lines = []
    base = found[found["rows"] == found["rows"].iloc[0]].set_index(["car", "stiffness"])["bias"]
    for name, group in found.groupby("rows", sort=False):
        cells = [str(name)]
        for what in ("bias", "valid", "held"):
            values = []
            for key in ("cy_front", "cy_rear"):
                rows = group[group["stiffness"] == key]
                x = rows[what] - [base[car, key] if what == "bias" else 0.0 for car in rows["car"]]
                values.append(
                    f"{100 * float(x.iloc[np.argmax(np.abs(x))] if what == 'bias' else x.mean()):+.1f}"
                    if what == "bias"
                    else f"{100 * float(x.mean()):.0f}"
                )
            cells.append(" / ".join(values))
        lines.append(cells)
    return format_markdown_table(
        ["rows", "change of the bias [%]", "valid [% of rows]", "95 % interval contains truth [% of rows]"],
        lines,
        4,
    )


def main(arguments: list[str]) -> int:
    """Run the study and write the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--calibrated", type=Path, required=True, help="what tests.cars.study --keep has left"
    )
    parser.add_argument("--seed", type=int, default=1, help="of the rows that come late (default: 1)")
    parser.add_argument("--out", type=Path, default=RESULTS / "late.md", help="the table")
    given = parser.parse_args(arguments)
    rng, delays = np.random.default_rng(given.seed), []
    cars = sorted(p.parent for p in given.calibrated.glob("car*/calibrated.toml"))
    scratch = given.calibrated / "late.csv"
    for folder, share in tqdm(list(product(cars, (*SHARES, None))), unit="drive", file=sys.stderr):
        delays += [{"car": folder.name, **row} for row in measure_bias(folder, share, rng, scratch)]
    scratch.unlink()
    text = f"""# Rows that come late

`python -m tests.cars.late --calibrated DIR --seed {given.seed}` after `python -m tests.cars.study
--keep DIR`

{len(cars)} calibrated cars on a mountain road. Front / rear cornering stiffness. Change of the bias:
bias minus the bias without late rows, largest of the cars. Shares: mean of the cars.

"""
    given.out.write_text(text + "\n".join(make_table(pd.DataFrame(delays))) + "\n", encoding="utf-8")
    print(f"{given.out}: {len(cars)} cars")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
