/* src/filter.c - reset and step: the page to read first. Algorithm 1 is in step_row(); the files it calls stand in
 * src/CMakeLists.txt in the same order. */
#include "stages.h"

#define STILL_SPEED TSE_R(0.02)   /* m/s: wheels that turn slower stand                                        */
#define STILL_TIME TSE_R(0.5)     /* s:   before the gyro is believed to read its bias; encoders stop counting
                                          a little before the car stops                                        */
#define REVERSE_SPEED TSE_R(-0.1) /* m/s */
#define LEVEL_TIME TSE_R(5)       /* s:   time constants of the running evidence, slow                         */
#define FAST_TIME TSE_R(0.2)      /* s:   and fast                                                             */
#define SETTLE_TIME TSE_R(2)      /* s:   after a recovery nothing is valid for so long                        */
#define TRIED_TIME TSE_R(0.5)     /* s:   after a contradiction                                                */
#define ABSURD TSE_R(29)          /* log2, 20 nats: innovations of 3.6 sigma in each channel, row after row; three times
                                     the noise in the settings costs 13 nats                              */
#define LN_2 TSE_R(0.69314718055994531)

tse_status tse_reset(const tse_params *p, tse_filter *f, size_t filter_bytes)
{
  if (!p || !f) return TSE_E_NULL;
  if (p->magic != TSE_PARAMS_MAGIC) return TSE_E_STATE;
  if (filter_bytes != sizeof *f) return TSE_E_SIZE;
  memset(f, 0, sizeof *f);
  f->magic = TSE_FILTER_MAGIC;
  f->fingerprint = p->fingerprint;
  return TSE_OK;
}

static void use_mean_stiffness(const tse_params *p, tse_particles *q)
{
  for (int a = 0; a < 3; a++)
    for (int32_t i = 0; i < padded(p->particles); i++) q->w[a][i] = q->mu[a][i];
}

static void resample_now(const tse_params *p, tse_filter *f)
{
  resample(p->resampling, f->weight, p->particles, p->seed, f->step, f->ancestor);
  keep_survivors(f->ancestor, f->copies, p->particles);
  copy_particles(&f->p, f->ancestor, p->particles);
  for (int32_t i = 0; i < padded(p->particles); i++) {
    f->p.logw[0][i] = TSE_R(0);
    f->weight[i] = i < p->particles ? TSE_R(1) : TSE_R(0);
  }
  f->log_total = r_log2(r_from_int(p->particles));
}

/* Evidence against its own running level, both in log2 per row.   Returned: 1 when it has stayed too far below.
 * The level does not sink with a filter that is wrong and stays wrong: it ends ABSURD below the best that could be.
 * One row counts no more than four times the drop, so that a lone outlier does not raise the alarm. */
static int evidence_is_lost(const tse_params *p, tse_filter *f, const sample *y, tse_real evidence, tse_real best)
{
  if (y->used < 3) return 0; /* the density of fewer channels has another level */
  if (!(f->evidence_age > TSE_R(0))) f->evidence_slow = f->evidence_fast = evidence;
  f->evidence_slow = r_max(f->evidence_slow, best - ABSURD);
  const tse_real floor = f->evidence_slow - r_mul(TSE_R(4), p->watchdog_drop);
  const tse_real e = r_max(evidence, floor);
  /* a running mean from the start: the time constant grows with age */
  f->evidence_age = r_min(f->evidence_age + y->dt, LEVEL_TIME);
  f->evidence_slow += r_mul(r_div(y->dt, f->evidence_age), e - f->evidence_slow);
  f->evidence_fast += r_mul(r_div(y->dt, r_min(FAST_TIME + y->dt, f->evidence_age)), e - f->evidence_fast);
  if (f->evidence_age < SETTLE_TIME || f->settle > TSE_R(0)) return 0;
  return f->evidence_fast < f->evidence_slow - p->watchdog_drop;
}

/* No car that tyres hold goes this much sideways, or this far from what its wheels say: half of its speed. */
static int state_is_absurd(const tse_output *est, const sample *y, tse_real fastest)
{
  const tse_real most = r_mul(TSE_R(0.5), fastest) + TSE_R(1);
  const tse_real wheels = r_mul(TSE_R(0.5), y->u.v_front + y->u.v_rear);
  return r_abs(est->vel_y) > most || r_abs(est->vel_x - wheels) > most;
}

