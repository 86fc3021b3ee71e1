/* tests/unit/filter/test_pedals.c <-> src/filter/row.c, update.c, predict.c, output.c:
 * brake switch and wheel torques, src/tables/sensors.toml. */
#include "filter/row.h"
#include "filter/update.h"
#include "filter_support.h"

static tse_filter f, other;

static tse_config a_car(int driven, double grade_sd)
{
  tse_config c = config_by(tse_config_exact);
  c.driven_axle = driven, c.grade_sd = setting(grade_sd), c.initial_cx_sd = setting(0.05);
  return c;
}

static tse_input a_row(void)
{
  tse_input u = blank_row();
  u.dt = real(0.01), u.wheel_speed_front = real(60), u.wheel_speed_rear = real(60.5);
  return u;
}

#define BRAKE TSE_GIVEN_brake
#define FRONT TSE_GIVEN_wheel_torque_front
#define REAR TSE_GIVEN_wheel_torque_rear

/* Which axle rolls freely, in each case? The expected answer is a driver's. 60 Nm counts
 * as zero torque. */
static void test_the_axle_that_rolls_freely_is_that_of_the_pedals(void)
{
  static const struct {
    int driven;
    uint32_t given;
    double brake, front, rear;
    int rolls;
  } cases[] = {
    { 1, 0, 1, 900, 900, ROLLS_UNKNOWN }, /* nothing is given: nothing is read */
    { 1, BRAKE, 0, 0, 0, ROLLS_REAR },
    { 2, BRAKE, 0.4, 0, 0, ROLLS_FRONT },
    { 1, BRAKE, 0.5, 0, 0, ROLLS_NONE },
    { 0, BRAKE, 0, 0, 0, ROLLS_UNKNOWN }, /* with four driven wheels the switch alone is not enough */
    { 0, BRAKE, 1, 0, 0, ROLLS_UNKNOWN },
    { 0, BRAKE | FRONT | REAR, 1, 900, 0, ROLLS_NONE },
    { 1, BRAKE, 1.5, 0, 0, ROLLS_UNKNOWN }, /* out of range: missing */
    { 1, REAR, 0, 0, -59, ROLLS_REAR },
    { 1, REAR, 0, 0, -61, ROLLS_NONE },
    { 1, FRONT | REAR, 0, -900, 10, ROLLS_REAR }, /* only the driven axle brakes: a generator */
    { 2, FRONT | REAR, 0, -61, 900, ROLLS_NONE },
    { 1, FRONT, 0, -900, 0, ROLLS_UNKNOWN }, /* of the driven axle only: the other axle may brake */
    { 1, BRAKE | FRONT, 0, -900, 0, ROLLS_REAR },
    { 1, BRAKE | REAR, 1, 0, 0, ROLLS_NONE }, /* the switch closes before the brake acts */
    { 0, FRONT | REAR, 0, 900, 59, ROLLS_REAR },
    { 0, FRONT | REAR, 0, -50, -900, ROLLS_FRONT },
    { 0, FRONT | REAR, 0, 61, 59, ROLLS_REAR },
    { 0, FRONT | REAR, 0, 0, 0, ROLLS_NONE }, /* the driven axle is unknown */
    { 0, FRONT, 0, 0, 0, ROLLS_UNKNOWN },
  };
  for (int n = 0; n < (int)(sizeof cases / sizeof cases[0]); n++)
    for (int climbs = 0; climbs < 2; climbs++) {
      const tse_params p = prepared(a_car(cases[n].driven, 0.03 * climbs));
      tse_input u = a_row();
      decoded z;
      u.given = cases[n].given, u.brake = real(cases[n].brake), u.wheel_torque_front = real(cases[n].front);
      u.wheel_torque_rear = real(cases[n].rear);
      TEST_ASSERT_EQUAL_INT(TSE_OK, tse_reset(&p, &f, sizeof f));
      TEST_ASSERT_EQUAL_INT(TSE_OK, decode_row(&p, &f, &u, &z));
      TEST_ASSERT_EQUAL_INT_MESSAGE(cases[n].rolls, z.rolls, cases[n].given ? "given" : "not given");
      const int no_speed = cases[n].rolls == ROLLS_NONE
          || (cases[n].rolls == ROLLS_UNKNOWN && cases[n].driven == 0);
      TEST_ASSERT_EQUAL_INT(climbs && no_speed, z.no_slip);
    }
}

/* A row without usable sensors, in a car that slows down: a freely rolling axle is a
 * scalar measurement of its slip, as in a dense Kalman filter. */
static void test_an_axle_that_rolls_freely_is_a_measurement_of_its_slip(void)
{
  uint32_t seed = 4;
  for (int n = 0; n < 20; n++) {
    const tse_params p = prepared(a_car(1 + n % 2, 0.03));
    const int at = n % 2 ? SF : SR;
    const steering straight = { TSE_R(0), TSE_R(0), real(0.01) };
    static tse_kalman k;
    decoded z = { 0 };
    double x[STATES], off;
    memset(&k, 0, sizeof k);
    any_covariance(&k.ud, &seed);
    for (int i = 0; i < STATES; i++) k.ud.d[i] = real(0.05 * number(k.ud.d[i]));
    for (int a = 0; a < TSE_SENSORS; a++) k.noise[a] = k.usual[a] = TSE_R(1);
    k.x[VX] = real(20);
    k.x[at] = k.x[at == SF ? SR : SF] = real(-0.002); /* brakes, according to the forces */
    for (int i = 0; i < STATES; i++) x[i] = number(k.x[i]);
    const dense before = dense_of(&k.ud);
    z.dt = real(0.01), z.has_steer = 1, z.given = BRAKE;
    z.rolls = at == SF ? ROLLS_FRONT : ROLLS_REAR;
    update_row(&p, &k, &z, straight);
    const double unit = number(state_unit[at]), free = number(at == SF ? p.car.free_front : p.car.free_rear);
    const double s = unit * unit * before.p[at][at] + pow(number(FREE_SLIP_SD), 2), e = -free - x[at];
    dense after = before;
    for (int i = 0; i < STATES; i++)
      for (int j = 0; j < STATES; j++) after.p[i][j] -= unit * unit * before.p[i][at] * before.p[at][j] / s;
    for (int i = 0; i < STATES; i++) {
      const double change = unit * before.p[i][at] * e / s;
      if (i >= LCX && i <= LCR)
        expect_near(pow(number(OWN_SHARE) * change, 2), number(k.moved[i - LCX]), 1e-4, "moved", i);
      off = x[i] + number(state_unit[i]) * change;
      expect_near(off, number(k.x[i]), 1e-4 * (fabs(off) + number(state_unit[i])), "state", i);
    }
    expect_dense(&after, &k.ud, 3e-4, "covariance");
  }
}

