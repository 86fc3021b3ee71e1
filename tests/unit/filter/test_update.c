/* tests/unit/filter/test_update.c <-> src/filter/update.c, scalar.c, faults.c: a row
 * against a dense Schmidt-Kalman filter in double. Its covariance is that of the state
 * and the consider parameters, whose gains are 0 (Schmidt 1966), by Joseph's form. */
#include "filter/events.h"
#include "filter/scalar.h"
#include "filter/update.h"
#include "filter_support.h"

enum { ALL = STATES + TSE_CONSIDERED, ROOM = STATES + TSE_UNCERTAIN_ALL };

typedef struct schmidt {
  double p[ALL][ALL], x[STATES];
} schmidt;

/* Dense covariance of the filter: U D U', considered parameters with variance 1, and
 * their covariance with the state. */
static schmidt schmidt_of(const tse_kalman *k)
{
  schmidt s = { 0 };
  const dense own = dense_of(&k->ud);
  for (int i = 0; i < STATES; i++) {
    s.x[i] = number(k->x[i]) / number(state_unit[i]);
    for (int j = 0; j < STATES; j++) {
      s.p[i][j] = own.p[i][j];
      for (int q = 0; q < TSE_CONSIDERED; q++)
        s.p[i][j] += number_of(k->consider[q][i]) * number_of(k->consider[q][j]);
    }
    for (int q = 0; q < TSE_CONSIDERED; q++)
      s.p[i][STATES + q] = s.p[STATES + q][i] = number_of(k->consider[q][i]);
  }
  for (int q = 0; q < TSE_CONSIDERED; q++) s.p[STATES + q][STATES + q] = 1;
  return s;
}

/* h P h' over state and considered parameters. */
static double spread_of(const schmidt *s, const double h[ALL], double ph[ALL])
{
  double sum = 0;
  for (int i = 0; i < ALL; i++) {
    ph[i] = 0;
    for (int j = 0; j < ALL; j++) ph[i] += s->p[i][j] * h[j];
  }
  for (int i = 0; i < ALL; i++) sum += h[i] * ph[i];
  return sum;
}

static void use_one(schmidt *s, const double h[ALL], double e, double r)
{
  double ph[ALL], gain[ALL], A[ALL][ALL];
  const double all = spread_of(s, h, ph) + r;
  for (int i = 0; i < ALL; i++) gain[i] = i < STATES ? ph[i] / all : 0;
  for (int i = 0; i < ALL; i++)
    for (int j = 0; j < ALL; j++) A[i][j] = (i == j) - gain[i] * h[j];
  conjugate(ALL, A[0], s->p[0], s->p[0]);
  for (int i = 0; i < ALL; i++)
    for (int j = 0; j < ALL; j++) s->p[i][j] += gain[i] * r * gain[j];
  for (int i = 0; i < STATES; i++) s->x[i] += gain[i] * e;
}

/* A car with many uncertain parameters, in a turn. */
static tse_params a_car(int told)
{
  tse_config c = config_by(tse_config_exact);
  c.grip = setting(1), c.grip_sd = setting(0.2), c.relaxation_length = setting(0.4);
  c.body_roll_gain = setting(0.005), c.steer_offset_sd = setting(0.004), c.steer_ratio_sd = setting(0.03);
  c.wheel_radius_sd = setting(0.004), c.lean_sd = setting(0.05);
  if (!told) {
    c.yaw_inertia_sd = setting(0.1), c.cg_sd = setting(0.03), c.trail_sd = setting(0.02);
    c.relaxation_sd = setting(0.2), c.roll_steer_sd = setting(0.04), c.accel_y_scale_sd = setting(0.03);
    c.gyro_scale_sd = setting(0.01), c.wheel_delay_sd = setting(0.01), c.accel_delay_sd = setting(0.003);
  }
  if (told) c.steer_lag_sd = setting(0);
  return prepared(c);
}

static void in_a_turn(const tse_params *p, tse_kalman *k, uint32_t *seed)
{
  memset(k, 0, sizeof *k);
  any_covariance(&k->ud, seed);
  for (int i = 0; i < STATES; i++)
    k->x[i] = real(number(p->prior[i]) + 0.3 * number(state_unit[i]) * next_between(seed, -1, 1));
  k->x[VX] = real(next_between(seed, 15, 25));
  k->x[YAW] = real(0.2), k->x[AF] = real(0.02), k->x[AR] = real(0.02), k->before[0] = real(0.1);
  k->before[1] = real(3), k->before[2] = k->x[VX];
  for (int c = 0; c < TSE_SENSORS; c++) k->noise[c] = k->usual[c] = TSE_R(1);
  for (int q = 0; q < TSE_CONSIDERED; q++)
    for (int i = 0; i < STATES; i++)
      if (p->uncertain[q] > TSE_R(0)) k->consider[q][i] = short_of(next_between(seed, -0.2, 0.2));
}

