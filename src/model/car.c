/* model/car.c - forces, motion and sensors of the car, with their partial derivatives.
 * car.h has the equations. */
#include "model/car.h"
#include "number/vector.h"

#define MAX_SUBSTEP TSE_R(0.011) /* [s] max substep of the integration; a row of 10 ms is one substep */
#define RADIUS_LOSS TSE_R(0.005) /* [1] relative decrease of the rolling radius under the static load: a tyre
                                  * deflection of 20 mm decreases the radius of 0.32 m by 8 % of
                                  * 20 mm, i.e. by 1.6 mm */

/* Longitudinal or lateral force of a tyre. Forces are divided by the mass of the car. */
typedef struct tyre {
  tse_real f;            /* [m/s2] force */
  tse_real by_slip;      /* derivative of f with respect to slip, or slip angle */
  tse_real by_stiffness; /* derivative of f with respect to ln(stiffness) */
  tse_real by_mu;        /* derivative of f with respect to ln(grip) */
  tse_real secant;       /* secant stiffness: force / slip */
  tse_real endless;      /* [m/s2] force of a linear tyre: stiffness times slip */
} tyre;

/* Return the longitudinal or lateral force of a tyre, and its derivatives.
 *   Given:  stiffness  [m/s2] or [m/s2/rad]
 *           limit      [m/s2] max force
 *           slip       [1] slip, or [rad] slip angle
 *           shape      [1] shape of the force curve, as in tyre_secant() */
static tyre compute_tyre(tse_real stiffness, tse_real limit, tse_real slip, tse_real shape)
{
  const tse_real linear = r_mul(stiffness, slip);
  tse_real slope;
  const tse_real secant = tyre_secant(r_div(r_abs(linear), limit), shape, &slope);
  const tyre t = { r_mul(linear, secant), r_mul(stiffness, secant + slope), r_mul(linear, secant + slope),
    -r_mul(linear, slope), r_mul(stiffness, secant), linear };
  return t;
}

/* Forces of both axles: x longitudinal, y lateral. */
typedef struct tyres {
  tyre x_front, x_rear, y_front, y_rear;
} tyres;

/* Return all tyre forces at the state x. Longitudinal acceleration transfers load to the
 * rear axle. The slip stiffness and the max force of an axle are proportional to the load
 * of the axle. The cornering stiffness of the axle changes by a smaller ratio than the
 * load. Lateral acceleration transfers load between the wheels of an axle, which reduces
 * the cornering stiffness of the axle. */
static tyres compute_tyres(const tse_car *c, const tse_real x[TSE_VALUES])
{
  const tse_real cx = exponential(x[LCX]), mu = r_mul(c->grip, exponential(x[LMU]));
  const tse_real drive = tyre_pull(r_mul(cx, r_mul(c->kx_front, x[SF]) + r_mul(c->kx_rear, x[SR])));
  const tse_real front = r_mul(
      r_mul(c->ky_front, exponential(x[LCF])), compute_load_share(-r_mul(c->along_front, drive)));
  const tse_real rear = r_mul(
      r_mul(c->ky_rear, exponential(x[LCR])), compute_load_share(r_mul(c->along_rear, drive)));
  const tse_real square = compute_lateral_square(
      r_mul(TSE_R(0.5), c->side_front + c->side_rear), tyre_pull(r_mul(front, x[AF]) + r_mul(rear, x[AR])));
  const tse_real load_front = compute_load_share(-r_mul(c->height_front, drive)),
                 load_rear = compute_load_share(r_mul(c->height_rear, drive));
  const tse_real max_front = r_mul(r_mul(mu, c->end_front), load_front);
  const tse_real max_rear = r_mul(r_mul(mu, c->end_rear), load_rear);
  tyres t;
  t.x_front = compute_tyre(r_mul(r_mul(cx, c->kx_front), load_front), max_front, x[SF], c->shape);
  t.x_rear = compute_tyre(r_mul(r_mul(cx, c->kx_rear), load_rear), max_rear, x[SR], c->shape);
  t.y_front = compute_tyre(
      r_mul(front, compute_side_share(c->side_front, square)), max_front, x[AF], c->shape);
  t.y_rear = compute_tyre(r_mul(rear, compute_side_share(c->side_rear, square)), max_rear, x[AR], c->shape);
  return t;
}

