/* tests/unit/estimator/hypotheses/test_learn.c <-> src/estimator/hypotheses/learn.c: against differences of the log evidence, and of S,
 * by the logarithms of the variances. */
#include "estimator/hypotheses/learn.h"

#include "unit_support.h"
#include "hypotheses_support.h"

static tse_params a_car(void)
{
  tse_config c;
  tse_config_default(&c);
  c.spread_max = setting(1);
  return prepared(&c);
}

static tse_real *variance(tse_hypothesis *h, int i)
{
  tse_real *const of[6] = { &h->spread_var[0], &h->spread_var[1], &h->spread_var[2], &h->noise_var[0], &h->noise_var[1], &h->noise_var[2] };
  return of[i];
}

/* At what was told, where the prior has no say. */
static tse_hypothesis told_hypothesis(const tse_params *p, uint32_t *seed)
{
  double P[JOINT][JOINT];
  tse_hypothesis h = some_hypothesis(p, seed, 1, P);
  for (int a = 0; a < 3; a++) {
    h.spread_var[a] = p->initial_spread_var;
    h.noise_var[a] = real(1);
  }
  return h;
}

static innovation with_log_variance(const tse_params *p, const tse_hypothesis *h, const sample *y, int i, double by)
{
  tse_hypothesis other = *h;
  innovation o;
  *variance(&other, i) = real(number(*variance(&other, i)) * exp(by));
  innovate(p, &other, y, &o);
  return o;
}

static double gaussian(const innovation *o) { return -0.5 * log(2) * number(o->log2_det) - 0.5 * number(o->m2); }

#define STEP BY_FORMAT(1e-4, 0.05)

static void reference(const tse_params *p, const tse_hypothesis *h, const sample *y, double score[6], double info[6][6])
{
  innovation o;
  double dS[6][9];
  innovate(p, h, y, &o);
  for (int i = 0; i < 6; i++) {
    const innovation lo = with_log_variance(p, h, y, i, -STEP), hi = with_log_variance(p, h, y, i, STEP);
    score[i] = (gaussian(&hi) - gaussian(&lo)) / (2 * STEP);
    double S[9];
    for (int k = 0; k < 9; k++) {
      S[k] = number(o.s[k / 3][k % 3]);
      dS[i][k] = (number(hi.s[k / 3][k % 3]) - number(lo.s[k / 3][k % 3])) / (2 * STEP);
    }
    dense_solve(3, S, dS[i], 3); /* S^-1 dS */
  }
  for (int i = 0; i < 6; i++)
    for (int j = 0; j < 6; j++) {
      info[i][j] = 0;
      for (int a = 0; a < 3; a++)
        for (int b = 0; b < 3; b++) info[i][j] += 0.5 * dS[i][3 * a + b] * dS[j][3 * b + a];
    }
}

/* With information K about each, the step is score/K. */
static void test_each_step_is_along_the_score_of_the_evidence(void)
{
  const tse_params p = a_car();
  const double K = 1000, keep = number(STATISTICS_TIME) / (number(STATISTICS_TIME) + 0.01);
  uint32_t seed = 31;
  for (int k = 0; k < 100; k++) {
    tse_hypothesis h = told_hypothesis(&p, &seed);
    const sample y = some_sample(&seed, &h, 8, k % 8);
    double score[6], info[6][6], was[6];
    innovation o;
    for (int i = 0; i < 6; i++) {
      was[i] = number(*variance(&h, i));
      h.info[i][i] = real(K);
    }
    innovate(&p, &h, &y, &o);
    reference(&p, &h, &y, score, info);
    learn(&p, &h, &y, &o, real(1));
    for (int i = 0; i < 6; i++) {
      const double moved = (number(*variance(&h, i)) / was[i] - 1) * keep * K;
      if (fabs(score[i]) > 0.15 * K) continue; /* bounded: below */
      expect_near(score[i], moved, 0.03 * fabs(score[i]) + BY_FORMAT(0.02, 0.2) + 2e-4 * score[i] * score[i], "score", i);
    }
  }
}

/* Where rows lost some of their noise by interpolation, innovations are smaller than S says, and on average nothing moves: over the
 * columns of a root of their covariance, times sqrt(3), squares have the mean that they have over all innovations. */
