/* model/effects/stiffness_drift.h - all stiffness times 1 + change share, share growing from 0 at `start` to 1 `time` later.
 * Typical 5 .. 15 %: temperature, wear, another road. A short time makes a step. */
static inline void stiffness_drift_stiffness(point *pt)
{
  const tse_effects *const e = &pt->p->effects;
  const tse_real since = pt->m->time + pt->ahead - e->stiffness_drift_start;
  const tse_real share = r_clamp(r_div(since, e->stiffness_drift_time), TSE_R(0), TSE_R(1));
  const tse_real factor = TSE_R(1) + r_mul(e->stiffness_drift_change, share);
  pt->k.x_front = r_mul(pt->k.x_front, factor);
  pt->k.x_rear = r_mul(pt->k.x_rear, factor);
  pt->k.y_front = r_mul(pt->k.y_front, factor);
  pt->k.y_rear = r_mul(pt->k.y_rear, factor);
}
