/* filter/predict.c - state and covariance to the time of the row. */
#include "filter/filter.h"

void signal_shares(const tse_kalman *k, tse_real share[3])
{
  static const int of[3][2] = { { SF, SR }, { AF, -1 }, { AR, -1 } };
  for (int a = HAS_SLIP ? 0 : 1; a < 3; a++) {
    tse_real signal = TSE_R(0), error = LEAST_ERROR;
    for (int n = 0; n < 2 && of[a][n] >= 0; n++) {
      signal += r_sqr(r_div(k->x[of[a][n]], state_unit[of[a][n]]));
      error += ud_variance(&k->ud, of[a][n]);
    }
    share[a] = r_div(signal, signal + error);
  }
}

/* Return the angle of the wheels through this row, after the steering's own lags. */
static steering delayed(const tse_params *p, tse_kalman *k, const decoded *z)
{
  const tse_real was = k->steer[2];
  if (p->steer_lag > TSE_R(0)) lag_steering(p->steer_lag, p->steer_lag_second, z->steer, z->dt, k->steer);
  else k->steer[0] = k->steer[1] = k->steer[2] = z->steer;
  const steering u = { was, k->steer[2], z->dt };
  return u;
}

/* Propagate state i as an Ornstein-Uhlenbeck process about 0: multiply x, its row and
 * column of the covariance and its sensitivities by `left`; add (1 - left^2) sd^2. */
static void fade(tse_kalman *k, int i, tse_real left, tse_real sd)
{
  k->x[i] = r_mul(k->x[i], left);
  ud_fade(&k->ud, i, left);
  sensitivities_fade(k, i, left);
  ud_add_at(&k->ud, i, r_mul(r_sqr(r_div(sd, state_unit[i])), TSE_R(1) - r_sqr(left)));
}

static const int gravity[2] = { GX, GY };

/* Return gravity along (i = 0) or across (1) the road about which its state wanders: what
 * is given, else the setting. */
static tse_real road_mean(const tse_params *p, const tse_kalman *k, int i)
{
  return k->road_given >> i & 1 ? k->road[i] : p->prior[gravity[i]];
}

/* Return by how much it wanders, sd. A given road is never less sure than one that is
 * not. */
static tse_real road_sd(const tse_params *p, const tse_kalman *k, int i)
{
  const tse_real sd = p->prior_sd[gravity[i]];
  return k->road_given >> i & 1 ? r_min(sd, p->road_sd) : sd;
}

void road_row(const tse_params *p, tse_kalman *k, const decoded *z)
{
  const int given = (z->given & TSE_GIVEN_grade ? 1 : 0) | (z->given & TSE_GIVEN_bank ? 2 : 0);
  if (!(given | k->road_given)) return;
  const int begins = given ^ k->road_given; /* or ends: nothing of the state before is of this road */
  for (int i = 0; i < 2; i++) {
    const int at = gravity[i];
    const tse_real before = road_mean(p, k, i);
    /* an angle that is not given is 0 */
    k->road[i] = gravity_along(i ? -z->optional[TSE_OPTIONAL_bank] : z->optional[TSE_OPTIONAL_grade]);
    k->road_given = (k->road_given & ~(1 << i)) | (given & 1 << i);
    k->x[at] += road_mean(p, k, i) - before;
    if (!(begins >> i & 1)) continue;
    for (int n = 0; n < FORGOTTEN && at < STATES; n++) fade(k, at, TSE_R(0.5), road_sd(p, k, i));
    k->x[at] = road_mean(p, k, i);
  }
}

typedef char each_slow_state_has_its_time[(int)TSE_SLOW == (int)STATES - (int)PLACED ? 1 : -1];

/* Let gravity along (i = 0) or across (1) the road wander about its mean for dt. */
static void wander(const tse_params *p, tse_kalman *k, int i, tse_real dt)
{
  const int at = gravity[i];
  const tse_real mean = road_mean(p, k, i);
  k->x[at] -= mean;
  fade(k, at, left_of(r_min(dt, MOST_AGE), ROAD_TIME), road_sd(p, k, i));
  k->x[at] += mean;
}

/* Add the process noise of a random-walk state for dt; of a stiffness, what its moves
 * have left to add, too. */
static void walk(const tse_params *p, tse_kalman *k, int i, tse_real dt)
{
  const int which = i == LCX ? 0 : i == LCF || i == LCR ? 1 + i - LCF : -1;
  const int bias = i == BX ? 0 : i == BY ? 1 : i == BR ? 2 : -1;
  const tse_real of_prior = bias >= 0 ? p->bias_sd_walk[bias] : r_mul(WALK_SHARE, p->prior_sd[i]);
  const tse_real sd = r_max(of_prior, which >= 0 ? p->steady_sd_walk : TSE_R(0));
  tse_real more = r_mul(r_sqr(r_div(sd, state_unit[i])), dt);
  if (which >= 0) {
    more += k->moved[which];
    k->moved[which] = TSE_R(0);
  }
  if (more > TSE_R(0)) ud_add_at(&k->ud, i, more);
}

