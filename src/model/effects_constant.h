/* model/effects_constant.h - effects on the settings, in the order of tse/effects.def.
 * Written by cmake/effects.cmake, not by hand. */
#include "model/effects/mass.h"
#include "model/effects/yaw_inertia.h"
#include "model/effects/cg_shift.h"
#include "model/effects/wheel_radius.h"
#define EFFECTS_CONSTANT(X) X(mass) X(yaw_inertia) X(cg_shift) X(wheel_radius)
