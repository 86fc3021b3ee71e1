/* tests/unit/estimator/test_settings.c <-> src/estimator/settings.c */
#include "model/state.h"
#include "unit_support.h"
#include "tables/config.h"
#include "tables/config_rows.h"

#include <float.h>
#include <stddef.h>

static tse_config defaults(void) { return config_by(tse_config_exact); }

static void expect_config_refused(const tse_config *c, const char *name)
{
  tse_params p, before;
  const char *wrong = NULL, *again = NULL;
  memset(&p, 0xa5, sizeof p);
  memcpy(&before, &p, sizeof p);
  TEST_ASSERT_EQUAL_INT_MESSAGE(TSE_E_CONFIG, tse_config_check(c, &wrong), name);
  TEST_ASSERT_EQUAL_STRING(name, wrong);
  TEST_ASSERT_EQUAL_INT_MESSAGE(TSE_E_CONFIG, tse_prepare(c, &p, &again), name);
  TEST_ASSERT_EQUAL_STRING(name, again);
  TEST_ASSERT_EQUAL_MEMORY_MESSAGE(&before, &p, sizeof p, name);
  TEST_ASSERT_EQUAL_INT(TSE_E_CONFIG, tse_config_check(c, NULL));
  TEST_ASSERT_EQUAL_INT(TSE_E_CONFIG, tse_prepare(c, &p, NULL));
  TEST_ASSERT_EQUAL_MEMORY_MESSAGE(&before, &p, sizeof p, name);
}

static void expect_config_accepted(const tse_config *c, const char *name)
{
  static const char untouched[] = "untouched";
  const char *wrong = untouched;
  TEST_ASSERT_EQUAL_INT_MESSAGE(TSE_OK, tse_config_check(c, &wrong), name);
  TEST_ASSERT_EQUAL_PTR(untouched, wrong);
}

static void test_defaults_are_those_of_the_table_and_pass_the_check(void)
{
  tse_config c;
  memset(&c, 0xff, sizeof c);
  tse_config_default(&c);
  expect_config_accepted(&c, "defaults");
  EACH_SETTING(row)
  {
    if (row->kind == 's') TEST_ASSERT_TRUE_MESSAGE(!(setting_field(&c, row) != setting(row->def)), row->name);
    else TEST_ASSERT_EQUAL_INT32_MESSAGE((int32_t)row->def, whole_field(&c, row), row->name);
  }
  tse_config_default(NULL);
}

/* Compare field by field: compilers may leave any bytes in the padding. */
static void expect_same_settings(const tse_config *expected, const tse_config *actual)
{
  expect_config_accepted(actual, "other defaults");
  EACH_SETTING(row)
  {
    if (row->kind == 's')
      TEST_ASSERT_TRUE_MESSAGE(!(setting_field(actual, row) != setting_field(expected, row)), row->name);
    else TEST_ASSERT_EQUAL_INT32_MESSAGE(whole_field(expected, row), whole_field(actual, row), row->name);
  }
}

#if !defined(TSE_SMALL)
/* The paper's filter, as printed and robust, differs from the defaults in exactly these
 * settings. */
static void test_other_forms_are_the_defaults_but_for_a_few_settings(void)
{
  tse_config c, expected = defaults();
  TEST_ASSERT_EQUAL_INT32(0, expected.form);
  memset(&c, 0xff, sizeof c);
  tse_config_paper(&c);
  expected.form = 1, expected.exact_kinematics_share = setting(0), expected.initial_spread = setting(0.3);
  expected.stiffness_max = setting(20);
  expected.initial_vel_x_sd = expected.initial_vel_y_sd = setting(1);
  expected.initial_yaw_rate_sd = setting(0.017453292519943295);
  expect_same_settings(&expected, &c);
  expected = defaults();
  memset(&c, 0xff, sizeof c);
  tse_config_robust(&c);
  expected.form = expected.integration = expected.reflect_draws = 1;
  expected.exact_kinematics_share = setting(0), expected.initial_vel_y_sd = setting(1);
  expected.initial_yaw_rate_sd = setting(0.017453292519943295), expected.forgetting = setting(0.998);
  expected.forgetting_mean = setting(0.98), expected.forgetting_change = setting(0.9);
  expected.initial_spread = setting(0.15), expected.spread_max = setting(0.7);
  expected.spread_kernel = setting(0.03);
  expect_same_settings(&expected, &c);
  tse_config_robust(NULL);
  tse_config_paper(NULL);
}
#endif

