/* model/effects/steering_compliance.h - the wheels give way by c n Fy_f: alpha = alpha_0 - c n C alpha, so alpha_0/(1 + c n C).
 * C is the stiffness without STIFFNESS effects: what saturation would take off the moment is left out. Linear, it is the
 * same as a softer tyre. Typical 0.2 .. 0.5 degrees per 100 Nm. */
static inline void steering_compliance_slip(const tse_params *p, const tse_effect_memory *m, point *pt)
{
  const tse_effects *const e = &p->effects;
  const tse_real per_force = r_mul(e->steering_compliance_angle_per_moment, e->steering_compliance_trail);
  (void)m;
  pt->s.a_front = r_div(pt->s.a_front, TSE_R(1) + r_mul(r_mul(per_force, e->mass), pt->k.y_front));
}
