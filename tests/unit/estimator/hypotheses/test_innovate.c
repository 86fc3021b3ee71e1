/* tests/unit/estimator/hypotheses/test_innovate.c <-> src/estimator/hypotheses/innovate.c and .h
 *
 * Slopes by differences, S by dense products, inverse by elimination, densities by scipy (tests/reference/hypotheses_table.h). */
#include "unit_support.h"
#include "hypotheses_support.h"
#include "hypotheses_table.h"

static tse_params a_car(void)
{
  tse_config c;
  tse_config_default(&c);
  return prepared(&c);
}

static void state_of(const tse_hypothesis *h, double z[JOINT])
{
  memset(z, 0, JOINT * sizeof z[0]);
  for (int i = 0; i < TSE_X; i++) z[i] = number(h->x[i]);
}

static void expect_innovation(const tse_params *p, const tse_hypothesis *h, const sample *y, double P[JOINT][JOINT])
{
  double z[JOINT], H[3][JOINT], read[3], s[3][3], flat[9], one[9] = { 1, 0, 0, 0, 1, 0, 0, 0, 1 }, m2 = 0;
  const double u[3] = { number(y->u.steer), number(y->u.v_front), number(y->u.v_rear) };
  innovation o;
  innovate(p, h, y, &o);
  state_of(h, z);
  ref_forecast(p, y, z, u, read);
  ref_slopes(p, y, z, H);
  for (int a = 0; a < 3; a++) {
    const int is = number(y->use[a]) > 0;
    expect_near(number(y->y[a]) - read[a], number(o.e[a]), BY_FORMAT(1e-10, 5e-4) * (1 + fabs(read[a])), "innovation", a);
    for (int i = 0; i < TSE_X; i++) {
      double sum = 0;
      for (int k = 0; k < TSE_X; k++) sum += H[a][k] * P[k][i];
      expect_near(sum, number(o.ph[a][i]), BY_FORMAT(1e-6, 1e-3) * sqrt(P[i][i]) * 50, "P H'", 100 * a + i);
    }
    for (int b = 0; b < 3; b++) {
      s[a][b] = a == b ? is ? number(h->noise_var[a]) : 1 : 0;
      for (int i = 0; i < TSE_X; i++)
        for (int j = 0; j < TSE_X; j++) s[a][b] += H[a][i] * P[i][j] * H[b][j];
      if (a == 0 && b == 0) s[a][b] += pow(H[0][0] / z[3], 2) * P[0][0] * P[3][3]; /* of speed times stiffness */
      for (int k = 0; k < 3; k++) s[a][b] += H[a][TSE_X + k] * H[b][TSE_X + k] * number(h->spread_var[k]) * pow(number(h->x[3 + k]), 2);
      flat[3 * a + b] = s[a][b];
      expect_near(s[a][b], number(o.s[a][b]), BY_FORMAT(1e-6, 1e-3) * (fabs(s[a][b]) + 5), "S", 10 * a + b);
    }
  }
  expect_near(log2(det3(s)), number(o.log2_det), BY_FORMAT(1e-6, 2e-3), "log2 det S", 0);
  dense_solve(3, flat, one, 3);
  for (int a = 0; a < 3; a++)
    for (int b = 0; b < 3; b++) m2 += number(o.e[a]) * one[3 * a + b] * number(o.e[b]);
  expect_near(m2, number(o.m2), BY_FORMAT(1e-5, 5e-3) * (1 + m2), "m2", 0);
}

static void test_forecast_slopes_and_covariance_are_those_of_dense_algebra(void)
{
  const tse_params p = a_car();
  uint32_t seed = 3;
  double P[JOINT][JOINT];
  for (int i = 0; i < 200; i++) {
    const tse_hypothesis h = some_hypothesis(&p, &seed, 1, P);
    const sample y = some_sample(&seed, &h, 20, i % 8);
    expect_innovation(&p, &h, &y, P);
  }
}

