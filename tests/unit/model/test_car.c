/* tests/unit/model/test_car.c <-> src/model/car.c
 *
 * Slopes are compared with central differences (double only: they need digits), forces
 * and motion with closed forms. */
#include <time.h>

#include "model/car.h"
#include "number/vector.h"

#include "unit_support.h"

static const double pi = 3.14159265358979323846;

/* A car with all effects that have exact slopes.
 *   Given:  load  1: with load transfer, compliance and pitch, whose slopes are
 *   neglected */
static tse_car some_car(int load)
{
  tse_config c = config_by(tse_config_exact);
  c.mass = setting(1600), c.lf = setting(1.2), c.lr = setting(1.5), c.yaw_inertia = setting(2700);
  c.cornering_stiffness_front = setting(1e5), c.cornering_stiffness_rear = setting(1.3e5);
  c.grip = setting(1.1), c.tyre_saturation_shape = setting(0.4), c.relaxation_length = setting(0.4);
  c.body_roll_gain = setting(0.006), c.body_roll_frequency = setting(1.5), c.body_roll_damping = setting(0.3);
  c.body_roll_height = setting(0.2),
  c.body_roll_coupling = setting(HAS_ROLL ? 0.3 : 0); /* without roll states, the roll terms have no slopes */
  c.rear_roll_steer_gain = setting(0.05), c.aligning_moment_trail = setting(0.03);
  c.aero_drag_coefficient = setting(0.4), c.rolling_resistance_coefficient = setting(0.01);
  c.imu_lever_arm_x = setting(0.3), c.imu_lever_arm_y = setting(-0.2),
  c.imu_misalignment_angle = setting(0.03);
  c.imu_scale_ay_error = setting(0.02), c.gyro_scale_error = setting(0.01);
  if (load) {
    c.cg_height = setting(0.6), c.longitudinal_load_transfer_gain = setting(0.02);
    c.lateral_load_transfer_gain = setting(0.0005);
  }
  return prepared(c).car;
}

/* Tyres without saturation, no load transfer, no roll: the textbook car. */
static tse_car plain_car(void) { return prepared(config_by(tse_config_exact)).car; }

static void any_state(tse_real x[TSE_VALUES], uint32_t *seed)
{
  static const struct {
    int at;
    double most;
  } some[] = { { VX, 0 }, { VY, 0.5 }, { YAW, 0.3 }, { AF, 0.05 }, { AR, 0.05 }, { PHI, 0.03 }, { DPHI, 0.1 },
    { SF, 0.03 }, { SR, 0.03 }, { GX, 0.4 }, { GY, 0.2 }, { BX, 0.1 }, { BY, 0.1 }, { BR, 0.005 },
    { LCX, 0.3 }, { LCF, 0.3 }, { LCR, 0.3 }, { LMU, 0.2 }, { STEER_OFFSET, 0.005 }, { GAIN, 0.04 },
    { LATE, 0.03 }, { RAD, 0.01 }, { LEAN, 0.1 } };
  for (int i = 0; i < TSE_VALUES; i++) x[i] = TSE_R(0);
  for (int i = 0; i < (int)(sizeof some / sizeof some[0]); i++)
    x[some[i].at] = real(next_between(seed, -some[i].most, some[i].most));
  x[VX] = real(next_between(seed, 8, 35));
}

static steering any_steering(uint32_t *seed)
{
  const double from = next_between(seed, -0.08, 0.08);
  return (steering){ real(from), real(from + next_between(seed, -0.004, 0.004)),
    real(next_between(seed, 0.005, 0.02)) };
}

/* ------------------------------------------------------------------------------- slopes */

#if defined(TSE_REAL_DOUBLE)
static const double unit[PLACES] = { [VX] = 0.2,
  [VY] = 0.1,
  [YAW] = 0.02,
  [AF] = 0.01,
  [AR] = 0.01,
  [PHI] = 0.01,
  [DPHI] = 0.5,
  [SF] = 0.01,
  [SR] = 0.01,
  [GX] = 0.3,
  [GY] = 0.15,
  [BX] = 0.05,
  [BY] = 0.05,
  [BR] = 0.002,
  [LCX] = 0.1,
  [LCF] = 0.1,
  [LCR] = 0.1,
  [LMU] = 0.2,
  [STEER_OFFSET] = 0.002,
  [GAIN] = 0.02,
  [LATE] = 0.01,
  [RAD] = 0.005,
  [LEAN] = 0.05,
  [STATES + CONSIDER_INERTIA] = 0.1,
  [STATES + CONSIDER_CENTRE] = 0.03,
  [STATES + CONSIDER_TRAIL] = 0.03,
  [STATES + CONSIDER_RELAXATION_FRONT] = 0.2,
  [STATES + CONSIDER_RELAXATION_REAR] = 0.2,
  [STATES + CONSIDER_ROLL_STEER] = 0.04 };

/* Change quantity j of the car, or of the state, by e. */
static tse_car off_by(const tse_car *c, tse_real x[TSE_VALUES], int j, double e)
{
  tse_car d = *c;
  if (j < STATES || j == LATE) x[j] += e;
  else if (j == STATES + CONSIDER_INERTIA) { /* I (1 + e) */ d.jf /= 1 + e;
    d.jr /= 1 + e;
    d.m_inertia /= 1 + e;
    d.trail /= 1 + e;
  } else if (j == STATES + CONSIDER_CENTRE) {
    d.lf += e;
    d.lr -= e;
    d.jf = d.m_inertia * d.lf, d.jr = d.m_inertia * d.lr;
  } else if (j == STATES + CONSIDER_TRAIL) d.trail += d.m_inertia * e;
  else if (j == STATES + CONSIDER_ROLL_STEER) d.roll_steer += e;
  else d.relaxation += e; /* of both axles */
  return d;
}

