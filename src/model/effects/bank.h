/* model/effects/bank.h - vy' - g sin(angle + profile): accelerates the car, but no accelerometer.
 * Typical 1.5 .. 3 %, left side high > 0. */
static inline void bank_body(const tse_params *p, const tse_effect_memory *m, point *pt)
{
  tse_real sine, cosine;
  (void)m;
  effects_sincos(p->effects.bank_angle + pt->g.bank, &sine, &cosine);
  pt->gravity_y = -r_mul(GRAVITY, sine);
}
