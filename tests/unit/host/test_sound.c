/* tests/unit/host/test_sound.c <-> src/host/sound.c and sound.h, tse_sim_check(): states
 * that occur are accepted. Every member with a range is checked, at both ends and for
 * every element of an array. The FMU's tests (tests/fmu/unit/test_state.c) continue from
 * accepted states. */
#include "unit_support.h"
#include "filter/types.h"
#include "host/sound.h"
#include "tables/constants.h"
#include "tables/input.h"
#include "tse/simulate.h"

static tse_filter_paper f, forged;
static tse_sim sim, other;
static tse_config c;
static tse_sim_config s;
static tse_params p;

static size_t bytes_of_form(int32_t form) { return form ? sizeof f : sizeof f.filter; }

/* Run rows through a filter.
 *   Given:  late  1: channels wait for the steering angle */
static void drive(int32_t form, int late)
{
  tse_config_exact(&c);
  c.form = form, c.particles = 60;
  if (late) c.steer_angle_latency = setting(0.123);
  p = prepared(c);
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_reset(&p, &f.filter, bytes_of_form(form)));
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_filter_check(&p, &f.filter, bytes_of_form(form)));
  for (int k = 0; k < 400; k++) {
    tse_input u = blank_row();
    u.dt = real(0.01), u.steer_angle = real(0.02 * sin(0.13 * k));
    u.wheel_speed_front = real(60 + 0.3 * sin(0.2 * k)), u.wheel_speed_rear = real(60);
    u.accel_y = real(1.9 * sin(0.13 * k) + 0.1 * sin(5.3 * k));
    u.yaw_rate = real(0.1 * sin(0.13 * k) + 0.003 * sin(9.7 * k));
    if (k > 200 && k < 260) u.missing = TSE_MISSING_steer_angle;
    if (k > 300) u.yaw_rate = real(6); /* beyond the model */
    TEST_ASSERT_TRUE(tse_step(&p, &f.filter, &u, NULL) >= 0);
    TEST_ASSERT_EQUAL_INT(TSE_OK, tse_filter_check(&p, &f.filter, bytes_of_form(form)));
  }
  memcpy(&forged, &f, sizeof f);
}

static void test_a_filter_that_was_stepped_is_sound_at_every_row(void)
{
  for (int32_t form = 0; form <= 1; form++)
    for (int late = 0; late < 2; late++) drive(form, late);
}

/* Return a row of random values within their ranges, some of them missing, sometimes
 * after a pause. */
static tse_input wild_row(uint32_t *seed)
{
  tse_input u = blank_row();
  const double amplitude = next_uniform(seed) < 0.05 ? 1 : 0.1, speed = next_between(seed, -10, 70);
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

/* Unrealistic settings and rows may make an estimate useless, but it stays finite and
 * limited. */
static void expect_numbers(const tse_output *y, const char *what)
{
  TEST_ASSERT_TRUE_MESSAGE(outputs_are_finite(y), what);
  TEST_ASSERT_TRUE_MESSAGE(
      fabs(number(y->yaw_rate)) <= 3 * number(MAX_YAW_RATE), what); /* with the shifts of undecided events */
}

static void go_through_wild_rows(const char *what, int rows, uint32_t *seed)
{
  p = prepared(c);
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_reset(&p, &f.filter, bytes_of_form(c.form)));
  for (int k = 0; k < rows; k++) {
    const tse_input u = wild_row(seed);
    tse_output y;
    TEST_ASSERT_TRUE_MESSAGE(tse_step(&p, &f.filter, &u, &y) >= 0, what);
    expect_numbers(&y, what);
    TEST_ASSERT_EQUAL_INT_MESSAGE(TSE_OK, tse_filter_check(&p, &f.filter, bytes_of_form(c.form)), what);
  }
}

/* States that occur are accepted: an FMU must accept its own state. */
static void test_a_filter_is_sound_whatever_the_rows_were(void)
{
  uint32_t seed = 3;
  tse_config_exact(&c);
  for (int i = 0; i < 500; i++) go_through_wild_rows("defaults", 100, &seed);
}

