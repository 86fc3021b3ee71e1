/* tests/unit/estimator/test_told.c <-> src/estimator/told.c: an estimator that is told of the effects that its car has. */
#include "unit_support.h"
#include "effect_support.h"

enum { ROWS_RUN = 1500 };

/* The default form, which moves as the simulator does: the one that effects are for. */
static tse_config told_car(void)
{
  tse_config c = default_car();
  c.steer_lag_sd = setting(0); /* which would find out some of what is told */
  return c;
}

static tse_filter_paper filter;
static tse_input rows[ROWS_RUN];
static double true_vx[ROWS_RUN], true_vy[ROWS_RUN];

/* ------------------------------------------------------------------------- inputs */

/* What lags behind the steering angle goes on for as long as that was missing, and no longer than the lags remember. */
static void test_time_without_a_steering_angle_is_made_up_for(void)
{
  tse_config c = told_car();
  c.steering_lag_time = setting(0.1);
  const tse_params p = prepared(&c);
  tse_filter a, b;
  tse_params row;
  sample y;
  memset(&a, 0, sizeof a);
  memset(&y, 0, sizeof y);
  y.has_inputs = y.has_steer = 1;
  y.dt = real(0.01);
  (void)told_inputs(&p, &a, &y, &row); /* at rest: straight ahead */
  b = a;
  y.u.steer = real(0.1);
  y.has_steer = 0;
  for (int i = 0; i < 3; i++) (void)told_inputs(&p, &a, &y, &row);
  expect_near(0.03, number(a.effects.steer_lost), 1e-7, "time lost", 0);
  y.has_steer = 1;
  const sample after = told_inputs(&p, &a, &y, &row);
  expect_near(0, number(a.effects.steer_lost), 0, "time lost", 1);
  y.dt = real(0.04);
  const sample at_once = told_inputs(&p, &b, &y, &row);
  expect_near(number(at_once.u.steer), number(after.u.steer), BY_FORMAT(1e-14, 1e-7), "steering angle", 0);
  TEST_ASSERT_TRUE(number(after.u.steer) > 0.005 && number(after.u.steer) < 0.09);
}

/* ------------------------------------------------------------------------- told against untold */

typedef struct drive { double speed, steer, torque; } drive;

static const drive lively = { 20, 0.035, 600 }, hard = { 20, 0.055, 2500 }, urban = { 5, 0.25, 400 };

/* Steering sweeps to 2 Hz, torque steps; sensor noise as told, spread 5 %. */
static void simulate(const tse_config *c, const drive *d)
{
  static tse_sim sim;
  tse_sim_config s;
  tse_sim_input u;
  tse_sim_output y;
  tse_sim_config_default(&s);
  s.speed = setting(d->speed);
  s.seed = 11;
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_sim_reset(&sim, c, &s, NULL));
  memset(&u, 0, sizeof u);
  u.dt = real(0.01);
  u.road_level = real(1);
  for (int i = 0; i < ROWS_RUN; i++) {
    const double t = 0.01 * i, torque = d->torque * (sin(1.3 * t) > 0 ? 1 : -1) + 0.4 * d->torque * sin(0.4 * t);
    const double sweep = d->speed > 10 ? 0.2 * t + 0.06 * t * t : 0.15 * t;
    u.steer_angle = real(d->steer * sin(6.283185307179586 * sweep) * (1 + 0.3 * sin(0.5 * t)) / 1.3 + 0.003);
    u.wheel_torque_front = real(0.6 * torque);
    u.wheel_torque_rear = real(0.4 * torque);
    TEST_ASSERT_EQUAL_INT(TSE_OK, tse_sim_step(&sim, &u, &y));
    rows[i] = y.row;
    rows[i].dt = real(0.01);
    true_vx[i] = number(y.vel_x);
    true_vy[i] = number(y.vel_y);
  }
}

typedef struct verdict { double stiffness, vx, vy, evidence; } verdict; /* worst RMS [1], RMS [m/s], mean [nat], second half */

