/* tests/unit/estimator/hypotheses/test_update.c <-> src/estimator/hypotheses/update.c: against a joint Gaussian of X, eps and noise,
 * conditioned by dense algebra; and a drive against a plain Kalman filter of 16 states. */
#include "estimator/hypotheses/update.h"

#include "unit_support.h"
#include "estimator/hypotheses/predict.h"
#include "hypotheses_support.h"

static tse_params a_car(void)
{
  tse_config c;
  tse_config_default(&c);
  return prepared(&c);
}

/* z and P of X and eps given the sample: K = P H' S^-1; considered: no gain of the stiffness (Joseph's form, right for any gain). */
static void condition(double z[JOINT], double P[JOINT][JOINT], double H[3][JOINT], const double e[3], const double R[3], int considered)
{
  double PH[JOINT][3], S[9], K[JOINT * 3], A[JOINT][JOINT], AP[JOINT][JOINT];
  for (int i = 0; i < JOINT; i++)
    for (int a = 0; a < 3; a++) {
      PH[i][a] = 0;
      for (int k = 0; k < JOINT; k++) PH[i][a] += P[i][k] * H[a][k];
    }
  for (int a = 0; a < 3; a++)
    for (int b = 0; b < 3; b++) {
      S[3 * a + b] = a == b ? R[a] : 0;
      for (int k = 0; k < JOINT; k++) S[3 * a + b] += H[a][k] * PH[k][b];
    }
  double rhs[3 * JOINT]; /* S K' = (P H')' */
  for (int a = 0; a < 3; a++)
    for (int i = 0; i < JOINT; i++) rhs[a * JOINT + i] = PH[i][a];
  dense_solve(3, S, rhs, JOINT);
  for (int i = 0; i < JOINT; i++)
    for (int a = 0; a < 3; a++) K[3 * i + a] = considered && i >= 3 && i < 6 ? 0 : rhs[a * JOINT + i];
  for (int i = 0; i < JOINT; i++) {
    for (int a = 0; a < 3; a++) z[i] += K[3 * i + a] * e[a];
    for (int j = 0; j < JOINT; j++) {
      A[i][j] = i == j;
      for (int a = 0; a < 3; a++) A[i][j] -= K[3 * i + a] * H[a][j];
    }
  }
  for (int i = 0; i < JOINT; i++)
    for (int j = 0; j < JOINT; j++) {
      AP[i][j] = 0;
      for (int k = 0; k < JOINT; k++) AP[i][j] += A[i][k] * P[k][j];
    }
  for (int i = 0; i < JOINT; i++)
    for (int j = 0; j < JOINT; j++) {
      P[i][j] = 0;
      for (int k = 0; k < JOINT; k++) P[i][j] += AP[i][k] * A[j][k];
      for (int a = 0; a < 3; a++) P[i][j] += K[3 * i + a] * R[a] * K[3 * j + a];
    }
}

/* The relative variance of a stiffness is what stays when its mean moves. */
static void keep_relative(double z[JOINT], double P[JOINT][JOINT], const double before[3])
{
  for (int a = 0; a < 3; a++) {
    const double ratio = z[3 + a] / before[a];
    for (int j = 0; j < TSE_X; j++) P[3 + a][j] *= ratio;
    for (int j = 0; j < TSE_X; j++) P[j][3 + a] *= ratio;
  }
}

static void joint_before(const tse_hypothesis *h, const innovation *o, double z[JOINT], double P[JOINT][JOINT], double H[3][JOINT])
{
  for (int i = 0; i < JOINT; i++) {
    z[i] = i < TSE_X ? number(h->x[i]) : 0;
    for (int j = 0; j < JOINT; j++) P[i][j] = i < TSE_X && j < TSE_X ? number(h->cov[i][j]) : 0;
  }
  for (int a = 0; a < 3; a++) {
    P[TSE_X + a][TSE_X + a] = number(o->eps_var[a]);
    for (int i = 0; i < JOINT; i++) H[a][i] = i < 6 ? number(o->h[a][i]) : i == X_LAG ? number(o->lag[a]) : i >= TSE_X ? number(o->d[a][i - TSE_X]) : 0;
  }
}

