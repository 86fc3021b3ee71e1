/* filter/update.c - measurement update of the filter with one row of the log: one sensor
 * after the other, each with its estimated noise variance. */
#include "filter/exponential.h"
#include "filter/faults.h"
#include "filter/predict.h"
#include "filter/scalar.h"
#include "filter/units.h"
#include "filter/update.h"
#include "filter/velocity.h"

/* Add the sum of the corrections of this row to the state x, and limit each state to its
 * range.
 *
 * Measurements before the correction of a stiffness were linearised at its old value. The
 * sd of the resulting error of the stiffness is OWN_SHARE (0.5) times the correction. The
 * variance of this error is added to k->moved, and predict_slow_states() adds k->moved to
 * the variance of the stiffness. */
static void apply_correction(const tse_params *p, tse_kalman *k, const tse_real change[TSE_ALL])
{
  for (int i = 0; i < STATES + k->ud.extras; i++)
    k->x[i] = r_clamp(k->x[i] + r_mul(change[i], state_unit[i]), -state_max[i], state_max[i]);
  for (int a = HAS_SLIP ? 0 : 1; a < 3; a++)
    k->moved[a] = r_min(k->moved[a] + r_sqr(r_mul(OWN_SHARE, change[stiffness_at(a)])), MAX_D);
  for (int i = STIFFNESS; i <= LCR; i++) k->x[i] = r_clamp(k->x[i], p->log_min, p->log_max);
}

void update_at_standstill(const tse_params *p, tse_kalman *k, const decoded *z)
{
  tse_real change[TSE_ALL], state;
  scalar m;
  if (!z->use[YAW_RATE] || !is_usable(k, YAW_RATE)) return;
  memset(&m, 0, sizeof m);
  for (int i = 0; i < TSE_ALL; i++) change[i] = TSE_R(0);
  m.h[BR] = state_unit[BR];
  m.e = z->z[YAW_RATE] - k->x[BR];
  m.r = m.white = r_sqr(p->sensor_sd[YAW_RATE]);
  /* If the innovation exceeds 3 sd, the car turns although its wheels stand, for example
   * on a ferry. The gyro then does not measure its bias, and the bias is not updated. */
  if (!(r_sqr(m.e) < r_mul(TAIL, r_mul(ud_variance(&k->ud, BR), r_sqr(m.h[BR])) + m.r))) return;
  (void)use_scalar(k, YAW_RATE, &m, p->sensor_sd[YAW_RATE], change, &state);
  apply_correction(p, k, change);
}

/* Compute the partial derivatives of the predicted readings with respect to the consider
 * parameters of the sensors (latencies and scales), each multiplied by the sd of the
 * parameter. The derivative with respect to a scale is the predicted quantity itself. The
 * derivative with respect to a latency is minus the rate of this quantity: its change
 * from the previous row to this row, divided by dt.
 *   Updated:   k->before  before the call: forces and speed of the previous row;
 *                         after the call: forces and speed of this row */
static void compute_consider_slopes(const tse_params *p, tse_kalman *k, const forces *f, tse_real dt,
    tse_real consider[TSE_SENSORS][TSE_UNCERTAIN_ALL])
{
  const tse_real over = r_div(TSE_R(1), dt);
  const tse_real late = p->uncertain[CONSIDER_ACCEL_LATE];
  for (int a = 0; a < TSE_SENSORS; a++)
    for (int q = 0; q < TSE_CONSIDERED; q++) consider[a][q] = TSE_R(0);
  consider[ACCEL_X][CONSIDER_ACCEL_LATE] = -r_mul(late, r_mul(f->x - k->before[0], over));
  consider[ACCEL_Y][CONSIDER_ACCEL_LATE] = -r_mul(late, r_mul(f->y - k->before[1], over));
  consider[YAW_RATE][CONSIDER_GYRO] = r_mul(p->uncertain[CONSIDER_GYRO], k->x[YAW]);
  consider[ACCEL_Y][CONSIDER_SCALE] = r_mul(p->uncertain[CONSIDER_SCALE], f->y);
  const tse_real wheels = -r_mul(p->uncertain[CONSIDER_WHEELS_LATE], r_mul(k->x[VX] - k->before[2], over));
  consider[WHEEL_FRONT][CONSIDER_WHEELS_LATE] = consider[WHEEL_REAR][CONSIDER_WHEELS_LATE] = wheels;
  k->before[0] = f->x;
  k->before[1] = f->y;
  k->before[2] = k->x[VX];
}

