/* estimator/settings.h - shared by the files that read settings: settings.c, latencies.c,
 * prepare.c. Internal. */
#ifndef TSE_SETTINGS_H
#define TSE_SETTINGS_H

#include "model/effects.h"
#include "tse/tse.h"
#include "tables/config.h"

#define STANDARD_GRAVITY TSE_S(9.81) /* m/s2: GRAVITY of model/laws.h as a setting */

static inline tse_real real_of(tse_setting x) { return r_from_setting(x); }

/* settings.c: return the bits of the active effects: a strength is not 0. */
uint64_t find_active_effects(const tse_config *c);

#if !defined(TSE_NO_EFFECTS)
/* settings.c: unpack the operations of a formula, one byte each. */
void unpack_formula(const tse_config *c, uint8_t code[TSE_FORMULA_OPS]);
#endif

/* latencies.c: return TSE_OK if the filter keeps enough rows for the span of the latencies.
 * *wrong: the channel furthest from the gyro; without latencies in the build the first late
 * channel. */
tse_status check_latencies(const tse_config *c, const char **wrong);

/* latencies.c: compute the age of a row when it is processed, and of each of its channels. */
void prepare_latencies(const tse_config *c, tse_params *p);

#endif
