/* tests/fmu/unit/test_calls.c - life cycle, call order, arguments, the pool of instances,
 * the log. */
#include "fmu_case.h"

/* ---- every function in every phase */

static const named_phase phases[] = PHASES("fmi2");

static fmi2Component in_phase(int phase)
{
  fmi2Component const c = instantiated();
  if (phase == BEFORE) return c;
  OK(fmi2SetupExperiment(c, fmi2True, 1e-4, 0.0, fmi2True, 10.0));
  OK(fmi2EnterInitializationMode(c));
  if (phase == INIT) return c;
  OK(fmi2ExitInitializationMode(c));
  if (phase == ENDED) {
    stepped(c, 0, 1);
    OK(fmi2Terminate(c));
  }
  return c;
}

static fmi2Status call_setup(fmi2Component c)
{
  return fmi2SetupExperiment(c, fmi2False, 0.0, 0.0, fmi2False, 0.0);
}
static fmi2Status call_step(fmi2Component c) { return fmi2DoStep(c, 0.0, STEP, fmi2True); }
static fmi2Status call_set_real(fmi2Component c) { return put_real(c, AN_INPUT, 1.0); }
static fmi2Status call_set_integer(fmi2Component c) { return put_integer(c, AN_INTEGER, 60); }
static fmi2Status call_set_real_parameter(fmi2Component c) { return put_real(c, ANOTHER_PARAMETER, 1800.0); }
static fmi2Status call_get_real(fmi2Component c)
{
  const fmi2ValueReference vr = ref(AN_OUTPUT);
  fmi2Real value;
  return fmi2GetReal(c, &vr, 1, &value);
}
static fmi2Status call_get_integer(fmi2Component c)
{
  const fmi2ValueReference vr = ref(AN_INTEGER);
  fmi2Integer value;
  return fmi2GetInteger(c, &vr, 1, &value);
}
static fmi2Status call_get_boolean(fmi2Component c)
{
  const fmi2ValueReference vr = ref(A_FLAG);
  fmi2Boolean value;
  return fmi2GetBoolean(c, &vr, 1, &value);
}
static fmi2Status call_derivatives(fmi2Component c)
{
  return fmi2SetRealInputDerivatives(c, NULL, 0, NULL, NULL);
}
static fmi2Status call_output_derivatives(fmi2Component c)
{
  return fmi2GetRealOutputDerivatives(c, NULL, 0, NULL, NULL);
}
static fmi2Status call_state(fmi2Component c)
{
  saved_bytes b = bytes_of(c);
  fmi2FMUstate state = NULL;
  fmi2Status status = fmi2DeSerializeFMUstate(c, b.at, b.count, &state);
  if (status == fmi2OK) status = fmi2SetFMUstate(c, state);
  if (status == fmi2OK) status = fmi2FreeFMUstate(c, &state);
  free(b.at);
  return status;
}
static fmi2Status call_logging(fmi2Component c) { return fmi2SetDebugLogging(c, fmi2False, 0, NULL); }
static fmi2Status call_real_status(fmi2Component c)
{
  fmi2Real value;
  return fmi2GetRealStatus(c, fmi2LastSuccessfulTime, &value);
}
static fmi2Status call_directional(fmi2Component c)
{
  return fmi2GetDirectionalDerivative(c, NULL, 0, NULL, 0, NULL, NULL);
}

static const struct {
  const char *name;
  int allowed;
  fmi2Status (*call)(fmi2Component);
} functions[] = {
  { "fmi2SetupExperiment", BEFORE, call_setup },
  { "fmi2EnterInitializationMode", BEFORE, fmi2EnterInitializationMode },
  { "fmi2ExitInitializationMode", INIT, fmi2ExitInitializationMode },
  { "fmi2DoStep", STEPS, call_step },
  { "fmi2Terminate", STEPS, fmi2Terminate },
  { "fmi2Reset", EVER, fmi2Reset },
  { "fmi2SetReal", BEFORE | INIT | STEPS, call_set_real },
  { "fmi2SetReal", BEFORE | INIT, call_set_real_parameter },
  { "fmi2SetInteger", BEFORE | INIT, call_set_integer },
  { "fmi2GetReal", EVER, call_get_real },
  { "fmi2GetInteger", EVER, call_get_integer },
  { "fmi2GetBoolean", EVER, call_get_boolean },
  { "fmi2SetRealInputDerivatives", INIT | STEPS, call_derivatives },
  { "fmi2GetRealOutputDerivatives", EVER, call_output_derivatives },
  { "fmi2SetFMUstate", EVER, call_state },
  { "fmi2SetDebugLogging", EVER, call_logging },
  { "fmi2GetRealStatus", EVER, call_real_status },
  { "fmi2CancelStep", 0, fmi2CancelStep },
  { "fmi2GetDirectionalDerivative", 0, call_directional },
};

