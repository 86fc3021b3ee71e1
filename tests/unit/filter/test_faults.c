/* tests/unit/filter/test_faults.c <-> src/filter/faults.c: evidence that a channel is
 * frozen, and the time for which a channel at fault has agreed again. */
#include "filter/faults.h"
#include "filter_support.h"

/* The probability of a repeat is the largest of the three, and below 1. */
static void test_a_repeat_counts_by_the_largest_of_its_probabilities(void)
{
  static const struct {
    double repeats, again, least, was, probability; /* was [log2] */
  } cases[] = { { 0.3, 0.6, 0.1, 2, 0.6 }, { 0.6, 0.3, 0.1, 2, 0.6 }, { 0.3, 0.2, 0.9, 2, 0.9 },
    { 1, 1, 0.1, 2, 0.999 }, { 0.5, 0.5, 0.1, 999.9, 0 } };
  for (int n = 0; n < ROWS(cases); n++) {
    static tse_kalman k;
    memset(&k, 0, sizeof k);
    k.repeats[ACCEL_Y] = real(cases[n].repeats), k.repeats_again[ACCEL_Y] = real(cases[n].again);
    k.frozen[ACCEL_Y] = real(cases[n].was), k.reading[ACCEL_Y] = TSE_R(1);
    watch_repeats(&k, ACCEL_Y, TSE_R(1), TSE_R(4), real(cases[n].least), real(0.01));
    const double expected = cases[n].probability > 0 ? cases[n].was - log2(cases[n].probability)
                                                     : number(MAX_FROZEN);
    expect_near(expected, number(k.frozen[ACCEL_Y]), 1e-4 * fmax(1, 0.01 * expected), "evidence [log2]", n);
  }
}

/* A steering angle repeats while the slow innovation of the yaw rate is beyond 3 of its
 * usual sds. A gyro that is missing, frozen or at fault contradicts nothing. */
static void test_a_repeated_angle_is_evidence_where_the_yaw_rate_contradicts_it(void)
{
  enum { WORKS, MISSING, FROZEN, FAULTY };
  static const struct {
    double slow, usual, var; /* slow innovation [rad/s]; its variance, usual and predicted */
    int gyro, contradicts;
  } cases[] = { { 0.31, 1, 0.01, WORKS, 1 }, { 0.29, 1, 0.01, WORKS, 0 }, { -0.31, 1, 0.01, WORKS, 1 },
    { 0.31, 2, 0.01, WORKS, 0 }, { 0.43, 2, 0.01, WORKS, 1 }, { 0.31, 1, 0.01, MISSING, 0 },
    { 0.31, 1, 0.01, FROZEN, 0 }, { 0.31, 1, 0.01, FAULTY, 0 } };
  static const double dt[] = { 0.01, 0.05 };
  for (int n = 0; n < ROWS(cases); n++)
    for (int i = 0; i < ROWS(dt); i++) {
      static tse_kalman k;
      decoded z = { 0 };
      memset(&k, 0, sizeof k);
      k.slow[YAW_RATE] = real(cases[n].slow), k.usual[YAW_RATE] = real(cases[n].usual);
      k.slow_var[YAW_RATE] = real(cases[n].var);
      k.innovation_var[YAW_RATE] = cases[n].gyro == MISSING ? TSE_R(0) : TSE_R(1);
      if (cases[n].gyro == FROZEN) k.frozen[YAW_RATE] = TSE_R(500);
      if (cases[n].gyro == FAULTY) k.fault = fault_of(YAW_RATE);
      k.frozen[STEERING] = TSE_R(1), k.reading[STEERING] = real(0.03);
      z.has_steer = 1, z.steer = real(0.03), z.dt = real(dt[i]);
      TEST_ASSERT_EQUAL_INT(0, watch_steering(&k, &z));
      TEST_ASSERT_EQUAL_INT(1, z.has_steer);
      /* a driver moves the wheel within the row with the probability 1 - exp(-dt/0.095) */
      expect_near(1 + cases[n].contradicts * dt[i] / 0.095 / log(2), number(k.frozen[STEERING]), 1e-3,
          "evidence [log2]", n);
    }
}

