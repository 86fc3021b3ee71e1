/* filter/limits.h - what the default filter takes no more or no less than: numbers that
 * nobody tunes. What is tuned is in tables/constants.toml. Internal. */
#ifndef FILTER_LIMITS_H
#define FILTER_LIMITS_H

#include "tables/constants.h"

/* Physics: what cars, roads and sensors do. */
#define STILL_SPEED TSE_R(0.02)       /* m/s: wheels that turn slower stand */
#define JUMP_RATE TSE_R(100)          /* m/s2: no wheel that grips or spins gains speed faster */
#define MOST_SIDEWAYS TSE_R(0.1)      /* rad: slip angle of a steady turn, further off the tyres have no
                                       * stiffness */
#define TRACK_SHARE TSE_R(0.02)       /* 1: of the speed, that the wheels of the front axle differ from one
                                       * by, over the sine of their angle squared */
#define RADII_APART TSE_R(0.01)       /* 1: of the radius, front over rear, from which the settings are
                                       * those of other wheels */
#define FURTHEST TSE_R(3)             /* 1: logarithm of twenty times as much; no tyres change by more */
#define SLIP_OPENS TSE_R(0.1)         /* 1: slip of wheels that begin to lock or spin */
#define STEER_OPENS TSE_R(0.05)       /* rad: error of a steering angle at fault, */
#define STEER_OWN TSE_R(0.01)         /* rad: and what it is uncertain by once it is believed */
#define HELD_STILL TSE_R(0.095)       /* s: time constant of how long a driver who steers holds the wheel
                                       * still now and then; a tenth of rows of 10 ms move it */
#define LONGEST_ROW TSE_R(0.125)      /* s: longer ones are gaps where substeps are half as many */
#define FORCE_TIME TSE_R(0.1)         /* s: the force that accel_x reads is smoothed by, where slip follows
                                       * it */
#define LEAST_COURSE TSE_R(10)        /* m/s: below, the course is worse in inverse proportion */
#define LEAST_OFF TSE_R(0.2)          /* m/s: how fast an axle slips sideways where nothing happens */

#define LEAST_ROLLING TSE_R(0.5)      /* m/s: a car that changes its direction is slower in between */
#define FASTEST_BACKWARDS TSE_R(8)    /* m/s: nobody drives backwards faster */

/* What follows from a definition, or from a tuned constant. */
#define MOST_GAPS TSE_R(3)           /* 1/s: of rows that are followed; motion that is placed so often is
                                      * what it was placed by */
#define STILL_TIME MODEL_TIME         /* s: wheels that stand for so long have come to rest; what a model
                                       * discrepancy lasts, too, is a swing of the body */
#define OPEN_TIME MODEL_TIME          /* s: between two openings of a kind; what comes between them is
                                       * explained by either */
#define OPEN_TIME_SLIP TSE_R(0.1)     /* s: the same of wheels that lock or spin, which grows as fast */
#define WHOLE_CHANGE TSE_R(1)         /* 1: least amplitude of a fault that counts: one sd of what it opens */
#define LIKELY TSE_R(0.5)             /* 1: likelier than not */
#define SAYS_BACKWARDS TSE_R(4.5)     /* 1: log odds of half a TAIL: one in a hundred */
#define SAYS_FORWARD TSE_R(-2.25)     /* 1: half of that, to the contrary: a slope, against what the turn
                                       * says */
#define BRAKES TSE_R(0.5)             /* 1: of the brake switch, as tables/input.toml says it */
#define HEADING_SD TSE_R(1)           /* rad: of a zero that is not known, so that the first course sets it */

/* Numerics: nothing is divided by less, and every number format holds the most. */
#define LONGEST_TIME TSE_R(1e6)       /* s: timers and ages stop here; nobody asks how much longer it was */
#define MOST_AGE TSE_R(100)           /* s: the same of what is asked about within seconds */
#define MOST_SINCE TSE_R(1000)        /* s: since the last value of a velocity, and left out for */
#define MOST_MOVED TSE_R(1000)        /* m/s, rad/s, rad: motion that is kept */
#define MOST_USUAL TSE_R(1000)        /* 1: slow innovations over their variance */
#define MOST_FROZEN TSE_R(1000)       /* log2: of how unlikely it is that a channel repeats itself */
#define MOST_INFO TSE_R(1e6)          /* 1: information and score of an event, squared innovation over its
                                       * variance */