/* Compare a slope in units of the state. Tolerance: relative `share`, absolute
 * `least`. */
static void expect_slope(
    double expected, double actual, double scale, double share, double least, const char *what, int index)
{
  expect_near(expected * scale, actual * scale, share * fabs(expected * scale) + least, what, index);
}

/* by_slip: including the columns of longitudinal slip. */
static void expect_slopes(const tse_car *c, int by_slip, double share, double least, uint32_t seed)
{
  tse_short M[MOTION][PLACES], N[MOTION][PLACES];
  tse_real x[TSE_VALUES], H[TSE_SENSORS][PLACES], ignored[TSE_SENSORS][PLACES], z[2][TSE_SENSORS];
  static const double sensor_unit[TSE_SENSORS] = { 0.1, 0.1, 0.003, 0.02, 0.02 };
  for (int n = 0; n < 40; n++) {
    any_state(x, &seed);
    const steering u = any_steering(&seed);
    tse_real moved[TSE_VALUES];
    /* The motion is as far from steady as in a fast turn. */
    x[AF] = u.from - atan((x[VY] + c->lf * x[YAW]) / x[VX]) + next_between(&seed, -0.01, 0.01);
    x[AR] = -atan((x[VY] - c->lr * x[YAW]) / x[VX]) + next_between(&seed, -0.01, 0.01);
    forces f;
    memcpy(moved, x, sizeof x);
    car_move(c, moved, u, M);
    car_forces(c, x, u, TSE_R(1), &f);
    car_measure(c, x, &f, TSE_R(0), z[0], H);
    for (int j = 0; j < COLUMNS; j++) {
      if (!by_slip && (j == SF || j == SR || j == LCX))
        continue; /* load depends on the longitudinal force: its effect on lateral forces is neglected */
      const int length = j == STATES + CONSIDER_RELAXATION_FRONT || j == STATES + CONSIDER_RELAXATION_REAR;
      tse_real end[2][TSE_VALUES];
      const double e = 1e-4 * unit[j];
      for (int k = 0; k < 2; k++) {
        tse_real start[TSE_VALUES];
        memcpy(end[k], x, sizeof x);
        const tse_car d = off_by(c, end[k], j, k ? e : -e);
        memcpy(start, end[k], sizeof start);
        car_move(&d, end[k], u, N);
        car_forces(&d, start, u, TSE_R(1), &f);
        car_measure(&d, start, &f, TSE_R(0), z[k], ignored);
      }
      for (int i = 0; i < MOTION; i++) {
        /* The grip is not learnt from longitudinal forces: its slope is set to zero on
         * purpose. A small part of it turns with the wheels. */
        if (j == LMU && i == VX) continue;
        const double slope = (end[1][i] - end[0][i]) / (2 * e),
                     found = length
            ? M[i][STATES + CONSIDER_RELAXATION_FRONT] + M[i][STATES + CONSIDER_RELAXATION_REAR]
            : M[i][j];
        expect_slope(slope, found, unit[j] / unit[i], j == LMU ? 5 * share : share,
            j == VX        ? 5 * least
                : j == LMU ? 10 * least
                           : least,
            "slope of the motion, state and column", 100 * i + j);
      }
      for (int a = j == LMU ? 1 : 0; a < TSE_SENSORS; a++)
        expect_slope((z[1][a] - z[0][a]) / (2 * e), length ? 0 : H[a][j], unit[j] / sensor_unit[a],
            j == LMU ? 5 * share : share, j == LMU ? 10 * least : least,
            "slope of a sensor, sensor and column", 100 * a + j);
    }
  }
}

/* Remaining error: the time constant of the slip angle depends on the speed, which slopes
 * neglect. 0.01 units, and for the speed 5 %. */
static void test_slopes_are_those_of_the_car(void)
{
  const tse_car c = some_car(0);
  expect_slopes(&c, 1, 0.01, 0.01, 1);
}

static void test_slopes_of_a_car_with_load_transfer_are_within_a_tenth(void)
{
  const tse_car c = some_car(1);
  expect_slopes(&c, 0, 0.1, 0.1, 2);
}
#endif

/* ------------------------------------------------------------------------------- forces */

static forces forces_at(const tse_car *c, const tse_real x[TSE_VALUES], double steer)
{
  forces f;
  const steering u = { real(steer), real(steer), real(0.01) };
  car_forces(c, x, u, TSE_R(1), &f);
  return f;
}

/* The lateral forces of both axles, in wheel coordinates, act at the trail. Braking in a
 * bend does not change this. */
static void test_the_slope_over_the_trail_is_exact_while_the_car_brakes(void)
{
  const tse_car c = some_car(0);
  tse_car d = c;
  tse_real x[TSE_VALUES] = { [VX] = TSE_R(20) };
  x[AF] = TSE_R(0.04);
  x[AR] = TSE_R(0.03);
  x[SF] = TSE_R(-0.04);
  const forces f = forces_at(&c, x, 0.1);
  d.trail += real(0.1 * number(c.m_inertia));
  const forces g = forces_at(&d, x, 0.1);
  expect_near(10 * (number(g.yaw) - number(f.yaw)), number(f.by_yaw[STATES + CONSIDER_TRAIL]),
      BY_NUMBER(1e-9, 1e-3, 1e-4) * fabs(number(f.by_yaw[STATES + CONSIDER_TRAIL])) + 64 * QUANTUM,
      "slope of the yaw acceleration over the trail", 0);
}

/* With any height of the centre of gravity, both axles keep some load: forces oppose the
 * slip and are finite. */
