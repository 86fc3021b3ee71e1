/* tests/unit/estimator/hypotheses/test_consider.c <-> src/estimator/hypotheses/consider.c: what a quantity that is told wrongly does to
 * forces and motion, by differences; its way through a row and a sample, by dense algebra. That the whole is the derivative of the
 * estimates by what is told: tests/lab/test_consider.py. */
#include "estimator/hypotheses/consider.c"

#include "unit_support.h"
#include "hypotheses_support.h"

static tse_bank b;
static uint32_t seed = 71;

static tse_config settings(double sd)
{
  tse_config c;
  tse_config_default(&c);
#define REAL(name, def, lo, hi, unit, text)
#define CONSIDER(id, name, most, unit, text) c.name = setting(sd);
#include "tse/told.def"
#undef REAL
  return c;
}

static void bank_of_one(const tse_params *p)
{
  double P[JOINT][JOINT];
  memset(&b, 0, sizeof b);
  b.count = 1;
  b.h[0] = some_hypothesis(p, &seed, 1, P);
  b.h[0].x[X_LAG] = real(0);
  for (int k = 0; k < TSE_CONSIDERED; k++)
    for (int i = 0; i < TSE_X; i++) b.off[k][i] = real(next_between(&seed, -0.1, 0.1));
  for (int i = 0; i < 5; i++) b.rate[i] = real(next_between(&seed, -3, 3));
}

/* Forces over mass - longitudinal, front, rear - and accelerations of vel_x, vel_y, yaw rate, when quantity k is off by q. */
static void forces_when_off(const tse_config *c, int k, const double x[6], const double in[3], double q, double force[3], double motion[3])
{
  tse_config wrong = *c;
  double u[3] = { in[0], in[1], in[2] };
  if (k == TSE_CONSIDER_INERTIA) wrong.yaw_inertia = setting(of_setting(c->yaw_inertia) * (1 + q));
  if (k == TSE_CONSIDER_CENTRE) {
    wrong.lf = setting(of_setting(c->lf) - q);
    wrong.lr = setting(of_setting(c->lr) + q);
  }
  if (k == TSE_CONSIDER_RATIO) u[0] *= 1 + q;
  if (k == TSE_CONSIDER_OFFSET) u[0] += q;
  if (k == TSE_CONSIDER_WHEELS_LATE) {
    u[1] += q * number(b.rate[3]);
    u[2] += q * number(b.rate[4]);
  }
  if (k == TSE_CONSIDER_RADIUS) u[2] *= 1 + q;
  const tse_params p = prepared(&wrong);
  ref_forces(&p, x, u, force);
  if (k == TSE_CONSIDER_RELAXATION) {
    force[1] -= q / fabs(x[0]) * number(b.rate[1]);
    force[2] -= q / fabs(x[0]) * number(b.rate[2]);
  }
  motion[0] = force[0];
  motion[1] = force[1] + force[2];
  motion[2] = number(p.jf) * force[1] - number(p.jr) * force[2];
}

/* 1 %: in float, where settings of both sides are rounded. */
static void test_what_each_quantity_adds_is_the_difference_of_the_forces(void)
{
  const tse_config c = settings(0.01);
  const tse_params p = prepared(&c);
  for (int i = 0; i < 50; i++)
    for (int k = 0; k < TSE_CONSIDERED; k++) {
      const double q = BY_FORMAT(1e-5, 1e-2);
      double x[6], lo[3], hi[3], lo_motion[3], hi_motion[3];
      bank_of_one(&p);
      for (int a = 0; a < 6; a++) x[a] = number(b.h[0].x[a]);
      const double v = x[0], u[3] = { next_between(&seed, -0.05, 0.05), v * next_between(&seed, 0.98, 1.02), v * next_between(&seed, 0.98, 1.02) };
      slopes s;
      addition a;
      slopes_of(&p, &b, inputs_of(u[0], u[1], u[2]), &s);
      add(&p, &b, k, inputs_of(u[0], u[1], u[2]), NULL, &s, &a);
      forces_when_off(&c, k, x, u, -q, lo, lo_motion);
      forces_when_off(&c, k, x, u, q, hi, hi_motion);
      const double by[3] = { number(a.x), number(a.front), number(a.rear) };
      for (int n = 0; n < 3; n++) {
        const double force = (hi[n] - lo[n]) / (2 * q), motion = (hi_motion[n] - lo_motion[n]) / (2 * q);
        expect_near(force, by[n], BY_FORMAT(1e-4, 1e-2) * (fabs(force) + 3), "force", 10 * k + n);
        expect_near(motion, number(a.motion[n]), BY_FORMAT(1e-4, 1e-2) * (fabs(motion) + 10), "motion", 10 * k + n);
      }
    }
}

