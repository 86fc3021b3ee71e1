/* model/effects.h - the plain model of vehicle.h with the effects of
 * src/tables/effects.toml, at one point of state and input.
 *
 * Each effect is a file effects/<id>.h with one function <id>_<hook>(); the table says
 * when it is called. The functions work on a `point`; they include nothing, because this
 * file includes them where everything they need stands above. With no effect on, every
 * sum and product is that of vehicle.h: the same bits. Not built with TSE_NO_EFFECTS. */
#ifndef TSE_SRC_EFFECTS_H
#define TSE_SRC_EFFECTS_H

#include "model/vehicle.h"

static inline int effect_is_on(const tse_effects *e, int effect) { return (int)((e->mask >> effect) & 1u); }

#if !defined(TSE_NO_EFFECTS)

/* What a log row may give beside its inputs: the road's profile, and disturbances placed
 * where an effect would enter. */
typedef struct given {
  tse_real grade, bank;           /* [rad] besides the effects' constants                 */
  tse_real slip_front, slip_rear; /* [rad] slip angles                                    */
  tse_real x, y, yaw;             /* [m/s2], [m/s2], [rad/s2] forces and moment on the body */
} given;

/* Wheels whose speeds are states, front and rear; v = R omega:  v' = drive - brake - load
 * Fx/m
 * Brakes oppose rotation; between -still and still their torque rises linearly, so that
 * they hold a standing wheel without a discontinuity. */
typedef struct wheels {
  int32_t turning;             /* 0: their speeds are inputs, and the rest is not used */
  tse_real load[2];            /* m R^2/J                                              */
  tse_real drive[2], brake[2]; /* [m/s2] torques times R/J                             */
  tse_real still[2];           /* [m/s]                                                */
} wheels;

/* What acts on the car from outside at one time. */
typedef struct acting {
  inputs u;
  given g;
  wheels w;
} acting;

/* One point: what is given, what the effects make of it, what the car then does. Forces
 * are over mass. */
typedef struct point {
  const tse_params *p; /* the car                                                                      */
  const tse_effect_memory
      *m;             /* what its effects remember                                                    */
  tse_real vx, vy, r; /* [m/s] [m/s] [rad/s]                                                          */
  inputs u;           /* steering angle after the INPUT effects                                       */
  tse_real ahead;     /* [s] how far this point lies after the time of the memory                     */
  given g;
  wheels w;
  tse_real friction;  /* at which the forces of an axle saturate, along and across; 0: it does not        */
  slips s;            /* what the tyres' forces are proportional to                                   */
  tse_real target[4]; /* slip angles front, rear, slips front, rear that the lags of LAG run towards  */
  tse_real rate[4];   /* [1/s] of these lags, 0: no state                                              */
  stiffness k;
  tse_real sin_steer,
      cos_steer; /* delta and 1 in the plain model                                               */
  tse_real fx_front, fx_rear, fy_front,
      fy_rear;            /* [m/s2] tyre forces, in the axes of their wheels                    */
  accels force;           /* [m/s2] specific force at the centre of gravity, [rad/s2] yaw acceleration    */
  tse_real free_angle[2]; /* [rad] slip angles before a formula of the user and before LAG                */
  tse_real gravity_x,
      gravity_y; /* [m/s2] accelerates the car, no sensor                                        */
} point;

/* What accelerometers and gyro read at a point, dt after the last row. */
typedef struct reading {
  const point *pt;
  tse_effect_memory *m; /* that of the point: a delay keeps what was read */
  tse_real dt, y[3];    /* [s] accel_x, accel_y [m/s2], yaw_rate [rad/s]  */
} reading;

/* Newest sample in. A sample that follows its predecessor closer than 1/9 of the delay
 * takes its place, so that TSE_DELAY_ROWS samples always reach further back than the
 * delay. */
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

/* The value of `delay` seconds ago, linear between samples; the oldest where there is
 * none. */
static inline tse_real effects_delay_get(const tse_delay *d, const tse_real v[TSE_DELAY_ROWS], tse_real delay)
{
  int i = 1;
  while (i < d->count && d->age[i] < delay) i++;
  if (i >= d->count) return v[d->count - 1];
  const tse_real share = r_div(delay - d->age[i - 1], d->age[i] - d->age[i - 1]);
  return v[i - 1] + r_mul(share, v[i] - v[i - 1]);
}

enum {
  MODE_ROLL,
  MODE_PITCH,
  MODE_ROLL_STEER,
};

#include "model/catalogue.h"
#include "tables/formula.h"
#include "model/formula.h"

/* EFFECTS_INPUT(INPUT_ON) and its like (catalogue.h) call every effect of that hook that
 * is on, in the order of the table. */
#define IF_ON(id, call) if (effect_is_on(e, TSE_EFFECT_##id)) call;
#define INPUT_ON(id) IF_ON(id, steer = id##_input(e, m, steer, dt))
#define SLIP_ON(id) IF_ON(id, id##_slip(pt))
#define LAG_ON(id) IF_ON(id, id##_slip(lag, pt))
#define STIFFNESS_ON(id) IF_ON(id, id##_stiffness(pt))
#define GRIP_ON(id) IF_ON(id, id##_grip(pt))
#define BODY_ON(id) IF_ON(id, id##_body(pt))
#define SENSOR_ON(id) IF_ON(id, id##_sensor(z))
#define LAG_BIT(id) | (uint64_t)1 << TSE_EFFECT_##id

