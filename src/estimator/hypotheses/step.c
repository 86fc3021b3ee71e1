/* estimator/hypotheses/step.c - a row of tse_step() in the default form: the page to read first of it.
 *
 *   predict.c    every hypothesis to the time of the row, (7)
 *   regimes.c    what may just have happened: births
 *   innovate.c   the sample as each foretells it, (9), (22)
 *   update.c     what each learns of it, (16), (19); learn.c: spread and noise
 *   bank.c       weights; repeats.c: values that repeat themselves
 *   report.c     what the bank believes, (26), (27) */
#include "estimator/hypotheses/bank.h"
#include "estimator/hypotheses/report.h"
#include "tse/constants.h"

#define STILL_SPEED TSE_R(0.02)   /* m/s: wheels that turn slower stand                              */
#define STILL_TIME TSE_R(0.5)     /* s: before the gyro is believed to read its bias                 */
#define REVERSE_SPEED TSE_R(-0.1) /* m/s                                                             */
#define LONGEST_LOSS LONGEST_WAIT /* s                                                               */
#define LN_2 TSE_R(0.69314718055994531)

/* What kind of row it is. */
typedef struct passage {
  int gap, frozen, moved; /* too long to bridge; inputs missing for too long; moved by (7) */
  int held, predicted;    /* nothing to learn from: slow, reverse, large angle; no inputs or no measurement */
} passage;

/* Why each stiffness is, or is not, valid: the first reason that applies. What is uncertain - a change, a rival that explains the
 * samples as well, what the model does not explain - is in its sd already. */
static void judge(const tse_params *p, const tse_filter *f, const passage *w, tse_output *out)
{
  const int doubtful = out->regime[TSE_REGIME_FAULT] > MOST_PROBABLE;
  for (int a = 0; a < 3; a++) {
    const tse_real var = r_sqr(out->stiffness_sd[a]), most = r_mul(p->valid_var, r_sqr(out->stiffness[a]));
    const tse_real of_late = r_mul(r_mul(f->bank.gained[a], TSE_R(2)), p->valid_var);
    tse_reason why = TSE_VALID;
    if (w->predicted) why = TSE_INPUT_INVALID;
    else if (w->held || out->regime[TSE_REGIME_SLIDING] > MOST_PROBABLE) why = TSE_HELD;
    else if (f->seen < START_TIME) why = TSE_STARTING;
    else if (doubtful) why = TSE_DIVERGING;
    else if (!(var <= most)) {
      tse_real told, misfit;
      bank_doubts(p, &f->bank, out, a, &told, &misfit);
      if (!(var - told - misfit <= most)) why = of_late < GAINED_SHARE ? TSE_NOT_EXCITED : TSE_UNCERTAIN;
      else why = told > misfit ? TSE_TOLD_LOOSELY : TSE_MISFIT;
    }
    out->reason[a] = (int32_t)why;
  }
}

static tse_status status_of(const tse_filter *f, const sample *y, const passage *w, const tse_output *out)
{
  tse_status status = TSE_OK;
  for (int a = 0; a < 3; a++)
    if (out->reason[a] != TSE_VALID) status = TSE_W_NOT_VALID;
  if (f->seen < START_TIME) status = worse(status, TSE_W_STARTING);
  if (y->used < 3) status = worse(status, TSE_W_MISSING_CHANNEL);
  if (w->held) status = worse(status, TSE_W_HELD);
  if (w->predicted) status = worse(status, TSE_W_PREDICTED);
  if (w->gap) status = worse(status, TSE_W_GAP);
  if (out->regime[TSE_REGIME_RESTARTED] > MOST_PROBABLE) status = worse(status, TSE_W_RECOVERED);
  return status;
}

/* To the time of the row. Effects (told.c) are evaluated at the likeliest hypothesis; all move by what they make of it. */
static void advance(const tse_params *own, const tse_params *p, tse_filter *f, const sample *y, passage *w)
{
  const course from = { { f->steer, f->v_front, f->v_rear }, f->late_steer }, to = { y->u, y->late_steer };
  tse_real push[3] = { TSE_R(0), TSE_R(0), TSE_R(0) }, at[6];
  const int lost = f->held_for > p->max_gap;
  f->held_for = y->has_inputs ? TSE_R(0) : r_min(f->held_for + y->dt, LONGEST_LOSS);
  w->frozen = f->held_for > p->max_gap;
  if (!f->started) {
    tse_start s = f->start;
    if (!s.loaded) start_of_settings(p, &s);
    bank_start(p, &f->bank, &s, y); /* again with every row until there are inputs to start from */
    f->started = y->has_inputs;
    return;
  }
  w->gap = !w->frozen && (y->dt > p->max_gap || lost);
  w->moved = !w->gap && !w->frozen;
  if (w->moved) {
    bank_mean(&f->bank, 1, at);
    if (p != own) told_motion(own, p, f, y, at, push);
    bank_predict(p, &f->bank, from, to, push, y->dt);
    return;
  }
  bank_pass(p, &f->bank, y->dt);
  if (w->gap) bank_restart_states(p, &f->bank, y);
}

