/* fmu/glue/glue.c - code shared by FMI 2.0 and 3.0, declared in glue.h. It works with
 * every model that implements fmu_model.h. */
#include <stdio.h>
#include <string.h>

#include "fmu_guid.h"
#include "glue.h"

#define STATE_MAGIC 0x32657374u /* first four bytes of a serialized state: "tse2" */
#define STATE_FORMAT 1u         /* version of the format of a serialized state */

#define PHASE 40 /* [bytes] max size of the text of a phase */

/* Return the phase of an instance in words, for the message that a call is not allowed.
 * `text` is a buffer for these words. */
static const char *describe_phase(const instance *s, char text[PHASE])
{
  switch (s->c.phase) {
    case GLUE_INSTANTIATED: return "before initialization";
    case GLUE_INITIALIZING: return "in initialization mode";
    case GLUE_STEPPING: return "while stepping";
    default: (void)snprintf(text, PHASE, "after %s", s->api->terminate); return text;
  }
}

/* Memory for one saved state of an instance. The FMU has FMU_STATES of these. */
typedef struct snapshot {
  volatile long taken;   /* 1: in use; 0: free */
  const instance *owner; /* instance whose state it is */
  glue_content c;
} snapshot;

static instance instances[FMU_INSTANCES];
static snapshot snapshots[FMU_STATES];

/* Functions that allocate and free the elements of the arrays `instances` and
 * `snapshots`. `taken` is the member of this name in the element.
 * take_place(): if the element is free, mark it as in use and return 1; otherwise return
 * 0. free_place(): mark the element as free. Both functions are atomic, because several
 * threads may search for a free element at the same time. */
#if defined(__GNUC__)
static int take_place(volatile long *taken) { return __sync_bool_compare_and_swap(taken, 0L, 1L); }
static void free_place(volatile long *taken) { __sync_lock_release(taken); }
#elif defined(_MSC_VER)
#include <intrin.h>
static int take_place(volatile long *taken) { return _InterlockedCompareExchange(taken, 1L, 0L) == 0L; }
static void free_place(volatile long *taken) { _InterlockedExchange(taken, 0L); }
#else /* no atomic operations: only one thread at a time may create instances and saved states */
static int take_place(volatile long *taken) { return *taken ? 0 : (*taken = 1, 1); }
static void free_place(volatile long *taken) { *taken = 0; }
#endif

/* ------------------------------------------------------------------------------------------- log */

static const char *const categories[] = {
#define X(name, text) name,
  FMU_LOG_CATEGORIES(X)
#undef X
};

/* Pass a text to the importer's log function. Replace the characters '%' and '#' in it by
 * '_': in a log text of FMI, '%' begins a format specification and '#' a reference to a
 * variable. Importers differ in how they treat both, so the text must not contain them. */
static void emit_line(const glue_api *api, glue_function *logger, void *environment, const char *name,
    glue_status status, int category, const char *text)
{
  char clean[FMU_TEXT + 128];
  size_t i;
  if (!logger) return;
  for (i = 0; text[i] && i < sizeof clean - 1; i++)
    clean[i] = (text[i] == '%' || text[i] == '#') ? '_' : text[i];
  clean[i] = '\0';
  api->emit(logger, environment, name, status, categories[category], clean);
}

void glue_log(const instance *s, glue_status status, int category, const char *text)
{
  if (s->wanted >> category & 1u)
    emit_line(s->api, s->logger, s->environment, s->name, status, category, text);
}

glue_status glue_refuse(const instance *s, const char *function, const char *text)
{
  char line[FMU_TEXT + 64];
  (void)snprintf(line, sizeof line, "%s: %s", function, text);
  glue_log(s, GLUE_ERROR, GLUE_LOG_ERROR, line);
  return GLUE_ERROR;
}