static void test_load_stays_on_an_axle_however_hard_the_car_brakes(void)
{
  tse_car c = some_car(1);
  tse_real x[TSE_VALUES] = { [VX] = TSE_R(20) };
  c.height_front = c.height_rear = TSE_R(0.3);
  x[AR] = TSE_R(0.03);
  for (int sign = -1; sign <= 1; sign += 2) {
    x[SF] = x[SR] = real(sign * 0.5);
    const forces f = forces_at(&c, x, 0);
    TEST_ASSERT_TRUE(r_is_finite(f.y) && number(f.y) > 0);
    TEST_ASSERT_TRUE(r_is_finite(f.x) && sign * number(f.x) > 0);
  }
}

/* A brush saturates at grip times load, and so does every mixture with the other
 * curve. */
static void test_a_tyre_ends_at_its_grip_times_its_load(void)
{
  static const double shape[3] = { 0, 0.5, 1 };
  for (int k = 0; k < 3; k++) {
    tse_car c = plain_car();
    tse_real x[TSE_VALUES] = { [VX] = TSE_R(20) };
    c.grip = real(0.8), c.shape = real(shape[k]);
    const double end = 0.8 * number(c.load_front);
    x[AF] = real(1e-4);
    expect_near(1e-4 * number(c.ky_front), number(forces_at(&c, x, 0).side),
        1e-3 * 1e-4 * number(c.ky_front) + 64 * QUANTUM, "stiffness at no slip", k);
    const double q = 30;
    x[AF] = real(q * end / number(c.ky_front));
    const double root = q * pow(1 + q * q + pow(q, 4), -0.25), expected = end * (1 + shape[k] * (root - 1));
    expect_near(expected, number(forces_at(&c, x, 0).side), BY_NUMBER(1e-10, 1e-4, 1e-5) * end, "end", k);
    x[AF] = -x[AF];
    expect_near(-expected, number(forces_at(&c, x, 0).side), BY_NUMBER(1e-10, 1e-4, 1e-5) * end,
        "end, to the right", k);
    x[LMU] = real(log(0.5));
    expect_near(-0.5, number(forces_at(&c, x, 0).side) / end, 0.01, "half the grip", k);
    x[AF] = TSE_R(0);
    x[LMU] = TSE_R(0);
    x[SR] = real(-q * 0.8 * number(c.load_rear) / number(c.kx_rear));
    expect_near(-expected * number(c.load_rear) / number(c.load_front), number(forces_at(&c, x, 0).x),
        BY_NUMBER(1e-10, 1e-4, 1e-5) * end, "brakes lock", k);
  }
}

/* Friction 1.0 in front and 1.3 at the rear: 1/friction is 0.884615 (1 +- 0.130435). The
 * estimated grip scales both. */
static void test_each_axle_ends_at_its_own_friction(void)
{
  tse_config s = config_by(tse_config_exact);
  s.tyre_saturation_inverse_friction = setting(0.8846154), s.tyre_saturation_balance = setting(0.1304348);
  const tse_car c = prepared(s).car;
  for (int halved = 0; halved < 2; halved++) {
    tse_real x[TSE_VALUES] = { [VX] = TSE_R(20), [LMU] = real(halved ? log(0.5) : 0) };
    const double left = halved ? 0.5 : 1;
    const double front = left * 1.0 * number(c.load_front), rear = left * 1.3 * number(c.load_rear);
    x[AF] = x[AR] = real(1); /* both slide */
    const forces f = forces_at(&c, x, 0);
    expect_near(front, number(f.side), BY_NUMBER(1e-6, 1e-5, 1e-5) * front,
        "front, to the digits of the settings", halved);
    expect_near(front + rear, number(f.y), BY_NUMBER(1e-6, 1e-5, 1e-5) * (front + rear), "both", halved);
    expect_near(front + rear, number(f.by_y[LMU]), BY_NUMBER(1e-6, 1e-4, 1e-4) * (front + rear),
        "slope over the grip", halved);
    x[AF] = x[AR] = TSE_R(0);
    x[SR] = real(-20 * rear / number(c.kx_rear));
    expect_near(-rear, number(forces_at(&c, x, 0).x), BY_NUMBER(1e-6, 1e-5, 1e-5) * rear,
        "the rear brakes lock", halved);
  }
}

/* The cubic of a brush with parabolic pressure: F = C a (1 - q/3 + q^2/27), flat at its
 * end. */
static void test_a_brush_is_its_cubic(void)
{
  tse_car c = plain_car();
  tse_real x[TSE_VALUES] = { [VX] = TSE_R(20) };
  c.grip = real(0.9), c.shape = TSE_R(0);
  const double end = 0.9 * number(c.load_front), k = number(c.ky_front);
  for (double a = -0.4; a < 0.4; a += 0.0137) {
    const double q = fabs(k * a) / end,
                 expected = q < 3 ? k * a * (1 - q / 3 + q * q / 27)
        : a > 0                   ? end
                                  : -end;
    x[AF] = real(a);
    const forces f = forces_at(&c, x, 0);
    expect_near(expected, number(f.side), BY_NUMBER(1e-12, 1e-5, 1e-6) * end, "side force", (int)(a * 1e4));
    const double slope = q < 3 ? k * (1 - q / 3) * (1 - q / 3) : 0;
    expect_near(slope, number(f.by_y[AF]), BY_NUMBER(1e-11, 1e-4, 1e-5) * k, "its slope", (int)(a * 1e4));
  }
}

/* The other end of the shapes, compared with magic formulas sin(C atan(B a - E (B a -
 * atan(B a)))) of passenger cars' tyres, up to the slip angle at which a linear tyre
 * reaches 1.2 times the grip. The limit is the largest difference on this grid. A root,
 * 1/sqrt(1 + q^2), differs by 0.12. */
