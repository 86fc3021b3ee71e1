/* tse/convert.h - convert between double and the number format of the library.
 *
 * This header is for programs that use the library; the library itself does not include
 * it. NaN stays NaN. In a fixed-point build, a value beyond +-2^28, infinity included,
 * becomes +-2^28, which is outside the range of every setting and channel. tse_prepare()
 * refuses a setting out of range. tse_step() refuses a row whose dt, steering angle or
 * wheel speed is out of range; any other channel out of range counts as missing. */
#ifndef TSE_CONVERT_H
#define TSE_CONVERT_H

#include <math.h>

#include "tse/real.h"

#if defined(TSE_REAL_FIXED)

static inline tse_real tse_real_of(double x)
{
  const double one = (double)((int64_t)1 << TSE_FRACTION_BITS);
  const double max_scaled = 1152921504606846976.0; /* 2^60, larger than any valid number */
  const double scaled = x * one;
  if (x != x) return INT64_MIN;
  if (scaled >= max_scaled) return (tse_real)1 << 60;
  if (scaled <= -max_scaled) return -((tse_real)1 << 60);
  const tse_real whole = (tse_real)scaled;
  const double rest = scaled - (double)whole;
  return whole + (rest >= 0.5 ? 1 : (rest <= -0.5 ? -1 : 0));
}

static inline double tse_double_of(tse_real x)
{
  if (x == INT64_MIN) return (double)NAN;
  return (double)x / (double)((int64_t)1 << TSE_FRACTION_BITS);
}

/* Convert a double to a setting. First round it to single precision, as TSE_S() does. */
static inline tse_setting tse_setting_of(double x) { return tse_real_of((double)(float)x); }
static inline double tse_double_of_setting(tse_setting x) { return tse_double_of(x); }

#else

static inline tse_real tse_real_of(double x) { return (tse_real)x; }
static inline double tse_double_of(tse_real x) { return (double)x; }
static inline tse_setting tse_setting_of(double x) { return (tse_setting)x; }
static inline double tse_double_of_setting(tse_setting x) { return (double)x; }

#endif
#endif
