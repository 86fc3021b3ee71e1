"""Estimate calibrated ordinary cars over changes of the road or a tyre (README.md).

    python -m tests.cars.events --calibrated DIR [--first SEED] [--minutes M]
        [--out FILE]

DIR: that of `tests.cars.study --keep DIR --first SEED`, with car<k>/calibrated.toml. Each
scenario of road.py begins at a third of a drive on a highway and on a mountain road. The
table has the seconds of the next minute in which a stiffness is valid and more than 20 %
wrong, of the rows with a truth. Beside it, the time until the samples show the change to
a filter that starts with it.
"""

import argparse
import json
import multiprocessing
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from tqdm import tqdm

from scripts.dev import tables
from tests.cars import SCENARIOS, make_cars, make_logs
from tests.cars.road import LASTS
from tests.cars.study import PRIOR, RESULTS, estimate_log, read_drive
from tse.library.core import NOMINAL, STIFFNESS, Config, Library, NativeFilter
from tse.log.rows import CheckedLog
from tse.report.tables import format_markdown_table

EVENTS = [s for s in SCENARIOS if s != "dry"]
ON = ("highway", "mountain")
# relative error; s; s; rows of the truth: half a second of a new road
OFF, AFTER, ROW, SMOOTH = (0.2, 60.0, 0.01, 51)
SURE = 1.96  # sd
# of a stiffness that may have changed, relative
CHANGE_SD = float(tables.read("constants")["events"]["CHANGE_SD"]["value"])


def compute_share(of: np.ndarray, among: np.ndarray) -> float:
    """Return the share of those rows; 0 without rows."""
    return float(of[among].mean()) if among.any() else 0.0


def cut_log(log: CheckedLog, row: int) -> CheckedLog:
    """Return a log from a row on."""
    parts = {
        k: v[row:]
        for k, v in vars(log).items()
        if isinstance(v, np.ndarray | pd.DataFrame) and len(v) == len(log.time)
    }
    return replace(
        log, **{k: v.reset_index(drop=True) if isinstance(v, pd.DataFrame) else v for k, v in parts.items()}
    )


def measure_detection_time(
    log: CheckedLog, config: Config, stiffness: dict[str, float], moved: dict[str, float], began: float
) -> float:
    """Return the time, s, after which a filter that starts at the change detects it.

    Its stiffnesses have the sd CHANGE_SD. It detects the change when one of them differs
    from before with 95 %; AFTER: never. The sd of the mass, common to both, does not
    count.
    """
    rest = cut_log(log, int(np.searchsorted(log.time - log.time[0], began)))
    start = {NOMINAL[k]: stiffness[k] for k in STIFFNESS} | {
        f"initial_{PRIOR[k]}_sd": CHANGE_SD for k in STIFFNESS
    }
    out, mass = (
        NativeFilter(Config.exact(config.as_dict() | start)).estimate_rows(rest.rows()),
        config.mass_sd,
    )
    var = {key: (out[f"{key}_sd"] / out[key]) ** 2 - mass**2 for key in STIFFNESS}
    sure = np.flatnonzero(np.any([np.log(moved[key]) ** 2 > SURE**2 * var[key] for key in STIFFNESS], axis=0))
    return float(min(rest.time[sure[0]] - rest.time[0], AFTER)) if len(sure) else AFTER


def compute_slipless_stiffness(
    about: dict[str, Any], road: str, key: str, of: np.ndarray, before: float
) -> np.ndarray:
    """Return the true stiffness at no slip, a value a row.

    That of the dry road times the factor of the event. The longitudinal one of the dry
    road is that of the filter, `before`: rolling radii and pitch make it differ from the
    tyres'.
    """
    event, linear = about["logs"][road]["event"], about["linear_stiffness"]
    axle = {"cy_front": [0], "cy_rear": [1]}.get(
        key, {"front": [0], "rear": [1]}.get(about["driven_axle"], [0, 1])
    )
    left = float(np.mean(np.array(event["along" if key == "cx_front" else "across"])[axle]))
    since = of - event["time"]
    there = (since > 0) & (since <= LASTS.get(about["logs"][road]["scenario"], np.inf))
    share = np.clip(since / event["takes"], 0.0, 1.0) if event["takes"] else there.astype(float)
    return (before if key == "cx_front" else linear.get(f"{key}_effective", linear[key])) * (
        1 + (left - 1) * share
    )


