/* tests/unit/model/test_formula.c <-> src/model/formula.h, src/tables/formula.toml: every
 * place is compared with the disturbance of replay from a column there, every function
 * with memory with a recurrence or a closed form. */
#include "unit_support.h"
#include "effect_support.h"

#define PI 3.14159265358979323846

enum { ROWS = 400 };

/* operations by their codes in the table: if the codes change, saved formulas change
 * their meaning */
enum {
  NUMBER_A = 1,
  NUMBER_B = 2,
  ONE = 9,
  TWO = 10,
  STEER = 16,
  VEL_X = 17,
  YAW_RATE = 19,
  ACCEL_Y = 21,
  ANGLE_FRONT = 22,
  TIME = 26,
  ADD = 32,
  SUB = 33,
  MUL = 34,
  DIV = 35,
  SQRT = 40,
  SOFT = 41,
  LAG = 48,
  SECOND = 49,
  LATE = 50,
  PLAY = 51,
  LIMIT = 52,
  RATE = 53,
};

static tse_real column[ROWS];

static void set_program(tse_config *c, int place, const int *ops, int n)
{
  int32_t *const packed[] = { &c->formula_code_1, &c->formula_code_2, &c->formula_code_3, &c->formula_code_4,
    &c->formula_code_5, &c->formula_code_6, &c->formula_code_7, &c->formula_code_8, &c->formula_code_9,
    &c->formula_code_10, &c->formula_code_11 };
  for (int k = 0; k < 11; k++) *packed[k] = 0;
  for (int k = 0; k < n; k++) *packed[k / 3] |= (int32_t)((unsigned)ops[k] << (8 * (k % 3)));
  c->formula_gain = setting(1), c->formula_place = place;
}

#define PROGRAM(c, place, ...) \
  do { \
    const int ops[] = { __VA_ARGS__ }; \
    set_program(c, place, ops, (int)(sizeof ops / sizeof ops[0])); \
  } while (0)

static tse_status status_of(const tse_config *c)
{
  const char *wrong = "";
  const tse_status status = tse_config_check(c, &wrong);
  if (status < 0) TEST_ASSERT_EQUAL_STRING("formula_code_1", wrong);
  return status;
}

static void weave(const tse_config *c)
{
  straight(c, 18, 0.01, ROWS);
  for (int i = 0; i < ROWS; i++) log_steer[i] = real(0.03 * sin(2 * PI * (0.3 + 0.002 * i) * 0.01 * i));
}

/* `within`: tolerance for rounding. In fixed point it includes the numbers of a formula,
 * which are single precision like all settings. */
static void expect_reference(double within, const char *what)
{
  for (int i = 0; i < ROWS; i++) {
    expect_near(number(kept_x[i]), number(got_x[i]), within, what, i);
    expect_near(number(kept_y[i]), number(got_y[i]), within, what, i);
    expect_near(number(kept_r[i]), number(got_r[i]), within, what, i);
  }
}

static void test_a_number_at_a_place_is_the_disturbance_there(void)
{
  for (int place = 0; place < 5; place++) {
    tse_config c = default_car();
    weave(&c);
    tse_replay_log log = the_log();
    const tse_replay_start s = the_start();
    const tse_real **const columns[] = { &log.slip_front, &log.slip_rear, &log.force_x, &log.force_y,
      &log.yaw_accel };
    for (int i = 0; i < ROWS; i++) column[i] = real(0.004);
    *columns[place] = column;
    replay_with(&c, &log, ROWS, &s);
    keep_readings();
    PROGRAM(&c, place, NUMBER_A);
    c.formula_a = setting(0.004);
    replay(&c, ROWS);
    expect_reference(BY_NUMBER(1e-11, 1e-4, 1e-6), "place");
  }
}

static void test_a_share_of_the_stiffness_is_another_stiffness(void)
{
  for (int place = 5; place < 7; place++) {
    tse_config c = default_car();
    weave(&c);
    const tse_replay_log log = the_log();
    tse_replay_start s = the_start();
    *(place == 5 ? &s.cy_front : &s.cy_rear) = real(1.2);
    replay_with(&c, &log, ROWS, &s);
    keep_readings();
    PROGRAM(&c, place, NUMBER_A);
    c.formula_a = setting(0.2);
    replay(&c, ROWS);
    expect_reference(BY_NUMBER(1e-11, 1e-4, 1e-6), "stiffness");
  }
}

