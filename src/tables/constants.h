/* tables/constants.h - rates, thresholds and sizes of the default filter, from
 * constants.toml. Internal to the sources. */
#ifndef TABLES_CONSTANTS_H
#define TABLES_CONSTANTS_H

#include "tse/real.h"

// clang-format off: table constants
#define TAIL TSE_R(9.0)                  /* [1] max innovation^2 / innovation variance, i.e. 3 sd: the gain
                                          * of a measurement with a larger innovation is reduced. Other
                                          * uses: The excitation level (mean squares of a_x and a_y)
                                          * includes TAIL times the noise variance of accel_y, because
                                          * uneven roads increase both this variance and the model error.
                                          * The prior sd of the offset of a faulty channel is TAIL^2 times
                                          * the noise sd of the channel. The log odds of driving in reverse
                                          * are limited to +-TAIL */
#define MODEL_TIME TSE_R(1.0)            /* [s] correlation time of the model discrepancy, i.e. of the
                                          * slowly varying error of predicted accelerations and yaw rate.
                                          * It is also the time constant of two low passes: of the squares
                                          * of accelerations and yaw rate (excitation level), and of the
                                          * innovations (slow innovations) */
#define MIN_ACTIVITY TSE_R(0.5)          /* [m/s2] min excitation level: its square is added to the mean
                                          * squares of a_x and a_y, because road unevenness, wind and
                                          * mechanical play cause accelerations that the model does not
                                          * describe, even if the driver does nothing */
#define MODEL_FLOOR TSE_R(0.02)          /* [1] min relative sd of a stiffness, because of model errors */
#define USUAL_MODEL_SD TSE_R(0.08)       /* [1] relative sd of the error of a stiffness that the model
                                          * errors of an ordinary car cause. (1) The longitudinal stiffness
                                          * has a constant error due to pitch, rolling radii and tyre curve
                                          * (10 % rms on four cars): the filter assumes the sd
                                          * USUAL_MODEL_SD or model_sd, whichever is larger. (2) A change
                                          * of road surface or tyres adds an error of sd 2 USUAL_MODEL_SD
                                          * to the longitudinal stiffness, because the constant error may
                                          * differ before and after the change. (3) In the test for a road
                                          * surface with a stiffness above nominal, USUAL_MODEL_SD^2 is
                                          * added to the prior variance of the stiffness. (4) The mean
                                          * square of slow innovations / its predicted value starts at 1 +
                                          * (model_sd / USUAL_MODEL_SD)^2 */
#define SLIP_SD TSE_R(0.02)              /* [1] sd of the slip that throttle and brake cause at an axle */
#define SLIP_TIME TSE_R(2.0)             /* [s] correlation time of the slip that throttle and brake cause */
#define WALK_SHARE TSE_R(0.002)          /* [1/sqrt(s)] random-walk process noise: sd of the change of a
                                          * state in 1 s. For states of the motion it is relative to the
                                          * unit of the state (src/filter/units.c), for slow states other
                                          * than biases relative to the prior sd of the state */
#define BANK_SD TSE_R(0.15)              /* [m/s2] sd of the lateral component of gravity: a bank of 1.5 % */
#define ROAD_TIME TSE_R(8.0)             /* [s] correlation time of gravity along and across the road
                                          * (grade and bank). It is also a time limit: if no wheel speed is
                                          * measured for longer than ROAD_TIME, the motion is unknown; an
                                          * event hypothesis that is older than ROAD_TIME and not accepted
                                          * may be discarded */
#define FREE_SLIP_SD TSE_R(0.00134)      /* [1] sd of a pseudo-measurement in each row: slip of a freely
                                          * rolling axle = slip due to rolling resistance. FREE_SLIP_SD is
                                          * 3e-4, the sd of the actual difference between these slips,
                                          * times sqrt(20). The factor is necessary because the difference
                                          * is correlated over time: only one row in 20 has new information */
#define RATE_ROAD TSE_R(0.0001)          /* [1/s] prior rate of each of four events: change of road
                                          * surface, return to the previous surface, change of the front
                                          * tyres, change of the rear tyres. Each happens about once in
                                          * three hours */
