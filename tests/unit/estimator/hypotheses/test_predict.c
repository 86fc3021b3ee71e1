/* tests/unit/estimator/hypotheses/test_predict.c <-> src/estimator/hypotheses/predict.c
 *
 * The mean against vehicle_advance(), the covariance against A P A' of X and eps, A by differences of vehicle_advance(). */
#include "estimator/hypotheses/predict.h"
#include "estimator/hypotheses/update.h"

#include "unit_support.h"
#include "hypotheses_support.h"

static const tse_real no_push[3] = { 0, 0, 0 };

static tse_params a_car(void)
{
  tse_config c;
  tse_config_default(&c);
  c.steady_walk = setting(0);
  c.accel_x_bias_walk = c.accel_y_bias_walk = c.yaw_rate_bias_walk = setting(0);
  return prepared(&c);
}

/* States after a row, by the integrator alone; z: X and eps. off: 1 + channel whose error eps is, in place of stiffness `at`. */
static void moved_to(const tse_params *p, const double z[JOINT], course before, course after, double dt, int off, int at, int held, double out[3])
{
  inputs from = before.now, to = after.now;
  from.steer = real(number(from.steer) + z[X_LAG] * number(before.late_steer - before.now.steer));
  to.steer = real(number(to.steer) + z[X_LAG] * number(after.late_steer - after.now.steer));
  if (held) to.steer = from.steer;
  tse_real x[3] = { real(z[0]), real(z[1]), real(z[2]) };
  double w[3];
  for (int a = 0; a < 3; a++) w[a] = z[3 + a] - 1 + (off && a == at ? 0 : z[TSE_X + a]);
  if (off) {
    tse_real *const in[2][3] = { { &from.steer, &from.v_front, &from.v_rear }, { &to.steer, &to.v_front, &to.v_rear } };
    for (int k = 0; k < 2; k++) *in[k][off - 1] = real(number(*in[k][off - 1]) + z[TSE_X + at]);
  }
  vehicle_advance(p, x, vehicle_stiffness(p, real(w[0]), real(w[1]), real(w[2])), from, to, real(dt));
  for (int a = 0; a < 3; a++) out[a] = number(x[a]);
}

static void expect_prediction(const tse_params *p, tse_hypothesis h, double P[JOINT][JOINT], course from, course to, double dt, int off, int at,
                              int held, double tolerance)
{
  static double A[JOINT][JOINT], AP[JOINT][JOINT];
  double z[JOINT], mean[3];
  for (int i = 0; i < TSE_X; i++) z[i] = number(h.x[i]);
  for (int a = 0; a < 3; a++) z[TSE_X + a] = number(h.eps[a]);
  memset(A, 0, sizeof A);
  for (int i = 3; i < TSE_X; i++) A[i][i] = 1;
  const double step = BY_FORMAT(1e-5, 1e-2);
  for (int k = 0; k < JOINT; k++) {
    double lo[JOINT], hi[JOINT], below[3], above[3];
    memcpy(lo, z, sizeof lo);
    memcpy(hi, z, sizeof hi);
    lo[k] -= step;
    hi[k] += step;
    moved_to(p, lo, from, to, dt, off, at, held, below);
    moved_to(p, hi, from, to, dt, off, at, held, above);
    for (int a = 0; a < 3; a++) A[a][k] = (above[a] - below[a]) / (2 * step);
  }
  moved_to(p, z, from, to, dt, off, at, held, mean);
  h.held = held;
  predict(p, &h, from, to, no_push, real(dt), NULL);
  for (int a = 0; a < 3; a++) expect_near(mean[a], number(h.x[a]), BY_FORMAT(1e-12, 1e-5) * (1 + fabs(mean[a])), "mean", a);
  for (int i = 0; i < TSE_X; i++)
    for (int j = 0; j < JOINT; j++) {
      AP[i][j] = 0;
      for (int k = 0; k < JOINT; k++) AP[i][j] += A[i][k] * P[k][j];
    }
  for (int i = 0; i < TSE_X; i++)
    for (int j = 0; j < TSE_X; j++) {
      if ((i >= X_SLOW && i < X_LAG) || (j >= X_SLOW && j < X_LAG)) continue; /* slow disturbances fade: elsewhere */
      double sum = i == j && i >= X_LAG ? dt * number(LAG_WALK) * number(LAG_WALK) : 0;
      for (int k = 0; k < JOINT; k++) sum += AP[i][k] * A[j][k];
      const double scale = sqrt(number(h.cov[i][i]) * number(h.cov[j][j]));
      expect_near(sum, number(h.cov[i][j]), tolerance * scale, "covariance", 100 * i + j);
      TEST_ASSERT_EQUAL_MEMORY(&h.cov[i][j], &h.cov[j][i], sizeof h.cov[i][j]);
    }
  for (int a = 0; a < 3; a++) { /* that row's eps is gone */
    expect_near(0, number(h.eps[a]), 0, "eps", a);
    for (int j = 0; j < TSE_X; j++) expect_near(0, number(h.eps_x[a][j]), 0, "eps_x", j);
    for (int j = 0; j < 3; j++) expect_near(0, number(h.eps_cov[a][j]), 0, "eps_cov", j);
  }
}

