/* fmu/glue/glue.h - what all versions of FMI share: instances and their log, values,
 * steps, saved states. fmi2.c and fmi3.c are the functions of one version each, with its
 * types and names; what they do is here.
 *
 * Memory: a fixed pool of instances and of saved states; nothing is allocated. Different
 * instances may be used in different threads at once. A call that is refused (GLUE_ERROR)
 * changes nothing, says why in the log, and leaves the instance as usable as it was. */
#ifndef GLUE_H
#define GLUE_H

#include "fmu_model.h"

/* The standards say which arguments a function has: it need not use all of them. */
#if defined(__GNUC__)
#pragma GCC diagnostic ignored "-Wunused-parameter"
#endif

#ifndef FMU_INSTANCES
#define FMU_INSTANCES 32   /* at once in one process */
#endif
#ifndef FMU_STATES
#define FMU_STATES 64      /* saved states, of all instances */
#endif

/* fmi2Status and fmi3Status have the same numbers. */
typedef enum glue_status {
  GLUE_OK,
  GLUE_WARNING,
  GLUE_DISCARD,
  GLUE_ERROR,
} glue_status;

enum {
  GLUE_INSTANTIATED = 1,
  GLUE_INITIALIZING = 2,
  GLUE_STEPPING = 4,
  GLUE_TERMINATED = 8,
};
enum {
  GLUE_LOG_ERROR,
  GLUE_LOG_WARNING,
  GLUE_LOG_EVENT,
  GLUE_LOG_CATEGORIES,
};

typedef void glue_function(void); /* some logger: its version knows which */

/* What a version of FMI calls things, and what it has. */
typedef struct glue_api {
  const char *terminate, *token,
      *state; /* function that ends a run; identity of a description; argument that is a saved state       */
  const char *references, *values;      /* arguments: value references, values of variables */
  const char *real, *integer, *boolean; /* types */
  int extended; /* also the variables of fmu_arrays, and the time: value references behind
                 * fmu_variable_count */
  void (*emit)(glue_function *logger, void *environment, const char *name, glue_status status,
      const char *category, const char *text);
} glue_api;

typedef struct glue_content { /* what a saved state holds */
  int32_t phase, stale;       /* stale: outputs are older than what was set since, before the first step */
  double start, now;          /* [s] start time; next communication point */
  model m;
} glue_content;

typedef struct instance {
  volatile long taken;
  char name[128];
  const glue_api *api;
  glue_function *logger;
  void *environment;
  unsigned wanted;       /* bit k: category k is logged */
  char warned[FMU_TEXT]; /* the last warning: one that lasts is said once */
  glue_content c;
} instance;

/* ---- log */

void glue_say(const instance *s, glue_status status, int category, const char *text);
/* An error line "function: text".   Returned: GLUE_ERROR */
glue_status glue_refuse(const instance *s, const char *function, const char *text);
glue_status glue_debug_logging(
    instance *s, const char *function, int on, size_t count, const char *const names[]);

/* ---- arguments: 1, or 0 when refused */

/* The instance behind a pointer, NULL when it is none (also one that was freed). */
instance *glue_instance_of(const void *c);
int glue_allowed(const instance *s, int phases, const char *function);
int glue_given(const instance *s, const void *argument, const char *name, const char *function);

/* The variable of a value reference; NULL: there is none. */
const fmu_variable *glue_variable(const instance *s, uint32_t vr);

/* How many values it has. */
int32_t glue_elements(const instance *s, uint32_t vr);

/* The arguments fit together: all value references exist and are of this kind, which its
 * version calls `type`, and there are `count` values for them; kind 0: nothing is. */
int glue_listed(const instance *s, const uint32_t vr[], size_t nvr, const void *value, size_t count,
    char kind, const char *type, const char *function);

/* A call about no variable: nothing to do, if it has no values either. */
glue_status glue_none(const instance *s, size_t count, const char *function);

/* ---- life cycle */

/* Refused (NULL) when there is no free place, no name, another token, or `unsupported`
 * says why.
 *   Given:  logger  may be NULL */
instance *glue_instantiate(const glue_api *api, const char *name, const char *token, const char *unsupported,
    glue_function *logger, void *environment, int logging);
void glue_free(const void *c);
glue_status glue_setup(instance *s, const char *function, double start, int has_stop, double stop);
glue_status glue_enter_initialization(instance *s, const char *function);
glue_status glue_exit_initialization(instance *s, const char *function);
glue_status glue_terminate(instance *s, const char *function);
glue_status glue_reset(instance *s);
/* The end of the last step, the start time before the first [s]. */
double glue_time(const instance *s);

/* Define a function of a version, whose status is fmi_status: what glue.c does, on an
 * instance that is one. */
#define DOES(name, arguments, call)                         \
  fmi_status name arguments                                 \
  {                                                         \
    static const char *const function = #name;              \
    instance *const s = glue_instance_of(c);                \
    (void)function;                                         \
    return s ? (fmi_status)(call) : (fmi_status)GLUE_ERROR; \
  }

/* ---- values; checks of all values come first: a call that is refused sets none */

/* In initialization mode: compute the outputs anew if something was set.   Returned: 0
 * when refused */
