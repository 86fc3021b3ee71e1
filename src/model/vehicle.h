/* model/vehicle.h - the single-track model of the paper, and functions that integrate it
 * over time. Particle filter, simulator and replay use them. Numbers in parentheses, (1)
 * to (4) and (7), are equations of the paper (src/EQUATIONS.md).
 *
 * Functions that are called for each particle are inline and have no branches, so that
 * the compiler vectorises the loops over particles. Forces are divided by the mass of the
 * car. Axes are those of ISO 8855. Longitudinal slip is positive if the tyre drives the
 * car forward. */
#ifndef TSE_VEHICLE_H
#define TSE_VEHICLE_H

#include "model/state.h"
#include "model/laws.h"

/* Inputs of the model: road-wheel angle, and wheel speeds R omega. */
typedef struct inputs {
  tse_real steer, v_front, v_rear; /* [rad] [m/s] [m/s] */
} inputs;

/* Slips and slip angles of both axles. */
typedef struct slips {
  tse_real s_front, s_rear;     /* [1] longitudinal slip, (3) */
  tse_real a_front, a_rear;     /* [rad] slip angle, (4) */
  tse_real inv_front, inv_rear; /* [s/m] reciprocals of the denominators of both slips */
  tse_real inv_body;            /* [s/m] reciprocal of the denominator of the slip angles */
} slips;

/* Compute slips (3) and slip angles (4). R omega is the wheel speed [m/s], delta the
 * road-wheel angle [rad], and low = LOW_SPEED = 1 m/s. Because of the absolute values in
 * the denominators, the force of a tyre opposes its sliding velocity in reverse, too.
 *   s = (R omega - vx)/max(|vx|, |R omega|, low)
 *   alpha_f = (delta vx - vy - lf r)/max(|vx|, low)
 *   alpha_r = (lr r - vy)/max(|vx|, low) */
static inline slips vehicle_slips(const tse_params *p, tse_real vx, tse_real vy, tse_real r, inputs u)
{
  slips s;
  const tse_real v = rolling_speed(vx);
  s.inv_body = r_div(TSE_R(1), v);
  s.inv_front = r_div(TSE_R(1), r_max(v, r_abs(u.v_front)));
  s.inv_rear = r_div(TSE_R(1), r_max(v, r_abs(u.v_rear)));
  s.s_front = r_mul(u.v_front - vx, s.inv_front);
  s.s_rear = r_mul(u.v_rear - vx, s.inv_rear);
  s.a_front = r_mul(r_mul(u.steer, vx) - vy - r_mul(p->car.lf, r), s.inv_body);
  s.a_rear = r_mul(r_mul(p->car.lr, r) - vy, s.inv_body);
  return s;
}

/* Stiffness / mass: x [m/s2] longitudinal, y [m/s2/rad] cornering. */
typedef struct stiffness {
  tse_real x_front, x_rear, y_front, y_rear;
} stiffness;

/* Return the stiffness C = C_nominal (1 + w). w is the relative deviation: w0 of the
 * front longitudinal stiffness, w1 of the front and w2 of the rear cornering stiffness.
 * The deviation of the rear longitudinal stiffness is p->follow times w0. */
static inline stiffness vehicle_stiffness(const tse_params *p, tse_real w0, tse_real w1, tse_real w2)
{
  stiffness k;
  k.x_front = r_mul(p->car.kx_front, TSE_R(1) + w0);
  k.x_rear = r_mul(p->car.kx_rear, TSE_R(1) + r_mul(p->follow, w0));
  k.y_front = r_mul(p->car.ky_front, TSE_R(1) + w1);
  k.y_rear = r_mul(p->car.ky_rear, TSE_R(1) + w2);
  return k;
}

/* Specific force at the centre of gravity, and yaw acceleration. */
typedef struct accels {
  tse_real x, y, yaw; /* [m/s2] [m/s2] [rad/s2] */
} accels;

/* Compute the accelerations, equations (1) and (2), with the approximations
 * cos(delta) = 1 and sin(delta) = delta. */
static inline accels vehicle_accels(const tse_params *p, stiffness k, slips s, tse_real steer)
{
  accels a;
  const tse_real fx_front = r_mul(k.x_front, s.s_front), fx_rear = r_mul(k.x_rear, s.s_rear);
  const tse_real fy_front = r_mul(k.y_front, s.a_front), fy_rear = r_mul(k.y_rear, s.a_rear);
  a.x = fx_front + fx_rear - r_mul(fy_front, steer);
  a.y = fy_front + fy_rear + r_mul(fx_front, steer);
  a.yaw = r_mul(p->car.jf, fy_front + r_mul(fx_front, steer)) - r_mul(p->car.jr, fy_rear);
  return a;
}

/* Matrix 1 - g h J of the integration method ROS2 (see the constant ROS2 below) for the
 * states (vy, r), and the reciprocal of its determinant. h is the step. J has the partial
 * derivatives, with respect to vy and r, of the forces and yaw moment of the tyres and of
 * the term -vx r in vy'. */
