/* tests/unit/paper/test_estimate.c <-> src/paper/estimate.c: (26), (27), compared with
 * sums over the particles in long double, with the mean known before the squares are
 * summed. */
#include "paper/paper.h"
#include "unit_support.h"

static tse_filter_paper f;
static tse_config config;
static tse_params p;

/* Rounding of a weighted sum over n particles, relative to the largest term, and of the
 * variance about the first value: a few ulp (2^-52, 2^-23) times sqrt(n) times the ratio
 * of distance to spread, which is below 4 here. */
#define RELATIVE BY_FORMAT(4e-15, 3e-6)
#define RELATIVE_SD BY_FORMAT(4e-14, 2e-5)

static void start(int32_t n)
{
  tse_config_paper(&config);
  config.particles = n;
  p = prepared(config);
  memset(&f, 0, sizeof f);
  f.gamma = real(0.0123), f.nu = real(57.5);
  for (int a = 0; a < 3; a++) f.bias_var[a] = real(0.04 * (a + 1));
}

/* Particles near typical values. Lambda/nu is positive definite. Particles beyond n must
 * not count. */
static void fill(uint32_t *state, double spread)
{
  for (int32_t i = 0; i < TSE_STRIDE; i++) {
    const int inside = i < p.particles;
    const double wild = inside ? 1.0 : 1e6;
    f.weight[i] = inside ? real(pow(10.0, -3.0 * next_uniform(state))) : TSE_R(0);
    f.p.x[0][i] = real(wild * (20.0 + spread * next_between(state, -1.0, 1.0)));
    f.p.x[1][i] = real(wild * (-0.4 + spread * next_between(state, -1.0, 1.0)));
    f.p.x[2][i] = real(wild * (0.2 + 0.1 * spread * next_between(state, -1.0, 1.0)));
    for (int a = 0; a < 3; a++) {
      f.p.mu[a][i] = real(wild * (-0.3 + 0.2 * a + 0.1 * next_between(state, -1.0, 1.0)));
      f.p.bias[a][i] = real(wild * (0.5 - 0.4 * a + 0.2 * next_between(state, -1.0, 1.0)));
    }
    for (int k = 0; k < 6; k++) f.p.lam[k][i] = real(wild * 1e-3 * next_between(state, -1.0, 1.0));
    for (int a = 0; a < 3; a++)
      f.p.lam[a == 0 ? 0 : a == 1 ? 3 : 5][i] = real(wild * next_between(state, 0.002, 0.02) * (a + 1));
  }
}

static long double weight_of(int32_t i) { return number(f.weight[i]); }

static long double total(void)
{
  long double sum = 0.0L;
  for (int32_t i = 0; i < p.particles; i++) sum += weight_of(i);
  return sum;
}

static long double weighted_mean(const tse_real *value)
{
  long double sum = 0.0L;
  for (int32_t i = 0; i < p.particles; i++) sum += weight_of(i) * number(value[i]);
  return sum / total();
}

static long double variance_of(const tse_real *value)
{
  const long double mean = weighted_mean(value);
  long double sum = 0.0L;
  for (int32_t i = 0; i < p.particles; i++)
    sum += weight_of(i) * (number(value[i]) - mean) * (number(value[i]) - mean);
  return sum / total();
}

static void expect_all_estimates(void)
{
  static const int diagonal[3] = { 0, 3, 5 };
  tse_output y;
  memset(&y, 0x7f, sizeof y);
  paper_estimate(&p, &f, &y);

  long double squares = 0.0L;
  for (int32_t i = 0; i < p.particles; i++) squares += weight_of(i) * weight_of(i);
  const double n_eff = (double)(total() * total() / squares);
  expect_near(n_eff, number(paper_effective_size(&p, &f)), RELATIVE * n_eff, "n_eff", 0);

  const double x[3] = { number(y.vel_x), number(y.vel_y), number(y.yaw_rate) };
  const double x_sd[3] = { number(y.vel_x_sd), number(y.vel_y_sd), number(y.yaw_rate_sd) };
  for (int a = 0; a < 3; a++) {
    const double mean = (double)weighted_mean(f.p.x[a]), sd = (double)sqrtl(variance_of(f.p.x[a]));
    expect_near(mean, x[a], RELATIVE * fabs(mean), "state", a);
    expect_near(sd, x_sd[a], RELATIVE_SD * sd + QUANTUM / sd, "sd of state", a); /* rounding of a variance */
  }
  expect_near(atan2((double)weighted_mean(f.p.x[1]), (double)weighted_mean(f.p.x[0])), number(y.sideslip),
      RELATIVE, "sideslip", 0);

  const double nu = number(f.nu), gamma = number(f.gamma);
  for (int a = 0; a < 3; a++) {
    const double mean = (double)weighted_mean(f.p.mu[a]);
    /* lam is Lambda/nu; Sigma = Lambda/(nu - d_w - 1) with d_w = 3 */
    const double sigma = nu * (double)weighted_mean(f.p.lam[diagonal[a]]) / (nu - 4.0);
    const double mean_sd = sqrt(gamma * sigma + (double)variance_of(f.p.mu[a]));
    expect_near(1.0 + mean, number(y.stiffness[a]), RELATIVE, "stiffness", a);
    expect_near(sqrt(sigma), number(y.stiffness_spread[a]), RELATIVE * sqrt(sigma), "spread", a);
    expect_near(mean_sd, number(y.stiffness_sd[a]), RELATIVE_SD * mean_sd, "sd of the mean", a);

    const double sensor = number(p.sd[a]), bias = sensor * (double)weighted_mean(f.p.bias[a]);
    const double bias_sd = sensor * sqrt(number(f.bias_var[a]) + (double)variance_of(f.p.bias[a]));
    expect_near(bias, number(y.bias[a]), RELATIVE * sensor, "bias", a);
    expect_near(bias_sd, number(y.bias_sd[a]), RELATIVE_SD * bias_sd, "sd of bias", a);
  }
}

