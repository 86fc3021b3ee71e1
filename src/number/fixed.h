/* number/fixed.h - fixed-point arithmetic: a number is an int64_t in units of
 * 2^-TSE_FRACTION_BITS. Only integer operations are used.
 *
 * Overflow of sums: `+` and `-` are those of C and do not detect overflow. The results of
 * all other operations therefore saturate at FIXED_MOST, a sixteenth of the range of
 * int64_t, so that fifteen results can be added without overflow. Sums over the states of
 * the filter have up to 23 terms, more than fifteen. Other limits (MAX_SLOPE in
 * filter/limits.h, state_max in filter/units.c) therefore keep the terms of such sums far
 * below FIXED_MOST. A saturated result counts as infinite: r_is_finite() returns 0, and
 * the filter restarts.
 *
 * The code is portable C: a product is computed from four products of 32-bit halves. If
 * the compiler has 128-bit integers, the code uses them instead, which takes less time
 * and gives the same results. On a Cortex-M0 the code uses 16-bit products. Two
 * properties of the compiler are checked at compile time: right shifts of negative
 * numbers are arithmetic, and conversion to a signed type keeps the bits. */
#ifndef TSE_FIXED_H
#define TSE_FIXED_H

#include <stdint.h>

#include "tse/real.h"

#if defined(TSE_REAL_FIXED)

#define FIXED_BITS TSE_FRACTION_BITS
#define FIXED_ROOM 4 /* number of bits that a result leaves free, so that sums by C's + do not overflow */
#define FIXED_MOST ((int64_t)1 << (63 - FIXED_ROOM))
#define FIXED_ONE ((int64_t)1 << FIXED_BITS)
#define FIXED_NAN INT64_MIN /* NaN: occurs in inputs only, never as a result */

typedef char fixed_needs_arithmetic_shift[((int64_t)-3 >> 1) == -2 ? 1 : -1];
typedef char fixed_needs_twos_complement[(int32_t)0xfffffffeu == -2 ? 1 : -1];

static inline uint64_t fixed_magnitude(int64_t x) { return x < 0 ? 0u - (uint64_t)x : (uint64_t)x; }

static inline int64_t fixed_signed(uint64_t magnitude, int negative)
{
  const int64_t x = magnitude > (uint64_t)FIXED_MOST ? FIXED_MOST : (int64_t)magnitude;
  return negative ? -x : x;
}

static inline int64_t fixed_saturate(int64_t x)
{
  return x > FIXED_MOST ? FIXED_MOST : (x < -FIXED_MOST ? -FIXED_MOST : x);
}

/* On processors that have neither 64-bit products nor division, for example the
 * Cortex-M0, compute with 16-bit products. This is faster than the functions of libgcc
 * and gives the same results. -DTSE_FIXED_QUARTERS selects 16-bit products on any
 * processor. */
#if defined(__ARM_ARCH_6M__) && !defined(TSE_FIXED_QUARTERS)
#define TSE_FIXED_QUARTERS
#endif

#if defined(TSE_FIXED_QUARTERS)
#define FIXED_LOW(x) ((int32_t)((uint32_t)(x) & 0xffffu))
#if defined(__GNUC__)
/* Attribute of a function that the compiler must not inline. Inlined, it would occupy
 * registers that the calling function needs. */
#define FIXED_APART __attribute__((noinline, unused))
#endif

/* Return the upper 32 bits of the 64-bit product a b.
 *   Returned:  *middle  word whose lower 16 bits are the bits 16 .. 31 of the product */
static inline int32_t fixed_upper(int32_t a, int32_t b, int32_t *middle)
{
  const int32_t ah = a >> 16, bh = b >> 16, al = FIXED_LOW(a), bl = FIXED_LOW(b);
  const int32_t across = al * bh + (int32_t)(((uint32_t)al * (uint32_t)bl) >> 16);
  *middle = ah * bl + FIXED_LOW(across);
  return ah * bh + (across >> 16) + (*middle >> 16);
}

/* Return the product a b. It is exact. */
static inline int64_t fixed_product(int32_t a, int32_t b)
{
  int32_t middle;
  const int32_t hi = fixed_upper(a, b, &middle);
  return (int64_t)(((uint64_t)(uint32_t)hi << 32) | ((uint32_t)middle << 16)
      | (((uint32_t)a * (uint32_t)b) & 0xffffu));
}

/* Return a b 2^-32, rounded to nearest, ties towards +infinity. */
static inline int32_t fixed_product_upper(int32_t a, int32_t b)
{
  int32_t middle;
  const int32_t hi = fixed_upper(a, b, &middle);
  return hi + (middle >> 15 & 1);
}

