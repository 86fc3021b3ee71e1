/* model/state.h - what stands in the structs that the caller places: constants of a
 * filter, its state, effects and their memory. Internal. A file of the library includes
 * this before any header that includes tse/state.h, which gives others bytes in their
 * place. */
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

#define TSE_DELAY_ROWS 12 /* samples kept; they thin out when the delay is longer than 9 rows */

typedef struct tse_delay { /* when samples were taken, newest first */
  int32_t count;
  tse_real age[TSE_DELAY_ROWS]; /* [s] */
} tse_delay;

typedef struct tse_effect_memory {
  int32_t settled; /* 0: the next row starts everything at rest                       */
#if !defined(TSE_NO_EFFECTS)
  tse_real lag[4];        /* slip angle front, rear [rad], slip front, rear: what tyres hold */
  tse_real mode[3][2];    /* body roll, pitch, roll steer: lagged acceleration and its rate  */
  tse_real time, heading; /* [s], [turns] since the start                                    */
  int32_t steered;        /* 0: the next angle is the first                                  */
  tse_real steered_by[3]; /* [rad] of the last row, before, between and after the lags       */
  tse_delay steer, imu;
  tse_real steer_was[1][TSE_DELAY_ROWS], imu_was[3][TSE_DELAY_ROWS];
  tse_real formula[TSE_FORMULA_MEMORIES][3],
      formula_accel[2]; /* of a formula: its own; accel_x, accel_y [m/s2] at this time */
  tse_delay formula_late;
  tse_real formula_was[1][TSE_DELAY_ROWS];
#endif
} tse_effect_memory;

#define TSE_PARAMS_MAGIC 0x74736570u /* "tsep" */
#define TSE_FILTER_MAGIC 0x74736566u /* "tsef" */

/* What each particle carries, [row][particle]; gamma, nu and the covariance are common to
 * all, hence not here. The resampler's copy takes the rows as they lie, one behind the
 * other. */
typedef struct tse_particles {
  tse_real x[3][TSE_STRIDE];    /* [m/s m/s rad/s] vehicle state: vel_x, vel_y, yaw rate (mean)           */
  tse_real mu[3][TSE_STRIDE];   /* [1] location of the stiffness deviation                                */
  tse_real lam[6][TSE_STRIDE];  /* [1] Lambda / nu, upper triangle by rows: 11 12 13 22 23 33             */
  tse_real bias[3][TSE_STRIDE]; /* [sigma] mean of the sensor biases, in units of the sensor's sd         */
  tse_real w[3][TSE_STRIDE];    /* [1] stiffness deviation drawn for the interval ahead                   */
  tse_real logw[1][TSE_STRIDE]; /* [log2] log-weight relative to the largest                              */
} tse_particles;

#define TSE_SENSORS 5   /* accel_x, accel_y, yaw_rate, wheel speeds front and rear */
#if defined(TSE_SMALL) /* lateral motion alone: src/model/car.h */
#if !defined(TSE_NO_VELOCITY) || !defined(TSE_NO_PARTICLES)
#error "TSE_SMALL goes with TSE_NO_VELOCITY and TSE_NO_PARTICLES"
#endif
#define TSE_STATES 14
#define TSE_SLOW 9
#define TSE_SUBSTEPS 4
#define TSE_UNCERTAIN_ALL 11
#define TSE_VALUES (TSE_STATES + TSE_UNCERTAIN_ALL + 8) /* places of the state, with those of what is none
                                                         * here */
#define TSE_CONSIDERED 4
#define TSE_KEPT 7
#define TSE_EVENTS 2
#else
#define TSE_STATES 23   /* src/model/car.h */
#define TSE_SLOW 14     /* of them, the last ones: gravity and random walks */
#define TSE_SUBSTEPS 8
#define TSE_VALUES TSE_STATES
#define TSE_UNCERTAIN_ALL 10 /* what may be a consider parameter (Schmidt): uncertain, and no state */
#define TSE_CONSIDERED TSE_UNCERTAIN_ALL
#define TSE_KEPT 11     /* states that a drive leaves to the next: biases, stiffness, grip, steering,
                         * radius */
#define TSE_EVENTS 15   /* slots of events, src/filter/events.c */
#endif
#if defined(TSE_NO_VELOCITY) /* saves 1.9 kB of RAM in float; rows with a velocity are refused */
#define TSE_EXTRAS 1 /* not in use */
#define TSE_PAST 1
#else
#define TSE_EXTRAS 7    /* states of a measured velocity, behind the others; src/filter/velocity.c: at rest
                         * unless one is given */