static void test_a_tyre_is_within_a_thirteenth_of_magic_formulas(void)
{
  double worst = 0;
  for (double c = 1.25; c < 1.71; c += 0.05) {
    for (double e = -1; e < 0.41; e += 0.1) {
      for (double q = 0.05; q <= 1.2; q += 0.05) {
        const double u = q / c, force = sin(c * atan(u - e * (u - atan(u))));
        tse_real slope;
        worst = fmax(worst, fabs(force / q - number(tyre_secant(real(q), TSE_R(1), &slope))));
      }
    }
  }
  TEST_ASSERT_TRUE(worst > 0.05 && worst < 0.076);
}

/* The secant factor times stiffness and slip is the force of car_forces(). It is 1
 * without slip at static load. Far beyond the grip, the force is the grip. */
static void test_a_secant_is_force_over_slip(void)
{
  const double tolerance = BY_NUMBER(
      1e-12, 1e-5, 1e-4); /* fixed: relative to a share of 1, with the digits of a slip of 0.02 */
  for (int k = 0; k < 5; k++) {
    static const double angle[5] = { 0.02, -0.05, 0.1, -0.2, 0.35 };
    tse_car c = k & 1 ? some_car(1) : plain_car();
    tse_real x[TSE_VALUES] = { [VX] = TSE_R(20) }, share[3];
    c.grip = real(0.9), c.shape = real(0.25 * k);
    car_secants(&c, x, share);
    for (int i = 0; i < 3; i++) expect_near(1, number(share[i]), tolerance, "at no slip", i);
    x[LCF] = real(0.2);
    x[LCR] = real(-0.1);
    x[AF] = real(angle[k]);
    x[AR] = real(-0.6 * angle[k]);
    car_secants(&c, x, share);
    const forces f = forces_at(&c, x, 0);
    const double front = exp(0.2) * number(c.ky_front) * number(x[AF]),
                 rear = exp(-0.1) * number(c.ky_rear) * number(x[AR]);
    expect_near(number(f.side) / front, number(share[1]), 50 * tolerance, "front", k);
    expect_near((number(f.y) - number(f.side)) / rear, number(share[2]), 50 * tolerance, "rear", k);
    TEST_ASSERT_TRUE(number(share[1]) < 0.97 && number(share[2]) < 0.97);
    x[AF] = x[AR] = TSE_R(0);
    x[SF] = real(0.3 * angle[k]);
    car_secants(&c, x, share);
    if (!(k & 1))
      expect_near(number(forces_at(&c, x, 0).x) / (number(c.kx_front) * number(x[SF])), number(share[0]),
          50 * tolerance, "along", k);
  }
}

/* Return the force of a brush tyre, from the shear stress integrated over its contact. */
static double brush(double rate, double slip, double limit)
{
  const double gone = 1 - fmin(1, fabs(rate * slip) / (3 * limit));
  return copysign(limit * (1 - gone * gone * gone), slip);
}

/* Limit x to +-10 m/s2, as the acceleration that transfers load. */
static double within_ten(double x) { return fmax(-10, fmin(10, x)); }

/* The equations of car.h for loads and stiffness, in double, with constants that differ
 * between the axles. The side force that transfers load is found by bisection. */
static void test_each_axle_has_its_own_load_and_its_own_loss(void)
{
  static const struct {
    double sf, sr, af, ar, side_front, side_rear;
  } cases[] = { { 0.01, 0.02, 0.02, 0.02, 0.002, 0.004 }, { -0.03, -0.01, 0.03, 0.02, 0.001, 0.002 },
    { 0.04, 0, -0.02, -0.03, 0.003, 0.001 }, { -0.3, -0.3, 0.05, 0.04, 0.001, 0.001 },
    { 0, 0, 0.1, 0.1, 0.04, 0.004 }, { 0, 0.01, 0.1, 0.1, 0.004, 0.04 } };
  for (int n = 0; n < ROWS(cases); n++) {
    tse_car c = plain_car();
    tse_real x[TSE_VALUES] = { [VX] = TSE_R(20) };
    const double sf = cases[n].sf, sr = cases[n].sr, af = cases[n].af, ar = cases[n].ar;
    c.grip = real(1.1), c.shape = TSE_R(0), c.compliance = TSE_R(0);
    c.height_front = real(0.03), c.height_rear = real(0.05);
    c.along_front = real(0.01), c.along_rear = real(0.02);
    c.side_front = real(cases[n].side_front), c.side_rear = real(cases[n].side_rear);
    x[SF] = real(sf), x[SR] = real(sr), x[AF] = real(af), x[AR] = real(ar);
    x[LCX] = real(0.2), x[LCF] = real(-0.1), x[LCR] = real(0.15), x[LMU] = real(-0.2);
    const double kxf = exp(0.2) * number(c.kx_front), kxr = exp(0.2) * number(c.kx_rear),
                 drive = within_ten(kxf * sf + kxr * sr);
    const double front = exp(-0.1) * number(c.ky_front) * (1 - 0.01 * drive),
                 rear = exp(0.15) * number(c.ky_rear) * (1 + 0.02 * drive);
    const double free = within_ten(front * af + rear * ar);
    double low = 0, high = fabs(free);
    for (int i = 0; i < 60; i++) {
      const double b = 0.5 * (low + high);
      const double left = 1 - 0.5 * (cases[n].side_front + cases[n].side_rear) * b * b;
      *(b < fabs(free) * left ? &low : &high) = b;
    }
    const double square = low * high, load_front = 1 - 0.03 * drive, load_rear = 1 + 0.05 * drive;
    const double end_front = 1.1 * exp(-0.2) * number(c.end_front) * load_front,
                 end_rear = 1.1 * exp(-0.2) * number(c.end_rear) * load_rear;
    const double along_front = brush(kxf * load_front, sf, end_front),
                 along_rear = brush(kxr * load_rear, sr, end_rear);
    const double across_front = brush(front * fmax(0.1, 1 - cases[n].side_front * square), af, end_front),
                 across_rear = brush(rear * fmax(0.1, 1 - cases[n].side_rear * square), ar, end_rear);
    const forces f = forces_at(&c, x, 0);
    const double close = BY_NUMBER(1e-9, 1e-4, 1e-4);
    expect_near(along_front + along_rear, number(f.x), close * 10, "along", n);
    expect_near(across_front, number(f.side), close * 10, "across, front", n);
    expect_near(across_front + across_rear, number(f.y), close * 10, "across", n);
    expect_near(kxf * load_front * sf + kxr * load_rear * sr, number(f.endless_x), close * 100,
        "along, of linear tyres", n);
    tse_real share[3];
    car_secants(&c, x, share);
    if (sf != 0) expect_near(along_front / (kxf * sf), number(share[0]), close, "secant, along", n);
  }
}

