/* model/integrator.c - integration of the model of vehicle.h with the effects of
 * effects.h. The effects are evaluated at every stage of the method. Wheel speeds are
 * inputs from the log (replay), or states that follow from torques (simulator). */
#include "model/effects.h"

/* State vector: vx, vy, r; from index TURNS on the wheel speeds R omega, front and rear;
 * from index LAGS on the four LAG states: lagged slip angles and slips (effects.h). */
enum { TURNS = 3, LAGS = 5, STATE_SIZE = 9 };

/* Return the brake torque of axle a times R/J [m/s2], as in wheels.brake.
 *   Given:  v  [m/s] R omega of the wheels of the axle */
static tse_real compute_brake_torque(const wheels *w, int a, tse_real v)
{
  return r_mul(w->brake[a], r_clamp(r_div(v, w->still[a]), TSE_R(-1), TSE_R(1)));
}

/* Return the slope of the brake torque over the wheel speed v.
 *   Given:  secant  0: the result is the derivative of compute_brake_torque() with respect
 *                   to v, which is 0 if the brake has its full torque
 *                   1: the result is torque / v */
static tse_real compute_brake_slope(const wheels *w, int a, tse_real v, int secant)
{
  if (secant) return r_div(w->brake[a], r_max(r_abs(v), w->still[a]));
  return r_abs(v) < w->still[a] ? r_div(w->brake[a], w->still[a]) : TSE_R(0);
}

/* Compute the time derivative f of the state vector, from equations (1) and (2) of the
 * paper (src/EQUATIONS.md) and from the equations of the wheels and of the LAG states. */
static void compute_derivatives(const point *pt, const tse_real lag[4], tse_real f[STATE_SIZE])
{
  const wheels *const w = &pt->w;
  const tse_real v[2] = { pt->u.v_front, pt->u.v_rear }, fx[2] = { pt->fx_front, pt->fx_rear };
  const int lags = effects_lag(&pt->p->effects);
  f[0] = pt->force.x + r_mul(pt->vy, pt->r) + pt->gravity_x;
  f[1] = pt->force.y - r_mul(pt->vx, pt->r) + pt->gravity_y;
  f[2] = pt->force.yaw;
  for (int a = 0; a < 2; a++)
    f[TURNS + a] = w->turning ? w->drive[a] - compute_brake_torque(w, a, v[a]) - r_mul(w->load[a], fx[a])
                              : TSE_R(0);
  for (int i = 0; i < 4; i++) f[LAGS + i] = lags ? r_mul(pt->rate[i], pt->target[i] - lag[i]) : TSE_R(0);
}

/* Factors of the matrix 1 - gh J (1: identity matrix). In the integration method ROS2
 * (vehicle.h) gh is the step h times the constant ROS2. In the implicit Euler method gh
 * is h. J contains only the stiff part of the Jacobian: the block of vx and
 * both wheel speeds, and the block of vy and r. The damping by a saturated tyre is
 * computed with its secant stiffness, which overestimates the damping. This keeps the
 * step stable, and the order of ROS2 does not depend on J.
 *
 * A LAG state a follows a kinematic slip or slip angle alpha: a' = rate (alpha - a). The
 * state is eliminated from the equations: if alpha changes by d, a changes by b d, with
 * b = gh rate/(1 + gh rate). The damping by the tyre is therefore multiplied by b. */
typedef struct solver {
  const point *at;
  tse_real inv_mx;
  tse_real pull[2];     /* [1] -gh d(Fx/m)/d(vx) of each axle, at constant wheel speed */
  tse_real inv_turn[2]; /* 1/(diagonal element of 1 - gh J for a wheel speed); 0: wheel speeds are inputs */
  lateral_block side;
  /* for each LAG state, in the order of point.target: slow = 1/(1 + gh rate), b as above,
   * force = gh times stiffness / mass. Without a lag slow and b are 1, force is 0 */
  tse_real slow[4], b[4], force[4];
  int lags; /* 1: there are LAG states */
} solver;

/* Compute the members slow, b and force of the solver, which belong to the LAG states. */
static void factor_lags(const point *pt, tse_real gh, solver *m)
{
  const tse_real k[4] = { pt->k.y_front, pt->k.y_rear, pt->k.x_front, pt->k.x_rear };
  for (int i = 0; i < 4; i++) {
    const int state = pt->rate[i] > TSE_R(0);
    m->slow[i] = r_div(TSE_R(1), TSE_R(1) + r_mul(gh, pt->rate[i]));
    m->b[i] = state ? r_mul(r_mul(gh, pt->rate[i]), m->slow[i]) : TSE_R(1);
    m->force[i] = state ? r_mul(gh, k[i]) : TSE_R(0);
  }
}

