/* model/effects.h - the single-track model of vehicle.h with effects, evaluated at a
 * `point`, i.e. for one state and one set of inputs. An effect is a property of a car
 * that the single-track model leaves out, such as body roll (src/tables/effects.toml).
 *
 * An effect is implemented by a function <id>_<hook>() of catalogue.h, which changes the
 * point. A hook is a stage of the evaluation at which such functions are called, for
 * example SLIP. The table of effects names the hook of each effect. A LAG state is a slip
 * or slip angle that follows its kinematic value with a first-order lag. With all effects
 * off, the results equal the results of vehicle.h bit for bit. In a build with
 * TSE_NO_EFFECTS, this file contains only effect_is_on(). */
#ifndef TSE_SRC_EFFECTS_H
#define TSE_SRC_EFFECTS_H

#include "model/vehicle.h"

static inline int effect_is_on(const tse_effects *e, int effect) { return (int)((e->mask >> effect) & 1u); }

#if !defined(TSE_NO_EFFECTS)

/* Additional inputs of a log row: angles of the road, and disturbances that are added to
 * slip angles, forces and yaw acceleration. */
typedef struct given {
  tse_real grade, bank;           /* [rad] added to the settings grade_angle and bank_angle */
  tse_real slip_front, slip_rear; /* [rad] added to the slip angles */
  tse_real x, y, yaw;             /* [m/s2], [m/s2], [rad/s2] added to force / mass and yaw acceleration */
} given;

/* Wheels whose speeds v = R omega are states, for the front and the rear axle:
 *   v' = drive - brake clamp(v/still, -1, 1) - load Fx/m
 * Fx is the longitudinal tyre force of the axle, m the mass of the car. The clamped ratio
 * gives the brake the sign of v. It is continuous at v = 0, so that the brake holds a
 * standing wheel. */
typedef struct wheels {
  int32_t turning;             /* 0: wheel speeds are inputs, and the other members are not used */
  tse_real load[2];            /* [1] m R^2/J, where J is the moment of inertia of both wheels of the axle */
  tse_real drive[2], brake[2]; /* [m/s2] torques times R/J */
  tse_real still[2];           /* [m/s] speed above which the brake has its full torque */
} wheels;

/* Inputs, disturbances and torques at one time. */
typedef struct acting {
  inputs u;
  given g;
  wheels w;
} acting;

/* The model at one time: state and inputs, results of the effects, and resulting forces.
 * Forces are divided by the mass. */
typedef struct point {
  const tse_params *p;        /* the car */
  const tse_effect_memory *m; /* memory of the effects */
  tse_real vx, vy, r;         /* [m/s] [m/s] [rad/s] */
  inputs u;                   /* [rad] road-wheel angle after hook INPUT; [m/s] wheel speeds R omega */
  tse_real ahead;             /* [s] time of this point minus time of the last update of the memory */
  given g;
  wheels w;
  tse_real friction;  /* [1] friction coefficient at which the forces of an axle saturate; 0: linear tyres */
  slips s;            /* slips and slip angles; the force / mass of a tyre is k (below) times s */
  tse_real target[4]; /* values that the LAG states follow: slip angles front, rear, slips front, rear */
  tse_real rate[4];   /* [1/s] rates of the LAG states, in the order of target; 0: this slip has no lag */
  stiffness k;
  /* sine and cosine of the steering angle. The plain model approximates them by the angle
   * and 1. The effect exact_kinematics replaces them by the exact values */
  tse_real sin_steer, cos_steer;
  tse_real fx_front, fx_rear;    /* [m/s2] tyre forces, in the axes of the wheels */
  tse_real fy_front, fy_rear;    /* [m/s2] tyre forces, in the axes of the wheels */
  accels force;                  /* [m/s2] specific force at the centre of gravity; yaw [rad/s2] */
  tse_real free_angle[2];        /* [rad] slip angles before the user's formula and LAG states change them */
  tse_real gravity_x, gravity_y; /* [m/s2] parts of vx', vy' that are not in `force`: gravity, body roll */
} point;

/* Readings of accelerometers and gyro at a point. dt is the time since the last row. */
typedef struct reading {
  const point *pt;
  tse_effect_memory *m; /* memory of the effects; delays store samples in it */
  tse_real dt, y[3];    /* [s]; accel_x, accel_y [m/s2], yaw_rate [rad/s] */
} reading;

