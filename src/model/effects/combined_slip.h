/* model/effects/combined_slip.h - Fy/sqrt(1 + k slip^2), each axle with its own slip. Typical k 50 .. 100. */
static inline void combined_slip_stiffness(point *pt)
{
  const tse_real k = pt->p->effects.combined_slip_factor;
  pt->k.y_front = r_div(pt->k.y_front, r_sqrt(TSE_R(1) + r_mul(k, r_mul(pt->s.s_front, pt->s.s_front))));
  pt->k.y_rear = r_div(pt->k.y_rear, r_sqrt(TSE_R(1) + r_mul(k, r_mul(pt->s.s_rear, pt->s.s_rear))));
}
