"""Is each named parameter one number? An effect of the catalogue has the same size at every speed, in every manoeuvre.

What only resembles one (a steering ratio that depends on speed, an active steering, a play) is fitted by a mean, and then would
have to be larger here and smaller there. So each parameter is let vary with a condition, p + d (z - mean z), in the linearisation
around the final fit, all else refitted; d is compared with the size and with its own uncertainty.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tselab.gap import where
from tselab.gap.catalogue import Effect
from tselab.gap.fit import Fit, excess, lengths
from tselab.gap.problem import PROFILES, Problem

CONDITIONS = ("speed", "|accel_y|", "|steering angle|", "time")
LEAST_RELATIVE = 0.25  # of the size, per standard deviation of the condition
LEAST_SIGMAS = 5.0
LEAST_LEFT = 0.4  # of what is left that the variation must close
UNITS = {"speed": "m/s", "|accel_y|": "m/s2", "|steering angle|": "rad", "time": "s"}


@dataclass(frozen=True)
class Variation:
    """How a parameter would have to change with a condition."""

    effect: str
    parameter: str
    condition: str
    relative: float  # change over one standard deviation of the condition, share of the size
    sigmas: float  # the same over its standard error, residuals as correlated as they are
    closes: float  # share of the gap that is left
    at: tuple[float, float]  # 10 and 90 % quantile of the condition
    values: tuple[float, float]  # what the parameter would be there

    @property
    def contradicts(self) -> bool:
        """That the parameter is one number, where something above the noise is left: forms that differ a little vary a little."""
        return abs(self.relative) >= LEAST_RELATIVE and abs(self.sigmas) >= LEAST_SIGMAS and self.closes >= LEAST_LEFT

    def words(self) -> str:
        unit = UNITS[self.condition]
        (a, b), (x, y) = self.at, self.values
        return f"{self.parameter} would be {x:.3g} at {self.condition} {a:.3g} {unit} and {y:.3g} at {b:.3g} {unit}"


def variations(problem: Problem, final: Fit, effects: Sequence[Effect]) -> list[Variation]:
    """Every strength of every effect against every condition."""
    known = [p.name for p in final.parameters]
    features = where.features(problem, final.values)
    q, r = np.linalg.qr(final.jacobian)
    left = max(excess(problem, final.residuals), 1.0)
    scale = np.zeros(len(final.residuals))
    for channel, t in lengths(problem, final.residuals).items():
        rows = problem.rows.channel == channel
        scale[rows] = t * np.mean(final.residuals[rows] ** 2)
    found = []
    for e in effects:
        if e.id in PROFILES:  # a road may be anything anywhere
            continue
        for p in e.strengths:
            slope, size = final.jacobian[:, known.index(p.name)], final.values[p.name] - p.default
            for condition in CONDITIONS:
                z = np.nan_to_num(features[condition])
                if z.std() <= 1e-3 * (1e-9 + np.abs(z).max()) or abs(size) < p.negligible:
                    continue
                z0 = (z - z.mean()) / z.std()
                taken = q.T @ (slope * z0)  # what the constants can do of it
                own = slope * z0 - q @ taken
                power = float(own @ own)
                if power <= 1e-9 * float(slope @ slope):
                    continue
                d = -float(own @ final.residuals) / power
                sd = float(np.sqrt(own**2 @ scale)) / power
                at = np.quantile(z, [0.1, 0.9])
                mean = final.values[p.name] - d * np.linalg.lstsq(r, taken, rcond=None)[0][known.index(p.name)]
                values = mean + d * (at - z.mean()) / z.std()
                found.append(
                    Variation(
                        e.id, p.name, condition, d / abs(size), d / max(sd, 1e-300), power * d * d / left,
                        (float(at[0]), float(at[1])), (float(values[0]), float(values[1])),
                    )
                )  # fmt: skip
    return sorted(found, key=lambda v: -v.closes)
