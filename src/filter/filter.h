/* filter/filter.h - types and functions shared by the files of the default filter, in the
 * order of the files. Start reading at step.c. Internal. */
#ifndef TSE_FILTER_H
#define TSE_FILTER_H

#include "estimator/stages.h"
#include "filter/ud.h"
#include "filter/limits.h"

/* Keep a stage of the row out of line: inlined, stack frames that are never alive at the
 * same time would add up to 1 kB on a Cortex-M4. */
#if defined(__GNUC__)
#define STAGE __attribute__((noinline))
#else
#define STAGE
#endif

/* ------------------------------------------------------------------------------ types */

/* Axle that rolls freely, so that its wheels show the speed. */
enum { ROLLS_UNKNOWN, ROLLS_NONE, ROLLS_FRONT, ROLLS_REAR };

/* A checked row. Arrays of TSE_SENSORS are in the order of ACCEL_X ... */
typedef struct decoded {
  tse_real dt;                      /* [s] */
  tse_real steer;                   /* [rad] logged steering angle, or the last one */
  tse_real z[TSE_SENSORS];          /* measurements; wheel speeds times radius [m/s]; 0 if not used */
  tse_real axle[2];                 /* [m/s] wheel speeds as logged, times radius */
  int32_t use[TSE_SENSORS];         /* 1: the measurement is used */
  int32_t has_steer;                /* 1: the steering angle is given */
  int32_t used;                     /* number of IMU channels used */
  int32_t equal;                    /* 1: both wheel speeds are equal */
  int32_t same;                     /* 1: they are equal or have their previous ratio */
  int32_t off[2];                   /* 1: the axle's speed changed to a value that the other does not have */
  int32_t one_speed;                /* 1: both wheel speeds are one signal */
  int32_t no_second;                /* 1: no second speed shows slip, which is computed from the force */
  tse_real optional[TSE_OPTIONALS]; /* optional channels; 0 if not given */
  uint32_t given;                   /* bits TSE_GIVEN_* of the optional channels */
  int32_t rolls;                    /* freely rolling axle: ROLLS_* */
  int32_t no_slip;                  /* 1: slip does not show the longitudinal stiffness */
} decoded;

/* Kinds of events; their table is in events.c. TSE_SMALL has road changes only. */
enum {
  EVENT_NONE,
  EVENT_ROAD,           /* another road */
  EVENT_ROAD_AXLE_DIFF, /* second amplitude of EVENT_ROAD: difference between the axles */
  EVENT_ROAD_RETURN,    /* back on the road before the last change */
  EVENT_FRONT,          /* other tyres in front */
  EVENT_REAR,           /* other tyres at the rear */
  EVENT_SLIP_FRONT,     /* front wheels lock or spin */
  EVENT_SLIP_REAR,      /* rear wheels lock or spin */
  EVENT_STEER,          /* faulty steering angle */
  EVENT_SENSOR,         /* first of TSE_SENSORS kinds: a faulty sensor */
  EVENT_KINDS = HAS_SLIP ? EVENT_SENSOR + TSE_SENSORS : EVENT_ROAD_RETURN
};

/* Channel at fault, numbered as tse_output.fault_channel: 1 + TSE_CHANNEL_*, then
 * velocities. */
enum { NO_FAULT, FAULT_STEER = 1 + TSE_CHANNEL_steer_angle, FAULT_VELOCITY = 1 + TSE_CHANNELS };

/* Place of the steering angle in tse_kalman.frozen, behind the sensors. */
enum { STEERING = TSE_SENSORS };

/* Channel of use_scalar() that is no sensor: of longitudinal, of lateral motion. */
enum { NO_SENSOR_LONGITUDINAL = -1, NO_SENSOR_LATERAL = -2 };

/* A scalar measurement with its prediction. */
typedef struct scalar {
  int32_t along;                     /* 1: it shows the grip along the road, because the car drives */
  tse_real h[TSE_ALL];               /* slopes over the state in its units */
  tse_real consider[TSE_CONSIDERED]; /* slopes over the consider parameters, per sd */
  tse_real e;                        /* innovation */
  tse_real r;                        /* noise variance with the model discrepancy */
  tse_real white;                    /* noise variance without it */
  tse_real dt;                       /* [s] since the measurement before */
} scalar;

/* Posterior of the amplitude of an event, with the second amplitude integrated out. The
 * state moves by the amplitude times (v - part v2) plus `beside` times v2. */
