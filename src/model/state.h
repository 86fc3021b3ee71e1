/* model/state.h - members of the structs that the caller allocates: the constants of a
 * filter (tse_params), its state, and the memory of the effects. An effect is a property
 * of a car that the single-track model leaves out, for example a steering delay.
 * Internal.
 *
 * Files of the library include this header before any header that includes tse/state.h.
 * Without it tse/state.h declares the structs as arrays of bytes, because a caller needs
 * only their sizes. */
#ifndef TSE_MODEL_STATE_H
#define TSE_MODEL_STATE_H

#if defined(TSE_STATE_H) && !defined(TSE_INTERNALS)
#error "include model/state.h before the headers of tse/"
#endif
#define TSE_INTERNALS
#include "tse/input.h"
#include "tse/real.h"
#include "tse/state.h"
#include "tables/effects.h"
#if !defined(TSE_NO_EFFECTS)
#include "tse/simulate.h"
#endif

#define TSE_DELAY_ROWS 12 /* max number of samples in a delay line, see effects_delay_put() */

/* Ages of the samples of a delay line, newest first. */
typedef struct tse_delay {
  int32_t count;
  tse_real age[TSE_DELAY_ROWS]; /* [s] */
} tse_delay;

/* Memory of the effects (properties of a car that the single-track model leaves out): the
 * numbers that the effects keep from step to step. */
typedef struct tse_effect_memory {
  int32_t settled; /* 0: the next row sets the effects to steady state (effects_settle()) */
#if !defined(TSE_NO_EFFECTS)
  tse_real lag[4];        /* after relaxation, front and rear: slip angles [rad], longitudinal slips [1] */
  tse_real mode[3][2];    /* second-order lags of roll, pitch, roll steer: output [m/s2], its rate [m/s3] */
  tse_real time, heading; /* since the start: [s] time; [turns] change of heading to the left, modulo 1 */
  int32_t steered;        /* 0: there has been no row with a steering angle */
  tse_real steered_by[3]; /* [rad] last steering angle: logged, after the first lag, after the second */
  /* delay lines of the effects steering_delay and imu_delay: ages and values */
  tse_delay steer, imu;
  tse_real steer_was[1][TSE_DELAY_ROWS], imu_was[3][TSE_DELAY_ROWS];
  /* memory of the user's formula, a term that the user may add to the vehicle model
   * (tables/formula.toml): states of its operations with memory, specific forces x and y
   * at the centre of gravity in the previous step [m/s2], and the stored samples of its
   * operation `late`, a delay */
  tse_real formula[TSE_FORMULA_MEMORIES][3];
  tse_real formula_accel[2];
  tse_delay formula_late;
  tse_real formula_was[1][TSE_DELAY_ROWS];
#endif
} tse_effect_memory;

#define TSE_PARAMS_MAGIC 0x74736570u /* "tsep" */
#define TSE_FILTER_MAGIC 0x74736566u /* "tsef" */

/* Those parts of the state of the particle filter that differ between particles, as
 * arrays [component][particle]. gamma and nu of the equations (16) and (17) of the paper,
 * and the covariance of the biases, are the same for all particles. They are therefore
 * not here but in tse_filter_paper. The resampler copies particles in a loop over all
 * arrays of this struct (paper_copy_particles()), so that every member must be such an
 * array. */
typedef struct tse_particles {
  tse_real x[3][TSE_STRIDE];    /* [m/s m/s rad/s] mean of vel_x, vel_y, yaw rate */
  tse_real mu[3][TSE_STRIDE];   /* [1] mean of (stiffness/nominal - 1) */
  tse_real lam[6][TSE_STRIDE];  /* [1] Lambda/nu, upper triangle by rows: 11 12 13 22 23 33. The covariance
                                 * of w has the inverse Wishart distribution of scale matrix Lambda and
                                 * nu degrees of freedom */
  tse_real bias[3][TSE_STRIDE]; /* [sigma] mean of the bias of accel_x, accel_y, yaw_rate, divided
                                 * by the noise sd of the sensor */
  tse_real w[3][TSE_STRIDE];    /* [1] stiffness/nominal - 1, drawn for the time to the next row */
  tse_real logw[1][TSE_STRIDE]; /* [log2] log weight, relative to the largest one */
} tse_particles;