void car_secants(const tse_car *c, const tse_real x[TSE_VALUES], tse_real share[3])
{
  const tyres t = compute_tyres(c, x);
  share[0] = r_div(t.x_front.secant, r_mul(c->kx_front, exponential(x[LCX])));
  share[1] = r_div(t.y_front.secant, r_mul(c->ky_front, exponential(x[LCF])));
  share[2] = r_div(t.y_rear.secant, r_mul(c->ky_rear, exponential(x[LCR])));
}

/* Compute the partial derivatives of the forces with respect to states and consider
 * parameters. Load transfer, steering compliance, and the influence of the grip on
 * longitudinal saturation are neglected.
 *   Given:     t       forces of the tyres at x
 *              ax, ay  [m/s2] longitudinal and lateral force of the front axle, in the
 *                      axes of the car
 *              f       forces at x: the members steer, rate, sin_d, cos_d and yaw
 *   Returned:  by_x, by_y, by_yaw of f */
static void compute_force_slopes(
    const tse_car *c, const tse_real x[TSE_VALUES], const tyres *t, tse_real ax, tse_real ay, forces *f)
{
  const tse_real none = TSE_R(0), sine = f->sin_d, cosine = f->cos_d;
  const struct {
    int at;
    /* derivatives of the front forces (axes of the wheels) and of the rear forces */
    tse_real x, y, rear_x, rear_y;
  } by[] = {
    { SF, t->x_front.by_slip, none, none, none },
    { AF, none, t->y_front.by_slip, none, none },
    { SR, none, none, t->x_rear.by_slip, none },
    { AR, none, none, none, t->y_rear.by_slip },
    { LCX, t->x_front.by_stiffness, none, t->x_rear.by_stiffness, none },
    { LCF, none, t->y_front.by_stiffness, none, none },
    { LCR, none, none, none, t->y_rear.by_stiffness },
    { LMU, none, t->y_front.by_mu, none, t->y_rear.by_mu },
  };
  for (int j = 0; j < PLACES; j++) f->by_x[j] = f->by_y[j] = f->by_yaw[j] = TSE_R(0);
  for (int i = 0; i < (int)(sizeof by / sizeof by[0]); i++) {
    if (by[i].at >= COLUMNS) continue;
    const tse_real y = r_mul(by[i].y, cosine) + r_mul(by[i].x, sine);
    f->by_x[by[i].at] = r_mul(by[i].x, cosine) - r_mul(by[i].y, sine) + by[i].rear_x;
    f->by_y[by[i].at] = y + by[i].rear_y;
    f->by_yaw[by[i].at] = r_mul(c->jf, y) - r_mul(c->trail, by[i].y) - r_mul(c->jr + c->trail, by[i].rear_y);
  }
  f->by_x[VX] = -r_mul(TSE_R(2), r_mul(c->drag, r_abs(x[VX])));
  static const int of_d[3] = { STEER_OFFSET, GAIN, LATE };
  const tse_real by_d[3] = { TSE_R(1), f->steer - r_mul(x[LATE], f->rate),
    -r_mul(TSE_R(1) + x[GAIN], f->rate) };
  for (int i = 0; i < 3; i++) { /* the road-wheel angle d turns the front force */
    f->by_x[of_d[i]] = -r_mul(by_d[i], ay);
    f->by_y[of_d[i]] = r_mul(by_d[i], ax);
    f->by_yaw[of_d[i]] = r_mul(c->jf, r_mul(by_d[i], ax));
  }
  f->by_yaw[STATES + CONSIDER_INERTIA] = -f->yaw;
  f->by_yaw[STATES + CONSIDER_CENTRE] = r_mul(c->m_inertia, ay + t->y_rear.f);
  f->by_yaw[STATES + CONSIDER_TRAIL] = -r_mul(c->m_inertia, t->y_front.f + t->y_rear.f);
}

