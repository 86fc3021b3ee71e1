/* model/effects/imu_scale_ay.h - accel_y (1 + error). Typical 1 .. 5 %. */
static inline void imu_scale_ay_sensor(const tse_effects *e, tse_effect_memory *m, const point *pt, tse_real dt, tse_real y[3])
{
  (void)m;
  (void)pt;
  (void)dt;
  y[1] += r_mul(e->imu_scale_ay_error, y[1]);
}
