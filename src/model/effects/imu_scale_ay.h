/* model/effects/imu_scale_ay.h - accel_y (1 + error). Typical 1 .. 5 %. */
static inline void imu_scale_ay_sensor(reading *z) { z->y[1] = r_mul(z->pt->p->car.scale_y, z->y[1]); }