static void test_a_filter_is_sound_at_both_ends_of_every_setting(void)
{
  uint32_t seed = 4;
  EACH_SETTING(row)
  for (int end = 0; end < 2; end++) {
    tse_config_exact(&c);
    put_field(&c, row, end ? row->hi : row->lo);
    if (tse_config_check(&c, NULL) == TSE_OK && prepared_if_held(&c, &p))
      go_through_wild_rows(row->name, 100, &seed);
  }
}

static tse_status look_at_filter(void) { return tse_filter_check(&p, &forged.filter, bytes_of_form(p.form)); }

static tse_status look_at_simulation(void) { return tse_sim_check(&other, &c, &s); }

static tse_real none(void)
{
#if defined(TSE_REAL_FIXED)
  return FIXED_NAN;
#else
  return r_div(TSE_R(0), TSE_R(0));
#endif
}

typedef struct place {
  unsigned char *at;
  size_t bytes;
  tse_status (*look)(void);
  const char *what;
} place;

static void expect(const place *a, size_t k, tse_real value, tse_status status)
{
  tse_real was;
  char text[120];
  memcpy(&was, a->at + k * sizeof was, sizeof was);
  memcpy(a->at + k * sizeof was, &value, sizeof value);
  (void)snprintf(text, sizeof text, "%s, number %d: %g", a->what, (int)k, number(value));
  TEST_ASSERT_EQUAL_INT_MESSAGE(status, a->look(), text);
  memcpy(a->at + k * sizeof was, &was, sizeof was);
}

/* Check that NaN and values outside lo .. hi are refused, of particles every twentieth.
 *   Given:  ends  1: lo and hi themselves are accepted */
static void held_to(place a, tse_real lo, tse_real hi, int ends)
{
  const size_t n = a.bytes / sizeof lo;
  TEST_ASSERT_EQUAL_INT_MESSAGE(TSE_OK, a.look(), a.what);
  for (size_t k = 0; k < n; k += n > 500 ? 20 : 1) {
    expect(&a, k, none(), TSE_E_STATE);
#if !defined(TSE_REAL_FIXED)
    expect(&a, k, lo - r_mul(TSE_R(0.001), r_abs(lo)) - TSE_R(1e-3), TSE_E_STATE);
    expect(&a, k, hi + r_mul(TSE_R(0.001), r_abs(hi)) + TSE_R(1e-3), TSE_E_STATE);
#else /* only NaN is beyond the largest number */
    if (lo > -FIXED_MOST) expect(&a, k, lo - r_mul(TSE_R(0.001), r_abs(lo)) - TSE_R(1e-3), TSE_E_STATE);
    if (hi < FIXED_MOST) expect(&a, k, hi + r_mul(TSE_R(0.001), r_abs(hi)) + TSE_R(1e-3), TSE_E_STATE);
#endif
    if (ends) {
      expect(&a, k, lo, TSE_OK);
      expect(&a, k, hi, TSE_OK);
    }
  }
}

static place of_filter(void *at, size_t bytes, const char *what)
{
  const place a = { at, bytes, look_at_filter, what };
  return a;
}

static place of_simulation(void *at, size_t bytes, const char *what)
{
  const place a = { at, bytes, look_at_simulation, what };
  return a;
}

