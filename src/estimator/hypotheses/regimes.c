/* estimator/hypotheses/regimes.c - births, by one rule.
 *
 * A hypothesis of a kind is born from the likeliest, just before a sample, with the prior weight
 *     rate of that kind times the time since it was last tried,
 * and from then on is worth what it foretells. Which kind is tried next, and whom it replaces, is decided by the same number with
 * the evidence of late for that kind added (a running sum that starts anew at zero: Page 1954): the one with the largest posterior
 * mass is born in place of the one with the least, as in the optimal resampling of a discrete set (Fearnhead & Clifford 2003). */
#include "estimator/hypotheses/regimes.h"

#define TRIES 3 /* births tried in a row */

/* ---- where one starts ---------------------------------------------------------------------------------------------- */

void place_states(const tse_params *p, tse_hypothesis *h, const sample *y)
{
  for (int a = 0; a < 3; a++)
    for (int b = 0; b < TSE_X; b++) h->cov[a][b] = h->cov[b][a] = TSE_R(0);
  h->x[0] = vehicle_kept(p->vel_x_from_wheels ? r_mul(TSE_R(0.5), y->u.v_front + y->u.v_rear) : p->vel_x0, MOST_SPEED);
  h->x[1] = TSE_R(0);
  h->x[2] = vehicle_kept(r_mul(y->use[2], r_mul(p->sd[2], y->y[2] - h->x[X_BIAS + 2])), MOST_YAW_RATE);
  for (int a = 0; a < 3; a++) h->cov[a][a] = r_max(r_sqr(p->x_sd0[a]), STATE_VAR);
  memset(h->eps, 0, sizeof h->eps);
  memset(h->eps_x, 0, sizeof h->eps_x);
  memset(h->eps_cov, 0, sizeof h->eps_cov);
}

void start_hypothesis(const tse_params *p, tse_hypothesis *h, const tse_start *s, const sample *y)
{
  memset(h, 0, sizeof *h);
  for (int a = 0; a < 3; a++) {
    const int c = X_STIFFNESS + a, b = X_BIAS + a;
    h->x[c] = r_clamp(TSE_R(1) + s->mu[a], TSE_R(1) + p->w_min, TSE_R(1) + p->w_max);
    h->x[b] = s->bias[a];
    h->cov[c][c] = s->mean_var[a];
    h->cov[b][b] = s->bias_var[a];
    h->spread_var[a] = s->loaded ? r_clamp(s->spread_var[a], LEAST_SPREAD_VAR, p->spread_max_var) : p->initial_spread_var;
    h->noise_var[a] = s->loaded ? r_clamp(s->noise_var[a], LEAST_NOISE_VAR, p->noise_max_var) : TSE_R(1);
    h->level[a] = s->loaded ? s->level[a] : 0;
    h->info[a][a] = r_div(TSE_R(1), r_sqr(SPREAD_PRIOR_SD));
    h->info[3 + a][3 + a] = r_div(TSE_R(1), r_sqr(NOISE_PRIOR_SD));
  }
  h->cov[X_LAG][X_LAG] = p->lag_var0;
  place_states(p, h, y);
  h->held = p->inputs_held == 2 ? s->loaded && s->held : p->inputs_held;
}

/* ---- how likely a birth is ------------------------------------------------------------------------------------------- */

/* Rate at which a drift ends [1/s]. */
static tse_real rate_of_steady(const tse_hypothesis *h)
{
  return h->drift == STEADY ? TSE_R(0) : h->drift == DRIFTS_SLOWLY ? RATE_STEADY_SLOW : RATE_STEADY;
}

tse_real rate_of_end(const tse_hypothesis *h) { return rate_of_steady(h) + (h->fault == FAULT_NONE ? TSE_R(0) : RATE_FAULT_END); }

/* Whether the wheels say how fast the car is: no axle locks or spins alone. */
static int wheels_agree(const tse_params *p, const sample *y)
{
  return r_abs(y->u.v_front - y->u.v_rear) < r_mul(p->max_slip, r_max(r_abs(y->u.v_front), r_abs(y->u.v_rear)));
}

