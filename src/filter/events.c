/* filter/events.c - what may have happened: another road, an axle's tyres, wheels that slide, a channel at fault.
 *
 * An event moves the state by an amplitude, N(0, 1), times what it opens. If it happened, the state of the filter, which does not know,
 * is off by the amplitude times v: v follows the filter's own transition and gains, and every innovation is shifted by h v. That gives the
 * amplitude's likelihood exactly (Willsky & Jones 1976), for a hundredth of the cost of a second filter. Each kind has places that are
 * opened in turn; an event whose posterior probability is high enough is believed: the state moves, and what it opens is uncertain. After a
 * change the tyres may be back where they were, a patch of ice or water behind: that amplitude is known, and what was known before comes back. */
#include "filter/filter.h"

#define FURTHEST TSE_R(3) /* 1: logarithm of twenty times as much; no tyres change by more */

typedef struct opens {
  int32_t state;
  tse_real sd;
} opens;
typedef struct kind {
  opens common[3], own[3];
  tse_real every;
  int32_t places;
} kind;

/* One row a kind, in the order of EVENT_NONE .. EVENT_SENSOR (filter.h): what one amplitude moves, in SI; what is uncertain beside it
 * once it is believed; time between openings [s]; places. Rows of NO: what BACK moves is found as it is opened (open_event()), ALONG
 * raises the alarm alone (gain_of()), a faulty channel is what its measurements say (events_learn()). */
#define NO { -1, TSE_R(0) }
static kind kind_of(int32_t which)
{
  static const kind kinds[EVENT_SENSOR + 1] = {
    { { NO, NO, NO }, { NO, NO, NO }, TSE_R(0), 0 },
    { { { LCF, CHANGE_SD }, { LCR, CHANGE_SD }, { LMU, CHANGE_SD } }, { { LCF, MODEL_FLOOR }, { LCR, MODEL_FLOOR }, { LCX, CHANGE_SD } }, TSE_R(1), 3 },
    { { NO, NO, NO }, { NO, NO, NO }, TSE_R(1), 1 },
    { { NO, NO, NO }, { NO, NO, NO }, TSE_R(1), 1 },
    { { { LCF, CHANGE_SD }, NO, NO }, { { LCF, MODEL_FLOOR }, NO, NO }, TSE_R(1), 2 },
    { { { LCR, CHANGE_SD }, NO, NO }, { { LCR, MODEL_FLOOR }, NO, NO }, TSE_R(1), 2 },
    { { { SF, TSE_R(0.1) }, NO, NO }, { { SF, TSE_R(0.1) }, NO, NO }, TSE_R(0.1), 1 },
    { { { SR, TSE_R(0.1) }, NO, NO }, { { SR, TSE_R(0.1) }, NO, NO }, TSE_R(0.1), 1 },
    { { { OFF, TSE_R(0.05) }, NO, NO }, { { OFF, TSE_R(0.01) }, NO, NO }, TSE_R(1), 1 },
    { { NO, NO, NO }, { NO, NO, NO }, TSE_R(1), 1 },
  };
  return kinds[which < EVENT_SENSOR ? which : EVENT_SENSOR];
}

static tse_real rate_of(int32_t which)
{
  return which <= EVENT_ALONG ? RATE_ROAD : which == EVENT_SLIP_FRONT || which == EVENT_SLIP_REAR ? RATE_SLIP
                                                                                                  : RATE_FAULT;
}

/* The amplitude below which nothing has happened that one would act on. */
static tse_real least_of(int32_t which) { return which <= EVENT_SLIP_REAR ? LEAST_CHANGE : TSE_R(1); }

/* Tyres, steering angle, accel_y and gyro make the car turn; slip, wheels and accel_x make it go: of each something may have happened. */
enum { TURNING,
       GOING };
static int group_of(int32_t which) { return which == EVENT_ALONG || which == EVENT_SLIP_FRONT || which == EVENT_SLIP_REAR || which == EVENT_SENSOR || which >= EVENT_SENSOR + 3 ? GOING : TURNING; }

