/* fmu/glue/fmi2.c - the functions of FMI 2.0 for co-simulation: its types and its names around what glue.c does. */
#include <stdio.h>

#include "fmi2Functions.h"
#include "glue.h"

#define ANY (GLUE_INITIALIZING | GLUE_STEPPING)

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

void fmi2FreeInstance(fmi2Component c)
{
  instance *const s = glue_instance_of(c);
  if (s) glue_free(s);
}

/* A function that glue.c does, on an instance that is one. */
#define DONE(call) (s ? (fmi2Status)(call) : fmi2Error)

fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t count, const fmi2String names[])
{
  instance *const s = glue_instance_of(c);
  return DONE(glue_debug_logging(s, "fmi2SetDebugLogging", on, count, names));
}

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean has_tolerance, fmi2Real tolerance, fmi2Real start,
                               fmi2Boolean has_stop, fmi2Real stop)
{
  instance *const s = glue_instance_of(c);
  return DONE(glue_setup(s, "fmi2SetupExperiment", start, has_stop, stop));
}

fmi2Status fmi2EnterInitializationMode(fmi2Component c)
{
  instance *const s = glue_instance_of(c);
  return DONE(glue_enter_initialization(s, "fmi2EnterInitializationMode"));
}

fmi2Status fmi2ExitInitializationMode(fmi2Component c)
{
  instance *const s = glue_instance_of(c);
  return DONE(glue_exit_initialization(s, "fmi2ExitInitializationMode"));
}

fmi2Status fmi2Terminate(fmi2Component c)
{
  instance *const s = glue_instance_of(c);
  return DONE(glue_terminate(s, "fmi2Terminate"));
}

fmi2Status fmi2Reset(fmi2Component c)
{
  instance *const s = glue_instance_of(c);
  return DONE(glue_reset(s));
}

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
fmi2Status fmi2GetString(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2String value[])
{
  const instance *const s = glue_instance_of(c);
  if (s && nvr == 0) return fmi2OK;
  if (s) (void)listed(s, vr, nvr, value, 0, "String", "fmi2GetString");
  return fmi2Error;
}

fmi2Status fmi2SetString(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2String value[])
{
  const instance *const s = glue_instance_of(c);
  if (s && nvr == 0) return fmi2OK;
  if (s) (void)listed(s, vr, nvr, value, 0, "String", "fmi2SetString");
  return fmi2Error;
}

/* ------------------------------------------------------------------------------------------- steps */

fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2Integer order[],
                                       const fmi2Real value[])
{
  static const char function[] = "fmi2SetRealInputDerivatives";
  char text[FMU_TEXT];
  instance *const s = glue_instance_of(c);
  if (!s || !glue_allowed(s, ANY, function)) return fmi2Error;
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

fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2Integer order[],
                                        fmi2Real value[])
{
  const instance *const s = glue_instance_of(c);
  if (!s) return fmi2Error;
  return nvr == 0 ? fmi2OK
                  : (fmi2Status)glue_refuse(s, "fmi2GetRealOutputDerivatives",
                                            "outputs have no derivatives (maxOutputDerivativeOrder is 0)");
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real time, fmi2Real step, fmi2Boolean no_earlier_state)
{
  instance *const s = glue_instance_of(c);
  return DONE(glue_step(s, "fmi2DoStep", time, step));
}

fmi2Status fmi2CancelStep(fmi2Component c)
{
  const instance *const s = glue_instance_of(c);
  return DONE(glue_refuse(s, "fmi2CancelStep", "no step is ever pending"));
}

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

fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference unknown[], size_t unknowns,
                                        const fmi2ValueReference known_[], size_t knowns, const fmi2Real dknown[],
                                        fmi2Real dunknown[])
{
  const instance *const s = glue_instance_of(c);
  return DONE(glue_refuse(s, "fmi2GetDirectionalDerivative", "not provided (providesDirectionalDerivative is false)"));
}

/* ------------------------------------------------------------------------------------------- state */

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state)
{
  const instance *const s = glue_instance_of(c);
  return DONE(glue_save(s, "fmi2GetFMUstate", state));
}

fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state)
{
  instance *const s = glue_instance_of(c);
  return DONE(glue_restore(s, "fmi2SetFMUstate", state));
}

fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state)
{
  const instance *const s = glue_instance_of(c);
  return DONE(glue_drop(s, "fmi2FreeFMUstate", state));
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate state, size_t *size)
{
  const instance *const s = glue_instance_of(c);
  return DONE(glue_state_size(s, "fmi2SerializedFMUstateSize", state, size));
}

fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[], size_t size)
{
  const instance *const s = glue_instance_of(c);
  return DONE(glue_serialize(s, "fmi2SerializeFMUstate", state, (unsigned char *)bytes, size));
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state)
{
  const instance *const s = glue_instance_of(c);
  return DONE(glue_deserialize(s, "fmi2DeSerializeFMUstate", (const unsigned char *)bytes, size, state));
}
