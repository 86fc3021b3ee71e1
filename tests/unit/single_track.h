/* tests/unit/single_track.h - the single-track model (1)-(4) in another form than
 * src/model/vehicle.h: forces in newtons, mass and inertia, slip relative to at least 1
 * m/s, absolute speeds. It is integrated by Runge-Kutta in steps of 1/200 of the fastest
 * tyre mode. A Kalman filter of it. Include it once, after unit_support.h. */
#ifndef SINGLE_TRACK_H
#define SINGLE_TRACK_H

#include <math.h>

/* mass, yaw inertia, lf, lr, Cx front, Cx rear, Cy front, Cy rear, share of the front's
 * deviation that the rear takes */
static const double car_table[3][9] = {
  { 1900.0, 3000.0, 1.25, 1.5, 160000.0, 160000.0, 120000.0, 140000.0, 1.0 },
  { 1100.0, 1500.0, 1.0, 1.375, 90000.0, 70000.0, 75000.0, 100000.0, 0.0 },
  { 2600.0, 5200.0, 1.625, 1.375, 210000.0, 240000.0, 150000.0, 170000.0, 0.5 },
};

/* Settings of car k with the default sensors. */
static inline tse_config config_of_table(int k)
{
  const double *const t = car_table[k];
  tse_config c = config_by(tse_config_exact);
  c.mass = setting(t[0]), c.yaw_inertia = setting(t[1]), c.lf = setting(t[2]), c.lr = setting(t[3]);
  c.longitudinal_stiffness_front = setting(t[4]), c.longitudinal_stiffness_rear = setting(t[5]);
  c.cornering_stiffness_front = setting(t[6]), c.cornering_stiffness_rear = setting(t[7]);
  c.rear_longitudinal_follows_front = setting(t[8]);
  return c;
}

/* Equations of motion.
 *   Given:     x      vel_x, vel_y, yaw rate
 *              u      steering angle, R omega front and rear
 *              w      deviations of the stiffness
 *   Returned:  slip   front, rear, slip angle front, rear
 *              accel  accel_x, accel_y, yaw acceleration */
static inline void single_track(const double *car, const double x[3], const double u[3], const double w[3],
    double slip[4], double accel[3])
{
  const double speed = fabs(x[0]), over = fmax(speed, 1), lf = car[2], lr = car[3];
  slip[0] = (u[1] - x[0]) / fmax(over, fabs(u[1]));
  slip[1] = (u[2] - x[0]) / fmax(over, fabs(u[2]));
  slip[2] = (u[0] * x[0] - (x[1] + lf * x[2])) / over;
  slip[3] = (lr * x[2] - x[1]) / over;
  const double fx_front = car[4] * (1 + w[0]) * slip[0], fx_rear = car[5] * (1 + car[8] * w[0]) * slip[1];
  const double fy_front = car[6] * (1 + w[1]) * slip[2], fy_rear = car[7] * (1 + w[2]) * slip[3],
               across = fy_front + fx_front * u[0];
  accel[0] = (fx_front + fx_rear - fy_front * u[0]) / car[0];
  accel[1] = (across + fy_rear) / car[0];
  accel[2] = (lf * across - lr * fy_rear) / car[1];
}

/* Return x after dt by Runge-Kutta, with linear inputs. */
static inline void track_move(const double *car, double x[3], const double w[3], const double u0[3],
    const double u1[3], double dt, int steps)
{
  static const double at[4] = { 0, 0.5, 0.5, 1 }, share[4] = { 1, 2, 2, 1 };
  for (int k = 0; k < steps; k++) {
    double rate[3] = { 0, 0, 0 }, sum[3] = { 0, 0, 0 };
    for (int s = 0; s < 4; s++) {
      double probe[3], u[3], slip[4], accel[3];
      for (int a = 0; a < 3; a++) {
        probe[a] = x[a] + at[s] * dt / steps * rate[a];
        u[a] = u0[a] + (u1[a] - u0[a]) * (k + at[s]) / steps;
      }
      single_track(car, probe, u, w, slip, accel);
      rate[0] = accel[0] + probe[1] * probe[2], rate[1] = accel[1] - probe[0] * probe[2], rate[2] = accel[2];
      for (int a = 0; a < 3; a++) sum[a] += share[s] * rate[a];
    }
    for (int a = 0; a < 3; a++) x[a] += dt / steps / 6 * sum[a];
  }
}

enum { DRIVES = 11 };

/* Drive i: car | duration | state at the start (3) | inputs at the start (3) and at the
 * end (3), linear in between | w (3) | state at the end (3) | time constant of the
 * fastest tyre mode at the start. */
static inline const double *single_track_drive(int i)
{
  static const double drives[DRIVES][4] = {
    /* speed, duration, change of R omega, steering angle at the end */
    { 0.3, 0.4, 0.2, 0.1 },
    { 0.6, 0.4, 0.3, -0.2 },
    { 2.0, 0.5, 0.8, 0.15 },
    { 5.0, 0.8, 1.0, -0.1 },
    { 10.0, 1.0, 1.5, 0.06 },
    { 20.0, 1.0, 2.0, 0.04 },
    { 20.0, 1.0, -2.5, -0.05 },
    { 40.0, 1.0, 1.5, -0.03 },
    { 70.0, 1.0, 1.0, 0.015 },
    { -5.0, 0.8, -1.0, 0.1 },
    { -0.5, 0.4, -0.2, 0.2 },
  };
  static double table[DRIVES][18];
  double *const t = table[i], speed = drives[i][0], steer = drives[i][3], change = drives[i][2],
                way = change > 0 ? 1 : -1;
  const double *const car = car_table[i % 3];
  if (t[1] > 0) return t;
  t[0] = i % 3;
  t[1] = drives[i][1];
  t[2] = speed, t[3] = 0.02 * steer * speed, t[4] = 0.3 * steer;
  t[5] = 0.2 * steer; /* driving or braking from the start on: avoids the corners of max() */
  t[6] = fabs(speed) < 1 ? speed + 0.02 * way : speed + 0.004 * way * fabs(speed);
  t[7] = fabs(speed) < 1 ? speed + 0.02 * way : speed + 0.006 * way * fabs(speed);
  t[8] = steer, t[9] = t[6] + change, t[10] = t[7] + 1.1 * change;
  for (int a = 0; a < 3; a++)
    t[11 + a] = (a == 0 ? 0.3 : a == 1 ? -0.25 : 0.2) * (i % 2 ? -1 : 1), t[14 + a] = t[2 + a];
  t[17] = car[0] * fmax(fabs(speed), 1) / (1 + (i % 2 ? 0.25 : 0.3)) / (car[4] + car[5]);
  track_move(car, t + 14, t + 11, t + 5, t + 8, t[1], (int)ceil(200 * t[1] / t[17]));
  return t;
}

/* An extended Kalman filter of nine states in dense matrices, to test filters: the model
 * above, with slopes by differences. States: vel_x, vel_y, yaw rate; deviations of the
 * stiffness; biases. Either the deviations are constant and the tyres scatter about them
 * by `spread`, or they are white noise of that sd, estimated with the sample that they
 * affect. So the correlation of process and measurement noise is included. */
typedef struct dense_kalman {
  const double *car; /* row of car_table */
  double mean[9], cov[9][9], sd[3], walk[3], spread;
  int white;
} dense_kalman;

/* Return the readings of accelerometers and gyro, with biases. */
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
