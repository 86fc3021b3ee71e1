/* filter/events.c - test hypotheses of sudden events: a different road surface, a change
 * of the tyres of one axle, wheels that slide, a channel at fault. In this file "change
 * of tyres" means any event that changes the stiffness (is_tyre_change()), also a
 * different road surface, which acts on all tyres.
 *
 * If an event of amplitude w has happened, the state has the error w v. The amplitude has
 * the prior N(0, 1). v is the sensitivity of the state to w, and is propagated with the
 * transitions and gains of the filter. Each innovation then has the mean w h' v (h:
 * partial derivatives of the measurement with respect to the state). The innovations
 * therefore give the exact likelihood of w (Willsky & Jones 1976), at a hundredth of the
 * cost of a second filter. At regular intervals a new hypothesis of each kind is opened:
 * the event happens now. It occupies a slot, i.e. an element of tse_kalman.event that is
 * reserved for its kind.
 *
 * The kinds form two groups, lateral and longitudinal. When the posterior probability of
 * "no event" in a group falls below 1 - BELIEVED, the most probable hypothesis of the
 * group is accepted, even if its own probability is below BELIEVED: the state is shifted
 * by the estimated amplitude times v, and its covariance is increased by the variance of
 * the amplitude and by fixed variances (kind.own). A hypothesis that is not accepted
 * loses its slot to a newer one. Its event is then merged into the state with a weight
 * that increases with its probability (compute_merge_weight()).
 *
 * After a change the car may return to the previous road, for example at the end of a
 * patch of ice or water. The amplitude of such a return is known: w = 1. If the return
 * is accepted, stiffness and grip are updated with their values on the previous road
 * (recall_state()). */
#include "filter/events.h"
#include "filter/faults.h"
#include "filter/slip_stiffness.h"
#include "filter/units.h"

/* A state that an event changes (index `state`; -1 in unused elements), and the sd of the
 * change (index `by`, BY_CHANGE ...; get_sd() returns the sd). */
typedef struct opens {
  int8_t state, by;
} opens;

/* Values of opens.by: the sd by which an event shifts a state. get_sd() returns this sd
 * [SI]. A negative sd shifts the state in the direction opposite to the other states of
 * the event. */
enum { BY_CHANGE, BY_MODEL, BY_MINUS_MODEL, BY_ALONG, BY_SLIP, BY_STEER, BY_STEER_OWN };
static tse_real get_sd(const opens *o)
{
  static const tse_real sds[] = { CHANGE_SD, MODEL_FLOOR, -MODEL_FLOOR, USUAL_MODEL_SD + USUAL_MODEL_SD,
    SLIP_EVENT_SD, STEER_FAULT_SD, STEER_ACCEPTED_SD };
  return sds[o->by];
}

/* Max number of open hypotheses of EVENT_ROAD, a different road surface. A hypothesis
 * occupies a slot, an element of tse_kalman.event: 0 .. ROADS - 1. Such an event has two
 * amplitudes. The first, in slot n, is the change that both axles have in common. The
 * second, in slot n + ROADS, is the difference of the change between the axles
 * (EVENT_ROAD_AXLE_DIFF). Each other kind of event has one slot. */
enum { ROADS = HAS_SLIP ? 2 : 1 };
typedef char
    roads_come_first[EVENT_ROAD == EVENT_NONE + 1 && EVENT_ROAD_AXLE_DIFF == EVENT_ROAD + 1 ? 1 : -1];
typedef char kinds_fill_the_slots[2 * ROADS + (EVENT_KINDS - EVENT_ROAD_RETURN) == TSE_EVENTS ? 1 : -1];

/* Groups of events: lateral (cornering stiffness, steering angle, accel_y, gyro) and
 * longitudinal (slip, wheel speeds, accel_x). At most one event of a group is assumed
 * to have happened. */
enum { LATERAL, LONGITUDINAL };

/* Value of kind.channel if the kind is not a fault of a channel. */
enum { NO_CHANNEL = -1 };

/* A kind of event. */
typedef struct kind {
  opens common[4];     /* states that the amplitude shifts */
  opens own[4];        /* states whose variance an accepted event increases, each by its get_sd()^2 */
  tse_real every;      /* [s] interval at which hypotheses are opened */
  tse_real rate;       /* [1/s] prior rate: expected number of such events per second */
  tse_real least;      /* [1] min amplitude to which the filter reacts */
  int8_t group, slots; /* LATERAL or LONGITUDINAL; max number of hypotheses open at a time */
  int8_t regime;       /* TSE_REGIME_* that starts with the event */
  int8_t change;       /* TSE_CHANGE_* of the tyres, or TSE_CHANGE_NONE */
  int8_t channel;      /* faulty channel: ACCEL_X ..., STEERING, or NO_CHANNEL */
} kind;

/* The kinds, in the order of EVENT_NONE ... (types.h). A change of tyres shifts LCX,
 * the logarithm of the longitudinal stiffness, with the same sd as the logarithm of
 * the cornering stiffness. LCX also contains the longitudinal model error, which may
 * be different for the old and the new tyres. When the change is accepted, LCX
 * therefore also receives an sd of 2 USUAL_MODEL_SD. This is the sum of the sds of the
 * two model errors, and so the max sd of their difference. UNUSED marks kinds without
 * states in this table: open_slot() sets the states of EVENT_ROAD_RETURN, and a faulty
 * sensor shifts no state, only its own measurements (events_learn()). */
