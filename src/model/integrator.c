/* model/integrator.c - the motion of vehicle.h with the effects of effects.h, evaluated at the state of every step. */
#include "model/effects.h"

/* [vx vy r], then the four states of LAG */
enum { MOTION = 7 };

static void motion_of(const tse_effects *e, const point *pt, const tse_real lag[4], tse_real f[MOTION])
{
  f[0] = pt->force.x + r_mul(pt->vy, pt->r);
  f[1] = pt->force.y - r_mul(pt->vx, pt->r);
  f[2] = pt->force.yaw;
  if (!e->mask) return;
  f[0] += pt->gravity_x;
  f[1] += pt->gravity_y;
  if (!effects_lag(e)) return;
  tse_real rate[4];
  effects_lag_rates(e, pt, rate);
  for (int i = 0; i < 4; i++) f[3 + i] = r_mul(rate[i], pt->target[i] - lag[i]);
}

/* 1 - g h J of ROS2, with the states of LAG eliminated: such a state a, a' = rate (alpha - a), answers
 * with b = gh rate/(1 + gh rate) of what its slip does, so that is how much of its tyre's damping is left. */
typedef struct solver {
  const point *at;
  tse_real inv_mx;
  lateral_block side;
  tse_real slow[4], b[4], force[4]; /* 1/(1 + gh rate); b; gh times stiffness over mass */
  int lags;
} solver;

static solver lags_factor(const point *pt, tse_real gh)
{
  solver m;
  const tse_params *const p = pt->p;
  tse_real yf = r_mul(pt->k.y_front, pt->s.inv_body), yr = r_mul(pt->k.y_rear, pt->s.inv_body);
  tse_real xf = r_mul(pt->k.x_front, pt->s.inv_front), xr = r_mul(pt->k.x_rear, pt->s.inv_rear);
  m.at = pt;
  m.lags = effects_lag(&p->effects);
  if (m.lags) {
    const tse_real k[4] = { pt->k.y_front, pt->k.y_rear, pt->k.x_front, pt->k.x_rear };
    tse_real rate[4];
    effects_lag_rates(&p->effects, pt, rate);
    for (int i = 0; i < 4; i++) {
      const int state = rate[i] > TSE_R(0);
      m.slow[i] = r_div(TSE_R(1), TSE_R(1) + r_mul(gh, rate[i]));
      m.b[i] = state ? r_mul(r_mul(gh, rate[i]), m.slow[i]) : TSE_R(1);
      m.force[i] = state ? r_mul(gh, k[i]) : TSE_R(0);
    }
    yf = r_mul(yf, m.b[0]);
    yr = r_mul(yr, m.b[1]);
    xf = r_mul(xf, m.b[2]);
    xr = r_mul(xr, m.b[3]);
  }
  m.inv_mx = r_div(TSE_R(1), TSE_R(1) + r_mul(gh, xf + xr));
  m.side = vehicle_block(p, yf, yr, pt->vx, gh);
  return m;
}

static void lags_solve(const solver *m, const tse_real f[MOTION], tse_real k[MOTION])
{
  const tse_params *const p = m->at->p;
  const slips *const s = &m->at->s;
  tse_real fx = f[0], fy = f[1], fr = f[2], own[4];
  if (m->lags) {
    for (int i = 0; i < 4; i++) own[i] = r_mul(f[3 + i], m->slow[i]);
    const tse_real front = r_mul(m->force[0], own[0]), rear = r_mul(m->force[1], own[1]);
    fx += r_mul(m->force[2], own[2]) + r_mul(m->force[3], own[3]);
    fy += front + rear;
    fr += r_mul(p->jf, front) - r_mul(p->jr, rear);
  }
  k[0] = r_mul(fx, m->inv_mx);
  vehicle_solve(&m->side, fy, fr, &k[1], &k[2]);
  if (m->lags) { /* with the slips' derivatives: d alpha/d vy = -1/v, d alpha/d r = -lf/v, lr/v; d slip/d vx = -1/v */
    k[3] = own[0] - r_mul(r_mul(m->b[0], s->inv_body), k[1] + r_mul(p->lf, k[2]));
    k[4] = own[1] - r_mul(r_mul(m->b[1], s->inv_body), k[1] - r_mul(p->lr, k[2]));
    k[5] = own[2] - r_mul(r_mul(m->b[2], s->inv_front), k[0]);
    k[6] = own[3] - r_mul(r_mul(m->b[3], s->inv_rear), k[0]);
  }
}

/* What the inputs alone change of the lags' derivatives from u0 to u: h df/dt. Added to the first stage of ROS2 and taken from
 * the second, times g, as Rosenbrock methods do with explicit time; without it a lag much shorter than the step, which follows
 * its slip at once, would overshoot by 1/(2 g). */
static void input_drift(const tse_params *p, const point *at, inputs u, const given *g, tse_real ramp[4])
{
  tse_real rate[4];
  effects_lag_rates(&p->effects, at, rate);
  const tse_real ahead = r_mul(r_mul(u.steer - at->u.steer, at->vx), at->s.inv_body);
  ramp[0] = r_mul(rate[0], ahead + g->slip_front - at->g.slip_front);
  ramp[1] = r_mul(rate[1], g->slip_rear - at->g.slip_rear);
  ramp[2] = r_mul(rate[2], r_mul(u.v_front - at->u.v_front, at->s.inv_front));
  ramp[3] = r_mul(rate[3], r_mul(u.v_rear - at->u.v_rear, at->s.inv_rear));
}