static inline uint64_t fixed_product_unsigned(uint32_t a, uint32_t b)
{
  const uint32_t ah = a >> 16, bh = b >> 16, al = a & 0xffffu, bl = b & 0xffffu, low = al * bl;
  const uint32_t across = al * bh + (low >> 16), middle = ah * bl + (across & 0xffffu);
  return ((uint64_t)(ah * bh + (across >> 16) + (middle >> 16)) << 32) | ((middle << 16) | (low & 0xffffu));
}

/* Return an approximation of 2^31/d for d from 2^15 to 2^16. It is at most 2 too small.
 * The first approximation is a line in d of slope -1. Its relative error is up to 7.2 %.
 * Three Newton steps follow. */
static inline uint32_t fixed_over(uint32_t d)
{
  uint32_t over = 95900u - d;
  for (int k = 0; k < 3; k++) over = (over * (131072u - ((over * d) >> 15))) >> 16;
  return over - 1;
}

/* Return n/d rounded down, for n up to 2^16 d. The quotient is estimated from the upper
 * 16 bits of n and over = fixed_over(d), and then corrected at most 6 times. */
static inline uint32_t fixed_digit(uint32_t n, uint32_t d, uint32_t over)
{
  uint32_t q = ((n >> 16) * over) >> 15, rest = n - q * d;
  for (int k = 0; k < 6 && rest >= d; k++) {
    rest -= d;
    q++;
  }
  return q;
}
#else
static inline int64_t fixed_product(int32_t a, int32_t b) { return (int64_t)a * b; }
static inline int32_t fixed_product_upper(int32_t a, int32_t b)
{
  return (int32_t)(((int64_t)a * b + ((int64_t)1 << 31)) >> 32);
}
static inline uint64_t fixed_product_unsigned(uint32_t a, uint32_t b) { return (uint64_t)a * b; }
static inline uint32_t fixed_over(uint32_t d) { return d; }
static inline uint32_t fixed_digit(uint32_t n, uint32_t d, uint32_t over) { return (void)over, n / d; }
#endif

#if !defined(FIXED_APART)
#define FIXED_APART inline
#endif

/* Halves of a number x = hi 2^32 + lo. The lower half is signed, too, so that all partial
 * products are signed. */
typedef struct fixed_halves {
  int32_t hi, lo;
} fixed_halves;
static inline fixed_halves fixed_halves_of(int64_t x)
{
  const uint32_t lo = (uint32_t)x;
  const fixed_halves h = { (int32_t)((uint32_t)((uint64_t)x >> 32) + (lo >> 31)), (int32_t)lo };
  return h;
}

/* Return the product of two fixed-point numbers, given by their halves: rounded to
 * nearest (ties towards +infinity) and saturated. */
static FIXED_APART int64_t fixed_mul_any(fixed_halves a, fixed_halves b)
{
  const int64_t middle = (int64_t)((uint64_t)(int64_t)fixed_product_upper(a.lo, b.lo)
      + (uint64_t)fixed_product(a.hi, b.lo) + (uint64_t)fixed_product(a.lo, b.hi));
  const int64_t hi = fixed_product(a.hi, b.hi) + (middle >> 32), most = (int64_t)1 << (31 - FIXED_ROOM);
  if (hi >= most) return FIXED_MOST;
  if (hi < -most) return -FIXED_MOST;
  return (int64_t)(((uint64_t)hi << 32) | (uint32_t)middle);
}

#if defined(TSE_FIXED_QUARTERS)
/* Return hi 2^32 + lo, saturated. */
static inline int64_t fixed_joint(int32_t hi, uint32_t lo)
{
  const int32_t most = (int32_t)1 << (31 - FIXED_ROOM);
  if (hi >= most) return FIXED_MOST;
  if (hi < -most) return -FIXED_MOST;
  return (int64_t)(((uint64_t)(uint32_t)hi << 32) | lo);
}

static inline int fixed_is_short(int32_t x) { return x > -32768 && x < 32768; }

/* Return the same as fixed_mul_any(). If both upper halves fit into 16 bits, 32-bit
 * products and sums are enough. */
