"""Write the files of a run to DIR: verdict.json, vehicle_improved.toml, effects.h,
residuals.parquet, report.html, gap.png. Also compute by how much the improved vehicle
file improves the estimates.
"""

from __future__ import annotations

import importlib.util
import json
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from tse.car.config import make_config
from tse.car.vehicle import Vehicle, describe_stiffness, fill_sensors, read_vehicle
from tse.estimation.estimate import estimate
from tse.estimation.verdict import NAMES
from tse.gaps.catalogue import drop_log_values
from tse.gaps.fit import ChannelChange, compare_models
from tse.gaps.problem import Problem
from tse.gaps.run import add, pictures, report
from tse.gaps.run.workflow import FIT, HELD_OUT, GapResult
from tse.identify.data import COMPARED_CHANNELS
from tse.library.core import NOMINAL, STIFFNESS
from tse.library.files import write_atomically
from tse.log.rows import CheckedLog
from tse.report.results import convert_to_plain
from tse.roads.road import write_road

VERDICT_FILE, RESIDUALS_FILE, REPORT_FILE, PICTURE_FILE, ROAD_FILE = (
    "verdict.json",
    "residuals.parquet",
    "report.html",
    "gap.png",
    "road.csv",
)
# Columns of residuals.parquet: see make_table()
RESIDUAL_COLUMNS = (
    "part",
    "log",
    "channel",
    "time",
    "block",
    "measured",
    "predicted_before",
    "predicted_after",
    "residual_before",
    "residual_after",
    "noise",
)
BOTH = ("before", "after")  # before: the user's vehicle file, after: the improved vehicle file


@dataclass(frozen=True)
class WrittenFiles:
    """The files that write_all() wrote, and the results in them that are printed in the
    terminal.
    """

    files: list[Path]
    gain: dict[str, Any]  # result of compute_gain()
    # part of the logs (FIT or HELD_OUT) -> channel -> change of the residuals of this
    # channel by the effects that were added
    changes: dict[str, dict[str, ChannelChange]]


def write_all(
    out: Path,
    result: GapResult,
    vehicle_path: Path,
    jobs: int = 1,
    say: Callable[[str], None] = lambda _: None,
) -> WrittenFiles:
    """Write all files of a run: the improved vehicle file, the report, and the residuals
    before and after effects were added.

    `say` is called with the name of each step.
    """
    problem, naming = result.problem, result.naming
    before, after = naming.baseline.values, result.after
    parts = {FIT: (result.level, problem)} | (
        {HELD_OUT: (result.held_level, result.held)} if result.held is not None else {}
    )
    say("writing the improved vehicle")
    improved, header = add.write_vehicle(out, vehicle_path, problem, result)
    result.words.insert(0, describe_stiffness(read_vehicle(improved)))
    say("residuals before and after")
    rows = make_table(parts, before, after)
    with write_atomically(out / RESIDUALS_FILE, "wb") as file:
        rows.to_parquet(file, engine="pyarrow", index=False, compression="zstd")
    changes = {FIT: compare_models(problem, naming.baseline.residuals, result.final.residuals)}
    if result.held_out:
        changes[HELD_OUT] = result.held_out

    old, new = read_vehicle(vehicle_path), read_vehicle(improved)
    stiffness = {k: new.values[setting] / getattr(problem.config, setting) for k, setting in NOMINAL.items()}
    read = [(part, log.path.stem, log) for part, log in result.read]
    # A sensor setting that the vehicle file leaves out is estimated from the first log,
    # in the same way for both cars.
    for vehicle in (old, new):
        fill_sensors(vehicle, read[0][2])
    gained = compute_gain(read, old, new, jobs, say)

    say("report")
    named = vehicle_path.name if old.name == vehicle_path.stem else f"{old.name} ({vehicle_path.name})"
    shown = report.ReportInput(result, named, rows, changes, gained, stiffness, [*old.filled])
    report.write_report(out / REPORT_FILE, shown)
    with write_atomically(out / VERDICT_FILE) as file:
        json.dump(
            convert_to_plain(result.as_json() | {"stiffness": stiffness, "estimator": gained}),
            file,
            indent=1,
            allow_nan=False,
        )
        file.write("\n")
    files = [
        out / VERDICT_FILE,
        improved,
        header,
        *add.write_formula_files(out, improved),
        *write_road_files(out, result),
        out / REPORT_FILE,
        out / RESIDUALS_FILE,
    ]
    if importlib.util.find_spec("matplotlib") is not None:
        pictures.draw_picture(out / PICTURE_FILE, rows, make_headline(result))
        files.append(out / PICTURE_FILE)
    return WrittenFiles(files, gained, changes)


