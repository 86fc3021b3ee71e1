/* tests/unit/paper/test_row.c <-> src/paper/row.c, algorithm1.c: the particle filter, row
 * by row. */
#include "paper/paper.h"
#include "driven.h"

static tse_filter_paper f, other, before;
static tse_params p;
static drive d;

/* Settings with which every test runs: again(). Fixed point: one of them, to save
 * time. */
static const struct {
  const char *name;
  void (*settings)(tse_config *c);
} forms[] = {
  { "robust", tse_config_robust },
  { "paper", tse_config_paper },
};
static int form;

static int again(void)
{
  return ++form < BY_NUMBER(ROWS(forms), ROWS(forms), 1) && printf("%s:\n", forms[form].name);
}

static tse_config some_settings(int32_t particles)
{
  tse_config c;
  forms[form].settings(&c);
  c.particles = particles;
  c.initial_vel_x_sd = c.initial_vel_y_sd = setting(0.1); /* the drives below start straight */
  c.initial_yaw_rate_sd = setting(0.01);
  return c;
}

static tse_input still_row(double gyro)
{
  tse_input u = blank_row();
  u.dt = real(0.01), u.yaw_rate = real(gyro);
  return u;
}

/* The filter with these settings after so many rows of a drive at 20 m/s; `before` is its
 * state at that time. */
static void set_out(tse_config c, int rows)
{
  p = prepared(c);
  set_off(&d, &c, 20.0);
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_reset(&p, &f.filter, sizeof f));
  (void)run(&p, &f, &d, rows);
  memcpy(&before, &f, sizeof f);
}

static void expect_same_statistics(const tse_filter_paper *was, const tse_filter_paper *is)
{
  TEST_ASSERT_EQUAL_MEMORY(&was->gamma, &is->gamma, sizeof is->gamma);
  TEST_ASSERT_EQUAL_MEMORY(&was->nu, &is->nu, sizeof is->nu);
  TEST_ASSERT_EQUAL_MEMORY(was->p.mu, is->p.mu, sizeof is->p.mu);
  TEST_ASSERT_EQUAL_MEMORY(was->p.lam, is->p.lam, sizeof is->p.lam);
  TEST_ASSERT_EQUAL_MEMORY(was->p.logw, is->p.logw, sizeof is->p.logw);
}

/* ----------------------------------------------------------------------------------- reproducibility */

static void test_asking_for_no_output_changes_nothing_in_the_filter(void)
{
  tse_output y;
  set_out(some_settings(50), 0);
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_reset(&p, &other.filter, sizeof other));
  for (int i = 0; i < 100; i++) {
    const tse_input u = next_row(&d);
    const tse_status status = tse_step(&p, &f.filter, &u, NULL);
    TEST_ASSERT_EQUAL_INT(tse_step(&p, &other.filter, &u, &y), status);
    TEST_ASSERT_EQUAL_INT(y.status, status);
  }
  TEST_ASSERT_EQUAL_MEMORY(&other, &f, sizeof f);
}

/* --------------------------------------------------------------------------------------- missing data */

static void lose(tse_input *u, int channel, int how)
{
  tse_real *const value[3] = { &u->accel_x, &u->accel_y, &u->yaw_rate };
  static const uint32_t bit[3] = { TSE_MISSING_accel_x, TSE_MISSING_accel_y, TSE_MISSING_yaw_rate };
  if (how == 0) u->missing |= bit[channel];
  else *value[channel] = real(how == 1 ? (double)NAN : how == 2 ? (double)INFINITY : how == 3 ? -50.1 : 1e30);
}

