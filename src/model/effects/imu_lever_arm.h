/* model/effects/imu_lever_arm.h - accelerations at (x, y) from the centre of gravity: ax - r^2 x - r' y, ay + r' x - r^2 y.
 * Typical 0.2 .. 0.8 m. */
static inline void imu_lever_arm_sensor(const tse_effects *e, tse_effect_memory *m, const point *pt, tse_real dt, tse_real y[3])
{
  const tse_real spin = r_mul(pt->r, pt->r), yaw = pt->force.yaw;
  (void)m;
  (void)dt;
  y[0] = y[0] - r_mul(spin, e->imu_lever_arm_x) - r_mul(yaw, e->imu_lever_arm_y);
  y[1] = y[1] + r_mul(yaw, e->imu_lever_arm_x) - r_mul(spin, e->imu_lever_arm_y);
}