#define TSE_SENSORS 5 /* accel_x, accel_y, yaw_rate, wheel speeds front and rear */
/* Sizes of the default filter. A "row" is a row of the log, which one call of tse_step()
 * processes.
 *   TSE_STATES         number of states (src/model/car.h)
 *   TSE_SLOW           number of slow states, which are the last elements of the state:
 *                      gravity components, and states that are random walks
 *   TSE_SUBSTEPS       max number of integration steps within a row
 *   TSE_UNCERTAIN_ALL  number of consider parameters, i.e. uncertain parameters that are
 *                      not estimated (Schmidt-Kalman filter)
 *   TSE_CONSIDERED     number of consider parameters whose influence this build computes
 *   TSE_VALUES         length of the arrays of prior and state. With TSE_SMALL some
 *                      states of the full build are constants. The arrays hold these
 *                      constants after the states and the consider parameters (KNOWN in
 *                      car.h): the model reads states and constants from one array
 *   TSE_KEPT           number of states that tse_learnt_save() saves: biases, stiffness,
 *                      grip, steering, radius
 *   TSE_EVENTS         max number of hypothetical events that are tracked at a time
 *                      (src/filter/events.c) */
#if defined(TSE_SMALL) /* a build with lateral motion only */
#if !defined(TSE_NO_VELOCITY) || !defined(TSE_NO_PARTICLES)
#error "TSE_SMALL needs TSE_NO_VELOCITY and TSE_NO_PARTICLES"
#endif
#define TSE_STATES 14
#define TSE_SLOW 9
#define TSE_SUBSTEPS 4
#define TSE_UNCERTAIN_ALL 11
#define TSE_VALUES (TSE_STATES + TSE_UNCERTAIN_ALL + 8)
#define TSE_CONSIDERED 4
#define TSE_KEPT 7
#define TSE_EVENTS 2
#else
#define TSE_STATES 23
#define TSE_SLOW 14
#define TSE_SUBSTEPS 8
#define TSE_VALUES TSE_STATES
#define TSE_UNCERTAIN_ALL 10
#define TSE_CONSIDERED TSE_UNCERTAIN_ALL
#define TSE_KEPT 11
#define TSE_EVENTS 15
#endif
/* Sizes for measured velocities (src/filter/velocity.c). A build with TSE_NO_VELOCITY
 * saves 1.9 kB of RAM in float, and refuses rows with a measured velocity.
 *   TSE_EXTRAS  number of extra states, which follow the other states. They are used from
 *               the first measured velocity on
 *   TSE_PAST    max number of rows whose motion is stored, so that a velocity with a
 *               latency can be compared with the motion at the time of its measurement */
#if defined(TSE_NO_VELOCITY)
#define TSE_EXTRAS 1
#define TSE_PAST 1
#else
#define TSE_EXTRAS 7
#define TSE_PAST 8
#endif
#define TSE_ALL (TSE_STATES + TSE_EXTRAS)

/* Parameters of the model of the car (src/model/car.h). Forces are divided by the
 * mass. */
