/* tse/tse.h - the public API of tse, a tyre-stiffness estimator.
 *
 * One Kalman filter of a car: exact kinematics, slip and slip angle of each axle as states. Tyres have a stiffness at zero slip and
 * saturate at the friction limit. Both wheel speeds are measured, the steering angle is the only input. Road changes, axle changes, sliding
 * and sensor faults are tested by likelihood ratios. Form 1 is the marginalized adaptive particle filter of Berntorp & Di Cairano
 * (2016). Equation numbers refer to that paper; src/EQUATIONS.md says where each equation is computed and tested, src/tables/constants.toml what
 * every threshold and rate of the default form is.
 *
 *   tse_config c;  tse_params p;  static tse_filter f;  tse_input u;  tse_output y;
 *   tse_config_default(&c);   c.mass = TSE_S(1650); ...           without a mass no stiffness is valid
 *   if (tse_prepare(&c, &p, NULL) < 0) ...                        settings -> constants, once
 *   tse_reset(&p, &f, sizeof f);                                  reset is also init
 *   while (next_row(&u)) tse_step(&p, &f, &u, &y);                one sample at a time
 *
 * Only the paper's form holds particles, in a larger struct that begins with a tse_filter:
 *
 *   static tse_filter_paper all;   tse_filter *const f = &all.filter;         instead of  static tse_filter f;
 *   tse_config_paper(&c);  ...     tse_reset(&p, f, sizeof all);              the rest is the same, with f
 *
 * The caller owns all memory. The library never allocates, prints, or keeps anything between calls outside
 * the objects it is handed; they hold no pointer: a copy of the struct is a snapshot of the filter.
 * Different filters may be stepped in different threads at once.
 *
 * Axes ISO 8855 (x forward, y left, z up), SI units; steering angle, yaw rate and lateral acceleration are
 * positive to the left.
 */
#ifndef TSE_TSE_H
#define TSE_TSE_H

#include <stddef.h>
#include <stdint.h>

#include "tse/config.h"
#include "tse/input.h"
#include "tse/output.h"
#include "tse/real.h"
#include "tse/status.h"
#include "tse/version.h"
#include "tse/state.h"

#define tse_config_default TSE_NAME(tse_config_default)
#define tse_config_exact   TSE_NAME(tse_config_exact)
#define tse_config_complete TSE_NAME(tse_config_complete)
#define tse_config_paper   TSE_NAME(tse_config_paper)
#define tse_config_robust  TSE_NAME(tse_config_robust)
#define tse_config_check   TSE_NAME(tse_config_check)
#define tse_prepare        TSE_NAME(tse_prepare)
#define tse_reset          TSE_NAME(tse_reset)
#define tse_input_default  TSE_NAME(tse_input_default)
#define tse_input_check    TSE_NAME(tse_input_check)
#define tse_step           TSE_NAME(tse_step)
#define tse_filter_check   TSE_NAME(tse_filter_check)
#define tse_self_test      TSE_NAME(tse_self_test)
#define tse_stiffness_si   TSE_NAME(tse_stiffness_si)
#define tse_uncertainty_sd        TSE_NAME(tse_uncertainty_sd)
#define tse_status_text    TSE_NAME(tse_status_text)
#define tse_reason_text    TSE_NAME(tse_reason_text)