/* Prior rate of a birth of this kind from h [1/s]; 0: impossible. */
static tse_real rate_of(const tse_params *p, const tse_hypothesis *h, const sample *y, int kind, tse_real seen)
{
  /* what is the car's stays: that it is found out only now is the less likely the longer it has been looked at */
  const tse_real of_the_car = r_div(RATE_CAR, seen + RATE_CAR_TIME);
  if (kind <= KIND_REAR) return kind == KIND_ROAD ? RATE_ROAD : RATE_AXLE;
  if (kind < KIND_DRIFT_END) return h->drift == kind - KIND_DRIFT_SLOW + DRIFTS_SLOWLY ? TSE_R(0) : RATE_DRIFT;
  if (kind == KIND_DRIFT_END) return rate_of_steady(h);
  if (kind < KIND_FAULT_END) return h->fault != FAULT_NONE ? TSE_R(0) : RATE_FAULT;
  if (kind == KIND_FAULT_END) return h->fault == FAULT_NONE ? TSE_R(0) : RATE_FAULT_END;
  if (kind < KIND_LEVEL_DOWN) return h->level[kind - KIND_LEVEL_UP] == LEVELS - 1 ? TSE_R(0) : of_the_car;
  if (kind < KIND_RESTART) return h->level[kind - KIND_LEVEL_DOWN] == 0 ? TSE_R(0) : of_the_car;
  if (kind == KIND_RESTART) return RATE_RESTART;
  if (kind == KIND_LOST) return h->slides && wheels_agree(p, y) ? RATE_LOST : TSE_R(0);
  return p->inputs_held == 2 ? of_the_car : TSE_R(0);
}

/* log2 of how much likelier a variance q along v would make the sample; q may be negative. Not as an outlier: far off, where one
 * costs the same with and without q, it is a birth that is missing. */
static tse_real gain_of(const innovation *o, const tse_real v[3], tse_real q)
{
  const tse_real wider = r_max(TSE_R(1) + r_mul(q, quadratic(o, v)), TSE_R(1e-3));
  const tse_real m2 = r_max(o->m2 - r_div(r_mul(q, r_sqr(along(o, v))), wider), TSE_R(0));
  return student_cost(o, o->m2) - student_cost(o, m2) - r_mul(TSE_R(0.5), r_log2(wider));
}

/* What an opened stiffness is relative to: from ice it goes up by a factor. */
static tse_real opened_level(const tse_hypothesis *h, int a) { return r_max(h->x[X_STIFFNESS + a], ROAD_LEAST); }

/* X as far as a change moves it: states, stiffness. */
typedef struct shift { tse_real of[X_BIAS]; } shift;

/* Accelerations ax, ay that were other for some time, and with them the yaw rate, by j of ay. */
static void move(tse_real ax, tse_real ay, tse_real j, tse_real time, shift *u)
{
  u->of[0] += r_mul(time, ax);
  u->of[1] += r_mul(time, ay);
  u->of[2] += r_mul(time, r_mul(j, ay));
}

/* What a change of stiffness a by `by` has moved when it is found `time` later, by its forces: o has their slopes. Added to u. */
static void add_change(const tse_params *p, const innovation *o, int a, tse_real by, tse_real time, shift *u)
{
  const int c = X_STIFFNESS + a;
  move(r_mul(p->sd[0], in_sigma(o, 0, o->h[0][c])), r_mul(p->sd[1], in_sigma(o, 1, o->h[1][c])), a == TSE_CY_REAR ? -p->jr : p->jf, r_mul(by, time), u);
  u->of[c] += by;
}

/* What a steering angle that is off by `by` has moved. */
static void add_steer(const tse_params *p, const innovation *o, tse_real by, tse_real time, shift *u)
{
  move(r_mul(p->sd[0], in_sigma(o, 0, o->unknown[0][0])), r_mul(p->sd[1], in_sigma(o, 1, o->unknown[1][0])), p->jf, r_mul(by, time), u);
}

/* log2 of how much likelier a variance q along u would make the sample. */
static tse_real gain_of_shift(const innovation *o, const shift *u, tse_real q)
{
  tse_real v[3] = { TSE_R(0), TSE_R(0), TSE_R(0) };
  for (int i = 0; i < 3; i++)
    for (int k = 0; k < X_BIAS; k++) v[i] += r_mul(u->of[k], o->h[i][k]);
  return gain_of(o, v, q);
}

static tse_real promise_of_fault(const tse_params *p, const tse_bank *b, const tse_hypothesis *h, const sample *y, const innovation *o,
                                 int channel)
{
  tse_real v[3] = { TSE_R(0), TSE_R(0), TSE_R(0) }, q;
  if (channel < 3) {
    shift u = { { TSE_R(0) } };
    if (channel == 0) add_steer(p, o, TSE_R(1), r_mul(CHANGE_ROWS, y->dt), &u);
    for (int i = 0; i < 3; i++) {
      v[i] = o->unknown[i][channel];
      for (int k = 0; k < 3; k++) v[i] += r_mul(u.of[k], o->h[i][k]);
    }
    q = r_sqr(channel == 0 ? FAULT_STEER_SD : FAULT_WHEEL_SD);
  } else {
    v[channel - 3] = in_units(o, channel - 3, TSE_R(1));
    q = r_mul(FAULT_NOISE, h->noise_var[channel - 3]);
  }
  return gain_of(o, v, q) + promise_of_repeat(&b->repeats, o, v, q, channel);
}

