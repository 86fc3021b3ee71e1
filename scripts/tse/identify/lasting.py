"""What a fit leaves of a channel and lasts: the numbers by which the filter counts it.

power, the integral of the autocovariance over positive lags: an error of that variance that
lasts a second. walk, a random walk that stays above hills: of the difference of residuals
over a lag L, D(L) = mean square,
    walk^2 = 2 most of (D(L) - D(SHORT)) / (L - SHORT), L up to LONG.
Noise, and what lasts less than SHORT, has none of it. A random walk has half of that for
every L. Hills, exp(-t/T) (cos t/T + sin t/T), have a spectrum that the random walk touches,
and is nowhere below (of unit variance, walk^2 = 2/T).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

SHORT_LAG, LONG_LAG = 0.5, 10.0  # s
MAX_COVARIANCE_LAG = 4.0  # s: of the autocovariance
MIN_PIECE_VALUES = 20  # differences over a lag, or values of a piece
PIECE_TIME = 10.0  # s: a manoeuvre or two
SHARE_QUANTILE = 0.9  # of the pieces, in which a share holds


@dataclass(frozen=True)
class Piece:
    """Residuals of one channel in one log: when [s], the size of the channel at the time,
    and what is left."""

    time: np.ndarray
    size: np.ndarray
    residual: np.ndarray


@dataclass(frozen=True)
class Lasting:
    """Of a channel: power [unit2 s] and walk [unit/sqrt(s)]."""

    power: float
    walk: float


def measure_lasting(pieces: Sequence[Piece]) -> Lasting:
    """Return it of all logs of a channel together, each about its mean.

    Values are about evenly spaced; over a gap between stretches nothing is counted."""
    step = float(np.median(np.concatenate([np.diff(p.time) for p in pieces])))
    centred = [p.residual - p.residual.mean() for p in pieces]

    def pairs(lag: int, of: np.ufunc) -> np.ndarray:
        both = zip(pieces, centred, strict=True)
        return np.concatenate([_combine_lagged(p, e, lag, step, of) for p, e in both])

    last = round(MAX_COVARIANCE_LAG / step)
    covariance = []
    for lag in range(last + 1):
        products = pairs(lag, np.multiply)
        if len(products) < MIN_PIECE_VALUES:
            break
        covariance.append(float(products.mean()))
    power = step * (0.5 * covariance[0] + _sum_positive(np.array(covariance[1:]))) if covariance else 0.0

    def apart(lag: int) -> float:
        found = pairs(lag, np.subtract)
        return float(np.mean(found**2)) if len(found) >= MIN_PIECE_VALUES else np.nan

    short = max(1, round(SHORT_LAG / step))
    lags = np.arange(2 * short, round(LONG_LAG / step) + 1, short)
    rise = [(apart(k) - apart(short)) / ((k - short) * step) for k in lags]
    return Lasting(max(power, 0.0), float(np.sqrt(2.0 * max(0.0, *np.nan_to_num(rise), 0.0))))


def _combine_lagged(piece: Piece, residual: np.ndarray, lag: int, step: float, of: np.ufunc) -> np.ndarray:
    """Return `of` each value and the one `lag` before it, where these are so far apart."""
    if lag >= len(residual):
        return np.zeros(0)
    near = slice(None, len(residual) - lag)
    there = np.abs(piece.time[lag:] - piece.time[near] - lag * step) < 0.5 * step
    return of(residual[lag:], residual[near])[there]


def _sum_positive(covariance: np.ndarray) -> float:
    """Return the sum of autocovariances as long as two neighbours are positive (Geyer 1992)."""
    pairs = covariance[: len(covariance) // 2 * 2].reshape(-1, 2).sum(axis=1)
    end = int(np.argmax(pairs <= 0)) if (pairs <= 0).any() else len(pairs)
    return float(pairs[:end].sum())


def measure_share(pieces: Sequence[Piece], least: Sequence[np.ndarray]) -> tuple[float, float]:
    """Return the sd of an error that lasts 1 s and has the power of the residuals, as a share
    of what happens; and in how many pieces of CUT something happens.

    What happens is the size of the channel, and `least` where it stands still. The share
    holds in MOST of the pieces: a model that is right on a motorway and 15 % off in a hairpin
    is not 5 % off. A piece counts by the part of what happens that is no `least`."""
    square = np.mean(np.concatenate([(p.residual - p.residual.mean()) ** 2 for p in pieces]))
    lasts = measure_lasting(pieces).power / max(float(square), 1e-300)
    found, count = [], 0.0
    for p, x in zip(pieces, least, strict=True):
        place = (p.time // PIECE_TIME).astype(int)
        for k in np.unique(place):
            mine = place == k
            if mine.sum() >= MIN_PIECE_VALUES:
                size = np.mean(p.size[mine] ** 2)
                happens = size + np.mean(x[mine] ** 2)
                found.append(lasts * np.mean((p.residual[mine] - p.residual.mean()) ** 2) / happens)
                count += float(size / happens)
    return (float(np.sqrt(np.quantile(found, SHARE_QUANTILE))) if found else 0.0), count
