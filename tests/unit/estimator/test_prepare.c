/* tests/unit/estimator/test_prepare.c <-> src/estimator/prepare.c, latencies.c */
#include "tables/constants.h"
#include "filter/types.h"
#include "unit_support.h"
#include "tables/rows.h"
#include "tables/config.h"

#include <float.h>
#include <stddef.h>

static tse_config defaults(void) { return config_by(tse_config_exact); }

/* Settings that all differ from the defaults and from each other, within the ranges. No
 * effects. */
static tse_config other_car(void)
{
  tse_config c = defaults();
  c.mass = setting(1250), c.yaw_inertia = setting(1700), c.lf = setting(1.1), c.lr = setting(1.6);
  c.wheel_radius_front = setting(0.29), c.wheel_radius_rear = setting(0.31);
  c.longitudinal_stiffness_front = setting(110000), c.longitudinal_stiffness_rear = setting(95000);
  c.cornering_stiffness_front = setting(70000), c.cornering_stiffness_rear = setting(85000);
  c.rear_longitudinal_follows_front = setting(0.25), c.accel_x_sd = setting(0.11),
  c.accel_y_sd = setting(0.23);
  c.yaw_rate_sd = setting(0.007), c.wheel_noise_sd = setting(0.06), c.steer_lag_sd = setting(0.05);
  c.mass_sd = setting(0.03), c.grade_sd = setting(0.025), c.model_sd = setting(0.04);
  int considered = 0;
  const tse_field *const first = field_of(TSE_STRUCT_CONFIG, "yaw_inertia_sd");
  for (; considered < TSE_CONSIDER_MODEL - TSE_CONSIDER_INERTIA; considered++)
    put_field(&c, first + considered, first[considered].hi / (4 + considered));
  c.steer_angle_latency = setting(0.006), c.wheel_speed_front_latency = setting(0.012);
  c.wheel_speed_rear_latency = setting(0.015), c.accel_x_latency = setting(-0.003);
  c.accel_y_latency = setting(-0.009), c.ins_velocity_sd = setting(0.06), c.gnss_speed_sd = setting(0.14);
  c.gnss_course_sd = setting(0.013), c.wheel_torque_least = setting(45), c.road_sd = setting(0.007),
  c.velocity_latency = setting(0.017);
  c.velocity_latency_sd = setting(0.019), c.velocity_lever_x = setting(0.55);
  c.velocity_lever_y = setting(-0.45), c.velocity_lever_sd = setting(0.16),
  c.velocity_heading = setting(0.021);
  c.velocity_heading_sd = setting(0.024), c.velocity_scale_sd = setting(0.026);
  c.accel_x_bias_sd = setting(0.02), c.accel_y_bias_sd = setting(0.04), c.yaw_rate_bias_sd = setting(0.003);
  c.accel_x_bias_walk = setting(0.005), c.accel_y_bias_walk = setting(0.006);
  c.yaw_rate_bias_walk = setting(0.0007), c.sample_time = setting(0.02), c.forgetting = setting(0.995);
  c.resample_threshold = setting(0.75), c.initial_cx_front = setting(0.7), c.initial_cy_front = setting(0.8);
  c.initial_cy_rear = setting(1.3), c.initial_mean_sd = setting(0.4), c.initial_cx_sd = setting(0.35);
  c.initial_cy_front_sd = setting(0.15), c.initial_cy_rear_sd = setting(0.22), c.grip = setting(0.9);
  c.grip_sd = setting(0.2), c.cg_height = setting(0.6), c.initial_spread = setting(0.2);
  c.spread_max = setting(0.7), c.initial_dof = setting(12), c.learnt_floor = setting(0.08);
  c.learnt_walk_day = setting(0.04), c.initial_vel_x = setting(17), c.initial_vel_x_sd = setting(0.3);
  c.initial_vel_y_sd = setting(0.2), c.initial_yaw_rate_sd = setting(0.05), c.stiffness_min = setting(0.2);
  c.stiffness_max = setting(3), c.hold_speed = setting(4), c.max_steer = setting(0.6);
  c.max_slip = setting(0.08), c.noise_max = setting(12), c.max_gap = setting(0.2), c.valid_sd = setting(0.05);
  c.forgetting_mean = setting(0.97), c.forgetting_change = setting(0.8), c.spread_kernel = setting(0.03);
  c.integration = 2, c.reflect_draws = 1, c.particles = 120, c.form = MOST_FORM > 0, c.driven_axle = 2,
  c.wheel_signals = 1;
  c.steady_walk = setting(0.002), c.resampling = 2, c.initial_vel_x_from_wheels = 0, c.seed = 12345;
  return c;
}

