/* filter/output.c - what the filter reports of a row, and whether to act on it. */
#include "filter/filter.h"

/* Return the variance of state i, A_ii plus that from the consider parameters [unit^2]. */
static tse_real own_variance_of(const tse_kalman *k, int i)
{
  tse_real var = ud_variance(&k->ud, i);
  for (int q = 0; q < TSE_CONSIDERED; q++) var += r_mul_short(k->consider[q][i], k->consider[q][i]);
  return var;
}

/* Events that may have happened: which, how likely, and what they say. */
typedef struct possible {
  int32_t at[TSE_EVENTS], count;
  tse_real weight[TSE_EVENTS];
  event_says says[TSE_EVENTS];
} possible;

static void possible_of(const tse_kalman *k, possible *e)
{
  e->count = 0;
  for (int n = 0; n < TSE_EVENTS; n++) {
    if (k->weight[n] < LEAST_WEIGHT) continue;
    e->at[e->count] = n;
    e->weight[e->count] = k->weight[n];
    e->says[e->count++] = event_of(k, n);
  }
}

/* Return the variance of state i over the posterior, the uncertain quantities and the
 * events that may have happened; *shift: their mean. SI */
static tse_real variance_of(
    const tse_params *p, const tse_kalman *k, const possible *e, int i, tse_real *shift)
{
  if (i >= STATES) { /* nothing estimates it */
    *shift = TSE_R(0);
    return r_sqr(p->prior_sd[i]);
  }
  const tse_real var = own_variance_of(k, i);
  tse_real mean = TSE_R(0), square = TSE_R(0);
  for (int n = 0; n < e->count; n++) {
    const event_says *const s = &e->says[n];
    const tse_real second = s->second ? r_long(s->second->v[i]) : TSE_R(0);
    const tse_real by = r_long(k->event[e->at[n]].v[i]) - r_mul(s->part, second);
    const tse_real moved = r_mul(s->amplitude, by) + r_mul(s->beside, second);
    mean += r_mul(e->weight[n], moved);
    square += r_mul(
        e->weight[n], r_mul(moved, moved) + r_mul(r_sqr(by), s->var) + r_mul(r_sqr(second), s->beside_var));
  }
  *shift = r_mul(mean, state_unit[i]);
  return r_mul(r_max(var + square - r_mul(mean, mean), TSE_R(0)), r_sqr(state_unit[i]));
}

/* Return the posterior probability of no event, or of one too small to act on; product of
 * both groups. */
static tse_real probability_none(const tse_kalman *k) { return r_mul(k->none[0], k->none[1]); }

/* Return the regime when no event is waiting to be believed. */
static int regime_now(const tse_params *p, const tse_kalman *k)
{
  if (k->fault || is_frozen(k, STEERING)) return TSE_REGIME_FAULT;
  if (r_max(r_abs(k->x[SF]), r_abs(k->x[SR])) > p->max_slip) return TSE_REGIME_SLIDING;
  if (k->change_kind == TSE_CHANGE_NONE || !(k->change_age < SETTLE_TIME)) return TSE_REGIME_STEADY;
  if (k->change_kind == TSE_CHANGE_RESTART) return TSE_REGIME_RESTARTED;
  return k->change_kind == TSE_CHANGE_ROAD ? TSE_REGIME_CHANGED : TSE_REGIME_AXLE;
}

/* Report the motion; of one that is lost no sd beyond what it may be. What the model
 * lacks adds to var(v_y): (model_sd^2 + mass_var) ((lr r - v_y)^2 + (lr r)^2) + (ASKEW
 * v_x)^2. lr r - v_y is the rear axle's sideways speed, its force over its stiffness,
 * which is as uncertain as that. A measured velocity says more of it, or nothing: it
 * makes no speed less sure. */
