/* model/state.h - contents of the structs whose memory the caller provides: constants of a
 * filter, its state, effects and their memory. Internal. Files of the library include this
 * before any header that includes tse/state.h, which otherwise declares opaque bytes. */
#ifndef TSE_MODEL_STATE_H
#define TSE_MODEL_STATE_H

#if defined(TSE_STATE_H) && !defined(TSE_INTERNALS)
#error "model/state.h is included before headers of tse/"
#endif
#define TSE_INTERNALS
#include "tse/input.h"
#include "tse/real.h"
#include "tse/state.h"
#include "tables/effects.h"
#if !defined(TSE_NO_EFFECTS)
#include "tse/simulate.h"
#endif

#define TSE_DELAY_ROWS 12 /* samples kept; they thin out if the delay exceeds 9 rows */

/* Ages of the samples of a delay line, newest first. */
typedef struct tse_delay {
  int32_t count;
  tse_real age[TSE_DELAY_ROWS]; /* [s] */
} tse_delay;

typedef struct tse_effect_memory {
  int32_t settled; /* 0: the next row starts everything at rest */
#if !defined(TSE_NO_EFFECTS)
  tse_real lag[4];        /* relaxed slip angles front, rear [rad], slips front, rear */
  tse_real mode[3][2];    /* body roll, pitch, roll steer: lagged acceleration, its rate */
  tse_real time, heading; /* [s], [turns] since the start */
  int32_t steered;        /* 0: no steering angle so far */
  tse_real steered_by[3]; /* [rad] angle of the last row: logged, after one lag, after both */
  tse_delay steer, imu;
  tse_real steer_was[1][TSE_DELAY_ROWS], imu_was[3][TSE_DELAY_ROWS];
  tse_real formula[TSE_FORMULA_MEMORIES][3]; /* memory of the user's formula */
  tse_real formula_accel[2];                 /* [m/s2] accel_x, accel_y of the last step */
  tse_delay formula_late;
  tse_real formula_was[1][TSE_DELAY_ROWS];
#endif
} tse_effect_memory;

#define TSE_PARAMS_MAGIC 0x74736570u /* "tsep" */
#define TSE_FILTER_MAGIC 0x74736566u /* "tsef" */

/* State of the particles, [row][particle]. gamma, nu and the covariance are common to all
 * particles and stand in tse_filter_paper. The resampler copies the rows as one contiguous
 * block. */
typedef struct tse_particles {
  tse_real x[3][TSE_STRIDE];    /* [m/s m/s rad/s] mean of vel_x, vel_y, yaw rate */
  tse_real mu[3][TSE_STRIDE];   /* [1] location of the stiffness deviation */
  tse_real lam[6][TSE_STRIDE];  /* [1] Lambda/nu, upper triangle by rows: 11 12 13 22 23 33 */
  tse_real bias[3][TSE_STRIDE]; /* [sigma] mean of the sensor biases, over the sensor's sd */
  tse_real w[3][TSE_STRIDE];    /* [1] stiffness deviation drawn for the next interval */
  tse_real logw[1][TSE_STRIDE]; /* [log2] log-weight relative to the largest */
} tse_particles;

