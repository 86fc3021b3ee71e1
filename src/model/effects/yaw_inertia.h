/* model/effects/yaw_inertia.h - the yaw inertia is I (1 + change). Typical 0.1 .. 0.2; see mass.h. */
static inline void yaw_inertia_constant(tse_config *c) { c->yaw_inertia += r_mul(c->yaw_inertia, c->yaw_inertia_change); }