static void expect_conditioned(int fault)
{
  const tse_params p = a_car();
  uint32_t seed = 21;
  double P[JOINT][JOINT], z[JOINT], H[3][JOINT], e[3], R[3];
  for (int k = 0; k < 60; k++) {
    tse_hypothesis h = some_hypothesis(&p, &seed, 1, P);
    h.fault = fault;
    sample y = some_sample(&seed, &h, 0, k % 8);
    innovation o;
    innovate(&p, &h, &y, &o);
    for (int a = 0; a < 3; a++) y.y[a] = real(number(y.use[a]) * (next_between(&seed, -2, 2) - number(o.e[a]))); /* near the forecast */
    innovate(&p, &h, &y, &o);
    joint_before(&h, &o, z, P, H);
    const double before[3] = { z[3], z[4], z[5] };
    for (int a = 0; a < 3; a++) {
      e[a] = number(o.e[a]);
      R[a] = number(o.noise[a]);
      H[a][X_BIAS + a] = H[a][X_SLOW + a] = number(y.use[a]);
    }
    TEST_ASSERT_TRUE(number(o.m2) < number(TRUST_FROM));
    condition(z, P, H, e, R, fault > 0 && fault < FAULT_MEASURED);
    keep_relative(z, P, before);
    update(&p, &h, &y, &o);
    for (int i = 0; i < TSE_X; i++) {
      expect_near(z[i], number(h.x[i]), BY_FORMAT(1e-9, 2e-4) * (1 + fabs(z[i])), "mean", i);
      for (int j = 0; j < TSE_X; j++) {
        const double scale = sqrt(P[i][i] * P[j][j]) + 1e-12;
        expect_near(P[i][j], number(h.cov[i][j]), BY_FORMAT(1e-8, 5e-3) * scale + BY_FORMAT(1e-14, 2e-7), "covariance", 100 * i + j);
      }
    }
    for (int a = 0; a < 3; a++) {
      const double scale = sqrt(number(o.eps_var[a])) + 1e-9;
      expect_near(z[TSE_X + a], number(h.eps[a]), BY_FORMAT(1e-8, 1e-3) * scale, "eps", a);
      for (int b = 0; b < 3; b++)
        expect_near(P[TSE_X + a][TSE_X + b], number(h.eps_cov[a][b]), BY_FORMAT(1e-8, 1e-3) * scale * sqrt(number(o.eps_var[b])), "eps_cov", 10 * a + b);
      if (fault > 0 && fault < FAULT_MEASURED) continue; /* Schmidt's form leaves eps with X to the gain that it would have */
      for (int j = 0; j < TSE_X; j++) /* follow_level() scales X, not eps */
        expect_near(P[TSE_X + a][j], number(h.eps_x[a][j]), BY_FORMAT(1e-8, 1e-3) * scale * sqrt(P[j][j]) + 1e-9, "eps_x", 100 * a + j);
    }
  }
}

static void test_mean_covariance_and_eps_are_those_of_the_joint_gaussian(void) { expect_conditioned(FAULT_NONE); }
static void test_a_reading_at_fault_is_conditioned_on_with_its_noise(void) { expect_conditioned(FAULT_MEASURED + 1); }

