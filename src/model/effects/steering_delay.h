/* model/effects/steering_delay.h - delta(t - time), linear between rows. Typical 10 .. 40 ms. */
static inline tse_real steering_delay_input(const tse_effects *e, tse_effect_memory *m, tse_real steer, tse_real dt)
{
  effects_delay_put(&m->steer, m->steer_was, e->steering_delay_time, dt, &steer, 1);
  return effects_delay_get(&m->steer, m->steer_was[0], e->steering_delay_time);
}
