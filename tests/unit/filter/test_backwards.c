/* tests/unit/filter/test_backwards.c <-> src/filter/backwards.c, step.c: a car that
 * reverses out of a parking place, with wheel speeds without sign. Textbook kinematics:
 * yaw rate is speed times steering angle over wheelbase, accel_x is the derivative of the
 * speed. */
#include "filter/backwards.h"
#include "filter_support.h"

typedef struct leg {
  double speed, steer; /* [m/s] at its end, negative in reverse; [rad] */
} leg;

typedef struct way {
  const char *what;
  double factor[TSE_CHANNELS], slope; /* of each channel as read; [m/s2] */
  uint32_t missing;
  leg last; /* after 3 s of standstill, at 1 m/s2 */
  int held; /* 1: above hold_speed at the end */
} way;

static tse_filter f;
static tse_params p;

/* Drive: stand still, change the speed, hold it for 3 s.
 *   Returned:  number of rows above hold_speed
 *              held  number of those whose status is held */
static int rolled(const way *w, int *held)
{
  const double wheelbase = number(p.car.lf) + number(p.car.lr), target = w->last.speed, dt = 0.01;
  double v = 0;
  int rows = 0;
  uint32_t seed = 3;
  *held = 0;
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_reset(&p, &f, sizeof f));
  for (int n = 0; n < 1500; n++) {
    const double ax = n < 300 || fabs(v) >= fabs(target) ? 0
        : target < 0                                     ? -1
                                                         : 1,
                 r = v * w->last.steer / wheelbase;
    tse_input u;
    tse_output y;
    v += ax * dt;
    tse_input_default(&u);
    u.dt = real(dt), u.missing = w->missing;
    u.steer_angle = real(w->factor[TSE_CHANNEL_steer_angle] * w->last.steer);
    u.wheel_speed_front = real(w->factor[TSE_CHANNEL_wheel_speed_front] * fabs(v) / number(p.radius_front));
    u.wheel_speed_rear = real(w->factor[TSE_CHANNEL_wheel_speed_rear] * fabs(v) / number(p.radius_rear));
    u.accel_x = real(w->factor[TSE_CHANNEL_accel_x] * (ax + w->slope + 0.05 * next_normal(&seed)));
    u.accel_y = real(v * r);
    u.yaw_rate = real(w->factor[TSE_CHANNEL_yaw_rate] * (r + 0.003 * next_normal(&seed)));
    TEST_ASSERT_GREATER_OR_EQUAL_INT(0, tse_step(&p, &f, &u, &y));
    TEST_ASSERT_EQUAL_INT(TSE_OK, tse_filter_check(&p, &f, sizeof f));
    if (n < 300 || fabs(v) < number(p.hold_speed) + 0.05) continue;
    rows++;
    *held += y.status == TSE_W_HELD || y.reason[TSE_CY_FRONT] == TSE_HELD;
  }
  return rows;
}

#define RIGHT { 1, 1, 1, 1, 1, 1 }
#define ALONE (TSE_MISSING_accel_x)

static void test_a_car_that_rolls_backwards_is_held(void)
{
  static const way ways[] = {
    { "backwards, full lock", RIGHT, 0, 0, { -4, 0.5 }, 1 },
    { "backwards, to the right", RIGHT, 0, 0, { -4, -0.3 }, 1 },
    { "backwards, straight", RIGHT, 0, 0, { -4, 0 }, 1 },
    { "backwards, and accel_x is missing", RIGHT, 0, ALONE, { -4, 0.2 }, 1 },
    { "backwards, and the yaw rate is missing", RIGHT, 0, TSE_MISSING_yaw_rate, { -4, 0.2 }, 1 },
    { "backwards down a slope", RIGHT, 0.6, 0, { -4, 0.3 }, 1 },
    { "forward, full lock", RIGHT, 0, 0, { 4, 0.5 }, 0 },
    { "forward, straight", RIGHT, 0, 0, { 4, 0 }, 0 },
    { "forward down a ramp of 15 %", RIGHT, -1.5, 0, { 4, 0 }, 0 },
    { "forward, accel_x missing", RIGHT, 0, ALONE, { 4, 0.2 }, 0 },
    { "forward, accel_x to the rear, in a bend", { 1, 1, 1, -1, 1, 1 }, 0, 0, { 4, 0.2 }, 0 },
    { "forward, steering to the right", { -1, 1, 1, 1, 1, 1 }, 0, 0, { 4, 0.2 }, 0 },
    { "forward, yaw rate to the right", { 1, 1, 1, 1, 1, -1 }, 0, 0, { 4, -0.2 }, 0 },
    { "backwards, wheel speeds with their sign", { 1, -1, -1, 1, 1, 1 }, 0, 0, { -4, 0.2 }, 1 },
    { "forward, faster than any car backwards, accel_x to the rear", { 1, 1, 1, -1, 1, 1 }, 0, 0, { 9, 0 },
        0 },
  };
  p = prepared(config_by(tse_config_default));
  for (int i = 0; i < ROWS(ways); i++) {
    int held;
    const int rows = rolled(&ways[i], &held);
    TEST_ASSERT_GREATER_THAN_INT(90, rows);
    if (ways[i].last.speed > 8)
      TEST_ASSERT_LESS_THAN_INT_MESSAGE(rows * 3 / 4, held, ways[i].what); /* undecided before */
    else TEST_ASSERT_EQUAL_INT_MESSAGE(ways[i].held ? rows : 0, held, ways[i].what);
  }
}