static verdict estimate_with(tse_config c)
{
  double sum[6] = { 0 };
  tse_output y;
  const tse_params p = prepared(&c);
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_reset(&p, &filter.filter, sizeof filter));
  for (int i = 0; i < ROWS_RUN; i++) {
    TEST_ASSERT_TRUE(tse_step(&p, &filter.filter, &rows[i], &y) >= TSE_OK);
    if (i < ROWS_RUN / 2) continue;
    for (int a = 0; a < 3; a++) sum[a] += pow(number(y.stiffness[a]) - 1, 2);
    sum[3] += pow(number(y.vel_x) - true_vx[i], 2);
    sum[4] += pow(number(y.vel_y) - true_vy[i], 2);
    sum[5] += number(y.log_evidence);
  }
  const double n = ROWS_RUN - ROWS_RUN / 2;
  verdict v;
  v.stiffness = sqrt(fmax(fmax(sum[0], sum[1]), sum[2]) / n);
  v.vx = sqrt(sum[3] / n);
  v.vy = sqrt(sum[4] / n);
  v.evidence = sum[5] / n;
  return v;
}

typedef enum measure { STIFF, VEL_X, VEL_Y, EVIDENCE } measure;

/* Told, every effect leaves an estimator that is as good as one whose car has none (at walking pace that is less: slopes by C_x are of the
 * plain slip, which large angles move by as much as there is of it). Untold it is twice
 * as wrong in what the effect moves, or less likely: 0.02 nat a row are 15 over this half of a drive. */
static void expect_told_is_better(const tse_config *with, const drive *d, measure what, const char *name)
{
  char text[200];
  tse_config without = told_car();
  simulate(with, d);
  const verdict told = estimate_with(*with), untold = estimate_with(without);
  (void)snprintf(text, sizeof text, "%s: told %.4f %.4f %.4f %.3f, untold %.4f %.4f %.4f %.3f", name, told.stiffness, told.vx,
                 told.vy, told.evidence, untold.stiffness, untold.vx, untold.vy, untold.evidence);
  TEST_ASSERT_TRUE_MESSAGE(told.stiffness < (d->speed > 10 ? 0.05 : 0.15) && told.vx < 0.012 && told.vy < 0.012, text);
  TEST_ASSERT_TRUE_MESSAGE(told.evidence > untold.evidence - 0.02, text);
  switch (what) {
    case STIFF:
      TEST_ASSERT_TRUE_MESSAGE(2 * told.stiffness < untold.stiffness || told.evidence > untold.evidence + 0.02, text);
      break;
    case VEL_X: TEST_ASSERT_TRUE_MESSAGE(2 * told.vx < untold.vx, text); break;
    case VEL_Y: TEST_ASSERT_TRUE_MESSAGE(2 * told.vy < untold.vy, text); break;
    default: TEST_ASSERT_TRUE_MESSAGE(told.evidence > untold.evidence + 0.02, text); break;
  }
}