static void report_motion(const tse_params *p, const tse_kalman *k, const possible *e, tse_output *out)
{
  tse_real *const state[3] = { &out->vel_x, &out->vel_y, &out->yaw_rate };
  tse_real *const state_sd[3] = { &out->vel_x_sd, &out->vel_y_sd, &out->yaw_rate_sd };
  tse_real shift;
  for (int i = 0; i < 3; i++) {
    *state_sd[i] = r_min(r_sqrt(variance_of(p, k, e, VX + i, &shift)), state_most[VX + i]); /* a lost one */
    *state[i] = r_clamp(k->x[VX + i] + shift, -state_most[VX + i], state_most[VX + i]);
  }
  const tse_real across = r_mul(p->car.lr, out->yaw_rate) - out->vel_y;
  const tse_real model = r_mul(
      r_sqr(across) + r_sqr(r_mul(p->car.lr, out->yaw_rate)), r_sqr(p->model_sd) + p->mass_var);
  const tse_real without = r_sqr(out->vel_y_sd) + model + r_sqr(r_mul(ASKEW, out->vel_x));
  if (k->ud.extras)
    out->vel_y = r_clamp(out->vel_y + velocity_discrepancy(k), -state_most[VY], state_most[VY]);
  out->vel_y_sd = r_sqrt(k->ud.extras ? r_min(velocity_across_var(k), without) : without);
  out->vel_y_sd = r_min(out->vel_y_sd, state_most[VY]);
  out->sideslip = r_max(r_abs(out->vel_x), r_abs(out->vel_y)) < LEAST_SPEED_ANGLE
      ? TSE_R(0)
      : r_atan2(out->vel_y, out->vel_x);
  out->sideslip_sd = r_min(r_div(out->vel_y_sd, r_max(r_abs(out->vel_x), LEAST_SPEED_SD)), HALF_TURN);
}

/* Return the variance of what the model lacks along the car, always the same. */
static tse_real lacks_along(const tse_params *p) { return r_sqr(r_max(USUAL_MODEL_SD, p->model_sd)); }

tse_real along_share(const tse_params *p, const tse_kalman *k, tse_real own, tse_real *var)
{
  const tse_real before = r_max(k->along.var, LEAST_ALONG),
                 left = r_min(r_mul(own, r_sqr(state_unit[LCX])), before), learnt = before - left;
  const tse_real share = r_div(before, before + r_mul(lacks_along(p), r_div(learnt, before)));
  *var = before - r_mul(share, learnt);
  return share;
}

/* Return the logarithm of the slip stiffness itself and its variance. Where the model
 * would lack more than it can, the tyres may be others.
 *   Given: shift  by what may have happened      Updated: var  of LCX */
static tse_real along_of(const tse_params *p, const tse_kalman *k, tse_real shift, tse_real *var)
{
  const tse_real own = own_variance_of(k, LCX), moved = k->x[LCX] - k->along.mean;
  tse_real itself;
  const tse_real part = r_mul(along_share(p, k, own, &itself), moved);
  *var = itself + r_max(*var - r_mul(own, r_sqr(state_unit[LCX])), TSE_R(0))
      + r_max(r_sqr(moved - part) - lacks_along(p), TSE_R(0));
  return k->along.mean + part + shift;
}

/* Report stiffness, grip and what the model does not explain. No stiffness is known
 * better than the model is right: with a measured velocity the covariance shrinks faster
 * than the model's error allows, so that the floor is higher. */
static void report_tyres(const tse_params *p, const tse_kalman *k, const possible *e, tse_output *out)
{
  const tse_real side_floor = k->ud.extras ? r_max(MODEL_FLOOR, r_mul(LASTING, p->model_sd)) : MODEL_FLOOR;
  tse_real shift, share[3];
  car_secants(&p->car, k->x, share);
  for (int i = 0; i < 3; i++) {
    const tse_real floor = i == TSE_CX_FRONT ? MODEL_FLOOR : side_floor;
    const int at = stiffness_at(i);
    tse_real var = variance_of(p, k, e, at, &shift);
    const tse_real log = HAS_SLIP && i == TSE_CX_FRONT ? along_of(p, k, shift, &var) : k->x[at] + shift;
    out->stiffness[i] = exponential(r_clamp(log, p->log_min, p->log_max));
    var += r_sqr(floor) + p->mass_var;
    out->stiffness_sd[i] = r_mul(out->stiffness[i], r_sqrt(var));
    out->stiffness_spread[i] = r_mul(out->stiffness[i], p->model_sd);
    out->stiffness_secant[i] = r_mul(out->stiffness[i], share[i]);
    out->spread_seen[i] = 0;
    out->discrepancy[i] = r_mul(p->model_sd, r_sqrt(k->activity[i]));
  }
  const tse_real var = variance_of(p, k, e, LMU, &shift);
  out->grip = r_mul(p->car.grip, exponential(r_clamp(k->x[LMU] + shift, -state_most[LMU], state_most[LMU])));
  out->grip_sd = r_mul(out->grip, r_sqrt(var + r_sqr(MODEL_FLOOR)));
}

