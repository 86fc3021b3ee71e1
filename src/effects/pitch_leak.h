/* src/effects/pitch_leak.h - accel_x + g gain x: the nose lifts by gain x, x: longitudinal acceleration through a second-order
 * mode (effects_mode). Typical gain 1.5 .. 3 degrees per g. */
static inline void pitch_leak_sensor(const tse_effects *e, tse_effect_memory *m, const point *pt, tse_real dt, tse_real y[3])
{
  (void)pt;
  (void)dt;
  y[0] += r_mul(r_mul(GRAVITY, e->pitch_leak_gain), m->mode[MODE_PITCH][0]);
}

static inline void pitch_leak_remember(const tse_effects *e, tse_effect_memory *m, const point *a, const point *b, tse_real h)
{
  effects_mode(m->mode[MODE_PITCH], e->pitch_leak_frequency, e->pitch_leak_damping, a->force.x, b->force.x, h);
}