#define TELL(name, value, how, what)                          \
  do {                                                           \
    tse_config c = told_car();                                \
    c.name = setting(value);                            \
    expect_told_is_better(&c, &how, what, #name);             \
  } while (0)

static void test_told_of_nothing_the_estimator_is_as_good_as_these_tests_ask_for(void)
{
  const tse_config c = told_car();
  simulate(&c, &lively);
  const verdict v = estimate_with(c);
  TEST_ASSERT_TRUE(v.stiffness < 0.03 && v.vx < 0.012 && v.vy < 0.012);
}

static void test_told_of_the_cars_constants_the_stiffness_is_right(void)
{
  TELL(mass_change, 0.15, lively, STIFF);
  TELL(yaw_inertia_change, 0.2, lively, STIFF);
  TELL(cg_shift_distance, 0.12, lively, STIFF);
  TELL(wheel_radius_change, 0.02, lively, VEL_X);
}

static void test_told_of_the_steering_the_stiffness_is_right(void)
{
  TELL(steering_ratio_change, 0.06, lively, STIFF);
  TELL(steering_offset_angle, 0.006, lively, STIFF);
  TELL(steering_delay_time, 0.03, lively, STIFF);
  TELL(steering_lag_time, 0.04, lively, STIFF);
  TELL(steering_compliance_angle_per_moment, 6e-5, lively, STIFF);
}

static void test_told_of_the_axles_the_stiffness_is_right(void)
{
  TELL(exact_kinematics_share, 1, urban, VEL_X);
  TELL(rear_roll_steer_gain, 0.1, lively, STIFF);
  TELL(relaxation_length, 0.5, lively, STIFF);
  TELL(longitudinal_relaxation_length, 0.3, lively, STIFF);
  TELL(tyre_saturation_inverse_friction, 1, lively, STIFF);
  TELL(combined_slip_factor, 600, hard, STIFF);
  TELL(lateral_load_transfer_gain, 0.01, hard, STIFF);
  TELL(longitudinal_load_transfer_gain, 0.06, hard, STIFF);
  tse_config c = told_car();
  c.stiffness_drift_change = setting(-0.3); /* then 1 is the drifting nominal */
  c.stiffness_drift_time = setting(8);
  c.stiffness_drift_start = setting(2);
  expect_told_is_better(&c, &lively, STIFF, "stiffness_drift");
}

static void test_told_of_forces_the_velocity_is_right(void)
{
  TELL(aero_drag_coefficient, 2, lively, VEL_X);
  TELL(rolling_resistance_coefficient, 0.04, lively, VEL_X);
  TELL(grade_angle, 0.05, lively, VEL_X);
  TELL(bank_angle, 0.03, lively, VEL_Y);
  TELL(crosswind_speed, 10, lively, VEL_Y);
  TELL(conicity_front, 200, lively, VEL_Y);
  TELL(conicity_rear, 200, lively, VEL_Y);
  TELL(aligning_moment_trail, 0.1, lively, STIFF);
}

static void test_told_of_the_sensors_the_readings_are_right(void)
{
  TELL(imu_lever_arm_x, 0.8, lively, EVIDENCE);
  TELL(imu_lever_arm_x, -1.5, lively, EVIDENCE);
  TELL(imu_lever_arm_y, 0.5, lively, EVIDENCE);
  TELL(body_roll_gain, 0.0107, lively, EVIDENCE);
  TELL(pitch_leak_gain, 0.01, lively, EVIDENCE);
  TELL(imu_misalignment_angle, 0.05, lively, STIFF);
  TELL(imu_scale_ax_error, 0.08, lively, EVIDENCE);
  TELL(imu_scale_ay_error, 0.05, lively, EVIDENCE);
  TELL(gyro_scale_error, 0.05, lively, STIFF);
  TELL(imu_delay_time, 0.03, lively, STIFF);
}

/* ---------------------------------------------------------------------------------- the mean's motion */

static tse_config all_effects(double share)
{
  tse_config c = told_car();
#define EFFECT_PARAMETER(id, parameter, role, unit, def, lo, hi, typical_lo, typical_hi, negligible, sign, text) \
  if (role) c.id##_##parameter = setting(share * (typical_hi));
#include "tse/effects.def"
  return c;
}

/* Without measurements nothing but the model moves the mean: it is where tse_replay() is, all effects on. */
static void test_without_measurements_the_mean_follows_the_replay(void)
{
  tse_config c = all_effects(1);
  c.inputs_held = 0; /* as the replay has it */
  c.initial_mean_sd = c.initial_vel_x_sd = c.initial_vel_y_sd = c.initial_yaw_rate_sd = setting(0);
  const tse_params p = prepared(&c);
  const int n = 1000;
  const tse_replay_log log = the_log();
  tse_replay_start s = the_start();
  tse_output y;
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_reset(&p, &filter.filter, sizeof filter));
  straight(&c, 20, 0.01, n);
  for (int i = 0; i < n; i++) {
    log_steer[i] = real(0.03 * sin(0.03 * i));
    log_front[i] = log_rear[i] = real((20 + 2 * sin(0.01 * i)) / 0.33);
  }
  replay_with(&c, &log, n, &s);
  for (int i = 0; i < n; i++) {
    tse_input u;
    memset(&u, 0, sizeof u);
    u.dt = real(0.01);
    u.steer_angle = log_steer[i];
    u.wheel_speed_front = log_front[i];
    u.wheel_speed_rear = log_rear[i];
    u.missing = TSE_MISSING(accel_x) | TSE_MISSING(accel_y) | TSE_MISSING(yaw_rate);
    TEST_ASSERT_EQUAL_INT(TSE_W_PREDICTED, tse_step(&p, &filter.filter, &u, &y));
    expect_near(number(got_vx[i]), number(y.vel_x), BY_FORMAT(1e-6, 2e-3), "vel_x", i); /* sums of differences round; */
    expect_near(number(got_vy[i]), number(y.vel_y), BY_FORMAT(1e-6, 2e-3), "vel_y", i); /* headings are foretold       */
    expect_near(number(got_yaw[i]), number(y.yaw_rate), BY_FORMAT(1e-6, 1e-3), "yaw_rate", i);
  }
}

