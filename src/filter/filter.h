/* filter/filter.h - types and functions that the files of the default filter share,
 * grouped by file. Start reading at step.c. Internal. */
#ifndef TSE_FILTER_H
#define TSE_FILTER_H

#include "estimator/stages.h"
#include "filter/ud.h"
#include "filter/limits.h"

/* Prevent inlining of a function that processes a part of the row. If these functions
 * were inlined, the stack would hold all their frames at once, up to 1 kB on a Cortex-M4,
 * although only one of them is in use at a time. */
#if defined(__GNUC__)
#define STAGE __attribute__((noinline))
#else
#define STAGE
#endif

/* ------------------------------------------------------------------------------ types */

/* Axle that rolls freely: no torque acts on it, so that its wheels measure the speed of
 * the car. ROLLS_UNKNOWN: it is not known whether an axle rolls freely. ROLLS_NONE: no
 * axle rolls freely, because the car brakes or both axles are driven. */
enum { ROLLS_UNKNOWN, ROLLS_NONE, ROLLS_FRONT, ROLLS_REAR };

/* A checked log row. Arrays of TSE_SENSORS elements are in the order ACCEL_X, ACCEL_Y,
 * YAW_RATE, WHEEL_FRONT, WHEEL_REAR. */
typedef struct decoded {
  tse_real dt;              /* [s] time since the previous row */
  tse_real steer;           /* [rad] steering angle of the row or, if it is missing, of an earlier row */
  tse_real z[TSE_SENSORS];  /* measurements, SI; wheel speeds times wheel radius [m/s]; 0 if not used */
  tse_real axle[2];         /* [m/s] front and rear wheel speed as logged, times wheel radius */
  int32_t use[TSE_SENSORS]; /* 1: the measurement is used */
  int32_t has_steer;        /* 1: the steering angle is given */
  int32_t used;             /* number of IMU channels used */
  int32_t equal;            /* 1: both wheel speeds are equal */
  int32_t same;             /* 1: wheel speeds equal, or in the ratio of earlier rows (tse_filter.ratio) */
  int32_t off[2];           /* 1: the wheel speed of this axle has changed since the previous row, and is
                             * not a copy of the wheel speed of the other axle */
  int32_t one_speed;        /* 1: both wheel speeds are copies of one signal */
  int32_t no_second;        /* 1: the wheel speeds of the two axles cannot be compared: one_speed is 1, or
                             * an axle has had no wheel speed for USUAL_TIME and no velocity is measured.
                             * The slips are then computed from the longitudinal force */
  tse_real optional[TSE_OPTIONALS]; /* optional channels; 0 if not given */
  uint32_t given;                   /* bits TSE_GIVEN_* of the optional channels */
  int32_t rolls;                    /* freely rolling axle: ROLLS_* */
  int32_t no_slip;                  /* 1: the longitudinal stiffness is not estimated from this row */
} decoded;

/* Kinds of events. The table in events.c describes each of them. A TSE_SMALL build has
 * only EVENT_ROAD and EVENT_ROAD_AXLE_DIFF. */
enum {
  EVENT_NONE,
  EVENT_ROAD,           /* a different road surface, which acts on all tyres */
  EVENT_ROAD_AXLE_DIFF, /* second amplitude of EVENT_ROAD: difference of the change between the axles */
  EVENT_ROAD_RETURN,    /* return to the road surface before the last change */
  EVENT_FRONT,          /* change of the front tyres */
  EVENT_REAR,           /* change of the rear tyres */
  EVENT_SLIP_FRONT,     /* front wheels lock or spin */
  EVENT_SLIP_REAR,      /* rear wheels lock or spin */
  EVENT_STEER,          /* faulty steering angle */
  EVENT_SENSOR,         /* faulty ACCEL_X. The kinds for the other sensors follow in their order */
  EVENT_KINDS = HAS_SLIP ? EVENT_SENSOR + TSE_SENSORS : EVENT_ROAD_RETURN
};

/* Number of the channel at fault, as in tse_output.fault_channel: 1 + TSE_CHANNEL_* for a
 * channel of the log, FAULT_VELOCITY + index for a measured velocity. */
enum { NO_FAULT, FAULT_STEER = 1 + TSE_CHANNEL_steer_angle, FAULT_VELOCITY = 1 + TSE_CHANNELS };

