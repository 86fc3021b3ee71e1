/* filter/output.c - what the filter reports of a row, and whether to act on it. */
#include "filter/filter.h"

static const int32_t stiffness_state[3] = { LCX, LCF, LCR };

/* Variance of state i over the posterior, the uncertain quantities and the events that may have happened; *shift: their mean. SI */
static tse_real variance_of(const tse_params *p, const tse_kalman *k, const tse_real weight[TSE_EVENTS], int i, tse_real *shift)
{
  tse_real var = ud_variance(&k->p, i), mean = TSE_R(0), square = TSE_R(0);
  (void)p;
  for (int q = 0; q < TSE_DOUBTS; q++) var += r_sqr(k->doubt[q][i]);
  for (int n = 0; n < TSE_EVENTS; n++) {
    const tse_event *const a = &k->event[n];
    if (a->kind == EVENT_NONE || weight[n] < TSE_R(1e-6)) continue;
    const tse_real amplitude = r_div(a->score, TSE_R(1) + a->info), off = r_mul(amplitude, a->v[i]);
    mean += r_mul(weight[n], off);
    square += r_mul(weight[n], r_mul(off, off) + r_div(r_sqr(a->v[i]), TSE_R(1) + a->info));
  }
  *shift = r_mul(mean, state_unit[i]);
  return r_mul(r_max(var + square - r_mul(mean, mean), TSE_R(0)), r_sqr(state_unit[i]));
}

void report_row(const tse_params *p, const tse_kalman *k, tse_output *out)
{
  tse_real weight[TSE_EVENTS], shift, var;
  tse_real *const state[3] = { &out->vel_x, &out->vel_y, &out->yaw_rate };
  tse_real *const state_sd[3] = { &out->vel_x_sd, &out->vel_y_sd, &out->yaw_rate_sd };
  tse_real group[GROUPS];
  events_weights(k, weight, group);
  const tse_real none = r_mul(group[0], group[1]);
  for (int i = 0; i < 3; i++) {
    var = variance_of(p, k, weight, VX + i, &shift);
    *state[i] = k->x[VX + i] + shift;
    *state_sd[i] = r_sqrt(var);
    var = variance_of(p, k, weight, BX + i, &shift);
    out->bias[i] = k->x[BX + i] + shift;
    out->bias_sd[i] = r_sqrt(var);
    out->noise[i] = r_sqrt(k->noise[i]);
    var = variance_of(p, k, weight, stiffness_state[i], &shift);
    out->stiffness[i] = r_exp2(r_mul(TSE_R(1.4426950408889634), k->x[stiffness_state[i]] + shift));
    var += r_sqr(MODEL_FLOOR) + p->mass_var;
    out->stiffness_sd[i] = r_mul(out->stiffness[i], r_sqrt(var));
    out->stiffness_spread[i] = r_mul(out->stiffness[i], p->model_sd);
    out->spread_seen[i] = 0;
    out->change_ratio[i] = k->change_kind ? r_exp2(r_mul(TSE_R(1.4426950408889634), k->x[stiffness_state[i]] - k->change_from[i])) : TSE_R(1);
  }
  /* the rear axle slips sideways by force over stiffness: lr r - vy is that much, times what the stiffness may be off by */
  const tse_real across = r_mul(p->lr, out->yaw_rate) - out->vel_y;
  out->vel_y_sd = r_sqrt(r_sqr(out->vel_y_sd) + r_mul(r_sqr(across), r_sqr(MODEL_FLOOR) + p->mass_var));
  out->sideslip = r_max(r_abs(out->vel_x), r_abs(out->vel_y)) < TSE_R(0.01) ? TSE_R(0) : r_atan2(out->vel_y, out->vel_x);
  var = variance_of(p, k, weight, LATE, &shift);
  out->lag_steer = k->x[LATE] + shift;
  out->lag_steer_sd = r_sqrt(var);
  var = variance_of(p, k, weight, LMU, &shift);
  for (int r = 0; r < TSE_REGIMES; r++) out->regime[r] = TSE_R(0);
  for (int n = 0; n < TSE_EVENTS; n++) {
    const int32_t kind = k->event[n].kind;
    if (kind == EVENT_NONE || event_is_small(&k->event[n])) continue;
    out->regime[kind == EVENT_ROAD ? TSE_REGIME_CHANGED : kind <= EVENT_REAR ? TSE_REGIME_AXLE : kind <= EVENT_SLIP_REAR ? TSE_REGIME_SLIDING : TSE_REGIME_FAULT] += weight[n];
  }
  const int recent = k->change_kind != TSE_CHANGE_NONE && k->change_age < RECENT_TIME;
  const int now = k->fault ? TSE_REGIME_FAULT : r_max(r_abs(k->x[SF]), r_abs(k->x[SR])) > p->max_slip ? TSE_REGIME_SLIDING
                : recent ? k->change_kind == TSE_CHANGE_ROAD ? TSE_REGIME_CHANGED : k->change_kind == TSE_CHANGE_RESTART ? TSE_REGIME_RESTARTED : TSE_REGIME_AXLE
                : TSE_REGIME_STEADY;
  out->regime[now] += none;
  out->change_kind = k->change_kind;
  out->change_age = k->change_age;
  out->change_probability = k->change_kind ? none : TSE_R(0);
  out->fault_channel = k->fault;
  out->n_eff = TSE_R(1);
  out->log_evidence = k->log_likelihood;
}

void judge_row(const tse_params *p, const tse_kalman *k, const passage *w, tse_output *out)
{
  for (int a = 0; a < 3; a++) {
    const tse_real var = r_sqr(out->stiffness_sd[a]), most = r_mul(p->valid_var, r_sqr(out->stiffness[a]));
    tse_reason why = TSE_VALID;
    if (w->predicted) why = TSE_INPUT_INVALID;
    else if (w->held) why = TSE_HELD;
    else if (k->seen < START_TIME) why = TSE_STARTING;
    else if (out->regime[TSE_REGIME_FAULT] > MOST_PROBABLE) why = TSE_DIVERGING;
    else if (out->regime[TSE_REGIME_SLIDING] > MOST_PROBABLE) why = TSE_HELD;
    else if (!(var <= most)) {
      tse_real doubts = p->mass_var;
      for (int q = 0; q < TSE_DOUBTS; q++) doubts += r_sqr(r_mul(k->doubt[q][stiffness_state[a]], state_unit[LCX]));
      why = r_mul(doubts, r_sqr(out->stiffness[a])) > r_mul(TSE_R(0.5), var) ? TSE_TOLD_LOOSELY : TSE_UNCERTAIN;
    }
    out->reason[a] = (int32_t)why;
  }
}