/* It is said once that the angle is frozen, in the row that decides. From then on the
 * angle is missing, until it moves. */
static void test_a_frozen_angle_is_said_once_and_missing_until_it_moves(void)
{
  static tse_kalman k;
  const double limit = -log2(number(RATE_FAULT));
  int said = 0;
  memset(&k, 0, sizeof k);
  k.slow[YAW_RATE] = k.usual[YAW_RATE] = k.innovation_var[YAW_RATE] = TSE_R(1),
  k.slow_var[YAW_RATE] = real(0.01);
  k.reading[STEERING] = real(0.03);
  for (int n = 0; n < 400; n++) {
    const double before = number(k.frozen[STEERING]);
    decoded z = { 0 };
    z.has_steer = n % 10 != 9, z.steer = real(0.03), z.dt = real(0.01);
    const int has = z.has_steer, finds = watch_steering(&k, &z);
    const double after = number(k.frozen[STEERING]);
    said += finds;
    if (!has) expect_near(before, after, 0, "a missing angle is no evidence", n);
    TEST_ASSERT_EQUAL_INT(before <= limit && after > limit, finds);
    TEST_ASSERT_EQUAL_INT(has && after <= limit, z.has_steer);
  }
  TEST_ASSERT_EQUAL_INT(1, said);
  decoded z = { 0 };
  z.has_steer = 1, z.steer = real(0.031), z.dt = real(0.01);
  TEST_ASSERT_EQUAL_INT(0, watch_steering(&k, &z));
  TEST_ASSERT_EQUAL_INT(1, z.has_steer);
}

/* A channel agrees within 3 sd of its innovation, unless it is frozen. Only the channel
 * at fault counts its time. */
static void test_the_channel_at_fault_agrees_within_three_sd(void)
{
  static const struct {
    double e; /* of an sd of 2 */
    int fault, frozen;
    double agrees_for;
  } cases[] = { { 5.9, 1, 0, 1.02 }, { -5.9, 1, 0, 1.02 }, { 6.1, 1, 0, 0 }, { -6.1, 1, 0, 0 },
    { 0.1, 1, 1, 0 }, { 0.1, 0, 0, 1 }, { 6.1, 0, 0, 1 } };
  for (int n = 0; n < ROWS(cases); n++) {
    static tse_kalman k;
    static scalar m;
    memset(&k, 0, sizeof k);
    memset(&m, 0, sizeof m);
    for (int i = 0; i < STATES; i++) k.ud.d[i] = TSE_R(1);
    m.h[BY] = TSE_R(1), m.r = TSE_R(3), m.e = real(cases[n].e), m.dt = real(0.02);
    k.agrees_for = TSE_R(1);
    k.fault = cases[n].fault ? fault_of(ACCEL_Y) : fault_of(YAW_RATE);
    if (cases[n].frozen) k.frozen[ACCEL_Y] = TSE_R(500);
    watch_fault(&k, ACCEL_Y, &m);
    expect_near(cases[n].agrees_for, number(k.agrees_for), 1e-6, "agrees for [s]", n);
    expect_near(cases[n].e, number(k.innovation[ACCEL_Y]), 1e-6, "innovation", n);
    expect_near(4, number(k.innovation_var[ACCEL_Y]), 1e-4, "its variance", n);
  }
}

/* Neither a frozen sensor nor the one at fault is used. */
static void test_a_sensor_is_used_unless_it_is_frozen_or_at_fault(void)
{
  static tse_kalman k;
  const double limit = -log2(number(RATE_FAULT));
  memset(&k, 0, sizeof k);
  k.fault = fault_of(WHEEL_FRONT);
  k.frozen[YAW_RATE] = real(1.01 * limit), k.frozen[ACCEL_Y] = real(0.99 * limit);
  for (int a = 0; a < TSE_SENSORS; a++) {
    TEST_ASSERT_EQUAL_INT(a == YAW_RATE, is_frozen(&k, a));
    TEST_ASSERT_EQUAL_INT(a != YAW_RATE && a != WHEEL_FRONT, is_usable(&k, a));
  }
}
