/* filter/velocity.c - a measured velocity: of an INS along and across the car, of GNSS
 * speed and course.
 *
 * With (vx, vy) = v + r x lever where it is measured, `late` before the row:
 *   ins_vel_x = (1 + scale)(vx + turn vy)      gnss_speed  = (1 + scale) |(vx, vy)|
 *   ins_vel_y = (1 + scale)(vy - turn vx)      gnss_course = heading + atan2(vy, vx)
 *                                              heading' = gyro - bias
 * Seven states more: heading, speed across that the model does not explain, scale, turn,
 * late, lever along and across. Nothing of the car depends on them, so they stand before
 * the others in U D U' (ud.h): a row of U each, and to the others it is as if they were
 * not there. They come into use with the first velocity that is given; until then nothing
 * is computed and no bit is another.
 *
 * What was true earlier is found by how the state has moved since (past), and the slopes
 * to first order, h - late dh/dt. A difference of courses in place of the heading would
 * need no state, but neighbours would share noise. */
#include "filter/filter.h"

#if !defined(TSE_NO_VELOCITY)

/* Columns of the kept motion: those of the state from VX on, and the heading. */
enum { KEPT_HEADING = 3, KEPT };

enum { INS_X, INS_Y, SPEED, COURSE };

/* Return the angle within -pi .. pi. */
static tse_real wrapped(tse_real angle)
{
  const tse_real turns = r_mul(angle, PER_TURN);
  return angle - r_mul(TSE_R(2), r_mul(HALF_TURN, r_from_int(r_floor_to_int(turns + TSE_R(0.5)))));
}

/* Bring the states of a measured velocity into use, from their prior. */
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

/* Keep the motion of the rows before, relative to that of this row, BETWEEN apart. */
static void remember(tse_kalman *k, tse_real dt)
{
  tse_velocity *const m = &k->velocity;
  const int first = m->kept == 0;
  for (int i = 0; i < KEPT; i++) {
    const tse_real by = i == KEPT_HEADING ? m->turned : k->x[VX + i] - m->motion[i];
    if (i < KEPT_HEADING) m->motion[i] = k->x[VX + i];
    for (int n = 0; n < m->kept; n++) m->past[n][i] = r_clamp(m->past[n][i] - by, -MOST_MOVED, MOST_MOVED);
  }
  for (int n = 0; n < m->kept; n++) m->age[n] = r_min(m->age[n] + dt, MOST_AGE);
  if (!first && m->age[0] < BETWEEN - r_mul(TSE_R(0.5), dt)) return;
  m->kept = m->kept < TSE_PAST ? m->kept + 1 : TSE_PAST;
  for (int n = m->kept - 1; n >= 0; n--) {
    m->age[n] = n > 0 ? m->age[n - 1] : TSE_R(0);
    for (int i = 0; i < KEPT; i++) m->past[n][i] = n > 0 ? m->past[n - 1][i] : TSE_R(0);
  }
}

/* Find the motion `late` seconds ago less that of now, as far back as it is known.
 * Returned: how late that is */
static tse_real past_of(const tse_velocity *m, tse_real late, tse_real delta[KEPT])
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

/* Add q to the variance of an extra state. */
static void grow(tse_kalman *k, int i, tse_real q)
{
  tse_real a[TSE_ALL];
  for (int j = 0; j < TSE_ALL; j++) a[j] = j == i ? TSE_R(1) : TSE_R(0);
  if (q > TSE_R(0)) ud_add(&k->ud, a, -1, q);
}

/* Propagate the model discrepancy of the speed across as an Ornstein-Uhlenbeck process of
 * time constant MODEL_TIME, its sd a share of how fast the axles slip sideways. */
static void fade_discrepancy(const tse_params *p, tse_kalman *k, tse_real left, tse_real dt)
{
  tse_velocity *const m = &k->velocity;
  const tse_real sideways = r_max(r_sqr(r_mul(p->car.lr, k->x[YAW]) - k->x[VY]), r_sqr(LEAST_OFF));
  m->activity += r_mul(r_div(dt, dt + MODEL_TIME), sideways - m->activity);
  k->x[V_DISCREPANCY] = r_mul(k->x[V_DISCREPANCY], left);
  ud_fade_extra(&k->ud, V_DISCREPANCY - STATES, left);
  sensitivities_fade(k, V_DISCREPANCY, left);
  const tse_real var = r_mul(r_mul(r_sqr(OFF_SHARE), r_sqr(p->model_sd) + p->mass_var), m->activity);
  grow(k, V_DISCREPANCY, r_div(r_mul(var, TSE_R(1) - r_sqr(left)), r_sqr(state_unit[V_DISCREPANCY])));
}

