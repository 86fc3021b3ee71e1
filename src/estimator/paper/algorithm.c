/* estimator/paper/algorithm.c - a row of tse_step() in the paper's form and in the sampled one: Algorithm 1, in another order.
 * The files it calls stand before it in src/CMakeLists.txt in the order in which it calls them. */
#include "estimator/paper/particles.h"

#define STILL_SPEED TSE_R(0.02)   /* m/s: wheels that turn slower stand                                        */
#define STILL_TIME TSE_R(0.5)     /* s:   before the gyro is believed to read its bias; encoders stop counting
                                          a little before the car stops                                        */
#define REVERSE_SPEED TSE_R(-0.1) /* m/s */
#define LEVEL_TIME TSE_R(5)       /* s:   time constants of the running evidence, slow                         */
#define FAST_TIME TSE_R(0.2)      /* s:   and fast                                                             */
#define SETTLE_TIME TSE_R(2)      /* s:   after a recovery nothing is valid for so long                        */
#define ABSURD TSE_R(29)          /* log2, 20 nats: innovations of 3.6 sigma in each channel, row after row; three times
                                     the noise in the settings costs 13 nats                              */
#define LN_2 TSE_R(0.69314718055994531)

/* How the row before became this one. */
typedef struct passage {
  int gap;       /* too long a time: the states started again  */
  int slides;    /* wheels lock or spin                        */
  int frozen;    /* inputs have been missing for too long      */
  int moved;     /* by (7)                                     */
} passage;

/* What a row is good for, and what it gave. */
typedef struct lesson {
  int held;      /* nothing to learn from: too slow, in reverse, sliding, far from small angles */
  int predicted; /* nothing to learn with: no inputs or no measurement                          */
  int recovered;
  int32_t excited[3];
  tse_real n_eff, evidence; /* [1], [log2] */
} lesson;

static void use_mean_stiffness(const tse_params *p, tse_particles *q)
{
  for (int a = 0; a < 3; a++)
    for (int32_t i = 0; i < padded(p->particles); i++) q->w[a][i] = q->mu[a][i];
}

