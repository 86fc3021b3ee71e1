/* filter/update.c - scalar measurements, one after the other, with heavy tails and noise
 * that is found. */
#include "filter/filter.h"

/* Update the log2 evidence that channel c is frozen: each repeated value adds -log2 of
 * the repeat probability, times min(nis, 1); a new value resets it. The repeat
 * probability is the larger one of all values and of values after a repeat, at least
 * `least`.
 *   Given: nis  squared innovation over the noise variance, not over S: a value that
 *               agrees with the prediction may repeat itself */
static void watch_repeats(tse_kalman *k, int c, tse_real z, tse_real nis, tse_real least, tse_real dt)
{
  const int same = !(z < k->reading[c] || z > k->reading[c]), again = k->frozen[c] > TSE_R(0);
  const tse_real g = r_min(r_div(dt, r_min(k->seen + TSE_R(1), USUAL_TIME)), MOST_FORGOTTEN),
                 now = same ? TSE_R(1) : TSE_R(0);
  const tse_real likely = r_max(r_max(k->repeats[c], k->repeats_again[c]), least);
  k->reading[c] = z;
  k->frozen[c] = same
      ? r_min(k->frozen[c] - r_mul(r_min(nis, TSE_R(1)), r_log2(r_min(likely, MOST_REPEATS))), MOST_FROZEN)
      : TSE_R(0);
  if (again) k->repeats_again[c] += r_mul(g, now - k->repeats_again[c]);
  k->repeats[c] += r_mul(g, now - k->repeats[c]);
}

int is_frozen(const tse_kalman *k, int channel) { return k->frozen[channel] > -r_log2(RATE_FAULT); }

int works(const tse_kalman *k, int channel)
{
  return k->fault != fault_of(channel) && !is_frozen(k, channel);
}

int watch_steering(tse_kalman *k, decoded *z)
{
  const tse_real usual = r_mul(r_mul(TAIL, k->usual[YAW_RATE]), r_max(k->slow_var[YAW_RATE], LEAST_SLOW_VAR));
  const int was = is_frozen(k, STEERING),
            compared = k->innovation_var[YAW_RATE] > TSE_R(0) && works(k, YAW_RATE); /* in the row before */
  if (!z->has_steer) return 0;
  const tse_real contradicts = compared && r_sqr(k->slow[YAW_RATE]) > usual ? TSE_R(1) : TSE_R(0);
  watch_repeats(k, STEERING, z->steer, contradicts, left_of(z->dt, HELD_STILL), z->dt);
  z->has_steer = !is_frozen(k, STEERING);
  return !was && !z->has_steer;
}

/* Return the mean over USUAL_TIME of the squared low-passed innovation over its predicted
 * variance, at least 1. It inflates S in event tests, so that steady model error does not
 * look like an event.
 *   Given: e  innovation   s  its variance   Updated: low-passed innovation, its
 *                                            predicted variance, the mean */
static tse_real usual_of(tse_kalman *k, int c, tse_real e, tse_real s, tse_real dt)
{
  const tse_real g = r_div(dt, dt + MODEL_TIME), left = r_div(dt, USUAL_TIME), most = r_sqrt(r_mul(TAIL, s));
  k->slow[c] += r_mul(g, r_clamp(e, -most, most) - k->slow[c]);
  k->slow_var[c] = r_mul(r_sqr(TSE_R(1) - g), k->slow_var[c]) + r_mul(r_mul(g, g), s);
  const tse_real ratio = r_div(r_sqr(k->slow[c]), r_max(k->slow_var[c], LEAST_SLOW_VAR));
  const tse_real counts = r_min(ratio, r_mul(MOST_GROWTH, k->usual[c]));
  k->usual[c] = r_clamp(
      k->usual[c] + r_mul(r_min(left, MOST_FORGOTTEN), counts - k->usual[c]), TSE_R(1), MOST_USUAL);
  return k->usual[c];
}

/* Uncertain quantities that are taken together. */
enum { TOGETHER = R_TOGETHER(TSE_CONSIDERED) };

/* Find by how much each uncertain quantity shifts an innovation.   Given: own  without
 * what it shifts the state by */