/* clang-format off */
#define NO { -1, 0 }
#define UNUSED { NO, NO, NO, NO }
#define ONE(state, by) { { state, by }, NO, NO, NO }
#define ALONG { HAS_SLIP ? LCX : -1, BY_CHANGE }
#define ALONG_OWN { HAS_SLIP ? LCX : -1, BY_ALONG }
#define ROAD { { LCF, BY_CHANGE }, { LCR, BY_CHANGE }, { LMU, BY_CHANGE }, ALONG }
#define ROAD_OWN { { LCF, BY_MODEL }, { LCR, BY_MODEL }, ALONG_OWN, NO }
#define AXLE_DIFF { { LCF, BY_MODEL }, { LCR, BY_MINUS_MODEL }, NO, NO }
#define AXLE(state) { { state, BY_CHANGE }, ALONG, NO, NO }, { { state, BY_MODEL }, ALONG_OWN, NO, NO }
#define SLIDES(state) ONE(state, BY_SLIP), ONE(state, BY_SLIP)
#define STEERS ONE(STEER_OFFSET, BY_STEER), ONE(STEER_OFFSET, BY_STEER_OWN)
#define TYRES(slots) OPEN_TIME, RATE_ROAD, CHANGE_SD, LATERAL, slots
#define WHEELS OPEN_TIME_SLIP, RATE_SLIP, CHANGE_SD, LONGITUDINAL, 1
#define FAULT(group) OPEN_TIME, RATE_FAULT, MIN_FAULT, group, 1
#define NEVER(slots) TSE_R(0), TSE_R(0), TSE_R(0), LATERAL, slots
static const kind *get_kind(int32_t which)
{
  static const kind kinds[EVENT_KINDS] = {
    /* columns: common, own; every .. slots; regime; change; channel */
    { UNUSED, UNUSED,      NEVER(0),            TSE_REGIME_STEADY,  TSE_CHANGE_NONE,  NO_CHANNEL },
    { ROAD, ROAD_OWN,      TYRES(ROADS),        TSE_REGIME_CHANGED, TSE_CHANGE_ROAD,  NO_CHANNEL },
    { AXLE_DIFF, UNUSED,   NEVER(ROADS),        TSE_REGIME_CHANGED, TSE_CHANGE_ROAD,  NO_CHANNEL },
#if !defined(TSE_SMALL)
    { UNUSED, UNUSED,      TYRES(1),            TSE_REGIME_CHANGED, TSE_CHANGE_ROAD,  NO_CHANNEL },
    { AXLE(LCF),           TYRES(1),            TSE_REGIME_AXLE,    TSE_CHANGE_FRONT, NO_CHANNEL },
    { AXLE(LCR),           TYRES(1),            TSE_REGIME_AXLE,    TSE_CHANGE_REAR,  NO_CHANNEL },
    { SLIDES(SF),          WHEELS,              TSE_REGIME_SLIDING, TSE_CHANGE_NONE,  NO_CHANNEL },
    { SLIDES(SR),          WHEELS,              TSE_REGIME_SLIDING, TSE_CHANGE_NONE,  NO_CHANNEL },
    { STEERS,              FAULT(LATERAL),      TSE_REGIME_FAULT,   TSE_CHANGE_NONE,  STEERING },
    { UNUSED, UNUSED,      FAULT(LONGITUDINAL), TSE_REGIME_FAULT,   TSE_CHANGE_NONE,  ACCEL_X },
    { UNUSED, UNUSED,      FAULT(LATERAL),      TSE_REGIME_FAULT,   TSE_CHANGE_NONE,  ACCEL_Y },
    { UNUSED, UNUSED,      FAULT(LATERAL),      TSE_REGIME_FAULT,   TSE_CHANGE_NONE,  YAW_RATE },
    { UNUSED, UNUSED,      FAULT(LONGITUDINAL), TSE_REGIME_FAULT,   TSE_CHANGE_NONE,  WHEEL_FRONT },
    { UNUSED, UNUSED,      FAULT(LONGITUDINAL), TSE_REGIME_FAULT,   TSE_CHANGE_NONE,  WHEEL_REAR },
#endif
  };
  return &kinds[which];
}
/* clang-format on */

int32_t event_regime(int32_t which) { return get_kind(which)->regime; }

int is_tyre_change(int32_t which) { return get_kind(which)->change != TSE_CHANGE_NONE; }

int32_t event_fault(int32_t which)
{
  const int32_t channel = get_kind(which)->channel;
  if (channel == NO_CHANNEL) return NO_FAULT;
  return channel == STEERING ? (int32_t)FAULT_STEER : fault_of(channel);
}

static int32_t get_group(int32_t which) { return get_kind(which)->group; }

static int is_fault(int32_t which) { return get_kind(which)->channel != NO_CHANNEL; }

static int is_fault_of_sensor(int32_t which)
{
  return is_fault(which) && get_kind(which)->channel != STEERING;
}