/* The row's constants are those of the secants at the mean; a memory that has not settled knows none. */
static void test_the_constants_of_a_row_are_scaled_axle_by_axle(void)
{
  const tse_config c = all_effects(1);
  const tse_params p = prepared(&c);
  tse_params row;
  sample y;
  memset(&y, 0, sizeof y);
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_reset(&p, &filter.filter, sizeof filter));
  for (int settled = 0; settled <= 1; settled++) {
    filter.filter.effects.settled = settled;
    for (int i = 0; i < 4; i++) filter.filter.effect_level[i] = real(0.5 + 0.125 * i);
    (void)told_inputs(&p, &filter.filter, &y, &row);
    const tse_real was[4] = { p.kx_front, p.kx_rear, p.ky_front, p.ky_rear }, now[4] = { row.kx_front, row.kx_rear, row.ky_front, row.ky_rear };
    for (int i = 0; i < 4; i++) expect_near(number(was[i]) * (settled ? 0.5 + 0.125 * i : 1), number(now[i]), BY_FORMAT(0, 1e-5), "k", i);
    TEST_ASSERT_TRUE(!(row.lf != p.lf) && row.particles == p.particles);
  }
}

/* A formula may make anything of a stiffness; what the filter takes over of it is bounded, and is a state that is accepted back. */
static void test_what_effects_make_of_a_stiffness_is_bounded(void)
{
  static const double shares[] = { 1e5, -1e5 };
  tse_output y;
  for (int k = 0; k < 2; k++) {
    tse_config c;
    tse_config_default(&c);
    c.formula_gain = setting(1);
    c.formula_a = setting(shares[k]);
    c.formula_place = 5; /* the share that the front cornering stiffness gains */
    c.formula_code_1 = 1;
    const tse_params p = prepared(&c);
    TEST_ASSERT_EQUAL_INT(TSE_OK, tse_reset(&p, &filter.filter, sizeof filter));
    for (int i = 0; i < 50; i++) {
      TEST_ASSERT_TRUE(tse_step(&p, &filter.filter, &rows[i], &y) >= TSE_OK);
      TEST_ASSERT_EQUAL_INT(TSE_OK, tse_filter_check(&p, &filter.filter, sizeof filter));
    }
    expect_near(k ? number(LEAST_LEVEL) : number(MOST_LEVEL), number(filter.filter.effect_level[2]), 0, "level", k);
    expect_near(1, number(filter.filter.effect_level[3]), 1e-5, "rear", k);
  }
}
#if defined(TSE_REAL_DOUBLE) || defined(TSE_REAL_FLOAT)
/* No row leads here, but a state that was loaded may: what is no number corrects nothing, and the memory starts anew. */
static void test_what_is_no_number_corrects_nothing(void)
{
  const tse_config c = all_effects(1);
  const tse_params p = prepared(&c);
  const tse_real none = TSE_R(0) / number(TSE_R(0));
  tse_real at[6] = { TSE_R(20), TSE_R(0.1), TSE_R(0.05), TSE_R(0), TSE_R(0), TSE_R(0) }, push[3];
  tse_params row = p;
  sample y, corrected;
  memset(&y, 0, sizeof y);
  y.dt = TSE_R(0.01);
  y.u.v_front = y.u.v_rear = TSE_R(20);
  for (int a = 0; a < 3; a++) y.use[a] = y.y[a] = TSE_R(1);
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_reset(&p, &filter.filter, sizeof filter));
  filter.filter.v_front = filter.filter.v_rear = TSE_R(20);

  told_motion(&p, &row, &filter.filter, &y, at, push); /* not settled yet: it settles first */
  TEST_ASSERT_EQUAL_INT32(1, filter.filter.effects.settled);
  for (int a = 0; a < 3; a++) TEST_ASSERT_TRUE(r_is_finite(push[a]));

  corrected = told_sample(&p, &row, &filter.filter, &y, at, 1, 0); /* wheels that nobody hears of: no correction */
  TEST_ASSERT_EQUAL_INT32(0, filter.filter.effects.settled);
  for (int a = 0; a < 3; a++) TEST_ASSERT_TRUE(!(corrected.y[a] < y.y[a]) && !(corrected.y[a] > y.y[a]));

  at[1] = none;
  corrected = told_sample(&p, &row, &filter.filter, &y, at, 1, 1);
  TEST_ASSERT_EQUAL_INT32(0, filter.filter.effects.settled);
  for (int a = 0; a < 3; a++) TEST_ASSERT_TRUE(r_is_finite(corrected.y[a]));
  told_motion(&p, &row, &filter.filter, &y, at, push);
  TEST_ASSERT_EQUAL_INT32(0, filter.filter.effects.settled);
  for (int a = 0; a < 3; a++) expect_near(0, number(push[a]), 0, "push", a);
}
#endif