static tse_real promise_of_fault_end(const tse_hypothesis *h, const innovation *o)
{
  tse_real v[3] = { TSE_R(0), TSE_R(0), TSE_R(0) };
  const int a = h->fault == FAULT_STEER ? TSE_CY_FRONT : TSE_CX_FRONT;
  if (h->fault >= FAULT_MEASURED) {
    const int c = h->fault - FAULT_MEASURED;
    v[c] = TSE_R(1);
    return gain_of(o, v, in_units(o, c, in_units(o, c, h->noise_var[c])) - o->noise[c]);
  }
  for (int i = 0; i < 3; i++) v[i] = o->d[i][a];
  return gain_of(o, v, -o->eps_var[a]);
}

/* Of one whose states, and with a restart whose stiffness, start anew: it foretells what is sensed to what these are unknown by, and
 * is off by as much as it says. What explains the same by less must have had the time to show that it does. */
static tse_real promise_of_restart(const tse_params *p, const sample *y, const innovation *o, int kind)
{
  tse_real of[3], off = TSE_R(0);
  for (int a = 0; a < 3; a++) {
    tse_real var = TSE_R(1);
    for (int b = 0; b < 3; b++) var += r_sqr(r_mul(in_sigma(o, a, o->h[a][b]), p->x_sd0[b]));
    if (kind == KIND_RESTART) var += r_mul(p->mean_var0, r_sqr(r_mul(y->use[a], y->y[a])));
    of[a] = var;
    off += y->use[a];
  }
  const tse_real better = student_cost(o, o->m2) - student_cost(o, off) + r_mul(TSE_R(0.5), o->log2_det - r_log2_of_product(of[2], of[1], of[0]));
  return r_mul(r_div(y->dt, y->dt + PROTECTED_TIME), better);
}

/* log2 of how much better this sample would have been foretold by a birth of this kind; 0 where that cannot be said beforehand. */
static tse_real promise_of(const tse_params *p, const tse_bank *b, const tse_hypothesis *h, const sample *y, const innovation *o, int kind)
{
  tse_real v[3] = { TSE_R(0), TSE_R(0), TSE_R(0) };
  if (kind <= KIND_REAR) {
    shift u = { { TSE_R(0) } };
    for (int a = 0; a < 3; a++)
      if (kind == KIND_ROAD || a == (kind == KIND_FRONT ? TSE_CY_FRONT : TSE_CY_REAR))
        add_change(p, o, a, opened_level(h, a), r_mul(CHANGE_ROWS, y->dt), &u);
    return gain_of_shift(o, &u, r_sqr(kind == KIND_ROAD ? ROAD_COMMON : AXLE_OPEN));
  }
  if (kind >= KIND_FAULT && kind < KIND_FAULT_END) return promise_of_fault(p, b, h, y, o, kind - KIND_FAULT);
  if (kind == KIND_FAULT_END) return promise_of_fault_end(h, o);
  if (kind >= KIND_LEVEL_UP && kind < KIND_LEVEL_DOWN) {
    const int a = kind - KIND_LEVEL_UP;
    v[a] = TSE_R(1);
    return gain_of(o, v, disturbance_var(p, h, a, h->level[a] + 1) - disturbance_var(p, h, a, h->level[a]));
  }
  /* sliding, a sample tells of the motion alone */
  if (kind == (o->slides ? KIND_LOST : KIND_RESTART)) return promise_of_restart(p, y, o, kind);
  return TSE_R(0);
}

/* ---- what a birth changes -------------------------------------------------------------------------------------------- */

static void open_along(tse_hypothesis *h, const shift *u)
{
  for (int i = 0; i < X_BIAS; i++)
    for (int j = 0; j < X_BIAS; j++) h->cov[i][j] += r_mul(u->of[i], u->of[j]);
}

