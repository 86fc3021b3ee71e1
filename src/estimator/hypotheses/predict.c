/* estimator/hypotheses/predict.c - (7): mean by the integrator of model/vehicle.h, covariance by its slopes. */
#include "estimator/hypotheses/predict.h"

#define MOST_STEPS 6 /* of a row: bounded time. The integrator is stable at any step */

/* In registers what is used three times: a row of few samples multiplies thirty times for each hypothesis. */
static void multiply(tse_real a[3][3], tse_real b[3][3], tse_real c[3][3])
{
  const tse_real b00 = b[0][0], b01 = b[0][1], b02 = b[0][2], b10 = b[1][0], b11 = b[1][1], b12 = b[1][2];
  const tse_real b20 = b[2][0], b21 = b[2][1], b22 = b[2][2];
  for (int i = 0; i < 3; i++) {
    const tse_real a0 = a[i][0], a1 = a[i][1], a2 = a[i][2];
    c[i][0] = r_mul(a0, b00) + r_mul(a1, b10) + r_mul(a2, b20);
    c[i][1] = r_mul(a0, b01) + r_mul(a1, b11) + r_mul(a2, b21);
    c[i][2] = r_mul(a0, b02) + r_mul(a1, b12) + r_mul(a2, b22);
  }
}

/* F = (1 - hJ + h^2 J^2/2)^-1: exp(hJ) to second order, and never unstable. S: what a constant rate adds, h F (1 - hJ/2). */
static void exponential(tse_real hJ[3][3], tse_real h, tse_real F[3][3], tse_real S[3][3])
{
  tse_real q[3][3], half[3][3], jj[3][3];
  multiply(hJ, hJ, jj);
  for (int a = 0; a < 3; a++)
    for (int b = 0; b < 3; b++) {
      const tse_real one = a == b ? TSE_R(1) : TSE_R(0);
      q[a][b] = one - hJ[a][b] + r_mul(TSE_R(0.5), jj[a][b]);
      half[a][b] = r_mul(h, one - r_mul(TSE_R(0.5), hJ[a][b]));
    }
  const tse_real c00 = r_mul(q[1][1], q[2][2]) - r_mul(q[1][2], q[2][1]);
  const tse_real c01 = r_mul(q[1][2], q[2][0]) - r_mul(q[1][0], q[2][2]);
  const tse_real c02 = r_mul(q[1][0], q[2][1]) - r_mul(q[1][1], q[2][0]);
  const tse_real inv = r_div(TSE_R(1), r_mul(q[0][0], c00) + r_mul(q[0][1], c01) + r_mul(q[0][2], c02));
  F[0][0] = r_mul(inv, c00);
  F[1][0] = r_mul(inv, c01);
  F[2][0] = r_mul(inv, c02);
  F[0][1] = r_mul(inv, r_mul(q[0][2], q[2][1]) - r_mul(q[0][1], q[2][2]));
  F[1][1] = r_mul(inv, r_mul(q[0][0], q[2][2]) - r_mul(q[0][2], q[2][0]));
  F[2][1] = r_mul(inv, r_mul(q[0][1], q[2][0]) - r_mul(q[0][0], q[2][1]));
  F[0][2] = r_mul(inv, r_mul(q[0][1], q[1][2]) - r_mul(q[0][2], q[1][1]));
  F[1][2] = r_mul(inv, r_mul(q[0][2], q[1][0]) - r_mul(q[0][0], q[1][2]));
  F[2][2] = r_mul(inv, r_mul(q[0][0], q[1][1]) - r_mul(q[0][1], q[1][0]));
  multiply(F, half, S);
}

/* Slopes of the forces, column c, as those of the accelerations of vel_x, vel_y, yaw rate. */
static void acceleration_column(const tse_params *p, const slopes *s, int c, tse_real out[3][3], int to)
{
  out[0][to] = s->dx[c];
  out[1][to] = s->dfront[c] + s->drear[c];
  out[2][to] = r_mul(p->jf, s->dfront[c]) - r_mul(p->jr, s->drear[c]);
}