/* ------------------------------------------------------------------------------------------------- off */

static void expect_same_bytes(const tse_config *a, const tse_config *b)
{
  static tse_output first[ROWS_RUN];
  const tse_params p = prepared(a), q = prepared(b);
  tse_output y;
  memset(&y, 0, sizeof y);
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_reset(&p, &filter.filter, sizeof filter));
  for (int i = 0; i < 600; i++) {
    TEST_ASSERT_TRUE(tse_step(&p, &filter.filter, &rows[i], &y) >= TSE_OK);
    first[i] = y;
  }
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_reset(&q, &filter.filter, sizeof filter));
  for (int i = 0; i < 600; i++) {
    TEST_ASSERT_TRUE(tse_step(&q, &filter.filter, &rows[i], &y) >= TSE_OK);
    TEST_ASSERT_EQUAL_MEMORY(&first[i], &y, sizeof y);
  }
}

/* The golden estimates (test_replay.c) say that this is also what the filter gave before there were effects. */
static void test_shapes_of_effects_that_are_off_change_no_bit_of_the_estimate(void)
{
  const tse_config plain = told_car();
  tse_config shaped = plain;
  simulate(&plain, &lively);
#define EFFECT_PARAMETER(id, parameter, role, unit, def, lo, hi, typical_lo, typical_hi, negligible, sign, text) \
  if (!role) shaped.id##_##parameter = setting(0.5 * (def) + 0.5 * (hi));
#include "tse/effects.def"
  expect_same_bytes(&plain, &shaped);
}

/* -------------------------------------------------------------------------------------- whatever comes */

/* Each strength at its ends, then all of them: standstill, reverse, gaps, missing inputs, sliding wheels. */
static void expect_numbers(tse_config c, const char *name)
{
  uint32_t seed = 3;
  const tse_params p = prepared(&c);
  tse_output y;
  double speed = 0;
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_reset(&p, &filter.filter, sizeof filter));
  for (int i = 0; i < 400; i++) {
    tse_input u;
    memset(&u, 0, sizeof u);
    speed = i < 20 ? 0 : i < 300 ? fmin(speed + 0.3, 45) : i < 340 ? speed - 1.5 : -3;
    u.dt = real(i % 97 == 96 ? 0.7 : i % 31 == 30 ? 0.05 : 0.01);
    u.steer_angle = real(0.1 * sin(0.1 * i) + next_between(&seed, -0.01, 0.01));
    u.wheel_speed_front = real(speed / 0.33 * (i % 53 == 52 ? 0.3 : 1));
    u.wheel_speed_rear = real(speed / 0.33);
    u.accel_x = real(next_between(&seed, -6, 6));
    u.accel_y = real(next_between(&seed, -8, 8));
    u.yaw_rate = real(next_between(&seed, -0.5, 0.5));
    if (i % 41 == 40) u.missing = TSE_MISSING(steer_angle);
    if (i % 43 >= 30 && i > 200) u.missing = TSE_MISSING(wheel_speed_front);
    if (i % 37 == 36) u.missing |= TSE_MISSING(accel_y);
    TEST_ASSERT_TRUE_MESSAGE(tse_step(&p, &filter.filter, &u, &y) >= TSE_OK, name);
    TEST_ASSERT_TRUE_MESSAGE(isfinite(number(y.vel_x)) && isfinite(number(y.vel_y)) && isfinite(number(y.yaw_rate)), name);
    for (int a = 0; a < 3; a++)
      TEST_ASSERT_TRUE_MESSAGE(isfinite(number(y.stiffness[a])) && number(y.stiffness[a]) > 0 && isfinite(number(y.bias[a])), name);
    TEST_ASSERT_TRUE_MESSAGE(fabs(number(y.vel_y)) < 200.001 && isfinite(number(filter.filter.effects.mode[0][0])), name);
  }
}

