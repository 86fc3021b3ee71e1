/* number/vector.h - rows (vectors) of numbers, and sums of their products. Nearly all
 * products of the filter are computed here. An element of a row has the type tse_short. A
 * number that multiplies all elements of a row is called a factor.
 *
 * double, float: tse_short and factor are the type tse_real, and every function is a
 * simple loop. The terms of a sum are added in the order of their index.
 *
 * fixed: a tse_short is an int32_t in units of 2^-SHORT_BITS, saturated at +-MAX_SHORT. A
 * factor is a mantissa of 31 bits and a shift, computed once for each row (r_factor). The
 * product of a factor and an element is a product of 32 x 32 bits, rounded once to
 * nearest. Sums of products are exact in 64 bits and rounded once. One of the two rows of
 * such a sum is scaled by a power of two that depends on its largest element (r_row,
 * r_sparse), so that the products use most of the 64 bits. Quotients with the same
 * divisor share the reciprocal of this divisor (r_divisor). The relative error of such a
 * quotient is at most 2^-29.
 *
 * The elements of a "scaled" row are multiplied by a power of two before they are stored.
 * A factor can contain a power 2^up, which corrects for this scale. In double and float
 * no row is scaled, and `up` is ignored.
 *   r_short r_long           convert to a tse_short (nearest, saturated) and back
 *   r_mul_short(a, b)        r_mul() of two tse_short
 *   r_factor(x, up)          the factor x 2^up
 *   r_quotient(x, d, up)     the factor x/d 2^up
 *   r_short_scaled(x, up)    x 2^up as an element of a scaled row
 *   r_short_of(a, x, up)     the same number, computed from a = r_factor(x, up), for
 *                            callers that need this factor anyway
 *   r_by(x, d)               x/d
 *   r_left(x, was, more, d)  x * was/d, where d = was + more; all arguments >= 0
 *   r_plus_times(y, a, x)    y + a x; x and y are elements of rows, a is a factor */
#ifndef TSE_VECTOR_H
#define TSE_VECTOR_H

#include "number/real_ops.h"
#if defined(TSE_REAL_FIXED) && defined(__ARM_FEATURE_SAT) && defined(__GNUC__) && !defined(__clang__)
#include <arm_acle.h>
#endif

/* `rows` rows are to be multiplied by one common row. R_TOGETHER(rows), a divisor of
 * `rows`, is the number of them that one loop multiplies. On a core without vector
 * instructions, this loop is faster than one loop for each row, because it loads each
 * element of the common row only once. */
#if defined(__thumb__) && defined(__OPTIMIZE__) && !defined(__OPTIMIZE_SIZE__) && !defined(TSE_REAL_FIXED)
#define R_TOGETHER(rows) ((rows) % 5 == 0 ? 5 : (rows) % 3 == 0 ? 3 : (rows) % 2 == 0 ? 2 : 1)
#else
#define R_TOGETHER(rows) 1
#endif

#define MAX_ROW 32 /* max number of elements of a row */
#define ROW_UP 4 /* elements of the transition matrix of the motion are stored multiplied by 2^ROW_UP */

/* The `count` nonzero elements of a row: m[i] is the element with index at[i]. In
 * fixed-point builds the value of this element is m[i] 2^-(right + FIXED_BITS). */
typedef struct r_sparse {
  tse_short m[MAX_ROW];
  int32_t count, right;
  uint8_t at[MAX_ROW];
} r_sparse;

/* A row whose elements are stored multiplied by 2^-up: m[i] = 2^-up times element i. To
 * multiply the row by x, multiply m by r_factor(x, up), which contains the factor
 * 2^up. */
typedef struct r_scaled {
  const tse_short *m;
  int32_t up;
} r_scaled;

#if !defined(TSE_REAL_FIXED)

/* ------------------------------------------------------------------- double and float */

typedef tse_real r_divided;
typedef tse_real r_factored;

static inline tse_short r_short(tse_real x) { return x; }
static inline tse_real r_long(tse_short x) { return x; }
static inline tse_real r_mul_short(tse_short a, tse_short b) { return r_mul(a, b); }
static inline r_factored r_factor(tse_real x, int up) { return (void)up, x; }
static inline r_divided r_divisor(tse_real d) { return d; }
static inline tse_real r_by(tse_real x, r_divided d) { return r_div(x, d); }
static inline r_factored r_quotient(tse_real x, r_divided d, int up) { return (void)up, r_div(x, d); }
static inline tse_real r_left(tse_real x, tse_real was, tse_real more, r_divided d)
{
  return (void)more, r_mul(x, r_div(was, d));
}

