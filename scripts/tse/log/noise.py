"""Estimate noise and bias of sensors from a log, if the vehicle file lacks them.

Noise of a channel while the car moves: the largest of

a  the sd from second differences, which remove the slow signal:
   1.4826 median|x(i+k) - 2 x(i) + x(i-k)| / sqrt(6);
b  step / sqrt(12) for a quantised channel; c  for accelerometers, the misfit to the
kinematics, accel_x - dv/dt and accel_y - v yaw_rate.
   It contains the errors of the model: pitch, road, vibration, lag. Take averages over
   0.2 s, remove the slow part, take the sd in the quieter windows of 2 s (quantile 30 %),
   multiply by sqrt(rows in 0.2 s): white noise of this sd leaves the same averages;
d  a floor, except for wheel speeds.

The hold k is the number of rows in which a slow sensor repeats a sample or stays on a
straight line. k repeated samples carry the information of one, so a and b are multiplied
by sqrt(k). Wheel speeds: a and b of the noisier axle's mean.

Bias of an accelerometer: the start sd is the size of the slow misfit (averages over 2 s),
the random walk its change over 1 s. Grade, bank and mounting drift cause it. Gyro: a
fixed start sd."""

from dataclasses import dataclass

import numpy as np

from tse.log.rows import DRIVES, CheckedLog

NOISE_FLOOR = {  # m/s2, rad/s
    "accel_x": 0.05,
    "accel_y": 0.05,
    "yaw_rate": 0.001,
    "wheel_speed_front": 0.0,
    "wheel_speed_rear": 0.0,
}
MAX_HOLD = 10  # rows
MIN_NOISE_ROWS = 50  # for an estimate
AVERAGE_TIME = 0.2  # s; averages of the misfit
WINDOW_TIME = 2.0  # s; windows in which its sd is taken, averages for its slow part
CHANGE_TIME = 1.0  # s; interval over which its random walk is taken
QUIET_QUANTILE = 0.3  # of windows or values: the quieter ones
NORMAL_QUIET = 0.3853  # QUIET_QUANTILE of |z|, z standard normal
MIN_MOVING_SPEED = 3.0  # m/s


@dataclass(frozen=True)
class Misfit:
    """Difference between an accelerometer and the kinematics."""

    sd: float  # m/s2, as white noise per row
    bias: float  # m/s2, size of the slow part
    walk: float  # m/s2, change of the slow part over 1 s


@dataclass(frozen=True)
class Noise:
    """Noise of a channel, in its unit."""

    sd: float  # per row
    hold: int  # rows per independent sample
    step: float  # quantisation step; 0: none found
    text: str  # the rule that gave the sd
    unraised: float = 0.0  # sd before the floor


def estimate_channel_noise(name: str, x: np.ndarray, moving: np.ndarray) -> Noise | None:
    """Return the noise of one channel; None if the log is too short."""
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
        parts.append(f"samples held {hold} rows: x {np.sqrt(hold):.2g}")
    unraised = float(sd)
    if sd < NOISE_FLOOR[name]:
        sd = NOISE_FLOOR[name]
        parts.append(f"raised to the floor {sd:g}")
    return Noise(float(sd), hold, step, ", ".join(parts), unraised)


def estimate_noise(log: CheckedLog, name: str, moving: np.ndarray) -> Noise | None:
    """Return the noise of a channel of a log; None if the log is too short.

    An interpolated channel has the noise of its own entries, spread over the rows
    between."""
    if name not in log.slower:
        return estimate_channel_noise(name, log.data[name].to_numpy(float), moving)
    own = log.slower[name]
    there = np.isfinite(own.value)
    at = np.clip(np.searchsorted(log.time, own.time), 0, len(log) - 1)
    found = estimate_channel_noise(name, own.value, moving[at] & there)
    if found is None:
        return None
    often = np.sqrt(own.rows)
    text = f"{found.text}, an entry in {own.rows:.3g} rows: x {often:.2g}"
    return Noise(found.sd * often, found.hold, found.step, text, found.unraised * often)


def _measure_scale(x: np.ndarray) -> float:
    """Return the size of the variations of x."""
    return float(np.median(np.abs(x - np.median(x))) or np.std(x) or 1.0)


def _find_hold(x: np.ndarray, scale: float) -> int:
    """Return the number of rows per independent sample, 1 without straight stretches.

    `scale`: size of the variations. A thousandth of it counts as no change. Of a wheel
    speed, which moves far but slowly, it is the size of the changes from row to row."""
    still = max(np.mean(np.abs(np.diff(x, order)) < 1e-3 * scale) for order in (1, 2))
    return int(np.clip(round(1 / max(1e-9, 1 - still)), 1, MAX_HOLD))


def _find_step(x: np.ndarray) -> float:
    """Return the step between the values of a quantised channel; 0 for a fine one."""
    values, counts = np.unique(np.round(x, 12), return_counts=True)
    common = values[counts >= max(5, 0.002 * len(x))]
    covered = counts[counts >= max(5, 0.002 * len(x))].sum() / len(x)
    if len(common) < 2 or covered < 0.5:
        return 0.0
    return float(np.median(np.diff(common)))


def compute_misfit(log: CheckedLog, radius_front: float, radius_rear: float) -> dict[str, Misfit]:
    """Return the misfit of accel_x and accel_y; {} if the car moves too little.

    The radii are those of the wheels, m."""
    if not log.sample_time:
        return {}
    d = {name: fill_gaps(log.data[name].to_numpy()) for name in log.data}
    speed = 0.5 * (radius_front * d["wheel_speed_front"] + radius_rear * d["wheel_speed_rear"])
    spans = {"average": AVERAGE_TIME, "window": WINDOW_TIME, "change": CHANGE_TIME}
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
    """Return x with missing values interpolated linearly."""
    good = np.isfinite(x)
    return np.interp(np.arange(len(x)), np.flatnonzero(good), x[good]) if good.any() else x


def compute_moving_average(x: np.ndarray, n: int) -> np.ndarray:
    """Return the moving average over n rows; the first and last values are repeated."""
    padded = np.pad(x, (n // 2, n - 1 - n // 2), mode="edge")
    return np.convolve(padded, np.ones(n) / n, mode="valid")


def _compute_quiet_sd(x: np.ndarray) -> float:
    """Return the sd of normal values by their quantile QUIET_QUANTILE."""
    return float(np.quantile(np.abs(x), QUIET_QUANTILE) / NORMAL_QUIET)


# ---- Held values: a signal that is slower than the rows repeats its last value.


def find_new_values(x: np.ndarray) -> np.ndarray:
    """Return the rows with a new value of a slow signal in a fast log.

    Held values are old: half a hold late on average. If new values do not come every k-th
    row, all rows are returned: a quantised signal repeats values, too, but
    irregularly."""
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
    # between changes every k-th row is new, too, with the same value as before
    late = gaps > beat
    for gap, start in zip(gaps[late], changed[1:-1][late], strict=True):
        found[start : start + gap : beat] = True
    found[changed[-1] :: beat] = True
    found[changed[1] :: -beat] = True  # before the first change
    return found
