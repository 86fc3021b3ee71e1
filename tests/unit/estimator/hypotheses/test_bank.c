/* tests/unit/estimator/hypotheses/test_bank.c <-> src/estimator/hypotheses/bank.c. The source is included: merging has no other door. */
#include "estimator/hypotheses/bank.c"

#include "unit_support.h"
#include "hypotheses_support.h"

static tse_bank b;
static uint32_t seed = 61;

static tse_config settings(void)
{
  tse_config c;
  tse_config_default(&c);
  c.hypotheses = TSE_HYPOTHESES;
  return c;
}

static void bank_of(const tse_params *p, int n)
{
  double P[JOINT][JOINT];
  memset(&b, 0, sizeof b);
  b.count = n;
  b.seen = real(100);
  b.h[0] = some_hypothesis(p, &seed, 1, P);
  for (int i = 1; i < n; i++) b.h[i] = b.h[0];
}

/* ------------------------------------------------------------------------------------------------ merging */

static void test_merging_keeps_weight_mean_and_covariance(void)
{
  const tse_config c = settings();
  const tse_params p = prepared(&c);
  for (int k = 0; k < 50; k++) {
    double P[JOINT][JOINT], mean[TSE_X], cov;
    tse_hypothesis g = some_hypothesis(&p, &seed, 1, P), h = some_hypothesis(&p, &seed, 1, P);
    g.log_weight = real(next_between(&seed, -3, 0));
    h.log_weight = real(next_between(&seed, -8, 0));
    const tse_hypothesis was = g;
    const double wg = exp2(number(g.log_weight)), wh = exp2(number(h.log_weight)), total = wg + wh;
    merge(&g, &h);
    expect_near(total, exp2(number(g.log_weight)), BY_FORMAT(1e-12, 1e-6), "weight", 0);
    for (int i = 0; i < TSE_X; i++) {
      mean[i] = (wg * number(was.x[i]) + wh * number(h.x[i])) / total;
      expect_near(mean[i], number(g.x[i]), BY_FORMAT(1e-12, 1e-5), "mean", i);
    }
    for (int i = 0; i < TSE_X; i++)
      for (int j = 0; j < TSE_X; j++) { /* second moments about zero add up */
        cov = (wg * (number(was.cov[i][j]) + number(was.x[i]) * number(was.x[j])) + wh * (number(h.cov[i][j]) + number(h.x[i]) * number(h.x[j]))) / total;
        cov -= mean[i] * mean[j];
        expect_near(cov, number(g.cov[i][j]), BY_FORMAT(1e-10, 1e-4) * (1 + fabs(cov)), "covariance", 100 * i + j);
      }
  }
}

static void test_what_differs_in_regime_or_in_stiffness_is_not_one(void)
{
  const tse_config c = settings();
  const tse_params p = prepared(&c);
  bank_of(&p, 1);
  const tse_hypothesis g = b.h[0];
  tse_hypothesis h = g;
  TEST_ASSERT_TRUE(are_one(&g, &h));
  for (int what = 0; what < 6; what++) {
    h = g;
    if (what == 0) h.drift++;
    if (what == 1) h.fault++;
    if (what == 2) h.held++;
    if (what > 2) h.level[what - 3]++;
    TEST_ASSERT_TRUE(!are_one(&g, &h));
  }
  for (int a = 3; a < 6; a++) {
    const double sd = sqrt(2 * number(MERGE_DISTANCE) * number(g.cov[a][a]));
    h = g;
    h.x[a] = real(number(g.x[a]) + 0.98 * sd);
    TEST_ASSERT_TRUE(are_one(&g, &h) && are_one(&h, &g));
    h.x[a] = real(number(g.x[a]) + 1.02 * sd);
    TEST_ASSERT_TRUE(!are_one(&g, &h) && !are_one(&h, &g));
    h = g;
    h.cov[a][a] = real(1.02 * number(MERGE_RATIO) * number(g.cov[a][a]));
    TEST_ASSERT_TRUE(!are_one(&g, &h) && !are_one(&h, &g));
  }
}

