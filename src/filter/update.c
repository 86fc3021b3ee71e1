/* filter/update.c - scalar measurements, one after the other, with heavy tails and noise that is found. */
#include "filter/filter.h"

/* How unlikely it is that a channel at work repeats its reading as often as it just has: repeats follow repeats. off: how far the reading is from
 * the prediction, squared, over its noise; one that is right may repeat itself. */
static void watch_repeats(tse_kalman *k, int c, tse_real z, tse_real off, tse_real dt)
{
  const int same = !(z < k->reading[c] || z > k->reading[c]), again = k->frozen[c] > TSE_R(0);
  const tse_real g = r_div(dt, r_min(k->seen + TSE_R(1), USUAL_TIME)), now = same ? TSE_R(1) : TSE_R(0);
  const tse_real likely = r_max(r_max(k->repeats[c], k->repeats_again[c]), TSE_R(1) - BELIEVED);
  k->reading[c] = z;
  k->frozen[c] = same ? r_min(k->frozen[c] - r_mul(r_min(off, TSE_R(1)), r_log2(r_min(likely, TSE_R(0.999)))), TSE_R(1000)) : TSE_R(0);
  if (again) k->repeats_again[c] += r_mul(g, now - k->repeats_again[c]);
  k->repeats[c] += r_mul(g, now - k->repeats[c]);
}

/* How much larger than thought slow innovations of a channel usually are: what this car's model does not explain is no event. */
static tse_real usual_of(tse_kalman *k, int c, tse_real e, tse_real s, tse_real dt)
{
  const tse_real g = r_div(dt, dt + MODEL_TIME), left = r_div(dt, USUAL_TIME), most = r_sqrt(r_mul(TAIL, s));
  k->slow[c] += r_mul(g, r_clamp(e, -most, most) - k->slow[c]);
  k->slow_var[c] = r_mul(r_sqr(TSE_R(1) - g), k->slow_var[c]) + r_mul(r_mul(g, g), s);
  const tse_real ratio = r_div(r_sqr(k->slow[c]), r_max(k->slow_var[c], TSE_R(1e-9)));
  if (c == 0) k->unusual = r_div(ratio, k->usual[c]);
  k->usual[c] = r_clamp(k->usual[c] + r_mul(r_min(left, TSE_R(0.1)), r_min(ratio, r_mul(TSE_R(4), k->usual[c])) - k->usual[c]), TSE_R(1), TSE_R(1000));
  return k->usual[c];
}

#define NEGLIGIBLE TSE_R(0.001) /* share of an innovation's variance: uncertain quantities that make less do not change the gain */

/* Use one measurement. change: what all measurements of this row move the state by so far, in units.
 * The gain is that of Schmidt (1966): uncertain quantities count in it and are not estimated. With A = U D U' the covariance if they
 * were known and V what the state is off by for each, it is K = (A h + V y)/(h'A h + y'y + r), y = V'h + slopes over them; and A after
 * it is that of the optimal gain of A alone, A h/s, plus s times the square of what K is off that one (Joseph's form, scalar).
 *   Returned:  variance of the innovation as used, of which *state is the state's and that of uncertain quantities */
tse_real use_scalar(tse_kalman *k, int channel, const scalar *m, tse_real sd, tse_real change[TSE_ALL], tse_real *state)
{
  tse_real f[TSE_ALL], v[TSE_ALL], gain[TSE_ALL], off[TSE_ALL], y[TSE_DOUBTS];
  const int n = STATES + k->p.extras;
  const tse_real own = ud_measure(&k->p, m->h, f, v), square = r_mul(m->e, m->e);
  tse_real doubt = TSE_R(0);
  for (int q = 0; q < TSE_DOUBTS; q++) {
    y[q] = m->doubts[q];
    for (int i = 0; i < n; i++) y[q] += r_mul(m->h[i], k->doubt[q][i]);
    doubt += r_mul(y[q], y[q]);
  }
  *state = own + doubt;
  const tse_real r = r_max(m->r, r_div(square, TAIL) - *state), s = *state + r, alone = own + r; /* further off: a smaller gain */
  ud_correct(&k->p, f, v, r, gain);
  if (doubt > r_mul(NEGLIGIBLE, s)) {
    const tse_real share = r_div(alone, s), over = r_div(TSE_R(1), s);
    for (int i = 0; i < n; i++) {
      tse_real best = r_mul(gain[i], share);
      for (int q = 0; q < TSE_DOUBTS; q++) best += r_mul(r_mul(k->doubt[q][i], y[q]), over);
      off[i] = best - gain[i];
      gain[i] = best;
    }
    ud_add(&k->p, off, STATES - 1, alone);
  }
  const tse_real s_event = *state + m->white + r_mul(EVENT_SHARE, m->r - m->white), usual = channel >= 0 ? usual_of(k, channel, m->e, s_event, m->dt) : TSE_R(1);
  events_learn(k, channel, m->h, gain, m->e, r_max(r_mul(usual, s_event), r_div(square, TAIL)), sd);
  for (int i = 0; i < n; i++) change[i] += r_mul(gain[i], m->e);
  for (int q = 0; q < TSE_DOUBTS; q++)
    for (int i = 0; i < n; i++) k->doubt[q][i] -= r_mul(gain[i], y[q]);
  return s;
}