static void test_a_reading_is_off_and_the_car_is_not(void)
{
  for (int place = 7; place < 10; place++) {
    tse_config c = default_car();
    weave(&c);
    replay(&c, ROWS);
    keep_readings();
    PROGRAM(&c, place, NUMBER_A);
    c.formula_a = setting(0.5), c.formula_gain = setting(-0.5);
    tse_real *const read[] = { kept_x, kept_y, kept_r };
    for (int i = 0; i < ROWS; i++) read[place - 7][i] -= real(0.25);
    replay(&c, ROWS);
    expect_reference(sizeof(tse_real) == 4 ? 1e-5 : 1e-14, "reading");
  }
}

/* Return the value of a program at a point where all members have different values. */
static double value_of(const int *ops, int n)
{
  static tse_params p;
  tse_effects *const e = &p.effects;
  tse_effect_memory m = { 0 };
  point pt = { 0 };
  memset(&p, 0, sizeof p);
  for (int k = 0; k < n; k++) e->formula_code[k] = (uint8_t)ops[k];
  for (int k = 0; k < TSE_FORMULA_NUMBERS; k++) e->formula[k] = real(k - 2.5);
  e->formula_gain = real(2);
  pt.p = &p, pt.m = &m, pt.u.steer = real(0.5), pt.vx = real(20), pt.vy = real(-1.5), pt.r = real(0.25);
  m.formula_accel[0] = real(-3), m.formula_accel[1] = real(4);
  pt.free_angle[0] = real(0.0625), pt.free_angle[1] = real(-0.125), pt.s.s_front = real(0.03125);
  pt.s.s_rear = real(-0.015625);
  m.time = real(10);
  pt.ahead = real(0.5);
  return number(formula_at(&pt));
}

static void test_every_operation_without_memory_has_its_value(void)
{
  static const struct {
    int ops[3];
    double value;
  } row[] = {
    /* doubled by the gain */
    { { 1 }, -5 },
    { { 2 }, -3 },
    { { 3 }, -1 },
    { { 4 }, 1 },
    { { 5 }, 3 },
    { { 6 }, 5 },
    { { 7 }, 7 },
    { { 8 }, 9 },
    { { 9 }, 2 },
    { { 10 }, 4 },
    { { 16 }, 1 },
    { { 17 }, 40 },
    { { 18 }, -3 },
    { { 19 }, 0.5 },
    { { 20 }, -6 },
    { { 21 }, 8 },
    { { 22 }, 0.125 },
    { { 23 }, -0.25 },
    { { 24 }, 0.0625 },
    { { 25 }, -0.03125 },
    { { 26 }, 21 },
    { { 17, 8, 32 }, 49 },
    { { 17, 8, 33 }, 31 },
    { { 17, 8, 34 }, 180 },
    { { 17, 10, 35 }, 20 },
    { { 17, 1, 35 }, -16 },
    { { 8, 36 }, -9 },
    { { 1, 37 }, 5 },
    { { 8, 37 }, 9 },
    { { 1, 8, 38 }, 9 },
    { { 8, 1, 38 }, 9 },
    { { 1, 8, 39 }, -5 },
    { { 8, 1, 39 }, -5 },
    { { 21, 40 }, 4 },
    { { 1, 40 }, 0 },
  };
  for (int i = 0; i < (int)(sizeof row / sizeof row[0]); i++) {
    int n = 0;
    while (n < 3 && row[i].ops[n]) n++;
    expect_near(row[i].value, value_of(row[i].ops, n), 1e-6, "operation", i);
  }
  static const int by_nothing[] = { 8, 9, 9, 33, 35 }, soft[] = { 21, 41 }, none[] = { 0 };
  expect_near(0, value_of(by_nothing, 5), 0, "x/0", 0);
  expect_near(2 * 4 / sqrt(17.0), value_of(soft, 2), 1e-6, "soft", 0);
  expect_near(0, value_of(none, 1), 0, "no program", 0);
}

static void test_switched_off_it_changes_no_bit(void)
{
  tse_config c = default_car();
  weave(&c);
  replay(&c, ROWS);
  keep_readings();
  PROGRAM(&c, 4, NUMBER_A, STEER, MUL);
  c.formula_a = setting(3), c.formula_gain = setting(0);
  replay(&c, ROWS);
  TEST_ASSERT_EQUAL_MEMORY(kept_x, got_x, ROWS * sizeof(tse_real));
  TEST_ASSERT_EQUAL_MEMORY(kept_y, got_y, ROWS * sizeof(tse_real));
  TEST_ASSERT_EQUAL_MEMORY(kept_r, got_r, ROWS * sizeof(tse_real));
}