#define TSE_SENSORS 5 /* accel_x, accel_y, yaw_rate, wheel speeds front and rear */
#if defined(TSE_SMALL) /* lateral motion only: src/model/car.h */
#if !defined(TSE_NO_VELOCITY) || !defined(TSE_NO_PARTICLES)
#error "TSE_SMALL goes with TSE_NO_VELOCITY and TSE_NO_PARTICLES"
#endif
#define TSE_STATES 14
#define TSE_SLOW 9
#define TSE_SUBSTEPS 4
#define TSE_UNCERTAIN_ALL 11
#define TSE_VALUES (TSE_STATES + TSE_UNCERTAIN_ALL + 8) /* with the constants in place of states */
#define TSE_CONSIDERED 4
#define TSE_KEPT 7
#define TSE_EVENTS 2
#else
#define TSE_STATES 23 /* src/model/car.h */
#define TSE_SLOW 14 /* last states: gravity and random walks */
#define TSE_SUBSTEPS 8
#define TSE_VALUES TSE_STATES
#define TSE_UNCERTAIN_ALL 10 /* quantities that may be consider parameters (Schmidt) */
#define TSE_CONSIDERED TSE_UNCERTAIN_ALL
#define TSE_KEPT 11 /* persisted states: biases, stiffness, grip, steering, radius */
#define TSE_EVENTS 15 /* slots of events, src/filter/events.c */
#endif
#if defined(TSE_NO_VELOCITY) /* saves 1.9 kB of RAM in float; rows with a velocity are refused */
#define TSE_EXTRAS 1 /* not in use */
#define TSE_PAST 1
#else
#define TSE_EXTRAS 7 /* last states, of a measured velocity (velocity.c); unused without one */
#define TSE_PAST 8 /* rows of past motion kept for late velocities */
#endif
#define TSE_ALL (TSE_STATES + TSE_EXTRAS)

/* Parameters of the car model, src/model/car.h. Forces are over mass. */
typedef struct tse_car {
  tse_real kx_front, kx_rear, ky_front, ky_rear; /* [m/s2] [m/s2/rad] nominal stiffness */
  tse_real load_front, load_rear, grip, shape;   /* [m/s2] axle loads; [1] friction; [1] curve shape */
  tse_real end_front, end_rear;                  /* [m/s2] max force of each axle, over friction */
  /* [s2/m] [s4/m2] share of cornering stiffness lost by load transfer */
  tse_real along_front, along_rear, side_front, side_rear;
  tse_real height_front, height_rear;            /* [s2/m] relative load per longitudinal acceleration */
  tse_real lf, lr, jf, jr, m_inertia, trail;     /* [m] [m] [1/m] m lf/I, m lr/I; [1/m2] m/I; [1/m] */
  tse_real drag, rolling, pull_front, pull_rear; /* [1/m] [m/s2] */
  tse_real relaxation, compliance, roll_steer, roll_coupling; /* [m] [rad s2/m] [1] [m] */
  /* [rad s2/m] [rad/s] natural frequency [1] [m/s2] [m] */
  tse_real roll_gain, roll_omega, roll_damping, roll_leak, roll_height;
  tse_real pitch_leak, pitch_height, pitch_frequency, pitch_damping;          /* [1] [rad s2] [Hz] [1] */
  tse_real lever_x, lever_y, mount_cos, mount_sin, scale_x, scale_y, scale_r; /* IMU */
  tse_real free_front, free_rear; /* [1] slip of a free-rolling axle */
  int32_t driven;                 /* 0 both or unknown, 1 front, 2 rear */
} tse_car;

/* Constants of a filter, made by tse_prepare(). Forces are over mass, measurements over the
 * sensor's sd, so that all numbers have a moderate size in every number format. */
