/* filter/step.h - processing of a row. Internal. */
#ifndef TSE_FILTER_STEP_H
#define TSE_FILTER_STEP_H

#include "filter/types.h"

/* Process a row: tse_step() of the default filter. */
tse_status step_row(const tse_params *p, tse_filter *f, const tse_input *u, tse_output *out);

#endif
