/* filter/plausible.c - do the channels agree? A unit, a sign or an axle that was taken
 * for another is a factor between two quantities of which physics says that they are the
 * same. Each such pair is smoothed, and its variances and covariance are kept over
 * USUAL_TIME of driving: means go with the biases, and the factor is the root of the
 * ratio of the variances, with the sign of the covariance. Of a pair that is apart they
 * are kept over ROAD_TIME alone: what contradicts for a stretch, as on ice, is forgotten
 * soon behind it.
 *
 * A factor of the speed alone (km/h taken for rad/s is 3.6 wheel radii: 1.0 .. 1.3) is
 * within what roll and pitch do to each pair. But v r grows with it where the change of
 * the speed does against accel_x, so the two together show it: roll, pitch and latency,
 * which both accelerometers have, leave their ratio as it is. */
#include "filter/filter.h"
#include "tables/input.h"

/* The pairs: [m/s2] v r and accel_y, [rad/s] v delta/(L + K v^2) and yaw_rate, [m/s2]
 * accel_x and the change of the wheels' speed, [1] (L r/v)^2/2 and how much faster the
 * front wheels are, [m/s2] accel_x and the same. */
enum { ACROSS, TURNING_BY, ALONG, IN_BENDS, BY_DRIVE };

/* Bits of tse_agreement.apart: the pairs, and which channel comes late. */
enum {
  PAIRS_APART = (1 << TSE_PAIRS) - 1,
  LATE_ACCEL = 1 << TSE_PAIRS,
  LATE_YAW = LATE_ACCEL << 1,
  LATE_STEER = LATE_ACCEL << 2
};

/* What of the smoothed values is which. */
enum { SIDE, SIDE_ASKED, GAINED, SPEED, TURN, TURN_ASKED };

/* Return the variance of the first of a pair that what the second is made of must
 * explain. A car that keeps its speed on a road that rises and falls feels it in accel_x:
 * more of that than the speed changes by may be the road, 3 sd of its grade. */
static tse_real to_explain(const tse_params *p, const tse_pair *q, int which)
{
  const tse_real road = which == ALONG ? r_mul(TAIL, r_sqr(p->prior_sd[GX])) : TSE_R(0);
  return r_max(q->var[0] - road, r_min(q->var[0], q->var[1]));
}

/* Variance times seconds from which a pair has moved so far that what it says counts. */
static const tse_real least_shown[TSE_PAIRS] = { TSE_R(2), TSE_R(0.01), TSE_R(2), TSE_R(2e-4), TSE_R(3) };

/* Return whether it has; of one that is apart, by the variance as if it were kept for as
 * long as of others. */
static int is_shown(const tse_pair *q, int which, tse_real first, int apart)
{
  const tse_real most = which < IN_BENDS ? r_max(first, q->var[1]) : first;
  return r_mul(apart ? USUAL_TIME : q->time, most) > least_shown[which];
}

/* Return the squared correlation of a pair.   Given: first  variance of the first, of
 *                                                           what is to be explained of
 *                                                           it */
static tse_real related_of(const tse_pair *q, tse_real first)
{
  return r_mul(
      r_div(q->both, r_max(first, LEAST_VARIANCE)), r_div(q->both, r_max(q->var[1], LEAST_VARIANCE)));
}

/* Return whether the two of a pair are not the same.   Given: driven  0 both axles or not
 *                                                      known, 1 front, 2 rear */
static int is_apart(const tse_pair *q, int which, tse_real first, int32_t driven)
{
  const tse_real x = r_max(first, LEAST_VARIANCE), y = r_max(q->var[1], LEAST_VARIANCE);
  const tse_real related = related_of(q, first);
  if (which == IN_BENDS) return q->both < TSE_R(0) && related > AGAINST;
  if (which == BY_DRIVE)
    return related > AGAINST && ((driven == 1 && q->both < TSE_R(0)) || (driven == 2 && q->both > TSE_R(0)));
  return !(q->both > TSE_R(0)) || related < UNRELATED || y > r_mul(FURTHEST_OFF, x)
      || x > r_mul(FURTHEST_OFF, y);
}

