/* tests/unit/estimator/paper/test_bias.c <-> src/estimator/paper/bias.c: (18), standstill; and (17), forget() in update.c. The
 * update (19) together with the draw that it needs: test_update.c. */
#include "estimator/paper/particles.h"
#include "unit_support.h"

#define REL BY_FORMAT(1e-12, 2e-6) /* exp2 and log2 of the format, a few roundings */

static tse_filter_paper filter, before;

static tse_config settings(void)
{
  tse_config c;
  tse_config_paper(&c);
  c.particles = 21; /* padded to 24 */
  c.forgetting = setting(0.98);
  c.sample_time = setting(0.01);
  return c;
}

static tse_params params(void)
{
  const tse_config c = settings();
  return prepared(&c);
}

static sample gyro(double reading, int used)
{
  sample y;
  memset(&y, 0, sizeof y);
  y.y[0] = real(3);
  y.y[1] = real(-5);
  y.y[2] = real(used ? reading : 0);
  y.use[0] = y.use[1] = real(1);
  y.use[2] = real(used);
  y.used = 2 + used;
  y.has_inputs = 1;
  return y;
}

/* ------------------------------------------------------------------------------------------------ (17) */

static void test_one_sample_time_forgets_by_lambda(void)
{
  const tse_params p = params();
  memset(&filter, 0, sizeof filter);
  filter.gamma = real(0.05);
  filter.nu = real(40);
  forget(&p, &filter, p.sample_time);
  expect_near(0.05 / 0.98, number(filter.gamma), REL * 0.05, "gamma", 0);
  expect_near(40 * 0.98, number(filter.nu), REL * 40, "nu", 0);
}

static void test_other_time_steps_forget_by_a_power_of_lambda(void)
{
  const tse_params p = params();
  const double dt[] = { 0.001, 0.005, 0.013, 0.02, 0.1 };
  for (int i = 0; i < ROWS(dt); i++) {
    const double lambda = pow(0.98, dt[i] / 0.01);
    memset(&filter, 0, sizeof filter);
    filter.gamma = real(0.05);
    filter.nu = real(40);
    forget(&p, &filter, real(dt[i]));
    expect_near(0.05 / lambda, number(filter.gamma), REL * 0.1, "gamma", i);
    expect_near(40 * lambda, number(filter.nu), REL * 40, "nu", i);
  }
}

static void test_two_short_steps_forget_as_much_as_a_long_one(void)
{
  const tse_params p = params();
  memset(&filter, 0, sizeof filter);
  filter.gamma = real(0.2);
  filter.nu = real(60);
  before = filter;
  forget(&p, &filter, real(0.03));
  forget(&p, &before, real(0.01));
  forget(&p, &before, real(0.02));
  expect_near(number(before.gamma), number(filter.gamma), REL, "gamma", 0);
  expect_near(number(before.nu), number(filter.nu), REL * 60, "nu", 0);
}

/* Lambda *= lambda and nu *= lambda: their quotient, which the particles carry, stays. So does everything else. */
static void test_forgetting_changes_only_gamma_and_nu(void)
{
  const tse_params p = params();
  memset(&filter, 0x3c, sizeof filter);
  filter.gamma = real(0.05);
  filter.nu = real(40);
  before = filter;
  forget(&p, &filter, p.sample_time);
  TEST_ASSERT_TRUE(filter.gamma != before.gamma && filter.nu != before.nu);
  filter.gamma = before.gamma;
  filter.nu = before.nu;
  TEST_ASSERT_EQUAL_MEMORY(&before, &filter, sizeof filter);
}

/* nu > 4 keeps A and Sigma alive: repeated long steps stop at 6. */
static void test_degrees_of_freedom_never_fall_below_six(void)
{
  const tse_params p = params();
  memset(&filter, 0, sizeof filter);
  filter.gamma = real(1e-6);
  filter.nu = real(40);
  for (int i = 0; i < 60; i++) forget(&p, &filter, real(0.1));
  expect_near(6, number(filter.nu), 0, "nu", 0);
}

/* However long it takes: the mean is as unknown as one sample leaves it, or as at the start, and nu is at its least. */
static void test_what_is_forgotten_is_not_forgotten_further(void)
{
  static const double dt[] = { 60, 600, 3600 };
  static const double lambda[] = { 0.9, 0.98, 0.9999 };
  for (int i = 0; i < ROWS(dt); i++)
    for (int k = 0; k < ROWS(lambda); k++) {
      tse_config c = settings();
      c.forgetting = setting(lambda[k]);
      const tse_params p = prepared(&c);
      memset(&filter, 0, sizeof filter);
      filter.gamma = real(0.05);
      filter.nu = real(40);
      forget(&p, &filter, real(dt[i]));
      expect_near(fmin(0.05 * exp2(-dt[i] / 0.01 * log2(lambda[k])), fmax(1, number(p.gamma0))), number(filter.gamma), 1e-3, "gamma", i);
      TEST_ASSERT_TRUE(number(filter.nu) >= 6 && number(filter.nu) <= 40);
      filter.gamma = TSE_R(0);
      forget(&p, &filter, real(dt[i]));
      expect_near(0, number(filter.gamma), 0, "a mean that is known", i);
    }
}

