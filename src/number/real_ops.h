/* number/real_ops.h - arithmetic in the number format of the build: r_mul, r_div, r_sqrt,
 * r_exp2 ...
 *
 * The core uses the C operators + - < and unary minus in every format. Every other
 * operation has a function here.
 *
 * double, float   These functions use only + - * /, sqrt and integer operations, so that
 *                 every IEEE machine computes the same bits. Build with -ffp-contract=off
 *                 and without -ffast-math. The code rounds x to an integer by computing
 *                 (x + c) - c, c = 1.5*2^52 in double. -ffast-math would simplify this to
 *                 x. Harmful options that the preprocessor can detect are errors below.
 *                 tse_self_test() detects the others. The functions have no branches, so
 *                 that loops over particles vectorise with -O3 -fno-math-errno
 *                 -fno-trapping-math on a machine that has only SSE2.
 * fixed           Only integers are used: 64 bits, 32 of them fraction (number/fixed.h).
 *                 Up to fifteen results can be added with `+` without overflow.
 *                 r_add_sat() adds numbers of any size and saturates.
 *
 * Guarantees and largest measured errors. Errors are absolute if "relative" is missing.
 * LSB is 2^-32. tests/unit/number/test_real_ops.c tests the errors, and
 * tests/reference/fit_elementary.py computes the coefficients of the polynomials.
 *
 *                  double            float             fixed
 *   r_mul r_div    IEEE              IEEE              nearest, saturates; x/0 = +-max,
 *                                                      0/0 = 0
 *   r_sqrt         IEEE              IEEE              nearest; 0 for x < 0
 *   r_log2         2.7e-14 relative  2.3e-7 relative   2.5e-9
 *   r_exp2         1.5e-14 relative  2.0e-7 relative   0.5 LSB + 1.6e-9 relative
 *   r_sincos_turn  8.4e-14           3.4e-7            3.0e-9
 *   r_atan2        2.7e-14 relative  2.0e-7 relative   1.8e-9
 *
 *   r_log2(x)         x > 0, normal. log2(1) = 0, and integer results are exact. For
 *                     other x see the function.
 *   r_exp2(x)         any finite x, clamped to +-120 (fixed: 0 below -33, the largest
 *                     number from 27 on). Exact for integer x, never infinite. NaN stays
 *                     NaN.
 *   r_sincos_turn     sine and cosine of 2 pi t; t in [0, 1] is in turns. sin(0) =
 *                     sin(1/2) = sin(1) = 0.
 *   r_atan2(y, x)     radians in [-pi, pi], atan2(0, 0) = 0. Called once a step, not in
 *                     loops over particles.
 *   r_uniform(w)      a random word as an exact number in the open interval (0, 1).
 *   r_share(x, n)     x/n, n > 0; in fixed rounded towards zero.
 *   r_single_bits(x)  a setting as the bits of an IEEE single.
 *   r_to_q24(x)       int32 in units of 2^-24, for files: nearest, saturates at +-127.
 *                     NaN gives INT32_MIN.
 *   r_from_q24(n)     the inverse of r_to_q24, nearest. */
#ifndef TSE_REAL_OPS_H
#define TSE_REAL_OPS_H

#include <float.h>
#include <math.h>
#include <stdint.h>
#include <string.h>

#include "number/fixed.h"
#include "tables/names.h"

#if !defined(TSE_REAL_FIXED)
/* FLT_EVAL_METHOD is the type in which the compiler computes sums. 0, 16, 32: the type of
 * the operands; 1, 64: double; 2 and more: a wider type; -1: unknown. */
#if defined(FLT_EVAL_METHOD)
#if !(FLT_EVAL_METHOD == 0 || FLT_EVAL_METHOD == 1 || FLT_EVAL_METHOD == 16 || FLT_EVAL_METHOD == 32 \
    || FLT_EVAL_METHOD == 64)
#error "sums are computed wider than double (x87) and round differently: compile with -msse2 -mfpmath=sse"
#elif defined(TSE_REAL_FLOAT) && (FLT_EVAL_METHOD == 1 || FLT_EVAL_METHOD == 64)
#error "sums of float are computed in double (s390x): compile with -fexcess-precision=fast"
#endif
#endif
#if defined(__FAST_MATH__) || defined(__ASSOCIATIVE_MATH__) || defined(__RECIPROCAL_MATH__) \
    || defined(__NO_SIGNED_ZEROS__) || defined(_M_FP_FAST) \
    || (defined(__FINITE_MATH_ONLY__) && __FINITE_MATH_ONLY__ > 0)
