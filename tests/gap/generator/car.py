"""The car: every number of the model, with all physical effects off.

An effect changes some of them (effects.py).
"""

import numpy as np

GRAVITY = 9.81
RIGID = 1000.0  # friction coefficient of a tyre that does not saturate

# As the calibration engineer measures it. The yaw inertia is the one that acts on the yaw
# acceleration, spin of the wheels included.
NOMINAL: dict[str, float] = {
    "mass": 1650.0, "yaw_inertia": 2700.0, "lf": 1.20, "lr": 1.52, "track_front": 1.56, "track_rear": 1.55,
    "wheel_radius_front": 0.325, "wheel_radius_rear": 0.325, "cg_height": 0.56,
    "longitudinal_stiffness_front": 1.9e5, "longitudinal_stiffness_rear": 1.6e5,
    "cornering_stiffness_front": 1.05e5, "cornering_stiffness_rear": 1.30e5,
}  # fmt: skip

SENSORS: dict[str, float] = {
    "accel_x_sd": 0.06, "accel_y_sd": 0.06, "yaw_rate_sd": 0.002, "wheel_noise_sd": 0.02,
    "accel_x_bias_sd": 0.08, "accel_y_bias_sd": 0.08, "yaw_rate_bias_sd": 0.002,
}  # fmt: skip
STEER_NOISE = 1e-4  # rad at the road wheel: 0.1 degree of steering wheel over a ratio of 16
SPEED_NOISE, TORQUE_NOISE = 0.05, 8.0  # m/s, N m: the optional channels

# Beyond NOMINAL: parts of the car, and every effect at "off".
PARTS: dict[str, float] = {
    "wheel_inertia": 1.1,
    "drive_front": 1.0,
    "brake_front": 0.66,  # kg m2 of one wheel; shares of torque
    "roll_front": 0.54,  # share of the lateral load transfer that the front axle takes
    "f_roll": 1.6,
    "z_roll": 0.3,
    "f_pitch": 1.7,
    "z_pitch": 0.35,  # the body's modes: Hz, damping ratio
    "exact": 0.0,
    "ackermann": 0.6,
    "mu": RIGID,
    "shape_y": -0.4,
    "shape_x": 0.0,
    "combined": 0.0,
    "load_sensitive": 0.0,
    "h_lateral": 0.0,
    "h_longitudinal": 0.0,
    "sigma_front": 0.0,
    "sigma_rear": 0.0,
    "sigma_x": 0.0,
    "roll_gain": 0.0,
    "roll_coupling": 0.0,
    "pitch_gain": 0.0,
    "pitch_coupling": 0.0,  # rad s2/m, s2
    "rear_roll_steer": 0.0,
    "trail": 0.0,
    "conicity_front": 0.0,
    "conicity_rear": 0.0,
    "drift": 0.0,
    "drag": 0.0,
    "rolling": 0.0,
    "wind_x": 0.0,
    "wind_y": 0.0,
    "side_area": 0.0,
    "wind_arm": 0.45,
    "grade": 0.0,
    "bank": 0.0,
    "bank_wander": 0.0,  # rms, mean, rms of the road's profiles, rad
    "steer_ratio": 0.0,
    "steer_offset": 0.0,
    "steer_lag": 0.0,
    "steer_lag_z": 0.8,
    "steer_delay": 0.0,
    "compliance": 0.0,
    "imu_x": 0.0,
    "imu_y": 0.0,
    "scale_x": 0.0,
    "scale_y": 0.0,
    "scale_r": 0.0,
    "imu_yaw": 0.0,
    "imu_roll": 0.0,
    "imu_pitch": 0.0,
    "imu_delay": 0.0,
    # outside the catalogue
    "play": 0.0,
    "gust": 0.0,
    "resonance": 0.0,
    "f_resonance": 4.5,
    "patch": 0.0,
    "stick": 0.0,
    "ratio_v": 0.0,
    "active": 0.0,
}


def make_baseline() -> dict[str, float]:
    """Return the nominal car with every effect off."""
    return {**NOMINAL, **PARTS}


def draw_car(rng: np.random.Generator) -> dict[str, float]:
    """Draw a car with every effect off whose tyres differ somewhat from the nominal ones.

    The estimator has to find their stiffness.
    """
    car = make_baseline()
    axes = rng.uniform(0.90, 1.12, 3)
    for key, factor in zip(
        ("longitudinal_stiffness", "cornering_stiffness_front", "cornering_stiffness_rear"), axes, strict=True
    ):
        for name in (key,) if key in car else (f"{key}_front", f"{key}_rear"):
            car[name] *= factor
    car["shape_y"] = rng.uniform(-0.9, 0.1)
    car["roll_front"] = rng.uniform(0.50, 0.58)
    return car


def compute_understeer(car: dict[str, float]) -> float:
    """Return the understeer gradient, rad s2/m.

    It is the road-wheel angle beyond Ackermann's per lateral acceleration.
    """
    lf, lr = car["lf"], car["lr"]
    return (
        car["mass"]
        / (lf + lr)
        * (lr / car["cornering_stiffness_front"] - lf / car["cornering_stiffness_rear"])
    )
