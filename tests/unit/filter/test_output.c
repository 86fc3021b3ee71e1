/* tests/unit/filter/test_output.c <-> src/filter/output.c: outputs of a given state,
 * computed by hand. */
#include "filter/output.h"
#include "filter_support.h"

/* Sideslip angle, forwards and backwards, straight and lateral: the quadrant is that of
 * libm, and its sd is that of the lateral speed over the speed. At the lowest speeds
 * there is no direction. */
static void test_the_sideslip_is_a_direction_in_every_quadrant_as_uncertain_backwards_as_forwards(void)
{
  static const double along[] = { 20, 3, 0.5, 0.02, 0.01, 0.005 }, across[] = { 2, 0.4, 0.02, 0.004 };
  tse_config c = config_by(tse_config_exact);
  c.mass_sd = setting(0.03);
  tse_params p = prepared(c);
  p.model_sd = real(0.02);
  const double least_angle = number(MIN_SIDESLIP_SPEED), lr = number(p.car.lr),
               close = BY_NUMBER(1e-12, 1e-6, 1e-6);
  for (int n = 0; n < 4 * ROWS(along) * ROWS(across); n++) {
    static tse_kalman k;
    tse_output y = blank_output();
    uint32_t seed = 1;
    memset(&k, 0, sizeof k);
    any_covariance(&k.ud, &seed);
    for (int i = 0; i < MOTION; i++) k.ud.d[i] = real(0.01 * number(k.ud.d[i]));
    const double vx = (n & 1 ? -1 : 1) * along[n / 4 % ROWS(along)],
                 vy = (n & 2 ? -1 : 1) * across[n / 4 / ROWS(along)], r = 0.3;
    k.x[VX] = real(vx), k.x[VY] = real(vy), k.x[YAW] = real(r);
    report_row(&p, &k, &y);
    const double var = dense_of(&k.ud).p[VY][VY] * pow(number(state_unit[VY]), 2),
                 model = pow(number(p.model_sd), 2) + number(p.mass_var);
    const double sd = sqrt(var + model * (pow(lr * r - vy, 2) + pow(lr * r, 2)) + pow(number(ASKEW) * vx, 2));
    expect_near(vx, number(y.vel_x), 1e-6, "along", n);
    expect_near(vy, number(y.vel_y), 1e-6, "across", n);
    expect_near(sd, number(y.vel_y_sd), close * (1 + sd), "sd across", n);
    expect_near(sd / fmax(fabs(vx), 1), number(y.sideslip_sd), close * (1 + sd), "sd of the sideslip", n);
    expect_near(fmax(fabs(number(k.x[VX])), fabs(number(k.x[VY]))) < least_angle ? 0 : atan2(vy, vx),
        number(y.sideslip), BY_NUMBER(1e-12, 2e-6, 1e-5), "sideslip", n);
  }
}

#if !defined(TSE_SMALL)
/* A probable fault that is not accepted yet is named: the channel of its most probable
 * event. An improbable fault is not named. */
static void test_a_likely_fault_names_its_channel(void)
{
  const tse_params p = prepared(config_by(tse_config_exact));
  for (int n = 0; n < 3; n++) {
    static tse_kalman k;
    tse_output y = blank_output();
    uint32_t seed = 2;
    memset(&k, 0, sizeof k);
    any_covariance(&k.ud, &seed);
    const int32_t kinds[] = { EVENT_STEER, EVENT_SENSOR + YAW_RATE };
    for (int e = 0; e < 2; e++) {
      k.event[4 + e].kind = kinds[e];
      k.event[4 + e].info = real(1), k.event[4 + e].score = real(10);
      k.weight[4 + e] = real(n == 2 ? 0.1 : e == n ? 0.7 : 0.2);
    }
    k.none[0] = real(n == 2 ? 0.8 : 0.1), k.none[1] = real(1);
    report_row(&p, &k, &y);
    TEST_ASSERT_EQUAL_INT(n == 2 ? NO_FAULT : n ? fault_of(YAW_RATE) : (int32_t)FAULT_STEER, y.fault_channel);
  }
}
#endif

