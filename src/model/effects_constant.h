/* model/effects_constant.h - effects that change settings, in the order of effects.toml,
 * where they have the hook CONSTANT (hook: place in the model at which an effect acts).
 * Only prepare.c includes this file. The functions compute with numbers of type
 * tse_setting. */

/* mass: the mass is m (1 + change). Yaw inertia, and stiffness in N and N/rad, are
 * unchanged. Typical change 0.1 .. 0.2: passengers, load, fuel. The motion depends only
 * on the ratios of stiffness to mass and of mass to yaw inertia. If all stiffnesses are
 * estimated, only the ratio of mass to yaw inertia is therefore observable. */
static inline void mass_constant(tse_config *c) { c->mass += r_mul(c->mass, c->mass_change); }

/* yaw_inertia: the yaw inertia is I (1 + change). Typical change 0.1 .. 0.2. Only the
 * ratio of mass to yaw inertia is observable, as for `mass`. */
static inline void yaw_inertia_constant(tse_config *c)
{
  c->yaw_inertia += r_mul(c->yaw_inertia, c->yaw_inertia_change);
}

/* cg_shift: the centre of gravity moves back by d = distance: lf + d, lr - d. Typical
 * d 0.05 .. 0.15 m. d is limited to 9/10 of lf or lr, so that the centre stays
 * between the axles. */
static inline void cg_shift_constant(tse_config *c)
{
  const tse_setting share = TSE_S(0.9), max = r_mul(share, c->lr), min = -r_mul(share, c->lf);
  const tse_setting above = c->cg_shift_distance < min ? min : c->cg_shift_distance;
  const tse_setting d = above > max ? max : above;
  c->lf += d;
  c->lr -= d;
}

/* wheel_radius: the rolling radius of both axles is R (1 + change). Typical change
 * 0.01 .. 0.025: wear, pressure, tyre size. */
static inline void wheel_radius_constant(tse_config *c)
{
  c->wheel_radius_front += r_mul(c->wheel_radius_front, c->wheel_radius_change);
  c->wheel_radius_rear += r_mul(c->wheel_radius_rear, c->wheel_radius_change);
}

// clang-format off: table constant_effects
#define EFFECTS_CONSTANT(X) X(mass) X(yaw_inertia) X(cg_shift) X(wheel_radius)
// clang-format on: end of table