/* Store a new sample in a delay line. If the two newest stored samples are less than 1/9
 * of the delay apart, the new sample replaces the newest one. Otherwise it is added, and
 * the oldest one is discarded if the line is full. Of the 11 intervals between the
 * TSE_DELAY_ROWS samples of a full line, all but the newest thus last at least 1/9 of
 * the delay, and together span it.
 *   Given:    delay     [s] delay that the stored samples must span
 *             dt        [s] time since the last call
 *             value     new sample of each channel
 *             channels  number of channels
 *   Updated:  d         ages of the stored samples, index 0: the most recent
 *             was       stored samples of each channel */
static inline void effects_delay_put(tse_delay *d, tse_real was[][TSE_DELAY_ROWS], tse_real delay,
    tse_real dt, const tse_real *value, int channels)
{
  for (int i = 0; i < d->count; i++) d->age[i] += dt;
  const int crowded = d->count > 1 && r_mul(TSE_R(9), d->age[1] - d->age[0]) < delay;
  if (d->count > 0 && !crowded) {
    const int last = d->count < TSE_DELAY_ROWS ? d->count : TSE_DELAY_ROWS - 1;
    for (int i = last; i > 0; i--) {
      d->age[i] = d->age[i - 1];
      for (int c = 0; c < channels; c++) was[c][i] = was[c][i - 1];
    }
    d->count = last + 1;
  }
  if (d->count < 1) d->count = 1;
  d->age[0] = TSE_R(0);
  for (int c = 0; c < channels; c++) was[c][0] = value[c];
}

/* Return the value `delay` seconds before the newest sample of a delay line that is not
 * empty. Interpolate linearly between the samples v, whose ages are d->age. If no sample
 * is as old as `delay`, return the oldest one. */
static inline tse_real effects_delay_get(const tse_delay *d, const tse_real v[TSE_DELAY_ROWS], tse_real delay)
{
  int i = 1;
  while (i < d->count && d->age[i] < delay) i++;
  if (i >= d->count) return v[d->count - 1];
  const tse_real share = r_div(delay - d->age[i - 1], d->age[i] - d->age[i - 1]);
  return v[i - 1] + r_mul(share, v[i] - v[i - 1]);
}

/* Indices in tse_effect_memory.mode of the second-order lags of the effects. */
enum {
  MODE_ROLL,
  MODE_PITCH,
  MODE_ROLL_STEER,
};

#include "model/catalogue.h"
#include "tables/formula.h"
#include "model/formula.h"

/* EFFECTS_INPUT(INPUT_ON) calls the functions of the active effects of hook INPUT, in the
 * order of the table of effects. EFFECTS_INPUT (catalogue.h) lists the effects of the
 * hook, and INPUT_ON is the call for one effect. The other hooks in this file have the
 * same two macros, for example EFFECTS_SLIP and SLIP_ON. */
#define IF_ON(id, call) if (effect_is_on(e, TSE_EFFECT_##id)) call;
#define INPUT_ON(id) IF_ON(id, steer = id##_input(e, m, steer, dt))
#define SLIP_ON(id) IF_ON(id, id##_slip(pt))
#define LAG_ON(id) IF_ON(id, id##_slip(lag, pt))
#define STIFFNESS_ON(id) IF_ON(id, id##_stiffness(pt))
#define GRIP_ON(id) IF_ON(id, id##_grip(pt))
#define BODY_ON(id) IF_ON(id, id##_body(pt))
#define SENSOR_ON(id) IF_ON(id, id##_sensor(z))
#define LAG_BIT(id) | (uint64_t)1 << TSE_EFFECT_##id

/* Hook INPUT: compute the road-wheel angle from the logged angle. Call it once for
 * each row.
 *   Given:     dt  [s] time since the last row
 *   Updated:   m
 *   Returned:  [rad] */
static inline tse_real effects_steer(const tse_effects *e, tse_effect_memory *m, tse_real steer, tse_real dt)
{
  EFFECTS_INPUT(INPUT_ON)
  m->steered = 1;
  return steer;
}

#define MAX_LAG_RATE TSE_R(1e6) /* [1/s] max rate of a LAG state; the rate is speed / relaxation length */

/* Return whether any effect of hook LAG is on. */
static inline int effects_lag(const tse_effects *e) { return (e->mask & (0 EFFECTS_LAG(LAG_BIT))) != 0; }

/* Compute the rates of the LAG states, speed / relaxation length [1/s]. The reciprocals
 * of the speeds are in pt->s.
 *   Updated:  pt->rate */
