/* model/car.c - forces, motion and sensors of the car, and their slopes. Equations: car.h. */
#include "model/car.h"

#define LONGEST TSE_R(0.0055) /* s: a substep; the front axle's slip angle turns by 0.1 of its own frequency in it */
#define GIVE TSE_R(0.005) /* 1: rolling radius that a tyre loses by its static load: 8 % of 20 mm of deflection, over 0.32 m */

/* One direction of a tyre: force, and its slopes over slip (or slip angle), the logarithms of stiffness and grip. */
typedef struct tyre {
  tse_real f, by_slip, by_k, by_mu;
} tyre;

static tyre tyre_of(tse_real k, tse_real limit, tse_real slip, tse_real shape)
{
  const tse_real linear = r_mul(k, slip);
  tse_real slope;
  const tse_real c = tyre_secant(r_div(r_abs(linear), limit), shape, &slope);
  const tyre t = { r_mul(linear, c), r_mul(k, c + slope), r_mul(linear, c + slope), -r_mul(linear, slope) };
  return t;
}

void car_forces(const tse_car *c, const tse_real x[STATES], steering u, tse_real share, forces *f)
{
  const tse_real cx = exponential(x[LCX]), mu = r_mul(c->grip, exponential(x[LMU]));
  /* load goes to the rear with the acceleration: slip stiffness and grip with it in proportion, cornering stiffness less */
  const tse_real drive = tyre_pull(r_mul(cx, r_mul(c->kx_front, x[SF]) + r_mul(c->kx_rear, x[SR]))), shift = r_mul(c->load_gain, drive);
  const tse_real front = r_mul(r_mul(c->ky_front, exponential(x[LCF])), TSE_R(1) - shift);
  const tse_real rear = r_mul(r_mul(c->ky_rear, exponential(x[LCR])), TSE_R(1) + shift);
  const tse_real square = lateral_square(r_mul(TSE_R(0.5), c->side_front + c->side_rear), tyre_pull(r_mul(front, x[AF]) + r_mul(rear, x[AR])));
  const tse_real load_front = TSE_R(1) - r_mul(c->height_front, drive), load_rear = TSE_R(1) + r_mul(c->height_rear, drive);
  const tse_real most_front = r_mul(r_mul(mu, c->load_front), load_front), most_rear = r_mul(r_mul(mu, c->load_rear), load_rear);
  const tyre xf = tyre_of(r_mul(r_mul(cx, c->kx_front), load_front), most_front, x[SF], c->shape);
  const tyre xr = tyre_of(r_mul(r_mul(cx, c->kx_rear), load_rear), most_rear, x[SR], c->shape);
  const tyre yf = tyre_of(r_mul(front, side_left(c->side_front, square)), most_front, x[AF], c->shape);
  const tyre yr = tyre_of(r_mul(rear, side_left(c->side_rear, square)), most_rear, x[AR], c->shape);
  tse_real s, k;
  f->steer = u.from + r_mul(share, u.to - u.from);
  f->rate = r_div(u.to - u.from, u.dt);
  const tse_real d = r_mul(TSE_R(1) + x[GAIN], f->steer - r_mul(x[LATE], f->rate)) + x[OFF] - r_mul(c->compliance, yf.f);
  sin_cos(d, &s, &k);
  f->sin_d = s;
  f->cos_d = k;
  f->side = yf.f;
  /* written -(a - b): gcc 12 fuses it else, see turn_axes() */
  const tse_real ax = -(r_mul(yf.f, s) - r_mul(xf.f, k)), ay = r_mul(yf.f, k) + r_mul(xf.f, s);
  f->x = ax + xr.f - drag_of(c->drag, x[VX]) - rolling_of(c->rolling, x[VX]);
  f->y = ay + yr.f + c->pull_front + c->pull_rear;
  f->yaw = r_mul(c->jf, ay + c->pull_front) - r_mul(c->jr, yr.f + c->pull_rear) - r_mul(c->trail, yf.f + yr.f);
  for (int j = 0; j < COLUMNS; j++) f->by_x[j] = f->by_y[j] = f->by_yaw[j] = TSE_R(0);
  /* by state: forces of the front axle along and across its wheels, of the rear axle; what saturates longitudinally is no sign of the grip */
  const struct {
    int at;
    tse_real x, y, rear_x, rear_y;
  } by[] = {
    { SF, xf.by_slip, TSE_R(0), TSE_R(0), TSE_R(0) }, { AF, TSE_R(0), yf.by_slip, TSE_R(0), TSE_R(0) }, { SR, TSE_R(0), TSE_R(0), xr.by_slip, TSE_R(0) }, { AR, TSE_R(0), TSE_R(0), TSE_R(0), yr.by_slip }, { LCX, xf.by_k, TSE_R(0), xr.by_k, TSE_R(0) }, { LCF, TSE_R(0), yf.by_k, TSE_R(0), TSE_R(0) }, { LCR, TSE_R(0), TSE_R(0), TSE_R(0), yr.by_k }, { LMU, TSE_R(0), yf.by_mu, TSE_R(0), yr.by_mu }
  };
  for (int i = 0; i < (int)(sizeof by / sizeof by[0]); i++) {
    const tse_real y = r_mul(by[i].y, k) + r_mul(by[i].x, s);
    f->by_x[by[i].at] = r_mul(by[i].x, k) - r_mul(by[i].y, s) + by[i].rear_x;
    f->by_y[by[i].at] = y + by[i].rear_y;
    f->by_yaw[by[i].at] = r_mul(c->jf, y) - r_mul(c->trail, by[i].y) - r_mul(c->jr + c->trail, by[i].rear_y);
  }
  f->by_x[VX] = -r_mul(TSE_R(2), r_mul(c->drag, r_abs(x[VX])));
  const tse_real by_d[3] = { TSE_R(1), f->steer - r_mul(x[LATE], f->rate), -r_mul(TSE_R(1) + x[GAIN], f->rate) };
  for (int i = 0; i < 3; i++) { /* forces turn with the wheels */
    f->by_x[OFF + i] = -r_mul(by_d[i], ay);
    f->by_y[OFF + i] = r_mul(by_d[i], ax);
    f->by_yaw[OFF + i] = r_mul(c->jf, r_mul(by_d[i], ax));
  }
  f->by_yaw[BY_INERTIA] = -f->yaw;
  f->by_yaw[BY_CENTRE] = r_mul(c->m_inertia, ay + yr.f);
  f->by_yaw[BY_MOMENT] = -r_mul(c->m_inertia, ay + yr.f);
}

