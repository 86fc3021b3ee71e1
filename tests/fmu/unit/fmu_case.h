/* tests/fmu/unit/fmu_case.h - shared by the tests of the FMI functions. They are linked
 * with the glue and one model each, and run for every model. Each test file includes it
 * once. */
#ifndef FMU_CASE_H
#define FMU_CASE_H

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "model/state.h" /* some tests forge the content of a model */
#include "fmi2Functions.h"
#include "fmu_guid.h"
#include "fmu_model.h"
#include "unity.h"

#define STEP 0.01
#define COUNT(table) ((int)(sizeof(table) / sizeof((table)[0])))
static const fmi2ValueReference NO_SUCH = 1000000u;

#if defined(CASE_ESTIMATOR)
#define AN_INPUT "wheel_speed_rear"
#define A_PARAMETER "filter.forgetting"
#define A_RANGE "0.9 .. 0.9999"
#define ANOTHER_PARAMETER "vehicle.mass"
#define AN_INTEGER "filter.particles"
#define AN_OUTPUT "estimate.vel_x"
#define A_FLAG "estimate.valid"
#else
#define AN_INPUT "wheel_torque_front"
#define A_PARAMETER "simulation.noise"
#define A_RANGE "0 .. 100"
#define ANOTHER_PARAMETER "vehicle.mass"
#define AN_INTEGER "simulation.seed"
#define AN_OUTPUT "sensor.accel_x"
#define A_FLAG "ramp"
#endif

/* ---- messages of the FMU */

typedef struct log_line {
  void *environment;
  char name[160], category[40], text[600];
  fmi2Status status;
} log_line;
static log_line lines[1000];
static int said;
static int bad_lines; /* with a character of a format, or of an unknown category */

static void logger(fmi2ComponentEnvironment environment, fmi2String name, fmi2Status status,
    fmi2String category, fmi2String text, ...)
{
  log_line *const l = &lines[said < COUNT(lines) ? said : COUNT(lines) - 1];
  l->environment = environment, l->status = status;
  (void)snprintf(l->name, sizeof l->name, "%s", name);
  (void)snprintf(l->category, sizeof l->category, "%s", category);
  (void)snprintf(l->text, sizeof l->text, "%s", text);
  if (strpbrk(text, "%#")) bad_lines++;
  if (strcmp(category, "logStatusError") != 0 && strcmp(category, "logStatusWarning") != 0
      && strcmp(category, "logEvents") != 0)
    bad_lines++;
  said++;
}

static int here; /* its address is the environment */
static const fmi2CallbackFunctions callbacks = { logger, NULL, NULL, NULL, &here };

/* ---- instances; those that a test leaves are freed */

static fmi2Component made[64];
static int made_count;

static fmi2Component instantiated_as(const char *name)
{
  fmi2Component const c = fmi2Instantiate(
      name, fmi2CoSimulation, FMU_GUID, "file:///nowhere", &callbacks, fmi2False, fmi2False);
  if (c && made_count < COUNT(made)) made[made_count++] = c;
  return c;
}

static fmi2Component instantiated(void)
{
  fmi2Component const c = instantiated_as("one");
  TEST_ASSERT_NOT_NULL(c);
  return c;
}

void setUp(void);
void tearDown(void);
void setUp(void) { said = bad_lines = 0; }
void tearDown(void)
{
  while (made_count > 0) fmi2FreeInstance(made[--made_count]);
  TEST_ASSERT_EQUAL_INT_MESSAGE(0, bad_lines, "a log line has a '%' or '#', or an unknown category");
}

static inline const char *last_line(void)
{
  return said > 0 && said <= COUNT(lines) ? lines[said - 1].text : "";
}

/* Check that a call was refused with fmi2Error and one message that contains all these
 * words (up to a NULL). */
