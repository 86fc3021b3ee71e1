/* model/effects/rear_roll_steer.h - the rear wheels steer with the roll angle: alpha_r + gain roll x, where x is accel_y
 * through a second-order mode (mode_step in laws.h). Typical gain 0.03 .. 0.1, into the turn. */
static inline void rear_roll_steer_slip(point *pt)
{
  const tse_effects *const e = &pt->p->effects;
  const tse_real *const x = pt->m->mode[MODE_ROLL_STEER];
  pt->s.a_rear += r_mul(r_mul(e->rear_roll_steer_gain, e->rear_roll_steer_roll), x[0] + r_mul(pt->ahead, x[1]));
}

static inline void rear_roll_steer_remember(const tse_effects *e, tse_effect_memory *m, const point *a, const point *b, tse_real h)
{
  mode_step(m->mode[MODE_ROLL_STEER], e->rear_roll_steer_frequency, e->rear_roll_steer_damping, a->force.y, b->force.y, h);
}
