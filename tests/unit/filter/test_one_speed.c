/* tests/unit/filter/test_one_speed.c <-> src/filter/row.c, step.c, predict.c, update.c,
 * output.c: both wheel speeds are one signal. */
#include "filter/row.h"
#include "filter_support.h"

static tse_filter f;
static truth w;

/* Ways to make two columns of one signal: equal, with another radius, rounded, one held
 * for ten rows, both held, one missing. */
enum { EQUAL, RADIUS, ROUNDED, REAR_HELD, FRONT_HELD, BOTH_HELD, REAR_MISSING, FRONT_MISSING, WAYS };

static tse_input one_row(int way, int n, double dt)
{
  static tse_real held;
  tse_input u = truth_row(&w, dt);
  tse_real speed = u.wheel_speed_rear;
  if (way == ROUNDED) speed = real(0.5 * floor(number(speed) / 0.5 + 0.5));
  if (n % 10 == 0) held = speed;
  u.wheel_speed_front = way == FRONT_HELD || way == BOTH_HELD ? held : speed;
  u.wheel_speed_rear = way == REAR_HELD || way == BOTH_HELD ? held : speed;
  if (way == RADIUS) u.wheel_speed_front = real(1.0013 * number(speed));
  if (way == REAR_MISSING) u.missing |= TSE_MISSING_wheel_speed_rear;
  if (way == FRONT_MISSING) u.missing |= TSE_MISSING_wheel_speed_front;
  return u;
}

/* Without observed slip nothing slides. Slip and slip stiffness are unchanged, the
 * longitudinal stiffness is not excited, and cornering is estimated. */
static void test_one_speed_shows_no_slip_and_finds_cornering(void)
{
  for (int way = 0; way < WAYS; way++) {
    tse_output y;
    double squares = 0;
    int valid = 0;
    memset(&y, 0, sizeof y);
    truth_start(&w, config_by(tse_config_exact), 20, 0.5, 3 + (uint32_t)way);
    w.throttle = 0.02;
    TEST_ASSERT_EQUAL_INT(TSE_OK, tse_reset(&w.p, &f, sizeof f));
    for (int n = 0; n < 4000; n++) {
      const tse_input u = one_row(way, n, n % 10 == 9 ? 0.12 : 0.01);
      TEST_ASSERT_GREATER_OR_EQUAL_INT(0, tse_step(&w.p, &f, &u, &y));
      TEST_ASSERT_TRUE_MESSAGE(number(y.regime[TSE_REGIME_SLIDING]) < 0.05, "sliding");
      expect_near(0, number(f.k.x[LCX]), 1e-6, "logarithm of the longitudinal", way);
      /* reported as a mixture with another road, which turning may show */
      expect_near(1, number(y.stiffness[TSE_CX_FRONT]), 0.02, "longitudinal", way);
      TEST_ASSERT_TRUE(number(r_abs(f.k.x[SF])) <= number(w.p.max_slip)
          && number(r_abs(f.k.x[SR])) <= number(w.p.max_slip));
      if (n < 2000) continue;
      TEST_ASSERT_EQUAL_INT(TSE_NOT_EXCITED, y.reason[TSE_CX_FRONT]);
      for (int a = TSE_CY_FRONT; a <= TSE_CY_REAR; a++) {
        if (y.reason[a] != TSE_VALID) continue;
        squares += pow(number(y.stiffness[a]) / truth_stiffness(&w, a) - 1, 2);
        valid++;
      }
    }
    TEST_ASSERT_GREATER_THAN_INT(3500, valid);
    TEST_ASSERT_TRUE_MESSAGE(sqrt(squares / valid) < 0.05, "cornering stiffness");
  }
}

/* Two signals: both change to values of their own. If only one does so, they count as two
 * signals for 20 s. */
static void test_two_signals_that_differ_once_are_two_for_20_s(void)
{
  truth_start(&w, config_by(tse_config_exact), 20, 0, 5);
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_reset(&w.p, &f, sizeof f));
  for (int n = 0; n < 3000; n++) {
    tse_input u = one_row(EQUAL, n, 0.01);
    decoded z;
    if (n == 500) u.wheel_speed_front += real(0.3);
    TEST_ASSERT_EQUAL_INT(TSE_OK, decode_row(&w.p, &f, &u, &z));
    if (n < 2495 || n > 2505) TEST_ASSERT_EQUAL_INT(n < 500 || n > 2500, z.one_speed);
    TEST_ASSERT_GREATER_OR_EQUAL_INT(0, tse_step(&w.p, &f, &u, NULL));
  }
}

/* Motion that restarts more than three times a second is determined by the restarts:
 * nothing is valid. */
static void test_nothing_is_valid_among_gaps(void)
{
  for (int every = 10; every <= 100; every += 90) {
    int valid = 0;
    truth_start(&w, config_by(tse_config_exact), 20, 0.5, 7);
    TEST_ASSERT_EQUAL_INT(TSE_OK, tse_reset(&w.p, &f, sizeof f));
    for (int n = 0; n < 3000; n++) {
      tse_output y;
      const tse_input u = truth_row(&w, n % every == every - 1 ? 0.4 : 0.01);
      TEST_ASSERT_GREATER_OR_EQUAL_INT(0, tse_step(&w.p, &f, &u, &y));
      valid += y.reason[TSE_CY_FRONT] == TSE_VALID;
    }
    TEST_ASSERT_TRUE(every == 10 ? valid == 0 : valid > 2000);
  }
}
