/* model/effects/imu_misalignment.h - the IMU is turned to the left by `angle`: ax cos + ay sin, ay cos - ax sin.
 * Typical 1 .. 3 degrees. */
static inline void imu_misalignment_sensor(reading *z)
{
  const planar read = turn_axes(z->y[0], z->y[1], z->pt->p->car.mount_sin, z->pt->p->car.mount_cos);
  z->y[0] = read.x;
  z->y[1] = read.y;
}
