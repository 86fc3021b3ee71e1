/* tests/unit/paper/test_resample.c <-> src/paper/resample.c
 *
 * Properties that define a resampler: it is unbiased (the expected number of copies is n
 * q), each scheme has its own limits on the copies of one particle, and its own variance.
 * Random numbers depend on the step number, so all results are the same in every run. */
#include "paper/paper.h"
#include "unit_support.h"

enum { SYSTEMATIC, STRATIFIED, RESIDUAL, MULTINOMIAL, SCHEMES };
#define MOST TSE_MAX_PARTICLES

static const uint32_t seed[2] = { 2016u, 0x7473650au };
static tse_real weight[TSE_STRIDE];
static uint16_t ancestor[TSE_STRIDE], copies_work[TSE_STRIDE];
static int32_t copies[TSE_STRIDE];

static double total_weight(int32_t n)
{
  double total = 0.0;
  for (int32_t i = 0; i < n; i++) total += number(weight[i]);
  return total;
}

/* Weights as in the filter: the largest is 1. */
static void random_weights(int32_t n, uint32_t *state, double decades)
{
  double largest = 0.0, w[TSE_STRIDE];
  for (int32_t i = 0; i < n; i++) {
    w[i] = pow(10.0, -decades * next_uniform(state));
    if (w[i] > largest) largest = w[i];
  }
  for (int32_t i = 0; i < n; i++) weight[i] = real(w[i] / largest);
}

/* Resample once, check the properties of all schemes, and store the numbers of copies. */
static void draw(int32_t scheme, int32_t n, uint32_t step)
{
  for (int32_t i = 0; i < n; i++) ancestor[i] = 0xffffu;
  ancestor[n] = 0xbeefu;
  paper_choose_ancestors(scheme, weight, n, seed, step, ancestor);
  TEST_ASSERT_EQUAL_HEX16(0xbeefu, ancestor[n]);
  for (int32_t i = 0; i < n; i++) copies[i] = 0;
  for (int32_t k = 0; k < n; k++) {
    TEST_ASSERT_TRUE(ancestor[k] < n);
    TEST_ASSERT_TRUE(k == 0 || ancestor[k] >= ancestor[k - 1]);
    copies[ancestor[k]]++;
  }
}

/* Mean number of copies over DRAWS draws, compared with n q. Multinomial copies have the
 * variance n q (1 - q). No scheme has more. 4.5 standard errors for 4 x 24 comparisons
 * (chance 7e-4). */
#define DRAWS 4000

static void test_every_scheme_gives_n_q_copies_on_average(void)
{
  const int32_t n = 24;
  for (int32_t scheme = 0; scheme < SCHEMES; scheme++) {
    double sum[24] = { 0 };
    uint32_t state = 5;
    random_weights(n, &state, 1.5);
    const double total = total_weight(n);
    for (uint32_t step = 0; step < DRAWS; step++) {
      draw(scheme, n, step);
      for (int32_t i = 0; i < n; i++) sum[i] += copies[i];
    }
    for (int32_t i = 0; i < n; i++) {
      const double q = number(weight[i]) / total, se = sqrt(n * q * (1.0 - q) / DRAWS);
      expect_near(n * q, sum[i] / DRAWS, 4.5 * se, "mean copies", i + 100 * scheme);
    }
  }
}

/* n q has an error by rounding of the cumulative sum: n times half an ulp, with a margin
 * of 4. */
#define ROUNDING(n) (BY_FORMAT(2.0e-16, 1.2e-7) * (n) * (n))