static void shifts_of(
    const tse_kalman *k, const tse_real own[TSE_CONSIDERED], const r_sparse *h, tse_real y[TSE_CONSIDERED])
{
  for (int q = 0; q < TSE_CONSIDERED; q += TOGETHER) {
    r_dot sum[TOGETHER];
    for (int b = 0; b < TOGETHER; b++) sum[b] = r_dot_start(own[q + b]);
    for (int i = 0; i < h->count; i++)
      for (int b = 0; b < TOGETHER; b++) sum[b] = r_dot_plus(sum[b], h->m[i], k->consider[q + b][h->at[i]]);
    for (int b = 0; b < TOGETHER; b++) y[q + b] = r_dot_end(own[q + b], sum[b], h->right);
  }
}

/* Move what they shift the state by, by -K y. */
static void correct_shifts(tse_kalman *k, const tse_real y[TSE_CONSIDERED], const r_scaled *gain, int n)
{
  for (int q = 0; q < TSE_CONSIDERED; q += TOGETHER) {
    r_factored back[TOGETHER];
    for (int b = 0; b < TOGETHER; b++) back[b] = r_factor(-y[q + b], gain->up);
    for (int i = 0; i < n; i++)
      for (int b = 0; b < TOGETHER; b++)
        k->consider[q + b][i] = r_plus_times(k->consider[q + b][i], back[b], gain->m[i]);
  }
}

/* Use one measurement.
 *   Given:     channel  ACCEL_X ... or NO_SENSOR_*      sd  of the sensor
 *   Updated:   change  what all measurements of this row move the state by so far, in
 *                      units
 *   Returned:  S, the variance of the innovation as used; *state: its part without the
 *              noise of the measurement, h'Ph and what is due to
 *              uncertain quantities
 * The gain is that of Schmidt (1966): uncertain quantities count in it and are not
 * estimated. With A = U D U' the covariance if they were known and V what the state is
 * off by for each, it is K = (A h + V y)/(h'A h + y'y + r), y = V'h + slopes over them;
 * and A after it is that of the optimal gain of A alone, K0 = A h/(h'A h + r), plus (h'A
 * h + r)(K - K0)(K - K0)' (Joseph's form, scalar). */
tse_real use_scalar(
    tse_kalman *k, int channel, const scalar *m, tse_real sd, tse_real change[TSE_ALL], tse_real *state)
{
  tse_real f[TSE_ALL], v[TSE_ALL], gain[TSE_ALL], y[TSE_CONSIDERED];
  tse_short room[TSE_ALL];
  r_sparse h;
  const int n = STATES + k->ud.extras;
  r_sparse_of(m->h, STATES, &h);
  const tse_real own = ud_measure_sparse(&k->ud, m->h, &h, f, v), square = r_mul(m->e, m->e);
  tse_real consider_var = TSE_R(0);
  if (n > STATES) r_sparse_of(m->h, n, &h);
  shifts_of(k, m->consider, &h, y);
  for (int q = 0; q < TSE_CONSIDERED; q++) consider_var += r_mul(y[q], y[q]);
  *state = own + consider_var;
  const tse_real r = r_max(m->r, r_div(square, TAIL) - *state), s = *state + r,
                 alone = own + r; /* further off: a smaller gain */
  ud_correct(&k->ud, f, v, own, r, gain);
  if (consider_var > r_mul(NEGLIGIBLE, s)) {
    tse_real *const dgain = f; /* which is used */
    const tse_real share = r_div(alone, s), over = r_div(TSE_R(1), s);
    for (int i = 0; i < n; i++) {
      tse_real best = r_mul(gain[i], share);
      for (int q = 0; q < TSE_CONSIDERED; q++) best += r_mul(r_mul(r_long(k->consider[q][i]), y[q]), over);
      dgain[i] = best - gain[i];
      gain[i] = best;
    }
    ud_add(&k->ud, dgain, STATES - 1, alone);
  }
  const tse_real s_event = *state + m->white + r_mul(EVENT_SHARE, m->r - m->white),
                 usual = channel >= 0 ? usual_of(k, channel, m->e, s_event, m->dt) : TSE_R(1);
  const r_scaled scaled = r_scaled_of(gain, n, room);
  events_learn(k, channel, channel >= 0 && m->along, &h, &scaled, m->e,
      r_max(r_mul(usual, s_event), r_div(square, TAIL)), sd);
  for (int i = 0; i < n; i++) change[i] += r_mul(gain[i], m->e);
  correct_shifts(k, y, &scaled, n);
  return s;
}

/* Add the summed correction to x, within its bounds; keep (OWN_SHARE times the
 * correction)^2 for the variance of each stiffness, of which one is due a row
 * (rest_row()). */
