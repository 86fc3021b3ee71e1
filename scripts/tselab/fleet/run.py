"""All logs of a fleet: several cars at once, the drives of one car one after the other, for each starts from what the one before
taught. In processes of this machine or on a Dask cluster; the numbers are the same."""

from __future__ import annotations

import contextlib
import logging
import multiprocessing
import os
import sys
import threading
from collections import deque
from collections.abc import Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, field
from multiprocessing import connection
from pathlib import Path
from typing import Any, Protocol

from tqdm import tqdm

from tselab.files import real
from tselab.fleet.find import Drive
from tselab.fleet.keep import Done, Store
from tselab.fleet.work import Outcome, Task, code_of, work
from tselab.log import Reading
from tselab.processes import dask, killed_as_interrupted, without_interrupts

DIED = "the process that worked on it died, probably for want of memory: cut the log, or run it where there is more"


TOGETHER = 4  # logs of a car on which it is calibrated, at most


class Interrupted(Exception):
    """Ctrl-C; the text says how to go on."""


@dataclass(frozen=True)
class Plan:
    """What is the same for all logs."""

    reading: Reading
    config: Path | None = None
    average: float | None = None
    form: str = "default"
    settings: dict[str, float] = field(default_factory=dict)
    learn: bool = True  # each drive starts from what the one of the same car before it taught
    reports: bool = True
    estimates: bool = False
    calibrate: bool = True  # a car that nobody has calibrated, on its first logs


def run(
    drives: Sequence[Drive],
    plan: Plan,
    store: Store,
    jobs: int = 1,
    scheduler: str | None = None,
    progress: bool = False,
) -> list[Done]:
    """Run what is not done yet; all logs, in the order of `drives`."""
    done: dict[Drive, Done] = {}
    chains = [_Chain(c, plan, store) for c in _chains(drives, plan.learn)]
    with tqdm(total=len(drives), unit="log", disable=not progress, file=sys.stderr, leave=False, desc="fleet") as bar:

        def keep(one: Done) -> None:
            done[one.drive] = one
            bar.update()
            bar.set_postfix_str(one.drive.log.name[-40:])

        try:
            with killed_as_interrupted(), contextlib.ExitStack() as stack:
                workers: Workers | None = None
                waiting = deque(chains)
                running: dict[Task, _Chain] = {}
                while waiting or running:
                    while waiting:
                        chain = waiting.popleft()
                        task = chain.next(keep)
                        if task is None:
                            continue
                        if workers is None:  # nobody is started where all is done
                            made = Cluster(scheduler) if scheduler is not None else Local(min(jobs, len(chains)))
                            workers = stack.enter_context(made)
                        running[_id(task)] = chain
                        workers.submit(task)
                    if running and workers is not None:
                        task, outcome = workers.next()
                        chain = running.pop(_id(task))
                        keep(chain.take(task, outcome))
                        waiting.append(chain)
        except KeyboardInterrupt:
            kept = f"{store.out} keeps the {len(done)} of {len(drives)} logs that are done"
            raise Interrupted(f"stopped; {kept}, the same command goes on from there") from None
    return [done[d] for d in drives]


def _id(task: Task) -> Any:
    return task.log


def _chains(drives: Sequence[Drive], learn: bool) -> list[list[Drive]]:
    """What must be done in order: the drives of a car."""
    if not learn:
        return [[d] for d in drives]
    cars: dict[str, list[Drive]] = {}
    for d in drives:
        cars.setdefault(d.car, []).append(d)
    return sorted(cars.values(), key=len, reverse=True)  # the longest first, or it is waited for at the end


class _Chain:
    """The drives of a car, and what the last of them taught."""

    def __init__(self, drives: Sequence[Drive], plan: Plan, store: Store):
        self.drives, self.plan, self.store = deque(drives), plan, store
        self.calibrated: dict[Path, Path] = {}  # vehicle file: the one that was made of it
        self.learnt: bytes | None = None
        self.end = 0.0  # of the drive that taught it, s since 1970

    def next(self, keep: Any) -> Task | None:
        """The next log that has to be run; what is done already is kept on the way. None: that was the last."""
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
        mine = [d for d in self.drives if d.vehicle == drive.vehicle and not d.error][1:TOGETHER] if plan.learn else []
        return Task(
            log=_whole(drive.log), vehicle=_whole(vehicle), signals=_whole(drive.signals or reading.signals),
            rate=reading.rate, strict=reading.strict, databases=tuple(_whole(p) for p in reading.databases),
            config=_whole(plan.config), average=plan.average, form=plan.form, settings=plan.settings, learnt=self.learnt,
            age=max(0.0, drive.start - self.end) if self.learnt is not None else 0.0, report=plan.reports,
            estimates=self.store.estimates(drive) if plan.estimates else None, code=code_of(),
            calibrate=plan.calibrate and vehicle == drive.vehicle,
            others=tuple((_whole(d.log), _whole(d.signals or reading.signals)) for d in mine) if vehicle == drive.vehicle else (),
        )  # fmt: skip

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


