/* tests/unit/estimator/test_input.c <-> src/estimator/input.c */
#include "unit_support.h"
#include "tables/input.h"

static tse_filter filter; /* holds the last inputs */

static tse_params params(void)
{
  tse_config c = config_by(tse_config_exact);
  c.wheel_radius_front = setting(0.25), c.wheel_radius_rear = setting(0.5), c.accel_x_sd = setting(0.125);
  c.accel_y_sd = setting(0.25), c.yaw_rate_sd = setting(0.0078125);
  return prepared(c);
}

static void start_filter(void)
{
  memset(&filter, 0, sizeof filter);
  filter.started = 1, filter.steer = real(-0.375), filter.v_front = real(31), filter.v_rear = real(32);
}

static tse_input good_row(void)
{
  tse_input u = blank_row();
  u.dt = real(0.015625), u.steer_angle = real(0.125), u.wheel_speed_front = real(80);
  u.wheel_speed_rear = real(40), u.accel_x = real(0.5), u.accel_y = real(-2), u.yaw_rate = real(0.0625);
  return u;
}

static void set_channel(tse_input *u, const channel_row *row, tse_real x)
{
  memcpy((char *)u + row->at, &x, sizeof x);
}

static void expect_real(double expected, tse_real actual, const char *what)
{
  expect_near(expected, number(actual), 0, what, 0);
}

static void expect_row_refused(const tse_input *u, tse_status status, const char *name)
{
  const tse_params p = params();
  static const char untouched[] = "untouched";
  const char *wrong = untouched;
  static tse_filter before;
  tse_input row;
  sample y;
  memcpy(&row, u, sizeof row);
  memcpy(&before, &filter, sizeof before);
  TEST_ASSERT_EQUAL_INT_MESSAGE(status, tse_input_check(u, &wrong), name);
  TEST_ASSERT_EQUAL_STRING(name, wrong);
  TEST_ASSERT_EQUAL_INT(status, tse_input_check(u, NULL));
  TEST_ASSERT_EQUAL_INT_MESSAGE(status, input_decode(&p, &filter, u, &y), name);
  TEST_ASSERT_EQUAL_MEMORY_MESSAGE(&before, &filter, sizeof before, name);
  TEST_ASSERT_EQUAL_MEMORY(&row, u, sizeof row);
}

static sample expect_row_accepted(const tse_input *u, const char *name)
{
  const tse_params p = params();
  static const char untouched[] = "untouched";
  const char *wrong = untouched;
  sample y;
  memset(&y, 0x77, sizeof y);
  TEST_ASSERT_EQUAL_INT_MESSAGE(TSE_OK, tse_input_check(u, &wrong), name);
  TEST_ASSERT_EQUAL_PTR_MESSAGE(untouched, wrong, name);
  TEST_ASSERT_EQUAL_INT_MESSAGE(TSE_OK, input_decode(&p, &filter, u, &y), name);
  return y;
}

/* Value of a driving channel when it is held, and otherwise: from start_filter(),
 * good_row() and params(). */
static void expect_drives(const sample *y, int steer_held, int front_held, int rear_held)
{
  expect_real(steer_held ? -0.375 : 0.125, y->u.steer, "steering angle");
  expect_real(front_held ? 31 : 20, y->u.v_front, "front wheel's speed");
  expect_real(rear_held ? 32 : 20, y->u.v_rear, "rear wheel's speed");
  TEST_ASSERT_EQUAL_INT(!(steer_held || front_held || rear_held), y->has_inputs);
}

static void expect_measurements(const sample *y, int x_missing, int y_missing, int yaw_missing)
{
  const int is_missing[3] = { x_missing, y_missing, yaw_missing };
  const double value[3] = { 4, -8, 8 }; /* [sd of the sensors] */
  for (int i = 0; i < 3; i++) {
    expect_real(is_missing[i] ? 0 : 1, y->use[i], "use");
    expect_real(is_missing[i] ? 0 : value[i], y->y[i], "measurement");
  }
  TEST_ASSERT_EQUAL_INT(3 - x_missing - y_missing - yaw_missing, y->used);
}

static int is_channel(int channel, int which) { return channel == which; }

static void expect_missing(const sample *y, int channel)
{
  expect_drives(y, is_channel(channel, TSE_CHANNEL_steer_angle),
      is_channel(channel, TSE_CHANNEL_wheel_speed_front), is_channel(channel, TSE_CHANNEL_wheel_speed_rear));
  expect_measurements(y, is_channel(channel, TSE_CHANNEL_accel_x), is_channel(channel, TSE_CHANNEL_accel_y),
      is_channel(channel, TSE_CHANNEL_yaw_rate));
}

/* ----------------------------------------------------------------------------------------- good rows */

static void test_good_row_becomes_speeds_in_metres_and_measurements_in_sigmas(void)
{
  start_filter();
  const tse_input u = good_row();
  const sample y = expect_row_accepted(&u, "good row");
  expect_missing(&y, -1);
  expect_real(0.015625, y.dt, "dt");
}

