/* model/effects/conicity.h - side forces of the axles without slip: conicity, ply steer. Typical 50 .. 150 N. */
static inline void conicity_body(const tse_params *p, const tse_effect_memory *m, point *pt)
{
  const tse_effects *const e = &p->effects;
  const tse_real front = r_mul(e->conicity_front, e->inv_mass), rear = r_mul(e->conicity_rear, e->inv_mass);
  (void)m;
  pt->force.y += front + rear;
  pt->force.yaw += r_mul(p->jf, front) - r_mul(p->jr, rear);
}