#error "-ffast-math, or an option that it implies, changes results: compile without, with -ffp-contract=off"
#endif
#if defined(__clang__)
#pragma STDC FP_CONTRACT OFF
#elif defined(_MSC_VER)
#pragma fp_contract(off)
#endif /* gcc has no such pragma: tse_self_test() detects contracted products */
#endif

#if defined(TSE_REAL_STRONG) && !defined(TSE_REAL_PLAIN)
/* Nothing here: tests/unit/strong_real.hpp defines tse_real as a class that wraps a
 * double. It includes this file with TSE_REAL_PLAIN for the functions of double. */
#elif !defined(TSE_REAL_FIXED)

/* ------------------------------------------------------------------- double and float */

static inline tse_real r_mul(tse_real a, tse_real b) { return a * b; }
static inline tse_real r_div(tse_real a, tse_real b) { return a / b; }
static inline tse_real r_add_sat(tse_real a, tse_real b) { return a + b; }
static inline tse_real r_from_int(int32_t n) { return (tse_real)n; }
static inline tse_real r_share(tse_real x, int32_t n) { return x / (tse_real)n; }
static inline tse_real r_from_setting(tse_setting x) { return x; }
static inline tse_setting r_to_setting(tse_real x) { return x; }

static inline uint32_t r_single_bits(tse_setting x)
{
  const float single = (float)x;
  uint32_t word;
  memcpy(&word, &single, sizeof word);
  return word;
}

/* Definitions that differ between float and double: layout of the bits, square root, and
 * the polynomial approximations of r_log2, r_exp2, r_sincos_turn and r_atan2. */
#if defined(TSE_REAL_FLOAT)
typedef uint32_t real_bits;
#define REAL_FRACTION 23                /* bits of a significand, without its leading 1 */
#define REAL_BIAS 127u                  /* stored exponent of the number 1 */
#define REAL_MAGNITUDE 0x7fffffffu      /* mask of all bits but the sign */
#define REAL_INFINITY 0x7f800000u
#define REAL_ROOT_HALF 0x00cafb0du      /* r_log2() adds it to the bits of x: the exponent grows by 1,
                                         * or by 2 if the significand is at least sqrt(2) */
#define REAL_MOST_INT 2147483520.0f     /* largest float below 2^31 */
#define REAL_UNIFORM 9                  /* low bits of a random word to drop: the rest + 1/2 has 24 bits */
static inline tse_real r_sqrt(tse_real x) { return sqrtf(x); }
static inline tse_real evaluate_log2_series(tse_real z)
{
  return 2.88539004f + z * (0.961798847f + z * (0.576714396f + z * 0.431735873f));
}
static inline tse_real evaluate_exp2_series(tse_real r)
{
  return 0.693147004f + r * (0.240222424f + r * (0.0555073358f + r * (0.00967149809f + r * 0.00132647553f)));
}
static inline tse_real evaluate_sine_series(tse_real z)
{
  const tse_real p3 = 0.075192228f + z * (0.00686792191f + z * 0.000389815948f); /* terms from z^3 on */
  return 3.14159274f + z * (2.02611947f + z * (0.524037182f + z * p3));
}
static inline tse_real evaluate_cosine_series(tse_real z)
{
  const tse_real q3 = 0.0571990833f + z * (0.00624197442f + z * 0.000399173965f);
  return 1.0f + z * (0.934801161f + z * (0.31949079f + z * q3));
}
static inline tse_real evaluate_atan_series(tse_real z)
{
  return 1.0f + z * (-0.333327979f + z * (0.199744701f + z * (-0.138520882f + z * 0.0798673555f)));
}