/* Return the group of events for which a measurement of a channel is evidence. Measured
 * velocities have NO_SENSOR_LATERAL or NO_SENSOR_LONGITUDINAL instead of a channel. */
static int get_channel_group(int channel)
{
  return channel == ACCEL_Y || channel == YAW_RATE || channel == NO_SENSOR_LATERAL ? LATERAL : LONGITUDINAL;
}

static int is_axle_change(int32_t which) { return which == EVENT_FRONT || which == EVENT_REAR; }

/* Return whether an event that changes the cornering stiffness also shifts LCX, the
 * logarithm of the longitudinal stiffness. A change of the road surface does. A change
 * of the tyres of one axle does only if this axle is driven. */
static int is_along(const tse_params *p, int32_t which)
{
  return !is_axle_change(which) || p->car.driven == (which == EVENT_FRONT ? 1 : 2);
}

/* Return whether a measurement of a channel is evidence for a kind of event. A channel is
 * evidence for the events of its group. For a change of tyres, whose kinds are lateral,
 * longitudinal channels are evidence too, but only while the car does not brake. For a
 * return to the previous road every channel is evidence.
 *   Given:  along  1: the car does not brake (scalar.along) */
static int is_evidence_for(int32_t which, int channel, int32_t along)
{
  const int32_t shown = get_channel_group(channel);
  return which == EVENT_ROAD_RETURN || shown == get_group(which) || (is_tyre_change(which) && along);
}

/* Return whether a slot holds an event. It does not if it is free, or if it holds only
 * the second amplitude of a road event (the event itself is in slot n - ROADS). */
static int is_event(const tse_event *a) { return a->kind != EVENT_NONE && a->kind != EVENT_ROAD_AXLE_DIFF; }

/* Compute the information and the score (event_posterior) on the amplitude of the event
 * in slot n. If the event has a second amplitude, compute them from the likelihood that
 * is integrated over the second amplitude. The prior of both amplitudes is N(0, 1).
 *   Returned:  all members but amplitude and var */
static event_posterior integrate_second(const tse_kalman *k, int n)
{
  const int has_second = n < ROADS && k->event[n + ROADS].kind == EVENT_ROAD_AXLE_DIFF;
  const tse_event *const a = &k->event[n];
  const tse_event *const b = has_second ? &k->event[n + ROADS] : NULL;
  event_posterior s;
  memset(&s, 0, sizeof s);
  s.info = a->info;
  s.score = a->score;
  s.second = b;
  if (b) {
    s.beside_var = r_div(TSE_R(1), TSE_R(1) + b->info);
    s.beside = r_mul(b->score, s.beside_var);
    s.part = r_mul(b->both, s.beside_var);
    s.info = r_max(s.info - r_mul(s.part, b->both), TSE_R(0));
    s.score = r_clamp(s.score - r_mul(s.beside, b->both), -MAX_INFO, MAX_INFO);
  }
  return s;
}

/* See events.h. If the event is a return to the previous road, its amplitude is known: it
 * is 1, with the variance 0. */
event_posterior compute_posterior(const tse_kalman *k, int n)
{
  const int known = k->event[n].kind == EVENT_ROAD_RETURN;
  event_posterior s = integrate_second(k, n);
  s.var = known ? TSE_R(0) : r_div(TSE_R(1), TSE_R(1) + s.info);
  s.amplitude = known ? TSE_R(1) : r_mul(s.score, s.var);
  return s;
}

/* Update the information and the score of an amplitude with a measurement.
 *   Given:  y      shift of the innovation by an amplitude of 1
 *           ys     y / variance of the innovation
 *           e      innovation
 *           first  y of the first amplitude of the event; used only if `a` is the second
 *                  amplitude */
static void update_amplitude(tse_event *a, tse_real y, tse_real ys, tse_real e, tse_real first)
{
  a->info = r_min(a->info + r_mul(y, ys), MAX_INFO);
  a->score = r_clamp(a->score + r_mul(e, ys), -MAX_INFO, MAX_INFO);
  if (a->kind == EVENT_ROAD_AXLE_DIFF) a->both = r_clamp(a->both + r_mul(first, ys), -MAX_INFO, MAX_INFO);
}

/* Number of events that one call of correct_together() processes; a divisor of
 * TSE_EVENTS (R_TOGETHER() in number/vector.h). */
enum { TOGETHER = R_TOGETHER(TSE_EVENTS) };

/* For each of the TOGETHER events in `a`, compute y, the shift of the innovation by an
 * amplitude of 1. Then correct the sensitivity v of the state as the measurement corrects
 * the state: v becomes v - K y (K: Kalman gain).
 *   Given:    all  number of states, including the extra states in use
 *   Updated:  y    in: shift by the offset of a faulty sensor; out: shift in total */
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
  const tse_real over = r_div(TSE_R(1), s);
  const tse_real offset = r_mul(r_sqr(TAIL), sd); /* sd of the offset of a faulty sensor */
  const int all = STATES + k->ud.extras;
  tse_real y[TSE_EVENTS];
  for (int n = 0; n < TSE_EVENTS; n++)
    y[n] = channel >= 0 && get_kind(k->event[n].kind)->channel == channel ? offset : TSE_R(0);
  for (int n = 0; n < TSE_EVENTS; n += TOGETHER)
    if (TOGETHER > 1 || k->event[n].kind != EVENT_NONE) correct_together(&k->event[n], h, gain, all, &y[n]);
  for (int n = 0; n < TSE_EVENTS; n++) {
    tse_event *const a = &k->event[n];
    const tse_real y_road = n >= ROADS && n < 2 * ROADS ? y[n - ROADS] : TSE_R(0);
    if (a->kind != EVENT_NONE && is_evidence_for(a->kind, channel, along))
      update_amplitude(a, y[n], r_mul(y[n], over), e, y_road);
  }
}

