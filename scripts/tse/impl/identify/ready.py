"""What is made of a log before it is compared with a simulation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.ndimage import gaussian_filter1d

from tse.impl.core import Config
from tse.impl.identify.data import BLOCK, SLOWEST, Prepared, speed
from tse.impl.identify.unknowns import MOST_LATENCY
from tse.impl.noise import filled

CALM = 0.15  # s: sd of the smoothing: wheels and body pitch at 1 to 2 Hz on uneven roads, a driver brakes below that
CURVE_LENGTH = 12.0  # m: sd of the smoothing: over which a road goes from level to leaning into its curve


def calm(log: Prepared) -> Prepared:
    """The log with wheel speeds and accel_x smoothed alike, which leaves what is between them as it was. An uneven road moves the
    wheels without the body; what the simulation makes of that would count as error of the car."""
    rows = CALM / log.step
    wheels = {n: gaussian_filter1d(x, rows) if n.startswith("wheel") else x for n, x in log.inputs.items()}
    along = log.measured["accel_x"]
    there = np.isfinite(along)
    weight = gaussian_filter1d(there.astype(float), rows)
    value = gaussian_filter1d(np.where(there, along, 0.0), rows) / np.maximum(weight, 1e-9)
    return replace(log, inputs=wheels, measured=log.measured | {"accel_x": np.where(there, value, np.nan)})


def curves(log: Prepared, config: Config) -> np.ndarray:
    """m/s2, square of the speed times the curvature of the road: what its lean into its curves goes by. The curvature is that of
    the car's path without what is shorter than roads are built in."""
    rate, v = log.measured["yaw_rate"], np.maximum(speed(log.inputs, config), SLOWEST)
    if not np.isfinite(rate).any():
        return np.zeros(len(rate))
    metres = np.arange(0.0, log.distance[-1] + 1.0)
    curvature = np.interp(metres, log.distance, filled(rate) / v)
    return v**2 * np.interp(log.distance, metres, gaussian_filter1d(curvature, CURVE_LENGTH))


def inside(log: Prepared) -> np.ndarray:
    """1 for rows whose channels are in the same stretch whatever their latency; at its start BURN_IN sees to that."""
    found = np.zeros(len(log.time))
    for s in log.stretches:
        found[s.first : s.last] = log.time[s.first : s.last] <= log.time[s.last - 1] - MOST_LATENCY
    return found


def together(time: np.ndarray, used: np.ndarray, count: int) -> np.ndarray:
    """Used blocks that are compared as one: their indices, a row each of `count` without a hole; what is left over is left out."""
    index = np.flatnonzero(used)
    runs = np.split(index, np.flatnonzero((np.diff(index) > 1) | (np.diff(time[index]) > 1.5 * BLOCK)) + 1)
    return np.concatenate([r[: len(r) // count * count].reshape(-1, count) for r in runs])
