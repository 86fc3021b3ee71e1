/* tse/config.h - settings, from the tables in src/tables.
 * Comments read: [unit] default, min .. max; meaning.
 * Defaults are an ordinary car, and the particle filter of Sec. IV of the paper. */
#ifndef TSE_CONFIG_H
#define TSE_CONFIG_H

#include <stdint.h>

#include "tse/real.h"

/* Filters of this build: 0 the default Kalman filter, 1 the paper's particle filter. */
#define TSE_FIRST_FORM 0
#define TSE_DEFAULT_FORM 0

/* A build without particles is at least 12 kB smaller on a Cortex-M. It refuses the
 * paper's filter. */
#if defined(TSE_NO_PARTICLES)
#define TSE_LAST_FORM 0
#else
#define TSE_LAST_FORM 1
#endif

/* Settings, in SI units. Fill with tse_config_default(), then set the values of your car,
 * at least the mass. Where 0 is outside the range (mass, yaw inertia, stiffness), it
 * means "not set". Effects of an ordinary car are on (body_roll_gain, relaxation_length
 * ...), the others are 0, off. Column `estimator` of src/tables/effects.toml lists the
 * effects of the default filter's model. */
typedef struct tse_config {
  // clang-format off: table config_members
  tse_setting mass;                             /* [kg] 0, 50 .. 50000; vehicle mass; 0: not known, then no
                                                 * stiffness is valid */
  tse_setting yaw_inertia;                      /* [kg m2] 0, 10 .. 1000000; yaw moment of inertia about
                                                 * the centre of gravity; 0: mass lf lr */
  tse_setting lf;                               /* [m] 1.25, 0.1 .. 10; centre of gravity to front axle */
  tse_setting lr;                               /* [m] 1.5, 0.1 .. 10; centre of gravity to rear axle */
  tse_setting wheel_radius_front;               /* [m] 0.33, 0.05 .. 2; effective rolling radius, front */
  tse_setting wheel_radius_rear;                /* [m] 0.33, 0.05 .. 2; effective rolling radius, rear */
  tse_setting longitudinal_stiffness_front;     /* [N] 0, 1000 .. 10000000; nominal longitudinal (slip)
                                                 * stiffness of the front axle; 0: of its class, by its
                                                 * load */
  tse_setting longitudinal_stiffness_rear;      /* [N] 0, 1000 .. 10000000; nominal longitudinal (slip)
                                                 * stiffness of the rear axle; 0: of its class, by its load */
  tse_setting cornering_stiffness_front;        /* [N/rad] 0, 1000 .. 10000000; nominal cornering stiffness
                                                 * of the front axle; 0: of its class, by its load */
  tse_setting cornering_stiffness_rear;         /* [N/rad] 0, 1000 .. 10000000; nominal cornering stiffness
                                                 * of the rear axle; 0: of its class, by its load */
  tse_setting rear_longitudinal_follows_front;  /* [1] 1, 0 .. 1; share of the front's relative deviation
                                                 * that the rear longitudinal stiffness takes; paper's
                                                 * filter */
  tse_setting mass_sd;                          /* [1] 0.05, 0 .. 0.5; sd of mass, relative, yaw_inertia
                                                 * with it */
  tse_setting yaw_inertia_sd;                   /* [1] 0.1, 0 .. 0.5; sd of yaw_inertia, relative */
  tse_setting cg_sd;                            /* [m] 0.03, 0 .. 1; sd of where the centre of gravity lies
                                                 * between the axles */
  tse_setting steer_ratio_sd;                   /* [1] 0.03, 0 .. 0.5; sd of the scale of steer_angle:
                                                 * steering ratio, compliance */
  tse_setting steer_offset_sd;                  /* [rad] 0.006, 0 .. 0.1; sd of a constant offset of
                                                 * steer_angle */
  tse_setting accel_y_scale_sd;                 /* [1] 0.03, 0 .. 0.5; sd of the scale of accel_y: body
                                                 * roll adds to it */
  tse_setting wheel_delay_sd;                   /* [s] 0.02, 0 .. 0.2; sd of how late the wheel speeds are
                                                 * behind the IMU */
  tse_setting accel_delay_sd;                   /* [s] 0.003, 0 .. 0.2; sd of how late the accelerometers
                                                 * are behind the gyro */
  tse_setting relaxation_sd;                    /* [m] 0.2, 0 .. 2; sd of the relaxation length of each
                                                 * axle */
  tse_setting lean_sd;                          /* [1] 0.1, 0 .. 0.5; sd of the share of speed times yaw
                                                 * rate by which roads lean into their curves */
  tse_setting gyro_scale_sd;                    /* [1] 0.01, 0 .. 0.2; sd of the scale of yaw_rate */
  tse_setting trail_sd;                         /* [m] 0.03, 0 .. 0.2; sd of how far the lateral forces act
                                                 * behind the axles */
  tse_setting roll_steer_sd;                    /* [1] 0.04, 0 .. 0.5; sd of the rear axle's roll steer */
  tse_setting wheel_radius_sd;                  /* [1] 0.005, 0 .. 0.2; sd of the wheel radius rear over
                                                 * front, relative */
  tse_setting model_sd;                         /* [1] 0.12, 0 .. 0.5; model discrepancy: sd of what the
                                                 * model does not explain of a channel, as a share of what
                                                 * happens, lasting about a second */
  tse_setting grade_sd;                         /* [rad] 0.03, 0 .. 0.3; sd of road grade, a state: v_x' =
                                                 * a_x - g grade, accel_x reads a_x */
  tse_setting accel_x_sd;                       /* [m/s2] 0.1, 0.001 .. 10; noise of accel_x, one sample */
  tse_setting accel_y_sd;                       /* [m/s2] 0.1, 0.001 .. 10; noise of accel_y, one sample */
  tse_setting yaw_rate_sd;                      /* [rad/s] 0.0025, 1e-05 .. 1; noise of yaw_rate, one
                                                 * sample */
  tse_setting wheel_noise_sd;                   /* [rad/s] 0.04, 0 .. 5; noise of the wheel speeds (mean of
                                                 * an axle's two wheels), one sample; default filter */
  tse_setting steer_lag_sd;                     /* [s] 0.025, 0 .. 0.2; how late the steering acts behind
                                                 * the IMU (bus, steering, tyres), or how early: sd of what
                                                 * is not known; 0: not at all; default filter */
  tse_setting accel_x_bias_sd;                  /* [m/s2] 0.2, 0 .. 5; bias of accel_x at the start */
  tse_setting accel_y_bias_sd;                  /* [m/s2] 0.2, 0 .. 5; bias of accel_y at the start */
  tse_setting yaw_rate_bias_sd;                 /* [rad/s] 0.01, 0 .. 0.5; bias of yaw_rate at the start */
  tse_setting accel_x_bias_walk;                /* [m/s2/sqrt(s)] 0.002, 0 .. 1; random walk of the accel_x
                                                 * bias (8), (18) */
  tse_setting accel_y_bias_walk;                /* [m/s2/sqrt(s)] 0.002, 0 .. 1; random walk of the accel_y
                                                 * bias (8), (18) */
  tse_setting yaw_rate_bias_walk;               /* [rad/s/sqrt(s)] 0.0001, 0 .. 0.1; random walk of the
                                                 * yaw_rate bias (8), (18) */
  tse_setting steer_angle_latency;              /* [s] 0, -0.2 .. 0.2; how much later than yaw_rate
                                                 * steer_angle is logged; below 0: earlier */
  tse_setting wheel_speed_front_latency;        /* [s] 0, -0.2 .. 0.2; how much later than yaw_rate
                                                 * wheel_speed_front is logged */
  tse_setting wheel_speed_rear_latency;         /* [s] 0, -0.2 .. 0.2; how much later than yaw_rate
                                                 * wheel_speed_rear is logged */
  tse_setting accel_x_latency;                  /* [s] 0, -0.2 .. 0.2; how much later than yaw_rate accel_x
                                                 * is logged */
  tse_setting accel_y_latency;                  /* [s] 0, -0.2 .. 0.2; how much later than yaw_rate accel_y
                                                 * is logged */
  tse_setting ins_velocity_sd;                  /* [m/s] 0.1, 0.001 .. 10; error of ins_vel_x and
                                                 * ins_vel_y, one value; the noise is found while driving */
  tse_setting gnss_speed_sd;                    /* [m/s] 0.1, 0.001 .. 10; error of gnss_speed, one value */
  tse_setting gnss_course_sd;                   /* [rad] 0.01, 0.0001 .. 1; error of gnss_course, one
                                                 * value, above 10 m/s; below in inverse proportion to the
                                                 * speed */
  tse_setting velocity_latency;                 /* [s] 0, -0.2 .. 0.2; latency of measured velocities
                                                 * behind yaw_rate */
  tse_setting velocity_latency_sd;              /* [s] 0.03, 0 .. 0.2; its sd */
  tse_setting velocity_lever_x;                 /* [m] 0, -20 .. 20; where the antenna, or the place that
                                                 * the INS speaks of, is before the centre of gravity */
  tse_setting velocity_lever_y;                 /* [m] 0, -20 .. 20; the same, to the left of it */
  tse_setting velocity_lever_sd;                /* [m] 0.1, 0 .. 5; sd of both */
  tse_setting velocity_heading;                 /* [rad] 0, -0.5 .. 0.5; how far the axes of the INS are
                                                 * turned to the left of the car's */
  tse_setting velocity_heading_sd;              /* [rad] 0.02, 0 .. 0.5; its sd */
  tse_setting velocity_scale_sd;                /* [1] 0.02, 0 .. 0.2; sd of the scale of a measured speed
                                                 * over that of the wheels: both wheel radii */
  tse_setting wheel_torque_least;               /* [Nm] 60, 1 .. 2000; an axle with less torque than this
                                                 * rolls freely: two sd of its offset and noise */
  tse_setting road_sd;                          /* [rad] 0.005, 0 .. 0.3; sd of a given bank and grade:
                                                 * laps of one road agree that well */
  tse_setting mass_change;                      /* [1] 0, -0.5 .. 1; true mass over the setting's, less one */
  tse_setting yaw_inertia_change;               /* [1] 0, -0.5 .. 1; true yaw inertia over the setting's,
                                                 * less one */
  tse_setting cg_shift_distance;                /* [m] 0, -0.6 .. 0.6; added to lf, taken from lr; at most
                                                 * 9/10 of either */
  tse_setting wheel_radius_change;              /* [1] 0, -0.1 .. 0.1; true rolling radius over the
                                                 * setting's, less one; both axles */
  tse_setting steering_ratio_change;            /* [1] 0, -0.3 .. 0.3; true road-wheel angle over the
                                                 * logged one, less one */
  tse_setting steering_offset_angle;            /* [rad] 0, -0.05 .. 0.05; true road-wheel angle less the
                                                 * logged one */
  tse_setting steering_delay_time;              /* [s] 0, 0 .. 0.2; the wheels turn this much later than
                                                 * logged */
  tse_setting steering_lag_time;                /* [s] 0.02, 0 .. 0.5; time constant from the logged angle
                                                 * to the wheels, of both lags together */
  tse_setting steering_lag_second;              /* [1] 0, 0 .. 1; second lag over the first; 0: one lag
                                                 * only */
  tse_setting exact_kinematics_share;           /* [1] 1, 0 .. 1; 0: (1)-(4) with small angles, 1: exact,
                                                 * between: a mixture */
  tse_setting steering_compliance_angle_per_moment; /* [rad/(N m)] 0, 0 .. 0.001; steering angle lost per
                                                     * moment about the steering axis */
  tse_setting steering_compliance_trail;        /* [m] 0.03, 0.001 .. 0.2; lever of the lateral force about
                                                 * the steering axis */
  tse_setting rear_roll_steer_gain;             /* [1] 0, -0.5 .. 0.5; rear steering angle per roll angle,
                                                 * into the turn */
  tse_setting rear_roll_steer_roll;             /* [rad s2/m] 0.0075, 0.0005 .. 0.03; roll angle per
                                                 * lateral acceleration */
  tse_setting rear_roll_steer_frequency;        /* [Hz] 1.5, 0.3 .. 6; natural frequency of the roll */
  tse_setting rear_roll_steer_damping;          /* [1] 0.3, 0.05 .. 2; damping ratio of the roll */
  tse_setting relaxation_length;                /* [m] 0.4, 0 .. 3; way that the slip angle takes to build
                                                 * up */
  tse_setting longitudinal_relaxation_length;   /* [m] 0, 0 .. 2; way that the slip takes to build up */
  tse_setting stiffness_drift_change;           /* [1] 0, -0.6 .. 1; of all stiffnesses, when the drift has
                                                 * ended */
  tse_setting stiffness_drift_time;             /* [s] 600, 0.001 .. 36000; how long it drifts; short: a
                                                 * step */
  tse_setting stiffness_drift_start;            /* [s] 0, 0 .. 36000; when it begins, from the start */
  tse_setting combined_slip_factor;             /* [1] 0, 0 .. 2000; k of 1/sqrt(1 + k slip^2) */
  tse_setting tyre_saturation_inverse_friction; /* [1] 0, 0 .. 5; 1/friction: axle load over the most
                                                 * lateral force */
  tse_setting tyre_saturation_shape;            /* [1] 1, 0 .. 1; 0: brush model with parabolic pressure,
                                                 * 1: as magic-formula tyres, which saturate later and
                                                 * harder */
  tse_setting tyre_saturation_balance;          /* [1] 0, -0.5 .. 0.5; front 1/friction (1 + balance), rear
                                                 * 1/friction (1 - balance): which axle ends first */
  tse_setting longitudinal_load_transfer_gain;  /* [s2/m] 0.02, -0.08 .. 0.08; k: cornering stiffness per
                                                 * accel_x, less in front, more in the rear */
  tse_setting longitudinal_load_transfer_balance; /* [1] 0, -1 .. 1; front k (1 + balance), rear k (1 -
                                                   * balance): tyres of the axle that carries more gain
                                                   * less by a load */
  tse_setting lateral_load_transfer_gain;       /* [s4/m2] 0.002, -0.003 .. 0.03; k of C (1 - k accel_y^2) */
  tse_setting lateral_load_transfer_balance;    /* [1] 0, -1 .. 1; front k (1 + balance), rear k (1 -
                                                 * balance): which axle carries the roll */
  tse_setting aero_drag_coefficient;            /* [kg/m] 0.4, 0 .. 5; force per speed squared: 1/2 rho cd
                                                 * A */
  tse_setting rolling_resistance_coefficient;   /* [1] 0.01, 0 .. 0.2; force per weight, against the motion */
  tse_setting grade_angle;                      /* [rad] 0, -0.35 .. 0.35; slope of the road, uphill > 0;
                                                 * replay adds a profile */
  tse_setting bank_angle;                       /* [rad] 0, -0.35 .. 0.35; left side of the road high > 0;
                                                 * replay adds a profile */
  tse_setting bank_superelevation;              /* [1] 0.1, -0.5 .. 0.5; share of speed times yaw rate that
                                                 * the road's lean into its curves takes over */
  tse_setting crosswind_speed;                  /* [m/s] 0, -30 .. 30; steady wind, pushing to the left at
                                                 * the heading of the start > 0 */
  tse_setting crosswind_heading;                /* [rad] 0, -3.2 .. 3.2; heading at the start from where
                                                 * the wind is a side wind */
  tse_setting crosswind_coefficient;            /* [kg/m] 2.8, 0.1 .. 30; side force per wind times air
                                                 * speed */
  tse_setting crosswind_arm;                    /* [m] 0.45, -3 .. 3; centre of pressure before the centre
                                                 * of gravity */
  tse_setting conicity_front;                   /* [N] 0, -2000 .. 2000; side force of the front axle
                                                 * without slip */
  tse_setting conicity_rear;                    /* [N] 0, -2000 .. 2000; side force of the rear axle
                                                 * without slip */
  tse_setting aligning_moment_trail;            /* [m] 0.03, -0.2 .. 0.2; lateral forces act this far
                                                 * behind the axles */
  tse_setting imu_lever_arm_x;                  /* [m] 0, -4 .. 4; IMU before the centre of gravity */
  tse_setting imu_lever_arm_y;                  /* [m] 0, -2 .. 2; IMU left of the centre of gravity */
  tse_setting body_roll_gain;                   /* [rad s2/m] 0.006, -0.02 .. 0.04; roll angle per lateral
                                                 * acceleration */
  tse_setting body_roll_frequency;              /* [Hz] 1.6, 0.3 .. 6; natural frequency */
  tse_setting body_roll_damping;                /* [1] 0.3, 0.05 .. 2; damping ratio */
  tse_setting body_roll_height;                 /* [m] 0, -1 .. 1.5; IMU above the roll axis, less
                                                 * coupling: above the centre of gravity */
  tse_setting body_roll_coupling;               /* [m] 0.4, -0.5 .. 1; sprung mass over mass times height
                                                 * of its centre of gravity above the roll axis: it pushes
                                                 * the car */
  tse_setting pitch_leak_gain;                  /* [rad s2/m] 0, -0.01 .. 0.03; pitch angle per
                                                 * longitudinal acceleration, nose up > 0 */
  tse_setting pitch_leak_frequency;             /* [Hz] 1.8, 0.3 .. 6; natural frequency */
  tse_setting pitch_leak_damping;               /* [1] 0.4, 0.05 .. 2; damping ratio */
  tse_setting pitch_leak_height;                /* [m] 0, -1 .. 1.5; IMU above the pitch axis */
  tse_setting imu_misalignment_angle;           /* [rad] 0, -0.2 .. 0.2; IMU turned to the left > 0 */
  tse_setting imu_scale_ax_error;               /* [1] 0, -0.3 .. 0.3; reading over true, less one */
  tse_setting imu_scale_ay_error;               /* [1] 0, -0.3 .. 0.3; reading over true, less one */
  tse_setting gyro_scale_error;                 /* [1] 0, -0.3 .. 0.3; reading over true, less one */
  tse_setting imu_delay_time;                   /* [s] 0, 0 .. 0.2; readings are this much older than
                                                 * inputs */
  tse_setting formula_gain;                     /* [1] 0, -10 .. 10; times a formula of the user; 0: none */
  tse_setting formula_a;                        /* [1] 0, -1000000 .. 1000000; number a of the formula, in
                                                 * its own unit */
  tse_setting formula_b;                        /* [1] 0, -1000000 .. 1000000; number b of the formula, in
                                                 * its own unit */
  tse_setting formula_c;                        /* [1] 0, -1000000 .. 1000000; number c of the formula, in
                                                 * its own unit */
  tse_setting formula_d;                        /* [1] 0, -1000000 .. 1000000; number d of the formula, in
                                                 * its own unit */
  tse_setting formula_e;                        /* [1] 0, -1000000 .. 1000000; number e of the formula, in
                                                 * its own unit */
  tse_setting formula_f;                        /* [1] 0, -1000000 .. 1000000; number f of the formula, in
                                                 * its own unit */
  tse_setting formula_g;                        /* [1] 0, -1000000 .. 1000000; number g of the formula, in
                                                 * its own unit */
  tse_setting formula_h;                        /* [1] 0, -1000000 .. 1000000; number h of the formula, in
                                                 * its own unit */
  int32_t formula_place;                        /* 0, 0 .. 9; where it is added: code of a place */
  int32_t formula_code_1;                       /* 0, 0 .. 16777215; operations 1 .. 3 of the formula, a
                                                 * byte each, the lowest first */
  int32_t formula_code_2;                       /* 0, 0 .. 16777215; operations 4 .. 6 */
  int32_t formula_code_3;                       /* 0, 0 .. 16777215; operations 7 .. 9 */
  int32_t formula_code_4;                       /* 0, 0 .. 16777215; operations 10 .. 12 */
  int32_t formula_code_5;                       /* 0, 0 .. 16777215; operations 13 .. 15 */
  int32_t formula_code_6;                       /* 0, 0 .. 16777215; operations 16 .. 18 */
  int32_t formula_code_7;                       /* 0, 0 .. 16777215; operations 19 .. 21 */
  int32_t formula_code_8;                       /* 0, 0 .. 16777215; operations 22 .. 24 */
  int32_t formula_code_9;                       /* 0, 0 .. 16777215; operations 25 .. 27 */
  int32_t formula_code_10;                      /* 0, 0 .. 16777215; operations 28 .. 30 */
  int32_t formula_code_11;                      /* 0, 0 .. 16777215; operations 31 .. 33 */
  tse_setting sample_time;                      /* [s] 0.01, 0.001 .. 0.1; nominal time between rows */
  tse_setting forgetting;                       /* [1] 0.99, 0.9 .. 0.9999; lambda of (17) per nominal
                                                 * sample; memory 1/(1 - lambda) samples; paper's filter */
  tse_setting forgetting_mean;                  /* [1] 0, 0 .. 0.9999; lambda of the mean, of gamma in
                                                 * (17), per nominal sample; 0: forgetting (the paper);
                                                 * paper's filter */
  tse_setting forgetting_change;                /* [1] 1, 0.5 .. 1; what lambda of the mean falls to where
                                                 * innovations last, as after a change of road; 1: it does
                                                 * not (the paper); paper's filter */
  tse_setting resample_threshold;               /* [1] 0.5, 0 .. 1; resample when N_eff falls to this share
                                                 * of the particles; paper's filter */
  tse_setting initial_cx_front;                 /* [1] 1, 0.2 .. 4; start of the front longitudinal
                                                 * stiffness, share of nominal */
  tse_setting initial_cy_front;                 /* [1] 1, 0.2 .. 4; start of the front cornering stiffness,
                                                 * share of nominal */
  tse_setting initial_cy_rear;                  /* [1] 1, 0.2 .. 4; start of the rear cornering stiffness,
                                                 * share of nominal */
  tse_setting initial_mean_sd;                  /* [1] 0.3, 0 .. 2; how uncertain the start of the mean is:
                                                 * sqrt(gamma Sigma), relative to nominal; paper's filter */
  tse_setting initial_cx_sd;                    /* [1] 0.3, 0 .. 2; sd of the start of the longitudinal
                                                 * stiffness, relative; default filter */
  tse_setting initial_cy_front_sd;              /* [1] 0.25, 0 .. 2; sd of the start of the front cornering
                                                 * stiffness, relative; default filter */
  tse_setting initial_cy_rear_sd;               /* [1] 0.25, 0 .. 2; sd of the start of the rear cornering
                                                 * stiffness, relative; default filter */
  tse_setting grip;                             /* [1] 1, 0 .. 50; friction of the tyres at the start; 0:
                                                 * 1/tyre_saturation_inverse_friction, or tyres without an
                                                 * end where that is 0; of each axle by
                                                 * tyre_saturation_balance; default filter */
  tse_setting grip_sd;                          /* [1] 0.25, 0 .. 1; its sd, relative; default filter */
  tse_setting initial_spread;                   /* [1] 0.07, 0.01 .. 2; sample-to-sample sd assumed at the
                                                 * start: sqrt(Sigma), relative to nominal; paper's filter */
  tse_setting spread_max;                       /* [1] 2, 0.01 .. 2; the learnt spread is kept at or below
                                                 * this, relative to nominal: what exceeds it is sensor
                                                 * noise, not tyre; 2: no limit (the paper); paper's filter */
  tse_setting spread_kernel;                    /* [1] 0, 0 .. 0.5; Lambda of a particle that was resampled
                                                 * is scaled by a random factor of this relative sd and
                                                 * mean one, so that copies differ; 0: it is not (the
                                                 * paper); paper's filter */
  tse_setting initial_dof;                      /* [1] 7, 6 .. 1000; degrees of freedom nu at the start:
                                                 * samples' worth of trust in initial_spread; paper's
                                                 * filter */
  tse_setting learnt_floor;                     /* [1] 0.1, 0 .. 2; no mean stiffness learnt in an earlier
                                                 * drive is trusted more than this (sd, relative to
                                                 * nominal): the road may be another */
  tse_setting learnt_walk_day;                  /* [1/sqrt(day)] 0.02, 0 .. 1; random walk of a mean
                                                 * stiffness between drives, relative to nominal: wear,
                                                 * pressure, temperature, other tyres */
  tse_setting initial_vel_x;                    /* [m/s] 0, -70 .. 70; start of vel_x, used when
                                                 * initial_vel_x_from_wheels is 0; paper's filter */
  tse_setting initial_vel_x_sd;                 /* [m/s] 0.1, 0 .. 20; how uncertain the start of vel_x is;
                                                 * paper's filter */
  tse_setting initial_vel_y_sd;                 /* [m/s] 0.1, 0 .. 10; how uncertain the start of vel_y is
                                                 * (mean 0); paper's filter */
  tse_setting initial_yaw_rate_sd;              /* [rad/s] 0.01, 0 .. 2; how uncertain the start of
                                                 * yaw_rate is (mean: first sample, else 0); paper's filter */
  tse_setting stiffness_min;                    /* [1] 0.1, 0.02 .. 0.9; no stiffness falls below this
                                                 * share of nominal; paper's filter without reflect_draws:
                                                 * only at its start */
  tse_setting stiffness_max;                    /* [1] 5, 1.1 .. 20; no stiffness rises above this share of
                                                 * nominal */
  tse_setting hold_speed;                       /* [m/s] 3, 0.5 .. 20; below this wheel speed, and in
                                                 * reverse, statistics are held */
  tse_setting max_steer;                        /* [rad] 0.7, 0.05 .. 1.2; beyond this steering angle
                                                 * nothing is learnt */
  tse_setting max_slip;                         /* [1] 0.05, 0.01 .. 1; beyond this slip of an axle its
                                                 * wheels lock or spin; default filter */
  tse_setting noise_max;                        /* [1] 30, 1 .. 1000; what the sensors' sd as found may be
                                                 * over the setting's; 1: the settings are believed;
                                                 * default filter */
  tse_setting max_gap;                          /* [s] 0.25, 0.01 .. 1; longer gaps between rows restart
                                                 * the states */
  tse_setting valid_sd;                         /* [1] 0.1, 0.01 .. 1; a stiffness is valid up to this sd
                                                 * of the mean, relative to the mean (paper's filter: to
                                                 * nominal) */
  tse_setting steady_walk;                      /* [1/sqrt(s)] 0.0005, 0 .. 0.1; random walk of a stiffness
                                                 * that nothing changes, relative: wear, warmth; default
                                                 * filter */
  int32_t form;                                 /* TSE_DEFAULT_FORM, TSE_FIRST_FORM .. TSE_LAST_FORM; 0:
                                                 * the car's Kalman filter; 1: the paper's particle filter.
                                                 * 2, the same with a watchdog, is gone: see
                                                 * tse_config_robust() */
  tse_setting cg_height;                        /* [m] 0.55, 0 .. 3; height of the centre of gravity: load
                                                 * goes from axle to axle with the acceleration; default
                                                 * filter */
  int32_t wheel_signals;                        /* 2, 1 .. 2; 1: both wheel speeds are one signal, the
                                                 * speed of the vehicle, which does not show slip; default
                                                 * filter */
  int32_t driven_axle;                          /* 0, 0 .. 2; 0 both or unknown, 1 front, 2 rear: the other
                                                 * rolls freely while the car does not brake; default
                                                 * filter */
  int32_t particles;                            /* 500, 16 .. TSE_MAX_PARTICLES; particles in use; paper's
                                                 * filter */
  int32_t resampling;                           /* 0, 0 .. 3; 0 systematic, 1 stratified, 2 residual, 3
                                                 * multinomial; paper's filter */
  int32_t integration;                          /* 0, 0 .. 2; of (7) between rows: 0 Euler, inputs held
                                                 * (the paper); 1 second order, inputs linear; 2 second
                                                 * order, the steering angle held; paper's filter */
  int32_t reflect_draws;                        /* 0, 0 .. 1; 1: a draw of (25) below stiffness_min is
                                                 * reflected at it; 0: it is not (the paper); paper's
                                                 * filter */
  int32_t initial_vel_x_from_wheels;            /* 1, 0 .. 1; 1: vel_x starts at the mean of the wheel
                                                 * speeds; paper's filter */
  int32_t seed;                                 /* 1, 0 .. 2147483647; seed of the random numbers; paper's
                                                 * filter */
  // clang-format on: end of table
} tse_config;

/* Uncertain parameters of car and model: k of tse_uncertainty_sd(). */
enum {
  // clang-format off: table considered
  TSE_CONSIDER_MASS,
  TSE_CONSIDER_INERTIA,
  TSE_CONSIDER_CENTRE,
  TSE_CONSIDER_RATIO,
  TSE_CONSIDER_OFFSET,
  TSE_CONSIDER_SCALE,
  TSE_CONSIDER_WHEELS_LATE,
  TSE_CONSIDER_ACCEL_LATE,
  TSE_CONSIDER_RELAXATION,
  TSE_CONSIDER_LEAN,
  TSE_CONSIDER_GYRO,
  TSE_CONSIDER_TRAIL,
  TSE_CONSIDER_ROLL_STEER,
  TSE_CONSIDER_RADIUS,
  TSE_CONSIDER_MODEL,
  // clang-format on: end of table
  TSE_UNCERTAINTIES
};

#endif