glue_status glue_set_logging(
    instance *s, const char *function, int on, size_t count, const char *const names[])
{
  unsigned mask = 0;
  if (count > 0 && !glue_check_pointer(s, names, "categories", function)) return GLUE_ERROR;
  for (size_t i = 0; i < count; i++) {
    unsigned k = 0;
    while (k < GLUE_LOG_CATEGORIES && (!names[i] || strcmp(names[i], categories[k]) != 0)) k++;
    if (k == GLUE_LOG_CATEGORIES) return glue_refuse(s, function, "unknown log category");
    mask |= 1u << k;
  }
  if (count == 0) mask = on ? (1u << GLUE_LOG_CATEGORIES) - 1u : 1u << GLUE_LOG_EVENT;
  s->wanted = on ? s->wanted | mask : s->wanted & ~mask;
  return GLUE_OK;
}

/* ------------------------------------------------------------------------------------- arguments */

instance *glue_find_instance(const void *c)
{
  for (size_t i = 0; i < FMU_INSTANCES; i++)
    if (c == &instances[i] && instances[i].taken) return &instances[i];
  return NULL;
}

int glue_check_phase(const instance *s, int phases, const char *function)
{
  char text[FMU_TEXT], phase[PHASE];
  if (s->c.phase & phases) return 1;
  (void)snprintf(text, sizeof text, "wrong call order: not allowed %s", describe_phase(s, phase));
  (void)glue_refuse(s, function, text);
  return 0;
}

int glue_check_pointer(const instance *s, const void *argument, const char *name, const char *function)
{
  char text[FMU_TEXT];
  if (argument) return 1;
  (void)snprintf(text, sizeof text, "the argument %s is NULL", name);
  (void)glue_refuse(s, function, text);
  return 0;
}

const fmu_variable *glue_find_variable(const instance *s, uint32_t vr)
{
  const uint32_t scalars = (uint32_t)fmu_variable_count, arrays = (uint32_t)fmu_array_count;
  if (vr < scalars) return &fmu_variables[vr];
  if (!s->api->extended || vr > scalars + arrays) return NULL;
  return vr < scalars + arrays ? &fmu_arrays[vr - scalars].of : &fmu_time;
}

int32_t glue_count_elements(const instance *s, uint32_t vr)
{
  const uint32_t scalars = (uint32_t)fmu_variable_count, arrays = (uint32_t)fmu_array_count;
  return s->api->extended && vr >= scalars && vr < scalars + arrays ? fmu_arrays[vr - scalars].count : 1;
}

/* Check the number of values in a call of a get or set function. Return 1 if `values` is
 * equal to `wanted`. Otherwise log an error and return 0.
 *   Given:  values  number of values that the importer passes
 *           wanted  number of values of all variables in the call: 1 for a scalar, more
 *                   for an array */
static int check_count(const instance *s, size_t values, size_t wanted, const char *function)
{
  char text[FMU_TEXT];
  if (values == wanted) return 1;
  (void)snprintf(text, sizeof text, "nValues is %lu, and the variables have %lu values",
      (unsigned long)values, (unsigned long)wanted);
  (void)glue_refuse(s, function, text);
  return 0;
}

/* Return the name that FMI has for the type of variables of this kind, for messages. */
static const char *get_type_name(const instance *s, char kind)
{
  switch (kind) {
    case 'r': return s->api->real;
    case 'i': return s->api->integer;
    case 'e': return "Enumeration";
    default: return s->api->boolean;
  }
}

/* Return 1 if the get and set functions for variables of this kind may access v: if v is
 * of the same kind. In FMI 2.0, the functions for Integer may access enumerations, too,
 * because FMI 2.0 has no get and set functions for enumerations. */
static int is_of_kind(const instance *s, const fmu_variable *v, char kind)
{
  return v->kind == kind || (!s->api->extended && v->kind == 'e' && kind == 'i');
}

