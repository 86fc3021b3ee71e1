/* number/fixed.h - arithmetic of the fixed-point scalar: an int64_t in units of 2^-TSE_FRACTION_BITS. Integers only.
 *
 * Room for sums. `+` and `-` are native and cannot say that they overflow, so results of everything else stop at FIXED_MOST, a
 * sixteenth of what the type holds: fifteen of them, of any sign, may be added before the sum leaves the type. The longest sums, over
 * the states of the filter, have 23 terms: those are kept far below it (STEEPEST in filter/predict.c, state_most in filter/start.c).
 * A result that has stopped is what an infinity is in the other formats: r_is_finite() says no, and the filter starts over.
 *
 * Portable C: four products of 32-bit halves, no type wider than 64 bits. Where the compiler has one, 128 bits give the same result
 * sooner. Right shifts of negative numbers must be arithmetic, and conversion to a signed type must keep the bits; both are checked. */
#ifndef TSE_FIXED_H
#define TSE_FIXED_H

#include <stdint.h>

#include "tse/real.h"

#if defined(TSE_REAL_FIXED)

#define FIXED_BITS TSE_FRACTION_BITS
#define FIXED_ROOM 4                                        /* bits above a result, for native sums and the sign's own */
#define FIXED_MOST ((int64_t)1 << (63 - FIXED_ROOM))
#define FIXED_ONE ((int64_t)1 << FIXED_BITS)
#define FIXED_NAN INT64_MIN                                 /* what is no number: comes from outside only */

#if TSE_FRACTION_BITS < 24 || TSE_FRACTION_BITS > 40 || TSE_FRACTION_BITS % 2
#error "TSE_FRACTION_BITS must be even (square roots) and lie in 24 .. 40"
#endif
typedef char fixed_needs_arithmetic_shift[((int64_t)-3 >> 1) == -2 ? 1 : -1];
typedef char fixed_needs_twos_complement[(int32_t)0xfffffffeu == -2 ? 1 : -1];

static inline uint64_t fixed_magnitude(int64_t x) { return x < 0 ? 0u - (uint64_t)x : (uint64_t)x; }

static inline int64_t fixed_signed(uint64_t magnitude, int negative)
{
  const int64_t x = magnitude > (uint64_t)FIXED_MOST ? FIXED_MOST : (int64_t)magnitude;
  return negative ? -x : x;
}

static inline int64_t fixed_saturate(int64_t x) { return x > FIXED_MOST ? FIXED_MOST : (x < -FIXED_MOST ? -FIXED_MOST : x); }

/* a b from halves, nearest, ties towards +infinity. hi, lo: the 128 bits of the exact product. */
static inline int64_t fixed_mul_halves(int64_t a, int64_t b)
{
  const int32_t ah = (int32_t)(a >> 32), bh = (int32_t)(b >> 32);
  const uint32_t al = (uint32_t)((uint64_t)a & 0xffffffffu), bl = (uint32_t)((uint64_t)b & 0xffffffffu);
  const uint64_t low = (uint64_t)al * bl;
  const int64_t across = (int64_t)ah * (int64_t)bl + (int64_t)(low >> 32);
  const int64_t middle = (int64_t)al * (int64_t)bh + (int64_t)((uint64_t)across & 0xffffffffu);
  const int64_t hi = (int64_t)ah * bh + (across >> 32) + (middle >> 32);
  const int64_t most = (int64_t)1 << (FIXED_BITS - 1 - FIXED_ROOM);
  if (hi >= most) return FIXED_MOST;
  if (hi < -most) return -FIXED_MOST;
#if FIXED_BITS == 32 /* whole words: no shift */
  return hi * ((int64_t)1 << 32) + (int64_t)((uint64_t)middle & 0xffffffffu) + (int64_t)((low >> 31) & 1u);
#else
  const uint64_t lo = ((uint64_t)middle << 32) | (low & 0xffffffffu);
  return hi * ((int64_t)1 << (64 - FIXED_BITS)) + (int64_t)(lo >> FIXED_BITS) + (int64_t)((lo >> (FIXED_BITS - 1)) & 1u);
#endif
}

/* Leading zeros of x > 0. */
static inline int fixed_zeros(uint64_t x)
{
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
}

/* (hi 2^64 + lo) / d, hi < d: two digits to the base 2^32, each from the leading digit of d and corrected at most twice
 * (Knuth, The Art of Computer Programming 2, 4.3.1 D). */
static inline uint64_t fixed_divide(uint64_t hi, uint64_t lo, uint64_t d, uint64_t *rest)
{
  const uint64_t base = (uint64_t)1 << 32;
  const int shift = fixed_zeros(d);
  d <<= shift;
  const uint64_t d1 = d >> 32, d0 = d & 0xffffffffu;
  if (shift > 0) hi = (hi << shift) | (lo >> (64 - shift));
  lo <<= shift;
  uint64_t quotient = 0;
  for (int digit = 0; digit < 2; digit++) {
    const uint64_t next = digit == 0 ? lo >> 32 : lo & 0xffffffffu;
    uint64_t q = hi / d1, r = hi - q * d1;
    for (int k = 0; k < 2 && r < base && (q >= base || q * d0 > (r << 32) + next); k++) {
      q--;
      r += d1;
    }
    hi = (hi << 32) + next - q * d;
    quotient = (quotient << 32) + q;
  }
  *rest = hi >> shift;
  return quotient;
}

/* n/d, nearest, ties away from zero; x/0 = +-most, 0/0 = 0. */
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

/* A binary digit a turn: the root of x 2^FIXED_BITS, nearest; 0 for x < 0. */
static inline int64_t fixed_sqrt_digits(int64_t x)
{
  uint64_t digits = x < 0 ? 0u : (uint64_t)x, root = 0, rest = 0;
  for (int i = 0; i < (64 + FIXED_BITS) / 2; i++) {
    rest = (rest << 2) | (digits >> 62);
    digits <<= 2;
    root <<= 1;
    if (rest > root << 1) {
      rest -= (root << 1) + 1;
      root++;
    }
  }
  return (int64_t)(root + (rest > root ? 1u : 0u));
}

/* Inlined on the host, where flash is not scarce; called where registers are short: a product is 30 .. 60 instructions there, and the
 * filter has two thousand of them. -DTSE_FIXED_CALLS=0 or 1 decides otherwise. */
#if !defined(TSE_FIXED_CALLS)
#if UINTPTR_MAX > 0xffffffffu
#define TSE_FIXED_CALLS 0
#else
#define TSE_FIXED_CALLS 1
#endif
#endif

#endif /* TSE_REAL_FIXED */
#endif