static inline void expect_refused(fmi2Status status, int said_before, const char *word, ...)
{
  va_list words;
  TEST_ASSERT_EQUAL_INT_MESSAGE(fmi2Error, status, word);
  TEST_ASSERT_EQUAL_INT_MESSAGE(said_before + 1, said, word);
  TEST_ASSERT_EQUAL_STRING("logStatusError", lines[said - 1].category);
  TEST_ASSERT_EQUAL_INT(fmi2Error, lines[said - 1].status);
  va_start(words, word);
  for (; word; word = va_arg(words, const char *))
    if (!strstr(last_line(), word)) {
      char text[900];
      (void)snprintf(text, sizeof text, "'%s' is not in the log line '%s'", word, last_line());
      va_end(words);
      TEST_FAIL_MESSAGE(text);
    }
  va_end(words);
}
#define REFUSED(call, ...)                                   \
  do {                                                       \
    const int said_before_ = said;                           \
    const fmi2Status status_ = (call);                       \
    expect_refused(status_, said_before_, __VA_ARGS__, NULL); \
  } while (0)
#define OK(call) TEST_ASSERT_EQUAL_INT_MESSAGE(fmi2OK, (call), last_line())

/* ---- variables by name */

static inline fmi2ValueReference ref(const char *name)
{
  for (int32_t i = 0; i < fmu_variable_count; i++)
    if (strcmp(fmu_variables[i].name, name) == 0) return (fmi2ValueReference)i;
  TEST_FAIL_MESSAGE(name);
  return NO_SUCH;
}