struct tse_params {
  uint32_t magic, fingerprint;
  uint32_t vehicle; /* fingerprint of the vehicle settings, the same in every number format */
  int32_t form, wheel_signals;
  tse_real steady_walk;
  int32_t particles, resampling, vel_x_from_wheels, integration;
  uint32_t seed[2];
  /* vehicle */
  tse_real follow;                    /* [1] share of front w in the rear longitudinal stiffness */
  tse_real radius_front, radius_rear; /* [m] */
  /* sensors */
  tse_real sd[3], inv_sd[3]; /* accel_x, accel_y [m/s2], yaw rate [rad/s] */
  tse_real bias_var0[3];     /* [sigma^2] initial bias variance */
  tse_real bias_walk[3];     /* [sigma^2/s] bias random walk */
  tse_real log_sd[3];        /* [log2] */
  tse_real mass_var;         /* [1] */
  /* filter */
  tse_real sample_time, inv_sample_time, max_step, max_gap, max_slip, hold_speed, max_steer;
  tse_real damping;                            /* [m/s2] 4 times the fastest damping, times speed */
  tse_real least_step;                         /* [s] integration step at hold_speed */
  tse_real noise_max_var;                      /* [1] */
  tse_real log2_forgetting;                    /* log2(lambda) of Lambda and nu, per nominal sample */
  tse_real log2_forgetting_mean;               /* log2(lambda) of gamma */
  tse_real forgetting_mean, forgetting_change; /* [1] lambda of gamma, its min */
  tse_real memory;                             /* [samples] 1/(1 - lambda) */
  tse_real resample_at;                        /* N_eff threshold, in particles */
  tse_real mu0[3], lam0, gamma0, nu0, spread_var;
  tse_real vel_x0, x_sd0[3];
  tse_real mean_var0;                      /* [1] variance of the mean at the start */
  tse_real spread_max_var;                 /* [1] */
  tse_real kernel;                         /* [log2] sd of the factor of Lambda at resampling */
  tse_real latency;                        /* [s] age of a row when it is processed */
  tse_real latency_span;                   /* [s] age of its earliest channel less that; 0: no row waits */
  tse_real latency_least;                  /* [s] min time between rows that are kept */
  tse_real latency_age[6];                 /* [s] age of each channel's value for that row */
  tse_real learnt_floor;                   /* [1] min variance of a mean from an earlier drive */
  tse_real learnt_walk;                    /* [1/day] its growth */
  tse_real w_min, w_low, w_max, valid_var; /* w_low: draws are reflected there */
  tse_car car;                             /* form 1 uses stiffness and geometry only */
  tse_real prior[TSE_VALUES], prior_sd[TSE_VALUES]; /* form 0: prior of the state */
  tse_real sensor_sd[TSE_SENSORS];                  /* [m/s2] [m/s2] [rad/s] [m/s] [m/s] */
  tse_real uncertain[TSE_UNCERTAIN_ALL];            /* sd of the consider parameters */
  tse_real model_sd;                                /* [1] */
  tse_real bias_sd_walk[3], steady_sd_walk, log_min, log_max;
  tse_real steer_lag, steer_lag_second;             /* [s] */
  tse_real velocity_sd[TSE_VELOCITIES];             /* [m/s] [m/s] [m/s] [rad] */
  tse_real velocity_late;                           /* [s] latency relative to the processed row */
  tse_real extra[TSE_EXTRAS], extra_sd[TSE_EXTRAS]; /* prior of the states of a measured velocity */
  tse_real no_torque;                               /* [Nm] an axle with less rolls freely */
  tse_real road_sd;                                 /* [m/s2] sd of gravity on a given road */
  tse_effects effects;                              /* mask 0: plain model */
};

/* Initial estimate from tse_learnt_load(). Without it, the settings are used. */
typedef struct tse_start {
  int32_t loaded;
  tse_real mu[3], mu_sd[3]; /* [1] mean stiffness deviation, its scatter over the particles */
  tse_real mean_var[3];     /* [1] its total variance */
  tse_real lam[6], gamma, nu;
  tse_real bias[3], bias_var[3];         /* [sigma] */
  tse_real kept[TSE_KEPT];               /* form 0: persisted states, SI */
  tse_real kept_cov[TSE_KEPT][TSE_KEPT]; /* their covariance, units of the state */
  tse_real noise[TSE_SENSORS];           /* [1] variance over the setting's */
} tse_start;

/* History of a stiffness: never valid, valid since the last recovery, loaded. */
enum {
  TSE_UNKNOWN,
  TSE_KNOWN,
  TSE_KNOWN_BEFORE,
};

#define TSE_GROUPS 2 /* groups of mutually exclusive events */