def score_event(job: tuple[Path, str, str, int, float], lib: Library | None = None) -> list[dict[str, Any]]:
    """Score a car on a road with an event. `lib`: another build of the filter."""
    folder, road, scenario, car, began = job
    log, _, truth = read_drive(folder / f"{scenario}_{road}" / f"car{car}", road, SMOOTH)
    out, config = estimate_log(folder / f"car{car}" / "calibrated.toml", log, lib=lib)
    time = log.time - log.time[0]
    of = time - out["estimate_age"]  # the time of which the estimates are
    told = (out["p_changed"] + out["p_axle"] + out["p_sliding"]) > 0.5
    about = json.loads(
        (folder / f"{scenario}_{road}" / f"car{car}" / "truth.json").read_text(encoding="utf-8")
    )
    rows = []
    before, after = (of > began - AFTER / 2) & (of <= began), (of > began) & (of <= began + AFTER)
    true_of = {key: np.interp(of, time, truth[key]) for key in STIFFNESS}
    ratio = {
        key: float(np.nanmedian(true[after]) / np.nanmedian(true[before])) for key, true in true_of.items()
    }
    moved = {key: r if np.isfinite(r) else 1.0 for key, r in ratio.items()}
    found = {key: getattr(config, NOMINAL[key]) * float(out[key][before][-1]) for key in STIFFNESS}
    shown = measure_detection_time(log, config, found, moved, began)
    for key, true in true_of.items():
        error = out[f"{key}_secant"] * getattr(config, NOMINAL[key]) / true - 1
        valid, known = out[f"{key}_valid"] == 0, np.isfinite(true)
        wrong = known & valid & (np.abs(error) > OFF)
        value = out[key] * getattr(config, NOMINAL[key])
        at_no_slip = (
            value / compute_slipless_stiffness(about, road, key, of, float(np.median(value[before]))) - 1
        )
        rows.append(
            {
                "scenario": scenario,
                "road": road,
                "car": car,
                "stiffness": key,
                "wrong": ROW * float(wrong[after].sum()),
                "no slip": ROW * float((valid & (np.abs(at_no_slip) > OFF))[after].sum()),
                "valid before": compute_share(valid, before & known),
                "valid after": compute_share(valid, after & known),
                "told": float(told[after & (of < began + 5)].any()),
                "moved": moved[key],
                "shown": shown,
            }
        )
    return rows


def drive(folder: Path, cars: int, first: int, minutes: float) -> list[tuple[Path, str, str, int, float]]:
    """Write logs of all cars into FOLDER/<scenario>_<road>/car<k>; return the
    estimation jobs."""
    jobs = []
    for n, scenario in enumerate(EVENTS):
        for m, road in enumerate(ON):
            at = [folder / f"{scenario}_{road}" / f"car{k}" / "truth.json" for k in range(cars)]
            if all(x.exists() for x in at):  # driven in an earlier run
                for k, x in enumerate(at):
                    event = json.loads(x.read_text(encoding="utf-8"))["logs"][road]["event"]
                    if event is not None:
                        jobs.append((folder, road, scenario, k, float(event["time"])))
                continue
            print(f"driving: {scenario}, {road}", file=sys.stderr)
            made = make_logs(
                road,
                minutes,
                cars=make_cars(cars, first),
                seed=1000 * first + 100 + 10 * n + m,
                scenario=scenario,
                event_time=20 * minutes,
            )
            for k, log in enumerate(made):
                log.write(folder / f"{scenario}_{road}" / f"car{k}", road)
                event = log.truth["log"]["event"]
                if event is not None:  # a driver who is never calm meets none
                    jobs.append((folder, road, scenario, k, float(event["time"])))
    return jobs


