/* fmu/SingleTrackVehicle/variables.h - every variable of the FMU, in the order of its value references. Part of model.c. */
#define PARAMETER(group, kind, member, name, def, lo, hi, unit, text) \
  { group "." #name, kind, 'p', (int32_t)offsetof(model, member.name), FMU_NO_RATE, def, lo, hi, unit, text },

const fmu_variable fmu_variables[] = {
#define SIM_INPUT(name, def, lo, hi, unit, text) \
  { #name, 'r', 'i', (int32_t)offsetof(model, u.name), (int32_t)offsetof(model, rate.name), def, lo, hi, unit, text },
#include "tse/sim_input.def"
#undef SIM_INPUT
  { "ramp", 'b', 'p', (int32_t)offsetof(model, ramp), FMU_NO_RATE, 1.0, 1.0, -1.0, "",
    "true: during a step inputs change linearly from where they were, as a driver's do; false: at its start they jump to what was set" },

#define REAL(name, def, lo, hi, unit, text) PARAMETER("vehicle", 'r', config, name, def, lo, hi, unit, text)
#define INT(name, def, lo, hi, text) PARAMETER("vehicle", 'i', config, name, def, lo, hi, "", text)
#include "tse/vehicle.def"
#undef REAL
#undef INT
#define REAL(name, def, lo, hi, unit, text) PARAMETER("sensors", 'r', config, name, def, lo, hi, unit, text)
#define INT(name, def, lo, hi, text) PARAMETER("sensors", 'i', config, name, def, lo, hi, "", text)
#include "tse/sensors.def"
#undef REAL
#undef INT
#define EFFECT_PARAMETER(id, parameter, role, unit, def, lo, hi, typical_lo, typical_hi, negligible, sign, text) \
  { "effects." #id "." #parameter, 'r', 'p', (int32_t)offsetof(model, config.id##_##parameter), FMU_NO_RATE, def, lo, hi, unit, text },
#include "tse/effects.def"
#define REAL(name, def, lo, hi, unit, text) PARAMETER("effects", 'r', config, name, def, lo, hi, unit, text)
#define INT(name, def, lo, hi, text) PARAMETER("effects", 'i', config, name, def, lo, hi, "", text)
#include "tse/formula.def"
#undef REAL
#undef INT
#define REAL(name, def, lo, hi, unit, text) PARAMETER("simulation", 'r', sim_config, name, def, lo, hi, unit, text)
#define INT(name, def, lo, hi, text) PARAMETER("simulation", 'i', sim_config, name, def, lo, hi, "", text)
#include "tse/sim.def"
#undef REAL
#undef INT

#define INPUT(name, lo, hi, unit, kind, text) OUTPUT("sensor." #name, 'r', y.row.name, unit, text ", as logged")
#include "tse/input.def"
#undef INPUT
#define SIM_OUTPUT(group, name, member, unit, text) OUTPUT(#group "." #name, 'r', y.member, unit, text)
#define SIM_STIFFNESS(group, name, member, si, unit, text) OUTPUT(#group "." #name, 'r', si, unit, text)
#include "tse/sim_output.def"
#undef SIM_OUTPUT
#define SIM_OUTPUT(group, name, member, unit, text)
#define SIM_STIFFNESS(group, name, member, si, unit, text) \
  OUTPUT(#group ".relative." #name, 'r', y.member, "1", text ", relative to nominal")
#include "tse/sim_output.def"
#undef SIM_OUTPUT
};
const int32_t fmu_variable_count = (int32_t)(sizeof fmu_variables / sizeof fmu_variables[0]);

