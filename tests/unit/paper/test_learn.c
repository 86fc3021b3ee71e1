/* tests/unit/paper/test_learn.c <-> src/paper/learn.c, bias.c: the draw (25), the
 * statistics (16), the biases (19).
 *
 * References: the exact conditional of the joint Student-t in dense matrices and SI units
 * (paper_cases.h); the batch posterior of the conjugate normal-inverse-Wishart; a dense
 * Kalman update in long double. */
#include "paper/paper.h"
#include "unit_support.h"
#include "paper_cases.h"

static tse_filter_paper f;

enum { UPDATE_CASES = 6 };

typedef struct update_case {
  paper_car car;
  paper_prior prior;
  paper_particle q;
  double u[3], y[3], h[3], d[3][3];
  int mask;
  conditional w; /* given the sample */
} update_case;

static update_case update_case_of(int k)
{
  static const int masks[UPDATE_CASES] = { 7, 7, 3, 6, 2, 5 };
  static const double nus[UPDATE_CASES] = { 8, 60, 12, 25, 9, 101 };
  uint32_t seed = 25u + (uint32_t)k;
  update_case c;
  c.car = any_car(&seed), c.prior.nu = nus[k];
  c.prior.gamma = any(&seed, 0.01, 0.5);
  for (int a = 0; a < 3; a++) c.prior.bias_var[a] = any(&seed, 0.05, 0.5);
  const double v = next_between(&seed, 12, 25);
  c.u[0] = any(&seed, 0.02, 0.05);
  c.u[1] = single(v / c.car.wheel_radius_front + 2), c.u[2] = single(v / c.car.wheel_radius_rear + 1);
  c.q = any_particle(&seed, &c.car, c.u, 0.03, 0.05);
  c.mask = masks[k];
  any_sample(&seed, &c.car, &c.q, c.u, c.y);
  regressors(&c.car, c.q.x, c.u, c.h, c.d);
  c.w = conditional_of(&c.car, &c.prior, &c.q, c.u, c.y, c.mask);
  return c;
}

static tse_params params_of(const update_case *c) { return prepared(config_of(&c->car, TSE_MAX_PARTICLES)); }

/* All particles are equal, except for their random numbers. */
static void fill(const tse_params *p, const update_case *c, uint32_t step)
{
  memset(&f, 0, sizeof f);
  f.filter.step = step, f.nu = real(c->prior.nu), f.gamma = real(c->prior.gamma);
  for (int a = 0; a < 3; a++) f.bias_var[a] = real(c->prior.bias_var[a]);
  for (int32_t i = 0; i < pad_count(p->particles); i++) {
    f.weight[i] = TSE_R(1);
    for (int a = 0; a < 3; a++) {
      f.p.x[a][i] = real(c->q.x[a]), f.p.mu[a][i] = real(c->q.mu[a]);
      f.p.bias[a][i] = real(c->q.bias[a] / number(p->sd[a]));
    }
    for (int k = 0; k < 6; k++) f.p.lam[k][i] = real(c->q.scale[k]);
  }
}

/* As in paper_update(). */
static void learn(const tse_params *p, const sample *y)
{
  const common c = paper_compute_common(p, &f, y);
  paper_draw_stiffness(p, &f, y, &c);
  paper_update_statistics(p, &f);
  paper_update_bias(p, &f, y, &c);
}

/* A row of this step, with every particle as in the case. */
static void learn_from(const tse_params *p, const update_case *c, uint32_t step, const sample *y)
{
  fill(p, c, step);
  learn(p, y);
}

/* ---------------------------------------------------------------------------------------- (25) */

enum { T_LEVELS = 55, F_LEVELS = 22 };

/* Levels for the comparison of distributions: percents and tails. */
static double t_level(int j)
{
  static const double tail[6] = { 0.0005, 0.002, 0.005, 0.995, 0.998, 0.9995 };
  return j < 3 ? tail[j] : j < 52 ? (j - 2) / 50.0 : tail[j - 49];
}

static double f_level(int j)
{
  static const double tail[3] = { 0.98, 0.99, 0.998 };
  return j < 19 ? (j + 1) / 20.0 : tail[j - 19];
}

#define REPEAT 100
#define DRAWS ((double)REPEAT * TSE_MAX_PARTICLES)