/* INPUT: the steering angle that a row logs becomes that of the wheels. Once a row, dt
 * since the last one.
 *   Updated:  m   Returned: [rad] */
static inline tse_real effects_steer(const tse_effects *e, tse_effect_memory *m, tse_real steer, tse_real dt)
{
  EFFECTS_INPUT(INPUT_ON)
  m->steered = 1;
  return steer;
}

#define MOST_RATE TSE_R(1e6) /* 1/s: a length of micrometres is none, and no infinite number */

static inline int effects_lag(const tse_effects *e) { return (e->mask & (0 EFFECTS_LAG(LAG_BIT))) != 0; }

/* Rates of the states of LAG, from the slips that they run towards.   Updated: pt->rate */
static inline void effects_lag_rates(point *pt)
{
  const tse_effects *const e = &pt->p->effects;
  const int lateral = effect_is_on(e, TSE_EFFECT_relaxation),
            along = effect_is_on(e, TSE_EFFECT_longitudinal_relaxation);
  pt->rate[0] = pt->rate[1] = lateral ? r_min(relaxation_rate(e, pt), MOST_RATE) : TSE_R(0);
  pt->rate[2] = along ? r_min(longitudinal_relaxation_rate(e, pt->s.inv_front), MOST_RATE) : TSE_R(0);
  pt->rate[3] = along ? r_min(longitudinal_relaxation_rate(e, pt->s.inv_rear), MOST_RATE) : TSE_R(0);
}

/* SLIP, LAG: from state and inputs to what the tyres' forces are proportional to.
 *   Given:  lag  the four states of LAG at this point       Updated:  pt->s, target,
 *                                                           rate, sin_steer, cos_steer */
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

/* STIFFNESS, GRIP: the secant stiffness at these slips.   Updated: pt->k */
static inline void effects_stiffness(point *pt)
{
  const tse_effects *const e = &pt->p->effects;
  if (!e->mask) return;
  EFFECTS_STIFFNESS(STIFFNESS_ON)
  EFFECTS_GRIP(GRIP_ON)
  if (formula_is_on(e)) formula_stiffness(pt);
}

/* Secant of a tyre that saturates along and across, over its stiffness: a brush. `limit`
 * is friction times axle load, `fx`, `fy` are what linear tyres would hold (all over
 * mass). */
static inline tse_real grip(tse_real limit, tse_real fx, tse_real fy)
{
  tse_real slope;
  return limit > TSE_R(0) ? tyre_secant(r_div(r_sqrt(r_mul(fx, fx) + r_mul(fy, fy)), limit), TSE_R(0), &slope)
                          : TSE_R(1);
}

/* The stiffness that the tyres of each axle show at these slips.   Updated: pt->k */
static inline void lose_grip(point *pt)
{
  const tse_car *const c = &pt->p->car;
  const tse_real front = grip(r_mul(pt->friction, c->load_front), r_mul(pt->k.x_front, pt->s.s_front),
      r_mul(pt->k.y_front, pt->s.a_front));
  const tse_real rear = grip(r_mul(pt->friction, c->load_rear), r_mul(pt->k.x_rear, pt->s.s_rear),
      r_mul(pt->k.y_rear, pt->s.a_rear));
  pt->k.x_front = r_mul(pt->k.x_front, front);
  pt->k.y_front = r_mul(pt->k.y_front, front);
  pt->k.x_rear = r_mul(pt->k.x_rear, rear);
  pt->k.y_rear = r_mul(pt->k.y_rear, rear);
}

/* BODY: (1) with what acts besides.   Updated: forces, pt->force, gravity */
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
  if (effect_is_on(e, TSE_EFFECT_body_roll)) body_roll_body(pt); /* acts here, too */
  if (formula_is_on(e)) formula_body(pt);
}

/* What effects with memory take from the step of h seconds that led from point a to point
 * b. */
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

/* SENSOR: what accelerometers and gyro read at a point of the memory m, without noise and
 * bias. Once a row, dt since the last one. */
static inline reading effects_sense(const point *pt, tse_effect_memory *m, tse_real dt)
{
  const tse_effects *const e = &pt->p->effects;
  reading now = { pt, m, dt, { pt->force.x, pt->force.y, pt->r } }, *const z = &now;
  if (!e->mask) return now;
  EFFECTS_SENSOR(SENSOR_ON)
  if (formula_is_on(e)) formula_sensor(pt, z->y);
  return now;
}

/* All of a point but the sensors, with the stiffness k of no effects. */
static inline void effects_at(
    const tse_params *p, const tse_effect_memory *m, const tse_real lag[4], stiffness k, point *pt)
{
  pt->p = p;
  pt->m = m;
  pt->k = k;
  effects_slips(lag, pt);
  effects_stiffness(pt);
  if (pt->friction > TSE_R(0)) lose_grip(pt);
  effects_forces(pt);
}

/* integrator.c */

/* Memory at rest at this state: tyres hold the kinematic slip, modes the acceleration.
 * Returned: pt evaluated. */
void effects_settle(const tse_params *p, tse_effect_memory *m, stiffness k, point *pt);

/* (7) with the effects, from the evaluated point `at` to what acts dt later, in equal
 * steps, between which that is linear; `at` is then that point. */
void effects_advance(const tse_params *p, tse_effect_memory *m, stiffness k, const acting *to, tse_real dt,
    int32_t steps, point *at);

#endif /* TSE_NO_EFFECTS */
#endif