static void test_a_row_merges_one_pair_and_the_total_weight_stays(void)
{
  const tse_config c = settings();
  const tse_params p = prepared(&c);
  bank_of(&p, 5);
  b.likeliest = 2;
  double before = 0, after = 0;
  for (int i = 0; i < 5; i++) {
    b.h[i].log_weight = real(i == 2 ? 0 : -3 - i);
    b.h[i].age = real(5);
    before += exp2(number(b.h[i].log_weight));
  }
  for (int n = 4; n >= 1; n--) {
    merge_pair(&b);
    TEST_ASSERT_EQUAL_INT32(n, b.count);
    TEST_ASSERT_TRUE(b.likeliest < b.count);
    for (int i = 0; i < n; i++) TEST_ASSERT_TRUE(number(b.h[i].log_weight) <= number(b.h[b.likeliest].log_weight));
  }
  for (int i = 0; i < b.count; i++) after += exp2(number(b.h[i].log_weight));
  expect_near(before, after, BY_FORMAT(1e-12, 1e-6), "weight", 0);
  merge_pair(&b);
  TEST_ASSERT_EQUAL_INT32(1, b.count);
}

static void test_a_birth_is_not_merged_before_it_could_show_anything(void)
{
  const tse_config c = settings();
  const tse_params p = prepared(&c);
  bank_of(&p, 2);
  b.h[0].age = real(10);
  b.h[1].kind = KIND_REAR;
  b.h[1].age = real(number(PROTECTED_TIME) - 0.01);
  merge_pair(&b);
  TEST_ASSERT_EQUAL_INT32(2, b.count);
  b.h[1].age = real(number(PROTECTED_TIME) + 0.01);
  merge_pair(&b);
  TEST_ASSERT_EQUAL_INT32(1, b.count);
}

/* -------------------------------------------------------------------------------------------- a row */

/* One history alone: the evidence is its log density, here by elimination and the gamma function. */
static void test_the_evidence_of_a_row_is_the_density_of_the_sample_in_si_units(void)
{
  const tse_config c = settings();
  const tse_params p = prepared(&c);
  for (int mask = 1; mask < 8; mask++) {
    bank_of(&p, TSE_HYPOTHESES);
    for (int i = 1; i < TSE_HYPOTHESES; i++) b.h[i].log_weight = real(-60); /* no birth of weight comes among these */
    b.seen = real(1e5);
    sample y = some_sample(&seed, &b.h[0], 0, mask);
    static const tse_real raw[6] = { 0, 0, 0, 0, 0, 0 };
    innovation o;
    innovate(&p, &b.h[0], &y, &o);
    for (int a = 0; a < 3; a++) y.y[a] = real(number(y.use[a]) * (next_between(&seed, -4, 4) - number(o.e[a]))); /* no birth is much likelier */
    innovate(&p, &b.h[0], &y, &o);
    double s[9], dense[3][3], x[3], m2 = 0, sigma = 0;
    for (int k = 0; k < 9; k++) dense[k / 3][k % 3] = s[k] = number(o.s[k / 3][k % 3]);
    for (int a = 0; a < 3; a++) x[a] = number(o.e[a]);
    dense_solve(3, s, x, 1);
    for (int a = 0; a < 3; a++) {
      m2 += number(o.e[a]) * x[a];
      sigma += number(y.use[a]) * log(number(p.sd[a]));
    }
    const double n = y.used;
    const double expected = lgamma((8 + n) / 2) - lgamma(4) - 0.5 * n * log(8 * 3.14159265358979323846) - 0.5 * log(det3(dense)) -
                            0.5 * (8 + n) * log(1 + m2 / 8) - sigma;
    expect_near(expected, log(2) * number(bank_learn(&p, &b, &y, raw)), 0.003, "evidence", mask);
  }
}

