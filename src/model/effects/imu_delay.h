/* model/effects/imu_delay.h - y(t - time), linear between rows. Typical 10 .. 30 ms. */
static inline void imu_delay_sensor(const tse_effects *e, tse_effect_memory *m, const point *pt, tse_real dt, tse_real y[3])
{
  (void)pt;
  effects_delay_put(&m->imu, m->imu_was, e->imu_delay_time, dt, y, 3);
  for (int i = 0; i < 3; i++) y[i] = effects_delay_get(&m->imu, m->imu_was[i], e->imu_delay_time);
}
