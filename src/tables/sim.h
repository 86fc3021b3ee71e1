/* tables/sim.h - default and range of the simulator's settings, range of what its driver does. Part of host/simulate.c. */
#define SIM_REAL(name, def, lo, hi) { #name, (uint16_t)offsetof(tse_sim_config, name), TSE_S(def), TSE_S(lo), TSE_S(hi) }
#define SIM_WHOLE(name, def, lo, hi) { #name, (uint16_t)offsetof(tse_sim_config, name), def, lo, hi }
#define INPUT(name, lo, hi) { #name, (uint16_t)offsetof(tse_sim_input, name), 1, TSE_R(lo), TSE_R(hi) }

static const real_row sim_reals[] = {
  /* table: sim_reals */
  SIM_REAL(wheel_inertia_front, 2.4, 0.05, 500.0), SIM_REAL(wheel_inertia_rear, 2.4, 0.05, 500.0),
  SIM_REAL(true_cx_front, 1.0, 0.02, 10.0), SIM_REAL(true_cy_front, 1.0, 0.02, 10.0), SIM_REAL(true_cy_rear, 1.0, 0.02, 10.0),
  SIM_REAL(spread_cx_front, 0.05, 0.0, 0.3), SIM_REAL(spread_cy_front, 0.05, 0.0, 0.3), SIM_REAL(spread_cy_rear, 0.05, 0.0, 0.3),
  SIM_REAL(noise, 1.0, 0.0, 100.0), SIM_REAL(steer_angle_sd, 0.0, 0.0, 0.1), SIM_REAL(wheel_speed_sd, 0.0, 0.0, 10.0),
  SIM_REAL(true_bias_accel_x, 0.0, -5.0, 5.0), SIM_REAL(true_bias_accel_y, 0.0, -5.0, 5.0),
  SIM_REAL(true_bias_yaw_rate, 0.0, -0.5, 0.5), SIM_REAL(bias_walk, 0.0, 0.0, 100.0), SIM_REAL(speed, 20.0, 0.0, 70.0),
  SIM_REAL(vel_y, 0.0, -20.0, 20.0), SIM_REAL(friction, 0.0, 0.0, 2.0), SIM_REAL(substep, 0.001, 0.0001, 0.005),
  /* end of table */
};

static const whole_row sim_wholes[] = {
  /* table: sim_wholes */
  SIM_WHOLE(hold_inputs, 0, 0, 1), SIM_WHOLE(seed, 1, 0, 2147483647),
  /* end of table */
};

static const channel_row sim_inputs[] = {
  /* table: sim_input_rows */
  INPUT(steer_angle, -1.2, 1.2), INPUT(wheel_torque_front, -100000.0, 100000.0), INPUT(wheel_torque_rear, -100000.0, 100000.0),
  INPUT(brake_torque_front, 0.0, 100000.0), INPUT(brake_torque_rear, 0.0, 100000.0), INPUT(road_level, 0.02, 10.0),
  INPUT(road_friction, 0.0, 2.0),
  /* end of table */
};

enum { SIM_REALS = sizeof sim_reals / sizeof sim_reals[0],
       SIM_WHOLES = sizeof sim_wholes / sizeof sim_wholes[0],
       SIM_INPUTS = sizeof sim_inputs / sizeof sim_inputs[0] };
#undef SIM_REAL
#undef SIM_WHOLE
#undef INPUT