#define RATE_SLIP TSE_R(0.1)             /* [1/s] rate at which the wheels of an axle lock or spin */
#define RATE_FAULT TSE_R(1e-07)          /* [1/s] rate at which a channel gets an offset, freezes or
                                          * becomes noisy */
#define CHANGE_SD TSE_R(0.4)             /* [1] prior sd of the relative change of stiffness and grip at a
                                          * change of road surface, or of the tyres of an axle. The change
                                          * is CHANGE_SD times an amplitude with the prior N(0, 1). The
                                          * same number 0.4 is the min amplitude: a change of road surface
                                          * or tyres, or locking or spinning wheels, counts as no event if
                                          * the rms of the amplitude, given the data, is below 0.4 */
#define OWN_SHARE TSE_R(0.5)             /* [1] if the estimate of a stiffness steps, its sd grows by this
                                          * share of the step, because the earlier measurements were
                                          * linearised at the old stiffness */
#define BELIEVED TSE_R(0.95)             /* [1] min posterior probability that one of the events of a group
                                          * (lateral or longitudinal) has happened. From this probability
                                          * on, the most probable event of the group is accepted. While the
                                          * probability that any event has happened exceeds 1 - BELIEVED,
                                          * no stiffness is valid */
#define EVENT_SHARE TSE_R(0.1)           /* [1] share of the variance of the model discrepancy that is
                                          * included in the variance of an innovation in the tests of
                                          * events. For the rest of the discrepancy, these tests multiply
                                          * the variance of the innovation by a factor: the observed mean
                                          * square of slow innovations (innovations after a low pass),
                                          * divided by its predicted value, at least 1 */
#define USUAL_TIME TSE_R(20.0)           /* [s] averaging time of the noise variance of a channel, and of
                                          * the mean square of its slow innovations (innovations after a
                                          * low pass) */
#define MAX_GROWTH TSE_R(4.0)            /* [1] in the update of the mean square of slow innovations, a
                                          * single square counts as at most this multiple of the mean, so
                                          * that a short disturbance hardly changes the mean */
#define SETTLE_TIME TSE_R(2.0)           /* [s] min duration of data before an estimate is valid. Also the
                                          * time for which a change of tyres or road surface counts as
                                          * recent; the time for which a faulty channel must agree with the
                                          * prediction before it is used again; and the time for which the
                                          * course (direction of motion, from GNSS) must contradict its
                                          * prediction before the heading is set from the course again */
#define ASKEW TSE_R(0.0035)              /* [rad] sd of the sideslip angle of a car that drives straight
                                          * ahead. Its causes are a rear axle misaligned by 0.2 degrees =
                                          * 0.0035 rad (alignment tolerance), cross slope of the road and
                                          * wind */
#define BLIND_ROWS TSE_R(2.5)            /* [1] max time for which the steering angle may be missing, in
                                          * sample times. Until then the last angle is held and used. After
                                          * a longer time, in which the car may have turned, the next row
                                          * with a steering angle initialises the motion */
#define LASTING TSE_R(0.5)               /* [1] sd of the slow error of a measured velocity, divided by the
                                          * sd of this velocity in the settings. The error has the
                                          * correlation time MODEL_TIME, because GNSS receivers and INS
                                          * filter their output. LASTING also sets a min: while velocities
                                          * are used, the relative sd of a cornering stiffness is at least
                                          * LASTING times model_sd */
#define OFF_SHARE TSE_R(4.0)             /* [1] the measured lateral speed differs from that of the model.
                                          * The sd of this difference (state V_DISCREPANCY) is OFF_SHARE
                                          * times sqrt(model_sd^2 + mass_sd^2) times the rms lateral speed
                                          * of the rear axle, to which the error of the model is
                                          * proportional */
#define MAX_NIS TSE_R(6.0)               /* [1] max normalised innovation squared (NIS) of a measured
                                          * velocity, averaged over MODEL_TIME. While the average is above
                                          * MAX_NIS, values of this velocity are rejected. In the average,
                                          * the NIS of one value counts as at most MAX_NIS^2 */
// clang-format on: end of table

#endif
