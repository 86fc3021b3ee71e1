/* tests/unit/paper/test_kalman.c - the whole particle filter, on a problem with a known
 * solution: linear and Gaussian, it must agree with a Kalman filter (turning:
 * single_track.h), including the evidence, with resampling. */
#include "paper/paper.h"
#include "unit_support.h"
#include "single_track.h"

static tse_filter_paper f;

static const double omega = 60, sd_of[3] = { 0.15, 0.15, 0.0035 }, bias_sd[3] = { 0.05, 0.05, 0.002 },
                    bias_walk[3] = { 0.002, 0.002, 0.0001 };
static const double x_sd[3] = { 0, 0.005, 0.003 }, spread = 0.05, row_time = 0.01;

static tse_config settings(void) /* the car of the defaults, car_table[0] */
{
  tse_config c = config_by(tse_config_paper);
  c.integration = 1; /* second order, as in the reference */
  c.accel_x_sd = c.accel_y_sd = setting(sd_of[0]), c.yaw_rate_sd = setting(sd_of[2]);
  c.accel_x_bias_sd = c.accel_y_bias_sd = setting(bias_sd[0]), c.yaw_rate_bias_sd = setting(bias_sd[2]);
  c.accel_x_bias_walk = c.accel_y_bias_walk = setting(bias_walk[0]);
  c.yaw_rate_bias_walk = setting(bias_walk[2]), c.sample_time = setting(row_time);
  c.initial_spread = setting(spread), c.initial_vel_x_sd = setting(x_sd[0]);
  c.initial_vel_y_sd = setting(x_sd[1]), c.initial_yaw_rate_sd = setting(x_sd[2]);
  return c;
}

static tse_input row(double steer, const double y[3], int mask)
{
  tse_input u = blank_row();
  u.dt = real(0.01), u.steer_angle = real(steer), u.wheel_speed_front = u.wheel_speed_rear = real(omega);
  u.accel_x = mask & 1 ? real(y[0]) : real((double)NAN);
  u.accel_y = mask & 2 ? real(y[1]) : real((double)NAN);
  u.yaw_rate = mask & 4 ? real(y[2]) : real((double)NAN);
  return u;
}

/* ------------------------------------------------------------------- turning: particles needed */

#define SEEDS 24
enum { STEPS = 160 };
static double estimate_of[SEEDS][STEPS][11]; /* vel_y, yaw rate, 3 biases; their sds; log evidence */
static int resampled;

/* Constant wheel speeds and a slowly varying steering angle. With known mean and spread
 * of the stiffness, w is white Gaussian noise in both the motion and the accelerometers.
 * vel_y, yaw rate and biases are then linear and Gaussian, except that d depends on the
 * slip angle, which is known to 1 %. */
static struct {
  double steer, y[3], evidence, mean[5], sd[5];
} kalman_turning[STEPS];

static void run_kalman_filter(void)
{
  const double v = 0.33 * omega;
  double truth[9] = { v };
  uint32_t seed = 1961;
  dense_kalman k = { car_table[0], { v }, { { 0 } }, { sd_of[0], sd_of[1], sd_of[2] },
    { bias_walk[0], bias_walk[1], bias_walk[2] }, spread, 1 };
  for (int a = 0; a < 3; a++) {
    truth[a] += x_sd[a] * next_normal(&seed), truth[6 + a] = bias_sd[a] * next_normal(&seed);
    k.cov[a][a] = x_sd[a] * x_sd[a], k.cov[3 + a][3 + a] = spread * spread,
    k.cov[6 + a][6 + a] = bias_sd[a] * bias_sd[a];
  }
  for (int n = 0; n < STEPS; n++) {
    const double from = single(0.03 * sin(6.283185307179586 * 0.4 * row_time * n)),
                 to = single(0.03 * sin(6.283185307179586 * 0.4 * row_time * (n + 1)));
    const double u0[3] = { from, v, v }, u1[3] = { to, v, v };
    double *const y = kalman_turning[n].y;
    for (int a = 0; a < 3; a++) truth[3 + a] = spread * next_normal(&seed);
    dense_observe(k.car, truth, u0, y);
    for (int a = 0; a < 3; a++) y[a] = single(y[a] + sd_of[a] * next_normal(&seed));
    kalman_turning[n].steer = from;
    kalman_turning[n].evidence = dense_update(
        &k, u0, y, n == 0 ? 3 : 7); /* without a first yaw rate the filter starts straight ahead */
    for (int a = 0; a < 5; a++) {
      const int at = a < 2 ? 1 + a : 4 + a;
      kalman_turning[n].mean[a] = k.mean[at];
      kalman_turning[n].sd[a] = sqrt(k.cov[at][at]);
    }
    dense_predict(&k, u0, u1, row_time);
    track_move(k.car, truth, truth + 3, u0, u1, row_time, 20);
    for (int a = 0; a < 3; a++) truth[6 + a] += bias_walk[a] * sqrt(row_time) * next_normal(&seed);
  }
}

