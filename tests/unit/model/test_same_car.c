/* tests/unit/model/test_same_car.c <-> src/model/car.c, src/model/catalogue.h,
 * src/host/simulate.c: the filter has the same model of the car as simulator, replay and
 * vehicle FMU.
 *
 * The simulator drives, with settings for both. car_move() follows, with the wheel slips
 * of the simulator as inputs, and car_measure() predicts the readings. The simulator
 * integrates by ROS2, car_move() by symplectic Euler: their difference halves with the
 * time step. The differences at h and h/2 are extrapolated to zero, and the remainder is
 * a difference of the models. */
#include "model/car.h"

#include "tse/simulate.h"
#include "unit_support.h"

enum {
  SPEED_X,
  SPEED_Y,
  TURN,
  ACCEL_ALONG,
  ACCEL_ACROSS,
  GYRO,
  SPEED_FRONT,
  SPEED_REAR,
  CHANNELS,
  GRID = 800
};

typedef struct drive {
  double off[GRID][CHANNELS], read[GRID][CHANNELS];
} drive;

/* A slalom with increasing frequency, up to 2 Hz, and amplitude.
 *   Given:  pedals  1: with throttle and brake */
static tse_sim_input driver_at(double t, double h, double steer, int pedals)
{
  tse_sim_input u = blank_sim_input();
  u.dt = real(h), u.road_level = real(1);
  u.steer_angle = real(steer * (0.3 + 0.1 * t) * sin(2 * 3.141592653589793 * (0.2 + 0.11 * t) * t));
  const double torque = pedals ? 900 * sin(1.7 * t) : 150;
  u.wheel_torque_front = real(torque > 0 ? torque : 0);
  u.brake_torque_front = real(torque < 0 ? -0.6 * torque : 0);
  u.brake_torque_rear = real(torque < 0 ? -0.4 * torque : 0);
  return u;
}

/* Slip of the wheels by (3) with exact kinematics, at the simulator's state.
 *   Given:  angle  of the wheels, after lags */
static void slips_of(const tse_sim *sim, double slip[2])
{
  const tse_params *const p = &sim->params;
  const double d = number(sim->steer), side = number(sim->x[1]) + number(p->car.lf) * number(sim->x[2]);
  const double along[2] = { number(sim->x[0]) * cos(d) + side * sin(d), number(sim->x[0]) };
  const double turns[2] = { number(p->radius_front) * number(sim->x[3]),
    number(p->radius_rear) * number(sim->x[4]) };
  for (int a = 0; a < 2; a++) slip[a] = (turns[a] - along[a]) / fmax(along[a], turns[a]);
}

/* Set the filter's constants from the settings, and its state to the simulator's
 * start. */
static void start(const tse_params *p, const tse_sim *sim, tse_real x[TSE_VALUES])
{
  for (int i = 0; i < TSE_VALUES; i++) x[i] = p->prior[i];
  for (int i = VX; i <= YAW; i++) x[i] = sim->x[i - VX];
  x[AF] = sim->effects.lag[0];
  x[AR] = sim->effects.lag[1];
  for (int i = SF; i <= SR; i++) x[i] = TSE_R(0);
}

