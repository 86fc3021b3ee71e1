/* estimator/hypotheses/learn.c - the adaptivity of the paper inside a regime: scales of spread and noise.
 *
 * The statistics of a normal-inverse-Wishart, mean and weight of three variances of the stiffness and three of the channels. The
 * states being marginalised, the scales follow from the evidence itself: with theta = log variance, V = dS/dtheta = var v v',
 *     score = (e' S^-1 V S^-1 e - tr(S^-1 V))/2,     information_ij = tr(S^-1 V_i S^-1 V_j)/2,
 * one step a row, scaled by the information gathered: recursive maximum likelihood with a prior (Ljung & Soderstrom 1983, 3.4).
 * Expected moments instead lose with a wide spread (study: 74 false changes of regime in six runs). */
#include "estimator/hypotheses/learn.h"

/* Solve A x = b in place, A = L D L' of six rows, positive definite by its prior; below the diagonal A is used up. */
static void solve(tse_real A[6][6], tse_real b[6])
{
  for (int j = 0; j < 6; j++) {
    const tse_real inv = r_div(TSE_R(1), A[j][j]);
    for (int i = j + 1; i < 6; i++) {
      const tse_real l = r_mul(A[i][j], inv);
      for (int k = i; k < 6; k++) A[k][i] = A[k][i] - r_mul(l, A[k][j]);
      b[i] = b[i] - r_mul(l, b[j]);
    }
    for (int i = j + 1; i < 6; i++) A[i][j] = r_mul(A[i][j], inv);
    b[j] = r_mul(b[j], inv);
  }
  for (int j = 5; j >= 0; j--)
    for (int i = j + 1; i < 6; i++) b[j] = b[j] - r_mul(A[i][j], b[i]);
}

/* g_ij = v_i' S^-1 v_j and q_i = v_i' S^-1 e, v: spread of a relative stiffness of one (0..2), noise of a channel (3..5). */
static void slopes_of_evidence(const tse_hypothesis *h, const innovation *o, tse_real g[6][6], tse_real q[6])
{
  tse_real v[3][2], w[3][3];
  for (int i = 0; i < 3; i++) {
    v[i][0] = r_mul(o->d[0][i], h->x[X_STIFFNESS + i]);
    v[i][1] = r_mul(o->d[1][i], h->x[X_STIFFNESS + i]);
    for (int a = 0; a < 3; a++) w[i][a] = r_mul(v[i][0], o->inv[0][a]) + r_mul(v[i][1], o->inv[1][a]);
    q[i] = r_mul(v[i][0], o->se[0]) + r_mul(v[i][1], o->se[1]);
    q[3 + i] = r_mul(o->use[i], o->se[i]);
  }
  for (int i = 0; i < 3; i++)
    for (int j = 0; j < 3; j++) {
      g[i][j] = r_mul(w[i][0], v[j][0]) + r_mul(w[i][1], v[j][1]);
      g[i][3 + j] = g[3 + j][i] = r_mul(w[i][j], o->use[j]);
      g[3 + i][3 + j] = r_mul(r_mul(o->use[i], o->use[j]), o->inv[i][j]);
    }
}

/* E q_i^2 is g_ii, but where interpolation took of the noise of a channel (align.c) the covariance of e is less than S by that.
 * Updated: step  the score of what is not missed then */
static void add_lost(const sample *y, tse_real g[6][6], const tse_real var[6], tse_real step[6])
{
  if (!(r_max(r_max(y->lost[0], y->lost[1]), y->lost[2]) > TSE_R(0))) return;
  for (int i = 0; i < 6; i++) {
    tse_real square = TSE_R(0);
    for (int c = 0; c < 3; c++) square += r_mul(r_mul(y->lost[c], var[3 + c]), r_sqr(g[i][3 + c]));
    step[i] += r_mul(r_mul(TSE_R(0.5), var[i]), square);
  }
}

/* g^2 a b/2. In fixed point g a, a share of the evidence, fits, and g^2 does not. */
static tse_real information(tse_real g, tse_real a, tse_real b)
{
#if defined(TSE_REAL_FIXED)
  return r_mul(r_mul(TSE_R(0.5), r_mul(g, a)), r_mul(g, b));
#else
  return r_mul(r_mul(TSE_R(0.5), r_sqr(g)), r_mul(a, b));
#endif
}

/* var times exp(step), in a bounded step. */
static tse_real moved(tse_real var, tse_real by, tse_real least, tse_real most)
{
  return r_clamp(r_mul(var, TSE_R(1) + r_clamp(by, TSE_R(-0.2), TSE_R(0.5))), least, most);
}

/* In fixed point: is all that has been learnt still a number? Elsewhere it is far from the end of the range. */
static int fits(tse_real A[6][6])
{
#if defined(TSE_REAL_FIXED)
  int fine = 1;
  for (int i = 0; i < 6; i++)
    for (int j = 0; j <= i; j++) fine = fine && r_is_finite(A[i][j]);
  return fine;
#else
  (void)A;
  return 1;
#endif
}

int learn(const tse_params *p, tse_hypothesis *h, const sample *y, const innovation *o, tse_real trust)
{
  tse_real g[6][6], q[6], A[6][6], step[6], var[6];
  const tse_real keep = r_div(STATISTICS_TIME, STATISTICS_TIME + y->dt);
  for (int a = 0; a < 3; a++) {
    var[a] = h->spread_var[a];
    var[3 + a] = h->noise_var[a];
  }
  slopes_of_evidence(h, o, g, q);
  for (int i = 0; i < 6; i++) {
    step[i] = r_mul(r_mul(TSE_R(0.5), var[i]), r_mul(trust, r_sqr(q[i])) - g[i][i]);
    for (int j = 0; j <= i; j++)
      A[i][j] = A[j][i] = r_mul(keep, h->info[i][j]) + information(g[i][j], var[i], var[j]);
    /* what is forgotten gives way to the prior: 2 (a - b)/(a + b) is log a - log b, near enough */
    const tse_real told = i < 3 ? p->initial_spread_var : TSE_R(1);
    const tse_real prior = r_div(TSE_R(1) - keep, r_sqr(i < 3 ? SPREAD_PRIOR_SD : NOISE_PRIOR_SD));
    A[i][i] += prior;
    step[i] += r_mul(prior, r_div(r_mul(TSE_R(2), told - var[i]), told + var[i]));
  }
  if (!fits(A)) return 0;
  add_lost(y, g, var, step);
  memcpy(h->info, A, sizeof h->info);
  solve(A, step);
  for (int a = 0; a < 3; a++) {
    h->spread_var[a] = moved(h->spread_var[a], step[a], LEAST_SPREAD_VAR, p->spread_max_var);
    if (p->noise_max_var > TSE_R(1)) h->noise_var[a] = moved(h->noise_var[a], step[3 + a], LEAST_NOISE_VAR, p->noise_max_var);
  }
  return 1;
}
