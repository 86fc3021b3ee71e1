/* tests/unit/filter/test_ud.c <-> src/filter/ud.c: all operations on U D U', compared
 * with a dense matrix in double.
 *
 * Tolerances: matrices have elements of some tens, sums of 23 products. Rounding is 6e-8
 * of them in float. In fixed point it is 2.3e-10 per product, amplified by divisions by
 * the smallest D. */
#include "filter_support.h"

#define CLOSE BY_NUMBER(1e-11, 2e-4, 2e-6)

static const dense none;

static void test_a_diagonal_is_its_variances(void)
{
  tse_ud p;
  tse_real variance[STATES];
  uint32_t seed = 1;
  dense expected = none;
  any_covariance(&p, &seed);
  for (int i = 0; i < STATES; i++) {
    variance[i] = real(0.25 * (i + 1));
    expected.p[i][i] = 0.25 * (i + 1);
  }
  variance[5] = TSE_R(0); /* known exactly: only rounding remains */
  expected.p[5][5] = 0;
  ud_set(&p, variance);
  expect_dense(&expected, &p, BY_NUMBER(2e-15, 2e-15, 16 * QUANTUM), "diagonal");
  TEST_ASSERT_TRUE(p.d[5] > TSE_R(0));
}

#if !defined(TSE_NO_VELOCITY)
/* A filter that had extra states and has none: it measures like one that never had any,
 * with any numbers in their places. */
static void test_a_diagonal_has_no_extra_states(void)
{
  tse_ud used, fresh;
  tse_real variance[STATES], more[TSE_EXTRAS], h[TSE_ALL], f[TSE_ALL], v[TSE_ALL];
  for (int i = 0; i < STATES; i++) variance[i] = real(0.25 * (i + 1));
  for (int e = 0; e < TSE_EXTRAS; e++) more[e] = TSE_R(3);
  for (int i = 0; i < TSE_ALL; i++) h[i] = TSE_R(1);
  memset(&used, 0, sizeof used);
  memset(&fresh, 0, sizeof fresh);
  ud_open(&used, more);
  ud_set(&used, variance);
  ud_set(&fresh, variance);
  const tse_real all = ud_measure(&used, h, f, v), plain = ud_measure(&fresh, h, f, v);
  TEST_ASSERT_EQUAL_INT(0, used.extras);
  TEST_ASSERT_EQUAL_MEMORY(&plain, &all, sizeof all);
  expect_near(0.25 * STATES * (STATES + 1) / 2, number(all), CLOSE * STATES, "sum of the variances", 0);
}
#endif

static void test_variances_and_covariances_are_those_of_the_matrix(void)
{
  uint32_t seed = 2;
  for (int n = 0; n < 20; n++) {
    tse_ud p;
    any_covariance(&p, &seed);
    const dense m = dense_of(&p);
    for (int i = 0; i < STATES; i++) {
      expect_near(m.p[i][i], number(ud_variance(&p, i)), CLOSE, "variance", i);
      for (int k = 0; k < STATES; k++)
        expect_near(m.p[i][k], number(ud_covariance(&p, i, k)), CLOSE, "covariance", 100 * i + k);
    }
  }
}

static void test_a_measurement_is_that_of_a_kalman_filter(void)
{
  uint32_t seed = 3;
  for (int n = 0; n < 200; n++) {
    tse_ud p;
    tse_real h[STATES], f[STATES], v[STATES], gain[STATES];
    double hp[STATES], s;
    any_covariance(&p, &seed);
    const dense m = dense_of(&p);
    const double r = next_between(&seed, 0.01, 4);
    /* most rows have few slopes */
    for (int i = 0; i < STATES; i++)
      h[i] = next_uniform(&seed) < 0.4 ? TSE_R(0) : real(next_between(&seed, -1, 1));
    s = r;
    for (int i = 0; i < STATES; i++) {
      hp[i] = 0;
      for (int k = 0; k < STATES; k++) hp[i] += m.p[i][k] * number(h[k]);
    }
    for (int i = 0; i < STATES; i++) s += number(h[i]) * hp[i];
    expect_near(s - r, number(ud_measure(&p, h, f, v)), CLOSE, "h' P h", n);
    ud_correct(&p, f, v, real(s - r), real(r), gain);
    dense after;
    for (int i = 0; i < STATES; i++) {
      expect_near(hp[i] / s, number(gain[i]), CLOSE, "gain", i);
      for (int k = 0; k < STATES; k++) after.p[i][k] = m.p[i][k] - hp[i] * hp[k] / s;
    }
    expect_dense(&after, &p, CLOSE, "after a measurement");
  }
}

