/* filter/step.c - process a row with the default filter: start reading here. The files:
 *
 *   row.c             decode a log row
 *   start.c           initial state: the prior, and the motion from the sensors
 *   backwards.c       find whether the car rolls backwards
 *   predict.c         predict to the time of the row (model/car.c: forces, motion and
 *                     sensors of the car; ud.c: the covariance)
 *   update.c          update with the sensors of the row, one after the other
 *   velocity.c        update with measured velocities
 *   scalar.c          update with one scalar measurement
 *   events.c          hypotheses of events (changed road or tyres, sliding wheels, a
 *                     channel at fault), and their probabilities
 *   faults.c          find frozen channels, and measure for how long a channel at fault
 *                     has agreed with the prediction again
 *   sensitivities.c   sensitivities of the state to events and consider parameters
 *   slip_stiffness.c  slip stiffness without the longitudinal model error
 *   plausible.c       test whether the channels agree: wrong units, signs, axles
 *   output.c          estimates, and whether they are valid */
#include "filter/backwards.h"
#include "filter/events.h"
#include "filter/faults.h"
#include "filter/output.h"
#include "filter/plausible.h"
#include "filter/predict.h"
#include "filter/row.h"
#include "filter/sensitivities.h"
#include "filter/start.h"
#include "filter/step.h"
#include "filter/update.h"
#include "filter/velocity.h"

static int has_wheel_speed(const decoded *z) { return z->use[WHEEL_FRONT] || z->use[WHEEL_REAR]; }

/* Return whether all wheel speeds of this row exceed those of the previous row by more
 * than a car can accelerate in dt. There are two causes: an outlier, or the return from
 * wrong zeros in the log to the true speed. A fast decrease is no such jump, because
 * wheels may lock. */
static int has_jumped(const tse_params *p, const tse_filter *f, const decoded *z)
{
  const tse_real max_rise = p->hold_speed + r_mul(JUMP_RATE, z->dt);
  const tse_real front = z->z[WHEEL_FRONT] - f->v_front, rear = z->z[WHEEL_REAR] - f->v_rear;
  return f->step > 0 && has_wheel_speed(z) && !(z->use[WHEEL_FRONT] && front < max_rise)
      && !(z->use[WHEEL_REAR] && rear < max_rise);
}

/* Return the speed of an axle. If the row has no wheel speed of this axle, return the
 * speed of the other axle. */
static tse_real get_axle_speed(const decoded *z, int axle)
{
  return z->z[z->use[axle] ? axle : WHEEL_FRONT + WHEEL_REAR - axle];
}

/* Return the larger magnitude of the axle speeds, or |v_x| of the state if
 * both are missing. */
static tse_real compute_speed(const tse_filter *f, const decoded *z)
{
  return has_wheel_speed(z)
      ? r_max(r_abs(get_axle_speed(z, WHEEL_FRONT)), r_abs(get_axle_speed(z, WHEEL_REAR)))
      : r_abs(f->k.x[VX]);
}

/* Store the wheel speeds and their ratio. In the next row find_one_speed() (row.c) needs
 * them to decide whether the wheel speeds of both axles are copies of one signal.
 *
 * Also update off_for [s] of each axle. While it is above 0, the wheel speed of the axle
 * counts as a signal of its own. A new wheel speed that is no copy of the one of the
 * other axle sets it to USUAL_TIME. It decreases while the two wheel speeds agree, or
 * while one of them is missing. */
static void keep_speeds(const tse_params *p, tse_filter *f, const decoded *z)
{
  const int has[2] = { z->use[WHEEL_FRONT] || z->one_speed, z->use[WHEEL_REAR] }, both = has[0] && has[1];
  const int is_new = !(f->ratio > TSE_R(0)) || (z->off[0] && z->off[1]);
  for (int a = 0; a < 2; a++) {
    if (z->off[a]) f->off_for[a] = USUAL_TIME;
    else if (z->same || !both) f->off_for[a] = r_max(f->off_for[a] - z->dt, TSE_R(0));
  }
  if (both && (is_new || z->equal) && z->axle[1] > p->hold_speed) {
    const tse_real ratio = r_clamp(r_div(z->axle[0], z->axle[1]), MIN_SPEED_RATIO, MAX_SPEED_RATIO);
    f->ratio = z->equal ? TSE_R(1) : ratio;
  }
  if (has[0]) f->v_front = z->axle[0];
  if (has[1]) f->v_rear = z->axle[1];
}

