/* model/effects/imu_scale_ax.h - accel_x (1 + error). Typical 1 .. 5 %. */
static inline void imu_scale_ax_sensor(const tse_effects *e, tse_effect_memory *m, const point *pt, tse_real dt, tse_real y[3])
{
  (void)m;
  (void)pt;
  (void)dt;
  y[0] += r_mul(e->imu_scale_ax_error, y[0]);
}
