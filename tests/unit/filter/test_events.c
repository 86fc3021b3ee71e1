/* tests/unit/filter/test_events.c <-> src/filter/events.c, sensitivities.c,
 * slip_stiffness.c: likelihood and posterior of an event against two dense Kalman
 * filters, one of which has the event in its prior. They are linear, so that both are
 * exact. */
#include "filter/events.h"
#include "filter/sensitivities.h"
#include "filter_support.h"

/* A dense Kalman filter with its state in units. The last member is an offset of the
 * channel. */
enum { ALL = STATES + 1, OFFSET = STATES };

typedef struct plain {
  double x[ALL], p[ALL][ALL], log_likelihood;
} plain;

static void plain_move(plain *f, double F[STATES][STATES], const double q[MOTION])
{
  static double all[ALL][ALL];
  double x[ALL];
  for (int i = 0; i < ALL; i++) {
    x[i] = 0;
    for (int j = 0; j < ALL; j++) {
      all[i][j] = i < STATES && j < STATES ? F[i][j] : i == j;
      x[i] += all[i][j] * f->x[j];
    }
  }
  memcpy(f->x, x, sizeof x);
  conjugate(ALL, all[0], f->p[0], f->p[0]);
  for (int i = 0; i < MOTION; i++) f->p[i][i] += q[i];
}

static void plain_use(plain *f, const double h[ALL], double z, double r)
{
  double ph[ALL], s = r, e = z;
  for (int i = 0; i < ALL; i++) {
    ph[i] = 0;
    for (int j = 0; j < ALL; j++) ph[i] += f->p[i][j] * h[j];
    e -= h[i] * f->x[i];
  }
  for (int i = 0; i < ALL; i++) s += h[i] * ph[i];
  for (int i = 0; i < ALL; i++) {
    f->x[i] += ph[i] / s * e;
    for (int j = 0; j < ALL; j++) f->p[i][j] -= ph[i] * ph[j] / s;
  }
  f->log_likelihood -= 0.5 * (e * e / s + log(s));
}

/* The filter of the library and the two dense ones. */
typedef struct trio {
  tse_params p;
  tse_kalman k;
  double x[STATES];
  plain without, with;
  int n; /* index of the event */
} trio;

static void learn(tse_kalman *k, int channel, const tse_real h[STATES], const tse_real gain[STATES], double e,
    double s, double sd)
{
  tse_short room[STATES];
  r_sparse slopes;
  r_sparse_of(h, STATES, &slopes);
  const r_scaled scaled = r_scaled_of(gain, STATES, room);
  events_learn(k, channel, 0, &slopes, &scaled, real(e), real(s), real(sd));
}

static void start(
    trio *t, int32_t kind, double amplitude_of_state, double amplitude_of_channel, uint32_t *seed)
{
  memset(t, 0, sizeof *t);
  t->n = 7; /* sliding front wheels */
  any_covariance(&t->k.ud, seed);
  const dense m = dense_of(&t->k.ud);
  for (int i = 0; i < STATES; i++)
    for (int j = 0; j < STATES; j++) t->without.p[i][j] = t->with.p[i][j] = m.p[i][j];
  t->with.p[SF][SF] += amplitude_of_state * amplitude_of_state;
  t->with.p[OFFSET][OFFSET] = amplitude_of_channel * amplitude_of_channel;
  t->k.event[t->n].kind = kind, t->k.event[t->n].v[SF] = short_of(amplitude_of_state),
  t->p.log_min = real(-10);
  t->p.log_max = real(10);
}

/* Run rows of one channel, with a shifted state and an offset. Every other row comes
 * after some time.
 *   Given:  amplitude  sd of the offset, over the sd of the channel */
static void rows(trio *t, int count, int channel, double moved, double off, double sd, uint32_t *seed)
{
  for (int row = 0; row < count; row++) {
    tse_real h[TSE_ALL], f[TSE_ALL], v[TSE_ALL], gain[TSE_ALL];
    double dense_h[ALL], z, e;
    if (row % 2) {
      tse_short M[MOTION][PLACES];
      tse_real noise[MOTION];
      double F[STATES][STATES], q[MOTION], x[STATES];
      for (int i = 0; i < STATES; i++)
        for (int j = 0; j < STATES; j++) F[i][j] = i == j;
      for (int i = 0; i < MOTION; i++) {
        noise[i] = real(0.01);
        q[i] = number(noise[i]);
        for (int j = 0; j < COLUMNS; j++)
          M[i][j] = slope_of((i == j) * 0.9 + next_between(seed, -0.05, 0.05));
        for (int j = 0; j < STATES; j++) F[i][j] = number_of_slope(M[i][j]);
      }
      for (int i = 0; i < STATES; i++) {
        x[i] = 0;
        for (int j = 0; j < STATES; j++) x[i] += F[i][j] * t->x[j];
      }
      memcpy(t->x, x, sizeof x);
      sensitivities_move(&t->p, &t->k, M, real(0.01));
      ud_move(&t->k.ud, M, noise);
      plain_move(&t->without, F, q);
      plain_move(&t->with, F, q);
    }
    for (int i = 0; i < STATES; i++) {
      h[i] = next_uniform(seed) < 0.5 ? TSE_R(0) : real(next_between(seed, -1, 1));
      if (i == SF) h[i] = TSE_R(1);
      dense_h[i] = number(h[i]);
    }
    dense_h[OFFSET] = 1;
    const double r = sd * sd;
    z = moved * dense_h[SF] + off + sd * next_normal(seed);
    e = z;
    for (int i = 0; i < STATES; i++) e -= dense_h[i] * t->x[i];
    const double s = number(ud_measure(&t->k.ud, h, f, v)) + r;
    ud_correct(&t->k.ud, f, v, real(s - r), real(r), gain);
    learn(&t->k, channel, h, gain, e, s, sd);
    for (int i = 0; i < STATES; i++) t->x[i] += number(gain[i]) * e;
    plain_use(&t->without, dense_h, z, r);
    plain_use(&t->with, dense_h, z, r);
  }
}

/* Return the odds of the event to no event, as the filter computes them. */
static double odds(const trio *t)
{
  static tse_kalman k;
  k = t->k;
  events_decide(&t->p, &k, TSE_R(0));
  const double weight = number(k.weight[t->n]), small = event_is_small(&t->k, t->n) ? weight : 0;
  double none = 1;
  for (int g = 0; g < TSE_GROUPS; g++) none = fmin(none, number(k.none[g])); /* it is 1 in the other group */
  return weight / (none - small);
}

static void expect_ratio(trio *t, double before, const char *what)
{
  const double expected = t->with.log_likelihood - t->without.log_likelihood, actual = log(odds(t) / before);
  /* fixed point: a probability of 1e-4 has six digits */
  expect_near(expected, actual, BY_NUMBER(1e-8, 5e-3, 5e-3) * (1 + fabs(expected)), what, 0);
}

static void test_a_state_that_may_have_moved_is_as_likely_as_a_filter_that_knows_it(void)
{
  static trio t;
  uint32_t seed = 1;
  for (int n = 0; n < 40; n++) {
    start(&t, EVENT_SLIP_FRONT, 2, 0, &seed);
    const double before = odds(&t);
    TEST_ASSERT_TRUE(before > 0 && before < 1);
    rows(&t, 12, 0, n % 2 ? 1.5 : 0, 0, 1, &seed);
    expect_ratio(&t, before, "slip");
  }
}

/* The amplitude of the offset is that of the kind. It is inferred from the score after
 * one row. */
static void test_a_channel_that_may_be_off_is_as_likely_as_a_filter_that_knows_it(void)
{
  static trio t;
  static const int going[3] = { ACCEL_X, WHEEL_FRONT, WHEEL_REAR };
  uint32_t seed = 2;
  for (int n = 0; n < 30; n++) {
    tse_kalman one;
    tse_real h[TSE_ALL], gain[TSE_ALL];
    const int channel = going[n % 3];
    start(&t, EVENT_SENSOR + channel, 0, 0, &seed);
    one = t.k;
    for (int i = 0; i < STATES; i++) h[i] = gain[i] = TSE_R(0);
    learn(&one, channel, h, gain, 1, 1, 1); /* info: squared amplitude */
    const double amplitude = sqrt(number(one.event[t.n].info));
    TEST_ASSERT_TRUE(amplitude > 1);
    t.with.p[OFFSET][OFFSET] = pow(0.1 * amplitude, 2);
    const double before = odds(&t);
    rows(&t, 8, channel, 0, n % 2 ? 0.3 : 0, 0.1, &seed);
    expect_ratio(&t, before, "offset");
  }
}

/* Another road affects the axles differently: besides the amplitude for both axles there
 * is a second one. A forged state may lack it, or have one where it is not part of the
 * road. */