void car_forces(const tse_car *c, const tse_real x[TSE_VALUES], steering u, tse_real share, forces *f)
{
  const tyres t = compute_tyres(c, x);
  const tyre *const xf = &t.x_front, *const yf = &t.y_front, *const xr = &t.x_rear, *const yr = &t.y_rear;
  f->steer = u.from + r_mul(share, u.to - u.from);
  f->rate = r_div(u.to - u.from, u.dt);
  const tse_real d = r_mul(TSE_R(1) + x[GAIN], f->steer - r_mul(x[LATE], f->rate)) + x[STEER_OFFSET]
      - r_mul(c->compliance, yf->f);
  sin_cos(d, &f->sin_d, &f->cos_d);
  f->side = yf->f;
  f->endless_x = xf->endless + xr->endless;
  f->endless_y = yf->endless + yr->endless;
  /* -(a - b) instead of b - a: gcc 12 would fuse the products, see turn_axes() */
  const tse_real ax = -(r_mul(yf->f, f->sin_d) - r_mul(xf->f, f->cos_d)),
                 ay = r_mul(yf->f, f->cos_d) + r_mul(xf->f, f->sin_d);
  f->x = ax + xr->f - drag_of(c->drag, x[VX]) - rolling_of(c->rolling, x[VX]);
  f->y = ay + yr->f + c->pull_front + c->pull_rear;
  f->yaw = r_mul(c->jf, ay + c->pull_front) - r_mul(c->jr, yr->f + c->pull_rear)
      - r_mul(c->trail, yf->f + yr->f);
  compute_force_slopes(c, x, &t, ax, ay, f);
}

/* Kinematic slip angle of an axle whose wheels are not steered: minus the angle of the
 * velocity of the axle to the longitudinal axis of the car. The slip angle of the tyres
 * approaches this angle, plus the steering angle, over the relaxation length. */
typedef struct kinematic {
  tse_real a;             /* [rad] */
  tse_real by_side, by_v; /* [s/m] its derivatives with respect to lateral and longitudinal speed */
} kinematic;

/* Return the kinematic slip angle of an axle whose wheels are not steered.
 *   Given:  side  lateral speed of the axle [m/s] */
static kinematic compute_kinematic_angle(tse_real side, tse_real vx)
{
  const tse_real v = rolling_speed(vx), over = r_div(TSE_R(1), r_mul(v, v) + r_mul(side, side));
  kinematic angle;
  angle.a = slip_angle(side, vx);
  angle.by_side = -r_mul(v, over);
  angle.by_v = vx > LOW_SPEED ? r_mul(side, over) : TSE_R(0);
  return angle;
}

/* Return the roll acceleration phi'' [rad/s2] at the lateral specific force ay [m/s2]. */
static tse_real compute_roll_swing(const tse_car *c, const tse_real x[TSE_VALUES], tse_real ay)
{
  return compute_mode_swing(x[PHI], x[DPHI], c->roll_omega, c->roll_damping, r_mul(c->roll_gain, ay));
}

/* Return whether the motion of the car depends on the state or consider parameter in
 * column j. The motion does not depend on biases and on the error of the front wheel
 * radius, because they change only the readings of sensors. */
static int moves_with(int j) { return !(j == BX || j == BY || j == BR) && j != RAD; }

/* Add `more` to the derivative in column j of the row, if this build has column j. */
static void add_slope(tse_short *row, int j, tse_real more)
{
  if (j < COLUMNS) row[j] = r_short_sum(row[j], r_short_scaled(more, ROW_UP));
}

