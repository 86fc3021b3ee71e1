"""Names, units and ranges of the C library. scripts/dev/api_tables.py wrote it."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import Literal, TypedDict

from tse._base import EstimateBase

CHANNELS = ("steer_angle", "wheel_speed_front", "wheel_speed_rear", "accel_x", "accel_y", "yaw_rate")
STIFFNESS = ("cx_front", "cy_front", "cy_rear")
Reason = Literal[
    "valid",
    "starting",
    "not excited",
    "uncertain",
    "sensor fault",
    "held",
    "input invalid",
    "parameters uncertain",
    "does not fit",
    "implausible",
]


class Status(IntEnum):
    """What the filter did with a row. Below 0: it refused the row, and the estimates are
    unchanged. 0: it used the row. Above 0: it used the row. The code is a warning."""

    E_BUILD = -12
    """This build rounds differently from the tested ones: compile without -ffast-math,
    with -ffp-contract=off."""
    E_FORMAT = -11
    """A setting leads to numbers that do not fit the fixed-point format of this build;
    use double or float."""
    E_OLD = -10
    """The learnt state was written by an older version of this library; learn anew."""
    E_VEHICLE = -9
    """The learnt state belongs to another vehicle."""
    E_VERSION = -8
    """The learnt state was written by a newer version of this library."""
    E_LEARNT = -7
    """This is not a learnt state of this library, or it is damaged."""
    E_SIZE = -6
    """The memory of the filter has a different size than the library expects (other
    number of particles or number format)."""
    E_STATE = -5
    """The filter was not reset with these parameters, or is not a filter of this
    library."""
    E_TIME = -4
    """The time step is not finite, not positive, or too long."""
    E_INPUT = -3
    """An input that drives the model is outside its range."""
    E_CONFIG = -2
    """A setting is outside its range."""
    E_NULL = -1
    """A required argument is NULL."""
    OK = 0
    """Ok."""
    NOT_VALID = 1
    """At least one stiffness is not valid; see its reason."""
    STARTING = 2
    """Too few informative rows since the start: no stiffness is valid yet."""
    MISSING_CHANNEL = 3
    """A measurement is missing; the others are used."""
    HELD = 4
    """Standstill, low speed, reverse or large steering angle: stiffness is not
    updated."""
    PREDICTED = 5
    """All measurements or an input are missing: the filter only predicts."""
    GAP = 6
    """Long gap between rows, or jump of the sensors: the motion is set from the
    sensors, all other estimates are kept."""
    RECOVERED = 7
    """The filter started over, because its state was not finite (memory fault or
    overflow)."""
    WAITING = 8
    """No step in this row: the filter waits for channels with a latency; the estimates
    are those of the last step, or of the start."""
    RANGE = 9
    """A number of the filter reached the limit of the fixed-point format: the number
    is kept at this limit, or the sample that led to it is not used."""
    IMPLAUSIBLE = 10
    """The channels contradict each other: one has a wrong unit or sign, belongs to a
    different axle, or is late; fault_channel names it, fault_factor is the factor
    by which it is too large."""


class Row(TypedDict, total=False):
    """One sample: SI units, ISO 8855 (x forward, y left, z up; angles and rates positive
    to the left). A field that is left out, None or NaN is missing."""

    dt: float
    """Time since the previous row; not needed in the first row, or if `time` is given
    [s, above 0 .. 3600]."""
    time: float
    """Time of the row on any clock; `dt` is then its difference to the previous row
    [s]."""
    steer_angle: float
    """Mean road-wheel angle of the front axle, positive left [-1.2 .. 1.2 rad]."""
    wheel_speed_front: float
    """Mean rotation rate of the front wheels, positive forward [-400 .. 400 rad/s]."""
    wheel_speed_rear: float
    """Mean rotation rate of the rear wheels, positive forward [-400 .. 400 rad/s]."""
    accel_x: float
    """Specific force at the centre of gravity, positive forward [-50 .. 50 m/s2]."""
    accel_y: float
    """Specific force at the centre of gravity, positive left [-50 .. 50 m/s2]."""
    yaw_rate: float
    """Yaw rate, positive left (counter-clockwise from above) [-6 .. 6 rad/s]."""
    ins_vel_x: float
    """Longitudinal velocity of the reference point of an INS or an optical sensor
    (settings velocity_lever_...) [-120 .. 120 m/s]."""
    ins_vel_y: float
    """Lateral velocity of the reference point of an INS or an optical sensor, positive
    left [-60 .. 60 m/s]."""
    gnss_speed: float
    """Speed over ground [0 .. 120 m/s]."""
    gnss_course: float
    """Direction of the motion over ground, positive left (counter-clockwise from
    above), relative to any fixed direction [-7 .. 7 rad]."""
    brake: float
    """1: the car brakes, 0: it does not; a value counts as 1 from 0.5 on; if missing,
    accel_x decides whether the car brakes [0 .. 1]."""
    wheel_torque_front: float
    """Drive torque minus brake torque of both front wheels [-20000 .. 20000 Nm]."""
    wheel_torque_rear: float
    """Drive torque minus brake torque of both rear wheels [-20000 .. 20000 Nm]."""
    bank: float
    """Bank of the road, positive if the left side is higher. It includes the
    superelevation of a curve, and is used in place of the settings bank_angle and
    bank_superelevation [-0.35 .. 0.35 rad]."""
    grade: float
    """Grade of the road, positive uphill, used in place of the setting grade_angle
    [-0.35 .. 0.35 rad]."""


@dataclass(frozen=True, slots=True)
class Estimate(EstimateBase):
    """Estimates after a row. SI units. A stiffness is the sum over both tyres of an axle.
    `_sd` is the standard deviation of an estimate."""

    time: float
    """Time of the row: its `time` or, if rows have none, the sum of `dt` [s]."""
    vel_x: float
    """Longitudinal velocity of the centre of gravity [m/s]."""
    vel_x_sd: float
    """Standard deviation of vel_x [m/s]."""
    vel_y: float
    """Lateral velocity of the centre of gravity [m/s]."""
    vel_y_sd: float
    """Standard deviation of vel_y [m/s]."""
    yaw_rate: float
    """Yaw rate [rad/s]."""
    yaw_rate_sd: float
    """Standard deviation of yaw_rate [rad/s]."""
    sideslip: float
    """Sideslip angle atan2(vel_y, vel_x) at the centre of gravity; 0 at standstill
    [rad]."""
    sideslip_sd: float
    """Standard deviation of sideslip [rad]."""
    grip: float
    """Friction coefficient of the tyres: max lateral force of an axle / its load. If
    the setting tyre_saturation_balance is not 0, the axles have different
    coefficients, and grip is their harmonic mean; default filter only."""
    grip_sd: float
    """Standard deviation of grip."""
    grip_valid: bool
    """Whether grip may be used; if not, grip_reason is the reason."""
    grip_reason: Reason
    """'valid', or the reason why grip may not be used."""
    cx_front: float
    """Mean longitudinal stiffness of the front axle [N]."""
    cx_front_sd: float
    """Standard deviation of cx_front [N]."""
    cx_front_spread: float
    """Default filter: setting model_sd times the stiffness; paper's filter: sample-to-
    sample sd of the stiffness, sqrt(Sigma), where Sigma is the covariance of the
    process noise [N]."""
    cx_front_spread_seen: bool
    """Whether the spread is estimated; if not, it is the setting, or too small to
    observe."""
    cx_front_valid: bool
    """Whether cx_front may be used; if not, cx_front_reason is the reason."""
    cx_front_reason: Reason
    """'valid', or the reason why cx_front may not be used."""
    cy_front: float
    """Mean cornering stiffness of the front axle [N/rad]."""
    cy_front_sd: float
    """Standard deviation of cy_front [N/rad]."""
    cy_front_spread: float
    """Default filter: setting model_sd times the stiffness; paper's filter: sample-to-
    sample sd of the stiffness, sqrt(Sigma), where Sigma is the covariance of the
    process noise [N/rad]."""
    cy_front_spread_seen: bool
    """Whether the spread is estimated; if not, it is the setting, or too small to
    observe."""
    cy_front_valid: bool
    """Whether cy_front may be used; if not, cy_front_reason is the reason."""
    cy_front_reason: Reason
    """'valid', or the reason why cy_front may not be used."""
    cy_rear: float
    """Mean cornering stiffness of the rear axle [N/rad]."""
    cy_rear_sd: float
    """Standard deviation of cy_rear [N/rad]."""
    cy_rear_spread: float
    """Default filter: setting model_sd times the stiffness; paper's filter: sample-to-
    sample sd of the stiffness, sqrt(Sigma), where Sigma is the covariance of the
    process noise [N/rad]."""
    cy_rear_spread_seen: bool
    """Whether the spread is estimated; if not, it is the setting, or too small to
    observe."""
    cy_rear_valid: bool
    """Whether cy_rear may be used; if not, cy_rear_reason is the reason."""
    cy_rear_reason: Reason
    """'valid', or the reason why cy_rear may not be used."""
    bias_accel_x: float
    """Bias of accel_x: measured minus true value [m/s2]."""
    bias_accel_x_sd: float
    """Standard deviation of bias_accel_x [m/s2]."""
    bias_accel_y: float
    """Bias of accel_y: measured minus true value [m/s2]."""
    bias_accel_y_sd: float
    """Standard deviation of bias_accel_y [m/s2]."""
    bias_yaw_rate: float
    """Bias of yaw_rate: measured minus true value [rad/s]."""
    bias_yaw_rate_sd: float
    """Standard deviation of bias_yaw_rate [rad/s]."""
    noise_accel_x: float
    """Estimated noise sd of accel_x / its setting; default filter only."""
    noise_accel_y: float
    """Estimated noise sd of accel_y / its setting."""
    noise_yaw_rate: float
    """Estimated noise sd of yaw_rate / its setting."""
    noise_wheel_front: float
    """Estimated noise sd of wheel_speed_front / its setting."""
    noise_wheel_rear: float
    """Estimated noise sd of wheel_speed_rear / its setting."""
    p_steady: float
    """Probability that no channel is faulty, no wheel locks or spins, and within the
    last 2 s neither has a stiffness changed nor has the filter started over."""
    p_changed: float
    """Probability that the stiffness of all tyres has changed within the last 2 s: a
    different road surface."""
    p_axle: float
    """Probability that the stiffness of one axle has changed within the last 2 s."""
    p_fault: float
    """Probability that a channel has an offset, is frozen or noisy."""
    p_sliding: float
    """Probability that wheels lock or spin."""
    p_restarted: float
    """Probability that the filter started over within the last 2 s."""
    change_age: float
    """Time since the last change (change_kind); 0 before the first change [s]."""
    change_probability: float
    """Probability that since the last change (change_kind) no further change, sliding
    or sensor fault has begun; 0 before the first change."""
    change_kind: int
    """Kind of the last change: 0 none yet, 1 road (all tyres), 2 front axle, 3 rear
    axle, 4 the filter started over."""
    change_cx_front: float
    """Ratio of the longitudinal stiffness now to its value before the last change."""
    change_cy_front: float
    """Ratio of the front cornering stiffness now to its value before the last change."""
    change_cy_rear: float
    """Ratio of the rear cornering stiffness now to its value before the last change."""
    fault_channel: str | None
    """The channel that is most probably faulty; None if no channel is."""
    discrepancy_accel_x: float
    """Sd of the model discrepancy of accel_x, the part that the model does not
    explain: setting model_sd times the recent rms of accel_x [m/s2]."""
    discrepancy_accel_y: float
    """Sd of the model discrepancy of accel_y [m/s2]."""
    discrepancy_yaw_rate: float
    """Sd of the model discrepancy of yaw_rate [rad/s]."""
    innovation_accel_x: float
    """Innovation of accel_x: measured minus predicted value; 0 if accel_x was not
    used; default filter only [m/s2]."""
    innovation_accel_y: float
    """Innovation of accel_y [m/s2]."""
    innovation_yaw_rate: float
    """Innovation of yaw_rate [rad/s]."""
    innovation_wheel_front: float
    """Innovation of the circumferential speed (wheel speed times radius) of the front
    wheels [m/s]."""
    innovation_wheel_rear: float
    """Innovation of the circumferential speed (wheel speed times radius) of the rear
    wheels [m/s]."""
    nis_accel_x: float
    """Normalised innovation squared of accel_x. Model errors cause a slowly varying
    part of the innovation, which is estimated and subtracted first. The mean of nis
    over many rows is 1 if model and settings fit; 0 if accel_x was not used;
    default filter only."""
    nis_accel_y: float
    """Normalised innovation squared of accel_y."""
    nis_yaw_rate: float
    """Normalised innovation squared of yaw_rate."""
    nis_wheel_front: float
    """Normalised innovation squared of the front wheel speed."""
    nis_wheel_rear: float
    """Normalised innovation squared of the rear wheel speed."""
    lag_steer: float
    """Estimated time from the logged steering angle to its effect in the IMU, caused
    by bus, steering and tyres together; negative: the angle is logged late; default
    filter only [s]."""
    lag_steer_sd: float
    """Standard deviation of lag_steer [s]."""
    estimate_age: float
    """Age of the estimates: time of this row minus the time to which they refer; above
    0 if the filter waits for channels with a latency (settings ..._latency) [s]."""
    n_eff: float
    """Effective number of particles, 1/sum q^2 of their weights q; default filter: 1."""
    log_evidence: float
    """Log likelihood of the measurements of this row, given all earlier rows; 0 if no
    measurement was used [nat]."""
    status: Status
    """Use of the row; `status_text` describes it in words."""
    cx_front_secant: float
    """Secant longitudinal stiffness of the front axle: force / slip at the slip and
    load of this row [N]."""
    cy_front_secant: float
    """Secant cornering stiffness of the front axle: force / slip angle at the slip and
    load of this row [N/rad]."""
    cy_rear_secant: float
    """Secant cornering stiffness of the rear axle: force / slip angle at the slip and
    load of this row [N/rad]."""
    fault_factor: float
    """Factor by which the channel that contradicts the others (fault_channel) is too
    large, such as 57.3 for degrees in place of radians, or -1 for a wrong sign; 0:
    no channel contradicts the others, or its error is not a factor: front and rear
    wheel speeds are exchanged, or the channel is constant or late."""
