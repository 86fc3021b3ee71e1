/* filter/limits.h - limits of the default filter that follow from
 * physics, from definitions or from the number formats. Tuned constants
 * are in tables/constants.toml. Internal. */
#ifndef FILTER_LIMITS_H
#define FILTER_LIMITS_H

#include "tables/constants.h"

/* Limits that follow from the physics of cars, roads and sensors. */
/* clang-format off */
#define STILL_SPEED TSE_R(0.02)         /* [m/s] max measured speed of a wheel that stands still */
#define JUMP_RATE TSE_R(100)            /* [m/s2] max rate at which a wheel can gain speed */
#define MAX_TURN_SLIP_ANGLE TSE_R(0.1)  /* [rad] max slip angle in a steady turn: beyond it tyres slide */
#define TRACK_SHARE TSE_R(0.02)         /* [1] (sd of the front wheel speed)/(v sin^2(d)). v: speed of the
                                         * car, d: steering angle. The model has one front wheel, but the two
                                         * front wheels of a car steer by different angles (Ackermann) */
#define MAX_RADIUS_ERROR TSE_R(0.01)    /* [1] max estimated error of the ratio of the wheel radii. If
                                         * the error is larger, the longitudinal stiffness is not
                                         * valid. If 3 prior sds of the ratio are more than 0.01, the
                                         * limit is 3 prior sds */
#define MAX_LOG_CHANGE TSE_R(3)         /* [1] max change of the logarithm of a stiffness: a factor of 20 */
#define SLIP_EVENT_SD TSE_R(0.1)        /* [1] sd of the slip of wheels that begin to lock or spin */
#define STEER_FAULT_SD TSE_R(0.05)      /* [rad] sd of the offset of a faulty steering angle */
#define STEER_ACCEPTED_SD TSE_R(0.01)   /* [rad] sd added to the steering offset when a steering
                                         * fault is accepted */
#define STEER_HOLD_TIME TSE_R(0.095)    /* [s] mean time for which an active driver holds the steering
                                         * wheel still. If rows are 10 ms apart, nine of ten angles then
                                         * repeat the one before */
#define MAX_ROW_TIME TSE_R(0.125)       /* [s] max time between rows over which a TSE_SMALL build predicts
                                         * the motion. Over a longer time its substeps (at most TSE_SUBSTEPS
                                         * in a row) would be too long for the integration. Also the max time
                                         * between rows that are used for latencies */
#define FORCE_TIME TSE_R(0.1)           /* [s] time constant of the low pass of the slip that is
                                         * computed from accel_x */
#define MIN_COURSE_SPEED TSE_R(10)      /* [m/s] speed below which the sd of a course grows as 1/speed */
#define MIN_SIDEWAYS_SPEED TSE_R(0.2)   /* [m/s] the sd of the model discrepancy of the lateral speed is
                                         * proportional to the sideways speed of the rear axle, which
                                         * counts as at least this speed */
#define MIN_ROLLING_SPEED TSE_R(0.5)    /* [m/s] speed below which a car may change its direction between
                                         * forwards and backwards */
#define REVERSE_SD TSE_R(1)             /* [m/s] test whether the car is in reverse: sd of the difference
                                         * between the gain of speed and the integral of accel_x. Also
                                         * the min speed in the sd of the yaw rate that is computed from
                                         * the steering angle */
#define MAX_REVERSE_SPEED TSE_R(8)      /* [m/s] max speed of a car in reverse */

/* Limits that follow from a definition or from a tuned constant. */
#define MAX_GAP_RATE TSE_R(3)           /* [1/s] max rate of gaps at which an estimate is valid. At a
                                         * higher rate the motion is mostly initialised from the sensors
                                         * and hardly filtered */
#define STILL_TIME MODEL_TIME           /* [s] time for which all wheels must be slower than STILL_SPEED
                                         * before the car counts as at rest. Until then the body of the car
                                         * may still swing */
#define OPEN_TIME MODEL_TIME            /* [s] interval at which a new hypothesis of each kind of event is
                                         * opened (events.c). An event in between is explained by the
                                         * hypothesis opened before it or after it */
