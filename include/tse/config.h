/* tse/config.h - settings, from the tables in src/tables.
 *
 * Each setting has a comment of this form: [unit] default, min .. max; meaning. The
 * library has two filters: the default filter, a Kalman filter, and the particle filter
 * of the paper by Berntorp and Di Cairano (cited in tse.h). The defaults of the settings
 * of the car describe an ordinary car. Settings that have no effect in the default filter
 * have the values in section IV of the paper as defaults. */
#ifndef TSE_CONFIG_H
#define TSE_CONFIG_H

#include <stdint.h>

#include "tse/real.h"

/* Values of setting `form`: 0 default Kalman filter, 1 paper's particle filter. */
#define TSE_FIRST_FORM 0
#define TSE_DEFAULT_FORM 0

/* A build with TSE_NO_PARTICLES does not contain the paper's filter. This saves at least
 * 12 kB of flash on a Cortex-M. tse_config_check() of such a build refuses form = 1. */
#if defined(TSE_NO_PARTICLES)
#define TSE_LAST_FORM 0
#else
#define TSE_LAST_FORM 1
#endif

/* Settings, in SI units. Fill the struct with tse_config_default(), then set the values
 * of your car, at least the mass. The settings mass, yaw_inertia and ..._stiffness_...
 * may also be 0, although their ranges do not include 0: 0 means "not set".
 *
 * Many settings are strengths of effects (src/tables/effects.toml). An effect is a
 * property of car, sensors or road that the plain single-track model leaves out. It is
 * off while all its strengths are 0. By default some effects that every car has are on
 * (body_roll_gain, relaxation_length ...), and all others are off. Column `filter` of
 * effects.toml states which filters use an effect. */
