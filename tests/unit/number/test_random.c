/* tests/unit/number/test_random.c <-> src/number/random.h
 *
 * Reference values: test vectors of Random123, threefry in the general form of Salmon et
 * al. (SC11, section 4.1), and the distributions of t and F from the incomplete beta
 * function.
 *
 * Distributions are compared by Kolmogorov-Smirnov distances and chi-squares of seeded
 * samples. A correct generator exceeds each limit with probability 1e-5 (KS:
 * 2.47/sqrt(N); counts and correlations: 4.42 sigma), and any of the limits here with
 * less than 1e-2. The numbers are the same in every run, so a test that passes once
 * always passes. */
#include <stdlib.h>

#include "number/random.h"

#include "unit_support.h"

#define SAMPLES 100000
#define KS_LIMIT (2.47 / sqrt((double)SAMPLES))

static const uint32_t seed[2] = { 7u, 0x7473650au };
static double sample_of[6][SAMPLES];

static void words(uint32_t step, uint32_t purpose, uint32_t particle, uint32_t w[2])
{
  random_words(seed, step, purpose, particle, &w[0], &w[1]);
}

static int ascending(const void *a, const void *b)
{
  const double x = *(const double *)a, y = *(const double *)b;
  return (x > y) - (x < y);
}

/* Return the KS distance; sorts the sample. */
static double ks_distance(double *x, double (*cdf)(double))
{
  double worst = 0;
  qsort(x, SAMPLES, sizeof x[0], ascending);
  for (int i = 0; i < SAMPLES; i++) {
    const double p = cdf(x[i]);
    worst = fmax(worst, fmax(fabs(p - (double)i / SAMPLES), fabs((i + 1.0) / SAMPLES - p)));
  }
  return worst;
}

/* Compare the shares of the sample below the quantiles of p: mean p, sd sqrt(p (1-p)/N).
 * The quantiles are percents and both tails. The largest difference is compared with the
 * KS limit, and each share with 4.42 sd. Returned: 1 if within both */
static int follows(const double *x, double (*cdf)(double, double), double nu)
{
  static const double tail[] = { 0.0005, 0.001, 0.002, 0.005, 0.995, 0.998, 0.999, 0.9995 };
  for (int j = 1; j < 100 + ROWS(tail); j++) {
    const double p = j < 100 ? j / 100.0 : tail[j - 100];
    const double quantile = quantile_of(cdf, nu, p);
    int below = 0;
    for (int i = 0; i < SAMPLES; i++) below += x[i] < quantile;
    const double distance = fabs((double)below / SAMPLES - p);
    if (distance > KS_LIMIT || distance > 4.42 * sqrt(p * (1 - p) / SAMPLES)) {
      printf("share %g below the quantile of %g\n", (double)below / SAMPLES, p);
      return 0;
    }
  }
  return 1;
}

static const double dof_table[] = { 5, 6, 8, 11, 30, 101, 1000 };

/* ------------------------------------------------------------------------------------------- words */

static void threefry(const uint32_t counter[2], const uint32_t key[2], uint32_t w[2])
{
  static const int rotation[8] = { 13, 15, 26, 6, 17, 29, 16, 24 };
  const uint32_t schedule[3] = { key[0], key[1], 0x1bd11bdau ^ key[0] ^ key[1] };
  for (int i = 0; i < 2; i++) w[i] = counter[i] + key[i];
  for (uint32_t r = 0; r < 20; r++) {
    w[0] += w[1];
    w[1] = (w[1] << rotation[r % 8] | w[1] >> (32 - rotation[r % 8])) ^ w[0];
    if (r % 4 == 3) {
      w[0] += schedule[(r / 4 + 1) % 3];
      w[1] += schedule[(r / 4 + 2) % 3] + r / 4 + 1;
    }
  }
}

static void expect_words(const uint32_t counter[2], const uint32_t key[2], const uint32_t expected[2])
{
  uint32_t a, b;
  random_words(key, counter[0], counter[1] >> 16, counter[1] & 0xffffu, &a, &b);
  TEST_ASSERT_EQUAL_HEX32(expected[0], a);
  TEST_ASSERT_EQUAL_HEX32(expected[1], b);
}

