/* tests/unit/estimator/hypotheses/test_step.c <-> src/estimator/hypotheses/step.c: the default form as its caller meets it. */
#include "unit_support.h"
#include "hypotheses_support.h"
#include "tse/simulate.h"

static tse_filter f, other;

/* Steering and torque as of a lively drive; sensor noise as told, spread 5 %. */
typedef struct drive {
  tse_sim sim;
  tse_sim_output y;
  double t, dt, road, brake, friction;
} drive;

static tse_config settings(void)
{
  tse_config c;
  tse_config_default(&c);
  return c;
}

static void set_off(drive *d, const tse_config *c, double noise, int held)
{
  tse_sim_config s;
  tse_sim_config_default(&s);
  memset(d, 0, sizeof *d);
  s.noise = setting(noise);
  s.hold_inputs = held;
  s.seed = 3;
  d->dt = 0.01;
  d->road = 1;
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_sim_reset(&d->sim, c, &s, NULL));
}

static tse_input next_row(drive *d)
{
  tse_sim_input u;
  memset(&u, 0, sizeof u);
  u.dt = real(d->dt);
  u.steer_angle = real(0.03 * sin(2.3 * d->t) + 0.01 * sin(5.9 * d->t));
  u.wheel_torque_front = real(700 * (sin(1.3 * d->t) > 0 ? 1 : -1));
  u.brake_torque_front = real(d->brake);
  u.road_level = real(d->road);
  u.road_friction = real(d->friction);
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_sim_step(&d->sim, &u, &d->y));
  d->t += d->dt;
  d->y.row.dt = real(d->dt);
  return d->y.row;
}

static void start(const tse_params *p) { TEST_ASSERT_EQUAL_INT(TSE_OK, tse_reset(p, &f, sizeof f)); }

