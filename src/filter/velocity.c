/* filter/velocity.c - measured velocities: longitudinal and lateral speed of an INS,
 * speed and course of GNSS.
 *
 * A sensor is at the position `lever` relative to the centre of gravity, and measures at
 * the time `late` before the row. Its velocity is (vx, vy) = v + r x lever, v being the
 * velocity of the centre of gravity and r the yaw rate. The channels are:
 *   ins_vel_x = (1 + scale)(vx + turn vy)      gnss_speed  = (1 + scale) |(vx, vy)|
 *   ins_vel_y = (1 + scale)(vy - turn vx)      gnss_course = heading + atan2(vy, vx)
 *                                              heading' = gyro - bias
 * The extra states are: heading, model discrepancy of the lateral speed, scale error,
 * mounting angle of the INS (turn), latency (late), and longitudinal and lateral position
 * of the sensor (lever). They are in use from the first measured velocity on. Before that
 * time they need no computing time and do not change the results (ud.h).
 *
 * The motion at the time of the measurement is the present motion plus the stored
 * difference `past`, which is the earlier motion minus the present one. The partial
 * derivatives of the earlier motion are the partial derivatives of the present motion,
 * minus `late` times the partial derivatives of its rate of change.
 *
 * The heading is a state, so that each course is a measurement of its own. Without this
 * state, a yaw rate would have to be computed from the difference of two successive
 * courses, and the noise of successive differences is correlated. */
#include "filter/exponential.h"
#include "filter/faults.h"
#include "filter/scalar.h"
#include "filter/sensitivities.h"
#include "filter/units.h"
#include "filter/velocity.h"

#if !defined(TSE_NO_VELOCITY)

/* Columns of the past motion: longitudinal speed, lateral speed and yaw rate, in the
 * order of the states VX, VY and YAW, then the heading. KEPT is the number of columns. */
enum { KEPT_HEADING = 3, KEPT };

/* Velocity channels, in the order of src/tables/sensors.toml. */
enum { INS_X, INS_Y, SPEED, COURSE };

/* Return whether a channel measures the longitudinal speed. Such a channel does not
 * update the latency (predict_reading()), and is not used with a single wheel speed
 * (velocity_update()). */
static int is_speed_along(int c) { return c == INS_X || c == SPEED; }

/* Return the angle plus a multiple of 2 pi, within -pi .. pi. */
static tse_real wrap_angle(tse_real angle)
{
  const tse_real turns = r_mul(angle, PER_TURN);
  return angle - r_mul(TSE_R(2), r_mul(HALF_TURN, r_from_int(r_floor_to_int(turns + TSE_R(0.5)))));
}

/* Start to use the extra states, which the measured velocities need. Their means and
 * variances are those of their prior. */
static void start_velocity(const tse_params *p, tse_kalman *k)
{
  tse_real variance[TSE_EXTRAS];
  tse_velocity *const m = &k->velocity;
  memset(m, 0, sizeof *m);
  for (int e = 0; e < TSE_EXTRAS; e++) {
    k->x[STATES + e] = p->extra[e];
    variance[e] = r_sqr(r_div(p->extra_sd[e], state_unit[STATES + e]));
    for (int q = 0; q < TSE_CONSIDERED; q++) k->consider[q][STATES + e] = r_short(TSE_R(0));
    for (int n = 0; n < TSE_EVENTS; n++) k->event[n].v[STATES + e] = r_short(TSE_R(0));
  }
  for (int c = 0; c < TSE_VELOCITIES; c++) m->noise[c] = m->mean_nis[c] = TSE_R(1);
  ud_open(&k->ud, variance);
}

void velocity_lose(tse_kalman *k)
{
  tse_velocity *const m = &k->velocity;
  if (!k->ud.extras) return;
  m->kept = m->has_heading = m->has_gyro = 0;
}

/* Update the stored past motion. Each element is the motion at an earlier row minus the
 * motion at this row. Insert a new element at intervals of PAST_INTERVAL. */
