/* tests/unit/filter/test_plausible.c <-> src/filter/plausible.c: a drive by textbook
 * kinematics - speed, its derivative, yaw rate, their product, the steering angle of the
 * understeer equation - and typical mistakes of logs, each as a factor on a channel. */
#include "filter/plausible.h"
#include "filter_support.h"

typedef struct mistake {
  const char *what;
  double factor[TSE_CHANNELS];
  int channel; /* 0 for none, else 1 + TSE_CHANNEL_ */
  double found;
} mistake;

#define DEGREES 57.29577951308232
#define G 9.80665

static double accel_noise = 0.1; /* [m/s2] noise of the accelerometers in driven() */

/* Run two minutes of bends and speed changes.
 *   Given:     every  n: accelerometers in each n-th row only; -n: wheel speeds
 *   Returned:  output of the last row */
static tse_output driven(
    const mistake *m, int32_t driven_axle, int exchanged, int every, int *valid, int *refused)
{
  static tse_filter f;
  tse_config c;
  tse_params p;
  tse_output y = { 0 };
  uint32_t seed = 5;
  tse_config_exact(&c);
  c.driven_axle = driven_axle;
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_prepare(&c, &p, NULL));
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_reset(&p, &f, sizeof f));
  const double wheelbase = number(p.car.lf) + number(p.car.lr), kf = number(p.car.ky_front),
               kr = number(p.car.ky_rear);
  const double understeer = (number(p.car.lr) * kr - number(p.car.lf) * kf) / (wheelbase * kf * kr);
  *valid = *refused = 0;
  for (int n = 0; n < 12000; n++) {
    const double t = 0.01 * n, w = 0.4, v = 14 + 4 * sin(w * t), ax = 4 * w * cos(w * t),
                 r = 0.25 * sin(0.9 * t) * sin(0.07 * t);
    const double slip = driven_axle == 1 ? 0.006 * fmax(ax, 0) : driven_axle == 2 ? -0.006 * fmax(ax, 0) : 0;
    const double bend = 0.5 * pow(wheelbase * r / v, 2);
    tse_input u;
    tse_input_default(&u);
    const double front = v * (1 + bend + fmax(slip, 0)) / number(p.radius_front),
                 rear = v * (1 + fmax(-slip, 0)) / number(p.radius_rear);
    u.dt = real(0.01);
    u.steer_angle = real(m->factor[TSE_CHANNEL_steer_angle] * r * (wheelbase + understeer * v * v) / v);
    u.wheel_speed_front = real(m->factor[TSE_CHANNEL_wheel_speed_front] * (exchanged ? rear : front));
    u.wheel_speed_rear = real(m->factor[TSE_CHANNEL_wheel_speed_rear] * (exchanged ? front : rear));
    u.accel_x = real(m->factor[TSE_CHANNEL_accel_x] * (ax + 0.3 + accel_noise * next_normal(&seed)));
    u.accel_y = real(m->factor[TSE_CHANNEL_accel_y] * (v * r - 0.2 + accel_noise * next_normal(&seed)));
    u.yaw_rate = real(m->factor[TSE_CHANNEL_yaw_rate] * (r + 0.003 * next_normal(&seed)));
    if (every > 0 && n % every) u.missing = TSE_MISSING_accel_x | TSE_MISSING_accel_y;
    if (every < 0 && n % -every) u.missing = TSE_MISSING_wheel_speed_front | TSE_MISSING_wheel_speed_rear;
    const tse_status status = tse_step(&p, &f, &u, &y);
    *refused += status < 0;
    if (n >= 6000 && status >= 0)
      for (int a = 0; a < 3; a++) *valid += y.reason[a] == TSE_VALID;
  }
  return y;
}

static void test_a_mistake_is_named_with_its_factor(void)
{
  static const mistake mistakes[] = {
    { "none", { 1, 1, 1, 1, 1, 1 }, 0, 0 },
    { "yaw rate in degrees", { 1, 1, 1, 1, 1, DEGREES }, 1 + TSE_CHANNEL_yaw_rate,
        0 /* partly out of range */ },
    { "yaw rate to the right", { 1, 1, 1, 1, 1, -1 }, 1 + TSE_CHANNEL_yaw_rate, -1 },
    { "accel_y in g", { 1, 1, 1, 1, 1 / G, 1 }, 1 + TSE_CHANNEL_accel_y, 1 / G },
    { "accel_y to the right", { 1, 1, 1, 1, -1, 1 }, 1 + TSE_CHANNEL_accel_y, -1 },
    { "accel_x in g", { 1, 1, 1, 1 / G, 1, 1 }, 1 + TSE_CHANNEL_accel_x, 1 / G },
    { "accel_x to the rear", { 1, 1, 1, -1, 1, 1 }, 1 + TSE_CHANNEL_accel_x, -1 },
    { "steering wheel", { 15, 1, 1, 1, 1, 1 }, 1 + TSE_CHANNEL_steer_angle, 15 },
    { "steering to the right", { -1, 1, 1, 1, 1, 1 }, 1 + TSE_CHANNEL_steer_angle, -1 },
    { "wheels in m/s", { 1, 0.3, 0.3, 1, 1, 1 }, 1 + TSE_CHANNEL_wheel_speed_front, 0.3 },
    { "km/h taken for rad/s, wheels of 0.325 m", { 1, 1.17, 1.17, 1, 1, 1 },
        1 + TSE_CHANNEL_wheel_speed_front, 1.17 },
    { "wheels of 0.4 m taken for 0.3 m", { 1, 0.75, 0.75, 1, 1, 1 }, 1 + TSE_CHANNEL_wheel_speed_front,
        0.75 },
    { "accel_y stands still", { 1, 1, 1, 1, 0, 1 }, 1 + TSE_CHANNEL_accel_y, 0 },
  };
  for (int i = 0; i < (int)(sizeof mistakes / sizeof mistakes[0]); i++) {
    const mistake *const m = &mistakes[i];
    int valid, refused;
    const tse_output y = driven(m, 1, 0, 1, &valid, &refused);
    if (refused) continue;
    TEST_ASSERT_EQUAL_INT_MESSAGE(m->channel, y.fault_channel, m->what);
    if (i == 0) {
      /* No car steers in to give these rows: if no event explains them, the fit is
       * bad. */
      if (HAS_SLIP) TEST_ASSERT_TRUE_MESSAGE(valid > 0, "nothing is wrong, and something is valid");
      TEST_ASSERT_TRUE(y.fault_factor == TSE_R(0) && y.status != TSE_W_IMPLAUSIBLE);
      continue;
    }
    TEST_ASSERT_EQUAL_INT_MESSAGE(0, valid, m->what);
    TEST_ASSERT_EQUAL_INT_MESSAGE(TSE_W_IMPLAUSIBLE, y.status, m->what);
    for (int a = 0; a < 3; a++) TEST_ASSERT_EQUAL_INT_MESSAGE(TSE_IMPLAUSIBLE, y.reason[a], m->what);
    /* 10 % tolerance: variances include noise, and a low-passed product differs from the
     * product of low-passed factors. */
    if (m->found != 0) expect_near(m->found, number(y.fault_factor), 0.1 * fabs(m->found), m->what, i);
  }
}

/* A car in bends at varying speed. Its yaw rate lags the steering angle by 0.08 s, and
 * its tyres are nominal. */
static double turn_at(double t) { return 0.25 * sin(0.9 * t) * sin(0.07 * t); }
static double speed_at(double t) { return 14 + 4 * sin(0.4 * t); }

static double side_at(const tse_params *p, double t)
{
  const double v = speed_at(t), lf = number(p->car.lf), lr = number(p->car.lr), dt = 0.005;
  const double arm = lr - v * v * lf / ((lf + lr) * number(p->car.ky_rear));
  return v * turn_at(t) + arm * (turn_at(t + dt) - turn_at(t - dt)) / (2 * dt);
}

typedef struct timing_case {
  const char *what;
  double steer, side, low_pass, turn; /* [s] delay of a channel; time constant of accel_y */
  uint32_t missing;                   /* in every 40th row */
  int channel;
} timing_case;

