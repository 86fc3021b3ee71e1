/* fmu/glue/fmi3.c - the functions of FMI 3.0 for co-simulation: its types and its names around what glue.c does. No event mode, no
 * clocks, no early return, no intermediate update: a step is a sample, and nothing happens between two of them. */
#include "fmi3Functions.h"
#include "glue.h"

/* The importer knows by the environment which instance it is. */
static void emit(glue_function *logger, void *environment, const char *name, glue_status status, const char *category, const char *text)
{
  ((fmi3LogMessageCallback)logger)(environment, (fmi3Status)status, category, text);
}

static const glue_api api = { "fmi3Terminate", "instantiation token", "FMUState", "Float64", "Int32", "Boolean", 1, emit };

/* A function that glue.c does, on an instance that is one. */
#define DONE(call) (s ? (fmi3Status)(call) : fmi3Error)
#define ON_INSTANCE(c) instance *const s = glue_instance_of(c)
#define ON_CONST_INSTANCE(c) const instance *const s = glue_instance_of(c)

const char *fmi3GetVersion(void) { return fmi3Version; }

/* -------------------------------------------------------------------------------------- life cycle */

fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible, fmi3Boolean logging,
                                         fmi3Boolean events, fmi3Boolean early_return, const fmi3ValueReference intermediate[],
                                         size_t intermediates, fmi3InstanceEnvironment environment, fmi3LogMessageCallback logger,
                                         fmi3IntermediateUpdateCallback update)
{
  const char *unsupported = NULL;
  if (events) unsupported = "eventModeUsed is true, and there is no event mode (hasEventMode is false)";
  else if (intermediates > 0) unsupported = "requiredIntermediateVariables are asked for, and there are none (providesIntermediateUpdate is false)";
  return glue_instantiate(&api, name, token, unsupported, (glue_function *)logger, environment, logging);
}

fmi3Instance fmi3InstantiateModelExchange(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible, fmi3Boolean logging,
                                          fmi3InstanceEnvironment environment, fmi3LogMessageCallback logger)
{
  return glue_instantiate(&api, name, token, "only co-simulation is supported", (glue_function *)logger, environment, logging);
}

fmi3Instance fmi3InstantiateScheduledExecution(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
                                               fmi3Boolean logging, fmi3InstanceEnvironment environment, fmi3LogMessageCallback logger,
                                               fmi3ClockUpdateCallback update, fmi3LockPreemptionCallback lock,
                                               fmi3UnlockPreemptionCallback unlock)
{
  return glue_instantiate(&api, name, token, "only co-simulation is supported", (glue_function *)logger, environment, logging);
}

void fmi3FreeInstance(fmi3Instance c)
{
  ON_INSTANCE(c);
  if (s) glue_free(s);
}

fmi3Status fmi3SetDebugLogging(fmi3Instance c, fmi3Boolean on, size_t count, const fmi3String names[])
{
  ON_INSTANCE(c);
  return DONE(glue_debug_logging(s, "fmi3SetDebugLogging", on, count, names));
}

fmi3Status fmi3EnterInitializationMode(fmi3Instance c, fmi3Boolean has_tolerance, fmi3Float64 tolerance, fmi3Float64 start,
                                       fmi3Boolean has_stop, fmi3Float64 stop)
{
  static const char function[] = "fmi3EnterInitializationMode";
  ON_INSTANCE(c);
  if (!s || glue_setup(s, function, start, has_stop, stop) != GLUE_OK) return fmi3Error;
  return (fmi3Status)glue_enter_initialization(s, function);
}

fmi3Status fmi3ExitInitializationMode(fmi3Instance c)
{
  ON_INSTANCE(c);
  return DONE(glue_exit_initialization(s, "fmi3ExitInitializationMode"));
}

fmi3Status fmi3Terminate(fmi3Instance c)
{
  ON_INSTANCE(c);
  return DONE(glue_terminate(s, "fmi3Terminate"));
}

