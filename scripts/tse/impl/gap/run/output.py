"""What a run leaves in DIR: verdict.json, vehicle_improved.toml, effects.h, residuals.parquet, report.html, gap.png."""

from __future__ import annotations

import importlib.util
import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tse.impl.core import NOMINAL
from tse.impl.files import atomic
from tse.impl.gap.infer import show
from tse.impl.gap.run import add, gain, pictures, report, table
from tse.impl.gap.run.workflow import Result
from tse.impl.results import plain
from tse.impl.vehicle import fill_sensors, read_vehicle, stiffness_words

VERDICT, RESIDUALS, REPORT, PICTURE = "verdict.json", "residuals.parquet", "report.html", "gap.png"


@dataclass(frozen=True)
class Written:
    """What was made."""

    files: list[Path]
    gain: dict[str, Any]
    changes: dict[str, dict[str, show.Change]]  # of each part: its channels, before and after


def write_all(out: Path, result: Result, vehicle_path: Path, jobs: int = 1, say: Callable[[str], None] = lambda _: None) -> Written:
    """Add and Show."""
    problem, naming = result.problem, result.naming
    before, after = naming.baseline.values, result.after
    parts = {table.FIT: problem} | ({table.HELD_OUT: result.held} if result.held is not None else {})
    say("writing the improved vehicle")
    improved, header = add.write(out, vehicle_path, problem, result)
    result.words.insert(0, stiffness_words(read_vehicle(improved)))
    say("residuals before and after")
    rows = table.table(parts, before, after)
    table.write(out / RESIDUALS, rows)
    changes = {table.FIT: show.compare(problem, naming.baseline.residuals, result.final.residuals)}
    if result.held_out:
        changes[table.HELD_OUT] = result.held_out

    old, new = read_vehicle(vehicle_path), read_vehicle(improved)
    stiffness = {k: new.values[setting] / getattr(problem.config, setting) for k, setting in NOMINAL.items()}
    read = [(part, log.path.stem, log) for part, log in result.read]
    for vehicle in (old, new):  # the same sensors on both sides: those of the first log where the file is silent
        fill_sensors(vehicle, read[0][2])
    gained = gain.gain(read, old, new, jobs, say)

    say("report")
    named = vehicle_path.name if old.name == vehicle_path.stem else f"{old.name} ({vehicle_path.name})"
    shown = report.Shown(result, named, rows, changes, gained, stiffness, [*old.filled])
    report.write_report(out / REPORT, shown)
    with atomic(out / VERDICT) as file:
        json.dump(plain(result.as_json() | {"stiffness": stiffness, "estimator": gained}), file, indent=1, allow_nan=False)
        file.write("\n")
    files = [out / VERDICT, improved, header, *add.formula_files(out, improved), out / REPORT, out / RESIDUALS]
    if importlib.util.find_spec("matplotlib") is not None:
        pictures.picture(out / PICTURE, rows, headline(result))
        files.append(out / PICTURE)
    return Written(files, gained, changes)


def headline(result: Result) -> str:
    """The verdict in a few words."""
    if result.verdict == "none":
        return "Nothing is missing that these logs could show"
    if result.verdict == "not_in_catalogue":
        return "Not in the catalogue" + (f": {result.formula.text} at {result.formula.place}" if result.formula else "")
    if result.verdict == "possible":
        return f"Possible: {result.naming.possible[0]['id']}"
    return "Missing: " + " + ".join(n.effect.id for n in result.naming.named)