/* Advance velocities and roll by a substep h, and their rows of M (see car_move()) by the
 * chain rule. The yaw rate comes first, so that the velocities use its value at mid-step.
 *
 * The slip angles at mid-step, which determine the forces f, were computed with the
 * velocities at the start of the substep. This function corrects f for the change of the
 * velocities until mid-step. Without the correction the error would be of first order in
 * the substep if the slip angles relax in less than a substep.
 *   Given:    f       forces at mid-step, without this correction
 *             follow  [s/m] -(d slip angle at mid-step)/(d lateral speed of the axle):
 *                     the result of move_slip_angles() for half a substep, divided by the
 *                     speed of the car
 *   Updated:  x, M */
static void move_velocities(const tse_car *c, tse_real x[TSE_VALUES], const forces *f, tse_real follow,
    tse_real h, tse_short M[MOTION][PLACES])
{
  const tse_real half = r_mul(TSE_R(0.5), h), level = TSE_R(1) - x[LEAN],
                 swing = compute_roll_swing(c, x, f->y);
  const tse_real w2 = r_mul(c->roll_omega, c->roll_omega),
                 drag = r_mul(TSE_R(2), r_mul(c->roll_damping, c->roll_omega));
  const tse_real vx = x[VX], r = x[YAW] + r_mul(half, f->yaw),
                 pull = f->y - r_mul(level, r_mul(vx, r)) + x[GY] + r_mul(c->roll_coupling, swing);
  const tse_real lag = r_mul(follow, half), front = r_mul(lag, pull + r_mul(c->lf, f->yaw)),
                 rear = r_mul(lag, pull - r_mul(c->lr, f->yaw));
  const tse_real across_rate = pull - r_mul(f->by_y[AF], front) - r_mul(f->by_y[AR], rear),
                 vy = x[VY] + r_mul(half, across_rate);
  /* rows of M: v_x, v_y, r, slip angles front and rear, phi, phi' */
  tse_short *const mx = M[VX], *const my = M[VY], *const mr = M[YAW], *const mf = M[AF], *const mb = M[AR],
                   *const mp = M[HAS_ROLL ? (int)PHI : (int)VX],
                   *const mq = M[HAS_ROLL ? (int)DPHI : (int)VX];
  /* x_..: derivatives of f->x with respect to v_x, front and rear slip angle. y_.. and
   * r_..: derivatives of f->y and f->yaw with respect to front and rear slip angle */
  const r_coefficient x_v = r_coef(f->by_x[VX]), x_f = r_coef(f->by_x[AF]), x_b = r_coef(f->by_x[AR]),
                      y_f = r_coef(f->by_y[AF]), y_b = r_coef(f->by_y[AR]);
  const r_coefficient r_f = r_coef(f->by_yaw[AF]), r_b = r_coef(f->by_yaw[AR]), ahead = r_coef(vx),
                      across = r_coef(vy), turn = r_coef(r);
  const r_coefficient flat = r_coef(level), stiff = r_coef(w2), damp = r_coef(drag),
                      couple = r_coef(c->roll_coupling);
  const r_factored roll_follow = r_factor(c->roll_gain, ROW_UP), step = r_factor(h, ROW_UP),
                   half_step = r_factor(half, ROW_UP), step_on = r_factor(h, 0);
  const tse_short one = r_short_scaled(TSE_R(1), ROW_UP);
  x[VX] = vx + r_mul(h, f->x + r_mul(vy, r) - x[GX]);
  x[VY] += r_mul(h, across_rate);
  x[YAW] += r_mul(h, f->yaw - r_mul(f->by_yaw[AF], front) - r_mul(f->by_yaw[AR], rear));
  x[DPHI] += r_mul(h, swing);
  x[PHI] += r_mul(h, x[DPHI]);
  for (int j = 0; j < COLUMNS; j++) {
    if (!moves_with(j)) continue;
    const tse_short x_slope = mx[j];
    r_total gx = r_plus(r_plus(r_product(x_v, x_slope), x_f, mf[j]), x_b, mb[j]);
    r_total gy = r_plus(r_product(y_f, mf[j]), y_b, mb[j]), gr = r_plus(r_product(r_f, mf[j]), r_b, mb[j]);
    if (j >= MOTION) {
      gx = r_plus(gx, r_coef(f->by_x[j]), one);
      gy = r_plus(gy, r_coef(f->by_y[j]), one);
      gr = r_plus(gr, r_coef(f->by_yaw[j]), one);
    }
    const tse_short yaw_rate_slope = r_end_rate(gr), middle = r_plus_times(mr[j], half_step, yaw_rate_slope);
    const tse_short side = r_end_rate(gy),
                    turned = r_end_rate(r_plus(r_product(ahead, middle), turn, x_slope));
    mx[j] = r_plus_times(x_slope, step, r_end_rate(r_plus(r_plus(gx, across, middle), turn, my[j])));
    mr[j] = r_plus_times(mr[j], step, yaw_rate_slope);
    if (!HAS_ROLL) my[j] = r_plus_times(my[j], step, r_end(r_minus(r_start(side), flat, turned)));
    if (!HAS_ROLL) continue;
    const tse_short swings = r_end_rate(
        r_minus(r_product(stiff, r_plus_times(-mp[j], roll_follow, side)), damp, mq[j]));
    my[j] = r_plus_times(my[j], step, r_end(r_plus(r_minus(r_start(side), flat, turned), couple, swings)));
    mq[j] = r_plus_times(mq[j], step, swings);
    mp[j] = r_plus_times(mp[j], step_on, mq[j]);
  }
  add_slope(mx, GX, -h);
  add_slope(my, GY, h);
  add_slope(my, LEAN, r_mul(h, r_mul(vx, r)));
}

