"""Who simulates: threads of this process, or a Dask cluster (`--scheduler`). The numbers are the same."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import lru_cache
from typing import Any

import numpy as np

from tselab.core import Config
from tselab.errors import UserError
from tselab.gap import constants
from tselab.gap.data import Prepared, in_time, prepare
from tselab.gap.problem import Problem
from tselab.log import Log
from tselab.processes import dask

WORKERS = 3  # s, for the first worker: those that start with the scheduler come a moment later


class Workers:
    """This process."""

    def __init__(self, jobs: int = 1):
        self.jobs = max(1, jobs)

    def prepare(self, logs: Sequence[Log], config: Config) -> list[Prepared]:
        return [in_time(prepare(log, config), config) for log in logs]

    def problem(self, logs: Sequence[Prepared], config: Config) -> Problem:
        return Problem(logs, config, self.jobs)


class Cluster(Workers):
    """A Dask cluster: logs are prepared, and all slopes simulated, there."""

    def __init__(self, client: Any, jobs: int):
        super().__init__(jobs)
        if changed := constants.overridden():  # its processes would not know
            raise UserError(f"option --scheduler: {', '.join(changed)} cannot be another on a cluster")
        self.client = client

    def prepare(self, logs: Sequence[Log], config: Config) -> list[Prepared]:
        return self.client.gather(self.client.map(_prepare, logs, values=config.as_dict(), pure=False))

    def problem(self, logs: Sequence[Prepared], config: Config) -> Problem:
        return ClusterProblem(self.client, logs, config, self.jobs)


class ClusterProblem(Problem):
    """A problem whose simulations are made by a cluster, many at once."""

    is_here = False

    def __init__(self, client: Any, logs: Sequence[Prepared], config: Config, jobs: int):
        super().__init__(logs, config, jobs)
        self._client = client
        data = (tuple(self.logs), tuple(config.as_dict().items()))
        self._data = client.scatter([data], broadcast=True, hash=False)[0]

    def of(self, logs: Sequence[Prepared]) -> Problem:
        return ClusterProblem(self._client, logs, self.config, self.jobs)

    def predict_all(self, asked: Sequence[Mapping[str, float]]) -> list[np.ndarray]:
        """Every one of them somewhere in the cluster, which knows nothing of what is held here."""
        whole = [tuple((self.fixed | dict(a)).items()) for a in asked]
        futures = self._client.map(_predict, whole, data=self._data, pure=False)
        self.simulations += len(asked)
        return self._client.gather(futures)

    def __getstate__(self) -> dict[str, Any]:
        raise TypeError("a problem of a cluster stays here")


def _prepare(log: Log, values: Mapping[str, float]) -> Prepared:
    config = Config(values)
    return in_time(prepare(log, config), config)


def _predict(values: Iterable[tuple[str, float]], data: tuple) -> np.ndarray:
    logs, settings = data
    return _problem(settings, _Held(logs)).predict(dict(values))


class _Held:
    """Logs as an argument of a cache, which their identity stands for."""

    def __init__(self, logs: tuple[Prepared, ...]):
        self.logs = logs

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Held) and self.logs is other.logs

    def __hash__(self) -> int:
        return id(self.logs)


@lru_cache(maxsize=2)
def _problem(settings: tuple, held: _Held) -> Problem:
    """Of a worker: made once, used for all its simulations."""
    return Problem(held.logs, Config(dict(settings)))


@contextmanager
def workers(jobs: int, scheduler: str | None, connect: Callable[[str], Any] | None = None) -> Iterator[Workers]:
    """This process, or the cluster at the address."""
    if scheduler is None:
        yield Workers(jobs)
        return
    with (connect or dask)(scheduler) as client:
        check_workers(client, scheduler)
        yield Cluster(client, jobs)


def check_workers(client: Any, scheduler: str) -> None:
    """There are workers, and they compute what this process would: else the run would wait for ever, or give other numbers."""

    def theirs() -> tuple[
        str, str
    ]:  # within a function, so that it is sent as code: a worker may have no tselab to find it in
        import hashlib
        from pathlib import Path

        try:
            import tselab
        except ImportError:
            return "none", ""
        code = hashlib.sha256()
        for path in sorted((Path(tselab.__file__).parent / "gap").glob("*.py")):
            code.update(path.read_bytes())
        return tselab.__version__, code.hexdigest()

    end = time.monotonic() + WORKERS
    while not (found := client.run(theirs)):
        if time.monotonic() > end:
            raise UserError(f"option --scheduler: the Dask cluster at {scheduler} has no workers")
        time.sleep(0.2)
    mine = theirs()
    for worker, (version, code) in sorted(found.items()):
        if (version, code) != mine:
            what = {"none": "no tselab", mine[0]: f"tselab {version} with other code"}.get(version, f"tselab {version}")
            raise UserError(
                f"option --scheduler: worker {worker} of the Dask cluster at {scheduler} has {what}, this is tselab {mine[0]}"
            )
