/* tse/describe.h - the tables of tse.h and simulate.h at run time, for bindings (Python,
 * FMU). The linker leaves them out of a program that does not call these functions. */
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

typedef enum tse_struct {
  TSE_STRUCT_CONFIG,
  TSE_STRUCT_INPUT,
  TSE_STRUCT_OUTPUT,
  TSE_STRUCT_SIM_CONFIG, /* of the simulator; like the replay's below NULL in builds without effects */
  TSE_STRUCT_SIM_INPUT,
  TSE_STRUCT_SIM_OUTPUT,
  TSE_STRUCT_STATUS, /* a list, as reasons, places and operations: name, text, code in `offset` */
  TSE_STRUCT_REASON,
  TSE_STRUCT_REPLAY_LOG,
  TSE_STRUCT_REPLAY_START,
  TSE_STRUCT_REPLAY_OUT,
  TSE_STRUCT_FORMULA_PLACE, /* src/tables/formula.toml */
  TSE_STRUCT_FORMULA_OP,    /* number of operands in `def`, kind as a letter n, s, p, m */
  TSE_STRUCT_FORMULA_LIMIT, /* limits of a formula; the limit in `offset` */
  TSE_STRUCTS
} tse_struct;

typedef struct tse_field {
  const char *name;
  char kind;          /* 's' tse_setting, 'r' tse_real, 'i' int32_t, 'u' uint32_t, 'c' code,
                         * 'p' array, 'o' array or NULL */
  int32_t offset;     /* bytes from the start of the struct */
  double def, lo, hi; /* default and range; hi < lo where there is no range */
  const char *unit;
  const char *text;
} tse_field;

/* Return the rows of one struct: the first row, *count rows, *size bytes of the struct.
 * NULL if there is no such struct. */
const tse_field *tse_describe(tse_struct which, int32_t *count, int32_t *size);

/* One effect of src/tables/effects.toml.
 *   hook       CONSTANT .. SENSOR
 *   estimator  how the filters use it */
typedef struct tse_effect_row {
  const char *id, *hook, *title, *entry_point, *channels, *look_alikes, *estimator;
  int32_t bit;            /* of tse_effects.mask */
  const char *filter;     /* "both", "default" or "none": the filters whose estimate it moves */
  const char *occurrence; /* SENSOR, EVERY_CAR, SOME_CARS, ROAD, ABSORBED, IN_MODEL: how often cars have it */
  const char *early;      /* title of a value below early_below (of messages or the IMU), or "" */
  double early_below;
} tse_effect_row;

/* The use of one setting of tse_config.
 *   table        of src/tables that it is from: vehicle, uncertainty, sensors, latency, velocity,
 *                pedals, road, effects, formula, filter
 *   filter       "both", "default", "paper" or "none": the filters whose estimate it moves
 *   replaced_by  the setting that the filter uses instead while that is not 0; "": there is none */
typedef struct tse_setting_row {
  const char *name, *table, *filter, *replaced_by;
} tse_setting_row;

/* One parameter of an effect.  setting: its name in tse_config. */
typedef struct tse_effect_parameter {
  const char *effect, *parameter, *setting, *unit, *text;
  int32_t strength;              /* 1: a strength, 0 is off. 0: a shape, unused while all strengths are 0.
                                  * -1: a shape that logs cannot distinguish from the strength */
  int32_t sign;                  /* plausible sign of a strength: 1, -1, or 0 for either */
  double def, lo, hi;            /* value of tse_config_exact() (strengths mostly 0), and bounds */
  double typical_lo, typical_hi; /* size in mid-size cars */
  double negligible;             /* smallest size worth naming; 0 for shapes */
} tse_effect_parameter;

/* Return the tables of src/tables/effects.toml: the first row, *count (if not NULL)
 * rows. */
const tse_effect_row *tse_describe_effects(int32_t *count);
const tse_effect_parameter *tse_describe_effect_parameters(int32_t *count);

/* Return the use of every setting, in the order of tse_describe(TSE_STRUCT_CONFIG): the first row,
 * *count (if not NULL) rows. */
const tse_setting_row *tse_describe_settings(int32_t *count);

/* The library as built: version, number format, max particles, sizes of its structs. */
typedef struct tse_build {
  const char *version, *format;
  int32_t capacity, filter_bytes, params_bytes, sim_bytes, learnt_bytes;
  int32_t filter_paper_bytes;
  int32_t fraction_bits; /* of a fixed-point number, else 0. Last, so that a host can read older
                          * libraries */
} tse_build;

/* Fill b. */
void tse_describe_build(tse_build *b);

#ifdef __cplusplus
}
#endif
#endif
