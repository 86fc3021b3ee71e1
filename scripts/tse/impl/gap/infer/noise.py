"""What no model explains of a channel, in units of its sensor's noise: the process of tse.impl.identify, with priors.

White: the noise, known to some percent from row to row differences. Fast: what the model does not have, a share of what the channel
does. Slow: road, wind, drift of the sensor. All sizes may be nothing: a car that the model has is one of the answers.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize

from tse.impl.identify.data import BLOCK
from tse.impl.identify.discrepancy import Discrepancy, Piece

# 1, 1, 1, s, s: of white, share, slow, fast time and slow time, prior; white and slow in units of the noise of one
# block
MEDIAN = (1.0, 0.002, 0.1, 0.3, 20.0)
SD = (0.3, 1.5, 1.5, 0.7, 0.7)  # ln: of the same: a car that the model has is one of the answers
RANGES = ((0.5, 20.0), (0.0001, 2.0), (0.001, 15.0), (0.1, 2.0), (3.0, 200.0))  # 1, 1, 1, s, s: of the same
BIAS_SD = 300.0  # of a sensor in a log, units of the noise of one block: any
PRECISION = 1e-05  # relative, of the cost: a tenth of a nat
APART = 1000000.0  # s: logs that know nothing of each other


def ln_prior(d: Discrepancy) -> float:
    z = (np.log(d.numbers) - np.log(MEDIAN)) / SD
    return -0.5 * float(z @ z)


@dataclass(frozen=True)
class Series:
    """The residuals of a channel in all logs one after the other, so far apart that they know nothing of each other."""

    piece: Piece
    starts: np.ndarray

    @classmethod
    def of(cls, pieces: Sequence[Piece]) -> Series:
        length = [len(p.time) for p in pieces]
        time = np.concatenate([p.time - p.time[0] + k * APART for k, p in enumerate(pieces)])
        rest = (np.concatenate([getattr(p, name) for p in pieces]) for name in ("count", "size", "bias", "residual"))
        return cls(Piece(time, *rest), np.append(0, np.cumsum(length)[:-1]))


def likelihood(d: Discrepancy, series: Series) -> float:
    """ln likelihood of residuals, up to a constant of the logs: biases are normal with BIAS_SD."""
    white, log_det = d.whiten(series.piece, np.column_stack([series.piece.residual, series.piece.bias]))
    r, b = white.T
    power, both = np.add.reduceat(b * b, series.starts), np.add.reduceat(r * b, series.starts)
    biases = float(np.sum(both**2 / (power + BIAS_SD**-2)) - np.sum(np.log1p(BIAS_SD**2 * power)))
    return -0.5 * (float(r @ r) + log_det) + 0.5 * biases


def worth(d: Discrepancy, series: Series) -> float:
    """ln probability of residuals and of the discrepancy, up to a constant."""
    return likelihood(d, series) + ln_prior(d)


@dataclass(frozen=True)
class Left:
    """What neither the model nor noise nor anything slow explains of a channel. `energy`: its variance and the noise's over the
    noise's; `values`: as how many independent ones it counts in the likelihood."""

    energy: float
    values: float

    @classmethod
    def of(cls, d: Discrepancy, pieces: Sequence[Piece]) -> Left:
        size = np.concatenate([p.size for p in pieces])
        energy = 1.0 + d.share**2 * float(np.mean(size**2)) / d.white**2
        return cls(energy, len(size) * min(1.0, BLOCK / (2.0 * d.time[0])))

    @property
    def wrong(self) -> float:
        """Independent values that are the model's error."""
        return self.values * (1.0 - 1.0 / self.energy)


# There is another in tse.impl.identify.discrepancy, of which the calibration's numbers are: noise and drift have no prior there,
# limits go with the size of the residuals, and a bias may be anything. Here sets of effects are compared by it, so that all priors
# are proper and sizes are in units of the noise. What both could share is the call of the minimiser.
def found(pieces: Sequence[Piece], start: Discrepancy | None = None) -> Discrepancy:
    """The most probable discrepancy of a channel."""
    limits, series = np.log(RANGES), Series.of(pieces)

    def cost(h: np.ndarray) -> float:
        return -worth(Discrepancy.of(np.exp(h)), series)

    size = float(np.sqrt(np.mean(np.concatenate([p.residual for p in pieces]) ** 2)))
    guesses = [start] if start else []
    guesses.append(Discrepancy.of((1.0, 0.02 if size > 1.5 else MEDIAN[1], max(MEDIAN[2], 0.3 * (size - 1)), *MEDIAN[3:])))
    best = min((np.clip(np.log(g.numbers), *limits.T) for g in guesses), key=cost)
    # slopes are nothing where a part is nothing: it would stay gone
    best[1], best[2] = max(best[1], np.log(1e-3)), max(best[2], np.log(0.03))
    ended = minimize(cost, best, method="L-BFGS-B", bounds=limits, options={"ftol": PRECISION, "maxiter": 60})
    return Discrepancy.of(np.exp(ended.x))