/* A row of a car that rolls at a speed, with all channels. */
static decoded a_row(double dt, double speed, double steer, double turn, double accel_x)
{
  decoded z = { 0 };
  z.dt = real(dt), z.has_steer = 1, z.steer = real(steer);
  z.use[ACCEL_X] = z.use[YAW_RATE] = z.use[WHEEL_FRONT] = z.use[WHEEL_REAR] = 1;
  z.z[ACCEL_X] = real(accel_x), z.z[YAW_RATE] = real(turn);
  z.z[WHEEL_FRONT] = z.z[WHEEL_REAR] = z.axle[0] = z.axle[1] = real(speed);
  return z;
}

/* Log odds of y = -x to y = x, from the two normal densities. */
static double opposite(double x, double y, double sd)
{
  const double odds = 0.5 * (pow((y - x) / sd, 2) - pow((y + x) / sd, 2)), max = number(TAIL);
  return fmax(-max, fmin(max, odds));
}

/* The yaw rate counts less its bias, and for as much as the row is new in SMOOTH_TIME. A
 * row without angle or without yaw rate says nothing. */
static void test_a_turn_against_the_steering_angle_is_evidence_of_reverse(void)
{
  static const struct {
    double dt, speed, steer, turn; /* [s] [m/s] [rad] [rad/s] */
  } rows[] = { { 0.05, 2, 0.2, 0.03 }, { 0.05, 2, 0.2, -0.03 }, { 0.05, 2, -0.2, 0.03 },
    { 0.05, 0.6, 0.2, 0.02 }, { 0.05, 6, 0.05, -0.05 }, { 0.05, 3, 0.5, -0.6 }, { 1, 2, 0.1, 0.02 } };
  p = prepared(config_by(tse_config_default));
  const double wheelbase = number(p.car.lf) + number(p.car.lr);
  for (int n = 0; n < ROWS(rows); n++)
    for (int lacks = 0; lacks < 3; lacks++) {
      memset(&f, 0, sizeof f);
      f.k.x[BR] = real(0.02);
      f.way.by_turn = TSE_R(1);
      decoded z = a_row(rows[n].dt, rows[n].speed, rows[n].steer, rows[n].turn + 0.02, 0);
      if (lacks == 1) z.has_steer = 0;
      if (lacks == 2) z.use[YAW_RATE] = 0;
      (void)rolls_backwards(&p, &f, &z, real(rows[n].speed));
      const double sd = number(STEER_FAULT_SD) * fmax(rows[n].speed, 1) / wheelbase,
                   odds = opposite(rows[n].speed * rows[n].steer / wheelbase, rows[n].turn, sd),
                   share = fmin(1, rows[n].dt / number(SMOOTH_TIME));
      const double sum = fmin(number(TAIL), 1 + share * odds);
      expect_near(
          lacks ? 1 : sum, number(f.way.by_turn), BY_NUMBER(1e-9, 1e-4, 2e-3), "log odds", 10 * n + lacks);
    }
}

/* The gain of speed counts from the last standstill. accel_x is integrated over rows
 * without it, and over rows without a wheel speed, in which neither is compared. */
