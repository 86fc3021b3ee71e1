/* filter/events.c - what may have happened: another road, an axle's tyres, wheels that
 * slide, a channel at fault.
 *
 * An event is a hypothesis: it shifts the state by w v, w ~ N(0, 1). v follows the
 * filter's transition and gains, so each innovation has the mean w h v: that gives the
 * likelihood of w exactly (Willsky & Jones 1976), for a hundredth of the cost of a second
 * filter. Each kind has slots that are opened in turn. When the posterior of "none" in a
 * group falls below 1 - BELIEVED, accept the most probable hypothesis of the group, even
 * if its own posterior is below BELIEVED: shift the state, and widen what the kind opens.
 * One that is discarded is merged with a weight. After a change the tyres may be back on
 * the road before, behind a patch of ice or water: then the amplitude is known, w = 1,
 * and the stiffness of that road is recalled. */
#include "filter/filter.h"

/* State, and which sd one amplitude of an event moves it by; state -1: none. */
typedef struct opens {
  int8_t state, by;
} opens;

/* Sds that states are moved by, SI. */
enum { BY_CHANGE, BY_MODEL, BY_MINUS_MODEL, BY_ALONG, BY_SLIP, BY_STEER, BY_STEER_OWN };
static tse_real sd_of(const opens *o)
{
  static const tse_real sds[] = { CHANGE_SD, MODEL_FLOOR, -MODEL_FLOOR, USUAL_MODEL_SD + USUAL_MODEL_SD,
    SLIP_OPENS, STEER_OPENS, STEER_OWN };
  return sds[o->by];
}

/* Slots of another road, the first ones; each has a second amplitude, as many slots
 * behind it. Each kind behind these two has one slot. */
enum { ROADS = HAS_SLIP ? 2 : 1 };
typedef char
    roads_come_first[EVENT_ROAD == EVENT_NONE + 1 && EVENT_ROAD_AXLE_DIFF == EVENT_ROAD + 1 ? 1 : -1];
typedef char kinds_fill_the_slots[2 * ROADS + (EVENT_KINDS - EVENT_ROAD_RETURN) == TSE_EVENTS ? 1 : -1];

/* Events are weighed in two groups: lateral (cornering stiffness, steering angle,
 * accel_y, gyro) and longitudinal (slip, wheel speeds, accel_x); of each group one may
 * have happened. */
enum { LATERAL, LONGITUDINAL };

/* A kind of event. */
typedef struct kind {
  opens common[4], own[4]; /* what one amplitude moves; what is uncertain beside it once it is believed */
  tse_real every;          /* [s] between openings */
  tse_real rate;           /* [1/s] how often it happens */
  tse_real least;          /* [1] amplitude below which nothing has happened that one would act on */
  int8_t group, slots;     /* slots: events that are open at a time */
  int8_t regime;
} kind;

/* One row a kind, in the order of EVENT_NONE ... (filter.h): common, own, every, rate,
 * least, group, slots, regime. Rows of NONE: what ROAD_RETURN moves is found as it is
 * opened (open_slot()), a faulty channel is what its measurements say (events_learn()).
 * Along the road tyres change as across, by as much more or less as the model lacks
 * before and after. */
