/* What Frama-C's EVA is asked: may these functions go wrong in memory or in whole
 * numbers, whatever they are handed?
 *
 *   PROVE_PREPARE     tse_config_check(), any bits as settings; tse_prepare(),
 *                     tse_reset(): any real settings
 *   PROVE_LEARNT      tse_learnt_load(): any bytes, any number of them up to twice a
 *                     state's, any age
 *   PROVE_STEP        tse_step(), default form, no velocity measured yet; PROVE_SMALL the
 *                     same of a build with TSE_SMALL
 *   PROVE_VELOCITY    the same with states of a measured velocity; and the row that
 *                     brings them into use, from there on
 *   PROVE_PARTICLES   tse_step(), form 1, without effects
 *   PROVE_NUMBERS     product, quotient and root of fixed point, of any sum of fifteen
 *                     results; in all the others these give any result
 *
 * Settings, rows and every real number of parameters and filter may be any bits, NaN and
 * infinite ones, too (fixed: any number that an operation of number/fixed.h may give).
 * Whole numbers lie where tse_prepare() and tse_filter_check() want them, and it is
 * asserted that they do so after the row: so what holds for one row holds for every row
 * after it. */
#include "model/state.h"
#include "tse/learnt.h"
#include "tse/tse.h"
#include "filter/filter.h"
#include "tables/settings.h"
#include <string.h>

#include "__fc_builtin.h"

/* Any bits: what is asked here does not depend on a square root. */
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

/* any number that an operation may give: `+` is native, and says nothing when it overflows */
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

/* The ranges of host/sound.c. */
static void any_filter(int32_t extras)
{
  ANY(all);
  f->started = in(0, 1);
  f->start.loaded = in(0, 1);
  f->waiting.count = in(0, TSE_LATENCY_ROWS);
  f->waiting.newest = in(0, TSE_LATENCY_ROWS - 1);
  f->k.change_kind = in(TSE_CHANGE_NONE, TSE_CHANGE_RESTART);
  f->k.fault = in(0, TSE_CHANNELS);
  f->k.slow_turn = in(0, TSE_SLOW - 1);
  f->k.ud.extras = extras;
  f->k.velocity.kept = in(0, TSE_PAST);
  f->k.agreement.apart = in(0, (1 << TSE_PAIRS) - 1);
  for (int i = 0; i < TSE_EVENTS; i++) f->k.event[i].kind = in(EVENT_NONE, EVENT_KINDS - 1);
  for (int i = 0; i < TSE_STRIDE; i++) {
    all.ancestor[i] = (uint16_t)in(0, TSE_MAX_PARTICLES - 1);
    all.copies[i] = (uint16_t)in(0, TSE_MAX_PARTICLES);
  }
}

/* What any_filter() took for granted, of the filter that the row leaves. */
static void still_so(void)
{
  //@ assert whole: 0 <= f->waiting.count <= TSE_LATENCY_ROWS && 0 <= f->waiting.newest < TSE_LATENCY_ROWS;
  //@ assert whole: 0 <= f->k.change_kind <= TSE_CHANGE_RESTART && 0 <= f->k.fault <= TSE_CHANNELS;
  //@ assert whole: 0 <= f->k.slow_turn < TSE_SLOW;
  //@ assert whole: f->k.ud.extras == 0 || f->k.ud.extras == MOST_EXTRAS;
  //@ assert whole: 0 <= f->k.velocity.kept <= TSE_PAST && 0 <= f->k.agreement.apart < (1 << TSE_PAIRS);
  //@ assert whole: \forall integer i; 0 <= i < TSE_EVENTS ==> EVENT_NONE <= f->k.event[i].kind < EVENT_KINDS;
}

#define WITHIN(fmu, name, def, exact, lo, hi, unit, text) c.name = in(lo, hi);
#if defined(TSE_REAL_FIXED) /* a sum of numbers of any size says nothing when it overflows */
#define REAL_WITHIN(fmu, name, def, exact, lo, hi, unit, text) c.name = Frama_C_long_long_interval(TSE_S(lo), TSE_S(hi));
#else
#define REAL_WITHIN NO_ROW
#endif

static void prove_prepare(void)
{
  static tse_config c;
  const char *wrong;
  ANY(c);
  if (tse_config_check(&c, &wrong) < 0) return;
  SETTINGS(REAL_WITHIN,
      /* which it holds them to, by a loop over a table; EVA does not see that a copy
       * of a number is the number */
      WITHIN)
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

/* given: bits of tse_input.given that may be there. The first row, and one that
     * starts the filter again, has no states of a velocity. */
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
#error "say what is to be proven"
#endif
  return 0;
}