/* Return whether the car brakes: whether its longitudinal tyre force is negative. The
 * force is computed from the estimated slip. If the latest innovation of accel_x exceeds
 * 3 sd of its noise, the innovation is added to the force.
 *
 * Reason for accel_x: the estimated slip oscillates with the rotation of the wheels. From
 * the slip alone, the car could seem to brake in the half of each rotation in which the
 * slip is too small. use_free_rolling(), which updates the slip while the car does not
 * brake, would then use only the other half, and bias the slip. */
static int is_braking(const tse_params *p, const tse_kalman *k, const forces *f)
{
  const tse_real e = k->innovation[ACCEL_X];
  const tse_real max_square = r_mul(r_mul(TAIL, k->noise[ACCEL_X]), r_sqr(p->sensor_sd[ACCEL_X]));
  const tse_real contradiction = r_sqr(e) > max_square && is_usable(k, ACCEL_X) ? e : TSE_R(0);
  return f->x + contradiction + r_mul(p->car.drag, r_sqr(k->x[VX])) < TSE_R(0);
}

/* Return the freely rolling axle. If brake switch or wheel torques determine it, return
 * z->rolls. Otherwise return the undriven axle or, if the car brakes, ROLLS_NONE. */
static int32_t find_rolling_axle(const tse_params *p, const tse_kalman *k, const decoded *z, const forces *f)
{
  if (z->rolls != ROLLS_UNKNOWN) return z->rolls;
  return is_braking(p, k, f) ? ROLLS_NONE : find_undriven_axle(&p->car);
}

/* Return whether an axle rolls freely according to brake switch and wheel torques or, if
 * these do not decide it (ROLLS_UNKNOWN), whether the car does not brake.
 *
 * If the result is 0, wheel speeds and accel_x are no evidence for a change of the tyres
 * (events.c): no wheel measures the speed of the car, which then follows only from the
 * integral of accel_x. An error of this integral looks like a change of the tyres. */
static int32_t is_driving(const tse_params *p, const tse_kalman *k, const decoded *z, const forces *f)
{
  return is_rolling_axle(z->rolls) || (z->rolls == ROLLS_UNKNOWN && !is_braking(p, k, f));
}

/* If an axle rolls freely, update the filter with a pseudo-measurement of its slip. The
 * assumed value is the small negative slip at which the tyre force overcomes the rolling
 * resistance of the wheels. */
static void use_free_rolling(
    const tse_params *p, tse_kalman *k, const decoded *z, const forces *f, tse_real change[TSE_ALL])
{
  const tse_car *const c = &p->car;
  const int32_t axle = find_rolling_axle(p, k, z, f);
  scalar m;
  tse_real state;
  if (!is_rolling_axle(axle)) return;
  const int at = axle == ROLLS_REAR ? SR : SF;
  for (int i = 0; i < TSE_ALL; i++) m.h[i] = TSE_R(0);
  for (int q = 0; q < TSE_CONSIDERED; q++) m.consider[q] = TSE_R(0);
  m.h[at] = state_unit[at];
  m.e = -(at == SR ? c->free_rear : c->free_front) - k->x[at] - r_mul(change[at], state_unit[at]);
  m.r = m.white = r_sqr(FREE_SLIP_SD);
  (void)use_scalar(k, NO_SENSOR_LONGITUDINAL, &m, TSE_R(1), change, &state);
}

/* Predicted readings of all sensors, and their partial derivatives with respect to the
 * state and to the consider parameters, SI. */
typedef struct prediction {
  tse_real read[TSE_SENSORS], H[TSE_SENSORS][PLACES], consider[TSE_SENSORS][TSE_UNCERTAIN_ALL];
} prediction;

