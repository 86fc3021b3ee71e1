/* tests/unit/estimator/hypotheses/test_report.c <-> src/estimator/hypotheses/report.c: moments of the mixture by brute force. */
#include "estimator/hypotheses/report.h"

#include "unit_support.h"
#include "hypotheses_support.h"

static tse_bank b;

static double model; /* model_sd */

static tse_params bank_of_five(void)
{
  tse_config c;
  tse_config_default(&c);
  c.model_sd = setting(model);
  const tse_params p = prepared(&c);
  uint32_t seed = 71;
  double P[JOINT][JOINT];
  memset(&b, 0, sizeof b);
  b.count = 5;
  b.likeliest = 3;
  for (int i = 0; i < 5; i++) {
    b.h[i] = some_hypothesis(&p, &seed, 1, P);
    b.h[i].log_weight = real(i == 3 ? 0 : -1 - i);
    for (int a = 0; a < 3; a++) b.h[i].level[a] = i == 1 ? a : 0;
  }
  return p;
}

static double weight(int i)
{
  double sum = 0;
  for (int k = 0; k < b.count; k++) sum += exp2(number(b.h[k].log_weight));
  return exp2(number(b.h[i].log_weight)) / sum;
}

static double mixed(int at, double *sd, int of)
{
  double first = 0, second = 0;
  for (int i = 0; i < b.count; i++) {
    const double x = number(b.h[i].x[at]);
    const int lateral = b.h[i].level[1] > b.h[i].level[2] ? b.h[i].level[1] : b.h[i].level[2];
    const int level = of == TSE_CX_FRONT ? b.h[i].level[0] : lateral;
    const double doubt = of < 0 || level == 0 ? 0 : x * number(model > 0 ? DISTURBANCE_DOUBT : DISTURBANCE_SHARE) * pow(3, level - 1);
    first += weight(i) * x;
    second += weight(i) * (x * x + number(b.h[i].cov[at][at]) + doubt * doubt);
  }
  *sd = sqrt(second - first * first + (of < 0 ? 0 : pow(first * model, 2)));
  return first;
}

/* Relative: of the model, and of each history's levels. */
static double doubt_of_the_rear(void)
{
  double var = model * model;
  for (int i = 0; i < b.count; i++) {
    const int lateral = b.h[i].level[1] > b.h[i].level[2] ? b.h[i].level[1] : b.h[i].level[2];
    if (lateral) var += weight(i) * pow(number(model > 0 ? DISTURBANCE_DOUBT : DISTURBANCE_SHARE) * pow(3, lateral - 1), 2);
  }
  return sqrt(var);
}

/* Of an exact model, and of one that leaves something out. */
static void expect_moments(void)
{
  const tse_params p = bank_of_five();
  tse_output y;
  double sd, squares = 0;
  memset(&y, 0, sizeof y);
  bank_report(&p, &b, &y);
  const double got[6] = { number(y.vel_x), number(y.vel_y), number(y.yaw_rate), number(y.stiffness[0]), number(y.stiffness[1]), number(y.stiffness[2]) };
  const double got_sd[6] = { number(y.vel_x_sd), number(y.vel_y_sd), number(y.yaw_rate_sd), number(y.stiffness_sd[0]), number(y.stiffness_sd[1]), number(y.stiffness_sd[2]) };
  for (int k = 0; k < 6; k++) {
    expect_near(mixed(k, &sd, k - 3), got[k], BY_FORMAT(1e-12, 1e-5), "mean", k);
    if (k == 1) sd = hypot(sd, (number(p.lr) * got[2] - got[1]) * doubt_of_the_rear()); /* what the rear axle slips by, and its doubt */
    expect_near(sd, got_sd[k], BY_FORMAT(1e-9, 1e-4), "sd", k);
  }
  for (int a = 0; a < 3; a++) {
    expect_near(number(p.sd[a]) * mixed(6 + a, &sd, -1), number(y.bias[a]), BY_FORMAT(1e-12, 1e-6), "bias", a);
    expect_near(number(p.sd[a]) * sd, number(y.bias_sd[a]), BY_FORMAT(1e-9, 1e-5), "sd of the bias", a);
    expect_near(sqrt(number(b.h[3].noise_var[a])), number(y.noise[a]), BY_FORMAT(1e-12, 1e-6), "noise", a);
    expect_near(sqrt(number(b.h[3].spread_var[a])) * number(y.stiffness[a]), number(y.stiffness_spread[a]), BY_FORMAT(1e-12, 1e-6), "spread", a);
  }
  for (int i = 0; i < 5; i++) squares += weight(i) * weight(i);
  expect_near(1 / squares, number(y.n_eff), BY_FORMAT(1e-9, 1e-5), "n_eff", 0);
  expect_near(atan2(number(y.vel_y), number(y.vel_x)), number(y.sideslip), BY_FORMAT(1e-9, 1e-6), "sideslip", 0);
}

