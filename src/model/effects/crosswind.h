/* model/effects/crosswind.h - Fy + c w sqrt(vx^2 + w^2) cos(psi), psi: heading since the start, plus the setting's; at `arm`
 * before the centre of gravity. Typical w 3 .. 10 m/s, c 2.8 kg/m, arm 0.45 m. */
static inline void crosswind_body(const tse_params *p, const tse_effect_memory *m, point *pt)
{
  const tse_effects *const e = &p->effects;
  const tse_real w = e->crosswind_speed, turns = m->heading + r_mul(TSE_R(0.15915494309189535), r_mul(pt->ahead, pt->r));
  tse_real sine, cosine;
  effects_sincos(e->crosswind_heading + r_mul(TSE_R(6.283185307179586), turns), &sine, &cosine);
  const tse_real air = r_sqrt(r_mul(pt->vx, pt->vx) + r_mul(w, w));
  const tse_real newton = r_mul(r_mul(e->crosswind_coefficient, w), r_mul(air, cosine));
  pt->force.y += r_mul(newton, e->inv_mass);
  pt->force.yaw += r_mul(r_mul(newton, e->crosswind_arm), e->inv_inertia);
}

static inline void crosswind_remember(tse_effect_memory *m, const point *a, const point *b, tse_real h)
{
  const tse_real turns = m->heading + r_mul(TSE_R(0.5 * 0.15915494309189535), r_mul(h, a->r + b->r));
  m->heading = turns - r_from_int(r_floor_to_int(turns));
}