/* Let a pair have x and y for dt. What is further off than usual counts as 3 sd: a burst
 * of wrong numbers weighs no more than its time, and a wrong unit is in the variance
 * soon.
 *   Given:     memory     [s] for how long it is kept   least  variance that nobody would
 *                                                       see
 *   Returned:  deviation  of both from their means, as they count */
static void pair_learn(
    tse_pair *q, tse_real x, tse_real y, tse_real dt, tse_real memory, tse_real least, tse_real deviation[2])
{
  q->time = r_mul(q->time, r_max(TSE_R(1) - r_div(dt, memory), TSE_R(0))) + dt;
  const tse_real gain = r_div(dt, q->time), keep = TSE_R(1) - gain;
  deviation[0] = x - q->mean[0], deviation[1] = y - q->mean[1];
  for (int i = 0; i < 2; i++) {
    const tse_real most = r_mul(TAIL, r_max(q->var[i], least));
    if (q->time > dt && r_sqr(deviation[i]) > most)
      deviation[i] = deviation[i] < TSE_R(0) ? -r_sqrt(most) : r_sqrt(most);
    q->mean[i] += r_mul(gain, deviation[i]);
    q->var[i] = r_mul(keep, q->var[i] + r_mul(gain, r_sqr(deviation[i])));
  }
  q->both = r_mul(keep, q->both + r_mul(gain, r_mul(deviation[0], deviation[1])));
}

/* Return the factor between the two of a pair; 0: none, they are not related. */
static tse_real factor_of(const tse_pair *q)
{
  const tse_real x = r_max(q->var[0], LEAST_VARIANCE), y = r_max(q->var[1], LEAST_VARIANCE);
  if (related_of(q, q->var[0]) < UNRELATED) return TSE_R(0);
  const tse_real size = r_sqrt(r_div(y, x));
  return q->both < TSE_R(0) ? -size : size;
}

/* Add a row to what tells the scale of the speed: square and product of a pair that goes
 * together, over SCALE_TIME of driving. What is a quarter of a period ahead is in
 * neither: slip, which leads the speed, and the change of the speed across in a fast
 * sweep. */
static void scale_learn(tse_agreement *a, int which, const tse_real deviation[2], tse_real dt)
{
  const tse_pair *const q = &a->pair[which];
  tse_real *const sum = a->moved[which == ALONG];
  const tse_real keep = r_max(TSE_R(1) - r_div(dt, SCALE_TIME), TSE_R(0));
  if (((a->apart >> which) & 1) || related_of(q, q->var[0]) < SCALE_RELATED) return;
  sum[0] = r_mul(keep, sum[0]) + r_mul(dt, r_sqr(deviation[0]));
  sum[1] = r_max(r_mul(keep, sum[1]) + r_mul(dt, r_mul(deviation[0], deviation[1])), TSE_R(0));
}

/* Return how many times too large the speed by the wheels is, squared: how the change of
 * the speed is to accel_x, over how accel_y is to v r; 0: the drive has not shown it. */
static tse_real scale_of(const tse_agreement *a)
{
  const tse_real *const across = a->moved[0], *const along = a->moved[1];
  if (!(across[0] > SCALE_SHOWN_ACROSS) || !(along[0] > SCALE_SHOWN_ALONG)) return TSE_R(0);
  return r_mul(r_div(along[1], along[0]), r_div(across[0], r_max(across[1], LEAST_VARIANCE)));
}

/* Return the same from the variances alone: noise and slopes are in them. */
static tse_real rough_scale_of(const tse_pair *across, const tse_pair *along, tse_real first)
{
  return r_sqrt(r_mul(r_div(across->var[0], r_max(across->var[1], LEAST_VARIANCE)),
      r_div(along->var[1], r_max(first, LEAST_VARIANCE))));
}

