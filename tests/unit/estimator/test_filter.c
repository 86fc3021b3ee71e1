/* tests/unit/estimator/test_filter.c <-> src/estimator/filter.c: properties of
 * tse_reset() and tse_step() that hold for all filters. Further ones of the particle
 * filter: paper/test_row.c. */
#include "driven.h"
#include "tse/describe.h"

static tse_filter_paper f, other, before;

/* Settings with which every test runs: again(). */
static const struct {
  const char *name;
  void (*settings)(tse_config *c);
} forms[] = {
  { "default", tse_config_exact },
  { "robust", tse_config_robust },
  { "paper", tse_config_paper },
};
static int form;

static int again(void) { return ++form < ROWS(forms) && printf("%s:\n", forms[form].name); }

/* The shortest sample time of the format: learning per second overflows, and is not
 * kept. */
static void test_rows_of_almost_no_time_leave_a_sound_filter(void)
{
  tse_config c = config_by(tse_config_exact);
  tse_input u = blank_row();
  const tse_params p = prepared(c);
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_reset(&p, &f.filter, sizeof f.filter));
  u.wheel_speed_front = u.wheel_speed_rear = real(60);
  for (int k = 0; k < 300; k++) {
    u.dt = real(k % 3 ? 0.01 : BY_FORMAT(5e-324, 2e-45));
#if defined(TSE_REAL_FIXED)
    if (k % 3 == 0) u.dt = (tse_real)1;
#endif
    u.steer_angle = real(0.02 * sin(0.13 * k)), u.accel_y = real(1.9 * sin(0.13 * k));
    u.yaw_rate = real(0.1 * sin(0.13 * k));
    TEST_ASSERT_TRUE(tse_step(&p, &f.filter, &u, NULL) >= 0);
    TEST_ASSERT_EQUAL_INT(TSE_OK, tse_filter_check(&p, &f.filter, sizeof f.filter));
  }
}

static void test_of_two_warnings_the_worse_is_told(void)
{
  TEST_ASSERT_EQUAL_INT(TSE_W_RECOVERED, worse(TSE_W_RECOVERED, TSE_W_NOT_VALID));
  TEST_ASSERT_EQUAL_INT(TSE_W_RECOVERED, worse(TSE_W_NOT_VALID, TSE_W_RECOVERED));
  TEST_ASSERT_EQUAL_INT(TSE_OK, worse(TSE_OK, TSE_OK));
}

static tse_config some_settings(int32_t particles)
{
  tse_config c;
  forms[form].settings(&c);
  c.particles = particles;
  return c;
}

/* ------------------------------------------------------------------------------------------ refusals */

static void expect_refused(tse_status why, const tse_params *p, const tse_input *u)
{
  tse_output y, y_before;
  memset(&y, 0x55, sizeof y);
  memcpy(&y_before, &y, sizeof y);
  memcpy(&before, &f, sizeof f);
  TEST_ASSERT_EQUAL_INT(why, tse_step(p, &f.filter, u, &y));
  TEST_ASSERT_EQUAL_MEMORY(&before, &f, sizeof f);
  TEST_ASSERT_EQUAL_MEMORY(&y_before, &y, sizeof y);
}

/* Refused rows: test_input.c. */
static void test_refused_input_leaves_the_filter_bit_for_bit_unchanged(void)
{
  tse_config c = some_settings(40);
  const tse_params p = prepared(c);
  drive d;
  set_off(&d, &c, 20.0);
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_reset(&p, &f.filter, sizeof f));
  (void)run(&p, &f, &d, 60);
  const tse_input good = next_row(&d);
  tse_input u;
  for (int k = 0; k < 4; k++) {
    u = good;
    if (k == 0) u.dt = real(0);
    if (k == 1) u.steer_angle = real(1.2001);
    if (k == 2) u.wheel_speed_front = real(-400.1);
    if (k == 3) u.wheel_speed_rear = real((double)INFINITY);
    expect_refused(k ? TSE_E_INPUT : TSE_E_TIME, &p, &u);
  }
  expect_refused(TSE_E_NULL, NULL, &good);
  expect_refused(TSE_E_NULL, &p, NULL);
  TEST_ASSERT_EQUAL_INT(TSE_E_NULL, tse_step(&p, NULL, &good, NULL));

  tse_params wrong = p; /* parameters that were never prepared */
  wrong.magic ^= 1u;
  expect_refused(TSE_E_STATE, &wrong, &good);
  c.mass = setting(1901); /* parameters of another car */
  wrong = prepared(c);
  expect_refused(TSE_E_STATE, &wrong, &good);
  f.filter.magic ^= 1u; /* not a filter */
  expect_refused(TSE_E_STATE, &p, &good);
  memset(&f, 0, sizeof f); /* not reset */
  expect_refused(TSE_E_STATE, &p, &good);
}

static void test_reset_refuses_what_does_not_fit_and_changes_nothing_then(void)
{
  tse_params p = prepared(some_settings(40));
  memset(&f, 0x33, sizeof f);
  memcpy(&before, &f, sizeof f);
  TEST_ASSERT_EQUAL_INT(TSE_E_NULL, tse_reset(NULL, &f.filter, sizeof f));
  TEST_ASSERT_EQUAL_INT(TSE_E_NULL, tse_reset(&p, NULL, sizeof f));
  TEST_ASSERT_EQUAL_INT(TSE_E_SIZE, tse_reset(&p, &f.filter, sizeof f - 1));
  TEST_ASSERT_EQUAL_INT(TSE_E_SIZE, tse_reset(&p, &f.filter, 0));
  p.magic = 0;
  TEST_ASSERT_EQUAL_INT(TSE_E_STATE, tse_reset(&p, &f.filter, sizeof f));
  TEST_ASSERT_EQUAL_MEMORY(&before, &f, sizeof f);
}

