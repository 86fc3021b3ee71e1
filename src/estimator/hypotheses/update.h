/* estimator/hypotheses/update.h - what a sample teaches a hypothesis. Internal. */
#ifndef TSE_HYPOTHESES_UPDATE_H
#define TSE_HYPOTHESES_UPDATE_H

#include "estimator/hypotheses/innovate.h"

#define update    TSE_NAME(tse_hypothesis_update)
#define is_proper TSE_NAME(tse_hypothesis_is_proper)
#define in_range  TSE_NAME(tse_hypothesis_in_range)

/* X, P, this row's eps, spread and noise given the sample whose innovation is o.   Returned: 0: as learn() */
int update(const tse_params *p, tse_hypothesis *h, const sample *y, const innovation *o);

/* 0: not made of numbers any more, or of a covariance, or linear in nothing. */
int is_proper(const tse_hypothesis *h);

/* 0: in fixed point, a number of X or P has stopped at the end of the range. */
int in_range(const tse_hypothesis *h);

#endif
