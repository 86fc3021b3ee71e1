/* tables/config.h - rows of the settings: default and range of each, and the effect that it
 * belongs to. Tables, because written-out comparisons would take 4 kB more of a
 * microcontroller's flash. Defined once, in settings.c. Internal to the sources. */
#ifndef TABLES_CONFIG_H
#define TABLES_CONFIG_H

#include "tse/config.h"
#include "tables/effects.h"
#include "tables/names.h"
#include "tables/rows.h"
#include "tables/settings.h"

#define ADD_ONE(fmu, name, def, exact, lo, hi, unit, text) + 1
#define NUMBER_OF_REALS (0 SETTINGS(ADD_ONE, NO_ROW))
#define NUMBER_OF_WHOLES (0 SETTINGS(NO_ROW, ADD_ONE))
enum {
  REALS = NUMBER_OF_REALS,
  WHOLES = NUMBER_OF_WHOLES,
  // clang-format off: table config_groups
  FIRST_VEHICLE = 0, COUNT_VEHICLE = 11, FIRST_LATENCY = 38, COUNT_LATENCY = 5, FIRST_EFFECTS = 56,
  COUNT_EFFECTS = 57, FIRST_FORMULA = 113, COUNT_FORMULA = 9, FIRST_WHOLE_FORMULA = 0,
  COUNT_WHOLE_FORMULA = 12,
  // clang-format on: end of table
};

/* Effect of a setting from FIRST_EFFECTS on, and whether the setting is its strength. */
typedef struct effect_row {
  uint8_t effect, strength;
} effect_row;

extern const real_row setting_reals[REALS]; /* in the order of the members */
extern const whole_row setting_wholes[WHOLES];
extern const effect_row setting_effects[COUNT_EFFECTS];

#endif