/* Index of the steering angle in arrays of TSE_SENSORS + 1 elements, such as
 * tse_kalman.frozen. The sensors come first. */
enum { STEERING = TSE_SENSORS };

/* Values of the argument `channel` of use_scalar() for a measurement that is not made by
 * one of the TSE_SENSORS. NO_SENSOR_LONGITUDINAL: the measurement depends on the
 * longitudinal motion. NO_SENSOR_LATERAL: it depends on the lateral motion. */
enum { NO_SENSOR_LONGITUDINAL = -1, NO_SENSOR_LATERAL = -2 };

/* A scalar measurement. h and consider are partial derivatives of its prediction. */
typedef struct scalar {
  int32_t along;                     /* 1: no braking: longitudinal channels can show tyre changes */
  tse_real h[TSE_ALL];               /* partial derivatives with respect to the state, per state_unit */
  tse_real consider[TSE_CONSIDERED]; /* partial derivatives with respect to the consider parameters, per sd */
  tse_real e;                        /* innovation */
  tse_real r;                        /* variance of noise and model discrepancy together */
  tse_real white;                    /* variance of the noise alone */
  tse_real dt;                       /* [s] time since the previous measurement of this channel */
} scalar;

/* Posterior of the amplitude w of an event. The event shifts the state by w v, v being
 * the sensitivity of the state (tse_event.v). A different road surface (EVENT_ROAD)
 * has a second amplitude w2, with the sensitivity v2, which shifts the state by w2 v2
 * in addition. The same samples determine both amplitudes, so that they are
 * correlated: for a given w, the mean of w2 is beside - part w. The mean shift of the
 * state for a given w is therefore w v + (beside - part w) v2 = w (v - part v2) +
 * beside v2. */
typedef struct event_posterior {
  tse_real amplitude, var; /* mean and variance of w */
  tse_real info, score;    /* information of the samples on w (1/variance); d ln(likelihood)/dw at w = 0 */
  tse_real part;           /* decrease of the mean of w2 per unit of w; 0 without w2 */
  tse_real beside, beside_var; /* mean of w2 at w = 0, and its variance given w; 0 without w2 */
  const tse_event *second;     /* event of w2, with v2; NULL without w2 */
} event_posterior;

/* Classification of a row. */
typedef struct row_class {
  int gap;       /* 1: the motion cannot be predicted from the previous row to this one */
  int sparse;    /* 1: gaps are more frequent than MAX_GAP_RATE, so that no estimate is valid */
  int held;      /* 1: no stiffness is updated: car slow, in reverse, or steering angle large */
  int predicted; /* 1: the row has no steering angle or no IMU channel, or the motion is unknown
                  * (tse_filter.lost), for example without wheel speeds for ROAD_TIME */
  int no_second; /* 1: the wheel speeds of the two axles cannot be compared (decoded.no_second) */
  int rolls;     /* freely rolling axle: ROLLS_* */
} row_class;

/* Return whether one of the axles rolls freely. */
static inline int is_rolling_axle(int32_t rolls) { return rolls == ROLLS_FRONT || rolls == ROLLS_REAR; }

/* Return whether a sensor is a wheel speed. */
static inline int is_wheel(int channel) { return channel == WHEEL_FRONT || channel == WHEEL_REAR; }

/* Return the axle that is not driven. It rolls freely while the car does not brake. If
 * both axles are driven, or the driven axle is unknown, return ROLLS_UNKNOWN. */
static inline int32_t find_undriven_axle(const tse_car *c)
{
  if (c->driven == 1) return ROLLS_REAR;
  return c->driven == 2 ? ROLLS_FRONT : ROLLS_UNKNOWN;
}

/* Return the number that sensor a (ACCEL_X ...) has in tse_output.fault_channel. */
static inline int32_t fault_of(int32_t a)
{
  return 1
      + (is_wheel(a) ? a - WHEEL_FRONT + (int32_t)TSE_CHANNEL_wheel_speed_front
                     : a + (int32_t)TSE_CHANNEL_accel_x);
}

/* ---------------------------------------------------------------------------- units.c */

/* Unit of each state in the covariance. In these units the elements of the covariance are
 * of order one, so that every number format resolves them. */
extern const tse_real state_unit[TSE_VALUES + TSE_EXTRAS];

/* Max magnitude of each state, SI. */
extern const tse_real state_max[TSE_VALUES + TSE_EXTRAS];

