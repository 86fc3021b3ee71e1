/* tse/describe.h - functions that return the names, units, ranges and meanings of
 * all struct members and codes of the library at run time, for bindings such as
 * Python and the FMUs. The linker leaves these tables out of a program that does not
 * call the functions. */
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

/* Tables of tse_describe(). In a build without effects, tse_describe() returns NULL for
 * the structs of simulator and replay. A row of a list of codes has the numerical value
 * of the code in `offset`, and its name and meaning in `name` and `text`. */
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
  TSE_STRUCT_FORMULA_PLACE, /* list of the places where a formula may act (src/tables/formula.toml) */
  TSE_STRUCT_FORMULA_OP,    /* list of the operations of a formula. `def`: number of operands. `kind`:
                             * 'n' number, 's' signal, 'p' plain function, 'm' function with memory */
  TSE_STRUCT_FORMULA_LIMIT, /* list of the limits of a formula. `offset`: the limit */
  TSE_STRUCTS
} tse_struct;

/* One member of a struct, or one code of a list. */
typedef struct tse_field {
  const char *name;
  char kind;          /* type: 's' tse_setting, 'r' tse_real, 'i' int32_t, 'u' uint32_t, 'c' code, 'p' array,
                       * 'o' array or NULL */
  int32_t offset;     /* bytes from the start of the struct */
  double def, lo, hi; /* default, min, max; hi < lo if there is no range */
  const char *unit;
  const char *text;
} tse_field;

/* Return the members of a struct, or the codes of a list.
 *   Returned:  pointer to the first of *count rows; NULL if there is no such struct
 *              *size  bytes of the struct; 0 for a list */
const tse_field *tse_describe(tse_struct which, int32_t *count, int32_t *size);

/* One effect of src/tables/effects.toml.
 *   hook         step of the computation in which the model applies the effect: CONSTANT,
 *                INPUT ... SENSOR (src/model/effects.h)
 *   title        name of the effect
 *   entry_point  part of the model that the effect changes
 *   channels     channels in which the effect is visible
 *   look_alikes  effects whose influence on the channels is similar
 *   estimator    how the filters use the effect */
typedef struct tse_effect_row {
  const char *id, *hook, *title, *entry_point, *channels, *look_alikes, *estimator;
  int32_t bit;            /* number of its bit in tse_effects.mask */
  const char *filter;     /* filters whose estimates depend on it: "both", "default" or "none" */
  const char *occurrence; /* column `occurrence` of src/tables/effects.toml: SENSOR, EVERY_CAR ... */
  /* title that replaces `title` if the strength of the effect is below early_below.
   * Example: a negative steering delay is a latency of the log, and a very short steering
   * lag is a low pass of the IMU. "": `title` is never replaced */
  const char *early;
  double early_below;
} tse_effect_row;

/* How one setting of tse_config is used.
 *   table        its table in src/tables: vehicle, uncertainty, sensors, latency,
 *                velocity, pedals, road, effects, formula or filter
 *   filter       filters whose estimates depend on it: "both", "default", "paper"
 *                or "none"
 *   replaced_by  name of a different setting. If that setting is not 0, the filter uses it
 *                instead of this one. "": there is no such setting */
typedef struct tse_setting_row {
  const char *name, *table, *filter, *replaced_by;
} tse_setting_row;

/* One parameter of an effect. The member `setting` is its name in tse_config. */
typedef struct tse_effect_parameter {
  const char *effect, *parameter, *setting, *unit, *text;
  int32_t strength;              /* 1: a strength; the value 0 switches the effect off. 0: a shape; it has no
                                  * influence while all strengths are 0. -1: a shape, too, but one that
                                  * cannot be estimated from logs together with the strength */
  int32_t sign;                  /* plausible sign of a strength: 1, -1, or 0 for either sign */
  double def, lo, hi;            /* value in tse_config_exact() (0 for most strengths), min, max */
  double typical_lo, typical_hi; /* range of the magnitude of the parameter in mid-size cars */
  double negligible;             /* a strength of smaller magnitude is not reported; 0 for shapes */
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

/* Properties of this build of the library. New members are appended at the end, so that a
 * host can read the struct of an older library. */
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
