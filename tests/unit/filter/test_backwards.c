/* tests/unit/filter/test_backwards.c <-> src/filter/backwards.c, step.c: a car that
 * reverses out of a parking place, with wheel speeds without sign. Textbook kinematics:
 * yaw rate is speed times steering angle over wheelbase, accel_x is the derivative of the
 * speed. */
#include "filter_support.h"

typedef struct leg {
  double speed, steer; /* [m/s] at its end, negative in reverse; [rad] */
} leg;

typedef struct way {
  const char *what;
  double factor[TSE_CHANNELS], slope; /* of each channel as read; [m/s2] */
  uint32_t missing;
  leg last; /* after 3 s of standstill, at 1 m/s2 */
  int held; /* 1: above hold_speed at the end */
} way;

static tse_filter f;
static tse_params p;

/* Drive: stand still, change the speed, hold it for 3 s.
 *   Returned:  number of rows above hold_speed
 *              held  number of those whose status is held */
static int rolled(const way *w, int *held)
{
  const double wheelbase = number(p.car.lf) + number(p.car.lr), target = w->last.speed, dt = 0.01;
  double v = 0;
  int rows = 0;
  uint32_t seed = 3;
  *held = 0;
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_reset(&p, &f, sizeof f));
  for (int n = 0; n < 1500; n++) {
    const double ax = n < 300 || fabs(v) >= fabs(target) ? 0
        : target < 0                                     ? -1
                                                         : 1,
                 r = v * w->last.steer / wheelbase;
    tse_input u;
    tse_output y;
    v += ax * dt;
    tse_input_default(&u);
    u.dt = real(dt), u.missing = w->missing;
    u.steer_angle = real(w->factor[TSE_CHANNEL_steer_angle] * w->last.steer);
    u.wheel_speed_front = real(w->factor[TSE_CHANNEL_wheel_speed_front] * fabs(v) / number(p.radius_front));
    u.wheel_speed_rear = real(w->factor[TSE_CHANNEL_wheel_speed_rear] * fabs(v) / number(p.radius_rear));
    u.accel_x = real(w->factor[TSE_CHANNEL_accel_x] * (ax + w->slope + 0.05 * next_normal(&seed)));
    u.accel_y = real(v * r);
    u.yaw_rate = real(w->factor[TSE_CHANNEL_yaw_rate] * (r + 0.003 * next_normal(&seed)));
    TEST_ASSERT_GREATER_OR_EQUAL_INT(0, tse_step(&p, &f, &u, &y));
    TEST_ASSERT_EQUAL_INT(TSE_OK, tse_filter_check(&p, &f, sizeof f));
    if (n < 300 || fabs(v) < number(p.hold_speed) + 0.05) continue;
    rows++;
    *held += y.status == TSE_W_HELD || y.reason[TSE_CY_FRONT] == TSE_HELD;
  }
  return rows;
}

#define RIGHT { 1, 1, 1, 1, 1, 1 }
#define ALONE (TSE_MISSING_accel_x)

static void test_a_car_that_rolls_backwards_is_held(void)
{
  static const way ways[] = {
    { "backwards, full lock", RIGHT, 0, 0, { -4, 0.5 }, 1 },
    { "backwards, to the right", RIGHT, 0, 0, { -4, -0.3 }, 1 },
    { "backwards, straight", RIGHT, 0, 0, { -4, 0 }, 1 },
    { "backwards, and accel_x is missing", RIGHT, 0, ALONE, { -4, 0.2 }, 1 },
    { "backwards, and the yaw rate is missing", RIGHT, 0, TSE_MISSING_yaw_rate, { -4, 0.2 }, 1 },
    { "backwards down a slope", RIGHT, 0.6, 0, { -4, 0.3 }, 1 },
    { "forward, full lock", RIGHT, 0, 0, { 4, 0.5 }, 0 },
    { "forward, straight", RIGHT, 0, 0, { 4, 0 }, 0 },
    { "forward down a ramp of 15 %", RIGHT, -1.5, 0, { 4, 0 }, 0 },
    { "forward, accel_x missing", RIGHT, 0, ALONE, { 4, 0.2 }, 0 },
    { "forward, accel_x to the rear, in a bend", { 1, 1, 1, -1, 1, 1 }, 0, 0, { 4, 0.2 }, 0 },
    { "forward, steering to the right", { -1, 1, 1, 1, 1, 1 }, 0, 0, { 4, 0.2 }, 0 },
    { "forward, yaw rate to the right", { 1, 1, 1, 1, 1, -1 }, 0, 0, { 4, -0.2 }, 0 },
    { "backwards, wheel speeds with their sign", { 1, -1, -1, 1, 1, 1 }, 0, 0, { -4, 0.2 }, 1 },
    { "forward, faster than any car backwards, accel_x to the rear", { 1, 1, 1, -1, 1, 1 }, 0, 0, { 9, 0 },
        0 },
  };
  p = prepared(config_by(tse_config_default));
  for (int i = 0; i < ROWS(ways); i++) {
    int held;
    const int rows = rolled(&ways[i], &held);
    TEST_ASSERT_GREATER_THAN_INT(90, rows);
    if (ways[i].last.speed > 8)
      TEST_ASSERT_LESS_THAN_INT_MESSAGE(rows * 3 / 4, held, ways[i].what); /* undecided before */
    else TEST_ASSERT_EQUAL_INT_MESSAGE(ways[i].held ? rows : 0, held, ways[i].what);
  }
}