static void test_a_missing_channel_is_the_same_however_it_is_said_and_the_others_are_used(void)
{
  for (int channel = 0; channel < 3; channel++)
    for (int how = 0; how < 5; how++) {
      tse_output y;
      set_out(some_settings(64), 100);
      tse_input u = next_row(&d);
      lose(&u, channel, how);
      TEST_ASSERT_EQUAL_INT(TSE_W_MISSING_CHANNEL, tse_step(&p, &f.filter, &u, &y));
      for (int a = 0; a < 3; a++) { /* sd of the bias: falls if the sensor is used, else grows */
        const tse_real now = f.bias_var[a], was = before.bias_var[a];
        if (a != channel) TEST_ASSERT_TRUE(now < was);
        else TEST_ASSERT_TRUE(now > was);
      }
      TEST_ASSERT_TRUE(
          f.nu > before.nu); /* 100 rows are below the memory: nu still grows with every used row */
      TEST_ASSERT_TRUE(number(y.log_evidence) < 0.0 || number(y.log_evidence) > 0.0);
      if (how == 0) memcpy(&other, &f, sizeof f);
      TEST_ASSERT_EQUAL_MEMORY(&other, &f, sizeof f);
    }
}

static void test_a_row_without_measurements_predicts_only(void)
{
  tse_output y;
  set_out(some_settings(64), 100);
  for (int i = 0; i < 20; i++) {
    tse_input u = next_row(&d);
    u.missing = TSE_MISSING_accel_x | TSE_MISSING_accel_y | TSE_MISSING_yaw_rate;
    TEST_ASSERT_EQUAL_INT(TSE_W_PREDICTED, tse_step(&p, &f.filter, &u, &y));
    expect_same_statistics(&before, &f);
    expect_near(0.0, number(y.log_evidence), 0.0, "log evidence", i);
    for (int a = 0; a < 3; a++) TEST_ASSERT_EQUAL_INT(TSE_INPUT_INVALID, y.reason[a]);
  }
  for (int a = 0; a < 3; a++) {
    const double walked = number(before.bias_var[a]) + 20 * 0.01 * number(p.bias_walk[a]);
    expect_near(walked, number(f.bias_var[a]), BY_FORMAT(1e-14, 1e-6), "bias variance", a);
  }
  /* The car has moved on. The states follow the inputs, so the true values are met
   * without a single measurement. */
  expect_near(number(d.sim.x[0]), number(y.vel_x), 0.2, "vel_x", 0);
  expect_near(number(d.sim.x[1]), number(y.vel_y), 0.1, "vel_y", 0);
  expect_near(number(d.sim.x[2]), number(y.yaw_rate), 0.05, "yaw_rate", 0);
}

static void test_missing_inputs_hold_the_last_ones_then_freeze_then_restart(void)
{
  tse_config c = some_settings(64);
  c.max_gap = setting(0.1);
  tse_output y, frozen;
  memset(&frozen, 0, sizeof frozen);
  set_out(c, 150);
  for (int i = 0; i < 30; i++) {
    tse_input u = next_row(&d);
    if (i % 2) u.steer_angle = real((double)NAN);
    else u.missing = TSE_MISSING_wheel_speed_rear;
    TEST_ASSERT_EQUAL_INT(TSE_W_PREDICTED, tse_step(&p, &f.filter, &u, &y));
    expect_same_statistics(&before, &f);
    if (i == 15) frozen = y;
  }
  expect_near(number(frozen.vel_x), number(y.vel_x), 0.0, "vel_x does not move after max_gap", 0);
  expect_near(number(frozen.yaw_rate), number(y.yaw_rate), 0.0, "yaw_rate does not move after max_gap", 0);
  tse_input u = next_row(&d);
  const double wheels = 0.33 * 0.5 * (number(u.wheel_speed_front) + number(u.wheel_speed_rear));
  TEST_ASSERT_EQUAL_INT(TSE_W_GAP, tse_step(&p, &f.filter, &u, &y));
  expect_near(wheels, number(y.vel_x), 0.3, "vel_x starts again from the wheels", 0); /* sd 0.1, slip 0.5 % */
  u = next_row(&d);
  TEST_ASSERT_TRUE(tse_step(&p, &f.filter, &u, &y) < TSE_W_MISSING_CHANNEL);
}