/* ---------------------------------------------------------------------- exponential.c */

/* Return e^x. */
tse_real compute_exponential(tse_real x);

/* Return exp(-dt/time): the factor by which a state with the time constant
 * `time` decays during dt. */
tse_real compute_decay(tse_real dt, tse_real time);

/* ------------------------------------------------------------------------------ row.c */

/* Check and decode a log row.
 *   Returned:  TSE_OK and z, or the reason why u is refused */
tse_status decode_row(const tse_params *p, const tse_filter *f, const tse_input *u, decoded *z);

/* --------------------------------------------------------------------------- faults.c */

/* Return whether a channel is frozen, i.e. repeats its value although it should change.
 *   Given:  channel  ACCEL_X ..., or STEERING for the steering angle */
int is_frozen(const tse_kalman *k, int channel);

/* Return whether a sensor is neither frozen nor at fault. */
int is_usable(const tse_kalman *k, int channel);

/* Update the evidence that channel c is frozen. z is the new reading of the channel.
 *   Given:    nis    ratio of the squared innovation to the noise variance of the channel
 *                    (not to the variance of the innovation, which also includes the
 *                    uncertainty of the prediction). If the ratio is small, a repeated
 *                    value agrees with the prediction and is only weak evidence
 *             least  min probability that a working channel repeats its value */
void watch_repeats(tse_kalman *k, int c, tse_real z, tse_real nis, tse_real least, tse_real dt);

/* Update the evidence that the steering angle is frozen: the angle repeats while the yaw
 * rate contradicts it. A frozen angle is treated as missing.
 *   Updated:   z->has_steer
 *   Returned:  1 in the row in which the angle turns out to be frozen, otherwise 0 */
int watch_steering(tse_kalman *k, decoded *z);

/* Compute the innovation of a channel that is not used for the update, and the variance
 * of that innovation. If the channel is the one at fault, update the time for which it
 * has agreed with the prediction. */
void watch_fault(tse_kalman *k, int channel, const scalar *m);

/* -------------------------------------------------------------------- sensitivities.c */

/* Sensitivities: partial derivatives of the state with respect to the amplitude of
 * each event (tse_event.v) and to each consider parameter (tse_kalman.consider). A
 * consider parameter is uncertain and not estimated. Its uncertainty is included in
 * the gains and variances (Schmidt-Kalman filter). */

/* Propagate the sensitivities through the row.
 *   Given:  M  transition in units of the state, as for ud_move(). The columns after
 *              those of the states are the partial derivatives with respect to the
 *              consider parameters, stored as tse_short (r_short()) */
void sensitivities_move(const tse_params *p, tse_kalman *k, tse_short M[MOTION][PLACES], tse_real dt);

/* Return whether, for each event and consider parameter, the sum of squares of the
 * sensitivities of the motion is below MAX_D. A larger sum means that the prediction of
 * the motion has diverged. */
int are_sensitivities_known(const tse_kalman *k);

/* Set the sensitivities of the first `count` states to 0. */
void sensitivities_clear(tse_kalman *k, int count);

/* Multiply all sensitivities of state i by `left`. */
void sensitivities_fade(tse_kalman *k, int i, tse_real left);

/* Return the variance of state i [unit^2], including the part that uncertain consider
 * parameters cause. */
tse_real compute_total_variance(const tse_kalman *k, int i);

/* ------------------------------------------------------------------- slip_stiffness.c */

/* The state LCX is the logarithm of the longitudinal (slip) stiffness plus the error
 * of the longitudinal model, which for example the pitch and wrong rolling radii
 * cause. These functions estimate the logarithm of the slip stiffness alone
 * (tse_along). */

/* Start the estimate of the slip stiffness at the present value of LCX, with
 * the prior variance `var`. */
STAGE void along_start(tse_kalman *k, tse_real var);

/* Return w = P^2/(P^2 + B^2 (P - V)), the share of a change of LCX that is a change of
 * ln(slip stiffness). The rest, 1 - w, is a change of the model error. P is the prior
 * variance of ln(slip stiffness), V the present variance of LCX, and B the sd of the
 * model error. As long as nothing is learnt, V = P and w = 1. If V is near 0, w is near
 * P/(P + B^2).
 *   Given:     var_lcx  V [unit^2]
 *   Returned:  *var     posterior variance of ln(slip stiffness), P - w (P - V) */
