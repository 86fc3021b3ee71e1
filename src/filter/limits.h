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
#define TRACK_SHARE TSE_R(0.02)         /* [1] sd of the model error of the front wheel speed in a turn,
                                         * divided by v sin^2(d). v: speed of the car, d: steering angle. The
                                         * error arises because the two front wheels of a car steer by
                                         * different angles (Ackermann), but the model has only one front
                                         * wheel */
#define MAX_RADIUS_ERROR TSE_R(0.01)    /* [1] max magnitude of the state RAD at which the longitudinal
                                         * stiffness is valid, or 3 prior sds of RAD if these are larger. RAD
                                         * is the relative error of the ratio of front to rear wheel radius in
                                         * the settings */
#define MAX_LOG_CHANGE TSE_R(3)         /* [1] max magnitude of the change of the logarithm of a stiffness or
                                         * the grip at a return to the previous road (events.c): a factor of
                                         * 20 */
#define SLIP_EVENT_SD TSE_R(0.1)        /* [1] prior sd of the step of the slip when wheels begin to lock or
                                         * spin (events.c) */
#define STEER_FAULT_SD TSE_R(0.05)      /* [rad] prior sd of the error of a faulty steering angle, which is
                                         * taken as an offset (events.c, backwards.c) */
#define STEER_ACCEPTED_SD TSE_R(0.01)   /* [rad] sd of the error of the estimated fault of a steering angle.
                                         * When the fault is accepted (events.c), the state STEER_OFFSET is
                                         * shifted by the estimate, and the square of this sd is added to the
                                         * variance of STEER_OFFSET */
#define STEER_HOLD_TIME TSE_R(0.095)    /* [s] mean time for which an active driver holds the steering wheel
                                         * still. A working steering angle therefore repeats its value from
                                         * one row to the next with the probability exp(-dt/STEER_HOLD_TIME)
                                         * or more: 0.9 if rows are 10 ms apart. The test for a frozen angle
                                         * (faults.c) allows for these repeats */
#define MAX_ROW_TIME TSE_R(0.125)       /* [s] max time between rows over which a TSE_SMALL build (lateral
                                         * motion only) predicts the motion, with at most TSE_SUBSTEPS = 4
                                         * integration steps per row. After a longer time these steps would be
                                         * too long, and the motion is initialised from the sensors instead.
                                         * In every build, only rows that follow the previous row within this
                                         * time are used to estimate latencies (plausible.c) */
#define FORCE_TIME TSE_R(0.1)           /* [s] time constant of the low pass of the slip, if the slip is
                                         * computed from accel_x instead of the wheel speeds
                                         * (set_slip_by_force() in predict.c) */
#define MIN_COURSE_SPEED TSE_R(10)      /* [m/s] speed below which the sd of a measured course grows as 1/v */
#define MIN_SIDEWAYS_SPEED TSE_R(0.2)   /* [m/s] min sideways speed of the rear axle from which the sd of the
                                         * model discrepancy of the lateral speed is computed. The sd is
                                         * proportional to the sideways speed. Without the minimum it would be
                                         * 0 while the car drives straight ahead */
#define MIN_ROLLING_SPEED TSE_R(0.5)    /* [m/s] speed below which a car may change its direction between
                                         * forwards and backwards */
#define REVERSE_SD TSE_R(1)             /* [m/s] used by two tests whether the car is in reverse
                                         * (backwards.c). The first test compares the gain of speed with the
                                         * integral of accel_x. The variance of their difference is
                                         * REVERSE_SD^2 plus a part due to gravity, which grows with time. The
                                         * second test compares the yaw rate with v d/L (v: speed, d: steering
                                         * angle, L: wheelbase). In the sd of v d/L, v counts as at least
                                         * REVERSE_SD */
#define MAX_REVERSE_SPEED TSE_R(8)      /* [m/s] max speed of a car in reverse */

