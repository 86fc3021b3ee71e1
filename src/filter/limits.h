/* filter/limits.h - limits of the default filter that follow from physics, from
 * definitions or from the number formats. Tuned constants are in tables/constants.toml.
 * Internal. */
#ifndef FILTER_LIMITS_H
#define FILTER_LIMITS_H

#include "tables/constants.h"

/* Physics of cars, roads and sensors. */
/* clang-format off */
#define STILL_SPEED TSE_R(0.02)         /* [m/s] max speed of a wheel that stands still */
#define JUMP_RATE TSE_R(100)            /* [m/s2] max rate at which a wheel can gain speed */
#define MAX_TURN_SLIP_ANGLE TSE_R(0.1)  /* [rad] max slip angle in a steady turn: beyond it tyres slide */
#define TRACK_SHARE TSE_R(0.02)         /* [1] speed difference of the front wheels over v sin^2 d
                                         * (Ackermann) */
#define MAX_RADIUS_ERROR TSE_R(0.01)    /* [1] max error of the ratio of the wheel radii, else they are
                                         * misfits */
#define MAX_LOG_CHANGE TSE_R(3)         /* max change of a log stiffness: a factor of 20 */
#define SLIP_EVENT_SD TSE_R(0.1)        /* [1] sd of the slip of wheels that begin to lock or spin */
#define STEER_FAULT_SD TSE_R(0.05)      /* [rad] sd of the error of a faulty steering angle */
#define STEER_ACCEPTED_SD TSE_R(0.01)   /* [rad] sd that remains after the fault is accepted */
#define STEER_HOLD_TIME TSE_R(0.095)    /* [s] time constant for which an active driver holds the wheel
                                         * still: of rows of 10 ms every tenth repeats the angle */
#define MAX_ROW_TIME TSE_R(0.125)       /* [s] max row length that the substeps of TSE_SMALL resolve */
#define FORCE_TIME TSE_R(0.1)           /* [s] time constant of the slip that is computed from accel_x */
#define MIN_COURSE_SPEED TSE_R(10)      /* [m/s] below it the sd of a course grows as 1/speed */
#define MIN_SIDEWAYS_SPEED TSE_R(0.2)   /* [m/s] min sideways speed of an axle in the model discrepancy */
#define MIN_ROLLING_SPEED TSE_R(0.5)    /* [m/s] below it a car may change its direction */
#define REVERSE_SD TSE_R(1)             /* [m/s] sd of a gain of speed in the test for reverse, and min
                                         * speed of its turn */
#define MAX_REVERSE_SPEED TSE_R(8)      /* [m/s] max speed of a car in reverse */

/* What follows from a definition, or from a tuned constant. */
#define MAX_GAP_RATE TSE_R(3)           /* [1/s] max rate of gaps: with more, the motion is mostly that of
                                         * the sensors from which it was initialised */
#define STILL_TIME MODEL_TIME           /* [s] wheels slower than STILL_SPEED for so long are at rest. A
                                         * swing of the body lasts as long */
#define OPEN_TIME MODEL_TIME            /* [s] interval at which hypotheses of a kind are opened. An event
                                         * in between is explained by either neighbour */
#define OPEN_TIME_SLIP TSE_R(0.1)       /* [s] the same for wheels that lock or spin, which takes as long */
#define MIN_FAULT TSE_R(1)              /* [1] min amplitude of a fault that needs a reaction: one sd of it */
#define LIKELY TSE_R(0.5)               /* [1] probability: more likely than not */
#define MIN_REVERSE_ODDS TSE_R(4.5)     /* [1] min log odds of reverse: TAIL/2, odds of 90 to 1 */
#define MIN_EACH_ODDS TSE_R(-2.25)      /* [1] min log odds of turn and of gain each, half of that with the
                                         * opposite sign: a slope may contradict the turn so far */
#define BRAKE_ON TSE_R(0.5)             /* [1] brake switch: above it the car brakes (tables/input.toml) */
#define HEADING_SD TSE_R(1)             /* [rad] prior sd of an unknown heading: the first course sets it */

/* Numerics: min divisors, and max values that every number format holds. */
#define MAX_TIME TSE_R(1e6)             /* [s] max of timers and ages */
#define MAX_AGE TSE_R(100)              /* [s] max of ages that are compared with seconds */
#define MAX_SINCE TSE_R(1000)           /* [s] max age of a velocity; max time of rejection; max number of
                                         * gaps */
