/* estimator/hypotheses/predict.c - (7): mean by the integrator of model/vehicle.h, covariance by its slopes. */
#include "estimator/hypotheses/predict.h"

#define MOST_STEPS 6 /* of a row: bounded time. The integrator is stable at any step */
#define LOG2_E TSE_R(1.4426950408889634)

/* What a step, or a row, does to small changes of the state (F), of the stiffness (G), and of eps (E). */
typedef struct transition { tse_real F[3][3], G[3][3], E[3][3]; } transition;

static void multiply(tse_real a[3][3], tse_real b[3][3], tse_real c[3][3])
{
  for (int i = 0; i < 3; i++)
    for (int j = 0; j < 3; j++) c[i][j] = r_mul(a[i][0], b[0][j]) + r_mul(a[i][1], b[1][j]) + r_mul(a[i][2], b[2][j]);
}

/* F = (1 - hJ + h^2 J^2/2)^-1: exp(hJ) to second order, and never unstable. S: what a constant rate adds, h F (1 - hJ/2). */
static void exponential(tse_real hJ[3][3], tse_real h, tse_real F[3][3], tse_real S[3][3])
{
  tse_real q[3][3], half[3][3];
  for (int a = 0; a < 3; a++)
    for (int b = 0; b < 3; b++) {
      const tse_real jj = r_mul(hJ[a][0], hJ[0][b]) + r_mul(hJ[a][1], hJ[1][b]) + r_mul(hJ[a][2], hJ[2][b]);
      const tse_real one = a == b ? TSE_R(1) : TSE_R(0);
      q[a][b] = one - hJ[a][b] + r_mul(TSE_R(0.5), jj);
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

/* One step of h seconds: x moves, with the stiffness deviations w; t: what it does to small changes, at its middle. */
static void step(const tse_params *p, tse_hypothesis *hyp, const tse_real w[3], inputs a, inputs b, tse_real h, transition *t)
{
  tse_real middle[6], hJ[3][3], S[3][3], B[3][3];
  tse_real *const x = hyp->x;
  slopes s;
  for (int i = 0; i < 3; i++) middle[i] = x[i];
  vehicle_step(p, &x[0], &x[1], &x[2], vehicle_stiffness(p, w[0], w[1], w[2]), a, b, h);
  for (int i = 0; i < 3; i++) {
    middle[i] = r_mul(TSE_R(0.5), middle[i] + x[i]);
    middle[3 + i] = x[X_STIFFNESS + i];
  }
  vehicle_slopes(p, middle, vehicle_between(a, b, 1, 2), slips_for_slopes(p, hyp), &s);
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
  for (int i = 0; i < 3; i++)
    if (unknown_in_place_of(hyp, i) >= 0) acceleration_column(p, &s, unknown_in_place_of(hyp, i), B, i);
  if (hyp->fault > FAULT_NONE && hyp->fault < FAULT_MEASURED) multiply(S, B, t->E);
  else memcpy(t->E, t->G, sizeof t->E);
}

static void chain(transition *all, transition *next)
{
  transition r;
  multiply(next->F, all->F, r.F);
  multiply(next->F, all->G, r.G);
  multiply(next->F, all->E, r.E);
  for (int i = 0; i < 3; i++)
    for (int j = 0; j < 3; j++) {
      r.G[i][j] += next->G[i][j];
      r.E[i][j] += next->E[i][j];
    }
  *all = r;
}

/* The mean through the row, with this row's eps as its sample has it, and what the row does to small changes. */
static void advance(const tse_params *p, tse_hypothesis *h, inputs from, inputs to, tse_real dt, transition *all)
{
  const int32_t wanted = vehicle_steps(p, dt, from, to), steps = wanted < MOST_STEPS ? wanted : MOST_STEPS;
  const tse_real length = steps > 1 ? r_div(dt, r_from_int(steps)) : dt;
  tse_real w[3], off[3] = { TSE_R(0), TSE_R(0), TSE_R(0) };
  for (int a = 0; a < 3; a++) {
    const int unknown = unknown_in_place_of(h, a);
    w[a] = h->x[X_STIFFNESS + a] - TSE_R(1) + (unknown < 0 ? h->eps[a] : TSE_R(0));
    if (unknown >= 0) off[unknown - BY_STEER] = h->eps[a];
  }
  const inputs first = { from.steer + off[0], from.v_front + off[1], from.v_rear + off[2] };
  const inputs last = { to.steer + off[0], to.v_front + off[1], to.v_rear + off[2] };
  inputs a = first;
  for (int32_t i = 1; i <= steps; i++) {
    const inputs b = vehicle_between(first, last, i, steps);
    transition next;
    step(p, h, w, a, b, length, &next);
    if (i == 1) *all = next;
    else chain(all, &next);
    a = b;
  }
}

/* P through the row: states move with states, stiffness and eps; eps, which is that of this row alone, then goes. */
static void carry(tse_hypothesis *h, transition *t)
{
  tse_real row[3][TSE_X], with_eps[3][3];
  for (int a = 0; a < 3; a++) {
    const tse_real *const F = t->F[a], *const G = t->G[a], *const E = t->E[a];
    for (int j = 0; j < TSE_X; j++)
      row[a][j] = r_mul(F[0], h->cov[0][j]) + r_mul(F[1], h->cov[1][j]) + r_mul(F[2], h->cov[2][j]) + r_mul(G[0], h->cov[3][j]) +
                  r_mul(G[1], h->cov[4][j]) + r_mul(G[2], h->cov[5][j]) + r_mul(E[0], h->eps_x[0][j]) + r_mul(E[1], h->eps_x[1][j]) +
                  r_mul(E[2], h->eps_x[2][j]);
    for (int j = 0; j < 3; j++) {
      with_eps[a][j] = TSE_R(0);
      for (int k = 0; k < 3; k++)
        with_eps[a][j] += r_mul(F[k], h->eps_x[j][k]) + r_mul(G[k], h->eps_x[j][3 + k]) + r_mul(E[k], h->eps_cov[k][j]);
    }
  }
  for (int a = 0; a < 3; a++)
    for (int b = a; b < 3; b++) {
      tse_real sum = TSE_R(0);
      for (int k = 0; k < 3; k++) sum += r_mul(row[a][k], t->F[b][k]) + r_mul(row[a][3 + k], t->G[b][k]) + r_mul(with_eps[a][k], t->E[b][k]);
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
  const tse_real time = h->drift == DRIFTS_SLOWLY ? SLOW_TIME : FAST_TIME, rate = h->drift == DRIFTS_SLOWLY ? SLOW_RATE : FAST_RATE;
  const tse_real grow = r_min(dt, time);
  for (int a = X_STIFFNESS; a < X_BIAS; a++) {
    const tse_real by = r_mul(grow, h->x[a]);
    h->x[a] = r_clamp(h->x[a] + r_mul(by, h->x[X_RATE]), TSE_R(1) + p->w_min, TSE_R(1) + p->w_max); /* through a pause, too */
    for (int j = 0; j < TSE_X; j++) h->cov[a][j] += r_mul(by, h->cov[X_RATE][j]);
    for (int j = 0; j < TSE_X; j++) h->cov[j][a] += r_mul(by, h->cov[j][X_RATE]);
  }
  fade(h, X_RATE, r_exp2(-r_mul(LOG2_E, r_div(dt, time))), r_sqr(rate));
}

void walk(const tse_params *p, tse_hypothesis *h, tse_real dt)
{
  const tse_real by = h->drift == STEADY ? p->steady_walk : r_sqr(h->drift == DRIFTS_SLOWLY ? SLOW_WALK : FAST_WALK);
  const tse_real keep = r_exp2(-r_mul(LOG2_E, r_div(dt, DISTURBANCE_TIME)));
  if (h->drift != STEADY) drift(p, h, dt);
  for (int a = 0; a < 3; a++) {
    const int c = X_STIFFNESS + a, b = X_BIAS + a;
    h->cov[c][c] = r_min(h->cov[c][c] + r_mul(r_mul(by, dt), r_sqr(h->x[c])), r_max(h->cov[c][c], p->mean_var0));
    h->cov[b][b] = r_max(h->cov[b][b], r_min(h->cov[b][b] + r_mul(p->bias_walk[a], dt), r_max(p->bias_var0[a], TSE_R(1))));
    if (h->level[a] > 0 || h->cov[X_SLOW + a][X_SLOW + a] > TSE_R(0)) fade(h, X_SLOW + a, keep, disturbance_var(h, a, h->level[a]));
  }
}

/* Noise of the wheel speeds drives (7); where there is some, slip is smoothed for the slopes. */
static void shake(const tse_params *p, tse_hypothesis *h, inputs to, tse_real dt)
{
  slopes s;
  vehicle_slopes(p, h->x, to, h->slip, &s);
  const tse_real var = r_mul(r_sqr(s.dx[BY_FRONT_WHEELS]), p->wheel_var[0]) + r_mul(r_sqr(s.dx[BY_REAR_WHEELS]), p->wheel_var[1]);
  h->cov[0][0] += r_mul(r_mul(TSE_R(0.5), r_sqr(dt)), var); /* half of each row's noise on either side of it */
  h->slip_share = r_div(dt, dt + SLIP_TIME);
  h->slip[0] += r_mul(h->slip_share, s.s_front - h->slip[0]);
  h->slip[1] += r_mul(h->slip_share, s.s_rear - h->slip[1]);
}

void predict(const tse_params *p, tse_hypothesis *h, inputs from, inputs to, const tse_real push[3], tse_real dt)
{
  transition t;
  inputs end = to;
  if (h->held) end.steer = from.steer;
  advance(p, h, from, end, dt, &t);
  carry(h, &t);
  if (p->wheel_var[0] > TSE_R(0)) shake(p, h, to, dt);
  h->x[0] = vehicle_kept(h->x[0] + push[0], MOST_SPEED);
  h->x[1] = vehicle_kept(h->x[1] + push[1], MOST_SPEED);
  h->x[2] = vehicle_kept(h->x[2] + push[2], MOST_YAW_RATE);
  walk(p, h, dt);
}