/* Return whether evidence that a sensor is frozen counts as evidence for this kind of
 * event. It counts for a fault of this sensor, and only while no channel is at fault,
 * because the filter treats at most one channel as faulty at a time. */
static int can_name_frozen(const tse_kalman *k, int32_t which)
{
  return is_fault_of_sensor(which) && k->fault == NO_FAULT;
}

/* Return the log2 penalty of an event that increases a cornering stiffness. It is
 * log2(e) * excess^2/(2 variance), for the axle with the larger excess^2/variance. It is
 * 0 if no axle has an excess > 0.
 *
 * Road surface: the nominal stiffness is that of a road with good grip, so that a new
 * stiffness above nominal is unlikely. The excess is ln(new stiffness/nominal), the
 * variance is that of the prior plus USUAL_MODEL_SD^2.
 *
 * Tyres of one axle: without a penalty, stiffer rear tyres would be as likely as softer
 * front tyres, because both change the response to steering in the same way. The excess
 * is the increase of ln(stiffness). If ln(stiffness) is now lower than before the last
 * change of tyres, the increase counts only from that earlier value. The variance is
 * MODEL_FLOOR^2. */
static tse_real penalise_stiffer(
    const tse_params *p, const tse_kalman *k, const tse_event *a, tse_real amplitude)
{
  const int axle = is_axle_change(a->kind);
  const int changed = HAS_SLIP && k->change_kind != TSE_CHANGE_NONE && k->change_kind != TSE_CHANGE_RESTART;
  tse_real largest = TSE_R(0);
  for (int i = LCF; i <= LCR && is_tyre_change(a->kind); i++) {
    const tse_real share = r_mul(r_mul(amplitude, r_long(a->v[i])), state_unit[i]);
    const tse_real fallen = changed ? r_min(k->x[i] - k->change_from[i - LCX], TSE_R(0)) : TSE_R(0);
    const tse_real from = axle ? fallen : k->x[i];
    if (!(share > TSE_R(0)) || !(from + share > TSE_R(0))) continue;
    /* ln(1 + share), to second order */
    const tse_real at = from + r_div(share, TSE_R(1) + r_mul(TSE_R(0.5), share));
    const tse_real var = axle ? r_sqr(MODEL_FLOOR) : r_sqr(p->prior_sd[i]) + r_sqr(USUAL_MODEL_SD);
    if (at > TSE_R(0)) largest = r_max(largest, r_div(r_sqr(at), var));
  }
  return r_mul(HALF_LOG2_OF_E, largest);
}

/* Return log2 of a likelihood ratio of the samples since the hypothesis in slot n was
 * opened: (likelihood if its event has happened)/(likelihood if no event has). If the
 * event increases a cornering stiffness, penalise_stiffer() is subtracted.
 *
 * For a fault, the log2 ratio of the samples is at most 0 during SETTLE_TIME after a
 * change of tyres: innovations are large until the new stiffness is found, and must not
 * make the fault more likely than no event. If there is stronger evidence that the faulty
 * sensor is frozen (tse_kalman.frozen > 0), return this evidence instead, also during
 * SETTLE_TIME. */
static tse_real compute_log2_ratio(const tse_params *p, const tse_kalman *k, int n)
{
  const tse_event *const a = &k->event[n];
  if (a->kind == EVENT_ROAD_RETURN) return r_mul(LOG2_OF_E, a->score - r_mul(TSE_R(0.5), a->info));
  const event_posterior s = compute_posterior(k, n);
  tse_real ratio = r_mul(HALF_LOG2_OF_E, r_mul(s.score, s.amplitude))
      - r_mul(TSE_R(0.5), r_log2(TSE_R(1) + s.info));
  if (s.second)
    ratio += r_mul(HALF_LOG2_OF_E, r_mul(s.second->score, s.beside))
        - r_mul(TSE_R(0.5), r_log2(TSE_R(1) + s.second->info));
  if (!is_fault(a->kind)) return ratio - penalise_stiffer(p, k, a, s.amplitude);
  const int changed = k->change_kind != TSE_CHANGE_NONE && k->change_age < SETTLE_TIME;
  const tse_real by_samples = changed ? r_min(ratio, TSE_R(0)) : ratio;
  const tse_real frozen = can_name_frozen(k, a->kind) ? k->frozen[get_kind(a->kind)->channel] : TSE_R(0);
  return frozen > TSE_R(0) ? r_max(by_samples, frozen) : by_samples;
}