typedef struct tse_config {
  // clang-format off: table config_members
  tse_setting mass;                             /* [kg] 0, 50 .. 50000; mass of the car; 0: unknown, and no
                                                 * estimated stiffness becomes valid */
  tse_setting yaw_inertia;                      /* [kg m2] 0, 10 .. 1000000; yaw moment of inertia about
                                                 * the centre of gravity; 0: mass times lf times lr is used */
  tse_setting lf;                               /* [m] 1.25, 0.1 .. 10; distance from the centre of gravity
                                                 * to the front axle */
  tse_setting lr;                               /* [m] 1.5, 0.1 .. 10; distance from the centre of gravity
                                                 * to the rear axle */
  tse_setting wheel_radius_front;               /* [m] 0.33, 0.05 .. 2; effective rolling radius of the
                                                 * front wheels */
  tse_setting wheel_radius_rear;                /* [m] 0.33, 0.05 .. 2; effective rolling radius of the
                                                 * rear wheels */
  tse_setting longitudinal_stiffness_front;     /* [N] 0, 1000 .. 10000000; nominal longitudinal (slip)
                                                 * stiffness of the front axle; 0: typical value for the
                                                 * static axle load */
  tse_setting longitudinal_stiffness_rear;      /* [N] 0, 1000 .. 10000000; nominal longitudinal (slip)
                                                 * stiffness of the rear axle; 0: typical value for the
                                                 * static axle load */
  tse_setting cornering_stiffness_front;        /* [N/rad] 0, 1000 .. 10000000; nominal cornering stiffness
                                                 * of the front axle; 0: typical value for the static axle
                                                 * load */
  tse_setting cornering_stiffness_rear;         /* [N/rad] 0, 1000 .. 10000000; nominal cornering stiffness
                                                 * of the rear axle; 0: typical value for the static axle
                                                 * load */
  tse_setting rear_longitudinal_follows_front;  /* [1] 1, 0 .. 1; factor f: the longitudinal stiffness,
                                                 * relative to nominal, is w in front and 1 + f (w - 1) in
                                                 * the rear; no effect in the default filter */
  tse_setting mass_sd;                          /* [1] 0.05, 0 .. 0.5; relative sd of mass; an error of the
                                                 * mass is assumed to change the yaw inertia in the same
                                                 * ratio */
  tse_setting yaw_inertia_sd;                   /* [1] 0.1, 0 .. 0.5; relative sd of the ratio yaw_inertia
                                                 * / mass */
  tse_setting cg_sd;                            /* [m] 0.03, 0 .. 1; sd of the longitudinal position of the
                                                 * centre of gravity */
  tse_setting steer_ratio_sd;                   /* [1] 0.03, 0 .. 0.5; relative sd of the scale factor of
                                                 * steer_angle, due to errors of the steering ratio and to
                                                 * compliance of the steering */
  tse_setting steer_offset_sd;                  /* [rad] 0.006, 0 .. 0.1; sd of a constant offset of
                                                 * steer_angle */
  tse_setting accel_y_scale_sd;                 /* [1] 0.03, 0 .. 0.5; relative sd of the scale factor of
                                                 * accel_y, including the effect of an error of
                                                 * body_roll_gain: body roll adds gravity to accel_y in
                                                 * proportion to the lateral acceleration, as a scale error
                                                 * does */
  tse_setting wheel_delay_sd;                   /* [s] 0.02, 0 .. 0.2; sd of the delay of the wheel speeds
                                                 * relative to the IMU */
  tse_setting accel_delay_sd;                   /* [s] 0.003, 0 .. 0.2; sd of the delay of the
                                                 * accelerometers relative to the gyro */
  tse_setting relaxation_sd;                    /* [m] 0.2, 0 .. 2; sd of the relaxation length of each
                                                 * axle */
  tse_setting lean_sd;                          /* [1] 0.1, 0 .. 0.5; sd of bank_superelevation, the share
                                                 * of the lateral acceleration that the bank of a curve
                                                 * provides; the share differs from road to road */
  tse_setting gyro_scale_sd;                    /* [1] 0.01, 0 .. 0.2; relative sd of the scale factor of
                                                 * yaw_rate */
  tse_setting trail_sd;                         /* [m] 0.03, 0 .. 0.2; sd of aligning_moment_trail, the
                                                 * distance behind an axle at which its lateral force acts */
  tse_setting roll_steer_sd;                    /* [1] 0.04, 0 .. 0.5; sd of rear_roll_steer_gain, the
                                                 * ratio of the steering angle of the rear wheels to the
                                                 * roll angle */
  tse_setting wheel_radius_sd;                  /* [1] 0.005, 0 .. 0.2; relative sd of the ratio of the
                                                 * rear to the front wheel radius */
  tse_setting model_sd;                         /* [1] 0.12, 0 .. 0.5; sd of the discrepancy of an IMU
                                                 * channel, i.e. of the part of the signal that the model
                                                 * does not explain, divided by the recent rms of the
                                                 * signal; the correlation time of the discrepancy is 1 s */
  tse_setting grade_sd;                         /* [rad] 0.03, 0 .. 0.3; sd of the road grade about its
                                                 * mean, the setting grade_angle; the filter estimates the
                                                 * grade as a state, because gravity along the road
                                                 * accelerates the car without a contribution to accel_x */
  tse_setting accel_x_sd;                       /* [m/s2] 0.1, 0.001 .. 10; noise sd of one sample of
                                                 * accel_x */
  tse_setting accel_y_sd;                       /* [m/s2] 0.1, 0.001 .. 10; noise sd of one sample of
                                                 * accel_y */
  tse_setting yaw_rate_sd;                      /* [rad/s] 0.0025, 1e-05 .. 1; noise sd of one sample of
                                                 * yaw_rate */
  tse_setting wheel_noise_sd;                   /* [rad/s] 0.04, 0 .. 5; noise sd of one sample of a wheel
                                                 * speed (mean of the two wheels of an axle); no effect in
                                                 * the paper's filter */
  tse_setting steer_lag_sd;                     /* [s] 0.025, 0 .. 0.2; sd of the delay of the steering
                                                 * angle relative to the IMU, caused by bus, steering and
                                                 * tyres; 0: the delay is known exactly; no effect in the
                                                 * paper's filter */
  tse_setting accel_x_bias_sd;                  /* [m/s2] 0.2, 0 .. 5; sd of the bias of accel_x at the
                                                 * start */
  tse_setting accel_y_bias_sd;                  /* [m/s2] 0.2, 0 .. 5; sd of the bias of accel_y at the
                                                 * start */
  tse_setting yaw_rate_bias_sd;                 /* [rad/s] 0.01, 0 .. 0.5; sd of the bias of yaw_rate at
                                                 * the start */
  tse_setting accel_x_bias_walk;                /* [m/s2/sqrt(s)] 0.002, 0 .. 1; sd of the change of the
                                                 * accel_x bias in 1 s; the bias is a random walk,
                                                 * equations (8) and (18) of the paper */
  tse_setting accel_y_bias_walk;                /* [m/s2/sqrt(s)] 0.002, 0 .. 1; sd of the change of the
                                                 * accel_y bias in 1 s; the bias is a random walk,
                                                 * equations (8) and (18) of the paper */
  tse_setting yaw_rate_bias_walk;               /* [rad/s/sqrt(s)] 0.0001, 0 .. 0.1; sd of the change of
                                                 * the yaw_rate bias in 1 s; the bias is a random walk,
                                                 * equations (8) and (18) of the paper */
  tse_setting steer_angle_latency;              /* [s] 0, -0.2 .. 0.2; latency of steer_angle in the log
                                                 * relative to yaw_rate; negative: steer_angle is logged
                                                 * earlier than a yaw rate that was measured at the same
                                                 * time */
  tse_setting wheel_speed_front_latency;        /* [s] 0, -0.2 .. 0.2; latency of wheel_speed_front in the
                                                 * log relative to yaw_rate */
  tse_setting wheel_speed_rear_latency;         /* [s] 0, -0.2 .. 0.2; latency of wheel_speed_rear in the
                                                 * log relative to yaw_rate */
  tse_setting accel_x_latency;                  /* [s] 0, -0.2 .. 0.2; latency of accel_x in the log
                                                 * relative to yaw_rate */
  tse_setting accel_y_latency;                  /* [s] 0, -0.2 .. 0.2; latency of accel_y in the log
                                                 * relative to yaw_rate */
  tse_setting ins_velocity_sd;                  /* [m/s] 0.1, 0.001 .. 10; initial value of the noise sd of
                                                 * one value of ins_vel_x or ins_vel_y; the filter
                                                 * estimates this noise sd */
  tse_setting gnss_speed_sd;                    /* [m/s] 0.1, 0.001 .. 10; initial value of the noise sd of
                                                 * one value of gnss_speed; the filter estimates this noise
                                                 * sd */
  tse_setting gnss_course_sd;                   /* [rad] 0.01, 0.0001 .. 1; initial value of the noise sd
                                                 * of one value of gnss_course above 10 m/s; the filter
                                                 * estimates this noise sd; below 10 m/s, the noise sd is
                                                 * inversely proportional to the speed */
  tse_setting velocity_latency;                 /* [s] 0, -0.2 .. 0.2; latency of measured velocities
                                                 * relative to yaw_rate */
  tse_setting velocity_latency_sd;              /* [s] 0.03, 0 .. 0.2; sd of velocity_latency */
  tse_setting velocity_lever_x;                 /* [m] 0, -20 .. 20; position of the antenna, or of the
                                                 * reference point of the INS, in front of the centre of
                                                 * gravity */
  tse_setting velocity_lever_y;                 /* [m] 0, -20 .. 20; position of the antenna, or of the
                                                 * reference point of the INS, to the left of the centre of
                                                 * gravity */
  tse_setting velocity_lever_sd;                /* [m] 0.1, 0 .. 5; sd of velocity_lever_x and of
                                                 * velocity_lever_y */
  tse_setting velocity_heading;                 /* [rad] 0, -0.5 .. 0.5; angle from the axes of the car to
                                                 * those of the INS; positive: the INS is turned to the
                                                 * left */
  tse_setting velocity_heading_sd;              /* [rad] 0.02, 0 .. 0.5; sd of velocity_heading */
  tse_setting velocity_scale_sd;                /* [1] 0.02, 0 .. 0.2; relative sd of the ratio of a
                                                 * measured speed to the speed computed from the wheel
                                                 * speeds; wrong wheel radii change this ratio */
  tse_setting wheel_torque_least;               /* [Nm] 60, 1 .. 2000; an axle whose |torque| is smaller
                                                 * than this limit counts as rolling freely; recommended:
                                                 * twice the sd of offset and noise of the torque signal */
  tse_setting road_sd;                          /* [rad] 0.005, 0 .. 0.3; sd of the error of bank and
                                                 * grade, if the log row contains them; the default is
                                                 * about the difference between bank or grade estimates
                                                 * from different laps of one road */
  tse_setting mass_change;                      /* [1] 0, -0.5 .. 1; true mass / setting - 1 */
  tse_setting yaw_inertia_change;               /* [1] 0, -0.5 .. 1; true yaw inertia / setting - 1 */
  tse_setting cg_shift_distance;                /* [m] 0, -0.6 .. 0.6; distance that is added to lf and
                                                 * subtracted from lr, limited so that lf and lr stay at
                                                 * least a tenth of their settings */
  tse_setting wheel_radius_change;              /* [1] 0, -0.1 .. 0.1; true rolling radius / setting - 1,
                                                 * the same for both axles */
  tse_setting steering_ratio_change;            /* [1] 0, -0.3 .. 0.3; true road-wheel angle / logged angle
                                                 * - 1 */
  tse_setting steering_offset_angle;            /* [rad] 0, -0.05 .. 0.05; true road-wheel angle minus
                                                 * logged angle */
  tse_setting steering_delay_time;              /* [s] 0, 0 .. 0.2; delay from the logged angle to the
                                                 * wheels */
  tse_setting steering_lag_time;                /* [s] 0.02, 0 .. 0.5; sum of the time constants of two
                                                 * first-order lags in series from the logged angle to the
                                                 * wheels */
  tse_setting steering_lag_second;              /* [1] 0, 0 .. 1; time constant of the second lag / time
                                                 * constant of the first lag; 0: one lag only */
  tse_setting exact_kinematics_share;           /* [1] 1, 0 .. 1; 0: equations (1) to (4) of the paper,
                                                 * with small angles; 1: exact equations; in between:
                                                 * linear interpolation */
  tse_setting steering_compliance_angle_per_moment; /* [rad/(N m)] 0, 0 .. 0.001; decrease of the road-
                                                     * wheel angle / moment of the front lateral force
                                                     * about the steering axis */
  tse_setting steering_compliance_trail;        /* [m] 0.03, 0.001 .. 0.2; lever arm of the lateral force
                                                 * about the steering axis */
  tse_setting rear_roll_steer_gain;             /* [1] 0, -0.5 .. 0.5; ratio of the steering angle of the
                                                 * rear wheels to the roll angle; positive: roll turns the
                                                 * rear wheels into the curve */
  tse_setting rear_roll_steer_roll;             /* [rad s2/m] 0.0075, 0.0005 .. 0.03; roll angle / lateral
                                                 * acceleration */
  tse_setting rear_roll_steer_frequency;        /* [Hz] 1.5, 0.3 .. 6; natural frequency of the roll */
  tse_setting rear_roll_steer_damping;          /* [1] 0.3, 0.05 .. 2; damping ratio of the roll */
  tse_setting relaxation_length;                /* [m] 0.4, 0 .. 3; relaxation length of the lateral force:
                                                 * after a step, the slip angle reaches 63 % of its final
                                                 * value over this distance */
  tse_setting longitudinal_relaxation_length;   /* [m] 0, 0 .. 2; relaxation length of the longitudinal
                                                 * force: after a step, the slip reaches 63 % of its final
                                                 * value over this distance */
  tse_setting stiffness_drift_change;           /* [1] 0, -0.6 .. 1; relative change of all stiffnesses at
                                                 * the end of a drift that is linear in time */
  tse_setting stiffness_drift_time;             /* [s] 600, 0.001 .. 36000; duration of the drift of all
                                                 * stiffnesses; a short duration makes the drift a step */
  tse_setting stiffness_drift_start;            /* [s] 0, 0 .. 36000; time from the first row to the
                                                 * beginning of the drift of all stiffnesses */
  tse_setting combined_slip_factor;             /* [1] 0, 0 .. 2000; k: the lateral force of an axle is
                                                 * multiplied by 1/sqrt(1 + k s^2), where s is the
                                                 * longitudinal slip of this axle */
  tse_setting tyre_saturation_inverse_friction; /* [1] 0, 0 .. 5; 1/friction coefficient: load of an axle /
                                                 * max lateral force of this axle; 0: no saturation */
  tse_setting tyre_saturation_shape;            /* [1] 1, 0 .. 1; 0: brush model with parabolic pressure
                                                 * distribution; 1: magic-formula tyre, which saturates
                                                 * later and more abruptly than the brush model; in
                                                 * between: linear interpolation */
  tse_setting tyre_saturation_balance;          /* [1] 0, -0.5 .. 0.5; 1/friction is multiplied by 1 +
                                                 * balance in front and by 1 - balance in the rear;
                                                 * positive: the front axle saturates first */
  tse_setting longitudinal_load_transfer_gain;  /* [s2/m] 0.02, -0.08 .. 0.08; k in the cornering stiffness
                                                 * Cf (1 - k ax) of the front axle and Cr (1 + k ax) of the
                                                 * rear axle; ax: acceleration by the longitudinal tyre
                                                 * forces */
  tse_setting longitudinal_load_transfer_balance; /* [1] 0, -1 .. 1; the gain k of the load transfer is
                                                   * multiplied by 1 + balance in front and by 1 - balance
                                                   * in the rear; negative if the front axle has the higher
                                                   * load: the load transfer is then a smaller share of its
                                                   * load */
  tse_setting lateral_load_transfer_gain;       /* [s4/m2] 0.002, -0.003 .. 0.03; k in the cornering
                                                 * stiffness C (1 - k accel_y^2) of both axles */
  tse_setting lateral_load_transfer_balance;    /* [1] 0, -1 .. 1; the gain k of the load transfer is
                                                 * multiplied by 1 + balance in front and by 1 - balance in
                                                 * the rear; positive if the front axle takes the larger
                                                 * part of the roll moment */
  tse_setting aero_drag_coefficient;            /* [kg/m] 0.4, 0 .. 5; force / speed squared: 1/2 rho cd A */
  tse_setting rolling_resistance_coefficient;   /* [1] 0.01, 0 .. 0.2; force against the motion / weight */
  tse_setting grade_angle;                      /* [rad] 0, -0.35 .. 0.35; grade of the road, positive
                                                 * uphill; if a log row contains a grade, simulator and
                                                 * replay use the sum of this setting and that grade, and
                                                 * the filter uses that grade alone */
  tse_setting bank_angle;                       /* [rad] 0, -0.35 .. 0.35; bank of the road, positive if
                                                 * the left side is higher; if a log row contains a bank,
                                                 * simulator and replay use the sum of this setting and
                                                 * that bank, and the filter uses that bank alone, without
                                                 * bank_superelevation */
  tse_setting bank_superelevation;              /* [1] 0.1, -0.5 .. 0.5; share of the lateral acceleration
                                                 * in a curve (speed times yaw rate) that the bank of the
                                                 * road provides */
  tse_setting crosswind_speed;                  /* [m/s] 0, -30 .. 30; speed of a steady wind; positive:
                                                 * with crosswind_heading = 0 it pushes the car to the left
                                                 * at the start */
  tse_setting crosswind_heading;                /* [rad] 0, -3.2 .. 3.2; heading of the car at the start,
                                                 * relative to the heading at which the wind is a pure side
                                                 * wind */
  tse_setting crosswind_coefficient;            /* [kg/m] 2.8, 0.1 .. 30; c in the side force c w sqrt(v^2
                                                 * + w^2) of a pure side wind of speed w on a car of speed
                                                 * v */
  tse_setting crosswind_arm;                    /* [m] 0.45, -3 .. 3; distance of the centre of pressure in
                                                 * front of the centre of gravity */
  tse_setting conicity_front;                   /* [N] 0, -2000 .. 2000; lateral force of the front axle at
                                                 * zero slip angle, positive left */
  tse_setting conicity_rear;                    /* [N] 0, -2000 .. 2000; lateral force of the rear axle at
                                                 * zero slip angle, positive left */
  tse_setting aligning_moment_trail;            /* [m] 0.03, -0.2 .. 0.2; distance behind an axle at which
                                                 * its lateral force acts */
  tse_setting imu_lever_arm_x;                  /* [m] 0, -4 .. 4; position of the IMU in front of the
                                                 * centre of gravity */
  tse_setting imu_lever_arm_y;                  /* [m] 0, -2 .. 2; position of the IMU to the left of the
                                                 * centre of gravity */
  tse_setting body_roll_gain;                   /* [rad s2/m] 0.006, -0.02 .. 0.04; roll angle / lateral
                                                 * acceleration; positive: the body leans out of the curve */
  tse_setting body_roll_frequency;              /* [Hz] 1.6, 0.3 .. 6; natural frequency of the roll */
  tse_setting body_roll_damping;                /* [1] 0.3, 0.05 .. 2; damping ratio of the roll */
  tse_setting body_roll_height;                 /* [m] 0, -1 .. 1.5; height of the IMU above the roll axis
                                                 * minus body_roll_coupling, i.e. about the height of the
                                                 * IMU above the centre of gravity */
  tse_setting body_roll_coupling;               /* [m] 0.4, -0.5 .. 1; (sprung mass / mass of the car)
                                                 * times (height of the centre of gravity of the sprung
                                                 * mass above the roll axis); this length times the roll
                                                 * acceleration is added to the lateral acceleration of the
                                                 * car */
  tse_setting pitch_leak_gain;                  /* [rad s2/m] 0, -0.01 .. 0.03; pitch angle / longitudinal
                                                 * acceleration, positive: the nose rises when the car
                                                 * accelerates */
  tse_setting pitch_leak_frequency;             /* [Hz] 1.8, 0.3 .. 6; natural frequency of the pitch */
  tse_setting pitch_leak_damping;               /* [1] 0.4, 0.05 .. 2; damping ratio of the pitch */
  tse_setting pitch_leak_height;                /* [m] 0, -1 .. 1.5; height of the IMU above the pitch axis */
  tse_setting imu_misalignment_angle;           /* [rad] 0, -0.2 .. 0.2; angle from the axes of the car to
                                                 * those of the IMU; positive: the IMU is turned to the
                                                 * left */
  tse_setting imu_scale_ax_error;               /* [1] 0, -0.3 .. 0.3; reading of accel_x / true value - 1 */
  tse_setting imu_scale_ay_error;               /* [1] 0, -0.3 .. 0.3; reading of accel_y / true value - 1 */
  tse_setting gyro_scale_error;                 /* [1] 0, -0.3 .. 0.3; reading of yaw_rate / true value - 1 */
  tse_setting imu_delay_time;                   /* [s] 0, 0 .. 0.2; delay of the readings of accelerometers
                                                 * and gyro relative to steering angle and wheel speeds */
  tse_setting formula_gain;                     /* [1] 0, -10 .. 10; factor of the value of the user's
                                                 * formula, a term that is added to the vehicle model; 0:
                                                 * no formula */
  tse_setting formula_a;                        /* [1] 0, -1000000 .. 1000000; constant a of the user's
                                                 * formula; its unit is not 1 but the one that the formula
                                                 * requires */
  tse_setting formula_b;                        /* [1] 0, -1000000 .. 1000000; constant b of the user's
                                                 * formula; its unit is not 1 but the one that the formula
                                                 * requires */
  tse_setting formula_c;                        /* [1] 0, -1000000 .. 1000000; constant c of the user's
                                                 * formula; its unit is not 1 but the one that the formula
                                                 * requires */
  tse_setting formula_d;                        /* [1] 0, -1000000 .. 1000000; constant d of the user's
                                                 * formula; its unit is not 1 but the one that the formula
                                                 * requires */
  tse_setting formula_e;                        /* [1] 0, -1000000 .. 1000000; constant e of the user's
                                                 * formula; its unit is not 1 but the one that the formula
                                                 * requires */
  tse_setting formula_f;                        /* [1] 0, -1000000 .. 1000000; constant f of the user's
                                                 * formula; its unit is not 1 but the one that the formula
                                                 * requires */
  tse_setting formula_g;                        /* [1] 0, -1000000 .. 1000000; constant g of the user's
                                                 * formula; its unit is not 1 but the one that the formula
                                                 * requires */
  tse_setting formula_h;                        /* [1] 0, -1000000 .. 1000000; constant h of the user's
                                                 * formula; its unit is not 1 but the one that the formula
                                                 * requires */
  int32_t formula_place;                        /* 0, 0 .. 9; quantity of the vehicle model to which the
                                                 * value of the user's formula is added, from 0, slip angle
                                                 * of the front axle, to 9, reading of the gyro ([place] in
                                                 * src/tables/formula.toml) */
  int32_t formula_code_1;                       /* 0, 0 .. 16777215; operations 1 .. 3 of the user's
                                                 * formula, one byte each, operation 1 in the lowest byte */
  int32_t formula_code_2;                       /* 0, 0 .. 16777215; operations 4 .. 6 of the user's
                                                 * formula */
  int32_t formula_code_3;                       /* 0, 0 .. 16777215; operations 7 .. 9 of the user's
                                                 * formula */
  int32_t formula_code_4;                       /* 0, 0 .. 16777215; operations 10 .. 12 of the user's
                                                 * formula */
  int32_t formula_code_5;                       /* 0, 0 .. 16777215; operations 13 .. 15 of the user's
                                                 * formula */
  int32_t formula_code_6;                       /* 0, 0 .. 16777215; operations 16 .. 18 of the user's
                                                 * formula */
  int32_t formula_code_7;                       /* 0, 0 .. 16777215; operations 19 .. 21 of the user's
                                                 * formula */
  int32_t formula_code_8;                       /* 0, 0 .. 16777215; operations 22 .. 24 of the user's
                                                 * formula */
  int32_t formula_code_9;                       /* 0, 0 .. 16777215; operations 25 .. 27 of the user's
                                                 * formula */
  int32_t formula_code_10;                      /* 0, 0 .. 16777215; operations 28 .. 30 of the user's
                                                 * formula */
  int32_t formula_code_11;                      /* 0, 0 .. 16777215; operations 31 .. 33 of the user's
                                                 * formula */
  tse_setting sample_time;                      /* [s] 0.01, 0.001 .. 0.1; nominal time between rows */
  tse_setting forgetting;                       /* [1] 0.99, 0.9 .. 0.9999; forgetting factor lambda of
                                                 * equation (17) of the paper per sample_time; the memory
                                                 * is 1/(1 - lambda) samples; no effect in the default
                                                 * filter */
  tse_setting forgetting_mean;                  /* [1] 0, 0 .. 0.9999; forgetting factor, per sample_time,
                                                 * of the mean of the stiffness: gamma is divided by this
                                                 * factor in equation (17) of the paper; 0 .. 0.5: the
                                                 * setting forgetting is used (the paper); no effect in the
                                                 * default filter */
  tse_setting forgetting_change;                /* [1] 1, 0.5 .. 1; min forgetting factor of the mean
                                                 * stiffness; while innovations are correlated, for example
                                                 * after a change of the road surface, the forgetting
                                                 * factor is reduced down to this min; 1: no reduction (the
                                                 * paper); no effect in the default filter */
  tse_setting resample_threshold;               /* [1] 0.5, 0 .. 1; resample when the effective number of
                                                 * particles N_eff falls to this share of all particles; no
                                                 * effect in the default filter */
  tse_setting initial_cx_front;                 /* [1] 1, 0.2 .. 4; initial front longitudinal stiffness,
                                                 * relative to nominal */
  tse_setting initial_cy_front;                 /* [1] 1, 0.2 .. 4; initial front cornering stiffness,
                                                 * relative to nominal */
  tse_setting initial_cy_rear;                  /* [1] 1, 0.2 .. 4; initial rear cornering stiffness,
                                                 * relative to nominal */
  tse_setting initial_mean_sd;                  /* [1] 0.3, 0 .. 2; sd of the initial mean of a stiffness /
                                                 * nominal stiffness; sqrt(gamma Sigma) in the symbols of
                                                 * the paper; no effect in the default filter */
  tse_setting initial_cx_sd;                    /* [1] 0.3, 0 .. 2; relative sd of the initial longitudinal
                                                 * stiffness; no effect in the paper's filter */
  tse_setting initial_cy_front_sd;              /* [1] 0.25, 0 .. 2; relative sd of the initial front
                                                 * cornering stiffness; no effect in the paper's filter */
  tse_setting initial_cy_rear_sd;               /* [1] 0.25, 0 .. 2; relative sd of the initial rear
                                                 * cornering stiffness; no effect in the paper's filter */
  tse_setting grip;                             /* [1] 1, 0 .. 50; initial friction coefficient mu of the
                                                 * tyres: mu/(1 + b) in front and mu/(1 - b) in the rear,
                                                 * where b is tyre_saturation_balance; 0: mu is
                                                 * 1/tyre_saturation_inverse_friction; if both settings are
                                                 * 0, the tyres do not saturate; no effect in the paper's
                                                 * filter */
  tse_setting grip_sd;                          /* [1] 0.25, 0 .. 1; relative sd of grip; no effect in the
                                                 * paper's filter */
  tse_setting initial_spread;                   /* [1] 0.07, 0.01 .. 2; initial sample-to-sample sd of a
                                                 * stiffness, relative to nominal: sqrt(Sigma); no effect
                                                 * in the default filter */
  tse_setting spread_max;                       /* [1] 2, 0.01 .. 2; max estimated sample-to-sample sd of a
                                                 * stiffness, relative to nominal; a larger estimate would
                                                 * be due to sensor noise; 2: no limit (the paper); no
                                                 * effect in the default filter */
  tse_setting spread_kernel;                    /* [1] 0, 0 .. 0.5; relative sd of a random factor of mean
                                                 * 1. This factor multiplies the scale matrix Lambda of the
                                                 * stiffness covariance of each particle after resampling,
                                                 * so that copies of a particle differ; 0: no factor (the
                                                 * paper); no effect in the default filter */
  tse_setting initial_dof;                      /* [1] 7, 6 .. 1000; initial degrees of freedom nu:
                                                 * initial_spread has the weight of this many samples; no
                                                 * effect in the default filter */
  tse_setting learnt_floor;                     /* [1] 0.1, 0 .. 2; min sd of a mean stiffness that is
                                                 * loaded from an earlier drive, relative to nominal,
                                                 * because the road surface may have changed since */
  tse_setting learnt_walk_day;                  /* [1/sqrt(day)] 0.02, 0 .. 1; random walk of a mean
                                                 * stiffness between drives: sd of its change in one day,
                                                 * relative to nominal, caused by wear, pressure,
                                                 * temperature, other tyres */
  tse_setting initial_vel_x;                    /* [m/s] 0, -70 .. 70; initial vel_x if
                                                 * initial_vel_x_from_wheels is 0; no effect in the default
                                                 * filter */
  tse_setting initial_vel_x_sd;                 /* [m/s] 0.1, 0 .. 20; sd of the initial vel_x; no effect
                                                 * in the default filter */
  tse_setting initial_vel_y_sd;                 /* [m/s] 0.1, 0 .. 10; sd of the initial vel_y, whose mean
                                                 * is 0; no effect in the default filter */
  tse_setting initial_yaw_rate_sd;              /* [rad/s] 0.01, 0 .. 2; sd of the initial yaw rate; its
                                                 * mean is the first sample of yaw_rate, or 0 if this
                                                 * sample is missing; no effect in the default filter */
  tse_setting stiffness_min;                    /* [1] 0.1, 0.02 .. 0.9; min stiffness, relative to
                                                 * nominal; in the paper's filter with reflect_draws = 0,
                                                 * this limit applies only to the initial stiffness */
  tse_setting stiffness_max;                    /* [1] 5, 1.1 .. 20; max stiffness, relative to nominal */
  tse_setting hold_speed;                       /* [m/s] 3, 0.5 .. 20; min wheel speed for learning; below
                                                 * it, and in reverse, stiffness is not updated */
  tse_setting max_steer;                        /* [rad] 0.7, 0.05 .. 1.2; max steering angle for learning;
                                                 * beyond it, stiffness is not updated */
  tse_setting max_slip;                         /* [1] 0.05, 0.01 .. 1; max slip of an axle whose wheels
                                                 * neither lock nor spin; above this limit, the filter
                                                 * reports that wheels slide; no effect in the paper's
                                                 * filter */
  tse_setting noise_max;                        /* [1] 30, 1 .. 1000; max ratio of the estimated noise sd
                                                 * of a sensor to its setting; a larger estimate is limited
                                                 * to this ratio; no effect in the paper's filter */
  tse_setting max_gap;                          /* [s] 0.25, 0.01 .. 1; max time between rows; after a
                                                 * longer gap, velocities and yaw rate are initialised from
                                                 * the sensors again */
  tse_setting valid_sd;                         /* [1] 0.1, 0.01 .. 1; max sd of a valid stiffness,
                                                 * relative to its mean (paper's filter: relative to
                                                 * nominal) */
  tse_setting steady_walk;                      /* [1/sqrt(s)] 0.0005, 0 .. 0.1; sd of the relative change
                                                 * of a stiffness in 1 s by wear and temperature (random
                                                 * walk); abrupt changes of road or tyres are modelled
                                                 * separately; no effect in the paper's filter */
  int32_t form;                                 /* TSE_DEFAULT_FORM, TSE_FIRST_FORM .. TSE_LAST_FORM;
                                                 * filter: 0 the default Kalman filter, 1 the paper's
                                                 * particle filter; form 2 of older versions is now
                                                 * tse_config_robust() */
  tse_setting cg_height;                        /* [m] 0.55, 0 .. 3; height of the centre of gravity, for
                                                 * the load transfer between the axles; no effect in the
                                                 * paper's filter */
  int32_t wheel_signals;                        /* 2, 1 .. 2; 1: both wheel speed channels carry the same
                                                 * signal, the speed of the vehicle, from which no slip can
                                                 * be estimated; 2: the channels carry two signals, unless
                                                 * the filter finds that both signals are equal; no effect
                                                 * in the paper's filter */
  int32_t driven_axle;                          /* 0, 0 .. 2; driven axle: 0 both or unknown, 1 front, 2
                                                 * rear; with 1 or 2, the filter assumes that the axle that
                                                 * is not driven rolls freely while the car does not brake;
                                                 * no effect in the paper's filter */
  int32_t particles;                            /* 500, 16 .. TSE_MAX_PARTICLES; number of particles; no
                                                 * effect in the default filter */
  int32_t resampling;                           /* 0, 0 .. 3; method of resampling: 0 systematic, 1
                                                 * stratified, 2 residual, 3 multinomial; no effect in the
                                                 * default filter */
  int32_t integration;                          /* 0, 0 .. 2; integration of equation (7) of the paper
                                                 * between rows: 0 Euler's method with the inputs of the
                                                 * previous row (the paper), 1 a second-order method with
                                                 * inputs that change linearly from row to row, 2 as 1, but
                                                 * with the steering angle of the previous row; no effect
                                                 * in the default filter */
  int32_t reflect_draws;                        /* 0, 0 .. 1; 1: a stiffness that is drawn below
                                                 * stiffness_min in equation (25) of the paper is reflected
                                                 * at stiffness_min; 0: the stiffness is used as drawn (the
                                                 * paper); no effect in the default filter */
  int32_t initial_vel_x_from_wheels;            /* 1, 0 .. 1; 1: the initial vel_x is wheel speed times
                                                 * wheel radius, mean of both axles, in the first row; 0:
                                                 * the initial vel_x is the setting initial_vel_x; no
                                                 * effect in the default filter */
  int32_t seed;                                 /* 1, 0 .. 2147483647; seed of the random numbers; no
                                                 * effect in the default filter */
  // clang-format on: end of table
} tse_config;

/* Uncertain parameters of the car and of its model: values of the argument k of
 * tse_uncertainty_sd(). */
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
