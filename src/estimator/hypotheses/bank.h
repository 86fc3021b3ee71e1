/* estimator/hypotheses/bank.h - the hypotheses that are held side by side. Internal. */
#ifndef TSE_HYPOTHESES_BANK_H
#define TSE_HYPOTHESES_BANK_H

#include "estimator/stages.h"

#define bank_start          TSE_NAME(tse_bank_start)
#define bank_restart_states TSE_NAME(tse_bank_restart_states)
#define bank_predict        TSE_NAME(tse_bank_predict)
#define bank_pass           TSE_NAME(tse_bank_pass)
#define bank_learn          TSE_NAME(tse_bank_learn)
#define bank_mend           TSE_NAME(tse_bank_mend)
#define bank_still          TSE_NAME(tse_bank_still)
#define bank_mean           TSE_NAME(tse_bank_mean)

/* The first row, or the first that has inputs. */
void bank_start(const tse_params *p, tse_bank *b, const tse_start *s, const sample *y);

/* From the last row to this one; push: what effects add to the states. */
void bank_predict(const tse_params *p, tse_bank *b, course from, course to, const tse_real push[3], tse_real dt);

/* Time goes by and nothing is known of the motion; states are placed anew from the sensors. */
void bank_pass(const tse_params *p, tse_bank *b, tse_real dt);
void bank_restart_states(const tse_params *p, tse_bank *b, const sample *y);

/* Births, weights and what every hypothesis learns. raw: channels as logged.  Returned: log2 evidence of the row in SI units. */
tse_real bank_learn(const tse_params *p, tse_bank *b, const sample *y, const tse_real raw[6]);

/* After a row of which nothing is learnt: states of which nothing is known any more are placed anew. */
void bank_mend(const tse_params *p, tse_bank *b, const sample *y);

/* While the wheels stand still the yaw rate is zero, so the gyro reads its bias. */
void bank_still(tse_bank *b, const sample *y);

/* vel_x, vel_y, yaw rate and the deviations of the stiffness, of the likeliest; with_eps: as the motion of this row has them. */
void bank_mean(const tse_bank *b, int with_eps, tse_real at[6]);

#endif
