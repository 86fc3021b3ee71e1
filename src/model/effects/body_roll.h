/* model/effects/body_roll.h - the car leans out of the turn by phi = gain x, x: lateral acceleration through a second-order mode
 * (effects_mode). Gravity leaks in, and an IMU above the roll axis swings: accel_y + g phi - height phi''. The body's mass swings,
 * too, and pushes the car: m (vy' + vx r) = sum of tyre forces + m coupling phi'', coupling = sprung mass times the height of its
 * centre of gravity above the roll axis, over m. Typical gain 3 .. 6 degrees per g, 1.2 .. 2 Hz, damping 0.2 .. 0.4. */
static inline void body_roll_body(const tse_params *p, const tse_effect_memory *m, point *pt)
{
  const tse_effects *const e = &p->effects;
  const tse_real f = e->body_roll_frequency, d = e->body_roll_damping, h = pt->ahead;
  tse_real x[2] = { m->mode[MODE_ROLL][0] + r_mul(h, m->mode[MODE_ROLL][1]), m->mode[MODE_ROLL][1] };
  const tse_real before = effects_mode_swing(x, f, d, pt->force.y); /* the mode is that of `ahead` seconds ago: extrapolated */
  x[0] += r_mul(r_mul(TSE_R(0.5), r_mul(h, h)), before);
  x[1] += r_mul(h, before);
  pt->gravity_y += r_mul(r_mul(e->body_roll_coupling, e->body_roll_gain), effects_mode_swing(x, f, d, pt->force.y));
}

static inline void body_roll_sensor(const tse_effects *e, tse_effect_memory *m, const point *pt, tse_real dt, tse_real y[3])
{
  (void)dt;
  const tse_real *const x = m->mode[MODE_ROLL];
  const tse_real swing = r_mul(e->body_roll_height, effects_mode_swing(x, e->body_roll_frequency, e->body_roll_damping, pt->force.y));
  y[1] += r_mul(e->body_roll_gain, r_mul(GRAVITY, x[0]) - swing);
}

static inline void body_roll_remember(const tse_effects *e, tse_effect_memory *m, const point *a, const point *b, tse_real h)
{
  effects_mode(m->mode[MODE_ROLL], e->body_roll_frequency, e->body_roll_damping, a->force.y, b->force.y, h);
}