typedef struct tse_ud {
  tse_short u[TSE_STATES * (TSE_STATES - 1) / 2];
  tse_short w[TSE_EXTRAS][TSE_ALL];      /* rows above u, of states on which no other depends */
  int32_t extras;                        /* number of those in use: 0 or TSE_EXTRAS */
  tse_real d[TSE_STATES], e[TSE_EXTRAS]; /* diagonal, and its part for those states */
} tse_ud;

/* State of the measured velocities, in the order of src/tables/sensors.toml. */
typedef struct tse_velocity {
  tse_real noise[TSE_VELOCITIES];        /* [1] estimated variance over the setting's */
  tse_real innovation[TSE_VELOCITIES];   /* [m/s, rad] of the last value */
  tse_real last[TSE_VELOCITIES];         /* [m/s, rad] last value */
  tse_real since[TSE_VELOCITIES];        /* [s] its age */
  tse_real mean_nis[TSE_VELOCITIES];     /* [1] mean of recent normalised squared innovations */
  tse_real rejected_for[TSE_VELOCITIES]; /* [s] */
  tse_real past[TSE_PAST][4]; /* vel_x, vel_y, yaw rate, heading less the current ones, newest first */
  tse_real age[TSE_PAST];     /* [s] */
  tse_real gyro;              /* [rad/s] yaw rate without bias at the last row */
  tse_real turned;            /* [rad] change of heading since */
  tse_real motion[3];         /* speeds [m/s] and yaw rate [rad/s] at the last row */
  tse_real activity;          /* [m2/s2] recent squared lateral slip speed of the axles */
  int32_t kept, has_heading, has_gyro;
} tse_velocity;

/* A hypothetical event: if it happened, the state error is amplitude times v. */
typedef struct tse_event {
  tse_short v[TSE_ALL]; /* [unit] of the state */
  tse_real info;        /* [1] information on the amplitude from the samples since: 1/variance */
  tse_real score;       /* [1] info times the estimate of the amplitude */
  tse_real both;        /* [1] cross information with a second amplitude */
  tse_real age;         /* [s] */
  int32_t kind;         /* src/filter/events.c; 0: free slot */
} tse_event;

/* Statistics of two redundant quantities: src/filter/plausible.c. */
typedef struct tse_pair {
  tse_real time;                  /* [s] effective duration of the samples, with forgetting */
  tse_real mean[2], var[2], both; /* means, variances, covariance */
} tse_pair;

/* Regression for the delay of a channel behind another one, with memory SCALE_TIME:
 * src/filter/plausible.c. */
typedef struct tse_timing {
  tse_real square; /* [m2/s5] sum of squared slopes of the first channel, times seconds */
  tse_real late;   /* [m2/s4] that sum times the delay of the second channel */
} tse_timing;

#define TSE_PAIRS 5
typedef struct tse_agreement {
  tse_real smooth[6];
  tse_pair pair[TSE_PAIRS];
  tse_real since; /* [s] since a row with a wheel speed */
  /* [m2/s3] sums times seconds: [0] square of v r and its product with accel_y; [1] square of
   * accel_x and its product with the rate of the wheel speed */
  tse_real moved[2][2];
  tse_timing across, steered; /* delay of accel_y behind v r; of yaw_rate behind steering */
  tse_real lags;              /* [m2/s4] as `late`, for the delay of accel_y by side slip */
  tse_real complete_for;      /* [s] with accel_y, yaw_rate and steer_angle in each row */
  int32_t apart;              /* bits by pair, then LATE_ACCEL ...: the two disagree */
  int32_t off_scale;          /* 1: accelerometers and wheels disagree on the speed */
} tse_agreement;

/* Prior of the slip stiffness, without the model error along the car that LCX includes. */
typedef struct tse_along {
  tse_real mean, var; /* of its logarithm; LCX had the same mean */
} tse_along;

