/* tables/constants.h - rates, thresholds and sizes of the default filter, from constants.toml.
 * Internal to the sources. */
#ifndef TABLES_CONSTANTS_H
#define TABLES_CONSTANTS_H

#include "tse/real.h"

// clang-format off: table constants
#define TAIL TSE_R(9.0)                  /* [1] tail of an innovation's distribution: beyond 3 sd its
                                          * weight falls with the distance. Also the share of accel_y's
                                          * noise variance that is road unevenness, and (squared, in sd of
                                          * its sensor) the sd of a faulty channel's offset */
#define MODEL_TIME TSE_R(1.0)            /* [s] correlation time of the model discrepancy; averaging time
                                          * of the excitation level and of slow innovations */
#define MIN_ACTIVITY TSE_R(0.5)          /* [m/s2] floor of the excitation level, for road unevenness, wind
                                          * and play */
#define MODEL_FLOOR TSE_R(0.02)          /* [1] min relative sd of a stiffness: model error */
#define USUAL_MODEL_SD TSE_R(0.08)       /* [1] model error of an ordinary car. Added to the prior of an
                                          * axle's stiffness on a road with grip. Along the car it is
                                          * permanent (pitch, rolling radii, tyre curve: 10 % rms on four
                                          * cars), or model_sd where that is larger. A model_sd of this
                                          * size doubles the initial variance of slow innovations */
#define SLIP_SD TSE_R(0.02)              /* [1] sd of an axle's slip, from throttle and brake */
#define SLIP_TIME TSE_R(2.0)             /* [s] correlation time of the slip, from throttle and brake */
#define WALK_SHARE TSE_R(0.002)          /* [1/sqrt(s)] random walk of the motion in units of the state,
                                          * and of slow states in units of their prior sd */
#define BANK_SD TSE_R(0.15)              /* [m/s2] sd of gravity across the road: 1.5 % */
#define ROAD_TIME TSE_R(8.0)             /* [s] correlation time of grade and lateral gravity. After so
                                          * long without a wheel speed the speed is unknown. An event that
                                          * is not confirmed by then is dropped */
#define FREE_SLIP_SD TSE_R(0.00134)      /* [1] sd of the slip of a free-rolling axle: 3e-4, with one row
                                          * in 20 as new information */
#define RATE_ROAD TSE_R(0.0001)          /* [1/s] rate of road changes, of returns to the road before, and
                                          * of changes of one axle: one in three hours */
#define RATE_SLIP TSE_R(0.1)             /* [1/s] rate at which wheels of an axle lock or spin */
#define RATE_FAULT TSE_R(1e-07)          /* [1/s] rate at which a channel gets an offset, freezes or
                                          * becomes noisy */
#define CHANGE_SD TSE_R(0.4)             /* [1] sd of the change of tyre forces at a road or axle change,
                                          * and of the slip stiffness beside it. A smaller change is no
                                          * event */
#define OWN_SHARE TSE_R(0.5)             /* [1] after a step of a stiffness, its sd grows by this share of
                                          * the step: linearisation error of what was learnt before */
#define BELIEVED TSE_R(0.95)             /* [1] posterior probability from which an event is accepted.
                                          * Above 1 - BELIEVED no stiffness is valid */
#define EVENT_SHARE TSE_R(0.1)           /* [1] share of the lasting discrepancy that counts when events
                                          * are weighed */
#define USUAL_TIME TSE_R(20.0)           /* [s] memory of a channel's noise and of the usual size of its
                                          * slow innovations */
#define MAX_GROWTH TSE_R(4.0)            /* [1] max ratio of a slow innovation to its usual size that
                                          * counts as usual */
#define SETTLE_TIME TSE_R(2.0)           /* [s] min time of samples before an output is valid, duration for
                                          * which a change is recent, time of agreement after which a
                                          * channel is right again, and time of disagreement after which a
                                          * course has another zero */
#define ASKEW TSE_R(0.0035)              /* [rad] sideslip of a car that drives straight ahead: rear axle
                                          * askew by 0.2 degrees (alignment tolerance), road slope, wind */
#define BLIND_ROWS TSE_R(2.5)            /* [1] sample times without a steering angle after which the held
                                          * angle is no longer used */
#define LASTING TSE_R(0.5)               /* [1] share of the sd of a velocity that lasts MODEL_TIME
                                          * (receiver, INS filter). Also the share of model_sd that limits
                                          * a cornering stiffness while velocities are used */
#define OFF_SHARE TSE_R(4.0)             /* [1] model discrepancy of the lateral speed, over model_sd times
                                          * the speed at which axles slip sideways */
#define MAX_NIS TSE_R(6.0)               /* [1] max normalised innovation squared of a velocity, averaged
                                          * over MODEL_TIME, before it is ignored. A single value counts as
                                          * at most the square of it */
// clang-format on: end of table

#endif
