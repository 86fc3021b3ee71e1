/* tests/unit/host/test_sound.c <-> src/host/sound.c and sound.h, tse_sim_check(). The FMU's tests (tests/fmu/unit/test_state.c) go
 * on with what is accepted. */
#include "filter/filter.h"
#include "unit_support.h"
#include "tse/simulate.h"

static tse_filter_paper f, forged;
static tse_params p;

static size_t bytes_of_form(int32_t form) { return form ? sizeof f : sizeof f.filter; }

/* A filter of a form after some rows; late: its channels wait for the steering angle. */
static void drive(int32_t form, int late)
{
  tse_config c;
  tse_config_default(&c);
  c.form = form;
  c.particles = 60;
  if (late) c.steer_angle_latency = setting(0.123);
  p = prepared(&c);
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_reset(&p, &f.filter, bytes_of_form(form)));
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_filter_check(&p, &f.filter, bytes_of_form(form)));
  for (int k = 0; k < 400; k++) {
    tse_input u;
    memset(&u, 0, sizeof u);
    u.dt = real(0.01);
    u.steer_angle = real(0.02 * sin(0.13 * k));
    u.wheel_speed_front = real(60 + 0.3 * sin(0.2 * k));
    u.wheel_speed_rear = real(60);
    u.accel_y = real(1.9 * sin(0.13 * k) + 0.1 * sin(5.3 * k));
    u.yaw_rate = real(0.1 * sin(0.13 * k) + 0.003 * sin(9.7 * k));
    if (k > 200 && k < 260) u.missing = TSE_MISSING_steer_angle;
    if (k > 300) u.yaw_rate = real(6); /* what the model does not explain */
    TEST_ASSERT_TRUE(tse_step(&p, &f.filter, &u, NULL) >= 0);
    TEST_ASSERT_EQUAL_INT(TSE_OK, tse_filter_check(&p, &f.filter, bytes_of_form(form)));
  }
}

static void test_a_filter_that_was_stepped_is_sound_at_every_row(void)
{
  for (int32_t form = 0; form <= 1; form++)
    for (int late = 0; late < 2; late++) drive(form, late);
}

/* A row of anything that is inside its range, or is missing; sometimes a pause. */
static tse_input wild_row(uint32_t *seed)
{
  tse_input u;
  const double amplitude = next_uniform(seed) < 0.05 ? 1 : 0.1, speed = next_between(seed, -10, 70);
  memset(&u, 0, sizeof u);
  u.dt = real(next_uniform(seed) < 0.03 ? next_between(seed, 0.1, 3600) : 0.01);
  u.steer_angle = real(1.2 * amplitude * next_between(seed, -1, 1));
  u.wheel_speed_front = real(speed + next_between(seed, -300, 300) * amplitude);
  u.wheel_speed_rear = real(speed);
  u.accel_x = real(50 * amplitude * next_between(seed, -1, 1));
  u.accel_y = real(50 * amplitude * next_between(seed, -1, 1));
  u.yaw_rate = real(6 * amplitude * next_between(seed, -1, 1));
  if (next_uniform(seed) < 0.1) u.missing = next_word(seed) & 63u;
  return u;
}

/* Settings and rows that nobody has may make an estimate useless, but a number, and of a size that there is. */
static void expect_numbers(const tse_output *y, const char *what)
{
  TEST_ASSERT_TRUE_MESSAGE(outputs_are_finite(y), what);
  TEST_ASSERT_TRUE_MESSAGE(fabs(number(y->yaw_rate)) <= 3 * number(MOST_YAW_RATE), what); /* with what events, believed half, would add */
}

static void go_through_wild_rows(const tse_config *c, const char *what, int rows, uint32_t *seed)
{
  p = prepared(c);
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_reset(&p, &f.filter, bytes_of_form(c->form)));
  for (int k = 0; k < rows; k++) {
    const tse_input u = wild_row(seed);
    tse_output y;
    TEST_ASSERT_TRUE_MESSAGE(tse_step(&p, &f.filter, &u, &y) >= 0, what);
    expect_numbers(&y, what);
    TEST_ASSERT_EQUAL_INT_MESSAGE(TSE_OK, tse_filter_check(&p, &f.filter, bytes_of_form(c->form)), what);
  }
}

/* What has come about by itself is not refused: an FMU would not take its own state back. */
static void test_a_filter_is_sound_whatever_the_rows_were(void)
{
  uint32_t seed = 3;
  tse_config c;
  tse_config_default(&c);
  for (int i = 0; i < 500; i++) go_through_wild_rows(&c, "defaults", 100, &seed);
}

static void test_a_filter_is_sound_at_both_ends_of_every_setting(void)
{
  uint32_t seed = 4;
  tse_config c;
  EACH_SETTING(row)
  for (int end = 0; end < 2; end++) {
    tse_config_default(&c);
    put_field(&c, row, end ? row->hi : row->lo);
    if (tse_config_check(&c, NULL) == TSE_OK && prepared_if_held(&c, &p)) go_through_wild_rows(&c, row->name, 100, &seed);
  }
}

static void expect_forged(const char *what)
{
  TEST_ASSERT_EQUAL_INT_MESSAGE(TSE_E_STATE, tse_filter_check(&p, &forged.filter, bytes_of_form(p.form)), what);
}

