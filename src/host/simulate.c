/* host/simulate.c - the truth for studies: the estimator's vehicle with wheels that turn, noise that is known. */
#include "tse/simulate.h"

#include <stddef.h>

#include "tables/rows.h"
#include "tables/sim.h"
#include "number/random.h"
#include "host/sound.h"
#include "model/effects.h"

/* Brakes oppose rotation; between -BRAKE_GRIP and BRAKE_GRIP rad/s their torque rises linearly, so that they hold a
 * standing wheel without a discontinuity. */
#define BRAKE_GRIP TSE_R(0.2)
/* Beyond these there is no car any more: the settings and what the driver does have led out of what the model is good for, and
 * soon to numbers that are none. Far above what torques within their range do in a minute to a car that can be built. */
#define LOST_SPEED TSE_R(1000)     /* m/s */
#define LOST_YAW_RATE TSE_R(200)   /* rad/s */
#define LOST_WHEEL TSE_R(1e7)      /* rad/s: on ice the largest torque spins the lightest wheels up by 2e6 within a second */
#define JUMP TSE_R(1e-6) /* s in which a steering angle that was set anew since the last row is reached */

void tse_sim_config_default(tse_sim_config *s)
{
  if (!s) return;
  set_defaults(s, sim_reals, SIM_REALS, sim_wholes, SIM_WHOLES);
}

tse_status tse_sim_config_check(const tse_sim_config *s, const char **wrong)
{
  if (!s) return TSE_E_NULL;
  const char *const name = first_outside(s, sim_reals, SIM_REALS, sim_wholes, SIM_WHOLES);
  if (name) {
    if (wrong) *wrong = name;
    return TSE_E_CONFIG;
  }
  return TSE_OK;
}

tse_status tse_sim_reset(tse_sim *sim, const tse_config *c, const tse_sim_config *s, const char **wrong)
{
  tse_params params;
  if (!sim) return TSE_E_NULL;
  tse_status status = tse_prepare(c, &params, wrong);
  if (status >= 0) status = tse_sim_config_check(s, wrong);
  if (status < 0) return status;
  memset(sim, 0, sizeof *sim);
  sim->config = *s;
  memcpy(&sim->params, &params, sizeof params); /* padding too: tse_sim_check() compares bytes */
  sim->params.seed[0] = (uint32_t)s->seed;
  sim->params.seed[1] = 0x73696d75u; /* the estimator's numbers come from another key */
  sim->x[0] = r_from_setting(s->speed);
  sim->x[1] = r_from_setting(s->vel_y);
  sim->x[3] = r_div(sim->x[0], params.radius_front);
  sim->x[4] = r_div(sim->x[0], params.radius_rear);
  sim->bias[0] = r_from_setting(s->true_bias_accel_x);
  sim->bias[1] = r_from_setting(s->true_bias_accel_y);
  sim->bias[2] = r_from_setting(s->true_bias_yaw_rate);
  return TSE_OK;
}

/* Member by member: bytes between members are whatever their writer left there. Settings of the vehicle: by their fingerprint. */
static int same_settings(const tse_sim *a, const tse_sim *b)
{
  int same = memcmp(&a->params, &b->params, sizeof a->params) == 0;
  const uint8_t *const x = (const uint8_t *)&a->config, *const y = (const uint8_t *)&b->config;
  for (int i = 0; i < SIM_REALS; i++) same = same && memcmp(x + sim_reals[i].at, y + sim_reals[i].at, sizeof(tse_setting)) == 0;
  for (int i = 0; i < SIM_WHOLES; i++) same = same && memcmp(x + sim_wholes[i].at, y + sim_wholes[i].at, sizeof(int32_t)) == 0;
  return same;
}