/* Kalman filter of the car (form 0). */
typedef struct tse_kalman {
  tse_real x[TSE_VALUES + TSE_EXTRAS];         /* SI */
  tse_ud ud;                                   /* in units of the state */
  tse_short consider[TSE_CONSIDERED][TSE_ALL]; /* [unit] error of x per sd of each parameter */
  tse_real noise[TSE_SENSORS];                 /* [1] estimated variance of a channel over the setting's */
  tse_real activity[3];          /* [m2/s4] [m2/s4] [rad2/s2] recent square of a_x, a_y, yaw rate */
  tse_real before[3];            /* [m/s2] [m/s2] [m/s] a_x, a_y and speed at the last row */
  tse_real pitch[2];             /* [m/s2] a_x as the pitch follows it, its rate */
  tse_real steer[3];             /* [rad] logged angle, after one lag, after both */
  tse_real road[2];              /* [m/s2] given gravity, longitudinal and lateral; 0: not given */
  tse_real since_slow[TSE_SLOW]; /* [s] since the last process noise of each slow state */
  tse_real moved[3];             /* [unit2] variance due to recent steps of each stiffness */
  tse_real seen;                 /* [s] total time of the rows processed since the start */
  tse_real nis[TSE_SENSORS];     /* [1] of each channel in the last row; 0: not used */
  tse_real lasting[TSE_SENSORS]; /* coloured part of the innovation */
  tse_real lasting_var[TSE_SENSORS];
  tse_real innovation[TSE_SENSORS], innovation_var[TSE_SENSORS], last_innovation[TSE_SENSORS];
  tse_real slow[TSE_SENSORS];     /* low-passed innovation */
  tse_real slow_var[TSE_SENSORS]; /* its predicted variance */
  tse_real usual[TSE_SENSORS];    /* [1] ratio of its observed to predicted variance */
  tse_real log_likelihood;
  tse_real change_age;                     /* [s] since the last change */
  tse_real change_from[4];                 /* [1] logs of stiffness and grip before it */
  tse_real change_from_var[4];             /* [unit2] their variance */
  tse_along along, along_from;             /* now, before the last change */
  tse_real reading[TSE_SENSORS + 1];       /* last reading, sensors and steering angle */
  tse_real repeats[TSE_SENSORS + 1];       /* [1] share of readings equal to the one before */
  tse_real repeats_again[TSE_SENSORS + 1]; /* [1] that share after a repeated reading */
  tse_real frozen[TSE_SENSORS + 1];        /* [1] -log2 probability of so many repeats if working */
  tse_real agrees_for;                     /* [s] agreement of the channel at fault */
  int32_t change_kind;                     /* TSE_CHANGE_* */
  int32_t fault;                           /* 0: no fault, else 1 + TSE_CHANNEL_ */
  int32_t slow_turn;                       /* rows */
  int32_t road_given;                      /* bits: gravity longitudinal, lateral */
  tse_event event[TSE_EVENTS];
  tse_real weight[TSE_EVENTS]; /* posterior probability of each event */
  tse_real none[TSE_GROUPS];   /* posterior probability of no event */
  tse_velocity velocity;
  tse_agreement agreement;
} tse_kalman;

/* Evidence for driving backwards: src/filter/backwards.c. */
typedef struct tse_way {
  tse_real by_turn, by_gain;  /* [1] log odds of backwards: by yaw rate, by gain of speed */
  tse_real begins, gained;    /* [m/s] speed at first, integral of accel_x since */
  tse_real rolls_for, unread; /* [s] since then, since the last accel_x */
} tse_way;

/* Ring of rows that wait for channels logged later. */
typedef struct tse_alignment {
  int32_t count, newest;               /* number of rows; index of the newest */
  tse_real since;                      /* [s] from the row of the last step to the last row given */
  tse_real unkept;                     /* [s] from the newest row kept to the last row given */
  tse_real before[TSE_LATENCY_KEPT];   /* [s] since the row kept before it; 0: first row */
  tse_real value[TSE_LATENCY_KEPT][6]; /* channels as logged; 0 where missing */
  uint8_t missing[TSE_LATENCY_KEPT];   /* bits of tse_input.missing */
  tse_real lost[3];                    /* [1] share of noise variance of the IMU removed by interpolation */
  int32_t reason[4];                   /* of the last step, while rows wait: three stiffnesses, grip */
} tse_alignment;

