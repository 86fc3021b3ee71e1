/* model/effects/conicity.h - side forces of the axles without slip: conicity, ply steer. Typical 50 .. 150 N. */
static inline void conicity_body(point *pt)
{
  const tse_car *const c = &pt->p->car;
  pt->force.y += c->pull_front + c->pull_rear;
  pt->force.yaw += r_mul(c->jf, c->pull_front) - r_mul(c->jr, c->pull_rear);
}
