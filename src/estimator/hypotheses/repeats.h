/* estimator/hypotheses/repeats.h - values that repeat themselves to the last bit, as evidence that a channel is stuck. Internal. */
#ifndef TSE_HYPOTHESES_REPEATS_H
#define TSE_HYPOTHESES_REPEATS_H

#include "estimator/hypotheses/innovate.h"

#define watch_repeats      TSE_NAME(tse_watch_repeats)
#define evidence_of_repeat TSE_NAME(tse_evidence_of_repeat)
#define promise_of_repeat  TSE_NAME(tse_promise_of_repeat)

/* now: the row's channels as logged; there: 0 where one is missing, or may rest by nature. */
void watch_repeats(tse_repeats *r, const tse_real now[6], const int32_t there[6]);

/* log2 of what this row's repeats say for hypothesis h, in place of the density of the channel that it says is at fault. */
tse_real evidence_of_repeat(const tse_repeats *r, const tse_hypothesis *h, const innovation *o);

/* The same for a birth that says so of `channel` (0..5), whose reading then has the variance q along v more. */
tse_real promise_of_repeat(const tse_repeats *r, const innovation *o, const tse_real v[3], tse_real q, int channel);

#endif