#define OPEN_TIME_SLIP TSE_R(0.1)       /* [s] interval at which a new hypothesis of wheels that lock or spin
                                         * is opened: wheels need about this time to lock or to spin up */
#define MIN_FAULT TSE_R(1)              /* [1] min amplitude of a fault to which the filter reacts: one
                                         * prior sd of the fault */
#define LIKELY TSE_R(0.5)               /* [1] probability above which a hypothesis is more likely than not */
#define MIN_REVERSE_ODDS TSE_R(4.5)     /* [1] natural log odds of reverse above which the car counts as in
                                         * reverse: TAIL/2, odds of 90 to 1 */
#define MIN_EACH_ODDS TSE_R(-2.25)      /* [1] the car counts as in reverse only if the log odds of each test
                                         * (yaw rate, gain of speed) are above this: -MIN_REVERSE_ODDS/2.
                                         * The limit is below 0, because an error such as the slope of the
                                         * road may make the log odds of one test negative in reverse, too */
#define BRAKE_ON TSE_R(0.5)             /* [1] the car brakes if the value of the brake switch is
                                         * at least this (tables/input.toml) */
#define HEADING_SD TSE_R(1)             /* [rad] sd of an unknown heading. The first measured
                                         * course then determines the heading */

/* Limits of numerics: min divisors, and max values that every number format can hold. */
#define MAX_TIME TSE_R(1e6)             /* [s] max of timers and ages */
#define MAX_AGE TSE_R(100)              /* [s] max of ages that are compared with times of some seconds */
#define MAX_SINCE TSE_R(1000)           /* [s] max stored age of a measured velocity, and max stored
                                         * time for which a velocity has been rejected. Also the max of
                                         * the number of gaps */
#define MAX_MOVED TSE_R(1000)           /* [m/s, rad/s, rad] max stored change of speed, yaw
                                         * rate and heading */
#define MAX_USUAL TSE_R(1000)           /* [1] max of tse_kalman.usual, the ratio of the mean square of the
                                         * slow innovation to its predicted variance */
#define MAX_FROZEN TSE_R(1000)          /* [log2] max evidence that a channel is frozen */
#define MAX_INFO TSE_R(1e6)             /* [1] max information and max score of an event. Also the max of the
                                         * normalised innovation squared (nis) */
#define MIN_LOG2 TSE_R(-100)            /* [log2] min logarithm of the weight of an
                                         * event before normalisation */
#define MIN_WEIGHT TSE_R(1e-6)          /* [1] min probability with which an event contributes to a result */
#define MIN_ALONG_VAR TSE_R(1e-6)       /* [1] min prior variance of the logarithm of the slip stiffness,
                                         * because along_share() divides by it */
#define MIN_RECALL_VAR TSE_R(1e-4)      /* [unit^2] min variance of a stiffness that is recalled after a
                                         * return to the previous road */
#define MIN_FORCE TSE_R(0.2)            /* [1] min ratio of the tyre force after a change to the tyre force
                                         * before it. The ratio is a linear approximation, and the logarithm
                                         * of a smaller value has no meaning */
#define MAX_SLOPE TSE_R(100)            /* [unit/unit] max element of a transition matrix. With this limit a
                                         * variance grows in one row by a factor of less than 1e7, so that a
                                         * variance of MAX_D stays in range */
#define MIN_SLIP_VAR TSE_R(1e-6)        /* [unit^2] added to the variance of the slip. Avoids 0/0 when slip
                                         * and variance are both 0 */
#define WALK_TIME TSE_R(1)              /* [s] max interval at which process noise is added to a slow state */
#define WANDER_TIME TSE_R(0.2)          /* [s] max interval at which process noise is added to gravity along
                                         * and across the road: ROAD_TIME/40 */
#define MAX_GAIN TSE_R(0.1)             /* [1] max gain of a running mean in one row, also if the time since
                                         * the previous row is long */
#define MIN_NOISE TSE_R(0.04)           /* [1] min ratio of the estimated noise variance to the variance in
                                         * the settings. The estimated sd is then a fifth of the sd in the
                                         * settings */