/* Scale rows by a power of two. In double and float nothing is scaled:
 * `up` is 0 and ignored. */
static inline int r_scale_of(const tse_real *x, int n, int max) { return (void)x, (void)n, (void)max, 0; }
static inline int r_scale_of_variance(tse_real x) { return (void)x, 0; }
static inline tse_short r_short_scaled(tse_real x, int up) { return (void)up, x; }
static inline tse_short r_short_of(r_factored a, tse_real x, int up) { return (void)a, (void)up, x; }
static inline tse_real r_long_scaled(tse_short x, int up) { return (void)up, x; }
static inline tse_real r_times(tse_short x, r_factored a) { return r_mul(x, a); }

/* Return whether an element of the row is close to saturation: whether its magnitude
 * exceeds 15/16 of the limit at which elements saturate. In double and float elements do
 * not saturate, and the result is 0. */
static inline int r_near_end(const tse_short *x, int n) { return (void)x, (void)n, 0; }

/* Elements of a transition matrix ("slopes"), and their products with rows. The
 * covariance is stored in units of the states (state_unit). Slopes are therefore
 * converted from SI units: row i is divided by the unit of state i, and column j is
 * multiplied by the unit of state j.
 *   r_slope_in_units  slope x, converted, and limited to +-max. `to` is r_unit() of the
 *                     unit of column j, and `over` is r_over_unit() of the unit of row i
 *   r_short_over      the same for the column of a consider parameter (an uncertain
 *                     parameter that is not estimated). It is not a state and has no
 *                     such unit: x is only divided by the unit of row i
 *   r_slope_sums      product of the matrix and `together` vectors x[b]:
 *                     to[i*together + b] += sum of slope[i*stride + j] * x[b][j], j < n,
 *                     for i < rows and b < together */
static inline tse_short r_slope(tse_real x) { return x; }
static inline r_factored r_unit(tse_real unit) { return unit; }
static inline r_factored r_over_unit(tse_real unit) { return r_div(TSE_R(1), unit); }
static inline tse_short r_slope_in_units(tse_short x, r_factored to, r_factored over, tse_real max)
{
  return r_clamp(r_mul(r_mul(x, to), over), -max, max);
}
static inline tse_short r_short_over(tse_short x, r_factored over, tse_real max)
{
  return r_clamp(r_mul(x, over), -max, max);
}
static inline void r_slope_sums(
    tse_short *to, int rows, const tse_short *slope, int stride, tse_short *const *x, int together, int n)
{
  for (int j = 0; j < n; j++) /* element by element: the sums stay in registers */
    for (int i = 0; i < rows; i++)
      for (int b = 0; b < together; b++) to[i * together + b] += r_mul(slope[i * stride + j], x[b][j]);
}

/* Convert the row x, and return it as the argument `row` of r_sum(). In fixed-point
 * builds the elements become mantissas of 27 bits with a common shift. In double and
 * float the result is x itself, and the shift is 0.
 *   Given:     room    memory for the converted row
 *   Returned:  *right  shift, the argument `right` of r_sum() */
static inline const tse_short *r_row(const tse_real *x, int n, tse_short *room, int32_t *right)
{
  return (void)n, (void)room, *right = 0, x;
}
static inline tse_real r_sum(tse_real from, const tse_short *x, const tse_short *row, int32_t right, int n)
{
  (void)right;
  for (int i = 0; i < n; i++) from += r_mul(row[i], x[i]);
  return from;
}

static inline r_scaled r_scaled_of(const tse_real *x, int n, tse_short *room)
{
  const r_scaled s = { x, 0 };
  return (void)n, (void)room, s;
}

static inline void r_sparse_of(const tse_real *x, int n, r_sparse *s)
{
  s->count = s->right = 0;
  for (int i = 0; i < n; i++)
    if (x[i] != TSE_R(0)) {
      s->m[s->count] = x[i];
      s->at[s->count++] = (uint8_t)i;
    }
}

static inline tse_real r_sum_sparse(tse_real from, const tse_short *x, const r_sparse *s, int count)
{
  for (int i = 0; i < count; i++) from += r_mul(s->m[i], x[s->at[i]]);
  return from;
}