/* Predict the readings of all sensors.
 *   Given:    f  forces at the end of the row, i.e. at the time of the measurements
 *   Updated:  k->pitch (see car_pitch()), k->before (see compute_consider_slopes())
 *   Returned: *s */
static void predict_sensors(
    const tse_params *p, tse_kalman *k, const decoded *z, const forces *f, prediction *s)
{
  const tse_car *const c = &p->car;
  tse_real share[3];
  const tse_real pitch = c->pitch_leak > TSE_R(0) || c->pitch_leak < TSE_R(0)
      ? car_pitch(c, k->pitch, f->x, z->dt)
      : TSE_R(0);
  car_measure(c, k->x, f, pitch, s->read, s->H);
  compute_signal_shares(k, share);
  for (int a = 0; a < TSE_SENSORS; a++)
    for (int i = HAS_SLIP ? 0 : 1; i < 3; i++)
      s->H[a][stiffness_at(i)] = r_mul(s->H[a][stiffness_at(i)], share[i]);
  if (HAS_SLIP && z->no_slip) s->H[ACCEL_X][LCX] = TSE_R(0);
  for (int a = 0; HAS_SLIP && z->no_second && a < TSE_SENSORS; a++) {
    s->H[a][SF] = s->H[a][SR] = s->H[a][LCX] = TSE_R(0); /* slip is observable only with two wheel speeds */
  }
  compute_consider_slopes(p, k, f, z->dt, s->consider);
}

/* Update k->activity: the mean squares of a_x, a_y and yaw rate (low pass with the time
 * constant MODEL_TIME). The variance of the model discrepancy is proportional to them.
 *
 * Near saturation the force depends on the form of the tyre curve, which is unknown, so
 * that the discrepancy is larger. Each square is therefore multiplied by the factor
 * (force of linear tyres / force of the model)^2. The factor is limited to
 * 1 .. MAX_LINEAR_RATIO.
 *
 * A constant is added to each mean square, because wind, play and uneven roads cause a
 * discrepancy even if the car drives straight at constant speed. For a_x and a_y the
 * constant is MIN_ACTIVITY^2 plus TAIL times the noise variance of accel_y, which is
 * larger on uneven roads. For the yaw rate the constant is this sum divided by v_x^2,
 * because a yaw rate r corresponds to the lateral acceleration v_x r. */
static void update_activity(const tse_params *p, tse_kalman *k, const forces *f, tse_real dt)
{
  const tse_real force = r_max(r_sqr(f->x) + r_sqr(f->y), r_sqr(MIN_ACTIVITY));
  const tse_real linear = r_sqr(f->endless_x) + r_sqr(f->endless_y);
  const tse_real weight = r_clamp(r_div(linear, force), TSE_R(1), MAX_LINEAR_RATIO);
  const tse_real excitation[IMU_CHANNELS] = { f->x, f->y, k->x[YAW] };
  const tse_real uneven = r_mul(r_mul(TAIL, k->noise[ACCEL_Y]), r_sqr(p->sensor_sd[ACCEL_Y]));
  const tse_real accel_floor = r_sqr(MIN_ACTIVITY) + uneven;
  const tse_real yaw_floor = r_div(accel_floor, r_sqr(r_max(k->x[VX], MIN_TURNING_SPEED)));
  const tse_real lowest[IMU_CHANNELS] = { accel_floor, accel_floor, yaw_floor };
  const tse_real gain = r_div(dt, dt + MODEL_TIME);
  for (int a = 0; a < IMU_CHANNELS; a++)
    k->activity[a] += r_mul(gain, r_mul(r_sqr(excitation[a]), weight) + lowest[a] - k->activity[a]);
}

/* Return the variance that the model discrepancy adds to the noise variance of a channel;
 * 0 for wheel speeds. The discrepancy is coloured noise with the time constant
 * T = MODEL_TIME and the variance V = model_sd^2 k->activity (update_activity()). The
 * filter treats it as white noise with the same power density at low frequencies. The
 * variance of this white noise is V (1 + 2 T/dt). */