/* Read values near the predicted ones, with slopes for all. Returned: row of H of a
 * channel */
static void a_row(const tse_params *p, const tse_kalman *k, steering u, decoded *z,
    double h[TSE_SENSORS][ROOM], double read[TSE_SENSORS], uint32_t *seed)
{
  forces f;
  tse_real at[TSE_SENSORS], H[TSE_SENSORS][PLACES];
  car_forces(&p->car, k->x, u, TSE_R(1), &f);
  car_measure(&p->car, k->x, &f, TSE_R(0), at, H);
  weaken(H, TSE_SENSORS, k);
  memset(z, 0, sizeof *z);
  z->dt = u.dt, z->steer = u.to, z->has_steer = 1, z->used = 3;
  for (int a = 0; a < TSE_SENSORS; a++) {
    z->use[a] = 1;
    read[a] = number(at[a]);
    z->z[a] = real(read[a] + number(p->sensor_sd[a]) * next_between(seed, -1, 1));
    for (int i = 0; i < STATES; i++) h[a][i] = number(H[a][i]) * number(state_unit[i]);
    for (int q = 0; q < TSE_CONSIDERED; q++)
      h[a][STATES + q] = q < COLUMNS - STATES ? number(H[a][STATES + q]) * number(p->uncertain[q]) : 0;
  }
  const double dt = number(u.dt), late = number(p->uncertain[CONSIDER_ACCEL_LATE]),
               wheels = number(p->uncertain[CONSIDER_WHEELS_LATE]);
  h[0][STATES + CONSIDER_ACCEL_LATE] -= late * (number(f.x) - number(k->before[0])) / dt;
  h[1][STATES + CONSIDER_ACCEL_LATE] -= late * (number(f.y) - number(k->before[1])) / dt;
  h[1][STATES + CONSIDER_SCALE] += number(p->uncertain[CONSIDER_SCALE]) * number(f.y);
  h[2][STATES + CONSIDER_GYRO] += number(p->uncertain[CONSIDER_GYRO]) * number(k->x[YAW]);
  for (int a = 3; a < 5; a++)
    h[a][STATES + CONSIDER_WHEELS_LATE] -= wheels * (number(k->x[VX]) - number(k->before[2])) / dt;
}

/* The row of the tests below, and a car in a turn before it. */
static decoded z;
static double h[TSE_SENSORS][ROOM], read[TSE_SENSORS];

static steering turned(void) { return (steering){ real(0.02), real(0.021), real(0.01) }; }

static void before_a_row(const tse_params *p, tse_kalman *k, uint32_t seed)
{
  in_a_turn(p, k, &seed);
  a_row(p, k, turned(), &z, h, read, &seed);
}

/* Number of channels that the last row has measured. */
static int used(const tse_kalman *k)
{
  int n = 0;
  for (int c = 0; c < TSE_SENSORS; c++) n += k->innovation_var[c] > TSE_R(0);
  return n;
}

/* Measure that the axle rolls freely, with slopes at the state after the sensors. A large
 * innovation has a smaller gain. */
static void use_rolling(schmidt *s, const tse_params *p, int32_t rolls)
{
  const int at = !HAS_SLIP ? 0 : rolls == ROLLS_REAR ? SR : SF;
  double slope[ALL] = { 0 }, ph[ALL];
  slope[at] = number(state_unit[at]);
  const double e = -number(rolls == ROLLS_REAR ? p->car.free_rear : p->car.free_front) - slope[at] * s->x[at];
  use_one(s, slope, e, fmax(pow(number(FREE_SLIP_SD), 2), e * e / number(TAIL) - spread_of(s, slope, ph)));
}

/* Exact arithmetic does not depend on the order of the channels. Here it is that of the
 * filter. The noise is taken from the filter: innovation variance minus the part of state
 * and considered parameters. */
