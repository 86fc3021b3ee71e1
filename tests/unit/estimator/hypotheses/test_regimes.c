/* tests/unit/estimator/hypotheses/test_regimes.c <-> src/estimator/hypotheses/regimes.c: where a hypothesis starts; births, their prior
 * weight, number, place, and what they open. */
#include "estimator/hypotheses/regimes.h"

#include "unit_support.h"
#include "hypotheses_support.h"

static tse_bank b;
static uint32_t seed = 51;

static tse_config settings(void)
{
  tse_config c;
  tse_config_default(&c);
  c.inputs_held = 2;
  c.hypotheses = TSE_HYPOTHESES;
  return c;
}

/* A bank of one, whose like has learnt; every other kind waits for it. */
static sample bank_of_one(const tse_params *p, innovation *o, double off)
{
  double P[JOINT][JOINT];
  memset(&b, 0, sizeof b);
  b.count = 1;
  b.h[0] = some_hypothesis(p, &seed, 1, P);
  b.h[0].kind = KIND_RESTART;
  b.h[0].age = real(100);
  b.seen = real(20);
  const sample y = some_sample(&seed, &b.h[0], off, 7);
  innovate(p, &b.h[0], &y, o);
  return y;
}

static int born(int kind)
{
  for (int32_t i = 1; i < b.count; i++)
    if (b.h[i].kind == kind && number(b.h[i].age) <= 0) return i;
  return -1;
}

/* Rates as the header of the table says, for a bank that has seen `seen` seconds. */
static double rate(int kind, double seen)
{
  const double car = number(RATE_CAR) / (seen + number(RATE_CAR_TIME));
  if (kind == KIND_ROAD) return number(RATE_ROAD);
  if (kind == KIND_FRONT || kind == KIND_REAR) return number(RATE_AXLE);
  if (kind == KIND_DRIFT_SLOW || kind == KIND_DRIFT_FAST) return number(RATE_DRIFT);
  if (kind >= KIND_FAULT && kind < KIND_FAULT_END) return number(RATE_FAULT);
  if (kind >= KIND_LEVEL_UP && kind < KIND_RESTART) return car;
  if (kind == KIND_RESTART) return number(RATE_RESTART);
  if (kind == KIND_LOST) return b.h[0].slides ? number(RATE_LOST) : 0; /* rolling wheels tie the motion down */
  return kind == KIND_HOLD ? car : 0;
}

static void test_a_birth_weighs_its_rate_times_the_time_since_the_last_try_and_never_more_than_half(void)
{
  static const double dts[] = { 0.001, 0.01, 0.1, 60, 3600 }, waits[] = { 0, 1, 100 };
  const tse_config c = settings();
  const tse_params p = prepared(&c);
  for (int kind = 0; kind < TSE_KINDS; kind++)
    for (int i = 0; i < ROWS(dts); i++)
      for (int k = 0; k < ROWS(waits); k++) {
        innovation o;
        sample y = bank_of_one(&p, &o, 1);
        y.dt = real(dts[i]);
        b.h[0].slides = k % 2;
        y.u.v_rear = y.u.v_front;
        b.score[kind] = real(60); /* so that it is tried first */
        b.waited[kind] = real(waits[k]);
        births(&p, &b, &y, &o);
        const int at = born(kind);
        if (!(rate(kind, 20) > 0)) {
          TEST_ASSERT_EQUAL_INT(-1, at);
          continue;
        }
        TEST_ASSERT_TRUE(at > 0);
        const double weight = exp2(number(b.h[at].log_weight));
        expect_near(fmin(rate(kind, 20) * (waits[k] + dts[i]), 0.5), weight, BY_FORMAT(1e-9, 1e-4) * weight + QUANTUM, "weight", kind);
        expect_near(0, number(b.waited[kind]), 0, "waits anew", kind);
        expect_near(0, number(b.score[kind]), 0, "scores anew", kind);
      }
}