static int is_kinematics(const char *setting) { return strcmp(setting, "exact_kinematics_share") == 0; }

static tse_config other_config(void)
{
  tse_config c = other_car();
  EACH_PARAMETER(e)
  put_parameter(&c, e, 0.9 * e->def + 0.1 * (e->def < e->hi ? e->hi : e->lo));
  EACH_SETTING(row)
  if (strncmp(row->name, "formula_", 8) == 0)
    put_field(&c, row, row->kind == 's' ? 0.25 : row->hi < 10 ? 4 : 0x242424 /* neg */);
  c.formula_code_1 = 0x242401; /* of a */
  return c;
}

/* ------------------------------------------------------------------------------------------ constants */

#if !defined(TSE_SMALL) /* no particle filter */
/* A constant computed from a default, or from a setting that these tests omit, would be
 * missed. */
static void test_settings_of_the_tests_below_are_none_of_the_defaults(void)
{
  const tse_config c = other_config(), usual[2] = { defaults(), config_by(tse_config_default) };
  for (int k = 0; k < 2; k++) EACH_SETTING(row)
  TEST_ASSERT_TRUE_MESSAGE(row->kind == 's' ? setting_field(&c, row) != setting_field(&usual[k], row)
                                            : whole_field(&c, row) != whole_field(&usual[k], row),
      row->name);
}
#endif

static void expect_relative(double expected, tse_real actual, const char *what)
{
  expect_near(
      expected, number(actual), BY_FORMAT(1e-13, 3e-7) * fabs(expected) + QUANTUM, what, 0); /* rounding */
}

static void test_vehicle_constants_are_normalised_by_mass(void)
{
  const tse_params p = prepared(other_car());
  expect_relative(110000.0 / 1250, p.car.kx_front, "kx_front");
  expect_relative(95000.0 / 1250, p.car.kx_rear, "kx_rear");
  expect_relative(70000.0 / 1250, p.car.ky_front, "ky_front");
  expect_relative(85000.0 / 1250, p.car.ky_rear, "ky_rear");
  expect_relative(0.25, p.follow, "follow");
  expect_relative(1.1, p.car.lf, "lf");
  expect_relative(1.6, p.car.lr, "lr");
  expect_relative(1250 * 1.1 / 1700, p.car.jf, "jf");
  expect_relative(1250 * 1.6 / 1700, p.car.jr, "jr");
  expect_relative(0.29, p.radius_front, "radius_front");
  expect_relative(0.31, p.radius_rear, "radius_rear");
}

/* The centre of gravity stays between the axles, at most 90 % of the way. */
static void test_a_centre_of_gravity_is_shifted_no_further_than_between_the_axles(void)
{
  static const double row[][5] = {
    /* lf, lr, shift; resulting lf, lr */
    { 1.1, 0.4, 0.6, 1.46, 0.04 },
    { 0.4, 1.1, -0.6, 0.04, 1.46 },
    { 1.1, 0.4, 0.3, 1.4, 0.1 },
    { 0.4, 1.1, -0.3, 0.1, 1.4 },
  };
  for (int k = 0; k < ROWS(row); k++) {
    tse_config c = defaults();
    c.lf = setting(row[k][0]), c.lr = setting(row[k][1]), c.cg_shift_distance = setting(row[k][2]);
    const tse_params p = prepared(c);
    expect_near(row[k][3], number(p.car.lf), 1e-6, "lf", k);
    expect_near(row[k][4], number(p.car.lr), 1e-6, "lr", k);
  }
}

static void test_sensor_constants_are_normalised_by_the_sensors_sd(void)
{
  const tse_params p = prepared(other_car());
  const double sd[3] = { 0.11, 0.23, 0.007 }, bias[3] = { 0.02, 0.04, 0.003 },
               walk[3] = { 0.005, 0.006, 0.0007 };
  for (int i = 0; i < 3; i++) {
    expect_relative(sd[i], p.sd[i], "sd");
    expect_relative(1 / sd[i], p.inv_sd[i], "inv_sd");
    expect_relative(bias[i] * bias[i] / sd[i] / sd[i], p.bias_var0[i], "bias_var0");
    expect_relative(walk[i] * walk[i] / sd[i] / sd[i], p.bias_walk[i], "bias_walk");
    expect_near(log(sd[i]) / log(2.0), number(p.log_sd[i]), BY_FORMAT(3e-13, 3e-6), "log_sd", i);
  }
  expect_relative(9e-4, p.mass_var, "mass_var");
}

/* Constants of the car in the filter's model, divided by mass. Constants of effects that
 * are off are 0 or 1. */
