/* tse/tse.h - the public API of tse, a tyre-stiffness estimator.
 *
 * The default filter is an extended Kalman filter. The kinematics of its model of the car
 * are exact, without small-angle approximations; slip and slip angle of each axle are
 * states. The force of a tyre has a stiffness at zero slip and saturates at the friction
 * limit. The steering angle is an input of the model. The speed of the front wheels and
 * that of the rear wheels are measurements. Likelihood ratios detect a change of the road
 * surface, a change of the tyres of one axle, sliding wheels and sensor faults.
 *
 * The paper's filter (setting form = 1) is the marginalized adaptive particle filter of
 * Berntorp & Di Cairano (2016). Equation numbers, as in (7), refer to that paper.
 * src/EQUATIONS.md lists where each equation is computed and tested.
 * src/tables/constants.toml gives the reason for each threshold and rate.
 *
 *   tse_config c;  tse_params p;  static tse_filter f;  tse_input u;  tse_output y;
 *   tse_config_default(&c);
 *   c.mass = TSE_S(1650);                            required: else no stiffness is valid
 *   if (tse_prepare(&c, &p, NULL) < 0) ...           compute constants from the settings
 *   tse_reset(&p, &f, sizeof f);                     initialise the filter
 *   while (next_row(&u)) tse_step(&p, &f, &u, &y);   process one row at a time
 *
 * The paper's filter needs a larger struct, which holds its particles after a tse_filter:
 *
 *   static tse_filter_paper all;
 *   tse_filter *const f = &all.filter;
 *   tse_config_paper(&c);
 *   tse_reset(&p, f, sizeof all);
 *
 * The caller owns all memory. The library never allocates or prints, and keeps its state
 * only in the structs that the caller passes. These structs hold no pointers, so a copy
 * of a struct is a snapshot. Different filters may run in different threads at once.
 *
 * All quantities are in SI units and in the axes of ISO 8855: x forward, y left, z up.
 * Steering angle, yaw rate and lateral acceleration are positive to the left. */
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

/* Fill c with the defaults of tse/config.h: an ordinary passenger car that is not
 * calibrated. Each parameter has the mean and the standard deviation of passenger cars
 * (src/tables/uncalibrated.toml). After this call, set the known values of your car in
 * any order: mass, lf, lr, driven_axle, wheel radii.
 *   a stiffness 0     tse_prepare() uses the stiffness of an ordinary car with the mass,
 *                     lf and lr in c
 *   yaw inertia 0     tse_prepare() uses mass * lf * lr
 *   mass 0            The mass is unknown: tse_prepare() uses the mass of an ordinary
 *                     car, with an sd of 30 %. With such an sd no stiffness becomes
 *                     valid: the reason of each is TSE_PARAMETERS_UNCERTAIN
 *   c NULL            no effect
 * The C library, the FMU, Python, the web page and the command line have the same
 * defaults. The command `tselab calibrate` finds smaller uncertainties from logs of the
 * car. */
void tse_config_default(tse_config *c);

/* Fill c with a car of 1900 kg whose parameters are known exactly: all uncertainties are
 * 0, and all effects except exact_kinematics are off. Use it for a simulated car, with
 * tse_sim_reset(). For a real car the confidence intervals would be too narrow, because
 * they would not include the uncertainty of its parameters.
 *   c NULL            no effect */
void tse_config_exact(tse_config *c);

/* Set each of mass, yaw inertia and stiffnesses that is 0 to the value that tse_prepare()
 * would use for it, for example to display this value. Settings that are not 0 stay
 * unchanged. If the mass was 0, mass_sd becomes at least 30 %. The filter does not need
 * this call. If you change the mass afterwards, the values that were set here are not
 * adapted to the new mass.
 *   c NULL            no effect */
void tse_config_complete(tse_config *c);

/* Fill c with the paper's filter as printed, and with the car of the paper's study, whose
 * parameters are known exactly. The filter is Algorithm 1 of the paper, without
 * protection against divergence (src/paper/algorithm1.c). src/EQUATIONS.md lists each
 * deviation from equations (1) to (27). This filter needs a tse_filter_paper.
 *   c NULL            no effect */
void tse_config_paper(tse_config *c);

/* Fill c with the paper's filter and with settings that prevent its divergence after a
 * change of road. The forgetting factor of the mean of each stiffness (setting
 * forgetting_mean) is smaller than that of the covariance of the stiffnesses (setting
 * forgetting). While innovations are correlated, the forgetting factor of the mean
 * decreases further, down to the setting forgetting_change. A stiffness that equation
 * (25) draws below stiffness_min is reflected at this limit. The state equation (7) is
 * integrated by a method of second order. Use this filter only for comparison with the
 * paper: on an ordinary car the estimates of the default filter are more reliable. This
 * filter needs a tse_filter_paper.
 *   c NULL            no effect */
void tse_config_robust(tse_config *c);