static void test_a_call_is_done_in_its_phases_and_refused_by_name_in_all_others(void)
{
  for (int p = 0; p < COUNT(phases); p++)
    for (int f = 0; f < COUNT(functions); f++) {
      fmi2Component const c = in_phase(phases[p].phase);
      saved_bytes before = bytes_of(c);
      const int n = said;
      const fmi2Status status = functions[f].call(c);
      char what[200];
      (void)snprintf(what, sizeof what, "%s %s: %s", functions[f].name, phases[p].words, last_line());
      if (functions[f].allowed & phases[p].phase) {
        TEST_ASSERT_EQUAL_INT_MESSAGE(fmi2OK, status, what);
        TEST_ASSERT_EQUAL_INT_MESSAGE(n, said, what);
      } else {
        expect_refused(status, n, functions[f].name, NULL);
        if (functions[f].allowed) expect_refused(status, n, phases[p].words, NULL);
        expect_unchanged(c, &before, what);
      }
      free(before.at);
      drop(c);
    }
}

static void test_a_component_that_is_none_is_an_error_and_touches_nothing(void)
{
  char elsewhere[64] = { 0 };
  fmi2Component const freed = instantiated();
  drop(freed);
  fmi2Component const none[] = { NULL, freed, elsewhere, (char *)freed + 8 };
  for (int i = 0; i < COUNT(none); i++) {
    fmi2Component const c = none[i];
    const fmi2ValueReference vr = 0;
    fmi2Real real = 0;
    fmi2Integer integer = 0;
    fmi2Boolean boolean = 0;
    fmi2String string = "";
    fmi2Status status = fmi2OK;
    fmi2FMUstate state = NULL;
    fmi2Byte byte = 0;
    size_t size = 0;
    for (int f = 0; f < COUNT(functions); f++)
      if (functions[f].call != call_state)
        TEST_ASSERT_EQUAL_INT_MESSAGE(fmi2Error, functions[f].call(c), functions[f].name);
    const fmi2Status results[] = {
      fmi2GetReal(c, &vr, 1, &real),
      fmi2GetString(c, &vr, 1, &string),
      fmi2SetBoolean(c, &vr, 1, &boolean),
      fmi2SetString(c, &vr, 1, &string),
      fmi2SetRealInputDerivatives(c, &vr, 1, &integer, &real),
      fmi2GetRealOutputDerivatives(c, &vr, 1, &integer, &real),
      fmi2GetStatus(c, fmi2DoStepStatus, &status),
      fmi2GetIntegerStatus(c, fmi2DoStepStatus, &integer),
      fmi2GetBooleanStatus(c, fmi2Terminated, &boolean),
      fmi2GetStringStatus(c, fmi2PendingStatus, &string),
      fmi2GetFMUstate(c, &state),
      fmi2SetFMUstate(c, state),
      fmi2FreeFMUstate(c, &state),
      fmi2SerializedFMUstateSize(c, state, &size),
      fmi2SerializeFMUstate(c, state, &byte, 1),
      fmi2DeSerializeFMUstate(c, &byte, 1, &state),
    };
    for (int k = 0; k < COUNT(results); k++) TEST_ASSERT_EQUAL_INT(fmi2Error, results[k]);
    fmi2FreeInstance(c);
  }
  TEST_ASSERT_EQUAL_INT(0, said);
}

/* ---- instantiation */