/* What a sensor reads beside: a scale of accel_y its forecast; accelerometers that are late what they read before. */
static void test_what_the_accelerometers_read_beside(void)
{
  const tse_config c = settings(0.01);
  const tse_params p = prepared(&c);
  innovation o;
  slopes s;
  addition a;
  bank_of_one(&p);
  const sample y = some_sample(&seed, &b.h[0], 5, 7);
  innovate(&p, &b.h[0], &y, &o);
  slopes_of(&p, &b, y.u, &s);
  for (int k = 0; k < TSE_CONSIDERED; k++) {
    add(&p, &b, k, y.u, &o, &s, &a);
    const double scale = k == TSE_CONSIDER_SCALE, late = k == TSE_CONSIDER_ACCEL_LATE;
    for (int n = 0; n < 3; n++) expect_near(-late * number(b.rate[n]), number(a.late[n]), 1e-6, "what was felt before", 10 * k + n);
    expect_near(scale * number(o.forecast[1]), number(a.scale), 1e-6, "accel_y", k);
  }
}

static void test_an_error_goes_through_a_row_as_the_state_does(void)
{
  const tse_config c = settings(0.02);
  const tse_params p = prepared(&c);
  for (int i = 0; i < 20; i++) {
    transition t;
    slopes s;
    bank_of_one(&p);
    const double v = number(b.h[0].x[0]), dt = 0.01;
    const inputs from = inputs_of(0.01, v, v), u = inputs_of(next_between(&seed, -0.05, 0.05), v * 1.01, v * 0.995);
    for (int r = 0; r < 3; r++) {
      t.L[r] = real(next_between(&seed, -1, 1));
      for (int n = 0; n < 3; n++) {
        t.F[r][n] = real(next_between(&seed, -1, 1));
        t.G[r][n] = real(next_between(&seed, -1, 1));
      }
    }
    const tse_bank was = b;
    slopes first;
    slopes_of(&p, &b, from, &first);
    consider_begin(&p, &b, from);
    consider_passage(&p, &b, &t, u, real(dt)); /* the state stays: forces go by the inputs alone */
    slopes_of(&p, &b, u, &s);
    expect_near((number(s.x) - number(first.x)) / dt, number(b.rate[0]), BY_FORMAT(1e-9, 0.05), "rate of the longitudinal force", i);
    expect_near((number(s.front) - number(first.front)) / dt, number(b.rate[1]), BY_FORMAT(1e-9, 0.05), "rate of the front force", i);
    expect_near((number(s.rear) - number(first.rear)) / dt, number(b.rate[2]), BY_FORMAT(1e-9, 0.05), "rate of the rear force", i);
    expect_near(v * 0.01 / dt, number(b.rate[3]), BY_FORMAT(1e-9, 0.01), "rate of the front wheels", i);
    expect_near(-v * 0.005 / dt, number(b.rate[4]), BY_FORMAT(1e-9, 0.01), "rate of the rear wheels", i);
    for (int k = 0; k < TSE_CONSIDERED; k++) {
      addition a;
      add(&p, &b, k, u, NULL, &s, &a); /* with the rates of now, as it was */
      for (int r = 0; r < 3; r++) {
        double sum = number(t.L[r]) * number(was.off[k][X_LAG]) + 0.5 * dt * 0.02 * number(a.motion[r]);
        for (int n = 0; n < 3; n++) {
          sum += number(t.F[r][n]) * (number(was.off[k][n]) + 0.5 * dt * 0.02 * number(a.motion[n]));
          sum += number(t.G[r][n]) * number(was.off[k][X_STIFFNESS + n]);
        }
        expect_near(sum, number(b.off[k][r]), BY_FORMAT(1e-12, 1e-5), "state", 10 * k + r);
        expect_near(exp(-dt / number(DISTURBANCE_TIME)) * number(was.off[k][X_SLOW + r]), number(b.off[k][X_SLOW + r]), 1e-6, "disturbance", k);
        expect_near(number(was.off[k][X_STIFFNESS + r]), number(b.off[k][X_STIFFNESS + r]), 0, "stiffness", k);
      }
    }
  }
}