/* Limits that follow from a definition or from a tuned constant. */
#define MAX_GAP_RATE TSE_R(3)           /* [1/s] max rate of gaps, averaged over USUAL_TIME, at which an
                                         * estimate is valid. At a gap the motion cannot be predicted from the
                                         * previous row, and is initialised from the sensors. At a higher rate
                                         * of gaps the motion is therefore hardly filtered */
#define STILL_TIME MODEL_TIME           /* [s] time for which all wheels must be slower than STILL_SPEED
                                         * before the car counts as at rest. Until then the body of the car
                                         * may still swing */
#define OPEN_TIME MODEL_TIME            /* [s] interval at which the filter opens, for each kind of event
                                         * except sliding wheels, a hypothesis that the event happens now
                                         * (events.c). An event that happens between two openings is explained
                                         * by the hypothesis opened just before or just after the event */
#define OPEN_TIME_SLIP TSE_R(0.1)       /* [s] interval at which a new hypothesis is opened that wheels
                                         * begin to lock or spin: wheels need about this time to lock or to
                                         * spin up */
#define MIN_FAULT TSE_R(1)              /* [1] min amplitude of a fault to which the filter reacts, in units
                                         * of the prior sd of the amplitude */
#define LIKELY TSE_R(0.5)               /* [1] probability above which a hypothesis is more likely than not */
#define MIN_REVERSE_ODDS TSE_R(4.5)     /* [1] min natural log odds of reverse, added up over both tests
                                         * (backwards.c), at which the car counts as in reverse: odds of 90 to
                                         * 1. The value is TAIL/2, the natural log of the ratio of a normal
                                         * density at its mean to the density at 3 sd */
#define MIN_EACH_ODDS TSE_R(-2.25)      /* [1] the car counts as in reverse only if the log odds of each of
                                         * the two tests (yaw rate, gain of speed) are above this:
                                         * -MIN_REVERSE_ODDS/2. The limit is below 0, because one of the tests
                                         * may have an error: the slope of the road, for example, may make its
                                         * log odds negative although the car is in reverse */
#define BRAKE_ON TSE_R(0.5)             /* [1] the car brakes if the value of the brake switch is
                                         * at least this (tables/input.toml) */
#define HEADING_SD TSE_R(1)             /* [rad] sd of an unknown heading. The first measured
                                         * course then determines the heading */

/* Limits of numerics: min divisors, and max values that every number format can hold. */
#define MAX_TIME TSE_R(1e6)             /* [s] max of timers and ages */
#define MAX_AGE TSE_R(100)              /* [s] as MAX_TIME, for times of which only the first seconds matter,
                                         * such as the age of the stored past motion */
#define MAX_SINCE TSE_R(1000)           /* [s] max stored age of a measured velocity, and max stored time for
                                         * which a velocity has been rejected. The same number without unit is
                                         * the max of tse_filter.gaps, the number of recent gaps */
#define MAX_MOVED TSE_R(1000)           /* [m/s, rad/s, rad] max stored difference of speed, yaw rate or
                                         * heading between an earlier row and the present row (velocity.c).
                                         * Also the max of the integral of accel_x in the test for reverse
                                         * (backwards.c) */
#define MAX_USUAL TSE_R(1000)           /* [1] max of tse_kalman.usual, the running mean of the ratio of the
                                         * squared slow (low-passed) innovation to its predicted variance */
#define MAX_FROZEN TSE_R(1000)          /* [log2] max evidence that a channel is frozen: -log2 of the
                                         * probability that a working channel repeats its value as many times
                                         * as this channel has */
#define MAX_INFO TSE_R(1e6)             /* [1] max information (1/variance) of the samples on the amplitude of
                                         * an event. Also the max magnitude of three other numbers: the score,
                                         * which is the derivative of the log-likelihood with respect to the
                                         * amplitude; the normalised innovation squared (nis); and, in m2/s4,
                                         * tse_timing.late (plausible.c), a latency times its excitation */
#define MIN_LOG2 TSE_R(-100)            /* [log2] min logarithm of the weight of an
                                         * event before normalisation */
