/* number/random.h - random numbers as a function of seed, step, particle and purpose. The
 * generator has no state, and numbers may be computed in any order.
 *
 * The generator is threefry2x32 with 20 rounds: Salmon et al., "Parallel random numbers:
 * as easy as 1, 2, 3", SC11 (2011). */
#ifndef TSE_RANDOM_H
#define TSE_RANDOM_H

#include "number/real_ops.h"

/* Purpose of a random number. The random numbers of a step for different purposes are
 * independent. The generator encrypts a counter of two words: the step, and a word with
 * the particle in its lower 16 bits and the purpose above them. */
enum {
  RANDOM_DRAW_A = 0,
  RANDOM_DRAW_B,
  RANDOM_RESAMPLE,
  RANDOM_START_A,
  RANDOM_START_B,
  RANDOM_START_C,
  RANDOM_SIM_STIFFNESS_A,
  RANDOM_SIM_STIFFNESS_B,
  RANDOM_SIM_NOISE_A,
  RANDOM_SIM_NOISE_B,
  RANDOM_SIM_NOISE_C,
  RANDOM_SIM_WALK_A,
  RANDOM_SIM_WALK_B,
  RANDOM_KERNEL,
};

static inline uint32_t rotate_left(uint32_t x, int n) { return (x << n) | (x >> (32 - n)); }

/* Compute two random words from the key (seed) and the counter
 * (step, purpose, particle). */
static inline void random_words(
    const uint32_t seed[2], uint32_t step, uint32_t purpose, uint32_t particle, uint32_t *a, uint32_t *b)
{
  const uint32_t k0 = seed[0], k1 = seed[1], k2 = 0x1BD11BDAu ^ k0 ^ k1;
  uint32_t x = step + k0, y = ((purpose << 16) | particle) + k1;
#define ROUND(n) x += y; y = rotate_left(y, n); y ^= x;
  /* clang-format off */
  ROUND(13) ROUND(15) ROUND(26) ROUND(6)   x += k1; y += k2 + 1u;
  ROUND(17) ROUND(29) ROUND(16) ROUND(24)  x += k2; y += k0 + 2u;
  ROUND(13) ROUND(15) ROUND(26) ROUND(6)   x += k0; y += k1 + 3u;
  ROUND(17) ROUND(29) ROUND(16) ROUND(24)  x += k1; y += k2 + 4u;
  ROUND(13) ROUND(15) ROUND(26) ROUND(6)   x += k2; y += k0 + 5u;
  /* clang-format on */
#undef ROUND
  *a = x;
  *b = y;
}

/* Compute two standard normal numbers from two random words, by Box & Muller. */
static inline void random_normal2(uint32_t a, uint32_t b, tse_real *n1, tse_real *n2)
{
  tse_real s, c;
  const tse_real radius = r_sqrt(r_mul(TSE_R(-2.0 * 0.69314718055994531), r_log2(r_uniform(a))));
  r_sincos_turn(r_uniform(b), &s, &c);
  *n1 = r_mul(radius, c);
  *n2 = r_mul(radius, s);
}

/* Compute three uncorrelated standard Student-t numbers with nu degrees of freedom. They
 * are not independent: their joint distribution is the spherical one, in which all three
 * have the same chi-square variable as divisor. Four random words are used, without
 * rejection: Bailey, Math. Comp. 62 (1994) 779.
 *   (t1, t2)  bivariate t: radius^2 = nu (U^(-2/nu) - 1), where U is uniform in (0, 1);
 *             uniform angle
 *   t3        given t1 and t2: t(nu + 2) sqrt((nu + radius^2)/(nu + 2)), where t(nu + 2)
 *             is a Student-t number with nu + 2 degrees of freedom
 *   Given:  minus_2_nu   -2/nu, computed once for all particles
 *           minus_2_nu2  -2/(nu + 2)
 *           inv_nu2      1/(nu + 2) */
static inline void random_student3(const uint32_t u[4], tse_real nu, tse_real minus_2_nu,
    tse_real minus_2_nu2, tse_real inv_nu2, tse_real *t1, tse_real *t2, tse_real *t3)
{
  tse_real s, c, unused;
  const tse_real nu2 = nu + TSE_R(2);
  const tse_real rr = r_max(
      TSE_R(0), r_mul(nu, r_exp2(r_mul(minus_2_nu, r_log2(r_uniform(u[0])))) - TSE_R(1)));
  const tse_real qq = r_max(
      TSE_R(0), r_mul(nu2, r_exp2(r_mul(minus_2_nu2, r_log2(r_uniform(u[2])))) - TSE_R(1)));
  const tse_real radius = r_sqrt(rr);
  r_sincos_turn(r_uniform(u[1]), &s, &c);
  *t1 = r_mul(radius, c);
  *t2 = r_mul(radius, s);
  r_sincos_turn(r_uniform(u[3]), &unused, &c);
  *t3 = r_mul(r_sqrt(r_mul(qq, r_mul(nu + rr, inv_nu2))), c);
}

#endif