static void expect_schmidt(int told, int32_t rolls, uint32_t seed)
{
  static const int order[TSE_SENSORS] = { 3, 4, 2, 0, 1 };
  const double close = BY_NUMBER(
      1e-9, 1e-3, 1e-4); /* float: slopes of some hundred times covariances of ten */
  for (int n = 0; n < 30; n++) {
    static tse_kalman k;
    const tse_params p = a_car(told);
    double ph[ALL];
    in_a_turn(&p, &k, &seed);
    a_row(&p, &k, turned(), &z, h, read, &seed);
    z.rolls = rolls;
    schmidt s = schmidt_of(&k);
    double start[STATES];
    memcpy(start, s.x, sizeof start);
    update_row(&p, &k, &z, turned());
    TEST_ASSERT_EQUAL_INT(HAS_SLIP ? TSE_SENSORS : 3, used(&k));
    for (int m = 0; m < TSE_SENSORS; m++) {
      const int a = order[m];
      if (!HAS_SLIP && (a == ACCEL_X || a == WHEEL_FRONT)) continue; /* no measurements there */
      double e = number(z.z[a]) - read[a];
      for (int i = 0; i < STATES; i++) e -= h[a][i] * (s.x[i] - start[i]);
      expect_near(e, number(k.innovation[a]), close * (1 + fabs(e)), "innovation", a);
      const double state = spread_of(&s, h[a], ph), r = number(k.innovation_var[a]) - state;
      TEST_ASSERT_TRUE(r > 0);
      use_one(&s, h[a], e, r);
    }
    if (HAS_SLIP && rolls != ROLLS_UNKNOWN) use_rolling(&s, &p, rolls);
    for (int a = HAS_SLIP ? 0 : 1; a < 3; a++) { /* slopes were different: added in sequence */
      const double moved = pow(number(OWN_SHARE) * (s.x[stiffness_at(a)] - start[stiffness_at(a)]), 2);
      expect_near(moved, number(k.moved[a]), close * 10 * (1 + moved), "moved", a);
    }
    const schmidt found = schmidt_of(&k);
    for (int i = 0; i < STATES; i++) {
      expect_near(s.x[i], found.x[i], close * 10, "state", i);
      for (int j = 0; j < ALL; j++)
        expect_near(s.p[i][j], found.p[i][j], close * 10, "covariance", 100 * i + j);
    }
  }
}

static void test_a_row_is_that_of_a_kalman_filter_where_all_is_known(void)
{
  expect_schmidt(1, ROLLS_UNKNOWN, 1);
}

static void test_a_row_is_that_of_a_schmidt_filter_where_much_is_uncertain(void)
{
  expect_schmidt(0, ROLLS_UNKNOWN, 2);
}

static void test_the_axle_that_rolls_is_one_more_measurement_of_that_filter(void)
{
  expect_schmidt(1, ROLLS_FRONT, 3);
  expect_schmidt(1, ROLLS_REAR, 4);
}

/* Uncertain parameters may make the state less accurate than exact ones, never more. */
static void test_doubt_never_makes_anything_surer(void)
{
  for (uint32_t seed = 1; seed < 30; seed++) {
    static tse_kalman k[2];
    for (int told = 0; told < 2; told++) {
      const tse_params p = a_car(told), common = a_car(0);
      uint32_t own = seed;
      in_a_turn(&common, &k[told], &own);
      if (told) memset(k[told].consider, 0, sizeof k[told].consider);
      a_row(&p, &k[told], turned(), &z, h, read, &own);
      update_row(&p, &k[told], &z, turned());
    }
    for (int i = STIFFNESS; i <= LCR; i++) {
      double with = number(ud_variance(&k[0].ud, i));
      for (int q = 0; q < TSE_CONSIDERED; q++) with += pow(number_of(k[0].consider[q][i]), 2);
      TEST_ASSERT_TRUE(with > number(ud_variance(&k[1].ud, i)) * (1 - BY_NUMBER(1e-9, 1e-3, 1e-4)));
    }
  }
}

/* An impossible reading has the same effect as one at the limit, in both directions. */
static void test_a_reading_far_off_pulls_the_less_the_further_off(void)
{
  const tse_params p = a_car(0);
  double before = 0;
  for (int far = 0; far < 4; far++) {
    static tse_kalman k, start;
    before_a_row(&p, &k, 5);
    start = k;
    for (int a = 0; a < TSE_SENSORS; a++) z.use[a] = a == 2;
    z.z[2] = real(read[2] + 10 * pow(2, far)); /* beyond any yaw rate */
    update_row(&p, &k, &z, turned());
    const double moved = fabs(number(k.x[YAW]) - number(start.x[YAW]));
    TEST_ASSERT_TRUE(moved > 0);
    if (far > 0) TEST_ASSERT_TRUE(moved < before);
    before = moved;
    for (int i = 0; i < STATES; i++) TEST_ASSERT_TRUE(r_is_finite(k.x[i]) && k.ud.d[i] > TSE_R(0));
  }
}

