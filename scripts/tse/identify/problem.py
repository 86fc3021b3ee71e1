"""Compare logs with the model: residuals of the sensors and their partial derivatives.

The vector x contains the unknowns of the car, for each log the lean of its roads (share
of the lateral acceleration in curves that their bank compensates), and for each channel
of each log a bias. The vector z contains bank and grade along the roads (knots.py).

Latencies are relative to the gyro. A channel with latency L has at time t the value of
t - L. So an input is read at t + L, and a simulated output is delayed by L. If a channel
repeats its samples, L includes the mean age of its values. simulate() subtracts this mean
age, because only new samples, whose age is 0, are compared.

accel_x is compared as a wheel speed. The difference e = measured - simulated becomes
    y = s + (m v/C) e, with ds/dt = e - s/SPEED_TIME,
with the mass m, the speed v, and the sum C of the longitudinal stiffnesses. s is the
difference in the speed of the car, and (m v/C) e the difference in slip speed that the
force m e causes. A direct comparison of accelerations would be biased: wheel speeds are
inputs, so the simulated acceleration contains the derivative of their noise. Too soft
tyres and too large wheel latencies smooth this noise, so a car with these errors would
fit accel_x better than the true car. C is fixed at the prior mean: otherwise the fit
could reduce y by changing C.

The simulation subtracts the mean latency of the wheels from the latencies of the wheels
and of accel_x. So the fit estimates how much later accel_x is than the wheels. The common
latency of wheels and accel_x relative to the gyro has no influence on the residuals and
keeps its prior. Bayesian literature calls this a cut (Liu, Bayarri & Berger 2009, Plummer
2015). Without the cut, this latency would be estimated as 0.1 s: logs contain little
information on it, because the speed hardly changes within a latency. But a wrong value
would reduce those residuals of yaw_rate that come from a small model error in the effect
of braking on lateral forces.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from scipy.linalg import block_diag
from scipy.signal import lfilter
from scipy.sparse import csc_matrix

from tse.car.vehicle import GRAVITY
from tse.identify.data import (
    BLOCK_TIME,
    PreparedLog,
    average_blocks,
    compute_curve_accel,
    compute_speed,
    group_blocks,
    mark_inside,
    simulate,
)
from tse.identify.knots import KNOT_SD, KNOT_STEP, Knots, build_sparse
from tse.identify.lasting import Lasting, Piece, measure_lasting
from tse.identify.unknowns import (
    BIAS_SD,
    COMPLIANCE,
    LATE_CHANNELS,
    LATENCIES,
    LATENCY_SUFFIX,
    LEAN_MEAN,
    LEAN_SD,
    MEASURED,
    SUPERELEVATION,
    VELOCITY,
    Prior,
    name_bias,
    name_in_log,
)
from tse.library.core import NOMINAL, Config
from tse.log.noise import compute_moving_average

# [prior sd] step of the finite differences. Key True: for cornering stiffness, whose
# effect is the least linear. Key False: for all other unknowns
SLOPE_STEPS = {True: 0.0005, False: 0.005}
ACTIVE_TIME = 1.0  # [s] window of the moving rms of a channel
# [s] time constant of the leaky integral by which a difference of accel_x is converted to
# a difference of speed (see the top of this file). With a longer time constant, the grade
# of the road would dominate the integral. With a shorter time constant, the noise of
# accel_x would dominate it
SPEED_TIME = 1.0
# A block is an interval of BLOCK_TIME, 0.04 s, over which samples are averaged. The mean
# of SPEED_BLOCKS blocks (0.4 s) is one compared value of accel_x
SPEED_BLOCKS = 10
# [m/s] average_speed() returns at least this speed, so that its inverse remains finite
# while the car stands
MIN_SLIP_SPEED = 5.0
MIN_BLOCKS = 25  # a channel with fewer blocks in a log is not compared
# A block of a channel is used if it has more values than this share of the median number
# of values in the blocks of this channel that are not empty
MIN_BLOCK_FILL = 0.5
# Lower limit of the ratio: rms of the model error / rms of the signal, for accel_y and
# yaw_rate. The ratio is 1.1 .. 4 % for the cars of tests/cars, and 2.7 .. 5 % for real
# cars. accel_x has no such limit: with it, the weight of accel_x would be too small to
# estimate the grade of the road
MIN_MODEL_ERROR = 0.01
# sd of the slow error of a measured velocity / sd of this velocity in the settings, as in
# the filter (LASTING in constants.toml)
LASTING_ERROR_SHARE = 0.5
BOUND_SD = 6.0  # [prior sd] distance of the bounds of leans and biases from the prior mean
# Setting with the lean of the roads: the share of the lateral acceleration in curves that
# the bank of the road compensates
LEAN = "bank_superelevation"
WHEEL_CHANNELS = ("wheel_speed_front", "wheel_speed_rear")
# outputs of the simulation, from which convert_velocities() computes the velocities that
# an INS or a GNSS receiver would measure
MOTION_OUTPUTS = ("vel_x", "vel_y", "true_yaw_rate")


class CarProblem:
    """Residuals of all logs, and the prior of their unknowns.

    Parameters
    ----------
    logs
        As data.prepare() returns them. A log is dropped if it has no stretch, i.e. no
        consecutive rows that can be simulated (see FitStretch).
    config
        Settings of the vehicle file.
    prior
        Prior of the unknowns of the car.
    jobs
        Number of threads that simulate.
    road
        Knots of bank and grade. None: each log has its own road. False: roads are level.
        If any log contains measured bank or grade, no log has knots.
    lean
        True: the lean of the roads is an unknown of each log. False: it is the value in
        the vehicle file. If any log contains measured bank or grade, the lean is 0.

    Attributes
    ----------
    names, mean, sd, covariance, information, low, high
        Names, prior and bounds of x. For a cornering stiffness (COMPLIANCE), x contains
        its inverse, relative to the vehicle file.
    groups, time
        A group is one channel of one log, and has one vector of residuals. `groups` has,
        for each group, the index of the log and the name of the channel. `time` has, for
        each group, the times [s] of the residuals.
    """

    def __init__(
        self,
        logs: Sequence[PreparedLog],
        config: Config,
        prior: Prior,
        jobs: int = 1,
        road: Knots | bool | None = None,
        lean: bool = True,
    ):
        self.logs = [log for log in logs if log.stretches]
        self.config, self.prior, self.jobs = config, prior, max(1, jobs)
        known = any(log.road for log in self.logs)
        self.leans = len(self.logs) if lean and not known else 0
        # The setting LEAN is 0 if the bank that the model gets already contains the lean.
        self.nominal = config.as_dict() | ({LEAN: 0.0} if lean or known else {})
        self._curves = [compute_curve_accel(log, config) for log in self.logs]
        self._lay_out()
        self._state_prior()
        self.road = Knots.lay([log.distance for log in self.logs]) if road is None else road
        if known:  # a log has measured bank or grade, so there are no knots
            self.road = False
        self._place = [self._locate_values(g) for g in range(len(self.groups))]

    def _state_prior(self) -> None:
        """Set names, prior and bounds of x, in the coordinates of the search."""
        biased = [(i, c) for i, c in self.groups if c in BIAS_SD]
        self.car = len(self.prior.names)
        self.names = (
            *self.prior.names,
            *(name_in_log(SUPERELEVATION, i) for i in range(self.leans)),
            *(name_bias(c, i) for i, c in biased),
        )
        self._inverse = np.array([name in COMPLIANCE for name in self.names])
        lean = getattr(self.config, LEAN) or LEAN_MEAN
        own = np.array([lean] * self.leans + [0.0] * len(biased))
        own_sd = np.array([LEAN_SD] * self.leans + [BIAS_SD[c] for _, c in biased])
        ln = np.append(self.prior.mean, own)
        self.mean = self.to_search(ln)
        unit = np.where(self._inverse, -self.mean, 1.0)  # d(compliance)/d(ln stiffness)
        self.covariance = block_diag(self.prior.covariance, np.diag(own_sd**2)) * np.outer(unit, unit)
        self.information = np.linalg.inv(self.covariance)
        self.sd = np.sqrt(np.diag(self.covariance))
        ends = [
            self.to_search(np.append(e, own + s * BOUND_SD * own_sd))
            for e, s in ((self.prior.low, -1), (self.prior.high, 1))
        ]
        self.low, self.high = np.minimum(*ends), np.maximum(*ends)

    def to_search(self, x: np.ndarray) -> np.ndarray:
        """Convert unknowns to coordinates of the search: ln(stiffness) to 1/stiffness."""
        return np.where(self._inverse, np.exp(-np.where(self._inverse, x, 0.0)), x)

    def to_ln(self, x: np.ndarray) -> np.ndarray:
        """Convert unknowns back, 1/stiffness to ln(stiffness): inverse of to_search()."""
        return np.where(self._inverse, -np.log(np.where(self._inverse, x, 1.0)), x)

    def compute_ln_slope(self, x: np.ndarray) -> np.ndarray:
        """Return the derivative of to_ln() with respect to each unknown."""
        return np.where(self._inverse, -1.0 / np.where(self._inverse, x, 1.0), 1.0)

    # ---- groups of residuals

    def _lay_out(self) -> None:
        """Set the groups (one channel of one log each), and which blocks (intervals of
        BLOCK_TIME) of each group are compared."""
        self.groups: list[tuple[int, str]] = []
        self.time: list[np.ndarray] = []
        self._measured, self._used, self._time, self._count, self._speed, self._together = (
            [] for _ in range(6)
        )
        for i, log in enumerate(self.logs):
            time, v = (average_blocks(log, x)[0] for x in (log.time, compute_speed(log.inputs, self.config)))
            within = average_blocks(log, mark_inside(log))[0] == 1
            for c in (c for c in (*MEASURED, *VELOCITY) if c in log.measured):
                value, number = average_blocks(log, log.measured[c])
                usual = float(np.median(number[number > 0])) if number.any() else 1.0
                used = (number > MIN_BLOCK_FILL * usual) & within
                mean = group_blocks(time, used, SPEED_BLOCKS if c == "accel_x" else 1)
                if used.sum() < MIN_BLOCKS or not len(mean):
                    continue
                self.groups.append((i, c))
                self._measured.append(value)
                self._used.append(used)
                self._time.append(time)
                self._count.append(number)
                self._speed.append(v)
                self._together.append(mean)
                self.time.append(time[mean].mean(axis=1))
        self.channels = tuple(
            c for c in (*MEASURED, *VELOCITY) if any(c == channel for _, channel in self.groups)
        )

    def _locate_values(self, g: int) -> np.ndarray:
        """Return the distance [m] along the road at which each residual of a group was
        measured. NaN: the place is not on the road."""
        if self.road is False:
            return np.zeros(0)
        i = self.groups[g][0]
        place, there = average_blocks(self.logs[i], self.road.distance[i])
        return np.where(there > 0, place, np.nan)[self._together[g]].mean(axis=1)

    def get_step(self, g: int) -> float:
        """Return the median time [s] between the residuals of a group. If there is only
        one residual, return BLOCK_TIME.
        """
        return float(np.median(np.diff(self.time[g]))) if len(self.time[g]) > 1 else BLOCK_TIME

    def compute_noise(self, g: int) -> float:
        """Return the sd that white sensor noise causes in a residual of a group."""
        i, channel = self.groups[g]
        block = self.logs[i].noise[channel] / np.sqrt(np.maximum(self._count[g][self._together[g]], 1))
        sd = float(np.sqrt(np.mean(block**2)))
        if channel != "accel_x":
            return sd
        # response of the residuals (each is a mean over SPEED_BLOCKS blocks) to an error
        # of 1 m/s2 in one block
        one = np.zeros(SPEED_BLOCKS + round(5 * SPEED_TIME / BLOCK_TIME))
        one[0] = 1.0
        slip = self.compute_slip_time() * float(np.mean(self.average_speed(g))) * one
        mean = np.convolve(self._integrate(one) + slip, np.full(SPEED_BLOCKS, 1.0 / SPEED_BLOCKS))
        return sd * float(np.sqrt(np.sum(mean**2)))

    def compute_lasting_error(self, channel: str) -> float:
        """Return a lower limit for the rms of the non-white errors of a channel.

        measure_scales() uses it, so that small residuals do not give a channel too much
        weight. For a velocity, the limit is the slow error of its sensor. For accel_y and
        yaw_rate it is MIN_MODEL_ERROR times the rms of the signal, and for accel_x it is
        0. Biases are not included, because they are unknowns.
        """
        if channel == "accel_x":
            return 0.0
        if channel in VELOCITY:
            sd = self.config.gnss_speed_sd if channel == "gnss_speed" else self.config.ins_velocity_sd
            return LASTING_ERROR_SHARE * float(sd)
        signal = [self._compute_signal(g) for g, (_, c) in enumerate(self.groups) if c == channel]
        return MIN_MODEL_ERROR * float(np.sqrt(np.mean(np.concatenate(signal) ** 2)))

    # ---- simulation

    def make_settings(self, x: np.ndarray) -> tuple[Config, dict[str, float], dict[str, float]]:
        """Return settings, latencies and relative stiffness of the car that x describes.

        Latencies [s] have channels as keys. Stiffnesses have names as keys, and are
        relative to the vehicle file.
        """
        at = dict(zip(self.prior.names, map(float, self.to_ln(x)[: self.car]), strict=True))
        values = self.nominal | {k: v for k, v in at.items() if k in self.nominal}
        stiffness = {s: float(np.exp(at.get(s, 0.0))) for s in NOMINAL}
        config = Config.exact(values)
        return config, list_latencies(values | at), stiffness

    def simulate(self, i: int, x: np.ndarray, z: np.ndarray) -> dict[str, np.ndarray]:
        """Simulate the measured channels of a log, one value per row, without bias.

        Values are NaN in rows that belong to no stretch (see FitStretch).
        """
        config, late, stiffness = self.make_settings(x)
        log = self.logs[i]
        clock = log.held.get("yaw_rate", 0.0)
        late = {c: by - log.held.get(c, 0.0) + clock for c, by in late.items()}
        wheels = 0.5 * sum(late[w] for w in WHEEL_CHANNELS)
        later = {
            "steer_angle": late["steer_angle"],
            "accel_x": late["accel_x"] - wheels,
            "accel_y": late["accel_y"],
        }
        later |= {w: late[w] - wheels for w in WHEEL_CHANNELS}
        for name in LATENCIES:  # set to 0, because `later` already contains the latencies
            setattr(config, name, 0.0)
        profiles = {} if self.road is False else self.road.compute_profiles(i, z)
        if self.leans:
            lean = -x[self.names.index(name_in_log(SUPERELEVATION, i))] / GRAVITY * self._curves[i]
            profiles["bank"] = lean + profiles.get("bank", 0.0)
        moving = any(c in log.measured for c in VELOCITY)
        found = simulate(
            config, log, (*MEASURED, *(MOTION_OUTPUTS if moving else ())), stiffness, profiles, later
        )
        return found | (convert_velocities(found, config, log) if moving else {})

    def predict(self, x: np.ndarray, z: np.ndarray) -> list[np.ndarray]:
        """Return the block means of the simulated channels, with bias, for each group."""
        simulated: list[dict[str, np.ndarray]] = [self.simulate(i, x, z) for i in range(len(self.logs))]
        found = []
        for i, c in self.groups:
            log = self.logs[i]
            value = average_blocks(log, np.where(np.isfinite(log.measured[c]), simulated[i][c], np.nan))[0]
            found.append(value + (x[self.names.index(name_bias(c, i))] if c in BIAS_SD else 0.0))
        return found

    def compute_residuals(self, x: np.ndarray, z: np.ndarray) -> list[np.ndarray]:
        """Return measured minus predicted values, an array for each group.

        For accel_x, the difference is converted to a wheel speed, see
        transform_difference().
        """
        found = []
        for g, (y, p, used) in enumerate(zip(self._measured, self.predict(x, z), self._used, strict=True)):
            found.append(self._average_groups(g, np.where(used, y - p, 0.0)))
        return found

    def compute_sensed_residuals(self, x: np.ndarray, z: np.ndarray) -> list[np.ndarray]:
        """Return measured minus predicted values in the unit of the sensor.

        In contrast to compute_residuals(), accel_x is not converted to a wheel speed.
        There is an array for each group. It has one value, a mean over BLOCK_TIME, for
        each block that is used.
        """
        return [(y - p)[u] for y, p, u in zip(self._measured, self.predict(x, z), self._used, strict=True)]

    def get_measured(self, g: int) -> np.ndarray:
        """Return the measured values of a group: one mean for each compared block."""
        return self._measured[g][self._used[g]]

    def _compute_signal(self, g: int) -> np.ndarray:
        """Return the signal of a group: measured values minus their mean.

        _average_groups() converts the signal in the same way as residuals, so that the
        two can be compared.
        """
        used = self._used[g]
        about = self._measured[g] - self._measured[g][used].mean()
        return self._average_groups(g, np.where(used, about, 0.0))

    def _average_groups(self, g: int, difference: np.ndarray) -> np.ndarray:
        """Convert a difference, one value per block of a group, to residuals.

        First, transform_difference() converts the difference of each block. Then a
        residual is the mean over SPEED_BLOCKS blocks for accel_x, and the value of a
        single block for other channels.
        """
        return self.transform_difference(g, difference)[self._together[g]].mean(axis=1)

    def transform_difference(self, g: int, difference: np.ndarray) -> np.ndarray:
        """Convert a difference, one value per block of a group, to the compared quantity.

        For accel_x the compared quantity is a wheel speed, s + (m v/C) difference. The
        first term is the leaky integral of the difference:
            ds/dt = difference - s/SPEED_TIME, with s = 0 after each gap in time.
        With the mass m, the speed v and the longitudinal stiffness C of all tyres, the
        second term is the slip speed of the wheels that a force of m times the difference
        causes. For other channels the difference is returned unchanged.
        """
        if self.groups[g][1] != "accel_x":
            return difference
        pieces = np.split(difference, np.flatnonzero(np.diff(self._time[g]) > 1.5 * BLOCK_TIME) + 1)
        speed = np.concatenate([self._integrate(p) for p in pieces])
        return speed + self.compute_slip_time() * self._speed[g] * difference

    @staticmethod
    def _integrate(difference: np.ndarray) -> np.ndarray:
        """Return the leaky integral of a difference of accel_x (one value per block).

        Its time constant is SPEED_TIME.
        """
        keep = float(np.exp(-BLOCK_TIME / SPEED_TIME))
        return lfilter([SPEED_TIME * (1 - keep)], [1, -keep], difference)

    def compute_slip_time(self) -> float:
        """Return m/C [s2/m], the ratio of longitudinal slip to acceleration of the car.

        m is the mass, and C the sum of the longitudinal stiffnesses at the prior mean.
        """
        at = dict(zip(self.prior.names, self.prior.mean, strict=True))
        front = float(np.exp(at.get("cx_front", 0.0)))
        rear = 1.0 + self.config.rear_longitudinal_follows_front * (front - 1.0)
        rear_stiffness = at.get("longitudinal_stiffness_rear", self.config.longitudinal_stiffness_rear)
        return self.config.mass / (self.config.longitudinal_stiffness_front * front + rear_stiffness * rear)

    def average_speed(self, g: int) -> np.ndarray:
        """Return for each residual the mean speed [m/s] over the blocks that it averages.

        Lower speeds than MIN_SLIP_SPEED are replaced by MIN_SLIP_SPEED.
        """
        return np.maximum(self._speed[g][self._together[g]].mean(axis=1), MIN_SLIP_SPEED)

    def compute_unit_yaw_rate(self, g: int) -> np.ndarray:
        """Return for each residual the yaw rate [rad/s] that a lateral acceleration of
        1 m/s2 causes at the speed that average_speed() returns.
        """
        return 1.0 / self.average_speed(g)

    # ---- partial derivatives

    def compute_slopes(self, x: np.ndarray, z: np.ndarray, base: list[np.ndarray]) -> list[np.ndarray]:
        """Return d(residuals)/dx by finite differences, one matrix for each group.

        The lean of a log acts on this log alone, so one simulation gives the derivatives
        with respect to all leans. Derivatives with respect to biases need no simulation.
        """
        runs = [[k] for k in range(self.car)] + [list(range(self.car, self.car + self.leans))]
        tables = [np.zeros((len(r), len(x))) for r in base]
        for g, (i, c) in enumerate(self.groups):
            if c in BIAS_SD:
                one = self._average_groups(g, np.where(self._used[g], -1.0, 0.0))
                tables[g][:, self.names.index(name_bias(c, i))] = one

        def run(members: list[int]) -> None:
            moved, by = x.copy(), {}
            for k in members:
                h = SLOPE_STEPS[self.names[k] in COMPLIANCE] * self.sd[k]
                by[k] = h if x[k] + h <= self.high[k] else -h
                moved[k] += by[k]
            changed = self.compute_residuals(moved, z)
            for g, (i, _) in enumerate(self.groups):
                for k in members:
                    if k < self.car or k - self.car == i:
                        tables[g][:, k] = (changed[g] - base[g]) / by[k]

        # Threads run in parallel here, because the library releases Python's global
        # interpreter lock while it simulates.
        with ThreadPoolExecutor(self.jobs) as pool:
            list(pool.map(run, runs))
        return tables

    def compute_road_slopes(self, x: np.ndarray, z: np.ndarray, base: list[np.ndarray]) -> list[csc_matrix]:
        """Return d(residuals)/dz by finite differences, one sparse matrix per group."""
        size = len(z)
        parts: list[tuple[list, list, list]] = [([], [], []) for _ in base]

        def run(step: np.ndarray) -> None:
            changed = self.compute_residuals(x, z + step)
            for g, (i, _) in enumerate(self.groups):
                at = self.road.find_acting(i, self._place[g], step)
                rows = np.flatnonzero(at >= 0)
                slopes = (changed[g] - base[g])[rows] / KNOT_STEP
                for part, values in zip(parts[g], (rows, at[rows], slopes), strict=True):
                    part.append(values)

        if size:
            with ThreadPoolExecutor(self.jobs) as pool:
                list(pool.map(run, self.road.list_moves()))
        shapes = [(len(r), size) for r in base]
        return [
            build_sparse(*part, shape) if part[0] else csc_matrix(shape)
            for part, shape in zip(parts, shapes, strict=True)
        ]

    @property
    def knots(self) -> int:
        """Length of z."""
        return 0 if self.road is False else len(self.road)

    knot_sd = KNOT_SD

    # ---- slow part of residuals

    def make_piece(self, g: int, residual: np.ndarray) -> Piece:
        """Return residuals of a group, with the moving rms of the measured channel over
        ACTIVE_TIME.
        """
        level = self.transform_difference(g, self._measured[g])
        square = compute_moving_average(level**2, max(1, round(ACTIVE_TIME / BLOCK_TIME)))
        return Piece(self.time[g], np.sqrt(square[self._together[g]].mean(axis=1)), residual)

    def measure_lasting(self, residuals: list[np.ndarray]) -> dict[str, Lasting]:
        """Return power and walk of the residuals (see lasting.py) for each channel.

        Channels are those of MEASURED that the logs have.
        """
        pieces = {
            c: [self.make_piece(g, residuals[g]) for g, (_, own) in enumerate(self.groups) if own == c]
            for c in self.channels
            if c in MEASURED
        }
        return {c: measure_lasting(p) for c, p in pieces.items()}


def make_known_car(problem: CarProblem, x: np.ndarray) -> Config:
    """Return the settings of the car that x describes.

    Its stiffnesses are those of the vehicle file, multiplied by the ratios that
    x describes.
    """
    config, _, stiffness = problem.make_settings(x)
    for key, setting in NOMINAL.items():
        setattr(config, setting, getattr(config, setting) * stiffness[key])
    follows = config.rear_longitudinal_follows_front
    config.longitudinal_stiffness_rear *= 1.0 + follows * (stiffness["cx_front"] - 1.0)
    return config


def list_latencies(values: Mapping[str, float]) -> dict[str, float]:
    """Return the latency [s] of each channel relative to yaw_rate, from settings."""
    return {c: values.get(c + LATENCY_SUFFIX, 0.0) for c in LATE_CHANNELS}


def convert_velocities(
    found: Mapping[str, np.ndarray], config: Config, log: PreparedLog
) -> dict[str, np.ndarray]:
    """Convert simulated velocities to those that an INS or a GNSS receiver measures.

    `found` has the velocity (v_x, v_y) of the centre of gravity and the yaw rate r. A
    sensor at the position (x, y) relative to the centre of gravity (velocity_lever_x and
    _y) has the velocity (v_x - r y, v_y + r x). The axes of the sensor are turned to the
    left by velocity_heading, and its values are delayed by velocity_latency.
    """
    vx, vy, rate = (found[n] for n in MOTION_OUTPUTS)
    vx, vy = vx - rate * config.velocity_lever_y, vy + rate * config.velocity_lever_x
    turn = config.velocity_heading
    made = {
        "ins_vel_x": np.cos(turn) * vx + np.sin(turn) * vy,
        "ins_vel_y": np.cos(turn) * vy - np.sin(turn) * vx,
        "gnss_speed": np.hypot(vx, vy),
    }
    late = config.velocity_latency
    return {c: log.delay(x, late) for c, x in made.items() if c in log.measured}
