/* tse/simulate.h - simulator for studies: the single-track model driven by wheel torques,
 * with wheel dynamics at 1 ms or finer, random stiffness in every row, sensor noise and
 * drifting biases. With `friction` tyre forces saturate, and wheels lock and spin.
 * Effects of src/tables/effects.toml are on if the vehicle's settings switch them on.
 * Rules as in tse/tse.h: the caller owns the memory, no globals, no pointers in the
 * state. */
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

/* Settings of the simulator: unit, default, least .. most; meaning. */
typedef struct tse_sim_config {
  // clang-format off: table sim_members
  tse_setting wheel_inertia_front;              /* [kg m2] 2.4, 0.05 .. 500; rotational inertia of both
                                                 * front wheels */
  tse_setting wheel_inertia_rear;               /* [kg m2] 2.4, 0.05 .. 500; rotational inertia of both
                                                 * rear wheels */
  tse_setting true_cx_front;                    /* [1] 1, 0.02 .. 10; mean longitudinal stiffness, share of
                                                 * nominal (rear follows as the settings say) */
  tse_setting true_cy_front;                    /* [1] 1, 0.02 .. 10; mean front cornering stiffness, share
                                                 * of nominal */
  tse_setting true_cy_rear;                     /* [1] 1, 0.02 .. 10; mean rear cornering stiffness, share
                                                 * of nominal */
  tse_setting spread_cx_front;                  /* [1] 0.05, 0 .. 0.3; sample-to-sample sd of the
                                                 * stiffness, share of its mean */
  tse_setting spread_cy_front;                  /* [1] 0.05, 0 .. 0.3; sample-to-sample sd of the
                                                 * stiffness, share of its mean */
  tse_setting spread_cy_rear;                   /* [1] 0.05, 0 .. 0.3; sample-to-sample sd of the
                                                 * stiffness, share of its mean */
  tse_setting noise;                            /* [1] 1, 0 .. 100; true sensor noise over the sd in the
                                                 * settings */
  tse_setting steer_angle_sd;                   /* [rad] 0, 0 .. 0.1; noise of the logged steering angle */
  tse_setting wheel_speed_sd;                   /* [rad/s] 0, 0 .. 10; noise of the logged wheel speeds */
  tse_setting true_bias_accel_x;                /* [m/s2] 0, -5 .. 5; accel_x bias at the start */
  tse_setting true_bias_accel_y;                /* [m/s2] 0, -5 .. 5; accel_y bias at the start */
  tse_setting true_bias_yaw_rate;               /* [rad/s] 0, -0.5 .. 0.5; yaw_rate bias at the start */
  tse_setting bias_walk;                        /* [1] 0, 0 .. 100; random walk of the true biases over the
                                                 * walk in the settings */
  tse_setting speed;                            /* [m/s] 20, 0 .. 70; vel_x at the start; wheels roll
                                                 * freely */
  tse_setting vel_y;                            /* [m/s] 0, -20 .. 20; vel_y at the start: above 0 the car
                                                 * slides to the left */
  tse_setting friction;                         /* [1] 0, 0 .. 2; friction coefficient at which the tyre
                                                 * forces of an axle saturate; 0: linear tyres */
  tse_setting substep;                          /* [s] 0.001, 0.0001 .. 0.005; longest integration step */
  int32_t hold_inputs;                          /* 0, 0 .. 1; 1: the driver's inputs are held from row to
                                                 * row; 0: they change linearly between rows */
  int32_t seed;                                 /* 1, 0 .. 2147483647; seed of the random numbers */
  // clang-format on: end of table
} tse_sim_config;

/* Inputs of the driver at this row. Between rows they are linear, or held with `hold_inputs`. Road
 * level and friction are held until the next row. */
