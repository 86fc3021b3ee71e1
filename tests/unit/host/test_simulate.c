/* tests/unit/host/test_simulate.c <-> src/host/simulate.c
 *
 * Reference: another model with wheels (newtons()), integrated in steps of 10 us. Random
 * numbers are seeded. Moments must lie within 4.42 standard errors of their nominal
 * values (missed by chance with probability 1e-5). */
#include <stddef.h>
#include <stdlib.h>

#include "model/state.h"

#include "unit_support.h"

#define SAMPLES 20000

static tse_sim sim, before;
static double sample_of[8][SAMPLES];

static tse_sim_input driver(double dt, double torque, double steer)
{
  tse_sim_input u = blank_sim_input();
  u.dt = real(dt), u.steer_angle = real(steer), u.wheel_torque_front = u.wheel_torque_rear = real(torque);
  u.road_level = real(1);
  return u;
}

static tse_sim_config quiet(void) { return still_sim(20); }

static void start(tse_config c, tse_sim_config s)
{
  const char *wrong = "";
  memset(&sim, 0x3c, sizeof sim);
  if (tse_sim_reset(&sim, &c, &s, &wrong) != TSE_OK) TEST_FAIL_MESSAGE(wrong);
}

static void step(tse_sim_input u, tse_sim_output *y)
{
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_sim_step(&sim, &u, y));
}

/* ------------------------------------------------------------------------------------------- the motion */

enum { SIMULATED_ROWS = 160 };

/* mass, yaw inertia, lf, lr, Cx front, Cx rear, Cy front, Cy rear, follow, radius front,
 * rear, inertia front, rear, levels (3) */
static const double simulated_car[] = { 1500.0, 2200.0, 1.2, 1.45, 150000.0, 120000.0, 90000.0, 110000.0, 0.5,
  0.33, 0.31, 2.4, 3.1, 0.8, 1.1, 0.9 };
static const double simulated_speed[] = { 20.0, 2.5, 0.0 };

static tse_config table_car(void)
{
  const double *const t = simulated_car;
  tse_config c = default_car();
  c.mass = setting(t[0]), c.yaw_inertia = setting(t[1]), c.lf = setting(t[2]), c.lr = setting(t[3]);
  c.longitudinal_stiffness_front = setting(t[4]), c.longitudinal_stiffness_rear = setting(t[5]);
  c.cornering_stiffness_front = setting(t[6]), c.cornering_stiffness_rear = setting(t[7]);
  c.rear_longitudinal_follows_front = setting(t[8]), c.wheel_radius_front = setting(t[9]);
  c.wheel_radius_rear = setting(t[10]);
  return c;
}

static tse_sim_config table_sim(double speed)
{
  const double *const t = simulated_car;
  tse_sim_config s = quiet();
  s.wheel_inertia_front = setting(t[11]), s.wheel_inertia_rear = setting(t[12]);
  s.true_cx_front = setting(t[13]), s.true_cy_front = setting(t[14]), s.true_cy_rear = setting(t[15]);
  s.speed = setting(speed);
  return s;
}

/* Row k of driver j: time step, steering angle, torques front and rear, brakes front and
 * rear, road. Driving, stopping, reversing. */
static void driver_row(int j, int k, double u[7])
{
  const double t = 0.015 * k, press = fmin(k / 20.0, 1.0), brake = k >= 70 && k < 90 ? 150.0 : 0.0;
  const double road = k < 60 ? 1.0 : 1.25 - 0.75 * (k < 110);
  const double row[3][7] = {
    { 0.01 + 0.01 * (k % 2), 0.03 * sin(5 * t), 500 * sin(4 * t), 250 * cos(3 * t), brake, brake / 2, road },
    { 0.01, 0.1 * press, 0.0, 0.0, 1500 * press, 1000 * press, 1.0 },
    { 0.01, 0.2 * sin(0.05 * k), -450 * fmin(k / 10.0, 1.0), 100 * sin(0.1 * k), 0.0, 0.0, 1.0 },
  };
  memcpy(u, row[j], sizeof row[j]);
}

/* The reference, in newtons and newton metres. Slip is relative to at least 1 m/s. Brakes
 * oppose the rotation, linearly up to 0.2 rad/s.
 *   Given:     x      vel_x, vel_y, yaw rate, wheel speeds
 *   Returned:  rate   derivatives of x
 *              accel  accel_x, accel_y */
static void newtons(const double x[5], const double u[7], double road, double rate[5], double accel[2])
{
  const double *const t = simulated_car, over = fmax(fabs(x[0]), 1), roll[2] = { t[9] * x[3], t[10] * x[4] };
  const double fx_front = t[4] * t[13] * road * (roll[0] - x[0]) / fmax(over, fabs(roll[0]));
  const double fx_rear = t[5] * road * (1 + t[8] * (t[13] - 1)) * (roll[1] - x[0])
      / fmax(over, fabs(roll[1]));
  const double fy_front = t[6] * t[14] * road * (u[1] * x[0] - x[1] - t[2] * x[2]) / over;
  const double fy_rear = t[7] * t[15] * road * (t[3] * x[2] - x[1]) / over,
               across = fy_front + fx_front * u[1];
  accel[0] = (fx_front + fx_rear - fy_front * u[1]) / t[0];
  accel[1] = (across + fy_rear) / t[0];
  rate[0] = accel[0] + x[1] * x[2];
  rate[1] = accel[1] - x[0] * x[2];
  rate[2] = (t[2] * across - t[3] * fy_rear) / t[1];
  rate[3] = (u[2] - u[4] * fmin(fmax(x[3] / 0.2, -1), 1) - t[9] * fx_front) / t[11];
  rate[4] = (u[3] - u[5] * fmin(fmax(x[4] / 0.2, -1), 1) - t[10] * fx_rear) / t[12];
}

/* Run driver j by Runge-Kutta in steps of 10 us: states and accelerations of every row.
 * Between rows, the driver's inputs are linear, and the road is that of the row
 * before. */
static double simulated[3][SIMULATED_ROWS][7];

static void reference_run(int j)
{
  static const double at[4] = { 0, 0.5, 0.5, 1 }, share[4] = { 1, 2, 2, 1 };
  double x[5] = { simulated_speed[j], 0, 0, simulated_speed[j] / simulated_car[9],
    simulated_speed[j] / simulated_car[10] };
  double from[7], to[7], rate[5] = { 0 };
  driver_row(j, 0, to);
  for (int k = 0; k < SIMULATED_ROWS; k++) {
    memcpy(from, to, sizeof from);
    driver_row(j, k, to);
    const int steps = k ? (int)(to[0] / 1e-5 + 0.5) : 0;
    for (int n = 0; n < steps; n++) {
      double sum[5] = { 0 }, accel[2];
      for (int s = 0; s < 4; s++) {
        double probe[5], u[7];
        for (int a = 0; a < 5; a++) probe[a] = x[a] + at[s] * to[0] / steps * rate[a];
        for (int a = 0; a < 7; a++) u[a] = from[a] + (to[a] - from[a]) * (n + at[s]) / steps;
        newtons(probe, u, from[6], rate, accel);
        for (int a = 0; a < 5; a++) sum[a] += share[s] * rate[a];
      }
      for (int a = 0; a < 5; a++) x[a] += to[0] / steps / 6 * sum[a];
    }
    memcpy(simulated[j][k], x, sizeof x);
    newtons(x, to, to[6], rate, simulated[j][k] + 5);
  }
}

/* Largest differences to the reference in run j: of the states (wheels times 0.3 m), and
 * of the accelerations. */
