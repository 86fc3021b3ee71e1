/* tests/unit/estimator/hypotheses/test_repeats.c <-> src/estimator/hypotheses/repeats.c: prices against determinants, counts against
 * the share of repeats in the readings made up here. */
#include "estimator/hypotheses/repeats.h"

#include "unit_support.h"
#include "hypotheses_support.h"

static const int32_t all_there[6] = { 1, 1, 1, 1, 1, 1 };
static tse_repeats r;

static void read_all(double value, const int32_t there[6])
{
  tse_real now[6];
  for (int c = 0; c < 6; c++) now[c] = real(value);
  watch_repeats(&r, now, there);
}

static void test_readings_that_differ_are_no_evidence(void)
{
  memset(&r, 0, sizeof r);
  for (int i = 1; i < 500; i++) {
    read_all(0.001 * i, all_there);
    for (int c = 0; c < 6; c++) expect_near(0, number(r.evidence[c]), 0, "evidence", c);
  }
}

/* The first repeat after n new values: as unusual as one in n + REPEAT_PRIOR. */
static void test_a_first_repeat_is_the_more_telling_the_more_readings_differed(void)
{
  for (int n = 1; n < 900; n *= 3) {
    memset(&r, 0, sizeof r);
    for (int i = 1; i <= n; i++) read_all(0.001 * i, all_there);
    read_all(0.001 * n, all_there);
    for (int c = 0; c < 6; c++) expect_near(log2(n + number(REPEAT_PRIOR)), number(r.evidence[c]), BY_FORMAT(1e-9, 1e-4), "evidence", c);
  }
}

/* Coarse steps: a share of the readings repeats, and soon that is as usual as it is. */
static void test_a_coarse_channel_repeats_itself_and_that_is_learnt(void)
{
  uint32_t seed = 41;
  double value = 0, last[2] = { 0, 0 };
  memset(&r, 0, sizeof r);
  for (int i = 0; i < 20000; i++) {
    const int before = r.run[0] > 0;
    value = next_uniform(&seed) < (before ? 0.6 : 0.4) ? value : value + 1;
    read_all(value, all_there);
    if (number(r.evidence[0]) > 0) last[before] = number(r.evidence[0]);
  }
  expect_near(-log2(0.4), last[0], 0.35, "after a new value", 0);
  expect_near(-log2(0.6), last[1], 0.35, "within a run", 0);
  for (int k = 0; k < 2; k++) TEST_ASSERT_TRUE(number(r.rows[0][k]) <= number(REPEAT_ROWS) + 21);
}

/* A value that stays is evidence at every row, and no longer run makes it usual before it has ended. */
static void test_a_stuck_channel_goes_on_being_evidence(void)
{
  memset(&r, 0, sizeof r);
  for (int i = 1; i <= 300; i++) read_all(0.001 * i, all_there);
  for (int i = 0; i < 1000; i++) {
    read_all(0.3, all_there);
    for (int c = 0; c < 6; c++) TEST_ASSERT_TRUE(number(r.evidence[c]) > log2(number(REPEAT_PRIOR)) - 0.01);
    TEST_ASSERT_TRUE(r.run[0] <= 20);
  }
  read_all(7, all_there);
  expect_near(0, number(r.evidence[0]), 0, "evidence", 0);
  TEST_ASSERT_TRUE(number(r.repeats[0][1]) <= 20.001); /* the run counts, but not for ever */
}

static void test_what_is_missing_or_may_rest_is_no_repeat(void)
{
  static const int32_t none[6] = { 0, 0, 0, 0, 0, 0 };
  memset(&r, 0, sizeof r);
  for (int i = 0; i < 50; i++) {
    read_all(1.5, none);
    for (int c = 0; c < 6; c++) expect_near(0, number(r.evidence[c]), 0, "evidence", c);
  }
  for (int i = 0; i < 50; i++) {
    read_all(NAN, all_there);
    for (int c = 0; c < 6; c++) {
      expect_near(0, number(r.evidence[c]), 0, "evidence", c);
      TEST_ASSERT_TRUE(isfinite(number(r.last[c])));
    }
  }
}

