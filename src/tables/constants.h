/* tables/constants.h - rates, thresholds and sizes of the default filter, from
 * constants.toml. Internal to the sources. */
#ifndef TABLES_CONSTANTS_H
#define TABLES_CONSTANTS_H

#include "tse/real.h"

// clang-format off: table constants
#define TAIL TSE_R(9.0)                  /* [1] square of 3 sd, the limit of outlier tests: if an
                                          * innovation exceeds 3 sd, the gain of its measurement is
                                          * reduced. Three other numbers are set by TAIL. To the excitation
                                          * level, the mean squares of a_x and a_y, TAIL times the noise
                                          * variance of accel_y is added, which road unevenness increases.
                                          * The sd of the offset of a faulty channel is TAIL^2 times the sd
                                          * of its sensor. The log odds of driving in reverse are limited
                                          * to +-TAIL */
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
#define USUAL_MODEL_SD TSE_R(0.08)       /* [1] relative sd of the model error of an ordinary car. It is
                                          * used four times. In the test for a change of road surface that
                                          * would raise the stiffness above nominal, its square is added to
                                          * the prior variance of the stiffness. The longitudinal model has
                                          * a constant relative error, caused by pitch, rolling radii and
                                          * tyre curve (10 % rms on four cars): its sd is USUAL_MODEL_SD or
                                          * the setting model_sd, whichever is larger. A change of road
                                          * surface or tyres adds an error of sd 2 USUAL_MODEL_SD to the
                                          * longitudinal stiffness: once this model error for the time
                                          * before the change, once for the time after. The ratio of the
                                          * mean square of slow innovations to its predicted value starts
                                          * at 1 + (model_sd / USUAL_MODEL_SD)^2 */
#define SLIP_SD TSE_R(0.02)              /* [1] sd of the slip that throttle and brake cause at an axle */
#define SLIP_TIME TSE_R(2.0)             /* [s] correlation time of the slip that throttle and brake cause */
#define WALK_SHARE TSE_R(0.002)          /* [1/sqrt(s)] sd by which the process noise of a random walk
                                          * changes a state in 1 s. For states of the motion it is a number
                                          * of units of the state (src/model/car.h). For slow states, other
                                          * than biases, it is a share of the sd of their prior */
#define BANK_SD TSE_R(0.15)              /* [m/s2] sd of the lateral component of gravity: a bank of 1.5 % */
#define ROAD_TIME TSE_R(8.0)             /* [s] correlation time of gravity along and across the road
                                          * (grade and bank). It is also the limit of two times: without a
                                          * wheel speed for longer, the motion is unknown; and a hypothesis
                                          * of an event that has not been accepted after this time may be
                                          * discarded */
#define FREE_SLIP_SD TSE_R(0.00134)      /* [1] sd of a pseudo-measurement that is made in each row: that
                                          * the slip of a freely rolling axle equals the slip due to
                                          * rolling resistance. The actual slip differs from this value by
                                          * 3e-4 (sd). This sd is multiplied by sqrt(20), because the
                                          * difference is correlated over time, so that only one row in 20
                                          * has new information */
#define RATE_ROAD TSE_R(0.0001)          /* [1/s] prior rate of each of four events: change of road
                                          * surface, return to the previous surface, change of the front
                                          * tyres, change of the rear tyres. Each happens about once in
                                          * three hours */
#define RATE_SLIP TSE_R(0.1)             /* [1/s] rate at which the wheels of an axle lock or spin */
#define RATE_FAULT TSE_R(1e-07)          /* [1/s] rate at which a channel gets an offset, freezes or
                                          * becomes noisy */
#define CHANGE_SD TSE_R(0.4)             /* [1] prior sd of the change of the logarithms of stiffness and
                                          * grip at a change of road surface, or of the tyres of an axle.
                                          * It is also a min amplitude. The amplitude of an event has the
                                          * prior N(0, 1). A change of road surface or tyres, or wheels
                                          * that lock or spin, with an amplitude below CHANGE_SD in
                                          * magnitude count as no event */
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
                                          * events. There the rest of the discrepancy is represented by a
                                          * factor on this variance: the observed mean square of slow
                                          * innovations (innovations after a low pass), divided by its
                                          * predicted value, at least 1 */
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
#define MAX_NIS TSE_R(6.0)               /* [1] max mean of the normalised innovation squared of a measured
                                          * velocity, averaged over MODEL_TIME. Above this limit the values
                                          * of the velocity are rejected. A single value counts as at most
                                          * MAX_NIS^2 in the mean */
// clang-format on: end of table

#endif