static void test_no_more_than_three_are_born_in_a_row_nor_than_the_settings_allow(void)
{
  tse_config c = settings();
  for (int n = 2; n <= TSE_HYPOTHESES; n++) {
    c.hypotheses = n;
    const tse_params p = prepared(&c);
    innovation o;
    const sample y = bank_of_one(&p, &o, 30);
    const tse_hypothesis first = b.h[0];
    for (int i = 0; i < 400; i++) {
      const int32_t before = b.count;
      births(&p, &b, &y, &o);
      TEST_ASSERT_TRUE(b.count <= before + 3 && b.count <= n);
      TEST_ASSERT_EQUAL_MEMORY(&first, &b.h[0], sizeof first); /* the likeliest is nobody's place */
      for (int32_t k = 0; k < b.count; k++) {
        b.h[k].age = real(number(b.h[k].age) + (k ? 0.01 : 0));
        if (k) b.h[k].log_weight = real(fmax(-80, number(b.h[k].log_weight) - 0.05));
      }
    }
    TEST_ASSERT_EQUAL_INT32(n, b.count);
  }
}

static void test_a_young_hypothesis_keeps_its_place_until_it_could_show_anything(void)
{
  tse_config c = settings();
  c.hypotheses = 2;
  const tse_params p = prepared(&c);
  for (int old = 0; old < 2; old++) {
    innovation o;
    const sample y = bank_of_one(&p, &o, 0.1);
    b.count = 2;
    b.h[1] = b.h[0];
    b.h[1].kind = KIND_ROAD;
    b.h[1].log_weight = real(-12);
    b.h[1].age = real(number(PROTECTED_TIME) + (old ? 0.01 : -0.01));
    for (int k = 0; k < TSE_KINDS; k++) b.waited[k] = real(0);
    b.waited[KIND_FRONT] = real(0.005 / number(RATE_AXLE)); /* worth 2^-7.6: more than the old, less than the young one */
    births(&p, &b, &y, &o);
    TEST_ASSERT_EQUAL_INT(2, b.count);
    TEST_ASSERT_EQUAL_INT(old ? KIND_FRONT : KIND_ROAD, b.h[1].kind);
  }
}

/* A road for which much evidence has gathered is not pushed out by a fault for which there is less, not even in the row of its birth. */
static void test_what_is_born_for_good_reasons_gives_way_to_better_ones_alone(void)
{
  tse_config c = settings();
  c.hypotheses = 2;
  c.inputs_held = 0;
  const tse_params p = prepared(&c);
  for (int less = 0; less < 2; less++) {
    innovation o;
    const sample y = bank_of_one(&p, &o, 0.1);
    for (int k = 0; k < TSE_KINDS; k++) b.waited[k] = real(1);
    b.score[KIND_ROAD] = real(30);
    births(&p, &b, &y, &o);
    TEST_ASSERT_EQUAL_INT(1, born(KIND_ROAD));
    const double prior = log2(number(RATE_ROAD) * 1.01), at_fault = log2(number(RATE_FAULT) * 1.01);
    expect_near(30, number(b.h[1].promise), 2, "promise", 0); /* this sample, which it leaves as it is, included */
    for (int k = 0; k < TSE_KINDS; k++) b.waited[k] = real(1), b.score[k] = real(0);
    b.score[KIND_FAULT] = real(prior - at_fault + 30 + number(YOUTH) + (less ? -20 : 20));
    births(&p, &b, &y, &o);
    TEST_ASSERT_EQUAL_INT(less ? KIND_ROAD : KIND_FAULT, b.h[1].kind);
  }
}

/* Where the likeliest has just changed, a channel is at fault of one that has not, for long or never, the likeliest of these. */
static void test_a_fault_is_born_of_who_has_not_just_changed(void)
{
  tse_config c = settings();
  const tse_params p = prepared(&c);
  for (int never = 0; never < 2; never++) {
    innovation o;
    const sample y = bank_of_one(&p, &o, 0.1);
    b.count = 5;
    for (int i = 1; i < b.count; i++) b.h[i] = b.h[0];
    for (int i = 0; i < b.count; i++) {
      b.h[i].x[X_BIAS] = real(0.01 * (i + 1)); /* by which a child is told */
      b.h[i].change_kind = TSE_CHANGE_ROAD;
      b.h[i].change_age = real(0.01);
      b.h[i].log_weight = real(-i);
    }
    b.h[2].change_kind = never ? TSE_CHANGE_NONE : TSE_CHANGE_ROAD;
    b.h[2].change_age = real(never ? 0 : number(PROTECTED_TIME) + 1);
    b.h[3].change_kind = TSE_CHANGE_NONE; /* less likely than that */
    b.h[4].change_age = PROTECTED_TIME; /* just old enough, and least likely */
    b.score[KIND_FAULT + 3] = real(60);
    b.waited[KIND_FAULT + 3] = real(1);
    births(&p, &b, &y, &o);
    const int child = born(KIND_FAULT + 3);
    TEST_ASSERT_TRUE(child > 0);
    expect_near(0.03, number(b.h[child].x[X_BIAS]), 1e-7, "mother", never);
  }
}

