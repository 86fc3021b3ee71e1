/* model/formula.h - the formula of the user (src/tables/formula.toml): its value at a
 * point of the model, and its memory.
 *
 * The program of the formula is interpreted. In a build with the macro TSE_FORMULA it is
 * compiled instead, from the header tse_formula.h, which tselab writes. Both ways call
 * the functions below in the same order and give the same bits.
 *
 * Some operations have a memory, for example a lag. During an integration step the memory
 * holds the state of these operations at the start of the step. A point is `ahead`
 * seconds after the start: from the memory and `ahead` the operations compute their
 * result at the point. After the step, formula_remember() updates the memory. */
#ifndef TSE_SRC_FORMULA_H
#define TSE_SRC_FORMULA_H

#include "model/point.h"
#include "tables/formula.h"

#if !defined(TSE_NO_EFFECTS)

#define MAX_FORMULA_VALUE TSE_R(1e6) /* formula_clip() sets larger magnitudes, and NaN, to 0 */

/* State of one evaluation of the formula. */
typedef struct formula_run {
  const point *pt;
  tse_effect_memory *next; /* memory to be updated; NULL: update none */
  int rest;                /* 1: operations with memory give their steady state; 0: they advance from pt->m */
  int used;                /* number of operations with memory that have been evaluated */
} formula_run;

static inline int formula_is_on(const tse_effects *e) { return (int)((e->mask >> TSE_BIT_FORMULA) & 1u); }

/* Return x, or 0 if |x| is at least MAX_FORMULA_VALUE or x is NaN. */
static inline tse_real formula_clip(tse_real x)
{
  return x > -MAX_FORMULA_VALUE && x < MAX_FORMULA_VALUE ? x : TSE_R(0);
}

/* Limit x to lo .. hi. */
static inline tse_real formula_clamp(tse_real x, tse_real lo, tse_real hi)
{
  return x < lo ? lo : (x > hi ? hi : x);
}

/* ---- numbers and signals */
static inline tse_real formula_number(formula_run *f, int slot) { return f->pt->p->effects.formula[slot]; }
static inline tse_real formula_one(void) { return TSE_R(1); }
static inline tse_real formula_two(void) { return TSE_R(2); }
static inline tse_real formula_steer_angle(formula_run *f) { return f->pt->u.steer; }
static inline tse_real formula_vel_x(formula_run *f) { return f->pt->vx; }
static inline tse_real formula_vel_y(formula_run *f) { return f->pt->vy; }
static inline tse_real formula_yaw_rate(formula_run *f) { return f->pt->r; }
static inline tse_real formula_accel_x(formula_run *f) { return f->pt->m->formula_accel[0]; }
static inline tse_real formula_accel_y(formula_run *f) { return f->pt->m->formula_accel[1]; }
static inline tse_real formula_slip_angle_front(formula_run *f) { return f->pt->free_angle[0]; }
static inline tse_real formula_slip_angle_rear(formula_run *f) { return f->pt->free_angle[1]; }
static inline tse_real formula_slip_front(formula_run *f) { return f->pt->s.s_front; }
static inline tse_real formula_slip_rear(formula_run *f) { return f->pt->s.s_rear; }
static inline tse_real formula_time(formula_run *f) { return f->pt->m->time + f->pt->ahead; }

/* ---- functions */
static inline tse_real formula_add(tse_real x, tse_real y) { return x + y; }
static inline tse_real formula_sub(tse_real x, tse_real y) { return x - y; }
static inline tse_real formula_mul(tse_real x, tse_real y) { return r_mul(x, y); }
static inline tse_real formula_div(tse_real x, tse_real y)
{
  return y < TSE_R(0) || y > TSE_R(0) ? r_div(x, y) : TSE_R(0);
}
static inline tse_real formula_neg(tse_real x) { return -x; }
static inline tse_real formula_abs(tse_real x) { return r_abs(x); }
static inline tse_real formula_max(tse_real x, tse_real y) { return x > y ? x : y; }
static inline tse_real formula_min(tse_real x, tse_real y) { return x < y ? x : y; }
static inline tse_real formula_sqrt(tse_real x) { return x > TSE_R(0) ? r_sqrt(x) : TSE_R(0); }
static inline tse_real formula_soft(tse_real x) { return r_div(x, r_sqrt(TSE_R(1) + r_mul(x, x))); }

/* ---- functions with memory
 *
 * Each occurrence of such a function in a formula keeps three numbers from step to step.
 * They are read from f->pt->m->formula[i], and stored for the next step in
 * f->next->formula[i]. i is f->used, the number of the occurrence, counted from 0. */

