/* tables/constants.h - rates, thresholds and sizes of the default filter, from constants.toml. Internal to the sources. */
#ifndef TABLES_CONSTANTS_H
#define TABLES_CONSTANTS_H

#include "tse/real.h"

/* table: constants */
#define TAIL TSE_R(9.0)                  /* [1] an innovation beyond 3 sd pulls the less the further off:
                                          * heavy tails; so much of the noise of accel_y happens, as an
                                          * uneven road; the offset of a channel at fault has the square of
                                          * that as sd, in sd of its sensor: it may read anything */
#define MODEL_TIME TSE_R(1.0)            /* [s] how long a model discrepancy lasts; what happens, and slow
                                          * innovations, are averaged over it */
#define LEAST_ACTIVITY TSE_R(0.5)        /* [m/s2] what happens where nothing does: unevenness, wind, play */
#define MODEL_FLOOR TSE_R(0.02)          /* [1] no stiffness is known better: model error */
#define USUAL_MODEL_SD TSE_R(0.08)       /* [1] what the model of an ordinary car lacks: stiffness of an
                                          * axle on a road with grip, beside its prior; along the car
                                          * always the same, pitch, rolling radii, curve of the tyres (the
                                          * filter alone is 10 % off on four cars, rms), model_sd where
                                          * that is more; a model_sd of that size doubles the usual
                                          * variance of slow innovations at the start */
#define SLIP_SD TSE_R(0.02)              /* [1] slip of an axle: throttle and brake */
#define SLIP_TIME TSE_R(2.0)             /* [s] how long throttle and brake stay */
#define WALK_SHARE TSE_R(0.002)          /* [1/sqrt(s)] walk of the motion in units of the state, and of
                                          * what hardly changes in its prior sd */
#define BANK_SD TSE_R(0.15)              /* [m/s2] gravity across the road: 1.5 % */
#define ROAD_TIME TSE_R(8.0)             /* [s] correlation time of grade and lateral gravity; without any
                                          * wheel speed for as long the speed is not known; the likeliest
                                          * event is given up that is not believed by then */
#define FREE_SLIP_SD TSE_R(0.00134)      /* [1] slip of an axle that rolls freely: 3e-4, of which one row
                                          * in 20 is news */
#define RATE_ROAD TSE_R(0.0001)          /* [1/s] another road, all tyres, or back on the one before; the
                                          * tyres of one axle: one in three hours */
#define RATE_SLIP TSE_R(0.1)             /* [1/s] wheels of an axle lock or spin */
#define RATE_FAULT TSE_R(1e-07)          /* [1/s] a channel gets an offset, freezes or gets noisy */
#define CHANGE_SD TSE_R(0.4)             /* [1] of tyre forces, where a road or an axle changes; of the
                                          * slip stiffness beside it; a change below that many sd is none */
#define OWN_SHARE TSE_R(0.5)             /* [1] of each move of a stiffness: what was learnt before it, at
                                          * other slopes, is off by that much */
#define BELIEVED TSE_R(0.95)             /* [1] posterior probability that something has happened from
                                          * which the likeliest event is believed; no stiffness is valid
                                          * from 1 less it on */
#define EVENT_SHARE TSE_R(0.1)           /* [1] of the lasting discrepancy that counts when events are
                                          * weighed */
#define USUAL_TIME TSE_R(20.0)           /* [s] memory of the noise of a channel, and of how large its slow
                                          * innovations usually are */
#define MOST_GROWTH TSE_R(4.0)           /* [1] a slow innovation counts as that many times the usual one
                                          * at most: an event is not what is usual */
#define SETTLE_TIME TSE_R(2.0)           /* [s] of samples before anything is valid; a change is recent for
                                          * so long; a channel that agrees for so long is right again; a
                                          * course that does not fit has another zero */
#define ASKEW TSE_R(0.0035)              /* [rad] sideslip of a car that goes straight on: its rear axle is
                                          * 0.2 degrees askew (alignment tolerance), roads slope, wind
                                          * blows */
#define BLIND_ROWS TSE_R(2.5)            /* [1] sample times without a steering angle after which the car
                                          * has turned otherwise than the angle that was held */
#define LASTING TSE_R(0.5)               /* [1] share of the sd of a velocity that is no white noise and
                                          * lasts MODEL_TIME: receivers and INS filter; of model_sd, which
                                          * a cornering stiffness is not known better than while velocities
                                          * are in use */
#define OFF_SHARE TSE_R(4.0)             /* [1] model discrepancy of the speed across, over model_sd times
                                          * how fast axles slip sideways */
#define MOST_NIS TSE_R(6.0)              /* [1] innovations of a velocity squared over their variance,
                                          * averaged over MODEL_TIME: above, it is left out; a single one
                                          * counts as the square of that at most */
/* end of table */

#endif