static void test_the_car_of_the_model_is_that_of_the_settings(void)
{
  tse_config c = other_car();
  c.relaxation_length = setting(0.5), c.body_roll_gain = setting(0.005), c.body_roll_frequency = setting(1.5);
  c.body_roll_damping = setting(0.25), c.body_roll_height = setting(0.2), c.body_roll_coupling = setting(0.4);
  c.aero_drag_coefficient = setting(0.4), c.rolling_resistance_coefficient = setting(0.012);
  c.aligning_moment_trail = setting(0.03), c.imu_misalignment_angle = setting(-0.05);
  c.gyro_scale_error = setting(0.02), c.steering_lag_time = setting(0.04);
  const tse_params p = prepared(c);
  const tse_car *const k = &p.car;
  expect_relative(9.81 * 1.6 / 2.7, k->load_front, "load_front");
  expect_relative(9.81 * 1.1 / 2.7, k->load_rear, "load_rear");
  expect_relative(0.9, k->grip, "grip");
  expect_relative(1250.0 / 1700, k->m_inertia, "m_inertia");
  expect_relative(1250.0 / 1700 * 0.03, k->trail, "trail");
  expect_relative(0.4 / 1250, k->drag, "drag");
  expect_relative(9.81 * 0.012, k->rolling, "rolling");
  expect_relative(0.5, k->relaxation, "relaxation");
  expect_relative(0.005, k->roll_gain, "roll_gain");
  expect_relative(2 * acos(-1.0) * 1.5, k->roll_omega, "roll_omega");
  expect_relative(9.81, k->roll_leak, "roll_leak");
  expect_relative(0.2, k->roll_height, "roll_height");
  expect_relative(0.25, k->roll_damping, "roll_damping");
  expect_relative(0.4, k->roll_coupling, "roll_coupling");
  expect_near(cos(0.05), number(k->mount_cos), BY_FORMAT(1e-12, 1e-6), "mount_cos", 0);
  expect_near(-sin(0.05), number(k->mount_sin), BY_FORMAT(1e-12, 1e-6), "mount_sin", 0);
  expect_relative(1.02, k->scale_r, "scale_r");
  expect_relative(9.81 * 0.012 * 1.6 / 2.7 * 1250 / 110000, k->free_front, "free_front");
  expect_relative(9.81 * 0.012 * 1.1 / 2.7 * 1250 / 95000, k->free_rear, "free_rear");
  TEST_ASSERT_EQUAL_INT32(2, k->driven);
  expect_relative(0.04, p.steer_lag, "steer_lag");
  const tse_params q = prepared(defaults());
  expect_relative(50, q.car.grip, "tyres without an end");
  expect_relative(0.05, q.car.relaxation, "no shorter relaxation");
  TEST_ASSERT_TRUE(number(q.car.drag) == 0 && number(q.car.compliance) == 0 && number(q.car.roll_leak) == 0);
  expect_relative(1, q.car.scale_x, "scale_x");
  expect_relative(1, q.car.mount_cos, "mount_cos");
  c.grip = setting(0), c.tyre_saturation_inverse_friction = setting(1.25);
  expect_relative(0.8, prepared(c).car.grip, "grip of the effect");
}

/* 1/friction of an axle is (1 +- balance) times the mean of both, including friction
 * given by the setting `grip`. */
static void test_friction_of_each_axle_is_that_of_both_and_a_balance(void)
{
  for (int stated = 0; stated < 2; stated++) {
    tse_config c = other_car();
    c.grip = setting(stated ? 0.8 : 0), c.tyre_saturation_inverse_friction = setting(stated ? 0 : 1.25);
    const tse_car even = prepared(c).car;
    /* without balance: the same bits */
    TEST_ASSERT_EQUAL_MEMORY(&even.load_front, &even.end_front, sizeof even.load_front);
    TEST_ASSERT_EQUAL_MEMORY(&even.load_rear, &even.end_rear, sizeof even.load_rear);
    c.tyre_saturation_balance = setting(0.25);
    const tse_car unlike = prepared(c).car;
    expect_relative(
        9.81 * 1.6 / 2.7 * 0.64, r_mul(unlike.grip, unlike.end_front), "front: friction 0.8/1.25");
    expect_relative(
        9.81 * 1.1 / 2.7 * 0.8 / 0.75, r_mul(unlike.grip, unlike.end_rear), "rear: friction 0.8/0.75");
    /* the total of the axles is the same */
    TEST_ASSERT_EQUAL_MEMORY(&even.load_front, &unlike.load_front, sizeof even.load_front);
  }
}