static void test_a_second_amplitude_is_that_of_a_filter_that_knows_both(void)
{
  static trio t;
  static const double first[3] = { 2, 0.7, 0.4 }, second[3] = { 0.5, -0.6, 0.8 };
  static const int at[3] = { SF, SR, STEER_OFFSET };
  enum { BEHIND = 2 }; /* index of the second of the road's two places */
  uint32_t seed = 10;
  double apart = 0;
  for (int n = 0; n < 42; n++) {
    const int lacks = n >= 40, slot = !lacks ? BEHIND : n == 40 ? 8 : 1;
    start(&t, EVENT_NONE, 2, 0, &seed);
    t.n = 0;
    t.with.p[SF][SF] -= 4;
    t.k.x[LCF] = t.k.x[LCR] = TSE_R(-3); /* with less grip than possible */
    t.k.event[0].kind = EVENT_ROAD, t.k.event[slot].kind = EVENT_ROAD_AXLE_DIFF;
    for (int i = 0; i < 3; i++) {
      t.k.event[0].v[at[i]] = short_of(first[i]), t.k.event[slot].v[at[i]] = short_of(second[i]);
      for (int j = 0; j < 3; j++)
        t.with.p[at[i]][at[j]] += first[i] * first[j] + (lacks ? 0 : second[i] * second[j]);
    }
    const double before = odds(&t);
    rows(&t, 12, YAW_RATE, n % 2 ? 1.5 : 0, 0, 1, &seed);
    expect_ratio(&t, before, "road");
    if (lacks) TEST_ASSERT_TRUE(t.k.event[slot].both == TSE_R(0));
    const event_posterior s = compute_posterior(&t.k, 0);
    const double close = BY_NUMBER(1e-9, 0.02, 1e-3);
    apart = fmax(apart, fabs(number(s.beside)));
    for (int i = 0; i < STATES; i++) {
      const double wi = number_of(t.k.event[BEHIND].v[i]),
                   vi = number_of(t.k.event[0].v[i]) - number(s.part) * wi;
      expect_near(
          t.with.x[i] - t.without.x[i], number(s.amplitude) * vi + number(s.beside) * wi, close, "state", i);
      for (int j = 0; j < STATES; j++) {
        const double wj = number_of(t.k.event[BEHIND].v[j]),
                     vj = number_of(t.k.event[0].v[j]) - number(s.part) * wj;
        expect_near(t.with.p[i][j] - t.without.p[i][j],
            number(s.var) * vi * vj + number(s.beside_var) * wi * wj, close, "covariance", 100 * i + j);
      }
    }
  }
  TEST_ASSERT_TRUE(apart > 0.5);
}

/* Without a second amplitude, its information is zero, not small. */
static void test_an_event_alone_has_no_second_amplitude(void)
{
  static trio t;
  uint32_t seed = 11;
  start(&t, EVENT_SLIP_FRONT, 2, 0, &seed);
  rows(&t, 6, 0, 1, 0, 1, &seed);
  const event_posterior s = compute_posterior(&t.k, t.n);
  TEST_ASSERT_NULL(s.second);
  expect_near(0, number(s.part), 0, "part", 0);
  expect_near(0, number(s.beside), 0, "mean beside", 0);
  expect_near(0, number(s.beside_var), 0, "variance beside", 0);
  TEST_ASSERT_TRUE(s.var > TSE_R(0));
}

/* After accepting an event, the state is that of the filter with the event, except for
 * the variance that the event adds. */
static void test_an_event_that_is_believed_leaves_the_state_of_a_filter_that_knows_it(void)
{
  static trio t;
  uint32_t seed = 3;
  for (int n = 0; n < 10; n++) {
    start(&t, EVENT_SLIP_FRONT, 30, 0, &seed);
    rows(&t, 40, 0, n % 2 ? 25 : -25, 0, 0.2, &seed);
    for (int i = 0; i < STATES; i++) t.k.x[i] = real(t.x[i] * number(state_unit[i]));
    events_decide(&t.p, &t.k, TSE_R(0));
    /* free, or newly opened */
    TEST_ASSERT_EQUAL_INT(
        EVENT_NONE == t.k.event[t.n].kind ? EVENT_NONE : EVENT_SLIP_FRONT, t.k.event[t.n].kind);
    const double close = BY_NUMBER(
        1e-7, 0.05, 1e-3); /* float: differences of 25 after a gain of 5 with 6e-8 */
    const dense m = dense_of(&t.k.ud);
    for (int i = 0; i < STATES; i++) {
      expect_near(t.with.x[i], number(t.k.x[i]) / number(state_unit[i]), close, "state", i);
      for (int j = 0; j < STATES; j++)
        if (i != SF || j != SF) expect_near(t.with.p[i][j], m.p[i][j], close, "covariance", 100 * i + j);
    }
    TEST_ASSERT_TRUE(m.p[SF][SF] >= t.with.p[SF][SF]);
  }
}

/* Dropping an event leaves mean and variance of the mixture of both filters, with the
 * square of its probability. */
static void test_an_event_that_is_given_up_leaves_what_the_state_may_be(void)
{
  static trio t;
  uint32_t seed = 5;
  int weighty = 0;
  for (int n = 0; n < 12; n++) {
    double weight = 0;
    start(&t, EVENT_NONE, 6, 0, &seed);
    t.n += 2; /* place of the steering angle */
    t.k.event[t.n].kind = EVENT_STEER, t.k.event[t.n].v[SF] = short_of(6);
    for (int row = 0; row < 60 && !(weight > 0.2); row++) {
      rows(&t, 2, ACCEL_Y, n % 2 ? 5 : -5, 0, 1, &seed);
      const double over = number(RATE_FAULT) * number(OPEN_TIME)
          * exp(t.with.log_likelihood - t.without.log_likelihood);
      weight = over / (1 + over);
    }
    if (weight > 0.9) continue; /* accepted */
    weighty += weight > 0.2;
    for (int i = 0; i < STATES; i++) t.k.x[i] = real(t.x[i] * number(state_unit[i]));
    t.k.event[t.n].age = OPEN_TIME;
    events_decide(&t.p, &t.k, TSE_R(0));
    TEST_ASSERT_EQUAL_INT(EVENT_STEER, t.k.event[t.n].kind);
    TEST_ASSERT_TRUE(number(t.k.event[t.n].age) == 0);
    const double w = weight * weight < number(MIN_WEIGHT) ? 0 : weight * weight,
                 close = BY_NUMBER(1e-6, 0.02, 2e-3);
    const dense m = dense_of(&t.k.ud);
    for (int i = 0; i < STATES; i++) {
      const double di = t.with.x[i] - t.without.x[i];
      expect_near(t.without.x[i] + w * di, number(t.k.x[i]) / number(state_unit[i]), close, "state", i);
      for (int j = 0; j < STATES; j++)
        if (i != STEER_OFFSET || j != STEER_OFFSET) /* its own variance is increased as much */
          expect_near((1 - w) * t.without.p[i][j] + w * t.with.p[i][j]
                  + w * (1 - w) * di * (t.with.x[j] - t.without.x[j]),
              m.p[i][j], close, "covariance", 100 * i + j);
      expect_near(w * pow(number(STEER_ACCEPTED_SD) / number(state_unit[STEER_OFFSET]), 2),
          m.p[STEER_OFFSET][STEER_OFFSET] - (1 - w) * t.without.p[STEER_OFFSET][STEER_OFFSET]
              - w * t.with.p[STEER_OFFSET][STEER_OFFSET]
              - w * (1 - w) * pow(t.with.x[STEER_OFFSET] - t.without.x[STEER_OFFSET], 2),
          close, "own", i);
    }
  }
  TEST_ASSERT_TRUE(weighty >= 3);
}

/* On a return to the previous value the amplitude is known: the result is that of a
 * filter that starts there. */
static void test_tyres_that_are_back_are_as_likely_as_a_filter_that_starts_there(void)
{
  static trio t;
  uint32_t seed = 5;
  for (int n = 0; n < 20; n++) {
    start(&t, EVENT_ROAD_RETURN, 2, 0, &seed);
    t.with.p[SF][SF] = t.without.p[SF][SF], t.with.x[SF] = 2;
    const double before = odds(&t);
    rows(&t, 12, n % 5, n % 2 ? 2 : 0, 0, 1, &seed);
    expect_ratio(&t, before, "back");
  }
}

/* A change that reverses an earlier one: each stiffness returns to its earlier value,
 * with its earlier sd. */