/* Speed and stiffness both unknown, as at a start: the variance of accel_x as foretold is that of draws. 2 %: twice the sd of a
 * variance of 20000 draws; slopes alone are a fifth off. */
static void test_where_speed_and_stiffness_are_unknown_their_product_is_as_drawn(void)
{
  enum { DRAWS = 20000 };
  const tse_params p = a_car();
  uint32_t seed = 14;
  double P[JOINT][JOINT], z[JOINT], sum = 0, squares = 0;
  tse_hypothesis h = some_hypothesis(&p, &seed, 1, P);
  const double v = number(h.x[0]), sd_v = 0.1, sd_c = 0.35, u[3] = { 0, v * 1.002, v * 1.002 };
  sample y = some_sample(&seed, &h, 1, 7);
  y.u = inputs_of(u[0], u[1], u[2]);
  y.late_steer = real(0);
  memset(h.cov, 0, sizeof h.cov);
  memset(h.spread_var, 0, sizeof h.spread_var);
  h.cov[0][0] = real(sd_v * sd_v);
  h.cov[3][3] = real(sd_c * sd_c);
  state_of(&h, z);
  const double at[2] = { z[0], z[3] };
  for (int k = 0; k < DRAWS; k++) {
    double read[3];
    z[0] = at[0] + sd_v * sqrt(3) * next_between(&seed, -1, 1);
    z[3] = at[1] + sd_c * sqrt(3) * next_between(&seed, -1, 1);
    ref_forecast(&p, &y, z, u, read);
    sum += read[0];
    squares += read[0] * read[0];
  }
  innovation o;
  innovate(&p, &h, &y, &o);
  const double drawn = squares / DRAWS - pow(sum / DRAWS, 2) + number(h.noise_var[0]);
  expect_near(drawn, number(o.s[0][0]), 0.02 * drawn, "variance", 0);
  TEST_ASSERT_TRUE(drawn > 1.1 * (number(o.s[0][0]) - number(o.noise[0]) + number(h.noise_var[0]))); /* slopes alone */
}

/* A channel that is missing says nothing: the density is that of the others alone. */
static void test_a_missing_channel_has_no_part(void)
{
  const tse_params p = a_car();
  uint32_t seed = 4;
  double P[JOINT][JOINT];
  const tse_hypothesis h = some_hypothesis(&p, &seed, 1, P);
  for (int mask = 0; mask < 8; mask++) {
    sample y = some_sample(&seed, &h, 5, mask);
    innovation o;
    innovate(&p, &h, &y, &o);
    for (int a = 0; a < 3; a++) {
      if (mask >> a & 1) continue;
      expect_near(0, number(o.e[a]), 0, "e", a);
      expect_near(1, number(o.s[a][a]), 0, "S", a);
      for (int i = 0; i < TSE_X; i++) expect_near(0, number(o.ph[a][i]), 0, "P H'", i);
      for (int b = 0; b < 3; b++) TEST_ASSERT_TRUE(a == b || fabs(number(o.s[a][b])) <= 0);
    }
    expect_near((number(EVIDENCE_DOF) + y.used) / 2, number(o.half_dof), 0, "degrees of freedom", mask);
  }
}

/* log2_density() lacks a constant, which is that of the density at its mode; a sample far off costs no more than an outlier. */
static void test_the_density_is_a_student_t_down_to_what_an_outlier_costs(void)
{
  int capped = 0;
  expect_near(8, number(EVIDENCE_DOF), 0, "degrees of freedom of the table", 0);
  for (int k = 0; k < ROWS(density_cases); k++) {
    const density_case *const c = &density_cases[k];
    double s[9], x[3], m2 = 0, dense[3][3];
    innovation o;
    memset(&o, 0, sizeof o);
    for (int i = 0; i < 9; i++) dense[i / 3][i % 3] = s[i] = c->s[i];
    memcpy(x, c->e, sizeof x);
    dense_solve(3, s, x, 1);
    for (int a = 0; a < 3; a++) m2 += c->e[a] * x[a];
    o.m2 = real(m2);
    o.log2_det = real(log2(det3(dense)));
    o.half_dof = real((8 + c->channels) / 2.0);
    const double constant = lgamma((8 + c->channels) / 2.0) - lgamma(4) - 0.5 * c->channels * log(8 * 3.14159265358979323846);
    const double least = constant - log(2) * (0.5 * log2(det3(dense)) + number(OUTLIER_COST));
    capped += c->log_density < least;
    expect_near(fmax(c->log_density, least), log(2) * number(log2_density(&o)) + constant, BY_FORMAT(1e-9, 1e-4), "log density", k);
  }
  TEST_ASSERT_TRUE(capped > 0 && capped < ROWS(density_cases));
}