/* Back is where it was: one amplitude, not any. */
tse_real event_amplitude(const tse_event *a, tse_real *var)
{
  *var = a->kind == EVENT_BACK ? TSE_R(0) : r_div(TSE_R(1), TSE_R(1) + a->info);
  return a->kind == EVENT_BACK ? TSE_R(1) : r_mul(a->score, *var);
}

void events_clear(tse_kalman *k, int count)
{
  for (int n = 0; n < TSE_EVENTS; n++)
    for (int i = 0; i < count; i++) k->event[n].v[i] = TSE_R(0);
  for (int q = 0; q < TSE_DOUBTS; q++)
    for (int i = 0; i < count; i++) k->doubt[q][i] = TSE_R(0);
}

static void move(tse_real v[STATES], tse_real M[MOTION][COLUMNS], const tse_real keep[STATES])
{
  tse_real to[MOTION];
  for (int i = 0; i < MOTION; i++) {
    to[i] = TSE_R(0);
    for (int j = 0; j < STATES; j++) to[i] += r_mul(M[i][j], v[j]);
  }
  for (int i = 0; i < MOTION; i++) v[i] = to[i];
  for (int i = MOTION; i < FAST; i++) v[i] = r_mul(v[i], keep[i]);
}

void events_move(const tse_params *p, tse_kalman *k, tse_real M[MOTION][COLUMNS], const tse_real keep[STATES], tse_real dt)
{
  for (int n = 0; n < TSE_EVENTS; n++) {
    tse_event *const e = &k->event[n];
    if (e->kind == EVENT_NONE) continue;
    move(e->v, M, keep);
    e->age += dt;
  }
  for (int q = 0; q < TSE_DOUBTS; q++) {
    if (!(p->uncertain[q] > TSE_R(0))) continue;
    move(k->doubt[q], M, keep);
    for (int i = 0; i < MOTION && q < COLUMNS - STATES; i++) k->doubt[q][i] += r_mul(M[i][STATES + q], p->uncertain[q]);
  }
}

void events_learn(tse_kalman *k, int channel, const tse_real h[STATES], const tse_real gain[STATES], tse_real e, tse_real s, tse_real sd)
{
  const tse_real over = r_div(TSE_R(1), s);
  const int all = STATES + k->p.extras;
  for (int n = 0; n < TSE_EVENTS; n++) {
    tse_event *const a = &k->event[n];
    if (a->kind == EVENT_NONE) continue;
    tse_real y = channel >= 0 && a->kind == EVENT_SENSOR + channel ? r_mul(FAULT_SD, sd) : TSE_R(0);
    for (int i = 0; i < all; i++) y += r_mul(h[i], a->v[i]);
    const tse_real ys = r_mul(y, over);
    if (a->kind == EVENT_BACK || group_of(a->kind) == (channel == 1 || channel == 2 || channel == NO_SENSOR_TURNING ? TURNING : GOING)) {
      a->info = r_min(a->info + r_mul(y, ys), TSE_R(1e6));
      a->score = r_clamp(a->score + r_mul(e, ys), TSE_R(-1e6), TSE_R(1e6));
    }
    for (int i = 0; i < all; i++) a->v[i] -= r_mul(gain[i], y);
  }
}

/* log2 of how much likelier the samples are if this happened. Along the road the force of a tyre beyond its grip is no longer that of its
 * stiffness: another road shows as a slow innovation of accel_x of which nothing is known, its variance included. A channel that is frozen
 * repeats its reading. */
