"""Align the clocks of groups of signals in a file.

In some formats, each group of signals has its own times. The clocks of groups may differ
by seconds, or may count from different epochs. The difference of two clocks is the time
shift at which signals of the two groups that follow the same motion of the car, e.g. two
yaw rates, correlate best.
"""

from dataclasses import dataclass, replace

import numpy as np

from tse.channels.vocabulary import find_place, score_name
from tse.readers.recording import Channel, Recording, list_names

# formats whose signals share one clock
ONE_CLOCK = ("BLF", "ASC", "TRC", "CAN log", "CSV", "VBOX", "Parquet", "Feather")
CORRELATION_RATE = 10.0  # [Hz] sampling rate at which signals are correlated
CORRELATION_MEAN = 0.5  # [s] length of the moving mean of signals before the correlation
MIN_SHIFT = 0.5  # [s] a smaller shift is a latency, found by find_latencies()
# [1] A shift is only accepted if the overlap of the shifted signals is at least this
# share of the duration of the shorter signal.
MIN_SHARED = 0.6
# [1] A shift is only accepted if the correlation of the two signals after the shift is at
# least MIN_SHIFT_CORR, and MIN_CORR_GAIN higher than without the shift.
MIN_SHIFT_CORR = 0.8
MIN_CORR_GAIN = 0.15
# Only the first MAX_CORRELATED_ROWS resampled values of a signal are correlated: 1.8 h at
# CORRELATION_RATE.
MAX_CORRELATED_ROWS = 1 << 16
# A group with fewer time stamps is not aligned. A signal with fewer values is not
# correlated.
MIN_GROUP_SAMPLES = 100
# [s] A signal is not correlated if it lasts longer than MAX_SIGNAL_SPAN (11 days), or if
# |first time| exceeds MAX_SIGNAL_TIME (3000 years). Such times are errors of the log.
MAX_SIGNAL_SPAN, MAX_SIGNAL_TIME = 1e6, 1e11
MAX_GROUPS = 64  # If a file has more groups, none of them is aligned.


@dataclass(frozen=True)
class ClockGroup:
    """Channels that share a clock."""

    number: int  # position in the file, from 1
    channels: list[Channel]

    @property
    def span(self) -> tuple[float, float]:
        """Return first and last time, s."""
        good = self.channels[0].time[np.isfinite(self.channels[0].time)]
        return float(good.min()), float(good.max())

    def describe(self) -> str:
        """Return number and first signals of the group, in words."""
        more = ", ..." if len(self.channels) > 3 else ""
        return f"group {self.number} ({list_names(c.short for c in self.channels[:3])}{more})"


def align_clocks(recording: Recording, warnings: list[str]) -> tuple[Recording, dict[str, float]]:
    """Shift the times of groups of signals to a common clock.

    The common clock is that of the reference group. This is the group with the signals
    whose names best describe yaw rate and lateral acceleration.

    Parameters
    ----------
    recording : Recording
        The log.
    warnings : list of str
        The function appends a warning for each group with a different clock.

    Returns
    -------
    Recording
        The log with corrected times.
    dict of str to float
        Name of each shifted signal -> shift that was subtracted from its times, s.
    """
    groups = _group_channels(recording)
    if recording.format in ONE_CLOCK or not 2 <= len(groups) <= MAX_GROUPS:
        return recording, {}
    base = max(
        groups,
        key=lambda g: (
            _find_motion(g) != {},
            _find_best("yaw_rate", g)[0] + _find_best("accel_y", g)[0],
            -g.number,
        ),
    )
    shifts: dict[int, float] = {}
    for g in groups:
        if g is base:
            continue
        found = _find_shift(base, g)
        apart = _describe_gap(base, g)
        if found is None:
            if apart:
                warnings.append(
                    f"the clock of {g.describe()} does not overlap with that of {base.describe()}: {apart}; "
                    "the shift is unknown"
                )
            continue
        shift, corr = found
        off = f"{abs(shift):.2f} s off, {'ahead of' if shift > 0 else 'behind'} that of {base.describe()}"
        how = f"correlation {corr:.2f}; the difference is subtracted: key clock in signals.toml"
        overlap = f"does not overlap with that of {base.describe()}: {apart}. It " if apart else ""
        warnings.append(f"the clock of {g.describe()} {overlap}is {off}, found by {how}")
        shifts[g.number] = shift
    if not shifts:
        return recording, {}
    moved: dict[str, float] = {}
    channels = dict(recording.channels)
    for g in groups:
        if g.number in shifts:
            time = g.channels[0].time - shifts[g.number]
            for c in g.channels:
                channels[c.name] = replace(c, time=time)
                moved[c.name] = shifts[g.number]
    return replace(recording, channels=channels), moved