static void test_mean_and_covariance_are_those_of_the_integrator_and_its_differences(void)
{
  const tse_params p = a_car();
  uint32_t seed = 5;
  double P[JOINT][JOINT];
  for (int i = 0; i < 40; i++) {
    tse_hypothesis h = some_hypothesis(&p, &seed, 0, P);
    const double v = number(h.x[0]);
    const inputs before = inputs_of(next_between(&seed, -0.05, 0.05), v + next_between(&seed, -0.2, 0.2), v + next_between(&seed, -0.2, 0.2));
    const inputs after = inputs_of(next_between(&seed, -0.05, 0.05), v + next_between(&seed, -0.2, 0.2), v + next_between(&seed, -0.2, 0.2));
    const course from = course_of(before, next_between(&seed, -0.01, 0.01));
    const course to = course_of(after, next_between(&seed, -0.01, 0.01));
    expect_prediction(&p, h, P, from, to, 0.01, 0, 0, 0, 0.03); /* slopes are at the stiffness without eps: a few per cent */
    memset(h.eps, 0, sizeof h.eps);
    expect_prediction(&p, h, P, from, to, 0.01, 0, 0, 0, 0.01);
    expect_prediction(&p, h, P, from, to, 0.05, 0, 0, 0, 0.03); /* in steps */
  }
}

/* However long the row and slow the car: six steps, whose sizes are the same. */
static void test_a_row_takes_no_more_than_six_steps(void)
{
  const tse_params p = a_car();
  uint32_t seed = 15;
  double P[JOINT][JOINT];
  static const struct { double dt; int steps; } row[] = { { 0.11, 6 }, { 0.4, 6 } };
  for (int k = 0; k < ROWS(row); k++) {
    tse_hypothesis h = some_hypothesis(&p, &seed, 0, P);
    memset(h.eps, 0, sizeof h.eps);
    const inputs from = inputs_of(0.01, 20, 20), to = inputs_of(0.02, 20.1, 20.05);
    TEST_ASSERT_TRUE(vehicle_steps(&p, real(row[k].dt), from, to) > row[k].steps);
    tse_real x[3] = { h.x[0], h.x[1], h.x[2] };
    inputs at = from;
    for (int i = 1; i <= row[k].steps; i++) {
      const inputs next = vehicle_between(from, to, i, row[k].steps);
      const stiffness as_is = vehicle_stiffness(&p, h.x[3] - TSE_R(1), h.x[4] - TSE_R(1), h.x[5] - TSE_R(1));
      vehicle_step(&p, &x[0], &x[1], &x[2], as_is, at, next,
                   r_div(real(row[k].dt), r_from_int(row[k].steps)));
      at = next;
    }
    predict(&p, &h, steadily(from), steadily(to), no_push, real(row[k].dt), NULL);
    for (int a = 0; a < 3; a++)
      expect_near(number(x[a]), number(h.x[a]), BY_FORMAT(1e-13, 2e-6) * (1 + fabs(number(x[a]))), "state", a);
  }
}

