/* tests/unit/host/test_replay_log.c <-> src/host/replay.c, src/model/integrator.c: calls,
 * the model without effects, order of the integration, profiles and disturbances.
 * (test_replay.c replays the golden drive of the estimator.) */
#include "paper/particle.h"
#include "unit_support.h"
#include "effect_support.h"

/* Rows of a lively drive: steering, wheels and time steps of several lengths, down to
 * walking pace. */
static void lively(const tse_config *c, int rows)
{
  straight(c, 20, 0.01, rows);
  for (int i = 0; i < rows; i++) {
    const double v = 12 + 10 * sin(0.004 * i);
    log_dt[i] = real(i % 50 == 49 ? 0.034 : 0.01);
    log_steer[i] = real(0.04 * sin(0.05 * i));
    log_front[i] = real(v / 0.33 * (1 + 0.01 * sin(0.02 * i)));
    log_rear[i] = real(v / 0.33);
  }
}

static tse_config all_effects(void)
{
  tse_config c = default_car();
  EACH_PARAMETER(e)
  if (e->strength == 1) put_parameter(&c, e, e->typical_hi);
  return c;
}

/* ------------------------------------------------------------------------------------- nothing on */

/* Replay equals the estimator's vehicle, row by row, bit for bit, with any shapes of
 * effects that are off. */
static void test_without_effects_a_replay_is_the_plain_vehicle_bit_for_bit(void)
{
  const tse_config plain = default_car();
  tse_config c = plain;
  EACH_PARAMETER(e)
  if (e->strength != 1) put_parameter(&c, e, 0.5 * e->def + 0.5 * e->hi);
  const tse_params p = prepared(plain);
  const int rows = 2000;
  tse_replay_start s = the_start();
  const tse_replay_log log = the_log();
  s.cx_front = real(1.2), s.cy_front = real(0.9), s.cy_rear = real(1.1), s.vel_y = real(0.2);
  s.yaw_rate = real(-0.1);
  lively(&c, rows);
  replay_with(&c, &log, rows, &s);
  const stiffness k = vehicle_stiffness(
      &p, s.cx_front - TSE_R(1), s.cy_front - TSE_R(1), s.cy_rear - TSE_R(1));
  inputs from = { TSE_R(0), TSE_R(0), TSE_R(0) }, to;
  tse_real x[3] = { TSE_R(0), TSE_R(0), TSE_R(0) };
  for (int i = 0; i < rows; i++) {
    to.steer = log_steer[i];
    to.v_front = r_mul(p.radius_front, log_front[i]);
    to.v_rear = r_mul(p.radius_rear, log_rear[i]);
    if (i == 0) {
      x[0] = r_mul(TSE_R(0.5), to.v_front + to.v_rear);
      x[1] = s.vel_y;
      x[2] = s.yaw_rate;
    } else {
      const int32_t steps = vehicle_steps(&p, log_dt[i], from, to);
      const tse_real h = steps > 1 ? r_div(log_dt[i], r_from_int(steps)) : log_dt[i];
      for (int32_t n = 0; n < steps; n++)
        particle_step(&p, &x[0], &x[1], &x[2], k, vehicle_between(from, to, n, steps),
            vehicle_between(from, to, n + 1, steps), h);
    }
    from = to;
    const accels a = vehicle_accels(&p, k, vehicle_slips(&p, x[0], x[1], x[2], to), to.steer);
    TEST_ASSERT_TRUE(!(x[0] != got_vx[i]) && !(x[1] != got_vy[i]) && !(x[2] != got_yaw[i]));
    TEST_ASSERT_TRUE(!(a.x != got_x[i]) && !(a.y != got_y[i]) && !(x[2] != got_r[i]));
  }
}

/* Rear wheels of twice the radius that turn half as fast: the same car, bit for bit. The
 * torque of their slip has twice the arm. */
