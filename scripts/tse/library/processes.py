"""Run tasks in processes of this machine or of a Dask cluster, with the same results.

    for task, result in run_in_processes(do, tasks, jobs, scheduler):  # as they finish
        result()  # returns the value of do(task), or raises its error

`do` is a function of a module; pickle must be able to send the tasks."""

from __future__ import annotations

import contextlib
import functools
import logging
import multiprocessing
import os
import queue
import signal
import socket
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import connection
from typing import Any, TypeAlias

from tse.library.errors import UserError

CONNECT_TIMEOUT = 10  # s; wait for the answer of a scheduler
WORKERS_TIMEOUT = 3  # s; wait for the first worker: workers start a moment after the scheduler
Work: TypeAlias = Callable[[Any], Any]
Finished: TypeAlias = tuple[Any, Callable[[], Any]]  # a task; a call that returns or raises its result


class Died(RuntimeError):
    """The process of a task has died."""

    def __init__(self, more: str = ""):
        super().__init__("the process that worked on it died, probably for want of memory" + more)


class Workers:
    """Accepts tasks (submit) and returns finished ones (next).

    On an error, leaving the `with` block does not wait for running tasks."""

    submit: Callable[[Any], None]
    next: Callable[[], Finished]

    def __enter__(self) -> Workers:
        return self

    def __exit__(self, kind: Any, *error: object) -> None:
        """End nothing; subclasses end their processes."""


def run_in_processes(
    do: Work, tasks: Sequence[Any], jobs: int = 1, scheduler: str | None = None
) -> Iterator[Finished]:
    """Yield each task when it has finished.

    Parameters
    ----------
    do : callable
        The work: a function of a module with one argument.
    tasks : sequence
        Its arguments.
    jobs : int
        Number of processes; 1: this process, in the order of the tasks.
    scheduler : str, optional
        Address of a Dask scheduler, whose workers replace the processes.

    Yields
    ------
    task
        One of the tasks.
    result : callable
        Returns the result of the task, or raises its error.
    """
    if tasks:
        few = InProcess(do) if jobs == 1 else LocalPool(do, min(jobs, len(tasks)))
        with few if scheduler is None else DaskCluster(do, scheduler) as workers:
            for task in tasks:
                workers.submit(task)
            for _ in tasks:
                yield workers.next()


class InProcess(Workers):
    """This process: each task runs when its result is called."""

    def __init__(self, do: Work):
        self._do = do
        self._tasks: deque[Any] = deque()

    def submit(self, task: Any) -> None:
        self._tasks.append(task)

    def next(self) -> Finished:
        task = self._tasks.popleft()
        return task, functools.partial(self._do, task)


class LocalPool(Workers):
    """Processes of this machine."""

    def __init__(self, do: Work, jobs: int):
        self._do, self._jobs = do, jobs
        self._running: dict[Future[Any], Any] = {}
        self._done: queue.SimpleQueue[Future[Any]] = queue.SimpleQueue()
        # tasks that ran when a process died; each runs again in a process of its own
        self._suspects: deque[Any] = deque()
        self._pool = self._start(jobs)

    @staticmethod
    def _start(jobs: int) -> ProcessPoolExecutor:
        context = multiprocessing.get_context("spawn")
        return ProcessPoolExecutor(jobs, mp_context=context, initializer=_end_with_parent)

    def submit(self, task: Any) -> None:
        with ignore_interrupts():  # submit() may start a process
            try:
                future = self._pool.submit(self._do, task)
            except BrokenProcessPool:
                self._suspects.append(task)
                return
            self._running[future] = task
            future.add_done_callback(self._done.put)

    def next(self) -> Finished:
        while not self._suspects:
            # get(), because Ctrl-C within wait() locks futures, and the pool never ends
            future = self._done.get()
            task = self._running.pop(future)
            if not isinstance(future.exception(), BrokenProcessPool):
                return task, future.result
            self._suspects += [task, *self._running.values()]
            self._running.clear()
            self._pool.shutdown(wait=True, cancel_futures=True)
            self._done = queue.SimpleQueue()
            self._pool = self._start(self._jobs)
        task = self._suspects.popleft()
        with self._start(1) as alone:
            with ignore_interrupts():
                future = alone.submit(self._do, task)
            return task, _raise_died if isinstance(future.exception(), BrokenProcessPool) else future.result

    def __exit__(self, kind: Any, *error: object) -> None:
        if kind is not None:
            for process in multiprocessing.active_children():
                process.terminate()
        self._pool.shutdown(wait=True, cancel_futures=True)