static inline int64_t fixed_mul_quick(fixed_halves a, fixed_halves b)
{
  if (!fixed_is_short(a.hi) || !fixed_is_short(b.hi)) return fixed_mul_any(a, b);
  const int32_t low = fixed_product_upper(a.lo, b.lo);
  if ((a.hi | b.hi) == 0) return low;
  const int32_t u = a.hi * FIXED_LOW(b.lo), v = b.hi * FIXED_LOW(a.lo), digits = FIXED_LOW(u) + FIXED_LOW(v);
  const int32_t sum = a.hi * (b.lo >> 16) + b.hi * (a.lo >> 16) + (u >> 16) + (v >> 16) + (digits >> 16);
  const uint32_t from = ((uint32_t)sum << 16) | (uint32_t)FIXED_LOW(digits), lo = from + (uint32_t)low;
  return fixed_joint(a.hi * b.hi + (sum >> 16) + (low >> 31) + (lo < from ? 1 : 0), lo);
}
#else
static inline int64_t fixed_mul_quick(fixed_halves a, fixed_halves b) { return fixed_mul_any(a, b); }
#endif

/* Return the product of two fixed-point numbers.
 *   Given:  a, b  results of functions of this file, or sums (by C's +) of at most
 *                 fifteen such results */
static inline int64_t fixed_mul_halves(int64_t a, int64_t b)
{
  return fixed_mul_quick(fixed_halves_of(a), fixed_halves_of(b));
}

/* Return the number of leading zeros of x > 0. */
static inline int fixed_zeros(uint64_t x)
{
#if defined(__GNUC__)
  return __builtin_clzll(x);
#else
  int n = 0;
  /* clang-format off */
  if (x < (uint64_t)1 << 32) { n += 32; x <<= 32; }
  uint32_t y = (uint32_t)(x >> 32);
  if (y < (uint32_t)1 << 16) { n += 16; y <<= 16; }
  if (y < (uint32_t)1 << 24) { n += 8;  y <<= 8; }
  if (y < (uint32_t)1 << 28) { n += 4;  y <<= 4; }
  if (y < (uint32_t)1 << 30) { n += 2;  y <<= 2; }
  /* clang-format on */
  return n + (y < (uint32_t)1 << 31 ? 1 : 0);
#endif
}

/* Return (hi 2^32 + lo)/d rounded down, for hi < d and d >= 2^31. The quotient has two
 * digits to base 2^16. Each digit is estimated with the leading digit of d, and corrected
 * at most twice (Knuth, The Art of Computer Programming 2, 4.3.1 D). */
static inline uint32_t fixed_divide_word(uint32_t hi, uint32_t lo, uint32_t d)
{
  const uint32_t base = (uint32_t)1 << 16, d1 = d >> 16, d0 = d & 0xffffu, over = fixed_over(d1);
  uint32_t quotient = 0;
  for (int digit = 0; digit < 2; digit++) {
    const uint32_t next = digit == 0 ? lo >> 16 : lo & 0xffffu;
    uint32_t q = fixed_digit(hi, d1, over), r = hi - q * d1;
    for (int k = 0; k < 2 && r < base && (q >= base || q * d0 > (r << 16) + next); k++) {
      q--;
      r += d1;
    }
    hi = (hi << 16) + next - q * d;
    quotient = (quotient << 16) + q;
  }
  return quotient;
}

/* Return (hi 2^64 + lo)/d rounded down, for hi < d. As in fixed_divide_word(), the
 * quotient has two digits, here to base 2^32. The estimate of a digit is `hi` divided by
 * d1, the upper 32 bits of d. This division is a multiplication by `over`, a reciprocal
 * of d1 (Moeller & Granlund 2011).
 *   Returned:  *rest  remainder */
static inline uint64_t fixed_divide(uint64_t hi, uint64_t lo, uint64_t d, uint64_t *rest)
{
  const int shift = fixed_zeros(d);
  d <<= shift;
  const uint32_t d1 = (uint32_t)(d >> 32), d0 = (uint32_t)d,
                 over = fixed_divide_word(~d1, UINT32_MAX, d1); /* (2^64 - 1)/d1 - 2^32 */
  if (shift > 0) hi = (hi << shift) | (lo >> (64 - shift));
  lo <<= shift;
  uint64_t quotient = 0;
  for (int digit = 0; digit < 2; digit++) {
    const uint32_t next = digit == 0 ? (uint32_t)(lo >> 32) : (uint32_t)lo, n1 = (uint32_t)(hi >> 32),
                   n0 = (uint32_t)hi;
    if (hi < d1) { /* the digit is 0 */
      hi = (hi << 32) + next;
      quotient <<= 32;
      continue;
    }
    const uint64_t guess = fixed_product_unsigned(over, n1) + hi;
    uint32_t q = (uint32_t)(guess >> 32) + 1, part = n0 - q * d1;
    if (part > (uint32_t)guess) {
      q--;
      part += d1;
    }
    if (part >= d1) {
      q++;
      part -= d1;
    }
    uint64_t r = part;
    if (n1 >= d1) { /* begin with the largest digit */
      q = UINT32_MAX;
      r = (uint64_t)n0 + d1;
    }
    for (int k = 0; k < 2 && r <= UINT32_MAX && fixed_product_unsigned(q, d0) > (r << 32) + next; k++) {
      q--;
      r += d1;
    }
    hi = (hi << 32) + next - fixed_product_unsigned(q, d0) - ((uint64_t)(q * d1) << 32);
    quotient = (quotient << 32) + q;
  }
  *rest = hi >> shift;
  return quotient;
}