/* Run three minutes of that drive.
 *   Returned:  output of the last row
 *              first  [s] first time at which the channels contradict each other
 *              valid  number of valid stiffnesses in the rows after that */
static tse_output driven_late(const timing_case *m, double *first, int *valid)
{
  static tse_filter f;
  tse_config c;
  tse_params p;
  tse_output y = { 0 };
  uint32_t seed = 9;
  double low = 0;
  tse_config_exact(&c);
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_prepare(&c, &p, NULL));
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_reset(&p, &f, sizeof f));
  const double lf = number(p.car.lf), lr = number(p.car.lr), kf = number(p.car.ky_front),
               kr = number(p.car.ky_rear);
  const double wheelbase = lf + lr, understeer = (lr * kr - lf * kf) / (wheelbase * kf * kr);
  *first = 0, *valid = 0;
  for (int n = 0; n < 9000; n++) {
    const double dt = 0.02, t = 10 + dt * n, v = speed_at(t - m->steer);
    const double side = side_at(&p, t - m->side);
    tse_input u;
    tse_input_default(&u);
    low += m->low_pass > 0 ? (1 - exp(-dt / m->low_pass)) * (side - low) : side - low;
    u.dt = real(dt);
    u.steer_angle = real(turn_at(t - m->steer + 0.08) * (wheelbase + understeer * v * v) / v);
    u.wheel_speed_front = real(speed_at(t) / number(p.radius_front));
    u.wheel_speed_rear = real(speed_at(t) / number(p.radius_rear));
    u.accel_x = real(1.6 * cos(0.4 * t) + 0.1 * next_normal(&seed));
    u.accel_y = real(low - 0.2 + 0.1 * next_normal(&seed));
    u.yaw_rate = real(turn_at(t - m->turn) + 0.003 * next_normal(&seed));
    if (n % 40 == 0) u.missing = m->missing;
    const tse_status status = tse_step(&p, &f, &u, &y);
    TEST_ASSERT_TRUE(status >= 0);
    if (status == TSE_W_IMPLAUSIBLE && !(*first > 0)) *first = t - 10;
    for (int a = 0; a < 3; a++) *valid += *first > 0 && y.reason[a] == TSE_VALID;
  }
  return y;
}

static void test_a_channel_that_comes_late_is_named(void)
{
  static const timing_case late[] = {
    { "all in time", 0, 0, 0, 0, 0, 0 },
    { "a bus: each channel 0 .. 60 ms late", 0, 0.05, 0, 0, 0, 0 },
    { "a bus: yaw rate", 0, 0, 0, 0.06, 0, 0 },
    { "a bus and stiff tyres: yaw rate", 0, 0, 0, 0.09, 0, 0 },
    { "a bus: steering angle", 0.06, 0, 0, 0, 0, 0 },
    { "accel_y 200 ms", 0, 0.2, 0, 0, 0, 1 + TSE_CHANNEL_accel_y },
    { "accel_y low-passed at 1 Hz", 0, 0, 0.159, 0, 0, 1 + TSE_CHANNEL_accel_y },
    { "yaw rate 200 ms", 0, 0, 0, 0.2, 0, 1 + TSE_CHANNEL_yaw_rate },
    { "steering angle 300 ms", 0.3, 0, 0, 0, 0, 1 + TSE_CHANNEL_steer_angle },
    { "accel_y 200 ms, never a second without a missing value", 0, 0.2, 0, 0, TSE_MISSING_yaw_rate, 0 },
  };
  for (int i = 0; i < ROWS(late); i++) {
    double first;
    int valid;
    const tse_output y = driven_late(&late[i], &first, &valid);
    TEST_ASSERT_EQUAL_INT_MESSAGE(late[i].channel, y.fault_channel, late[i].what);
    TEST_ASSERT_TRUE_MESSAGE((first > 0) == (late[i].channel != 0) && first < 60, late[i].what);
    TEST_ASSERT_EQUAL_INT_MESSAGE(0, valid, late[i].what);
    TEST_ASSERT_TRUE_MESSAGE(y.fault_factor == TSE_R(0), late[i].what);
    for (int a = 0; a < 3 && late[i].channel; a++)
      TEST_ASSERT_EQUAL_INT_MESSAGE(TSE_IMPLAUSIBLE, y.reason[a], late[i].what);
  }
}

/* Accelerometers or wheel speeds of a slow message: their values are as large as others,
 * and change as fast. */
static void test_a_channel_that_comes_seldom_contradicts_nobody(void)
{
  static const mistake seldom = { "seldom", { 1, 1, 1, 1, 1, 1 }, 0, 0 };
  static const int every[] = { 5, -2, -3, -10 };
  for (int i = 0; i < ROWS(every); i++) {
    int valid, refused;
    const tse_output y = driven(&seldom, 1, 0, every[i], &valid, &refused);
    TEST_ASSERT_EQUAL_INT(0, y.fault_channel);
    TEST_ASSERT_TRUE(y.status != TSE_W_IMPLAUSIBLE && refused == 0);
  }
}

static void test_axles_that_are_exchanged_are_no_other_factor(void)
{
  static const mistake none = { "none", { 1, 1, 1, 1, 1, 1 }, 0, 0 };
  for (int32_t axle = 0; axle <= 2; axle++) {
    int valid, refused;
    tse_output y = driven(&none, axle, 0, 1, &valid, &refused);
    TEST_ASSERT_EQUAL_INT(0, y.fault_channel);
    y = driven(&none, axle, 1, 1, &valid, &refused);
    if (axle) TEST_ASSERT_EQUAL_INT(1 + TSE_CHANNEL_wheel_speed_front, y.fault_channel);
    TEST_ASSERT_TRUE(y.fault_factor == TSE_R(0));
  }
}


/* Wheels of 0.29 m give a factor of 1.05 for km/h: within the tolerance for roll and
 * pitch, and within that of an uncertain radius. */
static void test_a_speed_that_is_hardly_off_contradicts_nobody(void)
{
  static const mistake hardly[] = { { "fast", { 1, 1.05, 1.05, 1, 1, 1 }, 0, 0 },
    { "slow", { 1, 0.92, 0.92, 1, 1, 1 }, 0, 0 } };
  for (int i = 0; i < 2; i++) {
    int valid, refused;
    const tse_output y = driven(&hardly[i], 1, 0, 1, &valid, &refused);
    TEST_ASSERT_EQUAL_INT_MESSAGE(0, y.fault_channel, hardly[i].what);
    TEST_ASSERT_TRUE(y.status != TSE_W_IMPLAUSIBLE && refused == 0);
  }
}

/* Vibrating accelerometers hide a factor of 1.17, but not factors of 2 or 0.5. */
static void test_a_diameter_for_a_radius_is_named_on_a_rough_road(void)
{
  static const mistake on_rough[] = { { "none", { 1, 1, 1, 1, 1, 1 }, 0, 0 },
    { "diameter", { 1, 2, 2, 1, 1, 1 }, 1 + TSE_CHANNEL_wheel_speed_front, 2 },
    { "half of it", { 1, 0.5, 0.5, 1, 1, 1 }, 1 + TSE_CHANNEL_wheel_speed_front, 0.5 } };
  accel_noise = 1.5;
  for (int i = 0; i < ROWS(on_rough); i++) {
    int valid, refused;
    const tse_output y = driven(&on_rough[i], 1, 0, 1, &valid, &refused);
    TEST_ASSERT_EQUAL_INT_MESSAGE(on_rough[i].channel, y.fault_channel, on_rough[i].what);
    expect_near(on_rough[i].found, number(y.fault_factor), 0.1 * on_rough[i].found, on_rough[i].what, i);
  }
  accel_noise = 0.1;
}

/* After a memory fault, NaN must not contradict forever. */
/* A road with slopes of +-6 %: gravity in accel_x, while the driver holds the speed
 * except for a part that lags by a quarter period. Without this part, accel_x would
 * contradict the wheels by a factor of four. */