static void test_copies_keep_within_the_bounds_of_each_scheme(void)
{
  uint32_t state = 9;
  for (uint32_t step = 0; step < 400; step++) {
    const int32_t n = 16 + (int32_t)(next_uniform(&state) * 80.0);
    random_weights(n, &state, step % 5 * 1.0);
    const double total = total_weight(n), slack = ROUNDING(n);
    for (int32_t scheme = 0; scheme < SCHEMES; scheme++) {
      draw(scheme, n, step);
      for (int32_t i = 0; i < n; i++) {
        const double nq = n * number(weight[i]) / total;
        if (scheme == SYSTEMATIC) { /* floor(n q) or one more */
          TEST_ASSERT_TRUE(copies[i] > nq - 1.0 - slack && copies[i] < nq + 1.0 + slack);
        } else if (scheme == STRATIFIED) { /* an interval of width n q overlaps that many strata */
          TEST_ASSERT_TRUE(copies[i] > nq - 2.0 - slack && copies[i] < nq + 2.0 + slack);
        } else if (scheme == RESIDUAL) { /* floor(n q) at least; the rest overlaps two strata */
          TEST_ASSERT_TRUE(copies[i] >= floor(nq - slack) && copies[i] < nq + 2.0 + slack);
        }
      }
      /* Also for the first k particles together: this distinguishes the schemes. */
      double ahead = 0.0;
      int32_t taken = 0;
      for (int32_t i = 0; i < n; i++) {
        ahead += n * number(weight[i]) / total;
        taken += copies[i];
        if (scheme == SYSTEMATIC || scheme == STRATIFIED) {
          TEST_ASSERT_TRUE(fabs(taken - ahead) < 1.0 + slack);
        }
      }
    }
  }
}

static double scatter_of(int32_t scheme, int32_t n, int32_t i, double nq)
{
  double sum = 0.0;
  for (uint32_t step = 0; step < 2000; step++) {
    draw(scheme, n, step + 7000u);
    sum += (copies[i] - nq) * (copies[i] - nq);
  }
  return sum / 2000.0;
}

static void test_schemes_scatter_as_theory_says(void)
{
  /* n = 20. Particle 7 has n q = 1 from 6.5 to 7.5, half of it in each of two strata.
   * Variance of its copies:
   *   systematic 0, residual 0, stratified 2 (1/2)(1/2), multinomial n q (1 - q) = 0.95
   * Particle 19 has n q = 1.5 from 18.5 to 20: systematic 1/4, residual (one for sure,
   * half of another) at most 1/4, stratified 1/4, multinomial 1.5 (1 - 1.5/20) = 1.3875.
   * A variance over 2000 draws has a standard error of 3-4 %. */
  const int32_t n = 20;
  for (int32_t i = 0; i < n; i++) weight[i] = real((i == 0 ? 0.5 : i == 19 ? 1.5 : 1.0) / 2.0);
  expect_near(0.0, scatter_of(SYSTEMATIC, n, 7, 1.0), 0.0, "systematic", 7);
  expect_near(0.0, scatter_of(RESIDUAL, n, 7, 1.0), 0.0, "residual", 7);
  expect_near(0.5, scatter_of(STRATIFIED, n, 7, 1.0), 0.15 * 0.5, "stratified", 7);
  expect_near(0.95, scatter_of(MULTINOMIAL, n, 7, 1.0), 0.15 * 0.95, "multinomial", 7);
  expect_near(0.25, scatter_of(SYSTEMATIC, n, 19, 1.5), 1e-9, "systematic", 19);
  expect_near(0.25, scatter_of(RESIDUAL, n, 19, 1.5), 1e-9, "residual", 19);
  expect_near(0.25, scatter_of(STRATIFIED, n, 19, 1.5), 1e-9, "stratified", 19);
  expect_near(1.3875, scatter_of(MULTINOMIAL, n, 19, 1.5), 0.15 * 1.3875, "multinomial", 19);
}

/* Pearson's statistic of all copies over many multinomial draws follows chi-square with n
 * - 1 degrees of freedom: mean n - 1, variance 2 (n - 1). A scheme with evenly spread
 * draws would give far too little, a wrong one too much. */