#define MIN_WEIGHT TSE_R(1e-6)          /* [1] min probability with which an event contributes to a result */
#define MIN_ALONG_VAR TSE_R(1e-6)       /* [1] min prior variance of the logarithm of the slip stiffness,
                                         * because along_share() divides by it */
#define MIN_RECALL_VAR TSE_R(1e-4)      /* [unit^2] min variance of the remembered stiffness or grip with
                                         * which a state is updated after a return to the previous road
                                         * (recall_state() in events.c). The gain is divided by this variance
                                         * plus the variance of the state, and both could otherwise be 0 */
#define MIN_FORCE TSE_R(0.2)            /* [1] min ratio of the tyre force after a change of road or tyres to
                                         * the tyre force before it. The filter estimates the ratio by a
                                         * linear approximation, which may give 0 or a negative number. The
                                         * state changes by the logarithm of the ratio, so that the ratio must
                                         * be positive */
#define MAX_SLOPE TSE_R(100)            /* [unit/unit] max magnitude of an element of a transition matrix. A
                                         * variance then grows in one row by a factor of at most (23 states x
                                         * 100)^2 = 5e6. A variance below MAX_D thus stays in the range of
                                         * floating-point numbers. In fixed point the number format limits the
                                         * elements instead */
#define MIN_SLIP_VAR TSE_R(1e-6)        /* [unit^2] added to the variance of the slip in slip^2/(slip^2 +
                                         * variance), see compute_signal_shares(). Avoids 0/0 when slip and
                                         * variance are both 0 */
#define WALK_TIME TSE_R(1)              /* [s] max time between two additions of process noise to a slow state
                                         * (bias, stiffness, grip, steering). Noise is not added in every row,
                                         * because each addition is a rank-one change of the covariance, which
                                         * takes time */
#define WANDER_TIME TSE_R(0.2)          /* [s] as WALK_TIME, but for gravity along and across the road. It is
                                         * shorter, because gravity changes faster: ROAD_TIME/40, where
                                         * ROAD_TIME is the correlation time of gravity */
#define MAX_GAIN TSE_R(0.1)             /* [1] max gain of a running mean in one row, also if the time since
                                         * the previous row is long */
#define MIN_NOISE TSE_R(0.04)           /* [1] min ratio of the estimated noise variance to the variance in
                                         * the settings. The estimated sd is then a fifth of the sd in the
                                         * settings */
#define MIN_DT TSE_R(1e-4)              /* [s] min dt of a row. A smaller dt counts as MIN_DT, because
                                         * differences are divided by dt to get rates */
#define SAME_SPEED TSE_R(1e-5)          /* [1] max relative difference of two speeds that count as equal.
                                         * Rounding of equal speeds to six digits causes such a difference */
#define MIN_SPEED_RATIO TSE_R(0.5)      /* [1] min stored ratio of front to rear wheel speed
                                         * (tse_filter.ratio). The ratio shows whether both are copies of one
                                         * signal. Copies differ only by the ratio of the wheel radii, which
                                         * is well within MIN_SPEED_RATIO .. MAX_SPEED_RATIO */
#define MAX_SPEED_RATIO TSE_R(2)        /* [1] max stored ratio of front to rear wheel speed, see
                                         * MIN_SPEED_RATIO */
#define SAME_RATIO TSE_R(2e-4)          /* [1] if both wheel speeds are copies of one signal, their ratio
                                         * differs from the stored ratio (tse_filter.ratio) by at most this
                                         * share. Rounding of the logged speeds to 0.01 rad/s causes such a
                                         * difference at 50 rad/s (about 15 m/s) */
#define MAX_REPEATS TSE_R(0.999)        /* [1] max probability with which a working channel repeats its value.
                                         * Each repeat adds -log2 of the probability to the evidence that the
                                         * channel is frozen. At a probability of 1 this would be 0, and the
                                         * test could never find a frozen channel */
#define MIN_SLOW_VAR TSE_R(1e-9)        /* [(unit of the channel)^2] min variance of a slow
                                         * (low-passed) innovation, because it is a divisor */
#define NEGLIGIBLE TSE_R(0.001)         /* [1] if consider parameters cause at most this share of the
                                         * innovation variance S, the gain is not corrected for them */
