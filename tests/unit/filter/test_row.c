/* tests/unit/filter/test_row.c <-> src/filter/row.c: what is read of a row, and whether
 * both wheel speeds are one signal. Wheel torques and brake: test_pedals.c. */
#include "filter/row.h"
#include "filter_support.h"

static tse_filter f;

static tse_params a_car(int signals)
{
  tse_params p = prepared(config_by(tse_config_exact));
  p.radius_front = real(0.25), p.radius_rear = real(0.5), p.wheel_signals = signals;
  return p;
}

/* A row at these wheel speeds [m/s]. */
static tse_input a_row(double front, double rear)
{
  tse_input u = blank_row();
  u.dt = real(0.01), u.wheel_speed_front = real(front / 0.25), u.wheel_speed_rear = real(rear / 0.5);
  return u;
}

typedef struct speeds {
  double front, rear, was_front, was_rear, ratio; /* [m/s] of this row and the previous one; [1] */
  double off_for[2];                              /* [s] */
  int signals, started, lacks;                    /* wheel_signals; lacks: 1 front, 2 rear */
  int same, off[2], one_speed, no_second;
  double used; /* [m/s] rear wheel speed that is used */
} speeds;

/* Each new value of a copy is a value of the other axle, of this row or the previous one.
 * Two signals both have new values of their own, now or less than USUAL_TIME ago. */