static void test_held_steering_is_that_of_the_row_before_until_the_next(void)
{
  const tse_params p = a_car();
  uint32_t seed = 6;
  double P[JOINT][JOINT];
  tse_hypothesis h = some_hypothesis(&p, &seed, 0, P);
  memset(h.eps, 0, sizeof h.eps);
  expect_prediction(&p, h, P, course_of(inputs_of(0.02, 20, 20), 0.01), steadily(inputs_of(0.08, 20.1, 20)), 0.01, 0, 0, 1, 0.01);
  tse_hypothesis ramped = h, held = h;
  held.held = 1;
  predict(&p, &ramped, steadily(inputs_of(0.02, 20, 20)), steadily(inputs_of(0.08, 20, 20)), no_push, real(0.01), NULL);
  predict(&p, &held, steadily(inputs_of(0.02, 20, 20)), steadily(inputs_of(0.08, 20, 20)), no_push, real(0.01), NULL);
  TEST_ASSERT_TRUE(number(ramped.x[2]) > number(held.x[2]) + 0.005);
}

static void test_what_a_fault_leaves_unknown_is_in_the_input_and_not_in_the_stiffness(void)
{
  static const int stiffness_of[3] = { TSE_CY_FRONT, TSE_CX_FRONT, TSE_CX_FRONT };
  const tse_params p = a_car();
  uint32_t seed = 8;
  double P[JOINT][JOINT];
  for (int off = 1; off <= 3; off++) {
    tse_hypothesis h = some_hypothesis(&p, &seed, 0, P);
    h.fault = off;
    for (int a = 0; a < 3; a++) h.eps[a] = a == stiffness_of[off - 1] ? h.eps[a] : real(0);
    expect_prediction(&p, h, P, steadily(inputs_of(0.02, 20, 20)), steadily(inputs_of(0.03, 20.1, 20)), 0.01, off, stiffness_of[off - 1], 0, 0.01);
  }
}

static void test_noise_of_the_wheel_speeds_drives_the_motion_by_half_of_each_rows(void)
{
  tse_config c;
  tse_config_default(&c);
  c.wheel_noise_sd = setting(0.5);
  const tse_params noisy = prepared(&c), quiet = a_car();
  uint32_t seed = 9;
  double P[JOINT][JOINT];
  tse_hypothesis h = some_hypothesis(&noisy, &seed, 0, P), g;
  const inputs to = inputs_of(0.0, number(h.x[0]) + 0.1, number(h.x[0]) + 0.05);
  memset(h.cov, 0, sizeof h.cov);
  memset(h.eps_cov, 0, sizeof h.eps_cov);
  memset(h.eps_x, 0, sizeof h.eps_x);
  memset(h.eps, 0, sizeof h.eps);
  g = h;
  predict(&quiet, &g, steadily(to), steadily(to), no_push, real(0.01), NULL);
  predict(&noisy, &h, steadily(to), steadily(to), no_push, real(0.01), NULL);
  double at[6], up[3], down[3], sum = 0;
  for (int i = 0; i < 6; i++) at[i] = number(h.x[i]);
  for (int k = 1; k <= 2; k++) {
    double u[3] = { 0.0, number(to.v_front), number(to.v_rear) };
    u[k] += 1e-5;
    ref_forces(&noisy, at, u, up);
    u[k] -= 2e-5;
    ref_forces(&noisy, at, u, down);
    sum += 0.5 * pow(0.01 * (up[0] - down[0]) / 2e-5 * 0.5 * 0.33, 2);
  }
  expect_near(sum, number(h.cov[0][0]) - number(g.cov[0][0]), 0.01 * sum, "variance", 0);
  TEST_ASSERT_TRUE(sum > 1e-6);
}

