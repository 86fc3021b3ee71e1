/* tse/tse.h - the public API of tse, a tyre-stiffness estimator.
 *
 * The default filter is a Kalman filter of a car with exact kinematics. Its states
 * include the slip and the slip angle of each axle. Tyres have a stiffness at zero slip
 * and saturate at the friction limit. The steering angle is the input; both wheel speeds
 * are measurements. Road changes, axle changes, sliding and sensor faults are tested by
 * likelihood ratios.
 *
 * The paper's filter (setting form = 1) is the marginalized adaptive particle filter of
 * Berntorp & Di Cairano (2016). Equation numbers refer to that paper. src/EQUATIONS.md
 * lists where each equation is computed and tested. src/tables/constants.toml explains
 * each threshold and rate.
 *
 *   tse_config c;  tse_params p;  static tse_filter f;  tse_input u;  tse_output y;
 *   tse_config_default(&c);
 *   c.mass = TSE_S(1650);                            without a mass no stiffness is valid
 *   if (tse_prepare(&c, &p, NULL) < 0) ...           settings to constants, once
 *   tse_reset(&p, &f, sizeof f);                     initialise
 *   while (next_row(&u)) tse_step(&p, &f, &u, &y);   one sample at a time
 *
 * The paper's filter needs a larger struct for its particles, which begins with a
 * tse_filter:
 *
 *   static tse_filter_paper all;
 *   tse_filter *const f = &all.filter;
 *   tse_config_paper(&c);
 *   tse_reset(&p, f, sizeof all);
 *
 * The caller owns all memory. The library never allocates or prints. Its state is only in
 * the structs that the caller passes. They hold no pointers, so a copy is a snapshot.
 * Different filters may run in different threads at once.
 *
 * SI units, axes of ISO 8855: x forward, y left, z up. Steering angle, yaw rate and
 * lateral acceleration are positive to the left. / */
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

/* Fill c with the defaults of tse/config.h: an ordinary car that is not calibrated, with
 * the mean and the uncertainty of its class (src/tables/uncalibrated.toml). Then set the
 * known values of your car, in any order: mass, lf, lr, driven_axle, wheel radii.
 *   stiffness or yaw inertia 0   tse_prepare() takes the value of the class for this mass
 *                                and axles
 *   mass 0                       unknown: the class's, sd 30 %; no stiffness becomes
 *                                valid
 *                                (TSE_PARAMETERS_UNCERTAIN)
 * C, FMU, Python, page and command share these defaults. `tselab calibrate` finds smaller
 * uncertainties.   c NULL: no effect. */
void tse_config_default(tse_config *c);

/* Fill c with a car that is known exactly: the simulated car of tse_sim_reset(), 1900 kg,
 * all uncertainties 0, effects off. For a real car the intervals would be too narrow.
 *   c NULL: no effect. */
void tse_config_exact(tse_config *c);

/* Replace mass, yaw inertia and stiffness of 0 by the values that tse_prepare() would
 * take, for display. The filter does not need this call. Values that are written here do
 * not follow a mass
 * that is set later.   c NULL: no effect. */
void tse_config_complete(tse_config *c);

/* Fill c with the paper's filter as printed: Algorithm 1 on particles, without protection
 * against divergence (src/paper/algorithm1.c), and the exactly known car of the paper's
 * study. src/EQUATIONS.md lists each deviation from (1)-(27). Needs a tse_filter_paper.
 *   c NULL: no effect. */
void tse_config_paper(tse_config *c);

/* Fill c with the paper's filter and settings that prevent divergence after a road
 * change. The mean forgets faster than the covariance, and still faster while innovations
 * are correlated. Draws are reflected at the bounds. (7) is integrated with second order.
 * A reference: on an
 * ordinary car the default filter is safer. Needs a tse_filter_paper.   c NULL: no
 * effect. */
void tse_config_robust(tse_config *c);

