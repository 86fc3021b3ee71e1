/* tse/effects.h - the effects of src/tables/effects.toml: their numbers, their constants, and what they remember from row to row.
 * Complete types, so that filter, simulator and replay can hold them; the members are the library's own business. */
#ifndef TSE_EFFECTS_H
#define TSE_EFFECTS_H

#include "tse/real.h"

/* Built without effects: a controller that wants the flash (CMake option TSE_EFFECTS). CONSTANT effects remain;
 * the others are refused by tse_config_check(). Then there is no simulator and no replay either. */
enum { /* TSE_EFFECT_<id>: bit of an effect in tse_effects.mask */
  /* table: effect_places */
  TSE_EFFECT_mass, TSE_EFFECT_yaw_inertia, TSE_EFFECT_cg_shift, TSE_EFFECT_wheel_radius, TSE_EFFECT_steering_ratio,
  TSE_EFFECT_steering_offset, TSE_EFFECT_steering_delay, TSE_EFFECT_steering_lag, TSE_EFFECT_exact_kinematics,
  TSE_EFFECT_steering_compliance, TSE_EFFECT_rear_roll_steer, TSE_EFFECT_relaxation, TSE_EFFECT_longitudinal_relaxation,
  TSE_EFFECT_stiffness_drift, TSE_EFFECT_combined_slip, TSE_EFFECT_tyre_saturation, TSE_EFFECT_longitudinal_load_transfer,
  TSE_EFFECT_lateral_load_transfer, TSE_EFFECT_aero_drag, TSE_EFFECT_rolling_resistance, TSE_EFFECT_grade, TSE_EFFECT_bank,
  TSE_EFFECT_crosswind, TSE_EFFECT_conicity, TSE_EFFECT_aligning_moment, TSE_EFFECT_imu_lever_arm, TSE_EFFECT_body_roll,
  TSE_EFFECT_pitch_leak, TSE_EFFECT_imu_misalignment, TSE_EFFECT_imu_scale_ax, TSE_EFFECT_imu_scale_ay, TSE_EFFECT_gyro_scale,
  TSE_EFFECT_imu_delay,
  /* end of table */
  TSE_EFFECTS
};

#define TSE_BIT_FORMULA 62  /* of the mask: a formula of the user, src/tables/formula.toml */
#define TSE_FORMULA_NUMBERS 8
#define TSE_FORMULA_OPS 33
#define TSE_FORMULA_MEMORIES 3

/* Constants, made by tse_prepare(). mask: bit TSE_EFFECT_<id> set when a strength of that effect is not zero. */
typedef struct tse_effects {
  uint64_t mask;
#if !defined(TSE_NO_EFFECTS)
  /* table: effect_members */
  tse_real mass_change; tse_real yaw_inertia_change; tse_real cg_shift_distance; tse_real wheel_radius_change;
  tse_real steering_ratio_change; tse_real steering_offset_angle; tse_real steering_delay_time; tse_real steering_lag_time;
  tse_real steering_lag_second; tse_real exact_kinematics_share; tse_real steering_compliance_angle_per_moment;
  tse_real steering_compliance_trail; tse_real rear_roll_steer_gain; tse_real rear_roll_steer_roll;
  tse_real rear_roll_steer_frequency; tse_real rear_roll_steer_damping; tse_real relaxation_length;
  tse_real longitudinal_relaxation_length; tse_real stiffness_drift_change; tse_real stiffness_drift_time;
  tse_real stiffness_drift_start; tse_real combined_slip_factor; tse_real tyre_saturation_inverse_friction;
  tse_real tyre_saturation_shape; tse_real longitudinal_load_transfer_gain; tse_real lateral_load_transfer_gain;
  tse_real lateral_load_transfer_balance; tse_real aero_drag_coefficient; tse_real rolling_resistance_coefficient;
  tse_real grade_angle; tse_real bank_angle; tse_real bank_superelevation; tse_real crosswind_speed; tse_real crosswind_heading;
  tse_real crosswind_coefficient; tse_real crosswind_arm; tse_real conicity_front; tse_real conicity_rear;
  tse_real aligning_moment_trail; tse_real imu_lever_arm_x; tse_real imu_lever_arm_y; tse_real body_roll_gain;
  tse_real body_roll_frequency; tse_real body_roll_damping; tse_real body_roll_height; tse_real body_roll_coupling;
  tse_real pitch_leak_gain; tse_real pitch_leak_frequency; tse_real pitch_leak_damping; tse_real pitch_leak_height;
  tse_real imu_misalignment_angle; tse_real imu_scale_ax_error; tse_real imu_scale_ay_error; tse_real gyro_scale_error;
  tse_real imu_delay_time;
  /* end of table */
  tse_real mass;                        /* [kg]                                                */
  tse_real formula_gain, formula[TSE_FORMULA_NUMBERS];
  int32_t formula_place;
  uint8_t formula_code[TSE_FORMULA_OPS];
#endif
} tse_effects;

#define TSE_DELAY_ROWS 12 /* samples kept; they thin out when the delay is longer than 9 rows */

typedef struct tse_delay { /* when samples were taken, newest first */
  int32_t count;
  tse_real age[TSE_DELAY_ROWS]; /* [s] */
} tse_delay;

typedef struct tse_effect_memory {
  int32_t settled;                      /* 0: the next row starts everything at rest                       */
#if !defined(TSE_NO_EFFECTS)
  tse_real lag[4];                      /* slip angle front, rear [rad], slip front, rear: what tyres hold */
  tse_real mode[3][2];                  /* body roll, pitch, roll steer: lagged acceleration and its rate  */
  tse_real time, heading;               /* [s], [turns] since the start                                    */
  int32_t steered;                      /* 0: the next angle is the first                                  */
  tse_real steered_by[3];               /* [rad] of the last row, before, between and after the lags       */
  tse_delay steer, imu;
  tse_real steer_was[1][TSE_DELAY_ROWS], imu_was[3][TSE_DELAY_ROWS];
  tse_real formula[TSE_FORMULA_MEMORIES][3], formula_accel[2]; /* of a formula: its own; accel_x, accel_y [m/s2] at this time */
  tse_delay formula_late;
  tse_real formula_was[1][TSE_DELAY_ROWS];
#endif
} tse_effect_memory;

#endif
