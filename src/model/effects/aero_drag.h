/* model/effects/aero_drag.h - m vx' - kd vx |vx|. Typical kd = 1/2 rho cd A: 0.35 .. 0.45 kg/m. */
static inline void aero_drag_body(const tse_params *p, const tse_effect_memory *m, point *pt)
{
  const tse_effects *const e = &p->effects;
  (void)m;
  pt->force.x = pt->force.x - r_mul(r_mul(e->aero_drag_coefficient, e->inv_mass), r_mul(pt->vx, r_abs(pt->vx)));
}
