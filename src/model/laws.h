/* model/laws.h - physical laws that the two models of the car share. One is the model of
 * the default filter (car.c), which adds partial derivatives. The other is the
 * single-track model of vehicle.h with the effects of catalogue.h, for simulator, replay
 * and vehicle FMU. An effect is a property of a car that the single-track model leaves
 * out, such as tyre saturation or body roll. In this file "force" means force divided by
 * the mass of the car [m/s2]. */
#ifndef TSE_LAWS_H
#define TSE_LAWS_H

#include "model/state.h"
#include "number/real_ops.h"

#define GRAVITY TSE_R(9.81)  /* [m/s2] */
#define LOW_SPEED TSE_R(1.0) /* [m/s] min speed in the denominator of slip and slip angles. At lower speeds
                              * the force of a tyre is proportional to its contact velocity, like the force
                              * of a damper (after Bernard & Clover, SAE 950311) */
#define MAX_PULL TSE_R(10)   /* [m/s2] max |acceleration| from which load transfer is computed: about the
                              * friction limit of a car. Linear tyres, whose force has no friction
                              * limit, can give larger accelerations */
#define MIN_SHARE_LEFT TSE_R(0.1) /* [1] min ratio of load or stiffness with load transfer to that without */
#define HALF_TURN TSE_R(3.141592653589793) /* [rad] */
#define TWO_PI TSE_R(6.283185307179586)
#define PER_TURN TSE_R(0.15915494309189535) /* 1/(2 pi) */
#define LOG2_OF_E TSE_R(1.4426950408889634)
#define LN_2 TSE_R(0.69314718055994531)
#define LN_TWO_PI TSE_R(1.8378770664093453) /* ln(2 pi) */
#define HALF_LOG2_OF_E TSE_R(0.72134752044448170)

/* ---- signals */

/* Compute sine and cosine of an angle [rad]. For angles up to 100 rad the error of both
 * is below 1e-13 in double and below 4e-7 in float. */
static inline void sin_cos(tse_real angle, tse_real *s, tse_real *c)
{
  const tse_real turns = r_mul(angle, PER_TURN);
  r_sincos_turn(turns - r_from_int(r_floor_to_int(turns)), s, c);
}

/* Return exp(x), and ln(x). */
static inline tse_real exponential(tse_real x) { return r_exp2(r_mul(LOG2_OF_E, x)); }
static inline tse_real logarithm(tse_real x) { return r_mul(LN_2, r_log2(x)); }

/* Return exp(-dt/time): the output of a first-order lag with this time constant after dt,
 * if its initial output is 1 and its input is 0. */
static inline tse_real left_of(tse_real dt, tse_real time)
{
  return r_exp2(-r_mul(LOG2_OF_E, r_div(dt, time)));
}

/* Return the output y1 of a first-order lag after dt. It is exact for an input that
 * changes linearly from x0 to x1:
 *   y1 = x1 - s T + (y0 - x0 + s T) exp(-dt/T),  s = (x1 - x0)/dt
 *   Given:  time  T;  from, to  x0, x1;  was  y0 */
static inline tse_real lagged(tse_real time, tse_real from, tse_real to, tse_real was, tse_real dt)
{
  const tse_real behind = r_mul(time, r_div(to - from, dt));
  return to - behind + r_mul(was - from + behind, left_of(dt, time));
}

/* Apply two first-order lags in series to the steering angle.
 *   Given:    first, second  time constants [s]; with second = 0 there is only the
 *             first lag
 *             steer          logged angle at this row
 *   Updated:  angle[3]       logged angle, angle after the first lag, angle after both */
static inline void lag_steering(
    tse_real first, tse_real second, tse_real steer, tse_real dt, tse_real angle[3])
{
  const tse_real before = angle[0], half_way = angle[1];
  angle[0] = steer;
  angle[1] = lagged(first, before, steer, half_way, dt);
  angle[2] = second > TSE_R(0) ? lagged(second, half_way, angle[1], angle[2], dt) : angle[1];
}