/* Schmidt's considered parameters: right for a gain without the rows of the stiffness. */
static void test_with_an_input_at_fault_the_stiffness_is_considered_and_not_moved(void)
{
  const tse_params p = a_car();
  uint32_t seed = 22;
  double P[JOINT][JOINT], z[JOINT], H[3][JOINT], e[3], R[3];
  for (int fault = FAULT_STEER; fault < FAULT_MEASURED; fault++) {
    tse_hypothesis h = some_hypothesis(&p, &seed, 1, P);
    h.fault = fault;
    const sample y = some_sample(&seed, &h, 3, 7);
    const tse_hypothesis was = h;
    innovation o;
    innovate(&p, &h, &y, &o);
    joint_before(&h, &o, z, P, H);
    for (int a = 0; a < 3; a++) {
      e[a] = number(o.e[a]);
      R[a] = number(o.noise[a]);
      H[a][X_BIAS + a] = H[a][X_SLOW + a] = 1;
    }
    condition(z, P, H, e, R, 1);
    update(&p, &h, &y, &o);
    TEST_ASSERT_EQUAL_MEMORY(&was.x[3], &h.x[3], 3 * sizeof h.x[3]);
    const int trusted = number(o.m2) <= number(TRUST_FROM);
    for (int i = 3; i < 6; i++)
      for (int j = 3; j < 6; j++) expect_near(number(was.cov[i][j]), number(h.cov[i][j]), BY_FORMAT(1e-15, 1e-8), "covariance of the stiffness", 10 * i + j);
    for (int i = 0; trusted && i < TSE_X; i++) {
      expect_near(z[i], number(h.x[i]), BY_FORMAT(1e-9, 1e-3), "mean", i);
      for (int j = 0; j < TSE_X; j++)
        expect_near(P[i][j], number(h.cov[i][j]), BY_FORMAT(1e-8, 5e-3) * sqrt(P[i][i] * P[j][j]) + BY_FORMAT(0, 2e-7), "covariance", 100 * i + j);
    }
    TEST_ASSERT_EQUAL_MEMORY(was.spread_var, h.spread_var, sizeof h.spread_var);
    TEST_ASSERT_EQUAL_MEMORY(was.noise_var, h.noise_var, sizeof h.noise_var);
  }
}

static void test_the_further_off_a_sample_is_the_less_it_pulls(void)
{
  const tse_params p = a_car();
  uint32_t seed = 23;
  double P[JOINT][JOINT], last = 1e9;
  const tse_hypothesis h = some_hypothesis(&p, &seed, 1, P);
  sample y = some_sample(&seed, &h, 0, 2);
  innovation o;
  innovate(&p, &h, &y, &o);
  const double fit = -number(o.e[1]), sd = sqrt(number(o.s[1][1]));
  for (double off = 2; off < 5000; off *= 3) {
    tse_hypothesis moved = h;
    y.y[1] = real(fit + off * sd);
    innovate(&p, &h, &y, &o);
    update(&p, &moved, &y, &o);
    const double pull = (number(moved.x[X_BIAS + 1]) - number(h.x[X_BIAS + 1])) / off;
    const double linear = number(o.ph[1][X_BIAS + 1]) / sd, m2 = off * off;
    const double trust = m2 > number(TRUST_FROM) ? (number(EVIDENCE_DOF) + number(TRUST_FROM)) / (number(EVIDENCE_DOF) + m2) : 1;
    expect_near(linear * trust, pull, BY_FORMAT(1e-9, 1e-3) * fabs(linear * trust) + QUANTUM, "pull per sigma", (int)off);
    TEST_ASSERT_TRUE(fabs(pull) < last || off < 4);
    last = fabs(pull);
    for (int i = 0; i < TSE_X; i++) TEST_ASSERT_TRUE(number(moved.cov[i][i]) >= 0 && number(moved.cov[i][i]) <= number(h.cov[i][i]) * 4 + 1e-9);
  }
}

static void test_a_stiffness_stays_within_its_bounds(void)
{
  tse_config c;
  tse_config_default(&c);
  c.stiffness_min = setting(0.5);
  c.stiffness_max = setting(1.5);
  const tse_params p = prepared(&c);
  uint32_t seed = 24;
  double P[JOINT][JOINT];
  int low = 0, high = 0;
  for (int i = 0; i < 300; i++) {
    tse_hypothesis h = some_hypothesis(&p, &seed, 1, P);
    for (int a = 3; a < 6; a++) h.cov[a][a] = real(10);
    const sample y = some_sample(&seed, &h, 40, 7);
    innovation o;
    innovate(&p, &h, &y, &o);
    update(&p, &h, &y, &o);
    for (int a = 3; a < 6; a++) {
      TEST_ASSERT_TRUE(number(h.x[a]) >= 0.5 - 1e-6 && number(h.x[a]) <= 1.5 + 1e-6);
      low += number(h.x[a]) < 0.5 + 1e-6;
      high += number(h.x[a]) > 1.5 - 1e-6;
    }
    TEST_ASSERT_TRUE(fabs(number(h.x[2])) <= 20);
  }
  TEST_ASSERT_TRUE(low > 3 && high > 3);
}

