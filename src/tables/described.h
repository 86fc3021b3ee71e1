/* tables/described.h - rows of tse_describe(): unit and text of every member, code and
 * effect, generated from the tables of this folder by scripts/dev/tables.py. Included by
 * host/describe.c only, so that the program of a controller that does not call
 * tse_describe() contains no texts. */
#include "tables/columns.h"
#include "tables/formula.h"
#include "tables/settings.h"

#define FIELD_REAL(fmu, name, def, exact, lo, hi, unit, text) \
  { #name, 's', (int32_t)offsetof(tse_config, name), def, lo, hi, unit, text },
#define FIELD_WHOLE(fmu, name, def, exact, lo, hi, unit, text) \
  { #name, 'i', (int32_t)offsetof(tse_config, name), def, lo, hi, "1", text },
static const tse_field config_fields[] = { SETTINGS(FIELD_REAL, FIELD_WHOLE) };

static const tse_setting_row setting_rows[] = {
  // clang-format off: table settings_described
  { "mass", "vehicle", "both", "" },
  { "yaw_inertia", "vehicle", "both", "" },
  { "lf", "vehicle", "both", "" },
  { "lr", "vehicle", "both", "" },
  { "wheel_radius_front", "vehicle", "both", "" },
  { "wheel_radius_rear", "vehicle", "both", "" },
  { "longitudinal_stiffness_front", "vehicle", "both", "" },
  { "longitudinal_stiffness_rear", "vehicle", "both", "" },
  { "cornering_stiffness_front", "vehicle", "both", "" },
  { "cornering_stiffness_rear", "vehicle", "both", "" },
  { "rear_longitudinal_follows_front", "vehicle", "paper", "" },
  { "mass_sd", "uncertainty", "both", "" },
  { "yaw_inertia_sd", "uncertainty", "default", "" },
  { "cg_sd", "uncertainty", "default", "" },
  { "steer_ratio_sd", "uncertainty", "default", "" },
  { "steer_offset_sd", "uncertainty", "default", "" },
  { "accel_y_scale_sd", "uncertainty", "default", "" },
  { "wheel_delay_sd", "uncertainty", "default", "" },
  { "accel_delay_sd", "uncertainty", "default", "" },
  { "relaxation_sd", "uncertainty", "default", "" },
  { "lean_sd", "uncertainty", "default", "" },
  { "gyro_scale_sd", "uncertainty", "default", "" },
  { "trail_sd", "uncertainty", "default", "" },
  { "roll_steer_sd", "uncertainty", "default", "" },
  { "wheel_radius_sd", "uncertainty", "default", "" },
  { "model_sd", "uncertainty", "default", "" },
  { "grade_sd", "uncertainty", "default", "" },
  { "accel_x_sd", "sensors", "both", "" },
  { "accel_y_sd", "sensors", "both", "" },
  { "yaw_rate_sd", "sensors", "both", "" },
  { "wheel_noise_sd", "sensors", "default", "" },
  { "steer_lag_sd", "sensors", "default", "" },
  { "accel_x_bias_sd", "sensors", "both", "" },
  { "accel_y_bias_sd", "sensors", "both", "" },
  { "yaw_rate_bias_sd", "sensors", "both", "" },
  { "accel_x_bias_walk", "sensors", "both", "" },
  { "accel_y_bias_walk", "sensors", "both", "" },
  { "yaw_rate_bias_walk", "sensors", "both", "" },
  { "steer_angle_latency", "latency", "both", "" },
  { "wheel_speed_front_latency", "latency", "both", "" },
  { "wheel_speed_rear_latency", "latency", "both", "" },
  { "accel_x_latency", "latency", "both", "" },
  { "accel_y_latency", "latency", "both", "" },
  { "ins_velocity_sd", "velocity", "default", "" },
  { "gnss_speed_sd", "velocity", "default", "" },
  { "gnss_course_sd", "velocity", "default", "" },
  { "velocity_latency", "velocity", "default", "" },
  { "velocity_latency_sd", "velocity", "default", "" },
  { "velocity_lever_x", "velocity", "default", "" },
  { "velocity_lever_y", "velocity", "default", "" },
  { "velocity_lever_sd", "velocity", "default", "" },
  { "velocity_heading", "velocity", "default", "" },
  { "velocity_heading_sd", "velocity", "default", "" },
  { "velocity_scale_sd", "velocity", "default", "" },
  { "wheel_torque_least", "pedals", "default", "" },
  { "road_sd", "road", "default", "" },
  { "mass_change", "effects", "both", "" },
  { "yaw_inertia_change", "effects", "both", "" },
  { "cg_shift_distance", "effects", "both", "" },
  { "wheel_radius_change", "effects", "both", "" },
  { "steering_ratio_change", "effects", "default", "" },
  { "steering_offset_angle", "effects", "default", "" },
  { "steering_delay_time", "effects", "default", "" },
  { "steering_lag_time", "effects", "default", "" },
  { "steering_lag_second", "effects", "default", "" },
  { "exact_kinematics_share", "effects", "none", "" },
  { "steering_compliance_angle_per_moment", "effects", "default", "" },
  { "steering_compliance_trail", "effects", "default", "" },
  { "rear_roll_steer_gain", "effects", "default", "" },
  { "rear_roll_steer_roll", "effects", "default", "body_roll_gain" },
  { "rear_roll_steer_frequency", "effects", "default", "body_roll_gain" },
  { "rear_roll_steer_damping", "effects", "default", "body_roll_gain" },
  { "relaxation_length", "effects", "default", "" },
  { "longitudinal_relaxation_length", "effects", "none", "" },
  { "stiffness_drift_change", "effects", "none", "" },
  { "stiffness_drift_time", "effects", "none", "" },
  { "stiffness_drift_start", "effects", "none", "" },
  { "combined_slip_factor", "effects", "none", "" },
  { "tyre_saturation_inverse_friction", "effects", "default", "grip" },
  { "tyre_saturation_shape", "effects", "default", "" },
  { "tyre_saturation_balance", "effects", "default", "" },
  { "longitudinal_load_transfer_gain", "effects", "default", "" },
  { "longitudinal_load_transfer_balance", "effects", "default", "" },
  { "lateral_load_transfer_gain", "effects", "default", "" },
  { "lateral_load_transfer_balance", "effects", "default", "" },
  { "aero_drag_coefficient", "effects", "default", "" },
  { "rolling_resistance_coefficient", "effects", "default", "" },
  { "grade_angle", "effects", "default", "" },
  { "bank_angle", "effects", "default", "" },
  { "bank_superelevation", "effects", "default", "" },
  { "crosswind_speed", "effects", "none", "" },
  { "crosswind_heading", "effects", "none", "" },
  { "crosswind_coefficient", "effects", "none", "" },
  { "crosswind_arm", "effects", "none", "" },
  { "conicity_front", "effects", "default", "" },
  { "conicity_rear", "effects", "default", "" },
  { "aligning_moment_trail", "effects", "default", "" },
  { "imu_lever_arm_x", "effects", "default", "" },
  { "imu_lever_arm_y", "effects", "default", "" },
  { "body_roll_gain", "effects", "default", "" },
  { "body_roll_frequency", "effects", "default", "" },
  { "body_roll_damping", "effects", "default", "" },
  { "body_roll_height", "effects", "default", "" },
  { "body_roll_coupling", "effects", "default", "" },
  { "pitch_leak_gain", "effects", "default", "" },
  { "pitch_leak_frequency", "effects", "default", "" },
  { "pitch_leak_damping", "effects", "default", "" },
  { "pitch_leak_height", "effects", "default", "" },
  { "imu_misalignment_angle", "effects", "default", "" },
  { "imu_scale_ax_error", "effects", "default", "" },
  { "imu_scale_ay_error", "effects", "default", "" },
  { "gyro_scale_error", "effects", "default", "" },
  { "imu_delay_time", "effects", "default", "" },
  { "formula_gain", "formula", "none", "" },
  { "formula_a", "formula", "none", "" },
  { "formula_b", "formula", "none", "" },
  { "formula_c", "formula", "none", "" },
  { "formula_d", "formula", "none", "" },
  { "formula_e", "formula", "none", "" },
  { "formula_f", "formula", "none", "" },
  { "formula_g", "formula", "none", "" },
  { "formula_h", "formula", "none", "" },
  { "formula_place", "formula", "none", "" },
  { "formula_code_1", "formula", "none", "" },
  { "formula_code_2", "formula", "none", "" },
  { "formula_code_3", "formula", "none", "" },
  { "formula_code_4", "formula", "none", "" },
  { "formula_code_5", "formula", "none", "" },
  { "formula_code_6", "formula", "none", "" },
  { "formula_code_7", "formula", "none", "" },
  { "formula_code_8", "formula", "none", "" },
  { "formula_code_9", "formula", "none", "" },
  { "formula_code_10", "formula", "none", "" },
  { "formula_code_11", "formula", "none", "" },
  { "sample_time", "filter", "both", "" },
  { "forgetting", "filter", "paper", "" },
  { "forgetting_mean", "filter", "paper", "" },
  { "forgetting_change", "filter", "paper", "" },
  { "resample_threshold", "filter", "paper", "" },
  { "initial_cx_front", "filter", "both", "" },
  { "initial_cy_front", "filter", "both", "" },
  { "initial_cy_rear", "filter", "both", "" },
  { "initial_mean_sd", "filter", "paper", "" },
  { "initial_cx_sd", "filter", "default", "" },
  { "initial_cy_front_sd", "filter", "default", "" },
  { "initial_cy_rear_sd", "filter", "default", "" },
  { "grip", "filter", "default", "" },
  { "grip_sd", "filter", "default", "" },
  { "initial_spread", "filter", "paper", "" },
  { "spread_max", "filter", "paper", "" },
  { "spread_kernel", "filter", "paper", "" },
  { "initial_dof", "filter", "paper", "" },
  { "learnt_floor", "filter", "both", "" },
  { "learnt_walk_day", "filter", "both", "" },
  { "initial_vel_x", "filter", "paper", "initial_vel_x_from_wheels" },
  { "initial_vel_x_sd", "filter", "paper", "" },
  { "initial_vel_y_sd", "filter", "paper", "" },
  { "initial_yaw_rate_sd", "filter", "paper", "" },
  { "stiffness_min", "filter", "both", "" },
  { "stiffness_max", "filter", "both", "" },
  { "hold_speed", "filter", "both", "" },
  { "max_steer", "filter", "both", "" },
  { "max_slip", "filter", "default", "" },
  { "noise_max", "filter", "default", "" },
  { "max_gap", "filter", "both", "" },
  { "valid_sd", "filter", "both", "" },
  { "steady_walk", "filter", "default", "" },
  { "form", "filter", "both", "" },
  { "cg_height", "filter", "default", "" },
  { "wheel_signals", "filter", "default", "" },
  { "driven_axle", "filter", "default", "" },
  { "particles", "filter", "paper", "" },
  { "resampling", "filter", "paper", "" },
  { "integration", "filter", "paper", "" },
  { "reflect_draws", "filter", "paper", "" },
  { "initial_vel_x_from_wheels", "filter", "paper", "" },
  { "seed", "filter", "paper", "" },
  // clang-format on: end of table
};

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
      "bits of the optional channels that are measured, in the order of the rows below" },
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
  FIELD(tse_output, #name "_valid", 'i', member, "", \
      "0: valid; otherwise the reason why it is not (tse_reason)")
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
      "time since the previous row, (0, 1]; not used in the first row" },
  { "steer_angle", 'p', (int32_t)offsetof(tse_replay_log, steer_angle), 0.0, 1.0, -1.0, "rad",
      "logged mean road-wheel angle of the front axle, positive left, -1.2 .. 1.2" },
  { "wheel_speed_front", 'p', (int32_t)offsetof(tse_replay_log, wheel_speed_front), 0.0, 1.0, -1.0, "rad/s",
      "mean rotation rate of the front wheels, -400 .. 400" },
  { "wheel_speed_rear", 'p', (int32_t)offsetof(tse_replay_log, wheel_speed_rear), 0.0, 1.0, -1.0, "rad/s",
      "mean rotation rate of the rear wheels, -400 .. 400" },
  { "grade", 'o', (int32_t)offsetof(tse_replay_log, grade), 0.0, 1.0, -1.0, "rad",
      "grade of the road, positive uphill, added to the setting grade_angle" },
  { "bank", 'o', (int32_t)offsetof(tse_replay_log, bank), 0.0, 1.0, -1.0, "rad",
      "bank of the road, positive if the left side is higher, added to the setting bank_angle" },
  { "slip_front", 'o', (int32_t)offsetof(tse_replay_log, slip_front), 0.0, 1.0, -1.0, "rad",
      "disturbance that is added to the front slip angle; positive: lateral tyre force to the left" },
  { "slip_rear", 'o', (int32_t)offsetof(tse_replay_log, slip_rear), 0.0, 1.0, -1.0, "rad",
      "disturbance that is added to the rear slip angle; positive: lateral tyre force to the left" },
  { "force_x", 'o', (int32_t)offsetof(tse_replay_log, force_x), 0.0, 1.0, -1.0, "m/s2",
      "disturbing force / mass, positive forward, for example of wind. As a tyre force does, it "
      "accelerates the car, and accel_x measures it" },
  { "force_y", 'o', (int32_t)offsetof(tse_replay_log, force_y), 0.0, 1.0, -1.0, "m/s2",
      "disturbing force / mass, positive left, for example of wind. As a tyre force does, it accelerates "
      "the car, and accel_y measures it" },
  { "yaw_accel", 'o', (int32_t)offsetof(tse_replay_log, yaw_accel), 0.0, 1.0, -1.0, "rad/s2",
      "disturbing yaw moment / yaw inertia, positive left" },
  // clang-format on: end of table
};