static void test_tyres_that_are_back_are_known_as_before(void)
{
  static trio t;
  uint32_t seed = 6;
  for (int n = 0; n < 10; n++) {
    double h[ALL], was[STATES];
    start(&t, EVENT_ROAD_RETURN, 0, 0, &seed);
    t.k.change_kind = TSE_CHANGE_REAR, t.k.change_age = TSE_R(1);
    for (int i = LCX; i <= LMU; i++) {
      t.k.x[i] = real(next_between(&seed, -0.5, 0.5));
      t.k.change_from[i - LCX] = real(next_between(&seed, -0.5, 0.5));
      t.k.change_from_var[i - LCX] = n % 2
          ? TSE_R(0)
          : real(next_between(&seed, 0.1, 1)); /* 0: as accurate as a recalled value can be */
    }
    for (int i = 0; i < STATES; i++) {
      was[i] = number(t.k.x[i]);
      t.k.event[t.n].v[i] = short_of(next_between(&seed, 0, 2));
      t.without.x[i] = (was[i] + number_of(t.k.event[t.n].v[i]) * number(state_unit[i]))
          / number(state_unit[i]);
      if (i >= LCX && i <= LMU)
        t.without.x[i] = (was[i] + log(1 + number_of(t.k.event[t.n].v[i]) * number(state_unit[i])))
            / number(state_unit[i]);
    }
    t.k.event[t.n].score = TSE_R(60), t.k.event[t.n].info = TSE_R(60);
    t.k.along.mean = real(0.2), t.k.along.var = real(0.03), t.k.along_from.mean = real(-0.1),
    t.k.along_from.var = real(0.01);
    for (int i = LCX; i <= LMU; i++) {
      memset(h, 0, sizeof h);
      h[i] = 1;
      plain_use(&t.without, h, number(t.k.change_from[i - LCX]) / number(state_unit[i]),
          n % 2 ? number(MIN_RECALL_VAR) : number(t.k.change_from_var[i - LCX]));
    }
    const dense p_was = dense_of(&t.k.ud);
    t.k.slow[ACCEL_X] = real(0.25);
    events_decide(&t.p, &t.k, TSE_R(0));
    const double close = BY_NUMBER(1e-9, 1e-4, 1e-4);
    const dense m = dense_of(&t.k.ud);
    for (int i = 0; i < STATES; i++) {
      expect_near(t.without.x[i], number(t.k.x[i]) / number(state_unit[i]),
          close * (1 + fabs(t.without.x[i])), "state", i);
      for (int j = 0; j < STATES; j++)
        expect_near(t.without.p[i][j], m.p[i][j], close * 10, "covariance", 100 * i + j);
    }
    for (int i = LCX; i <= LMU; i++) { /* the value that it came from, too */
      expect_near(was[i], number(t.k.change_from[i - LCX]), 1e-6, "before", i);
      expect_near(p_was.p[i][i], number(t.k.change_from_var[i - LCX]), close, "its variance", i);
    }
    expect_near(-0.1, number(t.k.along.mean), 1e-6, "slip stiffness as before", 0);
    expect_near(0.01, number(t.k.along.var), 1e-6, "its variance", 0);
    expect_near(0.2, number(t.k.along_from.mean), 1e-6, "slip stiffness in between", 0);
    TEST_ASSERT_EQUAL_INT(TSE_CHANGE_ROAD, t.k.change_kind);
    expect_near(0, number(t.k.change_age), 0, "a change of its own", 0);
  }
}

/* An event accepted soon after a change belongs to that change. Later it is a new one. */
static void test_a_change_is_reported_once(void)
{
  static trio t;
  uint32_t seed = 7;
  for (int later = 0; later < 2; later++) {
    start(&t, EVENT_REAR, 0, 0, &seed);
    t.p.car.driven = 1; /* the front axle */
    t.k.event[t.n].age = SETTLE_TIME;
    t.k.event[t.n].v[LCR] = short_of(1), t.k.event[t.n].score = TSE_R(-60), t.k.event[t.n].info = TSE_R(30);
    t.k.change_kind = TSE_CHANGE_ROAD;
    t.k.change_age = real(later ? 10 : 0.5);
    t.k.change_from[LCR - LCX] = real(0.25);
    t.k.along.mean = real(0.2),
    t.k.along.var = real(0.03);     /* an axle that is not driven has no slip stiffness */
    t.k.fault = fault_of(YAW_RATE); /* what looked like a fault may have been the change */
    events_decide(&t.p, &t.k, TSE_R(0));
    TEST_ASSERT_EQUAL_INT(TSE_CHANGE_REAR, t.k.change_kind);
    TEST_ASSERT_EQUAL_INT(NO_FAULT, t.k.fault);
    TEST_ASSERT_TRUE(number(t.k.x[LCR]) < 0);
    expect_near(later ? 0 : 0.5, number(t.k.change_age), 1e-6, "age", later);
    expect_near(0.2, number(t.k.along.mean), 1e-6, "slip stiffness", later);
    expect_near(0.03, number(t.k.along.var), 1e-6, "its variance", later);
    expect_near(later ? 0 : 0.25, number(t.k.change_from[LCR - LCX]), 1e-6, "stiffness before it", later);
  }
}

/* The prior is for a road with grip: more grip is as improbable as it states. Less grip,
 * or a moderate gain, is not. */
static void test_another_road_gives_no_more_grip_than_there_is(void)
{
  static trio t;
  uint32_t seed = 9;
  const double at[4] = { 0, 0, -2, 0.1 }, score[4] = { -12, 12, 12, 12 }, info = 20,
               unit = number(state_unit[LCR]);
  double stated[4];
  for (int n = 0; n < 4; n++) {
    start(&t, EVENT_ROAD, 0, 0, &seed);
    t.p.prior_sd[LCR] = real(0.2), t.k.x[LCR] = real(at[n]), t.k.event[t.n].v[LCR] = short_of(0.4 / unit);
    t.k.event[t.n].score = real(score[n]), t.k.event[t.n].info = real(info);
    stated[n] = log(odds(&t));
    const double beyond = at[n] + log(1 + 0.4 * score[n] / (1 + info)),
                 sd = hypot(0.2, number(USUAL_MODEL_SD));
    const double less = score[n] > 0 && beyond > 0 ? 0.5 * beyond * beyond / (sd * sd) : 0;
    expect_near(
        stated[0] - less, stated[n], 0.02, "odds", n); /* logarithm to second order, weights of six digits */
  }
  TEST_ASSERT_TRUE(stated[1] < stated[0] - 0.4 && stated[3] < stated[1] - 0.4);
}

/* A dropped change of road may have happened: the variance of the slip stiffness grows
 * accordingly, and so does that of its earlier estimate. */
static void test_a_road_that_is_given_up_opens_the_slip_stiffness(void)
{
  static tse_kalman k;
  static tse_params p;
  memset(&k, 0, sizeof k);
  memset(&p, 0, sizeof p);
  p.log_min = real(-10), p.log_max = real(10);
  for (int i = LCX; i <= LMU; i++) p.prior_sd[i] = real(0.1);
  for (int n = 0; n < 300; n++) events_decide(&p, &k, real(0.01));
  int road = -1;
  for (int n = 0; n < TSE_EVENTS && road < 0; n++)
    if (k.event[n].kind == EVENT_ROAD) road = n;
  TEST_ASSERT_TRUE(road >= 0);
  for (int n = 0; n < TSE_EVENTS; n++) k.event[n].age = OPEN_TIME;
  k.event[road].age = ROAD_TIME, k.event[road].score = real(-12.3), k.event[road].info = TSE_R(6);
  const double before = number(ud_variance(&k.ud, LCX)), before_all = number(k.along.var),
               unit = pow(number(state_unit[LCX]), 2);
  events_decide(&p, &k, TSE_R(0));
  TEST_ASSERT_TRUE(number(k.event[road].age) == 0);
  /* By hand: half of score^2 / (1 + info), and the normalisation. Another road, two axles
   * and three channels are as opened. */
  const double one = number(RATE_ROAD) * number(OPEN_TIME), over = one * exp(0.5 * 12.3 * 12.3 / 7) / sqrt(7),
               other = number(RATE_FAULT) * number(OPEN_TIME);
  const double axle = number(RATE_ROAD) * number(OPEN_TIME);
  const double w = pow(over / (1 + over + one + 2 * axle + 3 * other), 2),
               moved = number(OWN_SHARE) * log(1 - w * 12.3 / 7 * number(CHANGE_SD));
  const double opened = w * (pow(2 * number(USUAL_MODEL_SD), 2) + moved * moved);
  TEST_ASSERT_TRUE(w > 0.05 && w < 0.8);
  expect_near(
      opened, (number(ud_variance(&k.ud, LCX)) - before) * unit, BY_NUMBER(1e-6, 1e-4, 1e-4), "opened", 0);
  expect_near(opened, number(k.along.var) - before_all, BY_NUMBER(1e-6, 1e-4, 1e-4), "found before", 0);
}

/* An accepted change of road: the part of the earlier estimate of the slip stiffness that
 * is due to the tyres is kept, P - w (P - V) of its variance P. The variance that the
 * road adds is unknown. From then on the state holds the slip stiffness. */