#else /* double */
typedef uint64_t real_bits;
#define REAL_FRACTION 52
#define REAL_BIAS 1023u
#define REAL_MAGNITUDE 0x7fffffffffffffffu
#define REAL_INFINITY 0x7ff0000000000000u
#define REAL_ROOT_HALF 0x00195f619980c433u
#define REAL_MOST_INT 2147483647.0
#define REAL_UNIFORM 1 /* low bits of a random word to drop: SSE2 converts only signed integers (31 bits) */
static inline tse_real r_sqrt(tse_real x) { return sqrt(x); }
static inline tse_real evaluate_log2_series(tse_real z)
{
  const tse_real p3 = 0.41220925104433
      + z * (0.31990575530912474 + z * 0.2828992804167811); /* terms from z^3 on */
  return 2.88539008177785 + z * (0.9617966941133057 + z * (0.5770779423769504 + z * p3));
}
static inline tse_real evaluate_exp2_series(tse_real r)
{
  const tse_real p6 = 1.5252989702166316e-05
      + r * (1.325832399017149e-06 + r * 1.0148372120593971e-07); /* terms from r^6 on */
  const tse_real p3 = 0.009618129181074433
      + r * (0.0013333557626443204 + r * (0.00015403440941983887 + r * p6));
  return 0.6931471805598856 + r * (0.24022650695723233 + r * (0.05550410866840444 + r * p3));
}
static inline tse_real evaluate_sine_series(tse_real z)
{
  const tse_real p4 = 0.0069252258278788455
      + z * (0.0004450618605954197 + z * (2.1020491844271662e-05 + z * 6.923677125970025e-07));
  return 3.1415926535882295
      + z * (2.026120126368309 + z * (0.524043911871401 + z * (0.07522060439727324 + z * p4)));
}
static inline tse_real evaluate_cosine_series(tse_real z)
{
  const tse_real q6 = 2.588453671772188e-05
      + z * (1.0594002489588727e-06 + z * 3.047553945987138e-08); /* terms from z^6 on */
  const tse_real q3 = 0.057249471531854196
      + z * (0.006332740904225213 + z * (0.00047591530986587416 + z * q6));
  return 0.9999999999999934 + z * (0.9348022005434381 + z * (0.3195033242022668 + z * q3));
}
static inline tse_real evaluate_atan_series(tse_real z)
{
  const tse_real p6 = 0.07564643175915622
      + z * (-0.05877867766480258 + z * 0.03071132978538272); /* terms from z^6 on */
  const tse_real p3 = -0.1428569090793922 + z * (0.1111039608499545 + z * (-0.09078528868272435 + z * p6));
  return 0.9999999999999744 + z * (-0.3333333333088931 + z * (0.19999999615328912 + z * p3));
}
#endif

#define REAL_ONE ((tse_real)1)
#define REAL_LEAST_INT ((tse_real)-2147483648.0)
#define REAL_WHOLE ((tse_real)((real_bits)1 << REAL_FRACTION)) /* all larger numbers are integers */

static inline real_bits bits_of(tse_real x)
{
  real_bits u;
  memcpy(&u, &x, sizeof u);
  return u;
}

static inline tse_real from_bits(real_bits u)
{
  tse_real x;
  memcpy(&x, &u, sizeof x);
  return x;
}

static inline int r_is_finite(tse_real x) { return (bits_of(x) & REAL_INFINITY) != REAL_INFINITY; }
static inline int r_is_nan(tse_real x) { return (bits_of(x) & REAL_MAGNITUDE) > REAL_INFINITY; }
static inline tse_real r_abs(tse_real x) { return from_bits(bits_of(x) & REAL_MAGNITUDE); }

/* Round down and saturate; NaN gives INT32_MIN. */
static inline int32_t r_floor_to_int(tse_real x)
{
  const tse_real above = x > REAL_LEAST_INT ? x : REAL_LEAST_INT;
  const tse_real inside = above < REAL_MOST_INT ? above : REAL_MOST_INT;
  const int32_t n = (int32_t)inside;
  return n - (inside < (tse_real)n ? 1 : 0);
}

/* Return (k + 1/2) 2^-n, where k is the integer in the upper n = 32 - REAL_UNIFORM bits
 * of the word. The result is exact, and never 0 or 1. */
static inline tse_real r_uniform(uint32_t word)
{
  return ((tse_real)(int32_t)(word >> REAL_UNIFORM) + (tse_real)0.5)
      * (REAL_ONE / (tse_real)((uint32_t)1 << (32 - REAL_UNIFORM)));
}

