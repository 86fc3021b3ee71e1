/* fmu/glue/glue.h - code shared by FMI 2.0 and 3.0: instances and their log, values,
 * steps, saved states. fmi2.c defines the functions of FMI 2.0, and fmi3.c those of
 * FMI 3.0, with the types and names of the standard. Both call the functions declared
 * here.
 *
 * Instances and saved states are in two static arrays of fixed size; no memory is
 * allocated. Threads may use different instances at the same time. A refused call
 * returns GLUE_ERROR, logs the reason and leaves the instance unchanged. */
#ifndef GLUE_H
#define GLUE_H

#include "fmu_model.h"

/* Switch off the warning about unused arguments: FMI prescribes the arguments of each
 * function, and the FMUs do not use all of them. */
#if defined(__GNUC__)
#pragma GCC diagnostic ignored "-Wunused-parameter"
#endif

#ifndef FMU_INSTANCES
#define FMU_INSTANCES 32 /* max number of instances in one process */
#endif
#ifndef FMU_STATES
#define FMU_STATES 64 /* max number of saved states of all instances in one process */
#endif

/* Result of a call. The numbers are equal to those of fmi2Status and fmi3Status. */
typedef enum glue_status {
  GLUE_OK,
  GLUE_WARNING,
  GLUE_DISCARD,
  GLUE_ERROR,
} glue_status;

/* Phases of an instance. Each is one bit, so that a mask can hold the phases in which a
 * function may be called. */
enum {
  GLUE_INSTANTIATED = 1,
  GLUE_INITIALIZING = 2,
  GLUE_STEPPING = 4,
  GLUE_TERMINATED = 8,
};

/* Log categories: indices in FMU_LOG_CATEGORIES. */
enum {
  GLUE_LOG_ERROR,
  GLUE_LOG_WARNING,
  GLUE_LOG_EVENT,
  GLUE_LOG_CATEGORIES,
};

/* Log function of the importer. Its true type depends on the version of FMI, and
 * glue_api.emit() casts it to that type. */
typedef void glue_function(void);

/* Differences between FMI 2.0 and FMI 3.0. `terminate` .. `boolean`: names that this
 * version of FMI uses, for messages. */
typedef struct glue_api {
  const char *terminate;  /* function that ends a run: fmi2Terminate or fmi3Terminate */
  const char *token;      /* id that modelDescription.xml states: "GUID" or "instantiation token" */
  const char *state;      /* name of the argument with a saved state */
  const char *references; /* name of the argument with the value references */
  const char *values;     /* name of the argument with the values */
  const char *real;       /* name of the type of real variables */
  const char *integer;    /* name of the type of integer variables */
  const char *boolean;    /* name of the type of Boolean variables */
  int extended;           /* 1: the variables of the FMU are fmu_variables, fmu_arrays and
                           * fmu_time, with value references in this order (FMI 3.0). 0: they
                           * are fmu_variables only (FMI 2.0) */
  /* Call the importer's log function. */
  void (*emit)(glue_function *logger, void *environment, const char *name, glue_status status,
      const char *category, const char *text);
} glue_api;

/* Part of an instance that a saved state contains. */
typedef struct glue_content {
  int32_t phase; /* GLUE_INSTANTIATED .. GLUE_TERMINATED */
  int32_t stale; /* 1: outputs are out of date, because a value was set before the first step */
  double start;  /* [s] start time */
  double now;    /* [s] time at which the next step begins */
  model m;
} glue_content;

typedef struct instance {
  volatile long taken; /* 1: in use; 0: free */
  char name[128];      /* name that the importer gave */
  const glue_api *api; /* version of FMI */
  glue_function *logger;
  void *environment;     /* argument of the logger */
  unsigned wanted;       /* bit k is 1: log category k is on */
  char warned[FMU_TEXT]; /* warning of the last step. The same warning is not logged again */
  glue_content c;
} instance;

/* ---- log */

/* Log a text, if its category is on. */
void glue_log(const instance *s, glue_status status, int category, const char *text);

/* Log the error "function: text".   Returned: GLUE_ERROR */
glue_status glue_refuse(const instance *s, const char *function, const char *text);

