/* tests/fmu/client.c - a small importer for co-simulation, FMI 2.0 and 3.0, for platforms
 * without another one (qemu-user, wine).
 *
 *   client BINARY GUID INPUT.csv OUTPUT.csv [--set r12=0.5]... [--outputs r50,i60,b61]
 *   [--save FILE@ROW] [--restore FILE@ROW]
 *
 *   BINARY      shared library in the FMU: binaries/linux64/X.so, binaries/win64/X.dll
 *   ...
 *   GUID        as in modelDescription.xml; for FMI 3.0 the instantiation token
 *   INPUT.csv   header: time,r3,r4,i6 ... Type (r Real or Float64, i Integer or Int32, b
 *   Boolean, e Enumeration) and value reference of each column. One row per step: set the
 *   values, then fmi2DoStep() to the time of the next row. The last step is as long as
 *   the one before. An empty cell is NaN for a Real, and is not set for other types
 *   OUTPUT.csv  header: time,status,r50,i60 ... For each row its time, the fmi2Status of
 *   its step, and the values after it
 *   --set       set a parameter before initialization
 *   --outputs   variables to write; default: all, found by trying value references from 0
 *   --save      save the serialized state before the inputs of row ROW (0: the first)
 *   --restore   continue with row ROW from a saved state, without the rows before it
 *
 * Reals are read as decimal numbers, or as x and the 16 hexadecimal digits of their bits
 * (x3ff0000000000000 is 1). They are written in the latter form, so that outputs of all
 * platforms can be compared byte by byte. Log messages of the FMU go to stderr. Exit
 * code: 0 done, 1 a call was refused, 2 usage. */
#if !defined(_WIN32)
#define _POSIX_C_SOURCE 200112L
#endif
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fmi2FunctionTypes.h"
#if defined(CLIENT_FMI3) /* the headers of FMI 3.0 are available */
#include "fmi3FunctionTypes.h"
#endif

#if defined(_WIN32)
#include <windows.h>
typedef HMODULE library;
static library open_library(const char *path) { return LoadLibraryA(path); }
static void *symbol(library l, const char *name)
{
  void *p;
  const FARPROC f = GetProcAddress(l, name);
  memcpy(&p, &f, sizeof p);
  return p;
}
static const char *why(void) { return "LoadLibrary failed"; }
#else
#include <dlfcn.h>
typedef void *library;
static library open_library(const char *path) { return dlopen(path, RTLD_NOW | RTLD_LOCAL); }
static void *symbol(library l, const char *name) { return dlsym(l, name); }
static const char *why(void) { return dlerror(); }
#endif

/* ---- the functions of the FMU */

#define FUNCTIONS2(X) \
  X(Instantiate) X(FreeInstance) X(SetupExperiment) X(EnterInitializationMode) X(ExitInitializationMode) \
  X(Terminate) X(GetReal) X(GetInteger) X(GetBoolean) X(SetReal) X(SetInteger) X(SetBoolean) X(DoStep) \
  X(GetFMUstate) X(SetFMUstate) X(FreeFMUstate) X(SerializedFMUstateSize) X(SerializeFMUstate) \
  X(DeSerializeFMUstate)
#define X(name) static fmi2##name##TYPE *two##name;
FUNCTIONS2(X)
#undef X
#if defined(CLIENT_FMI3)
#define FUNCTIONS3(X) \
  X(InstantiateCoSimulation) X(FreeInstance) X(EnterInitializationMode) X(ExitInitializationMode) \
  X(Terminate) X(GetFloat64) X(GetInt32) X(GetInt64) X(GetBoolean) X(SetFloat64) X(SetInt32) \
  X(SetBoolean) X(DoStep) X(GetFMUState) X(SetFMUState) X(FreeFMUState) X(SerializedFMUStateSize) \
  X(SerializeFMUState) X(DeserializeFMUState)
#define X(name) static fmi3##name##TYPE *three##name;
FUNCTIONS3(X)
#undef X
static int is_3;
#endif

