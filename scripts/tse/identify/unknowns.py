"""List the unknowns of a car and its sensors with their priors.

Priors are those of passenger cars without calibration. Effects that every car has (roll,
relaxation) have a prior about their usual size, not about 0. An effect that a log does
not show keeps this size and its sd.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from tse.car.vehicle import GRAVITY, Vehicle
from tse.library.core import STIFFNESS, Config

MEASURED = ("accel_x", "accel_y", "yaw_rate")
VELOCITY = ("ins_vel_x", "ins_vel_y", "gnss_speed")  # optional channels of a log, compared if present
CHANNEL_UNIT = {"accel_x": "m/s2", "accel_y": "m/s2", "yaw_rate": "rad/s"} | dict.fromkeys(VELOCITY, "m/s")
CORNERING_AXLES = {"cy_front": "front", "cy_rear": "rear"}  # cornering stiffness, and its axle
LATE_CHANNELS = ("steer_angle", "wheel_speed_front", "wheel_speed_rear", "accel_x", "accel_y")
LATENCY_SUFFIX = "_latency"  # behind the gyro
LATENCIES = {c + LATENCY_SUFFIX: c for c in LATE_CHANNELS}  # unknown, and its channel
MAX_LATENCY = 0.2  # s, of a channel behind or before the gyro
# sd that the unknowns of one `message` share: latency behind the gyro [s] of channels in
# one message, relative error of the radii. The sd of each unknown beside it is smaller:
# wheel speeds come from one unit, accelerometers from one chip, tyres from one shop. The
# latency between both axles hardly shows, and with a wide prior it would absorb model
# errors
COMMON_SD = {"": 0.0, "wheels": 0.025, "accelerometers": 0.02, "radii": 0.007}
LN_STIFFNESS_SD = 0.5  # ln, of the stiffness over that of the vehicle file
MAX_LN_STIFFNESS = 1.8  # ln, bound of the same
# Posterior over prior sd: below, the logs show the unknown
MAX_SHOWN_RATIO = 0.7
SIGNIFICANT_SD = 3.0  # sd from 0: a size beyond is significant
# Cornering stiffness is searched as its inverse: the motion is nearly linear in the
# compliance of the axles, and steps in the stiffness would overshoot the minimum
COMPLIANCE = ("cy_front", "cy_rear")
# Share of the lateral acceleration in a curve that the bank of the road takes, by log.
# Real roads are built so. Without it, the bank would appear as a scale of accel_y or as
# other tyres
LEAN_MEAN, LEAN_SD = 0.12, 0.05
BIAS_SD = {"accel_x": 0.5, "accel_y": 0.5, "yaw_rate": 0.02}  # m/s2, rad/s: of each log
# Lower limits of posterior sds. The covariance leaves out that roads differ in their
# lean, steering moves with force, axles differ in relaxation, and the zero of a steering
# rack changes from day to day
MIN_SD = {
    "lean_sd": 0.1,
    "trail_sd": 0.02,
    "gyro_scale_sd": 0.005,
    "relaxation_sd": 0.12,
    "steer_offset_sd": 0.0003,
}


@dataclass(frozen=True)
class Unknown:
    """One unknown. `name` is its setting."""

    name: str
    group: str  # heading in reports
    mean: float
    sd: float
    low: float
    high: float
    relative: bool = False  # mean, sd and range are relative to the vehicle file
    message: str = ""  # unknowns of one message share an error with the sd COMMON_SD[message]
    worth: float = 0.0  # smallest size worth reporting; 0: shape of an effect


def _make_latency(name: str, own: float, message: str = "") -> Unknown:
    """Return the latency of a channel as an unknown, with its own sd [s]."""
    return Unknown(
        name + LATENCY_SUFFIX, "latency", 0.0, own, -MAX_LATENCY, MAX_LATENCY, message=message, worth=0.001
    )


# Sources of the sizes: src/tables/effects.toml (typical sizes). Sensors: CAN cycle times
# of 10 .. 20 ms and filters of 10 .. 30 ms (latencies), 1 to 2 degrees of mounting, 1 %
# of scale. fmt: off
UNKNOWNS: tuple[Unknown, ...] = (
    _make_latency("steer_angle", 0.025),
    _make_latency("wheel_speed_front", 0.0005, "wheels"),
    _make_latency("wheel_speed_rear", 0.0005, "wheels"),
    _make_latency("accel_x", 0.01, "accelerometers"),
    _make_latency("accel_y", 0.01, "accelerometers"),
    Unknown("steering_ratio_change", "steering", 0.0, 0.03, -0.3, 0.3, worth=0.005),
    Unknown("steering_offset_angle", "steering", 0.0, 0.005, -0.05, 0.05, worth=0.0003),
    Unknown("steering_lag_time", "steering lag", 0.02, 0.02, 0.0, 0.5, worth=0.003),
    Unknown("yaw_inertia", "yaw inertia", 1.0, 0.1, 0.5, 2.0, relative=True, worth=0.03),
    # axle loads are weighed; a file without them gives a larger cg_sd
    Unknown("cg_shift_distance", "centre of gravity", 0.0, 0.01, -0.6, 0.6, worth=0.02),
    # the ratio of the radii hardly shows beside longitudinal stiffness: prior by wear and
    # pressure
    Unknown(
        "wheel_radius_front", "wheel radii", 1.0, 0.003, 0.9, 1.1, relative=True, message="radii", worth=0.002
    ),
    Unknown(
        "wheel_radius_rear", "wheel radii", 1.0, 0.003, 0.9, 1.1, relative=True, message="radii", worth=0.002
    ),
    # axles share a force by their stiffness; with a wrong share, wheels seem late by tens
    # of ms
    Unknown(
        "longitudinal_stiffness_rear",
        "rear longitudinal stiffness",
        1.0,
        0.15,
        0.3,
        3.0,
        relative=True,
        worth=0.05,
    ),
    Unknown("relaxation_length", "relaxation", 0.4, 0.25, 0.0, 3.0, worth=0.05),
    Unknown("longitudinal_relaxation_length", "longitudinal relaxation", 0.1, 0.1, 0.0, 2.0, worth=0.02),
    Unknown("body_roll_gain", "roll", 0.008, 0.002, -0.02, 0.04, worth=0.0008),
    Unknown("body_roll_frequency", "roll", 1.6, 0.3, 0.3, 6.0),
    Unknown("body_roll_damping", "roll", 0.3, 0.1, 0.05, 2.0),
    Unknown("body_roll_height", "roll", 0.2, 0.3, -1.0, 1.5),
    Unknown("body_roll_coupling", "roll", 0.2, 0.2, -0.5, 1.0),
    Unknown("pitch_leak_gain", "pitch", 0.004, 0.003, -0.01, 0.03, worth=0.0006),
    Unknown("pitch_leak_frequency", "pitch", 1.8, 0.3, 0.3, 6.0),
    Unknown("pitch_leak_damping", "pitch", 0.4, 0.15, 0.05, 2.0),
    Unknown("pitch_leak_height", "pitch", 0.2, 0.3, -1.0, 1.5),
    Unknown("imu_lever_arm_x", "IMU place", 0.0, 0.5, -4.0, 4.0, worth=0.05),
    Unknown("imu_lever_arm_y", "IMU place", 0.0, 0.3, -2.0, 2.0, worth=0.05),
    Unknown("imu_misalignment_angle", "IMU mounting", 0.0, 0.02, -0.2, 0.2, worth=0.004),
    Unknown("imu_scale_ax_error", "IMU scale", 0.0, 0.01, -0.3, 0.3, worth=0.005),
    Unknown("imu_scale_ay_error", "IMU scale", 0.0, 0.01, -0.3, 0.3, worth=0.005),
    Unknown("gyro_scale_error", "IMU scale", 0.0, 0.005, -0.3, 0.3, worth=0.003),
    Unknown("lateral_load_transfer_gain", "tyres", 0.002, 0.002, -0.003, 0.03, worth=0.0004),
    # an axle with a larger share of the roll stiffness than of the weight loses more
    # grip: 0.4 .. 0.63 of the roll stiffness is in front
    Unknown("lateral_load_transfer_balance", "tyres", 0.0, 0.2, -1.0, 1.0),
    Unknown("longitudinal_load_transfer_gain", "tyres", 0.02, 0.015, -0.08, 0.08, worth=0.004),
    # the tyres of the axle with more weight gain less by a load
    Unknown("longitudinal_load_transfer_balance", "tyres", 0.0, 0.2, -1.0, 1.0),
    Unknown("combined_slip_factor", "tyres", 100.0, 100.0, 0.0, 2000.0, worth=20.0),
    Unknown("aligning_moment_trail", "tyres", 0.025, 0.012, -0.1, 0.1, worth=0.005),
    Unknown("tyre_saturation_inverse_friction", "tyres", 1.0, 0.25, 0.0, 5.0, worth=0.2),
    # axles differ in tyres or camber: ratio 0.8 .. 1.2
    Unknown("tyre_saturation_balance", "tyres", 0.0, 0.1, -0.5, 0.5),
    Unknown("aero_drag_coefficient", "resistance", 0.4, 0.1, 0.0, 5.0, worth=0.1),
    Unknown("rolling_resistance_coefficient", "resistance", 0.01, 0.004, 0.0, 0.2, worth=0.003),
)
# fmt: on
# Unknowns of a velocity sensor, of logs that have one; sds are settings (sensors.toml).
OF_VELOCITY: tuple[Unknown, ...] = (
    Unknown("velocity_latency", "velocity", 0.0, 0.03, -MAX_LATENCY, MAX_LATENCY, worth=0.002),
    Unknown("velocity_lever_x", "velocity", 0.0, 0.1, -20.0, 20.0, worth=0.05),
    Unknown("velocity_lever_y", "velocity", 0.0, 0.1, -20.0, 20.0, worth=0.05),
    Unknown("velocity_heading", "velocity", 0.0, 0.02, -0.5, 0.5, worth=0.001),
)
VELOCITY_SD = {u.name: u.name.removesuffix("_x").removesuffix("_y") + "_sd" for u in OF_VELOCITY}  # settings
# Settings of [uncertainty], and the unknowns whose sd they are, in the prior and the
# result.
UNCERTAIN_SETTINGS = {
    "cg_sd": "cg_shift_distance",
    "steer_ratio_sd": "steering_ratio_change",
    "steer_offset_sd": "steering_offset_angle",
    "accel_y_scale_sd": "imu_scale_ay_error",
    "accel_delay_sd": "accel_y_latency",
    "relaxation_sd": "relaxation_length",
    "gyro_scale_sd": "gyro_scale_error",
    "trail_sd": "aligning_moment_trail",
}
# effects that scale accel_y in the same way, with their factor
SCALE_PARTNERS = {"imu_scale_ay_error": ("body_roll_gain", GRAVITY)}
SUPERELEVATION = "superelevation"  # unknown of each log, see name_in_log()


def name_in_log(name: str, log: int) -> str:
    """Return the name of an unknown that each log has."""
    return f"{name}@{log}"


def name_bias(channel: str, log: int) -> str:
    """Return the name of the bias of a channel in one log."""
    return f"{channel}~{log}"


def get_unit(name: str) -> str:
    """Return the unit of an unknown."""
    if name in LATENCIES:
        return "s"
    fields = Config().fields
    return fields[name].unit if name in fields else "ln"


@dataclass
class Prior:
    """Gaussian of the unknowns of the car, and their bounds, in the order of `names`."""

    names: tuple[str, ...]
    mean: np.ndarray
    covariance: np.ndarray
    low: np.ndarray
    high: np.ndarray

    @property
    def sd(self) -> np.ndarray:
        """Standard deviation of each unknown."""
        return np.sqrt(np.diag(self.covariance))

    def select(self, names: Sequence[str]) -> Prior:
        """Return the prior of some of the unknowns."""
        at = [self.names.index(n) for n in names]
        covariance = self.covariance[np.ix_(at, at)]
        return Prior(tuple(names), self.mean[at], covariance, self.low[at], self.high[at])


def make_prior(vehicle: Vehicle, config: Config, velocity: bool = False) -> Prior:
    """Return the prior of the unknowns of a car.

    It is the table about the settings of the vehicle file. The result of an earlier
    calibration replaces it, if the file has one.

    Parameters
    ----------
    vehicle, config
        The vehicle file, and its settings.
    velocity
        A log has a measured velocity.
    """
    known = UNKNOWNS + (OF_VELOCITY if velocity else ())
    names = tuple(u.name for u in known) + STIFFNESS
    mean, sd, low, high = (np.zeros(len(names)) for _ in range(4))
    scale = [float(getattr(config, u.name)) if u.relative else 1.0 for u in known]
    stated = {name: key for key, name in UNCERTAIN_SETTINGS.items() if key in vehicle.given_uncertainty}
    stated |= {"yaw_inertia": "yaw_inertia_sd"} if "yaw_inertia_sd" in vehicle.given_uncertainty else {}
    for k, (u, by) in enumerate(zip(known, scale, strict=True)):
        own = max(vehicle.values[stated[u.name]], 0.01 * u.sd) if u.name in stated and not u.message else u.sd
        own = max(float(getattr(config, VELOCITY_SD[u.name])), 0.01 * u.sd) if u.name in VELOCITY_SD else own
        mean[k], sd[k], low[k], high[k] = u.mean * by, own * by, u.low * by, u.high * by
        if not u.relative and u.name in vehicle.values:
            mean[k] = vehicle.values[u.name]
    n = len(known)
    sd[n:], low[n:], high[n:] = LN_STIFFNESS_SD, -MAX_LN_STIFFNESS, MAX_LN_STIFFNESS
    covariance = np.diag(sd**2)
    for i, u in enumerate(known):
        for k, v in enumerate(known):
            both = scale[i] * scale[k] * COMMON_SD[u.message] ** 2
            covariance[i, k] += both if u.message == v.message else 0.0
    earlier: Mapping = vehicle.calibration
    if earlier:
        place = [names.index(name) for name in earlier["names"] if name in names]
        of = [k for k, name in enumerate(earlier["names"]) if name in names]
        mean[place] = np.array(earlier["mean"])[of]
        covariance[np.ix_(place, place)] = np.array(earlier["covariance"])[np.ix_(of, of)]
    return Prior(names, np.clip(mean, low, high), covariance, low, high)
