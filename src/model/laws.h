/* model/laws.h - the laws of the car, each once. car.c uses them with their slopes; the
 * effects of simulator, replay and vehicle FMU (catalogue.h) use them as they are. Forces
 * are over mass. */
#ifndef TSE_LAWS_H
#define TSE_LAWS_H

#include "model/state.h"
#include "number/real_ops.h"

#define GRAVITY TSE_R(9.81) /* m/s2 */
#define LOW_SPEED TSE_R(1.0) /* m/s: min speed in the denominator of slip and slip angles. Below it the tyre
                              * acts as a damper of its contact velocity (after Bernard & Clover, SAE
                              * 950311) */
#define MAX_PULL TSE_R(10) /* m/s2: max acceleration by tyres on a road; linear tyres would exceed it */
#define MIN_SHARE_LEFT TSE_R(0.1) /* 1: min share of load or stiffness after load transfer */
#define HALF_TURN TSE_R(3.141592653589793)
#define TWO_PI TSE_R(6.283185307179586)
#define PER_TURN TSE_R(0.15915494309189535)
#define LOG2_OF_E TSE_R(1.4426950408889634)
#define LN_2 TSE_R(0.69314718055994531)
#define LN_TWO_PI TSE_R(1.8378770664093453)
#define HALF_LOG2_OF_E TSE_R(0.72134752044448170)

/* ---- signals */

/* Compute sine and cosine of an angle in rad; error below 1e-13 (float: 4e-7) up to 100
 * rad. */
static inline void sin_cos(tse_real angle, tse_real *s, tse_real *c)
{
  const tse_real turns = r_mul(angle, PER_TURN);
  r_sincos_turn(turns - r_from_int(r_floor_to_int(turns)), s, c);
}

static inline tse_real exponential(tse_real x) { return r_exp2(r_mul(LOG2_OF_E, x)); }
static inline tse_real logarithm(tse_real x) { return r_mul(LN_2, r_log2(x)); }

/* Return exp(-dt/time), the share of the initial value that a first-order lag retains. */
static inline tse_real left_of(tse_real dt, tse_real time)
{
  return r_exp2(-r_mul(LOG2_OF_E, r_div(dt, time)));
}

/* Return the output of a first-order lag dt later. Exact for an input that is linear
 * between rows:
 *   y1 = x1 - s T + (y0 - x0 + s T) exp(-dt/T),  s = (x1 - x0)/dt */
static inline tse_real lagged(tse_real time, tse_real from, tse_real to, tse_real was, tse_real dt)
{
  const tse_real behind = r_mul(time, r_div(to - from, dt));
  return to - behind + r_mul(was - from + behind, left_of(dt, time));
}

/* Apply two first-order lags in series to the steering angle. second = 0: only the first.
 *   Updated:  angle[3]  logged angle, after the first lag, after both */
static inline void lag_steering(
    tse_real first, tse_real second, tse_real steer, tse_real dt, tse_real angle[3])
{
  const tse_real before = angle[0], half_way = angle[1];
  angle[0] = steer;
  angle[1] = lagged(first, before, steer, half_way, dt);
  angle[2] = second > TSE_R(0) ? lagged(second, half_way, angle[1], angle[2], dt) : angle[1];
}

/* Integrate a second-order mode over h by the trapezoidal rule, stable for every f h:
 *   x'' = w^2 (a - x) - 2 d w x',  w = 2 pi f,  a linear from a0 to a1
 *   Updated:  x[0] = x, x[1] = x' */
static inline void mode_step(
    tse_real x[2], tse_real frequency, tse_real damping, tse_real a0, tse_real a1, tse_real h)
{
  const tse_real wh = r_mul(TWO_PI, r_mul(frequency, h));
  const tse_real drag = r_mul(damping, wh), spring = r_mul(TSE_R(0.25), r_mul(wh, wh));
  const tse_real v = x[1];
  const tse_real push = r_div(r_mul(r_mul(wh, wh), r_mul(TSE_R(0.5), a0 + a1) - x[0]), h);
  x[1] = r_div(r_mul(v, TSE_R(1) - drag - spring) + push, TSE_R(1) + drag + spring);
  x[0] += r_mul(r_mul(TSE_R(0.5), h), v + x[1]);
}

/* Return x'' of such a mode. Given: rate  natural frequency w [rad/s] */
static inline tse_real compute_mode_swing(
    tse_real x, tse_real speed, tse_real rate, tse_real damping, tse_real a)
{
  return r_mul(r_mul(rate, rate), a - x) - r_mul(r_mul(TSE_R(2), r_mul(damping, rate)), speed);
}

/* ---- kinematics */

/* A vector in the plane, and the same in axes that are turned to the left (velocity of a
 * steered wheel, acceleration in a misaligned IMU). */
typedef struct planar {
  tse_real x, y;
} planar;

static inline planar turn_axes(tse_real x, tse_real y, tse_real sine, tse_real cosine)
{
  /* gcc 12 fuses a sum beside a difference into one instruction, in spite of
   * -ffp-contract=off, unless one of them is negated */
  const planar t = { r_mul(x, cosine) + r_mul(y, sine), -(r_mul(x, sine) - r_mul(y, cosine)) };
  return t;
}

