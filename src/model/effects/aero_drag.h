/* model/effects/aero_drag.h - m vx' - kd vx |vx|. Typical kd = 1/2 rho cd A: 0.35 .. 0.45 kg/m. */
static inline void aero_drag_body(point *pt) { pt->force.x = pt->force.x - drag_of(pt->p->car.drag, pt->vx); }