/* (16) adds a sample, (17) forgets: nu tends to lambda/(1 - lambda), gamma to (1 - lambda)/lambda. */
static void test_learning_and_forgetting_settle_at_the_memory_of_lambda(void)
{
  const tse_params p = params();
  memset(&filter, 0, sizeof filter);
  filter.gamma = real(1);
  filter.nu = real(10);
  for (int i = 0; i < 3000; i++) {
    filter.gamma = real(number(filter.gamma) / (1 + number(filter.gamma)));
    filter.nu = real(number(filter.nu) + 1);
    forget(&p, &filter, p.sample_time);
  }
  expect_near(0.98 / 0.02, number(filter.nu), BY_FORMAT(1e-9, 2e-3), "nu", 0); /* errors add over 1/(1 - lambda) samples */
  expect_near(0.02 / 0.98, number(filter.gamma), BY_FORMAT(1e-12, 1e-6), "gamma", 0);
}

/* ------------------------------------------------------------------------------------------------ (18) */

static void test_bias_variance_grows_with_time_by_the_squared_walk(void)
{
  tse_config c = settings();
  c.accel_x_sd = setting(0.1);
  c.accel_y_sd = setting(0.2);
  c.yaw_rate_sd = setting(0.004);
  c.accel_x_bias_walk = setting(0.01);
  c.accel_y_bias_walk = setting(0.03);
  c.yaw_rate_bias_walk = setting(0.0002);
  const tse_params p = prepared(&c);
  const double q[3] = { 0.1 * 0.1, 0.15 * 0.15, 0.05 * 0.05 }, start[3] = { 0.1, 0.2, 0.3 };
  memset(&filter, 0x3c, sizeof filter);
  for (int a = 0; a < 3; a++) filter.bias_var[a] = real(start[a]);
  before = filter;
  bias_predict(&p, &filter, real(0.02));
  bias_predict(&p, &filter, real(0.5));
  for (int a = 0; a < 3; a++) {
    expect_near(start[a] + q[a] * 0.52, number(filter.bias_var[a]), REL, "variance", a);
    filter.bias_var[a] = before.bias_var[a];
  }
  TEST_ASSERT_EQUAL_MEMORY(&before, &filter, sizeof filter);
}

static void test_bias_variance_stops_at_the_larger_of_its_start_and_one_sigma(void)
{
  tse_config c = settings();
  c.accel_x_sd = c.accel_y_sd = setting(0.1);
  c.accel_x_bias_sd = setting(0.05); /* a quarter of sigma^2: the limit is one */
  c.accel_y_bias_sd = setting(0.2);  /* four sigma^2 */
  c.accel_x_bias_walk = c.accel_y_bias_walk = setting(1);
  c.yaw_rate_bias_walk = setting(0);
  const tse_params p = prepared(&c);
  memset(&filter, 0, sizeof filter);
  filter.bias_var[2] = real(0.25);
  bias_predict(&p, &filter, real(0.005));
  expect_near(0.5, number(filter.bias_var[0]), REL, "below the limit", 0);
  for (int i = 0; i < 10; i++) bias_predict(&p, &filter, real(1));
  expect_near(1, number(filter.bias_var[0]), 0, "one sigma", 0);
  expect_near(4, number(filter.bias_var[1]), REL * 4, "start", 1);
  expect_near(0.25, number(filter.bias_var[2]), 0, "no walk", 2);
}

/* ---------------------------------------------------------------------------------------- at standstill */

static double start_bias(int i) { return -0.5 + 0.05 * i; }

static void start_filter(double variance)
{
  memset(&filter, 0x3c, sizeof filter);
  for (int i = 0; i < 24; i++) filter.p.bias[2][i] = real(start_bias(i));
  for (int a = 0; a < 2; a++) filter.bias_var[a] = real(0.3);
  filter.bias_var[2] = real(variance);
  before = filter;
}

/* In closed form, of all readings at once: 1/P_n = 1/P_0 + n, b_n = P_n (b_0/P_0 + sum y). */
static void test_gyro_bias_becomes_the_weighted_mean_of_its_start_and_all_readings(void)
{
  const tse_params p = params();
  uint32_t state = 1;
  double sum = 0;
  start_filter(0.4);
  for (int n = 1; n <= 200; n++) {
    const double reading = next_between(&state, -2.0, 3.0);
    const sample y = gyro(reading, 1);
    sum += number(y.y[2]);
    bias_learn_still(&p, &filter, &y);
    const double variance = 1 / (1 / 0.4 + n);
    expect_near(variance, number(filter.bias_var[2]), BY_FORMAT(1e-13, 1e-6), "variance", n);
    for (int i = 0; i < 24; i++)
      expect_near(variance * (start_bias(i) / 0.4 + sum), number(filter.p.bias[2][i]), BY_FORMAT(1e-13, 3e-6), "bias", i);
  }
}