typedef struct lateral_block {
  tse_real m11, m12, m21, m22, inv_det;
} lateral_block;

/* Compute the matrix of lateral_block.
 *   Given:  yf, yr  [1/s] cornering stiffness of each axle / (mass times speed)
 *           gh      [s] g h */
static inline lateral_block vehicle_block(
    const tse_params *p, tse_real yf, tse_real yr, tse_real vx, tse_real gh)
{
  lateral_block m;
  m.m11 = TSE_R(1) + r_mul(gh, yf + yr);
  m.m12 = r_mul(gh, r_mul(p->car.lf, yf) - r_mul(p->car.lr, yr) + vx);
  m.m21 = r_mul(gh, r_mul(p->car.jf, yf) - r_mul(p->car.jr, yr));
  m.m22 = TSE_R(1)
      + r_mul(gh, r_mul(r_mul(p->car.jf, p->car.lf), yf) + r_mul(r_mul(p->car.jr, p->car.lr), yr));
  m.inv_det = r_div(TSE_R(1), r_mul(m.m11, m.m22) - r_mul(m.m12, m.m21));
  return m;
}

/* Solve m (ky, kr) = (fy, fr) for ky and kr. */
static inline void vehicle_solve(const lateral_block *m, tse_real fy, tse_real fr, tse_real *ky, tse_real *kr)
{
  *ky = r_mul(r_mul(m->m22, fy) - r_mul(m->m12, fr), m->inv_det);
  *kr = r_mul(r_mul(m->m11, fr) - r_mul(m->m21, fy), m->inv_det);
}

/* Constant g of the method that integrates equation (7) in particle filter, replay and
 * simulator: the L-stable Rosenbrock method ROS2 of order 2 (Verwer, Spee, Blom &
 * Hundsdorfer, SIAM J. Sci. Comput. 20 (1999) 1456). A step h leads from the state x to
 * the state x+. f(x, u) is the rate of the state, and the input changes from u0 to u1:
 *   (1 - g h J) k1 = f(x, u0)
 *   (1 - g h J) k2 = f(x + h k1, u1) - 2 k1
 *   x+ = x + h (3 k1 + k2)/2,  g = 1 - 1/sqrt(2)
 * The method has order 2 for every matrix J. J is therefore only the stiff part of the
 * Jacobian, which is the damping of vx and of (vy, r) by the tyres. The rates of this
 * damping are proportional to 1/speed and exceed 100/s at walking pace, where an explicit
 * step would diverge. */
#define ROS2 TSE_R(0.29289321881345254)

/* Limits of the motion. They keep a particle finite if its motion becomes NaN, or if the
 * motion diverges because a wheel speed jumps or the stiffness of the particle is
 * extreme. A magnitude below MIN_MOTION is set to 0. Otherwise lateral speed and yaw rate
 * would decay to denormal numbers within minutes of straight driving. Computing with
 * denormal numbers is slow, and some machines replace them by 0. */
#define MAX_SPEED TSE_R(200)    /* [m/s] */
#define MAX_YAW_RATE TSE_R(20)  /* [rad/s] */
#define MIN_MOTION TSE_R(1e-12) /* [m/s], [rad/s] */

/* Limit a velocity or yaw rate to -max .. max, and replace a very small one by 0. */
static inline tse_real vehicle_limit(tse_real v, tse_real max)
{
  const tse_real inside = r_max(r_min(v, max), -max);
  return r_abs(inside) < MIN_MOTION ? TSE_R(0) : inside;
}

/* Return the number of integration steps for a log row of dt seconds. It is the same for
 * all particles. The length of a step has three limits. If they contradict each other,
 * the first in this list applies:
 *   1. At most max_step.
 *   2. At least max_step/8, to limit the computing time.
 *   3. At most 1/(4 rate). The rate is the fastest at which the tyres damp the motion. It
 *      is proportional to 1/speed. With a single step for each row the longitudinal
 *      stiffness would be wrong by 3 % at walking pace. Speeds below hold_speed count as
 *      hold_speed, because no stiffness is updated at such speeds. */
static inline int32_t vehicle_steps(const tse_params *p, tse_real dt, inputs from, inputs to)
{
  const tse_real speed = r_mul(
      TSE_R(0.25), r_abs(from.v_front + from.v_rear) + r_abs(to.v_front + to.v_rear));
  const tse_real quarter = r_div(speed, p->damping);
  return -r_floor_to_int(-r_div(dt, r_min(p->max_step, r_max(quarter, p->least_step))));
}

/* Return the inputs after k of `steps` equal steps, by linear interpolation. */
static inline inputs vehicle_between(inputs from, inputs to, int32_t k, int32_t steps)
{
  if (k < steps) {
    const tse_real share = r_div(r_from_int(k), r_from_int(steps));
    to.steer = from.steer + r_mul(share, to.steer - from.steer);
    to.v_front = from.v_front + r_mul(share, to.v_front - from.v_front);
    to.v_rear = from.v_rear + r_mul(share, to.v_rear - from.v_rear);
  }
  return to;
}

#endif