def _raise_died(more: str = "") -> Any:
    """Raise Died. Called in the place of the result of a task whose process has died."""
    raise Died(more)


def _end_with_parent() -> None:
    """End this worker when its parent ends; otherwise it would wait for work forever."""
    parent = multiprocessing.parent_process()

    def end_after_parent() -> None:
        if parent is not None:
            connection.wait([parent.sentinel])
            os._exit(1)

    threading.Thread(target=end_after_parent, daemon=True).start()


class DaskCluster(Workers):
    """A Dask cluster, whose workers reach files under the same paths as this process.

    The scheduler repeats the task of a dead worker on another one. `check` is called with
    client and address before the first task."""

    def __init__(
        self, do: Work, scheduler: str, check: Callable[[Any, str], None] = lambda client, scheduler: None
    ):
        self._do, self._client = do, connect_to_dask(scheduler)
        check(self._client, scheduler)
        import distributed

        logging.getLogger("distributed").setLevel(logging.CRITICAL)  # a dead worker is expected
        self._finished: Any = distributed.as_completed([], loop=self._client.loop)
        self._tasks: dict[str, Any] = {}
        self._futures: dict[str, Any] = {}

    def submit(self, task: Any) -> None:
        future = self._client.submit(self._do, task, pure=False)
        self._tasks[future.key], self._futures[future.key] = task, future
        self._finished.add(future)

    def next(self) -> Finished:
        import dask
        import distributed

        future = next(self._finished)
        task, _ = self._tasks.pop(future.key), self._futures.pop(future.key)
        if isinstance(future.exception(), distributed.KilledWorker):
            deaths = int(dask.config.get("distributed.scheduler.allowed-failures")) + 1
            return task, functools.partial(_raise_died, f" (it has ended {deaths} workers of the cluster)")
        return task, future.result

    def __exit__(self, kind: Any, *error: object) -> None:
        with contextlib.suppress(Exception):  # the cluster may have ended
            self._client.cancel(list(self._futures.values()))
        self._client.close()


def connect_to_dask(scheduler: str) -> Any:
    """Return a client of the Dask cluster at this address."""
    try:
        import distributed
    except ImportError:
        raise UserError("option --scheduler needs Dask: pip install 'tse[cluster]'") from None
    try:
        if not scheduler.startswith("inproc://"):  # a client without a scheduler logs many lines
            socket.create_connection(
                distributed.comm.get_address_host_port(scheduler), CONNECT_TIMEOUT
            ).close()
        return distributed.Client(scheduler, timeout=CONNECT_TIMEOUT, set_as_default=False)
    except (OSError, ValueError) as error:
        raise UserError(f"option --scheduler: no Dask scheduler answers at {scheduler}: {error}") from None


def check_workers(client: Any, scheduler: str) -> None:
    """Refuse a cluster without workers, or with other code than this process.

    Without workers the run would wait forever; other code gives other results."""

    # an inner function is sent as code: a worker may have no tselab to import it from
    def read_version() -> tuple[str, str]:
        import hashlib
        from pathlib import Path

        try:
            from tse import library
        except ImportError:
            return "none", ""
        code = hashlib.sha256()
        for path in sorted(Path(str(library.__file__)).parents[1].rglob("*.py")):
            code.update(path.read_bytes())
        return library.__version__, code.hexdigest()

    end = time.monotonic() + WORKERS_TIMEOUT
    while not (found := client.run(read_version)):
        if time.monotonic() > end:
            raise UserError(f"option --scheduler: the Dask cluster at {scheduler} has no workers")
        time.sleep(0.2)
    mine = read_version()
    for worker, (version, code) in sorted(found.items()):
        if (version, code) != mine:
            other = {"none": "no tselab", mine[0]: f"tselab {version} with other code"}
            raise UserError(
                f"option --scheduler: worker {worker} of the Dask cluster at {scheduler} has "
                f"{other.get(version, f'tselab {version}')}, this is tselab {mine[0]}"
            )


@contextlib.contextmanager
def treat_kill_as_interrupt() -> Iterator[None]:
    """Let a plain kill (SIGTERM) end the block as Ctrl-C does, workers included."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def stop(*_: object) -> None:
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGTERM, stop)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


@contextlib.contextmanager
def ignore_interrupts() -> Iterator[None]:
    """Let processes that are started in the block ignore Ctrl-C.

    A terminal sends Ctrl-C to all its processes; only the first one reacts."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