/* Store the three numbers a, b, c for the next step, clipped by formula_clip(), unless
 * f->next is NULL. Add 1 to f->used.
 *   Returned:  a, not clipped */
static inline tse_real formula_remembers(formula_run *f, tse_real a, tse_real b, tse_real c)
{
  if (f->next) {
    tse_real *const kept = f->next->formula[f->used];
    kept[0] = formula_clip(a);
    kept[1] = formula_clip(b);
    kept[2] = formula_clip(c);
  }
  f->used++;
  return a;
}

/* Return x after a first-order lag: y, where dy/dt = (x - y)/T. y is integrated over
 * h = f->pt->ahead by the trapezoidal rule. T is at least h/2: with a smaller T, y would
 * oscillate from step to step. In steady state (f->rest is 1) y is x.
 *   Given:  time  T [s] */
static inline tse_real formula_lag(formula_run *f, tse_real x, tse_real time)
{
  const tse_real *const was = f->pt->m->formula[f->used];
  const tse_real half = r_mul(TSE_R(0.5), f->pt->ahead);
  tse_real y = was[0];
  if (f->rest) y = x;
  else if (half > TSE_R(0)) {
    const tse_real share = time > half ? r_div(half, time) : TSE_R(1);
    y = r_div(r_mul(was[0], TSE_R(1) - share) + r_mul(share, was[1] + x), TSE_R(1) + share);
  }
  return formula_remembers(f, y, x, TSE_R(0));
}

/* Return x after a second-order lag (mode_step() in laws.h).
 *   Given:  frequency  [Hz] natural frequency; a negative value counts as 0
 *           damping    [1] damping ratio; a negative value counts as 0 */
static inline tse_real formula_second(formula_run *f, tse_real x, tse_real frequency, tse_real damping)
{
  const tse_real *const was = f->pt->m->formula[f->used];
  tse_real mode[2] = { was[0], was[1] };
  if (f->rest) {
    mode[0] = x;
    mode[1] = TSE_R(0);
  } else if (f->pt->ahead > TSE_R(0)) {
    mode_step(
        mode, formula_max(frequency, TSE_R(0)), formula_max(damping, TSE_R(0)), was[2], x, f->pt->ahead);
  }
  return formula_remembers(f, mode[0], mode[1], x);
}

/* Return x as it was `time` seconds ago. If no sample is that old, return the oldest. */
static inline tse_real formula_late(formula_run *f, tse_real x, tse_real time)
{
  const tse_real late = formula_max(time, TSE_R(0)), ahead = f->pt->ahead, back = late - ahead;
  const tse_real *const was = f->pt->m->formula_was[0];
  tse_real y = x;
  if (!f->rest && f->pt->m->formula_late.count > 0) {
    if (back >= TSE_R(0)) y = effects_delay_get(&f->pt->m->formula_late, was, back);
    else y = was[0] + r_mul(x - was[0], r_div(-back, ahead));
  }
  if (f->next) {
    const tse_real now = formula_clip(x);
    if (f->rest) f->next->formula_late.count = 0;
    effects_delay_put(&f->next->formula_late, f->next->formula_was, late, ahead, &now, 1);
  }
  return formula_remembers(f, y, TSE_R(0), TSE_R(0));
}

/* Return x after a mechanical play (backlash) of `half` to either side. If the previous
 * result is within x - half .. x + half, return it again. Otherwise return the nearer of
 * these two limits. */
static inline tse_real formula_play(formula_run *f, tse_real x, tse_real half)
{
  const tse_real wide = r_abs(half), was = f->pt->m->formula[f->used][0];
  return formula_remembers(f, f->rest ? x : formula_clamp(was, x - wide, x + wide), TSE_R(0), TSE_R(0));
}

/* Return x with its rate of change limited to +-rate, in units of x per second. */
static inline tse_real formula_limit(formula_run *f, tse_real x, tse_real rate)
{
  const tse_real max = r_mul(r_abs(rate), f->pt->ahead), was = f->pt->m->formula[f->used][0];
  return formula_remembers(f, f->rest ? x : formula_clamp(x, was - max, was + max), TSE_R(0), TSE_R(0));
}

/* Return the rate of change of x, in units of x per second: the difference quotient of x
 * over the step. */
static inline tse_real formula_rate(formula_run *f, tse_real x)
{
  const tse_real *const was = f->pt->m->formula[f->used];
  tse_real y = f->rest ? TSE_R(0) : was[0];
  if (!f->rest && f->pt->ahead > TSE_R(0)) y = r_div(x - was[1], f->pt->ahead);
  return formula_remembers(f, y, x, TSE_R(0));
}

/* ---- the program */
#if defined(TSE_FORMULA)