static void test_each_axle_has_the_speed_of_its_own_wheels(void)
{
  enum { COUNTED = 300 };
  static tse_real x[3][COUNTED], torque[2][COUNTED];
  tse_config c = default_car();
  tse_replay_start s = the_start();
  const tse_replay_log log = the_log();
  s.wheel_inertia_front = s.wheel_inertia_rear = TSE_R(0);
  lively(&c, COUNTED);
  replay_with(&c, &log, COUNTED, &s);
  memcpy(x[0], got_vx, sizeof x[0]);
  memcpy(x[1], got_vy, sizeof x[1]);
  memcpy(x[2], got_yaw, sizeof x[2]);
  memcpy(torque[0], got_tf, sizeof torque[0]);
  memcpy(torque[1], got_tr, sizeof torque[1]);
  c.wheel_radius_rear = 2 * c.wheel_radius_rear;
  for (int i = 0; i < COUNTED; i++) log_rear[i] = r_mul(TSE_R(0.5), log_rear[i]);
  replay_with(&c, &log, COUNTED, &s);
  for (int i = 0; i < COUNTED; i++) {
    const double near = BY_NUMBER(0, 0, 1e-4);
    expect_near(number(x[0][i]), number(got_vx[i]), near, "vel_x", i);
    expect_near(number(x[1][i]), number(got_vy[i]), near, "vel_y", i);
    expect_near(number(x[2][i]), number(got_yaw[i]), near, "yaw rate", i);
    expect_near(number(torque[0][i]), number(got_tf[i]), BY_NUMBER(1e-9, 1e-3, 1), "front", i);
    expect_near(2 * number(torque[1][i]), number(got_tr[i]), BY_NUMBER(1e-9, 1e-3, 1), "rear", i);
  }
}

/* test_simulate.c compares the simulator without effects with scipy. Here: effects that
 * are off have no influence. */
static void test_shapes_of_effects_that_are_off_change_no_bit_of_the_simulator(void)
{
  static tse_sim a, b;
  tse_config plain = default_car(), shaped = plain;
  tse_sim_config s;
  tse_sim_input u = blank_sim_input();
  tse_sim_output y, z;
  EACH_PARAMETER(e)
  if (e->strength != 1) put_parameter(&shaped, e, 0.5 * e->def + 0.5 * e->hi);
  tse_sim_config_default(&s);
  s.friction = setting(1);
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_sim_reset(&a, &plain, &s, NULL));
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_sim_reset(&b, &shaped, &s, NULL));
  u.road_level = real(1), u.dt = real(0.01);
  for (int i = 0; i < 500; i++) {
    u.steer_angle = real(0.05 * sin(0.1 * i)), u.wheel_torque_front = real(800 * sin(0.03 * i));
    TEST_ASSERT_EQUAL_INT(TSE_OK, tse_sim_step(&a, &u, &y));
    TEST_ASSERT_EQUAL_INT(TSE_OK, tse_sim_step(&b, &u, &z));
    TEST_ASSERT_EQUAL_MEMORY(&y, &z, sizeof y);
  }
}

/* If the driver's last angle is changed between two rows (an FMU with held inputs), the
 * wheels jump there. */
static void test_an_angle_set_between_rows_is_a_jump_also_with_effects(void)
{
  static tse_sim sim[2];
  const tse_sim_config s = still_sim(20);
  tse_sim_output y[2];
  for (int k = 0; k < 2; k++) {
    tse_config c = default_car();
    tse_sim_input u = blank_sim_input();
    c.steering_ratio_change = setting(k ? 0.25 : 0);
    TEST_ASSERT_EQUAL_INT(TSE_OK, tse_sim_reset(&sim[k], &c, &s, NULL));
    u.dt = real(0.01), u.road_level = real(1);
    TEST_ASSERT_EQUAL_INT(TSE_OK, tse_sim_step(&sim[k], &u, &y[k]));
    u.steer_angle = real(k ? 0.008 : 0.01);
    sim[k].last.steer_angle = u.steer_angle;
    TEST_ASSERT_EQUAL_INT(TSE_OK, tse_sim_step(&sim[k], &u, &y[k]));
  }
  TEST_ASSERT_TRUE(number(y[0].yaw_rate) > 1e-3);
  expect_near(number(y[0].yaw_rate), number(y[1].yaw_rate), BY_FORMAT(1e-12, 1e-7), "yaw_rate", 0);
}