/* After next to no time nothing can have happened. */
static void test_a_row_of_almost_no_time_bears_nothing(void)
{
  const tse_config c = settings();
  const tse_params p = prepared(&c);
  innovation o;
  sample y = bank_of_one(&p, &o, 0.1);
  for (int k = 0; k < TSE_KINDS; k++) b.waited[k] = real(0);
  y.dt = real(1e-30);
  births(&p, &b, &y, &o);
#if defined(TSE_REAL_FIXED) /* in which 1e-30 is 0, and the logarithm of 0 that of a number below the smallest */
  for (int i = 1; i < b.count; i++) TEST_ASSERT_TRUE(b.h[i].log_weight <= real(-TSE_FRACTION_BITS));
#else
  TEST_ASSERT_EQUAL_INT32(1, b.count);
#endif
}

/* Every place of another sort is kept for it: a drift is not starved by what happens at once. */
static void test_each_sort_has_places_of_its_own(void)
{
  tse_config c = settings();
  const tse_params p = prepared(&c);
  innovation o;
  const sample y = bank_of_one(&p, &o, 0.1);
  b.count = TSE_HYPOTHESES;
  for (int i = 1; i < TSE_HYPOTHESES; i++) {
    b.h[i] = b.h[0];
    b.h[i].kind = i == 1 ? KIND_DRIFT_SLOW : KIND_ROAD;
    b.h[i].age = real(1000);
    b.h[i].log_weight = real(i == 1 ? -70 : -20);
  }
  for (int k = KIND_FAULT; k < KIND_FAULT_END; k++) b.score[k] = real(60);
  births(&p, &b, &y, &o);
  TEST_ASSERT_EQUAL_INT(KIND_DRIFT_SLOW, b.h[1].kind); /* the least likely of all, but the only one of its sort */
  TEST_ASSERT_TRUE(born(KIND_FAULT) > 1);
}

/* With one place beside the likeliest a drift may take it from what happens at once; with three each sort has its own. */
static void test_where_places_are_few_a_sort_without_its_own_may_take_any(void)
{
  const int32_t kinds[4] = { 0, KIND_ROAD, KIND_DRIFT_SLOW, KIND_LEVEL_UP };
  tse_config c = settings();
  for (int n = 2; n <= 4; n += 2) {
    c.hypotheses = n;
    const tse_params p = prepared(&c);
    innovation o;
    const sample y = bank_of_one(&p, &o, 0);
    b.count = n;
    for (int i = 1; i < n; i++) {
      b.h[i] = b.h[0];
      b.h[i].kind = kinds[i];
      b.h[i].age = real(1000);
      b.h[i].log_weight = real(-2); /* more than a birth for which nothing speaks */
    }
    for (int k = 0; k < TSE_KINDS; k++) b.waited[k] = real(1), b.score[k] = real(-60); /* nothing speaks for it, whatever the sample */
    b.score[KIND_DRIFT_FAST] = real(60);
    births(&p, &b, &y, &o);
    for (int i = 1; i < n; i++) TEST_ASSERT_EQUAL_INT(kinds[i] == KIND_DRIFT_SLOW || n == 2 ? KIND_DRIFT_FAST : kinds[i], b.h[i].kind);
  }
}

/* ------------------------------------------------------------------------------------- what a birth opens */

