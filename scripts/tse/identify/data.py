"""Logs as calibration and gap workflow need them: inputs smoothed, stretches to simulate, blocks to compare, sensor noise.

Why smoothed: the model is driven by the logged steering angle and wheel speeds, and their noise, differentiated by the
tyres, would pass for a longitudinal relaxation. A smoothing spline is the fixed-interval (RTS) smoother of a signal whose
slope is a random walk; its smoothness is found by cross-validation, every second row from the others.
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

from tse.identify.unknowns import MOST_LATENCY, VELOCITY
from tse.library.core import Config, Replay
from tse.library.errors import UserError
from tse.log.noise import estimate_channel_noise, estimate_noise, fill_gaps, find_new_values
from tse.log.rows import DRIVES, MEASURES, CheckedLog

CHANNELS = MEASURES
SLOWEST = 3.0  # m/s: below it the tyre model is another one, and wheel speeds are counted too coarsely
DIVERGED = 1e4  # rad/s, m/s, m/s2: of a simulation that leaves all numbers
STEEPEST = 0.6  # rad: of road-wheel angle: beyond it the model is another one
BLOCK = 0.04  # s: residuals are averaged over so long
BURN_IN = 1.0  # s: of each stretch that are simulated, but not compared: the state starts unknown
SHORTEST = 3.0  # s: shorter stretches say less than their start costs
LONGEST_HOLE = 0.1  # s: holes in an input up to this are bridged
CURVE_LENGTH = 12.0  # m: sd of the smoothing: over which a road goes from level to leaning into its curve


@dataclass
class Stretch:
    """Rows of one log without a hole, a stop or an extreme; `used`: compared, not only simulated."""

    first: int
    last: int  # exclusive
    used: np.ndarray  # of the rows first .. last


@dataclass
class Prepared:
    """One log, ready to be simulated. Arrays have one entry per row."""

    path: Path
    time: np.ndarray
    inputs: dict[str, np.ndarray]  # smoothed
    measured: dict[str, np.ndarray]  # NaN: missing
    noise: dict[str, float]  # sd of one row
    stretches: list[Stretch]
    rows_per_block: int
    distance: np.ndarray  # m
    notes: list[str] = field(default_factory=list)
    quiet: dict[str, float] = field(
        default_factory=dict
    )  # sd that was found over that sd, where a floor raised it
    held: dict[str, float] = field(
        default_factory=dict
    )  # s since the value of a row was new, mean, where a slow signal is held
    wheel_noise: float = 0.0  # rad/s, rms of what smoothing took from the wheel speeds
    late: dict[str, float] = field(
        default_factory=dict
    )  # s behind the gyro, of what is measured; inputs are in time
    road: dict[str, np.ndarray] = field(
        default_factory=dict
    )  # rad: bank and grade of each row, where they are known
    _splines: dict[str, CubicSpline] = field(default_factory=dict, init=False, repr=False, compare=False)

    @property
    def name(self) -> str:
        return self.path.stem

    @property
    def channels(self) -> list[str]:
        return [c for c in CHANNELS if c in self.measured]

    @property
    def step(self) -> float:
        """s, of a row."""
        return float(np.median(np.diff(self.time)))

    @property
    def seconds(self) -> float:
        """Time that is compared."""
        return self.step * sum(int(s.used.sum()) for s in self.stretches)

    def later(self, name: str, by: float, rows: slice = slice(None)) -> np.ndarray:
        """An input as it was read `by` later, s: what it was when its row says, if it is logged so late."""
        spline = self._splines.get(name)
        if spline is None:
            spline = self._splines[name] = CubicSpline(self.time, self.inputs[name])
        return spline(np.clip(self.time[rows] + by, self.time[0], self.time[-1]))

    def earlier(self, x: np.ndarray, by: float) -> np.ndarray:
        """What is simulated, a value per row, as a channel has it that is `by` [s] late;
        NaN between stretches."""
        if not by:
            return x
        out = np.full(len(x), np.nan)
        for s in self.stretches:
            time = self.time[s.first : s.last]
            out[s.first : s.last] = np.interp(time - by, time, x[s.first : s.last])
        return out


def prepare(log: CheckedLog, config: Config) -> Prepared:
    """Smooth the inputs, find the stretches, measure the noise."""
    if log.sample_time is None or log.sample_time > 0.1:
        raise UserError(f"{log.path}: rows must come at least every 0.1 s to compare them with a simulation")
    raw = {name: log.data[name].to_numpy(float) for name in DRIVES}
    measured = {
        name: np.where(find_new_values(x), x, np.nan)
        for name in MEASURES
        for x in (log.data[name].to_numpy(float),)
    }
    measured = {name: x for name, x in measured.items() if np.isfinite(x).any()}
    moving = (
        np.abs(0.5 * (raw["wheel_speed_front"] + raw["wheel_speed_rear"])) * config.wheel_radius_front
        > SLOWEST
    )
    inputs = {name: _smoothed(log, name, x) for name, x in raw.items()}
    v = speed(inputs, config)
    good = (v > SLOWEST) & (np.abs(inputs["steer_angle"]) < STEEPEST)
    for x in raw.values():
        good &= ~_hole(log.time, x)
    noise, quiet = {}, {}
    for name, x in measured.items():
        found = (
            estimate_noise(log, name, moving)
            if name in log.slower
            else estimate_channel_noise(name, x, moving)
        )
        noise[name] = found.sd if found else _plain_noise(x)
        if found and found.unraised < found.sd:
            quiet[name] = found.unraised / found.sd
    per_block = max(1, round(BLOCK / log.sample_time))
    stretches = _stretches(log.time, good, per_block)
    distance = np.append(0.0, np.cumsum(np.maximum(v[1:], 0.0) * np.minimum(np.diff(log.time), 1.0)))
    for name in (n for n in VELOCITY if n in log.extra):
        x = log.extra[name].to_numpy(float)
        measured[name] = np.where(find_new_values(x), x, np.nan)
        noise[name] = _plain_noise(measured[name])
    absent = [name for name in MEASURES if name not in measured]
    notes = (
        [f"{log.path.name}: without {', '.join(absent)}: what only that shows is not asked of it"]
        if absent
        else []
    )
    if not stretches:
        notes.append(
            f"{log.path.name}: nowhere {SHORTEST:g} s in one piece above {SLOWEST:g} m/s and below {STEEPEST:g} rad of steering"
        )
    held = {
        name: age
        for name in (*DRIVES, *MEASURES)
        if (age := _age(log.time, log.data[name].to_numpy(float))) > 0
    }
    off = [
        np.concatenate([(raw[n] - inputs[n])[s.first : s.last] for s in stretches])
        for n in DRIVES[1:]
        if stretches
    ]
    wheel_noise = max((float(np.sqrt(np.nanmean(x**2))) for x in off), default=0.0)
    road = {n: np.nan_to_num(log.extra[n].to_numpy(float)) for n in ("bank", "grade") if n in log.extra}
    return Prepared(
        log.path,
        log.time,
        inputs,
        measured,
        noise,
        stretches,
        per_block,
        distance,
        notes,
        quiet,
        held,
        wheel_noise,
        road=road,
    )


def with_all(log: Prepared) -> Prepared:
    """Return the log with a column of NaN for a sensor that it does not have."""
    nothing = np.full(len(log.time), np.nan)
    return replace(log, measured={c: log.measured.get(c, nothing) for c in (*MEASURES, *log.measured)})


def speed(inputs: Mapping[str, np.ndarray], config: Config) -> np.ndarray:
    """m/s by the wheels, of each row."""
    return 0.5 * sum(
        getattr(config, f"wheel_radius_{a}") * inputs[f"wheel_speed_{a}"] for a in ("front", "rear")
    )


def prepare_all(logs: Sequence[CheckedLog], config: Config) -> list[Prepared]:
    """Every log, with the latencies of the vehicle file taken out."""
    return [in_time(prepare(log, config), config) for log in logs]


def in_time(log: Prepared, config: Config) -> Prepared:
    """The log as the latencies of the vehicle file say: inputs are read as much later as they are late; what is measured stays, and
    is compared with what was simulated as much earlier."""
    late = {c: by for c in (*DRIVES, *MEASURES) if (by := getattr(config, f"{c}_latency", 0.0))}
    if not late:
        return log
    ends = log.time[0], log.time[-1]
    inputs = {
        n: CubicSpline(log.time, x)(np.clip(log.time + late.get(n, 0.0), *ends))
        for n, x in log.inputs.items()
    }
    return replace(log, inputs=inputs, late={c: by for c, by in late.items() if c in log.measured})


def _smoothed(log: CheckedLog, name: str, x: np.ndarray) -> np.ndarray:
    """A channel on the rows of a log. Of one that was interpolated its own entries are smoothed: rows between them are what their
    neighbours say, and a cross-validation over rows would find that nothing is noise."""
    if name not in log.slower:
        return smoothed(log.time, x)
    own = log.slower[name]
    spline = smoothing(own.time, own.value)
    return fill_gaps(x) if spline is None else spline(np.clip(log.time, own.time[0], own.time[-1]))


def smoothed(time: np.ndarray, x: np.ndarray) -> np.ndarray:
    """The smoothing spline through the values that are there; through all of them, if they have no noise."""
    spline = smoothing(time, x)
    return fill_gaps(x) if spline is None else spline(time)


def smoothing(time: np.ndarray, x: np.ndarray) -> CubicSpline | None:
    """The smoothing spline through the values that are there; None: they are too few, or have no noise."""
    good = np.isfinite(x) & find_new_values(x)
    y = x[good]
    if len(y) < 8 or np.std(np.diff(y, 3)) <= 1e-9 * max(1.0, float(np.max(np.abs(y)))):
        return None
    return smoothing_spline(time[good], y, _smoothness(time[good], y))


def _age(time: np.ndarray, x: np.ndarray) -> float:
    """s since a value was new, mean over the rows that have one."""
    there = np.isfinite(x)
    if not there.any():
        return 0.0
    new = np.maximum.accumulate(np.where(find_new_values(x), np.arange(len(x)), 0))
    return float(np.mean((time - time[new])[there]))


def _smoothness(time: np.ndarray, y: np.ndarray) -> float:
    """Penalty on the square of the second derivative that predicts every second row best from the others. The ratio of noise
    to signal that it stands for does not depend on how many rows there are."""

    def error(exponent: float) -> float:
        spline = smoothing_spline(time[::2], y[::2], 10.0**exponent)
        return float(np.mean((spline(time[1::2]) - y[1::2]) ** 2))

    step = float(np.median(np.diff(time)))
    around = np.log10(step**3)  # a penalty of step^3 smooths over about a row
    coarse = [around + k for k in np.arange(-3.0, 9.0, 1.5)]
    best = coarse[int(np.argmin([error(x) for x in coarse]))]
    found = minimize_scalar(error, bounds=(best - 1.5, best + 1.5), method="bounded", options={"xatol": 0.15})
    return 10.0 ** float(found.x)


def blocks(log: Prepared, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Means of the blocks that are compared, and how many values each has."""
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