static void stop(const char *what, const char *which)
{
  (void)fprintf(stderr, "client: %s%s%s\n", what, which ? ": " : "", which ? which : "");
  exit(1);
}

#define LOAD(to, name)                        \
  do {                                        \
    p = symbol(l, name);                      \
    if (!p) stop("the binary lacks", name);   \
    memcpy(&(to), &p, sizeof p);              \
  } while (0);

static void load(const char *path)
{
  library const l = open_library(path);
  void *p;
  if (!l) stop(path, why());
#if defined(CLIENT_FMI3)
  is_3 = symbol(l, "fmi3GetVersion") != NULL;
#define X(name) LOAD(three##name, "fmi3" #name)
  if (is_3) {
    FUNCTIONS3(X)
    return;
  }
#undef X
#endif
#define X(name) LOAD(two##name, "fmi2" #name)
  FUNCTIONS2(X)
#undef X
}

static int quiet; /* 1: while value references are tried */

static void logger(fmi2ComponentEnvironment environment, fmi2String name, fmi2Status status,
    fmi2String category, fmi2String text, ...)
{
  (void)environment;
  if (!quiet) (void)fprintf(stderr, "%s %d %s: %s\n", name, (int)status, category, text);
}

#if defined(CLIENT_FMI3)
static void logger3(
    fmi3InstanceEnvironment environment, fmi3Status status, fmi3String category, fmi3String text)
{
  (void)environment;
  if (!quiet) (void)fprintf(stderr, "client %d %s: %s\n", (int)status, category, text);
}
#define BY_VERSION(call3, call2) (is_3 ? (fmi2Status)(call3) : (call2))
#else
#define BY_VERSION(call3, call2) (call2)
#endif

