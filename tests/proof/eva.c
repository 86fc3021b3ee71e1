/* tests/proof/eva.c - programs for Frama-C's EVA: prove that these functions have no
 * errors of memory or of integer arithmetic, for any arguments.
 *
 *   PROVE_PREPARE     tse_config_check() with any bits as settings; tse_prepare(),
 *                     tse_reset() with any settings of type real
 *   PROVE_LEARNT      tse_learnt_load() with any bytes, of any number up to twice the
 *                     size of a learnt state, and any age
 *   PROVE_STEP        tse_step() of the Kalman filter, before the first measured
 *                     velocity; PROVE_SMALL the same in a build with TSE_SMALL
 *   PROVE_VELOCITY    the same with the states of a measured velocity, and the row that
 *                     starts them
 *   PROVE_PARTICLES   tse_step() of the particle filter, without effects
 *   PROVE_NUMBERS     product, quotient and root in fixed point, of any sum of fifteen
 *                     results. In the other programs these return any result
 *
 * Settings, rows and all real numbers of parameters and filter have any bits, including
 * NaN and infinity (fixed point: any result of an operation of number/fixed.h). Integers
 * are in the ranges that tse_prepare() and tse_filter_check() enforce. After the row,
 * assertions check that they still are: by induction, the proof holds for all rows. */
#include "model/state.h"
#include "tse/learnt.h"
#include "tse/tse.h"
#include "filter/velocity.h"
#include "tables/settings.h"
#include <string.h>

#include "__fc_builtin.h"

/* Return any bits. The properties proven do not depend on square roots. */
double sqrt(double x)
{
  Frama_C_make_unknown((char *)&x, sizeof x);
  return x;
}
float sqrtf(float x)
{
  Frama_C_make_unknown((char *)&x, sizeof x);
  return x;
}

/* Set any results of operations. `+` is native and does not saturate. */
#if defined(TSE_REAL_FIXED)
#include "number/real_ops.h"
static void any_numbers(void *at, size_t bytes)
{
  tse_real *const x = at;
  for (size_t i = 0; i < bytes / sizeof *x; i++) x[i] = Frama_C_long_long_interval(-FIXED_MOST, FIXED_MOST);
}
#define ANY(object) any_numbers(&(object), sizeof(object))
#if defined(PROVE_NUMBERS)
static void prove_numbers(void)
{
  const int64_t most = 15 * (FIXED_MOST - 1), a = Frama_C_long_long_interval(-most, most),
                b = Frama_C_long_long_interval(-most, most);
  const int64_t product = fixed_mul_halves(a, b), quotient = fixed_div_halves(a, b),
                root = fixed_sqrt_digits(a);
  //@ assert number: -FIXED_MOST <= quotient <= FIXED_MOST;
  //@ assert number: -FIXED_MOST <= product <= FIXED_MOST;
  //@ assert number: 0 <= root <= FIXED_MOST;
}
#else
tse_real r_mul(tse_real a, tse_real b)
{
  return (void)a, (void)b, Frama_C_long_long_interval(-FIXED_MOST, FIXED_MOST);
}
tse_real r_div(tse_real a, tse_real b)
{
  return (void)a, (void)b, Frama_C_long_long_interval(-FIXED_MOST, FIXED_MOST);
}
tse_real r_sqrt(tse_real x) { return (void)x, Frama_C_long_long_interval(0, FIXED_MOST); }
#endif
#else
#define ANY(object) Frama_C_make_unknown((char *)&(object), sizeof(object))
#endif
#define ANY_BYTES(object) Frama_C_make_unknown((char *)&(object), sizeof(object))

static tse_params p;
static tse_filter_paper all;
static tse_filter *const f = &all.filter;
static tse_input u;
static tse_output out;

static int32_t in(int32_t lo, int32_t hi) { return Frama_C_interval(lo, hi); }

static void any_params(int32_t form)
{
  ANY(p);
  p.form = form;
  p.car.driven = in(0, 2);
  p.particles = in(16, TSE_MAX_PARTICLES);
  p.resampling = in(0, 3);
  p.integration = in(0, 2);
  p.effects.mask = 0;
}

/* Set any filter with integers in the ranges that host/sound.c checks. */
static void any_filter(int32_t extras)
{
  ANY(all);
  f->started = in(0, 1);
  f->start.loaded = in(0, 1);
  f->waiting.count = in(0, TSE_LATENCY_ROWS);
  f->waiting.newest = in(0, TSE_LATENCY_KEPT - 1);
  f->k.change_kind = in(TSE_CHANGE_NONE, TSE_CHANGE_RESTART);
  f->k.fault = in(0, TSE_CHANNELS);
  f->k.slow_turn = in(0, TSE_SLOW - 1);
  f->k.ud.extras = extras;
  f->k.velocity.kept = in(0, TSE_PAST);
  f->k.agreement.apart = in(0, (1 << (TSE_PAIRS + 3)) - 1);
  for (int i = 0; i < TSE_EVENTS; i++) f->k.event[i].kind = in(EVENT_NONE, EVENT_KINDS - 1);
  for (int i = 0; i < TSE_STRIDE; i++) {
    all.ancestor[i] = (uint16_t)in(0, TSE_MAX_PARTICLES - 1);
    all.copies[i] = (uint16_t)in(0, TSE_MAX_PARTICLES);
  }
}

