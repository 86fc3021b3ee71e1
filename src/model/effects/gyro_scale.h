/* model/effects/gyro_scale.h - yaw_rate (1 + error). Typical 1 .. 3 %. */
static inline void gyro_scale_sensor(const tse_effects *e, tse_effect_memory *m, const point *pt, tse_real dt, tse_real y[3])
{
  (void)m;
  (void)pt;
  (void)dt;
  y[2] += r_mul(e->gyro_scale_error, y[2]);
}
