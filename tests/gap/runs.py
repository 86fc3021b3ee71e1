"""Helpers of studies and tests: a changed constant of tse, and runs in processes.

with change_constant("identify.fit.MODEL_TIME", 4.0):
    run(...)
"""

import importlib
import multiprocessing
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from tqdm import tqdm


@contextmanager
def change_constant(name: str, value: Any) -> Iterator[None]:
    """Set a constant in its module and all importing modules, here and in later forks."""
    module, _, key = name.rpartition(".")
    before = getattr(importlib.import_module(f"tse.{module}"), key)
    mine = [m for n, m in sys.modules.items() if n.startswith("tse.") and vars(m).get(key) is before]
    for m in mine:
        setattr(m, key, value)
    try:
        yield
    finally:
        for m in mine:
            setattr(m, key, before)


def run_in_processes(
    job: Callable[[Any], Any], asked: Sequence[Any], jobs: int, unit: str
) -> list[Any] | None:
    """Run in new processes; return the results in order, or None after Ctrl-C.

    New processes import anew, so constants and caches that a run changes stay in its
    process. Each has one thread in the BLAS, as tselab: threads of several processes wait
    for each other (a case took four times as long).
    """
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    with multiprocessing.get_context("spawn").Pool(jobs) as pool:
        try:
            return list(
                tqdm(pool.imap(job, asked, chunksize=1), total=len(asked), unit=unit, file=sys.stderr)
            )
        except KeyboardInterrupt:
            pool.terminate()
            print("stopped; what is done is kept", file=sys.stderr)
            return None
