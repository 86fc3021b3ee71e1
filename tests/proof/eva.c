/* What Frama-C's EVA is asked: may these functions go wrong in memory or in whole numbers, whatever they are handed?
 *
 *   PROVE_PREPARE     tse_prepare(), tse_reset(): any bits as settings
 *   PROVE_LEARNT      tse_learnt_load(): any bytes, any number of them up to twice a state's, any age
 *   PROVE_STEP        tse_step(), default form
 *   PROVE_PARTICLES   tse_step(), form 1, without effects
 *
 * Settings, rows and every real number of parameters and filter may be any bits, NaN and infinite ones, too (fixed: any number that
 * an operation of number/fixed.h may give). Whole numbers lie where tse_prepare() and tse_filter_check() want them, and it is asserted
 * that they do so after the row: so what holds for one row holds for every row after it. */
#include "model/state.h"
#include "tse/learnt.h"
#include "tse/tse.h"
#include "filter/filter.h"
#include <string.h>

#include "__fc_builtin.h"

/* Any value that a square root may have: what is asked here does not depend on it. */
double sqrt(double x)
{
  (void)x;
  return Frama_C_double_interval(0.0, 1e308);
}
float sqrtf(float x)
{
  (void)x;
  return Frama_C_float_interval(0.0f, 1e38f);
}

#if defined(TSE_REAL_FIXED) /* any number that an operation may give: `+` is native, and says nothing when it overflows */
#include "number/real_ops.h"
static void any_numbers(void *at, size_t bytes)
{
  tse_real *const x = at;
  for (size_t i = 0; i < bytes / sizeof *x; i++) x[i] = Frama_C_long_long_interval(-FIXED_MOST, FIXED_MOST);
}
#define ANY(object) any_numbers(&(object), sizeof(object))
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
static void any_filter(void)
{
  ANY(all);
  f->waiting.count = in(0, TSE_LATENCY_ROWS);
  f->waiting.newest = in(0, TSE_LATENCY_ROWS - 1);
  f->k.change_kind = in(TSE_CHANGE_NONE, TSE_CHANGE_RESTART);
  f->k.fault = in(0, TSE_CHANNELS);
  f->k.slow_turn = in(0, STATES);
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
  //@ assert whole: 0 <= f->k.slow_turn <= STATES;
  //@ assert whole: \forall integer i; 0 <= i < TSE_EVENTS ==> EVENT_NONE <= f->k.event[i].kind < EVENT_KINDS;
}

static void prove_prepare(void)
{
  static tse_config c;
  const char *wrong;
  ANY(c);
  if (tse_prepare(&c, &p, &wrong) < 0) return;
  //@ assert whole: 0 <= p.form <= 1 && 0 <= p.car.driven <= 2;
  //@ assert whole: 16 <= p.particles <= TSE_MAX_PARTICLES && 0 <= p.resampling <= 3;
  tse_reset(&p, f, sizeof all);
}

static void prove_learnt(void)
{
  static uint8_t bytes[2 * TSE_LEARNT_BYTES];
  any_params(in(0, 2));
  any_filter();
  ANY_BYTES(bytes);
  (void)tse_learnt_load(&p, f, bytes, (size_t)in(0, 2 * TSE_LEARNT_BYTES), Frama_C_unsigned_int_interval(0, UINT32_MAX));
  //@ assert whole: 0 <= f->start.loaded <= 1;
}

static void prove_step(int32_t form)
{
  any_params(form);
  any_filter();
  ANY(u);
  (void)tse_step(&p, f, &u, &out);
  still_so();
}

int main(void)
{
#if defined(PROVE_PREPARE)
  prove_prepare();
#elif defined(PROVE_LEARNT)
  prove_learnt();
#elif defined(PROVE_STEP)
  prove_step(0);
#elif defined(PROVE_PARTICLES)
  prove_step(in(1, 2));
#else
#error "say what is to be proven"
#endif
  return 0;
}