#define MIN_TURNING_SPEED TSE_R(5)      /* [m/s] min speed by which a lateral acceleration is divided to get a
                                         * yaw rate (update_activity() in update.c), because the quotient is
                                         * too large at low speed. Also the speed above which latencies are
                                         * estimated (plausible.c) */
#define MAX_LINEAR_RATIO TSE_R(9)       /* [1] max of (force of a linear tyre / force of the tyre)^2. At this
                                         * ratio the whole contact patch of a brush tyre slides, and beyond
                                         * it the force is constant */
#define MIN_SIDESLIP_SPEED TSE_R(0.01)  /* [m/s] speed below which the sideslip angle is reported as 0 */
#define MIN_SIDESLIP_SD_SPEED TSE_R(1)  /* [m/s] min speed by which the sd of the lateral speed is divided to
                                         * get the sd of the sideslip angle */
#define MIN_SPEED TSE_R(0.1)            /* [m/s] min speed in the prediction of a measured course and speed
                                         * (velocity.c), because their partial derivatives are divided by
                                         * it */
#define PAST_INTERVAL TSE_R(0.035)      /* [s] interval at which the past motion is stored: 8 intervals span
                                         * the max latency, 0.28 s */
#define MAX_CORRELATION TSE_R(0.999)    /* [1] max correlation in a loaded covariance. Below 1, so that
                                         * conditional variances stay positive */
#define MAX_D TSE_R(1e6)                /* [unit^2] max element of the matrix D (covariance U D U') for a
                                         * state of the motion: an sd of 1000 units. Also the max sum of
                                         * squares of the sensitivities, i.e. of the shifts of the motion due
                                         * to an event or a consider parameter. Above either limit the motion
                                         * counts as unknown, and the next row with steering angle and wheel
                                         * speed initialises the motion */

/* Limits of the test whether the channels agree (plausible.c). They need no tuning: a
 * wrong unit, sign or axle exceeds these limits by far. */
#define SMOOTH_TIME TSE_R(0.25)         /* [s] time constant of the low passes: they remove noise and
                                         * vibration, and keep manoeuvres */
#define MAX_SMOOTH_DT TSE_R(0.35)       /* [s] max time between rows with a wheel speed. After a longer time
                                         * the low passes restart. The limit allows for a log of 10 Hz with
                                         * wheel speeds in every third row, at intervals of 0.3 s */
#define MAX_LATERAL TSE_R(200)          /* [m/s2] max magnitude of speed times yaw rate, and of the rate of
                                         * the speed. With this limit their squares fit every number format.
                                         * Only wrong values reach the limit, for example a yaw rate in
                                         * degrees per second */
#define MIN_VARIANCE TSE_R(1e-7)        /* [unit^2] min variance as a divisor */
#define MAX_VARIANCE_RATIO TSE_R(6.25)  /* [1] max ratio of the variances of two quantities that agree:
                                         * 2.5^2. Roll, banked roads, load, compliance and slip change the
                                         * ratio of the quantities by a factor of less than 2.5 */
#define UNRELATED TSE_R(0.1)            /* [1] the test compares pairs of quantities that should agree. If
                                         * the squared correlation of a pair is below this, the pair disagrees
                                         * (plausible.c). Noise alone does not make the correlation so small,
                                         * because a pair is judged only while its quantities are large
                                         * (min_excitation) */
#define AGAINST TSE_R(0.2)              /* [1] the pairs IN_BENDS and BY_DRIVE (plausible.c) disagree if their
                                         * covariance has the wrong sign and their squared correlation is
                                         * above this. Below it the sign may be wrong by chance, because speed
                                         * differences of the axles are small compared with their noise */
#define GAINS_SPEED TSE_R(-0.3)         /* [m/s2] min accel_x at which the pair BY_DRIVE (plausible.c) is
                                         * used. The pair compares accel_x with the speed difference of the
                                         * axles: driven wheels are faster while the car accelerates. At a
                                         * larger deceleration the car may brake. Undriven wheels then slip,
                                         * too, and the speed difference does not show which axle is driven */
