/* tests/unit/filter/test_predict.c <-> src/filter/predict.c, start.c: prediction of state
 * and covariance to the time of a row, and the start of a drive. */
#include "filter/predict.h"
#include "filter/slip_stiffness.h"
#include "filter/start.h"
#include "filter_support.h"

static tse_params a_car(void)
{
  tse_config c = config_by(tse_config_exact);
  c.grade_sd = setting(0.03), c.grip = setting(1), c.grip_sd = setting(0.2),
  c.steer_offset_sd = setting(0.004);
  c.steer_ratio_sd = setting(0.03), c.relaxation_length = setting(0.4), c.relaxation_sd = setting(0.2);
  c.yaw_inertia_sd = setting(0.1), c.cg_sd = setting(0.03);
  return prepared(c);
}

static decoded a_row(double dt, double steer)
{
  decoded z = { 0 };
  z.dt = real(dt), z.steer = real(steer), z.has_steer = 1;
  return z;
}

/* States that return to their means. */
static int fades(int i) { return i == SF || i == SR || i == GX || i == GY; }

static void in_a_turn(const tse_params *p, tse_kalman *k, uint32_t *seed)
{
  memset(k, 0, sizeof *k);
  any_covariance(&k->ud, seed);
  for (int i = 0; i < STATES; i++) k->x[i] = real(0.2 * number(state_unit[i]) * next_between(seed, -1, 1));
  k->x[VX] = TSE_R(20), k->steer[0] = k->steer[1] = k->steer[2] = real(0.02);
  for (int q = 0; q < TSE_CONSIDERED; q++)
    for (int i = 0; i < STATES; i++)
      if (p->uncertain[q] > TSE_R(0)) k->consider[q][i] = short_of(next_between(seed, -0.2, 0.2));
}

/* The state moves as the car does. The covariance becomes F P F' + Q, with Q diagonal and
 * not negative. Uncertain parameters are propagated by F. */
static void test_a_row_is_the_time_update_of_a_kalman_filter(void)
{
  const double close = BY_NUMBER(1e-10, 1e-3, 1e-5);
  uint32_t seed = 1;
  for (int n = 0; n < 30; n++) {
    static tse_kalman k;
    const tse_params p = a_car();
    tse_short scaled[MOTION][PLACES];
    tse_real x[TSE_VALUES], M[MOTION][PLACES];
    double F[STATES][STATES], moved[STATES][STATES];
    in_a_turn(&p, &k, &seed);
    const dense m = dense_of(&k.ud);
    const tse_kalman before = k;
    const decoded z = a_row(0.01, 0.023);
    const steering u = { real(0.02), real(0.023), real(0.01) };
    memcpy(x, k.x, sizeof x);
    car_move(&p.car, x, u, scaled);
    for (int i = 0; i < MOTION; i++)
      for (int j = 0; j < COLUMNS; j++) M[i][j] = r_long_scaled(scaled[i][j], ROW_UP);
    weaken(M, MOTION, &before);
    (void)predict_row(&p, &k, &z);
    for (int i = 0; i < STATES; i++)
      if (!fades(i))
        expect_near(
            number(x[i]), number(k.x[i]), close, "state", i); /* slips and gravity return to their mean */
    for (int i = 0; i < STATES; i++)
      for (int j = 0; j < STATES; j++)
        F[i][j] = i < MOTION ? number(M[i][j]) * number(state_unit[j]) / number(state_unit[i]) : i == j;
    for (int i = 0; i < STATES;
        i++) { /* compare the decay where the effect of uncertain parameters is largest */
      if (!fades(i)) continue;
      int most = 0;
      for (int q = 1; q < TSE_CONSIDERED; q++)
        if (fabs(number_of(before.consider[q][i])) > fabs(number_of(before.consider[most][i]))) most = q;
      F[i][i] = number_of(k.consider[most][i]) / number_of(before.consider[most][i]);
      TEST_ASSERT_TRUE(F[i][i] > 0.9 && F[i][i] <= 1);
    }
    conjugate(STATES, F[0], m.p[0], moved[0]);
    const dense after = dense_of(&k.ud);
    for (int i = 0; i < STATES; i++)
      for (int j = 0; j < STATES; j++) {
        const double expected = moved[i][j];
        if (i == j)
          TEST_ASSERT_TRUE(
              after.p[i][i] > expected - 10 * close && after.p[i][i] < expected + 0.2); /* process noise */
        else expect_near(expected, after.p[i][j], 100 * close, "covariance", 100 * i + j);
      }
    for (int q = 0; q < TSE_CONSIDERED; q++)
      for (int i = 0; i < STATES; i++) {
        double expected = 0;
        for (int l = 0; l < STATES; l++) expected += F[i][l] * number_of(before.consider[q][l]);
        if (i < MOTION && q < COLUMNS - STATES)
          expected += number(M[i][STATES + q]) / number(state_unit[i]) * number(p.uncertain[q]);
        expect_near(expected, number_of(k.consider[q][i]), 10 * close, "what is uncertain", 100 * q + i);
      }
  }
}