static void test_a_gap_restarts_the_states_and_keeps_the_statistics(void)
{
  tse_output y;
  set_out(some_settings(64), 150);
  tse_input u = next_row(&d);
  u.dt = real(25.0), u.wheel_speed_front = u.wheel_speed_rear = real(10.0 / 0.33), u.yaw_rate = real(0.3);
  u.missing = TSE_MISSING_accel_x | TSE_MISSING_accel_y;
  memcpy(&other, &f, sizeof f);
  TEST_ASSERT_EQUAL_INT(TSE_W_GAP, tse_step(&p, &f.filter, &u, &y));
  expect_near(10.0, number(y.vel_x), 0.1, "vel_x", 0);
  expect_near(0.3, number(y.yaw_rate), 0.02, "yaw_rate", 0);
  TEST_ASSERT_TRUE(number(y.vel_x_sd) > 0.03);
  for (int a = 0; a < 3; a++) { /* only one row's learning */
    tse_output was;
    paper_estimate(&p, &before, &was);
    expect_near(number(was.stiffness[a]), number(y.stiffness[a]), 0.05, "stiffness", a);
  }
  tse_output next;
  tse_input usual = u;
  usual.dt = real(0.01);
  tse_step(&p, &f.filter, &usual, &next);
  for (int a = 0; a < 3; a++)
    TEST_ASSERT_TRUE(
        number(next.stiffness_sd[a]) < 1.1 * number(y.stiffness_sd[a])); /* no forgetting during the gap */
  /* Without any measurement, no bit of the statistics changes. */
  u.missing |= TSE_MISSING_yaw_rate;
  TEST_ASSERT_EQUAL_INT(TSE_W_GAP, tse_step(&p, &other.filter, &u, &y));
  expect_same_statistics(&before, &other);
  expect_near(10.0, number(y.vel_x), 0.1, "vel_x", 1);
}

/* ------------------------------------------------------------------------- standstill, reverse, slow */

static void test_standstill_and_reverse_hold_the_statistics_bit_for_bit(void)
{
  static const double speed[] = { 0.0, 1.9, -1.9, -0.2, -5.0, -20.0 };
  for (int k = 0; k < ROWS(speed); k++) {
    tse_output y;
    set_out(some_settings(64), 150);
    for (int i = 0; i < 200; i++) {
      tse_input u = still_row(0.01);
      u.wheel_speed_front = u.wheel_speed_rear = real(speed[k] / 0.33);
      u.steer_angle = real(0.1);
      TEST_ASSERT_EQUAL_INT(TSE_W_HELD, tse_step(&p, &f.filter, &u, &y));
      expect_same_statistics(&before, &f);
      for (int a = 0; a < 3; a++) TEST_ASSERT_EQUAL_INT(TSE_HELD, y.reason[a]);
      TEST_ASSERT_TRUE(outputs_are_finite(&y));
    }
    expect_near(speed[k], number(y.vel_x), 0.3 + 0.02 * fabs(speed[k]), "vel_x follows the wheels", k);
    TEST_ASSERT_TRUE(
        fabs(number(y.vel_y)) < 6.0 && fabs(number(y.yaw_rate)) < 2.0); /* a car: -20 m/s, 0.1 rad, 2 s */
  }
}

/* Wheels of one axle that turn backwards are enough, however fast the others turn. */
static void test_one_axle_in_reverse_holds_the_statistics(void)
{
  for (int rear = 0; rear < 2; rear++) {
    tse_output y;
    set_out(some_settings(64), 20);
    tse_input u = next_row(&d);
    *(rear ? &u.wheel_speed_rear : &u.wheel_speed_front) = real(-1.0 / 0.33);
    TEST_ASSERT_EQUAL_INT(TSE_W_HELD, tse_step(&p, &f.filter, &u, &y));
    expect_same_statistics(&before, &f);
    for (int a = 0; a < 3; a++) TEST_ASSERT_EQUAL_INT(TSE_HELD, y.reason[a]);
  }
}

/* Wheels that lock while the others turn: the car moves. */
static void test_one_axle_at_rest_is_no_standstill(void)
{
  for (int rear = 0; rear < 2; rear++) {
    tse_output y;
    set_out(some_settings(64), 20);
    tse_input u = next_row(&d);
    *(rear ? &u.wheel_speed_rear : &u.wheel_speed_front) = TSE_R(0);
    TEST_ASSERT_TRUE(tse_step(&p, &f.filter, &u, &y) < TSE_W_HELD);
    TEST_ASSERT_TRUE(f.nu > before.nu);
  }
}