/* Return log2(x). x is written as 2^k m with sqrt(1/2) <= m < sqrt(2). The result is
 *   k + log2(m),  log2(m) = s P(s^2),  s = (m - 1)/(m + 1),  P is a polynomial.
 * The sign of x is ignored. The logarithm of 0 is -REAL_BIAS. For infinity and NaN the
 * result is REAL_BIAS + 1 or more, as for a very large number. The integer k is converted
 * to a real number without an instruction for 64-bit integers, which SSE2 does not have:
 * k is written into the low bits of REAL_WHOLE (2^52 in double), and REAL_WHOLE is
 * subtracted. */
static inline tse_real r_log2(tse_real x)
{
  const real_bits u = bits_of(x) & REAL_MAGNITUDE,
                  k = (u + REAL_ROOT_HALF) >> REAL_FRACTION; /* exponent + REAL_BIAS + 1 */
  const tse_real m = from_bits(u - (k << REAL_FRACTION) + (((real_bits)REAL_BIAS + 1u) << REAL_FRACTION));
  const tse_real s = (m - REAL_ONE) / (m + REAL_ONE);
  return (from_bits(k | ((real_bits)(REAL_BIAS + REAL_FRACTION) << REAL_FRACTION))
             - (REAL_WHOLE + (tse_real)(REAL_BIAS + 1u)))
      + s * evaluate_log2_series(s * s);
}

/* Return 2^x = 2^k 2^r, x = k + r with |r| <= 1/2, where 2^r = 1 + r P(r), and P is a
 * polynomial. k is found by adding 1.5 REAL_WHOLE to x: this sum is so large that it is
 * rounded to an integer, and its low bits are then k. */
static inline tse_real r_exp2(tse_real x)
{
  const tse_real low = x < -120 ? -120 : x, y = low > 120 ? 120 : low;
  const tse_real rounder = (tse_real)1.5 * REAL_WHOLE, t = y + rounder, r = y - (t - rounder);
  return (REAL_ONE + r * evaluate_exp2_series(r)) * from_bits((bits_of(t) + REAL_BIAS) << REAL_FRACTION);
}

/* Compute sine and cosine of 2 pi t, t in [0, 1]. With v = 2t - 1 they are
 *   sin = -v (1 - v^2) P(-v^2),  cos = -(1 - 4 v^2) Q(-v^2).
 * P and Q are polynomials in -v^2 and not in v^2, because all their coefficients are then
 * positive. Their evaluation therefore has no subtractions. If additions and subtractions
 * alternated, gcc 12 would fuse them with multiplications (FMA) in spite of
 * -ffp-contract=off, and the result would differ in the last bits. */
static inline void r_sincos_turn(tse_real t, tse_real *s, tse_real *c)
{
  const tse_real v = t + t - REAL_ONE, w = v * v;
  *s = v * (w - REAL_ONE) * evaluate_sine_series(-w);
  *c = (4 * w - REAL_ONE) * evaluate_cosine_series(-w);
}

/* Return atan(q), |q| <= tan(pi/8). */
static inline tse_real atan_eighth(tse_real q) { return q * evaluate_atan_series(q * q); }

#define R_PI ((tse_real)3.141592653589793)
#define R_TAN_EIGHTH ((tse_real)0.41421356237309503)

static inline int32_t r_to_q24(tse_real x)
{
  const tse_real most = 127, inside = x < -most ? -most : (most < x ? most : x), y = inside * 16777216;
  const int32_t n = r_floor_to_int(y);
  return n + (y - (tse_real)n >= (tse_real)0.5 ? 1 : 0);
}
static inline tse_real r_from_q24(int32_t n) { return (tse_real)n * (tse_real)(1.0 / 16777216); }

/* Return the angle of the vector (x, y) [rad]. If an argument is NaN, return NaN, except
 * that r_atan2(NaN, 0) is 0. |x| + |y| must not overflow. */
static inline tse_real r_atan2(tse_real y, tse_real x)
{
  const tse_real ax = r_abs(x), ay = r_abs(y);
  const tse_real big = ax < ay ? ay : ax, small = ax < ay ? ax : ay;
  tse_real a;
  if (big == 0) { return 0; }
  if (small > R_TAN_EIGHTH * big) {
    a = R_PI / 4 + atan_eighth((small - big) / (small + big));
  } else {
    a = atan_eighth(small / big);
  }
  if (ax < ay) { a = R_PI / 2 - a; }
  if (x < 0) { a = R_PI - a; }
  return y < 0 ? -a : a;
}
#undef R_PI
#undef R_TAN_EIGHTH