/* Difference of a row to the results kept. */
static double off_kept(int i)
{
  return fabs(number(got_x[i]) - number(kept_x[i])) + fabs(number(got_y[i]) - number(kept_y[i]))
      + fabs(number(got_r[i]) - number(kept_r[i]));
}

/* A strength near zero gives nearly the model without the effect: no effect starts with a
 * step. */
static void test_every_effect_is_continuous_at_zero(void)
{
#define BIT(id) | (uint64_t)1 << TSE_EFFECT_##id
  const uint64_t lags = 0 EFFECTS_LAG(
      BIT); /* shorter than a step: another discretisation of the same motion */
  char said[120];
  const int rows = 600;
  tse_config c = default_car();
  lively(&c, rows);
  replay(&c, rows);
  keep_readings();
  EACH_PARAMETER(e)
  {
    if (e->strength != 1) continue;
    double small = 0, large = 0;
    uint64_t lag = 0;
    c = default_car();
    c.stiffness_drift_time = setting(5);
    put_parameter(&c, e, 1e-4 * e->typical_hi);
    lag = prepared(c).effects.mask & lags;
    replay(&c, rows);
    for (int i = 0; i < rows; i++) small = fmax(small, off_kept(i));
    put_parameter(&c, e, e->typical_hi);
    replay(&c, rows);
    for (int i = 0; i < rows; i++) large = fmax(large, off_kept(i));
    TEST_ASSERT_TRUE_MESSAGE(large > BY_FORMAT(1e-4, 1e-3), e->setting);
    (void)snprintf(said, sizeof said, "%s: %.3g of %.3g", e->setting, small, large);
    TEST_ASSERT_TRUE_MESSAGE(small < 2e-3 * large + (lag ? 2e-2 : BY_FORMAT(1e-9, 2e-3)), said);
  }
}

/* ---------------------------------------------------------------------------------------- integration */

/* Half the step gives a quarter of the error, with all effects that have memory.
 * Reference: a sixteenth of the step. */
static void test_integration_is_of_second_order_with_all_effects(void)
{
  tse_config c = all_effects();
  static double end[4][3];
  const int steps[4] = { 100, 200, 400, 3200 };
  c.steering_delay_time = c.imu_delay_time = setting(
      0); /* linear between rows: of second order only on average */
  c.sample_time = setting(0.05);
  for (int k = 0; k < 4; k++) {
    const double dt = 2.0 / steps[k];
    straight(&c, 20, dt, steps[k] + 1);
    for (int i = 0; i <= steps[k]; i++) {
      log_steer[i] = real(0.03 * sin(4 * i * dt));
      log_front[i] = log_rear[i] = real((20 + sin(3 * i * dt)) / 0.33);
    }
    replay(&c, steps[k] + 1);
    end[k][0] = number(got_vx[steps[k]]);
    end[k][1] = number(got_vy[steps[k]]);
    end[k][2] = number(got_yaw[steps[k]]);
  }
  for (int a = 0; a < 3 && sizeof(tse_real) == 8; a++) { /* rounding in float is as large */
    const double e0 = fabs(end[0][a] - end[3][a]), e1 = fabs(end[1][a] - end[3][a]),
                 e2 = fabs(end[2][a] - end[3][a]);
    TEST_ASSERT_TRUE(e0 < 5e-3 && e0 > 1e-7);
    TEST_ASSERT_TRUE(e1 < e0 / 2.5 && e2 < e1 / 2.5);
  }
}

/* A relaxation length of micrometres has no effect: stiff states do not affect
 * stability. */
static void test_the_shortest_lags_change_nothing_and_stay_stable(void)
{
  const int rows = 2000;
  tse_config c = default_car();
  lively(&c, rows);
  replay(&c, rows);
  keep_readings();
  c.relaxation_length = c.longitudinal_relaxation_length = setting(1e-5);
  replay(&c, rows);
  for (int i = 0; i < rows; i++)
    expect_near(number(kept_y[i]), number(got_y[i]), 2e-2, "accel_y",
        i); /* the same motion in another discretisation: 0.5 % */
}

