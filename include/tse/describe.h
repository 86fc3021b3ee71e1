/* tse/describe.h - functions that return tables with the names, units, ranges and
 * meanings of all struct members and codes of the library at run time, for bindings such
 * as Python and the FMUs. The linker leaves the tables out of a program that does not
 * call these functions. */
#ifndef TSE_DESCRIBE_H
#define TSE_DESCRIBE_H

#include "tse/tse.h"

#define tse_describe       TSE_NAME(tse_describe)
#define tse_describe_build TSE_NAME(tse_describe_build)
#define tse_describe_effects           TSE_NAME(tse_describe_effects)
#define tse_describe_effect_parameters TSE_NAME(tse_describe_effect_parameters)
#define tse_describe_settings          TSE_NAME(tse_describe_settings)

#ifdef __cplusplus
extern "C" {
#endif

/* Tables that tse_describe() can return. A table describes the members of a struct, or
 * the codes of a list such as the status codes. Each of its rows is a tse_field. In the
 * row of a code, `offset` is the numerical value of the code, `name` its name and `text`
 * its meaning. A build without effects (TSE_NO_EFFECTS) has no tables for the structs of
 * the simulator and of the replay. */
typedef enum tse_struct {
  TSE_STRUCT_CONFIG,
  TSE_STRUCT_INPUT,
  TSE_STRUCT_OUTPUT,
  TSE_STRUCT_SIM_CONFIG,    /* settings of the simulator */
  TSE_STRUCT_SIM_INPUT,     /* inputs of the simulator */
  TSE_STRUCT_SIM_OUTPUT,    /* outputs of the simulator */
  TSE_STRUCT_STATUS,        /* list of status codes */
  TSE_STRUCT_REASON,        /* list of reason codes */
  TSE_STRUCT_REPLAY_LOG,    /* log for a replay */
  TSE_STRUCT_REPLAY_START,  /* constants and initial state of a replay */
  TSE_STRUCT_REPLAY_OUT,    /* results of a replay */
  TSE_STRUCT_FORMULA_PLACE, /* list of the quantities of the model to which the value of the user's
                             * formula can be added (src/tables/formula.toml) */
  TSE_STRUCT_FORMULA_OP,    /* list of the operations of a formula. tse_field.def: number of operands.
                             * tse_field.kind: 'n' is one of the settings formula_a, formula_b ..., 's' a
                             * signal of the model, 'p' a function of its operands, 'm' a function that
                             * also depends on earlier values of its operands */
  TSE_STRUCT_FORMULA_LIMIT, /* list of the limits of a formula, such as the max number of its operations.
                             * tse_field.offset: value of the limit */
  TSE_STRUCTS
} tse_struct;

/* One member of a struct, or one code of a list. */
typedef struct tse_field {
  const char *name;
  char kind;          /* type of a member of a struct: 's' tse_setting, 'r' tse_real, 'i' int32_t,
                       * 'u' uint32_t, 'p' pointer to an array of tse_real, 'o' the same or NULL.
                       * Code of a list: 'c', but TSE_STRUCT_FORMULA_OP (above) has letters of its own */
  int32_t offset;     /* bytes from the start of the struct to the member; for a code: its value */
  double def, lo, hi; /* default, min, max; hi < lo if there is no range */
  const char *unit;
  const char *text;
} tse_field;

/* Return the table `which`: the members of a struct, or the codes of a list.
 *   Returned:  pointer to the first of *count rows; NULL if this build has no such table
 *              *size  bytes of the struct; 0 for a list */
const tse_field *tse_describe(tse_struct which, int32_t *count, int32_t *size);

/* One effect: a property of cars that the single-track model leaves out, such as a
 * steering delay (src/tables/effects.toml).
 *   hook         point in the evaluation of the model at which the function of the effect
 *                is called: CONSTANT, INPUT ... SENSOR. src/tables/effects.toml explains
 *                these names
 *   title        name of the effect
 *   entry_point  part of the car whose model the effect changes, such as "front axle"
 *   channels     channels in which the effect is visible
 *   look_alikes  other effects, or settings, whose influence on the channels is similar
 *   estimator    which filters use the settings of the effect, and how */
typedef struct tse_effect_row {
  const char *id, *hook, *title, *entry_point, *channels, *look_alikes, *estimator;
  int32_t bit;            /* number of its bit in tse_effects.mask */
  const char *filter;     /* filters whose estimates depend on the effect: "both" (the default filter and the
                           * paper's filter), "default" or "none" */
  const char *occurrence; /* which cars or logs have the effect: SENSOR, EVERY_CAR, SOME_CARS ... The
                           * head of src/tables/effects.toml defines these words */
  /* title that replaces `title` if the strength of the effect is below early_below. Such
   * a value has its cause in the log or in the IMU, not in the car. Example: if the
   * estimated steering delay is negative, the steering angle was logged late. "": `title`
   * is never replaced */
  const char *early;
  double early_below;
} tse_effect_row;

/* How one setting of tse_config is used.
 *   table        its table in src/tables: vehicle, uncertainty, sensors, latency,
 *                velocity, pedals, road, effects, formula or filter
 *   filter       filters whose estimates depend on it: "both", "default", "paper"
 *                or "none"
 *   replaced_by  name of a second setting. If the second setting is not 0, the filter
 *                uses it and ignores this one. "": no setting replaces this one */
typedef struct tse_setting_row {
  const char *name, *table, *filter, *replaced_by;
} tse_setting_row;

/* One parameter of an effect.
 *   effect     id of the effect
 *   parameter  name of the parameter within the effect
 *   setting    name of the parameter in tse_config: the id, "_" and the name */
typedef struct tse_effect_parameter {
  const char *effect, *parameter, *setting, *unit, *text;
  int32_t strength;              /* 1: a strength; the value 0 switches the effect off. 0: a shape parameter;
                                  * it has no influence while all strengths are 0. -1: a shape parameter
                                  * that is never fitted, because logs do not show its influence separately
                                  * from the influence of the strength */
  int32_t sign;                  /* plausible sign of a strength: 1, -1, or 0 for either sign */
  double def, lo, hi;            /* def: value for a simulated car (tse_config_exact()), 0 for most
                                  * strengths; lo, hi: min, max */
  double typical_lo, typical_hi; /* range of the magnitude of the parameter in mid-size cars */
  double negligible;             /* difference from `def` below which a strength is negligible. `tselab gap`
                                  * does not report an effect if all its strengths are negligible. 0 for a
                                  * shape parameter */
} tse_effect_parameter;

/* Return the effects of src/tables/effects.toml: pointer to the first of *count rows.
 *   count NULL: the number of rows is not returned */
const tse_effect_row *tse_describe_effects(int32_t *count);
/* Return the parameters of all effects: pointer to the first of *count rows. With count
 * NULL, the number of rows is not returned. */
const tse_effect_parameter *tse_describe_effect_parameters(int32_t *count);

/* Return how each setting is used, in the order of tse_describe(TSE_STRUCT_CONFIG):
 * pointer to the first of *count rows.
 *   count NULL: the number of rows is not returned */
const tse_setting_row *tse_describe_settings(int32_t *count);

/* Properties of this build of the library. Later versions append new members at the end.
 * A host that sets the struct to 0 before the call can therefore load an older library:
 * the members that the older library does not know stay 0. */
typedef struct tse_build {
  const char *version, *format;                                /* version; number format */
  int32_t capacity;                                            /* max number of particles */
  int32_t filter_bytes, params_bytes, sim_bytes, learnt_bytes; /* sizes of the structs */
  int32_t filter_paper_bytes;
  int32_t fraction_bits; /* fraction bits of a fixed-point number; 0 in other formats */
} tse_build;

/* Fill b with the properties of this build.   b NULL: no effect. */
void tse_describe_build(tse_build *b);

#ifdef __cplusplus
}
#endif
#endif