int event_is_small(const tse_kalman *k, int n)
{
  const tse_event *const a = &k->event[n];
  if (can_name_frozen(k, a->kind) && is_frozen(k, get_kind(a->kind)->channel)) return 0;
  if (a->kind == EVENT_ROAD_RETURN) return 0;
  /* compare the posterior mean square of the amplitude, mean^2 + variance, with the
   * square of the min amplitude (kind.least). Both sides are multiplied by
   * (1 + info)^2 */
  const event_posterior s = integrate_second(k, n);
  const tse_real one = TSE_R(1) + s.info;
  return r_mul(s.score, s.score) + one < r_mul(r_sqr(get_kind(a->kind)->least), r_mul(one, one));
}

/* Compute for each group the posterior probability of each event, and of no event. An
 * event that is too small to need a reaction counts as no event.
 *   Returned:  ratio  compute_log2_ratio() of each event */
static void weigh_events(const tse_params *p, tse_kalman *k, tse_real ratio[TSE_EVENTS])
{
  tse_real *const weight = k->weight, *const none = k->none;
  for (int group = 0; group < TSE_GROUPS; group++) {
    /* log2 of the largest weight; the weight of no event is 1. All weights are divided by
     * the largest one before they are added, so that the sum does not overflow */
    tse_real largest = TSE_R(0), sum;
    for (int n = 0; n < TSE_EVENTS; n++) {
      const tse_event *const a = &k->event[n];
      if (!is_event(a)) weight[n] = ratio[n] = TSE_R(0);
      if (!is_event(a) || get_group(a->kind) != group) continue;
      ratio[n] = compute_log2_ratio(p, k, n);
      const tse_real prior = r_log2(r_mul(get_kind(a->kind)->rate, get_kind(a->kind)->every));
      weight[n] = r_max(prior + ratio[n], MIN_LOG2);
      largest = r_max(largest, weight[n]);
    }
    sum = none[group] = r_exp2(-largest);
    for (int n = 0; n < TSE_EVENTS; n++) {
      const tse_event *const a = &k->event[n];
      if (!is_event(a) || get_group(a->kind) != group) continue;
      weight[n] = r_exp2(weight[n] - largest);
      none[group] += event_is_small(k, n) ? weight[n] : TSE_R(0);
      sum += weight[n];
    }
    for (int n = 0; n < TSE_EVENTS; n++)
      if (is_event(&k->event[n]) && get_group(k->event[n].kind) == group) weight[n] = r_div(weight[n], sum);
    none[group] = r_div(none[group], sum);
  }
}

/* Return whether a state is constant, i.e. not estimated. Only the grip (LMU) can be
 * constant. It is constant if its prior sd is 0. */
static int is_constant(const tse_params *p, int32_t state)
{
  return state == LMU && !(p->prior_sd[LMU] > TSE_R(0));
}

/* Initialise slot n with a hypothesis of this kind. */
static void open_slot(const tse_params *p, tse_kalman *k, int n, int32_t which)
{
  tse_event *const a = &k->event[n];
  const kind *const what = get_kind(which);
  memset(a, 0, sizeof *a);
  a->kind = which;
  k->weight[n] = TSE_R(0);
  for (int i = 0; i < (int)(sizeof what->common / sizeof what->common[0]); i++) {
    const int32_t at = what->common[i].state;
    if (at < 0 || is_constant(p, at) || (HAS_SLIP && at == LCX && !is_along(p, which))) continue;
    a->v[at] = r_short(r_div(get_sd(&what->common[i]), state_unit[at]));
  }
  for (int i = LCX; HAS_SLIP && i <= LMU && which == EVENT_ROAD_RETURN; i++) {
    const tse_real back = r_clamp(k->change_from[i - LCX] - k->x[i], -MAX_LOG_CHANGE, MAX_LOG_CHANGE);
    a->v[i] = r_short(r_div(r_exp2(r_mul(LOG2_OF_E, back)) - TSE_R(1), state_unit[i]));
  }
}

/* Open an event of this kind in slot n. For EVENT_ROAD, also open its second amplitude,
 * in slot n + ROADS. */
static void open_event(const tse_params *p, tse_kalman *k, int n, int32_t which)
{
  open_slot(p, k, n, which);
  if (which == EVENT_ROAD && n < ROADS) open_slot(p, k, n + ROADS, EVENT_ROAD_AXLE_DIFF);
}

/* Restore state i, a stiffness or the grip, to its value on the previous road, before
 * the last change: update the filter as if this state had been measured with the mean
 * and variance of that time. The correlated states and the covariance then follow. */
static void recall_state(tse_kalman *k, int i)
{
  tse_real h[TSE_ALL], f[TSE_ALL], v[TSE_ALL], gain[TSE_ALL];
  for (int j = 0; j < TSE_ALL; j++) h[j] = j == i ? TSE_R(1) : TSE_R(0);
  const tse_real own = ud_measure(&k->ud, h, f, v);
  ud_correct(&k->ud, f, v, own, r_max(k->change_from_var[i - LCX], MIN_RECALL_VAR), gain);
  const tse_real e = r_div(k->change_from[i - LCX] - k->x[i], state_unit[i]);
  for (int j = 0; j < STATES + k->ud.extras; j++) {
    const tse_real to = k->x[j] + r_mul(r_mul(gain[j], e), state_unit[j]);
    k->x[j] = r_clamp(to, -state_max[j], state_max[j]);
  }
  for (int q = 0; q < TSE_CONSIDERED; q++) {
    const tse_real y = r_long(k->consider[q][i]);
    for (int j = 0; j < STATES + k->ud.extras; j++)
      k->consider[q][j] = r_short(r_long(k->consider[q][j]) - r_mul(gain[j], y));
  }
}

