/* fmu/glue/fmi2.c - functions of FMI 2.0 for co-simulation. They call functions of
 * glue.c. */
#include <stdio.h>

#include "fmi2Functions.h"
#include "glue.h"

typedef fmi2Status fmi_status;

/* Call the importer's log function. */
static void emit(glue_function *logger, void *environment, const char *name, glue_status status,
    const char *category, const char *text)
{
  ((fmi2CallbackLogger)logger)(environment, name, (fmi2Status)status, category, text);
}

static const glue_api api = { "fmi2Terminate", "GUID", "FMUstate", "vr", "value", "Real", "Integer",
  "Boolean", 0, emit };

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
const char *fmi2GetVersion(void) { return fmi2Version; }

/* -------------------------------------------------------------------------------------- life cycle */

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
    const fmi2CallbackFunctions *callbacks, fmi2Boolean visible, fmi2Boolean logging)
{
  if (!callbacks) return NULL;
  return glue_instantiate(&api, name, guid,
      type == fmi2CoSimulation ? NULL : "only co-simulation is supported", (glue_function *)callbacks->logger,
      callbacks->componentEnvironment, logging);
}

void fmi2FreeInstance(fmi2Component c) { glue_free(c); }

GLUE_LIFE(fmi2)
GLUE_CALL(fmi2SetupExperiment,
    (fmi2Component c, fmi2Boolean has_tolerance, fmi2Real tolerance, fmi2Real start, fmi2Boolean has_stop,
        fmi2Real stop),
    glue_set_times(s, function, start, has_stop, stop))
GLUE_CALL(fmi2EnterInitializationMode, (fmi2Component c), glue_enter_initialization(s, function))

/* ------------------------------------------------------------------------------------------ values */

#define NO_MORE /* fmi2Get.. and fmi2Set.. have no argument after `value`; those of FMI 3.0 have one */
GLUE_TYPE(fmi2, Real, 'r', (fmi2Real)number, value[i], NO_MORE, nvr)
GLUE_TYPE(fmi2, Integer, 'i', (fmi2Integer)number, value[i], NO_MORE, nvr)
GLUE_TYPE(fmi2, Boolean, 'b', (fmi2Boolean)number, value[i] != fmi2False, NO_MORE, nvr)

/* Get and set functions of type String. They refuse every variable, because no variable
 * has this type. */
GLUE_REFUSE_TYPE(fmi2GetString,
    (fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2String value[]), "String", nvr)
GLUE_REFUSE_TYPE(fmi2SetString,
    (fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2String value[]), "String", nvr)

/* ------------------------------------------------------------------------------------------- steps */

fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t nvr,
    const fmi2Integer order[], const fmi2Real value[])
{
  static const char function[] = "fmi2SetRealInputDerivatives";
  char text[FMU_TEXT];
  instance *const s = glue_find_instance(c);
  if (!s || !glue_check_phase(s, GLUE_INITIALIZING | GLUE_STEPPING, function)) return fmi2Error;
  if (nvr == 0) return fmi2OK;
  if (!glue_check_pointer(s, order, "order", function)
      || !glue_check_variables(s, vr, nvr, value, nvr, 'r', "Real", function))
    return fmi2Error;
  for (size_t i = 0; i < nvr; i++) {
    const fmu_variable *const v = &fmu_variables[vr[i]];
    if (order[i] == 1 && v->rate != FMU_NO_RATE && value[i] - value[i] == 0.0) continue;
    (void)snprintf(text, sizeof text, "%s takes no derivative of order %d with value %.10g", v->name,
        order[i], value[i]);
    return (fmi2Status)glue_refuse(s, function, text);
  }
  for (size_t i = 0; i < nvr; i++) glue_set_rate(s, &fmu_variables[vr[i]], value[i]);
  return fmi2OK;
}

GLUE_CALL(fmi2GetRealOutputDerivatives,
    (fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2Integer order[], fmi2Real value[]),
    nvr == 0 ? GLUE_OK
             : glue_refuse(s, function, "outputs have no derivatives (maxOutputDerivativeOrder is 0)"))

GLUE_CALL(fmi2DoStep, (fmi2Component c, fmi2Real time, fmi2Real step, fmi2Boolean no_earlier_state),
    glue_step(s, function, time, step))
GLUE_CALL(fmi2CancelStep, (fmi2Component c),
    glue_refuse(s, function, "no step is pending, because steps are synchronous"))

/* Refuse a request for a kind of status that this FMU does not have: log the text and
 * return fmi2Discard. Most kinds of status describe a step that is still running, but
 * here a step is complete when fmi2DoStep returns. */
static fmi2Status refuse_status(fmi2Component c, const char *text)
{
  const instance *const s = glue_find_instance(c);
  if (!s) return fmi2Error;
  glue_log(s, GLUE_DISCARD, GLUE_LOG_WARNING, text);
  return fmi2Discard;
}

fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Real *value)
{
  const instance *const s = glue_find_instance(c);
  if (!s || !glue_check_pointer(s, value, "value", "fmi2GetRealStatus")) return fmi2Error;
  if (kind != fmi2LastSuccessfulTime)
    return refuse_status(c, "fmi2GetRealStatus: only fmi2LastSuccessfulTime is supported");
  *value = glue_get_time(s);
  return fmi2OK;
}

fmi2Status fmi2GetStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Status *value)
{
  return refuse_status(c, "fmi2GetStatus: no step is pending, because steps are synchronous");
}

fmi2Status fmi2GetIntegerStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Integer *value)
{
  return refuse_status(c, "fmi2GetIntegerStatus: there is no status of type Integer");
}

fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Boolean *value)
{
  const instance *const s = glue_find_instance(c);
  if (!s || !glue_check_pointer(s, value, "value", "fmi2GetBooleanStatus")) return fmi2Error;
  if (kind != fmi2Terminated)
    return refuse_status(c, "fmi2GetBooleanStatus: only fmi2Terminated is supported");
  *value = fmi2False;
  return fmi2OK;
}

fmi2Status fmi2GetStringStatus(fmi2Component c, const fmi2StatusKind kind, fmi2String *value)
{
  return refuse_status(c, "fmi2GetStringStatus: no step is pending, because steps are synchronous");
}

GLUE_CALL(fmi2GetDirectionalDerivative,
    (fmi2Component c, const fmi2ValueReference unknown[], size_t unknowns, const fmi2ValueReference known_[],
        size_t knowns, const fmi2Real dknown[], fmi2Real dunknown[]),
    glue_refuse(s, function, "not provided (providesDirectionalDerivative is false)"))

/* ------------------------------------------------------------------------------------------- state */

GLUE_STATES(fmi2, FMUstate, DeSerializeFMUstate)
