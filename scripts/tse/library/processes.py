"""Run tasks in processes of this machine or of a Dask cluster; both give equal results.

    for task, result in run_in_processes(do, tasks, jobs, scheduler):  # as tasks finish
        result()  # returns the value of do(task), or raises its error

`do` is a function at the top level of a module. pickle must be able to send the tasks."""

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

CONNECT_TIMEOUT = 10  # [s] maximum wait for the answer of a scheduler
WORKERS_TIMEOUT = 3  # [s] maximum wait until a newly started cluster has a worker
Work: TypeAlias = Callable[[Any], Any]
# a task, and a function that returns the result of the task or raises its error
Finished: TypeAlias = tuple[Any, Callable[[], Any]]


class Died(RuntimeError):
    """The process that ran a task has died."""

    def __init__(self, more: str = ""):
        super().__init__("the process that ran this task died, probably out of memory" + more)


class Workers:
    """Interface of classes that run tasks.

    Use: `with LocalPool(do, jobs) as workers`. submit() accepts a task. next() waits
    until any task is finished, and returns the task and a function that returns the
    result of the task. If the `with` block ends with an error, running tasks are
    stopped."""

    submit: Callable[[Any], None]
    next: Callable[[], Finished]

    def __enter__(self) -> Workers:
        return self

    def __exit__(self, kind: Any, *error: object) -> None:
        """Do nothing. Subclasses end their processes here."""


def run_in_processes(
    do: Work, tasks: Sequence[Any], jobs: int = 1, scheduler: str | None = None
) -> Iterator[Finished]:
    """Yield each task, with its result, as soon as the task is finished.

    Parameters
    ----------
    do : callable
        Function of one argument, at the top level of a module.
    tasks : sequence
        The arguments; `do` is called once for each.
    jobs : int
        Number of processes. With 1, the tasks run in this process, in their order.
    scheduler : str, optional
        Address of a Dask scheduler. If given, its workers run the tasks, and `jobs` has
        no effect.

    Yields
    ------
    task
        A finished task.
    result : callable
        Function that returns do(task), or raises the error that do(task) raised.
    """
    if tasks:
        few = InProcess(do) if jobs == 1 else LocalPool(do, min(jobs, len(tasks)))
        with few if scheduler is None else DaskCluster(do, scheduler) as workers:
            for task in tasks:
                workers.submit(task)
            for _ in tasks:
                yield workers.next()


class InProcess(Workers):
    """Run the tasks in this process.

    next() returns a task and a function. The task runs when this function is called."""

    def __init__(self, do: Work):
        self._do = do
        self._tasks: deque[Any] = deque()

    def submit(self, task: Any) -> None:
        self._tasks.append(task)

    def next(self) -> Finished:
        task = self._tasks.popleft()
        return task, functools.partial(self._do, task)


class LocalPool(Workers):
    """Run the tasks in several processes of this machine."""

    def __init__(self, do: Work, jobs: int):
        self._do, self._jobs = do, jobs
        self._running: dict[Future[Any], Any] = {}
        self._done: queue.SimpleQueue[Future[Any]] = queue.SimpleQueue()
        # tasks that were unfinished when a process died: any of them may be the cause.
        # Each of them runs again, alone in a new process. If the new process dies, too,
        # the task raises Died
        self._suspects: deque[Any] = deque()
        self._pool = self._start(jobs)

    @staticmethod
    def _start(jobs: int) -> ProcessPoolExecutor:
        context = multiprocessing.get_context("spawn")
        return ProcessPoolExecutor(jobs, mp_context=context, initializer=_end_with_parent)

    def submit(self, task: Any) -> None:
        with ignore_interrupts():  # submit() may start a process, which must ignore Ctrl-C
            try:
                future = self._pool.submit(self._do, task)
            except BrokenProcessPool:
                self._suspects.append(task)
                return
            self._running[future] = task
            future.add_done_callback(self._done.put)

    def next(self) -> Finished:
        while not self._suspects:
            # not futures.wait(): after a Ctrl-C in wait(), shutdown() would wait forever
            # for locks that wait() still holds
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
    """Raise Died; `more` is appended to the message.

    next() returns this function for a task whose process has died."""
    raise Died(more)


def _end_with_parent() -> None:
    """Start a thread that ends this worker process when its parent process ends.

    Without this thread, a worker whose parent was killed would wait for tasks forever."""
    parent = multiprocessing.parent_process()

    def end_after_parent() -> None:
        if parent is not None:
            connection.wait([parent.sentinel])
            os._exit(1)

    threading.Thread(target=end_after_parent, daemon=True).start()


class DaskCluster(Workers):
    """Run the tasks on the workers of a Dask cluster.

    All paths must lead to the same files on the workers as in this process. If a worker
    dies, the scheduler repeats its task on a different worker. If check_workers() finds
    that the cluster cannot be used, UserError is raised before the first task."""

    def __init__(self, do: Work, scheduler: str):
        self._do, self._client = do, connect_to_dask(scheduler)
        check_workers(self._client, scheduler)
        import distributed

        # do not show Dask's warnings about workers that have died: next() reports them
        logging.getLogger("distributed").setLevel(logging.CRITICAL)
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
        with contextlib.suppress(Exception):  # cancel() fails if the cluster has ended
            self._client.cancel(list(self._futures.values()))
        self._client.close()


def connect_to_dask(scheduler: str) -> Any:
    """Return a client that is connected to the Dask scheduler at this address.

    Raise UserError if Dask is not installed or no scheduler answers."""
    try:
        import distributed
    except ImportError:
        raise UserError("option --scheduler needs Dask: pip install 'tse[cluster]'") from None
    try:
        # test the connection first: if no scheduler answers, Client() logs many lines
        if not scheduler.startswith("inproc://"):
            socket.create_connection(
                distributed.comm.get_address_host_port(scheduler), CONNECT_TIMEOUT
            ).close()
        return distributed.Client(scheduler, timeout=CONNECT_TIMEOUT, set_as_default=False)
    except (OSError, ValueError) as error:
        raise UserError(f"option --scheduler: no Dask scheduler answers at {scheduler}: {error}") from None


def check_workers(client: Any, scheduler: str) -> None:
    """Raise UserError if a cluster has no workers, or if the code of tselab on a worker
    is missing or differs from that of this process.

    Without workers, the run would wait forever. A worker with different code could give
    different results."""

    # This is an inner function, because Dask sends the code of an inner function. Of a
    # function of a module it sends only the name, which a worker without tselab could not
    # import.
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
            raise UserError(
                f"option --scheduler: the Dask cluster at {scheduler} has no workers; start at least one"
            )
        time.sleep(0.2)
    mine = read_version()
    for worker, (version, code) in sorted(found.items()):
        if (version, code) != mine:
            other = {"none": "no tselab", mine[0]: f"tselab {version} with other code"}
            raise UserError(
                f"option --scheduler: worker {worker} of the Dask cluster at {scheduler} has "
                f"{other.get(version, f'tselab {version}')}, but this process has tselab {mine[0]}; "
                "install the same code on the worker"
            )


@contextlib.contextmanager
def treat_kill_as_interrupt() -> Iterator[None]:
    """Let SIGTERM, which the command kill sends, act as Ctrl-C: raise KeyboardInterrupt.

    Without this, SIGTERM would end the process at once. The exception lets the code in
    the `with` block end the worker processes that it has started."""
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

    A terminal sends Ctrl-C to all processes of a command. Only the first process must
    react; it ends the workers."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
