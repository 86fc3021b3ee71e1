/* tables/constants.h - rates, thresholds and sizes of the default filter, from
 * constants.toml. Internal to the sources. */
#ifndef TABLES_CONSTANTS_H
#define TABLES_CONSTANTS_H

#include "tse/real.h"

// clang-format off: table constants
#define TAIL TSE_R(9.0)                  /* [1] square of 3 sd: if an innovation exceeds 3 sd, the gain of
                                          * its measurement is reduced. The number also sets two other
                                          * ratios. Road unevenness increases the excitation level by TAIL
                                          * times the noise variance of accel_y. The sd of the offset of a
                                          * faulty channel is TAIL^2 times the sd of its sensor */
#define MODEL_TIME TSE_R(1.0)            /* [s] correlation time of the model discrepancy. Also the
                                          * averaging time of the excitation level and of slow innovations */
#define MIN_ACTIVITY TSE_R(0.5)          /* [m/s2] min excitation level: accelerations caused by road
                                          * unevenness, wind and play */
#define MODEL_FLOOR TSE_R(0.02)          /* [1] min relative sd of a stiffness, because of model errors */
#define USUAL_MODEL_SD TSE_R(0.08)       /* [1] relative sd of the model error of an ordinary car. Its
                                          * square is added to the prior variance of the stiffness in the
                                          * test for a change of road that raises the stiffness above
                                          * nominal. The error of the longitudinal model is a constant
                                          * factor on the stiffness, caused by pitch, rolling radii and
                                          * tyre curve (10 % rms on four cars). The sd of this error is
                                          * USUAL_MODEL_SD or model_sd, whichever is larger. The initial
                                          * mean square of slow innovations is 1 + (model_sd /
                                          * USUAL_MODEL_SD)^2 */
#define SLIP_SD TSE_R(0.02)              /* [1] sd of the slip of an axle that throttle and brake cause */
#define SLIP_TIME TSE_R(2.0)             /* [s] correlation time of the slip that throttle and brake cause */
#define WALK_SHARE TSE_R(0.002)          /* [1/sqrt(s)] sd of the random walk of a state in 1 s: for states
                                          * of the motion in units of the state (src/model/car.h), for slow
                                          * states in sds of their prior */
#define BANK_SD TSE_R(0.15)              /* [m/s2] sd of the lateral component of gravity: a bank of 1.5 % */
#define ROAD_TIME TSE_R(8.0)             /* [s] correlation time of road grade and lateral gravity. If
                                          * there is no wheel speed for this time, the speed is unknown. An
                                          * event that is not confirmed within this time is discarded */
#define FREE_SLIP_SD TSE_R(0.00134)      /* [1] sd of the pseudo-measurement, in each row, of the slip of a
                                          * freely rolling axle. The slip itself has the sd 3e-4. It is
                                          * multiplied by sqrt(20), because the error is correlated and
                                          * only one row in 20 has new information */
#define RATE_ROAD TSE_R(0.0001)          /* [1/s] rate of each of three events: change of road, return to
                                          * the previous road, change of the tyres of one axle. One in
                                          * three hours */
#define RATE_SLIP TSE_R(0.1)             /* [1/s] rate at which the wheels of an axle lock or spin */
#define RATE_FAULT TSE_R(1e-07)          /* [1/s] rate at which a channel gets an offset, freezes or
                                          * becomes noisy */
#define CHANGE_SD TSE_R(0.4)             /* [1] sd by which the logarithms of stiffness and grip change at
                                          * a change of road, or of the tyres of an axle. Also the min
                                          * amplitude of a change of tyres and of sliding wheels, in sds of
                                          * the amplitude: a smaller amplitude counts as no event */
#define OWN_SHARE TSE_R(0.5)             /* [1] if a stiffness steps, its sd grows by this share of the
                                          * step, because the earlier measurements were linearised at the
                                          * old stiffness */
#define BELIEVED TSE_R(0.95)             /* [1] min posterior probability that an event has happened: at
                                          * this probability the most probable event is accepted. While the
                                          * probability exceeds 1 - BELIEVED, no stiffness is valid */
#define EVENT_SHARE TSE_R(0.1)           /* [1] share of the variance of the model discrepancy that is
                                          * included in the variance of an innovation in the tests of
                                          * events */
#define USUAL_TIME TSE_R(20.0)           /* [s] averaging time of the noise variance of a channel and of
                                          * the mean square of its slow innovations (innovations after a
                                          * low pass) */
#define MAX_GROWTH TSE_R(4.0)            /* [1] in the update of the mean square of slow innovations, a
                                          * single square counts as at most this multiple of the mean */
#define SETTLE_TIME TSE_R(2.0)           /* [s] min duration of data before an estimate is valid. Also the
                                          * time for which a change counts as recent, the time for which a
                                          * faulty channel must agree with the prediction before it is used
                                          * again, and the time for which a course must contradict the
                                          * prediction before the heading is initialised from the course
                                          * again */
#define ASKEW TSE_R(0.0035)              /* [rad] sd of the sideslip angle of a car that drives straight
                                          * ahead, because of a rear axle misaligned by 0.2 degrees
                                          * (alignment tolerance), slope of the road, wind */
#define BLIND_ROWS TSE_R(2.5)            /* [1] max time without a steering angle, in sample times, for
                                          * which the last angle is held and used */
#define LASTING TSE_R(0.5)               /* [1] share of the sd of a velocity that is an error with
                                          * correlation time MODEL_TIME (filters of receiver and INS). Also
                                          * the min relative sd of a cornering stiffness while velocities
                                          * are used, in units of model_sd */
#define OFF_SHARE TSE_R(4.0)             /* [1] ratio of two sds: the sd of the model discrepancy of the
                                          * lateral speed, and sqrt(model_sd^2 + mass_sd^2) times the rms
                                          * lateral speed of the rear axle */
#define MAX_NIS TSE_R(6.0)               /* [1] max normalised innovation squared of a velocity, averaged
                                          * over MODEL_TIME. Above this limit the values of the velocity
                                          * are rejected. In the average a single value counts as at most
                                          * MAX_NIS squared */
// clang-format on: end of table

#endif