/* What a unit of each stiffness, changed two rows of 10 ms ago, has moved by its forces, by differences: states, stiffness. */
static void ref_shift(const tse_params *p, const tse_hypothesis *h, const sample *y, int which, double by, double u[6])
{
  double lo[3], hi[3], x[6];
  const double in[3] = { number(y->u.steer) + number(h->x[X_LAG]) * (number(y->late_steer) - number(y->u.steer)), number(y->u.v_front), number(y->u.v_rear) };
  for (int i = 0; i < 6; i++) x[i] = number(h->x[i]);
  x[3 + which] -= 1e-6;
  ref_forces(p, x, in, lo);
  x[3 + which] += 2e-6;
  ref_forces(p, x, in, hi);
  const double time = 2 * 0.01 * by / 2e-6, front = hi[1] - lo[1], rear = hi[2] - lo[2];
  u[0] += time * (hi[0] - lo[0]);
  u[1] += time * (front + rear);
  u[2] += time * (number(p->jf) * front - number(p->jr) * rear);
  u[3 + which] += by;
}

/* P of a change: along each stiffness's shift, along that of all for a road, and the states by how long ago it may have been. */
static void expect_opened(const tse_params *p, const tse_hypothesis *was, const tse_hypothesis *h, const sample *y, int kind)
{
  double more[6][6], all[6] = { 0, 0, 0, 0, 0, 0 };
  memset(more, 0, sizeof more);
  for (int a = 0; a < 3; a++) {
    double own[6] = { 0, 0, 0, 0, 0, 0 };
    const double level = fmax(number(was->x[3 + a]), number(ROAD_LEAST));
    if ((kind == KIND_FRONT && a == TSE_CY_REAR) || (kind == KIND_REAR && a != TSE_CY_REAR)) continue;
    ref_shift(p, was, y, a, level * (kind == KIND_ROAD ? number(ROAD_OWN) : number(AXLE_OPEN)), own);
    if (kind == KIND_ROAD) ref_shift(p, was, y, a, level * number(ROAD_COMMON), all);
    for (int i = 0; i < 6; i++)
      for (int j = 0; j < 6; j++) more[i][j] += own[i] * own[j];
  }
  for (int i = 0; i < 6; i++)
    for (int j = 0; j < 6; j++) more[i][j] += all[i] * all[j];
  for (int i = 0; i < 2; i++) more[i][i] += pow(0.4 * 2 * 0.01 * number(p->sd[i]) * number(was->foretold[i]), 2);
  more[2][2] += pow(number(p->sd[2]), 2);
  for (int i = 0; i < TSE_X; i++)
    for (int j = 0; j < TSE_X; j++) {
      const double opened = i < 6 && j < 6 ? more[i][j] : 0;
      expect_near(number(was->cov[i][j]) + opened, number(h->cov[i][j]), BY_FORMAT(1e-8, 1e-5) * (1 + fabs(opened)), "covariance", 100 * i + j);
    }
}

static void test_a_new_road_opens_all_stiffnesses_together_and_each_a_little(void)
{
  const tse_config c = settings();
  const tse_params p = prepared(&c);
  for (int i = 0; i < 20; i++) {
    innovation o;
    const sample y = bank_of_one(&p, &o, 1);
    if (i % 2) b.h[0].x[4] = real(0.3); /* from ice it goes up by a factor */
    b.h[0].foretold[0] = real(60);
    b.h[0].foretold[1] = real(-90);
    innovate(&p, &b.h[0], &y, &o);
    b.score[KIND_ROAD] = real(60);
    births(&p, &b, &y, &o);
    const tse_hypothesis *const h = &b.h[born(KIND_ROAD)], *const was = &b.h[0];
    expect_opened(&p, was, h, &y, KIND_ROAD);
    for (int a = 0; a < 3; a++) expect_near(number(was->x[3 + a]), number(h->before[a]), 0, "before", a);
    TEST_ASSERT_EQUAL_INT(TSE_CHANGE_ROAD, h->change_kind);
    for (int a = 0; a < 3; a++) TEST_ASSERT_TRUE(was->level[a] == 1 && h->level[a] == 0);
    expect_near(0, number(h->change_age), 0, "age of the change", 0);
  }
}

static void test_a_change_of_one_axle_opens_its_stiffnesses_alone(void)
{
  const tse_config c = settings();
  const tse_params p = prepared(&c);
  for (int kind = KIND_FRONT; kind <= KIND_REAR; kind++) {
    innovation o;
    const sample y = bank_of_one(&p, &o, 1);
    b.score[kind] = real(60);
    births(&p, &b, &y, &o);
    const tse_hypothesis *const h = &b.h[born(kind)];
    expect_opened(&p, &b.h[0], h, &y, kind);
    TEST_ASSERT_EQUAL_INT(kind == KIND_FRONT ? TSE_CHANGE_FRONT : TSE_CHANGE_REAR, h->change_kind);
  }
}

