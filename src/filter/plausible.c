/* filter/plausible.c - test whether the channels agree. It finds channels with a wrong
 * unit, a wrong sign or a latency, and wheel speeds of the wrong axle.
 *
 * The test uses pairs of quantities that are equal by the laws of physics, for example
 * lateral acceleration, and speed times yaw rate. A wrong unit or sign of a channel
 * multiplies one quantity of a pair by a factor. To find this factor, both quantities are
 * low-passed, and their means, variances and covariance are estimated over USUAL_TIME of
 * driving. The factor is the root of the ratio of the variances, with the sign of the
 * covariance. The bias of a channel changes only a mean, and not the factor.
 *
 * A pair also disagrees on some roads, for example on ice. While a pair disagrees, its
 * means and variances are estimated over the shorter ROAD_TIME, so that the data from
 * such a road are forgotten soon after it ends.
 *
 * A speed in km/h that is taken for a wheel speed in rad/s is wrong by the factor 3.6
 * times the wheel radius in m, i.e. 1.0 .. 1.3. Roll and pitch change the ratio of the
 * quantities of one pair by as much. compute_scale() therefore combines two pairs. A
 * speed v that is too large by a factor increases (v r)/accel_y, r being the yaw rate,
 * and (rate of v)/accel_x by this factor, and their product by its square. The first
 * ratio is computed as variance(v r)/covariance, the second as
 * covariance/variance(accel_x). A latency of both accelerometers decreases both
 * covariances, which cancels in the product. */
#include "filter/exponential.h"
#include "filter/plausible.h"
#include "tables/input.h"

/* The pairs of quantities, the first and the second. v: speed, r: yaw rate, d: steering
 * angle, L: wheelbase, K: understeer gradient, faster: (front wheel speed - rear wheel
 * speed)/v. */
enum {
  ACROSS,     /* v r and accel_y [m/s2] */
  TURNING_BY, /* v d/(L + K v^2) and yaw_rate [rad/s] */
  ALONG,      /* accel_x and the rate of the speed [m/s2] */
  IN_BENDS,   /* (L r/v)^2/2 and faster [1] */
  BY_DRIVE    /* accel_x [m/s2] and faster [1] */
};

/* Bits of tse_agreement.apart. The lowest TSE_PAIRS bits stand for the pairs that
 * disagree, the next three bits for a channel that is late. */
enum {
  PAIRS_APART = (1 << TSE_PAIRS) - 1,
  LATE_ACCEL = 1 << TSE_PAIRS,
  LATE_YAW = LATE_ACCEL << 1,
  LATE_STEER = LATE_ACCEL << 2
};

/* Indices of the low-passed values: accel_y, v r, accel_x, speed v, yaw rate r, and the
 * yaw rate that is expected from the steering angle. */
enum { SIDE, SIDE_ASKED, GAINED, SPEED, TURN, TURN_ASKED };

/* Return the variance of the first quantity of a pair. For ALONG, subtract the variance
 * that the road can cause, (3 prior sd of gravity along the road)^2: accel_x measures
 * this gravity, and the rate of the speed does not contain it. Because the real grade may
 * vary less, the result is at least the smaller variance of the two quantities. */
static tse_real compute_explainable(const tse_params *p, const tse_pair *q, int which)
{
  const tse_real road = which == ALONG ? r_mul(TAIL, r_sqr(p->prior_sd[GX])) : TSE_R(0);
  return r_max(q->var[0] - road, r_min(q->var[0], q->var[1]));
}

/* Min excitation of each pair at which it is judged, [unit^2 s]: variance times averaging
 * time. is_shown() chooses the quantity of the pair whose variance counts. */
static const tse_real min_excitation[TSE_PAIRS] = { TSE_R(2), TSE_R(0.01), TSE_R(2), TSE_R(2e-4), TSE_R(3) };

/* Return whether the excitation of a pair is large enough to judge whether the pair
 * disagrees. The excitation is the averaging time times a variance. For ACROSS,
 * TURNING_BY and ALONG it is the larger variance of the two quantities, because a wrong
 * unit may make the other variance small. For the other pairs it is the variance of the
 * first quantity. While a pair disagrees, USUAL_TIME is used in place of the averaging
 * time, which is then limited to the shorter ROAD_TIME.
 *   Given:  first  variance of the first quantity, from compute_explainable()
 *           apart  1: the pair disagrees */
