"""Compare the answer for each stretch of road with the truth (README.md).

    python -m tests.cars.stretches --calibrated DIR [--cars N] [--first SEED]
        [--out FILE]

DIR: that of `tests.cars.study --keep DIR`, and of `tests.cars.events --calibrated DIR`,
if it was run. Truth of a stretch: median of the secants of its rows (study.truth_of). The
stretch is the one that the filter reports, right or not.
"""

import argparse
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from tqdm import tqdm

from tests.cars import ROADS
from tests.cars.events import EVENTS, ON
from tests.cars.study import CONSTANT, PRIOR, RESULTS, SLOW, read_drive
from tse.car.config import make_config
from tse.car.vehicle import read_vehicle
from tse.estimation import regimes
from tse.estimation.estimate import Estimates, estimate
from tse.estimation.verdict import make_findings
from tse.library.core import STIFFNESS, Config
from tse.report.tables import format_markdown_table

OFF, MIN_STRETCH_ROWS, MIN_STRETCH_TIME = 0.1, 100, 5.0  # relative error; rows with a truth; s
LAST, MEAN, SHOWN, SMOOTHED = (
    "last row",
    "mean of the valid rows",
    "last valid row, else the last",
    "smoothed",
)


Answer = tuple[float, float, bool]  # value, half of the 95 % interval, valid


def make_answers(est: Estimates, config: Config) -> Iterator[tuple[regimes.Stretch, str, dict[str, Answer]]]:
    """Yield the answers by estimator, of each stretch and stiffness."""
    table, changes = est.table, regimes.find_changes(est.table)
    found = make_findings(table, config, changes, uncertainty_sd=est.uncertainty_sd)
    for s, f in zip(regimes.find_stretches(table, changes), found, strict=True):
        rows = table.iloc[s.rows]
        rows = rows[rows["status"] >= 0]
        for v in f.verdicts:
            value, band = rows[v.key].to_numpy() / 1000, 1.96 * rows[f"{v.key}_sd"].to_numpy() / 1000
            valid = rows[f"{v.key}_valid"].to_numpy() == 1
            prior = 1.96 * getattr(config, f"initial_{PRIOR[v.key]}_sd") * v.nominal
            by = {CONSTANT: (v.nominal, prior, True), LAST: (value[-1], band[-1], bool(valid[-1]))}
            if valid.any():
                by[MEAN] = value[valid].mean(), band[valid].mean(), True
            by[SHOWN] = v.value, v.band, v.level != "none"
            by[SMOOTHED] = v.smoothed, v.smoothed_band, v.smoothed_reason == "valid"
            yield s, v.key, by


def score_drive(folder: Path, road: str, car: Path) -> list[dict[str, Any]]:
    """Score a drive: a row for each stretch, stiffness and estimator."""
    log, _, truth = read_drive(folder, road)
    config, _ = make_config(read_vehicle(car), log)
    est = estimate(log, config)
    moving = est.table["vel_x"].to_numpy() > SLOW
    scores = []
    for s, key, by in make_answers(est, config):
        true = truth[key][s.rows]
        true = true[np.isfinite(true) & (true > 0) & moving[s.rows]] / 1000
        if (
            s.end - s.start < MIN_STRETCH_TIME
            or len(true) < MIN_STRETCH_ROWS
            or (key == "cx_front" and not config.driven_axle)
        ):
            continue
        is_true = float(np.median(true))
        for who, (value, band, valid) in by.items():
            error = value / is_true - 1
            scores.append(
                {
                    "stiffness": key,
                    "who": who,
                    "error": abs(error),
                    "held": abs(value - is_true) < band,
                    "sd": band / 1.96 / value,
                    "valid": valid,
                    "off": valid and abs(error) > OFF,
                    "any": MEAN in by,
                }
            )
    return scores


def make_table(found: pd.DataFrame) -> list[str]:
    """Return a line for each estimator."""
    columns = (
        "stretches",
        "median error [%]",
        "rms error [%]",
        "95 % interval contains truth [%]",
        "median sd [%]",
        "valid [%]",
        f"valid, error > {100 * OFF:.0f} % [%]",
    )
    lines = []
    for who in (CONSTANT, LAST, MEAN, SHOWN, SMOOTHED):
        by = [found[(found["who"] == who) & (found["stiffness"] == key)] for key in STIFFNESS]
        cells = [[f"{len(g)}" for g in by]]
        cells += [[f"{100 * g['error'].median():.1f}" for g in by]]
        cells += [[f"{100 * np.sqrt((g['error'] ** 2).mean()):.0f}" for g in by]]
        cells += [
            [f"{100 * g['held'].mean():.0f}" for g in by],
            [f"{100 * g['sd'].median():.1f}" for g in by],
        ]
        cells += [[f"{100 * g[c].mean():.0f}" for g in by] for c in ("valid", "off")]
        lines.append([who, *(" / ".join(c) for c in cells)])
    return format_markdown_table(["value", *columns], lines)


def main(arguments: list[str]) -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--calibrated", type=Path, required=True, help="what the other studies have left")
    parser.add_argument("--cars", type=int, default=4, help="how many (default: 4)")
    parser.add_argument("--first", type=int, default=501, help="the first seed of those cars (default: 501)")
    parser.add_argument("--out", type=Path, default=RESULTS / "cars-stretches.md", help="the table")
    given = parser.parse_args(arguments)
    drives = [("without an event", road, f"car{k}/test", k) for road in ROADS for k in range(given.cars)]
    places = [(e, road, k) for e in EVENTS for road in ON for k in range(given.cars)]
    drives += [("with an event", road, f"{e}_{road}/car{k}", k) for e, road, k in places]
    scores = []
    for what, road, at, k in tqdm(drives, unit="drive", file=sys.stderr):
        for told, car in (("calibrated", "calibrated.toml"), ("not calibrated", "fit/car.toml")):
            if (given.calibrated / at / f"log_{road}.csv").exists():
                rows = score_drive(given.calibrated / at, road, given.calibrated / f"car{k}" / car)
                scores += [{"what": what, "told": told, **r} for r in rows]
    found, text = pd.DataFrame(scores), []
    for (told, what), mine in found.groupby(["told", "what"], sort=False):
        text += ["", f"{told.capitalize()}, drives {what}:", "", *make_table(mine)]
        if told == "calibrated" and what == "with an event":
            text += [
                "",
                "Calibrated, drives with an event, only stretches with a valid row:",
                "",
                *make_table(mine[mine["any"]]),
            ]
    head = f"""# Stiffness of each stretch of road

`python -m tests.cars.stretches --calibrated DIR --cars {given.cars} --first {given.first}` after
`python -m tests.cars.study --cars {given.cars} --first {given.first} --minutes 3 --keep DIR` and
`python -m tests.cars.events --calibrated DIR --first {given.first}`

Cars with 14 degrees of freedom. Cells with three numbers: front longitudinal / front cornering /
rear cornering stiffness. A stretch lies between two changes that the filter reports. If the filter
misses a change, a stretch contains two roads, and no value is true for both.

- Truth: median of the true secants in the rows of the stretch.
- *{CONSTANT}*: no filter. If the car is not calibrated: the stiffness of its class.
- *{MEAN}*: only the stretches with valid rows.
- Shares are relative to all stretches of the line.
"""
    given.out.write_text(head + "\n".join(text) + "\n", encoding="utf-8")
    print(f"{given.out}: {len(drives)} drives")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