static void test_a_hill_at_constant_speed_contradicts_nobody(void)
{
  static tse_filter f;
  tse_config c;
  tse_params p;
  tse_output y = { 0 };
  uint32_t seed = 7;
  int32_t implausible = 0;
  tse_config_exact(&c);
  c.grade_sd = setting(0.03);
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_prepare(&c, &p, NULL));
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_reset(&p, &f, sizeof f));
  for (int n = 0; n < 12000; n++) {
    const double t = 0.01 * n, w = 0.5, v = 25 - 0.3 * cos(w * t + 1.5), ax = 0.15 * sin(w * t + 1.5),
                 r = 0.05 * sin(0.9 * t);
    tse_input u;
    tse_input_default(&u);
    u.dt = real(0.01);
    u.steer_angle = real(r * (number(p.car.lf) + number(p.car.lr)) / v);
    u.wheel_speed_front = real(v / number(p.radius_front));
    u.wheel_speed_rear = real(v / number(p.radius_rear));
    u.accel_x = real(ax + 0.06 * G * sin(w * t) + 0.1 * next_normal(&seed));
    u.accel_y = real(v * r + 0.1 * next_normal(&seed));
    u.yaw_rate = real(r + 0.003 * next_normal(&seed));
    const tse_status status = tse_step(&p, &f, &u, &y);
    TEST_ASSERT_TRUE(status >= 0);
    implausible += y.reason[TSE_CY_FRONT] == TSE_IMPLAUSIBLE;
  }
  TEST_ASSERT_EQUAL_INT32(0, implausible);
  TEST_ASSERT_EQUAL_INT32(0, y.fault_channel);
}

static void test_what_is_kept_is_numbers_or_all_starts_over(void)
{
#if !defined(TSE_REAL_FIXED)
  static tse_filter f;
  tse_config c = config_by(tse_config_exact);
  tse_params p;
  tse_input u;
  tse_output y;
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_prepare(&c, &p, NULL));
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_reset(&p, &f, sizeof f));
  tse_input_default(&u);
  u.dt = real(0.01), u.wheel_speed_front = u.wheel_speed_rear = real(50);
  tse_real *const kept[] = { &f.k.agreement.smooth[5], &f.k.agreement.pair[0].time,
    &f.k.agreement.pair[TSE_PAIRS - 1].both, &f.k.agreement.pair[2].var[1], &f.k.agreement.pair[3].mean[0],
    &f.k.agreement.moved[1][1], &f.k.agreement.across.late, &f.k.agreement.steered.square };
  for (int i = 0; i < (int)(sizeof kept / sizeof kept[0]); i++) {
    for (int n = 0; n < 5; n++) TEST_ASSERT_TRUE(tse_step(&p, &f, &u, &y) >= 0);
    *kept[i] = real(NAN);
    TEST_ASSERT_EQUAL_INT(TSE_W_RECOVERED, tse_step(&p, &f, &u, &y));
    TEST_ASSERT_TRUE(r_is_finite(*kept[i]) && y.fault_channel == 0);
  }
#endif
}

/* The signals of each pair, for a car on a circle at constant speed: filtered from the
 * first row on, and then constant. The last rows have speeds and yaw rates that are not
 * physical: shares and sines are limited to 1. */
static void test_pairs_are_what_kinematics_make_of_a_steady_turn(void)
{
  static const struct {
    double front, rear, r; /* [m/s, m/s, rad/s] */
  } turn[] = { { 10.1, 9.9, 0.5 }, { 9.9, 10.1, -0.5 }, { 5.2, 5, 0.7 }, { 30, 30, 0.2 }, { 4, 4, 5 },
    { 4, 4, -5 }, { 16, -6, 0.2 }, { -6, 16, 0.2 } };
  const tse_params p = prepared(config_by(tse_config_exact));
  const double lf = number(p.car.lf), lr = number(p.car.lr), length = lf + lr, kf = number(p.car.ky_front),
               kr = number(p.car.ky_rear);
  const double understeer = (lr * kr - lf * kf) / (length * kf * kr), close = BY_NUMBER(1e-12, 1e-5, 1e-5);
  for (int n = 0; n < ROWS(turn); n++) {
    static tse_kalman k;
    tse_input u;
    memset(&k, 0, sizeof k);
    tse_input_default(&u);
    u.steer_angle = real(0.03), u.wheel_speed_front = real(turn[n].front / number(p.radius_front)),
    u.wheel_speed_rear = real(turn[n].rear / number(p.radius_rear));
    u.accel_x = real(0.4), u.accel_y = real(1.5), u.yaw_rate = real(turn[n].r);
    for (int row = 0; row < 20; row++) check_agreement(&p, &k, &u, real(0.01), 0);
    const tse_pair *const pair = k.agreement.pair;
    const double v = 0.5 * (turn[n].front + turn[n].rear), bend = fmin(fabs(length * turn[n].r / v), 1);
    const double faster = fmax(-1, fmin(1, (turn[n].front - turn[n].rear) / v));
    const double expected[TSE_PAIRS][2] = { { v * turn[n].r, 1.5 },
      { 0.03 * v / (length + understeer * v * v), turn[n].r }, { 0.4, 0 }, { 0.5 * bend * bend, faster },
      { 0.4, faster } };
    for (int i = 0; i < TSE_PAIRS; i++) {
      /* not informative about speed changes, nor about the front wheels' higher speed in
       * a bend */
      const int spins = (i == 2 && fabs(faster) >= number(SLIPPING))
          || (i == 3 && fabs(faster) >= number(SLIPPING) + 0.5 * bend * bend);
      for (int side = 0; side < 2; side++)
        expect_near(spins ? 0 : expected[i][side], number(pair[i].mean[side]), close * 10, "mean",
            100 * n + 10 * i + side);
      expect_near(spins ? 0 : number(USUAL_TIME) * (1 - pow(1 - 0.01 / number(USUAL_TIME), 19)),
          number(pair[i].time), close, "seconds", 10 * n + i);
    }
  }
}

/* A speed that grows linearly: the low-passed speed lags by the time constant and grows
 * as fast. Its derivative is that of the wheels. */
static void test_the_change_of_the_speed_is_that_of_an_even_one(void)
{
  static tse_kalman k;
  const tse_params p = prepared(config_by(tse_config_exact));
  const double gained = 1.5, dt = 0.01, smooth = number(SMOOTH_TIME), left = smooth / (dt + smooth),
               keep = 1 - dt / number(USUAL_TIME);
  double v = 5, sum = 0, weights = 0, speed = 0;
  memset(&k, 0, sizeof k);
  for (int row = 0; row < 400; row++, v += gained * dt) {
    tse_input u;
    tse_input_default(&u);
    speed = v;
    u.wheel_speed_front = real(v / number(p.radius_front)),
    u.wheel_speed_rear = real(v / number(p.radius_rear));
    u.accel_x = real(gained);
    check_agreement(&p, &k, &u, real(dt), 0);
    if (row == 0) continue;                           /* starts */
    sum = keep * sum + gained * (1 - pow(left, row)); /* as a filter of first order answers */
    weights = keep * weights + 1;
  }
  expect_near(
      speed - gained * smooth, number(k.agreement.smooth[3]), BY_NUMBER(1e-6, 1e-4, 1e-4), "smoothed", 0);
  expect_near(
      sum / weights, number(k.agreement.pair[2].mean[1]), BY_NUMBER(1e-9, 1e-3, 1e-3), "change [m/s2]", 0);
  expect_near(gained, number(k.agreement.pair[2].mean[0]), BY_NUMBER(1e-9, 1e-5, 1e-5), "accel_x [m/s2]", 0);
}

/* If all axles are driven, or the driven axle is unknown, only bends show which wheels
 * are the front ones: they run on the larger circle. */
