/* model/effects/imu_misalignment.h - the IMU is turned to the left by `angle`: ax cos + ay sin, ay cos - ax sin.
 * Typical 1 .. 3 degrees. */
static inline void imu_misalignment_sensor(const tse_effects *e, tse_effect_memory *m, const point *pt, tse_real dt, tse_real y[3])
{
  const tse_real x = y[0], side = y[1];
  tse_real sine, cosine;
  (void)m;
  (void)pt;
  (void)dt;
  effects_sincos(e->imu_misalignment_angle, &sine, &cosine);
  y[0] = r_mul(x, cosine) + r_mul(side, sine);
  y[1] = r_mul(side, cosine) - r_mul(x, sine);
}