/* With (18) in between the variance settles where update and walk balance: P^2/(P + 1) = Q, P before the update. */
static void test_walk_and_readings_balance_at_the_riccati_solution(void)
{
  tse_config c = settings();
  c.yaw_rate_sd = setting(0.004);
  c.yaw_rate_bias_walk = setting(0.004); /* Q = dt in sigma^2 */
  const tse_params p = prepared(&c);
  const double q = 0.01, steady = (q + sqrt(q * q + 4 * q)) / 2;
  const sample y = gyro(1.0, 1);
  start_filter(1.0);
  for (int n = 0; n < 500; n++) {
    bias_learn_still(&p, &filter, &y);
    bias_predict(&p, &filter, real(0.01));
  }
  expect_near(steady, number(filter.bias_var[2]), BY_FORMAT(1e-12, 1e-6), "variance", 0);
}

static void test_standstill_teaches_nothing_but_the_gyro_bias(void)
{
  const tse_params p = params();
  const sample y = gyro(2.0, 1);
  start_filter(0.4);
  bias_learn_still(&p, &filter, &y);
  TEST_ASSERT_TRUE(filter.p.bias[2][20] != before.p.bias[2][20]);
  memcpy(filter.p.bias[2], before.p.bias[2], 24 * sizeof(tse_real)); /* what lies beyond the 24 must not have changed */
  filter.bias_var[2] = before.bias_var[2];
  TEST_ASSERT_EQUAL_MEMORY(&before, &filter, sizeof filter);
}

static void test_standstill_without_a_gyro_sample_teaches_nothing(void)
{
  const tse_params p = params();
  const sample y = gyro(2.0, 0);
  start_filter(0.4);
  bias_learn_still(&p, &filter, &y);
  TEST_ASSERT_EQUAL_MEMORY(&before, &filter, sizeof filter);
}

static void test_known_bias_is_not_learnt(void)
{
  const tse_params p = params();
  const sample y = gyro(2.0, 1);
  start_filter(0.0);
  bias_learn_still(&p, &filter, &y);
  TEST_ASSERT_EQUAL_MEMORY(&before, &filter, sizeof filter);
}

/* (19): P - gain^2, no less than 0, of three channels and of nothing that stands behind them. */
static void test_the_update_takes_what_the_sample_told_and_touches_nothing_else(void)
{
  static const double var[3] = { 4, 0.25, 1 }, gain[3] = { 0.5, 2, 0 }, expected[3] = { 3.75, 0, 1 };
  bias_gains c;
  for (size_t i = 0; i < sizeof c / sizeof(tse_real); i++) ((tse_real *)(void *)&c)[i] = TSE_R(1);
  memset(&filter, 0, sizeof filter);
  filter.log_total = filter.nu = TSE_R(-8); /* on both sides of them */
  for (int a = 0; a < 3; a++) {
    filter.bias_var[a] = real(var[a]);
    c.gain[a] = real(gain[a]);
  }
  before = filter;
  bias_update(&filter, &c);
  for (int a = 0; a < 3; a++) {
    expect_near(expected[a], number(filter.bias_var[a]), 0, "variance", a);
    before.bias_var[a] = filter.bias_var[a];
  }
  TEST_ASSERT_EQUAL_MEMORY(&before, &filter, sizeof filter);
}

int main(void)
{
  UNITY_BEGIN();
  RUN_TEST(test_one_sample_time_forgets_by_lambda);
  RUN_TEST(test_other_time_steps_forget_by_a_power_of_lambda);
  RUN_TEST(test_two_short_steps_forget_as_much_as_a_long_one);
  RUN_TEST(test_forgetting_changes_only_gamma_and_nu);
  RUN_TEST(test_degrees_of_freedom_never_fall_below_six);
  RUN_TEST(test_what_is_forgotten_is_not_forgotten_further);
  RUN_TEST(test_learning_and_forgetting_settle_at_the_memory_of_lambda);
  RUN_TEST(test_bias_variance_grows_with_time_by_the_squared_walk);
  RUN_TEST(test_bias_variance_stops_at_the_larger_of_its_start_and_one_sigma);
  RUN_TEST(test_gyro_bias_becomes_the_weighted_mean_of_its_start_and_all_readings);
  RUN_TEST(test_walk_and_readings_balance_at_the_riccati_solution);
  RUN_TEST(test_standstill_teaches_nothing_but_the_gyro_bias);
  RUN_TEST(test_standstill_without_a_gyro_sample_teaches_nothing);
  RUN_TEST(test_known_bias_is_not_learnt);
  RUN_TEST(test_the_update_takes_what_the_sample_told_and_touches_nothing_else);
  return UNITY_END();
}