/* Turn the heading by the gyro, not by the yaw rate of the model, which is off by what
 * that does not explain; without a gyro, by that. */
static void turn_heading(const tse_params *p, tse_kalman *k, const decoded *z)
{
  const int measured = z->use[YAW_RATE] && works(k, YAW_RATE), by = measured ? BR : YAW;
  const tse_real sign = measured ? TSE_R(-1) : TSE_R(1),
                 share = r_mul(sign, r_div(r_mul(z->dt, state_unit[by]), state_unit[PSI]));
  const tse_real rate = measured ? z->z[YAW_RATE] - k->x[BR] : k->x[YAW],
                 before = k->velocity.has_gyro == measured ? k->velocity.gyro : rate;
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
  k->x[PSI] = wrapped(k->x[PSI] + k->velocity.turned);
}

void velocity_move(const tse_params *p, tse_kalman *k, const decoded *z)
{
  tse_velocity *const m = &k->velocity;
  const tse_real dt = z->dt;
  if (!k->ud.extras) return;
  turn_heading(p, k, z);
  fade_discrepancy(p, k, left_of(dt, MODEL_TIME), dt);
  grow(k, PSI, r_mul(r_sqr(WALK_SHARE), dt));
  for (int e = V_SCALE; e < TSE_ALL; e++)
    grow(k, e, r_mul(r_sqr(r_div(r_mul(WALK_SHARE, p->extra_sd[e - STATES]), state_unit[e])), dt));
  for (int c = 0; c < TSE_VELOCITIES; c++) m->since[c] = r_min(m->since[c] + dt, MOST_SINCE);
}

/* What a channel reads, and its slopes over the motion at that time (speeds along,
 * across, yaw rate) and the extra states, in SI. */
typedef struct velocity_reading {
  tse_real z, by[3], extra[TSE_EXTRAS];
} velocity_reading;

/* Predict a channel.
 *   Given: v  speeds along and across [m/s], yaw rate [rad/s] at the time of the value
 *   heading [rad]
 *   extra states */