static void test_axles_that_are_exchanged_show_in_bends_whatever_is_driven(void)
{
  for (int exchanged = 0; exchanged < 2; exchanged++) {
    static tse_kalman k;
    tse_config c = config_by(tse_config_exact);
    tse_real factor = broken();
    c.driven_axle = 0;
    const tse_params p = prepared(c);
    const double length = number(p.car.lf) + number(p.car.lr);
    memset(&k, 0, sizeof k);
    for (int n = 0; n < 6000; n++) {
      const double t = 0.01 * n, v = 4, r = 0.5 * sin(0.5 * t), front = v * sqrt(1 + pow(length * r / v, 2));
      tse_input u;
      tse_input_default(&u);
      u.wheel_speed_front = real((exchanged ? v : front) / number(p.radius_front));
      u.wheel_speed_rear = real((exchanged ? front : v) / number(p.radius_rear));
      u.yaw_rate = real(r), u.missing = TSE_MISSING_accel_x | TSE_MISSING_accel_y | TSE_MISSING_steer_angle;
      check_agreement(&p, &k, &u, real(0.01), 0);
    }
    TEST_ASSERT_EQUAL_INT(
        exchanged ? 1 + TSE_CHANNEL_wheel_speed_front : 0, find_implausible_channel(&k, &factor));
    TEST_ASSERT_TRUE(factor == TSE_R(0));
  }
}

/* How long after its end, and how long in total, a contradiction is reported in two
 * minutes of bends, with a channel that is wrong for a while: constant, or scaled. */
typedef struct wrong {
  const char *what;
  int channel;
  double from, to, value, factor; /* [s]; the channel reads value + factor * true value */
  double after, least;            /* [s] at most so long after its end; at least so long in total */
  double turn;                    /* [rad/s] largest yaw rate */
} wrong;

static void test_what_is_wrong_for_a_while_contradicts_for_a_while(void)
{
  static const wrong cases[] = {
    { "wheels at 98 m/s", TSE_CHANNEL_wheel_speed_front, 40, 40.5, 98, 0, 0, 0, 0.25 },
    { "both wheels late in the drive", TSE_CHANNEL_wheel_speed_rear, 90, 91, 98, 0, 0, 0, 0.25 },
    { "yaw rate at 4 rad/s", TSE_CHANNEL_yaw_rate, 40, 40.5, 4, 0, 0, 0, 0.25 },
    { "accel_y at 30 m/s2", TSE_CHANNEL_accel_y, 40, 40.5, 30, 0, 0, 0, 0.25 },
    { "accel_x at -30 m/s2", TSE_CHANNEL_accel_x, 40, 41, -30, 0, 0, 0, 0.25 },
    { "steering the other way", TSE_CHANNEL_steer_angle, 40, 75, 0, -3, 30, 25, 0.25 }, /* as on ice */
    { "the same in gentle bends", TSE_CHANNEL_steer_angle, 40, 75, 0, -3, 30, 25, 0.06 },
    { "yaw rate the other way, to the end", TSE_CHANNEL_yaw_rate, 40, 120, 0, -1, 0, 60, 0.25 },
  };
  const tse_params p = prepared(config_by(tse_config_default));
  const double length = number(p.car.lf) + number(p.car.lr);
  for (int i = 0; i < ROWS(cases); i++) {
    const wrong *const w = &cases[i];
    static tse_kalman k;
    double after = 0, all = 0;
    memset(&k, 0, sizeof k);
    for (int n = 0; n < 12000; n++) {
      const double t = 0.01 * n, v = 14 + 4 * sin(0.4 * t), r = w->turn * sin(0.9 * t) * sin(0.07 * t),
                   is = t >= w->from && t < w->to;
      double x[TSE_CHANNELS] = { r * length / v, v, v, 1.6 * cos(0.4 * t), v * r, r };
      tse_input u;
      if (is) x[w->channel] = w->value + w->factor * x[w->channel];
      tse_input_default(&u);
      u.steer_angle = real(x[0]), u.accel_x = real(x[3]), u.accel_y = real(x[4]), u.yaw_rate = real(x[5]);
      u.wheel_speed_front = real(x[1] / number(p.radius_front)),
      u.wheel_speed_rear = real(x[2] / number(p.radius_rear));
      check_agreement(&p, &k, &u, real(0.01), 0);
      if (!(k.agreement.apart || k.agreement.off_scale)) continue;
      all += 0.01;
      if (t >= w->to) after = t - w->to + 0.01;
    }
    TEST_ASSERT_TRUE_MESSAGE(after <= w->after, w->what);
    TEST_ASSERT_TRUE_MESSAGE(all >= w->least && (w->least > 0 || all <= 0), w->what);
  }
}

/* ------------------------------------------------------------------------- decisions, one by one */

/* The pairs and the bits of tse_agreement.apart, as in plausible.c. */
enum { ACROSS, TURNING_BY, ALONG, IN_BENDS, BY_DRIVE, ACCEL_LATE_BIT, YAW_LATE_BIT, STEER_LATE_BIT };

static tse_pair pair_of(double time, double first, double second, double both)
{
  tse_pair q;
  memset(&q, 0, sizeof q);
  q.time = real(time), q.var[0] = real(first), q.var[1] = real(second), q.both = real(both);
  return q;
}

/* A state at 10 m/s, all channels 0, and a row that changes none of it, save by
 * forgetting a thousandth or less. */
static tse_kalman even_state(void)
{
  tse_kalman k;
  memset(&k, 0, sizeof k);
  k.agreement.smooth[3] = TSE_R(10);
  return k;
}

static tse_input even_row(const tse_params *p)
{
  tse_input u;
  tse_input_default(&u);
  u.wheel_speed_front = r_div(TSE_R(10), p->radius_front);
  u.wheel_speed_rear = r_div(TSE_R(10), p->radius_rear);
  return u;
}

static tse_kalman judged(const tse_params *p, const tse_kalman *from)
{
  tse_kalman k = *from;
  const tse_input u = even_row(p);
  check_agreement(p, &k, &u, real(0.001), 0);
  return k;
}

/* A pair disagrees if its correlation is weak or of the wrong sign, or if the ratio of
 * its variances is beyond 2.5^2. Gravity along the road may be a part of the first
 * variance of ALONG. For the pairs of wheel speeds only the sign counts. */
static void test_a_pair_disagrees_by_its_correlation_and_its_ratio(void)
{
  static const struct {
    int which, driven;
    double slope, time, first, second, both; /* [m/s2] sd of gravity along the road */
    int was, is;
  } cases[] = {
    { ACROSS, 1, 0, 20, 1, 1, 0.9, 1, 0 },
    { ACROSS, 1, 0, 20, 1, 1, -0.9, 0, 1 },
    { ACROSS, 1, 0, 20, 1, 1, 0.33, 1, 0 },
    { ACROSS, 1, 0, 20, 1, 1, 0.3, 0, 1 },
    { TURNING_BY, 1, 0, 20, 1, 6, 2.2, 1, 0 },
    { TURNING_BY, 1, 0, 20, 1, 6.6, 2.2, 0, 1 },
    { TURNING_BY, 1, 0, 20, 6, 1, 2.2, 1, 0 },
    { TURNING_BY, 1, 0, 20, 6.6, 1, 2.2, 0, 1 },
    { ALONG, 1, 0, 20, 4, 0.5, 1.2, 0, 1 },
    { ALONG, 1, 0.5, 20, 4, 0.5, 1.2, 1, 0 },
    { ALONG, 1, 0.5, 20, 2, 0.3, 0.7, 1, 0 }, /* no less than the second */
    { ACROSS, 1, 0.5, 20, 8, 1, 2.5, 0, 1 },
    /* too little excitation leaves the decision of before */
    { ACROSS, 1, 0, 1, 0.5, 0.5, -0.4, 0, 0 },
    { ACROSS, 1, 0, 1, 0.5, 0.5, 0.4, 1, 0 }, /* the time does not count while they disagree */
    { ACROSS, 1, 0, 20, 0.05, 0.09, 0.06, 1, 1 },
    { ACROSS, 1, 0, 20, 0.05, 2, 0.3, 0, 1 },
    { TURNING_BY, 1, 0, 20, 1e-4, 0.01, 1e-3, 0, 1 },
    { ALONG, 1, 0, 20, 0.05, 2, 0.3, 0, 1 },
    { IN_BENDS, 1, 0, 20, 1e-3, 1e-3, -5e-4, 0, 1 },
    { IN_BENDS, 1, 0, 20, 1e-3, 1e-3, 5e-4, 1, 0 },
    { IN_BENDS, 1, 0, 20, 1e-3, 1e-3, -4e-4, 1, 0 },
    { BY_DRIVE, 1, 0, 20, 1, 0.01, -0.05, 0, 1 },
    { BY_DRIVE, 1, 0, 20, 1, 0.01, 0.05, 1, 0 },
    { BY_DRIVE, 1, 0, 20, 1, 0.01, -0.04, 1, 0 },
    { BY_DRIVE, 2, 0, 20, 1, 0.01, 0.05, 0, 1 },
    { BY_DRIVE, 2, 0, 20, 1, 0.01, -0.05, 1, 0 },
    { BY_DRIVE, 0, 0, 20, 1, 0.01, 0.05, 1, 0 },
    { BY_DRIVE, 0, 0, 20, 1, 0.01, -0.05, 1, 0 },
    { BY_DRIVE, 1, 0, 20, 0.1, 1, -0.25, 0, 0 }, /* only the first one shows it */
  };
  tse_params p = prepared(config_by(tse_config_exact));
  for (int n = 0; n < ROWS(cases); n++) {
    tse_kalman k = even_state();
    p.car.driven = cases[n].driven, p.prior_sd[GX] = real(cases[n].slope);
    k.agreement.pair[cases[n].which] = pair_of(cases[n].time, cases[n].first, cases[n].second, cases[n].both);
    k.agreement.apart = cases[n].was << cases[n].which;
    k = judged(&p, &k);
    char text[40];
    (void)snprintf(text, sizeof text, "case %d", n);
    TEST_ASSERT_EQUAL_INT_MESSAGE(cases[n].is << cases[n].which, k.agreement.apart, text);
  }
}