/* Update the number of recent gaps. A gap lies before a row to which the motion cannot be
 * predicted from the previous row. Each gap adds 1 to the number. In rows without a gap
 * the number decays with the time constant USUAL_TIME. */
static void count_gaps(tse_filter *f, int gap, tse_real dt)
{
  const tse_real left = r_max(TSE_R(1) - r_div(dt, USUAL_TIME), TSE_R(0));
  f->gaps = gap ? r_min(f->gaps + TSE_R(1), MAX_SINCE) : r_mul(f->gaps, left);
}

/* Store the wheel speeds for the next row, and advance the timers [s]:
 *   held_for    time since the last row with a steering angle
 *   rolled_for  time since the last row with a wheel speed
 *   still_for   time since the wheels have stopped
 *   off_for     see keep_speeds()
 * If held_for exceeds the setting max_gap, or rolled_for exceeds ROAD_TIME, the motion of
 * the car is lost, i.e. unknown. It stays lost until a row has both steering angle and
 * wheel speed again. */
static void advance_timers(const tse_params *p, tse_filter *f, const decoded *z, tse_real speed)
{
  const int wheels = has_wheel_speed(z);
  f->held_for = z->has_steer ? TSE_R(0) : r_min(f->held_for + z->dt, MAX_TIME);
  f->rolled_for = wheels ? TSE_R(0) : r_min(f->rolled_for + z->dt, MAX_TIME);
  f->lost = f->held_for > p->max_gap || f->rolled_for > ROAD_TIME || (f->lost && !(z->has_steer && wheels));
  f->still_for = wheels && speed < STILL_SPEED ? r_min(f->still_for + z->dt, STILL_TIME) : TSE_R(0);
  keep_speeds(p, f, z);
}

/* Classify the row (row_class in output.h). The class decides whether the motion is
 * predicted to this row, which status the row has, and which estimates are valid.
 *   Given:    f    with timers that include this row
 *             gap  1: the motion cannot be predicted from the previous row to this one
 *   Updated:  f->way  log odds of reverse, see rolls_backwards() */
static row_class classify_row(const tse_params *p, tse_filter *f, const decoded *z, tse_real speed, int gap)
{
  const tse_real slower = r_min(get_axle_speed(z, WHEEL_FRONT), get_axle_speed(z, WHEEL_REAR));
  const int reverse = rolls_backwards(p, f, z, speed) || slower < -p->hold_speed;
  row_class w;
  w.gap = gap;
  w.sparse = f->gaps > r_mul(MAX_GAP_RATE, r_min(f->k.seen + TSE_R(1), USUAL_TIME));
  w.predicted = f->lost || z->used == 0 || !z->has_steer;
  w.no_second = z->no_second;
  w.rolls = z->rolls;
  w.held = speed < p->hold_speed || reverse || r_abs(z->steer) > p->max_steer;
  return w;
}

/* Return whether all real numbers of tse_agreement are finite. They are its
 * members before `apart`. */
static int is_agreement_finite(const tse_agreement *a)
{
  int fine = 1;
  for (size_t at = 0; at < offsetof(tse_agreement, apart); at += sizeof(tse_real)) {
    tse_real x;
    memcpy(&x, (const uint8_t *)a + at, sizeof x);
    fine = fine && r_is_finite(x);
  }
  return fine;
}

/* Return whether all states and all elements of D (the variances in U D U') are finite,
 * and no element of D is negative. */
static int is_state_finite(const tse_kalman *k)
{
  int fine = 1;
  for (int i = 0; i < STATES; i++)
    fine = fine && r_is_finite(k->x[i]) && r_is_finite(k->ud.d[i]) && k->ud.d[i] >= TSE_R(0);
  for (int i = 0; i < k->ud.extras; i++)
    fine = fine && r_is_finite(k->x[STATES + i]) && r_is_finite(k->ud.e[i]) && k->ud.e[i] >= TSE_R(0);
  return fine;
}

