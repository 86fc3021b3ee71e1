/* host/self_test.c - tse_self_test(): check the rounding of this build. Harmful compiler
 * options that the preprocessor can see are compile errors in number/real_ops.h. This
 * test detects the others, above all contraction to fused multiply-add. */
#include "tse/tse.h"
#include "number/real_ops.h"

#if defined(TSE_REAL_FIXED)

/* In fixed point there is nothing to test: it uses integers only, and checks at compile
 * time how the compiler treats them. */
static const char *fault(void) { return NULL; }

#else

#if defined(TSE_REAL_FLOAT)
#define EPSILON TSE_R(1.1920928955078125e-7)
#else
#define EPSILON TSE_R(2.220446049250313e-16)
#endif

/* Return NULL if the build rounds correctly. Otherwise return a message: what is rounded
 * wrongly, and which compiler options to use or to avoid. The numbers are volatile, so
 * that the compiler cannot simplify the tests, for example `x - 1 == 0` to `x == 1`. */
static const char *fault(void)
{
  volatile tse_real given[] = { TSE_R(0), TSE_R(1), TSE_R(3), TSE_R(5), TSE_R(7), TSE_R(49), EPSILON,
    TSE_R(23), TSE_R(41) };
  const tse_real zero = given[0], one = given[1], three = given[2], five = given[3], seven = given[4],
                 many = given[5];
  const tse_real e = given[6];
  const tse_real much = TSE_R(0.75) * e, little = TSE_R(0.25) * e, large = r_div(TSE_R(4), e);
  volatile tse_real made[3];
  made[0] = (one + much) - one;
  made[1] = (one + little) - one;
  made[2] = (-one - much) + one;
  if (!(made[0] == e && made[1] == zero && made[2] == -e))
    return "sums have excess precision, or are not rounded to nearest: use -msse2 -mfpmath=sse, or "
           "-fexcess-precision=fast";
  made[0] = -one + (one + e) * (one - e);
  if (!(made[0] == zero)) return "products are not rounded before they are added: use -ffp-contract=off";
  made[0] = (one + large) - large;
  made[1] = one + (large - large);
  if (!(made[0] == zero && made[1] == one))
    return "sums are computed in a different order than written: use neither -ffast-math nor "
           "-fassociative-math";
  const tse_real none = r_div(zero, zero);
  if (none >= zero || none < zero || !r_is_nan(none) || !(r_div(one, zero) > large))
    return "NaN is compared like a number: use neither -ffast-math nor -ffinite-math-only";
  made[0] = r_div(five, many); /* the result differs if it is computed by a rounded reciprocal */
  made[1] = r_div(seven, three);
  made[2] = r_sqrt(five);
  if (!(made[0] == TSE_R(0.10204081632653061224) && made[1] == TSE_R(2.33333333333333333333)
          && made[2] == TSE_R(2.23606797749978969641)))
    return "quotients or roots are not rounded to nearest: use neither -ffast-math nor -mrecip";
  /* several quotients with one divisor, which a compiler may replace by one reciprocal */
  made[0] = r_div(five, many);
  made[1] = r_div(given[7], many);
  made[2] = r_div(given[8], many);
  if (!(made[0] == TSE_R(0.10204081632653061224) && made[1] == TSE_R(0.46938775510204081633)
          && made[2] == TSE_R(0.83673469387755102041)))
    return "quotients are computed by a common reciprocal: use neither -ffast-math nor -freciprocal-math";
  return NULL;
}

#endif

tse_status tse_self_test(const char **wrong)
{
  const char *const found = fault();
  if (found && wrong) *wrong = found;
  return found ? TSE_E_BUILD : TSE_OK;
}