def _group_channels(recording: Recording) -> list[ClockGroup]:
    """Return the groups of channels that share an array of times. Groups with fewer than
    MIN_GROUP_SAMPLES times are left out."""
    found: dict[int, list[Channel]] = {}
    for c in recording:
        found.setdefault(id(c.time), []).append(c)
    large = [part for part in found.values() if np.isfinite(part[0].time).sum() >= MIN_GROUP_SAMPLES]
    return [ClockGroup(i, part) for i, part in enumerate(large, 1)]


def _describe_gap(a: ClockGroup, b: ClockGroup) -> str:
    """Return a description of both time spans if they hardly overlap, otherwise "".

    The spans of `a` and `b` hardly overlap if their common part is at most half of the
    shorter span."""
    (a0, a1), (b0, b1) = a.span, b.span
    shared = min(a1, b1) - max(a0, b0)
    if shared > 0.5 * min(a1 - a0, b1 - b0):
        return ""
    return f"{b0:.1f} .. {b1:.1f} s and {a0:.1f} .. {a1:.1f} s"


def _find_best(role: str, g: ClockGroup) -> tuple[float, Channel | None]:
    """Return the channel whose name fits a role best: (score of its name, channel).

    A role is a quantity that a signal may measure, e.g. yaw_rate. If no name fits the
    role, i.e. if all scores are below 1, return (0, None)."""
    rated = [(score_name(role, c.name), i) for i, c in enumerate(g.channels)]
    worth, i = max(rated)
    return (worth, g.channels[i]) if worth >= 1.0 else (0.0, None)