int can_return(const tse_kalman *k)
{
  if (k->change_kind == TSE_CHANGE_NONE || k->change_kind == TSE_CHANGE_RESTART) return 0;
  return !(k->change_from_var[1] > ud_variance(&k->ud, LCF))
      || !(k->change_from_var[2] > ud_variance(&k->ud, LCR));
}

/* Find a slot for the next event of a kind. Take a free slot. If no slot is free, wait
 * until the youngest event of the kind has the age `due`, then take the slot of the
 * oldest event. These events keep their slot until they are ROAD_TIME old:
 *   - the most likely event of a kind with several slots, because on a drive with few
 *     bends the evidence of one second is not enough for a decision;
 *   - a change of the tyres of one axle, while it is more likely than no event.
 * An event that is not accepted within ROAD_TIME is probably drift or model error.
 *   Given:     first  first slot of the kind
 *              due    [s] min age of the youngest event of the kind before a slot with an
 *                     event is taken
 *   Returned:  the slot; -1 if no event is to be opened in this row */
static int find_slot(
    const tse_kalman *k, const tse_real ratio[TSE_EVENTS], int32_t which, int first, tse_real due)
{
  const int slots = get_kind(which)->slots;
  int best = first, oldest = -1;
  tse_real youngest = MAX_TIME, age = TSE_R(-1);
  for (int n = first; n < first + slots; n++) {
    if (k->event[n].kind == EVENT_NONE) return n;
    youngest = r_min(youngest, k->event[n].age);
    if (ratio[n] > ratio[best]) best = n;
  }
  for (int n = first; n < first + slots; n++) {
    const int keeps = slots > 1 || (is_axle_change(which) && ratio[n] > TSE_R(0));
    if ((keeps && n == best && k->event[n].age < ROAD_TIME) || !(k->event[n].age > age)) continue;
    age = k->event[n].age;
    oldest = n;
  }
  return youngest < due ? -1 : oldest;
}

/* Shift each state i by c = by[i] * state_unit[i]. Exception: in a change of tyres, c of
 * a stiffness or of the grip is its relative change. Its state, a logarithm, then shifts
 * by ln(1 + c).
 *   Returned:  rescale  derivative of each shift with respect to c: 1, or 1/(1 + c) for a
 *                       logarithm */
static void move_state(
    const tse_params *p, tse_kalman *k, int32_t which, const tse_real by[TSE_ALL], tse_real rescale[TSE_ALL])
{
  for (int i = 0; i < TSE_ALL; i++) rescale[i] = TSE_R(1);
  for (int i = 0; i < STATES + k->ud.extras; i++) {
    tse_real shift = r_mul(by[i], state_unit[i]);
    if (is_tyre_change(which) && i >= STIFFNESS && i <= LMU) {
      const tse_real force = r_max(TSE_R(1) + shift, MIN_FORCE);
      shift = r_div(r_log2(force), LOG2_OF_E);
      rescale[i] = r_div(TSE_R(1), force);
    }
    k->x[i] = r_clamp(k->x[i] + shift, -state_max[i], state_max[i]);
  }
  for (int i = STIFFNESS; i <= LCR; i++) k->x[i] = r_clamp(k->x[i], p->log_min, p->log_max);
}

/* Add var v v' to the covariance. var is the variance of an amplitude, and v the
 * derivative of the state with respect to this amplitude: v[i] = slopes[i] * rescale[i].
 *   Given:  slopes   derivative of `by`, the argument of move_state(), with respect to
 *                    the amplitude
 *           rescale  from move_state() */
static void add_rank_one(
    tse_kalman *k, const tse_real slopes[TSE_ALL], const tse_real rescale[TSE_ALL], tse_real var)
{
  tse_real v[TSE_ALL];
  if (!(var > TSE_R(0))) return;
  for (int i = 0; i < TSE_ALL; i++) v[i] = r_mul(slopes[i], rescale[i]);
  ud_add(&k->ud, v, STATES - 1, var);
}

/* Add to the covariance the variances by which an event of this kind increases single
 * states (kind.own). For a change of tyres also add (OWN_SHARE times the shift of ln
 * stiffness)^2 to each of these states. This is the variance of the linearisation error:
 * earlier updates were linearised at the old stiffness.
 *   Given:  was     stiffness and grip before the event shifted them
 *           weight  factor on the variances; 1 if the event is accepted */
