/* fmu/glue/fmi2.c - the functions of FMI 2.0 for co-simulation around any model of fmu_model.h.
 *
 * Memory: a fixed pool of instances and of saved states; nothing is allocated. Different instances may be used in
 * different threads at once. A call that is refused (fmi2Error) changes nothing, says why in the log, and leaves the
 * instance as usable as it was. */
#include <stdio.h>
#include <string.h>

#include "fmi2Functions.h"
#include "fmu_guid.h"
#include "fmu_model.h"

#ifndef FMU_INSTANCES
#define FMU_INSTANCES 32   /* at once in one process */
#endif
#ifndef FMU_STATES
#define FMU_STATES 64      /* saved states, of all instances */
#endif
#define STATE_MAGIC 0x32657374u /* "tse2" */
#define STATE_FORMAT 1u

enum { INSTANTIATED = 1, INITIALIZING = 2, STEPPING = 4, TERMINATED = 8 };
#define ANY (INSTANTIATED | INITIALIZING | STEPPING | TERMINATED)

static const char *phase_name(int32_t phase)
{
  switch (phase) {
    case INSTANTIATED: return "before initialization";
    case INITIALIZING: return "in initialization mode";
    case STEPPING: return "while stepping";
    default: return "after fmi2Terminate";
  }
}

typedef struct content { /* what a saved state holds */
  int32_t phase, stale;  /* stale: outputs are older than what was set since, before the first step */
  double start, now;     /* [s] start time; next communication point */
  model m;
} content;

typedef struct instance {
  volatile long taken;
  char name[128];
  fmi2CallbackLogger logger;
  void *environment;
  unsigned wanted;       /* bit k: category k is logged */
  char warned[FMU_TEXT]; /* the last warning: one that lasts is said once */
  content c;
} instance;

typedef struct snapshot {
  volatile long taken;
  const instance *owner;
  content c;
} snapshot;

static instance instances[FMU_INSTANCES];
static snapshot snapshots[FMU_STATES];

/* Take a free place, also when another thread looks for one at the same time. */
#if defined(__GNUC__)
static int take(volatile long *taken) { return __sync_bool_compare_and_swap(taken, 0L, 1L); }
static void give_back(volatile long *taken) { __sync_lock_release(taken); }
#elif defined(_MSC_VER)
#include <intrin.h>
static int take(volatile long *taken) { return _InterlockedCompareExchange(taken, 1L, 0L) == 0L; }
static void give_back(volatile long *taken) { _InterlockedExchange(taken, 0L); }
#else /* instances are then to be made in one thread at a time */
static int take(volatile long *taken) { return *taken ? 0 : (*taken = 1, 1); }
static void give_back(volatile long *taken) { *taken = 0; }
#endif

/* ------------------------------------------------------------------------------------------- log */

static const char *const categories[] = {
#define X(name, text) name,
  FMU_LOG_CATEGORIES(X)
#undef X
};
enum { LOG_ERROR, LOG_WARNING, LOG_EVENT, LOG_CATEGORIES };

/* The text goes out as it is, without arguments: not every importer formats it, so '%' and '#' must not be in it. */
static void put(fmi2CallbackLogger logger, void *environment, const char *name, fmi2Status status, int category, const char *text)
{
  char clean[FMU_TEXT + 128];
  size_t i;
  if (!logger) return;
  for (i = 0; text[i] && i < sizeof clean - 1; i++) clean[i] = (text[i] == '%' || text[i] == '#') ? '_' : text[i];
  clean[i] = '\0';
  logger(environment, name, status, categories[category], clean);
}

static void say(const instance *s, fmi2Status status, int category, const char *text)
{
  if (s->wanted >> category & 1u) put(s->logger, s->environment, s->name, status, category, text);
}

static fmi2Status refuse(const instance *s, const char *function, const char *text)
{
  char line[FMU_TEXT + 64];
  (void)snprintf(line, sizeof line, "%s: %s", function, text);
  say(s, fmi2Error, LOG_ERROR, line);
  return fmi2Error;
}

/* ------------------------------------------------------------------------------------- arguments */

/* The instance behind a component, NULL when it is none (also one that was freed). */
static instance *instance_of(fmi2Component c)
{
  for (size_t i = 0; i < FMU_INSTANCES; i++)
    if (c == &instances[i] && instances[i].taken) return &instances[i];
  return NULL;
}