static void test_a_road_that_is_believed_begins_the_slip_stiffness_anew(void)
{
  static trio t;
  uint32_t seed = 12;
  const double unit = number(state_unit[LCX]);
  for (int n = 0; n < 6; n++) {
    start(&t, EVENT_NONE, 0, 0, &seed);
    t.k.event[0].kind = EVENT_ROAD, t.k.event[0].v[LCF] = short_of(0.3 / number(state_unit[LCF]));
    t.k.event[0].score = TSE_R(-60), t.k.event[0].info = TSE_R(30);
    t.k.x[LCX] = real(next_between(&seed, -0.3, 0.3));
    const double own = dense_of(&t.k.ud).p[LCX][LCX] * unit * unit,
                 before = own + next_between(&seed, 0.01, 0.04), was = number(t.k.x[LCF]);
    t.k.along.mean = real(0.7), t.k.along.var = real(before);
    events_decide(&t.p, &t.k, TSE_R(0));
    expect_near(0, number(t.k.slow[ACCEL_X]), 0, "explained", n);
    TEST_ASSERT_EQUAL_INT(TSE_CHANGE_ROAD, t.k.change_kind);
    const double lacks = pow(number(USUAL_MODEL_SD), 2),
                 share = before * before / (before * before + lacks * (before - own));
    const double opened = pow(2 * number(USUAL_MODEL_SD), 2)
        + pow(number(OWN_SHARE) * (number(t.k.x[LCF]) - was), 2);
    TEST_ASSERT_TRUE(number(t.k.x[LCF]) < was - 0.1);
    expect_near(before - share * (before - own) + opened, number(t.k.along.var), BY_NUMBER(1e-9, 1e-5, 1e-5),
        "variance", n);
    expect_near(number(t.k.x[LCX]), number(t.k.along.mean), 0, "mean", n);
    expect_near(0.7, number(t.k.along_from.mean), 1e-6, "mean before", n);
    expect_near(before, number(t.k.along_from.var), 1e-6, "variance before", n);
  }
}

/* Driving nearly straight gives little information: the most probable event of a kind is
 * kept for seconds, but not forever. */
static void test_the_likeliest_event_keeps_its_place(void)
{
  static tse_kalman k;
  static tse_params p;
  memset(&k, 0, sizeof k);
  memset(&p, 0, sizeof p);
  for (int n = 0; n < 300; n++)
    events_decide(&p, &k, real(0.01)); /* ages are constant: all places of the kind are used in turn */
  int kept = -1;
  for (int n = 0; n < TSE_EVENTS && kept < 0; n++)
    if (k.event[n].kind == EVENT_ROAD) kept = n;
  TEST_ASSERT_TRUE(kept >= 0);
  double left_at = 0;
  for (int n = 0; n < 3000 && !(left_at > 0); n++) {
    for (int i = 0; i < TSE_EVENTS; i++) k.event[i].age += real(0.01);
    k.event[kept].score = TSE_R(-3); /* more probable than the others, but not accepted */
    k.event[kept].info = TSE_R(3);
    const double age = number(k.event[kept].age);
    events_decide(&p, &k, real(0.01));
    if (number(k.event[kept].age) < age) left_at = age;
  }
  expect_near(number(ROAD_TIME), left_at, number(OPEN_TIME), "kept for", kept);
}

/* The same for an event of an axle, while it is more probable than no event. */
static void test_an_axle_keeps_its_place_while_it_is_likely(void)
{
  for (int likely = 0; likely < 2; likely++) {
    static tse_kalman k;
    static tse_params p;
    int at = -1;
    double left_at = 0;
    memset(&k, 0, sizeof k);
    memset(&p, 0, sizeof p);
    for (int n = 0; n < 300; n++) events_decide(&p, &k, real(0.01));
    for (int n = 0; n < TSE_EVENTS; n++)
      if (k.event[n].kind == EVENT_REAR) at = n;
    TEST_ASSERT_TRUE(at >= 0);
    for (int n = 0; n < 3000 && !(left_at > 0); n++) {
      for (int i = 0; i < TSE_EVENTS; i++) k.event[i].age += real(0.01);
      k.event[at].score = TSE_R(-3);
      k.event[at].info = real(likely ? 3 : 300);
      const double age = number(k.event[at].age);
      events_decide(&p, &k, real(0.01));
      if (number(k.event[at].age) < age) left_at = age;
    }
    expect_near(number(likely ? ROAD_TIME : OPEN_TIME), left_at, 0.02, "kept for", likely);
  }
}

/* Misfits after a change are still being estimated: they are no fault until the tyres
 * have settled. */
static void test_soon_after_a_change_nothing_is_a_fault(void)
{
  static trio t;
  uint32_t seed = 8;
  for (int later = 0; later < 2; later++) {
    start(&t, EVENT_STEER, 0, 0, &seed);
    t.k.event[t.n].v[STEER_OFFSET] = short_of(1), t.k.event[t.n].score = TSE_R(60),
    t.k.event[t.n].info = TSE_R(30);
    t.k.change_kind = TSE_CHANGE_ROAD;
    t.k.change_age = real(later ? 10 : 0.5);
    events_decide(&t.p, &t.k, TSE_R(0));
    TEST_ASSERT_EQUAL_INT(later ? (int32_t)FAULT_STEER : (int32_t)NO_FAULT, t.k.fault);
  }
}

static void test_without_evidence_nothing_is_believed(void)
{
  static trio t;
  uint32_t seed = 4;
  int believed = 0;
  for (int n = 0; n < 50; n++) {
    start(&t, EVENT_SLIP_FRONT, 3, 0, &seed);
    rows(&t, 20, 0, 0, 0, 1, &seed);
    const tse_ud before = t.k.ud;
    events_decide(&t.p, &t.k, TSE_R(0));
    believed += memcmp(&before, &t.k.ud, sizeof before) != 0;
  }
  TEST_ASSERT_EQUAL_INT(0, believed);
}

/* Every event gets a place sooner or later, and no place keeps an impossible event. */
static void test_events_are_opened_in_turn(void)
{
  static tse_kalman k;
  static tse_params p;
  int opened[EVENT_KINDS] = { 0 }, before = 0;
  memset(&k, 0, sizeof k);
  memset(&p, 0, sizeof p);
  for (int n = 0; n < 4000; n++) {
    if (n == 2000) { /* from here on there is a previous value to return to */
      before = opened[EVENT_ROAD_RETURN];
      k.change_kind = TSE_CHANGE_ROAD, k.change_age = TSE_R(100);
    }
    tse_short M[MOTION][PLACES];
    for (int i = 0; i < MOTION; i++)
      for (int j = 0; j < COLUMNS; j++) M[i][j] = slope_of(i == j);
    sensitivities_move(&p, &k, M, real(0.01));
    events_decide(&p, &k, real(0.01));
    for (int i = 0; i < TSE_EVENTS; i++) {
      TEST_ASSERT_TRUE(k.event[i].kind >= EVENT_NONE && k.event[i].kind < EVENT_KINDS);
      if (!(k.event[i].age > TSE_R(0))) opened[k.event[i].kind]++;
    }
    TEST_ASSERT_EQUAL_INT(n < 2000 ? TSE_CHANGE_NONE : TSE_CHANGE_ROAD, k.change_kind);
    for (int g = 0; g < TSE_GROUPS; g++) TEST_ASSERT_TRUE(number(k.none[g]) > 0.95);
  }
  TEST_ASSERT_EQUAL_INT(0, before);
  const int once = opened[EVENT_ROAD_RETURN];
  for (int i = 0; i < 4; i++) k.change_from_var[i] = TSE_R(1); /* it was less certain then */
  for (int n = 0; n < TSE_EVENTS; n++) k.event[n].kind = EVENT_NONE;
  events_decide(&p, &k, real(0.01));
  for (int n = 0; n < TSE_EVENTS; n++) opened[EVENT_ROAD_RETURN] += k.event[n].kind == EVENT_ROAD_RETURN;
  TEST_ASSERT_EQUAL_INT(once, opened[EVENT_ROAD_RETURN]);
  for (int i = EVENT_NONE + 1; i < EVENT_KINDS; i++) TEST_ASSERT_TRUE(opened[i] > 1);
}

static void test_where_the_motion_is_placed_anew_events_know_nothing_of_it(void)
{
  static tse_kalman k;
  memset(&k, 0, sizeof k);
  for (int n = 0; n < TSE_EVENTS; n++)
    for (int i = 0; i < STATES; i++) k.event[n].v[i] = short_of(1);
  for (int q = 0; q < TSE_CONSIDERED; q++)
    for (int i = 0; i < STATES; i++) k.consider[q][i] = short_of(1);
  sensitivities_clear(&k, GX);
  for (int i = 0; i < STATES; i++) {
    for (int n = 0; n < TSE_EVENTS; n++) expect_near(i >= GX, number_of(k.event[n].v[i]), 0, "event", i);
    for (int q = 0; q < TSE_CONSIDERED; q++)
      expect_near(i >= GX, number_of(k.consider[q][i]), 0, "uncertain", i);
  }
}

/* A channel found at fault is left out until it agrees again; earlier agreement does not
 * count. The steering angle, whose offset is estimated anew, returns after a time
 * only. */