/* A change that happened CHANGE_ROWS ago: each stiffness, all of a road together, and the states as far as it has moved them. */
static void open_change(const tse_params *p, const innovation *o, tse_hypothesis *h, int kind, tse_real dt)
{
  const tse_real time = r_mul(CHANGE_ROWS, dt);
  shift together = { { TSE_R(0) } };
  for (int a = 0; a < 3; a++) {
    const int front = a != TSE_CY_REAR, own_axle = kind == KIND_FRONT ? front : kind == KIND_REAR ? !front : 1;
    shift own = { { TSE_R(0) } };
    h->before[a] = h->x[X_STIFFNESS + a];
    if (!own_axle) continue;
    add_change(p, o, a, r_mul(kind == KIND_ROAD ? ROAD_OWN : AXLE_OPEN, opened_level(h, a)), time, &own);
    open_along(h, &own);
    if (kind == KIND_ROAD) add_change(p, o, a, r_mul(ROAD_COMMON, opened_level(h, a)), time, &together);
  }
  open_along(h, &together);
  for (int a = 0; a < 2; a++) h->cov[a][a] += r_sqr(r_mul(r_mul(ROAD_COMMON, time), r_mul(p->sd[a], h->foretold[a]))); /* how long ago */
  h->cov[2][2] += r_sqr(p->sd[2]);
  for (int a = 0; a < 3; a++) h->level[a] = 0; /* what the model did not explain may have been this */
  h->change_age = TSE_R(0);
  h->change_kind = kind == KIND_ROAD ? TSE_CHANGE_ROAD : kind == KIND_FRONT ? TSE_CHANGE_FRONT : TSE_CHANGE_REAR;
}

static void start_over(const tse_params *p, tse_hypothesis *h, const sample *y)
{
  tse_start s;
  tse_real before[3];
  for (int a = 0; a < 3; a++) before[a] = h->x[X_STIFFNESS + a];
  start_of_settings(p, &s);
  start_hypothesis(p, h, &s, y);
  for (int a = 0; a < 3; a++) h->before[a] = before[a];
  h->change_kind = TSE_CHANGE_RESTART;
}

static void set_drift(tse_hypothesis *h, int32_t drift)
{
  h->drift = drift;
  h->x[X_RATE] = TSE_R(0);
  for (int j = 0; j < TSE_X; j++) h->cov[X_RATE][j] = h->cov[j][X_RATE] = TSE_R(0);
  h->cov[X_RATE][X_RATE] = drift == STEADY ? TSE_R(0) : r_sqr(drift == DRIFTS_SLOWLY ? SLOW_RATE : FAST_RATE);
}

/* A channel that lies; a steering angle since CHANGE_ROWS ago, and the states as far as it has moved them. The speeds of the wheels
 * lie by so much that a slope says nothing of where they have led. */
static void open_fault(const tse_params *p, const innovation *o, tse_hypothesis *h, int channel, tse_real dt)
{
  shift u = { { TSE_R(0) } };
  h->fault = channel + 1;
  if (h->fault == FAULT_STEER) add_steer(p, o, FAULT_STEER_SD, r_mul(CHANGE_ROWS, dt), &u);
  open_along(h, &u);
}

/* The child of `parent` that says that what `kind` stands for has just happened. It may take the place of its parent. */
static void bear(const tse_params *p, tse_hypothesis *child, const tse_hypothesis *parent, int kind, const sample *y, const innovation *o)
{
  if (child != parent) *child = *parent;
  if (kind <= KIND_REAR) open_change(p, o, child, kind, y->dt);
  else if (kind <= KIND_DRIFT_END) set_drift(child, kind == KIND_DRIFT_END ? STEADY : kind - KIND_DRIFT_SLOW + DRIFTS_SLOWLY);
  else if (kind < KIND_FAULT_END) open_fault(p, o, child, kind - KIND_FAULT, y->dt);
  else if (kind == KIND_FAULT_END) child->fault = FAULT_NONE;
  else if (kind < KIND_LEVEL_DOWN) {
    const int a = kind - KIND_LEVEL_UP, c = X_SLOW + a;
    child->cov[c][c] += disturbance_var(p, child, a, child->level[a] + 1) - disturbance_var(p, child, a, child->level[a]);
    child->level[a]++;
  } else if (kind < KIND_RESTART) child->level[kind - KIND_LEVEL_DOWN]--;
  else if (kind == KIND_RESTART) start_over(p, child, y);
  else if (kind == KIND_LOST) place_states(p, child, y);
  else child->held = !child->held;
  child->age = TSE_R(0);
  child->kind = kind;
}

/* ---- whose place it takes -------------------------------------------------------------------------------------------- */

/* What goes on for long shows slowly, what happens at once must be there when it does: each sort has places of its own, so that
 * none starves another. */
enum { SORT_EVENT, SORT_DRIFT, SORT_DISTURBANCE, SORTS };

static int sort_of(int kind)
{
  if (kind >= KIND_DRIFT_SLOW && kind <= KIND_DRIFT_END) return SORT_DRIFT;
  return kind >= KIND_LEVEL_UP && kind < KIND_RESTART ? SORT_DISTURBANCE : SORT_EVENT;
}