static inline void effects_lag_rates(point *pt)
{
  const tse_effects *const e = &pt->p->effects;
  const int lateral = effect_is_on(e, TSE_EFFECT_relaxation),
            along = effect_is_on(e, TSE_EFFECT_longitudinal_relaxation);
  pt->rate[0] = pt->rate[1] = lateral ? r_min(relaxation_rate(e, pt), MAX_LAG_RATE) : TSE_R(0);
  pt->rate[2] = along ? r_min(longitudinal_relaxation_rate(e, pt->s.inv_front), MAX_LAG_RATE) : TSE_R(0);
  pt->rate[3] = along ? r_min(longitudinal_relaxation_rate(e, pt->s.inv_rear), MAX_LAG_RATE) : TSE_R(0);
}

/* Hooks SLIP and LAG: compute the slips from state and inputs.
 *   Given:    lag  LAG states at this point
 *   Updated:  pt->s, target, rate, sin_steer, cos_steer */
static inline void effects_slips(const tse_real lag[4], point *pt)
{
  const tse_effects *const e = &pt->p->effects;
  pt->s = vehicle_slips(pt->p, pt->vx, pt->vy, pt->r, pt->u);
  pt->sin_steer = pt->u.steer;
  pt->cos_steer = TSE_R(1);
  if (!e->mask) return;
  EFFECTS_SLIP(SLIP_ON)
  if (formula_is_on(e)) formula_slip(pt);
  pt->s.a_front += pt->g.slip_front;
  pt->s.a_rear += pt->g.slip_rear;
  pt->target[0] = pt->s.a_front;
  pt->target[1] = pt->s.a_rear;
  pt->target[2] = pt->s.s_front;
  pt->target[3] = pt->s.s_rear;
  if (effects_lag(e)) effects_lag_rates(pt);
  EFFECTS_LAG(LAG_ON)
}

/* Hooks STIFFNESS and GRIP: apply the effects that change the stiffness. Those of hook
 * GRIP act after those of hook STIFFNESS. They reduce the lateral stiffness to the secant
 * stiffness, i.e. force / slip angle, at the slip angles in pt->s.
 *   Updated:  pt->k  given: stiffness without effects */
static inline void effects_stiffness(point *pt)
{
  const tse_effects *const e = &pt->p->effects;
  if (!e->mask) return;
  EFFECTS_STIFFNESS(STIFFNESS_ON)
  EFFECTS_GRIP(GRIP_ON)
  if (formula_is_on(e)) formula_stiffness(pt);
}

/* Return the ratio of the force of a brush tyre to the force of a linear tyre. Friction
 * limits the resultant of longitudinal and lateral force, and thus reduces both forces by
 * the same ratio.
 *   Given:  limit   [m/s2] friction coefficient times axle load / mass of the car; 0: no
 *                   friction limit, the ratio is 1
 *           fx, fy  [m/s2] forces of the linear tyre / mass of the car */
static inline tse_real compute_grip_share(tse_real limit, tse_real fx, tse_real fy)
{
  tse_real slope;
  return limit > TSE_R(0) ? tyre_secant(r_div(r_sqrt(r_mul(fx, fx) + r_mul(fy, fy)), limit), TSE_R(0), &slope)
                          : TSE_R(1);
}

/* Replace the stiffness of each axle by its secant stiffness: saturated force / slip, at
 * the slips pt->s.
 *   Updated:  pt->k */
static inline void reduce_stiffness(point *pt)
{
  const tse_car *const c = &pt->p->car;
  const tse_real front = compute_grip_share(r_mul(pt->friction, c->load_front),
      r_mul(pt->k.x_front, pt->s.s_front), r_mul(pt->k.y_front, pt->s.a_front));
  const tse_real rear = compute_grip_share(r_mul(pt->friction, c->load_rear),
      r_mul(pt->k.x_rear, pt->s.s_rear), r_mul(pt->k.y_rear, pt->s.a_rear));
  pt->k.x_front = r_mul(pt->k.x_front, front);
  pt->k.y_front = r_mul(pt->k.y_front, front);
  pt->k.x_rear = r_mul(pt->k.x_rear, rear);
  pt->k.y_rear = r_mul(pt->k.y_rear, rear);
}

/* Hook BODY: compute the forces of equation (1) (vehicle_accels() in vehicle.h), with
 * disturbances and effects.
 *   Updated:  fx_front .. fy_rear, force, gravity_x, gravity_y of pt */