static void test_each_setting_is_accepted_at_its_limits_and_refused_by_name_beyond(void)
{
  const double none[3] = { (double)NAN, (double)INFINITY, (double)-INFINITY };
  EACH_SETTING(row)
  {
    tse_config c = defaults();
    put_field(&c, row, row->lo);
    expect_config_accepted(&c, row->name);
    put_field(&c, row, row->hi);
    expect_config_accepted(&c, row->name);
    if (row->kind == 's') {
      put_setting(&c, row, towards(setting(row->lo), -INFINITY));
      expect_config_refused(&c, row->name);
      put_setting(&c, row, towards(setting(row->hi), INFINITY));
      expect_config_refused(&c, row->name);
      for (int k = 0; k < 3; k++) {
        put_field(&c, row, none[k]);
        expect_config_refused(&c, row->name);
      }
      continue;
    }
    put_field(&c, row, row->lo - 1);
    expect_config_refused(&c, row->name);
    put_field(&c, row, INT32_MIN);
    expect_config_refused(&c, row->name);
    put_field(&c, row, row->hi < INT32_MAX ? row->hi + 1 : INT32_MIN);
    expect_config_refused(&c, row->name);
  }
}

static void test_of_two_wrong_settings_the_first_is_named(void)
{
  tse_config c = defaults();
  c.particles = 0, c.lf = setting(-1), c.lr = setting(-1);
  expect_config_refused(&c, "lf");
  c = defaults();
  c.formula_code_1 = -1; /* integers stand between the real settings */
  c.sample_time = setting(-1);
  expect_config_refused(&c, "formula_code_1");
  EACH_SETTING(row)
  {
    if (row->kind == 's') continue;
    c = defaults();
    c.lf = setting(-1);
    put_field(&c, row, row->lo - 1);
    expect_config_refused(&c, "lf"); /* the third of the real settings */
  }
}

static void test_a_car_known_exactly_differs_from_an_ordinary_one_as_the_table_says_and_no_further(void)
{
  tse_config c = config_by(tse_config_default);
  for (size_t k = 0; k < sizeof exact / sizeof exact[0]; k++) {
    tse_setting x;
    memcpy(&x, (uint8_t *)&c + exact[k].at, sizeof x);
    TEST_ASSERT_TRUE_MESSAGE(x != exact[k].value, "a row that changes nothing");
    memcpy((uint8_t *)&c + exact[k].at, &exact[k].value, sizeof x);
  }
  const tse_config known = defaults();
  expect_same_settings(&known, &c);
  TEST_ASSERT_TRUE(
      known.mass == setting(1900) && known.cornering_stiffness_front == setting(120000) && known.form == 0);
  EACH_SETTING(row)
  if (strlen(row->name) > 3 && strcmp(row->name + strlen(row->name) - 3, "_sd") == 0
      && row->offset <= (int32_t)offsetof(tse_config, grade_sd))
    TEST_ASSERT_TRUE_MESSAGE(setting_field(&known, row) == 0, row->name);
  tse_config_exact(NULL);
}