/* Check that each setting is in its range, or 0 where 0 means "not set". Check that the
 * latencies of the channels differ by at most (TSE_LATENCY_ROWS - 4) * sample_time.
 *   Returned:  TSE_OK, TSE_E_NULL or TSE_E_CONFIG. With TSE_E_CONFIG, *wrong (if
 *              wrong is not NULL) points to the name of the first wrong setting,
 *              a string constant */
tse_status tse_config_check(const tse_config *c, const char **wrong);

/* Check the settings and compute the constants of the filter. In these constants, forces
 * are divided by the mass of the car, and measurements by the noise sd of their sensor.
 *   Updated:   p  constants; unchanged if the result is negative
 *   Returned:  as tse_config_check(), or TSE_E_FORMAT: a constant does not fit the
 *              fixed-point format of this build. *wrong then names the setting */
tse_status tse_prepare(const tse_config *c, tse_params *p, const char **wrong);

/* Initialise the filter: tse_step() treats the next row as the first row of a log.
 *   Given:     p             from tse_prepare()
 *              filter_bytes  size of the caller's struct. With the paper's filter it
 *                            is sizeof(tse_filter_paper), and f is the first member
 *                            of that struct. With the default filter,
 *                            sizeof(tse_filter) or sizeof(tse_filter_paper)
 *   Updated:   f             unchanged if the result is negative
 *   Returned:  TSE_OK, TSE_E_NULL, TSE_E_STATE (p is not from tse_prepare()) or
 *              TSE_E_SIZE
 *   Cost:      O(filter_bytes) */
tse_status tse_reset(const tse_params *p, tse_filter *f, size_t filter_bytes);

/* Fill u with zeros and dt = 0.01 s. Velocities, pedals and road angles are not used,
 * because `given` is 0. After this call, set the values of the measured channels. For a
 * measured velocity, pedal or road angle, set its bit in `given`. If the steering angle,
 * a wheel speed, an acceleration or the yaw rate is not measured, set its bit in
 * `missing`.
 *   u NULL            no effect */
void tse_input_default(tse_input *u);

/* Check a row as tse_step() does, without a filter.
 *   Returned:  TSE_OK, TSE_E_NULL, TSE_E_TIME or TSE_E_INPUT. With TSE_E_TIME and
 *              TSE_E_INPUT, *wrong (if wrong is not NULL) names the wrong member of u */
tse_status tse_input_check(const tse_input *u, const char **wrong);

/* Advance the filter to the time of this row and use its measurements.
 *   Given:     p  the same constants as in the call of tse_reset() for f
 *              u  one row, in SI units and axes of ISO 8855
 *   Updated:   f  unchanged, bit for bit, if the result is negative
 *   Returned:  y  estimates at this row; may be NULL; unchanged if the result is negative
 *              tse_status  negative: the row was refused. 0: done. Positive: done, with a
 *                          warning. Use a stiffness only if its y->reason is TSE_VALID
 *   Cost:      bounded. Default filter O(1), paper's filter O(particles). No allocation,
 *              no recursion, no globals
 *   Source:    src/EQUATIONS.md; for the paper's filter Algorithm 1, equations (16) to
 *              (19) and (22) to (27)
 *
 *   Special cases, both filters. A channel is missing if NaN or marked in u->missing
 *     steering angle or wheel speed out of range or infinite; dt not in (0, 3600] s
 *         The row is refused.
 *     a channel with a latency (settings ..._latency)
 *         Rows wait until the values of all channels are known. Meanwhile the status is
 *         TSE_W_WAITING, and the reasons are those of the last step. Once the values are
 *         known, the filter advances to the time that is estimate_age before this row.
 *     a channel with a latency, and dt above max_gap
 *         The waiting rows are discarded. The next step covers the whole time since the
 *         last step.
 *     a channel with a latency, and rows so dense that TSE_LATENCY_ROWS are not enough
 *         A row is not stored if it follows the last stored row by less than
 *         T/(TSE_LATENCY_ROWS - 2), where T is the time span that the stored rows must
 *         cover. Its dt is added to the dt of the next row that is stored.
 *     speed below hold_speed, reverse, or steering angle beyond max_steer
 *         No stiffness is updated. Default filter: the motion is set from the sensors of
 *         each row, and at standstill the gyro bias is updated.
 *     dt above max_gap
 *         The motion is set from wheel speeds and gyro. All other estimates are kept.
 *   Special cases, default filter
 *     dt up to max_gap that differs from sample_time
 *         The motion is integrated in up to TSE_SUBSTEPS substeps.
 *     a measurement missing or out of range
 *         The other measurements are used. If no measurement is left, the filter only
 *         predicts.
 *     steering angle missing
 *         The last angle is held for up to max_gap. After that the motion is unknown
 *         until the next row with a steering angle.
 *     a measurement whose innovation e exceeds 3 sd
 *         Its gain is reduced: e^2/9 replaces the predicted variance of the innovation.
 *     a faulty channel
 *         regime[TSE_REGIME_FAULT] and fault_channel report it. The channel is ignored
 *         until it agrees with the prediction again. After a fault of the steering angle
 *         the estimation of its offset starts anew. A frozen steering angle counts as
 *         missing.
 *     slip of an axle beyond max_slip
 *         regime[TSE_REGIME_SLIDING] reports it. No stiffness is valid.
 *     a change of road, or of the tyres of one axle
 *         regime[TSE_REGIME_CHANGED] or regime[TSE_REGIME_AXLE] reports it. Stiffness and
 *         grip step to new values, and their sd increases.
 *     sensor noise that differs from the setting
 *         The noise is estimated, up to noise_max times the setting. noise[] reports it.
 *     model discrepancy
 *         The filter assumes that the model has an error in each channel of the IMU. It
 *         treats this error as noise that is correlated over about a second. The sd of
 *         this noise is model_sd times the recent rms of the channel. discrepancy[]
 *         reports this sd.
 *     a velocity (tse_input.given)
 *         It is a measurement with the latency velocity_latency. A value is
 *         ignored if it is NaN or out of range, repeats the previous value, or
 *         contradicts the estimates.
 *     brake or wheel torques given
 *         They are used in place of accel_x to decide which axle rolls freely. If no axle
 *         rolls freely and the grade of the road is uncertain, the longitudinal stiffness
 *         is not updated.
 *     uncertain parameters of the car (settings from mass_sd to grade_sd)
 *         The larger these sds, the smaller are the gains (Schmidt-Kalman filter), and
 *         the larger is the sd of each estimate.
 *   Special cases, paper's filter
 *     steering angle or wheel speed missing
 *         The last value is held for up to max_gap. After that the states stay constant.
 *     a measurement missing or out of range
 *         The other measurements are used. If no measurement is left, the filter only
 *         predicts.
 *     velocity, brake, torques or road given
 *         The row is refused with TSE_E_INPUT. */