int glue_check_variables(const instance *s, const uint32_t vr[], size_t nvr, const void *value, size_t count,
    char kind, const char *type, const char *function)
{
  char text[FMU_TEXT];
  size_t wanted = 0;
  if (!glue_check_pointer(s, vr, s->api->references, function)
      || !glue_check_pointer(s, value, s->api->values, function))
    return 0;
  for (size_t i = 0; i < nvr; i++) {
    const fmu_variable *const v = glue_find_variable(s, vr[i]);
    if (!v) (void)snprintf(text, sizeof text, "unknown value reference %lu", (unsigned long)vr[i]);
    else if (!is_of_kind(s, v, kind))
      (void)snprintf(text, sizeof text, "value reference %lu, %s, is of type %s, not %s",
          (unsigned long)vr[i], v->name, get_type_name(s, v->kind), type);
    else {
      wanted += (size_t)glue_count_elements(s, vr[i]);
      continue;
    }
    (void)glue_refuse(s, function, text);
    return 0;
  }
  return check_count(s, count, wanted, function);
}

glue_status glue_check_empty(const instance *s, size_t count, const char *function)
{
  return check_count(s, count, 0, function) ? GLUE_OK : GLUE_ERROR;
}

/* -------------------------------------------------------------------------------------- values */

/* Return the address of a variable in the model. */
static void *find_variable_memory(glue_content *c, int32_t offset) { return (unsigned char *)&c->m + offset; }

/* Return the value of one element of a variable; a scalar has only element 0. The result
 * is a double, as the real variables of FMI are. In the model, a real parameter is a
 * tse_setting and every other real variable is a tse_real. */
static double get_number(glue_content *c, const fmu_variable *v, int32_t element)
{
  if (v->role == 't') return c->phase & (GLUE_STEPPING | GLUE_TERMINATED) ? c->now : c->start;
  if (v->kind != 'r') return (double)((int32_t *)find_variable_memory(c, v->offset))[element];
  return v->role == 'p' ? tse_double_of_setting(((tse_setting *)find_variable_memory(c, v->offset))[element])
                        : tse_double_of(((tse_real *)find_variable_memory(c, v->offset))[element]);
}

static void set_real(glue_content *c, int32_t offset, double value)
{
  *(tse_real *)find_variable_memory(c, offset) = tse_real_of(value);
}

static void set_number(glue_content *c, const fmu_variable *v, double value)
{
  if (v->kind != 'r') *(int32_t *)find_variable_memory(c, v->offset) = (int32_t)value;
  else if (v->role == 'p') *(tse_setting *)find_variable_memory(c, v->offset) = tse_setting_of(value);
  else set_real(c, v->offset, value);
}

double glue_get(instance *s, const fmu_variable *v, int32_t element) { return get_number(&s->c, v, element); }
double glue_get_time(const instance *s)
{
  return s->c.phase & (GLUE_STEPPING | GLUE_TERMINATED) ? s->c.now : s->c.start;
}

void glue_set(instance *s, const fmu_variable *v, double value)
{
  set_number(&s->c, v, value);
  if (v->role == 'p') model_note_set(&s->c.m, v, value);
}

void glue_set_rate(instance *s, const fmu_variable *v, double rate) { set_real(&s->c, v->rate, rate); }

void glue_mark_stale(instance *s)
{
  if (s->c.phase != GLUE_STEPPING) s->c.stale = 1;
}

int glue_check_value(const instance *s, const fmu_variable *v, double value, const char *function)
{
  char text[FMU_TEXT], range[FMU_RANGE], phase[PHASE];
  if (v->role == 't') (void)snprintf(text, sizeof text, "%s cannot be set: it is set by the steps", v->name);
  else if (v->role == 'o') (void)snprintf(text, sizeof text, "%s is an output and cannot be set", v->name);
  else if (v->role == 'p' && !(s->c.phase & (GLUE_INSTANTIATED | GLUE_INITIALIZING)))
    (void)snprintf(
        text, sizeof text, "%s is a fixed parameter and cannot be set %s", v->name, describe_phase(s, phase));
  else if (v->role == 'p' && v->hi >= v->lo && !(value >= v->lo && value <= v->hi) && value != v->start)
    (void)snprintf(
        text, sizeof text, "%s = %.10g is outside its range %s", v->name, value, fmu_write_range(v, range));
  else return 1;
  (void)glue_refuse(s, function, text);
  return 0;
}