static void test_a_measurement_of_nothing_changes_nothing(void)
{
  tse_ud p, before;
  tse_real h[STATES], f[STATES], v[STATES], gain[STATES];
  uint32_t seed = 4;
  any_covariance(&p, &seed);
  before = p;
  for (int i = 0; i < STATES; i++) h[i] = TSE_R(0);
  TEST_ASSERT_TRUE(!(ud_measure(&p, h, f, v) != TSE_R(0)));
  ud_correct(&p, f, v, TSE_R(0), TSE_R(1), gain);
  TEST_ASSERT_EQUAL_MEMORY(&before, &p, sizeof p);
  for (int i = 0; i < STATES; i++) TEST_ASSERT_TRUE(!(gain[i] != TSE_R(0)));
}

static void test_time_is_f_p_f_and_noise(void)
{
  uint32_t seed = 5;
  for (int n = 0; n < 100; n++) {
    tse_ud p;
    tse_short M[MOTION][PLACES];
    tse_real noise[MOTION];
    double F[STATES][STATES];
    any_covariance(&p, &seed);
    const dense m = dense_of(&p);
    for (int i = 0; i < STATES; i++)
      for (int k = 0; k < STATES; k++) F[i][k] = i == k;
    for (int i = 0; i < MOTION; i++) {
      noise[i] = real(next_between(&seed, 0, 0.1));
      for (int k = 0; k < COLUMNS; k++) M[i][k] = slope_of((i == k) * 0.9 + next_between(&seed, -0.3, 0.3));
      for (int k = 0; k < STATES; k++) F[i][k] = number_of_slope(M[i][k]);
    }
    dense after;
    conjugate(STATES, F[0], m.p[0], after.p[0]);
    for (int i = 0; i < MOTION; i++) after.p[i][i] += number(noise[i]);
    ud_move(&p, M, noise);
    expect_dense(&after, &p, BY_NUMBER(1e-11, 1e-3, 4e-6),
        "after a row"); /* fixed point: resolution of a row, 2^-22, of 23 columns with variance 2 */
  }
}

static void test_more_along_a_vector_is_rank_one(void)
{
  uint32_t seed = 6;
  for (int n = 0; n < 200; n++) {
    tse_ud p;
    tse_real a[STATES];
    any_covariance(&p, &seed);
    dense m = dense_of(&p);
    const double c = next_between(&seed, 0.01, 3);
    const int last = (int)(next_word(&seed) % STATES);
    for (int i = 0; i < STATES; i++)
      a[i] = i > last || next_uniform(&seed) < 0.3 ? TSE_R(0) : real(next_between(&seed, -1, 1));
    for (int i = 0; i < STATES; i++)
      for (int k = 0; k < STATES; k++) m.p[i][k] += c * number(a[i]) * number(a[k]);
    ud_add(&p, a, n % 2 ? last : STATES - 1, real(c));
    expect_dense(&m, &p, CLOSE, "rank one");
    const int at = (int)(next_word(&seed) % STATES);
    m.p[at][at] += c;
    ud_add_at(&p, at, real(c));
    expect_dense(&m, &p, CLOSE, "one state");
  }
}

static void test_a_state_fades_with_all_that_it_has_in_common(void)
{
  uint32_t seed = 7;
  for (int n = 0; n < 100; n++) {
    tse_ud p;
    any_covariance(&p, &seed);
    dense m = dense_of(&p);
    const double share = next_between(&seed, 0.3, 1);
    const int at = (int)(next_word(&seed) % STATES);
    for (int i = 0; i < STATES; i++) {
      m.p[at][i] *= share;
      m.p[i][at] *= share;
    }
    ud_fade(&p, at, real(share));
    expect_dense(&m, &p, CLOSE, "faded");
  }
}

/* A state that is known exactly has D at its lower limit, which does not decrease. Its
 * covariances still decay, row by row, and no element of U grows. */
static void test_a_fading_state_at_the_floor_leaves_u_small(void)
{
  tse_ud p;
  memset(&p, 0, sizeof p);
  for (int i = 0; i < STATES; i++) p.d[i] = TSE_R(1);
  const int at = STATES - 2;
#if defined(TSE_REAL_FIXED)
  return; /* there, elements of U saturate */
#endif
  p.d[at] = LEAST_D;
  for (int k = 0; k < at; k++) p.u[ud_column(at) + k] = short_of(0.5);
  p.u[ud_column(STATES - 1) + at] = short_of(0.5);
  for (int n = 0; n < 1000; n++) ud_fade(&p, at, real(0.9));
  TEST_ASSERT_TRUE(p.d[at] == LEAST_D);
  for (int k = 0; k < at; k++)
    TEST_ASSERT_TRUE(fabs(number_of(p.u[ud_column(at) + k])) < BY_NUMBER(1e-6, 1e-6, 1e-3));
  TEST_ASSERT_TRUE(fabs(number_of(p.u[ud_column(STATES - 1) + at])) < BY_NUMBER(1e-6, 1e-6, 1e-3));
}