typedef struct event_posterior {
  tse_real amplitude, var;     /* mean and variance of the amplitude */
  tse_real info, score;        /* information and score of the samples */
  tse_real part;               /* share of v2 in the sensitivity; 0 without a second amplitude */
  tse_real beside, beside_var; /* mean and variance of the second amplitude; 0 without one */
  const tse_event *second;     /* event of the second amplitude, with v2; NULL without one */
} event_posterior;

/* Classification of a row. */
typedef struct row_class {
  int gap;       /* 1: the motion cannot be followed to this row */
  int sparse;    /* 1: gaps are frequent */
  int held;      /* 1: slow, in reverse, or at a large steering angle */
  int predicted; /* 1: steering angle or measurements are missing */
  int no_second; /* 1: no second speed shows slip */
  int rolls;     /* freely rolling axle: ROLLS_* */
} row_class;

/* Return whether an axle rolls freely: ROLLS_FRONT or ROLLS_REAR. */
static inline int is_rolling_axle(int32_t rolls) { return rolls == ROLLS_FRONT || rolls == ROLLS_REAR; }

/* Return whether a sensor is a wheel speed. */
static inline int is_wheel(int channel) { return channel == WHEEL_FRONT || channel == WHEEL_REAR; }

/* Return the freely rolling axle of a car that does not brake, by the driven axle. */
static inline int32_t find_undriven_axle(const tse_car *c)
{
  if (c->driven == 1) return ROLLS_REAR;
  return c->driven == 2 ? ROLLS_FRONT : ROLLS_UNKNOWN;
}

/* Return the fault_channel number of a sensor, ACCEL_X ... */
static inline int32_t fault_of(int32_t a)
{
  return 1
      + (is_wheel(a) ? a - WHEEL_FRONT + (int32_t)TSE_CHANNEL_wheel_speed_front
                     : a + (int32_t)TSE_CHANNEL_accel_x);
}

/* ---------------------------------------------------------------------------- units.c */

/* Unit of each state in the covariance: numbers are of order one in every number
 * format. */
extern const tse_real state_unit[TSE_VALUES + TSE_EXTRAS];

/* Max magnitude of each state [m/s, m/s, rad/s ...]. */
extern const tse_real state_max[TSE_VALUES + TSE_EXTRAS];

/* ---------------------------------------------------------------------- exponential.c */

/* Return e^x. */
tse_real compute_exponential(tse_real x);

/* Return exp(-dt/time), the share of a process that remains after dt. */
tse_real compute_decay(tse_real dt, tse_real time);

/* ------------------------------------------------------------------------------ row.c */

/* Check and decode a log row.
 *   Returned:  z; TSE_OK, or the reason why u is refused */
tse_status decode_row(const tse_params *p, const tse_filter *f, const tse_input *u, decoded *z);

/* --------------------------------------------------------------------------- faults.c */

/* Return whether a sensor, or STEERING, is frozen. */
int is_frozen(const tse_kalman *k, int channel);

/* Return whether a sensor is neither frozen nor at fault. */
int is_usable(const tse_kalman *k, int channel);

/* Update the evidence that channel c is frozen with a reading.
 *   Given:    nis    squared innovation over the noise variance, not over S: a value that
 *                    agrees with the prediction may repeat itself
 *             least  min probability of a repeat */
void watch_repeats(tse_kalman *k, int c, tse_real z, tse_real nis, tse_real least, tse_real dt);

/* Update the evidence that the steering angle is frozen: it repeats while the yaw rate
 * contradicts it. A frozen angle is marked missing.
 *   Updated:   z->has_steer
 *   Returned:  1 in the row in which it is found frozen */
int watch_steering(tse_kalman *k, decoded *z);

/* Compute innovation and its variance for a channel that is not used. If it is the
 * channel at fault, update the time for which it has agreed with the prediction. */
void watch_fault(tse_kalman *k, int channel, const scalar *m);

/* -------------------------------------------------------------------- sensitivities.c */

/* Sensitivities are those of the state to the amplitude of each event and to each
 * consider parameter (tse_kalman.consider). */

/* Propagate the sensitivities through the row.
 *   Given:  M  transition in units of the state (ud_move()). Columns behind the states
 *              are r_short() numbers */
void sensitivities_move(const tse_params *p, tse_kalman *k, tse_short M[MOTION][PLACES], tse_real dt);

