/* host/sound.c - tse_filter_check(): check a filter from a file, a network or another
 * program. Integers must be in range, because loops and array indices depend on them.
 * Reals must be finite and of moderate size, and variances must not be negative. */
#include "host/sound.h"
#include "filter/types.h"
#include "filter/ud.h"
#include "tables/constants.h"
#include "tables/input.h"


/* Return whether the initial estimate that tse_learnt_load() has set is sound. */
static int is_start_sound(const tse_start *s)
{
  int fine = sound_int(s->loaded, 0, 1);
  fine = fine && sound_reals(s->mu, 3, -MOST_REAL, MOST_REAL)
      && sound_reals(s->mu_sd, 3, TSE_R(0), MOST_REAL);
  fine = fine && sound_reals(s->mean_var, 3, TSE_R(0), MOST_REAL)
      && sound_reals(s->lam, 6, -MOST_REAL, MOST_REAL);
  fine = fine && sound_reals(s->bias, 3, -MOST_REAL, MOST_REAL)
      && sound_reals(s->bias_var, 3, TSE_R(0), MOST_SQUARE);
  fine = fine && sound_reals(s->kept, TSE_KEPT, -MOST_REAL, MOST_REAL)
      && sound_reals(s->kept_cov[0], TSE_KEPT * TSE_KEPT, -MOST_SQUARE, MOST_SQUARE);
  fine = fine && sound_reals(s->noise, TSE_SENSORS, TSE_R(0), MOST_REAL)
      && sound_reals(&s->gamma, 1, TSE_R(0), MOST_REAL);
  for (int c = 0; fine && s->loaded && c < TSE_SENSORS; c++) fine = s->noise[c] > TSE_R(0);
  return fine && sound_reals(&s->nu, 1, s->loaded ? TSE_R(5) : TSE_R(0), MOST_REAL);
}

/* Return whether the rows that wait for late channels are sound: all values are in range,
 * and consecutive stored rows are at most latency_least + max_gap apart. Reason for this
 * limit (align_row()): a row is not stored if it comes less than latency_least after the
 * last stored row. The next row comes at most max_gap later, because after a longer time
 * step all stored rows are discarded. */
static int are_waiting_rows_sound(const tse_params *p, const tse_alignment *m)
{
  const tse_real max_apart = p->max_gap + p->latency_least;
  const int32_t rows = p->latency_span > TSE_R(0) ? TSE_LATENCY_ROWS : 0;
  int fine = sound_int(m->count, 0, rows) && sound_int(m->newest, 0, TSE_LATENCY_KEPT - 1);
  fine = fine && sound_reals(&m->since, 1, TSE_R(0), MAX_DT) && sound_reals(&m->unkept, 1, TSE_R(0), MAX_DT);
  fine = fine && sound_reals(m->before, TSE_LATENCY_KEPT, TSE_R(0), max_apart);
  for (int i = 0; i < TSE_LATENCY_KEPT; i++) {
    fine = fine && m->missing[i] < 1 << TSE_CHANNELS;
    for (int k = 0; k < (int)TSE_CHANNELS; k++)
      fine = fine && channel_holds(&channel_rows[k], m->value[i][k]);
  }
  for (int a = 0; a < 4; a++) fine = fine && sound_int(m->reason[a], TSE_VALID, TSE_IMPLAUSIBLE);
  fine = fine && sound_reals(m->lost, 3, TSE_R(0), TSE_R(0.5001));
  return fine;
}

/* Return whether an event is sound. */
static int is_event_sound(const tse_event *e)
{
  int fine = sound_int(e->kind, EVENT_NONE, EVENT_KINDS - 1) && sound_shorts(e->v, TSE_ALL);
  return fine && sound_reals(&e->info, 1, TSE_R(0), MOST_REAL)
      && sound_reals(&e->score, 1, -MOST_REAL, MOST_REAL) && sound_reals(&e->both, 1, -MOST_REAL, MOST_REAL)
      && sound_reals(&e->age, 1, TSE_R(0), MOST_REAL);
}

/* Return whether the state of the measured velocities is sound.
 *   Given:  in_use  1: velocities have been measured */