static int allowed(const instance *s, int phases, const char *function)
{
  char text[FMU_TEXT];
  if (s->c.phase & phases) return 1;
  (void)snprintf(text, sizeof text, "wrong call order: not allowed %s", phase_name(s->c.phase));
  (void)refuse(s, function, text);
  return 0;
}

static int given(const instance *s, const void *argument, const char *name, const char *function)
{
  char text[FMU_TEXT];
  if (argument) return 1;
  (void)snprintf(text, sizeof text, "the argument %s is NULL", name);
  (void)refuse(s, function, text);
  return 0;
}

static const char *kind_name(char kind)
{
  return kind == 'r' ? "Real" : kind == 'i' ? "Integer" : kind == 'b' ? "Boolean" : "String";
}

/* All value references of a call exist and are of this kind. */
static int known(const instance *s, const fmi2ValueReference vr[], size_t nvr, char kind, const char *function)
{
  char text[FMU_TEXT];
  for (size_t i = 0; i < nvr; i++) {
    if (vr[i] >= (fmi2ValueReference)fmu_variable_count)
      (void)snprintf(text, sizeof text, "unknown value reference %u", vr[i]);
    else if (fmu_variables[vr[i]].kind != kind)
      (void)snprintf(text, sizeof text, "value reference %u, %s, is of type %s, not %s", vr[i], fmu_variables[vr[i]].name,
                     kind_name(fmu_variables[vr[i]].kind), kind_name(kind));
    else
      continue;
    (void)refuse(s, function, text);
    return 0;
  }
  return 1;
}

/* May this variable be set now, to this value? */
static int settable(const instance *s, const fmu_variable *v, double value, const char *function)
{
  char text[FMU_TEXT], range[FMU_RANGE];
  if (v->role == 'o')
    (void)snprintf(text, sizeof text, "%s is an output and cannot be set", v->name);
  else if (v->role == 'p' && !(s->c.phase & (INSTANTIATED | INITIALIZING)))
    (void)snprintf(text, sizeof text, "%s is a fixed parameter and cannot be set %s", v->name, phase_name(s->c.phase));
  else if (v->role == 'p' && v->hi >= v->lo && !(value >= v->lo && value <= v->hi))
    (void)snprintf(text, sizeof text, "%s = %.10g is outside its range %s", v->name, value, fmu_range(v, range));
  else
    return 1;
  (void)refuse(s, function, text);
  return 0;
}

static void *place(content *c, int32_t offset) { return (unsigned char *)&c->m + offset; }

/* Real variables of FMI are double; a model keeps parameters as tse_setting, all others as tse_real, of which fixed point has less. */
static double get_number(content *c, const fmu_variable *v)
{
  if (v->kind != 'r') return (double)*(int32_t *)place(c, v->offset);
  return v->role == 'p' ? tse_double_of_setting(*(tse_setting *)place(c, v->offset)) : tse_double_of(*(tse_real *)place(c, v->offset));
}

static void set_real(content *c, int32_t offset, double value) { *(tse_real *)place(c, offset) = tse_real_of(value); }

static void set_number(content *c, const fmu_variable *v, double value)
{
  if (v->kind != 'r') *(int32_t *)place(c, v->offset) = (int32_t)value;
  else if (v->role == 'p') *(tse_setting *)place(c, v->offset) = tse_setting_of(value);
  else set_real(c, v->offset, value);
}

/* -------------------------------------------------------------------------------------- life cycle */

static void restart(content *c)
{
  memset(c, 0, sizeof *c);
  c->phase = INSTANTIATED;
  c->stale = 1;
  model_init(&c->m);
  for (int32_t i = 0; i < fmu_variable_count; i++)
    if (fmu_variables[i].role != 'o') set_number(c, &fmu_variables[i], fmu_variables[i].start);
}

