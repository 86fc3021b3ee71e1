/* model/vehicle.h - the single-track model, (1)-(4), and what its integrators share.
 *
 * Inline and branch-free, so that loops over particles (paper/) vectorise. Forces are
 * over mass, measurements over the sensor's sd. ISO 8855 axes, slip > 0 when driving. */
#ifndef TSE_VEHICLE_H
#define TSE_VEHICLE_H

#include "model/state.h"
#include "model/laws.h"

typedef struct inputs {
  tse_real steer, v_front, v_rear; /* [rad], R omega [m/s] */
} inputs;

typedef struct slips {
  tse_real s_front, s_rear;               /* [1]   longitudinal slip (3)  */
  tse_real a_front, a_rear;               /* [rad] slip angle (4)         */
  tse_real inv_front, inv_rear, inv_body; /* reciprocals of their denominators */
} slips;

/* Compute slips and slip angles, (3), (4). Absolute values make them valid in reverse,
 * too: the force of a tyre still opposes its contact velocity.
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

/* Stiffness over mass at the relative deviation w: C = C_n (1 + w). The rear longitudinal
 * stiffness follows the front one by the share `follow`. */
typedef struct stiffness {
  tse_real x_front, x_rear, y_front, y_rear;
} stiffness;

static inline stiffness vehicle_stiffness(const tse_params *p, tse_real w0, tse_real w1, tse_real w2)
{
  stiffness k;
  k.x_front = r_mul(p->car.kx_front, TSE_R(1) + w0);
  k.x_rear = r_mul(p->car.kx_rear, TSE_R(1) + r_mul(p->follow, w0));
  k.y_front = r_mul(p->car.ky_front, TSE_R(1) + w1);
  k.y_rear = r_mul(p->car.ky_rear, TSE_R(1) + w2);
  return k;
}

typedef struct accels {
  tse_real x, y, yaw; /* specific force [m/s2], yaw acceleration [rad/s2] */
} accels;

/* Compute the accelerations, (1), (2), with cos(delta) = 1, sin(delta) = delta. */
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

/* Matrix 1 - g h J of (vy, r). J holds the damping by the tyres; yf, yr: cornering
 * stiffness over mass and speed. */
typedef struct lateral_block {
  tse_real m11, m12, m21, m22, inv_det;
} lateral_block;

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

static inline void vehicle_solve(const lateral_block *m, tse_real fy, tse_real fr, tse_real *ky, tse_real *kr)
{
  *ky = r_mul(r_mul(m->m22, fy) - r_mul(m->m12, fr), m->inv_det);
  *kr = r_mul(r_mul(m->m11, fr) - r_mul(m->m21, fy), m->inv_det);
}

/* The integrator of (7) everywhere in this library: Rosenbrock method of order 2,
 * L-stable (ROS2: Verwer, Spee, Blom & Hundsdorfer, SIAM J. Sci. Comput. 20 (1999) 1456):
 *   (1 - g h J) k1 = f(x, u0)
 *   (1 - g h J) k2 = f(x + h k1, u1) - 2 k1
 *   x+ = x + h (3 k1 + k2)/2,  g = 1 - 1/sqrt(2)
 * Its order does not depend on J. J therefore holds only the stiff part: the tyres'
 * damping of vx and of (vy, r). Its rates grow like 1/speed to over 100/s at walking
 * pace, where an explicit step would diverge. */
#define ROS2 TSE_R(0.29289321881345254) /* g */

/* Limits of the motion: a particle that diverges (jump of a wheel speed, extreme
 * stiffness) or becomes NaN stays finite. Magnitudes below MIN_MOTION become 0: decay
 * over minutes of straight driving ends in denormal numbers, which are slow and which
 * some machines flush. */
#define MAX_SPEED TSE_R(200) /* m/s */
#define MAX_YAW_RATE TSE_R(20) /* rad/s */
#define MIN_MOTION TSE_R(1e-12)

static inline tse_real vehicle_limit(tse_real v, tse_real max)
{
  const tse_real inside = r_max(r_min(v, max), -max);
  return r_abs(inside) < MIN_MOTION ? TSE_R(0) : inside;
}

/* Return the number of integration steps of a row of dt seconds, the same for all
 * particles. A step is at most max_step, and short enough that the fastest rate of the
 * car (the tyres' damping, which grows with 1/speed) times the step is at most 1/4: a
 * single step at walking pace would bias the longitudinal stiffness by 3 %. The speed
 * counts as hold_speed at least, because nothing is learnt below; at most eight steps per
 * max_step. */
static inline int32_t vehicle_steps(const tse_params *p, tse_real dt, inputs from, inputs to)
{
  const tse_real speed = r_mul(
      TSE_R(0.25), r_abs(from.v_front + from.v_rear) + r_abs(to.v_front + to.v_rear));
  const tse_real quarter = r_div(speed, p->damping);
  return -r_floor_to_int(-r_div(dt, r_min(p->max_step, r_max(quarter, p->least_step))));
}

/* Return the inputs after k of these steps, linear from row to row. */
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
