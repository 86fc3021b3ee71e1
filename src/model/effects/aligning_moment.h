/* model/effects/aligning_moment.h - I r' - trail (Fy_f + Fy_r): lateral forces act behind the wheels' centres.
 * Typical 20 .. 40 mm. */
static inline void aligning_moment_body(point *pt)
{
  pt->force.yaw = pt->force.yaw - r_mul(pt->p->car.trail, pt->fy_front + pt->fy_rear);
}
