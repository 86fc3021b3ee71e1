/* host/sound.c - tse_filter_check(): a filter that came from a file, a network, another program. Every whole number in its range,
 * because places in arrays and loops depend on them; every real a number of moderate size, variances not negative. */
#include "host/sound.h"
#include "estimator/stages.h"
#include "tse/constants.h"

#define LONGEST_RUN 1000000000

static int sound_start(const tse_start *s)
{
  int fine = sound_flags(&s->loaded, 1) && sound_flags(&s->held, 1);
  for (int a = 0; a < 3; a++) fine = fine && sound_int(s->level[a], 0, 3);
  fine = fine && sound_reals(s->mu, 3, -MOST_REAL, MOST_REAL) && sound_reals(s->mu_sd, 3, TSE_R(0), MOST_REAL);
  fine = fine && sound_reals(s->mean_var, 3, TSE_R(0), MOST_REAL) && sound_reals(s->lam, 6, -MOST_REAL, MOST_REAL);
  fine = fine && sound_reals(s->bias, 3, -MOST_REAL, MOST_REAL) && sound_reals(s->bias_var, 3, TSE_R(0), MOST_REAL);
  fine = fine && sound_reals(s->spread_var, 3, TSE_R(0), MOST_REAL) && sound_reals(s->noise_var, 3, TSE_R(0), MOST_REAL);
  fine = fine && sound_reals(&s->gamma, 1, TSE_R(0), MOST_REAL);
  return fine && sound_reals(&s->nu, 1, s->loaded ? TSE_R(5) : TSE_R(0), MOST_REAL);
}

/* Rows between two kept are at most a gap apart, and no dt in all is longer than LONGEST_DT. */
static int sound_waiting(const tse_params *p, const tse_alignment *m)
{
  const tse_real most = p->max_gap + p->latency_least;
  const int32_t rows = p->latency_span > TSE_R(0) ? TSE_LATENCY_ROWS : 0;
  int fine = sound_int(m->count, 0, rows) && sound_int(m->newest, 0, TSE_LATENCY_ROWS - 1);
  fine = fine && sound_reals(&m->since, 1, TSE_R(0), LONGEST_DT) && sound_reals(&m->unkept, 1, TSE_R(0), LONGEST_DT);
  fine = fine && sound_reals(m->before, TSE_LATENCY_ROWS, TSE_R(0), most);
  for (int i = 0; i < TSE_LATENCY_ROWS; i++) {
    fine = fine && m->missing[i] < 1 << TSE_CHANNELS;
#define INPUT(name, lo, hi, unit, kind, text) fine = fine && sound_reals(&m->value[i][TSE_CHANNEL_##name], 1, TSE_R(lo), TSE_R(hi));
#include "tse/input.def"
#undef INPUT
  }
  for (int a = 0; a < 3; a++) fine = fine && sound_int(m->reason[a], TSE_VALID, TSE_MISFIT);
  fine = fine && sound_reals(m->lost, 3, TSE_R(0), TSE_R(0.5001));
  return fine;
}

