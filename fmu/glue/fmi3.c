/* fmu/glue/fmi3.c - functions of FMI 3.0 for co-simulation. They call functions of
 * glue.c. Event mode, clocks, early return and intermediate update are not supported. */
#include "fmi3Functions.h"
#include "glue.h"

typedef fmi3Status fmi_status;

/* Call the importer's log function. In FMI 3.0 this function has no argument for the name
 * of the instance: the importer identifies the instance by `environment`. */
static void emit(glue_function *logger, void *environment, const char *name, glue_status status,
    const char *category, const char *text)
{
  ((fmi3LogMessageCallback)logger)(environment, (fmi3Status)status, category, text);
}

static const glue_api api = { "fmi3Terminate", "instantiation token", "FMUState", "valueReferences", "values",
  "Float64", "Int32", "Boolean", 1, emit };

const char *fmi3GetVersion(void) { return fmi3Version; }

/* -------------------------------------------------------------------------------------- life cycle */

fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String resources,
    fmi3Boolean visible, fmi3Boolean logging, fmi3Boolean events, fmi3Boolean early_return,
    const fmi3ValueReference intermediate[], size_t intermediates, fmi3InstanceEnvironment environment,
    fmi3LogMessageCallback logger, fmi3IntermediateUpdateCallback update)
{
  const char *unsupported = NULL;
  if (events) unsupported = "eventModeUsed is true, and there is no event mode (hasEventMode is false)";
  else if (intermediates > 0)
    unsupported = "requiredIntermediateVariables are given, and there is no intermediate update "
                  "(providesIntermediateUpdate is false)";
  return glue_instantiate(&api, name, token, unsupported, (glue_function *)logger, environment, logging);
}

fmi3Instance fmi3InstantiateModelExchange(fmi3String name, fmi3String token, fmi3String resources,
    fmi3Boolean visible, fmi3Boolean logging, fmi3InstanceEnvironment environment,
    fmi3LogMessageCallback logger)
{
  return glue_instantiate(
      &api, name, token, "only co-simulation is supported", (glue_function *)logger, environment, logging);
}

fmi3Instance fmi3InstantiateScheduledExecution(fmi3String name, fmi3String token, fmi3String resources,
    fmi3Boolean visible, fmi3Boolean logging, fmi3InstanceEnvironment environment,
    fmi3LogMessageCallback logger, fmi3ClockUpdateCallback update, fmi3LockPreemptionCallback lock,
    fmi3UnlockPreemptionCallback unlock)
{
  return glue_instantiate(
      &api, name, token, "only co-simulation is supported", (glue_function *)logger, environment, logging);
}

void fmi3FreeInstance(fmi3Instance c) { glue_free(c); }

GLUE_LIFE(fmi3)

fmi3Status fmi3EnterInitializationMode(fmi3Instance c, fmi3Boolean has_tolerance, fmi3Float64 tolerance,
    fmi3Float64 start, fmi3Boolean has_stop, fmi3Float64 stop)
{
  static const char function[] = "fmi3EnterInitializationMode";
  instance *const s = glue_find_instance(c);
  if (!s || glue_set_times(s, function, start, has_stop, stop) != GLUE_OK) return fmi3Error;
  return (fmi3Status)glue_enter_initialization(s, function);
}

/* ------------------------------------------------------------------------------------------ values */

#define COUNT , size_t count /* argument of fmi3Get.. and fmi3Set.. after `value` */
GLUE_TYPE(fmi3, Float64, 'r', number, value[i], COUNT, count)
GLUE_TYPE(fmi3, Int32, 'i', (fmi3Int32)number, value[i], COUNT, count)
GLUE_TYPE(fmi3, Int64, 'e', (fmi3Int64)number, value[i], COUNT, count)
GLUE_TYPE(fmi3, Boolean, 'b', number > 0.0, value[i], COUNT, count)

/* Define the get and set functions of a type that no variable has. They refuse every
 * variable. */
