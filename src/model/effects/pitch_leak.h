/* model/effects/pitch_leak.h - accel_x + gain (g x - height x''): the nose lifts by gain x, x: longitudinal acceleration through
 * a second-order mode (mode_step in laws.h); gravity leaks in, and an IMU above the pitch axis swings.
 * Typical gain 1.5 .. 3 degrees per g. */
static inline void pitch_leak_sensor(reading *z)
{
  z->y[0] += pitch_read(&z->pt->p->car, z->m->mode[MODE_PITCH], z->pt->force.x);
}

static inline void pitch_leak_remember(const tse_effects *e, tse_effect_memory *m, const point *a, const point *b, tse_real h)
{
  mode_step(m->mode[MODE_PITCH], e->pitch_leak_frequency, e->pitch_leak_damping, a->force.x, b->force.x, h);
}