/* Inputs at both ends of a step or a row; what a lag of LAG_TIME moves the steering by there. */
typedef struct passage { inputs from, to; tse_real later, later_to; } passage;

/* Whether eps stands for an input that is not known, and not for the spread of a stiffness: then E is not G. */
static int has_unknown_input(const tse_hypothesis *h) { return h->fault > FAULT_NONE && h->fault < FAULT_MEASURED; }

/* One step of h seconds: x moves, with the stiffness deviations w; t: what it does to small changes, at its middle; E where it is
 * not G. */
static void step(const tse_params *p, tse_hypothesis *hyp, const tse_real w[3], passage u, tse_real h, transition *t)
{
  tse_real middle[6], hJ[3][3], S[3][3], B[3][3];
  tse_real *const x = hyp->x;
  slopes s;
  for (int i = 0; i < 3; i++) middle[i] = x[i];
  vehicle_step(p, &x[0], &x[1], &x[2], vehicle_stiffness(p, w[0], w[1], w[2]), u.from, u.to, h);
  for (int i = 0; i < 3; i++) {
    middle[i] = r_mul(TSE_R(0.5), middle[i] + x[i]);
    middle[3 + i] = x[X_STIFFNESS + i];
  }
  vehicle_slopes(p, middle, vehicle_between(u.from, u.to, 1, 2), slips_for_slopes(p, hyp), &s);
  for (int i = 0; i < 3; i++) {
    acceleration_column(p, &s, BY_STATE + i, hJ, i);
    acceleration_column(p, &s, BY_STIFFNESS + i, B, i);
  }
  hJ[0][1] += middle[2];
  hJ[0][2] += middle[1];
  hJ[1][0] = hJ[1][0] - middle[2];
  hJ[1][2] = hJ[1][2] - middle[0];
  for (int i = 0; i < 3; i++)
    for (int j = 0; j < 3; j++) hJ[i][j] = r_mul(h, hJ[i][j]);
  exponential(hJ, h, t->F, S);
  multiply(S, B, t->G);
  const tse_real later = r_mul(TSE_R(0.5), u.later + u.later_to), front = r_mul(later, s.dfront[BY_STEER]);
  const tse_real by[3] = { r_mul(later, s.dx[BY_STEER]), front, r_mul(p->jf, front) };
  for (int i = 0; i < 3; i++) t->L[i] = r_mul(S[i][0], by[0]) + r_mul(S[i][1], by[1]) + r_mul(S[i][2], by[2]);
  if (!has_unknown_input(hyp)) return;
  for (int i = 0; i < 3; i++)
    if (unknown_in_place_of(hyp, i) >= 0) acceleration_column(p, &s, unknown_in_place_of(hyp, i), B, i);
  multiply(S, B, t->E);
}

static void chain(transition *all, transition *next, int with_E)
{
  tse_real F[3][3], G[3][3], E[3][3], L[3];
  for (int i = 0; i < 3; i++) {
    const tse_real *const f = next->F[i];
    L[i] = next->L[i] + r_mul(f[0], all->L[0]) + r_mul(f[1], all->L[1]) + r_mul(f[2], all->L[2]);
  }
  multiply(next->F, all->F, F);
  multiply(next->F, all->G, G);
  if (with_E) multiply(next->F, all->E, E);
  for (int i = 0; i < 3; i++) {
    all->L[i] = L[i];
    for (int j = 0; j < 3; j++) {
      all->F[i][j] = F[i][j];
      all->G[i][j] = G[i][j] + next->G[i][j];
      if (with_E) all->E[i][j] = E[i][j] + next->E[i][j];
    }
  }
}