static void test_words_are_threefry2x32_20(void)
{
  static const uint32_t published[3][6] = { { 0, 0, 0, 0, 0x6b200159u, 0x99ba4efeu }, /* of Random123 */
    { 0xffffffffu, 0xffffffffu, 0xffffffffu, 0xffffffffu, 0x1cb996fcu, 0xbb002be7u },
    { 0x243f6a88u, 0x85a308d3u, 0x13198a2eu, 0x03707344u, 0xc4923a9cu, 0x483df7a0u } };
  for (int i = 0; i < 3; i++) expect_words(published[i], published[i] + 2, published[i] + 4);
  uint32_t state = 3;
  for (int i = 0; i < 200; i++) {
    uint32_t counter[2] = { 0, 0 }, key[2] = { 0, 0 }, w[2];
    if (i < 64) counter[i / 32] = 1u << i % 32; /* each bit of it */
    else
      for (int k = 0; k < 2; k++) counter[k] = next_word(&state), key[k] = next_word(&state);
    threefry(counter, key, w);
    expect_words(counter, key, w);
  }
}

static int ascending_words(const void *a, const void *b)
{
  const uint64_t x = *(const uint64_t *)a, y = *(const uint64_t *)b;
  return (x > y) - (x < y);
}

/* threefry permutes the counter: equal results would mean equal counters. */
static void test_no_two_steps_purposes_or_particles_share_their_words(void)
{
  static const uint32_t purposes[] = { RANDOM_DRAW_A, RANDOM_DRAW_B, RANDOM_RESAMPLE, RANDOM_START_A,
    RANDOM_START_B, RANDOM_START_C, RANDOM_SIM_STIFFNESS_A, RANDOM_SIM_STIFFNESS_B, RANDOM_SIM_NOISE_A,
    RANDOM_SIM_NOISE_B, RANDOM_SIM_NOISE_C, RANDOM_SIM_WALK_A, RANDOM_SIM_WALK_B };
  enum { STEPS = 8, PARTICLES = 520, ALL = STEPS * ROWS(purposes) * PARTICLES };
  static uint64_t all[ALL];
  int n = 0;
  for (uint32_t step = 0; step < STEPS; step++)
    for (int k = 0; k < ROWS(purposes); k++)
      for (uint32_t i = 0; i < PARTICLES; i++) {
        uint32_t w[2];
        words(step, purposes[k], i, w);
        all[n++] = (uint64_t)w[0] << 32 | w[1];
      }
  qsort(all, ALL, sizeof all[0], ascending_words);
  for (int i = 1; i < ALL; i++) TEST_ASSERT_TRUE(all[i] != all[i - 1]);
}

static void test_last_particle_of_the_largest_filter_does_not_reach_the_next_purpose(void)
{
  uint32_t a[2], b[2];
  words(3, RANDOM_DRAW_A, 65535u, a);
  words(3, RANDOM_DRAW_B, 0, b);
  TEST_ASSERT_TRUE(a[0] != b[0] && a[1] != b[1]);
}

/* ----------------------------------------------------------------------------- uniform and normal */

static double uniform_cdf(double x) { return x; }
static double normal_cdf(double x) { return 0.5 * erfc(-x * 0.70710678118654752); }
static double exponential_cdf(double x) { return 1.0 - exp(-x); }

static void test_uniform_numbers_are_uniform(void)
{
  for (uint32_t i = 0; i < SAMPLES; i++) {
    uint32_t w[2];
    words(i, RANDOM_START_A, 0, w);
    sample_of[0][i] = number(r_uniform(w[0]));
    sample_of[1][i] = number(r_uniform(w[1]));
  }
  TEST_ASSERT_TRUE(ks_distance(sample_of[0], uniform_cdf) < KS_LIMIT);
  TEST_ASSERT_TRUE(ks_distance(sample_of[1], uniform_cdf) < KS_LIMIT);
}

static void normal_samples(void)
{
  for (uint32_t i = 0; i < SAMPLES; i++) {
    uint32_t w[2];
    tse_real a, b;
    words(i / 500u, RANDOM_START_B, i % 500u, w);
    random_normal2(w[0], w[1], &a, &b);
    sample_of[0][i] = number(a);
    sample_of[1][i] = number(b);
  }
}

/* Distributions of 1e5 numbers do not show errors of 0.5 %. The formula of Box and Muller
 * with libm does. */
static void test_normal_numbers_are_those_of_box_and_muller(void)
{
  uint32_t state = 1;
  for (int i = 0; i < 2000; i++) {
    const uint32_t a = next_word(&state), b = next_word(&state);
    const double radius = sqrt(-2 * log(number(r_uniform(a)))),
                 angle = 6.283185307179586 * number(r_uniform(b));
    tse_real n1, n2;
    random_normal2(a, b, &n1, &n2);
    expect_near(radius * cos(angle), number(n1), BY_FORMAT(1e-12, 3e-6), "first",
        i); /* 7 times the errors documented in real_ops.h */
    expect_near(radius * sin(angle), number(n2), BY_FORMAT(1e-12, 3e-6), "second", i);
  }
}

