/* filter/step.c - a row of the default filter: start here.
 *
 *   row.c       a log row becomes a checked sample
 *   predict.c   state and covariance to its time (model/car.c)
 *   update.c    its measurements, one after the other
 *   velocity.c  ... of them a velocity, where one is measured
 *   events.c    what may have happened
 *   output.c    estimates, and whether to act on them */
#include "filter/filter.h"

#define STILL_SPEED TSE_R(0.02)   /* m/s: wheels that turn slower stand                 */
#define JUMP_RATE TSE_R(100)      /* m/s2 */

/* Wheels that stood, or were read as zero, and turn in the next row: nothing that a car can do. Downwards they may: they lock. */
static int jumped(const tse_params *p, tse_filter *f, const decoded *z)
{
  const tse_real most = p->hold_speed + r_mul(JUMP_RATE, z->dt), front = z->z[3] - f->v_front, rear = z->z[4] - f->v_rear;
  const int jump = f->step > 0 && (z->use[3] || z->use[4]) && !(z->use[3] && front < most) && !(z->use[4] && rear < most);
  if (z->use[3] || z->one_speed) f->v_front = z->z[3];
  if (z->use[4]) f->v_rear = z->z[4];
  return jump;
}

static passage classify(const tse_params *p, tse_filter *f, const decoded *z)
{
  const tse_real front = z->use[3] ? z->z[3] : z->z[4], rear = z->use[4] ? z->z[4] : z->z[3];
  const int wheels = z->use[3] || z->use[4];
  const tse_real slow = wheels ? r_max(r_abs(front), r_abs(rear)) : r_abs(f->k.x[VX]);
  passage w;
  f->held_for = z->has_steer ? TSE_R(0) : r_min(f->held_for + z->dt, TSE_R(1e6));
  f->rolled_for = wheels ? TSE_R(0) : r_min(f->rolled_for + z->dt, TSE_R(1e6));
  w.gap = jumped(p, f, z) || z->dt > p->max_gap || (z->has_steer && f->lost);
  f->lost = f->held_for > p->max_gap || f->rolled_for > TSE_R(10) || (f->lost && !(z->has_steer && wheels));
  w.predicted = f->lost || z->used == 0 || !z->has_steer;
  w.one_speed = z->one_speed;
  w.rolls = z->rolls;
  w.held = slow < p->hold_speed || r_min(front, rear) < -p->hold_speed || r_abs(z->steer) > p->max_steer;
  f->still_for = slow < STILL_SPEED && wheels ? r_min(f->still_for + z->dt, MODEL_TIME) : TSE_R(0);
  return w;
}

/* Every state and variance is a number. */
static int whole(const tse_kalman *k)
{
  int fine = 1;
  for (int i = 0; i < STATES; i++) fine = fine && r_is_finite(k->x[i]) && r_is_finite(k->p.d[i]) && k->p.d[i] >= TSE_R(0);
  for (int i = 0; i < k->p.extras; i++) fine = fine && r_is_finite(k->x[STATES + i]) && r_is_finite(k->p.e[i]) && k->p.e[i] >= TSE_R(0);
  return fine;
}

static tse_status status_of(const tse_filter *f, const decoded *z, const passage *w, const tse_output *out)
{
  tse_status status = TSE_OK;
  for (int a = 0; a < 3; a++)
    if (out->reason[a] != TSE_VALID) status = TSE_W_NOT_VALID;
  if (f->k.seen < SETTLE_TIME) status = worse(status, TSE_W_STARTING);
  if (z->used < 3 || !(z->use[3] || z->one_speed) || !z->use[4] || !z->has_steer) status = worse(status, TSE_W_MISSING_CHANNEL);
  if (w->held) status = worse(status, TSE_W_HELD);
  if (w->predicted) status = worse(status, TSE_W_PREDICTED);
  if (w->gap) status = worse(status, TSE_W_GAP);
  if (f->k.change_kind == TSE_CHANGE_RESTART && f->k.change_age == TSE_R(0)) status = worse(status, TSE_W_RECOVERED);
  return status;
}

tse_status step_row(const tse_params *p, tse_filter *f, const tse_input *u, tse_output *out)
{
  decoded z;
  tse_output now;
  tse_kalman *const k = &f->k;
  const tse_status refused = row_decode(p, f, u, &z);
  if (refused < 0) return refused; /* nothing has changed yet */
  if (f->step == 0) start_all(p, f);
  const int fine = whole(k);
  const int blind = f->held_for > r_mul(TSE_R(2.5), p->sample_time); /* the car has turned otherwise than the angle that was held */
  passage w = classify(p, f, &z);
  const int placed = !f->started || w.held || w.gap || f->lost || (blind && z.has_steer);
  for (int a = 0; a < TSE_SENSORS && !z.has_steer; a++) z.use[a] = placed ? z.use[a] : 0; /* a stiffness would make up for it */
  if (placed) {
    for (int a = 0; a < TSE_SENSORS; a++) k->innovation[a] = k->innovation_var[a] = TSE_R(0); /* nothing is weighed */
    k->nis = k->log_likelihood = TSE_R(0);
    k->channels = 0;
    velocity_lose(k);
    if (f->started) rest_row(p, k, z.dt);
    if (!f->lost || !f->started) start_motion(p, k, &z);
    if (!(f->still_for < MODEL_TIME)) update_still(p, k, &z);
    f->started = f->started || (z.has_steer && (z.use[3] || z.use[4]));
  } else {
    const steering angle = predict_row(p, k, &z);
    velocity_move(p, k, &z);
    update_row(p, k, &z, angle);
    events_decide(p, k, z.dt);
    k->seen = r_min(k->seen + z.dt, TSE_R(1e6));
  }
  if (!fine || !whole(k)) { /* a NaN or infinity, of a fault of the memory or an overflow: start again from the prior */
    memset(k, 0, sizeof *k);
    f->start.loaded = 0; /* what was learnt may have led here */
    start_all(p, f);
    start_motion(p, k, &z);
    k->change_kind = TSE_CHANGE_RESTART;
    for (int a = 0; a < 3; a++) k->change_from[a] = k->x[LCX + a];
  }
  memset(&now, 0, sizeof now);
  report_row(p, k, &now);
  judge_row(p, k, &w, &now);
  now.status = (int32_t)status_of(f, &z, &w, &now);
  for (int a = 0; a < 3; a++) {
    if (now.status == TSE_W_RECOVERED) f->known[a] = TSE_UNKNOWN;
    else if (now.reason[a] == TSE_VALID) f->known[a] = TSE_KNOWN;
  }
  f->step++;
  if (out) *out = now;
  return (tse_status)now.status;
}