/* If the draw is correct, e = white (w - mean) is spherical Student-t: mean 0, covariance
 * dof/(dof - 2) I, every projection t(dof). |e|^2/3 is F(3, dof), which requires one
 * chi-square for all three. */
static void test_draws_follow_the_exact_conditional_given_the_sample(void)
{
  /* projections: the axes and two oblique ones */
  static const double axis[5][3] = { { 1, 0, 0 }, { 0, 1, 0 }, { 0, 0, 1 }, { 0.6, 0.64, 0.48 },
    { 0.48, -0.6, 0.64 } };
  for (int k = 0; k < UPDATE_CASES; k++) {
    const update_case example = update_case_of(k), *const c = &example;
    const tse_params p = params_of(c);
    const sample y = sample_of_row(&p, c->u, c->y, c->mask);
    double mean[3] = { 0 }, product[3][3] = { { 0 } };
    static int below_t[5][T_LEVELS], below_f[F_LEVELS];
    double t_quantile[T_LEVELS], f_quantile[F_LEVELS];
    for (int j = 0; j < T_LEVELS; j++) t_quantile[j] = quantile_of(student_cdf, c->w.dof, t_level(j));
    for (int j = 0; j < F_LEVELS; j++) f_quantile[j] = quantile_of(radius3_cdf, c->w.dof, f_level(j));
    memset(below_t, 0, sizeof below_t);
    memset(below_f, 0, sizeof below_f);
    for (uint32_t step = 0; step < REPEAT; step++) {
      learn_from(&p, c, step + 1000u * (uint32_t)k, &y);
      for (int32_t i = 0; i < p.particles; i++) {
        double e[3] = { 0 };
        for (int a = 0; a < 3; a++)
          for (int b = 0; b < 3; b++) e[a] += c->w.white[a][b] * (number(f.p.w[b][i]) - c->w.mean[b]);
        for (int a = 0; a < 3; a++) {
          mean[a] += e[a] / DRAWS;
          for (int b = 0; b < 3; b++) product[a][b] += e[a] * e[b] / DRAWS;
        }
        for (int n = 0; n < 5; n++) {
          const double t = axis[n][0] * e[0] + axis[n][1] * e[1] + axis[n][2] * e[2];
          for (int j = 0; j < T_LEVELS; j++) below_t[n][j] += t < t_quantile[j];
        }
        const double ratio = (e[0] * e[0] + e[1] * e[1] + e[2] * e[2]) / 3.0;
        for (int j = 0; j < F_LEVELS; j++) below_f[j] += ratio < f_quantile[j];
      }
    }
    /* 4.5 standard errors; fourth moments of t(dof): 3 (dof - 2)/(dof - 4) times the
     * squared variance */
    const double var = c->w.dof / (c->w.dof - 2.0), kurtosis = 3.0 * (c->w.dof - 2.0) / (c->w.dof - 4.0);
    for (int a = 0; a < 3; a++) {
      expect_near(0.0, mean[a], 4.5 * sqrt(var / DRAWS), "mean of whitened draws", 10 * k + a);
      expect_near(var, product[a][a], 4.5 * var * sqrt((kurtosis - 1.0) / DRAWS),
          "variance of whitened draws", 10 * k + a);
      const int b = (a + 1) % 3;
      expect_near(0.0, product[a][b], 4.5 * var * sqrt(kurtosis / 3.0 / DRAWS),
          "covariance of whitened draws", 10 * k + a);
    }
    /* Kolmogorov-Smirnov at these levels: 1.95/sqrt(n) is exceeded by chance once in a
     * thousand. */
    for (int n = 0; n < 5; n++)
      for (int j = 0; j < T_LEVELS; j++)
        expect_near(t_level(j), below_t[n][j] / DRAWS, 1.95 / sqrt(DRAWS), "distribution of a projection",
            100 * n + j);
    for (int j = 0; j < F_LEVELS; j++)
      expect_near(f_level(j), below_f[j] / DRAWS, 1.95 / sqrt(DRAWS), "distribution of the length", j);
    /* The tails, where the sup norm is insensitive: expected count 25.6 beyond the
     * outermost levels, Poisson. */
    for (int n = 0; n < 5; n++) {
      const double tail = below_t[n][0] + DRAWS - below_t[n][T_LEVELS - 1],
                   expected = 2.0 * t_level(0) * DRAWS;
      expect_near(expected, tail, 4.5 * sqrt(expected), "draws in the tails", n);
    }
  }
}

