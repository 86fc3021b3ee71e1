/* filter/row.h - decoding of a log row. Internal. */
#ifndef TSE_FILTER_ROW_H
#define TSE_FILTER_ROW_H

#include "filter/types.h"

/* Check and decode a log row.
 *   Returned:  TSE_OK and z, or the reason why u is refused */
tse_status decode_row(const tse_params *p, const tse_filter *f, const tse_input *u, decoded *z);

#endif
