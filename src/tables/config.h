/* tables/config.h - default and range of every setting, for tse_config_default() and tse_config_check(): tables, because a
 * comparison written out for each is 4 kB more of a microcontroller's flash. Part of estimator/prepare.c. */
#define REAL(name, def, lo, hi) { #name, (uint16_t)offsetof(tse_config, name), TSE_S(def), TSE_S(lo), TSE_S(hi) }
#define WHOLE(name, def, lo, hi) { #name, (uint16_t)offsetof(tse_config, name), def, lo, hi }

static const real_row reals[] = { /* in the order of the members */
  /* table: config_reals */
  REAL(mass, 1900.0, 50.0, 50000.0), REAL(yaw_inertia, 3000.0, 10.0, 1000000.0), REAL(lf, 1.25, 0.1, 10.0),
  REAL(lr, 1.5, 0.1, 10.0), REAL(wheel_radius_front, 0.33, 0.05, 2.0), REAL(wheel_radius_rear, 0.33, 0.05, 2.0),
  REAL(longitudinal_stiffness_front, 160000.0, 1000.0, 10000000.0),
  REAL(longitudinal_stiffness_rear, 160000.0, 1000.0, 10000000.0), REAL(cornering_stiffness_front, 120000.0, 1000.0, 10000000.0),
  REAL(cornering_stiffness_rear, 140000.0, 1000.0, 10000000.0), REAL(rear_longitudinal_follows_front, 1.0, 0.0, 1.0),
  REAL(mass_sd, 0.0, 0.0, 0.5), REAL(yaw_inertia_sd, 0.0, 0.0, 0.5), REAL(cg_sd, 0.0, 0.0, 1.0),
  REAL(steer_ratio_sd, 0.0, 0.0, 0.5), REAL(steer_offset_sd, 0.0, 0.0, 0.1), REAL(accel_y_scale_sd, 0.0, 0.0, 0.5),
  REAL(wheel_delay_sd, 0.0, 0.0, 0.2), REAL(accel_delay_sd, 0.0, 0.0, 0.2), REAL(relaxation_sd, 0.0, 0.0, 2.0),
  REAL(lean_sd, 0.0, 0.0, 0.5), REAL(gyro_scale_sd, 0.0, 0.0, 0.2), REAL(trail_sd, 0.0, 0.0, 0.2),
  REAL(roll_steer_sd, 0.0, 0.0, 0.5), REAL(wheel_radius_sd, 0.0, 0.0, 0.2), REAL(model_sd, 0.0, 0.0, 0.5),
  REAL(grade_sd, 0.0, 0.0, 0.3), REAL(accel_x_sd, 0.15, 0.001, 10.0), REAL(accel_y_sd, 0.15, 0.001, 10.0),
  REAL(yaw_rate_sd, 0.0034906585039887, 1e-05, 1.0), REAL(wheel_noise_sd, 0.0, 0.0, 5.0), REAL(steer_lag_sd, 0.02, 0.0, 0.2),
  REAL(accel_x_bias_sd, 0.05, 0.0, 5.0), REAL(accel_y_bias_sd, 0.05, 0.0, 5.0), REAL(yaw_rate_bias_sd, 0.002, 0.0, 0.5),
  REAL(accel_x_bias_walk, 0.002, 0.0, 1.0), REAL(accel_y_bias_walk, 0.002, 0.0, 1.0), REAL(yaw_rate_bias_walk, 0.0001, 0.0, 0.1),
  REAL(steer_angle_latency, 0.0, -0.2, 0.2), REAL(wheel_speed_front_latency, 0.0, -0.2, 0.2),
  REAL(wheel_speed_rear_latency, 0.0, -0.2, 0.2), REAL(accel_x_latency, 0.0, -0.2, 0.2), REAL(accel_y_latency, 0.0, -0.2, 0.2),
  REAL(ins_velocity_sd, 0.1, 0.001, 10.0), REAL(gnss_speed_sd, 0.1, 0.001, 10.0), REAL(gnss_course_sd, 0.01, 0.0001, 1.0),
  REAL(velocity_latency, 0.0, -0.2, 0.2), REAL(velocity_latency_sd, 0.03, 0.0, 0.2), REAL(velocity_lever_x, 0.0, -20.0, 20.0),
  REAL(velocity_lever_y, 0.0, -20.0, 20.0), REAL(velocity_lever_sd, 0.1, 0.0, 5.0), REAL(velocity_heading, 0.0, -0.5, 0.5),
  REAL(velocity_heading_sd, 0.02, 0.0, 0.5), REAL(velocity_scale_sd, 0.02, 0.0, 0.2), REAL(wheel_torque_least, 60.0, 1.0, 2000.0),
  REAL(mass_change, 0.0, -0.5, 1.0), REAL(yaw_inertia_change, 0.0, -0.5, 1.0), REAL(cg_shift_distance, 0.0, -0.6, 0.6),
  REAL(wheel_radius_change, 0.0, -0.1, 0.1), REAL(steering_ratio_change, 0.0, -0.3, 0.3),
  REAL(steering_offset_angle, 0.0, -0.05, 0.05), REAL(steering_delay_time, 0.0, 0.0, 0.2), REAL(steering_lag_time, 0.0, 0.0, 0.5),
  REAL(steering_lag_second, 0.0, 0.0, 1.0), REAL(exact_kinematics_share, 1.0, 0.0, 1.0),
  REAL(steering_compliance_angle_per_moment, 0.0, 0.0, 0.001), REAL(steering_compliance_trail, 0.03, 0.001, 0.2),
  REAL(rear_roll_steer_gain, 0.0, -0.5, 0.5), REAL(rear_roll_steer_roll, 0.0075, 0.0005, 0.03),
  REAL(rear_roll_steer_frequency, 1.5, 0.3, 6.0), REAL(rear_roll_steer_damping, 0.3, 0.05, 2.0),
  REAL(relaxation_length, 0.0, 0.0, 3.0), REAL(longitudinal_relaxation_length, 0.0, 0.0, 2.0),
  REAL(stiffness_drift_change, 0.0, -0.6, 1.0), REAL(stiffness_drift_time, 600.0, 0.001, 36000.0),
  REAL(stiffness_drift_start, 0.0, 0.0, 36000.0), REAL(combined_slip_factor, 0.0, 0.0, 2000.0),
  REAL(tyre_saturation_inverse_friction, 0.0, 0.0, 5.0), REAL(tyre_saturation_shape, 0.0, 0.0, 1.0),
  REAL(longitudinal_load_transfer_gain, 0.0, -0.08, 0.08), REAL(lateral_load_transfer_gain, 0.0, -0.003, 0.03),
  REAL(lateral_load_transfer_balance, 0.0, -1.0, 1.0), REAL(aero_drag_coefficient, 0.0, 0.0, 5.0),
  REAL(rolling_resistance_coefficient, 0.0, 0.0, 0.2), REAL(grade_angle, 0.0, -0.35, 0.35), REAL(bank_angle, 0.0, -0.35, 0.35),
  REAL(bank_superelevation, 0.0, -0.5, 0.5), REAL(crosswind_speed, 0.0, -30.0, 30.0), REAL(crosswind_heading, 0.0, -3.2, 3.2),
  REAL(crosswind_coefficient, 2.8, 0.1, 30.0), REAL(crosswind_arm, 0.45, -3.0, 3.0), REAL(conicity_front, 0.0, -2000.0, 2000.0),
  REAL(conicity_rear, 0.0, -2000.0, 2000.0), REAL(aligning_moment_trail, 0.0, -0.2, 0.2), REAL(imu_lever_arm_x, 0.0, -4.0, 4.0),
  REAL(imu_lever_arm_y, 0.0, -2.0, 2.0), REAL(body_roll_gain, 0.0, -0.02, 0.04), REAL(body_roll_frequency, 1.5, 0.3, 6.0),
  REAL(body_roll_damping, 0.3, 0.05, 2.0), REAL(body_roll_height, 0.0, -1.0, 1.5), REAL(body_roll_coupling, 0.0, -0.5, 1.0),
  REAL(pitch_leak_gain, 0.0, -0.01, 0.03), REAL(pitch_leak_frequency, 1.8, 0.3, 6.0), REAL(pitch_leak_damping, 0.4, 0.05, 2.0),
  REAL(pitch_leak_height, 0.0, -1.0, 1.5), REAL(imu_misalignment_angle, 0.0, -0.2, 0.2), REAL(imu_scale_ax_error, 0.0, -0.3, 0.3),
  REAL(imu_scale_ay_error, 0.0, -0.3, 0.3), REAL(gyro_scale_error, 0.0, -0.3, 0.3), REAL(imu_delay_time, 0.0, 0.0, 0.2),
  REAL(formula_gain, 0.0, -10.0, 10.0), REAL(formula_a, 0.0, -1000000.0, 1000000.0), REAL(formula_b, 0.0, -1000000.0, 1000000.0),
  REAL(formula_c, 0.0, -1000000.0, 1000000.0), REAL(formula_d, 0.0, -1000000.0, 1000000.0),
  REAL(formula_e, 0.0, -1000000.0, 1000000.0), REAL(formula_f, 0.0, -1000000.0, 1000000.0),
  REAL(formula_g, 0.0, -1000000.0, 1000000.0), REAL(formula_h, 0.0, -1000000.0, 1000000.0), REAL(sample_time, 0.01, 0.001, 0.1),
  REAL(forgetting, 0.99, 0.9, 0.9999), REAL(forgetting_mean, 0.0, 0.0, 0.9999), REAL(forgetting_change, 1.0, 0.5, 1.0),
  REAL(resample_threshold, 0.5, 0.0, 1.0), REAL(initial_cx_front, 1.0, 0.2, 4.0), REAL(initial_cy_front, 1.0, 0.2, 4.0),
  REAL(initial_cy_rear, 1.0, 0.2, 4.0), REAL(initial_mean_sd, 0.3, 0.0, 2.0), REAL(initial_cx_sd, 0.3, 0.0, 2.0),
  REAL(initial_cy_front_sd, 0.3, 0.0, 2.0), REAL(initial_cy_rear_sd, 0.3, 0.0, 2.0), REAL(grip, 0.0, 0.0, 50.0),
  REAL(grip_sd, 0.0, 0.0, 1.0), REAL(initial_spread, 0.07, 0.01, 2.0), REAL(spread_max, 2.0, 0.01, 2.0),
  REAL(spread_kernel, 0.0, 0.0, 0.5), REAL(initial_dof, 7.0, 6.0, 1000.0), REAL(learnt_floor, 0.1, 0.0, 2.0),
  REAL(learnt_walk_day, 0.02, 0.0, 1.0), REAL(initial_vel_x, 0.0, -70.0, 70.0), REAL(initial_vel_x_sd, 0.1, 0.0, 20.0),
  REAL(initial_vel_y_sd, 0.1, 0.0, 10.0), REAL(initial_yaw_rate_sd, 0.01, 0.0, 2.0), REAL(stiffness_min, 0.1, 0.02, 0.9),
  REAL(stiffness_max, 5.0, 1.1, 20.0), REAL(hold_speed, 3.0, 0.5, 20.0), REAL(max_steer, 0.7, 0.05, 1.2),
  REAL(max_slip, 0.05, 0.01, 1.0), REAL(noise_max, 30.0, 1.0, 1000.0), REAL(max_gap, 0.25, 0.01, 1.0),
  REAL(valid_sd, 0.1, 0.01, 1.0), REAL(steady_walk, 0.0005, 0.0, 0.1), REAL(cg_height, 0.0, 0.0, 3.0),
  /* end of table */
};