static tse_real gain_of(const tse_kalman *k, const tse_event *a)
{
  if (a->kind == EVENT_ALONG) return k->unusual > TSE_R(1) ? r_mul(TSE_R(0.72134752044448170), k->unusual - TSE_R(1)) - r_mul(TSE_R(0.5), r_log2(k->unusual)) : TSE_R(0);
  if (a->kind == EVENT_BACK) return r_mul(LOG2_OF_E, a->score - r_mul(TSE_R(0.5), a->info));
  const tse_real one = TSE_R(1) + a->info;
  const tse_real gain = r_mul(TSE_R(0.72134752044448170), r_mul(a->score, r_div(a->score, one))) - r_mul(TSE_R(0.5), r_log2(one));
  if (a->kind < EVENT_STEER) return gain;
  const int changed = k->change_kind != TSE_CHANGE_NONE && k->change_age < SETTLE_TIME; /* what does not fit yet is being found: no fault */
  const tse_real off = changed ? r_min(gain, TSE_R(0)) : gain, frozen = a->kind >= EVENT_SENSOR ? k->frozen[a->kind - EVENT_SENSOR] : TSE_R(0);
  return frozen > TSE_R(0) ? r_max(off, frozen) : off;
}

int event_is_small(const tse_kalman *k, const tse_event *a)
{
  if (a->kind >= EVENT_SENSOR && k->frozen[a->kind - EVENT_SENSOR] > -r_log2(RATE_FAULT)) return 0;
  if (a->kind == EVENT_BACK) return 0;
  /* root mean square of the amplitude, which is as it was before the samples where they say nothing */
  const tse_real one = TSE_R(1) + a->info;
  return r_mul(a->score, a->score) + one < r_mul(r_sqr(least_of(a->kind)), r_mul(one, one));
}

static void weigh_events(tse_kalman *k)
{
  tse_real *const weight = k->weight, *const none = k->none;
  for (int group = 0; group < TSE_GROUPS; group++) {
    tse_real most = TSE_R(0), sum;
    for (int n = 0; n < TSE_EVENTS; n++) {
      const tse_event *const a = &k->event[n];
      if (a->kind == EVENT_NONE) weight[n] = TSE_R(0);
      if (a->kind == EVENT_NONE || group_of(a->kind) != group) continue;
      weight[n] = r_max(r_log2(r_mul(rate_of(a->kind), kind_of(a->kind).every)) + gain_of(k, a), TSE_R(-100));
      most = r_max(most, weight[n]);
    }
    sum = none[group] = r_exp2(-most);
    for (int n = 0; n < TSE_EVENTS; n++) {
      const tse_event *const a = &k->event[n];
      if (a->kind == EVENT_NONE || group_of(a->kind) != group) continue;
      weight[n] = r_exp2(weight[n] - most);
      none[group] += event_is_small(k, a) ? weight[n] : TSE_R(0); /* it explains, and calls for nothing */
      sum += weight[n];
    }
    for (int n = 0; n < TSE_EVENTS; n++)
      if (k->event[n].kind != EVENT_NONE && group_of(k->event[n].kind) == group) weight[n] = r_div(weight[n], sum);
    none[group] = r_div(none[group], sum);
  }
}

/* A grip that is a setting stays it. */
static int is_known(const tse_params *p, int32_t state) { return state == LMU && !(p->prior_sd[LMU] > TSE_R(0)); }

static void open_event(const tse_params *p, tse_kalman *k, int n, int32_t which)
{
  tse_event *const a = &k->event[n];
  const kind what = kind_of(which);
  memset(a, 0, sizeof *a);
  a->kind = which;
  k->weight[n] = TSE_R(0);
  for (int i = 0; i < 3; i++)
    if (what.common[i].state >= 0 && !is_known(p, what.common[i].state)) a->v[what.common[i].state] = r_div(what.common[i].sd, state_unit[what.common[i].state]);
  for (int i = LCX; i <= LMU && which == EVENT_BACK; i++) a->v[i] = r_div(r_exp2(r_mul(LOG2_OF_E, r_clamp(k->change_from[i - LCX] - k->x[i], -FURTHEST, FURTHEST))) - TSE_R(1), state_unit[i]);
}

