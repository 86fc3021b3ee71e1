"""Do the channels of a log agree with each other? Ratios of kinematic quantities that must be near 1 show wrong units
and signs long before an estimate does."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tselab.log import Log
from tselab.noise import filled, smooth

MOVING = 5.0  # m/s
WINDOW = 0.5  # s, averaging before channels are compared
TOLERANCE = 2.0  # a ratio within 1/2 .. 2 is not complained about (understeer alone makes 0.5)
CORRELATION = 0.8


@dataclass(frozen=True)
class Cause:
    factor: float
    text: str


def check_units(log: Log, wheelbase: float, radius_front: float, radius_rear: float, ratio: float | None) -> list[str]:
    """Warnings in plain words; empty when the channels agree or the log moves too little to tell."""
    if len(log) < 50 or not log.sample_time:
        return []
    n = max(1, round(WINDOW / log.sample_time))
    d = {name: smooth(filled(log.data[name].to_numpy()), n) for name in log.data}
    speed = 0.5 * (radius_front * d["wheel_speed_front"] + radius_rear * d["wheel_speed_rear"])
    accel = np.gradient(smooth(speed, n), log.time)
    moving = np.abs(speed) > MOVING
    radius = 0.5 * (radius_front + radius_rear)
    steering = ratio or 15.0
    checks = [
        (
            "yaw_rate",
            "speed x steer_angle / wheelbase",
            d["yaw_rate"],
            speed * d["steer_angle"] / wheelbase,
            0.01,
            [
                Cause(57.3, "yaw_rate is in deg/s (multiply by pi/180)"),
                Cause(1 / 57.3, "steer_angle is in degrees (multiply by pi/180)"),
                Cause(1 / steering, "steer_angle is the steering-wheel angle (divide by the steering ratio)"),
                Cause(1 / 57.3 / steering, "steer_angle is the steering-wheel angle in degrees"),
                Cause(
                    -1.0,
                    "yaw_rate or steer_angle is positive to the right (change its sign; left is positive)",
                ),
            ],
        ),
        (
            "accel_y",
            "speed x yaw_rate",
            d["accel_y"],
            speed * d["yaw_rate"],
            0.3,
            [
                Cause(
                    1 / 9.81,
                    "accel_y is in g (multiply by 9.81), or the wheel speeds are in rpm (multiply by 2 pi/60)",
                ),
                Cause(1 / 57.3, "yaw_rate is in deg/s (multiply by pi/180)"),
                Cause(1 / radius, "the wheel speeds are in m/s (divide by the wheel radius)"),
                Cause(-1.0, "accel_y or yaw_rate is positive to the right (change its sign; left is positive)"),
            ],
        ),
        (
            "accel_x",
            "the change of wheel speed x wheel radius",
            d["accel_x"],
            accel,
            0.3,
            [
                Cause(
                    1 / 9.81,
                    "accel_x is in g (multiply by 9.81), or the wheel speeds are in rpm (multiply by 2 pi/60)",
                ),
                Cause(1 / radius, "the wheel speeds are in m/s (divide by the wheel radius)"),
                Cause(-1.0, "accel_x is positive to the rear (change its sign; forward is positive)"),
            ],
        ),
    ]
    notes = [w for c in checks if (w := _compare(*c, moving))]
    front, rear = np.median(np.abs(d["wheel_speed_front"][moving])) if moving.any() else 0, 0.0
    if moving.any():
        rear = float(np.median(np.abs(d["wheel_speed_rear"][moving])))
        a, b = front * radius_front, rear * radius_rear
        if min(a, b) > 0 and not 0.8 < a / b < 1.25:
            notes.append(
                f"check the units: front and rear wheels roll at {a:.3g} and {b:.3g} m/s; "
                "wheel_radius_* or one wheel speed is wrong"
            )
    return notes


def _compare(
    name: str, other: str, x: np.ndarray, y: np.ndarray, least: float, causes: list[Cause], moving: np.ndarray
) -> str:
    keep = moving & np.isfinite(x) & np.isfinite(y)
    if keep.sum() < 50:
        return ""
    x, y = x[keep] - x[keep].mean(), y[keep] - y[keep].mean()
    sx, sy = x.std(), y.std()
    if sx == 0 or sy == 0 or max(sx, sy) < least:
        return ""
    correlation = float(np.mean(x * y) / (sx * sy))
    if abs(correlation) < CORRELATION:
        return ""
    ratio = float(np.sign(correlation) * sx / sy)
    if ratio > 0 and 1 / TOLERANCE < ratio < TOLERANCE:
        return ""
    same_sign = [c for c in causes if c.factor * ratio > 0]
    likely = [c for c in same_sign if abs(np.log(c.factor / ratio)) < np.log(1.6)] or (
        [c for c in causes if c.factor == -1.0] if ratio < 0 else []
    )
    text = f"check the units: {name} is {ratio:.3g} times {other}, about 1 is expected"
    return text + (f"; perhaps {' or '.join(c.text for c in likely)}" if likely else "")