static void test_states_that_start_anew_leave_the_others_as_they_are(void)
{
  uint32_t seed = 8;
  for (int count = 0; count <= STATES; count++) {
    tse_ud p;
    tse_real variance[STATES];
    any_covariance(&p, &seed);
    dense m = dense_of(&p);
    for (int i = 0; i < STATES; i++) variance[i] = real(next_between(&seed, 0.01, 3));
    for (int i = 0; i < count; i++)
      for (int k = 0; k < STATES; k++) m.p[i][k] = m.p[k][i] = i == k ? number(variance[i]) : 0;
    ud_forget(&p, variance, count);
    expect_dense(&m, &p, CLOSE, "forgotten");
  }
}

static void test_a_block_is_its_covariance(void)
{
  uint32_t seed = 9;
  for (int n = 0; n < 100; n++) {
    tse_ud p, q;
    tse_real variance[STATES], cov[TSE_KEPT][TSE_KEPT];
    dense expected = none;
    any_covariance(&q, &seed);
    const dense m = dense_of(&q);
    for (int i = 0; i < STATES; i++) {
      variance[i] = TSE_R(1);
      expected.p[i][i] = 1;
    }
    for (int i = 0; i < TSE_KEPT; i++)
      for (int k = 0; k < TSE_KEPT; k++) {
        cov[i][k] = real(m.p[i][k]);
        expected.p[FAST + i][FAST + k] = m.p[i][k];
      }
    ud_set(&p, variance);
    ud_set_block(&p, FAST, cov);
    expect_dense(&expected, &p, BY_NUMBER(1e-11, 1e-3, 2e-6),
        "block"); /* float: variances up to ten, condition number 100 */
  }
}

/* A hundred correlations that no covariance has, from any source. Variances are
 * unchanged, and D is positive. */
static void test_a_block_that_is_no_covariance_becomes_one_of_its_variances(void)
{
  uint32_t seed = 10;
  for (int n = 0; n < 100; n++) {
    tse_ud p;
    tse_real variance[STATES], cov[TSE_KEPT][TSE_KEPT];
    for (int i = 0; i < STATES; i++) variance[i] = TSE_R(1);
    for (int i = 0; i < TSE_KEPT; i++)
      for (int k = 0; k <= i; k++)
        cov[i][k] = cov[k][i] = i == k ? TSE_R(2) : real(next_uniform(&seed) < 0.5 ? -2 : 2);
    ud_set(&p, variance);
    ud_set_block(&p, FAST, cov);
    for (int i = 0; i < TSE_KEPT; i++) {
      TEST_ASSERT_TRUE(p.d[FAST + i] > TSE_R(0));
      expect_near(2, number(ud_variance(&p, FAST + i)), BY_NUMBER(1e-9, 1e-4, 1e-4), "variance", i);
    }
  }
}

/* One hour at 100 rows a second, with the rows of a drive and with very good and very bad
 * measurements. */
static void test_d_stays_positive_in_a_long_run(void)
{
  tse_ud p;
  tse_real variance[STATES], noise[MOTION];
  uint32_t seed = 11;
  const int rows = BY_NUMBER(100000, 100000, 30000);
  for (int i = 0; i < STATES; i++) variance[i] = TSE_R(1);
  for (int i = 0; i < MOTION; i++) noise[i] = real(1e-6);
  ud_set(&p, variance);
  for (int n = 0; n < rows; n++) {
    tse_short M[MOTION][PLACES];
    tse_real h[STATES], f[STATES], v[STATES], gain[STATES];
    for (int i = 0; i < MOTION; i++)
      for (int k = 0; k < COLUMNS; k++) M[i][k] = slope_of((i == k) * 0.99 + (k == (i + 3) % STATES) * 0.01);
    ud_move(&p, M, noise);
    for (int i = 0; i < STATES; i++)
      h[i] = next_uniform(&seed) < 0.7 ? TSE_R(0) : real(next_between(&seed, -1, 1));
    const tse_real own = ud_measure(&p, h, f, v);
    ud_correct(&p, f, v, own, real(n % 7 == 0 ? 1e-6 : n % 11 == 0 ? 1e3 : 1), gain);
    if (n % 23 == 0)
      for (int i = MOTION; i < STATES; i++) ud_add_at(&p, i, real(1e-6));
    for (int i = 0; i < STATES; i++)
      TEST_ASSERT_TRUE(p.d[i] > TSE_R(0) && r_is_finite(p.d[i]) && number(p.d[i]) < 1.01);
  }
  for (int i = 0; i < STATES; i++) {
    const double var = number(ud_variance(&p, i));
    TEST_ASSERT_TRUE(var > 0 && var < 1.01);
    for (int k = 0; k < i; k++) {
      const double r = number(ud_covariance(&p, i, k)) / sqrt(var * number(ud_variance(&p, k)));
      TEST_ASSERT_TRUE(
          fabs(r) < BY_NUMBER(1, 1.001, 1.2)); /* fixed point: variances of a few hundred steps */
    }
  }
}