static void keep_past(tse_kalman *k, tse_real dt)
{
  tse_velocity *const m = &k->velocity;
  const int first = m->kept == 0;
  for (int i = 0; i < KEPT; i++) {
    const tse_real by = i == KEPT_HEADING ? m->turned : k->x[VX + i] - m->motion[i];
    if (i < KEPT_HEADING) m->motion[i] = k->x[VX + i];
    for (int n = 0; n < m->kept; n++) m->past[n][i] = r_clamp(m->past[n][i] - by, -MAX_MOVED, MAX_MOVED);
  }
  for (int n = 0; n < m->kept; n++) m->age[n] = r_min(m->age[n] + dt, MAX_AGE);
  if (!first && m->age[0] < PAST_INTERVAL - r_mul(TSE_R(0.5), dt)) return;
  m->kept = m->kept < TSE_PAST ? m->kept + 1 : TSE_PAST;
  for (int n = m->kept - 1; n >= 0; n--) {
    m->age[n] = n > 0 ? m->age[n - 1] : TSE_R(0);
    for (int i = 0; i < KEPT; i++) m->past[n][i] = n > 0 ? m->past[n - 1][i] : TSE_R(0);
  }
}

/* Find the difference between the motion `late` seconds ago and the present one.
 *   Returned:  [s] time before the row to which delta refers: `late`, or less if the
 *              stored motion does not reach back so far
 *              delta  the difference, as in tse_velocity.past */
static tse_real find_past(const tse_velocity *m, tse_real late, tse_real delta[KEPT])
{
  tse_real newer = TSE_R(0);
  for (int i = 0; i < KEPT; i++) delta[i] = TSE_R(0);
  for (int n = 0; n < m->kept; n++) {
    if (!(m->age[n] > newer)) continue;
    const int within = late < m->age[n];
    const tse_real share = within ? r_div(late - newer, m->age[n] - newer) : TSE_R(1);
    for (int i = 0; i < KEPT; i++) delta[i] += r_mul(share, m->past[n][i] - delta[i]);
    newer = m->age[n];
    if (within) return late;
  }
  return newer;
}

/* Add q, in units of state_unit[i]^2, to the variance of extra state i. */
static void add_variance(tse_kalman *k, int i, tse_real q)
{
  tse_real a[TSE_ALL];
  for (int j = 0; j < TSE_ALL; j++) a[j] = j == i ? TSE_R(1) : TSE_R(0);
  if (q > TSE_R(0)) ud_add(&k->ud, a, -1, q);
}

/* Propagate the model discrepancy of the lateral speed as an Ornstein-Uhlenbeck process
 * with time constant MODEL_TIME. The sd of the process is proportional to the rms lateral
 * speed of the rear axle in the last MODEL_TIME, because the model has a relative error
 * of the rear slip angle. In this rms a speed of magnitude below MIN_SIDEWAYS_SPEED (0.2
 * m/s) counts as MIN_SIDEWAYS_SPEED.
 *   Given:  left  exp(-dt/MODEL_TIME) */
static void fade_discrepancy(const tse_params *p, tse_kalman *k, tse_real left, tse_real dt)
{
  tse_velocity *const m = &k->velocity;
  const tse_real sideways = r_max(r_sqr(r_mul(p->car.lr, k->x[YAW]) - k->x[VY]), r_sqr(MIN_SIDEWAYS_SPEED));
  m->activity += r_mul(r_div(dt, dt + MODEL_TIME), sideways - m->activity);
  k->x[V_DISCREPANCY] = r_mul(k->x[V_DISCREPANCY], left);
  ud_fade_extra(&k->ud, V_DISCREPANCY - STATES, left);
  sensitivities_fade(k, V_DISCREPANCY, left);
  const tse_real var = r_mul(r_mul(r_sqr(OFF_SHARE), r_sqr(p->model_sd) + p->mass_var), m->activity);
  add_variance(k, V_DISCREPANCY, r_div(r_mul(var, TSE_R(1) - r_sqr(left)), r_sqr(state_unit[V_DISCREPANCY])));
}