/* put_real(), real_of() and so on. */
#define ACCESS(type, Type)                                                                   \
  static inline fmi2Status put_##type(fmi2Component c, const char *name, fmi2##Type value)   \
  {                                                                                          \
    const fmi2ValueReference vr = ref(name);                                                 \
    return fmi2Set##Type(c, &vr, 1, &value);                                                 \
  }                                                                                          \
  static inline fmi2##Type type##_of(fmi2Component c, const char *name)                      \
  {                                                                                          \
    const fmi2ValueReference vr = ref(name);                                                 \
    fmi2##Type value = 7;                                                                    \
    OK(fmi2Get##Type(c, &vr, 1, &value));                                                    \
    return value;                                                                            \
  }
ACCESS(real, Real)
ACCESS(integer, Integer)
ACCESS(boolean, Boolean)

/* Of any type. */
static inline double value_of(fmi2Component c, const fmu_variable *v)
{
  if (v->kind != 'b') return v->kind == 'r' ? real_of(c, v->name) : integer_of(c, v->name);
  const fmi2Boolean value = boolean_of(c, v->name);
  TEST_ASSERT_TRUE_MESSAGE(value == fmi2False || value == fmi2True, v->name);
  return value;
}

/* ---- phases, and the message of a refusal in each; `fmi`: prefix of the functions */

enum { BEFORE = 1, INIT = 2, STEPS = 4, ENDED = 8, EVER = 15 };
typedef struct named_phase {
  int phase;
  const char *words;
} named_phase;
#define PHASES(fmi)                                                                                  \
  {                                                                                                  \
    { BEFORE, "before initialization" }, { INIT, "in initialization mode" }, { STEPS, "while stepping" }, \
    { ENDED, "after " fmi "Terminate" }                                                              \
  }

/* Values by name, of any type, in a table that ends with NULL. SET(c, { "vehicle.mass",
 * 1700 }, { "ramp", 0 }) */
typedef struct named {
  const char *name;
  double value;
} named;
static inline void put_all(fmi2Component c, const named *n)
{
  for (; n->name; n++) {
    const char kind = fmu_variables[ref(n->name)].kind;
    OK(kind == 'r'        ? put_real(c, n->name, n->value)
            : kind == 'b' ? put_boolean(c, n->name, n->value != 0)
                          : put_integer(c, n->name, (int)n->value));
  }
}
#define SET(c, ...) put_all(c, (const named[]){ __VA_ARGS__, { NULL, 0 } })

/* ---- a run: inputs of step k are a function of k */

static inline void begin(fmi2Component c)
{
  OK(fmi2EnterInitializationMode(c));
  OK(fmi2ExitInitializationMode(c));
}

/* Free the last instance. */
static inline void drop(fmi2Component c)
{
  fmi2FreeInstance(c);
  made_count--;
}

static inline void set_inputs(fmi2Component c, int k)
{
#if defined(CASE_ESTIMATOR)
  const double speed = 20.0 / 0.33 + 0.4 * sin(0.05 * k);
  SET(c, { "steer_angle", 0.02 * sin(0.13 * k) }, { "wheel_speed_front", speed + 0.2 * sin(0.21 * k) },
      { "wheel_speed_rear", speed }, { "accel_x", 0.7 * cos(0.05 * k) + 0.1 * sin(7.1 * k) },
      { "accel_y", 1.9 * sin(0.13 * k) + 0.1 * sin(5.3 * k) },
      { "yaw_rate", 0.1 * sin(0.13 * k) + 0.003 * sin(9.7 * k) });
#else
  SET(c, { "steer_angle", 0.02 * sin(0.13 * k) }, { "wheel_torque_front", 700.0 * cos(0.09 * k) },
      { "brake_torque_rear", 100.0 + 50.0 * sin(0.2 * k) }, { "road_level", k < 20 ? 1.0 : 0.8 });
#endif
}

static inline void initialized(fmi2Component c)
{
#if defined(CASE_ESTIMATOR)
  OK(put_integer(c, "filter.particles", 60)); /* not a multiple of eight: includes padding */
#endif
  OK(fmi2SetupExperiment(c, fmi2False, 0.0, 0.0, fmi2False, 0.0));
  begin(c);
}

static inline void stepped(fmi2Component c, int first, int last)
{
  for (int k = first; k < last; k++) {
    set_inputs(c, k);
    OK(fmi2DoStep(c, k * STEP, STEP, fmi2True));
  }
}

static inline fmi2Component stepping(void)
{
  fmi2Component const c = instantiated();
  initialized(c);
  return c;
}

/* ---- the whole state as bytes, for comparisons; the caller frees it */

typedef struct saved_bytes {
  fmi2Byte *at;
  size_t count;
} saved_bytes;

static inline saved_bytes bytes_of(fmi2Component c)
{
  saved_bytes b;
  fmi2FMUstate state = NULL;
  OK(fmi2GetFMUstate(c, &state));
  OK(fmi2SerializedFMUstateSize(c, state, &b.count));
  b.at = malloc(b.count); /* exact size: sanitizers detect writes beyond it */
  TEST_ASSERT_NOT_NULL(b.at);
  OK(fmi2SerializeFMUstate(c, state, b.at, b.count));
  OK(fmi2FreeFMUstate(c, &state));
  TEST_ASSERT_NULL(state);
  return b;
}

static inline void expect_same_and_free(saved_bytes a, saved_bytes b, const char *what)
{
  const int same = a.count == b.count && memcmp(a.at, b.at, a.count) == 0;
  char text[200];
  if (!same && a.count == b.count) {
    size_t i = 0;
    while (i < a.count && (i < 32 || a.at[i] == b.at[i]))
      i++; /* 32: after the header, whose checksum differs anyway */
    (void)snprintf(text, sizeof text, "%s: states differ from byte %lu of %lu on", what, (unsigned long)i,
        (unsigned long)a.count);
  } else {
    (void)snprintf(text, sizeof text, "%s: states have other sizes", what);
  }
  free(a.at);
  free(b.at);
  if (!same) TEST_FAIL_MESSAGE(text);
}

/* Check that the state is unchanged, bit for bit. `before` is freed on failure, so that a
 * leak reported by a sanitizer does not hide the failure. */
static inline void expect_unchanged(fmi2Component c, saved_bytes *before, const char *what)
{
  const saved_bytes now = bytes_of(c);
  const int same = now.count == before->count && memcmp(now.at, before->at, now.count) == 0;
  free(now.at);
  if (!same) {
    free(before->at);
    before->at = NULL;
  }
  TEST_ASSERT_TRUE_MESSAGE(same, what);
}

static inline void expect_unchanged_and_free(fmi2Component c, saved_bytes *before, const char *what)
{
  expect_unchanged(c, before, what);
  free(before->at);
}

#endif
