/* model/effects_constant.h - effects on the settings, in the order of effects.toml: scripts/tables.py. */
/* table: constant_effects */
#include "model/effects/mass.h"
#include "model/effects/yaw_inertia.h"
#include "model/effects/cg_shift.h"
#include "model/effects/wheel_radius.h"
#define EFFECTS_CONSTANT(X) X(mass) X(yaw_inertia) X(cg_shift) X(wheel_radius)
/* end of table */
