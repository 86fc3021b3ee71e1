/* tests/unit/paper/test_weigh.c <-> src/paper/weigh.c: (22), (23), compared with the
 * multivariate Student-t in SI units with dense matrices (paper_cases.h). */
#include "paper/paper.h"
#include "unit_support.h"
#include "paper_cases.h"

#define LN2 0.69314718055994530942

static tse_filter_paper f;

/* Tolerance of a log density [nat]: fixed + relative |log density|.
 *   double  2.7e-14 of log2, times (nut + d)/2 up to 1000
 *   float   wheel speeds are rounded to 1 um/s: 1e-7 of slip, 1e-4 sigma of acceleration,
 *           times an innovation of 5 sigma; log2(1 + q/nut) has errors of 6e-8, times
 *           (nut + d)/2 up to 1000: 1e-4 */
#define FIXED BY_FORMAT(2e-10, 3e-3)
#define RELATIVE BY_FORMAT(2e-12, 1e-5)

/* The first omitted term of the asymptotic series for Gamma(x + 1/2)/Gamma(x), x = nut/2
 * + 4: 399/(262144 x^5), 2e-7 at the smallest nu. */
static double series(double nu) { return 1.6e-3 * pow(0.5 * nu + 3.0, -5.0); }

enum { WEIGH_PARTICLES = 16, WEIGH_STEPS = 4, WEIGH_CASES = 6 };

typedef struct weigh_case {
  paper_car car;
  paper_prior prior;
  paper_particle particle[WEIGH_PARTICLES];
  double u[WEIGH_STEPS][3], y[WEIGH_STEPS][3];
  int mask[WEIGH_STEPS]; /* channels used in each row */
} weigh_case;

static weigh_case weigh_case_of(int k)
{
  static const double nus[WEIGH_CASES] = { 6, 9, 30, 100, 400, 2000 };
  uint32_t seed = 2016u + (uint32_t)k;
  weigh_case c;
  c.car = any_car(&seed), c.prior.nu = nus[k];
  c.prior.gamma = any(&seed, 0.005, 0.9);
  for (int a = 0; a < 3; a++) c.prior.bias_var[a] = any(&seed, 0.01, 0.6);
  const double v = next_between(&seed, 8, 30);
  for (int n = 0; n < WEIGH_STEPS; n++) {
    c.u[n][0] = single(0.05 * next_normal(&seed));
    c.u[n][1] = single(v / c.car.wheel_radius_front + 0.5 * next_normal(&seed));
    c.u[n][2] = single(v / c.car.wheel_radius_rear + 0.5 * next_normal(&seed));
    c.mask[n] = n == 0 || n == WEIGH_STEPS - 1 ? 7 : (int)(next_word(&seed) % 6) + 1;
  }
  for (int i = 0; i < WEIGH_PARTICLES; i++) c.particle[i] = any_particle(&seed, &c.car, c.u[0], 0.02, 0.15);
  for (int n = 0; n < WEIGH_STEPS; n++)
    any_sample(&seed, &c.car, &c.particle[n], c.u[n], c.y[n]); /* no density falls below 2^-120 */
  return c;
}

/* Log density [nat, SI] of a row's sample under particle i. */
static double expected_density(const weigh_case *c, int i, int n, int mask)
{
  return conditional_of(&c->car, &c->prior, &c->particle[i], c->u[n], c->y[n], mask).log_density;
}

static tse_params params_of(const weigh_case *c) { return prepared(config_of(&c->car, WEIGH_PARTICLES)); }

static void fill(const tse_params *p, const weigh_case *c)
{
  memset(&f, 0, sizeof f);
  f.nu = real(c->prior.nu), f.gamma = real(c->prior.gamma), f.log_total = r_log2(r_from_int(WEIGH_PARTICLES));
  for (int32_t i = 0; i < WEIGH_PARTICLES; i++) {
    const paper_particle *const q = &c->particle[i];
    f.weight[i] = TSE_R(1);
    for (int a = 0; a < 3; a++) {
      f.bias_var[a] = real(c->prior.bias_var[a]), f.p.x[a][i] = real(q->x[a]), f.p.mu[a][i] = real(q->mu[a]);
      f.p.bias[a][i] = real(q->bias[a] / number(p->sd[a]));
    }
    for (int k = 0; k < 6; k++) f.p.lam[k][i] = real(q->scale[k]);
  }
}

