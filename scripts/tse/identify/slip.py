"""Longitudinal stiffness, wheel radii and wheel latencies of a calibration, by one
regression over straight rows.

The search takes wheel speeds as exact inputs: its longitudinal stiffness absorbs their
noise, latency and radii. Along a straight road the free axle measures the speed, the
driven axle the slip, and accel_x the force of that slip. Rows that coast show the slip
without force, which is the mismatch of the radii. Rows that pull show the stiffness.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd

from tse.car.vehicle import FRICTION, GRAVITY, Vehicle, curve_of, ordinary_car
from tse.identify.fit import Fit
from tse.identify.problem import Problem
from tse.identify.unknowns import LATENCY, prior_of
from tse.library.core import Config
from tse.log.noise import estimate_noise
from tse.log.rows import TORQUE_COLUMNS, CheckedLog

STIFFNESS = "cx_front"
WHEELS = ("wheel_speed_front", "wheel_speed_rear")
RADII = ("wheel_radius_front", "wheel_radius_rear")
# s, sd before the logs: latency of one wheel speed behind the other, two messages of a
# bus with cycles of 10 .. 20 ms
APART_SD = 0.006
# 1, sd before the logs: radius of one axle over the other's, relative to the file, by wear
# and pressure. The bias of accel_x is in it
RADIUS_SD = 0.01
LAG_SD = 0.1  # s, sd before the logs: latency of accel_x behind the wheels, less what tyres relax
DRAG_SD = 0.1  # kg/m, sd before the logs: drag
UNKNOWN_SD = 1e3  # 1, sd before the logs: 1/stiffness, over the file's
BEND_SD = 0.25  # 1, sd before the logs: tyre curve and moved load of a car, over those of the model
PRIOR_SD = (UNKNOWN_SD, APART_SD, LAG_SD, DRAG_SD, BEND_SD)  # of the numbers that all logs share
# ln: error of the model of force over slip, however long the logs: pitch, rolling radii
# under load, tyre curve. Ten cars of tests/cars: 0.034 rms, 0.042 of each road alone
MODEL_SD = 0.05
SURE = 3.0  # sd from 0 above which a latency is applied, and above which 1/stiffness has a logarithm
MOST_NOISE = 0.5  # 1: share of noise in the square of the slip by accel_x, above which nothing is shown
MISMATCH = 0.01  # 1: of the radii, from which it is said
SHOWN = 0.7  # posterior over prior sd, below which logs have shown the stiffness
# Rows that are used: tyres far from their grip, no brake, no curve
SLOW, STRAIGHT, ACROSS, HARD = 4.0, 0.03, 1.0, 0.5  # m/s, rad, m/s2, 1
# m/s2: accel_x from which no brake acts, where no brake switch is logged. -0.1 lets brakes
# in, which make a steady drive 14 % too stiff, -0.3 65 %
COASTS = 0.0
BRAKES = 0.5  # 1: of the brake switch, above which brakes act
SMOOTH, EVERY, BLOCK, FEWEST = 0.6, 0.1, 10.0, 6  # s, s, s, blocks
GIVE = 0.005  # 1: rolling radius that a tyre loses by its static load (src/model/car.c)
SPIN = 0.014  # 1: mass of two wheels at their radius over that of the car: 2.4 kg m2, 0.33 m, 1600 kg


def slips(problem: Problem, fit: Fit, logs: Sequence[CheckedLog], vehicle: Vehicle) -> Fit:
    """Return the fit with the longitudinal stiffness of the regression, and what it shows
    of wheel latencies and radii.

    Parameters
    ----------
    problem, fit : Problem, Fit
        The search. Its longitudinal stiffness and its common wheel latency are not used.
    logs : sequence of Log
        Those of the calibration.
    vehicle : Vehicle
        Its driven axle. Of two driven axles only logs with wheel torques and a brake
        switch show anything.

    Returns
    -------
    Fit
        What the logs do not show keeps mean and covariance of the prior.

    Notes
    -----
    v_driven/v_free - 1 = F/C/k + share (slip(F) - F/C + radii(a)) - later a/v
                          + lag d slip(F)/dt + drag v^2 + radius,
    with k the stiffness over the file's. F is by accel_x, drag, rolling resistance and
    the inertia of the wheels that turn up; F/C is the slip of a linear tyre at static
    load. slip(F) is by the tyre curve and the load along the car of src/model/car.c, and
    radii(a) what that load takes of the rolling radii; of both there may be more or less
    (`share`, 1 +- BEND_SD). A radius a log, in which the bias of accel_x is, too.

    Weighted least squares with Huber weights and priors, less what the noise of accel_x
    adds to the square of its slip (errors in variables: Fuller 1987). Residuals are
    correlated: weights count so many samples as blocks of ten seconds say, and the
    covariance is the larger one of both: inverse information, sandwich over blocks (White
    1982). MODEL_SD is added to k.
    """
    names = list(problem.names)
    k = names.index(STIFFNESS)
    at = dict(zip(names, map(float, fit.x), strict=True))
    found = _regression(problem.config, at, logs, vehicle)
    wheels = [names.index(name + LATENCY) for name in WHEELS]
    x, covariance = fit.x.copy(), fit.covariance.copy()
    x[wheels] = problem.mean[wheels]
    covariance[[k, *wheels], :] = covariance[:, [k, *wheels]] = 0.0
    covariance[np.ix_(wheels, wheels)] = problem.covariance[np.ix_(wheels, wheels)]
    x[k], covariance[k, k] = _beside(found, float(problem.mean[k]), float(problem.sd[k]) ** 2)
    if found is not None and abs(found.later) > SURE * found.later_sd:
        x[wheels] += found.later * np.array([0.5, -0.5])
    if found is not None and abs(found.mismatch) >= MISMATCH:
        radii = [names.index(name) for name in RADII]
        x[radii] = _with_mismatch(problem.config, x[radii], found.mismatch)
    return replace(fit, x=x, covariance=covariance)


def longitudinal(
    config: Config, values: Mapping[Any, float], logs: Sequence[CheckedLog], vehicle: Vehicle
) -> tuple[float, float]:
    """Return ln of the longitudinal stiffness over the vehicle file's and its sd, as a
    calibration on these logs has them.

    values: settings that a fit has found. The prior counts for the others."""
    prior = prior_of(vehicle, config)
    at = dict(zip(prior.names, map(float, prior.mean), strict=True))
    at |= {n: values[n] for n in at if n in values}
    found = _regression(config, at, logs, vehicle) if logs else None
    k = prior.names.index(STIFFNESS)
    mean, var = _beside(found, float(prior.mean[k]), float(prior.sd[k]) ** 2)
    return mean, float(np.sqrt(var))


def slip_words(problem: Problem, fit: Fit) -> list[str]:
    """Return in words the findings of slips(): a stiffness that the logs do not show, a
    latency between both wheel speeds, a mismatch of the wheel radii from MISMATCH on."""
    names, found = list(problem.names), []
    k = names.index(STIFFNESS)
    if not fit.covariance[k, k] < (SHOWN * problem.sd[k]) ** 2:
        found.append(
            "longitudinal stiffness: not shown by these logs: it takes straight rows in which the driven axle pulls "
            "and coasts, and of two driven axles wheel torques and brake"
        )
    if (late := _apart(problem, fit)) != 0.0:
        which = "front" if late > 0 else "rear"
        found.append(
            f"wheel speeds: the {which} one is {1000 * abs(late):.1f} ms behind the other, half of it each"
        )
    front, rear = (fit.x[names.index(name)] / getattr(problem.config, name) for name in RADII)
    off = rear / front - 1.0
    if abs(off) >= MISMATCH:
        found.append(
            f"wheel radii: the rear one is {100 * abs(off):.1f} % {'smaller' if off < 0 else 'larger'}, beside the "
            f"front one, than the vehicle file says"
        )
    return found


def slip_bands(problem: Problem, fit: Fit) -> dict[str, str]:
    """Return what a vehicle file says behind the latencies of the wheel speeds, where
    slips() has moved them."""
    text = ", behind each other as these logs show, both together as before"
    return dict.fromkeys((name + LATENCY for name in WHEELS), text) if _apart(problem, fit) != 0.0 else {}


def _apart(problem: Problem, fit: Fit) -> float:
    """Return how much later [s] than before the logs the front wheel speed is, over the
    rear one."""
    front, rear = (list(problem.names).index(name + LATENCY) for name in WHEELS)
    return float(fit.x[front] - problem.mean[front] - fit.x[rear] + problem.mean[rear])


def _with_mismatch(config: Config, radii: np.ndarray, mismatch: float) -> np.ndarray:
    """Return the radii [m] of the search, front and rear, with this mismatch of rear over
    front; their mean stays."""
    front, rear = radii / np.array([getattr(config, name) for name in RADII])
    half = 0.5 * (np.log1p(mismatch) - np.log(rear / front))
    return radii * np.exp([-half, half])


def _beside(found: _Found | None, mean: float, var: float) -> tuple[float, float]:
    """Return mean and variance of ln of the stiffness: the prior, and beside it what the
    logs show."""
    if found is None:
        return mean, var
    seen = found.stiffness_sd**2 + MODEL_SD**2
    return (mean * seen + found.stiffness * var) / (seen + var), seen * var / (seen + var)


@dataclass(frozen=True)
class _Found:
    """What straight rows show, with sds: ln of the stiffness over the vehicle file's,
    latency [s] of the front wheel speed behind the rear one, and by how much [1] the
    ratio of the radii, rear over front, is larger than the file's."""

    stiffness: float
    stiffness_sd: float
    later: float
    later_sd: float
    mismatch: float