#define REFUSE_TYPE(Type)                                                                              \
  GLUE_REFUSE_TYPE(fmi3Get##Type,                                                                       \
      (fmi3Instance c, const fmi3ValueReference vr[], size_t nvr, fmi3##Type value[], size_t count), \
      #Type, count)                                                                                \
  GLUE_REFUSE_TYPE(fmi3Set##Type,                                                                       \
      (fmi3Instance c, const fmi3ValueReference vr[], size_t nvr, const fmi3##Type value[],        \
          size_t count),                                                                           \
      #Type, count)
REFUSE_TYPE(Float32)
REFUSE_TYPE(Int8)
REFUSE_TYPE(UInt8)
REFUSE_TYPE(Int16)
REFUSE_TYPE(UInt16)
REFUSE_TYPE(UInt32)
REFUSE_TYPE(UInt64)
REFUSE_TYPE(String)
GLUE_REFUSE_TYPE(fmi3GetBinary,
    (fmi3Instance c, const fmi3ValueReference vr[], size_t nvr, size_t sizes[], fmi3Binary value[],
        size_t count),
    "Binary", count)
GLUE_REFUSE_TYPE(fmi3SetBinary,
    (fmi3Instance c, const fmi3ValueReference vr[], size_t nvr, const size_t sizes[],
        const fmi3Binary value[], size_t count),
    "Binary", count)
GLUE_REFUSE_TYPE(fmi3GetClock, (fmi3Instance c, const fmi3ValueReference vr[], size_t nvr, fmi3Clock value[]),
    "Clock", nvr)
GLUE_REFUSE_TYPE(fmi3SetClock,
    (fmi3Instance c, const fmi3ValueReference vr[], size_t nvr, const fmi3Clock value[]), "Clock", nvr)

/* ------------------------------------------------------------------------------------------- steps */

/* Run a step. Each of the last four arguments is a pointer to an output, or NULL if the
 * importer does not need this output. */
fmi3Status fmi3DoStep(fmi3Instance c, fmi3Float64 time, fmi3Float64 step, fmi3Boolean no_earlier_state,
    fmi3Boolean *event, fmi3Boolean *terminate, fmi3Boolean *early, fmi3Float64 *last)
{
  instance *const s = glue_find_instance(c);
  if (!s) return fmi3Error;
  const glue_status status = glue_step(s, "fmi3DoStep", time, step);
  if (event) *event = fmi3False;
  if (terminate) *terminate = fmi3False;
  if (early) *early = fmi3False;
  if (last) *last = glue_get_time(s);
  return (fmi3Status)status;
}

/* ------------------------------------------------------------------------------------------- state */

GLUE_STATES(fmi3, FMUState, DeserializeFMUState)

/* ----------------------------------------------------------------------------- refused: not supported */

/* Define a function of FMI that refuses every call and logs the reason `why`. */
#define REFUSE(name, arguments, why) GLUE_CALL(name, arguments, glue_refuse(s, function, why))
static const char no_events[] = "there is no event mode (hasEventMode is false)";
static const char no_exchange[] = "only co-simulation is supported";
static const char no_adjoint[] = "not provided (providesAdjointDerivatives is false)";
static const char no_directional[] = "not provided (providesDirectionalDerivatives is false)";
static const char no_dependencies[] = "not provided (providesPerElementDependencies is false)";
static const char no_structure[] = "there are no structural parameters";

GLUE_CALL(fmi3GetOutputDerivatives,
    (fmi3Instance c, const fmi3ValueReference vr[], size_t nvr, const fmi3Int32 order[], fmi3Float64 value[],
        size_t count),
    nvr == 0 ? glue_check_empty(s, count, function)
             : glue_refuse(s, function, "outputs have no derivatives (maxOutputDerivativeOrder is 0)"))
REFUSE(fmi3GetDirectionalDerivative,
    (fmi3Instance c, const fmi3ValueReference unknown[], size_t unknowns, const fmi3ValueReference known[],
        size_t knowns, const fmi3Float64 seed[], size_t seeds, fmi3Float64 sensitivity[],
        size_t sensitivities),
    no_directional)
REFUSE(fmi3GetAdjointDerivative,
    (fmi3Instance c, const fmi3ValueReference unknown[], size_t unknowns, const fmi3ValueReference known[],
        size_t knowns, const fmi3Float64 seed[], size_t seeds, fmi3Float64 sensitivity[],
        size_t sensitivities),
    no_adjoint)
REFUSE(fmi3GetNumberOfVariableDependencies, (fmi3Instance c, fmi3ValueReference vr, size_t *count),
    no_dependencies)
REFUSE(fmi3GetVariableDependencies,
    (fmi3Instance c, fmi3ValueReference dependent, size_t elements[], fmi3ValueReference independents[],
        size_t of[], fmi3DependencyKind kinds[], size_t count),
    no_dependencies)
REFUSE(fmi3EnterConfigurationMode, (fmi3Instance c), no_structure)
REFUSE(fmi3ExitConfigurationMode, (fmi3Instance c), no_structure)
REFUSE(fmi3EnterEventMode, (fmi3Instance c), no_events)
REFUSE(fmi3EnterStepMode, (fmi3Instance c), no_events)
REFUSE(fmi3EvaluateDiscreteStates, (fmi3Instance c), no_events)
REFUSE(fmi3UpdateDiscreteStates,
    (fmi3Instance c, fmi3Boolean *again, fmi3Boolean *terminate, fmi3Boolean *nominals, fmi3Boolean *values,
        fmi3Boolean *has_next, fmi3Float64 *next),
    no_events)

/* Define a function of FMI for clocks. It refuses every call that passes a value
 * reference, because there are no clocks. */
#define REFUSE_CLOCK(name, ...)                                                                  \
  GLUE_CALL(name, (fmi3Instance c, const fmi3ValueReference vr[], size_t nvr, __VA_ARGS__), \
       nvr == 0 ? GLUE_OK : glue_refuse(s, function, "there are no clocks"))
REFUSE_CLOCK(fmi3GetIntervalDecimal, fmi3Float64 interval[], fmi3IntervalQualifier qualifier[])
REFUSE_CLOCK(fmi3GetShiftFraction, fmi3UInt64 counter[], fmi3UInt64 resolution[])
REFUSE_CLOCK(fmi3SetIntervalFraction, const fmi3UInt64 counter[], const fmi3UInt64 resolution[])
REFUSE_CLOCK(fmi3SetShiftFraction, const fmi3UInt64 counter[], const fmi3UInt64 resolution[])
REFUSE_CLOCK(fmi3GetShiftDecimal, fmi3Float64 shift[])
REFUSE_CLOCK(fmi3SetIntervalDecimal, const fmi3Float64 interval[])
REFUSE_CLOCK(fmi3SetShiftDecimal, const fmi3Float64 shift[])
REFUSE_CLOCK(
    fmi3GetIntervalFraction, fmi3UInt64 counter[], fmi3UInt64 resolution[], fmi3IntervalQualifier qualifier[])

/* Functions of model exchange, and fmi3ActivateModelPartition of scheduled execution.
 * They refuse every call. They exist only because some importers load them from every
 * FMU. */
REFUSE(fmi3EnterContinuousTimeMode, (fmi3Instance c), no_exchange)
REFUSE(fmi3ActivateModelPartition, (fmi3Instance c, fmi3ValueReference clock, fmi3Float64 time), no_exchange)
REFUSE(fmi3CompletedIntegratorStep,
    (fmi3Instance c, fmi3Boolean no_earlier_state, fmi3Boolean *event, fmi3Boolean *terminate), no_exchange)
REFUSE(fmi3SetTime, (fmi3Instance c, fmi3Float64 time), no_exchange)
REFUSE(fmi3SetContinuousStates, (fmi3Instance c, const fmi3Float64 values[], size_t count), no_exchange)
REFUSE(fmi3GetContinuousStates, (fmi3Instance c, fmi3Float64 values[], size_t count), no_exchange)
REFUSE(fmi3GetContinuousStateDerivatives, (fmi3Instance c, fmi3Float64 values[], size_t count), no_exchange)
REFUSE(fmi3GetNominalsOfContinuousStates, (fmi3Instance c, fmi3Float64 values[], size_t count), no_exchange)
REFUSE(fmi3GetEventIndicators, (fmi3Instance c, fmi3Float64 values[], size_t count), no_exchange)
REFUSE(fmi3GetNumberOfEventIndicators, (fmi3Instance c, size_t *count), no_exchange)
REFUSE(fmi3GetNumberOfContinuousStates, (fmi3Instance c, size_t *count), no_exchange)
