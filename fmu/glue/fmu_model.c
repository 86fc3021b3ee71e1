/* fmu/glue/fmu_model.c - what models share. */
#include "fmu_model.h"

#include <stdio.h>
#include <string.h>

const char *fmu_name_of(const char *last_part)
{
  for (int32_t i = 0; i < fmu_variable_count; i++) {
    const char *const dot = strrchr(fmu_variables[i].name, '.');
    if (fmu_variables[i].role == 'p' && dot && strcmp(dot + 1, last_part) == 0) return fmu_variables[i].name;
  }
  return last_part;
}

const char *fmu_range(const fmu_variable *v, char text[FMU_RANGE])
{
  const char *const unit = strcmp(v->unit, "1") == 0 ? "" : v->unit; /* nobody says "0 to 2 ones" */
  (void)snprintf(text, FMU_RANGE, "%.10g .. %.10g%s%s", v->lo, v->hi, *unit ? " " : "", unit);
  return text;
}