/* Stiffness and yaw inertia follow from mass and axles, in any order of setting. */
static void test_what_is_not_set_is_of_the_class_under_the_mass_and_axles_that_are_set(void)
{
  const double g = 9.81, one = BY_FORMAT(1e-12, 1e-6);
  const double front = g * 1234 * 1.375 / 2.5, rear = g * 1234 * 1.125 / 2.5; /* axle loads */
  const double of_class[5] = { 1234 * 1.125 * 1.375, CLASS_CORNERING_FRONT * front,
    CLASS_CORNERING_REAR * rear, CLASS_LONGITUDINAL * front, CLASS_LONGITUDINAL * rear };
  tse_config c = config_by(tse_config_default);
  c.mass = setting(1234), c.lf = setting(1.125), c.lr = setting(1.375);
  tse_config whole = c;
  tse_config_complete(&whole);
  const tse_setting actual[5] = { whole.yaw_inertia, whole.cornering_stiffness_front,
    whole.cornering_stiffness_rear, whole.longitudinal_stiffness_front, whole.longitudinal_stiffness_rear };
  for (int i = 0; i < 5; i++)
    expect_near(of_class[i], of_setting(actual[i]), one * of_class[i], "of the class", i);
  TEST_ASSERT_TRUE(whole.mass_sd == c.mass_sd && c.mass_sd == setting(0.05)); /* a known mass */
  tse_params as_set = prepared(c);
  const tse_params written_down = prepared(whole);
  TEST_ASSERT_EQUAL_MEMORY(&written_down, &as_set, sizeof as_set); /* with the fingerprint */

  /* prepared before: another car; settings that are set are unchanged */
  c.mass = setting(2468), c.cornering_stiffness_rear = setting(150000);
  as_set = prepared(c);
  expect_near(of_class[1] / 1234, number(as_set.car.ky_front), BY_FORMAT(1e-9, 1e-4), "over the mass", 0);
  expect_near(150000.0 / 2468, number(as_set.car.ky_rear), BY_FORMAT(1e-9, 1e-4), "as set", 0);
  tse_config_complete(&c);
  expect_near(150000, of_setting(c.cornering_stiffness_rear), 0, "as set", 1);
  expect_near(
      2 * of_class[1], of_setting(c.cornering_stiffness_front), 2 * one * of_class[1], "twice the load", 0);
  tse_config_complete(NULL);
}

static void test_a_mass_that_is_not_known_is_the_class_s_and_as_uncertain(void)
{
  tse_config c = config_by(tse_config_default);
  expect_config_accepted(&c, "no mass");
  const tse_params p = prepared(c);
  expect_near(
      CLASS_MASS_SD * CLASS_MASS_SD, number(p.mass_var), BY_FORMAT(1e-12, 1e-6), "sd of the class", 0);
  TEST_ASSERT_TRUE(CLASS_MASS_SD > 2 * of_setting(c.valid_sd));
  tse_config same = c;
  same.mass = setting(CLASS_MASS);
  TEST_ASSERT_TRUE(prepared(same).mass_var < p.mass_var && prepared(same).car.ky_front == p.car.ky_front);
  c.mass_sd = setting(0.4); /* never below the setting */
  expect_near(0.16, number(prepared(c).mass_var), BY_FORMAT(1e-12, 1e-6), "as told", 0);
  c.mass = setting(49);
  expect_config_refused(&c, "mass"); /* 0 means not set; values near 0 are refused */
}

static void test_a_stiffness_of_the_class_outside_its_range_is_refused(void)
{
  tse_config c = config_by(tse_config_default);
  c.mass = setting(50), c.lf = setting(0.1), c.lr = setting(10);
  expect_config_refused(&c, "longitudinal_stiffness_rear");
  c.longitudinal_stiffness_rear = setting(2000);
  expect_config_refused(&c, "cornering_stiffness_rear");
}


static void test_null_arguments_are_refused_and_change_nothing(void)
{
  tse_config c = defaults();
  tse_params p, before;
  memset(&p, 0x5a, sizeof p);
  memcpy(&before, &p, sizeof p);
  TEST_ASSERT_EQUAL_INT(TSE_E_NULL, tse_config_check(NULL, NULL));
  TEST_ASSERT_EQUAL_INT(TSE_E_NULL, tse_prepare(NULL, &p, NULL));
  TEST_ASSERT_EQUAL_INT(TSE_E_NULL, tse_prepare(&c, NULL, NULL));
  TEST_ASSERT_EQUAL_MEMORY(&before, &p, sizeof p);
}