/* Propagate the heading with the reading of the gyro minus its bias. If there is no
 * usable reading of the gyro, propagate the heading with the yaw rate of the state. The
 * gyro is preferred, because the yaw rate of the state has a model error. */
static void turn_heading(const tse_params *p, tse_kalman *k, const decoded *z)
{
  const int measured = z->use[YAW_RATE] && is_usable(k, YAW_RATE);
  const int by = measured ? BR : YAW; /* state on which the rate of the heading depends */
  const tse_real sign = measured ? TSE_R(-1) : TSE_R(1);
  const tse_real share = r_mul(sign, r_div(r_mul(z->dt, state_unit[by]), state_unit[PSI]));
  const tse_real rate = measured ? z->z[YAW_RATE] - k->x[BR] : k->x[YAW];
  const tse_real before = k->velocity.has_gyro == measured ? k->velocity.gyro : rate;
  k->velocity.gyro = rate;
  k->velocity.has_gyro = measured;
  ud_tie(&k->ud, by, share);
  for (int q = 0; q < TSE_CONSIDERED; q++)
    k->consider[q][PSI] = r_short(r_long(k->consider[q][PSI]) + r_mul(share, r_long(k->consider[q][by])));
  for (int n = 0; n < TSE_EVENTS; n++)
    k->event[n].v[PSI] = r_short(r_long(k->event[n].v[PSI]) + r_mul(share, r_long(k->event[n].v[by])));
  if (measured)
    k->consider[CONSIDER_GYRO][PSI] = r_short(r_long(k->consider[CONSIDER_GYRO][PSI])
        - r_div(r_mul(r_mul(p->uncertain[CONSIDER_GYRO], rate), z->dt), state_unit[PSI]));
  k->velocity.turned = r_mul(r_mul(TSE_R(0.5), z->dt), before + rate);
  k->x[PSI] = wrap_angle(k->x[PSI] + k->velocity.turned);
}

void velocity_move(const tse_params *p, tse_kalman *k, const decoded *z)
{
  tse_velocity *const m = &k->velocity;
  const tse_real dt = z->dt;
  if (!k->ud.extras) return;
  turn_heading(p, k, z);
  fade_discrepancy(p, k, compute_decay(dt, MODEL_TIME), dt);
  add_variance(k, PSI, r_mul(r_sqr(WALK_SHARE), dt));
  for (int e = V_SCALE; e < TSE_ALL; e++)
    add_variance(k, e, r_mul(r_sqr(r_div(r_mul(WALK_SHARE, p->extra_sd[e - STATES]), state_unit[e])), dt));
  for (int c = 0; c < TSE_VELOCITIES; c++) m->since[c] = r_min(m->since[c] + dt, MAX_SINCE);
}

/* z: predicted value of a channel, SI. by, extra: its partial derivatives with respect to
 * the motion at the time of the value (longitudinal speed, lateral speed, yaw rate), and
 * to the extra states. */
typedef struct velocity_reading {
  tse_real z, by[3], extra[TSE_EXTRAS];
} velocity_reading;

/* Predict the value of a channel.
 *   Given:  v        longitudinal and lateral speed [m/s], yaw rate [rad/s], at the time
 *                    of the value
 *           heading  [rad] at that time
 *           extra    extra states */