static void apply_correction(const tse_params *p, tse_kalman *k, const tse_real change[TSE_ALL])
{
  for (int i = 0; i < STATES + k->ud.extras; i++)
    k->x[i] = r_clamp(k->x[i] + r_mul(change[i], state_unit[i]), -state_most[i], state_most[i]);
  for (int a = HAS_SLIP ? 0 : 1; a < 3; a++)
    k->moved[a] = r_min(k->moved[a] + r_sqr(r_mul(OWN_SHARE, change[stiffness_at(a)])),
        MOST_D); /* what was learnt before, at other slopes, holds less */
  for (int i = STIFFNESS; i <= LCR; i++) k->x[i] = r_clamp(k->x[i], p->log_min, p->log_max);
}

void update_still(const tse_params *p, tse_kalman *k, const decoded *z)
{
  tse_real change[TSE_ALL], state;
  scalar m;
  if (!z->use[YAW_RATE] || !works(k, YAW_RATE)) return;
  memset(&m, 0, sizeof m);
  for (int i = 0; i < TSE_ALL; i++) change[i] = TSE_R(0);
  m.h[BR] = state_unit[BR];
  m.e = z->z[YAW_RATE] - k->x[BR];
  m.r = m.white = r_sqr(p->sensor_sd[YAW_RATE]);
  /* wheels that are read as standing while the car turns: a bias is no larger than it may
   * be */
  if (!(r_sqr(m.e) < r_mul(TAIL, r_mul(ud_variance(&k->ud, BR), r_sqr(m.h[BR])) + m.r))) return;
  (void)use_scalar(k, YAW_RATE, &m, p->sensor_sd[YAW_RATE], change, &state);
  apply_correction(p, k, change);
}

/* Find the slopes of the sensors over what is uncertain and no state of the car:
 * latencies, by how fast forces and speed change, and scales.
 *   Updated: k->before */
static void slopes_of_sensors(const tse_params *p, tse_kalman *k, const forces *f, tse_real dt,
    tse_real consider[TSE_SENSORS][TSE_UNCERTAIN_ALL])
{
  const tse_real over = r_div(TSE_R(1), dt), late = p->uncertain[CONSIDER_ACCEL_LATE];
  for (int a = 0; a < TSE_SENSORS; a++)
    for (int q = 0; q < TSE_CONSIDERED; q++) consider[a][q] = TSE_R(0);
  consider[ACCEL_X][CONSIDER_ACCEL_LATE] = -r_mul(late, r_mul(f->x - k->before[0], over));
  consider[ACCEL_Y][CONSIDER_ACCEL_LATE] = -r_mul(late, r_mul(f->y - k->before[1], over));
  consider[YAW_RATE][CONSIDER_GYRO] = r_mul(p->uncertain[CONSIDER_GYRO], k->x[YAW]);
  consider[ACCEL_Y][CONSIDER_SCALE] = r_mul(p->uncertain[CONSIDER_SCALE], f->y);
  consider[WHEEL_FRONT][CONSIDER_WHEELS_LATE] = consider[WHEEL_REAR][CONSIDER_WHEELS_LATE] = -r_mul(
      p->uncertain[CONSIDER_WHEELS_LATE], r_mul(k->x[VX] - k->before[2], over));
  k->before[0] = f->x;
  k->before[1] = f->y;
  k->before[2] = k->x[VX];
}

/* Return whether the car brakes, which forces show where nothing else does: those of the
 * slip, unless accel_x contradicts them. A slip that ripples with the wheels would choose
 * the half of each turn in which it is too large. */
static int brakes(const tse_params *p, const tse_kalman *k, const forces *f)
{
  const tse_real e = k->innovation[ACCEL_X],
                 likely = r_mul(r_mul(TAIL, k->noise[ACCEL_X]), r_sqr(p->sensor_sd[ACCEL_X]));
  return f->x + (r_sqr(e) > likely && works(k, ACCEL_X) ? e : TSE_R(0)) + r_mul(p->car.drag, r_sqr(k->x[VX]))
      < TSE_R(0);
}

/* Return the freely rolling axle: the one that brake switch and wheel torques name, else
 * the undriven one while the car does not brake. */
static int32_t rolling_axle(const tse_params *p, const tse_kalman *k, const decoded *z, const forces *f)
{
  if (z->rolls != ROLLS_UNKNOWN) return z->rolls;
  return brakes(p, k, f) ? ROLLS_NONE : not_driven(&p->car);
}