static void test_the_prior_of_the_state_is_that_of_the_settings(void)
{
  tse_config c = other_car();
  c.steering_offset_angle = setting(0.004), c.grade_angle = setting(0.02), c.bank_angle = setting(0.01);
  const tse_params p = prepared(c);
  static const int at[] = { BX, BY, BR, LCX, LCF, LCR, LMU, STEER_OFFSET, GAIN, LATE, RAD, LEAN };
  const double sd[] = { 0.02, 0.04, 0.003, 0.35, 0.15, 0.22, 0.2, of_setting(c.steer_offset_sd),
    of_setting(c.steer_ratio_sd), 0.05, of_setting(c.wheel_radius_sd), of_setting(c.lean_sd) };
  for (int i = 0; i < (int)(sizeof at / sizeof at[0]); i++)
    expect_near(sd[i], number(p.prior_sd[at[i]]), 1e-7, "prior_sd", i);
  const double mean[3] = { log(0.7), log(0.8), log(1.3) };
  for (int i = 0; i < 3; i++)
    expect_near(mean[i], number(p.prior[stiffness_at(i)]), BY_NUMBER(1e-12, 1e-6, 1e-6), "prior", i);
  expect_near(0.004, number(p.prior[STEER_OFFSET]), 1e-9, "offset", 0);
  expect_near(9.81 * sin(0.02), number(p.prior[GX]), 1e-6, "along the road", 0);
  expect_near(-9.81 * sin(0.01), number(p.prior[GY]), 1e-6, "across the road", 0);
  expect_near(9.81 * 0.025, number(p.prior_sd[GX]), 1e-6, "sd of the grade", 0);
  expect_near(log(0.2), number(p.log_min), BY_NUMBER(1e-12, 1e-6, 1e-6), "log_min", 0);
  expect_near(log(3), number(p.log_max), BY_NUMBER(1e-12, 1e-6, 1e-6), "log_max", 0);
  c.wheel_radius_sd = setting(0); /* a car that is known exactly: no radius is estimated */
  expect_near(0.002, number(prepared(c).prior_sd[RAD]), 1e-7, "no radius is known exactly", 0);
  expect_relative(0.04, p.model_sd, "model_sd");
  static const int of[] = { CONSIDER_INERTIA, CONSIDER_CENTRE, CONSIDER_TRAIL, CONSIDER_RELAXATION_FRONT,
    CONSIDER_RELAXATION_REAR, CONSIDER_ROLL_STEER, CONSIDER_SCALE, CONSIDER_GYRO, CONSIDER_WHEELS_LATE,
    CONSIDER_ACCEL_LATE };
  const tse_setting told[] = { c.yaw_inertia_sd, c.cg_sd, c.trail_sd, c.relaxation_sd, c.relaxation_sd,
    c.roll_steer_sd, c.accel_y_scale_sd, c.gyro_scale_sd, c.wheel_delay_sd, c.accel_delay_sd };
  for (int q = 0; q < (int)(sizeof of / sizeof of[0]); q++)
    expect_near(of_setting(told[q]), number(p.uncertain[of[q]]), 1e-9, "uncertain", q);
}

static void test_channels_are_read_as_long_before_the_row_as_the_latest_one_needs(void)
{
  static const double age[6] = { 0.017 - 0.006, 0.017 - 0.012, 0.002, 0.02, 0.017 + 0.009,
    0.017 }; /* in the order of a row */
  const tse_params p = prepared(other_car());
  expect_relative(0.017, p.latency, "latency");
  expect_relative(0.017 + 0.009, p.latency_span, "latency_span");
  expect_relative(0.026 / (TSE_LATENCY_ROWS - 2), p.latency_least, "latency_least");
  for (int k = 0; k < 6; k++) expect_near(age[k], number(p.latency_age[k]), BY_FORMAT(1e-16, 1e-8), "age", k);
  const tse_params q = prepared(defaults());
  for (int k = 0; k < 6; k++) expect_near(0, number(q.latency_age[k]), 0, "latency_age", k);
  expect_near(0, number(q.latency_span), 0, "latency_span", 0);
}

