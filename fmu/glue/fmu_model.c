/* fmu/glue/fmu_model.c - what models share. */
#include "fmu_model.h"

#include <string.h>

const char *fmu_name_of(const char *last_part)
{
  for (int32_t i = 0; i < fmu_variable_count; i++) {
    const char *const dot = strrchr(fmu_variables[i].name, '.');
    if (fmu_variables[i].role == 'p' && dot && strcmp(dot + 1, last_part) == 0) return fmu_variables[i].name;
  }
  return last_part;
}