int glue_readable(instance *s, const char *function);
/* May this variable be set now, to this value? */
int glue_settable(const instance *s, const fmu_variable *v, double value, const char *function);
double glue_get(instance *s, const fmu_variable *v, int32_t element);
/* Of scalars only: no array can be set. Then glue_was_set(). */
void glue_set(instance *s, const fmu_variable *v, double value);
void glue_set_rate(instance *s, const fmu_variable *v, double rate);
void glue_was_set(instance *s);

/* Define the functions of a version that get and set values of a type, and refuse to
 * where no variable has it.
 *   from_number, to_number  what becomes of `number`, a double, and what of value[i];
 *                           more, count  arguments behind the values, and how many
 *                           values they say there are */
#define GLUE_TYPE(fmi, Type, kind, from_number, to_number, more, count)                                                            \
  fmi_status fmi##Get##Type(void *c, const fmi##ValueReference vr[], size_t nvr, fmi##Type value[] more)                           \
  {                                                                                                                                \
    static const char function[] = #fmi "Get" #Type;                                                                               \
    instance *const s = glue_instance_of(c);                                                                                       \
    if (!s) return (fmi_status)GLUE_ERROR;                                                                                         \
    if (nvr == 0) return (fmi_status)glue_none(s, count, function);                                                                \
    if (!glue_listed(s, vr, nvr, value, count, kind, #Type, function) || !glue_readable(s, function)) return (fmi_status)GLUE_ERROR; \
    for (size_t i = 0, at = 0; i < nvr; i++)                                                                                       \
      for (int32_t k = 0; k < glue_elements(s, vr[i]); k++, at++) {                                                                \
        const double number = glue_get(s, glue_variable(s, vr[i]), k);                                                             \
        value[at] = (from_number);                                                                                                 \
      }                                                                                                                            \
    return (fmi_status)GLUE_OK;                                                                                                    \
  }                                                                                                                                \
  fmi_status fmi##Set##Type(void *c, const fmi##ValueReference vr[], size_t nvr, const fmi##Type value[] more)                     \
  {                                                                                                                                \
    static const char function[] = #fmi "Set" #Type;                                                                               \
    instance *const s = glue_instance_of(c);                                                                                       \
    if (!s || !glue_allowed(s, GLUE_INSTANTIATED | GLUE_INITIALIZING | GLUE_STEPPING, function)) return (fmi_status)GLUE_ERROR;    \
    if (nvr == 0) return (fmi_status)glue_none(s, count, function);                                                                \
    if (!glue_listed(s, vr, nvr, value, count, kind, #Type, function)) return (fmi_status)GLUE_ERROR;                              \
    for (size_t i = 0; i < nvr; i++) /* an array before it is refused: each has one value */                                       \
      if (!glue_settable(s, glue_variable(s, vr[i]), (double)(to_number), function)) return (fmi_status)GLUE_ERROR;                \
    for (size_t i = 0; i < nvr; i++) glue_set(s, glue_variable(s, vr[i]), (double)(to_number));                                    \
    glue_was_set(s);                                                                                                               \
    return (fmi_status)GLUE_OK;                                                                                                    \
  }
#define GLUE_ABSENT(name, arguments, type, count)                                \
  fmi_status name arguments                                                      \
  {                                                                              \
    const instance *const s = glue_instance_of(c);                               \
    if (s && nvr == 0) return (fmi_status)glue_none(s, count, #name);            \
    if (s) (void)glue_listed(s, vr, nvr, value, count, 0, type, #name);          \
    return (fmi_status)GLUE_ERROR;                                               \
  }

/* ---- steps and states */

glue_status glue_step(instance *s, const char *function, double time, double step);
glue_status glue_save(const instance *s, const char *function, void **state);
glue_status glue_restore(instance *s, const char *function, const void *state);
glue_status glue_drop(const instance *s, const char *function, void **state);
glue_status glue_state_size(const instance *s, const char *function, const void *state, size_t *size);
glue_status glue_serialize(
    const instance *s, const char *function, const void *state, unsigned char bytes[], size_t size);
glue_status glue_deserialize(
    const instance *s, const char *function, const unsigned char bytes[], size_t size, void **state);

/* Define the functions that all versions have. */
#define GLUE_LIFE(fmi)                                                                                                                                   \
  DOES(fmi##SetDebugLogging, (void *c, fmi##Boolean on, size_t count, const fmi##String names[]), glue_debug_logging(s, function, on, count, names))     \
  DOES(fmi##ExitInitializationMode, (void *c), glue_exit_initialization(s, function))                                                                    \
  DOES(fmi##Terminate, (void *c), glue_terminate(s, function))                                                                                           \
  DOES(fmi##Reset, (void *c), glue_reset(s))
#define GLUE_STATES(fmi, State, Deserialize)                                                                                                             \
  DOES(fmi##Get##State, (void *c, void **state), glue_save(s, function, state))                                                                          \
  DOES(fmi##Set##State, (void *c, void *state), glue_restore(s, function, state))                                                                        \
  DOES(fmi##Free##State, (void *c, void **state), glue_drop(s, function, state))                                                                         \
  DOES(fmi##Serialized##State##Size, (void *c, void *state, size_t *size), glue_state_size(s, function, state, size))                                    \
  DOES(fmi##Serialize##State, (void *c, void *state, fmi##Byte bytes[], size_t size), glue_serialize(s, function, state, (unsigned char *)bytes, size))  \
  DOES(fmi##Deserialize, (void *c, const fmi##Byte bytes[], size_t size, void **state), glue_deserialize(s, function, (const unsigned char *)bytes, size, state))

#endif
