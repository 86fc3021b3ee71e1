/* filter/events.h - events: hypotheses, evidence, decisions. Internal. */
#ifndef TSE_FILTER_EVENTS_H
#define TSE_FILTER_EVENTS_H

#include "filter/types.h"

/* Posterior of the amplitude w of an event. The event shifts the state by w v, v being
 * the sensitivity of the state (tse_event.v). A different road surface (EVENT_ROAD)
 * has a second amplitude w2, with the sensitivity v2, which shifts the state by w2 v2
 * in addition. The same samples determine both amplitudes, so that they are correlated.
 * For a given w, the mean of w2 is beside - part w, with the members `beside` and `part`
 * below. The mean shift of the state for a given w is therefore
 * w v + (beside - part w) v2 = w (v - part v2) + beside v2. */
typedef struct event_posterior {
  tse_real amplitude, var;     /* mean and variance of w */
  tse_real info, score;        /* info: information of the samples on w (1/variance).
                                * score: d ln(likelihood)/dw at w = 0 */
  tse_real part;               /* decrease of the mean of w2 per unit of w; 0 without w2 */
  tse_real beside, beside_var; /* beside: mean of w2 at w = 0. beside_var: variance of w2 for a given w.
                                * Both are 0 without w2 */
  const tse_event *second;     /* event of w2, with v2; NULL without w2 */
} event_posterior;

/* Return the posterior of the amplitude of the event in slot n. */
event_posterior compute_posterior(const tse_kalman *k, int n);

/* Return whether the event in slot n is too small to need a reaction. */
int event_is_small(const tse_kalman *k, int n);

/* Return the regime TSE_REGIME_* that starts with a kind of event. */
int32_t event_regime(int32_t which);

/* Return whether a kind of event changes the stiffness: of all tyres (a different road),
 * or of the tyres of one axle. */
int is_tyre_change(int32_t which);

/* Return the number of the channel that a kind of event makes faulty, or NO_FAULT. */
int32_t event_fault(int32_t which);

/* Return whether EVENT_ROAD_RETURN is possible. The road or the tyres must have changed
 * before. For at least one axle, the variance of the cornering stiffness before that
 * change must be at most its present variance, because a return replaces the present
 * stiffness by the stiffness of that time. This excludes a return to a patch of ice,
 * where the stiffness was hardly known. */
int can_return(const tse_kalman *k);

/* Update the sensitivity and the evidence of all events with a measurement.
 *   Given:  channel  ACCEL_X ..., or NO_SENSOR_* (types.h) if the measurement is not made
 *                    by one of the TSE_SENSORS, for example a measured velocity
 *           along    1: the car does not brake (scalar.along)
 *           h, gain  partial derivatives and Kalman gain. First those of the STATES
 *                    states, then those of the extra states in use (measured
 *                    velocities)
 *           e, s     innovation and its variance
 *           sd       sd of the sensor */
void events_learn(tse_kalman *k, int channel, int32_t along, const r_sparse *h, const r_scaled *gain,
    tse_real e, tse_real s, tse_real sd);

/* Compute the probability of each event. The events form two groups, lateral and
 * longitudinal (events.c). In each group accept the most probable event if the
 * probability that some event of the group has happened exceeds BELIEVED. Events that are
 * too small to need a reaction do not count. Then open new hypotheses. */
STAGE void events_decide(const tse_params *p, tse_kalman *k, tse_real dt);

#endif
