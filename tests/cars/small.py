"""Compare the build with TSE_SMALL with the full filter and with a constant (README.md).

    python -m tests.cars.small --keep DIR --first SEED [--cars N] [--real DIR]
        [--out FILE]

DIR: that of `python -m tests.cars.study --keep DIR`, with the same calibrated cars; with
--real that of `python -m tests.cars.real --keep DIR`: two drives of one car, each with
the calibration of the other.
"""

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from tqdm import tqdm

from scripts.dev.fixed import build_library
from tests.cars import ROADS
from tests.cars.real import CORNERING, DATA, FAST, SAME_CAR, find_lively_rows
from tests.cars.study import (
    CONSTANT,
    OFF,
    SETTLED,
    SLOW,
    estimate_log,
    format_shares,
    make_constant_estimates,
    make_parser,
    read_drive,
    relax_truth,
    score,
)
from tse.channels.log import read_log
from tse.library.core import NOMINAL, STIFFNESS, Library
from tse.report.tables import format_markdown_table

FULL, LITTLE, FIXED = "full", "small", "small, fixed point"


def score_builds(car: Path, road: str, builds: dict[str, Library | None]) -> list[dict[str, Any]]:
    """Return a row for each build and the constant: score and squared errors.

    Errors are against the secants without relaxation.
    """
    log, reference, _ = read_drive(car / "test", road)
    truth = relax_truth(reference, json.loads((car / "test" / "truth.json").read_text(encoding="utf-8")))
    time = log.time - log.time[0]
    rows = []
    for who in (*builds, CONSTANT):
        vehicle = car / "calibrated.toml"
        out, config = (
            make_constant_estimates(vehicle, log)
            if who == CONSTANT
            else estimate_log(vehicle, log, lib=builds[who])
        )
        row: dict[str, Any] = {"car": car.name, "road": road, "who": who, **score(out, config, log, truth)}
        for key in STIFFNESS:
            true = np.interp(time - out["estimate_age"], time, truth[key])
            error = out[f"{key}_secant"].astype(float) * getattr(config, NOMINAL[key]) / true - 1
            counts = np.isfinite(error) & (time > SETTLED) & (out["vel_x"] > SLOW)
            row[f"{key} square"] = float((error[counts] ** 2).sum())
        rows.append(row)
    return rows


def compare_builds_on_log(
    name: str, other: str, kept: Path, builds: dict[str, Library | None]
) -> list[list[str]]:
    """Return lines of a real log with the calibration of another log of the same car.

    The tyres are unknown; the lateral velocity is measured.
    """
    log = read_log(DATA / name / "data.csv")
    time, lines = log.time - log.time[0], []
    for who, lib in builds.items():
        out, config = estimate_log(kept / f"{other}_whole.toml", log, lib=lib)
        true = np.interp(time - out["estimate_age"], time, log.ref["ref_vel_y"].to_numpy(float))
        counts = (time > SETTLED) & (out["vel_x"] > FAST) & np.isfinite(true)
        end, excited = counts & (time > time[-1] * 2 / 3), counts & find_lively_rows(time, out)
        off = (out["vel_y"] - true)[counts]
        cells = [name, who]
        for key in CORNERING:
            nominal = getattr(config, NOMINAL[key]) / 1000.0
            mean, sd = np.median(out[key][end]), np.median(out[f"{key}_sd"][end])
            cells.append(f"{nominal * mean:.0f} +- {1.96 * nominal * sd:.0f}")
        cells.append(
            " / ".join(f"{100 * np.mean(out[f'{key}_valid'][excited] == 0):.0f}" for key in CORNERING)
        )
        cells.append(f"{np.degrees(np.sqrt(np.mean((off / out['vel_x'][counts]) ** 2))):.2f}")
        lines.append([*cells, f"{100 * np.mean(np.abs(off) < 1.96 * out['vel_y_sd'][counts]):.0f}"])
    return lines


def make_table(runs: pd.DataFrame) -> list[str]:
    """Return a line for each road and build; the small one has no longitudinal
    stiffness."""

    def rms(group: pd.DataFrame) -> str:
        return " / ".join(
            f"{100 * np.sqrt(group[f'{k} square'].sum() / group[f'{k} rows'].sum()):.1f}" for k in CORNERING
        )

    rows = []
    for (road, who), g in runs.groupby(["road", "who"], sort=False):
        cells = [
            str(road),
            str(who),
            " / ".join(f"{100 * float(g[f'{k} error'].median()):.1f}" for k in CORNERING),
            rms(g),
        ]
        cells += [
            format_shares(g, what, of, keys=CORNERING)
            for what, of in (("valid", "rows"), ("off", "valid"), ("held", "rows"))
        ]
        rows.append([*cells, f"{g['changes'].sum() / g['hours'].sum():.1f}"])
    head = (
        f"road|build|median error [%]|rms error [%]|valid [% of rows]|error > {100 * OFF:.0f} % [% of valid "
        "rows]|95 % interval contains truth [% of rows]|false changes per hour"
    )
    return format_markdown_table(head.split("|"), rows, 7)


def main(arguments: list[str]) -> int:
    """Write the table."""
    parser = make_parser(__doc__, "small.md")
    parser.add_argument("--real", type=Path, help="that of python -m tests.cars.real")
    given = parser.parse_args(arguments)
    builds: dict[str, Library | None] = {
        FULL: None,
        LITTLE: build_library("double", small=True),
        FIXED: build_library("fixed", small=True),
    }
    jobs = [(given.keep / f"car{k}", road) for k in range(given.cars) for road in ROADS]
    runs = pd.DataFrame(
        [row for car, road in tqdm(jobs, file=sys.stderr) for row in score_builds(car, road, builds)]
    )
    head = f"""# A smaller state

`python -m tests.cars.small --keep DIR --first {given.first} --cars {given.cars} --real DIR` after
`python -m tests.cars.study --cars {given.cars} --first {given.first} --minutes 3 --keep DIR`

{len(jobs)} drives of {given.cars} calibrated cars with 14 degrees of freedom: the full filter, the
build with `TSE_SMALL`, and the constant stiffness of the calibration. Front / rear cornering
stiffness. Truth: force over the slip angle after relaxation. rms error: of all rows whose true
stiffness is known. The other columns are explained in [cars](cars-fresh.md).

"""
    text = (
        head
        + "\n".join(make_table(runs.assign(road="all")))
        + "\n\nBy road:\n\n"
        + "\n".join(make_table(runs))
        + "\n"
    )
    if given.real:
        lines = []
        for name, other in (SAME_CAR[0], SAME_CAR[0][::-1]):
            lines += compare_builds_on_log(name, other, given.real, builds)
        text += """
Two logs of one car, each with the calibration of the other (`python -m tests.cars.real --keep
DIR`): cornering stiffness at zero slip with 95 % interval, median of the last third; valid as in
[real logs](real.md). The true stiffness is not known. The lateral speed is measured.

"""
        columns = (
            "log|build|front [kN/rad]|rear [kN/rad]|front / rear valid [%]|rms error of sideslip [deg]|"
            "95 % interval of vel_y contains truth [% of rows]"
        )
        text += "\n".join(format_markdown_table(columns.split("|"), lines, 5)) + "\n"
    given.out.write_text(text, encoding="utf-8")
    print(f"{given.out}: {len(jobs)} drives")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
