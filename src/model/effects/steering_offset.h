/* model/effects/steering_offset.h - delta + angle. Typical 0.1 .. 0.5 degrees. */
static inline tse_real steering_offset_input(const tse_effects *e, tse_effect_memory *m, tse_real steer, tse_real dt)
{
  (void)m;
  (void)dt;
  return steer + e->steering_offset_angle;
}