/* -------------------------------------------------------------------------------------- life cycle */

/* Set the content to that of a new instance. */
static void reset_content(glue_content *c)
{
  memset(c, 0, sizeof *c);
  c->phase = GLUE_INSTANTIATED;
  c->stale = 1;
  model_init(&c->m);
  for (int32_t i = 0; i < fmu_variable_count; i++)
    if (fmu_variables[i].role != 'o') set_number(c, &fmu_variables[i], fmu_variables[i].start);
}

/* If `stale` is 1, because a parameter or input was set, compute the outputs again.
 * Return 0 if the model refuses a parameter or input, otherwise 1. */
static int update_outputs(instance *s, const char *function)
{
  char text[FMU_TEXT] = "";
  if (!s->c.stale) return 1;
  if (model_start(&s->c.m, s->c.start, text) == FMU_ERROR) {
    (void)glue_refuse(s, function, text);
    return 0;
  }
  s->c.stale = 0;
  return 1;
}

int glue_update_outputs(instance *s, const char *function)
{
  return s->c.phase != GLUE_INITIALIZING || update_outputs(s, function);
}

instance *glue_instantiate(const glue_api *api, const char *name, const char *token, const char *unsupported,
    glue_function *logger, void *environment, int logging)
{
  const char *wrong = NULL;
  char text[FMU_TEXT];
  if (!name || !name[0]) wrong = "the instance name is missing";
  else if (unsupported) wrong = unsupported;
  else if (!token || strcmp(token, FMU_GUID) != 0) {
    (void)snprintf(text, sizeof text,
        "the %s %.64s is not that of this binary, %s: modelDescription.xml is of a different version",
        api->token, token ? token : "NULL", FMU_GUID);
    wrong = text;
  }
  for (size_t i = 0; !wrong && i < FMU_INSTANCES; i++) {
    instance *const s = &instances[i];
    if (!take_place(&s->taken)) continue;
    (void)snprintf(s->name, sizeof s->name, "%s", name);
    s->api = api;
    s->logger = logger;
    s->environment = environment;
    s->wanted = 1u << GLUE_LOG_ERROR | 1u << GLUE_LOG_WARNING | (logging ? 1u << GLUE_LOG_EVENT : 0u);
    s->warned[0] = '\0';
    reset_content(&s->c);
    glue_log(s, GLUE_OK, GLUE_LOG_EVENT, "instantiated");
    return s;
  }
  if (!wrong) {
    (void)snprintf(text, sizeof text,
        "all %d instances are in use: free one, or build the FMU with a larger FMU_INSTANCES", FMU_INSTANCES);
    wrong = text;
  }
  emit_line(api, logger, environment, name ? name : "", GLUE_ERROR, GLUE_LOG_ERROR, wrong);
  return NULL;
}

void glue_free(const void *c)
{
  instance *const s = glue_find_instance(c);
  if (!s) return;
  for (size_t i = 0; i < FMU_STATES; i++)
    if (snapshots[i].taken && snapshots[i].owner == s) free_place(&snapshots[i].taken);
  free_place(&s->taken);
}

glue_status glue_set_times(instance *s, const char *function, double start, int has_stop, double stop)
{
  if (!glue_check_phase(s, GLUE_INSTANTIATED, function)) return GLUE_ERROR;
  if (!(start - start == 0.0)) return glue_refuse(s, function, "startTime is not a finite number");
  if (has_stop && !(stop >= start)) return glue_refuse(s, function, "stopTime is before startTime");
  s->c.start = start;
  return GLUE_OK;
}