/* Return whether the speed is off by so much that noise and slopes, of which no pair has
 * more than what is not related, make no such factor. */
static int is_far_off(const tse_params *p, const tse_agreement *a)
{
  const tse_pair *const across = &a->pair[ACROSS], *const along = &a->pair[ALONG];
  const tse_real first = to_explain(p, along, ALONG);
  if (a->apart || !is_shown(across, ACROSS, across->var[0], 0) || !is_shown(along, ALONG, first, 0)) return 0;
  if (related_of(across, across->var[0]) < ROUGH_RELATED || related_of(along, first) < ROUGH_RELATED)
    return 0;
  const tse_real scale = rough_scale_of(across, along, first);
  return scale > ROUGH_MOST || scale < ROUGH_LEAST;
}

static tse_real inverse(tse_real x) { return x == TSE_R(0) ? x : r_div(TSE_R(1), x); }

/* Add a row to a timing. Of y = g x - late x' the sum of x y' - y x' is that of late
 * x'^2, twice, whatever the factor g is: its half counts.
 *   Given: x, y  of the row before and of this one    slope  of x per second */
static void timing_learn(
    tse_timing *t, const tse_real x[2], const tse_real y[2], tse_real slope, tse_real keep, tse_real dt)
{
  const tse_real turned = r_mul(x[0], y[1]) - r_mul(x[1], y[0]);
  t->square = r_mul(keep, t->square) + r_mul(dt, r_sqr(slope));
  t->late = r_clamp(r_mul(keep, t->late) + r_mul(TSE_R(0.5), turned), -MOST_INFO, MOST_INFO);
}

/* Return by how much softer than nominal the rear tyres may be: on a road that is
 * believed to have less grip than the one before, by what they have lost, too. */
static tse_real softer_by(const tse_kalman *k)
{
  const tse_real lost = k->change_from[TSE_CY_REAR] - k->x[LCR];
  if (k->change_kind != TSE_CHANGE_ROAD || !(lost > TSE_R(0))) return SOFTER;
  return SOFTER + exponential(r_min(lost, TSE_R(1))) - TSE_R(1);
}

/* Learn how late accel_y is behind the turn of the car, and yaw_rate behind the steering
 * angle: all in m/s2, yaw rates times the speed.
 *   a_y = v r + v_y',  v_y = (l_r - T v) r,  T = v l_f/(L C_r/m)    at the centre of
 *                                            gravity, of a car whose rear tyres are
 *                                            nominal
 *   Given: was  smoothed values of the row before */
static void late_learn(const tse_params *p, tse_kalman *k, const tse_real was[6], tse_real dt)
{
  tse_agreement *const a = &k->agreement;
  const tse_real *const s = a->smooth;
  const tse_real gyro_bias = k->x[BR];
  const tse_car *const c = &p->car;
  const tse_real over = r_div(TSE_R(1), dt), keep = TSE_R(1) - r_div(dt, SCALE_TIME), v = s[SPEED];
  const tse_real slip_time = r_div(r_mul(v, r_div(c->lf, c->lf + c->lr)), c->ky_rear),
                 arm = c->lr + c->lever_x - r_mul(v, slip_time);
  const tse_real asked[2] = { r_mul(v, was[TURN_ASKED]), r_mul(v, s[TURN_ASKED]) };
  const tse_real turns[2] = { r_mul(v, was[TURN] - gyro_bias), r_mul(v, s[TURN] - gyro_bias) };
  const tse_real beside = a->pair[ACROSS].mean[1] - a->pair[ACROSS].mean[0];
  const tse_real side[2] = { was[SIDE] - beside, s[SIDE] - beside },
                 across[2] = { was[SIDE_ASKED], s[SIDE_ASKED] };
  const tse_real jerk = r_mul(across[1] - across[0], over), steered = r_mul(asked[1] - asked[0], over);
  if (r_abs(jerk) > MOST_JERK || r_abs(steered) > MOST_JERK) return;
  timing_learn(&a->across, across, side, jerk, keep, dt);
  timing_learn(&a->steered, asked, turns, steered, keep, dt);
  a->across.late += r_mul(r_mul(arm, s[TURN] - was[TURN]), jerk);
  a->lags = r_mul(keep, a->lags)
      + r_mul(dt, r_mul(r_sqr(jerk), r_min(r_mul(softer_by(k), slip_time) + r_div(LEVER, v), TSE_R(1))));
}