#define HELD(member, lo, hi) held_to(of_filter(&forged.member, sizeof forged.member, #member), lo, hi, 1)
#define HELD_AMONG_OTHERS(member, lo, hi) \
  held_to(of_filter(&forged.member, sizeof forged.member, #member), lo, hi, 0)
/* Numbers of rows, which saturate in fixed point below the limit of their type. */
#if defined(TSE_REAL_FIXED)
static void row_held(tse_short *at, size_t bytes, const char *what)
{
  static const struct {
    tse_short value;
    tse_status status;
  } row[] = { { -MAX_SHORT, TSE_OK }, { MAX_SHORT - 1, TSE_OK }, { -MAX_SHORT - 1, TSE_E_STATE },
    { MAX_SHORT, TSE_E_STATE } };
  for (size_t i = 0; i < bytes / sizeof *at; i++) {
    const tse_short was = at[i];
    for (int k = 0; k < ROWS(row); k++) {
      at[i] = row[k].value;
      TEST_ASSERT_EQUAL_INT_MESSAGE(row[k].status, look_at_filter(), what);
    }
    at[i] = was;
  }
}
#define ROW_HELD(member) row_held((tse_short *)&forged.member, sizeof forged.member, #member)
#define ELEMENT_HELD(at, d) row_held((tse_short *)(at), sizeof(tse_short), #at)
#else
#define ROW_HELD(member) ANY_SIGN(member)
#define ELEMENT_HELD(at, d) element_held(at, d, #at)

/* Check the limit of an element of U, in a column with the element d of D: it is at most
 * 1e14, and d u^2 at most 1e31. The limit is approached to half of the step of held_to(),
 * because u is rounded. */
static void element_held(tse_real *at, tse_real d, const char *what)
{
  const tse_real most = real(fmin(1e14, sqrt(1e31 / number(d))) * 0.9995);
  held_to(of_filter(at, sizeof *at, what), -most, most, 1);
}
#endif
#define ANY_SIGN(member) HELD(member, -MOST_REAL, MOST_REAL)
#define NOT_NEGATIVE(member) HELD(member, TSE_R(0), MOST_REAL)

static void whole_number(int32_t *at, int32_t lo, int32_t hi, tse_status (*look)(void), const char *what)
{
  const int32_t was = *at;
  const struct {
    int32_t value;
    tse_status status;
  } row[] = { { lo, TSE_OK }, { hi, TSE_OK }, { lo - 1, TSE_E_STATE }, { hi + 1, TSE_E_STATE } };
  for (int k = 0; k < ROWS(row); k++) {
    *at = row[k].value;
    TEST_ASSERT_EQUAL_INT_MESSAGE(row[k].status, look(), what);
  }
  *at = was;
}

#define LEAST_OF_ALL BY_NUMBER(TSE_R(1e-12), TSE_R(1e-12), (tse_real)1) /* 0 is not allowed */
#define WHOLE(member, lo, hi) whole_number(&forged.member, lo, hi, look_at_filter, #member)

#define FORGED(member, value)                                                   \
  do {                                                                          \
    memcpy(&forged, &f, sizeof f);                                              \
    forged.member = (value);                                                    \
    TEST_ASSERT_EQUAL_INT_MESSAGE(TSE_E_STATE, look_at_filter(), #member " = " #value); \
  } while (0)

static void test_what_belongs_to_something_else_is_refused(void)
{
  drive(0, 0);
  FORGED(filter.waiting.count, 1); /* where no channel is late */
  drive(0, 1);
  FORGED(filter.magic, 0);
  FORGED(filter.fingerprint, p.fingerprint + 1);
  FORGED(filter.start.loaded, 1); /* without content */
  FORGED(filter.k.x[GX], real((double)INFINITY));
  FORGED(filter.k.noise[1], TSE_R(0)); /* in a filter that has had a row */
  FORGED(filter.k.usual[2], TSE_R(0));
  FORGED(filter.waiting.missing[5], 64);
  drive(1, 0);
  FORGED(ancestor[7], 60);
  FORGED(copies[7], 61);
  TEST_ASSERT_EQUAL_INT(TSE_E_NULL, tse_filter_check(NULL, &f.filter, sizeof f));
  TEST_ASSERT_EQUAL_INT(TSE_E_NULL, tse_filter_check(&p, NULL, sizeof f));
  p.magic = 0;
  TEST_ASSERT_EQUAL_INT(TSE_E_STATE, tse_filter_check(&p, &f.filter, sizeof f));
}

static void test_what_every_filter_has_is_held_to_its_range(void)
{
  drive(0, 1);
  ANY_SIGN(filter.steer);
  ANY_SIGN(filter.v_front);
  ANY_SIGN(filter.v_rear);
  NOT_NEGATIVE(filter.held_for);
  NOT_NEGATIVE(filter.rolled_for);
  NOT_NEGATIVE(filter.still_for);
  NOT_NEGATIVE(filter.seen);
  WHOLE(filter.known[0], TSE_UNKNOWN, TSE_KNOWN_BEFORE);
  WHOLE(filter.known[1], TSE_UNKNOWN, TSE_KNOWN_BEFORE);
  WHOLE(filter.known[2], TSE_UNKNOWN, TSE_KNOWN_BEFORE);
  WHOLE(filter.started, 0, 1);
  WHOLE(filter.lost, 0, 1);
}

static void test_where_a_filter_starts_is_held_to_its_range(void)
{
  drive(0, 1);
  ANY_SIGN(filter.start.mu);
  NOT_NEGATIVE(filter.start.mu_sd);
  NOT_NEGATIVE(filter.start.mean_var);
  ANY_SIGN(filter.start.lam);
  NOT_NEGATIVE(filter.start.gamma);
  NOT_NEGATIVE(filter.start.nu);
  ANY_SIGN(filter.start.bias);
  HELD(filter.start.bias_var, TSE_R(0), MOST_SQUARE);
  ANY_SIGN(filter.start.kept);
  HELD(filter.start.kept_cov, -MOST_SQUARE, MOST_SQUARE);
  NOT_NEGATIVE(filter.start.noise);
  forged.filter.start.nu = TSE_R(5);
  for (int k = 0; k < TSE_SENSORS; k++) forged.filter.start.noise[k] = TSE_R(1);
  WHOLE(filter.start.loaded, 0, 1);
  forged.filter.start.loaded = 1;
  HELD(filter.start.nu, TSE_R(5), MOST_REAL);
}

static void test_rows_that_wait_are_held_to_their_ranges(void)
{
  drive(0, 1);
  TEST_ASSERT_TRUE(forged.filter.waiting.count > 3);
  WHOLE(filter.waiting.count, 0, TSE_LATENCY_ROWS);
  WHOLE(filter.waiting.newest, 0, TSE_LATENCY_ROWS - 1);
  HELD(filter.waiting.since, TSE_R(0), MAX_DT);
  HELD(filter.waiting.unkept, TSE_R(0), MAX_DT);
  HELD(filter.waiting.before, TSE_R(0), p.max_gap + p.latency_least);
  for (int i = 0; i < TSE_LATENCY_ROWS; i++) {
    for (int k = 0; k < TSE_CHANNELS; k++)
      HELD(filter.waiting.value[i][k], channel_rows[k].lo, channel_rows[k].hi);
  }
  HELD(filter.waiting.lost, TSE_R(0), TSE_R(0.5001));
  for (int a = 0; a < 4; a++) WHOLE(filter.waiting.reason[a], TSE_VALID, TSE_IMPLAUSIBLE);
}

static void test_the_state_of_the_filter_is_held_to_its_ranges(void)
{
  drive(0, 1);
  ANY_SIGN(filter.k.x);
  for (int j = 1; j < TSE_STATES; j++)
    for (int i = 0; i < j; i++)
      ELEMENT_HELD(&forged.filter.k.ud.u[j * (j - 1) / 2 + i], forged.filter.k.ud.d[j]);
  HELD(filter.k.ud.d, TSE_R(0), MOST_VARIANCE);
  ROW_HELD(filter.k.consider);
  for (int c_ = 0; c_ < TSE_SENSORS; c_++) {
    held_to(of_filter(&forged.filter.k.noise[c_], sizeof(tse_real), "noise"), LEAST_OF_ALL, MOST_REAL, 1);
    held_to(of_filter(&forged.filter.k.usual[c_], sizeof(tse_real), "usual"), TSE_R(1), MOST_REAL, 1);
  }
  HELD(filter.k.activity, TSE_R(0), MOST_SQUARE);
  ANY_SIGN(filter.k.before);
  ANY_SIGN(filter.k.pitch);
  HELD(filter.k.steer, TSE_R(-2), TSE_R(2));
  NOT_NEGATIVE(filter.k.since_slow);
  HELD(filter.k.moved, TSE_R(0), MOST_VARIANCE);
  NOT_NEGATIVE(filter.k.seen);
  NOT_NEGATIVE(filter.k.nis);
  NOT_NEGATIVE(filter.k.change_age);
  NOT_NEGATIVE(filter.k.agrees_for);
  ANY_SIGN(filter.k.agreement.smooth);
  NOT_NEGATIVE(filter.k.agreement.since);
  HELD(filter.k.agreement.moved, TSE_R(0), MOST_SQUARE);
  WHOLE(filter.k.agreement.apart, 0, (1 << (TSE_PAIRS + 3)) - 1); /* pairs, then LATE_ACCEL ... */
  WHOLE(filter.k.agreement.off_scale, 0, 1);
  for (int c_ = 0; c_ < TSE_PAIRS; c_++) {
    NOT_NEGATIVE(filter.k.agreement.pair[c_].time);
    ANY_SIGN(filter.k.agreement.pair[c_].mean);
    HELD(filter.k.agreement.pair[c_].var, TSE_R(0), MOST_SQUARE);
    ANY_SIGN(filter.k.agreement.pair[c_].both);
  }
  ANY_SIGN(filter.k.innovation);
  HELD(filter.k.innovation_var, TSE_R(0), MOST_SQUARE);
  ANY_SIGN(filter.k.last_innovation);
  ANY_SIGN(filter.k.slow);
  HELD(filter.k.slow_var, TSE_R(0), MOST_SQUARE);
  ANY_SIGN(filter.k.lasting);
  HELD(filter.k.lasting_var, TSE_R(0), MOST_SQUARE);
  ANY_SIGN(filter.k.reading);
  HELD(filter.k.repeats, TSE_R(0), TSE_R(1));
  HELD(filter.k.repeats_again, TSE_R(0), TSE_R(1));
  NOT_NEGATIVE(filter.k.frozen);
  ANY_SIGN(filter.k.log_likelihood);
  HELD(filter.k.weight, TSE_R(0), TSE_R(1));
  HELD(filter.k.none, TSE_R(0), TSE_R(1));
  HELD(filter.k.change_from, TSE_R(-10), TSE_R(10));
  NOT_NEGATIVE(filter.k.change_from_var);
  ANY_SIGN(filter.k.along.mean);
  NOT_NEGATIVE(filter.k.along.var);
  ANY_SIGN(filter.k.along_from.mean);
  NOT_NEGATIVE(filter.k.along_from.var);
  WHOLE(filter.k.change_kind, TSE_CHANGE_NONE, TSE_CHANGE_RESTART);
  WHOLE(filter.k.fault, 0, TSE_CHANNELS);
  WHOLE(filter.k.slow_turn, 0, TSE_SLOW - 1);
  for (int j = 0; j < TSE_ALL; j++)
    ELEMENT_HELD(&forged.filter.k.ud.w[0][j],
        j < TSE_STATES ? forged.filter.k.ud.d[j] : forged.filter.k.ud.e[j - TSE_STATES]);
  HELD(filter.k.ud.e, TSE_R(0), MOST_VARIANCE);
  for (int c_ = 0; c_ < TSE_VELOCITIES; c_++) forged.filter.k.velocity.noise[c_] = TSE_R(1);
  WHOLE(filter.k.ud.extras, TSE_EXTRAS, TSE_EXTRAS);
  WHOLE(filter.k.ud.extras, 0, 0);
  forged.filter.k.ud.extras = TSE_EXTRAS;
  for (int c_ = 0; c_ < TSE_VELOCITIES; c_++) {
    const place noise = of_filter(&forged.filter.k.velocity.noise[c_], sizeof(tse_real), "velocity.noise");
    held_to(noise, LEAST_OF_ALL, MOST_REAL, 1);
    expect(&noise, 0, TSE_R(0), TSE_E_STATE);
  }
  ANY_SIGN(filter.k.velocity.innovation);
  ANY_SIGN(filter.k.velocity.last);
  NOT_NEGATIVE(filter.k.velocity.since);
  NOT_NEGATIVE(filter.k.velocity.mean_nis);
  NOT_NEGATIVE(filter.k.velocity.rejected_for);
  ANY_SIGN(filter.k.velocity.past);
  NOT_NEGATIVE(filter.k.velocity.age);
  ANY_SIGN(filter.k.velocity.gyro);
  ANY_SIGN(filter.k.velocity.turned);
  ANY_SIGN(filter.k.velocity.motion);
  HELD(filter.k.velocity.activity, TSE_R(0), MOST_SQUARE);
  WHOLE(filter.k.velocity.kept, 0, TSE_PAST);
  WHOLE(filter.k.velocity.has_heading, 0, 1);
  WHOLE(filter.k.velocity.has_gyro, 0, 1);
  for (int i = 0; i < TSE_EVENTS; i++) {
    WHOLE(filter.k.event[i].kind, EVENT_NONE, EVENT_KINDS - 1);
    ROW_HELD(filter.k.event[i].v);
    NOT_NEGATIVE(filter.k.event[i].info);
    ANY_SIGN(filter.k.event[i].score);
    ANY_SIGN(filter.k.event[i].both);
    NOT_NEGATIVE(filter.k.event[i].age);
  }
}

static void test_particles_are_held_to_their_ranges(void)
{
  drive(1, 1);
  ANY_SIGN(filter.steer); /* members that every filter has, too */
  ANY_SIGN(log_total);
  NOT_NEGATIVE(gamma);
  HELD(bias_var, TSE_R(0), MOST_SQUARE);
  ANY_SIGN(excite);
  ANY_SIGN(excite_mean);
  HELD(excite_sq, TSE_R(0), MOST_SQUARE);
  ANY_SIGN(slow);
  HELD(weight, TSE_R(0), TSE_R(1));
  ANY_SIGN(p.x);
  HELD_AMONG_OTHERS(p.mu, -MOST_REAL, MOST_REAL);
  for (int a = 0; a < 3; a++) HELD(p.mu[a][p.particles - 1], p.w_low, p.w_max);
  ANY_SIGN(p.bias);
  ANY_SIGN(p.w);
  HELD_AMONG_OTHERS(p.lam, -MOST_REAL, MOST_REAL);
  for (int d = 0; d < 6; d += d ? 2 : 3) NOT_NEGATIVE(p.lam[d][p.particles - 1]);
  HELD(p.logw[0][p.particles - 1], -MOST_REAL, TSE_R(64));
  HELD(p.logw[0][TSE_STRIDE - 1], -MOST_REAL, MOST_REAL);
  HELD_AMONG_OTHERS(nu, TSE_R(4), MOST_REAL);
  HELD(nu, TSE_R(4.001), MOST_REAL);
  forged.filter.started = 0;
  NOT_NEGATIVE(nu);
  for (int d = 0; d < 6; d += d ? 2 : 3) ANY_SIGN(p.lam[d][0]);
}

/* The Kalman filter ignores particles: a filter with them counts as one without. Particle
 * filters require them. */
static void test_a_filter_may_be_larger_than_its_form_needs_and_not_smaller(void)
{
  drive(0, 1);
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_filter_check(&p, &forged.filter, sizeof forged.filter));
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_filter_check(&p, &forged.filter, sizeof forged));
  TEST_ASSERT_EQUAL_INT(TSE_E_SIZE, tse_filter_check(&p, &forged.filter, sizeof forged - 1));
  TEST_ASSERT_EQUAL_INT(TSE_E_SIZE, tse_filter_check(&p, &forged.filter, sizeof forged.filter - 1));
  drive(1, 1);
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_filter_check(&p, &forged.filter, sizeof forged));
  TEST_ASSERT_EQUAL_INT(TSE_E_SIZE, tse_filter_check(&p, &forged.filter, sizeof forged.filter));
}

