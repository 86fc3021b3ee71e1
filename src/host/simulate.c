/* host/simulate.c - simulator: the single-track model with wheel dynamics, random
 * stiffness and sensor noise. */

#include "model/state.h"
#include "tse/simulate.h"

#include <stddef.h>

#include "tables/columns.h"
#include "tables/rows.h"
#include "tables/settings.h"
#include "number/random.h"
#include "host/sound.h"
#include "model/effects.h"

/* Defaults and ranges of the settings, and ranges of the inputs of driver and road. */
#define SIM_REAL(fmu, name, def, exact, lo, hi, unit, text) \
  { #name, (uint16_t)offsetof(tse_sim_config, name), TSE_S(def), TSE_S(lo), TSE_S(hi) },
#define SIM_WHOLE(fmu, name, def, exact, lo, hi, unit, text) \
  { #name, (uint16_t)offsetof(tse_sim_config, name), def, lo, hi },
#define SIM_INPUT(name, def, lo, hi, unit, text) \
  { #name, (uint16_t)offsetof(tse_sim_input, name), 1, TSE_R(lo), TSE_R(hi) },
static const real_row sim_reals[] = { SETTINGS_SIM(SIM_REAL, NO_ROW) };
static const whole_row sim_wholes[] = { SETTINGS_SIM(NO_ROW, SIM_WHOLE) };
static const channel_row sim_inputs[] = { DRIVER(SIM_INPUT) };
enum {
  SIM_REALS = sizeof sim_reals / sizeof sim_reals[0],
  SIM_WHOLES = sizeof sim_wholes / sizeof sim_wholes[0],
  SIM_INPUTS = sizeof sim_inputs / sizeof sim_inputs[0]
};

#define BRAKE_GRIP TSE_R(0.2) /* [rad/s] wheel speed above which a brake has its full torque. At lower
                               * speeds the torque is proportional to the speed, so that the
                               * brake holds a standing wheel without a discontinuity (`wheels` in
                               * model/point.h) */
/* Limits of the motion. A step that exceeds them is refused, before numbers overflow.
 * They do not limit realistic simulations: with torques within their range, a car of
 * usual mass and inertia takes more than a minute to reach them. */
#define LOST_SPEED TSE_R(1000)     /* [m/s] */
#define LOST_YAW_RATE TSE_R(200)   /* [rad/s] */
#define LOST_WHEEL TSE_R(1e7)      /* [rad/s] wheel speed; on ice the max torque accelerates the lightest
                                    * wheels by 2e6 rad/s in a second */
#define JUMP TSE_R(1e-6) /* [s] time in which jump() turns the wheels to a changed steering angle */

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
  memcpy(&sim->params, &params, sizeof params); /* with padding, because tse_sim_check() compares bytes */
  sim->params.seed[0] = (uint32_t)s->seed;
  /* Not the seed[1] of the filter: if simulator and filter have the same setting `seed`
   * (seed[0]), they still draw different numbers. */
  sim->params.seed[1] = 0x73696d75u;
  sim->x[0] = r_from_setting(s->speed);
  sim->x[1] = r_from_setting(s->vel_y);
  sim->x[3] = r_div(sim->x[0], params.radius_front);
  sim->x[4] = r_div(sim->x[0], params.radius_rear);
  sim->bias[0] = r_from_setting(s->true_bias_accel_x);
  sim->bias[1] = r_from_setting(s->true_bias_accel_y);
  sim->bias[2] = r_from_setting(s->true_bias_yaw_rate);
  return TSE_OK;
}

/* Return whether two simulations have the same settings. The settings of the simulator
 * are compared member by member, because their padding bytes are undefined. */
static int has_same_settings(const tse_sim *a, const tse_sim *b)
{
  int same = memcmp(&a->params, &b->params, sizeof a->params) == 0;
  const uint8_t *const x = (const uint8_t *)&a->config, *const y = (const uint8_t *)&b->config;
  for (int i = 0; i < SIM_REALS; i++)
    same = same && memcmp(x + sim_reals[i].at, y + sim_reals[i].at, sizeof(tse_setting)) == 0;
  for (int i = 0; i < SIM_WHOLES; i++)
    same = same && memcmp(x + sim_wholes[i].at, y + sim_wholes[i].at, sizeof(int32_t)) == 0;
  return same;
}

tse_status tse_sim_check(const tse_sim *sim, const tse_config *c, const tse_sim_config *s)
{
  tse_sim fresh;
  if (!sim || !c || !s) return TSE_E_NULL;
  const tse_status status = tse_sim_reset(&fresh, c, s, NULL);
  if (status < 0) return status;
  int fine = has_same_settings(&fresh, sim);
  fine = fine && sound_memory(&sim->effects);
  fine = fine && sound_reals(sim->x, 5, -MOST_REAL, MOST_REAL)
      && sound_reals(sim->bias, 3, -MOST_REAL, MOST_REAL);
  fine = fine && sound_reals(sim->drawn, 3, -MOST_REAL, MOST_REAL)
      && sound_reals(&sim->steer, 1, -MOST_REAL, MOST_REAL);
  fine = fine && sound_reals(&sim->steer_logged, 1, -MOST_REAL, MOST_REAL)
      && sound_reals(&sim->last.dt, 1, TSE_R(0), MOST_REAL);
  for (int i = 0; i < SIM_INPUTS; i++)
    fine = fine && channel_holds(&sim_inputs[i], channel_at(&sim->last, &sim_inputs[i]));
  return fine ? TSE_OK : TSE_E_STATE;
}

/* Return the constants of the wheels, and the drive and brake torques of u. */
static wheels compute_wheels(const tse_sim *sim, const tse_sim_input *u)
{
  const tse_real radius[2] = { sim->params.radius_front, sim->params.radius_rear };
  const tse_setting inertia[2] = { sim->config.wheel_inertia_front, sim->config.wheel_inertia_rear };
  const tse_real drive[2] = { u->wheel_torque_front, u->wheel_torque_rear },
                 brake[2] = { u->brake_torque_front, u->brake_torque_rear };
  wheels w;
  w.turning = 1;
  for (int a = 0; a < 2; a++) {
    const tse_real arm = r_div(radius[a], r_from_setting(inertia[a]));
    w.load[a] = r_mul(sim->params.effects.mass, r_mul(arm, radius[a]));
    w.drive[a] = r_mul(arm, drive[a]);
    w.brake[a] = r_mul(arm, brake[a]);
    w.still[a] = r_mul(BRAKE_GRIP, radius[a]);
  }
  return w;
}

/* Return the friction coefficient of the road at the last row. */
static tse_real friction_now(const tse_sim *sim)
{
  return sim->last.road_friction > TSE_R(0) ? sim->last.road_friction : r_from_setting(sim->config.friction);
}

/* Return the current state and the inputs u of the model. The other members of `point`
 * are 0 until effects_at() computes them.
 *   Given:  steer  road-wheel angle [rad] */
static point make_point(const tse_sim *sim, const tse_sim_input *u, tse_real steer)
{
  point pt;
  memset(&pt, 0, sizeof pt);
  pt.vx = sim->x[0];
  pt.vy = sim->x[1];
  pt.r = sim->x[2];
  pt.u.steer = steer;
  pt.u.v_front = r_mul(sim->params.radius_front, sim->x[3]);
  pt.u.v_rear = r_mul(sim->params.radius_rear, sim->x[4]);
  pt.w = compute_wheels(sim, u);
  pt.g.grade = u->grade;
  pt.g.bank = u->bank;
  pt.friction = friction_now(sim);
  return pt;
}

/* Draw two independent numbers from N(0, 1) for this step and purpose. */
static void draw_two_normals(const tse_sim *sim, uint32_t purpose, tse_real *a, tse_real *b)
{
  uint32_t u, v;
  random_words(sim->params.seed, sim->step, purpose, 0, &u, &v);
  random_normal2(u, v, a, b);
}

/* Draw the stiffness from this row to the next row, relative to nominal:
 *   mean (1 + spread n), n from N(0, 1), but at least a tenth of the mean
 *   Returned:  mean   setting (true_cx_front ...) times road_level
 *              drawn  the drawn stiffness */
static void draw_stiffness(const tse_sim *sim, tse_real road_level, tse_real mean[3], tse_real drawn[3])
{
  const tse_sim_config *const s = &sim->config;
  const tse_real level[3] = { r_from_setting(s->true_cx_front), r_from_setting(s->true_cy_front),
    r_from_setting(s->true_cy_rear) };
  const tse_real spread[3] = { r_from_setting(s->spread_cx_front), r_from_setting(s->spread_cy_front),
    r_from_setting(s->spread_cy_rear) };
  tse_real n[4];
  draw_two_normals(sim, RANDOM_SIM_STIFFNESS_A, &n[0], &n[1]);
  draw_two_normals(sim, RANDOM_SIM_STIFFNESS_B, &n[2], &n[3]);
  for (int a = 0; a < 3; a++) {
    mean[a] = r_mul(level[a], road_level);
    drawn[a] = r_mul(mean[a], r_max(TSE_R(1) + r_mul(spread[a], n[a]), TSE_R(0.1)));
  }
}

/* Return the drawn stiffness of all tyres, divided by the mass of the car. The rear
 * longitudinal stiffness is not drawn: it follows the front longitudinal stiffness.
 * Relative to nominal it is road_level plus f times the difference between the front
 * stiffness and road_level. f is the setting rear_longitudinal_follows_front. */
static stiffness get_stiffness(const tse_sim *sim, tse_real road_level)
{
  const tse_params *const p = &sim->params;
  stiffness k;
  k.x_front = r_mul(p->car.kx_front, sim->drawn[0]);
  k.x_rear = r_mul(p->car.kx_rear, road_level + r_mul(p->follow, sim->drawn[0] - road_level));
  k.y_front = r_mul(p->car.ky_front, sim->drawn[1]);
  k.y_rear = r_mul(p->car.ky_rear, sim->drawn[2]);
  return k;
}

/* Check the ranges of the inputs of a row. */
static tse_status check_input(const tse_sim *sim, const tse_sim_input *u)
{
  if (sim->step > 0 && !(u->dt > TSE_R(0) && u->dt <= TSE_R(1))) return TSE_E_TIME;
  for (int i = 0; i < SIM_INPUTS; i++)
    if (!channel_holds(&sim_inputs[i], channel_at(u, &sim_inputs[i]))) return TSE_E_INPUT;
  return TSE_OK;
}

/* If the steering angle in `last` is not the one to which the wheels have been turned,
 * turn the wheels to it within the time JUMP. This is so if the caller has changed `last`
 * after the last row and, with hold_inputs = 1, if a row has a new angle. */
static void jump(tse_sim *sim)
{
  if (!(sim->last.steer_angle < sim->steer_logged || sim->last.steer_angle > sim->steer_logged)) return;
  sim->steer = effects_steer(&sim->params.effects, &sim->effects, sim->last.steer_angle, JUMP);
  sim->steer_logged = sim->last.steer_angle;
}

/* Add the random walk of dt seconds to the biases. */
static void walk_biases(tse_sim *sim, tse_real dt)
{
  const tse_real scale = r_mul(r_from_setting(sim->config.bias_walk), r_sqrt(dt));
  tse_real n[4];
  draw_two_normals(sim, RANDOM_SIM_WALK_A, &n[0], &n[1]);
  draw_two_normals(sim, RANDOM_SIM_WALK_B, &n[2], &n[3]);
  for (int a = 0; a < 3; a++) sim->bias[a] += r_mul(r_mul(scale, sim->params.bias_sd_walk[a]), n[a]);
}

/* Integrate to the next row. The inputs of the driver are linear between rows or, if
 * hold_inputs is 1, constant.
 *
 * A constant torque acts half a row later, on average, than a linear one. An estimator
 * that interpolates wheel speeds linearly between rows does not model this delay. With
 * hold_inputs = 1 it therefore estimates a longitudinal stiffness that is 2 % too
 * small. */
static void advance_to_row(tse_sim *sim, const tse_sim_input *u)
{
  const tse_params *const p = &sim->params;
  const stiffness k = get_stiffness(sim, sim->last.road_level);
  /* round up, with a tolerance so that 0.01/0.001 gives 10 */
  const int32_t steps = -r_floor_to_int(-r_div(u->dt, r_from_setting(sim->config.substep)) + TSE_R(1e-4));
  const tse_sim_input end = sim->config.hold_inputs ? sim->last : *u;
  acting to;
  jump(sim);
  point at = make_point(sim, &sim->last, sim->steer);
  effects_at(p, &sim->effects, sim->effects.lag, k, &at);
  sim->steer_logged = end.steer_angle;
  sim->steer = effects_steer(&p->effects, &sim->effects, end.steer_angle, u->dt);
  memset(&to, 0, sizeof to);
  to.u.steer = sim->steer;
  to.w = compute_wheels(sim, &end);
  to.g.grade = end.grade;
  to.g.bank = end.bank;
  effects_advance(p, &sim->effects, k, &to, u->dt, steps, &at);
  sim->x[0] = at.vx;
  sim->x[1] = at.vy;
  sim->x[2] = at.r;
  sim->x[3] = r_div(at.u.v_front, p->radius_front);
  sim->x[4] = r_div(at.u.v_rear, p->radius_rear);
  sim->last = *u;
  jump(sim);
  walk_biases(sim, u->dt);
}

/* Compute the readings of the sensors without noise and bias. At the first row the
 * effects start in steady state: slips have built up, and the wheels have reached the
 * steering angle.
 *   Returned:  *pt  state, inputs and forces of the model at this row */
static reading observe(tse_sim *sim, stiffness k, point *pt, tse_real dt)
{
  const tse_params *const p = &sim->params;
  const int first = !sim->effects.settled;
  if (first) {
    sim->steer_logged = sim->last.steer_angle;
    sim->steer = effects_steer(&p->effects, &sim->effects, sim->last.steer_angle, TSE_R(1));
  }
  *pt = make_point(sim, &sim->last, sim->steer);
  if (first) effects_settle(p, &sim->effects, k, pt);
  else effects_at(p, &sim->effects, sim->effects.lag, k, pt);
  return effects_sense(pt, &sim->effects, dt);
}

/* Log the next row. Advance the car to it first, unless it is the first row. */
static void log_next(tse_sim *sim, const tse_sim_input *u, tse_sim_output *y)
{
  if (sim->step > 0) advance_to_row(sim, u);
  else sim->last = *u;

  tse_real mean[3], n[6];
  draw_stiffness(sim, u->road_level, mean, sim->drawn);
  point pt;
  const reading clean = observe(sim, get_stiffness(sim, u->road_level), &pt, u->dt);

  for (uint32_t i = 0; i < 3; i++) draw_two_normals(sim, RANDOM_SIM_NOISE_A + i, &n[2 * i], &n[2 * i + 1]);
  const tse_real noise = r_from_setting(sim->config.noise);
  const tse_real wheel_sd = r_from_setting(sim->config.wheel_speed_sd);
  tse_real measured[3];
  for (int i = 0; i < 3; i++)
    measured[i] = clean.y[i] + sim->bias[i] + r_mul(r_mul(noise, sim->params.sd[i]), n[i]);

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

/* Return whether the motion is within its limits (LOST_SPEED ...), so that
 * tse_sim_check() accepts it. A motion that contains a NaN is not within its limits. */
static int is_car(const tse_sim *sim, const tse_sim_output *y)
{
  int fine = sound_reals(sim->x, 2, -LOST_SPEED, LOST_SPEED)
      && sound_reals(&sim->x[2], 1, -LOST_YAW_RATE, LOST_YAW_RATE);
  fine = fine && sound_reals(&sim->x[3], 2, -LOST_WHEEL, LOST_WHEEL);
  fine = fine && sound_reals(sim->bias, 3, -MOST_REAL, MOST_REAL)
      && sound_reals(&sim->steer, 1, -MOST_REAL, MOST_REAL);
  fine = fine && sound_memory(&sim->effects);
  /* the channels are adjacent members */
  fine = fine && sound_reals(&y->row.steer_angle, TSE_CHANNELS, -MOST_REAL, MOST_REAL);
  return fine && sound_reals(&y->accel_x, 1, -MOST_REAL, MOST_REAL)
      && sound_reals(&y->accel_y, 1, -MOST_REAL, MOST_REAL);
}

/* Return the mask of the effects in this row: the effects that the settings switch on. If
 * u or the last row has a road angle other than 0, the mask also has grade and bank. */
static uint64_t find_row_effects(const tse_sim *sim, const tse_sim_input *u)
{
  const uint64_t road = (uint64_t)1 << TSE_EFFECT_grade | (uint64_t)1 << TSE_EFFECT_bank;
  const tse_real leans = r_abs(u->grade) + r_abs(u->bank) + r_abs(sim->last.grade) + r_abs(sim->last.bank);
  return sim->params.effects.mask | (leans > TSE_R(0) ? road : 0u);
}

tse_status tse_sim_step(tse_sim *sim, const tse_sim_input *u, tse_sim_output *y)
{
  if (!sim || !u || !y) return TSE_E_NULL;
  const tse_status refused = check_input(sim, u);
  if (refused < 0) return refused;
  tse_sim before;
  tse_sim_output made;
  memcpy(&before, sim, sizeof before); /* with the padding bytes */
  sim->params.effects.mask = find_row_effects(sim, u);
  log_next(sim, u, &made);
  memcpy(&sim->params, &before.params, sizeof before.params);
  if (!is_car(sim, &made)) {
    memcpy(sim, &before, sizeof before);
    return TSE_E_INPUT;
  }
  memcpy(y, &made, sizeof made);
  return TSE_OK;
}