def write_road_files(out: Path, result: GapResult) -> list[Path]:
    """Write the estimated roads to files, and return the paths. Remove road files of an
    earlier run that are not overwritten.
    """
    found = result.roads.list_roads() if result.roads is not None else []
    files = [out / (f"road_{k}.csv" if k > 1 else ROAD_FILE) for k in range(1, len(found) + 1)]
    for path, road in zip(files, found, strict=True):
        write_road(road, path)
    for old in {*out.glob("road_*.csv"), out / ROAD_FILE} - {*files}:
        old.unlink(missing_ok=True)
    return files


def make_headline(result: GapResult) -> str:
    """Return the verdict in a few words, as the title of the picture PICTURE_FILE."""
    if result.verdict == "none":
        return "Nothing is missing that these logs could show"
    if result.verdict == "not_in_catalogue":
        return "Not in the catalogue" + (
            f": {result.formula.text} at {result.formula.place}" if result.formula else ""
        )
    if result.verdict == "possible":
        return f"Possible: {result.naming.possible[0]['id']}"
    return "Missing: " + " + ".join(n.effect.id for n in result.naming.named)


# ---- Table of the residuals before and after effects are added to the vehicle file. The
# report draws its figures from this table.


def make_table(
    parts: Mapping[str, tuple[Problem, Problem]], before: Mapping[str, float], after: Mapping[str, float]
) -> pd.DataFrame:
    """Return a table of the residuals, with a row for each log, channel and block of 40
    ms.

    The columns are RESIDUAL_COLUMNS. predicted_* include the fitted sensor bias of the
    log. `noise` is the sd of the sensor noise in a block mean. residual_* are (measured -
    predicted) / noise. Their rms is 1 if they are noise alone. They are NaN in blocks
    without a measurement.

    `parts` has two Problems with the same logs for each part (FIT and HELD_OUT). The
    first has level roads and is used for *_before. The second has the estimated roads and
    is used for *_after. `before` and `after` are the parameter values of the two fits.
    """
    frames = []
    for part, (level, problem) in parts.items():
        rows = problem.rows
        columns: dict[str, object] = {
            "part": part,
            "log": pd.Categorical.from_codes(rows.log, list_log_names(problem)),
            "channel": pd.Categorical.from_codes(rows.channel, list(COMPARED_CHANNELS)),
            "time": rows.time.astype(float),
            "block": rows.block.astype(np.int64),
            "measured": problem.measured,
        }
        mine = after if part == FIT else drop_log_values(after)
        for when, values, model in (("before", before, level), ("after", mine, problem)):
            measured = np.nan_to_num(problem.measured)
            left = problem.subtract_bias(measured - model.predict(values))
            columns[f"predicted_{when}"] = measured - left
            columns[f"residual_{when}"] = np.where(problem.weight > 0, problem.weight * left, np.nan)
        columns["noise"] = np.where(
            problem.weight > 0, 1.0 / np.where(problem.weight > 0, problem.weight, 1.0), np.nan
        )
        frames.append(pd.DataFrame(columns))
    found = pd.concat(frames, ignore_index=True)
    for name in ("part", "log", "channel"):
        found[name] = found[name].astype("category")
    return found[list(RESIDUAL_COLUMNS)]


