"""The longitudinal stiffness of a calibrated car, as the car's filter finds it on the same logs.

The search takes wheel speeds as exact inputs, and their noise, lateness and radii for slip: its longitudinal stiffness is 20 % and
more off (scripts/results/cars-fresh.md). To the filter wheel speeds are measurements, and the free axle says the speed.
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from tselab.calibrate import output
from tselab.calibrate.result import Result
from tselab.config import make_config
from tselab.core import Config, Filter
from tselab.errors import UserError
from tselab.log import Log
from tselab.vehicle import read_vehicle

STIFFNESS = "cx_front"


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
