"""Estimate noise and bias of sensors from a log, if the vehicle file lacks them.

The sd of the noise of a channel, while the car moves, is the largest of these values:

(a) An sd from second differences, in which a slow signal cancels:
    1.4826 median|x(i+k) - 2 x(i) + x(i-k)| / sqrt(6). k: the hold, explained below.
(b) For a quantised channel: quantisation step / sqrt(12).
(c) For an accelerometer: the sd of its misfit in quiet driving. The misfit is
    accel_x - dv/dt or accel_y - v yaw_rate; pitch, road, vibration and lag add to it. It
    is averaged over n rows (0.2 s), and its slow part (average over 2 s) is subtracted.
    The sd is the quantile 0.3 of the sds in windows of 2 s, times sqrt(n), because the
    average of n rows of white noise has an sd that is smaller by the factor sqrt(n).
(d) A lower limit, NOISE_FLOOR, which is 0 for wheel speeds.

If a sensor has fewer samples per second than the log has rows, each sample is repeated,
or interpolated linearly, over several rows. The number of rows per sample is the hold k.
The filter takes rows as independent, so (a) and (b) are multiplied by sqrt(k): k rows
then have the weight of one sample. For wheel speeds, (a) and (b) of the noisier axle are
used for both axles.

The bias of an accelerometer is the slow part of its misfit, which grade, bank and a
drifting mounting cause. The initial sd of the bias is |median| + sd of this slow part.
The sd of the random walk of the bias over 1 s is the sd of the change of the slow part
over 1 s. For the gyro, the initial sd of the bias is fixed."""

from dataclasses import dataclass

import numpy as np

from tse.log.rows import DRIVES, CheckedLog

NOISE_FLOOR = {  # min sd of the noise, in the unit of the channel: m/s2, rad/s
    "accel_x": 0.05,
    "accel_y": 0.05,
    "yaw_rate": 0.001,
    "wheel_speed_front": 0.0,
    "wheel_speed_rear": 0.0,
}
MAX_HOLD = 10  # [rows] a longer hold is not detected
MIN_NOISE_ROWS = 50  # min number of rows from which noise is estimated
# The misfit of an accelerometer is its value minus the acceleration that follows from
# wheel speeds and yaw rate (class Misfit).
AVERAGE_TIME = 0.2  # [s] interval over which the misfit is averaged
# [s] length of the windows in which the sd of the misfit is computed; also the interval
# over which the misfit is averaged to get its slow part
WINDOW_TIME = 2.0
SLOW_CHANGE_TIME = 1.0  # [s] interval over which the change of the slow part of the misfit is measured
QUIET_QUANTILE = 0.3  # quantile of sds or absolute values that represents quiet driving
NORMAL_QUIET = 0.3853  # quantile QUIET_QUANTILE of |x| if x is a standard normal variable
MIN_MOVING_SPEED = 3.0  # [m/s] above it, the car counts as moving


@dataclass(frozen=True)
class Misfit:
    """Statistics of the misfit of an accelerometer to the kinematics.

    The misfit is accel_x - dv/dt or accel_y - v yaw_rate, with the speed v from the
    wheels."""

    # [m/s2] sd of the misfit, averaged over n rows (0.2 s) and without its slow part,
    # times sqrt(n): the sd in one row if the misfit is white noise
    sd: float
    bias: float  # [m/s2] |median| + sd of the slow part; the sd is that in quiet driving
    walk: float  # [m/s2] sd of the change of the slow part over 1 s


@dataclass(frozen=True)
class Noise:
    """Noise of a channel, in the unit of the channel."""

    sd: float  # sd of the noise in one row
    hold: int  # number of rows with the same sample; 1: each row has a new one
    step: float  # quantisation step; 0: the channel is not quantised
    text: str  # how the sd was found
    unraised: float = 0.0  # `sd` before the lower limit NOISE_FLOOR was applied


