/* tables/described.h - rows of tse_describe(): every member, code and effect with unit and
 * text, generated from the tables of this folder by scripts/dev/tables.py. Part of
 * host/describe.c, so that a controller that does not call it carries no texts. */
#include "tables/columns.h"
#include "tables/formula.h"
#include "tables/settings.h"

#define FIELD_REAL(fmu, name, def, exact, lo, hi, unit, text) \
  { #name, 's', (int32_t)offsetof(tse_config, name), def, lo, hi, unit, text },
#define FIELD_WHOLE(fmu, name, def, exact, lo, hi, unit, text) \
  { #name, 'i', (int32_t)offsetof(tse_config, name), def, lo, hi, "1", text },
static const tse_field config_fields[] = { SETTINGS(FIELD_REAL, FIELD_WHOLE) };
#undef FIELD_REAL
#undef FIELD_WHOLE

#define FIELD_ROW(name, drives, lo, hi, unit, text) \
  { #name, 'r', (int32_t)offsetof(tse_input, name), 0.0, lo, hi, unit, text },
static const tse_field input_fields[] = {
  { "dt", 'r', (int32_t)offsetof(tse_input, dt), 0.0, 0.0, 3600.0, "s", "time since the previous row" },
  CHANNELS(FIELD_ROW)
  { "missing", 'u', (int32_t)offsetof(tse_input, missing), 0.0, 1.0, -1.0, "",
      "bits of missing channels, in the order of the rows above" },
  { "given", 'u', (int32_t)offsetof(tse_input, given), 0.0, 1.0, -1.0, "",
      "bits of what is measured, in the order of the rows below" },
  VELOCITIES(FIELD_ROW) PEDALS(FIELD_ROW) ROADS(FIELD_ROW)
};

#undef FIELD_ROW
#define FIELD(of, name, kind, member, unit, text) \
  { name, kind, (int32_t)offsetof(of, member), 0.0, 1.0, -1.0, unit, text },
#define FIELD_NUMBER(name, member, unit, text) FIELD(tse_output, #name, 'r', member, unit, text)
#define FIELD_FLAG(name, member, text) FIELD(tse_output, #name, 'i', member, "", text)
#define FIELD_CODE(name, member, type, text) FIELD(tse_output, #name, 'i', member, "", text)
#define FIELD_STIFFNESS(name, member, si, unit, text) FIELD(tse_output, #name, 'r', member, "1", text)
#define FIELD_REASON(name, member, valid, what) \
  FIELD(tse_output, #name "_valid", 'i', member, "", "0 valid, else the reason (tse_reason)")
static const tse_field output_fields[] = {
  OUTPUTS(FIELD_NUMBER, FIELD_FLAG, FIELD_CODE, FIELD_STIFFNESS, FIELD_REASON)
};
#undef FIELD_NUMBER
#undef FIELD_STIFFNESS

#define CODED(name, word, text) { word, 'c', (int32_t)(name), 0.0, 1.0, -1.0, "", text },
static const tse_field status_fields[] = { STATUSES(CODED) };

static const tse_field reason_fields[] = { REASON_CODES(CODED) };

#if !defined(TSE_NO_EFFECTS)
#define FIELD_REAL(fmu, name, def, exact, lo, hi, unit, text) \
  { #name, 's', (int32_t)offsetof(tse_sim_config, name), def, lo, hi, unit, text },
#define FIELD_WHOLE(fmu, name, def, exact, lo, hi, unit, text) \
  { #name, 'i', (int32_t)offsetof(tse_sim_config, name), def, lo, hi, "1", text },
static const tse_field sim_config_fields[] = { SETTINGS_SIM(FIELD_REAL, FIELD_WHOLE) };

#define FIELD_ROW(name, def, lo, hi, unit, text) \
  { #name, 'r', (int32_t)offsetof(tse_sim_input, name), def, lo, hi, unit, text },
static const tse_field sim_input_fields[] = {
  { "dt", 'r', (int32_t)offsetof(tse_sim_input, dt), 0.01, 0.0, 1.0, "s", "time since the previous row" },
  DRIVER(FIELD_ROW)
};

#undef FIELD_ROW
#define FIELD_ROW(name, drives, lo, hi, unit, text) FIELD(tse_sim_output, #name, 'r', row.name, unit, text)
#define FIELD_NUMBER(group, name, member, unit, text) \
  FIELD(tse_sim_output, #group "_" #name, 'r', member, unit, text)
#define FIELD_STIFFNESS(group, name, member, si, unit, text) \
  FIELD(tse_sim_output, #group "_" #name, 'r', member, "1", text ", relative to nominal")
static const tse_field sim_output_fields[] = { CHANNELS(FIELD_ROW) TRUTHS(FIELD_NUMBER, FIELD_STIFFNESS) };
#undef FIELD_ROW

static const tse_field replay_log_fields[] = {
  // clang-format off: table replay_log_described
  { "dt", 'p', (int32_t)offsetof(tse_replay_log, dt), 0.0, 1.0, -1.0, "s",
      "time since the row before, (0, 1]; of the first row not used" },
  { "steer_angle", 'p', (int32_t)offsetof(tse_replay_log, steer_angle), 0.0, 1.0, -1.0, "rad",
      "mean road-wheel angle as logged, -1.2 .. 1.2" },
  { "wheel_speed_front", 'p', (int32_t)offsetof(tse_replay_log, wheel_speed_front), 0.0, 1.0, -1.0, "rad/s",
      "mean rotation rate of the front wheels, -400 .. 400" },
  { "wheel_speed_rear", 'p', (int32_t)offsetof(tse_replay_log, wheel_speed_rear), 0.0, 1.0, -1.0, "rad/s",
      "mean rotation rate of the rear wheels, -400 .. 400" },
  { "grade", 'o', (int32_t)offsetof(tse_replay_log, grade), 0.0, 1.0, -1.0, "rad",
      "profile of the road, uphill > 0, besides the setting grade_angle" },
  { "bank", 'o', (int32_t)offsetof(tse_replay_log, bank), 0.0, 1.0, -1.0, "rad",
      "profile of the road, left side high > 0, besides the setting bank_angle" },
  { "slip_front", 'o', (int32_t)offsetof(tse_replay_log, slip_front), 0.0, 1.0, -1.0, "rad",
      "disturbance of the front slip angle" },
  { "slip_rear", 'o', (int32_t)offsetof(tse_replay_log, slip_rear), 0.0, 1.0, -1.0, "rad",
      "disturbance of the rear slip angle" },
  { "force_x", 'o', (int32_t)offsetof(tse_replay_log, force_x), 0.0, 1.0, -1.0, "m/s2",
      "disturbing force over mass, forward, seen by the accelerometer" },
  { "force_y", 'o', (int32_t)offsetof(tse_replay_log, force_y), 0.0, 1.0, -1.0, "m/s2",
      "disturbing force over mass, to the left, seen by the accelerometer" },
  { "yaw_accel", 'o', (int32_t)offsetof(tse_replay_log, yaw_accel), 0.0, 1.0, -1.0, "rad/s2",
      "disturbing yaw moment over inertia" },
  // clang-format on: end of table
};

#define FIELD_ROW(name, def, unit, text) \
  { #name, 'r', (int32_t)offsetof(tse_replay_start, name), def, 1.0, -1.0, unit, text },
static const tse_field replay_start_fields[] = { REPLAY_START(FIELD_ROW) };

static const tse_field replay_out_fields[] = {
  // clang-format off: table replay_out_described
  { "accel_x", 'o', (int32_t)offsetof(tse_replay_out, accel_x), 0.0, 1.0, -1.0, "m/s2",
      "as the IMU reads it, bias included, no noise" },
  { "accel_y", 'o', (int32_t)offsetof(tse_replay_out, accel_y), 0.0, 1.0, -1.0, "m/s2",
      "as the IMU reads it, bias included, no noise" },
  { "yaw_rate", 'o', (int32_t)offsetof(tse_replay_out, yaw_rate), 0.0, 1.0, -1.0, "rad/s",
      "as the IMU reads it, bias included, no noise" },
  { "vel_x", 'o', (int32_t)offsetof(tse_replay_out, vel_x), 0.0, 1.0, -1.0, "m/s",
      "longitudinal velocity of the centre of gravity" },
  { "vel_y", 'o', (int32_t)offsetof(tse_replay_out, vel_y), 0.0, 1.0, -1.0, "m/s",
      "lateral velocity of the centre of gravity" },
  { "true_yaw_rate", 'o', (int32_t)offsetof(tse_replay_out, true_yaw_rate), 0.0, 1.0, -1.0, "rad/s",
      "yaw rate of the car" },
  { "wheel_torque_front", 'o', (int32_t)offsetof(tse_replay_out, wheel_torque_front), 0.0, 1.0, -1.0, "Nm",
      "drive less brake torque that the front wheels need: slip force times radius, and inertia" },
  { "wheel_torque_rear", 'o', (int32_t)offsetof(tse_replay_out, wheel_torque_rear), 0.0, 1.0, -1.0, "Nm",
      "drive less brake torque that the rear wheels need" },
  // clang-format on: end of table
};
#endif

static const tse_field formula_places[] = {
  // clang-format off: table formula_places_described
  { "front_angle", 'c', 0, 0.0, 1.0, -1.0, "rad",
      "slip angle of the front axle, as if the wheels were steered by it" },
  { "rear_angle", 'c', 1, 0.0, 1.0, -1.0, "rad", "slip angle of the rear axle, into the turn > 0" },
  { "force_x", 'c', 2, 0.0, 1.0, -1.0, "m/s2", "force over mass, forward, that the accelerometer feels" },
  { "force_y", 'c', 3, 0.0, 1.0, -1.0, "m/s2", "force over mass, to the left, that the accelerometer feels" },
  { "yaw_moment", 'c', 4, 0.0, 1.0, -1.0, "rad/s2", "yaw moment over yaw inertia" },
  { "stiffness_front", 'c', 5, 0.0, 1.0, -1.0, "1", "share that the front cornering stiffness gains" },
  { "stiffness_rear", 'c', 6, 0.0, 1.0, -1.0, "1", "share that the rear cornering stiffness gains" },
  { "accel_x", 'c', 7, 0.0, 1.0, -1.0, "m/s2", "reading of the accelerometer, the car does not feel it" },
  { "accel_y", 'c', 8, 0.0, 1.0, -1.0, "m/s2", "reading of the accelerometer, the car does not feel it" },
  { "yaw_rate", 'c', 9, 0.0, 1.0, -1.0, "rad/s", "reading of the gyro, the car does not feel it" },
  // clang-format on: end of table
};

#define NUMBER_OP(name, code, takes, unit, text) { #name, 'n', code, takes, 1.0, -1.0, unit, text },
#define SIGNAL_OP(name, code, takes, unit, text) { #name, 's', code, takes, 1.0, -1.0, unit, text },
#define PLAIN_OP(name, code, takes, unit, text) { #name, 'p', code, takes, 1.0, -1.0, unit, text },
#define MEMORY_OP(name, code, takes, unit, text) { #name, 'm', code, takes, 1.0, -1.0, unit, text },
static const tse_field formula_ops[] = { FORMULA_OPERATIONS(NUMBER_OP, SIGNAL_OP, PLAIN_OP, MEMORY_OP) };

static const tse_effect_row effect_rows[] = {
  // clang-format off: table effects_described
  { "mass", "CONSTANT", "mass other than stated, yaw inertia as stated", "yaw dynamics",
      "yaw_rate, accel_y: steering above 1 Hz", "yaw_inertia", "works", TSE_EFFECT_mass },
  { "yaw_inertia", "CONSTANT", "yaw inertia other than stated", "yaw dynamics",
      "yaw_rate, accel_y: steering above 1 Hz", "mass, imu_lever_arm", "works", TSE_EFFECT_yaw_inertia },
  { "cg_shift", "CONSTANT", "centre of gravity further back than stated", "yaw moment",
      "accel_y against yaw_rate: balance", "imu_lever_arm, aligning_moment", "works", TSE_EFFECT_cg_shift },
  { "wheel_radius", "CONSTANT", "rolling radius other than stated", "wheel speeds",
      "accel_x in proportion; accel_y against vel_x yaw_rate",
      "gyro_scale, imu_scale_ay, imu_scale_ax, aero_drag, rolling_resistance", "works",
      TSE_EFFECT_wheel_radius },
  { "steering_ratio", "INPUT", "steering ratio other than stated", "front axle",
      "yaw_rate, accel_y: gain at all speeds", "exact_kinematics, gyro_scale", "works",
      TSE_EFFECT_steering_ratio },
  { "steering_offset", "INPUT", "steering angle offset", "front axle",
      "yaw_rate, accel_y: offset with the gain of the speed", "conicity, bank, crosswind", "works",
      TSE_EFFECT_steering_offset },
  { "steering_delay", "INPUT", "steering or bus delay", "front axle",
      "accel_y, yaw_rate: high steering rate", "steering_lag, imu_delay, relaxation",
      "works: the prior of the delay that is estimated", TSE_EFFECT_steering_delay },
  { "steering_lag", "INPUT", "steering lag of first order", "front axle",
      "accel_y, yaw_rate: high steering rate", "steering_delay, imu_delay, relaxation", "works",
      TSE_EFFECT_steering_lag },
  { "exact_kinematics", "SLIP", "exact kinematics instead of small angles", "front axle",
      "accel_x, yaw_rate: steering above 5 degrees", "steering_ratio", "works", TSE_EFFECT_exact_kinematics
      },
  { "steering_compliance", "SLIP", "steering compliance", "front axle",
      "none: absorbed in the front cornering stiffness", "cornering_stiffness_front",
      "makes no sense: the estimated stiffness holds it; where it is known, it is taken out of it",
      TSE_EFFECT_steering_compliance },
  { "rear_roll_steer", "SLIP", "rear roll steer, with the lag of the roll", "rear axle",
      "yaw_rate: phase at 1-2 Hz", "cornering_stiffness_rear, aligning_moment",
      "works; the static part is absorbed in the rear cornering stiffness if unknown",
      TSE_EFFECT_rear_roll_steer },
  { "relaxation", "LAG", "relaxation length of the lateral force", "front axle, rear axle",
      "accel_y, yaw_rate: steering above 1 Hz, like 1/speed", "steering_lag, steering_delay, imu_delay",
      "works", TSE_EFFECT_relaxation },
  { "longitudinal_relaxation", "LAG", "relaxation length of the longitudinal force, or driveline lag",
      "front axle, rear axle", "accel_x: steps of brake and throttle", "imu_delay",
      "not in its model: simulator and replay apply it", TSE_EFFECT_longitudinal_relaxation },
  { "stiffness_drift", "STIFFNESS", "stiffness drifts with time", "front axle, rear axle",
      "accel_y, yaw_rate: early against late", "tyre_saturation", "makes no sense: the filter follows it",
      TSE_EFFECT_stiffness_drift },
  { "combined_slip", "STIFFNESS", "lateral force falls with longitudinal slip", "front axle, rear axle",
      "accel_y, yaw_rate: |accel_x| > 2 and |accel_y| > 2", "longitudinal_load_transfer, tyre_saturation",
      "not in its model: simulator and replay apply it", TSE_EFFECT_combined_slip },
  { "tyre_saturation", "GRIP", "lateral force saturates", "front axle, rear axle",
      "accel_y, yaw_rate: |accel_y| > 4", "lateral_load_transfer, combined_slip, stiffness_drift", "works",
      TSE_EFFECT_tyre_saturation },
  { "longitudinal_load_transfer", "STIFFNESS", "longitudinal load transfer", "front axle, rear axle",
      "yaw_rate, accel_y: braking, accelerating in a turn", "combined_slip", "works",
      TSE_EFFECT_longitudinal_load_transfer },
  { "lateral_load_transfer", "STIFFNESS", "lateral load transfer", "front axle, rear axle",
      "accel_y, yaw_rate: |accel_y| > 4", "tyre_saturation", "works", TSE_EFFECT_lateral_load_transfer },
  { "aero_drag", "BODY", "aerodynamic drag", "body", "slip: v^2", "rolling_resistance, wheel_radius",
      "works", TSE_EFFECT_aero_drag },
  { "rolling_resistance", "BODY", "rolling resistance", "body", "slip: constant",
      "aero_drag, wheel_radius, grade", "works", TSE_EFFECT_rolling_resistance },
  { "grade", "BODY", "road grade", "road", "accel_x: offset that wanders with the distance",
      "pitch_leak, accel_x bias, rolling_resistance, imu_misalignment",
      "works; constant angle, or as a row gives it", TSE_EFFECT_grade },
  { "bank", "BODY", "road bank", "road", "accel_y and yaw_rate: offset that wanders with the distance",
      "crosswind, conicity, steering_offset, imu_misalignment",
      "works; constant angle and superelevation, or as a row gives it", TSE_EFFECT_bank },
  { "crosswind", "BODY", "crosswind", "body", "accel_y, yaw_rate: offset with heading and speed",
      "bank, steering_offset, conicity", "not in its model: simulator and replay apply it",
      TSE_EFFECT_crosswind },
  { "conicity", "BODY", "conicity, ply steer", "front axle, rear axle",
      "accel_y, yaw_rate: constant offset", "steering_offset, bank, crosswind", "works", TSE_EFFECT_conicity
      },
  { "aligning_moment", "BODY", "aligning moment of the tyres", "yaw moment", "yaw_rate",
      "cg_shift, cornering_stiffness_rear, rear_roll_steer", "works", TSE_EFFECT_aligning_moment },
  { "imu_lever_arm", "SENSOR", "IMU away from the centre of gravity", "sensors",
      "accel_y: yaw acceleration; accel_x: yaw rate squared", "cg_shift, yaw_inertia, body_roll", "works",
      TSE_EFFECT_imu_lever_arm },
  { "body_roll", "SENSOR", "gravity in accel_y by body roll", "sensor accel_y",
      "accel_y: all cornering, phase near 1.5 Hz", "imu_scale_ay, imu_misalignment, imu_lever_arm", "works",
      TSE_EFFECT_body_roll },
  { "pitch_leak", "SENSOR", "gravity in accel_x by pitch", "sensor accel_x", "accel_x: braking",
      "imu_scale_ax, grade", "works", TSE_EFFECT_pitch_leak },
  { "imu_misalignment", "SENSOR", "IMU turned about the vertical", "sensor accel_x, sensor accel_y",
      "accel_x in turns, accel_y in braking", "grade, bank, body_roll", "works", TSE_EFFECT_imu_misalignment
      },
  { "imu_scale_ax", "SENSOR", "scale of accel_x", "sensor accel_x", "accel_x: braking",
      "pitch_leak, wheel_radius", "works", TSE_EFFECT_imu_scale_ax },
  { "imu_scale_ay", "SENSOR", "scale of accel_y", "sensor accel_y", "accel_y against vel_x yaw_rate",
      "body_roll, wheel_radius, gyro_scale", "works", TSE_EFFECT_imu_scale_ay },
  { "gyro_scale", "SENSOR", "scale of the gyro", "sensor yaw_rate", "yaw_rate against accel_y/vel_x",
      "wheel_radius, steering_ratio, imu_scale_ay", "works", TSE_EFFECT_gyro_scale },
  { "imu_delay", "SENSOR", "delay of the IMU", "sensors",
      "accel_x against wheel speeds; accel_y, yaw_rate against steering",
      "steering_delay, steering_lag, longitudinal_relaxation, relaxation",
      "works: the prior of the delay that is estimated", TSE_EFFECT_imu_delay },
  // clang-format on: end of table
};

#define PARAMETER_ROW( \
    REAL, effect, parameter, def, exact, lo, hi, unit, text, strength, sign, from, to, negligible) \
  { #effect, #parameter, #effect "_" #parameter, unit, text, \
      strength, sign, exact, lo, hi, from, to, negligible },
static const tse_effect_parameter effect_parameters[] = { EFFECT_PARAMETERS(PARAMETER_ROW, ) };