/* ---------------------------------------------------------------------------------------- what goes on at rest */

static void test_a_disturbance_forgets_itself_whatever_the_steps(void)
{
  const tse_params p = a_car();
  uint32_t seed = 11;
  double P[JOINT][JOINT];
  tse_hypothesis h = some_hypothesis(&p, &seed, 1, P), fine = h;
  const int c = X_SLOW + 1;
  walk(&p, &h, real(0.2));
  for (int i = 0; i < 20; i++) walk(&p, &fine, real(0.01));
  const double keep = exp(-0.2 / number(DISTURBANCE_TIME)), level = pow(number(DISTURBANCE_SHARE), 2);
  expect_near(keep * 0.1, number(h.x[c]), BY_FORMAT(1e-12, 1e-6), "mean", 0);
  expect_near(level + keep * keep * (P[c][c] - level), number(h.cov[c][c]), BY_FORMAT(1e-12, 1e-6), "variance", 0);
  expect_near(keep * P[c][2], number(h.cov[c][2]), BY_FORMAT(1e-12, 1e-7), "covariance", 0);
  for (int j = 0; j < TSE_X; j++) expect_near(number(h.cov[c][j]), number(fine.cov[c][j]), BY_FORMAT(1e-11, 1e-6), "in small steps", j);
}

/* Of a model that is told not to be exact, there is a disturbance without any level, and beside one. */
static void test_what_the_model_leaves_out_is_a_disturbance_of_its_own(void)
{
  tse_config c;
  tse_config_default(&c);
  c.model_sd = setting(0.03);
  const tse_params p = prepared(&c);
  uint32_t seed = 13;
  double P[JOINT][JOINT];
  for (int level = 0; level < LEVELS; level++) {
    tse_hypothesis h = some_hypothesis(&p, &seed, 0, P);
    h.level[1] = level;
    h.activity[1] = real(2);
    h.cov[X_SLOW + 1][X_SLOW + 1] = real(0);
    for (int i = 0; i < 100; i++) walk(&p, &h, real(0.1));
    const double share = level ? number(DISTURBANCE_SHARE) * pow(3, level - 1) : 0;
    expect_near(4 * (share * share + 0.03 * 0.03), number(h.cov[X_SLOW + 1][X_SLOW + 1]), BY_FORMAT(1e-9, 1e-5), "variance", level);
  }
}

static void test_a_drift_moves_all_stiffnesses_by_its_rate_and_forgets_itself(void)
{
  const tse_params p = a_car();
  uint32_t seed = 12;
  double P[JOINT][JOINT];
  for (int fast = 0; fast < 2; fast++) {
    tse_hypothesis h = some_hypothesis(&p, &seed, 1, P);
    double was[3], A[TSE_X][TSE_X] = { { 0 } };
    const double T = number(fast ? FAST_TIME : SLOW_TIME), sd = number(fast ? FAST_RATE : SLOW_RATE), w = number(fast ? FAST_WALK : SLOW_WALK);
    const double dt = 0.5, keep = exp(-dt / T);
    h.drift = fast ? DRIFTS_FAST : DRIFTS_SLOWLY;
    h.x[X_RATE] = real(0.01);
    for (int i = 0; i < TSE_X; i++) A[i][i] = 1;
    for (int a = 0; a < 3; a++) {
      was[a] = number(h.x[3 + a]);
      A[3 + a][X_RATE] = dt * was[a];
    }
    A[X_RATE][X_RATE] = keep;
    walk(&p, &h, real(dt));
    for (int a = 0; a < 3; a++) expect_near(was[a] * (1 + 0.01 * dt), number(h.x[3 + a]), BY_FORMAT(1e-12, 1e-6), "stiffness", a);
    expect_near(0.01 * keep, number(h.x[X_RATE]), BY_FORMAT(1e-12, 1e-8), "rate", 0);
    static const int of[4] = { 3, 4, 5, X_RATE };
    for (int i = 0; i < 4; i++)
      for (int j = 0; j < 4; j++) {
        double sum = 0;
        for (int k = 0; k < TSE_X; k++)
          for (int l = 0; l < TSE_X; l++) sum += A[of[i]][k] * P[k][l] * A[of[j]][l];
        if (i == j) sum += i == 3 ? (1 - keep * keep) * sd * sd : w * w * dt * pow(number(h.x[of[i]]), 2);
        expect_near(sum, number(h.cov[of[i]][of[j]]), BY_FORMAT(1e-12, 2e-8), "covariance", 10 * i + j);
      }
  }
}

