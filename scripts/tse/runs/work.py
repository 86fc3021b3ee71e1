"""One log of a fleet: the task, the work and the outcome of a process, here or
elsewhere."""

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
    """This process has another tselab or library than the one that sent the task, so
    all numbers would be in doubt."""


@dataclass(frozen=True)
class Task:
    """One log and everything that is needed to run it. `learnt`: learnt state of the
    drive before, `age` s older."""

    log: Path
    vehicle: Path
    signals: Path | None
    rate: float | None
    strict: bool
    databases: tuple[Path, ...]
    config: Path | None
    average: float | None
    form: str
    settings: Mapping[str, float]
    learnt: bytes | None
    age: float
    report: bool
    estimates: Path | None
    calibrate: bool  # an uncalibrated car, on this log and on `others`, each with its signals
    others: tuple[tuple[Path, Path | None], ...]
    code: tuple[str, str]  # read_code_version() of the sender


@dataclass
class Outcome:
    """The outcome of a task."""

    error: str = ""
    rows: list[dict[str, Any]] = field(default_factory=list)  # results.COLUMNS
    learnt: bytes | None = None
    report: bytes | None = None
    seconds: float = 0.0  # duration of the log
    code: int = 4  # results.choose_exit_code()
    notes: list[str] = field(default_factory=list)
    calibrated: str = ""  # text of the vehicle file that this log has calibrated


def read_code_version() -> tuple[str, str]:
    """Return version of tselab and digest of the library of this process."""

    return __version__, hash_library()


def run_task(task: Task) -> Outcome:
    """Run one log. A log that cannot be used is an outcome, not an exception."""
    version, digest = read_code_version()
    if (version, digest) != task.code:
        raise Mismatch(
            f"a worker has tselab {version}, library {digest[:8]}; asked is {task.code[0]}, "
            f"{task.code[1][:8]}: install the same on all"
        )
    try:
        return _run_log(task)
    except UserError as error:
        return Outcome(error=str(error))
    except MemoryError:
        return Outcome(
            error=f"{task.log}: is too long for the memory of this machine: cut it, or run it where there "
            "is more"
        )
    except Exception as error:
        where = traceback.extract_tb(error.__traceback__)[-1]
        return Outcome(
            error=f"{task.log}: internal error: {type(error).__name__}: {error} "
            f"({Path(where.filename).name}:{where.lineno}); "
            "a fault of tselab, please report it"
        )


def _run_log(task: Task) -> Outcome:

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
    # A state that was learnt with the uncalibrated car does not fit
    before = task.learnt if not made else None
    learnt = Learnt(Path("the drive before"), before, task.age, True) if before is not None else None
    if learnt is not None:
        try:
            learnt.load(NativeFilter(prepared.config))
        except UserError as error:
            prepared.notes.append(f"what the drive before taught is not used: {error}")
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
        learnt=None
        if prepared.warnings
        else ran.estimate.learnt,  # nothing is learnt from contradicting channels
        report=page,
        seconds=float(time.iloc[-1] - time.iloc[0]) if len(time) else 0.0,
        code=results.choose_exit_code(ran.findings),
        notes=[*prepared.vehicle.found, *of_others, *ran.notes],
        calibrated=made,
    )