#if !defined(TSE_SMALL) /* no particle filter */
static void test_filter_constants_follow_their_formulas(void)
{
  const tse_params p = prepared(other_car());
  TEST_ASSERT_EQUAL_HEX32(TSE_PARAMS_MAGIC, p.magic);
  TEST_ASSERT_EQUAL_INT32(120, p.particles);
  TEST_ASSERT_EQUAL_INT32(2, p.resampling);
  TEST_ASSERT_EQUAL_INT32(1, p.form);
  expect_relative(4e-6, p.steady_walk, "steady_walk, squared");
  TEST_ASSERT_EQUAL_INT32(0, p.vel_x_from_wheels);
  TEST_ASSERT_EQUAL_UINT32(12345u, p.seed[0]);
  expect_relative(0.02, p.sample_time, "sample_time");
  expect_relative(50, p.inv_sample_time, "inv_sample_time");
  expect_relative(0.03, p.max_step, "max_step: 1.5 sample times");
  const double yaw = (1.1 * 1.1 * 70000 + 1.6 * 1.6 * 85000) / 1700;
  expect_relative(4 * yaw, p.damping, "damping: four times the fastest, here of the yaw rate");
  expect_relative(4 / (4 * yaw), p.least_step, "least_step: at hold_speed");
  expect_relative(0.2, p.max_gap, "max_gap");
  expect_relative(0.08, p.max_slip, "max_slip");
  expect_relative(144, p.noise_max_var, "noise_max, squared");
  expect_relative(4, p.hold_speed, "hold_speed");
  expect_relative(0.6, p.max_steer, "max_steer");
  expect_near(log(0.995) / log(2.0), number(p.log2_forgetting), BY_FORMAT(1e-14, 1e-7), "log2 lambda", 0);
  expect_near(200, number(p.memory), BY_FORMAT(1e-10, 3e-3), "memory: 1/(1 - lambda)", 0); /* cancellation */
  expect_relative(90, p.resample_at, "resample_at");
  expect_near(-0.3, number(p.mu0[0]), BY_FORMAT(1e-15, 1e-7), "mu0", 0);
  expect_near(-0.2, number(p.mu0[1]), BY_FORMAT(1e-15, 1e-7), "mu0", 1);
  expect_near(0.3, number(p.mu0[2]), BY_FORMAT(1e-15, 1.2e-7), "mu0", 2);
  expect_relative(12, p.nu0, "nu0");
  expect_relative(0.04, p.spread_var, "spread_var");
  expect_relative(0.49, p.spread_max_var, "spread_max_var");
  expect_relative(0.16, p.mean_var0, "mean_var0");
  expect_relative(0.0064, p.learnt_floor, "learnt_floor, squared");
  expect_relative(0.0016, p.learnt_walk, "learnt_walk_day, squared");
  expect_relative(17, p.vel_x0, "vel_x0");
  expect_relative(0.3, p.x_sd0[0], "vel_x_sd");
  expect_relative(0.2, p.x_sd0[1], "vel_y_sd");
  expect_relative(0.05, p.x_sd0[2], "yaw_rate_sd");
  expect_near(-0.8, number(p.w_min), BY_FORMAT(1e-15, 1e-7), "w_min", 0);
  expect_relative(2, p.w_max, "w_max");
  expect_relative(0.0025, p.valid_var, "valid_var");
  expect_near(log(0.97) / log(2.0), number(p.log2_forgetting_mean), BY_FORMAT(1e-14, 1e-7),
      "log2 lambda of the mean", 0);
  expect_relative(0.97, p.forgetting_mean, "forgetting_mean");
  expect_relative(0.8, p.forgetting_change, "forgetting_change");
  expect_relative(0.03 / log(2.0), p.kernel, "spread_kernel in log2");
  TEST_ASSERT_EQUAL_INT32(2, p.integration);
  expect_near(
      -0.8, number(p.w_low), BY_FORMAT(1e-15, 1e-7), "w_low: draws are reflected at stiffness_min", 0);
}
#endif

static void test_off_is_off(void)
{
  tse_config c = other_car();
  c.forgetting_mean = setting(0), c.reflect_draws = 0, c.spread_max = setting(2);
  const tse_params p = prepared(c);
  expect_relative(0.995, p.forgetting_mean, "lambda of the mean is lambda");
  expect_relative(-2, p.w_low, "draws are free down to -(stiffness_max - 1)");
  TEST_ASSERT_TRUE(number(p.spread_max_var) > 1e5); /* sd 300: no limit */
}

/* The fastest of the three damping rates, times speed. The smallest step is at least an
 * eighth of the largest. */
static void test_damping_is_that_of_the_stiffest_direction(void)
{
  tse_config c = other_car();
  c.yaw_inertia = setting(17000);
  expect_relative(4 * 205000.0 / 1250, prepared(c).damping, "longitudinal");
  c.cornering_stiffness_front = setting(500000);
  expect_relative(4 * 585000.0 / 1250, prepared(c).damping, "lateral");
  c.longitudinal_stiffness_front = setting(1e7);
  expect_relative(0.03 / 8, prepared(c).least_step, "least_step");
}