/* A pause of 100 s at -30 % in 10 s is no stiffness below zero. */
static void test_a_drift_through_a_pause_stays_within_the_bounds_of_a_stiffness(void)
{
  const tse_params p = a_car();
  uint32_t seed = 15;
  double P[JOINT][JOINT];
  for (int down = 0; down < 2; down++) {
    tse_hypothesis h = some_hypothesis(&p, &seed, 1, P);
    h.drift = DRIFTS_FAST;
    h.x[X_RATE] = real(down ? -0.3 : 0.3);
    for (int i = 0; i < 3; i++) walk(&p, &h, real(100));
    for (int a = 3; a < 6; a++) TEST_ASSERT_TRUE(number(h.x[a]) > 0.0999 && number(h.x[a]) < 5.001);
  }
}

static void test_walks_are_rates_times_time_and_end_at_what_was_unknown_at_the_start(void)
{
  tse_config c;
  tse_config_default(&c);
  const tse_params p = prepared(&c);
  tse_hypothesis h;
  memset(&h, 0, sizeof h);
  for (int a = 0; a < 3; a++) h.x[3 + a] = real(1.2);
  walk(&p, &h, real(4));
  for (int a = 0; a < 3; a++) {
    expect_near(pow(0.0005 * 1.2, 2) * 4, number(h.cov[3 + a][3 + a]), BY_FORMAT(1e-16, 1e-11) + 2 * QUANTUM, "stiffness", a);
    expect_near(4 * number(p.bias_walk[a]), number(h.cov[6 + a][6 + a]), BY_FORMAT(1e-15, 1e-8), "bias", a);
  }
  expect_near(4 * pow(number(LAG_WALK), 2), number(h.cov[X_LAG][X_LAG]), BY_FORMAT(1e-15, 1e-8), "lag", 0);
  for (int i = 0; i < 3000; i++) walk(&p, &h, real(3600));
  expect_near(pow(0.02 / number(LAG_TIME), 2), number(h.cov[X_LAG][X_LAG]), BY_FORMAT(1e-9, 1e-5), "lag", 1);
  for (int a = 0; a < 3; a++) {
    expect_near(0.09, number(h.cov[3 + a][3 + a]), BY_FORMAT(1e-9, 1e-6), "stiffness", a);
    TEST_ASSERT_TRUE(number(h.cov[6 + a][6 + a]) <= fmax(1, number(p.bias_var0[a])) * (1 + 1e-6));
  }
}

static void test_a_lag_that_is_told_stays(void)
{
  tse_config c;
  tse_config_default(&c);
  c.steer_lag_sd = setting(0);
  const tse_params p = prepared(&c);
  tse_hypothesis h;
  memset(&h, 0, sizeof h);
  walk(&p, &h, real(100));
  expect_near(0, number(h.cov[X_LAG][X_LAG]), 0, "lag", 0);
}