static const whole_row wholes[] = {
  /* table: config_wholes */
  WHOLE(formula_place, 0, 0, 9), WHOLE(formula_code_1, 0, 0, 16777215), WHOLE(formula_code_2, 0, 0, 16777215),
  WHOLE(formula_code_3, 0, 0, 16777215), WHOLE(formula_code_4, 0, 0, 16777215), WHOLE(formula_code_5, 0, 0, 16777215),
  WHOLE(formula_code_6, 0, 0, 16777215), WHOLE(formula_code_7, 0, 0, 16777215), WHOLE(formula_code_8, 0, 0, 16777215),
  WHOLE(formula_code_9, 0, 0, 16777215), WHOLE(formula_code_10, 0, 0, 16777215), WHOLE(formula_code_11, 0, 0, 16777215),
  WHOLE(form, TSE_DEFAULT_FORM < TSE_LAST_FORM ? TSE_DEFAULT_FORM : TSE_LAST_FORM, TSE_FIRST_FORM, TSE_LAST_FORM),
  WHOLE(wheel_signals, 2, 1, 2), WHOLE(driven_axle, 0, 0, 2),
  WHOLE(particles, 500 < TSE_MAX_PARTICLES ? 500 : TSE_MAX_PARTICLES, 16, TSE_MAX_PARTICLES), WHOLE(resampling, 0, 0, 3),
  WHOLE(integration, 0, 0, 2), WHOLE(reflect_draws, 0, 0, 1), WHOLE(initial_vel_x_from_wheels, 1, 0, 1),
  WHOLE(seed, 1, 0, 2147483647),
  /* end of table */
};

