/* model/effects/imu_delay.h - y(t - time), linear between rows. Typical 10 .. 30 ms. */
static inline void imu_delay_sensor(reading *z)
{
  const tse_real time = z->pt->p->effects.imu_delay_time;
  effects_delay_put(&z->m->imu, z->m->imu_was, time, z->dt, z->y, 3);
  for (int i = 0; i < 3; i++) z->y[i] = effects_delay_get(&z->m->imu, z->m->imu_was[i], time);
}