/* From any start, gravity along and across the road returns to its mean, with the
 * variance of roads. The stiffness is a random walk without drift. */
static void test_at_rest_gravity_forgets_and_stiffness_does_not(void)
{
  static tse_kalman k;
  const tse_params p = a_car();
  uint32_t seed = 2;
  in_a_turn(&p, &k, &seed);
  const tse_kalman before = k;
  const int at = HAS_SLIP ? GX : GY;
  k.x[at] = real(3);
  for (int n = 0; n < 100; n++) predict_slow_states(&p, &k, real(10));
  expect_near(number(p.prior[at]), number(k.x[at]), 1e-6, "gravity", 0);
  const double sd = sqrt(number(ud_variance(&k.ud, at))) * number(state_unit[at]);
  TEST_ASSERT_TRUE(sd > 0.05 && sd < 1);
  for (int i = 0; i < STATES; i++)
    if (i != at) expect_near(0, fabs(number(ud_covariance(&k.ud, at, i))), 1e-4, "nothing in common", i);
  for (int i = FAST; i < STATES; i++) {
    TEST_ASSERT_EQUAL_MEMORY(&before.x[i], &k.x[i], sizeof k.x[i]);
    TEST_ASSERT_TRUE(number(ud_variance(&k.ud, i))
        >= number(ud_variance(&before.ud, i)) * (1 - BY_NUMBER(1e-9, 1e-4, 1e-5)));
  }
}

#if !defined(TSE_SMALL) /* there in each row */
/* Each slow state receives its process noise once in as many rows as there are slow
 * states; a stiffness receives the remainder of its changes. A row treats one state. */
static void test_slow_states_have_their_noise_in_turn(void)
{
  static tse_kalman k;
  const tse_params p = a_car();
  uint32_t seed = 3;
  in_a_turn(&p, &k, &seed);
  const tse_kalman before = k;
  for (int a = 0; a < 3; a++) k.moved[a] = real(0.25);
  for (int n = 0; n < TSE_SLOW; n++) {
    const tse_kalman was = k;
    predict_slow_states(&p, &k, real(0.01));
    for (int i = FAST; i < STATES; i++)
      if (i != PLACED + n)
        expect_near(number(ud_variance(&was.ud, i)), number(ud_variance(&k.ud, i)),
            BY_NUMBER(1e-9, 1e-4, 1e-5), "not its turn", i);
  }
  for (int a = HAS_SLIP ? 0 : 1; a < 3; a++) {
    const int i = stiffness_at(a);
    TEST_ASSERT_EQUAL_INT(1, k.moved[a] == TSE_R(0));
    const double more = number(ud_variance(&k.ud, i)) - number(ud_variance(&before.ud, i));
    TEST_ASSERT_TRUE(more > 0.249 && more < 0.26);
  }
}
#endif

static decoded on_road(double dt, uint32_t given, double bank, double grade)
{
  decoded z = a_row(dt, 0.02);
  z.given = given, z.optional[TSE_OPTIONAL_bank] = real(bank), z.optional[TSE_OPTIONAL_grade] = real(grade);
  return z;
}

