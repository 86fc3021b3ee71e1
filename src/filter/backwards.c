/* filter/backwards.c - find whether the car rolls backwards. Many wheel speeds have no
 * sign, so that the direction must be found from other channels.
 *
 * In reverse the yaw rate has the opposite sign of the steering angle, and accel_x is
 * negative while the magnitude of the speed increases. Two tests use this: one compares
 * yaw rate and steering angle, the other compares accel_x and the gain of speed. Each
 * test gives the log odds of reverse. The log odds of both tests start again at 0
 * whenever the car is slower than MIN_ROLLING_SPEED, where it can change its direction,
 * and whenever a wheel speed is negative, because the wheel speeds then have a sign and
 * show the direction without a test. Above MAX_REVERSE_SPEED the car drives forwards, and
 * both log odds are set to the min, -TAIL.
 *
 * The car counts as rolling backwards if the sum of the two log odds is large
 * (MIN_REVERSE_ODDS) and each of the two is above a lower limit (MIN_EACH_ODDS). The
 * sum alone is not enough: a channel with a wrong sign makes the odds of one test
 * large. */
#include "filter/backwards.h"

/* Return the natural log odds of y = -x against y = x for equal prior probabilities and
 * normal errors: -2 x y / var, limited to -TAIL .. TAIL.
 *   Given:  var  variance of the error: of y + x if y = -x, of y - x if y = x */
static tse_real compute_opposite_odds(tse_real x, tse_real y, tse_real var)
{
  return r_clamp(r_mul(TSE_R(-2), r_mul(x, r_div(y, var))), -TAIL, TAIL);
}

/* Update the log odds of reverse from the yaw rate and the steering angle. The yaw rate
 * is compared with speed times steering angle / wheelbase. The variance of their
 * difference allows for an offset of the steering angle (STEER_FAULT_SD).
 *   Given:  turn  [rad/s] measured yaw rate, less the gyro bias */
static void update_by_turn(const tse_params *p, tse_way *w, const decoded *z, tse_real speed, tse_real turn)
{
  const tse_real wheelbase = p->car.lf + p->car.lr;
  const tse_real steered = r_div(r_mul(speed, z->steer), wheelbase);
  const tse_real sd = r_div(r_mul(STEER_FAULT_SD, r_max(speed, REVERSE_SD)), wheelbase);
  const tse_real odds = compute_opposite_odds(steered, turn, r_sqr(sd));
  const tse_real share = r_min(r_div(z->dt, SMOOTH_TIME), TSE_R(1));
  w->by_turn = r_clamp(w->by_turn + r_mul(share, odds), -TAIL, TAIL);
}

/* Update the log odds of reverse from the gain of speed and the integral of accel_x.
 * The integral also contains gravity along the road, so that its variance grows with
 * time. When the speed no longer changes, newly computed log odds therefore shrink
 * towards 0, which would discard the earlier evidence. So keep the log odds of the
 * largest magnitude so far. */
static void update_by_gain(tse_way *w, const decoded *z, tse_real speed)
{
  w->gained = r_clamp(w->gained + r_mul(w->unread, z->z[ACCEL_X]), -MAX_MOVED, MAX_MOVED);
  w->unread = TSE_R(0);
  const tse_real var = r_sqr(REVERSE_SD) + r_sqr(r_mul(MIN_ACTIVITY, w->rolls_for));
  const tse_real odds = compute_opposite_odds(speed - w->begins, w->gained, var);
  if (r_abs(odds) > r_abs(w->by_gain)) w->by_gain = odds;
}

int rolls_backwards(const tse_params *p, tse_filter *f, const decoded *z, tse_real speed)
{
  tse_way *const w = &f->way;
  const int has_speed = z->use[WHEEL_FRONT] || z->use[WHEEL_REAR];
  const int has_sign = r_min(z->axle[0], z->axle[1]) < -STILL_SPEED;
  w->rolls_for = r_min(w->rolls_for + z->dt, MAX_AGE);
  w->unread = r_min(w->unread + z->dt, MAX_AGE);
  if (has_speed && (has_sign || speed < MIN_ROLLING_SPEED || speed > MAX_REVERSE_SPEED)) {
    memset(w, 0, sizeof *w);
    w->begins = speed;
    if (speed > MAX_REVERSE_SPEED) w->by_turn = w->by_gain = -TAIL;
  } else if (has_speed) {
    if (z->has_steer && z->use[YAW_RATE]) update_by_turn(p, w, z, speed, z->z[YAW_RATE] - f->k.x[BR]);
    if (z->use[ACCEL_X]) update_by_gain(w, z, speed);
  }
  return w->by_turn + w->by_gain > MIN_REVERSE_ODDS && r_min(w->by_turn, w->by_gain) > MIN_EACH_ODDS;
}
