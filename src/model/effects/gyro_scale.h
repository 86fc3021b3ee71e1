/* model/effects/gyro_scale.h - yaw_rate (1 + error). Typical 1 .. 3 %. */
static inline void gyro_scale_sensor(reading *z) { z->y[2] = r_mul(z->pt->p->car.scale_r, z->y[2]); }
