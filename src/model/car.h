/* model/car.h - the model of the car in the default filter (a Kalman filter), with its
 * partial derivatives.
 *
 * Each axle is one wheel. Kinematics are exact, without small-angle approximations. The
 * slip angle of each axle builds up over the relaxation length. The slip of each axle is
 * a state, so that wheel speeds are measurements. A tyre force is proportional to the
 * slip if the slip is small, and limited by the grip if it is large. The body rolls. The
 * steering angle is the only input. Forces are divided by the mass of the car. Axes are
 * those of ISO 8855. Slip is positive if the tyre drives the car forward. A slip angle is
 * positive if its lateral force points to the left.
 *
 * The equations follow in the order of car.c. Names are those of the members of tse_car
 * (state.h), and those of the states below in lower case. Other symbols:
 *   i              axle. Two signs, as in 1 -+ x, mean 1 - x for the front axle and
 *                  1 + x for the rear axle
 *   s, a           slip and slip angle of an axle
 *   X_f, Y_f       longitudinal and lateral force of the front axle, in the axes of its
 *                  wheels; X_r, Y_r the same of the rear axle
 *   d              road-wheel angle of the front axle
 *   c_x, c_i, c_mu ln(value / nominal value) of the longitudinal stiffness, of the
 *                  cornering stiffness of axle i, and of the grip
 *   A, B           longitudinal and lateral acceleration that cause load transfer
 *   g_x, g_y       components of gravity (GX, GY); b_x, b_y, b_r biases (BX, BY, BR)
 *   w_f, w_r       [rad/s] wheel speeds; R_f, R_r rolling radii in the settings
 *
 *   Tyre        F = C s c(q), q = |C s|/limit; the same with the slip angle a for s
 *               shape = 0: c = 1 - q/3 + q^2/27 up to q = 3, then 1/q (brush model)
 *               shape = 1: c = (1 + q^2 + q^4)^(-1/4)
 *               between them c is interpolated linearly
 *   Loads       A = clamp(e^c_x (kx_front s_f + kx_rear s_r), +-10 m/s2)
 *               limit_i = grip e^c_mu end_i (1 -+ height_i A)
 *               end_i = load_i/(1 +- balance)
 *               B follows from the lateral acceleration B_0 without lateral load
 *               transfer: B = B_0 (1 - (side_front + side_rear)/2 B^2)
 *   Stiffness   longitudinal  C = kx_i e^c_x (1 -+ height_i A)
 *               lateral       C = ky_i e^c_i (1 -+ along_i A) max(1 - side_i B^2, 0.1)
 *   Wheels      d = (1 + gain)(steer - late steer') + steer_offset - compliance Y_f
 *   Forces      X, Y are the forces of the front axle in the axes of the car
 *               X = X_f cos d - Y_f sin d
 *               Y = Y_f cos d + X_f sin d
 *               a_x = X + X_r - drag |v_x| v_x - rolling v_x/max(|v_x|, 0.5)
 *               a_y = Y + Y_r + pull_front + pull_rear
 *               yaw = jf (Y + pull_front) - jr (Y_r + pull_rear) - trail (Y_f + Y_r)
 *   Motion      v_x' = a_x + v_y r - g_x
 *               v_y' = a_y - (1 - lean) v_x r + g_y + roll_coupling phi''
 *               r' = yaw
 *               phi'' = roll_omega^2 (roll_gain a_y - phi)
 *                       - 2 roll_damping roll_omega phi'
 *   Slip angle  relaxation a_f' = v (d - atan((v_y + lf r)/v) - a_f)
 *               relaxation a_r' = v (-atan((v_y - lr r)/v) + roll_steer phi - a_r)
 *               v = max(|v_x|, 1 m/s)
 *   Pitch       p'' = w^2 (a_x - p) - 2 pitch_damping w p', w = 2 pi pitch_frequency
 *               read = pitch_leak p - pitch_height p'', part of accel_x due to pitch
 *   IMU         x = a_x - lever_x r^2 - lever_y r' + read
 *               y = a_y + lever_x r' - lever_y r^2 + roll_leak phi - roll_height phi''
 *               accel_x = scale_x (x cos m + y sin m) + b_x, m is the mounting angle
 *               accel_y = scale_y (y cos m - x sin m) + b_y
 *               yaw_rate = scale_r r + b_r
 *   Speeds      w_f R_f = (v_x cos d + (v_y + lf r) sin d)(1 + s_f)(1 + rad)
 *                         (1 - loss height_front a_x)
 *               w_r R_r = v_x (1 + s_r)(1 + loss height_rear a_x)
 *               loss is RADIUS_LOSS in car.c
 *
 * The partial derivatives neglect load transfer, compliance, and the influence of the
 * grip on longitudinal saturation. The model has no combined slip: with combined slip,
 * errors of the longitudinal model changed the estimates of grip and cornering stiffness
 * by 10 % and more (tests/cars). */