#define SLIPPING TSE_R(0.03)            /* [1] max relative speed difference of the axles at which the pairs
                                         * ALONG and IN_BENDS (plausible.c) are used. For IN_BENDS the
                                         * difference that is expected in the bend is added to this limit. At
                                         * a larger difference wheels spin or lock, and do not measure the
                                         * speed of the car */
#define MAX_SPEED_FACTOR TSE_R(6)       /* [1] max factor (rate of the speed)/accel_x that is attributed to a
                                         * wrong speed if the pairs ACROSS and ALONG (plausible.c) both
                                         * disagree. The cause is either the speed, which both pairs use, or
                                         * both accelerometers. A speed in km/h in place of m/s gives 3.6, and
                                         * counts as a wrong speed. Accelerations in g give 9.8, and count as
                                         * wrong accelerometers */
#define MIN_SPEED_FACTOR TSE_R(0.17)    /* [1] as MAX_SPEED_FACTOR, for factors below 1. A factor above this
                                         * limit is attributed to the speed: a wheel speed in m/s is taken for
                                         * rad/s and multiplied by the wheel radius in m, about 0.3. A smaller
                                         * factor is attributed to the accelerometers: 0.1 if accel_x and
                                         * accel_y are ten times too large */
#define MAX_SCALE TSE_R(1.25)           /* [1] max squared scale of the speed, 1.12^2. The scale is the ratio
                                         * of the speed from the wheels to the true speed of the car. It is
                                         * within 0.96 .. 1.05 for the cars in tests/cars */
#define MIN_SCALE TSE_R(0.7)            /* [1] min squared scale of the speed, 0.84^2. This is further below 1
                                         * than MAX_SCALE is above 1. The scale is computed from the ratio of
                                         * the rate of the speed to accel_x. Changing road slopes increase the
                                         * variance of accel_x alone, which decreases the computed scale */
#define ROUGH_RELATED TSE_R(0.7)        /* [1] min squared correlation of a pair that is used for the rough
                                         * scale of the speed (compute_rough_scale()): noise and road slopes
                                         * are then less than a third of the variance */
#define MAX_ROUGH_SCALE TSE_R(2.25)     /* [1] max square of the roughly estimated scale of the speed, 1.5^2.
                                         * A larger square is reported as implausible: a wheel diameter in
                                         * place of a radius gives 2^2 */
#define MIN_ROUGH_SCALE TSE_R(0.3)      /* [1] min square of the roughly estimated scale of the speed, 0.55^2.
                                         * It is below 1/MAX_ROUGH_SCALE, because road slopes decrease the
                                         * estimated scale (MIN_SCALE) */
#define SCALE_TIME TSE_R(300)           /* [s] averaging time of the scale of the speed: long enough for road
                                         * slopes and cambers to average out */
#define SCALE_RELATED TSE_R(0.97)       /* [1] min squared correlation of a pair that is used for the scale
                                         * of the speed. Noise and road slopes are then at most 3 % of the
                                         * variance */
#define SCALE_SHOWN_ACROSS TSE_R(20)    /* [(m/s2)^2 s] min time integral of the squared v r (speed times yaw
                                         * rate) before the scale of the speed is computed: ten times
                                         * min_excitation of the pair ACROSS (plausible.c). The scale is
                                         * judged by a limit of 1.12 (MAX_SCALE) and a pair by 2.5
                                         * (MAX_VARIANCE_RATIO). The scale therefore needs more data */
#define SCALE_SHOWN_ALONG TSE_R(10)     /* [(m/s2)^2 s] min time integral of the squared accel_x before the
                                         * scale of the speed is computed: five times min_excitation of the
                                         * pair ALONG, for the same reason as SCALE_SHOWN_ACROSS */
#define MAX_JERK TSE_R(30)              /* [m/s3] max low-passed lateral jerk of a row from which latencies
                                         * are estimated. Emergency manoeuvres reach it. With this limit the
                                         * time integral of the squared jerk over SCALE_TIME fits every number
                                         * format */