/* Compute the outputs anew, if something was set before the first step. */
static int refresh(instance *s, const char *function)
{
  char text[FMU_TEXT] = "";
  if (!s->c.stale) return 1;
  if (model_start(&s->c.m, s->c.start, text) == FMU_ERROR) {
    (void)refuse(s, function, text);
    return 0;
  }
  s->c.stale = 0;
  return 1;
}

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
const char *fmi2GetVersion(void) { return fmi2Version; }

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                              const fmi2CallbackFunctions *callbacks, fmi2Boolean visible, fmi2Boolean logging)
{
  const char *wrong = NULL;
  char text[FMU_TEXT];
  (void)resources;
  (void)visible;
  if (!callbacks) return NULL;
  if (!name || !name[0]) wrong = "the instance name is missing";
  else if (type != fmi2CoSimulation) wrong = "only co-simulation is supported";
  else if (!guid || strcmp(guid, FMU_GUID) != 0) {
    (void)snprintf(text, sizeof text,
                   "the GUID %.64s is not that of this binary, %s: modelDescription.xml belongs to another version",
                   guid ? guid : "NULL", FMU_GUID);
    wrong = text;
  }
  for (size_t i = 0; !wrong && i < FMU_INSTANCES; i++) {
    instance *const s = &instances[i];
    if (!take(&s->taken)) continue;
    (void)snprintf(s->name, sizeof s->name, "%s", name);
    s->logger = callbacks->logger;
    s->environment = callbacks->componentEnvironment;
    s->wanted = 1u << LOG_ERROR | 1u << LOG_WARNING | (logging ? 1u << LOG_EVENT : 0u);
    s->warned[0] = '\0';
    restart(&s->c);
    say(s, fmi2OK, LOG_EVENT, "instantiated");
    return s;
  }
  if (!wrong) {
    (void)snprintf(text, sizeof text, "all %d instances are in use: free one, or build the FMU with a larger FMU_INSTANCES",
                   FMU_INSTANCES);
    wrong = text;
  }
  put(callbacks->logger, callbacks->componentEnvironment, name ? name : "", fmi2Error, LOG_ERROR, wrong);
  return NULL;
}

void fmi2FreeInstance(fmi2Component c)
{
  instance *const s = instance_of(c);
  if (!s) return;
  for (size_t i = 0; i < FMU_STATES; i++)
    if (snapshots[i].taken && snapshots[i].owner == s) give_back(&snapshots[i].taken);
  give_back(&s->taken);
}

fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t count, const fmi2String names[])
{
  instance *const s = instance_of(c);
  unsigned mask = 0;
  if (!s || (count > 0 && !given(s, names, "categories", "fmi2SetDebugLogging"))) return fmi2Error;
  for (size_t i = 0; i < count; i++) {
    unsigned k = 0;
    while (k < LOG_CATEGORIES && (!names[i] || strcmp(names[i], categories[k]) != 0)) k++;
    if (k == LOG_CATEGORIES) return refuse(s, "fmi2SetDebugLogging", "unknown log category");
    mask |= 1u << k;
  }
  if (count == 0) mask = on ? (1u << LOG_CATEGORIES) - 1u : 1u << LOG_EVENT;
  s->wanted = on ? s->wanted | mask : s->wanted & ~mask;
  return fmi2OK;
}

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean has_tolerance, fmi2Real tolerance, fmi2Real start,
                               fmi2Boolean has_stop, fmi2Real stop)
{
  instance *const s = instance_of(c);
  (void)has_tolerance;
  (void)tolerance;
  if (!s || !allowed(s, INSTANTIATED, "fmi2SetupExperiment")) return fmi2Error;
  if (!(start - start == 0.0)) return refuse(s, "fmi2SetupExperiment", "startTime is not a finite number");
  if (has_stop && !(stop >= start)) return refuse(s, "fmi2SetupExperiment", "stopTime is before startTime");
  s->c.start = start;
  return fmi2OK;
}

fmi2Status fmi2EnterInitializationMode(fmi2Component c)
{
  instance *const s = instance_of(c);
  if (!s || !allowed(s, INSTANTIATED, "fmi2EnterInitializationMode")) return fmi2Error;
  s->c.phase = INITIALIZING;
  return fmi2OK;
}

fmi2Status fmi2ExitInitializationMode(fmi2Component c)
{
  instance *const s = instance_of(c);
  if (!s || !allowed(s, INITIALIZING, "fmi2ExitInitializationMode") || !refresh(s, "fmi2ExitInitializationMode"))
    return fmi2Error;
  s->c.phase = STEPPING;
  s->c.now = s->c.start;
  say(s, fmi2OK, LOG_EVENT, "initialized");
  return fmi2OK;
}

