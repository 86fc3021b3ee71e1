/* filter/faults.h - frozen channels and channels at fault. Internal. */
#ifndef TSE_FILTER_FAULTS_H
#define TSE_FILTER_FAULTS_H

#include "filter/types.h"

/* Return whether a channel is frozen, i.e. repeats its value although it should change.
 *   Given:  channel  ACCEL_X ..., or STEERING for the steering angle */
int is_frozen(const tse_kalman *k, int channel);

/* Return whether a sensor is neither frozen nor at fault. */
int is_usable(const tse_kalman *k, int channel);

/* Update the evidence that channel c is frozen. z is the new reading of the channel.
 *   Given:    nis    ratio of the squared innovation to the noise variance of the channel
 *                    (not to the variance of the innovation, which also includes the
 *                    uncertainty of the prediction). If the ratio is small, a repeated
 *                    value agrees with the prediction and is only weak evidence
 *             least  min probability that a working channel repeats its value */
void watch_repeats(tse_kalman *k, int c, tse_real z, tse_real nis, tse_real least, tse_real dt);

/* Update the evidence that the steering angle is frozen: the angle repeats while the yaw
 * rate contradicts it. A frozen angle is treated as missing.
 *   Updated:   z->has_steer
 *   Returned:  1 in the row in which the angle turns out to be frozen, otherwise 0 */
int watch_steering(tse_kalman *k, decoded *z);

/* Compute the innovation of a channel that is not used for the update, and the variance
 * of that innovation. If the channel is the one at fault, update the time for which it
 * has agreed with the prediction. */
void watch_fault(tse_kalman *k, int channel, const scalar *m);

#endif