#define TSE_PAST 8      /* earlier motion that is kept for velocities that come late */
#endif
#define TSE_ALL (TSE_STATES + TSE_EXTRAS)

/* The car as the filter's model has it, src/model/car.h. Forces are over mass. */
typedef struct tse_car {
  tse_real kx_front, kx_rear, ky_front, ky_rear; /* [m/s2] [m/s2/rad] nominal stiffness                   */
  tse_real load_front, load_rear, grip, shape; /* [m/s2] load of each axle; [1] friction, form of the curve */
  tse_real end_front, end_rear; /* [m/s2] where the force of each axle ends, over the friction */
  tse_real along_front, along_rear, side_front,
      side_rear;                      /* [s2/m] [s4/m2] cornering stiffness lost by load transfer */
  tse_real height_front, height_rear; /* [s2/m] load of each axle per longitudinal acceleration, relative */
  tse_real lf, lr, jf, jr, m_inertia, trail;     /* [m] [m] [1/m] m lf/I, m lr/I; [1/m2] m/I; [1/m]       */
  tse_real drag, rolling, pull_front, pull_rear; /* [1/m] [m/s2]                                          */
  tse_real relaxation, compliance, roll_steer, roll_coupling; /* [m] [rad s2/m] [1] [m]                    */
  tse_real roll_gain, roll_omega, roll_damping, roll_leak,
      roll_height; /* [rad s2/m] [rad/s] natural frequency [1] [m/s2] [m] */
  tse_real pitch_leak, pitch_height, pitch_frequency, pitch_damping; /* [1] [rad s2] [Hz] [1]              */
  tse_real lever_x, lever_y, mount_cos, mount_sin, scale_x, scale_y, scale_r; /* IMU                      */
  tse_real free_front, free_rear; /* [1] slip of an axle that rolls freely                 */
  int32_t driven;                 /* 0 both or unknown, 1 front, 2 rear                    */
} tse_car;

/* Constants of a filter, made by tse_prepare(). Everything is normalised: forces by
     * mass (accelerations), measurements by the sensor's sd, so that all numbers have a
     * moderate size in every number format. */
struct tse_params {
  uint32_t magic, fingerprint;
  uint32_t vehicle; /* fingerprint of the vehicle alone, the same in every number format */
  int32_t form, wheel_signals;
  tse_real steady_walk;
  int32_t particles, resampling, vel_x_from_wheels, integration;
  uint32_t seed[2];
  /* vehicle */
  tse_real follow;                    /* [1]        rear longitudinal follows front, 0..1  */
  tse_real radius_front, radius_rear; /* [m]                                               */
  /* sensors */
  tse_real sd[3], inv_sd[3]; /* accel_x, accel_y [m/s2], yaw rate [rad/s]         */
  tse_real bias_var0[3];     /* [sigma^2]   initial bias variance                 */
  tse_real bias_walk[3];     /* [sigma^2/s] bias random walk                      */
  tse_real log_sd[3];        /* [log2]                                            */
  tse_real mass_var;         /* [1] */
  /* filter */
  tse_real sample_time, inv_sample_time, max_step, max_gap, max_slip, hold_speed, max_steer;
  tse_real damping, least_step; /* [m/s2] 4 times the fastest damping times speed; [s] step at hold_speed */
  tse_real noise_max_var;       /* [1]                                             */
  tse_real log2_forgetting,
      log2_forgetting_mean; /* log2(lambda) of Lambda and nu, of gamma, per nominal sample */
  tse_real forgetting_mean, forgetting_change; /* [1]     of gamma, and what it may fall to         */
  tse_real memory;                             /* [samples]   1/(1 - lambda)                        */
  tse_real resample_at;                        /* N_eff threshold, in particles                     */
  tse_real mu0[3], lam0, gamma0, nu0, spread_var;
  tse_real vel_x0, x_sd0[3];
  tse_real mean_var0;              /* [1] variance of the mean at the start             */
  tse_real spread_max_var, kernel; /* [1]; [log2] sd of the factor of Lambda when resampled */
  tse_real latency,
      latency_span; /* [s] how old a row is when it is read, and its earliest channel; 0: nothing waits */
  tse_real latency_least; /* [s] rows that come closer are not kept          */
  tse_real
      latency_age[6]; /* [s] how old the value of each channel is that is true at the time estimated of */
  tse_real learnt_floor,
      learnt_walk; /* [1], [1/day] variance of a mean from an earlier drive: at least, growth */
  tse_real w_min, w_low, w_max, valid_var;          /* w_low: where a draw is reflected */
  tse_car car;                                      /* of it stiffness and geometry: every form */
  tse_real prior[TSE_VALUES], prior_sd[TSE_VALUES]; /* form 0: of the state at the start */
  tse_real sensor_sd[TSE_SENSORS], uncertain[TSE_UNCERTAIN_ALL],
      model_sd; /* [m/s2] [m/s2] [rad/s] [m/s] [m/s]; sd of what is no state; [1] */
  tse_real bias_sd_walk[3], steady_sd_walk, log_min, log_max;
  tse_real steer_lag, steer_lag_second; /* [s] */
  tse_real velocity_sd[TSE_VELOCITIES],
      velocity_late; /* [m/s] [m/s] [m/s] [rad]; [s] behind the row that is stepped to */
  tse_real extra[TSE_EXTRAS], extra_sd[TSE_EXTRAS]; /* prior of the states of a measured velocity */
  tse_real no_torque;                               /* [Nm] an axle with less rolls freely */
  tse_real road_sd;    /* [m/s2] of gravity along and across a road that is given */
  tse_effects effects; /* what is not in the plain model; mask 0: nothing   */
};

