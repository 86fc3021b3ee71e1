/* tests/unit/test_error.c <-> src/error.c: the covariance of the error of the mean of all particles.
 *
 * References (tests/reference/generate_error.py): dense matrices of twelve states in SI units from numpy, and the error of
 * the filter counted in 200 000 runs. The Kalman filter's own covariance is that of gaussian.c, tested in test_gaussian.c. */
#include "unit_support.h"
#include "error_table.h"

enum { X = TSE_GAUSS, N = TSE_ERROR };
static tse_filter f;

/* What gaussian_foretell() hands over, made of P, H and Sigma. */
static forecast forecast_of(double P[X][X], double H[3][X], double sigma[3][3])
{
  forecast c;
  memset(&c, 0, sizeof c);
  for (int b = 0; b < 3; b++)
    for (int a = 0; a < X; a++) {
      double sum = 0.0;
      for (int k = 0; k < X; k++) sum += P[a][k] * H[b][k];
      c.ph[a][b] = real(sum);
      c.h[b][a] = real(H[b][a]);
    }
  for (int a = 0; a < 3; a++)
    for (int b = 0; b < 3; b++) {
      double hph = 0.0, sigma_d = 0.0, spread = 0.0;
      for (int i = 0; i < X; i++)
        for (int k = 0; k < X; k++) hph += H[a][i] * P[i][k] * H[b][k];
      for (int k = 0; k < 3; k++) sigma_d += sigma[a][k] * H[b][3 + k];
      for (int i = 0; i < 3; i++)
        for (int k = 0; k < 3; k++) spread += H[a][3 + i] * sigma[i][k] * H[b][3 + k];
      c.hph[a][b] = real(hph);
      c.sigma[a][b] = real(sigma[a][b]);
      c.sigma_d[a][b] = real(sigma_d);
      c.spread[a][b] = real(spread);
    }
  return c;
}

static void expect_symmetric(int index)
{
  for (int a = 0; a < N; a++)
    for (int b = 0; b < a; b++)
      if (memcmp(&f.err[a][b], &f.err[b][a], sizeof(tse_real)) != 0) expect_near(0, 1, 0, "not symmetric", index);
}

/* In float: S up to 1000 with cancelling cofactors, so that K is 1e-4 off, and E with it. */
static void expect_error(const double expected[N][N], int index)
{
  for (int a = 0; a < N; a++)
    for (int b = 0; b < N; b++) {
      const double sa = sqrt(expected[a][a]), sb = sqrt(expected[b][b]);
      expect_near(expected[a][b], number(f.err[a][b]), BY_FORMAT(1e-12, 3e-4) * sa * sb, "E", 1000 * index + 20 * a + b);
    }
}

/* ------------------------------------------------------------------------------------ update, prediction */

static void test_an_update_is_that_of_dense_matrices_in_si_units(void)
{
  for (int k = 0; k < ROWS(error_update_cases); k++) {
    error_update_case c = error_update_cases[k];
    memset(&f, 0, sizeof f);
    for (int a = 0; a < N; a++)
      for (int b = 0; b < N; b++) f.err[a][b] = a < X && b < X ? real(c.E[a][b]) : TSE_R(77); /* eps of before: of no concern */
    const forecast fc = forecast_of(c.P, c.H, c.sigma);
    const tse_real noise[3] = { real(c.noise[0]), real(c.noise[1]), real(c.noise[2]) };
    error_update(&f, &fc, noise);
    expect_symmetric(k);
    expect_error(c.after, k);
  }
}

static void test_a_prediction_is_a_e_at_and_the_next_eps_is_another_one(void)
{
  for (int k = 0; k < ROWS(error_predict_cases); k++) {
    const error_predict_case *const c = &error_predict_cases[k];
    tse_real jac[3][6];
    memset(&f, 0, sizeof f);
    for (int a = 0; a < N; a++)
      for (int b = 0; b < N; b++) f.err[a][b] = real(c->E[a][b]);
    for (int a = 0; a < 3; a++)
      for (int b = 0; b < 6; b++) jac[a][b] = real(c->jac[a][b]);
    error_predict(&f, jac);
    expect_symmetric(k);
    for (int a = 0; a < N; a++)
      for (int b = 0; b < N; b++) {
        const double scale = sqrt(fmax(c->after[a][a], c->E[a][a]) * fmax(c->after[b][b], c->E[b][b]));
        expect_near(c->after[a][b], number(f.err[a][b]), BY_FORMAT(1e-14, 3e-6) * scale, "E", 1000 * k + 20 * a + b);
      }
  }
}