def list_log_names(problem: Problem) -> list[str]:
    """Return the names of the logs. If a name occurs more than once, " (2)", " (3)" ...
    is added from the second on.
    """
    seen: dict[str, int] = {}
    names = []
    for log in problem.logs:
        n = seen[log.name] = seen.get(log.name, 0) + 1
        names.append(log.name if n == 1 else f"{log.name} ({n})")
    return names


# ---- gain of the estimator
#
# The true stiffness is unknown, so the error of the estimates cannot be computed.
# Instead, the gain is measured by two quantities: the log evidence of the rows [nat], and
# the share of the rows with valid estimates. Log evidence is the log likelihood of the
# measurements of a row, given all earlier rows.


def compute_gain(
    logs: Sequence[tuple[str, str, CheckedLog]],
    before: Vehicle,
    after: Vehicle,
    jobs: int = 1,
    say: Callable[[str], None] = lambda _: None,
) -> dict[str, Any]:
    """Run the estimator on each log, once with each of two cars. Return for each car the
    mean log evidence per row, and the share of rows in which the estimate of a stiffness
    is valid. Both are computed for all logs together and for each log.

    `logs` has part (FIT or HELD_OUT), name and rows of each log. `before` is the car of
    the user's vehicle file, `after` the improved car.
    """

    def estimate_log(task: tuple[tuple[str, str, CheckedLog], Vehicle]) -> pd.DataFrame:
        (_, name, log), vehicle = task
        say(f"estimating {name}")
        return estimate(log, make_config(vehicle, log)[0]).table

    # Threads suffice, because the library releases Python's global interpreter lock.
    with ThreadPoolExecutor(max(1, jobs)) as pool:
        tables = list(pool.map(estimate_log, [(log, vehicle) for log in logs for vehicle in (before, after)]))
    drives = []
    for (part, name, _), *pair in zip(logs, tables[::2], tables[1::2], strict=True):
        # The log evidence is compared only in the rows in which both runs used a
        # measurement. So both means are over the same rows.
        used = np.logical_and(*(np.isfinite(t["log_evidence"]) & (t["log_evidence"] != 0) for t in pair))
        drives.append(
            {
                "log": name,
                "part": part,
                "evidence": _collect_both(pair, lambda t, u=used: float(t.loc[u, "log_evidence"].mean())),
                "valid": _collect_both(
                    pair, lambda t: {k: float((t[f"{k}_valid"] == 1).mean()) for k in STIFFNESS}
                ),
            }
        )
    rows = [len(log) for _, _, log in logs]

    def mean(of: Callable[[dict[str, Any]], float]) -> float:
        return float(np.average([of(d) for d in drives], weights=rows))

    return {
        "log_evidence_per_row": {w: mean(lambda d, w=w: d["evidence"][w]) for w in BOTH},
        "valid": {w: {k: mean(lambda d, w=w, k=k: d["valid"][w][k]) for k in STIFFNESS} for w in BOTH},
        "logs": drives,
    }


def describe_gain(gained: Mapping[str, Any]) -> list[str]:
    """Return a sentence for each stiffness, for the terminal: the share of time in which
    the estimate is valid, with the vehicle file of the user and with the improved one.

    `gained` is the result of compute_gain().
    """
    shares = {k: [100 * gained["valid"][w][k] for w in BOTH] for k in STIFFNESS}
    return [
        f"The estimator's {NAMES[k][0].lower() + NAMES[k][1:]}: valid {old:.0f} -> {new:.0f} % of the time."
        for k, (old, new) in shares.items()
    ]


def _collect_both(pair: Sequence[pd.DataFrame], of: Callable[[pd.DataFrame], Any]) -> dict[str, Any]:
    return dict(zip(BOTH, map(of, pair), strict=True))