static void test_two_normal_numbers_are_independent(void)
{
  normal_samples();
  for (int i = 0; i < SAMPLES; i++) {
    const double a = sample_of[0][i], b = sample_of[1][i];
    sample_of[2][i] = a * a;
    sample_of[3][i] = b * b;
    sample_of[4][i] = 0.5 * (a * a + b * b);
    sample_of[5][i] = 0.6 * a + 0.8 * b;
  }
  for (int k = 0; k < 2; k++) {
    expect_moments(sample_of[k], SAMPLES, 0, 1, "normal");
    expect_uncorrelated(sample_of[2 * k], sample_of[2 * k + 1], SAMPLES, "numbers; their squares");
    TEST_ASSERT_TRUE(ks_distance(sample_of[k], normal_cdf) < KS_LIMIT); /* sorts them */
  }
  TEST_ASSERT_TRUE(ks_distance(sample_of[4], exponential_cdf) < KS_LIMIT);
  TEST_ASSERT_TRUE(ks_distance(sample_of[5], normal_cdf) < KS_LIMIT);
}

/* ------------------------------------------------------------------------------------- Student's t */

static void student(const uint32_t u[4], double nu, double t[3])
{
  tse_real a, b, c;
  random_student3(u, real(nu), real(-2 / nu), real(-2 / (nu + 2)), real(1 / (nu + 2)), &a, &b, &c);
  t[0] = number(a);
  t[1] = number(b);
  t[2] = number(c);
}

/* Rows 0..2 of sample_of: t1, t2, t3. */
static void student_samples(double nu)
{
  for (uint32_t i = 0; i < SAMPLES; i++) {
    uint32_t u[4];
    double t[3];
    words(i / 500u, RANDOM_DRAW_A, i % 500u, u);
    words(i / 500u, RANDOM_DRAW_B, i % 500u, u + 2);
    student(u, nu, t);
    for (int a = 0; a < 3; a++) sample_of[a][i] = t[a];
  }
}

static void combine(double *out, double a, double b, double c)
{
  for (int i = 0; i < SAMPLES; i++) out[i] = a * sample_of[0][i] + b * sample_of[1][i] + c * sample_of[2][i];
}

/* As for normal numbers: Bailey's formulas with libm. rr has nu times the relative error
 * of exp2. */
static void test_student_variates_are_those_of_bailey(void)
{
  uint32_t state = 2;
  for (int i = 0; i < 2000; i++) {
    const double nu = dof_table[i % ROWS(dof_table)];
    double u[4], t[3];
    uint32_t w[4];
    for (int k = 0; k < 4; k++) {
      w[k] = next_word(&state);
      u[k] = number(r_uniform(w[k]));
    }
    const double rr = nu * (pow(u[0], -2 / nu) - 1), qq = (nu + 2) * (pow(u[2], -2 / (nu + 2)) - 1);
    const double turn = 6.283185307179586, third = sqrt(qq * (nu + rr) / (nu + 2)) * cos(turn * u[3]);
    student(w, nu, t);
    /* The error of a root is that of its argument over twice the root, and at most the
     * root of the error. */
    const double noise = BY_FORMAT(1e-13, 1e-6) * (nu + rr), size = fmax(sqrt(rr), sqrt(noise));
    const double noise3 = BY_FORMAT(1e-13, 1e-6) * (nu + 2 + qq) * (1 + rr / nu),
                 size3 = fmax(fabs(third), sqrt(noise3));
    expect_near(
        sqrt(rr) * cos(turn * u[1]), t[0], noise / size + BY_FORMAT(1e-12, 2e-6) * (1 + sqrt(rr)), "t1", i);
    expect_near(
        sqrt(rr) * sin(turn * u[1]), t[1], noise / size + BY_FORMAT(1e-12, 2e-6) * (1 + sqrt(rr)), "t2", i);
    expect_near(third, t[2], noise3 / size3 + BY_FORMAT(1e-12, 2e-6) * (1 + fabs(third) + sqrt(qq)), "t3", i);
  }
}

/* Jointly spherical t: every projection onto a unit vector has the t distribution with
 * the same degrees of freedom. */