/* A missing channel's row of H is zero: whatever its noise, it moves nothing. */
static void test_without_a_measurement_nothing_is_known_better(void)
{
  error_update_case c = error_update_cases[0];
  memset(&f, 0, sizeof f);
  memset(c.H, 0, sizeof c.H);
  for (int a = 0; a < X; a++)
    for (int b = 0; b < X; b++) f.err[a][b] = real(c.E[a][b]);
  const forecast fc = forecast_of(c.P, c.H, c.sigma);
  error_update(&f, &fc, TOLD);
  for (int a = 0; a < X; a++)
    for (int b = 0; b < X; b++) expect_near(number(real(c.E[a][b])), number(f.err[a][b]), 0.0, "E", 20 * a + b);
}

/* ------------------------------------------------------------------------------------------- a drive */

static inputs inputs_of(double steer, double front, double rear)
{
  inputs u;
  u.steer = real(steer);
  u.v_front = real(front);
  u.v_rear = real(rear);
  return u;
}

/* Where the gain is Kalman's (no forgetting) and there is no spread, what it says of itself is true: E = P. What differs is
 * rounding: P loses gain gain', E is a sum of squares (Joseph's form). */
static void test_without_forgetting_and_spread_the_error_is_what_the_kalman_filter_says(void)
{
  tse_config config;
  uint32_t state = 7;
  tse_config_default(&config);
  believe_everything(&config);
  config.particles = 16;
  const tse_params p = prepared(&config);
  memset(&f, 0, sizeof f);
  gaussian_start(&p, &f);
  f.nu = p.nu0;
  double worst = 0.0;
  for (int step = 0; step < 3000; step++) {
    const double v = 8.0 + 20.0 * (step % 1000) / 1000.0, slip = next_between(&state, -0.01, 0.01);
    sample y;
    forecast fc;
    gaussian g;
    memset(&y, 0, sizeof y);
    y.dt = p.sample_time;
    y.u = inputs_of(step % 300 < 150 ? 0.03 : -0.03, v * (1.0 + slip), v);
    for (int a = 0; a < 3; a++) y.use[a] = step % 7 == 3 + a ? TSE_R(0) : TSE_R(1);
    for (int32_t i = 0; i < 16; i++) {
      f.weight[i] = TSE_R(1);
      f.p.x[0][i] = real(v);
      f.p.x[1][i] = real(0.2 * sin(0.03 * step));
      f.p.x[2][i] = real(0.2 * sin(0.02 * step));
      for (int a = 0; a < 3; a++) f.p.w[a][i] = f.p.mu[a][i] = real(-0.1 * a);
    }
    bias_predict(&p, &f, y.dt);
    gaussian_predict(&p, &f, y.u, y.dt);
    f.steer = y.u.steer;
    f.v_front = y.u.v_front;
    f.v_rear = y.u.v_rear;
    (void)observed(&p, &f, &y, &fc, &g);
    gaussian_update(&p, &f, &g, &fc, TOLD);
    for (int a = 0; a < X; a++)
      for (int b = 0; b < X; b++) {
        const double off = fabs(number(f.err[a][b]) - number(f.cov[a][b]));
        const double scale = sqrt(number(f.cov[a][a]) * number(f.cov[b][b])) + BY_FORMAT(1e-16, 1e-9);
        worst = fmax(worst, off / scale);
      }
  }
  expect_near(0.0, worst, BY_FORMAT(1e-6, 0.05), "E and P, over P", 0);
  TEST_ASSERT_TRUE(number(f.err[4][4]) < 0.01 * number(p.mean_var0)); /* and something was learnt */
}

/* ------------------------------------------------------------------------------------------ a constant */

