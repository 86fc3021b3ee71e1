/* model/effects/grade.h - vx' - g sin(angle + profile): accelerates the car, but no accelerometer.
 * Typical 1 .. 6 %, uphill > 0. */
static inline void grade_body(const tse_params *p, const tse_effect_memory *m, point *pt)
{
  tse_real sine, cosine;
  (void)m;
  effects_sincos(p->effects.grade_angle + pt->g.grade, &sine, &cosine);
  pt->gravity_x = -r_mul(GRAVITY, sine);
}