/* A change is promised what a variance along its shift would make of the sample, which may be in the yaw rate alone. */
static void test_a_change_is_promised_what_it_has_moved_by_now(void)
{
  const tse_config c = settings();
  const tse_params p = prepared(&c);
  int met = 0;
  for (int i = 0; i < 60; i++) {
    const int kind = i % 3;
    innovation o, wide;
    double u[6] = { 0, 0, 0, 0, 0, 0 };
    (void)bank_of_one(&p, &o, 1);
    const sample y = some_sample(&seed, &b.h[0], 30, 6); /* accel_x would feel the product of speed and stiffness, too */
    innovate(&p, &b.h[0], &y, &o);
    for (int a = 0; a < 3; a++)
      if (kind == KIND_ROAD || a == (kind == KIND_FRONT ? TSE_CY_FRONT : TSE_CY_REAR))
        ref_shift(&p, &b.h[0], &y, a, fmax(number(b.h[0].x[3 + a]), number(ROAD_LEAST)), u);
    const double sd = kind == KIND_ROAD ? number(ROAD_COMMON) : number(AXLE_OPEN);
    tse_hypothesis child = b.h[0];
    for (int k = 0; k < 6; k++)
      for (int n = 0; n < 6; n++) child.cov[k][n] = real(number(child.cov[k][n]) + sd * sd * u[k] * u[n]);
    innovate(&p, &child, &y, &wide);
    const double gain = number(student_cost(&o, o.m2)) - number(student_cost(&wide, wide.m2)) + 0.5 * (number(o.log2_det) - number(wide.log2_det));
    b.count = TSE_HYPOTHESES; /* no place: the score stays */
    for (int k = 1; k < TSE_HYPOTHESES; k++) {
      b.h[k] = b.h[0];
      b.h[k].log_weight = real(1000);
    }
    births(&p, &b, &y, &o);
    expect_near(fmax(gain, 0), number(b.score[kind]), 0.01 + 0.01 * fabs(gain), "score", i);
    met += gain > 1;
  }
  TEST_ASSERT_TRUE(met > 5);
}

/* A steering angle that lies has turned the car since two rows ago: P and the promise along what it has moved; wheels: P as it was. */
static void test_a_steering_angle_at_fault_opens_what_it_has_moved(void)
{
  const tse_config c = settings();
  const tse_params p = prepared(&c);
  const double sd = number(FAULT_STEER_SD);
  for (int kind = KIND_FAULT; kind < KIND_FAULT_END; kind++) {
    innovation o;
    const sample y = bank_of_one(&p, &o, 1);
    const tse_hypothesis was = b.h[0];
    double lo[3], hi[3], x[6], u[3] = { 0, 0, 0 };
    double in[3] = { number(y.u.steer) + number(was.x[X_LAG]) * (number(y.late_steer) - number(y.u.steer)), number(y.u.v_front), number(y.u.v_rear) };
    for (int i = 0; i < 6; i++) x[i] = number(was.x[i]);
    in[0] -= 1e-6;
    ref_forces(&p, x, in, lo);
    in[0] += 2e-6;
    ref_forces(&p, x, in, hi);
    const double time = kind == KIND_FAULT ? 2 * 0.01 * sd / 2e-6 : 0, front = hi[1] - lo[1];
    u[0] = time * (hi[0] - lo[0]);
    u[1] = time * front;
    u[2] = time * number(p.jf) * front;
    b.score[kind] = real(60);
    births(&p, &b, &y, &o);
    const tse_hypothesis *const h = &b.h[born(kind)];
    TEST_ASSERT_EQUAL_INT(1 + kind - KIND_FAULT, h->fault);
    for (int i = 0; i < TSE_X; i++)
      for (int j = 0; j < TSE_X; j++) {
        const double opened = i < 3 && j < 3 ? u[i] * u[j] : 0;
        expect_near(number(was.cov[i][j]) + opened, number(h->cov[i][j]), BY_FORMAT(1e-7, 1e-4) * (1e-3 + fabs(opened)), "covariance", 100 * i + j);
      }
    if (kind == KIND_FAULT) TEST_ASSERT_TRUE(u[2] * u[2] > 10 * BY_FORMAT(1e-7, 1e-4)); /* or the comparison would say nothing */
  }
}

