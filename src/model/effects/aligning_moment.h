/* model/effects/aligning_moment.h - I r' - trail (Fy_f + Fy_r): lateral forces act behind the wheels' centres.
 * Typical 20 .. 40 mm. */
static inline void aligning_moment_body(const tse_params *p, const tse_effect_memory *m, point *pt)
{
  const tse_effects *const e = &p->effects;
  const tse_real lever = r_mul(r_mul(e->aligning_moment_trail, e->mass), e->inv_inertia);
  (void)m;
  pt->force.yaw = pt->force.yaw - r_mul(lever, pt->fy_front + pt->fy_rear);
}
