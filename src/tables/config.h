/* tables/config.h - default and range of every setting, for tse_config_default() and tse_config_check(): tables, because a
 * comparison written out for each is 4 kB more of a microcontroller's flash. Part of estimator/prepare.c. */
#include "tables/settings.h"
#define CONFIG_REAL(fmu, name, def, exact, lo, hi, unit, text) { #name, (uint16_t)offsetof(tse_config, name), TSE_S(def), TSE_S(lo), TSE_S(hi) },
#define CONFIG_WHOLE(fmu, name, def, exact, lo, hi, unit, text) { #name, (uint16_t)offsetof(tse_config, name), def, lo, hi },

static const real_row reals[] = { SETTINGS(CONFIG_REAL, NO_ROW) }; /* in the order of the members */
static const whole_row wholes[] = { SETTINGS(NO_ROW, CONFIG_WHOLE) };

enum { REALS = sizeof reals / sizeof reals[0],
       WHOLES = sizeof wholes / sizeof wholes[0],
       // clang-format off: table config_groups
       FIRST_VEHICLE = 0, COUNT_VEHICLE = 11, FIRST_LATENCY = 38, COUNT_LATENCY = 5, FIRST_EFFECTS = 56,
       COUNT_EFFECTS = 57, FIRST_FORMULA = 113, COUNT_FORMULA = 9, FIRST_WHOLE_FORMULA = 0,
       COUNT_WHOLE_FORMULA = 12,
       // clang-format on: end of table
};

/* Of the settings from FIRST_EFFECTS on: the effect, and whether it is a strength. */
#define EFFECT_OF(REAL, effect, parameter, def, exact, lo, hi, unit, text, strength, ...) { TSE_EFFECT_##effect, (strength) > 0 },
static const struct {
  uint8_t effect, strength;
} effect_settings[COUNT_EFFECTS] = { EFFECT_PARAMETERS(EFFECT_OF, ) };

/* Constants that are settings as they are: `constant` of their rows, of tse_params. */
#define COPY(constant, setting) { (uint16_t)offsetof(tse_params, constant), (uint16_t)offsetof(tse_config, setting) }
static const struct {
  uint16_t to, from;
} copied[] = {
  // clang-format off: table copies
  COPY(car.lf, lf), COPY(car.lr, lr), COPY(radius_front, wheel_radius_front),
  COPY(radius_rear, wheel_radius_rear), COPY(follow, rear_longitudinal_follows_front),
  COPY(uncertain[CONSIDER_INERTIA], yaw_inertia_sd), COPY(uncertain[CONSIDER_CENTRE], cg_sd),
  COPY(prior_sd[GAIN], steer_ratio_sd), COPY(prior_sd[STEER_OFFSET], steer_offset_sd),
  COPY(uncertain[CONSIDER_SCALE], accel_y_scale_sd), COPY(uncertain[CONSIDER_WHEELS_LATE], wheel_delay_sd),
  COPY(uncertain[CONSIDER_ACCEL_LATE], accel_delay_sd),
  COPY(uncertain[CONSIDER_RELAXATION_FRONT], relaxation_sd),
  COPY(uncertain[CONSIDER_RELAXATION_REAR], relaxation_sd), COPY(prior_sd[LEAN], lean_sd),
  COPY(uncertain[CONSIDER_GYRO], gyro_scale_sd), COPY(uncertain[CONSIDER_TRAIL], trail_sd),
  COPY(uncertain[CONSIDER_ROLL_STEER], roll_steer_sd), COPY(prior_sd[RAD], wheel_radius_sd),
  COPY(model_sd, model_sd), COPY(sd[0], accel_x_sd), COPY(sd[1], accel_y_sd), COPY(sd[2], yaw_rate_sd),
  COPY(prior_sd[LATE], steer_lag_sd), COPY(prior_sd[BX], accel_x_bias_sd),
  COPY(prior_sd[BY], accel_y_bias_sd), COPY(prior_sd[BR], yaw_rate_bias_sd),
  COPY(bias_sd_walk[0], accel_x_bias_walk), COPY(bias_sd_walk[1], accel_y_bias_walk),
  COPY(bias_sd_walk[2], yaw_rate_bias_walk), COPY(no_torque, wheel_torque_least),
  COPY(prior[GAIN], steering_ratio_change), COPY(prior[STEER_OFFSET], steering_offset_angle),
  COPY(car.roll_steer, rear_roll_steer_gain), COPY(car.shape, tyre_saturation_shape),
  COPY(prior[LEAN], bank_superelevation), COPY(car.lever_x, imu_lever_arm_x),
  COPY(car.lever_y, imu_lever_arm_y), COPY(car.pitch_frequency, pitch_leak_frequency),
  COPY(car.pitch_damping, pitch_leak_damping), COPY(sample_time, sample_time),
  COPY(forgetting_change, forgetting_change), COPY(prior_sd[LCX], initial_cx_sd),
  COPY(prior_sd[LCF], initial_cy_front_sd), COPY(prior_sd[LCR], initial_cy_rear_sd),
  COPY(prior_sd[LMU], grip_sd), COPY(nu0, initial_dof), COPY(vel_x0, initial_vel_x),
  COPY(x_sd0[0], initial_vel_x_sd), COPY(x_sd0[1], initial_vel_y_sd), COPY(x_sd0[2], initial_yaw_rate_sd),
  COPY(hold_speed, hold_speed), COPY(max_steer, max_steer), COPY(max_slip, max_slip),
  COPY(max_gap, max_gap), COPY(steady_sd_walk, steady_walk),
  // clang-format on: end of table
#if !defined(TSE_NO_VELOCITY)
  // clang-format off: table velocity_copies
  COPY(velocity_sd[0], ins_velocity_sd), COPY(velocity_sd[1], ins_velocity_sd),
  COPY(velocity_sd[2], gnss_speed_sd), COPY(velocity_sd[3], gnss_course_sd),
  COPY(extra_sd[V_LATE - PSI], velocity_latency_sd), COPY(extra[V_LEVER_X - PSI], velocity_lever_x),
  COPY(extra[V_LEVER_Y - PSI], velocity_lever_y), COPY(extra_sd[V_LEVER_X - PSI], velocity_lever_sd),
  COPY(extra_sd[V_LEVER_Y - PSI], velocity_lever_sd), COPY(extra[V_TURN - PSI], velocity_heading),
  COPY(extra_sd[V_TURN - PSI], velocity_heading_sd), COPY(extra_sd[V_SCALE - PSI], velocity_scale_sd),
  // clang-format on: end of table
#endif
};