#else /* TSE_REAL_FIXED */

/* ------------------------------------------------------------------------------ fixed */

#if TSE_FIXED_CALLS
#define r_mul  TSE_NAME(tse_fixed_mul)
#define r_div  TSE_NAME(tse_fixed_div)
#define r_sqrt TSE_NAME(tse_fixed_sqrt)
tse_real r_mul(tse_real a, tse_real b);
tse_real r_div(tse_real a, tse_real b);
tse_real r_sqrt(tse_real x);
#else
#if defined(__SIZEOF_INT128__) && !defined(TSE_FIXED_HALVES)
__extension__ typedef __int128 fixed_wide;
static inline tse_real r_mul(tse_real a, tse_real b)
{
  const fixed_wide product = (fixed_wide)a * b;
  const int64_t hi = (int64_t)(product >> 64), most = (int64_t)1 << (FIXED_BITS - 1 - FIXED_ROOM);
  const int64_t x = (int64_t)((product + ((fixed_wide)1 << (FIXED_BITS - 1))) >> FIXED_BITS);
  return hi >= most ? FIXED_MOST : (hi < -most ? -FIXED_MOST : x);
}
#else
static inline tse_real r_mul(tse_real a, tse_real b) { return fixed_mul_halves(a, b); }
#endif
static inline tse_real r_div(tse_real a, tse_real b) { return fixed_div_halves(a, b); }
static inline tse_real r_sqrt(tse_real x) { return fixed_sqrt_digits(x); }
#endif

/* Return x, rounded to an IEEE single (nearest, ties to even), as the bits of this
 * single. The value of a setting has already been rounded to a single by TSE_S(). If its
 * magnitude is at least 2^-8, the fixed-point number x equals this single exactly,
 * because the 24 bits of its significand are multiples of 2^-32. The rounding here then
 * changes nothing. */
static inline uint32_t r_single_bits(tse_setting x)
{
  const uint64_t m = fixed_magnitude(x);
  if (m == 0) return 0;
  const int zeros = fixed_zeros(m);
  const uint64_t left = m << zeros; /* 24 bits of the significand, then 40 to round off */
  const uint32_t digits = (uint32_t)(left >> 40), odd = digits & 1u;
  const uint64_t rest = left & (((uint64_t)1 << 40) - 1), half = (uint64_t)1 << 39;
  const uint32_t up = rest > half || (rest == half && odd) ? 1u : 0u;
  const uint32_t exponent = (uint32_t)(127 + 63 - zeros - FIXED_BITS);
  return (x < 0 ? 0x80000000u : 0u) | ((exponent << 23) + (digits - 0x800000u) + up);
}

/* Return c + p x in Q30 (units of 2^-30): one step of the evaluation of a polynomial. */
static inline int32_t evaluate_q30_step(int32_t c, int32_t p, int32_t x)
{
  return (int32_t)(c + ((fixed_product(p, x) + (1 << 29)) >> 30));
}

static inline tse_real r_from_int(int32_t n) { return fixed_saturate((int64_t)n * FIXED_ONE); }
static inline tse_real r_share(tse_real x, int32_t n) { return x / n; }
static inline tse_real r_from_setting(tse_setting x) { return x; }
static inline tse_setting r_to_setting(tse_real x) { return x; }
static inline int r_is_finite(tse_real x) { return x < FIXED_MOST && x > -FIXED_MOST; }
static inline int r_is_nan(tse_real x) { return x == FIXED_NAN; }
static inline tse_real r_abs(tse_real x) { return x == FIXED_NAN ? INT64_MAX : (x < 0 ? -x : x); }

/* Return the saturated sum of two numbers of any size. */
static inline tse_real r_add_sat(tse_real a, tse_real b)
{
  if (b > 0) return a > FIXED_MOST - b ? FIXED_MOST : fixed_saturate(a + b);
  return a < -FIXED_MOST - b ? -FIXED_MOST : fixed_saturate(a + b);
}

static inline int32_t r_floor_to_int(tse_real x)
{
  const int64_t n = x >> FIXED_BITS;
  return n > INT32_MAX ? INT32_MAX : (n < INT32_MIN ? INT32_MIN : (int32_t)n);
}