/* White noise of a channel: half the mean square of what the innovation changes by from row to row, where nothing slower shows. */
static void learn_noise(const tse_params *p, tse_kalman *k, int c, tse_real e, tse_real own, tse_real dt)
{
  const tse_real change = e - k->last_innovation[c], seen = r_min(r_div(r_mul(TSE_R(0.5), r_sqr(change)), r_mul(own, k->noise[c])), TAIL);
  const tse_real g = r_min(r_div(dt, r_min(k->seen + TSE_R(1), USUAL_TIME)), TSE_R(0.1)); /* at first a mean of all since the start */
  k->last_innovation[c] = e;
  k->noise[c] = r_clamp(r_mul(k->noise[c], TSE_R(1) + r_mul(g, seen - TSE_R(1))), LEAST_NOISE, p->noise_max_var);
}

static void finish(const tse_params *p, tse_kalman *k, const tse_real change[TSE_ALL])
{
  for (int i = 0; i < STATES + k->p.extras; i++) k->x[i] = r_clamp(k->x[i] + r_mul(change[i], state_unit[i]), -state_most[i], state_most[i]);
  for (int i = LCX; i <= LCR; i++) ud_add_at(&k->p, i, r_sqr(r_mul(OWN_SHARE, change[i]))); /* what was learnt before, at other slopes, holds less */
  for (int i = LCX; i <= LCR; i++) k->x[i] = r_clamp(k->x[i], p->log_min, p->log_max);
}

void update_still(const tse_params *p, tse_kalman *k, const decoded *z)
{
  tse_real change[TSE_ALL], state;
  scalar m;
  if (!z->use[2]) return;
  memset(&m, 0, sizeof m);
  for (int i = 0; i < TSE_ALL; i++) m.h[i] = change[i] = TSE_R(0);
  for (int q = 0; q < TSE_DOUBTS; q++) m.doubts[q] = TSE_R(0);
  m.h[BR] = state_unit[BR];
  m.e = z->z[2] - k->x[BR];
  m.r = m.white = r_sqr(p->sensor_sd[2]);
  (void)use_scalar(k, 2, &m, p->sensor_sd[2], change, &state);
  finish(p, k, change);
}

/* What is known of a row beside the sensors: how fast forces and speed change, for what is late. */
static void what_is_late(const tse_params *p, tse_kalman *k, const forces *f, tse_real dt, tse_real doubts[TSE_SENSORS][TSE_DOUBTS])
{
  const tse_real over = r_div(TSE_R(1), dt), late = p->uncertain[DOUBT_ACCEL_LATE];
  for (int a = 0; a < TSE_SENSORS; a++)
    for (int q = 0; q < TSE_DOUBTS; q++) doubts[a][q] = TSE_R(0);
  doubts[0][DOUBT_ACCEL_LATE] = -r_mul(late, r_mul(f->x - k->before[0], over));
  doubts[1][DOUBT_ACCEL_LATE] = -r_mul(late, r_mul(f->y - k->before[1], over));
  doubts[2][DOUBT_GYRO] = r_mul(p->uncertain[DOUBT_GYRO], k->x[YAW]);
  doubts[1][DOUBT_SCALE] = r_mul(p->uncertain[DOUBT_SCALE], f->y);
  doubts[3][DOUBT_WHEELS_LATE] = doubts[4][DOUBT_WHEELS_LATE] = -r_mul(p->uncertain[DOUBT_WHEELS_LATE], r_mul(k->x[VX] - k->before[2], over));
  k->before[0] = f->x;
  k->before[1] = f->y;
  k->before[2] = k->x[VX];
}

/* The axle that is not driven rolls freely while the car does not brake, which forces show where nothing else does. */
static void roll_freely(const tse_params *p, tse_kalman *k, const decoded *z, const forces *f, tse_real change[TSE_ALL])
{
  const tse_car *const c = &p->car;
  scalar m;
  tse_real state;
  int32_t axle = z->rolls;
  if (axle == ROLLS_UNKNOWN) axle = f->x + r_mul(c->drag, r_sqr(k->x[VX])) < TSE_R(0) ? ROLLS_NONE : not_driven(c);
  if (axle < ROLLS_FRONT) return;
  const int at = axle == ROLLS_REAR ? SR : SF;
  for (int i = 0; i < TSE_ALL; i++) m.h[i] = TSE_R(0);
  for (int q = 0; q < TSE_DOUBTS; q++) m.doubts[q] = TSE_R(0);
  m.h[at] = state_unit[at];
  m.e = -(at == SR ? c->free_rear : c->free_front) - k->x[at] - r_mul(change[at], state_unit[at]);
  m.r = m.white = r_sqr(FREE_SLIP_SD);
  (void)use_scalar(k, NO_SENSOR_GOING, &m, TSE_R(1), change, &state);
}

