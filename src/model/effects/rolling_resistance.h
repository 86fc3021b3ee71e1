/* model/effects/rolling_resistance.h - m vx' - f m g against the motion, rising linearly below 0.5 m/s.
 * Typical f 0.008 .. 0.015. */
static inline void rolling_resistance_body(point *pt) { pt->force.x = pt->force.x - rolling_of(pt->p->car.rolling, pt->vx); }