/* Standstill and rolling backwards with a lag: the tyre is a spring there, and the car
 * comes to rest. */
static void test_with_lags_the_car_settles_at_walking_pace(void)
{
  tse_config c = default_car();
  const int rows = 3000;
  c.relaxation_length = setting(0.5), c.longitudinal_relaxation_length = setting(0.3);
  straight(&c, 0, 0.01, rows);
  for (int i = 0; i < rows; i++) {
    log_front[i] = log_rear[i] = real(fmax(5 - 0.01 * i, -1) / 0.33);
    log_steer[i] = real(0.1);
  }
  replay(&c, rows);
  for (int i = 0; i < rows; i++)
    TEST_ASSERT_TRUE(fabs(number(got_vy[i])) < 0.5 && fabs(number(got_vx[i])) < 5.1);
  expect_near(-1, number(got_vx[rows - 1]), 0.02, "vel_x", 0);
  expect_near(-1 * 0.1 / 2.75, number(got_yaw[rows - 1]), 2e-3, "yaw rate: v delta/L", 0);
}

/* --------------------------------------------------------------------- start, biases, what is given */

static void test_biases_are_added_to_what_is_read(void)
{
  const tse_config c = default_car();
  const tse_replay_log log = the_log();
  tse_replay_start s = the_start();
  lively(&c, 200);
  replay_with(&c, &log, 200, &s);
  keep_readings();
  s.bias_accel_x = real(0.25), s.bias_accel_y = real(-0.5), s.bias_yaw_rate = real(0.0625);
  replay_with(&c, &log, 200, &s);
  for (int i = 0; i < 200; i++) {
    expect_near(number(kept_x[i]) + 0.25, number(got_x[i]), BY_FORMAT(1e-14, 1e-6), "accel_x", i);
    expect_near(number(kept_y[i]) - 0.5, number(got_y[i]), BY_FORMAT(1e-14, 1e-6), "accel_y", i);
    expect_near(number(kept_r[i]) + 0.0625, number(got_r[i]), BY_FORMAT(1e-14, 1e-7), "yaw_rate", i);
    expect_near(number(kept_r[i]), number(got_yaw[i]), 0, "the car's", i);
  }
}

static void test_the_start_is_where_it_is_told(void)
{
  const tse_config c = default_car();
  const tse_replay_log log = the_log();
  tse_replay_start s = the_start();
  straight(&c, 20, 0.01, 3);
  log_front[0] = real(22 / 0.33);
  replay_with(&c, &log, 3, &s);
  expect_near(21, number(got_vx[0]), BY_FORMAT(1e-12, 1e-5), "mean of the wheels", 0);
  s.vel_x_from_wheels = real(0), s.vel_x = real(19), s.vel_y = real(0.5), s.yaw_rate = real(0.25);
  replay_with(&c, &log, 3, &s);
  expect_near(19, number(got_vx[0]), 0, "vel_x", 0);
  expect_near(0.5, number(got_vy[0]), 0, "vel_y", 0);
  expect_near(0.25, number(got_yaw[0]), 0, "yaw_rate", 0);
  s.vel_x_from_wheels = real(-1); /* any number except zero */
  replay_with(&c, &log, 3, &s);
  expect_near(21, number(got_vx[0]), BY_FORMAT(1e-12, 1e-5), "mean of the wheels", 1);
}

/* accel_x = v' + g sin(grade) and accel_y = v r' + g sin(bank), once the car follows. A
 * profile adds to the setting. */
