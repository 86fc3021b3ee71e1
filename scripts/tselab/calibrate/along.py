"""What the search of a calibration does not find of the slip: how much later one wheel speed is than the other, by regression, and
the longitudinal stiffness, as the car's filter finds it on the same logs.

The search takes wheel speeds as exact inputs, and their noise, lateness and radii for slip: its longitudinal stiffness is 20 % and
more off (scripts/results/cars-fresh.md). To the filter wheel speeds are measurements, and the free axle says the speed.
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.optimize import least_squares

from tselab.calibrate import output
from tselab.calibrate.result import Result
from tselab.config import make_config
from tselab.core import Config, Filter
from tselab.errors import UserError
from tselab.identify.fit import Fit
from tselab.identify.problem import Problem
from tselab.identify.unknowns import LATENCY
from tselab.log import Log
from tselab.vehicle import GRAVITY, read_vehicle

STIFFNESS = "cx_front"
WHEELS = ("wheel_speed_front", "wheel_speed_rear")
APART_SD = (
    0.006  # s: of how much later one is than the other before the logs say so: two messages of a bus, every 10 .. 20 ms
)
# Where the axle that is not driven rolls freely, and front and rear wheels go the same way.
SLOW, PULLING, STRAIGHT = 4.0, 0.8, 0.03  # m/s, m/s2, rad
SMOOTH, EVERY, BLOCK, FEWEST = 0.3, 0.1, 10.0, 6  # s, s, s, blocks


def refined(result: Result, logs: Sequence[Log]) -> Result:
    """Return the result with the longitudinal stiffness of the filter in place of that of the search.

    Parameters
    ----------
    result : Result
        Of the search.
    logs : sequence of Log
        Those of the calibration; the filter runs over each.

    Notes
    -----
    Each log starts from the same prior, which counts once: with information 1/P0 of the prior and 1/P of the end of a log,
    1/P0 + sum(1/P - 1/P0) is that of all logs. Its sd is never below that of the best log, in which is the error of the model, and
    that of the prior where the logs show nothing: two driven axles. A filter moves from a right prior by less than 1.96
    sqrt(P0 - P) in 19 logs of 20; a log on which it moves further says that the model is wrong, and nothing of the stiffness.
    """
    k = result.problem.names.index(STIFFNESS)
    start = _with(result, k, float(result.problem.mean[k]), float(result.problem.sd[k]))
    with tempfile.TemporaryDirectory() as folder:
        draft = Path(folder) / "car.toml"
        output.write(draft, start, [])
        ends = np.array([_end(draft, log) for log in logs])
    mean, sd, first = ends[np.isfinite(ends).all(axis=1)].T
    fits = np.abs(mean) < 1.96 * np.sqrt(np.maximum(first**2 - sd**2, 0.0))
    if not fits.any():
        return start
    mean, sd, prior = mean[fits], sd[fits], 1.0 / first[0] ** 2
    information = np.maximum(1.0 / sd**2, prior)
    whole = prior + float(np.sum(information - prior))
    return _with(result, k, start.fit.x[k] + float(information @ mean) / whole, max(whole**-0.5, float(sd.min())))


def wheels_apart(problem: Problem, fit: Fit, logs: Sequence[Log], driven: str) -> Fit:
    """Return the fit with wheel speeds as far apart in time as the logs show, half of it each.

    Parameters
    ----------
    problem, fit : Problem, Fit
        The search, in which both wheel speeds are equally late.
    logs : sequence of Log
        Those of the calibration.
    driven : str
        Axle: front or rear; of both nothing says how fast the car is.

    Notes
    -----
    While a car accelerates straight on and its other axle rolls freely, (v_driven - v_free)/v = F/C - later a/v + offset, with F by
    accel_x, drag and rolling resistance: a regression over all logs, an offset each. How sure it is shows where a block of ten
    seconds is left out at a time; by that and APART_SD it counts. 8 ms are 0.2 % of slip at 8 m/s and 2 m/s2, where tyres take
    1.5 %.
    """
    if driven not in ("front", "rear"):
        return fit
    at = dict(zip(problem.names, map(float, fit.x), strict=True))
    parts = [_pulls(problem.config, at, log, driven == "front") for log in logs]
    x = np.vstack([np.column_stack([p[0], np.eye(len(parts))[[n] * len(p[0])]]) for n, p in enumerate(parts)])
    y, weight = (np.concatenate([p[i] for p in parts]) for i in (1, 2))
    block = np.concatenate([1e6 * n + p[3] for n, p in enumerate(parts)])
    blocks = np.unique(block)
    if len(blocks) < FEWEST:
        return fit

    def later(use: np.ndarray) -> float:
        slopes, values = weight[use, None] * x[use], weight[use] * y[use]
        start = np.linalg.lstsq(slopes, values, rcond=None)[0]
        scale = 3.0 * float(np.median(np.abs(values - slopes @ start))) or 1.0
        found = least_squares(lambda b: slopes @ b - values, start, jac=lambda _: slopes, loss="huber", f_scale=scale)
        return -float(found.x[1])

    without = np.array([later(block != b) for b in blocks])
    var = (len(blocks) - 1) / len(blocks) * float(np.sum((without - without.mean()) ** 2))
    apart = later(block >= 0) * APART_SD**2 / (APART_SD**2 + var) * (1 if driven == "front" else -1)
    shift = dict(zip((name + LATENCY for name in WHEELS), (0.5 * apart, -0.5 * apart), strict=True))
    return replace(fit, x=fit.x + np.array([shift.get(name, 0.0) for name in problem.names]))


def _pulls(
    config: Config, at: dict[str, float], log: Log, front_driven: bool
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return F and a/v, slip of the driven axle over the free one, weight, and block of each sample of a log that counts."""
    count = max(1, round(SMOOTH / log.sample_time))

    def smooth(x: np.ndarray) -> np.ndarray:
        return pd.Series(x).rolling(count, center=True, min_periods=1).mean().to_numpy()

    steer, rate, pull, *spin = (log.data[c].to_numpy(float) for c in ("steer_angle", "yaw_rate", "accel_x", *WHEELS))
    front, rear = config.wheel_radius_front * spin[0], config.wheel_radius_rear * spin[1]
    ahead = front - (rear * np.cos(steer) + (config.lf + config.lr) * rate * np.sin(steer))
    v, slip, pull = smooth(rear if front_driven else front), smooth(ahead if front_driven else -ahead), smooth(pull)
    gains = smooth(np.gradient(v, log.time))
    force = config.mass * (pull + GRAVITY * at["rolling_resistance_coefficient"]) + at["aero_drag_coefficient"] * v**2
    use = (v > SLOW) & (pull > PULLING) & (np.abs(steer) < STRAIGHT) & np.isfinite(slip + force + gains)
    use &= np.arange(len(v)) % max(1, round(EVERY / log.sample_time)) == 0
    slopes = np.column_stack([1e-5 * force[use], gains[use] / v[use]])
    return slopes, slip[use] / v[use], np.minimum(v[use], 15.0), np.floor(log.time[use] / BLOCK)


