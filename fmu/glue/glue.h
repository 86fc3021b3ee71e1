/* fmu/glue/glue.h - code shared by FMI 2.0 and 3.0: instances and their log, values,
 * steps, saved states. fmi2.c and fmi3.c define the functions of one version each, with
 * its types and names, and call the functions declared here.
 *
 * Memory: fixed pools of instances and of saved states, without allocation. Threads may
 * use different instances at the same time. A refused call (GLUE_ERROR) logs the reason
 * and leaves the instance unchanged. */
#ifndef GLUE_H
#define GLUE_H

#include "fmu_model.h"

/* The standards prescribe the arguments of a function. Some of them are unused here. */
#if defined(__GNUC__)
#pragma GCC diagnostic ignored "-Wunused-parameter"
#endif

#ifndef FMU_INSTANCES
#define FMU_INSTANCES 32 /* max number of instances in one process */
#endif
#ifndef FMU_STATES
#define FMU_STATES 64 /* max number of saved states, all instances together */
#endif

/* The same numbers as fmi2Status and fmi3Status. */
typedef enum glue_status {
  GLUE_OK,
  GLUE_WARNING,
  GLUE_DISCARD,
  GLUE_ERROR,
} glue_status;


/* Phases of an instance. Bits, so that a function can accept several of them. */
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

/* Logger of any FMI version. glue_api.emit() casts it to its own type. */
typedef void glue_function(void);

/* Names and features of a version of FMI. */
typedef struct glue_api {
  const char *terminate;  /* function that ends a run */
  const char *token;      /* name of the identifier of a model description */
  const char *state;      /* argument: saved state */
  const char *references; /* argument: value references */
  const char *values;     /* argument: values of variables */
  const char *real;       /* types of variables */
  const char *integer;
  const char *boolean;
  int extended; /* 1: has fmu_arrays and the time, with value references behind those of
                 * fmu_variables */
  void (*emit)(glue_function *logger, void *environment, const char *name, glue_status status,
      const char *category, const char *text);
} glue_api;

/* Content of a saved state. */
typedef struct glue_content {
  int32_t phase; /* GLUE_INSTANTIATED .. GLUE_TERMINATED */
  int32_t stale; /* 1: outputs are older than the last value set, before the first step */
  double start;  /* [s] start time */
  double now;    /* [s] next communication point */
  model m;
} glue_content;

typedef struct instance {
  volatile long taken;
  char name[128];
  const glue_api *api;
  glue_function *logger;
  void *environment;
  unsigned wanted;       /* bit k: log category k */
  char warned[FMU_TEXT]; /* last warning, to log a persistent one once */
  glue_content c;
} instance;

/* ---- log */

void glue_log(const instance *s, glue_status status, int category, const char *text);

/* Log the error "function: text".   Returned: GLUE_ERROR */
glue_status glue_refuse(const instance *s, const char *function, const char *text);
/* Switch these log categories on or off. Without names: all on, or logEvents off. */
glue_status glue_set_logging(
    instance *s, const char *function, int on, size_t count, const char *const names[]);

/* ---- arguments. Checks return 1, or log an error and return 0. */

/* Return the instance at a pointer; NULL if the pointer is invalid or was freed. */
instance *glue_find_instance(const void *c);

/* Check that the instance is in one of these phases. */
int glue_check_phase(const instance *s, int phases, const char *function);

/* Check that an argument is not NULL. */
int glue_check_pointer(const instance *s, const void *argument, const char *name, const char *function);

/* Return the variable of a value reference; NULL if the reference is unknown. */
const fmu_variable *glue_find_variable(const instance *s, uint32_t vr);

/* Return the number of values of a variable: above 1 for arrays. */
int32_t glue_count_elements(const instance *s, uint32_t vr);

/* Check the arguments of a get or set function: all value references exist and are of
 * this kind, and `count` is the number of their values.
 *   Given:  kind  of fmu_variable; 0 matches no variable
 *           type  name of this kind in this version of FMI, for messages */
int glue_check_variables(const instance *s, const uint32_t vr[], size_t nvr, const void *value, size_t count,
    char kind, const char *type, const char *function);