/* Slip angle of an axle that its motion asks for, and its slopes. */
typedef struct kinematic {
  tse_real a, by_side, by_v;
} kinematic;

static kinematic kinematic_of(tse_real side, tse_real vx)
{
  const tse_real v = rolling_speed(vx), over = r_div(TSE_R(1), r_mul(v, v) + r_mul(side, side));
  kinematic k;
  k.a = slip_angle(side, vx);
  k.by_side = -r_mul(v, over);
  k.by_v = vx > LOW_SPEED ? r_mul(side, over) : TSE_R(0);
  return k;
}

static tse_real roll_swing(const tse_car *c, const tse_real x[STATES], tse_real ay)
{
  return mode_swing(x[PHI], x[DPHI], c->roll_rate, c->roll_damping, r_mul(c->roll_gain, ay));
}

/* One substep of h, symplectic: velocities first, then slip angles and roll with them: stable without damping. */
static void substep(const tse_car *c, tse_real x[STATES], steering u, tse_real middle, tse_real end, tse_real h, tse_real M[MOTION][COLUMNS])
{
  forces f;
  car_forces(c, x, u, middle, &f);
  const tse_real vx = x[VX], vy = x[VY], r = x[YAW];
  tse_real *const mx = M[VX], *const my = M[VY], *const mr = M[YAW], *const mf = M[AF], *const mb = M[AR], *const mp = M[PHI], *const mq = M[DPHI];
  const tse_real w2 = r_mul(c->roll_rate, c->roll_rate), drag = r_mul(TSE_R(2), r_mul(c->roll_damping, c->roll_rate));
  x[VX] = vx + r_mul(h, f.x + r_mul(vy, r) - x[GX]);
  const tse_real swing = roll_swing(c, x, f.y), stays_level = TSE_R(1) - x[LEAN];
  x[VY] = vy + r_mul(h, f.y - r_mul(stays_level, r_mul(vx, r)) + x[GY] + r_mul(c->roll_coupling, swing));
  x[YAW] = r + r_mul(h, f.yaw);
  x[DPHI] += r_mul(h, swing);
  x[PHI] += r_mul(h, x[DPHI]);
  const tse_real v = rolling_speed(x[VX]), turn = r_div(r_mul(h, v), c->relaxation), stays = exponential(-turn), g = TSE_R(1) - stays;
  const kinematic kf = kinematic_of(x[VY] + r_mul(c->lf, x[YAW]), x[VX]), kr = kinematic_of(x[VY] - r_mul(c->lr, x[YAW]), x[VX]);
  const tse_real steer = u.from + r_mul(end, u.to - u.from) - r_mul(x[LATE], f.rate);
  const tse_real d = r_mul(TSE_R(1) + x[GAIN], steer) + x[OFF] - r_mul(c->compliance, f.side);
  const tse_real to_front = d + kf.a - x[AF], to_rear = kr.a + r_mul(c->roll_steer, x[PHI]) - x[AR];
  x[AF] += r_mul(g, to_front);
  x[AR] += r_mul(g, to_rear);

  for (int j = 0; j < COLUMNS; j++) { /* slopes, by the chain rule in the same order */
    const tse_real direct = j >= MOTION ? TSE_R(1) : TSE_R(0);
    const tse_real gx = r_mul(f.by_x[VX], mx[j]) + r_mul(f.by_x[AF], mf[j]) + r_mul(f.by_x[AR], mb[j]) + r_mul(direct, f.by_x[j]);
    const tse_real gy = r_mul(f.by_y[AF], mf[j]) + r_mul(f.by_y[AR], mb[j]) + r_mul(direct, f.by_y[j]);
    const tse_real gr = r_mul(f.by_yaw[AF], mf[j]) + r_mul(f.by_yaw[AR], mb[j]) + r_mul(direct, f.by_yaw[j]);
    const tse_real was = mx[j];
    mx[j] += r_mul(h, gx + r_mul(vy, mr[j]) + r_mul(r, my[j]));
    const tse_real swings = r_mul(w2, r_mul(c->roll_gain, gy) - mp[j]) - r_mul(drag, mq[j]);
    my[j] += r_mul(h, gy - r_mul(stays_level, r_mul(vx, mr[j]) + r_mul(r, was)) + r_mul(c->roll_coupling, swings));
    mr[j] += r_mul(h, gr);
    mq[j] += r_mul(h, swings);
    mp[j] += r_mul(h, mq[j]);
  }
  mx[GX] -= h;
  my[GY] += h;
  my[LEAN] += r_mul(h, r_mul(vx, r));
  for (int j = 0; j < COLUMNS; j++) {
    const tse_real front = r_mul(kf.by_side, my[j] + r_mul(c->lf, mr[j])) + r_mul(kf.by_v, mx[j]);
    const tse_real rear = r_mul(kr.by_side, my[j] - r_mul(c->lr, mr[j])) + r_mul(kr.by_v, mx[j]) + r_mul(c->roll_steer, mp[j]);
    mf[j] = r_mul(stays, mf[j]) + r_mul(g, front);
    mb[j] = r_mul(stays, mb[j]) + r_mul(g, rear);
  }
  mf[OFF] += g;
  mf[GAIN] += r_mul(g, steer);
  mf[LATE] -= r_mul(r_mul(g, TSE_R(1) + x[GAIN]), f.rate);
  mf[BY_CENTRE] += r_mul(g, r_mul(kf.by_side, x[YAW]));
  mb[BY_CENTRE] += r_mul(g, r_mul(kr.by_side, x[YAW]));
  const tse_real by_length = -r_div(r_mul(stays, turn), c->relaxation);
  mf[BY_LENGTH_FRONT] += r_mul(by_length, to_front);
  mb[BY_LENGTH_REAR] += r_mul(by_length, to_rear);
  mb[BY_ROLL_STEER] += r_mul(g, x[PHI]);
}