static void test_a_gain_of_speed_against_accel_x_is_evidence_of_reverse(void)
{
  p = prepared(config_by(tse_config_default));
  for (int backwards = 0; backwards < 2; backwards++) {
    double largest = 0, gained = 0;
    memset(&f, 0, sizeof f);
    f.way.by_gain = TSE_R(2), f.way.gained = TSE_R(5); /* of an earlier way */
    const decoded stands = a_row(0.1, 0.25, 0, 0, 4);
    (void)rolls_backwards(&p, &f, &stands, real(0.25));
    expect_near(0, number(f.way.by_gain), 0, "at standstill", backwards);
    double unread = 0;
    for (int n = 1; n <= 30; n++) {
      const double t = 0.1 * n, v = 0.25 + fmin(t, 2), accel = t > 2 ? 0 : backwards ? -1 : 1;
      decoded z = a_row(0.1, v, 0, 0, accel);
      if (n > 5 && n < 9) z.use[ACCEL_X] = 0, z.z[ACCEL_X] = TSE_R(0);
      if (n > 11 && n < 15) z.use[WHEEL_FRONT] = z.use[WHEEL_REAR] = 0;
      unread += 0.1;
      const int compares = z.use[ACCEL_X] && z.use[WHEEL_REAR] && v >= 0.5;
      (void)rolls_backwards(&p, &f, &z, real(z.use[WHEEL_REAR] ? v : 0.1));
      if (v < 0.5) { /* still stands */
        unread = 0;
        continue;
      }
      if (!compares) continue;
      gained += accel * unread, unread = 0;
      const double rolls_for = t - 0.2, sd = sqrt(1 + pow(number(MIN_ACTIVITY) * rolls_for, 2)),
                   odds = opposite(v - 0.45, gained, sd);
      if (fabs(odds) > fabs(largest)) largest = odds;
      expect_near(largest, number(f.way.by_gain), BY_NUMBER(1e-9, 1e-4, 2e-3), "log odds", n);
    }
    TEST_ASSERT_TRUE(backwards ? largest > 1 : largest < -1);
  }
}

/* A sign of a wheel speed ends the tests, also of one axle alone. Faster than any car
 * backwards, both tests have the odds of a car that drives forwards. */
static void test_what_was_found_ends_with_a_sign_and_with_a_fast_car(void)
{
  static const struct {
    double front, rear, speed, odds; /* [m/s], log odds of each test */
  } rows[] = { { 3, 3, 3, 2 }, { -3, -3, 3, 0 }, { -3, 3, 3, 0 }, { 3, -3, 3, 0 }, { 0.4, 0.4, 0.4, 0 },
    { 9, 9, 9, -9 }, { -9, -9, 9, -9 } };
  p = prepared(config_by(tse_config_default));
  for (int n = 0; n < ROWS(rows); n++) {
    memset(&f, 0, sizeof f);
    f.way.by_turn = f.way.by_gain = TSE_R(2), f.way.begins = real(0.2), f.way.gained = real(0.1);
    decoded z = a_row(0.01, rows[n].speed, 0, 0, 0);
    z.axle[0] = real(rows[n].front), z.axle[1] = real(rows[n].rear);
    (void)rolls_backwards(&p, &f, &z, real(rows[n].speed));
    expect_near(rows[n].odds, number(f.way.by_turn), 1e-6, "by the turn", n);
    expect_near(rows[n].odds, number(f.way.by_gain), 1e-6, "by the gain", n);
    expect_near(n ? rows[n].speed : 0.2, number(f.way.begins), 1e-6, "speed at its begin", n);
    expect_near(n ? 0 : 0.1, number(f.way.gained), 1e-6, "gained", n);
  }
}

/* The sum of both log odds decides, unless one of them speaks against it. */
static void test_both_tests_together_decide_and_neither_may_contradict(void)
{
  static const struct {
    double turn, gain;
    int backwards;
  } cases[] = { { 4.6, 0, 1 }, { 4.4, 0, 0 }, { 2.3, 2.3, 1 }, { 0, 4.6, 1 }, { 7, -2, 1 }, { -2, 7, 1 },
    { 8, -2.5, 0 }, { -2.5, 8, 0 }, { 0, 0, 0 } };
  p = prepared(config_by(tse_config_default));
  for (int n = 0; n < ROWS(cases); n++) {
    memset(&f, 0, sizeof f);
    f.way.by_turn = real(cases[n].turn), f.way.by_gain = real(cases[n].gain);
    decoded z = a_row(0.01, 0, 0.3, -1, 1);
    z.use[WHEEL_FRONT] = z.use[WHEEL_REAR] = 0; /* such a row compares nothing, and ends nothing */
    TEST_ASSERT_EQUAL_INT(cases[n].backwards, rolls_backwards(&p, &f, &z, real(0.1)));
    expect_near(cases[n].turn, number(f.way.by_turn), 1e-6, "by the turn", n);
  }
}