static void test_an_instantiation_that_is_refused_says_why(void)
{
  static const char name[] = "car 7";
  const struct {
    const char *name, *guid;
    fmi2Type type;
    const char *words;
  } cases[] = {
    { NULL, FMU_GUID, fmi2CoSimulation, "instance name" },
    { "", FMU_GUID, fmi2CoSimulation, "instance name" },
    { name, FMU_GUID, fmi2ModelExchange, "only co-simulation" },
    { name, NULL, fmi2CoSimulation, "NULL" },
    { name, "", fmi2CoSimulation, "GUID" },
    { name, "{other}", fmi2CoSimulation, "{other}" },
    { name, "%s%n#r1#", fmi2CoSimulation, "_s_n_r1_" },
    { name, "{00000000-0000-4000-8000-000000000002}", fmi2CoSimulation, FMU_GUID },
    { name, FMU_GUID "x", fmi2CoSimulation, FMU_GUID },
    { name, "00000000-0000-4000-8000-000000000001", fmi2CoSimulation, FMU_GUID },
  };
  for (int i = 0; i < COUNT(cases); i++) {
    TEST_ASSERT_NULL(
        fmi2Instantiate(cases[i].name, cases[i].type, cases[i].guid, NULL, &callbacks, fmi2False, fmi2False));
    expect_refused(fmi2Error, i, cases[i].words, NULL);
    TEST_ASSERT_EQUAL_PTR(&here, lines[i].environment);
    TEST_ASSERT_EQUAL_STRING(cases[i].name ? cases[i].name : "", lines[i].name);
  }
  TEST_ASSERT_NULL(fmi2Instantiate(name, fmi2CoSimulation, FMU_GUID, NULL, NULL, fmi2False, fmi2False));
}

static void test_without_a_logger_nothing_is_said_and_nothing_breaks(void)
{
  static const fmi2CallbackFunctions silent = { NULL, NULL, NULL, NULL, NULL };
  TEST_ASSERT_NULL(fmi2Instantiate("one", fmi2CoSimulation, "{other}", NULL, &silent, fmi2False, fmi2True));
  fmi2Component const c = fmi2Instantiate(
      "one", fmi2CoSimulation, FMU_GUID, NULL, &silent, fmi2True, fmi2True);
  TEST_ASSERT_NOT_NULL(c);
  made[made_count++] = c;
  TEST_ASSERT_EQUAL_INT(fmi2Error, call_step(c));
  TEST_ASSERT_EQUAL_INT(fmi2Error, put_real(c, ANOTHER_PARAMETER, -1.0));
  TEST_ASSERT_EQUAL_INT(0, said);
}

static void test_the_pool_of_instances_says_when_it_is_exhausted_and_is_whole_again_after_freeing(void)
{
  for (int round = 0; round < 3; round++) {
    fmi2Component all[FMU_INSTANCES];
    for (int i = 0; i < FMU_INSTANCES; i++) {
      all[i] = instantiated_as("one of many");
      TEST_ASSERT_NOT_NULL(all[i]);
      for (int k = 0; k < i; k++) TEST_ASSERT_TRUE(all[i] != all[k]);
    }
    const int n = said;
    TEST_ASSERT_NULL(instantiated_as("one too many"));
    expect_refused(fmi2Error, n, "all 4 instances are in use", "FMU_INSTANCES", NULL);
    TEST_ASSERT_EQUAL_STRING("one too many", lines[n].name);
    for (int i = 0; i < FMU_INSTANCES; i++) fmi2FreeInstance(all[i]);
    made_count = 0;
  }
}

static void test_a_freed_place_gives_a_new_instance_not_the_old_one(void)
{
  fmi2Component const old = stepping();
  stepped(old, 0, 3);
  drop(old);
  fmi2Component const c = instantiated_as("fresh"), d = instantiated_as("fresh");
  TEST_ASSERT_EQUAL_PTR(old, c);
  expect_same_and_free(bytes_of(c), bytes_of(d), "a place used before and one that was not");
  REFUSED(call_step(c), "before initialization");
}

static void test_long_names_and_texts_do_not_overflow(void)
{
  char name[1000];
  memset(name, 'x', sizeof name - 1);
  name[sizeof name - 1] = '\0';
  TEST_ASSERT_NULL(fmi2Instantiate("one", fmi2CoSimulation, name, NULL, &callbacks, fmi2False, fmi2False));
  TEST_ASSERT_EQUAL_INT(1, said);
  fmi2Component const c = instantiated_as(name);
  REFUSED(call_step(c), "fmi2DoStep");
  TEST_ASSERT_EQUAL_INT(0, strncmp(name, lines[1].name, 127));
  TEST_ASSERT_EQUAL_INT(127, (int)strlen(lines[1].name));
}

/* ---- arguments */

