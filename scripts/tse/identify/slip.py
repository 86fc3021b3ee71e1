"""Estimate longitudinal stiffness, wheel radii and wheel latencies on straight rows.

The search takes wheel speeds as exact inputs, so its longitudinal stiffness absorbs their
noise, latency and radii. On a straight road the free axle measures the speed, the driven
axle the slip, and accel_x the force of that slip. Coasting rows have slip without force,
which is the mismatch of the radii. Rows with drive torque show the stiffness. One
regression uses all rows.
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

# Prior sd of the unknowns of the regression.
# s, latency of one wheel speed behind the other: two messages of a bus with cycles of
# 10 .. 20 ms
WHEEL_LATENCY_SD = 0.006
# 1, ratio of the radii of both axles over that of the file, by wear and pressure; it
# includes the bias of accel_x
RADIUS_RATIO_SD = 0.01
LAG_SD = 0.1  # s, latency of accel_x behind the wheels, less the relaxation of the tyres
DRAG_SD = 0.1  # kg/m, air drag
INVERSE_STIFFNESS_SD = 1e3  # 1, inverse stiffness over the file's: no prior
BEND_SD = 0.25  # 1, tyre curve and load transfer over those of the model
PRIOR_SD = (INVERSE_STIFFNESS_SD, WHEEL_LATENCY_SD, LAG_SD, DRAG_SD, BEND_SD)  # shared by all logs

# ln, model error of the stiffness, for logs of any length: pitch, rolling radius under
# load, tyre curve. Ten cars of tests/cars: 0.034 rms, 0.042 with each road alone
SLIP_MODEL_SD = 0.05
# share of the noise of accel_x in the square of its slip: above, the logs show no
# stiffness
MAX_NOISE_SHARE = 0.5
MIN_MISMATCH = 0.01  # 1, of the radii: a smaller mismatch is neither applied nor reported

# Rows that are used: tyres far from their grip, no brake, no curve.
MIN_REGRESSION_SPEED = 4.0  # m/s
MAX_STRAIGHT_STEER = 0.03  # rad
MAX_STRAIGHT_ACCEL = 1.0  # m/s2, lateral
MAX_GRIP_SHARE = 0.5
# m/s2, of accel_x: below, the brakes may act, where no brake switch is logged. A limit of
# -0.1 admits rows with brakes, which make a steady drive 14 % too stiff, and -0.3 65 %
MIN_COAST_ACCEL = 0.0
BRAKE_THRESHOLD = 0.5  # of the brake switch: at or above, the brakes act

SMOOTH_TIME = 0.6  # s, moving mean of the channels
SAMPLE_PERIOD = 0.1  # s, between rows that are used
REGRESSION_BLOCK = 10.0  # s, length of a block: blocks are independent, their rows are not
MIN_REGRESSION_BLOCKS = 6
TYRE_COMPRESSION = 0.005  # share of the rolling radius that the static load takes (src/model/car.c)
# mass of two wheels, at their radius, over that of the car: 2.4 kg m2, 0.33 m, 1600 kg
WHEEL_MASS_SHARE = 0.014


def apply_slip_regression(
    problem: CarProblem, fit: CarFit, logs: Sequence[CheckedLog], vehicle: Vehicle
) -> CarFit:
    """Return the fit with longitudinal stiffness, wheel latencies and radii by
    regression.

    Parameters
    ----------
    problem, fit : Problem, Fit
        The search. Its longitudinal stiffness and common wheel latency are replaced.
    logs : sequence of CheckedLog
        Logs of the calibration.
    vehicle : Vehicle
        Gives the driven axle. If both axles are driven, only logs with wheel torques and
        a brake switch are used.

    Returns
    -------
    CarFit
        Numbers that the logs do not show keep mean and covariance of the prior.

    Notes
    -----
    v_driven/v_free - 1 = F/C/k + share (slip(F) - F/C + radii(a)) - later a/v
                          + lag d slip(F)/dt + drag v^2 + radius,
    with k the stiffness over the file's. F is by accel_x, drag, rolling resistance and
    with the stiffness k over that of the file. F is the force by accel_x, drag, rolling
    resistance and inertia of the wheels. F/C is the slip of a linear tyre at static load.
    slip(F) follows the tyre curve and the longitudinal load transfer of src/model/car.c,
    and radii(a) is what this load takes of the rolling radii. `share` scales both, with
    prior sd BEND_SD. Each log has its own radius, which includes the bias of accel_x.

    Weighted least squares with Huber weights and priors. The share of the noise of
    accel_x in the square of its slip is subtracted (errors in variables: Fuller 1987).
    Residuals are correlated: the weights count the effective number of samples by blocks
    of ten seconds. The covariance is the larger one of the inverse information and the
    sandwich over blocks (White 1982). SLIP_MODEL_SD is added to k.
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
    """Return ln of the longitudinal stiffness over the vehicle file's, and its sd.

    Parameters
    ----------
    config
        Settings of the vehicle file.
    values
        Settings of a fit by name; the others keep their prior.
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
    """Return as text what the regression found.

    A stiffness that the logs do not show, a latency between both wheel speeds, and a
    mismatch of the wheel radii from MIN_MISMATCH on.
    """
    names, found = list(problem.names), []
    k = names.index(LONGITUDINAL_KEY)
    if not fit.covariance[k, k] < (MAX_SHOWN_RATIO * problem.sd[k]) ** 2:
        found.append(
            "longitudinal stiffness: not shown by these logs: it needs straight rows in which the driven "
            "axle pulls and coasts, and, if both axles are driven, wheel torques and brake"
        )
    if (late := _compute_wheel_delay(problem, fit)) != 0.0:
        which = "front" if late > 0 else "rear"
        found.append(
            f"wheel speeds: the {which} one is {1000 * abs(late):.1f} ms behind the other, half of it each"
        )
    front, rear = (fit.x[names.index(name)] / getattr(problem.config, name) for name in RADIUS_SETTINGS)
    off = rear / front - 1.0
    if abs(off) >= MIN_MISMATCH:
        size = "smaller" if off < 0 else "larger"
        found.append(
            f"wheel radii: the rear one is {100 * abs(off):.1f} % {size}, beside the front one, than the "
            "vehicle file says"
        )
    return found


def describe_wheel_latencies(problem: CarProblem, fit: CarFit) -> dict[str, str]:
    """Return comments of a vehicle file for wheel latencies that the regression moved."""
    if _compute_wheel_delay(problem, fit) == 0.0:
        return {}
    text = ", behind each other as these logs show, both together as before"
    return dict.fromkeys((name + LATENCY_SUFFIX for name in WHEEL_CHANNELS), text)


def _compute_wheel_delay(problem: CarProblem, fit: CarFit) -> float:
    """Return the latency [s] of the front wheels behind the rear, less its prior."""
    front, rear = (list(problem.names).index(name + LATENCY_SUFFIX) for name in WHEEL_CHANNELS)
    return float(fit.x[front] - problem.mean[front] - fit.x[rear] + problem.mean[rear])


def _apply_mismatch(config: Config, radii: np.ndarray, mismatch: float) -> np.ndarray:
    """Return both radii [m] with this mismatch of rear over front, same mean."""
    front, rear = radii / np.array([getattr(config, name) for name in RADIUS_SETTINGS])
    half = 0.5 * (np.log1p(mismatch) - np.log(rear / front))
    return radii * np.exp([-half, half])


def _combine_with_prior(found: _SlipFinding | None, mean: float, var: float) -> tuple[float, float]:
    """Return mean and variance of ln of the stiffness: the prior updated by the logs."""
    if found is None:
        return mean, var
    seen = found.stiffness_sd**2 + SLIP_MODEL_SD**2
    return (mean * seen + found.stiffness * var) / (seen + var), seen * var / (seen + var)


@dataclass(frozen=True)
class _SlipFinding:
    """Result of the regression, with sds.

    stiffness: ln over that of the vehicle file. later: latency [s] of the front wheel
    speed behind the rear one. mismatch: rear over front radius relative to the file,
    minus 1.
    """

    stiffness: float
    stiffness_sd: float
    later: float
    later_sd: float
    mismatch: float


def _run_regression(
    config: Config, at: Mapping[str, float], logs: Sequence[CheckedLog], vehicle: Vehicle
) -> _SlipFinding | None:
    """Return the result of all logs; None: they show nothing. at: car, by name."""
    if vehicle.driven_axle != "front" and config.rear_longitudinal_follows_front != 1.0:
        return None
    car = _Car(config, at, vehicle)
    parts = [p for log in logs if (p := _select_samples(car, log)) is not None]
    if sum(len(np.unique(p.block)) for p in parts) < MIN_REGRESSION_BLOCKS:
        return None
    b, b_sd = _solve(parts, np.array([*PRIOR_SD, *[RADIUS_RATIO_SD] * len(parts)]))
    if not b[0] > SIGNIFICANT_SD * b_sd[0]:  # no slip is significant: soft and stiff tyres fit alike
        return None
    sign = 1.0 if car.driven == "front" else -1.0
    weights = [len(p.slip) for p in parts]
    slip = float(np.average(b[len(PRIOR_SD) :], weights=weights))
    # a driven axle that turns faster than it should has a smaller radius than in the file
    mismatch = (1.0 + slip) ** sign - 1.0
    stiffness = float(np.log1p(slip) - np.log(b[0]))
    return _SlipFinding(stiffness, float(b_sd[0] / b[0]), -sign * float(b[1]), float(b_sd[1]), mismatch)


def _solve(parts: Sequence[_Samples], prior_sd: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return solution and sds: shared unknowns, then one of each log."""
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
        # effective number of samples by the correlation within blocks
        lasts = max(1.0, float(np.sum(np.bincount(block, np.sqrt(w) * error) ** 2)) / total)
        w = w * len(y) / (total * lasts)
        information = (x * w[:, None]).T @ x + prior
        noisy = float(w @ noise) * np.linalg.inv(information)[0, 0]
        information[0, 0] -= w @ noise  # share of the noise of accel_x in the square of its slip
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
    """Numbers of the car that the regression needs; forces per mass."""

    def __init__(self, c: Config, at: Mapping[str, float], vehicle: Vehicle):
        ordinary = get_ordinary_car(c)
        self.grip, shape = choose_curve(ordinary, at.get(FRICTION, 0.0), c.tyre_saturation_shape)
        self.driven = vehicle.driven_axle
        self.radius = c.wheel_radius_front, c.wheel_radius_rear
        self.base, self.mass = c.lf + c.lr, c.mass
        self.load = GRAVITY * c.lr / self.base, GRAVITY * c.lf / self.base  # m/s2: front, rear
        self.height = float(vehicle.facts.get("cg_height", ordinary["cg_height"])) / self.base
        # change of the rolling radius of both axles, per m/s2
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
        self.curve = 3.0 * z, 3.0 * z * (brush + shape * (other - brush))

    def compute_slip(
        self, axle: int, force: np.ndarray, push: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the slip of an axle, its difference from a linear tyre, and the grip
        used.

        Parameters
        ----------
        axle
            0: front, 1: rear.
        force, push
            Of the axle and of the car, per mass [m/s2].

        Returns
        -------
        slip
            With the stiffness of the file.
        bend
            Slip less that of a linear tyre at static load.
        share
            Force over grip.
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
    """Samples of a log that are used.

    x: regressors: slip of the force at the file's stiffness, a/v, rate of that slip, slip
    of 1 kg/m of drag, nonlinear part of that slip. noise: variance of the first regressor
    by the noise of accel_x. slip: of the driven axle over the free one.
    """

    x: np.ndarray
    noise: np.ndarray
    slip: np.ndarray
    weight: np.ndarray
    block: np.ndarray


def _select_samples(car: _Car, log: CheckedLog) -> _Samples | None:
    """Return the straight rows of a log without brakes; None: the drive torques are
    unknown.

    Slip is that of the front axle over the rear one, unless the rear axle is driven.
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
    rear_ahead = rear * np.cos(steer) + car.base * rate * np.sin(steer)  # along the front wheels
    first = 1 if car.driven == "rear" else 0  # axle of the slip
    v = smooth(front if first else rear)
    slip = smooth(rear_ahead - front if first else front - rear_ahead) / np.maximum(v, 0.1)
    pull, gains = smooth(pull) / car.scale, smooth(np.gradient(v, log.time))
    push = pull + GRAVITY * car.rolling + car.drag * v**2 / car.mass
    turns = WHEEL_MASS_SHARE * gains  # force that accelerates the wheels of an axle
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
    # load transfer to the rear increases the rolling radius in front, so those wheels
    # turn slower, and reduces the one at the rear
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