static void test_a_missing_channel_is_not_used(void)
{
  tse_params p = a_car(0);
  for (int n = 0; n < 2 * TSE_SENSORS; n++) {
    const int missing = n / 2;
    static tse_kalman k[2];
    p.car.driven = 1 + n % 2; /* if one axle is missing, the other replaces it, whichever is driven */
    for (int i = 0; i < 2; i++) {
      before_a_row(&p, &k[i], 6);
      z.use[missing] = 0;
      z.z[missing] = real(i * 7); /* any value */
      update_row(&p, &k[i], &z, turned());
      TEST_ASSERT_EQUAL_INT(HAS_SLIP                      ? TSE_SENSORS - 1
              : missing == ACCEL_Y || missing == YAW_RATE ? 2
                                                          : 3,
          used(&k[i]));
    }
    TEST_ASSERT_EQUAL_MEMORY(&k[0], &k[1], sizeof k[0]);
  }
}

static void test_the_log_likelihood_is_that_of_the_innovations(void)
{
  const tse_params p = a_car(0);
  static tse_kalman k;
  double sum = 0;
  before_a_row(&p, &k, 7);
  update_row(&p, &k, &z, turned());
  for (int a = 0; a < TSE_SENSORS; a++) {
    const double e = number(k.innovation[a]), var = number(k.innovation_var[a]);
    if (!(var > 0)) continue;
    sum -= 0.5 * (e * e / var + log(2 * 3.14159265358979323846 * var));
  }
  expect_near(sum, number(k.log_likelihood), BY_NUMBER(1e-10, 1e-4, 1e-6), "log likelihood", 0);
}

/* The scalar Kalman filter of a persistent error, in double, over three rows. Without
 * model discrepancy, the innovation variance consists of state and white noise. */
static void test_nis_is_of_the_innovation_without_what_lasts(void)
{
  tse_params p = a_car(0);
  static tse_kalman k;
  double d[IMU_CHANNELS] = { 0 }, var[IMU_CHANNELS] = { 0 };
  p.model_sd = TSE_R(0);
  before_a_row(&p, &k, 7);
  const double keep = exp(-2 * number(z.dt) / number(MODEL_TIME));
  for (int row = 0; row < 3; row++) {
    double white[IMU_CHANNELS];
    for (int a = 0; a < IMU_CHANNELS; a++)
      white[a] = number(k.noise[a]) * number(p.sensor_sd[a]) * number(p.sensor_sd[a]);
    update_row(&p, &k, &z, turned());
    for (int a = 0; a < IMU_CHANNELS; a++) {
      const double state = number(k.innovation_var[a]) - white[a];
      if (!(number(k.innovation_var[a]) > 0)) continue;
      d[a] *= sqrt(keep);
      var[a] = keep * var[a] + (1 - keep) * state;
      const double s = var[a] + white[a], e = number(k.innovation[a]) - d[a];
      expect_near(e * e / s, number(k.nis[a]), BY_NUMBER(1e-6, 1e-3, 2e-2) * (1 + e * e / s), "nis", row);
      d[a] += var[a] / s * e;
      var[a] *= white[a] / s;
    }
  }
}

/* A state beyond the limits of a car is limited in the next row. */
static void test_stiffness_stays_within_its_bounds(void)
{
  const tse_params p = a_car(0);
  for (int side = -1; side <= 1; side += 2) {
    static tse_kalman k;
    before_a_row(&p, &k, 8);
    for (int i = STIFFNESS; i <= LCR; i++) k.x[i] = real(2 * side);
    update_row(&p, &k, &z, turned());
    for (int i = STIFFNESS; i <= LCR; i++) TEST_ASSERT_TRUE(k.x[i] >= p.log_min && k.x[i] <= p.log_max);
  }
}

/* A channel at fault is used again after it has agreed for a while without
 * interruption. */