static void test_a_missing_input_is_the_reason_even_at_standstill(void)
{
  tse_output y;
  set_out(some_settings(64), 20);
  tse_input u = still_row(0.01);
  u.missing = TSE_MISSING_steer_angle;
  TEST_ASSERT_EQUAL_INT(TSE_W_PREDICTED, tse_step(&p, &f.filter, &u, &y));
  for (int a = 0; a < 3; a++) TEST_ASSERT_EQUAL_INT(TSE_INPUT_INVALID, y.reason[a]);
}

/* Until a row has all inputs, its wheel speeds say nothing: the motion starts with the
 * first row that has them. */
static void test_the_motion_starts_with_the_first_row_that_has_all_inputs(void)
{
  tse_output y;
  tse_config c = some_settings(64);
  c.initial_vel_x_from_wheels = 1;
  p = prepared(c);
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_reset(&p, &f.filter, sizeof f));
  tse_input u = still_row(0);
  for (int i = 0; i < 5; i++) {
    u.missing = TSE_MISSING_steer_angle;
    u.wheel_speed_front = u.wheel_speed_rear = real(5.0 / 0.33);
    TEST_ASSERT_EQUAL_INT(TSE_W_PREDICTED, tse_step(&p, &f.filter, &u, &y));
    TEST_ASSERT_EQUAL_INT32(0, f.filter.started);
  }
  u.missing = 0;
  u.wheel_speed_front = u.wheel_speed_rear = real(20.0 / 0.33);
  TEST_ASSERT_TRUE(tse_step(&p, &f.filter, &u, &y) >= 0);
  TEST_ASSERT_EQUAL_INT32(1, f.filter.started);
  expect_near(20.0, number(y.vel_x), 0.2, "vel_x", 0); /* sd 0.1 */
}

static void test_large_steering_angles_hold_the_statistics(void)
{
  const tse_config c = some_settings(64);
  tse_output y;
  set_out(c, 150);
  for (int side = -1; side <= 1; side += 2) {
    tse_input u = next_row(&d);
    u.wheel_speed_front = u.wheel_speed_rear = real(5.0 / 0.33);
    u.steer_angle = real(side * (number(c.max_steer) + 1e-4));
    TEST_ASSERT_EQUAL_INT(TSE_W_HELD, tse_step(&p, &f.filter, &u, &y));
    expect_same_statistics(&before, &f);
    for (int a = 0; a < 3; a++) TEST_ASSERT_EQUAL_INT(TSE_HELD, y.reason[a]);
    memcpy(&f, &before, sizeof f);
    u.steer_angle = real(side * (number(c.max_steer) - 1e-4));
    TEST_ASSERT_TRUE(tse_step(&p, &f.filter, &u, &y) != TSE_W_HELD);
    memcpy(&f, &before, sizeof f);
  }
}

static void test_the_car_stands_still_when_its_wheels_do(void)
{
  p = prepared(some_settings(64));
  tse_output y;
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_reset(&p, &f.filter, sizeof f));
  for (int i = 0; i < 300; i++) {
    const tse_input u = still_row(0.0);
    TEST_ASSERT_TRUE(tse_step(&p, &f.filter, &u, &y) >= 0);
  }
  expect_near(0.0, number(y.vel_x), 1e-3, "vel_x", 0);
  expect_near(0.0, number(y.vel_y), 1e-3, "vel_y", 0);
  expect_near(0.0, number(y.yaw_rate), 1e-3, "yaw_rate", 0);
  expect_near(0.0, number(y.sideslip), 0.0, "sideslip", 0);
}

/* ------------------------------------------------------------------------------------ time steps */