typedef struct tse_car {
  tse_real kx_front, kx_rear;                  /* [m/s2] nominal longitudinal stiffness */
  tse_real ky_front, ky_rear;                  /* [m/s2/rad] nominal cornering stiffness */
  tse_real load_front, load_rear, grip, shape; /* static loads [m/s2]; friction, shape (tyre_secant()) [1] */
  /* [m/s2] max force of each axle at a friction coefficient of 1: load_front/(1 + b) and
   * load_rear/(1 - b). b is the setting tyre_saturation_balance */
  tse_real end_front, end_rear;
  /* relative change of the cornering stiffness of an axle by load transfer
   *   along  [s2/m] decrease in front, increase in the rear, per longitudinal acceleration
   *   side   [s4/m2] decrease per squared lateral acceleration */
  tse_real along_front, along_rear, side_front, side_rear;
  tse_real height_front, height_rear; /* [s2/m] as along, but relative change of the axle load */
  tse_real lf, lr;                    /* [m] distances of the axles from the centre of gravity */
  tse_real jf, jr, m_inertia;         /* [1/m] m lf/I, m lr/I; [1/m2] m/I */
  tse_real trail;                 /* [1/m] m/I times the distance by which Fy acts behind the wheel centre */
  tse_real drag, rolling;         /* [1/m] drag / squared speed; [m/s2] rolling resistance */
  tse_real pull_front, pull_rear; /* [m/s2] lateral force of each axle at zero slip angle */
  tse_real relaxation;            /* [m] relaxation length of the slip angles */
  tse_real compliance;            /* [rad s2/m] decrease of road-wheel angle per front lateral force */
  tse_real roll_steer;            /* [1] rear steering angle into the turn / roll angle out of the turn */
  tse_real roll_coupling;         /* [m] lateral acceleration of the car per roll acceleration */
  tse_real roll_gain, roll_omega; /* [rad s2/m] roll angle per a_y; [rad/s] natural frequency of roll */
  tse_real roll_damping;          /* [1] damping ratio of the roll */
  /* accel_y contains roll_leak phi - roll_height phi''. phi is the roll angle [rad] */
  tse_real roll_leak, roll_height; /* [m/s2] g, or 0 without roll; [m] setting body_roll_height */
  /* accel_x contains pitch_leak p - pitch_height p''. p is the longitudinal acceleration
   * after the lag of the pitch [m/s2] */
  tse_real pitch_leak;                /* [1] g times setting pitch_leak_gain */
  tse_real pitch_height;              /* [rad s2] settings pitch_leak_gain times pitch_leak_height */
  tse_real pitch_frequency;           /* [Hz] natural frequency of the pitch */
  tse_real pitch_damping;             /* [1] damping ratio of the pitch */
  tse_real lever_x, lever_y;          /* [m] position of the IMU, ahead and left of the centre of gravity */
  tse_real mount_cos, mount_sin;      /* [1] cosine, sine of the turn of the IMU to the left */
  tse_real scale_x, scale_y, scale_r; /* [1] (reading - bias)/true value: accel_x, accel_y, yaw_rate */
  tse_real free_front, free_rear;     /* [1] size of the small negative slip of a freely rolling axle:
                                       * rolling resistance / longitudinal stiffness */
  int32_t driven;                     /* driven axle: 0 both or unknown, 1 front, 2 rear */
} tse_car;

/* Constants of a filter, computed by tse_prepare() from the settings. The member `form`
 * is 0 in the default filter, a Kalman filter, and 1 in the paper's particle filter.
 * Forces are divided by the mass of the car. The particle filter also divides
 * measurements by the sd of their sensor (unit [sigma]). All numbers then have a moderate
 * size, which suits every number format. */