def estimate_channel_noise(name: str, x: np.ndarray, moving: np.ndarray) -> Noise | None:
    """Return the noise of the values x of one channel; None: there are too few values.

    `moving` marks the rows in which the car moves. Only these rows are used, unless there
    are fewer than MIN_NOISE_ROWS of them."""
    usable = np.isfinite(x)
    keep = usable & moving if (usable & moving).sum() >= MIN_NOISE_ROWS else usable
    x = x[keep]
    if len(x) < MIN_NOISE_ROWS:
        return None
    hold = _find_hold(x, float(np.std(np.diff(x)) or 1.0) if name in DRIVES else _measure_scale(x))
    differences = x[2 * hold :] - 2 * x[hold:-hold] + x[: -2 * hold]
    sd = 1.4826 * float(np.median(np.abs(differences))) / np.sqrt(6)
    step = _find_step(x)
    parts = [f"second differences {sd:.3g}"]
    if step / np.sqrt(12) > sd:
        sd = step / np.sqrt(12)
        parts = [f"steps of {step:.3g}: step/sqrt(12) = {sd:.3g}"]
    if hold > 1:
        sd *= np.sqrt(hold)
        parts.append(f"samples repeat over {hold} rows: times {np.sqrt(hold):.2g}")
    unraised = float(sd)
    if sd < NOISE_FLOOR[name]:
        sd = NOISE_FLOOR[name]
        parts.append(f"raised to the floor {sd:g}")
    return Noise(float(sd), hold, step, ", ".join(parts), unraised)


def estimate_noise(log: CheckedLog, name: str, moving: np.ndarray) -> Noise | None:
    """Return the noise of a channel of a log; None if the log is too short.

    For a channel that was interpolated to the rows (log.slower), the noise is estimated
    from the original samples and multiplied by sqrt(rows per sample), because the filter
    takes rows as independent."""
    if name not in log.slower:
        return estimate_channel_noise(name, log.data[name].to_numpy(float), moving)
    own = log.slower[name]
    there = np.isfinite(own.value)
    at = np.clip(np.searchsorted(log.time, own.time), 0, len(log) - 1)
    found = estimate_channel_noise(name, own.value, moving[at] & there)
    if found is None:
        return None
    often = np.sqrt(own.rows)
    text = f"{found.text}, one entry per {own.rows:.3g} rows: times {often:.2g}"
    return Noise(found.sd * often, found.hold, found.step, text, found.unraised * often)


def _measure_scale(x: np.ndarray) -> float:
    """Return the median absolute deviation of x. If it is 0, return the sd of x, or 1 if
    the sd is 0, too.
    """
    return float(np.median(np.abs(x - np.median(x))) or np.std(x) or 1.0)


def _find_hold(x: np.ndarray, scale: float) -> int:
    """Return the hold: the number of rows over which x is constant or on a straight line.

    If each sample is held over k rows, the share 1 - 1/k of the first differences of x is
    0. If x is interpolated linearly between samples, this is the share of the second
    differences that are 0. k follows from the larger one of both shares.
    Differences below 0.001 `scale` count as 0. `scale`: size of the variation of x. If x
    is an input of the model (DRIVES), it is the sd of the change of x from row to row,
    otherwise the result of _measure_scale()."""
    still = max(np.mean(np.abs(np.diff(x, order)) < 1e-3 * scale) for order in (1, 2))
    return int(np.clip(round(1 / max(1e-9, 1 - still)), 1, MAX_HOLD))


def _find_step(x: np.ndarray) -> float:
    """Return the quantisation step of x: the median distance between frequent values.

    A value is frequent if at least 5 rows and 0.2 % of all rows have it. Return 0, i.e. x
    is not quantised, if less than half of the rows have a frequent value."""
    values, counts = np.unique(np.round(x, 12), return_counts=True)
    common = values[counts >= max(5, 0.002 * len(x))]
    covered = counts[counts >= max(5, 0.002 * len(x))].sum() / len(x)
    if len(common) < 2 or covered < 0.5:
        return 0.0
    return float(np.median(np.diff(common)))