/* Switch the named log categories on or off. If no category is named (count is 0), on = 1
 * switches all categories on. on = 0 then switches only logEvents off: errors and
 * warnings are still logged, as after glue_instantiate() with logging = 0. */
glue_status glue_set_logging(
    instance *s, const char *function, int on, size_t count, const char *const names[]);

/* ---- arguments. The functions glue_check_*() return 1 if the check succeeds; otherwise
 * they log an error and return 0. Only glue_check_empty() returns a glue_status. */

/* Return the instance to which a pointer points. Return NULL if it points to no instance
 * that is in use. */
instance *glue_find_instance(const void *c);

/* Check that the instance is in one of the phases of a mask. */
int glue_check_phase(const instance *s, int phases, const char *function);

/* Check that an argument is not NULL. */
int glue_check_pointer(const instance *s, const void *argument, const char *name, const char *function);

/* Return the variable with a value reference, or NULL if no variable has it. */
const fmu_variable *glue_find_variable(const instance *s, uint32_t vr);

/* Return the number of values of a variable: 1 for a scalar, more for an array. */
int32_t glue_count_elements(const instance *s, uint32_t vr);

/* Check the arguments of a get or set function: each value reference belongs to a
 * variable of kind `kind`, and `count` is the number of values of all these variables.
 *   Given:  kind  fmu_variable.kind; 0: no variable has the FMI type of the function, so
 *                 the check fails for every value reference
 *           type  name of the FMI type, for messages */
int glue_check_variables(const instance *s, const uint32_t vr[], size_t nvr, const void *value, size_t count,
    char kind, const char *type, const char *function);

/* Check a get or set call that passes no value references: its number of values `count`
 * must be 0. Return GLUE_OK; otherwise log an error and return GLUE_ERROR. */
glue_status glue_check_empty(const instance *s, size_t count, const char *function);

/* ---- life cycle */

/* Return a new instance. Log an error and return NULL if all instances are in use, if the
 * name is missing, if the token differs from FMU_GUID, or if `unsupported` is not NULL.
 *   Given:  token        GUID that the importer has read in modelDescription.xml.
 *                        FMU_GUID is the GUID with which this binary was built. If they
 *                        differ, the description is of a different version
 *           unsupported  reason to refuse the call; NULL if there is none
 *           logger       log function of the importer, or NULL
 *           logging      1: log all categories; 0: log errors and warnings only */
instance *glue_instantiate(const glue_api *api, const char *name, const char *token, const char *unsupported,
    glue_function *logger, void *environment, int logging);

/* Free an instance and its saved states. */
void glue_free(const void *c);

/* Functions of FMI. Each checks that the instance is in the right phase. */
glue_status glue_set_times(instance *s, const char *function, double start, int has_stop, double stop);
glue_status glue_enter_initialization(instance *s, const char *function);
glue_status glue_exit_initialization(instance *s, const char *function);
glue_status glue_terminate(instance *s, const char *function);
glue_status glue_reset(instance *s);

/* Return the time [s] at the end of the last step. Before the first step, return the
 * start time. */
double glue_get_time(const instance *s);

/* Define a function of FMI. The function finds the instance `s` to which its argument `c`
 * points, and returns the result of the expression `call`, such as
 * glue_free_state(s, ...). If `c` points to no instance, it returns GLUE_ERROR.
 * fmi_status is the status type of FMI. */
#define GLUE_CALL(name, arguments, call)                    \
  fmi_status name arguments                                 \
  {                                                         \
    static const char *const function = #name;              \
    instance *const s = glue_find_instance(c);              \
    (void)function;                                         \
    return s ? (fmi_status)(call) : (fmi_status)GLUE_ERROR; \
  }

/* ---- values. A call checks all its values before it sets the first. A refused call
 * therefore sets no value. */

/* Prepare the outputs for a get function. In initialization mode, compute the outputs
 * again if a parameter or input was set since the last computation. In the other phases,
 * do nothing.   Returned: 0 if the model refuses a parameter or input, otherwise 1 */
int glue_update_outputs(instance *s, const char *function);

/* Return 1 if this variable may be set to this value in the current phase. Otherwise log
 * an error and return 0. */