/* clang-format off */
#define NO { -1, 0 }
#define NONE { NO, NO, NO, NO }
#define ONE(state, by) { { state, by }, NO, NO, NO }
#define ALONG { HAS_SLIP ? LCX : -1, BY_CHANGE }
#define ALONG_OWN { HAS_SLIP ? LCX : -1, BY_ALONG }
#define ROAD { { LCF, BY_CHANGE }, { LCR, BY_CHANGE }, { LMU, BY_CHANGE }, ALONG }
#define ROAD_OWN { { LCF, BY_MODEL }, { LCR, BY_MODEL }, ALONG_OWN, NO }
#define AXLE_DIFF { { LCF, BY_MODEL }, { LCR, BY_MINUS_MODEL }, NO, NO }
#define AXLE(state) { { state, BY_CHANGE }, ALONG, NO, NO }, { { state, BY_MODEL }, ALONG_OWN, NO, NO }
#define SLIDES(state) ONE(state, BY_SLIP), ONE(state, BY_SLIP)
#define TYRES RATE_ROAD, CHANGE_SD, LATERAL
#define SENSOR(group) { NONE, NONE, OPEN_TIME, RATE_FAULT, WHOLE_CHANGE, group, 1, TSE_REGIME_FAULT }
static const kind *kind_of(int32_t which)
{
  static const kind kinds[EVENT_KINDS] = {
    { NONE, NONE, TSE_R(0), TSE_R(0), TSE_R(0), LATERAL, 0, TSE_REGIME_STEADY },
    /* another road, and by how much it is not the same for both axles; back on the one before */
    { ROAD, ROAD_OWN, OPEN_TIME, TYRES, ROADS, TSE_REGIME_CHANGED },
    { AXLE_DIFF, NONE, TSE_R(0), TSE_R(0), TSE_R(0), LATERAL, ROADS, TSE_REGIME_CHANGED },
#if !defined(TSE_SMALL)
    { NONE, NONE, OPEN_TIME, TYRES, 1, TSE_REGIME_CHANGED },
    /* tyres of the front axle, of the rear axle; wheels of it that slide */
    { AXLE(LCF), OPEN_TIME, TYRES, 1, TSE_REGIME_AXLE },
    { AXLE(LCR), OPEN_TIME, TYRES, 1, TSE_REGIME_AXLE },
    { SLIDES(SF), OPEN_TIME_SLIP, RATE_SLIP, CHANGE_SD, LONGITUDINAL, 1, TSE_REGIME_SLIDING },
    { SLIDES(SR), OPEN_TIME_SLIP, RATE_SLIP, CHANGE_SD, LONGITUDINAL, 1, TSE_REGIME_SLIDING },
    /* channels at fault: the steering angle; accel_x, accel_y, yaw_rate; wheel speeds */
    { ONE(STEER_OFFSET, BY_STEER), ONE(STEER_OFFSET, BY_STEER_OWN), OPEN_TIME, RATE_FAULT, WHOLE_CHANGE,
      LATERAL, 1, TSE_REGIME_FAULT },
    SENSOR(LONGITUDINAL),
    SENSOR(LATERAL),
    SENSOR(LATERAL),
    SENSOR(LONGITUDINAL),
    SENSOR(LONGITUDINAL),
#endif
  };
  return &kinds[which];
}
/* clang-format on */

int32_t event_regime(int32_t which) { return kind_of(which)->regime; }

static int32_t group_of(int32_t which) { return kind_of(which)->group; }

/* Return the group whose events a measurement of a channel speaks of. */
static int group_of_channel(int channel)
{
  return channel == ACCEL_Y || channel == YAW_RATE || channel == NO_SENSOR_LATERAL ? LATERAL : LONGITUDINAL;
}

static int is_of_road(int32_t which) { return event_regime(which) == TSE_REGIME_CHANGED; }

/* Return whether a kind is of tyres: of a road, or of an axle. */
static int is_of_tyres(int32_t which) { return is_of_road(which) || event_regime(which) == TSE_REGIME_AXLE; }

/* Return whether a kind is of a channel at fault. */
static int is_fault(int32_t which) { return event_regime(which) == TSE_REGIME_FAULT; }

static int is_of_axle(int32_t which) { return which == EVENT_FRONT || which == EVENT_REAR; }

/* Return whether a change of tyres is one of LCX, too: of a road it is, of an axle where
 * that one drives. */
static int is_along(const tse_params *p, int32_t which)
{
  return !is_of_axle(which) || p->car.driven == (which == EVENT_FRONT ? 1 : 2);
}

/* Return whether a measurement of a channel speaks of a kind of event.   Given: along  as
 * in scalar */
static int speaks_of(int32_t which, int channel, int32_t along)
{
  const int32_t of = group_of_channel(channel);
  return which == EVENT_ROAD_RETURN || of == group_of(which) || (is_of_tyres(which) && along);
}

/* Return whether a slot holds an event that may have happened by itself. */
static int is_event(const tse_event *a) { return a->kind != EVENT_NONE && a->kind != EVENT_ROAD_AXLE_DIFF; }

/* Integrate the second amplitude out, if there is one. Both are N(0, 1) before the
 * samples.
 *   Returned: all but mean and variance of the first */
static event_says integrated(const tse_kalman *k, int n)
{
  const tse_event *const a = &k->event[n],
                         *const b = n < ROADS && k->event[n + ROADS].kind == EVENT_ROAD_AXLE_DIFF
      ? &k->event[n + ROADS]
      : NULL;
  event_says s;
  memset(&s, 0, sizeof s);
  s.info = a->info;
  s.score = a->score;
  s.second = b;
  if (b) {
    s.beside_var = r_div(TSE_R(1), TSE_R(1) + b->info);
    s.beside = r_mul(b->score, s.beside_var);
    s.part = r_mul(b->both, s.beside_var);
    s.info = r_max(s.info - r_mul(s.part, b->both), TSE_R(0));
    s.score = r_clamp(s.score - r_mul(s.beside, b->both), -MOST_INFO, MOST_INFO);
  }
  return s;
}

/* The amplitude of tyres that are back is known: 1. */
event_says event_of(const tse_kalman *k, int n)
{
  const int known = k->event[n].kind == EVENT_ROAD_RETURN;
  event_says s = integrated(k, n);
  s.var = known ? TSE_R(0) : r_div(TSE_R(1), TSE_R(1) + s.info);
  s.amplitude = known ? TSE_R(1) : r_mul(s.score, s.var);
  return s;
}

