"""All runs of a study: in this process, in a pool of processes or on a Dask cluster; every finished run is kept at once.

A unit of work is a case and a seed. It is a plain tuple and run_unit() a plain function, so that every way of running does
the same and gives the same numbers.
"""

from __future__ import annotations

import contextlib
import csv
import functools
import hashlib
import importlib.util
import io
import json
import sys
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from tqdm import tqdm

from tselab import __version__
from tselab.core import STIFFNESS, Config, SimConfig, library, library_hash
from tselab.errors import UserError
from tselab.files import atomic
from tselab.montecarlo import estimators, scores, studies
from tselab.montecarlo.case import Case, Drive, drive
from tselab.montecarlo.studies import Study
from tselab.processes import each, killed_as_interrupted
from tselab.rows import MEASURES
from tselab.study import START

RUNS, SETTINGS = "runs.csv", "settings.json"
KEYS = ["case", "estimator", "seed", "fingerprint"]
NOISES = [f"noise_{channel}" for channel in MEASURES]
TIMES = ["simulate_s", "estimate_s"]  # differ from run to run


class Interrupted(Exception):
    """Ctrl-C; the text says how to go on."""


@dataclass(frozen=True)
class Plan:
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


class Unit(NamedTuple):
    """One seed of one case, and all that a process elsewhere must know to run it."""

    study: str
    case: str
    seed: int
    form: str
    settings: dict[str, float]
    sim_settings: dict[str, float]
    library: str  # hash: every process has to run the same


# ---- one unit


@functools.cache
def _study(name: str) -> Study:
    return studies.study(name)


def run_unit(unit: Unit) -> list[dict[str, Any]]:
    """Simulate once, run every estimator of the case on it: one row each."""
    if library_hash() != unit.library:
        raise UserError(
            f"the tse library {library().path} is not, or no longer, the one that the study began with; start it again"
        )
    case = _study(unit.study).case(unit.case)
    start = time.perf_counter()
    d = drive(case, unit.seed, lambda about: configure("tse", unit, about), unit.sim_settings)
    known = scores.knowable(d, case)
    simulated = time.perf_counter() - start
    rows = []
    for name in case.estimators:
        config = configure(name, unit, d.about)
        start = time.perf_counter()
        estimate = estimators.run(name, d, config)
        took = time.perf_counter() - start
        row: dict[str, Any] = {"case": unit.case, "estimator": name, "seed": unit.seed}
        row |= scores.score(d, case, known, estimate)
        row |= {"seconds": float(d.time[-1] - d.time[0]), "steps": len(d.rows)}
        rows.append(row | {"simulate_s": simulated, "estimate_s": took})
    return rows


def trace(plan: Plan, case: Case, seed: int, name: str) -> tuple[Drive, np.ndarray]:
    """One run once more, with all its rows: for a picture."""
    d = drive(case, seed, lambda about: configure("tse", plan, about), plan.sim_settings)
    return d, estimators.run(name, d, configure(name, plan, d.about))


def configure(name: str, unit: Unit | Plan, about: Mapping[str, float]) -> Config:
    """The settings of an estimator in a unit."""
    return estimators.configure(name, unit.form, unit.settings, about)


# ---- all units


def run(
    plan: Plan, out: Path, jobs: int = 1, scheduler: str | None = None, restart: bool = False, progress: bool = False
) -> pd.DataFrame:
    """Run what is not yet in `out`; all rows of the plan."""
    store = Store(plan, out, restart)
    done = store.read()
    todo = [u for u in store.units() if (u.case, u.seed) not in done]
    with (
        tqdm(
            total=len(todo), unit="run", disable=not progress, file=sys.stderr, leave=False, desc=plan.study.name
        ) as bar,
        store.writer() as write,
    ):
        try:
            with killed_as_interrupted(), contextlib.closing(each(run_unit, todo, jobs, scheduler)) as results:
                for unit, result in results:
                    write(_said_where(unit, result))
                    done.add((unit.case, unit.seed))
                    bar.update()
                    bar.set_postfix_str(f"{unit.case} seed {unit.seed}")
        except KeyboardInterrupt:
            units = store.units()
            kept = sum((u.case, u.seed) in done for u in units)
            raise Interrupted(
                f"stopped; {store.path} keeps the {kept} of {len(units)} runs that are done, "
                "the same command goes on from there"
            ) from None
    return store.table()


def _said_where(unit: Unit, result: Any) -> list[dict[str, Any]]:
    try:
        return result()
    except UserError:
        raise
    except Exception as error:
        raise RuntimeError(f"case {unit.case}, seed {unit.seed}: {type(error).__name__}: {error}") from error


# ---- what is kept