/* Check the range of each setting (0 is allowed where it means "not set"), and that the
 * latencies fit TSE_LATENCY_ROWS rows of sample_time.
 *   Returned:  TSE_OK, TSE_E_NULL or TSE_E_CONFIG; with the latter *wrong (if not NULL)
 *              points to
 *              the name of the first wrong field, a string constant */
tse_status tse_config_check(const tse_config *c, const char **wrong);

/* Check the settings and compute the constants of the filter, normalised by mass and
 * sensor noise.
 *   Updated:   p  constants; unchanged if the result is negative
 *   Returned:  as tse_config_check(). TSE_E_FORMAT if a constant does not fit the
 *              fixed-point
 *              format of this build; *wrong then names the setting */
tse_status tse_prepare(const tse_config *c, tse_params *p, const char **wrong);

/* Initialise the filter: the next row of tse_step() is the first.
 *   Given:     p             from tse_prepare()
 *              filter_bytes  size of the caller's struct: sizeof(tse_filter_paper) with
 *                            the paper's
 *                            filter, where f is its first member; either size with the
 *                            default one
 *   Updated:   f             unchanged if the result is negative
 *   Returned:  TSE_OK, TSE_E_NULL, TSE_E_STATE (p not prepared) or TSE_E_SIZE
 *   Cost:      O(filter_bytes) */
tse_status tse_reset(const tse_params *p, tse_filter *f, size_t filter_bytes);

/* Fill u with a row of zeros, 0.01 s after the row before, without velocities, pedals and
 * road. Then set the channels that are measured, and mark the others in `missing`.
 *   u NULL: no effect. */
void tse_input_default(tse_input *u);

/* Check a row as tse_step() does, without a filter.
 *   Returned:  TSE_OK, TSE_E_NULL, TSE_E_TIME or TSE_E_INPUT; *wrong (if not NULL) then
 *              names the
 *              field */
tse_status tse_input_check(const tse_input *u, const char **wrong);

/* Advance the estimator to this row and use its measurements.
 *   Given:     p  the parameters with which f was reset
 *              u  one row, SI units, ISO 8855
 *   Updated:   f  bit for bit unchanged if the result is negative
 *   Returned:  y  estimates at this row; may be NULL; unchanged if the result is negative
 *              tse_status  negative: refused. 0: done. Positive: warning. Use a stiffness
 *                          only if
 *                          y->reason is TSE_VALID
 *   Cost:      bounded: O(1), paper's filter O(particles). No allocation, no recursion,
 *              no globals
 *   Source:    src/EQUATIONS.md; paper's filter: Algorithm 1, (16)-(19), (22)-(27)
 *
 *   Odd rows, both filters
 *     steering angle or wheel speed out of range,   refused
 *     or infinite; dt not in (0, 3600]
 *     a channel is logged late (..._latency)        rows wait until all channels are
 *                                                   known (status
 *                                                   TSE_W_WAITING, reasons of the last
 *                                                   step), then a
 *                                                   step to the time estimate_age before
 *                                                   the row
 *     ... and dt above max_gap                      waiting rows are dropped; the next
 *                                                   step covers
 *                                                   the whole time
 *     ... and rows faster than TSE_LATENCY_ROWS     are left out; their time counts
 *     slower than hold_speed, reverse, steering     nothing is learnt; default filter:
 *                                                   motion is set
 *     beyond max_steer                              from each row, gyro bias learnt at
 *                                                   standstill
 *     dt above max_gap                              motion is set from wheels and gyro;
 *                                                   learnt
 *                                                   values stay
 *   Odd rows, default filter
 *     any other dt                                  up to TSE_SUBSTEPS substeps
 *     a measurement missing or out of range         the others are used; without any:
 *                                                   predict only
 *     steering angle missing                        held up to max_gap; then the motion
 *                                                   is unknown
 *                                                   until the angle is back
 *     one measurement beyond 3 sd                   weighted down: S is at least e^2/9
 *     a faulty channel                              regime[TSE_REGIME_FAULT],
 *                                                   fault_channel; ignored
 *                                                   until it agrees again. The offset of
 *                                                   a steering
 *                                                   angle is estimated anew; a frozen one
 *                                                   is missing
 *     slip of an axle beyond max_slip               regime[TSE_REGIME_SLIDING]; nothing
 *                                                   is valid
 *     another road, another axle                    regime[TSE_REGIME_CHANGED],
 *                                                   [TSE_REGIME_AXLE];
 *                                                   stiffness and grip step and become
 *                                                   uncertain
 *     noise unlike the setting                      estimated in noise[], up to noise_max
 *                                                   times
 *     model discrepancy                             share model_sd of the recent rms of
 *                                                   each IMU
 *                                                   channel, discrepancy[]
 *     a velocity (tse_input.given)                  measurement, late by
 *                                                   velocity_latency. A
 *                                                   repeated value is not new. Out of
 *                                                   range, NaN or
 *                                                   contradicting: ignored
 *     brake or wheel torques given                  they replace accel_x in the decision
 *                                                   which axle
 *                                                   rolls freely. Without a free axle on
 *                                                   a road of
 *                                                   unknown grade no longitudinal
 *                                                   stiffness is learnt
 *     uncertain parameters (mass_sd .. grade_sd)    Schmidt-Kalman gain; they widen every
 *                                                   sd
 *   Odd rows, paper's filter
 *     steering angle or wheel speed missing         held up to max_gap, then states are
 *                                                   frozen
 *     a measurement missing or out of range         the others are used; without any:
 *                                                   predict only
 *     velocity, brake or torques given              refused, TSE_E_INPUT */