typedef tse_real r_dot;
static inline r_dot r_dot_start(tse_real from) { return from; }
static inline r_dot r_dot_plus(r_dot sum, tse_short a, tse_short x) { return sum + r_mul(a, x); }
static inline tse_real r_dot_end(tse_real from, r_dot sum, int32_t right)
{
  return (void)from, (void)right, sum;
}

/* Sums of products that car.c forms term by term: r_start() or r_product(), then r_plus()
 * and r_minus(), at the end r_end() or r_end_rate(). The fixed-point version below
 * explains the units. */
typedef tse_real r_coefficient;
typedef tse_real r_total;
static inline r_coefficient r_coef(tse_real x) { return x; }
static inline r_total r_start(tse_short x) { return x; }
static inline r_total r_product(r_coefficient a, tse_short x) { return r_mul(a, x); }
static inline r_total r_plus(r_total s, r_coefficient a, tse_short x) { return s + r_mul(a, x); }
static inline r_total r_minus(r_total s, r_coefficient a, tse_short x) { return s - r_mul(a, x); }
static inline tse_short r_end(r_total s) { return s; }
static inline tse_short r_end_rate(r_total s) { return s; }
static inline tse_short r_plus_times(tse_short y, r_factored a, tse_short x) { return y + r_mul(a, x); }
static inline tse_short r_short_sum(tse_short x, tse_short y) { return x + y; }

#else /* TSE_REAL_FIXED */

/* ------------------------------------------------------------------------------ fixed */

#define SHORT_BITS 22
#define COEF_BITS 20
#define MAX_SHORT ((int32_t)1 << 30) /* [2^-SHORT_BITS] a tse_short is at least -256 and below 256 */

/* A factor by which rows of tse_short are multiplied: m 2^-(32 + right). */
typedef struct r_factored {
  int32_t m, right;
} r_factored;

/* Reciprocal of a divisor d: 1/d = m 2^-(30 + right), m up to 2^31 - 1. */
typedef struct r_divided {
  int32_t m, right;
} r_divided;

/* Limit x to the range of a signed integer of `bits` bits. Some cores have an instruction
 * for this. */
#if defined(__ARM_FEATURE_SAT) && defined(__GNUC__) && !defined(__clang__)
#define FIXED_WITHIN(x, bits) __ssat(x, bits)
#else
#define FIXED_WITHIN(x, bits) saturate_to(x, (int32_t)1 << ((bits) - 1))
static inline int32_t saturate_to(int32_t x, int32_t max)
{
  return x > max - 1 ? max - 1 : (x < -max ? -max : x);
}
#endif

static inline int32_t saturate_short(int32_t x) { return FIXED_WITHIN(x, 31); }

/* Return x 2^-right, rounded to nearest and saturated; |x| up to 2^62. */
static inline int64_t fixed_shifted(int64_t x, int right)
{
  if (right > 0) return right > 62 ? 0 : fixed_saturate(((x >> (right - 1)) + 1) >> 1);
  const int left = right < -59 ? 59 : -right;
  const int64_t max = FIXED_MOST >> left;
  return x > max ? FIXED_MOST : (x < -max ? -FIXED_MOST : x * ((int64_t)1 << left));
}

/* Macros FIXED_NARROW_TO and FIXED_NARROW: return x 2^-right, rounded to nearest and
 * saturated. FIXED_NARROW_TO saturates to the given number of bits, FIXED_NARROW to the
 * bits of a tse_short. |x| must be at most 2^62. Saturation is applied to the upper 32
 * bits of the rounded x only, which takes less time. A saturated result may therefore
 * differ from the limit in its lowest bits. The macros use the two functions that
 * follow. */
static inline uint64_t fixed_half_up(int64_t x, int right)
{
  return (uint64_t)x + ((uint64_t)1 << (right - 1));
}
static inline int32_t fixed_joined(int32_t high, uint32_t low, int right)
{
  return (int32_t)(((uint32_t)high << (32 - right)) | (low >> right));
}
#define FIXED_HIGH_WORD(x, right) ((int32_t)(uint32_t)(fixed_half_up(x, right) >> 32))
#define FIXED_NARROW_TO(x, right, bits) \
  fixed_joined(FIXED_WITHIN(FIXED_HIGH_WORD(x, right), (bits) + (right) - 32), \
      (uint32_t)fixed_half_up(x, right), right)
