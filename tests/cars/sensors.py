"""Log the motion as a production car: steering angle, wheel speeds, IMU by a bus, 100 Hz.

Every channel is sampled at its own times: the time of the row less the latency of the
channel, with jitter. Wheel speeds may come in every second row only. If a message is
missing, the last one is held. The latency in truth.json is the resulting mean age of the
value of a row, with the delay of the IMU's filter and of the wheel pulses. Only
differences between channels show in a log: an age below the delay of its own filter means
that the clock of the log is ahead by this time, and is allowed.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.signal import butter, group_delay, lfilter, lfilter_zi

from .cars import CHANNELS, Car, compute_roll_arm, compute_sprung_mass

FINE = 0.005  # s between records of the motion
ROW = 0.01  # s between rows of the log
STATES = (
    "vx",
    "vy",
    "r",
    "roll",
    "droll",
    "pitch",
    "dpitch",
    "dheave",
    "steering_wheel",
    "spin_fl",
    "spin_fr",
    "spin_rl",
    "spin_rr",
)
SLOPES = ("gx", "gy", "gz")  # m/s2, gravity along x, y of the road and into it


@dataclass
class Motion:
    """Motion of one car: time, s, every FINE; STATES and SLOPES by name."""

    time: np.ndarray
    state: dict[str, np.ndarray]


def _mount(roll: float, pitch: float, yaw: float) -> np.ndarray:
    """Return the matrix that turns vectors into axes at these angles (yaw first), rad."""
    cr, sr, cp, sp, cy, sy = (
        np.cos(roll),
        np.sin(roll),
        np.cos(pitch),
        np.sin(pitch),
        np.cos(yaw),
        np.sin(yaw),
    )
    return np.array(
        [
            [cy * cp, sy * cp, -sp],
            [cy * sp * sr - sy * cr, sy * sp * sr + cy * cr, cp * sr],
            [cy * sp * cr + sy * sr, sy * sp * cr - cy * sr, cp * cr],
        ]
    )


def measure_motion(car: Car, motion: Motion) -> tuple[np.ndarray, np.ndarray]:
    """Return times, s, and specific force along x, y and yaw rate of a perfect IMU, (3,
    times).

    It is at its place in the car. Accelerations are differences of velocities over FINE,
    i.e. means between two records; times are the middles.
    """
    p, q, m = car.parameters, car.sensors, motion.state

    def rate(name: str) -> np.ndarray:
        return np.diff(m[name]) / FINE

    def middle(name: str) -> np.ndarray:
        return 0.5 * (m[name][1:] + m[name][:-1])

    vx, vy, r, roll, pitch = (middle(k) for k in ("vx", "vy", "r", "roll", "pitch"))
    x, y = q["imu_x"], q["imu_y"]
    _, height, _ = compute_sprung_mass(p)
    above_roll = p["cg_height"] + q["imu_z"] - (height - compute_roll_arm(p))
    above_pitch = p["cg_height"] + q["imu_z"] - p["pitch_centre"]
    dr, ddroll, ddpitch = rate("r"), rate("droll"), rate("dpitch")
    fx = rate("vx") - r * vy - middle("gx") - dr * y - r * r * x + above_pitch * ddpitch
    fy = rate("vy") + r * vx - middle("gy") + dr * x - r * r * y - above_roll * ddroll
    fz = middle("gz") + rate("dheave") + y * ddroll - x * ddpitch
    cr, sr, cp, sp = np.cos(roll), np.sin(roll), np.cos(pitch), np.sin(pitch)
    fx, fz = fx * cp - fz * sp, fz * cp + fx * sp  # nose down: what holds the car up points backwards in it
    fy, fz = fy * cr + fz * sr, fz * cr - fy * sr
    turn = np.array(
        [middle("droll") - r * sp, middle("dpitch") * cr + r * sr * cp, r * cr * cp - middle("dpitch") * sr]
    )
    mount = _mount(q["imu_roll"], q["imu_pitch"], q["imu_yaw"])
    force, turn = mount @ np.array([fx, fy, fz]), mount @ turn
    return motion.time[:-1] + 0.5 * FINE, np.array([force[0], force[1], turn[2]])


def quantise(x: np.ndarray, step: float) -> np.ndarray:
    return np.round(x / step) * step if step > 0 else x


def draw_sample_times(
    rows: np.ndarray, latency: float, period: float, sensors: dict[str, Any], rng: np.random.Generator
) -> np.ndarray:
    """Return the sample time, s, of the value of each row, and the mean age: the latency.

    A row that holds an older sample has the time of that sample.
    """
    every = round(period / ROW)
    jitter = rng.uniform(-1, 1, len(rows)) * sensors["jitter"]
    index = np.arange(len(rows))
    fresh = index - (index + rng.integers(every)) % every
    at = rows - (latency - 0.5 * (every - 1) * ROW) + jitter
    late = rng.random(len(rows)) < sensors["late"]
    last = np.maximum.accumulate(np.where((fresh == index) & ~late, index, -1))
    return at[np.maximum(last, 0)]


def hold_noise(instants: np.ndarray, noise: np.ndarray) -> np.ndarray:
    """Return noise that stays constant as long as its sample."""
    changed = np.diff(instants, prepend=-np.inf) != 0
    return noise[np.maximum.accumulate(np.where(changed, np.arange(len(noise)), 0))]


def count_pulses(
    time: np.ndarray, spin: np.ndarray, at: np.ndarray, teeth: int, window: float, pitch: np.ndarray
) -> tuple[np.ndarray, float]:
    """Return the speed of a wheel, rad/s, from pulses within a window, and its mean age,
    s.

    pitch: misplacement of each tooth, in teeth. Without a pulse in 0.3 s the wheel
    stands.
    """
    step = 2 * np.pi / teeth
    turned = (
        np.maximum.accumulate(np.concatenate([[0.0], np.cumsum(0.5 * (spin[1:] + spin[:-1])) * FINE])) / step
    )
    turned += 1e-9 * np.arange(len(turned))  # np.interp wants it to rise
    tooth = np.arange(1, int(turned[-1]) + 1)
    if len(tooth) < 3:
        return np.zeros(len(at)), 0.0
    when = np.interp(tooth + pitch[tooth % teeth], turned, time)
    last = np.searchsorted(when, at, side="right") - 1
    first = np.minimum(np.searchsorted(when, at - window, side="right") - 1, last - 1)
    ok = (first >= 0) & (last >= 1)
    first, last = np.maximum(first, 0), np.maximum(last, 1)
    # it cannot be faster than the pulse that is missing
    took = np.maximum(when[last] - when[first], at - when[last])
    speed = np.where(ok & (at - when[last] < 0.3), step * (last - first) / np.maximum(took, 1e-6), 0.0)
    fast = ok & (speed > 15.0)
    age = float(np.mean((at - 0.5 * (when[last] + when[first]))[fast])) if fast.any() else 0.5 * window
    return speed, age


def make_log(
    car: Car, motion: Motion, rows: np.ndarray, rng: np.random.Generator
) -> tuple[dict[str, np.ndarray], dict[str, float]]:
    """Return the log at times of rows, s, (from 0), and the resulting latency by
    channel, s."""
    q, m, nominal = car.sensors, motion.state, car.vehicle
    log = {"time": rows - rows[0]}
    latency: dict[str, float] = {}
    at = {c: draw_sample_times(rows, q["latency"][c], q["period"][c], q, rng) for c in CHANNELS}
    latency = {c: float(np.mean(rows - at[c])) for c in CHANNELS}
    n = len(rows)

    turned = np.interp(at["steer_angle"], motion.time, m["steering_wheel"]) + q["steering_wheel_offset"]
    log["steer_angle"] = quantise(turned, q["steering_wheel_step"]) / nominal["steering_ratio"]

    for axle, wheels in (("front", ("fl", "fr")), ("rear", ("rl", "rr"))):
        name, radius = f"wheel_speed_{axle}", nominal[f"wheel_radius_{axle}"]
        speeds, ages = [], []
        for wheel in wheels:
            spin, age = m[f"spin_{wheel}"], 0.0
            pitch = q["wheel_pitch_sd"] * rng.standard_normal(max(q["wheel_pulses"], 1))
            noise = q["wheel_noise_sd"] * rng.standard_normal(n)
            if q["wheel_pulses"]:
                window = q["period"][name]
                speed, age = count_pulses(
                    motion.time, spin, at[name] + 0.5 * window, q["wheel_pulses"], window, pitch
                )
                speed, age = speed * radius, age - 0.5 * window
            else:
                speed = np.interp(at[name], motion.time, spin) * radius
                speed = np.where(
                    np.abs(speed) > 0.3,
                    speed + hold_noise(at[name], noise),
                    0.0 if q["wheel_step"] else speed,
                )
            speeds.append(quantise(speed, q["wheel_step"]))
            ages.append(age)
        log[name] = 0.5 * (speeds[0] + speeds[1]) / radius
        latency[name] += float(np.mean(ages))

    time, perfect = measure_motion(car, motion)
    b, a = butter(2, q["imu_bandwidth"], fs=1 / FINE)
    delay = float(group_delay((b, a), [1e-3])[1][0]) * FINE
    for k, name in enumerate(("accel_x", "accel_y", "yaw_rate")):
        kind = "accel" if k < 2 else "yaw_rate"
        slow, _ = lfilter(b, a, perfect[k], zi=lfilter_zi(b, a) * perfect[k, 0])
        x = np.interp(at[name] + delay, time, slow) * (1 + q[f"{name}_scale"]) + q[f"{name}_bias"]
        x += q[f"{kind}_walk"] * np.sqrt(ROW) * np.cumsum(rng.standard_normal(n))
        x += hold_noise(at[name], q[f"{kind}_sd"] * rng.standard_normal(n))
        log[name] = quantise(x, q[f"{kind}_step"])
    return log, latency


def make_pedals(
    q: dict[str, Any], reference: dict[str, np.ndarray], rng: np.random.Generator
) -> dict[str, np.ndarray]:
    """Return brake switch and wheel torques as sensors q log them.

    Torques are those of a model of the engine and of the brake pressure, with a scale
    error and a latency.
    """
    time, n = reference["time"], len(reference["time"])

    def late(name: str) -> np.ndarray:
        return np.interp(time - q["torque_latency"], time, reference[name])

    found = {"brake": np.where(late("brake") > 0.5, 1.0, 0.0)}
    for axle in ("front", "rear"):
        torque = late(f"wheel_torque_{axle}")
        scale = np.where(found["brake"] > 0, q[f"brake_scale_{axle}"], q["drive_scale"])
        found[f"wheel_torque_{axle}"] = torque * (1 + scale) + q["torque_sd"] * rng.standard_normal(n)
    return found
