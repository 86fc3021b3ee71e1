/* tables/constants.h - rates, thresholds and sizes of the default filter, from constants.toml. Internal to the sources. */
#ifndef TABLES_CONSTANTS_H
#define TABLES_CONSTANTS_H

#include "tse/real.h"

/* table: constants */
static const tse_real TAIL = TSE_R(9.0);               /* [1] an innovation beyond 3 sd pulls the less the further off: heavy tails */
static const tse_real LEAST_NOISE = TSE_R(0.04);       /* [1] a fifth of the sensor's sd, squared */
static const tse_real MODEL_TIME = TSE_R(1.0);         /* [s] how long a model discrepancy lasts; what happens, and slow innovations, are averaged over it */
static const tse_real LEAST_ACTIVITY = TSE_R(0.5);     /* [m/s2] what happens where nothing does: unevenness, wind, play */
static const tse_real ROUGHNESS = TSE_R(2.0);          /* [1] what an uneven road adds to it, in sd of the noise of accel_y */
static const tse_real MODEL_FLOOR = TSE_R(0.02);       /* [1] no stiffness is known better: model error */
static const tse_real FLOOR_ALONG = TSE_R(0.08);       /* [1] no slip stiffness: pitch, braking, drag are known less; nor better than the discrepancy: no bend shows another side of it */
static const tse_real MOTION_NOISE = TSE_R(0.01);      /* [1/sqrt(s)] process noise of the motion, in units of the state */
static const tse_real SLIP_SD = TSE_R(0.02);           /* [1] slip of an axle: throttle and brake */
static const tse_real SLIP_TIME = TSE_R(2.0);          /* [s] how long throttle and brake stay */
static const tse_real WALK_SHARE = TSE_R(0.002);       /* [1/sqrt(s)] walk of what hardly changes, as a share of its prior sd */
static const tse_real BANK_SD = TSE_R(0.15);           /* [m/s2] gravity across the road: 1.5 % */
static const tse_real ROAD_TIME = TSE_R(8.0);          /* [s] correlation time of both */
static const tse_real FREE_SLIP_SD = TSE_R(0.00134);   /* [1] slip of an axle that rolls freely: 3e-4, of which one row in 20 is news */
static const tse_real RATE_ROAD = TSE_R(4e-05);        /* [1/s] another road, all tyres, or back on the one before: one in seven hours */
static const tse_real RATE_SLIP = TSE_R(0.1);          /* [1/s] wheels of an axle lock or spin */
static const tse_real RATE_FAULT = TSE_R(1e-07);       /* [1/s] a channel gets an offset, freezes or gets noisy; one axle's tyres change: a puncture, aquaplaning */
static const tse_real CHANGE_SD = TSE_R(0.4);          /* [1] of tyre forces, where a road or an axle changes; of the slip stiffness beside it */
static const tse_real FAULT_SD = TSE_R(30.0);          /* [1] sd of an offset of a channel at fault, in sd of its sensor */
static const tse_real LEAST_CHANGE = TSE_R(0.5);       /* [1] a smaller change of a road or an axle, in sd of what it opens, is none */
static const tse_real OWN_SHARE = TSE_R(0.5);          /* [1] of each move of a stiffness: what was learnt before it, at other slopes, is off by that much */
static const tse_real BELIEVED = TSE_R(0.95);          /* [1] posterior probability from which an event is believed; below it of nothing, no stiffness is valid */
static const tse_real EVENT_SHARE = TSE_R(0.1);        /* [1] of the lasting discrepancy that counts when events are weighed */
static const tse_real USUAL_TIME = TSE_R(20.0);        /* [s] memory of the noise of a channel, and of how large its slow innovations usually are */
static const tse_real LONGEST_EVENT = TSE_R(4.0);      /* [s] an event that is not believed by then is given up: what goes on for longer is a model that does not fit; for so long a change is one */
static const tse_real SETTLE_TIME = TSE_R(2.0);        /* [s] of samples before anything is valid; a change is recent for so long; a channel that agrees for so long is right again */
/* end of table */

#endif
