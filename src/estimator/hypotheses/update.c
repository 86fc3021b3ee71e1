/* estimator/hypotheses/update.c - Kalman update with dependent noise: eps is in the sample and in the motion until the next. */
#include "estimator/hypotheses/update.h"
#include "estimator/hypotheses/learn.h"

#define MOST_VAR TSE_R(400) /* (20 m/s)^2: beyond, nothing is linear */

/* A sample says how large a force, stiffness times slip, is: the relative error of the stiffness. So it is that which keeps its
 * variance when the mean moves, as if the logarithm were estimated. */
static void follow_level(const tse_params *p, tse_hypothesis *h, const tse_real before[3])
{
  for (int a = 0; a < 3; a++) {
    const int c = X_STIFFNESS + a;
    h->x[c] = r_clamp(h->x[c], TSE_R(1) + p->w_min, TSE_R(1) + p->w_max);
    const tse_real ratio = r_clamp(r_div(h->x[c], before[a]), TSE_R(0.5), TSE_R(2));
    const tse_real own = r_mul(r_sqr(ratio), h->cov[c][c]);
    for (int b = 0; b < TSE_X; b++) h->cov[c][b] = h->cov[b][c] = r_mul(ratio, h->cov[c][b]);
    h->cov[c][c] = own;
  }
}

/* K: gain of X, one channel after the other; an input that is not known teaches no stiffness, which is then only considered
 * (Schmidt 1966): its rows of the gain are zero, what it has in common with the rest is updated all the same. */
static void move(tse_hypothesis *h, const innovation *o, tse_real trust, int considered)
{
  tse_real K[3][TSE_X];
  for (int a = 0; a < 3; a++) {
    const tse_real i0 = r_mul(trust, o->inv[0][a]), i1 = r_mul(trust, o->inv[1][a]), i2 = r_mul(trust, o->inv[2][a]);
    for (int i = 0; i < TSE_X; i++) K[a][i] = r_mul(o->ph[0][i], i0) + r_mul(o->ph[1][i], i1) + r_mul(o->ph[2][i], i2);
    if (considered) K[a][3] = K[a][4] = K[a][5] = TSE_R(0);
  }
  for (int i = 0; i < TSE_X; i++) {
    h->x[i] += r_mul(K[0][i], o->e[0]) + r_mul(K[1][i], o->e[1]) + r_mul(K[2][i], o->e[2]);
    for (int j = i; j < TSE_X; j++) /* i: the row whose gain is not zero, unless both are considered */
      h->cov[i][j] = h->cov[i][j] - (r_mul(K[0][i], o->ph[0][j]) + r_mul(K[1][i], o->ph[1][j]) + r_mul(K[2][i], o->ph[2][j]));
  }
  for (int i = X_STIFFNESS; i < X_BIAS && considered; i++)
    for (int j = X_BIAS; j < TSE_X; j++)
      h->cov[i][j] = h->cov[i][j] - (r_mul(K[0][j], o->ph[0][i]) + r_mul(K[1][j], o->ph[1][i]) + r_mul(K[2][j], o->ph[2][i]));
  for (int i = 0; i < TSE_X; i++) {
    h->cov[i][i] = r_max(h->cov[i][i], TSE_R(0));
    for (int j = i + 1; j < TSE_X; j++) h->cov[j][i] = h->cov[i][j];
  }
}