void sensitivities_clear(tse_kalman *k, int count)
{
  for (int n = 0; n < TSE_EVENTS; n++)
    for (int i = 0; i < count; i++) k->event[n].v[i] = r_short(TSE_R(0));
  for (int q = 0; q < TSE_CONSIDERED; q++)
    for (int i = 0; i < count; i++) k->consider[q][i] = r_short(TSE_R(0));
}

static void fade_short(tse_short *v, tse_real left)
{
  if (*v != TSE_R(0)) *v = r_short(r_mul(left, r_long(*v))); /* few are not */
}

void sensitivities_fade(tse_kalman *k, int i, tse_real left)
{
  for (int q = 0; q < TSE_CONSIDERED; q++) fade_short(&k->consider[q][i], left);
  for (int n = 0; n < TSE_EVENTS; n++) fade_short(&k->event[n].v[i], left);
}

/* Sensitivities that move together. */
enum { MOVED = R_TOGETHER(3) };

static void move_together(tse_short *const v[MOVED], tse_short M[MOTION][PLACES])
{
  tse_short to[MOTION * MOVED];
  for (int i = 0; i < MOTION * MOVED; i++) to[i] = r_short(TSE_R(0));
  r_slope_sums(to, MOTION, M[0], PLACES, v, MOVED, STATES);
  for (int i = 0; i < MOTION; i++)
    for (int b = 0; b < MOVED; b++) v[b][i] = to[i * MOVED + b];
}

void sensitivities_move(const tse_params *p, tse_kalman *k, tse_short M[MOTION][PLACES], tse_real dt)
{
  tse_short *v[TSE_EVENTS + TSE_CONSIDERED + MOVED];
  int count = 0;
  for (int n = 0; n < TSE_EVENTS; n++) {
    tse_event *const e = &k->event[n];
    if (e->kind == EVENT_NONE) continue;
    v[count++] = e->v;
    e->age += dt;
  }
  for (int q = 0; q < TSE_CONSIDERED; q++)
    if (p->uncertain[q] > TSE_R(0)) v[count++] = k->consider[q];
  for (int b = 0; b < MOVED && count; b++)
    v[count + b] = v[count - 1]; /* moved from where it was, as often as there are places left */
  for (int n = 0; n < count; n += MOVED) move_together(&v[n], M);
  for (int q = 0; q < COLUMNS - STATES; q++)
    for (int i = 0; i < MOTION && p->uncertain[q] > TSE_R(0); i++)
      k->consider[q][i] = r_short(
          r_long(k->consider[q][i]) + r_mul(r_long(M[i][STATES + q]), p->uncertain[q]));
}

/* Let an event have a measurement which it shifts the innovation of by y.   Given: ys  y
 * over the variance   first  y of the road that it is
 * the second amplitude of */
static void learn(tse_event *a, tse_real y, tse_real ys, tse_real e, tse_real first)
{
  a->info = r_min(a->info + r_mul(y, ys), MOST_INFO);
  a->score = r_clamp(a->score + r_mul(e, ys), -MOST_INFO, MOST_INFO);
  if (a->kind == EVENT_ROAD_AXLE_DIFF) a->both = r_clamp(a->both + r_mul(first, ys), -MOST_INFO, MOST_INFO);
}

/* Events whose sensitivities are moved together. */
enum { TOGETHER = R_TOGETHER(TSE_EVENTS) };

/* Find by how much each of these events shifts an innovation, y, and move their
 * sensitivities by -K y. */
static void correct_together(
    tse_event a[TOGETHER], const r_sparse *h, const r_scaled *gain, int all, tse_real y[TOGETHER])
{
  r_dot sum[TOGETHER];
  r_factored back[TOGETHER];
  for (int b = 0; b < TOGETHER; b++) sum[b] = r_dot_start(y[b]);
  for (int i = 0; i < h->count; i++)
    for (int b = 0; b < TOGETHER; b++) sum[b] = r_dot_plus(sum[b], h->m[i], a[b].v[h->at[i]]);
  for (int b = 0; b < TOGETHER; b++) {
    y[b] = a[b].kind == EVENT_NONE ? TSE_R(0) : r_dot_end(y[b], sum[b], h->right);
    back[b] = r_factor(-y[b], gain->up);
  }
  for (int i = 0; i < all; i++)
    for (int b = 0; b < TOGETHER; b++) a[b].v[i] = r_plus_times(a[b].v[i], back[b], gain->m[i]);
}