enum { REALS = sizeof reals / sizeof reals[0],
       WHOLES = sizeof wholes / sizeof wholes[0],
       /* table: config_groups */
       FIRST_VEHICLE = 0, COUNT_VEHICLE = 11, FIRST_LATENCY = 38, COUNT_LATENCY = 5, FIRST_EFFECTS = 55, COUNT_EFFECTS = 55,
       FIRST_FORMULA = 110, COUNT_FORMULA = 9, FIRST_WHOLE_FORMULA = 0, COUNT_WHOLE_FORMULA = 12,
       /* end of table */
};

/* Of the settings from FIRST_EFFECTS on: the effect, and whether it is a strength. */
static const struct {
  uint8_t effect, strength;
} effect_settings[COUNT_EFFECTS] = {
  /* table: effect_settings */
  { TSE_EFFECT_mass, 1 }, { TSE_EFFECT_yaw_inertia, 1 }, { TSE_EFFECT_cg_shift, 1 }, { TSE_EFFECT_wheel_radius, 1 },
  { TSE_EFFECT_steering_ratio, 1 }, { TSE_EFFECT_steering_offset, 1 }, { TSE_EFFECT_steering_delay, 1 },
  { TSE_EFFECT_steering_lag, 1 }, { TSE_EFFECT_steering_lag, 0 }, { TSE_EFFECT_exact_kinematics, 1 },
  { TSE_EFFECT_steering_compliance, 1 }, { TSE_EFFECT_steering_compliance, 0 }, { TSE_EFFECT_rear_roll_steer, 1 },
  { TSE_EFFECT_rear_roll_steer, 0 }, { TSE_EFFECT_rear_roll_steer, 0 }, { TSE_EFFECT_rear_roll_steer, 0 },
  { TSE_EFFECT_relaxation, 1 }, { TSE_EFFECT_longitudinal_relaxation, 1 }, { TSE_EFFECT_stiffness_drift, 1 },
  { TSE_EFFECT_stiffness_drift, 0 }, { TSE_EFFECT_stiffness_drift, 0 }, { TSE_EFFECT_combined_slip, 1 },
  { TSE_EFFECT_tyre_saturation, 1 }, { TSE_EFFECT_tyre_saturation, 0 }, { TSE_EFFECT_longitudinal_load_transfer, 1 },
  { TSE_EFFECT_lateral_load_transfer, 1 }, { TSE_EFFECT_lateral_load_transfer, 0 }, { TSE_EFFECT_aero_drag, 1 },
  { TSE_EFFECT_rolling_resistance, 1 }, { TSE_EFFECT_grade, 1 }, { TSE_EFFECT_bank, 1 }, { TSE_EFFECT_bank, 1 },
  { TSE_EFFECT_crosswind, 1 }, { TSE_EFFECT_crosswind, 0 }, { TSE_EFFECT_crosswind, 0 }, { TSE_EFFECT_crosswind, 0 },
  { TSE_EFFECT_conicity, 1 }, { TSE_EFFECT_conicity, 1 }, { TSE_EFFECT_aligning_moment, 1 }, { TSE_EFFECT_imu_lever_arm, 1 },
  { TSE_EFFECT_imu_lever_arm, 1 }, { TSE_EFFECT_body_roll, 1 }, { TSE_EFFECT_body_roll, 0 }, { TSE_EFFECT_body_roll, 0 },
  { TSE_EFFECT_body_roll, 0 }, { TSE_EFFECT_body_roll, 0 }, { TSE_EFFECT_pitch_leak, 1 }, { TSE_EFFECT_pitch_leak, 0 },
  { TSE_EFFECT_pitch_leak, 0 }, { TSE_EFFECT_pitch_leak, 0 }, { TSE_EFFECT_imu_misalignment, 1 }, { TSE_EFFECT_imu_scale_ax, 1 },
  { TSE_EFFECT_imu_scale_ay, 1 }, { TSE_EFFECT_gyro_scale, 1 }, { TSE_EFFECT_imu_delay, 1 },
  /* end of table */
};