#define FORGED(member, value)                 \
  do {                                        \
    memcpy(&forged, &f, sizeof f);            \
    forged.member = (value);                  \
    expect_forged(#member " = " #value);      \
  } while (0)

static void test_what_no_filter_holds_is_refused(void)
{
  const tse_real none = real((double)NAN), endless = real((double)INFINITY);
#if defined(TSE_REAL_FIXED)
  const tse_short far = INT32_MAX; /* further than rows stop */
#else
  const tse_short far = endless;
#endif
  drive(0, 0);
  FORGED(filter.waiting.count, 1); /* where none is late */
  FORGED(filter.magic, 0);
  FORGED(filter.fingerprint, p.fingerprint + 1);
  FORGED(filter.started, 2);
  FORGED(filter.known[2], 3);
  FORGED(filter.seen, none);
  FORGED(filter.start.loaded, 1); /* with nothing in it */
  FORGED(filter.k.x[LCF], none);
  FORGED(filter.k.x[GX], endless);
  FORGED(filter.k.p.d[4], TSE_R(-1e-6));
  FORGED(filter.k.p.u[77], far);
  FORGED(filter.k.noise[1], TSE_R(0));
  FORGED(filter.k.usual[2], TSE_R(0));
  FORGED(filter.k.doubt[3][7], -far);
  FORGED(filter.k.fault, TSE_CHANNELS + 1);
  FORGED(filter.k.change_kind, TSE_CHANGE_RESTART + 1);
  FORGED(filter.k.slow_turn, -1);
  FORGED(filter.k.channels, TSE_SENSORS + 1);
  FORGED(filter.k.steer[1], TSE_R(3));
  FORGED(filter.k.event[3].kind, EVENT_KINDS);
  FORGED(filter.k.event[3].kind, -1);
  FORGED(filter.k.event[9].info, TSE_R(-1));
  FORGED(filter.k.event[9].score, none);
  FORGED(filter.k.event[9].v[5], far);
  drive(0, 1);
  FORGED(filter.waiting.count, TSE_LATENCY_ROWS + 1);
  FORGED(filter.waiting.newest, TSE_LATENCY_ROWS);
  FORGED(filter.waiting.newest, -1);
  FORGED(filter.waiting.since, none);
  FORGED(filter.waiting.unkept, TSE_R(-1));
  FORGED(filter.waiting.before[3], TSE_R(0.5));
  FORGED(filter.waiting.value[7][0], TSE_R(1.3));
  FORGED(filter.waiting.value[7][5], none);
  FORGED(filter.waiting.missing[5], 64);
  FORGED(filter.waiting.reason[2], 10);
  FORGED(filter.waiting.lost[1], TSE_R(0.6));
  drive(1, 0);
  FORGED(nu, TSE_R(4));
  FORGED(p.mu[1][3], none);
  FORGED(p.logw[0][3], TSE_R(1e4));
  FORGED(weight[9], TSE_R(-1));
  FORGED(ancestor[7], 60);
  FORGED(copies[7], 61);
  TEST_ASSERT_EQUAL_INT(TSE_E_SIZE, tse_filter_check(&p, &f.filter, sizeof f.filter));
  TEST_ASSERT_EQUAL_INT(TSE_E_NULL, tse_filter_check(NULL, &f.filter, sizeof f));
  TEST_ASSERT_EQUAL_INT(TSE_E_NULL, tse_filter_check(&p, NULL, sizeof f));
  p.magic = 0;
  TEST_ASSERT_EQUAL_INT(TSE_E_STATE, tse_filter_check(&p, &f.filter, sizeof f));
}

static void test_a_simulation_is_of_its_settings_or_refused(void)
{
  tse_config c;
  tse_sim_config s;
  tse_sim sim;
  tse_config_default(&c);
  tse_sim_config_default(&s);
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_sim_reset(&sim, &c, &s, NULL));
  for (int k = 0; k < 200; k++) {
    tse_sim_input u;
    tse_sim_output y;
    memset(&u, 0, sizeof u);
    u.dt = real(0.01);
    u.steer_angle = real(0.02 * sin(0.1 * k));
    u.road_level = real(1);
    TEST_ASSERT_EQUAL_INT(TSE_OK, tse_sim_step(&sim, &u, &y));
    TEST_ASSERT_EQUAL_INT(TSE_OK, tse_sim_check(&sim, &c, &s));
  }
  tse_sim other = sim;
  other.params.lf += TSE_R(0.1);
  TEST_ASSERT_EQUAL_INT(TSE_E_STATE, tse_sim_check(&other, &c, &s));
  other = sim;
  other.last.steer_angle = TSE_R(10);
  TEST_ASSERT_EQUAL_INT(TSE_E_STATE, tse_sim_check(&other, &c, &s));
  other = sim;
  other.x[4] = real(1e20);
  TEST_ASSERT_EQUAL_INT(TSE_E_STATE, tse_sim_check(&other, &c, &s));
  other = sim;
  other.effects.settled = 5;
  TEST_ASSERT_EQUAL_INT(TSE_E_STATE, tse_sim_check(&other, &c, &s));
  c.mass += 1;
  TEST_ASSERT_EQUAL_INT(TSE_E_STATE, tse_sim_check(&sim, &c, &s));
  c.mass = setting(-1);
  TEST_ASSERT_EQUAL_INT(TSE_E_CONFIG, tse_sim_check(&sim, &c, &s));
  TEST_ASSERT_EQUAL_INT(TSE_E_NULL, tse_sim_check(NULL, &c, &s));
}

int main(void)
{
  UNITY_BEGIN();
  RUN_TEST(test_a_filter_that_was_stepped_is_sound_at_every_row);
  RUN_TEST(test_a_filter_is_sound_whatever_the_rows_were);
  RUN_TEST(test_a_filter_is_sound_at_both_ends_of_every_setting);
  RUN_TEST(test_what_no_filter_holds_is_refused);
  RUN_TEST(test_a_simulation_is_of_its_settings_or_refused);
  return UNITY_END();
}