static void test_other_births_change_what_they_stand_for(void)
{
  const tse_config c = settings();
  const tse_params p = prepared(&c);
  for (int kind = KIND_DRIFT_SLOW; kind < TSE_KINDS; kind++) {
    innovation o;
    const sample y = bank_of_one(&p, &o, 1);
    b.h[0].slides = kind == KIND_LOST;
    b.score[kind] = real(60);
    births(&p, &b, &y, &o);
    if (!(rate(kind, 20) > 0)) continue;
    const tse_hypothesis *const h = &b.h[born(kind)], *const parent = &b.h[0];
    const int a = kind >= KIND_LEVEL_DOWN ? kind - KIND_LEVEL_DOWN : kind - KIND_LEVEL_UP;
    if (kind <= KIND_DRIFT_FAST) {
      TEST_ASSERT_EQUAL_INT32(kind == KIND_DRIFT_SLOW ? DRIFTS_SLOWLY : DRIFTS_FAST, h->drift);
      expect_near(pow(kind == KIND_DRIFT_SLOW ? number(SLOW_RATE) : number(FAST_RATE), 2), number(h->cov[12][12]), 1e-9, "rate", kind);
      for (int j = 0; j < 12; j++) expect_near(0, number(h->cov[12][j]), 0, "rate with", j);
    } else if (kind < KIND_FAULT_END) TEST_ASSERT_EQUAL_INT32(1 + kind - KIND_FAULT, h->fault);
    else if (kind >= KIND_LEVEL_UP && kind < KIND_RESTART) {
      TEST_ASSERT_EQUAL_INT32(kind < KIND_LEVEL_DOWN ? 2 : 0, h->level[a]);
      const double more = kind < KIND_LEVEL_DOWN ? 8 * pow(number(DISTURBANCE_SHARE), 2) : 0; /* three times the sd: nine times, once there */
      expect_near(number(parent->cov[9 + a][9 + a]) + more, number(h->cov[9 + a][9 + a]), BY_FORMAT(1e-12, 1e-6), "disturbance", a);
    } else if (kind == KIND_HOLD) TEST_ASSERT_TRUE(h->held != parent->held);
    else if (kind == KIND_LOST) {
      expect_near(0.5 * (number(y.u.v_front) + number(y.u.v_rear)), number(h->x[0]), 1e-6, "vel_x", 0);
      for (int k = 0; k < 3; k++) {
        expect_near(number(parent->x[3 + k]), number(h->x[3 + k]), 0, "stiffness", k);
        expect_near(number(parent->cov[3 + k][3 + k]), number(h->cov[3 + k][3 + k]), 0, "variance", k);
        expect_near(0, number(h->cov[k][3 + k]), 0, "of states and stiffness", k);
      }
    }
    else if (kind == KIND_RESTART) {
      TEST_ASSERT_EQUAL_INT(TSE_CHANGE_RESTART, h->change_kind);
      for (int k = 0; k < 3; k++) {
        expect_near(1, number(h->x[3 + k]), 0, "stiffness", k);
        expect_near(0.09, number(h->cov[3 + k][3 + k]), 1e-6, "variance", k);
        expect_near(number(parent->x[3 + k]), number(h->before[k]), 0, "before", k);
      }
    }
  }
}