/* An ordinary car of its class, uncalibrated.toml. */
/* table: car_class */
#define CLASS_CORNERING_FRONT 12.5 /* [1/rad] with the compliance of the steering */
#define CLASS_CORNERING_REAR 16.0 /* [1/rad] cornering stiffness over the load of the axle */
#define CLASS_LONGITUDINAL 22.0 /* [1] slip stiffness: the same tyres on both axles carry more where the load is */
/* end of table */
#define SET(name, value) { (uint16_t)offsetof(tse_config, name), TSE_S(value) }
static const struct {
  uint16_t at;
  tse_setting value;
} ordinary[] = {
  /* table: uncalibrated */
  SET(initial_cx_sd, 0.3), SET(initial_cy_front_sd, 0.25), SET(initial_cy_rear_sd, 0.25), SET(grip, 1.0), SET(grip_sd, 0.25),
  SET(tyre_saturation_shape, 0.7), SET(relaxation_length, 0.4), SET(relaxation_sd, 0.2), SET(steering_lag_time, 0.02),
  SET(steer_lag_sd, 0.025), SET(longitudinal_load_transfer_gain, 0.02), SET(lateral_load_transfer_gain, 0.002),
  SET(cg_height, 0.55), SET(aero_drag_coefficient, 0.4), SET(rolling_resistance_coefficient, 0.01), SET(body_roll_gain, 0.006),
  SET(body_roll_frequency, 1.6), SET(body_roll_coupling, 0.4), SET(aligning_moment_trail, 0.03), SET(bank_superelevation, 0.1),
  SET(lean_sd, 0.1), SET(mass_sd, 0.05), SET(yaw_inertia_sd, 0.1), SET(cg_sd, 0.03), SET(steer_ratio_sd, 0.03),
  SET(steer_offset_sd, 0.006), SET(accel_y_scale_sd, 0.03), SET(gyro_scale_sd, 0.01), SET(wheel_delay_sd, 0.02),
  SET(accel_delay_sd, 0.003), SET(trail_sd, 0.03), SET(roll_steer_sd, 0.04), SET(wheel_radius_sd, 0.005), SET(model_sd, 0.12),
  SET(grade_sd, 0.03), SET(accel_x_sd, 0.1), SET(accel_y_sd, 0.1), SET(yaw_rate_sd, 0.0025), SET(wheel_noise_sd, 0.04),
  SET(accel_x_bias_sd, 0.2), SET(accel_y_bias_sd, 0.2), SET(yaw_rate_bias_sd, 0.01),
  /* end of table */
};
#undef REAL
#undef WHOLE
#undef SET