static void test_draws_differ_between_steps_seeds_and_particles(void)
{
  const update_case example = update_case_of(0), *const c = &example;
  tse_params p = params_of(c);
  const sample y = sample_of_row(&p, c->u, c->y, 7);
  static tse_real first[3][TSE_STRIDE];
  learn_from(&p, c, 5, &y);
  memcpy(first, f.p.w, sizeof first);
  for (int32_t i = 1; i < p.particles; i++)
    TEST_ASSERT_TRUE(first[0][i] < first[0][i - 1] || first[0][i] > first[0][i - 1]);
  learn_from(&p, c, 5, &y);
  TEST_ASSERT_EQUAL_MEMORY(first, f.p.w, sizeof first);
  for (int k = 0; k < 2; k++) {
    if (k) p.seed[0]++;
    learn_from(&p, c, k ? 5 : 6, &y);
    for (int32_t i = 0; i < p.particles; i++)
      TEST_ASSERT_TRUE(first[k][i] < f.p.w[k][i] || first[k][i] > f.p.w[k][i]);
  }
}

static void test_a_draw_does_not_depend_on_how_many_particles_there_are(void)
{
  const update_case example = update_case_of(1), *const c = &example;
  tse_params p = params_of(c);
  const sample y = sample_of_row(&p, c->u, c->y, 7);
  static tse_real all[3][TSE_STRIDE];
  learn_from(&p, c, 9, &y);
  memcpy(all, f.p.w, sizeof all);
  for (int32_t n = 16; n < 100; n += 13) {
    p.particles = n;
    learn_from(&p, c, 9, &y);
    for (int a = 0; a < 3; a++) TEST_ASSERT_EQUAL_MEMORY(all[a], f.p.w[a], sizeof(tse_real) * (size_t)n);
  }
}

/* ---------------------------------------------------------------------------------------- (16) */

enum { STEPS = 30 };
static double drawn[STEPS][3][TSE_MAX_PARTICLES];

static void learn_repeatedly(const tse_params *p, const update_case *c)
{
  fill(p, c, 0);
  for (int step = 0; step < STEPS; step++) {
    /* another sample every time; the states are unchanged: move.c moves them */
    const double moved[3] = { c->y[0] + 0.1 * (step % 5 - 2), c->y[1] - 0.15 * (step % 3 - 1), c->y[2] };
    const sample y = sample_of_row(p, c->u, moved, step % 4 == 3 ? 3 : 7);
    learn(p, &y);
    f.filter.step++;
    for (int a = 0; a < 3; a++)
      for (int32_t i = 0; i < p->particles; i++) drawn[step][a][i] = number(f.p.w[a][i]);
  }
}

/* Normal-inverse-Wishart posterior of n samples at once (Gelman et al., Bayesian Data
 * Analysis, 3.6):
 *   kappa0 = 1/gamma;  mu_n = (kappa0 mu + n wbar)/(kappa0 + n);  nu_n = nu + n
 *   Lambda_n = Lambda + sum (w - wbar)(w - wbar)'
 *            + kappa0 n/(kappa0 + n) (wbar - mu)(wbar - mu)' */
static void test_updates_one_by_one_equal_the_batch_posterior(void)
{
  for (int k = 0; k < UPDATE_CASES; k++) {
    const update_case example = update_case_of(k), *const c = &example;
    const tse_params p = params_of(c);
    const long double kappa = 1.0L / c->prior.gamma, n = STEPS;
    learn_repeatedly(&p, c);
    expect_near((double)(1.0L / (kappa + n)), number(f.gamma), BY_FORMAT(1e-14, 5e-6) / (double)(kappa + n),
        "gamma", k);
    expect_near(c->prior.nu + STEPS, number(f.nu), BY_FORMAT(1e-12, 1e-4), "nu", k);
    for (int32_t i = 0; i < p.particles; i += 7) {
      long double bar[3] = { 0 };
      for (int a = 0; a < 3; a++)
        for (int step = 0; step < STEPS; step++) bar[a] += drawn[step][a][i] / n;
      for (int a = 0, at = 0; a < 3; a++) {
        const long double mu = (kappa * c->q.mu[a] + n * bar[a]) / (kappa + n);
        expect_near((double)mu, number(f.p.mu[a][i]), BY_FORMAT(1e-14, 2e-6), "mu", i);
        for (int b = a; b < 3; b++, at++) {
          long double lambda = c->prior.nu * c->q.scale[at];
          lambda += kappa * n / (kappa + n) * (bar[a] - c->q.mu[a]) * (bar[b] - c->q.mu[b]);
          for (int step = 0; step < STEPS; step++)
            lambda += (drawn[step][a][i] - bar[a]) * (drawn[step][b][i] - bar[b]);
          /* Lambda/nu is of order 0.01: 1e-6 of it in float, times sqrt(30) steps */
          expect_near((double)lambda / (c->prior.nu + STEPS), number(f.p.lam[at][i]), BY_FORMAT(1e-15, 2e-7),
              "Lambda/nu", 10 * i + at);
        }
      }
    }
  }
}

