/* estimator/hypotheses/report.c - moments of the mixture, probabilities of the regimes, the last change. */
#include "estimator/hypotheses/report.h"
#include "estimator/hypotheses/consider.h"

static int regime_of(const tse_hypothesis *h)
{
  if (h->fault != FAULT_NONE) return TSE_REGIME_FAULT;
  if (h->slides) return TSE_REGIME_SLIDING;
  if (h->change_kind != TSE_CHANGE_NONE && h->change_age < RECENT_TIME)
    return h->change_kind == TSE_CHANGE_ROAD ? TSE_REGIME_CHANGED : h->change_kind == TSE_CHANGE_RESTART ? TSE_REGIME_RESTARTED : TSE_REGIME_AXLE;
  return h->drift == STEADY ? TSE_REGIME_STEADY : TSE_REGIME_DRIFTING;
}

/* Mean of X[at] over the hypotheses, its variance and what is considered. */
static tse_real mixture(const tse_params *p, const tse_bank *b, const tse_real *w, int at, tse_real *var)
{
  tse_real mean = TSE_R(0), sum = TSE_R(0);
  for (int32_t i = 0; i < b->count; i++) mean += r_mul(w[i], b->h[i].x[at]);
  for (int32_t i = 0; i < b->count; i++) sum += r_mul(w[i], b->h[i].cov[at][at] + r_sqr(b->h[i].x[at] - mean));
  *var = r_max(sum, TSE_R(0)) + (p->considers ? considered_var(p, b, at) : TSE_R(0));
  return mean;
}

static tse_real doubt_of(const tse_params *p, const tse_hypothesis *h, int a)
{
  return r_sqr(r_mul(h->x[X_STIFFNESS + a], doubt_by_levels(p, h->level, a)));
}

/* Relative variance of stiffness a that no covariance knows of: mass, model, what it does not explain. */
static tse_real doubt_beside(const tse_params *p, const tse_bank *b, const tse_real *w, int a)
{
  tse_real sum = p->mass_var + p->model_var;
  for (int32_t i = 0; i < b->count; i++) sum += r_mul(w[i], r_sqr(doubt_by_levels(p, b->h[i].level, a)));
  return sum;
}

static void report_states(const tse_params *p, const tse_bank *b, const tse_real *w, tse_output *out)
{
  tse_real *const state[3] = { &out->vel_x, &out->vel_y, &out->yaw_rate };
  tse_real *const state_sd[3] = { &out->vel_x_sd, &out->vel_y_sd, &out->yaw_rate_sd };
  tse_real var;
  for (int a = 0; a < 3; a++) {
    *state[a] = mixture(p, b, w, a, &var);
    *state_sd[a] = r_sqrt(var);
    out->bias[a] = r_mul(p->sd[a], mixture(p, b, w, X_BIAS + a, &var));
    out->bias_sd[a] = r_mul(p->sd[a], r_sqrt(var));
  }
  /* the rear axle slips sideways by force over stiffness: lr r - vy is that much, times the doubt of the stiffness */
  const tse_real across = r_mul(p->lr, out->yaw_rate) - out->vel_y;
  out->vel_y_sd = r_sqrt(r_sqr(out->vel_y_sd) + r_mul(r_sqr(across), doubt_beside(p, b, w, TSE_CY_REAR)));
  out->lag_steer = r_mul(LAG_TIME, mixture(p, b, w, X_LAG, &var));
  out->lag_steer_sd = r_mul(LAG_TIME, r_sqrt(var));
  out->sideslip = r_max(r_abs(out->vel_x), r_abs(out->vel_y)) < TSE_R(0.01) ? TSE_R(0) : r_atan2(out->vel_y, out->vel_x);
}

static void weights(const tse_bank *b, tse_real w[TSE_HYPOTHESES])
{
  tse_real total = TSE_R(0);
  for (int32_t i = 0; i < b->count; i++) total += w[i] = r_exp2(b->h[i].log_weight);
  for (int32_t i = 0; i < b->count; i++) w[i] = r_div(w[i], total);
}