#define FIXED_NARROW(x, right) FIXED_NARROW_TO(x, right, 31)

/* Count the leading zeros of the magnitude of a number: fixed_zeros_of(fixed_bits_of(x))
 * is 1 .. 63. The OR of fixed_bits_of() of several numbers gives the leading zeros that
 * all of them have. */
static inline int64_t fixed_bits_of(int64_t x) { return x < 0 ? ~x : x; }
static inline int fixed_zeros_of(int64_t bits) { return fixed_zeros((uint64_t)bits | 1u); }

/* Return the 31 binary digits of x that follow `zeros` leading zeros, with the sign of x.
 * x must have that many leading zeros. */
static inline int32_t fixed_mantissa(int64_t x, int zeros)
{
  return (int32_t)(uint32_t)(((uint64_t)x << (zeros - 1)) >> 32);
}

static inline tse_short r_short_scaled(tse_real x, int up)
{
  const int64_t y = fixed_shifted(x, FIXED_BITS - SHORT_BITS - up);
  return y > MAX_SHORT - 1 ? MAX_SHORT - 1 : (y < -MAX_SHORT ? -MAX_SHORT : (int32_t)y);
}
static inline tse_short r_short(tse_real x) { return FIXED_NARROW(x, FIXED_BITS - SHORT_BITS); }
static inline int r_near_end(const tse_short *x, int n)
{
  uint32_t bits = 0;
  for (int i = 0; i < n; i++) bits |= (uint32_t)(x[i] ^ (x[i] >> 31)) + MAX_SHORT / 16;
  return bits >= (uint32_t)MAX_SHORT;
}
static inline tse_real r_long_scaled(tse_short x, int up)
{
  return fixed_shifted(x, SHORT_BITS - FIXED_BITS + up);
}
static inline tse_real r_long(tse_short x)
{
  return (tse_real)x * ((tse_real)1 << (FIXED_BITS - SHORT_BITS));
}
static inline tse_real r_mul_short(tse_short a, tse_short b)
{
  return (fixed_product(a, b) + (1 << (2 * SHORT_BITS - FIXED_BITS - 1))) >> (2 * SHORT_BITS - FIXED_BITS);
}

static inline r_factored limit_factor(int32_t m, int right)
{
  const r_factored none = { 0, 0 }, a = { m, right < -30 ? -30 : right };
  return right > 30 ? none : a;
}

static inline r_factored r_factor(tse_real x, int up)
{
  const int zeros = fixed_zeros_of(fixed_bits_of(x));
  return limit_factor(fixed_mantissa(x, zeros), FIXED_BITS + zeros - 65 - up);
}

static inline r_divided r_divisor(tse_real d)
{
  r_divided over = { INT32_MAX, -FIXED_BITS }; /* for d <= 0: 2^33 = 1/(half of the smallest number) */
  if (d <= 0) return over;
  const int zeros = fixed_zeros((uint64_t)d);
  const uint32_t reciprocal = fixed_divide_word(
      (uint32_t)1 << 30, 0, (uint32_t)(((uint64_t)d << zeros) >> 32)); /* 2^62 over the upper 32 bits of d */
  over.m = reciprocal > INT32_MAX ? INT32_MAX : (int32_t)reciprocal;
  over.right = 64 - zeros - FIXED_BITS;
  return over;
}

static inline tse_real r_by(tse_real x, r_divided d)
{
  const int zeros = fixed_zeros_of(fixed_bits_of(x));
  const int64_t product = fixed_product(fixed_mantissa(x, zeros), d.m);
  return fixed_shifted(product, 30 + d.right + zeros - 33);
}

static inline r_factored r_quotient(tse_real x, r_divided d, int up)
{
  const int zeros = fixed_zeros_of(fixed_bits_of(x));
  const int64_t product = fixed_product(fixed_mantissa(x, zeros), d.m); /* magnitude 2^60 .. 2^62 */
  return limit_factor(
      (int32_t)((product + ((int64_t)1 << 30)) >> 31), FIXED_BITS + d.right + zeros - 66 - up);
}

/* Compute x * was/d as x - x * more/d, where d = was + more. Only the subtracted term is
 * rounded. It is exactly 0 if `more` is 0, so that x does not change then. The quotient
 * more/d has 32 binary digits, and both halves of x are multiplied by it. */