static void test_a_channel_at_fault_has_to_agree_for_a_while(void)
{
  const tse_params p = a_car(0);
  static tse_kalman k;
  uint32_t seed = 9;
  in_a_turn(&p, &k, &seed);
  k.fault = fault_of(YAW_RATE);
  for (int step = 0; step < 4; step++) { /* agrees; disagrees; agrees again; has agreed for long */
    a_row(&p, &k, turned(), &z, h, read, &seed);
    for (int a = 0; a < TSE_SENSORS; a++) z.use[a] = a == YAW_RATE;
    z.z[YAW_RATE] = real(read[YAW_RATE] + (step == 1 ? 100 : 0));
    if (step == 0) k.agrees_for = r_mul(TSE_R(0.5), SETTLE_TIME);
    if (step == 3) k.agrees_for = SETTLE_TIME;
    update_row(&p, &k, &z, turned());
    if (step == 0) TEST_ASSERT_TRUE(k.agrees_for > r_mul(TSE_R(0.5), SETTLE_TIME));
    if (step == 1) TEST_ASSERT_TRUE(k.agrees_for == TSE_R(0));
    events_decide(&p, &k, TSE_R(0));
    TEST_ASSERT_EQUAL_INT(step < 3 ? fault_of(YAW_RATE) : (int32_t)NO_FAULT, k.fault);
  }
}

/* Excitation is computed for tyres without saturation. With the cubic of a brush at q = 2
 * on both axles it is 1/(1 - 2/3 + 4/27) times as large. A sliding axle at q = 8 counts
 * as q = 3. Nothing is measured, so the state is unchanged. */
static void expect_activity(double q, double left, double counts)
{
  tse_params p = a_car(1);
  static tse_kalman k;
  uint32_t seed = 11;
  const steering u = { TSE_R(0), TSE_R(0), real(0.01) };
  in_a_turn(&p, &k, &seed);
  memset(&z, 0, sizeof z);
  z.dt = u.dt, z.has_steer = z.one_speed = z.no_second = 1;
  p.car.shape = p.car.along_front = p.car.along_rear = p.car.height_front = p.car.height_rear =
      p.car.side_front = p.car.side_rear = TSE_R(0);
  p.car.rolling = p.car.drag = p.car.compliance = p.car.pull_front = p.car.pull_rear = TSE_R(0);
  for (int i = 0; i < STATES; i++) k.x[i] = TSE_R(0);
  k.x[VX] = TSE_R(20), k.x[YAW] = real(0.3);
  k.x[AF] = real(q * number(p.car.grip) * number(p.car.load_front) / number(p.car.ky_front));
  k.x[AR] = real(q * number(p.car.grip) * number(p.car.load_rear) / number(p.car.ky_rear));
  for (int n = 0; n < 2000; n++) update_row(&p, &k, &z, u);
  const double force = q * left * number(p.car.grip) * (number(p.car.load_front) + number(p.car.load_rear));
  const double least = pow(number(MIN_ACTIVITY), 2) + number(TAIL) * pow(number(p.sensor_sd[ACCEL_Y]), 2);
  const double close = BY_NUMBER(1e-6, 2e-3, 1e-4);
  expect_near(pow(force * counts, 2) + least, number(k.activity[ACCEL_Y]), close * pow(force * counts, 2),
      "across [m2/s4]", 0);
  expect_near(
      pow(0.3 * counts, 2) + least / 400, number(k.activity[YAW_RATE]), close, "turning [rad2/s2]", 0);
}

static void test_what_happens_near_the_end_of_tyres_counts_more(void)
{
  const double left = 1 - 2.0 / 3 + 4.0 / 27;
  expect_activity(2, left, 1 / left);
  expect_activity(8, 1.0 / 8, 3);
}

/* At standstill the gyro measures its bias, and nothing else is learnt. */
static void test_at_standstill_the_gyro_teaches_its_bias(void)
{
  const tse_params p = a_car(0);
  static tse_kalman k;
  tse_real variance[STATES], before[STATES];
  memset(&k, 0, sizeof k);
  for (int i = 0; i < STATES; i++) variance[i] = TSE_R(1);
  for (int c = 0; c < TSE_SENSORS; c++) k.noise[c] = k.usual[c] = TSE_R(1);
  ud_set(&k.ud, variance);
  memcpy(before, k.x, sizeof before);
  memset(&z, 0, sizeof z);
  z.dt = real(0.01), z.use[2] = 1, z.z[2] = real(0.004);
  for (int n = 0; n < 200; n++) update_at_standstill(&p, &k, &z);
  expect_near(0.004, number(k.x[BR]), 1e-4, "bias of the gyro", 0);
  for (int i = 0; i < STATES; i++)
    if (i != BR) TEST_ASSERT_EQUAL_MEMORY(&before[i], &k.x[i], sizeof before[i]);
  const double r = pow(number(p.sensor_sd[2]) / number(state_unit[BR]), 2);
  expect_near(r / (200 + r), number(ud_variance(&k.ud, BR)), BY_NUMBER(1e-10, 1e-5, 1e-6), "its variance", 0);
}

