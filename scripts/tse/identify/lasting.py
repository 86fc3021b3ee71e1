"""Measure the slow part of residuals, as the settings of the filter describe it.

power: integral of the autocovariance over positive lags, i.e. the variance of an error
that lasts 1 s. walk: random walk that bounds the spectrum of the residuals from above.
With the mean square difference D(L) of residuals over a lag L,
    walk^2 = 2 max of (D(L) - D(SHORT_LAG)) / (L - SHORT_LAG), L up to LONG_LAG.
Noise and errors shorter than SHORT_LAG do not contribute. A random walk has the same
quotient for every L, half of what counts here. Hills, with autocovariance exp(-t/T)
(cos t/T + sin t/T) and unit variance, have walk^2 = 2/T: the spectrum of that random walk
touches theirs and is nowhere below it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

SHORT_LAG, LONG_LAG = 0.5, 10.0  # s
MAX_COVARIANCE_LAG = 4.0  # s, of the autocovariance
MIN_PIECE_VALUES = 20  # values of a piece, or differences over a lag
PIECE_TIME = 10.0  # s: about two manoeuvres
SHARE_QUANTILE = 0.9  # share of the pieces in which the model error stays below the result


@dataclass(frozen=True)
class Piece:
    """Residuals of one channel in one log: time [s], size of the channel, residual."""

    time: np.ndarray
    size: np.ndarray
    residual: np.ndarray


@dataclass(frozen=True)
class Lasting:
    """Slow part of the residuals of a channel: power [unit2 s], walk [unit/sqrt(s)]."""

    power: float
    walk: float


def measure_lasting(pieces: Sequence[Piece]) -> Lasting:
    """Measure power and walk of a channel over all its logs, each about its mean.

    Values are about evenly spaced. Pairs across a gap between stretches are left out.
    """
    step = float(np.median(np.concatenate([np.diff(p.time) for p in pieces])))
    centred = [p.residual - p.residual.mean() for p in pieces]

    def combine(lag: int, of: np.ufunc) -> np.ndarray:
        both = zip(pieces, centred, strict=True)
        return np.concatenate([_combine_lagged(p, e, lag, step, of) for p, e in both])

    last = round(MAX_COVARIANCE_LAG / step)
    covariance = []
    for lag in range(last + 1):
        products = combine(lag, np.multiply)
        if len(products) < MIN_PIECE_VALUES:
            break
        covariance.append(float(products.mean()))
    power = step * (0.5 * covariance[0] + _sum_positive(np.array(covariance[1:]))) if covariance else 0.0

    def compute_structure(lag: int) -> float:
        found = combine(lag, np.subtract)
        return float(np.mean(found**2)) if len(found) >= MIN_PIECE_VALUES else np.nan

    short = max(1, round(SHORT_LAG / step))
    lags = np.arange(2 * short, round(LONG_LAG / step) + 1, short)
    first = compute_structure(short)
    rise = [(compute_structure(k) - first) / ((k - short) * step) for k in lags]
    return Lasting(max(power, 0.0), float(np.sqrt(2.0 * max(0.0, *np.nan_to_num(rise), 0.0))))


def _combine_lagged(piece: Piece, residual: np.ndarray, lag: int, step: float, of: np.ufunc) -> np.ndarray:
    """Apply `of` to the pairs of values that are `lag` apart in index and in time."""
    if lag >= len(residual):
        return np.zeros(0)
    near = slice(None, len(residual) - lag)
    there = np.abs(piece.time[lag:] - piece.time[near] - lag * step) < 0.5 * step
    return of(residual[lag:], residual[near])[there]


def _sum_positive(covariance: np.ndarray) -> float:
    """Sum autocovariances up to the first pair that sums to <= 0 (Geyer 1992)."""
    pairs = covariance[: len(covariance) // 2 * 2].reshape(-1, 2).sum(axis=1)
    end = int(np.argmax(pairs <= 0)) if (pairs <= 0).any() else len(pairs)
    return float(pairs[:end].sum())


def measure_share(pieces: Sequence[Piece], floor: Sequence[np.ndarray]) -> tuple[float, float]:
    """Return the model error as a share of the signal, and the number of pieces that show
    it.

    Parameters
    ----------
    pieces
        Residuals of a channel, by log.
    floor
        Floor of the signal for each value, by log.

    Returns
    -------
    share
        sd of an error that lasts 1 s and has the power of the residuals, over the signal.
        It holds in SHARE_QUANTILE of the pieces of PIECE_TIME: a model that is right on a
        motorway and 15 % off in a hairpin is not 5 % off.
    count
        Number of pieces. Each counts by the share of the signal in the sum of signal and
        floor.
    """
    square = np.mean(np.concatenate([(p.residual - p.residual.mean()) ** 2 for p in pieces]))
    lasts = measure_lasting(pieces).power / max(float(square), 1e-300)
    found, count = [], 0.0
    for p, x in zip(pieces, floor, strict=True):
        place = (p.time // PIECE_TIME).astype(int)
        for k in np.unique(place):
            mine = place == k
            if mine.sum() >= MIN_PIECE_VALUES:
                size = np.mean(p.size[mine] ** 2)
                happens = size + np.mean(x[mine] ** 2)
                found.append(lasts * np.mean((p.residual[mine] - p.residual.mean()) ** 2) / happens)
                count += float(size / happens)
    return (float(np.sqrt(np.quantile(found, SHARE_QUANTILE))) if found else 0.0), count