static void simulated(void)
{
  tse_sim_input u = blank_sim_input();
  tse_sim_output y;
  tse_config_exact(&c);
  tse_sim_config_default(&s);
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_sim_reset(&sim, &c, &s, NULL));
  u.dt = real(0.01), u.road_level = real(1);
  for (int k = 0; k < 200; k++) {
    u.steer_angle = real(0.02 * sin(0.1 * k));
    TEST_ASSERT_EQUAL_INT(TSE_OK, tse_sim_step(&sim, &u, &y));
    TEST_ASSERT_EQUAL_INT(TSE_OK, tse_sim_check(&sim, &c, &s));
  }
  other = sim;
}

static void test_a_simulation_is_held_to_its_ranges(void)
{
  simulated();
#define SIMULATED(member, lo, hi) \
  held_to(of_simulation(&other.member, sizeof other.member, #member), lo, hi, 1)
  SIMULATED(x, -MOST_REAL, MOST_REAL);
  SIMULATED(bias, -MOST_REAL, MOST_REAL);
  SIMULATED(drawn, -MOST_REAL, MOST_REAL);
  SIMULATED(steer, -MOST_REAL, MOST_REAL);
  SIMULATED(steer_logged, -MOST_REAL, MOST_REAL);
  SIMULATED(last.dt, TSE_R(0), MOST_REAL);
  whole_number(&other.effects.settled, 0, 1, look_at_simulation, "effects.settled");
  whole_number(&other.effects.steered, 0, 1, look_at_simulation, "effects.steered");
  SIMULATED(effects.lag, -MOST_REAL, MOST_REAL);
  SIMULATED(effects.mode, -MOST_SQUARE, MOST_SQUARE);
  SIMULATED(effects.steer_was, -MOST_REAL, MOST_REAL);
  SIMULATED(effects.imu_was, -MOST_SQUARE, MOST_SQUARE);
  SIMULATED(effects.formula_was, -MOST_REAL, MOST_REAL);
  SIMULATED(effects.formula, -MOST_REAL, MOST_REAL);
  SIMULATED(effects.formula_accel, -MOST_REAL, MOST_REAL);
  SIMULATED(effects.steered_by, -MOST_REAL, MOST_REAL);
  SIMULATED(effects.time, -MOST_REAL, MOST_REAL);
  SIMULATED(effects.heading, -MOST_REAL, MOST_REAL);
  tse_delay *const delays[] = { &other.effects.steer, &other.effects.imu, &other.effects.formula_late };
  for (int k = 0; k < ROWS(delays); k++) {
    held_to(of_simulation(delays[k]->age, sizeof delays[k]->age, "age"), TSE_R(0), MOST_REAL,
        delays[k]->count == 0);
    for (int i = 0; i < TSE_DELAY_ROWS; i++) delays[k]->age[i] = r_from_int(i);
    whole_number(&delays[k]->count, 0, TSE_DELAY_ROWS, look_at_simulation, "count");
  }
  EACH_FIELD(row, TSE_STRUCT_SIM_INPUT)
  if (strcmp(row->name, "dt") != 0)
    held_to(of_simulation((char *)&other.last + row->offset, sizeof(tse_real), row->name), real(row->lo),
        real(row->hi), 1);
}

/* Each setting of the car and of the simulator, changed slightly. */
static void test_a_simulation_of_other_settings_is_refused_whichever_it_is(void)
{
  simulated();
  const tse_config told = c;
#define LOOKED(what)                                                                  \
  other = sim;                                                                        \
  TEST_ASSERT_EQUAL_INT_MESSAGE(TSE_E_STATE, look_at_simulation(), what);             \
  c = told;
  EACH_SETTING(row)
  {
    const double was = row->kind == 's' ? of_setting(setting_field(&c, row)) : whole_field(&c, row),
                 end = was < row->hi ? row->hi : row->lo;
    put_field(&c, row, row->kind == 's' ? was + 0.001 * (end - was) : was < row->hi ? was + 1 : was - 1);
    LOOKED(row->name)
  }
  EACH_FIELD(row, TSE_STRUCT_SIM_CONFIG)
  {
    other = sim;
    put_field(&other.config, row,
        row->kind == 's' ? of_setting(setting_field(&sim.config, row)) + 0.01
                         : whole_field(&sim.config, row) + 1);
    TEST_ASSERT_EQUAL_INT_MESSAGE(TSE_E_STATE, look_at_simulation(), row->name);
  }
  other = sim;
  TEST_ASSERT_EQUAL_INT(TSE_OK, look_at_simulation());
  other.params.car.lf += TSE_R(0.1);
  TEST_ASSERT_EQUAL_INT(TSE_E_STATE, look_at_simulation());
  TEST_ASSERT_EQUAL_INT(TSE_E_NULL, tse_sim_check(NULL, &c, &s));
  TEST_ASSERT_EQUAL_INT(TSE_E_NULL, tse_sim_check(&sim, NULL, &s));
  TEST_ASSERT_EQUAL_INT(TSE_E_NULL, tse_sim_check(&sim, &c, NULL));
  c.mass = setting(-1);
  TEST_ASSERT_EQUAL_INT(TSE_E_CONFIG, tse_sim_check(&sim, &c, &s));
}