/* off - K (H off + D), K as the estimate has it; a missing channel has no part, and an input at fault teaches no stiffness. */
static void test_an_error_goes_through_a_sample_as_the_estimate_does(void)
{
  const tse_config c = settings(0.02);
  const tse_params p = prepared(&c);
  for (int i = 0; i < 40; i++) {
    const int mask = 1 + i % 7, fault = i % 5 == 4;
    innovation o;
    slopes s;
    bank_of_one(&p);
    b.h[0].fault = fault ? FAULT_STEER : FAULT_NONE;
    const sample y = some_sample(&seed, &b.h[0], 5, mask);
    innovate(&p, &b.h[0], &y, &o);
    const tse_bank was = b;
    consider_sample(&p, &b, &y, &o);
    slopes_of(&p, &was, y.u, &s);
    for (int k = 0; k < TSE_CONSIDERED; k++) {
      double e[3], K;
      addition a;
      add(&p, &was, k, y.u, &o, &s, &a);
      const double D[3] = { (number(a.x) + number(a.late[0])) * number(p.inv_sd[0]),
                            (number(a.front) + number(a.late[1]) + number(a.rear) + number(a.late[2])) * number(p.inv_sd[1]) + number(a.scale), 0 };
      for (int r = 0; r < 3; r++) {
        const double use = (mask >> r) & 1;
        e[r] = use * (number(was.off[k][X_BIAS + r]) + number(was.off[k][X_SLOW + r])) + number(o.lag[r]) * number(was.off[k][X_LAG]);
        if (use > 0) e[r] += 0.02 * D[r];
        for (int n = 0; n < 6; n++) e[r] += number(o.h[r][n]) * number(was.off[k][n]);
      }
      for (int n = 0; n < TSE_X; n++) {
        double moved = number(was.off[k][n]);
        for (int r = 0; r < 3; r++) {
          K = 0;
          for (int m = 0; m < 3; m++) K += number(o.ph[m][n]) * number(o.inv[m][r]);
          if (!(fault && n >= X_STIFFNESS && n < X_BIAS)) moved -= number(trust_of(&o)) * K * e[r];
        }
        expect_near(moved, number(b.off[k][n]), BY_FORMAT(1e-9, 1e-3) * (1 + fabs(moved)), "off", 100 * k + n);
      }
    }
  }
}

static void test_what_is_told_exactly_is_left_alone(void)
{
  const tse_config c = settings(0);
  const tse_params p = prepared(&c);
  transition t;
  innovation o;
  memset(&t, 0, sizeof t);
  TEST_ASSERT_EQUAL_INT(0, p.considers);
  bank_of_one(&p);
  const tse_bank was = b;
  const sample y = some_sample(&seed, &b.h[0], 5, 7);
  innovate(&p, &b.h[0], &y, &o);
  consider_passage(&p, &b, &t, y.u, real(0.01));
  consider_sample(&p, &b, &y, &o);
  TEST_ASSERT_EQUAL_MEMORY(was.off, b.off, sizeof was.off);
  for (int i = 0; i < TSE_X; i++) expect_near(0, number(considered_var(&p, &b, i)), 0, "variance", i);
}

/* A filter that is lost may see slopes of any size: what comes of it is large, and a number. */
static void test_errors_stay_numbers(void)
{
  const tse_config c = settings(0.02);
  const tse_params p = prepared(&c);
  innovation o;
  transition t;
  bank_of_one(&p);
  const sample y = some_sample(&seed, &b.h[0], 5, 7);
  innovate(&p, &b.h[0], &y, &o);
  memset(&t, 0, sizeof t);
  t.F[0][0] = real(1e30);
  t.F[1][1] = real((double)INFINITY);
  consider_passage(&p, &b, &t, y.u, real(0.01));
  o.ph[0][5] = real((double)INFINITY);
  consider_sample(&p, &b, &y, &o);
  for (int k = 0; k < TSE_CONSIDERED; k++)
    for (int i = 0; i < TSE_X; i++) TEST_ASSERT_TRUE(fabs(number(b.off[k][i])) <= 1e6);
}