/* State i is where it was before the last change, as well as it was known then. */
static void recall(tse_kalman *k, int i)
{
  tse_real h[TSE_ALL], f[TSE_ALL], v[TSE_ALL], gain[TSE_ALL];
  for (int j = 0; j < TSE_ALL; j++) h[j] = j == i ? TSE_R(1) : TSE_R(0);
  (void)ud_measure(&k->p, h, f, v);
  ud_correct(&k->p, f, v, r_max(k->change_from_var[i - LCX], TSE_R(1e-4)), gain);
  const tse_real e = r_div(k->change_from[i - LCX] - k->x[i], state_unit[i]);
  for (int j = 0; j < STATES + k->p.extras; j++) k->x[j] += r_mul(r_mul(gain[j], e), state_unit[j]);
  for (int q = 0; q < TSE_DOUBTS; q++) {
    const tse_real y = k->doubt[q][i];
    for (int j = 0; j < STATES + k->p.extras; j++) k->doubt[q][j] -= r_mul(gain[j], y);
  }
}

/* Something has changed, and before it an axle was known better than now: behind a patch the patch itself is nothing to go back to. */
static int may_be_back(const tse_kalman *k)
{
  if (k->change_kind == TSE_CHANGE_NONE || k->change_kind == TSE_CHANGE_RESTART) return 0;
  return !(k->change_from_var[LCF - LCX] > ud_variance(&k->p, LCF)) || !(k->change_from_var[LCR - LCX] > ud_variance(&k->p, LCR));
}

/* Places of the kinds lie one after the other. A kind's next one takes a free place, else that of the oldest:
 * the likeliest event keeps its place until LONGEST_EVENT. */
static void spawn(const tse_params *p, tse_kalman *k, tse_real dt)
{
  int at = 0;
  for (int32_t which = EVENT_NONE + 1; which < EVENT_KINDS; which++) {
    const kind what = kind_of(which);
    const int last = at + what.places;
    if (which == EVENT_BACK && !may_be_back(k)) {
      at = last;
      continue;
    }
    int oldest = at, best = at, free = 0;
    tse_real youngest = TSE_R(1e6);
    for (int n = at; n < last; n++) {
      if (k->event[n].kind == EVENT_NONE) {
        oldest = n;
        free = 1;
        break;
      }
      youngest = r_min(youngest, k->event[n].age);
      if (gain_of(k, &k->event[n]) > gain_of(k, &k->event[best])) best = n;
    }
    if (!free) {
      tse_real age = TSE_R(-1);
      for (int n = at; n < last; n++)
        if ((n != best || what.places == 1 || k->event[n].age > LONGEST_EVENT) && k->event[n].age > age) {
          age = k->event[n].age;
          oldest = n;
        }
      const int shows = gain_of(k, &k->event[at]) > TSE_R(3) && !event_is_small(k, &k->event[at]); /* one that began before it happened is in the way */
      if (what.places == 1 && shows && k->event[at].age < LONGEST_EVENT) {
        at = last;
        continue;
      }
    }
    if (free || !(youngest < what.every - r_mul(TSE_R(0.5), dt))) open_event(p, k, oldest, which);
    at = last;
  }
}

/* What is reported of a change, and where another one may lead back to. One that is believed soon after another is what was found of that. */
static void note_change(tse_kalman *k, int32_t which, const tse_real was[4], const tse_real was_var[4])
{
  const int same = k->change_kind != TSE_CHANGE_NONE && k->change_age < LONGEST_EVENT && which != EVENT_BACK;
  k->change_kind = which <= EVENT_ALONG ? TSE_CHANGE_ROAD : which == EVENT_FRONT ? TSE_CHANGE_FRONT
                                                                                 : TSE_CHANGE_REAR;
  k->fault = 0; /* what looked like a fault may have been this */
  for (int i = 0; i < 4 && !same; i++) {
    k->change_age = TSE_R(0);
    k->change_from[i] = was[i];
    k->change_from_var[i] = was_var[i];
  }
}