static int sound_hypothesis(const tse_params *p, const tse_hypothesis *h)
{
  const tse_real w_least = TSE_R(1) + p->w_min, w_most = TSE_R(1) + p->w_max;
  const tse_real *const one[] = { &h->log_weight, &h->promise, &h->age, &h->change_age };
  int fine = sound_int(h->change_kind, TSE_CHANGE_NONE, TSE_CHANGE_RESTART) && sound_int(h->kind, 0, TSE_KINDS - 1) &&
             sound_int(h->drift, 0, 2) && sound_int(h->fault, 0, TSE_CHANNELS) && sound_flags(&h->slides, 1) && sound_flags(&h->held, 1);
  for (int a = 0; a < 3; a++) fine = fine && sound_int(h->level[a], 0, 3);
  fine = fine && sound_reals(h->x, TSE_X, -MOST_REAL, MOST_REAL) && sound_reals(h->cov[0], TSE_X * TSE_X, -MOST_SQUARE, MOST_SQUARE);
  fine = fine && sound_reals(&h->x[3], 3, w_least, w_most);
  for (int i = 0; i < TSE_X; i++) fine = fine && h->cov[i][i] >= TSE_R(0);
  const tse_real sum = MOST_SUM(MOST_REAL), square = MOST_SUM(MOST_SQUARE);
  fine = fine && sound_reals(h->eps, 3, -sum, sum) && sound_reals(h->eps_cov[0], 9, -square, square);
  fine = fine && sound_reals(h->eps_x[0], 3 * TSE_X, -square, square) && sound_reals(h->info[0], 36, -sum, sum);
  fine = fine && sound_reals(h->spread_var, 3, LEAST_VAR, MOST_REAL) && sound_reals(h->noise_var, 3, LEAST_VAR, MOST_REAL);
  fine = fine && sound_reals(h->smooth, 2, -MOST_REAL, MOST_REAL) && sound_reals(&h->shaken, 1, TSE_R(0), MOST_REAL);
  fine = fine && sound_reals(h->with_slip, 2, -MOST_REAL, MOST_REAL) && sound_reals(h->with_past, 2, -MOST_REAL, MOST_REAL);
  fine = fine && sound_reals(h->pull, 2, -MOST_REAL, MOST_REAL);
  fine = fine && sound_reals(h->slip, 2, -MOST_REAL, MOST_REAL) && sound_reals(h->foretold, 3, -square, square);
  fine = fine && sound_reals(h->activity, 3, -square, square) && sound_reals(h->before, 3, TSE_R(0), MOST_REAL);
  if (h->change_kind != TSE_CHANGE_NONE) fine = fine && sound_reals(h->before, 3, w_least, w_most);
  for (int i = 0; i < (int)(sizeof one / sizeof one[0]); i++) fine = fine && sound_reals(one[i], 1, -MOST_REAL, MOST_REAL);
  return fine && h->log_weight >= LEAST_WEIGHT && h->log_weight <= TSE_R(64);
}

static int sound_bank(const tse_params *p, const tse_bank *b, int started)
{
  const tse_repeats *const r = &b->repeats;
  int fine = sound_int(b->count, started, p->hypotheses) && sound_int(b->likeliest, 0, b->count > 0 ? b->count - 1 : 0);
  fine = fine && sound_reals(&b->seen, 1, TSE_R(0), MOST_REAL) && sound_reals(b->gained, 3, TSE_R(0), MOST_SQUARE);
  fine = fine && sound_reals(b->score, TSE_KINDS, TSE_R(0), MOST_REAL) && sound_reals(b->waited, TSE_KINDS, TSE_R(0), MOST_REAL);
  fine = fine && sound_reals(b->off[0], TSE_CONSIDERED * TSE_X, -MOST_REAL, MOST_REAL);
  fine = fine && sound_reals(b->rate, 5, -MOST_SQUARE, MOST_SQUARE);
  fine = fine && sound_reals(r->last, 6, -MOST_REAL, MOST_REAL) && sound_reals(r->repeats[0], 12, TSE_R(0), MOST_REAL);
  fine = fine && sound_reals(r->rows[0], 12, TSE_R(0), MOST_REAL) && sound_reals(r->evidence, 6, -MOST_REAL, MOST_REAL);
  for (int c = 0; c < 6; c++) fine = fine && sound_int(r->run[c], 0, LONGEST_RUN);
  for (int32_t i = 0; fine && i < b->count; i++) fine = sound_hypothesis(p, &b->h[i]);
  return fine;
}