/* Rolling resistance and drag act against the motion, forwards and in reverse. Below 0.5
 * m/s rolling resistance is proportional to the speed. */
static void test_what_slows_a_car_slows_it_forwards_and_in_reverse(void)
{
  static const double speed[] = { -20, -3, -0.5, -0.25, 0, 0.1, 0.25, 0.5, 3, 20 };
  for (int n = 0; n < ROWS(speed); n++) {
    tse_car c = plain_car();
    const double v = speed[n], rolling = fabs(v) < 0.5 ? 0.15 * v / 0.5 : copysign(0.15, v);
    tse_real x[TSE_VALUES] = { [VX] = real(v) };
    c.rolling = real(0.15), c.drag = real(0.0005);
    const forces f = forces_at(&c, x, 0);
    expect_near(
        -rolling - copysign(0.0005 * v * v, v), number(f.x), BY_NUMBER(1e-12, 1e-6, 1e-7), "force", n);
    expect_near(-2 * 0.0005 * fabs(v), number(f.by_x[VX]), BY_NUMBER(1e-12, 1e-6, 1e-7), "its slope", n);
  }
}

/* The side force of the front axle turns its wheels back, by the compliance. */
static void test_a_compliant_steering_gives_way_to_the_side_force(void)
{
  tse_car c = plain_car();
  tse_real x[TSE_VALUES] = { [VX] = TSE_R(20), [AF] = real(0.03) };
  c.compliance = real(0.004);
  const forces f = forces_at(&c, x, 0.05);
  TEST_ASSERT_TRUE(number(f.side) > 1);
  expect_near(sin(0.05 - 0.004 * number(f.side)), number(f.sin_d), BY_NUMBER(1e-12, 1e-6, 1e-7), "sine", 0);
}

/* Below 1 m/s the divisor of a slip angle is constant: the slip angle does not depend on
 * the speed. */
static void test_below_walking_pace_a_slip_angle_does_not_depend_on_the_speed(void)
{
  static const double speed[] = { 0.5, -0.5, -5, 5 };
  for (int n = 0; n < ROWS(speed); n++) {
    tse_car c = plain_car();
    tse_short M[MOTION][PLACES];
    tse_real x[TSE_VALUES] = { [VX] = real(speed[n]), [VY] = real(0.3) };
    const steering u = { TSE_R(0), TSE_R(0), real(0.01) };
    c.ky_front = c.ky_rear = TSE_R(0), c.relaxation = real(0.1);
    car_move(&c, x, u, M);
    const double slope = number(r_long_scaled(M[AF][VX], ROW_UP));
    if (speed[n] < 1) expect_near(0, slope, 0, "slope over the speed", n);
    else TEST_ASSERT_TRUE(slope > 1e-3);
  }
}

/* Left and right turns are mirror images: no term depends on the side. */
static void test_left_is_the_mirror_of_right(void)
{
  static const int sides[] = { VY, YAW, AF, AR, PHI, DPHI, GY, BY, BR, STEER_OFFSET };
  tse_car c = some_car(1);
  c.lever_y = c.mount_sin = c.pull_front = c.pull_rear = TSE_R(0); /* these depend on the side */
  uint32_t seed = 3;
  for (int n = 0; n < 30; n++) {
    tse_short M[MOTION][PLACES], N[MOTION][PLACES];
    tse_real x[TSE_VALUES], y[TSE_VALUES], z[TSE_SENSORS], w[TSE_SENSORS], H[TSE_SENSORS][PLACES];
    forces f, g;
    any_state(x, &seed);
    memcpy(y, x, sizeof x);
    for (int i = 0; i < ROWS(sides); i++) y[sides[i]] = -y[sides[i]];
    const steering u = any_steering(&seed), v = { -u.from, -u.to, u.dt };
    car_move(&c, x, u, M);
    car_move(&c, y, v, N);
    car_forces(&c, x, u, TSE_R(1), &f);
    car_forces(&c, y, v, TSE_R(1), &g);
    car_measure(&c, x, &f, TSE_R(0), z, H);
    car_measure(&c, y, &g, TSE_R(0), w, H);
    for (int i = 0; i < ROWS(sides); i++) y[sides[i]] = -y[sides[i]];
    /* Angles become turns in 0 .. 1: their mirror images are rounded differently. */
    for (int i = 0; i < MOTION; i++)
      expect_near(number(x[i]), number(y[i]), BY_NUMBER(1e-12, 2e-5, 1e-6), "motion", i);
    for (int a = 0; a < TSE_SENSORS; a++) {
      const double mirrored = a == 1 || a == 2 ? -number(w[a]) : number(w[a]);
      expect_near(number(z[a]), mirrored, BY_NUMBER(1e-12, 1e-4, 1e-6), "sensor", a);
    }
  }
}