#ifndef TSE_CAR_H
#define TSE_CAR_H

#include "model/state.h"
#include "model/laws.h"

/* The state x, in SI units: ROW(name, unit in the covariance, max magnitude). The units
 * in the covariance give all its elements a similar magnitude, which suits every number
 * format. The states of the motion come first. In the transition matrix only their rows
 * have off-diagonal elements. */
/* clang-format off */
/* The build TSE_SMALL has lateral motion only. There the quantities of KNOWN_ROWS are not
 * states but constants, with the mean of their prior as value. There are two exceptions:
 * PHI is proportional to the lateral force, without a lag, and SF and SR are computed
 * from accel_x. */
#if defined(TSE_SMALL)
#define NOT_SMALL(rows)
#define KNOWN_ROWS(NAME) NAME(PHI) NAME(DPHI) NAME(SF) NAME(SR) NAME(GX) NAME(BX) NAME(LCX) NAME(RAD)
#else
#define NOT_SMALL(rows) rows
#endif
#define STATE_ROWS(ROW) \
  ROW(VX,   0.2,   200) /* [m/s] longitudinal velocity */ \
  ROW(VY,   0.1,   60)  /* [m/s] lateral velocity */ \
  ROW(YAW,  0.02,  20)  /* [rad/s] yaw rate */ \
  ROW(AF,   0.01,  1.5) /* [rad] slip angle of the front axle, after relaxation */ \
  ROW(AR,   0.01,  1.5) /* [rad] slip angle of the rear axle, after relaxation */ \
  NOT_SMALL(ROW(PHI,  0.01, 0.5)) /* [rad] roll angle */ \
  NOT_SMALL(ROW(DPHI, 0.5,  10))  /* [rad/s] rate of the roll angle */ \
  NOT_SMALL(ROW(SF,   0.01, 10))  /* [1] slip of the front axle */ \
  NOT_SMALL(ROW(SR,   0.01, 10))  /* [1] slip of the rear axle */ \
  NOT_SMALL(ROW(GX,   0.3,  5))   /* [m/s2] gravity along the road, positive uphill: it slows the car */ \
  ROW(GY,   0.15,  5)   /* [m/s2] gravity across the road, positive if it pulls to the left */ \
  NOT_SMALL(ROW(BX,   0.05, 50))  /* [m/s2] bias of accel_x */ \
  ROW(BY,   0.05,  50)  /* [m/s2] bias of accel_y */ \
  ROW(BR,   0.002, 6)   /* [rad/s] bias of yaw_rate */ \
  NOT_SMALL(ROW(LCX,  0.1,  4))   /* [1] ln(longitudinal stiffness / nominal) */ \
  ROW(LCF,  0.1,   4)   /* [1] ln(front cornering stiffness / nominal) */ \
  ROW(LCR,  0.1,   4)   /* [1] ln(rear cornering stiffness / nominal) */ \
  ROW(LMU,  0.2,   4)   /* [1] ln(grip / grip in the settings) */ \
  ROW(STEER_OFFSET, 0.002, 0.2) /* [rad] true minus logged road-wheel angle where the logged one is 0 */ \
  ROW(GAIN, 0.02,  0.5) /* [1] scale error: (road-wheel angle without offset)/(logged angle) - 1 */ \
  NOT_SMALL(ROW(LATE, 0.01,  0.2)) /* [s] latency of the steering angle */ \
  NOT_SMALL(ROW(RAD,  0.005, 0.2)) /* [1] (front wheel radius in the settings)/(true one) - 1 */ \
  ROW(LEAN, 0.05,  0.9) /* [1] superelevation: share of v_x r that gravity provides in banked curves */