tse_status tse_step(const tse_params *p, tse_filter *f, const tse_input *u, tse_output *y);

/* Check a filter struct that was copied from a file or another program. tse_step() does
 * not check the contents of f.
 *   Given:     p  from tse_prepare() with the same settings
 *   Returned:  TSE_OK, TSE_E_NULL, TSE_E_SIZE, or TSE_E_STATE: of other parameters, or a
 *              value is
 *              outside its range
 *   Cost:      O(filter_bytes) */
tse_status tse_filter_check(const tse_params *p, const tse_filter *f, size_t filter_bytes);

/* Return the share of one uncertain parameter in the sd of each stiffness. The parameter
 * with the largest share is worth measuring better.
 *   Given:     k  TSE_CONSIDER_MASS, TSE_CONSIDER_INERTIA ... (tse/config.h)
 *   Returned:  sd[3]  after the last row, relative to nominal as tse_output.stiffness_sd;
 *                     unchanged
 *                     if the result is negative
 *              TSE_OK, TSE_E_NULL, TSE_E_SIZE (no such k) or TSE_E_STATE (other
 *              parameters, or the
 *              paper's filter)
 *   Cost:      O(1) */
tse_status tse_uncertainty_sd(const tse_params *p, const tse_filter *f, int32_t k, tse_real sd[3]);

/* Convert stiffness to N (longitudinal) and N/rad (cornering) per axle: nominal times
 * relative.
 *   Returned:  mean[3], sd[3], spread[3] in the order TSE_CX_FRONT, TSE_CY_FRONT,
 *              TSE_CY_REAR; each
 *              may be NULL */
void tse_stiffness_si(
    const tse_config *c, const tse_output *y, tse_setting mean[3], tse_setting sd[3], tse_setting spread[3]);

/* Check that this build rounds as IEEE 754 requires. Call it once, before the first
 * filter. -ffast-math and wider intermediate sums are compile errors; this call detects
 * contraction, -mrecip and the like.
 *   Returned:  TSE_OK, or TSE_E_BUILD: results will differ from other builds. *wrong (if
 *              not NULL)
 *              then names the cause and the compiler option that cures it, a string
 *              constant */
tse_status tse_self_test(const char **wrong);

/* Return the text of a status or reason code of tse/status.h; never NULL. */
const char *tse_status_text(int32_t status);
const char *tse_reason_text(int32_t reason);

#ifdef __cplusplus
}
#endif

#include "tse/learnt.h" /* so that one include serves in all layouts */
#endif