#define MIN_DT TSE_R(1e-4)              /* [s] min time between rows, because rates are divided by it */
#define SAME_SPEED TSE_R(1e-5)          /* [1] max relative difference of two speeds that count as equal.
                                         * Rounding of equal speeds to six digits causes such a difference */
#define MIN_SPEED_RATIO TSE_R(0.5)      /* [1] min stored ratio of front to rear wheel speed
                                         * (tse_filter.ratio). Copies of one signal differ only by the ratio
                                         * of wheel radii, which is well within these limits */
#define MAX_SPEED_RATIO TSE_R(2)        /* [1] max stored ratio of front to rear wheel speed, see
                                         * MIN_SPEED_RATIO */
#define SAME_RATIO TSE_R(2e-4)          /* [1] if two columns are copies of one signal, the ratio of front to
                                         * rear wheel speed changes from row to row by at most this share.
                                         * Rounding of the logged speeds to 0.01 causes such changes */
#define MAX_REPEATS TSE_R(0.999)        /* [1] max probability of a repeated value. It is below 1, so that
                                         * each repeat is evidence of a frozen channel */
#define MIN_SLOW_VAR TSE_R(1e-9)        /* [unit of the channel^2] min variance of a slow
                                         * (low-passed) innovation, because it is a divisor */
#define NEGLIGIBLE TSE_R(0.001)         /* [1] if consider parameters cause at most this share of the
                                         * innovation variance S, the gain is not corrected for them */
#define MIN_TURNING_SPEED TSE_R(5)      /* [m/s] min speed by which a lateral acceleration is divided to get
                                         * a yaw rate. Also the speed above which latencies are estimated */
#define MAX_LINEAR_RATIO TSE_R(9)       /* [1] max of (force of a linear tyre / force of the tyre)^2. At this
                                         * ratio the whole contact patch of a brush tyre slides, and beyond
                                         * it the force is constant */
#define MIN_SIDESLIP_SPEED TSE_R(0.01)  /* [m/s] speed below which the sideslip angle is reported as 0 */
#define MIN_SIDESLIP_SD_SPEED TSE_R(1)  /* [m/s] min speed by which the sd of the lateral speed is divided to
                                         * get the sd of the sideslip angle */
#define MIN_SPEED TSE_R(0.1)            /* [m/s] min speed by which the partial derivatives of measured
                                         * course and speed divide */
#define PAST_INTERVAL TSE_R(0.035)      /* [s] interval at which the past motion is stored: 8 intervals span
                                         * the max latency, 0.28 s */
#define MAX_CORRELATION TSE_R(0.999)    /* [1] max correlation in a loaded covariance. Below 1, so that
                                         * conditional variances stay positive */
#define MAX_D TSE_R(1e6)                /* [unit^2] max variance that the matrix D (covariance U D U') may
                                         * hold for a state of the motion: an sd of 1000 units. Beyond it the
                                         * motion is unknown */

/* Limits of the test whether the channels agree (plausible.c). They need no tuning: a
 * wrong unit, sign or axle exceeds these limits by far. */
#define SMOOTH_TIME TSE_R(0.25)         /* [s] time constant of the low passes: they remove noise and
                                         * vibration, and keep manoeuvres */
#define MAX_SMOOTH_DT TSE_R(0.35)       /* [s] max time between rows with a wheel speed. After a longer time
                                         * the low passes restart. The limit allows for a log of 10 Hz with
                                         * wheel speeds in every third row, at intervals of 0.3 s */
#define MAX_LATERAL TSE_R(200)          /* [m/s2] speed times yaw rate, and the rate of the speed, are
                                         * limited to this magnitude, so that their squares fit every number
                                         * format. A yaw rate that is in degrees per second by mistake
                                         * reaches the limit */
#define MIN_VARIANCE TSE_R(1e-7)        /* [unit^2] min variance as a divisor */
#define MAX_VARIANCE_RATIO TSE_R(6.25)  /* [1] max ratio of the variances of two quantities that agree:
                                         * 2.5^2. Roll, banked roads, load, compliance and slip change the
                                         * ratio of the quantities by a factor of less than 2.5 */