/* Return the quotient a/b of two fixed-point numbers: rounded to nearest (ties away from
 * zero) and saturated. a/0 is FIXED_MOST with the sign of a, and 0/0 is 0. */
static inline int64_t fixed_div_halves(int64_t a, int64_t b)
{
  const uint64_t n = fixed_magnitude(a), d = fixed_magnitude(b);
  const int negative = (a < 0) != (b < 0);
  uint64_t rest, quotient;
  if (n == 0) return 0;
  if (n >> (63 - FIXED_ROOM - FIXED_BITS) >= d) return fixed_signed((uint64_t)FIXED_MOST, negative);
  quotient = fixed_divide(n >> (64 - FIXED_BITS), n << FIXED_BITS, d, &rest);
  return fixed_signed(quotient + (rest >= d - rest ? 1u : 0u), negative);
}

/* Return the square root of x >= 2^30, rounded down. The first approximation is a line in
 * x. Three Newton steps follow. Their results are never below the root. */
static inline uint32_t fixed_sqrt_half(uint32_t x)
{
  uint32_t s = (((x >> 16) * 43691u) >> 16) + 21847u;
  for (int k = 0; k < 3; k++) s = (s + fixed_digit(x, s, fixed_over(s))) >> 1;
  if (s > 65535) s = 65535;
  return s * s > x ? s - 1 : s;
}

/* Return the square root of a fixed-point number x, rounded to nearest; 0 for x <= 0. In
 * units of 2^-FIXED_BITS, the result is the root of the integer x 2^FIXED_BITS. First the
 * leading zeros of x are shifted out, an even number of them. Then the upper 16, 32 and
 * 48 bits of the root are computed one after the other (Zimmermann, Karatsuba Square
 * Root, 1999). The new bits are (n - s^2)/(2 s), where n is the shifted integer and s the
 * root so far. If the square of the new root exceeds n, the root is decreased by 1. */
static inline int64_t fixed_sqrt_digits(int64_t x)
{
  if (x <= 0) return 0;
  const int half = FIXED_BITS / 2, zeros = fixed_zeros((uint64_t)x) & ~1;
  const uint64_t n = (uint64_t)x << zeros;
  const uint32_t top = (uint32_t)(n >> 32), low = (uint32_t)n;
  const uint32_t s16 = fixed_sqrt_half(top), over = ((top - s16 * s16) << 15) + (low >> 17),
                 q16 = fixed_digit(over, s16, fixed_over(s16));
  uint64_t root = ((uint64_t)s16 << 16) + q16;
  int64_t rest = (int64_t)((((uint64_t)(over - q16 * s16) << 1 | (low >> 16 & 1u)) << 16) + (low & 0xffffu))
      - (int64_t)fixed_product_unsigned(q16, q16);
  if (rest < 0) {
    root--;
    rest += (int64_t)(2 * root + 1);
  }
  const uint64_t next = (uint64_t)rest << (half - 1);
  const uint32_t s32 = (uint32_t)root, q = fixed_divide_word((uint32_t)(next >> 32), (uint32_t)next, s32);
  root = (root << half) + q;
  rest = (int64_t)((next - fixed_product_unsigned(q, s32)) << (half + 1))
      - (int64_t)fixed_product_unsigned(q, q);
  if (rest < 0) {
    root--;
    rest += (int64_t)(2 * root + 1);
  }
  if (zeros == 0) return (int64_t)root + (rest > (int64_t)root ? 1 : 0);
  return (int64_t)((root + ((uint64_t)1 << (zeros / 2 - 1))) >> (zeros / 2));
}

/* Products are inlined on 64-bit machines. On other machines a product takes 30 .. 60
 * instructions, and the program has about two thousand products. Products are therefore
 * function calls there, which take much less program memory. -DTSE_FIXED_CALLS=0 (inline)
 * or 1 (calls) overrides this choice. */
#if !defined(TSE_FIXED_CALLS)
#if UINTPTR_MAX > 0xffffffffu
#define TSE_FIXED_CALLS 0
#else
#define TSE_FIXED_CALLS 1
#endif
#endif

#endif /* TSE_REAL_FIXED */
#endif