static void table_run(int j, double substep, double *state, double *accel)
{
  tse_sim_config s = table_sim(simulated_speed[j]);
  s.substep = setting(substep);
  start(table_car(), s);
  *state = *accel = 0;
  if (!(simulated[j][SIMULATED_ROWS - 1][0] != 0)) reference_run(j);
  for (int k = 0; k < SIMULATED_ROWS; k++) {
    tse_sim_input u = blank_sim_input();
    tse_sim_output y;
    double row[7];
    driver_row(j, k, row);
    u.dt = real(row[0]), u.steer_angle = real(row[1]), u.wheel_torque_front = real(row[2]);
    u.wheel_torque_rear = real(row[3]), u.brake_torque_front = real(row[4]),
    u.brake_torque_rear = real(row[5]);
    u.road_level = real(row[6]);
    step(u, &y);
    const double *const t = simulated[j][k];
    *state = fmax(*state, fabs(number(y.vel_x) - t[0]));
    *state = fmax(*state, fabs(number(y.vel_y) - t[1]));
    *state = fmax(*state, fabs(number(y.yaw_rate) - t[2]));
    *state = fmax(*state, 0.3 * fabs(number(y.wheel_speed_front) - t[3]));
    *state = fmax(*state, 0.3 * fabs(number(y.wheel_speed_rear) - t[4]));
    *accel = fmax(*accel, fabs(number(y.accel_x) - t[5]));
    *accel = fmax(*accel, fabs(number(y.accel_y) - t[6]));
  }
}

/* Driving at 20 m/s with two changes of road, braking to a standstill, driving off in
 * reverse. Substeps of 0.1 ms resolve the 7000/s of the wheels at walking pace. The
 * corners of brake and max() cost one order. Float: 16 substeps in 1.6e4 round 20 m/s by
 * 1e-6 each at random, and 1 m/s of slip is 80 m/s2 of acceleration. */
static void test_motion_matches_an_independent_model_of_forces_in_newtons(void)
{
  for (int j = 0; j < ROWS(simulated_speed); j++) {
    double state, accel;
    table_run(j, 0.0001, &state, &accel);
    expect_near(0, state, BY_FORMAT(2e-5, 2e-3), "states", j);
    expect_near(0, accel, BY_FORMAT(1e-3, 5e-2), "accelerations", j);
  }
}

/* Away from the corners, the error decreases with the square of the substep. */
static void test_motion_depends_on_the_substep_in_second_order_only(void)
{
  double coarse, fine, accel;
  table_run(0, 0.001, &coarse, &accel);
  table_run(0, 0.0005, &fine, &accel);
  expect_near(0, coarse, BY_FORMAT(2e-4, 2e-3), "1 ms", 0);
#if !defined(TSE_REAL_FLOAT) /* rounding hides the order */
  expect_near(4, coarse / fine, 0.5, "1 ms over 0.5 ms", 0);
#endif
}

static void test_longest_substep_is_stable_from_standstill_to_70_ms(void)
{
  const double speeds[] = { 0, 0.3, 1, 3, 20, 70 };
  for (int i = 0; i < ROWS(speeds); i++) {
    tse_sim_config s = quiet();
    tse_sim_output y;
    s.substep = setting(0.005), s.speed = setting(speeds[i]);
    start(default_car(), s);
    for (int k = 0; k < 1000; k++) {
      step(driver(0.01, k < 50 ? 300 : 0, k < 50 ? 0.02 : 0), &y);
      TEST_ASSERT_TRUE(fabs(number(y.vel_x) - speeds[i]) < 1.0 && fabs(number(y.vel_y)) < 6
          && fabs(number(y.yaw_rate)) < 1);
    }
    /* no inputs for 9.5 s: it rolls straight ahead again */
    expect_near(0, number(y.vel_y), 1e-3, "vel_y", i);
    expect_near(0, number(y.yaw_rate), 1e-3, "yaw rate", i);
    expect_near(number(y.vel_x), 0.33 * number(y.wheel_speed_front), 1e-3, "rolls freely", i);
  }
}

/* A row of 10 ms has ten substeps of 1 ms, not eleven. With a slightly shorter substep it
 * has eleven. */
static void test_time_step_is_divided_into_the_fewest_substeps(void)
{
  const double substeps[3] = { 0.001, 0.00100005, 0.000995 };
  tse_sim_output y[3];
  memset(y, 0, sizeof y);
  for (int j = 0; j < 3; j++) {
    tse_sim_config s = quiet();
    s.substep = setting(substeps[j]);
    s.speed = setting(3); /* slow: truncation far above the rounding in float */
    start(default_car(), s);
    for (int k = 0; k < 10; k++) step(driver(0.01, 100 * k, 0.02 * k), &y[j]);
  }
  TEST_ASSERT_EQUAL_MEMORY(&y[0], &y[1], sizeof y[0]);
  TEST_ASSERT_TRUE(y[0].vel_x != y[2].vel_x);
}

/* A time step that is a difference of two times may exceed 10 ms by one bit: still ten
 * substeps. */
static void test_rounding_of_the_time_step_costs_no_substep(void)
{
  tse_sim_output y[2];
  for (int ms = 1; ms <= 100; ms++) {
    for (int j = 0; j < 2; j++) {
      tse_sim_input u1 = driver(0, 1000, 0.1);
      u1.dt = neighbour(number(real(ms * 0.001)), INFINITY);
      tse_sim_config s = quiet();
      s.substep = setting(0.001 + j * 5e-9); /* 0.0005 % longer */
      s.speed = setting(3);
      start(default_car(), s);
      step(driver(0, 0, 0), &y[j]);
      step(u1, &y[j]);
    }
    TEST_ASSERT_EQUAL_MEMORY(&y[0], &y[1], sizeof y[0]);
  }
}

/* Straight ahead without brakes, m vx + J_f omega_f/R_f + J_r omega_r/R_r is the impulse
 * of the torques over the radii, up to rounding, with any tyres: they transfer momentum
 * between wheels and car. */
static void test_tyres_pass_the_impulse_of_the_wheels_to_the_car_without_loss(void)
{
  tse_sim_config s = table_sim(10);
  tse_sim_output first, y;
  memset(&first, 0, sizeof first); /* the compiler does not see that the loop sets it */
  double impulse = 0, last = 0;
  s.spread_cx_front = setting(0.2);
  start(table_car(), s);
  for (int k = 0; k <= 400; k++) {
    const tse_sim_input u = driver(0.01, 400 * sin(0.05 * k) + 100, 0);
    const double torque = number(u.wheel_torque_front);
    step(u, &y);
    if (k == 0) first = y;
    else impulse += 0.005 * (torque + last) * (1 / 0.33 + 1 / 0.31);
    last = torque;
  }
  const double gained = 1500.0 * (number(y.vel_x) - number(first.vel_x))
      + 2.4 / 0.33 * (number(y.wheel_speed_front) - number(first.wheel_speed_front))
      + 3.1 / 0.31 * (number(y.wheel_speed_rear) - number(first.wheel_speed_rear));
  TEST_ASSERT_TRUE(impulse > 2000);
  expect_near(impulse, gained, BY_FORMAT(1e-8, 1.0), "impulse [Ns]",
      0); /* float: 1e-6 m/s times 1500 kg, 4000 times at random */
}