static void compare(const tse_config *c, double h, double steer, int pedals, drive *d)
{
  static tse_sim sim;
  static tse_short M[MOTION][PLACES];
  static tse_real H[TSE_SENSORS][PLACES];
  const tse_params p = prepared(*c);
  tse_sim_config s;
  tse_sim_output y;
  tse_real x[TSE_VALUES], angle[3], pitch[2] = { TSE_R(0), TSE_R(0) }, z[TSE_SENSORS];
  double slip[2], before[2];
  tse_sim_config_default(&s);
  s.noise = s.spread_cx_front = s.spread_cy_front = s.spread_cy_rear = setting(0);
  s.substep = setting(h);
  tse_sim_input u = driver_at(0, h, steer, pedals);
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_sim_reset(&sim, c, &s, NULL));
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_sim_step(&sim, &u, &y));
  start(&p, &sim, x);
  slips_of(&sim, before);
  x[PHI] = r_mul(p.car.roll_gain, sim.effects.mode[0][0]);
  pitch[0] = sim.effects.mode[1][0];
  for (int i = 0; i < 3; i++) angle[i] = u.steer_angle;
  const int rows = (int)lround(0.01 / h);
  for (int n = 0; n < GRID * rows; n++) {
    u = driver_at((n + 1) * h, h, steer, pedals);
    TEST_ASSERT_EQUAL_INT(TSE_OK, tse_sim_step(&sim, &u, &y));
    slips_of(&sim, slip);
    const tse_real was = angle[2];
    if (p.steer_lag > TSE_R(0)) lag_steering(p.steer_lag, p.steer_lag_second, u.steer_angle, u.dt, angle);
    else angle[2] = u.steer_angle;
    const steering w = { was, angle[2], u.dt };
    forces f;
    x[SF] = real(0.5 * (before[0] + slip[0]));
    x[SR] = real(0.5 * (before[1] + slip[1]));
    car_move(&p.car, x, w, M);
    for (int a = 0; a < 2; a++) before[a] = slip[a];
    x[SF] = real(slip[0]);
    x[SR] = real(slip[1]);
    car_forces(&p.car, x, w, TSE_R(1), &f);
    const tse_real leaks = car_pitch(&p.car, pitch, f.x, u.dt);
    car_measure(&p.car, x, &f, p.car.pitch_leak != TSE_R(0) ? leaks : TSE_R(0), z, H);
    if ((n + 1) % rows) continue;
    const double expected[CHANNELS] = { number(y.vel_x), number(y.vel_y), number(y.yaw_rate),
      number(y.row.accel_x), number(y.row.accel_y), number(y.row.yaw_rate),
      number(p.radius_front) * number(y.wheel_speed_front),
      number(p.radius_rear) * number(y.wheel_speed_rear) };
    const double actual[CHANNELS] = { number(x[VX]), number(x[VY]), number(x[YAW]), number(z[0]),
      number(z[1]), number(z[2]), number(z[3]), number(z[4]) };
    for (int k = 0; k < CHANNELS; k++) {
      d->read[n / rows][k] = expected[k];
      d->off[n / rows][k] = actual[k] - expected[k];
    }
  }
}

static drive coarse, fine, plain;
static double worst[CHANNELS], matters[CHANNELS], largest[CHANNELS];

/* The extrapolated difference of the readings, their distance from a car without effects,
 * and their size. */
static void look(const tse_config *c, double steer, int pedals)
{
  compare(c, 0.001, steer, pedals, &coarse);
  compare(c, 0.0005, steer, pedals, &fine);
  for (int k = 0; k < CHANNELS; k++) {
    worst[k] = matters[k] = largest[k] = 0;
    for (int i = 0; i < GRID; i++) {
      worst[k] = fmax(worst[k], fabs(2 * fine.off[i][k] - coarse.off[i][k]));
      matters[k] = fmax(matters[k], fabs(fine.read[i][k] - plain.read[i][k]));
      largest[k] = fmax(largest[k], fabs(fine.read[i][k]));
    }
  }
}

/* Tolerances: `share` of the yaw motion and of its sensors. Longitudinally: 8 s of the
 * error of the accelerometer. With slip s, a driving wheel turns by 1/(1 - s) in (3), and
 * by 1 + s in the filter: a difference of s^2 of 20 m/s. */
static double allowed(int k, double share, double along)
{
  if (k == SPEED_X || k == SPEED_REAR) return along;
  if (k == SPEED_FRONT) return along + 0.008;
  return share * largest[k] + (k == ACCEL_ALONG ? along / 3 : 0);
}

static void expect_same(const char *what, double share, double along)
{
  for (int k = 0; k < CHANNELS; k++) expect_near(0, worst[k], allowed(k, share, along), what, k);
}

typedef struct set {
  const char *name;
  size_t at;
  double value;
} set;
#define SET(name, value) { #name, offsetof(tse_config, name), value }
/* All effects of src/tables/effects.toml in the filter, except those tested below;
 * delays, which the filter models to first order. */
static const set sets[] = { SET(mass_change, 0.1), SET(yaw_inertia_change, 0.1), SET(cg_shift_distance, 0.1),
  SET(wheel_radius_change, 0.02), SET(steering_ratio_change, 0.05), SET(steering_offset_angle, 0.004),
  SET(steering_lag_time, 0.05), SET(rear_roll_steer_gain, 0.05), SET(longitudinal_load_transfer_gain, 0.03),
  SET(lateral_load_transfer_gain, 0.005), SET(aero_drag_coefficient, 0.45),
  SET(rolling_resistance_coefficient, 0.012), SET(grade_angle, 0.03), SET(bank_angle, 0.02),
  SET(bank_superelevation, 0.1), SET(conicity_front, 150), SET(conicity_rear, 150),
  SET(aligning_moment_trail, 0.03), SET(imu_lever_arm_x, 0.5), SET(imu_lever_arm_y, 0.3),
  SET(body_roll_gain, 0.0075), SET(pitch_leak_gain, 0.004), SET(imu_misalignment_angle, 0.03),
  SET(imu_scale_ax_error, 0.03), SET(imu_scale_ay_error, 0.03), SET(gyro_scale_error, 0.02) };

