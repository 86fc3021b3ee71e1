/* tse/replay.h - simulate the other channels of a log from its steering angle and wheel
 * speeds.
 *
 * Deterministic: constant stiffness and biases, no noise, effects of
 * src/tables/effects.toml as the settings switch them on. For fits, which call it
 * thousands of times. Rules as in tse/tse.h. */
#ifndef TSE_REPLAY_H
#define TSE_REPLAY_H

#include "tse/tse.h"

#define tse_replay_start_default TSE_NAME(tse_replay_start_default)
#define tse_replay               TSE_NAME(tse_replay)

#ifdef __cplusplus
extern "C" {
#endif

/* Arrays of `rows` values. */
typedef struct tse_replay_log {
  // clang-format off: table replay_log_members
  const tse_real *dt;                 /* [s] time since the row before, (0, 1]; not used in the first row */
  const tse_real *steer_angle;        /* [rad] mean road-wheel angle as logged, -1.2 .. 1.2 */
  const tse_real *wheel_speed_front;  /* [rad/s] mean rotation rate of the front wheels, -400 .. 400 */
  const tse_real *wheel_speed_rear;   /* [rad/s] mean rotation rate of the rear wheels, -400 .. 400 */
  const tse_real *grade;              /* [rad] or NULL; profile of the road, uphill > 0, besides the
                                       * setting grade_angle */
  const tse_real *bank;               /* [rad] or NULL; profile of the road, left side high > 0, besides
                                       * the setting bank_angle */
  const tse_real *slip_front;         /* [rad] or NULL; disturbance of the front slip angle */
  const tse_real *slip_rear;          /* [rad] or NULL; disturbance of the rear slip angle */
  const tse_real *force_x;            /* [m/s2] or NULL; disturbing force over mass, forward, seen by the
                                       * accelerometer */
  const tse_real *force_y;            /* [m/s2] or NULL; disturbing force over mass, to the left, seen by
                                       * the accelerometer */
  const tse_real *yaw_accel;          /* [rad/s2] or NULL; disturbing yaw moment over inertia */
  // clang-format on: end of table
} tse_replay_log;

typedef struct tse_replay_start {
  // clang-format off: table replay_start_members
  tse_real cx_front;             /* [1] 1; longitudinal stiffness, share of nominal (rear follows as the
                                  * settings say) */
  tse_real cy_front;             /* [1] 1; front cornering stiffness, share of nominal */
  tse_real cy_rear;              /* [1] 1; rear cornering stiffness, share of nominal */
  tse_real bias_accel_x;         /* [m/s2] 0; bias of accel_x */
  tse_real bias_accel_y;         /* [m/s2] 0; bias of accel_y */
  tse_real bias_yaw_rate;        /* [rad/s] 0; bias of yaw_rate */
  tse_real vel_x_from_wheels;    /* [1] 1; not 0: vel_x starts at the mean of the wheel speeds */
  tse_real vel_x;                /* [m/s] 0; start of vel_x, when not from the wheels */
  tse_real vel_y;                /* [m/s] 0; start of vel_y */
  tse_real yaw_rate;             /* [rad/s] 0; start of the yaw rate */
  tse_real time;                 /* [s] 0; clock of stiffness_drift at the first row */
  tse_real heading;              /* [rad] 0; heading at the first row, for crosswind */
  tse_real wheel_inertia_front;  /* [kg m2] 2.4; rotational inertia of both front wheels, for
                                  * wheel_torque_front */
  tse_real wheel_inertia_rear;   /* [kg m2] 2.4; rotational inertia of both rear wheels, for
                                  * wheel_torque_rear */
  // clang-format on: end of table
} tse_replay_start;

typedef struct tse_replay_out {
  // clang-format off: table replay_out_members
  tse_real *accel_x;             /* [m/s2] as the IMU reads it, bias included, no noise */
  tse_real *accel_y;             /* [m/s2] as the IMU reads it, bias included, no noise */
  tse_real *yaw_rate;            /* [rad/s] as the IMU reads it, bias included, no noise */
  tse_real *vel_x;               /* [m/s] longitudinal velocity of the centre of gravity */
  tse_real *vel_y;               /* [m/s] lateral velocity of the centre of gravity */
  tse_real *true_yaw_rate;       /* [rad/s] yaw rate of the car */
  tse_real *wheel_torque_front;  /* [Nm] drive minus brake torque that the front wheels need: slip force
                                  * times radius, and inertia */
  tse_real *wheel_torque_rear;   /* [Nm] drive minus brake torque that the rear wheels need */
  // clang-format on: end of table
} tse_replay_out;

/* Fill s with the defaults.   s NULL: no effect. */
void tse_replay_start_default(tse_replay_start *s);

/* Run a whole log. Inputs are linear between rows. Substeps as in the estimator (vehicle_steps() in
 * src/model/vehicle.h).
 *   Given:     p    from tse_prepare(), with its effects
 *              log  arrays of `rows` finite values
 *              s    stiffness, biases, start
 *   Updated:   out  motion and sensors at each row; unchanged if a row is refused; up to the row
 *                   before, if the motion overflows
 *   Returned:  TSE_OK; TSE_E_NULL; TSE_E_STATE (p not prepared); TSE_E_TIME or TSE_E_INPUT: row *wrong
 *              (if not NULL) is out of range. TSE_E_INPUT also if the start (row 0) or a profile is not
 *              finite, or if the motion overflows
 *   Cost:      two evaluations of the model a row: 0.1 us without effects
 *   Source:    (1)-(4), (7), src/EQUATIONS.md */
tse_status tse_replay(const tse_params *p, const tse_replay_log *log, int32_t rows, const tse_replay_start *s,
    const tse_replay_out *out, int32_t *wrong);

#ifdef __cplusplus
}
#endif
#endif
