/* tse/simulate.h - simulator for studies: a single-track model that is driven
 * by wheel torques.
 *
 * The motion and the wheel speeds are integrated in steps of at most `substep`. In every
 * row, each stiffness is drawn at random about its mean (settings true_... and
 * spread_...). The sensors have noise, and biases that drift. If the setting `friction`
 * or the input `road_friction` is not 0, tyre forces saturate, so that wheels can lock
 * and spin. The settings of the vehicle switch the effects of src/tables/effects.toml on.
 * As in tse/tse.h, the caller owns the memory, there are no globals, and the state holds
 * no pointers. */
#ifndef TSE_SIMULATE_H
#define TSE_SIMULATE_H

#include "tse/tse.h"

#define tse_sim_config_default TSE_NAME(tse_sim_config_default)
#define tse_sim_config_check   TSE_NAME(tse_sim_config_check)
#define tse_sim_reset          TSE_NAME(tse_sim_reset)
#define tse_sim_step           TSE_NAME(tse_sim_step)
#define tse_sim_check          TSE_NAME(tse_sim_check)

#ifdef __cplusplus
extern "C" {
#endif

/* Settings of the simulator. The comments give: [unit] default, min .. max; meaning. */
typedef struct tse_sim_config {
  // clang-format off: table sim_members
  tse_setting wheel_inertia_front;              /* [kg m2] 2.4, 0.05 .. 500; rotational inertia of both
                                                 * front wheels */
  tse_setting wheel_inertia_rear;               /* [kg m2] 2.4, 0.05 .. 500; rotational inertia of both
                                                 * rear wheels */
  tse_setting true_cx_front;                    /* [1] 1, 0.02 .. 10; mean over time of the front
                                                 * longitudinal stiffness, relative to nominal. The rear
                                                 * longitudinal stiffness, relative to nominal, is 1 + f
                                                 * (true_cx_front - 1), where f is the setting
                                                 * rear_longitudinal_follows_front */
  tse_setting true_cy_front;                    /* [1] 1, 0.02 .. 10; mean over time of the front cornering
                                                 * stiffness, relative to nominal */
  tse_setting true_cy_rear;                     /* [1] 1, 0.02 .. 10; mean over time of the rear cornering
                                                 * stiffness, relative to nominal */
  tse_setting spread_cx_front;                  /* [1] 0.05, 0 .. 0.3; sd of the front longitudinal
                                                 * stiffness about its mean, relative to this mean; drawn
                                                 * anew in each row */
  tse_setting spread_cy_front;                  /* [1] 0.05, 0 .. 0.3; sd of the front cornering stiffness
                                                 * about its mean, relative to this mean; drawn anew in
                                                 * each row */
  tse_setting spread_cy_rear;                   /* [1] 0.05, 0 .. 0.3; sd of the rear cornering stiffness
                                                 * about its mean, relative to this mean; drawn anew in
                                                 * each row */
  tse_setting noise;                            /* [1] 1, 0 .. 100; factor on the noise sds of the IMU in
                                                 * the vehicle settings (accel_x_sd, accel_y_sd,
                                                 * yaw_rate_sd); 1: the simulated noise has these sds */
  tse_setting steer_angle_sd;                   /* [rad] 0, 0 .. 0.1; noise sd of the logged steering angle */
  tse_setting wheel_speed_sd;                   /* [rad/s] 0, 0 .. 10; noise sd of the logged wheel speeds */
  tse_setting true_bias_accel_x;                /* [m/s2] 0, -5 .. 5; accel_x bias at the start */
  tse_setting true_bias_accel_y;                /* [m/s2] 0, -5 .. 5; accel_y bias at the start */
  tse_setting true_bias_yaw_rate;               /* [rad/s] 0, -0.5 .. 0.5; yaw_rate bias at the start */
  tse_setting bias_walk;                        /* [1] 0, 0 .. 100; factor on the sds of the random walks
                                                 * of the biases in the vehicle settings (accel_x_bias_walk
                                                 * ...); 0: the simulated biases are constant */
  tse_setting speed;                            /* [m/s] 20, 0 .. 70; vel_x at the start; the wheels then
                                                 * roll freely */
  tse_setting vel_y;                            /* [m/s] 0, -20 .. 20; vel_y at the start; positive: the
                                                 * car slides to the left */
  tse_setting friction;                         /* [1] 0, 0 .. 2; friction coefficient at which the tyre
                                                 * forces of an axle saturate; 0: linear tyres */
  tse_setting substep;                          /* [s] 0.001, 0.0001 .. 0.005; max step of the integration */
  int32_t hold_inputs;                          /* 0, 0 .. 1; 1: the inputs of a row stay constant until
                                                 * the next row; 0: the inputs change linearly from row to
                                                 * row */
  int32_t seed;                                 /* 1, 0 .. 2147483647; seed of the random numbers */
  // clang-format on: end of table
} tse_sim_config;

/* Inputs of driver and road at a row. The comments give: [unit] default, min .. max;
 * meaning. Until the next row the inputs change linearly to those of the next row or, if
 * the setting hold_inputs is 1, stay constant. road_level and road_friction always stay
 * constant until the next row. */
typedef struct tse_sim_input {
  tse_real dt; /* [s] (0, 1]; time since the previous row; ignored at the first row */
  // clang-format off: table sim_input_members
  tse_real steer_angle;        /* [rad] 0, -1.2 .. 1.2; road-wheel angle of the front axle, positive left */
  tse_real wheel_torque_front; /* [Nm] 0, -100000 .. 100000; drive torque of the front axle, positive
                                * forward; unlike a brake torque, a negative drive torque can make the
                                * wheels rotate backwards */
  tse_real wheel_torque_rear;  /* [Nm] 0, -100000 .. 100000; drive torque of the rear axle, positive
                                * forward; unlike a brake torque, a negative drive torque can make the
                                * wheels rotate backwards */
  tse_real brake_torque_front; /* [Nm] 0, 0 .. 100000; brake torque of the front axle; it opposes the
                                * rotation and holds the wheels at standstill */
  tse_real brake_torque_rear;  /* [Nm] 0, 0 .. 100000; brake torque of the rear axle; it opposes the
                                * rotation and holds the wheels at standstill */
  tse_real road_level;         /* [1] 1, 0.02 .. 10; factor by which this road surface changes the mean
                                * stiffness of all tyres; 1: dry road */
  tse_real road_friction;      /* [1] 0, 0 .. 2; friction coefficient at which the tyre forces of an axle
                                * saturate; 0: value of the setting friction */
  tse_real bank;               /* [rad] 0, -0.35 .. 0.35; bank of the road, positive if the left side is
                                * higher, added to the setting bank_angle */
  tse_real grade;              /* [rad] 0, -0.35 .. 0.35; grade of the road, positive uphill, added to the
                                * setting grade_angle */
  // clang-format on: end of table
} tse_sim_input;

/* The log row of the simulated car, and the true values at this row. */
typedef struct tse_sim_output {
  tse_input row; /* row of the log, with noise and biases */
  // clang-format off: table sim_output_members
  tse_real vel_x;               /* [m/s] longitudinal velocity of the centre of gravity */
  tse_real vel_y;               /* [m/s] lateral velocity of the centre of gravity */
  tse_real yaw_rate;            /* [rad/s] yaw rate */
  tse_real accel_x;             /* [m/s2] longitudinal specific force with the stiffness drawn for this
                                 * row, without noise and bias */
  tse_real accel_y;             /* [m/s2] lateral specific force with the stiffness drawn for this row,
                                 * without noise and bias */
  tse_real wheel_speed_front;   /* [rad/s] rotation rate of the front wheels */
  tse_real wheel_speed_rear;    /* [rad/s] rotation rate of the rear wheels */
  tse_real stiffness[3];        /* [1] true mean stiffness at this row, relative to nominal, in the order
                                 * cx_front, cy_front, cy_rear: mean of the distribution from which `drawn`
                                 * is drawn */
  tse_real drawn[3];            /* [1] true stiffness of this row, relative to nominal, drawn at random
                                 * about `stiffness` */
  tse_real bias[3];             /* [m/s2 m/s2 rad/s] bias of accel_x, accel_y, yaw_rate */
  // clang-format on: end of table
} tse_sim_output;

/* Storage for the internal members of tse_sim. */
typedef struct tse_sim_bytes {
  tse_real first;
  unsigned char rest[sizeof(tse_sim_config) + 134 * sizeof(tse_real) + 24 + 6 * TSE_PADDING];
} tse_sim_bytes;

/* State of a simulation. The caller allocates it, like the structs of tse/state.h. */
typedef struct tse_sim tse_sim;
#if !defined(TSE_INTERNALS)
struct tse_sim {
  tse_params_bytes params;
  /* inputs of the last row, from which the inputs of the next step start.
   * fmu/SingleTrackVehicle with ramp = 0 overwrites them before a step: the inputs then
   * jump at the start of the step */
  tse_sim_input last;
  tse_sim_bytes bytes;
};
#endif

/* Fill s with the default settings.   s NULL: no effect. */
void tse_sim_config_default(tse_sim_config *s);

/* Check that each setting of the simulator is in its range.
 *   Returned:  TSE_OK, TSE_E_NULL or TSE_E_CONFIG. With TSE_E_CONFIG, *wrong (if
 *              wrong is not NULL) points to the name of the first wrong setting,
 *              a string constant */
tse_status tse_sim_config_check(const tse_sim_config *s, const char **wrong);

/* Start a simulation of the vehicle in c, with the settings s of the simulator.
 *   Updated:   sim  unchanged if the result is negative
 *   Returned:  status of tse_prepare() for c or, if it is not negative, of
 *              tse_sim_config_check() for s. *wrong (if wrong is not NULL) then names the
 *              wrong setting of c or of s */
tse_status tse_sim_reset(tse_sim *sim, const tse_config *c, const tse_sim_config *s, const char **wrong);

/* Advance to the next row and log it. The first call logs the initial state and
 * does not advance.
 *   Updated:   sim  unchanged if the result is negative
 *   Returned:  y    row of the log and true values; unchanged if the result is negative
 *              TSE_OK, TSE_E_NULL, TSE_E_TIME, or TSE_E_INPUT: an input is out of range,
 *              or the motion exceeds a limit: velocity 1000 m/s, yaw rate 200 rad/s,
 *              wheel speed 1e7 rad/s, or the range of the number format
 *   Cost:      2 dt/substep evaluations of the model: two for each substep, because the
 *              integration method has two stages */
tse_status tse_sim_step(tse_sim *sim, const tse_sim_input *u, tse_sim_output *y);

/* Check a struct tse_sim that was copied from a file or from another program.
 * tse_sim_step() does not check the contents of sim.
 *   Given:     c, s  the settings with which the simulation was started
 *   Returned:  TSE_OK, TSE_E_NULL, TSE_E_CONFIG (c or s is wrong), or TSE_E_STATE: sim
 *              belongs to other settings, or one of its values is out of range */
tse_status tse_sim_check(const tse_sim *sim, const tse_config *c, const tse_sim_config *s);

#ifdef __cplusplus
}
#endif
#endif