/* A rank-one change of the covariance takes long: one slow state a row has its time since
 * the last, in turn, and each that is due. */
void rest_row(const tse_params *p, tse_kalman *k, tse_real dt)
{
  for (int n = 0; n < TSE_SLOW; n++) {
    const int i = PLACED + n;
    tse_real *const since = &k->since_slow[n];
    *since = r_min(*since + dt, MAX_DT);
    if (n != k->slow_turn && *since < (i < FAST ? WANDER_TIME : WALK_TIME)) continue;
    if (i < FAST) wander(p, k, i == GY, *since);
    else walk(p, k, i, *since);
    *since = TSE_R(0);
  }
  k->slow_turn = k->slow_turn < TSE_SLOW - 1 ? k->slow_turn + 1 : 0;
  k->change_age = k->change_kind ? r_min(k->change_age + dt, LONGEST_TIME) : TSE_R(0);
}

/* Move the state through the row. The given bank of a road is all of it: the share by
 * which roads lean into their curves has no part then.
 *   Updated: x      Returned: M  as car_move() */
static void move_row(
    const tse_params *p, tse_kalman *k, const decoded *z, steering u, tse_short M[MOTION][PLACES])
{
  const tse_real lean = k->x[LEAN];
  const int has_bank = (z->given & TSE_GIVEN_bank) != 0;
  if (has_bank) k->x[LEAN] = TSE_R(0);
  car_move(&p->car, k->x, u, M);
  k->x[LEAN] = lean;
  for (int i = 0; has_bank && i < MOTION; i++) M[i][LEAN] = r_short(TSE_R(0));
}

/* Scale the transition to state units. Multiply derivatives with respect to a stiffness
 * by share: slip^2/(slip^2 + var slip), of signal_shares().
 *   Given: z  no_slip: v_x does not depend on the longitudinal stiffness; no_second: nor
 *             does any motion on slip
 *   Updated: M  from car_move() to ud_move() */
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
      if (M[i][j] != TSE_R(0)) M[i][j] = r_slope_in_units(M[i][j], unit[j], own, STEEPEST);
    for (int j = STATES; j < COLUMNS; j++) M[i][j] = r_short_over(M[i][j], own, STEEPEST);
  }
}

/* Set the slip of each axle to that of the force that accel_x reads: of the axle that
 * drives, of both where they brake or which one drives is not known. Where accel_x is
 * missing, none. No wheels slide that nothing shows. */
static void slip_of_force(const tse_params *p, tse_kalman *k, const decoded *z)
{
  const tse_car *const c = &p->car;
  const tse_real rest = drag_of(c->drag, k->x[VX]) + rolling_of(c->rolling, k->x[VX]);
  const tse_real force = z->use[ACCEL_X] ? tyre_pull(r_div(z->z[ACCEL_X], c->scale_x) + rest) : TSE_R(0);
  const int32_t free = z->rolls != ROLLS_UNKNOWN ? z->rolls : force < TSE_R(0) ? ROLLS_NONE : not_driven(c);
  const tse_real stiff = r_mul(exponential(k->x[LCX]),
      (free == ROLLS_FRONT ? TSE_R(0) : c->kx_front) + (free == ROLLS_REAR ? TSE_R(0) : c->kx_rear));
  const tse_real slip = r_clamp(r_div(force, stiff), -p->max_slip, p->max_slip),
                 follow = r_div(z->dt, z->dt + FORCE_TIME);
  k->x[SF] += r_mul(follow, (free == ROLLS_FRONT ? TSE_R(0) : slip) - k->x[SF]);
  k->x[SR] += r_mul(follow, (free == ROLLS_REAR ? TSE_R(0) : slip) - k->x[SR]);
}

steering predict_row(const tse_params *p, tse_kalman *k, const decoded *z)
{
  tse_short M[MOTION][PLACES];
  tse_real noise[MOTION], share[3];
  const tse_real dt = z->dt, left = left_of(dt, SLIP_TIME);
  const steering u = delayed(p, k, z);
  const int by_force = !HAS_SLIP || z->no_second;
  if (by_force) slip_of_force(p, k, z);
  signal_shares(k, share);
  move_row(p, k, z, u, M);
  for (int i = 0; i < MOTION; i++) {
    k->x[i] = r_clamp(k->x[i], -state_most[i], state_most[i]);
    noise[i] = r_mul(r_sqr(WALK_SHARE), dt);
  }
  if (by_force)
    noise[VX] = r_mul(r_sqr(r_div(p->prior_sd[GX] + p->prior_sd[BX] + LEAST_ACTIVITY, state_unit[VX])), dt);
  scale_transition(M, share, z);
  ud_move(&k->ud, M, noise);
  sensitivities_move(p, k, M, dt);
  for (int i = SF; HAS_SLIP && i <= SR; i++) {
    const tse_real slip = k->x[i];
    fade(k, i, left, SLIP_SD);
    if (by_force) k->x[i] = slip;
  }
  rest_row(p, k, dt);
  return u;
}