static void expect_road(const tse_kalman *k, int at, double mean, double sd, int when)
{
  expect_near(mean, number(k->x[at]), BY_NUMBER(1e-12, 3e-6, 1e-6), "gravity", when);
  if (at < STATES)
    expect_near(sd, sqrt(number(ud_variance(&k->ud, at))) * number(state_unit[at]), 1e-5, "sd",
        when); /* 2^-24 of the variance before */
}

/* While a slope is given, the state is g sin(angle) with the sd of the setting, whatever
 * it was before. The deviation from it is predicted. */
static void test_a_given_road_is_where_gravity_is(void)
{
  static tse_filter f;
  tse_config c = config_by(tse_config_exact);
  c.grade_sd = setting(0.03), c.road_sd = setting(0.004), c.bank_angle = setting(0.01);
  const tse_params p = prepared(c);
  tse_kalman *const k = &f.k;
  const double g = 9.81, sd = 0.004 * g, along = HAS_SLIP ? 0.03 * g : 0, across = number(BANK_SD);
  memset(&f, 0, sizeof f);
  start_state(&p, &f);
  static const struct {
    uint32_t given;
    double bank, grade;
  } row[] = { { TSE_GIVEN_bank, 0.05, 9 }, { TSE_GIVEN_bank | TSE_GIVEN_grade, -0.03, 0.02 },
    { TSE_GIVEN_grade, 9, -0.04 }, { 0, 9, 9 } };
  for (int n = 0; n < 4; n++) {
    const decoded z = on_road(0.01, row[n].given, row[n].bank, row[n].grade);
    const int bank = (row[n].given & TSE_GIVEN_bank) != 0, grade = (row[n].given & TSE_GIVEN_grade) != 0;
    update_road(&p, k, &z);
    predict_slow_states(&p, k, real(0.01));
    expect_road(k, GY, -g * sin(bank ? row[n].bank : 0.01), bank ? sd : across, n);
    expect_road(k, GX, grade ? g * sin(row[n].grade) : 0, grade ? sd : along, n);
  }
  const decoded first = on_road(0.01, TSE_GIVEN_bank, 0.05, 0), then = on_road(0.01, TSE_GIVEN_bank, 0.02, 0);
  update_road(&p, k, &first);
  k->x[GY] += real(0.03);
  update_road(&p, k, &then);
  expect_road(k, GY, 0.03 - g * sin(0.02), sd, 4);
}

/* If the settings are more accurate than the given road, the settings count. */
static void test_a_given_road_is_no_less_sure_than_one_that_is_not(void)
{
  static tse_filter f;
  tse_config c = config_by(tse_config_exact);
  c.road_sd = setting(0.1);
  const tse_params p = prepared(c);
  const decoded z = on_road(0.01, TSE_GIVEN_bank, 0.05, 0);
  memset(&f, 0, sizeof f);
  start_state(&p, &f);
  update_road(&p, &f.k, &z);
  expect_road(&f.k, GY, -9.81 * sin(0.05), number(BANK_SD), 0);
}

/* With a given bank, superelevation of curves and its uncertainty have no effect, as for
 * settings without them on a road with this constant bank. */
static void test_a_given_bank_is_all_of_it(void)
{
  static tse_filter given, same;
  tse_config c = config_by(tse_config_exact);
  c.bank_superelevation = setting(0.1), c.lean_sd = setting(0.05),
  c.road_sd = setting(0.02); /* above BANK_SD: the uncertainty is as without */
  const tse_params p = prepared(c);
  c.bank_superelevation = setting(0), c.lean_sd = setting(0), c.bank_angle = setting(0.04);
  const tse_params q = prepared(c);
  memset(&given, 0, sizeof given), memset(&same, 0, sizeof same);
  start_state(&p, &given), start_state(&q, &same);
  given.k.x[VX] = same.k.x[VX] = TSE_R(20), given.k.x[YAW] = same.k.x[YAW] = real(0.2);
  for (int n = 0; n < 20; n++) {
    const decoded z = on_road(0.01, TSE_GIVEN_bank, 0.04, 0), plain = a_row(0.01, 0.02);
    update_road(&p, &given.k, &z);
    (void)predict_row(&p, &given.k, &z), (void)predict_row(&q, &same.k, &plain);
  }
  for (int i = 0; i < STATES; i++) {
    if (i == LEAN) continue;
    expect_near(number(same.k.x[i]), number(given.k.x[i]), BY_NUMBER(1e-12, 1e-5, 1e-7), "state", i);
    expect_near(number(ud_variance(&same.k.ud, i)), number(ud_variance(&given.k.ud, i)),
        BY_NUMBER(1e-12, 1e-4, 1e-6), "variance", i);
  }
  expect_near(0.1, number(given.k.x[LEAN]), BY_NUMBER(1e-12, 1e-6, 1e-8), "what is known of roads stays", 0);
}

