/* estimator/settings.h - functions that read settings. Internal. */
#ifndef TSE_SETTINGS_H
#define TSE_SETTINGS_H

#include "model/effects.h"
#include "tse/tse.h"
#include "tables/config.h"

#define STANDARD_GRAVITY TSE_S(9.81) /* [m/s2] GRAVITY of model/laws.h, as a tse_setting */

static inline tse_real real_of(tse_setting x) { return r_from_setting(x); }

/* Return a bit mask of the active effects: those with a strength other than 0. */
uint64_t find_active_effects(const tse_config *c);

#if !defined(TSE_NO_EFFECTS)
/* Unpack the operations of the user's formula, one byte each. */
void unpack_formula(const tse_config *c, uint8_t code[TSE_FORMULA_OPS]);
#endif

#endif
