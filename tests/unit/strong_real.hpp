// tests/unit/strong_real.hpp - a double without the operators * and /.
//
// include/tse/real.h uses it as tse_real if TSE_REAL_STRONG is defined, and the core is
// compiled as C++. A product written with an operator, or a literal without TSE_R(), is
// then a compile error. Only this file reads the double: it wraps the functions of
// src/number/real_ops.h for double, in a namespace of their own.
#ifndef TSE_STRONG_REAL_HPP
#define TSE_STRONG_REAL_HPP

#include <float.h>
#include <math.h>
#include <stdint.h>
#include <string.h>

#include <type_traits>

#if defined(TSE_REAL_OPS_H) // real_ops.h includes this file and continues after it
#undef TSE_REAL_OPS_H
#define INCLUDED_BY_REAL_OPS
#endif
namespace plain {
typedef double tse_real;
typedef double tse_setting;
#define TSE_REAL_PLAIN
#include "number/real_ops.h"
#undef TSE_REAL_PLAIN
} // namespace plain
#if !defined(INCLUDED_BY_REAL_OPS) // otherwise functions made of these are defined later
#undef TSE_REAL_OPS_H
#endif

class tse_real {
public:
  tse_real() = default;
  static constexpr tse_real wrap(double value) { return tse_real(value); }
  static constexpr double raw(tse_real x) { return x.value_; }

  constexpr tse_real operator-() const { return tse_real(-value_); }
  friend constexpr tse_real operator+(tse_real a, tse_real b) { return tse_real(a.value_ + b.value_); }
  friend constexpr tse_real operator-(tse_real a, tse_real b) { return tse_real(a.value_ - b.value_); }
  tse_real &operator+=(tse_real b) { value_ += b.value_; return *this; }
  tse_real &operator-=(tse_real b) { value_ -= b.value_; return *this; }
  friend constexpr bool operator<(tse_real a, tse_real b) { return a.value_ < b.value_; }
  friend constexpr bool operator>(tse_real a, tse_real b) { return a.value_ > b.value_; }
  friend constexpr bool operator<=(tse_real a, tse_real b) { return a.value_ <= b.value_; }
  friend constexpr bool operator>=(tse_real a, tse_real b) { return a.value_ >= b.value_; }
  friend constexpr bool operator==(tse_real a, tse_real b) { return a.value_ == b.value_; }
  friend constexpr bool operator!=(tse_real a, tse_real b) { return a.value_ != b.value_; }

private:
  explicit constexpr tse_real(double value) : value_(value) {}
  double value_;
};

#define TSE_R(x) (tse_real::wrap((double)(x)))

// The core copies whole structures and clears them with memset.
static_assert(std::is_trivial<tse_real>::value && sizeof(tse_real) == sizeof(double), "");

typedef double tse_setting;

#define R_STRONG_1(name)                                                                          \
  static inline tse_real name(tse_real x) { return tse_real::wrap(plain::name(tse_real::raw(x))); }
#define R_STRONG_2(name)                                                                          \
  static inline tse_real name(tse_real x, tse_real y)                                             \
  {                                                                                               \
    return tse_real::wrap(plain::name(tse_real::raw(x), tse_real::raw(y)));                       \
  }
R_STRONG_2(r_mul)
R_STRONG_2(r_div)
R_STRONG_2(r_add_sat)
R_STRONG_2(r_atan2)
R_STRONG_1(r_abs)
R_STRONG_1(r_sqrt)
R_STRONG_1(r_log2)
R_STRONG_1(r_exp2)
#undef R_STRONG_1
#undef R_STRONG_2

static inline int r_is_finite(tse_real x) { return plain::r_is_finite(tse_real::raw(x)); }
static inline int r_is_nan(tse_real x) { return plain::r_is_nan(tse_real::raw(x)); }
static inline int32_t r_floor_to_int(tse_real x) { return plain::r_floor_to_int(tse_real::raw(x)); }
static inline tse_real r_from_int(int32_t n) { return tse_real::wrap(n); }
static inline tse_real r_share(tse_real x, int32_t n)
{
  return tse_real::wrap(plain::r_share(tse_real::raw(x), n));
}
static inline tse_real r_uniform(uint32_t word) { return tse_real::wrap(plain::r_uniform(word)); }
static inline int32_t r_to_q24(tse_real x) { return plain::r_to_q24(tse_real::raw(x)); }
static inline tse_real r_from_q24(int32_t n) { return tse_real::wrap(plain::r_from_q24(n)); }
static inline tse_real r_from_setting(tse_setting x) { return tse_real::wrap(x); }
static inline tse_setting r_to_setting(tse_real x) { return tse_real::raw(x); }
static inline void r_sincos_turn(tse_real t, tse_real *s, tse_real *c)
{
  double sine, cosine;
  plain::r_sincos_turn(tse_real::raw(t), &sine, &cosine);
  *s = tse_real::wrap(sine);
  *c = tse_real::wrap(cosine);
}

#endif
