/* tests/unit/test_ekf.c <-> tests/bench/ekf.c: what the cost of a row is measured against does what it says.
 *
 * Reference values: tests/reference/ekf_table.h. */
#include "unit_support.h"
#include "../bench/ekf.c"
#include "../reference/ekf_table.h"

/* The midpoint rule is off by 0.2 (rate dt)^3 of what decays within a row: 0.3 mm/s, and with it a
 * thousandth of Cx, which lives on the slip. */
static void test_estimates_are_those_of_a_kalman_filter_in_another_form(void)
{
  tse_config c;
  ekf f;
  tse_config_default(&c);
#define X(name, value) c.name = setting(value);
  EKF_SETTINGS(X)
#undef X
  for (int k = 0; k < EKF_ROWS; k++) {
    tse_input row;
    double u[6];
    for (int a = 0; a < 6; a++) u[a] = ekf_rows[k][a] * ekf_unit[a];
    memset(&row, 0, sizeof row);
    row.dt = real(ekf_dt);
    row.steer_angle = real(u[0]);
    row.wheel_speed_front = real(u[1]);
    row.wheel_speed_rear = real(u[2]);
    row.accel_x = real(u[3]);
    row.accel_y = real(u[4]);
    row.yaw_rate = real(u[5]);
    if (k == 0) ekf_start(&f, &c, real(ekf_spread), &row);
    ekf_step(&f, &row, k == 0);
    if ((k + 1) % EKF_EVERY != 0) continue;
    for (int a = 0; a < 9; a++) {
      const double *const mean = ekf_expected[k / EKF_EVERY].mean, sd = ekf_expected[k / EKF_EVERY].sd[a];
      expect_near(mean[a] + (a / 3 == 1), number(f.x[a]), BY_FORMAT(0.08, 0.15) * sd + (a < 3 ? 3e-4 : 0), "mean", 100 * k + a);
      expect_near(sd, sqrt(number(f.p[a][a])), BY_FORMAT(5e-3, 2e-2) * sd, "sd", 100 * k + a);
    }
  }
}

static void test_the_drive_teaches_all_stiffnesses(void)
{
  for (int a = 3; a < 6; a++) TEST_ASSERT_TRUE(ekf_expected[EKF_ROWS / EKF_EVERY - 1].sd[a] < 0.1);
}

int main(void)
{
  UNITY_BEGIN();
  RUN_TEST(test_estimates_are_those_of_a_kalman_filter_in_another_form);
  RUN_TEST(test_the_drive_teaches_all_stiffnesses);
  return UNITY_END();
}