void car_move(const tse_car *c, tse_real x[STATES], steering u, tse_real M[MOTION][COLUMNS])
{
  int32_t steps = -r_floor_to_int(-r_div(u.dt, LONGEST));
  steps = steps < 1 ? 1 : steps > TSE_SUBSTEPS ? TSE_SUBSTEPS
                                               : steps;
  const tse_real part = r_div(TSE_R(1), r_from_int(steps)), h = r_mul(u.dt, part);
  for (int i = 0; i < MOTION; i++)
    for (int j = 0; j < COLUMNS; j++) M[i][j] = i == j ? TSE_R(1) : TSE_R(0);
  for (int32_t k = 0; k < steps; k++) {
    const tse_real from = r_mul(part, r_from_int(k));
    substep(c, x, u, from + r_mul(TSE_R(0.5), part), from + part, h, M);
  }
}

void car_rates(const tse_car *c, const tse_real x[STATES], const forces *f, tse_real rate[3], tse_real by[3][COLUMNS])
{
  const tse_real vx = x[VX], vy = x[VY], r = x[YAW], level = TSE_R(1) - x[LEAN];
  const tse_real w2 = r_mul(c->roll_rate, c->roll_rate), drag = r_mul(TSE_R(2), r_mul(c->roll_damping, c->roll_rate));
  const tse_real swing = roll_swing(c, x, f->y);
  const tse_real own = TSE_R(1) + r_mul(c->roll_coupling, r_mul(w2, c->roll_gain)); /* slope over f->y */
  rate[0] = f->x + r_mul(vy, r) - x[GX];
  rate[1] = f->y - r_mul(level, r_mul(vx, r)) + x[GY] + r_mul(c->roll_coupling, swing);
  rate[2] = f->yaw;
  for (int j = 0; j < COLUMNS; j++) {
    by[0][j] = f->by_x[j];
    by[1][j] = r_mul(own, f->by_y[j]);
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

void car_measure(const tse_car *c, const tse_real x[STATES], const forces *f, tse_real pitch, tse_real z[TSE_SENSORS], tse_real H[TSE_SENSORS][COLUMNS])
{
  const tse_real r = x[YAW], cm = c->mount_cos, sm = c->mount_sin, lx = c->lever_x, ly = c->lever_y;
  const tse_real w2 = r_mul(c->roll_rate, c->roll_rate), drag = r_mul(TSE_R(2), r_mul(c->roll_damping, c->roll_rate));
  /* at the place of the IMU, in the axes of the car; gravity leaks in as body rolls and pitches, and an IMU above the roll axis swings */
  const planar there = force_at(f->x, f->y, lx, ly, r, f->yaw);
  const tse_real here_x = there.x + pitch;
  const tse_real here_y = there.y + r_mul(c->roll_leak, x[PHI]) - r_mul(c->roll_height, roll_swing(c, x, f->y));
  const planar read = turn_axes(here_x, here_y, sm, cm);
  const tse_real own_y = TSE_R(1) - r_mul(c->roll_height, r_mul(w2, c->roll_gain)), own_x = TSE_R(1) + c->pitch_leak;
  const planar wheel = turn_axes(x[VX], x[VY] + r_mul(c->lf, r), f->sin_d, f->cos_d); /* across: slope of what is along over d */
  const tse_real along = wheel.x;
  const tse_real rolls = TSE_R(1) + x[RAD];
  z[0] = r_mul(c->scale_x, read.x) + x[BX];
  z[1] = r_mul(c->scale_y, read.y) + x[BY];
  z[2] = r_mul(c->scale_r, r) + x[BR];
  /* load that goes to the rear takes rolling radius there and gives it in front: the free axle lies about the speed, the driven one about its slip */
  const tse_real give_front = r_mul(GIVE, c->height_front), give_rear = r_mul(GIVE, c->height_rear);
  const tse_real turns_front = TSE_R(1) - r_mul(give_front, f->x), turns_rear = TSE_R(1) + r_mul(give_rear, f->x);
  z[3] = r_mul(r_mul(r_mul(along, TSE_R(1) + x[SF]), rolls), turns_front);
  z[4] = r_mul(r_mul(x[VX], TSE_R(1) + x[SR]), turns_rear);
  for (int j = 0; j < COLUMNS; j++) {
    tse_real hx = r_mul(own_x, f->by_x[j]) - r_mul(ly, f->by_yaw[j]), hy = r_mul(own_y, f->by_y[j]) + r_mul(lx, f->by_yaw[j]);
    if (j == YAW) {
      hx -= r_mul(TSE_R(2), r_mul(lx, r));
      hy -= r_mul(TSE_R(2), r_mul(ly, r));
    } else if (j == PHI) hy += c->roll_leak + r_mul(c->roll_height, w2);
    else if (j == DPHI) hy += r_mul(c->roll_height, drag);
    const planar h = turn_axes(hx, hy, sm, cm);
    H[0][j] = r_mul(c->scale_x, h.x);
    H[1][j] = r_mul(c->scale_y, h.y);
    H[2][j] = TSE_R(0);
    H[3][j] = -r_mul(r_mul(along, give_front), f->by_x[j]);
    H[4][j] = r_mul(r_mul(x[VX], give_rear), f->by_x[j]);
  }
  const tse_real forward = r_mul(TSE_R(1) + x[SF], rolls), sideways = r_mul(forward, f->sin_d), by_d = r_mul(forward, wheel.y);
  H[0][BX] = H[1][BY] = H[2][BR] = TSE_R(1);
  H[2][YAW] = c->scale_r;
  H[3][VX] += r_mul(forward, f->cos_d);
  H[3][VY] += sideways;
  H[3][YAW] += r_mul(c->lf, sideways);
  H[3][SF] += r_mul(along, rolls);
  H[3][OFF] += by_d;
  H[3][GAIN] += r_mul(by_d, f->steer - r_mul(x[LATE], f->rate));
  H[3][LATE] -= r_mul(r_mul(by_d, TSE_R(1) + x[GAIN]), f->rate);
  H[3][RAD] += r_mul(along, TSE_R(1) + x[SF]);
  H[3][BY_CENTRE] += r_mul(sideways, r);
  H[4][VX] += TSE_R(1) + x[SR];
  H[4][SR] += x[VX];
}
