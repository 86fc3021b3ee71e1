/* tests/unit/estimator/paper/test_slide.c <-> src/estimator/paper/slide.c: wheels that lock or spin, and the motion meanwhile.
 *
 * References: closed-form kinematics. The rule is Euler's, so that a motion with constant rates is exact but for rounding. */
#include "estimator/paper/particles.h"
#include "unit_support.h"

enum { PARTICLES = 20 };
#define DT 0.01

static tse_filter_paper f, before;

static tse_config settings(void)
{
  tse_config c;
  tse_config_sampled(&c);
  c.particles = PARTICLES;
  c.max_slip = setting(0.05);
  c.hold_speed = setting(2);
  c.initial_vel_x_sd = c.initial_vel_y_sd = c.initial_yaw_rate_sd = setting(0);
  return c;
}

static sample wheels(double front, double rear)
{
  sample y;
  memset(&y, 0, sizeof y);
  y.dt = real(DT);
  y.u.v_front = real(front);
  y.u.v_rear = real(rear);
  y.has_inputs = 1;
  y.use[0] = y.use[1] = y.use[2] = TSE_R(1);
  y.used = 3;
  return y;
}

static void start(double vel_x)
{
  memset(&f, 0, sizeof f);
  f.vel_x = real(vel_x);
  for (int32_t i = 0; i < PARTICLES; i++) f.p.x[0][i] = real(vel_x);
}

/* -------------------------------------------------------------------------------------- begin and end */

/* Slip is taken over the larger of the two speeds. */
static void test_a_slide_begins_beyond_the_largest_slip_of_either_axle_in_either_direction(void)
{
  static const double slip[] = { 0.0, 0.02, 0.0499, 0.0501, 0.2, 1.0 };
  const tse_config c = settings();
  const tse_params p = prepared(&c);
  for (int direction = -1; direction <= 1; direction += 2)
    for (int k = 0; k < ROWS(slip); k++)
      for (int how = 0; how < 4; how++) {
        const double v = direction * 20.0, other = v * 1.01;
        const double turning = how % 2 ? v * (1.0 - slip[k]) : v / fmax(1.0 - slip[k], 0.05); /* braked, driven */
        const sample y = how < 2 ? wheels(turning, other) : wheels(other, turning);
        start(v);
        TEST_ASSERT_EQUAL_INT(slip[k] > 0.05, wheels_slide(&p, &f, &y));
      }
}

static void test_no_slide_begins_below_the_speed_at_which_slip_is_small_numbers_over_small_numbers(void)
{
  const tse_config c = settings();
  const tse_params p = prepared(&c);
  const sample y = wheels(0.0, 5.0);
  start(1.99);
  TEST_ASSERT_FALSE(wheels_slide(&p, &f, &y));
  start(2.01);
  TEST_ASSERT_TRUE(wheels_slide(&p, &f, &y));
}

static void test_a_slide_goes_on_beyond_half_of_that_slip_and_ends_after_a_tenth_of_a_second_of_rolling(void)
{
  const tse_config c = settings();
  const tse_params p = prepared(&c);
  const sample locked = wheels(0.0, 20.0), nearly = wheels(20.0 * 0.974, 20.0), rolling = wheels(20.0 * 0.976, 20.0);
  start(20.0);
  TEST_ASSERT_FALSE(wheels_slide(&p, &f, &nearly));
  for (int i = 0; i < 50; i++) TEST_ASSERT_TRUE(wheels_slide(&p, &f, &locked));
  for (int i = 0; i < 50; i++) TEST_ASSERT_TRUE(wheels_slide(&p, &f, &nearly));
  for (int i = 0; i < 8; i++) TEST_ASSERT_TRUE(wheels_slide(&p, &f, &rolling));
  TEST_ASSERT_TRUE(wheels_slide(&p, &f, &nearly)); /* the time starts anew */
  before = f;
  int rows = 0;
  while (rows < 20 && wheels_slide(&p, &f, &rolling)) {
    rows++;
  }
  TEST_ASSERT_TRUE(rows == 9 || rows == 10); /* 0.1 s less ten times 0.01 s may leave a rounding */
  expect_near(0.0, number(f.sliding_for), 0.0, "sliding_for", 0);
  TEST_ASSERT_FALSE(wheels_slide(&p, &f, &nearly));
}

/* Integrated accelerometers drift: after five seconds the wheels are believed. */
static void test_the_longest_slide_starts_again_from_the_wheels(void)
{
  const tse_config c = settings();
  const tse_params p = prepared(&c);
  sample y = wheels(10.0, 10.0);
  y.y[2] = r_mul(TSE_R(0.1), p.inv_sd[2]);
  start(20.0);
  int rows = 0;
  while (rows < 1000 && wheels_slide(&p, &f, &y)) rows++;
  TEST_ASSERT_TRUE(rows >= 498 && rows <= 500);
  for (int32_t i = 0; i < PARTICLES; i++) {
    expect_near(10.0, number(f.p.x[0][i]), 0.0, "vel_x", i);
    expect_near(0.0, number(f.p.x[1][i]), 0.0, "vel_y", i);
    expect_near(0.1, number(f.p.x[2][i]), BY_FORMAT(1e-15, 1e-7), "yaw_rate", i);
  }
  expect_near(0.0, number(f.sliding), 0.0, "sliding", 0);
  expect_near(0.0, number(f.sliding_for), 0.0, "sliding_for", 0);
}