/* Sigma = Lambda/(nu - d_w - 1) with lam = Lambda/nu is the squared spread. gamma Sigma
 * is the variance of the mean. */
static void test_both_meanings_of_the_initial_sd_come_out_of_the_statistics(void)
{
  const tse_params p = prepared(other_car());
  const double sigma = number(p.lam0) * number(p.nu0) / (number(p.nu0) - 3 - 1);
  expect_near(0.2, sqrt(sigma), BY_FORMAT(1e-15, 1e-7), "spread", 0);
  expect_near(0.4, sqrt(number(p.gamma0) * sigma), BY_FORMAT(1e-15, 2e-7), "sd of the mean", 0);
}

/* Returned: 1; 0 if the number format refuses these settings */
static int expect_finite_constants(const tse_config *settings, const char *name)
{
  const size_t first = offsetof(tse_params, follow),
               end = offsetof(tse_params, car) + offsetof(tse_car, driven);
  tse_config c = *settings;
  fit_together(&c);
  tse_params p;
  if (!prepared_if_held(&c, &p)) return 0;
  TEST_ASSERT_TRUE((end - first) % sizeof(tse_real) == 0); /* only tse_real between the two */
  for (size_t at = first; at < end; at += sizeof(tse_real)) {
    tse_real x;
    memcpy(&x, (const char *)&p + at, sizeof x);
    TEST_ASSERT_TRUE_MESSAGE(r_is_finite(x), name);
  }
  return 1;
}

/* Set one setting after the other to the limit of its range, and keep it there if the
 * number format can represent the car. */
static void test_constants_are_finite_at_both_ends_of_every_range(void)
{
  tse_config c = defaults();
  int held = 0, all = 0;
  for (int end = 0; end < 2; end++) EACH_SETTING(row)
    {
      const tse_config was = c;
      put_field(&c, row, end ? row->hi : row->lo);
      all++;
      if (expect_finite_constants(&c, row->name)) held++;
      else c = was;
    }
  TEST_ASSERT_TRUE(held >= BY_NUMBER(all, all, 0.9 * all));
}

static void test_no_seed_gives_the_key_of_only_zeros(void)
{
  tse_config c = defaults();
  c.seed = 0;
  const tse_params p = prepared(c);
  TEST_ASSERT_TRUE(p.seed[0] != 0 || p.seed[1] != 0);
}

static void test_same_settings_give_the_same_bytes(void)
{
  const tse_config c = other_config();
  tse_params a, b;
  memset(&a, 0x11, sizeof a);
  memset(&b, 0xee, sizeof b);
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_prepare(&c, &a, NULL));
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_prepare(&c, &b, NULL));
  TEST_ASSERT_EQUAL_MEMORY(&a, &b, sizeof a);
}

#if !defined(TSE_SMALL) /* no particle filter */
/* Including the smallest change that the number format can represent. */
static void test_fingerprint_changes_with_every_setting(void)
{
  const uint32_t before = prepared(other_config()).fingerprint;
  EACH_SETTING(row)
  {
    tse_config c = other_config();
    if (row->kind == 's') {
      put_setting(&c, row, towards(setting_field(&c, row), INFINITY));
      TEST_ASSERT_TRUE_MESSAGE(prepared(c).fingerprint != before, row->name);
      put_field(&c, row, row->lo);
      tse_params p;
      if (prepared_if_held(&c, &p)) TEST_ASSERT_TRUE_MESSAGE(p.fingerprint != before, row->name);
    } else {
      put_field(
          &c, row, whole_field(&c, row) < row->hi ? whole_field(&c, row) + 1 : whole_field(&c, row) - 1);
      TEST_ASSERT_TRUE_MESSAGE(prepared(c).fingerprint != before, row->name);
    }
  }
}
#endif

static void test_fingerprint_changes_with_every_bit_of_a_setting(void)
{
  tse_config a = defaults(), b;
  for (int bit = 0; bit < 31; bit++) {
    b = a;
    b.seed = (int32_t)(1u << bit);
    a.seed = 0;
    TEST_ASSERT_TRUE(prepared(a).fingerprint != prepared(b).fingerprint);
  }
  a.initial_vel_x = setting(17);
  b = a;
  b.initial_vel_x = setting(-17); /* the sign bit only */
  TEST_ASSERT_TRUE(prepared(a).fingerprint != prepared(b).fingerprint);
}

static void test_fingerprint_tells_settings_that_were_exchanged(void)
{
  tse_config a = defaults(), b = defaults();
  a.accel_x_sd = b.accel_y_sd = setting(0.2), a.accel_y_sd = b.accel_x_sd = setting(0.3);
  TEST_ASSERT_TRUE(prepared(a).fingerprint != prepared(b).fingerprint);
}