def _regression(
    config: Config, at: Mapping[str, float], logs: Sequence[CheckedLog], vehicle: Vehicle
) -> _Found | None:
    """Return what all logs show together; None: nothing. at: numbers of the car."""
    if vehicle.driven_axle != "front" and config.rear_longitudinal_follows_front != 1.0:
        return None
    car = _Car(config, at, vehicle)
    parts = [p for log in logs if (p := _samples(car, log)) is not None]
    if sum(len(np.unique(p.block)) for p in parts) < FEWEST:
        return None
    b, b_sd = _solve(parts, np.array([*PRIOR_SD, *[RADIUS_SD] * len(parts)]))
    if not b[0] > SURE * b_sd[0]:  # soft tyres and stiff ones, which show no slip, are not distinguished
        return None
    sign = 1.0 if car.driven == "front" else -1.0
    weights = [len(p.slip) for p in parts]
    slip = float(np.average(b[len(PRIOR_SD) :], weights=weights))
    # a driven axle that turns faster than it drives is smaller than the file says
    mismatch = (1.0 + slip) ** sign - 1.0
    stiffness = float(np.log1p(slip) - np.log(b[0]))
    return _Found(stiffness, float(b_sd[0] / b[0]), -sign * float(b[1]), float(b_sd[1]), mismatch)