struct tse_params {
  uint32_t magic, fingerprint;
  uint32_t vehicle; /* hash of the vehicle settings, the same in every number format */
  int32_t form, wheel_signals;
  tse_real steady_walk; /* [1/s] growth rate of var(stiffness/nominal) while road and tyres stay the same */
  int32_t particles, resampling, vel_x_from_wheels, integration;
  uint32_t seed[2];
  /* vehicle */
  tse_real follow;                    /* [1] w rear / w front, w = longitudinal stiffness/nominal - 1 */
  tse_real radius_front, radius_rear; /* [m] rolling radii */
  /* sensors */
  tse_real sd[3], inv_sd[3]; /* sd of accel_x, accel_y [m/s2], yaw rate [rad/s], and 1/sd */
  tse_real bias_var0[3];     /* [sigma^2] initial variance of each bias */
  tse_real bias_walk[3];     /* [sigma^2/s] growth rate of the variance of each bias */
  tse_real log_sd[3];        /* log2 of each sd */
  tse_real mass_var;         /* [1] relative variance of the mass */
  /* filter */
  tse_real sample_time, inv_sample_time, max_step, max_gap, max_slip, hold_speed, max_steer;
  /* [m/s2] 4 times speed times the fastest rate at which the tyres damp the motion. An
   * integration step lasts at most speed / damping (vehicle_steps()) */
  tse_real damping;
  tse_real least_step;      /* [s] min integration step (vehicle_steps()) */
  tse_real noise_max_var;   /* [1] max (estimated noise variance / variance in the settings): noise_max^2 */
  tse_real log2_forgetting; /* log2 of the forgetting factor of Lambda and nu */
  tse_real log2_forgetting_mean; /* log2 of forgetting_mean */
  /* [1] forgetting_mean is the forgetting factor of gamma. While low-passed innovations
   * are larger than those of white noise, the factor decreases, at most to
   * forgetting_change (paper_forget()) */
  tse_real forgetting_mean, forgetting_change;
  tse_real memory;      /* [samples] memory of Lambda: 1/(1 - forgetting factor) */
  tse_real resample_at; /* [particles] N_eff at or below which particles are resampled */
  /* particle filter: mu0 .. nu0 are the initial mu, lam (tse_particles), gamma and nu.
   * spread_var is the initial variance of stiffness/nominal about its mean */
  tse_real mu0[3], lam0, gamma0, nu0, spread_var;
  tse_real vel_x0, x_sd0[3];
  tse_real mean_var0;      /* [1] initial variance of the mean of stiffness/nominal */
  tse_real spread_max_var; /* [1] square of setting spread_max */
  tse_real kernel;         /* [log2] sd of log2 of the random factor by which resampling multiplies Lambda */
  tse_real latency;        /* [s] age of the row that is processed when the newest row arrives */
  tse_real latency_span;   /* [s] max of latency_age; 0: no channel has a latency, so that no row waits */
  tse_real latency_least;  /* [s] min time between stored rows */
  tse_real latency_age[6]; /* [s] age of the processed value of each channel when the newest row arrives */
  /* variance of a mean of stiffness/nominal that was learnt in an earlier drive:
   * learnt_floor is its min [1], learnt_walk its growth rate between drives [1/day] */
  tse_real learnt_floor;
  tse_real learnt_walk;
  /* particle filter: limits of w = stiffness/nominal - 1. Initial values are clipped to
   * w_min .. w_max. Later w is drawn at random for each particle and row. A drawn w below
   * w_low is reflected at w_low, and a drawn w above w_max is clipped. w_low is w_min, or
   * lower if the setting reflect_draws is 0 */
  tse_real w_min, w_low, w_max;
  tse_real valid_var;                               /* [1] square of setting valid_sd */
  tse_car car;                                      /* the particle filter uses only stiffness and geometry */
  tse_real prior[TSE_VALUES], prior_sd[TSE_VALUES]; /* default filter: prior mean and sd of the state */
  tse_real sensor_sd[TSE_SENSORS];                  /* [m/s2] [m/s2] [rad/s] [m/s] [m/s] sd of each sensor */
  tse_real uncertain[TSE_UNCERTAIN_ALL];            /* sd of each consider parameter */
  tse_real model_sd;                                /* [1] setting model_sd */
  tse_real bias_sd_walk[3], steady_sd_walk, log_min, log_max;
  tse_real steer_lag, steer_lag_second; /* [s] time constants of the two lags of the steering, in series */
  /* [m/s m/s m/s rad] noise sd of ins_vel_x, ins_vel_y, gnss_speed, gnss_course */
  tse_real velocity_sd[TSE_VELOCITIES];
  tse_real velocity_late; /* [s] latency of the velocities relative to the rest of their row; may be < 0 */
  tse_real extra[TSE_EXTRAS], extra_sd[TSE_EXTRAS]; /* prior mean and sd of the extra states */
  tse_real no_torque;                               /* [Nm] an axle with a smaller |torque| rolls freely */
  tse_real road_sd;    /* [m/s2] sd of the error of gravity from a logged grade or bank */
  tse_effects effects; /* mask 0: model without effects */
};

/* Initial estimate from tse_learnt_load(). If `loaded` is 0, the filter starts from the
 * settings instead. */