/* A strength other than zero makes another vehicle, and so does a shape once its effect
 * is on. Kinematics are always exact in the filter. */
static void test_fingerprint_of_the_vehicle_tells_the_shapes_of_effects_that_are_on(void)
{
  tse_config c = other_config();
  const uint32_t before = prepared(c).vehicle;
  EACH_PARAMETER(e)
  {
    c = other_config();
    put_parameter(&c, e, 0.8 * e->def + 0.2 * (e->def < e->hi ? e->hi : e->lo));
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        is_kinematics(e->setting), prepared(c).vehicle == before, e->setting); /* always exact */
  }
}

/* A learnt state from before tyre_saturation had a balance still belongs to its vehicle.
 * With balance 0, the fingerprint contains only the other numbers of the effect, by their
 * names: FNV-1a over single precision. */
static void test_fingerprint_of_the_vehicle_has_a_balance_of_the_friction_only_where_there_is_one(void)
{
  static const char *const names[2] = { "tyre_saturation_inverse_friction", "tyre_saturation_shape" };
  const float values[2] = { 1.25f, 0.5f };
  tse_config c = defaults();
  uint32_t hash = prepared(c).vehicle;
  for (int i = 0; i < 2; i++) {
    uint32_t bits;
    for (const char *at = names[i]; *at; at++)
      for (int k = 0; k < 4; k++) hash = (hash ^ (k == 0 ? (uint32_t)(unsigned char)*at : 0u)) * 16777619u;
    memcpy(&bits, &values[i], sizeof bits);
    for (int k = 0; k < 4; k++) hash = (hash ^ (bits >> 8 * k & 255u)) * 16777619u;
  }
  c.tyre_saturation_inverse_friction = setting(1.25), c.tyre_saturation_shape = setting(0.5);
  TEST_ASSERT_EQUAL_HEX32(hash, prepared(c).vehicle);
  c.tyre_saturation_balance = setting(-0.125);
  TEST_ASSERT_TRUE(prepared(c).vehicle != hash);
}

/* The same value for another effect makes another vehicle: fingerprints of all strengths
 * differ. */
static void test_fingerprint_of_the_vehicle_tells_which_effect_a_value_is_of(void)
{
  enum { MOST = 64 };
  static uint32_t seen[MOST];
  static const char *whose[MOST];
  int count = 0, alone = 0;
  const double value = 0.0625; /* exact in every format, and within most ranges */
  EACH_PARAMETER(e)
  {
    tse_config c = defaults();
    tse_params p;
    if (e->strength != 1 || is_kinematics(e->setting) || e->lo > value || e->hi < value || count == MOST)
      continue;
    put_parameter(&c, e, value);
    if (!prepared_if_held(&c, &p)) continue;
    for (int k = 0; k < count; k++)
      if (seen[k] == p.vehicle) TEST_FAIL_MESSAGE(whose[k]);
    alone += strcmp(e->setting, "mass_change") == 0 || strcmp(e->setting, "yaw_inertia_change") == 0;
    whose[count] = e->setting, seen[count++] = p.vehicle;
  }
  TEST_ASSERT_EQUAL_INT(2, alone); /* effects without other parameters */
}

#if !defined(TSE_SMALL) /* no particle filter */
/* A learnt state must match the same vehicle with any other settings, in every number
 * format: one fingerprint for all builds. It is FNV-1a over the settings of vehicle.toml
 * in single precision. It changes if one of their defaults changes. */
static void test_fingerprint_of_the_vehicle_changes_with_the_vehicle_only(void)
{
  const tse_config base = defaults();
  const uint32_t before = prepared(base).vehicle;
  uint32_t hash = 2166136261u;
  EACH_SETTING(f)
  {
    if ((size_t)f->offset >= offsetof(tse_config, mass_sd)) continue;
    const float x = (float)of_setting(setting_field(&base, f));
    uint32_t bits;
    memcpy(&bits, &x, sizeof bits);
    for (int k = 0; k < 4; k++) hash = (hash ^ (bits >> 8 * k & 255u)) * 16777619u;
  }
  TEST_ASSERT_EQUAL_HEX32(hash, before);
  TEST_ASSERT_EQUAL_HEX32(0x6e6ba1d6u, before);
  EACH_SETTING(row)
  {
    tse_config other = other_config(), c = defaults();
    if (row->kind == 's') {
      put_setting(&c, row, setting_field(&other, row));
      const int same = prepared(c).vehicle == before;
      const int acts = kind_of_effect_setting(row->name) == 2 && !is_kinematics(row->name);
      const int vehicle = (size_t)row->offset < offsetof(tse_config, mass_sd) || acts;
      TEST_ASSERT_EQUAL_INT_MESSAGE(!vehicle, same, row->name);
    } else {
      put_field(
          &c, row, whole_field(&c, row) < row->hi ? whole_field(&c, row) + 1 : whole_field(&c, row) - 1);
      TEST_ASSERT_EQUAL_HEX32_MESSAGE(before, prepared(c).vehicle, row->name);
    }
  }
}
#endif