void update_row(const tse_params *p, tse_kalman *k, const decoded *z, steering u)
{
  static const int order[TSE_SENSORS] = { 3, 4, 2, 0, 1 };
  const tse_car *const c = &p->car;
  forces f;
  tse_real read[TSE_SENSORS], H[TSE_SENSORS][COLUMNS], doubts[TSE_SENSORS][TSE_DOUBTS], change[TSE_ALL], share[3];
  car_forces(c, k->x, u, TSE_R(1), &f);
  const tse_real pitch = c->pitch_leak > TSE_R(0) || c->pitch_leak < TSE_R(0) ? car_pitch(c, k->pitch, f.x, z->dt) : TSE_R(0);
  car_measure(c, k->x, &f, pitch, read, H);
  signal_shares(k, share);
  for (int a = 0; a < TSE_SENSORS; a++)
    for (int i = 0; i < 3; i++) H[a][LCX + i] = r_mul(H[a][LCX + i], share[i]);
  if (z->no_slip) H[0][LCX] = TSE_R(0); /* one speed is no slip: nothing of the stiffness that it has */
  what_is_late(p, k, &f, z->dt, doubts);
  for (int i = 0; i < TSE_ALL; i++) change[i] = TSE_R(0);
  k->nis = k->unusual = TSE_R(0);
  k->channels = 0;
  k->log_likelihood = TSE_R(0);
  /* What the model does not explain of a channel is a share of what happens, and lasts: as white noise that is the same at low
   * frequencies, which is where parameters are learnt, it has 2 MODEL_TIME/dt times the variance. */
  const tse_real happens[3] = { f.x, f.y, k->x[YAW] }, lasts = r_mul(r_sqr(p->model_sd), r_add_sat(TSE_R(1), r_div(r_mul(TSE_R(2), MODEL_TIME), z->dt)));
  /* ... and of an uneven road, which shows as noise */
  const tse_real rough = r_mul(r_sqrt(k->noise[1]), p->sensor_sd[1]), little = LEAST_ACTIVITY + r_mul(ROUGHNESS, rough), least[3] = { little, little, r_div(little, r_max(k->x[VX], TSE_R(5))) };
  for (int a = 0; a < 3; a++) k->activity[a] += r_mul(r_div(z->dt, z->dt + MODEL_TIME), r_sqr(happens[a]) + r_sqr(least[a]) - k->activity[a]);
  for (int n = 0; n < TSE_SENSORS; n++) {
    const int a = order[n];
    k->innovation[a] = k->innovation_var[a] = TSE_R(0);
    if (!z->use[a]) continue;
    scalar m;
    tse_real state, sd = p->sensor_sd[a];
    m.dt = z->dt;
    for (int i = STATES; i < TSE_ALL; i++) m.h[i] = TSE_R(0);
    m.e = z->z[a] - read[a];
    for (int i = 0; i < STATES; i++) {
      m.h[i] = r_mul(H[a][i], state_unit[i]);
      m.e -= r_mul(m.h[i], change[i]);
    }
    for (int q = 0; q < TSE_DOUBTS; q++) m.doubts[q] = doubts[a][q] + (q < COLUMNS - STATES ? r_mul(H[a][STATES + q], p->uncertain[q]) : TSE_R(0));
    const tse_real own = r_sqr(sd), turn = a == 3 ? r_sqr(r_mul(r_mul(TSE_R(0.02), k->x[VX]), r_sqr(f.sin_d))) : TSE_R(0); /* its wheels are not one */
    m.white = r_mul(k->noise[a], own) + turn;
    watch_repeats(k, a, z->z[a], r_div(r_sqr(m.e), r_max(m.white, own)), z->dt);
    m.r = m.white + (a < 3 ? r_mul(lasts, k->activity[a]) : TSE_R(0));
    if (k->fault == fault_of(a)) { /* not used; heard again when it agrees */
      tse_real fx[TSE_ALL], v[TSE_ALL];
      const tse_real s = ud_measure(&k->p, m.h, fx, v) + m.r;
      k->innovation[a] = m.e;
      k->innovation_var[a] = s;
      k->agrees_for = r_sqr(m.e) < r_mul(TAIL, s) && k->frozen[a] < -r_log2(RATE_FAULT) ? r_min(k->agrees_for + z->dt, TSE_R(100)) : TSE_R(0);
      continue;
    }
    const tse_real s = use_scalar(k, a, &m, sd, change, &state);
    learn_noise(p, k, a, m.e, own, z->dt);
    k->innovation[a] = m.e;
    k->innovation_var[a] = state + m.r;
    k->nis += r_div(r_sqr(m.e), state + m.r);
    k->channels++;
    k->log_likelihood -= r_mul(TSE_R(0.5), r_div(r_sqr(m.e), s) + r_mul(TSE_R(0.69314718055994531), r_log2(s)) + TSE_R(1.8378770664093453));
  }
  if (!z->one_speed) roll_freely(p, k, z, &f, change);
  velocity_update(p, k, z, &f, change);
  finish(p, k, change);
}