/* Filter: common part and the Kalman filter (form 0). */
struct tse_filter {
  uint32_t magic, fingerprint;
  uint32_t step;                   /* rows accepted since reset, counter of the random numbers */
  int32_t started;                 /* 0: the next row initialises */
  tse_real steer, v_front, v_rear; /* inputs of the last row: [rad], R omega [m/s] */
  tse_real held_for;               /* [s] since the last steering angle, which is held */
  tse_real rolled_for;             /* [s] since the last wheel speed */
  int32_t lost;                    /* 1: one of them for too long, until a row has both */
  tse_real still_for;              /* [s] standstill of the wheels */
  tse_real off_for[2];             /* [s] left after an axle's wheel speed changed on its own */
  tse_real ratio;                  /* [1] last front over rear wheel speed when both changed; 0: unknown */
  tse_real gaps;                   /* [1] gaps in the last 20 s of processed rows */
  tse_way way;
  tse_real seen;    /* form 1: samples learnt from, max five memories; form 0: k.seen */
  int32_t known[3]; /* history of each stiffness, TSE_KNOWN ..., for tse_learnt_save() */
  tse_start start;
  tse_kalman k;          /* form 0 */
  tse_alignment waiting; /* rows that wait for channels logged later */
};

/* The paper's particle filter (form 1). A pointer to its first member may be cast to it. */
struct tse_filter_paper {
  tse_filter filter;
  tse_real gamma, nu;                    /* (16), (17): recursions without data, common to all particles */
  tse_real bias_var[3];                  /* [sigma^2] P of (18), (19), common; diagonal, as P0, Q and R are */
  tse_real log_total;                    /* log2 of the sum of 2^logw */
  tse_real excite[3];                    /* regressors, low-passed over EXCITATION_TIME */
  tse_real excite_mean[3], excite_sq[3]; /* their running mean and mean square */
  tse_real slow[3];                      /* [sigma] low-passed innovations, for forgetting */
  tse_particles p;
  tse_real weight[TSE_STRIDE];                       /* over the largest; 0 beyond the particles in use */
  uint16_t ancestor[TSE_STRIDE], copies[TSE_STRIDE]; /* work space of the resampler */
};

#if !defined(TSE_NO_EFFECTS)
struct tse_sim {
  tse_params params;
  tse_sim_input last;
  tse_sim_config config;
  uint32_t step;
  tse_real x[5]; /* vel_x, vel_y, yaw rate, wheel speeds front and rear */
  tse_real bias[3], drawn[3];
  tse_real steer;        /* [rad] road-wheel angle of the last row, after the effects */
  tse_real steer_logged; /* [rad] its logged angle */
  tse_effect_memory effects;
};
#endif

/* Compile-time check (array of -1 elements) that tse/state.h reserves the right sizes. */
typedef char tse_params_has_its_size[sizeof(tse_params) == sizeof(tse_params_bytes) ? 1 : -1];
typedef char tse_filter_has_its_size[sizeof(tse_filter) == sizeof(tse_filter_bytes) ? 1 : -1];
typedef char tse_filter_paper_has_its_size
    [sizeof(tse_filter_paper) == sizeof(tse_filter_bytes) + sizeof(tse_paper_bytes) ? 1 : -1];
#if !defined(TSE_NO_EFFECTS)
struct tse_sim_seen {
  tse_params_bytes params;
  tse_sim_input last;
  tse_sim_bytes bytes;
}; /* tse_sim in tse/simulate.h */
typedef char tse_sim_has_its_size[sizeof(tse_sim) == sizeof(struct tse_sim_seen) ? 1 : -1];
#endif

#endif
