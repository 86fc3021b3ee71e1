/* model/effects/tyre_saturation.h - the lateral force of an axle ends at friction times load: C tyre_secant(C |alpha|/(friction load)), laws.h,
 * with the stiffness C that load transfer leaves: a tyre that is softer is not less grippy. Typical friction 1 .. 1.1. */
static inline void tyre_saturation_grip(point *pt)
{
  const tse_effects *const e = &pt->p->effects;
  const tse_real inv = e->tyre_saturation_inverse_friction, front = r_abs(r_mul(pt->k.y_front, pt->s.a_front)), rear = r_abs(r_mul(pt->k.y_rear, pt->s.a_rear));
  tse_real slope;
  pt->k.y_front = r_mul(pt->k.y_front, tyre_secant(r_div(r_mul(inv, front), pt->p->car.load_front), e->tyre_saturation_shape, &slope));
  pt->k.y_rear = r_mul(pt->k.y_rear, tyre_secant(r_div(r_mul(inv, rear), pt->p->car.load_rear), e->tyre_saturation_shape, &slope));
}
