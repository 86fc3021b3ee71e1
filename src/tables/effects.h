/* tables/effects.h - bits and parameters of the effects, i.e. of the properties of a car
 * that the single-track model leaves out (effects.toml). Internal to the sources. */
#ifndef TABLES_EFFECTS_H
#define TABLES_EFFECTS_H

#include "tse/real.h"

/* TSE_EFFECT_<id>: number of the bit of an effect in tse_effects.mask. Effects can be
 * left out of a build with the CMake option TSE_EFFECTS=OFF, which saves flash. Such a
 * build has only the effects of the hook CONSTANT (effects.toml), which change settings
 * once at the start, and tse_config_check() refuses settings that switch on another
 * effect. It has no simulator and no replay. */
enum {
  // clang-format off: table effect_places
  TSE_EFFECT_mass, TSE_EFFECT_yaw_inertia, TSE_EFFECT_cg_shift, TSE_EFFECT_wheel_radius,
  TSE_EFFECT_steering_ratio, TSE_EFFECT_steering_offset, TSE_EFFECT_steering_delay, TSE_EFFECT_steering_lag,
  TSE_EFFECT_exact_kinematics, TSE_EFFECT_steering_compliance, TSE_EFFECT_rear_roll_steer,
  TSE_EFFECT_relaxation, TSE_EFFECT_longitudinal_relaxation, TSE_EFFECT_stiffness_drift,
  TSE_EFFECT_combined_slip, TSE_EFFECT_tyre_saturation, TSE_EFFECT_longitudinal_load_transfer,
  TSE_EFFECT_lateral_load_transfer, TSE_EFFECT_aero_drag, TSE_EFFECT_rolling_resistance, TSE_EFFECT_grade,
  TSE_EFFECT_bank, TSE_EFFECT_crosswind, TSE_EFFECT_conicity, TSE_EFFECT_aligning_moment,
  TSE_EFFECT_imu_lever_arm, TSE_EFFECT_body_roll, TSE_EFFECT_pitch_leak, TSE_EFFECT_imu_misalignment,
  TSE_EFFECT_imu_scale_ax, TSE_EFFECT_imu_scale_ay, TSE_EFFECT_gyro_scale, TSE_EFFECT_imu_delay,
  // clang-format on: end of table
  TSE_EFFECTS,
};

#define TSE_BIT_FORMULA 62  /* number of the bit of the user's formula (formula.toml) in tse_effects.mask */
// clang-format off: table formula_limits
#define TSE_FORMULA_OPS 33       /* max number of operations of a formula */
#define FORMULA_STACK 8          /* max number of values on the stack while a formula is evaluated */
#define TSE_FORMULA_MEMORIES 3   /* max number of operations of kind MEMORY, whose result also depends on
                                  * earlier operands */
#define FORMULA_LATE 1           /* max number of delays (operation `late`) */
#define TSE_FORMULA_NUMBERS 8    /* number of settings formula_a, formula_b ... for the constants of a
                                  * formula */
// clang-format on: end of table

/* Effects and their parameters, as prepared by tse_prepare(). Bit TSE_EFFECT_<id> of mask
 * is 1 if the effect is on. It is on if at least one of its parameters that are strengths
 * is not 0. */
typedef struct tse_effects {
  uint64_t mask;
#if !defined(TSE_NO_EFFECTS)
  tse_real
  // clang-format off: table effect_members
  mass_change, yaw_inertia_change, cg_shift_distance, wheel_radius_change, steering_ratio_change,
  steering_offset_angle, steering_delay_time, steering_lag_time, steering_lag_second,
  exact_kinematics_share, steering_compliance_angle_per_moment, steering_compliance_trail,
  rear_roll_steer_gain, rear_roll_steer_roll, rear_roll_steer_frequency, rear_roll_steer_damping,
  relaxation_length, longitudinal_relaxation_length, stiffness_drift_change, stiffness_drift_time,
  stiffness_drift_start, combined_slip_factor, tyre_saturation_inverse_friction, tyre_saturation_shape,
  tyre_saturation_balance, longitudinal_load_transfer_gain, longitudinal_load_transfer_balance,
  lateral_load_transfer_gain, lateral_load_transfer_balance, aero_drag_coefficient,
  rolling_resistance_coefficient, grade_angle, bank_angle, bank_superelevation, crosswind_speed,
  crosswind_heading, crosswind_coefficient, crosswind_arm, conicity_front, conicity_rear,
  aligning_moment_trail, imu_lever_arm_x, imu_lever_arm_y, body_roll_gain, body_roll_frequency,
  body_roll_damping, body_roll_height, body_roll_coupling, pitch_leak_gain, pitch_leak_frequency,
  pitch_leak_damping, pitch_leak_height, imu_misalignment_angle, imu_scale_ax_error, imu_scale_ay_error,
  gyro_scale_error, imu_delay_time,
  // clang-format on: end of table
  mass; /* [kg] mass of the car */
  tse_real formula_gain, formula[TSE_FORMULA_NUMBERS];
  int32_t formula_place;
  uint8_t formula_code[TSE_FORMULA_OPS];
#endif
} tse_effects;

#endif
