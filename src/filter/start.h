/* filter/start.h - initialisation of state and motion. Internal. */
#ifndef TSE_FILTER_START_H
#define TSE_FILTER_START_H

#include "filter/types.h"

/* Initialise state and covariance from the prior, or from a learnt
 * state if one was loaded. */
STAGE void start_state(const tse_params *p, tse_filter *f);

/* Initialise the motion from wheel speed and gyro, and set the two low passes that delay
 * the steering angle (setting steering_lag_time) to the logged angle. */
STAGE void start_motion(const tse_params *p, tse_kalman *k, const decoded *z);

#endif