def _find_motion(g: ClockGroup) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Return signals that describe the motion of the car: name -> (times, values).

    Names: "turn", proportional to the yaw rate; "change", proportional to the derivative
    of the speed; "speed", proportional to the speed."""
    found: dict[str, tuple[np.ndarray, np.ndarray]] = {}
    wheels = {place: c for c in g.channels if (place := find_place(c.name)[0])}
    for axle in ("rear", "front"):
        left, right = wheels.get(f"{axle}_left"), wheels.get(f"{axle}_right")
        if left is not None and right is not None:
            found.setdefault("turn", (left.time, right.value - left.value))
    for role in ("yaw_rate", "accel_y", "steer_angle"):
        c = _find_best(role, g)[1]
        if c is not None:
            found.setdefault("turn", (c.time, c.value))
    along = _find_best("accel_x", g)[1]
    speed = next(iter(wheels.values()), None) or _find_best("speed", g)[1]
    if along is not None:
        found["change"] = along.time, along.value
    elif speed is not None:
        found["speed"] = speed.time, speed.value
    return found


def _resample_evenly(part: tuple[np.ndarray, np.ndarray], derive: bool) -> tuple[float, np.ndarray] | None:
    """Return start time [s] and values of a signal resampled at CORRELATION_RATE.

    The values are smoothed, and their mean is subtracted. Return None if the signal is
    constant, too short or too long. `part`: (times [s], values) of the signal. `derive`:
    True: differentiate the signal."""
    good = np.isfinite(part[0]) & np.isfinite(part[1])
    time, value = part[0][good], part[1][good]
    if len(time) < MIN_GROUP_SAMPLES:
        return None
    order = np.argsort(time, kind="stable")
    time, value = time[order], value[order]
    if not 0 < time[-1] - time[0] < MAX_SIGNAL_SPAN or abs(time[0]) > MAX_SIGNAL_TIME:
        return None
    at = (
        time[0]
        + np.arange(min(MAX_CORRELATED_ROWS, int((time[-1] - time[0]) * CORRELATION_RATE) + 1))
        / CORRELATION_RATE
    )
    x = np.interp(at, time, value)
    n = max(1, round(CORRELATION_MEAN * CORRELATION_RATE))
    x = np.convolve(x, np.ones(n) / n, "same") if len(x) > n else x
    x = np.gradient(x) * CORRELATION_RATE if derive and len(x) > 2 else x
    x = x[n:-n] if len(x) > 4 * n else x
    x = x - x.mean()
    return (float(at[0]) + n / CORRELATION_RATE, x) if len(x) > MIN_GROUP_SAMPLES and x.std() > 1e-9 else None


def _find_shift(a: ClockGroup, b: ClockGroup) -> tuple[float, float] | None:
    """Return the time [s] by which the clock of `b` is ahead of the clock of `a`, and the
    correlation at this shift.

    The time follows from the pair of signals, one of `a` and one of `b`, with the highest
    correlation. Return None if the clocks agree, or if no pair correlates well enough."""
    mine, other = _find_motion(a), _find_motion(b)
    best: tuple[float, float] | None = None
    for x, y, dx, dy in (
        ("turn", "turn", False, False),
        ("change", "speed", False, True),
        ("speed", "change", True, False),
    ):
        if x not in mine or y not in other:
            continue
        one, two = _resample_evenly(mine[x], dx), _resample_evenly(other[y], dy)
        if one is None or two is None:
            continue
        lag, corr, at_zero = _correlate(one, two)
        if corr < MIN_SHIFT_CORR or corr < at_zero + MIN_CORR_GAIN or abs(lag) < MIN_SHIFT:
            if at_zero >= MIN_SHIFT_CORR and not _describe_gap(a, b):
                return None  # the clocks agree
            continue
        if best is None or corr > best[1]:
            best = lag, corr
    return best


def _correlate(one: tuple[float, np.ndarray], two: tuple[float, np.ndarray]) -> tuple[float, float, float]:
    """Correlate two signals at all lags.

    Return three numbers: the lag [s] of `two` behind `one` at which |correlation| is
    highest, this |correlation|, and the |correlation| at lag 0. At lags with too little
    overlap (MIN_SHARED), |correlation| is set to 0. `one`, `two`: (start time [s],
    values)."""
    (a0, a), (b0, b) = one, two
    size = 1 << (len(a) + len(b)).bit_length()

    def correlate_all(p: np.ndarray, q: np.ndarray) -> np.ndarray:
        """Return the sum over i of p(i) q(i + k), for each shift k."""
        return np.fft.irfft(np.conj(np.fft.rfft(p, size)) * np.fft.rfft(q, size), size)

    ones_a, ones_b = np.ones(len(a)), np.ones(len(b))
    shared = np.round(correlate_all(ones_a, ones_b))
    power = np.sqrt(
        np.maximum(correlate_all(a**2, ones_b), 0.0) * np.maximum(correlate_all(ones_a, b**2), 0.0)
    )
    enough = shared >= MIN_SHARED * min(len(a), len(b))
    corr = np.where(enough & (power > 0), np.abs(correlate_all(a, b)) / np.maximum(power, 1e-30), 0.0)
    k = int(corr.argmax())
    steps = np.arange(size)
    steps = np.where(steps > size // 2, steps - size, steps)
    before, top, after = corr[k - 1], corr[k], corr[(k + 1) % size]
    bend = before - 2.0 * top + after
    # Interpolate the shift by the parabola through the max correlation and its two
    # neighbours. `between`: [steps] distance of the vertex from the max.
    between = 0.5 * (before - after) / bend if bend < 0 and before > 0 and after > 0 else 0.0
    # at the highest |correlation|, sample i of a corresponds to sample i + steps[k] of b
    lag = (float(steps[k]) + float(between)) / CORRELATION_RATE + b0 - a0
    zero = round((a0 - b0) * CORRELATION_RATE)
    at_zero = float(corr[zero % size]) if -size // 2 < zero < size // 2 else 0.0
    return lag, float(corr[k]), at_zero
