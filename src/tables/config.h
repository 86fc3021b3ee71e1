/* tables/config.h - one row for each setting: its default, its range, and the effect to
 * which it belongs. An effect is a property of a car that the single-track model leaves
 * out (effects.toml). Checking the ranges by a loop over a table needs 4 kB less flash
 * than code that compares each setting with its range. settings.c defines the arrays.
 * Internal to the sources. */
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

/* The effect to which a setting belongs (TSE_EFFECT_...), and whether the setting is a
 * strength of this effect (1) or a shape parameter, for example a frequency (0). An
 * effect is off while all its strengths are 0. */
typedef struct effect_row {
  uint8_t effect, strength;
} effect_row;

/* Rows of the settings of type tse_setting, and of those of type int32_t, in the order of
 * the members of tse_config. */
extern const real_row setting_reals[REALS];
extern const whole_row setting_wholes[WHOLES];
/* Effect of each setting: row i is for setting_reals[FIRST_EFFECTS + i]. */
extern const effect_row setting_effects[COUNT_EFFECTS];

#endif