static tse_real compute_discrepancy_var(const tse_params *p, const tse_kalman *k, int channel, tse_real dt)
{
  if (is_wheel(channel)) return TSE_R(0);
  return r_mul(r_mul(r_sqr(p->model_sd), r_add_sat(TSE_R(1), r_div(r_mul(TSE_R(2), MODEL_TIME), dt))),
      k->activity[channel]);
}

/* Return the part of the variance of a predicted wheel speed [m2/s2] that the error of
 * the slip causes. This part is needed only if the slip is computed from the force. If
 * the slip is a state, its variance is in the covariance of the state. */
static tse_real compute_slip_var(const tse_params *p, const tse_kalman *k, int channel)
{
  const tse_real slip = r_mul(p->prior_sd[LCX], k->x[channel == WHEEL_FRONT ? SF : SR]);
  return r_mul(r_sqr(k->x[VX]), r_sqr(FREE_SLIP_SD) + r_sqr(slip));
}

/* Return whether a channel is used as a measurement in this row. If slip is computed from
 * the force, accel_x is an input, and only the wheel speed of the undriven axle is used
 * (of the rear axle if the driven axle is unknown). Reason: with steered wheels the front
 * axle is faster than the rear axle, by a difference that depends on the yaw rate. If
 * both wheel speeds were used, lasting errors of radius and slip would look like a yaw
 * rate. */
static int is_measured(const tse_params *p, const decoded *z, int channel)
{
  if (HAS_SLIP && !z->no_second) return 1;
  const int axle = z->use[WHEEL_REAR] && (find_undriven_axle(&p->car) != ROLLS_FRONT || !z->use[WHEEL_FRONT])
      ? WHEEL_REAR
      : WHEEL_FRONT;
  return is_wheel(channel) ? channel == axle : channel != ACCEL_X;
}

/* Compute the scalar measurement of a channel: innovation, partial derivatives and noise
 * variance. The innovation is that after the corrections by the channels that precede
 * this channel in the row.
 *   Given:     sin_d   sine of the road-wheel angle of the front axle
 *              change  sum of the corrections by the preceding channels, in units of the
 *                      state
 *   Returned:  *m */
static void make_scalar(const tse_params *p, const tse_kalman *k, const decoded *z, const prediction *s,
    tse_real sin_d, int channel, const tse_real change[TSE_ALL], scalar *m)
{
  m->dt = z->dt;
  for (int i = STATES; i < TSE_ALL; i++) m->h[i] = TSE_R(0);
  m->e = z->z[channel] - s->read[channel];
  for (int i = 0; i < STATES; i++) {
    m->h[i] = TSE_R(0);
    if (!(s->H[channel][i] != TSE_R(0))) continue; /* most elements are 0 */
    m->h[i] = r_mul(s->H[channel][i], state_unit[i]);
    m->e -= r_mul(m->h[i], change[i]);
  }
  for (int q = 0; q < TSE_CONSIDERED; q++) {
    const int is_of_car = q < COLUMNS - STATES;
    const tse_real by_car = is_of_car ? r_mul(s->H[channel][STATES + q], p->uncertain[q]) : TSE_R(0);
    m->consider[q] = s->consider[channel][q] + by_car;
  }
  /* Variance of the front wheel speed due to Ackermann steering: the two front wheels
   * have different angles, and the single front wheel of the model has their mean. */
  const tse_real ackermann = r_sqr(r_mul(r_mul(TRACK_SHARE, k->x[VX]), r_sqr(sin_d)));
  const tse_real turn = channel == WHEEL_FRONT ? ackermann : TSE_R(0);
  const int slip_by_force = (!HAS_SLIP || z->no_second) && is_wheel(channel);
  const tse_real by_slip = slip_by_force ? compute_slip_var(p, k, channel) : TSE_R(0);
  m->white = r_mul(k->noise[channel], r_sqr(p->sensor_sd[channel])) + turn + by_slip;
  m->r = m->white + compute_discrepancy_var(p, k, channel, z->dt);
}

