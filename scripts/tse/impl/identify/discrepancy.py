"""What no model explains of a channel: a Gaussian process, white noise and two that decay, a fast and a slow one.

Slow: road bank and grade, drift of the sensor. It is smooth, as hills are, exp(-t/T) (cos t/T + sin t/T): with a kink at 0 its
likeliest time is minutes, hills count as what the car does, and tyres come out too stiff along. Fast: what the model does not have,
which is the more the more the car does: a share of the channel's size at the time. Sizes and times are found from the residuals by
maximum likelihood; a channel that the model misses badly is believed less. The share has a least: with forty numbers a model of
another car fits a log down to the noise of its sensors, at numbers that are wrong by many of the sd that noise alone would leave,
and predicts other logs badly.
O(n) by the semiseparable Cholesky factor of such processes (Foreman-Mackey et al. 2017, celerite2).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import celerite2.driver as semiseparable
import numpy as np
from scipy.optimize import minimize

TIMES = (0.3, 20.0)  # s: prior medians of the two decay times
TIME_SD = 0.7  # ln: of both
RANGES = ((0.15, 0.6), (1.0, 200.0))  # s: the fast one is neither the white noise of blocks of 0.04 s nor a bias
SHARE = 0.03  # prior median of the share that the model does not have
SHARE_SD = 0.7  # ln: of it
# its range; the least: with forty numbers a model of another car fits a log down to the noise of its sensors, at
# numbers that are wrong by many of the sd that noise alone would leave
SHARES = (0.02, 1.0)
ACTIVE_TIME = 1.0  # s: over which a channel's size is taken
PRECISION = 1e-07  # relative, of the cost: some thousandths of a nat
LEAST = 0.001  # sd of a part over that of the residual: none


@dataclass
class Piece:
    """Residuals of one channel in one log, blocks."""

    time: np.ndarray  # s
    count: np.ndarray  # rows in each block
    size: np.ndarray  # of the channel at the time
    bias: np.ndarray  # what a bias of 1 would be in the residual
    residual: np.ndarray
    _waves: tuple[float, np.ndarray, np.ndarray] | None = field(default=None, init=False, repr=False, compare=False)

    def waves(self, rate: float) -> tuple[np.ndarray, np.ndarray]:
        """cos and sin of rate x time: most of what is asked one after the other has the same rate."""
        if self._waves is None or self._waves[0] != rate:
            phase = rate * (self.time - self.time[0])
            self._waves = rate, np.cos(phase), np.sin(phase)
        return self._waves[1:]


@dataclass(frozen=True)
class Discrepancy:
    """sd of the white noise of one row; the fast part as a share of the channel's size; sd of the slow part; decay times [s]."""

    white: float
    share: float
    slow: float
    time: tuple[float, float]

    @property
    def numbers(self) -> list[float]:
        return [self.white, self.share, self.slow, *self.time]

    @classmethod
    def of(cls, numbers: Sequence[float]) -> Discrepancy:
        white, share, slow, fast_time, slow_time = map(float, numbers)
        return cls(white, share, slow, (fast_time, slow_time))

    @property
    def walk(self) -> float:
        """Unit of the slow part per sqrt(s): of the smallest random walk whose spectrum is nowhere below that of the slow part,
        2 T slow^2/(1 + (w T)^4/4); they touch at w = sqrt(2)/T."""
        return self.slow * float(np.sqrt(2.0 / self.time[1]))

    def _factor(self, piece: Piece) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        n, slow = len(piece.time), 1.0 / self.time[1]
        rates = np.array([1.0 / self.time[0], slow, slow])
        fast = self.share * piece.size
        cos, sin = piece.waves(slow)
        u = np.column_stack([fast, self.slow**2 * (cos + sin), self.slow**2 * (sin - cos)])
        v = np.column_stack([fast, cos, sin])
        diagonal = self.white**2 / np.maximum(piece.count, 0.1) + fast**2 + self.slow**2
        d, w = semiseparable.factor(piece.time, rates, diagonal, u, v, np.empty(n), np.empty((n, 3)))
        return rates, u, w, d

    def whiten(self, piece: Piece, columns: np.ndarray) -> tuple[np.ndarray, float]:
        """L^-1 columns, and ln det of the covariance L L'."""
        rates, u, w, d = self._factor(piece)
        y = np.ascontiguousarray(columns)
        return semiseparable.solve_lower(piece.time, rates, u, w, y, np.empty_like(y)) / np.sqrt(d)[:, None], float(np.log(d).sum())


def without_bias(white: np.ndarray, bias: np.ndarray) -> np.ndarray:
    """Whitened columns, less what a bias of any size explains. `bias`: of 1, whitened; zeros: there is none."""
    # a sum over one row each: threads of the BLAS cost a hundred times as much where other processes have the cores
    shares = np.einsum("i,ij->j", bias, white) / max(float(np.einsum("i,i", bias, bias)), 1e-300)
    return white - np.outer(bias, shares)


def cost(d: Discrepancy, pieces: Sequence[Piece]) -> float:
    """Minus the log likelihood of residuals up to a constant of each piece."""
    total = 0.0
    for piece in pieces:
        white, log_det = d.whiten(piece, np.column_stack([piece.residual, piece.bias]))
        left = without_bias(white[:, :1], white[:, 1])[:, 0]
        total += 0.5 * float(np.einsum("i,i", left, left)) + 0.5 * log_det
    return total


def found(pieces: Sequence[Piece], start: Discrepancy | None = None, far: bool = False) -> Discrepancy:
    """The likeliest discrepancy of a channel, with the prior of its share and times. `far`: the residuals are those of a model that
    does not fit yet; the slow part is as slow as its prior then. In a second it follows the car, explains a channel by itself - a
    road that leans by 7 % from one second to the next - and a search that believes it stays where it is."""
    size = float(np.sqrt(np.mean(np.concatenate([p.residual - p.residual.mean() for p in pieces]) ** 2))) or 1e-9
    centre, sd = np.log([SHARE, *TIMES]), np.array([SHARE_SD, TIME_SD, TIME_SD])

    def objective(h: np.ndarray) -> float:
        return cost(Discrepancy.of(np.exp(h)), pieces) + 0.5 * float(np.sum(((h[[1, 3, 4]] - centre) / sd) ** 2))

    bound = (LEAST * size, 10 * size)
    limits = np.log([bound, SHARES, bound, RANGES[0], (TIMES[1], TIMES[1]) if far else RANGES[1]])
    first = start.numbers if start else Discrepancy(size, SHARE, 0.3 * size, TIMES).numbers
    first = np.maximum(first, [0.1 * size, 0.0, 0.1 * size, 0.0, 0.0])  # slopes are nothing where a part is: it would stay gone
    ended = minimize(objective, np.clip(np.log(first), *limits.T), method="L-BFGS-B", bounds=limits, options={"ftol": PRECISION})
    return Discrepancy.of(np.exp(ended.x))