def compute_misfit(log: CheckedLog, radius_front: float, radius_rear: float) -> dict[str, Misfit]:
    """Return the misfits of accel_x and accel_y, see class Misfit: channel -> misfit.

    A channel is omitted if the log lacks it, the wheel speeds or (for accel_y) the yaw
    rate, or if the car moves too little. radius_front, radius_rear: [m] wheel radii."""
    if not log.sample_time:
        return {}
    d = {name: fill_gaps(log.data[name].to_numpy()) for name in log.data}
    speed = 0.5 * (radius_front * d["wheel_speed_front"] + radius_rear * d["wheel_speed_rear"])
    spans = {"average": AVERAGE_TIME, "window": WINDOW_TIME, "change": SLOW_CHANGE_TIME}
    rows = {name: max(1, round(span / log.sample_time)) for name, span in spans.items()}
    moving = np.abs(speed) > MIN_MOVING_SPEED
    misfits = {}
    for name, kinematic in (("accel_x", np.gradient(speed, log.time)), ("accel_y", speed * d["yaw_rate"])):
        if not np.isfinite(d[name]).any() or not np.isfinite(kinematic).any():
            continue
        residual = compute_moving_average(d[name] - kinematic, rows["average"])
        slow = compute_moving_average(residual, rows["window"])
        fast, n = residual - slow, rows["window"]
        windows = [fast[i : i + n].std() for i in range(0, len(fast) - n + 1, n) if moving[i : i + n].all()]
        both = moving[rows["change"] :] & moving[: -rows["change"]]
        if len(windows) < 5 or not both.any():
            continue
        change = (slow[rows["change"] :] - slow[: -rows["change"]])[both]
        offset = float(np.median(slow[moving]))
        misfits[name] = Misfit(
            sd=float(np.quantile(windows, QUIET_QUANTILE) * np.sqrt(rows["average"])),
            bias=_compute_quiet_sd(slow[moving] - offset) + abs(offset),
            walk=_compute_quiet_sd(change),
        )
    return misfits


def fill_gaps(x: np.ndarray) -> np.ndarray:
    """Return x with its missing values interpolated linearly."""
    good = np.isfinite(x)
    return np.interp(np.arange(len(x)), np.flatnonzero(good), x[good]) if good.any() else x


def compute_moving_average(x: np.ndarray, n: int) -> np.ndarray:
    """Return the moving average of x over n rows; at the ends, x is taken as constant."""
    padded = np.pad(x, (n // 2, n - 1 - n // 2), mode="edge")
    return np.convolve(padded, np.ones(n) / n, mode="valid")


def _compute_quiet_sd(x: np.ndarray) -> float:
    """Return (quantile QUIET_QUANTILE of |x|) / NORMAL_QUIET.

    This is about the sd of x in quiet driving: large values of x in the other rows hardly
    change a low quantile."""
    return float(np.quantile(np.abs(x), QUIET_QUANTILE) / NORMAL_QUIET)


# ---- Held values: between the samples of a slow signal, the log repeats the last one.


def find_new_values(x: np.ndarray) -> np.ndarray:
    """Mark the rows in which the signal x has a new sample.

    A slow signal has a new sample every `beat` rows, and the rows in between repeat it.
    So at least 90 % of the distances between changes of x must be multiples of `beat`. If
    not, if `beat` is 1, or if x has fewer than about 50 changes, all rows are marked."""
    changed = np.flatnonzero(np.append(True, (np.diff(x) != 0) & np.isfinite(x[1:])))
    changed = changed.astype(np.int32)  # half the memory
    gaps = np.diff(changed[1:])
    if len(gaps) < 50:
        return np.ones(len(x), bool)
    beat = int(np.median(gaps[gaps <= np.quantile(gaps, 0.5)]))
    if beat < 2 or np.mean(gaps % beat == 0) < 0.9:
        return np.ones(len(x), bool)
    found = np.zeros(len(x), bool)
    found[changed] = True
    # every `beat`-th row between two changes is a new sample, too, with an equal value
    late = gaps > beat
    for gap, start in zip(gaps[late], changed[1:-1][late], strict=True):
        found[start : start + gap : beat] = True
    found[changed[-1] :: beat] = True
    found[changed[1] :: -beat] = True  # before the first change
    return found
