"""Estimate longitudinal stiffness, wheel radii and wheel latencies on straight rows.

The search of fit.py treats wheel speeds as exact inputs. In fact, wheel speeds have
noise, and their latencies and the wheel radii are not known exactly. These errors bias
the longitudinal stiffness that the search finds. A regression on rows of straight driving
is better suited: the free axle measures the speed of the car, the driven axle is faster
by the slip, and accel_x is proportional to the force that causes the slip. Rows without
drive force determine the ratio of the wheel radii, rows with drive force the stiffness.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd

from tse.car.vehicle import FRICTION, GRAVITY, Vehicle, choose_curve, get_ordinary_car
from tse.identify.fit import CarFit
from tse.identify.problem import WHEEL_CHANNELS, CarProblem
from tse.identify.unknowns import LATENCY_SUFFIX, MAX_SHOWN_RATIO, SIGNIFICANT_SD, make_prior
from tse.library.core import Config
from tse.log.noise import estimate_noise
from tse.log.rows import TORQUE_COLUMNS, CheckedLog

LONGITUDINAL_KEY = "cx_front"
RADIUS_SETTINGS = ("wheel_radius_front", "wheel_radius_rear")

# Prior sds of the unknowns of the regression.
# [s] sd of: latency of the front wheel speed - latency of the rear wheel speed. If they
# come in two CAN messages of the cycle time T = 10 .. 20 ms, each latency has the sd
# T/sqrt(12) (uniform), and their difference an sd of 4 .. 8 ms
WHEEL_LATENCY_SD = 0.006
# sd of the relative error of the ratio of front to rear wheel radius in the vehicle file.
# In the regression, this error is a constant offset of the slip. A bias of accel_x causes
# such an offset, too. So the sd covers three causes: tyre wear, tyre pressure, and bias
RADIUS_RATIO_SD = 0.01
LAG_SD = 0.1  # [s] sd of: latency of accel_x behind the wheels + relaxation time of the tyres
DRAG_SD = 0.1  # [kg/m] sd of: true coefficient of the air drag - coefficient found by the search
INVERSE_STIFFNESS_SD = 1e3  # sd of: stiffness in the vehicle file / true stiffness; practically no prior
BEND_SD = 0.25  # sd of `bend`, the relative error of tyre curve and load transfer (apply_slip_regression())
# prior sds of the unknowns common to all logs, in the order of the columns of _Samples.x
PRIOR_SD = (INVERSE_STIFFNESS_SD, WHEEL_LATENCY_SD, LAG_SD, DRAG_SD, BEND_SD)

# sd of ln(stiffness) caused by model errors (pitch, rolling radius under load, tyre
# curve), which longer logs do not reduce. Ten cars of tests/cars had an rms error of
# ln(stiffness) of 0.034 with the logs of all roads of a car, and of 0.042 with the logs
# of one road. The constant is above both
SLIP_MODEL_SD = 0.05
# The coefficient of slip(F), the slip computed from accel_x, is 1/k (k: stiffness). If
# noise of accel_x causes more than this share of the variance of slip(F) that the other
# regressors do not explain, the logs do not determine k
MAX_NOISE_SHARE = 0.5
MIN_MISMATCH = 0.01  # relative error of the ratio of the radii; a smaller one is ignored

# Rows that are used: tyres far from their grip, brakes off, road straight.
MIN_REGRESSION_SPEED = 4.0  # [m/s]
MAX_STRAIGHT_STEER = 0.03  # [rad]
MAX_STRAIGHT_ACCEL = 1.0  # [m/s2] lateral acceleration
MAX_GRIP_SHARE = 0.5  # ratio of the force of the driven axle to its grip, the largest possible force
# [m/s2] If the log has no brake switch, or one that is never on, rows with accel_x below
# this limit are not used, because the brakes may be on. In a log of steady driving, the
# estimated stiffness would be 14 % too large with a limit of -0.1, and 65 % with -0.3
MIN_COAST_ACCEL = 0.0
BRAKE_THRESHOLD = 0.5  # value of the brake switch from which on the brakes are on

SMOOTH_TIME = 0.6  # [s] window of the moving mean of the channels
SAMPLE_PERIOD = 0.1  # [s] time between rows that are used
REGRESSION_BLOCK = 10.0  # [s] residuals of different blocks are taken as independent
MIN_REGRESSION_BLOCKS = 6
TYRE_COMPRESSION = 0.005  # share by which the static load reduces the rolling radius (src/model/car.c)
# inertia/radius^2 of the two wheels of an axle, relative to the mass of the car. Example:
# two wheels of 1.2 kg m2 each, radius 0.33 m, car of 1600 kg
WHEEL_MASS_SHARE = 0.014


def apply_slip_regression(
    problem: CarProblem, fit: CarFit, logs: Sequence[CheckedLog], vehicle: Vehicle
) -> CarFit:
    """Return the fit, with results of the regression in place of some unknowns.

    The replaced unknowns are longitudinal stiffness, wheel latencies and wheel radii.

    Parameters
    ----------
    problem, fit : CarProblem, CarFit
        The search and its result.
    logs : sequence of CheckedLog
        Logs of the calibration.
    vehicle : Vehicle
        States which axle is driven. If both are driven, only logs with wheel torques and
        a brake switch are used.

    Returns
    -------
    CarFit
        Unknowns of the regression that the logs do not determine have mean and covariance
        of the prior.

    Notes
    -----
    The regression is
        v_driven/v_free - 1 = slip(F)/k + radii(F) + bend (slip(F) - F/C + radii(F))
                              - later a/v + lag d slip(F)/dt + drag v^2/C + radius.

    Known quantities:
        v_driven, v_free  [m/s] wheel speeds times the wheel radii of the vehicle file
        v, a      speed of the car, and its time derivative
        F         drive force, from accel_x, drag, rolling resistance and wheel inertia
        C         longitudinal stiffness in the vehicle file
        slip(F)   slip of the driven minus that of the free axle, by the tyre curve and
                  the load transfer of src/model/car.c. F/C: linear tyres at static load
        radii(F)  relative change of v_driven/v_free by load transfer, which changes the
                  rolling radii
    Unknowns:
        k         true stiffness / C
        bend      common relative error of slip(F) - F/C and of radii(F): tyre curve and
                  load transfer may be wrong
        later     [s] latency of the driven wheel speed - that of the free wheel speed
        lag       [s] latency of accel_x - that of the wheel speeds + relaxation time of
                  the tyres
        drag      [kg/m] true coefficient of the air drag - fitted coefficient
        radius    relative change of v_driven/v_free by wrong wheel radii in the vehicle
                  file and by the bias of accel_x. Each log has its own radius, because
                  the bias differs from log to log

    Method: weighted least squares with Huber weights and priors. Noise of accel_x in
    slip(F) would make its coefficient 1/k too small. So the variance of this noise is
    subtracted from the square of each sample of slip(F) in the information matrix (errors
    in variables, Fuller 1987). Residuals are correlated within blocks of 10 s, so all
    weights are divided by the number of samples that count as one. The sd of an unknown
    is the larger of two: from the inverse information matrix, and from the sandwich
    estimator over blocks (White 1982). SLIP_MODEL_SD^2 is added to the variance of ln k.
    """
    names = list(problem.names)
    k = names.index(LONGITUDINAL_KEY)
    at = dict(zip(names, map(float, fit.x), strict=True))
    found = _run_regression(problem.config, at, logs, vehicle)
    wheels = [names.index(name + LATENCY_SUFFIX) for name in WHEEL_CHANNELS]
    x, covariance = fit.x.copy(), fit.covariance.copy()
    x[wheels] = problem.mean[wheels]
    covariance[[k, *wheels], :] = covariance[:, [k, *wheels]] = 0.0
    covariance[np.ix_(wheels, wheels)] = problem.covariance[np.ix_(wheels, wheels)]
    x[k], covariance[k, k] = _combine_with_prior(found, float(problem.mean[k]), float(problem.sd[k]) ** 2)
    if found is not None and abs(found.later) > SIGNIFICANT_SD * found.later_sd:
        x[wheels] += found.later * np.array([0.5, -0.5])
    if found is not None and abs(found.mismatch) >= MIN_MISMATCH:
        radii = [names.index(name) for name in RADIUS_SETTINGS]
        x[radii] = _apply_mismatch(problem.config, x[radii], found.mismatch)
    return replace(fit, x=x, covariance=covariance)


def estimate_longitudinal(
    config: Config, values: Mapping[Any, float], logs: Sequence[CheckedLog], vehicle: Vehicle
) -> tuple[float, float]:
    """Return mean and sd of ln(longitudinal stiffness / its value in the vehicle file).

    The regression updates the prior. If the regression is not possible with these logs,
    return mean and sd of the prior.

    Parameters
    ----------
    config
        Settings of the vehicle file.
    values
        Estimates of a fit, by name of the setting. For a setting that is missing, the
        prior mean is used.
    logs, vehicle
        As in apply_slip_regression().
    """
    prior = make_prior(vehicle, config)
    at = dict(zip(prior.names, map(float, prior.mean), strict=True))
    at |= {n: values[n] for n in at if n in values}
    found = _run_regression(config, at, logs, vehicle) if logs else None
    k = prior.names.index(LONGITUDINAL_KEY)
    mean, var = _combine_with_prior(found, float(prior.mean[k]), float(prior.sd[k]) ** 2)
    return mean, float(np.sqrt(var))


def describe_slip(problem: CarProblem, fit: CarFit) -> list[str]:
    """Return the findings of the regression, one string each.

    Possible findings: the logs do not determine the stiffness; the wheel speeds of both
    axles differ in latency; the ratio of the wheel radii is wrong by at least
    MIN_MISMATCH.
    """
    names, found = list(problem.names), []
    k = names.index(LONGITUDINAL_KEY)
    if not fit.covariance[k, k] < (MAX_SHOWN_RATIO * problem.sd[k]) ** 2:
        found.append(
            "longitudinal stiffness: not shown by these logs; needed: straight rows with and without drive "
            "force and, if both axles are driven, the columns of wheel torques and brake"
        )
    if (late := _compute_wheel_delay(problem, fit)) != 0.0:
        which = "front" if late > 0 else "rear"
        found.append(
            f"wheel speeds: the {which} axle is {1000 * abs(late):.1f} ms later than the other axle; the "
            "latency of each axle is corrected by half of this difference"
        )
    front, rear = (fit.x[names.index(name)] / getattr(problem.config, name) for name in RADIUS_SETTINGS)
    off = rear / front - 1.0
    if abs(off) >= MIN_MISMATCH:
        size = "smaller" if off < 0 else "larger"
        found.append(
            f"wheel radii: the ratio rear / front is {100 * abs(off):.1f} % {size} than in the vehicle file; "
            "both radii are corrected"
        )
    return found


def describe_wheel_latencies(problem: CarProblem, fit: CarFit) -> dict[str, str]:
    """Return comments for the vehicle file, by name of the latency.

    If the regression has not changed the wheel latencies, the result is empty.
    """
    if _compute_wheel_delay(problem, fit) == 0.0:
        return {}
    text = ", difference between the axles estimated from these logs, mean of both axles unchanged"
    return dict.fromkeys((name + LATENCY_SUFFIX for name in WHEEL_CHANNELS), text)


def _compute_wheel_delay(problem: CarProblem, fit: CarFit) -> float:
    """Return latency of the front minus latency of the rear wheel speed [s], minus the
    prior mean of this difference.
    """
    front, rear = (list(problem.names).index(name + LATENCY_SUFFIX) for name in WHEEL_CHANNELS)
    return float(fit.x[front] - problem.mean[front] - fit.x[rear] + problem.mean[rear])


def _apply_mismatch(config: Config, radii: np.ndarray, mismatch: float) -> np.ndarray:
    """Return both radii [m], changed so that rear / front has the ratio that was found.

    That ratio is (1 + `mismatch`) times the ratio in the vehicle file. The product of
    both radii does not change.
    """
    front, rear = radii / np.array([getattr(config, name) for name in RADIUS_SETTINGS])
    half = 0.5 * (np.log1p(mismatch) - np.log(rear / front))
    return radii * np.exp([-half, half])


def _combine_with_prior(found: _SlipFinding | None, mean: float, var: float) -> tuple[float, float]:
    """Return mean and variance of ln(stiffness): the prior updated by the regression."""
    if found is None:
        return mean, var
    seen = found.stiffness_sd**2 + SLIP_MODEL_SD**2
    return (mean * seen + found.stiffness * var) / (seen + var), seen * var / (seen + var)


@dataclass(frozen=True)
class _SlipFinding:
    """Result of the regression."""

    stiffness: float  # ln(stiffness / its value in the vehicle file)
    stiffness_sd: float
    later: float  # [s] latency of the front wheel speed behind the rear one
    later_sd: float  # [s]
    mismatch: float  # ratio of rear to front radius, divided by its value in the vehicle file, minus 1


def _run_regression(
    config: Config, at: Mapping[str, float], logs: Sequence[CheckedLog], vehicle: Vehicle
) -> _SlipFinding | None:
    """Return the result of the regression on all logs; None if it is not possible.

    The regression is not possible in three cases: the rear axle is driven and its
    stiffness is not tied to the stiffness of the front axle, too few rows are usable, or
    the slip is not significant. `at` has the unknowns of the car, by name.
    """
    if vehicle.driven_axle != "front" and config.rear_longitudinal_follows_front != 1.0:
        return None
    car = _Car(config, at, vehicle)
    parts = [p for log in logs if (p := _select_samples(car, log)) is not None]
    if sum(len(np.unique(p.block)) for p in parts) < MIN_REGRESSION_BLOCKS:
        return None
    b, b_sd = _solve(parts, np.array([*PRIOR_SD, *[RADIUS_RATIO_SD] * len(parts)]))
    if not b[0] > SIGNIFICANT_SD * b_sd[0]:  # no significant slip: stiffer tyres fit equally well
        return None
    sign = 1.0 if car.driven == "front" else -1.0
    weights = [len(p.slip) for p in parts]
    slip = float(np.average(b[len(PRIOR_SD) :], weights=weights))
    # if the driven axle turns faster than predicted, its radius is below that in the file
    mismatch = (1.0 + slip) ** sign - 1.0
    stiffness = float(np.log1p(slip) - np.log(b[0]))
    return _SlipFinding(stiffness, float(b_sd[0] / b[0]), -sign * float(b[1]), float(b_sd[1]), mismatch)


def _solve(parts: Sequence[_Samples], prior_sd: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the unknowns of the regression and their sds.

    Order: the coefficients of the five columns of _Samples.x, which all logs have in
    common, then the offset of the slip of each log (`radius` in apply_slip_regression()).
    """
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
        # number of samples that count as one, because residuals of a block are correlated
        lasts = max(1.0, float(np.sum(np.bincount(block, np.sqrt(w) * error) ** 2)) / total)
        w = w * len(y) / (total * lasts)
        information = (x * w[:, None]).T @ x + prior
        noisy = float(w @ noise) * np.linalg.inv(information)[0, 0]
        information[0, 0] -= w @ noise  # the part of the sum of slip(F)^2 that noise of accel_x causes
        b = np.linalg.solve(information, (x * w[:, None]).T @ y)
        error = w * (y - x @ b)
        score = np.column_stack([np.bincount(block, error * column) for column in x.T])
        score[:, 0] += np.bincount(block, w * noise) * b[0]
    inverse = np.linalg.inv(information)
    sandwich = inverse @ (score.T @ score + prior) @ inverse
    sd = np.sqrt(np.maximum(np.diag(inverse), np.diag(sandwich)))
    if noisy > MAX_NOISE_SHARE:
        sd[0] = np.inf
    return b, sd


