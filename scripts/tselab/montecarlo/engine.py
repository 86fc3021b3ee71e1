"""All runs of a study: in this process, in a pool of processes or on a Dask cluster;
every finished run is kept at once.

A unit of work is a case and a seed. It is a plain tuple and run_unit() a plain function,
so that every way of running does the same and gives the same numbers.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import json
import sys
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from tqdm import tqdm

from tse.estimation.estimate import write_table
from tse.library import core
from tse.library.core import STIFFNESS, Config, hash_library, library
from tse.library.errors import Interrupted, UserError
from tse.library.files import make_directory
from tse.library.processes import run_in_processes, treat_kill_as_interrupt
from tse.log.rows import MEASURES
from tse.simulation import maneuvers, simulate
from tselab.montecarlo import estimators, scores, studies
from tselab.montecarlo.case import Case, CaseDrive, simulate_case
from tselab.montecarlo.studies import Study

RUNS = "runs.jsonl"
KEYS = ["case", "estimator", "seed"]
NOISES = [f"noise_{channel}" for channel in MEASURES]
TIMES = ["simulate_s", "estimate_s"]  # differ from run to run


@dataclass(frozen=True)
class StudyPlan:
    """What is to be run."""

    study: Study
    runs: int
    first_seed: int = 1
    form: str = "default"
    settings: Mapping[str, float] = field(default_factory=dict)
    sim_settings: Mapping[str, float] = field(default_factory=dict)
    cases: tuple[str, ...] = ()  # as asked for; empty: all

    @property
    def seeds(self) -> range:
        return range(self.first_seed, self.first_seed + self.runs)

    @property
    def units(self) -> list[Unit]:
        common = self.form, dict(self.settings), dict(self.sim_settings), hash_library()
        return [Unit(self.study.name, c.name, seed, *common) for c in self.study.cases for seed in self.seeds]


class Unit(NamedTuple):
    """One seed of one case, and all that a process elsewhere must know to run it."""

    study: str
    case: str
    seed: int
    form: str
    settings: dict[str, float]
    sim_settings: dict[str, float]
    library: str  # hash: every process has to run the same

    @property
    def mark(self) -> str:
        """Of all that decides its numbers."""
        return _hash(json.dumps([*self, hash_code()], sort_keys=True))


# ---- one unit


@functools.cache
def _load_study(name: str) -> Study:
    return studies.make_study(name)


def run_unit(unit: Unit) -> list[dict[str, Any]]:
    """Simulate once, run every estimator of the case on it: one row each."""
    if hash_library() != unit.library:
        raise UserError(
            f"the tse library {library().path} is not, or no longer, the one that the study began with; "
            "start it again"
        )
    case = _load_study(unit.study).case(unit.case)
    start = time.perf_counter()
    d = simulate_case(case, unit.seed, lambda about: configure_unit("tse", unit, about), unit.sim_settings)
    known = scores.find_knowable(d, case)
    simulated = time.perf_counter() - start
    rows = []
    for name in case.estimators:
        config = configure_unit(name, unit, d.about)
        start = time.perf_counter()
        estimate = estimators.run_estimator(name, d, config)
        took = time.perf_counter() - start
        row: dict[str, Any] = {"case": unit.case, "estimator": name, "seed": unit.seed}
        row |= scores.score_run(d, case, known, estimate)
        row |= {"seconds": float(d.time[-1] - d.time[0]), "steps": len(d.rows)}
        rows.append(row | {"simulate_s": simulated, "estimate_s": took})
    return rows


def trace_run(plan: StudyPlan, case: Case, seed: int, name: str) -> tuple[CaseDrive, np.ndarray]:
    """One run once more, with all its rows: for a picture."""
    d = simulate_case(case, seed, lambda about: configure_unit("tse", plan, about), plan.sim_settings)
    return d, estimators.run_estimator(name, d, configure_unit(name, plan, d.about))


def configure_unit(name: str, unit: Unit | StudyPlan, about: Mapping[str, float]) -> Config:
    """The settings of an estimator in a unit."""
    return estimators.configure_estimator(name, unit.form, unit.settings, about)


# ---- all units


def run_study(
    plan: StudyPlan,
    out: Path,
    jobs: int = 1,
    scheduler: str | None = None,
    restart: bool = False,
    progress: bool = False,
) -> pd.DataFrame:
    """Run what is not yet in OUT/runs.jsonl; all rows of the plan, which OUT/runs.csv
    gets, too.

    A line holds the rows of a unit behind what they are of and a sum of themselves. Lines
    of another plan or of older code stay there for a plan that they are of; what a stop
    has cut is no line."""
    make_directory(out)
    path, units = out / RUNS, plan.units
    if restart:
        path.unlink(missing_ok=True)
    done = read_runs(path, units)
    left = [u for u in units if u.mark not in done]
    _append(path, "\n")  # the last line may be cut
    with tqdm(
        total=len(left), unit="run", disable=not progress, file=sys.stderr, leave=False, desc=plan.study.name
    ) as bar:
        try:
            with (
                treat_kill_as_interrupt(),
                contextlib.closing(run_in_processes(run_unit, left, jobs, scheduler)) as results,
            ):
                for unit, result in results:
                    done[unit.mark] = _locate_error(unit, result)
                    text = json.dumps(done[unit.mark], default=float)
                    _append(path, f"{unit.mark} {_hash(text)} {text}\n")
                    bar.update()
                    bar.set_postfix_str(f"{unit.case} seed {unit.seed}")
        except KeyboardInterrupt:
            raise Interrupted(
                f"stopped; {path} keeps the {len(done)} of {len(units)} runs that are done, the same "
                "command goes on from there"
            ) from None
    table = pd.DataFrame([row for u in units for row in done[u.mark]], columns=list_columns(plan.study.name))
    order = [(c.name, e) for c in plan.study.cases for e in c.estimators]
    rank = [order.index(key) for key in zip(table["case"], table["estimator"], strict=True)]
    table = table.iloc[np.lexsort((table["seed"], rank))].reset_index(drop=True)
    table = table.astype({c: float for c in table if c not in KEYS})
    write_table(table, out / "runs.csv")
    return table


def read_runs(path: Path, units: list[Unit]) -> dict[str, list[dict[str, Any]]]:
    """The rows of those of the units that are there, by their marks."""
    wanted, found = {u.mark for u in units}, {}
    if path.exists():
        for line in path.read_text(encoding="utf-8", errors="replace").split("\n"):
            mark, _, rest = line.partition(" ")
            check, _, text = rest.partition(" ")
            if mark in wanted and check == _hash(text):
                found[mark] = json.loads(text)
    return found


def _append(path: Path, text: str) -> None:
    try:
        with open(path, "a", encoding="utf-8") as file:
            file.write(text)
    except OSError as error:
        raise UserError(f"{path}: cannot be written: {error.strerror}") from None


def _locate_error(unit: Unit, result: Any) -> list[dict[str, Any]]:
    try:
        return result()
    except UserError:
        raise
    except Exception as error:
        raise RuntimeError(f"case {unit.case}, seed {unit.seed}: {type(error).__name__}: {error}") from error


def list_columns(study: str) -> list[str]:
    """Columns of runs.csv."""
    names = list(KEYS)
    cases = _load_study(study).cases
    events = max(len(c.events) for c in cases) + 1
    windows = range(max(len(c.windows) for c in cases))
    for key in STIFFNESS:
        names += [
            f"{key}_{x}" for x in ("mean_square", "bias", "covered", "sd_square", "spread", "spread_seen")
        ]
        names += [
            f"{key}_{x}_w{n}" for n in windows for x in ("mean_square", "covered", "bias", "off", "spread")
        ]
        names += [f"{key}_{x}_{n}" for x in ("settle", "stay") for n in range(events)]
        names += [f"{key}_{x}" for x in ("judged", "worst", "diverged")]
        for share in scores.SHARES:
            names += [f"{key}_{share}", f"{key}_{share}_of"]
    names += [f"{state}_square" for state in scores.STATES]
    names += ["changes", "false_changes"]
    names += [f"{x}_{n}" for n in range(1, events) for x in ("detected", "all_settle", "valid_off")]
    return [*names, "diverged", "diverged_any", "recoveries", *NOISES, "seconds", "steps", *TIMES]


@functools.cache
def hash_code() -> str:
    """What makes the numbers beside the library and the settings: the files of studies,
    manoeuvres and other filters."""
    files = {
        *Path(__file__).parent.glob("*.py"),
        *(Path(str(m.__file__)) for m in (core, maneuvers, simulate)),
    }
    return _hash("".join(p.read_text(encoding="utf-8") for p in sorted(files)))


def _hash(text: str) -> str:
    return hashlib.sha256(text.encode("utf-8", "replace")).hexdigest()[:24]