fmi3Status fmi3Reset(fmi3Instance c)
{
  ON_INSTANCE(c);
  return DONE(glue_reset(s));
}

/* ------------------------------------------------------------------------------------------ values */

/* The arguments fit together: `count` values for these variables, of this kind. */
static int listed(const instance *s, const fmi3ValueReference vr[], size_t nvr, const void *value, size_t count, char kind,
                  const char *type, const char *function)
{
  size_t wanted = 0;
  if (!glue_given(s, vr, "valueReferences", function) || !glue_given(s, value, "values", function) ||
      !glue_known(s, vr, nvr, kind, type, function, &wanted))
    return 0;
  return glue_counted(s, count, wanted, function);
}

/* A call about no variable: nothing to do, if it has no values either. */
static fmi3Status none(const instance *s, size_t count, const char *function)
{
  return glue_counted(s, count, 0, function) ? fmi3OK : fmi3Error;
}

/* Checks of all values come first: a call that is refused sets none. */
#define GET(Type, kind, from_number)                                                                                       \
  fmi3Status fmi3Get##Type(fmi3Instance c, const fmi3ValueReference vr[], size_t nvr, fmi3##Type value[], size_t count)    \
  {                                                                                                                        \
    static const char function[] = "fmi3Get" #Type;                                                                       \
    ON_INSTANCE(c);                                                                                                       \
    if (!s) return fmi3Error;                                                                                             \
    if (nvr == 0) return none(s, count, function);                                                                        \
    if (!listed(s, vr, nvr, value, count, kind, #Type, function) || !glue_readable(s, function)) return fmi3Error;        \
    for (size_t i = 0, at = 0; i < nvr; i++)                                                                              \
      for (int32_t k = 0; k < glue_elements(s, vr[i]); k++, at++) {                                                       \
        const double number = glue_get(s, glue_variable(s, vr[i]), k);                                                    \
        value[at] = (from_number);                                                                                        \
      }                                                                                                                   \
    return fmi3OK;                                                                                                        \
  }
/* Arrays are outputs: what can be set has one value. */
#define SET(Type, kind)                                                                                                   \
  fmi3Status fmi3Set##Type(fmi3Instance c, const fmi3ValueReference vr[], size_t nvr, const fmi3##Type value[], size_t count) \
  {                                                                                                                        \
    static const char function[] = "fmi3Set" #Type;                                                                       \
    ON_INSTANCE(c);                                                                                                       \
    if (!s || !glue_allowed(s, GLUE_INSTANTIATED | GLUE_INITIALIZING | GLUE_STEPPING, function)) return fmi3Error;        \
    if (nvr == 0) return none(s, count, function);                                                                        \
    if (!listed(s, vr, nvr, value, count, kind, #Type, function)) return fmi3Error;                                       \
    for (size_t i = 0, at = 0; i < nvr; at += (size_t)glue_elements(s, vr[i]), i++)                                       \
      if (!glue_settable(s, glue_variable(s, vr[i]), (double)value[at], function)) return fmi3Error;                      \
    for (size_t i = 0; i < nvr; i++) glue_set(s, glue_variable(s, vr[i]), (double)value[i]);                              \
    glue_was_set(s);                                                                                                      \
    return fmi3OK;                                                                                                        \
  }
GET(Float64, 'r', number)
GET(Int32, 'i', (fmi3Int32)number)
GET(Boolean, 'b', number > 0.0)
SET(Float64, 'r')
SET(Int32, 'i')
SET(Boolean, 'b')

/* Types that no variable has. */
#define NO_TYPE(Type)                                                                                                     \
  fmi3Status fmi3Get##Type(fmi3Instance c, const fmi3ValueReference vr[], size_t nvr, fmi3##Type value[], size_t count)    \
  {                                                                                                                        \
    ON_CONST_INSTANCE(c);                                                                                                 \
    if (s && nvr == 0) return none(s, count, "fmi3Get" #Type);                                                            \
    if (s) (void)listed(s, vr, nvr, value, count, 0, #Type, "fmi3Get" #Type);                                             \
    return fmi3Error;                                                                                                     \
  }                                                                                                                        \
  fmi3Status fmi3Set##Type(fmi3Instance c, const fmi3ValueReference vr[], size_t nvr, const fmi3##Type value[], size_t count) \
  {                                                                                                                        \
    ON_CONST_INSTANCE(c);                                                                                                 \
    if (s && nvr == 0) return none(s, count, "fmi3Set" #Type);                                                            \
    if (s) (void)listed(s, vr, nvr, value, count, 0, #Type, "fmi3Set" #Type);                                             \
    return fmi3Error;                                                                                                     \
  }
NO_TYPE(Float32)
NO_TYPE(Int8)
NO_TYPE(UInt8)
NO_TYPE(Int16)
NO_TYPE(UInt16)
NO_TYPE(UInt32)
NO_TYPE(Int64)
NO_TYPE(UInt64)
NO_TYPE(String)

fmi3Status fmi3GetBinary(fmi3Instance c, const fmi3ValueReference vr[], size_t nvr, size_t sizes[], fmi3Binary value[], size_t count)
{
  ON_CONST_INSTANCE(c);
  if (s && nvr == 0) return none(s, count, "fmi3GetBinary");
  if (s) (void)listed(s, vr, nvr, value, count, 0, "Binary", "fmi3GetBinary");
  return fmi3Error;
}

fmi3Status fmi3SetBinary(fmi3Instance c, const fmi3ValueReference vr[], size_t nvr, const size_t sizes[], const fmi3Binary value[],
                         size_t count)
{
  ON_CONST_INSTANCE(c);
  if (s && nvr == 0) return none(s, count, "fmi3SetBinary");
  if (s) (void)listed(s, vr, nvr, value, count, 0, "Binary", "fmi3SetBinary");
  return fmi3Error;
}

fmi3Status fmi3GetClock(fmi3Instance c, const fmi3ValueReference vr[], size_t nvr, fmi3Clock value[])
{
  ON_CONST_INSTANCE(c);
  if (s && nvr == 0) return fmi3OK;
  if (s) (void)listed(s, vr, nvr, value, nvr, 0, "Clock", "fmi3GetClock");
  return fmi3Error;
}

fmi3Status fmi3SetClock(fmi3Instance c, const fmi3ValueReference vr[], size_t nvr, const fmi3Clock value[])
{
  ON_CONST_INSTANCE(c);
  if (s && nvr == 0) return fmi3OK;
  if (s) (void)listed(s, vr, nvr, value, nvr, 0, "Clock", "fmi3SetClock");
  return fmi3Error;
}

/* ------------------------------------------------------------------------------------------- steps */

/* What nobody wants to know may be NULL. */
fmi3Status fmi3DoStep(fmi3Instance c, fmi3Float64 time, fmi3Float64 step, fmi3Boolean no_earlier_state, fmi3Boolean *event,
                      fmi3Boolean *terminate, fmi3Boolean *early, fmi3Float64 *last)
{
  ON_INSTANCE(c);
  if (!s) return fmi3Error;
  const glue_status status = glue_step(s, "fmi3DoStep", time, step);
  if (event) *event = fmi3False;
  if (terminate) *terminate = fmi3False;
  if (early) *early = fmi3False;
  if (last) *last = glue_time(s);
  return (fmi3Status)status;
}

/* ------------------------------------------------------------------------------------------- state */

fmi3Status fmi3GetFMUState(fmi3Instance c, fmi3FMUState *state)
{
  ON_CONST_INSTANCE(c);
  return DONE(glue_save(s, "fmi3GetFMUState", state));
}

fmi3Status fmi3SetFMUState(fmi3Instance c, fmi3FMUState state)
{
  ON_INSTANCE(c);
  return DONE(glue_restore(s, "fmi3SetFMUState", state));
}

fmi3Status fmi3FreeFMUState(fmi3Instance c, fmi3FMUState *state)
{
  ON_CONST_INSTANCE(c);
  return DONE(glue_drop(s, "fmi3FreeFMUState", state));
}

fmi3Status fmi3SerializedFMUStateSize(fmi3Instance c, fmi3FMUState state, size_t *size)
{
  ON_CONST_INSTANCE(c);
  return DONE(glue_state_size(s, "fmi3SerializedFMUStateSize", state, size));
}

fmi3Status fmi3SerializeFMUState(fmi3Instance c, fmi3FMUState state, fmi3Byte bytes[], size_t size)
{
  ON_CONST_INSTANCE(c);
  return DONE(glue_serialize(s, "fmi3SerializeFMUState", state, bytes, size));
}

fmi3Status fmi3DeserializeFMUState(fmi3Instance c, const fmi3Byte bytes[], size_t size, fmi3FMUState *state)
{
  ON_CONST_INSTANCE(c);
  return DONE(glue_deserialize(s, "fmi3DeserializeFMUState", bytes, size, state));
}

/* ------------------------------------------------------------------- what there is not, and is refused */

#define REFUSED(name, why) return DONE(glue_refuse(s, name, why))
static const char no_events[] = "there is no event mode (hasEventMode is false)";
static const char no_clocks[] = "there are no clocks";
static const char no_exchange[] = "only co-simulation is supported";

fmi3Status fmi3GetOutputDerivatives(fmi3Instance c, const fmi3ValueReference vr[], size_t nvr, const fmi3Int32 order[], fmi3Float64 value[],
                                    size_t count)
{
  ON_CONST_INSTANCE(c);
  if (s && nvr == 0) return none(s, count, "fmi3GetOutputDerivatives");
  REFUSED("fmi3GetOutputDerivatives", "outputs have no derivatives (maxOutputDerivativeOrder is 0)");
}

fmi3Status fmi3GetDirectionalDerivative(fmi3Instance c, const fmi3ValueReference unknown[], size_t unknowns,
                                        const fmi3ValueReference known[], size_t knowns, const fmi3Float64 seed[], size_t seeds,
                                        fmi3Float64 sensitivity[], size_t sensitivities)
{
  ON_CONST_INSTANCE(c);
  REFUSED("fmi3GetDirectionalDerivative", "not provided (providesDirectionalDerivatives is false)");
}

fmi3Status fmi3GetAdjointDerivative(fmi3Instance c, const fmi3ValueReference unknown[], size_t unknowns, const fmi3ValueReference known[],
                                    size_t knowns, const fmi3Float64 seed[], size_t seeds, fmi3Float64 sensitivity[], size_t sensitivities)
{
  ON_CONST_INSTANCE(c);
  REFUSED("fmi3GetAdjointDerivative", "not provided (providesAdjointDerivatives is false)");
}

fmi3Status fmi3GetNumberOfVariableDependencies(fmi3Instance c, fmi3ValueReference vr, size_t *count)
{
  ON_CONST_INSTANCE(c);
  REFUSED("fmi3GetNumberOfVariableDependencies", "not provided (providesPerElementDependencies is false)");
}

fmi3Status fmi3GetVariableDependencies(fmi3Instance c, fmi3ValueReference dependent, size_t elements[], fmi3ValueReference independents[],
                                       size_t of[], fmi3DependencyKind kinds[], size_t count)
{
  ON_CONST_INSTANCE(c);
  REFUSED("fmi3GetVariableDependencies", "not provided (providesPerElementDependencies is false)");
}

/* Functions of an instance alone. */
#define NO_MODE(name, why) \
  fmi3Status name(fmi3Instance c) { ON_CONST_INSTANCE(c); REFUSED(#name, why); }
NO_MODE(fmi3EnterConfigurationMode, "there are no structural parameters")
NO_MODE(fmi3ExitConfigurationMode, "there are no structural parameters")
NO_MODE(fmi3EnterEventMode, no_events)
NO_MODE(fmi3EnterStepMode, no_events)
NO_MODE(fmi3EvaluateDiscreteStates, no_events)
NO_MODE(fmi3EnterContinuousTimeMode, no_exchange)

fmi3Status fmi3UpdateDiscreteStates(fmi3Instance c, fmi3Boolean *again, fmi3Boolean *terminate, fmi3Boolean *nominals, fmi3Boolean *values,
                                    fmi3Boolean *has_next, fmi3Float64 *next)
{
  ON_CONST_INSTANCE(c);
  REFUSED("fmi3UpdateDiscreteStates", no_events);
}

/* Functions of clocks: about none of them there is nothing to do. */
#define NO_CLOCK(name, ...)                                                              \
  fmi3Status name(fmi3Instance c, const fmi3ValueReference vr[], size_t nvr, __VA_ARGS__) \
  {                                                                                      \
    ON_CONST_INSTANCE(c);                                                                \
    if (s && nvr == 0) return fmi3OK;                                                    \
    REFUSED(#name, no_clocks);                                                           \
  }
NO_CLOCK(fmi3GetIntervalDecimal, fmi3Float64 interval[], fmi3IntervalQualifier qualifier[])
NO_CLOCK(fmi3GetShiftFraction, fmi3UInt64 counter[], fmi3UInt64 resolution[])
NO_CLOCK(fmi3SetIntervalFraction, const fmi3UInt64 counter[], const fmi3UInt64 resolution[])
NO_CLOCK(fmi3SetShiftFraction, const fmi3UInt64 counter[], const fmi3UInt64 resolution[])
NO_CLOCK(fmi3GetShiftDecimal, fmi3Float64 shift[])
NO_CLOCK(fmi3SetIntervalDecimal, const fmi3Float64 interval[])
NO_CLOCK(fmi3SetShiftDecimal, const fmi3Float64 shift[])
NO_CLOCK(fmi3GetIntervalFraction, fmi3UInt64 counter[], fmi3UInt64 resolution[], fmi3IntervalQualifier qualifier[])

fmi3Status fmi3ActivateModelPartition(fmi3Instance c, fmi3ValueReference clock, fmi3Float64 time)
{
  ON_CONST_INSTANCE(c);
  REFUSED("fmi3ActivateModelPartition", no_exchange);
}

/* Model exchange. Some importers load these names without asking what the FMU is. */
fmi3Status fmi3CompletedIntegratorStep(fmi3Instance c, fmi3Boolean no_earlier_state, fmi3Boolean *event, fmi3Boolean *terminate)
{
  ON_CONST_INSTANCE(c);
  REFUSED("fmi3CompletedIntegratorStep", no_exchange);
}

fmi3Status fmi3SetTime(fmi3Instance c, fmi3Float64 time)
{
  ON_CONST_INSTANCE(c);
  REFUSED("fmi3SetTime", no_exchange);
}

fmi3Status fmi3SetContinuousStates(fmi3Instance c, const fmi3Float64 values[], size_t count)
{
  ON_CONST_INSTANCE(c);
  REFUSED("fmi3SetContinuousStates", no_exchange);
}

#define NO_NUMBERS(name)                                                 \
  fmi3Status name(fmi3Instance c, fmi3Float64 values[], size_t count)    \
  {                                                                      \
    ON_CONST_INSTANCE(c);                                                \
    REFUSED(#name, no_exchange);                                         \
  }
NO_NUMBERS(fmi3GetContinuousStateDerivatives)
NO_NUMBERS(fmi3GetEventIndicators)
NO_NUMBERS(fmi3GetContinuousStates)
NO_NUMBERS(fmi3GetNominalsOfContinuousStates)

#define NO_NUMBER(name)                                                  \
  fmi3Status name(fmi3Instance c, size_t *count)                         \
  {                                                                      \
    ON_CONST_INSTANCE(c);                                                \
    REFUSED(#name, no_exchange);                                         \
  }
NO_NUMBER(fmi3GetNumberOfEventIndicators)
NO_NUMBER(fmi3GetNumberOfContinuousStates)