/* ------------------------------------------------------------------------------------ tse_stiffness_si */

static void test_stiffness_in_newtons_is_nominal_times_relative(void)
{
  const tse_config c = other_config();
  const double nominal[3] = { 110000, 70000, 85000 };
  tse_output y = blank_output();
  tse_setting mean[3], sd[3], spread[3];
  for (int i = 0; i < 3; i++) {
    y.stiffness[i] = real(0.5 + 0.25 * i), y.stiffness_sd[i] = real(0.125 + 0.0625 * i);
    y.stiffness_spread[i] = real(0.03125 * (i + 1));
  }
  tse_stiffness_si(&c, &y, mean, sd, spread);
  for (int i = 0; i < 3; i++) {
    expect_near(nominal[i] * (0.5 + 0.25 * i), of_setting(mean[i]), 0, "mean", i); /* exact in all formats */
    expect_near(nominal[i] * (0.125 + 0.0625 * i), of_setting(sd[i]), 0, "sd", i);
    expect_near(nominal[i] * 0.03125 * (i + 1), of_setting(spread[i]), 0, "spread", i);
  }
}

static void test_stiffness_in_newtons_skips_what_is_not_asked_for(void)
{
  const tse_config c = defaults();
  tse_output y = { 0 };
  tse_setting x[3] = { setting(-1), setting(-1), setting(-1) };
  y.stiffness_sd[1] = real(0.5);
  tse_stiffness_si(&c, &y, NULL, x, NULL);
  expect_near(6e4, of_setting(x[1]), 0, "sd", 1);
  tse_stiffness_si(&c, &y, NULL, NULL, NULL);
  x[0] = setting(-1);
  tse_stiffness_si(NULL, &y, x, x, x);
  tse_stiffness_si(&c, NULL, x, x, x);
  expect_near(-1, of_setting(x[0]), 0, "untouched", 0);
}

/* -------------------------------------------------------------------------------------- number formats */

#if defined(TSE_REAL_FIXED)
static void expect_not_fitting(const tse_config *c, const char *name)
{
  tse_params p, before;
  const char *wrong = "";
  memset(&p, 0x5a, sizeof p);
  before = p;
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_config_check(c, NULL)); /* inside its range */
  TEST_ASSERT_EQUAL_INT_MESSAGE(TSE_E_FORMAT, tse_prepare(c, &p, &wrong), name);
  TEST_ASSERT_EQUAL_STRING(name, wrong);
  TEST_ASSERT_EQUAL_MEMORY(&before, &p, sizeof p);
}

static void test_what_does_not_fit_is_refused_by_name(void)
{
#define TRY(name, value) \
  { \
    tse_config c; \
    tse_config_exact(&c); \
    c.name = setting(value); \
    expect_not_fitting(&c, #name); \
  }
  TRY(accel_x_sd, 0.001)
  TRY(noise_max, 300)
  TRY(steady_walk, 0.0001)
#undef TRY
}

/* A state with numbers at the limits of the range stays finite and recovers. */
static void test_a_state_at_the_end_of_the_range_goes_on_as_numbers(void)
{
  static tse_filter one;
  const tse_params p = prepared(defaults());
  tse_input u = blank_row();
  tse_output y;
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_reset(&p, &one, sizeof one));
  u.dt = real(0.01), u.wheel_speed_front = u.wheel_speed_rear = real(60);
  for (int i = 0; i < 50; i++) TEST_ASSERT_TRUE(tse_step(&p, &one, &u, &y) >= 0);
  one.k.ud.d[0] = one.k.ud.d[7] = FIXED_MOST;
  u.steer_angle = real(0.05);
  for (int i = 0; i < 500; i++) {
    TEST_ASSERT_TRUE(tse_step(&p, &one, &u, &y) >= 0);
    TEST_ASSERT_EQUAL_INT(TSE_OK, tse_filter_check(&p, &one, sizeof one));
  }
  TEST_ASSERT_TRUE(fabs(number(y.vel_x) - 60 * 0.33) < 1);
}
#endif