/* One second in 100 rows gives the same variance as in 20 rows. */
static void test_noise_does_not_depend_on_how_often_rows_come(void)
{
  static tse_kalman k[2];
  const tse_params p = a_car();
  for (int often = 0; often < 2; often++) {
    tse_real variance[STATES];
    memset(&k[often], 0, sizeof k[often]);
    for (int i = 0; i < STATES; i++) variance[i] = real(0.01);
    ud_set(&k[often].ud, variance);
    k[often].x[VX] = TSE_R(20);
    const int rows = often ? 200 : 40;
    for (int n = 0; n < rows; n++) {
      const decoded z = a_row(2.0 / rows, 0);
      (void)predict_row(&p, &k[often], &z);
    }
  }
  for (int i = VX; i < FAST; i++) {
    const double a = number(ud_variance(&k[0].ud, i)), b = number(ud_variance(&k[1].ud, i));
    if (i < AF || i >= MOTION) expect_near(a, b, 0.05 * a, "variance", i);
  }
}

static void test_all_starts_as_the_settings_say(void)
{
  static tse_filter f;
  const tse_params p = a_car();
  memset(&f, 0, sizeof f);
  start_state(&p, &f);
  for (int i = 0; i < STATES; i++) {
    const double sd = number(p.prior_sd[i]) / number(state_unit[i]);
    expect_near(number(p.prior[i]), number(f.k.x[i]), 0, "mean", i);
    expect_near(sd * sd, number(ud_variance(&f.k.ud, i)), BY_NUMBER(1e-12, 1e-6, 1e-8) * (1 + sd * sd),
        "variance", i);
    for (int j = 0; j < i; j++)
      expect_near(0, number(ud_covariance(&f.k.ud, i, j)), 0, "nothing in common", i);
  }
}

/* After a restart in a steady turn, the motion is that of the turn. Learnt states are
 * unchanged, bit for bit. */
static void test_motion_is_placed_from_wheels_and_gyro(void)
{
  static tse_kalman k;
  const tse_params p = a_car();
  uint32_t seed = 3;
  in_a_turn(&p, &k, &seed);
  k.x[BR] = real(0.01), k.x[LCF] = k.x[LCR] = TSE_R(0);
  const tse_kalman before = k;
  decoded z = a_row(0.01, 0.02);
  z.use[2] = z.use[3] = z.use[4] = 1, z.z[2] = real(0.16), z.z[3] = z.z[4] = TSE_R(20);
  start_motion(&p, &k, &z);
  const double lf = number(p.car.lf), lr = number(p.car.lr), across = 20 * 0.15,
               front = across * lr / (lf + lr) / number(p.car.ky_front),
               back = across * lf / (lf + lr) / number(p.car.ky_rear);
  expect_near(20, number(k.x[VX]), 0, "vel_x", 0);
  expect_near(0.15, number(k.x[YAW]), 1e-7, "yaw rate", 0);
  expect_near(front, number(k.x[AF]), 1e-6, "slip angle, front", 0);
  expect_near(back, number(k.x[AR]), 1e-6, "slip angle, rear", 0);
  expect_near(lr * 0.15 - 20 * back, number(k.x[VY]), 1e-5, "vel_y", 0);
  for (int i = FAST; i < STATES; i++) {
    TEST_ASSERT_EQUAL_MEMORY(&before.x[i], &k.x[i], sizeof k.x[i]);
    for (int j = FAST; j < STATES; j++)
      TEST_ASSERT_TRUE(!(ud_covariance(&before.ud, i, j) != ud_covariance(&k.ud, i, j)));
  }
  for (int i = 0; i < PLACED; i++) {
    for (int j = 0; j < STATES; j++)
      if (i != j) expect_near(0, number(ud_covariance(&k.ud, i, j)), 0, "nothing in common", 100 * i + j);
    for (int q = 0; q < TSE_CONSIDERED; q++)
      expect_near(0, number_of(k.consider[q][i]), 0, "not uncertain", i);
  }
}