class Store:
    """OUT/runs.csv, and OUT/settings.json, which says what made it."""

    def __init__(self, plan: Plan, out: Path, restart: bool):
        self.plan, self.out, self.path = plan, out, out / RUNS
        self.columns = columns(plan.study.name)
        self.settings = fingerprint(plan)
        if out.exists() and not out.is_dir():
            raise UserError(f"{out}: is a file, a directory is needed")
        try:
            out.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise UserError(f"{out}: cannot be made: {error.strerror}") from None
        if restart:
            for name in (RUNS, SETTINGS):
                (out / name).unlink(missing_ok=True)
        self._merge()

    def _merge(self) -> None:
        """Compare with what is there; add the cases that are new."""
        file = self.out / SETTINGS
        if not self.path.exists():
            before = None
        else:
            try:
                before = json.loads(file.read_text(encoding="utf-8"))
                if not all(isinstance(h, str) for h in before["cases"].values()):
                    raise TypeError("cases are compared by their hashes")
            except (OSError, ValueError, LookupError, AttributeError, TypeError, RecursionError):
                raise UserError(
                    f"{self.path}: no readable {SETTINGS} beside it says what made it; {_WAY_OUT}"
                ) from None
        if before is not None:
            differs = list(_differences(before, self.settings))
            now = [c.name for c in _study(self.plan.study.name).cases]
            if before.get("study") == self.plan.study.name and (gone := [c for c in before["cases"] if c not in now]):
                differs.append(f"the study has no case {', '.join(gone)} any more")
            if differs:
                raise UserError(f"{self.path}: was made with other settings: {'; '.join(differs)}; {_WAY_OUT}")
            self.settings["cases"] = before["cases"] | self.settings["cases"]
        with atomic(file) as f:
            json.dump(self.settings, f, indent=1)
            f.write("\n")
        # what a row of each case carries to show where it belongs
        self.marks = {c: _hash({**self.settings, "cases": h})[:12] for c, h in self.settings["cases"].items()}

    def units(self) -> list[Unit]:
        p = self.plan
        common = p.form, dict(p.settings), dict(p.sim_settings), library_hash()
        return [Unit(p.study.name, c.name, seed, *common) for c in p.study.cases for seed in p.seeds]

    def read(self) -> set[tuple[str, int]]:
        """The runs that are there in full. What a stop has cut is dropped from the file."""
        if not self.path.exists():
            with atomic(self.path) as file:
                file.write(",".join(self.columns) + "\n")
            return set()
        try:
            lines = self.path.read_text(encoding="utf-8").split("\n")
            cut = lines.pop()  # '' after a whole line
            if not lines or lines[0] != ",".join(self.columns):
                raise UserError(f"{self.path}: is not a table of study {self.plan.study.name}; {_WAY_OUT}")
            units = self._units_of(lines[1:])
        except UserError:
            raise
        except (ValueError, csv.Error) as error:  # not UTF-8; a cell that no reader takes
            raise UserError(f"{self.path}: is damaged: {error}; {_WAY_OUT}") from None
        complete = {}
        for (case, seed), found in units.items():
            if set(found) == set(_study(self.plan.study.name).case(case).estimators):
                complete[case, seed] = found
        rows = [line for found in complete.values() for line in found.values()]
        if cut or len(rows) != len(lines) - 1:
            with atomic(self.path) as file:
                file.write("\n".join([lines[0], *rows]) + "\n")
        return set(complete)

    def _units_of(self, lines: list[str]) -> dict[tuple[str, int], dict[str, str]]:
        """The lines of each unit, by their estimator; without those that a stop has cut."""
        units: dict[tuple[str, int], dict[str, str]] = {}
        for line in lines:
            cells = next(csv.reader([line]), [])
            if len(cells) != len(self.columns) or not cells[2].isdigit():
                continue
            case, estimator, seed, mark = cells[:4]
            if mark != self.marks.get(case):
                raise UserError(f"{self.path}: holds runs of another study (case {case}, seed {seed}); {_WAY_OUT}")
            units.setdefault((case, int(seed)), {})[estimator] = line
        return units

    @contextlib.contextmanager
    def writer(self) -> Iterator[Any]:
        """Appends the rows of a unit in one write."""
        with open(self.path, "a", encoding="utf-8", newline="") as file:

            def write(rows: list[dict[str, Any]]) -> None:
                text = io.StringIO()
                sheet = csv.DictWriter(text, self.columns, lineterminator="\n")
                for row in rows:
                    row["fingerprint"] = self.marks[row["case"]]
                    sheet.writerow({k: f"{v:.7g}" if isinstance(v, float) else v for k, v in row.items()})
                file.write(text.getvalue())
                file.flush()

            yield write

    def table(self) -> pd.DataFrame:
        """The rows of the plan, in the order of its cases, estimators and seeds."""
        kinds = {"fingerprint": str, **{c: float for c in self.columns if c not in KEYS}}
        try:
            table = pd.read_csv(self.path, dtype=kinds)
        except (ValueError, OverflowError) as error:  # of pandas, also its parser's
            raise UserError(f"{self.path}: is damaged: {error}; {_WAY_OUT}") from None
        cases = [c.name for c in self.plan.study.cases]
        table = table[table["case"].isin(cases) & table["seed"].isin(self.plan.seeds)]
        order = {(c.name, e): i for i, (c, e) in enumerate((c, e) for c in self.plan.study.cases for e in c.estimators)}
        rank = [order[key] for key in zip(table["case"], table["estimator"], strict=True)]
        return table.iloc[np.lexsort((table["seed"], rank))].reset_index(drop=True)