static int is_shown(const tse_pair *q, int which, tse_real first, int apart)
{
  const int may_have_factor = which == ACROSS || which == TURNING_BY || which == ALONG;
  const tse_real var = may_have_factor ? r_max(first, q->var[1]) : first;
  return r_mul(apart ? USUAL_TIME : q->time, var) > min_excitation[which];
}

/* Return the squared correlation of the two quantities of a pair.
 *   Given:  first  variance of the first quantity: q->var[0], or the smaller value that
 *                  compute_explainable() returns */
static tse_real compute_squared_correlation(const tse_pair *q, tse_real first)
{
  return r_mul(r_div(q->both, r_max(first, MIN_VARIANCE)), r_div(q->both, r_max(q->var[1], MIN_VARIANCE)));
}

/* Return whether the two quantities of a pair disagree: their correlation is too weak,
 * their covariance is not positive, or their variances are too different. IN_BENDS and
 * BY_DRIVE disagree only if their covariance has the wrong sign.
 *   Given:  which   index of the pair, ACROSS ...
 *           first   [unit^2] variance of the first quantity
 *           driven  driven axle: 1 front, 2 rear, 0 both or unknown */
static int is_apart(const tse_pair *q, int which, tse_real first, int32_t driven)
{
  const tse_real x = r_max(first, MIN_VARIANCE), y = r_max(q->var[1], MIN_VARIANCE);
  const tse_real related = compute_squared_correlation(q, first);
  if (which == IN_BENDS) return q->both < TSE_R(0) && related > AGAINST;
  if (which == BY_DRIVE)
    return related > AGAINST && ((driven == 1 && q->both < TSE_R(0)) || (driven == 2 && q->both > TSE_R(0)));
  return !(q->both > TSE_R(0)) || related < UNRELATED || y > r_mul(MAX_VARIANCE_RATIO, x)
      || x > r_mul(MAX_VARIANCE_RATIO, y);
}

/* Update means, variances and covariance of a pair with the sample (x, y). A deviation
 * from the mean counts as at most 3 sd. A short burst of wrong values thus has little
 * effect. A wrong unit, however, lasts, and soon increases the variance in spite of this
 * limit.
 *   Given:     memory     [s] averaging time
 *              least      [unit^2] lower limit of the variance from which the 3 sd are
 *                         computed
 *   Returned:  deviation  of x and y from their means, limited */
static void update_pair(
    tse_pair *q, tse_real x, tse_real y, tse_real dt, tse_real memory, tse_real least, tse_real deviation[2])
{
  q->time = r_mul(q->time, r_max(TSE_R(1) - r_div(dt, memory), TSE_R(0))) + dt;
  const tse_real gain = r_div(dt, q->time), keep = TSE_R(1) - gain;
  deviation[0] = x - q->mean[0];
  deviation[1] = y - q->mean[1];
  for (int i = 0; i < 2; i++) {
    const tse_real max_square = r_mul(TAIL, r_max(q->var[i], least));
    if (q->time > dt && r_sqr(deviation[i]) > max_square)
      deviation[i] = deviation[i] < TSE_R(0) ? -r_sqrt(max_square) : r_sqrt(max_square);
    q->mean[i] += r_mul(gain, deviation[i]);
    q->var[i] = r_mul(keep, q->var[i] + r_mul(gain, r_sqr(deviation[i])));
  }
  q->both = r_mul(keep, q->both + r_mul(gain, r_mul(deviation[0], deviation[1])));
}

/* Return the ratio of the second to the first quantity of a pair: the root of the ratio
 * of their variances, with the sign of their covariance. Return 0 if the two quantities
 * do not correlate. */
static tse_real compute_factor(const tse_pair *q)
{
  const tse_real x = r_max(q->var[0], MIN_VARIANCE), y = r_max(q->var[1], MIN_VARIANCE);
  if (compute_squared_correlation(q, q->var[0]) < UNRELATED) return TSE_R(0);
  const tse_real size = r_sqrt(r_div(y, x));
  return q->both < TSE_R(0) ? -size : size;
}

