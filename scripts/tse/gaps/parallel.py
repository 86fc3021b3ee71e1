"""Much work at once: in copies of this process, where threads would wait for Python's
lock most of the time.
"""

from __future__ import annotations

import multiprocessing
import signal
import sys
import warnings
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

_work: tuple[Callable[[Any], Any], Sequence[Any]] | None = (
    None  # what copies inherit: a closure cannot be sent
)
_copy = False


def is_copy() -> bool:
    """Return whether this process is a copy: a copy makes no copies."""
    return _copy


def run_in_processes(
    jobs: int, do: Callable[[Any], Any], asked: Sequence[Any], light: Callable[[Any], Any] = lambda x: x
) -> list[Any]:
    """Run `do` for each of `asked`, in this order, in as many processes as jobs.

    Each process is a copy of this one. It sends back `light` of the result, and its other
    changes are lost. On systems other than Linux threads run, which keep their changes:
    nothing may depend on either.
    """
    global _work
    if jobs == 1 or len(asked) < 2 or _copy:
        return [do(a) for a in asked]
    if sys.platform != "linux":  # elsewhere libraries do not survive being copied
        with ThreadPoolExecutor(jobs) as pool:
            return list(pool.map(do, asked))
    _work = (lambda a: light(do(a))), asked
    try:
        with warnings.catch_warnings():
            # Python 3.12 warns of threads in what is copied: they sleep, and copies use
            # none of their locks
            warnings.simplefilter("ignore", DeprecationWarning)
            with multiprocessing.get_context("fork").Pool(min(jobs, len(asked)), _begin_worker) as copies:
                return copies.map(_run_one, range(len(asked)), chunksize=1)
    finally:
        _work = None


def _begin_worker() -> None:
    global _copy
    _copy = True
    # it is this process's, which ends its copies
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _run_one(k: int) -> Any:
    assert _work is not None
    do, asked = _work
    return do(asked[k])