static void test_multinomial_copies_pass_a_chi_square_test(void)
{
  const int32_t n = 32;
  double sum[32] = { 0 }, total, chi2 = 0.0;
  uint32_t state = 77;
  random_weights(n, &state, 1.0);
  total = total_weight(n);
  for (uint32_t step = 0; step < DRAWS; step++) {
    draw(MULTINOMIAL, n, step);
    for (int32_t i = 0; i < n; i++) sum[i] += copies[i];
  }
  for (int32_t i = 0; i < n; i++) {
    const double expected = (double)DRAWS * n * number(weight[i]) / total;
    chi2 += (sum[i] - expected) * (sum[i] - expected) / expected;
  }
  TEST_ASSERT_TRUE(chi2 > 13.1); /* scipy.stats.chi2.ppf([0.002, 0.998], 31) = 12.5 (rounded up), 58.3 */
  TEST_ASSERT_TRUE(chi2 < 58.3);

  /* Also draw by draw, to distinguish evenly spread draws from independent ones. The mean
   * over draws of each draw's statistic is n - 1 for any weights. Its sd is slightly
   * above sqrt(2 n/DRAWS). Tolerance: 5 of them. */
  double mean = 0.0;
  for (uint32_t step = 0; step < DRAWS; step++) {
    draw(MULTINOMIAL, n, step);
    for (int32_t i = 0; i < n; i++) {
      const double expected = n * number(weight[i]) / total;
      mean += (copies[i] - expected) * (copies[i] - expected) / expected / DRAWS;
    }
  }
  expect_near(n - 1.0, mean, 1.0, "mean statistic", 0);
}

static void test_equal_weights_keep_every_particle_once_except_at_random_ones(void)
{
  for (int32_t i = 0; i < 64; i++) weight[i] = TSE_R(1);
  for (uint32_t step = 0; step < 200; step++) {
    for (int32_t scheme = 0; scheme < MULTINOMIAL; scheme++) {
      draw(scheme, 64, step);
      for (int32_t i = 0; i < 64; i++) TEST_ASSERT_EQUAL_INT32(1, copies[i]);
    }
    draw(MULTINOMIAL, 64, step);
    int32_t lost = 0;
    for (int32_t i = 0; i < 64; i++) lost += copies[i] == 0;
    TEST_ASSERT_TRUE(lost > 8 && lost < 40); /* 64/e = 23.5 on average, sd 2.9 */
  }
}

static void test_a_particle_without_weight_is_never_chosen(void)
{
  static const int32_t alone[] = { 0, 25, 47 };
  uint32_t state = 3;
  for (int32_t scheme = 0; scheme < SCHEMES; scheme++)
    for (uint32_t step = 0; step < 300; step++) {
      for (int32_t i = 0; i < 48; i++)
        weight[i] = real(i % 3 == 1 && step > 150 ? ldexp(ceil(256.0 * next_uniform(&state)), -8) : 0.0);
      weight[step > 150 ? 25 : alone[step % 3]] = TSE_R(
          1); /* multiples of 1/256: the sums are exact in every format */
      draw(scheme, 48, step);
      for (int32_t i = 0; i < 48; i++) TEST_ASSERT_TRUE(weight[i] > TSE_R(0) || copies[i] == 0);
    }
}

static void test_the_same_seed_and_step_choose_the_same_and_another_step_does_not(void)
{
  uint16_t first[64];
  uint32_t state = 21;
  random_weights(64, &state, 1.0);
  for (int32_t scheme = 0; scheme < SCHEMES; scheme++) {
    draw(scheme, 64, 5);
    memcpy(first, ancestor, sizeof first);
    draw(scheme, 64, 5);
    TEST_ASSERT_EQUAL_HEX16_ARRAY(first, ancestor, 64);
    int32_t differ = 0;
    for (uint32_t step = 6; step < 16; step++) {
      draw(scheme, 64, step);
      differ += memcmp(first, ancestor, sizeof first) != 0;
    }
    TEST_ASSERT_TRUE(differ > 5);
  }
}

/* -------------------------------------------------------------------------------- the copy in place */

static void test_survivors_keep_their_places_and_the_multiset_stays(void)
{
  uint32_t state = 31;
  for (uint32_t step = 0; step < 400; step++) {
    const int32_t n = step < 4 ? MOST : 16 + (int32_t)(next_uniform(&state) * 100.0);
    int32_t after[TSE_STRIDE] = { 0 };
    random_weights(n, &state, step % 7 * 2.0);
    draw((int32_t)(step % SCHEMES), n, step);
    paper_keep_survivors(ancestor, copies_work, n);
    for (int32_t i = 0; i < n; i++) {
      TEST_ASSERT_TRUE(ancestor[i] < n);
      after[ancestor[i]]++;
      if (copies[i] > 0) TEST_ASSERT_EQUAL_UINT16(i, ancestor[i]);
    }
    TEST_ASSERT_EQUAL_INT32_ARRAY(copies, after, n);
  }
}

