"""Run all logs of a fleet: several cars at once, the drives of a car one after the
other, each from the learnt state of the one before. In processes of this machine or on
a Dask cluster, with the same numbers."""

import contextlib
import sys
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from tqdm import tqdm

from tse.library.errors import Interrupted
from tse.library.files import resolve_path
from tse.library.processes import (
    DaskCluster,
    Died,
    InProcess,
    LocalPool,
    Workers,
    check_workers,
    treat_kill_as_interrupt,
)
from tse.log.rows import Reading
from tse.runs.find import Drive
from tse.runs.keep import Done, Store
from tse.runs.work import Outcome, Task, read_code_version, run_task

MAX_CALIBRATION_LOGS = 4  # max number of logs of a car that calibrate it


@dataclass(frozen=True)
class FleetPlan:
    """Options that all logs share."""

    reading: Reading
    config: Path | None = None
    average: float | None = None
    form: str = "default"
    settings: dict[str, float] = field(default_factory=dict)
    learn: bool = True  # each drive starts from the learnt state of the drive before
    reports: bool = True
    estimates: bool = False
    calibrate: bool = True  # an uncalibrated car, on its first logs


def run_drives(
    drives: Sequence[Drive],
    plan: FleetPlan,
    store: Store,
    jobs: int = 1,
    scheduler: str | None = None,
    progress: bool = False,
) -> list[Done]:
    """Run the logs that are not done. Return all, in the order of `drives`. `jobs`:
    processes; 0: this one."""
    done: dict[Drive, Done] = {}
    chains = [_Chain(c, plan, store) for c in _group_chains(drives, plan.learn)]
    with tqdm(
        total=len(drives), unit="log", disable=not progress, file=sys.stderr, leave=False, desc="fleet"
    ) as bar:

        def keep(one: Done) -> None:
            done[one.drive] = one
            bar.update()
            bar.set_postfix_str(one.drive.log.name[-40:])

        try:
            with treat_kill_as_interrupt(), contextlib.ExitStack() as stack:
                workers: Workers | None = None
                waiting = deque(chains)
                running: dict[Path, _Chain] = {}
                while waiting or running:
                    while waiting:
                        chain = waiting.popleft()
                        task = chain.next(keep)
                        if task is None:
                            continue
                        if workers is None:  # no process is started if all is done
                            workers = stack.enter_context(_open_workers(min(jobs, len(chains)), scheduler))
                        running[task.log] = chain
                        workers.submit(task)
                    if running and workers is not None:
                        task, result = workers.next()
                        chain = running.pop(task.log)
                        keep(chain.take(task, get_outcome(task, result)))
                        waiting.append(chain)
        except KeyboardInterrupt:
            kept = f"{store.out} keeps the {len(done)} of {len(drives)} logs that are done"
            raise Interrupted(f"stopped; {kept}, the same command goes on from there") from None
    return [done[d] for d in drives]


def _open_workers(jobs: int, scheduler: str | None) -> Workers:
    if scheduler is not None:
        return DaskCluster(run_task, scheduler, check_workers)
    return LocalPool(run_task, jobs) if jobs else InProcess(run_task)


def get_outcome(task: Task, result: Callable[[], Outcome]) -> Outcome:
    """Return the outcome of a log, also if its process died."""
    try:
        return result()
    except Died as error:
        return Outcome(error=f"{task.log}: {error}: cut the log, or run it where there is more")


def _group_chains(drives: Sequence[Drive], learn: bool) -> list[list[Drive]]:
    """Return the drives that must run in order: those of a car."""
    if not learn:
        return [[d] for d in drives]
    cars: dict[str, list[Drive]] = {}
    for d in drives:
        cars.setdefault(d.car, []).append(d)
    return sorted(
        cars.values(), key=len, reverse=True
    )  # the longest chain first: it decides when all is done


class _Chain:
    """The drives of a car, and the learnt state of the last one."""

    def __init__(self, drives: Sequence[Drive], plan: FleetPlan, store: Store):
        self.drives, self.plan, self.store = deque(drives), plan, store
        self.calibrated: dict[Path, Path] = {}  # vehicle file -> the calibrated one
        self.learnt: bytes | None = None
        self.end = 0.0  # end of the drive that was learnt from, s since 1970

    def next(self, keep: Any) -> Task | None:
        """Return the next log that has to be run; keep the done ones on the way. None:
        no more."""
        while self.drives:
            drive = self.drives[0]
            if drive.error or drive.vehicle is None:
                self.drives.popleft()
                keep(Done(drive, Outcome(error=drive.error or f"{drive.log}: no vehicle file")))
                continue
            task = self.task(drive)
            kept = self.store.load(drive, task)
            if kept is None:
                return task
            self.drives.popleft()
            self._learn(drive, kept.outcome)
            keep(kept)
        return None

    def task(self, drive: Drive) -> Task:
        reading, plan = self.plan.reading, self.plan
        vehicle = self.calibrated.get(drive.vehicle, drive.vehicle) if drive.vehicle else None
        mine = (
            [d for d in self.drives if d.vehicle == drive.vehicle and not d.error][1:MAX_CALIBRATION_LOGS]
            if plan.learn
            else []
        )
        return Task(
            log=_resolve_path(drive.log),
            vehicle=_resolve_path(vehicle),
            signals=_resolve_path(drive.signals or reading.signals),
            rate=reading.rate,
            strict=reading.strict,
            databases=tuple(_resolve_path(p) for p in reading.databases),
            config=_resolve_path(plan.config),
            average=plan.average,
            form=plan.form,
            settings=plan.settings,
            learnt=self.learnt,
            age=max(0.0, drive.start - self.end) if self.learnt is not None else 0.0,
            report=plan.reports,
            estimates=self.store.estimates(drive) if plan.estimates else None,
            code=read_code_version(),
            calibrate=plan.calibrate and vehicle == drive.vehicle,
            others=tuple((_resolve_path(d.log), _resolve_path(d.signals or reading.signals)) for d in mine)
            if vehicle == drive.vehicle
            else (),
        )

    def take(self, task: Task, outcome: Outcome) -> Done:
        drive = self.drives.popleft()
        outcome.error = outcome.error.replace(str(task.log), str(drive.log))
        self._learn(drive, outcome)
        return self.store.save(drive, task, outcome)

    def _learn(self, drive: Drive, outcome: Outcome) -> None:
        if self.plan.learn and outcome.calibrated and drive.vehicle:
            self.calibrated[drive.vehicle] = self.store.calibrated(drive, outcome.calibrated)
        if self.plan.learn and outcome.learnt is not None:
            self.learnt, self.end = outcome.learnt, drive.start + outcome.seconds


def _resolve_path(path: Path | None) -> Any:
    """Return an absolute path: workers may run in another folder."""
    return resolve_path(path) if path is not None else None


def group_by_car(done: Sequence[Done]) -> Iterator[tuple[str, list[Done]]]:
    """Yield the logs car by car, in order of time."""
    for car in dict.fromkeys(d.drive.car for d in done):
        yield car, [d for d in done if d.drive.car == car]