static void test_two_wheel_speeds_are_one_signal_while_one_copies_the_other(void)
{
  static const speeds cases[] = {
    { 10.1, 10.1, 10, 10, 1, { 0, 0 }, 2, 1, 0, 1, { 0, 0 }, 1, 1, 10.1 },
    { 10.2, 10.1, 10, 10, 1, { 0, 0 }, 2, 1, 0, 0, { 1, 1 }, 0, 0, 10.1 },
    { -10, -10, -9, -9, 1, { 0, 0 }, 2, 1, 0, 1, { 0, 0 }, 1, 1, -10 },
    /* the front axle lags by a row; the rear axle does */
    { 10, 10.1, 9.9, 10, 1, { 0, 0 }, 2, 1, 0, 0, { 0, 1 }, 1, 1, 10.1 },
    { 10.1, 10, 10, 9.9, 1, { 0, 0 }, 2, 1, 0, 0, { 1, 0 }, 1, 1, 10.1 },
    { 10.605, 10, 10.5, 9.9, 1.05, { 0, 0 }, 2, 1, 0, 0, { 1, 0 }, 1, 1, 10.1 },
    { 10.5, 10.1, 10.395, 10, 1.05, { 0, 0 }, 2, 1, 0, 0, { 0, 1 }, 1, 1, 10.1 },
    /* one repeats its value */
    { 10.1, 10, 10, 10, 1, { 0, 0 }, 2, 1, 0, 0, { 1, 0 }, 1, 1, 10.1 },
    { 9.9, 10, 10, 10, 1, { 0, 0 }, 2, 1, 0, 0, { 1, 0 }, 1, 1, 9.9 },
    { 10, 10.1, 10, 10, 1, { 0, 0 }, 2, 1, 0, 0, { 0, 1 }, 1, 1, 10.1 },
    { 10, 9.9, 10, 10, 1, { 0, 0 }, 2, 1, 0, 0, { 0, 1 }, 1, 1, 9.9 },
    { 10.2, 10, 10.1, 10, 1, { 0, 0 }, 2, 1, 0, 0, { 1, 0 }, 1, 1, 10.2 },
    { 10, 10.2, 10, 10.1, 1, { 0, 0 }, 2, 1, 0, 0, { 0, 1 }, 1, 1, 10.2 },
    /* a constant ratio, rounded */
    { 10.014, 10, 9, 9, 1.0013, { 0, 0 }, 2, 1, 0, 1, { 0, 0 }, 1, 1, 10 },
    { 10.017, 10, 9, 9, 1.0013, { 0, 0 }, 2, 1, 0, 0, { 1, 1 }, 0, 0, 10 },
    { 10.1, 10.1, 10, 10, 1.0013, { 0, 0 }, 2, 1, 0, 1, { 0, 0 }, 1, 1, 10.1 },
    /* no ratio yet, or not started: nothing to compare */
    { -10, -10, -9, -9, 0, { 0, 0 }, 2, 1, 0, 1, { 0, 0 }, 1, 1, -10 },
    { 10.2, 10.1, 10, 10, 0, { 0, 0 }, 2, 1, 0, 0, { 0, 0 }, 0, 0, 10.1 },
    { 10.1, 10.1, 10, 10, 0, { 0, 0 }, 2, 0, 0, 1, { 0, 0 }, 1, 1, 10.1 },
    { 10.2, 10.1, 10, 10, 1, { 0, 0 }, 2, 0, 0, 0, { 0, 0 }, 1, 1, 10.1 },
    { 10.2, 10.2, 10, 10, 0, { 9, 0 }, 2, 1, 0, 1, { 0, 0 }, 1, 1, 10.2 },
    /* slow */
    { 0.2, 0.1, 0.1, 0.2, 1, { 0, 0 }, 2, 1, 0, 0, { 0, 0 }, 0, 0, 0.1 },
    { 0.2, 10, 0.1, 9, 1, { 0, 0 }, 2, 1, 0, 0, { 0, 0 }, 0, 0, 10 },
    /* two signals less than USUAL_TIME ago */
    { 10.1, 10.1, 10, 10, 1, { 9, 9 }, 2, 1, 0, 1, { 0, 0 }, 0, 0, 10.1 },
    { 10.1, 10, 10, 10, 1, { 0, 9 }, 2, 1, 0, 0, { 1, 0 }, 0, 0, 10 },
    { 10, 10.1, 10, 10, 1, { 9, 0 }, 2, 1, 0, 0, { 0, 1 }, 0, 0, 10.1 },
    { 10.1, 10.1, 10, 10, 1.01, { 9, 0 }, 2, 1, 0, 1, { 0, 0 }, 1, 1, 10 },
    /* according to the settings there is one */
    { 12, 10, 11, 9, 1, { 9, 9 }, 1, 1, 0, 0, { 1, 1 }, 1, 1, 10 },
    { 12, 10, 11, 9, 0, { 0, 0 }, 1, 1, 0, 0, { 0, 0 }, 1, 1, 10 },
    /* one axle is missing: for long, or not */
    { 12, 10, 11, 9, 1, { 0, 0 }, 2, 1, 1, 0, { 0, 0 }, 0, 1, 10 },
    { 12, 10, 11, 9, 1, { 0, 0 }, 2, 1, 2, 0, { 0, 0 }, 0, 1, 0 },
    { 12, 10, 11, 9, 1, { 9, 9 }, 2, 1, 1, 0, { 0, 0 }, 0, 0, 10 },
    { 12, 10, 11, 9, 1, { 9, 9 }, 1, 1, 1, 0, { 0, 0 }, 0, 1, 10 },
  };
  for (int n = 0; n < ROWS(cases); n++) {
    const speeds *const c = &cases[n];
    const tse_params p = a_car(c->signals);
    tse_input u = a_row(c->front, c->rear);
    decoded z;
    char text[40];
    (void)snprintf(text, sizeof text, "case %d", n);
    TEST_ASSERT_EQUAL_INT(TSE_OK, tse_reset(&p, &f, sizeof f));
    f.started = c->started, f.ratio = real(c->ratio);
    f.v_front = r_mul(p.radius_front, real(c->was_front / 0.25));
    f.v_rear = r_mul(p.radius_rear, real(c->was_rear / 0.5));
    for (int a = 0; a < 2; a++) f.off_for[a] = real(c->off_for[a]);
    if (c->lacks == 1) u.missing = TSE_MISSING_wheel_speed_front;
    if (c->lacks == 2) u.missing = TSE_MISSING_wheel_speed_rear;
    TEST_ASSERT_EQUAL_INT_MESSAGE(TSE_OK, decode_row(&p, &f, &u, &z), text);
    TEST_ASSERT_EQUAL_INT_MESSAGE(c->same, z.same, text);
    for (int a = 0; a < 2; a++) TEST_ASSERT_EQUAL_INT_MESSAGE(c->off[a], z.off[a], text);
    TEST_ASSERT_EQUAL_INT_MESSAGE(c->one_speed, z.one_speed, text);
    TEST_ASSERT_EQUAL_INT_MESSAGE(c->no_second, z.no_second, text);
    TEST_ASSERT_EQUAL_INT_MESSAGE(!c->one_speed && c->lacks != 1, z.use[WHEEL_FRONT], text);
    TEST_ASSERT_EQUAL_INT_MESSAGE(c->lacks != 2, z.use[WHEEL_REAR], text);
    TEST_ASSERT_TRUE_MESSAGE(z.no_slip || !z.no_second, text);
    expect_near(c->used, number(z.z[WHEEL_REAR]), BY_NUMBER(1e-6, 1e-5, 1e-4), "rear", n);
    expect_near(c->lacks == 1 ? 0 : c->front, number(z.axle[0]), 1e-5, "as logged, front", n);
    expect_near(c->lacks == 2 ? 0 : c->rear, number(z.axle[1]), 1e-5, "as logged, rear", n);
  }
}

/* A sensor is used if it is there and in range. The wheel speeds have their own radius. A
 * missing steering angle is that of before. */
