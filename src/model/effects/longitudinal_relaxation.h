/* model/effects/longitudinal_relaxation.h - as relaxation.h for the slip of an axle: s' = (v/length)(slip - s), v what slip is
 * taken over. Typical length 0.1 .. 0.4 m; stands for the driveline's lag, too. */
static inline void longitudinal_relaxation_slip(const tse_real lag[4], point *pt)
{
  pt->s.s_front = lag[2];
  pt->s.s_rear = lag[3];
}

/* [1/s]; inv: of the axle, slips.inv_front or inv_rear */
static inline tse_real longitudinal_relaxation_rate(const tse_effects *e, tse_real inv)
{
  return r_div(TSE_R(1), r_mul(e->longitudinal_relaxation_length, inv));
}
