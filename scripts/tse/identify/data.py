"""Prepare logs for `tselab calibrate` and `tselab gap`.

Inputs are smoothed, rows are divided into stretches (see FitStretch) and these into
blocks of BLOCK_TIME, and the noise of the sensors is estimated.

Inputs of the model are steering angle and wheel speeds. The tyre model differentiates
them and so amplifies their noise. Longitudinal relaxation is a low pass and reduces the
noise. So from inputs that are not smoothed, a fit would get too long a relaxation length.

The smoothing spline is the fixed-interval (RTS) smoother of a signal whose derivative is
a random walk. Its penalty is set by cross-validation: every second row is predicted from
the other rows.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.linalg import solveh_banded
from scipy.ndimage import gaussian_filter1d
from scipy.optimize import minimize_scalar

from tse.identify.unknowns import MAX_FITTED_LATENCY, VELOCITY
from tse.library.core import Config, Replay
from tse.library.errors import UserError
from tse.log.noise import estimate_channel_noise, estimate_noise, fill_gaps, find_new_values
from tse.log.rows import DRIVES, MEASURES, CheckedLog

COMPARED_CHANNELS = MEASURES
MIN_FIT_SPEED = 3.0  # [m/s] below it, the tyre model does not hold and wheel speeds are coarse
DIVERGED = 1e4  # [rad/s, m/s, m/s2] value of all channels of a simulation that diverges
MAX_FIT_STEER = 0.6  # [rad] at the wheels; beyond, the model does not hold
BLOCK_TIME = 0.04  # [s] length of a block; residuals are compared as means over blocks
BURN_IN = 1.0  # [s] first part of a stretch; not compared, because the initial state is unknown
MIN_STRETCH_TIME = 3.0  # [s] shorter stretches are not used: their burn-in is too large a share
MAX_HOLE = 0.1  # [s] a longer hole in an input ends a stretch
# [m] sd of the Gaussian that smooths the curvature of a road in compute_curve_accel().
# A fit assumes that the bank is proportional to the smoothed curvature: the bank of a
# road changes gradually at both ends of a curve.
CURVE_LENGTH = 12.0


@dataclass
class FitStretch:
    """Consecutive rows of a log without a hole, a stop or an extreme steering angle."""

    first: int
    last: int  # exclusive
    used: np.ndarray  # bool, for rows first .. last - 1. True: compared; False: only simulated


@dataclass
class PreparedLog:
    """A log that is prepared for simulation and comparison.

    Arrays have one entry per row. Dictionaries have the names of channels as keys.
    """

    path: Path
    time: np.ndarray  # [s]
    inputs: dict[str, np.ndarray]  # smoothed inputs of the model
    measured: dict[str, np.ndarray]  # compared channels; missing or repeated values are NaN
    noise: dict[str, float]  # sd of the sensor noise in one row, for each compared channel
    stretches: list[FitStretch]
    rows_per_block: int
    distance: np.ndarray  # [m] travelled since the first row
    notes: list[str] = field(default_factory=list)
    # for channels whose noise was raised to a lower limit: ratio of original to raised sd
    quiet: dict[str, float] = field(default_factory=dict)
    # [s] for channels that repeat their samples: mean time since the last new sample,
    # over all rows with a value (_compute_age())
    held: dict[str, float] = field(default_factory=dict)
    wheel_noise: float = 0.0  # [rad/s] rms of the part of wheel speeds that smoothing removed
    # [s] Latency of measured channels relative to the gyro. simulate() delays the
    # simulated channels by it. The latencies of the inputs are already removed from
    # `inputs`.
    late: dict[str, float] = field(default_factory=dict)
    road: dict[str, np.ndarray] = field(default_factory=dict)  # [rad] bank and grade, if they are logged
    _splines: dict[str, CubicSpline] = field(default_factory=dict, init=False, repr=False, compare=False)

    @property
    def name(self) -> str:
        """Name of the file without its suffix."""
        return self.path.stem

    @property
    def channels(self) -> list[str]:
        """Names of the compared channels that the log has."""
        return [c for c in COMPARED_CHANNELS if c in self.measured]

    @property
    def step(self) -> float:
        """Median time between rows [s]."""
        return float(np.median(np.diff(self.time)))

    @property
    def seconds(self) -> float:
        """Total time that is compared [s]."""
        return self.step * sum(int(s.used.sum()) for s in self.stretches)

    def read_later(self, name: str, by: float, rows: slice = slice(None)) -> np.ndarray:
        """Return an input at the given rows, with its latency `by` [s] removed.

        A latency delays the values in the log, so the value for a row at time t is read
        at time t + by.
        """
        spline = self._splines.get(name)
        if spline is None:
            spline = self._splines[name] = CubicSpline(self.time, self.inputs[name])
        return spline(np.clip(self.time[rows] + by, self.time[0], self.time[-1]))

    def delay(self, x: np.ndarray, by: float) -> np.ndarray:
        """Delay a simulated signal, one value per row, by a latency [s].

        The result is NaN between stretches.
        """
        if not by:
            return x
        out = np.full(len(x), np.nan)
        for s in self.stretches:
            time = self.time[s.first : s.last]
            out[s.first : s.last] = np.interp(time - by, time, x[s.first : s.last])
        return out


def prepare(log: CheckedLog, config: Config) -> PreparedLog:
    """Smooth the inputs of a log, find the stretches that can be simulated (FitStretch),
    and estimate the noise of the compared channels.

    Raises
    ------
    UserError
        The median time between rows is longer than 0.1 s, or the log has a single row.
    """
    if log.sample_time is None or log.sample_time > 0.1:
        raise UserError(
            f"{log.path}: rows are too far apart for a comparison with a simulation; allowed: at most 0.1 s "
            "(median)"
        )
    raw = {name: log.data[name].to_numpy(float) for name in DRIVES}
    measured = {
        name: np.where(find_new_values(x), x, np.nan)
        for name in MEASURES
        for x in (log.data[name].to_numpy(float),)
    }
    measured = {name: x for name, x in measured.items() if np.isfinite(x).any()}
    moving = (
        np.abs(0.5 * (raw["wheel_speed_front"] + raw["wheel_speed_rear"])) * config.wheel_radius_front
        > MIN_FIT_SPEED
    )
    inputs = {name: _smooth_channel(log, name, x) for name, x in raw.items()}
    v = compute_speed(inputs, config)
    good = (v > MIN_FIT_SPEED) & (np.abs(inputs["steer_angle"]) < MAX_FIT_STEER)
    for x in raw.values():
        good &= ~_find_holes(log.time, x)
    noise, quiet = {}, {}
    for name, x in measured.items():
        found = (
            estimate_noise(log, name, moving)
            if name in log.slower
            else estimate_channel_noise(name, x, moving)
        )
        noise[name] = found.sd if found else _estimate_noise(x)
        if found and found.unraised < found.sd:
            quiet[name] = found.unraised / found.sd
    per_block = max(1, round(BLOCK_TIME / log.sample_time))
    stretches = _find_stretches(log.time, good, per_block)
    distance = np.append(0.0, np.cumsum(np.maximum(v[1:], 0.0) * np.minimum(np.diff(log.time), 1.0)))
    for name in (n for n in VELOCITY if n in log.extra):
        x = log.extra[name].to_numpy(float)
        measured[name] = np.where(find_new_values(x), x, np.nan)
        noise[name] = _estimate_noise(measured[name])
    absent = [name for name in MEASURES if name not in measured]
    notes = []
    if absent:
        notes.append(
            f"{log.path.name}: has no {', '.join(absent)}: unknowns that only these channels determine keep "
            "their prior"
        )
    if not stretches:
        notes.append(
            f"{log.path.name}: has no stretch of {MIN_STRETCH_TIME:g} s with a speed above "
            f"{MIN_FIT_SPEED:g} m/s and a steering angle below {MAX_FIT_STEER:g} rad"
        )
    held = {
        name: age
        for name in (*DRIVES, *MEASURES)
        if (age := _compute_age(log.time, log.data[name].to_numpy(float))) > 0
    }
    off = [
        np.concatenate([(raw[n] - inputs[n])[s.first : s.last] for s in stretches])
        for n in DRIVES[1:]
        if stretches
    ]
    wheel_noise = max((float(np.sqrt(np.nanmean(x**2))) for x in off), default=0.0)
    road = {n: np.nan_to_num(log.extra[n].to_numpy(float)) for n in ("bank", "grade") if n in log.extra}
    return PreparedLog(
        log.path, log.time, inputs, measured, noise, stretches, per_block, distance,
        notes, quiet, held, wheel_noise, road=road,
    )  # fmt: skip


def add_missing_channels(log: PreparedLog) -> PreparedLog:
    """Return the log with a column of NaN for each sensor that it lacks."""
    nothing = np.full(len(log.time), np.nan)
    return replace(log, measured={c: log.measured.get(c, nothing) for c in (*MEASURES, *log.measured)})


def compute_speed(inputs: Mapping[str, np.ndarray], config: Config) -> np.ndarray:
    """Return the speed [m/s] of each row: the mean of both axles' wheel speeds."""
    return 0.5 * sum(
        getattr(config, f"wheel_radius_{a}") * inputs[f"wheel_speed_{a}"] for a in ("front", "rear")
    )