static void test_profiles_of_the_road_act_as_slopes_do(void)
{
  static tse_real grade[2000], bank[2000];
  tse_config c = default_car();
  tse_replay_log log = the_log();
  const tse_replay_start s = the_start();
  straight(&c, 20, 0.01, 2000);
  for (int i = 0; i < 2000; i++) {
    grade[i] = real(0.04 * sin(0.002 * i));
    bank[i] = real(0.02 * sin(0.0015 * i));
  }
  log.grade = grade, log.bank = bank;
  replay_with(&c, &log, 2000, &s);
  for (int i = 700; i < 1999;
      i++) { /* vel_x follows the wheels within a tenth of a second: 0.2 rad/s of it */
    const double vx = (number(got_vx[i + 1]) - number(got_vx[i - 1])) / 0.02,
                 vy = (number(got_vy[i + 1]) - number(got_vy[i - 1])) / 0.02;
    expect_near(vx - number(got_vy[i]) * number(got_yaw[i]) + 9.81 * sin(number(grade[i])), number(got_x[i]),
        BY_FORMAT(1e-4, 5e-3), "accel_x", i);
    expect_near(vy + number(got_vx[i]) * number(got_yaw[i]) + 9.81 * sin(number(bank[i])), number(got_y[i]),
        BY_FORMAT(1e-4, 5e-3), "accel_y", i);
    expect_near(9.81 * sin(number(grade[i])), number(got_x[i]), 0.01, "accel_x shows the grade", i);
  }
  const double seen = number(got_x[1500]);
  c.grade_angle = setting(0.01);
  replay_with(&c, &log, 2000, &s);
  expect_near(9.81 * (sin(0.01 + number(grade[1500])) - sin(number(grade[1500]))), number(got_x[1500]) - seen,
      BY_FORMAT(1e-5, 1e-4), "both", 0);
}

/* A disturbance of the front slip angle acts like a steering angle; of both slip angles,
 * like a lateral motion of the ground. A force shows in the accelerometer. */
static void test_disturbances_enter_where_they_say(void)
{
  static tse_real front[1000], rear[1000], force[1000], push[1000], yaw[1000];
  static double steered[1000];
  const tse_config c = default_car();
  tse_replay_log log = the_log();
  const tse_replay_start s = the_start();
  straight(&c, 20, 0.01, 1000);
  for (int i = 0; i < 1000; i++) {
    front[i] = rear[i] = real(0.002 * sin(0.02 * i));
    force[i] = real(0.25);
    push[i] = real(0.125);
    yaw[i] = real(0.5);
    log_steer[i] = front[i];
  }
  replay_with(&c, &log, 1000, &s);
  for (int i = 0; i < 1000; i++) {
    steered[i] = number(got_r[i]);
    log_steer[i] = real(0);
  }
  log.slip_front = front;
  replay_with(&c, &log, 1000, &s);
  for (int i = 0; i < 1000; i++)
    expect_near(steered[i], number(got_r[i]), 1e-5, "slip_front", i); /* except for Fy sin d */
  log.slip_front = NULL, log.slip_rear = rear;
  for (int i = 0; i < 1000; i++) rear[i] = real(0.002);
  replay_with(&c, &log, 1000, &s);
  const double v = 20, k = 1900 / 2.75 * (1.5 / 1.2e5 - 1.25 / 1.4e5); /* steered in the other direction */
  expect_near(-v * 0.002 / (2.75 + k * v * v), number(got_r[999]), 1e-4, "slip_rear", 0);
  log.slip_rear = NULL, log.force_x = push;
  replay_with(&c, &log, 1000, &s);
  expect_near(0, number(got_x[999]), BY_FORMAT(1e-6, 1e-3), "force_x, carried by the tyres", 0);
  expect_near(20 + 20 * 1900 * 0.125 / 3.2e5, number(got_vx[999]), BY_FORMAT(1e-3, 2e-3), "force_x, slip", 0);
  log.force_x = NULL, log.force_y = force;
  replay_with(&c, &log, 1000, &s);
  const double length = 2.75, side = 1900 * 0.25,
               r = v * (1.5 * side / (length * 1.2e5) - 1.25 * side / (length * 1.4e5))
      / (length + k * v * v);
  expect_near(r, number(got_r[999]), 2e-3 * fabs(r) + 1e-5, "force_y", 0);
  expect_near(v * r, number(got_y[999]), 2e-3 * fabs(v * r) + 2e-4, "force_y is seen", 0);
  log.force_y = NULL, log.yaw_accel = yaw;
  replay_with(&c, &log, 1000, &s);
  const double moment = 3000 * 0.5,
               turned = v * (moment / (length * 1.2e5) + moment / (length * 1.4e5)) / (length + k * v * v);
  expect_near(turned, number(got_r[999]), 5e-3 * turned, "yaw_accel", 0);
}