static tse_real kept(tse_real x) { return r_abs(x) < LEAST ? TSE_R(0) : x; }

/* ROS2 of vehicle.h. The point at the end is the first stage of the next step, too. */
static void step(const tse_params *p, tse_effect_memory *m, stiffness k, inputs u, const given *g, tse_real h, point *at)
{
  const tse_effects *const e = &p->effects;
  const solver lu = lags_factor(at, r_mul(ROS2, h));
  const tse_real half = r_mul(TSE_R(0.5), h);
  tse_real f[MOTION], k1[MOTION], k2[MOTION], lag[4], ramp[4];
  point b;
  motion_of(e, at, m->lag, f);
  if (lu.lags) {
    input_drift(p, at, u, g, ramp);
    for (int i = 0; i < 4; i++) ramp[i] = r_mul(ROS2, ramp[i]);
    for (int i = 0; i < 4; i++) f[3 + i] += ramp[i];
  }
  lags_solve(&lu, f, k1);
  b.vx = at->vx + r_mul(h, k1[0]);
  b.vy = at->vy + r_mul(h, k1[1]);
  b.r = at->r + r_mul(h, k1[2]);
  b.u = u;
  b.g = *g;
  b.ahead = h;
  for (int i = 0; i < 4; i++) lag[i] = lu.lags ? m->lag[i] + r_mul(h, k1[3 + i]) : TSE_R(0);
  effects_at(p, m, lag, k, &b);
  motion_of(e, &b, lag, f);
  for (int i = 0; i < (lu.lags ? MOTION : 3); i++) f[i] = f[i] - k1[i] - k1[i];
  for (int i = 0; i < 4 && lu.lags; i++) f[3 + i] = f[3 + i] - ramp[i];
  lags_solve(&lu, f, k2);
  b.vx = at->vx + r_mul(half, k1[0] + k1[0] + k1[0] + k2[0]);
  b.vy = at->vy + r_mul(half, k1[1] + k1[1] + k1[1] + k2[1]);
  b.r = at->r + r_mul(half, k1[2] + k1[2] + k1[2] + k2[2]);
  if (lu.lags)
    for (int i = 0; i < 4; i++) m->lag[i] = kept(m->lag[i] + r_mul(half, k1[3 + i] + k1[3 + i] + k1[3 + i] + k2[3 + i]));
  effects_at(p, m, m->lag, k, &b);
  effects_remember(e, m, at, &b, h);
  b.ahead = TSE_R(0);
  /* the roll, and the accelerations that a formula knows, were extrapolated so far */
  if (effect_is_on(e, TSE_EFFECT_rear_roll_steer) || formula_is_on(e)) effects_at(p, m, m->lag, k, &b);
  *at = b;
}

void effects_settle(const tse_params *p, tse_effect_memory *m, stiffness k, point *pt)
{
  pt->ahead = TSE_R(0);
  for (int i = 0; i < 3; i++) m->mode[i][0] = m->mode[i][1] = TSE_R(0);
  for (int pass = 0; pass < 3; pass++) { /* slips, then forces, then what rolls with them */
    effects_at(p, m, m->lag, k, pt);
    for (int i = 0; i < 4 && p->effects.mask; i++) m->lag[i] = pt->target[i];
    m->mode[MODE_ROLL][0] = m->mode[MODE_ROLL_STEER][0] = pass ? pt->force.y : TSE_R(0);
    m->mode[MODE_PITCH][0] = pt->force.x;
    if (formula_is_on(&p->effects)) formula_remember(m, pt, 1);
  }
  effects_at(p, m, m->lag, k, pt);
  m->settled = 1;
}

static given given_between(const given *a, const given *b, tse_real share)
{
  given g;
  g.grade = a->grade + r_mul(share, b->grade - a->grade);
  g.bank = a->bank + r_mul(share, b->bank - a->bank);
  g.slip_front = a->slip_front + r_mul(share, b->slip_front - a->slip_front);
  g.slip_rear = a->slip_rear + r_mul(share, b->slip_rear - a->slip_rear);
  g.x = a->x + r_mul(share, b->x - a->x);
  g.y = a->y + r_mul(share, b->y - a->y);
  g.yaw = a->yaw + r_mul(share, b->yaw - a->yaw);
  return g;
}

void effects_advance(const tse_params *p, tse_effect_memory *m, stiffness k, inputs to, const given *g, tse_real dt, point *at)
{
  const inputs from = at->u;
  const int32_t steps = vehicle_steps(p, dt, from, to);
  if (steps == 1) {
    step(p, m, k, to, g, dt, at);
    return;
  }
  const given before = at->g;
  const tse_real h = r_div(dt, r_from_int(steps));
  for (int32_t i = 1; i <= steps; i++) {
    const given now = given_between(&before, g, i < steps ? r_div(r_from_int(i), r_from_int(steps)) : TSE_R(1));
    step(p, m, k, vehicle_between(from, to, i, steps), &now, h, at);
  }
}