tse_status tse_sim_check(const tse_sim *sim, const tse_config *c, const tse_sim_config *s)
{
  tse_sim fresh;
  if (!sim || !c || !s) return TSE_E_NULL;
  const tse_status status = tse_sim_reset(&fresh, c, s, NULL);
  if (status < 0) return status;
  int fine = same_settings(&fresh, sim);
  fine = fine && sound_memory(&sim->effects);
  fine = fine && sound_reals(sim->x, 9, -MOST_REAL, MOST_REAL) && sound_reals(sim->bias, 3, -MOST_REAL, MOST_REAL);
  fine = fine && sound_reals(sim->drawn, 3, -MOST_REAL, MOST_REAL) && sound_reals(&sim->steer, 1, -MOST_REAL, MOST_REAL);
  fine = fine && sound_reals(&sim->steer_logged, 1, -MOST_REAL, MOST_REAL) && sound_reals(&sim->last.dt, 1, TSE_R(0), MOST_REAL);
  for (int i = 0; i < SIM_INPUTS; i++) fine = fine && channel_holds(&sim_inputs[i], channel_at(&sim->last, &sim_inputs[i]));
  return fine ? TSE_OK : TSE_E_STATE;
}

typedef struct driver { tse_real steer, drive_front, drive_rear, brake_front, brake_rear; } driver;

/* Between two rows everything that the driver does is linear: a step takes one row; with `hold_inputs` it is held. (Held
 * torques lead the logged wheel speeds, which an estimator can only interpolate, by half a row; where that is unknown it costs 2 % of the
 * longitudinal stiffness.) */
static driver driver_between(const tse_sim_input *a, const tse_sim_input *b, tse_real share)
{
  driver u;
  u.steer = a->steer_angle + r_mul(share, b->steer_angle - a->steer_angle);
  u.drive_front = a->wheel_torque_front + r_mul(share, b->wheel_torque_front - a->wheel_torque_front);
  u.drive_rear = a->wheel_torque_rear + r_mul(share, b->wheel_torque_rear - a->wheel_torque_rear);
  u.brake_front = a->brake_torque_front + r_mul(share, b->brake_torque_front - a->brake_torque_front);
  u.brake_rear = a->brake_torque_rear + r_mul(share, b->brake_torque_rear - a->brake_torque_rear);
  return u;
}

static tse_real brake(tse_real torque, tse_real omega)
{
  return r_mul(torque, r_clamp(r_div(omega, BRAKE_GRIP), TSE_R(-1), TSE_R(1)));
}

/* Slope of brake() over omega; where the brake slips it is zero. The secant never is. */
static tse_real brake_slope(tse_real torque, tse_real omega, int secant)
{
  if (secant) return r_div(torque, r_max(r_abs(omega), BRAKE_GRIP));
  return r_abs(omega) < BRAKE_GRIP ? r_div(torque, BRAKE_GRIP) : TSE_R(0);
}

/* Secant of a tyre that saturates along and across, over its stiffness: a brush. `limit` is friction times axle load, `fx`, `fy` are what
 * linear tyres would hold (all over mass). */
static tse_real grip(tse_real limit, tse_real fx, tse_real fy)
{
  tse_real slope;
  return limit > TSE_R(0) ? tyre_secant(r_div(r_sqrt(r_mul(fx, fx) + r_mul(fy, fy)), limit), TSE_R(0), &slope) : TSE_R(1);
}

static tse_real friction_now(const tse_sim *sim)
{
  return sim->last.road_friction > TSE_R(0) ? sim->last.road_friction : r_from_setting(sim->config.friction);
}

/* The stiffness that the tyres of each axle show at these slips; as it was, bit for bit, without friction limit.   Updated: pt->k */
static void lose_grip(const tse_sim *sim, point *pt)
{
  const tse_car *const c = &sim->params.car;
  const tse_real mu = friction_now(sim);
  const tse_real front = grip(r_mul(mu, c->load_front), r_mul(pt->k.x_front, pt->s.s_front), r_mul(pt->k.y_front, pt->s.a_front));
  const tse_real rear = grip(r_mul(mu, c->load_rear), r_mul(pt->k.x_rear, pt->s.s_rear), r_mul(pt->k.y_rear, pt->s.a_rear));
  pt->k.x_front = r_mul(pt->k.x_front, front);
  pt->k.y_front = r_mul(pt->k.y_front, front);
  pt->k.x_rear = r_mul(pt->k.x_rear, rear);
  pt->k.y_rear = r_mul(pt->k.y_rear, rear);
}

enum { STATES = 9 }; /* vel_x, vel_y, yaw rate, wheel speeds front and rear, the slips that tyres hold */

typedef struct car { /* what one substep needs beside the state */
  const tse_sim *sim;
  const tse_params *p;
  stiffness k;
  tse_real mass, inertia_front, inertia_rear;
} car;