int glue_check_value(const instance *s, const fmu_variable *v, double value, const char *function);

/* Return the value of an element of a variable. A scalar has only element 0. */
double glue_get(instance *s, const fmu_variable *v, int32_t element);

/* Set a scalar variable. No array can be set, because all arrays are outputs. The outputs
 * are not computed here: the caller sets all its values, and then calls
 * glue_mark_stale() once. */
void glue_set(instance *s, const fmu_variable *v, double value);

/* Set the time derivative of an input. */
void glue_set_rate(instance *s, const fmu_variable *v, double rate);

/* Mark the outputs as out of date, because a value was set. After initialization this has
 * no effect: the next step computes the outputs. */
void glue_mark_stale(instance *s);

/* Define the functions of FMI that get and set the values of variables of one type.
 *   Type         FMI's name of the type
 *   kind         kind of the variables as in fmu_variable
 *   from_number  expression that converts `number`, a double, to the type
 *   to_number    expression that converts value[i] to a number
 *   more         arguments that follow the argument `value`
 *   count        expression for the number of values */
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
    /* check all values before setting one. Only scalars can be set, so vr[i] has the value value[i] */  \
    for (size_t i = 0; i < nvr; i++)                                                                     \
      if (!glue_check_value(s, glue_find_variable(s, vr[i]), (double)(to_number), function))             \
        return (fmi_status)GLUE_ERROR;                                                                   \
    for (size_t i = 0; i < nvr; i++) glue_set(s, glue_find_variable(s, vr[i]), (double)(to_number));     \
    glue_mark_stale(s);                                                                                  \
    return (fmi_status)GLUE_OK;                                                                          \
  }

/* Define the get or set function of a type that no variable has. The function refuses
 * every value reference. */
#define GLUE_REFUSE_TYPE(name, arguments, type, count)                           \
  fmi_status name arguments                                                      \
  {                                                                              \
    const instance *const s = glue_find_instance(c);                             \
    if (s && nvr == 0) return (fmi_status)glue_check_empty(s, count, #name);     \
    if (s) (void)glue_check_variables(s, vr, nvr, value, count, 0, type, #name); \
    return (fmi_status)GLUE_ERROR;                                               \
  }

/* ---- steps and states */

/* Run one step from `time` to `time + step` [s].   Returned: GLUE_WARNING if an input is
 * missing or out of range */
glue_status glue_step(instance *s, const char *function, double time, double step);

/* Save the state of the instance. If *state is NULL, set it to a new saved state;
 * otherwise overwrite the saved state *state. */
glue_status glue_save_state(const instance *s, const char *function, void **state);

/* Replace the state of the instance by a saved state. */
glue_status glue_restore_state(instance *s, const char *function, const void *state);

/* Free a saved state and set *state to NULL. */
glue_status glue_free_state(const instance *s, const char *function, void **state);

/* Set *size to the number of bytes of a serialized state. */
glue_status glue_get_state_size(const instance *s, const char *function, const void *state, size_t *size);

/* Serialize a saved state: write it to the array `bytes`, whose size is `size`. */
glue_status glue_serialize_state(
    const instance *s, const char *function, const void *state, unsigned char bytes[], size_t size);

/* Check the `size` bytes of a serialized state. Make a saved state of them, and set
 * *state to it. */
glue_status glue_deserialize_state(
    const instance *s, const char *function, const unsigned char bytes[], size_t size, void **state);

/* Define the functions of the life cycle that both versions of FMI have. */
#define GLUE_LIFE(fmi)                                                                     \
  GLUE_CALL(fmi##SetDebugLogging,                                                          \
      (void *c, fmi##Boolean on, size_t count, const fmi##String names[]),                \
      glue_set_logging(s, function, on, count, names))                                    \
  GLUE_CALL(fmi##ExitInitializationMode, (void *c), glue_exit_initialization(s, function)) \
  GLUE_CALL(fmi##Terminate, (void *c), glue_terminate(s, function))                        \
  GLUE_CALL(fmi##Reset, (void *c), glue_reset(s))

/* Define the functions of saved states. State and Deserialize are parts of their names,
 * which differ between the versions of FMI. */
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