static void test_a_channel_that_is_found_at_fault_has_agreed_for_no_time(void)
{
  static trio t;
  uint32_t seed = 13;
  for (int32_t kind = EVENT_STEER; kind < EVENT_SENSOR + TSE_SENSORS; kind++) {
    const int32_t fault = kind == EVENT_STEER ? (int32_t)FAULT_STEER : fault_of(kind - EVENT_SENSOR);
    int rows = 0;
    start(&t, kind, 0, 0, &seed);
    t.k.event[t.n].v[STEER_OFFSET] = short_of(kind == EVENT_STEER ? 1 : 0), t.k.event[t.n].score = TSE_R(60),
    t.k.event[t.n].info = TSE_R(30);
    t.k.agrees_for = real(1.5), t.k.slow[ACCEL_X] = real(0.25);
    events_decide(&t.p, &t.k, real(0.01));
    TEST_ASSERT_EQUAL_INT(fault, t.k.fault);
    expect_near(0, number(t.k.agrees_for), 0, "agrees", kind);
    expect_near(0.25, number(t.k.slow[ACCEL_X]), 0, "explained by no fault", kind);
    TEST_ASSERT_EQUAL_INT(TSE_CHANGE_NONE, t.k.change_kind);
    for (; t.k.fault != NO_FAULT && rows < 1000; rows++) events_decide(&t.p, &t.k, real(0.01));
    const double expected = kind == EVENT_STEER ? number(SETTLE_TIME) / 0.01
                                                : 1000; /* for the others, measurements decide */
    expect_near(expected, rows, kind == EVENT_STEER ? 1.5 : 0, "rows", kind);
  }
}

/* Two events are due in one row, and both may have happened: one is dropped in this row,
 * the other in the next. Events that leave nothing do not wait. */
static void test_of_events_that_may_have_happened_one_a_row_is_given_up(void)
{
  static tse_kalman k;
  static tse_params p;
  const int32_t likely[2] = { EVENT_STEER, EVENT_SENSOR + YAW_RATE };
  int at[2] = { -1, -1 }, one_slot = 0;
  memset(&k, 0, sizeof k);
  memset(&p, 0, sizeof p);
  p.log_min = real(-10), p.log_max = real(10);
  for (int i = LCX; i <= LMU; i++) p.prior_sd[i] = real(0.1);
  for (int n = 0; n < 300; n++) events_decide(&p, &k, real(0.01));
  for (int n = 0; n < TSE_EVENTS; n++)
    for (int i = 0; i < 2; i++)
      if (k.event[n].kind == likely[i]) at[i] = n;
  for (int i = 0; i < 2; i++) {
    TEST_ASSERT_TRUE(at[i] >= 0);
    k.event[at[i]].score = real(15.2), k.event[at[i]].info = TSE_R(6);
  }
  for (int n = 0; n < TSE_EVENTS; n++) k.event[n].age = OPEN_TIME;
  const double before = number(ud_variance(&k.ud, STEER_OFFSET));
  events_decide(&p, &k, real(0.01));
  TEST_ASSERT_TRUE(k.event[at[0]].age == TSE_R(0) && k.event[at[1]].age == OPEN_TIME);
  TEST_ASSERT_TRUE(k.fault == NO_FAULT && number(ud_variance(&k.ud, STEER_OFFSET)) > before);
  for (int n = 0; n < TSE_EVENTS; n++)
    if (k.event[n].kind > EVENT_ROAD_RETURN && n != at[1]) {
      one_slot++;
      TEST_ASSERT_TRUE(k.event[n].age == TSE_R(0));
    }
  TEST_ASSERT_TRUE(one_slot > 5);
  events_decide(&p, &k, real(0.01));
  TEST_ASSERT_TRUE(k.event[at[1]].age == TSE_R(0) && k.event[at[1]].kind == likely[1]);
  TEST_ASSERT_TRUE(k.event[at[1]].score == TSE_R(0));
}

/* An event is due in the row that is nearest to its time. */
static void test_an_event_is_opened_in_the_row_nearest_to_its_time(void)
{
  static const double early[2] = { 0.55, 0.45 }; /* [rows] */
  for (int due = 0; due < 2; due++) {
    static tse_kalman k;
    static tse_params p;
    memset(&k, 0, sizeof k);
    memset(&p, 0, sizeof p);
    for (int n = 0; n < 300; n++) events_decide(&p, &k, real(0.01));
    for (int n = 0; n < TSE_EVENTS; n++) k.event[n].age = real(number(OPEN_TIME) - early[due] * 0.01);
    events_decide(&p, &k, real(0.01));
    for (int n = 0; n < TSE_EVENTS; n++)
      if (k.event[n].kind == EVENT_FRONT || k.event[n].kind == EVENT_STEER)
        TEST_ASSERT_EQUAL_INT(due, k.event[n].age == TSE_R(0));
  }
}

/* The rear axle has changed, or the road: the samples do not distinguish them. The
 * accepted state is a mixture of both, so the front axle is uncertain, too. Mean and
 * variance by hand, for two amplitudes with one covariance each. */
static void test_an_axle_that_has_changed_may_have_been_the_road(void)
{
  static const double score[] = { -16, -15.9, -15.5, 0 }; /* of the road; the axle has -16 */
  for (int n = 0; n < ROWS(score); n++) {
    static trio t;
    uint32_t seed = 14;
    const double unit = number(state_unit[LCF]), info = 5, step = 0.3;
    start(&t, EVENT_NONE, 0, 0, &seed);
    for (int i = LCX; i <= LMU; i++) t.p.prior_sd[i] = real(0.1);
    t.k.event[0].kind = EVENT_ROAD, t.k.event[0].score = real(score[n]), t.k.event[0].info = real(info);
    t.k.event[0].v[LCF] = t.k.event[0].v[LCR] = short_of(step / unit);
    t.k.event[6].kind = EVENT_REAR, t.k.event[6].age = SETTLE_TIME, t.k.event[6].score = TSE_R(-16),
    t.k.event[6].info = real(info);
    t.k.event[6].v[LCR] = short_of(step / unit);
    const double before = dense_of(&t.k.ud).p[LCF][LCF] * unit * unit;
    events_decide(&t.p, &t.k, TSE_R(0));
    const double over = exp(0.5 * (score[n] * score[n] - 256) / (1 + info)), road = over / (1 + over);
    TEST_ASSERT_EQUAL_INT(over < 1 ? TSE_CHANGE_REAR : TSE_CHANGE_ROAD, t.k.change_kind);
    const double mean = step * score[n] / (1 + info), left = 1 + road * mean;
    const double common = road * (step * step / (1 + info) + (1 - road) * mean * mean) / (left * left);
    const double own = road * (pow(number(MODEL_FLOOR), 2) + pow(number(OWN_SHARE) * log(left), 2));
    expect_near(log(left), number(t.k.x[LCF]), BY_NUMBER(1e-6, 1e-4, 1e-3), "front axle", n);
    expect_near(before + common + own, dense_of(&t.k.ud).p[LCF][LCF] * unit * unit,
        BY_NUMBER(1e-5, 1e-4, 1e-3), "its variance", n);
    for (int g = 0; g < TSE_GROUPS; g++) expect_near(1, number(t.k.none[g]), 0, "nothing waits", g);
  }
}

/* A softer front axle and a stiffer rear one have the same effect on steering. Tyres of
 * one axle that change lose stiffness: an increase is accepted only as far as the model
 * allows, a decrease fully. */
static void test_an_axle_that_changes_gets_softer(void)
{
  for (int stiffer = 0; stiffer < 2; stiffer++) {
    static trio t;
    uint32_t seed = 14;
    start(&t, EVENT_NONE, 0, 0, &seed);
    for (int i = LCX; i <= LMU; i++) t.p.prior_sd[i] = TSE_R(1);
    t.k.event[6].kind = EVENT_REAR, t.k.event[6].score = real(stiffer ? 13 : -13),
    t.k.event[6].info = TSE_R(5);
    t.k.event[6].v[LCR] = short_of(0.3 / number(state_unit[LCR])), t.k.event[6].age = SETTLE_TIME;
    events_decide(&t.p, &t.k, TSE_R(0));
    TEST_ASSERT_EQUAL_INT(stiffer ? TSE_CHANGE_NONE : TSE_CHANGE_REAR, t.k.change_kind);
    if (stiffer) TEST_ASSERT_TRUE(number(t.k.none[0]) > number(BELIEVED));
  }
}

/* One axle reaches another road first: a change of an axle is not accepted at once, and
 * no stiffness is valid meanwhile. */
static void test_an_axle_is_not_believed_at_once(void)
{
  for (int later = 0; later < 2; later++) {
    static trio t;
    uint32_t seed = 14;
    start(&t, EVENT_NONE, 0, 0, &seed);
    t.k.event[6].kind = EVENT_REAR, t.k.event[6].score = TSE_R(-16), t.k.event[6].info = TSE_R(5);
    t.k.event[6].v[LCR] = short_of(0.3 / number(state_unit[LCR]));
    t.k.event[6].age = later ? SETTLE_TIME : real(0.9 * number(SETTLE_TIME));
    events_decide(&t.p, &t.k, TSE_R(0));
    TEST_ASSERT_EQUAL_INT(later ? TSE_CHANGE_REAR : TSE_CHANGE_NONE, t.k.change_kind);
    TEST_ASSERT_EQUAL_INT(later, t.k.none[0] > BELIEVED);
  }
}