static int is_velocity_sound(const tse_velocity *m, int in_use)
{
  int fine = sound_reals(m->noise, TSE_VELOCITIES, TSE_R(0), MOST_REAL)
      && sound_reals(m->innovation, TSE_VELOCITIES, -MOST_REAL, MOST_REAL);
  fine = fine && sound_reals(m->last, TSE_VELOCITIES, -MOST_REAL, MOST_REAL)
      && sound_reals(m->since, TSE_VELOCITIES, TSE_R(0), MOST_REAL);
  fine = fine && sound_reals(m->mean_nis, TSE_VELOCITIES, TSE_R(0), MOST_REAL)
      && sound_reals(m->rejected_for, TSE_VELOCITIES, TSE_R(0), MOST_REAL);
  fine = fine && sound_reals(m->past[0], TSE_PAST * 4, -MOST_REAL, MOST_REAL)
      && sound_reals(m->age, TSE_PAST, TSE_R(0), MOST_REAL);
  fine = fine && sound_reals(&m->gyro, 1, -MOST_REAL, MOST_REAL)
      && sound_reals(&m->turned, 1, -MOST_REAL, MOST_REAL);
  fine = fine && sound_reals(m->motion, 3, -MOST_REAL, MOST_REAL)
      && sound_reals(&m->activity, 1, TSE_R(0), MOST_SQUARE);
  for (int c = 0; in_use && c < TSE_VELOCITIES; c++) fine = fine && m->noise[c] > TSE_R(0);
  return fine && sound_int(m->kept, 0, TSE_PAST) && sound_int(m->has_heading, 0, 1)
      && sound_int(m->has_gyro, 0, 1);
}

/* Return whether the statistics of the plausibility check are sound. */
static int is_agreement_sound(const tse_agreement *a)
{
  int fine = sound_reals(a->smooth, 6, -MOST_REAL, MOST_REAL)
      && sound_int(a->apart, 0, (1 << (TSE_PAIRS + 3)) - 1) && sound_int(a->off_scale, 0, 1);
  fine = fine && sound_reals(&a->since, 1, TSE_R(0), MOST_REAL)
      && sound_reals(a->moved[0], 4, TSE_R(0), MOST_SQUARE);
  fine = fine && sound_reals(&a->across.square, 1, TSE_R(0), MOST_SQUARE)
      && sound_reals(&a->across.late, 1, -MOST_SQUARE, MOST_SQUARE);
  fine = fine && sound_reals(&a->steered.square, 1, TSE_R(0), MOST_SQUARE)
      && sound_reals(&a->steered.late, 1, -MOST_SQUARE, MOST_SQUARE);
  fine = fine && sound_reals(&a->lags, 1, TSE_R(0), MOST_SQUARE)
      && sound_reals(&a->complete_for, 1, TSE_R(0), MAX_DT);
  for (int i = 0; i < TSE_PAIRS; i++) {
    const tse_pair *const q = &a->pair[i];
    fine = fine && sound_reals(&q->time, 1, TSE_R(0), MOST_REAL)
        && sound_reals(q->mean, 2, -MOST_REAL, MOST_REAL);
    fine = fine && sound_reals(q->var, 2, TSE_R(0), MOST_SQUARE)
        && sound_reals(&q->both, 1, -MOST_REAL, MOST_REAL);
  }
  return fine;
}

/* Return whether the prior of the longitudinal stiffness (tse_along) is sound. */
static int is_along_sound(const tse_along *a)
{
  return sound_reals(&a->mean, 1, -MOST_REAL, MOST_REAL) && sound_reals(&a->var, 1, TSE_R(0), MOST_REAL);
}

/* Return whether an element of U is sound.
 *   Given:  d  [squared unit of the state] element of D of the same column */
static int is_element_sound(tse_short u, tse_real d)
{
#if defined(TSE_REAL_FIXED)
  return (void)d, sound_shorts(&u, 1);
#else
  return sound_reals(&u, 1, -MOST_U, MOST_U) && r_mul(r_mul(d, u), u) <= MOST_PART;
#endif
}

/* Return whether the covariance of the default filter is sound. */
static int is_covariance_sound(const tse_ud *p)
{
  int fine = sound_reals(p->d, TSE_STATES, TSE_R(0), MOST_VARIANCE)
      && sound_reals(p->e, TSE_EXTRAS, TSE_R(0), MOST_VARIANCE)
      && (p->extras == 0 || p->extras == MAX_EXTRAS);
  for (int j = 0; j < TSE_STATES; j++)
    for (int i = 0; i < j; i++) fine = fine && is_element_sound(p->u[ud_column(j) + i], p->d[j]);
  for (int e = 0; e < TSE_EXTRAS; e++)
    for (int j = 0; j < TSE_ALL; j++)
      fine = fine && is_element_sound(p->w[e][j], j < TSE_STATES ? p->d[j] : p->e[j - TSE_STATES]);
  return fine;
}