/* A drift and a fault are worth less with every second that they last, by the rate at which they end. */
static void test_what_lasts_pays_for_it(void)
{
  static const double dts[] = { 0.001, 0.1, 1 };
  tse_config c = settings();
  c.hypotheses = 4;
  c.inputs_held = 0;
  const tse_params p = prepared(&c);
  const double pays[4] = { 0, number(RATE_STEADY_SLOW), number(RATE_STEADY), number(RATE_STEADY) + number(RATE_FAULT_END) };
  for (int k = 0; k < ROWS(dts); k++) {
    const tse_real raw[6] = { real(0.01), real(60), real(60), real(0.1), real(0.2), real(0.01) };
    bank_of(&p, 4);
    sample y = some_sample(&seed, &b.h[0], 1, 0); /* nothing is sensed: weights change for no other reason */
    y.dt = real(dts[k]);
    for (int i = 1; i < 4; i++) {
      b.h[i].drift = i == 1 ? DRIFTS_SLOWLY : DRIFTS_FAST;
      b.h[i].log_weight = real(-0.5 * i);
      b.h[i].age = real(0.01);
      b.h[i].promise = real(100);
    }
    b.h[3].fault = FAULT_STEER;
    (void)bank_learn(&p, &b, &y, raw);
    TEST_ASSERT_EQUAL_INT(4, b.count);
    for (int i = 1; i < 4; i++) expect_near(-0.5 * i - pays[i] * dts[k] / log(2), number(b.h[i].log_weight), BY_FORMAT(1e-9, 1e-5), "weight", i);
  }
}

static void test_weights_are_relative_to_the_largest_and_nonsense_weighs_nothing(void)
{
  const tse_config c = settings();
  const tse_params p = prepared(&c);
  bank_of(&p, 4);
  b.h[0].log_weight = real(-5);
  b.h[1].log_weight = real(-2);
  b.h[2].log_weight = real(3);
  b.h[2].x[0] = broken(); /* is not proper */
  b.h[3].log_weight = broken();
  const double sum = number(normalise(&b));
  TEST_ASSERT_EQUAL_INT32(1, b.likeliest);
  expect_near(-2 + log2(1 + 0.125), sum, BY_FORMAT(1e-9, 1e-5), "log2 of the sum", 0);
  expect_near(-3, number(b.h[0].log_weight), 0, "weight", 0);
  expect_near(0, number(b.h[1].log_weight), 0, "weight", 1);
  expect_near(-80, number(b.h[2].log_weight), 0, "weight", 2);
  expect_near(-80, number(b.h[3].log_weight), 0, "weight", 3);
}

/* 2^-80 times what is no number is none either. */
static void test_a_hypothesis_that_is_no_longer_made_of_numbers_goes(void)
{
  const tse_config c = settings();
  const tse_params p = prepared(&c);
  static const tse_real raw[6] = { 0, 0, 0, 0, 0, 0 };
  for (int bad = 1; bad < TSE_HYPOTHESES; bad++) {
    bank_of(&p, TSE_HYPOTHESES);
    const sample y = some_sample(&seed, &b.h[0], 3, 7);
    for (int i = 1; i < TSE_HYPOTHESES; i++) b.h[i].log_weight = real(-2);
    b.h[bad].x[4] = b.h[bad].cov[4][4] = broken();
    (void)bank_learn(&p, &b, &y, raw);
    TEST_ASSERT_TRUE(b.count > 1 && b.likeliest < b.count);
    for (int i = 0; i < b.count; i++) TEST_ASSERT_TRUE(is_proper(&b.h[i]));
  }
}

/* Nothing that makes sense is left: all begins again, says so, and is made of numbers. */
static void test_when_nothing_makes_sense_all_starts_over(void)
{
  const tse_config c = settings();
  const tse_params p = prepared(&c);
  static const tse_real raw[6] = { 0, 0, 0, 0, 0, 0 };
  bank_of(&p, 3);
  const sample y = some_sample(&seed, &b.h[0], 3, 7);
  for (int i = 0; i < 3; i++) b.h[i].x[7] = b.h[i].cov[7][7] = broken(); /* of a bias, which nothing bounds */
  TEST_ASSERT_TRUE(isfinite(number(bank_learn(&p, &b, &y, raw))));
  TEST_ASSERT_TRUE(b.count >= 1 && b.likeliest == 0);
  for (int i = 0; i < b.count; i++) {
    TEST_ASSERT_TRUE(is_proper(&b.h[i]));
    TEST_ASSERT_EQUAL_INT32(TSE_CHANGE_RESTART, b.h[i].change_kind);
    for (int a = 0; a < 3; a++) {
      expect_near(1, number(b.h[i].x[3 + a]), 0, "stiffness", a);
      TEST_ASSERT_TRUE(number(b.h[i].before[a]) > 0); /* else what it is put in relation to is nothing */
    }
  }
}