/* Longitudinal slip measures the tyres only if an axle rolls freely, and then those of
 * the driven axle. */
static void test_slip_speaks_of_tyres_where_an_axle_rolls_freely(void)
{
  tse_real h[STATES] = { TSE_R(0) }, gain[STATES] = { TSE_R(0) };
  h[LCX] = TSE_R(1);
  for (int along = 0; along < 2; along++) {
    static const int32_t kinds[] = { EVENT_ROAD, EVENT_FRONT, EVENT_REAR, EVENT_STEER };
    for (int n = 0; n < ROWS(kinds); n++) {
      static tse_kalman k;
      tse_short room[STATES];
      r_sparse slopes;
      memset(&k, 0, sizeof k);
      k.event[0].kind = kinds[n], k.event[0].v[LCX] = short_of(1);
      r_sparse_of(h, STATES, &slopes);
      const r_scaled scaled = r_scaled_of(gain, STATES, room);
      events_learn(&k, WHEEL_FRONT, along, &slopes, &scaled, TSE_R(1), TSE_R(1), TSE_R(1));
      TEST_ASSERT_EQUAL_INT(along && kinds[n] != EVENT_STEER, k.event[0].info > TSE_R(0));
    }
  }
}

/* Longitudinal amplitudes of a road and of each axle, by driven axle. */
static void test_an_axle_that_does_not_drive_says_nothing_along(void)
{
  static const double share[3][3] = { { 1, 0, 0 }, { 1, 1, 0 },
    { 1, 0, 1 } }; /* by driven axle: of road, front, rear */
  for (int driven = 0; driven < 3; driven++) {
    static tse_kalman k;
    static tse_params p;
    memset(&k, 0, sizeof k);
    memset(&p, 0, sizeof p);
    p.car.driven = driven;
    for (int n = 0; n < 300; n++) events_decide(&p, &k, real(0.01));
    for (int n = 0; n < TSE_EVENTS; n++) {
      const int32_t kind = k.event[n].kind;
      if (kind != EVENT_ROAD && kind != EVENT_FRONT && kind != EVENT_REAR) continue;
      const int which = kind == EVENT_ROAD ? 0 : kind == EVENT_FRONT ? 1 : 2;
      const double moves = share[driven][which] * number(CHANGE_SD) / number(state_unit[LCX]);
      expect_near(
          moves, number_of(k.event[n].v[LCX]), BY_NUMBER(1e-6, 1e-5, 2e-2), "along", 10 * driven + which);
    }
  }
}

/* A longitudinal event has happened, and two kinds are possible with neither certain: the
 * more probable one is accepted, whichever comes first, and not an even more probable
 * lateral one. */
static void test_of_a_group_the_likeliest_event_is_believed(void)
{
  for (int other = 0; other < 2; other++) {
    static trio t;
    uint32_t seed = 15;
    start(&t, EVENT_SLIP_FRONT, 1, 0, &seed);
    t.k.event[t.n + 1].kind = EVENT_SLIP_REAR, t.k.event[t.n + 1].v[SR] = short_of(1);
    for (int i = 0; i < 2; i++)
      t.k.event[t.n + i].score = real(i == other ? 60 : 59.9), t.k.event[t.n + i].info = TSE_R(30);
    t.k.event[0].kind = EVENT_ROAD, t.k.event[0].v[LCF] = short_of(0.3 / number(state_unit[LCF]));
    t.k.event[0].score = real(-28.52), t.k.event[0].info = TSE_R(30); /* odds of 9 to no event */
    t.k.along.mean = real(0.2), t.k.along.var = real(0.03);
    t.k.fault = fault_of(YAW_RATE), t.k.agrees_for = real(1.5);
    events_decide(&t.p, &t.k, TSE_R(0));
    const double moved = 60.0 / 31, close = BY_NUMBER(1e-9, 1e-5, 1e-5);
    expect_near(other ? 0 : moved * number(state_unit[SF]), number(t.k.x[SF]), close, "front slip", other);
    expect_near(other ? moved * number(state_unit[SR]) : 0, number(t.k.x[SR]), close, "rear slip", other);
    expect_near(0, number(t.k.x[LCF]), 0, "stiffness", other);
    expect_near(0.9, number(t.k.weight[0]), 0.03, "road", other);
    TEST_ASSERT_EQUAL_INT(TSE_CHANGE_NONE, t.k.change_kind);
    TEST_ASSERT_EQUAL_INT(fault_of(YAW_RATE), t.k.fault); /* unchanged */
    expect_near(1.5, number(t.k.agrees_for), 0, "agrees", other);
    expect_near(0.2, number(t.k.along.mean), 1e-6, "slip stiffness", other);
    expect_near(0.03, number(t.k.along.var), 1e-6, "its variance", other);
  }
}

/* A channel is evidence for the events of its group, also a channel that is no sensor,
 * and every channel for the previous road. */
static void test_a_channel_is_evidence_for_the_events_of_its_group(void)
{
  static const int lateral[] = { NO_SENSOR_LATERAL, ACCEL_Y, YAW_RATE };
  static const int32_t kinds[] = { EVENT_ROAD, EVENT_ROAD_RETURN, EVENT_FRONT, EVENT_SLIP_FRONT,
    EVENT_SLIP_REAR, EVENT_STEER, EVENT_SENSOR + ACCEL_X, EVENT_SENSOR + YAW_RATE,
    EVENT_SENSOR + WHEEL_REAR };
  for (int channel = NO_SENSOR_LATERAL; channel < TSE_SENSORS; channel++)
    for (int n = 0; n < ROWS(kinds); n++) {
      static tse_kalman k;
      tse_real h[STATES] = { TSE_R(0) }, gain[STATES] = { TSE_R(0) };
      int across = 0;
      memset(&k, 0, sizeof k);
      for (int i = 0; i < ROWS(lateral); i++) across = across || channel == lateral[i];
      k.event[0].kind = kinds[n], k.event[0].v[SF] = short_of(1), h[SF] = TSE_R(1);
      learn(&k, channel, h, gain, 1, 1, 1);
      const int along = kinds[n] == EVENT_SLIP_FRONT || kinds[n] == EVENT_SLIP_REAR
          || kinds[n] == EVENT_SENSOR + ACCEL_X || kinds[n] == EVENT_SENSOR + WHEEL_REAR;
      TEST_ASSERT_EQUAL_INT(kinds[n] == EVENT_ROAD_RETURN || along == !across, k.event[0].info > TSE_R(0));
    }
}

/* The tyres of an axle get stiffer as rarely as the model errs by as much, save for what
 * they lost at the last change of tyres. The prior after a restart is no such change. */
static void test_stiffer_tyres_of_an_axle_are_those_of_before_a_change(void)
{
  static const struct {
    int32_t change;
    double now, before, lost; /* logarithms of the stiffness */
  } cases[] = { { TSE_CHANGE_NONE, -0.5, 0, 0 }, { TSE_CHANGE_RESTART, -0.5, 0, 0 },
    { TSE_CHANGE_ROAD, -0.03, 0, 0.03 }, { TSE_CHANGE_REAR, -0.5, -0.48, 0.02 },
    { TSE_CHANGE_ROAD, 0.5, 0, 0 }, { TSE_CHANGE_ROAD, -0.5, 0, 0.5 } };
  const double share = 0.06, info = 20, score = 12, unit = number(state_unit[LCR]);
  for (int n = 0; n < ROWS(cases); n++) {
    static trio t;
    double stated[2];
    for (int softer = 0; softer < 2; softer++) {
      uint32_t seed = 9;
      start(&t, EVENT_REAR, 0, 0, &seed);
      t.p.prior_sd[LCR] = real(0.2), t.k.x[LCR] = real(cases[n].now);
      t.k.change_kind = cases[n].change, t.k.change_age = TSE_R(100);
      t.k.change_from[TSE_CY_REAR] = real(cases[n].before);
      t.k.event[t.n].v[LCR] = short_of((softer ? -1 : 1) * share * (1 + info) / score / unit);
      t.k.event[t.n].score = real(score), t.k.event[t.n].info = real(info);
      stated[softer] = log(odds(&t));
    }
    const double excess = fmax(0, log(1 + share) - cases[n].lost), sd = number(MODEL_FLOOR);
    expect_near(0.5 * excess * excess / (sd * sd), stated[1] - stated[0], 0.01, "penalty", n);
  }
}

/* A frozen sensor is at fault by that evidence or by its samples, whichever is larger,
 * unless a channel is at fault already. A frozen steering angle has its own test. */