/* A possible event moves each estimate by its probability times its shift, and adds the
 * variance of the mixture. By hand, with amplitude s/(1 + i) and variance 1/(1 + i), for
 * score s and information i. */
static void test_an_event_that_may_have_happened_is_in_mean_and_variance(void)
{
  const tse_params p = prepared(config_by(tse_config_exact));
  static const int at[] = { VX, VY, YAW, BX, BY, BR, LATE };
  const double w = 0.3, amplitude = 12.0 / 7, spread = 1 / 7.0, close = BY_NUMBER(1e-9, 2e-5, 2e-5);
  for (int n = 0; n < ROWS(at); n++) {
    static tse_kalman k;
    tse_output y = blank_output();
    uint32_t seed = 2;
    memset(&k, 0, sizeof k);
    any_covariance(&k.ud, &seed);
    k.x[VX] = real(15), k.x[at[n]] = real(number(k.x[at[n]]) + 0.1 * number(state_unit[at[n]]));
    const int slot = TSE_EVENTS - 1;
    k.event[slot].kind = EVENT_SENSOR + ACCEL_Y, k.weight[slot] = real(w);
    k.event[slot].score = TSE_R(12), k.event[slot].info = TSE_R(6), k.event[slot].v[at[n]] = short_of(0.5);
    report_row(&p, &k, &y);
    const tse_real *const mean[] = { &y.vel_x, &y.vel_y, &y.yaw_rate, &y.bias[0], &y.bias[1], &y.bias[2],
      &y.lag_steer };
    const tse_real *const sd[] = { &y.vel_x_sd, NULL, &y.yaw_rate_sd, &y.bias_sd[0], &y.bias_sd[1],
      &y.bias_sd[2], &y.lag_steer_sd };
    const double unit = number(state_unit[at[n]]), by = 0.5 * amplitude;
    const double var = dense_of(&k.ud).p[at[n]][at[n]] + w * (by * by + 0.25 * spread) - w * w * by * by;
    expect_near(number(k.x[at[n]]) + w * by * unit, number(*mean[n]), close, "mean", n);
    if (sd[n]) expect_near(sqrt(var) * unit, number(*sd[n]), close, "sd", n);
    expect_near(w, number(y.regime[TSE_REGIME_FAULT]), close, "regime", n);
    expect_near(1 - w, number(y.regime[TSE_REGIME_STEADY]), close, "regime as it was", n);
  }
}

/* A lag of the steering within 3 sd of its prior is accepted. The mean of the prior is
 * the lag in the settings: delay of the steering plus that of the IMU. If the lag differs
 * more, the wheels have not made the motion of the logged angle yet. A lag above 3 sd is
 * too large for the linear model, even if the settings have it. Longitudinal slip does
 * not depend on the lag. */
static void test_cornering_by_another_steering_than_the_settings_is_not_valid(void)
{
  static const struct {
    double sd, steering, imu, late;
    int valid;
  } cases[] = { { 0.01, 0, 0, 0.029, 1 }, { 0.01, 0, 0, -0.029, 1 }, { 0.01, 0, 0, 0.031, 0 },
    { 0.01, 0, 0, -0.031, 0 }, { 0, 0, 0, 0.1, 1 }, { 0.01, 0.01, 0.01, 0.029, 1 },
    { 0.01, 0.01, 0.01, -0.009, 1 }, { 0.01, 0.01, 0.01, -0.011, 0 }, { 0.01, 0.01, 0.01, 0.031, 0 },
    { 0.01, 0.06, 0.02, 0.08, 0 } };
  for (int n = 0; n < ROWS(cases); n++) {
    static tse_kalman k;
    tse_output y = blank_output();
    row_class w;
    tse_config c = config_by(tse_config_exact);
    c.driven_axle = 1, c.steer_lag_sd = setting(cases[n].sd);
    c.steering_delay_time = setting(cases[n].steering), c.imu_delay_time = setting(cases[n].imu);
    const tse_params p = prepared(c);
    memset(&k, 0, sizeof k);
    memset(&w, 0, sizeof w);
    k.seen = real(100), k.none[0] = k.none[1] = TSE_R(1), k.x[VX] = real(20), k.x[LATE] = real(cases[n].late);
    report_row(&p, &k, &y);
    judge_row(&p, &k, &w, &y);
    const tse_reason expected = cases[n].valid ? TSE_VALID : TSE_MISFIT;
    TEST_ASSERT_EQUAL_INT_MESSAGE(expected, y.reason[TSE_CY_FRONT], "front");
    TEST_ASSERT_EQUAL_INT_MESSAGE(expected, y.reason[TSE_CY_REAR], "rear");
    if (HAS_SLIP) TEST_ASSERT_EQUAL_INT_MESSAGE(TSE_VALID, y.reason[TSE_CX_FRONT], "along");
  }
}

