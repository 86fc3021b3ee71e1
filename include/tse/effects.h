/* tse/effects.h - the effects of tse/effects.def: their numbers, their constants, and what they remember from row to row.
 * Complete types, so that filter, simulator and replay can hold them; the members are the library's own business. */
#ifndef TSE_EFFECTS_H
#define TSE_EFFECTS_H

#include "tse/real.h"

/* Built without effects: a controller that wants the flash (CMake option TSE_EFFECTS). CONSTANT effects remain;
 * the others are refused by tse_config_check(). Then there is no simulator and no replay either. */
enum { /* TSE_EFFECT_<id>: bit of an effect in tse_effects.mask */
#define EFFECT(id, hook, title, entry, channels, alike, estimator) TSE_EFFECT_##id,
#include "tse/effects.def"
  TSE_EFFECTS
};

#define TSE_BIT_FORMULA 62  /* of the mask: a formula of the user, tse/formula.def */
#define TSE_FORMULA_NUMBERS 8
#define TSE_FORMULA_OPS 33
#define TSE_FORMULA_MEMORIES 3

/* Constants, made by tse_prepare(). mask: bit TSE_EFFECT_<id> set when a strength of that effect is not zero. */
typedef struct tse_effects {
  uint64_t mask;
#if !defined(TSE_NO_EFFECTS)
#define EFFECT_PARAMETER(id, parameter, role, unit, def, lo, hi, typical_lo, typical_hi, negligible, sign, text) tse_real id##_##parameter;
#include "tse/effects.def"
  tse_real mass;                        /* [kg]                                                */
  tse_real formula_gain, formula[TSE_FORMULA_NUMBERS];
  int32_t formula_place;
  uint8_t formula_code[TSE_FORMULA_OPS];
#endif
} tse_effects;

#define TSE_DELAY_ROWS 12 /* samples kept; they thin out when the delay is longer than 9 rows */

typedef struct tse_delay { /* when samples were taken, newest first */
  int32_t count;
  tse_real age[TSE_DELAY_ROWS]; /* [s] */
} tse_delay;

typedef struct tse_effect_memory {
  int32_t settled;                      /* 0: the next row starts everything at rest                       */
#if !defined(TSE_NO_EFFECTS)
  tse_real lag[4];                      /* slip angle front, rear [rad], slip front, rear: what tyres hold */
  tse_real mode[3][2];                  /* body roll, pitch, roll steer: lagged acceleration and its rate  */
  tse_real time, heading;               /* [s], [turns] since the start                                    */
  int32_t steered;                      /* 0: the next angle is the first                                  */
  tse_real steered_by[3];               /* [rad] of the last row, before, between and after the lags       */
  tse_delay steer, imu;
  tse_real steer_was[1][TSE_DELAY_ROWS], imu_was[3][TSE_DELAY_ROWS];
  tse_real formula[TSE_FORMULA_MEMORIES][3], formula_accel[2]; /* of a formula: its own; accel_x, accel_y [m/s2] at this time */
  tse_delay formula_late;
  tse_real formula_was[1][TSE_DELAY_ROWS];
#endif
} tse_effect_memory;

#endif
