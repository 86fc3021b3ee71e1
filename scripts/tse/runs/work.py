"""Estimate one log of a fleet in a worker. A worker is this process, a different process,
or a process on a different machine. It receives a Task and returns an Outcome."""

import tempfile
import traceback
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from tse.calibration.own import is_uncalibrated
from tse.car.vehicle import read_vehicle
from tse.channels.agree import read_agreeing
from tse.estimation.estimate import Learnt
from tse.library import __version__
from tse.library.core import NativeFilter, hash_library
from tse.library.errors import UserError
from tse.log.rows import CheckedLog, Reading
from tse.report import results
from tse.runs import single
from tse.runs.single import Calibrate, prepare_run


class Mismatch(UserError):
    """A worker has a different version of tselab or of the C library than the process
    that sent the task. Its results could differ."""


@dataclass(frozen=True)
class Task:
    """One log, and everything that a worker needs to estimate it."""

    log: Path
    vehicle: Path
    signals: Path | None  # file that assigns the signals of `log` to channels; None: as in `others`
    rate: float | None
    strict: bool
    databases: tuple[Path, ...]
    config: Path | None
    average: float | None
    form: str
    settings: Mapping[str, float]
    learnt: bytes | None  # learnt state after the previous drive of the car; None: there is none
    age: float  # [s] time from the end of the previous drive to the start of this one
    report: bool  # whether a report (HTML page) is written
    estimates: Path | None  # file for the estimates of every row; None: they are not written
    calibrate: bool  # whether an uncalibrated car is calibrated on this log and on `others`
    # further logs of the car, each with the file that assigns its signals to channels.
    # None: the file signals.toml in the folder of the log, if there is one
    others: tuple[tuple[Path, Path | None], ...]
    code: tuple[str, str]  # read_code_version() in the process that sends the task to the worker


@dataclass
class Outcome:
    """Result of a task."""

    error: str = ""  # why the log could not be estimated; empty: no error
    # a dict for each stiffness on each stretch of road (part of the drive from one
    # detected change of the stiffness to the next), with the keys of
    # results.ESTIMATE_COLUMNS
    rows: list[dict[str, Any]] = field(default_factory=list)
    learnt: bytes | None = None  # learnt state after this drive
    report: bytes | None = None  # content of the report (HTML page); None: none was written
    seconds: float = 0.0  # [s] duration of the log
    # exit code, from results.choose_exit_code(). 0: all stiffnesses are usable; 3: they
    # are usable in part; 4: none is usable
    code: int = 4
    notes: list[str] = field(default_factory=list)
    # text of the vehicle file that was calibrated on this log; empty: there was no
    # calibration
    calibrated: str = ""


def read_code_version() -> tuple[str, str]:
    """Return the version of tselab and the digest of the C library of this process."""

    return __version__, hash_library()


def run_task(task: Task) -> Outcome:
    """Estimate one log. If it cannot be estimated, return an outcome with the error.

    Raise Mismatch if this process has a different tselab or C library than the sender."""
    version, digest = read_code_version()
    if (version, digest) != task.code:
        raise Mismatch(
            f"a worker has tselab {version} and library {digest[:8]}, but {task.code[0]} and "
            f"{task.code[1][:8]} are needed: install the same version on all workers"
        )
    try:
        return _run_log(task)
    except UserError as error:
        return Outcome(error=str(error))
    except MemoryError:
        return Outcome(
            error=f"{task.log}: is too long for the memory of this machine: cut the log, or run it on a "
            "machine with more memory"
        )
    except Exception as error:
        where = traceback.extract_tb(error.__traceback__)[-1]
        return Outcome(
            error=f"{task.log}: internal error: {type(error).__name__}: {error} "
            f"({Path(where.filename).name}:{where.lineno}); "
            "this is an error in tselab, please report it"
        )


def _run_log(task: Task) -> Outcome:
    """Estimate one log. Raise UserError if it cannot be estimated."""
    reading = Reading(task.signals, task.rate, task.strict, task.databases)
    itself, of_others = None, list[str]()
    if task.calibrate and is_uncalibrated(car := read_vehicle(task.vehicle)):
        others: list[CheckedLog] = []
        for log, signals in task.others:
            with suppress(UserError):
                others += read_agreeing([log], of_others, replace(reading, signals=signals, car=car))
        itself = Calibrate(others=others)
    prepared = prepare_run(
        task.log, task.vehicle, task.config, task.average, {}, task.form, task.settings, reading, itself
    )
    made = prepared.own.text if prepared.own else ""
    # a state that was learnt before the calibration is not valid with the new parameters
    before = task.learnt if not made else None
    learnt = Learnt(Path("the previous drive"), before, task.age, True) if before is not None else None
    if learnt is not None:
        try:
            learnt.load(NativeFilter(prepared.config))
        except UserError as error:
            prepared.notes.append(f"the learnt state of the previous drive is not used: {error}")
            learnt = None
    with tempfile.TemporaryDirectory() as scratch:
        report = Path(scratch) / "report.html" if task.report else None
        ran = single.run_prepared(prepared, task.estimates, report, learnt)
        page = report.read_bytes() if report is not None and ran.reported else None
    time = ran.estimate.table["time"]
    return Outcome(
        rows=results.make_rows(
            task.log,
            ran.estimate,
            ran.findings,
            ran.changes,
            [*prepared.warnings, *prepared.doubts, *prepared.log.warnings],
        ),
        # if channels contradict each other, the learnt state is wrong and is discarded
        learnt=None if prepared.warnings else ran.estimate.learnt,
        report=page,
        seconds=float(time.iloc[-1] - time.iloc[0]) if len(time) else 0.0,
        code=results.choose_exit_code(ran.findings),
        notes=[*prepared.vehicle.found, *of_others, *ran.notes],
        calibrated=made,
    )
