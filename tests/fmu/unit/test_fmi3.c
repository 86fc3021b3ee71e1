/* tests/fmu/unit/test_fmi3.c - the functions of FMI 3.0, called by an importer in allowed
 * and forbidden ways, and compared with those of 2.0, which are linked with the same
 * model: the same inputs and steps give the same bits. */
#include "fmi3Functions.h"
#include "fmu_case.h"

/* ---- an importer */

static void logger3(
    fmi3InstanceEnvironment environment, fmi3Status status, fmi3String category, fmi3String text)
{
  logger(environment, "", (fmi2Status)status, category, text);
}

/* Tests free their remaining instances by the functions of 2.0 (tearDown): one pool holds
 * the instances of both versions. */
static fmi3Instance instantiated3(void)
{
  fmi3Instance const c = fmi3InstantiateCoSimulation("three", FMU_GUID, "/nowhere/resources/", fmi3False,
      fmi3False, fmi3False, fmi3True, NULL, 0, &here, logger3, NULL);
  TEST_ASSERT_NOT_NULL_MESSAGE(c, last_line());
  made[made_count++] = c;
  return c;
}

static void free_all(void)
{
  while (made_count > 0) fmi3FreeInstance(made[--made_count]);
}

#define OK3(call) TEST_ASSERT_EQUAL_INT_MESSAGE(fmi3OK, (call), last_line())
#define REFUSED3(call, ...)                                               \
  do {                                                                    \
    const int said_before_ = said;                                        \
    const fmi2Status status_ = (fmi2Status)(call);                        \
    expect_refused(status_, said_before_, __VA_ARGS__, NULL);             \
  } while (0)

static uint32_t time_reference(void) { return (uint32_t)(fmu_variable_count + fmu_array_count); }

static double number3(fmi3Instance c, fmi3ValueReference vr, char kind)
{
  double real = 0;
  fmi3Int32 integer = 0;
  fmi3Int64 code = 0;
  fmi3Boolean flag = fmi3False;
  if (kind == 'r') OK3(fmi3GetFloat64(c, &vr, 1, &real, 1));
  else if (kind == 'i') OK3(fmi3GetInt32(c, &vr, 1, &integer, 1));
  else if (kind == 'e') OK3(fmi3GetInt64(c, &vr, 1, &code, 1));
  else OK3(fmi3GetBoolean(c, &vr, 1, &flag, 1));
  return kind == 'r' ? real : kind == 'i' ? (double)integer : kind == 'e' ? (double)code : (double)flag;
}

/* Compare bits: two NaN are equal. */
static void expect_same_number(double a, double b, const char *name)
{
  TEST_ASSERT_TRUE_MESSAGE(memcmp(&a, &b, sizeof a) == 0, name);
}

static void expect_same_variables(fmi2Component two, fmi3Instance three)
{
  for (int32_t i = 0; i < fmu_variable_count; i++) {
    const fmu_variable *const v = &fmu_variables[i];
    expect_same_number(value_of(two, v), number3(three, (fmi3ValueReference)i, v->kind), v->name);
  }
}

static void put3(fmi3Instance c, const char *name, double value)
{
  const fmi3ValueReference vr = ref(name);
  OK3(fmi3SetFloat64(c, &vr, 1, &value, 1));
}

static void prepare3(fmi3Instance c)
{
#if defined(CASE_ESTIMATOR)
  const fmi3ValueReference vr = ref("filter.particles");
  const fmi3Int32 particles = 60;
  OK3(fmi3SetInt32(c, &vr, 1, &particles, 1));
#else
  (void)c;
#endif
}

/* Set the inputs of set_inputs() in both versions. */
static void copy_inputs(fmi2Component from, fmi3Instance to)
{
  for (int32_t i = 0; i < fmu_variable_count; i++)
    if (fmu_variables[i].role == 'i' && fmu_variables[i].kind == 'r')
      put3(to, fmu_variables[i].name, value_of(from, &fmu_variables[i]));
}

static void enter3(fmi3Instance c)
{
  OK3(fmi3EnterInitializationMode(c, fmi3False, 0.0, 0.0, fmi3False, 0.0));
  OK3(fmi3ExitInitializationMode(c));
}

static fmi3Instance stepping3(void)
{
  fmi3Instance const c = instantiated3();
  prepare3(c);
  enter3(c);
  return c;
}

static fmi3Status step3(fmi3Instance c, int k)
{
  fmi3Boolean event = fmi3True, terminate = fmi3True, early = fmi3True;
  fmi3Float64 last = -1.0;
  const fmi3Status status = fmi3DoStep(c, k * STEP, STEP, fmi3True, &event, &terminate, &early, &last);
  TEST_ASSERT_FALSE(event || terminate || early);
  TEST_ASSERT_TRUE(last == (status <= fmi3Warning ? k * STEP + STEP : number3(c, time_reference(), 'r')));
  return status;
}