/* Radii that differ by up to 1 %, or by up to 3 sd of their prior, are those of the car.
 * Otherwise the wheels are different ones, and their slip does not measure the stiffness
 * of the settings. Cornering does not depend on them. */
static void test_the_slip_of_other_wheels_than_the_settings_is_not_valid(void)
{
  static const struct {
    double sd, off;
    int valid;
  } cases[] = { { 0, 0.009, 1 }, { 0, -0.009, 1 }, { 0, 0.011, 0 }, { 0, -0.03, 0 }, { 0.005, 0.014, 1 },
    { 0.005, -0.016, 0 } };
  if (!HAS_SLIP) return;
  for (int n = 0; n < ROWS(cases); n++) {
    static tse_kalman k;
    tse_output y = blank_output();
    row_class w;
    tse_config c = config_by(tse_config_exact);
    c.driven_axle = 1, c.wheel_radius_sd = setting(cases[n].sd);
    const tse_params p = prepared(c);
    memset(&k, 0, sizeof k);
    memset(&w, 0, sizeof w);
    k.seen = real(100), k.none[0] = k.none[1] = TSE_R(1), k.x[VX] = real(20), k.x[RAD] = real(cases[n].off);
    report_row(&p, &k, &y);
    judge_row(&p, &k, &w, &y);
    TEST_ASSERT_EQUAL_INT_MESSAGE(cases[n].valid ? TSE_VALID : TSE_MISFIT, y.reason[TSE_CX_FRONT], "along");
    TEST_ASSERT_EQUAL_INT_MESSAGE(TSE_VALID, y.reason[TSE_CY_FRONT], "front");
  }
}

/* Run a drive without faults of a car of the class, with or without its mass set. */
static void count_reasons(const tse_config *told, int rows[(TSE_IMPLAUSIBLE + 1)])
{
  static tse_filter_paper f;
  truth w;
  tse_output y = blank_output();
  tse_config c = config_by(tse_config_default);
  c.mass = setting(1500);
  truth_start(&w, c, 25, 0, 4);
  w.amplitude = 0.02;
  const tse_params p = prepared(*told);
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_reset(&p, &f.filter, sizeof f));
  memset(rows, 0, (TSE_IMPLAUSIBLE + 1) * sizeof *rows);
  for (int n = 0; n < 6000; n++) {
    const tse_input u = truth_row(&w, 0.01);
    TEST_ASSERT_GREATER_OR_EQUAL_INT(0, tse_step(&p, &f.filter, &u, &y));
    for (int a = 0; a < 3; a++) rows[y.reason[a]]++;
  }
}

