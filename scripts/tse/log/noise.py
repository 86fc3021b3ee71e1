"""Sensor noise and bias from the log itself, for vehicle files that do not state them.

Rule for the noise, per channel, over the rows where the car moves; the largest of
  a  second differences, which take out the slow signal: 1.4826 median|x(i+k) - 2 x(i) + x(i-k)| / sqrt(6)
  b  step / sqrt(12) for a channel that takes few distinct values (quantised)
     a and b times sqrt(k), where k is the hold: how many rows a sample stays the same or on a straight line (a slow
     sensor in a fast log); k repeated samples carry the information of one
  c  for the accelerometers: the misfit to the kinematics, accel_x - dv/dt and accel_y - v yaw_rate, which sees what the
     model does not know (pitch, road, vibration, lag). Its sd over 0.2 s averages, slow part taken out, in the quieter
     windows of 2 s (30 % quantile), times sqrt(rows in 0.2 s): the white noise that would leave as much
  d  a floor; none for the wheel speeds
Wheel speeds: a and b, of the noisier axle's mean.
Rule for the bias of an accelerometer: start sd from the size of the slow misfit (2 s averages), random walk from its change
over 1 s. Grade, bank and mounting drift through it. Gyro: a fixed start sd.
"""

from dataclasses import dataclass

import numpy as np

from tse.log.rows import DRIVES, CheckedLog

NOISE_FLOOR = {
    "accel_x": 0.05,
    "accel_y": 0.05,
    "yaw_rate": 0.001,
    "wheel_speed_front": 0.0,
    "wheel_speed_rear": 0.0,
}  # m/s2, rad/s
MAX_HOLD = 10
MIN_NOISE_ROWS = 50


AVERAGE_TIME, WINDOW_TIME, CHANGE_TIME = 0.2, 2.0, 1.0  # s: of the misfit
QUIET_QUANTILE = 0.3  # quantile
NORMAL_QUIET = 0.3853  # that quantile of |z|, z standard normal
MIN_MOVING_SPEED = 3.0  # m/s


@dataclass(frozen=True)
class Misfit:
    """What an accelerometer and the kinematics disagree by."""

    sd: float  # as white noise per row
    bias: float  # size of the slow part
    walk: float  # its change over 1 s


@dataclass(frozen=True)
class Noise:
    sd: float
    hold: int
    step: float  # quantisation step, 0 if none was seen
    text: str
    unraised: float = 0.0  # sd before the floor


def estimate_channel_noise(name: str, x: np.ndarray, moving: np.ndarray) -> Noise | None:
    """The noise of one channel, or None if the log is too short to tell."""
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
    """The noise of a channel of a log. Of one that was interpolated: that of its own entries, spread over the rows between them."""
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
    return float(np.median(np.abs(x - np.median(x))) or np.std(x) or 1.0)


def _find_hold(x: np.ndarray, scale: float) -> int:
    """Rows per independent sample: 1 when no straight stretches are seen. `scale`: a thousandth of it is nothing; of a wheel
    speed, which moves far but slowly, the size of its changes."""
    still = max(np.mean(np.abs(np.diff(x, order)) < 1e-3 * scale) for order in (1, 2))
    return int(np.clip(round(1 / max(1e-9, 1 - still)), 1, MAX_HOLD))


def _find_step(x: np.ndarray) -> float:
    """The step between the values a coarse channel takes; 0 for a fine one."""
    values, counts = np.unique(np.round(x, 12), return_counts=True)
    common = values[counts >= max(5, 0.002 * len(x))]
    covered = counts[counts >= max(5, 0.002 * len(x))].sum() / len(x)
    if len(common) < 2 or covered < 0.5:
        return 0.0
    return float(np.median(np.diff(common)))


def compute_misfit(log: CheckedLog, radius_front: float, radius_rear: float) -> dict[str, Misfit]:
    """Misfit of accel_x and accel_y; empty when the log moves too little to tell."""
    if not log.sample_time:
        return {}
    d = {name: fill_gaps(log.data[name].to_numpy()) for name in log.data}
    speed = 0.5 * (radius_front * d["wheel_speed_front"] + radius_rear * d["wheel_speed_rear"])
    rows = {name: max(1, round(span / log.sample_time)) for name, span in
            (("average", AVERAGE_TIME), ("window", WINDOW_TIME), ("change", CHANGE_TIME))}  # fmt: skip
    moving = np.abs(speed) > MIN_MOVING_SPEED
    misfits = {}
    for name, kinematic in (("accel_x", np.gradient(speed, log.time)), ("accel_y", speed * d["yaw_rate"])):
        if not np.isfinite(d[name]).any() or not np.isfinite(kinematic).any():
            continue
        residual = smooth(d[name] - kinematic, rows["average"])
        slow = smooth(residual, rows["window"])
        fast, n = residual - slow, rows["window"]
        windows = [fast[i : i + n].std() for i in range(0, len(fast) - n + 1, n) if moving[i : i + n].all()]
        both = moving[rows["change"] :] & moving[: -rows["change"]]
        if len(windows) < 5 or not both.any():
            continue
        change = (slow[rows["change"] :] - slow[: -rows["change"]])[both]
        misfits[name] = Misfit(
            sd=float(np.quantile(windows, QUIET_QUANTILE) * np.sqrt(rows["average"])),
            bias=_compute_quiet_sd(slow[moving] - np.median(slow[moving]))
            + float(abs(np.median(slow[moving]))),
            walk=_compute_quiet_sd(change),
        )
    return misfits


def fill_gaps(x: np.ndarray) -> np.ndarray:
    """Missing values on the straight line between their neighbours."""
    good = np.isfinite(x)
    return np.interp(np.arange(len(x)), np.flatnonzero(good), x[good]) if good.any() else x


def smooth(x: np.ndarray, n: int) -> np.ndarray:
    """Moving average over n rows, ends repeated."""
    padded = np.pad(x, (n // 2, n - 1 - n // 2), mode="edge")
    return np.convolve(padded, np.ones(n) / n, mode="valid")


def _compute_quiet_sd(x: np.ndarray) -> float:
    return float(np.quantile(np.abs(x), QUIET_QUANTILE) / NORMAL_QUIET)


# ---- Values that are held: of a signal that is slower than the rows of its log, which rows have a new one.


def find_new_values(x: np.ndarray) -> np.ndarray:
    """Rows with a new value, where a slow signal is held in a fast log: held values are old ones, and half a hold late on average.
    All rows, unless new values come every k-th row: a quantised signal repeats itself, too, but at no beat."""
    changed = np.flatnonzero(np.append(True, (np.diff(x) != 0) & np.isfinite(x[1:]))).astype(
        np.int32
    )  # half the memory
    gaps = np.diff(changed[1:])
    if len(gaps) < 50:
        return np.ones(len(x), bool)
    beat = int(np.median(gaps[gaps <= np.quantile(gaps, 0.5)]))
    if beat < 2 or np.mean(gaps % beat == 0) < 0.9:
        return np.ones(len(x), bool)
    found = np.zeros(len(x), bool)
    found[changed] = True
    for gap, start in zip(
        gaps[gaps > beat], changed[1:-1][gaps > beat], strict=True
    ):  # the same again is new, too
        found[start : start + gap : beat] = True
    found[changed[-1] :: beat] = True
    found[changed[1] :: -beat] = True  # and before it changed for the first time
    return found