static inline tse_real r_left(tse_real x, tse_real was, tse_real more, r_divided d)
{
  const int zeros = 64 - FIXED_BITS - d.right; /* of d */
  const uint32_t digits = (uint32_t)(((uint64_t)more << (zeros - 1)) >> 32),
                 share = (uint32_t)(fixed_product_unsigned(digits, (uint32_t)d.m) >> 29); /* below 1 */
  const uint64_t low = fixed_product_unsigned((uint32_t)x, share) + 0x80000000u;
  return (void)was,
         x - (tse_real)(fixed_product_unsigned((uint32_t)((uint64_t)x >> 32), share) + (low >> 32));
}

/* Return the shift by which a row is scaled. The shift of r_scale_of() brings the largest
 * magnitude of n numbers to 2 .. 4, but is at most `max`. The shift of
 * r_scale_of_variance() brings the square root of a variance to 5.6 .. 11.4. A tse_short
 * saturates only at 256, so that elements of the row can grow. */
static inline int r_scale_of(const tse_real *x, int n, int max)
{
  int64_t bits = 0;
  for (int i = 0; i < n; i++) bits |= fixed_bits_of(x[i]);
  const int up = fixed_zeros_of(bits) - 64 + FIXED_BITS + 2;
  return up < max ? up : max;
}
static inline int r_scale_of_variance(tse_real x)
{
  const int log2 = 64 - fixed_zeros_of(x) - FIXED_BITS;
  return 3 - (log2 >> 1);
}

static inline tse_short r_short_of(r_factored a, tse_real x, int up)
{
  const int right = 32 - SHORT_BITS + a.right;
  if (right <= 0) return r_short_scaled(x, up);
  return right > 31 ? 0 : ((a.m >> (right - 1)) + 1) >> 1;
}

/* Return a x. If x is an element of a row stored times 2^-up, a must contain 2^up. */
static inline tse_real r_times(tse_short x, r_factored a)
{
  return fixed_shifted(fixed_product(x, a.m), 32 + a.right + SHORT_BITS - FIXED_BITS);
}

/* Convert the row to mantissas m of `digits` binary digits with a common shift, which is
 * chosen for the largest element.
 *   Returned:  the shift `right`: element i has the value m[i] 2^-(right + FIXED_BITS) */
static inline int32_t write_mantissas(const tse_real *x, int n, tse_short *m, int digits)
{
  int64_t bits = 0;
  for (int i = 0; i < n; i++) bits |= fixed_bits_of(x[i]);
  const int zeros = fixed_zeros_of(bits);
  for (int i = 0; i < n; i++) m[i] = fixed_mantissa(x[i], zeros) >> (31 - digits);
  return zeros + digits - 64;
}

static inline const tse_short *r_row(const tse_real *x, int n, tse_short *room, int32_t *right)
{
  *right = write_mantissas(x, n, room, 27);
  return room;
}

static inline r_scaled r_scaled_of(const tse_real *x, int n, tse_short *room)
{
  const int32_t right = write_mantissas(x, n, room, 30);
  const r_scaled s = { room, SHORT_BITS - FIXED_BITS - right };
  return s;
}

/* Return the sum of n products. n must be at most 32, and each product below 2^57. */
static inline int64_t fixed_sum(const tse_short *a, const tse_short *b, int n)
{
  int64_t sum = 0;
  int i = 0;
  for (; i + 4 <= n; i += 4)
    sum += fixed_product(a[i], b[i]) + fixed_product(a[i + 1], b[i + 1]) + fixed_product(a[i + 2], b[i + 2])
        + fixed_product(a[i + 3], b[i + 3]);
  for (; i < n; i++) sum += fixed_product(a[i], b[i]);
  return sum;
}
static inline tse_real r_sum(tse_real from, const tse_short *x, const tse_short *row, int32_t right, int n)
{
  return from + fixed_shifted(fixed_sum(row, x, n), SHORT_BITS + right);
}

static inline void r_sparse_of(const tse_real *x, int n, r_sparse *s)
{
  int64_t bits = 0;
  s->count = 0;
  for (int i = 0; i < n; i++)
    if (x[i] != 0) {
      bits |= fixed_bits_of(x[i]);
      s->at[s->count++] = (uint8_t)i;
    }
  const int zeros = fixed_zeros_of(bits);
  for (int i = 0; i < s->count; i++) s->m[i] = fixed_mantissa(x[s->at[i]], zeros) >> 4;
  s->right = zeros + 27 - 64;
}