static tse_status worse(tse_status a, tse_status b) { return a > b ? a : b; }

/* Why each stiffness is, or is not, valid; the first reason that applies. */
static tse_status judge(const tse_params *p, const tse_filter *f, const sample *y, int held, int predicted,
                        const int32_t excited[3], tse_output *out)
{
  tse_status status = TSE_OK;
  const int starting = f->seen < p->memory + p->memory;
  for (int a = 0; a < 3; a++) {
    const tse_real var = r_mul(out->stiffness_sd[a], out->stiffness_sd[a]), most = r_mul(p->valid_var, level_2(p, out, a));
    tse_reason why = TSE_VALID;
    if (predicted) why = TSE_INPUT_INVALID;
    else if (held) why = TSE_HELD;
    else if (starting) why = TSE_STARTING;
    else if (f->settle > TSE_R(0)) why = TSE_DIVERGING;
    else if (!excited[a]) why = TSE_NOT_EXCITED;
    else if (var > most) why = TSE_UNCERTAIN;
    out->reason[a] = (int32_t)why;
    if (why != TSE_VALID) status = worse(status, TSE_W_NOT_VALID);
  }
  if (starting) status = worse(status, TSE_W_STARTING);
  if (y->used < 3) status = worse(status, TSE_W_MISSING_CHANNEL);
  if (held) status = worse(status, TSE_W_HELD);
  if (predicted) status = worse(status, TSE_W_PREDICTED);
  return status;
}