/* Rows that teach nothing may still lose the states. */
static void test_lost_states_are_placed_anew_and_the_stiffness_stays(void)
{
  const tse_config c = settings();
  const tse_params p = prepared(&c);
  bank_of(&p, 3);
  const sample y = some_sample(&seed, &b.h[0], 3, 7);
  const tse_bank was = b;
  bank_mend(&p, &b, &y);
  TEST_ASSERT_EQUAL_MEMORY(&was, &b, sizeof b); /* nothing is lost */
  b.likeliest = 1;
  b.h[1].cov[0][0] = b.h[2].cov[1][1] = real(1e6);
  const tse_hypothesis lost = b.h[1];
  bank_mend(&p, &b, &y);
  TEST_ASSERT_EQUAL_INT32(2, b.count);
  TEST_ASSERT_TRUE(is_proper(&b.h[b.likeliest]));
  TEST_ASSERT_EQUAL_MEMORY(&lost.x[3], &b.h[b.likeliest].x[3], (TSE_X - 3) * sizeof lost.x[0]);
  for (int a = 3; a < TSE_X; a++) TEST_ASSERT_EQUAL_MEMORY(&lost.cov[a][3], &b.h[b.likeliest].cov[a][3], (TSE_X - 3) * sizeof lost.x[0]);
  TEST_ASSERT_EQUAL_INT32(lost.change_kind, b.h[b.likeliest].change_kind);
}

/* It was not the states: then nothing of it can be gone on with. */
static void test_what_is_no_number_beside_the_states_starts_over_on_any_row(void)
{
  const tse_config c = settings();
  const tse_params p = prepared(&c);
  const tse_real none = broken();
  const int places[] = { 3, 5, 6, 11, TSE_X - 1 };
  for (int k = 0; k < ROWS(places); k++)
    for (int of_cov = 0; of_cov < 2; of_cov++) {
      bank_of(&p, 3);
      const sample y = some_sample(&seed, &b.h[0], 3, 7);
      b.likeliest = 2;
      if (of_cov) b.h[2].cov[places[k]][places[k]] = none;
      else b.h[2].x[places[k]] = none;
      bank_mend(&p, &b, &y);
      TEST_ASSERT_TRUE(b.count > 0);
      for (int32_t i = 0; i < b.count; i++) {
        TEST_ASSERT_TRUE(is_proper(&b.h[i]));
        TEST_ASSERT_EQUAL_INT32(TSE_CHANGE_RESTART, b.h[i].change_kind);
        for (int a = 0; a < 3; a++) expect_near(number(b.h[i].x[3 + a]), number(b.h[i].before[a]), 0, "before", a);
      }
    }
}