static inline tse_real r_sum_sparse(tse_real from, const tse_short *x, const r_sparse *s, int count)
{
  int64_t sum = 0;
  for (int i = 0; i < count; i++) sum += fixed_product(s->m[i], x[s->at[i]]);
  return from + fixed_shifted(sum, SHORT_BITS + s->right);
}

typedef int64_t r_dot;
static inline r_dot r_dot_start(tse_real from) { return (void)from, 0; }
static inline r_dot r_dot_plus(r_dot sum, tse_short a, tse_short x) { return sum + fixed_product(a, x); }
static inline tse_real r_dot_end(tse_real from, r_dot sum, int32_t right)
{
  return from + fixed_shifted(sum, SHORT_BITS + right);
}

/* Convert a factor whose magnitude is below 1/2 to an integer in units of 2^-32. Bits of
 * its mantissa below 2^-32 are lost. The product with a tse_short changes by at most 1/8
 * of 2^-SHORT_BITS. */
static inline int32_t convert_small_factor(r_factored a)
{
  return a.right > 0 ? ((a.m >> (a.right - 1)) + 1) >> 1 : a.m;
}

/* Return y + m x/2^32, rounded to nearest and saturated. */
static inline int32_t add_to_short(int32_t y, int32_t x, int32_t m)
{
  return saturate_short((int32_t)((uint32_t)y + (uint32_t)fixed_product_upper(x, m)));
}

static inline tse_short r_plus_times(tse_short y, r_factored a, tse_short x)
{
  if (a.right >= 0) return add_to_short(y, x, convert_small_factor(a));
  const int32_t product = fixed_product_upper(x, a.m), max = MAX_SHORT >> -a.right;
  const int32_t more = product > max
      ? MAX_SHORT - 1
      : (product < -max ? -MAX_SHORT : (int32_t)((uint32_t)product << -a.right));
  return saturate_short(y + more);
}

/* Elements of a transition matrix (slopes) are in units of 2^-SLOPE_BITS. Their magnitude
 * is below 16, so that the sum of 32 products with a row is below 2^62 and fits an
 * int64_t. r_unit() returns unit/2, and r_over_unit() 2^-9/unit. Both must be below 1/2
 * (convert_small_factor()). They are, because the unit of a state is below 1, and
 * r_over_unit() is called only for units of the states of the motion, which are above
 * 2^-8. */
#define SLOPE_BITS 23
#define SLOPE_ALL (SLOPE_BITS + 5) /* number of bits of a slope, including integer part and sign */
static inline tse_short r_slope(tse_real x) { return FIXED_NARROW_TO(x, FIXED_BITS - SLOPE_BITS, SLOPE_ALL); }
static inline r_factored r_unit(tse_real unit)
{
  const r_factored half = { convert_small_factor(r_factor(unit, -1)), 0 };
  return half;
}
static inline r_factored r_over_unit(tse_real unit)
{
  const r_factored part = { convert_small_factor(r_quotient(FIXED_ONE, r_divisor(unit), -9)), 0 };
  return part;
}

static inline tse_short r_slope_in_units(tse_short x, r_factored to, r_factored over, tse_real max)
{
  const int32_t moved = add_to_short(0, x, to.m); /* half of the product */
  const int64_t product = fixed_product(moved, over.m);
  return (void)max, FIXED_NARROW_TO(product, SHORT_BITS + ROW_UP + 22 - SLOPE_BITS, SLOPE_ALL);
}

static inline tse_short r_short_over(tse_short x, r_factored over, tse_real max)
{
  const int64_t product = fixed_product(x, over.m);
  return (void)max, FIXED_NARROW(product, ROW_UP + 23);
}

static inline void r_slope_sums(
    tse_short *to, int rows, const tse_short *slope, int stride, tse_short *const *x, int together, int n)
{
  for (int i = 0; i < rows; i++)
    for (int b = 0; b < together; b++) {
      const int64_t sum = (int64_t)to[i * together + b] * (1 << SHORT_BITS)
          + fixed_sum(&slope[i * stride], x[b], n);
      to[i * together + b] = FIXED_NARROW(sum, SLOPE_BITS);
    }
}