typedef struct tse_start {
  int32_t loaded;
  tse_real mu[3], mu_sd[3]; /* [1] mean of (stiffness/nominal - 1); sd of this mean over the particles */
  tse_real mean_var[3];     /* [1] variance of this mean: mu_sd^2 plus the variance within each particle */
  tse_real lam[6], gamma, nu;
  tse_real bias[3], bias_var[3]; /* particle filter: mean of each bias [sigma]; its variance [sigma^2] */
  tse_real kept[TSE_KEPT];       /* default filter: saved states, SI units */
  tse_real kept_cov[TSE_KEPT][TSE_KEPT]; /* default filter: covariance of `kept`, in units of state_unit */
  tse_real noise[TSE_SENSORS];           /* [1] noise variance / variance in the settings */
} tse_start;

/* History of a stiffness: whether it has been valid, or was loaded. */
enum {
  TSE_UNKNOWN,      /* not valid in any row since the last restart, and not loaded */
  TSE_KNOWN,        /* valid in at least one row since the last restart */
  TSE_KNOWN_BEFORE, /* loaded by tse_learnt_load(), and not valid in any row since */
};

#define TSE_GROUPS 2 /* groups of events: lateral, longitudinal; at most one event in each is assumed */

/* Covariance U D U' of the state, in the units that STATE_ROWS (car.h) lists for the
 * states. U is unit upper triangular, D diagonal. */
typedef struct tse_ud {
  tse_short u[TSE_STATES * (TSE_STATES - 1) / 2]; /* elements of U above its diagonal */
  tse_short w[TSE_EXTRAS][TSE_ALL];               /* rows of U that belong to the extra states */
  int32_t extras;                                 /* number of extra states in use: 0 or TSE_EXTRAS */
  tse_real d[TSE_STATES], e[TSE_EXTRAS];          /* D of the states, D of the extra states */
} tse_ud;

/* State of the measured velocities, in the order of src/tables/sensors.toml. */
typedef struct tse_velocity {
  tse_real noise[TSE_VELOCITIES];        /* [1] estimated noise variance / variance in the settings */
  tse_real innovation[TSE_VELOCITIES];   /* [m/s, rad] innovation of the last measured value */
  tse_real last[TSE_VELOCITIES];         /* [m/s, rad] last measured value */
  tse_real since[TSE_VELOCITIES];        /* [s] age of the last measured value */
  tse_real mean_nis[TSE_VELOCITIES];     /* [1] mean of recent normalised squared innovations */
  tse_real rejected_for[TSE_VELOCITIES]; /* [s] time for which the values of the channel have been rejected */
  /* [m/s m/s rad/s rad] vel_x, vel_y, yaw rate, heading of each past row, minus those of
   * the present row; newest row first */
  tse_real past[TSE_PAST][4];
  tse_real age[TSE_PAST]; /* [s] ages of the rows in past */
  tse_real gyro;          /* [rad/s] rate of the heading at the last row */
  tse_real turned;        /* [rad] change of heading since the last row */
  tse_real motion[3];     /* vel_x, vel_y [m/s] and yaw rate [rad/s] at the last row */
  tse_real activity;      /* [m2/s2] recent mean square of the lateral speed of the rear axle */
  int32_t kept;           /* number of rows in past */
  int32_t has_heading;    /* 1: the heading has been initialised */
  int32_t has_gyro;       /* 1: `gyro` is the reading minus its bias; 0: the yaw rate of the state */
} tse_velocity;

/* A hypothetical event, for example a change of the road surface. If the event has
 * happened, the estimated state has an error: the vector v times the amplitude of the
 * event. The amplitude is unknown, and is estimated from the innovations. */
typedef struct tse_event {
  tse_short v[TSE_ALL]; /* error of the state per unit of the amplitude, in units of the state */
  tse_real info;  /* [1] information (1/variance) on the amplitude, collected while the event is tracked */
  tse_real score; /* [1] info times the estimate of the amplitude */
  tse_real both;  /* [1] of EVENT_ROAD_AXLE_DIFF: cross information with the amplitude of EVENT_ROAD */
  tse_real age;   /* [s] time for which the event has been tracked */
  int32_t kind;   /* EVENT_... of src/filter/types.h; 0: unused, no event */
} tse_event;

/* Statistics of a pair of quantities that should be equal (src/filter/plausible.c). */
typedef struct tse_pair {
  tse_real time; /* [s] effective duration of the samples, with forgetting */
  /* mean and variance of each quantity, and covariance of the two */
  tse_real mean[2], var[2], both;
} tse_pair;