/* One speed of the vehicle is not the speed of an axle. Without a steering angle no
 * measurement is possible. In both cases the freely rolling axle is no measurement, and
 * no bit changes. */
static void test_an_axle_that_rolls_freely_says_nothing_with_one_speed_or_without_a_steering_angle(void)
{
  static tse_kalman with, without;
  for (int how = 0; how < 3; how++) /* both known; one speed; no steering angle */
    for (int32_t rolls = ROLLS_FRONT; rolls <= ROLLS_REAR; rolls++) {
      const tse_params p = a_car(1);
      before_a_row(&p, &with, 21);
      without = with;
      z.one_speed = z.no_second = how == 1, z.has_steer = how != 2;
      z.rolls = rolls;
      update_row(&p, &with, &z, turned());
      z.rolls = ROLLS_NONE;
      update_row(&p, &without, &z, turned());
      TEST_ASSERT_EQUAL_INT(how > 0 || !HAS_SLIP, memcmp(&with, &without, sizeof with) == 0);
    }
}

/* The noise of a channel alone, with the front wheels at a large angle. For the sensor it
 * is the estimated noise; for the front wheels that of the mean of two different angles;
 * for the IMU the model error, which lasts a second: fully for the state, a tenth of it
 * for events. */
static void test_what_is_noise_of_a_channel_is_its_sensors_and_what_the_model_lacks(void)
{
  tse_params p = a_car(0);
  const double dt = 0.01, lasts = number(MODEL_TIME), share = dt / (dt + lasts),
               close = BY_NUMBER(1e-12, 2e-6, 2e-6);
  const steering u = { real(0.4), real(0.4), real(dt) };
  p.model_sd = real(0.02);
  for (int a = 0; a < TSE_SENSORS; a++) {
    static tse_kalman k;
    uint32_t seed = 22;
    double ph[ALL];
    forces f;
    in_a_turn(&p, &k, &seed);
    for (int i = 0; i < STATES; i++) k.ud.d[i] = real(1e-3 * number(k.ud.d[i]));
    k.noise[a] = real(1.75);
    a_row(&p, &k, u, &z, h, read, &seed);
    for (int b = 0; b < TSE_SENSORS; b++) z.use[b] = a == b;
    z.rolls = ROLLS_NONE;
    if (!HAS_SLIP && a == ACCEL_X) continue; /* no measurement there */
    car_forces(&p.car, k.x, u, TSE_R(1), &f);
    const schmidt s = schmidt_of(&k);
    const double known = spread_of(&s, h[a], ph), speed = number(k.x[VX]), sd = number(p.sensor_sd[a]);
    const double turn = a == WHEEL_FRONT ? pow(number(TRACK_SHARE) * speed * pow(number(f.sin_d), 2), 2) : 0;
    const double off = number(p.prior_sd[LCX]) * number(k.x[a == WHEEL_FRONT ? SF : SR]);
    const double slip = !HAS_SLIP && a >= WHEEL_FRONT
        ? speed * speed * (pow(number(FREE_SLIP_SD), 2) + off * off)
        : 0;
    update_row(&p, &k, &z, u);
    const double lacks = a < IMU_CHANNELS
        ? pow(number(p.model_sd), 2) * (1 + 2 * lasts / dt) * number(k.activity[a])
        : 0;
    const double white = 1.75 * sd * sd + turn + slip, all = known + white + lacks;
    if (a == WHEEL_FRONT) TEST_ASSERT_TRUE(turn > 0.1 * white);
    if (a < IMU_CHANNELS) TEST_ASSERT_TRUE(lacks > 0.01 * white);
    expect_near(all, number(k.innovation_var[a]), close * (1 + all), "variance", a);
    expect_near(share * share * (known + white + 0.1 * lacks), number(k.slow_var[a]),
        close * (1e-4 + share * share * all), "for events", a);
  }
}

/* Each value occurs three times: two thirds of all readings repeat, and half of those
 * after a repeated one. Both shares are exponential means. A repeated reading counts as
 * much as it is improbable, and less where it agrees. A channel at fault is monitored,
 * but not used. */