static void test_each_channel_is_accepted_at_both_limits(void)
{
  start_filter();
  for (const channel_row *row = channel_rows; row < channel_rows + TSE_CHANNELS; row++) {
    tse_input u = good_row();
    set_channel(&u, row, row->lo);
    sample y = expect_row_accepted(&u, row->name);
    TEST_ASSERT_TRUE_MESSAGE(y.has_inputs && y.used == 3, row->name);
    set_channel(&u, row, row->hi);
    y = expect_row_accepted(&u, row->name);
    TEST_ASSERT_TRUE_MESSAGE(y.has_inputs && y.used == 3, row->name);
  }
}

/* --------------------------------------------------------------------- missing channels, one or all */

static void test_channel_that_is_no_number_is_missing_and_one_out_of_range_refused_if_it_drives(void)
{
  int driving = 0;
  start_filter();
  for (const channel_row *row = channel_rows; row < channel_rows + TSE_CHANNELS; row++) {
    const tse_real bad[5] = { neighbour(number(row->hi), INFINITY), neighbour(number(row->lo), -INFINITY),
      real((double)INFINITY), real((double)-INFINITY), real((double)NAN) };
    for (int i = 0; i < 5; i++) {
      tse_input u = good_row();
      set_channel(&u, row, bad[i]);
      if (row->drives && i < 4) {
        expect_row_refused(&u, TSE_E_INPUT, row->name);
        continue;
      }
      const sample y = expect_row_accepted(&u, row->name);
      expect_missing(&y, (int)(row - channel_rows));
    }
    driving += row->drives;
  }
  TEST_ASSERT_EQUAL_INT(3, driving);
}

static void test_channel_whose_bit_is_set_is_missing_whatever_its_value(void)
{
  const double values[] = { 0.0, 0.5, 1e6, -INFINITY, NAN };
  start_filter();
  for (int i = 0; i < ROWS(values); i++) {
    for (const channel_row *row = channel_rows; row < channel_rows + TSE_CHANNELS; row++) {
      tse_input u = good_row();
      set_channel(&u, row, real(values[i]));
      u.missing = 1u << (row - channel_rows);
      const sample y = expect_row_accepted(&u, row->name);
      expect_missing(&y, (int)(row - channel_rows));
    }
  }
}

static void test_row_without_any_channel_is_accepted_and_all_held(void)
{
  start_filter();
  tse_input u = good_row();
  u.missing = 0xffffffffu; /* bits without a channel are ignored */
  sample y = expect_row_accepted(&u, "all missing");
  expect_drives(&y, 1, 1, 1);
  expect_measurements(&y, 1, 1, 1);
  u = good_row();
  u.missing = ~0x3fu;
  y = expect_row_accepted(&u, "no channel's bit");
  expect_missing(&y, -1);
}

static void test_a_default_row_is_a_row_in_which_nothing_moves(void)
{
  tse_input u, rest = { 0 };
  memset(&u, 0x5a, sizeof u);
  tse_input_default(&u);
  rest.dt = real(0.01);
  TEST_ASSERT_EQUAL_MEMORY(&rest, &u, sizeof u);
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_input_check(&u, NULL));
  tse_input_default(NULL);
}

static void test_of_two_wrong_channels_the_first_is_named_and_dt_before_both(void)
{
  start_filter();
  tse_input u = good_row();
  u.wheel_speed_rear = real(1000), u.wheel_speed_front = real(1000);
  expect_row_refused(&u, TSE_E_INPUT, "wheel_speed_front");
  u.dt = real(-1);
  expect_row_refused(&u, TSE_E_TIME, "dt");
}

/* -------------------------------------------------------------------------------------------------- time */

static void test_time_step_must_be_positive_finite_and_at_most_an_hour(void)
{
  const double good[] = { BY_NUMBER(1e-30, 1e-30, QUANTUM), 1e-6, 0.01, 3599.5, 3600 };
  const double bad[] = { 0, -0.0, -0.01, -INFINITY, INFINITY, NAN, 3601 };
  start_filter();
  for (int i = 0; i < ROWS(good); i++) {
    tse_input u = good_row();
    u.dt = real(good[i]);
    const sample y = expect_row_accepted(&u, "dt");
    expect_real(number(real(good[i])), y.dt, "dt");
  }
  for (int i = 0; i < ROWS(bad); i++) {
    tse_input u = good_row();
    u.dt = real(bad[i]);
    expect_row_refused(&u, TSE_E_TIME, "dt");
  }
  tse_input u = good_row();
  u.dt = neighbour(3600, INFINITY);
  expect_row_refused(&u, TSE_E_TIME, "dt");
}

static void test_first_row_is_refused_like_any_other_when_an_input_is_out_of_range(void)
{
  const tse_params p = params();
  sample y;
  start_filter();
  filter.started = 0;
  tse_input u = good_row();
  u.steer_angle = real(2);
  TEST_ASSERT_EQUAL_INT(TSE_E_INPUT, input_decode(&p, &filter, &u, &y));
}

static void test_check_of_no_row_is_refused(void)
{
  const char *wrong = "untouched";
  TEST_ASSERT_EQUAL_INT(TSE_E_NULL, tse_input_check(NULL, &wrong));
  TEST_ASSERT_EQUAL_STRING("untouched", wrong);
}