void events_learn(tse_kalman *k, int channel, int32_t along, const r_sparse *h, const r_scaled *gain,
    tse_real e, tse_real s, tse_real sd)
{
  const tse_real over = r_div(TSE_R(1), s), off = r_mul(r_sqr(TAIL), sd);
  const int all = STATES + k->ud.extras;
  tse_real y[TSE_EVENTS];
  for (int n = 0; n < TSE_EVENTS; n++)
    y[n] = channel >= 0 && k->event[n].kind == EVENT_SENSOR + channel ? off : TSE_R(0);
  for (int n = 0; n < TSE_EVENTS; n += TOGETHER)
    if (TOGETHER > 1 || k->event[n].kind != EVENT_NONE) correct_together(&k->event[n], h, gain, all, &y[n]);
  for (int n = 0; n < TSE_EVENTS; n++) {
    tse_event *const a = &k->event[n];
    const tse_real of_road = n >= ROADS && n < 2 * ROADS ? y[n - ROADS] : TSE_R(0);
    if (a->kind != EVENT_NONE && speaks_of(a->kind, channel, along))
      learn(a, y[n], r_mul(y[n], over), e, of_road);
  }
}

/* Return whether an event may name a channel that is frozen: one at a time is named. None
 * that is frozen is used. */
static int names_frozen(const tse_kalman *k, int32_t which)
{
  return is_fault(which) && which != EVENT_STEER && k->fault == NO_FAULT;
}

/* Return the log2 penalty for a cornering stiffness that an event raises. Nominal is of a
 * road with grip, and another road lowers it: what is above nominal counts, by the prior.
 * Of one axle all that is raised counts, but for what the last change has taken: else a
 * stiffer rear axle would be as likely as a softer front one, which steers alike. */
static tse_real beyond(const tse_params *p, const tse_kalman *k, const tse_event *a, tse_real amplitude)
{
  const int axle = is_of_axle(a->kind);
  const int changed = HAS_SLIP && k->change_kind != TSE_CHANGE_NONE && k->change_kind != TSE_CHANGE_RESTART;
  tse_real most = TSE_R(0);
  for (int i = LCF; i <= LCR && is_of_tyres(a->kind); i++) {
    const tse_real share = r_mul(r_mul(amplitude, r_long(a->v[i])), state_unit[i]);
    const tse_real fallen = changed ? r_min(k->x[i] - k->change_from[i - LCX], TSE_R(0)) : TSE_R(0);
    const tse_real from = axle ? fallen : k->x[i];
    if (!(share > TSE_R(0)) || !(from + share > TSE_R(0))) continue;
    const tse_real at = from
        + r_div(share, TSE_R(1) + r_mul(TSE_R(0.5), share)); /* log(1 + share), to second order */
    const tse_real var = axle ? r_sqr(MODEL_FLOOR) : r_sqr(p->prior_sd[i]) + r_sqr(USUAL_MODEL_SD);
    if (at > TSE_R(0)) most = r_max(most, r_div(r_sqr(at), var));
  }
  return r_mul(HALF_LOG2_OF_E, most);
}

/* Return log2 of how much likelier the samples are if this happened. A channel that is
 * frozen repeats its reading. */
static tse_real log2_ratio(const tse_params *p, const tse_kalman *k, int n)
{
  const tse_event *const a = &k->event[n];
  if (a->kind == EVENT_ROAD_RETURN) return r_mul(LOG2_OF_E, a->score - r_mul(TSE_R(0.5), a->info));
  const event_says s = event_of(k, n);
  tse_real ratio = r_mul(HALF_LOG2_OF_E, r_mul(s.score, s.amplitude))
      - r_mul(TSE_R(0.5), r_log2(TSE_R(1) + s.info));
  if (s.second)
    ratio += r_mul(HALF_LOG2_OF_E, r_mul(s.second->score, s.beside))
        - r_mul(TSE_R(0.5), r_log2(TSE_R(1) + s.second->info));
  if (!is_fault(a->kind)) return ratio - beyond(p, k, a, s.amplitude);
  const int changed = k->change_kind != TSE_CHANGE_NONE
      && k->change_age < SETTLE_TIME; /* what does not fit yet is being found: no fault */
  const tse_real likelier = changed ? r_min(ratio, TSE_R(0)) : ratio,
                 frozen = names_frozen(k, a->kind) ? k->frozen[a->kind - EVENT_SENSOR] : TSE_R(0);
  return frozen > TSE_R(0) ? r_max(likelier, frozen) : likelier;
}

int event_is_small(const tse_kalman *k, int n)
{
  const tse_event *const a = &k->event[n];
  if (names_frozen(k, a->kind) && is_frozen(k, a->kind - EVENT_SENSOR)) return 0;
  if (a->kind == EVENT_ROAD_RETURN) return 0;
  /* root mean square of the amplitude, which is as it was before the samples where they
   * say nothing */
  const event_says s = integrated(k, n);
  const tse_real one = TSE_R(1) + s.info;
  return r_mul(s.score, s.score) + one < r_mul(r_sqr(kind_of(a->kind)->least), r_mul(one, one));
}

