/* filter/units.c - units and limits of the states, from their table in model/car.h. */
#include "filter/units.h"

#define STATE_UNIT(name, unit, max) TSE_R(unit),
#define STATE_MAX(name, unit, max) TSE_R(max),
#if defined(TSE_NO_VELOCITY)
const tse_real state_unit[TSE_VALUES + TSE_EXTRAS] = { STATE_ROWS(STATE_UNIT) };
const tse_real state_max[TSE_VALUES + TSE_EXTRAS] = { STATE_ROWS(STATE_MAX) };
#else
const tse_real state_unit[TSE_VALUES + TSE_EXTRAS] = { STATE_ROWS(STATE_UNIT) EXTRA_ROWS(STATE_UNIT) };
const tse_real state_max[TSE_VALUES + TSE_EXTRAS] = { STATE_ROWS(STATE_MAX) EXTRA_ROWS(STATE_MAX) };
#endif