/* The mean through the row, with this row's eps as its sample has it, and what the row does to small changes. */
static void advance(const tse_params *p, tse_hypothesis *h, passage u, tse_real dt, transition *all)
{
  const int32_t wanted = vehicle_steps(p, dt, u.from, u.to), steps = wanted < MOST_STEPS ? wanted : MOST_STEPS;
  const tse_real length = steps > 1 ? r_div(dt, r_from_int(steps)) : dt;
  tse_real w[3], off[3] = { TSE_R(0), TSE_R(0), TSE_R(0) };
  for (int a = 0; a < 3; a++) {
    const int unknown = unknown_in_place_of(h, a);
    w[a] = h->x[X_STIFFNESS + a] - TSE_R(1) + (unknown < 0 ? h->eps[a] : TSE_R(0));
    if (unknown >= 0) off[unknown - BY_STEER] = h->eps[a];
  }
  const inputs first = { u.from.steer + off[0], u.from.v_front + off[1], u.from.v_rear + off[2] };
  const inputs last = { u.to.steer + off[0], u.to.v_front + off[1], u.to.v_rear + off[2] };
  const tse_real grows = steps > 1 ? r_div(u.later_to - u.later, r_from_int(steps)) : u.later_to - u.later;
  passage part = { first, first, u.later, u.later };
  for (int32_t i = 1; i <= steps; i++) {
    transition next;
    part.to = vehicle_between(first, last, i, steps);
    part.later_to = part.later + grows;
    step(p, h, w, part, length, i == 1 ? all : &next);
    if (i > 1) chain(all, &next, has_unknown_input(h));
    part.from = part.to;
    part.later = part.later_to;
  }
  if (!has_unknown_input(h)) memcpy(all->E, all->G, sizeof all->E);
}

/* P through the row: states move with states, stiffness, eps and lag; eps, which is that of this row alone, then goes. What is
 * added to P before is_proper() looks at it must find room in a fixed-point number: sums end saturated. */
static void carry(tse_hypothesis *h, transition *t)
{
  tse_real row[3][TSE_X], with_eps[3][3];
  for (int a = 0; a < 3; a++) {
    const tse_real *const F = t->F[a], *const G = t->G[a], *const E = t->E[a];
    for (int j = 0; j < TSE_X; j++)
      row[a][j] = r_add_sat(r_mul(F[0], h->cov[0][j]) + r_mul(F[1], h->cov[1][j]) + r_mul(F[2], h->cov[2][j]) +
                              r_mul(G[0], h->cov[3][j]) + r_mul(G[1], h->cov[4][j]) + r_mul(G[2], h->cov[5][j]) +
                              r_mul(E[0], h->eps_x[0][j]) + r_mul(E[1], h->eps_x[1][j]) + r_mul(E[2], h->eps_x[2][j]),
                            r_mul(t->L[a], h->cov[X_LAG][j]));
    for (int j = 0; j < 3; j++) {
      with_eps[a][j] = r_mul(t->L[a], h->eps_x[j][X_LAG]);
      for (int k = 0; k < 3; k++)
        with_eps[a][j] += r_mul(F[k], h->eps_x[j][k]) + r_mul(G[k], h->eps_x[j][3 + k]) + r_mul(E[k], h->eps_cov[k][j]);
    }
  }
  for (int a = 0; a < 3; a++)
    for (int b = a; b < 3; b++) {
      tse_real sum = r_mul(row[a][X_LAG], t->L[b]);
      for (int k = 0; k < 3; k++)
        sum = r_add_sat(sum, r_mul(row[a][k], t->F[b][k]) + r_mul(row[a][3 + k], t->G[b][k]) + r_mul(with_eps[a][k], t->E[b][k]));
      h->cov[a][b] = h->cov[b][a] = a == b && sum < STATE_VAR ? STATE_VAR : sum; /* no r_max, which would hide a NaN from is_proper */
    }
  for (int a = 0; a < 3; a++)
    for (int j = 3; j < TSE_X; j++) h->cov[a][j] = h->cov[j][a] = row[a][j];
  memset(h->eps, 0, sizeof h->eps);
  memset(h->eps_x, 0, sizeof h->eps_x);
  memset(h->eps_cov, 0, sizeof h->eps_cov);
}

