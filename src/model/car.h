/* model/car.h - the model of the car, with its slopes.
 *
 * Each axle is one wheel. Kinematics are exact. The slip angle of each axle relaxes over
 * a length. The slip of each axle is a state, so that wheel speeds are measurements.
 * Tyres have a stiffness at zero slip and a max force by grip. The body rolls. The
 * steering angle is the only input. Forces are over mass. ISO 8855 axes, slip > 0 when
 * driving, slip angle > 0 when the force points left.
 *
 * Equations, in the order of car.c. Names are those of tse_car (state.h) and of the state
 * below. i: axle, upper sign front; s, a: slip and slip angle of an axle; c_x, c_i, c_mu:
 * logarithms of stiffness and grip; e^: exponential().
 *
 *   Tyre        F = C s c(q), q = |C s|/limit; slip and slip angle alike, independently
 *               c = 1 - q/3 + q^2/27 up to q = 3, then 1/q (brush model);
 *               `shape` mixes it with (1 + q^2 + q^4)^(-1/4)
 *   Loads       A = clamp(e^c_x (kx_front s_f + kx_rear s_r), +-10 m/s2)
 *               limit_i = grip e^c_mu end_i (1 -+ height_i A)
 *               end_i = load_i/(1 +- balance)
 *               B: lateral acceleration by tyres that lose the share
 *               (side_front + side_rear)/2 B^2 of their stiffness
 *   Stiffness   longitudinal  C = kx_i e^c_x (1 -+ height_i A)
 *               lateral       C = ky_i e^c_i (1 -+ along_i A) max(1 - side_i B^2, 0.1)
 *   Wheels      d = (1 + gain)(steer - late steer') + steer_offset - compliance Y_f
 *   Forces      X, Y: of the front axle, in the axes of the car
 *               X = X_f cos d - Y_f sin d
 *               Y = Y_f cos d + X_f sin d
 *               a_x = X + X_r - drag |v_x| v_x - rolling v_x/max(|v_x|, 0.5)
 *               a_y = Y + Y_r + pull_front + pull_rear
 *               yaw = jf (Y + pull_front) - jr (Y_r + pull_rear) - trail (Y_f + Y_r)
 *   Motion      v_x' = a_x + v_y r - g_x
 *               v_y' = a_y - (1 - lean) v_x r + g_y + roll_coupling phi''
 *               r' = yaw
 *               phi'' = roll_omega^2 (roll_gain a_y - phi) - 2 roll_damping roll_omega phi'
 *   Slip angle  relaxation a_f' = v (d - atan((v_y + lf r)/v) - a_f), v = max(|v_x|, 1 m/s)
 *               relaxation a_r' = v (-atan((v_y - lr r)/v) + roll_steer phi - a_r)
 *   Pitch       p'' = w^2 (a_x - p) - 2 pitch_damping w p', w = 2 pi pitch_frequency
 *               read = pitch_leak p - pitch_height p''
 *   IMU         x = a_x - lever_x r^2 - lever_y r' + read
 *               y = a_y + lever_x r' - lever_y r^2 + roll_leak phi - roll_height phi''
 *               accel_x = scale_x (x cos m + y sin m) + b_x, m: mounting angle
 *               accel_y = scale_y (y cos m - x sin m) + b_y
 *               yaw_rate = scale_r r + b_r
 *   Speeds      w_f R_f = (v_x cos d + (v_y + lf r) sin d)(1 + s_f)(1 + rad)
 *                         (1 - give height_front a_x)
 *               w_r R_r = v_x (1 + s_r)(1 + give height_rear a_x), give: RADIUS_LOSS
 *
 * Slopes leave out load transfer, compliance, and the grip's effect on longitudinal
 * saturation. The model has no combined slip: with it, errors of the longitudinal model
 * moved the grip, and with it the cornering stiffness, by 10 % and more (tests/cars). */
#ifndef TSE_CAR_H
#define TSE_CAR_H

#include "model/state.h"
#include "model/laws.h"

/* The state x: ROW(name, unit in the covariance, max magnitude), SI. The unit makes
 * numbers of similar magnitude in every number format. The motion comes first: only its
 * rows of the transition are not diagonal. */
