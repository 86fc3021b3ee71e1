/* fmu/glue/fmi2.c - the functions of FMI 2.0 for co-simulation: its types and its names around what glue.c does. */
#include <stdio.h>

#include "fmi2Functions.h"
#include "glue.h"

typedef fmi2Status fmi_status;

static void emit(glue_function *logger, void *environment, const char *name, glue_status status, const char *category, const char *text)
{
  ((fmi2CallbackLogger)logger)(environment, name, (fmi2Status)status, category, text);
}

static const glue_api api = { "fmi2Terminate", "GUID", "FMUstate", "Real", "Integer", "Boolean", 0, emit };

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
const char *fmi2GetVersion(void) { return fmi2Version; }

/* -------------------------------------------------------------------------------------- life cycle */

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                              const fmi2CallbackFunctions *callbacks, fmi2Boolean visible, fmi2Boolean logging)
{
  if (!callbacks) return NULL;
  return glue_instantiate(&api, name, guid, type == fmi2CoSimulation ? NULL : "only co-simulation is supported",
                          (glue_function *)callbacks->logger, callbacks->componentEnvironment, logging);
}

void fmi2FreeInstance(fmi2Component c) { glue_free(c); }

DOES(fmi2SetDebugLogging, (fmi2Component c, fmi2Boolean on, size_t count, const fmi2String names[]),
     glue_debug_logging(s, function, on, count, names))
DOES(fmi2SetupExperiment,
     (fmi2Component c, fmi2Boolean has_tolerance, fmi2Real tolerance, fmi2Real start, fmi2Boolean has_stop, fmi2Real stop),
     glue_setup(s, function, start, has_stop, stop))
DOES(fmi2EnterInitializationMode, (fmi2Component c), glue_enter_initialization(s, function))
DOES(fmi2ExitInitializationMode, (fmi2Component c), glue_exit_initialization(s, function))
DOES(fmi2Terminate, (fmi2Component c), glue_terminate(s, function))
DOES(fmi2Reset, (fmi2Component c), glue_reset(s))

/* ------------------------------------------------------------------------------------------ values */

static int listed(const instance *s, const fmi2ValueReference vr[], size_t nvr, const void *value, char kind, const char *type,
                  const char *function)
{
  return glue_given(s, vr, "vr", function) && glue_given(s, value, "value", function) &&
         glue_known(s, vr, nvr, kind, type, function, NULL);
}

