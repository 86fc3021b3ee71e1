"""Measure the slow part of residuals by two numbers, power and walk.

power: integral of the autocovariance of the residuals over positive lags [unit^2 s]. The
variance of an estimate from a long log depends on the autocovariance only through power.
An error with correlation time 1 s and variance power / 1 s has the same integral. The
setting model_sd, which describes such an error, is derived from power.

walk: sd after 1 s [unit/sqrt(s)] of a random walk whose spectrum is nowhere below that of
the residuals. walk becomes the setting for the bias of the channel, which the filter
models as a random walk. With D(L), the mean square difference of residuals a lag L apart,
    walk^2 = 2 max of (D(L) - D(SHORT_LAG)) / (L - SHORT_LAG), for L up to LONG_LAG.
Noise and errors shorter than SHORT_LAG add the same to D(L) and D(SHORT_LAG), and cancel.
The factor 2 suits residuals that hills cause, whose autocovariance at the lag t is
exp(-t/T) (cos t/T + sin t/T) for variance 1: the spectrum of a random walk with
walk^2 = 2/T touches theirs from above, and for T >> SHORT_LAG the formula gives about
2/T. If the residuals are themselves a random walk, walk^2 is too large by the factor 2.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

SHORT_LAG, LONG_LAG = 0.5, 10.0  # [s] lags in the formula of walk, see the top of this file
MAX_COVARIANCE_LAG = 4.0  # [s] longest lag of the autocovariance in the integral that gives power
# min number of values in an interval of measure_share(), and of pairs of values at a lag.
# Intervals and lags with fewer are not used
MIN_PIECE_VALUES = 20
LASTING_PIECE_TIME = 10.0  # [s] length of an interval in measure_share(): about two manoeuvres
# measure_share() computes the ratio of model error to signal for each interval, and
# returns this quantile of the ratios
SHARE_QUANTILE = 0.9


@dataclass(frozen=True)
class Piece:
    """Residuals of one channel in one log. The arrays have an entry for each residual."""

    time: np.ndarray  # [s]
    # moving rms (over 1 s) of the measured channel, in the unit of the residuals
    size: np.ndarray
    residual: np.ndarray


@dataclass(frozen=True)
class Lasting:
    """Size of the slow part of the residuals of a channel (see the top of this file)."""

    power: float  # [unit^2 s] integral of the autocovariance over positive lags
    # [unit/sqrt(s)] sd after 1 s of a random walk whose spectrum is nowhere below that of
    # the residuals
    walk: float


def measure_lasting(pieces: Sequence[Piece]) -> Lasting:
    """Measure power and walk of the residuals of a channel in all its logs.

    The mean of the residuals of each log is subtracted first. Apart from gaps, the values
    must be about equidistant in time. Pairs of values across a gap are left out.
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
    """Apply `of` to all pairs of residuals that are `lag` entries apart.

    Pairs across a gap, whose distance in time is not `lag` times `step`, are left out.
    """
    if lag >= len(residual):
        return np.zeros(0)
    near = slice(None, len(residual) - lag)
    there = np.abs(piece.time[lag:] - piece.time[near] - lag * step) < 0.5 * step
    return of(residual[lag:], residual[near])[there]


def _sum_positive(covariance: np.ndarray) -> float:
    """Sum pairs of autocovariances up to the first pair with a sum <= 0 (Geyer 1992)."""
    pairs = covariance[: len(covariance) // 2 * 2].reshape(-1, 2).sum(axis=1)
    end = int(np.argmax(pairs <= 0)) if (pairs <= 0).any() else len(pairs)
    return float(pairs[:end].sum())


def measure_share(pieces: Sequence[Piece], floor: Sequence[np.ndarray]) -> tuple[float, float]:
    """Return the ratio of model error to signal, and the effective number of intervals.

    The ratio is computed for each interval of LASTING_PIECE_TIME:
        ratio^2 = power / 1 s / (signal^2 + floor^2).
    power is the integral of the autocovariance of the residuals (top of this file). An
    interval has the power of all residuals, times mean square of its residuals / mean
    square of all. signal is the rms of the measured channel (Piece.size).

    Parameters
    ----------
    pieces
        Residuals of a channel, one entry for each log.
    floor
        A small signal for each value, one array for each log. It prevents large ratios in
        intervals with hardly any signal, e.g. straight driving.

    Returns
    -------
    share
        The SHARE_QUANTILE of the ratios of all intervals. Their mean would be misleading:
        a model that is right on a motorway and 15 % off in a hairpin is not 5 % off.
    count
        Effective number of intervals, the sum of signal^2 / (signal^2 + floor^2): an
        interval counts as 1 if its signal is much larger than the floor, and as 0 if it
        has no signal.
    """
    square = np.mean(np.concatenate([(p.residual - p.residual.mean()) ** 2 for p in pieces]))
    lasts = measure_lasting(pieces).power / max(float(square), 1e-300)
    found, count = [], 0.0
    for p, x in zip(pieces, floor, strict=True):
        place = (p.time // LASTING_PIECE_TIME).astype(int)
        for k in np.unique(place):
            mine = place == k
            if mine.sum() >= MIN_PIECE_VALUES:
                size = np.mean(p.size[mine] ** 2)
                happens = size + np.mean(x[mine] ** 2)
                found.append(lasts * np.mean((p.residual[mine] - p.residual.mean()) ** 2) / happens)
                count += float(size / happens)
    return (float(np.sqrt(np.quantile(found, SHARE_QUANTILE))) if found else 0.0), count
