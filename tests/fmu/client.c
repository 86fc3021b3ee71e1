/* tests/fmu/client.c - a small FMI 2.0 co-simulation importer, for platforms where nothing else runs (qemu-user, wine).
 *
 *   client BINARY GUID INPUT.csv OUTPUT.csv [--set r12=0.5]... [--outputs r50,i60,b61] [--save FILE@ROW] [--restore FILE@ROW]
 *
 *   BINARY      the shared library inside the FMU: binaries/linux64/X.so, binaries/win64/X.dll ...
 *   GUID        as in modelDescription.xml
 *   INPUT.csv   header: time,r3,r4,i6 ...    type (r Real, i Integer, b Boolean) and value reference of what each column sets.
 *               One row per step: set, fmi2DoStep(time, to the time of the next row; the last step is as long as the one before).
 *               An empty cell of a Real is NaN, of others: not set.
 *   OUTPUT.csv  header: time,status,r50,i60 ...    then per row its time, the fmi2Status of its step, the values after it
 *   --set       a parameter, before initialization
 *   --outputs   which variables to write; without it all there are: value references are tried from 0 on until there is none
 *   --save      the serialized state as it is before row ROW (0: the first) is set
 *   --restore   go on with row ROW from a saved state; rows before it are not done
 *
 * Reals are read as decimal numbers or as x and the 16 hexadecimal digits of their bits (x3ff0000000000000 is 1), and written in
 * the latter form, so that outputs of all platforms compare byte by byte whatever their printf() does. What the FMU logs goes to
 * stderr. Exit: 0 done, 1 something was refused, 2 usage. */
#if !defined(_WIN32)
#define _POSIX_C_SOURCE 200112L
#endif
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fmi2FunctionTypes.h"

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

#define FUNCTIONS(X)                                                                                                              \
  X(Instantiate) X(FreeInstance) X(SetupExperiment) X(EnterInitializationMode) X(ExitInitializationMode) X(Terminate) X(GetReal)  \
  X(GetInteger) X(GetBoolean) X(SetReal) X(SetInteger) X(SetBoolean) X(DoStep) X(GetFMUstate) X(SetFMUstate) X(FreeFMUstate)      \
  X(SerializedFMUstateSize) X(SerializeFMUstate) X(DeSerializeFMUstate)
#define X(name) static fmi2##name##TYPE *name;
FUNCTIONS(X)
#undef X

static void stop(const char *what, const char *which)
{
  (void)fprintf(stderr, "client: %s%s%s\n", what, which ? ": " : "", which ? which : "");
  exit(1);
}