/* Advance the slip angles and their partial derivatives M by h. Velocities and roll are
 * constant, with their values at mid-step. The steering angle is a ramp. It is replaced
 * by the constant angle that gives nearly the same slip angle at the end. If the
 * relaxation takes much longer than h, this is the angle in the middle of the ramp. If it
 * takes much less time than h, this is the angle at the end of the ramp.
 *   Given:     side  [m/s2] lateral force of the front axle
 *              from  [rad] steering angle at the start of h, after its latency
 *              rate  [rad/s] rate of the steering angle
 *   Updated:   x, M
 *   Returned:  [1] share by which the slip angles have approached the kinematic slip
 *              angles: 0 not at all, 1 completely */
static tse_real move_slip_angles(const tse_car *c, tse_real x[TSE_VALUES], tse_real side, tse_real from,
    tse_real rate, tse_real h, tse_short M[MOTION][PLACES])
{
  const tse_real turn = r_div(r_mul(h, rolling_speed(x[VX])), c->relaxation), kept = exponential(-turn),
                 covered = TSE_R(1) - kept;
  const kinematic kf = compute_kinematic_angle(x[VY] + r_mul(c->lf, x[YAW]), x[VX]),
                  kr = compute_kinematic_angle(x[VY] - r_mul(c->lr, x[YAW]), x[VX]);
  const tse_real steer = from + r_mul(r_mul(h, rate), r_div(turn + TSE_R(3), turn + TSE_R(6)));
  const tse_real d = r_mul(TSE_R(1) + x[GAIN], steer) + x[STEER_OFFSET] - r_mul(c->compliance, side);
  const tse_real gap_front = d + kf.a - x[AF], gap_rear = kr.a + r_mul(c->roll_steer, x[PHI]) - x[AR];
  const tse_real by_length = -r_div(r_mul(kept, turn), c->relaxation);
  const tse_short *const mx = M[VX], *const my = M[VY], *const mr = M[YAW],
                         *const mp = M[HAS_ROLL ? (int)PHI : (int)VX];
  tse_short *const mf = M[AF], *const mb = M[AR];
  const r_coefficient f_side = r_coef(kf.by_side), f_ahead = r_coef(kf.by_v), r_side = r_coef(kr.by_side),
                      r_ahead = r_coef(kr.by_v);
  const r_coefficient to_axle = r_coef(c->lf), from_axle = r_coef(c->lr), roll = r_coef(c->roll_steer),
                      stay = r_coef(kept), go = r_coef(covered);
  x[AF] += r_mul(covered, gap_front);
  x[AR] += r_mul(covered, gap_rear);
  for (int j = 0; j < COLUMNS; j++) {
    if (!moves_with(j)) continue;
    const tse_short front = r_end(
        r_plus(r_product(f_side, r_end(r_plus(r_start(my[j]), to_axle, mr[j]))), f_ahead, mx[j]));
    const r_total back = r_plus(
        r_product(r_side, r_end(r_minus(r_start(my[j]), from_axle, mr[j]))), r_ahead, mx[j]);
    const tse_short rear = r_end(HAS_ROLL ? r_plus(back, roll, mp[j]) : back);
    mf[j] = r_end(r_plus(r_product(stay, mf[j]), go, front));
    mb[j] = r_end(r_plus(r_product(stay, mb[j]), go, rear));
  }
  add_slope(mf, STEER_OFFSET, covered);
  add_slope(mf, GAIN, r_mul(covered, steer));
  add_slope(mf, LATE, -r_mul(r_mul(covered, TSE_R(1) + x[GAIN]), rate));
  add_slope(mf, STATES + CONSIDER_CENTRE, r_mul(covered, r_mul(kf.by_side, x[YAW])));
  add_slope(mb, STATES + CONSIDER_CENTRE, r_mul(covered, r_mul(kr.by_side, x[YAW])));
  add_slope(mf, STATES + CONSIDER_RELAXATION_FRONT, r_mul(by_length, gap_front));
  add_slope(mb, STATES + CONSIDER_RELAXATION_REAR, r_mul(by_length, gap_rear));
  add_slope(mb, STATES + CONSIDER_ROLL_STEER, r_mul(covered, x[PHI]));
  return covered;
}