static void expect_sane(const tse_output *y, const char *what)
{
  char text[128];
#define OUT_REAL(name, member, unit, about)                              \
  (void)snprintf(text, sizeof text, "%s: " #name " is no number", what); \
  TEST_ASSERT_TRUE_MESSAGE(isfinite(number(y->member)), text);
#define OUT_INT(name, member, about)
#include "tse/output.def"
#undef OUT_REAL
#undef OUT_INT
  double sum = 0;
  for (int k = 0; k < TSE_REGIMES; k++) sum += number(y->regime[k]);
  expect_near(1, sum, 1e-4, what, 0);
  TEST_ASSERT_TRUE_MESSAGE(fabs(number(y->yaw_rate)) < 20.0001 && fabs(number(y->vel_x)) < 200.001 && fabs(number(y->vel_y)) < 200.001, what);
  for (int a = 0; a < 3; a++) TEST_ASSERT_TRUE_MESSAGE(number(y->stiffness[a]) > 0 && number(y->stiffness_sd[a]) >= 0, what);
}

static tse_output run(const tse_params *p, drive *d, int rows)
{
  tse_output y;
  memset(&y, 0, sizeof y);
  for (int i = 0; i < rows; i++) {
    const tse_input u = next_row(d);
    TEST_ASSERT_TRUE(tse_step(p, &f, &u, &y) >= 0);
    expect_sane(&y, "a drive");
  }
  return y;
}

static void expect_stiffness(double truth, const tse_output *y, double share, const char *what)
{
  for (int a = 0; a < 3; a++) expect_near(truth, number(y->stiffness[a]), share * truth, what, a);
}

/* ------------------------------------------------------------------------------------------- what it is for */

static void test_a_plain_drive_is_learnt_and_valid(void)
{
  const tse_config c = settings();
  const tse_params p = prepared(&c);
  drive d;
  set_off(&d, &c, 1, 0);
  start(&p);
  const tse_output y = run(&p, &d, 1500);
  expect_stiffness(1, &y, 0.03, "stiffness");
  for (int a = 0; a < 3; a++) {
    TEST_ASSERT_EQUAL_INT(TSE_VALID, y.reason[a]);
    TEST_ASSERT_TRUE(fabs(number(y.stiffness[a]) - 1) < 4 * number(y.stiffness_sd[a]) + 0.005);
    expect_near(1, number(y.noise[a]), 0.15, "noise", a);
  }
  TEST_ASSERT_EQUAL_INT(TSE_OK, y.status);
  TEST_ASSERT_TRUE(number(y.regime[TSE_REGIME_STEADY]) > 0.5);
}

static void test_another_road_is_noticed_within_a_tenth_of_a_second_and_told_with_its_probability(void)
{
  const tse_config c = settings();
  const tse_params p = prepared(&c);
  static const double levels[] = { 0.4, 0.6 };
  for (int k = 0; k < ROWS(levels); k++) {
    drive d;
    int noticed = -1;
    set_off(&d, &c, 1, 0);
    start(&p);
    tse_output y = run(&p, &d, 1275);
    TEST_ASSERT_EQUAL_INT(TSE_CHANGE_NONE, y.change_kind);
    d.road = levels[k];
    for (int i = 0; i < 100; i++) {
      y = run(&p, &d, 1);
      const double told = number(y.regime[TSE_REGIME_CHANGED]) + number(y.regime[TSE_REGIME_AXLE]);
      if (noticed < 0 && told > 0.5) noticed = i;
    }
    TEST_ASSERT_TRUE_MESSAGE(noticed >= 0 && noticed <= 10, "not noticed in 0.1 s");
    TEST_ASSERT_EQUAL_INT(TSE_CHANGE_ROAD, y.change_kind);
    TEST_ASSERT_TRUE(number(y.change_probability) > 0.9);
    expect_near(1.0 - 0.01, number(y.change_age), 0.15, "age", 0);
    y = run(&p, &d, 300);
    expect_stiffness(levels[k], &y, 0.08, "stiffness after the change");
    for (int a = 0; a < 3; a++) expect_near(levels[k], number(y.change_ratio[a]), 0.1, "ratio", a);
    TEST_ASSERT_TRUE(number(y.regime[TSE_REGIME_CHANGED]) < 0.05); /* it is no news any more */
  }
}

static void test_noise_that_is_not_as_told_is_found(void)
{
  static const double noise[] = { 0.4, 3 };
  const tse_config c = settings();
  const tse_params p = prepared(&c);
  for (int k = 0; k < ROWS(noise); k++) {
    drive d;
    set_off(&d, &c, noise[k], 0);
    start(&p);
    const tse_output y = run(&p, &d, 2000);
    for (int a = 0; a < 3; a++) expect_near(noise[k], number(y.noise[a]), (a ? 0.3 : 0.45) * noise[k], "noise", a); /* sd of accel_x's at 0.4: 15 % */
  }
}

static void test_a_slow_change_is_followed(void)
{
  const tse_config c = settings();
  const tse_params p = prepared(&c);
  drive d;
  tse_output y;
  set_off(&d, &c, 1, 0);
  start(&p);
  y = run(&p, &d, 1500);
  double drifting = 0;
  for (int i = 0; i < 1500; i++) { /* -30 % in 15 s */
    d.road = 1 - 0.3 * i / 1500;
    y = run(&p, &d, 1);
    drifting = fmax(drifting, number(y.regime[TSE_REGIME_DRIFTING]));
  }
  expect_stiffness(0.7, &y, 0.12, "stiffness");
  TEST_ASSERT_TRUE(drifting > 0.5);
}

static void test_a_stuck_reading_is_found_muted_and_taken_back(void)
{
  const tse_config c = settings();
  const tse_params p = prepared(&c);
  for (int channel = 3; channel < 6; channel++) {
    drive d;
    tse_output y;
    double stuck = 0;
    int found = 0;
    set_off(&d, &c, 1, 0);
    start(&p);
    (void)run(&p, &d, 1210);
    for (int i = 0; i < 300; i++) {
      tse_input u = next_row(&d);
      tse_real *const value = channel == 3 ? &u.accel_x : channel == 4 ? &u.accel_y : &u.yaw_rate;
      if (i == 0) stuck = number(*value);
      *value = real(stuck);
      TEST_ASSERT_TRUE(tse_step(&p, &f, &u, &y) >= 0);
      expect_sane(&y, "stuck");
      found += y.fault_channel == channel + 1;
    }
    TEST_ASSERT_TRUE(found > 200);
    expect_stiffness(1, &y, 0.15, "stiffness while a reading is stuck");
    for (int a = 0; a < 3; a++) TEST_ASSERT_TRUE(y.reason[a] != TSE_VALID); /* nothing is promised meanwhile */
    y = run(&p, &d, 300);
    TEST_ASSERT_EQUAL_INT(0, y.fault_channel);
    expect_stiffness(1, &y, 0.1, "stiffness afterwards");
  }
}

/* Front wheels locked on a slippery road for a second: what was learnt stays, nothing is promised, the speed is that of the car. */
static void test_while_wheels_are_locked_the_car_coasts_on_its_accelerometers(void)
{
  const tse_config c = settings();
  const tse_params p = prepared(&c);
  drive d;
  int locked = 0, told = 0;
  set_off(&d, &c, 1, 0);
  start(&p);
  const tse_output before = run(&p, &d, 1500);
  tse_output y;
  for (int i = 0; i < 100; i++) {
    d.brake = 6000;
    d.friction = 0.5;
    y = run(&p, &d, 1);
    if (number(d.y.row.wheel_speed_front) > 1 || i < 30) continue;
    locked++;
    told += number(y.regime[TSE_REGIME_SLIDING]) + number(y.regime[TSE_REGIME_FAULT]) > 0.5;
    for (int a = 0; a < 3; a++) TEST_ASSERT_TRUE(y.reason[a] != TSE_VALID);
  }
  TEST_ASSERT_TRUE(locked > 50 && told > 0.9 * locked);
  expect_near(number(d.y.vel_x), number(y.vel_x), 1, "vel_x", 0);
  for (int a = 0; a < 3; a++) expect_near(number(before.stiffness[a]), number(y.stiffness[a]), 0.15, "stiffness", a);
}

static void test_how_steering_goes_between_rows_is_found_out(void)
{
  tse_config c = settings();
  c.sample_time = setting(0.05);
  c.max_gap = setting(0.2);
  c.inputs_held = 2;
  const tse_params p = prepared(&c);
  for (int held = 0; held < 2; held++) {
    drive d;
    set_off(&d, &c, 1, held);
    d.dt = 0.05;
    start(&p);
    (void)run(&p, &d, 600);
    double weight = 0, total = 0;
    for (int i = 0; i < f.bank.count; i++) {
      const double w = exp2(number(f.bank.h[i].log_weight));
      total += w;
      weight += f.bank.h[i].held ? w : 0;
    }
    TEST_ASSERT_TRUE_MESSAGE(held ? weight > 0.9 * total : weight < 0.1 * total, held ? "held" : "ramps");
  }
}

/* A car of another kind from one row to the next: not what was believed, and not for long. */
/* Learnt well, and yet not valid: what is told of the car is loose, or the sensors say what the model does not explain. */
static void test_what_is_told_loosely_and_what_does_not_fit_are_reasons(void)
{
  tse_config c = settings();
  for (int loose = 0; loose < 2; loose++) {
    c.mass_sd = setting(loose ? 0.15 : 0.05);
    const tse_params p = prepared(&c);
    drive d;
    set_off(&d, &c, 1, 0);
    start(&p);
    tse_output y = run(&p, &d, 1500);
    for (int a = 0; a < 3; a++) {
      TEST_ASSERT_EQUAL_INT32(loose ? TSE_TOLD_LOOSELY : TSE_VALID, y.reason[a]);
      TEST_ASSERT_TRUE(number(y.stiffness_sd[a]) > (loose ? 0.15 : 0.05) * number(y.stiffness[a]));
    }
    for (int i = 0; i < f.bank.count; i++) f.bank.h[i].level[1] = 3;
    y = run(&p, &d, 1);
    TEST_ASSERT_EQUAL_INT32(loose ? TSE_TOLD_LOOSELY : TSE_VALID, y.reason[TSE_CX_FRONT]);
    for (int a = TSE_CY_FRONT; a <= TSE_CY_REAR; a++) TEST_ASSERT_EQUAL_INT32(TSE_MISFIT, y.reason[a]);
  }
}

/* Slips are read without nods: accel_x and wheel speeds both go through the same two lags, whatever is missing on the way. */
static void test_nods_are_taken_out_of_accel_x_and_wheel_speeds_alike(void)
{
  tse_config c = settings();
  c.nod_time = setting(0.15);
  const tse_params p = prepared(&c);
  const double by[3] = { 1 / number(p.sd[0]), number(p.radius_front), number(p.radius_rear) };
  double once[3] = { 0 }, twice[3] = { 0 };
  drive d;
  set_off(&d, &c, 1, 0);
  start(&p);
  for (int i = 0; i < 400; i++) {
    tse_input u = next_row(&d);
    const double dt = i == 300 ? 1 : i % 7 ? 0.01 : 0.02, given[3] = { number(u.accel_x), number(u.wheel_speed_front), number(u.wheel_speed_rear) };
    const int no_accel = i > 5 && i % 11 == 0, no_wheel = i > 5 && i % 13 == 0;
    u.dt = real(dt);
    u.missing = (no_accel ? TSE_MISSING(accel_x) : 0u) | (no_wheel ? TSE_MISSING(wheel_speed_rear) : 0u);
    TEST_ASSERT_TRUE(tse_step(&p, &f, &u, NULL) >= 0);
    for (int k = 0; k < 3; k++) {
      const double g = i == 0 || dt > 0.1 ? 1 : dt / (dt + 0.15); /* the first row and a gap begin anew */
      if (k == 0 ? no_accel : no_wheel) continue;
      once[k] += g * (by[k] * given[k] - once[k]);
      twice[k] += g * (once[k] - twice[k]);
      expect_near(twice[k], number(f.nod[k][1]), BY_FORMAT(1e-12, 1e-4) * (1 + fabs(twice[k])), "followed", 10 * i + k);
    }
    expect_near(twice[1], number(f.v_front), BY_FORMAT(1e-12, 1e-4) * (1 + fabs(twice[1])), "the input of the motion", i);
  }
}

static void test_forced_nonsense_is_recovered_from(void)
{
  const tse_config c = settings();
  const tse_params p = prepared(&c);
  for (int what = 0; what < 4; what++) {
    drive d;
    set_off(&d, &c, 1, 0);
    start(&p);
    (void)run(&p, &d, 1000);
    for (int i = 0; i < f.bank.count; i++) {
      tse_hypothesis *const h = &f.bank.h[i];
      if (what == 0) h->x[0] = h->x[4] = h->cov[4][4] = broken();
      if (what == 1) h->x[1] = real(150);
      if (what == 2) h->x[4] = real(4);
      if (what == 3) h->x[1] = real(5);
    }
    const tse_output y = run(&p, &d, 1500);
    expect_stiffness(1, &y, 0.1, "stiffness");
    expect_near(number(d.y.vel_x), number(y.vel_x), 0.1, "vel_x", what);
    expect_near(number(d.y.vel_y), number(y.vel_y), 0.1, "vel_y", what);
  }
}

/* ------------------------------------------------------------------------------------------------- any time step */

static void test_a_long_pause_leaves_all_finite_and_what_was_learnt(void)
{
  static const double pauses[] = { 0.05, 0.3, 60, 600, 3600 };
  const tse_config c = settings();
  const tse_params p = prepared(&c);
  for (int k = 0; k < ROWS(pauses); k++) {
    drive d;
    tse_output y;
    set_off(&d, &c, 1, 0);
    start(&p);
    (void)run(&p, &d, 1500);
    for (int n = 0; n < 3; n++) {
      tse_input u = next_row(&d);
      u.dt = real(pauses[k]);
      TEST_ASSERT_TRUE(tse_step(&p, &f, &u, &y) >= 0);
      expect_sane(&y, "a pause");
      /* what would have changed an hour ago would be anywhere by now: beyond all sense, and beyond fixed point, too */
      const int told = BY_NUMBER(0, 0, pauses[k] > 3000) && y.status == TSE_W_RANGE;
      if (pauses[k] > 0.2 && !told) TEST_ASSERT_EQUAL_INT(TSE_W_GAP, y.status);
      expect_stiffness(1, &y, 0.15, "right after a pause");
      double total = 0;
      for (int i = 0; i < f.bank.count; i++) { /* that nothing has changed stays as likely as not: no birth has more than half */
        total += exp2(number(f.bank.h[i].log_weight));
        for (int a = 0; a < TSE_X; a++) TEST_ASSERT_TRUE(number(f.bank.h[i].cov[a][a]) >= 0);
      }
      TEST_ASSERT_TRUE(total >= 1 && total <= TSE_HYPOTHESES);
      y = run(&p, &d, 20);
    }
    y = run(&p, &d, 400);
    expect_stiffness(1, &y, 0.06, "after a pause");
  }
}

static void test_inputs_lost_for_long_are_a_gap_afterwards(void)
{
  const tse_config c = settings();
  const tse_params p = prepared(&c);
  drive d;
  tse_output y;
  set_off(&d, &c, 1, 0);
  start(&p);
  (void)run(&p, &d, 1000);
  for (int i = 0; i < 100; i++) {
    tse_input u = next_row(&d);
    u.missing = TSE_MISSING(wheel_speed_front);
    TEST_ASSERT_EQUAL_INT(TSE_W_PREDICTED, tse_step(&p, &f, &u, &y));
    expect_sane(&y, "lost inputs");
    TEST_ASSERT_EQUAL_INT(TSE_INPUT_INVALID, y.reason[0]);
  }
  y = run(&p, &d, 1);
  TEST_ASSERT_EQUAL_INT(TSE_W_GAP, y.status);
  y = run(&p, &d, 300);
  expect_stiffness(1, &y, 0.06, "stiffness");
}

/* ------------------------------------------------------------------------------------------- whatever comes */

/* Settings anywhere in their ranges, rows at their ends and beyond: outputs are numbers, also in single precision. */
static void test_odd_settings_and_rows_give_numbers(void)
{
  uint32_t seed = 81;
  int taken = 0;
  for (int round = 0; round < 300; round++) {
    tse_config c = settings();
    const double odds = round % 3 == 0 ? 0.9 : 0.2;
#define REAL(name, def, lo, hi, unit, text)                                                                                     \
    if (!kind_of_effect_setting(offsetof(tse_config, name)) && next_uniform(&seed) < odds) {                                    \
      const double u = next_uniform(&seed);                                                                                     \
      c.name = setting(u < 0.25 ? (lo) : u < 0.5 ? (hi) : (lo) + ((hi) - (lo)) * next_uniform(&seed));                   \
    }
#define INT(name, def, lo, hi, text)
#include "tse/config.def"
#undef REAL
#undef INT
    fit_together(&c);
    c.form = 0;
    c.hypotheses = 2 + (int32_t)(next_uniform(&seed) * (TSE_HYPOTHESES - 1.01));
    c.inputs_held = (int32_t)(next_uniform(&seed) * 2.99);
    tse_params p;
    if (!prepared_if_held(&c, &p)) continue;
    start(&p);
    double v = next_between(&seed, -20, 60);
    for (int i = 0; i < 120; i++) {
      tse_input u;
      tse_output y;
      memset(&u, 0, sizeof u);
      const int wild = next_uniform(&seed) < 0.2;
      v = wild ? next_between(&seed, -400, 400) : v + next_between(&seed, -1, 1);
      u.dt = real(wild ? pow(10, next_between(&seed, -7, 3.55)) : 0.01);
      u.steer_angle = real(wild ? next_between(&seed, -1.2, 1.2) : next_between(&seed, -0.05, 0.05));
      u.wheel_speed_front = real(fmax(-400, fmin(400, v / number(c.wheel_radius_front))));
      u.wheel_speed_rear = real(fmax(-400, fmin(400, v / number(c.wheel_radius_rear))));
      u.accel_x = real(wild ? next_between(&seed, -60, 60) : next_between(&seed, -1, 1));
      u.accel_y = real(wild ? next_between(&seed, -60, 60) : next_between(&seed, -1, 1));
      u.yaw_rate = real(wild ? next_between(&seed, -7, 7) : next_between(&seed, -0.1, 0.1));
      if (wild && i % 3 == 0) u.accel_y = real((double)NAN);
      if (wild && i % 5 == 0) u.missing = TSE_MISSING(steer_angle);
      const tse_status status = tse_step(&p, &f, &u, &y);
      if (status < 0) continue;
      char what[64];
      (void)snprintf(what, sizeof what, "round %d, row %d", round, i);
      expect_sane(&y, what);
      taken++;
    }
  }
  TEST_ASSERT_TRUE(taken > BY_NUMBER(20000, 20000, 5000));
}

static void test_the_same_rows_give_the_same_bits_and_a_refused_row_none_others(void)
{
  const tse_config c = settings();
  const tse_params p = prepared(&c);
  drive d;
  tse_output y, z;
  memset(&y, 0, sizeof y);
  memset(&z, 0, sizeof z);
  set_off(&d, &c, 1, 0);
  memset(&f, 0x55, sizeof f);
  start(&p);
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_reset(&p, &other, sizeof other));
  for (int i = 0; i < 800; i++) {
    if (i == 400) d.road = 0.5;
    const tse_input u = next_row(&d);
    tse_input bad = u;
    TEST_ASSERT_TRUE(tse_step(&p, &f, &u, &y) >= 0);
    if (i % 3 == 0 && i > 0) bad.dt = real(i % 2 ? -1 : 3601);
    else bad.steer_angle = real(1.3);
    const tse_filter before = other;
    TEST_ASSERT_TRUE(tse_step(&p, &other, &bad, &z) < 0);
    TEST_ASSERT_EQUAL_MEMORY(&before, &other, sizeof before);
    TEST_ASSERT_TRUE(tse_step(&p, &other, &u, &z) >= 0);
    TEST_ASSERT_EQUAL_MEMORY(&y, &z, sizeof y);
  }
  TEST_ASSERT_EQUAL_MEMORY(&f, &other, sizeof f);
  TEST_ASSERT_EQUAL_INT(TSE_CHANGE_ROAD, y.change_kind);
}