static void test_car_starts_rolling_freely_at_its_speed_and_keeps_it(void)
{
  tse_sim_output y;
  start(table_car(), table_sim(16.5));
  for (int k = 0; k < 300; k++) {
    step(driver(0.01, 0, 0), &y);
    expect_near(16.5, number(y.vel_x), BY_FORMAT(1e-12, 1e-4), "vel_x", k);
    expect_near(16.5 / 0.33, number(y.wheel_speed_front), BY_FORMAT(1e-10, 1e-3), "front wheel", k);
    expect_near(16.5 / 0.31, number(y.wheel_speed_rear), BY_FORMAT(1e-10, 1e-3), "rear wheel", k);
  }
}

static void test_brakes_hold_a_standing_car_against_less_torque_than_theirs(void)
{
  tse_sim_config s = quiet();
  tse_sim_output y;
  s.speed = setting(0);
  start(default_car(), s);
  for (int k = 0; k < 500; k++) {
    tse_sim_input u = driver(0.01, k < 100 ? 0 : 500, 0.3);
    u.brake_torque_front = u.brake_torque_rear = real(1000);
    step(u, &y);
    if (k < 100) {
      TEST_ASSERT_TRUE(
          !(y.vel_x != TSE_R(0)) && !(y.wheel_speed_front != TSE_R(0)) && !(y.yaw_rate != TSE_R(0)));
    }
    /* Below 0.2 rad/s the brake is linear: half of its torque at half of that speed, and
     * no more. */
    TEST_ASSERT_TRUE(number(y.wheel_speed_front) >= 0 && number(y.wheel_speed_front) < 0.1001);
    TEST_ASSERT_TRUE(number(y.vel_x) >= 0 && number(y.vel_x) < 0.1001 * 0.33);
  }
}

static void test_braked_car_stops_and_does_not_roll_back(void)
{
  tse_sim_config s = quiet();
  tse_sim_output y;
  double slowest = 1;
  s.speed = setting(5);
  start(default_car(), s);
  for (int k = 0; k < 400; k++) {
    tse_sim_input u = driver(0.01, 0, 0.1);
    u.brake_torque_front = u.brake_torque_rear = real(1500);
    step(u, &y);
    slowest = fmin(slowest, number(y.vel_x));
  }
  TEST_ASSERT_TRUE(slowest > -1e-3);
  expect_near(0, number(y.vel_x), 1e-6, "vel_x", 0);
  expect_near(0, number(y.yaw_rate), 1e-6, "yaw rate", 0);
}

static void test_turning_right_is_turning_left_mirrored_bit_for_bit(void)
{
  tse_sim_output left[100], right;
  for (int side = 0; side < 2; side++) {
    start(default_car(), quiet());
    for (int k = 0; k < 100; k++) {
      step(driver(0.01, 300, (side == 0 ? 0.05 : -0.05) * sin(0.1 * k)), side == 0 ? &left[k] : &right);
      if (side == 0) continue;
      const tse_real mirrored[2] = { -right.vel_y, -right.accel_y };
      expect_mirrored(left[k].vel_x, right.vel_x, "vel_x");
      if (k > 0) expect_mirrored(left[k].vel_y, mirrored[0], "vel_y");
      if (k > 0) expect_mirrored(left[k].accel_y, mirrored[1], "accel_y");
    }
  }
}

/* ------------------------------------------------------------------------------- tyres that saturate */

/* Brush model of an axle, with forces over mass. Returned: share of the linear force */
static double brush(double limit, double fx, double fy)
{
  const double force = hypot(fx, fy), z = force / (3 * limit);
  return z < 1 ? 1 - z + z * z / 3 : limit / force;
}

/* Specific forces of the built-in car at the state in y with friction mu.
 *   Returned:  lin  those of linear tyres
 *              z    q of the front axle */
static void closed_form(
    const tse_sim_output *y, double steer, double mu, double a[2], double lin[2], double *z)
{
  const double m = 1900, lf = 1.25, lr = 1.5, vx = number(y->vel_x), g = 9.81 * mu / (lf + lr);
  const double rf = 0.33 * number(y->wheel_speed_front), rr = 0.33 * number(y->wheel_speed_rear);
  const double fx[2] = { 1.6e5 / m * (rf - vx) / fmax(rf, vx), 1.6e5 / m * (rr - vx) / fmax(rr, vx) };
  const double fy[2] = { 1.2e5 / m * (steer - (number(y->vel_y) + lf * number(y->yaw_rate)) / vx),
    1.4e5 / m * (lr * number(y->yaw_rate) - number(y->vel_y)) / vx };
  const double front = brush(g * lr, fx[0], fy[0]), rear = brush(g * lf, fx[1], fy[1]);
  *z = hypot(fx[0], fy[0]) / (3 * g * lr);
  lin[0] = fx[0] + fx[1] - fy[0] * steer;
  lin[1] = fy[0] + fy[1] + fx[0] * steer;
  a[0] = front * (fx[0] - fy[0] * steer) + rear * fx[1];
  a[1] = front * (fy[0] + fx[0] * steer) + rear * fy[1];
}

/* From rolling to sliding sideways with locked wheels. */
static void test_saturated_forces_are_those_of_the_brush_model(void)
{
  const double mus[] = { 0.1, 0.4, 1.0, 2.0 };
  double least = 10, most = 0;
  for (int i = 0; i < ROWS(mus); i++)
    for (int j = 0; j < 4; j++) {
      tse_sim_config s = quiet();
      s.friction = setting(mus[i]), s.vel_y = setting(0.02 * j * j);
      start(default_car(), s);
      for (int k = 0; k < 60; k++) {
        tse_sim_input u = driver(0.01, k < 30 ? 20 * k : 0, 0.01 * j);
        tse_sim_output y;
        double a[2], lin[2], z;
        u.brake_torque_front = u.brake_torque_rear = real(k < 30 ? 0 : 100 * (k - 30));
        step(u, &y);
        closed_form(&y, number(u.steer_angle), mus[i], a, lin, &z);
        expect_near(a[0], number(y.accel_x), BY_FORMAT(1e-11, 1e-3), "accel_x", k);
        expect_near(a[1], number(y.accel_y), BY_FORMAT(1e-11, 1e-3), "accel_y", k);
        least = fmin(least, z);
        most = fmax(most, z);
      }
    }
  TEST_ASSERT_TRUE(least < 1e-3 && most > 3);
}

/* The friction of the road is that of the settings until the input sets another one. */
static void test_friction_of_the_road_takes_the_place_of_the_settings(void)
{
  tse_sim other;
  for (int named = 0; named < 2; named++) {
    tse_sim_config s = quiet(), t = quiet();
    s.friction = setting(0.9);
    t.friction = setting(named ? 0.2 : 0.9);
    start(default_car(), t);
    other = sim;
    start(default_car(), s);
    for (int k = 0; k < 200; k++) {
      tse_sim_input u = driver(0.01, 900 * sin(0.1 * k), 0.03 * sin(0.07 * k));
      tse_sim_output y, z;
      TEST_ASSERT_EQUAL_INT(TSE_OK, tse_sim_step(&other, &u, &z));
      u.road_friction = real(named ? number(t.friction) : 0);
      step(u, &y);
      TEST_ASSERT_EQUAL_MEMORY(&z, &y, sizeof y);
    }
  }
}

/* The road turns to ice: the row with the new friction is the first affected. */
static void test_friction_may_change_from_row_to_row(void)
{
  start(default_car(), quiet());
  for (int k = 0; k < 120; k++) {
    tse_sim_input u = driver(0.01, 0, 0.02);
    tse_sim_output y;
    double a[2], lin[2], z;
    u.road_friction = real(k < 60 ? 0 : 0.2);
    step(u, &y);
    closed_form(&y, number(u.steer_angle), 0.2, a, lin, &z);
    expect_near(k < 60 ? lin[1] : a[1], number(y.accel_y), BY_FORMAT(1e-11, 1e-3), "accel_y", k);
    if (k == 60) TEST_ASSERT_TRUE(a[1] < 0.9 * lin[1]);
  }
}

