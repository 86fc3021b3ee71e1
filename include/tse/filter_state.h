/* tse/filter_state.h - the filter's constants and its state: complete types, so that the caller can place them
 * (static, stack, linker section), with members that are the library's own business.
 * Both are pointer-free: copying the struct copies the filter. */
#ifndef TSE_FILTER_STATE_H
#define TSE_FILTER_STATE_H

#include "tse/real.h"
#include "tse/effects.h"

/* Sums over particles run in TSE_LANES interleaved partial sums, joined in a fixed order: the same bits whatever
 * the vector width. Rows are padded so that they do not fall on the same cache sets (power-of-two strides cost
 * up to 14 %). */
#define TSE_LANES 8
#define TSE_STRIDE ((TSE_MAX_PARTICLES + TSE_LANES - 1) / TSE_LANES * TSE_LANES + TSE_LANES)

/* What each particle carries: name, rows, unit, meaning. The struct, the resampler's copy and the redraw derive from it. */
#define TSE_PARTICLE_FIELDS(X)                                                              \
  X(x,    3, "m/s m/s rad/s", "vehicle state: vel_x, vel_y, yaw rate (mean)")               \
  X(mu,   3, "1",             "location of the stiffness deviation")                        \
  X(lam,  6, "1",             "Lambda / nu, upper triangle by rows: 11 12 13 22 23 33")     \
  X(bias, 3, "sigma",         "mean of the sensor biases, in units of the sensor's sd")     \
  X(w,    3, "1",             "stiffness deviation drawn for the interval ahead")           \
  X(logw, 1, "log2",          "log-weight relative to the largest")

#define TSE_PARAMS_MAGIC 0x74736570u /* "tsep" */
#define TSE_FILTER_MAGIC 0x74736566u /* "tsef" */

typedef struct tse_particles { /* [row][particle]; gamma, nu and the covariance are common to all, hence not here */
#define X(name, rows, unit, text) tse_real name[rows][TSE_STRIDE];
  TSE_PARTICLE_FIELDS(X)
#undef X
} tse_particles;

/* Constants of a filter, made by tse_prepare(). Everything is normalised: forces by mass (accelerations), measurements
 * by the sensor's sd, so that all numbers have a moderate size in every number format. */
typedef struct tse_params {
  uint32_t magic, fingerprint;
  uint32_t vehicle;                   /* fingerprint of the vehicle alone, the same in every number format */
  int32_t particles, resampling, marginalised, vel_x_from_wheels, notice_stuck, relative_covariance;
  uint32_t seed[2];
  /* vehicle */
  tse_real kx_front, kx_rear;         /* [m/s2]     longitudinal stiffness / mass          */
  tse_real ky_front, ky_rear;         /* [m/s2/rad] cornering stiffness / mass             */
  tse_real follow;                    /* [1]        rear longitudinal follows front, 0..1  */
  tse_real lf, lr;                    /* [m]                                               */
  tse_real jf, jr;                    /* [1/m]      m lf / I, m lr / I                     */
  tse_real radius_front, radius_rear; /* [m]                                               */
  /* sensors */
  tse_real sd[3], inv_sd[3];          /* accel_x, accel_y [m/s2], yaw rate [rad/s]         */
  tse_real read_x, read_y_front, read_y_rear; /* [1] accel_x, accel_y read per tyre force; 1 without effects */
  tse_real bias_var0[3];              /* [sigma^2]   initial bias variance                 */
  tse_real bias_walk[3];              /* [sigma^2/s] bias random walk                      */
  tse_real log_sd[3];                 /* [log2]                                            */
  tse_real wheel_var[2];              /* [m2/s2]     of R omega, front and rear            */
  /* filter */
  tse_real sample_time, inv_sample_time, max_step, max_gap, max_slip, hold_speed, max_steer;
  tse_real damping, least_step;       /* [m/s2] 4 times the fastest damping times speed; [s] step at hold_speed */
  tse_real gate_var, contradiction_var; /* [sigma^2], 0: never                           */
  tse_real noise_max_var;             /* [1]                                             */
  tse_real log2_forgetting;           /* log2(lambda) per nominal sample                   */
  tse_real memory;                    /* [samples]   1/(1 - lambda)                        */
  tse_real resample_at;               /* N_eff threshold, in particles                     */
  tse_real mu0[3], lam0, gamma0, nu0, mean_sd, spread_var;
  tse_real vel_x0, x_sd0[3];
  tse_real mean_var0, mean_walk;      /* [1], [1/s] variance of the mean at the start, its random walk */
  tse_real spread_max_var;            /* [1]    */
  tse_real learnt_floor, learnt_walk; /* [1], [1/day] variance of a mean from an earlier drive: at least, growth */
  tse_real w_min, w_max, valid_var, hold_var;
  tse_real watchdog_drop;             /* [log2] per row                                    */
  int32_t recovery_count;             /* particles drawn anew                              */
  tse_effects effects;                /* what is not in the plain model; mask 0: nothing   */
} tse_params;