static void test_a_frozen_sensor_is_at_fault_by_the_larger_evidence(void)
{
  static const struct {
    int32_t kind, fault;
    double frozen, score; /* [log2], [1] of an information of 3 */
    double ratio;         /* [log2] */
  } cases[] = {
    { EVENT_SENSOR + YAW_RATE, NO_FAULT, 12, 0, 12 },
    { EVENT_SENSOR + YAW_RATE, NO_FAULT, 3, 8, 0.5 * 64 / 4 * 1.442695 - 1 },
    { EVENT_SENSOR + YAW_RATE, NO_FAULT, 12, 8, 12 },
    { EVENT_SENSOR + YAW_RATE, FAULT_STEER, 12, 0, -1 },
    { EVENT_SENSOR + YAW_RATE, NO_FAULT, 0, 0, -1 }, /* a new value: the samples decide */
    { EVENT_STEER, NO_FAULT, 12, 0, -1 },
  };
  for (int n = 0; n < ROWS(cases); n++) {
    static trio t;
    uint32_t seed = 3;
    start(&t, EVENT_NONE, 0, 0, &seed);
    t.n = 9;
    t.k.event[t.n].kind = cases[n].kind, t.k.event[t.n].score = real(cases[n].score);
    t.k.event[t.n].info = TSE_R(3), t.k.fault = cases[n].fault;
    t.k.frozen[cases[n].kind == EVENT_STEER ? STEERING : YAW_RATE] = real(cases[n].frozen);
    const double prior = log2(number(RATE_FAULT) * number(OPEN_TIME));
    expect_near(prior + cases[n].ratio, log2(odds(&t)), BY_NUMBER(1e-4, 1e-2, 2e-2), "odds [log2]", n);
  }
}

/* The filter reacts to an event if the mean square of its amplitude, mean^2 + variance,
 * is as large as the least amplitude squared; to a frozen sensor and to a return
 * always. */
static void test_an_event_is_small_by_the_mean_square_of_its_amplitude(void)
{
  static const struct {
    int32_t kind;
    double score, info, frozen;
    int is_small;
  } cases[] = {
    { EVENT_STEER, 0, 0, 0, 0 }, /* no sample: the prior */
    { EVENT_STEER, 3.3, 3, 0, 1 },
    { EVENT_STEER, 3.6, 3, 0, 0 }, /* 0.9^2 + 0.25 */
    { EVENT_STEER, -3.6, 3, 0, 0 },
    { EVENT_SENSOR + YAW_RATE, 0, 3, 0, 1 },
    { EVENT_SENSOR + YAW_RATE, 0, 3, 500, 0 },
    { EVENT_ROAD_RETURN, 0, 1000, 0, 0 },
    { EVENT_ROAD, 0, 1000, 0, 1 },
  };
  for (int n = 0; n < ROWS(cases); n++) {
    static tse_kalman k;
    memset(&k, 0, sizeof k);
    k.event[9].kind = cases[n].kind, k.event[9].score = real(cases[n].score);
    k.event[9].info = real(cases[n].info), k.frozen[YAW_RATE] = real(cases[n].frozen);
    TEST_ASSERT_EQUAL_INT(cases[n].is_small, event_is_small(&k, 9));
  }
}

/* Return an empty filter whose events are all due, with room for any stiffness. */
static tse_kalman emptied(tse_params *p)
{
  tse_kalman k;
  memset(&k, 0, sizeof k);
  memset(p, 0, sizeof *p);
  p->log_min = real(-10), p->log_max = real(10);
  for (int i = LCX; i <= LMU; i++) p->prior_sd[i] = real(0.1);
  for (int i = 0; i < STATES; i++) k.ud.d[i] = TSE_R(1);
  return k;
}

/* A road changes the grip, unless the grip is known. A return shifts each state by the
 * relative change to its value of before, of a factor of 20 at most. */
static void test_an_event_opens_with_the_shifts_of_its_kind(void)
{
  for (int known = 0; known < 2; known++) {
    tse_params p;
    static tse_kalman k;
    int roads = 0, returns = 0;
    k = emptied(&p);
    p.prior_sd[LMU] = real(known ? 0 : 0.1);
    static const double from[4] = { 0.5, -0.4, 4, 0.1 }, now[4] = { 0.2, 0.1, -2, 0.1 };
    k.change_kind = TSE_CHANGE_ROAD, k.change_age = TSE_R(50);
    for (int i = 0; i < 4; i++) k.change_from[i] = real(from[i]), k.x[LCX + i] = real(now[i]);
    for (int n = 0; n < TSE_EVENTS; n++) k.weight[n] = real(0.3); /* of what was there */
    events_decide(&p, &k, real(0.01));
    for (int n = 0; n < TSE_EVENTS; n++) {
      if (k.event[n].kind != EVENT_NONE) expect_near(0, number(k.weight[n]), 0, "weight", n);
      if (k.event[n].kind == EVENT_ROAD) {
        roads++;
        expect_near(known ? 0 : number(CHANGE_SD) / number(state_unit[LMU]), number_of(k.event[n].v[LMU]),
            BY_NUMBER(1e-9, 1e-5, 1e-3), "grip", n);
      }
      if (k.event[n].kind != EVENT_ROAD_RETURN) continue;
      returns++;
      for (int i = 0; i < 4; i++)
        expect_near(exp(fmin(3, from[i] - now[i])) - 1,
            number_of(k.event[n].v[LCX + i]) * number(state_unit[LCX + i]), BY_NUMBER(1e-6, 1e-4, 1e-2),
            "return", i);
    }
    TEST_ASSERT_TRUE(roads >= 1 && returns == 1);
  }
}

/* There is something to return to after a change of road or tyres, if the stiffness of
 * one axle was known at least as well before. */
static void test_a_return_is_to_what_was_known_as_well(void)
{
  static const struct {
    int32_t change;
    double front, rear; /* variance before; it is 1 now */
    int can;
  } cases[] = { { TSE_CHANGE_ROAD, 0.9, 0.9, 1 }, { TSE_CHANGE_ROAD, 0.9, 1.1, 1 },
    { TSE_CHANGE_ROAD, 1.1, 0.9, 1 }, { TSE_CHANGE_ROAD, 1.1, 1.1, 0 }, { TSE_CHANGE_REAR, 0.9, 0.9, 1 },
    { TSE_CHANGE_NONE, 0.9, 0.9, 0 }, { TSE_CHANGE_RESTART, 0.9, 0.9, 0 } };
  for (int n = 0; n < ROWS(cases); n++) {
    tse_params p;
    static tse_kalman k;
    k = emptied(&p);
    k.change_kind = cases[n].change;
    for (int i = 0; i < 4; i++) k.change_from_var[i] = TSE_R(5);
    k.change_from_var[TSE_CY_FRONT] = real(cases[n].front);
    k.change_from_var[TSE_CY_REAR] = real(cases[n].rear);
    TEST_ASSERT_EQUAL_INT(cases[n].can, can_return(&k));
  }
}

/* An accepted road multiplies stiffness and grip by one plus the shift, by 0.2 at least,
 * and no stiffness leaves its limits. The variance of the amplitude follows with the
 * derivative of the logarithm. */
static void test_an_accepted_road_scales_stiffness_within_its_limits(void)
{
  static const struct {
    double shift, min, max; /* relative shift; limits of the logarithm */
    double front, rear, grip;
  } cases[] = { { -0.5, -10, 10, -0.693147, -0.693147, -0.693147 },
    { -0.95, -10, 10, -1.609438, -1.609438, -1.609438 }, { -1.5, -10, 10, -1.609438, -1.609438, -1.609438 },
    { -0.5, -0.4, 10, -0.4, -0.4, -0.693147 } };
  for (int n = 0; n < ROWS(cases); n++) {
    tse_params p;
    static tse_kalman k;
    k = emptied(&p);
    p.log_min = real(cases[n].min), p.log_max = real(cases[n].max);
    const double info = 99, score = -100, unit = number(state_unit[LCF]);
    k.event[0].kind = EVENT_ROAD, k.event[0].score = real(score), k.event[0].info = real(info);
    for (int i = LCF; i <= LMU; i++)
      k.event[0].v[i] = short_of(cases[n].shift / (score / (1 + info)) / number(state_unit[i]));
    events_decide(&p, &k, TSE_R(0));
    const double close = BY_NUMBER(1e-6, 1e-4, 1e-3);
    TEST_ASSERT_EQUAL_INT(TSE_CHANGE_ROAD, k.change_kind);
    expect_near(cases[n].front, number(k.x[LCF]), close, "front", n);
    expect_near(cases[n].rear, number(k.x[LCR]), close, "rear", n);
    expect_near(cases[n].grip, number(k.x[LMU]), close, "grip", n);
    const double left = fmax(0.2, 1 + cases[n].shift), slope = cases[n].shift / left,
                 own = pow(number(MODEL_FLOOR), 2) + pow(number(OWN_SHARE) * cases[n].front, 2);
    expect_near(1 + (slope * slope / (1 + info) + own) / (unit * unit), number(ud_variance(&k.ud, LCF)),
        BY_NUMBER(1e-4, 1e-3, 1e-2), "variance", n);
    expect_near(1 + slope * slope / (1 + info) / pow(number(state_unit[LMU]), 2),
        number(ud_variance(&k.ud, LMU)), BY_NUMBER(1e-4, 1e-3, 1e-2), "variance of the grip", n);
  }
}