/* Report biases, latencies, noise and innovations of the sensors. */
static void report_sensors(const tse_params *p, const tse_kalman *k, const possible *e, tse_output *out)
{
  tse_real shift;
  for (int i = 0; i < 3; i++) {
    out->bias_sd[i] = r_sqrt(variance_of(p, k, e, bias_at(i), &shift));
    out->bias[i] = k->x[bias_at(i)] + shift;
  }
  out->lag_steer_sd = r_sqrt(variance_of(p, k, e, LATE, &shift));
  out->lag_steer = k->x[LATE] + shift;
  for (int c = 0; c < TSE_SENSORS; c++) {
    out->noise[c] = r_sqrt(k->noise[c]);
    out->innovation[c] = k->innovation[c];
    out->nis[c] = k->nis[c];
  }
}

/* Report the probability of each regime: of events that wait to be believed, and of what
 * is so if none of them has happened. */
static void report_regimes(const tse_params *p, const tse_kalman *k, tse_output *out)
{
  tse_real sum = TSE_R(0);
  for (int r = 0; r < TSE_REGIMES; r++) out->regime[r] = TSE_R(0);
  for (int n = 0; n < TSE_EVENTS; n++) {
    const int32_t kind = k->event[n].kind;
    if (kind != EVENT_NONE && !event_is_small(k, n)) out->regime[event_regime(kind)] += k->weight[n];
  }
  for (int r = 0; r < TSE_REGIMES; r++) sum += out->regime[r];
  const tse_real share = r_div(TSE_R(1), r_max(sum, TSE_R(1))); /* two may have happened at once */
  for (int r = 0; r < TSE_REGIMES; r++) out->regime[r] = r_mul(share, out->regime[r]);
  out->regime[regime_now(p, k)] += r_max(TSE_R(1) - sum, TSE_R(0));
}

/* Return the channel of the likeliest fault where one is likelier than not and none is
 * believed yet, as fault_channel numbers it. So each row whose regime is a fault names
 * its channel. */
static int32_t likely_fault(const tse_kalman *k, const tse_output *out)
{
  int32_t channel = NO_FAULT;
  tse_real most = TSE_R(0);
  for (int n = 0; n < TSE_EVENTS && out->regime[TSE_REGIME_FAULT] > LIKELY; n++) {
    const int32_t kind = k->event[n].kind;
    if (kind == EVENT_NONE || event_regime(kind) != TSE_REGIME_FAULT || event_is_small(k, n)
        || !(k->weight[n] > most))
      continue;
    most = k->weight[n];
    channel = kind == EVENT_STEER ? (int32_t)FAULT_STEER : fault_of(kind - EVENT_SENSOR);
  }
  return channel;
}

/* Report the last change that was believed, and a channel at fault. */
static void report_change(const tse_params *p, const tse_kalman *k, tse_output *out)
{
  const int changed = k->change_kind != TSE_CHANGE_NONE;
  const tse_real most = p->log_max - p->log_min; /* as far as a stiffness goes, from end to end */
  for (int i = 0; i < 3; i++) {
    const tse_real by = r_clamp(k->x[stiffness_at(i)] - k->change_from[i], -most, most);
    out->change_ratio[i] = changed ? exponential(by) : TSE_R(1);
  }
  out->change_kind = k->change_kind;
  out->change_age = k->change_age;
  out->change_probability = changed ? probability_none(k) : TSE_R(0);
  const int32_t implausible = plausible_channel(k, &out->fault_factor), velocity = velocity_fault(k);
  out->fault_channel = implausible ? implausible
      : k->fault                   ? k->fault
      : is_frozen(k, STEERING)     ? (int32_t)FAULT_STEER
      : velocity                   ? velocity
                                   : likely_fault(k, out);
}