/* Set the sensitivities of the first `count` states to 0. */
void sensitivities_clear(tse_kalman *k, int count);

/* Multiply the sensitivities of state i by `left`. */
void sensitivities_fade(tse_kalman *k, int i, tse_real left);

/* Return the variance of state i with that by the consider parameters [unit^2]. */
tse_real compute_total_variance(const tse_kalman *k, int i);

/* ------------------------------------------------------------------- slip_stiffness.c */

/* Start the estimate of the slip stiffness itself at LCX, with this prior variance. */
STAGE void along_start(tse_kalman *k, tse_real var);

/* Return w = P^2/(P^2 + B^2 (P - V)), the share of a move of LCX that is one of the slip
 * stiffness itself. P is its prior variance, V the variance of LCX now, and B the sd of a
 * constant model error along the car.
 *   Given:     var_lcx  V [unit^2]
 *   Returned:  *var     P - w (P - V) */
STAGE tse_real along_share(const tse_params *p, const tse_kalman *k, tse_real var_lcx, tse_real *var);

/* Return the logarithm of the slip stiffness itself. A deviation of LCX beyond the model
 * error along the car widens its variance: the tyres may have changed.
 *   Given:    shift  mean shift of LCX by events that are not accepted yet
 *   Updated:  var    variance of LCX, then of the result */
tse_real along_estimate(const tse_params *p, const tse_kalman *k, tse_real shift, tse_real *var);

/* Restart the slip stiffness itself at LCX after an accepted change of tyres: the model
 * error on the new road is unknown. The variance that the change has added to LCX is
 * added. Tyres that return to the road before have their estimate of then.
 *   Given:  before  variance of LCX before the change [unit^2] */
void along_restart(const tse_params *p, tse_kalman *k, int32_t which, tse_real before);

/* ---------------------------------------------------------------------------- start.c */

/* Initialise state and covariance from the prior, or from what was loaded. */
STAGE void start_state(const tse_params *p, tse_filter *f);

/* Initialise the motion from wheel speed and gyro, and the lags of the steering from its
 * angle. */
STAGE void start_motion(const tse_params *p, tse_kalman *k, const decoded *z);

/* -------------------------------------------------------------------------- predict.c */

/* Return slip^2/(slip^2 + its variance) of the slip and of the slip angle of each axle.
 * Slopes over their stiffness are used with this share, so that errors of the slip do not
 * bias the stiffness (errors in variables). */
void compute_signal_shares(const tse_kalman *k, tse_real share[3]);

/* Move gravity along and across the road to the grade and bank given in the row. Call it
 * before predict_row() or predict_slow_states(). */
void update_road(const tse_params *p, tse_kalman *k, const decoded *z);

/* Predict state and covariance to the time of the row. */
STAGE steering predict_row(const tse_params *p, tse_kalman *k, const decoded *z);

/* Predict the slow states alone, where the motion is unknown. */
void predict_slow_states(const tse_params *p, tse_kalman *k, tse_real dt);

/* --------------------------------------------------------------------------- events.c */

/* Return the posterior of the amplitude of slot n. */
event_posterior compute_posterior(const tse_kalman *k, int n);

/* Return whether the amplitude of slot n is below the size that needs a reaction. */
int event_is_small(const tse_kalman *k, int n);

/* Return the regime TSE_REGIME_* that a kind of event begins. */
int32_t event_regime(int32_t which);

/* Return whether a kind is a change of tyres: of a road, or of an axle. */
int is_tyre_change(int32_t which);

/* Return the channel at fault in a kind of event, or NO_FAULT. */
int32_t event_fault(int32_t which);

/* Return whether EVENT_ROAD_RETURN is possible: something has changed, and an axle was
 * better known before the change than now. Behind a patch of ice the ice itself is not a
 * road to return to. */
int can_return(const tse_kalman *k);

/* Update all events with a measurement.
 *   Given:  channel  ACCEL_X ..., or NO_SENSOR_*     along  as in scalar
 *           h, gain  slopes and Kalman gain: STATES elements, then extra states in use
 *           e, s     innovation and its variance     sd     sd of the sensor */
void events_learn(tse_kalman *k, int channel, int32_t along, const r_sparse *h, const r_scaled *gain,
    tse_real e, tse_real s, tse_real sd);

