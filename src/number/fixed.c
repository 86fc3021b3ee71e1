/* number/fixed.c - compile r_mul, r_div and r_sqrt of number/real_ops.h as functions, for
 * fixed-point builds that call them instead of inlining them (TSE_FIXED_CALLS). */
#include "number/real_ops.h"

typedef int tse_fixed_is_inline; /* C allows no empty translation unit */

#if defined(TSE_REAL_FIXED)
#if TSE_FIXED_CALLS

tse_real r_mul(tse_real a, tse_real b) { return fixed_mul_halves(a, b); }
tse_real r_div(tse_real a, tse_real b) { return fixed_div_halves(a, b); }
tse_real r_sqrt(tse_real x) { return fixed_sqrt_digits(x); }

#endif
#endif
