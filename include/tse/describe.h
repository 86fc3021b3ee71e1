/* tse/describe.h - the tables of tse.h and simulate.h at run time, for hosts that bind to them (Python, FMU).
 * An embedded program that does not call these functions does not carry them. */
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
  TSE_STRUCT_SIM_CONFIG, /* the simulator's, and the replay's below: absent (NULL) in builds without effects */
  TSE_STRUCT_SIM_INPUT,
  TSE_STRUCT_SIM_OUTPUT,
  TSE_STRUCT_STATUS, /* no struct, as reasons, places and operations: name, text, and the code in `offset` */
  TSE_STRUCT_REASON,
  TSE_STRUCT_REPLAY_LOG,
  TSE_STRUCT_REPLAY_START,
  TSE_STRUCT_REPLAY_OUT,
  TSE_STRUCT_FORMULA_PLACE, /* src/tables/formula.toml */
  TSE_STRUCT_FORMULA_OP,    /* how many operands it takes in `def`, its kind as a letter n, s, p, m */
  TSE_STRUCT_FORMULA_LIMIT, /* limits of a formula; the limit in `offset` */
  TSE_STRUCTS
} tse_struct;

typedef struct tse_field {
  const char *name;
  char kind;            /* 's' tse_setting, 'r' tse_real, 'i' int32_t, 'u' uint32_t, 'c' code, 'p' array, 'o' array or NULL */
  int32_t offset;       /* bytes from the start of the struct */
  double def, lo, hi;   /* default and range; hi < lo where there is no range */
  const char *unit;
  const char *text;
} tse_field;

/* The rows of one struct.   Returned: first row; *count rows; *size bytes of the struct.   NULL if there is no such struct. */
const tse_field *tse_describe(tse_struct which, int32_t *count, int32_t *size);

/* One effect of src/tables/effects.toml. hook: CONSTANT .. SENSOR; estimator: how the filters use it. */
typedef struct tse_effect_row {
  const char *id, *hook, *title, *entry_point, *channels, *look_alikes, *estimator;
  int32_t bit;            /* of tse_effects.mask */
  const char *filter;     /* "both", "default" or "none": the filters whose estimate it moves */
  const char *occurrence; /* SENSOR, EVERY_CAR, SOME_CARS, ROAD, ABSORBED, IN_MODEL: how often cars have it */
  const char *early;      /* title of a value below early_below, which is of messages or the IMU; "": there is none */
  double early_below;
} tse_effect_row;

/* The use of one setting of tse_config.
 *   table        of src/tables that it is from: vehicle, uncertainty, sensors, latency, velocity, pedals, road, effects,
 *                formula, filter
 *   filter       "both", "default", "paper" or "none": the filters whose estimate it moves
 *   replaced_by  the setting that the filter uses instead while that is not 0; "": there is none */
typedef struct tse_setting_row {
  const char *name, *table, *filter, *replaced_by;
} tse_setting_row;

/* One parameter of an effect. setting: its name in tse_config, which gives offset, default, range, unit and text. */
typedef struct tse_effect_parameter {
  const char *effect, *parameter, *setting, *unit, *text;
  int32_t strength;                /* 1: 0 switches off what it scales; 0: a shape, without meaning while all strengths are 0;
                                      -1: a shape that no log tells from the strength                                        */
  int32_t sign;                    /* plausible sign of a strength: 1, -1, or 0 for either                                   */
  double def, lo, hi;              /* off: as tse_config_exact() has it (of a strength mostly 0); and bounds                 */
  double typical_lo, typical_hi;   /* size in mid-size cars                                                                  */
  double negligible;               /* below it an effect should not be named; 0 for shapes                                   */
} tse_effect_parameter;

/* The tables of src/tables/effects.toml, in their order.   Returned: first row; *count (if not NULL) rows. */
const tse_effect_row *tse_describe_effects(int32_t *count);
const tse_effect_parameter *tse_describe_effect_parameters(int32_t *count);

/* The use of every setting, in the order of tse_describe(TSE_STRUCT_CONFIG).   Returned: first row; *count (if not NULL) rows. */
const tse_setting_row *tse_describe_settings(int32_t *count);

/* The library as built: version, format name, capacity, sizeof of tse_filter, tse_filter_paper, tse_params and tse_sim, bytes of
 * a learnt state. */
typedef struct tse_build {
  const char *version, *format;
  int32_t capacity, filter_bytes, params_bytes, sim_bytes, learnt_bytes;
  int32_t filter_paper_bytes;
  int32_t fraction_bits; /* of a fixed-point number, behind the point; 0 else. Last, so that a host reads older libraries, too */
} tse_build;
void tse_describe_build(tse_build *b);

#ifdef __cplusplus
}
#endif
#endif
