/* filter/velocity.h - update with measured velocities. Internal. */
#ifndef TSE_FILTER_VELOCITY_H
#define TSE_FILTER_VELOCITY_H

#include "filter/types.h"

/* Predict the extra states to the time of the row. They are heading, model discrepancy of
 * the lateral speed, and errors of the velocity sensor (velocity.c). They are in use only
 * after a velocity, an optional input, has been measured. */
void velocity_move(const tse_params *p, tse_kalman *k, const decoded *z);

/* Discard the heading and the stored past motion. Call it when the
 * motion is initialised again. */
void velocity_lose(tse_kalman *k);

/* Update the filter with the velocities of this row.
 *   Updated:  change  sum of the corrections of this row, in units of the state */
void velocity_update(
    const tse_params *p, tse_kalman *k, const decoded *z, const forces *f, tse_real change[TSE_ALL]);

/* Return the number of the first velocity channel whose value is rejected, as in
 * tse_output.fault_channel. Return NO_FAULT if none is rejected. */
int32_t velocity_fault(const tse_kalman *k);

/* Return the model discrepancy of the lateral speed [m/s]. */
tse_real velocity_discrepancy(const tse_kalman *k);

/* Return the variance of the sum of lateral speed and its model discrepancy [m2/s2]. */
tse_real velocity_across_var(const tse_kalman *k);

#endif