/* Update the two sums from which the scale of the speed is computed, over SCALE_TIME of
 * driving: of the square of the first quantity of a pair, and of the product of both
 * quantities, each minus its mean. A pair that disagrees, or whose squared correlation is
 * below SCALE_RELATED, does not contribute.
 *
 * The second quantity also contains the rate of the slip (ALONG) or of the lateral speed
 * (ACROSS). In periodic motion this rate is proportional to the rate of the first
 * quantity, and thus leads the first quantity by a quarter of a period. The mean product
 * of this rate and the first quantity is therefore 0, so that slip and lateral speed do
 * not bias the scale. */
static void update_scale(tse_agreement *a, int which, const tse_real deviation[2], tse_real dt)
{
  const tse_pair *const q = &a->pair[which];
  tse_real *const sum = a->moved[which == ALONG];
  const tse_real keep = r_max(TSE_R(1) - r_div(dt, SCALE_TIME), TSE_R(0));
  if (((a->apart >> which) & 1) || compute_squared_correlation(q, q->var[0]) < SCALE_RELATED) return;
  sum[0] = r_mul(keep, sum[0]) + r_mul(dt, r_sqr(deviation[0]));
  sum[1] = r_max(r_mul(keep, sum[1]) + r_mul(dt, r_mul(deviation[0], deviation[1])), TSE_R(0));
}

/* Return the square of the factor by which the speed from the wheels is too large. It is
 * the product of two ratios, (rate of the speed)/accel_x and (v r)/accel_y, each computed
 * as the ratio of the two sums of update_scale(). Return 0 if the excitation is not large
 * enough. */
static tse_real compute_scale(const tse_agreement *a)
{
  const tse_real *const across = a->moved[0], *const along = a->moved[1];
  if (!(across[0] > SCALE_SHOWN_ACROSS) || !(along[0] > SCALE_SHOWN_ALONG)) return TSE_R(0);
  return r_mul(r_div(along[1], along[0]), r_div(across[0], r_max(across[1], MIN_VARIANCE)));
}

/* Return the squared factor of compute_scale(), but computed from the variances of the
 * two pairs. In each pair, (variance of the quantity computed from the speed)/(variance
 * of the acceleration) is the squared factor. The result is the geometric mean of both
 * ratios. This needs less excitation than the sums of update_scale(), but is less
 * accurate, because noise and road slopes also increase the variances.
 *   Given:  across  lateral pair: var[0] from the speed, var[1] of accel_y
 *           along   longitudinal pair: var[1] from the speed
 *           first   variance of accel_x, without the part that road slopes can cause */
static tse_real compute_rough_scale(const tse_pair *across, const tse_pair *along, tse_real first)
{
  return r_sqrt(r_mul(r_div(across->var[0], r_max(across->var[1], MIN_VARIANCE)),
      r_div(along->var[1], r_max(first, MIN_VARIANCE))));
}

/* Return whether the speed is wrong by a factor that noise and road slopes cannot cause.
 * Both pairs must have a squared correlation of at least ROUGH_RELATED. Noise and slopes
 * are then less than a third of each variance, too little to bring the squared factor to
 * MIN_ROUGH_SCALE or MAX_ROUGH_SCALE. */
static int is_far_off(const tse_params *p, const tse_agreement *a)
{
  const tse_pair *const across = &a->pair[ACROSS], *const along = &a->pair[ALONG];
  const tse_real first = compute_explainable(p, along, ALONG);
  if (a->apart || !is_shown(across, ACROSS, across->var[0], 0) || !is_shown(along, ALONG, first, 0)) return 0;
  if (compute_squared_correlation(across, across->var[0]) < ROUGH_RELATED
      || compute_squared_correlation(along, first) < ROUGH_RELATED)
    return 0;
  const tse_real scale = compute_rough_scale(across, along, first);
  return scale > MAX_ROUGH_SCALE || scale < MIN_ROUGH_SCALE;
}