/* The method is Strang splitting (SIAM J. Numer. Anal. 5 (1968) 506). At the start the
 * slip angles advance by half a substep. Then velocities and slip angles advance
 * alternately, by a whole substep each. The last step of the slip angles is again half a
 * substep. The velocities advance with the slip angles at mid-step, and the slip angles
 * with the velocities at mid-step. The error is therefore of second order in the
 * substep. */
void car_move(const tse_car *c, tse_real x[TSE_VALUES], steering u, tse_short M[MOTION][PLACES])
{
  int32_t steps = -r_floor_to_int(-r_div(u.dt, MAX_SUBSTEP));
  steps = steps < 1 ? 1 : steps > TSE_SUBSTEPS ? TSE_SUBSTEPS : steps;
  const tse_real part = r_div(TSE_R(1), r_from_int(steps)), h = r_mul(u.dt, part),
                 half = r_mul(TSE_R(0.5), h);
  const tse_real rate = r_div(u.to - u.from, u.dt);
  for (int i = 0; i < MOTION; i++)
    for (int j = 0; j < COLUMNS; j++) M[i][j] = r_short_scaled(i == j ? TSE_R(1) : TSE_R(0), ROW_UP);
  tse_real steer = u.from - r_mul(x[LATE], rate),
           side = c->compliance > TSE_R(0) ? compute_tyres(c, x).y_front.f : TSE_R(0), follow = TSE_R(0);
  for (int32_t n = 0; n <= steps; n++) {
    const tse_real length = n > 0 && n < steps ? h : half,
                   follows = move_slip_angles(c, x, side, steer, rate, length, M);
    forces f;
    if (n == steps) break;
    if (n == 0) follow = r_div(follows, rolling_speed(x[VX]));
    car_forces(c, x, u, r_mul(part, r_from_int(n) + TSE_R(0.5)), &f);
    move_velocities(c, x, &f, follow, h, M);
    side = f.side;
    steer += r_mul(length, rate);
  }
}