/* clang-format off */
/* Lateral motion only. KNOWN_ROWS are constants at their prior, except PHI, which follows
 * the lateral force at once, and SF, SR, which follow from accel_x. */
#if defined(TSE_SMALL)
#define NOT_SMALL(rows)
#define KNOWN_ROWS(NAME) NAME(PHI) NAME(DPHI) NAME(SF) NAME(SR) NAME(GX) NAME(BX) NAME(LCX) NAME(RAD)
#else
#define NOT_SMALL(rows) rows
#endif
#define STATE_ROWS(ROW) \
  ROW(VX,   0.2,   200) /* [m/s] longitudinal and lateral speed */ \
  ROW(VY,   0.1,   60)  \
  ROW(YAW,  0.02,  20)  /* [rad/s] */ \
  ROW(AF,   0.01,  1.5) /* [rad] slip angle of each axle, after relaxation */ \
  ROW(AR,   0.01,  1.5) \
  NOT_SMALL(ROW(PHI,  0.01, 0.5)) /* [rad] roll angle, and its rate [rad/s] */ \
  NOT_SMALL(ROW(DPHI, 0.5,  10))  \
  NOT_SMALL(ROW(SF,   0.01, 10))  /* [1] slip of each axle */ \
  NOT_SMALL(ROW(SR,   0.01, 10))  \
  NOT_SMALL(ROW(GX,   0.3,  5))   /* [m/s2] gravity along (> 0 uphill), across (> 0 to the left) */ \
  ROW(GY,   0.15,  5)   \
  NOT_SMALL(ROW(BX,   0.05, 50))  /* [m/s2] [m/s2] [rad/s] biases of accel_x, accel_y, yaw_rate */ \
  ROW(BY,   0.05,  50)  \
  ROW(BR,   0.002, 6)   \
  NOT_SMALL(ROW(LCX,  0.1,  4))   /* [1] log stiffness over nominal: cx, cy front, cy rear; log grip */ \
  ROW(LCF,  0.1,   4)   \
  ROW(LCR,  0.1,   4)   \
  ROW(LMU,  0.2,   4)   \
  ROW(STEER_OFFSET, 0.002, 0.2) /* [rad] steering offset */ \
  ROW(GAIN, 0.02,  0.5) /* [1] error of the steering ratio */ \
  NOT_SMALL(ROW(LATE, 0.01,  0.2)) /* [s] latency of the steering angle */ \
  NOT_SMALL(ROW(RAD,  0.005, 0.2)) /* [1] relative error of the front radius */ \
  ROW(LEAN, 0.05,  0.9) /* [1] superelevation: share of v r that bank compensates */
#define EXTRA_ROWS(ROW) /* after them: states of a measured velocity */ \
  ROW(PSI,           0.02, 10)  /* [rad] heading of the car, in the axes of the course */ \
  ROW(V_DISCREPANCY, 0.1,  30)  /* [m/s] model discrepancy of the lateral speed */ \
  ROW(V_SCALE,       0.01, 0.5) /* [1] */ \
  ROW(V_TURN,        0.01, 1)   /* [rad] heading offset of the INS */ \
  ROW(V_LATE,        0.02, 0.3) /* [s] latency beyond the setting */ \
  ROW(V_LEVER_X,     0.2,  30)  /* [m] position of the velocity sensor */ \
  ROW(V_LEVER_Y,     0.2,  30)
/* clang-format on */
#define STATE_NAME(name, unit, most) name,
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
  MOTION = SF, /* states before this one: motion */
  PLACED = GX, /* states before this one: initialised from the sensors */
  FAST = BX,   /* states before this one: process noise in every row */
};
#endif

/* Consider parameters: uncertain quantities that are not estimated. The first ones belong
 * to the car and are columns of the slopes after the state; the others belong to the
 * sensors. Names are those of TSE_CONSIDER_ (tse/config.h), which also has names for states
 * and the model error, and only one relaxation. */
#if defined(TSE_SMALL)
#define KNOWN_NAME(name) name,
enum {
  CONSIDER_CENTRE,
  CONSIDER_LATE, /* of the steering; not a state in this build */
  CONSIDER_SCALE,
  CONSIDER_GYRO,
  CONSIDER_INERTIA, /* from here on: columns that are written and never read */
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
  PLACES = COLUMNS, /* columns of slopes; those from COLUMNS on are written and never read */
};
#endif