#define UNRELATED TSE_R(0.1)            /* [1] squared correlation below which the quantities of a pair
                                         * disagree. Noise alone does not make the correlation so small */
#define AGAINST TSE_R(0.2)              /* [1] used for the pairs IN_BENDS and BY_DRIVE (plausible.c). Their
                                         * signals are small compared with the noise, so that the sign of the
                                         * covariance may be wrong by chance. A wrong sign counts only if the
                                         * squared correlation is above this limit */
#define GAINS_SPEED TSE_R(-0.3)         /* [m/s2] the pair BY_DRIVE (plausible.c) is used if accel_x is above
                                         * this. At a larger deceleration the car may brake, and not only the
                                         * driven axle has a longitudinal force */
#define SLIPPING TSE_R(0.03)            /* [1] max relative speed difference of the axles. Beyond it wheels
                                         * spin or lock, and do not measure the speed of the car */
#define MAX_SPEED_FACTOR TSE_R(6)       /* [1] max factor that is explained by a wrong speed alone: km/h in
                                         * place of m/s gives 3.6. A factor of 9.8 is explained by both
                                         * accelerometers in g */
#define MIN_SPEED_FACTOR TSE_R(0.17)    /* [1] min factor that is explained by a wrong speed alone: m/s in
                                         * place of rad/s gives the wheel radius, 0.3. A factor of 0.1 is
                                         * explained by accel_x and accel_y that are ten times too large */
#define MAX_SCALE TSE_R(1.25)           /* [1] max squared scale of the speed, 1.12^2. The scale is the ratio
                                         * of the speed from the wheels to the true speed of the car. It is
                                         * within 0.96 .. 1.05 for the cars in tests/cars */
#define MIN_SCALE TSE_R(0.7)            /* [1] min squared scale of the speed, 0.84^2. The difference to 1 is
                                         * larger than for MAX_SCALE, because changing road slopes change
                                         * accel_x and not the wheel speeds: the rate of the speed then looks
                                         * too small */
#define ROUGH_RELATED TSE_R(0.7)        /* [1] min squared correlation of a pair that is used for the rough
                                         * scale of the speed (compute_rough_scale()): noise and road slopes
                                         * are then less than a third of the variance */
#define MAX_ROUGH_SCALE TSE_R(2.25)     /* [1] max square of the roughly estimated scale of the speed, 1.5^2.
                                         * A larger square is reported as implausible: a wheel diameter in
                                         * place of a radius gives 2^2 */
#define MIN_ROUGH_SCALE TSE_R(0.3)      /* [1] min square of the roughly estimated scale of the speed,
                                         * 0.55^2. It is below 1/MAX_ROUGH_SCALE, because road slopes have
                                         * the effect of a speed that is too small (MIN_SCALE) */
#define SCALE_TIME TSE_R(300)           /* [s] averaging time of the scale of the speed: long enough for road
                                         * slopes and cambers to average out */
#define SCALE_RELATED TSE_R(0.97)       /* [1] min squared correlation of a pair that is used for the scale
                                         * of the speed. Noise and road slopes are then at most 3 % of the
                                         * variance */
#define SCALE_SHOWN_ACROSS TSE_R(20)    /* [(m/s2)^2 s] min time integral of the squared v r (speed
                                         * times yaw rate) before the scale of the speed is computed: ten
                                         * times min_excitation of the pair ACROSS (plausible.c). With
                                         * min_excitation only a factor of 2.5 can be detected, but here a
                                         * factor of 1.12 counts (MAX_SCALE) */
#define SCALE_SHOWN_ALONG TSE_R(10)     /* [(m/s2)^2 s] min time integral of the squared accel_x before the
                                         * scale of the speed is computed: five times min_excitation of the
                                         * pair ALONG */
#define MAX_JERK TSE_R(30)              /* [m/s3] max low-passed lateral jerk, reached in emergency
                                         * manoeuvres. Rows with a larger jerk are not used for latencies, so
                                         * that the squared jerk times SCALE_TIME fits every number format */