/* Return the reading of a gyro that measures f(yaw_rate, a, b): the formula adds f -
 * yaw_rate. */
static void read_through(tse_config *c, int function, double a, double b)
{
  if (function == SECOND) PROGRAM(c, 9, YAW_RATE, NUMBER_A, NUMBER_B, SECOND, YAW_RATE, SUB);
  else if (function == RATE) PROGRAM(c, 9, YAW_RATE, RATE, YAW_RATE, SUB);
  else PROGRAM(c, 9, YAW_RATE, NUMBER_A, function, YAW_RATE, SUB);
  c->formula_a = setting(a), c->formula_b = setting(b);
  replay(c, ROWS);
}

static double clamp(double x, double lo, double hi) { return x < lo ? lo : x > hi ? hi : x; }

static void test_functions_with_memory_are_their_recurrences(void)
{
  const double eps = BY_NUMBER(1e-12, 2e-5, 1e-8);
  tse_config c = default_car();
  weave(&c);
  read_through(&c, PLAY, 0.05, 0);
  for (double y = number(got_yaw[0]), i = 0; i < ROWS; i++) {
    y = clamp(y, number(got_yaw[(int)i]) - 0.05, number(got_yaw[(int)i]) + 0.05);
    expect_near(y, number(got_r[(int)i]), eps, "play", (int)i);
  }
  read_through(&c, LIMIT, 0.4, 0);
  for (double y = number(got_yaw[0]), i = 0; i < ROWS; i++) {
    y = i > 0 ? clamp(number(got_yaw[(int)i]), y - 0.004, y + 0.004) : y;
    expect_near(y, number(got_r[(int)i]), eps, "limit", (int)i);
  }
  read_through(&c, RATE, 0, 0);
  for (int i = 1; i < ROWS; i++)
    expect_near((number(got_yaw[i]) - number(got_yaw[i - 1])) / 0.01, number(got_r[i]), 1e3 * eps, "rate", i);
  read_through(&c, LATE, 0.035, 0);
  for (int i = 4; i < ROWS; i++) /* halfway between two rows */
    expect_near(0.5 * (number(got_yaw[i - 3]) + number(got_yaw[i - 4])), number(got_r[i]), eps, "late", i);
  read_through(&c, LATE, 0.004, 0);
  for (int i = 1; i < ROWS; i++) /* within a row */
    expect_near(
        0.6 * number(got_yaw[i]) + 0.4 * number(got_yaw[i - 1]), number(got_r[i]), eps, "late, little", i);
}

/* For a value that is given at the start and at the end of a step, a lag of time zero
 * gives the mean: the trapezoidal rule. */
static void test_a_lag_of_less_than_half_a_step_is_none(void)
{
  tse_config c = default_car();
  weave(&c);
  static const double time[2] = { 0, 0.0004 }; /* [s] shorter than a step */
  for (int k = 0; k < 2; k++) {
    read_through(&c, LAG, time[k], 0);
    for (int i = 1; i < ROWS; i++) {
      const double now = number(got_yaw[i]), before = number(got_yaw[i - 1]);
      expect_near(0.5 * (now + before), number(got_r[i]), 0.1 * fabs(now - before) + 1e-6, "lag", i);
    }
  }
}

/* A memory that is marked as settled but has no sample, as in a forged state
 * (tse_filter_check()). */
static void test_late_of_nothing_is_now(void)
{
  tse_effect_memory m = { 0 };
  point at = { 0 };
  formula_run f = { 0 };
  m.settled = 1;
  at.ahead = real(0.01), at.m = f.next = &m;
  f.pt = &at;
  expect_near(0.3, number(formula_late(&f, real(0.3), real(0.05))), 1e-7, "late", 0);
  TEST_ASSERT_EQUAL_INT32(1, m.formula_late.count);
  f.next = NULL; /* between two samples: 4 ms after the end of a step of 10 ms from 0.3 to 0.5 */
  expect_near(0.42, number(formula_late(&f, real(0.5), real(0.004))), 1e-7, "late within the step", 0);
  expect_near(0.3, number(formula_late(&f, real(0.5), real(0.01))), 1e-7, "late by the step", 0);
}