static void test_what_is_not_made_of_numbers_is_not_proper(void)
{
  const tse_params p = a_car();
  uint32_t seed = 25;
  double P[JOINT][JOINT];
  const tse_hypothesis fine = some_hypothesis(&p, &seed, 1, P);
  TEST_ASSERT_TRUE(is_proper(&fine));
  for (int a = 0; a < TSE_X; a++) {
    tse_hypothesis h = fine;
    h.x[a] = real((double)NAN);
    TEST_ASSERT_TRUE(!is_proper(&h));
    h.x[a] = real((double)INFINITY);
    TEST_ASSERT_TRUE(!is_proper(&h));
    h = fine;
    h.cov[a][a] = real((double)NAN);
    TEST_ASSERT_TRUE(!is_proper(&h));
    h.cov[a][a] = real(-1e-6);
    TEST_ASSERT_TRUE(!is_proper(&h));
  }
#if !defined(TSE_REAL_FIXED)
  tse_hypothesis huge = fine; /* finite, and together nothing: sizes count, and are beyond all numbers */
  huge.x[X_BIAS] = real(BY_FORMAT(1.7e308, 3.4e38));
  huge.x[X_BIAS + 1] = -huge.x[X_BIAS];
  TEST_ASSERT_TRUE(!is_proper(&huge));
#endif
  tse_hypothesis lost = fine;
  lost.cov[1][1] = real(401);
  TEST_ASSERT_TRUE(!is_proper(&lost));
}

/* -------------------------------------------------------------------------------- a drive: a plain Kalman filter */