/* Run steps `first` .. `last` - 1, beside an instance of 2.0 with the same inputs. */
static void stepped3(fmi3Instance c, int first, int last)
{
  fmi2Component const source = instantiated();
  for (int k = first; k < last; k++) {
    set_inputs(source, k);
    copy_inputs(source, c);
    OK3(step3(c, k));
  }
  drop(source);
}

typedef struct bytes3 {
  fmi3Byte at[1 << 18];
  size_t count;
} bytes3;

static void save3(fmi3Instance c, bytes3 *b)
{
  fmi3FMUState state = NULL;
  OK3(fmi3GetFMUState(c, &state));
  OK3(fmi3SerializedFMUStateSize(c, state, &b->count));
  TEST_ASSERT_TRUE(b->count <= sizeof b->at);
  OK3(fmi3SerializeFMUState(c, state, b->at, b->count));
  OK3(fmi3FreeFMUState(c, &state));
  TEST_ASSERT_NULL(state);
}

static int same_state(fmi3Instance c, const bytes3 *before)
{
  static bytes3 now;
  save3(c, &now);
  return now.count == before->count && memcmp(now.at, before->at, now.count) == 0;
}
static bytes3 before, other;

/* ---- the same bits */

static void test_every_variable_has_the_bits_of_fmi_2_over_a_drive(void)
{
  fmi2Component const two = instantiated();
  fmi3Instance const three = instantiated3();
  OK(put_real(two, ANOTHER_PARAMETER, 1777.5));
  put3(three, ANOTHER_PARAMETER, 1777.5);
  prepare3(three);
  expect_same_number(number3(three, ref(ANOTHER_PARAMETER), 'r'), 1777.5, ANOTHER_PARAMETER);
  initialized(two);
  enter3(three);
  expect_same_variables(two, three);
  for (int k = 0; k < 60; k++) {
    set_inputs(two, k);
    copy_inputs(two, three);
    OK(fmi2DoStep(two, k * STEP, STEP, fmi2True));
    OK3(step3(three, k));
    expect_same_variables(two, three);
  }
  OK3(fmi3Terminate(three));
  double end = 0;
  OK(fmi2GetRealStatus(two, fmi2LastSuccessfulTime, &end));
  expect_same_number(end, number3(three, time_reference(), 'r'), "time after the end");
}

/* Give every element of an array of the instance a value of its own. A state may have any
 * outputs: they are not checked. */
static void make_elements_differ(fmi3Instance c)
{
  const size_t frame = 32, at_model = frame + 24; /* as in test_state.c */
  fmi3FMUState state = NULL;
  save3(c, &other);
  for (int32_t k = 0; k < fmu_array_count; k++)
    for (int32_t e = 0; e < fmu_arrays[k].count; e++) {
      const fmu_variable *const of = &fmu_arrays[k].of;
      fmi3Byte *const at = other.at + at_model + of->offset;
      const int32_t whole = of->kind == 'b' ? e % 2 : e + 1;
      const double real = 0.1 * e + k;
      if (of->kind == 'r') memcpy(at + (size_t)e * sizeof real, &real, sizeof real);
      else memcpy(at + (size_t)e * sizeof whole, &whole, sizeof whole);
    }
  uint64_t sum = 14695981039346656037u;
  for (size_t i = frame; i < other.count; i++) sum = (sum ^ other.at[i]) * 1099511628211u;
  memcpy(other.at + 24, &sum, sizeof sum);
  OK3(fmi3DeserializeFMUState(c, other.at, other.count, &state));
  OK3(fmi3SetFMUState(c, state));
  OK3(fmi3FreeFMUState(c, &state));
}