/* The two versions under one name. Their statuses have the same numbers. */
static void *instantiate(const char *guid)
{
  static const fmi2CallbackFunctions callbacks = { logger, NULL, NULL, NULL, NULL };
#if defined(CLIENT_FMI3)
  if (is_3)
    return threeInstantiateCoSimulation(
        "client", guid, NULL, fmi3False, fmi3False, fmi3False, fmi3False, NULL, 0, NULL, logger3, NULL);
#endif
  return twoInstantiate("client", fmi2CoSimulation, guid, NULL, &callbacks, fmi2False, fmi2False);
}
static void free_instance(void *c)
{
#if defined(CLIENT_FMI3)
  if (is_3) {
    threeFreeInstance(c);
    return;
  }
#endif
  twoFreeInstance(c);
}
static fmi2Status enter(void *c, double start)
{
#if defined(CLIENT_FMI3)
  if (is_3) return (fmi2Status)threeEnterInitializationMode(c, fmi3False, 0.0, start, fmi3False, 0.0);
#endif
  return twoSetupExperiment(c, fmi2False, 0.0, start, fmi2False, 0.0) > fmi2Warning
      ? fmi2Error
      : twoEnterInitializationMode(c);
}
static fmi2Status leave(void *c)
{
  return BY_VERSION(threeExitInitializationMode(c), twoExitInitializationMode(c));
}
static fmi2Status terminate(void *c) { return BY_VERSION(threeTerminate(c), twoTerminate(c)); }
static fmi2Status get_real(void *c, unsigned vr, double *value)
{
  return BY_VERSION(threeGetFloat64(c, &vr, 1, value, 1), twoGetReal(c, &vr, 1, value));
}
static fmi2Status get_integer(void *c, unsigned vr, int *value)
{
  return BY_VERSION(threeGetInt32(c, &vr, 1, value, 1), twoGetInteger(c, &vr, 1, value));
}
static fmi2Status get_enumeration(void *c, unsigned vr, int *value)
{
#if defined(CLIENT_FMI3)
  if (is_3) {
    fmi3Int64 code = 0;
    const fmi2Status status = (fmi2Status)threeGetInt64(c, &vr, 1, &code, 1);
    *value = (int)code;
    return status;
  }
#endif
  return twoGetInteger(c, &vr, 1, value);
}
static fmi2Status get_boolean(void *c, unsigned vr, int *value)
{
#if defined(CLIENT_FMI3)
  if (is_3) {
    fmi3Boolean b = fmi3False;
    const fmi2Status status = (fmi2Status)threeGetBoolean(c, &vr, 1, &b, 1);
    *value = b;
    return status;
  }
#endif
  return twoGetBoolean(c, &vr, 1, value);
}
static fmi2Status set_real(void *c, unsigned vr, double value)
{
  return BY_VERSION(threeSetFloat64(c, &vr, 1, &value, 1), twoSetReal(c, &vr, 1, &value));
}
static fmi2Status set_integer(void *c, unsigned vr, int value)
{
  return BY_VERSION(threeSetInt32(c, &vr, 1, &value, 1), twoSetInteger(c, &vr, 1, &value));
}
static fmi2Status set_boolean(void *c, unsigned vr, int value)
{
#if defined(CLIENT_FMI3)
  const fmi3Boolean b = value != 0;
#endif
  return BY_VERSION(threeSetBoolean(c, &vr, 1, &b, 1), twoSetBoolean(c, &vr, 1, &value));
}
static fmi2Status do_step(void *c, double time, double step)
{
#if defined(CLIENT_FMI3)
  fmi3Boolean event, terminated, early;
  double last;
#endif
  return BY_VERSION(threeDoStep(c, time, step, fmi3True, &event, &terminated, &early, &last),
      twoDoStep(c, time, step, fmi2True));
}
static fmi2Status get_state(void *c, void **state)
{
  return BY_VERSION(threeGetFMUState(c, state), twoGetFMUstate(c, state));
}
static fmi2Status set_state(void *c, void *state)
{
  return BY_VERSION(threeSetFMUState(c, state), twoSetFMUstate(c, state));
}
static fmi2Status free_state(void *c, void **state)
{
  return BY_VERSION(threeFreeFMUState(c, state), twoFreeFMUstate(c, state));
}
static fmi2Status state_size(void *c, void *state, size_t *size)
{
  return BY_VERSION(threeSerializedFMUStateSize(c, state, size), twoSerializedFMUstateSize(c, state, size));
}
static fmi2Status serialize(void *c, void *state, void *bytes, size_t size)
{
  return BY_VERSION(
      threeSerializeFMUState(c, state, bytes, size), twoSerializeFMUstate(c, state, bytes, size));
}
static fmi2Status deserialize(void *c, const void *bytes, size_t size, void **state)
{
  return BY_VERSION(
      threeDeserializeFMUState(c, bytes, size, state), twoDeSerializeFMUstate(c, bytes, size, state));
}

static void need(fmi2Status status, const char *call)
{
  if (status > fmi2Warning) stop("refused", call);
}

/* ---- columns */

enum { MOST = 1024 };
typedef struct column {
  char type;
  fmi2ValueReference vr;
} column;
static column inputs[MOST], outputs[MOST];
static int input_count, output_count;

static column column_of(const char *text)
{
  column c;
  char *end;
  c.type = text[0];
  c.vr = (fmi2ValueReference)strtoul(text + (text[0] != 0), &end, 10);
  if (!strchr("ribe", c.type) || !c.type || end == text + 1 || (*end && !strchr(",=\r\n", *end)))
    stop("not a variable such as r12", text);
  return c;
}

static int columns_of(const char *text, column *to)
{
  int n = 0;
  while (text && *text && *text != '\r' && *text != '\n') {
    if (n == MOST) stop("too many columns", NULL);
    to[n++] = column_of(text);
    text = strchr(text, ',');
    if (text) text++;
  }
  return n;
}