/* What cannot follow is not born: a fault's end without one, a steady drift's end, a level below none. */
static void test_a_fault_ends_and_a_drift_ends_where_there_is_one(void)
{
  const tse_config c = settings();
  const tse_params p = prepared(&c);
  innovation o;
  sample y = bank_of_one(&p, &o, 1);
  b.h[0].fault = FAULT_MEASURED;
  b.h[0].drift = DRIFTS_FAST;
  b.h[0].level[0] = 0;
  b.h[0].level[1] = LEVELS - 1;
  innovate(&p, &b.h[0], &y, &o);
  for (int k = 0; k < TSE_KINDS; k++) b.score[k] = real(60);
  for (int i = 0; i < 20; i++) {
    births(&p, &b, &y, &o);
    for (int k = 0; k < TSE_KINDS; k++) b.waited[k] = real(100);
    for (int32_t k = 1; k < b.count; k++) {
      const tse_hypothesis *const h = &b.h[k];
      TEST_ASSERT_TRUE(h->kind < KIND_FAULT || h->kind >= KIND_FAULT_END); /* one fault at a time */
      TEST_ASSERT_TRUE(h->kind != KIND_DRIFT_FAST && h->kind != KIND_LEVEL_DOWN && h->kind != KIND_LEVEL_UP + 1);
      if (h->kind == KIND_FAULT_END) TEST_ASSERT_EQUAL_INT32(FAULT_NONE, h->fault);
      if (h->kind == KIND_DRIFT_END) TEST_ASSERT_TRUE(h->drift == STEADY && number(h->cov[12][12]) <= 0);
      b.h[k].age = real(1000);
      b.h[k].log_weight = real(-80);
    }
    for (int k = 0; k < TSE_KINDS; k++) b.score[k] = real(i % TSE_KINDS == k ? 60 : 0);
  }
}

/* ------------------------------------------------------------------------------------------- its promise */

/* The score of a kind grows by what its child foretells better, where the child differs in a reading's variance. */
static void test_the_score_is_what_the_child_would_have_gained(void)
{
  const tse_config c = settings();
  const tse_params p = prepared(&c);
  int met = 0;
  for (int i = 0; i < 60; i++)
    for (int kind = KIND_FAULT + 3; kind < KIND_LEVEL_DOWN; kind++) {
      if (kind == KIND_FAULT_END) continue;
      innovation o, own;
      const sample y = bank_of_one(&p, &o, 6);
      tse_hypothesis child = b.h[0];
      if (kind < KIND_FAULT_END) child.fault = 1 + kind - KIND_FAULT;
      else {
        const int a = kind - KIND_LEVEL_UP;
        child.cov[9 + a][9 + a] = real(number(child.cov[9 + a][9 + a]) + 8 * pow(number(DISTURBANCE_SHARE), 2));
      }
      innovate(&p, &child, &y, &own);
      const double gain = number(student_cost(&o, o.m2)) - number(student_cost(&own, own.m2)) + 0.5 * (number(o.log2_det) - number(own.log2_det));
      b.count = TSE_HYPOTHESES; /* no place: the score stays */
      for (int k = 1; k < TSE_HYPOTHESES; k++) {
        b.h[k] = b.h[0];
        b.h[k].log_weight = real(1000);
      }
      births(&p, &b, &y, &o);
      expect_near(fmax(gain, 0), number(b.score[kind]), 0.02 + 0.02 * fabs(gain), "score", kind);
      met += gain > 1;
    }
  TEST_ASSERT_TRUE(met > 20);
}

/* A start foretells sensors to what it leaves unknown; its score grows by that, slowly. Where wheels slide, lost states alone. */
static void test_a_start_is_promised_what_the_sensors_are_foretold_by_it(void)
{
  const tse_config c = settings();
  const tse_params p = prepared(&c);
  for (int i = 0; i < 40; i++) {
    const int mask = i % 7 + 1, slides = i % 2, kind = slides ? KIND_LOST : KIND_RESTART;
    innovation o;
    (void)bank_of_one(&p, &o, 1);
    sample y = some_sample(&seed, &b.h[0], 40, mask);
    b.h[0].slides = slides;
    innovate(&p, &b.h[0], &y, &o);
    o.slides = slides;
    double det = 1, used = 0;
    for (int a = 0; a < 3; a++) {
      double var = 1;
      for (int k = 0; k < 3; k++) var += pow(number(o.h[a][k]) * number(p.x_sd0[k]), 2);
      if (!slides) var += number(p.mean_var0) * pow(number(y.y[a]), 2);
      det *= var;
      used += number(y.use[a]);
    }
    const double gain = 0.5 * (8 + used) * log2((8 + number(o.m2)) / (8 + used)) + 0.5 * (number(o.log2_det) - log2(det));
    b.count = TSE_HYPOTHESES; /* no place: the score stays */
    for (int k = 1; k < TSE_HYPOTHESES; k++) {
      b.h[k] = b.h[0];
      b.h[k].log_weight = real(1000);
    }
    births(&p, &b, &y, &o);
    expect_near(fmax(gain, 0) * 0.01 / (0.01 + number(PROTECTED_TIME)), number(b.score[kind]), BY_FORMAT(1e-9, 1e-3), "score", i);
    expect_near(0, number(b.score[slides ? KIND_RESTART : KIND_LOST]), 0, "of the other", i);
  }
}

