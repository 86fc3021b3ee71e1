/* filter/plausible.h - channels that contradict each other. Internal. */
#ifndef TSE_FILTER_PLAUSIBLE_H
#define TSE_FILTER_PLAUSIBLE_H

#include "filter/types.h"

/* Compare the channels of a row with each other, to find channels with a wrong unit or
 * sign, and wheel speeds of the wrong axle.
 *   Given:     no_second  1: the wheel speeds of the two axles cannot be compared
 *                         (decoded.no_second)
 *   Updated:   k->agreement
 *   O(1) time */
STAGE void check_agreement(
    const tse_params *p, tse_kalman *k, const tse_input *u, tse_real dt, int no_second);

/* Return the number of the channel that contradicts the others, as in
 * tse_output.fault_channel, or 0.
 *   Returned:  *factor  (logged value)/(true value) of this channel; negative if its
 *                       sign is wrong. 0: no channel, or the error is not a factor, for
 *                       example a latency */
int32_t find_implausible_channel(const tse_kalman *k, tse_real *factor);

#endif