/* Weigh the events of each group, and that none has happened, by how likely and how usual
 * they are.
 *   Returned:  ratio  log2_ratio() of each */
static void weigh_events(const tse_params *p, tse_kalman *k, tse_real ratio[TSE_EVENTS])
{
  tse_real *const weight = k->weight, *const none = k->none;
  for (int group = 0; group < TSE_GROUPS; group++) {
    tse_real most = TSE_R(0), sum;
    for (int n = 0; n < TSE_EVENTS; n++) {
      const tse_event *const a = &k->event[n];
      if (!is_event(a)) weight[n] = ratio[n] = TSE_R(0);
      if (!is_event(a) || group_of(a->kind) != group) continue;
      ratio[n] = log2_ratio(p, k, n);
      weight[n] = r_max(
          r_log2(r_mul(kind_of(a->kind)->rate, kind_of(a->kind)->every)) + ratio[n], LEAST_LOG2);
      most = r_max(most, weight[n]);
    }
    sum = none[group] = r_exp2(-most);
    for (int n = 0; n < TSE_EVENTS; n++) {
      const tse_event *const a = &k->event[n];
      if (!is_event(a) || group_of(a->kind) != group) continue;
      weight[n] = r_exp2(weight[n] - most);
      none[group] += event_is_small(k, n) ? weight[n] : TSE_R(0); /* it explains, and calls for nothing */
      sum += weight[n];
    }
    for (int n = 0; n < TSE_EVENTS; n++)
      if (is_event(&k->event[n]) && group_of(k->event[n].kind) == group) weight[n] = r_div(weight[n], sum);
    none[group] = r_div(none[group], sum);
  }
}

/* Return whether a state is a setting that nothing changes: a grip. */
static int is_known(const tse_params *p, int32_t state)
{
  return state == LMU && !(p->prior_sd[LMU] > TSE_R(0));
}

/* Initialise slot n with a hypothesis of this kind; v is the state shift for amplitude
 * 1. */
static void open_slot(const tse_params *p, tse_kalman *k, int n, int32_t which)
{
  tse_event *const a = &k->event[n];
  const kind *const what = kind_of(which);
  memset(a, 0, sizeof *a);
  a->kind = which;
  k->weight[n] = TSE_R(0);
  for (int i = 0; i < (int)(sizeof what->common / sizeof what->common[0]); i++) {
    const int32_t at = what->common[i].state;
    if (at < 0 || is_known(p, at) || (HAS_SLIP && at == LCX && !is_along(p, which))) continue;
    a->v[at] = r_short(r_div(sd_of(&what->common[i]), state_unit[at]));
  }
  for (int i = LCX; HAS_SLIP && i <= LMU && which == EVENT_ROAD_RETURN; i++)
    a->v[i] = r_short(r_div(
        r_exp2(r_mul(LOG2_OF_E, r_clamp(k->change_from[i - LCX] - k->x[i], -FURTHEST, FURTHEST))) - TSE_R(1),
        state_unit[i]));
}

/* Open an event of a kind in slot n, and its second amplitude with it. */
static void open_event(const tse_params *p, tse_kalman *k, int n, int32_t which)
{
  open_slot(p, k, n, which);
  if (which == EVENT_ROAD && n < ROADS) open_slot(p, k, n + ROADS, EVENT_ROAD_AXLE_DIFF);
}

/* Measure state i to be where it was before the last change, as well as it was known
 * then. */
static void recall(tse_kalman *k, int i)
{
  tse_real h[TSE_ALL], f[TSE_ALL], v[TSE_ALL], gain[TSE_ALL];
  for (int j = 0; j < TSE_ALL; j++) h[j] = j == i ? TSE_R(1) : TSE_R(0);
  const tse_real own = ud_measure(&k->ud, h, f, v);
  ud_correct(&k->ud, f, v, own, r_max(k->change_from_var[i - LCX], RECALL_VAR), gain);
  const tse_real e = r_div(k->change_from[i - LCX] - k->x[i], state_unit[i]);
  for (int j = 0; j < STATES + k->ud.extras; j++) {
    const tse_real to = k->x[j] + r_mul(r_mul(gain[j], e), state_unit[j]);
    k->x[j] = r_clamp(to, -state_most[j], state_most[j]);
  }
  for (int q = 0; q < TSE_CONSIDERED; q++) {
    const tse_real y = r_long(k->consider[q][i]);
    for (int j = 0; j < STATES + k->ud.extras; j++)
      k->consider[q][j] = r_short(r_long(k->consider[q][j]) - r_mul(gain[j], y));
  }
}

