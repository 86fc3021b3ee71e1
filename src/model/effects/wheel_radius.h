/* model/effects/wheel_radius.h - the rolling radius is R (1 + change), both axles.
 * Typical 0.01 .. 0.025: wear, pressure, size. */
static inline void wheel_radius_constant(tse_config *c)
{
  c->wheel_radius_front += r_mul(c->wheel_radius_front, c->wheel_radius_change);
  c->wheel_radius_rear += r_mul(c->wheel_radius_rear, c->wheel_radius_change);
}