/* Sigma = lam nu/(nu - 4): no diagonal element above spread_max^2. Compared with the step
 * without a limit, a share of Lambda is removed, the same for all six elements, and
 * nothing below the limit. */
static void test_lambda_is_scaled_down_to_the_largest_spread(void)
{
  const update_case example = update_case_of(0), *const c = &example;
  tse_params p = params_of(c);
  const sample y = sample_of_row(&p, c->u, c->y, 7);
  const double nu = c->prior.nu + 1;
  static const double limit_of[] = { 1e3, 0.9, 0.5, 0.01 }; /* of lam's largest element at the start */
  static tse_filter_paper unlimited;
  learn_from(&p, c, 3, &y);
  memcpy(&unlimited, &f, sizeof f);
  for (int k = 0; k < ROWS(limit_of); k++) {
    const double limit = limit_of[k] * fmax(fmax(c->q.scale[0], c->q.scale[3]), c->q.scale[5]);
    int limited = 0;
    p.spread_max_var = real(limit * nu / (nu - 4.0));
    learn_from(&p, c, 3, &y);
    for (int32_t i = 0; i < p.particles; i += 7) {
      double l[6];
      for (int m = 0; m < 6; m++) l[m] = number(unlimited.p.lam[m][i]);
      const double share = fmin(1.0, limit / fmax(fmax(l[0], l[3]), l[5]));
      limited += share < 1.0;
      for (int m = 0; m < 6; m++)
        expect_near(share * l[m], number(f.p.lam[m][i]), BY_FORMAT(1e-15, 2e-8), "Lambda/nu", 10 * k + m);
    }
    TEST_ASSERT_EQUAL_INT(k > 0, limited > 0);
    TEST_ASSERT_EQUAL_MEMORY(unlimited.p.w, f.p.w, sizeof f.p.w);
    TEST_ASSERT_EQUAL_MEMORY(unlimited.p.mu, f.p.mu, sizeof f.p.mu);
  }
}

/* ---------------------------------------------------------------------------------------- (19) */

static void test_biases_follow_a_dense_kalman_update_given_the_drawn_stiffness(void)
{
  for (int k = 0; k < UPDATE_CASES; k++) {
    const update_case example = update_case_of(k), *const c = &example;
    const tse_params p = params_of(c);
    for (int mask = 1; mask < 8; mask++) {
      const sample y = sample_of_row(&p, c->u, c->y, mask);
      learn_from(&p, c, 77, &y);
      for (int a = 0; a < 3; a++) {
        const double sd = number(p.sd[a]), before = c->prior.bias_var[a] * sd * sd;
        const double gain = mask >> a & 1 ? before / (before + sd * sd)
                                          : 0.0; /* P and R are diagonal, and so is the dense K */
        const double after = (1.0 - gain) * before * (1.0 - gain) + gain * sd * sd * gain; /* Joseph */
        expect_near(after, number(f.bias_var[a]) * sd * sd, BY_FORMAT(1e-14, 1e-6) * before, "P", 10 * k + a);
        for (int32_t i = 0; i < p.particles; i += 3) {
          double left = c->y[a] - c->h[a] - c->q.bias[a];
          for (int b = 0; b < 3; b++) left -= c->d[a][b] * number(f.p.w[b][i]);
          /* float: h has errors of 1e-6 of some 10 m/s2 by the rounding of the wheel
           * speeds */
          expect_near(c->q.bias[a] + gain * left, sd * number(f.p.bias[a][i]), BY_FORMAT(1e-12, 2e-4) * sd,
              "bias", 100 * mask + a);
        }
      }
    }
  }
}

