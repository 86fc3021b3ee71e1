/* tests/fmu/unit/test_random.c - importers that do anything, in any order, with any settings in range and any input: nothing
 * breaks, every refusal is said once and changes nothing. Under the sanitizers of the preset dev this is a fuzz test. */
#include "fmu_case.h"

#if !defined(SEED)
#define SEED 20240607u
#endif
static uint32_t word = SEED;

static uint32_t next_word(void)
{
  word = word * 1664525u + 1013904223u;
  return word ^ (word >> 15);
}
static double uniform(void) { return (next_word() + 0.5) / 4294967296.0; }
static int below(int n) { return (int)(uniform() * n); }

/* Mostly in range, often near its ends, now and then not a number. */
static double value_for(const fmu_variable *v)
{
  static const double odd[] = { 0.0, 1.0, -1.0, 1e-300, 1e300, -1e300 };
  const double lo = v->hi >= v->lo ? v->lo : -100.0, hi = v->hi >= v->lo ? v->hi : 100.0;
  switch (below(12)) {
    case 0: return lo;
    case 1: return hi;
    case 2: return v->kind == 'r' && below(4) == 0 ? odd[below(COUNT(odd))] : v->start;
    case 3: return v->kind == 'r' && below(6) == 0 ? (double)NAN : v->start;
    case 4: return v->kind == 'r' && below(6) == 0 ? (double)INFINITY : v->start;
    case 5:
    case 6: return lo + (hi - lo) * uniform();
    default: return v->start + 0.01 * (hi - lo) * (uniform() - 0.5);
  }
}

static fmi2Status set_any(fmi2Component c)
{
  const int32_t i = below(fmu_variable_count);
  const fmu_variable *const v = &fmu_variables[i];
  const fmi2ValueReference vr = (fmi2ValueReference)i;
  const double x = value_for(v);
  const fmi2Integer k = x > -2147483648.0 && x < 2147483647.0 ? (fmi2Integer)x : 0;
  const fmi2Boolean b = k > 0;
  return v->kind == 'r'   ? fmi2SetReal(c, &vr, 1, &x)
         : v->kind == 'b' ? fmi2SetBoolean(c, &vr, 1, &b)
                          : fmi2SetInteger(c, &vr, 1, &k);
}

static fmi2Status set_any_inputs(fmi2Component c)
{
  for (int32_t i = 0; i < fmu_variable_count; i++) {
    const fmu_variable *const v = &fmu_variables[i];
    const fmi2ValueReference vr = (fmi2ValueReference)i;
    if (v->role != 'i' || v->kind != 'r' || below(3) == 0) continue;
    const double x = value_for(v);
    const fmi2Status status = fmi2SetReal(c, &vr, 1, &x);
    if (status != fmi2OK) return status;
  }
  return fmi2OK;
}

static fmi2Status get_all(fmi2Component c)
{
  for (int32_t i = 0; i < fmu_variable_count; i++) {
    const fmi2ValueReference vr = (fmi2ValueReference)i;
    fmi2Real r;
    fmi2Integer k;
    fmi2Boolean b;
    const char kind = fmu_variables[i].kind;
    const fmi2Status status = kind == 'r'   ? fmi2GetReal(c, &vr, 1, &r)
                              : kind == 'b' ? fmi2GetBoolean(c, &vr, 1, &b)
                                            : fmi2GetInteger(c, &vr, 1, &k);
    if (status != fmi2OK) return status;
  }
  return fmi2OK;
}

static double clock_of(fmi2Component c)
{
  fmi2Real time = 0;
  OK(fmi2GetRealStatus(c, fmi2LastSuccessfulTime, &time));
  return time;
}