/* Return which of accel_y, yaw_rate and the steering angle comes late, as a bit, or 0.
 * Each lateness counts times the square that shows it, and with its sd, which falls with
 * the root of that square. Tyres that are softer than nominal make accel_y late, too, and
 * an IMU behind the centre of gravity. Behind the steering angle the yaw rate is late in
 * every car, and never early. */
static int late_channel(const tse_params *p, const tse_agreement *a)
{
  const tse_real late = a->across.late, behind = a->steered.late, square = a->across.square,
                 asked = a->steered.square;
  const int is_long = a->pair[ACROSS].time > LATE_TIME && a->pair[TURNING_BY].time > LATE_TIME;
  if (!is_long || !(asked > LATE_SHOWN)) return 0;
  if (-behind > r_mul(STEER_LATE, asked) + r_mul(LATE_SD, r_sqrt(asked))) return LATE_STEER;
  if (!(square > LATE_SHOWN)) return 0;
  const tse_real sd = r_mul(r_mul(ACCEL_SD, LATE_SD), r_sqrt(square));
  const tse_real settings = r_mul(TSE_R(3), p->uncertain[CONSIDER_ACCEL_LATE]);
  const tse_real limit = r_mul(r_max(ACCEL_LATE, settings), square) + a->lags + sd;
  if (square > ACCEL_SHOWN && late > limit) return LATE_ACCEL;
  const tse_real both = r_mul(r_div(behind, asked), square) - late;
  return -late > r_mul(YAW_LATE, square) + sd && both > r_mul(YAW_LATE_TWICE, square) + sd ? LATE_YAW : 0;
}

/* Learn from a row that is one of many complete ones, and decide which channel comes
 * late.
 *   Given: was  smoothed values of the row before    has  bits of the channels that are
 *                                                         there    dt  0: there is no row
 *                                                         before */
static void late_row(const tse_params *p, tse_kalman *k, const tse_real was[6], uint32_t has, tse_real dt)
{
  static const uint32_t needed = TSE_MISSING_accel_y | TSE_MISSING_yaw_rate | TSE_MISSING_steer_angle;
  tse_agreement *const a = &k->agreement;
  const int is_complete = (has & needed) == needed && dt > TSE_R(0) && dt < LONGEST_ROW;
  a->complete_for = is_complete ? r_min(a->complete_for + dt, MAX_DT) : TSE_R(0);
  if (!(a->complete_for > COMPLETE_TIME && a->smooth[SPEED] > LEAST_TURNING)) return;
  late_learn(p, k, was, dt);
  a->apart = (a->apart & PAIRS_APART) | late_channel(p, a);
}