static void resample_now(const tse_params *p, tse_filter_paper *f)
{
  resample(p->resampling, f->weight, p->particles, p->seed, f->filter.step, f->ancestor);
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
static int evidence_is_lost(const tse_params *p, tse_filter_paper *f, const sample *y, tse_real evidence, tse_real best)
{
  if (y->used < 3) return 0; /* the density of fewer channels has another level */
  if (!(f->evidence_age > TSE_R(0))) f->evidence_slow = f->evidence_fast = evidence;
  f->evidence_slow = r_max(f->evidence_slow, best - ABSURD);
  const tse_real floor = f->evidence_slow - r_mul(TSE_R(4), p->watchdog_drop);
  const tse_real e = r_max(evidence, floor);
  /* running means from the start: the time constant grows with age; a row that is longer than it is all there is */
  const tse_real dt = r_min(y->dt, LEVEL_TIME);
  f->evidence_age = r_min(f->evidence_age + dt, LEVEL_TIME);
  f->evidence_slow += r_mul(r_div(dt, f->evidence_age), e - f->evidence_slow);
  f->evidence_fast += r_mul(r_div(dt, r_min(FAST_TIME + dt, f->evidence_age)), e - f->evidence_fast);
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

/* Why each stiffness is, or is not, valid; the first reason that applies. */
static tse_status judge(const tse_params *p, const tse_filter_paper *f, const sample *y, const lesson *l, tse_output *out)
{
  tse_status status = TSE_OK;
  const int starting = f->filter.seen < p->memory + p->memory;
  for (int a = 0; a < 3; a++) {
    tse_reason why = TSE_VALID;
    if (l->predicted) why = TSE_INPUT_INVALID;
    else if (l->held) why = TSE_HELD;
    else if (starting) why = TSE_STARTING;
    else if (f->settle > TSE_R(0)) why = TSE_DIVERGING;
    else if (!l->excited[a]) why = TSE_NOT_EXCITED;
    else if (r_mul(out->stiffness_sd[a], out->stiffness_sd[a]) > p->valid_var) why = TSE_UNCERTAIN;
    out->reason[a] = (int32_t)why;
    if (why != TSE_VALID) status = worse(status, TSE_W_NOT_VALID);
  }
  if (starting) status = worse(status, TSE_W_STARTING);
  if (y->used < 3) status = worse(status, TSE_W_MISSING_CHANNEL);
  if (l->held) status = worse(status, TSE_W_HELD);
  if (l->predicted) status = worse(status, TSE_W_PREDICTED);
  return status;
}

/* Where are we in time: the first row, after a gap, or one step further? */
static passage advance(const tse_params *p, tse_filter_paper *f, const sample *y)
{
  tse_filter *const c = &f->filter;
  passage w = { 0, 0, 0, 0 };
  const int lost = c->held_for > p->max_gap;
  c->held_for = y->has_inputs ? TSE_R(0) : r_add_sat(c->held_for, y->dt);
  w.frozen = c->held_for > p->max_gap;
  if (!c->started) {
    initialise(p, f, y); /* again with every row until there are inputs to start from */
    c->started = y->has_inputs;
    return w;
  }
  bias_predict(p, f, y->dt);
  w.gap = !w.frozen && (y->dt > p->max_gap || lost);
  w.slides = !w.gap && !w.frozen && wheels_slide(p, f, y);
  w.moved = !w.gap && !w.frozen && !w.slides;
  if (w.gap) restart_states(p, f, y);
  else if (w.slides) coast(p, f, y);
  else if (w.moved) propagate(p, f, y->u, y->dt); /* (7) */
  return w;
}

static tse_real fastest_wheel(const sample *y) { return r_max(r_abs(y->u.v_front), r_abs(y->u.v_rear)); }

/* The row's lesson from (22) on, and the estimate.   Updated: l, now */
static void learn(const tse_params *p, tse_filter_paper *f, const sample *y, lesson *l, tse_output *now)
{
  bias_gains c;
  tse_real best;
  const int broken = !bias_observe(f, y, &c) || !weigh(p, f, y, &c, &l->evidence, &best); /* (22), (23) */
  if (broken) initialise(p, f, y); /* variance or weights are not numbers any more: start over */
  l->recovered = broken || evidence_is_lost(p, f, y, l->evidence, best);
  l->n_eff = effective_size(p, f);
  estimate(p, f, now); /* (26), (27), before resampling */

  if (l->recovered || l->n_eff <= p->resample_at) resample_now(p, f);
  if (l->recovered) {
    redraw(p, f, y, p->recovery_count);
    (void)bias_observe(f, y, &c);
  }
  draw_and_learn(p, f, y, &c); /* (25), (16), (19) */
  bias_update(f, &c);          /* (19) */
  if (state_is_absurd(now, y, fastest_wheel(y))) {
    l->recovered = 1;
    resample_now(p, f);
    redraw(p, f, y, padded(p->particles));
    estimate(p, f, now);
  }
  excitation(p, f, y, now, l->excited);
  forget(p, f, y->dt); /* (17) */
  f->filter.seen = r_min(f->filter.seen + TSE_R(1), r_mul(TSE_R(5), p->memory));
  if (l->recovered) {
    f->settle = SETTLE_TIME;
    f->evidence_fast = f->evidence_slow;
    f->recoveries++;
    for (int a = 0; a < 3; a++) f->filter.known[a] = TSE_UNKNOWN;
  }
}

/* The row's estimate where there is nothing to learn but, at standstill, the gyro's bias.   Updated: l, now */
static void hold(const tse_params *p, tse_filter_paper *f, const sample *y, lesson *l, tse_output *now)
{
  l->n_eff = effective_size(p, f);
  estimate(p, f, now);
  use_mean_stiffness(p, &f->p);
  if (!(f->filter.still_for < STILL_TIME)) bias_learn_still(p, f, y);
}

/* Is there something to learn from? */
static lesson lesson_of(const tse_params *p, const sample *y, int slides)
{
  lesson l;
  memset(&l, 0, sizeof l);
  l.held = slides || fastest_wheel(y) < p->hold_speed || y->u.v_front < REVERSE_SPEED || y->u.v_rear < REVERSE_SPEED ||
           r_abs(y->u.steer) > p->max_steer;
  l.predicted = !y->has_inputs || y->used == 0;
  return l;
}

/* What a row's estimate does not say of itself: outputs of the other form, counters, verdict. */
static tse_status conclude(const tse_params *p, tse_filter_paper *f, const sample *y, const passage *w, const lesson *l,
                           tse_output *now)
{
  f->vel_x = now->vel_x;
  for (int a = 0; a < 3; a++) now->noise[a] = now->change_ratio[a] = TSE_R(1);
  now->n_eff = l->n_eff;
  now->log_evidence = r_mul(LN_2, l->evidence);
  f->filter.step++;
  tse_status status = judge(p, f, y, l, now);
  for (int a = 0; a < 3; a++)
    if (now->reason[a] == TSE_VALID) f->filter.known[a] = TSE_KNOWN;
  if (w->gap) status = worse(status, TSE_W_GAP);
  if (l->recovered) status = worse(status, TSE_W_RECOVERED);
  now->status = (int32_t)status;
  return status;
}

/* A row. */
tse_status step_particles(const tse_params *p, tse_filter *c, const tse_input *u, tse_output *out)
{
  tse_filter_paper *const f = (tse_filter_paper *)c;
  tse_output now;
  sample y;
  const tse_status refused = input_decode(p, c, u, &y);
  if (refused < 0) return refused; /* nothing has changed yet */

  const passage w = advance(p, f, &y);
  c->steer = y.u.steer;
  c->v_front = y.u.v_front;
  c->v_rear = y.u.v_rear;
  c->still_for = fastest_wheel(&y) < STILL_SPEED && y.has_inputs && !w.slides ? r_min(r_add_sat(c->still_for, y.dt), STILL_TIME) : TSE_R(0);
  f->settle = r_max(f->settle - y.dt, TSE_R(0));

  lesson l = lesson_of(p, &y, w.slides);
  memset(&now, 0, sizeof now);
  if (l.held || l.predicted) hold(p, f, &y, &l, &now);
  else learn(p, f, &y, &l, &now);
  const tse_status status = conclude(p, f, &y, &w, &l, &now);
  if (out) *out = now;
  return status;
}
