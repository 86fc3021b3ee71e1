/* estimator/settings.h - declarations shared by the files that read settings: settings.c,
 * latencies.c, prepare.c. Internal. */
#ifndef TSE_SETTINGS_H
#define TSE_SETTINGS_H

#include "model/effects.h"
#include "tse/tse.h"
#include "tables/config.h"

#define STANDARD_GRAVITY TSE_S(9.81) /* [m/s2] GRAVITY of model/laws.h, as a tse_setting */

static inline tse_real real_of(tse_setting x) { return r_from_setting(x); }

/* settings.c: return a bit mask of the active effects: those whose strength is not 0. */
uint64_t find_active_effects(const tse_config *c);

#if !defined(TSE_NO_EFFECTS)
/* settings.c: unpack the operations of the user's formula, one byte each. */
void unpack_formula(const tse_config *c, uint8_t code[TSE_FORMULA_OPS]);
#endif

/* latencies.c: check that the filter stores enough rows for the span from the smallest to
 * the largest latency. Latencies are relative to the yaw rate.
 *   Returned:  TSE_OK; or TSE_E_CONFIG and *wrong, the name of the latency of largest
 *              magnitude. In a build that allows no latencies, *wrong is the first
 *              latency that is not 0 */
tse_status check_latencies(const tse_config *c, const char **wrong);

/* latencies.c: compute ages [s] at the time of the newest row. p->latency: age of the row
 * that is then processed. p->latency_age: for each channel, time since the value in the
 * processed row was logged. */
void prepare_latencies(const tse_config *c, tse_params *p);

#endif
