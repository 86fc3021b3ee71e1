"""Logs against the model: what the sensors would read with these unknowns, and the slopes of that.

The gyro is the clock. A channel that is late by L has at time t what was true at t - L: inputs are read L later, what is simulated
of a measured channel is compared L earlier.

accel_x is compared as what it adds to the speed within SPEED_TIME. Driven by wheel speeds, its simulation is their slope, and has
the slope of their noise in it: compared as an acceleration, whatever makes the simulation smoother fits better - tyres at half
their stiffness, wheels that are late. As a speed, that noise is white and small; what remains of it is in scripts/results/cars.md.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import lfilter

from tselab.core import NOMINAL, Config, Replay
from tselab.gap.data import BLOCK, Prepared, blocks
from tselab.identify.discrepancy import ACTIVE_TIME, Piece
from tselab.identify.unknowns import LATE, LATENCY, MEASURED, MOST_LATENCY, OWN_SD, STIFFNESS, Prior
from tselab.noise import smooth

STEP = 0.02  # of finite differences, in prior sd
SPEED_TIME = 1.0  # s
FEWEST = 25  # blocks of a channel in a log, to compare it
ENOUGH = 0.5  # rows with a value in a block, over the usual number


class Problem:
    """All logs. The vector x holds the unknowns of the car, in the order of the prior, and then three of each log: ln of its
    stiffness over the car's."""

    def __init__(self, logs: Sequence[Prepared], config: Config, prior: Prior, jobs: int = 1):
        self.logs = [log for log in logs if log.stretches]
        self.config, self.prior, self.jobs = config, prior, max(1, jobs)
        self.nominal = config.as_dict()
        own = len(self.logs) * len(STIFFNESS)
        self.names = (*prior.names, *(f"{s}@{i}" for i in range(len(self.logs)) for s in STIFFNESS))
        self.car = len(prior.names)
        self.mean = np.append(prior.mean, np.zeros(own))
        self.covariance = np.zeros((len(self.names), len(self.names)))
        self.covariance[: self.car, : self.car] = prior.covariance
        self.covariance[self.car :, self.car :] = OWN_SD**2 * np.eye(own)
        self.information = np.linalg.inv(self.covariance)
        self.sd = np.sqrt(np.diag(self.covariance))
        self.low = np.append(prior.low, np.full(own, -6 * OWN_SD))
        self.high = np.append(prior.high, np.full(own, 6 * OWN_SD))
        self._inputs = [{n: CubicSpline(log.time, x) for n, x in log.inputs.items()} for log in self.logs]
        self.groups: list[tuple[int, str]] = []  # of residuals: log and channel
        self._measured, self.used, self.time, self.count, self.size, self._bias = [], [], [], [], [], []
        for i, log in enumerate(self.logs):
            for c in MEASURED:
                value, count = blocks(log, log.measured[c])
                usual = float(np.median(count[count > 0])) if count.any() else 1.0
                used = (count > ENOUGH * usual) & (blocks(log, inside(log))[0] == 1)
                if used.sum() >= FEWEST:
                    self.groups.append((i, c))
                    self._measured.append(value)
                    self.used.append(used)
                    self.time.append(blocks(log, log.time)[0])
                    self.count.append(count)
        for g in range(len(self.groups)):
            compared, bias = self._compared(g, self._measured[g]), self._compared(g, np.ones(len(self._measured[g])))
            self.size.append(smooth(compared**2, max(1, round(ACTIVE_TIME / BLOCK))) ** 0.5)
            self._bias.append(bias[self.used[g]])
        self.channels = tuple(c for c in MEASURED if any(c == channel for _, channel in self.groups))

    # ---- the model

    def settings(self, x: np.ndarray) -> tuple[Config, dict[str, float], list[dict[str, float]]]:
        """Settings of the simulation, latencies, and stiffness of each log over the vehicle file's."""
        at = dict(zip(self.names, map(float, x), strict=True))
        values, late = dict(self.nominal), {c: self.nominal.get(c + LATENCY, 0.0) for c in LATE}
        for name in (n for n in self.prior.names if n not in NOMINAL):
            if name.endswith(LATENCY):
                late[name.removesuffix(LATENCY)] = at[name]
            else:
                values[name] = at[name]
        stiffness = [{s: float(np.exp(at[s] + at[f"{s}@{i}"])) for s in STIFFNESS} for i in range(len(self.logs))]
        return Config(values), late, stiffness

    def simulate(self, i: int, x: np.ndarray) -> dict[str, np.ndarray]:
        """What the measured channels of a log would read, a value per row, without bias; NaN between stretches."""
        config, late, stiffness = self.settings(x)
        log, inputs = self.logs[i], self._inputs[i]
        out = {c: np.full(len(log.time), np.nan) for c in MEASURED}
        for s in log.stretches:
            rows = slice(s.first, s.last)
            t = log.time[rows]
            given = {n: x[rows] for n, x in log.inputs.items()}
            given |= {n: inputs[n](np.clip(t + late[n], log.time[0], log.time[-1])) for n in given if late.get(n)}
            replay = Replay(MEASURED, dt=np.diff(t, prepend=t[0] - 0.01), **given)
            gyro = log.measured["yaw_rate"][s.first]
            start = float(gyro) if np.isfinite(gyro) else 0.0
            found = replay.run(config, yaw_rate=start, time=float(t[0] - log.time[0]), **stiffness[i])
            for c in MEASURED:
                lag = late.get(c, 0.0)
                out[c][rows] = CubicSpline(t, found[c])(np.clip(t - lag, t[0], t[-1])) if lag else found[c]
        return out

    def predict(self, x: np.ndarray) -> list[np.ndarray]:
        """The same as blocks, a vector per group."""
        simulated = [self.simulate(i, x) for i in range(len(self.logs))]
        found = []
        for i, c in self.groups:
            there = np.isfinite(self.logs[i].measured[c])
            found.append(blocks(self.logs[i], np.where(there, simulated[i][c], np.nan))[0])
        return found

    def residuals(self, x: np.ndarray) -> list[np.ndarray]:
        """Measured less predicted as they are compared, a vector of used blocks per group: accel_x in m/s."""
        apart = zip(self._measured, self.predict(x), self.used, strict=True)
        return [self._compared(g, np.where(u, y - p, 0.0))[u] for g, (y, p, u) in enumerate(apart)]

    def as_sensed(self, x: np.ndarray) -> list[np.ndarray]:
        """The same in the units of the sensors."""
        return [(y - p)[u] for y, p, u in zip(self._measured, self.predict(x), self.used, strict=True)]

    def _compared(self, g: int, difference: np.ndarray) -> np.ndarray:
        """accel_x: d(speed)/dt = difference - speed/SPEED_TIME, from 0 in every stretch."""
        if self.groups[g][1] != "accel_x":
            return difference
        keep = float(np.exp(-BLOCK / SPEED_TIME))
        pieces = np.split(difference, np.flatnonzero(np.diff(self.time[g]) > 1.5 * BLOCK) + 1)
        return np.concatenate([lfilter([SPEED_TIME * (1 - keep)], [1, -keep], piece) for piece in pieces])

    def slopes(self, x: np.ndarray, base: list[np.ndarray]) -> list[np.ndarray]:
        """d(residuals)/dx by differences, a matrix per group. What is of one log acts on it alone, so one simulation serves one
        number of each log; and the car's stiffness acts as that of all logs together."""
        own = [[self.car + 3 * i + k for i in range(len(self.logs))] for k in range(len(STIFFNESS))]
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
                    if k < self.car or (k - self.car) // 3 == i:
                        tables[g][:, k] = (changed[g] - base[g]) / step[k]

        with ThreadPoolExecutor(self.jobs) as pool:  # the library runs without Python's lock
            list(pool.map(run, alone + own))
        for table, (i, _) in zip(tables, self.groups, strict=True):
            for k, name in enumerate(STIFFNESS):
                table[:, self.prior.names.index(name)] = table[:, self.car + 3 * i + k]
        return tables

    def pieces(self, residuals: list[np.ndarray], channel: str) -> list[Piece]:
        """The residuals of a channel, of all logs that have it."""
        return [self.piece(g, residuals[g]) for g, (_, c) in enumerate(self.groups) if c == channel]

    def piece(self, g: int, residual: np.ndarray) -> Piece:
        used = self.used[g]
        return Piece(self.time[g][used], self.count[g][used], self.size[g][used], self._bias[g], residual)


def inside(log: Prepared) -> np.ndarray:
    """1 for rows whose channels are in the same stretch whatever their latency; at its start BURN_IN sees to that."""
    found = np.zeros(len(log.time))
    for s in log.stretches:
        found[s.first : s.last] = log.time[s.first : s.last] <= log.time[s.last - 1] - MOST_LATENCY
    return found