def prepare_all(logs: Sequence[CheckedLog], config: Config) -> list[PreparedLog]:
    """Prepare every log and remove the latencies that the vehicle file states."""
    return [remove_latencies(prepare(log, config), config) for log in logs]


def remove_latencies(log: PreparedLog, config: Config) -> PreparedLog:
    """Return the log without the latencies that the vehicle file states.

    With the latency L, the log has the true value of time t in the row of time t + L. So
    each row of an input gets the value that is logged one latency later. Measured
    channels are not changed. Instead, simulate() delays the simulated channel.
    """
    late = {c: by for c in (*DRIVES, *MEASURES) if (by := getattr(config, f"{c}_latency", 0.0))}
    if not late:
        return log
    ends = log.time[0], log.time[-1]
    inputs = {
        n: CubicSpline(log.time, x)(np.clip(log.time + late.get(n, 0.0), *ends))
        for n, x in log.inputs.items()
    }
    return replace(log, inputs=inputs, late={c: by for c, by in late.items() if c in log.measured})


def _smooth_channel(log: CheckedLog, name: str, x: np.ndarray) -> np.ndarray:
    """Smooth a channel at the rows of a log.

    If the channel was interpolated, its original samples are smoothed. Interpolated
    values follow from their neighbours, so cross-validation would find no noise in them.
    """
    if name not in log.slower:
        return smooth_values(log.time, x)
    own = log.slower[name]
    spline = fit_smoothing_spline(own.time, own.value)
    return fill_gaps(x) if spline is None else spline(np.clip(log.time, own.time[0], own.time[-1]))


