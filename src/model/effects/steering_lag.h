/* model/effects/steering_lag.h - two first-order lags in a row, T = time/(1 + second) and second T, which add up to `time`; with
 * second = 0 only one:  T delta_e' = delta - delta_e (lagged in laws.h).   Typical 20 .. 60 ms. */
static inline tse_real steering_lag_input(const tse_effects *e, tse_effect_memory *m, tse_real steer, tse_real dt)
{
  const tse_real first = r_div(e->steering_lag_time, TSE_R(1) + e->steering_lag_second), second = r_mul(first, e->steering_lag_second);
  if (m->steered) lag_steering(first, second, steer, dt, m->steered_by);
  else m->steered_by[0] = m->steered_by[1] = m->steered_by[2] = steer;
  return m->steered_by[2];
}
