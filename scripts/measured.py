"""What a command takes: scripts/long_logs.py, tests/gap/scale.py."""

import os
import subprocess
import sys
import time
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[1]
TSELAB = [sys.executable, "-m", "tselab"]
PATHS = os.pathsep.join([str(ROOT / "scripts"), os.environ.get("PYTHONPATH", "")])
ENV = os.environ | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "PYTHONPATH": PATHS}


class Taken(NamedTuple):
    """Of a process with its children."""

    code: int
    clock: float  # s
    busy: float  # s of processors
    memory: float  # bytes, the most of one process


def measured(*command: object, codes: Collection[int] = (0, 3), env: Mapping[str, str] = ENV) -> Taken:
    """Run a command. RuntimeError: it was stopped, or its exit code is none of `codes`."""
    start = time.perf_counter()
    process = subprocess.Popen([str(c) for c in command], cwd=ROOT, env=env, stdout=subprocess.DEVNULL)
    _, status, usage = os.wait4(process.pid, 0)  # of this one alone: getrusage() has the largest of all that ever ended
    clock = time.perf_counter() - start
    process.returncode = code = os.waitstatus_to_exitcode(status)
    if code not in codes:
        raise RuntimeError(f"{' '.join(map(str, command))}: exit code {code}")
    return Taken(code, clock, usage.ru_utime + usage.ru_stime, usage.ru_maxrss * (1 if sys.platform == "darwin" else 1024))
