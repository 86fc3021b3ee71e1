/* estimator/hypotheses/consider.h - what is told of the car may be off: how far estimates are off by that (Schmidt 1966). Internal.
 *
 * For each row of tse/told.def, bank.off[k] is the error of X in the likeliest hypothesis if that quantity is off by one sd of its
 * setting: a linear recursion with the transitions and gains that X itself goes by. Nothing is estimated of these quantities, and no
 * estimate changes; the sd that goes out is that of X and of all of these errors together. */
#ifndef TSE_HYPOTHESES_CONSIDER_H
#define TSE_HYPOTHESES_CONSIDER_H

#include "estimator/hypotheses/predict.h"
#include "estimator/hypotheses/innovate.h"

#define consider_begin   TSE_NAME(tse_consider_begin)
#define consider_passage TSE_NAME(tse_consider_passage)
#define consider_sample  TSE_NAME(tse_consider_sample)
#define consider_restart TSE_NAME(tse_consider_restart)
#define considered_var   TSE_NAME(tse_considered_var)

/* Before X goes through a row, from: inputs at its start; and when it has gone, by t, u: inputs at its end. */
void consider_begin(const tse_params *p, tse_bank *b, inputs from);
void consider_passage(const tse_params *p, tse_bank *b, const transition *t, inputs u, tse_real dt);

/* Through a sample, o: its innovation in the likeliest, before it has learnt of it. */
void consider_sample(const tse_params *p, tse_bank *b, const sample *y, const innovation *o);

/* States were placed anew from the sensors; with_tyres: all was. */
void consider_restart(tse_bank *b, int with_tyres);

/* Variance of X[i] by all that is considered. */
tse_real considered_var(const tse_params *p, const tse_bank *b, int i);

#endif
