/* tests/fmu/unit/test_values.c - getting and setting: references, types, ranges,
 * phases. */
#include "fmu_case.h"

static void test_the_table_is_sound(void)
{
  for (int32_t i = 0; i < fmu_variable_count; i++) {
    const fmu_variable *const v = &fmu_variables[i];
    const size_t size = v->kind == 'r' ? sizeof(double) : sizeof(int32_t);
    TEST_ASSERT_TRUE_MESSAGE(
        v->kind == 'r' || v->kind == 'i' || v->kind == 'b' || (v->kind == 'e' && v->role == 'o'), v->name);
    TEST_ASSERT_TRUE_MESSAGE(v->role == 'p' || v->role == 'i' || v->role == 'o', v->name);
    TEST_ASSERT_TRUE_MESSAGE(
        v->offset >= 0 && (size_t)v->offset + size <= sizeof(model) && (size_t)v->offset % size == 0,
        v->name);
    TEST_ASSERT_TRUE_MESSAGE(v->rate == FMU_NO_RATE || (v->role == 'i' && v->kind == 'r'), v->name);
    if (v->role != 'o' && v->hi >= v->lo)
      TEST_ASSERT_TRUE_MESSAGE(
          (v->start >= v->lo && v->start <= v->hi) || (v->role == 'p' && v->start == 0), v->name);
    if (v->role == 'p' && v->kind != 'b') TEST_ASSERT_TRUE_MESSAGE(v->hi >= v->lo, v->name);
    for (int32_t k = 0; k < i; k++) {
      TEST_ASSERT_TRUE_MESSAGE(strcmp(v->name, fmu_variables[k].name) != 0, v->name);
      TEST_ASSERT_TRUE_MESSAGE(
          v->offset != fmu_variables[k].offset, v->name); /* no two variables share a place */
      TEST_ASSERT_TRUE_MESSAGE(v->rate == FMU_NO_RATE || v->rate != fmu_variables[k].rate, v->name);
    }
  }
}

static void test_starts_are_there_from_the_start_and_after_a_reset(void)
{
  fmi2Component const c = instantiated();
  for (int round = 0; round < 2; round++) {
    for (int32_t i = 0; i < fmu_variable_count; i++) {
      const fmu_variable *const v = &fmu_variables[i];
      if (v->role == 'o') continue;
      TEST_ASSERT_TRUE_MESSAGE(value_of(c, v) == v->start, v->name);
    }
    SET(c, { AN_INPUT, 3.0 }, { ANOTHER_PARAMETER, 1234.0 });
    initialized(c);
    stepped(c, 0, 2);
    OK(fmi2Reset(c));
  }
}

/* Every parameter and input takes its own value and returns it, without changing another
 * one. */
static void test_every_variable_has_a_place_of_its_own(void)
{
  fmi2Component const c = instantiated();
  for (int read = 0; read < 2; read++)
    for (int32_t i = 0; i < fmu_variable_count; i++) {
      const fmu_variable *const v = &fmu_variables[i];
      if (v->role == 'o') continue;
      const double within = v->lo + (v->hi - v->lo) * (1 + i % 7) / 9.0;
      const double own = v->kind == 'r' ? within : v->kind == 'i' ? (int)within : v->start <= 0;
      if (read) TEST_ASSERT_TRUE_MESSAGE(value_of(c, v) == own, v->name);
      else SET(c, { v->name, own });
    }
}

static void test_every_parameter_is_refused_beyond_its_range_and_taken_at_its_ends(void)
{
  fmi2Component const c = instantiated();
  for (int32_t i = 0; i < fmu_variable_count; i++) {
    const fmu_variable *const v = &fmu_variables[i];
    if (v->role != 'p' || v->kind == 'b') continue;
    if (v->kind == 'r') {
      const double bad[] = { nextafter(v->lo, -1e300), nextafter(v->hi, 1e300), (double)NAN, (double)INFINITY,
        -(double)INFINITY };
      for (int k = 0; k < COUNT(bad); k++) {
        REFUSED(put_real(c, v->name, bad[k]), "fmi2SetReal", v->name, "outside its range");
        TEST_ASSERT_TRUE_MESSAGE(real_of(c, v->name) == v->start, v->name);
      }
      OK(put_real(c, v->name, v->lo));
      OK(put_real(c, v->name, v->hi));
      OK(put_real(c, v->name, v->start));
    } else {
      REFUSED(put_integer(c, v->name, (int)v->lo - 1), "fmi2SetInteger", v->name, "outside its range");
      if (v->hi < 2147483647.0)
        REFUSED(put_integer(c, v->name, (int)v->hi + 1), "fmi2SetInteger", v->name, "outside its range");
      TEST_ASSERT_TRUE_MESSAGE(integer_of(c, v->name) == (int)v->start, v->name);
      OK(put_integer(c, v->name, (int)v->lo));
      OK(put_integer(c, v->name, (int)v->hi));
    }
  }
  REFUSED(put_real(c, A_PARAMETER, -7.5), A_PARAMETER " = -7.5 is outside its range " A_RANGE);
  TEST_ASSERT_NULL(strstr(last_line(), A_RANGE " 1")); /* ranges of ratios have no unit */
  REFUSED(put_real(c, ANOTHER_PARAMETER, 1.0), "50 .. 50000 kg");
}