/* Means, variances and covariance are those of exponentially weighted samples. A sample
 * beyond 3 sd counts as one of 3 sd, on its side of the mean. */
static void test_the_statistics_of_a_pair_are_those_of_its_weighted_samples(void)
{
  static tse_kalman k;
  const tse_params p = prepared(config_by(tse_config_exact));
  double sum = 0, mean[2] = { 0 }, square[3] = { 0 };
  const double dt = 0.05, keep = 1 - dt / number(USUAL_TIME);
  memset(&k, 0, sizeof k);
  for (int n = 0; n < 600; n++) {
    tse_input u = even_row(&p);
    u.yaw_rate = real(0.1 * sin(0.3 * n) + 0.02), u.accel_y = real(sin(0.3 * n - 0.2) + 0.3 * sin(0.05 * n));
    check_agreement(&p, &k, &u, real(dt), 0);
    if (n == 0) continue; /* starts */
    const double x = number(k.agreement.smooth[1]), y = number(k.agreement.smooth[0]);
    sum = keep * sum + 1;
    mean[0] = keep * mean[0] + x, mean[1] = keep * mean[1] + y;
    square[0] = keep * square[0] + x * x, square[1] = keep * square[1] + y * y;
    square[2] = keep * square[2] + x * y;
  }
  const tse_pair *const q = &k.agreement.pair[ACROSS];
  const double mx = mean[0] / sum, my = mean[1] / sum, close = BY_NUMBER(1e-6, 1e-4, 1e-3);
  expect_near(mx, number(q->mean[0]), close, "mean", 0);
  expect_near(my, number(q->mean[1]), close, "mean", 1);
  expect_near(square[0] / sum - mx * mx, number(q->var[0]), close, "variance", 0);
  expect_near(square[1] / sum - my * my, number(q->var[1]), close, "variance", 1);
  expect_near(square[2] / sum - mx * my, number(q->both), close, "covariance", 0);

  static const struct {
    double sample, var, counts; /* 2/20: variance of the least excitation of ACROSS */
  } far[] = { { 5, 1, 3 }, { -5, 1, -3 }, { 2, 1, 2 }, { 5, 0, 0.9487 }, { -5, 0, -0.9487 } };
  for (int n = 0; n < ROWS(far); n++) {
    tse_kalman one = even_state();
    one.agreement.pair[ACROSS] = pair_of(10, far[n].var, 1, 0);
    one.agreement.smooth[1] = real(far[n].sample);
    tse_input u = even_row(&p);
    u.yaw_rate = real(far[n].sample / 10);
    check_agreement(&p, &one, &u, real(0.1), 0);
    const double time = 10 * (1 - 0.1 / 20) + 0.1;
    expect_near(far[n].counts * 0.1 / time, number(one.agreement.pair[ACROSS].mean[0]), 1e-4, "moved by", n);
  }
}

/* The sums of the scale: of samples of pairs that agree and correlate almost fully. */
static void test_the_scale_is_summed_of_pairs_that_agree_well(void)
{
  static const struct {
    double both; /* covariance of variances of 4 */
    int apart, counts;
  } cases[] = { { 3.98, 0, 1 }, { 3.92, 0, 0 }, { 3.98, 1, 1 }, { -3.98, 0, 0 }, { 4, 0, 2 } };
  const tse_params p = prepared(config_by(tse_config_exact));
  const double dt = 0.1, keep = 1 - dt / number(SCALE_TIME);
  for (int n = 0; n < ROWS(cases); n++) {
    tse_kalman k = even_state();
    const int against = cases[n].counts == 2; /* the mean product does not become negative */
    k.agreement.pair[ACROSS] = k.agreement.pair[ALONG] = pair_of(20, 4, 4, cases[n].both);
    k.agreement.apart = cases[n].apart * (1 << ACROSS | 1 << ALONG); /* agrees again in this row */
    for (int i = 0; i < 2; i++)
      k.agreement.moved[i][0] = real(3 + i), k.agreement.moved[i][1] = real(against ? 0.01 : 5 + i);
    k.agreement.smooth[0] = real(against ? -2.2 : 2.2), k.agreement.smooth[1] = TSE_R(2);
    k.agreement.smooth[2] = TSE_R(1), k.agreement.smooth[4] = real(2 / 10.35);
    tse_input u = even_row(&p);
    u.wheel_speed_front = r_div(real(against ? 9.65 : 10.35), p.radius_front);
    u.wheel_speed_rear = r_div(real(against ? 9.65 : 10.35), p.radius_rear);
    u.yaw_rate = real(2 / (against ? 9.65 : 10.35)), u.accel_y = k.agreement.smooth[0], u.accel_x = TSE_R(1);
    check_agreement(&p, &k, &u, real(dt), 0);
    const double first[2] = { 3 + 0.0, 4 }, both[2] = { against ? 0.01 : 5, against ? 0.01 : 6 };
    const double x[2] = { 2, 1 }, y[2] = { against ? -2.2 : 2.2, against ? -1 : 1 };
    for (int i = 0; i < 2; i++) {
      expect_near(cases[n].counts ? keep * first[i] + dt * x[i] * x[i] : first[i],
          number(k.agreement.moved[i][0]), 1e-4, "squares", 10 * n + i);
      expect_near(cases[n].counts ? fmax(0, keep * both[i] + dt * x[i] * y[i]) : both[i],
          number(k.agreement.moved[i][1]), 1e-4, "products", 10 * n + i);
    }
  }
}

/* The squared scale is (ratio of ALONG) / (ratio of ACROSS), from both sums or, where
 * these are too small, roughly from the variances of pairs that correlate and are
 * excited. */