glue_status glue_enter_initialization(instance *s, const char *function)
{
  if (!glue_check_phase(s, GLUE_INSTANTIATED, function)) return GLUE_ERROR;
  s->c.phase = GLUE_INITIALIZING;
  return GLUE_OK;
}

glue_status glue_exit_initialization(instance *s, const char *function)
{
  if (!glue_check_phase(s, GLUE_INITIALIZING, function) || !update_outputs(s, function)) return GLUE_ERROR;
  s->c.phase = GLUE_STEPPING;
  s->c.now = s->c.start;
  glue_log(s, GLUE_OK, GLUE_LOG_EVENT, "initialized");
  return GLUE_OK;
}

glue_status glue_terminate(instance *s, const char *function)
{
  if (!glue_check_phase(s, GLUE_STEPPING, function)) return GLUE_ERROR;
  s->c.phase = GLUE_TERMINATED;
  glue_log(s, GLUE_OK, GLUE_LOG_EVENT, "terminated");
  return GLUE_OK;
}

glue_status glue_reset(instance *s)
{
  reset_content(&s->c);
  s->warned[0] = '\0';
  return GLUE_OK;
}

/* ------------------------------------------------------------------------------------------- steps */

glue_status glue_step(instance *s, const char *function, double time, double step)
{
  char text[FMU_TEXT] = "", reason[FMU_TEXT] = "";
  if (!glue_check_phase(s, GLUE_STEPPING, function)) return GLUE_ERROR;
  if (!(step > 0.0) || !(step - step == 0.0)) {
    (void)snprintf(text, sizeof text, "communicationStepSize = %.10g is not a positive number", step);
    return glue_refuse(s, function, text);
  }
  /* Compare the time that the importer passes with the end of the last step. They may
   * differ a little, because importers compute the time of a step in different ways. The
   * tolerance is 1 % of the step plus the rounding error of a sum of many steps in
   * double. */
  const double error = time - s->c.now, size = time < 0.0 ? -time : time;
  const double tolerance = 0.01 * step + 1e-14 * size;
  const int is_finite = time - time == 0.0; /* needed: the tolerance of an infinite time is infinite */
  if (!(error <= tolerance && error >= -tolerance) || !is_finite) {
    (void)snprintf(text, sizeof text, "currentCommunicationPoint = %.17g, but the last step ended at %.17g",
        time, s->c.now);
    return glue_refuse(s, function, text);
  }
  const fmu_result result = model_step(&s->c.m, time, step, reason);
  if (result == FMU_ERROR) return glue_refuse(s, function, reason);
  s->c.now = time + step;
  /* A time derivative of an input is valid for one step. */
  for (int32_t i = 0; i < fmu_variable_count; i++)
    if (fmu_variables[i].rate != FMU_NO_RATE) set_real(&s->c, fmu_variables[i].rate, 0.0);
  if (result == FMU_WARNING && strcmp(reason, s->warned) != 0) {
    (void)snprintf(text, sizeof text, "at %.6g s: %.200s", time, reason);
    glue_log(s, GLUE_WARNING, GLUE_LOG_WARNING, text);
  }
  memcpy(s->warned, reason, sizeof s->warned);
  return result == FMU_WARNING ? GLUE_WARNING : GLUE_OK;
}

/* ------------------------------------------------------------------------------------------- state */

/* Return the saved state to which a pointer points. Return NULL if it points to none. */
static snapshot *find_snapshot(const void *state)
{
  for (size_t i = 0; i < FMU_STATES; i++)
    if (state == &snapshots[i] && snapshots[i].taken) return &snapshots[i];
  return NULL;
}

/* Mark a free element of `snapshots` as in use, and return it. If there is none, log an
 * error and return NULL. */
static snapshot *take_snapshot(const instance *s, const char *function)
{
  char text[FMU_TEXT];
  for (size_t i = 0; i < FMU_STATES; i++)
    if (take_place(&snapshots[i].taken)) {
      snapshots[i].owner = s;
      return &snapshots[i];
    }
  (void)snprintf(text, sizeof text,
      "all %d saved states are in use: free one, or build the FMU with a larger FMU_STATES", FMU_STATES);
  (void)glue_refuse(s, function, text);
  return NULL;
}