static void test_forgetting_goes_by_time_not_by_rows(void)
{
  static const double dt[] = { 0.01, 0.02, 0.005, 0.05 };
  tse_config c = some_settings(20);
  c.forgetting_change = setting(1); /* else it depends on innovations: test_bias.c */
  set_out(c, 50);
  for (int k = 0; k < ROWS(dt); k++) {
    const double lambda = pow(number(c.forgetting), dt[k] / 0.01);
    const double nu = (number(f.nu) + 1.0) * lambda,
                 gamma = number(f.gamma) / (1.0 + number(f.gamma))
        / pow(number(p.forgetting_mean), dt[k] / 0.01);
    d.dt = dt[k];
    (void)run(&p, &f, &d, 1);
    expect_near(nu, number(f.nu), BY_FORMAT(1e-11, 1e-5) * nu, "nu", k);
    expect_near(gamma, number(f.gamma), BY_FORMAT(1e-11, 1e-5) * gamma, "gamma", k);
  }
}

/* Mean stiffness over the last part of a run that starts at 70 %. */
static void learn_from_seventy_percent(double dt, int32_t particles, double seconds, double mean[3])
{
  tse_config c = some_settings(particles);
  c.initial_cx_front = c.initial_cy_front = c.initial_cy_rear = setting(0.7);
  p = prepared(c);
  const int rows = (int)(seconds / dt), last = rows / 2;
  set_off(&d, &c, 20.0);
  d.dt = dt;
  memset(mean, 0, 3 * sizeof mean[0]);
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_reset(&p, &f.filter, sizeof f));
  for (int i = 0; i < rows; i++) {
    const tse_output y = run(&p, &f, &d, 1);
    if (i >= rows - last)
      for (int a = 0; a < 3; a++) mean[a] += number(y.stiffness[a]) / last;
  }
}

/* Limits for the mean over the last seconds of one run. The longitudinal stiffness is
 * observable only by changes of acceleration and takes tens of seconds. The lateral ones
 * settle within two. Three standard deviations between seeds. */
static void expect_stiffness(const double mean[3], double longitudinal, double lateral, const char *what)
{
  if (some_settings(16).integration == 0)
    longitudinal = lateral =
        0.12; /* as in the paper: bias of Euler's method with held inputs, for rows of 20 ms */
  for (int a = 0; a < 3; a++) expect_near(1.0, mean[a], a == 0 ? longitudinal : lateral, what, a);
}

static void test_stiffness_is_found_on_a_clean_drive(void)
{
  double mean[3];
  learn_from_seventy_percent(0.01, 300, 30.0, mean);
  expect_stiffness(mean, 0.06, 0.02, "stiffness");
}

/* Minutes there, since particles take ten times as long. scripts/dev/fixed.py runs them
 * on drives. */
#if !defined(TSE_REAL_FIXED)
static void test_stiffness_is_found_with_rows_twice_as_long_or_half_as_long(void)
{
  double mean[3];
  learn_from_seventy_percent(0.02, 300, 40.0, mean);
  expect_stiffness(mean, 0.1, 0.02, "stiffness at 20 ms");
  learn_from_seventy_percent(0.005, 300, 40.0, mean);
  expect_stiffness(mean, 0.12, 0.02, "stiffness at 5 ms");
}

static void test_a_long_run_with_quiet_and_lively_parts_stays_finite_and_near_the_truth(void)
{
  set_out(some_settings(100), 0);
  for (int i = 0; i < 24000; i++) { /* 4 minutes, every other one straight without torque */
    d.steer = d.torque = 0.0;
    if (i / 6000 % 2 == 0) { d.steer = 0.02, d.torque = 700.0; }
    const tse_output y = run(&p, &f, &d, 1);
    TEST_ASSERT_TRUE(outputs_are_finite(&y));
    for (int a = 0; a < 3; a++) {
      TEST_ASSERT_TRUE(number(y.stiffness[a]) > 0.5 && number(y.stiffness[a]) < 2.0);
      TEST_ASSERT_EQUAL_INT(y.reason[a] == TSE_VALID, y.spread_seen[a]);
      if (i == 5999) TEST_ASSERT_EQUAL_INT(1, y.spread_seen[a]); /* one minute of each */
    }
  }
}
#endif