static void test_estimates_stay_numbers_at_both_ends_of_every_effect(void)
{
  tse_config all = told_car();
#define EFFECT_PARAMETER(id, parameter, role, unit, def, lo, hi, typical_lo, typical_hi, negligible, sign, text)       \
  {                                                                                                                    \
    tse_config c = told_car();                                                                                      \
    c.id##_##parameter = setting(lo); expect_numbers(c, #id " " #parameter " low");                              \
    c.id##_##parameter = setting(hi); expect_numbers(c, #id " " #parameter " high");                             \
    if (role) { c.id##_##parameter = setting(1e-30); expect_numbers(c, #id " " #parameter " next to nothing"); }   \
    all.id##_##parameter = setting(hi);                                                                          \
  }
#include "tse/effects.def"
  expect_numbers(all, "all high");
}

/* After a gap the tyres hold the slip that there is; nothing of before is left but clock and heading. */
static void test_a_gap_starts_the_memory_anew(void)
{
  tse_config c = all_effects(1);
  const tse_params p = prepared(&c);
  simulate(&c, &lively);
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_reset(&p, &filter.filter, sizeof filter));
  for (int i = 0; i < 300; i++) TEST_ASSERT_TRUE(tse_step(&p, &filter.filter, &rows[i], NULL) >= TSE_OK);
  const double clock = number(filter.filter.effects.time);
  expect_near(2.99, clock, BY_FORMAT(1e-9, 1e-4), "clock", 0);
  TEST_ASSERT_TRUE(filter.filter.effects.steer.count > 2 && filter.filter.effects.imu.count > 2);
  rows[300].dt = real(5);
  TEST_ASSERT_TRUE(tse_step(&p, &filter.filter, &rows[300], NULL) >= TSE_OK);
  TEST_ASSERT_EQUAL_INT32(1, filter.filter.effects.imu.count);
  TEST_ASSERT_EQUAL_INT32(1, filter.filter.effects.settled);
  expect_near(0, number(filter.filter.effects.mode[MODE_ROLL][1]), 0, "at rest", 0);
  expect_near(clock, number(filter.filter.effects.time), 0, "clock", 1);
}

int main(void)
{
  UNITY_BEGIN();
  RUN_TEST(test_time_without_a_steering_angle_is_made_up_for);
  RUN_TEST(test_told_of_nothing_the_estimator_is_as_good_as_these_tests_ask_for);
  RUN_TEST(test_told_of_the_cars_constants_the_stiffness_is_right);
  RUN_TEST(test_told_of_the_steering_the_stiffness_is_right);
  RUN_TEST(test_told_of_the_axles_the_stiffness_is_right);
  RUN_TEST(test_told_of_forces_the_velocity_is_right);
  RUN_TEST(test_told_of_the_sensors_the_readings_are_right);
  RUN_TEST(test_without_measurements_the_mean_follows_the_replay);
  RUN_TEST(test_the_constants_of_a_row_are_scaled_axle_by_axle);
  RUN_TEST(test_what_effects_make_of_a_stiffness_is_bounded);
#if defined(TSE_REAL_DOUBLE) || defined(TSE_REAL_FLOAT)
  RUN_TEST(test_what_is_no_number_corrects_nothing);
#endif
  RUN_TEST(test_shapes_of_effects_that_are_off_change_no_bit_of_the_estimate);
  RUN_TEST(test_estimates_stay_numbers_at_both_ends_of_every_effect);
  RUN_TEST(test_a_gap_starts_the_memory_anew);
  return UNITY_END();
}