/* Rows of 50 ms are integrated in four steps, with linear inputs: the same as rows of
 * 12.5 ms with these inputs. */
static void test_what_is_given_is_linear_within_a_row(void)
{
  static tse_real given_at[7][401];
  static double fine[3][401];
  const tse_config c = default_car();
  tse_replay_log log = the_log();
  const tse_replay_start s = the_start();
  static const double size[7] = { 0.04, 0.03, 0.002, -0.003, 0.3, 0.2, 0.1 };
  for (int coarse = 0; coarse <= 1; coarse++) {
    const int rows = coarse ? 101 : 401, every = coarse ? 4 : 1;
    straight(&c, 20, coarse ? 0.05 : 0.0125, rows);
    for (int i = 0; i < rows; i++)
      for (int k = 0; k < 7; k++) { /* a polygon with a corner every 50 ms */
        const int at = i * every, corner = at / 4;
        const double a = sin(0.7 * corner + k), b = sin(0.7 * (corner + 1) + k);
        given_at[k][i] = real(size[k] * (a + (b - a) * (at % 4) / 4));
      }
    log.grade = given_at[0], log.bank = given_at[1], log.slip_front = given_at[2],
    log.slip_rear = given_at[3];
    log.force_x = given_at[4], log.force_y = given_at[5], log.yaw_accel = given_at[6];
    replay_with(&c, &log, rows, &s);
    for (int i = 0; i < rows; i++) {
      if (!coarse) {
        fine[0][i] = number(got_vx[i]);
        fine[1][i] = number(got_vy[i]);
        fine[2][i] = number(got_yaw[i]);
        continue;
      }
      expect_near(fine[0][4 * i], number(got_vx[i]), BY_FORMAT(1e-12, 1e-4), "vel_x", i);
      expect_near(fine[1][4 * i], number(got_vy[i]), BY_FORMAT(1e-12, 1e-4), "vel_y", i);
      expect_near(fine[2][4 * i], number(got_yaw[i]), BY_FORMAT(1e-12, 1e-5), "yaw_rate", i);
    }
  }
}

static void test_wheel_torque_of_a_braked_axle_is_negative(void)
{
  const tse_config c = default_car();
  straight(&c, 20, 0.01, 300);
  for (int i = 0; i < 300; i++) log_front[i] = real(19.8 / 0.33);
  replay(&c, 300);
  TEST_ASSERT_TRUE(number(got_tf[299]) < -200 && number(got_tr[299]) > 200);
  expect_near(0, number(got_tf[299]) + number(got_tr[299]), BY_FORMAT(1, 3), "they balance", 0);
}

/* ------------------------------------------------------------------------------------------------ calls */

