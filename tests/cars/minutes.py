"""Calibrate the same cars on the first minutes of their drives (README.md).

    python -m tests.cars.minutes --keep DIR --first SEED [--cars N] [--minutes M ...]
        [--out FILE]

DIR: that of `python -m tests.cars.study --keep DIR`.
"""

import sys
from pathlib import Path
from typing import Any

import pandas as pd
from tqdm import tqdm

from tests.cars import ROADS
from tests.cars.study import SETTLED, SLOW, estimate_log, make_parser, make_table, read_drive, score
from tse.calibration import output, workflow


def write_short_logs(fit: Path, minutes: float, into: Path) -> list[Path]:
    """Write the logs of FIT, cut to some minutes, to INTO; empty: all are shorter."""
    into.mkdir(exist_ok=True)
    paths, cut = [], False
    for path in sorted(fit.glob("log_*.csv")):
        log = pd.read_csv(path)
        time = log["time"] - log["time"].iloc[0]
        paths.append(into / path.name)
        cut = cut or bool(time.iloc[-1] > 60 * minutes)
        log[time <= 60 * minutes].to_csv(paths[-1], index=False)
    return paths if cut else []


def score_car(car: Path, minutes: float) -> list[dict[str, Any]]:
    """Return a row for each road: estimates of CAR/test, calibrated on minutes of
    CAR/fit."""
    folder = car / f"fit-{minutes:g}"
    logs, vehicle = write_short_logs(car / "fit", minutes, folder), folder / "calibrated.toml"
    if logs:
        result = workflow.run(logs, car / "fit" / "car.toml", [], 1, lambda _: None)
        output.write(vehicle, result, [p.name for p in logs])
    else:
        vehicle = car / "calibrated.toml"  # the study's own, on all of them
    rows = []
    for road in ROADS:
        log, _, truth = read_drive(car / "test", road)
        out, config = estimate_log(vehicle, log)
        who = f"{minutes:g} min a road"
        rows.append({"car": car.name, "road": road, "who": who, **score(out, config, log, truth)})
    return rows


def main(arguments: list[str]) -> int:
    """Write the table."""
    parser = make_parser(__doc__, "minutes.md")
    parser.add_argument(
        "--minutes",
        type=float,
        nargs="+",
        default=[0.4, 1.0, 3.0, 10.0],
        help="lengths (default: 0.4 1 3 10)",
    )
    given = parser.parse_args(arguments)
    jobs = [(given.keep / f"car{k}", m) for m in given.minutes for k in range(given.cars)]
    runs = pd.DataFrame(
        [row for job in tqdm(jobs, unit="search", file=sys.stderr) for row in score_car(*job)]
    )
    head = f"""# Minutes of calibration

`python -m tests.cars.minutes --keep DIR --cars {given.cars} --first {given.first}` after `python -m
tests.cars.study --first {given.first} --minutes {max(given.minutes):g} --keep DIR`

{given.cars} cars with 14 degrees of freedom. Each is calibrated on the first minutes of one drive on
each of {", ".join(ROADS)}, and estimated on another drive on each road. Cells with three numbers:
front longitudinal / front cornering / rear cornering stiffness. Rows after {SETTLED:g} s and above
{SLOW:g} m/s are counted. The columns are explained in [cars](cars-fresh.md).

"""
    text = (
        head
        + "\n".join(make_table(runs.assign(road="all")))
        + "\n\nBy road:\n\n"
        + "\n".join(make_table(runs))
        + "\n"
    )
    given.out.write_text(text, encoding="utf-8")
    print(f"{given.out}: {given.cars} cars")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