static tse_real weighed(const tse_params *p, const sample *y) /* as paper_update() calls it */
{
  const common c = paper_compute_common(p, &f, y);
  return paper_update_weights(p, &f, y, &c);
}

/* Log density [nat, SI] of the sample under particle i: the increment of a log-weight by
 * paper_update_weights(). */
static double log_density(int32_t i, tse_real log2_evidence)
{
  return LN2 * (number(f.p.logw[0][i]) + number(log2_evidence) - number(f.log_total)) + log(WEIGH_PARTICLES);
}

static void test_each_particles_density_is_the_students_t_for_every_combination_of_channels(void)
{
  for (int k = 0; k < WEIGH_CASES; k++) {
    const weigh_case example = weigh_case_of(k), *const c = &example;
    const tse_params p = params_of(c);
    for (int mask = 1; mask < 8; mask++) {
      const sample y = sample_of_row(&p, c->u[0], c->y[0], mask);
      double largest = -1e300;
      fill(&p, c);
      const tse_real evidence = weighed(&p, &y);
      for (int32_t i = 0; i < WEIGH_PARTICLES; i++) largest = fmax(largest, expected_density(c, i, 0, mask));
      for (int32_t i = 0; i < WEIGH_PARTICLES; i++) {
        const double expected = fmax(
            expected_density(c, i, 0, mask), largest - 120.0 * LN2); /* lower weights are 0 */
        expect_near(expected, log_density(i, evidence),
            FIXED + RELATIVE * fabs(expected) + series(c->prior.nu), "log density",
            1000 * k + 100 * mask + i);
      }
    }
  }
}

static void test_evidence_is_the_log_of_the_weighted_sum_over_several_rows(void)
{
  for (int k = 0; k < WEIGH_CASES; k++) {
    const weigh_case example = weigh_case_of(k), *const c = &example;
    const tse_params p = params_of(c);
    double logw[WEIGH_PARTICLES];
    fill(&p, c);
    for (int i = 0; i < WEIGH_PARTICLES; i++) logw[i] = -log(WEIGH_PARTICLES);
    for (int step = 0; step < WEIGH_STEPS; step++) {
      const sample y = sample_of_row(&p, c->u[step], c->y[step], c->mask[step]);
      const tse_real evidence = weighed(&p, &y);
      double largest = -1e300, sum = 0, kept = 0;
      for (int i = 0; i < WEIGH_PARTICLES; i++)
        largest = fmax(largest, logw[i] += expected_density(c, i, step, c->mask[step]));
      for (int i = 0; i < WEIGH_PARTICLES; i++) sum += exp(logw[i] - largest);
      const double expected = largest + log(sum);
      for (int i = 0; i < WEIGH_PARTICLES; i++)
        kept += exp((logw[i] = fmax(logw[i] - largest, -120 * LN2))); /* lower weights are 0 */
      for (int i = 0; i < WEIGH_PARTICLES; i++) logw[i] -= log(kept);
      /* Errors of earlier rows remain in the weights: step + 1 times the tolerance of one
       * row. */
      const double tolerance = (step + 1) * (FIXED + RELATIVE * fabs(expected)) + series(c->prior.nu);
      expect_near(expected, LN2 * number(evidence), tolerance, "log evidence", 100 * k + step);
    }
  }
}

/* Wheels roll freely straight ahead: without slip and with d = 0, the evidence of one row
 * is the density of the innovation. The only other factor is that with two gamma
 * functions, for 1, 2 and 3 channels. */
