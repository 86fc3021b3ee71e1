/* tests/unit/host/test_self_test.c <-> src/host/self_test.c. Builds that fail it: tests/test_build.py. */
#include "unit_support.h"

static void test_this_build_computes_as_it_is_tested(void)
{
  const char *wrong = "nothing";
  TEST_ASSERT_EQUAL_INT_MESSAGE(TSE_OK, tse_self_test(&wrong), wrong);
  TEST_ASSERT_EQUAL_STRING("nothing", wrong);
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_self_test(NULL));
}