static void test_standing_still_the_gyros_bias_is_learnt_and_nothing_else(void)
{
  tse_config c = settings();
  c.yaw_rate_bias_sd = setting(0.01);
  const tse_params p = prepared(&c);
  tse_output y;
  uint32_t seed = 82;
  start(&p);
  for (int i = 0; i < 500; i++) {
    tse_input u;
    memset(&u, 0, sizeof u);
    u.dt = real(0.01);
    u.yaw_rate = real(0.008 + next_between(&seed, -0.004, 0.004));
    u.accel_x = real(next_between(&seed, -0.1, 0.1));
    u.accel_y = real(next_between(&seed, -0.1, 0.1));
    TEST_ASSERT_TRUE(tse_step(&p, &f, &u, &y) >= 0);
    for (int a = 0; a < 3; a++) TEST_ASSERT_EQUAL_INT(TSE_HELD, y.reason[a]);
  }
  expect_near(0.008, number(y.bias[2]), 5e-4, "bias", 0);
  TEST_ASSERT_TRUE(number(y.bias_sd[2]) < 5e-4);
  expect_stiffness(1, &y, 1e-6, "stiffness");
}

int main(void)
{
  UNITY_BEGIN();
  RUN_TEST(test_a_plain_drive_is_learnt_and_valid);
  RUN_TEST(test_another_road_is_noticed_within_a_tenth_of_a_second_and_told_with_its_probability);
  RUN_TEST(test_noise_that_is_not_as_told_is_found);
  RUN_TEST(test_a_slow_change_is_followed);
  RUN_TEST(test_a_stuck_reading_is_found_muted_and_taken_back);
  RUN_TEST(test_while_wheels_are_locked_the_car_coasts_on_its_accelerometers);
  RUN_TEST(test_how_steering_goes_between_rows_is_found_out);
  RUN_TEST(test_what_is_told_loosely_and_what_does_not_fit_are_reasons);
  RUN_TEST(test_nods_are_taken_out_of_accel_x_and_wheel_speeds_alike);
  RUN_TEST(test_forced_nonsense_is_recovered_from);
  RUN_TEST(test_a_long_pause_leaves_all_finite_and_what_was_learnt);
  RUN_TEST(test_inputs_lost_for_long_are_a_gap_afterwards);
  RUN_TEST(test_odd_settings_and_rows_give_numbers);
  RUN_TEST(test_the_same_rows_give_the_same_bits_and_a_refused_row_none_others);
  RUN_TEST(test_standing_still_the_gyros_bias_is_learnt_and_nothing_else);
  return UNITY_END();
}