static inputs inputs_of(const car *c, const tse_real x[STATES], tse_real steer)
{
  inputs u;
  u.steer = steer;
  u.v_front = r_mul(c->p->radius_front, x[3]);
  u.v_rear = r_mul(c->p->radius_rear, x[4]);
  return u;
}

/* The car at a state, `ahead` of the effects' memory, with all effects and with tyres that saturate. */
static point point_at(const car *c, const tse_real x[STATES], tse_real steer, tse_real ahead)
{
  point pt;
  memset(&pt, 0, sizeof pt);
  pt.p = c->p;
  pt.m = &c->sim->effects;
  pt.vx = x[0];
  pt.vy = x[1];
  pt.r = x[2];
  pt.u = inputs_of(c, x, steer);
  pt.ahead = ahead;
  pt.k = c->k;
  effects_slips(&x[5], &pt);
  effects_stiffness(&pt);
  lose_grip(c->sim, &pt);
  effects_forces(&pt);
  return pt;
}

/* (1), (2), (7) without its sampling, and the wheels: J omega' = T - T_brake - R Fx. */
static void derivative(const car *c, const tse_real x[STATES], driver d, tse_real ahead, tse_real dx[STATES])
{
  const point pt = point_at(c, x, d.steer, ahead);
  tse_real rate[4];
  effects_lag_rates(&c->p->effects, &pt, rate);
  dx[0] = pt.force.x + pt.gravity_x + r_mul(x[1], x[2]);
  dx[1] = pt.force.y + pt.gravity_y - r_mul(x[0], x[2]);
  dx[2] = pt.force.yaw;
  dx[3] = r_div(d.drive_front - brake(d.brake_front, x[3]) - r_mul(c->p->radius_front, r_mul(c->mass, pt.fx_front)), c->inertia_front);
  dx[4] = r_div(d.drive_rear - brake(d.brake_rear, x[4]) - r_mul(c->p->radius_rear, r_mul(c->mass, pt.fx_rear)), c->inertia_rear);
  for (int i = 0; i < 4; i++) dx[5 + i] = r_mul(rate[i], pt.target[i] - x[5 + i]);
}

/* What is stiff, and therefore implicit: the arrow (vx; omega_f, omega_r) and the block (vy, r). Tyres that saturate enter
 * by their secant, which overestimates their damping: ROS2 keeps its order with any Jacobian. */
typedef struct solver { tse_real vf, vr, wf, wr, df, dr, schur, slow[4]; lateral_block side; } solver;

static solver wheels_factor(const car *c, const tse_real x[STATES], driver d, tse_real gh, int secant)
{
  const tse_params *const p = c->p;
  const point pt = point_at(c, x, d.steer, TSE_R(0));
  const slips s = pt.s;
  const stiffness k = pt.k;
  tse_real rate[4];
  solver m;
  effects_lag_rates(&p->effects, &pt, rate);
  for (int i = 0; i < 4; i++) m.slow[i] = r_div(TSE_R(1), TSE_R(1) + r_mul(gh, rate[i]));
  /* with D = what slip is taken over: d(Fx/m)/dvx = -k/D, d(Fx/m)/domega = k R/D (where D does not move) */
  const tse_real kf = r_mul(k.x_front, s.inv_front), kr = r_mul(k.x_rear, s.inv_rear);
  m.vf = -r_mul(gh, r_mul(kf, p->radius_front));
  m.vr = -r_mul(gh, r_mul(kr, p->radius_rear));
  m.wf = -r_mul(gh, r_div(r_mul(c->mass, r_mul(p->radius_front, kf)), c->inertia_front));
  m.wr = -r_mul(gh, r_div(r_mul(c->mass, r_mul(p->radius_rear, kr)), c->inertia_rear));
  m.df = TSE_R(1) - r_mul(m.wf, p->radius_front) + r_mul(gh, r_div(brake_slope(d.brake_front, x[3], secant), c->inertia_front));
  m.dr = TSE_R(1) - r_mul(m.wr, p->radius_rear) + r_mul(gh, r_div(brake_slope(d.brake_rear, x[4], secant), c->inertia_rear));
  m.schur = TSE_R(1) + r_mul(gh, kf + kr) - r_div(r_mul(m.vf, m.wf), m.df) - r_div(r_mul(m.vr, m.wr), m.dr);
  m.side = vehicle_block(p, r_mul(k.y_front, s.inv_body), r_mul(k.y_rear, s.inv_body), x[0], gh);
  return m;
}