/* Return 1 if a pointer points to a saved state. Otherwise log an error and return 0. */
static int check_state(const instance *s, const void *state, const char *function)
{
  if (find_snapshot(state)) return 1;
  (void)glue_refuse(s, function, "not a state that this FMU has saved");
  return 0;
}

glue_status glue_save_state(const instance *s, const char *function, void **state)
{
  if (!glue_check_pointer(s, state, s->api->state, function)) return GLUE_ERROR;
  if (*state && !check_state(s, *state, function)) return GLUE_ERROR;
  snapshot *const t = *state ? find_snapshot(*state) : take_snapshot(s, function);
  if (!t) return GLUE_ERROR;
  memcpy(&t->c, &s->c, sizeof t->c);
  *state = t;
  return GLUE_OK;
}

glue_status glue_restore_state(instance *s, const char *function, const void *state)
{
  if (!glue_check_pointer(s, state, s->api->state, function) || !check_state(s, state, function))
    return GLUE_ERROR;
  memcpy(&s->c, &find_snapshot(state)->c, sizeof s->c);
  return GLUE_OK;
}

glue_status glue_free_state(const instance *s, const char *function, void **state)
{
  if (!state || !*state) return GLUE_OK;
  if (!check_state(s, *state, function)) return GLUE_ERROR;
  free_place(&find_snapshot(*state)->taken);
  *state = NULL;
  return GLUE_OK;
}

/* Header of a serialized state. A glue_content follows it. Machines with the same byte
 * order and the same layout of glue_content can exchange serialized states. */
typedef struct frame {
  uint32_t magic;  /* STATE_MAGIC; a machine with the opposite byte order reads a different number */
  uint32_t format; /* STATE_FORMAT */
  uint64_t bytes;  /* [bytes] size of glue_content */
  uint64_t model;  /* hash of BUILD_IDENTITY */
  uint64_t sum;    /* hash of the glue_content, as its checksum */
} frame;
#define STATE_BYTES (sizeof(frame) + sizeof(glue_content)) /* [bytes] size of a serialized state */
#define BUILD_IDENTITY FMU_GUID FMU_SOURCES                /* GUID, and hash of all sources */

/* Return the FNV-1a hash of bytes. A change of one byte always changes it. */
static uint64_t hash_bytes(const void *bytes, size_t count)
{
  const unsigned char *const b = (const unsigned char *)bytes;
  uint64_t h = 14695981039346656037u;
  for (size_t i = 0; i < count; i++) h = (h ^ b[i]) * 1099511628211u;
  return h;
}

glue_status glue_get_state_size(const instance *s, const char *function, const void *state, size_t *size)
{
  if (!glue_check_pointer(s, size, "size", function) || !glue_check_pointer(s, state, s->api->state, function)
      || !check_state(s, state, function))
    return GLUE_ERROR;
  *size = STATE_BYTES;
  return GLUE_OK;
}

glue_status glue_serialize_state(
    const instance *s, const char *function, const void *state, unsigned char bytes[], size_t size)
{
  frame f;
  if (!glue_check_pointer(s, bytes, "serializedState", function)
      || !glue_check_pointer(s, state, s->api->state, function) || !check_state(s, state, function))
    return GLUE_ERROR;
  if (size < STATE_BYTES)
    return glue_refuse(s, function, "the buffer is smaller than the size of a serialized state");
  memset(&f, 0, sizeof f);
  f.magic = STATE_MAGIC;
  f.format = STATE_FORMAT;
  f.bytes = sizeof(glue_content);
  f.model = hash_bytes(BUILD_IDENTITY, sizeof BUILD_IDENTITY);
  f.sum = hash_bytes(&find_snapshot(state)->c, sizeof(glue_content));
  memcpy(bytes, &f, sizeof f);
  memcpy(bytes + sizeof f, &find_snapshot(state)->c, sizeof(glue_content));
  return GLUE_OK;
}

