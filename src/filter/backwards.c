/* filter/backwards.c - does the car roll backwards? Many wheel speeds have no sign.
 * Backwards a car turns the other way than it steers, and accel_x is negative while the
 * speed grows. Both are weighed from when the car stood, or was seen first. It rolls
 * backwards where they say so and neither says the contrary: where a channel has the
 * wrong sign, one does. */
#include "filter/filter.h"

/* Return the log odds that two numbers are opposite, not equal, of which one is off by
 * this variance. */
static tse_real opposite(tse_real x, tse_real y, tse_real var)
{
  return r_clamp(r_mul(TSE_R(-2), r_mul(x, r_div(y, var))), -TAIL, TAIL);
}

/* Let a row say which way the car turns for what it steers. The angle may have an
 * offset. */
static void learn_by_turn(const tse_params *p, tse_way *w, const decoded *z, tse_real speed, tse_real turn)
{
  const tse_real wheelbase = p->car.lf + p->car.lr;
  const tse_real asked = r_div(r_mul(speed, z->steer), wheelbase);
  const tse_real sd = r_div(r_mul(STEER_OPENS, r_max(speed, LEAST_SPEED_SD)), wheelbase);
  const tse_real says = opposite(asked, turn, r_sqr(sd)), share = r_min(r_div(z->dt, SMOOTH_TIME), TSE_R(1));
  w->by_turn = r_clamp(w->by_turn + r_mul(share, says), -TAIL, TAIL);
}

/* Let what accel_x has added up to say which way the car gained its speed, on a road that
 * may rise or fall. What it has said most surely counts: a sum is worth less with time. */
static void learn_by_gain(tse_way *w, const decoded *z, tse_real speed)
{
  w->gained = r_clamp(w->gained + r_mul(w->unread, z->z[ACCEL_X]), -MOST_MOVED, MOST_MOVED);
  w->unread = TSE_R(0);
  const tse_real var = r_sqr(LEAST_SPEED_SD) + r_sqr(r_mul(LEAST_ACTIVITY, w->rolls_for));
  const tse_real says = opposite(speed - w->begins, w->gained, var);
  if (r_abs(says) > r_abs(w->by_gain)) w->by_gain = says;
}

int rolls_backwards(const tse_params *p, tse_filter *f, const decoded *z, tse_real speed)
{
  tse_way *const w = &f->way;
  const int has_speed = z->use[WHEEL_FRONT] || z->use[WHEEL_REAR];
  const int has_sign = r_min(z->axle[0], z->axle[1]) < -STILL_SPEED;
  w->rolls_for = r_min(w->rolls_for + z->dt, MOST_AGE);
  w->unread = r_min(w->unread + z->dt, MOST_AGE);
  if (has_speed && (has_sign || speed < LEAST_ROLLING || speed > FASTEST_BACKWARDS)) {
    memset(w, 0, sizeof *w);
    w->begins = speed;
    if (speed > FASTEST_BACKWARDS) w->by_turn = w->by_gain = -TAIL;
  } else if (has_speed) {
    if (z->has_steer && z->use[YAW_RATE]) learn_by_turn(p, w, z, speed, z->z[YAW_RATE] - f->k.x[BR]);
    if (z->use[ACCEL_X]) learn_by_gain(w, z, speed);
  }
  return w->by_turn + w->by_gain > SAYS_BACKWARDS && r_min(w->by_turn, w->by_gain) > SAYS_FORWARD;
}
