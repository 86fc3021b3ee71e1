/* tests/bench/ekf.h - a plain extended Kalman filter of the same nine states, as the
 * reference for the cost of a row.
 *
 * Textbook: dense matrices, analytic Jacobians, the spread of the stiffness as noise of
 * measurement and motion (taken as independent), all noise known, no checks. Compiled
 * like the library. */
#ifndef BENCH_EKF_H
#define BENCH_EKF_H

#include "tse/tse.h"

typedef struct ekf {
  /* vel_x, vel_y, yaw_rate; cx_front, cy_front, cy_rear relative to nominal; biases of
   * accel_x, accel_y, yaw_rate */
  tse_real x[9], p[9][9];
  tse_real u[3];                                 /* steering angle, R omega front and rear at the last row */
  tse_real kx_front, kx_rear, ky_front, ky_rear; /* stiffness over mass */
  tse_real follows, lf, lr, jf, jr, radius_front, radius_rear;
  tse_real spread_var, noise_var[3], walk_var[3]; /* known; walk: per second */
} ekf;

/* Start at a row: speed from the wheels, straight ahead.
 *   Given:  spread  sd of the stiffness, relative to nominal */
void ekf_start(ekf *f, const tse_config *c, tse_real spread, const tse_input *row);

/* Predict to a row, unless it is the first, and update with it. No channel may be
 * missing. */
void ekf_step(ekf *f, const tse_input *row, int first);

#endif
