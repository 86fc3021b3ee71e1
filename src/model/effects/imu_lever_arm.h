/* model/effects/imu_lever_arm.h - accelerations at (x, y) from the centre of gravity: ax - r^2 x - r' y, ay + r' x - r^2 y.
 * Typical 0.2 .. 0.8 m. */
static inline void imu_lever_arm_sensor(reading *z)
{
  const tse_car *const c = &z->pt->p->car;
  const planar there = force_at(z->y[0], z->y[1], c->lever_x, c->lever_y, z->pt->r, z->pt->force.yaw);
  z->y[0] = there.x;
  z->y[1] = there.y;
}