static void put(tse_config *c, const set *s)
{
  const tse_setting value = setting(s->value);
  memcpy((char *)c + s->at, &value, sizeof value);
}

/* Exact kinematics and a relaxation length, which the filter always has; shapes of
 * effects that may be switched on. */
static tse_config basic(void)
{
  tse_config c = config_by(tse_config_exact);
  c.exact_kinematics_share = setting(1), c.relaxation_length = setting(0.4);
  c.tyre_saturation_shape = setting(1); /* the filter's tyres then saturate at 50 times their load */
  c.steering_lag_second = setting(0.5), c.lateral_load_transfer_balance = setting(0.2),
  c.longitudinal_load_transfer_balance = setting(-0.3);
  c.body_roll_height = c.body_roll_coupling = c.pitch_leak_height = setting(0.3);
  return c;
}

/* Second order in the time step: (2 pi 2 Hz 1 ms)^2. Float: rounding of 16000 steps. */
static const double share = BY_FORMAT(0.00025, 0.01), along = BY_FORMAT(0.0005, 0.03);

static void test_each_effect_that_both_have_is_the_same(void)
{
  tse_config c = basic();
  look(&c, 0.1, 1);
  expect_same("exact kinematics, relaxation", share, along);
  plain = fine;
  for (int i = 0; i < ROWS(sets); i++) {
    int shows = 0;
    c = basic();
    put(&c, &sets[i]);
    look(&c, 0.1, 1);
    expect_same(sets[i].name, share, along);
    for (int k = 0; k < CHANNELS; k++) shows |= matters[k] > 4 * allowed(k, 0.00025, 0.0005);
    TEST_ASSERT_TRUE_MESSAGE(shows, sets[i].name); /* the effect is visible */
  }
}

static void test_all_of_them_together_are_the_same(void)
{
  tse_config c = basic();
  for (int i = 0; i < ROWS(sets); i++) put(&c, &sets[i]);
  look(&c, 0.1, 1);
  expect_same("all", share, along);
}

/* Load transfer changes the stiffness, not the grip. The filter's tyres also saturate
 * longitudinally: for a car with little drive, by 1 % of its slip force, 0.002 m/s2, and
 * over 8 s by enough speed to turn 0.1 % more. */
static void test_tyres_that_saturate_are_the_same(void)
{
  tse_config c = basic();
  for (int lose = 0; lose < 2; lose++) {
    c.tyre_saturation_inverse_friction = setting(1.1), c.tyre_saturation_shape = setting(0.6);
    c.lateral_load_transfer_gain = setting(lose ? 0.004 : 0);
    look(&c, 0.13, 0);
    TEST_ASSERT_TRUE(largest[ACCEL_ACROSS] > 4.5);
    expect_same(lose ? "saturation and load transfer" : "saturation", BY_FORMAT(0.0015, 0.01), 0.02);
  }
  plain = fine;
  for (int rear = 0; rear < 2; rear++) {
    c.tyre_saturation_balance = setting(rear ? -0.1 : 0.15);
    look(&c, 0.13, 0);
    expect_same(rear ? "the rear ends earlier" : "the front ends earlier", BY_FORMAT(0.0015, 0.01), 0.02);
    TEST_ASSERT_TRUE(
        matters[ACCEL_ACROSS] > 4 * allowed(ACCEL_ACROSS, 0.0015, 0.02)); /* the effect is visible */
  }
}

/* Steering compliance of the filter's wheels follows the present force, that of the
 * simulator the force after the tyre's relaxation: a difference of 2 % in a slalom of 1
 * Hz. In steady state they are equal. */
static void test_steering_compliance_is_the_same_but_for_the_relaxation(void)
{
  tse_config c = basic();
  c.steering_compliance_angle_per_moment = setting(5e-5);
  look(&c, 0.03, 0);
  expect_same("compliance", 0.03, 0.02);
}