static void test_odd_calls_are_refused_and_the_row_is_named(void)
{
  const tse_config c = default_car();
  const tse_params p = prepared(c);
  tse_params unprepared = p;
  const tse_replay_log log = the_log();
  tse_replay_log lacking;
  const tse_replay_start s = the_start();
  const tse_replay_out out = the_out(), none = { 0 };
  int32_t wrong = -1;
  tse_replay_start_default(NULL);
  straight(&c, 20, 0.01, 20);
  TEST_ASSERT_EQUAL_INT(TSE_E_NULL, tse_replay(NULL, &log, 20, &s, &out, &wrong));
  TEST_ASSERT_EQUAL_INT(TSE_E_NULL, tse_replay(&p, NULL, 20, &s, &out, &wrong));
  TEST_ASSERT_EQUAL_INT(TSE_E_NULL, tse_replay(&p, &log, 20, NULL, &out, &wrong));
  TEST_ASSERT_EQUAL_INT(TSE_E_NULL, tse_replay(&p, &log, 20, &s, NULL, &wrong));
  EACH_FIELD(column, TSE_STRUCT_REPLAY_LOG)
  {
    lacking = log;
    memset((char *)&lacking + column->offset, 0, sizeof(tse_real *));
    TEST_ASSERT_EQUAL_INT_MESSAGE(column->kind == 'p' ? TSE_E_NULL : TSE_OK,
        tse_replay(&p, &lacking, 20, &s, &out, NULL), column->name);
  }
  unprepared.magic = 0;
  TEST_ASSERT_EQUAL_INT(TSE_E_STATE, tse_replay(&unprepared, &log, 20, &s, &out, &wrong));
  TEST_ASSERT_EQUAL_INT32(-1, wrong);
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_replay(&p, &log, 0, &s, &out, &wrong));
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_replay(&p, &log, 20, &s, &none, NULL)); /* no output is requested */
  log_dt[0] = real(0);
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_replay(&p, &log, 20, &s, &out, &wrong)); /* of the first row not used */
  static const double bad_dt[4] = { 0, -0.01, 1.5, NAN };
  for (int k = 0; k < 4; k++) {
    log_dt[7] = real(bad_dt[k]);
    TEST_ASSERT_EQUAL_INT(TSE_E_TIME, tse_replay(&p, &log, 20, &s, &out, &wrong));
    TEST_ASSERT_EQUAL_INT32(7, wrong);
    TEST_ASSERT_EQUAL_INT(TSE_E_TIME, tse_replay(&p, &log, 20, &s, &out, NULL));
  }
  log_dt[7] = real(1); /* the limit */
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_replay(&p, &log, 20, &s, &out, NULL));
  log_dt[7] = real(0.01);
  tse_real *const arrays[3] = { log_steer, log_front, log_rear };
  static const double most[3] = { 1.2, 400, 400 };
  for (int k = 0; k < 3; k++) {
    const tse_real was = arrays[k][5];
    const double bad[3] = { 1.001 * most[k], -1.001 * most[k], NAN };
    for (int b = 0; b < 3; b++) {
      arrays[k][5] = real(bad[b]);
      TEST_ASSERT_EQUAL_INT(TSE_E_INPUT, tse_replay(&p, &log, 20, &s, &out, &wrong));
      TEST_ASSERT_EQUAL_INT32(5, wrong);
    }
    arrays[k][5] = was;
  }
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_replay(&p, &log, 20, &s, &out, NULL));
}

/* Every result that is not finite gives a status. */
static void test_what_is_no_number_is_refused_and_never_put_out(void)
{
  const tse_config c = all_effects();
  const tse_params p = prepared(c);
  const tse_replay_out out = the_out();
  const tse_real bad[2] = { real((double)NAN), real((double)INFINITY) };
  static tse_real profile[20];
  lively(&c, 20);
  for (int k = 0; k < 2; k++) {
    int32_t wrong;
    EACH_FIELD(number_of_start, TSE_STRUCT_REPLAY_START)
    {
      const tse_replay_log log = the_log();
      tse_replay_start s = the_start();
      memcpy((char *)&s + number_of_start->offset, &bad[k], sizeof bad[k]);
      wrong = -1;
      TEST_ASSERT_EQUAL_INT_MESSAGE(
          TSE_E_INPUT, tse_replay(&p, &log, 20, &s, &out, &wrong), number_of_start->name);
      TEST_ASSERT_EQUAL_INT32_MESSAGE(0, wrong, number_of_start->name);
    }
    EACH_FIELD(column, TSE_STRUCT_REPLAY_LOG)
    {
      if (column->kind == 'p') continue;
      tse_replay_log log = the_log();
      const tse_replay_start s = the_start();
      const tse_real *const there = profile;
      memset(profile, 0, sizeof profile);
      profile[7] = bad[k];
      memcpy((char *)&log + column->offset, &there, sizeof there);
      wrong = -1;
      TEST_ASSERT_EQUAL_INT_MESSAGE(TSE_E_INPUT, tse_replay(&p, &log, 20, &s, &out, &wrong), column->name);
      TEST_ASSERT_EQUAL_INT32_MESSAGE(7, wrong, column->name);
    }
  }
}

/* A lag of the lateral force does not apply to the longitudinal one, which follows at
 * once. */
