"""Before and after, on manoeuvres that the fit has not seen: rms over noise with paired block-bootstrap intervals."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from tse.impl.gap import catalogue
from tse.impl.gap.fit import fit
from tse.impl.gap.problem import Problem

BLOCK = 2.0  # s: of residuals that are resampled together
DRAWS = 1000  # of the bootstrap
SEED = 1  # of the bootstrap


@dataclass(frozen=True)
class Change:
    """One channel before and after."""

    before: float  # rms over noise
    after: float
    change: float  # relative, of the rms
    ci95: tuple[float, float]

    @property
    def better(self) -> bool:
        return self.ci95[1] < 0.0


def compare(problem: Problem, before: np.ndarray, after: np.ndarray) -> dict[str, Change]:
    """Per channel, from whitened residuals of the same logs under both models. Seeded."""
    rng = np.random.default_rng(SEED)
    found = {}
    for c, mine in problem.used():
        key = problem.rows.log[mine] * 10_000_000 + (problem.rows.time[mine] // BLOCK).astype(np.int64)
        _, index = np.unique(key, return_inverse=True)
        count = np.bincount(index).astype(float)
        e0, e1 = np.bincount(index, before[mine] ** 2), np.bincount(index, after[mine] ** 2)
        draws = rng.integers(0, len(count), (DRAWS, len(count)))
        n0, n1 = e0[draws].sum(axis=1), e1[draws].sum(axis=1)
        ratio = np.sqrt(n1 / np.maximum(n0, 1e-300)) - 1.0
        found[c] = Change(
            float(np.sqrt(e0.sum() / count.sum())),
            float(np.sqrt(e1.sum() / count.sum())),
            float(np.sqrt(e1.sum() / max(e0.sum(), 1e-300)) - 1.0),
            (float(np.quantile(ratio, 0.025)), float(np.quantile(ratio, 0.975))),
        )
    return found


def of_the_car(problem: Problem, after: Mapping[str, float]) -> dict[str, float]:
    """What was fitted elsewhere, for other logs: what is own to a log is left out, and profiles of a road that was named are found
    anew, because it is another road."""
    car = catalogue.of_the_car(after)
    road = [e for e in catalogue.catalogue().values() if catalogue.profiles(after, e.id)]
    if not road:
        return car
    return car | fit(problem.holding(car), [p for e in road for p in problem.strengths(e)], {}).values