static void test_evidence_holds_from_six_to_two_thousand_degrees_of_freedom(void)
{
  static const double straight[3] = { 0.0, 50.0, 50.0 };
  tse_config config = config_by(tse_config_paper);
  config.particles = 16;
  config.accel_x_sd = config.accel_y_sd = config.yaw_rate_sd = setting(1);
  const tse_params p = prepared(config);
  static const double nus[] = { 6, 6.25, 7, 8, 9.5, 12, 20, 35, 60, 102, 250, 500, 1000, 2000 };
  uint32_t seed = 1;
  for (int k = 0; k < ROWS(nus); k++)
    for (int mask = 1; mask < 8; mask++) {
      const double nu = nus[k], nut = nu - 2,
                   z[3] = { any(&seed, -3, 3), any(&seed, -3, 3), any(&seed, -3, 3) };
      const sample y = sample_of_row(&p, straight, z, mask);
      double n = 0, q = 0; /* channels, of unit sd, scale (nut-2)/nut */
      for (int a = 0; a < 3; a++)
        if (mask >> a & 1) n++, q += z[a] * z[a] * nut / (nut - 2);
      const double expected = lgamma((nut + n) / 2) - lgamma(nut / 2)
          - n / 2 * log((nut - 2) * 3.141592653589793) - (nut + n) / 2 * log1p(q / nut);
      memset(&f, 0, sizeof f);
      f.nu = real(nu), f.gamma = real(0.1), f.log_total = TSE_R(4);
      for (int32_t i = 0; i < 16; i++) f.p.x[0][i] = y.u.v_front;
      const tse_real evidence = weighed(&p, &y);
      /* double: 2.7e-14 of log2 times (nut + 3)/2 log2(1 + q/nut), plus as much for each
       * other log. float: log2(1 + q/nut) has errors of 6e-8, times (nut + 3)/2, and the
       * other logs 2.3e-7 of up to 20. */
      expect_near(expected, LN2 * number(evidence),
          series(nu) + BY_FORMAT(1e-12 + 2e-15 * nu, 2e-5 + 1.2e-7 * nu), "log evidence", 10 * k + mask);
    }
}

static void test_weights_are_the_powers_of_the_log_weights_and_padding_has_none(void)
{
  const weigh_case example = weigh_case_of(2), *const c = &example;
  tse_params p = params_of(c);
  const sample y = sample_of_row(&p, c->u[0], c->y[0], 7);
  fill(&p, c);
  for (int32_t i = 16; i < 24; i++) {
    f.weight[i] = TSE_R(5);
    for (int a = 0; a < 3; a++) { /* a particle like the others, but not in use */
      f.p.x[a][i] = f.p.x[a][0], f.p.mu[a][i] = f.p.mu[a][0], f.p.bias[a][i] = f.p.bias[a][0];
    }
    for (int k = 0; k < 6; k++) f.p.lam[k][i] = f.p.lam[k][0];
    f.p.logw[0][i] = TSE_R(400); /* and one with the largest weight by far */
  }
  p.particles = 19;
  f.p.logw[0][16] = f.p.logw[0][17] = TSE_R(-1);
  f.p.logw[0][18] = TSE_R(50); /* the best one is after the last whole group of eight */
  (void)weighed(&p, &y);
  expect_near(1.0, number(f.weight[18]), 0.0, "best weight", 18);
  double largest = -1.0, sum = 0.0;
  for (int32_t i = 0; i < 19; i++) {
    const double w = number(f.weight[i]);
    largest = fmax(largest, w);
    sum += w;
    expect_near(exp2(number(f.p.logw[0][i])), w, BY_FORMAT(1e-13, 1e-6) * w + QUANTUM, "weight", i);
  }
  for (int32_t i = 19; i < 24; i++) expect_near(0.0, number(f.weight[i]), 0.0, "padding", i);
  expect_near(1.0, largest, 0.0, "largest weight", 0);
  expect_near(log2(sum), number(f.log_total), BY_FORMAT(1e-13, 2e-6), "log2 of the sum of weights", 0);
}