/* Check the assumptions of any_filter() for the filter after the row. */
static void still_so(void)
{
  //@ assert whole: 0 <= f->waiting.count <= TSE_LATENCY_ROWS;
  //@ assert whole: f->waiting.newest == 0 || 0 <= f->waiting.newest < TSE_LATENCY_ROWS;
  //@ assert whole: 0 <= f->k.change_kind <= TSE_CHANGE_RESTART && 0 <= f->k.fault <= TSE_CHANNELS;
  //@ assert whole: 0 <= f->k.slow_turn < TSE_SLOW;
  //@ assert whole: f->k.ud.extras == 0 || f->k.ud.extras == MAX_EXTRAS;
  //@ assert whole: 0 <= f->k.velocity.kept <= TSE_PAST && 0 <= f->k.agreement.apart < (1 << (TSE_PAIRS + 3));
  //@ assert whole: \forall integer i; 0 <= i < TSE_EVENTS ==> EVENT_NONE <= f->k.event[i].kind < EVENT_KINDS;
}

#define WITHIN(fmu, name, def, exact, lo, hi, unit, text) c.name = in(lo, hi);
#if defined(TSE_REAL_FIXED) /* sums of unlimited numbers could overflow */
#define REAL_WITHIN(fmu, name, def, exact, lo, hi, unit, text) \
  c.name = Frama_C_long_long_interval(TSE_S(lo), TSE_S(hi));
#else
#define REAL_WITHIN NO_ROW
#endif

static void prove_prepare(void)
{
  static tse_config c;
  const char *wrong;
  ANY(c);
  if (tse_config_check(&c, &wrong) < 0) return;
  /* tse_config_check() ensures these ranges in a loop over a table, on copies of the
   * settings. EVA does not relate a copy to its original. */
  SETTINGS(REAL_WITHIN, WITHIN)
  if (tse_prepare(&c, &p, &wrong) < 0) return;
  //@ assert whole: 0 <= p.form <= 1 && 0 <= p.car.driven <= 2;
  //@ assert whole: 16 <= p.particles <= TSE_MAX_PARTICLES && 0 <= p.resampling <= 3;
  tse_reset(&p, f, sizeof all);
}

static void prove_learnt(void)
{
  static uint8_t bytes[2 * TSE_LEARNT_BYTES];
  any_params(in(0, 2));
  any_filter(0);
  ANY_BYTES(bytes);
  (void)tse_learnt_load(
      &p, f, bytes, (size_t)in(0, 2 * TSE_LEARNT_BYTES), Frama_C_unsigned_int_interval(0, UINT32_MAX));
  //@ assert whole: 0 <= f->start.loaded <= 1;
}

/* Prove tse_step(). The first row and a row after a restart have no states of a velocity.
 *   Given:  given  bits of tse_input.given that may be set */
static void prove_step(int32_t form, int32_t extras, uint32_t given)
{
  any_params(form);
  any_filter(extras);
  if (extras) f->step = Frama_C_unsigned_int_interval(1, UINT32_MAX);
  ANY(u);
  u.given = Frama_C_unsigned_int_interval(0, UINT32_MAX) & given;
  (void)tse_step(&p, f, &u, &out);
  still_so();
}

#if defined(PROVE_VELOCITY)
static void prove_start_of_velocity(void)
{
  static decoded z;
  static forces now;
  static tse_real change[TSE_ALL];
  any_params(0);
  any_filter(0);
  ANY(z);
  ANY(now);
  ANY(change);
  velocity_update(&p, &f->k, &z, &now, change);
  still_so();
}
#endif

int main(void)
{
#if defined(PROVE_NUMBERS)
  prove_numbers();
#elif defined(PROVE_PREPARE)
  prove_prepare();
#elif defined(PROVE_LEARNT)
  prove_learnt();
#elif defined(PROVE_STEP) || defined(PROVE_SMALL)
  prove_step(0, 0, ~(uint32_t)TSE_GIVEN_VELOCITIES);
#elif defined(PROVE_VELOCITY)
  if (in(0, 1)) prove_start_of_velocity();
  else prove_step(0, TSE_EXTRAS, UINT32_MAX);
#elif defined(PROVE_PARTICLES)
  prove_step(in(1, 2), 0, UINT32_MAX);
#else
#error "define one of PROVE_PREPARE .. PROVE_NUMBERS"
#endif
  return 0;
}