static void test_without_a_mass_no_stiffness_is_valid_and_the_parameters_are_the_reason(void)
{
  int rows[(TSE_IMPLAUSIBLE + 1)];
  for (int form = 0; form <= TSE_LAST_FORM; form++) {
    tse_config c = config_by(tse_config_default);
    c.form = form, c.valid_sd = setting(0.2); /* twice the usual limit, for an ordinary car */
    count_reasons(&c, rows);
    TEST_ASSERT_EQUAL_INT(0, rows[TSE_VALID]);
    TEST_ASSERT_GREATER_THAN_INT(9000, rows[TSE_PARAMETERS_UNCERTAIN]);
    TEST_ASSERT_LESS_THAN_INT(20, rows[TSE_UNCERTAIN]);
    c.mass = setting(1500);
    count_reasons(&c, rows);
    TEST_ASSERT_GREATER_THAN_INT(form ? 1000 : 6000, rows[TSE_VALID]);
  }
}

/* A filter that has seen enough of a car that drives steadily: all its estimates are
 * valid.
 *   Returned:  its parameters */
static tse_params steady_filter(tse_kalman *k, row_class *w)
{
  tse_config c = config_by(tse_config_exact);
  c.driven_axle = 1, c.grip_sd = setting(0.1);
  memset(k, 0, sizeof *k);
  memset(w, 0, sizeof *w);
  k->seen = real(100), k->none[0] = k->none[1] = TSE_R(1), k->x[VX] = real(20);
  return prepared(c);
}

/* Each reason for which no estimate is valid, alone, and the order in which they
 * count. */
static void test_every_reason_alone_makes_an_estimate_not_valid_and_the_first_counts(void)
{
  enum { APART, SCALE, PREDICTED, SPARSE, HELD, STARTING, FAULT, SLIDING, LATERAL, ALONG, ALL_CAUSES };
  static const int expected[ALL_CAUSES] = { TSE_IMPLAUSIBLE, TSE_IMPLAUSIBLE, TSE_INPUT_INVALID,
    TSE_INPUT_INVALID, TSE_HELD, TSE_STARTING, TSE_SENSOR_FAULT, TSE_HELD, TSE_MISFIT, TSE_MISFIT };
  for (int n = -1; n < 2 * ALL_CAUSES; n++) {
    static tse_kalman k;
    row_class w;
    tse_output y = blank_output();
    const tse_params p = steady_filter(&k, &w);
    const int first = n < 0 ? ALL_CAUSES : n % ALL_CAUSES, last = n < ALL_CAUSES ? first : ALL_CAUSES - 1;
    for (int cause = first; cause <= last && cause < ALL_CAUSES; cause++) {
      if (cause == APART) k.agreement.apart = 1;
      if (cause == SCALE) k.agreement.off_scale = 1;
      if (cause == PREDICTED) w.predicted = 1;
      if (cause == SPARSE) w.sparse = 1;
      if (cause == HELD) w.held = 1;
      if (cause == STARTING) k.seen = real(1);
      if (cause == FAULT) k.fault = fault_of(ACCEL_Y);
      if (cause == SLIDING) k.x[SR] = real(-2 * number(p.max_slip));
      if (cause == LATERAL) k.none[0] = real(0.9);
      if (cause == ALONG) k.none[1] = real(0.9);
    }
    report_row(&p, &k, &y);
    judge_row(&p, &k, &w, &y);
    const int reason = first < ALL_CAUSES ? expected[first] : TSE_VALID;
    for (int a = HAS_SLIP ? 0 : 1; a < 3; a++) expect_near(reason, y.reason[a], 0, "reason", 100 * n + a);
    expect_near(reason, y.grip_reason, 0, "reason, grip", n);
  }
}

/* A grip that is a setting is not estimated. */
static void test_a_grip_that_is_a_setting_is_not_an_estimate(void)
{
  static tse_kalman k;
  row_class w;
  tse_output y = blank_output();
  tse_params p = steady_filter(&k, &w);
  p.prior_sd[LMU] = TSE_R(0);
  report_row(&p, &k, &y);
  judge_row(&p, &k, &w, &y);
  TEST_ASSERT_EQUAL_INT(TSE_NOT_EXCITED, y.grip_reason);
  w.held = 1;
  judge_row(&p, &k, &w, &y);
  TEST_ASSERT_EQUAL_INT(TSE_HELD, y.grip_reason);
}

