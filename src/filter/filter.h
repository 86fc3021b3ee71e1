/* filter/filter.h - what the stages of the filter share. Internal. */
#ifndef TSE_FILTER_H
#define TSE_FILTER_H

#include "estimator/stages.h"
#include "filter/ud.h"
#include "filter/limits.h"

/* A stage of a row keeps a frame of its own: inlined into the row, what is never alive at
 * once adds up, to 1 kB of a Cortex-M4's stack. */
#if defined(__GNUC__)
#define STAGE __attribute__((noinline))
#else
#define STAGE
#endif

/* One decoded row. z, use: by channel, ACCEL_X ...; wheel speeds times radius; use: 0
 * missing, 1 to be used. used: accelerometers and gyro of them. axle: wheel speeds as
 * read. equal, same: both read one number, or the ratio that they have had. off: of each
 * axle, whether it has changed to what the other does not read. one_speed: both are one
 * signal. no_second: no second speed shows slip, which is that of the force then. rolls:
 * which axle rolls freely in this row, so that its wheels show the speed. */
typedef struct decoded {
  tse_real dt, steer, z[TSE_SENSORS], axle[2];
  int32_t use[TSE_SENSORS], has_steer, used, equal, same, off[2], one_speed, no_second;
  tse_real optional[TSE_OPTIONALS];
  uint32_t given;
  int32_t rolls, no_slip; /* ROLLS_UNKNOWN ...; 1: slip does not show the stiffness */
} decoded;

/* Which axle rolls freely, by what is given of the pedals: not known, none, front, rear. */
enum { ROLLS_UNKNOWN, ROLLS_NONE, ROLLS_FRONT, ROLLS_REAR };
static inline int32_t not_driven(const tse_car *c)
{
  if (c->driven == 1) return ROLLS_REAR;
  return c->driven == 2 ? ROLLS_FRONT : ROLLS_UNKNOWN;
}

/* Kinds of events, and what each opens: events.c. */
enum {
  EVENT_NONE,
  EVENT_ROAD,
  EVENT_ROAD_AXLE_DIFF,
  EVENT_ROAD_RETURN,
  EVENT_FRONT,
  EVENT_REAR,
  EVENT_SLIP_FRONT,
  EVENT_SLIP_REAR,
  EVENT_STEER,
  EVENT_SENSOR,
  EVENT_KINDS = HAS_SLIP ? EVENT_SENSOR + TSE_SENSORS : EVENT_ROAD_RETURN
}; /* TSE_SMALL: another road alone */

/* Unit of each state in the covariance: numbers of one magnitude in every number format. */
extern const tse_real state_unit[TSE_VALUES + TSE_EXTRAS];

/* No car goes beyond: [m/s] [m/s] [rad/s] ... as the states. */
extern const tse_real state_most[TSE_VALUES + TSE_EXTRAS];

/* row.c      Check a log row. Nothing is changed. */
tse_status row_decode(const tse_params *p, const tse_filter *f, const tse_input *u, decoded *z);

/* start.c    Note that the slip stiffness itself is where LCX is now, with this variance */
STAGE void along_start(tse_kalman *k, tse_real var);

/* output.c   Return w = P^2/(P^2 + B^2 (P - V)), the share of a move of LCX that is one
 *            of the slip stiffness itself.
 *            P: its variance before anything was learnt, V: variance of LCX now, B: sd of
 *            a constant model error along the car.
 *            Given: own  V [unit2]      Returned: *var = P - w (P - V) */
STAGE tse_real along_share(const tse_params *p, const tse_kalman *k, tse_real own, tse_real *var);

/* start.c    Place all by the prior, or by what was loaded; the motion alone, by wheel
 *            speed and gyro; the steering
 *            angle is where its lag begins */
STAGE void start_all(const tse_params *p, tse_filter *f);
STAGE void start_motion(const tse_params *p, tse_kalman *k, const decoded *z);