#ifdef __cplusplus
extern "C" {
#endif

/* Fill c with the defaults of tse/config.h: an ordinary car that nobody has calibrated, with what cars of its class have and how
 * uncertain that is (src/tables/uncalibrated.toml). Then set, in any order, what is known of yours: mass, lf, lr, driven_axle, wheel
 * radii. Stiffness and yaw inertia that stay 0 are those of the class under the mass and axles that tse_prepare() is given. A mass
 * that stays 0 is not known: one of the class with an sd of 30 %, and no stiffness is valid (TSE_PARAMETERS_UNCERTAIN). The same in
 * C, FMU, Python, page and command. `tselab calibrate` finds smaller uncertainties. c NULL: nothing happens. */
void tse_config_default(tse_config *c);

/* Fill c with a car that is known exactly, as only a simulated one is: that of tse_sim_reset(), 1900 kg, uncertainties 0, effects off.
 * Of a real car intervals are then too narrow. c NULL: nothing happens. */
void tse_config_exact(tse_config *c);

/* Write down what tse_prepare() takes for mass, yaw inertia and stiffness that are 0, to show it. A filter does not need it; what is
 * written down follows no mass that is set later. c NULL: nothing happens. */
void tse_config_complete(tse_config *c);

/* The filter of the paper as printed: Algorithm 1 on particles, with nothing to save it where it diverges (src/paper/algorithm1.c).
 * The car is that of tse_config_exact(), as in the paper's study.
 * src/EQUATIONS.md lists each deviation from (1)-(27). Needs a tse_filter_paper. c NULL: nothing happens. */
void tse_config_paper(tse_config *c);

/* The same code with settings that keep it from diverging after a change of road: the mean forgets faster than the covariance, and faster
 * still where innovations last; draws are reflected; (7) is integrated by a method of second order. A reference, not as safe as the
 * default on an ordinary car. Needs a tse_filter_paper. c NULL: nothing happens. */
void tse_config_robust(tse_config *c);

/* Check every setting against its range (a default may be outside it: 0, not set), and that the latencies (settings ..._latency) fit TSE_LATENCY_ROWS rows of sample_time.
 *   Returned:  TSE_OK, TSE_E_NULL or TSE_E_CONFIG; then *wrong (if not NULL) points to the name of the first
 *              wrong field, a string constant. */
tse_status tse_config_check(const tse_config *c, const char **wrong);

/* Check the settings and turn them into the constants of the filter (normalised by mass and sensor noise).
 *   Updated:   p  constants; unchanged when the result is negative
 *   Returned:  as tse_config_check(); TSE_E_FORMAT when a number that follows from the settings does not fit the number format of
 *              this build (fixed point); then *wrong names the setting */
tse_status tse_prepare(const tse_config *c, tse_params *p, const char **wrong);

/* Start, or start again: the next row given to tse_step() is the first.
 *   Given:     p  from tse_prepare()      filter_bytes  size of the struct as the caller compiled it: of tse_filter_paper in
 *              the paper's form, where f is its first member; of either in the default form
 *   Updated:   f  unchanged when the result is negative
 *   Returned:  TSE_OK, TSE_E_NULL, TSE_E_STATE (p not prepared) or TSE_E_SIZE.    O(filter_bytes) time. */
tse_status tse_reset(const tse_params *p, tse_filter *f, size_t filter_bytes);

/* Fill u with a row that measures 0 on every channel, 0.01 s after the row before, and no velocity, no pedal: then set what the log has,
 * and mark what it lacks in `missing`. u NULL: nothing happens. */
void tse_input_default(tse_input *u);

/* Say what tse_step() would refuse in this row, without a filter.
 *   Returned:  TSE_OK, TSE_E_NULL, TSE_E_TIME or TSE_E_INPUT; then *wrong (if not NULL) names the field. */
tse_status tse_input_check(const tse_input *u, const char **wrong);

/* Advance the estimator to this row and use its measurements.
 *   Given:     p  the parameters f was reset with      u  one row, SI units, ISO 8855
 *   Updated:   f  bit for bit unchanged when the result is negative
 *   Returned:  y  estimates at this row (may be NULL; unchanged when the result is negative)
 *              tse_status: negative refused, 0 ok, positive done with a caution; whether to use a stiffness says y->reason
 *   Policy for odd rows
 *     steering angle or wheel speed out of range (also infinite), dt not in (0, 3600]   refused
 *     a channel logged late (..._latency)        rows wait, with the reasons of the last step and the status TSE_W_WAITING, until
 *                                                all channels are known; then a step to that time, estimate_age before the row.
 *                                                dt above max_gap: what waits is given up, and the next step, when the channels
 *                                                are known again, has the whole time. Rows that come faster than the memory can
 *                                                hold (TSE_LATENCY_ROWS) are left out, their time is not
 *     |wheel speed| below hold_speed, reverse,   nothing is learnt; form 0: motion is placed anew with each row, gyro bias learnt at standstill
 *     steering angle beyond max_steer
 *     dt above max_gap                           motion is placed anew from wheels and gyro; what was learnt is kept
 *   ... in the default form
 *     any other dt                               up to TSE_SUBSTEPS steps; a late row loses information and biases nothing
 *     a measurement missing or out of range      the others are used, wheel speeds, too; all missing: predicts only
 *     steering angle missing                     held up to max_gap, then nothing is known of the motion until it is back
 *     one measurement beyond 3 sd                is down-weighted: its S is at least e^2/9
 *     a channel at fault                         regime[TSE_REGIME_FAULT], fault_channel: it is left out until it agrees again; of the
 *                                                steering angle the offset is estimated anew, one that is frozen is missing
 *     slip of an axle beyond max_slip            regime[TSE_REGIME_SLIDING]: nothing is valid
 *     another road, an axle's tyres              regime[TSE_REGIME_CHANGED], [TSE_REGIME_AXLE]: stiffness and grip move, and are
 *                                                uncertain
 *     noise other than the setting               found, noise[]; at most noise_max times
 *     model discrepancy                          a share model_sd of the recent rms of each IMU channel, discrepancy[]
 *     a velocity is given (tse_input.given)      a measurement, late by velocity_latency; a value that repeats the one before is no
 *                                                new one; out of range or NaN: not there; one that does not fit is left out until
 *                                                it does. In form 1: refused, TSE_E_INPUT
 *     brake, wheel torques given                 they say which axle rolls freely, in place of accel_x; while none does, on a road
 *                                                that may climb, nothing is learnt of the longitudinal stiffness. In form 1: refused
 *     uncertain parameters                       settings from mass_sd to grade_sd: Schmidt's gain; they widen the sd of all estimates
 *   ... in form 1
 *     steering angle or wheel speed missing      last value held up to max_gap, then states frozen; predicts only
 *     a measurement missing or out of range      the others are used; all missing: predicts only
 *   Source:    src/EQUATIONS.md; form 1: Algorithm 1, (16)-(19), (22)-(27).
 *   Bounded time, O(1) or O(particles); no allocation, no recursion, no global state. */
tse_status tse_step(const tse_params *p, tse_filter *f, const tse_input *u, tse_output *y);

/* Check a filter struct copied from a file or another program before it is stepped: tse_step() trusts the contents of f. Make p
 * anew from the settings.
 *   Returned:  TSE_OK, TSE_E_NULL, TSE_E_SIZE, or TSE_E_STATE: of other parameters, or something in it is outside its range.
 *              O(N) time. */
tse_status tse_filter_check(const tse_params *p, const tse_filter *f, size_t filter_bytes);

/* Return how much one uncertain parameter of the car adds to the sd of each stiffness: what to measure better first.
 *   Given:     k  which: TSE_CONSIDER_MASS, TSE_CONSIDER_INERTIA ... (tse/config.h)
 *   Returned:  sd[3]  after the last row, relative to nominal, as tse_output.stiffness_sd; unchanged when the result is negative
 *              TSE_OK, TSE_E_NULL, TSE_E_SIZE (no such k) or TSE_E_STATE (of other parameters, or of a form other than 0).
 *              O(1) time. */
tse_status tse_uncertainty_sd(const tse_params *p, const tse_filter *f, int32_t k, tse_real sd[3]);

/* Convert the stiffnesses to N (longitudinal) and N/rad (cornering) per axle: nominal value times relative one.
 *   Returned:  mean[3], sd[3], spread[3] in the order TSE_CX_FRONT, TSE_CY_FRONT, TSE_CY_REAR; each may be NULL. */
void tse_stiffness_si(const tse_config *c, const tse_output *y, tse_setting mean[3], tse_setting sd[3], tse_setting spread[3]);

/* Check that this build rounds as IEEE 754 says and as the library is tested. What can be seen when it is compiled is an error there
 * (-ffast-math, sums that are wider than a number); contraction, -mrecip and the like cannot. Call it once, before the first filter.
 *   Returned:  TSE_OK, or TSE_E_BUILD: estimates will have other bits than elsewhere, or wrong ones; then *wrong (if not NULL)
 *              says what is found and the option that cures it, a string constant */
tse_status tse_self_test(const char **wrong);

/* Return the sentence of a status or reason code from tse/status.h; never NULL. */
const char *tse_status_text(int32_t status);
const char *tse_reason_text(int32_t reason);

#ifdef __cplusplus
}
#endif

#include "tse/learnt.h" /* one include serves in all layouts: as one file tse.h holds it, too */
#endif