/* ------------------------------------------------------------------------------- motion */

static void advance(const tse_car *c, tse_real x[TSE_VALUES], double from, double to, double dt)
{
  tse_short M[MOTION][PLACES];
  const steering u = { real(from), real(to), real(dt) };
  car_move(c, x, u, M);
}

/* v delta = r (L + K v^2), K = (m/L)(lr/C_f - lf/C_r), in every book on vehicle dynamics.
 * Small angles: 1 %. */
static void test_a_steady_turn_obeys_the_understeer_equation(void)
{
  for (double speed = 8; speed < 40; speed += 8.5) {
    const tse_car c = plain_car();
    const double lf = number(c.lf), lr = number(c.lr), kf = number(c.ky_front), kr = number(c.ky_rear),
                 span = lf + lr;
    const double understeer = (lr / kf - lf / kr) / span,
                 steer = 1.2 * (span + understeer * speed * speed) / (speed * speed);
    tse_real x[TSE_VALUES] = { 0 };
    for (int k = 0; k < 800; k++) {
      x[VX] = real(speed); /* the driver holds the speed */
      advance(&c, x, k < 100 ? steer * k / 100 : steer, k < 100 ? steer * (k + 1) / 100 : steer, 0.01);
    }
    const double r = speed * steer / (span + understeer * speed * speed);
    expect_near(r, number(x[YAW]), 0.01 * r, "yaw rate", (int)speed);
    expect_near(
        lr / span * speed * r / kf, number(x[AF]), 0.01 * speed * r / kf, "slip angle, front", (int)speed);
    expect_near(
        lf / span * speed * r / kr, number(x[AR]), 0.01 * speed * r / kr, "slip angle, rear", (int)speed);
    expect_near(lr * r - speed * number(x[AR]), number(x[VY]), 0.01 * fabs(speed * number(x[AR])) + 0.001,
        "lateral velocity", (int)speed);
    const forces f = forces_at(&c, x, steer);
    expect_near(speed * r, number(f.y), 0.01 * speed * r, "lateral acceleration", (int)speed);
    expect_near(0, number(f.yaw), 1e-3, "no yaw acceleration", (int)speed);
  }
}

/* Straight without torque: v' = -k v^2 gives v/(1 + k v t). Rolling resistance and slope
 * subtract their accelerations. */
static void test_a_car_that_coasts_loses_what_drag_and_road_take(void)
{
  tse_car c = plain_car();
  tse_real x[TSE_VALUES] = { [VX] = TSE_R(40) };
  c.drag = real(0.5 / 1500);
  for (int k = 0; k < 2000; k++) advance(&c, x, 0, 0, 0.01);
  const double v = 40 / (1 + 0.5 / 1500 * 40 * 20);
  expect_near(v, number(x[VX]), 5e-4 * v, "speed after 20 s", 0);
  for (int i = VY; i < GX; i++) expect_near(0, number(x[i]), 0, "nothing sideways", i);
  c.drag = TSE_R(0), c.rolling = real(0.1);
  x[VX] = TSE_R(40);
  x[GX] = real(0.3);
  for (int k = 0; k < 1000; k++) advance(&c, x, 0, 0, 0.01);
  expect_near(36, number(x[VX]), BY_NUMBER(1e-9, 1e-2, 1e-5), "uphill", 0);
}

/* Without torque, tyres only remove energy from a slide. */
static void test_sliding_sideways_gives_energy_away(void)
{
  const tse_car c = plain_car();
  tse_real x[TSE_VALUES] = { [VX] = TSE_R(20) };
  x[VY] = TSE_R(2);
  x[YAW] = real(-0.3);
  double before = 1e9;
  for (int k = 0; k < 400; k++) {
    const double energy = pow(number(x[VX]), 2) + pow(number(x[VY]), 2)
        + pow(number(x[YAW]), 2) / number(c.m_inertia);
    TEST_ASSERT_TRUE(k < 10
        || energy < before * (1 + BY_NUMBER(1e-6, 1e-5, 1e-6))); /* slip angles lag while they build up */
    before = energy;
    advance(&c, x, 0, 0, 0.01);
  }
  TEST_ASSERT_TRUE(before < 402);
  expect_near(0, number(x[VY]), 1e-3, "vel_y", 0);
  expect_near(0, number(x[YAW]), 1e-3, "yaw rate", 0);
}

/* Turned wheels on a car without lateral motion: a first-order response over the
 * relaxation length, for any time step. */
static void test_slip_angles_build_up_over_the_relaxation_length(void)
{
  static const double dt[3] = { 0.004, 0.01, 0.05 };
  for (int k = 0; k < 3; k++) {
    tse_car c = plain_car();
    tse_real x[TSE_VALUES] = { [VX] = TSE_R(10) };
    c.relaxation = real(0.6);
    c.ky_front = c.ky_rear = TSE_R(0); /* no force: the car does not move */
    for (double t = dt[k]; t < 0.3; t += dt[k]) {
      advance(&c, x, 0.02, 0.02, dt[k]);
      expect_near(0.02 * (1 - exp(-10 * t / 0.6)), number(x[AF]), BY_NUMBER(1e-10, 1e-6, 1e-7), "slip angle",
          (int)(1000 * t));
      expect_near(0, number(x[AR]), 0, "rear", 0);
    }
  }
}

/* A spring-damper: in steady state the roll angle is gain times acceleration. Free, it
 * oscillates at its frequency and decays. */
