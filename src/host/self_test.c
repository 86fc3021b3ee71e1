/* host/self_test.c - tse_self_test(): check the rounding of this build. number/real_ops.h
 * makes an error of options that the preprocessor can see. This file detects the others,
 * above all contraction. */
#include "tse/tse.h"
#include "number/real_ops.h"

#if defined(TSE_REAL_FIXED)

static const char *fault(void) { return NULL; } /* integers are checked when they are compiled */

#else

#if defined(TSE_REAL_FLOAT)
#define EPSILON TSE_R(1.1920928955078125e-7)
#else
#define EPSILON TSE_R(2.220446049250313e-16)
#endif

/* Volatile, so that the compiler must compute: it may replace x - 1 == 0 by x == 1. */
static const char *fault(void)
{
  volatile tse_real given[] = { TSE_R(0), TSE_R(1), TSE_R(3), TSE_R(5), TSE_R(7), TSE_R(49), EPSILON,
    TSE_R(23), TSE_R(41) };
  const tse_real zero = given[0], one = given[1], three = given[2], five = given[3], seven = given[4],
                 many = given[5];
  const tse_real e = given[6];
  const tse_real most = TSE_R(0.75) * e, little = TSE_R(0.25) * e, large = r_div(TSE_R(4), e);
  volatile tse_real made[3];
  made[0] = (one + most) - one;
  made[1] = (one + little) - one;
  made[2] = (-one - most) + one;
  if (!(made[0] == e && made[1] == zero && made[2] == -e))
    return "sums are wider than a number, or not rounded to nearest: -msse2 -mfpmath=sse, "
           "-fexcess-precision=fast";
  made[0] = -one + (one + e) * (one - e);
  if (!(made[0] == zero)) return "products are not rounded before they are added: -ffp-contract=off";
  made[0] = (one + large) - large;
  made[1] = one + (large - large);
  if (!(made[0] == zero && made[1] == one))
    return "sums are made in another order than is written: no -ffast-math, no -fassociative-math";
  const tse_real none = r_div(zero, zero);
  if (none >= zero || none < zero || !r_is_nan(none) || !(r_div(one, zero) > large))
    return "what is no number is taken for one: no -ffast-math, no -ffinite-math-only";
  made[0] = r_div(five, many); /* differs if computed by a rounded reciprocal */
  made[1] = r_div(seven, three);
  made[2] = r_sqrt(five);
  if (!(made[0] == TSE_R(0.10204081632653061224) && made[1] == TSE_R(2.33333333333333333333)
          && made[2] == TSE_R(2.23606797749978969641)))
    return "quotients or roots are not rounded to nearest: no -ffast-math, no -mrecip";
  made[0] = r_div(five, many); /* several by one divisor: a shared reciprocal would be tempting */
  made[1] = r_div(given[7], many);
  made[2] = r_div(given[8], many);
  if (!(made[0] == TSE_R(0.10204081632653061224) && made[1] == TSE_R(0.46938775510204081633)
          && made[2] == TSE_R(0.83673469387755102041)))
    return "quotients share a reciprocal: no -ffast-math, no -freciprocal-math";
  return NULL;
}

#endif

tse_status tse_self_test(const char **wrong)
{
  const char *const found = fault();
  if (found && wrong) *wrong = found;
  return found ? TSE_E_BUILD : TSE_OK;
}