static void wheels_solve(const solver *m, const tse_real f[STATES], tse_real k[STATES])
{
  for (int i = 5; i < STATES; i++) k[i] = r_mul(f[i], m->slow[i - 5]);
  k[0] = r_div(f[0] - r_div(r_mul(m->vf, f[3]), m->df) - r_div(r_mul(m->vr, f[4]), m->dr), m->schur);
  k[3] = r_div(f[3] - r_mul(m->wf, k[0]), m->df);
  k[4] = r_div(f[4] - r_mul(m->wr, k[0]), m->dr);
  vehicle_solve(&m->side, f[1], f[2], &k[1], &k[2]);
}

/* Could this brake stop the wheel within the substep? Only tyres that saturate let it. */
static int may_lock(const car *c, tse_real torque, tse_real inertia, tse_real omega, tse_real h)
{
  return friction_now(c->sim) > TSE_R(0) && r_mul(h, torque) > r_mul(TSE_R(0.5), r_mul(inertia, r_abs(omega)));
}

/* ROS2 of vehicle.h, with the wheel speeds as states. Its stages would jump over the brake's change of
 * sign where a wheel locks; there implicit Euler takes over: with secants all terms off its diagonal have the sign that
 * keeps a wheel from being braked into reverse, whatever the torque. */
static void wheels_step(const car *c, tse_real x[STATES], driver u0, driver u1, tse_real h)
{
  tse_real f[STATES], k1[STATES], k2[STATES], mid[STATES];
  if (may_lock(c, u1.brake_front, c->inertia_front, x[3], h) || may_lock(c, u1.brake_rear, c->inertia_rear, x[4], h)) {
    const solver euler = wheels_factor(c, x, u1, h, 1);
    derivative(c, x, u1, TSE_R(0), f);
    wheels_solve(&euler, f, k1);
    for (int a = 0; a < STATES; a++) x[a] += r_mul(h, k1[a]);
    return;
  }
  const solver m = wheels_factor(c, x, u0, r_mul(ROS2, h), 0);
  derivative(c, x, u0, TSE_R(0), f);
  wheels_solve(&m, f, k1);
  for (int a = 0; a < STATES; a++) mid[a] = x[a] + r_mul(h, k1[a]);
  derivative(c, mid, u1, h, f);
  for (int a = 0; a < STATES; a++) f[a] = f[a] - k1[a] - k1[a];
  wheels_solve(&m, f, k2);
  for (int a = 0; a < STATES; a++) x[a] += r_mul(h, r_mul(TSE_R(1.5), k1[a]) + r_mul(TSE_R(0.5), k2[a]));
}

static void two_normals(const tse_sim *sim, uint32_t purpose, tse_real *a, tse_real *b)
{
  uint32_t u, v;
  random_words(sim->params.seed, sim->step, purpose, 0, &u, &v);
  random_normal2(u, v, a, b);
}

/* Stiffness for the interval that starts now: mean times (1 + spread n), never below a tenth of the mean. */
static void draw_stiffness(const tse_sim *sim, tse_real road_level, tse_real mean[3], tse_real drawn[3])
{
  const tse_sim_config *const s = &sim->config;
  const tse_real level[3] = { r_from_setting(s->true_cx_front), r_from_setting(s->true_cy_front), r_from_setting(s->true_cy_rear) };
  const tse_real spread[3] = { r_from_setting(s->spread_cx_front), r_from_setting(s->spread_cy_front), r_from_setting(s->spread_cy_rear) };
  tse_real n[4];
  two_normals(sim, RANDOM_SIM_STIFFNESS_A, &n[0], &n[1]);
  two_normals(sim, RANDOM_SIM_STIFFNESS_B, &n[2], &n[3]);
  for (int a = 0; a < 3; a++) {
    mean[a] = r_mul(level[a], road_level);
    drawn[a] = r_mul(mean[a], r_max(TSE_R(1) + r_mul(spread[a], n[a]), TSE_R(0.1)));
  }
}