/* Return whether the car drives, as far as is known: while it brakes no axle rolls
 * freely, and slip is what accel_x adds up to. */
static int32_t drives(const tse_params *p, const tse_kalman *k, const decoded *z, const forces *f)
{
  return z->rolls >= ROLLS_FRONT || (z->rolls == ROLLS_UNKNOWN && !brakes(p, k, f));
}

/* Apply a pseudo-measurement of slip to the freely rolling axle. */
static void roll_freely(
    const tse_params *p, tse_kalman *k, const decoded *z, const forces *f, tse_real change[TSE_ALL])
{
  const tse_car *const c = &p->car;
  const int32_t axle = rolling_axle(p, k, z, f);
  scalar m;
  tse_real state;
  if (axle < ROLLS_FRONT) return;
  const int at = axle == ROLLS_REAR ? SR : SF;
  for (int i = 0; i < TSE_ALL; i++) m.h[i] = TSE_R(0);
  for (int q = 0; q < TSE_CONSIDERED; q++) m.consider[q] = TSE_R(0);
  m.h[at] = state_unit[at];
  m.e = -(at == SR ? c->free_rear : c->free_front) - k->x[at] - r_mul(change[at], state_unit[at]);
  m.r = m.white = r_sqr(FREE_SLIP_SD);
  (void)use_scalar(k, NO_SENSOR_LONGITUDINAL, &m, TSE_R(1), change, &state);
}

/* What the car reads, as the state predicts it, and its slopes over state and uncertain
 * quantities, SI. */
typedef struct prediction {
  tse_real read[TSE_SENSORS], H[TSE_SENSORS][PLACES], consider[TSE_SENSORS][TSE_UNCERTAIN_ALL];
} prediction;

/* Predict all sensors.   Given: f  forces at the row   Updated: k  the mode of pitch, and
 *                                                      what is known of the row for the
 *                                                      next one */
static void predict_sensors(
    const tse_params *p, tse_kalman *k, const decoded *z, const forces *f, prediction *s)
{
  const tse_car *const c = &p->car;
  tse_real share[3];
  const tse_real pitch = c->pitch_leak > TSE_R(0) || c->pitch_leak < TSE_R(0)
      ? car_pitch(c, k->pitch, f->x, z->dt)
      : TSE_R(0);
  car_measure(c, k->x, f, pitch, s->read, s->H);
  signal_shares(k, share);
  for (int a = 0; a < TSE_SENSORS; a++)
    for (int i = HAS_SLIP ? 0 : 1; i < 3; i++)
      s->H[a][stiffness_at(i)] = r_mul(s->H[a][stiffness_at(i)], share[i]);
  if (HAS_SLIP && z->no_slip) s->H[ACCEL_X][LCX] = TSE_R(0);
  for (int a = 0; HAS_SLIP && z->no_second && a < TSE_SENSORS; a++) {
    s->H[a][SF] = s->H[a][SR] = s->H[a][LCX] = TSE_R(0); /* one speed is no slip */
  }
  slopes_of_sensors(p, k, f, z->dt, s->consider);
}

/* Update the mean squares of a_x, a_y and yaw rate (time constant MODEL_TIME), weighted
 * by (linear force/force)^2, limited to 1 .. MOST_ENDLESS; add a floor and TAIL times the
 * noise variance of accel_y, for the yaw rate over v_x^2. The weight is for saturation,
 * where the unknown form of the tyre curve decides; the noise of accel_y is that of an
 * uneven road. */
static void follow_activity(const tse_params *p, tse_kalman *k, const forces *f, tse_real dt)
{
  const tse_real force = r_max(r_sqr(f->x) + r_sqr(f->y), r_sqr(LEAST_ACTIVITY));
  const tse_real over = r_clamp(
      r_div(r_sqr(f->endless_x) + r_sqr(f->endless_y), force), TSE_R(1), MOST_ENDLESS);
  const tse_real happens[IMU_CHANNELS] = { f->x, f->y, k->x[YAW] };
  const tse_real uneven = r_mul(r_mul(TAIL, k->noise[ACCEL_Y]), r_sqr(p->sensor_sd[ACCEL_Y])),
                 least = r_sqr(LEAST_ACTIVITY) + uneven;
  const tse_real at_least[IMU_CHANNELS] = { least, least,
    r_div(least, r_sqr(r_max(k->x[VX], LEAST_TURNING))) };
  for (int a = 0; a < IMU_CHANNELS; a++)
    k->activity[a] += r_mul(
        r_div(dt, dt + MODEL_TIME), r_mul(r_sqr(happens[a]), over) + at_least[a] - k->activity[a]);
}