/* predict.c  row: predict to the time of the row      rest: parameters alone, where
 *                                                     nothing is known of the motion
 *            road: move the gravity of the road to where it is given in the row; before
 *            row or rest
 *            shares: slip^2/(slip^2 + its variance), of the slip and of the slip angle of
 *            each axle: so much of the slopes over their
 *            stiffness is used, so that errors of the slip do not pull it (errors in
 *            variables) */
STAGE steering predict_row(const tse_params *p, tse_kalman *k, const decoded *z);
void rest_row(const tse_params *p, tse_kalman *k, tse_real dt);
void road_row(const tse_params *p, tse_kalman *k, const decoded *z);
void signal_shares(const tse_kalman *k, tse_real share[3]);

/* update.c   Use one scalar measurement after the other; the gyro's bias at standstill */
STAGE void update_row(const tse_params *p, tse_kalman *k, const decoded *z, steering u);
void update_still(const tse_params *p, tse_kalman *k, const decoded *z);

/* update.c   Note whether the steering angle repeats itself while the car turns otherwise
 *            than it says. One that is frozen is
 *            missing: z->has_steer. Returned: whether it is from this row on
 *            is_frozen: return whether a sensor, or STEERING, is      works: whether a
 *            sensor is used: neither frozen nor at fault */
int watch_steering(tse_kalman *k, decoded *z);
int is_frozen(const tse_kalman *k, int channel);
int works(const tse_kalman *k, int channel);

/* A measurement as the filter predicts it: slopes over the state in its units, over
 * uncertain quantities, innovation, noise. */
typedef struct scalar {
  int32_t along; /* of a sensor, 1: it shows how the tyres grip along the road, since the car drives */
  tse_real h[TSE_ALL], consider[TSE_CONSIDERED], e, r, white, dt;
} scalar;
tse_real use_scalar(
    tse_kalman *k, int channel, const scalar *m, tse_real sd, tse_real change[TSE_ALL], tse_real *state);

/* Find the white noise of a channel: half the mean square of what the innovation changes
 * by from one value to the next, where nothing slower shows.
 *   Given:    own  variance by the setting      share  of a mean that the new value is
 *   Updated:  noise  variance over that of the setting */
static inline void learn_noise(
    const tse_params *p, tse_real *noise, tse_real change, tse_real own, tse_real share)
{
  const tse_real seen = r_min(r_div(r_mul(TSE_R(0.5), r_sqr(change)), r_mul(own, *noise)), TAIL);
  *noise = r_clamp(r_mul(*noise, TSE_R(1) + r_mul(r_min(share, MOST_FORGOTTEN), seen - TSE_R(1))),
      LEAST_NOISE, p->noise_max_var);
}

/* velocity.c  move: move what belongs to a velocity with the row      lose: forget
 *             heading and past, as motion was placed anew
 *             update: use the velocities of this row, as update_row()
 *             fault: return NO_FAULT, or which one is left out, as fault_channel numbers
 *             it */
void velocity_move(const tse_params *p, tse_kalman *k, const decoded *z);
void velocity_lose(tse_kalman *k);
void velocity_update(
    const tse_params *p, tse_kalman *k, const decoded *z, const forces *f, tse_real change[TSE_ALL]);
int32_t velocity_fault(const tse_kalman *k);
tse_real velocity_discrepancy(const tse_kalman *k); /* model discrepancy of the speed across, m/s */
tse_real velocity_across_var(
    const tse_kalman *k); /* of the speed across with what the model does not explain of it, m2/s2 */

/* Channel of use_scalar() that is no sensor: of longitudinal, of lateral motion. */
enum { NO_SENSOR_LONGITUDINAL = -1, NO_SENSOR_LATERAL = -2 };

/* events.c   sensitivities: of the state to the amplitude of an event, and to what is
 *            uncertain and no state, tse_kalman.consider
 *                move   with the motion of the row.  Given: M  its transition, in units
 *                                                    (ud_move(); behind the states
 *                                                    r_short())
 *                clear  of states before count, which were placed anew
 *                fade   of state i, which keeps so much of itself
 *            learn: use a measurement of a channel (or NO_SENSOR_*).   Given: h  slopes
 *            gain   e  innovation   s  its variance
 *                   sd  of the sensor      h, gain: STATES elements and those of the
 *                                          extra states in use    along  as in scalar
 *            decide: weigh, believe, open */