/* Where the first row starts, made by tse_learnt_load(); else the settings say it. */
typedef struct tse_start {
  int32_t loaded;
  tse_real mu[3], mu_sd[3]; /* [1]        mean stiffness deviation, its scatter over the particles */
  tse_real mean_var[3];     /* [1]        its variance in all                                      */
  tse_real lam[6], gamma, nu;
  tse_real bias[3], bias_var[3]; /* [sigma]                                                             */
  tse_real kept[TSE_KEPT],
      kept_cov[TSE_KEPT][TSE_KEPT]; /* form 0: what a drive leaves of the state, SI and units of the state */
  tse_real noise[TSE_SENSORS];      /* [1] variance over the setting's                                     */
} tse_start;

enum {
  TSE_UNKNOWN,
  TSE_KNOWN,
  TSE_KNOWN_BEFORE
}; /* a stiffness: never valid, valid since the last recovery, loaded */

#define TSE_GROUPS 2     /* of events that exclude each other */

typedef struct tse_ud {
  tse_short u[TSE_STATES * (TSE_STATES - 1) / 2];
  tse_short w[TSE_EXTRAS][TSE_ALL];      /* rows above u, of states that no other depends on */
  int32_t extras;                        /* of them in use: 0 or TSE_EXTRAS */
  tse_real d[TSE_STATES], e[TSE_EXTRAS]; /* the diagonal, and their part of it */
} tse_ud;

/* What is kept of a measured velocity, in the order of src/tables/sensors.toml. */
typedef struct tse_velocity {
  tse_real noise[TSE_VELOCITIES]; /* [1] variance of a channel as found, over the setting's */
  tse_real innovation[TSE_VELOCITIES], last[TSE_VELOCITIES],
      since[TSE_VELOCITIES]; /* [m/s, rad] of the last value, itself; [s] its age */
  tse_real mean_nis[TSE_VELOCITIES],
      rejected_for[TSE_VELOCITIES]; /* [1] recent innovations squared over their variance; [s] rejected for */
  tse_real past[TSE_PAST][4],
      age[TSE_PAST]; /* vel_x, vel_y, yaw rate, heading less those now, newest first; [s] */
  tse_real gyro, turned,
      motion[3]; /* [rad/s] without bias, [rad] heading since, speeds [m/s] and yaw rate [rad/s], at the last
                * row */
  tse_real activity; /* [m2/s2] recent square of how fast the axles slip sideways */
  int32_t kept, has_heading, has_gyro;
} tse_velocity;

/* What may have happened: the state is off by amplitude times v if it did. */
typedef struct tse_event {
  tse_short v[TSE_ALL]; /* [unit] of the state */
  tse_real info, score; /* [1] 1/variance of the amplitude by the samples since, and that times its mean */
  tse_real both;        /* [1] of a second amplitude: what the samples say of both at once */
  tse_real age;         /* [s] */
  int32_t kind;         /* src/filter/events.c; 0: free slot */
} tse_event;

