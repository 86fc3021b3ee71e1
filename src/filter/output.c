/* filter/output.c - output of a row: the estimates, and whether they are valid. */
#include "filter/events.h"
#include "filter/exponential.h"
#include "filter/faults.h"
#include "filter/output.h"
#include "filter/plausible.h"
#include "filter/sensitivities.h"
#include "filter/slip_stiffness.h"
#include "filter/units.h"
#include "filter/velocity.h"

/* Result of collect_possible(): the events whose probability is at least MIN_WEIGHT. For
 * each of the `count` events: at, its index in tse_kalman.event; weight, its probability;
 * posterior, the posterior of its amplitude. */
typedef struct possible {
  int32_t at[TSE_EVENTS], count;
  tse_real weight[TSE_EVENTS];
  event_posterior posterior[TSE_EVENTS];
} possible;

/* Collect the events whose probability is at least MIN_WEIGHT. */
static void collect_possible(const tse_kalman *k, possible *e)
{
  e->count = 0;
  for (int n = 0; n < TSE_EVENTS; n++) {
    if (k->weight[n] < MIN_WEIGHT) continue;
    e->at[e->count] = n;
    e->weight[e->count] = k->weight[n];
    e->posterior[e->count++] = compute_posterior(k, n);
  }
}

/* Return the variance of state i [square of its SI unit]. It includes the variance due to
 * consider parameters, and the variance due to events that may or may not have happened.
 *   Given:     e       these events: possible, but not accepted yet
 *   Returned:  *shift  [SI unit] expected shift of the state by the events: sum of
 *                      probability times shift */
