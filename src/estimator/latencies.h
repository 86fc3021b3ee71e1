/* estimator/latencies.h - latencies of the channels. Internal. */
#ifndef TSE_LATENCIES_H
#define TSE_LATENCIES_H

#include "model/state.h"
#include "tables/names.h"
#include "tse/tse.h"

/* Check that the filter stores enough rows for the span from the smallest to the largest
 * latency. Latencies are relative to the yaw rate.
 *   Returned:  TSE_OK; or TSE_E_CONFIG and *wrong, the name of the latency of largest
 *              magnitude. In a build that allows no latencies, *wrong is the first
 *              latency that is not 0 */
tse_status check_latencies(const tse_config *c, const char **wrong);

/* Compute ages [s] at the time of the newest row. p->latency: age of the row that is then
 * processed. p->latency_age: for each channel, time since the value in the processed row
 * was logged. Also compute p->velocity_late, p->latency_span and p->latency_least. */
void prepare_latencies(const tse_config *c, tse_params *p);

#endif