static void test_a_reading_that_repeats_says_as_much_as_repeats_are_unlikely(void)
{
  const tse_params p = a_car(1);
  const double sd = number(p.sensor_sd[YAW_RATE]), close = BY_NUMBER(1e-9, 1e-3, 1e-3);
  for (int far = 0; far < 2; far++) {
    static tse_kalman k;
    before_a_row(&p, &k, 23);
    k.fault = fault_of(YAW_RATE), k.seen = real(far ? 1 : 1000);
    const double g = 0.01 / (far ? 2 : number(USUAL_TIME)),
                 q = 1 - g; /* of all readings since the start, later of the last ones */
    for (int a = 0; a < TSE_SENSORS; a++) z.use[a] = a == YAW_RATE;
    z.rolls = ROLLS_NONE;
    for (int value = 0; value < 30; value++) {
      const double all = (g + g * q) * (1 - pow(q, 3 * value)) / (1 - pow(q, 3)),
                   again = g * (1 - pow(q, 2 * value)) / (1 - q * q);
      z.z[YAW_RATE] = real(read[YAW_RATE] + (value % 2 ? 1 : -1) * (far ? 3 : 0.4) * sd * (1 + 0.01 * value));
      const double off = (number(z.z[YAW_RATE]) - read[YAW_RATE]) / sd, counts = fmin(off * off, 1);
      const double likely[3] = { 1, fmax(fmax(all, again) * q, 0.05),
        fmax(fmax(all * q * q + g, again * q), 0.05) };
      double said = 0;
      for (int n = 0; n < 3; n++) {
        update_row(&p, &k, &z, turned());
        said -= counts * log2(likely[n]);
        expect_near(said, number(k.frozen[YAW_RATE]), close, "evidence", 10 * value + n);
      }
      expect_near(all * pow(q, 3) + g * q + g, number(k.repeats[YAW_RATE]), close * 0.1, "repeat", value);
      expect_near(again * q * q + g, number(k.repeats_again[YAW_RATE]), close * 0.1, "repeat again", value);
    }
  }
}

/* A gyro that turns while the wheels stand, one that is faulty, and one that is missing
 * say nothing about its bias. Within 3 sd of both variances it does. */
static void test_at_standstill_only_a_gyro_that_may_stand_teaches_its_bias(void)
{
  for (int n = 0; n < 4; n++) {
    const tse_params p = a_car(0);
    static tse_kalman k;
    tse_real variance[STATES];
    memset(&k, 0, sizeof k);
    for (int i = 0; i < STATES; i++) variance[i] = TSE_R(1);
    for (int c = 0; c < TSE_SENSORS; c++) k.noise[c] = k.usual[c] = TSE_R(1);
    ud_set(&k.ud, variance);
    variance[BR] = real(pow(4 * number(p.sensor_sd[YAW_RATE]) / number(state_unit[BR]), 2));
    ud_set(&k.ud, variance);
    memset(&z, 0, sizeof z);
    const double sd = hypot(4, 1) * number(p.sensor_sd[YAW_RATE]);
    z.dt = real(0.01), z.use[YAW_RATE] = n != 2, z.z[YAW_RATE] = real((n == 3 ? 3.1 : 2.9) * sd);
    if (n == 1) k.fault = fault_of(YAW_RATE);
    update_at_standstill(&p, &k, &z);
    TEST_ASSERT_EQUAL_INT(n == 0, number(k.x[BR]) > 0);
  }
}

/* Without a second speed accel_x is an input, and one wheel speed measures: that of the
 * undriven axle; of the rear one if the driven axle is unknown, or of the other if it is
 * missing. Its variance has a part due to the slip, whose error is that of its force over
 * the stiffness, and no slope over slips. */
