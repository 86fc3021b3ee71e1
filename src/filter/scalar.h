/* filter/scalar.h - update with one scalar measurement. Internal. */
#ifndef TSE_FILTER_SCALAR_H
#define TSE_FILTER_SCALAR_H

#include "filter/types.h"

/* Update the filter with one measurement.
 *   Given:     channel  ACCEL_X ..., or NO_SENSOR_LONGITUDINAL or NO_SENSOR_LATERAL for a
 *                       measured velocity or a pseudo-measurement
 *              sd       sd of the sensor
 *   Updated:   change   sum of the corrections of this row, in units of the state
 *   Returned:  the variance S of the innovation, as used for the gain (scalar.c)
 *              *state   the part of S due to the uncertainty of the state and of the
 *                       consider parameters: S without measurement noise */
tse_real use_scalar(
    tse_kalman *k, int channel, const scalar *m, tse_real sd, tse_real change[TSE_ALL], tse_real *state);

/* Update the estimated white noise of a channel: half the mean square of the difference
 * between successive innovations. Slow errors cancel in this difference, and it has twice
 * the variance of the white noise.
 *   Given:    difference  between the last two innovations
 *             nominal     noise variance by the settings
 *             share       gain of the running mean
 *   Updated:  noise       ratio of the estimated noise variance to nominal */
static inline void learn_noise(
    const tse_params *p, tse_real *noise, tse_real difference, tse_real nominal, tse_real share)
{
  const tse_real seen = r_min(r_div(r_mul(TSE_R(0.5), r_sqr(difference)), r_mul(nominal, *noise)), TAIL);
  *noise = r_clamp(
      r_mul(*noise, TSE_R(1) + r_mul(r_min(share, MAX_GAIN), seen - TSE_R(1))), MIN_NOISE, p->noise_max_var);
}

#endif