/* Slip of noisy wheels indicates braking. If accel_x confirms this force, it is used. If
 * accel_x contradicts it by many sd, the rear axle of a front-driven car rolls freely,
 * and its slip has the corresponding sd. */
static void test_a_slip_that_accel_x_contradicts_does_not_brake(void)
{
  const tse_params p = prepared(a_car(1, 0.03));
  const steering straight = { TSE_R(0), TSE_R(0), real(0.01) };
  for (int contradicts = 0; contradicts < 2; contradicts++) {
    static tse_kalman k;
    decoded z = { 0 };
    forces by_slip;
    memset(&k, 0, sizeof k);
    for (int i = 0; i < STATES; i++) k.ud.d[i] = i == SF || i == SR ? TSE_R(1) : TSE_R(0);
    for (int a = 0; a < TSE_SENSORS; a++) k.noise[a] = k.usual[a] = TSE_R(1);
    k.x[VX] = real(20);
    k.x[SF] = k.x[SR] = real(-0.004);
    car_forces(&p.car, k.x, straight, TSE_R(1), &by_slip);
    z.dt = real(0.01), z.has_steer = 1, z.rolls = ROLLS_UNKNOWN;
    z.use[ACCEL_X] = 1, z.z[ACCEL_X] = contradicts ? TSE_R(0) : by_slip.x;
    TEST_ASSERT_TRUE(number(by_slip.x) < -0.5);
    update_row(&p, &k, &z, straight);
    const double sd = sqrt(number(ud_variance(&k.ud, SR)))
        * number(state_unit[SR]); /* accel_x measures the sum of both slips only */
    TEST_ASSERT_EQUAL_INT(contradicts, sd < 1.01 * number(FREE_SLIP_SD));
  }
}

/* While the car brakes, the longitudinal stiffness is learnt on a flat road, but not on a
 * road with unknown slope. */
static void test_braking_teaches_the_longitudinal_stiffness_on_a_flat_road_alone(void)
{
  static truth w;
  for (int climbs = 0; climbs < 2; climbs++) {
    truth_start(&w, a_car(1, 0.03 * climbs), 20, 0, 1);
    w.x[LCX] = real(0.2);
    w.amplitude = 0; /* the lateral force of a steered wheel has a longitudinal part */
    TEST_ASSERT_EQUAL_INT(TSE_OK, tse_reset(&w.p, &f, sizeof f));
    for (int n = 0; n < 800; n++) {
      tse_input u = truth_row(&w, 0.01);
      u.given = BRAKE, u.brake = TSE_R(1);
      TEST_ASSERT_TRUE(tse_step(&w.p, &f, &u, NULL) >= 0);
    }
    if (climbs) expect_near(0, number(f.k.x[LCX]), 1e-3, "not learnt", 0); /* a steering offset remains */
    else TEST_ASSERT_TRUE(number(f.k.x[LCX]) > 0.01);
  }
}

/* With four driven wheels, a known stiffness is excited while one axle has no torque. */
static void test_four_driven_wheels_are_excited_where_an_axle_has_no_torque(void)
{
  static truth w;
  tse_config c = a_car(0, 0.03);
  c.initial_cx_sd = setting(0.01); /* known, not to be estimated */
  tse_output y;
  truth_start(&w, c, 20, 0, 1);
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_reset(&w.p, &f, sizeof f));
  for (int n = 0; n < 600; n++) {
    tse_input u = truth_row(&w, 0.01);
    u.given = n % 3 == 0 ? 0 : FRONT | REAR;
    u.wheel_torque_front = real(800);
    u.wheel_torque_rear = real(n % 3 == 1 ? 800 : 20);
    TEST_ASSERT_TRUE(tse_step(&w.p, &f, &u, &y) >= 0);
    if (n > 300) TEST_ASSERT_EQUAL_INT(n % 3 == 2 ? TSE_VALID : TSE_NOT_EXCITED, y.reason[TSE_CX_FRONT]);
  }
}

/* Values that are not given are not read: the same bits. */
static void test_what_is_not_given_changes_no_bit(void)
{
  static truth w;
  truth_start(&w, a_car(1, 0.03), 20, 1, 1);
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_reset(&w.p, &f, sizeof f));
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_reset(&w.p, &other, sizeof other));
  for (int n = 0; n < 300; n++) {
    tse_input u = truth_row(&w, 0.01), more = u;
    more.brake = TSE_R(1);
    more.wheel_torque_front = more.wheel_torque_rear = real(-1000);
    TEST_ASSERT_EQUAL_INT(tse_step(&w.p, &f, &u, NULL), tse_step(&w.p, &other, &more, NULL));
  }
  TEST_ASSERT_EQUAL_MEMORY(&f, &other, sizeof f);
}
