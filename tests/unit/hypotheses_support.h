/* tests/unit/hypotheses_support.h - what the tests of the default form share: forces and dense algebra written another way, in
 * double. Included once, after unit_support.h. */
#ifndef HYPOTHESES_SUPPORT_H
#define HYPOTHESES_SUPPORT_H

#include "estimator/hypotheses/innovate.h"

enum { JOINT = TSE_X + 3 }; /* X and this row's eps */

/* Forces over mass by their definition: longitudinal, lateral front, lateral rear [m/s2]. x: states, stiffnesses; u: inputs. */
static inline void ref_forces(const tse_params *p, const double x[6], const double u[3], double force[3])
{
  const double v = fmax(fabs(x[0]), 1.0);
  const double sf = (u[1] - x[0]) / fmax(v, fabs(u[1])), sr = (u[2] - x[0]) / fmax(v, fabs(u[2]));
  const double af = (u[0] * x[0] - x[1] - number(p->lf) * x[2]) / v, ar = (number(p->lr) * x[2] - x[1]) / v;
  const double xf = number(p->kx_front) * x[3] * sf, xr = number(p->kx_rear) * (1 + number(p->follow) * (x[3] - 1)) * sr;
  const double yf = number(p->ky_front) * x[4] * af;
  force[0] = xf + xr - yf * u[0];
  force[1] = yf + xf * u[0];
  force[2] = number(p->ky_rear) * x[5] * ar;
}

static inline inputs inputs_of(double steer, double front, double rear)
{
  inputs u;
  u.steer = real(steer);
  u.v_front = real(front);
  u.v_rear = real(rear);
  return u;
}

/* Inputs, and a late steering angle that is so much more. */
static inline course course_of(inputs now, double later)
{
  course c;
  c.now = now;
  c.late_steer = real(number(now.steer) + later);
  return c;
}

static inline course steadily(inputs now) { return course_of(now, 0); }

/* A random joint covariance of X and eps, of full rank, with sensible sizes. */
static inline void random_joint(uint32_t *seed, double P[JOINT][JOINT])
{
  static const double sd[JOINT] = { 0.05, 0.03, 0.02, 0.1, 0.08, 0.12, 0.3, 0.4, 0.2, 0.2, 0.3, 0.25, 0.001, 0.5, 0.05, 0.06, 0.04 };
  double G[JOINT][2 * JOINT];
  for (int i = 0; i < JOINT; i++)
    for (int k = 0; k < 2 * JOINT; k++) G[i][k] = next_between(seed, -1, 1);
  for (int i = 0; i < JOINT; i++)
    for (int j = 0; j < JOINT; j++) {
      P[i][j] = 0;
      for (int k = 0; k < 2 * JOINT; k++) P[i][j] += 3 * G[i][k] * G[j][k] / (2 * JOINT);
      P[i][j] *= sd[i] * sd[j];
    }
}

/* A hypothesis in the middle of a turn. P: joint covariance that it has then; without_eps: eps is new. */
static inline tse_hypothesis some_hypothesis(const tse_params *p, uint32_t *seed, int without_eps, double P[JOINT][JOINT])
{
  tse_hypothesis h;
  memset(&h, 0, sizeof h);
  random_joint(seed, P);
  const double x[TSE_X] = { next_between(seed, 15, 25), next_between(seed, -0.5, 0.5), next_between(seed, -0.3, 0.3),
                            next_between(seed, 0.7, 1.3), next_between(seed, 0.7, 1.3), next_between(seed, 0.7, 1.3),
                            0.3, -0.2, 0.1, 0.2, 0.1, -0.3, 0.0005, 0.6 };
  for (int i = 0; i < TSE_X; i++) {
    h.x[i] = real(x[i]);
    for (int j = 0; j < TSE_X; j++) h.cov[i][j] = real(P[i][j]);
  }
  for (int a = 0; a < 3; a++) {
    h.eps[a] = real(without_eps ? 0 : next_between(seed, -0.05, 0.05));
    for (int i = 0; i < TSE_X; i++) {
      if (without_eps) P[TSE_X + a][i] = P[i][TSE_X + a] = 0;
      h.eps_x[a][i] = real(P[TSE_X + a][i]);
    }
    for (int b = 0; b < 3; b++) {
      if (without_eps) P[TSE_X + a][TSE_X + b] = 0;
      h.eps_cov[a][b] = real(P[TSE_X + a][TSE_X + b]);
    }
    h.spread_var[a] = real(0.0025 * (1 + a));
    h.noise_var[a] = real(1 + 0.3 * a);
    h.activity[a] = real(1);
    h.info[a][a] = real(1);
    h.info[3 + a][3 + a] = real(2);
    h.level[a] = 1;
  }
  (void)p;
  return h;
}

