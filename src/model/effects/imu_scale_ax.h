/* model/effects/imu_scale_ax.h - accel_x (1 + error). Typical 1 .. 5 %. */
static inline void imu_scale_ax_sensor(reading *z) { z->y[0] = r_mul(z->pt->p->car.scale_x, z->y[0]); }