static void test_the_speed_is_off_scale_by_both_ratios_together(void)
{
  static const struct {
    double across[2], along[2];                       /* sums of the scale */
    double time[2], ratio[2], related[2], slope, all; /* of the pairs ACROSS, ALONG */
    int apart, is;
  } cases[] = {
    { { 30, 30 }, { 20, 26 }, { 1, 1 }, { 1, 1 }, { 0, 0 }, 0, 0, 0, 1 },
    { { 30, 30 }, { 20, 24 }, { 1, 1 }, { 1, 1 }, { 0, 0 }, 0, 0, 0, 0 },
    { { 30, 30 }, { 20, 13.5 }, { 1, 1 }, { 1, 1 }, { 0, 0 }, 0, 0, 0, 1 },
    { { 30, 30 }, { 20, 15 }, { 1, 1 }, { 1, 1 }, { 0, 0 }, 0, 0, 0, 0 },
    { { 30, 23 }, { 20, 20 }, { 1, 1 }, { 1, 1 }, { 0, 0 }, 0, 0, 0, 1 },
    { { 30, 26 }, { 20, 22 }, { 1, 1 }, { 1, 1 }, { 0, 0 }, 0, 0, 0, 1 },
    { { 30, 26 }, { 20, 18 }, { 1, 1 }, { 1, 1 }, { 0, 0 }, 0, 0, 0, 0 },
    { { 19, 10 }, { 20, 20 }, { 1, 1 }, { 1, 1 }, { 0, 0 }, 0, 0, 0, 0 },
    { { 30, 30 }, { 9, 19 }, { 1, 1 }, { 1, 1 }, { 0, 0 }, 0, 0, 0, 0 },
    { { 0, 0 }, { 0, 0 }, { 20, 20 }, { 4, 4 }, { 0.8, 0.8 }, 0, 1, 0, 1 },
    { { 0, 0 }, { 0, 0 }, { 20, 20 }, { 2, 2 }, { 0.8, 0.8 }, 0, 1, 0, 0 },
    { { 0, 0 }, { 0, 0 }, { 20, 20 }, { 6, 1 }, { 0.8, 0.8 }, 0, 1, 0, 1 },
    { { 0, 0 }, { 0, 0 }, { 20, 20 }, { 0.25, 0.25 }, { 0.8, 0.8 }, 0, 1, 0, 1 },
    { { 0, 0 }, { 0, 0 }, { 20, 20 }, { 0.35, 0.35 }, { 0.8, 0.8 }, 0, 1, 0, 0 },
    { { 0, 0 }, { 0, 0 }, { 20, 20 }, { 4, 4 }, { 0.6, 0.8 }, 0, 1, 0, 0 },
    { { 0, 0 }, { 0, 0 }, { 20, 20 }, { 4, 4 }, { 0.8, 0.6 }, 0, 1, 0, 0 },
    { { 0, 0 }, { 0, 0 }, { 0.2, 20 }, { 4, 4 }, { 0.8, 0.8 }, 0, 1, 0, 0 },
    { { 0, 0 }, { 0, 0 }, { 20, 0.2 }, { 4, 4 }, { 0.8, 0.8 }, 0, 1, 0, 0 },
    { { 0, 0 }, { 0, 0 }, { 20, 20 }, { 4, 4 }, { 0.8, 0.8 }, 0, 1, 1 << BY_DRIVE, 0 },
  };
  tse_params p = prepared(config_by(tse_config_exact));
  p.prior_sd[GX] = TSE_R(0);
  for (int n = 0; n < ROWS(cases); n++) {
    tse_kalman k = even_state();
    tse_agreement *const a = &k.agreement;
    for (int i = 0; i < 2; i++)
      a->moved[0][i] = real(cases[n].across[i]), a->moved[1][i] = real(cases[n].along[i]);
    const double *const ratio = cases[n].ratio, all = cases[n].all;
    a->pair[ACROSS] = pair_of(
        cases[n].time[0], all * ratio[0], all, all * sqrt(cases[n].related[0] * ratio[0]));
    a->pair[ALONG] = pair_of(
        cases[n].time[1], all, all * ratio[1], all * sqrt(cases[n].related[1] * ratio[1]));
    a->apart = cases[n].apart;
    k = judged(&p, &k);
    char text[40];
    (void)snprintf(text, sizeof text, "case %d", n);
    TEST_ASSERT_EQUAL_INT_MESSAGE(cases[n].is, a->off_scale, text);
    TEST_ASSERT_EQUAL_INT_MESSAGE(cases[n].apart, a->apart, text);
  }
}

/* Latencies: sums, and the limits that they must exceed, by hand. Three sds of a latency
 * times an excitation of 100 are 2 for the steering angle and 3.5 for accel_y. */
static void test_a_channel_is_late_beyond_the_limit_of_its_latency(void)
{
  enum { A = 1 << ACCEL_LATE_BIT, Y = 1 << YAW_LATE_BIT, S = 1 << STEER_LATE_BIT };
  static const struct {
    double across, square, steered, asked, lags, settings; /* [s] sd of the latency of accel_y */
    double time[2], speed, complete_for;                   /* [s] of ACROSS, TURNING_BY; [m/s] [s] */
    int was, is;
  } cases[] = {
    { 4.4, 100, 0, 100, 0, 0, { 20, 20 }, 10, 2, 0, 0 }, /* 0.01 * 100 + 3.5 */
    { 4.6, 100, 0, 100, 0, 0, { 20, 20 }, 10, 2, 0, A },
    { 14.4, 100, 0, 100, 10, 0, { 20, 20 }, 10, 2, A, 0 },
    { 14.6, 100, 0, 100, 10, 0, { 20, 20 }, 10, 2, 0, A },
    { 18.4, 100, 0, 100, 0, 0.05, { 20, 20 }, 10, 2, 0, 0 }, /* 3 * 0.05 * 100 + 3.5 */
    { 18.6, 100, 0, 100, 0, 0.05, { 20, 20 }, 10, 2, 0, A },
    { 4.4, 100, 0, 100, 0, 0.001, { 20, 20 }, 10, 2, 0, 0 },
    { 3, 20, 0, 100, 0, 0, { 20, 20 }, 10, 2, 0, 0 }, /* a single corner */
    { 3, 30, 0, 100, 0, 0, { 20, 20 }, 10, 2, 0, A },
    { 0, 100, -6.9, 100, 0, 0, { 20, 20 }, 10, 2, 0, 0 }, /* 0.05 * 100 + 2 */
    { 0, 100, -7.1, 100, 0, 0, { 20, 20 }, 10, 2, 0, S },
    { 0, 100, -5, 7, 0, 0, { 20, 20 }, 10, 2, 0, 0 },
    { 0, 7, -7.1, 100, 0, 0, { 20, 20 }, 10, 2, 0, S },
    { -15, 100, 20, 100, 0, 0, { 20, 20 }, 10, 2, 0, Y }, /* 0.11 * 100 + 3.5, and 0.3 * 100 + 3.5 */
    { -14, 100, 30, 100, 0, 0, { 20, 20 }, 10, 2, 0, 0 },
    { -15, 100, 18, 100, 0, 0, { 20, 20 }, 10, 2, 0, 0 },
    { -15, 100, 10, 50, 0, 0, { 20, 20 }, 10, 2, 0, Y },
    { -3, 7.5, 5, 100, 0, 0, { 20, 20 }, 10, 2, 0, 0 },
    { -3, 8.5, 5, 100, 0, 0, { 20, 20 }, 10, 2, 0, 0 },
    { -5, 7.5, 5, 100, 0, 0, { 20, 20 }, 10, 2, 0, 0 },
    { -5, 8.5, 5, 100, 0, 0, { 20, 20 }, 10, 2, 0, Y },
    { 30, 100, 0, 100, 0, 0, { 14, 20 }, 10, 2, 0, 0 }, /* too short */
    { 30, 100, 0, 100, 0, 0, { 20, 14 }, 10, 2, 0, 0 },
    { 30, 100, 0, 100, 0, 0, { 20, 20 }, 4.9, 2, 0, 0 }, /* slow */
    { 30, 100, 0, 100, 0, 0, { 20, 20 }, 10, 0.9, 0, 0 },
    { 0, 100, 0, 100, 0, 0, { 20, 20 }, 10, 0.9, Y, Y }, /* undecided: as before */
  };
  tse_params p = prepared(config_by(tse_config_exact));
  for (int n = 0; n < ROWS(cases); n++) {
    tse_kalman k = even_state();
    tse_agreement *const a = &k.agreement;
    tse_input u = even_row(&p);
    p.uncertain[CONSIDER_ACCEL_LATE] = real(cases[n].settings);
    a->across.late = real(cases[n].across), a->across.square = real(cases[n].square);
    a->steered.late = real(cases[n].steered), a->steered.square = real(cases[n].asked);
    a->lags = real(cases[n].lags), a->complete_for = real(cases[n].complete_for), a->apart = cases[n].was;
    a->pair[ACROSS].time = real(cases[n].time[0]), a->pair[TURNING_BY].time = real(cases[n].time[1]);
    a->smooth[3] = real(cases[n].speed);
    u.wheel_speed_front = r_div(real(cases[n].speed), p.radius_front);
    u.wheel_speed_rear = r_div(real(cases[n].speed), p.radius_rear);
    check_agreement(&p, &k, &u, real(0.001), 0);
    char text[40];
    (void)snprintf(text, sizeof text, "case %d", n);
    TEST_ASSERT_EQUAL_INT_MESSAGE(cases[n].is, a->apart, text);
  }
}