static velocity_reading predict_value(
    int c, const tse_real v[3], tse_real heading, const tse_real extra[TSE_EXTRAS])
{
  const tse_real scale = TSE_R(1) + extra[V_SCALE - STATES];
  const tse_real turn = extra[V_TURN - STATES];
  const tse_real lx = extra[V_LEVER_X - STATES];
  const tse_real ly = extra[V_LEVER_Y - STATES];
  const tse_real vx = v[0] - r_mul(v[2], ly);
  const tse_real vy = v[1] + extra[V_DISCREPANCY - STATES] + r_mul(v[2], lx);
  tse_real along = TSE_R(0), across = TSE_R(0); /* partial derivatives of m.z with respect to vx, vy */
  velocity_reading m;
  for (int e = 0; e < TSE_EXTRAS; e++) m.extra[e] = TSE_R(0);
  if (c == INS_X || c == INS_Y) {
    const tse_real plain = c == INS_X ? vx + r_mul(turn, vy) : vy - r_mul(turn, vx);
    m.z = r_mul(scale, plain);
    along = c == INS_X ? scale : -r_mul(scale, turn);
    across = c == INS_X ? r_mul(scale, turn) : scale;
    m.extra[V_SCALE - STATES] = plain;
    m.extra[V_TURN - STATES] = r_mul(scale, c == INS_X ? vy : -vx);
  } else {
    const tse_real speed = r_max(r_sqrt(r_sqr(vx) + r_sqr(vy)), MIN_SPEED);
    const tse_real over = r_div(TSE_R(1), speed);
    const tse_real cos_b = r_mul(vx, over);
    const tse_real sin_b = r_mul(vy, over);
    m.z = c == SPEED ? r_mul(scale, speed) : heading + r_atan2(vy, vx);
    along = c == SPEED ? r_mul(scale, cos_b) : -r_mul(sin_b, over);
    across = c == SPEED ? r_mul(scale, sin_b) : r_mul(cos_b, over);
    m.extra[V_SCALE - STATES] = c == SPEED ? speed : TSE_R(0);
    m.extra[0] = c == COURSE ? TSE_R(1) : TSE_R(0);
  }
  m.by[0] = along;
  m.by[1] = across;
  m.by[2] = r_mul(across, lx) - r_mul(along, ly);
  m.extra[V_DISCREPANCY - STATES] = across;
  m.extra[V_LEVER_X - STATES] = r_mul(across, v[2]);
  m.extra[V_LEVER_Y - STATES] = -r_mul(along, v[2]);
  return m;
}

/* Predict the value of a channel at the time `late` before the row, and compute its
 * innovation. A longitudinal speed does not update the latency, because a latency has the
 * same effect on it as an error of the slip: its partial derivative with respect to the
 * latency is set to 0, and noise due to the prior variance of the latency is added.
 *   Given:     z   measured value
 *              by  partial derivatives of the rates of change of vx, vy and yaw rate with
 *                  respect to state and consider parameters, SI
 *   Returned:  *m  e      innovation before the corrections of this row
 *                  h      partial derivatives of the predicted value with respect to the
 *                         state, per state_unit
 *                  white  noise variance due to the latency, for longitudinal speeds;
 *                         0 for other channels */
static void predict_reading(
    const tse_params *p, const tse_kalman *k, int c, tse_real z, tse_real by[3][COLUMNS], scalar *m)
{
  const tse_real *const x = k->x;
  tse_real delta[KEPT], rate[KEPT], h[TSE_ALL], changes = TSE_R(0);
  tse_real late = p->velocity_late + x[V_LATE];
  const tse_real span = find_past(&k->velocity, r_max(late, PAST_INTERVAL), delta);
  for (int i = 0; i < KEPT; i++) rate[i] = span > TSE_R(0) ? -r_div(delta[i], span) : TSE_R(0);
  late = r_min(late, span);
  for (int i = 0; i < KEPT; i++) delta[i] = -r_mul(late, rate[i]); /* linear in late, which may be < 0 */
  const tse_real v[3] = { x[VX] + delta[0], x[VY] + delta[1], x[YAW] + delta[2] };
  const velocity_reading now = predict_value(c, v, x[PSI] + delta[KEPT_HEADING], &x[STATES]);
  m->e = z - now.z;
  if (c == COURSE) m->e = wrap_angle(m->e);
  for (int q = 0; q < TSE_CONSIDERED; q++) m->consider[q] = TSE_R(0);
  for (int j = 0; j < COLUMNS; j++) {
    tse_real slope = TSE_R(0);
    for (int i = 0; i < 3; i++) slope -= r_mul(now.by[i], r_mul(late, by[i][j]));
    if (j < STATES) h[j] = slope;
    else m->consider[j - STATES] = r_mul(slope, p->uncertain[j - STATES]);
  }
  for (int i = 0; i < 3; i++) {
    h[VX + i] += now.by[i];
    changes += r_mul(now.by[i], rate[i]);
  }
  for (int e = 0; e < TSE_EXTRAS; e++) h[STATES + e] = now.extra[e];
  h[k->velocity.has_gyro ? BR : YAW] -= r_mul(k->velocity.has_gyro ? -late : late, now.extra[0]);
  h[V_LATE] = -changes - r_mul(now.extra[0], rate[KEPT_HEADING]);
  m->white = TSE_R(0);
  if (is_speed_along(c)) {
    m->white = r_sqr(r_mul(changes, p->extra_sd[V_LATE - STATES]));
    h[V_LATE] = TSE_R(0);
  }
  for (int i = 0; i < TSE_ALL; i++) m->h[i] = r_mul(h[i], state_unit[i]);
}