/* A car of its class, uncalibrated.toml. */
// clang-format off: table car_class
#define CLASS_CORNERING_FRONT 12.5 /* [1/rad] with the compliance of the steering */
#define CLASS_CORNERING_REAR 16.0 /* [1/rad] cornering stiffness over the load of the axle */
#define CLASS_LONGITUDINAL 22.0 /* [1] slip stiffness: the same tyres on both axles carry more where the
                                 * load is */
#define CLASS_MASS 1500.0 /* [kg] where nobody has said the mass */
#define CLASS_MASS_SD 0.3 /* [1] how far cars scatter about it, relative: too far for a stiffness to be
                           * valid */
// clang-format on: end of table

/* A car that is known exactly, where it is not that of the defaults. */
#define SET(name, value) { (uint16_t)offsetof(tse_config, name), TSE_S(value) }
static const struct {
  uint16_t at;
  tse_setting value;
} exact[] = {
  // clang-format off: table exact
  SET(mass, 1900.0), SET(yaw_inertia, 3000.0), SET(longitudinal_stiffness_front, 160000.0),
  SET(longitudinal_stiffness_rear, 160000.0), SET(cornering_stiffness_front, 120000.0),
  SET(cornering_stiffness_rear, 140000.0), SET(mass_sd, 0.0), SET(yaw_inertia_sd, 0.0), SET(cg_sd, 0.0),
  SET(steer_ratio_sd, 0.0), SET(steer_offset_sd, 0.0), SET(accel_y_scale_sd, 0.0), SET(wheel_delay_sd, 0.0),
  SET(accel_delay_sd, 0.0), SET(relaxation_sd, 0.0), SET(lean_sd, 0.0), SET(gyro_scale_sd, 0.0),
  SET(trail_sd, 0.0), SET(roll_steer_sd, 0.0), SET(wheel_radius_sd, 0.0), SET(model_sd, 0.0),
  SET(grade_sd, 0.0), SET(accel_x_sd, 0.15), SET(accel_y_sd, 0.15), SET(yaw_rate_sd, 0.0034906585039887),
  SET(wheel_noise_sd, 0.0), SET(steer_lag_sd, 0.02), SET(accel_x_bias_sd, 0.05), SET(accel_y_bias_sd, 0.05),
  SET(yaw_rate_bias_sd, 0.002), SET(steering_lag_time, 0.0), SET(relaxation_length, 0.0),
  SET(tyre_saturation_shape, 0.0), SET(longitudinal_load_transfer_gain, 0.0),
  SET(lateral_load_transfer_gain, 0.0), SET(aero_drag_coefficient, 0.0),
  SET(rolling_resistance_coefficient, 0.0), SET(bank_superelevation, 0.0), SET(aligning_moment_trail, 0.0),
  SET(body_roll_gain, 0.0), SET(body_roll_frequency, 1.5), SET(body_roll_coupling, 0.0),
  SET(initial_cy_front_sd, 0.3), SET(initial_cy_rear_sd, 0.3), SET(grip, 0.0), SET(grip_sd, 0.0),
  SET(cg_height, 0.0),
  // clang-format on: end of table
};