/* Read a number. Returned: start of the next cell; given 0 if the cell is empty */
static const char *number(const char *text, double *value, int *given)
{
  char *end;
  if (*text == 'x') {
    uint64_t bits = 0;
    int digits = 0;
    for (text++; *text && !strchr(",\r\n", *text); text++, digits++) {
      const char *const hex = "0123456789abcdef", *const at = strchr(hex, *text);
      if (!at) stop("not the bits of a number", text);
      bits = bits << 4 | (uint64_t)(at - hex);
    }
    if (digits != 16) stop("bits of a number have 16 digits", NULL);
    memcpy(value, &bits, sizeof bits);
    *given = 1;
    end = (char *)text;
  } else {
    *value = strtod(text, &end);
    *given = end != text;
    if (!*given) *value = strtod("nan", NULL);
  }
  if (*end && !strchr(",\r\n", *end)) stop("not a number", text);
  return *end == ',' ? end + 1 : end;
}

static fmi2Status put(void *c, column v, double value)
{
  const int i = v.type == 'r' ? 0 : (int)value;
  return v.type == 'r' ? set_real(c, v.vr, value)
      : v.type == 'i'  ? set_integer(c, v.vr, i)
                       : set_boolean(c, v.vr, i != 0);
}

static void print_bits(FILE *to, double x)
{
  uint64_t bits;
  memcpy(&bits, &x, sizeof bits);
  (void)fprintf(to, "x%08lx%08lx", (unsigned long)(bits >> 32), (unsigned long)(bits & 0xffffffffu));
}

static void print(FILE *to, void *c, column v)
{
  double r;
  int i, b;
  (void)fputc(',', to);
  if (v.type == 'r') {
    need(get_real(c, v.vr, &r), "a Real");
    print_bits(to, r);
  } else if (v.type == 'i' || v.type == 'e') {
    need(v.type == 'i' ? get_integer(c, v.vr, &i) : get_enumeration(c, v.vr, &i),
        v.type == 'i' ? "an Integer" : "an Enumeration");
    (void)fprintf(to, "%d", i);
  } else {
    need(get_boolean(c, v.vr, &b), "a Boolean");
    (void)fprintf(to, "%d", b);
  }
}

/* List all variables, if none are requested; for FMI 3.0 up to the first array. */
static void try_all(void *c)
{
  quiet = 1;
  for (fmi2ValueReference vr = 0; output_count < MOST; vr++) {
    double r;
    int i, b;
    const char type = get_real(c, vr, &r) == fmi2OK ? 'r'
        : get_integer(c, vr, &i) == fmi2OK          ? 'i'
        : get_boolean(c, vr, &b) == fmi2OK          ? 'b'
        : get_enumeration(c, vr, &i) == fmi2OK      ? 'e'
                                                    : 0;
    if (!type) break;
    outputs[output_count].type = type;
    outputs[output_count++].vr = vr;
  }
  quiet = 0;
}

/* ---- states in files */

static void save(void *c, const char *path)
{
  void *state = NULL;
  size_t size = 0;
  need(get_state(c, &state), "to save");
  need(state_size(c, state, &size), "the size of a state");
  unsigned char *const bytes = malloc(size);
  FILE *const file = fopen(path, "wb");
  if (!bytes || !file) stop("cannot write", path);
  need(serialize(c, state, bytes, size), "to serialize");
  if (fwrite(bytes, 1, size, file) != size || fclose(file) != 0) stop("cannot write", path);
  need(free_state(c, &state), "to free a state");
  free(bytes);
}

static void restore(void *c, const char *path)
{
  void *state = NULL;
  FILE *const file = fopen(path, "rb");
  const size_t most = 16u << 20;
  unsigned char *const bytes = malloc(most);
  if (!bytes || !file) stop("cannot read", path);
  const size_t size = fread(bytes, 1, most, file);
  (void)fclose(file);
  need(deserialize(c, bytes, size, &state), "to deserialize");
  need(set_state(c, state), "to restore");
  need(free_state(c, &state), "to free a state");
  free(bytes);
}

