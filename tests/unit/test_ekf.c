/* tests/unit/test_ekf.c <-> tests/bench/ekf.c: the reference filter of the benchmark
 * gives the estimates of a filter in dense matrices (single_track.h), on a drive with the
 * noise of the settings. */
#include "unit_support.h"
#include "../bench/ekf.c"
#include "single_track.h"

static void inputs_of_row(int k, double u[3]) /* steering angle, R omega */
{
  const double t = 0.01 * k, turn = 6.283185307179586,
               speed = 20 + 1.2 * sin(turn * 0.25 * t) + 0.2 * sin(turn * 0.9 * t);
  u[0] = single(0.025 * sin(turn * 0.3 * t) + 0.01 * sin(turn * 1.1 * t));
  u[1] = 0.33 * single(speed / 0.33);
  u[2] = 0.33 * single((speed - 0.02) / 0.33);
}

/* The midpoint rule has an error of 0.2 (rate dt)^3 of what decays within a row: 0.3
 * mm/s, and 1e-3 of Cx, which depends on the slip. */
static void test_estimates_are_those_of_a_kalman_filter_in_another_form(void)
{
  const double sd[9] = { 0.05, 0.1, 0.01, 0.2, 0.2, 0.2, 0.05, 0.05, 0.002 }, spread = 0.05,
               mean[3] = { -0.15, 0.12, -0.1 };
  dense_kalman d = { car_table[0], { 0 }, { { 0 } }, { 0.15, 0.15, 0.0035 }, { 0.002, 0.002, 0.0001 }, spread,
    0 };
  double truth[9] = { 0 };
  uint32_t seed = 27;
  tse_config c = config_by(tse_config_exact);
  ekf f; /* its car is used */
  c.accel_x_sd = c.accel_y_sd = setting(0.15), c.yaw_rate_sd = setting(0.0035);
  c.accel_x_bias_sd = c.accel_y_bias_sd = setting(0.05), c.yaw_rate_bias_sd = setting(0.002);
  c.accel_x_bias_walk = c.accel_y_bias_walk = setting(0.002), c.yaw_rate_bias_walk = setting(0.0001);
  c.initial_mean_sd = setting(0.2), c.initial_vel_x_sd = setting(sd[0]), c.initial_vel_y_sd = setting(sd[1]);
  c.initial_yaw_rate_sd = setting(sd[2]);
  for (int k = 0; k < 400; k++) {
    tse_input row = { 0 };
    double u[3], next[3], y[3];
    inputs_of_row(k, u);
    inputs_of_row(k + 1, next);
    if (k == 0) {
      d.mean[0] = 0.5 * (u[1] + u[2]);
      for (int a = 0; a < 9; a++)
        d.cov[a][a] = sd[a] * sd[a], truth[a] = d.mean[a] + (a / 3 != 1 ? sd[a] * next_normal(&seed) : 0);
    }
    for (int a = 0; a < 3; a++) truth[3 + a] = mean[a] + spread * next_normal(&seed);
    dense_observe(d.car, truth, u, y);
    for (int a = 0; a < 3; a++) y[a] = single(y[a] + d.sd[a] * next_normal(&seed));
    row.dt = real(0.01), row.steer_angle = real(u[0]), row.wheel_speed_front = real(u[1] / 0.33);
    row.wheel_speed_rear = real(u[2] / 0.33), row.accel_x = real(y[0]), row.accel_y = real(y[1]);
    row.yaw_rate = real(y[2]);
    if (k == 0) ekf_start(&f, &c, real(spread), &row);
    ekf_step(&f, &row, k == 0);
    (void)dense_update(&d, u, y, 7);
    for (int a = 0; a < 9 && (k + 1) % 50 == 0; a++) {
      const double expected = sqrt(d.cov[a][a]);
      expect_near(d.mean[a] + (a / 3 == 1), number(f.x[a]),
          BY_FORMAT(0.08, 0.15) * expected + (a < 3 ? 3e-4 : 0), "mean", 100 * k + a);
      expect_near(expected, sqrt(number(f.p[a][a])), BY_FORMAT(5e-3, 2e-2) * expected, "sd", 100 * k + a);
    }
    dense_predict(&d, u, next, 0.01);
    track_move(d.car, truth, truth + 3, u, next, 0.01, 20);
    for (int a = 0; a < 3; a++) truth[6 + a] += d.walk[a] * 0.1 * next_normal(&seed);
  }
  for (int a = 3; a < 6; a++)
    TEST_ASSERT_TRUE(sqrt(d.cov[a][a]) < 0.1); /* the drive excites all stiffnesses */
}