/* The group's events are over. */
static void close_events(tse_kalman *k, int group)
{
  for (int i = 0; i < TSE_EVENTS; i++)
    if (k->event[i].kind != EVENT_NONE && group_of(k->event[i].kind) == group) {
      k->event[i].kind = EVENT_NONE;
      k->weight[i] = TSE_R(0);
    }
  k->none[group] = TSE_R(1);
}

static void believe(const tse_params *p, tse_kalman *k, int n)
{
  if (k->event[n].kind == EVENT_ALONG) { /* another road: as far as it shows across */
    k->weight[n] = TSE_R(0);
    k->none[GOING] = TSE_R(1);
    for (int i = 0; i < TSE_EVENTS; i++)
      if (k->event[i].kind == EVENT_ROAD && (k->event[n].kind != EVENT_ROAD || gain_of(k, &k->event[i]) > gain_of(k, &k->event[n]))) n = i;
  }
  tse_event a = k->event[n];
  const kind what = kind_of(a.kind);
  tse_real var, was[4], was_var[4];
  const tse_real mean = event_amplitude(&a, &var);
  for (int i = 0; i < 4; i++) {
    was[i] = k->x[LCX + i];
    was_var[i] = ud_variance(&k->p, LCX + i);
  }
  for (int i = 0; i < STATES + k->p.extras; i++) {
    tse_real shift = r_mul(r_mul(mean, a.v[i]), state_unit[i]);
    if (a.kind <= EVENT_REAR && i >= LCX && i <= LMU) { /* a share of the force, no logarithm yet */
      const tse_real force = r_max(TSE_R(1) + shift, TSE_R(0.2));
      shift = r_div(r_log2(force), LOG2_OF_E);
      a.v[i] = r_div(a.v[i], force);
    }
    k->x[i] += shift;
  }
  if (a.kind == EVENT_BACK)
    for (int i = LCX; i <= LMU; i++) recall(k, i);
  else ud_add(&k->p, a.v, STATES - 1, var);
  for (int i = 0; i < 3; i++)
    if (what.own[i].state >= 0) { /* what each does beside it; and the further the state moves, the less its slopes held */
      const tse_real moved = a.kind <= EVENT_REAR ? r_mul(OWN_SHARE, k->x[LCF + (a.kind == EVENT_REAR)] - was[1 + (a.kind == EVENT_REAR)]) : TSE_R(0);
      ud_add_at(&k->p, what.own[i].state, r_div(r_sqr(what.own[i].sd) + r_sqr(moved), r_sqr(state_unit[what.own[i].state])));
    }
  if (a.kind >= EVENT_STEER) {
    k->fault = a.kind == EVENT_STEER ? (int32_t)FAULT_STEER : fault_of(a.kind - EVENT_SENSOR);
    k->agrees_for = TSE_R(0);
  }
  for (int i = 0; i < 3; i++) k->x[LCX + i] = r_clamp(k->x[LCX + i], p->log_min, p->log_max);
  k->slow[0] = a.kind <= EVENT_BACK ? TSE_R(0) : k->slow[0]; /* it is explained */
  if (a.kind <= EVENT_REAR) note_change(k, a.kind, was, was_var);
  close_events(k, group_of(a.kind));
}

void events_decide(const tse_params *p, tse_kalman *k, tse_real dt)
{
  if (k->fault == 1) k->agrees_for += dt; /* the offset is found anew */
  if (k->fault && k->agrees_for > SETTLE_TIME) k->fault = 0;
  weigh_events(k);
  for (int group = 0; group < TSE_GROUPS; group++) {
    int best = -1;
    if (!(k->none[group] < TSE_R(1) - BELIEVED)) continue;
    for (int n = 0; n < TSE_EVENTS; n++) {
      const int32_t which = k->event[n].kind;
      if (which != EVENT_NONE && group_of(which) == group && !event_is_small(k, &k->event[n]) && (best < 0 || k->weight[n] > k->weight[best])) best = n;
    }
    if (best >= 0) believe(p, k, best);
  }
  spawn(p, k, dt);
}