/* Sums of a regression that estimates the delay [s] of a second channel relative to a
 * first channel. Model: the second channel is the first channel, times a constant, minus
 * the delay times the rate of the first channel. The estimated delay is late / square.
 * Older samples are forgotten with the time constant SCALE_TIME
 * (src/filter/plausible.c). */
typedef struct tse_timing {
  tse_real square; /* [m2/s5] time integral of the squared rate of the first channel */
  tse_real late;   /* [m2/s4] `square` times the estimated delay */
} tse_timing;

/* State of the plausibility check of the channels (src/filter/plausible.c). */
#define TSE_PAIRS 5
typedef struct tse_agreement {
  /* low-passed accel_y, v r, accel_x, speed v, yaw rate r, and the yaw rate expected from
   * the steering angle */
  tse_real smooth[6];
  tse_pair pair[TSE_PAIRS];
  tse_real since; /* [s] time since the last row with a wheel speed */
  /* [m2/s3] sums that give the factor by which the speed from the wheels is too large
   * (compute_scale()). r is the yaw rate, v the speed from the wheels. moved[0]: time
   * integrals of (v r)^2 and of v r accel_y. moved[1]: time integrals of accel_x^2 and of
   * accel_x times the rate of v */
  tse_real moved[2][2];
  tse_timing across, steered; /* delay of accel_y behind v r; of yaw_rate behind steer_angle */
  tse_real lags;              /* [m2/s4] across.square times the max lag of accel_y by tyres and lever arm */
  tse_real complete_for;      /* [s] time since the last row without accel_y, yaw_rate or steer_angle */
  /* bits 0 .. TSE_PAIRS - 1: the two quantities of this pair disagree. The next three bits:
   * accel_y is late; yaw_rate is late; steer_angle is late */
  int32_t apart;
  int32_t off_scale; /* 1: accelerometers and wheels disagree on the speed */
} tse_agreement;

/* Prior of c = ln(longitudinal stiffness / nominal) at the last start, or at the last
 * change of road or tyres. The state LCX is c plus a constant error of the longitudinal
 * model (pitch, rolling radii), and only the sum is observable. When LCX changes, c gets
 * the share of the change that follows from the prior variance of c
 * (src/filter/slip_stiffness.c). */
typedef struct tse_along {
  tse_real mean, var; /* value of LCX at that time; variance of c alone [1] */
} tse_along;