tse_status tse_step(const tse_params *p, tse_filter *f, const tse_input *u, tse_output *y);

/* Check a filter struct that was copied from a file or from another program. tse_step()
 * does not check the contents of f.
 *   Given:     p  from tse_prepare() with the same settings
 *   Returned:  TSE_OK, TSE_E_NULL, TSE_E_SIZE, or TSE_E_STATE: f was reset with
 *              parameters other than p, or one of its values is out of range
 *   Cost:      O(filter_bytes) */
tse_status tse_filter_check(const tse_params *p, const tse_filter *f, size_t filter_bytes);

/* Return the contribution of one uncertain parameter to the sd of each stiffness. The
 * squares of the contributions of independent parameters add. To reduce the sds, measure
 * the parameter with the largest contribution more accurately.
 *   Given:     k  TSE_CONSIDER_MASS, TSE_CONSIDER_INERTIA ... (tse/config.h)
 *   Returned:  sd[3]  contribution after the last row, relative to the nominal stiffness
 *                     as tse_output.stiffness_sd; unchanged if the result is negative
 *              TSE_OK, TSE_E_NULL, TSE_E_SIZE (there is no such k) or TSE_E_STATE (f
 *              was reset with parameters other than p, or is the paper's filter)
 *   Cost:      O(1) */
tse_status tse_uncertainty_sd(const tse_params *p, const tse_filter *f, int32_t k, tse_real sd[3]);

/* Convert estimated stiffnesses, which are relative to nominal values, to N
 * (longitudinal) and N/rad (cornering): multiply them by the nominal values of c.
 *   Returned:  mean[3], sd[3], spread[3]  from y->stiffness, y->stiffness_sd and
 *              y->stiffness_spread, in the order TSE_CX_FRONT, TSE_CY_FRONT, TSE_CY_REAR;
 *              each array may be NULL */
void tse_stiffness_si(
    const tse_config *c, const tse_output *y, tse_setting mean[3], tse_setting sd[3], tse_setting spread[3]);

/* Check that this build rounds as IEEE 754 requires. Call it once, before the first
 * filter is used. With -ffast-math, or if the compiler computes sums in a wider format
 * than that of their operands (x87), the library does not compile. Other options change
 * rounding without a compile error, for example the contraction of a product and a sum
 * to a fused multiply-add, or -mrecip. This call detects them.
 *   Returned:  TSE_OK, or TSE_E_BUILD: results will differ from those of other builds.
 *              *wrong (if wrong is not NULL) then points to a string constant that names
 *              the cause, and the compiler option that removes it */
tse_status tse_self_test(const char **wrong);

/* Return the text of a status code of tse/status.h; never NULL. */
const char *tse_status_text(int32_t status);
/* Return the text of a reason code of tse/status.h; never NULL. */
const char *tse_reason_text(int32_t reason);

#ifdef __cplusplus
}
#endif

#include "tse/learnt.h" /* so that programs need to include tse/tse.h only */
#endif
