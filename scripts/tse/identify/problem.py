"""Logs against the model: what the sensors would read with these unknowns, and the slopes of that.

Unknown are, as one vector x, the numbers of the car, how far the roads of each log lean
into their curves, and a bias of each channel in each log; and, as a second vector z, bank
and grade along the roads (road.py).

The gyro is the clock. A channel that is late by L has at time t the value of t - L: inputs are
read L later, simulated channels are compared L earlier. Where values are held, L is their mean
age.

accel_x is compared as a wheel speed. With e = measured - simulated, v the speed and C the sum
of the longitudinal stiffnesses,
    y = integral of e, leaking within SPEED_TIME, + (m v/C) e.
A car follows its wheels with the lag m v/C. Then y is the difference of the wheel speeds from
those that the accelerometer implies. Why: a simulation that wheel speeds drive has the slope
of their noise in its acceleration. Soft tyres and late wheels smooth it, and so fit accel_x
better than the truth does. C is that of the prior: it defines the comparison and is not
searched.

Between wheels and accel_x only the difference of their latencies counts. accel_y and yaw_rate
are compared with a car whose wheels are in time (a cut: Liu, Bayarri & Berger 2009, Plummer
2015). The speed hardly changes within a latency, but tyres change with braking, and every
percent by which the model has that wrong would show as a latency: yaw_rate, the most exact
channel, then says 0.1 s. The latency of both behind the gyro is left to the prior.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from scipy.linalg import block_diag
from scipy.signal import lfilter
from scipy.sparse import csc_matrix

from tse.car.vehicle import GRAVITY
from tse.identify.data import BLOCK, Prepared, blocks, curves, inside, simulate, speed, together
from tse.identify.knots import KNOT_SD, STEP, Knots, sparse
from tse.identify.lasting import Lasting, Piece, measure
from tse.identify.unknowns import (
    BIAS_SD,
    COMPLIANCE,
    LATE,
    LATENCIES,
    LATENCY,
    LEAN_MEAN,
    LEAN_SD,
    MEASURED,
    SUPERELEVATION,
    VELOCITY,
    Prior,
    bias_of,
    of_log,
)
from tse.library.core import NOMINAL, Config
from tse.log.noise import compute_moving_average

# prior sd, of finite differences: of stiffness, to which the response is least linear, and of the others
STEPS = {True: 0.0005, False: 0.005}
ACTIVE_TIME = 1.0  # s: over which the size of a channel is taken
SPEED_TIME = 1.0  # s: in the comparison of accel_x; longer lets the grade of the road in, shorter its noise
SPEED_BLOCKS = 10  # blocks: that are one in the comparison of accel_x: a second holds two or three numbers
LEAST_SPEED = 5.0  # m/s: below, slip is not observable
FEWEST = 25  # blocks: of a channel in a log, to compare it
ENOUGH = 0.5  # rows with a value in a block, over the usual number
# of what happens across, rms: no model is nearer to a car. Those of tests/cars are 1.1 .. 4 %
# off, the real ones 2.7 .. 5 %. Along the car it would hide what accel_x shows of roads
UNLIKE = 0.01
LASTING = 0.5  # of the error of a velocity: what is no white noise, as the filter has it (constants.toml)
FAR = 6.0  # prior sd: bounds of leans and biases
LEAN = "bank_superelevation"
WHEELS = ("wheel_speed_front", "wheel_speed_rear")
MOTION = ("vel_x", "vel_y", "true_yaw_rate")  # of the simulation, of which a measured velocity is made


class Problem:
    """All logs.

    Parameters
    ----------
    logs
        As data.prepare() leaves them; those without a stretch to simulate are left out.
    config
        The car of the vehicle file.
    prior
        Unknowns of the car.
    jobs
        Threads that simulate.
    road
        Knots of bank and grade; None: of each log, on its own. False: level roads. Of
        logs whose road is known there are none.
    lean
        How far the road of a log leans into its curves is unknown; else as the vehicle
        file says. Not of logs whose road is known.

    Attributes
    ----------
    names, mean, sd, covariance, information, low, high
        Prior of x: cornering stiffness (COMPLIANCE) as its inverse over the vehicle file's.
    groups, time
        Log and channel of each vector of residuals, and when [s] its values are.
    """

    def __init__(
        self,
        logs: Sequence[Prepared],
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
        # how far the roads of the logs lean is found of each, around what the vehicle file says
        self.nominal = config.as_dict() | ({LEAN: 0.0} if lean or known else {})
        self._curves = [curves(log, config) for log in self.logs]
        self._lay_out()
        self._state_prior()
        self.road = Knots.of([log.distance for log in self.logs]) if road is None else road
        if known:  # it is the whole of it
            self.road = False
        self._place = [self._distance(g) for g in range(len(self.groups))]

    def _state_prior(self) -> None:
        """Prior of x, in the coordinates of the search."""
        biased = [(i, c) for i, c in self.groups if c in BIAS_SD]
        self.car = len(self.prior.names)
        self.names = (
            *self.prior.names,
            *(of_log(SUPERELEVATION, i) for i in range(self.leans)),
            *(bias_of(c, i) for i, c in biased),
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
            self.to_search(np.append(e, own + s * FAR * own_sd))
            for e, s in ((self.prior.low, -1), (self.prior.high, 1))
        ]
        self.low, self.high = np.minimum(*ends), np.maximum(*ends)

    def to_search(self, x: np.ndarray) -> np.ndarray:
        """Return unknowns as they are searched, of stiffness in ln over the vehicle file's."""
        return np.where(self._inverse, np.exp(-np.where(self._inverse, x, 0.0)), x)

    def to_ln(self, x: np.ndarray) -> np.ndarray:
        """Return the opposite of to_search()."""
        return np.where(self._inverse, -np.log(np.where(self._inverse, x, 1.0)), x)

    def ln_slope(self, x: np.ndarray) -> np.ndarray:
        """Return d(to_ln)/dx, of each by itself."""
        return np.where(self._inverse, -1.0 / np.where(self._inverse, x, 1.0), 1.0)

    # ---- what is compared

    def _lay_out(self) -> None:
        """Groups of residuals, a log and a channel each, and which blocks are compared."""
        self.groups: list[tuple[int, str]] = []
        self.time: list[np.ndarray] = []
        self._measured, self._used, self._time, self._count, self._speed, self._together = (
            [] for _ in range(6)
        )
        for i, log in enumerate(self.logs):
            time, v = (blocks(log, x)[0] for x in (log.time, speed(log.inputs, self.config)))
            within = blocks(log, inside(log))[0] == 1
            for c in (c for c in (*MEASURED, *VELOCITY) if c in log.measured):
                value, number = blocks(log, log.measured[c])
                usual = float(np.median(number[number > 0])) if number.any() else 1.0
                used = (number > ENOUGH * usual) & within
                mean = together(time, used, SPEED_BLOCKS if c == "accel_x" else 1)
                if used.sum() < FEWEST or not len(mean):
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

    def _distance(self, g: int) -> np.ndarray:
        """Where on its road [m] the car is at each value of a group."""
        if self.road is False:
            return np.zeros(0)
        i = self.groups[g][0]
        place, there = blocks(self.logs[i], self.road.distance[i])
        return np.where(there > 0, place, np.nan)[self._together[g]].mean(axis=1)

    def step(self, g: int) -> float:
        """Return the time [s] between values of a group."""
        return float(np.median(np.diff(self.time[g]))) if len(self.time[g]) > 1 else BLOCK

    def noise(self, g: int) -> float:
        """Return what the sensor's white noise leaves in a value of a group, rms."""
        i, channel = self.groups[g]
        block = self.logs[i].noise[channel] / np.sqrt(np.maximum(self._count[g][self._together[g]], 1))
        sd = float(np.sqrt(np.mean(block**2)))
        if channel != "accel_x":
            return sd
        length = SPEED_BLOCKS + round(
            5 * SPEED_TIME / BLOCK
        )  # of what one block does to the mean of SPEED_BLOCKS
        one = np.zeros(length)
        one[0] = 1.0
        answer = self._integral(one) + self.slip_time() * float(np.mean(self.mean_speed(g))) * one
        mean = np.convolve(answer, np.full(SPEED_BLOCKS, 1.0 / SPEED_BLOCKS))
        return sd * float(np.sqrt(np.sum(mean**2)))

    def lasting_error(self, channel: str) -> float:
        """Return the least error, rms, that is no white noise: of a velocity that of the
        sensor; of accel_y and yaw_rate that of the model. Biases are unknowns."""
        if channel == "accel_x":
            return 0.0
        if channel not in VELOCITY:
            mine = [g for g, (_, c) in enumerate(self.groups) if c == channel]
            return UNLIKE * float(np.sqrt(np.mean(np.concatenate([self._signal(g) for g in mine]) ** 2)))
        return LASTING * float(
            self.config.gnss_speed_sd if channel == "gnss_speed" else self.config.ins_velocity_sd
        )

    # ---- the model

    def settings(self, x: np.ndarray) -> tuple[Config, dict[str, float], dict[str, float]]:
        """Return settings of the simulation, latencies [s] of the channels, and stiffness
        over the vehicle file's."""
        at = dict(zip(self.prior.names, map(float, self.to_ln(x)[: self.car]), strict=True))
        values = self.nominal | {k: v for k, v in at.items() if k in self.nominal}
        stiffness = {s: float(np.exp(at.get(s, 0.0))) for s in NOMINAL}
        config = Config.exact(values)
        return config, lateness(values | at), stiffness

    def simulate(self, i: int, x: np.ndarray, z: np.ndarray) -> dict[str, np.ndarray]:
        """Return what the measured channels of a log would read, a value per row, without
        bias; NaN between stretches."""
        config, late, stiffness = self.settings(x)
        log = self.logs[i]
        clock = log.held.get("yaw_rate", 0.0)
        late = {c: by - log.held.get(c, 0.0) + clock for c, by in late.items()}
        wheels = 0.5 * sum(late[w] for w in WHEELS)
        later = {
            "steer_angle": late["steer_angle"],
            "accel_x": late["accel_x"] - wheels,
            "accel_y": late["accel_y"],
        }
        later |= {w: late[w] - wheels for w in WHEELS}
        for name in LATENCIES:  # they are in `later`; settings may only differ by so much
            setattr(config, name, 0.0)
        profiles = {} if self.road is False else self.road.profiles(i, z)
        if self.leans:
            lean = -x[self.names.index(of_log(SUPERELEVATION, i))] / GRAVITY * self._curves[i]
            profiles["bank"] = lean + profiles.get("bank", 0.0)
        moving = any(c in log.measured for c in VELOCITY)
        found = simulate(config, log, (*MEASURED, *(MOTION if moving else ())), stiffness, profiles, later)
        return found | (as_measured(found, config, log) if moving else {})

    def predict(self, x: np.ndarray, z: np.ndarray) -> list[np.ndarray]:
        """Return the same with bias as blocks, a vector per group."""
        simulated: list[dict[str, np.ndarray]] = [self.simulate(i, x, z) for i in range(len(self.logs))]
        found = []
        for i, c in self.groups:
            log = self.logs[i]
            value = blocks(log, np.where(np.isfinite(log.measured[c]), simulated[i][c], np.nan))[0]
            found.append(value + (x[self.names.index(bias_of(c, i))] if c in BIAS_SD else 0.0))
        return found

    def residuals(self, x: np.ndarray, z: np.ndarray) -> list[np.ndarray]:
        """Return measured less predicted as they are compared, a vector per group: accel_x in m/s."""
        found = []
        for g, (y, p, used) in enumerate(zip(self._measured, self.predict(x, z), self._used, strict=True)):
            found.append(self.compared(g, np.where(used, y - p, 0.0))[self._together[g]].mean(axis=1))
        return found

    def as_sensed(self, x: np.ndarray, z: np.ndarray) -> list[np.ndarray]:
        """Return the same in the units of the sensors, a value per used block."""
        return [(y - p)[u] for y, p, u in zip(self._measured, self.predict(x, z), self._used, strict=True)]

    def measured(self, g: int) -> np.ndarray:
        """Return what was measured of a group, a value per used block."""
        return self._measured[g][self._used[g]]

    def _signal(self, g: int) -> np.ndarray:
        """Return what is measured of a group as it is compared, about its mean."""
        used = self._used[g]
        about = self._measured[g] - self._measured[g][used].mean()
        return self.compared(g, np.where(used, about, 0.0))[self._together[g]].mean(axis=1)

    def compared(self, g: int, difference: np.ndarray) -> np.ndarray:
        """Return a difference of all blocks of a group as it counts.

        accel_x: d(speed)/dt = difference - speed/SPEED_TIME, from 0 in every stretch; and
        the slip that the difference needs."""
        if self.groups[g][1] != "accel_x":
            return difference
        pieces = np.split(difference, np.flatnonzero(np.diff(self._time[g]) > 1.5 * BLOCK) + 1)
        return (
            np.concatenate([self._integral(p) for p in pieces])
            + self.slip_time() * self._speed[g] * difference
        )

    @staticmethod
    def _integral(difference: np.ndarray) -> np.ndarray:
        keep = float(np.exp(-BLOCK / SPEED_TIME))
        return lfilter([SPEED_TIME * (1 - keep)], [1, -keep], difference)

    def slip_time(self) -> float:
        """Return by how much [s per m/s] wheels run ahead of a car at 1 m/s that gains 1
        m/s2, with the stiffness of the prior."""
        at = dict(zip(self.prior.names, self.prior.mean, strict=True))
        front = float(np.exp(at.get("cx_front", 0.0)))
        rear = 1.0 + self.config.rear_longitudinal_follows_front * (front - 1.0)
        rear_stiffness = at.get("longitudinal_stiffness_rear", self.config.longitudinal_stiffness_rear)
        return self.config.mass / (self.config.longitudinal_stiffness_front * front + rear_stiffness * rear)

    def mean_speed(self, g: int) -> np.ndarray:
        """Return m/s, of each value that is compared of group g; not below LEAST_SPEED."""
        return np.maximum(self._speed[g][self._together[g]].mean(axis=1), LEAST_SPEED)

    def one_at_speed(self, g: int) -> np.ndarray:
        """Return rad/s: yaw rate of 1 m/s2 across."""
        return 1.0 / self.mean_speed(g)

    # ---- slopes

    def slopes(self, x: np.ndarray, z: np.ndarray, base: list[np.ndarray]) -> list[np.ndarray]:
        """Return d(residuals)/dx by differences, a matrix per group. What is of one log
        acts on it alone, so one simulation serves the lean of each; a bias needs none."""
        runs = [[k] for k in range(self.car)] + [list(range(self.car, self.car + self.leans))]
        tables = [np.zeros((len(r), len(x))) for r in base]
        for g, (i, c) in enumerate(self.groups):
            if c in BIAS_SD:
                one = self.compared(g, np.where(self._used[g], -1.0, 0.0))[self._together[g]].mean(axis=1)
                tables[g][:, self.names.index(bias_of(c, i))] = one

        def run(members: list[int]) -> None:
            moved, by = x.copy(), {}
            for k in members:
                h = STEPS[self.names[k] in COMPLIANCE] * self.sd[k]
                by[k] = h if x[k] + h <= self.high[k] else -h
                moved[k] += by[k]
            changed = self.residuals(moved, z)
            for g, (i, _) in enumerate(self.groups):
                for k in members:
                    if k < self.car or k - self.car == i:
                        tables[g][:, k] = (changed[g] - base[g]) / by[k]

        with ThreadPoolExecutor(self.jobs) as pool:  # the library runs without Python's lock
            list(pool.map(run, runs))
        return tables

    def road_slopes(self, x: np.ndarray, z: np.ndarray, base: list[np.ndarray]) -> list[csc_matrix]:
        """Return d(residuals)/dz by differences, a sparse matrix per group."""
        size = len(z)
        parts: list[tuple[list, list, list]] = [([], [], []) for _ in base]

        def run(step: np.ndarray) -> None:
            changed = self.residuals(x, z + step)
            for g, (i, _) in enumerate(self.groups):
                at = self.road.acting(i, self._place[g], step)
                rows = np.flatnonzero(at >= 0)
                for part, values in zip(
                    parts[g], (rows, at[rows], (changed[g] - base[g])[rows] / STEP), strict=True
                ):
                    part.append(values)

        if size:
            with ThreadPoolExecutor(self.jobs) as pool:
                list(pool.map(run, self.road.moves()))
        shapes = [(len(r), size) for r in base]
        return [
            sparse(*part, shape) if part[0] else csc_matrix(shape)
            for part, shape in zip(parts, shapes, strict=True)
        ]

    @property
    def knots(self) -> int:
        """Return the length of z."""
        return 0 if self.road is False else len(self.road)

    knot_sd = KNOT_SD

    # ---- what lasts of residuals

    def piece(self, g: int, residual: np.ndarray) -> Piece:
        """Return residuals of a group with the size of their channel."""
        level = self.compared(g, self._measured[g])
        square = compute_moving_average(level**2, max(1, round(ACTIVE_TIME / BLOCK)))
        return Piece(self.time[g], np.sqrt(square[self._together[g]].mean(axis=1)), residual)

    def lasting(self, residuals: list[np.ndarray]) -> dict[str, Lasting]:
        """Return what lasts of them, of each channel of the filter."""
        pieces = {
            c: [self.piece(g, residuals[g]) for g, (_, own) in enumerate(self.groups) if own == c]
            for c in self.channels
            if c in MEASURED
        }
        return {c: measure(p) for c, p in pieces.items()}