/* State of the default filter, a Kalman filter of the car. */
typedef struct tse_kalman {
  tse_real x[TSE_VALUES + TSE_EXTRAS]; /* state, SI units */
  tse_ud ud;                           /* covariance of x, in units of state_unit */
  tse_short consider[TSE_CONSIDERED]
                    [TSE_ALL];   /* error of x if a parameter is wrong by its sd, in units of the state */
  tse_real noise[TSE_SENSORS];   /* [1] estimated noise variance / variance in the settings */
  tse_real activity[3];          /* [m2/s4] [m2/s4] [rad2/s2] recent mean square of a_x, a_y, yaw rate */
  tse_real before[3];            /* [m/s2] [m/s2] [m/s] a_x, a_y and speed at the last row */
  tse_real pitch[2];             /* [m/s2] a_x after the lag of the pitch; [m/s3] its rate */
  tse_real steer[3];             /* [rad] steering angle: logged, after the first lag, after both lags */
  tse_real road[2];              /* [m/s2] gravity g_x, g_y from the logged grade and bank; 0: not logged */
  tse_real since_slow[TSE_SLOW]; /* [s] time since process noise was last added to each slow state */
  /* for each stiffness state (LCX, LCF, LCR), variance of its linearisation error, in
   * squared units of the state. Measurements were linearised at the value that the state
   * had before a correction, which makes them inaccurate. The variance is added to the
   * covariance with the next process noise of the state */
  tse_real moved[3];
  tse_real seen; /* [s] total time of the processed rows since the start */
  tse_real
      nis[TSE_SENSORS]; /* [1] normalised innovation squared of each channel in the last row; 0: not used */
  tse_real lasting[TSE_SENSORS];     /* [SI] estimate of the non-white part of the innovation */
  tse_real lasting_var[TSE_SENSORS]; /* variance of the error of `lasting` */
  tse_real innovation[TSE_SENSORS], innovation_var[TSE_SENSORS], last_innovation[TSE_SENSORS];
  tse_real slow[TSE_SENSORS];     /* [SI] innovation after a low pass, for tests of events */
  tse_real slow_var[TSE_SENSORS]; /* predicted variance of `slow` */
  tse_real usual[TSE_SENSORS];    /* [1] recent mean of slow^2 / slow_var */
  tse_real log_likelihood;
  tse_real change_age;         /* [s] time since the last change of road or tyres (change_kind) */
  tse_real change_from[4];     /* [1] states LCX, LCF, LCR, LMU (logarithms) before the last change */
  tse_real change_from_var[4]; /* variances of change_from, in squared units of the state */
  /* along: prior of ln(longitudinal stiffness / nominal), see tse_along. along_from: the
   * prior before the last change of road or tyres */
  tse_along along, along_from;
  tse_real reading[TSE_SENSORS + 1];       /* last readings of the sensors and of the steering angle */
  tse_real repeats[TSE_SENSORS + 1];       /* [1] share of the readings that equal the previous reading */
  tse_real repeats_again[TSE_SENSORS + 1]; /* [1] share of repeats among the readings that follow a repeat */
  /* [1] -log2 of the probability that a working channel repeats its reading as often as
   * this channel now has (watch_repeats()) */
  tse_real frozen[TSE_SENSORS + 1];
  tse_real agrees_for; /* [s] time for which the faulty channel has agreed with the prediction */
  int32_t change_kind; /* TSE_CHANGE_* */
  int32_t fault;       /* 1 + TSE_CHANNEL_... of the faulty channel; 0: no fault */
  int32_t slow_turn;   /* slow state whose process noise is added next */
  int32_t road_given;  /* bit 0: the last row has a grade; bit 1: the last row has a bank */
  tse_event event[TSE_EVENTS];
  tse_real weight[TSE_EVENTS]; /* posterior probability of each event */
  tse_real none[TSE_GROUPS];   /* posterior probability that no event of the group has happened */
  tse_velocity velocity;
  tse_agreement agreement;
} tse_kalman;

/* Evidence that the car drives backwards (src/filter/backwards.c). */
typedef struct tse_way {
  tse_real by_turn, by_gain;  /* [1] natural log odds of reverse, by yaw rate and by accel_x (backwards.c) */
  tse_real begins, gained;    /* [m/s] speed when the car began to roll; integral of accel_x since then */
  tse_real rolls_for, unread; /* [s] time since the car began to roll; time since the last accel_x */
} tse_way;

/* Ring buffer of rows that wait for the values of channels with a latency. */
typedef struct tse_alignment {
  int32_t count, newest;               /* number of rows; index of the newest */
  tse_real since;                      /* [s] sum of dt of the rows received since a row was last processed */
  tse_real unkept;                     /* [s] sum of dt of the rows received since a row was last stored */
  tse_real before[TSE_LATENCY_KEPT];   /* [s] time since the stored row before this one; 0: first row */
  tse_real value[TSE_LATENCY_KEPT][6]; /* channels as logged; 0 if missing */
  uint8_t missing[TSE_LATENCY_KEPT];   /* bits of tse_input.missing */
  tse_real lost[3];  /* [1] share of the noise variance of the IMU that interpolation removes */
  int32_t reason[4]; /* reason codes of the three stiffnesses and of the grip in the last step */
} tse_alignment;

/* A filter: members that the Kalman filter and the particle filter share, then the state
 * of the Kalman filter. */
