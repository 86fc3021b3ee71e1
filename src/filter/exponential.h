/* filter/exponential.h - exponential function. Internal. */
#ifndef TSE_FILTER_EXPONENTIAL_H
#define TSE_FILTER_EXPONENTIAL_H

#include "filter/types.h"

/* Return e^x. */
tse_real compute_exponential(tse_real x);

/* Return exp(-dt/time): the factor by which a state with the time constant
 * `time` decays during dt. */
tse_real compute_decay(tse_real dt, tse_real time);

#endif
