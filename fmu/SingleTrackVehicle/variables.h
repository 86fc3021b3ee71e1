/* fmu/SingleTrackVehicle/variables.h - every variable of the FMU, in the order of its value references. Part of model.c. */
#include "tables/columns.h"
#include "tables/settings.h"

#define DRIVES(name, def, lo, hi, unit, text) \
  { #name, 'r', 'i', (int32_t)offsetof(model, u.name), (int32_t)offsetof(model, rate.name), def, lo, hi, unit, text },
#define LOGGED(name, drives, lo, hi, unit, text) OUTPUT("sensor." #name, 'r', y.row.name, unit, text ", as logged")
#define NUMBER(group, name, member, unit, text) OUTPUT(#group "." #name, 'r', y.member, unit, text)
#define STIFFNESS(group, name, member, si, unit, text) OUTPUT(#group "." #name, 'r', si, unit, text)
#define SHARE(group, name, member, si, unit, text) OUTPUT(#group ".relative." #name, 'r', y.member, "1", text ", relative to nominal")
#define SIM_PARAMETER(fmu, name, def, lo, hi, unit, text) \
  { fmu, 'r', 'p', (int32_t)offsetof(model, sim_config.name), FMU_NO_RATE, def, lo, hi, unit, text },
#define WHOLE_SIM_PARAMETER(fmu, name, def, lo, hi, unit, text) \
  { fmu, 'i', 'p', (int32_t)offsetof(model, sim_config.name), FMU_NO_RATE, def, lo, hi, "", text },

const fmu_variable fmu_variables[] = {
  DRIVER(DRIVES)
  { "ramp", 'b', 'p', (int32_t)offsetof(model, ramp), FMU_NO_RATE, 1.0, 1.0, -1.0, "",
    "true: during a step inputs change linearly from where they were, as a driver's do; false: at its start they jump to what was set" },

  SETTINGS_VEHICLE(PARAMETER, WHOLE_PARAMETER) SETTINGS_SENSORS(PARAMETER, WHOLE_PARAMETER)
  SETTINGS_EFFECTS(PARAMETER, WHOLE_PARAMETER) SETTINGS_FORMULA(PARAMETER, WHOLE_PARAMETER)
  SETTINGS_SIM(SIM_PARAMETER, WHOLE_SIM_PARAMETER)
  CHANNELS(LOGGED)
  TRUTHS(NUMBER, STIFFNESS)
  TRUTHS(NO_COLUMN, SHARE)
};
const int32_t fmu_variable_count = (int32_t)(sizeof fmu_variables / sizeof fmu_variables[0]);