#if !defined(TSE_SMALL) /* no slip stiffness there */
/* Stiffness and model error are observed only as a sum. For any drives, the reported
 * stiffness is that of a Kalman filter with both as states. */
static void test_of_a_sum_its_part_is_that_of_a_filter_of_both(void)
{
  const double close = BY_NUMBER(1e-9, 2e-5, 2e-5);
  uint32_t seed = 5;
  for (int drive = 0; drive < 50; drive++) {
    tse_config c = config_by(tse_config_exact);
    c.initial_cx_sd = setting(next_between(&seed, 0.04, 0.3));
    c.model_sd = setting(next_between(&seed, 0, 0.2));
    const tse_params p = prepared(c);
    static tse_filter f;
    memset(&f, 0, sizeof f);
    start_state(&p, &f);
    const double lacks = pow(fmax(number(USUAL_MODEL_SD), number(p.model_sd)), 2),
                 unit = number(state_unit[LCX]);
    double mean[2] = { number(p.prior[LCX]), 0 },
           P[2][2] = { { pow(number(p.prior_sd[LCX]), 2), 0 }, { 0, lacks } };
    for (int n = 0; n < 20; n++) {
      const double z = next_between(&seed, -0.3, 0.3), r = pow(next_between(&seed, 0.05, 0.5), 2),
                   s = P[0][0] + 2 * P[0][1] + P[1][1] + r, off = z - mean[0] - mean[1];
      const double g[2] = { (P[0][0] + P[0][1]) / s, (P[0][1] + P[1][1]) / s };
      tse_real h[TSE_ALL] = { TSE_R(0) }, u[TSE_ALL], v[TSE_ALL], gain[TSE_ALL], var;
      h[LCX] = TSE_R(1);
      const tse_real own = ud_measure(&f.k.ud, h, u, v);
      ud_correct(&f.k.ud, u, v, own, real(r / (unit * unit)), gain);
      f.k.x[LCX] += r_mul(gain[LCX], real(z - number(f.k.x[LCX])));
      for (int i = 0; i < 2; i++) mean[i] += g[i] * off;
      for (int i = 0; i < 2; i++)
        for (int j = i; j < 2; j++) P[i][j] = P[j][i] = P[i][j] - g[i] * g[j] * s;
      const double share = number(along_share(&p, &f.k, ud_variance(&f.k.ud, LCX), &var));
      expect_near(mean[0], number(f.k.along.mean) + share * (number(f.k.x[LCX]) - number(f.k.along.mean)),
          close, "part", n);
      expect_near(P[0][0], number(var), close, "its variance", n);
    }
  }
}
#endif

/* A steering without lag has the logged angle at both ends of a row. With lags in series,
 * the angle of a step at the first row is the response of a cascade, integrated here in
 * steps of 1/500 of a row. The input of each lag changes linearly within a row. */
