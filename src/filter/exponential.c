/* filter/exponential.c - exponential functions that are called instead of inlined: each
 * inlined copy takes 150 bytes of flash. */
#include "filter/exponential.h"

tse_real compute_exponential(tse_real x) { return exponential(x); }

tse_real compute_decay(tse_real dt, tse_real time) { return left_of(dt, time); }
