/* fmu/glue/fmu_model.h - interface between a model and the code that all models share:
 * glue.c, fmi2.c, fmi3.c, and describe.c, which prints the description of a model.
 *
 * A model is a folder with two files. model.h defines the type `model`, which holds all
 * variables and the whole state. This type contains no pointers, so that a copy of it is
 * a saved state. model.c defines the functions and tables declared here. */
#ifndef FMU_MODEL_H
#define FMU_MODEL_H

#include <stddef.h>
#include <stdint.h>

#include "model.h"
#include "tse/convert.h"

#define FMU_NO_RATE (-1) /* fmu_variable.rate of a variable without a time derivative */

/* A variable of the FMU. Its value reference is its index in fmu_variables. */
typedef struct fmu_variable {
  const char *name; /* unique name, with dots between its parts. Example: vehicle.mass */
  char kind;        /* FMI type. 'r': Real, 'i': Integer, 'b': Boolean, 'e': Enumeration.
                     * C type in `model`: tse_setting for a Real parameter, tse_real for a
                     * Real input or output, int32_t for all others */
  char role;        /* 'p': parameter, 'i': input, 'o': output, 't': time */
  int32_t offset;   /* [bytes] offset in `model` */
  int32_t rate;     /* [bytes] offset in `model` of the time derivative that extrapolates
                     * an input during a step. FMU_NO_RATE: no time derivative */
  double start;     /* start value of a parameter or input */
  double lo, hi;    /* range; there is no range if hi < lo. A parameter outside its range is
                     * refused, unless it is equal to `start`: a start value may lie
                     * outside the range, as 0 for "not set". An input may be set to any
                     * value: its range is checked in the next step, by model_step() */
  const char *unit; /* Real: unit as in the tables of include/tse. Enumeration: name of its
                     * type. Otherwise "" */
  const char *text; /* description */
} fmu_variable;

/* Make the element of fmu_variables for a setting: PARAMETER for a real setting,
 * WHOLE_PARAMETER for an integer. The tables in src/tables/settings.h call these macros.
 * `fmu` is the name in the FMU; the value is the member `name` of model.config. */
#define PARAMETER(fmu, name, def, exact, lo, hi, unit, text) \
  { fmu, 'r', 'p', (int32_t)offsetof(model, config.name), FMU_NO_RATE, def, lo, hi, unit, text },
#define WHOLE_PARAMETER(fmu, name, def, exact, lo, hi, unit, text) \
  { fmu, 'i', 'p', (int32_t)offsetof(model, config.name), FMU_NO_RATE, def, lo, hi, "", text },

extern const fmu_variable fmu_variables[];
extern const int32_t fmu_variable_count;
extern const fmu_variable fmu_time; /* defined in fmu_model.c */

/* An array of outputs. FMI 3.0 has arrays in addition to the scalar variables; FMI 2.0
 * has no arrays. The value references of the arrays follow those of fmu_variables, and
 * the value reference of fmu_time is the last. All elements of an array have the same
 * unit. Relative stiffnesses are therefore an array, and stiffnesses in N and N/rad are
 * not. */
typedef struct fmu_array {
  fmu_variable of; /* `offset` is that of the first element; name, unit and description are
                    * those of the array; it has no range and no rate */
  int32_t count;   /* number of elements */
} fmu_array;
extern const fmu_array fmu_arrays[];
extern const int32_t fmu_array_count;

/* A terminal of FMI 3.0: a group of variables that the user connects in one action. The
 * members of the group are the Real inputs (`role` 'i') or Real outputs (`role` 'o')
 * whose name is `prefix` followed by a member name without a dot. Example: with the
 * prefix "road.", the input "road.bank" is the member "bank". An importer can connect two
 * terminals that have the same `kind`: it connects the members with the same name. */
typedef struct fmu_terminal {
  const char *name, *kind;
  char role; /* 'i' or 'o' */
  const char *prefix, *text;
} fmu_terminal;
extern const fmu_terminal fmu_terminals[];
extern const int32_t fmu_terminal_count;

/* Attributes of the model for modelDescription.xml. */
typedef struct fmu_info {
  const char *identifier; /* modelIdentifier: name of the binary and of the .fmu */
  const char *title, *description;
  double stop_time, step_size, tolerance; /* DefaultExperiment [s], [s], [1] */
} fmu_info;
extern const fmu_info fmu_about;

/* Call row(to, ...) once for each code of each enumeration type, type by type. */
typedef void fmu_code_row(void *to, const char *type, int32_t code, const char *name, const char *text);
void model_list_codes(fmu_code_row *row, void *to);

typedef enum fmu_result {
  FMU_OK,
  FMU_WARNING,
  FMU_ERROR,
} fmu_result;

/* Log categories: name and description for modelDescription.xml. A new instance logs
 * errors and warnings. It logs events only if the importer has switched logging on in the
 * call that instantiates it. The importer can later switch each category on or off. */
#define FMU_LOG_CATEGORIES(X)                                                         \
  X("logStatusError", "a call was refused and changed nothing; the text is the reason") \
  X("logStatusWarning",                                                               \
    "the step was done, but an input is missing or out of range; logged once while it lasts") \
  X("logEvents", "instantiated, initialized, terminated")

#define FMU_TEXT 256 /* [bytes] max size of a message */

/* Return the name of the parameter that holds a setting, for messages. Examples: "mass"
 * -> "vehicle.mass", "body_roll_gain" -> "effects.body_roll.gain". Return `setting` if
 * there is no such parameter. */
const char *fmu_find_name(const char *setting);

/* Write the range of a variable for messages. Example: "50 .. 50000 kg".
 *   Returned:  text  the range; `text` is also the result of the function */
#define FMU_RANGE 80 /* [bytes] max size of a range */
const char *fmu_write_range(const fmu_variable *v, char text[FMU_RANGE]);

/* Initialise the members of m that are not variables of the FMU. The caller then sets the
 * start values of the variables.
 *   Given:  m  all bytes are 0 */
void model_init(model *m);

/* Record that the importer has set a parameter. The caller has already written the value
 * into m. Models that do not distinguish set and unset parameters do nothing here. */
void model_note_set(model *m, const fmu_variable *v, double value);

/* Check the parameters, set the state at time `start` [s], and compute all outputs from
 * parameters and inputs. Until the first step, it may be called again with different
 * parameters.
 *   Returned:  text  variable and reason, if the result is FMU_ERROR */
fmu_result model_start(model *m, double start, char text[FMU_TEXT]);

/* Run a step from `time` to `time + step` [s], with the inputs at `time`.
 *   Updated:   m     not changed if the result is FMU_ERROR
 *   Returned:  text  reason, if the result is not FMU_OK */
fmu_result model_step(model *m, double time, double step, char text[FMU_TEXT]);

/* Return 1 if every value of a deserialized state is in the range that a run of the model
 * can produce, otherwise 0. The bytes of the state may come from an attacker.
 *   Given:  m        the state; its parameters are within their ranges
 *           started  1: model_start() has initialised the filter or the simulator with
 *                    these parameters, and its state is checked. 0: its state is not
 *                    checked, because model_start() initialises it before the next step */
int model_check(const model *m, int started);

#endif