/* Return a limit of a parameter, rounded to the number format of the settings. The model
 * rounds the parameter in the same way. A parameter that was set to its limit is
 * therefore not outside its range after the rounding. */
static double round_limit(const fmu_variable *v, double limit)
{
  return v->kind == 'r' ? tse_double_of_setting(tse_setting_of(limit)) : limit;
}

/* Return 1 if every value of a deserialized state is in the range that a run can produce,
 * otherwise 0. The checksum of the state does not replace this check, because an attacker
 * can change values and compute the checksum of the changed values. Outputs are not checked,
 * because no later value depends on them.
 *   Returned:  wrong  the parameter that is outside its range; unchanged if the state has
 *                     a different error or none */
static int check_content(glue_content *c, const fmu_variable **wrong)
{
  const int ready = (c->phase & (GLUE_STEPPING | GLUE_TERMINATED)) != 0;
  if (c->phase != GLUE_INSTANTIATED && c->phase != GLUE_INITIALIZING && !ready) return 0;
  if ((c->stale != 0 && c->stale != 1) || (ready && c->stale) || (c->phase == GLUE_INSTANTIATED && !c->stale))
    return 0;
  if (!(c->start - c->start == 0.0) || !(c->now - c->now == 0.0)) return 0;
  for (int32_t i = 0; i < fmu_variable_count; i++) {
    const fmu_variable *const v = &fmu_variables[i];
    const double value = get_number(c, v, 0);
    if (v->kind == 'b' && !(value == 0.0 || value == 1.0)) return 0;
    if (v->role == 'p' && v->hi >= v->lo
        && !(value >= round_limit(v, v->lo) && value <= round_limit(v, v->hi))
        && value != round_limit(v, v->start)) {
      *wrong = v;
      return 0;
    }
  }
  return model_check(&c->m, !c->stale);
}

glue_status glue_deserialize_state(
    const instance *s, const char *function, const unsigned char bytes[], size_t size, void **state)
{
  frame f;
  if (!glue_check_pointer(s, bytes, "serializedState", function)
      || !glue_check_pointer(s, state, s->api->state, function))
    return GLUE_ERROR;
  if (size < sizeof f) return glue_refuse(s, function, "too short to be a saved state");
  memcpy(&f, bytes, sizeof f);
  if (f.magic != STATE_MAGIC)
    return glue_refuse(s, function, "not a state of this FMU, or from a machine with another byte order");
  if (f.format != STATE_FORMAT || f.model != hash_bytes(BUILD_IDENTITY, sizeof BUILD_IDENTITY))
    return glue_refuse(s, function, "the state of another FMU, or of another version of this one");
  if (f.bytes != sizeof(glue_content) || size < STATE_BYTES)
    return glue_refuse(s, function, "the state has another size than a state of this build");
  if (f.sum != hash_bytes(bytes + sizeof f, sizeof(glue_content)))
    return glue_refuse(s, function, "the state is damaged: its checksum differs");
  snapshot *const t = take_snapshot(s, function);
  if (!t) return GLUE_ERROR;
  memcpy(&t->c, bytes + sizeof f, sizeof(glue_content));
  const fmu_variable *wrong = NULL;
  if (!check_content(&t->c, &wrong)) {
    char text[FMU_TEXT] = "the state is impossible: a value in it is outside its range";
    char range[FMU_RANGE];
    if (wrong)
      (void)snprintf(text, sizeof text, "the state is impossible: %s = %.10g is outside its range %s",
          wrong->name, get_number(&t->c, wrong, 0), fmu_write_range(wrong, range));
    free_place(&t->taken);
    return glue_refuse(s, function, text);
  }
  *state = t;
  return GLUE_OK;
}
