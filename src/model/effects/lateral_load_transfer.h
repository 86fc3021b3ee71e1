/* model/effects/lateral_load_transfer.h - cornering stiffness C (1 - k a^2), a: lateral acceleration by the tyres with that very
 * stiffness. With a0 the one before: a = a0 (1 - k a^2), so a = 2 a0/(1 + sqrt(1 + 4 k a0^2)). Front k (1 + balance), rear
 * k (1 - balance); nothing below a tenth. Typical k 0.002 .. 0.005 s4/m2: -8 % at 5 m/s2. */
static inline void lateral_load_transfer_stiffness(const tse_params *p, const tse_effect_memory *m, point *pt)
{
  const tse_effects *const e = &p->effects;
  const tse_real a0 = r_mul(pt->k.y_front, pt->s.a_front) + r_mul(pt->k.y_rear, pt->s.a_rear);
  const tse_real inside = r_max(TSE_R(1) + r_mul(r_mul(TSE_R(4), e->lateral_load_transfer_gain), r_mul(a0, a0)), TSE_R(0));
  const tse_real a = r_div(a0 + a0, TSE_R(1) + r_sqrt(inside));
  const tse_real lost = r_mul(e->lateral_load_transfer_gain, r_mul(a, a)), uneven = r_mul(lost, e->lateral_load_transfer_balance);
  (void)m;
  pt->k.y_front = r_mul(pt->k.y_front, r_max(TSE_R(1) - lost - uneven, TSE_R(0.1)));
  pt->k.y_rear = r_mul(pt->k.y_rear, r_max(TSE_R(1) - lost + uneven, TSE_R(0.1)));
}
