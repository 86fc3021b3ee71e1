/* tests/unit/single_track.h - the single-track model (1)-(4) in another form than src/model/vehicle.h: forces in newtons, mass and
 * inertia, slip over at least 1 m/s, absolute speeds; integrated by Runge and Kutta in a 200th of the fastest tyre mode. */
#ifndef SINGLE_TRACK_H
#define SINGLE_TRACK_H

#include <math.h>

/* mass, yaw inertia, lf, lr, Cx front, Cx rear, Cy front, Cy rear, share of the front's deviation that the rear takes */
static const double car_table[3][9] = {
  { 1900.0, 3000.0, 1.25, 1.5, 160000.0, 160000.0, 120000.0, 140000.0, 1.0 },
  { 1100.0, 1500.0, 1.0, 1.375, 90000.0, 70000.0, 75000.0, 100000.0, 0.0 },
  { 2600.0, 5200.0, 1.625, 1.375, 210000.0, 240000.0, 150000.0, 170000.0, 0.5 },
};

/* x: vel_x, vel_y, yaw rate; u: steering angle, R omega front and rear; w: deviations of the stiffness.
 * slip: front, rear, slip angle front, rear; accel: accel_x, accel_y, yaw acceleration. */
static inline void single_track(const double *car, const double x[3], const double u[3], const double w[3], double slip[4], double accel[3])
{
  const double speed = fabs(x[0]), over = fmax(speed, 1), lf = car[2], lr = car[3];
  slip[0] = (u[1] - x[0]) / fmax(over, fabs(u[1]));
  slip[1] = (u[2] - x[0]) / fmax(over, fabs(u[2]));
  slip[2] = (u[0] * x[0] - (x[1] + lf * x[2])) / over;
  slip[3] = (lr * x[2] - x[1]) / over;
  const double fx_front = car[4] * (1 + w[0]) * slip[0], fx_rear = car[5] * (1 + car[8] * w[0]) * slip[1];
  const double fy_front = car[6] * (1 + w[1]) * slip[2], fy_rear = car[7] * (1 + w[2]) * slip[3], across = fy_front + fx_front * u[0];
  accel[0] = (fx_front + fx_rear - fy_front * u[0]) / car[0];
  accel[1] = (across + fy_rear) / car[0];
  accel[2] = (lf * across - lr * fy_rear) / car[1];
}

/* x after dt by Runge and Kutta, inputs linear in between. */
static inline void track_move(const double *car, double x[3], const double w[3], const double u0[3], const double u1[3], double dt, int steps)
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

/* Drive i: car | duration | state at the start (3) | inputs at the start (3), at the end (3), linear between | w (3) |
 * state at the end (3) | time constant of the fastest tyre mode at the start. */
static inline const double *single_track_drive(int i)
{
  static const double drives[DRIVES][4] = { /* speed, duration, change of R omega, steering angle at the end */
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
                                            { -0.5, 0.4, -0.2, 0.2 }
  };
  static double table[DRIVES][18];
  double *const t = table[i], speed = drives[i][0], steer = drives[i][3], change = drives[i][2], way = change > 0 ? 1 : -1;
  const double *const car = car_table[i % 3];
  if (t[1] > 0) return t;
  t[0] = i % 3;
  t[1] = drives[i][1];
  t[2] = speed, t[3] = 0.02 * steer * speed, t[4] = 0.3 * steer;
  t[5] = 0.2 * steer; /* driving or braking from the start: no corner of max() is crossed */
  t[6] = fabs(speed) < 1 ? speed + 0.02 * way : speed + 0.004 * way * fabs(speed);
  t[7] = fabs(speed) < 1 ? speed + 0.02 * way : speed + 0.006 * way * fabs(speed);
  t[8] = steer, t[9] = t[6] + change, t[10] = t[7] + 1.1 * change;
  for (int a = 0; a < 3; a++) t[11 + a] = (a == 0 ? 0.3 : a == 1 ? -0.25
                                                                 : 0.2) *
                                          (i % 2 ? -1 : 1),
                                     t[14 + a] = t[2 + a];
  t[17] = car[0] * fmax(fabs(speed), 1) / (1 + (i % 2 ? 0.25 : 0.3)) / (car[4] + car[5]);
  track_move(car, t + 14, t + 11, t + 5, t + 8, t[1], (int)ceil(200 * t[1] / t[17]));
  return t;
}

#endif