/* Return whether a vector of the filter has an element near saturation. If so, the row
 * has the status TSE_W_RANGE. In double and float elements do not saturate, and the
 * result is 0 (r_near_end() in number/vector.h). */
static int is_near_saturation(const tse_kalman *k)
{
  int near = r_near_end(k->ud.u, STATES * (STATES - 1) / 2);
  for (int e = 0; e < k->ud.extras; e++) near = near || r_near_end(k->ud.w[e], TSE_ALL);
  for (int n = 0; n < TSE_EVENTS; n++)
    near = near || (k->event[n].kind != EVENT_NONE && r_near_end(k->event[n].v, TSE_ALL));
  for (int q = 0; q < TSE_CONSIDERED; q++) near = near || r_near_end(k->consider[q], TSE_ALL);
  return near;
}

/* Return the most severe warning that applies to the row: the one with the largest code.
 * TSE_OK: no warning applies. */
static tse_status find_status(
    const tse_filter *f, const decoded *z, const row_class *w, const tse_output *out)
{
  tse_status status = TSE_OK;
  for (int a = 0; a < 3; a++)
    if (out->reason[a] != TSE_VALID) status = TSE_W_NOT_VALID;
  if (f->k.seen < SETTLE_TIME) status = worse(status, TSE_W_STARTING);
  if (z->used < IMU_CHANNELS || !(z->use[WHEEL_FRONT] || z->one_speed) || !z->use[WHEEL_REAR]
      || !z->has_steer)
    status = worse(status, TSE_W_MISSING_CHANNEL);
  if (w->held) status = worse(status, TSE_W_HELD);
  if (w->predicted) status = worse(status, TSE_W_PREDICTED);
  if (w->gap) status = worse(status, TSE_W_GAP);
  if (is_near_saturation(&f->k)) status = worse(status, TSE_W_RANGE);
  if (f->k.change_kind == TSE_CHANGE_RESTART && f->k.change_age == TSE_R(0))
    status = worse(status, TSE_W_RECOVERED);
  if (f->k.agreement.apart || f->k.agreement.off_scale) status = worse(status, TSE_W_IMPLAUSIBLE);
  return status;
}

/* Process a row in which the motion is not predicted: the car is slow, in reverse or
 * steers by a large angle; the motion cannot be predicted from the previous row; the
 * motion is lost; or the filter has not started yet.
 *
 * Before the start, initialise the motion from wheel speeds and gyro. The filter starts
 * with the first row that has both steering angle and wheel speed. After the start,
 * predict the slow states, and initialise the motion unless it is lost. In both cases
 * update the gyro bias at standstill. */
static void place_row(const tse_params *p, tse_filter *f, const decoded *z)
{
  tse_kalman *const k = &f->k;
  for (int a = 0; a < TSE_SENSORS; a++) k->innovation[a] = k->innovation_var[a] = k->nis[a] = TSE_R(0);
  k->log_likelihood = TSE_R(0);
  velocity_lose(k);
  if (f->started) predict_slow_states(p, k, z->dt);
  if (!f->lost || !f->started) start_motion(p, k, z);
  if (!(f->still_for < STILL_TIME)) update_at_standstill(p, k, z);
  f->started = f->started || (z->has_steer && has_wheel_speed(z));
}

/* Return whether the motion is known: its elements of D and the sums of squares of its
 * sensitivities are below MAX_D. If the motion diverges, they exceed MAX_D long before a
 * number overflows. It can diverge with unrealistic settings, even within one row, and in
 * an unstable (oversteering) car while measurements are missing. */
static int is_motion_known(const tse_kalman *k)
{
  int known = are_sensitivities_known(k);
  for (int i = 0; i < MOTION; i++)
    if (!(k->ud.d[i] < MAX_D)) known = 0;
  return known;
}

/* Predict to the row, update with its measurements, and decide on events. If the row has
 * no steering angle, predict with the last angle, and use no sensor. Otherwise the filter
 * would take the difference between the last and the true angle for a change of the
 * stiffness. */