static void test_the_variance_is_the_sum_of_their_squares_and_a_restart_forgets(void)
{
  const tse_config c = settings(0.02);
  const tse_params p = prepared(&c);
  bank_of_one(&p);
  for (int i = 0; i < TSE_X; i++) {
    double sum = 0;
    for (int k = 0; k < TSE_CONSIDERED; k++) sum += pow(number(b.off[k][i]), 2);
    expect_near(sum, number(considered_var(&p, &b, i)), BY_FORMAT(1e-12, 1e-6), "variance", i);
  }
  const tse_bank was = b;
  consider_restart(&b, 0);
  for (int k = 0; k < TSE_CONSIDERED; k++)
    for (int i = 0; i < TSE_X; i++) expect_near(i < 3 ? 0 : number(was.off[k][i]), number(b.off[k][i]), 0, "states", 100 * k + i);
  consider_restart(&b, 1);
  for (int i = 0; i < TSE_X; i++) expect_near(0, number(considered_var(&p, &b, i)), 0, "all", i);
}

static void test_what_to_tell_better_first(void)
{
  static tse_filter f;
  tse_real sd[3] = { real(7), real(7), real(7) };
  tse_config c = settings(0.02);
  c.mass_sd = setting(0.25);
  c.model_sd = setting(0.125);
  const tse_params p = prepared(&c);
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_reset(&p, &f, sizeof f));
  bank_of_one(&p);
  f.bank = b;
  for (int k = 0; k < TSE_TOLD; k++) {
    TEST_ASSERT_EQUAL_INT(TSE_OK, tse_told_sd(&p, &f, k, sd));
    for (int a = 0; a < 3; a++) {
      const double share = k == 0 ? 0.25 : k == TSE_TOLD - 1 ? 0.125 : 0;
      const double expected = share > 0 ? share * number(b.h[0].x[X_STIFFNESS + a]) : fabs(number(b.off[k - 1][X_STIFFNESS + a]));
      expect_near(expected, number(sd[a]), 1e-6, "sd", 10 * k + a);
    }
  }
  sd[0] = real(7);
  TEST_ASSERT_EQUAL_INT(TSE_E_SIZE, tse_told_sd(&p, &f, TSE_TOLD, sd));
  TEST_ASSERT_EQUAL_INT(TSE_E_SIZE, tse_told_sd(&p, &f, -1, sd));
  TEST_ASSERT_EQUAL_INT(TSE_E_NULL, tse_told_sd(NULL, &f, 0, sd));
  TEST_ASSERT_EQUAL_INT(TSE_E_NULL, tse_told_sd(&p, NULL, 0, sd));
  TEST_ASSERT_EQUAL_INT(TSE_E_NULL, tse_told_sd(&p, &f, 0, NULL));
  f.fingerprint++;
  TEST_ASSERT_EQUAL_INT(TSE_E_STATE, tse_told_sd(&p, &f, 0, sd));
  f.fingerprint--;
  f.magic++;
  TEST_ASSERT_EQUAL_INT_MESSAGE(TSE_E_STATE, tse_told_sd(&p, &f, 0, sd), "a filter without its mark");
  f.magic--;
  tse_params other = p;
  other.magic++;
  TEST_ASSERT_EQUAL_INT_MESSAGE(TSE_E_STATE, tse_told_sd(&other, &f, 0, sd), "parameters without their mark");
  other = p;
  other.form = 2;
  TEST_ASSERT_EQUAL_INT_MESSAGE(TSE_E_STATE, tse_told_sd(&other, &f, 0, sd), "of another form");
  expect_near(7, number(sd[0]), 0, "untouched", 0);
}

int main(void)
{
  UNITY_BEGIN();
  RUN_TEST(test_what_each_quantity_adds_is_the_difference_of_the_forces);
  RUN_TEST(test_what_the_accelerometers_read_beside);
  RUN_TEST(test_an_error_goes_through_a_row_as_the_state_does);
  RUN_TEST(test_an_error_goes_through_a_sample_as_the_estimate_does);
  RUN_TEST(test_what_is_told_exactly_is_left_alone);
  RUN_TEST(test_the_variance_is_the_sum_of_their_squares_and_a_restart_forgets);
  RUN_TEST(test_errors_stay_numbers);
  RUN_TEST(test_what_to_tell_better_first);
  return UNITY_END();
}