static void look(const tse_params *p, tse_filter *f, const sample *y, passage *w)
{
  const tse_real fastest = r_max(r_abs(y->u.v_front), r_abs(y->u.v_rear));
  w->held = fastest < p->hold_speed || y->u.v_front < REVERSE_SPEED || y->u.v_rear < REVERSE_SPEED || r_abs(y->u.steer) > p->max_steer;
  w->predicted = !y->has_inputs || y->used == 0;
  f->still_for = fastest < STILL_SPEED && y->has_inputs ? r_min(f->still_for + y->dt, STILL_TIME) : TSE_R(0);
}

/* One of the channels that show slip, after both lags. g: share of the way in this row, 1: begin anew. */
static tse_real follow_twice(tse_real at[2], tse_real g, tse_real value)
{
  at[0] += r_mul(g, value - at[0]);
  at[1] += r_mul(g, at[0] - at[1]);
  return at[1];
}

/* accel_x and wheel speeds without the nodding of body and wheels. Slip is what is left between them, and slow: what both lose alike
 * does not move the stiffness. A channel that is missing waits. */
static sample without_nods(const tse_params *p, tse_filter *f, const sample *read)
{
  sample y = *read;
  if (!(p->nod_time > TSE_R(0))) return y;
  tse_real g = !f->started || y.dt > p->max_gap || f->held_for > p->max_gap ? TSE_R(1) : r_div(y.dt, y.dt + p->nod_time);
  if (y.use[0] > TSE_R(0)) y.y[0] = follow_twice(f->nod[0], g, y.y[0]);
  if (!y.has_inputs) g = TSE_R(0);
  y.u.v_front = follow_twice(f->nod[1], g, y.u.v_front);
  y.u.v_rear = follow_twice(f->nod[2], g, y.u.v_rear);
  return y;
}

/* The sample with its steering angle as a lag of LAG_TIME leaves it; it catches up in a gap. */
static sample followed(const tse_params *p, const tse_filter *f, const sample *read)
{
  sample y = *read;
  const tse_real g = !f->started || y.dt > p->max_gap ? TSE_R(1) : r_div(y.dt, y.dt + LAG_TIME);
  y.late_steer = f->late_steer + r_mul(g, y.u.steer - f->late_steer);
  return y;
}

/* As logged; 0 where missing, whatever stands there: of that nothing is known. */
static tse_real logged(const tse_input *u, uint32_t bit, tse_real value)
{
  return (u->missing & bit) != 0 || r_is_nan(value) ? TSE_R(0) : value;
}

/* row: NULL, or where the parameters with this row's effects go. */
static tse_status step_row(const tse_params *own, tse_params *row, tse_filter *f, const tse_input *u, tse_output *out)
{
  const tse_params *const p = row ? row : own;
  const tse_real raw[6] = {
#define INPUT(name, lo, hi, unit, kind, text) logged(u, TSE_MISSING(name), u->name),
#include "tse/input.def"
#undef INPUT
  };
  passage w = { 0, 0, 0, 0, 0 };
  tse_output now;
  sample read, told;
  const tse_status refused = input_decode(own, f, u, &read);
  if (refused < 0) return refused; /* nothing has changed yet */
  read = without_nods(own, f, &read);
  told = row ? told_inputs(own, f, &read, row) : read;
  const sample steered = followed(own, f, &told);
  advance(own, p, f, &steered, &w);
  tse_real at[6];
  bank_mean(&f->bank, 0, at);
  const sample y = row ? told_sample(own, row, f, &steered, at, w.moved, !w.frozen) : steered;
  f->steer = y.u.steer;
  f->v_front = y.u.v_front;
  f->v_rear = y.u.v_rear;
  f->late_steer = y.late_steer;
  look(p, f, &y, &w);

  tse_real evidence = TSE_R(0);
  if (!w.held && !w.predicted) {
    evidence = bank_learn(p, &f->bank, &y, raw);
    f->seen = f->bank.seen;
  } else {
    if (!(f->still_for < STILL_TIME)) bank_still(&f->bank, &y);
    bank_mend(p, &f->bank, &y);
  }
  memset(&now, 0, sizeof now);
  bank_report(p, &f->bank, &now);
  now.log_evidence = r_mul(LN_2, evidence);
  judge(p, f, &w, &now);
  for (int a = 0; a < 3; a++)
    if (now.reason[a] == TSE_VALID) f->known[a] = TSE_KNOWN;
  f->step++;
  now.status = (int32_t)status_of(f, &y, &w, &now);
  if (out) *out = now;
  return (tse_status)now.status;
}

/* Its own frame, so that a filter without effects needs no stack for the parameters of a row with them. */
static tse_status step_told(const tse_params *p, tse_filter *f, const tse_input *u, tse_output *out)
{
  tse_params row;
  return step_row(p, &row, f, u, out);
}

tse_status step_hypotheses(const tse_params *p, tse_filter *f, const tse_input *u, tse_output *out)
{
  return p->effects.mask ? step_told(p, f, u, out) : step_row(p, NULL, f, u, out);
}