static void test_the_body_rolls_as_a_spring_and_a_damper(void)
{
  tse_car c = plain_car();
  tse_real x[TSE_VALUES] = { [VX] = TSE_R(20) };
  c.roll_gain = real(0.006), c.roll_omega = real(2 * pi * 1.5), c.roll_damping = real(0.2);
  c.ky_front = c.ky_rear = TSE_R(0);
  x[PHI] = real(0.05);
  const double w = 2 * pi * 1.5, own = w * sqrt(1 - 0.04);
  for (int k = 1; k <= 200; k++) {
    advance(&c, x, 0, 0, 0.005);
    const double t = 0.005 * k,
                 expected = 0.05 * exp(-0.2 * w * t) * (cos(own * t) + 0.2 * w / own * sin(own * t));
    expect_near(expected, number(x[PHI]), 0.002, "roll angle: half a substep of the swing", k);
  }
}

#if defined(TSE_REAL_DOUBLE)
/* The end of a lane change in rows of dt, each one substep, without body roll. */
static void change_lane(double relaxation, double speed, double dt, double end[MOTION])
{
  tse_car c = some_car(0);
  tse_real x[TSE_VALUES] = { [VX] = speed };
  const int rows = (int)(0.8 / dt + 0.5);
  c.roll_gain = 0, c.relaxation = relaxation;
  x[SF] = 0.002;
  for (int k = 0; k < rows; k++)
    advance(&c, x, 0.6 / speed * sin(8 * dt * k), 0.6 / speed * sin(8 * dt * (k + 1)), dt);
  for (int i = 0; i < MOTION; i++) end[i] = x[i];
}

/* Speeds, yaw rate and slip angles: half the time step gives nearly a quarter of the
 * error (a method of first order: half of it). With a short relaxation length, where slip
 * angles settle within a row, only the size of the error is limited. */
static void test_the_error_of_a_row_is_of_second_order(void)
{
  static const double speeds[] = { 8, 15, 30 };
  for (int k = 0; k < 2 * ROWS(speeds); k++) {
    double exact[MOTION], end[MOTION], off[2] = { 0, 0 };
    const double relaxation = k % 2 ? 0.05 : 0.4, speed = speeds[k / 2];
    change_lane(relaxation, speed, 1.0 / 4000, exact);
    for (int n = 0; n < 2; n++) {
      change_lane(relaxation, speed, n ? 0.005 : 0.01, end);
      for (int i = 0; i <= AR; i++) off[n] += pow((end[i] - exact[i]) / unit[i], 2);
    }
    TEST_ASSERT_TRUE(sqrt(off[0]) < (k % 2 ? 0.08 : 0.04)); /* in the units of the slopes' test */
    if (k % 2 == 0) TEST_ASSERT_TRUE(off[0] > 3.4 * 3.4 * off[1]);
  }
}
#endif

static void test_parameters_do_not_move(void)
{
  const tse_car c = some_car(1);
  tse_real x[TSE_VALUES], before[TSE_VALUES];
  uint32_t seed = 8;
  any_state(x, &seed);
  memcpy(before, x, sizeof x);
  for (int k = 0; k < 50; k++) advance(&c, x, 0.01, -0.01, 0.02);
  for (int i = MOTION; i < STATES; i++) TEST_ASSERT_EQUAL_MEMORY(&before[i], &x[i], sizeof x[i]);
}

/* A longer row costs no more: a thousand rows of an hour take less than a second. */
static void test_a_long_row_takes_no_more_substeps_than_there_are(void)
{
  const tse_car c = some_car(0);
  tse_real x[TSE_VALUES];
  uint32_t seed = 9;
  const clock_t began = clock();
  for (int n = 0; n < 1000; n++) {
    any_state(x, &seed);
    advance(&c, x, 0, 0, 3600);
  }
  TEST_ASSERT_TRUE((double)(clock() - began) / CLOCKS_PER_SEC
      < 10); /* with sanitizers a tenth of it; unlimited substeps would take much longer */
}

/* ------------------------------------------------------------------------------- sensors */

static void test_sensors_read_what_textbooks_say(void)
{
  tse_car c = plain_car();
  tse_real x[TSE_VALUES] = { [VX] = TSE_R(20) }, z[TSE_SENSORS], H[TSE_SENSORS][PLACES];
  x[VY] = real(-0.4);
  x[YAW] = real(0.3);
  x[AF] = real(0.02);
  x[AR] = real(0.03);
  x[SF] = real(0.01);
  x[SR] = real(-0.005);
  x[BX] = real(0.2);
  x[BR] = real(-0.01);
  x[RAD] = real(0.004);
  const forces f = forces_at(&c, x, 0.05);
  car_measure(&c, x, &f, TSE_R(0), z, H);
  const double side = 0.02 * number(c.ky_front), drive = 0.01 * number(c.kx_front);
  const double tight = BY_NUMBER(2e-3, 2e-3, 2e-3); /* "no saturation" is at 50 loads */
  expect_near(drive * cos(0.05) - side * sin(0.05) - 0.005 * number(c.kx_rear) + 0.2, number(z[0]), 0.05,
      "accel_x", 0);
  expect_near(
      side * cos(0.05) + drive * sin(0.05) + 0.03 * number(c.ky_rear), number(z[1]), 0.05, "accel_y", 0);
  expect_near(0.29, number(z[2]), 1e-6, "yaw_rate", 0);
  tse_car scaled = c;
  scaled.scale_r = real(1.25);
  tse_real read[TSE_SENSORS];
  car_measure(&scaled, x, &f, TSE_R(0), read, H);
  expect_near(1.25 * 0.3 - 0.01, number(read[2]), 1e-6, "yaw_rate of a gyro with a scale", 0);
  expect_near(1.25, number(H[YAW_RATE][YAW]), 1e-6, "its slope", 0);
  const double along = 20 * cos(0.05) + (-0.4 + number(c.lf) * 0.3) * sin(0.05);
  expect_near(along * 1.01 * 1.004, number(z[3]), tight, "wheel speed, front", 0);
  expect_near(20 * 0.995, number(z[4]), tight, "wheel speed, rear", 0);
  /* Load moves to the rear: m h a over the wheelbase, of m g lr/L in front and m g lf/L
   * at the rear. The radius changes by 0.5 % for all of the load. */
  tse_car high = c;
  high.height_front = real(0.6 / (9.81 * number(c.lr))), high.height_rear = real(0.6 / (9.81 * number(c.lf)));
  tse_real loaded[TSE_SENSORS];
  car_measure(&high, x, &f, TSE_R(0), loaded, H);
  const double share = 0.005 * 0.6 * number(f.x) / 9.81;
  TEST_ASSERT_TRUE(fabs(share) > 1e-4);
  expect_near(
      number(z[3]) * (1 - share / number(c.lr)), number(loaded[3]), 1e-5, "wheel speed, front, loaded", 0);
  expect_near(
      number(z[4]) * (1 + share / number(c.lf)), number(loaded[4]), 1e-5, "wheel speed, rear, loaded", 0);
  c.lever_x = real(0.5), c.lever_y = real(0.25);
  tse_real there[TSE_SENSORS];
  car_measure(&c, x, &f, TSE_R(0), there, H);
  expect_near(number(z[0]) - 0.5 * 0.09 - 0.25 * number(f.yaw), number(there[0]), 1e-4,
      "accel_x, away from the centre of gravity", 0);
  expect_near(number(z[1]) + 0.5 * number(f.yaw) - 0.25 * 0.09, number(there[1]), 1e-4,
      "accel_y, away from the centre of gravity", 0);
}

