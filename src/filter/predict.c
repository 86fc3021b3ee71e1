/* filter/predict.c - prediction of state and covariance to the time of the row. */
#include "filter/exponential.h"
#include "filter/predict.h"
#include "filter/sensitivities.h"
#include "filter/units.h"

void compute_signal_shares(const tse_kalman *k, tse_real share[3])
{
  /* for each stiffness, the states (slips or slip angle) that it multiplies in the tyre
   * force. The longitudinal stiffness multiplies two slips, front and rear. -1: no second
   * state */
  static const int slip_states[3][2] = { { SF, SR }, { AF, -1 }, { AR, -1 } };
  for (int a = HAS_SLIP ? 0 : 1; a < 3; a++) {
    tse_real signal = TSE_R(0), error = MIN_SLIP_VAR;
    for (int n = 0; n < 2 && slip_states[a][n] >= 0; n++) {
      signal += r_sqr(r_div(k->x[slip_states[a][n]], state_unit[slip_states[a][n]]));
      error += ud_variance(&k->ud, slip_states[a][n]);
    }
    share[a] = r_div(signal, signal + error);
  }
}

/* Return the angle of the front wheels at the previous row and at this row: the logged
 * steering angle, delayed by the lags of the steering. */
static steering apply_steering_lag(const tse_params *p, tse_kalman *k, const decoded *z)
{
  const tse_real was = k->steer[2];
  if (p->steer_lag > TSE_R(0)) lag_steering(p->steer_lag, p->steer_lag_second, z->steer, z->dt, k->steer);
  else k->steer[0] = k->steer[1] = k->steer[2] = z->steer;
  const steering u = { was, k->steer[2], z->dt };
  return u;
}

/* Propagate state i as an Ornstein-Uhlenbeck process about 0: multiply x, its row
 * and column of the covariance, and its sensitivities by `left`, and add
 * (1 - left^2) sd^2 to its variance. */
static void fade_state(tse_kalman *k, int i, tse_real left, tse_real sd)
{
  k->x[i] = r_mul(k->x[i], left);
  ud_fade(&k->ud, i, left);
  sensitivities_fade(k, i, left);
  ud_add_at(&k->ud, i, r_mul(r_sqr(r_div(sd, state_unit[i])), TSE_R(1) - r_sqr(left)));
}

static const int gravity[2] = { GX, GY };

/* Return the mean of gravity along (i = 0) or across (i = 1) the road: from the grade or
 * bank of the row if given, otherwise from the settings. */
static tse_real get_road_mean(const tse_params *p, const tse_kalman *k, int i)
{
  return k->road_given >> i & 1 ? k->road[i] : p->prior[gravity[i]];
}

/* Return the sd [m/s2] by which gravity along (i = 0) or across (i = 1) the road varies
 * about its mean: the prior sd in the settings. If the row gives the grade (i = 0) or the
 * bank (i = 1), the sd is at most p->road_sd = g x (sd of the error of a given angle). */
static tse_real get_road_sd(const tse_params *p, const tse_kalman *k, int i)
{
  const tse_real sd = p->prior_sd[gravity[i]];
  return k->road_given >> i & 1 ? r_min(sd, p->road_sd) : sd;
}

void update_road(const tse_params *p, tse_kalman *k, const decoded *z)
{
  const int given = (z->given & TSE_GIVEN_grade ? 1 : 0) | (z->given & TSE_GIVEN_bank ? 2 : 0);
  if (!(given | k->road_given)) return;
  const int changes = given ^ k->road_given; /* bit 0: grade, bit 1: bank begins or ceases to be given */
  for (int i = 0; i < 2; i++) {
    const int at = gravity[i];
    const tse_real before = get_road_mean(p, k, i);
    /* if the row gives no angle, z->optional is 0, and get_road_mean() does not use the
     * result */
    k->road[i] = gravity_along(i ? -z->optional[TSE_OPTIONAL_bank] : z->optional[TSE_OPTIONAL_grade]);
    k->road_given = (k->road_given & ~(1 << i)) | (given & 1 << i);
    k->x[at] += get_road_mean(p, k, i) - before;
    if (!(changes >> i & 1)) continue;
    for (int n = 0; n < ROAD_HALVINGS && at < STATES; n++)
      fade_state(k, at, TSE_R(0.5), get_road_sd(p, k, i));
    k->x[at] = get_road_mean(p, k, i);
  }
}