static void test_a_row_is_what_is_there_and_in_range(void)
{
  static const struct {
    uint32_t missing;
    double accel_x, accel_y, yaw_rate; /* 1000: out of range */
    int use[3];
  } cases[] = { { 0, 1, 2, 3, { 1, 1, 1 } }, { TSE_MISSING_accel_x, 1, 2, 3, { 0, 1, 1 } },
    { TSE_MISSING_accel_y, 1, 2, 3, { 1, 0, 1 } }, { TSE_MISSING_yaw_rate, 1, 2, 3, { 1, 1, 0 } },
    { 0, 1000, 2, 3, { 0, 1, 1 } }, { 0, 1, -1000, 3, { 1, 0, 1 } }, { 0, 1, 2, 1000, { 1, 1, 0 } },
    { TSE_MISSING_steer_angle, 1, 2, 3, { 1, 1, 1 } } };
  const tse_params p = a_car(2);
  for (int n = 0; n < ROWS(cases); n++) {
    tse_input u = a_row(5, 7);
    decoded z;
    const int has_steer = !(cases[n].missing & TSE_MISSING_steer_angle);
    const double read[3] = { cases[n].accel_x, cases[n].accel_y, cases[n].yaw_rate };
    u.missing = cases[n].missing, u.steer_angle = real(0.2);
    u.accel_x = real(read[0]), u.accel_y = real(read[1]), u.yaw_rate = real(read[2]);
    TEST_ASSERT_EQUAL_INT(TSE_OK, tse_reset(&p, &f, sizeof f));
    f.k.steer[0] = real(0.1);
    TEST_ASSERT_EQUAL_INT(TSE_OK, decode_row(&p, &f, &u, &z));
    for (int a = 0; a < 3; a++) {
      TEST_ASSERT_EQUAL_INT(cases[n].use[a], z.use[a]);
      expect_near(cases[n].use[a] ? read[a] : 0, number(z.z[a]), 1e-6, "value", 10 * n + a);
    }
    TEST_ASSERT_EQUAL_INT(cases[n].use[0] + cases[n].use[1] + cases[n].use[2], z.used);
    TEST_ASSERT_EQUAL_INT(has_steer, z.has_steer);
    expect_near(has_steer ? 0.2 : 0.1, number(z.steer), 1e-6, "steering angle", n);
    expect_near(5, number(z.z[WHEEL_FRONT]), 1e-5, "front [m/s]", n);
    expect_near(7, number(z.z[WHEEL_REAR]), 1e-5, "rear [m/s]", n);
  }
}

/* The first row has no predecessor, so that its dt is not read. Later ones are no shorter
 * than MIN_DT. */
static void test_the_time_of_a_row_counts_from_the_second_one_on(void)
{
  const tse_params p = a_car(2);
  const tse_real dt[] = { TSE_R(0), real(-1), real(1e-6), real(0.02) };
  for (int started = 0; started < 2; started++)
    for (int n = 0; n < ROWS(dt); n++) {
      tse_input u = a_row(5, 7);
      decoded z;
      u.dt = dt[n];
      TEST_ASSERT_EQUAL_INT(TSE_OK, tse_reset(&p, &f, sizeof f));
      f.started = started;
      const tse_status status = decode_row(&p, &f, &u, &z);
      TEST_ASSERT_EQUAL_INT(started && n < 2, status < 0);
      if (status < 0) continue;
      expect_near(
          started ? fmax(number(MIN_DT), number(dt[n])) : number(p.sample_time), number(z.dt), 1e-9, "dt", n);
    }
}

#if !defined(TSE_NO_VELOCITY)
/* A measured velocity is the speed that one wheel speed, or four driven wheels, lack. */
static void test_a_measured_velocity_is_a_second_speed(void)
{
  for (int way = 0; way < 4; way++) {
    tse_params p = a_car(2);
    tse_input u = a_row(5, 7);
    decoded z;
    p.car.driven = 0, p.prior_sd[GX] = TSE_R(1);
    TEST_ASSERT_EQUAL_INT(TSE_OK, tse_reset(&p, &f, sizeof f));
    u.given = way == 1 ? TSE_GIVEN_VELOCITIES & (0u - TSE_GIVEN_VELOCITIES) : 0;
    if (way == 2) f.k.ud.extras = TSE_EXTRAS;
    if (way == 3) p.car.driven = 1;
    TEST_ASSERT_EQUAL_INT(TSE_OK, decode_row(&p, &f, &u, &z));
    TEST_ASSERT_EQUAL_INT(way == 0 || way == 2, z.no_slip);
    u.missing = TSE_MISSING_wheel_speed_front;
    TEST_ASSERT_EQUAL_INT(TSE_OK, decode_row(&p, &f, &u, &z));
    TEST_ASSERT_EQUAL_INT(way == 0 || way == 3, z.no_second);
  }
}
#endif