/* Compile-time constants: whether roll and slip are states; the first stiffness state. */
enum {
  HAS_ROLL = (int)PHI < (int)STATES ? 1 : 0,
  HAS_SLIP = (int)LCX < (int)STATES ? 1 : 0,
  STIFFNESS = HAS_SLIP ? (int)LCX : (int)LCF
};

/* Return the index of a stiffness or the grip (TSE_CX_FRONT .., 3), and of a bias. */
static inline int stiffness_at(int a) { return a == 0 ? LCX : LCF + a - 1; }
static inline int bias_at(int i) { return i == 0 ? BX : BY + i - 1; }

/* Sensors, in the order of every array of TSE_SENSORS. Those of the IMU come first. */
enum {
  ACCEL_X,
  ACCEL_Y,
  YAW_RATE,
  WHEEL_FRONT,
  WHEEL_REAR,
  IMU_CHANNELS = WHEEL_FRONT,
};

/* Steering angle through a row, linear: from .. to [rad] within dt [s]. */
typedef struct steering {
  tse_real from, to, dt;
} steering;

/* Specific forces, yaw acceleration, and their slopes over the state. */
typedef struct forces {
  tse_real x, y, yaw; /* [m/s2] [m/s2] [rad/s2] */
  tse_real by_x[PLACES], by_y[PLACES], by_yaw[PLACES];
  tse_real sin_d, cos_d, steer, rate; /* road-wheel angle d; logged angle [rad] and its rate [rad/s] */
  tse_real side;                      /* [m/s2] lateral force of the front axle */
  tse_real endless_x, endless_y;      /* [m/s2] forces of linear tyres */
} forces;

/* Compute the forces at x.
 *   Given:  share  of the row's steering, 0 .. 1
 *   O(1) time. */
void car_forces(const tse_car *c, const tse_real x[TSE_VALUES], steering u, tse_real share, forces *f);

/* Compute the secant stiffness at x, over the nominal stiffness at zero slip.
 *   Returned:  share[3]  longitudinal front, cornering front, cornering rear
 *   O(1) time. */
void car_secants(const tse_car *c, const tse_real x[TSE_VALUES], tse_real share[3]);

/* Advance x through the row u and compute the transition of the motion.
 *   Updated:   x
 *   Returned:  M[MOTION][PLACES]  slopes of the motion at the end over state and consider
 *                                 parameters at the start, SI, as r_short_scaled(x, ROW_UP)
 *   O(substeps) time, at most TSE_SUBSTEPS. */
void car_move(const tse_car *c, tse_real x[TSE_VALUES], steering u, tse_short M[MOTION][PLACES]);

/* Compute the rates of the speeds and of the yaw rate at x.
 *   Given:     f              car_forces() at x
 *   Returned:  rate[3]        [m/s2] [m/s2] [rad/s2]
 *              by[3][PLACES]  their slopes */
void car_rates(const tse_car *c, const tse_real x[TSE_VALUES], const forces *f, tse_real rate[3],
    tse_real by[3][PLACES]);

/* Advance the pitch from the previous row to longitudinal acceleration ax, dt later.
 *   Updated:   pitch  acceleration that the pitch follows, and its rate
 *   Returned:  [m/s2] part of accel_x due to pitch */
tse_real car_pitch(const tse_car *c, tse_real pitch[2], tse_real ax, tse_real dt);

/* Predict the measurements at x.
 *   Given:     f      car_forces() at x, at the end of the row
 *              pitch  from car_pitch(), or 0
 *   Returned:  z[TSE_SENSORS]          accel_x, accel_y [m/s2], yaw_rate [rad/s], wheel
 *                                      speeds front, rear times radius [m/s]
 *              H[TSE_SENSORS][PLACES]  their slopes */
void car_measure(const tse_car *c, const tse_real x[TSE_VALUES], const forces *f, tse_real pitch,
    tse_real z[TSE_SENSORS], tse_real H[TSE_SENSORS][PLACES]);

#endif