#define LEAST_LOG2 TSE_R(-100)        /* log2: nothing is less likely */
#define LEAST_WEIGHT TSE_R(1e-6)      /* 1: an event less likely moves no digit */
#define LEAST_ALONG TSE_R(1e-6)       /* 1: variance of a slip stiffness that is known */
#define RECALL_VAR TSE_R(1e-4)        /* unit^2: least variance that is recalled */
#define LEAST_FORCE TSE_R(0.2)        /* 1: of a tyre force that a change leaves, where its logarithm is
                                       * taken of a first-order share */
#define STEEPEST TSE_R(100)           /* unit: no car has such a slope; a variance grows by less than 1e7
                                       * in a row, so that one below MOST_D stays in range */
#define LEAST_ERROR TSE_R(1e-6)       /* unit^2: an error of nothing leaves a slip of nothing a share of
                                       * nothing */
#define WALK_TIME TSE_R(1)            /* s: what walks slowly is due once in that time at least */
#define WANDER_TIME TSE_R(0.2)        /* s: the same of gravity along and across the road, 1/40 of
                                       * ROAD_TIME */
#define MOST_FORGOTTEN TSE_R(0.1)     /* 1: a noise or a ratio that is found as a mean forgets no more in
                                       * one row, however long that is */
#define LEAST_NOISE TSE_R(0.04)       /* 1: variance over that of the setting: no channel is quieter than a
                                       * fifth of what is stated */
#define LEAST_DT TSE_R(1e-4)          /* s: rows that come closer are taken as that far apart: rates are
                                       * what changes over it */
#define SAME_SPEED TSE_R(1e-5)        /* 1: share of the speed that six digits leave */
#define LEAST_RATIO TSE_R(0.5)         /* 1: of two wheel speeds that are one signal */
#define MOST_RATIO TSE_R(2)
#define SAME_RATIO TSE_R(2e-4)        /* 1: the same of a ratio of two columns that are rounded to a
                                       * hundredth */
#define MOST_REPEATS TSE_R(0.999)     /* 1: share of readings that repeat; one more still says something */
#define LEAST_SLOW_VAR TSE_R(1e-9)    /* squared unit of a channel */
#define NEGLIGIBLE TSE_R(0.001)       /* 1: share of an innovation's variance: uncertain quantities that
                                       * make less do not change the gain */
#define LEAST_TURNING TSE_R(5)        /* m/s: what happens to the yaw rate is what happens across over the
                                       * speed, over no less */
#define MOST_ENDLESS TSE_R(9)         /* 1: square of endless force over force where a brush slides as a
                                       * whole; beyond, its form says no more */
#define LEAST_SPEED_ANGLE TSE_R(0.01) /* m/s: slower has no direction: the sideslip angle is 0 */
#define LEAST_SPEED_SD TSE_R(1)       /* m/s: its sd is taken over no less */
#define LEAST_SPEED TSE_R(0.1)        /* m/s: course and speed are taken over no less */
#define BETWEEN TSE_R(0.035)          /* s: kept motion is so far apart; 8 of them reach back 0.28 s, to
                                       * which latencies are limited */
#define LARGEST_CORRELATION TSE_R(0.999) /* 1: of two states that a file gives: what remains of a variance
                                          * stays positive */

#define MOST_D TSE_R(1e6)             /* unit^2: element of D of the motion; no car goes beyond a thousand
                                       * units of any state in motion */

/* Whether channels agree: plausible.c. No filter is tuned by them: what is apart is so by
 * a unit, a sign, an axle. */
#define SMOOTH_TIME TSE_R(0.25)   /* s: noise and vibration go, what a driver does stays */
#define FASTEST_DT TSE_R(0.35)   /* s: after a longer row nothing is smooth: all starts there; a wheel
                                  * speed in every third row of 10 Hz is */
#define MOST_ACROSS TSE_R(200)    /* m/s2: degrees for radians make as much, and its square fits every
                                   * number format */
#define LEAST_VARIANCE TSE_R(1e-7) /* unit^2: nothing is divided by less */
#define FURTHEST_OFF TSE_R(6.25)   /* 1: variance over variance: roll, banked roads, load, compliance and
                                    * slip make less than 2.5 times */
#define UNRELATED TSE_R(0.1)      /* 1: squared correlation of two that are the same; noise leaves more,
                                   * whatever the car */