def _with(result: Result, k: int, mean: float, sd: float) -> Result:
    """Return the result with another mean and sd of one unknown, the others as they are."""
    x, covariance = result.fit.x.copy(), result.fit.covariance.copy()
    x[k] = mean
    covariance[k, :] = covariance[:, k] = 0.0
    covariance[k, k] = sd**2
    return replace(result, fit=replace(result.fit, x=x, covariance=covariance))


def _end(vehicle: Path, log: Log) -> tuple[float, float, float]:
    """Return logarithm of the longitudinal stiffness over the file's at the end of a log, its sd, and the sd of the start; NaN
    where the filter refuses the log, or the file with this log."""
    try:
        config, _ = make_config(read_vehicle(vehicle), log)
    except UserError:
        return np.nan, np.nan, np.nan
    out = outputs(config, log)
    used = out[out["status"] >= 0]
    if not len(used):
        return np.nan, np.nan, np.nan
    mean, sd = float(used[STIFFNESS][-1]), float(used[f"{STIFFNESS}_sd"][-1])
    return float(np.log(mean)), sd / mean, config.initial_cx_sd


def outputs(config: Config, log: Log) -> np.ndarray:
    """Return what the filter makes of a log, a row each."""
    filter_ = Filter(config)
    rows, given = filter_.inputs(len(log)), log.rows()
    for column in rows.dtype.names:
        rows[column] = given[column]
    out = filter_.outputs(len(rows))
    filter_.step_into(rows, out)
    return out
