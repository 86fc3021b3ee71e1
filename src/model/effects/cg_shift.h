/* model/effects/cg_shift.h - the centre of gravity lies `distance` further back: lf + d, lr - d. Typical 0.05 .. 0.15 m.
 * No more than 9/10 of lf or lr, so that it stays between the axles. */
static inline void cg_shift_constant(tse_config *c)
{
  const tse_setting share = TSE_S(0.9), most = r_mul(share, c->lr), least = -r_mul(share, c->lf);
  const tse_setting d = c->cg_shift_distance > most ? most : (c->cg_shift_distance < least ? least : c->cg_shift_distance);
  c->lf += d;
  c->lr -= d;
}
