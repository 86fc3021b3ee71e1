/* model/effects/steering_lag.h - two first-order lags in a row, T = time/(1 + second) and second T, which add up to `time`; with
 * second = 0 only one:  T delta_e' = delta - delta_e, exact for an angle that is linear between rows:
 *   delta_e1 = delta_1 - s T + (delta_e0 - delta_0 + s T) exp(-dt/T),  s = (delta_1 - delta_0)/dt.   Typical 20 .. 60 ms. */
static inline tse_real steering_lag_of(tse_real time, tse_real from, tse_real to, tse_real was, tse_real dt)
{
  const tse_real behind = r_mul(time, r_div(to - from, dt));
  const tse_real left = r_exp2(-r_div(r_mul(TSE_R(1.4426950408889634), dt), time));
  return to - behind + r_mul(was - from + behind, left);
}

static inline tse_real steering_lag_input(const tse_effects *e, tse_effect_memory *m, tse_real steer, tse_real dt)
{
  const tse_real first = r_div(e->steering_lag_time, TSE_R(1) + e->steering_lag_second);
  const tse_real second = r_mul(first, e->steering_lag_second), half_way = m->steer_half;
  m->steer_half = m->steered ? steering_lag_of(first, m->steer_in, steer, half_way, dt) : steer;
  m->steer_in = steer;
  if (!m->steered || !(second > TSE_R(0))) m->steer_out = m->steer_half;
  else m->steer_out = steering_lag_of(second, half_way, m->steer_half, m->steer_out, dt);
  return m->steer_out;
}