#define MAX_MOVED TSE_R(1000)           /* [m/s, rad/s, rad] max change of the motion that is kept */
#define MAX_USUAL TSE_R(1000)           /* [1] max ratio of slow innovations to their variance */
#define MAX_FROZEN TSE_R(1000)          /* [log2] max evidence that a channel is frozen */
#define MAX_INFO TSE_R(1e6)             /* [1] max information and score of an event; max nis */
#define MIN_LOG2 TSE_R(-100)            /* [log2] min weight of an event before normalisation */
#define MIN_WEIGHT TSE_R(1e-6)          /* [1] min probability of an event that changes a result */
#define MIN_ALONG_VAR TSE_R(1e-6)       /* [1] min prior variance of the log slip stiffness */
#define MIN_RECALL_VAR TSE_R(1e-4)      /* [unit^2] min variance of a recalled stiffness */
#define MIN_FORCE TSE_R(0.2)            /* [1] min share of a tyre force that a change leaves: below it the
                                         * logarithm of a first-order share is meaningless */
#define MAX_SLOPE TSE_R(100)            /* [unit/unit] max slope of a transition: in one row a variance
                                         * grows by less than 1e7 and stays in range from MAX_D on */
#define MIN_SLIP_VAR TSE_R(1e-6)        /* [unit^2] avoids 0/0 when slip and its variance are both 0 */
#define WALK_TIME TSE_R(1)              /* [s] slow states receive process noise at least this often */
#define WANDER_TIME TSE_R(0.2)          /* [s] the same for gravity along and across the road: ROAD_TIME/40 */
#define MAX_GAIN TSE_R(0.1)             /* [1] max gain of a running mean in one row, however long the row
                                         * is */
#define MIN_NOISE TSE_R(0.04)           /* [1] min noise variance over that of the setting: a fifth of the
                                         * sd */
#define MIN_DT TSE_R(1e-4)              /* [s] min row length: rates divide by it */
#define SAME_SPEED TSE_R(1e-5)          /* [1] relative difference of equal speeds: rounding of six digits */
#define MIN_SPEED_RATIO TSE_R(0.5)      /* [1] min and max ratio of two wheel speeds that are one signal */
#define MAX_SPEED_RATIO TSE_R(2)
#define SAME_RATIO TSE_R(2e-4)          /* [1] relative error of the ratio of two columns rounded to 0.01 */
#define MAX_REPEATS TSE_R(0.999)        /* [1] max probability of a repeat: each repeat remains evidence */
#define MIN_SLOW_VAR TSE_R(1e-9)        /* [unit of the channel^2] min variance of a slow innovation */
#define NEGLIGIBLE TSE_R(0.001)         /* [1] share of S below which consider parameters leave the gain as
                                         * is */
#define MIN_TURNING_SPEED TSE_R(5)      /* [m/s] min divisor that makes a lateral acceleration a yaw rate */
#define MAX_LINEAR_RATIO TSE_R(9)       /* [1] max square of linear force over force: a brush tyre slides
                                         * as a whole there, and its form is meaningless beyond */
#define MIN_SIDESLIP_SPEED TSE_R(0.01)  /* [m/s] below it the sideslip angle is reported as 0 */
#define MIN_SIDESLIP_SD_SPEED TSE_R(1)  /* [m/s] min divisor of the sd of the sideslip angle */
#define MIN_SPEED TSE_R(0.1)            /* [m/s] min divisor of the slopes of course and speed */
#define PAST_INTERVAL TSE_R(0.035)      /* [s] spacing of the past motion: 8 of them span the max latency,
                                         * 0.28 s */
#define MAX_CORRELATION TSE_R(0.999)    /* [1] max correlation of loaded states: variances stay positive */
#define MAX_D TSE_R(1e6)                /* [unit^2] max element of D of the motion: sd of 1000 units */

/* Agreement of the channels: plausible.c. Not tuning parameters: the errors looked for
 * (unit, sign, axle) are far larger than these limits. */
#define SMOOTH_TIME TSE_R(0.25)         /* [s] time constant: removes noise and vibration, keeps manoeuvres */
#define MAX_SMOOTH_DT TSE_R(0.35)       /* [s] max row length of a low pass, else it restarts. Wheel speeds
                                         * in every third row of 10 Hz are shorter */
#define MAX_LATERAL TSE_R(200)          /* [m/s2] max lateral acceleration: reached by yaw rates in
                                         * degrees. Its square fits every number format */
#define MIN_VARIANCE TSE_R(1e-7)        /* [unit^2] min divisor */
#define MAX_VARIANCE_RATIO TSE_R(6.25)  /* [1] max ratio of the variances of a pair: roll, banked roads,
                                         * load, compliance and slip stay below the factor 2.5 */
#define UNRELATED TSE_R(0.1)            /* [1] squared correlation below which a pair disagrees. Noise
                                         * leaves more in any car */
#define AGAINST TSE_R(0.2)              /* [1] squared correlation from which a wrong sign counts where the
                                         * signal is small beside its noise */