/* Check that a call without variables has no values.   Returned: GLUE_OK or GLUE_ERROR */
glue_status glue_check_empty(const instance *s, size_t count, const char *function);

/* ---- life cycle */

/* Return a new instance. NULL if all are in use, if the name is missing, if the token
 * differs or if `unsupported` is not NULL.
 *   Given:  unsupported  reason to refuse the call; NULL if there is none
 *           logger       may be NULL */
instance *glue_instantiate(const glue_api *api, const char *name, const char *token, const char *unsupported,
    glue_function *logger, void *environment, int logging);
void glue_free(const void *c);
glue_status glue_set_times(instance *s, const char *function, double start, int has_stop, double stop);
glue_status glue_enter_initialization(instance *s, const char *function);
glue_status glue_exit_initialization(instance *s, const char *function);
glue_status glue_terminate(instance *s, const char *function);
glue_status glue_reset(instance *s);

/* Return the time [s]: end of the last step, before the first one the start time. */
double glue_get_time(const instance *s);

/* Define a function of an FMI version, with its status type fmi_status: check the
 * instance, then call a function of glue.c with it. */
#define GLUE_CALL(name, arguments, call)                    \
  fmi_status name arguments                                 \
  {                                                         \
    static const char *const function = #name;              \
    instance *const s = glue_find_instance(c);              \
    (void)function;                                         \
    return s ? (fmi_status)(call) : (fmi_status)GLUE_ERROR; \
  }

/* ---- values. All are checked before the first is set: a refused call sets none. */

/* In initialization mode, compute the outputs again if a value was set.   Returned: 0 if
 * the model refuses a value */
int glue_update_outputs(instance *s, const char *function);

/* Check that this variable may be set to this value in the current phase. */
int glue_check_value(const instance *s, const fmu_variable *v, double value, const char *function);

/* Return element `element` of a variable; 0 for a scalar. */
double glue_get(instance *s, const fmu_variable *v, int32_t element);

/* Set a scalar: arrays are outputs and cannot be set. Call glue_mark_stale() after it. */
void glue_set(instance *s, const fmu_variable *v, double value);

/* Set the time derivative of an input. */
void glue_set_rate(instance *s, const fmu_variable *v, double rate);

/* Mark the outputs as older than the inputs, before the first step. */
void glue_mark_stale(instance *s);

/* Define the functions of an FMI version that get and set values of a type.
 *   from_number  expression: `number`, a double, as a value of this type
 *   to_number    expression: value[i] as a double
 *   more, count  arguments after the values; expression for the number of values */