typedef char each_slow_state_has_its_time[(int)TSE_SLOW == (int)STATES - (int)PLACED ? 1 : -1];

/* Propagate gravity along (i = 0) or across (i = 1) the road for dt: an Ornstein-
 * Uhlenbeck process about its mean. */
static void propagate_gravity(const tse_params *p, tse_kalman *k, int i, tse_real dt)
{
  const int at = gravity[i];
  const tse_real mean = get_road_mean(p, k, i);
  k->x[at] -= mean;
  fade_state(k, at, compute_decay(r_min(dt, MAX_AGE), ROAD_TIME), get_road_sd(p, k, i));
  k->x[at] += mean;
}

/* Add the process noise of a random walk over dt to state i. If state i is a stiffness,
 * also add k->moved and reset it to 0. k->moved is the variance of linearisation errors:
 * each correction of the stiffness increases it (apply_correction() in update.c). */
static void add_walk(const tse_params *p, tse_kalman *k, int i, tse_real dt)
{
  const int a = i == LCX ? 0 : i == LCF || i == LCR ? 1 + i - LCF : -1;
  const int bias = i == BX ? 0 : i == BY ? 1 : i == BR ? 2 : -1;
  const tse_real walk_sd = bias >= 0 ? p->bias_sd_walk[bias] : r_mul(WALK_SHARE, p->prior_sd[i]);
  const tse_real sd = r_max(walk_sd, a >= 0 ? p->steady_sd_walk : TSE_R(0));
  tse_real q = r_mul(r_sqr(r_div(sd, state_unit[i])), dt);
  if (a >= 0) {
    q += k->moved[a];
    k->moved[a] = TSE_R(0);
  }
  if (q > TSE_R(0)) ud_add_at(&k->ud, i, q);
}

/* Each addition of process noise to a state is a rank-one change of the covariance, which
 * takes too long for all slow states in each row. In a row, process noise is added only
 * to the state slow_turn (each slow state in turn), and to each state whose last addition
 * is WALK_TIME ago, or WANDER_TIME for gravity. It is the noise of the whole time since
 * then. A TSE_SMALL build adds noise to all its few slow states in each row. */
void predict_slow_states(const tse_params *p, tse_kalman *k, tse_real dt)
{
  for (int n = 0; n < TSE_SLOW; n++) {
    const int i = PLACED + n;
    tse_real *const since = &k->since_slow[n];
    *since = r_min(*since + dt, MAX_DT);
    if (HAS_SLIP && n != k->slow_turn && *since < (i < FAST ? WANDER_TIME : WALK_TIME)) continue;
    if (i < FAST) propagate_gravity(p, k, i == GY, *since);
    else add_walk(p, k, i, *since);
    *since = TSE_R(0);
  }
  k->slow_turn = k->slow_turn < TSE_SLOW - 1 ? k->slow_turn + 1 : 0;
  k->change_age = k->change_kind ? r_min(k->change_age + dt, MAX_TIME) : TSE_R(0);
}

/* Propagate the state through the row. The state LEAN is the superelevation of curves:
 * the share of the lateral acceleration that gravity provides in a banked curve. If the
 * row gives the bank of the road, the bank includes the superelevation, and 0 is used in
 * place of LEAN.
 *   Updated:   k->x
 *   Returned:  M  as in car_move() */
static void move_motion(
    const tse_params *p, tse_kalman *k, const decoded *z, steering u, tse_short M[MOTION][PLACES])
{
  const tse_real lean = k->x[LEAN];
  const int has_bank = (z->given & TSE_GIVEN_bank) != 0;
  if (has_bank) k->x[LEAN] = TSE_R(0);
  car_move(&p->car, k->x, u, M);
  k->x[LEAN] = lean;
  for (int i = 0; has_bank && i < MOTION; i++) M[i][LEAN] = r_short(TSE_R(0));
}

/* Multiply the partial derivatives with respect to each stiffness by its share from
 * compute_signal_shares(), so that errors of the slip do not bias the stiffness. Then
 * convert the transition M from SI units to the units of the state.
 *
 * If z->no_slip is 1, set the derivative of v_x with respect to the slip stiffness to 0.
 * If z->no_second is 1, set all derivatives with respect to slips and slip stiffness to
 * 0. The filter then does not estimate them. */