int may_be_back(const tse_kalman *k)
{
  if (k->change_kind == TSE_CHANGE_NONE || k->change_kind == TSE_CHANGE_RESTART) return 0;
  return !(k->change_from_var[1] > ud_variance(&k->ud, LCF))
      || !(k->change_from_var[2] > ud_variance(&k->ud, LCR));
}

/* Find a slot for the next event of a kind: a free one, else that of the oldest. Of
 * several the likeliest keeps its slot for ROAD_TIME, since a driver who hardly turns
 * shows little in a second: what is still not believed then is a model that does not fit,
 * or drift. That of an axle does, too, while it is likelier than none.
 *   Given:     first  slot of the kind      due  age of the youngest from which another
 *                                                is opened
 *   Returned:  -1 if none is to be opened now */
static int slot_for(
    const tse_kalman *k, const tse_real ratio[TSE_EVENTS], int32_t which, int first, tse_real due)
{
  const int slots = kind_of(which)->slots;
  int best = first, oldest = -1;
  tse_real youngest = LONGEST_TIME, age = TSE_R(-1);
  for (int n = first; n < first + slots; n++) {
    if (k->event[n].kind == EVENT_NONE) return n;
    youngest = r_min(youngest, k->event[n].age);
    if (ratio[n] > ratio[best]) best = n;
  }
  for (int n = first; n < first + slots; n++) {
    const int keeps = slots > 1 || (is_of_axle(which) && ratio[n] > TSE_R(0));
    if ((keeps && n == best && k->event[n].age < ROAD_TIME) || !(k->event[n].age > age)) continue;
    age = k->event[n].age;
    oldest = n;
  }
  return youngest < due ? -1 : oldest;
}

/* Shift the state by `by`; for stiffness and grip of a road or an axle that is a share of
 * the force.
 *   Returned: rescale  derivative of the shifted state with respect to `by` */
static void move_state(
    const tse_params *p, tse_kalman *k, int32_t which, const tse_real by[TSE_ALL], tse_real rescale[TSE_ALL])
{
  for (int i = 0; i < TSE_ALL; i++) rescale[i] = TSE_R(1);
  for (int i = 0; i < STATES + k->ud.extras; i++) {
    tse_real shift = r_mul(by[i], state_unit[i]);
    if (is_of_tyres(which) && i >= STIFFNESS && i <= LMU) {
      const tse_real force = r_max(TSE_R(1) + shift, LEAST_FORCE);
      shift = r_div(r_log2(force), LOG2_OF_E);
      rescale[i] = r_div(TSE_R(1), force);
    }
    k->x[i] = r_clamp(k->x[i] + shift, -state_most[i], state_most[i]);
  }
  for (int i = STIFFNESS; i <= LCR; i++) k->x[i] = r_clamp(k->x[i], p->log_min, p->log_max);
}

/* Add var times v v' to the covariance, v the slopes rescaled to the state after
 * move_state(). */
static void add_along(
    tse_kalman *k, const tse_real slopes[TSE_ALL], const tse_real rescale[TSE_ALL], tse_real var)
{
  tse_real v[TSE_ALL];
  if (!(var > TSE_R(0))) return;
  for (int i = 0; i < TSE_ALL; i++) v[i] = r_mul(slopes[i], rescale[i]);
  ud_add(&k->ud, v, STATES - 1, var);
}

/* Add what each state of a kind does beside the common amplitude; and the further the
 * stiffness has moved, the less its slopes
 * held.   Given: weight  1 if it has happened */
static void widen(const tse_params *p, tse_kalman *k, int32_t which, const tse_real was[4], tse_real weight)
{
  const kind *const what = kind_of(which);
  const int axle = which == EVENT_REAR;
  const tse_real moved = is_of_tyres(which) ? r_mul(OWN_SHARE, k->x[LCF + axle] - was[1 + axle]) : TSE_R(0);
  for (int i = 0; i < (int)(sizeof what->own / sizeof what->own[0]); i++) {
    const int32_t at = what->own[i].state;
    if (at < 0 || (HAS_SLIP && at == LCX && !is_along(p, which))) continue;
    const tse_real var = r_sqr(sd_of(&what->own[i])) + r_sqr(moved);
    ud_add_at(&k->ud, at, r_div(r_mul(weight, var), r_sqr(state_unit[at])));
  }
}

/* Return the weight with which a discarded lateral hypothesis is merged: its posterior
 * squared, because events of small posterior are mostly model errors. 0 if it is below
 * LEAST_WEIGHT, or longitudinal: slip is estimated anew in every row. */