/* One of X fades to zero, its variance to `var`. */
static void fade(tse_hypothesis *h, int c, tse_real keep, tse_real var)
{
  const tse_real own = r_mul(r_sqr(keep), h->cov[c][c]);
  h->x[c] = r_mul(keep, h->x[c]);
  for (int b = 0; b < TSE_X; b++) h->cov[c][b] = h->cov[b][c] = r_mul(keep, h->cov[c][b]);
  h->cov[c][c] = own + r_mul(TSE_R(1) - r_sqr(keep), var);
}

/* C' = rate C for all stiffnesses; the rate is an Ornstein-Uhlenbeck process. */
static void drift(const tse_params *p, tse_hypothesis *h, tse_real dt)
{
  const tse_real time = h->drift == DRIFTS_SLOWLY ? SLOW_TIME_OLD : FAST_TIME, rate = h->drift == DRIFTS_SLOWLY ? SLOW_RATE : FAST_RATE;
  const tse_real grow = r_min(dt, time);
  for (int a = X_STIFFNESS; a < X_BIAS; a++) {
    const tse_real by = r_mul(grow, h->x[a]);
    h->x[a] = r_clamp(h->x[a] + r_mul(by, h->x[X_RATE]), TSE_R(1) + p->w_min, TSE_R(1) + p->w_max); /* through a pause, too */
    for (int j = 0; j < TSE_X; j++) h->cov[a][j] += r_mul(by, h->cov[X_RATE][j]);
    for (int j = 0; j < TSE_X; j++) h->cov[j][a] += r_mul(by, h->cov[j][X_RATE]);
    if (h->cov[a][a] < TSE_R(0)) h->cov[a][a] = TSE_R(0); /* rounding, through a long pause */
  }
  fade(h, X_RATE, r_exp2(-r_mul(LOG2_E, r_div(dt, time))), r_sqr(rate));
}

void walk(const tse_params *p, tse_hypothesis *h, tse_real dt)
{
  const tse_real by = h->drift == STEADY ? p->steady_walk : r_sqr(h->drift == DRIFTS_SLOWLY ? SLOW_WALK : FAST_WALK);
  const tse_real keep = r_exp2(-r_mul(LOG2_E, r_div(dt, DISTURBANCE_TIME)));
  if (h->drift != STEADY) drift(p, h, dt);
  tse_real *const lag_var = &h->cov[X_LAG][X_LAG];
  *lag_var = r_max(*lag_var, r_min(*lag_var + r_mul(r_sqr(LAG_WALK), dt), p->lag_var0)); /* 0: told, and stays */
  for (int a = 0; a < 3; a++) {
    const int c = X_STIFFNESS + a, b = X_BIAS + a;
    h->cov[c][c] = r_min(h->cov[c][c] + r_mul(r_mul(by, dt), r_sqr(h->x[c])), r_max(h->cov[c][c], p->mean_var0));
    h->cov[b][b] = r_max(h->cov[b][b], r_min(h->cov[b][b] + r_mul(p->bias_walk[a], dt), r_max(p->bias_var0[a], TSE_R(1))));
    if (h->level[a] > 0 || p->model_var > TSE_R(0) || h->cov[X_SLOW + a][X_SLOW + a] > TSE_R(0))
      fade(h, X_SLOW + a, keep, disturbance_var(p, h, a, h->level[a]));
  }
}

/* Noise of the wheel speeds drives (7). */
static void shake(const tse_params *p, tse_hypothesis *h, inputs to, tse_real dt)
{
  slopes s;
  vehicle_slopes(p, h->x, to, NULL, &s);
  const tse_real var = r_mul(r_sqr(s.dx[BY_FRONT_WHEELS]), p->wheel_var[0]) + r_mul(r_sqr(s.dx[BY_REAR_WHEELS]), p->wheel_var[1]);
  h->cov[0][0] += r_mul(r_mul(TSE_R(0.5), r_sqr(dt)), var); /* half of each row's noise on either side of it */
}

/* What noise of the wheel speeds has put into vel_x, which follows them, and what that has in common with the smoothed slips, to
 * first order: with n of variance var at each row and linear between rows, error d of vel_x, slip z,
 *     d' = (1 - f) d + f (n + n')/2,  z' = z + g ((n - d)/v - z),  vel_x moved by a unit of slip so far: w' = (1 - f) w + f z'
 * f: of all axles, share[a] of axle a. */