/* Mean and covariance of this row's eps given the sample, and its covariance with X. */
static void move_eps(tse_hypothesis *h, const innovation *o, tse_real trust)
{
  tse_real sd[3][3], K[3][3];
  for (int j = 0; j < 3; j++) {
    for (int a = 0; a < 3; a++) sd[j][a] = r_mul(o->eps_var[j], o->d[a][j]);
    for (int a = 0; a < 3; a++)
      K[j][a] = r_mul(trust, r_mul(sd[j][0], o->inv[0][a]) + r_mul(sd[j][1], o->inv[1][a]) + r_mul(sd[j][2], o->inv[2][a]));
    h->eps[j] = r_mul(K[j][0], o->e[0]) + r_mul(K[j][1], o->e[1]) + r_mul(K[j][2], o->e[2]);
    for (int i = 0; i < TSE_X; i++) h->eps_x[j][i] = -(r_mul(K[j][0], o->ph[0][i]) + r_mul(K[j][1], o->ph[1][i]) + r_mul(K[j][2], o->ph[2][i]));
  }
  for (int i = 0; i < 3; i++)
    for (int j = 0; j < 3; j++)
      h->eps_cov[i][j] = (i == j ? o->eps_var[i] : TSE_R(0)) - (r_mul(K[i][0], sd[j][0]) + r_mul(K[i][1], sd[j][1]) + r_mul(K[i][2], sd[j][2]));
}

/* The noise that smoothed slip and vel_x have in common is in gain and innovation: each sample would move the longitudinal
 * stiffness by that much on average. */
static void undo_pull(const tse_params *p, tse_hypothesis *h, const innovation *o, tse_real trust)
{
  const tse_real gx = r_mul(r_mul(o->use[0], p->inv_sd[0]), p->read_x);
  const tse_real common = r_mul(p->kx_front, h->pull[0]) + r_mul(r_mul(p->kx_rear, p->follow), h->pull[1]);
  const tse_real by = r_mul(trust, r_div(r_mul(r_mul(o->h[0][0], gx), common), o->s[0][0]));
  for (int a = 0; a < TSE_X; a++) h->x[a] += r_mul(h->cov[a][X_STIFFNESS], by);
}

int update(const tse_params *p, tse_hypothesis *h, const sample *y, const innovation *o)
{
  const tse_real trust = trust_of(o);
  const tse_real before[3] = { h->x[3], h->x[4], h->x[5] }, fresh = r_div(DISTURBANCE_TIME, y->dt + DISTURBANCE_TIME);
  move(h, o, trust, h->fault > FAULT_NONE && h->fault < FAULT_MEASURED);
  move_eps(h, o, trust);
  if (p->wheel_var[0] > TSE_R(0)) undo_pull(p, h, o, trust);
  follow_level(p, h, before);
  h->x[0] = vehicle_kept(h->x[0], MOST_SPEED);
  h->x[1] = vehicle_kept(h->x[1], MOST_SPEED);
  h->x[2] = vehicle_kept(h->x[2], MOST_YAW_RATE);
  h->slides = o->slides;
  for (int a = 0; a < 3; a++) {
    h->activity[a] = r_mul(fresh, h->activity[a]) + r_abs(o->forecast[a] - h->foretold[a]);
    h->foretold[a] = o->forecast[a];
  }
  if (o->slides || h->fault != FAULT_NONE) return 1;
  return learn(p, h, y, o, trust);
}

int in_range(const tse_hypothesis *h)
{
#if defined(TSE_REAL_FIXED)
  int fine = 1;
  for (int a = 0; a < TSE_X; a++) {
    fine = fine && r_is_finite(h->x[a]);
    for (int b = a; b < TSE_X; b++) fine = fine && r_is_finite(h->cov[a][b]);
  }
  return fine;
#else /* what is no number spreads to the diagonal, where is_proper() sees it */
  (void)h;
  return 1;
#endif
}

int is_proper(const tse_hypothesis *h)
{
  if (!in_range(h)) return 0; /* before sums are made of them */
  tse_real sum = TSE_R(0);
  int proper = 1;
  for (int a = 0; a < TSE_X; a++) {
    sum = r_add_sat(sum, r_abs(h->x[a]) + r_abs(h->cov[a][a]));
    proper = proper && h->cov[a][a] >= TSE_R(0);
  }
  return proper && r_is_finite(sum) && h->cov[0][0] < MOST_VAR && h->cov[1][1] < MOST_VAR &&
         r_abs(h->cov[0][1]) < MOST_VAR;
}