static int row_of(char *file_at_row) /* cuts the text at its last @ */
{
  char *const at = strrchr(file_at_row, '@');
  if (!at) stop("not FILE@ROW", file_at_row);
  *at = '\0';
  return atoi(at + 1);
}

static char line[2][1 << 16]; /* this row and the next */

int main(int count, char **argument)
{
  const char *from = NULL, *to = NULL;
  int save_row = -1, first = 0, given;
  double time, next, step = 0.01, value;
  if (count < 5) {
    (void)fputs("usage: client BINARY GUID INPUT.csv OUTPUT.csv [--set r12=0.5]... [--outputs r50,i60] "
                "[--save FILE@ROW] "
                "[--restore FILE@ROW]\n",
        stderr);
    return 2;
  }
  load(argument[1]);
  FILE *const in = fopen(argument[3], "r");
  if (!in || !fgets(line[0], sizeof line[0], in)) stop("cannot read", argument[3]);
  if (strncmp(line[0], "time", 4) != 0) stop("the first column must be time", argument[3]);
  input_count = line[0][4] == ',' ? columns_of(line[0] + 5, inputs) : 0;

  void *const c = instantiate(argument[2]);
  if (!c) stop("refused", "to instantiate");
  for (int i = 5; i < count; i += 2) {
    if (i + 1 == count) stop("an option lacks its value", argument[i]);
    if (strcmp(argument[i], "--set") == 0) {
      const char *const sign = strchr(argument[i + 1], '=');
      if (!sign) stop("not r12=0.5", argument[i + 1]);
      (void)number(sign + 1, &value, &given);
      need(put(c, column_of(argument[i + 1]), value), argument[i + 1]);
    } else if (strcmp(argument[i], "--outputs") == 0) {
      output_count = columns_of(argument[i + 1], outputs);
    } else if (strcmp(argument[i], "--save") == 0) {
      save_row = row_of(argument[i + 1]);
      to = argument[i + 1];
    } else if (strcmp(argument[i], "--restore") == 0) {
      first = row_of(argument[i + 1]);
      from = argument[i + 1];
    } else {
      stop("unknown option", argument[i]);
    }
  }
  if (output_count == 0) try_all(c);
  FILE *const out = fopen(argument[4], "wb"); /* b: the same line ends on all platforms */
  if (!out) stop("cannot write", argument[4]);
  (void)fputs("time,status", out);
  for (int k = 0; k < output_count; k++)
    (void)fprintf(out, ",%c%lu", outputs[k].type, (unsigned long)outputs[k].vr);
  (void)fputc('\n', out);

  int more = fgets(line[0], sizeof line[0], in) != NULL, started = 0;
  for (int row = 0; more; row++) {
    char *const now = line[row & 1], *const after = line[~row & 1];
    const char *cell = number(now, &time, &given);
    more = fgets(after, sizeof line[0], in) != NULL && *after != '\n' && *after != '\r';
    if (more) {
      (void)number(after, &next, &given);
      step = next - time;
    }
    if (row < first) continue;
    if (!started && from) restore(c, from);
    if (!started && !from) need(enter(c, time), "initialization");
    if (row == save_row && started) save(c, to);
    for (int k = 0; k < input_count;
        k++) { /* those of the first row also before initialization ends, as start values */
      cell = number(cell, &value, &given);
      if (inputs[k].type == 'r' || given) need(put(c, inputs[k], value), "an input");
    }
    if (!started && !from) need(leave(c), "the end of initialization");
    started = 1;
    const fmi2Status status = do_step(c, time, step);
    need(status, "a step");
    print_bits(out, time);
    (void)fprintf(out, ",%d", (int)status);
    for (int k = 0; k < output_count; k++) print(out, c, outputs[k]);
    (void)fputc('\n', out);
  }
  if (started) need(terminate(c), "to terminate");
  free_instance(c);
  if (fclose(out) != 0) stop("cannot write", argument[4]);
  (void)fclose(in);
  return 0;
}