/* Road inputs in each row give the same bits as settings, and the simulator's state is
 * accepted afterwards. */
static void test_a_road_given_row_by_row_acts_as_that_of_the_settings(void)
{
  static tse_sim_output y[2];
  static tse_sim kept;
  tse_config c = table_car(), leans = c;
  const tse_sim_config s = table_sim(20);
  leans.bank_angle = setting(0.03), leans.grade_angle = setting(-0.02);
  for (int way = 0; way < 2; way++) {
    start(way ? leans : c, s);
    for (int row = 0; row < 50; row++) {
      tse_sim_input u = driver(0.01, 100, 0.01);
      if (!way) u.bank = r_from_setting(setting(0.03)), u.grade = r_from_setting(setting(-0.02));
      step(u, &y[way]);
    }
    memcpy(&kept, &sim, sizeof kept);
    TEST_ASSERT_EQUAL_INT(TSE_OK, tse_sim_check(&kept, way ? &leans : &c, &s));
  }
  TEST_ASSERT_EQUAL_MEMORY(&y[1], &y[0], sizeof y[0]);
  start(c, s);
  for (int row = 0; row < 50; row++) step(driver(0.01, 100, 0.01), &y[1]);
  TEST_ASSERT_TRUE(number(y[0].vel_y) < number(y[1].vel_y)
      && number(y[0].vel_x) > number(y[1].vel_x)); /* to the right and downhill */
}

/* Held inputs are ramps with equal ends and a jump at every row. An effect on the
 * steering gets the same angles. */
static void test_held_inputs_act_from_their_row_to_the_next(void)
{
  tse_sim ramped;
  for (int lag = 0; lag < 2; lag++) {
    tse_config c = default_car();
    tse_sim_config s = quiet();
    tse_sim_input last = driver(0.01, 0, 0);
    c.steering_lag_time = setting(lag ? 0.05 : 0);
    start(c, s);
    ramped = sim;
    s.hold_inputs = 1;
    start(c, s);
    for (int k = 0; k < 200; k++) {
      tse_sim_input u = driver(k % 7 ? 0.01 : 0.025, 700 * sin(0.3 * k), 0.02 * cos(0.2 * k)), end = u;
      tse_sim_output y, z;
      u.brake_torque_rear = real(30 * (k % 3));
      if (k > 0) {
        end.steer_angle = last.steer_angle;
        end.wheel_torque_front = end.wheel_torque_rear = last.wheel_torque_front;
        end.brake_torque_rear = last.brake_torque_rear;
      } else {
        end = u;
      }
      step(u, &y);
      TEST_ASSERT_EQUAL_INT(TSE_OK, tse_sim_step(&ramped, &end, &z));
      ramped.last = u; /* the jump */
      TEST_ASSERT_EQUAL_MEMORY(&z.vel_x, &y.vel_x, 3 * sizeof(tse_real));
      TEST_ASSERT_EQUAL_MEMORY(&z.wheel_speed_front, &y.wheel_speed_front, 2 * sizeof(tse_real));
      TEST_ASSERT_EQUAL_MEMORY(&u.steer_angle, &y.row.steer_angle, sizeof(tse_real));
      last = u;
    }
  }
}

/* A slope acts from the row before it on, in which it begins to rise, to the row after
 * it: as a ramp, with half of its gravity in each of the two steps. */
static void test_a_slope_of_one_row_acts_in_the_steps_before_and_after_it(void)
{
  for (int bank = 0; bank < 2; bank++) {
    double speed[2][3];
    for (int slope = 0; slope < 2; slope++) {
      tse_config c = default_car();
      start(c, quiet());
      for (int row = 0; row < 3; row++) {
        tse_sim_input u = driver(0.01, 0, 0);
        tse_sim_output y;
        *(bank ? &u.bank : &u.grade) = real(slope && row == 1 ? -0.1 : 0);
        step(u, &y);
        speed[slope][row] = number(bank ? y.vel_y : y.vel_x);
      }
    }
    const double half = 0.5 * 9.81 * sin(0.1) * 0.01;
    expect_near(half, fabs(speed[1][1] - speed[0][1]), 0.15 * half, "before", bank);
    expect_near(2 * half, fabs(speed[1][2] - speed[0][2]), 0.3 * half, "after", bank);
  }
}

/* True accelerations and yaw rate are those of the car, whatever the IMU makes of
 * them. */
static void test_true_values_have_no_errors_of_the_sensors(void)
{
  tse_sim_output y[2];
  for (int k = 0; k < 2; k++) {
    tse_config c = default_car();
    c.imu_scale_ax_error = c.imu_scale_ay_error = c.gyro_scale_error = setting(k ? 0.1 : 0);
    start(c, quiet());
    for (int row = 0; row < 50; row++) step(driver(0.01, 500, 0.02), &y[k]);
  }
  expect_near(number(y[0].accel_x), number(y[1].accel_x), BY_FORMAT(1e-9, 1e-4), "true accel_x", 0);
  expect_near(number(y[0].accel_y), number(y[1].accel_y), BY_FORMAT(1e-9, 1e-4), "true accel_y", 0);
  expect_near(number(y[0].yaw_rate), number(y[1].yaw_rate), BY_FORMAT(1e-9, 1e-4), "true yaw rate", 0);
  TEST_ASSERT_TRUE(number(y[0].yaw_rate) > 0.05);
  TEST_ASSERT_TRUE(number(y[0].accel_x) > 0.1 && number(y[0].accel_y) > 1);
  expect_near(1.1 * number(y[0].row.accel_x), number(y[1].row.accel_x), BY_FORMAT(1e-9, 1e-4), "accel_x", 0);
  expect_near(1.1 * number(y[0].row.accel_y), number(y[1].row.accel_y), BY_FORMAT(1e-9, 1e-4), "accel_y", 0);
}

/* A car that rolls straight responds to a step of the steering in the row that logs it,
 * not before. */
static void test_a_held_step_of_the_steering_is_felt_in_its_row(void)
{
  tse_config c = default_car();
  tse_sim_config s = quiet();
  s.hold_inputs = 1;
  for (int run = 0; run < 4; run++) {
    const int effect = run % 2;
    const double left = run < 2 ? 0.02 : -0.02;
    c.steering_offset_angle = setting(effect ? 0.001 : 0);
    start(c, s);
    for (int k = 0; k < 3; k++) {
      const double steer = (k == 2 ? left : 0) - (effect ? 0.001 : 0);
      tse_sim_output y;
      step(driver(0.01, 0, steer), &y);
      expect_near(k == 2 ? left * 1.2e5 / 1900 : 0, number(y.accel_y), BY_FORMAT(1e-9, 1e-3), "accel_y", k);
    }
  }
}

/* Wheel speeds are no inputs: tyres with a relaxation length, however short, have no slip
 * without drive. A constant torque accelerates car and wheels together, by torque over m
 * R + sum of J/R. */
