/* estimator/hypotheses/predict.h - a hypothesis through the time between two rows. Internal. */
#ifndef TSE_HYPOTHESES_PREDICT_H
#define TSE_HYPOTHESES_PREDICT_H

#include "estimator/hypotheses/hypothesis.h"

#define predict TSE_NAME(tse_hypothesis_predict)
#define walk    TSE_NAME(tse_hypothesis_walk)

/* X and P from the row before (`from`) to this one (`to`), dt later, (7); push: what effects add to the states. O(1) time. */
void predict(const tse_params *p, tse_hypothesis *h, course from, course to, const tse_real push[3], tse_real dt);

/* Only what goes on when nothing is known of the motion: drift, walks, fading disturbances. */
void walk(const tse_params *p, tse_hypothesis *h, tse_real dt);

#endif
