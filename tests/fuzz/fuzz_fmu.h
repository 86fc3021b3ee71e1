/* tests/fuzz/fuzz_fmu.h - shared by the targets of the FMI functions: an importer that
 * checks the log. Linked with the glue and one model. */
#ifndef FUZZ_FMU_H
#define FUZZ_FMU_H

#include "fmi2Functions.h"
#include "fmu_guid.h"
#include "fmu_model.h"
#include "fuzz.h"

static int said;            /* number of messages since it was reset */
static int odd_lines;       /* number of messages with characters of a format */
static char last_text[600]; /* last message */

static inline void listen(fmi2ComponentEnvironment environment, fmi2String name, fmi2Status status,
    fmi2String category, fmi2String text, ...)
{
  (void)environment;
  (void)name;
  (void)status;
  (void)category;
  if (strpbrk(text, "%#")) odd_lines++; /* importers may interpret them as a format */
  (void)snprintf(last_text, sizeof last_text, "%s", text);
  said++;
}
static const fmi2CallbackFunctions callbacks = { listen, NULL, NULL, NULL, NULL };

/* Return a new instance. */
static inline fmi2Component made(void)
{
  fmi2Component const c = fmi2Instantiate(
      "fuzz", fmi2CoSimulation, FMU_GUID, "file:///nowhere", &callbacks, fmi2False, fmi2False);
  MUST(c, "no instance");
  return c;
}

/* Serialize the state of an instance into a buffer.   Returned: number of bytes */
static inline size_t serialized(fmi2Component c, fmi2Byte *at, size_t most)
{
  fmi2FMUstate state = NULL;
  size_t count = 0;
  MUST(fmi2GetFMUstate(c, &state) == fmi2OK && fmi2SerializedFMUstateSize(c, state, &count) == fmi2OK,
      "no state: %s", last_text);
  MUST(count <= most, "%lu bytes", (unsigned long)count);
  MUST(fmi2SerializeFMUstate(c, state, at, count) == fmi2OK && fmi2FreeFMUstate(c, &state) == fmi2OK,
      "no bytes: %s", last_text);
  return count;
}
enum {
  MOST_BYTES = 1 << 18, /* max size of a serialized state */
  FRAME = 32,           /* size of its header: `frame` in fmu/glue/glue.c */
  SUM = 24              /* offset of the checksum in the header */
};

/* Copy the state of an instance without header and checksum, which take longer than all
 * calls together. A saved state contains the serialized bytes, a few words after its
 * start. */
static inline size_t bytes_of(fmi2Component c, fmi2Byte *at, size_t most)
{
  static size_t offset, count;
  static fmi2Byte once[MOST_BYTES];
  fmi2FMUstate state = NULL;
  if (!count) count = serialized(c, once, sizeof once) - FRAME;
  MUST(count <= most && fmi2GetFMUstate(c, &state) == fmi2OK, "no state: %s", last_text);
  while (once[0] && memcmp((const fmi2Byte *)state + offset, once + FRAME, count) != 0)
    MUST((offset += 8) <= 64, "the content of a state is nowhere");
  once[0] = 0; /* the offset is known now */
  memcpy(at, (const fmi2Byte *)state + offset, count);
  MUST(fmi2FreeFMUstate(c, &state) == fmi2OK, "not freed: %s", last_text);
  return count;
}

/* Check that all outputs are finite. Before the first step, reading an output computes
 * all of them, and is refused while an input is out of range. */
static inline void must_put_out_numbers(fmi2Component c, const char *when)
{
  for (int32_t i = 0; i < fmu_variable_count; i++) {
    const fmi2ValueReference vr = (fmi2ValueReference)i;
    fmi2Real x = 0;
    if (fmu_variables[i].role != 'o' || fmu_variables[i].kind != 'r') continue;
    if (fmi2GetReal(c, &vr, 1, &x) != fmi2OK) return;
    MUST(x - x == 0, "%s is %g %s", fmu_variables[i].name, x, when);
  }
}

/* Take a value for a variable, most often within its range. */
static inline double take_value(bytes *b, const fmu_variable *v)
{
  const double lo = v->hi >= v->lo ? v->lo : -100.0, hi = v->hi >= v->lo ? v->hi : 100.0;
  switch (take(b, 1) & 7u) {
    case 0: return lo;
    case 1: return hi;
    case 2: return v->kind == 'r' ? take_odd(b) : v->start;
    case 3:
    case 4: return take_between(b, lo, hi);
    case 5: return v->start;
    default: return v->start + 0.01 * (hi - lo) * take_between(b, -0.5, 0.5);
  }
}

static inline fmi2Status set_one(fmi2Component c, bytes *b, uint32_t which)
{
  const fmu_variable *const v = &fmu_variables[which % (uint32_t)fmu_variable_count];
  const fmi2ValueReference vr = (fmi2ValueReference)(which % (uint32_t)fmu_variable_count);
  const double x = take_value(b, v);
  const fmi2Integer k = x > -2147483648.0 && x < 2147483647.0 ? (fmi2Integer)x : 0;
  const fmi2Boolean flag = k > 0;
  return v->kind == 'r' ? fmi2SetReal(c, &vr, 1, &x)
      : v->kind != 'b'  ? fmi2SetInteger(c, &vr, 1, &k)
                        : fmi2SetBoolean(c, &vr, 1, &flag);
}

static inline double clock_of(fmi2Component c)
{
  fmi2Real time = 0;
  MUST(fmi2GetRealStatus(c, fmi2LastSuccessfulTime, &time) == fmi2OK, "no clock: %s", last_text);
  return time;
}

#endif