static void test_a_lag_along_the_car_moves_nothing_that_no_torque_moves(void)
{
  const double length[] = { 1e-3, 0.02, 0.4 }, R = 0.33, J = 2.4;
  for (int i = 0; i < ROWS(length); i++)
    for (int driven = 0; driven < 2; driven++) {
      tse_config c = default_car();
      tse_sim_output y;
      c.longitudinal_relaxation_length = setting(length[i]);
      start(c, quiet());
      const double torque = driven ? 300 : 0;
      for (int k = 0; k < 200; k++) {
        step(driver(0.01, torque, 0), &y);
        if (k < 100 && driven) continue;
        expect_near(2 * torque / R / (1900 + 2 * J / R / R), number(y.accel_x), BY_FORMAT(2e-4, 2e-3),
            "accel_x", 100 * i + k);
        if (!driven) expect_near(20 / R, number(y.wheel_speed_front), BY_FORMAT(1e-9, 1e-4), "front", k);
        if (!driven) expect_near(20 / R, number(y.wheel_speed_rear), BY_FORMAT(1e-9, 1e-4), "rear", k);
      }
    }
}

/* A rolling wheel adds its inertia: m + J/R^2. A locked wheel turns at most at 0.2
 * rad/s. */
static void test_locked_axles_decelerate_with_friction_times_their_load(void)
{
  const double torques[] = { 6000, 2e4, 1e5 };
  const double rolling = 2.4 / 0.33 / 0.33 / 1900;
  for (int i = 0; i < ROWS(torques); i++)
    for (int both = 0; both < 2; both++) {
      tse_sim_config s = quiet();
      s.friction = setting(0.8), s.speed = setting(30);
      start(default_car(), s);
      for (int k = 0; k < 250; k++) {
        tse_sim_input u = driver(0.01, 0, 0);
        tse_sim_output y;
        if (k > 0) u.brake_torque_front = real(torques[i]);
        if (k > 0 && both) u.brake_torque_rear = real(torques[i]);
        step(u, &y);
        TEST_ASSERT_TRUE(number(y.wheel_speed_front) >= 0 && number(y.wheel_speed_rear) >= 0);
        if (k < 100) continue;
        const double a = both ? 0.8 * 9.81 : 0.8 * 9.81 * 1.5 / 2.75 / (1 + rolling);
        expect_near(-a, number(y.accel_x), BY_FORMAT(1e-4, 1e-2), both ? "both" : "front", k);
        TEST_ASSERT_TRUE(number(y.wheel_speed_front) < 0.2);
      }
    }
}

static void test_a_spinning_axle_pushes_with_friction_times_its_load_and_grips_again(void)
{
  tse_sim_config s = quiet();
  tse_sim_output y;
  double fastest = 0;
  s.friction = setting(0.3), s.speed = setting(0);
  start(default_car(), s);
  for (int k = 0; k < 1500; k++) {
    tse_sim_input u = driver(0.01, 0, 0);
    u.wheel_torque_front = real(k < 200 ? 2000 : 0);
    step(u, &y);
    fastest = fmax(fastest, number(y.wheel_speed_front));
    if (k > 50 && k < 200)
      expect_near(
          0.3 * 9.81 * 1.5 / 2.75 / (1 + 2.4 / 0.33 / 0.33 / 1900), number(y.accel_x), 2e-3, "accel_x", k);
  }
  TEST_ASSERT_TRUE(fastest > 500);
  expect_near(number(y.vel_x), 0.33 * number(y.wheel_speed_front), 2e-3, "rolls again", 0);
}

static void test_a_car_that_slides_sideways_stops_by_friction_alone(void)
{
  tse_sim_config s = quiet();
  tse_sim_output y;
  s.friction = setting(0.5), s.speed = setting(20), s.vel_y = setting(10);
  start(default_car(), s);
  for (int k = 0; k < 300; k++) {
    step(driver(0.01, 0, 0), &y);
    if (k == 0) {
      expect_near(10, number(y.vel_y), 0, "vel_y at the start", 0);
      expect_near(-0.5 * 9.81, number(y.accel_y), BY_FORMAT(1e-12, 1e-5), "both axles slide", 0);
    }
    TEST_ASSERT_TRUE(hypot(number(y.accel_x), number(y.accel_y)) < 0.5 * 9.81 * (1 + 1e-6));
  }
  TEST_ASSERT_TRUE(fabs(number(y.vel_y)) < 1);
}

/* Extreme drivers: no speed above what friction allows, and no wheel is braked into
 * reverse. Until the car spins, which amplifies every error, substeps of 1 ms and of 0.1
 * ms agree. */
static void test_locking_and_spinning_wheels_stay_stable_at_a_millisecond(void)
{
  enum { COUNT = 400, COMPARED = 80 };
  static double path[2][COMPARED][3];
  double off = 0;
  for (int seed = 1; seed <= 40; seed++) {
    const double mu = 0.05 + 0.05 * (seed % 20), speed = seed % 3 * 15;
    for (int fine = 0; fine < 2; fine++) {
      uint32_t words = (uint32_t)seed;
      tse_sim_config s = quiet();
      tse_sim_input u = driver(0.01, 0, 0);
      tse_sim_output y;
      s.friction = setting(mu);
      s.substep = setting(fine ? 0.0001 : 0.001);
      s.speed = setting(speed);
      tse_config c = default_car();
      c.relaxation_length = setting(seed % 4 ? 0 : 0.3);
      start(c, s);
      for (int k = 0; k < COUNT; k++) {
        if (k % 20 == 0) {
          u.steer_angle = real(next_between(&words, -0.3, 0.3));
          u.wheel_torque_front = real(fmax(0, next_between(&words, -3000, 3000)));
          u.wheel_torque_rear = real(fmax(0, next_between(&words, -3000, 3000)));
          u.brake_torque_front = real(fmax(0, next_between(&words, -2e4, 2e4)));
          u.brake_torque_rear = real(fmax(0, next_between(&words, -1e5, 1e5)));
        }
        step(u, &y);
        const double v[3] = { number(y.vel_x), number(y.vel_y), number(y.yaw_rate) };
        if (v[0] > 0)
          TEST_ASSERT_TRUE(number(y.wheel_speed_front) > -1e-3 && number(y.wheel_speed_rear) > -1e-3);
        TEST_ASSERT_TRUE(hypot(v[0], v[1]) < speed + mu * 9.81 * 4 + 0.1 && fabs(v[2]) < 6);
        for (int a = 0; a < 3 && k < COMPARED; a++) {
          if (fine) off = fmax(off, fabs(path[0][k][a] - v[a]));
          path[fine][k][a] = v[a];
        }
      }
    }
  }
  expect_near(0, off, 0.1, "1 ms against 0.1 ms [m/s, rad/s]", 0);
}

/* ------------------------------------------------------------------------------ stiffness, noise, bias */

/* One row per millisecond, in one substep. Requested values, in sample_of[0..]: */
enum { DRAWN, NOISE };
static void record(tse_config c, tse_sim_config s, double road, int what)
{
  start(c, s);
  for (int k = 0; k < SAMPLES; k++) {
    tse_sim_input u = driver(0.001, 100, 0.01);
    tse_sim_output y;
    u.road_level = real(road);
    step(u, &y);
    if (what == DRAWN) {
      for (int a = 0; a < 3; a++) sample_of[a][k] = number(y.drawn[a]);
    } else {
      const double truth[3] = { number(y.accel_x), number(y.accel_y), number(y.yaw_rate) };
      const double logged[3] = { number(y.row.accel_x), number(y.row.accel_y), number(y.row.yaw_rate) };
      for (int a = 0; a < 3; a++) sample_of[a][k] = logged[a] - truth[a] - number(y.bias[a]);
      sample_of[3][k] = number(y.row.steer_angle) - number(u.steer_angle);
      sample_of[4][k] = number(y.row.wheel_speed_front) - number(y.wheel_speed_front);
      sample_of[5][k] = number(y.row.wheel_speed_rear) - number(y.wheel_speed_rear);
      for (int a = 0; a < 2; a++) sample_of[6 + a][k] = number(y.drawn[a]);
    }
  }
}