/* Stiffness over mass as drawn; what does not follow the front still follows the road. */
static stiffness stiffness_now(const tse_sim *sim, tse_real road_level)
{
  const tse_params *const p = &sim->params;
  stiffness k;
  k.x_front = r_mul(p->kx_front, sim->drawn[0]);
  k.x_rear = r_mul(p->kx_rear, road_level + r_mul(p->follow, sim->drawn[0] - road_level));
  k.y_front = r_mul(p->ky_front, sim->drawn[1]);
  k.y_rear = r_mul(p->ky_rear, sim->drawn[2]);
  return k;
}

static tse_status check_input(const tse_sim *sim, const tse_sim_input *u)
{
  if (sim->step > 0 && !(u->dt > TSE_R(0) && u->dt <= TSE_R(1))) return TSE_E_TIME;
  for (int i = 0; i < SIM_INPUTS; i++)
    if (!channel_holds(&sim_inputs[i], channel_at(u, &sim_inputs[i]))) return TSE_E_INPUT;
  return TSE_OK;
}

static car car_of(const tse_sim *sim, stiffness k)
{
  car c;
  c.sim = sim;
  c.p = &sim->params;
  c.k = k;
  c.mass = sim->params.effects.mass;
  c.inertia_front = r_from_setting(sim->config.wheel_inertia_front);
  c.inertia_rear = r_from_setting(sim->config.wheel_inertia_rear);
  return c;
}

/* A steering angle that was set anew since the logged one: the wheels follow. */
static void jump(tse_sim *sim)
{
  if (!(sim->last.steer_angle < sim->steer_logged || sim->last.steer_angle > sim->steer_logged)) return;
  sim->steer = effects_steer(&sim->params.effects, &sim->effects, sim->last.steer_angle, JUMP);
  sim->steer_logged = sim->last.steer_angle;
}

static void advance_to_row(tse_sim *sim, const tse_sim_input *u)
{
  const tse_real longest = r_from_setting(sim->config.substep);
  const int32_t steps = -r_floor_to_int(-r_div(u->dt, longest) + TSE_R(1e-4)); /* 0.01/0.001 are ten, not eleven */
  const tse_real h = r_div(u->dt, r_from_int(steps));
  const car c = car_of(sim, stiffness_now(sim, sim->last.road_level));
  const tse_effects *const e = &c.p->effects;
  tse_sim_input from = sim->last, to = sim->config.hold_inputs ? sim->last : *u;
  jump(sim);
  sim->steer_logged = to.steer_angle;
  from.steer_angle = sim->steer;
  to.steer_angle = sim->steer = effects_steer(e, &sim->effects, to.steer_angle, u->dt);
  for (int32_t i = 0; i < steps; i++) {
    const driver d0 = driver_between(&from, &to, r_div(r_from_int(i), r_from_int(steps)));
    const driver d1 = driver_between(&from, &to, r_div(r_from_int(i + 1), r_from_int(steps)));
    if (!e->mask) wheels_step(&c, sim->x, d0, d1, h);
    else {
      const point a = point_at(&c, sim->x, d0.steer, TSE_R(0));
      wheels_step(&c, sim->x, d0, d1, h);
      const point b = point_at(&c, sim->x, d1.steer, h);
      effects_remember(e, &sim->effects, &a, &b, h);
    }
  }
  sim->last = *u;
  jump(sim);
  const tse_real scale = r_mul(r_from_setting(sim->config.bias_walk), r_sqrt(u->dt));
  tse_real n[4];
  two_normals(sim, RANDOM_SIM_WALK_A, &n[0], &n[1]);
  two_normals(sim, RANDOM_SIM_WALK_B, &n[2], &n[3]);
  for (int a = 0; a < 3; a++) sim->bias[a] += r_mul(r_mul(scale, sim->params.bias_sd_walk[a]), n[a]);
}

/* At the first row everything is at rest: tyres hold the slip that there is, the steering has followed. */
static void settle(tse_sim *sim, const car *c)
{
  point pt;
  sim->steer_logged = sim->last.steer_angle;
  sim->steer = effects_steer(&sim->params.effects, &sim->effects, sim->last.steer_angle, TSE_R(1));
  memset(&pt, 0, sizeof pt);
  pt.vx = sim->x[0];
  pt.vy = sim->x[1];
  pt.r = sim->x[2];
  pt.u = inputs_of(c, sim->x, sim->steer);
  effects_settle(c->p, &sim->effects, c->k, &pt);
  for (int i = 0; i < 4; i++) sim->x[5 + i] = sim->effects.lag[i];
}