/* Latency and limit of a lag, estimated from a drive in which a channel is late by a
 * known time. The car is that of the comment at update_timings(): a_y = v r + v_y', v_y =
 * (l_r - T v) r, and at the IMU the yaw acceleration times its lever. */
static void test_a_latency_is_found_apart_from_the_lag_of_the_car(void)
{
  static const struct {
    double accel_y, yaw_rate, lever; /* [s] [s] [m] */
    double from, now;                /* logarithm of the rear stiffness before the change, and now */
    int32_t change;
    double softening;
  } cases[] = {
    { 0, 0, 0, 0, 0, TSE_CHANGE_NONE, 0.4 },
    { 0.1, 0, 0, 0, 0, TSE_CHANGE_NONE, 0.4 },
    { 0, 0.1, 0, 0, 0, TSE_CHANGE_NONE, 0.4 },
    { 0.05, 0, 1, 0.2, -0.3, TSE_CHANGE_ROAD, 0.4 + 0.64872 }, /* e^0.5 - 1 */
    { 0.05, 0, -1, 2, -0.3, TSE_CHANGE_ROAD, 0.4 + 1.71828 },  /* at most e - 1 */
    { 0, 0, 0, -0.5, 0, TSE_CHANGE_ROAD, 0.4 },
    { 0, 0, 0, 0.5, 0, TSE_CHANGE_REAR, 0.4 },
  };
  tse_params p = prepared(config_by(tse_config_exact));
  const double lf = number(p.car.lf), lr = number(p.car.lr), kf = number(p.car.ky_front),
               kr = number(p.car.ky_rear), length = lf + lr, v = 15, w = 2, dt = 0.02, bias = 0.3;
  const double understeer = (lr * kr - lf * kf) / (length * kf * kr), slip_time = v * lf / (length * kr);
  for (int n = 0; n < ROWS(cases); n++) {
    static tse_kalman k;
    memset(&k, 0, sizeof k);
    p.car.lever_x = real(cases[n].lever);
    k.x[BR] = real(bias), k.x[LCR] = real(cases[n].now);
    k.change_kind = cases[n].change, k.change_from[TSE_CY_FRONT] = TSE_R(-2);
    k.change_from[TSE_CY_REAR] = real(cases[n].from);
    const double arm = lr + cases[n].lever - v * slip_time;
    for (int row = 0; row < 1500; row++) {
      const double t = dt * row, ty = t - cases[n].accel_y, tr = t - cases[n].yaw_rate;
      tse_input u = even_row(&p);
      u.wheel_speed_front = real(v / number(p.radius_front));
      u.wheel_speed_rear = real(v / number(p.radius_rear));
      u.steer_angle = real(0.1 * sin(w * t) * (length + understeer * v * v) / v);
      u.yaw_rate = real(0.1 * sin(w * tr) + bias);
      u.accel_y = real(0.1 * (v * sin(w * ty) + arm * w * cos(w * ty)) - 0.3);
      if (row == 1200) u.yaw_rate = TSE_R(5); /* counts for nothing, as no car can do that */
      const double square = number(k.agreement.across.square);
      check_agreement(&p, &k, &u, real(dt), 0);
      if (row == 1200) TEST_ASSERT_TRUE(number(k.agreement.across.square) <= square);
      if (row == 1199) {
        const tse_timing *const a = &k.agreement.across, *const s = &k.agreement.steered;
        expect_near(
            cases[n].accel_y - cases[n].yaw_rate, number(a->late) / number(a->square), 0.012, "accel_y", n);
        expect_near(cases[n].yaw_rate, number(s->late) / number(s->square), 0.012, "yaw rate", n);
        /* the low pass leaves 1/(1 + (w 0.25 s)^2) of a square; the sums start after 1 s */
        const double time = number(SCALE_TIME) * (1 - exp(-(dt * 1200 - 1) / number(SCALE_TIME)));
        expect_near(0.5 * pow(0.1 * v * w, 2) / (1 + pow(w * 0.25, 2)) * time, number(a->square),
            0.05 * number(a->square), "square of the jerk", n);
        expect_near(cases[n].softening * slip_time + number(LEVER) / v,
            number(k.agreement.lags) / number(a->square), BY_NUMBER(1e-4, 1e-3, 2e-3), "lag", n);
      }
    }
  }
}

/* Which channel is wrong follows from the pairs that disagree: it is what they have in
 * common. Its factor follows from its pair, in which it is the first or the second. */
static void test_the_wrong_channel_is_what_the_pairs_have_in_common(void)
{
  enum { C = 1 << ACROSS, T = 1 << TURNING_BY, L = 1 << ALONG };
  enum {
    STEERED = 1 + TSE_CHANNEL_steer_angle,
    WHEELS = 1 + TSE_CHANNEL_wheel_speed_front,
    AHEAD = 1 + TSE_CHANNEL_accel_x,
    SIDE = 1 + TSE_CHANNEL_accel_y,
    TURNS = 1 + TSE_CHANNEL_yaw_rate
  };
  static const struct {
    int apart, off_scale;
    double across, turning, along; /* second quantity of the pair / first one; 0: not related */
    double sums[4];                /* of the scale: ACROSS, ALONG */
    int channel;
    double factor;
  } cases[] = {
    { 0, 0, 1, 1, 1, { 0 }, 0, 0 },
    { 1 << STEER_LATE_BIT, 0, 1, 1, 1, { 0 }, STEERED, 0 },
    { 1 << ACCEL_LATE_BIT, 0, 1, 1, 1, { 0 }, SIDE, 0 },
    { 1 << YAW_LATE_BIT, 0, 1, 1, 1, { 0 }, TURNS, 0 },
    { 1 << ACCEL_LATE_BIT, 1, 1, 1, 1, { 0 }, SIDE, 0 },
    { C | 1 << YAW_LATE_BIT, 0, 5, 1, 1, { 0 }, SIDE, 5 },
    { 0, 1, 1, 1, 1, { 30, 25, 20, 26 }, WHEELS, 1.24900 }, /* root of 1.3 * 1.2 */
    { 0, 1, 0.5, 1, 2, { 10, 25, 20, 26 }, WHEELS, 2 },
    { 0, 1, 0.5, 1, 3, { 30, 25, 9, 26 }, WHEELS, 2.44949 }, /* root of 2 * 3 */
    { L | T, 0, 1, 2, 3.6, { 0 }, WHEELS, 3.6 },
    { L | T, 0, 1, 2, -1, { 0 }, WHEELS, -1 },
    { L | C, 0, 1 / 3.6, 1, 3.6, { 0 }, WHEELS, 3.6 },
    { L | C, 0, 3, 1, 0.3, { 0 }, WHEELS, 0.3 },
    { L | C, 0, 1 / 9.8, 1, 9.8, { 0 }, SIDE, 1 / 9.8 }, /* both in g */
    { L | C, 0, 10, 1, 0.1, { 0 }, SIDE, 10 },
    { L | C, 0, -1, 1, -1, { 0 }, SIDE, -1 },
    { L, 0, 1, 1, 0.25, { 0 }, AHEAD, 4 },
    { L, 0, 1, 1, -1, { 0 }, AHEAD, -1 },
    { L, 0, 1, 1, 0, { 0 }, AHEAD, 0 },
    { T, 0, 1, 0.125, 1, { 0 }, STEERED, 8 },
    { T, 0, 1, 0.125, 3, { 0 }, WHEELS, 3 }, /* ALONG disagrees, too, except for a slope */
    { T, 0, 1, 0.125, 0, { 0 }, STEERED, 8 },
    { C, 0, 0.3, 1, 3, { 0 }, WHEELS, 3 },
    { T | C, 0, 0.02, 50, 1, { 0 }, TURNS, 50 },
    { C, 0, 0.25, 1, 1, { 0 }, SIDE, 0.25 },
    { C, 0, 0, 1, 1, { 0 }, SIDE, 0 },
    { 1 << IN_BENDS, 0, 1, 1, 1, { 0 }, WHEELS, 0 },
    { 1 << BY_DRIVE, 0, 1, 1, 1, { 0 }, WHEELS, 0 },
  };
  for (int n = 0; n < ROWS(cases); n++) {
    static tse_kalman k;
    const double ratio[3] = { cases[n].across, cases[n].turning, cases[n].along };
    tse_real factor = broken();
    memset(&k, 0, sizeof k);
    k.agreement.apart = cases[n].apart, k.agreement.off_scale = cases[n].off_scale;
    for (int i = 0; i < 3; i++)
      k.agreement.pair[i] = ratio[i] < 0 || ratio[i] > 0
          ? pair_of(20, 1, ratio[i] * ratio[i], 0.95 * ratio[i])
          : pair_of(20, 1, 1, 0.3);
    for (int i = 0; i < 4; i++) k.agreement.moved[i / 2][i % 2] = real(cases[n].sums[i]);
    char text[40];
    (void)snprintf(text, sizeof text, "case %d", n);
    TEST_ASSERT_EQUAL_INT_MESSAGE(cases[n].channel, find_implausible_channel(&k, &factor), text);
    expect_near(cases[n].factor, number(factor), 1e-4 * (1 + fabs(cases[n].factor)), "factor", n);
  }
}