/* Two quantities that are the same, and how they went together:
     * src/filter/plausible.c. */
typedef struct tse_pair {
  tse_real time;                  /* [s] of samples, without what is forgotten */
  tse_real mean[2], var[2], both; /* their means, variances and covariance */
} tse_pair;

/* Whether one of two channels comes late: sums over SCALE_TIME,
     * src/filter/plausible.c. */
typedef struct tse_timing {
  tse_real square,
      late; /* [m2/s5] square of the slope of the first times seconds; [m2/s4] that times how late the
             * second is */
} tse_timing;

#define TSE_PAIRS 5
typedef struct tse_agreement {
  tse_real smooth[6];
  tse_pair pair[TSE_PAIRS];
  tse_real since; /* [s] since a row that has a wheel speed */
  tse_real
      moved[2]
           [2]; /* [m2/s3] square of v r and its product with accel_y, of accel_x and with the change of the
            * wheels' speed, times seconds */
  tse_timing across, steered; /* how late accel_y is behind v r; yaw_rate behind the steering angle */
  tse_real lags; /* [m2/s4] square of the slope of v r times how late the car's side slip makes accel_y, times
             * seconds */
  tse_real complete_for;    /* [s] for so long each row has had accel_y, yaw_rate and steer_angle */
  int32_t apart, off_scale; /* bits, by pair, and behind them LATE_ACCEL ...: the two are not the same; 1:
                  * accelerometers saw another speed than the wheels */
} tse_agreement;

/* The slip stiffness itself before anything was learnt of it: LCX is it and what the
 * model lacks along the car. */
typedef struct tse_along {
  tse_real mean, var; /* of its logarithm; LCX was there, too */
} tse_along;

/* A filter of the default form. */
typedef struct tse_kalman {
  tse_real x[TSE_VALUES + TSE_EXTRAS];         /* SI */
  tse_ud ud;                                   /* in units of the state */
  tse_short consider[TSE_CONSIDERED][TSE_ALL]; /* [unit] error of x per sd of each consider parameter */
  tse_real noise[TSE_SENSORS];                 /* [1] variance of a channel as found, over the setting's */
  tse_real activity[3];          /* [m2/s4] [m2/s4] [rad2/s2] recent a_x, a_y, yaw rate, squared */
  tse_real before[3];            /* [m/s2] [m/s2] [m/s] a_x, a_y and speed at the last row */
  tse_real pitch[2];             /* [m/s2] a_x as the body's pitch follows it */
  tse_real steer[3];             /* [rad] logged angle, after one lag, after both */
  tse_real road[2];              /* [m/s2] gravity along and across as given; 0 where not given */
  tse_real since_slow[TSE_SLOW]; /* [s] since each slow state had its share of process noise */
  tse_real moved[3];             /* [unit2] share of each stiffness in it by how far it has moved since */
  tse_real seen;                 /* [s] of rows that the filter has followed since its start */
  tse_real nis[TSE_SENSORS];     /* [1] of each channel in the last row; 0 where it was not used */
  tse_real lasting[TSE_SENSORS],
      lasting_var[TSE_SENSORS]; /* part of the innovation that is not white; its variance */
  tse_real innovation[TSE_SENSORS], innovation_var[TSE_SENSORS], last_innovation[TSE_SENSORS];
  tse_real slow[TSE_SENSORS], slow_var[TSE_SENSORS],
      usual[TSE_SENSORS]; /* innovation, smoothed; its variance as thought; [1] as it is, over that */
  tse_real log_likelihood;
  tse_real change_age, change_from[4],
      change_from_var[4]; /* [s]; [1] logarithms of stiffness and grip before the last change; [unit2] their
                    * variance */
  tse_along along, along_from; /* now, before the last change */
  tse_real reading[TSE_SENSORS + 1], repeats[TSE_SENSORS + 1],
      repeats_again[TSE_SENSORS
          + 1]; /* last reading, of sensors and steering angle; [1] share of readings that repeat the one before;
                                         of those after one that did */
  tse_real frozen[TSE_SENSORS
      + 1]; /* [1] log2 of how unlikely it is that a channel at work repeats its reading that often */
  tse_real agrees_for;                   /* [s] that the channel at fault has agreed */
  int32_t change_kind, fault, slow_turn; /* TSE_CHANGE_*; 0 none, else 1 + TSE_CHANNEL_; rows */
  int32_t road_given;                    /* bits: gravity along, across */
  tse_event event[TSE_EVENTS];
  tse_real weight[TSE_EVENTS],
      none[TSE_GROUPS]; /* posterior probability of each event, and that nothing happened */
  tse_velocity velocity;
  tse_agreement agreement;
} tse_kalman;