static void test_a_start_doubts_the_noise_and_how_steering_goes_between_rows(void)
{
  tse_config c = settings();
  tse_start s;
  for (int held = 0; held <= 2; held++)
    for (int n = 2; n <= TSE_HYPOTHESES; n++) {
      int at_told = 0, louder = 0, quieter = 0, holds = 0;
      c.inputs_held = held;
      c.hypotheses = n;
      const tse_params p = prepared(&c);
      bank_of(&p, 1);
      const sample y = some_sample(&seed, &b.h[0], 1, 7);
      start_of_settings(&p, &s);
      bank_start(&p, &b, &s, &y);
      const int expected = held == 2 ? 6 : 3;
      TEST_ASSERT_EQUAL_INT32(n < expected ? n : expected, b.count);
      for (int i = 0; i < b.count; i++) {
        const double noise = number(b.h[i].noise_var[1]);
        at_told += fabs(noise - 1) < 1e-6;
        louder += noise > 1.1;
        quieter += noise < 0.9;
        holds += b.h[i].held;
        if (held < 2) TEST_ASSERT_EQUAL_INT32(held, b.h[i].held);
        TEST_ASSERT_TRUE(i == 0 ? fabs(number(b.h[i].log_weight)) <= 0 : number(b.h[i].log_weight) < 0);
      }
      if (n < expected) continue;
      TEST_ASSERT_TRUE(louder == quieter && louder == at_told);
      TEST_ASSERT_EQUAL_INT(held == 0 ? 0 : 3, holds);
    }
  c.noise_max = setting(1); /* believed */
  c.inputs_held = 0;
  const tse_params p = prepared(&c);
  const sample y = some_sample(&seed, &b.h[0], 1, 7);
  start_of_settings(&p, &s);
  bank_start(&p, &b, &s, &y);
  TEST_ASSERT_EQUAL_INT32(1, b.count);
}

/* At rest the gyro reads its bias: a scalar Kalman filter, and what goes with the bias follows. */
static void test_at_rest_the_gyro_shows_its_bias(void)
{
  const tse_config c = settings();
  const tse_params p = prepared(&c);
  const int k = X_BIAS + 2;
  bank_of(&p, 2);
  sample y = some_sample(&seed, &b.h[0], 1, 7);
  y.y[2] = real(1.7);
  const tse_hypothesis was = b.h[0];
  bank_still(&b, &y);
  const double var = number(was.cov[k][k]), gain = var / (var + 1);
  for (int i = 0; i < 2; i++) {
    expect_near(number(was.x[k]) + gain * (1.7 - number(was.x[k])), number(b.h[i].x[k]), BY_FORMAT(1e-12, 1e-6), "bias", i);
    expect_near(1 / (1 / var + 1), number(b.h[i].cov[k][k]), BY_FORMAT(1e-12, 1e-6), "variance", i);
    for (int j = 0; j < TSE_X; j++)
      if (j != k) expect_near((1 - gain) * number(was.cov[k][j]), number(b.h[i].cov[j][k]), BY_FORMAT(1e-12, 1e-6), "covariance", j);
  }
  const tse_hypothesis once = b.h[0];
  y.use[2] = real(0);
  bank_still(&b, &y); /* no gyro: nothing new */
  for (int j = 0; j < TSE_X; j++) expect_near(number(once.cov[k][j]), number(b.h[0].cov[k][j]), 0, "covariance", j);
  expect_near(number(once.x[k]), number(b.h[0].x[k]), 0, "bias", 9);
}

int main(void)
{
  UNITY_BEGIN();
  RUN_TEST(test_merging_keeps_weight_mean_and_covariance);
  RUN_TEST(test_what_differs_in_regime_or_in_stiffness_is_not_one);
  RUN_TEST(test_a_row_merges_one_pair_and_the_total_weight_stays);
  RUN_TEST(test_a_birth_is_not_merged_before_it_could_show_anything);
  RUN_TEST(test_the_evidence_of_a_row_is_the_density_of_the_sample_in_si_units);
  RUN_TEST(test_what_lasts_pays_for_it);
  RUN_TEST(test_weights_are_relative_to_the_largest_and_nonsense_weighs_nothing);
  RUN_TEST(test_a_hypothesis_that_is_no_longer_made_of_numbers_goes);
  RUN_TEST(test_when_nothing_makes_sense_all_starts_over);
  RUN_TEST(test_lost_states_are_placed_anew_and_the_stiffness_stays);
  RUN_TEST(test_what_is_no_number_beside_the_states_starts_over_on_any_row);
  RUN_TEST(test_a_start_doubts_the_noise_and_how_steering_goes_between_rows);
  RUN_TEST(test_at_rest_the_gyro_shows_its_bias);
  return UNITY_END();
}