/* Checks of all values come first: a call that is refused sets none. */
#define GET(Type, kind)                                                                                                  \
  fmi2Status fmi2Get##Type(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2##Type value[])               \
  {                                                                                                                      \
    static const char function[] = "fmi2Get" #Type;                                                                     \
    instance *const s = glue_instance_of(c);                                                                            \
    if (!s) return fmi2Error;                                                                                           \
    if (nvr == 0) return fmi2OK;                                                                                        \
    if (!listed(s, vr, nvr, value, kind, #Type, function) || !glue_readable(s, function)) return fmi2Error;             \
    for (size_t i = 0; i < nvr; i++) value[i] = (fmi2##Type)glue_get(s, &fmu_variables[vr[i]], 0);                      \
    return fmi2OK;                                                                                                      \
  }
#define SET(Type, kind, number)                                                                                         \
  fmi2Status fmi2Set##Type(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2##Type value[])        \
  {                                                                                                                      \
    static const char function[] = "fmi2Set" #Type;                                                                     \
    instance *const s = glue_instance_of(c);                                                                            \
    if (!s || !glue_allowed(s, GLUE_INSTANTIATED | GLUE_INITIALIZING | GLUE_STEPPING, function)) return fmi2Error;      \
    if (nvr == 0) return fmi2OK;                                                                                        \
    if (!listed(s, vr, nvr, value, kind, #Type, function)) return fmi2Error;                                            \
    for (size_t i = 0; i < nvr; i++)                                                                                    \
      if (!glue_settable(s, &fmu_variables[vr[i]], (double)(number), function)) return fmi2Error;                       \
    for (size_t i = 0; i < nvr; i++) glue_set(s, &fmu_variables[vr[i]], (double)(number));                              \
    glue_was_set(s);                                                                                                    \
    return fmi2OK;                                                                                                      \
  }
GET(Real, 'r')
GET(Integer, 'i')
GET(Boolean, 'b')
SET(Real, 'r', value[i])
SET(Integer, 'i', value[i])
SET(Boolean, 'b', value[i] != fmi2False)

/* No model has a String. */
#define ABSENT(name, Value)                                                                          \
  fmi2Status name(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, Value value[])         \
  {                                                                                                  \
    const instance *const s = glue_instance_of(c);                                                   \
    if (s && nvr == 0) return fmi2OK;                                                                \
    if (s) (void)listed(s, vr, nvr, value, 0, "String", #name);                                      \
    return fmi2Error;                                                                                \
  }
ABSENT(fmi2GetString, fmi2String)
ABSENT(fmi2SetString, const fmi2String)

/* ------------------------------------------------------------------------------------------- steps */

fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2Integer order[],
                                       const fmi2Real value[])
{
  static const char function[] = "fmi2SetRealInputDerivatives";
  char text[FMU_TEXT];
  instance *const s = glue_instance_of(c);
  if (!s || !glue_allowed(s, GLUE_INITIALIZING | GLUE_STEPPING, function)) return fmi2Error;
  if (nvr == 0) return fmi2OK;
  if (!glue_given(s, vr, "vr", function) || !glue_given(s, order, "order", function) || !glue_given(s, value, "value", function) ||
      !glue_known(s, vr, nvr, 'r', "Real", function, NULL))
    return fmi2Error;
  for (size_t i = 0; i < nvr; i++) {
    const fmu_variable *const v = &fmu_variables[vr[i]];
    if (order[i] == 1 && v->rate != FMU_NO_RATE && value[i] - value[i] == 0.0) continue;
    (void)snprintf(text, sizeof text, "%s takes no derivative of order %d and value %.10g", v->name, order[i], value[i]);
    return (fmi2Status)glue_refuse(s, function, text);
  }
  for (size_t i = 0; i < nvr; i++) glue_set_rate(s, &fmu_variables[vr[i]], value[i]);
  return fmi2OK;
}

DOES(fmi2GetRealOutputDerivatives,
     (fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2Integer order[], fmi2Real value[]),
     nvr == 0 ? GLUE_OK : glue_refuse(s, function, "outputs have no derivatives (maxOutputDerivativeOrder is 0)"))

DOES(fmi2DoStep, (fmi2Component c, fmi2Real time, fmi2Real step, fmi2Boolean no_earlier_state),
     glue_step(s, function, time, step))
DOES(fmi2CancelStep, (fmi2Component c), glue_refuse(s, function, "no step is ever pending"))
/* Steps are done when fmi2DoStep returns, so there is nothing to ask but how far the simulation has got. */
static fmi2Status no_status(fmi2Component c, const char *function)
{
  const instance *const s = glue_instance_of(c);
  if (!s) return fmi2Error;
  glue_say(s, GLUE_DISCARD, GLUE_LOG_WARNING, function);
  return fmi2Discard;
}

fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Real *value)
{
  const instance *const s = glue_instance_of(c);
  if (!s || !glue_given(s, value, "value", "fmi2GetRealStatus")) return fmi2Error;
  if (kind != fmi2LastSuccessfulTime) return no_status(c, "fmi2GetRealStatus: only fmi2LastSuccessfulTime is kept");
  *value = glue_time(s);
  return fmi2OK;
}

fmi2Status fmi2GetStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Status *value)
{
  return no_status(c, "fmi2GetStatus: no step is ever pending");
}

fmi2Status fmi2GetIntegerStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Integer *value)
{
  return no_status(c, "fmi2GetIntegerStatus: there is no such status");
}

fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Boolean *value)
{
  const instance *const s = glue_instance_of(c);
  if (!s || !glue_given(s, value, "value", "fmi2GetBooleanStatus")) return fmi2Error;
  if (kind != fmi2Terminated) return no_status(c, "fmi2GetBooleanStatus: only fmi2Terminated is kept");
  *value = fmi2False;
  return fmi2OK;
}

fmi2Status fmi2GetStringStatus(fmi2Component c, const fmi2StatusKind kind, fmi2String *value)
{
  return no_status(c, "fmi2GetStringStatus: no step is ever pending");
}

DOES(fmi2GetDirectionalDerivative,
     (fmi2Component c, const fmi2ValueReference unknown[], size_t unknowns, const fmi2ValueReference known_[], size_t knowns,
      const fmi2Real dknown[], fmi2Real dunknown[]),
     glue_refuse(s, function, "not provided (providesDirectionalDerivative is false)"))

/* ------------------------------------------------------------------------------------------- state */

DOES(fmi2GetFMUstate, (fmi2Component c, fmi2FMUstate *state), glue_save(s, function, state))
DOES(fmi2SetFMUstate, (fmi2Component c, fmi2FMUstate state), glue_restore(s, function, state))
DOES(fmi2FreeFMUstate, (fmi2Component c, fmi2FMUstate *state), glue_drop(s, function, state))
DOES(fmi2SerializedFMUstateSize, (fmi2Component c, fmi2FMUstate state, size_t *size), glue_state_size(s, function, state, size))
DOES(fmi2SerializeFMUstate, (fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[], size_t size),
     glue_serialize(s, function, state, (unsigned char *)bytes, size))
DOES(fmi2DeSerializeFMUstate, (fmi2Component c, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state),
     glue_deserialize(s, function, (const unsigned char *)bytes, size, state))
