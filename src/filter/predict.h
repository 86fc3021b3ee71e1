/* filter/predict.h - prediction to the time of a row. Internal. */
#ifndef TSE_FILTER_PREDICT_H
#define TSE_FILTER_PREDICT_H

#include "filter/types.h"

/* Compute the share slip^2/(slip^2 + variance of the slip) for each stiffness: from the
 * slips of both axles for the longitudinal stiffness, and from the slip angle of the
 * axle for a cornering stiffness. Partial derivatives with respect to the stiffness are
 * multiplied by this share, so that errors of the slip do not bias the stiffness
 * (errors in variables). */
void compute_signal_shares(const tse_kalman *k, tse_real share[3]);

/* Use the grade and bank of the row. GX and GY, gravity along and across the road, are
 * Ornstein-Uhlenbeck processes: each decays towards a process mean. Set this mean from
 * grade or bank, and shift the state by the change of the mean. If the log begins or
 * ceases to give grade or bank, set the state to the mean and reset its variance. Call it
 * before predict_row() or predict_slow_states(). */
void update_road(const tse_params *p, tse_kalman *k, const decoded *z);

/* Predict state and covariance to the time of the row.
 *   Returned:  angle of the front wheels at the previous row and at this row */
STAGE steering predict_row(const tse_params *p, tse_kalman *k, const decoded *z);

/* Predict the slow states only: gravity, biases, stiffness, grip, steering. If the motion
 * is unknown, call it in place of predict_row(). */
void predict_slow_states(const tse_params *p, tse_kalman *k, tse_real dt);

#endif