/* Return an odd multiple of 2^-32: never 0 or 1. */
static inline tse_real r_uniform(uint32_t word) { return (tse_real)(word | 1u); }

static inline int32_t r_to_q24(tse_real x)
{
  const tse_real most = 127 * FIXED_ONE;
  if (x == FIXED_NAN) return INT32_MIN;
  const tse_real inside = x < -most ? -most : (most < x ? most : x);
  return (int32_t)(((inside >> (FIXED_BITS - 25)) + 1) >> 1);
}
static inline tse_real r_from_q24(int32_t n) { return (tse_real)n * ((tse_real)1 << (FIXED_BITS - 24)); }

/* Return log2(x) = k + log2(1 + f), x = 2^k (1 + f) with sqrt(1/2) <= 1 + f <= sqrt(2),
 * where log2(1 + f) = f P(f), and P is a polynomial. For x <= 0 return the logarithm of
 * the smallest positive number. */
static inline tse_real r_log2(tse_real x)
{
  const uint64_t u = x > 0 ? (uint64_t)x : 1u;
  const int zeros = fixed_zeros(u);
  const uint32_t m = (uint32_t)((u << zeros) >> 32); /* Q31 in [1, 2) */
  const int halve = m > 3037000499u;                 /* sqrt(2) */
  const int32_t k = 63 - FIXED_BITS - zeros + halve;
  const int32_t f = (int32_t)(m >> (1 + halve)) - 1073741824;
  int32_t p = 104075279;
  p = evaluate_q30_step(-184201811, p, f);
  p = evaluate_q30_step(186422404, p, f);
  p = evaluate_q30_step(-191715534, p, f);
  p = evaluate_q30_step(219823290, p, f);
  p = evaluate_q30_step(-258211884, p, f);
  p = evaluate_q30_step(309879893, p, f);
  p = evaluate_q30_step(-387271120, p, f);
  p = evaluate_q30_step(516359561, p, f);
  p = evaluate_q30_step(-774540990, p, f);
  p = evaluate_q30_step(1549082010, p, f);
  return k * FIXED_ONE + ((fixed_product(p, f) + ((int64_t)1 << (59 - FIXED_BITS))) >> (60 - FIXED_BITS));
}

/* Return 2^x = 2^k 2^f, x = k + f with 0 <= f < 1, where 2^f = 1 + f P(f), and P is a
 * polynomial. If the result is too small for the format, return 0. If it is too large,
 * return the largest number. */
static inline tse_real r_exp2(tse_real x)
{
  const int64_t k = x >> FIXED_BITS, part = x - k * FIXED_ONE;
  const int32_t f = (int32_t)(part >> (FIXED_BITS - 30));
  const int up = FIXED_BITS - 30; /* shift from Q30 to the units of the result */
  int32_t p = 23011;
  int64_t y;
  if (k >= 63 - FIXED_ROOM - FIXED_BITS) return FIXED_MOST;
  if (k < -FIXED_BITS - 1) return 0;
  p = evaluate_q30_step(154374, p, f);
  p = evaluate_q30_step(1440856, p, f);
  p = evaluate_q30_step(10323258, p, f);
  p = evaluate_q30_step(59598065, p, f);
  p = evaluate_q30_step(257941138, p, f);
  p = evaluate_q30_step(744261122, p, f);
  y = (int64_t)1073741824 + ((fixed_product(p, f) + (1 << 29)) >> 30); /* Q30 in [1, 2] */
  return k + up >= 0 ? y * ((int64_t)1 << (k + up)) : (y + ((int64_t)1 << (-k - up - 1))) >> (-k - up);
}

/* Compute sine and cosine of 2 pi t. Only the fractional part of t is used. It is written
 * as quarter/4 + x/8, where `quarter` is an integer and |x| <= 1. sin(pi/4 x) = x P(x^2)
 * and cos(pi/4 x) = 1 + x^2 Q(x^2) are computed with the polynomials P and Q. Depending
 * on `quarter` they are then exchanged or change sign. */
