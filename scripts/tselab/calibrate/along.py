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
WHEELS = ("wheel_speed_front_latency", "wheel_speed_rear_latency")
APART_SD = 0.002  # s: messages of a bus come and go between two drives


def refined(result: Result, logs: Sequence[Log]) -> Result:
    """Return the result with what the filter finds of the slip in place of the search's: the longitudinal stiffness, and how much
    later the front wheel speed is than the rear's.

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
        ends = [end for log in logs if (end := _end(draft, log))]
    stiffness, lag = (_joined([end[n] for end in ends]) for n in range(2))
    if stiffness:
        start = _with(start, k, start.fit.x[k] + stiffness[0], stiffness[1])
    return _apart(start, *lag) if lag else start


def _joined(ends: list[tuple[float, float, float]]) -> tuple[float, float] | None:
    """Return mean and sd of all logs, of (mean, sd, sd of the prior) of each; None where no log says something."""
    fits = [(m, s, p) for m, s, p in ends if abs(m) < 1.96 * max(p**2 - s**2, 0.0) ** 0.5]
    if not fits:
        return None
    mean, sd, first = np.array(fits).T
    prior = 1.0 / first[0] ** 2
    information = np.maximum(1.0 / sd**2, prior)
    whole = prior + float(np.sum(information - prior))
    return float(information @ mean) / whole, max(whole**-0.5, float(sd.min()))


def _with(result: Result, k: int, mean: float, sd: float) -> Result:
    """Return the result with another mean and sd of one unknown, the others as they are."""
    x, covariance = result.fit.x.copy(), result.fit.covariance.copy()
    x[k] = mean
    covariance[k, :] = covariance[:, k] = 0.0
    covariance[k, k] = sd**2
    return replace(result, fit=replace(result.fit, x=x, covariance=covariance))


def _apart(result: Result, mean: float, sd: float) -> Result:
    """Return the result with the wheel speeds this much further apart, half of it each, and as uncertain."""
    shift = dict(zip(WHEELS, (0.5 * mean, -0.5 * mean), strict=True))
    x = result.fit.x + np.array([shift.get(name, 0.0) for name in result.problem.names])
    findings = [replace(f, value=f.value + shift[f.name]) if f.name in shift else f for f in result.findings]
    return replace(result, findings=findings, fit=replace(result.fit, x=x), wheels_apart_sd=max(sd, APART_SD))


def _end(vehicle: Path, log: Log) -> tuple[tuple[float, float, float], ...]:
    """Return (mean, sd, sd of the prior) at the end of a log, of the logarithm of the longitudinal stiffness over the file's, and
    of how much later the front wheel speed is; nothing where the filter refuses the log, or the file with this log."""
    try:
        config, _ = make_config(read_vehicle(vehicle), log)
    except UserError:
        return ()
    out = outputs(config, log)
    used = out[out["status"] >= 0]
    if not len(used):
        return ()
    mean, sd = float(used[STIFFNESS][-1]), float(used[f"{STIFFNESS}_sd"][-1])
    lag, lag_sd = float(used["lag_wheels"][-1]), float(used["lag_wheels_sd"][-1])
    return (float(np.log(mean)), sd / mean, config.initial_cx_sd), (lag, lag_sd, config.wheel_delay_apart_sd)


def outputs(config: Config, log: Log) -> np.ndarray:
    """Return what the filter makes of a log, a row each."""
    filter_ = Filter(config)
    rows, given = filter_.inputs(len(log)), log.rows()
    for column in rows.dtype.names:
        rows[column] = given[column]
    out = filter_.outputs(len(rows))
    filter_.step_into(rows, out)
    return out