static void test_another_road_is_found_within_seconds(void)
{
  const tse_config c = some_settings(300);
  p = prepared(c);
  double mean[3] = { 0 };
  set_off(&d, &c, 20.0);
  d.steer = 0.01, d.torque = 500.0;
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_reset(&p, &f.filter, sizeof f));
  (void)run(&p, &f, &d, 1500);
  d.road = 0.4;
  (void)run(&p, &f, &d, 1500);
  for (int i = 0; i < 500; i++) {
    const tse_output y = run(&p, &f, &d, 1);
    for (int a = 0; a < 3; a++) mean[a] += number(y.stiffness[a]) / 500.0;
  }
  for (int a = 0; a < 3; a++) expect_near(0.4, mean[a], 0.05, "stiffness on snow", a);
}

/* Rows with excess noise, then an accelerometer with an offset, then locked wheels. */
static tse_input troubled_row(int i, uint32_t *state)
{
  tse_input u = next_row(&d);
  if (i >= 900) u.accel_x = u.accel_x + real(1.5);
  u.accel_y = u.accel_y
      + real(0.15 * 10.0 * (next_uniform(state) + next_uniform(state) + next_uniform(state) - 1.5));
  if (i >= 1000) u.wheel_speed_front = u.wheel_speed_rear = TSE_R(0);
  return u;
}

static void test_a_copy_taken_in_the_midst_of_trouble_goes_on_bit_for_bit(void)
{
  for (int taken = 895; taken < 1100; taken += 15) {
    uint32_t state = 3;
    tse_output y, z;
    set_out(some_settings(50), 0);
    for (int i = 0; i < 1200; i++) {
      const tse_input u = troubled_row(i, &state);
      TEST_ASSERT_TRUE(tse_step(&p, &f.filter, &u, &y) >= 0);
      if (i > taken) {
        TEST_ASSERT_TRUE(tse_step(&p, &other.filter, &u, &z) >= 0);
        TEST_ASSERT_EQUAL_MEMORY(&f, &other, sizeof f);
        TEST_ASSERT_EQUAL_MEMORY(&y, &z, sizeof y);
      }
      if (i == taken) memcpy(&other, &f, sizeof f);
      TEST_ASSERT_TRUE(outputs_are_finite(&y));
    }
  }
}

/* ------------------------------------------------------------------------------ broken numbers, fuzz */

static double special(uint32_t *state)
{
  static const double values[] = { 0.0, -0.0, NAN, INFINITY, -INFINITY, 1e300, -1e300, 1e-300, -1e-300, 1e-30,
    3.4e38, 50.0, -50.0, 1.2, -1.2, 400.0, -400.0, 6.0, -6.0, 1e-3 };
  return values[next_word(state) % (uint32_t)ROWS(values)];
}

static double fuzzed(uint32_t *state, double plausible, double most, int wildness)
{
  const uint32_t dice = next_word(state) >> 8;
  if (wildness == 0 || dice % 16u > (uint32_t)wildness) return plausible;
  if (dice % 3u == 0) return special(state);
  return next_between(state, -most, most);
}

/* States of every particle, and so the estimates, are those of a car. */
static void expect_bounded(const tse_output *y, int row)
{
  for (int32_t i = 0; i < pad_count(p.particles); i++)
    if (!(fabs(number(f.p.x[0][i])) <= 200.0 && fabs(number(f.p.x[1][i])) <= 200.0
            && fabs(number(f.p.x[2][i])) <= 20.0))
      expect_near(0.0, number(f.p.x[2][i]), 20.0, "a state beyond any car", row);
  TEST_ASSERT_TRUE(fabs(number(y->yaw_rate)) < 20.001 && fabs(number(y->vel_x)) < 200.01
      && fabs(number(y->vel_y)) < 200.01);
}

