/* model/effects/mass.h - the car weighs m (1 + change); yaw inertia and stiffness in N and N/rad stay.
 * Typical 0.1 .. 0.2: passengers, load, fuel. Only m/I is to be seen while all stiffness is free. */
static inline void mass_constant(tse_config *c) { c->mass += r_mul(c->mass, c->mass_change); }