/* The instrument: the slip of the row before, smoothed with SLIP_TIME, less what of it may be noise; and none within that. */
static void test_slips_are_smoothed_and_shrunk_where_wheel_speeds_are_noisy(void)
{
  tse_config c;
  tse_config_default(&c);
  c.wheel_noise_sd = setting(0.1);
  const tse_params p = prepared(&c);
  uint32_t seed = 16;
  double P[JOINT][JOINT];
  tse_hypothesis h = some_hypothesis(&p, &seed, 1, P);
  const double v = number(h.x[0]), g = 0.01 / (0.01 + number(SLIP_TIME));
  const course from = steadily(inputs_of(0, v * 1.01, v));
  predict(&p, &h, from, steadily(inputs_of(0, v * 2, v * 2)), no_push, real(0.01), NULL);
  const double slip = g * 0.01 / 1.01, var = g / (2 - g) * number(p.wheel_var[0]);
  expect_near(slip, number(h.smooth[0]), BY_FORMAT(1e-12, 1e-7), "smoothed", 0);
  expect_near(0, number(h.smooth[1]), BY_FORMAT(1e-12, 1e-7), "smoothed", 1);
  expect_near(0, number(h.slip[1]), 0, "nothing but noise", 0);
  expect_near(slip - var / pow(v * 1.01, 2) / slip, number(h.slip[0]), BY_FORMAT(1e-10, 1e-6), "shrunk", 0);
}

/* By drawing: what noise of the wheel speeds puts into vel_x and into the smoothed slip, at constant speed. The recursion is of first
 * order in dt over the time in which vel_x follows, 0.08 s. */
static void test_noise_in_slip_and_speed_has_in_common_what_it_has_when_drawn(void)
{
  tse_config c;
  tse_config_default(&c);
  c.wheel_noise_sd = setting(0.02);
  const tse_params p = prepared(&c);
  uint32_t seed = 17;
  tse_hypothesis h;
  enum { DRAWS = 200000 };
  const double v = 17;
  double moved[2] = { 0, 0 }, sum[3] = { 0, 0, 0 }, mean[3] = { 0, 0, 0 };
  memset(&h, 0, sizeof h);
  h.x[0] = real(v);
  for (int a = 0; a < 3; a++) h.x[3 + a] = real(1);
  course from = steadily(inputs_of(0, v, v));
  for (int i = 0; i < DRAWS; i++) {
    double n[2];
    for (int k = 0; k < 2; k++)
      n[k] = 0.02 * number(k ? p.radius_rear : p.radius_front) * sqrt(-2 * log(next_uniform(&seed))) * cos(6.283185307179586 * next_uniform(&seed));
    const course to = steadily(inputs_of(0, v + n[0], v + n[1]));
    memset(h.cov, 0, sizeof h.cov);
    predict(&p, &h, from, to, no_push, real(0.01), NULL);
    from = to;
    const double off = number(h.x[0]) - v, follow = 0.01 * (number(p.kx_front) + number(p.kx_rear)) / v;
    moved[0] += follow * (number(h.smooth[0]) - moved[0]); /* by a unit of the front slip, over v */
    sum[0] += off * off / DRAWS;
    sum[1] += off * number(h.smooth[0]) / DRAWS;
    sum[2] += off * moved[0] / DRAWS;
    mean[0] += number(h.shaken) / DRAWS;
    mean[1] += number(h.with_slip[0]) / DRAWS;
    mean[2] += number(h.with_past[0]) / DRAWS;
  }
  static const char *const name[3] = { "vel_x", "vel_x with slip", "vel_x with past slip" };
  for (int k = 0; k < 3; k++) expect_near(sum[k], mean[k], 0.2 * fabs(sum[k]), name[k], k);
}

/* Standstill, walking pace, reverse, wheels that jump, nonsense of a state: numbers, variances that are none below zero. In float
 * a covariance overflows, or is beyond all speeds, in some of the rows; the bank drops such a hypothesis (is_proper). */