struct tse_filter {
  uint32_t magic, fingerprint;
  uint32_t step;   /* number of rows processed since tse_reset(); counter of the random numbers */
  int32_t started; /* 0: the next row initialises the motion */
  tse_real steer, v_front, v_rear; /* inputs of the last row: [rad], [m/s] R omega */
  tse_real held_for;               /* [s] time since the last row with a steering angle; the angle is held */
  tse_real rolled_for;             /* [s] time since the last wheel speed */
  /* 1: the motion is unknown, because held_for exceeds the setting max_gap or rolled_for
   * exceeds ROAD_TIME. It stays unknown until a row has both steering angle and wheel
   * speed */
  int32_t lost;
  tse_real still_for; /* [s] time since the wheels stopped */
  /* [s] for each axle, remaining time for which its wheel speed counts as a signal of its
   * own. In some logs the wheel speeds of both axles are copies of one signal, which must
   * not be used as two measurements. A row in which the wheel speed has a new value that
   * is not a copy sets the time to USUAL_TIME. 0: the wheel speed may be a copy */
  tse_real off_for[2];
  tse_real ratio; /* [1] front / rear wheel speed in the last row in which both changed; 0: unknown */
  tse_real gaps;  /* [1] number of recent gaps (count_gaps()); decays with the time constant USUAL_TIME */
  tse_way way;
  tse_real seen;    /* particle filter: number of rows that have updated it, at most 5 * tse_params.memory */
  int32_t known[3]; /* history of each stiffness (TSE_UNKNOWN ...), for tse_learnt_save() */
  tse_start start;
  tse_kalman k;          /* state of the Kalman filter */
  tse_alignment waiting; /* rows that wait for channels with a latency */
};

/* State of the paper's particle filter. The caller passes a pointer to its first member,
 * a tse_filter. The functions of the particle filter cast the pointer to one of type
 * tse_filter_paper. */
struct tse_filter_paper {
  tse_filter filter;
  /* gamma and nu of equations (16) and (17) of the paper. gamma: variance of the mean
   * stiffness / variance of the stiffness about its mean; nu: degrees of freedom. All
   * particles share gamma and nu */
  tse_real gamma, nu;
  tse_real bias_var
      [3]; /* [sigma^2] variances of the biases: diagonal of P of (18), (19), the same for all particles */
  tse_real log_total; /* log2 of the sum of the weights 2^logw */
  tse_real excite[3]; /* [sigma] low-passed d(measurement)/d(stiffness/nominal), paper/row.c */
  tse_real excite_mean[3], excite_sq[3]; /* recent mean and mean square of excite */
  tse_real slow[3]; /* [sigma] low-passed innovations; they adapt the forgetting factor of gamma */
  tse_particles p;
  tse_real weight[TSE_STRIDE];                       /* weight / largest weight; 0 for unused particles */
  uint16_t ancestor[TSE_STRIDE], copies[TSE_STRIDE]; /* work space of the resampler */
};

#if !defined(TSE_NO_EFFECTS)
struct tse_sim {
  tse_params params;
  tse_sim_input last; /* inputs of the last row */
  tse_sim_config config;
  uint32_t step;              /* number of rows so far */
  tse_real x[5];              /* vel_x, vel_y [m/s]; yaw rate, wheel speeds front and rear [rad/s] */
  tse_real bias[3], drawn[3]; /* biases [m/s2 m/s2 rad/s]; drawn stiffness / nominal, until the next row */
  tse_real steer;             /* [rad] road-wheel angle at the last row, after the effects */
  tse_real steer_logged;      /* [rad] logged angle at the last row */
  tse_effect_memory effects;
};
#endif

/* Compile-time checks of the sizes that tse/state.h reserves. If a size is wrong, an
 * array gets -1 elements, which is a compile error. */
typedef char tse_params_has_its_size[sizeof(tse_params) == sizeof(tse_params_bytes) ? 1 : -1];
typedef char tse_filter_has_its_size[sizeof(tse_filter) == sizeof(tse_filter_bytes) ? 1 : -1];
typedef char tse_filter_paper_has_its_size
    [sizeof(tse_filter_paper) == sizeof(tse_filter_bytes) + sizeof(tse_paper_bytes) ? 1 : -1];
#if !defined(TSE_NO_EFFECTS)
/* The public declaration of struct tse_sim: a copy from tse/simulate.h. */
struct tse_sim_seen {
  tse_params_bytes params;
  tse_sim_input last;
  tse_sim_bytes bytes;
};
typedef char tse_sim_has_its_size[sizeof(tse_sim) == sizeof(struct tse_sim_seen) ? 1 : -1];
#endif

#endif