int32_t plausible_channel(const tse_kalman *k, tse_real *factor)
{
  const tse_agreement *const a = &k->agreement;
  const tse_pair *const going = &a->pair[ALONG];
  const int across = (a->apart >> ACROSS) & 1, turning = (a->apart >> TURNING_BY) & 1;
  const int also = factor_of(going) != TSE_R(0)
      && is_apart(going, ALONG, going->var[0], 0); /* where another pair is apart, it is no road */
  const int along = ((a->apart >> ALONG) & 1) || also;
  *factor = TSE_R(0);
  if (!(a->apart & PAIRS_APART)) {
    if (a->apart & LATE_STEER) return 1 + (int32_t)TSE_CHANNEL_steer_angle;
    if (a->apart & LATE_ACCEL) return 1 + (int32_t)TSE_CHANNEL_accel_y;
    if (a->apart & LATE_YAW) return 1 + (int32_t)TSE_CHANNEL_yaw_rate;
    if (!a->off_scale) return 0;
    const tse_real scale = scale_of(a);
    *factor = r_sqrt(scale > TSE_R(0) ? scale : rough_scale_of(&a->pair[ACROSS], going, going->var[0]));
    return 1 + (int32_t)TSE_CHANNEL_wheel_speed_front;
  }
  const tse_real gained = along ? factor_of(going) : TSE_R(0);
  if (along
      && (turning
          || (across && gained < MOST_OF_SPEED && gained > LEAST_OF_SPEED))) { /* in common is the speed */
    *factor = gained;
    return 1 + (int32_t)TSE_CHANNEL_wheel_speed_front;
  }
  if (turning) {
    *factor = across ? factor_of(&a->pair[TURNING_BY]) : inverse(factor_of(&a->pair[TURNING_BY]));
    return 1 + (int32_t)(across ? TSE_CHANNEL_yaw_rate : TSE_CHANNEL_steer_angle);
  }
  if (across) {
    *factor = factor_of(&a->pair[ACROSS]);
    return 1 + (int32_t)TSE_CHANNEL_accel_y;
  }
  if (!along)
    return 1
        + (int32_t)TSE_CHANNEL_wheel_speed_front; /* front and rear exchanged, or another axle is driven */
  *factor = inverse(factor_of(going));
  return 1 + (int32_t)TSE_CHANNEL_accel_x;
}

/* Return what each pair is made of now, in the order of the smoothed values.   Given: x
 * channels   speed  of the car */
static void values_of(const tse_params *p, const tse_real x[TSE_CHANNELS], tse_real speed, tse_real value[6])
{
  const tse_real wheelbase = p->car.lf + p->car.lr, square = r_sqr(speed);
  const tse_real understeer = r_div(
      r_div(r_mul(p->car.lr, p->car.ky_rear) - r_mul(p->car.lf, p->car.ky_front), wheelbase),
      r_mul(p->car.ky_front, p->car.ky_rear));
  value[SIDE] = x[TSE_CHANNEL_accel_y];
  value[SIDE_ASKED] = r_clamp(r_mul(speed, x[TSE_CHANNEL_yaw_rate]), -MOST_ACROSS, MOST_ACROSS);
  value[GAINED] = x[TSE_CHANNEL_accel_x];
  value[SPEED] = speed;
  value[TURN] = x[TSE_CHANNEL_yaw_rate];
  value[TURN_ASKED] = r_div(r_mul(speed, x[TSE_CHANNEL_steer_angle]),
      r_max(wheelbase + r_mul(understeer, square), r_mul(SHORTEST, wheelbase)));
}

/* Let a pair have x and y for dt, and decide whether the two are apart. */
static void compare(const tse_params *p, tse_agreement *a, int which, tse_real x, tse_real y, tse_real dt)
{
  tse_pair *const q = &a->pair[which];
  tse_real deviation[2];
  const int apart = (a->apart >> which) & 1;
  pair_learn(q, x, y, dt, apart ? ROAD_TIME : USUAL_TIME, r_div(least_shown[which], USUAL_TIME), deviation);
  const tse_real first = to_explain(p, q, which);
  if (!is_shown(q, which, first, apart)) return;
  a->apart = is_apart(q, which, first, p->car.driven) ? a->apart | 1 << which : a->apart & ~(1 << which);
  if (which == ACROSS || which == ALONG) scale_learn(a, which, deviation, dt);
}

/* Read the channels.   Returned: bits of those that are there and in their range; x  0 of
 *                      the others */
static uint32_t channels_of(const tse_input *u, tse_real x[TSE_CHANNELS])
{
  uint32_t has = 0;
  for (int c = 0; c < (int)TSE_CHANNELS; c++) {
    const tse_real read = channel_at(u, &channel_rows[c]);
    const int is_there = !is_missing(u, 1u << c, read) && channel_holds(&channel_rows[c], read);
    x[c] = is_there ? read : TSE_R(0);
    has |= is_there ? 1u << c : 0u;
  }
  return has;
}

