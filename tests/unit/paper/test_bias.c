/* tests/unit/paper/test_bias.c <-> src/paper/bias.c: (18), and paper_forget() in learn.c:
 * (17). The update (19), together with its draw: test_learn.c. */
#include "paper/paper.h"
#include "unit_support.h"

#define REL BY_FORMAT(1e-12, 2e-6) /* exp2 and log2 of the format, a few roundings */

static tse_filter_paper filter, before;

static tse_config settings(void)
{
  tse_config c = config_by(tse_config_paper);
  c.particles = 21; /* padded to 24 */
  c.forgetting = setting(0.98), c.sample_time = setting(0.01);
  return c;
}

static tse_params params(void) { return prepared(settings()); }

/* A filter with the members that are read. */
static void know(double gamma, double nu)
{
  memset(&filter, 0, sizeof filter);
  filter.gamma = real(gamma), filter.nu = real(nu);
}

/* A row in which every channel is `off` sigma from its prediction. */
static void forget_after(const tse_params *p, tse_filter_paper *f, tse_real dt, double off)
{
  sample y = { 0 };
  tse_output now = { 0 };
  y.dt = dt;
  now.vel_x = y.u.v_front = y.u.v_rear = real(20); /* straight on: no slip, no force */
  for (int a = 0; a < 3; a++) {
    now.stiffness[a] = y.use[a] = TSE_R(1);
    y.y[a] = real(off);
  }
  paper_forget(p, f, &y, &now);
}

static void forget_for(const tse_params *p, tse_filter_paper *f, tse_real dt) { forget_after(p, f, dt, 0); }

/* ------------------------------------------------------------------------------------------------ (17) */

static void test_one_sample_time_forgets_by_lambda(void)
{
  const tse_params p = params();
  know(0.05, 40);
  forget_for(&p, &filter, p.sample_time);
  expect_near(0.05 / 0.98, number(filter.gamma), REL * 0.05, "gamma", 0);
  expect_near(40 * 0.98, number(filter.nu), REL * 40, "nu", 0);
}

/* Lambda *= lambda and nu *= lambda: their quotient, which the particles store, is
 * unchanged, and so is everything else. */
static void test_forgetting_changes_only_gamma_and_nu(void)
{
  const tse_params p = params();
  memset(&filter, 0x3c, sizeof filter);
  filter.gamma = real(0.05), filter.nu = real(40);
  before = filter;
  forget_for(&p, &filter, p.sample_time);
  TEST_ASSERT_TRUE(filter.gamma != before.gamma && filter.nu != before.nu);
  filter.gamma = before.gamma, filter.nu = before.nu;
  TEST_ASSERT_EQUAL_MEMORY(&before, &filter, sizeof filter);
}

/* nu > 4 keeps A and Sigma valid: repeated long steps stop at 6. */
static void test_degrees_of_freedom_never_fall_below_six(void)
{
  const tse_params p = params();
  know(1e-6, 40);
  for (int i = 0; i < 60; i++) forget_for(&p, &filter, real(0.1));
  expect_near(6, number(filter.nu), 0, "nu", 0);
}

/* After any time, the mean is as uncertain as after one sample, or as at the start, and
 * nu is at its minimum. */
static void test_what_is_forgotten_is_not_forgotten_further(void)
{
  static const double dt[] = { 60, 600, 3600 };
  static const double lambda[] = { 0.9, 0.98, 0.9999 };
  for (int i = 0; i < ROWS(dt); i++)
    for (int k = 0; k < ROWS(lambda); k++) {
      tse_config c = settings();
      c.forgetting = setting(lambda[k]);
      const tse_params p = prepared(c);
      know(0.05, 40);
      forget_for(&p, &filter, real(dt[i]));
      expect_near(fmin(0.05 * exp2(-dt[i] / 0.01 * log2(lambda[k])), fmax(1, number(p.gamma0))),
          number(filter.gamma), 1e-3, "gamma", i);
      TEST_ASSERT_TRUE(number(filter.nu) >= 6 && number(filter.nu) <= 40);
      filter.gamma = TSE_R(0);
      forget_for(&p, &filter, real(dt[i]));
      expect_near(0, number(filter.gamma), 0, "a mean that is known", i);
    }
}

/* gamma rises to at most 1, as after one sample, or to its value at the start if that is
 * larger. A gamma that is larger already stays. */
static void test_gamma_rises_to_one_or_to_its_value_at_the_start(void)
{
  static const struct {
    double spread, from, to; /* initial_mean_sd is 0.3: gamma is 0.5625, or 4, at the start */
  } cases[] = { { 0.4, 0.05, 1 }, { 0.4, 0.9, 1 }, { 0.4, 1.5, 1.5 }, { 0.15, 0.05, 4 }, { 0.15, 1.5, 4 } };
  for (int k = 0; k < ROWS(cases); k++) {
    tse_config c = settings();
    c.initial_mean_sd = setting(0.3), c.initial_spread = setting(cases[k].spread);
    const tse_params p = prepared(c);
    know(cases[k].from, 40);
    for (int i = 0; i < 100; i++) forget_for(&p, &filter, real(0.1));
    expect_near(cases[k].to, number(filter.gamma), BY_NUMBER(1e-12, 1e-5, 1e-3), "gamma", k);
  }
}