/* Return whether the default filter is sound.
 *   Given:  started  1: the filter has processed a row */
static int is_kalman_sound(const tse_kalman *k, int started)
{
  const tse_real *const not_negative[] = { &k->seen, &k->change_age, &k->agrees_for };
  int fine = sound_int(k->change_kind, TSE_CHANGE_NONE, TSE_CHANGE_RESTART)
      && sound_int(k->fault, 0, TSE_CHANNELS) && sound_int(k->slow_turn, 0, TSE_SLOW - 1);
  fine = fine && sound_reals(k->since_slow, TSE_SLOW, TSE_R(0), MOST_REAL)
      && sound_reals(k->moved, 3, TSE_R(0), MOST_VARIANCE);
  fine = fine && sound_reals(k->x, TSE_VALUES + TSE_EXTRAS, -MOST_REAL, MOST_REAL)
      && is_covariance_sound(&k->ud) && is_velocity_sound(&k->velocity, k->ud.extras > 0);
  fine = fine && sound_shorts(k->consider[0], TSE_CONSIDERED * TSE_ALL);
  fine = fine && sound_reals(k->noise, TSE_SENSORS, TSE_R(0), MOST_REAL)
      && sound_reals(k->usual, TSE_SENSORS, TSE_R(0), MOST_REAL);
  fine = fine && sound_reals(k->activity, 3, TSE_R(0), MOST_SQUARE)
      && sound_reals(k->before, 3, -MOST_REAL, MOST_REAL);
  fine = fine && sound_reals(k->road, 2, -MOST_REAL, MOST_REAL) && sound_int(k->road_given, 0, 3);
  fine = fine && sound_reals(k->pitch, 2, -MOST_REAL, MOST_REAL)
      && sound_reals(k->steer, 3, TSE_R(-2), TSE_R(2));
  fine = fine && sound_reals(k->innovation, TSE_SENSORS, -MOST_REAL, MOST_REAL)
      && sound_reals(k->innovation_var, TSE_SENSORS, TSE_R(0), MOST_SQUARE);
  fine = fine && sound_reals(k->last_innovation, TSE_SENSORS, -MOST_REAL, MOST_REAL)
      && sound_reals(k->slow, TSE_SENSORS, -MOST_REAL, MOST_REAL);
  fine = fine && sound_reals(k->nis, TSE_SENSORS, TSE_R(0), MOST_REAL);
  fine = fine && sound_reals(k->lasting, TSE_SENSORS, -MOST_REAL, MOST_REAL);
  fine = fine && sound_reals(k->lasting_var, TSE_SENSORS, TSE_R(0), MOST_SQUARE);
  fine = fine && sound_reals(k->slow_var, TSE_SENSORS, TSE_R(0), MOST_SQUARE);
  fine = fine && sound_reals(k->reading, TSE_SENSORS + 1, -MOST_REAL, MOST_REAL)
      && sound_reals(k->repeats, TSE_SENSORS + 1, TSE_R(0), TSE_R(1));
  fine = fine && sound_reals(k->repeats_again, TSE_SENSORS + 1, TSE_R(0), TSE_R(1))
      && sound_reals(k->frozen, TSE_SENSORS + 1, TSE_R(0), MOST_REAL);
  fine = fine && sound_reals(&k->log_likelihood, 1, -MOST_REAL, MOST_REAL)
      && sound_reals(k->change_from, 4, TSE_R(-10), TSE_R(10))
      && sound_reals(k->change_from_var, 4, TSE_R(0), MOST_REAL) && is_along_sound(&k->along)
      && is_along_sound(&k->along_from);
  for (int i = 0; i < (int)(sizeof not_negative / sizeof not_negative[0]); i++)
    fine = fine && sound_reals(not_negative[i], 1, TSE_R(0), MOST_REAL);
  for (int i = 0; i < TSE_EVENTS; i++) fine = fine && is_event_sound(&k->event[i]);
  fine = fine && is_agreement_sound(&k->agreement);
  fine = fine && sound_reals(k->weight, TSE_EVENTS, TSE_R(0), TSE_R(1))
      && sound_reals(k->none, TSE_GROUPS, TSE_R(0), TSE_R(1));
  for (int c = 0; started && c < TSE_SENSORS; c++)
    fine = fine && k->noise[c] > TSE_R(0) && k->usual[c] >= TSE_R(1);
  return fine;
}

