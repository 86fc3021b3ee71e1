"""Logged channels of a motion: IMU, wheel speeds, steering, optional channels.

The signal filters, linear and others, work on every step: (steps,) or (steps, signals).
"""

import numpy as np

from .car import GRAVITY, SENSORS, SPEED_NOISE, STEER_NOISE, TORQUE_NOISE
from .manoeuvres import SETTLE, Program
from .model import OUTPUTS, SLOW, STEP, Motion

COLUMNS = ("time", "steer_angle", "wheel_speed_front", "wheel_speed_rear", "accel_x", "accel_y", "yaw_rate",
           "vehicle_speed", "wheel_torque_front", "wheel_torque_rear")  # fmt: skip
BIASES = ("accel_x", "accel_y", "yaw_rate")
BESSEL = (3.0, 3.0)  # s^2 T^2 + 3 s T + 3: second order, group delay T


def filter_second_order(x: np.ndarray, w: float, z: float) -> np.ndarray:
    """Filter by w^2/(s^2 + 2 z w s + w^2); exact for inputs linear within a step."""
    a = np.array([[0.0, 1.0], [-(w**2), -2 * z * w]])
    block = np.zeros((4, 4))  # x, dx, input, slope of the input
    block[:2, :2], block[1, 2], block[2, 3] = a, w**2, 1.0
    phi = compute_expm(block * STEP)[:2]
    y = np.empty_like(x, dtype=float)
    y[0], rate = x[0], 0.0 * x[0]
    for i in range(len(x) - 1):
        slope = (x[i + 1] - x[i]) / STEP
        y[i + 1] = phi[0, 0] * y[i] + phi[0, 1] * rate + phi[0, 2] * x[i] + phi[0, 3] * slope
        rate = phi[1, 0] * y[i] + phi[1, 1] * rate + phi[1, 2] * x[i] + phi[1, 3] * slope
    return y


def filter_bessel(x: np.ndarray, delay: float) -> np.ndarray:
    """Apply a two-pole Bessel low-pass."""
    w = np.sqrt(BESSEL[1]) / delay
    return filter_second_order(x, w, BESSEL[0] / (2 * np.sqrt(BESSEL[1])))


def delay_signal(x: np.ndarray, delay: float) -> np.ndarray:
    """Delay by any part of a step; before the start the first value holds."""
    at = np.arange(len(x)) - delay / STEP
    return np.interp(at, np.arange(len(x)), x)


def apply_backlash(x: np.ndarray, half: float) -> np.ndarray:
    """Return the signal that follows x through a play of +-half."""
    y = np.empty_like(x)
    last = x[0]
    for i, value in enumerate(x.tolist()):
        last = min(max(last, value - half), value + half)
        y[i] = last
    return y


def apply_sticking(x: np.ndarray, threshold: float) -> np.ndarray:
    """Hold the value until it is off by `threshold`, then jump to the signal."""
    y = np.empty_like(x)
    last = x[0]
    for i, value in enumerate(x.tolist()):
        if abs(value - last) > threshold:
            last = value
        y[i] = last
    return y


def compute_expm(a: np.ndarray) -> np.ndarray:
    total, term = np.eye(len(a)), np.eye(len(a))
    for n in range(1, 30):
        term = term @ a / n
        total = total + term
    return total


def make_rotation(roll: float, pitch: float, yaw: float) -> np.ndarray:
    """Return the matrix from components in the old axes to those in the rotated axes."""
    (cr, cp, cy), (sr, sp, sy) = np.cos([roll, pitch, yaw]), np.sin([roll, pitch, yaw])
    about_x = np.array([[1, 0, 0], [0, cr, sr], [0, -sr, cr]])
    about_y = np.array([[cp, 0, -sp], [0, 1, 0], [sp, 0, cp]])
    about_z = np.array([[cy, sy, 0], [-sy, cy, 0], [0, 0, 1]])
    return about_x @ about_y @ about_z


def measure_motion(car: dict[str, float], fast: np.ndarray) -> np.ndarray:
    """Return accel_x, accel_y and yaw_rate of every step. `fast`: (steps, OUTPUTS).

    An accelerometer measures the forces other than gravity. In the road's axes these are
    the forces of the tyres and the air, and upwards the weight that the tyres carry. A
    body that rolls by phi (left side up in a left turn) adds g sin(phi) to its lateral
    axis. A body that pitches by theta (nose down when braking) subtracts g sin(theta)
    from its longitudinal axis.
    """
    fx, fy, yaw_acc, r, roll, pitch = (fast[:, i] for i in range(len(OUTPUTS)))
    fx, fy = (
        fx - r**2 * car["imu_x"] - yaw_acc * car["imu_y"],
        fy + yaw_acc * car["imu_x"] - r**2 * car["imu_y"],
    )
    phi, theta = car["roll_gain"] * roll, -car["pitch_gain"] * pitch
    up = np.full_like(fx, GRAVITY)
    fx, up = fx * np.cos(theta) - up * np.sin(theta), up * np.cos(theta) + fx * np.sin(theta)
    fy, up = fy * np.cos(phi) + up * np.sin(phi), up * np.cos(phi) - fy * np.sin(phi)
    turn = make_rotation(car["imu_roll"], car["imu_pitch"], car["imu_yaw"])
    force = turn @ np.array([fx, fy, up])
    rate = turn @ np.array([r * np.sin(theta) * -1, r * np.sin(phi), r * np.cos(phi) * np.cos(theta)])
    y = np.stack(
        [force[0] * (1 + car["scale_x"]), force[1] * (1 + car["scale_y"]), rate[2] * (1 + car["scale_r"])], -1
    )
    return filter_bessel(y, car["imu_delay"]) if car["imu_delay"] > 0 else y


def make_log(
    car: dict[str, float],
    motion: Motion,
    i: int,
    program: Program,
    rng: np.random.Generator,
    noise: float = 1.0,
) -> tuple[dict[str, np.ndarray], dict[str, float]]:
    """Return the log of car i, and its biases; `noise` scales all noise and biases."""
    every = (len(motion.fast) - 1) // (len(motion.slow) - 1)
    first = round(SETTLE / STEP / every)
    slow = dict(zip(SLOW, motion.slow[first:, :, i].T, strict=True))
    n = len(slow["vx"])
    bias = {k: noise * SENSORS[f"{k}_bias_sd"] * rng.standard_normal() for k in BIASES}

    def jitter(sd: float) -> np.ndarray:
        return noise * sd * rng.standard_normal(n)

    steer = apply_sticking(program.steer, car["stick"]) if car["stick"] > 0 else program.steer
    log = {
        "time": np.arange(n) * every * STEP,
        "steer_angle": steer[::every][first:] + jitter(STEER_NOISE),
        "wheel_speed_front": slow["wf"] + jitter(SENSORS["wheel_noise_sd"]),
        "wheel_speed_rear": slow["wr"] + jitter(SENSORS["wheel_noise_sd"]),
    }
    measured = measure_motion(car, motion.fast[:, :, i])[::every][first:]
    for k, name in enumerate(BIASES):
        log[name] = measured[:, k] + bias[name] + jitter(SENSORS[f"{name}_sd"])
    log["vehicle_speed"] = np.hypot(slow["vx"], slow["vy"]) + jitter(SPEED_NOISE)
    log["wheel_torque_front"] = slow["tf"] + jitter(TORQUE_NOISE)
    log["wheel_torque_rear"] = slow["tr"] + jitter(TORQUE_NOISE)
    return log, bias