static tse_real weight_left(const tse_kalman *k, int n)
{
  const tse_real weight = k->event[n].kind != EVENT_NONE && group_of(k->event[n].kind) == LATERAL
      ? r_sqr(k->weight[n])
      : TSE_R(0);
  return weight < LEAST_WEIGHT ? TSE_R(0) : weight;
}

/* Make mean and variance those of the two that the state may be in: with that weight what
 * event n says, else as it is. */
static void mix_in(const tse_params *p, tse_kalman *k, int n, tse_real weight)
{
  const event_says s = event_of(k, n);
  const int32_t which = k->event[n].kind;
  tse_real was[4], first[TSE_ALL], second[TSE_ALL], mean[TSE_ALL], by[TSE_ALL], rescale[TSE_ALL];
  for (int i = 0; i < 4; i++) was[i] = k->x[stiffness_at(i)];
  for (int i = 0; i < TSE_ALL; i++) {
    second[i] = s.second ? r_long(s.second->v[i]) : TSE_R(0);
    first[i] = r_long(k->event[n].v[i]) - r_mul(s.part, second[i]);
    mean[i] = r_mul(s.amplitude, first[i]) + r_mul(s.beside, second[i]);
    by[i] = r_mul(weight, mean[i]);
  }
  move_state(p, k, which, by, rescale);
  add_along(k, first, rescale, r_mul(weight, s.var));
  add_along(k, second, rescale, r_mul(weight, s.beside_var));
  add_along(k, mean, rescale, r_mul(weight, TSE_R(1) - weight));
  widen(p, k, which, was, weight);
}

/* Give event n up. The slip stiffness is as much less known, and stays: it moves with
 * cornering where an event is believed. */
static void give_up(const tse_params *p, tse_kalman *k, int n, tse_real weight)
{
  const tse_real own = HAS_SLIP ? ud_variance(&k->ud, LCX) : TSE_R(0);
  if (HAS_SLIP && is_of_tyres(k->event[n].kind)) k->event[n].v[LCX] = r_short(TSE_R(0));
  mix_in(p, k, n, weight);
  if (HAS_SLIP)
    k->along.var += r_mul(r_max(ud_variance(&k->ud, LCX) - own, TSE_R(0)), r_sqr(state_unit[LCX]));
}

/* Open the next event of each kind when it is due, in the slot of one that is given up:
 * of these one a row, which bounds its time. Slots of the kinds lie one after the other. */
static void spawn(const tse_params *p, tse_kalman *k, const tse_real ratio[TSE_EVENTS], tse_real dt)
{
  int first = 0, given_up = 0;
  for (int32_t which = EVENT_NONE + 1; which < EVENT_KINDS; which++) {
    const kind *const what = kind_of(which);
    const int possible = which != EVENT_ROAD_AXLE_DIFF && (which != EVENT_ROAD_RETURN || may_be_back(k));
    const int at = possible ? slot_for(k, ratio, which, first, what->every - r_mul(TSE_R(0.5), dt)) : -1;
    const tse_real left = at >= 0 ? weight_left(k, at) : TSE_R(0);
    first += what->slots;
    if (at < 0 || (left > TSE_R(0) && given_up)) continue;
    if (left > TSE_R(0)) {
      give_up(p, k, at, left);
      given_up = 1;
    }
    open_event(p, k, at, which);
  }
}

/* Note what is reported of a change, and where another one may lead back to. One that is
 * believed soon after another is what was found of that. */
static void note_change(
    tse_kalman *k, int32_t which, const tse_real was[4], const tse_real was_var[4], tse_along along)
{
  const int changed = k->change_kind != TSE_CHANGE_NONE && k->change_kind != TSE_CHANGE_RESTART;
  const int same = changed && k->change_age < SETTLE_TIME && which != EVENT_ROAD_RETURN;
  k->change_kind = is_of_road(which) ? TSE_CHANGE_ROAD
      : which == EVENT_FRONT         ? TSE_CHANGE_FRONT
                                     : TSE_CHANGE_REAR;
  k->fault = NO_FAULT; /* what looked like a fault may have been this */
  if (same) return;
  k->change_age = TSE_R(0);
  k->along_from = along;
  for (int i = 0; i < 4; i++) {
    k->change_from[i] = was[i];
    k->change_from_var[i] = was_var[i];
  }
}

/* End the group's events. */
static void close_events(tse_kalman *k, int group)
{
  for (int i = 0; i < TSE_EVENTS; i++)
    if (k->event[i].kind != EVENT_NONE && group_of(k->event[i].kind) == group) {
      k->event[i].kind = EVENT_NONE;
      k->weight[i] = TSE_R(0);
    }
  k->none[group] = TSE_R(1);
}

/* Find what the slip stiffness itself is on another road, or of other tyres: where LCX
 * is, what the model lacks there is not known; and as much less sure. Tyres that are back
 * are as they were.
 *   Given: own  variance of LCX before [unit2] */
