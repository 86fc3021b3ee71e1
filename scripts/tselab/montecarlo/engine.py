"""Run a study: in this process, in a pool of processes or on a Dask cluster. Every run is
stored when it is finished.

A unit of work is a case with a seed. It is a plain tuple, and run_unit() is a plain
function, so that a unit can be sent to any process and has the same results in each.
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

RUNS = "runs.jsonl"  # file to which the scores of each run are appended when the run is finished
KEYS = ["case", "estimator", "seed"]  # columns of runs.csv that identify a row
NOISES = [f"noise_{channel}" for channel in MEASURES]
TIMES = ["simulate_s", "estimate_s"]  # columns with measured times, which are not reproducible


@dataclass(frozen=True)
class StudyPlan:
    """A study, and the options with which it runs."""

    study: Study
    runs: int  # number of runs of each case
    first_seed: int = 1
    form: str = "default"  # option --form, the settings from which estimators start
    settings: Mapping[str, float] = field(default_factory=dict)
    sim_settings: Mapping[str, float] = field(default_factory=dict)
    cases: tuple[str, ...] = ()  # value of the option --cases; empty: all cases

    @property
    def seeds(self) -> range:
        return range(self.first_seed, self.first_seed + self.runs)

    @property
    def units(self) -> list[Unit]:
        common = self.form, dict(self.settings), dict(self.sim_settings), hash_library()
        return [Unit(self.study.name, c.name, seed, *common) for c in self.study.cases for seed in self.seeds]


class Unit(NamedTuple):
    """A case with a seed, and everything that a worker process needs to run it."""

    study: str
    case: str
    seed: int
    form: str
    settings: dict[str, float]
    sim_settings: dict[str, float]
    library: str  # hash of the C library, which must be the same in every process

    @property
    def mark(self) -> str:
        """Digest of everything that determines the results of the unit."""
        return _hash(json.dumps([*self, hash_code()], sort_keys=True))


# ---- run one unit: all estimators of a case, on the drive with one seed


@functools.cache
def _load_study(name: str) -> Study:
    return studies.make_study(name)


def run_unit(unit: Unit) -> list[dict[str, Any]]:
    """Simulate the drive of a unit, and run every estimator of the case on it. Return a
    row of scores for each estimator."""
    if hash_library() != unit.library:
        raise UserError(
            f"the tse library {library().path} of this process differs from the one with which the study "
            "began: install the same library on all workers, and run the command again"
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
    """Repeat the run of the estimator `name` on a case with a seed. Return the drive, and
    the estimates in all rows, which a picture needs: run_study() stores only scores."""
    d = simulate_case(case, seed, lambda about: configure_unit("tse", plan, about), plan.sim_settings)
    return d, estimators.run_estimator(name, d, configure_unit(name, plan, d.about))


def configure_unit(name: str, unit: Unit | StudyPlan, about: Mapping[str, float]) -> Config:
    """Return the settings with which an estimator runs in a unit, from the settings of
    the user in `unit` and the settings of the case, `about`."""
    return estimators.configure_estimator(name, unit.form, unit.settings, about)


# ---- run all units of a study, in several processes


def run_study(
    plan: StudyPlan,
    out: Path,
    jobs: int = 1,
    scheduler: str | None = None,
    restart: bool = False,
    progress: bool = False,
) -> pd.DataFrame:
    """Run the units that are not in the file runs.jsonl of the folder `out` yet. Return
    the scores of all units of the plan, and write them to runs.csv.

    A line of runs.jsonl has the digest of a unit (Unit.mark), a checksum, and the
    scores. A line that is incomplete because the study was stopped has a wrong
    checksum, and is ignored. The file may also have lines from runs with other settings
    or with an earlier version of the code. These lines are not used, but they stay in
    the file. If the study is later run with those settings or that code again, their
    scores are read, and the runs are not repeated."""
    make_directory(out)
    path, units = out / RUNS, plan.units
    if restart:
        path.unlink(missing_ok=True)
    done = read_runs(path, units)
    left = [u for u in units if u.mark not in done]
    # a stopped study may have left an incomplete last line: new lines start after it
    _append(path, "\n")
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
                f"stopped by Ctrl-C; {path} keeps the {len(done)} of {len(units)} runs that are done, and "
                "the same command continues"
            ) from None
    table = pd.DataFrame([row for u in units for row in done[u.mark]], columns=list_columns(plan.study.name))
    order = [(c.name, e) for c in plan.study.cases for e in c.estimators]
    rank = [order.index(key) for key in zip(table["case"], table["estimator"], strict=True)]
    table = table.iloc[np.lexsort((table["seed"], rank))].reset_index(drop=True)
    table = table.astype({c: float for c in table if c not in KEYS})
    write_table(table, out / "runs.csv")
    return table


def read_runs(path: Path, units: list[Unit]) -> dict[str, list[dict[str, Any]]]:
    """Read the scores of units from runs.jsonl. Key of the result: digest of a unit
    (Unit.mark). Value: its rows of scores. Units that have not run are left out."""
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
    """Call result(), and return the rows of scores of the unit that it returns. If
    result() raises an error other than UserError, add case and seed to the message."""
    try:
        return result()
    except UserError:
        raise
    except Exception as error:
        raise RuntimeError(f"case {unit.case}, seed {unit.seed}: {type(error).__name__}: {error}") from error


def list_columns(study: str) -> list[str]:
    """Return the names of the columns of runs.csv for a study. Their number depends on
    the events and windows of its cases."""
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
    names += [f"{state}_square" for state in scores.SCORED_STATES]
    names += ["changes", "false_changes"]
    names += [f"{x}_{n}" for n in range(1, events) for x in ("detected", "all_settle", "valid_off")]
    return [*names, "diverged", "diverged_any", "recoveries", *NOISES, "seconds", "steps", *TIMES]


@functools.cache
def hash_code() -> str:
    """Return a digest of the Python code on which the scores depend: studies, manoeuvres,
    simulation, and filters for comparison."""
    files = {
        *Path(__file__).parent.glob("*.py"),
        *(Path(str(m.__file__)) for m in (core, maneuvers, simulate)),
    }
    return _hash("".join(p.read_text(encoding="utf-8") for p in sorted(files)))


def _hash(text: str) -> str:
    return hashlib.sha256(text.encode("utf-8", "replace")).hexdigest()[:24]