#include "tse_formula.h"
static inline int formula_place_of(const tse_effects *e)
{
  (void)e;
  return TSE_FORMULA_PLACE;
}

#else

static inline int formula_place_of(const tse_effects *e) { return e->formula_place; }

/* Replace the operands of an operation by its result x. The operands are the elements of
 * the stack s from index `at` to its top.
 *   Returned:  new depth of the stack */
static inline int formula_push(tse_real s[FORMULA_STACK], int at, tse_real x)
{
  s[at] = x;
  return at + 1;
}

/* Cases of the switch statement over the operations: a macro for each kind of operation.
 * The operands are the last values of the stack s, whose depth is n. */
#define FORMULA_OPERANDS_0
#define FORMULA_OPERANDS_1 s[n - 1]
#define FORMULA_OPERANDS_2 s[n - 2], s[n - 1]
#define FORMULA_OPERANDS_3 s[n - 3], s[n - 2], s[n - 1]
#define FORMULA_CASE(code, takes, value) case code: n = formula_push(s, n - (takes), value); break;
#define FORMULA_NUMBER(name, code, takes, unit, text) FORMULA_CASE(code, takes, formula_number(f, (code) - 1))
#define FORMULA_SIGNAL(name, code, takes, unit, text) FORMULA_CASE(code, takes, formula_##name(f))
#define FORMULA_PLAIN(name, code, takes, unit, text) \
  FORMULA_CASE(code, takes, formula_##name(FORMULA_OPERANDS_##takes))
#define FORMULA_MEMORY(name, code, takes, unit, text) \
  FORMULA_CASE(code, takes, formula_##name(f, FORMULA_OPERANDS_##takes))

/* Run the program of the formula and return its result. tse_config_check() has verified
 * that stack and memory are large enough. */
static inline tse_real formula_program(formula_run *f)
{
  tse_real s[FORMULA_STACK] = { TSE_R(0) };
  int n = 0;
  for (int k = 0; k < TSE_FORMULA_OPS && f->pt->p->effects.formula_code[k]; k++) {
    switch (f->pt->p->effects.formula_code[k]) {
      FORMULA_OPERATIONS(FORMULA_NUMBER, FORMULA_SIGNAL, FORMULA_PLAIN, FORMULA_MEMORY)
      default: break;
    }
  }
  return s[0];
}

#endif

/* Return the value of the formula at a point, in the unit of the quantity to which it is
 * added. For a stiffness it is a relative change. */
static inline tse_real formula_at(const point *pt)
{
  formula_run f = { pt, NULL, 0, 0 };
  return r_mul(pt->p->effects.formula_gain, formula_clip(formula_program(&f)));
}

/* If the formula acts on a slip angle, add the value of the formula to this slip angle.
 * free_angle keeps the slip angles without the formula, as its input signals. The next
 * functions apply the formula to a stiffness (multiplied by 1 + value), to a force or yaw
 * moment of the body, and to a sensor. */
static inline void formula_slip(point *pt)
{
  const int place = formula_place_of(&pt->p->effects);
  pt->free_angle[0] = pt->s.a_front;
  pt->free_angle[1] = pt->s.a_rear;
  if (place == PLACE_front_angle) pt->s.a_front += formula_at(pt);
  if (place == PLACE_rear_angle) pt->s.a_rear += formula_at(pt);
}

static inline void formula_stiffness(point *pt)
{
  const int place = formula_place_of(&pt->p->effects);
  if (place != PLACE_stiffness_front && place != PLACE_stiffness_rear) return;
  tse_real *const k = place == PLACE_stiffness_front ? &pt->k.y_front : &pt->k.y_rear;
  *k = r_mul(*k, formula_max(TSE_R(1) + formula_at(pt), TSE_R(0.02)));
}

static inline void formula_body(point *pt)
{
  const int place = formula_place_of(&pt->p->effects);
  if (place == PLACE_force_x) pt->force.x += formula_at(pt);
  if (place == PLACE_force_y) pt->force.y += formula_at(pt);
  if (place == PLACE_yaw_moment) pt->force.yaw += formula_at(pt);
}

static inline void formula_sensor(const point *pt, tse_real y[3])
{
  const int place = formula_place_of(&pt->p->effects);
  if (place >= PLACE_accel_x) y[place - PLACE_accel_x] += formula_at(pt);
}

/* If rest is 0, update the memory after the step that ended at this point. If rest is 1,
 * set the memory to steady state at this point. */
static inline void formula_remember(tse_effect_memory *m, const point *pt, int rest)
{
  formula_run f = { pt, m, rest, 0 };
  (void)formula_program(&f);
  m->formula_accel[0] = pt->force.x;
  m->formula_accel[1] = pt->force.y;
}

#endif
#endif