static void test_a_quotient_is_one_but_by_nothing(void)
{
  static const double by[] = { -2, -0.25, 0.25, 2 };
  for (int k = 0; k < 4; k++)
    expect_near(3 / by[k], number(formula_div(real(3), real(by[k]))), 1e-7, "quotient", k);
  expect_near(0, number(formula_div(real(3), real(0))), 0, "by nothing", 0);
  for (int k = -1; k < 5; k++)
    expect_near(k > 0 ? 0.5 * k : 0, number(formula_sqrt(real(0.25 * k * abs(k)))), 1e-7, "root", k);
}

/* The amplitude of a lag T at w is 1/sqrt(1 + (w T)^2), of a mode 1/|1 - u^2 + 2 i d u|
 * with u = w/w0. The trapezoidal rule at 0.01 s turns w into 2/h tan(w h/2): 0.03 % at 1
 * Hz. */
static void test_lags_and_modes_have_their_gain(void)
{
  tse_config c = default_car();
  straight(&c, 18, 0.01, ROWS);
  for (int i = 0; i < ROWS; i++) log_steer[i] = real(0.02 * sin(2 * PI * 0.01 * i));
  const double w = 2 * PI;
  for (int k = 0; k < 2; k++) {
    double most_in = 0, most_out = 0;
    read_through(&c, k ? SECOND : LAG, k ? 1.5 : 0.1, 0.3);
    for (int i = ROWS - 100; i < ROWS; i++) {
      most_in = fmax(most_in, fabs(number(got_yaw[i])));
      most_out = fmax(most_out, fabs(number(got_r[i])));
    }
    const double u = w / (2 * PI * 1.5), gain = k ? 1 / hypot(1 - u * u, 2 * 0.3 * u) : 1 / hypot(1, 0.1 * w);
    expect_near(gain, most_out / most_in, 3e-3 * gain, "gain",
        k); /* at most a hundredth of a period between peak and row: 2e-3 */
  }
}

static void test_at_rest_a_memory_holds_what_is(void)
{
  const int functions[] = { LAG, LATE, PLAY, LIMIT, SECOND };
  for (int k = 0; k < 5; k++) {
    tse_config c = default_car();
    straight(&c, 18, 0.01, ROWS);
    tse_replay_log log = the_log();
    tse_replay_start s = the_start();
    s.yaw_rate = real(0.2);
    tse_real first;
    read_through(&c, functions[k], 0.3, 0.5);
    replay_with(&c, &log, ROWS, &s);
    first = got_r[0];
    expect_near(0.2, number(first), 1e-6, "the first row is at rest", functions[k]);
  }
}

/* A point after a step of 10 ms, whose memory holds these numbers. */
static point a_point(const tse_params *p, tse_effect_memory *m, double a, double b, double c)
{
  point at;
  memset(&at, 0, sizeof at);
  memset(m, 0, sizeof *m);
  at.p = p, at.m = m, at.ahead = real(0.01);
  for (int k = 0; k < 2; k++)
    m->formula[k][0] = real(a), m->formula[k][1] = real(b), m->formula[k][2] = real(c);
  return at;
}

/* At rest an operation forgets what it remembers. */
static void test_at_rest_what_was_is_forgotten(void)
{
  const tse_params p = prepared(default_car());
  tse_effect_memory m, next;
  const point at = a_point(&p, &m, 0.7, 0.8, 0.9);
  formula_run f = { &at, &next, 1, 0 };
  memset(&next, 0, sizeof next);
  next.formula_late.count = 5;
  expect_near(0.3, number(formula_second(&f, real(0.3), real(1), real(0.5))), 1e-7, "second", 0);
  expect_near(0, number(next.formula[0][1]), 0, "its rate", 0);
  f.used = 1;
  expect_near(0, number(formula_rate(&f, real(0.3))), 0, "rate", 0);
  expect_near(0.3, number(formula_late(&f, real(0.3), real(0.05))), 1e-7, "late", 0);
  TEST_ASSERT_EQUAL_INT32(1, next.formula_late.count);
}

/* Between two steps the rate is the one of the last step. */
static void test_without_time_a_rate_stays(void)
{
  const tse_params p = prepared(default_car());
  tse_effect_memory m;
  point at = a_point(&p, &m, 0.7, 0.3, 0);
  formula_run f = { &at, NULL, 0, 0 };
  at.ahead = TSE_R(0);
  expect_near(0.7, number(formula_rate(&f, real(0.3))), 1e-7, "rate", 0);
}