static void test_estimates_are_the_weighted_moments_and_padding_does_not_count(void)
{
  static const int32_t sizes[] = { 16, 17, 23, 24, 25, 100, 500, TSE_MAX_PARTICLES };
  uint32_t state = 1;
  for (int k = 0; k < ROWS(sizes); k++) {
    start(sizes[k] < TSE_MAX_PARTICLES ? sizes[k] : TSE_MAX_PARTICLES);
    fill(&state, 1.0);
    expect_all_estimates();
  }
}

static void test_weighted_means_are_those_of_any_rows(void)
{
  uint32_t state = 10;
  tse_real mean[4];
  start(61);
  fill(&state, 1.0);
  const tse_real *const rows[4] = { f.p.w[1], f.p.x[0], f.p.lam[5], f.p.bias[2] };
  for (int32_t i = 0; i < TSE_STRIDE; i++) f.p.w[1][i] = real(i < 61 ? 0.01 * i : 1e6);
  paper_weighted_means(&p, &f, rows, 4, mean);
  for (int k = 0; k < 4; k++) {
    const double expected = (double)weighted_mean(rows[k]);
    expect_near(expected, number(mean[k]), RELATIVE * (1.0 + fabs(expected)), "mean", k);
  }
}

static void test_equal_weights_give_the_number_of_particles_as_effective_size(void)
{
  uint32_t state = 3;
  start(133);
  fill(&state, 1.0);
  for (int32_t i = 0; i < 133; i++) f.weight[i] = TSE_R(1);
  expect_near(133.0, number(paper_effective_size(&p, &f)), 133.0 * RELATIVE, "n_eff", 0);
}

static void test_identical_particles_have_no_spread_of_their_own(void)
{
  uint32_t state = 4;
  tse_output y;
  start(100);
  fill(&state, 1.0);
  for (int32_t i = 1; i < 100; i++) {
    for (int a = 0; a < 3; a++) {
      f.p.x[a][i] = f.p.x[a][0], f.p.mu[a][i] = f.p.mu[a][0], f.p.bias[a][i] = f.p.bias[a][0];
    }
  }
  paper_estimate(&p, &f, &y);
  expect_near(0.0, number(y.vel_x_sd), 0.0, "vel_x_sd", 0);
  expect_near(number(f.p.x[0][0]), number(y.vel_x), 0.0, "vel_x", 0);
  expect_near(number(p.sd[1]) * sqrt(0.08), number(y.bias_sd[1]), RELATIVE,
      "bias_sd is that of the Kalman filter", 1);
  expect_near(number(y.stiffness_spread[2]) * sqrt(0.0123), number(y.stiffness_sd[2]), RELATIVE,
      "sqrt(gamma Sigma)", 2);
}

/* 20 m/s and particles that differ by millimetres per second: E[x^2] - E[x]^2 would lose
 * all digits in single precision, whose resolution at 20 m/s is 2 um/s. The sd, 3 mm/s,
 * must be accurate to 1e-3. */
static void test_millimetres_a_second_on_twenty_metres_a_second_survive(void)
{
  uint32_t state = 5;
  tse_output y;
  start(500);
  fill(&state, 0.005);
  expect_all_estimates();
  paper_estimate(&p, &f, &y);
  const double sd = (double)sqrtl(variance_of(f.p.x[0]));
  TEST_ASSERT_TRUE(sd > 0.002 && sd < 0.004);
  expect_near(sd, number(y.vel_x_sd), BY_FORMAT(1e-12, 1e-3) * sd, "vel_x_sd", 0);
}

static void test_sideslip_is_zero_at_standstill_and_right_in_every_quadrant(void)
{
  static const double v[][2] = { { 10.0, 1.0 }, { -10.0, 1.0 }, { -10.0, -1.0 }, { 10.0, -1.0 }, { 0.5, 2.0 },
    { 0.02, 0.0 }, { 0.0, 0.02 } };
  tse_output y;
  uint32_t state = 6;
  start(16);
  fill(&state, 1.0);
  for (int k = 0; k < ROWS(v); k++) {
    for (int32_t i = 0; i < 16; i++) { f.p.x[0][i] = real(v[k][0]), f.p.x[1][i] = real(v[k][1]); }
    paper_estimate(&p, &f, &y);
    expect_near(atan2(v[k][1], v[k][0]), number(y.sideslip), BY_FORMAT(1e-13, 1e-6), "sideslip", k);
  }
  for (int32_t i = 0; i < 16; i++) { f.p.x[0][i] = real(-0.009), f.p.x[1][i] = real(0.009); }
  paper_estimate(&p, &f, &y);
  expect_near(0.0, number(y.sideslip), 0.0, "sideslip at standstill", 0);
}

static void test_estimating_changes_neither_particles_nor_weights(void)
{
  static tse_filter_paper before;
  uint32_t state = 7;
  tse_output y;
  start(50);
  fill(&state, 1.0);
  memcpy(&before, &f, sizeof f);
  paper_estimate(&p, &f, &y);
  TEST_ASSERT_EQUAL_MEMORY(&before, &f, sizeof f);
}