void car_rates(
    const tse_car *c, const tse_real x[TSE_VALUES], const forces *f, tse_real rate[3], tse_real by[3][PLACES])
{
  const tse_real vx = x[VX], vy = x[VY], r = x[YAW], level = TSE_R(1) - x[LEAN];
  const tse_real w2 = r_mul(c->roll_omega, c->roll_omega),
                 drag = r_mul(TSE_R(2), r_mul(c->roll_damping, c->roll_omega));
  const tse_real swing = compute_roll_swing(c, x, f->y);
  /* derivative of rate[1] with respect to f->y */
  const tse_real gain_y = TSE_R(1) + r_mul(c->roll_coupling, r_mul(w2, c->roll_gain));
  rate[0] = f->x + r_mul(vy, r) - x[GX];
  rate[1] = f->y - r_mul(level, r_mul(vx, r)) + x[GY] + r_mul(c->roll_coupling, swing);
  rate[2] = f->yaw;
  for (int j = 0; j < PLACES; j++) {
    by[0][j] = f->by_x[j];
    by[1][j] = r_mul(gain_y, f->by_y[j]);
    by[2][j] = f->by_yaw[j];
  }
  by[0][VY] += r;
  by[0][YAW] += vy;
  by[0][GX] -= TSE_R(1);
  by[1][VX] -= r_mul(level, r);
  by[1][YAW] -= r_mul(level, vx);
  by[1][GY] += TSE_R(1);
  by[1][LEAN] += r_mul(vx, r);
  by[1][PHI] -= r_mul(c->roll_coupling, w2);
  by[1][DPHI] -= r_mul(c->roll_coupling, drag);
}

tse_real car_pitch(const tse_car *c, tse_real pitch[2], tse_real ax, tse_real dt)
{
  mode_step(pitch, c->pitch_frequency, c->pitch_damping, ax, ax, dt);
  return pitch_read(c, pitch, ax);
}

/* Predict the readings of accelerometers and gyro, at the position and in the axes of the
 * IMU. Roll and pitch add a component of gravity. Away from the centre of gravity the IMU
 * also measures accelerations due to yaw rate and yaw acceleration.
 *   Returned:  rows ACCEL_X, ACCEL_Y and YAW_RATE of z and H */
static void predict_imu(const tse_car *c, const tse_real x[TSE_VALUES], const forces *f, tse_real pitch,
    tse_real z[TSE_SENSORS], tse_real H[TSE_SENSORS][PLACES])
{
  const tse_real r = x[YAW], lx = c->lever_x, ly = c->lever_y;
  const tse_real w2 = r_mul(c->roll_omega, c->roll_omega),
                 drag = r_mul(TSE_R(2), r_mul(c->roll_damping, c->roll_omega));
  const planar at_imu = compute_force_at(f->x, f->y, lx, ly, r, f->yaw);
  const tse_real imu_x = at_imu.x + pitch;
  const tse_real imu_y = at_imu.y + r_mul(c->roll_leak, x[PHI])
      - r_mul(c->roll_height, compute_roll_swing(c, x, f->y));
  const planar read = turn_axes(imu_x, imu_y, c->mount_sin, c->mount_cos);
  /* derivatives of imu_y with respect to f->y, and of imu_x with respect to f->x */
  const tse_real gain_y = TSE_R(1) - r_mul(c->roll_height, r_mul(w2, c->roll_gain)),
                 gain_x = TSE_R(1) + c->pitch_leak;
  z[ACCEL_X] = r_mul(c->scale_x, read.x) + x[BX];
  z[ACCEL_Y] = r_mul(c->scale_y, read.y) + x[BY];
  z[YAW_RATE] = r_mul(c->scale_r, r) + x[BR];
  for (int j = 0; j < COLUMNS; j++) {
    tse_real hx = r_mul(gain_x, f->by_x[j]) - r_mul(ly, f->by_yaw[j]),
             hy = r_mul(gain_y, f->by_y[j]) + r_mul(lx, f->by_yaw[j]);
    if (j == YAW) {
      hx -= r_mul(TSE_R(2), r_mul(lx, r));
      hy -= r_mul(TSE_R(2), r_mul(ly, r));
    } else if (j == PHI) hy += c->roll_leak + r_mul(c->roll_height, w2);
    else if (j == DPHI) hy += r_mul(c->roll_height, drag);
    const planar h = turn_axes(hx, hy, c->mount_sin, c->mount_cos);
    H[ACCEL_X][j] = r_mul(c->scale_x, h.x);
    H[ACCEL_Y][j] = r_mul(c->scale_y, h.y);
    H[YAW_RATE][j] = TSE_R(0);
  }
  for (int j = COLUMNS; j < PLACES; j++) H[ACCEL_X][j] = H[ACCEL_Y][j] = H[YAW_RATE][j] = TSE_R(0);
  H[ACCEL_X][BX] = H[ACCEL_Y][BY] = H[YAW_RATE][BR] = TSE_R(1);
  H[YAW_RATE][YAW] = c->scale_r;
}