/* Returned: 1; 0 if the number format of the build refuses these settings. */
static int fuzz(const tse_config *c, int rows, uint32_t seed)
{
  if (!prepared_if_held(c, &p)) return 0;
  uint32_t state = seed;
  double v = 10.0, steer = 0.0;
  int accepted = 0, wildness = 0;
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_reset(&p, &f.filter, sizeof f));
  for (int i = 0; i < rows; i++) {
    if (i % 64 == 0) wildness = (int)(next_word(&state) >> 8) % 5 * 3; /* 0 never .. 12 almost always */
    v = fmin(fmax(v + next_between(&state, -0.3, 0.3), -3.0), 45.0);
    steer = 0.9 * steer + next_between(&state, -0.01, 0.01);
    tse_input u = blank_row();
    u.dt = real(fuzzed(&state, 0.01, 0.2, wildness / 4));
    u.steer_angle = real(fuzzed(&state, steer, 1.3, wildness));
    u.wheel_speed_front = real(fuzzed(&state, v / 0.33, 420.0, wildness));
    u.wheel_speed_rear = real(fuzzed(&state, v / 0.33, 420.0, wildness));
    u.accel_x = real(fuzzed(&state, next_between(&state, -1.0, 1.0), 60.0, wildness));
    u.accel_y = real(fuzzed(&state, 2.0 * v * steer, 60.0, wildness));
    u.yaw_rate = real(fuzzed(&state, 0.3 * v * steer, 7.0, wildness));
    u.missing = wildness && next_word(&state) % 8u == 0 ? next_word(&state) >> 24 : 0u;
    tse_output y;
    memset(&y, 0x55, sizeof y);
    const tse_status status = tse_step(&p, &f.filter, &u, &y);
    if (status < 0) continue;
    accepted++;
    if (!outputs_are_finite(&y)) {
      char text[120];
      (void)snprintf(text, sizeof text, "row %d of seed %u: an output is not finite", i, (unsigned)seed);
      TEST_FAIL_MESSAGE(text);
    }
    for (int a = 0; a < 3; a++) {
      TEST_ASSERT_TRUE(
          number(y.stiffness[a]) > (c->reflect_draws ? 0.0 : -20.0) && number(y.stiffness[a]) < 21.0);
      /* in fixed point a variance below the resolution is 0 */
      TEST_ASSERT_TRUE(number(y.stiffness_sd[a]) >= 0.0 && number(y.stiffness_spread[a]) >= 0.0
          && number(y.bias_sd[a]) >= 0.0);
      TEST_ASSERT_TRUE(y.reason[a] >= TSE_VALID && y.reason[a] < TSE_REASON_END_);
    }
    TEST_ASSERT_TRUE(number(y.n_eff) > 0.999 && number(y.n_eff) < 1.001 * c->particles);
    TEST_ASSERT_EQUAL_INT(status, y.status);
    expect_bounded(&y, i);
  }
  TEST_ASSERT_TRUE(accepted > rows / 4);
  return 1;
}

static void test_no_row_of_numbers_whatever_makes_an_output_that_is_none(void)
{
  tse_config c = some_settings(20); /* 20: includes padding, which must not break either */
  for (uint32_t seed = 1; seed <= 4; seed++) {
    c.resampling = (int32_t)(seed - 1u);
    TEST_ASSERT_TRUE(fuzz(&c, 25000, seed));
  }
}

static void test_no_row_breaks_a_filter_whose_settings_are_extreme(void)
{
  tse_config c = some_settings(17);
  c.mass = setting(50), c.yaw_inertia = setting(10);
  c.longitudinal_stiffness_front = c.longitudinal_stiffness_rear = setting(1e7);
  c.cornering_stiffness_front = c.cornering_stiffness_rear = setting(1e7);
  c.accel_x_sd = c.accel_y_sd = setting(0.001), c.yaw_rate_sd = setting(1e-5),
  c.stiffness_min = setting(0.02);
  c.stiffness_max = setting(20);
  fuzz(&c, 4000, 77);
  c = some_settings(16);
  c.mass = setting(50000), c.forgetting = setting(0.9), c.initial_dof = setting(6);
  c.initial_mean_sd = c.initial_spread = setting(2), c.max_gap = setting(1), c.sample_time = setting(0.1);
  c.resample_threshold = setting(0);
  fuzz(&c, 4000, 78);
  c = some_settings(18);
  c.wheel_noise_sd = setting(5), c.stiffness_max = setting(20), c.initial_spread = setting(2);
  fuzz(&c, 4000, 79);
}

/* Any of the settings at either limit, with the others unchanged: 0.1 s to a minute. The
 * outputs are finite, in float, too. */