/* Up to max_slip the spread is what was learnt; beyond, the stiffness is as uncertain as slip is large. */
static void test_a_wheel_beyond_the_greatest_slip_has_a_stiffness_that_is_not_known(void)
{
  const tse_params p = a_car();
  uint32_t seed = 5;
  double P[JOINT][JOINT];
  tse_hypothesis h = some_hypothesis(&p, &seed, 1, P);
  const double v = number(h.x[0]);
  sample y = some_sample(&seed, &h, 1, 7);
  innovation o;
  h.x[X_LAG] = real(0);
  y.u = inputs_of(0, v, v / (1 - 0.049));
  innovate(&p, &h, &y, &o);
  TEST_ASSERT_EQUAL_INT(0, o.slides);
  y.u = inputs_of(0, 0, v); /* front wheels locked: slip -1 */
  innovate(&p, &h, &y, &o);
  TEST_ASSERT_TRUE(o.slides);
  for (int a = 0; a < 3; a++) {
    const double wider = a == TSE_CY_REAR ? 0 : 1 / 0.05 - 1;
    const double expected = (number(h.spread_var[a]) + wider * wider) * pow(number(h.x[3 + a]), 2);
    expect_near(expected, number(o.eps_var[a]), BY_FORMAT(1e-9, 1e-4) * expected, "variance of eps", a);
  }
}

static void test_a_fault_takes_the_reading_out_or_the_input(void)
{
  const tse_params p = a_car();
  uint32_t seed = 6;
  double P[JOINT][JOINT], z[JOINT];
  tse_hypothesis h = some_hypothesis(&p, &seed, 1, P);
  const sample y = some_sample(&seed, &h, 5, 7);
  h.x[X_LAG] = real(0); /* what is at fault is the input as it acts */
  innovation healthy, o;
  innovate(&p, &h, &y, &healthy);
  for (int a = 0; a < 3; a++) {
    h.fault = FAULT_MEASURED + a;
    innovate(&p, &h, &y, &o);
    const double more = number(h.noise_var[a]) * (number(FAULT_NOISE) - 1);
    expect_near(number(healthy.s[a][a]) + more, number(o.s[a][a]), BY_FORMAT(1e-9, 1e-2), "S", a);
    TEST_ASSERT_TRUE(fabs(number(o.inv[a][a])) < 2 / number(FAULT_NOISE) / number(h.noise_var[a]));
  }
  state_of(&h, z);
  for (int off = 0; off < 3; off++) { /* slopes by the input, by differences */
    const int a = off == 0 ? TSE_CY_FRONT : TSE_CX_FRONT;
    double u[3] = { number(y.u.steer), number(y.u.v_front), number(y.u.v_rear) }, lo[3], hi[3];
    h.fault = FAULT_STEER + off;
    innovate(&p, &h, &y, &o);
    u[off] -= 1e-6;
    ref_forecast(&p, &y, z, u, lo);
    u[off] += 2e-6;
    ref_forecast(&p, &y, z, u, hi);
    for (int i = 0; i < 3; i++) expect_near((hi[i] - lo[i]) / 2e-6, number(in_sigma(&o, i, o.d[i][a])), BY_FORMAT(1e-4, 1e-2) + 1e-4 * fabs(hi[i] - lo[i]) / 2e-6, "slope", i);
    expect_near(pow(number(off ? FAULT_WHEEL_SD : FAULT_STEER_SD), 2), number(o.eps_var[a]), 1e-6, "variance", off);
  }
}

