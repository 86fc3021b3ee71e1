/* filter/update.h - update with the measurements of a row. Internal. */
#ifndef TSE_FILTER_UPDATE_H
#define TSE_FILTER_UPDATE_H

#include "filter/types.h"

/* Update the filter with the measurements of the row, one after the other.
 *   Given:  u  angle of the front wheels at the previous row and at this row, from
 *              predict_row() */
STAGE void update_row(const tse_params *p, tse_kalman *k, const decoded *z, steering u);

/* Update the gyro bias at standstill. */
void update_at_standstill(const tse_params *p, tse_kalman *k, const decoded *z);

#endif
