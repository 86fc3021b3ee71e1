/* tests/unit/estimator/test_format.c <-> src/estimator/prepare.c: every form in every format; what fixed point cannot hold is refused. */
#include "unit_support.h"

static tse_filter_paper f;

static void test_every_form_works_in_every_format(void)
{
  static void (*const fill[])(tse_config *) = { tse_config_default, tse_config_robust, tse_config_paper };
  for (int i = 0; i < ROWS(fill); i++) {
    tse_config c;
    tse_params p;
    const char *wrong = "untouched";
    fill[i](&c);
    TEST_ASSERT_EQUAL_INT(TSE_OK, tse_config_check(&c, NULL));
    TEST_ASSERT_EQUAL_INT(TSE_OK, tse_prepare(&c, &p, &wrong));
    TEST_ASSERT_EQUAL_STRING("untouched", wrong);
    TEST_ASSERT_EQUAL_INT(TSE_OK, tse_reset(&p, &f.filter, sizeof f));
  }
}

static void test_a_wrong_setting_is_named_in_every_format(void)
{
  tse_config c = config_by(tse_config_default);
  tse_params p;
  const char *wrong = "";
  c.mass = 0;
  TEST_ASSERT_EQUAL_INT(TSE_E_CONFIG, tse_prepare(&c, &p, &wrong));
  TEST_ASSERT_EQUAL_STRING("mass", wrong);
}

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
#define TRY(name, value) { tse_config c; tse_config_default(&c); c.name = setting(value); expect_not_fitting(&c, #name); }
  TRY(accel_x_sd, 0.001)
  TRY(noise_max, 300)
  TRY(steady_walk, 0.0001)
#undef TRY
}

/* A state whose numbers stand at the end of the range goes on as numbers, and comes back. */
static void test_a_state_at_the_end_of_the_range_goes_on_as_numbers(void)
{
  static tse_filter one;
  tse_params p;
  tse_input u = blank_row();
  tse_output y;
  p = prepared(config_by(tse_config_default));
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