static fmi2Status any_call(fmi2Component c, fmi2FMUstate *kept, saved_bytes *before)
{
  static const double sizes[] = { 0.01, 0.01, 0.001, 0.1, 0.5, 1.0, 7.0, 0.0 };
  const int what = below(40);
  if (what < 18 && below(3)) (void)set_any_inputs(c);
  said = 0;
  *before = bytes_of(c);
  if (what < 18) return fmi2DoStep(c, below(30) ? clock_of(c) : uniform(), sizes[below(COUNT(sizes))], fmi2True);
  if (what < 25) return set_any(c);
  switch (what) {
    case 25:
    case 26: return fmi2EnterInitializationMode(c);
    case 27:
    case 28: return fmi2ExitInitializationMode(c);
    case 29: return below(4) ? fmi2OK : fmi2Terminate(c);
    case 30: return below(4) ? fmi2OK : fmi2Reset(c);
    case 31: return fmi2SetupExperiment(c, fmi2False, 0, 10 * uniform(), fmi2False, 0);
    case 32: return fmi2GetFMUstate(c, kept);
    case 33: return *kept ? fmi2SetFMUstate(c, *kept) : fmi2OK;
    case 34: return fmi2FreeFMUstate(c, kept);
    case 35: {
      const fmi2ValueReference vr = (fmi2ValueReference)below(fmu_variable_count + 2);
      const fmi2Integer order = 1 + (below(5) == 0);
      const fmi2Real rate = uniform() - 0.5;
      return fmi2SetRealInputDerivatives(c, &vr, 1, &order, &rate);
    }
    default: return get_all(c);
  }
}

static void test_no_sequence_of_calls_breaks_anything(void)
{
  int refused = 0, done = 0, steps = 0;
  for (int round = 0; round < 60; round++) {
    fmi2Component const c = instantiated();
    fmi2FMUstate kept = NULL;
#if defined(CASE_ESTIMATOR)
    OK(put_integer(c, "filter.particles", 16 + below(30)));
#endif
    for (int k = 0; k < 8; k++) (void)set_any(c); /* settings in range, some at their ends */
    if (below(4)) {
      (void)fmi2EnterInitializationMode(c);
      (void)fmi2ExitInitializationMode(c);
    }
    for (int k = 0; k < 120; k++) {
      saved_bytes before;
      const fmi2Status status = any_call(c, &kept, &before);
      TEST_ASSERT_TRUE_MESSAGE(status == fmi2OK || status == fmi2Warning || status == fmi2Error, last_line());
      TEST_ASSERT_TRUE_MESSAGE(status == fmi2Error ? said == 1 : said <= 1, last_line());
      refused += status == fmi2Error;
      done += status != fmi2Error;
      steps += status != fmi2Error && clock_of(c) > 0.0;
      if (status == fmi2Error) expect_unchanged(c, &before, last_line());
      free(before.at);
    }
    (void)fmi2FreeFMUstate(c, &kept);
    fmi2FreeInstance(c);
    made_count--;
  }
  TEST_ASSERT_TRUE(refused > 500 && done > 2000 && steps > 1000);
}

/* Long drives with random settings: what is put out stays a number, whatever the inputs were. */
static void test_outputs_are_numbers_with_any_settings_and_inputs(void)
{
  int steps = 0;
  for (int round = 0; round < 25; round++) {
    fmi2Component const c = instantiated();
#if defined(CASE_ESTIMATOR)
    OK(put_integer(c, "filter.particles", 16 + below(30)));
#endif
    for (int k = 0; k < 6; k++) {
      const int32_t i = below(fmu_variable_count);
      if (fmu_variables[i].role == 'p') (void)set_any(c);
    }
    OK(fmi2EnterInitializationMode(c));
    while (fmi2ExitInitializationMode(c) != fmi2OK) (void)set_any_inputs(c); /* an input was out of range */
    for (int k = 0; k < 150; k++) {
      if (k % 10 == 0) (void)set_any_inputs(c);
      if (fmi2DoStep(c, clock_of(c), 0.01, fmi2True) == fmi2Error) continue; /* the next inputs may be in range */
      steps++;
      for (int32_t i = 0; i < fmu_variable_count; i++)
        if (fmu_variables[i].role == 'o' && fmu_variables[i].kind == 'r') {
          const double x = real_of(c, fmu_variables[i].name);
          if (!(x - x == 0.0)) {
            char text[200];
            (void)snprintf(text, sizeof text, "round %d, step %d: %s is %g", round, k, fmu_variables[i].name, x);
            TEST_FAIL_MESSAGE(text);
          }
        }
    }
    const saved_bytes b = bytes_of(c); /* and the state is one that is accepted back */
    fmi2FMUstate again = NULL;
    OK(fmi2DeSerializeFMUstate(c, b.at, b.count, &again));
    free(b.at);
    fmi2FreeInstance(c);
    made_count--;
  }
  TEST_ASSERT_TRUE(steps > 1000); /* the other rows had an input out of range */
}

int main(void)
{
  UNITY_BEGIN();
  RUN_TEST(test_no_sequence_of_calls_breaks_anything);
  RUN_TEST(test_outputs_are_numbers_with_any_settings_and_inputs);
  return UNITY_END();
}