_WAY_OUT = "name another --out, or discard it with --restart"


def columns(study: str) -> list[str]:
    """Columns of runs.csv."""
    names = list(KEYS)
    cases = _study(study).cases
    events = max(len(c.events) for c in cases) + 1
    windows = range(max(len(c.windows) for c in cases))
    for key in STIFFNESS:
        names += [f"{key}_{x}" for x in ("mean_square", "bias", "covered", "sd_square", "spread", "spread_seen")]
        names += [f"{key}_{x}_w{n}" for n in windows for x in ("mean_square", "covered", "bias", "off", "spread")]
        names += [f"{key}_{x}_{n}" for x in ("settle", "stay") for n in range(events)]
        names += [f"{key}_{x}" for x in ("judged", "worst", "diverged")]
        for share in scores.SHARES:
            names += [f"{key}_{share}", f"{key}_{share}_of"]
    names += [f"{state}_square" for state in scores.STATES]
    names += ["changes", "false_changes"]
    names += [f"{x}_{n}" for n in range(1, events) for x in ("detected", "all_settle", "valid_off")]
    return [*names, "diverged", "diverged_any", "recoveries", *NOISES, "seconds", "steps", *TIMES]


def fingerprint(plan: Plan) -> dict[str, Any]:
    """All that decides the numbers, but for the seeds."""
    return {
        "study": plan.study.name,
        "form": plan.form,
        "settings": dict(plan.settings),
        "simulator settings": dict(plan.sim_settings),
        "defaults": _hash([Config().as_dict(), SimConfig().as_dict(), START]),
        "tselab": __version__,
        "library version": f"{library().version}, {library().format}, up to {library().capacity} particles",
        "library file": library_hash(),
        "cases": {c.name: _case_hash(c) for c in plan.study.cases},
    }


# What makes the numbers beside the library and the settings.
_SOURCES = ("montecarlo.case", "montecarlo.corrupt", "montecarlo.drives", "montecarlo.scores", "maneuvers", "simulate")
_SOURCES_OF = {
    "ekf": ("peers",), "ukf": ("peers",), "known": ("peers",),
}  # fmt: skip


def _case_hash(case: Case) -> str:
    own = {name: estimators.overrides(name) for name in case.estimators}
    sources = {*_SOURCES, *(m for e in case.estimators for m in _SOURCES_OF.get(e, ()))}
    return _hash([_plain(case), own, [_source_hash(m) for m in sorted(sources)]])


def _source_hash(module: str) -> str:
    spec = importlib.util.find_spec(f"tselab.{module}")
    return _hash(Path(spec.origin).read_bytes()) if spec and spec.origin else ""


def _plain(value: Any) -> Any:
    """A case as JSON can hold it; functions by their names."""
    if isinstance(value, functools.partial):
        return [_plain(value.func), _plain(value.args), _plain(value.keywords)]
    if callable(value):
        return f"{value.__module__}.{value.__qualname__}"
    if isinstance(value, Case):
        return {f.name: _plain(getattr(value, f.name)) for f in fields(value) if f.name != "title"}
    if isinstance(value, Mapping):
        return {k: _plain(v) for k, v in value.items()}
    return [_plain(v) for v in value] if isinstance(value, (list, tuple)) else value


def _hash(value: Any) -> str:
    data = value if isinstance(value, bytes) else json.dumps(value, sort_keys=True).encode()
    return hashlib.sha256(data).hexdigest()


def _differences(before: Mapping[str, Any], now: Mapping[str, Any]) -> Iterator[str]:
    for name, value in now.items():
        old = before.get(name)
        if name == "cases":
            changed = [c for c in value if c in old and old[c] != value[c]]
            if changed:
                yield f"the definition of case {', '.join(changed)} has changed"
        elif old != value:
            yield f"{name} was {_short(old)}, is {_short(value)}"


def _short(value: Any) -> str:
    text = value if isinstance(value, str) else json.dumps(value)
    return text[:12] if len(text) == 64 and text.isalnum() else text
