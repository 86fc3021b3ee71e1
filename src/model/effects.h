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

#include "model/catalogue.h"
#include "model/formula.h"
#include "model/point.h"

static inline int effect_is_on(const tse_effects *e, int effect) { return (int)((e->mask >> effect) & 1u); }

#if !defined(TSE_NO_EFFECTS)

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
 *   Updated:  pt->k  in: stiffness without effects, out: with effects */
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
