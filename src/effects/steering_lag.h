/* src/effects/steering_lag.h - T delta_e' = delta - delta_e, exact for an angle that is linear between rows:
 *   delta_e1 = delta_1 - s T + (delta_e0 - delta_0 + s T) exp(-dt/T),  s = (delta_1 - delta_0)/dt.   Typical 20 .. 60 ms. */
static inline tse_real steering_lag_input(const tse_effects *e, tse_effect_memory *m, tse_real steer, tse_real dt)
{
  if (m->steered) {
    const tse_real behind = r_mul(e->steering_lag_time, r_div(steer - m->steer_in, dt));
    const tse_real left = r_exp2(-r_div(r_mul(TSE_R(1.4426950408889634), dt), e->steering_lag_time));
    m->steer_out = steer - behind + r_mul(m->steer_out - m->steer_in + behind, left);
  } else {
    m->steer_out = steer;
  }
  m->steer_in = steer;
  return m->steer_out;
}
