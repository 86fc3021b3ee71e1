/* fmu/glue/fmu_model.c - variable names and ranges as text, for all FMUs. */
#include "fmu_model.h"

#include <stdio.h>
#include <string.h>

const fmu_variable fmu_time = { "time", 'r', 't', 0, FMU_NO_RATE, 0.0, 1.0, -1.0, "s", "simulation time" };

/* Return 1 if a variable holds a setting: if the part of the variable's name after the
 * first dot is the name of the setting. Names of variables have dots where settings have
 * underscores, so a dot in this part matches an underscore. Example: the variable
 * "effects.body_roll.gain" holds the setting "body_roll_gain". */
static int is_setting(const char *name, const char *setting)
{
  const char *at = strchr(name, '.');
  if (!at) return 0;
  for (at++; *at && (*at == *setting || (*at == '.' && *setting == '_')); at++) setting++;
  return !*at && !*setting;
}

const char *fmu_find_name(const char *setting)
{
  for (int32_t i = 0; i < fmu_variable_count; i++)
    if (fmu_variables[i].role == 'p' && is_setting(fmu_variables[i].name, setting))
      return fmu_variables[i].name;
  return setting;
}

const char *fmu_write_range(const fmu_variable *v, char text[FMU_RANGE])
{
  const char *const unit = strcmp(v->unit, "1") == 0 ? "" : v->unit; /* the unit 1 is not written */
  (void)snprintf(text, FMU_RANGE, "%.10g .. %.10g%s%s", v->lo, v->hi, *unit ? " " : "", unit);
  return text;
}