STAGE tse_real along_share(const tse_params *p, const tse_kalman *k, tse_real var_lcx, tse_real *var);

/* Return the estimate of ln(slip stiffness). If LCX has changed by more than the model
 * error explains, increase the variance of the result, because the tyres may have
 * changed.
 *   Given:    shift  mean shift of LCX by events that are not accepted yet; it is added
 *                    to the result
 *   Updated:  var    in: variance of LCX, including the part due to these events; out:
 *                    variance of the result */
tse_real along_estimate(const tse_params *p, const tse_kalman *k, tse_real shift, tse_real *var);

/* Start a new estimate of ln(slip stiffness) at the present value of LCX, after an
 * accepted change of the road surface or of the tyres, because the model error after the
 * change is unknown. Its variance is that of the old estimate plus the increase of the
 * variance of LCX by the change. If the change is a return to the previous road (which =
 * EVENT_ROAD_RETURN), restore the estimate for that road instead.
 *   Given:  which   kind of the event: EVENT_ROAD ...
 *           before  variance of LCX before the change [unit^2] */
void along_restart(const tse_params *p, tse_kalman *k, int32_t which, tse_real before);

/* ---------------------------------------------------------------------------- start.c */

/* Initialise state and covariance from the prior, or from a learnt
 * state if one was loaded. */
STAGE void start_state(const tse_params *p, tse_filter *f);

/* Initialise the motion from wheel speed and gyro. Two low passes in series delay the
 * logged steering angle (setting steering_lag_time): set their outputs to the logged
 * angle. */
STAGE void start_motion(const tse_params *p, tse_kalman *k, const decoded *z);

/* -------------------------------------------------------------------------- predict.c */

/* Compute the share slip^2/(slip^2 + variance of the slip) for each stiffness: from the
 * slips of both axles for the longitudinal stiffness, and from the slip angle of the
 * axle for a cornering stiffness. Partial derivatives with respect to the stiffness are
 * multiplied by this share, so that errors of the slip do not bias the stiffness
 * (errors in variables). */
void compute_signal_shares(const tse_kalman *k, tse_real share[3]);

/* Use the grade and bank of the row. GX and GY, gravity along and across the road, are
 * Ornstein-Uhlenbeck processes: each decays towards a process mean. Set this mean from
 * grade or bank, and shift the state by the change of the mean. If the log begins or
 * ceases to give grade or bank, set the state to the mean and reset its variance. Call it
 * before predict_row() or predict_slow_states(). */
void update_road(const tse_params *p, tse_kalman *k, const decoded *z);

/* Predict state and covariance to the time of the row.
 *   Returned:  angle of the front wheels from the previous row to this one */
STAGE steering predict_row(const tse_params *p, tse_kalman *k, const decoded *z);

/* Predict the slow states only: gravity, biases, stiffness, grip, steering. If the motion
 * is unknown, call it in place of predict_row(). */
void predict_slow_states(const tse_params *p, tse_kalman *k, tse_real dt);

/* --------------------------------------------------------------------------- events.c */

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
 *   Given:  channel  ACCEL_X ..., or NO_SENSOR_*
 *           along    1: the car does not brake (scalar.along)
 *           h, gain  partial derivatives and Kalman gain. First those of the STATES
 *                    states, then those of the extra states in use (measured
 *                    velocities)
 *           e, s     innovation and its variance
 *           sd       sd of the sensor */
void events_learn(tse_kalman *k, int channel, int32_t along, const r_sparse *h, const r_scaled *gain,
    tse_real e, tse_real s, tse_real sd);

/* Compute the probability of each event. In each group accept the most probable event if
 * the probability that some event has happened exceeds BELIEVED. Events that are too
 * small to need a reaction do not count. Then open new hypotheses. */
STAGE void events_decide(const tse_params *p, tse_kalman *k, tse_real dt);

/* --------------------------------------------------------------------------- scalar.c */

/* Update the filter with one measurement.
 *   Given:     channel  ACCEL_X ..., or NO_SENSOR_*
 *              sd       sd of the sensor
 *   Updated:   change   sum of the corrections of this row, in units of the state
 *   Returned:  S, the variance of the innovation with which the gain was computed
 *              *state   the part of S that is not measurement noise: h' P h, and the
 *                       part due to consider parameters */
