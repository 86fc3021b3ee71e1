"""Logs against the model: what the sensors would read with these unknowns, and the slopes of that.

The gyro is the clock. A channel that is late by L has at time t what was true at t - L: inputs are read L later, what is simulated
of a measured channel is compared L earlier. Where values are held, L is how old they are on average.

accel_x is compared as a wheel speed: with e = measured - simulated, v the speed and C the sum of the longitudinal stiffnesses,
    y = integral of e, leaking within SPEED_TIME, + (m v/C) e
which is, for a car that follows its wheels with the lag m v/C, how far the wheel speeds are from those that the accelerometer asks
for. Driven by wheel speeds alone, the simulation has the slope of their noise, and soft tyres and wheels that are late smooth it:
as an acceleration both fit better than the truth. What is in y does not depend on the tyres.

Between wheels and accel_x only the difference of their latencies counts; accel_y and yaw_rate are compared with a car whose wheels
are in time (a cut: Liu, Bayarri & Berger 2009, Plummer 2015). The speed hardly moves within a latency, but every percent by which
braking changes the tyres otherwise than the model has it does so at that time: yaw_rate, the most exact of all channels, then says
0.1 s. How late both are behind the gyro is left to the prior.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from scipy.linalg import block_diag
from scipy.signal import lfilter

from tse.impl.core import NOMINAL, Config
from tse.impl.identify.data import BLOCK, Prepared, blocks, calm, curves, inside, simulate, speed, together
from tse.impl.identify.discrepancy import ACTIVE_TIME, Discrepancy, Piece, cost, found
from tse.impl.identify.unknowns import (
    LATE,
    LATENCIES,
    LATENCY,
    MEASURED,
    OWN,
    OWN_MEAN,
    OWN_SD,
    STIFFNESS,
    SUPERELEVATION,
    Prior,
    of_log,
)
from tse.impl.noise import smooth
from tse.impl.vehicle import GRAVITY

STEP = 0.02  # of finite differences, in prior sd
SPEED_TIME = 1.0  # s: in the comparison of accel_x; longer lets the grade of the road in, shorter its noise
SPEED_BLOCKS = 10  # blocks: that are one in the comparison of accel_x: a second holds two or three numbers
LEAST_SPEED = 5.0  # m/s: below, slip is not observable
FEWEST = 25  # blocks: of a channel in a log, to compare it
ENOUGH = 0.5  # rows with a value in a block, over the usual number
UNLIKE_SD = 0.03  # share by which the car is unlike the model, of each of the shapes of that
# the likelihood counts so much (a power posterior: Miller & Dunson 2019): where a model of another car is wrong it is
# so for hours, and no length of log makes it right. On four cars with 14 degrees of freedom bands with 1 held
# relaxation in two, inertia in three
POWER = 0.25
HARD = (3.0, 20.0)  # m/s2 along, m/s: of shapes that are about 1 where a driver goes hard
LEAN = "bank_superelevation"
# Channels that are simulated together, and the inputs that are read on the clock of accel_x; else they are in time.
CUT = ((("accel_x",), ("wheel_speed_front", "wheel_speed_rear")), (("accel_y", "yaw_rate"), ()))
# How the car is unlike the model, as a function of what it does (Kennedy & O'Hagan 2001): a share of the channel that goes with
# SHAPES, each about 1 where a driver goes hard. None goes with the square of accel_y: that is the curve of the tyres, whose
# friction is an unknown, and such a share would take its place.
UNLIKE = ("accel_y", "yaw_rate")
SHAPES = ("ax", "ax v", "ax^2", "v")


def shapes(along: np.ndarray, v: np.ndarray) -> np.ndarray:
    """SHAPES as columns, of accel_x [m/s2] and speed [m/s]."""
    a, fast = along / HARD[0], v / HARD[1] - 1.0
    return np.column_stack([a, a * fast, a * a, fast])


class Problem:
    """All logs. The vector x holds the unknowns of the car, in the order of the prior; those of each log (OWN); and, unless
    `unlike` is False, how much of SHAPES there is in each channel of UNLIKE."""

    def __init__(self, logs: Sequence[Prepared], config: Config, prior: Prior, jobs: int = 1, unlike: bool = True):
        self.power = dict.fromkeys(MEASURED, POWER)
        self.logs = [calm(log) for log in logs if log.stretches]
        self.config, self.prior, self.jobs = config, prior, max(1, jobs)
        # how far the roads of the logs lean is found of each, around what the vehicle file says
        self.nominal = config.as_dict() | {LEAN: 0.0}
        own_mean = (*OWN_MEAN[:-1], getattr(config, LEAN) or OWN_MEAN[-1])
        count = len(self.logs)
        shares = [f"{c}~{s}" for c in UNLIKE for s in SHAPES] if unlike else []
        self.names = (*prior.names, *(of_log(s, i) for i in range(count) for s in OWN), *shares)
        self.car = len(prior.names)
        self.unlike = self.car + len(OWN) * count  # where the shares of SHAPES begin
        sd = np.array([*OWN_SD * count, *[UNLIKE_SD] * len(shares)])
        other = np.array([*own_mean * count, *[0.0] * len(shares)])
        self.mean = np.append(prior.mean, other)
        self.covariance = block_diag(prior.covariance, np.diag(sd**2))
        self.information = np.linalg.inv(self.covariance)
        self.sd = np.sqrt(np.diag(self.covariance))
        self.low = np.append(prior.low, other - 6 * sd)
        self.high = np.append(prior.high, other + 6 * sd)
        self._curves = [curves(log, config) for log in self.logs]
        self.groups: list[tuple[int, str]] = []  # of residuals: log and channel
        self.time: list[np.ndarray] = []  # of what is compared, by group
        self._measured, self._used, self._time, self._count, self._speed, self._together, self._rest = ([] for _ in range(7))
        for i, log in enumerate(self.logs):
            time, v = (blocks(log, x)[0] for x in (log.time, speed(log.inputs, config)))
            for c in MEASURED:
                value, number = blocks(log, log.measured[c])
                usual = float(np.median(number[number > 0])) if number.any() else 1.0
                used = (number > ENOUGH * usual) & (blocks(log, inside(log))[0] == 1)
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
        for g, mean in enumerate(self._together):
            measured, bias = (self._compared(g, x, self.mean) for x in (self._measured[g], np.ones(len(self._measured[g]))))
            square = smooth(measured**2, max(1, round(ACTIVE_TIME / BLOCK)))
            size = np.sqrt(square[mean].mean(axis=1))
            self._rest.append((self._count[g][mean].sum(axis=1), size, bias[mean].mean(axis=1)))
        self.channels = tuple(c for c in MEASURED if any(c == channel for _, channel in self.groups))

    # ---- the model

    def settings(self, x: np.ndarray) -> tuple[Config, dict[str, float], list[dict[str, float]]]:
        """Settings of the simulation, latencies, and stiffness of each log over the vehicle file's."""
        at = dict(zip(self.names, map(float, x), strict=True))
        values, late = dict(self.nominal), {c: self.nominal.get(c + LATENCY, 0.0) for c in LATE}
        for name in (n for n in self.prior.names if n not in NOMINAL):
            if name in LATENCIES:
                late[LATENCIES[name]] = at[name]
            else:
                values[name] = at[name]
        stiffness = [{s: float(np.exp(at[s] + at[of_log(s, i)])) for s in STIFFNESS} for i in range(len(self.logs))]
        return Config(values), late, stiffness

    def simulate(self, i: int, x: np.ndarray) -> dict[str, np.ndarray]:
        """What the measured channels of a log would read, a value per row, without bias; NaN between stretches."""
        config, late, stiffness = self.settings(x)
        log = self.logs[i]
        clock = log.held.get("yaw_rate", 0.0)
        late = {c: by - log.held.get(c, 0.0) + clock for c, by in late.items()}
        bank = -x[self.names.index(of_log(SUPERELEVATION, i))] / GRAVITY * self._curves[i]
        out = {}
        for channels, on_its_clock in CUT:
            later = {n: late[n] - late["accel_x"] for n in on_its_clock}
            later |= {n: late[n] for n in ("steer_angle", *(() if on_its_clock else channels)) if n in late}
            out |= simulate(config, log, channels, stiffness[i], {"bank": bank}, later)
        return out

    def predict(self, x: np.ndarray) -> list[np.ndarray]:
        """The same as blocks, a vector per group, and how the car is unlike it."""
        return self._predict(x)[0]

    def _predict(self, x: np.ndarray) -> tuple[list[np.ndarray], list[np.ndarray]]:
        """Also what a share of 1 of each of SHAPES adds, a matrix per group."""
        simulated = [self.simulate(i, x) for i in range(len(self.logs))]
        found, adds = [], []
        for g, (i, c) in enumerate(self.groups):
            log = self.logs[i]
            value = blocks(log, np.where(np.isfinite(log.measured[c]), simulated[i][c], np.nan))[0]
            add = np.zeros((len(value), len(x) - self.unlike))
            if c in UNLIKE and add.shape[1]:
                along = blocks(log, simulated[i]["accel_x"])[0]
                k = UNLIKE.index(c) * len(SHAPES)
                add[:, k : k + len(SHAPES)] = value[:, None] * shapes(along, self._speed[g])
            found.append(value + add @ x[self.unlike :])
            adds.append(add)
        return found, adds

    def residuals(self, x: np.ndarray) -> list[np.ndarray]:
        """Measured less predicted as they are compared, a vector per group: accel_x in m/s."""
        found = []
        for g, (y, p, used) in enumerate(zip(self._measured, self.predict(x), self._used, strict=True)):
            found.append(self._compared(g, np.where(used, y - p, 0.0), x)[self._together[g]].mean(axis=1))
        return found

    def as_sensed(self, x: np.ndarray) -> list[np.ndarray]:
        """The same in the units of the sensors, a value per used block."""
        return [(y - p)[u] for y, p, u in zip(self._measured, self.predict(x), self._used, strict=True)]

    def _compared(self, g: int, difference: np.ndarray, x: np.ndarray) -> np.ndarray:
        """accel_x: d(speed)/dt = difference - speed/SPEED_TIME, from 0 in every stretch; and the slip that the difference needs."""
        i, channel = self.groups[g]
        if channel != "accel_x":
            return difference
        keep = float(np.exp(-BLOCK / SPEED_TIME))
        pieces = np.split(difference, np.flatnonzero(np.diff(self._time[g]) > 1.5 * BLOCK) + 1)
        gained = np.concatenate([lfilter([SPEED_TIME * (1 - keep)], [1, -keep], piece) for piece in pieces])
        return gained + self.slip_time(i, x) * self._speed[g] * difference

    def slip_time(self, i: int, x: np.ndarray) -> float:
        """s per m/s: how far wheels run ahead of a car at 1 m/s that gains 1 m/s2, with the stiffness of log i."""
        config, _, stiffness = self.settings(x)
        front = stiffness[i]["cx_front"]
        rear = 1.0 + config.rear_longitudinal_follows_front * (front - 1.0)
        return config.mass / (config.longitudinal_stiffness_front * front + config.longitudinal_stiffness_rear * rear)

    def mean_speed(self, g: int) -> np.ndarray:
        """m/s, of each value that is compared of group g; not below LEAST_SPEED."""
        return np.maximum(self._speed[g][self._together[g]].mean(axis=1), LEAST_SPEED)

    def one_at_speed(self, g: int) -> np.ndarray:
        """rad/s: yaw rate of 1 m/s2 across."""
        return 1.0 / self.mean_speed(g)

    def slopes(self, x: np.ndarray, base: list[np.ndarray]) -> list[np.ndarray]:
        """d(residuals)/dx by differences, a matrix per group. What is of one log acts on it alone, so one simulation serves one
        number of each log; the car's stiffness acts as that of all logs together; shares of SHAPES need no simulation."""
        own = [[self.car + len(OWN) * i + k for i in range(len(self.logs))] for k in range(len(OWN))]
        alone = [[k] for k, name in enumerate(self.prior.names) if name not in NOMINAL]
        tables = [np.zeros((len(r), len(x))) for r in base]

        def run(members: list[int]) -> None:
            moved, step = x.copy(), {}
            for k in members:
                h = STEP * self.sd[k]
                step[k] = h if x[k] + h <= self.high[k] else -h
                moved[k] += step[k]
            changed = self.residuals(moved)
            for g, (i, _) in enumerate(self.groups):
                for k in members:
                    if k < self.car or (k - self.car) // len(OWN) == i:
                        tables[g][:, k] = (changed[g] - base[g]) / step[k]

        with ThreadPoolExecutor(self.jobs) as pool:  # the library runs without Python's lock
            list(pool.map(run, alone + own))
        for g, add in enumerate(self._predict(x)[1]):
            tables[g][:, self.unlike :] = -add[self._together[g]].mean(axis=1)
        for table, (i, _) in zip(tables, self.groups, strict=True):
            for k, name in enumerate(STIFFNESS):
                table[:, self.prior.names.index(name)] = table[:, self.car + len(OWN) * i + k]
        return tables

    def pieces(self, residuals: list[np.ndarray], channel: str) -> list[Piece]:
        """The residuals of a channel, of all logs that have it."""
        return [self.piece(g, residuals[g]) for g, (_, c) in enumerate(self.groups) if c == channel]

    def piece(self, g: int, residual: np.ndarray) -> Piece:
        return Piece(self.time[g], *self._rest[g], residual)

    def found(self, pieces: Sequence[Piece], start: Discrepancy | None, far: bool = False) -> Discrepancy:
        return found(pieces, start, far)

    def cost(self, d: Discrepancy, pieces: Sequence[Piece]) -> float:
        return cost(d, pieces)