/* y = m + eps + e: only the mean stiffness of one axle, seen by one channel with H = 1. */
static void measure(const tse_params *p, double spread_var)
{
  double P[X][X] = { { 0 } }, H[3][X] = { { 0 } }, sigma[3][3] = { { 0 } };
  gaussian g;
  P[4][4] = number(f.cov[4][4]);
  H[1][4] = 1.0;
  sigma[1][1] = spread_var;
  const forecast fc = forecast_of(P, H, sigma);
  TEST_ASSERT_TRUE(gaussian_observe(&fc, TOLD, &g));
  gaussian_update(p, &f, &g, &fc, TOLD);
}

static tse_params constant(double forgetting, double start_var)
{
  tse_config c;
  tse_config_default(&c);
  c.forgetting = (tse_setting)forgetting;
  c.mean_walk = 0;
  c.initial_mean_sd = 2;
  c.particles = 16;
  const tse_params p = prepared(&c);
  memset(&f, 0, sizeof f);
  f.nu = p.nu0;
  f.cov[4][4] = f.err[4][4] = real(start_var);
  return p;
}

/* 4.5 standard errors of the count: chance 7e-6 for one figure. */
static void test_the_error_of_a_forgetting_filter_is_the_one_that_is_counted(void)
{
  const tse_params p = constant(CONSTANT_FORGETTING, CONSTANT_START_VAR);
  int at = 0;
  for (int k = 1; at < ROWS(constant_rows); k++) {
    measure(&p, CONSTANT_SPREAD_VAR);
    if (k == constant_rows[at].samples) {
      expect_near(constant_rows[at].variance, number(f.err[4][4]), 4.5 * constant_rows[at].standard_error, "variance after", k);
      at++;
    }
    forget(&p, &f, p.sample_time);
  }
}

/* For one constant and no spread K settles at 1 - lambda, P at (1 - lambda) R, E at (1 - lambda)/(1 + lambda) R. */
static void test_a_long_run_settles_at_half_of_what_forgetting_keeps(void)
{
  static const double lambda[] = { 0.9, 0.95, 0.99 };
  for (int k = 0; k < ROWS(lambda); k++) {
    const tse_params p = constant(lambda[k], 1.0);
    for (int i = 0; i < 2000; i++) {
      measure(&p, 0.0);
      if (i < 1999) forget(&p, &f, p.sample_time);
    }
    expect_near(1.0 - lambda[k], number(f.cov[4][4]), BY_FORMAT(1e-9, 1e-4), "P", k);
    expect_near((1.0 - lambda[k]) / (1.0 + lambda[k]), number(f.err[4][4]), BY_FORMAT(1e-9, 1e-4), "E", k);
  }
}

/* In the outputs: E's, and not P's. */
static void test_the_sd_of_a_mean_in_the_outputs_is_that_of_its_error(void)
{
  tse_output y;
  const tse_params p = constant(0.99, 1.0);
  for (int32_t i = 0; i < 16; i++) {
    f.weight[i] = TSE_R(1);
    for (int k = 0; k < 6; k++) f.p.lam[k][i] = TSE_R(0.01);
  }
  for (int a = 0; a < 3; a++) f.err[3 + a][3 + a] = real(0.0625 * (a + 1) * (a + 1));
  estimate(&p, &f, &y);
  for (int a = 0; a < 3; a++) expect_near(0.25 * (a + 1), number(y.stiffness_sd[a]), BY_FORMAT(1e-15, 1e-7), "sd", a);
}

int main(void)
{
  UNITY_BEGIN();
  RUN_TEST(test_an_update_is_that_of_dense_matrices_in_si_units);
  RUN_TEST(test_a_prediction_is_a_e_at_and_the_next_eps_is_another_one);
  RUN_TEST(test_without_a_measurement_nothing_is_known_better);
  RUN_TEST(test_without_forgetting_and_spread_the_error_is_what_the_kalman_filter_says);
  RUN_TEST(test_the_error_of_a_forgetting_filter_is_the_one_that_is_counted);
  RUN_TEST(test_a_long_run_settles_at_half_of_what_forgetting_keeps);
  RUN_TEST(test_the_sd_of_a_mean_in_the_outputs_is_that_of_its_error);
  return UNITY_END();
}