static void widen_states(
    const tse_params *p, tse_kalman *k, int32_t which, const tse_real was[4], tse_real weight)
{
  const kind *const what = get_kind(which);
  /* axle from whose change of stiffness `moved` is computed: 0 front, also for a change
   * of the road; 1 rear */
  const int axle = which == EVENT_REAR;
  const tse_real moved = is_tyre_change(which) ? r_mul(OWN_SHARE, k->x[LCF + axle] - was[1 + axle])
                                               : TSE_R(0);
  for (int i = 0; i < (int)(sizeof what->own / sizeof what->own[0]); i++) {
    const int32_t at = what->own[i].state;
    if (at < 0 || (HAS_SLIP && at == LCX && !is_along(p, which))) continue;
    const tse_real var = r_sqr(get_sd(&what->own[i])) + r_sqr(moved);
    ud_add_at(&k->ud, at, r_div(r_mul(weight, var), r_sqr(state_unit[at])));
  }
}

/* Return the weight with which a discarded event is merged into the state. For a lateral
 * event it is the square of its probability, because events of small probability are
 * mostly model errors. A square below MIN_WEIGHT counts as 0. For longitudinal events the
 * weight is 0: wheels that slide need no merging, because the slip is estimated in each
 * row, and a faulty sensor shifts no state. */
static tse_real compute_merge_weight(const tse_kalman *k, int n)
{
  const tse_real weight = k->event[n].kind != EVENT_NONE && get_group(k->event[n].kind) == LATERAL
      ? r_sqr(k->weight[n])
      : TSE_R(0);
  return weight < MIN_WEIGHT ? TSE_R(0) : weight;
}

/* Replace the state by the mean and variance of a mixture of two distributions: the state
 * after event n, with the probability `weight`, and the state without the event, with the
 * probability 1 - weight. */
static void merge_event(const tse_params *p, tse_kalman *k, int n, tse_real weight)
{
  const event_posterior s = compute_posterior(k, n);
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
  add_rank_one(k, first, rescale, r_mul(weight, s.var));
  add_rank_one(k, second, rescale, r_mul(weight, s.beside_var));
  add_rank_one(k, mean, rescale, r_mul(weight, TSE_R(1) - weight));
  widen_states(p, k, which, was, weight);
}

/* Discard event n and merge it into the state with this weight. Unlike an accepted change
 * of tyres, a discarded one only increases the variance of LCX, and does not shift its
 * mean. The increase is also added to tse_along.var, the variance of ln(slip stiffness),
 * which is LCX without the model error. */
static void discard_event(const tse_params *p, tse_kalman *k, int n, tse_real weight)
{
  const tse_real own = HAS_SLIP ? ud_variance(&k->ud, LCX) : TSE_R(0);
  if (HAS_SLIP && is_tyre_change(k->event[n].kind)) k->event[n].v[LCX] = r_short(TSE_R(0));
  merge_event(p, k, n, weight);
  if (HAS_SLIP)
    k->along.var += r_mul(r_max(ud_variance(&k->ud, LCX) - own, TSE_R(0)), r_sqr(state_unit[LCX]));
}

/* Open the next event of each kind that is due. If its slot holds an older event,
 * discard that event. At most one discarded event is merged per row, which bounds the
 * computing time. If a second one would have to be merged, the opening of its
 * successor waits for the next row. The slots are in the order of the kinds. */
static void open_due_events(const tse_params *p, tse_kalman *k, const tse_real ratio[TSE_EVENTS], tse_real dt)
{
  int first = 0, has_merged = 0;
  for (int32_t which = EVENT_NONE + 1; which < EVENT_KINDS; which++) {
    const kind *const what = get_kind(which);
    const int possible = which != EVENT_ROAD_AXLE_DIFF && (which != EVENT_ROAD_RETURN || can_return(k));
    const tse_real due = what->every - r_mul(TSE_R(0.5), dt);
    const int at = possible ? find_slot(k, ratio, which, first, due) : -1;
    const tse_real left = at >= 0 ? compute_merge_weight(k, at) : TSE_R(0);
    first += what->slots;
    if (at < 0 || (left > TSE_R(0) && has_merged)) continue;
    if (left > TSE_R(0)) {
      discard_event(p, k, at, left);
      has_merged = 1;
    }
    open_event(p, k, at, which);
  }
}

/* Store the accepted change for the output. Also store the stiffness before the
 * change, to which a later EVENT_ROAD_RETURN returns. If the change is not a return
 * and comes within SETTLE_TIME of the last change, it counts as part of the last
 * change: the stored stiffness and the time of the last change stay as they are. A
 * fault that was accepted before is withdrawn, because its evidence may have come from
 * this change.
 *   Given:  was, was_var, along  before the change: stiffness and grip, their variances,
 *                                and tse_kalman.along */
static void record_change(
    tse_kalman *k, int32_t which, const tse_real was[4], const tse_real was_var[4], tse_along along)
{
  const int changed = k->change_kind != TSE_CHANGE_NONE && k->change_kind != TSE_CHANGE_RESTART;
  const int same = changed && k->change_age < SETTLE_TIME && which != EVENT_ROAD_RETURN;
  k->change_kind = get_kind(which)->change;
  k->fault = NO_FAULT;
  if (same) return;
  k->change_age = TSE_R(0);
  k->along_from = along;
  for (int i = 0; i < 4; i++) {
    k->change_from[i] = was[i];
    k->change_from_var[i] = was_var[i];
  }
}