/* A width or a rate limit has no sign. A negative frequency, damping or time is 0. */
static void test_a_negative_number_where_none_can_be_is_its_magnitude_or_nothing(void)
{
  const tse_params p = prepared(default_car());
  tse_effect_memory m;
  const point at = a_point(&p, &m, 0.2, 0.1, 0.3);
  for (int sign = -1; sign <= 1; sign += 2) {
    formula_run f = { &at, NULL, 0, 0 };
    expect_near(0.9, number(formula_play(&f, real(1), real(sign * 0.1))), 1e-6, "play", sign);
    expect_near(0.25, number(formula_limit(&f, real(1), real(sign * 5))), 1e-6, "limit", sign);
  }
  static const double pairs[3][2] = { { 1, -0.5 }, { -2, 0.5 }, { -2, -0.5 } };
  for (int n = 0; n < 3; n++) {
    formula_run f = { &at, NULL, 0, 0 }, g = f;
    const double frequency = pairs[n][0], damping = pairs[n][1];
    expect_near(number(formula_second(&g, real(1), real(fmax(frequency, 0)), real(fmax(damping, 0)))),
        number(formula_second(&f, real(1), real(frequency), real(damping))), 0, "second", n);
  }
  m.formula_late.count = 2, m.formula_late.age[1] = real(0.01);
  m.formula_was[0][0] = real(0.5), m.formula_was[0][1] = real(0.4);
  formula_run f = { &at, NULL, 0, 0 };
  expect_near(1, number(formula_late(&f, real(1), real(-0.005))), 1e-7, "late", 0);
}

/* Each operation of a formula has its own memory, also between the stages of a step. */
static void test_two_memories_of_a_formula_do_not_mix(void)
{
  tse_config c = default_car();
  PROGRAM(&c, 0, STEER, NUMBER_A, PLAY, VEL_X, NUMBER_A, PLAY, ADD);
  c.formula_a = setting(0.5);
  const tse_params p = prepared(c);
  tse_effect_memory m;
  point at = a_point(&p, &m, 0, 0, 0);
  m.formula[0][0] = real(0.25), m.formula[1][0] = real(9.75);
  at.u.steer = real(0), at.vx = real(10);
  expect_near(0.25 + 9.75, number(formula_at(&at)), 1e-5, "both inside their play", 0);
}

/* The formula sees slip angles without its own part, of the axle that it names, and the
 * accelerations of the last step. */
static void test_a_signal_is_that_of_its_name(void)
{
  tse_config c = default_car();
  PROGRAM(&c, 0, ANGLE_FRONT + 1);
  const tse_params p = prepared(c);
  tse_effect_memory m;
  point at = a_point(&p, &m, 0, 0, 0);
  at.s.a_front = real(0.01), at.s.a_rear = real(0.03);
  formula_slip(&at);
  expect_near(0.04, number(at.s.a_front), 1e-7, "front, with the slip angle of the rear", 0);
  expect_near(0.03, number(at.s.a_rear), 1e-7, "rear", 0);
  at.force.x = real(1.5), at.force.y = real(-2.5);
  formula_remember(&m, &at, 0);
  expect_near(1.5, number(m.formula_accel[0]), 0, "accel_x", 0);
  expect_near(-2.5, number(m.formula_accel[1]), 0, "accel_y", 0);
}

/* However large its value, a formula leaves 2 % of a stiffness. */
static void test_a_stiffness_stays_positive(void)
{
  for (int place = 5; place < 7; place++) {
    tse_config c = default_car();
    PROGRAM(&c, place, NUMBER_A);
    c.formula_a = setting(-3);
    const tse_params p = prepared(c);
    tse_effect_memory m;
    point at = a_point(&p, &m, 0, 0, 0);
    at.k.y_front = at.k.y_rear = real(50);
    formula_stiffness(&at);
    expect_near(place == 5 ? 1 : 50, number(at.k.y_front), 1e-5, "front", place);
    expect_near(place == 5 ? 50 : 1, number(at.k.y_rear), 1e-5, "rear", place);
  }
}