/* Change the heading by `by`, so that the predicted course equals the measured course.
 * Set the variance of the heading to HEADING_SD^2, the variance of an unknown heading. */
static void set_heading(tse_kalman *k, tse_real by)
{
  k->x[PSI] = wrap_angle(k->x[PSI] + by);
  ud_renew(&k->ud, r_sqr(r_div(HEADING_SD, state_unit[PSI])));
  for (int q = 0; q < TSE_CONSIDERED; q++) k->consider[q][PSI] = r_short(TSE_R(0));
  for (int n = 0; n < TSE_EVENTS; n++) k->event[n].v[PSI] = r_short(TSE_R(0));
  k->velocity.has_heading = 1;
}

/* Update the filter with a value of a channel. Reject the value if recent values of the
 * channel contradict the prediction. This is so if the running mean of their normalised
 * innovation squared exceeds MAX_NIS.
 *   Given:    dt      [s] time since the last value
 *   Updated:  s       s->e: innovation after the corrections by other channels; s->r:
 *                     noise variance
 *             change  sum of the corrections of this row, in units of the state */
static void use_velocity(
    const tse_params *p, tse_kalman *k, int c, tse_real dt, scalar *s, tse_real change[TSE_ALL])
{
  tse_velocity *const m = &k->velocity;
  tse_real f[TSE_ALL], v[TSE_ALL], state;
  tse_real nominal = r_sqr(p->velocity_sd[c]); /* noise variance by the settings */
  if (c == COURSE && k->x[VX] < MIN_COURSE_SPEED)
    nominal = r_mul(nominal, r_sqr(r_div(MIN_COURSE_SPEED, r_max(k->x[VX], p->hold_speed))));
  if (c == COURSE && !m->has_heading) {
    set_heading(k, s->e);
    s->e = change[PSI] = TSE_R(0);
  }
  for (int i = 0; i < TSE_ALL; i++) s->e -= r_mul(s->h[i], change[i]);
  s->dt = dt;
  const tse_real lasting = r_add_sat(TSE_R(1), r_div(r_mul(TSE_R(2), MODEL_TIME), dt));
  s->white += r_mul(nominal, m->noise[c] + r_mul(r_sqr(LASTING), lasting));
  s->r = s->white;
  const tse_real nis = r_div(r_sqr(s->e), ud_measure(&k->ud, s->h, f, v) + s->r);
  m->mean_nis[c] += r_mul(r_div(dt, dt + MODEL_TIME), r_min(nis, r_sqr(MAX_NIS)) - m->mean_nis[c]);
  if (m->mean_nis[c] > MAX_NIS) {
    m->rejected_for[c] = r_min(m->rejected_for[c] + dt, MAX_SINCE);
    /* rejected for long: the direction in which the logged course is 0 has probably
     * changed. Initialise the heading again */
    if (c == COURSE && m->rejected_for[c] > SETTLE_TIME) {
      m->has_heading = 0;
      m->mean_nis[c] = TSE_R(1);
      m->rejected_for[c] = TSE_R(0);
    }
    return;
  }
  m->rejected_for[c] = TSE_R(0);
  const int channel = is_speed_along(c) ? NO_SENSOR_LONGITUDINAL : NO_SENSOR_LATERAL;
  (void)use_scalar(k, channel, s, p->velocity_sd[c], change, &state);
  learn_noise(p, &m->noise[c], s->e - m->innovation[c], nominal, r_div(dt, USUAL_TIME));
  m->innovation[c] = s->e;
}