static void along_change(const tse_params *p, tse_kalman *k, int32_t which, tse_real own)
{
  tse_real var;
  if (which == EVENT_ROAD_RETURN) {
    k->along = k->along_from;
    return;
  }
  (void)along_share(p, k, own, &var);
  along_start(k, var + r_mul(r_max(ud_variance(&k->ud, LCX) - own, TSE_R(0)), r_sqr(state_unit[LCX])));
}

/* Return the likeliest slot of a kind, or -1; *weight: of all its slots. */
static int likeliest_of_kind(const tse_kalman *k, int32_t which, tse_real *weight)
{
  int best = -1;
  *weight = TSE_R(0);
  for (int n = 0; n < TSE_EVENTS; n++) {
    if (k->event[n].kind != which) continue;
    if (best < 0 || k->weight[n] > k->weight[best]) best = n;
    *weight += k->weight[n];
  }
  return best;
}

/* Mix in event n, which has happened, and with their weights the other changes of tyres
 * that are not excluded with BELIEVED: an axle that has changed may have been the road. */
static void mix_in_believed(const tse_params *p, tse_kalman *k, int n)
{
  static const int32_t tyres[3] = { EVENT_ROAD, HAS_SLIP ? EVENT_FRONT : EVENT_NONE,
    HAS_SLIP ? EVENT_REAR : EVENT_NONE };
  const int32_t which = k->event[n].kind;
  int at[3] = { -1, -1, -1 }, known = 0;
  tse_real weight[3], sum = TSE_R(0), rest = TSE_R(1);
  for (int i = 0; i < 3; i++) {
    weight[i] = TSE_R(0);
    if (tyres[i] != EVENT_NONE) at[i] = likeliest_of_kind(k, tyres[i], &weight[i]);
    sum += weight[i];
    known = known || tyres[i] == which;
  }
  for (int i = 0; known && i < 3; i++) {
    const tse_real share = r_div(weight[i], sum);
    if (tyres[i] == which || at[i] < 0 || share < TSE_R(1) - BELIEVED) continue;
    mix_in(p, k, at[i], share);
    rest -= share;
  }
  mix_in(p, k, n, rest);
}

/* Move the filter to what it is if event n has happened, and end the events of its
 * group. */
static void believe(const tse_params *p, tse_kalman *k, int n)
{
  tse_real was[4], was_var[4];
  const int32_t which = k->event[n].kind;
  const tse_along along = k->along;
  for (int i = 0; i < 4; i++) {
    was[i] = k->x[stiffness_at(i)];
    was_var[i] = i > 0 || HAS_SLIP ? ud_variance(&k->ud, stiffness_at(i)) : TSE_R(0);
  }
  mix_in_believed(p, k, n);
  for (int i = LCX; HAS_SLIP && i <= LMU && which == EVENT_ROAD_RETURN; i++) recall(k, i);
  if (is_fault(which)) {
    k->fault = which == EVENT_STEER ? (int32_t)FAULT_STEER : fault_of(which - EVENT_SENSOR);
    k->agrees_for = TSE_R(0);
  }
  if (HAS_SLIP && is_of_tyres(which) && is_along(p, which)) along_change(p, k, which, was_var[0]);
  if (is_of_tyres(which)) note_change(k, which, was, was_var, along);
  close_events(k, group_of(which));
}

/* Return the likeliest event of a group that calls for something, or -1. Tyres of one
 * axle change slowly, and a road is felt by one axle first: an axle is not believed
 * before SETTLE_TIME. */
static int likeliest(const tse_kalman *k, int group)
{
  int best = -1;
  for (int n = 0; n < TSE_EVENTS; n++) {
    const int32_t which = k->event[n].kind;
    if (is_event(&k->event[n]) && group_of(which) == group && !event_is_small(k, n)
        && (best < 0 || k->weight[n] > k->weight[best]))
      best = n;
  }
  if (best >= 0 && is_of_axle(k->event[best].kind) && k->event[best].age < SETTLE_TIME) return -1;
  return best;
}

void events_decide(const tse_params *p, tse_kalman *k, tse_real dt)
{
  if (k->fault == FAULT_STEER) k->agrees_for += dt; /* the offset is found anew */
  if (k->fault && k->agrees_for > SETTLE_TIME) k->fault = NO_FAULT;
  tse_real ratio[TSE_EVENTS];
  weigh_events(p, k, ratio);
  for (int group = 0; group < TSE_GROUPS; group++) {
    const int best = k->none[group] < TSE_R(1) - BELIEVED ? likeliest(k, group) : -1;
    if (best >= 0) believe(p, k, best);
  }
  spawn(p, k, ratio, dt);
}