static void test_what_is_no_number_is_nothing(void)
{
  tse_config c = default_car();
  weave(&c);
  replay(&c, ROWS);
  keep_readings();
  PROGRAM(&c, 4, ONE, NUMBER_A, DIV, NUMBER_B, SQRT, ADD); /* 1/0 + sqrt(-1) */
  c.formula_b = setting(-1);
  replay(&c, ROWS);
  expect_reference(sizeof(tse_real) == 4 ? 1e-5 : 1e-11, "0");
  PROGRAM(&c, 4, NUMBER_A, NUMBER_A, MUL, NUMBER_A, MUL); /* -1e18, 1e18 */
  for (int sign = -1; sign <= 1; sign += 2) {
    c.formula_a = setting(sign * 1000000);
    replay(&c, ROWS);
    expect_reference(sizeof(tse_real) == 4 ? 1e-5 : 1e-11, "too large");
  }
  PROGRAM(&c, 4, NUMBER_A, NUMBER_A, MUL, NUMBER_A, MUL, RATE, SOFT); /* 1e18 */
  c.formula_a = setting(1000000);
  replay(&c, ROWS);
  for (int i = 0; i < ROWS; i++) TEST_ASSERT_TRUE(r_is_finite(got_r[i]));
}

static void test_programs_that_do_not_fit_are_refused(void)
{
#define EXPECT(status, what, ...)       \
  PROGRAM(&c, 0, __VA_ARGS__); \
  TEST_ASSERT_EQUAL_INT_MESSAGE(status, status_of(&c), what)
  tse_config c = default_car();
  EXPECT(TSE_OK, "a program", NUMBER_A, STEER, MUL);
  EXPECT(TSE_E_CONFIG, "takes more than there is", NUMBER_A, MUL);
  EXPECT(TSE_E_CONFIG, "leaves two values", NUMBER_A, NUMBER_B);
  set_program(&c, 0, NULL, 0);
  TEST_ASSERT_EQUAL_INT_MESSAGE(TSE_OK, status_of(&c), "no program is no formula");
  EXPECT(TSE_E_CONFIG, "no operation", 200);
  EXPECT(TSE_E_CONFIG, "four memories", STEER, RATE, RATE, RATE, RATE);
  EXPECT(TSE_E_CONFIG, "two delays", STEER, NUMBER_A, LATE, NUMBER_A, LATE);
  EXPECT(TSE_E_CONFIG, "nine values deep", ONE, ONE, ONE, ONE, ONE, ONE, ONE, ONE, ONE, ADD, ADD, ADD, ADD,
      ADD, ADD, ADD, ADD);
  EXPECT(
      TSE_OK, "eight values deep", ONE, ONE, ONE, ONE, ONE, ONE, ONE, ONE, ADD, ADD, ADD, ADD, ADD, ADD, ADD);
  PROGRAM(&c, 0, NUMBER_A, MUL);
  c.formula_gain = setting(0);
  TEST_ASSERT_EQUAL_INT_MESSAGE(TSE_OK, status_of(&c), "switched off, nobody runs it");
}

static void test_every_operation_is_known_and_a_program_may_fill_its_room(void)
{
  int32_t count;
  const tse_field *const op = tse_describe(TSE_STRUCT_FORMULA_OP, &count, NULL);
  for (int i = 0; i < count; i++)
    for (int n = 0; n <= 3; n++) { /* the number of values that it needs, or another number */
      tse_config c = default_car();
      int ops[4] = { ONE, ONE, ONE, ONE };
      ops[n] = op[i].offset;
      set_program(&c, 2, ops, n + 1);
      TEST_ASSERT_EQUAL_INT(n == (int)op[i].def ? TSE_OK : TSE_E_CONFIG, status_of(&c));
    }
  tse_config c = default_car();
  int full[TSE_FORMULA_OPS] = { ONE };
  for (int k = 1; k < TSE_FORMULA_OPS; k += 2) {
    full[k] = ONE;
    full[k + 1] = ADD;
  }
  set_program(&c, 2, full, TSE_FORMULA_OPS);
  TEST_ASSERT_EQUAL_INT(TSE_OK, status_of(&c));
  expect_near(2 * (TSE_FORMULA_OPS + 1) / 2, value_of(full, TSE_FORMULA_OPS), 1e-6,
      "as many ones as there is room for", 0);
  full[TSE_FORMULA_OPS - 1] = ONE; /* ends with two values; the name of the setting is not requested */
  set_program(&c, 2, full, TSE_FORMULA_OPS);
  TEST_ASSERT_EQUAL_INT(TSE_E_CONFIG, tse_config_check(&c, NULL));
}