static tse_real invert_factor(tse_real x) { return x == TSE_R(0) ? x : r_div(TSE_R(1), x); }

/* Update the two sums from which the latency T of y behind x is estimated. The model is
 * y = g x - T x', i.e. y is x times a factor g, with a latency (x', y': rates of change).
 * The time integral of (x y' - y x')/2 is then T times the time integral of x'^2, for any
 * g. The ratio of these two integrals, t->late and t->square, is the estimate of T.
 *   Given:  x, y   values in the previous row and in this row
 *           slope  rate of x [per second]
 *           keep   factor by which the old sums are multiplied, to forget old rows */
static void update_timing(
    tse_timing *t, const tse_real x[2], const tse_real y[2], tse_real slope, tse_real keep, tse_real dt)
{
  const tse_real turned = r_mul(x[0], y[1]) - r_mul(x[1], y[0]);
  t->square = r_mul(keep, t->square) + r_mul(dt, r_sqr(slope));
  t->late = r_clamp(r_mul(keep, t->late) + r_mul(TSE_R(0.5), turned), -MAX_INFO, MAX_INFO);
}

/* Return the max plausible value of (nominal - true)/true for the rear cornering
 * stiffness: SOFTER, plus (before - after)/after of the last accepted change if this was
 * a change to a road with less grip. The ratio before/after counts as at most e (2.718,
 * i.e. exp(1)). */
static tse_real compute_softening(const tse_kalman *k)
{
  const tse_real lost = k->change_from[TSE_CY_REAR] - k->x[LCR];
  if (k->change_kind != TSE_CHANGE_ROAD || !(lost > TSE_R(0))) return SOFTER;
  return SOFTER + compute_exponential(r_min(lost, TSE_R(1))) - TSE_R(1);
}

/* Update the sums for two latencies: of accel_y behind speed times yaw rate, and of
 * yaw_rate behind the yaw rate that is expected from the steering angle. All quantities
 * are in m/s2: yaw rates are multiplied by the speed v.
 *
 * The lateral motion of the car itself also shifts accel_y in time. At the centre of
 * gravity, with nominal rear tyres,
 *   a_y = v r + v_y',  v_y = (l_r - T v) r,  T = v l_f/(L C_r/m)
 * where r is the yaw rate, l_f and l_r the distances of the axles from the centre of
 * gravity, L the wheelbase, C_r the rear cornering stiffness and m the mass. At the IMU,
 * l_r + lever_x takes the place of l_r. The effect of v_y' is removed from a->across, so
 * that only the latency of the channel remains. Tyres that are softer, or an IMU that is
 * further back than in the settings, leave a lag. a->lags is the time integral of (max
 * plausible value of this lag) x jerk^2.
 *   Given:  was  low-passed values of the previous row */
static void update_timings(const tse_params *p, tse_kalman *k, const tse_real was[6], tse_real dt)
{
  tse_agreement *const a = &k->agreement;
  const tse_real *const s = a->smooth;
  const tse_real gyro_bias = k->x[BR];
  const tse_car *const c = &p->car;
  const tse_real v = s[SPEED];
  const tse_real rate = r_div(TSE_R(1), dt);
  const tse_real keep = TSE_R(1) - r_div(dt, SCALE_TIME);
  const tse_real slip_time = r_div(r_mul(v, r_div(c->lf, c->lf + c->lr)), c->ky_rear);
  const tse_real arm = c->lr + c->lever_x - r_mul(v, slip_time);
  const tse_real asked[2] = { r_mul(v, was[TURN_ASKED]), r_mul(v, s[TURN_ASKED]) };
  const tse_real turns[2] = { r_mul(v, was[TURN] - gyro_bias), r_mul(v, s[TURN] - gyro_bias) };
  const tse_real offset = a->pair[ACROSS].mean[1] - a->pair[ACROSS].mean[0];
  const tse_real side[2] = { was[SIDE] - offset, s[SIDE] - offset };
  const tse_real across[2] = { was[SIDE_ASKED], s[SIDE_ASKED] };
  const tse_real jerk = r_mul(across[1] - across[0], rate);
  const tse_real steered = r_mul(asked[1] - asked[0], rate);
  if (r_abs(jerk) > MAX_JERK || r_abs(steered) > MAX_JERK) return;
  update_timing(&a->across, across, side, jerk, keep, dt);
  update_timing(&a->steered, asked, turns, steered, keep, dt);
  a->across.late += r_mul(r_mul(arm, s[TURN] - was[TURN]), jerk);
  const tse_real lag = r_min(r_mul(compute_softening(k), slip_time) + r_div(LEVER, v), TSE_R(1));
  a->lags = r_mul(keep, a->lags) + r_mul(dt, r_mul(r_sqr(jerk), lag));
}