static void test_each_student_variate_and_every_projection_has_the_t_distribution(void)
{
  for (int k = 0; k < ROWS(dof_table); k++) {
    student_samples(dof_table[k]);
    for (int a = 0; a < 3; a++) TEST_ASSERT_TRUE(follows(sample_of[a], student_cdf, dof_table[k]));
    combine(sample_of[3], 1 / sqrt(3.0), 1 / sqrt(3.0), 1 / sqrt(3.0));
    combine(sample_of[4], 1 / 3.0, -2 / 3.0, 2 / 3.0);
    combine(sample_of[5], -0.6, 0.0, 0.8);
    for (int a = 3; a < 6; a++) TEST_ASSERT_TRUE(follows(sample_of[a], student_cdf, dof_table[k]));
  }
}

/* One chi-square for all three: (t1^2 + t2^2 + t3^2)/3 ~ F(3, nu), (t1^2 + t2^2)/2 ~ F(2,
 * nu). Independent t would not have these distributions. */
static void test_three_student_variates_share_one_chi_square(void)
{
  for (int k = 0; k < ROWS(dof_table); k++) {
    student_samples(dof_table[k]);
    for (int i = 0; i < SAMPLES; i++) {
      const double a = sample_of[0][i], b = sample_of[1][i], c = sample_of[2][i];
      sample_of[3][i] = (a * a + b * b + c * c) / 3;
      sample_of[4][i] = (a * a + b * b) / 2;
      sample_of[5][i] = (b * b + c * c) / 2;
    }
    TEST_ASSERT_TRUE(follows(sample_of[3], radius3_cdf, dof_table[k]));
    TEST_ASSERT_TRUE(follows(sample_of[4], radius2_cdf, dof_table[k]));
    TEST_ASSERT_TRUE(follows(sample_of[5], radius2_cdf, dof_table[k]));
  }
}

static double sphere_cdf(double x)
{
  return 0.5 * (1.0 + x);
} /* Archimedes: a coordinate on the sphere is uniform */

/* 8 octants times 6 orders of the absolute values are 48 congruent parts of the sphere.
 * Chi-square with 47 degrees of freedom, upper 1e-5 quantile 100.3. */
static void test_directions_are_uniform_on_the_sphere(void)
{
  const double dofs[] = { 5, 11, 101 };
  for (int k = 0; k < ROWS(dofs); k++) {
    int count[48] = { 0 };
    student_samples(dofs[k]);
    for (int i = 0; i < SAMPLES; i++) {
      const double a = sample_of[0][i], b = sample_of[1][i], c = sample_of[2][i],
                   radius = sqrt(a * a + b * b + c * c);
      const int octant = (a < 0) + 2 * (b < 0) + 4 * (c < 0);
      const int order = (fabs(a) < fabs(b)) + 2 * (fabs(b) < fabs(c)) + 4 * (fabs(a) < fabs(c));
      static const int place[8] = { 0, 1, 2, -1, -1, 3, 4,
        5 }; /* orders a < c < b etc.: two of eight are impossible */
      TEST_ASSERT_TRUE(place[order] >= 0);
      count[octant * 6 + place[order]]++;
      sample_of[3][i] = a / radius;
      sample_of[4][i] = b / radius;
      sample_of[5][i] = c / radius;
    }
    double chi_square = 0;
    for (int j = 0; j < 48; j++)
      chi_square += (count[j] - SAMPLES / 48.0) * (count[j] - SAMPLES / 48.0) / (SAMPLES / 48.0);
    TEST_ASSERT_TRUE(chi_square < 100.3);
    for (int a = 3; a < 6; a++) TEST_ASSERT_TRUE(ks_distance(sample_of[a], sphere_cdf) < KS_LIMIT);
  }
}

static void test_extreme_words_give_finite_numbers(void)
{
  static const uint32_t extremes[] = { 0u, 1u, 0x7fffffffu, 0x80000000u, 0xffffffffu };
  const double dofs[] = { 4, 5, 30, 1000, 12000 };
  for (int k = 0; k < ROWS(dofs); k++)
    for (int j = 0; j < 625; j++) {
      const uint32_t u[4] = { extremes[j % 5], extremes[j / 5 % 5], extremes[j / 25 % 5], extremes[j / 125] };
      double t[3];
      tse_real a, b;
      student(u, dofs[k], t);
      random_normal2(u[0], u[1], &a, &b);
      TEST_ASSERT_TRUE(
          isfinite(t[0]) && isfinite(t[1]) && isfinite(t[2]) && r_is_finite(a) && r_is_finite(b));
      TEST_ASSERT_TRUE(fabs(number(a)) < 6.7 && fabs(number(b)) < 6.7); /* sqrt(2 ln 2^32) */
    }
}
