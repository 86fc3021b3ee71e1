"""What the search of a calibration does not find of the slip: the longitudinal stiffness, and how much later one wheel speed is
than the other. Both by one regression.

The search takes wheel speeds as exact inputs, and their noise, lateness and radii for slip: its longitudinal stiffness is 20 % and
more off. While a car accelerates straight on, its free axle says the speed, and the driven one the slip that the force takes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd
from scipy.optimize import least_squares

from tse.impl.core import Config
from tse.impl.identify.fit import Fit
from tse.impl.identify.problem import Problem
from tse.impl.identify.unknowns import LATENCY, prior_of
from tse.impl.rows import Log
from tse.impl.vehicle import FRICTION, GRAVITY, Vehicle, curve_of, ordinary_car

STIFFNESS = "cx_front"
WHEELS = ("wheel_speed_front", "wheel_speed_rear")
# s: of how much later one is than the other before the logs say so: two messages of a bus, every 10 .. 20 ms
APART_SD = 0.006
# ln: of the stiffness by this regression, however long the logs: pitch, rolling radii under load, the curve of the tyre
MODEL_SD = 0.05
# Where the axle that is not driven rolls freely, front and rear wheels go the same way, and tyres are far from their grip.
SLOW, PULLING, STRAIGHT, HARD = 4.0, 0.8, 0.03, 0.5  # m/s, m/s2, rad, 1
SMOOTH, EVERY, BLOCK, FEWEST = 0.3, 0.1, 10.0, 6  # s, s, s, blocks
GIVE = 0.005  # rolling radius that a tyre loses by its static load: src/model/car.c
SPIN = 0.015  # of the mass: two wheels of 1.2 kg m2 with 0.32 m, which the driven axle turns up through the road


def slips(problem: Problem, fit: Fit, logs: Sequence[Log], vehicle: Vehicle) -> Fit:
    """Return the fit with longitudinal stiffness and wheel speeds as far apart in time as the logs show, half of it each.

    Parameters
    ----------
    problem, fit : Problem, Fit
        The search, in which both wheel speeds are equally late. Its longitudinal stiffness is not used.
    logs : sequence of Log
        Those of the calibration.
    vehicle : Vehicle
        Its driven axle, front or rear; of both nothing says how fast the car is, and the stiffness keeps its prior.

    Notes
    -----
    (v_driven - v_free)/v = slip(F) - later a/v + offset, with F by accel_x, drag, rolling resistance and the wheels that turn up,
    and slip(F) by the tyre curve and load transfer of src/model/car.c: a regression over all logs, an offset each. How sure it is
    shows where a block of ten seconds is left out at a time; by that, MODEL_SD and APART_SD it counts beside the prior. 8 ms are
    0.2 % of slip at 8 m/s and 2 m/s2, where tyres take 1.5 %.

    How late both wheel speeds are keeps its prior: what the search makes of it is what its model lacks along the car, pitch and
    rolling radii.
    """
    k = list(problem.names).index(STIFFNESS)
    at = dict(zip(problem.names, map(float, fit.x), strict=True))
    found = _regression(problem.config, at, logs, vehicle)
    mean, var = _beside(found, float(problem.mean[k]), float(problem.sd[k]) ** 2)
    shift = dict.fromkeys(problem.names, 0.0)
    if found is not None:
        apart = found.later * APART_SD**2 / (APART_SD**2 + found.later_sd**2)
        for name, half in zip(WHEELS, (0.5, -0.5), strict=True):
            shift[name + LATENCY] = half * apart
    wheels = [list(problem.names).index(name + LATENCY) for name in WHEELS]
    x, covariance = fit.x.copy(), fit.covariance.copy()
    x[k], x[wheels] = mean, problem.mean[wheels]
    covariance[[k, *wheels], :] = covariance[:, [k, *wheels]] = 0.0
    covariance[k, k], covariance[np.ix_(wheels, wheels)] = var, problem.covariance[np.ix_(wheels, wheels)]
    x += np.array(list(shift.values()))
    return replace(fit, x=x, covariance=covariance)


def longitudinal(config: Config, values: Mapping[Any, float], logs: Sequence[Log], vehicle: Vehicle) -> tuple[float, float]:
    """Return ln of the longitudinal stiffness over the vehicle file's and its sd, as a calibration on these logs has them.

    values: settings that a fit has found; of the others the prior counts."""
    prior = prior_of(vehicle, config)
    at = dict(zip(prior.names, map(float, prior.mean), strict=True))
    found = _regression(config, at | {n: values[n] for n in at if n in values}, logs, vehicle) if logs else None
    mean, var = _beside(found, at[STIFFNESS], float(prior.sd[prior.names.index(STIFFNESS)]) ** 2)
    return mean, float(np.sqrt(var))


def _beside(found: _Found | None, mean: float, var: float) -> tuple[float, float]:
    """Return mean and variance of ln of the stiffness: what logs show beside the prior."""
    if found is None:
        return mean, var
    seen = found.stiffness_sd**2 + MODEL_SD**2
    return (mean * seen + found.stiffness * var) / (seen + var), seen * var / (seen + var)


@dataclass(frozen=True)
class _Found:
    """ln of the stiffness over the vehicle file's, and how much later [s] the front wheel speed is; their sds by blocks."""

    stiffness: float
    stiffness_sd: float
    later: float
    later_sd: float