/* The value of every number of every field identifies field, row and particle. */
static tse_real tag(int row, int32_t i) { return real((double)i + 1024.0 * row); }

static void test_copying_moves_every_field_of_a_particle_and_leaves_the_padding(void)
{
  static tse_particles q;
  const int32_t n = 100;
  uint32_t state = 41;
  random_weights(n, &state, 2.0);
  draw(SYSTEMATIC, n, 1);
  paper_keep_survivors(ancestor, copies_work, n);

  tse_real(*const row)[TSE_STRIDE] = q.x;
  for (int r = 0; r < 19; r++)
    for (int32_t i = 0; i < TSE_STRIDE; i++) row[r][i] = tag(r, i);

  paper_copy_particles(&q, ancestor, n);

  for (int r = 0; r < 19; r++)
    for (int32_t i = 0; i < TSE_STRIDE; i++)
      expect_near(number(tag(r, i < n ? ancestor[i] : i)), number(row[r][i]), 0.0, "row of the particles", i);
  TEST_ASSERT_EQUAL_UINT64(
      sizeof q, (size_t)sizeof(tse_real) * TSE_STRIDE * 19u); /* the list covers the struct */
}

#if defined(TSE_REAL_DOUBLE) || defined(TSE_REAL_FLOAT)
/* Weights so small that shares of them round up: positions beyond the sum of all weights,
 * which the last ancestor takes. */
static void test_positions_that_rounding_leaves_beyond_all_weights_take_the_last_ancestor(void)
{
  const tse_real least = (tse_real)(sizeof(tse_real) == 4 ? 1.401298464324817e-45 : 4.9406564584124654e-324);
  for (int32_t scheme = 0; scheme < SCHEMES; scheme++)
    for (uint32_t step = 0; step < 40; step++) {
      weight[0] = least;
      weight[1] = least + least;
      draw(scheme, 2, step);
      weight[1] = weight[2] = least;
      draw(scheme, 3, step);
    }
}
#endif

/* With a kernel, the Lambdas of equal particles are multiplied by exp(k n - k^2/2): mean
 * 1, variance exp(k^2) - 1, unchanged shape, within 4.5 standard errors (for the variance
 * with a factor of 4 k: the tail is longer than normal). Without a kernel, no bit
 * changes. */
static void test_a_kernel_scales_lambda_by_a_factor_of_mean_one(void)
{
  static tse_filter_paper f;
  const double k = 0.2, n = TSE_MAX_PARTICLES;
  for (int on = 0; on < 2; on++) {
    tse_config c = config_by(tse_config_robust);
    double mean = 0, square = 0;
    c.particles = TSE_MAX_PARTICLES;
    c.spread_kernel = setting(on ? k : 0);
    const tse_params p = prepared(c);
    memset(&f, 0, sizeof f);
    for (int32_t i = 0; i < p.particles; i++) {
      f.weight[i] = TSE_R(1);
      for (int m = 0; m < 6; m++) f.p.lam[m][i] = real(0.25 * (m + 1));
    }
    paper_resample(&p, &f);
    for (int32_t i = 0; i < p.particles; i++) {
      const double scale = number(f.p.lam[0][i]) / 0.25;
      for (int m = 1; m < 6; m++)
        expect_near(scale * 0.25 * (m + 1), number(f.p.lam[m][i]), BY_FORMAT(1e-14, 1e-6), "shape", i);
      if (!on) expect_near(1.0, scale, 0.0, "without a kernel", i);
      mean += scale / n;
      square += scale * scale / n;
    }
    if (!on) continue;
    const double var = exp(k * k) - 1.0;
    expect_near(1.0, mean, 4.5 * sqrt(var / n), "mean", 0);
    expect_near(var, square - mean * mean, 4.5 * var * sqrt(4.0 / n), "variance", 0);
  }
}
