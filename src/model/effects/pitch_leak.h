/* model/effects/pitch_leak.h - accel_x + gain (g x - height x''): the nose lifts by gain x, x: longitudinal acceleration through
 * a second-order mode (effects_mode); gravity leaks in, and an IMU above the pitch axis swings.
 * Typical gain 1.5 .. 3 degrees per g. */
static inline void pitch_leak_sensor(const tse_effects *e, tse_effect_memory *m, const point *pt, tse_real dt, tse_real y[3])
{
  (void)dt;
  const tse_real *const x = m->mode[MODE_PITCH];
  const tse_real swing = r_mul(e->pitch_leak_height, effects_mode_swing(x, e->pitch_leak_frequency, e->pitch_leak_damping, pt->force.x));
  y[0] += r_mul(e->pitch_leak_gain, r_mul(GRAVITY, x[0]) - swing);
}

static inline void pitch_leak_remember(const tse_effects *e, tse_effect_memory *m, const point *a, const point *b, tse_real h)
{
  effects_mode(m->mode[MODE_PITCH], e->pitch_leak_frequency, e->pitch_leak_damping, a->force.x, b->force.x, h);
}