/* Compute the normalised innovation squared (nis) of a channel. It is 1 on average if
 * settings and model fit. The innovation e is the sum of white noise and a slow error d:
 *   d' = -d/T + white noise of power density 2 V/T,  T = MODEL_TIME
 * The variance V of d is `state` plus the variance of the model discrepancy
 * (model_sd^2 k->activity; 0 for wheel speeds). A Kalman filter of one state estimates d.
 * The nis is computed from e minus the predicted d.
 *   Given:    state  from use_scalar(): the part of the variance of e that is due to the
 *                    state and the consider parameters
 *   Updated:  k->nis, k->lasting (d), k->lasting_var (variance of the error of d) */
static void update_lasting(const tse_params *p, tse_kalman *k, int channel, const scalar *m, tse_real state)
{
  tse_real *const d = &k->lasting[channel], *const var = &k->lasting_var[channel];
  const tse_real left = compute_decay(m->dt, MODEL_TIME), keep = r_sqr(left);
  const tse_real model = is_wheel(channel) ? TSE_R(0) : r_mul(r_sqr(p->model_sd), k->activity[channel]);
  *d = r_mul(left, *d);
  *var = r_mul(keep, *var) + r_mul(TSE_R(1) - keep, state + model);
  const tse_real s = *var + m->white, e = m->e - *d, gain = r_div(*var, s);
  k->nis[channel] = r_min(r_div(r_sqr(e), s), MAX_INFO);
  *d += r_mul(gain, e);
  *var = r_mul(gain, m->white);
}

/* Update the filter with the measurement m of a channel. Store the innovation of the
 * channel. Update its estimated noise variance, its nis and the log-likelihood of the
 * row.
 *   Updated:  k, and change, to which the correction of the state is added */
static void use_channel(
    const tse_params *p, tse_kalman *k, int channel, const scalar *m, tse_real change[TSE_ALL])
{
  const tse_real sd = p->sensor_sd[channel];
  tse_real state;
  const tse_real s = use_scalar(k, channel, m, sd, change, &state);
  /* gain of the running mean in learn_noise(): the mean covers the time since the start
   * + 1 s, at most USUAL_TIME */
  const tse_real share = r_div(m->dt, r_min(k->seen + TSE_R(1), USUAL_TIME));
  learn_noise(p, &k->noise[channel], m->e - k->last_innovation[channel], r_sqr(sd), share);
  k->last_innovation[channel] = m->e;
  k->innovation[channel] = m->e;
  k->innovation_var[channel] = r_add_sat(state, m->r);
  update_lasting(p, k, channel, m, state);
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
  update_activity(p, k, &f, z->dt);
  for (int i = 0; i < TSE_ALL; i++) change[i] = TSE_R(0);
  k->log_likelihood = TSE_R(0);
  /* is_driving() must be called before the loop, because it needs the innovation of
   * accel_x in the previous row, which the loop overwrites. */
  const int32_t along = HAS_SLIP && is_driving(p, k, z, &f);
  for (int n = 0; n < TSE_SENSORS; n++) {
    const int channel = order[n];
    scalar m;
    k->innovation[channel] = k->innovation_var[channel] = k->nis[channel] = TSE_R(0);
    if (!z->use[channel] || !is_measured(p, z, channel)) continue;
    make_scalar(p, k, z, &s, f.sin_d, channel, change, &m);
    m.along = along;
    const tse_real noise_var = r_max(m.white, r_sqr(p->sensor_sd[channel]));
    watch_repeats(k, channel, z->z[channel], r_div(r_sqr(m.e), noise_var), TSE_R(1) - BELIEVED, z->dt);
    if (is_usable(k, channel)) use_channel(p, k, channel, &m, change);
    else watch_fault(k, channel, &m);
  }
  if (HAS_SLIP && !z->no_second && z->has_steer) use_free_rolling(p, k, z, &f, change);
  if (z->has_steer) velocity_update(p, k, z, &f, change);
  apply_correction(p, k, change);
}
