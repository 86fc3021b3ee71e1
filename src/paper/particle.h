/* paper/particle.h - the vehicle model of vehicle.h in the form that the particle filter
 * uses: equations (6), (7), (9) of the paper, for one particle.
 *
 * All functions are inline and have no branches, so that the compiler vectorises loops
 * over particles. */
#ifndef TSE_PARTICLE_H
#define TSE_PARTICLE_H

#include "model/vehicle.h"

/* Matrix d and vector h of (9), divided by the sds of the sensors. The accelerations are
 * h + d w. The struct omits elements that are 0: the third row of d (yaw rate) and
 * element (1, 3), the derivative of accel_x with respect to the rear cornering
 * stiffness. */
typedef struct observation {
  tse_real d11, d12, d21, d22, d23; /* partial derivatives of accel_x, accel_y with respect to w */
  tse_real h1, h2;                  /* accel_x, accel_y at w = 0 */
} observation;

/* Nominal stiffness, divided by the mass of the car and by the sd of a sensor. The names
 * consist of: x longitudinal or y cornering stiffness; f front or r rear axle; 1 sd of
 * accel_x or 2 sd of accel_y. xr1_follow is xr1 times p->follow: the relative deviation
 * of the rear longitudinal stiffness is p->follow times that of the front. */
typedef struct observation_gains {
  tse_real xf1, xr1, xr1_follow, yf1, xf2, yf2, yr2;
} observation_gains;

static inline observation_gains particle_observation_gains(
    const tse_params *p, tse_real use_x, tse_real use_y)
{
  observation_gains g; /* use_x, use_y: 0 if accel_x, accel_y is missing, which makes its gains 0; else 1 */
  const tse_real ix = r_mul(use_x, p->inv_sd[0]), iy = r_mul(use_y, p->inv_sd[1]);
  g.xf1 = r_mul(p->car.kx_front, ix);
  g.xr1 = r_mul(p->car.kx_rear, ix);
  g.xr1_follow = r_mul(g.xr1, p->follow);
  g.yf1 = r_mul(p->car.ky_front, ix);
  g.xf2 = r_mul(p->car.kx_front, iy);
  g.yf2 = r_mul(p->car.ky_front, iy);
  g.yr2 = r_mul(p->car.ky_rear, iy);
  return g;
}

static inline observation particle_observation(observation_gains g, slips s, tse_real steer)
{
  observation o;
  const tse_real front1 = r_mul(g.xf1, s.s_front);
  o.d11 = front1 + r_mul(g.xr1_follow, s.s_rear);
  o.d12 = -r_mul(r_mul(g.yf1, s.a_front), steer);
  o.d21 = r_mul(r_mul(g.xf2, s.s_front), steer);
  o.d22 = r_mul(g.yf2, s.a_front);
  o.d23 = r_mul(g.yr2, s.a_rear);
  o.h1 = front1 + r_mul(g.xr1, s.s_rear) + o.d12;
  o.h2 = o.d21 + o.d22 + o.d23;
  return o;
}

/* Integrate (7) over h seconds with constant stiffness k and inputs that change linearly
 * from u0 to u1, by the method ROS2 of vehicle.h. */
static inline void particle_step(const tse_params *p, tse_real *vx, tse_real *vy, tse_real *r, stiffness k,
    inputs u0, inputs u1, tse_real h)
{
  const tse_real gh = r_mul(ROS2, h);
  const slips s0 = vehicle_slips(p, *vx, *vy, *r, u0);
  const accels a0 = vehicle_accels(p, k, s0, u0.steer);
  const tse_real inv_mx = r_div(
      TSE_R(1), TSE_R(1) + r_mul(gh, r_mul(k.x_front, s0.inv_front) + r_mul(k.x_rear, s0.inv_rear)));
  const lateral_block side = vehicle_block(
      p, r_mul(k.y_front, s0.inv_body), r_mul(k.y_rear, s0.inv_body), *vx, gh);

  const tse_real k1x = r_mul(a0.x + r_mul(*vy, *r), inv_mx);
  tse_real k1y, k1r, k2y, k2r;
  vehicle_solve(&side, a0.y - r_mul(*vx, *r), a0.yaw, &k1y, &k1r);

  const tse_real px = *vx + r_mul(h, k1x), py = *vy + r_mul(h, k1y), pr = *r + r_mul(h, k1r);
  const slips s1 = vehicle_slips(p, px, py, pr, u1);
  const accels a1 = vehicle_accels(p, k, s1, u1.steer);
  const tse_real gx = a1.x + r_mul(py, pr) - k1x - k1x;
  vehicle_solve(&side, a1.y - r_mul(px, pr) - k1y - k1y, a1.yaw - k1r - k1r, &k2y, &k2r);

  const tse_real half = r_mul(TSE_R(0.5), h);
  *vx += r_mul(half, k1x + k1x + k1x + r_mul(gx, inv_mx));
  *vy += r_mul(half, k1y + k1y + k1y + k2y);
  *r += r_mul(half, k1r + k1r + k1r + k2r);
}

#endif
