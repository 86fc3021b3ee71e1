/* model/effects/grade.h - vx' - g sin(angle + profile): accelerates the car, but no accelerometer.
 * Typical 1 .. 6 %, uphill > 0. */
static inline void grade_body(point *pt) { pt->gravity_x = -gravity_along(pt->p->effects.grade_angle + pt->g.grade); }