static inline sample some_sample(uint32_t *seed, const tse_hypothesis *h, double off, int mask)
{
  sample y;
  memset(&y, 0, sizeof y);
  const double v = number(h->x[0]);
  y.u = inputs_of(next_between(seed, -0.04, 0.04), v * (1 + next_between(seed, -0.01, 0.01)), v * (1 + next_between(seed, -0.01, 0.01)));
  y.late_steer = real(number(y.u.steer) + next_between(seed, -0.01, 0.01));
  y.dt = real(0.01);
  y.has_inputs = y.has_steer = 1;
  for (int a = 0; a < 3; a++) {
    y.use[a] = real((mask >> a) & 1);
    y.used += (mask >> a) & 1;
    y.y[a] = real((mask >> a & 1) ? off * next_between(seed, -1, 1) : 0);
  }
  return y;
}

/* A x = b by elimination with pivots; A and b are used up. */
static inline void dense_solve(int n, double *A, double *b, int columns)
{
  for (int k = 0; k < n; k++) {
    int pivot = k;
    for (int i = k + 1; i < n; i++)
      if (fabs(A[i * n + k]) > fabs(A[pivot * n + k])) pivot = i;
    for (int j = 0; j < n; j++) { const double t = A[k * n + j]; A[k * n + j] = A[pivot * n + j]; A[pivot * n + j] = t; }
    for (int j = 0; j < columns; j++) { const double t = b[k * columns + j]; b[k * columns + j] = b[pivot * columns + j]; b[pivot * columns + j] = t; }
    for (int i = 0; i < n; i++) {
      const double l = i == k ? 0 : A[i * n + k] / A[k * n + k];
      for (int j = 0; j < n && i != k; j++) A[i * n + j] -= l * A[k * n + j];
      for (int j = 0; j < columns && i != k; j++) b[i * columns + j] -= l * b[k * columns + j];
    }
  }
  for (int i = 0; i < n; i++)
    for (int j = 0; j < columns; j++) b[i * columns + j] /= A[i * n + i];
}

static inline double det3(double s[3][3])
{
  return s[0][0] * (s[1][1] * s[2][2] - s[1][2] * s[2][1]) - s[0][1] * (s[1][0] * s[2][2] - s[1][2] * s[2][0]) +
         s[0][2] * (s[1][0] * s[2][1] - s[1][1] * s[2][0]);
}

/* What the sensors are foretold to read, in sigma, from X and eps; a missing one reads 0. eps: of the stiffnesses. */
static inline void ref_forecast(const tse_params *p, const sample *y, const double z[JOINT], const double u[3], double read[3])
{
  double at[6] = { z[0], z[1], z[2], z[3] + z[TSE_X], z[4] + z[TSE_X + 1], z[5] + z[TSE_X + 2] }, force[3];
  const double acts[3] = { u[0] + z[X_LAG] * (number(y->late_steer) - u[0]), u[1], u[2] };
  ref_forces(p, at, acts, force);
  const double plain[3] = { number(p->inv_sd[0]) * force[0], number(p->inv_sd[1]) * (force[1] + force[2]), number(p->inv_sd[2]) * z[2] };
  for (int a = 0; a < 3; a++) read[a] = number(y->use[a]) * (plain[a] + z[X_BIAS + a] + z[X_SLOW + a]);
}

/* Its slopes by central differences. */
static inline void ref_slopes(const tse_params *p, const sample *y, const double z[JOINT], double H[3][JOINT])
{
  const double u[3] = { number(y->u.steer), number(y->u.v_front), number(y->u.v_rear) };
  for (int k = 0; k < JOINT; k++) {
    double lo[JOINT], hi[JOINT], below[3], above[3];
    memcpy(lo, z, sizeof lo);
    memcpy(hi, z, sizeof hi);
    lo[k] -= 1e-6;
    hi[k] += 1e-6;
    ref_forecast(p, y, lo, u, below);
    ref_forecast(p, y, hi, u, above);
    for (int a = 0; a < 3; a++) H[a][k] = (above[a] - below[a]) / 2e-6;
  }
}

#endif