static void test_any_row_leaves_numbers(void)
{
  tse_config c;
  tse_config_default(&c);
  const tse_params p = prepared(&c);
  uint32_t seed = 13;
  int overflows = 0;
  double P[JOINT][JOINT];
  for (int i = 0; i < 2000; i++) {
    tse_hypothesis h = some_hypothesis(&p, &seed, i % 2, P);
    h.x[0] = real(next_between(&seed, -30, 60));
    h.x[1] = real(next_between(&seed, -20, 20));
    h.x[2] = real(next_between(&seed, -20, 20));
    h.drift = i % 3;
    h.fault = i % 7;
    const inputs from = inputs_of(next_between(&seed, -1.2, 1.2), next_between(&seed, -100, 100), next_between(&seed, -100, 100));
    const inputs to = inputs_of(next_between(&seed, -1.2, 1.2), next_between(&seed, -100, 100), next_between(&seed, -100, 100));
    predict(&p, &h, course_of(from, next_between(&seed, -1, 1)), steadily(to), no_push, real(next_between(&seed, 1e-6, 1)), NULL);
    if (!is_proper(&h)) {
      overflows++;
      continue;
    }
    for (int a = 0; a < TSE_X; a++) {
      TEST_ASSERT_TRUE(isfinite(number(h.x[a])) && number(h.cov[a][a]) >= 0);
      for (int b = 0; b < TSE_X; b++) TEST_ASSERT_TRUE(isfinite(number(h.cov[a][b])));
    }
    TEST_ASSERT_TRUE(fabs(number(h.x[0])) <= 200 && fabs(number(h.x[1])) <= 200 && fabs(number(h.x[2])) <= 20);
  }
  TEST_ASSERT_TRUE(overflows < 400); /* of 2000: 161 in float */
}

static void test_the_push_of_effects_moves_the_states_alone(void)
{
  const tse_params p = a_car();
  const tse_real push[3] = { real(0.25), real(-0.125), real(0.0625) };
  const inputs u = inputs_of(0.01, 20, 20);
  uint32_t seed = 14;
  double P[JOINT][JOINT];
  tse_hypothesis h = some_hypothesis(&p, &seed, 0, P), pushed = h;
  predict(&p, &h, steadily(u), steadily(u), no_push, real(0.01), NULL);
  predict(&p, &pushed, steadily(u), steadily(u), push, real(0.01), NULL);
  for (int a = 0; a < 3; a++) expect_near(number(push[a]), number(pushed.x[a]) - number(h.x[a]), BY_FORMAT(1e-14, 4e-6), "push", a);
  TEST_ASSERT_EQUAL_MEMORY(h.cov, pushed.cov, sizeof h.cov);
}

int main(void)
{
  UNITY_BEGIN();
  RUN_TEST(test_mean_and_covariance_are_those_of_the_integrator_and_its_differences);
  RUN_TEST(test_a_row_takes_no_more_than_six_steps);
  RUN_TEST(test_held_steering_is_that_of_the_row_before_until_the_next);
  RUN_TEST(test_what_a_fault_leaves_unknown_is_in_the_input_and_not_in_the_stiffness);
  RUN_TEST(test_noise_of_the_wheel_speeds_drives_the_motion_by_half_of_each_rows);
  RUN_TEST(test_a_disturbance_forgets_itself_whatever_the_steps);
  RUN_TEST(test_what_the_model_leaves_out_is_a_disturbance_of_its_own);
  RUN_TEST(test_a_drift_moves_all_stiffnesses_by_its_rate_and_forgets_itself);
  RUN_TEST(test_a_drift_through_a_pause_stays_within_the_bounds_of_a_stiffness);
  RUN_TEST(test_walks_are_rates_times_time_and_end_at_what_was_unknown_at_the_start);
  RUN_TEST(test_a_lag_that_is_told_stays);
  RUN_TEST(test_slips_are_smoothed_and_shrunk_where_wheel_speeds_are_noisy);
  RUN_TEST(test_noise_in_slip_and_speed_has_in_common_what_it_has_when_drawn);
  RUN_TEST(test_any_row_leaves_numbers);
  RUN_TEST(test_the_push_of_effects_moves_the_states_alone);
  return UNITY_END();
}