/* A pitched IMU reads its share of gravity, of the pitch that follows the acceleration.
 * The rear wheel turns faster while load shrinks it. */
static void test_pitch_and_load_are_in_the_slopes_of_the_sensors(void)
{
  tse_car c = plain_car();
  tse_real x[TSE_VALUES] = { [VX] = TSE_R(20), [SR] = real(0.01) };
  tse_real z[2][TSE_SENSORS], H[2][TSE_SENSORS][PLACES];
  const forces f = forces_at(&c, x, 0.02);
  car_measure(&c, x, &f, TSE_R(0), z[0], H[0]);
  c.pitch_leak = real(0.25), c.height_front = real(0.04), c.height_rear = real(0.06);
  car_measure(&c, x, &f, real(0.3), z[1], H[1]);
  const double close = BY_NUMBER(1e-11, 1e-5, 1e-6);
  expect_near(number(z[0][ACCEL_X]) + 0.3, number(z[1][ACCEL_X]), close, "accel_x", 0);
  for (int j = 0; j < STATES; j++) {
    if (j == BX) continue;
    expect_near(1.25 * number(H[0][ACCEL_X][j]), number(H[1][ACCEL_X][j]),
        close * (1 + fabs(number(H[0][ACCEL_X][j]))), "slope of accel_x", j);
    expect_near(20 * 0.005 * 0.06 * number(f.by_x[j]),
        number(H[1][WHEEL_REAR][j]) - number(H[0][WHEEL_REAR][j]), close * (1 + fabs(number(f.by_x[j]))),
        "slope of the rear wheel", j);
  }
}

/* Any car and state of this filter give finite results. */
static void test_any_state_makes_numbers(void)
{
  /* five times as stiff */
  static const double most[TSE_VALUES] = { [VX] = 200,
    [VY] = 60,
    [YAW] = 20,
    [AF] = 1.5,
    [AR] = 1.5,
    [PHI] = 0.5,
    [DPHI] = 10,
    [SF] = 10,
    [SR] = 10,
    [GX] = 5,
    [GY] = 5,
    [BX] = 50,
    [BY] = 50,
    [BR] = 6,
    [LCX] = 1.6,
    [LCF] = 1.6,
    [LCR] = 1.6,
    [LMU] = 4,
    [STEER_OFFSET] = 0.2,
    [GAIN] = 0.5,
    [LATE] = 0.2,
    [RAD] = 0.2,
    [LEAN] = 0.9 };
  static const double dt[] = { 1e-4, 0.01, 0.05, HAS_SLIP ? 0.25 : 0.125 }; /* a longer row is a gap */
  uint32_t seed = 9;
  for (int load = 0; load < 2; load++)
    for (int n = 0; n < 400; n++) {
      const tse_car c = some_car(load);
      tse_short M[MOTION][PLACES];
      tse_real x[TSE_VALUES], z[TSE_SENSORS], H[TSE_SENSORS][PLACES];
      forces f;
      for (int i = 0; i < TSE_VALUES; i++)
        x[i] = real(most[i] * (n % 3 ? next_between(&seed, -1, 1) : next_uniform(&seed) < 0.5 ? -1 : 1));
      const steering u = { real(next_between(&seed, -1.2, 1.2)), real(next_between(&seed, -1.2, 1.2)),
        real(dt[n % 4]) };
      car_move(&c, x, u, M);
      car_forces(&c, x, u, TSE_R(1), &f);
      car_measure(&c, x, &f, TSE_R(0), z, H);
      for (int i = 0; i < MOTION; i++) {
        TEST_ASSERT_TRUE(r_is_finite(x[i]));
        for (int j = 0; j < COLUMNS; j++) TEST_ASSERT_TRUE(r_is_finite(r_long(M[i][j])));
      }
      for (int a = 0; a < TSE_SENSORS; a++) {
        TEST_ASSERT_TRUE(r_is_finite(z[a]));
        for (int j = 0; j < COLUMNS; j++) TEST_ASSERT_TRUE(r_is_finite(H[a][j]));
      }
    }
}