/* --------------------------------------------------------------------------------------------- the start */

static void test_a_hypothesis_starts_at_the_settings_and_its_states_at_the_sensors(void)
{
  tse_config c = settings();
  c.initial_cy_front = setting(0.8);
  const tse_params p = prepared(&c);
  double P[JOINT][JOINT];
  tse_hypothesis h = some_hypothesis(&p, &seed, 0, P);
  sample y = some_sample(&seed, &h, 1, 7);
  y.u = inputs_of(0.01, 19, 21);
  y.y[2] = real(50);
  tse_start s;
  start_of_settings(&p, &s);
  start_hypothesis(&p, &h, &s, &y);
  expect_near(20, number(h.x[0]), BY_FORMAT(1e-12, 1e-5), "vel_x", 0);
  expect_near(0, number(h.x[1]), 0, "vel_y", 0);
  expect_near(50 * number(p.sd[2]), number(h.x[2]), 1e-6, "yaw rate", 0);
  expect_near(0.8, number(h.x[4]), 1e-6, "stiffness", 0);
  for (int a = 0; a < 3; a++) {
    expect_near(0.09, number(h.cov[3 + a][3 + a]), 1e-6, "variance of the mean", a);
    expect_near(number(p.initial_spread_var), number(h.spread_var[a]), 0, "spread", a);
    expect_near(1, number(h.noise_var[a]), 0, "noise", a);
    expect_near(number(p.bias_var0[a]), number(h.cov[6 + a][6 + a]), 0, "bias", a);
  }
  h.x[8] = real(3); /* later: placed anew, the bias is taken off, what was learnt stays */
  h.cov[4][0] = h.cov[0][4] = real(0.01);
  h.eps_cov[1][1] = real(1);
  place_states(&p, &h, &y);
  expect_near(47 * number(p.sd[2]), number(h.x[2]), 1e-6, "yaw rate", 1);
  expect_near(0.8, number(h.x[4]), 1e-6, "stiffness", 1);
  for (int a = 0; a < 3; a++)
    for (int j = 0; j < TSE_X; j++)
      if (j != a) expect_near(0, number(h.cov[a][j]), 0, "covariance", 10 * a + j);
  expect_near(0, number(h.eps_cov[1][1]), 0, "eps", 0);
}

int main(void)
{
  UNITY_BEGIN();
  RUN_TEST(test_a_birth_weighs_its_rate_times_the_time_since_the_last_try_and_never_more_than_half);
  RUN_TEST(test_no_more_than_three_are_born_in_a_row_nor_than_the_settings_allow);
  RUN_TEST(test_a_young_hypothesis_keeps_its_place_until_it_could_show_anything);
  RUN_TEST(test_what_is_born_for_good_reasons_gives_way_to_better_ones_alone);
  RUN_TEST(test_a_fault_is_born_of_who_has_not_just_changed);
  RUN_TEST(test_a_row_of_almost_no_time_bears_nothing);
  RUN_TEST(test_each_sort_has_places_of_its_own);
  RUN_TEST(test_where_places_are_few_a_sort_without_its_own_may_take_any);
  RUN_TEST(test_a_new_road_opens_all_stiffnesses_together_and_each_a_little);
  RUN_TEST(test_a_change_of_one_axle_opens_its_stiffnesses_alone);
  RUN_TEST(test_a_change_is_promised_what_it_has_moved_by_now);
  RUN_TEST(test_a_steering_angle_at_fault_opens_what_it_has_moved);
  RUN_TEST(test_other_births_change_what_they_stand_for);
  RUN_TEST(test_a_fault_ends_and_a_drift_ends_where_there_is_one);
  RUN_TEST(test_the_score_is_what_the_child_would_have_gained);
  RUN_TEST(test_a_start_is_promised_what_the_sensors_are_foretold_by_it);
  RUN_TEST(test_a_hypothesis_starts_at_the_settings_and_its_states_at_the_sensors);
  return UNITY_END();
}