/* Compute the factors of 1 - gh J.
 *   Given:  secant  1: a brake enters by torque / v; 0: by the derivative of torque */
static solver factor_matrix(const point *pt, tse_real gh, int secant)
{
  solver m;
  const wheels *const w = &pt->w;
  const tse_real v[2] = { pt->u.v_front, pt->u.v_rear };
  tse_real y[2] = { r_mul(pt->k.y_front, pt->s.inv_body), r_mul(pt->k.y_rear, pt->s.inv_body) };
  tse_real x[2] = { r_mul(pt->k.x_front, pt->s.inv_front), r_mul(pt->k.x_rear, pt->s.inv_rear) };
  m.at = pt;
  m.lags = effects_lag(&pt->p->effects);
  if (m.lags) factor_lags(pt, gh, &m);
  for (int a = 0; a < 2; a++) {
    if (m.lags) {
      y[a] = r_mul(y[a], m.b[a]);
      x[a] = r_mul(x[a], m.b[2 + a]);
    }
    m.pull[a] = m.inv_turn[a] = TSE_R(0);
    if (!w->turning) continue;
    /* the wheel speed follows a change of vx, so that the slip changes less and the tyre
     * damps vx less */
    const tse_real held = TSE_R(1) + r_mul(gh, compute_brake_slope(w, a, v[a], secant));
    m.pull[a] = r_mul(gh, x[a]);
    m.inv_turn[a] = r_div(TSE_R(1), held + r_mul(w->load[a], m.pull[a]));
    x[a] = r_mul(x[a], r_mul(held, m.inv_turn[a]));
  }
  m.inv_mx = r_div(TSE_R(1), TSE_R(1) + r_mul(gh, x[0] + x[1]));
  m.side = vehicle_block(pt->p, y[0], y[1], pt->vx, gh);
  return m;
}

/* Solve (1 - gh J) k = f for k. */
static void solve(const solver *m, const tse_real f[STATE_SIZE], tse_real k[STATE_SIZE])
{
  const tse_params *const p = m->at->p;
  const tse_real *const load = m->at->w.load;
  const int turning = m->at->w.turning;
  const slips *const s = &m->at->s;
  tse_real fx = f[0], fy = f[1], fr = f[2], fw[2] = { f[TURNS], f[TURNS + 1] }, own[4];
  for (int i = 0; i < 4; i++) own[i] = m->lags ? r_mul(f[LAGS + i], m->slow[i]) : TSE_R(0);
  if (m->lags) {
    const tse_real front = r_mul(m->force[0], own[0]), rear = r_mul(m->force[1], own[1]);
    const tse_real along[2] = { r_mul(m->force[2], own[2]), r_mul(m->force[3], own[3]) };
    fx += along[0] + along[1];
    fy += front + rear;
    fr += r_mul(p->car.jf, front) - r_mul(p->car.jr, rear);
    for (int a = 0; a < 2 && turning; a++) fw[a] -= r_mul(load[a], along[a]);
  }
  for (int a = 0; a < 2 && turning; a++) fx += r_mul(r_mul(m->pull[a], m->inv_turn[a]), fw[a]);
  k[0] = r_mul(fx, m->inv_mx);
  vehicle_solve(&m->side, fy, fr, &k[1], &k[2]);
  for (int a = 0; a < 2; a++)
    k[TURNS + a] = turning ? r_mul(fw[a] + r_mul(load[a], r_mul(m->pull[a], k[0])), m->inv_turn[a])
                           : TSE_R(0);
  for (int i = 0; i < 4; i++) k[LAGS + i] = own[i];
  if (!m->lags) return;
  /* For LAG state i, k is own[i] + b[i] dalpha. own[i] is the part of k at constant
   * kinematic slip or slip angle. dalpha is the rate of change of this slip or slip angle
   * that follows from k[0] .. k[TURNS + 1]. With the denominator v of slip or slip angle:
   * d alpha/d vy = -1/v, d alpha/d r = -lf/v in front and lr/v in the rear,
   * d slip/d vx = -1/v, d slip/d (R omega) = 1/v */
  k[LAGS] = own[0] - r_mul(r_mul(m->b[0], s->inv_body), k[1] + r_mul(p->car.lf, k[2]));
  k[LAGS + 1] = own[1] - r_mul(r_mul(m->b[1], s->inv_body), k[1] - r_mul(p->car.lr, k[2]));
  k[LAGS + 2] = own[2] - r_mul(r_mul(m->b[2], s->inv_front), k[0] - k[TURNS]);
  k[LAGS + 3] = own[3] - r_mul(r_mul(m->b[3], s->inv_rear), k[0] - k[TURNS + 1]);
}

