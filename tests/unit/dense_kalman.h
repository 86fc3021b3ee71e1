/* tests/unit/dense_kalman.h - an extended Kalman filter of nine states in dense matrices, for who checks a filter: the model of
 * single_track.h, differentiated by differences. States: vel_x, vel_y, yaw rate; deviations of the stiffness; biases. The
 * deviations are constant and the tyres scatter about them by `spread`, or they are white noise of that sd, which is estimated with
 * the sample that it disturbs: so the correlation of process and measurement noise is carried. After unit_support.h. */
#ifndef DENSE_KALMAN_H
#define DENSE_KALMAN_H

#include "single_track.h"

typedef struct dense_kalman {
  const double *car; /* of car_table */
  double mean[9], cov[9][9], sd[3], walk[3], spread;
  int white;
} dense_kalman;

/* What accelerometer and gyro read, biases and all. */
static inline void dense_observe(const double *car, const double s[9], const double u[3], double y[3])
{
  double slip[4];
  single_track(car, s, u, s + 3, slip, y);
  y[0] += s[6], y[1] += s[7], y[2] = s[2] + s[8];
}

static inline void dense_predict(dense_kalman *f, const double u0[3], const double u1[3], double dt)
{
  double F[9][9] = { { 0 } }, a[9], b[9];
  const double h = 1e-4, spread2 = f->spread * f->spread;
  for (int j = 0; j < 9; j++) {
    memcpy(a, f->mean, sizeof a);
    memcpy(b, f->mean, sizeof b);
    a[j] += h, b[j] -= h;
    track_move(f->car, a, a + 3, u0, u1, dt, 20);
    track_move(f->car, b, b + 3, u0, u1, dt, 20);
    for (int i = 0; i < 9; i++) F[i][j] = f->white && i / 3 == 1 ? 0 : (a[i] - b[i]) / (2 * h);
  }
  track_move(f->car, f->mean, f->mean + 3, u0, u1, dt, 20);
  for (int i = 3; i < 6 && f->white; i++) f->mean[i] = 0;
  conjugate(9, F[0], f->cov[0], f->cov[0]);
  for (int i = 0; i < 3 && !f->white; i++)
    for (int j = 0; j < 3; j++)
      for (int k = 3; k < 6; k++) f->cov[i][j] += spread2 * F[i][k] * F[j][k];
  for (int i = 0; i < 3; i++) {
    if (f->white) f->cov[3 + i][3 + i] += spread2;
    f->cov[6 + i][6 + i] += f->walk[i] * f->walk[i] * dt;
  }
}

/* Returned: log density of the channels of the mask. */
static inline double dense_update(dense_kalman *f, const double u[3], const double y[3], int mask)
{
  double H[3][9], at[3], up[3], down[3], s[3][3], G[3][9], e[3], left[3], evidence = 0;
  const double h = 1e-5;
  int use[3], n = 0;
  for (int a = 0; a < 3; a++)
    if (mask >> a & 1) use[n++] = a;
  dense_observe(f->car, f->mean, u, at);
  for (int j = 0; j < 9; j++) {
    double x[9];
    memcpy(x, f->mean, sizeof x);
    x[j] += h;
    dense_observe(f->car, x, u, up);
    x[j] -= 2 * h;
    dense_observe(f->car, x, u, down);
    for (int i = 0; i < n; i++) H[i][j] = (up[use[i]] - down[use[i]]) / (2 * h);
  }
  for (int i = 0; i < n; i++) {
    left[i] = y[use[i]] - at[use[i]];
    for (int j = 0; j < 9; j++) {
      G[i][j] = 0;
      for (int k = 0; k < 9; k++) G[i][j] += H[i][k] * f->cov[k][j];
    }
    for (int j = 0; j < n; j++) {
      s[i][j] = i == j ? f->sd[use[i]] * f->sd[use[i]] : 0;
      for (int k = 0; k < 9; k++) s[i][j] += G[i][k] * H[j][k];
      for (int k = 3; k < 6 && !f->white; k++) s[i][j] += f->spread * f->spread * H[i][k] * H[j][k];
    }
  }
  cholesky(s, n);
  forward(s, n, left, e);
  for (int i = 0; i < n; i++) evidence -= 0.5 * (e[i] * e[i] + log(6.283185307179586)) + log(s[i][i]);
  for (int j = 0; j < 9; j++) {
    double column[3], g[3];
    for (int i = 0; i < n; i++) column[i] = G[i][j];
    forward(s, n, column, g);
    for (int i = 0; i < n; i++) G[i][j] = g[i], f->mean[j] += g[i] * e[i];
  }
  for (int i = 0; i < 9; i++)
    for (int j = 0; j < 9; j++)
      for (int k = 0; k < n; k++) f->cov[i][j] -= G[k][i] * G[k][j];
  return evidence;
}

#endif
