/* model/effects/body_roll.h - the car leans out of the turn by phi = gain x, x: lateral acceleration through a second-order mode
 * (mode_step in laws.h). Gravity leaks in, and an IMU above the roll axis swings: accel_y + g phi - height phi''. The body's mass swings,
 * too, and pushes the car: m (vy' + vx r) = sum of tyre forces + m coupling phi'', coupling = sprung mass times the height of its
 * centre of gravity above the roll axis, over m. Typical gain 3 .. 6 degrees per g, 1.2 .. 2 Hz, damping 0.2 .. 0.4. */
static inline tse_real body_roll_swing(const point *pt, tse_real x, tse_real speed)
{
  return mode_swing(x, speed, pt->p->car.roll_omega, pt->p->car.roll_damping, pt->force.y);
}

static inline void body_roll_body(point *pt)
{
  const tse_effects *const e = &pt->p->effects;
  const tse_real *const x = pt->m->mode[MODE_ROLL], h = pt->ahead;
  const tse_real then = x[0] + r_mul(h, x[1]), before = body_roll_swing(pt, then, x[1]); /* the mode is that of `ahead` seconds ago: extrapolated */
  const tse_real swing = body_roll_swing(pt, then + r_mul(r_mul(TSE_R(0.5), r_mul(h, h)), before), x[1] + r_mul(h, before));
  pt->gravity_y += r_mul(r_mul(e->body_roll_coupling, e->body_roll_gain), swing);
}

static inline void body_roll_sensor(reading *z)
{
  const tse_effects *const e = &z->pt->p->effects;
  const tse_real *const x = z->m->mode[MODE_ROLL], swing = r_mul(e->body_roll_height, body_roll_swing(z->pt, x[0], x[1]));
  z->y[1] += r_mul(e->body_roll_gain, r_mul(GRAVITY, x[0]) - swing);
}

static inline void body_roll_remember(const tse_effects *e, tse_effect_memory *m, const point *a, const point *b, tse_real h)
{
  mode_step(m->mode[MODE_ROLL], e->body_roll_frequency, e->body_roll_damping, a->force.y, b->force.y, h);
}