static void test_a_lag_of_the_side_force_leaves_the_drive_force_as_it_is(void)
{
  static double plain[60];
  tse_config c = default_car();
  for (int lags = 0; lags < 2; lags++) {
    c.relaxation_length = setting(lags ? 0.5 : 0);
    straight(&c, 20, 0.01, 60);
    for (int i = 0; i < 60; i++)
      log_front[i] = real(number(log_front[i]) * (1 + 0.004 * sin(0.3 * i))); /* drive and brake */
    replay(&c, 60);
    for (int i = 0; i < 60; i++) {
      if (lags) expect_near(plain[i], number(got_x[i]), BY_FORMAT(1e-9, 2e-3), "accel_x", i);
      else plain[i] = number(got_x[i]);
    }
  }
}

/* In a log of one row the acceleration of the wheels is unknown, and their inertia has no
 * effect. */
static void test_one_row_has_the_torque_of_its_slip_alone(void)
{
  const tse_config c = default_car();
  const tse_params p = prepared(c);
  const tse_replay_log log = the_log();
  const tse_replay_out out = the_out();
  tse_replay_start s = the_start();
  straight(&c, 20, 0.01, 1);
  s.vel_x_from_wheels = TSE_R(0), s.vel_x = real(19.9);
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_replay(&p, &log, 1, &s, &out, NULL));
  const double light[2] = { number(got_tf[0]), number(got_tr[0]) };
  TEST_ASSERT_TRUE(light[0] > 100 && light[1] > 100);
  s.wheel_inertia_front = s.wheel_inertia_rear = TSE_R(100);
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_replay(&p, &log, 1, &s, &out, NULL));
  expect_near(light[0], number(got_tf[0]), 0, "front", 0);
  expect_near(light[1], number(got_tr[0]), 0, "rear", 0);
}

/* Finite but too large, in each channel alone. The row need not be asked for, and the
 * outputs before it are finite. */
static void test_a_reading_that_overflows_alone_is_refused_too(void)
{
  const tse_config c = default_car();
  const tse_params p = prepared(c);
  const tse_real huge = real(
      BY_NUMBER(1.7e308, 3.4e38, 1e8)); /* the largest number is finite, a sum of two is not */
  static tse_real profile[20];
  tse_replay_log log;
  lively(&c, 20);
  for (int i = 0; i < 20; i++) profile[i] = i < 5 ? TSE_R(0) : huge;
  for (int k = 0; k < 3; k++) {
    const tse_replay_out all = the_out();
    tse_replay_out out = { 0 };
    tse_replay_start s = the_start();
    int32_t wrong = -1;
    log = the_log();
    if (k == 0) {
      log.force_x = profile;
      s.bias_accel_x = huge;
      out.accel_x = all.accel_x;
    }
    if (k > 0) {
      log.force_y = profile;
      s.bias_accel_y = huge;
      out.accel_y = all.accel_y;
    }
    if (k == 2) out = all;
    TEST_ASSERT_EQUAL_INT(TSE_E_INPUT, tse_replay(&p, &log, 20, &s, &out, &wrong));
    TEST_ASSERT_EQUAL_INT32(5, wrong);
    TEST_ASSERT_EQUAL_INT(TSE_E_INPUT, tse_replay(&p, &log, 20, &s, &out, NULL));
  }
  for (int i = 0; i < 5; i++)
    TEST_ASSERT_TRUE(r_is_finite(got_x[i]) && r_is_finite(got_y[i]) && r_is_finite(got_r[i])
        && r_is_finite(got_vx[i]) && r_is_finite(got_vy[i]) && r_is_finite(got_yaw[i])
        && r_is_finite(got_tf[i]) && r_is_finite(got_tr[i]));
  for (int k = 0; k < 2; k++) { /* a wheel that accelerates from the first row on */
    tse_replay_start s = the_start();
    int32_t wrong = -1;
    const tse_replay_out out = the_out();
    log = the_log();
    *(k ? &s.wheel_inertia_rear : &s.wheel_inertia_front) = huge;
    TEST_ASSERT_EQUAL_INT(TSE_E_INPUT, tse_replay(&p, &log, 20, &s, &out, &wrong));
    TEST_ASSERT_EQUAL_INT32(0, wrong);
    TEST_ASSERT_EQUAL_INT(k == 0, r_is_finite(got_tr[0]));
  }
}