static void scale_transition(tse_short M[MOTION][PLACES], const tse_real share[3], const decoded *z)
{
  r_factored unit[STATES];
  for (int i = 0; i < MOTION; i++)
    for (int a = HAS_SLIP ? 0 : 1; a < 3; a++)
      M[i][stiffness_at(a)] = r_short_scaled(
          r_mul(r_long_scaled(M[i][stiffness_at(a)], ROW_UP), share[a]), ROW_UP);
  if (HAS_SLIP && z->no_slip) M[VX][LCX] = r_short(TSE_R(0));
  for (int i = 0; HAS_SLIP && z->no_second && i < MOTION; i++) {
    M[i][SF] = M[i][SR] = M[i][LCX] = r_short(TSE_R(0));
  }
  for (int j = 0; j < STATES; j++) unit[j] = r_unit(state_unit[j]);
  for (int i = 0; i < MOTION; i++) {
    const r_factored own = r_over_unit(state_unit[i]);
    for (int j = 0; j < STATES; j++)
      if (M[i][j] != TSE_R(0)) M[i][j] = r_slope_in_units(M[i][j], unit[j], own, MAX_SLOPE);
    for (int j = STATES; j < COLUMNS; j++) M[i][j] = r_short_over(M[i][j], own, MAX_SLOPE);
  }
}

/* Compute the slip of each axle for a row whose wheel speeds do not show it: the force
 * that accel_x measures, divided by the longitudinal stiffness, and low-passed. The force
 * acts at the driven axle. It acts at both axles if the car brakes, or if the driven axle
 * is unknown. Without accel_x the force is 0. Wheels that slide are not detected: their
 * slip is larger than this quotient. */
static void set_slip_by_force(const tse_params *p, tse_kalman *k, const decoded *z)
{
  const tse_car *const c = &p->car;
  const tse_real rest = drag_of(c->drag, k->x[VX]) + rolling_of(c->rolling, k->x[VX]);
  const tse_real force = z->use[ACCEL_X] ? tyre_pull(r_div(z->z[ACCEL_X], c->scale_x) + rest) : TSE_R(0);
  const int32_t free = z->rolls != ROLLS_UNKNOWN ? z->rolls
      : force < TSE_R(0)                         ? ROLLS_NONE
                                                 : find_undriven_axle(c);
  const tse_real C = r_mul(compute_exponential(k->x[LCX]),
      (free == ROLLS_FRONT ? TSE_R(0) : c->kx_front) + (free == ROLLS_REAR ? TSE_R(0) : c->kx_rear));
  const tse_real slip = r_clamp(r_div(force, C), -p->max_slip, p->max_slip);
  const tse_real gain = r_div(z->dt, z->dt + FORCE_TIME);
  k->x[SF] += r_mul(gain, (free == ROLLS_FRONT ? TSE_R(0) : slip) - k->x[SF]);
  k->x[SR] += r_mul(gain, (free == ROLLS_REAR ? TSE_R(0) : slip) - k->x[SR]);
}

steering predict_row(const tse_params *p, tse_kalman *k, const decoded *z)
{
  tse_short M[MOTION][PLACES];
  tse_real noise[MOTION], share[3];
  const tse_real dt = z->dt, left = compute_decay(dt, SLIP_TIME);
  const steering u = apply_steering_lag(p, k, z);
  const int by_force = !HAS_SLIP || z->no_second;
  if (by_force) set_slip_by_force(p, k, z);
  compute_signal_shares(k, share);
  move_motion(p, k, z, u, M);
  for (int i = 0; i < MOTION; i++) {
    k->x[i] = r_clamp(k->x[i], -state_max[i], state_max[i]);
    noise[i] = r_mul(r_sqr(WALK_SHARE), dt);
  }
  if (by_force)
    noise[VX] = r_mul(r_sqr(r_div(p->prior_sd[GX] + p->prior_sd[BX] + MIN_ACTIVITY, state_unit[VX])), dt);
  scale_transition(M, share, z);
  ud_move(&k->ud, M, noise);
  sensitivities_move(p, k, M, dt);
  for (int i = SF; HAS_SLIP && i <= SR; i++) {
    const tse_real slip = k->x[i];
    fade_state(k, i, left, SLIP_SD);
    if (by_force) k->x[i] = slip;
  }
  predict_slow_states(p, k, dt);
  return u;
}