def make_table(found: pd.DataFrame) -> list[str]:
    """Return a line for each scenario."""
    wrong = f"valid, error > {100 * OFF:.0f} %, in the next {AFTER:g} s [s]: median; 90 %; max"
    heads = ("event", "drives", "truth after / before", "valid before [% of rows]", "valid after [% of rows]",
             wrong, "the same for the stiffness at zero slip [s]", "reported within 5 s [% of drives]",
             "detectable after [s]: median, 90 %")  # fmt: skip
    rows = []
    for scenario, group in found.groupby("scenario", sort=False):
        by = [group[group["stiffness"] == key] for key in STIFFNESS]

        def three(what: str, scale: float = 100.0, by: list[pd.DataFrame] = by) -> str:
            return " / ".join(f"{scale * float(g[what].mean()):.0f}" for g in by)

        def seconds(what: str, by: list[pd.DataFrame] = by) -> str:
            return "; ".join(
                " / ".join(f"{float(g[what].quantile(q)):.1f}" for g in by) for q in (0.5, 0.9, 1.0)
            )

        moved = " / ".join(f"{float(g['moved'].median()):.2f}" for g in by)
        told = f"{100 * float(by[0]['told'].mean()):.0f}"
        shown = ", ".join(f"{float(by[0]['shown'].quantile(q)):.1f}" for q in (0.5, 0.9))
        valid = (three("valid before"), three("valid after"))
        rows.append(
            [scenario, f"{len(by[0])}", moved, *valid, seconds("wrong"), seconds("no slip"), told, shown]
        )
    return format_markdown_table(heads, rows)


def main(arguments: list[str]) -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--calibrated", type=Path, required=True, help="with car<k>/calibrated.toml; the logs go there, too"
    )
    parser.add_argument("--first", type=int, default=501, help="the first seed of those cars (default: 501)")
    parser.add_argument(
        "--minutes", type=float, default=3.0, help="length of each log; the event is at a third (default: 3)"
    )
    parser.add_argument("--jobs", type=int, default=2, help="processes (default: 2)")
    parser.add_argument("--out", type=Path, default=RESULTS / "cars-events.md", help="the table")
    given = parser.parse_args(arguments)
    cars = len(list(given.calibrated.glob("car*/calibrated.toml")))
    jobs = drive(given.calibrated, cars, given.first, given.minutes)
    with multiprocessing.Pool(given.jobs) as pool:
        found = [
            row
            for rows in tqdm(pool.imap(score_event, jobs), total=len(jobs), unit="drive", file=sys.stderr)
            for row in rows
        ]
    head = f"""# Roads and tyres that change, on ordinary cars that are calibrated

`python -m tests.cars.events --calibrated DIR --first {given.first} --minutes {given.minutes:g}`
after `python -m tests.cars.study --cars {cars} --first {given.first} --minutes 3 --keep DIR`

{cars} cars with 14 degrees of freedom on {" and ".join(ON)}. The event begins at a third of each
drive, or as soon after that as the car drives calmly. Cells with three numbers: front longitudinal
/ front cornering / rear cornering stiffness. Truth: secant at the slip of each row.

- reported: the probability of a change or of sliding wheels exceeds 0.5.
- detectable after: time after the event at which the data suffice for a detection. The filter is
  started at the event with an sd of {CHANGE_SD:g} of each stiffness. The change counts as detectable
  when the true change of a stiffness (median of {AFTER:g} s) exceeds {SURE:g} sd. {AFTER:g} s: never.

"""
    given.out.write_text(head + "\n".join(make_table(pd.DataFrame(found))) + "\n", encoding="utf-8")
    print(f"{given.out}: {len(jobs)} drives")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
