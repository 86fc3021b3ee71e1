/* model/effects/crosswind.h - Fy + c w sqrt(vx^2 + w^2) cos(psi), psi: heading since the start, plus the setting's; at `arm`
 * before the centre of gravity. Typical w 3 .. 10 m/s, c 2.8 kg/m, arm 0.45 m. */
static inline void crosswind_body(point *pt)
{
  const tse_effects *const e = &pt->p->effects;
  const tse_real w = e->crosswind_speed, turns = pt->m->heading + r_mul(PER_TURN, r_mul(pt->ahead, pt->r));
  tse_real sine, cosine;
  sin_cos(e->crosswind_heading + r_mul(TWO_PI, turns), &sine, &cosine);
  const tse_real air = r_sqrt(r_mul(pt->vx, pt->vx) + r_mul(w, w));
  const tse_real push = r_div(r_mul(r_mul(e->crosswind_coefficient, w), r_mul(air, cosine)), e->mass);
  pt->force.y += push;
  pt->force.yaw += r_mul(r_mul(push, e->crosswind_arm), pt->p->car.m_inertia);
}

static inline void crosswind_remember(tse_effect_memory *m, const point *a, const point *b, tse_real h)
{
  const tse_real turns = m->heading + r_mul(TSE_R(0.5 * 0.15915494309189535), r_mul(h, a->r + b->r));
  m->heading = turns - r_from_int(r_floor_to_int(turns));
}
