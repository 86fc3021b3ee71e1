/* estimator/hypotheses/learn.h - spread and noise inside a regime. Internal. */
#ifndef TSE_HYPOTHESES_LEARN_H
#define TSE_HYPOTHESES_LEARN_H

#include "estimator/hypotheses/innovate.h"

#define learn TSE_NAME(tse_hypothesis_learn)

/* One step of spread_var and noise_var along the score of the evidence of this sample. trust: share of it that counts.
 *   Returned:  0: in fixed point, what has been learnt of them all would leave the range of the format; nothing has changed */
int learn(const tse_params *p, tse_hypothesis *h, const sample *y, const innovation *o, tse_real trust);

#endif