static void test_without_inputs_a_slide_neither_begins_nor_ends_and_without_a_limit_there_is_none(void)
{
  tse_config c = settings();
  tse_params p = prepared(&c);
  sample y = wheels(0.0, 0.0);
  y.has_inputs = 0;
  start(20.0);
  before = f;
  TEST_ASSERT_FALSE(wheels_slide(&p, &f, &y));
  TEST_ASSERT_EQUAL_MEMORY(&before, &f, sizeof f);
  f.sliding = TSE_R(0.05);
  before = f;
  TEST_ASSERT_TRUE(wheels_slide(&p, &f, &y));
  TEST_ASSERT_EQUAL_MEMORY(&before, &f, sizeof f);
  c.max_slip = setting(1);
  p = prepared(&c);
  y.has_inputs = 1;
  start(20.0);
  before = f;
  TEST_ASSERT_FALSE(wheels_slide(&p, &f, &y));
  TEST_ASSERT_EQUAL_MEMORY(&before, &f, sizeof f);
}

/* --------------------------------------------------------------------------------------------- coasting */

/* Readings of acceleration and yaw rate in SI units; each particle has biases of its own, which are taken off again. */
static sample readings(const tse_params *p, double ax, double ay, double r)
{
  const double value[3] = { ax, ay, r };
  sample y = wheels(0.0, 0.0);
  for (int a = 0; a < 3; a++) y.y[a] = real(value[a] / number(p->sd[a]) + 0.25);
  for (int a = 0; a < 3; a++)
    for (int32_t i = 0; i < PARTICLES; i++) f.p.bias[a][i] = TSE_R(0.25);
  return y;
}

static void place(double vx, double vy, double r)
{
  memset(&f, 0, sizeof f);
  for (int32_t i = 0; i < PARTICLES; i++) {
    f.p.x[0][i] = real(vx);
    f.p.x[1][i] = real(vy);
    f.p.x[2][i] = real(r);
  }
}

static void expect_state(double vx, double vy, double r, double tolerance)
{
  for (int32_t i = 0; i < PARTICLES; i++) {
    expect_near(vx, number(f.p.x[0][i]), tolerance, "vel_x", i);
    expect_near(vy, number(f.p.x[1][i]), tolerance, "vel_y", i);
    expect_near(r, number(f.p.x[2][i]), BY_FORMAT(1e-13, 1e-6), "yaw_rate", i);
  }
}

static void test_braking_straight_loses_speed_as_the_accelerometer_says(void)
{
  const tse_config c = settings();
  const tse_params p = prepared(&c);
  place(25.0, 0.0, 0.0);
  const sample y = readings(&p, -8.0, 0.0, 0.0);
  for (int i = 0; i < 200; i++) coast(&p, &f, &y);
  expect_state(25.0 - 8.0 * 2.0, 0.0, 0.0, BY_FORMAT(1e-12, 1e-4));
}

static void test_a_circle_driven_steadily_stays_one(void)
{
  const tse_config c = settings();
  const tse_params p = prepared(&c);
  place(15.0, 0.0, 0.0);
  const sample y = readings(&p, 0.0, 15.0 * 0.4, 0.4);
  for (int i = 0; i < 300; i++) coast(&p, &f, &y);
  expect_state(15.0, 0.0, 0.4, BY_FORMAT(1e-11, 1e-3));
}

/* A car that turns without any force on it keeps its velocity, seen from a frame that turns: v <- v (1 - i r dt) in complex
 * numbers vx + i vy, (1 - i r dt)^n = (1 + (r dt)^2)^(n/2) exp(-i n atan(r dt)). */
static void test_a_car_that_turns_without_a_force_keeps_its_velocity_over_ground(void)
{
  const tse_config c = settings();
  const tse_params p = prepared(&c);
  const double r = 0.8, turned = 200.0 * atan(r * DT), grown = pow(1.0 + r * DT * r * DT, 100.0);
  place(12.0, 5.0, 0.0);
  const sample y = readings(&p, 0.0, 0.0, r);
  for (int i = 0; i < 200; i++) coast(&p, &f, &y);
  const double vx = grown * (12.0 * cos(turned) + 5.0 * sin(turned)), vy = grown * (5.0 * cos(turned) - 12.0 * sin(turned));
  expect_state(vx, vy, r, BY_FORMAT(1e-11, 2e-4));
  expect_near(13.0, sqrt(vx * vx + vy * vy), 0.1, "speed over ground", 0); /* Euler's growth: 0.6 % */
}