#define COMPLETE_TIME TSE_R(1)          /* [s] time for which accel_y, yaw rate and steering angle must be
                                         * present before latencies are estimated: 4 SMOOTH_TIME, in which
                                         * their low passes settle */
#define LATE_TIME TSE_R(15)             /* [s] min averaging time (tse_pair.time) of the pairs ACROSS and
                                         * TURNING_BY before a latency is reported. Old samples are
                                         * forgotten, so that the averaging time reaches 15 s only after 28 s
                                         * of driving. In 28 s a car usually drives several bends */
#define LATE_SHOWN TSE_R(8)             /* [m2/s5] min excitation (time integral of the squared jerk) before a
                                         * latency is reported. It is reached after two minutes on a
                                         * motorway, and after five seconds on a mountain road */
#define ACCEL_SHOWN TSE_R(25)           /* [m2/s5] min excitation before a latency of accel_y is reported:
                                         * two corners in a town. A single corner that is banked has the
                                         * effect of a latency of 0.2 s */
#define LATE_SD TSE_R(0.2)              /* [s m/s2.5] three times the sd of an estimated latency,
                                         * multiplied by the square root of its excitation. Measured on the
                                         * cars in tests/cars */
#define ACCEL_SD TSE_R(1.75)            /* [1] factor by which LATE_SD is larger for a latency between
                                         * accel_y and yaw_rate, because the bank of roads changes */
#define ACCEL_LATE TSE_R(0.01)          /* [s] max plausible latency of accel_y behind the yaw rate, in
                                         * addition to the lag that SOFTER and LEVER allow. A larger limit of
                                         * 3 accel_delay_sd in the settings replaces it. A larger latency is
                                         * an error in the log: messages on a vehicle bus have different
                                         * delays of 0 .. 60 ms */
#define SOFTER TSE_R(0.4)               /* [1] max plausible value of (nominal - true)/true for the rear
                                         * cornering stiffness. Wet roads, and nominal values that are those
                                         * of a vehicle class, cause such a difference */
#define LEVER TSE_R(0.7)                /* [m] max plausible distance by which the IMU is further behind
                                         * the centre of gravity than its position in the settings */
#define STEER_LATE TSE_R(0.05)          /* [s] max plausible time by which the yaw rate leads the steering
                                         * angle. In real cars the yaw rate follows the steering angle by
                                         * 0 .. 130 ms */
#define MAX_LAG TSE_R(0.06)             /* [s] max lag of the steering, unless its prior sd is larger than a
                                         * third of it. The model replaces the angle at the time t - lag by
                                         * angle - lag x rate of the angle: at 0.06 s, a sine of 2 Hz is then
                                         * 25 % too large */
#define YAW_LATE TSE_R(0.11)            /* [s] max plausible latency of the yaw rate behind
                                         * accel_y. The bus, stiff tyres and an IMU ahead of the
                                         * centre of gravity cause such a latency */
#define YAW_LATE_TWICE TSE_R(0.3)       /* [s] max plausible sum of two latencies of the yaw rate: behind
                                         * accel_y, and behind the steering angle. Real cars reach 0.24 s */
#define ROAD_HALVINGS 12                /* [1] in the row in which the log begins or ceases to give grade
                                         * or bank, the covariances of gravity with other states are halved
                                         * 12 times, i.e. divided by 4096. They are then negligible */
#define MIN_WHEELBASE TSE_R(0.3)        /* [1] min of (L + K v^2)/L in the expected yaw rate v d/(L + K v^2);
                                         * L: wheelbase, K: understeer gradient, v: speed, d: steering angle.
                                         * For an oversteering car (K < 0) the divisor would be 0 at the
                                         * critical speed */

/* [unit^2] Min element of the matrix D of a covariance U D U'. Without it rounding could
 * make an element 0 (fixed point) or a denormal number (floating point). */
#if defined(TSE_REAL_FIXED)
#define MIN_D ((tse_real)16)
#else
#define MIN_D TSE_R(1e-15)
#endif
/* clang-format on */

#endif