/* The slip shows the stiffness along only if the speed of the car is known: from an axle
 * that rolls freely, or from accel_x on roads without grade. */
static void test_the_stiffness_along_needs_two_speeds_and_that_of_the_car(void)
{
  static const struct {
    int driven, rolls, flat, no_second, valid;
  } cases[] = { { 1, ROLLS_UNKNOWN, 0, 0, 1 }, { 0, ROLLS_UNKNOWN, 0, 0, 0 }, { 0, ROLLS_REAR, 0, 0, 1 },
    { 0, ROLLS_FRONT, 0, 0, 1 }, { 0, ROLLS_NONE, 0, 0, 0 }, { 0, ROLLS_NONE, 1, 0, 1 },
    { 1, ROLLS_UNKNOWN, 1, 1, 0 } };
  if (!HAS_SLIP) return;
  for (int n = 0; n < ROWS(cases); n++) {
    static tse_kalman k;
    row_class w;
    tse_output y = blank_output();
    tse_params p = steady_filter(&k, &w);
    p.car.driven = cases[n].driven, p.prior_sd[GX] = real(cases[n].flat ? 0 : 0.3);
    w.rolls = cases[n].rolls, w.no_second = cases[n].no_second;
    report_row(&p, &k, &y);
    judge_row(&p, &k, &w, &y);
    expect_near(cases[n].valid ? TSE_VALID : TSE_NOT_EXCITED, y.reason[TSE_CX_FRONT], 0, "along", n);
    expect_near(TSE_VALID, y.reason[TSE_CY_FRONT], 0, "across", n);
    w.held = 1;
    judge_row(&p, &k, &w, &y);
    expect_near(TSE_HELD, y.reason[TSE_CX_FRONT], 0, "another reason stays", n);
  }
}

/* An estimate is valid up to valid_sd, relative to itself. If the parameters of the
 * settings cause more than half of a larger variance, they are the reason. Without a
 * second speed an uncertain stiffness along is one that is not excited. */
static void test_what_is_too_uncertain_says_whether_parameters_are_the_cause(void)
{
  for (int n = 0; n < 6; n++) {
    static tse_kalman k;
    row_class w;
    tse_output y = blank_output();
    tse_params p = steady_filter(&k, &w);
    const int from = n % 3, big = n / 3; /* 0: the state, 1: the mass, 2: a consider parameter */
    const double sd = (big ? 1.1 : 0.8) * sqrt(number(p.valid_var));
    k.x[LCF] = real(0.5); /* relative to a stiffness that is not nominal */
    if (from == 0) k.ud.d[LCF] = real(pow(sd / number(state_unit[LCF]), 2));
    if (from == 1) p.mass_var = real(sd * sd);
    if (from == 2) k.consider[0][LCF] = short_of(sd / number(state_unit[LCF]));
    report_row(&p, &k, &y);
    judge_row(&p, &k, &w, &y);
    expect_near(!big    ? TSE_VALID
            : from == 0 ? TSE_UNCERTAIN
                        : TSE_PARAMETERS_UNCERTAIN,
        y.reason[TSE_CY_FRONT], 0, "reason", n);
    if (from != 1) expect_near(TSE_VALID, y.reason[TSE_CY_REAR], 0, "rear", n);
    w.no_second = 1;
    judge_row(&p, &k, &w, &y);
    if (HAS_SLIP) expect_near(TSE_NOT_EXCITED, y.reason[TSE_CX_FRONT], 0, "along", n);
  }
}