void report_row(const tse_params *p, const tse_kalman *k, tse_output *out)
{
  possible e;
  possible_of(k, &e);
  report_motion(p, k, &e, out);
  report_tyres(p, k, &e, out);
  report_sensors(p, k, &e, out);
  report_regimes(p, k, out);
  report_change(p, k, out);
  out->n_eff = TSE_R(1);
  out->log_evidence = k->log_likelihood;
}

/* Return whether slow innovations of a channel are larger than a model that fits leaves
 * them, or than usual: where no event names a channel at fault, they do. */
static int misfits(const tse_kalman *k, int channel)
{
  const tse_real usual = k->usual[channel];
  return usual > TAIL
      || r_sqr(k->slow[channel]) > r_mul(r_mul(TAIL, usual), r_max(k->slow_var[channel], LEAST_SLOW_VAR));
}

/* Return the first reason that applies.   Given: sd, mean  of the quantity, whose state
 *                                                          is `at` */
static tse_reason reason_of(const tse_params *p, const tse_kalman *k, const row_class *w,
    const tse_output *out, tse_real sd, tse_real mean, int at)
{
  const tse_real var = r_sqr(sd), most = r_mul(p->valid_var, r_sqr(mean));
  if (k->agreement.apart || k->agreement.off_scale) return TSE_IMPLAUSIBLE;
  if (w->predicted || w->sparse) return TSE_INPUT_INVALID;
  if (w->held) return TSE_HELD;
  if (k->seen < SETTLE_TIME) return TSE_STARTING;
  if (out->regime[TSE_REGIME_FAULT] > LIKELY) return TSE_SENSOR_FAULT;
  if (out->regime[TSE_REGIME_SLIDING] > LIKELY) return TSE_HELD;
  if (probability_none(k) < BELIEVED || (!HAS_SLIP && (misfits(k, ACCEL_Y) || misfits(k, YAW_RATE))))
    return TSE_MISFIT;
  if (var <= most) return TSE_VALID;
  tse_real consider_var = p->mass_var;
  for (int q = 0; q < TSE_CONSIDERED; q++)
    consider_var += r_sqr(r_mul(r_long(k->consider[q][at]), state_unit[at]));
  return r_mul(consider_var, r_sqr(mean)) > r_mul(TSE_R(0.5), var) /* the larger part */
      ? TSE_PARAMETERS_UNCERTAIN
      : TSE_UNCERTAIN;
}

/* Return whether the wheel radii differ from the settings by more than their prior
 * allows. The stiffness then holds an error from before the radii were found. */
static int has_other_wheels(const tse_params *p, const tse_kalman *k)
{
  return HAS_SLIP && r_sqr(k->x[RAD]) > r_max(r_sqr(RADII_APART), r_mul(TAIL, r_sqr(p->prior_sd[RAD])));
}

/* Return whether the steering angle comes at another time than the settings say, by more
 * than their prior allows. Cornering stiffness then stands for what the angle was not
 * yet. */
static int has_other_steering(const tse_params *p, const tse_output *out)
{
  const tse_real var = r_sqr(p->prior_sd[LATE]);
  return var > TSE_R(0) && r_sqr(out->lag_steer) > r_mul(TAIL, var);
}

void judge_row(const tse_params *p, const tse_kalman *k, const row_class *w, tse_output *out)
{
  for (int a = 0; a < 3; a++)
    out->reason[a] = (int32_t)reason_of(p, k, w, out, out->stiffness_sd[a], out->stiffness[a],
        a == TSE_CX_FRONT && !HAS_SLIP ? LCF : stiffness_at(a));
  /* No slip is seen where there is no second speed, and none where no axle rolls freely
   * and the road may climb: accel_x then says no speed. */
  const int has_speed = p->car.driven != 0 || w->rolls >= ROLLS_FRONT || !(p->prior_sd[GX] > TSE_R(0));
  const int32_t reason = out->reason[TSE_CX_FRONT];
  const int uncertain = reason == TSE_UNCERTAIN || reason == TSE_PARAMETERS_UNCERTAIN;
  const int shown = !w->no_second && has_speed && HAS_SLIP;
  if (!shown && (reason == TSE_VALID || (uncertain && w->no_second)))
    out->reason[TSE_CX_FRONT] = TSE_NOT_EXCITED;
  if (out->reason[TSE_CX_FRONT] == TSE_VALID && has_other_wheels(p, k))
    out->reason[TSE_CX_FRONT] = TSE_MISFIT;
  for (int a = TSE_CY_FRONT; a <= TSE_CY_REAR; a++) {
    if (out->reason[a] == TSE_VALID && has_other_steering(p, out)) out->reason[a] = TSE_MISFIT;
  }
  out->grip_reason = (int32_t)reason_of(p, k, w, out, out->grip_sd, out->grip, LMU);
  if (out->grip_reason == TSE_VALID && !(p->prior_sd[LMU] > TSE_R(0)))
    out->grip_reason = TSE_NOT_EXCITED; /* a setting, no estimate */
}