static inline void r_sincos_turn(tse_real t, tse_real *s, tse_real *c)
{
  const int64_t turn = t & (FIXED_ONE - 1), quarter = (turn + FIXED_ONE / 8) >> (FIXED_BITS - 2);
  const int64_t off = turn - quarter * (FIXED_ONE / 4); /* from the nearest quarter turn: at most 1/8 turn */
  const int32_t x = (int32_t)(2 * off);
  const int32_t w = evaluate_q30_step(0, x, x);
  int32_t p = 331, q = 3792;
  p = evaluate_q30_step(-39268, p, w);
  p = evaluate_q30_step(2674039, p, w);
  p = evaluate_q30_step(-86699833, p, w);
  p = evaluate_q30_step(843314857, p, w);
  q = evaluate_q30_step(-349978, q, w);
  q = evaluate_q30_step(17023455, q, w);
  q = evaluate_q30_step(-331168968, q, w);
  const int64_t sine = (fixed_product(p, x) + ((int64_t)1 << (59 - FIXED_BITS))) >> (60 - FIXED_BITS);
  const int64_t cosine = FIXED_ONE
      + ((fixed_product(q, w) + ((int64_t)1 << (59 - FIXED_BITS))) >> (60 - FIXED_BITS));
  *s = (quarter & 1) != 0 ? cosine : sine;
  *c = (quarter & 1) != 0 ? sine : cosine;
  if ((quarter & 2) != 0) { *s = -*s; }
  if (((quarter + 1) & 2) != 0) { *c = -*c; }
}

/* Return the angle of the vector (x, y). q is the smaller of |x| and |y| divided by the
 * larger. If q exceeds tan(pi/8), it is replaced by (1 - q)/(1 + q), which is at most
 * tan(pi/8), and atan(q) = pi/4 - atan((1 - q)/(1 + q)) is used. Angles are in Q32 (units
 * of 2^-32 rad). */
static inline tse_real r_atan2(tse_real y, tse_real x)
{
  const uint64_t ax = fixed_magnitude(x), ay = fixed_magnitude(y);
  uint64_t big = ax < ay ? ay : ax, small = ax < ay ? ax : ay;
  if (big == 0) return 0;
  const int zeros = fixed_zeros(big);
  const int shift = zeros < 32 ? 32 - zeros : 0; /* leaves `big` at most 32 bits */
  big >>= shift;
  small >>= shift;
  const int beyond = (small << 30) > 444758319u * big; /* tan(pi/8) */
  uint64_t rest;
  const int32_t quotient = (int32_t)fixed_divide(
                    0, (beyond ? big - small : small) << 30, beyond ? big + small : big, &rest),
                q = beyond ? -quotient : quotient;
  const int32_t w = evaluate_q30_step(0, q, q);
  int32_t p = 50619838;
  p = evaluate_q30_step(-90836426, p, w);
  p = evaluate_q30_step(118553854, p, w);
  p = evaluate_q30_step(-153348062, p, w);
  p = evaluate_q30_step(214747145, p, w);
  p = evaluate_q30_step(-357913928, p, w);
  int64_t a = ((int64_t)1073741824 * q + (int64_t)evaluate_q30_step(0, p, w) * q + ((int64_t)1 << 27)) >> 28;
  if (beyond) { a += 3373259426; }
  if (ax < ay) { a = 6746518852 - a; }
  if (x < 0) { a = 13493037705 - a; }
  return y < 0 ? -a : a;
}

#endif /* format */

/* ------------------------------------------------------------------------ all formats */

/* Return log2(a b c) of positive numbers. In double and float the product a b c must not
 * overflow. */
static inline tse_real r_log2_of_product(tse_real a, tse_real b, tse_real c)
{
#if defined(TSE_REAL_FIXED)
  return r_log2(a) + r_log2(b) + r_log2(c);
#else
  return r_log2(r_mul(a, r_mul(b, c)));
#endif
}

static inline tse_real r_sqr(tse_real x) { return r_mul(x, x); }

/* Return the smaller, or the larger, of two numbers. If one of them is NaN, return b. */
static inline tse_real r_min(tse_real a, tse_real b) { return a < b ? a : b; }
static inline tse_real r_max(tse_real a, tse_real b) { return b < a ? a : b; }

/* Limit x to lo .. hi; NaN stays NaN. */
static inline tse_real r_clamp(tse_real x, tse_real lo, tse_real hi)
{
  const tse_real y = x < lo ? lo : x;
  return hi < y ? hi : y;
}

#endif