def _hole(time: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Rows further than half of LONGEST_HOLE from a value that is there."""
    good = np.isfinite(x)
    there = time[good]
    after = np.searchsorted(there, time)
    left = time - there[np.clip(after - 1, 0, len(there) - 1)]
    right = there[np.clip(after, 0, len(there) - 1)] - time
    return np.minimum(np.abs(left), np.abs(right)) > 0.5 * LONGEST_HOLE


def _plain_noise(x: np.ndarray) -> float:
    good = x[np.isfinite(x)]
    return 1.4826 * float(np.median(np.abs(np.diff(good, 2)))) / np.sqrt(6) if len(good) >= 8 else 1e-6


def _stretches(time: np.ndarray, good: np.ndarray, per_block: int) -> list[Stretch]:
    broken = np.append(True, ~good[1:] | ~good[:-1] | (np.diff(time) > LONGEST_HOLE)) | ~good
    starts = np.flatnonzero(broken & good)
    stretches = []
    for first in starts:
        last = first + 1
        while last < len(good) and good[last] and not broken[last]:
            last += 1
        if time[last - 1] - time[first] < SHORTEST:
            continue
        last = first + (last - first) // per_block * per_block
        used = time[first:last] - time[first] >= BURN_IN
        used[: int(np.argmax(used)) // per_block * per_block + per_block] = False  # whole blocks
        stretches.append(Stretch(int(first), int(last), used))
    return stretches


def smoothing_spline(time: np.ndarray, y: np.ndarray, penalty: float) -> CubicSpline:
    """The f with the least sum of (y - f(time))^2 + penalty x integral of f''^2 (Reinsch 1967; Green & Silverman 1994, 2.3).

    `time`: increasing, at least 3; `penalty`: unit of time cubed, at least 0. As scipy.interpolate.make_smoothing_spline, in a
    thirtieth of its time: that one walks through the rows in Python, which of half an hour of log is a minute."""
    h = np.diff(time)
    before, here, after = 1 / h[:-1], -1 / h[:-1] - 1 / h[1:], 1 / h[1:]  # rows of the second difference
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


# ---- the model on one log: smoothed inputs in, what the sensors should read out; every stretch from a start of its own


def simulate(
    config: Config,
    log: Prepared,
    channels: Sequence[str],
    stiffness: dict[str, float],
    profiles: dict[str, np.ndarray],
    later: Mapping[str, float] | None = None,
) -> dict[str, np.ndarray]:
    """Predicted channels, one value per row, as late as the log has them; NaN between stretches. Biases are not in it.

    `later`: s, by channel: how much later it is than the vehicle file says."""
    later = later or {}
    road = {n: profiles.get(n, 0.0) + log.road.get(n, 0.0) for n in {**profiles, **log.road}}
    out = {c: np.full(len(log.time), np.nan) for c in channels}
    for s in log.stretches:
        rows = slice(s.first, s.last)
        dt = np.diff(log.time[rows], prepend=log.time[s.first] - 0.01)
        inputs = {n: x[rows] for n, x in (log.inputs | road).items()}
        inputs |= {n: log.later(n, by, rows) for n, by in later.items() if by and n in log.inputs}
        replay = Replay(tuple(channels), dt=dt, **inputs)
        gyro = log.measured["yaw_rate"][s.first] if "yaw_rate" in log.measured else np.nan
        start = {
            "yaw_rate": float(gyro) if np.isfinite(gyro) else 0.0,
            "time": float(log.time[s.first] - log.time[0]),
        }
        try:
            found = replay.run(config, **start, **stiffness)
        except UserError:  # no number any more: a car that a search must leave again
            found = {c: np.full(len(dt), DIVERGED) for c in channels}
        for c, x in found.items():
            late, t = log.late.get(c, 0.0) + later.get(c, 0.0), log.time[rows]
            out[c][rows] = np.interp(t - late, t, x) if late else x
    return out


# ---- what is made of a log before calibration compares it with a simulation


def curves(log: Prepared, config: Config) -> np.ndarray:
    """m/s2, square of the speed times the curvature of the road: what its lean into its curves goes by. The curvature is that of
    the car's path without what is shorter than roads are built in."""
    rate, v = log.measured["yaw_rate"], np.maximum(speed(log.inputs, config), SLOWEST)
    if not np.isfinite(rate).any():
        return np.zeros(len(rate))
    metres = np.arange(0.0, log.distance[-1] + 1.0)
    curvature = np.interp(metres, log.distance, fill_gaps(rate) / v)
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