/* Mean and sd of bias a given all rows so far: the output precedes the row's own bias
 * update. */
static void bias_now(const tse_params *p, int a, double *mean, double *sd)
{
  double sum = 0.0, first = 0.0, second = 0.0;
  for (int32_t i = 0; i < p->particles; i++) {
    const double w = exp2(number(f.p.logw[0][i])), b = number(f.p.bias[a][i]);
    sum += w;
    first += w * b;
    second += w * b * b;
  }
  *mean = number(p->sd[a]) * first / sum;
  *sd = number(p->sd[a]) * sqrt(number(f.bias_var[a]) + second / sum - (first / sum) * (first / sum));
}

/* Mean stiffness known exactly (gamma = 0), spread known almost exactly (1000 degrees of
 * freedom, little forgetting). */
static void run_turning(int32_t scheme)
{
  resampled = 0;
  run_kalman_filter();
  for (int s = 0; s < SEEDS; s++) {
    tse_config c = settings();
    c.particles = TSE_MAX_PARTICLES, c.initial_mean_sd = setting(0), c.initial_dof = setting(1000);
    c.forgetting = setting(0.9999), c.resample_threshold = setting(0.5), c.resampling = scheme;
    c.seed = 100 + s;
    const tse_params p = prepared(c);
    TEST_ASSERT_EQUAL_INT(TSE_OK, tse_reset(&p, &f.filter, sizeof f));
    for (int k = 0; k < STEPS; k++) {
      const tse_input u = row(kalman_turning[k].steer, kalman_turning[k].y, k == 0 ? 3 : 7);
      tse_output y;
      const tse_status status = tse_step(&p, &f.filter, &u, &y);
      TEST_ASSERT_TRUE(status >= 0);
      resampled += y.n_eff <= p.resample_at;
      double *const e = estimate_of[s][k];
      e[0] = number(y.vel_y);
      e[1] = number(y.yaw_rate);
      e[5] = number(y.vel_y_sd);
      e[6] = number(y.yaw_rate_sd);
      for (int a = 0; a < 3; a++) bias_now(&p, a, &e[2 + a], &e[7 + a]);
      e[10] = number(y.log_evidence);
    }
  }
}

static void over_seeds(int k, int column, double *mean, double *standard_error)
{
  double sum = 0.0, squares = 0.0;
  for (int s = 0; s < SEEDS; s++) sum += estimate_of[s][k][column];
  for (int s = 0; s < SEEDS; s++) squares += pow(estimate_of[s][k][column] - sum / SEEDS, 2.0);
  *mean = sum / SEEDS;
  *standard_error = sqrt(squares / (SEEDS - 1) / SEEDS);
}

/* Tolerances, for the mean over SEEDS runs:
 *   means     4.5 standard errors of that mean, measured over the seeds (Student-t with
 *             23 degrees of freedom: chance 2e-4 per number), and 2 % of the Kalman
 *             filter's sd for nonlinear terms: d known to 1 %, second-order integration,
 *             Student-t with 998 degrees of freedom instead of a normal
 *   sds       4.5 standard errors, and 3 %: N particles underestimate an sd by
 *             1/(2 N_eff), again in every generation with shared ancestors
 *   evidence  of one row: 4.5 standard errors and (q^2 - 10 q + 15)/(4 nu), the first
 *             term of the Student-t, below 0.03 for q = z'S^-1 z up to 16; of all rows:
 *             exp(sum) is unbiased, so its mean over the seeds is compared */
static void expect_agreement_with_the_kalman_filter(void)
{
  for (int k = 0; k < STEPS; k++) {
    double mean, se;
    for (int a = 0; a < 5; a++) {
      const double sd = kalman_turning[k].sd[a];
      over_seeds(k, a, &mean, &se);
      expect_near(kalman_turning[k].mean[a], mean, 4.5 * se + 0.02 * sd, "mean", 1000 * a + k);
      TEST_ASSERT_TRUE(se < 0.1 * sd); /* the test needs a tolerance below a tenth of the sd */
      over_seeds(k, 5 + a, &mean, &se);
      expect_near(sd, mean, 4.5 * se + 0.03 * sd, "sd", 1000 * a + k);
      TEST_ASSERT_TRUE(se < 0.05 * sd);
    }
    over_seeds(k, 10, &mean, &se);
    expect_near(kalman_turning[k].evidence, mean, 4.5 * se + 0.03, "log evidence of a row", k);
    TEST_ASSERT_TRUE(se < 0.05);
  }

  double kalman = 0.0, ratio[SEEDS], mean_ratio = 0.0, squares = 0.0;
  for (int k = 0; k < STEPS; k++) kalman += kalman_turning[k].evidence;
  for (int s = 0; s < SEEDS; s++) {
    double sum = 0.0;
    for (int k = 0; k < STEPS; k++) sum += estimate_of[s][k][10];
    ratio[s] = exp(sum - kalman);
    mean_ratio += ratio[s] / SEEDS;
  }
  for (int s = 0; s < SEEDS; s++) squares += (ratio[s] - mean_ratio) * (ratio[s] - mean_ratio);
  const double se = sqrt(squares / (SEEDS - 1) / SEEDS);
  expect_near(1.0, mean_ratio, 4.5 * se + 0.05, "evidence of all rows over the Kalman filter's", 0);
  TEST_ASSERT_TRUE(se < 0.15);
  TEST_ASSERT_TRUE(resampled > 2 * SEEDS); /* the test must include resampling */
}

