/* tests/unit/estimator/test_format.c <-> src/estimator/prepare.c: a format whose filter is not finished has none. */
#include "unit_support.h"

#if defined(TSE_REAL_Q20)
#define EXPECTED TSE_E_FORMAT
#else
#define EXPECTED TSE_OK
#endif

static tse_filter_paper f;

static void test_every_form_works_or_is_refused(void)
{
  static void (*const fill[])(tse_config *) = { tse_config_default, tse_config_sampled, tse_config_paper };
  for (int i = 0; i < ROWS(fill); i++) {
    tse_config c;
    tse_params p, before;
    const char *wrong = "untouched";
    fill[i](&c);
    memset(&p, 0x5a, sizeof p);
    before = p;
    TEST_ASSERT_EQUAL_INT(TSE_OK, tse_config_check(&c, NULL));
    TEST_ASSERT_EQUAL_INT(EXPECTED, tse_prepare(&c, &p, &wrong));
    TEST_ASSERT_EQUAL_STRING("untouched", wrong);
    if (EXPECTED == TSE_OK) continue;
    TEST_ASSERT_EQUAL_MEMORY(&before, &p, sizeof p);
    TEST_ASSERT_EQUAL_INT(TSE_E_STATE, tse_reset(&p, &f.filter, sizeof f)); /* so that nothing goes on from there */
  }
}

static void test_a_wrong_setting_is_named_in_every_format(void)
{
  tse_config c;
  tse_params p;
  const char *wrong = "";
  tse_config_default(&c);
  c.mass = 0;
  TEST_ASSERT_EQUAL_INT(TSE_E_CONFIG, tse_prepare(&c, &p, &wrong));
  TEST_ASSERT_EQUAL_STRING("mass", wrong);
}

int main(void)
{
  UNITY_BEGIN();
  RUN_TEST(test_every_form_works_or_is_refused);
  RUN_TEST(test_a_wrong_setting_is_named_in_every_format);
  return UNITY_END();
}
