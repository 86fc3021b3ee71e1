"""Run all logs of a fleet. Several cars run in parallel. The drives of a car run one
after the other, each from the learnt state of the previous drive. The logs run in
processes on this machine or on a Dask cluster. The results are the same on both."""

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
from tse.library.processes import DaskCluster, Died, InProcess, LocalPool, Workers, treat_kill_as_interrupt
from tse.log.rows import Reading
from tse.runs.find import Drive
from tse.runs.keep import Done, Store
from tse.runs.work import Outcome, Task, read_code_version, run_task

MAX_CALIBRATION_LOGS = 4  # a car is calibrated on at most this many of its first logs


@dataclass(frozen=True)
class FleetPlan:
    """Options of a fleet, the same for all logs; see tse.fleet()."""

    reading: Reading
    config: Path | None = None
    average: float | None = None
    form: str = "default"
    settings: dict[str, float] = field(default_factory=dict)
    learn: bool = True  # whether each drive starts from the learnt state of the previous one
    reports: bool = True  # whether a report (HTML page) is written for each log
    estimates: bool = False  # whether the estimates for each row of a log are written to a file
    calibrate: bool = True  # whether an uncalibrated car is calibrated on its first logs


def run_drives(
    drives: Sequence[Drive],
    plan: FleetPlan,
    store: Store,
    jobs: int = 1,
    scheduler: str | None = None,
    progress: bool = False,
) -> list[Done]:
    """Run the logs that have no valid outcome in `store` from an earlier call. Return the
    outcomes of all logs, stored and new ones, in the order of `drives`.

    `jobs`: number of worker processes on this machine; 0: run in this process.
    `scheduler`: address of a Dask cluster. If it is given, the logs run on this cluster
    and not on this machine. `progress`: show a progress bar."""
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
                        task = chain.find_next(keep)
                        if task is None:
                            continue
                        if workers is None:  # start processes only if a log has to run
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
            raise Interrupted(f"stopped by Ctrl-C; {kept}, and the same command continues") from None
    return [done[d] for d in drives]


def _open_workers(jobs: int, scheduler: str | None) -> Workers:
    if scheduler is not None:
        return DaskCluster(run_task, scheduler)
    return LocalPool(run_task, jobs) if jobs else InProcess(run_task)


def get_outcome(task: Task, result: Callable[[], Outcome]) -> Outcome:
    """Return the outcome of a log. If the process that ran the log died, return an
    outcome with an error."""
    try:
        return result()
    except Died as error:
        return Outcome(error=f"{task.log}: {error}: cut the log, or run it on a machine with more memory")


def _group_chains(drives: Sequence[Drive], learn: bool) -> list[list[Drive]]:
    """Return groups of drives. The drives of a group run one after the other, different
    groups run in parallel. If `learn` is True, a group has all drives of a car, otherwise
    a single drive. The group with the most drives comes first: it takes longest, and if
    it started last, the other processes would wait for it at the end."""
    if not learn:
        return [[d] for d in drives]
    cars: dict[str, list[Drive]] = {}
    for d in drives:
        cars.setdefault(d.car, []).append(d)
    return sorted(cars.values(), key=len, reverse=True)


class _Chain:
    """The drives of a car that still have to run, and the learnt state after the last
    drive that ran."""

    def __init__(self, drives: Sequence[Drive], plan: FleetPlan, store: Store):
        self.drives, self.plan, self.store = deque(drives), plan, store
        self.calibrated: dict[Path, Path] = {}  # key: vehicle file; value: calibrated vehicle file
        self.learnt: bytes | None = None
        self.end = 0.0  # [s since 1970] end of the drive after which `learnt` was saved

    def find_next(self, keep: Any) -> Task | None:
        """Return the task of the next log that has to run, or None if no log has to run.

        A log is skipped if Drive.error says why it cannot be estimated, if it has no
        vehicle file, or if its outcome is stored from an earlier call. `keep`: called
        with the outcome (Done) of each log that is skipped."""
        while self.drives:
            drive = self.drives[0]
            if drive.error or drive.vehicle is None:
                self.drives.popleft()
                keep(Done(drive, Outcome(error=drive.error or f"{drive.log}: no vehicle file")))
                continue
            task = self.make_task(drive)
            kept = self.store.load(drive, task)
            if kept is None:
                return task
            self.drives.popleft()
            self._learn(drive, kept.outcome)
            keep(kept)
        return None

    def make_task(self, drive: Drive) -> Task:
        """Return the task of a drive: its files, the options of the fleet, and the learnt
        state after the previous drive of the car."""
        reading, plan = self.plan.reading, self.plan
        vehicle = self.calibrated.get(drive.vehicle, drive.vehicle) if drive.vehicle else None
        # logs on which the car is calibrated together with the log of this drive
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
        """Store the outcome of the first drive of the chain, and remove the drive
        from the chain."""
        drive = self.drives.popleft()
        outcome.error = outcome.error.replace(str(task.log), str(drive.log))
        self._learn(drive, outcome)
        return self.store.save(drive, task, outcome)

    def _learn(self, drive: Drive, outcome: Outcome) -> None:
        """Keep the calibrated vehicle file and the learnt state of a drive, for the later
        drives of the car."""
        if self.plan.learn and outcome.calibrated and drive.vehicle:
            self.calibrated[drive.vehicle] = self.store.calibrated(drive, outcome.calibrated)
        if self.plan.learn and outcome.learnt is not None:
            self.learnt, self.end = outcome.learnt, drive.start + outcome.seconds


def _resolve_path(path: Path | None) -> Any:
    """Return `path` as an absolute path, because workers may run in a different folder.
    Return None if `path` is None."""
    return resolve_path(path) if path is not None else None


def group_by_car(done: Sequence[Done]) -> Iterator[tuple[str, list[Done]]]:
    """Yield the name and the logs of each car."""
    for car in dict.fromkeys(d.drive.car for d in done):
        yield car, [d for d in done if d.drive.car == car]