/* How long a birth may need before it shows. */
static tse_real time_to_show(int kind)
{
  if (kind == KIND_DRIFT_FAST) return DRIFT_TIME;
  if (sort_of(kind) == SORT_DRIFT) return r_mul(TSE_R(4), DRIFT_TIME);
  return sort_of(kind) == SORT_DISTURBANCE ? LEVEL_TIME : PROTECTED_TIME;
}

/* A free place, or that of the least likely of a sort that has more than its share; a sort that has no place of its own, because
 * there are few, may take any. -1: none that is worth less. */
static int32_t place_for(const tse_params *p, const tse_bank *b, int kind, tse_real worth)
{
  const int32_t others = p->hypotheses - 1, drifts = (others + 2) / 5, disturbances = 2 * others / 5;
  const int32_t share[SORTS] = { others - drifts - disturbances, drifts, disturbances };
  const int sort = sort_of(kind);
  int32_t at = -1, have[SORTS] = { 0, 0, 0 };
  tse_real least = TSE_R(0);
  if (b->count < p->hypotheses) return b->count;
  for (int32_t i = 0; i < b->count; i++) have[sort_of(b->h[i].kind)] += i != b->likeliest;
  for (int32_t i = 0; i < b->count; i++) {
    const tse_hypothesis *const h = &b->h[i];
    const int theirs = sort_of(h->kind);
    if (i == b->likeliest) continue;
    if (theirs != sort && share[sort] > 0 && (have[theirs] <= share[theirs] || have[sort] >= share[sort])) continue;
    const tse_real value = h->log_weight + (h->age < time_to_show(h->kind) ? YOUTH + h->promise : TSE_R(0));
    if (at < 0 || value < least) {
      least = value;
      at = i;
    }
  }
  return at >= 0 && least < worth ? at : -1;
}

static int largest(const tse_real worth[TSE_KINDS])
{
  int best = 0;
  for (int k = 1; k < TSE_KINDS; k++)
    if (worth[k] > worth[best]) best = k;
  return best;
}

/* Of whom one is born: of the likeliest; a fault, where the likeliest speaks of a change that is younger than it takes to show, of
 * the likeliest that does not: a channel that lies looks like a change at first. */
static const tse_hypothesis *mother_of(const tse_bank *b, int kind)
{
  const tse_hypothesis *const best = &b->h[b->likeliest], *elder = NULL;
  if (kind < KIND_FAULT || kind >= KIND_FAULT_END || best->change_kind == TSE_CHANGE_NONE || !(best->change_age < PROTECTED_TIME)) return best;
  for (int32_t i = 0; i < b->count; i++) {
    const tse_hypothesis *const h = &b->h[i];
    const int old = h->change_kind == TSE_CHANGE_NONE || !(h->change_age < PROTECTED_TIME);
    if (old && h->fault == FAULT_NONE && (!elder || h->log_weight > elder->log_weight)) elder = h;
  }
  return elder ? elder : best;
}

void births(const tse_params *p, tse_bank *b, const sample *y, const innovation *o)
{
  const tse_hypothesis *const parent = &b->h[b->likeliest];
  tse_real worth[TSE_KINDS], prior[TSE_KINDS];
  for (int k = 0; k < TSE_KINDS; k++) {
    const tse_real rate = rate_of(p, parent, y, k, b->seen);
    b->waited[k] = rate > TSE_R(0) ? r_min(b->waited[k] + y->dt, LONGEST_WAIT) : TSE_R(0);
    b->score[k] = rate > TSE_R(0) ? r_max(TSE_R(0), b->score[k] + promise_of(p, b, parent, y, o, k)) : TSE_R(0);
    prior[k] = rate > TSE_R(0) ? r_log2(r_min(r_mul(rate, b->waited[k]), TSE_R(0.5))) : LEAST_WEIGHT;
    worth[k] = prior[k] + b->score[k];
  }
  for (int n = 0; n < TRIES; n++) {
    const int kind = largest(worth);
    if (!(worth[kind] > LEAST_WEIGHT)) return;
    const int32_t at = place_for(p, b, kind, worth[kind]);
    worth[kind] = LEAST_WEIGHT;
    if (at < 0) continue;
    const tse_hypothesis *const mother = mother_of(b, kind);
    const tse_real log_weight = mother->log_weight; /* it may be her place */
    bear(p, &b->h[at], mother, kind, y, o);
    b->h[at].log_weight = r_max(log_weight + prior[kind], LEAST_WEIGHT);
    b->h[at].promise = b->score[kind];
    b->score[kind] = b->waited[kind] = TSE_R(0);
    if (at == b->count) b->count++;
  }
}