static double normal_cdf(double x) { return 0.5 * erfc(-x * 0.70710678118654752); }

static int ascending(const void *a, const void *b)
{
  const double x = *(const double *)a, y = *(const double *)b;
  return (x > y) - (x < y);
}

/* Return the KS distance; sorts x. It exceeds the limit by chance with probability
 * 1e-5. */
static void expect_normal(double *x, double mean, double sd)
{
  double worst = 0;
  qsort(x, SAMPLES, sizeof x[0], ascending);
  for (int i = 0; i < SAMPLES; i++)
    worst = fmax(worst, fabs(normal_cdf((x[i] - mean) / sd) - (i + 0.5) / SAMPLES));
  TEST_ASSERT_TRUE(worst < 2.47 / sqrt(SAMPLES));
}

static void expect_white(double *x, const char *what) { expect_uncorrelated(x, x + 1, SAMPLES - 1, what); }

static void test_drawn_stiffness_has_the_mean_and_the_spread_of_the_settings(void)
{
  tse_sim_config s = quiet();
  const double mean[3] = { 0.8, 1.1, 0.9 }, spread[3] = { 0.05, 0.02, 0.15 };
  s.true_cx_front = setting(mean[0]), s.true_cy_front = setting(mean[1]), s.true_cy_rear = setting(mean[2]);
  s.spread_cx_front = setting(spread[0]), s.spread_cy_front = setting(spread[1]);
  s.spread_cy_rear = setting(spread[2]);
  record(default_car(), s, 0.5, DRAWN);
  for (int a = 0; a < 3; a++) {
    expect_moments(sample_of[a], SAMPLES, 0.5 * mean[a], 0.5 * mean[a] * spread[a], "drawn stiffness");
    expect_white(sample_of[a], "from row to row");
    for (int b = 0; b < a; b++)
      expect_uncorrelated(sample_of[a], sample_of[b], SAMPLES, "between the stiffnesses");
  }
  for (int a = 0; a < 3; a++) expect_normal(sample_of[a], 0.5 * mean[a], 0.5 * mean[a] * spread[a]);
}

/* Three sigma below the mean at the largest spread of 30 %: 0.135 % of the draws are
 * limited to a tenth of the mean. */
static void test_drawn_stiffness_never_falls_below_a_tenth_of_its_mean(void)
{
  tse_sim_config s = quiet();
  int cut = 0;
  s.spread_cx_front = s.spread_cy_front = s.spread_cy_rear = setting(0.3);
  s.true_cx_front = setting(2);
  record(default_car(), s, 1.0, DRAWN);
  for (int k = 0; k < SAMPLES; k++) {
    TEST_ASSERT_TRUE(sample_of[0][k] >= 0.2 * (1 - 1e-6) && sample_of[1][k] >= 0.1 * (1 - 1e-6));
    cut += sample_of[0][k] < 0.2 * (1 + 1e-6);
  }
  const double expected = normal_cdf(-3) * SAMPLES;
  expect_near(expected, cut, SIGMAS * sqrt(expected), "draws that were cut", 0);
}

static void test_mean_stiffness_is_the_setting_times_the_road(void)
{
  tse_sim_config s = quiet();
  const double mean[3] = { 0.75, 1.25, 0.875 }, road[] = { 1, 0.5, 10, 0.02 };
  s.true_cx_front = setting(mean[0]), s.true_cy_front = setting(mean[1]), s.true_cy_rear = setting(mean[2]);
  start(default_car(), s);
  for (int k = 0; k < ROWS(road); k++) {
    tse_sim_input u = driver(0.01, 0, 0);
    tse_sim_output y;
    u.road_level = real(road[k]);
    step(u, &y);
    for (int a = 0; a < 3; a++) {
      expect_near(mean[a] * road[k], number(y.stiffness[a]), BY_FORMAT(1e-14, 1e-6), "mean", a);
      expect_near(mean[a] * road[k], number(y.drawn[a]), BY_FORMAT(1e-14, 1e-6), "drawn without spread", a);
    }
  }
}

/* The accelerometer measures the stiffness drawn for its own row: at fixed slip, the
 * deviations are proportional. */
static void test_accelerometer_feels_the_stiffness_drawn_for_its_row(void)
{
  tse_sim_config s = quiet();
  s.spread_cx_front = s.spread_cy_front = s.spread_cy_rear = setting(0.2);
  start(default_car(), s);
  for (int k = 0; k < 200; k++) {
    const tse_sim_input u = driver(0.01, 300, 0.03);
    tse_sim_output y;
    step(u, &y);
    const inputs in = { u.steer_angle, real(0.33 * number(y.wheel_speed_front)),
      real(0.33 * number(y.wheel_speed_rear)) };
    const double vx = number(y.vel_x), vy = number(y.vel_y), r = number(y.yaw_rate),
                 delta = number(u.steer_angle);
    const double over_front = fmax(fabs(vx), number(in.v_front)),
                 over_rear = fmax(fabs(vx), number(in.v_rear));
    const double fxf = 1.6e5 * number(y.drawn[0]) * (number(in.v_front) - vx) / over_front;
    const double fxr = 1.6e5 * number(y.drawn[0]) * (number(in.v_rear) - vx)
        / over_rear; /* the rear follows the front */
    const double fyf = 1.2e5 * number(y.drawn[1]) * (delta - (vy + 1.25 * r) / vx);
    const double fyr = 1.4e5 * number(y.drawn[2]) * (1.5 * r - vy) / vx;
    expect_near((fxf + fxr - fyf * delta) / 1900, number(y.accel_x), BY_FORMAT(1e-11, 1e-3), "accel_x", k);
    expect_near((fyf + fyr + fxf * delta) / 1900, number(y.accel_y), BY_FORMAT(1e-11, 1e-3), "accel_y", k);
  }
}

static void test_sensor_noise_is_white_normal_and_of_the_size_asked_for(void)
{
  tse_config c = default_car();
  tse_sim_config s = quiet();
  const double sd[6] = { 3 * 0.1, 3 * 0.2, 3 * 0.004, 0.002, 0.5, 0.5 };
  c.accel_x_sd = setting(0.1), c.accel_y_sd = setting(0.2), c.yaw_rate_sd = setting(0.004);
  s.noise = setting(3), s.steer_angle_sd = setting(0.002), s.wheel_speed_sd = setting(0.5);
  s.spread_cx_front = s.spread_cy_front = setting(0.05);
  record(c, s, 1.0, NOISE);
  for (int a = 0; a < 8; a++)
    for (int b = 0; b < a; b++)
      expect_uncorrelated(sample_of[a], sample_of[b], SAMPLES, "channels and stiffness");
  for (int a = 0; a < 6; a++) {
    expect_moments(sample_of[a], SAMPLES, 0, sd[a], "noise");
    expect_white(sample_of[a], "from row to row");
  }
  for (int a = 0; a < 6; a++) expect_normal(sample_of[a], 0, sd[a]);
}

