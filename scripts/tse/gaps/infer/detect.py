"""Compute the smallest size at which each effect would be visible in the logs, without
fitting the effect.

Near a fitted model, an effect of size s changes the whitened residuals by s times their
partial derivatives. Stiffness and the effects in the fit can compensate a part of this
change. The effect is visible if the rest gives a log likelihood ratio of at least
compute_threshold(), with the variance of the present residuals.
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

# [m] For bank and grade, the smallest visible size is the rms of a sinusoidal profile of
# this wavelength
ROAD_WAVELENGTH = 400.0


@dataclass(frozen=True)
class Detectable:
    """The smallest size at which an effect would be visible in the logs, and the typical
    size of the effect."""

    id: str
    parameter: str
    unit: str
    smallest: float  # inf if no size within the limits of the effect would be visible
    typical: float
    # The effect changes the residuals. Stiffness and the effects in the fit can
    # compensate a part of this change, which is therefore not visible. `absorbed` is the
    # mean square of this part / mean square of the whole change.
    absorbed: float

    @property
    def visible(self) -> bool:
        """True if the effect would be visible in the logs at its typical size."""
        return self.smallest <= self.typical


def compute_detectable(problem: Problem, current: Fit, effects: Sequence[Effect]) -> list[Detectable]:
    """Return the smallest visible size of each effect.

    An effect may have several parameters that state its size (strengths). The result is
    then for the strength with the smallest ratio (smallest visible size / typical size).
    """
    need = compute_threshold(len(effects))
    parameters = [p for e in effects for p in problem.strengths(e)]
    slopes = problem.compute_jacobian(current.values, current.residuals, parameters, REACH)
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
    """Return the partial derivatives of the residuals with respect to the rms of a
    sinusoidal road profile with wavelength ROAD_WAVELENGTH, as a matrix of one column.

    `slopes` has the partial derivatives with respect to the values at the knots.
    """
    place = np.array([float(p.name.knot) for p in parameters])
    return (slopes @ (np.sqrt(2.0) * np.sin(2 * np.pi * place * KNOT_DISTANCE / ROAD_WAVELENGTH)))[:, None]