def known_car(problem: Problem, x: np.ndarray) -> Config:
    """Return the car as settings, stiffness in them."""
    config, _, stiffness = problem.settings(x)
    for key, setting in NOMINAL.items():
        setattr(config, setting, getattr(config, setting) * stiffness[key])
    config.longitudinal_stiffness_rear *= 1.0 + config.rear_longitudinal_follows_front * (
        stiffness["cx_front"] - 1.0
    )
    return config


def lateness(values: Mapping[str, float]) -> dict[str, float]:
    """Return the latency [s] of each channel that has one, against yaw_rate."""
    return {c: values.get(c + LATENCY, 0.0) for c in LATE}


def as_measured(found: Mapping[str, np.ndarray], config: Config, log: Prepared) -> dict[str, np.ndarray]:
    """Return simulated velocities as an INS or a receiver has them: at its place, in its
    axes, as late as it is.

    v_x' = v_x - r y, v_y' = v_y + r x at the place (x, y); axes turned to the left by the heading."""
    vx, vy, rate = (found[n] for n in MOTION)
    vx, vy = vx - rate * config.velocity_lever_y, vy + rate * config.velocity_lever_x
    turn = config.velocity_heading
    made = {
        "ins_vel_x": np.cos(turn) * vx + np.sin(turn) * vy,
        "ins_vel_y": np.cos(turn) * vy - np.sin(turn) * vx,
        "gnss_speed": np.hypot(vx, vy),
    }
    late = config.velocity_latency
    return {c: log.earlier(x, late) for c, x in made.items() if c in log.measured}
