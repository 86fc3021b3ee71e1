/* filter/velocity.h - update with measured velocities. Internal. */
#ifndef TSE_FILTER_VELOCITY_H
#define TSE_FILTER_VELOCITY_H

#include "filter/types.h"

/* Predict the extra states to the time of the row. They are needed only for measured
 * velocities, an optional input. */
void velocity_move(const tse_params *p, tse_kalman *k, const decoded *z);

/* Discard the heading and the stored past motion. Call it when the
 * motion is initialised again. */
void velocity_lose(tse_kalman *k);

/* Update the filter with the velocities of this row.
 *   Updated:  change  as in use_scalar() */
void velocity_update(
    const tse_params *p, tse_kalman *k, const decoded *z, const forces *f, tse_real change[TSE_ALL]);

/* Return the rejected velocity, numbered as in tse_output.fault_channel, or NO_FAULT. */
int32_t velocity_fault(const tse_kalman *k);

/* Return the model discrepancy of the lateral speed [m/s]. */
tse_real velocity_discrepancy(const tse_kalman *k);

/* Return the variance of the sum of lateral speed and its model discrepancy [m2/s2]. */
tse_real velocity_across_var(const tse_kalman *k);

#endif