static void test_turning_agrees_with_a_kalman_filter_with_systematic_resampling(void)
{
  run_turning(0);
  expect_agreement_with_the_kalman_filter();
}

static void test_turning_agrees_with_a_kalman_filter_with_the_other_ways_of_resampling(void)
{
  for (int32_t scheme = 1; scheme <= 3; scheme++) { /* stratified, residual, multinomial */
    printf("resampling %d\n", (int)scheme);
    run_turning(scheme);
    expect_agreement_with_the_kalman_filter();
  }
}

/* ------------------------------------------------------------------ straight: exact per particle */

/* Wheels roll freely straight ahead: without slip, every particle is one scalar Kalman
 * filter per bias (here in double), whose innovations have a Student-t density with nut =
 * nu - 2 degrees of freedom and scale (nut-2)/nut (R + P). Differences are rounding: both
 * logs of gamma functions (series accurate to 1.6e-3/(nut/2 + 4)^5 = 1e-9 from 28 degrees
 * of freedom on), and in float 6e-8 of the measurements times (nut + 3)/2. */
static void test_straight_on_the_evidence_is_that_of_a_kalman_filter(void)
{
  tse_config c = settings();
  c.particles = 16, c.initial_dof = setting(30), c.forgetting = setting(0.96875);
  c.initial_vel_y_sd = c.initial_yaw_rate_sd = setting(0);
  const tse_params p = prepared(c);
  double total = 0.0, expected_total = 0.0, nu = 30, bias[3], mean[3] = { 0 }, var[3];
  uint32_t seed = 1960;
  for (int a = 0; a < 3; a++)
    var[a] = pow(bias_sd[a], 2), bias[a] = bias_sd[a] * next_between(&seed, -1.7, 1.7);
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_reset(&p, &f.filter, sizeof f));
  for (int k = 0; k < 250; k++) {
    const int drawn = (int)(next_word(&seed) % 7) + 1,
              mask = k == 0 ? 3
        : k % 3 == 0        ? drawn
                            : 7; /* without a first yaw rate */
    const double nut = nu - 2;
    double y[3], used = 0, log_det = 0, q = 0;
    for (int a = 0; a < 3; a++) y[a] = (float)(bias[a] + number(p.sd[a]) * next_between(&seed, -1.7, 1.7));
    const tse_input u = row(0.0, y, mask);
    const tse_real *const read[3] = { &u.accel_x, &u.accel_y, &u.yaw_rate };
    for (int a = 0; a < 3; a++) {
      const double r = pow(number(p.sd[a]), 2), s = r + var[a], z = number(*read[a]) - mean[a],
                   gain = var[a] / s;
      if (mask >> a & 1) {
        used++, log_det += log((nut - 2) / nut * s), q += z * z / ((nut - 2) / nut * s);
        mean[a] += gain * z;
        var[a] = pow(1 - gain, 2) * var[a] + gain * gain * r;
      }
    }
    const double evidence = lgamma((nut + used) / 2) - lgamma(nut / 2)
        - used / 2 * log(nut * 3.141592653589793) - log_det / 2 - (nut + used) / 2 * log1p(q / nut);
    tse_output out;
    TEST_ASSERT_TRUE(tse_step(&p, &f.filter, &u, &out) >= 0);
    expect_near(evidence, number(out.log_evidence), BY_FORMAT(5e-9, 1e-4), "log evidence", k);
    for (int a = 0; a < 3; a++) {
      double now, sd;
      bias_now(&p, a, &now, &sd);
      expect_near(mean[a], now, BY_FORMAT(1e-12, 1e-5) * number(p.sd[a]), "bias", 10 * k + a);
      expect_near(sqrt(var[a]), sd, BY_FORMAT(1e-7, 1e-3) * sqrt(var[a]), "sd of bias", 10 * k + a);
      var[a] += pow(bias_walk[a], 2) * row_time;
      bias[a] += sqrt(row_time) * bias_walk[a] * next_between(&seed, -1.7, 1.7);
    }
    nu = (nu + 1) * 0.96875;
    total += number(out.log_evidence);
    expected_total += evidence;
  }
  expect_near(expected_total, total, BY_FORMAT(1e-6, 3e-3), "log evidence of all rows", 0);
}