void bank_doubts(const tse_params *p, const tse_bank *b, const tse_output *out, int a, tse_real *by_what_is_told, tse_real *by_misfit)
{
  tse_real w[TSE_HYPOTHESES];
  weights(b, w);
  *by_what_is_told = r_mul(p->mass_var + p->model_var, r_sqr(out->stiffness[a])) + (p->considers ? considered_var(p, b, X_STIFFNESS + a) : TSE_R(0));
  *by_misfit = TSE_R(0);
  for (int32_t i = 0; i < b->count; i++) *by_misfit += r_mul(w[i], doubt_of(p, &b->h[i], a));
}

static void report_stiffness(const tse_params *p, const tse_bank *b, const tse_real *w, tse_output *out)
{
  const tse_hypothesis *const best = &b->h[b->likeliest];
  for (int a = 0; a < 3; a++) {
    tse_real var;
    out->stiffness[a] = mixture(p, b, w, X_STIFFNESS + a, &var);
    for (int32_t i = 0; i < b->count; i++) var += r_mul(w[i], doubt_of(p, &b->h[i], a));
    var += r_mul(p->mass_var + p->model_var, r_sqr(out->stiffness[a]));
    out->stiffness_sd[a] = r_sqrt(var);
    out->stiffness_spread[a] = r_mul(r_sqrt(best->spread_var[a]), out->stiffness[a]);
    out->spread_seen[a] = best->info[a][a] > SPREAD_SEEN;
    out->noise[a] = r_sqrt(best->noise_var[a]);
    out->discrepancy[a] = r_mul(p->sd[a], r_sqrt(disturbance_var(p, best, a, best->level[a])));
  }
}

static void report_regimes(const tse_bank *b, const tse_real *w, tse_output *out)
{
  const tse_hypothesis *const best = &b->h[b->likeliest];
  tse_real faults[7] = { TSE_R(0), TSE_R(0), TSE_R(0), TSE_R(0), TSE_R(0), TSE_R(0), TSE_R(0) }, squares = TSE_R(0);
  for (int k = 0; k < TSE_REGIMES; k++) out->regime[k] = TSE_R(0);
  out->change_age = best->change_age;
  out->change_kind = best->change_kind;
  out->change_probability = TSE_R(0);
  for (int a = 0; a < 3; a++)
    out->change_ratio[a] = best->change_kind == TSE_CHANGE_NONE ? TSE_R(1) : r_div(best->x[X_STIFFNESS + a], best->before[a]);
  for (int32_t i = 0; i < b->count; i++) {
    const tse_hypothesis *const h = &b->h[i];
    const int same = best->change_kind != TSE_CHANGE_NONE && h->change_kind == best->change_kind &&
                     r_abs(h->change_age - best->change_age) < SAME_CHANGE_TIME;
    out->regime[regime_of(h)] += w[i];
    faults[h->fault] += w[i];
    out->change_probability += same ? w[i] : TSE_R(0);
    squares += r_sqr(w[i]);
  }
  out->fault_channel = 0;
  for (int k = 1; k < 7; k++)
    if (faults[k] > TSE_R(0.5)) out->fault_channel = k;
  out->n_eff = r_div(TSE_R(1), squares);
}

tse_real bank_stiffness_var(const tse_params *p, const tse_bank *b, int a)
{
  tse_real w[TSE_HYPOTHESES], var;
  weights(b, w);
  (void)mixture(p, b, w, X_STIFFNESS + a, &var);
  return var;
}

void bank_report(const tse_params *p, const tse_bank *b, tse_output *out)
{
  tse_real w[TSE_HYPOTHESES];
  weights(b, w);
  report_states(p, b, w, out);
  report_stiffness(p, b, w, out);
  report_regimes(b, w, out);
}