static tse_real compute_variance(
    const tse_params *p, const tse_kalman *k, const possible *e, int i, tse_real *shift)
{
  if (i >= STATES) { /* a state that TSE_SMALL does not estimate */
    *shift = TSE_R(0);
    return r_sqr(p->prior_sd[i]);
  }
  const tse_real var = compute_total_variance(k, i);
  tse_real mean = TSE_R(0), square = TSE_R(0);
  for (int n = 0; n < e->count; n++) {
    const event_posterior *const s = &e->posterior[n];
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

/* Return the posterior probability that no event large enough to need a reaction has
 * happened: neither in the lateral nor in the longitudinal group of events (events.c). */
static tse_real compute_no_event(const tse_kalman *k) { return r_mul(k->none[0], k->none[1]); }

/* Return the present regime: a fault, sliding wheels, a recent change or restart, or
 * steady driving. Events that may have happened but are not accepted yet do not count. */
static int find_regime(const tse_params *p, const tse_kalman *k)
{
  if (k->fault || is_frozen(k, STEERING)) return TSE_REGIME_FAULT;
  if (r_max(r_abs(k->x[SF]), r_abs(k->x[SR])) > p->max_slip) return TSE_REGIME_SLIDING;
  if (k->change_kind == TSE_CHANGE_NONE || !(k->change_age < SETTLE_TIME)) return TSE_REGIME_STEADY;
  if (k->change_kind == TSE_CHANGE_RESTART) return TSE_REGIME_RESTARTED;
  return k->change_kind == TSE_CHANGE_ROAD ? TSE_REGIME_CHANGED : TSE_REGIME_AXLE;
}

/* Return the mean of state i [SI unit]: its estimate plus `shift`, limited to the range
 * of the state. If TSE_SMALL does not estimate it (latency of the steering), it is a
 * constant, which is returned without a change.
 *   Given:  shift  expected shift by possible events, from compute_variance() */
static tse_real compute_mean(const tse_kalman *k, int i, tse_real shift)
{
  return i < STATES ? r_clamp(k->x[i] + shift, -state_max[i], state_max[i]) : k->x[i];
}

/* Report the motion. While the motion is unknown (tse_filter.lost), its sds grow, up to
 * state_max.
 *
 * Errors of the model add to the variance of v_y that the filter computes. Let r be the
 * yaw rate, lr the distance of the rear axle from the centre of gravity, and s the
 * sideways speed of the rear axle, positive to the right: v_y = lr r - s. There are three
 * errors:
 *   - s is proportional to the ratio of tyre force to stiffness, whose relative variance
 *     is model_sd^2 + mass_var;
 *   - lr r is assumed to have the same relative variance;
 *   - a car that drives straight ahead has a sideslip angle with the sd ASKEW.
 * Together they add to the variance of v_y
 *   (model_sd^2 + mass_var) (s^2 + (lr r)^2) + (ASKEW v_x)^2
 * Measured velocities, if any, give a second variance of v_y. The smaller of the two
 * variances is reported. */
static void report_motion(const tse_params *p, const tse_kalman *k, const possible *e, tse_output *out)
{
  tse_real *const state[3] = { &out->vel_x, &out->vel_y, &out->yaw_rate };
  tse_real *const state_sd[3] = { &out->vel_x_sd, &out->vel_y_sd, &out->yaw_rate_sd };
  tse_real shift;
  for (int i = 0; i < 3; i++) {
    *state_sd[i] = r_min(r_sqrt(compute_variance(p, k, e, VX + i, &shift)), state_max[VX + i]);
    *state[i] = compute_mean(k, VX + i, shift);
  }
  const tse_real across = r_mul(p->car.lr, out->yaw_rate) - out->vel_y;
  const tse_real model = r_mul(
      r_sqr(across) + r_sqr(r_mul(p->car.lr, out->yaw_rate)), r_sqr(p->model_sd) + p->mass_var);
  const tse_real unmeasured = r_sqr(out->vel_y_sd) + model + r_sqr(r_mul(ASKEW, out->vel_x));
  if (k->ud.extras) out->vel_y = r_clamp(out->vel_y + velocity_discrepancy(k), -state_max[VY], state_max[VY]);
  out->vel_y_sd = r_sqrt(k->ud.extras ? r_min(velocity_across_var(k), unmeasured) : unmeasured);
  out->vel_y_sd = r_min(out->vel_y_sd, state_max[VY]);
  out->sideslip = r_max(r_abs(out->vel_x), r_abs(out->vel_y)) < MIN_SIDESLIP_SPEED
      ? TSE_R(0)
      : r_atan2(out->vel_y, out->vel_x);
  out->sideslip_sd = r_min(r_div(out->vel_y_sd, r_max(r_abs(out->vel_x), MIN_SIDESLIP_SD_SPEED)), HALF_TURN);
}

/* Report stiffness, grip and model discrepancy. The relative variance of a stiffness is
 * the sum of three variances: of the state, of the model error and of the mass. The sd of
 * the model error is MODEL_FLOOR. While measured velocities are used, the sd for a
 * cornering stiffness is at least LASTING times model_sd: the velocities reduce the
 * variance of the state, but the error of the model remains. */
static void report_tyres(const tse_params *p, const tse_kalman *k, const possible *e, tse_output *out)
{
  const tse_real side_floor = k->ud.extras ? r_max(MODEL_FLOOR, r_mul(LASTING, p->model_sd)) : MODEL_FLOOR;
  tse_real shift, share[3];
  car_secants(&p->car, k->x, share);
  for (int i = 0; i < 3; i++) {
    const tse_real floor = i == TSE_CX_FRONT ? MODEL_FLOOR : side_floor;
    const int at = stiffness_at(i);
    tse_real var = compute_variance(p, k, e, at, &shift);
    const tse_real c = HAS_SLIP && i == TSE_CX_FRONT ? along_estimate(p, k, shift, &var) : k->x[at] + shift;
    out->stiffness[i] = compute_exponential(r_clamp(c, p->log_min, p->log_max));
    var += r_sqr(floor) + p->mass_var;
    out->stiffness_sd[i] = r_mul(out->stiffness[i], r_sqrt(var));
    out->stiffness_spread[i] = r_mul(out->stiffness[i], p->model_sd);
    out->stiffness_secant[i] = r_mul(out->stiffness[i], share[i]);
    out->spread_seen[i] = 0;
    out->discrepancy[i] = r_mul(p->model_sd, r_sqrt(k->activity[i]));
  }
  const tse_real var = compute_variance(p, k, e, LMU, &shift);
  out->grip = r_mul(p->car.grip, compute_exponential(compute_mean(k, LMU, shift)));
  out->grip_sd = r_mul(out->grip, r_sqrt(var + r_sqr(MODEL_FLOOR)));
}

/* Report biases, latencies, noise and innovations of the sensors. */
static void report_sensors(const tse_params *p, const tse_kalman *k, const possible *e, tse_output *out)
{
  tse_real shift;
  for (int i = 0; i < 3; i++) {
    out->bias_sd[i] = r_sqrt(compute_variance(p, k, e, bias_at(i), &shift));
    out->bias[i] = compute_mean(k, bias_at(i), shift);
  }
  out->lag_steer_sd = r_sqrt(compute_variance(p, k, e, LATE, &shift));
  out->lag_steer = compute_mean(k, LATE, shift);
  for (int c = 0; c < TSE_SENSORS; c++) {
    out->noise[c] = r_sqrt(k->noise[c]);
    out->innovation[c] = k->innovation[c];
    out->nis[c] = k->nis[c];
  }
}

/* Report the probability of each regime. An event that is not accepted yet adds its
 * probability to the regime that would start with it. The rest of the probability goes to
 * the present regime. */
static void report_regimes(const tse_params *p, const tse_kalman *k, tse_output *out)
{
  tse_real sum = TSE_R(0);
  for (int r = 0; r < TSE_REGIMES; r++) out->regime[r] = TSE_R(0);
  for (int n = 0; n < TSE_EVENTS; n++) {
    const int32_t kind = k->event[n].kind;
    if (kind != EVENT_NONE && !event_is_small(k, n)) out->regime[event_regime(kind)] += k->weight[n];
  }
  for (int r = 0; r < TSE_REGIMES; r++) sum += out->regime[r];
  /* the probabilities of the events of one group (lateral or longitudinal) add up to at
   * most 1, those of both groups to at most 2. If the sum exceeds 1, divide by it */
  const tse_real share = r_div(TSE_R(1), r_max(sum, TSE_R(1)));
  for (int r = 0; r < TSE_REGIMES; r++) out->regime[r] = r_mul(share, out->regime[r]);
  out->regime[find_regime(p, k)] += r_max(TSE_R(1) - sum, TSE_R(0));
}

/* Return the channel of the most probable fault that is not accepted yet, or NO_FAULT if
 * the probability of TSE_REGIME_FAULT is at most LIKELY. Above LIKELY the estimates have
 * the reason TSE_SENSOR_FAULT (find_reason()). */
static int32_t find_likely_fault(const tse_kalman *k, const tse_output *out)
{
  int32_t channel = NO_FAULT;
  tse_real largest = TSE_R(0);
  for (int n = 0; n < TSE_EVENTS && out->regime[TSE_REGIME_FAULT] > LIKELY; n++) {
    const int32_t kind = k->event[n].kind;
    if (kind == EVENT_NONE || event_regime(kind) != TSE_REGIME_FAULT || event_is_small(k, n)) continue;
    if (!(k->weight[n] > largest)) continue;
    largest = k->weight[n];
    channel = event_fault(kind);
  }
  return channel;
}

/* Report the last accepted change of the stiffness (different road, different tyres) or
 * restart of the filter, and the channel at fault, if there is one. */
static void report_change(const tse_params *p, const tse_kalman *k, tse_output *out)
{
  const int changed = k->change_kind != TSE_CHANGE_NONE;
  const tse_real range = p->log_max - p->log_min;
  for (int i = 0; i < 3; i++) {
    const tse_real change = r_clamp(k->x[stiffness_at(i)] - k->change_from[i], -range, range);
    out->change_ratio[i] = changed ? compute_exponential(change) : TSE_R(1);
  }
  out->change_kind = k->change_kind;
  out->change_age = k->change_age;
  out->change_probability = changed ? compute_no_event(k) : TSE_R(0);
  const int32_t implausible = find_implausible_channel(k, &out->fault_factor), velocity = velocity_fault(k);
  out->fault_channel = implausible ? implausible
      : k->fault                   ? k->fault
      : is_frozen(k, STEERING)     ? (int32_t)FAULT_STEER
      : velocity                   ? velocity
                                   : find_likely_fault(k, out);
}

void report_row(const tse_params *p, const tse_kalman *k, tse_output *out)
{
  possible e;
  collect_possible(k, &e);
  report_motion(p, k, &e, out);
  report_tyres(p, k, &e, out);
  report_sensors(p, k, &e, out);
  report_regimes(p, k, out);
  report_change(p, k, out);
  out->n_eff = TSE_R(1);
  out->log_evidence = k->log_likelihood;
}

/* Return whether the model does not fit a channel: the squared low-passed innovation
 * exceeds TAIL times its usual mean square (tse_kalman.usual times its predicted
 * variance), or tse_kalman.usual exceeds TAIL. Only a TSE_SMALL build uses this test,
 * because its events do not find faulty channels. */
static int is_misfit(const tse_kalman *k, int channel)
{
  const tse_real usual = k->usual[channel];
  return usual > TAIL
      || r_sqr(k->slow[channel]) > r_mul(r_mul(TAIL, usual), r_max(k->slow_var[channel], MIN_SLOW_VAR));
}

/* Return TSE_VALID or, if the estimate is not valid, the first reason that applies.
 *   Given:  sd, mean  of the estimate
 *           at        index of its state */
static tse_reason find_reason(const tse_params *p, const tse_kalman *k, const row_class *w,
    const tse_output *out, tse_real sd, tse_real mean, int at)
{
  const tse_real var = r_sqr(sd);
  if (k->agreement.apart || k->agreement.off_scale) return TSE_IMPLAUSIBLE;
  if (w->predicted || w->sparse) return TSE_INPUT_INVALID;
  if (w->held) return TSE_HELD;
  if (k->seen < SETTLE_TIME) return TSE_STARTING;
  if (out->regime[TSE_REGIME_FAULT] > LIKELY) return TSE_SENSOR_FAULT;
  if (out->regime[TSE_REGIME_SLIDING] > LIKELY) return TSE_HELD;
  if (compute_no_event(k) < BELIEVED || (!HAS_SLIP && (is_misfit(k, ACCEL_Y) || is_misfit(k, YAW_RATE))))
    return TSE_MISFIT;
  if (var <= r_mul(p->valid_var, r_sqr(mean))) return TSE_VALID;
  tse_real consider_var = p->mass_var;
  for (int q = 0; q < TSE_CONSIDERED; q++)
    consider_var += r_sqr(r_mul(r_long(k->consider[q][at]), state_unit[at]));
  const int parameters_dominate = r_mul(consider_var, r_sqr(mean)) > r_mul(TSE_R(0.5), var);
  return parameters_dominate ? TSE_PARAMETERS_UNCERTAIN : TSE_UNCERTAIN;
}

/* Return whether the estimated ratio of the wheel radii differs from the ratio in the
 * settings by more than its prior allows: by more than 3 prior sds, and by more than
 * MAX_RADIUS_ERROR. Before the filter found this difference, the longitudinal stiffness
 * absorbed a part of it. The stiffness is therefore wrong. */
static int has_other_wheels(const tse_params *p, const tse_kalman *k)
{
  return HAS_SLIP && r_sqr(k->x[RAD]) > r_max(r_sqr(MAX_RADIUS_ERROR), r_mul(TAIL, r_sqr(p->prior_sd[RAD])));
}

/* Return whether the estimated lag of the steering angle differs by more than 3 prior sds
 * from the lag in the settings, or from 0. In the first case the estimate contradicts the
 * settings. In the second case the lag is too large for the model, which is linear in the
 * lag: (delayed angle) = angle - lag x (rate of the angle). In both cases the delayed
 * angle is wrong while the angle changes. The cornering stiffness compensates for this
 * error, and is therefore wrong, too. Return 0 if the prior sd of the lag is 0. */
static int has_other_steering(const tse_params *p, const tse_output *out)
{
  const tse_real lag = out->lag_steer, var = r_sqr(p->prior_sd[LATE]), max_var = r_mul(TAIL, var);
  return var > TSE_R(0) && (r_sqr(lag - p->prior[LATE]) > max_var || r_sqr(lag) > max_var);
}

void judge_row(const tse_params *p, const tse_kalman *k, const row_class *w, tse_output *out)
{
  for (int a = 0; a < 3; a++)
    out->reason[a] = (int32_t)find_reason(p, k, w, out, out->stiffness_sd[a], out->stiffness[a],
        a == TSE_CX_FRONT && !HAS_SLIP ? LCF : stiffness_at(a));
  /* Slip is the relative difference between the speeds of wheel and car. The speed of the
   * car is measured by an axle that rolls freely, for example the undriven axle. If no
   * axle rolls freely, the speed follows from accel_x, but only if all roads are flat
   * according to the settings. If neither gives the speed, the longitudinal stiffness is
   * not valid. */
  const int has_speed = p->car.driven != 0 || is_rolling_axle(w->rolls) || !(p->prior_sd[GX] > TSE_R(0));
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
  out->grip_reason = (int32_t)find_reason(p, k, w, out, out->grip_sd, out->grip, LMU);
  if (out->grip_reason == TSE_VALID && !(p->prior_sd[LMU] > TSE_R(0)))
    out->grip_reason = TSE_NOT_EXCITED; /* the grip is a setting and not estimated */
}

/* Kinds of uncertainty: the mass, the model error, a consider parameter, a state. */
enum { OF_MASS, OF_MODEL, OF_CONSIDER, OF_STATE };

/* An uncertainty. of: its kind (OF_MASS ...). at: for OF_CONSIDER and OF_STATE the index
 * of the parameter or of the state that is uncertain, otherwise 0. */
typedef struct origin {
  int32_t of, at;
} origin;

/* Return the part of the sd of state i that is due to an uncertainty. The unit is
 * state_unit[i], or 1 for a stiffness that TSE_SMALL does not estimate. */
static tse_real compute_part(const tse_params *p, const tse_kalman *k, origin o, int i)
{
  if (i >= STATES) return o.of == OF_MASS ? r_sqrt(p->mass_var) : o.of == OF_MODEL ? MODEL_FLOOR : TSE_R(0);
  if ((o.of == OF_STATE && o.at >= STATES) || (o.of == OF_CONSIDER && o.at >= TSE_CONSIDERED))
    return TSE_R(0);
  if (o.of == OF_MASS) return r_div(r_sqrt(p->mass_var), state_unit[i]);
  if (o.of == OF_MODEL) return r_div(MODEL_FLOOR, state_unit[i]);
  if (o.of == OF_STATE)
    return r_div(r_abs(ud_covariance(&k->ud, i, o.at)), r_sqrt(ud_variance(&k->ud, o.at)));
  const int both_axles = (int)CONSIDER_RELAXATION_REAR < TSE_CONSIDERED && o.at == CONSIDER_RELAXATION_FRONT;
  const tse_real part = r_long(k->consider[o.at][i]);
  return both_axles ? r_sqrt(r_sqr(part) + r_sqr(r_long(k->consider[o.at + 1][i]))) : r_abs(part);
}

tse_status tse_uncertainty_sd(const tse_params *p, const tse_filter *f, int32_t k, tse_real sd[3])
{
  /* in the order of TSE_CONSIDER_... (tse/config.h) */
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
    const tse_real all = f->step == 0 ? TSE_R(0) : compute_part(p, &f->k, origins[k], i);
    const int by_filter = origins[k].of == OF_CONSIDER || origins[k].of == OF_STATE;
    tse_real var, part = all;
    if (HAS_SLIP && i == LCX && by_filter)
      part = r_mul(along_share(p, &f->k, compute_total_variance(&f->k, LCX), &var), all);
    sd[a] = r_mul(compute_exponential(f->k.x[i]), i < STATES ? r_mul(part, state_unit[i]) : part);
  }
  return TSE_OK;
}
