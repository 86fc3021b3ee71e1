/* tables/copies.h - list of the members of tse_params that are copies of a setting. The
 * tables of the settings give the member in their column `constant`. Included by
 * estimator/prepare.c only. */
#include <stddef.h>

#define COPY(constant, setting) \
  { (uint16_t)offsetof(tse_params, constant), (uint16_t)offsetof(tse_config, setting) }
static const struct {
  uint16_t to, from; /* offset in tse_params, offset in tse_config */
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