/* Compute ramp[i], the change of the time derivative f of each LAG state within a step h
 * that is due to the change of the inputs from `at` to `to`: h df/dt. As in Rosenbrock
 * methods for equations that depend on time, ramp[i] times the constant ROS2 is added to
 * f in the first stage of the method, and subtracted from f in the second stage. Without
 * this term, a LAG state with a time constant much shorter than the step would move by
 * 1/(2 ROS2) = 1.7 times the change of the slip that it follows. */
static void compute_input_drift(const point *at, const acting *to, tse_real ramp[4])
{
  const tse_real given_speeds = at->w.turning ? TSE_R(0) : TSE_R(1);
  const tse_real *const rate = at->rate;
  const tse_real ahead = r_mul(r_mul(to->u.steer - at->u.steer, at->vx), at->s.inv_body);
  ramp[0] = r_mul(rate[0], ahead + to->g.slip_front - at->g.slip_front);
  ramp[1] = r_mul(rate[1], to->g.slip_rear - at->g.slip_rear);
  ramp[2] = r_mul(r_mul(given_speeds, rate[2]), r_mul(to->u.v_front - at->u.v_front, at->s.inv_front));
  ramp[3] = r_mul(r_mul(given_speeds, rate[3]), r_mul(to->u.v_rear - at->u.v_rear, at->s.inv_rear));
}

/* Return whether a brake may stop its wheel within the step h: whether its full torque
 * alone would remove more than half of the wheel speed. The result is 0 with linear tyres
 * (friction 0), because their force has no limit and keeps the wheel turning. */
static int may_lock(const point *at, const wheels *w, tse_real h)
{
  const tse_real v[2] = { at->u.v_front, at->u.v_rear };
  int locks = 0;
  for (int a = 0; a < 2 && w->turning && at->friction > TSE_R(0); a++)
    locks |= r_mul(h, w->brake[a]) > r_mul(TSE_R(0.5), r_abs(v[a]));
  return locks;
}

/* Compute the point at the time h after `at`, where the state has changed by dx.
 *   Updated:  b    state and inputs; effects_at() evaluates the other members
 *             end  LAG states at b */
static void move_point(const point *at, const tse_real lag[4], const tse_real dx[STATE_SIZE],
    const acting *to, tse_real h, point *b, tse_real end[4])
{
  b->vx = at->vx + dx[0];
  b->vy = at->vy + dx[1];
  b->r = at->r + dx[2];
  b->u = to->u;
  if (to->w.turning) {
    b->u.v_front = at->u.v_front + dx[TURNS];
    b->u.v_rear = at->u.v_rear + dx[TURNS + 1];
  }
  b->g = to->g;
  b->w = to->w;
  b->friction = at->friction;
  b->ahead = h;
  for (int i = 0; i < 4; i++) end[i] = lag[i] + dx[LAGS + i];
}

/* Compute the change dx of the state within h. If no wheel may lock, use ROS2
 * (vehicle.h).
 *
 * If a wheel may lock, the stages of ROS2 would jump over the change of sign of the brake
 * torque. Then use the implicit Euler method, with the steering angle and the torques at
 * the end of h. In this method the brake torque is proportional to the wheel speed v at
 * the end of h, with the ratio torque / v at the start. The torque is 0 if this speed is
 * 0, so that a brake never turns a wheel backwards.
 *   Updated:   at  if a wheel may lock: evaluated with the steering angle and the torques
 *                  at the end of h; otherwise unchanged
 *   Returned:  dx */
static void compute_change(
    tse_real h, const tse_effect_memory *m, stiffness k, const acting *to, point *at, tse_real dx[STATE_SIZE])
{
  const int locks = may_lock(at, &to->w, h);
  tse_real f[STATE_SIZE], k1[STATE_SIZE], k2[STATE_SIZE], lag[4],
      ramp[4] = { TSE_R(0), TSE_R(0), TSE_R(0), TSE_R(0) };
  point b;
  if (locks) {
    at->u.steer = to->u.steer;
    at->w = to->w;
    effects_at(at->p, m, m->lag, k, at);
  }
  const solver lu = factor_matrix(at, locks ? h : r_mul(ROS2, h), locks);
  compute_derivatives(at, m->lag, f);
  if (lu.lags && !locks) compute_input_drift(at, to, ramp);
  for (int i = 0; i < 4; i++) f[LAGS + i] += r_mul(ROS2, ramp[i]);
  solve(&lu, f, k1);
  for (int i = 0; i < STATE_SIZE; i++) dx[i] = r_mul(h, k1[i]);
  if (locks) return;
  move_point(at, m->lag, dx, to, h, &b, lag);
  effects_at(at->p, m, lag, k, &b);
  compute_derivatives(&b, lag, f);
  for (int i = 0; i < STATE_SIZE; i++) f[i] = f[i] - k1[i] - k1[i];
  for (int i = 0; i < 4; i++) f[LAGS + i] = f[LAGS + i] - r_mul(ROS2, ramp[i]);
  solve(&lu, f, k2);
  for (int i = 0; i < STATE_SIZE; i++) dx[i] = r_mul(r_mul(TSE_R(0.5), h), k1[i] + k1[i] + k1[i] + k2[i]);
}