/* Extra states, which are needed only if velocities are measured. In the state vector
 * they follow the states above. */
#define EXTRA_ROWS(ROW) \
  ROW(PSI,           0.02, 10)  /* [rad] heading of the car, positive left; 0 where gnss_course is 0 */ \
  ROW(V_DISCREPANCY, 0.1,  30)  /* [m/s] true lateral speed minus lateral speed of the model */ \
  ROW(V_SCALE,       0.01, 0.5) /* [1] scale error: measured/true velocity - 1 */ \
  ROW(V_TURN,        0.01, 1)   /* [rad] angle from the axes of the car to those of the INS */ \
  ROW(V_LATE,        0.02, 0.3) /* [s] latency of the velocities, minus the setting velocity_latency */ \
  ROW(V_LEVER_X,     0.2,  30)  /* [m] position of the velocity sensor, ahead of the centre of gravity */ \
  ROW(V_LEVER_Y,     0.2,  30)  /* [m] position of the velocity sensor, left of the centre of gravity */
/* clang-format on */
#define STATE_NAME(name, unit, max) name,
#if defined(TSE_SMALL)
enum {
  STATE_ROWS(STATE_NAME) STATES,
  MOTION = GY,
  PLACED = GY,
  FAST = BY,
};
#else
enum {
  STATE_ROWS(STATE_NAME) EXTRA_ROWS(STATE_NAME) STATES = PSI,
  MOTION = SF, /* the states before SF are the motion */
  PLACED = GX, /* the states before GX are initialised from the sensors */
  FAST = BX,   /* the states before BX get process noise in every row */
};
#endif

/* Consider parameters of the Schmidt-Kalman filter: uncertain quantities that are not
 * estimated. Their uncertainty increases the variance of the estimates.
 *
 * The parameters before CONSIDER_SCALE belong to the car. In a matrix of partial
 * derivatives, the columns of these parameters follow the columns of the states. The
 * parameters from CONSIDER_SCALE on belong to the sensors. The public enumeration
 * TSE_CONSIDER_... (tse/config.h) is a different list: it also has some states and the
 * model error, and one relaxation length for both axles. */
#if defined(TSE_SMALL)
#define KNOWN_NAME(name) name,
enum {
  CONSIDER_CENTRE,
  CONSIDER_LATE, /* latency of the steering angle, which is not a state in this build */
  CONSIDER_SCALE,
  CONSIDER_GYRO,
  CONSIDER_INERTIA, /* from here on: parameters that this build does not consider */
  CONSIDER_TRAIL,
  CONSIDER_RELAXATION_FRONT,
  CONSIDER_RELAXATION_REAR,
  CONSIDER_ROLL_STEER,
  CONSIDER_WHEELS_LATE,
  CONSIDER_ACCEL_LATE,
  COLUMNS = STATES + CONSIDER_SCALE,
  LATE = STATES + CONSIDER_LATE,
  KNOWN = STATES + TSE_UNCERTAIN_ALL - 1,
  KNOWN_ROWS(KNOWN_NAME) PLACES,
};
#else
enum {
  CONSIDER_INERTIA,
  CONSIDER_CENTRE,
  CONSIDER_TRAIL,
  CONSIDER_RELAXATION_FRONT,
  CONSIDER_RELAXATION_REAR,
  CONSIDER_ROLL_STEER,
  CONSIDER_SCALE,
  CONSIDER_GYRO,
  CONSIDER_WHEELS_LATE,
  CONSIDER_ACCEL_LATE,
  COLUMNS = STATES + CONSIDER_SCALE,
  PLACES = COLUMNS, /* number of columns of a matrix of partial derivatives */
};
#endif

/* Constants of the build: whether roll and slip are states, and the first state that
 * is a stiffness. */
enum {
  HAS_ROLL = (int)PHI < (int)STATES ? 1 : 0,
  HAS_SLIP = (int)LCX < (int)STATES ? 1 : 0,
  STIFFNESS = HAS_SLIP ? (int)LCX : (int)LCF
};

/* Return the index, in the state, of the logarithm of stiffness a (a = TSE_CX_FRONT ..)
 * or, if a is 3, of the grip. */
static inline int stiffness_at(int a) { return a == 0 ? LCX : LCF + a - 1; }
/* Return the index, in the state, of the bias of IMU channel i (i = ACCEL_X ..). */
static inline int bias_at(int i) { return i == 0 ? BX : BY + i - 1; }