/* Predict the wheel speeds. Load transfer to the rear axle reduces its rolling radius and
 * increases that of the front axle. This changes the measured speed of a freely rolling
 * axle, and the apparent slip of a driven axle.
 *   Returned:  rows WHEEL_FRONT and WHEEL_REAR of z and H */
static void predict_wheels(const tse_car *c, const tse_real x[TSE_VALUES], const forces *f,
    tse_real z[TSE_SENSORS], tse_real H[TSE_SENSORS][PLACES])
{
  const tse_real r = x[YAW], loss_front = r_mul(RADIUS_LOSS, c->height_front),
                 loss_rear = r_mul(RADIUS_LOSS, c->height_rear);
  /* wheel.y is the derivative of wheel.x with respect to the road-wheel angle d */
  const planar wheel = turn_axes(x[VX], x[VY] + r_mul(c->lf, r), f->sin_d, f->cos_d);
  const tse_real along = wheel.x, radius = TSE_R(1) + x[RAD];
  const tse_real turns_front = TSE_R(1) - r_mul(loss_front, f->x),
                 turns_rear = TSE_R(1) + r_mul(loss_rear, f->x);
  const tse_real forward = r_mul(TSE_R(1) + x[SF], radius), sideways = r_mul(forward, f->sin_d),
                 by_d = r_mul(forward, wheel.y);
  tse_real *const front = H[WHEEL_FRONT], *const rear = H[WHEEL_REAR];
  z[WHEEL_FRONT] = r_mul(r_mul(r_mul(along, TSE_R(1) + x[SF]), radius), turns_front);
  z[WHEEL_REAR] = r_mul(r_mul(x[VX], TSE_R(1) + x[SR]), turns_rear);
  for (int j = 0; j < COLUMNS; j++) {
    front[j] = -r_mul(r_mul(along, loss_front), f->by_x[j]);
    rear[j] = r_mul(r_mul(x[VX], loss_rear), f->by_x[j]);
  }
  for (int j = COLUMNS; j < PLACES; j++) front[j] = rear[j] = TSE_R(0);
  front[VX] += r_mul(forward, f->cos_d);
  front[VY] += sideways;
  front[YAW] += r_mul(c->lf, sideways);
  front[SF] += r_mul(along, radius);
  front[STEER_OFFSET] += by_d;
  front[GAIN] += r_mul(by_d, f->steer - r_mul(x[LATE], f->rate));
  front[LATE] -= r_mul(r_mul(by_d, TSE_R(1) + x[GAIN]), f->rate);
  front[RAD] += r_mul(along, TSE_R(1) + x[SF]);
  front[STATES + CONSIDER_CENTRE] += r_mul(sideways, r);
  rear[VX] += TSE_R(1) + x[SR];
  rear[SR] += x[VX];
}

void car_measure(const tse_car *c, const tse_real x[TSE_VALUES], const forces *f, tse_real pitch,
    tse_real z[TSE_SENSORS], tse_real H[TSE_SENSORS][PLACES])
{
  predict_imu(c, x, f, pitch, z, H);
  predict_wheels(c, x, f, z, H);
}