/* Integrate a second-order lag x of the input a over h by the trapezoidal rule, which is
 * stable for every product of frequency and h:
 *   x'' = w^2 (a - x) - 2 damping w x',  w = 2 pi frequency,  a linear from a0 to a1
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

/* Return x'' of the second-order lag of mode_step().
 *   Given:  x, speed  x and x'
 *           rate      w [rad/s] */
static inline tse_real compute_mode_swing(
    tse_real x, tse_real speed, tse_real rate, tse_real damping, tse_real a)
{
  return r_mul(r_mul(rate, rate), a - x) - r_mul(r_mul(TSE_R(2), r_mul(damping, rate)), speed);
}

/* ---- kinematics */

/* A vector in the horizontal plane. */
typedef struct planar {
  tse_real x, y;
} planar;

/* Return the components of the vector (x, y) in axes that are turned to the left by an
 * angle. Examples are the axes of a steered wheel and of a misaligned IMU.
 *   Given:  sine, cosine  of the angle */
static inline planar turn_axes(tse_real x, tse_real y, tse_real sine, tse_real cosine)
{
  /* The second component is written as -(a - b), because gcc 12 computes a sum and a
   * difference of the same products by one fused instruction, in spite of
   * -ffp-contract=off, unless one of them is negated. The fused instruction does not
   * round the products, so that the result would differ between machines. */
  const planar t = { r_mul(x, cosine) + r_mul(y, sine), -(r_mul(x, sine) - r_mul(y, cosine)) };
  return t;
}

/* Return the speed in the denominator of slip and slip angles: |along|, at least
 * LOW_SPEED. */
static inline tse_real rolling_speed(tse_real along) { return r_max(r_abs(along), LOW_SPEED); }

/* Return the slip angle [rad] of a wheel, which is positive if the wheel moves to the
 * right. Its lateral force then points to the left.
 *   Given:  across, along  [m/s] lateral, longitudinal speed in the axes of the wheel */
static inline tse_real slip_angle(tse_real across, tse_real along)
{
  return -r_atan2(across, rolling_speed(along));
}

/* ---- tyres */

/* Return the secant ratio of a tyre: its force divided by the force of a linear tyre of
 * the same stiffness. The argument is q = |stiffness * slip| / limit, where the limit is
 * the friction coefficient times the load of the tyre.
 *   shape 0: brush model with parabolic pressure distribution,
 *            1 - q/3 + q^2/27 up to q = 3, then 1/q
 *   shape 1: (1 + q^2 + q^4)^(-1/4). Up to q = 1.2 it differs by at most 0.08 from
 *            magic-formula models of car tyres
 * For a shape between 0 and 1 the result is interpolated linearly between the two. The
 * force divided by the limit is q times the result. It has the slope 1 at q = 0 and tends
 * to 1 for large q.
 *   Returned:  *slope  q times the derivative of the result with respect to q */
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
    /* with v = 1/(1 + q^2), the ratio of shape 1 is (v^2/(1 - v + v^2))^(1/4).
     * Unlike q^4, no part of this expression can overflow */
    const tse_real v = r_div(TSE_R(1), TSE_R(1) + r_mul(q, q)), gone = TSE_R(1) - v;
    const tse_real sum = TSE_R(1) - r_mul(v, gone), root = r_sqrt(r_div(v, r_sqrt(sum)));
    c += r_mul(shape, root - c);
    cq += r_mul(shape, -r_mul(root, r_div(r_mul(gone, TSE_R(1) - r_mul(TSE_R(0.5), v)), sum)) - cq);
  }
  *slope = cq;
  return c;
}

/* Limit the acceleration that linear tyres would cause to +-MAX_PULL, for the computation
 * of load transfer, which would otherwise become too large. */
static inline tse_real tyre_pull(tse_real linear) { return r_clamp(linear, -MAX_PULL, MAX_PULL); }