fmi2Status fmi2Terminate(fmi2Component c)
{
  instance *const s = instance_of(c);
  if (!s || !allowed(s, STEPPING, "fmi2Terminate")) return fmi2Error;
  s->c.phase = TERMINATED;
  say(s, fmi2OK, LOG_EVENT, "terminated");
  return fmi2OK;
}

fmi2Status fmi2Reset(fmi2Component c)
{
  instance *const s = instance_of(c);
  if (!s) return fmi2Error;
  restart(&s->c);
  s->warned[0] = '\0';
  return fmi2OK;
}

/* ------------------------------------------------------------------------------------------ values */

/* Checks of all values come first: a call that is refused sets none. */
#define GET(Type, kind)                                                                                                  \
  fmi2Status fmi2Get##Type(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2##Type value[])               \
  {                                                                                                                      \
    static const char function[] = "fmi2Get" #Type;                                                                     \
    instance *const s = instance_of(c);                                                                                 \
    if (!s) return fmi2Error;                                                                                           \
    if (nvr == 0) return fmi2OK;                                                                                        \
    if (!given(s, vr, "vr", function) || !given(s, value, "value", function) || !known(s, vr, nvr, kind, function))      \
      return fmi2Error;                                                                                                 \
    if (s->c.phase == INITIALIZING && !refresh(s, function)) return fmi2Error;                                          \
    for (size_t i = 0; i < nvr; i++) value[i] = (fmi2##Type)get_number(&s->c, &fmu_variables[vr[i]]);                   \
    return fmi2OK;                                                                                                      \
  }
#define SET(Type, kind, number)                                                                                         \
  fmi2Status fmi2Set##Type(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2##Type value[])        \
  {                                                                                                                      \
    static const char function[] = "fmi2Set" #Type;                                                                     \
    instance *const s = instance_of(c);                                                                                 \
    if (!s || !allowed(s, INSTANTIATED | INITIALIZING | STEPPING, function)) return fmi2Error;                          \
    if (nvr == 0) return fmi2OK;                                                                                        \
    if (!given(s, vr, "vr", function) || !given(s, value, "value", function) || !known(s, vr, nvr, kind, function))      \
      return fmi2Error;                                                                                                 \
    for (size_t i = 0; i < nvr; i++)                                                                                    \
      if (!settable(s, &fmu_variables[vr[i]], (double)(number), function)) return fmi2Error;                            \
    for (size_t i = 0; i < nvr; i++) set_number(&s->c, &fmu_variables[vr[i]], (double)(number));                        \
    if (s->c.phase != STEPPING) s->c.stale = 1;                                                                         \
    return fmi2OK;                                                                                                      \
  }
GET(Real, 'r')
GET(Integer, 'i')
GET(Boolean, 'b')
SET(Real, 'r', value[i])
SET(Integer, 'i', value[i])
SET(Boolean, 'b', value[i] != fmi2False)

/* No model has a String. */
fmi2Status fmi2GetString(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2String value[])
{
  const instance *const s = instance_of(c);
  if (!s) return fmi2Error;
  if (nvr == 0) return fmi2OK;
  if (given(s, vr, "vr", "fmi2GetString") && given(s, value, "value", "fmi2GetString"))
    (void)known(s, vr, nvr, 's', "fmi2GetString");
  return fmi2Error;
}

fmi2Status fmi2SetString(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2String value[])
{
  const instance *const s = instance_of(c);
  if (!s) return fmi2Error;
  if (nvr == 0) return fmi2OK;
  if (given(s, vr, "vr", "fmi2SetString") && given(s, value, "value", "fmi2SetString"))
    (void)known(s, vr, nvr, 's', "fmi2SetString");
  return fmi2Error;
}

/* ------------------------------------------------------------------------------------------- steps */

fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2Integer order[],
                                       const fmi2Real value[])
{
  static const char function[] = "fmi2SetRealInputDerivatives";
  char text[FMU_TEXT];
  instance *const s = instance_of(c);
  if (!s || !allowed(s, INITIALIZING | STEPPING, function)) return fmi2Error;
  if (nvr == 0) return fmi2OK;
  if (!given(s, vr, "vr", function) || !given(s, order, "order", function) || !given(s, value, "value", function) ||
      !known(s, vr, nvr, 'r', function))
    return fmi2Error;
  for (size_t i = 0; i < nvr; i++) {
    const fmu_variable *const v = &fmu_variables[vr[i]];
    if (order[i] == 1 && v->rate != FMU_NO_RATE && value[i] - value[i] == 0.0) continue;
    (void)snprintf(text, sizeof text, "%s takes no derivative of order %d and value %.10g", v->name, order[i], value[i]);
    return refuse(s, function, text);
  }
  for (size_t i = 0; i < nvr; i++) set_real(&s->c, fmu_variables[vr[i]].rate, value[i]);
  return fmi2OK;
}

fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2Integer order[],
                                        fmi2Real value[])
{
  const instance *const s = instance_of(c);
  (void)vr;
  (void)order;
  (void)value;
  if (!s) return fmi2Error;
  return nvr == 0 ? fmi2OK
                  : refuse(s, "fmi2GetRealOutputDerivatives", "outputs have no derivatives (maxOutputDerivativeOrder is 0)");
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real time, fmi2Real step, fmi2Boolean no_earlier_state)
{
  static const char function[] = "fmi2DoStep";
  char text[FMU_TEXT] = "", reason[FMU_TEXT] = "";
  instance *const s = instance_of(c);
  (void)no_earlier_state;
  if (!s || !allowed(s, STEPPING, function)) return fmi2Error;
  if (!(step > 0.0) || !(step - step == 0.0)) {
    (void)snprintf(text, sizeof text, "communicationStepSize = %.10g is not a positive number", step);
    return refuse(s, function, text);
  }
  /* Importers sum steps up in different ways: what is off by less than a hundredth of the step, or by
   * what a double of that size can hold, is the same point. */
  const double off = time - s->c.now, size = time < 0.0 ? -time : time;
  const double most = 0.01 * step + 1e-14 * size;
  if (!(off <= most && off >= -most) || !(time - time == 0.0)) { /* infinity is within any share of itself */
    (void)snprintf(text, sizeof text, "currentCommunicationPoint = %.17g, but the last step ended at %.17g", time, s->c.now);
    return refuse(s, function, text);
  }
  const fmu_result result = model_step(&s->c.m, time, step, reason);
  if (result == FMU_ERROR) return refuse(s, function, reason);
  s->c.now = time + step;
  for (int32_t i = 0; i < fmu_variable_count; i++)
    if (fmu_variables[i].rate != FMU_NO_RATE) set_real(&s->c, fmu_variables[i].rate, 0.0); /* it was that of this point */
  if (result == FMU_WARNING && strcmp(reason, s->warned) != 0) {
    (void)snprintf(text, sizeof text, "at %.6g s: %.200s", time, reason);
    say(s, fmi2Warning, LOG_WARNING, text);
  }
  memcpy(s->warned, reason, sizeof s->warned);
  return result == FMU_WARNING ? fmi2Warning : fmi2OK;
}

fmi2Status fmi2CancelStep(fmi2Component c)
{
  const instance *const s = instance_of(c);
  return s ? refuse(s, "fmi2CancelStep", "no step is ever pending") : fmi2Error;
}

/* Steps are done when fmi2DoStep returns, so there is nothing to ask but how far the simulation has got. */
static fmi2Status no_status(fmi2Component c, const char *function)
{
  const instance *const s = instance_of(c);
  if (!s) return fmi2Error;
  say(s, fmi2Discard, LOG_WARNING, function);
  return fmi2Discard;
}

fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Real *value)
{
  const instance *const s = instance_of(c);
  if (!s || !given(s, value, "value", "fmi2GetRealStatus")) return fmi2Error;
  if (kind != fmi2LastSuccessfulTime) return no_status(c, "fmi2GetRealStatus: only fmi2LastSuccessfulTime is kept");
  *value = s->c.phase & (STEPPING | TERMINATED) ? s->c.now : s->c.start;
  return fmi2OK;
}

fmi2Status fmi2GetStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Status *value)
{
  (void)kind;
  (void)value;
  return no_status(c, "fmi2GetStatus: no step is ever pending");
}

fmi2Status fmi2GetIntegerStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Integer *value)
{
  (void)kind;
  (void)value;
  return no_status(c, "fmi2GetIntegerStatus: there is no such status");
}

fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Boolean *value)
{
  const instance *const s = instance_of(c);
  if (!s || !given(s, value, "value", "fmi2GetBooleanStatus")) return fmi2Error;
  if (kind != fmi2Terminated) return no_status(c, "fmi2GetBooleanStatus: only fmi2Terminated is kept");
  *value = fmi2False;
  return fmi2OK;
}

fmi2Status fmi2GetStringStatus(fmi2Component c, const fmi2StatusKind kind, fmi2String *value)
{
  (void)kind;
  (void)value;
  return no_status(c, "fmi2GetStringStatus: no step is ever pending");
}

fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference unknown[], size_t unknowns,
                                        const fmi2ValueReference known_[], size_t knowns, const fmi2Real dknown[],
                                        fmi2Real dunknown[])
{
  const instance *const s = instance_of(c);
  (void)unknown;
  (void)unknowns;
  (void)known_;
  (void)knowns;
  (void)dknown;
  (void)dunknown;
  return s ? refuse(s, "fmi2GetDirectionalDerivative", "not provided (providesDirectionalDerivative is false)") : fmi2Error;
}

/* ------------------------------------------------------------------------------------------- state */

static snapshot *snapshot_of(fmi2FMUstate state)
{
  for (size_t i = 0; i < FMU_STATES; i++)
    if (state == &snapshots[i] && snapshots[i].taken) return &snapshots[i];
  return NULL;
}

static snapshot *free_snapshot(const instance *s, const char *function)
{
  char text[FMU_TEXT];
  for (size_t i = 0; i < FMU_STATES; i++)
    if (take(&snapshots[i].taken)) {
      snapshots[i].owner = s;
      return &snapshots[i];
    }
  (void)snprintf(text, sizeof text, "all %d saved states are in use: free one, or build the FMU with a larger FMU_STATES",
                 FMU_STATES);
  (void)refuse(s, function, text);
  return NULL;
}

static int is_state(const instance *s, fmi2FMUstate state, const char *function)
{
  if (snapshot_of(state)) return 1;
  (void)refuse(s, function, "not a state that this FMU has saved");
  return 0;
}

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state)
{
  static const char function[] = "fmi2GetFMUstate";
  const instance *const s = instance_of(c);
  if (!s || !given(s, state, "FMUstate", function)) return fmi2Error;
  if (*state && !is_state(s, *state, function)) return fmi2Error;
  snapshot *const t = *state ? snapshot_of(*state) : free_snapshot(s, function);
  if (!t) return fmi2Error;
  memcpy(&t->c, &s->c, sizeof t->c);
  *state = t;
  return fmi2OK;
}

fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state)
{
  static const char function[] = "fmi2SetFMUstate";
  instance *const s = instance_of(c);
  if (!s || !given(s, state, "FMUstate", function) || !is_state(s, state, function)) return fmi2Error;
  memcpy(&s->c, &snapshot_of(state)->c, sizeof s->c);
  return fmi2OK;
}

fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state)
{
  static const char function[] = "fmi2FreeFMUstate";
  const instance *const s = instance_of(c);
  if (!s) return fmi2Error;
  if (!state || !*state) return fmi2OK;
  if (!is_state(s, *state, function)) return fmi2Error;
  give_back(&snapshot_of(*state)->taken);
  *state = NULL;
  return fmi2OK;
}

/* A serialized state: this frame, then the content. Machines with the same layout of `content` and the same byte order
 * understand each other's. */
typedef struct frame {
  uint32_t magic, format; /* the magic number also tells the byte order */
  uint64_t bytes;         /* of the content                             */
  uint64_t model;         /* hash of the GUID and of all sources        */
  uint64_t sum;           /* hash of the content                        */
} frame;
#define STATE_BYTES (sizeof(frame) + sizeof(content))
#define MADE_OF FMU_GUID FMU_SOURCES

/* FNV-1a: a change of any one byte changes it. */
static uint64_t hash(const void *bytes, size_t count)
{
  const unsigned char *const b = (const unsigned char *)bytes;
  uint64_t h = 14695981039346656037u;
  for (size_t i = 0; i < count; i++) h = (h ^ b[i]) * 1099511628211u;
  return h;
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate state, size_t *size)
{
  static const char function[] = "fmi2SerializedFMUstateSize";
  const instance *const s = instance_of(c);
  if (!s || !given(s, size, "size", function) || !given(s, state, "FMUstate", function) || !is_state(s, state, function))
    return fmi2Error;
  *size = STATE_BYTES;
  return fmi2OK;
}

fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[], size_t size)
{
  static const char function[] = "fmi2SerializeFMUstate";
  const instance *const s = instance_of(c);
  frame f;
  if (!s || !given(s, bytes, "serializedState", function) || !given(s, state, "FMUstate", function) ||
      !is_state(s, state, function))
    return fmi2Error;
  if (size < STATE_BYTES) return refuse(s, function, "the buffer is smaller than fmi2SerializedFMUstateSize says");
  memset(&f, 0, sizeof f);
  f.magic = STATE_MAGIC;
  f.format = STATE_FORMAT;
  f.bytes = sizeof(content);
  f.model = hash(MADE_OF, sizeof MADE_OF);
  f.sum = hash(&snapshot_of(state)->c, sizeof(content));
  memcpy(bytes, &f, sizeof f);
  memcpy(bytes + sizeof f, &snapshot_of(state)->c, sizeof(content));
  return fmi2OK;
}

/* The edge of a parameter's range as a model that keeps less than double has it. */
static double kept(const fmu_variable *v, double edge)
{
  return v->kind == 'r' ? tse_double_of_setting(tse_setting_of(edge)) : edge;
}

/* Whoever made the bytes, and their checksum: is this a state that this FMU could have been in? Outputs are not looked at, nothing
 * depends on them.   Returned: wrong  the variable outside its range, if it is one */
static int sound(content *c, const fmu_variable **wrong)
{
  const int ready = (c->phase & (STEPPING | TERMINATED)) != 0;
  if (c->phase != INSTANTIATED && c->phase != INITIALIZING && !ready) return 0;
  if ((c->stale != 0 && c->stale != 1) || (ready && c->stale) || (c->phase == INSTANTIATED && !c->stale)) return 0;
  if (!(c->start - c->start == 0.0) || !(c->now - c->now == 0.0)) return 0;
  for (int32_t i = 0; i < fmu_variable_count; i++) {
    const fmu_variable *const v = &fmu_variables[i];
    const double value = get_number(c, v);
    if (v->kind == 'b' && !(value == 0.0 || value == 1.0)) return 0;
    if (v->role == 'p' && v->hi >= v->lo && !(value >= kept(v, v->lo) && value <= kept(v, v->hi))) {
      *wrong = v;
      return 0;
    }
  }
  return model_sound(&c->m, !c->stale);
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state)
{
  static const char function[] = "fmi2DeSerializeFMUstate";
  const instance *const s = instance_of(c);
  frame f;
  if (!s || !given(s, bytes, "serializedState", function) || !given(s, state, "FMUstate", function)) return fmi2Error;
  if (size < sizeof f) return refuse(s, function, "too short to be a saved state");
  memcpy(&f, bytes, sizeof f);
  if (f.magic != STATE_MAGIC) return refuse(s, function, "not a state of this FMU, or of a machine with another byte order");
  if (f.format != STATE_FORMAT || f.model != hash(MADE_OF, sizeof MADE_OF))
    return refuse(s, function, "the state of another FMU, or of another version of this one");
  if (f.bytes != sizeof(content) || size < STATE_BYTES)
    return refuse(s, function, "the state has another size than this build's");
  if (f.sum != hash(bytes + sizeof f, sizeof(content))) return refuse(s, function, "the state is damaged: its checksum differs");
  snapshot *const t = free_snapshot(s, function);
  if (!t) return fmi2Error;
  memcpy(&t->c, bytes + sizeof f, sizeof(content));
  const fmu_variable *wrong = NULL;
  if (!sound(&t->c, &wrong)) {
    char text[FMU_TEXT] = "the state is not one that this FMU can be in: something in it is outside its range", range[FMU_RANGE];
    if (wrong)
      (void)snprintf(text, sizeof text, "the state is not one that this FMU can be in: %s = %.10g is outside its range %s", wrong->name,
                     get_number(&t->c, wrong), fmu_range(wrong, range));
    give_back(&t->taken);
    return refuse(s, function, text);
  }
  *state = t;
  return fmi2OK;
}