/* Each element of an array equals the output in its place. */
static void test_an_array_is_the_outputs_that_it_is_made_of(void)
{
  fmi3Instance const c = stepping3();
  stepped3(c, 0, 30);
  make_elements_differ(c);
  for (int32_t k = 0; k < fmu_array_count; k++) {
    const fmu_array *const a = &fmu_arrays[k];
    const fmi3ValueReference vr = (fmi3ValueReference)(fmu_variable_count + k);
    const int32_t size = a->of.kind == 'r' ? (int32_t)sizeof(tse_real) : (int32_t)sizeof(int32_t);
    double real[16];
    fmi3Int64 code[16];
    fmi3Boolean flag[16];
    TEST_ASSERT_TRUE(a->count > 1 && a->count <= 16);
    const size_t count = (size_t)a->count;
    if (a->of.kind == 'r') OK3(fmi3GetFloat64(c, &vr, 1, real, count));
    else if (a->of.kind == 'e') OK3(fmi3GetInt64(c, &vr, 1, code, count));
    else OK3(fmi3GetBoolean(c, &vr, 1, flag, count));
    for (int32_t e = 0; e < a->count; e++) {
      int32_t i = 0;
      while (i < fmu_variable_count
          && (fmu_variables[i].role != 'o' || fmu_variables[i].kind != a->of.kind
              || fmu_variables[i].offset != a->of.offset + e * size))
        i++;
      TEST_ASSERT_TRUE_MESSAGE(i < fmu_variable_count, a->of.name);
      TEST_ASSERT_EQUAL_STRING_MESSAGE(a->of.unit, fmu_variables[i].unit, a->of.name);
      expect_same_number(number3(c, (fmi3ValueReference)i, a->of.kind),
          a->of.kind == 'r'       ? real[e]
              : a->of.kind == 'e' ? (double)code[e]
                                  : (double)flag[e],
          a->of.name);
    }
  }
}

static void test_arrays_and_single_values_come_in_the_order_of_the_call(void)
{
  fmi3Instance const c = stepping3();
  stepped3(c, 0, 10);
  const fmi3ValueReference array = (fmi3ValueReference)fmu_variable_count,
                           vr[] = { ref(AN_OUTPUT), array, time_reference(), array };
  const size_t n = (size_t)fmu_arrays[0].count;
  double value[40] = { 0 }, alone[16];
  TEST_ASSERT_TRUE(2 + 2 * n < 40);
  OK3(fmi3GetFloat64(c, vr, 4, value, 2 + 2 * n));
  OK3(fmi3GetFloat64(c, &array, 1, alone, n));
  expect_same_number(number3(c, ref(AN_OUTPUT), 'r'), value[0], "first");
  TEST_ASSERT_EQUAL_INT(0, memcmp(alone, value + 1, n * sizeof *alone));
  TEST_ASSERT_TRUE(value[1 + n] == 9 * STEP + STEP);
  TEST_ASSERT_EQUAL_INT(0, memcmp(alone, value + 2 + n, n * sizeof *alone));
}

/* ---- refusals change nothing */

static void test_values_must_be_as_many_as_the_variables_have(void)
{
  fmi3Instance const c = stepping3();
  const fmi3ValueReference array = (fmi3ValueReference)fmu_variable_count, vr[] = { ref(AN_INPUT), array },
                           in[] = { ref(AN_INPUT), ref(AN_INPUT) };
  const size_t n = (size_t)fmu_arrays[0].count;
  double value[40];
  save3(c, &before);
  for (size_t i = 0; i < 40; i++) value[i] = 42.0;
  const size_t wrong[] = { 0, 1, 2, n, n + 2, 39 };
  for (int i = 0; i < COUNT(wrong); i++)
    REFUSED3(fmi3GetFloat64(c, vr, 2, value, wrong[i]), "fmi3GetFloat64", "nValues is", "4 values");
  REFUSED3(fmi3GetFloat64(c, NULL, 0, NULL, 1), "fmi3GetFloat64", "nValues is 1", "0 values");
  REFUSED3(fmi3SetFloat64(c, in, 2, value, 1), "fmi3SetFloat64", "nValues is 1", "2 values");
  REFUSED3(fmi3SetFloat64(c, in, 2, value, 3), "fmi3SetFloat64", "nValues is 3");
  REFUSED3(fmi3SetFloat64(c, NULL, 0, NULL, 1), "fmi3SetFloat64", "nValues is 1");
  REFUSED3(fmi3SetInt32(c, NULL, 0, NULL, 2), "fmi3SetInt32", "nValues is 2");
  REFUSED3(fmi3GetBoolean(c, NULL, 0, NULL, 2), "fmi3GetBoolean", "nValues is 2");
  for (size_t i = 0; i < 40; i++) TEST_ASSERT_TRUE(value[i] == 42.0);
  OK3(fmi3GetFloat64(c, NULL, 0, NULL, 0));
  OK3(fmi3SetBoolean(c, NULL, 0, NULL, 0));
  TEST_ASSERT_TRUE(same_state(c, &before));
}

