/* model/effects/bank.h - vy' - g sin(angle + profile) + superelevation vx r: accelerates the car, but no accelerometer.
 * Roads are built to lean into their curves, and take over a share of what the tyres would have to give.
 * Typical 1.5 .. 3 %, left side high > 0; superelevation 0.05 .. 0.2. */
static inline void bank_body(point *pt)
{
  const tse_effects *const e = &pt->p->effects;
  pt->gravity_y = r_mul(e->bank_superelevation, r_mul(pt->vx, pt->r)) - gravity_along(e->bank_angle + pt->g.bank);
}
