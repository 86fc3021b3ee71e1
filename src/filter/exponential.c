/* filter/exponential.c - exponentials out of line: each inlined one takes 150 bytes of
 * flash. */
#include "filter/filter.h"

tse_real compute_exponential(tse_real x) { return exponential(x); }

tse_real compute_decay(tse_real dt, tse_real time) { return left_of(dt, time); }