/* ----------------------------------------------------------------------------------- reproducibility */

static void test_two_filters_in_turn_do_not_influence_each_other(void)
{
  static tse_filter_paper alone[2], together[2];
  tse_config c[2] = { some_settings(50), some_settings(64) };
  tse_params p[2];
  drive d[2];
  c[1].mass = setting(1400);
  c[1].seed = 9;
  c[1].resampling = 3;
  for (int k = 0; k < 2; k++) {
    p[k] = prepared(c[k]);
    TEST_ASSERT_EQUAL_INT(TSE_OK, tse_reset(&p[k], &alone[k].filter, sizeof alone[k]));
    TEST_ASSERT_EQUAL_INT(TSE_OK, tse_reset(&p[k], &together[k].filter, sizeof together[k]));
    set_off(&d[k], &c[k], 15.0 + 5.0 * k);
    (void)run(&p[k], &alone[k], &d[k], 400);
    set_off(&d[k], &c[k], 15.0 + 5.0 * k);
  }
  for (int i = 0; i < 400; i++)
    for (int k = 0; k < 2; k++) (void)run(&p[k], &together[k], &d[k], 1);
  for (int k = 0; k < 2; k++) TEST_ASSERT_EQUAL_MEMORY(&alone[k], &together[k], sizeof alone[k]);
}

static void test_the_same_seed_gives_the_same_bits_and_another_seed_does_not(void)
{
  tse_config c = some_settings(50);
  tse_output y[3];
  for (int k = 0; k < 3; k++) {
    drive d;
    c.seed = k < 2 ? 11 : 12;
    const tse_params p = prepared(c);
    set_off(&d, &c, 20.0);
    memset(&f, 0x77 * k, sizeof f); /* reset must clear all bytes */
    TEST_ASSERT_EQUAL_INT(TSE_OK, tse_reset(&p, &f.filter, sizeof f));
    y[k] = run(&p, &f, &d, 250);
    if (k == 0) memcpy(&other, &f, sizeof f);
    if (k == 1) TEST_ASSERT_EQUAL_MEMORY(&other, &f, sizeof f);
  }
  TEST_ASSERT_EQUAL_MEMORY(&y[0], &y[1], sizeof y[0]);
  TEST_ASSERT_EQUAL_INT(c.form != 0,
      y[2].stiffness[1] < y[0].stiffness[1] || y[2].stiffness[1] > y[0].stiffness[1]); /* never drawn */
}

static void test_the_time_step_of_the_first_row_does_not_count(void)
{
  static const double dt[] = { 0.0, -1.0, NAN, INFINITY, 1e9, 0.01 };
  const tse_config c = some_settings(20);
  const tse_params p = prepared(c);
  drive d;
  set_off(&d, &c, 20.0);
  tse_input u = next_row(&d);
  for (int k = 0; k < ROWS(dt); k++) {
    TEST_ASSERT_EQUAL_INT(TSE_OK, tse_reset(&p, &f.filter, sizeof f));
    u.dt = real(dt[k]);
    TEST_ASSERT_TRUE(tse_step(&p, &f.filter, &u, NULL) >= 0);
    if (k == 0) memcpy(&other, &f, sizeof f);
    TEST_ASSERT_EQUAL_MEMORY(&other, &f, sizeof f);
  }
}

/* A filter without particles needs no memory for them. A filter with particles requires
 * it. */
static void test_particles_are_memory_only_for_who_asks_for_them(void)
{
  static struct {
    tse_filter filter;
    unsigned char beyond[64];
  } small;
  const tse_config c = some_settings(40);
  const tse_params p = prepared(c);
  TEST_ASSERT_TRUE(sizeof(tse_filter) < sizeof(tse_filter_paper) - sizeof(tse_particles));
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_reset(&p, &f.filter, sizeof f));
  memset(&small, 0x5a, sizeof small);
  const tse_status status = tse_reset(&p, &small.filter, sizeof small.filter);
  TEST_ASSERT_EQUAL_INT(c.form == 0 ? TSE_OK : TSE_E_SIZE, status);
  if (status == TSE_OK) {
    drive d, again;
    set_off(&d, &c, 20.0);
    again = d;
    tse_output y, z;
    memset(&y, 0, sizeof y);
    memset(&z, 0, sizeof z);
    for (int i = 0; i < 200; i++) {
      const tse_input u = next_row(&d), v = next_row(&again);
      TEST_ASSERT_TRUE(tse_step(&p, &small.filter, &u, &y) >= 0);
      TEST_ASSERT_TRUE(tse_step(&p, &f.filter, &v, &z) >= 0);
    }
    TEST_ASSERT_EQUAL_MEMORY(&z, &y, sizeof y);
    TEST_ASSERT_EQUAL_MEMORY(&f.filter, &small.filter, sizeof small.filter);
  }
  for (size_t i = 0; i < sizeof small.beyond; i++) TEST_ASSERT_EQUAL_INT(0x5a, small.beyond[i]);
}
