/* estimator/hypotheses/regimes.h - what may have happened: births of hypotheses. Internal. */
#ifndef TSE_HYPOTHESES_REGIMES_H
#define TSE_HYPOTHESES_REGIMES_H

#include "estimator/hypotheses/repeats.h"

#define births            TSE_NAME(tse_births)
#define rate_of_end       TSE_NAME(tse_rate_of_end)
#define place_states      TSE_NAME(tse_place_states)
#define start_hypothesis  TSE_NAME(tse_start_hypothesis)

/* Where a hypothesis starts, or its states do: from wheel speeds and gyro. */
void start_hypothesis(const tse_params *p, tse_hypothesis *h, const tse_start *s, const sample *y);
void place_states(const tse_params *p, tse_hypothesis *h, const sample *y);

/* Rate at which what h says lasts - a drift, a fault - ends [1/s]: it pays for every second that it does not (a Markov chain of
 * regimes: Blom & Bar-Shalom 1988). */
tse_real rate_of_end(const tse_hypothesis *h);

/* The births of a row, o: of the likeliest hypothesis, before it is updated. O(1) time: so many are tried, no more. */
void births(const tse_params *p, tse_bank *b, const sample *y, const innovation *o);

#endif