#define GLUE_TYPE(fmi, Type, kind, from_number, to_number, more, count)                                  \
  fmi_status fmi##Get##Type(void *c, const fmi##ValueReference vr[], size_t nvr, fmi##Type value[] more) \
  {                                                                                                      \
    static const char function[] = #fmi "Get" #Type;                                                     \
    instance *const s = glue_find_instance(c);                                                           \
    if (!s) return (fmi_status)GLUE_ERROR;                                                               \
    if (nvr == 0) return (fmi_status)glue_check_empty(s, count, function);                               \
    if (!glue_check_variables(s, vr, nvr, value, count, kind, #Type, function))                          \
      return (fmi_status)GLUE_ERROR;                                                                     \
    if (!glue_update_outputs(s, function)) return (fmi_status)GLUE_ERROR;                                \
    for (size_t i = 0, at = 0; i < nvr; i++)                                                             \
      for (int32_t k = 0; k < glue_count_elements(s, vr[i]); k++, at++) {                                \
        const double number = glue_get(s, glue_find_variable(s, vr[i]), k);                              \
        value[at] = (from_number);                                                                       \
      }                                                                                                  \
    return (fmi_status)GLUE_OK;                                                                          \
  }                                                                                                      \
  fmi_status fmi##Set##Type(                                                                             \
      void *c, const fmi##ValueReference vr[], size_t nvr, const fmi##Type value[] more)                 \
  {                                                                                                      \
    static const char function[] = #fmi "Set" #Type;                                                     \
    instance *const s = glue_find_instance(c);                                                           \
    const int phases = GLUE_INSTANTIATED | GLUE_INITIALIZING | GLUE_STEPPING;                            \
    if (!s || !glue_check_phase(s, phases, function)) return (fmi_status)GLUE_ERROR;                     \
    if (nvr == 0) return (fmi_status)glue_check_empty(s, count, function);                               \
    if (!glue_check_variables(s, vr, nvr, value, count, kind, #Type, function))                          \
      return (fmi_status)GLUE_ERROR;                                                                     \
    /* arrays are refused here, so i also counts the values */                                           \
    for (size_t i = 0; i < nvr; i++)                                                                     \
      if (!glue_check_value(s, glue_find_variable(s, vr[i]), (double)(to_number), function))             \
        return (fmi_status)GLUE_ERROR;                                                                   \
    for (size_t i = 0; i < nvr; i++) glue_set(s, glue_find_variable(s, vr[i]), (double)(to_number));     \
    glue_mark_stale(s);                                                                                  \
    return (fmi_status)GLUE_OK;                                                                          \
  }

/* Define a get or set function of a type without variables. It refuses all of them. */
#define GLUE_REFUSE_TYPE(name, arguments, type, count)                           \
  fmi_status name arguments                                                      \
  {                                                                              \
    const instance *const s = glue_find_instance(c);                             \
    if (s && nvr == 0) return (fmi_status)glue_check_empty(s, count, #name);     \
    if (s) (void)glue_check_variables(s, vr, nvr, value, count, 0, type, #name); \
    return (fmi_status)GLUE_ERROR;                                               \
  }

/* ---- steps and states */

/* Run one step from `time` to `time + step` [s].   Returned: GLUE_WARNING where an input
 * is missing or out of range */
glue_status glue_step(instance *s, const char *function, double time, double step);

/* Save the state, in a new place if *state is NULL. */
glue_status glue_save_state(const instance *s, const char *function, void **state);

/* Continue from a saved state. */
glue_status glue_restore_state(instance *s, const char *function, const void *state);

/* Free a saved state and set *state to NULL. */
glue_status glue_free_state(const instance *s, const char *function, void **state);

/* Serialize a saved state: its size in bytes; to bytes; from bytes, in a new place. */
glue_status glue_get_state_size(const instance *s, const char *function, const void *state, size_t *size);
glue_status glue_serialize_state(
    const instance *s, const char *function, const void *state, unsigned char bytes[], size_t size);
glue_status glue_deserialize_state(
    const instance *s, const char *function, const unsigned char bytes[], size_t size, void **state);

/* Define the functions that both versions have: life cycle, saved states. */
#define GLUE_LIFE(fmi)                                                                     \
  GLUE_CALL(fmi##SetDebugLogging,                                                          \
      (void *c, fmi##Boolean on, size_t count, const fmi##String names[]),                \
      glue_set_logging(s, function, on, count, names))                                    \
  GLUE_CALL(fmi##ExitInitializationMode, (void *c), glue_exit_initialization(s, function)) \
  GLUE_CALL(fmi##Terminate, (void *c), glue_terminate(s, function))                        \
  GLUE_CALL(fmi##Reset, (void *c), glue_reset(s))
#define GLUE_STATES(fmi, State, Deserialize)                                                 \
  GLUE_CALL(fmi##Get##State, (void *c, void **state), glue_save_state(s, function, state))   \
  GLUE_CALL(fmi##Set##State, (void *c, void *state), glue_restore_state(s, function, state)) \
  GLUE_CALL(fmi##Free##State, (void *c, void **state), glue_free_state(s, function, state))  \
  GLUE_CALL(fmi##Serialized##State##Size, (void *c, void *state, size_t *size),              \
      glue_get_state_size(s, function, state, size))                                        \
  GLUE_CALL(fmi##Serialize##State, (void *c, void *state, fmi##Byte bytes[], size_t size),   \
      glue_serialize_state(s, function, state, (unsigned char *)bytes, size))               \
  GLUE_CALL(fmi##Deserialize, (void *c, const fmi##Byte bytes[], size_t size, void **state), \
      glue_deserialize_state(s, function, (const unsigned char *)bytes, size, state))

#endif
