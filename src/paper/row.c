/* paper/row.c - process a row of tse_step() with the particle filter: everything around
 * Algorithm 1. The paper assumes rows at intervals of Ts, a car that drives forward, and
 * measurements of all channels. A row is only predicted, with the mean stiffness and
 * without an update of the statistics, if the car is too slow, drives in reverse or
 * steers too much, or if an input or all measurements are missing. After a gap in the log
 * the motion is initialised again. */
#include "paper/paper.h"

#define REVERSE_SPEED TSE_R(-0.1) /* [m/s] wheel speed below which the car is in reverse */
#define EXCITATION_TIME TSE_R(0.1) /* [s] time constant of the low pass of the regressors */
#define MAX_REGRESSOR TSE_R(1e6) /* [1] max of a regressor (acceleration per w, divided by the sd of its
                                  * sensor), so that computing its square does not overflow */

/* Classification of a row. */
typedef struct row_kind {
  int gap;            /* 1: too long after the previous row; the motion is initialised again */
  int held;           /* 1: too slow, in reverse or steering too much: equation (4) is not valid */
  int predicted;      /* 1: no update, because an input or all measurements are missing */
  int32_t excited[3]; /* 1: recent inputs excite the stiffness: it can be estimated */
} row_kind;

static tse_real find_max_wheel_speed(const sample *y)
{
  return r_max(r_abs(y->u.v_front), r_abs(y->u.v_rear));
}

/* Find the stiffnesses that recent inputs have excited. A stiffness can be observed only
 * while its force changes: with a constant slip or slip angle, a different velocity with
 * a different stiffness fits the data equally well.
 *
 * Let w be the relative deviation of the stiffness from nominal, and the regressor phi
 * the derivative of the measured acceleration with respect to w, divided by the sd of the
 * accelerometer (an element of d in equation (9)). In every sample, w differs at random
 * from its mean, with the sd stiffness_spread (s). The noise variance of a sample,
 * divided by the variance of the accelerometer, is therefore 1 + phi^2 s^2. The mean of
 * w, estimated from n = p->memory samples, then has the variance
 *   (1 + E[phi^2] s^2)/(n var(phi)).
 * The stiffness counts as excited if this variance is at most valid_sd^2. Otherwise its
 * estimate is reported, but as not valid. E and var are taken over about 2 n samples,
 * because the estimated velocity, from which phi is computed, settles more slowly than
 * the estimated stiffness. Regressors are low-passed first, because noise of a wheel
 * speed looks like slip but does not move the car. */
void paper_excitation(
    const tse_params *p, tse_filter_paper *f, const sample *y, const tse_output *est, int32_t excited[3])
{
  const slips s = vehicle_slips(p, est->vel_x, est->vel_y, est->yaw_rate, y->u);
  const observation o = particle_observation(
      particle_observation_gains(p, TSE_R(1), TSE_R(1)), s, y->u.steer);
  const tse_real phi[3] = { o.d11, o.d22, o.d23 };
  const tse_real window = r_mul(TSE_R(2), p->memory), seen = f->filter.seen;
  const tse_real smooth = r_div(y->dt, y->dt + EXCITATION_TIME);
  const tse_real gain = r_div(TSE_R(1), r_min(window, seen + TSE_R(1)));
  for (int a = 0; a < 3; a++) {
    f->excite[a] += r_mul(smooth, r_clamp(phi[a], -MAX_REGRESSOR, MAX_REGRESSOR) - f->excite[a]);
    f->excite_mean[a] += r_mul(gain, f->excite[a] - f->excite_mean[a]);
    f->excite_sq[a] += r_mul(gain, r_mul(f->excite[a], f->excite[a]) - f->excite_sq[a]);
    const tse_real var = f->excite_sq[a] - r_mul(f->excite_mean[a], f->excite_mean[a]);
    const tse_real spread_var = r_mul(est->stiffness_spread[a], est->stiffness_spread[a]);
    const tse_real noise = TSE_R(1) + r_mul(f->excite_sq[a], spread_var), signal = r_mul(p->memory, var);
    excited[a] = noise <= r_mul(p->valid_var, signal);
  }
}

/* Advance the particles to this row. Up to the first row with all inputs, initialise
 * them. After a gap, initialise only their motion. In all other rows, predict them,
 * unless the inputs have been missing for longer than max_gap: then the motion is
 * kept. */