/* The mean has its own factor: gamma by it, nu and Lambda by the other. */
static void test_the_mean_may_forget_faster_than_the_covariance(void)
{
  tse_config c = settings();
  c.forgetting_mean = setting(0.95);
  const tse_params p = prepared(c);
  know(0.05, 40);
  forget_for(&p, &filter, real(0.02));
  expect_near(0.05 / (0.95 * 0.95), number(filter.gamma), REL, "gamma", 0);
  expect_near(40 * 0.98 * 0.98, number(filter.nu), REL * 40, "nu", 0);
}

/* A missing channel has no innovation: its low-passed innovation stays. */
static void test_a_missing_channel_leaves_its_low_passed_innovation(void)
{
  tse_config c = settings();
  c.forgetting_change = setting(0.8);
  const tse_params p = prepared(c);
  for (int missing = 0; missing < 3; missing++) {
    sample y = { 0 };
    tse_output now = { 0 };
    know(0.05, 40);
    y.dt = p.sample_time;
    now.vel_x = y.u.v_front = y.u.v_rear = real(20);
    for (int a = 0; a < 3; a++) {
      filter.slow[a] = TSE_R(0.5);
      now.stiffness[a] = TSE_R(1);
      y.use[a] = a == missing ? TSE_R(0) : TSE_R(1);
      y.y[a] = TSE_R(0);
    }
    paper_forget(&p, &filter, &y, &now);
    for (int a = 0; a < 3; a++)
      expect_near(a == missing ? 0.5 : 0.5 * (1 - 0.01 / 0.11), number(filter.slow[a]),
          BY_FORMAT(1e-12, 1e-6), "low-passed innovation", a);
  }
}

/* Persistent innovations of c sigma, filtered with gain g, become c (1 - (1 - g)^n).
 * White ones of variance one leave g/(2 - g). The factor decreases by 0.05 for each
 * multiple of that above 3, down to forgetting_change. */
static void test_the_mean_forgets_faster_where_innovations_last(void)
{
  static const double off[] = { 0, 0.2, 0.45, 2 };
  const double g = 0.01 / 0.11;
  tse_config c = settings();
  c.forgetting_change = setting(0.8);
  const tse_params p = prepared(c);
  for (int i = 0; i < ROWS(off); i++) {
    int least = 0;
    memset(&filter, 0, sizeof filter);
    for (int n = 1; n <= 60; n++) {
      const double slow = off[i] * (1 - pow(1 - g, n)), beyond = slow * slow * (2 - g) / g - 3;
      const double lambda = fmax(0.8, 0.98 - 0.05 * fmax(beyond, 0));
      least += lambda < 0.801;
      filter.gamma = real(0.05), filter.nu = real(40);
      forget_after(&p, &filter, p.sample_time, off[i]);
      expect_near(0.05 / lambda, number(filter.gamma), BY_FORMAT(1e-12, 4e-6), "gamma", n);
      expect_near(40 * 0.98, number(filter.nu), REL * 40, "nu", n);
    }
    TEST_ASSERT_EQUAL_INT(i == 3, least > 0);
  }
}

/* (16) adds a sample, (17) forgets: nu tends to lambda/(1 - lambda), gamma to (1 -
 * lambda)/lambda. */
static void test_learning_and_forgetting_settle_at_the_memory_of_lambda(void)
{
  const tse_params p = params();
  know(1, 10);
  for (int i = 0; i < 3000; i++) {
    filter.gamma = real(number(filter.gamma) / (1 + number(filter.gamma)));
    filter.nu = real(number(filter.nu) + 1);
    forget_for(&p, &filter, p.sample_time);
  }
  expect_near(0.98 / 0.02, number(filter.nu), BY_FORMAT(1e-9, 2e-3), "nu",
      0); /* errors accumulate over 1/(1 - lambda) samples */
  expect_near(0.02 / 0.98, number(filter.gamma), BY_FORMAT(1e-12, 1e-6), "gamma", 0);
}

/* ------------------------------------------------------------------------------------------------ (18) */

static void test_bias_variance_grows_with_time_by_the_squared_walk(void)
{
  tse_config c = settings();
  c.accel_x_sd = setting(0.1), c.accel_y_sd = setting(0.2), c.yaw_rate_sd = setting(0.004);
  c.accel_x_bias_walk = setting(0.01), c.accel_y_bias_walk = setting(0.03);
  c.yaw_rate_bias_walk = setting(0.0002);
  const tse_params p = prepared(c);
  const double q[3] = { 0.1 * 0.1, 0.15 * 0.15, 0.05 * 0.05 }, start[3] = { 0.1, 0.2, 0.3 };
  memset(&filter, 0x3c, sizeof filter);
  for (int a = 0; a < 3; a++) filter.bias_var[a] = real(start[a]);
  before = filter;
  paper_predict_bias(&p, &filter, real(0.02));
  paper_predict_bias(&p, &filter, real(0.5));
  for (int a = 0; a < 3; a++) {
    expect_near(start[a] + q[a] * 0.52, number(filter.bias_var[a]), REL, "variance", a);
    filter.bias_var[a] = before.bias_var[a];
  }
  TEST_ASSERT_EQUAL_MEMORY(&before, &filter, sizeof filter);
}