def _regression(config: Config, at: Mapping[str, float], logs: Sequence[Log], vehicle: Vehicle) -> _Found | None:
    """Return what all logs show together; None: nothing, or two driven axles. at: numbers of the car."""
    moves = {"front": 1.0, "rear": config.rear_longitudinal_follows_front}  # with STIFFNESS
    if moves.get(vehicle.driven_axle, 0.0) != 1.0:
        return None
    car = _Car(config, at, vehicle)
    parts = [_pulls(car, log) for log in logs]
    x = np.vstack([np.column_stack([p[0], np.eye(len(parts))[[n] * len(p[0])]]) for n, p in enumerate(parts)])
    y, weight = (np.concatenate([p[i] for p in parts]) for i in (1, 2))
    block = np.concatenate([1e6 * n + p[3] for n, p in enumerate(parts)])
    blocks = np.unique(block)
    if len(blocks) < FEWEST:
        return None

    def solved(use: np.ndarray) -> tuple[float, float]:
        slopes, values = weight[use, None] * x[use], weight[use] * y[use]
        start = np.linalg.lstsq(slopes, values, rcond=None)[0]
        scale = 3.0 * float(np.median(np.abs(values - slopes @ start))) or 1.0
        found = least_squares(lambda b: slopes @ b - values, start, jac=lambda _: slopes, loss="huber", f_scale=scale)
        return float(found.x[0]), -float(found.x[1])

    over, later = solved(block >= 0)
    without = np.array([solved(block != b) for b in blocks])
    sd = np.sqrt((len(blocks) - 1) / len(blocks) * np.sum((without - without.mean(axis=0)) ** 2, axis=0))
    if not over > 2 * sd[0]:  # soft tyres, or stiff ones that show no slip: not distinguished
        return None
    sign = 1 if car.front_driven else -1
    return _Found(-float(np.log(over)), float(sd[0]) / over, sign * later, float(sd[1]))


class _Car:
    """What of the car the regression needs; forces per mass."""

    def __init__(self, c: Config, at: Mapping[str, float], vehicle: Vehicle):
        ordinary = ordinary_car(c)
        self.grip, shape = curve_of(ordinary, at.get(FRICTION, 0.0), c.tyre_saturation_shape)
        self.front_driven = vehicle.driven_axle == "front"
        self.radius = c.wheel_radius_front, c.wheel_radius_rear
        self.base, self.mass = c.lf + c.lr, c.mass
        self.load = GRAVITY * (c.lr if self.front_driven else c.lf) / self.base
        height = float(vehicle.facts.get("cg_height", ordinary["cg_height"]))
        self.height = height / self.base * (-1 if self.front_driven else 1)
        self.give = GIVE * abs(self.height) * self.base**2 / (GRAVITY * c.lf * c.lr)  # of both axles, per m/s2
        front, rear = (c.longitudinal_stiffness_front, at.get("longitudinal_stiffness_rear", c.longitudinal_stiffness_rear))
        self.stiffness, self.of_free = (front, rear) if self.front_driven else (rear, front)
        self.scale = (1.0 + at.get("imu_scale_ax_error", 0.0)) * (1.0 + GRAVITY * at.get("pitch_leak_gain", 0.0))
        self.drag, self.rolling = at["aero_drag_coefficient"], at["rolling_resistance_coefficient"]
        z = np.linspace(0.0, 1.0, 400)  # of the brush model, up to where it slides
        brush, other = 1.0 - z + z * z / 3.0, (1.0 + 9.0 * z**2 + 81.0 * z**4) ** -0.25
        self.curve = 3.0 * z, 3.0 * z * (brush + shape * (other - brush))

    def slip(self, push: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return slip of the driven axle over the free one at the file's stiffness, and share of the driven one's grip, for what
        pushes the car, per mass [m/s2]."""
        spin, load = SPIN * push, self.load + self.height * push
        share = np.abs(push + spin) / (self.grip * np.maximum(load, 0.1 * self.load))
        linear = np.interp(share, self.curve[1], self.curve[0]) * self.grip * load
        return self.mass * (linear / (self.stiffness * load / self.load) + spin / self.of_free), share


def _pulls(car: _Car, log: Log) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return slip that the force takes and a/v, slip of the driven axle over the free one, weight, and block of each sample of a
    log that counts."""
    count = max(1, round(SMOOTH / log.sample_time))

    def smooth(x: np.ndarray) -> np.ndarray:
        return pd.Series(x).rolling(count, center=True, min_periods=1).mean().to_numpy()

    steer, rate, pull, *spin = (log.data[c].to_numpy(float) for c in ("steer_angle", "yaw_rate", "accel_x", *WHEELS))
    front, rear = car.radius[0] * spin[0], car.radius[1] * spin[1]
    ahead = front - (rear * np.cos(steer) + car.base * rate * np.sin(steer))
    v, slip = smooth(rear if car.front_driven else front), smooth(ahead if car.front_driven else -ahead)
    pull, gains = smooth(pull) / car.scale, smooth(np.gradient(v, log.time))
    push = pull + GRAVITY * car.rolling + car.drag * v**2 / car.mass
    takes, share = car.slip(np.maximum(push, 0.0))
    use = (v > SLOW) & (pull > PULLING) & (np.abs(steer) < STRAIGHT) & (share < HARD) & np.isfinite(slip + push + gains)
    use &= np.arange(len(v)) % max(1, round(EVERY / log.sample_time)) == 0
    # under load the driven axle's rolling radius is another than at rest, and the free one's the other way
    seen = slip / np.maximum(v, 0.1) - np.sign(car.height) * car.give * push
    return (
        np.column_stack([takes, gains / np.maximum(v, 0.1)])[use],
        seen[use],
        np.minimum(v[use], 15.0),
        np.floor(log.time[use] / BLOCK),
    )
