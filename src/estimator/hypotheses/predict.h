/* estimator/hypotheses/predict.h - a hypothesis through the time between two rows. Internal. */
#ifndef TSE_HYPOTHESES_PREDICT_H
#define TSE_HYPOTHESES_PREDICT_H

#include "estimator/hypotheses/hypothesis.h"

#define predict TSE_NAME(tse_hypothesis_predict)
#define walk    TSE_NAME(tse_hypothesis_walk)

/* What a step, or a row, does to small changes of the state (F), of the stiffness (G), of eps (E), and of the lag (L). */
typedef struct transition { tse_real F[3][3], G[3][3], E[3][3], L[3]; } transition;

/* X and P from the row before (`from`) to this one (`to`), dt later, (7); push: what effects add to the states; did: NULL, or where what the row does goes. O(1) time. */
void predict(const tse_params *p, tse_hypothesis *h, course from, course to, const tse_real push[3], tse_real dt, transition *did);

/* Only what goes on when nothing is known of the motion: drift, walks, fading disturbances. */
void walk(const tse_params *p, tse_hypothesis *h, tse_real dt);

#endif