/* Return the variance of the model discrepancy of an IMU channel: coloured noise of time
 * constant MODEL_TIME and sd model_sd times the root of activity, replaced by white noise
 * of the same low-frequency power. 0 for wheel speeds. */
static tse_real unexplained(const tse_params *p, const tse_kalman *k, int channel, tse_real dt)
{
  if (channel >= IMU_CHANNELS) return TSE_R(0);
  return r_mul(r_mul(r_sqr(p->model_sd), r_add_sat(TSE_R(1), r_div(r_mul(TSE_R(2), MODEL_TIME), dt))),
      k->activity[channel]);
}

/* Return the variance of what a wheel speed is off by where the slip is that of a force,
 * m2/s2. */
static tse_real slip_var(const tse_params *p, const tse_kalman *k, int channel)
{
  const tse_real slip = r_mul(p->prior_sd[LCX], k->x[channel == WHEEL_FRONT ? SF : SR]);
  return r_mul(r_sqr(k->x[VX]), r_sqr(FREE_SLIP_SD) + r_sqr(slip));
}

/* Return whether a channel is a measurement where the slip is that of a force: accel_x is
 * none, of two wheel speeds that which drives less. What both differ by, radius and slip,
 * is not white, and would say how the car turns. */
static int is_measured(const tse_params *p, const decoded *z, int channel)
{
  if (HAS_SLIP && !z->no_second) return 1;
  const int axle = z->use[WHEEL_REAR] && (not_driven(&p->car) != ROLLS_FRONT || !z->use[WHEEL_FRONT])
      ? WHEEL_REAR
      : WHEEL_FRONT;
  return channel < WHEEL_FRONT ? channel != ACCEL_X : channel == axle;
}

/* Make the measurement of a channel about the state that those before it have left.
 * Given: sin_d  of the front wheels */
static void make_scalar(const tse_params *p, const tse_kalman *k, const decoded *z, const prediction *s,
    tse_real sin_d, int channel, const tse_real change[TSE_ALL], scalar *m)
{
  m->dt = z->dt;
  for (int i = STATES; i < TSE_ALL; i++) m->h[i] = TSE_R(0);
  m->e = z->z[channel] - s->read[channel];
  for (int i = 0; i < STATES; i++) {
    m->h[i] = TSE_R(0);
    if (!(s->H[channel][i] != TSE_R(0))) continue; /* as most are */
    m->h[i] = r_mul(s->H[channel][i], state_unit[i]);
    m->e -= r_mul(m->h[i], change[i]);
  }
  for (int q = 0; q < TSE_CONSIDERED; q++) {
    const tse_real of_car = q < COLUMNS - STATES ? r_mul(s->H[channel][STATES + q], p->uncertain[q])
                                                 : TSE_R(0);
    m->consider[q] = s->consider[channel][q] + of_car;
  }
  /* the front wheels have different angles (Ackermann): their mean speed is not that of
   * one wheel */
  const tse_real turn = channel == WHEEL_FRONT ? r_sqr(r_mul(r_mul(TRACK_SHARE, k->x[VX]), r_sqr(sin_d)))
                                               : TSE_R(0);
  const tse_real by_slip = (!HAS_SLIP || z->no_second) && channel >= WHEEL_FRONT ? slip_var(p, k, channel)
                                                                                 : TSE_R(0);
  m->white = r_mul(k->noise[channel], r_sqr(p->sensor_sd[channel])) + turn + by_slip;
  m->r = m->white + unexplained(p, k, channel, z->dt);
}

/* Compute e and S, without parameter uncertainty, of a channel that is not used. If it is
 * the channel at fault, count how long e^2 < TAIL S and it is not frozen. */
static void watch_fault(tse_kalman *k, int channel, const scalar *m)
{
  tse_real f[TSE_ALL], v[TSE_ALL];
  const tse_real s = r_add_sat(ud_measure(&k->ud, m->h, f, v), m->r);
  const int agrees = r_sqr(m->e) < r_mul(TAIL, s) && !is_frozen(k, channel);
  k->innovation[channel] = m->e;
  k->innovation_var[channel] = s;
  if (k->fault == fault_of(channel))
    k->agrees_for = agrees ? r_min(k->agrees_for + m->dt, MOST_AGE) : TSE_R(0);
}