static void test_the_wheels_have_the_logged_angle_after_the_lags_of_the_steering(void)
{
  static const double lag[][2] = { { 0, 0 }, { 0.1, 0 }, { 0.1, 0.04 } };
  for (int n = 0; n < ROWS(lag); n++) {
    static tse_kalman k;
    uint32_t seed = 4;
    tse_params p = a_car();
    double y[3] = { 0, 0, 0 };
    in_a_turn(&p, &k, &seed);
    p.steer_lag = real(lag[n][0]), p.steer_lag_second = real(lag[n][1]);
    k.steer[0] = k.steer[1] = k.steer[2] = TSE_R(0);
    for (int row = 0; row < 8; row++) {
      const double to = row < 4 ? 0.02 * (row + 1) : 0.08, from = row < 5 ? 0.02 * row : 0.08, was = y[2];
      const decoded z = a_row(0.01, to);
      k.x[VX] = TSE_R(20);
      const steering u = predict_row(&p, &k, &z);
      const double middle = y[1];
      y[0] = to;
      for (int pass = 1; pass <= 2; pass++) { /* the input of a lag changes linearly in the row */
        const double start = pass == 1 ? from : middle, end = y[pass - 1], time = lag[n][pass - 1];
        for (int i = 0; i < 500 && time > 0; i++) {
          const double h = 0.01 / 500;
          y[pass] += h / (time + 0.5 * h) * (start + (end - start) * (i + 0.5) / 500 - y[pass]);
        }
        if (!(time > 0)) y[pass] = end;
      }
      expect_near(was, number(u.from), 1e-5, "from", row);
      expect_near(y[2], number(u.to), 1e-5, "to", row);
      for (int i = 0; i < 3; i++) expect_near(y[i], number(k.steer[i]), 1e-5, "after so many lags", i);
    }
  }
}

/* A row that does not show the slip: the force that accel_x measures, plus what drag and
 * rolling resistance take, over the stiffness of the axles that it acts at. It acts at
 * the driven axle, and at both if the car brakes or the driven axle is unknown. The slip
 * approaches it with the time constant 0.1 s, and keeps within max_slip. */
static void test_without_a_second_speed_the_slip_is_that_of_the_force(void)
{
  static const struct {
    double accel;
    int use, driven, rolls, axles; /* axles: bit 0 front, bit 1 rear */
  } cases[] = { { 2, 1, 0, ROLLS_UNKNOWN, 3 }, { 2, 1, 1, ROLLS_UNKNOWN, 1 }, { 2, 1, 2, ROLLS_UNKNOWN, 2 },
    { -3, 1, 1, ROLLS_UNKNOWN, 3 }, { -3, 1, 2, ROLLS_UNKNOWN, 3 }, { 2, 1, 2, ROLLS_REAR, 1 },
    { 2, 1, 1, ROLLS_FRONT, 2 }, { 2, 1, 1, ROLLS_NONE, 3 }, { 2, 0, 1, ROLLS_UNKNOWN, 1 },
    { 9, 1, 1, ROLLS_UNKNOWN, 1 }, { -30, 1, 0, ROLLS_UNKNOWN, 3 }, { 30, 1, 1, ROLLS_UNKNOWN, 1 } };
  for (int n = 0; n < ROWS(cases); n++) {
    static tse_kalman k;
    uint32_t seed = 5;
    tse_params p = a_car();
    decoded z = a_row(0.025, 0.02);
    in_a_turn(&p, &k, &seed);
    p.car.driven = cases[n].driven, p.car.drag = real(0.0005), p.car.rolling = real(0.125);
    p.car.scale_x = real(1.25), p.max_slip = real(0.03);
    k.x[SF] = real(0.004), k.x[SR] = real(-0.002), k.x[LCX] = real(0.25);
    z.no_second = 1, z.rolls = cases[n].rolls, z.use[ACCEL_X] = cases[n].use,
    z.z[ACCEL_X] = real(cases[n].accel);
    (void)predict_row(&p, &k, &z);
    const double all = cases[n].accel / 1.25 + 0.0005 * 400 + 0.125,
                 force = cases[n].use ? fmax(-10, fmin(10, all)) : 0;
    const double steep = exp(0.25)
        * ((cases[n].axles & 1 ? number(p.car.kx_front) : 0)
            + (cases[n].axles & 2 ? number(p.car.kx_rear) : 0));
    const double slip = fmax(-0.03, fmin(0.03, force / steep));
    const double front = cases[n].axles & 1 ? slip : 0, rear = cases[n].axles & 2 ? slip : 0;
    expect_near(0.004 + 0.2 * (front - 0.004), number(k.x[SF]), BY_NUMBER(1e-12, 1e-7, 1e-7), "front", n);
    expect_near(-0.002 + 0.2 * (rear + 0.002), number(k.x[SR]), BY_NUMBER(1e-12, 1e-7, 1e-7), "rear", n);
  }
}

