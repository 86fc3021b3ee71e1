"""What the studies share: many runs in processes of their own, with progress, that can be stopped."""

import multiprocessing
import sys
from collections.abc import Callable, Sequence
from typing import Any

from tqdm import tqdm


def in_processes(job: Callable[[Any], Any], asked: Sequence[Any], jobs: int, unit: str) -> list[Any] | None:
    """The results in the order of what was asked, or None after Ctrl-C. New processes that import anew: what a run has changed
    (constants, caches) reaches no other tree of processes, and the machine's threads none of them."""
    with multiprocessing.get_context("spawn").Pool(jobs) as pool:
        try:
            return list(tqdm(pool.imap(job, asked, chunksize=1), total=len(asked), unit=unit, file=sys.stderr))
        except KeyboardInterrupt:
            pool.terminate()
            print("stopped; what is done is kept", file=sys.stderr)
            return None
