/* filter/sensitivities.h - sensitivities of the state to events and consider parameters.
 * Internal. */
#ifndef TSE_FILTER_SENSITIVITIES_H
#define TSE_FILTER_SENSITIVITIES_H

#include "filter/types.h"

/* Sensitivities: shift of the state per unit of the amplitude of each event
 * (tse_event.v), and per sd of each consider parameter (tse_kalman.consider). A consider
 * parameter is uncertain and not estimated. Its uncertainty is included in the gains and
 * variances (Schmidt-Kalman filter). */

/* Propagate the sensitivities over the time step dt of a row.
 *   Given:  M  transition matrix in units of the states: first the columns of the states,
 *              as for ud_move(), then the partial derivatives with respect to the
 *              consider parameters, in the number format of r_short() */
void sensitivities_move(const tse_params *p, tse_kalman *k, tse_short M[MOTION][PLACES], tse_real dt);

/* Return whether, for each event and consider parameter, the sum of squares of the
 * sensitivities of the states of the motion is below MAX_D. A larger sum means that the
 * prediction of the motion has diverged. */
int are_sensitivities_known(const tse_kalman *k);

/* Set the sensitivities of the first `count` states to 0. */
void sensitivities_clear(tse_kalman *k, int count);

/* Multiply all sensitivities of state i by `left`. */
void sensitivities_fade(tse_kalman *k, int i, tse_real left);

/* Return the variance of state i [unit^2], including the part that uncertain consider
 * parameters cause. */
tse_real compute_total_variance(const tse_kalman *k, int i);

#endif