#define AGAINST TSE_R(0.2)        /* 1: squared correlation, of the wrong sign, of what is small beside its
                                   * noise */
#define GAINS_SPEED TSE_R(-0.3)   /* m/s2: what more is the drive's, or nobody's; what less may be the
                                   * brakes' */
#define SLIPPING TSE_R(0.03)      /* 1: of the speed; wheels that spin or lock do not show how the car
                                   * gains speed */
#define MOST_OF_SPEED TSE_R(6)    /* 1: km/h for m/s is 3.6; 9.8 are both accelerometers in g */
#define LEAST_OF_SPEED TSE_R(0.17) /* 1: m/s for rad/s is a radius; 0.1 is accel_x and accel_y ten times
                                    * too large */
#define SCALE_MOST TSE_R(1.25)     /* 1: square of 1.12 times too fast; cars of tests/cars leave 0.96 ..
                                    * 1.05 */
#define SCALE_LEAST TSE_R(0.7)    /* 1: of 0.84; a slope that changes is in accel_x and not in the wheels,
                                   * and makes as if they were slow */
#define ROUGH_RELATED TSE_R(0.7)   /* 1: squared correlation, of which less than a third is noise or slopes */
#define ROUGH_MOST TSE_R(2.25)     /* 1: square of 1.5 times too fast: a diameter for a radius is 2 */
#define ROUGH_LEAST TSE_R(0.3)     /* 1: of 0.55: slopes make as if the wheels were slow */
#define SCALE_TIME TSE_R(300)     /* s: slopes and cambers are as often up as down in it */
#define SCALE_RELATED TSE_R(0.97) /* 1: squared correlation, less has noise or slopes in its variances */
#define SCALE_SHOWN_ACROSS TSE_R(20) /* (m/s2)^2 s: ten times what a factor of 2.5 takes */
#define SCALE_SHOWN_ALONG TSE_R(10) /* the same, along */
#define MOST_JERK TSE_R(30)        /* m/s3: an emergency manoeuvre, smoothed; of 300 s its square fits
                                    * every number format */
#define COMPLETE_TIME TSE_R(1)     /* s: four times SMOOTH_TIME: all channels are smoothed alike then */
#define LATE_TIME TSE_R(15)       /* s: of USUAL_TIME, that is 28 s of driving: several bends */
#define LATE_SHOWN TSE_R(8)        /* m2/s5: two minutes of a motorway, five seconds of a mountain road */
#define ACCEL_SHOWN TSE_R(25)      /* m2/s5: min excitation of a late accel_y: two corners of a town (one
                                    * that leans makes 0.2 s) */
#define LATE_SD TSE_R(0.2)         /* s m/s2.5: three sd of a lateness times the root of the square that
                                    * shows it, on cars of tests/cars */
#define ACCEL_SD TSE_R(1.75)       /* 1: factor of LATE_SD for accel_y: roads whose bank changes */
#define ACCEL_LATE TSE_R(0.01)     /* s: what a bus leaves beside the others here: messages are 0 .. 60 ms
                                    * late, each for itself */
#define SOFTER TSE_R(0.4)          /* 1: rear tyres by so much softer than nominal, of a class or on a wet
                                    * road, are tyres */
#define LEVER TSE_R(0.7)           /* m: so far behind the centre of gravity an IMU may be that nobody has
                                    * stated */
#define STEER_LATE TSE_R(0.05)     /* s: the yaw rate of a car is 0 .. 130 ms behind its steering angle */
#define YAW_LATE TSE_R(0.11)       /* s: max latency behind accel_y: bus, stiff tyres, an IMU ahead of the
                                    * centre of gravity */
#define YAW_LATE_TWICE TSE_R(0.3)  /* s: max sum of that and of the latency behind the steering angle: cars
                                    * have up to 0.24 */
#define FORGOTTEN 12               /* 1: halvings of what the gravity of a road has in common with the
                                    * state, where a given road begins or ends */
#define SHORTEST TSE_R(0.3)       /* 1: of the wheelbase, which an oversteering car has left at speed */

/* [unit^2] Least element of D: rounding must not leave it at 0 (fixed point), nor make
 * denormal numbers. */
#if defined(TSE_REAL_FIXED)
#define LEAST_D ((tse_real)16)
#else
#define LEAST_D TSE_R(1e-15)
#endif

#endif