tse_status step_row(const tse_params *own, tse_params *told, tse_filter *f, const tse_input *u, tse_output *out)
{
  const tse_params *p = own;
  sample y;
  const tse_status refused = input_decode(p, f, u, &y);
  if (refused < 0) return refused; /* nothing has changed yet */

  if (p->marginalised && p->notice_stuck) watch_repeats(p, f, u, &y);

  if (told) p = told_begin(own, f, &y, told);

  /* Where are we in time: the first row, after a gap, or one step further? */
  const int lost = f->held_for > p->max_gap;
  f->held_for = y.has_inputs ? TSE_R(0) : f->held_for + y.dt;
  const int frozen = f->held_for > p->max_gap;
  int gap = 0, slides = 0, moved = 0;
  if (!f->started) {
    initialise(p, f, &y); /* again with every row until there are inputs to start from */
    f->started = y.has_inputs;
  } else {
    bias_predict(p, f, y.dt); /* (18) */
    gap = !frozen && (y.dt > p->max_gap || lost);
    slides = !gap && !frozen && wheels_slide(p, f, &y);
    if (gap) restart_states(p, f, &y);
    else if (slides) coast(p, f, &y);
    else if (!frozen) {
      tse_real push[3];
      moved = 1;
      if (told) told_motion(own, p, f, &y, push);
      gaussian_predict(p, f, y.u, y.dt); /* (7) of the covariance */
      propagate(p, f, y.u, y.dt);        /* (7) of the particles  */
      if (told) told_push(p, f, push);
    }
  }
  if (told) told_sample(own, told, f, &y, moved, !slides && !frozen);
  f->steer = y.u.steer;
  f->v_front = y.u.v_front;
  f->v_rear = y.u.v_rear;

  /* Is there something to learn from? */
  const tse_real fastest = r_max(r_abs(y.u.v_front), r_abs(y.u.v_rear));
  const int held = slides || fastest < p->hold_speed || y.u.v_front < REVERSE_SPEED || y.u.v_rear < REVERSE_SPEED ||
                   r_abs(y.u.steer) > p->max_steer;
  const int predicted = !y.has_inputs || y.used == 0;
  int learning = !held && !predicted;
  f->still_for = fastest < STILL_SPEED && y.has_inputs && !slides ? r_min(f->still_for + y.dt, STILL_TIME) : TSE_R(0);
  f->settle = r_max(f->settle - y.dt, TSE_R(0));

  tse_real evidence = TSE_R(0), best = TSE_R(0);
  tse_output now;
  gaussian g;
  forecast fc;
  tse_real noise[3] = { TSE_R(1), TSE_R(1), TSE_R(1) };
  int32_t excited[3] = { 0, 0, 0 };
  int recover = 0;
  if (learning) {
    gaussian_foretell(p, f, &y, &fc);
    if (p->marginalised && consistency(p, f, &y, &fc, noise)) gaussian_foretell(p, f, &y, &fc);
    if (is_trying(f)) f->settle = r_max(f->settle, TRIED_TIME);
    if (is_holding(f)) learning = 0;
  }
  if (learning) {
    int broken = !gaussian_observe(&fc, noise, &g);
    broken = broken || !weigh(p, f, &y, &g, &evidence, &best); /* (22), (23) */
    if (broken) initialise(p, f, &y); /* covariance or weights are not numbers any more: start over */
    recover = broken || evidence_is_lost(p, f, &y, evidence, best);
  }
  const tse_real n_eff = effective_size(p, f);
  if (!learning || !p->marginalised) estimate(p, f, &now); /* (26), (27), before resampling */

  if (learning) {
    if (recover || n_eff <= p->resample_at) resample_now(p, f);
    if (recover) {
      redraw(p, f, &y, p->recovery_count);
      gaussian_foretell(p, f, &y, &fc);
      (void)gaussian_observe(&fc, noise, &g);
    }
    draw_and_learn(p, f, &y, &g); /* (25), (16), (19) */
    gaussian_update(p, f, &g, &fc, noise);
    if (p->marginalised) estimate(p, f, &now); /* here the sample has moved states and means, too */
    if (state_is_absurd(&now, &y, fastest)) {
      recover = 1;
      resample_now(p, f);
      redraw(p, f, &y, padded(p->particles));
      estimate(p, f, &now);
    }
    if (p->marginalised) gaussian_follow_level(p, f, &now);
    excitation(p, f, &y, &now, excited);
    forget(p, f, y.dt); /* (17) */
    f->seen = r_min(f->seen + TSE_R(1), r_mul(TSE_R(5), p->memory));
    if (recover) {
      f->settle = SETTLE_TIME;
      f->evidence_fast = f->evidence_slow;
      f->recoveries++;
      for (int a = 0; a < 3; a++) f->known[a] = TSE_UNKNOWN;
    }
  } else {
    use_mean_stiffness(p, &f->p);
    if (!(f->still_for < STILL_TIME)) bias_learn_still(p, f, &y);
  }
  f->vel_x = now.vel_x;
  for (int a = 0; a < 3; a++) f->bias_now[a] = r_mul(now.bias[a], p->inv_sd[a]);
  for (int a = 0; a < 3; a++) now.noise[a] = p->marginalised ? r_sqrt(r_mul(f->noise[a], slow_factor(f, a))) : TSE_R(1);
  for (int a = 0; a < 3; a++) now.spread_seen[a] = p->marginalised && spread_is_seen(f, a, now.stiffness_spread[a]);
  now.n_eff = n_eff;
  now.log_evidence = r_mul(LN_2, evidence);
  f->step++;

  tse_status status = judge(p, f, &y, held, predicted, excited, &now);
  for (int a = 0; a < 3; a++)
    if (now.reason[a] == TSE_VALID) f->known[a] = TSE_KNOWN;
  if (gap) status = worse(status, TSE_W_GAP);
  if (recover) status = worse(status, TSE_W_RECOVERED);
  now.status = (int32_t)status;
  if (out) *out = now;
  return status;
}

tse_status tse_step(const tse_params *p, tse_filter *f, const tse_input *u, tse_output *out)
{
  if (!p || !f || !u) return TSE_E_NULL;
  if (p->magic != TSE_PARAMS_MAGIC || f->magic != TSE_FILTER_MAGIC || f->fingerprint != p->fingerprint) return TSE_E_STATE;
  return p->effects.mask ? told_step(p, f, u, out) : step_row(p, NULL, f, u, out);
}

const char *tse_status_text(int32_t status)
{
  switch (status) {
#define X(name, code, text) case code: return text;
    TSE_STATUS_TABLE(X)
#undef X
    default: return "unknown status";
  }
}

const char *tse_reason_text(int32_t reason)
{
  switch (reason) {
#define X(name, code, word, text) case code: return text;
    TSE_REASON_TABLE(X)
#undef X
    default: return "unknown reason";
  }
}
