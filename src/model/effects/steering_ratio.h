/* model/effects/steering_ratio.h - delta (1 + change). Typical 0.02 .. 0.06. */
static inline tse_real steering_ratio_input(const tse_effects *e, tse_effect_memory *m, tse_real steer, tse_real dt)
{
  (void)m;
  (void)dt;
  return steer + r_mul(e->steering_ratio_change, steer);
}