class _Car:
    """Parameters of the car that the regression needs. Forces are divided by the mass of
    the car [m/s2].
    """

    def __init__(self, c: Config, at: Mapping[str, float], vehicle: Vehicle):
        ordinary = get_ordinary_car(c)
        self.grip, shape = choose_curve(ordinary, at.get(FRICTION, 0.0), c.tyre_saturation_shape)
        self.driven = vehicle.driven_axle
        self.radius = c.wheel_radius_front, c.wheel_radius_rear
        self.base, self.mass = c.lf + c.lr, c.mass
        self.load = GRAVITY * c.lr / self.base, GRAVITY * c.lf / self.base  # [m/s2] front, rear
        # height of the centre of gravity / wheelbase
        self.height = float(vehicle.facts.get("cg_height", ordinary["cg_height"])) / self.base
        # [s2/m] relative increase of the ratio of front to rear rolling radius by load
        # transfer, per m/s2 of (drive force / mass)
        self.give = TYRE_COMPRESSION * self.height * self.base**2 / (GRAVITY * c.lf * c.lr)
        self.stiffness = (
            c.longitudinal_stiffness_front,
            at.get("longitudinal_stiffness_rear", c.longitudinal_stiffness_rear),
        )
        self.scale = (1.0 + at.get("imu_scale_ax_error", 0.0)) * (
            1.0 + GRAVITY * at.get("pitch_leak_gain", 0.0)
        )
        self.drag, self.rolling = at["aero_drag_coefficient"], at["rolling_resistance_coefficient"]
        z = np.linspace(0.0, 1.0, 400)  # normalised slip of the brush model, up to full sliding
        brush, other = 1.0 - z + z * z / 3.0, (1.0 + 9.0 * z**2 + 81.0 * z**4) ** -0.25
        # force / grip at the slip z: of a linear tyre, and of the tyre
        self.curve = 3.0 * z, 3.0 * z * (brush + shape * (other - brush))

    def compute_slip(
        self, axle: int, force: np.ndarray, push: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the slip of an axle for a longitudinal force.

        Parameters
        ----------
        axle
            0: front, 1: rear.
        force, push
            Force of the axle, and total force that accelerates the car, per mass [m/s2].

        Returns
        -------
        slip
            Slip with the stiffness of the vehicle file.
        bend
            Slip minus that of a linear tyre at static load.
        share
            Ratio of the absolute value of the force to the grip of the axle.
        """
        load = np.maximum(
            self.load[axle] + (self.height if axle else -self.height) * push, 0.1 * self.load[axle]
        )
        share = np.abs(force) / (self.grip * load)
        linear = np.interp(share, self.curve[1], self.curve[0]) * self.grip * load * np.sign(force)
        slip = self.mass * linear / (self.stiffness[axle] * load / self.load[axle])
        return slip, slip - self.mass * force / self.stiffness[axle], share


@dataclass(frozen=True)
class _Samples:
    """Samples of a log that are used in the regression."""

    # (samples, 5) regressors, with the symbols of apply_slip_regression(): slip(F), a/v,
    # d slip(F)/dt, v^2/C, slip(F) - F/C + radii(F)
    x: np.ndarray
    noise: np.ndarray  # variance of the first regressor caused by noise of accel_x
    slip: np.ndarray  # measured v_driven/v_free - 1 - radii(F)
    # factor of the residual in the least squares: the speed [m/s], because the sd of the
    # slip noise is proportional to 1/speed. A limit of 15 bounds the weight of fast rows
    weight: np.ndarray
    block: np.ndarray  # number of the block of REGRESSION_BLOCK seconds


def _select_samples(car: _Car, log: CheckedLog) -> _Samples | None:
    """Return samples of straight rows without braking; None if there are none.

    If both axles are driven, the front axle is treated as the driven and the rear axle as
    the free one, and a log has no samples if it lacks a wheel torque or the brake switch.
    """
    brake, torque = log.extra.get("brake"), [log.extra.get(name) for name in TORQUE_COLUMNS]
    if car.driven == "both" and (brake is None or any(t is None for t in torque)):
        return None
    count = max(1, round(SMOOTH_TIME / (log.sample_time or 0.01)))

    def smooth(x: np.ndarray) -> np.ndarray:
        return pd.Series(x).rolling(count, center=True, min_periods=1).mean().to_numpy()

    steer, rate, pull, *spin = (
        log.data[c].to_numpy(float) for c in ("steer_angle", "yaw_rate", "accel_x", *WHEEL_CHANNELS)
    )
    rate = np.nan_to_num(rate)  # without a gyro, the steering angle alone selects straight rows
    front, rear = car.radius[0] * spin[0], car.radius[1] * spin[1]
    # speed of the front axle in the direction of its wheels, computed from the rear axle
    rear_ahead = rear * np.cos(steer) + car.base * rate * np.sin(steer)
    first = 1 if car.driven == "rear" else 0  # axle whose slip is measured
    v = smooth(front if first else rear)
    slip = smooth(rear_ahead - front if first else front - rear_ahead) / np.maximum(v, 0.1)
    pull, gains = smooth(pull) / car.scale, smooth(np.gradient(v, log.time))
    push = pull + GRAVITY * car.rolling + car.drag * v**2 / car.mass
    turns = WHEEL_MASS_SHARE * gains  # [m/s2] force per mass that spins up the wheels of an axle
    if car.driven == "both":
        pulls = [t.to_numpy(float) / (r * car.mass) for t, r in zip(torque, car.radius, strict=True)]
        apart = smooth(pulls[0] - pulls[1])
        forces = 0.5 * (push + apart), 0.5 * (push - apart)
    else:
        forces = push + turns, -turns
    own, other = (car.compute_slip(axle, f, push) for axle, f in zip((first, 1 - first), forces, strict=True))
    takes, bend, share = own[0] - other[0], own[1] - other[1], own[2]
    switch = np.zeros(len(v))
    if brake is not None:
        switch = np.where(brake.to_numpy(float) < BRAKE_THRESHOLD, 0.0, 1.0)
    brakes = smooth(switch) > 0 if switch.any() else pull < MIN_COAST_ACCEL
    use = (
        (v > MIN_REGRESSION_SPEED)
        & (np.abs(steer) < MAX_STRAIGHT_STEER)
        & (np.abs(v * smooth(rate)) < MAX_STRAIGHT_ACCEL)
        & (share < MAX_GRIP_SHARE)
        & ~brakes
    )
    later, lag = gains / np.maximum(v, 0.1), np.gradient(takes, log.time)
    drag = v**2 / car.stiffness[first]
    # load transfer to the rear increases the rolling radius in front, so the front wheels
    # turn slower, and reduces the radius at the rear, so the rear wheels turn faster
    radii = (1 if first else -1) * car.give * push
    seen = slip - radii
    use &= np.isfinite(seen + takes + lag)
    use &= np.arange(len(v)) % max(1, round(SAMPLE_PERIOD / (log.sample_time or 0.01))) == 0
    if not use.any():
        return None
    columns = np.column_stack([takes, later, lag, drag, bend + radii])[use]
    white = estimate_noise(log, "accel_x", v > MIN_REGRESSION_SPEED)
    of_mean = white.unraised**2 / count if white is not None else 0.0
    noise = np.full(len(columns), of_mean * (car.mass / (car.scale * car.stiffness[first])) ** 2)
    return _Samples(
        columns, noise, seen[use], np.minimum(v[use], 15.0), np.floor(log.time[use] / REGRESSION_BLOCK)
    )