/* By drawing. */
static void test_noise_of_the_wheel_speeds_is_in_the_reading_as_drawn(void)
{
  tse_config c;
  tse_config_default(&c);
  c.wheel_noise_sd = setting(0.1);
  const tse_params p = prepared(&c), quiet = a_car();
  uint32_t seed = 7;
  double P[JOINT][JOINT], z[JOINT], mean = 0, square = 0, read[3];
  tse_hypothesis h = some_hypothesis(&p, &seed, 1, P);
  sample y = some_sample(&seed, &h, 1, 7);
  h.x[X_LAG] = real(0);
  y.u = inputs_of(0, number(h.x[0]) + 0.5, number(h.x[0]) + 0.5); /* no kink */
  innovation o, without;
  innovate(&p, &h, &y, &o);
  innovate(&quiet, &h, &y, &without);
  state_of(&h, z);
  enum { DRAWS = 40000 };
  for (int i = 0; i < DRAWS; i++) {
    double n[2];
    for (int k = 0; k < 2; k++) n[k] = 0.033 * sqrt(-2 * log(next_uniform(&seed))) * cos(6.283185307179586 * next_uniform(&seed));
    const double u[3] = { 0, number(y.u.v_front) + n[0], number(y.u.v_rear) + n[1] };
    ref_forecast(&p, &y, z, u, read);
    mean += read[0] / DRAWS;
    square += read[0] * read[0] / DRAWS;
  }
  const double var = square - mean * mean;
  expect_near(var, number(o.noise[0]) - number(without.noise[0]), 0.05 * var, "variance of the reading", 0);
}

/* Not of this row's, which is noisy. */
static void test_where_wheel_speeds_are_noisy_slopes_are_of_the_smoothed_slip(void)
{
  tse_config c;
  tse_config_default(&c);
  c.wheel_noise_sd = setting(0.1);
  const tse_params p = prepared(&c);
  uint32_t seed = 8;
  double P[JOINT][JOINT];
  tse_hypothesis h = some_hypothesis(&p, &seed, 1, P);
  const sample y = some_sample(&seed, &h, 1, 7);
  innovation o;
  h.slip[0] = real(0.004);
  h.slip[1] = real(-0.001);
  innovate(&p, &h, &y, &o);
  const double inv = number(p.inv_sd[0]), slope = inv * (number(p.kx_front) * 0.004 - number(p.kx_rear) * number(p.follow) * 0.001);
  expect_near(slope, number(o.h[0][3]), BY_FORMAT(1e-9, 1e-4), "by the stiffness", 0);
  h.slip[0] = h.slip[1] = real(0);
  innovate(&p, &h, &y, &o);
  expect_near(0, number(o.h[0][3]), 0, "by the stiffness", 1);
}

int main(void)
{
  UNITY_BEGIN();
  RUN_TEST(test_forecast_slopes_and_covariance_are_those_of_dense_algebra);
  RUN_TEST(test_where_speed_and_stiffness_are_unknown_their_product_is_as_drawn);
  RUN_TEST(test_a_missing_channel_has_no_part);
  RUN_TEST(test_the_density_is_a_student_t_down_to_what_an_outlier_costs);
  RUN_TEST(test_a_wheel_beyond_the_greatest_slip_has_a_stiffness_that_is_not_known);
  RUN_TEST(test_a_fault_takes_the_reading_out_or_the_input);
  RUN_TEST(test_noise_of_the_wheel_speeds_is_in_the_reading_as_drawn);
  RUN_TEST(test_where_wheel_speeds_are_noisy_slopes_are_of_the_smoothed_slip);
  return UNITY_END();
}