/* Scalars and rows of what a filter with particles has in common. */
static int sound_common(const tse_filter_paper *f)
{
  const tse_real *const one[] = { &f->log_total, &f->vel_x, &f->evidence_slow, &f->evidence_fast };
  const tse_real *const not_negative[] = { &f->gamma, &f->sliding, &f->sliding_for, &f->evidence_age, &f->settle };
  int fine = sound_int(f->recoveries, 0, INT32_MAX - 1) && sound_reals(&f->nu, 1, TSE_R(0), MOST_REAL);
  for (int i = 0; i < (int)(sizeof one / sizeof one[0]); i++) fine = fine && sound_reals(one[i], 1, -MOST_REAL, MOST_REAL);
  for (int i = 0; i < (int)(sizeof not_negative / sizeof not_negative[0]); i++)
    fine = fine && sound_reals(not_negative[i], 1, TSE_R(0), MOST_REAL);
  if (f->filter.started) fine = fine && f->nu > TSE_R(4);
  fine = fine && sound_reals(f->bias_var, 3, TSE_R(0), MOST_SQUARE) && sound_reals(f->excite, 3, -MOST_REAL, MOST_REAL);
  fine = fine && sound_reals(f->excite_mean, 3, -MOST_REAL, MOST_REAL) && sound_reals(f->excite_sq, 3, TSE_R(0), MOST_SQUARE);
  return fine && sound_reals(f->learn, 3, TSE_R(0), TSE_R(1));
}

static int sound_particles(const tse_params *p, const tse_filter_paper *f)
{
  const tse_particles *const q = &f->p;
  int fine = sound_common(f) && sound_reals(f->weight, TSE_STRIDE, TSE_R(0), TSE_R(1));
#define X(name, rows, unit, text) fine = fine && sound_reals(q->name[0], rows * TSE_STRIDE, -MOST_REAL, MOST_REAL);
  TSE_PARTICLE_FIELDS(X)
#undef X
  for (int i = 0; i < TSE_STRIDE; i++) fine = fine && f->ancestor[i] < p->particles && f->copies[i] <= p->particles;
  if (f->filter.started)
    for (int d = 0; d < 6; d += d ? 2 : 3) fine = fine && sound_reals(q->lam[d], p->particles, TSE_R(0), MOST_REAL);
  return fine && sound_reals(q->logw[0], p->particles, -MOST_REAL, TSE_R(64)); /* padding has larger ones */
}

tse_status tse_filter_check(const tse_params *p, const tse_filter *f, size_t filter_bytes)
{
  if (!p || !f) return TSE_E_NULL;
  if (p->magic != TSE_PARAMS_MAGIC) return TSE_E_STATE;
  if (!(p->form == 0 && filter_bytes == sizeof(tse_filter)) && filter_bytes != sizeof(tse_filter_paper)) return TSE_E_SIZE;
  const tse_real *const one[] = { &f->steer, &f->v_front, &f->v_rear, &f->late_steer, &f->held_for, &f->still_for, &f->seen };
  int fine = f->magic == TSE_FILTER_MAGIC && f->fingerprint == p->fingerprint && sound_flags(&f->started, 1);
  for (int i = 0; i < (int)(sizeof one / sizeof one[0]); i++) fine = fine && sound_reals(one[i], 1, i < 4 ? -MOST_REAL : TSE_R(0), MOST_REAL);
  for (int a = 0; a < 3; a++) fine = fine && sound_int(f->known[a], TSE_UNKNOWN, TSE_KNOWN_BEFORE);
  fine = fine && sound_start(&f->start) && sound_memory(&f->effects) && sound_reals(f->effect_level, 4, f->effects.settled ? LEAST_LEVEL : TSE_R(0), MOST_LEVEL) &&
         sound_reals(f->nod[0], 6, -MOST_REAL, MOST_REAL);
  fine = fine && sound_waiting(p, &f->waiting);
  if (p->form == 0) fine = fine && sound_bank(p, &f->bank, f->started);
  else fine = fine && sound_particles(p, (const tse_filter_paper *)f);
  return fine ? TSE_OK : TSE_E_STATE;
}
