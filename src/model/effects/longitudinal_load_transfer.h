/* model/effects/longitudinal_load_transfer.h - cornering stiffness Cf (1 - gain ax), Cr (1 + gain ax), each between 0.1 and 1.9;
 * ax: specific force of drive and brakes. The longitudinal stiffness is left, whose sum would not change.
 * Typical 0.02 .. 0.04 s2/m. */
static inline void longitudinal_load_transfer_stiffness(point *pt)
{
  const tse_real ax = r_mul(pt->k.x_front, pt->s.s_front) + r_mul(pt->k.x_rear, pt->s.s_rear);
  const tse_real shift = r_mul(pt->p->car.load_gain, tyre_pull(ax));
  pt->k.y_front = r_mul(pt->k.y_front, TSE_R(1) - shift);
  pt->k.y_rear = r_mul(pt->k.y_rear, TSE_R(1) + shift);
}