/* Return whether the quantities that all particles have in common are sound. */
static int is_shared_state_sound(const tse_filter_paper *f)
{
  int fine = sound_reals(&f->nu, 1, TSE_R(0), MOST_REAL) && sound_reals(&f->gamma, 1, TSE_R(0), MOST_REAL);
  fine = fine && sound_reals(&f->log_total, 1, -MOST_REAL, MOST_REAL);
  if (f->filter.started) fine = fine && f->nu > TSE_R(4);
  fine = fine && sound_reals(f->bias_var, 3, TSE_R(0), MOST_SQUARE)
      && sound_reals(f->excite, 3, -MOST_REAL, MOST_REAL);
  fine = fine && sound_reals(f->excite_mean, 3, -MOST_REAL, MOST_REAL)
      && sound_reals(f->excite_sq, 3, TSE_R(0), MOST_SQUARE);
  return fine && sound_reals(f->slow, 3, -MOST_REAL, MOST_REAL);
}

#define ROUNDED TSE_R(0.00001) /* [1] tolerance for rounding: a mean of numbers with 24 bits may exceed the
                                * largest of them by 2e-6 if they have values up to 20, the max relative
                                * stiffness */

/* Return whether the particles are sound. */
static int are_particles_sound(const tse_params *p, const tse_filter_paper *f)
{
  const tse_particles *const q = &f->p;
  int fine = is_shared_state_sound(f) && sound_reals(f->weight, TSE_STRIDE, TSE_R(0), TSE_R(1));
  fine = fine && sound_reals(q->x[0], (int)(sizeof *q / sizeof q->x[0][0]), -MOST_REAL, MOST_REAL);
  for (int i = 0; i < TSE_STRIDE; i++)
    fine = fine && f->ancestor[i] < p->particles && f->copies[i] <= p->particles;
  for (int a = 0; a < 3; a++) /* mu: mean of drawn deviations w, each within w_low .. w_max */
    fine = fine && sound_reals(q->mu[a], p->particles, p->w_low - ROUNDED, p->w_max + ROUNDED);
  if (f->filter.started)
    for (int d = 0; d < 6; d += d ? 2 : 3) /* 0, 3, 5: diagonal of lam, which is not negative */
      fine = fine && sound_reals(q->lam[d], p->particles, TSE_R(0), MOST_REAL);
  /* log-weights beyond the first p->particles are not used and not checked */
  return fine && sound_reals(q->logw[0], p->particles, -MOST_REAL, TSE_R(64));
}

tse_status tse_filter_check(const tse_params *p, const tse_filter *f, size_t filter_bytes)
{
  if (!p || !f) return TSE_E_NULL;
  if (p->magic != TSE_PARAMS_MAGIC) return TSE_E_STATE;
  if (!(p->form == 0 && filter_bytes == sizeof(tse_filter)) && filter_bytes != sizeof(tse_filter_paper))
    return TSE_E_SIZE;
  const tse_way *const w = &f->way;
  const tse_real *const one[] = { &w->by_turn, &w->by_gain, &w->gained, &f->steer, &f->v_front, &f->v_rear,
    &w->begins, &w->rolls_for, &w->unread, &f->held_for, &f->rolled_for, &f->still_for, &f->off_for[0],
    &f->off_for[1], &f->ratio, &f->gaps, &f->seen };
  int fine = f->magic == TSE_FILTER_MAGIC && f->fingerprint == p->fingerprint && sound_int(f->started, 0, 1)
      && sound_int(f->lost, 0, 1);
  for (int i = 0; i < (int)(sizeof one / sizeof one[0]); i++)
    fine = fine && sound_reals(one[i], 1, i < 6 ? -MOST_REAL : TSE_R(0), MOST_REAL);
  for (int a = 0; a < 3; a++) fine = fine && sound_int(f->known[a], TSE_UNKNOWN, TSE_KNOWN_BEFORE);
  fine = fine && is_start_sound(&f->start);
  fine = fine && are_waiting_rows_sound(p, &f->waiting);
  if (p->form == 0) fine = fine && is_kalman_sound(&f->k, f->step > 0);
  else fine = fine && are_particles_sound(p, (const tse_filter_paper *)f);
  return fine ? TSE_OK : TSE_E_STATE;
}