static void test_without_noise_the_log_is_the_truth_and_its_bias(void)
{
  const double bias[2][7] = { { 0 }, { 0, 0, 0, 0, 0.25, -0.5, 0.0625 } };
  for (int n = 0; n < 100; n++) {
    const int k = n % 50, biased = n / 50;
    tse_sim_config s = quiet();
    s.true_bias_accel_x = setting(bias[biased][4]), s.true_bias_accel_y = setting(bias[biased][5]);
    s.true_bias_yaw_rate = setting(bias[biased][6]);
    if (k == 0) start(default_car(), s);
    const tse_sim_input u = driver(0.01, 300, 0.03);
    tse_sim_output y;
    step(u, &y);
    const tse_real logged[7] = { y.row.dt, y.row.steer_angle, y.row.wheel_speed_front, y.row.wheel_speed_rear,
      y.row.accel_x, y.row.accel_y, y.row.yaw_rate };
    const tse_real dt = k > 0 ? u.dt : TSE_R(0); /* there is no time before the first row */
    const tse_real truth[7] = { dt, u.steer_angle, y.wheel_speed_front, y.wheel_speed_rear, y.accel_x,
      y.accel_y, y.yaw_rate };
    for (int a = 0; a < 7; a++)
      expect_near(number(truth[a]) + bias[biased][a], number(logged[a]), biased ? BY_FORMAT(1e-15, 2e-7) : 0,
          "channel", a);
    for (int a = 0; a < 3; a++) expect_near(bias[biased][4 + a], number(y.bias[a]), 0, "bias", a);
    TEST_ASSERT_EQUAL_HEX32(0, y.row.missing);
    TEST_ASSERT_EQUAL_INT(
        k > 0 ? TSE_OK : TSE_E_TIME, tse_input_check(&y.row, NULL)); /* accepted as a first row */
  }
}

/* Over many cars, the variance at time t is (bias_walk times walk)^2 t, also with rows of
 * different lengths. The sample variance of n normal numbers has the relative sd
 * sqrt(2/n). */
static void test_variance_of_the_bias_grows_with_time(void)
{
  enum { CARS = 3000 };
  const int rows[3] = { 4, 20, 40 };
  const double walk[3] = { 3 * 0.01, 3 * 0.03, 3 * 0.0005 };
  tse_config c = default_car();
  tse_sim_config s = quiet();
  c.accel_x_bias_walk = setting(0.01), c.accel_y_bias_walk = setting(0.03);
  c.yaw_rate_bias_walk = setting(0.0005);
  s.bias_walk = setting(3), s.substep = setting(0.005);
  static double end[3][3][CARS];
  double time[3] = { 0, 0, 0 };
  for (int i = 0; i < CARS; i++) {
    double t = 0;
    s.seed = i;
    start(c, s);
    for (int k = 0; k <= 40; k++) {
      const tse_sim_input u = driver(k % 2 ? 0.005 : 0.03, 0, 0);
      tse_sim_output y;
      step(u, &y);
      if (k > 0) t += number(u.dt);
      for (int j = 0; j < 3; j++)
        if (k == rows[j]) {
          time[j] = t;
          for (int a = 0; a < 3; a++) end[j][a][i] = number(y.bias[a]);
        }
    }
  }
  for (int j = 0; j < 3; j++)
    for (int a = 0; a < 3; a++) {
      const double variance = walk[a] * walk[a] * time[j];
      expect_near(0, mean_of(end[j][a], CARS), SIGMAS * sqrt(variance / CARS), "mean", a);
      expect_near(variance, covariance(end[j][a], end[j][a], CARS), SIGMAS * variance * sqrt(2.0 / CARS),
          "variance", a);
      for (int b = 0; b < a; b++) expect_uncorrelated(end[j][a], end[j][b], CARS, "between the sensors");
    }
}

/* ---------------------------------------------------------------------------------------------- seeds */

static tse_sim_config noisy(int32_t seed)
{
  tse_sim_config s;
  tse_sim_config_default(&s);
  s.bias_walk = setting(1), s.wheel_speed_sd = setting(0.1), s.steer_angle_sd = setting(0.001), s.seed = seed;
  return s;
}

static void test_same_seed_gives_the_same_bits_and_another_does_not(void)
{
  enum { COUNT = 100 };
  static tse_sim_output first[COUNT], again[COUNT], other[COUNT];
  tse_sim_output *const runs[3] = { first, again, other };
  for (int j = 0; j < 3; j++) {
    start(default_car(), noisy(j < 2 ? 5 : 6));
    for (int k = 0; k < COUNT; k++) {
      memset(&runs[j][k], 0x11 * (j + 1),
          sizeof runs[j][k]); /* the output is the same bytes, including padding */
      step(driver(0.01, 300, 0.03), &runs[j][k]);
    }
  }
  TEST_ASSERT_EQUAL_MEMORY(first, again, sizeof first);
  for (int k = 0; k < COUNT; k++) {
    TEST_ASSERT_TRUE(first[k].row.accel_x != other[k].row.accel_x
        && first[k].row.accel_y != other[k].row.accel_y && first[k].row.yaw_rate != other[k].row.yaw_rate
        && first[k].drawn[0] != other[k].drawn[0]);
  }
}

/* The estimator's seed must not change the simulated car, and equal seeds must not give
 * both the same random words. */
static void test_estimators_seed_plays_no_part(void)
{
  tse_config c = default_car();
  const tse_sim_config s = noisy(5);
  const tse_sim_input u = driver(0.01, 300, 0.03);
  tse_sim_output y[2];
  for (int j = 0; j < 2; j++) {
    c.seed = 5 + j;
    start(c, s);
    step(u, &y[j]);
    TEST_ASSERT_TRUE(sim.params.seed[1] != prepared(c).seed[1]);
  }
  TEST_ASSERT_EQUAL_MEMORY(&y[0], &y[1], sizeof y[0]);
}

/* --------------------------------------------------------------------------------------------- refusals */

static void expect_refused(const tse_sim_input *u, tse_status status, const char *what)
{
  tse_sim_output y, untouched;
  memset(&y, 0x5a, sizeof y);
  memcpy(&untouched, &y, sizeof y);
  memcpy(&before, &sim, sizeof sim); /* including padding */
  TEST_ASSERT_EQUAL_INT_MESSAGE(status, tse_sim_step(&sim, u, &y), what);
  TEST_ASSERT_EQUAL_MEMORY_MESSAGE(&before, &sim, sizeof sim, what);
  TEST_ASSERT_EQUAL_MEMORY_MESSAGE(&untouched, &y, sizeof y, what);
}

static void expect_accepted(const tse_sim_input *u, const char *what)
{
  tse_sim_output y;
  before = sim;
  TEST_ASSERT_EQUAL_INT_MESSAGE(TSE_OK, tse_sim_step(&sim, u, &y), what);
  sim = before;
}

static void test_refused_input_leaves_the_simulator_bit_for_bit_unchanged(void)
{
  tse_sim_output y;
  for (int rows = 0; rows < 2; rows++) { /* the first row, and a later one */
    start(default_car(), noisy(1));
    for (int k = 0; k < 3 * rows; k++) step(driver(0.01, 300, 0.03), &y);
    EACH_FIELD(row, TSE_STRUCT_SIM_INPUT)
    {
      if (row->offset == offsetof(tse_sim_input, dt)) continue; /* its statuses are tested below */
      const tse_real bad[5] = { neighbour(row->lo, -INFINITY), neighbour(row->hi, INFINITY),
        real((double)NAN), real((double)INFINITY), real((double)-INFINITY) };
      for (int j = 0; j < 7; j++) {
        tse_sim_input u = driver(0.01, 300, 0.03);
        put_field(&u, row, j == 5 ? row->lo : row->hi);
        if (j < 5) memcpy((char *)&u + row->offset, &bad[j], sizeof bad[j]);
        if (j < 5) expect_refused(&u, TSE_E_INPUT, row->name);
        else expect_accepted(&u, row->name);
      }
    }
  }
}