/* What an uncertainty is to the filter: the mass, the model error, a consider parameter
 * (CONSIDER_INERTIA ...), a state. */
enum { OF_MASS, OF_MODEL, OF_CONSIDER, OF_STATE };
typedef struct origin {
  int32_t of, at;
} origin;

/* Return what of the sd of state i, in its units, goes with an uncertainty. */
static tse_real part_of(const tse_params *p, const tse_kalman *k, origin o, int i)
{
  if (i >= STATES) return o.of == OF_MASS ? r_sqrt(p->mass_var) : o.of == OF_MODEL ? MODEL_FLOOR : TSE_R(0);
  if ((o.of == OF_STATE && o.at >= STATES) || (o.of == OF_CONSIDER && o.at >= TSE_CONSIDERED))
    return TSE_R(0);
  if (o.of == OF_MASS) return r_div(r_sqrt(p->mass_var), state_unit[i]);
  if (o.of == OF_MODEL) return r_div(MODEL_FLOOR, state_unit[i]);
  if (o.of == OF_STATE)
    return r_div(r_abs(ud_covariance(&k->ud, i, o.at)), r_sqrt(ud_variance(&k->ud, o.at)));
  if ((int)CONSIDER_RELAXATION_REAR < TSE_CONSIDERED
      && o.at == CONSIDER_RELAXATION_FRONT) /* and that of the rear axle */
    return r_sqrt(r_sqr(r_long(k->consider[o.at][i])) + r_sqr(r_long(k->consider[o.at + 1][i])));
  return r_abs(r_long(k->consider[o.at][i]));
}

tse_status tse_uncertainty_sd(const tse_params *p, const tse_filter *f, int32_t k, tse_real sd[3])
{
  /* in the order of TSE_CONSIDER_ */
  static const origin origins[TSE_UNCERTAINTIES] = {
    { OF_MASS, 0 },
    { OF_CONSIDER, CONSIDER_INERTIA },
    { OF_CONSIDER, CONSIDER_CENTRE },
    { OF_STATE, GAIN },
    { OF_STATE, STEER_OFFSET },
    { OF_CONSIDER, CONSIDER_SCALE },
    { OF_CONSIDER, CONSIDER_WHEELS_LATE },
    { OF_CONSIDER, CONSIDER_ACCEL_LATE },
    { OF_CONSIDER, CONSIDER_RELAXATION_FRONT },
    { OF_STATE, LEAN },
    { OF_CONSIDER, CONSIDER_GYRO },
    { OF_CONSIDER, CONSIDER_TRAIL },
    { OF_CONSIDER, CONSIDER_ROLL_STEER },
    { OF_STATE, RAD },
    { OF_MODEL, 0 },
  };
  if (!p || !f || !sd) return TSE_E_NULL;
  if (!params_match(p, f) || p->form != 0) return TSE_E_STATE;
  if (k < 0 || k >= TSE_UNCERTAINTIES) return TSE_E_SIZE;
  for (int a = 0; a < 3; a++) {
    const int i = stiffness_at(a);
    const tse_real all = f->step == 0 ? TSE_R(0) : part_of(p, &f->k, origins[k], i);
    tse_real itself;
    const tse_real part = HAS_SLIP && i == LCX && origins[k].of >= OF_CONSIDER
        ? r_mul(along_share(p, &f->k, own_variance_of(&f->k, LCX), &itself), all)
        : all;
    sd[a] = r_mul(exponential(f->k.x[i]), i < STATES ? r_mul(part, state_unit[i]) : part);
  }
  return TSE_OK;
}