static void test_of_several_values_none_is_set_when_one_is_refused(void)
{
  fmi2Component const c = instantiated();
  const fmi2ValueReference vr[] = { ref(AN_INPUT), ref(ANOTHER_PARAMETER), ref(A_PARAMETER) };
  const fmi2Real values[] = { 1.0, 1500.0, -1.0 };
  saved_bytes before = bytes_of(c);
  REFUSED(fmi2SetReal(c, vr, 3, values), A_PARAMETER);
  const fmi2ValueReference unknown[] = { ref(AN_INPUT), NO_SUCH };
  REFUSED(fmi2SetReal(c, unknown, 2, values), "unknown value reference 1000000");
  const fmi2ValueReference output[] = { ref(AN_INPUT), ref(AN_OUTPUT) };
  REFUSED(fmi2SetReal(c, output, 2, values), AN_OUTPUT);
  expect_unchanged_and_free(c, &before, "after refusals");

  const fmi2Real good[] = { 1.0, 1500.0, fmu_variables[ref(A_PARAMETER)].lo };
  fmi2Real got[3] = { 0 };
  OK(fmi2SetReal(c, vr, 3, good));
  OK(fmi2GetReal(c, vr, 3, got));
  for (int i = 0; i < 3; i++) TEST_ASSERT_TRUE(got[i] == good[i]);
}

static void test_unknown_references_and_wrong_types_are_named_and_nothing_is_written(void)
{
  fmi2Component const c = stepping();
  const fmi2ValueReference real = ref(AN_INPUT), integer = ref(AN_INTEGER), flag = ref(A_FLAG),
                           end = (fmi2ValueReference)fmu_variable_count;
  fmi2Real r[2] = { 77, 77 };
  fmi2Integer i[2] = { 77, 77 };
  fmi2Boolean b[2] = { 77, 77 };
  fmi2String s[2] = { NULL, NULL };
  char number[40];
  (void)snprintf(number, sizeof number, "unknown value reference %u", (unsigned)end);
  REFUSED(fmi2GetReal(c, &end, 1, r), number);
  REFUSED(fmi2GetInteger(c, &end, 1, i), number);
  REFUSED(fmi2GetBoolean(c, &NO_SUCH, 1, b), "unknown value reference 1000000");
  REFUSED(fmi2GetString(c, &end, 1, s), number);
  REFUSED(fmi2SetReal(c, &end, 1, r), number);
  REFUSED(fmi2SetInteger(c, &end, 1, i), number);
  REFUSED(fmi2SetBoolean(c, &NO_SUCH, 1, b), "unknown value reference 1000000");
  REFUSED(fmi2SetString(c, &end, 1, s), number);
  const fmi2ValueReference largest = 4294967295u;
  REFUSED(fmi2GetReal(c, &largest, 1, r), "unknown value reference 4294967295");

  REFUSED(fmi2GetReal(c, &integer, 1, r), AN_INTEGER, "is of type Integer, not Real");
  REFUSED(fmi2GetReal(c, &flag, 1, r), A_FLAG, "is of type Boolean, not Real");
  REFUSED(fmi2GetInteger(c, &real, 1, i), AN_INPUT, "is of type Real, not Integer");
  REFUSED(fmi2GetInteger(c, &flag, 1, i), A_FLAG, "is of type Boolean, not Integer");
  REFUSED(fmi2GetBoolean(c, &integer, 1, b), AN_INTEGER, "is of type Integer, not Boolean");
  REFUSED(fmi2GetString(c, &real, 1, s), AN_INPUT, "is of type Real, not String");
  REFUSED(fmi2SetReal(c, &integer, 1, r), AN_INTEGER, "is of type Integer, not Real");
  REFUSED(fmi2SetInteger(c, &real, 1, i), AN_INPUT, "is of type Real, not Integer");
  REFUSED(fmi2SetBoolean(c, &real, 1, b), AN_INPUT, "is of type Real, not Boolean");
  REFUSED(fmi2SetString(c, &real, 1, s), AN_INPUT, "is of type Real, not String");

  const fmi2ValueReference two[] = { ref(AN_OUTPUT), end };
  REFUSED(fmi2GetReal(c, two, 2, r), number);
  TEST_ASSERT_TRUE(r[0] == 77 && r[1] == 77 && i[0] == 77 && b[0] == 77 && !s[0]);
}