static row_kind advance_particles(const tse_params *p, tse_filter_paper *f, const sample *y)
{
  tse_filter *const c = &f->filter;
  row_kind k = { 0, 0, 0, { 0, 0, 0 } };
  const int lost = c->held_for > p->max_gap;
  c->held_for = y->has_inputs ? TSE_R(0) : r_add_sat(c->held_for, y->dt);
  k.predicted = !y->has_inputs || y->used == 0;
  k.held = find_max_wheel_speed(y) < p->hold_speed || y->u.v_front < REVERSE_SPEED
      || y->u.v_rear < REVERSE_SPEED || r_abs(y->u.steer) > p->max_steer;
  if (!c->started) {
    paper_start(p, f, y); /* in every row up to the first with all inputs */
    c->started = y->has_inputs;
    return k;
  }
  const int frozen = c->held_for > p->max_gap;
  k.gap = !frozen && (y->dt > p->max_gap || lost);
  if (!frozen && !k.gap) paper_predict(p, f, y);
  else paper_predict_bias(p, f, y->dt);
  if (k.gap) paper_place(p, f, y);
  return k;
}

/* Report a row without an update. Replace w of each particle by its mean mu, so that the
 * next row is predicted with the mean stiffness. */
static void report_held(const tse_params *p, tse_filter_paper *f, tse_output *now)
{
  now->n_eff = paper_effective_size(p, f);
  paper_estimate(p, f, now);
  for (int a = 0; a < 3; a++)
    for (int32_t i = 0; i < pad_count(p->particles); i++) f->p.w[a][i] = f->p.mu[a][i];
}

/* Set the reason of each stiffness: TSE_VALID or, if it is not valid, the first reason
 * that applies. Return the status of the row. */
static tse_status judge_stiffness(
    const tse_params *p, tse_filter_paper *f, const sample *y, const row_kind *k, tse_output *now)
{
  tse_status status = TSE_OK;
  const int starting = f->filter.seen < p->memory + p->memory;
  for (int a = 0; a < 3; a++) {
    const tse_real var = r_mul(now->stiffness_sd[a], now->stiffness_sd[a]) + p->mass_var;
    tse_reason why = TSE_VALID;
    if (k->predicted) why = TSE_INPUT_INVALID;
    else if (k->held) why = TSE_HELD;
    else if (starting) why = TSE_STARTING;
    else if (!k->excited[a]) why = TSE_NOT_EXCITED;
    else if (var > p->valid_var)
      why = p->mass_var > r_mul(TSE_R(0.5), var) ? TSE_PARAMETERS_UNCERTAIN : TSE_UNCERTAIN;
    now->reason[a] = (int32_t)why;
    now->spread_seen[a] = why == TSE_VALID;
    if (why != TSE_VALID) status = worse(status, TSE_W_NOT_VALID);
    else f->filter.known[a] = TSE_KNOWN;
  }
  if (starting) status = worse(status, TSE_W_STARTING);
  if (y->used < 3) status = worse(status, TSE_W_MISSING_CHANNEL);
  if (k->held) status = worse(status, TSE_W_HELD);
  if (k->predicted) status = worse(status, TSE_W_PREDICTED);
  return k->gap ? worse(status, TSE_W_GAP) : status;
}

tse_status step_particles(const tse_params *p, tse_filter *c, const tse_input *u, tse_output *out)
{
  tse_filter_paper *const f = (tse_filter_paper *)c;
  tse_output now;
  tse_real evidence = TSE_R(0);
  sample y;
  const tse_status refused = input_decode(p, c, u, &y);
  if (refused < 0) return refused; /* f is unchanged */

  row_kind k = advance_particles(p, f, &y);
  c->steer = y.u.steer;
  c->v_front = y.u.v_front;
  c->v_rear = y.u.v_rear;

  memset(&now, 0, sizeof now);
  if (k.gap) y.dt = p->sample_time; /* forgetting, (17), counts a gap as one sample time */
  if (k.held || k.predicted) report_held(p, f, &now);
  else {
    paper_update(p, f, &y, &now, &evidence);
    paper_excitation(p, f, &y, &now, k.excited);
    c->seen = r_min(c->seen + TSE_R(1), r_mul(TSE_R(5), p->memory));
  }
  for (int a = 0; a < 3; a++) now.noise[a] = now.change_ratio[a] = TSE_R(1);
  now.log_evidence = r_mul(LN_2, evidence);
  c->step++;
  now.status = (int32_t)judge_stiffness(p, f, &y, &k, &now);
  if (out) *out = now;
  return (tse_status)now.status;
}