/* Sums of products, one term after the other, with which car.c propagates partial
 * derivatives. Each product has a coefficient (a velocity or a partial derivative of the
 * model) and an element of a row of the transition matrix, which is scaled by 2^ROW_UP. A
 * sum is exact in 64 bits and rounded once at the end. r_end() converts it to an element
 * of a scaled row. r_end_rate() converts it to a rate, i.e. the change of such an element
 * per second, which can be larger and is not scaled.
 *   coefficient  units 2^-20, up to 1024
 *   element      units 2^-(SHORT_BITS + ROW_UP), up to 16
 *   rate         units 2^-SHORT_BITS, up to 256
 * A sum has at most 7 products, each below 2^60. */
typedef int32_t r_coefficient;
typedef int64_t r_total;
static inline r_coefficient r_coef(tse_real x) { return FIXED_NARROW(x, FIXED_BITS - COEF_BITS); }
static inline r_total r_start(tse_short x) { return (int64_t)x * (1 << COEF_BITS); }
static inline r_total r_product(r_coefficient a, tse_short x) { return fixed_product(a, x); }
static inline r_total r_plus(r_total s, r_coefficient a, tse_short x) { return s + fixed_product(a, x); }
static inline r_total r_minus(r_total s, r_coefficient a, tse_short x) { return s - fixed_product(a, x); }
static inline tse_short r_end(r_total s) { return FIXED_NARROW(s, COEF_BITS); }
static inline tse_short r_end_rate(r_total s) { return FIXED_NARROW(s, COEF_BITS + ROW_UP); }
static inline tse_short r_short_sum(tse_short x, tse_short y) { return saturate_short(x + y); }

#endif /* format */

/* ------------------------------------------------------------------------ all formats */

/* Compute y += a x. */
static inline void r_add_row(tse_short *y, const tse_short *x, r_factored a, int n)
{
  for (int i = 0; i < n; i++) y[i] = r_plus_times(y[i], a, x[i]);
}

/* Compute y += a x and x += b y, both from the old values of x and y. */
static inline void r_add_both(tse_short *y, tse_short *x, r_factored a, r_factored b, int n)
{
  for (int i = 0; i < n; i++) {
    const tse_short was = y[i];
    y[i] = r_plus_times(was, a, x[i]);
    x[i] = r_plus_times(x[i], b, was);
  }
}

/* Compute the same as r_add_both() with y[0], followed by r_add_both() with y[1]. This
 * function is faster, because it reads x only once. */
static inline void r_add_both_twice(
    tse_short *const y[2], tse_short *x, const r_factored a[2], const r_factored b[2], int n)
{
  tse_short *const y0 = y[0], *const y1 = y[1];
  const r_factored a0 = a[0], a1 = a[1], b0 = b[0], b1 = b[1];
  for (int i = 0; i < n; i++) {
    const tse_short was0 = y0[i], was1 = y1[i], before = x[i], between = r_plus_times(before, b0, was0);
    y0[i] = r_plus_times(was0, a0, before);
    y1[i] = r_plus_times(was1, a1, between);
    x[i] = r_plus_times(between, b1, was1);
  }
}

/* Compute x += b y, then y += a x with the new x. */
static inline void r_add_in_turn(tse_short *y, tse_short *x, r_factored a, r_factored b, int n)
{
  for (int i = 0; i < n; i++) {
    x[i] = r_plus_times(x[i], b, y[i]);
    y[i] = r_plus_times(y[i], a, x[i]);
  }
}

/* Compute the same as r_add_in_turn() with y[0], followed by r_add_in_turn() with
 * y[1]. */
static inline void r_add_in_turn_twice(
    tse_short *const y[2], tse_short *x, const r_factored a[2], const r_factored b[2], int n)
{
  tse_short *const y0 = y[0], *const y1 = y[1];
  const r_factored a0 = a[0], a1 = a[1], b0 = b[0], b1 = b[1];
  for (int i = 0; i < n; i++) {
    const tse_short was0 = y0[i], was1 = y1[i], between = r_plus_times(x[i], b0, was0),
                    after = r_plus_times(between, b1, was1);
    y0[i] = r_plus_times(was0, a0, between);
    y1[i] = r_plus_times(was1, a1, after);
    x[i] = after;
  }
}

#endif