static void test_arguments_that_are_missing_or_of_another_type_are_named(void)
{
  fmi3Instance const c = stepping3();
  const fmi3ValueReference real = ref(AN_INPUT), integer = ref(AN_INTEGER), flag = ref(A_FLAG),
                           none = time_reference() + 1;
  double x = 0;
  fmi3Int32 i = 0;
  fmi3Boolean b = fmi3False;
  union {
    float f;
    int8_t i8;
    uint8_t u8;
    int16_t i16;
    uint16_t u16;
    uint32_t u32;
    int64_t i64;
    uint64_t u64;
    fmi3Clock clock;
    fmi3String s;
    fmi3Binary bin;
  } u = { 0 };
  size_t size = 0;
  save3(c, &before);
  REFUSED3(fmi3GetFloat64(c, NULL, 1, &x, 1), "valueReferences is NULL");
  REFUSED3(fmi3GetFloat64(c, &real, 1, NULL, 1), "values is NULL");
  REFUSED3(fmi3SetFloat64(c, NULL, 1, &x, 1), "valueReferences is NULL");
  REFUSED3(fmi3SetFloat64(c, &real, 1, NULL, 1), "values is NULL");
  REFUSED3(fmi3GetFloat64(c, &none, 1, &x, 1), "unknown value reference");
  REFUSED3(fmi3GetFloat64(c, &integer, 1, &x, 1), AN_INTEGER, "of type Int32, not Float64");
  REFUSED3(fmi3GetFloat64(c, &flag, 1, &x, 1), A_FLAG, "of type Boolean, not Float64");
  REFUSED3(fmi3GetInt32(c, &real, 1, &i, 1), AN_INPUT, "of type Float64, not Int32");
  REFUSED3(fmi3SetInt32(c, &real, 1, &i, 1), "of type Float64, not Int32");
  REFUSED3(fmi3GetBoolean(c, &real, 1, &b, 1), "of type Float64, not Boolean");
  REFUSED3(fmi3SetBoolean(c, &real, 1, &b, 1), "of type Float64, not Boolean");
#if defined(CASE_ESTIMATOR)
  const fmi3ValueReference code = ref("estimate.status");
  REFUSED3(fmi3GetInt32(c, &code, 1, &i, 1), "estimate.status", "of type Enumeration, not Int32");
  REFUSED3(fmi3GetFloat64(c, &code, 1, &x, 1), "of type Enumeration, not Float64");
#endif
#define ANOTHER(type, variable, its, at)                                                                     \
  REFUSED3(fmi3Get##type(c, &variable, 1, &at, 1), "fmi3Get" #type, "of type " its ", not " #type);          \
  REFUSED3(fmi3Set##type(c, &variable, 1, &at, 1), "fmi3Set" #type, "of type " its ", not " #type)
  ANOTHER(Float32, real, "Float64", u.f);
  ANOTHER(Int8, real, "Float64", u.i8);
  ANOTHER(UInt8, real, "Float64", u.u8);
  ANOTHER(Int16, real, "Float64", u.i16);
  ANOTHER(UInt16, real, "Float64", u.u16);
  ANOTHER(UInt32, integer, "Int32", u.u32);
  ANOTHER(Int64, integer, "Int32", u.i64);
  ANOTHER(UInt64, real, "Float64", u.u64);
  ANOTHER(String, real, "Float64", u.s);
  REFUSED3(fmi3GetBinary(c, &real, 1, &size, &u.bin, 1), "not Binary");
  REFUSED3(fmi3SetBinary(c, &real, 1, &size, &u.bin, 1), "not Binary");
  REFUSED3(fmi3GetClock(c, &real, 1, &u.clock), "not Clock");
  REFUSED3(fmi3SetClock(c, &real, 1, &u.clock), "not Clock");
  OK3(fmi3GetFloat32(c, NULL, 0, NULL, 0));
  OK3(fmi3GetClock(c, NULL, 0, NULL));
  REFUSED3(fmi3GetFMUState(c, NULL), "FMUState is NULL");
  REFUSED3(fmi3SetFMUState(c, NULL), "FMUState is NULL");
  REFUSED3(fmi3SetDebugLogging(c, fmi3True, 1, NULL), "categories is NULL");
  TEST_ASSERT_TRUE(same_state(c, &before));
}

static void test_what_may_not_be_set_is_not_and_neither_is_what_stands_before_it(void)
{
  fmi3Instance const c = instantiated3();
  const fmi3ValueReference good = ref(ANOTHER_PARAMETER), bad = ref(A_PARAMETER), out = ref(AN_OUTPUT),
                           array = (fmi3ValueReference)fmu_variable_count, time = time_reference(),
                           both[] = { good, bad };
  const double wrong[] = { -5.0, 1e9, (double)NAN, (double)INFINITY };
  double value[16] = { 1700.0 };
  save3(c, &before);
  for (int i = 0; i < COUNT(wrong); i++) {
    value[1] = wrong[i];
    REFUSED3(fmi3SetFloat64(c, both, 2, value, 2), A_PARAMETER, "outside its range " A_RANGE);
  }
  REFUSED3(fmi3SetFloat64(c, &out, 1, value, 1), AN_OUTPUT, "is an output");
  REFUSED3(fmi3SetFloat64(c, &array, 1, value, (size_t)fmu_arrays[0].count), fmu_arrays[0].of.name,
      "is an output");
  REFUSED3(fmi3SetFloat64(c, &time, 1, value, 1), "time", "set by the steps");
  TEST_ASSERT_TRUE(same_state(c, &before));
  enter3(c);
  save3(c, &before);
  REFUSED3(fmi3SetFloat64(c, &good, 1, value, 1), ANOTHER_PARAMETER, "fixed parameter", "while stepping");
  TEST_ASSERT_TRUE(same_state(c, &before));
}

static void test_an_instantiation_that_is_refused_says_why(void)
{
  const fmi3ValueReference vr = 0;
  const struct {
    const char *name, *token;
    fmi3Boolean events;
    size_t intermediates;
    const char *words;
  } cases[] = {
    { NULL, FMU_GUID, fmi3False, 0, "instance name" },
    { "", FMU_GUID, fmi3False, 0, "instance name" },
    { "car", NULL, fmi3False, 0, "instantiation token NULL" },
    { "car", "{other}", fmi3False, 0, "instantiation token {other} is not that of this binary" },
    { "car", FMU_GUID "x", fmi3False, 0, FMU_GUID },
    { "car", FMU_GUID, fmi3True, 0, "eventModeUsed" },
    { "car", FMU_GUID, fmi3False, 1, "requiredIntermediateVariables" },
  };
  for (int i = 0; i < COUNT(cases); i++) {
    TEST_ASSERT_NULL(fmi3InstantiateCoSimulation(cases[i].name, cases[i].token, NULL, fmi3False, fmi3False,
        cases[i].events, fmi3False, &vr, cases[i].intermediates, &here, logger3, NULL));
    expect_refused(fmi2Error, i, cases[i].words, NULL);
    TEST_ASSERT_EQUAL_PTR(&here, lines[i].environment);
  }
  TEST_ASSERT_NULL(fmi3InstantiateModelExchange("car", FMU_GUID, NULL, fmi3False, fmi3False, &here, logger3));
  expect_refused(fmi2Error, COUNT(cases), "only co-simulation", NULL);
  TEST_ASSERT_NULL(fmi3InstantiateScheduledExecution(
      "car", FMU_GUID, NULL, fmi3False, fmi3False, &here, logger3, NULL, NULL, NULL));
  expect_refused(fmi2Error, COUNT(cases) + 1, "only co-simulation", NULL);
  TEST_ASSERT_NULL(fmi3InstantiateCoSimulation(
      "car", "{other}", NULL, fmi3False, fmi3True, fmi3False, fmi3False, NULL, 0, NULL, NULL, NULL));
  fmi3Instance const silent = fmi3InstantiateCoSimulation(
      "car", FMU_GUID, NULL, fmi3False, fmi3True, fmi3False, fmi3False, NULL, 0, NULL, NULL, NULL);
  TEST_ASSERT_NOT_NULL(silent);
  made[made_count++] = silent;
  TEST_ASSERT_EQUAL_INT(fmi3Error, fmi3Terminate(silent));
}

/* ---- the life cycle */

static const named_phase phases[] = PHASES("fmi3");

static fmi3Instance in_phase(int phase)
{
  fmi3Instance const c = instantiated3();
  if (phase == BEFORE) return c;
  OK3(fmi3EnterInitializationMode(c, fmi3True, 1e-4, 0.0, fmi3True, 10.0));
  if (phase == INIT) return c;
  OK3(fmi3ExitInitializationMode(c));
  if (phase == ENDED) OK3(fmi3Terminate(c));
  return c;
}

static fmi3Status call_enter(fmi3Instance c)
{
  return fmi3EnterInitializationMode(c, fmi3False, 0.0, 0.0, fmi3False, 0.0);
}
static fmi3Status call_step(fmi3Instance c)
{
  return fmi3DoStep(c, 0.0, STEP, fmi3True, NULL, NULL, NULL, NULL);
}
static fmi3Status call_set_input(fmi3Instance c)
{
  const fmi3ValueReference vr = ref(AN_INPUT);
  const double x = 1.0;
  return fmi3SetFloat64(c, &vr, 1, &x, 1);
}
static fmi3Status call_set_parameter(fmi3Instance c)
{
  const fmi3ValueReference vr = ref(AN_INTEGER);
  const fmi3Int32 x = 60;
  return fmi3SetInt32(c, &vr, 1, &x, 1);
}
static fmi3Status call_get(fmi3Instance c)
{
  const fmi3ValueReference vr = ref(AN_OUTPUT);
  double x;
  return fmi3GetFloat64(c, &vr, 1, &x, 1);
}
static fmi3Status call_state(fmi3Instance c)
{
  fmi3FMUState state = NULL;
  save3(c, &other);
  fmi3Status status = fmi3DeserializeFMUState(c, other.at, other.count, &state);
  if (status == fmi3OK) status = fmi3SetFMUState(c, state);
  if (status == fmi3OK) status = fmi3FreeFMUState(c, &state);
  return status;
}
static fmi3Status call_logging(fmi3Instance c) { return fmi3SetDebugLogging(c, fmi3False, 0, NULL); }

/* Functions that are refused in every phase, without reading their arguments. */
#define NEVER(DO) \
  DO(EnterConfigurationMode, (c)) DO(ExitConfigurationMode, (c)) DO(EnterEventMode, (c)) \
  DO(EnterStepMode, (c)) DO(EvaluateDiscreteStates, (c)) \
  DO(UpdateDiscreteStates, (c, NULL, NULL, NULL, NULL, NULL, NULL)) \
  DO(GetOutputDerivatives, (c, NULL, 1, NULL, NULL, 1)) \
  DO(GetDirectionalDerivative, (c, NULL, 0, NULL, 0, NULL, 0, NULL, 0)) \
  DO(GetAdjointDerivative, (c, NULL, 0, NULL, 0, NULL, 0, NULL, 0)) \
  DO(GetNumberOfVariableDependencies, (c, 0, NULL)) \
  DO(GetVariableDependencies, (c, 0, NULL, NULL, NULL, NULL, 0)) \
  DO(GetIntervalDecimal, (c, NULL, 1, NULL, NULL)) DO(GetIntervalFraction, (c, NULL, 1, NULL, NULL, NULL)) \
  DO(GetShiftDecimal, (c, NULL, 1, NULL)) DO(GetShiftFraction, (c, NULL, 1, NULL, NULL)) \
  DO(SetIntervalDecimal, (c, NULL, 1, NULL)) DO(SetIntervalFraction, (c, NULL, 1, NULL, NULL)) \
  DO(SetShiftDecimal, (c, NULL, 1, NULL)) DO(SetShiftFraction, (c, NULL, 1, NULL, NULL)) \
  DO(ActivateModelPartition, (c, 0, 0.0)) DO(EnterContinuousTimeMode, (c)) \
  DO(CompletedIntegratorStep, (c, fmi3True, NULL, NULL)) DO(SetTime, (c, 1.0)) \
  DO(SetContinuousStates, (c, NULL, 0)) DO(GetContinuousStateDerivatives, (c, NULL, 0)) \
  DO(GetEventIndicators, (c, NULL, 0)) DO(GetContinuousStates, (c, NULL, 0)) \
  DO(GetNominalsOfContinuousStates, (c, NULL, 0)) DO(GetNumberOfEventIndicators, (c, NULL)) \
  DO(GetNumberOfContinuousStates, (c, NULL))
#define CALL(name, arguments) \
  static fmi3Status never_##name(fmi3Instance c) \
  { return fmi3##name arguments; }
#define ROW(name, arguments) \
  { "fmi3" #name, 0, never_##name },
NEVER(CALL)

static const struct {
  const char *name;
  int allowed;
  fmi3Status (*call)(fmi3Instance);
} functions[] = { { "fmi3EnterInitializationMode", BEFORE, call_enter },
  { "fmi3ExitInitializationMode", INIT, fmi3ExitInitializationMode }, { "fmi3DoStep", STEPS, call_step },
  { "fmi3Terminate", STEPS, fmi3Terminate }, { "fmi3Reset", EVER, fmi3Reset },
  { "fmi3SetFloat64", BEFORE | INIT | STEPS, call_set_input },
  { "fmi3SetInt32", BEFORE | INIT, call_set_parameter }, { "fmi3GetFloat64", EVER, call_get },
  { "fmi3SetFMUState", EVER, call_state }, { "fmi3SetDebugLogging", EVER, call_logging }, NEVER(ROW) };

static void test_a_call_is_done_in_its_phases_and_refused_by_name_in_all_others(void)
{
  for (int p = 0; p < COUNT(phases); p++)
    for (int f = 0; f < COUNT(functions); f++) {
      fmi3Instance const c = in_phase(phases[p].phase);
      save3(c, &before);
      const int n = said;
      const fmi3Status status = functions[f].call(c);
      char what[400];
      (void)snprintf(what, sizeof what, "%s %s: %s", functions[f].name, phases[p].words, last_line());
      if (functions[f].allowed & phases[p].phase) {
        TEST_ASSERT_EQUAL_INT_MESSAGE(fmi3OK, status, what);
        TEST_ASSERT_EQUAL_INT_MESSAGE(n, said, what);
      } else {
        expect_refused((fmi2Status)status, n, functions[f].name, NULL);
        if (functions[f].allowed) expect_refused((fmi2Status)status, n, phases[p].words, NULL);
        TEST_ASSERT_TRUE_MESSAGE(same_state(c, &before), what);
      }
      free_all();
    }
}

static void test_an_instance_that_is_none_is_an_error_and_nothing_is_said(void)
{
  char elsewhere[64] = { 0 };
  fmi3Instance const freed = instantiated3();
  free_all();
  fmi3Instance const none[] = { NULL, freed, elsewhere, (char *)freed + 8 };
  for (int i = 0; i < COUNT(none); i++) {
    fmi3Instance const c = none[i];
    const fmi3ValueReference vr = 0;
    double x = 7.0;
    fmi3FMUState state = NULL;
    fmi3Byte byte = 0;
    size_t size = 0;
    for (int f = 0; f < COUNT(functions); f++)
      if (functions[f].call != call_state)
        TEST_ASSERT_EQUAL_INT_MESSAGE(fmi3Error, functions[f].call(c), functions[f].name);
    TEST_ASSERT_EQUAL_INT(fmi3Error, fmi3GetFloat64(c, &vr, 1, &x, 1));
    TEST_ASSERT_EQUAL_INT(fmi3Error, fmi3GetFloat64(c, NULL, 0, NULL, 0));
    TEST_ASSERT_EQUAL_INT(fmi3Error, fmi3GetFloat32(c, NULL, 0, NULL, 0));
    TEST_ASSERT_EQUAL_INT(fmi3Error, fmi3SetUInt8(c, NULL, 0, NULL, 0));
    TEST_ASSERT_EQUAL_INT(fmi3Error, fmi3GetBinary(c, NULL, 0, NULL, NULL, 0));
    TEST_ASSERT_EQUAL_INT(fmi3Error, fmi3SetBinary(c, NULL, 0, NULL, NULL, 0));
    TEST_ASSERT_EQUAL_INT(fmi3Error, fmi3GetClock(c, NULL, 0, NULL));
    TEST_ASSERT_EQUAL_INT(fmi3Error, fmi3SetClock(c, NULL, 0, NULL));
    TEST_ASSERT_EQUAL_INT(fmi3Error, fmi3GetFMUState(c, &state));
    TEST_ASSERT_EQUAL_INT(fmi3Error, fmi3SetFMUState(c, state));
    TEST_ASSERT_EQUAL_INT(fmi3Error, fmi3FreeFMUState(c, &state));
    TEST_ASSERT_EQUAL_INT(fmi3Error, fmi3SerializedFMUStateSize(c, state, &size));
    TEST_ASSERT_EQUAL_INT(fmi3Error, fmi3SerializeFMUState(c, state, &byte, 1));
    TEST_ASSERT_EQUAL_INT(fmi3Error, fmi3DeserializeFMUState(c, &byte, 1, &state));
    TEST_ASSERT_TRUE(x == 7.0 && state == NULL);
    fmi3FreeInstance(c);
  }
  TEST_ASSERT_EQUAL_INT(0, said);
}

static void test_the_experiment_and_the_steps_must_be_numbers_in_order(void)
{
  fmi3Instance const c = instantiated3();
  const double odd[] = { (double)NAN, (double)INFINITY, -(double)INFINITY };
  save3(c, &before);
  for (int i = 0; i < COUNT(odd); i++)
    REFUSED3(fmi3EnterInitializationMode(c, fmi3False, 0, odd[i], fmi3False, 0), "startTime");
  REFUSED3(fmi3EnterInitializationMode(c, fmi3False, 0, 1.0, fmi3True, 0.5), "stopTime");
  REFUSED3(fmi3EnterInitializationMode(c, fmi3False, 0, 1.0, fmi3True, (double)NAN), "stopTime");
  TEST_ASSERT_TRUE(same_state(c, &before));
  OK3(fmi3EnterInitializationMode(c, fmi3False, 0, 3.5, fmi3False, 0));
  TEST_ASSERT_TRUE(number3(c, time_reference(), 'r') == 3.5);
  OK3(fmi3ExitInitializationMode(c));
  save3(c, &before);
  double last = 0.0;
  for (int i = 0; i < COUNT(odd); i++) {
    REFUSED3(fmi3DoStep(c, odd[i], STEP, fmi3True, NULL, NULL, NULL, &last), "currentCommunicationPoint");
    REFUSED3(fmi3DoStep(c, 3.5, odd[i], fmi3True, NULL, NULL, NULL, &last), "communicationStepSize");
  }
  REFUSED3(fmi3DoStep(c, 3.5, 0.0, fmi3True, NULL, NULL, NULL, &last), "communicationStepSize");
  REFUSED3(fmi3DoStep(c, 3.6, STEP, fmi3True, NULL, NULL, NULL, &last), "currentCommunicationPoint");
  TEST_ASSERT_TRUE(last == 3.5 && same_state(c, &before));
  OK3(fmi3DoStep(c, 3.5, 0.25, fmi3True, NULL, NULL, NULL, NULL));
  TEST_ASSERT_TRUE(number3(c, time_reference(), 'r') == 3.75);
}

static void test_an_input_that_is_no_number_is_a_warning_or_an_error_as_in_fmi_2(void)
{
  fmi2Component const two = stepping();
  fmi3Instance const three = stepping3();
  set_inputs(two, 0);
  copy_inputs(two, three);
  OK(put_real(two, AN_INPUT, (double)NAN));
  put3(three, AN_INPUT, (double)NAN);
  const fmi2Status a = fmi2DoStep(two, 0.0, STEP, fmi2True);
  const fmi3Status b = step3(three, 0);
  TEST_ASSERT_EQUAL_INT((int)a, (int)b);
#if defined(CASE_ESTIMATOR)
  TEST_ASSERT_EQUAL_INT(fmi3Warning, b);
  const fmi3ValueReference valid = (fmi3ValueReference)(fmu_variable_count + 3);
  fmi3Boolean flags[3] = { fmi3True, fmi3True, fmi3True };
  OK3(fmi3GetBoolean(three, &valid, 1, flags, 3));
  TEST_ASSERT_FALSE(flags[0] || flags[1] || flags[2]);
#else
  TEST_ASSERT_EQUAL_INT(fmi3Error, b);
#endif
  expect_same_variables(two, three);
}

/* ---- several, saved, restored */

static void test_a_serialized_state_goes_on_bit_for_bit_in_another_instance(void)
{
  fmi3Instance const a = stepping3();
  stepped3(a, 0, 15);
  save3(a, &other);
  stepped3(a, 15, 30);
  save3(a, &before);
  fmi3FreeInstance(a);
  made_count--;
  fmi3Instance const b = instantiated3();
  fmi3FMUState state = NULL;
  OK3(fmi3DeserializeFMUState(b, other.at, other.count, &state));
  OK3(fmi3SetFMUState(b, state));
  stepped3(b, 15, 30);
  TEST_ASSERT_TRUE(same_state(b, &before));
  OK3(fmi3Reset(b));
  TEST_ASSERT_FALSE(same_state(b, &before));
  OK3(fmi3SetFMUState(b, state)); /* the phase is part of the state */
  stepped3(b, 15, 30);
  TEST_ASSERT_TRUE(same_state(b, &before));
  OK3(fmi3FreeFMUState(b, &state));
  REFUSED3(fmi3DeserializeFMUState(b, other.at, other.count - 1, &state), "another size");
  REFUSED3(fmi3DeserializeFMUState(b, other.at, 3, &state), "too short");
  REFUSED3(fmi3SerializeFMUState(b, &state, other.at, other.count), "fmi3SerializeFMUState", "not a state");
  TEST_ASSERT_TRUE(same_state(b, &before));
}

static void test_what_is_logged_has_status_category_and_environment(void)
{
  fmi3Instance const c = fmi3InstantiateCoSimulation(
      "three", FMU_GUID, NULL, fmi3False, fmi3True, fmi3False, fmi3False, NULL, 0, &here, logger3, NULL);
  TEST_ASSERT_NOT_NULL(c);
  made[made_count++] = c;
  enter3(c);
  TEST_ASSERT_EQUAL_INT(2, said);
  TEST_ASSERT_EQUAL_STRING("logEvents", lines[1].category);
  TEST_ASSERT_EQUAL_STRING("initialized", lines[1].text);
  TEST_ASSERT_EQUAL_INT(fmi3OK, lines[1].status);
  TEST_ASSERT_EQUAL_PTR(&here, lines[1].environment);
  const fmi3String none = "noSuchCategory", errors = "logStatusError";
  REFUSED3(fmi3SetDebugLogging(c, fmi3True, 1, &none), "unknown log category");
  OK3(fmi3SetDebugLogging(c, fmi3False, 1, &errors));
  const int n = said;
  TEST_ASSERT_EQUAL_INT(fmi3Error, fmi3EnterEventMode(c));
  TEST_ASSERT_EQUAL_INT(n, said);
  TEST_ASSERT_EQUAL_STRING("3.0", fmi3GetVersion());
}