static void share_noise(const tse_params *p, tse_hypothesis *h, const tse_real inv[2], tse_real g, tse_real dt)
{
  const tse_real level = h->x[X_STIFFNESS], rear = TSE_R(1) + r_mul(p->follow, level - TSE_R(1));
  const tse_real share[2] = { r_min(r_mul(dt, r_mul(r_mul(p->kx_front, level), inv[0])), TSE_R(0.5)),
                              r_min(r_mul(dt, r_mul(r_mul(p->kx_rear, rear), inv[1])), TSE_R(0.5)) };
  const tse_real all = share[0] + share[1], keep = r_max(TSE_R(1) - all, TSE_R(0)), was = h->shaken;
  h->shaken = r_mul(r_sqr(keep), was);
  for (int a = 0; a < 2; a++) {
    const tse_real own = r_mul(TSE_R(0.5), r_mul(share[a], p->wheel_var[a])), fresh = r_mul(r_mul(g, inv[a]), own);
    const tse_real slip = h->with_slip[a] + r_mul(g, r_mul(inv[a], own - was) - h->with_slip[a]);
    h->with_past[a] = r_mul(keep, r_mul(keep, h->with_past[a]) + r_mul(all, slip)) + r_mul(all, fresh);
    h->with_slip[a] = r_mul(keep, slip) + fresh;
    h->shaken += r_mul(share[a], r_mul(own, TSE_R(1) + keep));
  }
}

/* Errors in variables: where wheel speeds are noisy, the slopes by the longitudinal stiffness take the slip of the rows before
 * instead of this row's, whose noise is in the innovation, too (an instrument: Soderstrom & Stoica 1983); smoothed, and shrunk by
 * what of it is noise (1 - var/slip^2, no less than 0: James & Stein 1961), so that noise alone excites nothing. */
static void smooth_slips(const tse_params *p, tse_hypothesis *h, inputs from, tse_real dt)
{
  const slips s = vehicle_slips(p, h->x[0], h->x[1], h->x[2], from);
  const tse_real now[2] = { s.s_front, s.s_rear }, inv[2] = { s.inv_front, s.inv_rear };
  const tse_real g = r_div(dt, dt + SLIP_TIME), left = r_div(g, TSE_R(2) - g);
  share_noise(p, h, inv, g, dt);
  for (int a = 0; a < 2; a++) {
    h->smooth[a] += r_mul(g, now[a] - h->smooth[a]);
    const tse_real var = r_mul(r_mul(left, p->wheel_var[a]), r_sqr(inv[a])), square = r_sqr(h->smooth[a]);
    h->slip[a] = square > var ? h->smooth[a] - r_div(var, h->smooth[a]) : TSE_R(0);
    const tse_real excited = square > var ? r_min(r_div(square, var) - TSE_R(1), TSE_R(1)) : TSE_R(0);
    h->pull[a] = r_mul(h->with_slip[a] - h->with_past[a], excited);
  }
}

void predict(const tse_params *p, tse_hypothesis *h, course from, course to, const tse_real push[3], tse_real dt, transition *did)
{
  transition t;
  if (p->wheel_var[0] > TSE_R(0)) smooth_slips(p, h, from.now, dt);
  passage u = { acting(h, from), acting(h, to), from.late_steer - from.now.steer, to.late_steer - to.now.steer };
  if (h->held) {
    u.to.steer = u.from.steer;
    u.later_to = u.later;
  }
  advance(p, h, u, dt, &t);
  if (did) *did = t;
  carry(h, &t);
  if (p->wheel_var[0] > TSE_R(0)) shake(p, h, to.now, dt);
  h->x[0] = vehicle_kept(h->x[0] + push[0], MOST_SPEED);
  h->x[1] = vehicle_kept(h->x[1] + push[1], MOST_SPEED);
  h->x[2] = vehicle_kept(h->x[2] + push[2], MOST_YAW_RATE);
  walk(p, h, dt);
}