def _solve(parts: Sequence[_Samples], prior_sd: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the solution and its sds: numbers of all logs, and one of each log. Their
    priors have mean 0."""
    count, prior = len(parts), np.diag(prior_sd**-2.0)
    x = np.vstack([np.column_stack([p.x, np.eye(count)[[n] * len(p.slip)]]) for n, p in enumerate(parts)])
    y, weight, noise = (
        np.concatenate([getattr(p, name) for p in parts]) for name in ("slip", "weight", "noise")
    )
    _, block = np.unique(
        np.concatenate([1e6 * n + p.block for n, p in enumerate(parts)]), return_inverse=True
    )
    b = np.linalg.lstsq(x * weight[:, None], y * weight, rcond=None)[0]
    information, score, noisy = np.eye(len(b)), np.zeros((0, len(b))), 0.0
    for _ in range(8):
        error = y - x @ b
        size = np.abs(error) * weight
        w = weight**2 * np.minimum(1.0, 1.345 * 1.4826 * np.median(size) / np.maximum(size, 1e-12))
        total = float(np.sum(w * error**2)) or 1e-30
        # samples that are one
        lasts = max(1.0, float(np.sum(np.bincount(block, np.sqrt(w) * error) ** 2)) / total)
        w = w * len(y) / (total * lasts)
        information = (x * w[:, None]).T @ x + prior
        noisy = float(w @ noise) * np.linalg.inv(information)[0, 0]
        information[0, 0] -= w @ noise  # what noise of accel_x adds to the square of its slip
        b = np.linalg.solve(information, (x * w[:, None]).T @ y)
        error = w * (y - x @ b)
        score = np.column_stack([np.bincount(block, error * column) for column in x.T])
        score[:, 0] += np.bincount(block, w * noise) * b[0]
    inverse = np.linalg.inv(information)
    sandwich = inverse @ (score.T @ score + prior) @ inverse
    sd = np.sqrt(np.maximum(np.diag(inverse), np.diag(sandwich)))
    if noisy > MOST_NOISE:
        sd[0] = np.inf
    return b, sd


class _Car:
    """What of the car the regression needs; forces per mass."""

    def __init__(self, c: Config, at: Mapping[str, float], vehicle: Vehicle):
        ordinary = ordinary_car(c)
        self.grip, shape = curve_of(ordinary, at.get(FRICTION, 0.0), c.tyre_saturation_shape)
        self.driven = vehicle.driven_axle
        self.radius = c.wheel_radius_front, c.wheel_radius_rear
        self.base, self.mass = c.lf + c.lr, c.mass
        self.load = GRAVITY * c.lr / self.base, GRAVITY * c.lf / self.base  # m/s2: front, rear
        self.height = float(vehicle.facts.get("cg_height", ordinary["cg_height"])) / self.base
        self.give = GIVE * self.height * self.base**2 / (GRAVITY * c.lf * c.lr)  # of both axles, per m/s2
        self.stiffness = (
            c.longitudinal_stiffness_front,
            at.get("longitudinal_stiffness_rear", c.longitudinal_stiffness_rear),
        )
        self.scale = (1.0 + at.get("imu_scale_ax_error", 0.0)) * (
            1.0 + GRAVITY * at.get("pitch_leak_gain", 0.0)
        )
        self.drag, self.rolling = at["aero_drag_coefficient"], at["rolling_resistance_coefficient"]
        z = np.linspace(0.0, 1.0, 400)  # of the brush model, up to where it slides
        brush, other = 1.0 - z + z * z / 3.0, (1.0 + 9.0 * z**2 + 81.0 * z**4) ** -0.25
        self.curve = 3.0 * z, 3.0 * z * (brush + shape * (other - brush))

    def slip(
        self, axle: int, force: np.ndarray, push: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return slip of an axle at the file's stiffness, what of it is no linear tyre at
        static load, and share of its grip.

        force, push: of the axle and of the car, per mass [m/s2]"""
        load = np.maximum(
            self.load[axle] + (self.height if axle else -self.height) * push, 0.1 * self.load[axle]
        )
        share = np.abs(force) / (self.grip * load)
        linear = np.interp(share, self.curve[1], self.curve[0]) * self.grip * load * np.sign(force)
        slip = self.mass * linear / (self.stiffness[axle] * load / self.load[axle])
        return slip, slip - self.mass * force / self.stiffness[axle], share


@dataclass(frozen=True)
class _Samples:
    """Samples of a log that count: what slip goes with, slip of the driven axle over the
    free one, weight, block."""

    # slip that the force takes at the file's stiffness, a/v, rate of that slip, slip of 1
    # kg/m, the part of that slip that is not linear
    x: np.ndarray
    noise: np.ndarray  # variance of the first of them, by the noise of accel_x
    slip: np.ndarray
    weight: np.ndarray
    block: np.ndarray


def _samples(car: _Car, log: CheckedLog) -> _Samples | None:
    """Return the straight rows of a log without brakes; None: no row says which axle
    pulls how much.

    Slip is of the front axle over the rear one, unless the rear axle is driven."""
    brake, torque = log.extra.get("brake"), [log.extra.get(name) for name in TORQUE_COLUMNS]
    if car.driven == "both" and (brake is None or any(t is None for t in torque)):
        return None
    count = max(1, round(SMOOTH / (log.sample_time or 0.01)))

    def smooth(x: np.ndarray) -> np.ndarray:
        return pd.Series(x).rolling(count, center=True, min_periods=1).mean().to_numpy()

    steer, rate, pull, *spin = (
        log.data[c].to_numpy(float) for c in ("steer_angle", "yaw_rate", "accel_x", *WHEELS)
    )
    rate = np.nan_to_num(rate)  # without a gyro the steering angle alone selects straight rows
    front, rear = car.radius[0] * spin[0], car.radius[1] * spin[1]
    rear_ahead = rear * np.cos(steer) + car.base * rate * np.sin(steer)  # along the front wheels
    first = 1 if car.driven == "rear" else 0  # the axle whose slip it is
    v = smooth(front if first else rear)
    slip = smooth(rear_ahead - front if first else front - rear_ahead) / np.maximum(v, 0.1)
    pull, gains = smooth(pull) / car.scale, smooth(np.gradient(v, log.time))
    push = pull + GRAVITY * car.rolling + car.drag * v**2 / car.mass
    turns = SPIN * gains  # force that turns the wheels of an axle up
    if car.driven == "both":
        pulls = [t.to_numpy(float) / (r * car.mass) for t, r in zip(torque, car.radius, strict=True)]
        apart = smooth(pulls[0] - pulls[1])
        forces = 0.5 * (push + apart), 0.5 * (push - apart)
    else:
        forces = push + turns, -turns
    own, other = (car.slip(axle, f, push) for axle, f in zip((first, 1 - first), forces, strict=True))
    takes, bend, share = own[0] - other[0], own[1] - other[1], own[2]
    switch = np.zeros(len(v)) if brake is None else np.where(brake.to_numpy(float) < BRAKES, 0.0, 1.0)
    brakes = smooth(switch) > 0 if switch.any() else pull < COASTS
    use = (
        (v > SLOW)
        & (np.abs(steer) < STRAIGHT)
        & (np.abs(v * smooth(rate)) < ACROSS)
        & (share < HARD)
        & ~brakes
    )
    later, lag = gains / np.maximum(v, 0.1), np.gradient(takes, log.time)
    drag = v**2 / car.stiffness[first]
    # load that goes to the rear gives rolling radius in front, where wheels then turn
    # slower, and takes it at the rear
    radii = (1 if first else -1) * car.give * push
    seen = slip - radii
    use &= np.isfinite(seen + takes + lag)
    use &= np.arange(len(v)) % max(1, round(EVERY / (log.sample_time or 0.01))) == 0
    if not use.any():
        return None
    columns = np.column_stack([takes, later, lag, drag, bend + radii])[use]
    white = estimate_noise(log, "accel_x", v > SLOW)
    of_mean = white.unraised**2 / count if white is not None else 0.0
    noise = np.full(len(columns), of_mean * (car.mass / (car.scale * car.stiffness[first])) ** 2)
    return _Samples(columns, noise, seen[use], np.minimum(v[use], 15.0), np.floor(log.time[use] / BLOCK))
