/* model/point.h - the model at one time (`point`), and delay lines, for the files that
 * implement effects: catalogue.h, formula.h, effects.h. Internal. */
#ifndef TSE_SRC_POINT_H
#define TSE_SRC_POINT_H

#include "model/vehicle.h"

#if !defined(TSE_NO_EFFECTS)

/* Additional inputs of a log row: angles of the road, and disturbances that are added to
 * slip angles, forces and yaw acceleration. */
typedef struct given {
  tse_real grade, bank;           /* [rad] added to the settings grade_angle and bank_angle */
  tse_real slip_front, slip_rear; /* [rad] added to the slip angles */
  tse_real x, y, yaw;             /* [m/s2], [m/s2], [rad/s2] added to force / mass and yaw acceleration */
} given;

/* Wheels whose speeds v = R omega are states, for the front and the rear axle:
 *   v' = drive - brake clamp(v/still, -1, 1) - load Fx/m
 * Fx is the longitudinal tyre force of the axle, m the mass of the car. The clamped ratio
 * gives the brake the sign of v. It is continuous at v = 0, so that the brake holds a
 * standing wheel. */
typedef struct wheels {
  int32_t turning;             /* 0: wheel speeds are inputs, and the other members are not used */
  tse_real load[2];            /* [1] m R^2/J, where J is the moment of inertia of both wheels of the axle */
  tse_real drive[2], brake[2]; /* [m/s2] torques times R/J */
  tse_real still[2];           /* [m/s] speed above which the brake has its full torque */
} wheels;

/* Inputs, disturbances and torques at one time. */
typedef struct acting {
  inputs u;
  given g;
  wheels w;
} acting;

/* The model at one time: state and inputs, results of the effects, and resulting forces.
 * Forces are divided by the mass. */
typedef struct point {
  const tse_params *p;        /* the car */
  const tse_effect_memory *m; /* memory of the effects */
  tse_real vx, vy, r;         /* [m/s] [m/s] [rad/s] */
  inputs u;                   /* [rad] road-wheel angle with steering effects; [m/s] wheel speeds R omega */
  tse_real ahead;             /* [s] time of this point minus time of the last update of m */
  given g;
  wheels w;
  tse_real friction;  /* [1] friction coefficient at which the forces of an axle saturate; 0: linear tyres */
  slips s;            /* slips and slip angles; the force / mass of a tyre is k (below) times s */
  tse_real target[4]; /* LAG states (effects.h) follow these: slip angles front, rear, slips front, rear */
  tse_real rate[4];   /* [1/s] rates of the LAG states, in the order of target; 0: this slip has no lag */
  stiffness k;
  /* sine and cosine of the steering angle. The plain model approximates them by the angle
   * and 1. The effect exact_kinematics replaces them by the exact values */
  tse_real sin_steer, cos_steer;
  tse_real fx_front, fx_rear;    /* [m/s2] tyre forces, in the axes of the wheels */
  tse_real fy_front, fy_rear;    /* [m/s2] tyre forces, in the axes of the wheels */
  accels force;                  /* [m/s2] specific force at the centre of gravity; yaw [rad/s2] */
  tse_real free_angle[2];        /* [rad] slip angles before the user's formula and LAG states change them */
  tse_real gravity_x, gravity_y; /* [m/s2] parts of vx', vy' that are not in `force`: gravity, body roll */
} point;

/* Readings of accelerometers and gyro at a point. dt is the time since the last row. */
typedef struct reading {
  const point *pt;
  tse_effect_memory *m; /* memory of the effects; delays store samples in it */
  tse_real dt, y[3];    /* [s]; accel_x, accel_y [m/s2], yaw_rate [rad/s] */
} reading;

/* Store a new sample in a delay line. If the two newest stored samples are less than 1/9
 * of the delay apart, the new sample replaces the newest one. Otherwise it is added, and
 * the oldest one is discarded if the line is full. A full line has TSE_DELAY_ROWS = 12
 * samples, i.e. 11 intervals. Each but the newest lasts at least 1/9 of the delay, so
 * that these 10 intervals span more than the delay.
 *   Given:    delay     [s] delay that the stored samples must span
 *             dt        [s] time since the last call
 *             value     new sample of each channel
 *             channels  number of channels
 *   Updated:  d         ages of the stored samples, index 0: the most recent
 *             was       stored samples of each channel */
static inline void effects_delay_put(tse_delay *d, tse_real was[][TSE_DELAY_ROWS], tse_real delay,
    tse_real dt, const tse_real *value, int channels)
{
  for (int i = 0; i < d->count; i++) d->age[i] += dt;
  const int crowded = d->count > 1 && r_mul(TSE_R(9), d->age[1] - d->age[0]) < delay;
  if (d->count > 0 && !crowded) {
    const int last = d->count < TSE_DELAY_ROWS ? d->count : TSE_DELAY_ROWS - 1;
    for (int i = last; i > 0; i--) {
      d->age[i] = d->age[i - 1];
      for (int c = 0; c < channels; c++) was[c][i] = was[c][i - 1];
    }
    d->count = last + 1;
  }
  if (d->count < 1) d->count = 1;
  d->age[0] = TSE_R(0);
  for (int c = 0; c < channels; c++) was[c][0] = value[c];
}

/* Return the value `delay` seconds before the newest sample of a delay line that is not
 * empty. Interpolate linearly between the samples v, whose ages are d->age. If no sample
 * is as old as `delay`, return the oldest one. */
static inline tse_real effects_delay_get(const tse_delay *d, const tse_real v[TSE_DELAY_ROWS], tse_real delay)
{
  int i = 1;
  while (i < d->count && d->age[i] < delay) i++;
  if (i >= d->count) return v[d->count - 1];
  const tse_real share = r_div(delay - d->age[i - 1], d->age[i] - d->age[i - 1]);
  return v[i - 1] + r_mul(share, v[i] - v[i - 1]);
}

/* Indices in tse_effect_memory.mode of the second-order lags of the effects. */
enum {
  MODE_ROLL,
  MODE_PITCH,
  MODE_ROLL_STEER,
};

#endif
#endif