/* Each sensor bias wanders with its own rate: variance of a random walk, rate^2 t. A
 * change has an age; without a change there is none, and an age has a limit. */
static void test_each_bias_wanders_by_itself_and_only_a_change_has_an_age(void)
{
  static tse_kalman k;
  tse_params p = a_car();
  uint32_t seed = 6;
  in_a_turn(&p, &k, &seed);
  const tse_kalman before = k;
  for (int i = 0; i < 3; i++) p.bias_sd_walk[i] = real((i + 1) * number(state_unit[bias_at(i)]));
  for (int n = 0; n < 4 * TSE_SLOW; n++) {
    predict_slow_states(&p, &k, real(0.01));
    for (int i = 0; i < TSE_SLOW; i++)
      TEST_ASSERT_TRUE(number(k.since_slow[i]) < 0.01 * TSE_SLOW + 1e-6); /* each has its turn */
  }
  for (int i = HAS_SLIP ? 0 : 1; i < 3; i++) {
    const double since = 0.01 * 4 * TSE_SLOW - number(k.since_slow[bias_at(i) - PLACED]);
    expect_near((i + 1) * (i + 1) * since,
        number(ud_variance(&k.ud, bias_at(i))) - number(ud_variance(&before.ud, bias_at(i))),
        BY_NUMBER(1e-9, 1e-3, 1e-4), "variance", i);
  }
  expect_near(0, number(k.change_age), 0, "no age", 0);
  k.change_kind = TSE_CHANGE_ROAD, k.change_age = real(3);
  predict_slow_states(&p, &k, real(0.25));
  expect_near(3.25, number(k.change_age), 1e-6, "age", 0);
  k.change_age = MAX_TIME;
  predict_slow_states(&p, &k, real(0.25));
  expect_near(number(MAX_TIME), number(k.change_age), 0, "limited", 0);
}

/* No state of the motion leaves its range to either side. */
static void test_the_motion_keeps_within_its_range_to_both_sides(void)
{
  for (int sign = -1; sign <= 1; sign += 2) {
    static tse_kalman k;
    const tse_params p = a_car();
    const decoded z = a_row(0.01, 0.02);
    memset(&k, 0, sizeof k);
    k.x[VX] = real(sign * 210), k.x[VY] = real(sign * 70);
    (void)predict_row(&p, &k, &z);
    expect_near(sign * 200, number(k.x[VX]), 0, "speed", sign);
    TEST_ASSERT_TRUE(fabs(number(k.x[VY])) <= 60);
  }
}

/* Without a second speed the speed wanders as much as accel_x may be wrong: by the sds of
 * gravity along the road and of its bias, and a constant. */
static void test_without_a_second_speed_the_speed_is_as_unsure_as_the_acceleration(void)
{
  double more[3];
  for (int n = 0; n < 3; n++) {
    static tse_kalman k;
    uint32_t seed = 7;
    tse_params p = a_car();
    decoded z = a_row(0.01, 0.02);
    in_a_turn(&p, &k, &seed);
    p.prior_sd[GX] = real(n == 1 ? 0.5 : 0), p.prior_sd[BX] = real(n == 2 ? 0.5 : 0);
    z.no_second = 1;
    (void)predict_row(&p, &k, &z);
    more[n] = number(ud_variance(&k.ud, VX)) * pow(number(state_unit[VX]), 2) / 0.01;
  }
  const double least = number(MIN_ACTIVITY), expected = pow(0.5 + least, 2) - pow(least, 2);
  expect_near(expected, more[1] - more[0], BY_NUMBER(1e-9, 2e-3, 2e-4), "gravity", 0);
  expect_near(expected, more[2] - more[0], BY_NUMBER(1e-9, 2e-3, 2e-4), "bias", 0);
}