static void test_noise_that_interpolation_took_is_not_missed(void)
{
  const tse_params p = a_car();
  uint32_t seed = 37;
  for (int k = 0; k < 60; k++) {
    tse_hypothesis h = told_hypothesis(&p, &seed);
    sample y = some_sample(&seed, &h, 1, 7);
    innovation o;
    double C[3][3], root[3][3] = { { 0 } }, moved[6] = { 0 }, size[6] = { 0 };
    for (int i = 0; i < 6; i++) h.info[i][i] = real(1e4);
    for (int a = 0; a < 3; a++) y.lost[a] = real(k % 4 == a ? 0 : next_between(&seed, 0.1, 0.5));
    innovate(&p, &h, &y, &o);
    for (int a = 0; a < 3; a++)
      for (int b = 0; b < 3; b++) C[a][b] = number(o.s[a][b]) - (a == b ? number(y.lost[a]) * number(h.noise_var[a]) : 0);
    for (int j = 0; j < 3; j++)
      for (int i = j; i < 3; i++) {
        double x = C[i][j];
        for (int l = 0; l < j; l++) x -= root[i][l] * root[j][l];
        root[i][j] = i == j ? sqrt(x) : x / root[j][j];
      }
    for (int j = 0; j < 3; j++) {
      tse_hypothesis other = h;
      for (int a = 0; a < 3; a++) {
        double se = 0;
        for (int b = 0; b < 3; b++) se += number(o.inv[a][b]) * sqrt(3) * root[b][j];
        o.se[a] = real(se);
      }
      learn(&p, &other, &y, &o, real(1));
      for (int i = 0; i < 6; i++) {
        const double by = number(*variance(&other, i)) / number(*variance(&h, i)) - 1;
        moved[i] += by;
        size[i] += fabs(by);
      }
    }
    for (int i = 0; i < 6; i++) expect_near(0, moved[i], 0.005 * size[i] + BY_FORMAT(1e-9, 2e-6), "moved", i);
  }
}

static void test_information_is_that_of_a_gaussian_and_is_forgotten(void)
{
  const tse_params p = a_car();
  const double keep = number(STATISTICS_TIME) / (number(STATISTICS_TIME) + 0.01);
  uint32_t seed = 32;
  for (int k = 0; k < 50; k++) {
    tse_hypothesis h = told_hypothesis(&p, &seed);
    const sample y = some_sample(&seed, &h, 3, 7);
    double score[6], info[6][6];
    const tse_hypothesis was = h;
    innovation o;
    innovate(&p, &h, &y, &o);
    reference(&p, &h, &y, score, info);
    learn(&p, &h, &y, &o, real(1));
    for (int i = 0; i < 6; i++)
      for (int j = 0; j < 6; j++) {
        const double prior = i == j ? (1 - keep) / pow(number(i < 3 ? SPREAD_PRIOR_SD : NOISE_PRIOR_SD), 2) : 0;
        expect_near(keep * number(was.info[i][j]) + info[i][j] + prior, number(h.info[i][j]), BY_FORMAT(1e-6, 5e-3) * (1 + fabs(info[i][j])), "information", 10 * i + j);
      }
  }
}

/* A step is A^-1 score: by elimination. */
static void test_the_step_solves_for_all_six_at_once(void)
{
  const tse_params p = a_car();
  uint32_t seed = 33;
  int met = 0;
  for (int k = 0; k < 60; k++) {
    tse_hypothesis h = told_hypothesis(&p, &seed);
    double score[6], info[6][6], A[36], root[6][6], was[6];
    for (int i = 0; i < 6; i++)
      for (int j = 0; j < 6; j++) root[i][j] = next_between(&seed, -1, 1);
    for (int i = 0; i < 6; i++)
      for (int j = 0; j < 6; j++) {
        double sum = i == j ? 5 : 0;
        for (int l = 0; l < 6; l++) sum += 20 * root[i][l] * root[j][l];
        h.info[i][j] = real(sum);
      }
    for (int i = 0; i < 6; i++) was[i] = number(*variance(&h, i));
    const sample y = some_sample(&seed, &h, 3, 7);
    innovation o;
    innovate(&p, &h, &y, &o);
    reference(&p, &h, &y, score, info);
    learn(&p, &h, &y, &o, real(1));
    for (int i = 0; i < 36; i++) A[i] = number(h.info[i / 6][i % 6]);
    dense_solve(6, A, score, 1);
    for (int i = 0; i < 6; i++) {
      if (score[i] < -0.19 || score[i] > 0.49) continue;
      met++;
      expect_near(score[i], number(*variance(&h, i)) / was[i] - 1, BY_FORMAT(1e-5, 0.01) + 0.01 * fabs(score[i]), "step", i);
    }
  }
  TEST_ASSERT_TRUE(met > 200);
}

