// strong_real.hpp - a double that has lost * and /.
//
// include/tse/real.h uses it as tse_real when TSE_REAL_STRONG is defined, and the core is compiled as C++:
// a product written with an operator, or a bare literal in place of TSE_R(), is then a compile error.
// src/number/real_ops.h is the one place that looks inside, through raw() and wrap().
#ifndef TSE_STRONG_REAL_HPP
#define TSE_STRONG_REAL_HPP

#include <type_traits>

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

// A sum over particles. Of another type than tse_real, because it may have another scale.
class tse_acc {
public:
  tse_acc() = default;
  static constexpr tse_acc wrap(double value) { return tse_acc(value); }
  static constexpr double raw(tse_acc x) { return x.value_; }

  friend constexpr bool operator<(tse_acc a, tse_acc b) { return a.value_ < b.value_; }
  friend constexpr bool operator>(tse_acc a, tse_acc b) { return a.value_ > b.value_; }
  friend constexpr bool operator<=(tse_acc a, tse_acc b) { return a.value_ <= b.value_; }
  friend constexpr bool operator>=(tse_acc a, tse_acc b) { return a.value_ >= b.value_; }

private:
  explicit constexpr tse_acc(double value) : value_(value) {}
  double value_;
};

// The core copies whole structures and clears them with memset.
static_assert(std::is_trivial<tse_real>::value && sizeof(tse_real) == sizeof(double), "");
static_assert(std::is_trivial<tse_acc>::value, "");

#endif