/* What the sensors read, without noise and bias. */
static reading observe(tse_sim *sim, const car *c, point *pt, tse_real dt)
{
  if (!sim->effects.settled) settle(sim, c);
  *pt = point_at(c, sim->x, sim->steer, TSE_R(0));
  return effects_sense(pt, &sim->effects, dt);
}

static void log_next(tse_sim *sim, const tse_sim_input *u, tse_sim_output *y)
{
  if (sim->step > 0) advance_to_row(sim, u);
  else sim->last = *u;

  tse_real mean[3], n[6];
  draw_stiffness(sim, u->road_level, mean, sim->drawn);
  const car c = car_of(sim, stiffness_now(sim, u->road_level));
  point pt;
  const reading clean = observe(sim, &c, &pt, u->dt);

  for (uint32_t i = 0; i < 3; i++) two_normals(sim, RANDOM_SIM_NOISE_A + i, &n[2 * i], &n[2 * i + 1]);
  const tse_real noise = r_from_setting(sim->config.noise);
  const tse_real wheel_sd = r_from_setting(sim->config.wheel_speed_sd);
  tse_real measured[3];
  for (int i = 0; i < 3; i++) measured[i] = clean.y[i] + sim->bias[i] + r_mul(r_mul(noise, sim->params.sd[i]), n[i]);

  memset(y, 0, sizeof *y);
  y->row.dt = sim->step > 0 ? u->dt : TSE_R(0);
  y->row.steer_angle = u->steer_angle + r_mul(r_from_setting(sim->config.steer_angle_sd), n[3]);
  y->row.wheel_speed_front = sim->x[3] + r_mul(wheel_sd, n[4]);
  y->row.wheel_speed_rear = sim->x[4] + r_mul(wheel_sd, n[5]);
  y->row.accel_x = measured[0];
  y->row.accel_y = measured[1];
  y->row.yaw_rate = measured[2];
  y->vel_x = sim->x[0];
  y->vel_y = sim->x[1];
  y->yaw_rate = sim->x[2];
  y->accel_x = pt.force.x;
  y->accel_y = pt.force.y;
  y->wheel_speed_front = sim->x[3];
  y->wheel_speed_rear = sim->x[4];
  for (int i = 0; i < 3; i++) {
    y->stiffness[i] = mean[i];
    y->drawn[i] = sim->drawn[i];
    y->bias[i] = sim->bias[i];
  }
  sim->step++;
}

/* Is this still a car? NaN is none. What it leaves is what tse_sim_check() takes. */
static int is_car(const tse_sim *sim, const tse_sim_output *y)
{
  int fine = sound_reals(sim->x, 2, -LOST_SPEED, LOST_SPEED) && sound_reals(&sim->x[2], 1, -LOST_YAW_RATE, LOST_YAW_RATE);
  fine = fine && sound_reals(&sim->x[3], 2, -LOST_WHEEL, LOST_WHEEL) && sound_reals(&sim->x[5], 4, -MOST_REAL, MOST_REAL);
  fine = fine && sound_reals(sim->bias, 3, -MOST_REAL, MOST_REAL) && sound_reals(&sim->steer, 1, -MOST_REAL, MOST_REAL);
  fine = fine && sound_memory(&sim->effects);
  fine = fine && sound_reals(&y->row.steer_angle, TSE_CHANNELS, -MOST_REAL, MOST_REAL); /* one behind the other */
  return fine && sound_reals(&y->accel_x, 1, -MOST_REAL, MOST_REAL) && sound_reals(&y->accel_y, 1, -MOST_REAL, MOST_REAL);
}

tse_status tse_sim_step(tse_sim *sim, const tse_sim_input *u, tse_sim_output *y)
{
  if (!sim || !u || !y) return TSE_E_NULL;
  const tse_status refused = check_input(sim, u);
  if (refused < 0) return refused;
  tse_sim before;
  tse_sim_output made;
  memcpy(&before, sim, sizeof before); /* bytes between members too */
  log_next(sim, u, &made);
  if (!is_car(sim, &made)) {
    memcpy(sim, &before, sizeof before);
    return TSE_E_INPUT;
  }
  memcpy(y, &made, sizeof made);
  return TSE_OK;
}
