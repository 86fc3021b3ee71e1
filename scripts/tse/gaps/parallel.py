"""Run work in parallel in forked copies of this process. It is meant for work in Python
code, for which threads would mostly wait for Python's global interpreter lock.
"""

from __future__ import annotations

import multiprocessing
import signal
import sys
import warnings
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

# The function that the forked processes run, and the list of its arguments. Both are in a
# global variable, because a forked process has a copy of all global variables. A function
# that is sent to a process would be pickled, and pickle does not accept closures.
_work: tuple[Callable[[Any], Any], Sequence[Any]] | None = None
_copy = False  # True in a forked copy, False in the parent process


def is_copy() -> bool:
    """Return whether this process is a forked copy, which must not fork again."""
    return _copy


def run_in_processes(
    jobs: int, do: Callable[[Any], Any], asked: Sequence[Any], light: Callable[[Any], Any] = lambda x: x
) -> list[Any]:
    """Return the results of `do` for each argument in `asked`, computed in up to `jobs`
    processes.

    Each process is a forked copy of this one. It applies `light` to each result, for
    example to drop large arrays, and sends back what `light` returns.

    Nothing is forked if `jobs` is 1, if there are fewer than two arguments, in a process
    that is itself a copy, or on systems other than Linux, where threads are used. `light`
    is not applied then, so the caller must accept results with and without it. `do` must
    not rely on changes in memory: they are lost in a copy, but kept without copies.
    """
    global _work
    if jobs == 1 or len(asked) < 2 or _copy:
        return [do(a) for a in asked]
    if sys.platform != "linux":  # on other systems some libraries fail after a fork
        with ThreadPoolExecutor(jobs) as pool:
            return list(pool.map(do, asked))
    _work = (lambda a: light(do(a))), asked
    try:
        with warnings.catch_warnings():
            # Python 3.12 warns if a process with threads is forked. Here the threads are
            # idle, and the copies use none of their locks.
            warnings.simplefilter("ignore", DeprecationWarning)
            with multiprocessing.get_context("fork").Pool(min(jobs, len(asked)), _begin_worker) as copies:
                return copies.map(_run_one, range(len(asked)), chunksize=1)
    finally:
        _work = None


def _begin_worker() -> None:
    global _copy
    _copy = True
    # Only the parent process handles Ctrl-C. It ends its copies.
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _run_one(k: int) -> Any:
    assert _work is not None
    do, asked = _work
    return do(asked[k])