/* The regime of a filter without possible events, and how it reports the last change. */
static void test_a_regime_is_a_fault_a_slide_or_a_recent_change(void)
{
  static const struct {
    double sf, sr, age;
    int fault, change, regime;
  } cases[] = { { 0, 0, 1, 0, TSE_CHANGE_NONE, TSE_REGIME_STEADY },
    { 0, 0, 1, 0, TSE_CHANGE_ROAD, TSE_REGIME_CHANGED }, { 0, 0, 1, 0, TSE_CHANGE_FRONT, TSE_REGIME_AXLE },
    { 0, 0, 1, 0, TSE_CHANGE_REAR, TSE_REGIME_AXLE },
    { 0, 0, 1, 0, TSE_CHANGE_RESTART, TSE_REGIME_RESTARTED },
    { 0, 0, 3, 0, TSE_CHANGE_RESTART, TSE_REGIME_STEADY }, { 0, 0, 3, 0, TSE_CHANGE_ROAD, TSE_REGIME_STEADY },
    { 0.2, 0, 1, 0, TSE_CHANGE_ROAD, TSE_REGIME_SLIDING }, { -0.2, 0, 1, 0, 0, TSE_REGIME_SLIDING },
    { 0, 0.2, 1, 0, 0, TSE_REGIME_SLIDING }, { 0, -0.2, 1, 0, 0, TSE_REGIME_SLIDING },
    { 0.2, 0, 1, 1, TSE_CHANGE_ROAD, TSE_REGIME_FAULT } };
  for (int n = 0; n < ROWS(cases); n++) {
    static tse_kalman k;
    row_class w;
    tse_output y = blank_output();
    const tse_params p = steady_filter(&k, &w);
    const int changed = cases[n].change != TSE_CHANGE_NONE;
    k.x[SF] = real(cases[n].sf), k.x[SR] = real(cases[n].sr), k.change_age = real(cases[n].age);
    k.change_kind = cases[n].change, k.none[0] = real(0.75), k.none[1] = real(0.5);
    if (cases[n].fault) k.fault = fault_of(YAW_RATE);
    for (int a = 0; a < 3; a++) k.x[stiffness_at(a)] = real(0.1 * a), k.change_from[a] = real(0.3);
    report_row(&p, &k, &y);
    for (int r = 0; r < TSE_REGIMES; r++)
      expect_near(r == cases[n].regime, number(y.regime[r]), 1e-6, "regime", 100 * n + r);
    TEST_ASSERT_EQUAL_INT(cases[n].fault ? fault_of(YAW_RATE) : NO_FAULT, y.fault_channel);
    for (int a = 0; a < 3; a++)
      expect_near(changed ? exp(0.1 * a - 0.3) : 1, number(y.change_ratio[a]), 1e-5, "ratio", 100 * n + a);
    expect_near(changed ? 0.375 : 0, number(y.change_probability), 1e-6, "probability", n);
    expect_near(cases[n].age, number(y.change_age), 1e-6, "age", n);
  }
}

/* A bias is that of its own sensor. No motion and no sd leaves its range. */
static void test_outputs_are_of_their_state_and_within_their_range(void)
{
  static tse_kalman k;
  row_class w;
  tse_output y = blank_output();
  const tse_params p = steady_filter(&k, &w);
  for (int i = 0; i < 3; i++) k.x[bias_at(i)] = real(0.1 * (i + 1));
  k.x[BX] = real(0.1), k.x[BY] = real(0.2), k.x[BR] = real(0.3);
  for (int i = 0; i < MOTION; i++) k.ud.d[i] = real(1e6);
  for (int c = 0; c < TSE_SENSORS; c++) k.noise[c] = real(0.25 * (c + 1) * (c + 1));
  report_row(&p, &k, &y);
  for (int i = 0; i < 3; i++) expect_near(0.1 * (i + 1), number(y.bias[i]), 1e-6, "bias", i);
  for (int c = 0; c < TSE_SENSORS; c++) expect_near(0.5 * (c + 1), number(y.noise[c]), 1e-5, "noise", c);
  TEST_ASSERT_TRUE(number(y.vel_x_sd) <= 200 && number(y.vel_y_sd) <= 60 && number(y.yaw_rate_sd) <= 20);
  TEST_ASSERT_TRUE(number(y.sideslip_sd) <= 3.1416);
}