static void test_without_a_second_speed_one_wheel_measures_the_speed(void)
{
  static const struct {
    int driven, missing, axle;
  } cases[] = { { 0, -1, WHEEL_REAR }, { 1, -1, WHEEL_REAR }, { 2, -1, WHEEL_FRONT },
    { 2, WHEEL_FRONT, WHEEL_REAR }, { 1, WHEEL_REAR, WHEEL_FRONT }, { 0, WHEEL_REAR, WHEEL_FRONT } };
  for (int n = 0; n < ROWS(cases); n++) {
    static tse_kalman k;
    tse_params p = a_car(0);
    uint32_t seed = 31;
    double ph[ALL];
    in_a_turn(&p, &k, &seed);
    p.car.driven = cases[n].driven;
    k.x[SF] = real(0.01), k.x[SR] = real(0.03);
    a_row(&p, &k, turned(), &z, h, read, &seed);
    z.no_second = 1;
    if (cases[n].missing >= 0) z.use[cases[n].missing] = 0;
    const int axle = cases[n].axle;
    const int unseen[] = { SF, SR, LCX };
    for (int i = 0; HAS_SLIP && i < 3; i++) h[axle][unseen[i]] = 0;
    const schmidt s = schmidt_of(&k);
    const double known = spread_of(&s, h[axle], ph), sd = number(p.sensor_sd[axle]), speed = number(k.x[VX]),
                 off = number(p.prior_sd[LCX]) * (axle == WHEEL_FRONT ? 0.01 : 0.03),
                 var = known + sd * sd + speed * speed * (pow(number(FREE_SLIP_SD), 2) + off * off);
    update_row(&p, &k, &z, turned());
    for (int a = 0; a < TSE_SENSORS; a++)
      TEST_ASSERT_EQUAL_INT(a == axle || a == ACCEL_Y || a == YAW_RATE, number(k.innovation_var[a]) > 0);
    expect_near(var, number(k.innovation_var[axle]), BY_NUMBER(1e-6, 1e-4, 1e-4) * var, "variance", n);
  }
}

/* What a row does not measure has no innovation, and the row no likelihood. */
static void test_a_row_without_a_channel_reports_nothing_of_the_row_before(void)
{
  static tse_kalman k;
  const tse_params p = a_car(0);
  uint32_t seed = 32;
  in_a_turn(&p, &k, &seed);
  for (int i = 0; i < 3; i++) k.moved[i] = real(0.25);
  a_row(&p, &k, turned(), &z, h, read, &seed);
  update_row(&p, &k, &z, turned());
  TEST_ASSERT_TRUE(number(k.innovation[YAW_RATE]) != 0 && number(k.log_likelihood) != 0);
  for (int i = HAS_SLIP ? 0 : 1; i < 3; i++) TEST_ASSERT_TRUE(number(k.moved[i]) >= 0.25);
  for (int a = 0; a < TSE_SENSORS; a++) z.use[a] = 0;
  z.rolls = ROLLS_NONE;
  update_row(&p, &k, &z, turned());
  expect_near(0, number(k.log_likelihood), 0, "likelihood", 0);
  for (int a = 0; a < TSE_SENSORS; a++) {
    expect_near(0, number(k.innovation[a]), 0, "innovation", a);
    expect_near(0, number(k.innovation_var[a]), 0, "its variance", a);
    expect_near(0, number(k.nis[a]), 0, "nis", a);
  }
}

/* The low-passed innovation takes 3 sd of an outlier at most, of either sign. Its
 * variance is that of a low pass of white noise. The usual ratio is at least 1. */
static void test_the_slow_innovation_takes_three_sd_of_an_outlier_of_either_sign(void)
{
  for (int sign = -1; sign <= 1; sign += 2) {
    static tse_kalman k;
    const tse_params p = a_car(0);
    tse_real change[TSE_ALL], state, variance[STATES];
    scalar m;
    memset(&k, 0, sizeof k);
    memset(&m, 0, sizeof m);
    for (int i = 0; i < TSE_ALL; i++) change[i] = TSE_R(0);
    for (int i = 0; i < STATES; i++) variance[i] = TSE_R(1);
    ud_set(&k.ud, variance);
    k.usual[YAW_RATE] = TSE_R(1), k.slow_var[YAW_RATE] = TSE_R(2);
    m.h[YAW] = TSE_R(1), m.r = m.white = TSE_R(3), m.e = real(sign * 50), m.dt = real(0.25);
    (void)use_scalar(&k, YAW_RATE, &m, p.sensor_sd[YAW_RATE], change, &state);
    const double g = 0.25 / (0.25 + number(MODEL_TIME)), s = 1 + 3;
    expect_near(sign * g * 3 * sqrt(s), number(k.slow[YAW_RATE]), 1e-5, "slow innovation", sign);
    expect_near((1 - g) * (1 - g) * 2 + g * g * s, number(k.slow_var[YAW_RATE]), 1e-5, "variance", sign);
    TEST_ASSERT_TRUE(number(k.usual[YAW_RATE]) >= 1);
  }
}
