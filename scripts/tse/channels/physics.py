"""Kinematic relations between the channels of a car, for guesses and for checks.

With speed v and yaw rate r: a_y = v r; a_x = dv/dt; right - left wheel speed of an axle =
track x r; steering angle = steering ratio x wheelbase x r/v, plus understeer. These
relations identify signals regardless of their names. All arrays are (rows,), sampled at
the same times at COMPARISON_RATE. NaN: missing.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

COMPARISON_RATE = 20.0  # [Hz] sampling rate of the raster on which channels are compared
MEAN_TIME = 0.4  # [s] length of the moving mean of channels before a comparison
MOVING_SPEED = 5.0  # [m/s] slower rows are not compared
MIN_ROWS = 200  # min number of rows with both signals for a comparison
USUAL_TRACK = 1.53  # [m] mean track of passenger cars; the range is 1.3 .. 1.7
USUAL_TRACK_SD = 0.08  # [1] sd of the logarithm of the track


@dataclass(frozen=True)
class LineFit:
    """Straight line fitted to the values x and y of two channels: y = slope x +
    offset."""

    slope: float = 0.0
    offset: float = 0.0
    corr: float = 0.0  # correlation of x and y; 0: too few rows, or a constant channel
    rows: int = 0  # number of rows with both channels


def smooth(x: np.ndarray) -> np.ndarray:
    """Return moving means over MEAN_TIME; NaN if half of the values or more are NaN."""
    n = max(1, round(MEAN_TIME * COMPARISON_RATE))
    good = np.isfinite(x)
    kernel = np.ones(n)
    count = np.convolve(good, kernel, "same")
    total = np.convolve(np.where(good, x, 0.0), kernel, "same")
    return np.where(count > 0.5 * n, total / np.maximum(count, 1), np.nan)


def fit(x: np.ndarray, y: np.ndarray, keep: np.ndarray | None = None) -> LineFit:
    """Fit y = slope x + offset in the rows `keep`; None: in all rows.

    Both channels have noise. The slope is therefore sd(y) / sd(x), with the sign of the
    correlation. This is the geometric mean of two values of dy/dx: that of the regression
    of y on x, and that of the regression of x on y."""
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
    """Return the mean of the signals in each row. Missing values are left out."""
    table = np.array(parts)
    good = np.isfinite(table)
    count = good.sum(axis=0)
    return np.where(count > 0, np.where(good, table, 0.0).sum(axis=0) / np.maximum(count, 1), np.nan)


def differentiate(x: np.ndarray) -> np.ndarray:
    """Return the time derivative, per second, of a channel sampled at COMPARISON_RATE."""
    return np.gradient(x) * COMPARISON_RATE


@dataclass(frozen=True)
class Steering:
    """Model of the steering angle: per_curvature (r/v) (1 + understeer v^2) + offset."""

    # Angle per curvature r/v at low speed (r: yaw rate, v: speed), in the unit of the
    # angle x m. For an angle in rad, its magnitude is wheelbase [m] x steering ratio. It
    # is negative if the logged angle and yaw rate have opposite signs in a bend.
    per_curvature: float
    sd: float  # [1] sd of the logarithm of |per_curvature|
    understeer: float  # [s2/m2]
    offset: float  # unit of the angle
    share: float  # [1] share of the variance of the angle that the model explains


# [s2/m2] mean and sd of the understeer over passenger cars. The understeer is
# 1/(characteristic speed)^2, and the characteristic speed of passenger cars is 18 .. 35
# m/s.
UNDERSTEER, UNDERSTEER_SD = 0.002, 0.0012


def fit_steering(angle: np.ndarray, v: np.ndarray, r: np.ndarray) -> Steering | None:
    """Fit the model of the steering angle to a log.

    At constant speed, understeer and steering ratio have the same effect on the angle, so
    a log at constant speed cannot determine both. The understeer therefore has a normal
    prior with the mean UNDERSTEER and the sd UNDERSTEER_SD. `angle`: steering angle in
    any unit. `v`: [m/s] speed. `r`: [rad/s] yaw rate.

    Returns
    -------
    Steering or None
        The fitted model. None: too few rows, or no bends.
    """
    moving = v > MOVING_SPEED
    curvature = r / np.where(moving, v, np.nan)
    keep = moving & np.isfinite(angle) & np.isfinite(curvature)
    if keep.sum() < MIN_ROWS or np.std(curvature[keep]) < 1e-5 or np.std(angle[keep]) < 1e-9:
        return None
    y, c, v2 = angle[keep], curvature[keep], v[keep] ** 2
    independent = max(len(y) / (2.0 * MEAN_TIME * COMPARISON_RATE), 1.0)
    grid = np.linspace(UNDERSTEER - 3 * UNDERSTEER_SD, UNDERSTEER + 5 * UNDERSTEER_SD, 41)
    # The model is y = per_curvature (c + k c v2) + offset. y: angle, c: curvature r/v, k:
    # understeer, v2: squared speed. For each k of a grid, regress y on c + k c v2. The
    # covariances of c, c v2 and y suffice for this, and are the same for all k.
    parts = np.array([c, c * v2])
    middle = parts.mean(axis=1)
    parts = parts - middle[:, None]
    shared, with_y, own = parts @ parts.T / len(y), parts @ (y - y.mean()) / len(y), float(y.var())
    terms = np.array([np.ones(len(grid)), grid])
    spread = np.einsum("ik,ij,jk->k", terms, shared, terms)
    # exclude each k for which c + k (c v2) is constant: k = -1 / v2 at constant speed
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
    # Noise of the curvature biases the slope of the regression of angle on curvature
    # towards 0. The regression of curvature on angle gives slope / share instead (share:
    # explained share of the variance). Noise of the angle biases this value away from 0.
    # Return the geometric mean of slope and slope / share, as in fit(). The sd includes
    # that of a uniform distribution of ln(slope) between both values.
    apart = -0.5 * float(np.log(max(shares[best], 1e-2)))
    sd = float(np.hypot(sd, apart / np.sqrt(3.0)))
    return Steering(
        float(slopes[best] * np.exp(apart)), sd, float(grid[best]), float(offsets[best]), float(shares[best])
    )


def find_lag(
    x: np.ndarray, y: np.ndarray, keep: np.ndarray, more: tuple[np.ndarray, ...] = ()
) -> tuple[float, float]:
    """Return the lag of y behind x, and the sd of the lag, both in s.

    y is modelled as the delayed signal a x(t - lag), plus a combination of further
    regressors `more`, plus a constant. For a small lag, x(t - lag) is about x - lag x',
    with the derivative x' of x. The model is thus linear, with the coefficient a of x and
    the coefficient b = -a lag of x'. Both are fitted by least squares to the rows `keep`,
    and the lag is -b / a. Return (0, inf) if the lag cannot be determined."""
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
    """Compute the speed over ground, m/s, from positions in degrees."""
    north = np.gradient(np.radians(latitude)) * 6371e3 * COMPARISON_RATE
    east = (
        np.gradient(np.unwrap(np.radians(longitude)))
        * 6371e3
        * COMPARISON_RATE
        * np.cos(np.radians(np.nanmean(latitude)))
    )
    return np.hypot(north, east)