static void test_a_missing_accelerometer_reads_nothing_and_a_missing_gyro_goes_on_turning(void)
{
  const tse_config c = settings();
  const tse_params p = prepared(&c);
  place(20.0, 0.0, 0.3);
  sample y = readings(&p, -3.0, 6.0, 5.0);
  y.use[0] = y.use[2] = TSE_R(0);
  coast(&p, &f, &y);
  expect_state(20.0, 0.01 * (6.0 - 20.0 * 0.3), 0.3, BY_FORMAT(1e-13, 1e-6));
  place(20.0, 0.0, 0.0);
  y = readings(&p, -3.0, 6.0, 0.0);
  y.use[1] = TSE_R(0);
  coast(&p, &f, &y);
  expect_state(20.0 - 0.03, 0.0, 0.0, BY_FORMAT(1e-13, 3e-6));
}

static void test_coasting_stays_a_number(void)
{
  const tse_config c = settings();
  const tse_params p = prepared(&c);
  place(199.0, -199.0, 19.0);
  const sample y = readings(&p, 50.0, -50.0, 6.0);
  for (int i = 0; i < 5000; i++) coast(&p, &f, &y);
  for (int32_t i = 0; i < PARTICLES; i++)
    for (int a = 0; a < 3; a++) TEST_ASSERT_TRUE(fabs(number(f.p.x[a][i])) <= 200.0);
}

/* -------------------------------------------------------------------------------------- the whole filter */

static tse_input log_row(double front, double rear, double ax)
{
  tse_input u;
  memset(&u, 0, sizeof u);
  u.dt = real(DT);
  u.wheel_speed_front = real(front / 0.33);
  u.wheel_speed_rear = real(rear / 0.33);
  u.accel_x = real(ax);
  return u;
}

/* Locked wheels stand still, the car does not: 20 m/s, braked with 8 m/s2. The gyro turns as slowly as a standing one. */
static void test_locked_wheels_are_no_standstill_and_speed_follows_the_accelerometer(void)
{
  for (int exact = 0; exact < 2; exact++) {
    tse_config c = settings();
    if (!exact) tse_config_sampled(&c);
    c.particles = PARTICLES;
    const tse_params p = prepared(&c);
    tse_output y;
    memset(&y, 0, sizeof y);
    TEST_ASSERT_EQUAL_INT(TSE_OK, tse_reset(&p, &f.filter, sizeof f));
    for (int i = 0; i < 300; i++) {
      const tse_input u = log_row(20.0, 20.0, 0.01 * (i % 2));
      TEST_ASSERT_TRUE(tse_step(&p, &f.filter, &u, &y) >= 0);
    }
    before = f;
    const double began = number(y.vel_x);
    for (int i = 1; i <= 200; i++) {
      tse_input u = log_row(0.0, 0.0, -8.0);
      u.yaw_rate = real(0.02);
      TEST_ASSERT_EQUAL_INT(TSE_W_HELD, tse_step(&p, &f.filter, &u, &y));
      expect_near(began - 8.0 * DT * i, number(y.vel_x), 0.151, "vel_x", i); /* a bias of 0.05 m/s2 for 2 s */
      expect_near(0.0, number(f.filter.still_for), 0.0, "still_for", i);
      for (int a = 0; a < 3; a++) TEST_ASSERT_EQUAL_INT(TSE_HELD, y.reason[a]);
    }
    TEST_ASSERT_EQUAL_MEMORY(before.p.bias, f.p.bias, sizeof f.p.bias);
    TEST_ASSERT_EQUAL_MEMORY(before.p.mu, f.p.mu, sizeof f.p.mu);
    TEST_ASSERT_EQUAL_MEMORY(before.p.lam, f.p.lam, sizeof f.p.lam);
    for (int i = 0; i < 40; i++) { /* and the wheels roll again */
      const tse_input u = log_row(number(y.vel_x), number(y.vel_x), 0.0);
      TEST_ASSERT_TRUE(tse_step(&p, &f.filter, &u, &y) >= 0);
    }
    TEST_ASSERT_TRUE(y.reason[0] != TSE_HELD);
    expect_near(began - 16.0, number(y.vel_x), 0.3, "vel_x after", exact);
  }
}

int main(void)
{
  UNITY_BEGIN();
  RUN_TEST(test_a_slide_begins_beyond_the_largest_slip_of_either_axle_in_either_direction);
  RUN_TEST(test_no_slide_begins_below_the_speed_at_which_slip_is_small_numbers_over_small_numbers);
  RUN_TEST(test_a_slide_goes_on_beyond_half_of_that_slip_and_ends_after_a_tenth_of_a_second_of_rolling);
  RUN_TEST(test_the_longest_slide_starts_again_from_the_wheels);
  RUN_TEST(test_without_inputs_a_slide_neither_begins_nor_ends_and_without_a_limit_there_is_none);
  RUN_TEST(test_braking_straight_loses_speed_as_the_accelerometer_says);
  RUN_TEST(test_a_circle_driven_steadily_stays_one);
  RUN_TEST(test_a_car_that_turns_without_a_force_keeps_its_velocity_over_ground);
  RUN_TEST(test_a_missing_accelerometer_reads_nothing_and_a_missing_gyro_goes_on_turning);
  RUN_TEST(test_coasting_stays_a_number);
  RUN_TEST(test_locked_wheels_are_no_standstill_and_speed_follows_the_accelerometer);
  return UNITY_END();
}