typedef struct tse_sim_input {
  tse_real dt; /* [s] (0, 1]; time since the previous row; ignored at the first row */
  // clang-format off: table sim_input_members
  tse_real steer_angle;        /* [rad] 0, -1.2 .. 1.2; road-wheel angle of the front axle, positive left */
  tse_real wheel_torque_front; /* [Nm] 0, -100000 .. 100000; drive torque of the front axle; negative turns
                                * the wheels backwards */
  tse_real wheel_torque_rear;  /* [Nm] 0, -100000 .. 100000; drive torque of the rear axle; negative turns
                                * the wheels backwards */
  tse_real brake_torque_front; /* [Nm] 0, 0 .. 100000; brake torque of the front axle, against the
                                * rotation; holds at standstill */
  tse_real brake_torque_rear;  /* [Nm] 0, 0 .. 100000; brake torque of the rear axle, against the rotation;
                                * holds at standstill */
  tse_real road_level;         /* [1] 1, 0.02 .. 10; stiffness of all tyres relative to dry road */
  tse_real road_friction;      /* [1] 0, 0 .. 2; friction coefficient at which the tyre forces of an axle
                                * saturate; 0: that of the settings */
  tse_real bank;               /* [rad] 0, -0.35 .. 0.35; bank of the road, left side high > 0, besides the
                                * setting bank_angle */
  tse_real grade;              /* [rad] 0, -0.35 .. 0.35; slope of the road, uphill > 0, besides the
                                * setting grade_angle */
  // clang-format on: end of table
} tse_sim_input;

typedef struct tse_sim_output {
  tse_input row; /* the row that the car logs */
  // clang-format off: table sim_output_members
  tse_real vel_x;               /* [m/s] longitudinal velocity of the centre of gravity */
  tse_real vel_y;               /* [m/s] lateral velocity of the centre of gravity */
  tse_real yaw_rate;            /* [rad/s] yaw rate */
  tse_real accel_x;             /* [m/s2] specific force with the stiffness drawn for this row, without
                                 * noise and bias */
  tse_real accel_y;             /* [m/s2] specific force with the stiffness drawn for this row, without
                                 * noise and bias */
  tse_real wheel_speed_front;   /* [rad/s] rotation rate of the front wheels */
  tse_real wheel_speed_rear;    /* [rad/s] rotation rate of the rear wheels */
  tse_real stiffness[3];        /* [1] mean stiffness now, relative to nominal */
  tse_real drawn[3];            /* [1] stiffness drawn for this row, relative to nominal */
  tse_real bias[3];             /* [m/s2 m/s2 rad/s] bias of accel_x, accel_y, yaw_rate */
  // clang-format on: end of table
} tse_sim_output;

/* A simulation, allocated by the caller as in tse/state.h. */
typedef struct tse_sim_bytes {
  tse_real first;
  unsigned char rest[sizeof(tse_sim_config) + 134 * sizeof(tse_real) + 24 + 6 * TSE_PADDING];
} tse_sim_bytes;

typedef struct tse_sim tse_sim;
#if !defined(TSE_INTERNALS)
struct tse_sim {
  tse_params_bytes params;
  tse_sim_input last; /* inputs of the last row; fmu/SingleTrackVehicle, which holds inputs, sets it */
  tse_sim_bytes bytes;
};
#endif

/* Fill s with the defaults.   s NULL: no effect. */
void tse_sim_config_default(tse_sim_config *s);

/* Check the simulator's settings as tse_config_check() does. */
tse_status tse_sim_config_check(const tse_sim_config *s, const char **wrong);

/* Start a simulation.
 *   Updated:   sim  unchanged if the result is negative
 *   Returned:  as tse_config_check() */
tse_status tse_sim_reset(tse_sim *sim, const tse_config *c, const tse_sim_config *s, const char **wrong);

/* Advance to the next row and log it. The first call logs the start without advancing.
 *   Returned:  y  logged row and truth
 *              TSE_OK, TSE_E_NULL, TSE_E_TIME, or TSE_E_INPUT: an input is out of range, or drives the
 *              car beyond 1000 m/s or 200 rad/s; nothing has changed then
 *   Cost:      2 dt/substep evaluations of the model */
tse_status tse_sim_step(tse_sim *sim, const tse_sim_input *u, tse_sim_output *y);

/* Check a copied simulation before it goes on, as tse_filter_check() does.
 *   Returned:  TSE_OK, TSE_E_NULL, TSE_E_CONFIG, or TSE_E_STATE: a value is outside its range, or it
 *              belongs to other settings */
tse_status tse_sim_check(const tse_sim *sim, const tse_config *c, const tse_sim_config *s);

#ifdef __cplusplus
}
#endif
#endif