/* Find the normalised innovation squared of a channel: 1 on average where settings and
 * model fit. What lasts is not white: errors of the state, and model discrepancy. A
 * Kalman filter of one state estimates their sum d as an Ornstein-Uhlenbeck process of
 * time constant MODEL_TIME, and what counts is the innovation less d:
 *   d' = -d/T + noise of variance 2 V/T, V = state + model_sd^2 activity      e = d +
 *   white noise
 *   Given:    state  variance of the innovation by the state      white  of its noise
 *   Updated:  k->nis, k->lasting, k->lasting_var */
static void follow_lasting(const tse_params *p, tse_kalman *k, int channel, const scalar *m, tse_real state)
{
  tse_real *const d = &k->lasting[channel], *const var = &k->lasting_var[channel];
  const tse_real left = left_of(m->dt, MODEL_TIME), keep = r_sqr(left);
  const tse_real model = channel < IMU_CHANNELS ? r_mul(r_sqr(p->model_sd), k->activity[channel]) : TSE_R(0);
  *d = r_mul(left, *d);
  *var = r_mul(keep, *var) + r_mul(TSE_R(1) - keep, state + model);
  const tse_real s = *var + m->white, e = m->e - *d, gain = r_div(*var, s);
  k->nis[channel] = r_min(r_div(r_sqr(e), s), MOST_INFO);
  *d += r_mul(gain, e);
  *var = r_mul(gain, m->white);
}

/* Use a channel, and note its innovation, its likelihood and its noise.   Updated:
 * change */
static void use_channel(
    const tse_params *p, tse_kalman *k, int channel, const scalar *m, tse_real change[TSE_ALL])
{
  const tse_real sd = p->sensor_sd[channel];
  tse_real state;
  const tse_real s = use_scalar(k, channel, m, sd, change, &state);
  const tse_real share = r_div(
      m->dt, r_min(k->seen + TSE_R(1), USUAL_TIME)); /* at first a mean of all since the start */
  learn_noise(p, &k->noise[channel], m->e - k->last_innovation[channel], r_sqr(sd), share);
  k->last_innovation[channel] = m->e;
  k->innovation[channel] = m->e;
  k->innovation_var[channel] = r_add_sat(state, m->r);
  follow_lasting(p, k, channel, m, state);
  k->log_likelihood -= r_mul(TSE_R(0.5), r_div(r_sqr(m->e), s) + r_mul(LN_2, r_log2(s)) + LN_TWO_PI);
}

void update_row(const tse_params *p, tse_kalman *k, const decoded *z, steering u)
{
  static const int order[TSE_SENSORS] = { WHEEL_FRONT, WHEEL_REAR, YAW_RATE, ACCEL_X, ACCEL_Y };
  forces f;
  prediction s;
  tse_real change[TSE_ALL];
  car_forces(&p->car, k->x, u, TSE_R(1), &f);
  predict_sensors(p, k, z, &f, &s);
  follow_activity(p, k, &f, z->dt);
  for (int i = 0; i < TSE_ALL; i++) change[i] = TSE_R(0);
  k->log_likelihood = TSE_R(0);
  const int32_t along = HAS_SLIP && drives(p, k, z, &f); /* by accel_x of the row before */
  for (int n = 0; n < TSE_SENSORS; n++) {
    const int channel = order[n];
    scalar m;
    k->innovation[channel] = k->innovation_var[channel] = k->nis[channel] = TSE_R(0);
    if (!z->use[channel] || !is_measured(p, z, channel)) continue;
    make_scalar(p, k, z, &s, f.sin_d, channel, change, &m);
    m.along = along;
    watch_repeats(k, channel, z->z[channel], r_div(r_sqr(m.e), r_max(m.white, r_sqr(p->sensor_sd[channel]))),
        TSE_R(1) - BELIEVED, z->dt);
    if (works(k, channel)) use_channel(p, k, channel, &m, change);
    else watch_fault(k, channel, &m);
  }
  if (HAS_SLIP && !z->no_second && z->has_steer) roll_freely(p, k, z, &f, change);
  if (z->has_steer) velocity_update(p, k, z, &f, change);
  apply_correction(p, k, change);
}