static void test_no_sample_moves_a_variance_far_or_out_of_its_bounds(void)
{
  const tse_params p = a_car();
  uint32_t seed = 34;
  tse_hypothesis h = told_hypothesis(&p, &seed);
  for (int k = 0; k < 500; k++) {
    const tse_hypothesis was = h;
    const sample y = some_sample(&seed, &h, k < 250 ? 1e4 : 0.01, 7);
    innovation o;
    innovate(&p, &h, &y, &o);
    learn(&p, &h, &y, &o, real(1));
    for (int i = 0; i < 6; i++) {
      tse_hypothesis before = was;
      const double now = number(*variance(&h, i)), then = number(*variance(&before, i));
      TEST_ASSERT_TRUE(now <= 1.5001 * then && now >= 0.7999 * then);
      TEST_ASSERT_TRUE(i < 3 ? now >= number(LEAST_SPREAD_VAR) * 0.999 && now <= 1.001 : now >= number(LEAST_NOISE_VAR) * 0.999 && now <= 900.1);
    }
  }
}

static void test_where_the_settings_are_believed_the_noise_is_as_told(void)
{
  tse_config c;
  tse_config_default(&c);
  c.noise_max = setting(1);
  const tse_params p = prepared(&c);
  uint32_t seed = 35;
  tse_hypothesis h = told_hypothesis(&p, &seed);
  const tse_hypothesis was = h;
  const sample y = some_sample(&seed, &h, 30, 7);
  innovation o;
  innovate(&p, &h, &y, &o);
  learn(&p, &h, &y, &o, real(1));
  TEST_ASSERT_EQUAL_MEMORY(was.noise_var, h.noise_var, sizeof h.noise_var);
  TEST_ASSERT_TRUE(memcmp(was.spread_var, h.spread_var, sizeof h.spread_var) != 0);
}

/* Nothing but noise, twice as loud as told, for 30 s: it is found, and what cannot be seen is as told. */
static void test_the_noise_is_found(void)
{
  const tse_params p = a_car();
  uint32_t seed = 36;
  tse_hypothesis h;
  memset(&h, 0, sizeof h);
  h.x[0] = real(20);
  for (int a = 0; a < 3; a++) {
    h.x[3 + a] = h.noise_var[a] = real(1);
    h.spread_var[a] = p.initial_spread_var;
    h.info[a][a] = real(1);
    h.info[3 + a][3 + a] = real(2);
  }
  for (int k = 0; k < 3000; k++) {
    sample y;
    memset(&y, 0, sizeof y);
    y.u = inputs_of(0, 20, 20);
    y.dt = real(0.01);
    y.used = 3;
    for (int a = 0; a < 3; a++) {
      y.use[a] = real(1);
      y.y[a] = real((1 + a) * sqrt(-2 * log(next_uniform(&seed))) * cos(6.283185307179586 * next_uniform(&seed)));
    }
    innovation o;
    innovate(&p, &h, &y, &o);
    learn(&p, &h, &y, &o, real(1));
  }
  for (int a = 0; a < 3; a++) {
    expect_near(1 + a, sqrt(number(h.noise_var[a])), 0.08 * (1 + a), "noise", a);
    expect_near(number(p.initial_spread_var), number(h.spread_var[a]), 1e-5, "spread", a);
  }
}

int main(void)
{
  UNITY_BEGIN();
  RUN_TEST(test_each_step_is_along_the_score_of_the_evidence);
  RUN_TEST(test_noise_that_interpolation_took_is_not_missed);
  RUN_TEST(test_information_is_that_of_a_gaussian_and_is_forgotten);
  RUN_TEST(test_the_step_solves_for_all_six_at_once);
  RUN_TEST(test_no_sample_moves_a_variance_far_or_out_of_its_bounds);
  RUN_TEST(test_where_the_settings_are_believed_the_noise_is_as_told);
  RUN_TEST(test_the_noise_is_found);
  return UNITY_END();
}