void sensitivities_clear(tse_kalman *k, int count);
void sensitivities_fade(tse_kalman *k, int i, tse_real left);
void sensitivities_move(const tse_params *p, tse_kalman *k, tse_short M[MOTION][PLACES], tse_real dt);
void events_learn(tse_kalman *k, int channel, int32_t along, const r_sparse *h, const r_scaled *gain,
    tse_real e, tse_real s, tse_real sd);
STAGE void events_decide(const tse_params *p, tse_kalman *k, tse_real dt);
/* What the samples say of an event. A second amplitude is integrated out: of the first
 * times v - part times its own v, and beside it. */
typedef struct event_says {
  tse_real amplitude, var, info, score; /* the first: mean, variance, and what that is of */
  tse_real part, beside, beside_var;    /* 0 where there is no second */
  const tse_event *second;              /* NULL: none */
} event_says;
event_says event_of(const tse_kalman *k, int n); /* of slot n */
int event_is_small(const tse_kalman *k, int n);  /* it may explain the samples, and calls for nothing */
/* something has changed, and before it an axle was known better than now: behind a patch
 * the patch itself is nothing to go back to */
int may_be_back(const tse_kalman *k);
int32_t event_regime(int32_t which); /* that a kind of event begins: TSE_REGIME_ */

/* Which channel is at fault, as fault_channel numbers it: 1 + TSE_CHANNEL_, behind them
 * velocities. */
enum { NO_FAULT, FAULT_STEER = 1 + TSE_CHANNEL_steer_angle, FAULT_VELOCITY = 1 + TSE_CHANNELS };

/* Place of the steering angle in tse_kalman.frozen, behind the sensors. */
enum { STEERING = TSE_SENSORS };

/* Return that number of a sensor, ACCEL_X ... */
static inline int32_t fault_of(int32_t a)
{
  return 1
      + (a < IMU_CHANNELS ? a + (int32_t)TSE_CHANNEL_accel_x
                          : a - WHEEL_FRONT + (int32_t)TSE_CHANNEL_wheel_speed_front);
}

/* Classification of a row: gap, one of many, held, predicted only, no second speed,
 * freely rolling axle (ROLLS_UNKNOWN ...). */
typedef struct row_class {
  int gap, sparse, held, predicted, no_second, rolls;
} row_class;

/* output.c   Report estimates and probabilities; judge whether each stiffness is valid,
 *            and why not */
STAGE void report_row(const tse_params *p, const tse_kalman *k, tse_output *out);
void judge_row(const tse_params *p, const tse_kalman *k, const row_class *w, tse_output *out);

/* plausible.c  let a row say whether the channels agree: wrong units, signs, axles
 *              Given:     no_second  1: both wheel speeds are one, and do not say which
 *                                    wheels are ahead
 *              Updated:   k->agreement      O(1) time */
STAGE void plausible_row(const tse_params *p, tse_kalman *k, const tse_input *u, tse_real dt, int no_second);

/* Return the channel that contradicts the others, as fault_channel has it, or 0; *factor:
 * how many times too large it is, 0 where no factor explains it. */
int32_t plausible_channel(const tse_kalman *k, tse_real *factor);

/* backwards.c  Return whether the car rolls backwards, whose wheel speeds may have no
 *              sign.
 *              Given:     z  of this row   speed  of the faster axle, or as it was last,
 *                                                 without its sign
 *              Updated:   f->way           O(1) time */
int rolls_backwards(const tse_params *p, tse_filter *f, const decoded *z, tse_real speed);

/* step.c     a row of tse_step() */
tse_status step_row(const tse_params *p, tse_filter *f, const tse_input *u, tse_output *out);

#endif