static inline void effects_forces(point *pt)
{
  const tse_params *const p = pt->p;
  const tse_effects *const e = &p->effects;
  pt->gravity_x = pt->gravity_y = TSE_R(0);
  pt->fx_front = r_mul(pt->k.x_front, pt->s.s_front);
  pt->fx_rear = r_mul(pt->k.x_rear, pt->s.s_rear);
  if (!e->mask) {
    pt->force = vehicle_accels(p, pt->k, pt->s, pt->u.steer);
    return;
  }
  pt->fy_front = r_mul(pt->k.y_front, pt->s.a_front);
  pt->fy_rear = r_mul(pt->k.y_rear, pt->s.a_rear);
  const tse_real side = r_mul(pt->fy_front, pt->cos_steer) + r_mul(pt->fx_front, pt->sin_steer);
  pt->force.x = r_mul(pt->fx_front, pt->cos_steer) + pt->fx_rear - r_mul(pt->fy_front, pt->sin_steer)
      + pt->g.x;
  pt->force.y = side + pt->fy_rear + pt->g.y;
  pt->force.yaw = r_mul(p->car.jf, side) - r_mul(p->car.jr, pt->fy_rear) + pt->g.yaw;
  EFFECTS_BODY(BODY_ON)
  /* body_roll has a function of hook BODY in addition to that of its hook SENSOR */
  if (effect_is_on(e, TSE_EFFECT_body_roll)) body_roll_body(pt);
  if (formula_is_on(e)) formula_body(pt);
}

/* Update the memory of the effects after a step of h seconds, from point a at the start
 * of the step to point b at its end. */
static inline void effects_remember(
    const tse_effects *e, tse_effect_memory *m, const point *a, const point *b, tse_real h)
{
  if (!e->mask) return;
  m->time += h;
  if (effect_is_on(e, TSE_EFFECT_crosswind)) crosswind_remember(m, a, b, h);
  if (effect_is_on(e, TSE_EFFECT_body_roll)) body_roll_remember(e, m, a, b, h);
  if (effect_is_on(e, TSE_EFFECT_pitch_leak)) pitch_leak_remember(e, m, a, b, h);
  if (effect_is_on(e, TSE_EFFECT_rear_roll_steer)) rear_roll_steer_remember(e, m, a, b, h);
  if (formula_is_on(e)) formula_remember(m, b, 0);
}

/* Hook SENSOR: compute the readings of accelerometers and gyro, without noise and bias.
 * Call it once for each row.
 *   Given:  dt  [s] time since the last row */
static inline reading effects_sense(const point *pt, tse_effect_memory *m, tse_real dt)
{
  const tse_effects *const e = &pt->p->effects;
  reading now = { pt, m, dt, { pt->force.x, pt->force.y, pt->r } }, *const z = &now;
  if (!e->mask) return now;
  EFFECTS_SENSOR(SENSOR_ON)
  if (formula_is_on(e)) formula_sensor(pt, z->y);
  return now;
}

/* Evaluate a point, except for the readings of the sensors.
 *   Given:    k   stiffness without effects
 *   Updated:  pt  state and inputs are given, the other members are computed */
static inline void effects_at(
    const tse_params *p, const tse_effect_memory *m, const tse_real lag[4], stiffness k, point *pt)
{
  pt->p = p;
  pt->m = m;
  pt->k = k;
  effects_slips(lag, pt);
  effects_stiffness(pt);
  if (pt->friction > TSE_R(0)) reduce_stiffness(pt);
  effects_forces(pt);
}

/* ---- integrator.c */

/* Evaluate the point, and set the memory to its steady state: slips after relaxation
 * equal the kinematic slips, and the output of each second-order lag equals its input,
 * the longitudinal or lateral specific force at the point.
 *   Updated:  m, pt */
void effects_settle(const tse_params *p, tse_effect_memory *m, stiffness k, point *pt);

/* Integrate the equation of motion (equation (7), src/EQUATIONS.md) with effects over dt,
 * in `steps` equal steps. The inputs change linearly, from those in `at` to `to`.
 *   Updated:  m   memory of the effects
 *             at  evaluated point; in: at the start of dt, out: at the end of dt */
void effects_advance(const tse_params *p, tse_effect_memory *m, stiffness k, const acting *to, tse_real dt,
    int32_t steps, point *at);

#endif /* TSE_NO_EFFECTS */
#endif
