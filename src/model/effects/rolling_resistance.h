/* model/effects/rolling_resistance.h - m vx' - f m g against the motion, rising linearly below 0.5 m/s.
 * Typical f 0.008 .. 0.015. */
static inline void rolling_resistance_body(const tse_params *p, const tse_effect_memory *m, point *pt)
{
  const tse_real most = r_mul(p->effects.rolling_resistance_coefficient, GRAVITY);
  (void)m;
  pt->force.x = pt->force.x - r_mul(most, r_div(pt->vx, r_max(r_abs(pt->vx), TSE_R(0.5))));
}