static void follow_row(const tse_params *p, tse_kalman *k, decoded *z)
{
  const steering angle = predict_row(p, k, z);
  velocity_move(p, k, z);
  for (int a = 0; a < TSE_SENSORS && !z->has_steer; a++) z->use[a] = 0;
  update_row(p, k, z, angle);
  events_decide(p, k, z->dt);
  k->seen = r_min(k->seen + z->dt, MAX_TIME);
}

/* Restart from the prior, or from the learnt state that was loaded. */
static void restart_filter(const tse_params *p, tse_filter *f, const decoded *z)
{
  tse_kalman *const k = &f->k;
  memset(k, 0, sizeof *k);
  start_state(p, f);
  start_motion(p, k, z);
  k->change_kind = TSE_CHANGE_RESTART;
  for (int a = 0; a < 3; a++) {
    k->change_from[a] = k->x[stiffness_at(a)];
    f->known[a] = TSE_UNKNOWN;
  }
}

/* Restart after the steering angle has turned out to be frozen. Before this was known,
 * stiffness, steering offset and steering ratio had absorbed the error of the angle. The
 * evidence that the angle is frozen is kept. */
static void restart_with_frozen_angle(const tse_params *p, tse_filter *f, const decoded *z)
{
  tse_kalman *const k = &f->k;
  const tse_real frozen = k->frozen[STEERING], again = k->repeats_again[STEERING];
  restart_filter(p, f, z);
  k->reading[STEERING] = z->steer;
  k->frozen[STEERING] = frozen;
  k->repeats_again[STEERING] = again;
}

/* Fill the output of a row, and mark each valid stiffness as
 * known for tse_learnt_save(). */
static void report_step(
    const tse_params *p, tse_filter *f, const decoded *z, const row_class *w, tse_output *now)
{
  memset(now, 0, sizeof *now);
  report_row(p, &f->k, now);
  judge_row(p, &f->k, w, now);
  now->status = (int32_t)find_status(f, z, w, now);
  for (int a = 0; a < 3; a++)
    if (now->reason[a] == TSE_VALID) f->known[a] = TSE_KNOWN;
}

tse_status step_row(const tse_params *p, tse_filter *f, const tse_input *u, tse_output *out)
{
  decoded z;
  tse_output now;
  const tse_status refused = decode_row(p, f, u, &z);
  if (refused < 0) return refused; /* f is unchanged */
  if (f->step == 0) start_state(p, f);
  if (watch_steering(&f->k, &z)) restart_with_frozen_angle(p, f, &z);
  update_road(p, &f->k, &z);
  const int was_finite = is_state_finite(&f->k) && is_agreement_finite(&f->k.agreement);
  /* 1: before this row the steering angle was missing for more than BLIND_ROWS (2.5)
   * sample times. The car may have turned meanwhile. If this row has a steering angle
   * again, the motion is therefore initialised in this row. */
  const int blind = f->held_for > r_mul(BLIND_ROWS, p->sample_time);
  const tse_real max_dt = HAS_SLIP ? p->max_gap : r_min(p->max_gap, MAX_ROW_TIME);
  const int gap = has_jumped(p, f, &z) || z.dt > max_dt || (z.has_steer && f->lost);
  const tse_real speed = compute_speed(f, &z);
  advance_timers(p, f, &z, speed);
  count_gaps(f, gap && f->started && speed > p->hold_speed, z.dt);
  const row_class w = classify_row(p, f, &z, speed, gap);
  if (!f->started || w.held || w.gap || f->lost || (blind && z.has_steer)) place_row(p, f, &z);
  else follow_row(p, &f->k, &z);
  if (!is_motion_known(&f->k)) f->lost = 1;
  /* Numbers that are not finite come from faulty memory or from overflow. A loaded learnt
   * state may have caused the overflow, so it is not used again. */
  if (!was_finite || !is_state_finite(&f->k)) {
    f->start.loaded = 0;
    restart_filter(p, f, &z);
  }
  if (!w.held) check_agreement(p, &f->k, u, z.dt, z.no_second);
  report_step(p, f, &z, &w, &now);
  if (f->step < UINT32_MAX) f->step++; /* no overflow to 0, which marks the first row */
  if (out) *out = now;
  return (tse_status)now.status;
}
