/* tests/unit/student.h - distributions of Student's t and of F. */
#ifndef STUDENT_H
#define STUDENT_H

#include <math.h>

/* Regularised incomplete beta function I_x(a, b), by its continued fraction (NIST DLMF 8.17.22), evaluated from its end. */
static inline double beta_share(double x, double a, double b)
{
  if (x > (a + 1) / (a + b + 2)) return 1 - beta_share(1 - x, b, a);
  double fraction = 1;
  for (int m = 200; m > 0; m--) {
    const int k = m / 2;
    const double d = m % 2 == 0 ? k * (b - k) / ((a + 2 * k - 1) * (a + 2 * k)) : -(a + k) * (a + b + k) / ((a + 2 * k) * (a + 2 * k + 1));
    fraction = 1 + d * x / fraction;
  }
  return exp(a * log(x) + b * log1p(-x) + lgamma(a + b) - lgamma(a) - lgamma(b)) / (a * fraction);
}

static inline double student_cdf(double x, double nu)
{
  const double tail = 0.5 * beta_share(nu / (nu + x * x), nu / 2, 0.5);
  return x < 0 ? tail : 1 - tail;
}

/* The squared radius of n jointly spherical t, over n: F(n, nu). */
static inline double radius2_cdf(double x, double nu) { return beta_share(2 * x / (2 * x + nu), 1, nu / 2); }
static inline double radius3_cdf(double x, double nu) { return beta_share(3 * x / (3 * x + nu), 1.5, nu / 2); }

static inline double quantile_of(double (*cdf)(double, double), double nu, double p)
{
  double low = cdf == student_cdf ? -1000 : 1e-12, high = 1000;
  for (int i = 0; i < 50; i++) *(cdf(0.5 * (low + high), nu) < p ? &low : &high) = 0.5 * (low + high);
  return high;
}

#endif