void plausible_row(const tse_params *p, tse_kalman *k, const tse_input *u, tse_real dt, int no_second)
{
  static const uint32_t made_of[6] = { TSE_MISSING_accel_y, TSE_MISSING_yaw_rate, TSE_MISSING_accel_x, 0,
    TSE_MISSING_yaw_rate, TSE_MISSING_steer_angle };
  tse_agreement *const a = &k->agreement;
  tse_real x[TSE_CHANNELS], value[6], change;
  const uint32_t has = channels_of(u, x);
  const uint32_t wheels = has & (TSE_MISSING_wheel_speed_front | TSE_MISSING_wheel_speed_rear);
  const int both = wheels == (TSE_MISSING_wheel_speed_front | TSE_MISSING_wheel_speed_rear);
  const tse_real front = r_mul(p->radius_front, x[TSE_CHANNEL_wheel_speed_front]),
                 rear = r_mul(p->radius_rear, x[TSE_CHANNEL_wheel_speed_rear]);
  const tse_real speed = r_mul(both ? TSE_R(0.5) : TSE_R(1), front + rear);
  dt = r_min(a->since + dt, LONGEST_TIME);
  a->since = wheels ? TSE_R(0) : dt; /* they may come in every third row */
  if (!wheels || !(speed > p->hold_speed)) return;
  values_of(p, x, speed, value);
  const int starts = dt > FASTEST_DT || !(a->smooth[SPEED] > TSE_R(0));
  tse_real was[6];
  memcpy(was, a->smooth, sizeof was);
  const tse_real gain = starts ? TSE_R(1) : r_div(dt, dt + SMOOTH_TIME);
  change = r_div(speed - a->smooth[SPEED], dt + SMOOTH_TIME);
  for (int i = 0; i < 6; i++)
    if ((has & made_of[i]) == made_of[i])
      a->smooth[i] += r_mul(gain, value[i] - a->smooth[i]); /* a channel that comes seldom is no smaller */
  late_row(p, k, was, has, starts ? TSE_R(0) : dt);
  /* as the smoothed change of the speed, which begins anew */
  if (dt > FASTEST_DT) a->smooth[GAINED] = TSE_R(0);
  if (starts) return;
  const tse_real *const s = a->smooth;
  const tse_real faster = r_clamp(r_div(front - rear, speed), TSE_R(-1), TSE_R(1)),
                 bend = r_clamp(r_div(r_mul(p->car.lf + p->car.lr, s[TURN]), s[SPEED]), TSE_R(-1), TSE_R(1));
  const tse_real ahead = r_mul(TSE_R(0.5), r_sqr(bend)); /* so much faster the front wheels are in a bend */
  const struct {
    tse_real x, y;
    int counts;
  } now[TSE_PAIRS] = {
    { s[SIDE_ASKED], s[SIDE], (has & TSE_MISSING_accel_y) && (has & TSE_MISSING_yaw_rate) },
    { s[TURN_ASKED], s[TURN], (has & TSE_MISSING_steer_angle) && (has & TSE_MISSING_yaw_rate) },
    { s[GAINED], r_clamp(change, -MOST_ACROSS, MOST_ACROSS),
        (has & TSE_MISSING_accel_x) && r_abs(faster) < SLIPPING },
    { ahead, faster, both && !no_second && (has & TSE_MISSING_yaw_rate) && r_abs(faster) < SLIPPING + ahead },
    { s[GAINED], faster, both && !no_second && (has & TSE_MISSING_accel_x) && s[GAINED] > GAINS_SPEED },
  };
  for (int i = 0; i < TSE_PAIRS; i++)
    if (now[i].counts) compare(p, a, i, now[i].x, now[i].y, dt);
  const tse_real scale = scale_of(a);
  a->off_scale = (scale > TSE_R(0) && (scale > SCALE_MOST || scale < SCALE_LEAST)) || is_far_off(p, a);
}
