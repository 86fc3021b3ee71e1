"""What is logged of a motion: the IMU on the body, wheel speeds, steering angle, and the optional channels."""

import numpy as np

from .car import GRAVITY, SENSORS, SPEED_NOISE, STEER_NOISE, TORQUE_NOISE
from .filters import bessel, sticking
from .manoeuvres import SETTLE, Program
from .model import OUTPUTS, SLOW, STEP, Motion

COLUMNS = ("time", "steer_angle", "wheel_speed_front", "wheel_speed_rear", "accel_x", "accel_y", "yaw_rate",
           "vehicle_speed", "wheel_torque_front", "wheel_torque_rear")  # fmt: skip
BIASES = ("accel_x", "accel_y", "yaw_rate")


def _rotation(roll: float, pitch: float, yaw: float) -> np.ndarray:
    """Components in the rotated axes of a vector given in the old ones."""
    (cr, cp, cy), (sr, sp, sy) = np.cos([roll, pitch, yaw]), np.sin([roll, pitch, yaw])
    about_x = np.array([[1, 0, 0], [0, cr, sr], [0, -sr, cr]])
    about_y = np.array([[cp, 0, -sp], [0, 1, 0], [sp, 0, cp]])
    about_z = np.array([[cy, sy, 0], [-sy, cy, 0], [0, 0, 1]])
    return about_x @ about_y @ about_z


def imu(car: dict[str, float], fast: np.ndarray) -> np.ndarray:
    """accel_x, accel_y, yaw_rate at every step. `fast`: (steps, OUTPUTS).

    An accelerometer feels the forces other than gravity: in the road's axes the tyres' and the air's, and upwards the weight
    that the tyres carry. A body that rolls by phi (left side up in a left turn) adds g sin(phi) to its lateral axis, one that
    pitches by theta (nose down when braking) takes g sin(theta) from its longitudinal axis.
    """
    fx, fy, yaw_acc, r, roll, pitch = (fast[:, i] for i in range(len(OUTPUTS)))
    fx, fy = fx - r**2 * car["imu_x"] - yaw_acc * car["imu_y"], fy + yaw_acc * car["imu_x"] - r**2 * car["imu_y"]
    phi, theta = car["roll_gain"] * roll, -car["pitch_gain"] * pitch
    up = np.full_like(fx, GRAVITY)
    fx, up = fx * np.cos(theta) - up * np.sin(theta), up * np.cos(theta) + fx * np.sin(theta)
    fy, up = fy * np.cos(phi) + up * np.sin(phi), up * np.cos(phi) - fy * np.sin(phi)
    turn = _rotation(car["imu_roll"], car["imu_pitch"], car["imu_yaw"])
    force = turn @ np.array([fx, fy, up])
    rate = turn @ np.array([r * np.sin(theta) * -1, r * np.sin(phi), r * np.cos(phi) * np.cos(theta)])
    y = np.stack([force[0] * (1 + car["scale_x"]), force[1] * (1 + car["scale_y"]), rate[2] * (1 + car["scale_r"])], -1)
    return bessel(y, car["imu_delay"]) if car["imu_delay"] > 0 else y


def log_of(
    car: dict[str, float], motion: Motion, i: int, program: Program, rng: np.random.Generator, noise: float = 1.0
) -> tuple[dict[str, np.ndarray], dict[str, float]]:
    """The log of car i, and its biases. `noise` scales all noise and biases."""
    every = (len(motion.fast) - 1) // (len(motion.slow) - 1)
    first = round(SETTLE / STEP / every)
    slow = dict(zip(SLOW, motion.slow[first:, :, i].T, strict=True))
    n = len(slow["vx"])
    bias = {k: noise * SENSORS[f"{k}_bias_sd"] * rng.standard_normal() for k in BIASES}

    def jitter(sd: float) -> np.ndarray:
        return noise * sd * rng.standard_normal(n)

    steer = sticking(program.steer, car["stick"]) if car["stick"] > 0 else program.steer
    log = {
        "time": np.arange(n) * every * STEP,
        "steer_angle": steer[::every][first:] + jitter(STEER_NOISE),
        "wheel_speed_front": slow["wf"] + jitter(SENSORS["wheel_noise_sd"]),
        "wheel_speed_rear": slow["wr"] + jitter(SENSORS["wheel_noise_sd"]),
    }
    measured = imu(car, motion.fast[:, :, i])[::every][first:]
    for k, name in enumerate(BIASES):
        log[name] = measured[:, k] + bias[name] + jitter(SENSORS[f"{name}_sd"])
    log["vehicle_speed"] = np.hypot(slow["vx"], slow["vy"]) + jitter(SPEED_NOISE)
    log["wheel_torque_front"] = slow["tf"] + jitter(TORQUE_NOISE)
    log["wheel_torque_rear"] = slow["tr"] + jitter(TORQUE_NOISE)
    return log, bias