#define FIELD_ROW(name, def, unit, text) \
  { #name, 'r', (int32_t)offsetof(tse_replay_start, name), def, 1.0, -1.0, unit, text },
static const tse_field replay_start_fields[] = { REPLAY_START(FIELD_ROW) };

static const tse_field replay_out_fields[] = {
  // clang-format off: table replay_out_described
  { "accel_x", 'o', (int32_t)offsetof(tse_replay_out, accel_x), 0.0, 1.0, -1.0, "m/s2",
      "reading of accel_x, with bias and without noise" },
  { "accel_y", 'o', (int32_t)offsetof(tse_replay_out, accel_y), 0.0, 1.0, -1.0, "m/s2",
      "reading of accel_y, with bias and without noise" },
  { "yaw_rate", 'o', (int32_t)offsetof(tse_replay_out, yaw_rate), 0.0, 1.0, -1.0, "rad/s",
      "reading of yaw_rate, with bias and without noise" },
  { "vel_x", 'o', (int32_t)offsetof(tse_replay_out, vel_x), 0.0, 1.0, -1.0, "m/s",
      "longitudinal velocity of the centre of gravity" },
  { "vel_y", 'o', (int32_t)offsetof(tse_replay_out, vel_y), 0.0, 1.0, -1.0, "m/s",
      "lateral velocity of the centre of gravity" },
  { "true_yaw_rate", 'o', (int32_t)offsetof(tse_replay_out, true_yaw_rate), 0.0, 1.0, -1.0, "rad/s",
      "true yaw rate of the car" },
  { "wheel_torque_front", 'o', (int32_t)offsetof(tse_replay_out, wheel_torque_front), 0.0, 1.0, -1.0, "Nm",
      "drive torque minus brake torque of both front wheels: longitudinal tyre force times wheel radius, "
      "plus wheel_inertia_front times the angular acceleration of the logged wheel speed" },
  { "wheel_torque_rear", 'o', (int32_t)offsetof(tse_replay_out, wheel_torque_rear), 0.0, 1.0, -1.0, "Nm",
      "drive torque minus brake torque of both rear wheels: longitudinal tyre force times wheel radius, "
      "plus wheel_inertia_rear times the angular acceleration of the logged wheel speed" },
  // clang-format on: end of table
};
#endif

static const tse_field formula_places[] = {
  // clang-format off: table formula_places_described
  { "front_angle", 'c', 0, 0.0, 1.0, -1.0, "rad",
      "slip angle of the front axle; it acts like a steering angle" },
  { "rear_angle", 'c', 1, 0.0, 1.0, -1.0, "rad",
      "slip angle of the rear axle, positive for a force to the left" },
  { "force_x", 'c', 2, 0.0, 1.0, -1.0, "m/s2",
      "force / mass, positive forward. As a tyre force does, it accelerates the car, and accel_x measures"
      " it" },
  { "force_y", 'c', 3, 0.0, 1.0, -1.0, "m/s2",
      "force / mass, positive left. As a tyre force does, it accelerates the car, and accel_y measures it"
      },
  { "yaw_moment", 'c', 4, 0.0, 1.0, -1.0, "rad/s2", "yaw moment / yaw inertia, positive left" },
  { "stiffness_front", 'c', 5, 0.0, 1.0, -1.0, "1", "relative increase of the front cornering stiffness" },
  { "stiffness_rear", 'c', 6, 0.0, 1.0, -1.0, "1", "relative increase of the rear cornering stiffness" },
  { "accel_x", 'c', 7, 0.0, 1.0, -1.0, "m/s2", "reading of the accelerometer alone; the motion is unchanged"
      },
  { "accel_y", 'c', 8, 0.0, 1.0, -1.0, "m/s2", "reading of the accelerometer alone; the motion is unchanged"
      },
  { "yaw_rate", 'c', 9, 0.0, 1.0, -1.0, "rad/s", "reading of the gyro alone; the motion is unchanged" },
  // clang-format on: end of table
};

static const tse_field formula_limits[] = {
  // clang-format off: table formula_limits_described
  { "FORMULA_OPS", 'c', 33, 0.0, 1.0, -1.0, "", "max number of operations of a formula" },
  { "FORMULA_STACK", 'c', 8, 0.0, 1.0, -1.0, "",
      "max number of values on the stack while a formula is evaluated" },
  { "FORMULA_MEMORIES", 'c', 3, 0.0, 1.0, -1.0, "",
      "max number of operations of kind MEMORY, whose result also depends on earlier operands" },
  { "FORMULA_LATE", 'c', 1, 0.0, 1.0, -1.0, "", "max number of delays (operation `late`)" },
  // clang-format on: end of table
};

#define NUMBER_OP(name, code, takes, unit, text) { #name, 'n', code, takes, 1.0, -1.0, unit, text },
#define SIGNAL_OP(name, code, takes, unit, text) { #name, 's', code, takes, 1.0, -1.0, unit, text },
#define PLAIN_OP(name, code, takes, unit, text) { #name, 'p', code, takes, 1.0, -1.0, unit, text },
#define MEMORY_OP(name, code, takes, unit, text) { #name, 'm', code, takes, 1.0, -1.0, unit, text },
static const tse_field formula_ops[] = { FORMULA_OPERATIONS(NUMBER_OP, SIGNAL_OP, PLAIN_OP, MEMORY_OP) };

static const tse_effect_row effect_rows[] = {
  // clang-format off: table effects_described
  { "mass", "CONSTANT", "mass other than stated, yaw inertia as stated",
    "yaw dynamics", "yaw_rate, accel_y: steering above 1 Hz",
    "yaw_inertia",
    "both filters use it",
    TSE_EFFECT_mass, "both", "SOME_CARS",
    "", 0.0 },
  { "yaw_inertia", "CONSTANT", "yaw inertia other than stated",
    "yaw dynamics", "yaw_rate, accel_y: steering above 1 Hz",
    "mass, imu_lever_arm",
    "both filters use it",
    TSE_EFFECT_yaw_inertia, "both", "SOME_CARS",
    "", 0.0 },
  { "cg_shift", "CONSTANT", "centre of gravity further back than stated",
    "yaw moment", "accel_y compared with yaw_rate: understeer",
    "imu_lever_arm, aligning_moment",
    "both filters use it",
    TSE_EFFECT_cg_shift, "both", "SOME_CARS",
    "", 0.0 },
  { "wheel_radius", "CONSTANT", "rolling radius other than stated",
    "wheel speeds",
        "accel_x compared with the rate of the wheel speeds; accel_y compared with vel_x yaw_rate",
    "gyro_scale, imu_scale_ay, imu_scale_ax, aero_drag, rolling_resistance",
    "both filters use it",
    TSE_EFFECT_wheel_radius, "both", "SOME_CARS",
    "", 0.0 },
  { "steering_ratio", "INPUT", "steering ratio other than stated",
    "front axle", "yaw_rate, accel_y: gain of the steering at all speeds",
    "exact_kinematics, gyro_scale",
    "the default filter uses it, the paper's does not",
    TSE_EFFECT_steering_ratio, "default", "SOME_CARS",
    "", 0.0 },
  { "steering_offset", "INPUT", "steering angle offset",
    "front axle", "yaw_rate, accel_y: offset that changes with speed as the gain of the steering does",
    "conicity, bank, crosswind",
    "the default filter uses it, the paper's does not",
    TSE_EFFECT_steering_offset, "default", "SENSOR",
    "", 0.0 },
  { "steering_delay", "INPUT", "steering or bus delay",
    "front axle", "accel_y, yaw_rate: at high steering rates",
    "steering_lag, imu_delay, relaxation",
    "the default filter uses it, the paper's does not; as the prior mean of a delay that the filter "
        "estimates",
    TSE_EFFECT_steering_delay, "default", "SENSOR",
    "steering angle logged late, after the wheels have turned", 0.0 },
  { "steering_lag", "INPUT", "steering lag of first order",
    "front axle", "accel_y, yaw_rate: at high steering rates",
    "steering_delay, imu_delay, relaxation",
    "the default filter uses it, the paper's does not",
    TSE_EFFECT_steering_lag, "default", "SOME_CARS",
    "a low pass of the IMU, or a fast steering", 0.02 },
  { "exact_kinematics", "SLIP", "exact kinematics instead of small angles",
    "front axle", "accel_x, yaw_rate: at steering angles above 5 degrees",
    "steering_ratio",
    "no filter uses it, simulator and replay do; the default filter always has exact kinematics, the "
        "paper's filter small angles",
    TSE_EFFECT_exact_kinematics, "none", "IN_MODEL",
    "", 0.0 },
  { "steering_compliance", "SLIP", "steering compliance",
    "front axle", "none: the front cornering stiffness compensates",
    "cornering_stiffness_front",
    "the default filter uses it, the paper's does not; if the setting is 0, the estimated front "
        "cornering stiffness includes the compliance, otherwise the stiffness is that of the tyres alone",
    TSE_EFFECT_steering_compliance, "default", "ABSORBED",
    "", 0.0 },
  { "rear_roll_steer", "SLIP", "rear roll steer, with the lag of the roll",
    "rear axle", "yaw_rate: phase at 1-2 Hz",
    "cornering_stiffness_rear, aligning_moment",
    "the default filter uses it, the paper's does not; if the setting gain is 0, the estimated rear "
        "cornering stiffness includes the influence of roll steer in steady cornering; roll is ignored "
        "unless body_roll_gain is 0; frequency is ignored unless body_roll_gain is 0; damping is ignored "
        "unless body_roll_gain is 0",
    TSE_EFFECT_rear_roll_steer, "default", "SOME_CARS",
    "", 0.0 },
  { "relaxation", "LAG", "relaxation length of the lateral force",
    "front axle, rear axle", "accel_y, yaw_rate: steering above 1 Hz, in proportion to 1/speed",
    "steering_lag, steering_delay, imu_delay",
    "the default filter uses it, the paper's does not",
    TSE_EFFECT_relaxation, "default", "EVERY_CAR",
    "", 0.0 },
  { "longitudinal_relaxation", "LAG", "relaxation length of the longitudinal force, or driveline lag",
    "front axle, rear axle", "accel_x: steps of brake and throttle",
    "imu_delay",
    "no filter uses it, simulator and replay do",
    TSE_EFFECT_longitudinal_relaxation, "none", "EVERY_CAR",
    "", 0.0 },
  { "stiffness_drift", "STIFFNESS", "stiffness drifts with time",
    "front axle, rear axle", "accel_y, yaw_rate: start of a log compared with its end",
    "tyre_saturation",
    "no filter uses it, simulator and replay do; both filters follow a stiffness that drifts",
    TSE_EFFECT_stiffness_drift, "none", "SOME_CARS",
    "", 0.0 },
  { "combined_slip", "STIFFNESS", "lateral force falls with longitudinal slip",
    "front axle, rear axle", "accel_y, yaw_rate: |accel_x| > 2 m/s2 and |accel_y| > 2 m/s2",
    "longitudinal_load_transfer, tyre_saturation",
    "no filter uses it, simulator and replay do",
    TSE_EFFECT_combined_slip, "none", "EVERY_CAR",
    "", 0.0 },
  { "tyre_saturation", "GRIP", "lateral force saturates",
    "front axle, rear axle", "accel_y, yaw_rate: |accel_y| > 4 m/s2",
    "lateral_load_transfer, combined_slip, stiffness_drift",
    "the default filter uses it, the paper's does not; inverse_friction is ignored unless grip is 0",
    TSE_EFFECT_tyre_saturation, "default", "EVERY_CAR",
    "", 0.0 },
  { "longitudinal_load_transfer", "STIFFNESS", "longitudinal load transfer",
    "front axle, rear axle", "yaw_rate, accel_y: braking, accelerating in a turn",
    "combined_slip",
    "the default filter uses it, the paper's does not",
    TSE_EFFECT_longitudinal_load_transfer, "default", "EVERY_CAR",
    "", 0.0 },
  { "lateral_load_transfer", "STIFFNESS", "lateral load transfer",
    "front axle, rear axle", "accel_y, yaw_rate: |accel_y| > 4 m/s2",
    "tyre_saturation",
    "the default filter uses it, the paper's does not",
    TSE_EFFECT_lateral_load_transfer, "default", "EVERY_CAR",
    "", 0.0 },
  { "aero_drag", "BODY", "aerodynamic drag",
    "body", "longitudinal slip: in proportion to the square of the speed",
    "rolling_resistance, wheel_radius",
    "the default filter uses it, the paper's does not",
    TSE_EFFECT_aero_drag, "default", "ABSORBED",
    "", 0.0 },
  { "rolling_resistance", "BODY", "rolling resistance",
    "body", "longitudinal slip: constant offset",
    "aero_drag, wheel_radius, grade",
    "the default filter uses it, the paper's does not",
    TSE_EFFECT_rolling_resistance, "default", "ABSORBED",
    "", 0.0 },
  { "grade", "BODY", "road grade",
    "road", "accel_x: offset that changes along the road",
    "pitch_leak, accel_x bias, rolling_resistance, imu_misalignment",
    "the default filter uses it, the paper's does not; as a constant angle, or as the grade that is "
        "given in each row",
    TSE_EFFECT_grade, "default", "ROAD",
    "", 0.0 },
  { "bank", "BODY", "road bank",
    "road", "accel_y and yaw_rate: offset that changes along the road",
    "crosswind, conicity, steering_offset, imu_misalignment",
    "the default filter uses it, the paper's does not; as a constant angle and superelevation, or as "
        "the bank that is given in each row",
    TSE_EFFECT_bank, "default", "ROAD",
    "", 0.0 },
  { "crosswind", "BODY", "crosswind",
    "body", "accel_y, yaw_rate: offset that depends on heading and speed",
    "bank, steering_offset, conicity",
    "no filter uses it, simulator and replay do",
    TSE_EFFECT_crosswind, "none", "SOME_CARS",
    "", 0.0 },
  { "conicity", "BODY", "conicity, ply steer",
    "front axle, rear axle", "accel_y, yaw_rate: constant offset",
    "steering_offset, bank, crosswind",
    "the default filter uses it, the paper's does not",
    TSE_EFFECT_conicity, "default", "SOME_CARS",
    "", 0.0 },
  { "aligning_moment", "BODY", "aligning moment of the tyres",
    "yaw moment", "yaw_rate",
    "cg_shift, cornering_stiffness_rear, rear_roll_steer",
    "the default filter uses it, the paper's does not",
    TSE_EFFECT_aligning_moment, "default", "ABSORBED",
    "", 0.0 },
  { "imu_lever_arm", "SENSOR", "IMU away from the centre of gravity",
    "sensors", "accel_y: in proportion to yaw acceleration; accel_x: in proportion to the square of yaw_rate",
    "cg_shift, yaw_inertia, body_roll",
    "the default filter uses it, the paper's does not",
    TSE_EFFECT_imu_lever_arm, "default", "SENSOR",
    "", 0.0 },
  { "body_roll", "SENSOR", "gravity in accel_y by body roll",
    "sensor accel_y", "accel_y: in all cornering, and by its phase near 1.5 Hz",
    "imu_scale_ay, imu_misalignment, imu_lever_arm",
    "the default filter uses it, the paper's does not",
    TSE_EFFECT_body_roll, "default", "EVERY_CAR",
    "", 0.0 },
  { "pitch_leak", "SENSOR", "gravity in accel_x by pitch",
    "sensor accel_x", "accel_x: braking",
    "imu_scale_ax, grade",
    "the default filter uses it, the paper's does not",
    TSE_EFFECT_pitch_leak, "default", "EVERY_CAR",
    "", 0.0 },
  { "imu_misalignment", "SENSOR", "IMU turned about the vertical",
    "sensor accel_x, sensor accel_y", "accel_x in turns, accel_y in braking",
    "grade, bank, body_roll",
    "the default filter uses it, the paper's does not",
    TSE_EFFECT_imu_misalignment, "default", "SENSOR",
    "", 0.0 },
  { "imu_scale_ax", "SENSOR", "scale of accel_x",
    "sensor accel_x", "accel_x: braking",
    "pitch_leak, wheel_radius",
    "the default filter uses it, the paper's does not",
    TSE_EFFECT_imu_scale_ax, "default", "SENSOR",
    "", 0.0 },
  { "imu_scale_ay", "SENSOR", "scale of accel_y",
    "sensor accel_y", "accel_y compared with vel_x yaw_rate",
    "body_roll, wheel_radius, gyro_scale",
    "the default filter uses it, the paper's does not",
    TSE_EFFECT_imu_scale_ay, "default", "SENSOR",
    "", 0.0 },
  { "gyro_scale", "SENSOR", "scale of the gyro",
    "sensor yaw_rate", "yaw_rate compared with accel_y/vel_x",
    "wheel_radius, steering_ratio, imu_scale_ay",
    "the default filter uses it, the paper's does not",
    TSE_EFFECT_gyro_scale, "default", "SENSOR",
    "", 0.0 },
  { "imu_delay", "SENSOR", "delay of the IMU",
    "sensors", "accel_x compared with wheel speeds; accel_y, yaw_rate compared with steering",
    "steering_delay, steering_lag, longitudinal_relaxation, relaxation",
    "the default filter uses it, the paper's does not; as the prior mean of a delay that the filter "
        "estimates",
    TSE_EFFECT_imu_delay, "default", "SENSOR",
    "steering angle and wheel speeds logged later than the IMU", 0.0 },
  // clang-format on: end of table
};

#define PARAMETER_ROW( \
    REAL, effect, parameter, def, exact, lo, hi, unit, text, strength, sign, from, to, negligible) \
  { #effect, #parameter, #effect "_" #parameter, unit, text, \
      strength, sign, exact, lo, hi, from, to, negligible },
static const tse_effect_parameter effect_parameters[] = { EFFECT_PARAMETERS(PARAMETER_ROW, ) };