static void test_no_mixture_of_extreme_settings_makes_an_output_that_is_no_number(void)
{
  uint32_t state = 17;
  int held = 0;
  for (int k = 0; k < 400; k++) {
    tse_config c = some_settings(16);
    const int32_t kept = c.form;
    EACH_SETTING(row)
    {
      const uint32_t dice = next_word(&state) >> 9;
      if (dice % 5u < 2u) put_field(&c, row, dice % 5u ? row->lo : row->hi);
    }
    EACH_PARAMETER(e)
    put_parameter(&c, e, e->def);
    fit_together(&c);
    c.form = kept, c.particles = 16;
    held += fuzz(&c, 60, 1000u + (uint32_t)k);
  }
  TEST_ASSERT_TRUE(held >= BY_NUMBER(400, 400, 100)); /* fixed point refuses the others by name */
}

/* One row after a pause of any length: forgetting is limited, and the drive continues. */
static void test_after_a_pause_of_any_length_the_drive_goes_on(void)
{
  static const double pause[] = { 0.001, 0.5, 6.0, 60.0, 600.0, 3600.0 };
  for (int k = 0; k < ROWS(pause); k++) {
    tse_output y;
    set_out(some_settings(100), 800);
    tse_input u = next_row(&d);
    u.dt = real(pause[k]);
    TEST_ASSERT_TRUE(tse_step(&p, &f.filter, &u, &y) >= 0);
    TEST_ASSERT_TRUE(number(f.gamma) <= fmax(1.0, number(p.gamma0)) && number(f.nu) >= 6.0);
    for (int i = 0; i < 1000; i++) {
      y = run(&p, &f, &d, 1);
      TEST_ASSERT_TRUE(outputs_are_finite(&y) && y.status < TSE_W_HELD);
    }
    for (int a = 1; a < 3; a++) expect_near(1.0, number(y.stiffness[a]), 0.15, "stiffness", 10 * k + a);
  }
}

static void test_a_filter_whose_particles_were_broken_gives_finite_outputs(void)
{
  for (int share = 1; share <= 16; share *= 4) { /* all particles, a quarter, a sixteenth */
    const tse_config c = some_settings(64);
    set_out(c, 100);
    for (int32_t i = 0; i < 64; i += share) f.p.x[1][i] = real((double)NAN);
    for (int i = 0; i < 1000; i++) {
      const tse_output y = run(&p, &f, &d, 1);
      TEST_ASSERT_TRUE(outputs_are_finite(&y));
      if (i == 999 && c.reflect_draws) expect_near(number(d.sim.x[0]), number(y.vel_x), 0.5, "vel_x", share);
    }
  }
}

/* ------------------------------------------------------------------------------------------ excitation */

/* noise <= limit^2 memory var(phi), where noise is one sigma and that of the spread. */
static void test_excitation_is_the_variance_of_the_regressor_over_noise_and_spread(void)
{
  for (int a = 0; a < 3; a++)
    for (int k = 0; k < 2; k++) {
      tse_config c = config_by(tse_config_robust);
      c.forgetting = setting(0.99);
      tse_params own = prepared(c);
      tse_output est = blank_output();
      sample y = { 0 };
      int32_t excited[3];
      memset(&f, 0, sizeof f);
      y.dt = own.sample_time;
      y.u.v_front = y.u.v_rear = est.vel_x = TSE_R(20); /* no slip now: the past decays */
      f.filter.seen = TSE_R(500);
      for (int b = 0; b < 3; b++) {
        f.excite_mean[b] = TSE_R(0.25), f.excite_sq[b] = TSE_R(4);
        est.stiffness[b] = TSE_R(0.4), est.stiffness_spread[b] = TSE_R(0.1);
      }
      const double left = 1.0 - 1.0 / 200.0, sq = 4.0 * left,
                   var = sq - pow(0.25 * left, 2.0); /* over two memories */
      const double noise = 1.0 + sq * 0.01, signal = number(own.memory) * var;
      own.valid_var = real(noise / signal * (k ? 1.001 : 0.999));
      paper_excitation(&own, &f, &y, &est, excited);
      TEST_ASSERT_EQUAL_INT(k, excited[a]);
    }
}