static void test_extreme_innovations_stay_finite(void)
{
  static const double far[][3] = { { 50.0, -50.0, 6.0 }, { -50.0, 50.0, -6.0 }, { 50.0, 0.0, 0.0 } };
  static const double turn[3] = { 1.2, 400.0, -400.0 };
  tse_config config = config_by(tse_config_paper);
  config.particles = 16;
  config.accel_x_sd = config.accel_y_sd = setting(
      BY_NUMBER(0.001, 0.001, 0.01)); /* at the limits: 50 000 and 600 000 sigma away */
  config.yaw_rate_sd = setting(BY_NUMBER(1e-5, 1e-5, 1e-3));
  config.longitudinal_stiffness_front = config.cornering_stiffness_rear = setting(BY_NUMBER(1e7, 1e7, 5e5));
  config.mass = setting(BY_NUMBER(50, 50, 600));
  const tse_params p = prepared(config);
  for (int k = 0; k < ROWS(far); k++)
    for (int mask = 1; mask < 8; mask++) {
      const sample y = sample_of_row(&p, turn, far[k], mask);
      const weigh_case c = weigh_case_of(k);
      fill(&p, &c);
      const tse_real evidence = weighed(&p, &y);
      TEST_ASSERT_TRUE(r_is_finite(evidence));
      TEST_ASSERT_TRUE(r_is_finite(f.log_total));
      double largest = 0.0;
      for (int32_t i = 0; i < 16; i++) {
        TEST_ASSERT_TRUE(number(f.weight[i]) >= 0.0 && number(f.weight[i]) <= 1.0);
        largest = fmax(largest, number(f.weight[i]));
      }
      expect_near(1.0, largest, 0.0, "largest weight", mask);
    }
}

/* A distant sample must keep the order of the particles by likelihood, although all
 * densities underflow. */
static void test_order_of_particles_survives_where_densities_underflow(void)
{
  static const double straight[3] = { 0.0, 50.0, 50.0 };
  static const double y_far[3] = { 0.0, 45.0, 0.0 };
  tse_config config = config_by(tse_config_paper);
  config.particles = 16;
  const tse_params p = prepared(config);
  const sample y = sample_of_row(&p, straight, y_far, 7);
  memset(&f, 0, sizeof f);
  f.nu = TSE_R(2000), f.log_total = TSE_R(4);
  for (int32_t i = 0; i < 16; i++) {
    f.p.x[0][i] = y.u.v_front;
    f.p.bias[1][i] = real(i == 11 ? 1.0 : 0.0); /* 299 instead of 300 sigma away */
  }
  const tse_real evidence = weighed(&p, &y);
  for (int32_t i = 0; i < 16; i++) TEST_ASSERT_TRUE(i == 11 || f.weight[i] < f.weight[11]);
  TEST_ASSERT_TRUE(number(evidence) * LN2 < -3000.0);
}

/* No density is finite: the sample carries no information about the particles. */
static void test_weights_that_are_no_numbers_count_as_equal(void)
{
  const weigh_case example = weigh_case_of(1), *const c = &example;
  const tse_params p = params_of(c);
  for (int how = 0; how < 2; how++) {
    fill(&p, c);
    for (int32_t i = 0; i < 16; i++) f.p.logw[0][i] = real(how ? (double)NAN : (double)-INFINITY);
    (void)paper_normalise(&p, &f);
    for (int32_t i = 0; i < 16; i++) expect_near(1.0, number(f.weight[i]), 0.0, "weight", i);
    expect_near(4.0, number(f.log_total), 0.0, "log2 of their sum", how);
  }
}

static void test_one_broken_particle_does_not_take_the_others_along(void)
{
  const weigh_case example = weigh_case_of(1), *const c = &example;
  const tse_params p = params_of(c);
  const sample y = sample_of_row(&p, c->u[0], c->y[0], 7);
  for (int32_t spoilt = 0; spoilt < 16; spoilt++) {
    fill(&p, c);
    f.p.x[1][spoilt] = broken();
    const tse_real evidence = weighed(&p, &y);
    double sum = 0.0;
    for (int32_t i = 0; i < 16; i++) sum += exp(expected_density(c, i, 0, 7)) * (i != spoilt) / 16.0;
    const double tolerance = 2.0 * FIXED + RELATIVE * fabs(log(sum)) + series(c->prior.nu);
    expect_near(log(sum), LN2 * number(evidence), tolerance, "log evidence", spoilt);
    TEST_ASSERT_TRUE(number(f.weight[spoilt]) < 1e-30);
  }
}
