"""List the unknowns of a car and its sensors with their priors.

The priors describe passenger cars that have not been calibrated. For effects that every
car has (roll, relaxation), the prior mean is the usual size, not 0. If the logs do not
show an effect, its estimate keeps the prior mean and the prior sd.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from tse.car.vehicle import GRAVITY, Vehicle
from tse.library.core import STIFFNESS, Config

MEASURED = ("accel_x", "accel_y", "yaw_rate")
VELOCITY = ("ins_vel_x", "ins_vel_y", "gnss_speed")  # optional channels, compared if a log has them
CHANNEL_UNIT = {"accel_x": "m/s2", "accel_y": "m/s2", "yaw_rate": "rad/s"} | dict.fromkeys(VELOCITY, "m/s")
CORNERING_AXLES = {"cy_front": "front", "cy_rear": "rear"}  # name of a cornering stiffness -> axle
LATE_CHANNELS = ("steer_angle", "wheel_speed_front", "wheel_speed_rear", "accel_x", "accel_y")
# The unknown CHANNEL_latency is the latency of a channel relative to the gyro
LATENCY_SUFFIX = "_latency"
LATENCIES = {c + LATENCY_SUFFIX: c for c in LATE_CHANNELS}  # name of the unknown -> channel
MAX_FITTED_LATENCY = 0.2  # [s] bound of a latency, positive or negative
# Key: Unknown.message. Value: prior sd of the error that all unknowns with this message
# have in common (latency [s], relative error of the wheel radius). Example: the wheel
# speeds of both axles come from one control unit, so their latencies are nearly equal
COMMON_SD = {"": 0.0, "wheels": 0.025, "accelerometers": 0.02, "radii": 0.007}
LN_STIFFNESS_SD = 0.5  # prior sd of ln(stiffness / its value in the vehicle file)
MAX_LN_STIFFNESS = 1.8  # bound of |ln(stiffness / its value in the vehicle file)|
MAX_SHOWN_RATIO = 0.7  # ratio of posterior to prior sd; below it, the logs determine the unknown
SIGNIFICANT_SD = 3.0  # [posterior sd] distance from 0 above which an unknown is significant
# stiffnesses that the fit varies as compliance = 1 / stiffness, because the motion is
# nearly linear in the compliance
COMPLIANCE = ("cy_front", "cy_rear")
# Prior mean and sd of the lean of the roads of a log. The lean is the share of the
# lateral acceleration in curves that the bank of the road compensates; roads are built
# with such a bank. Without the lean, a fit would explain the bank by a scale error of
# accel_y or by different tyres
LEAN_MEAN, LEAN_SD = 0.12, 0.05
BIAS_SD = {"accel_x": 0.5, "accel_y": 0.5, "yaw_rate": 0.02}  # [m/s2, rad/s] prior sd in each log
# Key: setting of table [uncertainty]. Value: smallest sd that a calibration writes there,
# in the unit of the setting. The posterior sd alone can be too small: it ignores that
# roads differ in lean, axles differ in relaxation, the steering is elastic, and the zero
# of the steering angle changes every day
MIN_SD = {
    "lean_sd": 0.1,
    "trail_sd": 0.02,
    "gyro_scale_sd": 0.005,
    "relaxation_sd": 0.12,
    "steer_offset_sd": 0.0003,
}


@dataclass(frozen=True)
class Unknown:
    """An unknown of the car, with its prior and bounds."""

    name: str  # name of the setting
    group: str  # heading in reports
    mean: float  # prior mean
    sd: float  # prior sd
    low: float  # lower bound
    high: float  # upper bound
    relative: bool = False  # True: mean, sd and bounds are relative to the vehicle file
    # Unknowns with the same message, e.g. "wheels", have a common error with the prior sd
    # COMMON_SD[message]. Each also has an individual error with the prior sd `sd`. "": no
    # common error
    message: str = ""
    # Changes against the vehicle file (latency: against 0) below this value are
    # negligible. Unit: that of `mean`. 0: no change is negligible, as for a balance
    # between the axles
    worth: float = 0.0


def _make_latency(name: str, own: float, message: str = "") -> Unknown:
    """Return the latency of a channel as an unknown.

    `own` [s] is the prior sd of the individual error. Channels with the same `message`
    also have a common error (see COMMON_SD).
    """
    return Unknown(
        name + LATENCY_SUFFIX,
        "latency",
        0.0,
        own,
        -MAX_FITTED_LATENCY,
        MAX_FITTED_LATENCY,
        message=message,
        worth=0.001,
    )


# Prior means and sds follow from the typical sizes in src/tables/effects.toml. Those of
# sensors follow from CAN cycle times of 10 .. 20 ms and filters of 10 .. 30 ms (latency),
# mounting errors of 1 to 2 degrees, and scale errors of 1 %.
UNKNOWNS: tuple[Unknown, ...] = (
    _make_latency("steer_angle", 0.025),
    # 0.5 ms: logs hardly show by how much the latencies of the axles differ
    _make_latency("wheel_speed_front", 0.0005, "wheels"),
    _make_latency("wheel_speed_rear", 0.0005, "wheels"),
    _make_latency("accel_x", 0.01, "accelerometers"),
    _make_latency("accel_y", 0.01, "accelerometers"),
    Unknown("steering_ratio_change", "steering", 0.0, 0.03, -0.3, 0.3, worth=0.005),
    Unknown("steering_offset_angle", "steering", 0.0, 0.005, -0.05, 0.05, worth=0.0003),
    Unknown("steering_lag_time", "steering lag", 0.02, 0.02, 0.0, 0.5, worth=0.003),
    Unknown("yaw_inertia", "yaw inertia", 1.0, 0.1, 0.5, 2.0, relative=True, worth=0.03),
    # The sd of 0.01 m is that of weighed axle loads. If the vehicle file states cg_sd,
    # e.g. 0.03 m for loads from a data sheet, cg_sd replaces the sd given here
    Unknown("cg_shift_distance", "centre of gravity", 0.0, 0.01, -0.6, 0.6, worth=0.02),
    # Logs can hardly distinguish an error in the ratio of the radii from an error of the
    # longitudinal stiffness. With a large prior sd, the fit would explain an error of the
    # stiffness by wrong radii. So the prior sd only covers wear and tyre pressure
    Unknown(
        "wheel_radius_front", "wheel radii", 1.0, 0.003, 0.9, 1.1, relative=True, message="radii", worth=0.002
    ),
    Unknown(
        "wheel_radius_rear", "wheel radii", 1.0, 0.003, 0.9, 1.1, relative=True, message="radii", worth=0.002
    ),
    # This unknown lets the ratio of rear to front stiffness change. With a wrong constant
    # ratio, the fit would compensate by latencies that are wrong by tens of ms
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
    # The axle with the larger share of the roll stiffness has more load transfer and
    # loses more cornering stiffness. Front axles have a share s of 0.4 .. 0.63. If the
    # loss is proportional to the share, the balance is 2 s - 1 = -0.2 .. 0.26
    Unknown("lateral_load_transfer_balance", "tyres", 0.0, 0.2, -1.0, 1.0),
    Unknown("longitudinal_load_transfer_gain", "tyres", 0.02, 0.015, -0.08, 0.08, worth=0.004),
    # not 0 if the static axle loads differ: the load transfer of both axles is equal, so
    # the axle with the larger static load has the smaller relative change of stiffness
    Unknown("longitudinal_load_transfer_balance", "tyres", 0.0, 0.2, -1.0, 1.0),
    Unknown("combined_slip_factor", "tyres", 100.0, 100.0, 0.0, 2000.0, worth=20.0),
    Unknown("aligning_moment_trail", "tyres", 0.025, 0.012, -0.1, 0.1, worth=0.005),
    Unknown("tyre_saturation_inverse_friction", "tyres", 1.0, 0.25, 0.0, 5.0, worth=0.2),
    # Tyres and camber make the friction of the two axles different. A balance of b means
    # a ratio front/rear of (1 - b)/(1 + b): with the sd of 0.1, 0.8 .. 1.2
    Unknown("tyre_saturation_balance", "tyres", 0.0, 0.1, -0.5, 0.5),
    Unknown("aero_drag_coefficient", "resistance", 0.4, 0.1, 0.0, 5.0, worth=0.1),
    Unknown("rolling_resistance_coefficient", "resistance", 0.01, 0.004, 0.0, 0.2, worth=0.003),
)
# Unknowns of a velocity sensor, if a log has one. The settings in VELOCITY_SD replace the
# prior sds given here
OF_VELOCITY: tuple[Unknown, ...] = (
    Unknown("velocity_latency", "velocity", 0.0, 0.03, -MAX_FITTED_LATENCY, MAX_FITTED_LATENCY, worth=0.002),
    Unknown("velocity_lever_x", "velocity", 0.0, 0.1, -20.0, 20.0, worth=0.05),
    Unknown("velocity_lever_y", "velocity", 0.0, 0.1, -20.0, 20.0, worth=0.05),
    Unknown("velocity_heading", "velocity", 0.0, 0.02, -0.5, 0.5, worth=0.001),
)
# name of an unknown of a velocity sensor -> setting with its prior sd
VELOCITY_SD = {u.name: u.name.removesuffix("_x").removesuffix("_y") + "_sd" for u in OF_VELOCITY}
# Key: setting of table [uncertainty]. Value: unknown whose posterior sd a calibration
# writes to the setting. If the vehicle file states the setting, it is also the prior sd
# of the unknown, except if the unknown has a `message`
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
# Roll of the body (gain g in rad per m/s2) changes accel_y like a scale error of
# GRAVITY * g. Logs determine only the sum: scale error of the sensor + GRAVITY * g.
# Key: name of the scale error. Value: name of g, and the factor of g in the sum
SCALE_PARTNERS = {"imu_scale_ay_error": ("body_roll_gain", GRAVITY)}
SUPERELEVATION = "superelevation"  # lean of a log's roads (LEAN_MEAN); name_in_log() adds the log's index


def name_in_log(name: str, log: int) -> str:
    """Return the name of an unknown of one log."""
    return f"{name}@{log}"


def name_bias(channel: str, log: int) -> str:
    """Return the name of the bias of a channel in one log."""
    return f"{channel}~{log}"


def get_unit(name: str) -> str:
    """Return the unit of an unknown; "ln" for a stiffness: its logarithm is estimated."""
    if name in LATENCIES:
        return "s"
    fields = Config().fields
    return fields[name].unit if name in fields else "ln"


@dataclass
class Prior:
    """Normal prior and bounds of the unknowns of the car, in the order of `names`."""

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

    Means and sds come from the vehicle file, else from UNKNOWNS. If the file contains the
    result of an earlier calibration, its means and covariances are used instead.

    Parameters
    ----------
    vehicle, config
        The vehicle file, and its settings.
    velocity
        True: a log has a measured velocity, so the prior contains OF_VELOCITY, too.
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