#define COMPLETE_TIME TSE_R(1)          /* [s] time for which accel_y, yaw rate and steering angle must be
                                         * present before latencies are estimated: 4 SMOOTH_TIME, in which
                                         * their low passes settle */
#define LATE_TIME TSE_R(15)             /* [s] min averaging time (tse_pair.time) of the pairs ACROSS and
                                         * TURNING_BY before a channel is reported as late. The averaging time
                                         * is shorter than the driving time, because old samples are forgotten
                                         * with the time constant USUAL_TIME. It reaches 15 s after 28 s of
                                         * driving, in which a car usually drives several bends */
#define LATE_SHOWN TSE_R(8)             /* [m2/s5] min excitation, i.e. min time integral of the squared
                                         * lateral jerk, before a channel is reported as late. It is reached
                                         * after two minutes on a motorway, and after five seconds on a
                                         * mountain road */
#define ACCEL_SHOWN TSE_R(25)           /* [m2/s5] min excitation, as for LATE_SHOWN, before accel_y is
                                         * reported as late: two corners in a town. A single corner is not
                                         * enough: if it is banked, it has the effect of a latency of 0.2 s */
#define LATE_SD TSE_R(0.2)              /* [m/s^1.5] three sds of an estimated latency [s] are
                                         * LATE_SD/sqrt(x), x [m2/s5] being the time integral of the squared
                                         * lateral jerk (LATE_SHOWN). Measured on the cars in tests/cars */
#define ACCEL_SD TSE_R(1.75)            /* [1] factor by which the sd of a latency between accel_y and
                                         * yaw_rate is larger than LATE_SD gives, because changes of the bank
                                         * of the road act on accel_y alone */
#define ACCEL_LATE TSE_R(0.01)          /* [s] max plausible latency of accel_y behind the yaw rate, or 3
                                         * accel_delay_sd (setting) if that is larger. Tyres that are softer
                                         * (SOFTER) and an IMU further back (LEVER) than in the settings delay
                                         * accel_y by more, and this lag is added to the limit. A larger
                                         * latency is an error in the log: messages on a vehicle bus have
                                         * different delays of 0 .. 60 ms */
#define SOFTER TSE_R(0.4)               /* [1] max plausible value of (nominal - true)/true for the rear
                                         * cornering stiffness. Wet roads cause such a difference. Nominal
                                         * values of a whole vehicle class may also differ so much from those
                                         * of the car. Softer rear tyres delay accel_y. The limit of the
                                         * latency of accel_y (ACCEL_LATE) therefore grows with this value */
#define LEVER TSE_R(0.7)                /* [m] max plausible distance by which the true IMU is further back in
                                         * the car than its position in the settings. The limit of the latency
                                         * of accel_y allows for it, because an IMU further back measures a
                                         * later accel_y */
#define STEER_LATE TSE_R(0.05)          /* [s] max plausible time by which the logged yaw rate leads the
                                         * logged steering angle. In real cars it does not lead, but follows
                                         * by 0 .. 130 ms. If it leads by more than this limit, the steering
                                         * angle is reported as late */
#define YAW_LATE TSE_R(0.11)            /* [s] max plausible latency of the yaw rate behind accel_y. Delays
                                         * on the vehicle bus, tyres that are stiffer than in the settings,
                                         * and an IMU ahead of its position in the settings cause such a
                                         * latency */
#define YAW_LATE_TWICE TSE_R(0.3)       /* [s] max plausible sum of two latencies of the yaw rate: behind
                                         * accel_y, and behind the steering angle. Real cars reach 0.24 s. The
                                         * yaw rate is reported as late only if both this limit and YAW_LATE
                                         * are exceeded */
#define ROAD_HALVINGS 12                /* [1] number of times that the covariances of gravity with other
                                         * states are halved in the row in which the log begins or ceases to
                                         * give grade or bank. Gravity is then set to a new mean, whose error
                                         * is not related to the errors of other states. 12 halvings divide
                                         * the covariances by 4096, after which they are negligible */
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