/* A pair is compared in rows with all channels of which it is made, none of them out of
 * range. The axles are compared only if there are two signals. */
static void test_a_pair_is_compared_where_its_channels_are_there(void)
{
  enum { C = 1 << ACROSS, T = 1 << TURNING_BY, L = 1 << ALONG, B = 1 << IN_BENDS, D = 1 << BY_DRIVE };
  static const struct {
    uint32_t missing;
    int no_second;
    double accel_x, accel_y, front, rear; /* [m/s2] [m/s] */
    int compared;
  } cases[] = {
    { 0, 0, 0, 1, 10, 10, C | T | L | B | D },
    { TSE_MISSING_accel_x, 0, 0, 1, 10, 10, C | T | B },
    { TSE_MISSING_accel_y, 0, 0, 1, 10, 10, T | L | B | D },
    { TSE_MISSING_yaw_rate, 0, 0, 1, 10, 10, L | D },
    { TSE_MISSING_steer_angle, 0, 0, 1, 10, 10, C | L | B | D },
    { TSE_MISSING_wheel_speed_front, 0, 0, 1, 10, 10, C | T },
    { TSE_MISSING_wheel_speed_rear, 0, 0, 1, 10, 10, C | T },
    { 0, 1, 0, 1, 10, 10, C | T | L },
    { 0, 0, 0, 1000, 10, 10, T | L | B | D },
    { 0, 0, -1, 1, 10, 10, C | T | L | B }, /* may brake */
    { 0, 0, 0, 1, 10.5, 10, C | T | D },    /* the front wheels spin */
    { 0, 0, 0, 1, 1, 1, 0 },                /* slow */
  };
  const tse_params p = prepared(config_by(tse_config_exact));
  for (int n = 0; n < ROWS(cases); n++) {
    tse_kalman k = even_state();
    tse_input u = even_row(&p);
    u.wheel_speed_front = real(cases[n].front / number(p.radius_front));
    u.wheel_speed_rear = real(cases[n].rear / number(p.radius_rear));
    u.missing = cases[n].missing, u.accel_x = real(cases[n].accel_x), u.accel_y = real(cases[n].accel_y);
    k.agreement.smooth[2] = u.accel_x;
    check_agreement(&p, &k, &u, real(0.01), cases[n].no_second);
    int compared = 0;
    for (int i = 0; i < TSE_PAIRS; i++) compared |= (k.agreement.pair[i].time > TSE_R(0)) << i;
    char text[40];
    (void)snprintf(text, sizeof text, "case %d", n);
    TEST_ASSERT_EQUAL_HEX_MESSAGE(cases[n].compared, compared, text);
    if (cases[n].compared) /* one wheel speed alone is the speed */
      expect_near(10, number(k.agreement.smooth[3]), 0.01 + 0.02 * (cases[n].front > 10), "speed", n);
  }
}

/* After more than 0.35 s without a wheel speed the low passes start at the values of the
 * row, except for accel_x, and nothing is compared. A shorter time counts as one row. */
static void test_after_a_gap_the_low_passes_start_again(void)
{
  const tse_params p = prepared(config_by(tse_config_exact));
  for (int longer = 0; longer < 2; longer++) {
    tse_kalman k = even_state();
    const int rows = longer ? 8 : 5;
    const double dt = 0.05, smooth = number(SMOOTH_TIME), value[6] = { 1, 11 * 0.2, 2, 11, 0.2, 0 };
    k.agreement.complete_for = TSE_R(5);
    for (int row = 0; row < rows; row++) {
      tse_input u = even_row(&p);
      u.wheel_speed_front = r_mul(u.wheel_speed_front, real(1.1));
      u.wheel_speed_rear = r_mul(u.wheel_speed_rear, real(1.1));
      u.accel_x = TSE_R(2), u.accel_y = TSE_R(1), u.yaw_rate = real(0.2);
      if (row < rows - 1) u.missing = TSE_MISSING_wheel_speed_front | TSE_MISSING_wheel_speed_rear;
      check_agreement(&p, &k, &u, real(dt), 0);
    }
    const double gain = longer ? 1 : rows * dt / (rows * dt + smooth);
    for (int i = 0; i < 6; i++) {
      const double from = i == 3 ? 10 : 0;
      expect_near(longer && i == 2 ? 0 : from + gain * (value[i] - from), number(k.agreement.smooth[i]), 1e-4,
          "low-passed", 10 * longer + i);
    }
    expect_near(longer ? 0 : rows * dt, number(k.agreement.pair[ACROSS].time), 1e-4, "compared for", longer);
    expect_near(longer ? 0 : 1 / (rows * dt + smooth), number(k.agreement.pair[ALONG].mean[1]), 1e-3,
        "rate of the speed", longer);
    expect_near(0, number(k.agreement.complete_for), 0, "complete rows", longer);
  }
}

/* Values that no car has are limited, so that their squares fit every number format. At
 * the critical speed of an oversteering car its turn would be infinite: its wheelbase
 * counts as 0.3 of the true one or more. */
static void test_values_of_no_car_are_limited(void)
{
  tse_params p = prepared(config_by(tse_config_exact));
  for (int side = -1; side <= 1; side += 2) {
    tse_kalman k = even_state(), fresh;
    tse_input u = even_row(&p);
    memset(&fresh, 0, sizeof fresh);
    u.wheel_speed_front = r_div(TSE_R(110), p.radius_front);
    u.wheel_speed_rear = r_div(TSE_R(110), p.radius_rear);
    u.yaw_rate = TSE_R(5 * side);
    check_agreement(&p, &fresh, &u, real(0.01), 0);
    expect_near(200 * side, number(fresh.agreement.smooth[1]), 1e-3, "speed times yaw rate", side);
    check_agreement(&p, &k, &u, real(0.01), 0);
    expect_near(200, number(k.agreement.pair[ALONG].mean[1]), 1e-3, "rate of the speed", side);
  }
  tse_kalman k;
  tse_input u = even_row(&p);
  const double length = number(p.car.lf) + number(p.car.lr);
  p.car.ky_rear = real(0.3 * number(p.car.ky_front)); /* oversteers */
  u.wheel_speed_front = r_div(TSE_R(50), p.radius_front);
  u.wheel_speed_rear = r_div(TSE_R(50), p.radius_rear);
  u.steer_angle = real(0.02);
  memset(&k, 0, sizeof k);
  check_agreement(&p, &k, &u, real(0.01), 0);
  expect_near(50 * 0.02 / (0.3 * length), number(k.agreement.smooth[5]), 1e-3, "turn of the angle", 0);
}
