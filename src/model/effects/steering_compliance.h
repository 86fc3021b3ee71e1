/* model/effects/steering_compliance.h - the wheels give way by c n Fy_f: alpha = alpha_0 - c n C alpha, so alpha_0/(1 + c n C).
 * C is the stiffness without STIFFNESS effects: what saturation would take off the moment is left out. Linear, it is the
 * same as a softer tyre. Typical 0.2 .. 0.5 degrees per 100 Nm. */
static inline void steering_compliance_slip(point *pt)
{
  pt->s.a_front = r_div(pt->s.a_front, TSE_R(1) + r_mul(pt->p->car.compliance, pt->k.y_front));
}
