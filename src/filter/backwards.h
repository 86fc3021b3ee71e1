/* filter/backwards.h - detection of reverse. Internal. */
#ifndef TSE_FILTER_BACKWARDS_H
#define TSE_FILTER_BACKWARDS_H

#include "filter/types.h"

/* Return whether the car rolls backwards. This is also found if the wheel speeds have no
 * sign.
 *   Given:     z      this row
 *              speed  [m/s] magnitude of the speed of the faster axle or, without wheel
 *                     speeds, |v_x|
 *   Updated:   f->way  log odds of reverse, and the data from which they follow
 *   O(1) time */
int rolls_backwards(const tse_params *p, tse_filter *f, const decoded *z, tse_real speed);

#endif
