/* model/car.h - the car: one model of an ordinary car, with its slopes.
 *
 * Axles are single wheels. Kinematics are exact; the slip angle of each axle relaxes over a length; the slip of each axle is a state,
 * so that wheel speeds are measurements; tyres have a stiffness at no slip and a grip at which the force ends; the body rolls. The
 * steering angle is the only input. Forces are over mass. ISO 8855 axes, slip > 0 when it drives, slip angle > 0 when it pushes left.
 *
 *   vx' = a_x + vy r - g_x           a_x = (X_f cos d - Y_f sin d + X_r)/m - drag vx^2 - rolling      g_x: gravity along the road
 *   vy' = a_y - vx r + g_y + lean vx r + c phi''        a_y = (Y_f cos d + X_f sin d + Y_r)/m
 *   r'  = (lf (Y_f cos d + X_f sin d) - lr Y_r)/I
 *   sigma af' = v (d - atan((vy + lf r)/v) - af)        sigma ar' = v (-atan((vy - lr r)/v) - ar)
 *   phi'' = w^2 (k a_y - phi) - 2 zeta w phi'
 *   d = (1 + gain) (steer - lateness steer') + offset
 *   w_f R_f = (vx cos d + (vy + lf r) sin d)(1 + s_f)(1 + rad)(1 - give h a_x/(9.81 lr))      w_r R_r = vx (1 + s_r)(1 + give h a_x/(9.81 lf))
 * Tyre: with X = C_x s and q = |X|/(grip load) its force is X c(q), along and across alike and each for itself; c = 1 - q/3 + q^2/27 up to
 * q = 3, then 1/q (brush model), mixed with 1/sqrt(1 + q^2). That one direction takes of the other's force is left out: with it the errors
 * of the longitudinal model pulled the grip, and with it the cornering stiffness, by 10 % and more (tests/cars). */
#ifndef TSE_CAR_H
#define TSE_CAR_H

#include "tse/filter_state.h"
#include "model/laws.h"

#define car_forces  TSE_NAME(tse_car_forces)
#define car_move    TSE_NAME(tse_car_move)
#define car_rates   TSE_NAME(tse_car_rates)
#define car_pitch   TSE_NAME(tse_car_pitch)
#define car_measure TSE_NAME(tse_car_measure)

/* The state x. Motion comes first: its rows are the only ones of the transition that are not diagonal. */
enum {
  VX, VY, YAW, AF, AR, PHI, DPHI, /* [m/s] [m/s] [rad/s], slip angles [rad], roll angle [rad] and rate [rad/s] */
  SF, SR,                         /* [1] slip of each axle */
  GX, GY,                         /* [m/s2] gravity along the road, and across */
  BX, BY, BR,                     /* [m/s2] [m/s2] [rad/s] biases */
  LCX, LCF, LCR, LMU,             /* [1] logarithm of stiffness over nominal: longitudinal, front, rear cornering; of grip */
  OFF, GAIN, LATE, RAD, LEAN,     /* [rad] steering offset, [1] error of the steering ratio, [s] lateness of the steering, [1] of the front radius,
                                     [1] share of v r that roads lean into their curves */
  STATES
};
enum { MOTION = SF, FAST = BX }; /* states before these: in motion; with noise in every row */

/* Beside the state, quantities that are no state and uncertain: columns of the slopes after it. */
enum { BY_INERTIA = STATES, BY_CENTRE, BY_MOMENT, BY_LENGTH_FRONT, BY_LENGTH_REAR, BY_ROLL_STEER, COLUMNS };

/* What the sensors measure, in the order of every array of TSE_SENSORS. The first are the IMU's. */
enum { ACCEL_X, ACCEL_Y, YAW_RATE, WHEEL_FRONT, WHEEL_REAR, IMU_CHANNELS = WHEEL_FRONT };

/* The steering angle through a row: from .. to, rad; dt, s. */
typedef struct steering { tse_real from, to, dt; } steering;

/* Specific forces, yaw acceleration, and their slopes over the state at this time. */
typedef struct forces {
  tse_real x, y, yaw;                              /* [m/s2] [m/s2] [rad/s2] */
  tse_real by_x[COLUMNS], by_y[COLUMNS], by_yaw[COLUMNS];
  tse_real sin_d, cos_d, steer, rate;              /* of the road-wheel angle d; logged angle [rad] and its rate [rad/s] */
  tse_real side;                                   /* [m/s2] front axle's lateral force */
} forces;

/* Forces at x. share: of the row's steering, 0 .. 1. O(1) time. */
void car_forces(const tse_car *c, const tse_real x[STATES], steering u, tse_real share, forces *f);

/* Move x through the row u and find the transition of the motion.
 *   Updated:   x
 *   Returned:  M[MOTION][COLUMNS]  slopes of the motion at the end over state and uncertain quantities at the start, SI units
 *   O(substeps) time, at most TSE_SUBSTEPS. */
void car_move(const tse_car *c, tse_real x[STATES], steering u, tse_real M[MOTION][COLUMNS]);

/* How fast speeds along and across and the yaw rate change at x. f: car_forces() there.
 *   Returned:  rate[3]  [m/s2] [m/s2] [rad/s2]     by[3][COLUMNS]  their slopes */
void car_rates(const tse_car *c, const tse_real x[STATES], const forces *f, tse_real rate[3], tse_real by[3][COLUMNS]);

/* The body's pitch, as the acceleration that it follows: pitch[0], and its rate.
 *   Updated:  pitch  from the row before to a_x = ax, dt later      Returned: [m/s2] what accel_x reads of it */
tse_real car_pitch(const tse_car *c, tse_real pitch[2], tse_real ax, tse_real dt);

/* What the sensors read at x. f: car_forces() there, at the end of the row. pitch: from car_pitch(), or 0.
 *   Returned:  z[TSE_SENSORS]  accel_x, accel_y [m/s2], yaw_rate [rad/s], wheel speeds front, rear times radius [m/s]
 *              H[TSE_SENSORS][COLUMNS]  their slopes */
void car_measure(const tse_car *c, const tse_real x[STATES], const forces *f, tse_real pitch, tse_real z[TSE_SENSORS], tse_real H[TSE_SENSORS][COLUMNS]);

#endif