static void load(const char *path)
{
  library const l = open_library(path);
  void *p;
  if (!l) stop(path, why());
#define X(name)                                   \
  p = symbol(l, "fmi2" #name);                    \
  if (!p) stop("the binary lacks", "fmi2" #name); \
  memcpy(&name, &p, sizeof p);
  FUNCTIONS(X)
#undef X
}

static int quiet; /* while value references are tried */

static void logger(fmi2ComponentEnvironment environment, fmi2String name, fmi2Status status, fmi2String category, fmi2String text,
                   ...)
{
  (void)environment;
  if (!quiet) (void)fprintf(stderr, "%s %d %s: %s\n", name, (int)status, category, text);
}

static void need(fmi2Status status, const char *call)
{
  if (status > fmi2Warning) stop("refused", call);
}

/* ---- columns */

enum { MOST = 1024 };
typedef struct column { char type; fmi2ValueReference vr; } column;
static column inputs[MOST], outputs[MOST];
static int input_count, output_count;

static column column_of(const char *text)
{
  column c;
  char *end;
  c.type = text[0];
  c.vr = (fmi2ValueReference)strtoul(text + (text[0] != 0), &end, 10);
  if (!strchr("rib", c.type) || !c.type || end == text + 1 || (*end && !strchr(",=\r\n", *end)))
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

/* A number; *given 0 where the cell is empty.   Returned: where the next cell starts. */
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

static fmi2Status put(fmi2Component c, column v, double value)
{
  const fmi2Integer i = v.type == 'r' ? 0 : (fmi2Integer)value;
  const fmi2Boolean b = v.type != 'r' && i != 0;
  return v.type == 'r' ? SetReal(c, &v.vr, 1, &value) : v.type == 'i' ? SetInteger(c, &v.vr, 1, &i) : SetBoolean(c, &v.vr, 1, &b);
}

static void print_bits(FILE *to, double x)
{
  uint64_t bits;
  memcpy(&bits, &x, sizeof bits);
  (void)fprintf(to, "x%08lx%08lx", (unsigned long)(bits >> 32), (unsigned long)(bits & 0xffffffffu));
}

static void print(FILE *to, fmi2Component c, column v)
{
  fmi2Real r;
  fmi2Integer i;
  fmi2Boolean b;
  (void)fputc(',', to);
  if (v.type == 'r') {
    need(GetReal(c, &v.vr, 1, &r), "fmi2GetReal");
    print_bits(to, r);
  } else if (v.type == 'i') {
    need(GetInteger(c, &v.vr, 1, &i), "fmi2GetInteger");
    (void)fprintf(to, "%d", i);
  } else {
    need(GetBoolean(c, &v.vr, 1, &b), "fmi2GetBoolean");
    (void)fprintf(to, "%d", b);
  }
}

/* What there is, when nobody says it. */
static void try_all(fmi2Component c)
{
  quiet = 1;
  for (fmi2ValueReference vr = 0; output_count < MOST; vr++) {
    fmi2Real r;
    fmi2Integer i;
    fmi2Boolean b;
    const char type = GetReal(c, &vr, 1, &r) == fmi2OK      ? 'r'
                      : GetInteger(c, &vr, 1, &i) == fmi2OK ? 'i'
                      : GetBoolean(c, &vr, 1, &b) == fmi2OK ? 'b'
                                                            : 0;
    if (!type) break;
    outputs[output_count].type = type;
    outputs[output_count++].vr = vr;
  }
  quiet = 0;
}

/* ---- states in files */

static void save(fmi2Component c, const char *path)
{
  fmi2FMUstate state = NULL;
  size_t size = 0;
  need(GetFMUstate(c, &state), "fmi2GetFMUstate");
  need(SerializedFMUstateSize(c, state, &size), "fmi2SerializedFMUstateSize");
  fmi2Byte *const bytes = malloc(size);
  FILE *const file = fopen(path, "wb");
  if (!bytes || !file) stop("cannot write", path);
  need(SerializeFMUstate(c, state, bytes, size), "fmi2SerializeFMUstate");
  if (fwrite(bytes, 1, size, file) != size || fclose(file) != 0) stop("cannot write", path);
  need(FreeFMUstate(c, &state), "fmi2FreeFMUstate");
  free(bytes);
}

static void restore(fmi2Component c, const char *path)
{
  fmi2FMUstate state = NULL;
  FILE *const file = fopen(path, "rb");
  const size_t most = 16u << 20;
  fmi2Byte *const bytes = malloc(most);
  if (!bytes || !file) stop("cannot read", path);
  const size_t size = fread(bytes, 1, most, file);
  (void)fclose(file);
  need(DeSerializeFMUstate(c, bytes, size, &state), "fmi2DeSerializeFMUstate");
  need(SetFMUstate(c, state), "fmi2SetFMUstate");
  need(FreeFMUstate(c, &state), "fmi2FreeFMUstate");
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
  static const fmi2CallbackFunctions callbacks = { logger, NULL, NULL, NULL, NULL };
  const char *from = NULL, *to = NULL;
  int save_row = -1, first = 0, given;
  double time, next, step = 0.01, value;
  if (count < 5) {
    (void)fputs("usage: client BINARY GUID INPUT.csv OUTPUT.csv [--set r12=0.5]... [--outputs r50,i60] [--save FILE@ROW] "
                "[--restore FILE@ROW]\n",
                stderr);
    return 2;
  }
  load(argument[1]);
  FILE *const in = fopen(argument[3], "r");
  if (!in || !fgets(line[0], sizeof line[0], in)) stop("cannot read", argument[3]);
  if (strncmp(line[0], "time", 4) != 0) stop("the first column must be time", argument[3]);
  input_count = line[0][4] == ',' ? columns_of(line[0] + 5, inputs) : 0;

  fmi2Component const c = Instantiate("client", fmi2CoSimulation, argument[2], NULL, &callbacks, fmi2False, fmi2False);
  if (!c) stop("refused", "fmi2Instantiate");
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
  FILE *const out = fopen(argument[4], "wb"); /* b: the same line ends everywhere */
  if (!out) stop("cannot write", argument[4]);
  (void)fputs("time,status", out);
  for (int k = 0; k < output_count; k++) (void)fprintf(out, ",%c%lu", outputs[k].type, (unsigned long)outputs[k].vr);
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
    if (!started && !from) {
      need(SetupExperiment(c, fmi2False, 0.0, time, fmi2False, 0.0), "fmi2SetupExperiment");
      need(EnterInitializationMode(c), "fmi2EnterInitializationMode");
    }
    if (row == save_row && started) save(c, to);
    for (int k = 0; k < input_count; k++) { /* the first row's also before initialization ends, as start values */
      cell = number(cell, &value, &given);
      if (inputs[k].type == 'r' || given) need(put(c, inputs[k], value), "an input");
    }
    if (!started && !from) need(ExitInitializationMode(c), "fmi2ExitInitializationMode");
    started = 1;
    const fmi2Status status = DoStep(c, time, step, fmi2True);
    need(status, "fmi2DoStep");
    print_bits(out, time);
    (void)fprintf(out, ",%d", (int)status);
    for (int k = 0; k < output_count; k++) print(out, c, outputs[k]);
    (void)fputc('\n', out);
  }
  if (started) need(Terminate(c), "fmi2Terminate");
  FreeInstance(c);
  if (fclose(out) != 0) stop("cannot write", argument[4]);
  (void)fclose(in);
  return 0;
}