#define GAINS_SPEED TSE_R(-0.3)         /* [m/s2] min accel_x of a car that may drive, below it it may
                                         * brake */
#define SLIPPING TSE_R(0.03)            /* [1] max relative speed difference of the axles: beyond it wheels
                                         * spin or lock and do not show the speed */
#define MAX_SPEED_FACTOR TSE_R(6)       /* [1] max factor of a speed: km/h for m/s is 3.6. Both
                                         * accelerometers in g are 9.8 */
#define MIN_SPEED_FACTOR TSE_R(0.17)    /* [1] min factor of a speed: m/s for rad/s is a radius. accel_x
                                         * and accel_y ten times too large are 0.1 */
#define MAX_SCALE TSE_R(1.25)           /* [1] max squared scale of the speed, 1.12^2. Cars of tests/cars
                                         * are within 0.96 .. 1.05 */
#define MIN_SCALE TSE_R(0.7)            /* [1] min, 0.84^2: changing slopes act on accel_x and not on the
                                         * wheels, as slow wheels do */
#define ROUGH_RELATED TSE_R(0.7)        /* [1] min squared correlation of the rough scale: noise and slopes
                                         * make less than a third of the variance */
#define MAX_ROUGH_SCALE TSE_R(2.25)     /* [1] max squared rough scale, 1.5^2: a diameter for a radius is 2 */
#define MIN_ROUGH_SCALE TSE_R(0.3)      /* [1] min, 0.55^2: slopes act as slow wheels do */
#define SCALE_TIME TSE_R(300)           /* [s] memory of the scale: slopes and cambers average out */
#define SCALE_RELATED TSE_R(0.97)       /* [1] min squared correlation of the scale: limits noise and
                                         * slopes */
#define SCALE_SHOWN_ACROSS TSE_R(20)    /* [(m/s2)^2 s] min excitation of the scale, lateral: ten times
                                         * that of a factor of 2.5 */
#define SCALE_SHOWN_ALONG TSE_R(10)     /* [(m/s2)^2 s] min excitation of the scale, longitudinal */
#define MAX_JERK TSE_R(30)              /* [m/s3] max low-passed jerk of an emergency manoeuvre: its square
                                         * over SCALE_TIME fits every number format */
#define COMPLETE_TIME TSE_R(1)          /* [s] 4 SMOOTH_TIME of complete rows: all channels are in step
                                         * then */
#define LATE_TIME TSE_R(15)             /* [s] min time of both pairs, 28 s of driving: several bends */
#define LATE_SHOWN TSE_R(8)             /* [m2/s5] min excitation of a latency: two minutes of a motorway,
                                         * five seconds of a mountain road */
#define ACCEL_SHOWN TSE_R(25)           /* [m2/s5] min excitation of a late accel_y: two corners of a town,
                                         * of which one that leans makes 0.2 s */
#define LATE_SD TSE_R(0.2)              /* [s m/s2.5] three sd of a latency times the root of its
                                         * excitation, on cars of tests/cars */
#define ACCEL_SD TSE_R(1.75)            /* [1] factor on LATE_SD for accel_y and yaw_rate: roads whose bank
                                         * changes */
#define ACCEL_LATE TSE_R(0.01)          /* [s] max relative latency of accel_y. Messages of a bus are 0 ..
                                         * 60 ms late, each by its own delay */
#define SOFTER TSE_R(0.4)               /* [1] max loss of rear stiffness to nominal of a valid car: class
                                         * values or a wet road */
#define LEVER TSE_R(0.7)                /* [m] max unstated distance of the IMU behind the centre of
                                         * gravity */
#define STEER_LATE TSE_R(0.05)          /* [s] max time by which the yaw rate leads the steering angle. Of
                                         * cars it is 0 .. 130 ms behind */
#define YAW_LATE TSE_R(0.11)            /* [s] max latency of the yaw rate behind accel_y: bus, stiff
                                         * tyres, an IMU ahead of the centre of gravity */
#define YAW_LATE_TWICE TSE_R(0.3)       /* [s] max sum of its latencies behind accel_y and behind the
                                         * steering angle: cars reach 0.24 */
#define ROAD_HALVINGS 12                /* [1] halvings of the correlations of gravity where a given road
                                         * begins or ends */
#define MIN_WHEELBASE TSE_R(0.3)        /* [1] min effective wheelbase of an oversteering car at speed,
                                         * over the wheelbase */

/* Min element of D [unit^2]: rounding must not leave it at 0 (fixed point) or make it a
 * denormal number. */
#if defined(TSE_REAL_FIXED)
#define MIN_D ((tse_real)16)
#else
#define MIN_D TSE_R(1e-15)
#endif
/* clang-format on */

#endif