/* Which way the car rolls: src/filter/backwards.c. */
typedef struct tse_way {
  tse_real by_turn, by_gain;  /* [1] log odds of backwards by how it turns, by how it gains speed */
  tse_real begins, gained;    /* [m/s] speed at first, and what accel_x has added up to since */
  tse_real rolls_for, unread; /* [s] since then, since accel_x was read */
} tse_way;

/* Rows that wait for channels which are logged later, in a ring: before them stands
     * an older one. */
typedef struct tse_alignment {
  int32_t count, newest;  /* rows kept; place of the newest                             */
  tse_real since, unkept; /* [s] from the last step's row, from the newest row kept, to the last one given */
  tse_real before[TSE_LATENCY_KEPT];   /* [s] since the row kept before it; 0 where there is none      */
  tse_real value[TSE_LATENCY_KEPT][6]; /* channels as logged; 0 where missing                        */
  uint8_t missing[TSE_LATENCY_KEPT];   /* bits of tse_input.missing                                  */
  tse_real lost[3];  /* [1] what interpolation took of the noise variance of accel_x, accel_y, yaw rate */
  int32_t reason[4]; /* of the last step, while rows wait: of the three, of the grip */
} tse_alignment;

/* A filter of the default form, and what every form needs. */
struct tse_filter {
  uint32_t magic, fingerprint;
  uint32_t step;                   /* rows accepted since reset: the counter of the random numbers */
  int32_t started;                 /* 0: the next row initialises                                  */
  tse_real steer, v_front, v_rear; /* inputs of the last row: [rad], R omega [m/s]                 */
  tse_real held_for;               /* [s] since a row had a steering angle: the last is held       */
  tse_real rolled_for;             /* [s] since a row had any wheel speed: the car rolls on        */
  int32_t lost;                    /* 1: either for too long; until a row has both                 */
  tse_real still_for;              /* [s] how long the wheels have stood still                     */
  tse_real off_for
      [2]; /* [s] for so long the column of each axle is no copy of the other's: it has changed to another
            * value */
  tse_real ratio; /* [1] front over rear wheel speed when both changed and differed last; 0: not known */
  tse_real gaps;  /* [1] gaps in the last 20 s of rows that the filter has followed */
  tse_way way;
  tse_real seen;    /* form 1: samples learnt from, up to five memories; form 0: k.seen */
  int32_t known[3]; /* what tse_learnt_save() may call learnt: TSE_KNOWN ...        */
  tse_start start;
  tse_kalman k;          /* form 0                                                       */
  tse_alignment waiting; /* rows that wait for channels which are logged later           */
};

/* A filter of the paper's form, with its particles. A pointer to its first member is
     * one to all of it. */
struct tse_filter_paper {
  tse_filter filter;
  tse_real gamma, nu;   /* (16), (17): follow recursions without data, common to all    */
  tse_real bias_var[3]; /* [sigma^2] P of (18), (19), common to all; diagonal, as P0, Q and R are */
  tse_real log_total;   /* log2 of the sum of 2^logw                                    */
  tse_real excite[3];   /* regressors, smoothed over EXCITATION_TIME                    */
  tse_real excite_mean[3], excite_sq[3]; /* their running mean and mean square                        */
  tse_real slow[3];                      /* [sigma] smoothed innovations, where forgetting follows them  */
  tse_particles p;
  tse_real weight[TSE_STRIDE]; /* normalised to the largest = 1; 0 beyond the particles in use */
  uint16_t ancestor[TSE_STRIDE], copies[TSE_STRIDE]; /* the resampler's work space */
};

#if !defined(TSE_NO_EFFECTS)
struct tse_sim {
  tse_params params;
  tse_sim_input last;
  tse_sim_config config;
  uint32_t step;
  tse_real x[5]; /* vel_x, vel_y, yaw rate, wheel speeds front and rear */
  tse_real bias[3], drawn[3];
  tse_real steer,
      steer_logged; /* with effects: the wheels' angle at the last row, and the logged one that led to
                         * it */
  tse_effect_memory effects;
};
#endif

/* An array of -1 elements where tse/state.h has another size than the struct. */
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