tse_real use_scalar(
    tse_kalman *k, int channel, const scalar *m, tse_real sd, tse_real change[TSE_ALL], tse_real *state);

/* Update the estimated white noise of a channel: half the mean square of the difference
 * between successive innovations. Slow errors cancel in this difference, and it has twice
 * the variance of the white noise.
 *   Given:    difference  between the last two innovations
 *             nominal     noise variance of the setting
 *             share       gain of the running mean
 *   Updated:  noise       ratio of the estimated noise variance to nominal */
static inline void learn_noise(
    const tse_params *p, tse_real *noise, tse_real difference, tse_real nominal, tse_real share)
{
  const tse_real seen = r_min(r_div(r_mul(TSE_R(0.5), r_sqr(difference)), r_mul(nominal, *noise)), TAIL);
  *noise = r_clamp(
      r_mul(*noise, TSE_R(1) + r_mul(r_min(share, MAX_GAIN), seen - TSE_R(1))), MIN_NOISE, p->noise_max_var);
}

/* ------------------------------------------------------------------------- velocity.c */

/* Predict the extra states to the time of the row. They are needed only for measured
 * velocities, an optional input. */
void velocity_move(const tse_params *p, tse_kalman *k, const decoded *z);

/* Discard the heading and the stored past motion. Call it when the
 * motion is initialised again. */
void velocity_lose(tse_kalman *k);

/* Update the filter with the velocities of this row.
 *   Updated:  change  as in use_scalar() */
void velocity_update(
    const tse_params *p, tse_kalman *k, const decoded *z, const forces *f, tse_real change[TSE_ALL]);

/* Return the number of a velocity that is rejected, as in fault_channel, or NO_FAULT. */
int32_t velocity_fault(const tse_kalman *k);

/* Return the model discrepancy of the lateral speed [m/s]. */
tse_real velocity_discrepancy(const tse_kalman *k);

/* Return the variance of the sum of lateral speed and its model discrepancy [m2/s2]. */
tse_real velocity_across_var(const tse_kalman *k);

/* --------------------------------------------------------------------------- update.c */

/* Update the filter with the measurements of the row, one after the other.
 *   Given:  u  angle of the front wheels from the previous row to this one, as returned
 *              by predict_row() */
STAGE void update_row(const tse_params *p, tse_kalman *k, const decoded *z, steering u);

/* Update the gyro bias at standstill. */
void update_at_standstill(const tse_params *p, tse_kalman *k, const decoded *z);

/* ------------------------------------------------------------------------ backwards.c */

/* Return whether the car rolls backwards. This is also found if the wheel speeds have no
 * sign.
 *   Given:     z      this row
 *              speed  [m/s] magnitude of the speed of the faster axle or, without wheel
 *                     speeds, |v_x|
 *   Updated:   f->way  log odds of reverse, and the data from which they follow
 *   O(1) time */
int rolls_backwards(const tse_params *p, tse_filter *f, const decoded *z, tse_real speed);

/* ------------------------------------------------------------------------ plausible.c */

/* Compare the channels of a row with each other, to find channels with a wrong unit or
 * sign, and wheel speeds of the wrong axle.
 *   Given:     no_second  1: only one wheel speed is measured, so that the speeds of the
 *                         axles are not compared
 *   Updated:   k->agreement
 *   O(1) time */
STAGE void check_agreement(
    const tse_params *p, tse_kalman *k, const tse_input *u, tse_real dt, int no_second);

/* Return the number of the channel that contradicts the others, as
 * in fault_channel, or 0.
 *   Returned:  *factor  (logged value)/(true value) of this channel; negative if its
 *                       sign is wrong. 0: no channel, or the error is not a factor, for
 *                       example a latency */
int32_t find_implausible_channel(const tse_kalman *k, tse_real *factor);

/* --------------------------------------------------------------------------- output.c */

/* Write the estimates and the probabilities of this row to out. */
STAGE void report_row(const tse_params *p, const tse_kalman *k, tse_output *out);

/* Write to out, for each stiffness and the grip, whether it is valid or why it is not. */
void judge_row(const tse_params *p, const tse_kalman *k, const row_class *w, tse_output *out);

/* ----------------------------------------------------------------------------- step.c */

/* Process a row: tse_step() of the default filter. */
tse_status step_row(const tse_params *p, tse_filter *f, const tse_input *u, tse_output *out);

#endif