/* Close all events of a group. */
static void close_events(tse_kalman *k, int group)
{
  for (int i = 0; i < TSE_EVENTS; i++)
    if (k->event[i].kind != EVENT_NONE && get_group(k->event[i].kind) == group) {
      k->event[i].kind = EVENT_NONE;
      k->weight[i] = TSE_R(0);
    }
  k->none[group] = TSE_R(1);
}

/* Return the slot of the most probable event of a kind, or -1.
 *   Returned:  *weight  sum of the probabilities of all slots of the kind */
static int find_most_probable_of_kind(const tse_kalman *k, int32_t which, tse_real *weight)
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

/* Merge the accepted event n into the state. A different road surface can look like a
 * change of the tyres of one axle, and the other way round. If n is one of the three
 * kinds road, front axle or rear axle, the most probable event of each of the three
 * kinds is therefore merged. Its weight is the share of its kind in the sum of the
 * probabilities of the three kinds. If the share of a kind other than that of n is
 * below 1 - BELIEVED, the kind is left out, and n receives its share. If n is of any
 * other kind, only n is merged, with the weight 1. */
static void merge_accepted(const tse_params *p, tse_kalman *k, int n)
{
  static const int32_t tyres[3] = { EVENT_ROAD, HAS_SLIP ? EVENT_FRONT : EVENT_NONE,
    HAS_SLIP ? EVENT_REAR : EVENT_NONE };
  const int32_t which = k->event[n].kind;
  int at[3] = { -1, -1, -1 }, known = 0;
  tse_real weight[3], sum = TSE_R(0), rest = TSE_R(1);
  for (int i = 0; i < 3; i++) {
    weight[i] = TSE_R(0);
    if (tyres[i] != EVENT_NONE) at[i] = find_most_probable_of_kind(k, tyres[i], &weight[i]);
    sum += weight[i];
    known = known || tyres[i] == which;
  }
  for (int i = 0; known && i < 3; i++) {
    const tse_real share = r_div(weight[i], sum);
    if (tyres[i] == which || at[i] < 0 || share < TSE_R(1) - BELIEVED) continue;
    merge_event(p, k, at[i], share);
    rest -= share;
  }
  merge_event(p, k, n, rest);
}

/* Accept event n: merge it into the state and into what is reported (fault, change of the
 * tyres). Then close all open events of its group, because at most one of them is assumed
 * to have happened. */
static void accept_event(const tse_params *p, tse_kalman *k, int n)
{
  tse_real was[4], was_var[4];
  const int32_t which = k->event[n].kind;
  const tse_along along = k->along;
  for (int i = 0; i < 4; i++) {
    was[i] = k->x[stiffness_at(i)];
    was_var[i] = i > 0 || HAS_SLIP ? ud_variance(&k->ud, stiffness_at(i)) : TSE_R(0);
  }
  merge_accepted(p, k, n);
  for (int i = LCX; HAS_SLIP && i <= LMU && which == EVENT_ROAD_RETURN; i++) recall_state(k, i);
  if (is_fault(which)) {
    k->fault = event_fault(which);
    k->agrees_for = TSE_R(0);
  }
  if (HAS_SLIP && is_tyre_change(which) && is_along(p, which)) along_restart(p, k, which, was_var[0]);
  if (is_tyre_change(which)) record_change(k, which, was, was_var, along);
  close_events(k, get_group(which));
}

/* Return the slot of the most probable event of a group that needs a reaction, or -1.
 * If this event is a change of the tyres of one axle whose hypothesis has been open
 * for less than SETTLE_TIME, also return -1. Waiting costs little, because the tyres
 * of one axle change slowly. It avoids an error on a new road, which reaches the front
 * axle first and for a short time looks like a change of the front tyres. */
static int find_most_probable(const tse_kalman *k, int group)
{
  int best = -1;
  for (int n = 0; n < TSE_EVENTS; n++) {
    const int32_t which = k->event[n].kind;
    if (is_event(&k->event[n]) && get_group(which) == group && !event_is_small(k, n)
        && (best < 0 || k->weight[n] > k->weight[best]))
      best = n;
  }
  if (best >= 0 && is_axle_change(k->event[best].kind) && k->event[best].age < SETTLE_TIME) return -1;
  return best;
}

void events_decide(const tse_params *p, tse_kalman *k, tse_real dt)
{
  /* end a fault. A faulty sensor is not used. It is compared with the prediction, and
   * agrees_for is the time for which it has agreed (watch_fault()). A faulty steering
   * angle stays in use, and its offset is estimated. It cannot be compared, so that
   * agrees_for is the time since the fault was accepted. The fault ends when
   * agrees_for exceeds SETTLE_TIME */
  if (k->fault == FAULT_STEER) k->agrees_for += dt;
  if (k->fault && k->agrees_for > SETTLE_TIME) k->fault = NO_FAULT;
  tse_real ratio[TSE_EVENTS];
  weigh_events(p, k, ratio);
  for (int group = 0; group < TSE_GROUPS; group++) {
    const int best = k->none[group] < TSE_R(1) - BELIEVED ? find_most_probable(k, group) : -1;
    if (best >= 0) accept_event(p, k, best);
  }
  open_due_events(p, k, ratio, dt);
}
