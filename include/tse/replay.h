/* tse/replay.h - replay of a log: the vehicle model, driven by the steering angle and the
 * wheel speeds of the log, predicts accelerations, yaw rate, velocities and wheel
 * torques.
 *
 * The replay is deterministic: stiffness and biases are constant, and there is no
 * noise. The settings switch the effects of src/tables/effects.toml on. A fit of vehicle
 * parameters calls the replay thousands of times and compares the predicted with the
 * logged channels. As in tse/tse.h, the caller owns all memory, and several threads may
 * replay at once. */
#ifndef TSE_REPLAY_H
#define TSE_REPLAY_H

#include "tse/tse.h"

#define tse_replay_start_default TSE_NAME(tse_replay_start_default)
#define tse_replay               TSE_NAME(tse_replay)

#ifdef __cplusplus
extern "C" {
#endif

/* The log: arrays of `rows` values each. */
typedef struct tse_replay_log {
  // clang-format off: table replay_log_members
  const tse_real *dt;                 /* [s] time since the previous row, (0, 1]; not used in the first row */
  const tse_real *steer_angle;        /* [rad] logged mean road-wheel angle of the front axle, positive
                                       * left, -1.2 .. 1.2 */
  const tse_real *wheel_speed_front;  /* [rad/s] mean rotation rate of the front wheels, -400 .. 400 */
  const tse_real *wheel_speed_rear;   /* [rad/s] mean rotation rate of the rear wheels, -400 .. 400 */
  const tse_real *grade;              /* [rad] or NULL; grade of the road, positive uphill, added to the
                                       * setting grade_angle */
  const tse_real *bank;               /* [rad] or NULL; bank of the road, positive if the left side is
                                       * higher, added to the setting bank_angle */
  const tse_real *slip_front;         /* [rad] or NULL; disturbance that is added to the front slip angle;
                                       * positive: lateral tyre force to the left */
  const tse_real *slip_rear;          /* [rad] or NULL; disturbance that is added to the rear slip angle;
                                       * positive: lateral tyre force to the left */
  const tse_real *force_x;            /* [m/s2] or NULL; disturbing force / mass, positive forward, for
                                       * example of wind. As a tyre force does, it accelerates the car, and
                                       * accel_x measures it */
  const tse_real *force_y;            /* [m/s2] or NULL; disturbing force / mass, positive left, for
                                       * example of wind. As a tyre force does, it accelerates the car, and
                                       * accel_y measures it */
  const tse_real *yaw_accel;          /* [rad/s2] or NULL; disturbing yaw moment / yaw inertia, positive
                                       * left */
  // clang-format on: end of table
} tse_replay_log;

/* Constants and initial state of a replay. The comments give: [unit] default; meaning. */
typedef struct tse_replay_start {
  // clang-format off: table replay_start_members
  tse_real cx_front;             /* [1] 1; front longitudinal stiffness, relative to nominal. The rear
                                  * longitudinal stiffness, relative to nominal, is 1 + f (cx_front - 1),
                                  * where f is the setting rear_longitudinal_follows_front */
  tse_real cy_front;             /* [1] 1; front cornering stiffness, relative to nominal */
  tse_real cy_rear;              /* [1] 1; rear cornering stiffness, relative to nominal */
  tse_real bias_accel_x;         /* [m/s2] 0; bias of accel_x */
  tse_real bias_accel_y;         /* [m/s2] 0; bias of accel_y */
  tse_real bias_yaw_rate;        /* [rad/s] 0; bias of yaw_rate */
  tse_real vel_x_from_wheels;    /* [1] 1; not 0: the initial vel_x is wheel speed times wheel radius, mean
                                  * of both axles, in the first row */
  tse_real vel_x;                /* [m/s] 0; initial vel_x if vel_x_from_wheels is 0 */
  tse_real vel_y;                /* [m/s] 0; initial vel_y */
  tse_real yaw_rate;             /* [rad/s] 0; initial yaw rate */
  tse_real time;                 /* [s] 0; time at the first row; used by the effect stiffness_drift */
  tse_real heading;              /* [rad] 0; heading at the first row; used by the effect crosswind */
  tse_real wheel_inertia_front;  /* [kg m2] 2.4; rotational inertia of both front wheels; used for output
                                  * wheel_torque_front */
  tse_real wheel_inertia_rear;   /* [kg m2] 2.4; rotational inertia of both rear wheels; used for output
                                  * wheel_torque_rear */
  // clang-format on: end of table
} tse_replay_start;

/* Results of a replay: arrays of `rows` values each, or NULL for results that are not
 * needed. */
typedef struct tse_replay_out {
  // clang-format off: table replay_out_members
  tse_real *accel_x;             /* [m/s2] reading of accel_x, with bias and without noise */
  tse_real *accel_y;             /* [m/s2] reading of accel_y, with bias and without noise */
  tse_real *yaw_rate;            /* [rad/s] reading of yaw_rate, with bias and without noise */
  tse_real *vel_x;               /* [m/s] longitudinal velocity of the centre of gravity */
  tse_real *vel_y;               /* [m/s] lateral velocity of the centre of gravity */
  tse_real *true_yaw_rate;       /* [rad/s] true yaw rate of the car */
  tse_real *wheel_torque_front;  /* [Nm] drive torque minus brake torque of both front wheels: longitudinal
                                  * tyre force times wheel radius, plus wheel_inertia_front times the
                                  * angular acceleration of the logged wheel speed */
  tse_real *wheel_torque_rear;   /* [Nm] drive torque minus brake torque of both rear wheels: longitudinal
                                  * tyre force times wheel radius, plus wheel_inertia_rear times the
                                  * angular acceleration of the logged wheel speed */
  // clang-format on: end of table
} tse_replay_out;

/* Fill s with the defaults.   s NULL: no effect. */
void tse_replay_start_default(tse_replay_start *s);

/* Replay a whole log. Between two rows the inputs change linearly. The model is
 * integrated in substeps, as many as the paper's filter uses (vehicle_steps() in
 * src/model/vehicle.h).
 *   Given:     p    from tse_prepare(). The effects that its settings switch on act
 *              log  arrays of `rows` finite values
 *              s    constants and initial state
 *   Updated:   out  motion and sensor readings at each row. The log and s are checked
 *                   first: out is unchanged if one of their values is wrong. If the
 *                   motion overflows later, the rows before the overflow are filled
 *   Returned:  TSE_OK, TSE_E_NULL, TSE_E_STATE (p is not from tse_prepare()), TSE_E_TIME
 *              (dt of a row is not in (0, 1] s), or TSE_E_INPUT: another value of the log
 *              is out of range, a value of the log or of s is not finite, or the motion
 *              overflows. With TSE_E_TIME and TSE_E_INPUT, *wrong (if wrong is not NULL)
 *              is the index of the wrong row, or of the row in which the motion
 *              overflows. If a value of s is wrong, *wrong is 0, as for the first row
 *   Cost:      two evaluations of the model for each substep, because the integration
 *              method has two stages; 0.1 us a row without effects
 *   Source:    equations (1) to (4) and (7), src/EQUATIONS.md */
tse_status tse_replay(const tse_params *p, const tse_replay_log *log, int32_t rows, const tse_replay_start *s,
    const tse_replay_out *out, int32_t *wrong);

#ifdef __cplusplus
}
#endif
#endif