void velocity_update(
    const tse_params *p, tse_kalman *k, const decoded *z, const forces *f, tse_real change[TSE_ALL])
{
  tse_velocity *const m = &k->velocity;
  tse_real rate[3], by[3][COLUMNS];
  if (k->ud.extras) keep_past(k, z->dt);
  if (!(z->given & TSE_GIVEN_VELOCITIES)) return;
  if (!k->ud.extras) {
    start_velocity(p, k);
    keep_past(k, z->dt);
  }
  const tse_real lean = k->x[LEAN];
  const int has_bank = (z->given & TSE_GIVEN_bank) != 0; /* the given bank replaces LEAN, as in predict.c */
  if (has_bank) k->x[LEAN] = TSE_R(0);
  car_rates(&p->car, k->x, f, rate, by);
  k->x[LEAN] = lean;
  if (has_bank) by[1][LEAN] = TSE_R(0);
  for (int c = 0; c < TSE_VELOCITIES; c++) {
    const tse_real now = z->optional[c];
    const tse_real dt = r_clamp(m->since[c], z->dt, MODEL_TIME);
    const int is_repeat = now >= m->last[c] && now <= m->last[c]; /* no new value, or frozen */
    scalar s;
    if (!(z->given >> c & 1u) || is_repeat) continue;
    m->last[c] = now;
    m->since[c] = TSE_R(0);
    /* With a single wheel speed the slip is not estimated. Slip or an error of the wheel
     * radius would make this channel contradict the wheel speed, and change other
     * states. */
    if (z->one_speed && is_speed_along(c)) continue;
    predict_reading(p, k, c, now, by, &s);
    use_velocity(p, k, c, dt, &s, change);
  }
}

tse_real velocity_across_var(const tse_kalman *k)
{
  tse_real h[TSE_ALL], f[TSE_ALL], v[TSE_ALL];
  for (int i = 0; i < TSE_ALL; i++) h[i] = i == VY || i == V_DISCREPANCY ? state_unit[i] : TSE_R(0);
  tse_real var = ud_measure(&k->ud, h, f, v);
  for (int q = 0; q < TSE_CONSIDERED; q++)
    var += r_sqr(r_mul(r_long(k->consider[q][VY]), state_unit[VY])
        + r_mul(r_long(k->consider[q][V_DISCREPANCY]), state_unit[V_DISCREPANCY]));
  return var;
}

int32_t velocity_fault(const tse_kalman *k)
{
  for (int32_t c = 0; c < TSE_VELOCITIES && k->ud.extras; c++)
    if (k->velocity.rejected_for[c] > TSE_R(0)) return (int32_t)FAULT_VELOCITY + c;
  return NO_FAULT;
}

tse_real velocity_discrepancy(const tse_kalman *k) { return k->x[V_DISCREPANCY]; }

#else /* build without velocities: a row that contains a velocity is refused */

void velocity_move(const tse_params *p, tse_kalman *k, const decoded *z) { (void)p, (void)k, (void)z; }
void velocity_lose(tse_kalman *k) { (void)k; }
void velocity_update(
    const tse_params *p, tse_kalman *k, const decoded *z, const forces *f, tse_real change[TSE_ALL])
{
  (void)p, (void)k, (void)z, (void)f, (void)change;
}
int32_t velocity_fault(const tse_kalman *k) { return (void)k, NO_FAULT; }
tse_real velocity_discrepancy(const tse_kalman *k) { return (void)k, TSE_R(0); }
tse_real velocity_across_var(const tse_kalman *k) { return (void)k, TSE_R(0); }

#endif