/* Sensors: indices in every array of TSE_SENSORS elements. The IMU comes first. */
enum {
  ACCEL_X,
  ACCEL_Y,
  YAW_RATE,
  WHEEL_FRONT,
  WHEEL_REAR,
  IMU_CHANNELS = WHEEL_FRONT,
};

/* Steering angle during a row: it changes linearly from `from` to `to` [rad] in
 * dt [s]. */
typedef struct steering {
  tse_real from, to, dt;
} steering;

/* Specific forces (force / mass) and yaw acceleration of the car, and their partial
 * derivatives. */
typedef struct forces {
  tse_real x, y, yaw; /* [m/s2] [m/s2] [rad/s2] */
  /* derivatives of x, y, yaw with respect to states and consider parameters */
  tse_real by_x[PLACES], by_y[PLACES], by_yaw[PLACES];
  tse_real sin_d, cos_d;         /* [1] sine and cosine of the road-wheel angle d */
  tse_real steer, rate;          /* [rad] logged steering angle; [rad/s] its rate */
  tse_real side;                 /* [m/s2] lateral force of the front axle, in the axes of its wheels */
  tse_real endless_x, endless_y; /* [m/s2] forces that linear tyres would have */
} forces;

/* Compute the forces at the state x.
 *   Given:  u      steering angle during the row
 *           share  time within the row: 0 at its start, 1 at its end
 *   Cost:   O(1) */
void car_forces(const tse_car *c, const tse_real x[TSE_VALUES], steering u, tse_real share, forces *f);

/* Compute the ratio of the secant stiffness at the state x to the stiffness at zero slip.
 *   Returned:  share[3]  ratio of the longitudinal stiffness of the front axle, and of
 *                        the cornering stiffness of the front and of the rear axle
 *   Cost:      O(1) */
void car_secants(const tse_car *c, const tse_real x[TSE_VALUES], tse_real share[3]);

/* Advance the state x through a row and compute the transition matrix of the motion.
 *   Given:     u  steering angle during the row
 *   Updated:   x
 *   Returned:  M[MOTION][PLACES]  partial derivatives of the motion at the end of the
 *                                 row with respect to states and consider parameters
 *                                 at its start, in SI units, scaled by
 *                                 r_short_scaled(.., ROW_UP)
 *   Cost:      O(substeps), at most TSE_SUBSTEPS */
void car_move(const tse_car *c, tse_real x[TSE_VALUES], steering u, tse_short M[MOTION][PLACES]);

/* Compute the time derivatives of v_x, v_y and yaw rate at the state x.
 *   Given:     f              car_forces() at x
 *   Returned:  rate[3]        [m/s2] [m/s2] [rad/s2]
 *              by[3][PLACES]  by[i][k]: partial derivative of rate[i] with respect to
 *                             state k or, from k = STATES on, to consider parameter
 *                             k - STATES */
void car_rates(const tse_car *c, const tse_real x[TSE_VALUES], const forces *f, tse_real rate[3],
    tse_real by[3][PLACES]);

/* Advance the pitch by dt, at the longitudinal acceleration ax.
 *   Updated:   pitch[0]  [m/s2] ax after a second-order lag; proportional to the pitch
 *              pitch[1]  [m/s3] rate of pitch[0]
 *   Returned:  [m/s2] part of accel_x that is due to pitch */
tse_real car_pitch(const tse_car *c, tse_real pitch[2], tse_real ax, tse_real dt);

/* Predict the measurements at the state x.
 *   Given:     f      car_forces() at x, at the end of the row
 *              pitch  [m/s2] part of accel_x due to pitch, from car_pitch(), or 0
 *   Returned:  z[TSE_SENSORS]          accel_x, accel_y [m/s2]; yaw_rate [rad/s]; wheel
 *                                      speed times radius, front and rear [m/s]
 *              H[TSE_SENSORS][PLACES]  partial derivatives of z with respect to
 *                                      states and consider parameters */
void car_measure(const tse_car *c, const tse_real x[TSE_VALUES], const forces *f, tse_real pitch,
    tse_real z[TSE_SENSORS], tse_real H[TSE_SENSORS][PLACES]);

#endif