/* Return the bit of the channel that is late: accel_y, yaw_rate or the steering angle.
 * Return 0 if no channel is late, or if the excitation is too small for a decision.
 *
 * In every car the yaw rate follows the steering angle. If the logged yaw rate leads it,
 * the logged steering angle is late. The limit of the latency of accel_y includes the lag
 * that soft tyres or an IMU further back can cause (a->lags). A late yaw_rate lags both
 * accel_y and the steering angle. Two values must therefore exceed their limits: the
 * latency of yaw_rate behind accel_y, and the sum of its two latencies (`both`).
 *
 * Both sides of each comparison are multiplied by the excitation, the time integral of
 * the squared jerk (`square`, `asked`). 3 sd of a latency are LATE_SD/sqrt(excitation).
 * Multiplied by the excitation, this is LATE_SD sqrt(excitation). */
static int find_late_channel(const tse_params *p, const tse_agreement *a)
{
  const tse_real late = a->across.late;
  const tse_real square = a->across.square;
  const tse_real behind = a->steered.late;
  const tse_real asked = a->steered.square;
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

/* If accel_y, yaw_rate and the steering angle have been present for COMPLETE_TIME, update
 * the latencies with a row and find the channel that is late.
 *   Given:  was  low-passed values of the previous row
 *           has  bits TSE_MISSING_* of the channels that are present
 *           dt   time since the previous row; 0 if there is none */
static void watch_latencies(
    const tse_params *p, tse_kalman *k, const tse_real was[6], uint32_t has, tse_real dt)
{
  static const uint32_t needed = TSE_MISSING_accel_y | TSE_MISSING_yaw_rate | TSE_MISSING_steer_angle;
  tse_agreement *const a = &k->agreement;
  const int is_complete = (has & needed) == needed && dt > TSE_R(0) && dt < MAX_ROW_TIME;
  a->complete_for = is_complete ? r_min(a->complete_for + dt, MAX_DT) : TSE_R(0);
  if (!(a->complete_for > COMPLETE_TIME && a->smooth[SPEED] > MIN_TURNING_SPEED)) return;
  update_timings(p, k, was, dt);
  a->apart = (a->apart & PAIRS_APART) | find_late_channel(p, a);
}

int32_t find_implausible_channel(const tse_kalman *k, tse_real *factor)
{
  const tse_agreement *const a = &k->agreement;
  const tse_pair *const going = &a->pair[ALONG];
  const int across = (a->apart >> ACROSS) & 1, turning = (a->apart >> TURNING_BY) & 1;
  /* If ALONG is the only pair that disagrees, the grade of the road may be the cause. The
   * decision in compare_pair() therefore subtracts the variance due to the grade. If
   * another pair disagrees, too, a wrong channel is the more likely cause of both. So
   * decide on ALONG here once more, without subtracting this variance. */
  const int also = compute_factor(going) != TSE_R(0) && is_apart(going, ALONG, going->var[0], 0);
  const int along = ((a->apart >> ALONG) & 1) || also;
  *factor = TSE_R(0);
  if (!(a->apart & PAIRS_APART)) {
    if (a->apart & LATE_STEER) return 1 + (int32_t)TSE_CHANNEL_steer_angle;
    if (a->apart & LATE_ACCEL) return 1 + (int32_t)TSE_CHANNEL_accel_y;
    if (a->apart & LATE_YAW) return 1 + (int32_t)TSE_CHANNEL_yaw_rate;
    if (!a->off_scale) return 0;
    const tse_real scale = compute_scale(a);
    *factor = r_sqrt(scale > TSE_R(0) ? scale : compute_rough_scale(&a->pair[ACROSS], going, going->var[0]));
    return 1 + (int32_t)TSE_CHANNEL_wheel_speed_front;
  }
  const tse_real gained = along ? compute_factor(going) : TSE_R(0);
  const int is_speed = across && gained < MAX_SPEED_FACTOR && gained > MIN_SPEED_FACTOR;
  /* ALONG disagrees, and so does TURNING_BY, or ACROSS by a factor that a wrong speed can
   * have. The speed is the only quantity that ALONG shares with TURNING_BY and ACROSS. It
   * is therefore wrong */
  if (along && (turning || is_speed)) {
    *factor = gained;
    return 1 + (int32_t)TSE_CHANNEL_wheel_speed_front;
  }
  if (turning) {
    *factor = across ? compute_factor(&a->pair[TURNING_BY])
                     : invert_factor(compute_factor(&a->pair[TURNING_BY]));
    return 1 + (int32_t)(across ? TSE_CHANNEL_yaw_rate : TSE_CHANNEL_steer_angle);
  }
  if (across) {
    *factor = compute_factor(&a->pair[ACROSS]);
    return 1 + (int32_t)TSE_CHANNEL_accel_y;
  }
  /* IN_BENDS or BY_DRIVE disagrees: front and rear wheel speeds are exchanged, or the
   * driven axle in the settings is wrong */
  if (!along) return 1 + (int32_t)TSE_CHANNEL_wheel_speed_front;
  *factor = invert_factor(compute_factor(going));
  return 1 + (int32_t)TSE_CHANNEL_accel_x;
}

/* Compute the values that are low-passed for the pairs, in the order SIDE ...
 *   Given:  x      channels
 *           speed  of the car [m/s] */
static void compute_values(
    const tse_params *p, const tse_real x[TSE_CHANNELS], tse_real speed, tse_real value[6])
{
  const tse_real wheelbase = p->car.lf + p->car.lr, square = r_sqr(speed);
  const tse_real understeer = r_div(
      r_div(r_mul(p->car.lr, p->car.ky_rear) - r_mul(p->car.lf, p->car.ky_front), wheelbase),
      r_mul(p->car.ky_front, p->car.ky_rear));
  value[SIDE] = x[TSE_CHANNEL_accel_y];
  value[SIDE_ASKED] = r_clamp(r_mul(speed, x[TSE_CHANNEL_yaw_rate]), -MAX_LATERAL, MAX_LATERAL);
  value[GAINED] = x[TSE_CHANNEL_accel_x];
  value[SPEED] = speed;
  value[TURN] = x[TSE_CHANNEL_yaw_rate];
  value[TURN_ASKED] = r_div(r_mul(speed, x[TSE_CHANNEL_steer_angle]),
      r_max(wheelbase + r_mul(understeer, square), r_mul(MIN_WHEELBASE, wheelbase)));
}

/* Update a pair with the sample (x, y), and decide whether its quantities disagree. */
static void compare_pair(
    const tse_params *p, tse_agreement *a, int which, tse_real x, tse_real y, tse_real dt)
{
  tse_pair *const q = &a->pair[which];
  tse_real deviation[2];
  const int apart = (a->apart >> which) & 1;
  update_pair(
      q, x, y, dt, apart ? ROAD_TIME : USUAL_TIME, r_div(min_excitation[which], USUAL_TIME), deviation);
  const tse_real first = compute_explainable(p, q, which);
  if (!is_shown(q, which, first, apart)) return;
  a->apart = is_apart(q, which, first, p->car.driven) ? a->apart | 1 << which : a->apart & ~(1 << which);
  if (which == ACROSS || which == ALONG) update_scale(a, which, deviation, dt);
}

/* Read the channels of a row.
 *   Returned:  bits TSE_MISSING_* of the channels that are present (not missing, as the
 *              name of the bits says) and in range
 *              x  their values; 0 for the other channels */
static uint32_t read_channels(const tse_input *u, tse_real x[TSE_CHANNELS])
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

void check_agreement(const tse_params *p, tse_kalman *k, const tse_input *u, tse_real dt, int no_second)
{
  static const uint32_t made_of[6] = { TSE_MISSING_accel_y, TSE_MISSING_yaw_rate, TSE_MISSING_accel_x, 0,
    TSE_MISSING_yaw_rate, TSE_MISSING_steer_angle };
  tse_agreement *const a = &k->agreement;
  tse_real x[TSE_CHANNELS], value[6], change;
  const uint32_t has = read_channels(u, x);
  const uint32_t wheels = has & (TSE_MISSING_wheel_speed_front | TSE_MISSING_wheel_speed_rear);
  const int both = wheels == (TSE_MISSING_wheel_speed_front | TSE_MISSING_wheel_speed_rear);
  const tse_real front = r_mul(p->radius_front, x[TSE_CHANNEL_wheel_speed_front]),
                 rear = r_mul(p->radius_rear, x[TSE_CHANNEL_wheel_speed_rear]);
  const tse_real speed = r_mul(both ? TSE_R(0.5) : TSE_R(1), front + rear);
  dt = r_min(a->since + dt, MAX_TIME);
  a->since = wheels ? TSE_R(0) : dt; /* adds up over rows without a wheel speed */
  if (!wheels || !(speed > p->hold_speed)) return;
  compute_values(p, x, speed, value);
  const int starts = dt > MAX_SMOOTH_DT || !(a->smooth[SPEED] > TSE_R(0));
  tse_real was[6];
  memcpy(was, a->smooth, sizeof was);
  const tse_real gain = starts ? TSE_R(1) : r_div(dt, dt + SMOOTH_TIME);
  change = r_div(speed - a->smooth[SPEED], dt + SMOOTH_TIME);
  /* A channel that is missing in this row keeps its low-passed value. Its `value` is 0
   * because read_channels() returns 0 for it. If this 0 were used, the low-passed value
   * of a channel that is logged less often than the others would be too small. */
  for (int i = 0; i < 6; i++)
    if ((has & made_of[i]) == made_of[i]) a->smooth[i] += r_mul(gain, value[i] - a->smooth[i]);
  watch_latencies(p, k, was, has, starts ? TSE_R(0) : dt);
  /* After a gap the low-passed rate of the speed (`change`) restarts at 0. accel_x is
   * compared with it in the pair ALONG. The low-passed accel_x therefore also restarts at
   * 0. */
  if (dt > MAX_SMOOTH_DT) a->smooth[GAINED] = TSE_R(0);
  if (starts) return;
  const tse_real *const s = a->smooth;
  const tse_real faster = r_clamp(r_div(front - rear, speed), TSE_R(-1), TSE_R(1)),
                 bend = r_clamp(r_div(r_mul(p->car.lf + p->car.lr, s[TURN]), s[SPEED]), TSE_R(-1), TSE_R(1));
  const tse_real ahead = r_mul(TSE_R(0.5), r_sqr(bend)); /* expected value of `faster` in a bend */
  const struct {
    tse_real x, y;
    int counts;
  } now[TSE_PAIRS] = {
    { s[SIDE_ASKED], s[SIDE], (has & TSE_MISSING_accel_y) && (has & TSE_MISSING_yaw_rate) },
    { s[TURN_ASKED], s[TURN], (has & TSE_MISSING_steer_angle) && (has & TSE_MISSING_yaw_rate) },
    { s[GAINED], r_clamp(change, -MAX_LATERAL, MAX_LATERAL),
        (has & TSE_MISSING_accel_x) && r_abs(faster) < SLIPPING },
    { ahead, faster, both && !no_second && (has & TSE_MISSING_yaw_rate) && r_abs(faster) < SLIPPING + ahead },
    { s[GAINED], faster, both && !no_second && (has & TSE_MISSING_accel_x) && s[GAINED] > GAINS_SPEED },
  };
  for (int i = 0; i < TSE_PAIRS; i++)
    if (now[i].counts) compare_pair(p, a, i, now[i].x, now[i].y, dt);
  const tse_real scale = compute_scale(a);
  a->off_scale = (scale > TSE_R(0) && (scale > MAX_SCALE || scale < MIN_SCALE)) || is_far_off(p, a);
}