/* ------------------------------------------------------------------------------- bounds, missing */

static void test_a_draw_beyond_the_lower_bound_is_reflected_and_beyond_the_upper_cut(void)
{
  const update_case example = update_case_of(0), *const c = &example;
  tse_params p = params_of(c);
  const sample y = sample_of_row(&p, c->u, c->y, 7);
  static double free_w[3][TSE_MAX_PARTICLES];
  p.w_low = TSE_R(-1000), p.w_max = TSE_R(1000);
  learn_from(&p, c, 3, &y);
  for (int a = 0; a < 3; a++)
    for (int32_t i = 0; i < p.particles; i++) free_w[a][i] = number(f.p.w[a][i]);
  p.w_low = real(c->w.mean[1] - 0.02), p.w_max = real(c->w.mean[1] + 0.06);
  learn_from(&p, c, 3, &y);
  const double lo = number(p.w_low), hi = number(p.w_max);
  int reflected = 0, cut = 0;
  for (int a = 0; a < 3; a++)
    for (int32_t i = 0; i < p.particles; i++) {
      const double w = free_w[a][i], inside = w < lo ? 2.0 * lo - w : w;
      reflected += w < lo;
      cut += inside > hi;
      /* 1000 in the reference run costs ulps of 1000 in float */
      expect_near(inside > hi ? hi : inside, number(f.p.w[a][i]), BY_FORMAT(1e-12, 3e-4), "w", i);
    }
  TEST_ASSERT_TRUE(reflected > 50 && cut > 50);
}

static void test_stiffness_stays_within_its_bounds_whatever_the_input(void)
{
  uint32_t state = 12;
  for (int k = 0; k < UPDATE_CASES; k++) {
    const update_case example = update_case_of(k), *const c = &example;
    tse_params p = params_of(c);
    if (k % 2) p.w_low = p.w_min; /* reflect_draws */
    fill(&p, c, 0);
    for (int step = 0; step < 300; step++) {
      static const double most[6] = { 1.2, 400.0, 400.0, 50.0, 50.0, 6.0 }; /* input.toml */
      double u[6];
      for (int k2 = 0; k2 < 6; k2++) u[k2] = next_between(&state, -most[k2], most[k2]);
      const sample s = sample_of_row(&p, u, u + 3, (int)(next_word(&state) >> 8 & 7u));
      for (int32_t i = 0; i < p.particles; i++) {
        f.p.x[0][i] = real(next_between(&state, -70.0, 70.0));
        f.p.x[1][i] = real(next_between(&state, -30.0, 30.0));
        f.p.x[2][i] = real(next_between(&state, -6.0, 6.0));
      }
      if (step % 100 == 99) f.p.x[1][5] = real((double)NAN); /* even a broken particle keeps its stiffness */
      learn(&p, &s);
      f.filter.step++;
      for (int a = 0; a < 3; a++)
        for (int32_t i = 0; i < p.particles; i++) {
          const double slack = BY_FORMAT(1e-15, 1e-6); /* mu is a mean of limited numbers, rounded */
          TEST_ASSERT_TRUE(f.p.w[a][i] >= p.w_low && f.p.w[a][i] <= p.w_max);
          TEST_ASSERT_TRUE(number(f.p.mu[a][i]) >= number(p.w_low) - slack
              && number(f.p.mu[a][i]) <= number(p.w_max) + slack);
        }
    }
    for (int m = 0; m < 6; m++)
      for (int32_t i = 0; i < p.particles; i++) TEST_ASSERT_TRUE(r_is_finite(f.p.lam[m][i]));
  }
}

static void test_states_and_weights_are_left_alone(void)
{
  const update_case example = update_case_of(2), *const c = &example;
  const tse_params p = params_of(c);
  const sample y = sample_of_row(&p, c->u, c->y, c->mask);
  static tse_filter_paper before;
  fill(&p, c, 4);
  memcpy(&before, &f, sizeof f);
  learn(&p, &y);
  TEST_ASSERT_EQUAL_MEMORY(before.p.x, f.p.x, sizeof f.p.x);
  TEST_ASSERT_EQUAL_MEMORY(before.p.logw, f.p.logw, sizeof f.p.logw);
  TEST_ASSERT_EQUAL_MEMORY(before.weight, f.weight, sizeof f.weight);
}