static void test_outputs_cannot_be_set_and_parameters_only_before_the_first_step(void)
{
  fmi2Component const c = instantiated();
  for (int phase = 0; phase < 3; phase++) {
    if (phase == 1) OK(fmi2EnterInitializationMode(c));
    if (phase == 2) OK(fmi2ExitInitializationMode(c));
    for (int32_t i = 0; i < fmu_variable_count; i++) {
      const fmu_variable *const v = &fmu_variables[i];
      const fmi2ValueReference vr = (fmi2ValueReference)i;
      const fmi2Real r = v->start;
      const fmi2Integer k = (fmi2Integer)v->start;
      const fmi2Boolean b = v->start > 0;
      const int n = said;
      const fmi2Status status = v->kind == 'r' ? fmi2SetReal(c, &vr, 1, &r)
          : v->kind == 'b'                     ? fmi2SetBoolean(c, &vr, 1, &b)
                                               : fmi2SetInteger(c, &vr, 1, &k);
      if (v->role == 'o') expect_refused(status, n, v->name, "is an output", NULL);
      else if (v->role == 'p' && phase == 2)
        expect_refused(status, n, v->name, "fixed parameter", "while stepping", NULL);
      else TEST_ASSERT_EQUAL_INT_MESSAGE(fmi2OK, status, v->name);
    }
    said = 0;
  }
}

static void test_booleans_are_true_or_false_whatever_number_says_so(void)
{
  for (int32_t i = 0; i < fmu_variable_count; i++) {
    if (fmu_variables[i].kind != 'b' || fmu_variables[i].role == 'o') continue;
    fmi2Component const c = instantiated();
    OK(put_boolean(c, fmu_variables[i].name, 42));
    TEST_ASSERT_EQUAL_INT(fmi2True, boolean_of(c, fmu_variables[i].name));
    OK(put_boolean(c, fmu_variables[i].name, fmi2False));
    TEST_ASSERT_EQUAL_INT(fmi2False, boolean_of(c, fmu_variables[i].name));
  }
}

/* Values derived from settings are available in initialization mode, and follow changed
 * settings. */
static void test_outputs_follow_parameters_in_initialization_mode(void)
{
  fmi2Component const c = instantiated();
#if defined(CASE_ESTIMATOR)
  static const char setting[] = "vehicle.cornering_stiffness_front", output[] = "estimate.cy_front";
#else
  static const char setting[] = "vehicle.cornering_stiffness_front", output[] = "true.cy_front";
#endif
  OK(put_real(c, setting, 9e4));
  OK(fmi2EnterInitializationMode(c));
  TEST_ASSERT_TRUE(real_of(c, output) == 9e4);
  OK(put_real(c, setting, 8e4));
  TEST_ASSERT_TRUE(real_of(c, output) == 8e4);
  OK(put_real(c, AN_INPUT, 1.0));
  OK(fmi2ExitInitializationMode(c));
  TEST_ASSERT_TRUE(real_of(c, output) == 8e4);
}

/* Reading outputs and changing settings back and forth before the start do not affect the
 * run. */
static void test_what_was_tried_before_the_start_leaves_no_trace(void)
{
  fmi2Component const a = instantiated(), b = instantiated();
  OK(put_real(a, ANOTHER_PARAMETER, 1500.0));
  OK(fmi2EnterInitializationMode(a));
  for (int i = 0; i < 3; i++) {
    (void)real_of(a, AN_OUTPUT);
    OK(put_real(a, ANOTHER_PARAMETER, 1600.0 + i));
    set_inputs(a, i);
  }
  OK(put_real(a, ANOTHER_PARAMETER, 1800.0));
  set_inputs(a, 0);
  OK(put_real(b, ANOTHER_PARAMETER, 1800.0));
  set_inputs(b, 0);
  OK(fmi2EnterInitializationMode(b));
  OK(fmi2ExitInitializationMode(a));
  OK(fmi2ExitInitializationMode(b));
  expect_same_and_free(bytes_of(a), bytes_of(b), "initialized after trials");
}
