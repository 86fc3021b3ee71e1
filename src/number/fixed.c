/* number/fixed.c - functions of number/real_ops.h in builds where a product is a call. */
#include "number/real_ops.h"

typedef int tse_fixed_is_inline; /* C allows no empty file */

#if defined(TSE_REAL_FIXED)
#if TSE_FIXED_CALLS

tse_real r_mul(tse_real a, tse_real b) { return fixed_mul_halves(a, b); }
tse_real r_div(tse_real a, tse_real b) { return fixed_div_halves(a, b); }
tse_real r_sqrt(tse_real x) { return fixed_sqrt_digits(x); }

#endif
#endif