/* Motion linear and Gaussian but for what a hundredth of a rad leaves: 16 states, slopes by differences, nothing of the code. */
static void test_a_drive_agrees_with_a_plain_kalman_filter(void)
{
  const tse_params p = a_car();
  static const tse_real none[3] = { 0, 0, 0 };
  static double P[JOINT][JOINT], A[JOINT][JOINT], AP[JOINT][JOINT];
  uint32_t seed = 26;
  double z[JOINT] = { 20, 0, 0, 1, 1, 1 }, H[3][JOINT], R[3], spread[3], noise[3];
  tse_hypothesis h;
  memset(&h, 0, sizeof h);
  memset(P, 0, sizeof P);
  for (int a = 0; a < 3; a++) {
    h.x[3 + a] = real(1);
    P[a][a] = 1e-4;
    P[3 + a][3 + a] = 0.01;
    P[6 + a][6 + a] = 0.1;
    h.spread_var[a] = real(0.0025);
    h.noise_var[a] = real(1);
    h.info[a][a] = real(1);
    h.info[3 + a][3 + a] = real(2);
  }
  h.x[0] = real(20);
  for (int i = 0; i < TSE_X; i++) h.cov[i][i] = real(P[i][i]);
  double truth[3] = { 20, 0, 0 };
  inputs from = inputs_of(0, 20, 20);
  for (int k = 1; k <= 150; k++) {
    const double t = 0.01 * k;
    const inputs to = inputs_of(0.01 * sin(3 * t), 20 + 0.05 * sin(2 * t), 20 + 0.04 * sin(2 * t));
    tse_real x[3] = { real(truth[0]), real(truth[1]), real(truth[2]) };
    vehicle_advance(&p, x, vehicle_stiffness(&p, real(0.1), real(-0.1), real(0.05)), from, to, real(0.01));
    for (int a = 0; a < 3; a++) truth[a] = number(x[a]);
    sample y;
    memset(&y, 0, sizeof y);
    y.u = to;
    y.late_steer = to.steer;
    y.dt = real(0.01);
    y.used = 3;
    double at[JOINT] = { truth[0], truth[1], truth[2], 1.1, 0.9, 1.05 }, read[3];
    const double u[3] = { number(to.steer), number(to.v_front), number(to.v_rear) };
    for (int a = 0; a < 3; a++) y.use[a] = real(1);
    ref_forecast(&p, &y, at, u, read);
    for (int a = 0; a < 3; a++) y.y[a] = real(read[a] + next_between(&seed, -1.5, 1.5));

    /* the reference: forward ... */
    memset(A, 0, sizeof A);
    for (int i = 3; i < TSE_X; i++) A[i][i] = 1;
    const double step = BY_FORMAT(1e-5, 1e-2);
    double lo[3], hi[3];
    for (int i = 0; i < JOINT; i++) {
      for (int side = -1; side <= 1; side += 2) {
        double w[JOINT];
        memcpy(w, z, sizeof w);
        w[i] += side * step;
        tse_real s[3] = { real(w[0]), real(w[1]), real(w[2]) };
        vehicle_advance(&p, s, vehicle_stiffness(&p, real(w[3] - 1 + w[TSE_X]), real(w[4] - 1 + w[TSE_X + 1]), real(w[5] - 1 + w[TSE_X + 2])), from, to, real(0.01));
        for (int a = 0; a < 3; a++) (side < 0 ? lo : hi)[a] = number(s[a]);
      }
      for (int a = 0; a < 3; a++) A[a][i] = (hi[a] - lo[a]) / (2 * step);
    }
    tse_real s[3] = { real(z[0]), real(z[1]), real(z[2]) };
    vehicle_advance(&p, s, vehicle_stiffness(&p, real(z[3] - 1 + z[TSE_X]), real(z[4] - 1 + z[TSE_X + 1]), real(z[5] - 1 + z[TSE_X + 2])), from, to, real(0.01));
    for (int a = 0; a < 3; a++) {
      z[a] = number(s[a]);
      z[TSE_X + a] = 0;
      spread[a] = number(h.spread_var[a]); /* as found up to the row before */
      noise[a] = number(h.noise_var[a]);
    }
    for (int i = 0; i < JOINT; i++)
      for (int j = 0; j < JOINT; j++) {
        AP[i][j] = 0;
        for (int l = 0; l < JOINT; l++) AP[i][j] += A[i][l] * P[l][j];
      }
    for (int i = 0; i < JOINT; i++)
      for (int j = 0; j < JOINT; j++) {
        P[i][j] = 0;
        for (int l = 0; l < JOINT; l++) P[i][j] += AP[i][l] * A[j][l];
      }
    for (int a = 0; a < 3; a++) {
      P[3 + a][3 + a] += 0.01 * number(p.steady_walk) * pow(z[3 + a], 2);
      P[6 + a][6 + a] += 0.01 * number(p.bias_walk[a]);
      P[TSE_X + a][TSE_X + a] = spread[a] * pow(z[3 + a], 2);
      R[a] = noise[a];
    }
    /* ... and the sample */
    double e[3];
    const double before[3] = { z[3], z[4], z[5] };
    ref_forecast(&p, &y, z, u, read);
    ref_slopes(&p, &y, z, H);
    for (int a = 0; a < 3; a++) e[a] = number(y.y[a]) - read[a];
    condition(z, P, H, e, R, 0);
    keep_relative(z, P, before);

    innovation o;
    predict(&p, &h, steadily(from), steadily(to), none, real(0.01), NULL);
    innovate(&p, &h, &y, &o);
    TEST_ASSERT_TRUE(number(o.m2) < number(TRUST_FROM));
    update(&p, &h, &y, &o);
    from = to;
    for (int i = 0; i < 9; i++) {
      const double sd = sqrt(P[i][i]);
      expect_near(z[i], number(h.x[i]), BY_FORMAT(0.02, 0.1) * sd + BY_FORMAT(0, 5e-5), "mean", 100 * k + i);
      expect_near(sd, sqrt(number(h.cov[i][i])), BY_FORMAT(0.02, 0.1) * sd + BY_FORMAT(0, 5e-5), "sd", 100 * k + i);
    }
  }
  TEST_ASSERT_TRUE(P[4][4] < 0.005); /* something was learnt */
}

int main(void)
{
  UNITY_BEGIN();
  RUN_TEST(test_mean_covariance_and_eps_are_those_of_the_joint_gaussian);
  RUN_TEST(test_a_reading_at_fault_is_conditioned_on_with_its_noise);
  RUN_TEST(test_with_an_input_at_fault_the_stiffness_is_considered_and_not_moved);
  RUN_TEST(test_the_further_off_a_sample_is_the_less_it_pulls);
  RUN_TEST(test_a_stiffness_stays_within_its_bounds);
  RUN_TEST(test_what_is_not_made_of_numbers_is_not_proper);
  RUN_TEST(test_a_drive_agrees_with_a_plain_kalman_filter);
  return UNITY_END();
}
