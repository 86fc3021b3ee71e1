"""Measure time and memory of a command. long_logs.py and tests/gap/scale.py use it."""

import os
import subprocess
import sys
import time
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[2]
TSELAB = [sys.executable, "-m", "tselab"]
PATHS = os.pathsep.join([str(ROOT / "scripts"), os.environ.get("PYTHONPATH", "")])
ENV = os.environ | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "PYTHONPATH": PATHS}
# Program that runs a command and prints its exit status, processor time and maximum
# memory (ru_maxrss). On Linux, ru_maxrss of a new process starts at the memory of its
# parent. The parent is therefore this small program. If the script that measures were the
# parent, its own memory (pandas, numpy) could be reported as that of the command.
LAUNCH = """
import os, sys
quiet = [(os.POSIX_SPAWN_OPEN, 1, os.devnull, os.O_WRONLY, 0)]
_, status, usage = os.wait4(os.posix_spawn(sys.argv[1], sys.argv[1:], os.environ, file_actions=quiet), 0)
print(status, usage.ru_utime + usage.ru_stime, usage.ru_maxrss)
"""


class Taken(NamedTuple):
    """Time and memory of a process and its children."""

    code: int  # exit code
    clock: float  # [s] elapsed time
    busy: float  # [s] processor time of all processes
    memory: float  # [bytes] maximum memory of a single process


def measure_command(*command: object, codes: Collection[int] = (0, 3), env: Mapping[str, str] = ENV) -> Taken:
    """Run a command. Return its time and memory.

    Parameters
    ----------
    *command
        Program and arguments.
    codes : collection of int
        Exit codes that do not raise an error.
    env : mapping
        Environment of the process.

    Raises
    ------
    RuntimeError
        A signal stopped the command, or its exit code is not one of `codes`.
    """
    start = time.perf_counter()
    done = subprocess.run(
        [sys.executable, "-c", LAUNCH, *map(str, command)],
        cwd=ROOT,
        env=env,
        stdout=subprocess.PIPE,
        text=True,
        check=True,
    )
    clock = time.perf_counter() - start
    status, busy, memory = done.stdout.split()
    code = os.waitstatus_to_exitcode(int(status))
    if code not in codes:
        raise RuntimeError(f"{' '.join(map(str, command))}: exit code {code}")
    return Taken(code, clock, float(busy), float(memory) * (1 if sys.platform == "darwin" else 1024))