static velocity_reading read_of(
    int c, const tse_real v[3], tse_real heading, const tse_real extra[TSE_EXTRAS])
{
  const tse_real scale = TSE_R(1) + extra[V_SCALE - STATES], turn = extra[V_TURN - STATES],
                 lx = extra[V_LEVER_X - STATES], ly = extra[V_LEVER_Y - STATES];
  const tse_real vx = v[0] - r_mul(v[2], ly), vy = v[1] + extra[V_DISCREPANCY - STATES] + r_mul(v[2], lx);
  tse_real along = TSE_R(0), across = TSE_R(0); /* slopes over vx, vy */
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
    const tse_real speed = r_max(r_sqrt(r_sqr(vx) + r_sqr(vy)), LEAST_SPEED), over = r_div(TSE_R(1), speed),
                   cos_b = r_mul(vx, over), sin_b = r_mul(vy, over);
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

/* Predict a channel as it was `late` before the row.
 *   Given:     z   its value      by  slopes of the rates of the motion over state and
 *                                     uncertain quantities, SI
 *   Returned:  m   innovation without what the row has moved the state by, slopes in
 *                  units; white: variance of what is no witness */
static void predict_reading(
    const tse_params *p, const tse_kalman *k, int c, tse_real z, tse_real by[3][COLUMNS], scalar *m)
{
  tse_real delta[KEPT], rate[KEPT], h[TSE_ALL], changes = TSE_R(0), late = p->velocity_late + k->x[V_LATE];
  const tse_real *const x = k->x;
  const tse_real over = past_of(&k->velocity, r_max(late, BETWEEN), delta);
  for (int i = 0; i < KEPT; i++) rate[i] = over > TSE_R(0) ? -r_div(delta[i], over) : TSE_R(0);
  late = r_min(late, over);
  for (int i = 0; i < KEPT; i++) delta[i] = -r_mul(late, rate[i]); /* ahead, as fast as it changed */
  const tse_real v[3] = { x[VX] + delta[0], x[VY] + delta[1], x[YAW] + delta[2] };
  const velocity_reading now = read_of(c, v, x[PSI] + delta[KEPT_HEADING], &x[STATES]);
  m->e = z - now.z;
  if (c == COURSE) m->e = wrapped(m->e);
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
  if (c == INS_X
      || c
          /* slip that is thought wrong looks like a latency: speed along is no witness
           * of it, and suffers from it */
          == SPEED) {
    m->white = r_sqr(r_mul(changes, p->extra_sd[V_LATE - STATES]));
    h[V_LATE] = TSE_R(0);
  }
  for (int i = 0; i < TSE_ALL; i++) m->h[i] = r_mul(h[i], state_unit[i]);
}

/* Set the zero of the heading so that the course fits; nothing is known of it but that. */
static void new_heading(tse_kalman *k, tse_real by)
{
  k->x[PSI] = wrapped(k->x[PSI] + by);
  ud_renew(&k->ud, r_sqr(r_div(HEADING_SD, state_unit[PSI])));
  for (int q = 0; q < TSE_CONSIDERED; q++) k->consider[q][PSI] = r_short(TSE_R(0));
  for (int n = 0; n < TSE_EVENTS; n++) k->event[n].v[PSI] = r_short(TSE_R(0));
  k->velocity.has_heading = 1;
}

/* Use a value, or leave it out while values do not fit.   Given: dt  since the last
 *                                                         value, s   Updated: s, change */
static void use_velocity(
    const tse_params *p, tse_kalman *k, int c, tse_real dt, scalar *s, tse_real change[TSE_ALL])
{
  tse_velocity *const m = &k->velocity;
  tse_real f[TSE_ALL], v[TSE_ALL], state, own = r_sqr(p->velocity_sd[c]);
  if (c == COURSE && k->x[VX] < LEAST_COURSE)
    own = r_mul(own, r_sqr(r_div(LEAST_COURSE, r_max(k->x[VX], p->hold_speed))));
  if (c == COURSE && !m->has_heading) {
    new_heading(k, s->e);
    s->e = change[PSI] = TSE_R(0);
  }
  for (int i = 0; i < TSE_ALL; i++) s->e -= r_mul(s->h[i], change[i]);
  s->dt = dt;
  s->white += r_mul(
      own, m->noise[c] + r_mul(r_sqr(LASTING), r_add_sat(TSE_R(1), r_div(r_mul(TSE_R(2), MODEL_TIME), dt))));
  s->r = s->white;
  const tse_real fits = r_div(r_sqr(s->e), ud_measure(&k->ud, s->h, f, v) + s->r);
  m->mean_nis[c] += r_mul(r_div(dt, dt + MODEL_TIME), r_min(fits, r_sqr(MOST_NIS)) - m->mean_nis[c]);
  if (m->mean_nis[c] > MOST_NIS) {
    m->rejected_for[c] = r_min(m->rejected_for[c] + dt, MOST_SINCE);
    if (c == COURSE && m->rejected_for[c] > SETTLE_TIME) { /* its zero is another */
      m->has_heading = 0;
      m->mean_nis[c] = TSE_R(1);
      m->rejected_for[c] = TSE_R(0);
    }
    return;
  }
  m->rejected_for[c] = TSE_R(0);
  (void)use_scalar(k, c == INS_Y || c == COURSE ? NO_SENSOR_LATERAL : NO_SENSOR_LONGITUDINAL, s,
      p->velocity_sd[c], change, &state);
  learn_noise(p, &m->noise[c], s->e - m->innovation[c], own, r_div(dt, USUAL_TIME));
  m->innovation[c] = s->e;
}

void velocity_update(
    const tse_params *p, tse_kalman *k, const decoded *z, const forces *f, tse_real change[TSE_ALL])
{
  tse_velocity *const m = &k->velocity;
  tse_real rate[3], by[3][COLUMNS];
  if (k->ud.extras) remember(k, z->dt);
  if (!(z->given & TSE_GIVEN_VELOCITIES)) return;
  if (!k->ud.extras) {
    start_velocity(p, k);
    remember(k, z->dt);
  }
  const tse_real lean = k->x[LEAN];
  const int has_bank = (z->given & TSE_GIVEN_bank) != 0; /* which is all of it, as in predict.c */
  if (has_bank) k->x[LEAN] = TSE_R(0);
  car_rates(&p->car, k->x, f, rate, by);
  k->x[LEAN] = lean;
  if (has_bank) by[1][LEAN] = TSE_R(0);
  for (int c = 0; c < TSE_VELOCITIES; c++) {
    const tse_real now = z->optional[c], dt = r_clamp(m->since[c], z->dt, MODEL_TIME);
    scalar s;
    if (!(z->given >> c & 1u) || (now >= m->last[c] && now <= m->last[c]))
      continue; /* held from the row before, or frozen */
    m->last[c] = now;
    m->since[c] = TSE_R(0);
    if (z->one_speed && (c == INS_X || c == SPEED))
      continue; /* what it differs from one speed of the vehicle by need not be slip */
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

#else /* rows that give one are refused */

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