def _whole(path: Path | None) -> Any:
    """Whoever works on it may stand elsewhere."""
    return real(path) if path is not None else None


# ---- who works


class Workers(Protocol):
    """Takes tasks, and gives their outcomes as they come. Left with an error, it waits for nothing."""

    def __enter__(self) -> Workers: ...

    def __exit__(self, kind: Any, *error: object) -> None: ...

    def submit(self, task: Task) -> None: ...

    def next(self) -> tuple[Task, Outcome]: ...


class Local:
    """Processes of this machine."""

    def __init__(self, jobs: int):
        self._jobs = jobs
        self._running: dict[Future[Outcome], Task] = {}
        self._suspects: deque[Task] = deque()  # were worked on when a process died: each alone, to see which it was
        self._pool = self._start(jobs)

    @staticmethod
    def _start(jobs: int) -> ProcessPoolExecutor:
        context = multiprocessing.get_context("spawn")
        return ProcessPoolExecutor(jobs, mp_context=context, initializer=_end_with_parent)

    def submit(self, task: Task) -> None:
        with without_interrupts():  # it may start a process
            try:
                self._running[self._pool.submit(work, task)] = task
            except BrokenProcessPool:
                self._suspects.append(task)

    def next(self) -> tuple[Task, Outcome]:
        while not self._suspects:
            finished, _ = wait(self._running, return_when=FIRST_COMPLETED)
            future = finished.pop()
            task = self._running.pop(future)
            try:
                return task, future.result()
            except BrokenProcessPool:
                self._suspects += [task, *self._running.values()]
                self._running.clear()
                self._pool.shutdown(wait=True, cancel_futures=True)
                self._pool = self._start(self._jobs)
        task = self._suspects.popleft()
        with self._start(1) as alone:
            with without_interrupts():
                future = alone.submit(work, task)
            try:
                return task, future.result()
            except BrokenProcessPool:
                return task, Outcome(error=f"{task.log}: {DIED}")

    def __enter__(self) -> Local:
        return self

    def __exit__(self, kind: Any, *error: object) -> None:
        if kind is not None:
            for process in multiprocessing.active_children():
                process.terminate()
        self._pool.shutdown(wait=True, cancel_futures=True)


def _end_with_parent() -> None:
    """A worker whose parent is killed would wait for work for ever."""
    parent = multiprocessing.parent_process()

    def watch() -> None:
        if parent is not None:
            connection.wait([parent.sentinel])
            os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


class Cluster:
    """A Dask cluster, whose workers see the logs under the same paths. A worker that dies costs its log once more, elsewhere."""

    def __init__(self, scheduler: str):
        from tselab.gap.workers import check_workers

        self._client = dask(scheduler)
        check_workers(self._client, scheduler)
        import distributed

        logging.getLogger("distributed").setLevel(logging.CRITICAL)  # of a worker that died, which is borne
        self._finished: Any = distributed.as_completed([], loop=self._client.loop)
        self._tasks: dict[str, Task] = {}
        self._futures: dict[str, Any] = {}

    def submit(self, task: Task) -> None:
        future = self._client.submit(work, task, pure=False)
        self._tasks[future.key], self._futures[future.key] = task, future
        self._finished.add(future)

    def next(self) -> tuple[Task, Outcome]:
        import distributed

        future = next(self._finished)
        task, _ = self._tasks.pop(future.key), self._futures.pop(future.key)
        try:
            outcome = future.result()
        except distributed.KilledWorker:
            outcome = Outcome(error=f"{task.log}: {DIED} (it has ended {_deaths()} workers of the cluster)")
        future.release()
        return task, outcome

    def __enter__(self) -> Cluster:
        return self

    def __exit__(self, kind: Any, *error: object) -> None:
        with contextlib.suppress(Exception):  # a cluster that is gone has nothing to cancel
            self._client.cancel(list(self._futures.values()))
        self._client.close()


def _deaths() -> int:
    import dask

    return int(dask.config.get("distributed.scheduler.allowed-failures")) + 1


def each(done: Sequence[Done]) -> Iterator[tuple[str, list[Done]]]:
    """Car by car, in order of time."""
    for car in dict.fromkeys(d.drive.car for d in done):
        yield car, [d for d in done if d.drive.car == car]