/* The price: half the log2 of how much larger the determinant of S is for what the hypothesis leaves open. */
static void test_a_hypothesis_of_a_fault_gets_back_what_it_paid_and_the_evidence_of_the_repeat(void)
{
  tse_config c;
  tse_config_default(&c);
  const tse_params p = prepared(&c);
  uint32_t seed = 42;
  double P[JOINT][JOINT];
  for (int fault = 0; fault <= 6; fault++) {
    tse_hypothesis h = some_hypothesis(&p, &seed, 1, P);
    sample y = some_sample(&seed, &h, 5, 7);
    innovation o, tight;
    h.fault = fault;
    innovate(&p, &h, &y, &o);
    for (int k = 0; k < 6; k++) r.evidence[k] = real(6.5);
    if (fault == 0) {
      expect_near(0, number(evidence_of_repeat(&r, &h, &o)), 0, "without a fault", 0);
      continue;
    }
    tight = o;
    double s[3][3], without[3][3];
    for (int i = 0; i < 3; i++)
      for (int j = 0; j < 3; j++) {
        s[i][j] = without[i][j] = number(o.s[i][j]);
        if (fault < FAULT_MEASURED) {
          const int a = fault == FAULT_STEER ? TSE_CY_FRONT : TSE_CX_FRONT;
          without[i][j] -= number(tight.eps_var[a]) * number(o.d[i][a]) * number(o.d[j][a]);
        } else if (i == j && i == fault - FAULT_MEASURED) without[i][j] -= number(o.noise[i]) * (1 - 1 / number(FAULT_NOISE));
      }
    const double price = 0.5 * log2(det3(s) / det3(without));
    TEST_ASSERT_TRUE(price > 1);
    const double cap = -0.5 * log2(1e-5);
    expect_near(6.5 - 0.72 + fmin(price, cap), number(evidence_of_repeat(&r, &h, &o)), BY_FORMAT(1e-6, 0.3), "evidence", fault);
    r.evidence[fault - 1] = real(0);
    expect_near(0, number(evidence_of_repeat(&r, &h, &o)), 0, "not repeated", fault);
  }
}

/* What a birth is promised is what the child gets. */
static void test_the_promise_to_a_birth_is_kept(void)
{
  tse_config c;
  tse_config_default(&c);
  const tse_params p = prepared(&c);
  uint32_t seed = 43;
  double P[JOINT][JOINT];
  for (int a = 0; a < 3; a++) {
    tse_hypothesis h = some_hypothesis(&p, &seed, 1, P), child = h;
    const sample y = some_sample(&seed, &h, 5, 7);
    innovation o, own;
    tse_real v[3] = { real(0), real(0), real(0) };
    for (int k = 0; k < 6; k++) r.evidence[k] = real(4);
    v[a] = real(1);
    child.fault = FAULT_MEASURED + a;
    innovate(&p, &h, &y, &o);
    innovate(&p, &child, &y, &own);
    const double promise = number(promise_of_repeat(&r, &o, v, real(number(FAULT_NOISE) * number(h.noise_var[a])), 3 + a));
    expect_near(number(evidence_of_repeat(&r, &child, &own)), promise, 0.01, "promise", a);
  }
}

int main(void)
{
  UNITY_BEGIN();
  RUN_TEST(test_readings_that_differ_are_no_evidence);
  RUN_TEST(test_a_first_repeat_is_the_more_telling_the_more_readings_differed);
  RUN_TEST(test_a_coarse_channel_repeats_itself_and_that_is_learnt);
  RUN_TEST(test_a_stuck_channel_goes_on_being_evidence);
  RUN_TEST(test_what_is_missing_or_may_rest_is_no_repeat);
  RUN_TEST(test_a_hypothesis_of_a_fault_gets_back_what_it_paid_and_the_evidence_of_the_repeat);
  RUN_TEST(test_the_promise_to_a_birth_is_kept);
  return UNITY_END();
}
