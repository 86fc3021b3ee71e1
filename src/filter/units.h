/* filter/units.h - units and limits of the states. Internal. */
#ifndef TSE_FILTER_UNITS_H
#define TSE_FILTER_UNITS_H

#include "filter/types.h"

/* Unit of each state in the covariance. In these units the elements of the covariance are
 * of order one, so that every number format resolves them. */
extern const tse_real state_unit[TSE_VALUES + TSE_EXTRAS];

/* Max magnitude of each state, SI. */
extern const tse_real state_max[TSE_VALUES + TSE_EXTRAS];

#endif