/* What is Gaussian given a particle's path: states 0..2, mean stiffness 3..5, biases 6..8. In the paper's form the
 * first six are sampled, and their rows of the covariance are zero. */
#define TSE_GAUSS 9
#define TSE_ERROR (TSE_GAUSS + 3)

/* What the filter believed while all was well, to return to: mean stiffness and biases, their covariances, Lambda / nu. */
typedef struct tse_memory {
  tse_real mean[6], cov[6][6], err[6][6], lam[6];
} tse_memory;

/* Where the first row starts, made by tse_learnt_load(); else the settings say it. */
typedef struct tse_start {
  int32_t loaded;
  tse_real mu[3], mu_sd[3];           /* [1]        mean stiffness deviation, its scatter over the particles */
  tse_real mean_var[3];               /* [1]        its variance in all                                      */
  tse_real lam[6], gamma, nu;
  tse_real bias[3], bias_var[3];      /* [sigma]                                                             */
} tse_start;

enum { TSE_UNKNOWN, TSE_KNOWN, TSE_KNOWN_BEFORE }; /* a stiffness: never valid, valid since the last recovery, loaded */

typedef struct tse_filter {
  uint32_t magic, fingerprint;
  uint32_t step;                      /* rows accepted since reset: the counter of the random numbers */
  int32_t started;                    /* 0: the next row initialises                                  */
  tse_real gamma, nu;                 /* (16), (17): follow recursions without data, common to all    */
  tse_real cov[TSE_GAUSS][TSE_GAUSS]; /* common covariance of (x, mu, bias) given a particle's path; (18), (19) */
  tse_real err[TSE_ERROR][TSE_ERROR]; /* covariance of the error of the mean of all particles: cov's nine, and eps */
  tse_real level[3];                  /* mean stiffness at which the covariances were taken           */
  tse_real mean_var[3];               /* of mu before the last sample: forgetting goes no further     */
  tse_real log_total;                 /* log2 of the sum of 2^logw                                    */
  tse_real steer, v_front, v_rear;    /* inputs of the last row: [rad], R omega [m/s]                 */
  tse_real vel_x;                     /* [m/s] estimate after the last row                            */
  tse_real sliding, sliding_for;      /* [s] left of sliding, since when: 0 when wheels roll          */
  tse_real held_for;                  /* [s] how long inputs have been missing                        */
  tse_real still_for;                 /* [s] how long the wheels have stood still                     */
  tse_real seen;                      /* samples used since the start, up to five memories            */
  tse_real excite[3];                 /* regressors, smoothed over EXCITATION_TIME                    */
  tse_real excite_mean[3], excite_sq[3]; /* their running mean and mean square                        */
  tse_real learn[3];                  /* 1: statistics of this stiffness are learnt, 0: held          */
  tse_real evidence_slow, evidence_fast; /* running log evidence per row, slow and fast [log2]           */
  tse_real evidence_age, settle;      /* [s] age of the level; [s] left until settled after a recovery */
  int32_t recoveries;
  tse_real noise[3];                  /* variance of the sensors over what the settings say, >= 1     */
  tse_real fit_for;                   /* [s] behind the running means below, up to COLOUR_TIME        */
  tse_real misfit[3];                 /* running mean of z^2 over what the widest spread would allow  */
  tse_real smooth[3], colour[3];      /* smoothed z; its running mean square over that of white noise */
  tse_real surprise[3], foreseen[3];  /* running mean of z^2, and of its variance less noise, at a typical spread */
  tse_real shows[3];                  /* running mean square of d^2/S: what a sample says about the spread squared */
  tse_real contradicted;              /* share of recent samples that contradict                      */
  tse_real last[6];                   /* raw row before this one: steer, wheels, accelerometers, gyro  */
  int32_t repeats[6];                 /* rows for which each has not changed in the last bit          */
  tse_real repeat_for[6];             /* [s]                                                          */
  tse_real other_then[2], gained[2];  /* since a wheel speed repeats: the other axle's then, speed gained by accel_x [m/s] */
  int32_t stuck[3];                   /* accelerometers, gyro                                         */
  tse_real bias_now[3];               /* [sigma] mean of the biases                                   */
  int32_t stance;                     /* learn, try anew, hold                                        */
  tse_real stance_for;                /* [s] since when                                               */
  tse_real saved_for;                 /* [s] age of saved[0]                                          */
  int32_t saves;                      /* 0: nothing saved yet                                         */
  tse_memory saved[2];                /* what was believed before: the newer, the older               */
  int32_t known[3];                   /* what tse_learnt_save() may call learnt                       */
  tse_start start;
  tse_effect_memory effects;          /* of the effects that have one                                 */
  tse_real effect_level[4];           /* what the stiffness effects leave of kx_front, kx_rear, ky_front, ky_rear */
  tse_particles p;
  tse_real weight[TSE_STRIDE];        /* normalised to the largest = 1; 0 beyond the particles in use */
  uint16_t ancestor[TSE_STRIDE], copies[TSE_STRIDE]; /* the resampler's work space */
} tse_filter;

#endif