static void test_estimates_are_moments_of_the_mixture(void)
{
  for (int told = 0; told < 2; told++) {
    model = 0.03 * told;
    expect_moments();
  }
  model = 0;
}

/* A fault hides what else is so; a slide, a change; a change is one for so long; a drift what is steady. */
static void test_each_history_is_in_one_regime_and_their_probabilities_add_up(void)
{
  const tse_params p = bank_of_five();
  tse_output y;
  memset(&y, 0, sizeof y);
  b.h[0].fault = 4;
  b.h[0].slides = 1;
  b.h[1].slides = 1;
  b.h[1].change_kind = TSE_CHANGE_ROAD;
  b.h[2].change_kind = TSE_CHANGE_REAR;
  b.h[2].drift = 2;
  b.h[2].change_age = real(number(RECENT_TIME) - 0.01);
  b.h[4].change_kind = TSE_CHANGE_ROAD;
  b.h[4].change_age = real(number(RECENT_TIME) + 0.01);
  b.h[4].drift = 1;
  bank_report(&p, &b, &y);
  static const int regime_of[5] = { TSE_REGIME_FAULT, TSE_REGIME_SLIDING, TSE_REGIME_AXLE, TSE_REGIME_STEADY, TSE_REGIME_DRIFTING };
  double sum = 0;
  for (int i = 0; i < 5; i++) expect_near(weight(i), number(y.regime[regime_of[i]]), BY_FORMAT(1e-12, 1e-6), "probability", i);
  for (int k = 0; k < TSE_REGIMES; k++) sum += number(y.regime[k]);
  expect_near(1, sum, BY_FORMAT(1e-12, 1e-6), "sum", 0);
  TEST_ASSERT_EQUAL_INT32(0, y.fault_channel); /* not likelier than not */
  TEST_ASSERT_EQUAL_INT32(TSE_CHANGE_NONE, y.change_kind);
  b.h[3].fault = 4;
  b.h[4].change_kind = TSE_CHANGE_RESTART;
  b.h[4].change_age = real(0);
  bank_report(&p, &b, &y);
  TEST_ASSERT_EQUAL_INT32(4, y.fault_channel);
  expect_near(weight(0) + weight(3), number(y.regime[TSE_REGIME_FAULT]), BY_FORMAT(1e-12, 1e-6), "fault", 0);
  expect_near(weight(4), number(y.regime[TSE_REGIME_RESTARTED]), BY_FORMAT(1e-12, 1e-6), "restarted", 0);
}

static void test_a_change_has_an_age_a_ratio_and_the_probability_of_all_who_speak_of_it(void)
{
  const tse_params p = bank_of_five();
  tse_output y;
  memset(&y, 0, sizeof y);
  bank_report(&p, &b, &y);
  for (int a = 0; a < 3; a++) expect_near(1, number(y.change_ratio[a]), 0, "ratio without a change", a);
  expect_near(0, number(y.change_probability), 0, "probability", 0);
  for (int i = 0; i < 5; i++) {
    b.h[i].change_kind = i == 0 ? TSE_CHANGE_REAR : TSE_CHANGE_ROAD;
    b.h[i].change_age = real(i == 1 ? 7 + number(SAME_CHANGE_TIME) + 0.01 : i == 2 ? 7 + number(SAME_CHANGE_TIME) - 0.01 : 7);
    for (int a = 0; a < 3; a++) b.h[i].before[a] = real(2 + a);
  }
  bank_report(&p, &b, &y);
  expect_near(7, number(y.change_age), 0, "age", 0);
  TEST_ASSERT_EQUAL_INT32(TSE_CHANGE_ROAD, y.change_kind);
  expect_near(weight(2) + weight(3) + weight(4), number(y.change_probability), BY_FORMAT(1e-12, 1e-6), "probability", 1);
  for (int a = 0; a < 3; a++) expect_near(number(b.h[3].x[3 + a]) / (2 + a), number(y.change_ratio[a]), BY_FORMAT(1e-12, 1e-6), "ratio", a);
}

static void test_at_rest_there_is_no_sideslip(void)
{
  const tse_params p = bank_of_five();
  tse_output y;
  memset(&y, 0, sizeof y);
  for (int i = 0; i < 5; i++) b.h[i].x[0] = b.h[i].x[1] = real(-0.009);
  bank_report(&p, &b, &y);
  expect_near(0, number(y.sideslip), 0, "sideslip", 0);
}

int main(void)
{
  UNITY_BEGIN();
  RUN_TEST(test_estimates_are_moments_of_the_mixture);
  RUN_TEST(test_each_history_is_in_one_regime_and_their_probabilities_add_up);
  RUN_TEST(test_a_change_has_an_age_a_ratio_and_the_probability_of_all_who_speak_of_it);
  RUN_TEST(test_at_rest_there_is_no_sideslip);
  return UNITY_END();
}
