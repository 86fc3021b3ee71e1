"""A Dask cluster of local processes, and a task that kills its process: for tests.

It is a module of its own because the process imports the module of a function that it is
given. It could not import a test module, which needs the conftest of this folder: the
conftest of another folder may be found first.
"""

import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from tse.runs.work import Outcome, Task

Start = Callable[..., subprocess.Popen]


@contextmanager
def start_programs() -> Iterator[Start]:
    """Start `dask ARGS`; end all programs afterwards, whatever happens."""
    processes: list[subprocess.Popen] = []

    def one(*args: object, path: Path | None = None) -> subprocess.Popen:
        env = os.environ | {"OMP_NUM_THREADS": "1"} | ({"PYTHONPATH": str(path)} if path else {})
        command = [sys.executable, "-m", "dask", *map(str, args)]
        processes.append(
            subprocess.Popen(command, env=env, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        )
        return processes[-1]

    try:
        yield one
    finally:
        for process in processes:  # without a word: nobody waits for what they would still do
            process.kill()
        for process in processes:
            process.wait()


def start_scheduler(start: Start) -> str:
    """Start one; its address."""
    port = free_port()
    start("scheduler", "--host", "127.0.0.1", "--port", port, "--no-dashboard")
    wait_until(lambda: is_listening(port))
    return f"tcp://127.0.0.1:{port}"


def make_worker_command(address: str, folder: Path) -> tuple[object, ...]:
    """Return the arguments that start a worker."""
    return ("worker", address, "--no-nanny", "--nthreads", 1, "--no-dashboard", "--local-directory", folder)


def free_port() -> int:
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        return s.getsockname()[1]


def wait_until(what: Callable[[], object], seconds: float = 120.0) -> None:
    end = time.monotonic() + seconds
    while not what():
        assert time.monotonic() < end, "the cluster does not start"
        time.sleep(0.1)


def is_listening(port: int) -> bool:
    with socket.socket() as s:
        s.settimeout(1.0)
        return s.connect_ex(("127.0.0.1", port)) == 0


def kill_this_process(task: Task) -> Outcome:
    """Kill the process on a log called deadly, as a log too long for the memory does."""
    if "deadly" in task.log.name:
        os.kill(os.getpid(), signal.SIGKILL)
    return Outcome(seconds=1.0)