/* Weigh the events, accept the one that is likely enough, and open new ones. */
STAGE void events_decide(const tse_params *p, tse_kalman *k, tse_real dt);

/* --------------------------------------------------------------------------- scalar.c */

/* Update the filter with one measurement.
 *   Given:     channel  ACCEL_X ..., or NO_SENSOR_*      sd  of the sensor
 *   Updated:   change   sum of the corrections of this row, in units of the state
 *   Returned:  S, the variance of the innovation as used
 *              *state   its part without the noise of the measurement: h' P h, and that
 *                       of the consider parameters */
tse_real use_scalar(
    tse_kalman *k, int channel, const scalar *m, tse_real sd, tse_real change[TSE_ALL], tse_real *state);

/* Update the white noise of a channel: half the mean square of the difference of
 * successive innovations, in which slow errors cancel.
 *   Given:    nominal  variance of the setting      share  gain of the running mean
 *   Updated:  noise    variance over that of the setting */
static inline void learn_noise(
    const tse_params *p, tse_real *noise, tse_real difference, tse_real nominal, tse_real share)
{
  const tse_real seen = r_min(r_div(r_mul(TSE_R(0.5), r_sqr(difference)), r_mul(nominal, *noise)), TAIL);
  *noise = r_clamp(
      r_mul(*noise, TSE_R(1) + r_mul(r_min(share, MAX_GAIN), seen - TSE_R(1))), MIN_NOISE, p->noise_max_var);
}

/* ------------------------------------------------------------------------- velocity.c */

/* Propagate the states of a measured velocity through the row. */
void velocity_move(const tse_params *p, tse_kalman *k, const decoded *z);

/* Discard heading and past motion, because the motion is initialised anew. */
void velocity_lose(tse_kalman *k);

/* Update the filter with the velocities of this row.
 *   Updated:  change  as in use_scalar() */
void velocity_update(
    const tse_params *p, tse_kalman *k, const decoded *z, const forces *f, tse_real change[TSE_ALL]);

/* Return NO_FAULT, or the number of a velocity that is rejected. */
int32_t velocity_fault(const tse_kalman *k);

/* Return the model discrepancy of the lateral speed [m/s]. */
tse_real velocity_discrepancy(const tse_kalman *k);

/* Return the variance of the lateral speed with its model discrepancy [m2/s2]. */
tse_real velocity_across_var(const tse_kalman *k);

/* --------------------------------------------------------------------------- update.c */

/* Update the filter with the measurements of the row, one after the other.
 *   Given:  u  steering through the row, from predict_row() */
STAGE void update_row(const tse_params *p, tse_kalman *k, const decoded *z, steering u);

/* Update the gyro bias at standstill. */
void update_at_standstill(const tse_params *p, tse_kalman *k, const decoded *z);

/* ------------------------------------------------------------------------ backwards.c */

/* Return whether the car rolls backwards. Its wheel speeds may have no sign.
 *   Given:     z      of this row
 *              speed  of the faster axle or, without wheel speeds, of the state; unsigned
 *   Updated:   f->way
 *   O(1) time */
int rolls_backwards(const tse_params *p, tse_filter *f, const decoded *z, tse_real speed);

/* ------------------------------------------------------------------------ plausible.c */

/* Update the test whether the channels agree (wrong units, signs, axles) with a row.
 *   Given:     no_second  1: both wheel speeds are one signal, and do not show which
 *                         wheels are ahead
 *   Updated:   k->agreement
 *   O(1) time */
STAGE void check_agreement(
    const tse_params *p, tse_kalman *k, const tse_input *u, tse_real dt, int no_second);

/* Return the channel that contradicts the others, as fault_channel numbers it, or 0.
 *   Returned:  *factor  how many times too large it is; 0 where no factor explains it */
int32_t find_implausible_channel(const tse_kalman *k, tse_real *factor);

/* --------------------------------------------------------------------------- output.c */

/* Report estimates and probabilities. */
STAGE void report_row(const tse_params *p, const tse_kalman *k, tse_output *out);

/* Judge for each stiffness and the grip whether it is valid, and else why not. */
void judge_row(const tse_params *p, const tse_kalman *k, const row_class *w, tse_output *out);

/* ----------------------------------------------------------------------------- step.c */

/* Process a row of tse_step(). */
tse_status step_row(const tse_params *p, tse_filter *f, const tse_input *u, tse_output *out);

#endif