/* Return a^2, the square of the lateral acceleration. Load transfer reduces the stiffness
 * of the tyres by the factor 1 - k a^2, and with it the acceleration. a0 is the
 * acceleration that the car would have without load transfer:
 *   a = a0 (1 - k a^2), with the solution a = 2 a0/(1 + sqrt(1 + 4 k a0^2)) */
static inline tse_real compute_lateral_square(tse_real k, tse_real a0)
{
  const tse_real inside = r_max(TSE_R(1) + r_mul(r_mul(TSE_R(4), k), r_mul(a0, a0)), TSE_R(0));
  const tse_real a = r_div(a0 + a0, TSE_R(1) + r_sqrt(inside));
  return r_mul(a, a);
}

/* Return the ratio of the cornering stiffness of an axle with lateral load transfer to
 * its cornering stiffness without load transfer.
 *   Given:  k       [s4/m2] relative loss of stiffness / squared lateral acceleration
 *           square  [m2/s4] squared lateral acceleration */
static inline tse_real compute_side_share(tse_real k, tse_real square)
{
  return r_max(TSE_R(1) - r_mul(k, square), MIN_SHARE_LEFT);
}

/* Return the ratio of the load (or stiffness) of an axle with longitudinal load transfer
 * to its load (or stiffness) without load transfer: 1 + more, at least MIN_SHARE_LEFT.
 *   Given:  more  relative increase of the load (or stiffness), negative for a decrease */
static inline tse_real compute_load_share(tse_real more) { return r_max(TSE_R(1) + more, MIN_SHARE_LEFT); }

/* ---- body and sensors */

/* Return aerodynamic drag / mass [m/s2]: the coefficient `drag` [1/m] times vx |vx|. */
static inline tse_real drag_of(tse_real drag, tse_real vx) { return r_mul(r_mul(drag, r_abs(vx)), vx); }

/* Return rolling resistance / mass. Below 0.5 m/s it is proportional to the speed.
 *   Given:  max  [m/s2] rolling resistance / mass at higher speeds */
static inline tse_real rolling_of(tse_real max, tse_real vx)
{
  return r_mul(max, r_div(vx, r_max(r_abs(vx), TSE_R(0.5))));
}

/* Return the component of gravity [m/s2] along an axis that rises by this angle. */
static inline tse_real gravity_along(tse_real angle)
{
  tse_real sine, cosine;
  sin_cos(angle, &sine, &cosine);
  return r_mul(GRAVITY, sine);
}

/* Return the part of the reading accel_x that is due to pitch [m/s2]:
 *   pitch_leak p - pitch_height p''
 * p is the longitudinal acceleration ax after a second-order lag (mode_step()). The pitch
 * angle, positive if the nose rises, is proportional to p. The first term is gravity
 * along the x axis of the pitched IMU. The second term is the tangential acceleration of
 * the IMU, which lies above the pitch axis.
 *   Given:  pitch[2]  p [m/s2] and its rate p' [m/s3]
 *           ax        [m/s2] */
static inline tse_real pitch_read(const tse_car *c, const tse_real pitch[2], tse_real ax)
{
  const tse_real swing = compute_mode_swing(
      pitch[0], pitch[1], r_mul(TWO_PI, c->pitch_frequency), c->pitch_damping, ax);
  return r_mul(c->pitch_leak, pitch[0]) - r_mul(c->pitch_height, swing);
}

/* Return the specific force at the point (lx, ly) [m] relative to the centre of gravity.
 *   Given:  x, y    [m/s2] specific force at the centre of gravity
 *           r, yaw  [rad/s] yaw rate; [rad/s2] yaw acceleration */
static inline planar compute_force_at(
    tse_real x, tse_real y, tse_real lx, tse_real ly, tse_real r, tse_real yaw)
{
  const tse_real spin = r_mul(r, r);
  const planar t = { x - r_mul(lx, spin) - r_mul(ly, yaw), y + r_mul(lx, yaw) - r_mul(ly, spin) };
  return t;
}

#endif