/* All settings in range, but not a car: light, on stiff tyres, with a rear axle that
 * steers by roll with a gain of 1200. */
static void test_a_row_after_which_there_is_no_car_any_more_is_refused(void)
{
  tse_config c = default_car();
  tse_sim_config s = quiet();
  tse_sim_output y;
  c.mass = setting(50), c.cornering_stiffness_rear = setting(4e6), c.accel_y_sd = setting(5);
  c.rear_roll_steer_gain = setting(0.5), c.rear_roll_steer_roll = setting(0.03);
  start(c, s);
  tse_sim_input u = driver(0.01, 0, -1.2);
  expect_refused(&u, TSE_E_INPUT, "no car at the start");
  c = default_car();
  s.speed = setting(70);
  start(c, s);
  u = driver(1.0, 1e5, 0); /* 163 m/s2: after six rows near the largest speed that tyres allow */
  for (int k = 0; k < 6; k++) step(u, &y);
  TEST_ASSERT_TRUE(number(y.vel_x) > 850 && number(y.vel_x) <= 1000);
  for (int k = 0; k < 2; k++) expect_refused(&u, TSE_E_INPUT, "no car");
  u = driver(0.01, 0, 0);
  step(u, &y); /* continue without the torque */
}

/* Any member that is not finite, or larger than a car allows. */
static void test_what_is_no_car_before_a_row_is_none_after_it(void)
{
  const tse_sim_input u = driver(0.01, 300, 0.03);
  tse_sim_output y;
  start(default_car(), noisy(1));
  for (int k = 0; k < 10; k++) step(u, &y);
  const tse_sim good = sim;
  tse_real *const part[] = { &sim.x[0], &sim.x[1], &sim.x[2], &sim.x[3], &sim.x[4], &sim.bias[0],
    &sim.bias[1], &sim.bias[2], &sim.effects.lag[0], &sim.effects.lag[3], &sim.steer };
  for (int i = 0; i < ROWS(part); i++) {
    *part[i] = broken();
    expect_refused(&u, TSE_E_INPUT, "a part that is no number");
    sim = good;
  }
  const double most[] = { 1000, 1000, 200, 1e7, 1e7 };
  for (int i = 0; i < ROWS(most); i++) {
    sim.x[i] = real(2.0 * most[i]);
    expect_refused(&u, TSE_E_INPUT, "more than a car can do");
    sim = good;
  }
  step(u, &y);
}

static void test_time_step_must_lie_between_zero_and_a_second_except_at_the_first_row(void)
{
  const double bad[] = { 0, -0.01, 1.0001, INFINITY, -INFINITY, NAN };
  tse_sim_input u = driver(0.01, 300, 0.03);
  tse_sim_output y;
  start(default_car(), noisy(1));
  for (int j = 0; j < ROWS(bad); j++) {
    u.dt = real(bad[j]);
    expect_accepted(&u, "first row");
  }
  step(u, &y);
  expect_near(20, number(y.vel_x), 0, "no time has passed", 0);
  for (int j = 0; j < ROWS(bad); j++) {
    u.dt = real(bad[j]);
    expect_refused(&u, TSE_E_TIME, "later row");
  }
  u.dt = real(1);
  expect_accepted(&u, "a second");
  u.dt = real(1e-6);
  expect_accepted(&u, "a microsecond");
}

static void test_null_arguments_are_refused(void)
{
  const tse_config c = default_car();
  const tse_sim_config s = quiet();
  const tse_sim_input u = driver(0.01, 0, 0);
  tse_sim_output y;
  start(c, s);
  before = sim;
  TEST_ASSERT_EQUAL_INT(TSE_E_NULL, tse_sim_step(NULL, &u, &y));
  TEST_ASSERT_EQUAL_INT(TSE_E_NULL, tse_sim_step(&sim, NULL, &y));
  TEST_ASSERT_EQUAL_INT(TSE_E_NULL, tse_sim_step(&sim, &u, NULL));
  TEST_ASSERT_EQUAL_INT(TSE_E_NULL, tse_sim_reset(NULL, &c, &s, NULL));
  TEST_ASSERT_EQUAL_INT(TSE_E_NULL, tse_sim_reset(&sim, NULL, &s, NULL));
  TEST_ASSERT_EQUAL_INT(TSE_E_NULL, tse_sim_reset(&sim, &c, NULL, NULL));
  TEST_ASSERT_EQUAL_INT(TSE_E_NULL, tse_sim_config_check(NULL, NULL));
  tse_sim_config_default(NULL);
  TEST_ASSERT_EQUAL_MEMORY(&before, &sim, sizeof sim);
}

static void expect_config_refused(const tse_sim_config *s, const char *name)
{
  const tse_config c = default_car();
  const char *wrong = "", *again = "";
  memset(&sim, 0xa5, sizeof sim);
  before = sim;
  TEST_ASSERT_EQUAL_INT_MESSAGE(TSE_E_CONFIG, tse_sim_config_check(s, &wrong), name);
  TEST_ASSERT_EQUAL_STRING(name, wrong);
  TEST_ASSERT_EQUAL_INT(TSE_E_CONFIG, tse_sim_reset(&sim, &c, s, &again));
  TEST_ASSERT_EQUAL_STRING(name, again);
  TEST_ASSERT_EQUAL_INT(TSE_E_CONFIG, tse_sim_config_check(s, NULL));
  TEST_ASSERT_EQUAL_MEMORY_MESSAGE(&before, &sim, sizeof sim, name);
}

static void test_each_setting_is_accepted_at_its_limits_and_refused_by_name_beyond(void)
{
  EACH_FIELD(row, TSE_STRUCT_SIM_CONFIG)
  {
    tse_sim_config s;
    tse_sim_config_default(&s);
    if (row->kind == 'i') {
      TEST_ASSERT_EQUAL_INT32_MESSAGE((int32_t)row->def, whole_field(&s, row), row->name);
      put_field(&s, row, row->lo - 1);
      expect_config_refused(&s, row->name);
      continue;
    }
    TEST_ASSERT_TRUE_MESSAGE(!(setting_field(&s, row) != setting(row->def)), row->name);
    put_field(&s, row, row->lo);
    TEST_ASSERT_EQUAL_INT_MESSAGE(TSE_OK, tse_sim_config_check(&s, NULL), row->name);
    put_field(&s, row, row->hi);
    TEST_ASSERT_EQUAL_INT_MESSAGE(TSE_OK, tse_sim_config_check(&s, NULL), row->name);
    const tse_setting bad[4] = { towards(setting(row->lo), -INFINITY), towards(setting(row->hi), INFINITY),
      setting((double)NAN), setting((double)INFINITY) };
    for (int k = 0; k < 4; k++) {
      put_setting(&s, row, bad[k]);
      expect_config_refused(&s, row->name);
    }
  }
}

static void test_wrong_setting_of_the_vehicle_is_named_and_the_simulator_unchanged(void)
{
  tse_config c = default_car();
  const tse_sim_config s = quiet();
  const char *wrong = "";
  c.yaw_inertia = setting(-1);
  memset(&sim, 0xa5, sizeof sim);
  before = sim;
  TEST_ASSERT_EQUAL_INT(TSE_E_CONFIG, tse_sim_reset(&sim, &c, &s, &wrong));
  TEST_ASSERT_EQUAL_STRING("yaw_inertia", wrong);
  TEST_ASSERT_EQUAL_MEMORY(&before, &sim, sizeof sim);
}
