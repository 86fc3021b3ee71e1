"""Kinematic relations between the channels of a car, for guesses and for checks.

a_y = v r; a_x = dv/dt; wheels of an axle and yaw rate; steering angle and curvature. The
relations hold whatever the signals are called. Arrays are (rows,) on one even raster.
NaN: missing.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

COMPARISON_RATE = 20.0  # Hz of the raster on which channels are compared
MEAN_TIME = 0.4  # s of the moving mean before a comparison
MOVING_SPEED = 5.0  # m/s: slower rows are not compared
MIN_ROWS = 200  # min rows with both signals
USUAL_TRACK = 1.53  # m; cars have 1.3 .. 1.7
USUAL_TRACK_SD = 0.08  # of its logarithm


@dataclass(frozen=True)
class LineFit:
    """Line through two channels: y = slope x + offset."""

    slope: float = 0.0
    offset: float = 0.0
    corr: float = 0.0  # correlation; 0: too few rows, or a constant channel
    rows: int = 0


def smooth(x: np.ndarray) -> np.ndarray:
    """Return moving means over MEAN_TIME; NaN where more than half is missing."""
    n = max(1, round(MEAN_TIME * COMPARISON_RATE))
    good = np.isfinite(x)
    kernel = np.ones(n)
    count = np.convolve(good, kernel, "same")
    total = np.convolve(np.where(good, x, 0.0), kernel, "same")
    return np.where(count > 0.5 * n, total / np.maximum(count, 1), np.nan)


def fit(x: np.ndarray, y: np.ndarray, keep: np.ndarray | None = None) -> LineFit:
    """Fit y = slope x + offset in the rows `keep`.

    Both channels have noise, so the slope is the geometric mean of both regressions."""
    both = np.isfinite(x) & np.isfinite(y)
    if keep is not None:
        both &= keep
    n = int(both.sum())
    if n < MIN_ROWS:
        return LineFit(rows=n)
    a, b = x[both], y[both]
    a0, b0 = a.mean(), b.mean()
    sa, sb = a.std(), b.std()
    if sa < 1e-12 or sb < 1e-12:
        return LineFit(rows=n)
    corr = float(np.mean((a - a0) * (b - b0)) / (sa * sb))
    slope = float(np.sign(corr) * sb / sa)
    return LineFit(slope, float(b0 - slope * a0), corr, n)


def average(parts: Sequence[np.ndarray]) -> np.ndarray:
    """Return the mean of the signals in each row, without missing values."""
    table = np.array(parts)
    good = np.isfinite(table)
    count = good.sum(axis=0)
    return np.where(count > 0, np.where(good, table, 0.0).sum(axis=0) / np.maximum(count, 1), np.nan)


def differentiate(x: np.ndarray) -> np.ndarray:
    """Return the derivative, 1/s."""
    return np.gradient(x) * COMPARISON_RATE


@dataclass(frozen=True)
class Steering:
    """Model of the steering angle: per_curvature (r/v) (1 + understeer v^2) + offset."""

    per_curvature: float  # wheelbase x steering ratio, m
    sd: float  # of the logarithm of per_curvature
    understeer: float  # s2/m2
    offset: float
    share: float  # of the variance of the angle


# s2/m2, 1/(characteristic speed)^2: passenger cars, 18 .. 35 m/s
UNDERSTEER, UNDERSTEER_SD = 0.002, 0.0012


def fit_steering(angle: np.ndarray, v: np.ndarray, r: np.ndarray) -> Steering | None:
    """Fit the model of the steering angle; v: m/s, r: rad/s.

    Logs at one speed do not show the understeer, so it has a prior of passenger cars.

    Returns
    -------
    Steering or None
        None: too few bends.
    """
    moving = v > MOVING_SPEED
    curvature = r / np.where(moving, v, np.nan)
    keep = moving & np.isfinite(angle) & np.isfinite(curvature)
    if keep.sum() < MIN_ROWS or np.std(curvature[keep]) < 1e-5 or np.std(angle[keep]) < 1e-9:
        return None
    y, c, v2 = angle[keep], curvature[keep], v[keep] ** 2
    independent = max(len(y) / (2.0 * MEAN_TIME * COMPARISON_RATE), 1.0)
    grid = np.linspace(UNDERSTEER - 3 * UNDERSTEER_SD, UNDERSTEER + 5 * UNDERSTEER_SD, 41)
    # Regression of y on c + k (c v2) for all k of the grid at once, by the covariances of
    # c, c v2 and y
    parts = np.array([c, c * v2])
    middle = parts.mean(axis=1)
    parts = parts - middle[:, None]
    shared, with_y, own = parts @ parts.T / len(y), parts @ (y - y.mean()) / len(y), float(y.var())
    terms = np.array([np.ones(len(grid)), grid])
    spread = np.einsum("ik,ij,jk->k", terms, shared, terms)
    # this understeer needs no steering at the speed of the log: excluded
    flat = spread < 1e-24
    slopes = np.where(flat, 0.0, with_y @ terms / np.where(flat, 1.0, spread))
    shares = np.where(flat, 0.0, slopes * (with_y @ terms) / own)
    offsets = y.mean() - slopes * (middle @ terms)
    worth = (
        -0.5 * independent * np.log(np.maximum(1 - shares, 1e-4))
        - 0.5 * ((grid - UNDERSTEER) / UNDERSTEER_SD) ** 2
    )
    weight = np.exp(worth - worth.max())
    weight /= weight.sum()
    best = int(worth.argmax())
    size = np.log(np.maximum(np.abs(slopes), 1e-12))
    sd = float(np.sqrt(max(weight @ size**2 - (weight @ size) ** 2, 0.0)))
    # The noise of the curvature biases the slope towards 0. The true slope is between
    # this regression and the inverse one, slope / share. The result is their geometric
    # mean, as in fit(). Half their distance, as a uniform distribution, is added to the
    # sd.
    apart = -0.5 * float(np.log(max(shares[best], 1e-2)))
    sd = float(np.hypot(sd, apart / np.sqrt(3.0)))
    return Steering(
        float(slopes[best] * np.exp(apart)), sd, float(grid[best]), float(offsets[best]), float(shares[best])
    )


def find_lag(
    x: np.ndarray, y: np.ndarray, keep: np.ndarray, more: tuple[np.ndarray, ...] = ()
) -> tuple[float, float]:
    """Return the lag of y behind x and its sd, s: y = a (x - lag x') + the terms `more`.

    (0, inf): too few rows."""
    slope = differentiate(x)
    table = np.column_stack([x, slope, *more, np.ones(len(x))])
    rows = keep & np.isfinite(table).all(axis=1) & np.isfinite(y)
    n = int(rows.sum())
    if n < MIN_ROWS or np.std(x[rows]) < 1e-9:
        return 0.0, np.inf
    t, target = table[rows], y[rows]
    scale = np.maximum(np.sqrt(np.mean(t**2, axis=0)), 1e-12)
    found, *_ = np.linalg.lstsq(t / scale, target, rcond=None)
    left = target - (t / scale) @ found
    independent = max(n / (2.0 * MEAN_TIME * COMPARISON_RATE), 1.0)
    inverse = np.linalg.pinv((t / scale).T @ (t / scale) / n)
    sd = np.sqrt(np.mean(left**2) * np.diag(inverse) / independent) / scale
    a, b = (found / scale)[:2]
    if abs(a) < 1e-12:
        return 0.0, np.inf
    return float(-b / a), float(np.hypot(sd[1] / a, b * sd[0] / a**2))


def compute_ground_speed(latitude: np.ndarray, longitude: np.ndarray) -> np.ndarray:
    """Return the speed over ground, m/s, from positions in degrees."""
    north = np.gradient(np.radians(latitude)) * 6371e3 * COMPARISON_RATE
    east = (
        np.gradient(np.unwrap(np.radians(longitude)))
        * 6371e3
        * COMPARISON_RATE
        * np.cos(np.radians(np.nanmean(latitude)))
    )
    return np.hypot(north, east)