/* Integrate one step of h. The point at its end is also the first stage of the
 * next step. */
static void step(
    const tse_params *p, tse_effect_memory *m, stiffness k, const acting *to, tse_real h, point *at)
{
  const tse_effects *const e = &p->effects;
  tse_real dx[STATE_SIZE];
  point b;
  compute_change(h, m, k, to, at, dx);
  move_point(at, m->lag, dx, to, h, &b, m->lag);
  for (int i = 0; i < 4; i++)
    if (r_abs(m->lag[i]) < MIN_MOTION) m->lag[i] = TSE_R(0);
  effects_at(p, m, m->lag, k, &b);
  effects_remember(e, m, at, &b, h);
  b.ahead = TSE_R(0);
  /* b was evaluated with an extrapolated roll angle and, for the formula, extrapolated
   * accelerations. Evaluate it again with the values at the time of b. */
  if (effect_is_on(e, TSE_EFFECT_rear_roll_steer) || formula_is_on(e)) effects_at(p, m, m->lag, k, &b);
  *at = b;
}

void effects_settle(const tse_params *p, tse_effect_memory *m, stiffness k, point *pt)
{
  pt->ahead = TSE_R(0);
  for (int i = 0; i < 3; i++) m->mode[i][0] = m->mode[i][1] = TSE_R(0);
  for (int pass = 0; pass < 3; pass++) { /* pass 0 sets slips, 1 forces and roll, 2 slips with roll steer */
    effects_at(p, m, m->lag, k, pt);
    for (int i = 0; i < 4 && p->effects.mask; i++) m->lag[i] = pt->target[i];
    m->mode[MODE_ROLL][0] = m->mode[MODE_ROLL_STEER][0] = pass ? pt->force.y : TSE_R(0);
    m->mode[MODE_PITCH][0] = pt->force.x;
    if (formula_is_on(&p->effects)) formula_remember(m, pt, 1);
  }
  effects_at(p, m, m->lag, k, pt);
  m->settled = 1;
}

/* Return a + share (b - a). */
static tse_real interpolate(tse_real a, tse_real b, tse_real share) { return a + r_mul(share, b - a); }

/* Return the inputs after k of `steps` equal steps, interpolated linearly. */
static acting interpolate_inputs(const acting *from, const acting *to, int32_t k, int32_t steps)
{
  acting now = *to;
  if (k >= steps) return now;
  const tse_real share = r_div(r_from_int(k), r_from_int(steps));
  const given *const a = &from->g, *const b = &to->g;
  now.u = vehicle_between(from->u, to->u, k, steps);
  now.g.grade = interpolate(a->grade, b->grade, share);
  now.g.bank = interpolate(a->bank, b->bank, share);
  now.g.slip_front = interpolate(a->slip_front, b->slip_front, share);
  now.g.slip_rear = interpolate(a->slip_rear, b->slip_rear, share);
  now.g.x = interpolate(a->x, b->x, share);
  now.g.y = interpolate(a->y, b->y, share);
  now.g.yaw = interpolate(a->yaw, b->yaw, share);
  for (int i = 0; i < 2 && to->w.turning; i++) {
    now.w.drive[i] = interpolate(from->w.drive[i], to->w.drive[i], share);
    now.w.brake[i] = interpolate(from->w.brake[i], to->w.brake[i], share);
  }
  return now;
}

void effects_advance(const tse_params *p, tse_effect_memory *m, stiffness k, const acting *to, tse_real dt,
    int32_t steps, point *at)
{
  const acting from = { at->u, at->g, at->w };
  const tse_real h = r_div(dt, r_from_int(steps));
  for (int32_t i = 1; i <= steps; i++) {
    const acting now = interpolate_inputs(&from, to, i, steps);
    step(p, m, k, &now, h, at);
  }
}
