"""What logs can show at all: the smallest size at which an effect would be named, before
any effect is looked for.

Around a fitted model an effect of size s moves the whitened residuals by s times its
slopes, less what stiffness (and the effects already named) can take up. It is named when
that is worth compute_threshold() nats against residuals as they are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tse.gaps.catalogue import CatalogueParameter, Effect
from tse.gaps.fit import Fit
from tse.gaps.infer.hypotheses import compute_threshold
from tse.gaps.infer.search import compute_variance
from tse.gaps.infer.space import REACH
from tse.gaps.problem import Problem
from tse.identify.knots import KNOT_DISTANCE, PROFILES

WAVE = 400.0  # m: of a road that goes up and down, which stands for any: would it show?


@dataclass(frozen=True)
class Detectable:
    """Smallest size of one effect that logs show, and the share that stiffness hides."""

    id: str
    parameter: str
    unit: str
    smallest: float  # inf: at no size that the model takes
    typical: float
    absorbed: float  # share of what it does that stiffness and named effects take up

    @property
    def visible(self) -> bool:
        """At its typical size."""
        return self.smallest <= self.typical


def compute_detectable(problem: Problem, current: Fit, effects: Sequence[Effect]) -> list[Detectable]:
    """Return every effect with its smallest detectable size, by its most visible
    strength.
    """
    need = compute_threshold(len(effects))
    parameters = [p for e in effects for p in problem.strengths(e)]
    slopes = problem.jacobian(current.values, current.residuals, parameters, REACH)
    q, _ = np.linalg.qr(current.jacobian)
    weight = np.zeros(len(current.residuals))
    for _, rows in problem.used():
        weight[rows] = 1.0 / compute_variance(float(np.mean(current.residuals[rows] ** 2)))
    found, k = [], 0
    for e in effects:
        mine = problem.strengths(e)
        a = slopes[:, k : k + len(mine)]
        k += len(mine)
        if e.id in PROFILES:
            a, mine = _make_wave(a, mine), mine[:1]
        own = a - q @ (q.T @ a)
        best: tuple[float, CatalogueParameter, float] | None = None
        for p, full, rest in zip(mine, a.T, own.T, strict=True):
            power, total = float(rest @ (weight * rest)), float(full @ (weight * full))
            smallest = (
                float(np.sqrt(2.0 * need / power))
                if power > 1e-12 * max(total, 1e-300) and power > 0
                else float("inf")
            )
            if smallest > max(p.high - p.default, p.default - p.low):
                smallest = float("inf")
            absorbed = 1.0 - power / total if total > 0 else 1.0
            if best is None or smallest / p.scale < best[0] / best[1].scale:
                best = (smallest, p, absorbed)
        if best is None:
            continue
        smallest, p, absorbed = best
        found.append(
            Detectable(
                e.id, e.strengths[0].name if e.id in PROFILES else p.name, p.unit, smallest, p.scale, absorbed
            )
        )
    return found


def _make_wave(slopes: np.ndarray, parameters: Sequence[CatalogueParameter]) -> np.ndarray:
    """Return a profile of rms one that goes up and down every WAVE metres."""
    place = np.array([float(p.name.knot) for p in parameters])
    return (slopes @ (np.sqrt(2.0) * np.sin(2 * np.pi * place * KNOT_DISTANCE / WAVE)))[:, None]