/* Return the speed in the denominator of slip and slip angles. */
static inline tse_real rolling_speed(tse_real along) { return r_max(r_abs(along), LOW_SPEED); }

/* Return the slip angle of a wheel from its speeds across and along its own axis. */
static inline tse_real slip_angle(tse_real across, tse_real along)
{
  return -r_atan2(across, rolling_speed(along));
}

/* ---- tyres */

/* Return the tyre force over that of a linear tyre, at q = stiffness slip/(friction
 * load).
 *   shape 0: brush model with parabolic pressure: 1 - q/3 + q^2/27 up to q = 3, then 1/q
 *   shape 1: (1 + q^2 + q^4)^(-1/4), within 0.08 of magic-formula car tyres up to q = 1.2
 * Both force curves have slope 1 at 0 and end at the grip. `shape` interpolates.
 *   Returned:  *slope  q times the derivative of the result */
static inline tse_real tyre_secant(tse_real q, tse_real shape, tse_real *slope)
{
  const tse_real z = r_mul(TSE_R(1.0 / 3), q);
  tse_real c, cq;
  if (z < TSE_R(1)) {
    c = TSE_R(1) - z + r_mul(TSE_R(1.0 / 3), r_mul(z, z));
    cq = r_mul(z, r_mul(TSE_R(2.0 / 3), z) - TSE_R(1));
  } else {
    c = r_div(TSE_R(1), q);
    cq = -c;
  }
  if (shape > TSE_R(0)) {
    /* with v = 1/(1 + q^2) it is (v^2/(1 - v + v^2))^(1/4), which cannot overflow */
    const tse_real v = r_div(TSE_R(1), TSE_R(1) + r_mul(q, q)), gone = TSE_R(1) - v;
    const tse_real sum = TSE_R(1) - r_mul(v, gone), root = r_sqrt(r_div(v, r_sqrt(sum)));
    c += r_mul(shape, root - c);
    cq += r_mul(shape, -r_mul(root, r_div(r_mul(gone, TSE_R(1) - r_mul(TSE_R(0.5), v)), sum)) - cq);
  }
  *slope = cq;
  return c;
}

/* Limit the acceleration by linear tyres. Load transfer is computed from it. */
static inline tse_real tyre_pull(tse_real linear) { return r_clamp(linear, -MAX_PULL, MAX_PULL); }

/* Return the square of the lateral acceleration a of tyres that lose the share k a^2 of
 * their stiffness. a0: acceleration without this loss. a = a0 (1 - k a^2) to first order,
 * solved as 2 a0/(1 + sqrt(1 + 4 k a0^2)). */
static inline tse_real compute_lateral_square(tse_real k, tse_real a0)
{
  const tse_real inside = r_max(TSE_R(1) + r_mul(r_mul(TSE_R(4), k), r_mul(a0, a0)), TSE_R(0));
  const tse_real a = r_div(a0 + a0, TSE_R(1) + r_sqrt(inside));
  return r_mul(a, a);
}

/* Return the share of an axle's cornering stiffness that lateral load transfer leaves. */
static inline tse_real compute_side_share(tse_real k, tse_real square)
{
  return r_max(TSE_R(1) - r_mul(k, square), MIN_SHARE_LEFT);
}

/* Return the share of an axle's load, or of a stiffness, that longitudinal transfer
 * leaves. */
static inline tse_real compute_load_share(tse_real more) { return r_max(TSE_R(1) + more, MIN_SHARE_LEFT); }

/* ---- body and sensors */

static inline tse_real drag_of(tse_real drag, tse_real vx) { return r_mul(r_mul(drag, r_abs(vx)), vx); }

/* Return the rolling resistance over mass. It grows linearly with speed up to 0.5 m/s. */
static inline tse_real rolling_of(tse_real max, tse_real vx)
{
  return r_mul(max, r_div(vx, r_max(r_abs(vx), TSE_R(0.5))));
}

/* Return the gravity component along an axis that climbs by this angle. */
static inline tse_real gravity_along(tse_real angle)
{
  tse_real sine, cosine;
  sin_cos(angle, &sine, &cosine);
  return r_mul(GRAVITY, sine);
}

/* Return the part of accel_x due to pitch: gravity, less the acceleration of the IMU
 * about the pitch axis.
 *   Given:  pitch[2]  longitudinal acceleration that the body follows, and its rate
 *           ax        longitudinal acceleration */
static inline tse_real pitch_read(const tse_car *c, const tse_real pitch[2], tse_real ax)
{
  const tse_real swing = compute_mode_swing(
      pitch[0], pitch[1], r_mul(TWO_PI, c->pitch_frequency), c->pitch_damping, ax);
  return r_mul(c->pitch_leak, pitch[0]) - r_mul(c->pitch_height, swing);
}

/* Return the specific force at the point (lx, ly) of a body with yaw rate r and yaw
 * acceleration yaw; (x, y): specific force at the centre of gravity. */
static inline planar compute_force_at(
    tse_real x, tse_real y, tse_real lx, tse_real ly, tse_real r, tse_real yaw)
{
  const tse_real spin = r_mul(r, r);
  const planar t = { x - r_mul(lx, spin) - r_mul(ly, yaw), y + r_mul(lx, yaw) - r_mul(ly, spin) };
  return t;
}

#endif