def smooth_values(time: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Smooth x by a spline; if it has no noise or few values, only fill its gaps."""
    spline = fit_smoothing_spline(time, x)
    return fill_gaps(x) if spline is None else spline(time)


def fit_smoothing_spline(time: np.ndarray, x: np.ndarray) -> CubicSpline | None:
    """Return the smoothing spline of x; None if x has few values or no noise.

    Missing values and values that repeat an old sample are left out.
    """
    good = np.isfinite(x) & find_new_values(x)
    y = x[good]
    if len(y) < 8 or np.std(np.diff(y, 3)) <= 1e-9 * max(1.0, float(np.max(np.abs(y)))):
        return None
    return solve_smoothing_spline(time[good], y, _choose_penalty(time[good], y))


def _compute_age(time: np.ndarray, x: np.ndarray) -> float:
    """Return the mean age [s] of the values of a channel. It is 0 if the channel has a
    new value in every row, and larger if the channel repeats its samples.

    The age of a value is the time since the row in which this value was new.
    """
    there = np.isfinite(x)
    if not there.any():
        return 0.0
    new = np.maximum.accumulate(np.where(find_new_values(x), np.arange(len(x)), 0))
    return float(np.mean((time - time[new])[there]))


def _choose_penalty(time: np.ndarray, y: np.ndarray) -> float:
    """Return the best penalty of a smoothing spline, by cross-validation.

    With this penalty, a spline of every second row predicts the other rows best.

    The best penalty is noise variance of a row / variance of the random walk after 1 s
    (top of this file). It does not depend on the number of rows, so it also suits the
    spline of all rows.
    """

    def compute_error(exponent: float) -> float:
        spline = solve_smoothing_spline(time[::2], y[::2], 10.0**exponent)
        return float(np.mean((spline(time[1::2]) - y[1::2]) ** 2))

    step = float(np.median(np.diff(time)))
    around = np.log10(step**3)  # a penalty of step^3 averages over about one row
    coarse = [around + k for k in np.arange(-3.0, 9.0, 1.5)]
    best = coarse[int(np.argmin([compute_error(x) for x in coarse]))]
    bounds = best - 1.5, best + 1.5
    found = minimize_scalar(compute_error, bounds=bounds, method="bounded", options={"xatol": 0.15})
    return 10.0 ** float(found.x)


def average_blocks(log: PreparedLog, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return for each compared block the mean of x, and the number of finite values."""
    parts = []
    for s in log.stretches:
        piece = x[s.first : s.last][s.used]
        parts.append(
            piece[: len(piece) // log.rows_per_block * log.rows_per_block].reshape(-1, log.rows_per_block)
        )
    table = np.concatenate(parts)
    good = np.isfinite(table)
    count = good.sum(axis=1)
    return np.where(good, table, 0.0).sum(axis=1) / np.maximum(count, 1), count


def _find_holes(time: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Mark the rows that are further than half of MAX_HOLE from a finite value."""
    good = np.isfinite(x)
    there = time[good]
    after = np.searchsorted(there, time)
    left = time - there[np.clip(after - 1, 0, len(there) - 1)]
    right = there[np.clip(after, 0, len(there) - 1)] - time
    return np.minimum(np.abs(left), np.abs(right)) > 0.5 * MAX_HOLE


def _estimate_noise(x: np.ndarray) -> float:
    """Return the sd of the white noise of a channel, from its second differences. With
    fewer than 8 finite values, return 1e-6.
    """
    good = x[np.isfinite(x)]
    if len(good) < 8:
        return 1e-6
    return 1.4826 * float(np.median(np.abs(np.diff(good, 2)))) / np.sqrt(6)


def _find_stretches(time: np.ndarray, good: np.ndarray, per_block: int) -> list[FitStretch]:
    """Return the stretches: runs of good rows that last at least MIN_STRETCH_TIME.

    Each is cut to whole blocks of `per_block` rows.
    """
    broken = np.append(True, ~good[1:] | ~good[:-1] | (np.diff(time) > MAX_HOLE)) | ~good
    starts = np.flatnonzero(broken & good)
    stretches = []
    for first in starts:
        last = first + 1
        while last < len(good) and good[last] and not broken[last]:
            last += 1
        if time[last - 1] - time[first] < MIN_STRETCH_TIME:
            continue
        last = first + (last - first) // per_block * per_block
        used = time[first:last] - time[first] >= BURN_IN
        # the burn-in, which is not used, is lengthened to whole blocks
        used[: int(np.argmax(used)) // per_block * per_block + per_block] = False
        stretches.append(FitStretch(int(first), int(last), used))
    return stretches


def solve_smoothing_spline(time: np.ndarray, y: np.ndarray, penalty: float) -> CubicSpline:
    """Return the f that minimises sum (y - f(time))^2 + penalty * integral of f''^2.

    Parameters
    ----------
    time
        (n,) increasing, n >= 3.
    y
        (n,) values.
    penalty
        >= 0, in the unit of time to the power 3.

    Notes
    -----
    Reinsch 1967; Green & Silverman 1994, section 2.3. The function
    scipy.interpolate.make_smoothing_spline() returns the same but is 30 times slower (one
    minute for a log of half an hour), because it loops over the rows in Python.
    """
    h = np.diff(time)
    # coefficients of the second difference at a row, the row before and the row after
    before, here, after = 1 / h[:-1], -1 / h[:-1] - 1 / h[1:], 1 / h[1:]
    bands = np.zeros((3, len(h) - 1))
    bands[2] = (h[:-1] + h[1:]) / 3 + penalty * (before**2 + here**2 + after**2)
    bands[1, 1:] = h[1:-1] / 6 + penalty * (here[:-1] * before[1:] + after[:-1] * here[1:])
    bands[0, 2:] = penalty * after[:-2] * before[2:]
    bend = penalty * solveh_banded(bands, np.diff(np.diff(y) / h))
    smooth = np.array(y, float)
    smooth[:-2] -= before * bend
    smooth[1:-1] -= here * bend
    smooth[2:] -= after * bend
    return CubicSpline(time, smooth, bc_type="natural")


# ---- simulation of a log: every stretch is simulated from its own initial state


def simulate(
    config: Config,
    log: PreparedLog,
    channels: Sequence[str],
    stiffness: dict[str, float],
    profiles: dict[str, np.ndarray],
    later: Mapping[str, float] | None = None,
) -> dict[str, np.ndarray]:
    """Simulate the channels of a log. The result has the latencies of the channels, but
    no biases.

    Parameters
    ----------
    config
        Settings of the car.
    log
        Log with the inputs of the model.
    channels
        Outputs of the model that are returned.
    stiffness
        Name of a stiffness -> ratio of its value at the start of the simulation to its
        setting in `config`.
    profiles
        Bank and grade [rad] of each row. Bank and grade in the log are added to them.
    later
        Channel -> latency [s] that is added to the latency in the vehicle file.

    Returns
    -------
    By channel, one value per row: NaN between stretches, DIVERGED in a stretch whose
    simulation diverges.
    """
    later = later or {}
    road = {n: profiles.get(n, 0.0) + log.road.get(n, 0.0) for n in {**profiles, **log.road}}
    out = {c: np.full(len(log.time), np.nan) for c in channels}
    for s in log.stretches:
        rows = slice(s.first, s.last)
        dt = np.diff(log.time[rows], prepend=log.time[s.first] - 0.01)
        inputs = {n: x[rows] for n, x in (log.inputs | road).items()}
        inputs |= {n: log.read_later(n, by, rows) for n, by in later.items() if by and n in log.inputs}
        replay = Replay(tuple(channels), dt=dt, **inputs)
        gyro = log.measured["yaw_rate"][s.first] if "yaw_rate" in log.measured else np.nan
        start = {
            "yaw_rate": float(gyro) if np.isfinite(gyro) else 0.0,
            "time": float(log.time[s.first] - log.time[0]),
        }
        try:
            found = replay.run(config, **start, **stiffness)
        except UserError:  # the simulation diverged: large residuals make a search reject this car
            found = {c: np.full(len(dt), DIVERGED) for c in channels}
        for c, x in found.items():
            late, t = log.late.get(c, 0.0) + later.get(c, 0.0), log.time[rows]
            out[c][rows] = np.interp(t - late, t, x) if late else x
    return out


# ---- preparation of a log for the comparison


def compute_curve_accel(log: PreparedLog, config: Config) -> np.ndarray:
    """Return v^2 times the curvature of the road [m/s2] for each row, with the speed v.

    A fit assumes that the bank of a road in a curve is proportional to this value. The
    curvature of the road is unknown. The curvature of the car's path, yaw rate / v, is
    used in its place, smoothed over CURVE_LENGTH. Without a yaw rate the result is 0.
    """
    rate, v = log.measured["yaw_rate"], np.maximum(compute_speed(log.inputs, config), MIN_FIT_SPEED)
    if not np.isfinite(rate).any():
        return np.zeros(len(rate))
    metres = np.arange(0.0, log.distance[-1] + 1.0)
    curvature = np.interp(metres, log.distance, fill_gaps(rate) / v)
    return v**2 * np.interp(log.distance, metres, gaussian_filter1d(curvature, CURVE_LENGTH))


def mark_inside(log: PreparedLog) -> np.ndarray:
    """Return for each row 1 if its inputs can be read inside its stretch at every latency
    that a fit may try, otherwise 0.

    An input with latency L is read at t + L, and L is at most MAX_FITTED_LATENCY. So rows
    less than MAX_FITTED_LATENCY before the end of their stretch get 0. Rows at the start,
    where a negative L would matter, lie in BURN_IN and are not compared.
    """
    found = np.zeros(len(log.time))
    for s in log.stretches:
        found[s.first : s.last] = log.time[s.first : s.last] <= log.time[s.last - 1] - MAX_FITTED_LATENCY
    return found


def group_blocks(time: np.ndarray, used: np.ndarray, count: int) -> np.ndarray:
    """Form groups of `count` consecutive blocks, and drop incomplete groups.

    `time` [s] and `used` have one entry per block. A group contains only blocks for which
    `used` is True. No group extends across a gap in time.

    Returns
    -------
    Indices of the blocks, one row per group.
    """
    index = np.flatnonzero(used)
    runs = np.split(
        index, np.flatnonzero((np.diff(index) > 1) | (np.diff(time[index]) > 1.5 * BLOCK_TIME)) + 1
    )
    return np.concatenate([r[: len(r) // count * count].reshape(-1, count) for r in runs])