#define WITHOUT(function, value)                                         \
  REFUSED(function(c, NULL, 1, value), #function, "vr is NULL");         \
  REFUSED(function(c, &vr, 1, NULL), #function, "value is NULL")

static void test_a_missing_argument_is_named(void)
{
  fmi2Component const c = stepping();
  const fmi2ValueReference vr = ref(AN_INPUT);
  fmi2Real real = 0;
  fmi2Integer integer = 1;
  fmi2Boolean boolean = 0;
  fmi2String string = "";
  fmi2Byte byte = 0;
  size_t size = 0;
  fmi2FMUstate state = NULL;
  OK(fmi2GetFMUstate(c, &state));
  saved_bytes before = bytes_of(c);
  WITHOUT(fmi2GetReal, &real);
  WITHOUT(fmi2GetInteger, &integer);
  WITHOUT(fmi2GetBoolean, &boolean);
  WITHOUT(fmi2GetString, &string);
  WITHOUT(fmi2SetReal, &real);
  WITHOUT(fmi2SetInteger, &integer);
  WITHOUT(fmi2SetBoolean, &boolean);
  WITHOUT(fmi2SetString, &string);
  REFUSED(fmi2SetRealInputDerivatives(c, NULL, 1, &integer, &real), "vr is NULL");
  REFUSED(fmi2SetRealInputDerivatives(c, &vr, 1, NULL, &real), "order is NULL");
  REFUSED(fmi2SetRealInputDerivatives(c, &vr, 1, &integer, NULL), "value is NULL");
  REFUSED(fmi2GetRealOutputDerivatives(c, NULL, 1, NULL, NULL), "fmi2GetRealOutputDerivatives");
  REFUSED(fmi2SetDebugLogging(c, fmi2True, 1, NULL), "categories is NULL");
  REFUSED(fmi2GetRealStatus(c, fmi2LastSuccessfulTime, NULL), "value is NULL");
  REFUSED(fmi2GetBooleanStatus(c, fmi2Terminated, NULL), "value is NULL");
  REFUSED(fmi2GetFMUstate(c, NULL), "FMUstate is NULL");
  REFUSED(fmi2SetFMUstate(c, NULL), "FMUstate is NULL");
  REFUSED(fmi2SerializedFMUstateSize(c, state, NULL), "size is NULL");
  REFUSED(fmi2SerializedFMUstateSize(c, NULL, &size), "FMUstate is NULL");
  REFUSED(fmi2SerializeFMUstate(c, state, NULL, 1), "serializedState is NULL");
  REFUSED(fmi2SerializeFMUstate(c, NULL, &byte, 1), "FMUstate is NULL");
  REFUSED(fmi2DeSerializeFMUstate(c, NULL, 1, &state), "serializedState is NULL");
  REFUSED(fmi2DeSerializeFMUstate(c, &byte, 1, NULL), "FMUstate is NULL");
  OK(fmi2FreeFMUstate(c, NULL)); /* like free(NULL) */
  expect_unchanged_and_free(c, &before, "after refusals");
}

static void test_nothing_to_do_needs_no_arguments(void)
{
  fmi2Component const c = stepping();
  OK(fmi2GetReal(c, NULL, 0, NULL));
  OK(fmi2GetInteger(c, NULL, 0, NULL));
  OK(fmi2GetBoolean(c, NULL, 0, NULL));
  OK(fmi2GetString(c, NULL, 0, NULL));
  OK(fmi2SetReal(c, NULL, 0, NULL));
  OK(fmi2SetInteger(c, NULL, 0, NULL));
  OK(fmi2SetBoolean(c, NULL, 0, NULL));
  OK(fmi2SetString(c, NULL, 0, NULL));
  OK(fmi2SetRealInputDerivatives(c, NULL, 0, NULL, NULL));
  TEST_ASSERT_EQUAL_INT(0, said);
}

static void test_the_experiment_must_have_numbers_in_order(void)
{
  fmi2Component const c = instantiated();
  const double bad[] = { (double)NAN, (double)INFINITY, -(double)INFINITY };
  for (int i = 0; i < COUNT(bad); i++)
    REFUSED(fmi2SetupExperiment(c, fmi2False, 0, bad[i], fmi2False, 0), "startTime");
  REFUSED(fmi2SetupExperiment(c, fmi2False, 0, 1.0, fmi2True, 0.5), "stopTime");
  REFUSED(fmi2SetupExperiment(c, fmi2False, 0, 1.0, fmi2True, (double)NAN), "stopTime");
  OK(fmi2SetupExperiment(
      c, fmi2True, 1e-6, 1.0, fmi2False, 0.5)); /* a stop time is ignored unless it is given */
  OK(fmi2SetupExperiment(c, fmi2False, (double)NAN, -3.0, fmi2True, -3.0));
  begin(c);
  fmi2Real time = 0;
  OK(fmi2GetRealStatus(c, fmi2LastSuccessfulTime, &time));
  TEST_ASSERT_TRUE(time == -3.0);
  set_inputs(c, 0);
  OK(fmi2DoStep(c, -3.0, STEP, fmi2True));
}

/* ---- steps */

static void test_a_step_size_that_is_no_positive_number_is_refused(void)
{
  fmi2Component const c = stepping();
  stepped(c, 0, 2);
  saved_bytes before = bytes_of(c);
  const double bad[] = { 0.0, -0.0, -0.01, (double)NAN, (double)INFINITY, -(double)INFINITY };
  for (int i = 0; i < COUNT(bad); i++) {
    REFUSED(fmi2DoStep(c, 2 * STEP, bad[i], fmi2True), "fmi2DoStep", "communicationStepSize");
    expect_unchanged(c, &before, "after a refused step");
  }
  free(before.at);
  stepped(c, 2, 4);
}

static void test_the_communication_point_may_be_off_by_what_summing_costs_and_no_more(void)
{
  fmi2Component const c = stepping();
  stepped(c, 0, 2);
  saved_bytes before = bytes_of(c);
  const double bad[] = { 0.0, STEP, 3 * STEP, 2 * STEP + 0.011 * STEP, 2 * STEP - 0.011 * STEP, (double)NAN,
    (double)INFINITY, -1e300 };
  for (int i = 0; i < COUNT(bad); i++) {
    REFUSED(fmi2DoStep(c, bad[i], STEP, fmi2True), "currentCommunicationPoint", "0.02");
    expect_unchanged(c, &before, "after a refused communication point");
  }
  free(before.at);
  set_inputs(c, 2);
  OK(fmi2DoStep(c, 2 * STEP + 0.009 * STEP, STEP, fmi2True));
  fmi2Real time = 0;
  OK(fmi2GetRealStatus(c, fmi2LastSuccessfulTime, &time));
  /* the importer's times count, so that differences do not add up */
  TEST_ASSERT_TRUE(time == 2 * STEP + 0.009 * STEP + STEP);
  set_inputs(c, 3);
  OK(fmi2DoStep(c, 3 * STEP, STEP, fmi2True)); /* 0.009 of a step before the end of the last one */
  OK(fmi2GetRealStatus(c, fmi2LastSuccessfulTime, &time));
  TEST_ASSERT_TRUE(time == 3 * STEP + STEP);
}

static void step_far_from_zero(double start)
{
  fmi2Component const c = instantiated();
  OK(fmi2SetupExperiment(c, fmi2False, 0, start, fmi2False, 0));
  begin(c);
  for (int k = 0; k < 20; k++) {
    set_inputs(c, k);
    OK(fmi2DoStep(c, start + k * STEP, STEP, fmi2True));
  }
  REFUSED(fmi2DoStep(c, start + 20.5 * STEP, STEP, fmi2True), "currentCommunicationPoint");
  REFUSED(fmi2DoStep(c, start + 19.5 * STEP, STEP, fmi2True), "currentCommunicationPoint");
  set_inputs(c, 20);
  OK(fmi2DoStep(c, start + 20 * STEP, 1e-5, fmi2True));
  OK(fmi2DoStep(c, start + 20 * STEP + 1e-5 + 4.8e-7, 1e-5, fmi2True)); /* two neighbours: 5 % of this step */
}

/* [s] since 1970, or before: neighbours are 2.4e-7 apart */
static void test_times_far_from_zero_are_compared_with_what_they_can_hold(void)
{
  step_far_from_zero(1.7e9);
  step_far_from_zero(-1.7e9);
}

static void test_what_is_asked_about_steps(void)
{
  fmi2Component const c = instantiated();
  fmi2Real time = -1;
  fmi2Integer integer = 9;
  fmi2Boolean boolean = 9;
  fmi2String string = "untouched";
  fmi2Status status = fmi2Fatal;
  OK(fmi2SetupExperiment(c, fmi2False, 0, 5.0, fmi2False, 0));
  OK(fmi2GetRealStatus(c, fmi2LastSuccessfulTime, &time));
  TEST_ASSERT_TRUE(time == 5.0);
  begin(c);
  set_inputs(c, 0);
  OK(fmi2DoStep(c, 5.0, 0.02, fmi2True));
  OK(fmi2GetRealStatus(c, fmi2LastSuccessfulTime, &time));
  TEST_ASSERT_TRUE(time == 5.02);
  OK(fmi2GetBooleanStatus(c, fmi2Terminated, &boolean));
  TEST_ASSERT_EQUAL_INT(fmi2False, boolean);
  TEST_ASSERT_EQUAL_INT(0, said);
  TEST_ASSERT_EQUAL_INT(fmi2Discard, fmi2GetRealStatus(c, fmi2Terminated, &time));
  TEST_ASSERT_EQUAL_INT(fmi2Discard, fmi2GetBooleanStatus(c, fmi2DoStepStatus, &boolean));
  TEST_ASSERT_EQUAL_INT(fmi2Discard, fmi2GetStatus(c, fmi2DoStepStatus, &status));
  TEST_ASSERT_EQUAL_INT(fmi2Discard, fmi2GetIntegerStatus(c, fmi2DoStepStatus, &integer));
  TEST_ASSERT_EQUAL_INT(fmi2Discard, fmi2GetStringStatus(c, fmi2PendingStatus, &string));
  TEST_ASSERT_EQUAL_INT(5, said);
  TEST_ASSERT_TRUE(time == 5.02 && integer == 9 && boolean == fmi2False && status == fmi2Fatal
      && strcmp(string, "untouched") == 0);
  OK(fmi2Terminate(c));
  OK(fmi2GetRealStatus(c, fmi2LastSuccessfulTime, &time));
  TEST_ASSERT_TRUE(time == 5.02);
}

static void test_derivatives_of_outputs_are_not_given(void)
{
  fmi2Component const c = stepping();
  const fmi2ValueReference vr = ref(AN_OUTPUT);
  const fmi2Integer order = 1;
  fmi2Real value = 3.0;
  REFUSED(fmi2GetRealOutputDerivatives(c, &vr, 1, &order, &value), "maxOutputDerivativeOrder");
  REFUSED(fmi2GetDirectionalDerivative(c, &vr, 1, &vr, 1, &value, &value), "providesDirectionalDerivative");
  TEST_ASSERT_TRUE(value == 3.0);
}

/* ---- log */

static void test_the_logger_gets_environment_name_status_and_category(void)
{
  static int other;
  static const fmi2CallbackFunctions its = { logger, NULL, NULL, NULL, &other };
  fmi2Component const a = instantiated_as("first %d"),
                      b = fmi2Instantiate(
                          "second", fmi2CoSimulation, FMU_GUID, "", &its, fmi2False, fmi2True);
  TEST_ASSERT_NOT_NULL(b);
  made[made_count++] = b;
  TEST_ASSERT_EQUAL_INT(1, said); /* only b has events switched on */
  TEST_ASSERT_EQUAL_STRING("logEvents", lines[0].category);
  TEST_ASSERT_EQUAL_INT(fmi2OK, lines[0].status);
  TEST_ASSERT_EQUAL_STRING("instantiated", lines[0].text);
  REFUSED(call_step(a), "fmi2DoStep");
  TEST_ASSERT_EQUAL_PTR(&here, lines[1].environment);
  TEST_ASSERT_EQUAL_STRING("first %d", lines[1].name);
  REFUSED(call_step(b), "fmi2DoStep");
  TEST_ASSERT_EQUAL_PTR(&other, lines[2].environment);
  TEST_ASSERT_EQUAL_STRING("second", lines[2].name);
  begin(b);
  TEST_ASSERT_EQUAL_STRING("initialized", last_line());
  stepped(b, 0, 1);
  OK(fmi2Terminate(b));
  TEST_ASSERT_EQUAL_STRING("terminated", last_line());
  TEST_ASSERT_EQUAL_INT(5, said);
}

static int events_of_a_round(fmi2Component c) /* and one error */
{
  const int n = said;
  OK(fmi2Reset(c));
  begin(c);
  TEST_ASSERT_EQUAL_INT(fmi2Error, fmi2EnterInitializationMode(c));
  OK(fmi2Terminate(c));
  return said - n;
}

static void test_categories_are_switched_on_and_off(void)
{
  static const fmi2String event[] = { "logEvents" }, error[] = { "logStatusError" },
                          both[] = { "logEvents", "logStatusError" };
  static const fmi2String wrong[] = { "logEvents", "logNothing" }, none[] = { NULL };
  fmi2Component const c = instantiated();
  TEST_ASSERT_EQUAL_INT(1, events_of_a_round(c));
  OK(fmi2SetDebugLogging(c, fmi2True, 1, event));
  TEST_ASSERT_EQUAL_INT(3, events_of_a_round(c));
  OK(fmi2SetDebugLogging(c, fmi2False, 1, error));
  TEST_ASSERT_EQUAL_INT(2, events_of_a_round(c));
  OK(fmi2SetDebugLogging(c, fmi2False, 1, event));
  TEST_ASSERT_EQUAL_INT(0, events_of_a_round(c));
  OK(fmi2SetDebugLogging(c, fmi2True, 1, error));
  TEST_ASSERT_EQUAL_INT(1, events_of_a_round(c));
  REFUSED(fmi2SetDebugLogging(c, fmi2True, 2, wrong), "unknown log category");
  REFUSED(fmi2SetDebugLogging(c, fmi2True, 1, none), "unknown log category");
  TEST_ASSERT_EQUAL_INT_MESSAGE(
      1, events_of_a_round(c), "of several categories none is switched when one is unknown");
  OK(fmi2SetDebugLogging(c, fmi2True, 0, NULL));
  TEST_ASSERT_EQUAL_INT(3, events_of_a_round(c));
  OK(fmi2SetDebugLogging(c, fmi2False, 0, NULL));
  TEST_ASSERT_EQUAL_INT_MESSAGE(
      1, events_of_a_round(c), "errors are said unless they are switched off by name");
  OK(fmi2SetDebugLogging(c, fmi2True, 0, NULL));
  OK(fmi2SetDebugLogging(c, fmi2False, 2, both));
  TEST_ASSERT_EQUAL_INT(0, events_of_a_round(c));
  OK(fmi2SetDebugLogging(c, fmi2True, 2, both));
  TEST_ASSERT_EQUAL_INT(3, events_of_a_round(c));
}

static void test_the_platform_is_the_standard_one(void)
{
  TEST_ASSERT_EQUAL_STRING("default", fmi2GetTypesPlatform());
  TEST_ASSERT_EQUAL_STRING("2.0", fmi2GetVersion());
}

/* ---- instances are independent */

static void test_instances_in_turn_do_what_each_does_alone(void)
{
  fmi2Component const a = stepping(), b = stepping(), alone_a = stepping(), alone_b = stepping();
  stepped(alone_a, 0, 40);
  for (int k = 0; k < 40; k++) {
    set_inputs(alone_b, k + 100);
    OK(fmi2DoStep(alone_b, k * STEP, STEP, fmi2True));
  }
  for (int k = 0; k < 40; k++) {
    set_inputs(a, k);
    set_inputs(b, k + 100);
    OK(fmi2DoStep(a, k * STEP, STEP, fmi2True));
    OK(fmi2DoStep(b, k * STEP, STEP, fmi2True));
  }
  expect_same_and_free(bytes_of(a), bytes_of(alone_a), "first of two");
  expect_same_and_free(bytes_of(b), bytes_of(alone_b), "second of two");
  saved_bytes x = bytes_of(a), y = bytes_of(b);
  TEST_ASSERT_TRUE(memcmp(x.at, y.at, x.count) != 0);
  free(x.at);
  free(y.at);
}

static void test_reset_makes_a_new_instance_bit_for_bit(void)
{
  fmi2Component const c = instantiated(), fresh = instantiated();
  OK(put_real(c, ANOTHER_PARAMETER, 1700.0));
  initialized(c);
  stepped(c, 0, 20);
  const double before = real_of(c, AN_OUTPUT);
  OK(fmi2Terminate(c));
  OK(fmi2Reset(c));
  expect_same_and_free(bytes_of(c), bytes_of(fresh), "reset");
  initialized(c);
  initialized(fresh);
  stepped(c, 0, 20);
  stepped(fresh, 0, 20);
  TEST_ASSERT_TRUE(real_of(c, AN_OUTPUT) != before); /* the mass is the default again */
  expect_same_and_free(bytes_of(c), bytes_of(fresh), "second run");
}