/* A return measures the state: what parameters have made of it is forgotten with it. */
static void test_a_return_forgets_what_parameters_made_of_the_stiffness(void)
{
  tse_params p;
  static tse_kalman k;
  k = emptied(&p);
  k.change_kind = TSE_CHANGE_ROAD, k.change_age = TSE_R(50);
  k.event[4].kind = EVENT_ROAD_RETURN, k.event[4].score = TSE_R(60), k.event[4].info = TSE_R(60);
  for (int i = 0; i < 4; i++) k.change_from_var[i] = real(0.25);
  for (int q = 0; q < TSE_CONSIDERED; q++)
    for (int i = 0; i < STATES; i++) k.consider[q][i] = short_of(0.5);
  events_decide(&p, &k, TSE_R(0));
  TEST_ASSERT_EQUAL_INT(TSE_CHANGE_ROAD, k.change_kind);
  for (int q = 0; q < TSE_CONSIDERED; q++)
    for (int i = 0; i < STATES; i++) /* variances of 1 and 0.25: a fifth is left */
      expect_near(i >= LCX && i <= LMU ? 0.1 : 0.5, number_of(k.consider[q][i]), 1e-3, "parameter", i);
}

/* Wheels that may have slid leave nothing when they are given up. */
static void test_wheels_that_may_have_slid_are_given_up_without_a_trace(void)
{
  tse_params p;
  static tse_kalman k;
  k = emptied(&p);
  k.event[7].kind = EVENT_SLIP_FRONT, k.event[7].v[SF] = short_of(2), k.event[7].age = OPEN_TIME;
  k.event[7].score = real(8.8), k.event[7].info = TSE_R(6);
  events_decide(&p, &k, real(0.01));
  TEST_ASSERT_TRUE(k.event[7].kind == EVENT_SLIP_FRONT && k.event[7].age == TSE_R(0));
  expect_near(0, number(k.x[SF]), 0, "slip", 0);
  expect_near(1, number(ud_variance(&k.ud, SF)), 1e-6, "its variance", 0);
  expect_near(0, number(k.weight[7]), 0, "probability of the event that follows", 0);
}

/* No event moves a state beyond its limit. */
static void test_an_accepted_event_leaves_a_state_within_its_limit(void)
{
  for (int side = -1; side <= 1; side += 2) {
    tse_params p;
    static tse_kalman k;
    k = emptied(&p);
    k.event[7].kind = EVENT_SLIP_FRONT, k.event[7].score = TSE_R(600 * side), k.event[7].info = TSE_R(29);
    k.event[7].v[SF] = short_of(0.25 * number(state_max[SF]) / number(state_unit[SF]));
    events_decide(&p, &k, TSE_R(0));
    expect_near(side * number(state_max[SF]), number(k.x[SF]), 1e-6, "slip", side);
  }
}

/* An accepted change of an axle widens its own stiffness by its own step, and the
 * longitudinal stiffness only where the axle is driven. */
static void test_an_accepted_axle_is_uncertain_by_its_own_step(void)
{
  for (int rear = 0; rear < 2; rear++)
    for (int driven = 1; driven <= 2; driven++) {
      tse_params p;
      static tse_kalman k;
      k = emptied(&p);
      const int n = rear ? 6 : 5, at = rear ? LCR : LCF, other = rear ? LCF : LCR;
      const double unit = number(state_unit[at]), along = number(state_unit[LCX]);
      p.car.driven = driven;
      k.event[n].kind = rear ? EVENT_REAR : EVENT_FRONT, k.event[n].age = SETTLE_TIME;
      k.event[n].score = TSE_R(-100), k.event[n].info = TSE_R(99), k.event[n].v[at] = short_of(0.5 / unit);
      k.x[at] = real(0.1);
      events_decide(&p, &k, TSE_R(0));
      const double step = number(OWN_SHARE) * log(0.5), own = pow(number(MODEL_FLOOR), 2) + step * step;
      const double is_driven = driven == 1 + rear;
      TEST_ASSERT_EQUAL_INT(rear ? TSE_CHANGE_REAR : TSE_CHANGE_FRONT, k.change_kind);
      expect_near(0.1 + log(0.5), number(k.x[at]), 1e-3, "stiffness", n);
      expect_near(0.1, number(k.change_from[at - LCX]), 1e-3, "stiffness before", n);
      expect_near(1 + (1.0 / 100 + own) / (unit * unit), number(ud_variance(&k.ud, at)),
          BY_NUMBER(1e-4, 1e-3, 1e-2), "variance", n);
      expect_near(1, number(ud_variance(&k.ud, other)), 1e-4, "variance of the other axle", n);
      expect_near(1 + is_driven * (pow(2 * number(USUAL_MODEL_SD), 2) + step * step) / (along * along),
          number(ud_variance(&k.ud, LCX)), BY_NUMBER(1e-4, 1e-3, 1e-2), "variance along", 10 * n + driven);
    }
}

/* The second amplitude of a road adds its variance, whatever its mean. */
static void test_an_accepted_road_is_uncertain_by_both_amplitudes(void)
{
  tse_params p;
  static tse_kalman k;
  k = emptied(&p);
  k.event[0].kind = EVENT_ROAD, k.event[0].score = TSE_R(60), k.event[0].info = TSE_R(29);
  k.event[2].kind = EVENT_ROAD_AXLE_DIFF, k.event[2].info = TSE_R(1), k.event[2].v[BY] = short_of(2);
  events_decide(&p, &k, TSE_R(0));
  TEST_ASSERT_EQUAL_INT(TSE_CHANGE_ROAD, k.change_kind);
  expect_near(1 + 4.0 / 2, number(ud_variance(&k.ud, BY)), BY_NUMBER(1e-6, 1e-4, 1e-3), "variance", 0);
}

/* A change soon after a restart is the first one: nothing of the restart is a part of
 * it. */
static void test_a_restart_is_no_change_that_goes_on(void)
{
  for (int restarted = 0; restarted < 2; restarted++) {
    tse_params p;
    static tse_kalman k;
    k = emptied(&p);
    k.change_kind = restarted ? TSE_CHANGE_RESTART : TSE_CHANGE_ROAD, k.change_age = real(0.5);
    k.x[LCF] = real(0.125);
    k.event[0].kind = EVENT_ROAD, k.event[0].score = TSE_R(-60), k.event[0].info = TSE_R(29);
    events_decide(&p, &k, TSE_R(0));
    TEST_ASSERT_EQUAL_INT(TSE_CHANGE_ROAD, k.change_kind);
    expect_near(restarted ? 0 : 0.5, number(k.change_age), 1e-6, "age", restarted);
    expect_near(restarted ? 0.125 : 0, number(k.change_from[TSE_CY_FRONT]), 1e-6, "before", restarted);
  }
}

/* Of two roads the less likely one gives way to the next. */
static void test_the_less_likely_road_gives_way(void)
{
  for (int likelier = 0; likelier < 2; likelier++) {
    tse_params p;
    static tse_kalman k;
    k = emptied(&p);
    for (int n = 0; n < 2; n++) {
      k.event[n].kind = EVENT_ROAD, k.event[n].age = TSE_R(2 + n), k.event[n].info = TSE_R(3);
      k.event[n].score = TSE_R(n == likelier ? -3 : 0);
    }
    events_decide(&p, &k, real(0.01));
    for (int n = 0; n < 2; n++)
      expect_near(n == likelier ? 2 + n : 0, number(k.event[n].age), 0, "age", 10 * likelier + n);
  }
}

/* Both roads together are the probability that it was the road. By hand: the axle and two
 * roads of the same evidence are a third each. */
static void test_an_axle_that_has_changed_may_have_been_either_road(void)
{
  tse_params p;
  static tse_kalman k;
  k = emptied(&p);
  for (int n = 0; n <= 6; n++) {
    if (n > 1 && n < 6) continue;
    k.event[n].kind = n < 2 ? EVENT_ROAD : EVENT_REAR, k.event[n].age = SETTLE_TIME;
    k.event[n].score = real(n < 2 ? -29.99 : -30), k.event[n].info = TSE_R(29);
    k.event[n].v[n < 2 ? LCF : LCR] = short_of(0.5 / number(state_unit[LCF]));
  }
  events_decide(&p, &k, TSE_R(0));
  const double road = exp(0.5 * (29.99 * 29.99 - 900) / 30), share = 2 * road / (2 * road + 1);
  TEST_ASSERT_EQUAL_INT(TSE_CHANGE_REAR, k.change_kind);
  expect_near(log(1 - 0.5 * share * 29.99 / 30), number(k.x[LCF]), 1e-3, "front axle", 0);
  expect_near(log(1 - 0.5 * (1 - share)), number(k.x[LCR]), 1e-3, "rear axle", 0);
}
