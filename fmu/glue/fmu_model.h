/* fmu/glue/fmu_model.h - interface of a model to the code that is independent of the
 * model: glue.c, fmi2.c and fmi3.c, and the generator of its description, describe.c.
 *
 * A model is a folder with two files. model.h defines the type `model`, which holds all
 * variables and the whole state. It has no pointers, so that a copy of it is a saved
 * state. model.c defines the functions and tables declared here. */
#ifndef FMU_MODEL_H
#define FMU_MODEL_H

#include <stddef.h>
#include <stdint.h>

#include "model.h"
#include "tse/convert.h"

#define FMU_NO_RATE (-1)

/* A variable. Its value reference is its index in fmu_variables. */
typedef struct fmu_variable {
  const char *name; /* structured and unique: vehicle.mass */
  char kind;        /* 'r' Real: tse_setting if a parameter, else tse_real; 'i' Integer,
                     * 'b' Boolean, 'e' Enumeration: int32_t */
  char role;        /* 'p' parameter, 'i' input, 'o' output, 't' time */
  int32_t offset;   /* [bytes] offset in `model` */
  int32_t rate;     /* [bytes] offset in `model` of the time derivative, which interpolates
                     * a Real input; FMU_NO_RATE: no derivative */
  double start;     /* start value of a parameter or input */
  double lo, hi;    /* range; hi < lo: no range. A parameter outside it is refused, unless it
                     * has its start value. model_step() checks the inputs. */
  const char *unit; /* as in the tables of include/tse; "" without unit; type of an Enumeration */
  const char *text; /* description */
} fmu_variable;

/* Make a parameter of a setting (src/tables/settings.h) in `config` of the model. */
#define PARAMETER(fmu, name, def, exact, lo, hi, unit, text) \
  { fmu, 'r', 'p', (int32_t)offsetof(model, config.name), FMU_NO_RATE, def, lo, hi, unit, text },
#define WHOLE_PARAMETER(fmu, name, def, exact, lo, hi, unit, text) \
  { fmu, 'i', 'p', (int32_t)offsetof(model, config.name), FMU_NO_RATE, def, lo, hi, "", text },

extern const fmu_variable fmu_variables[];
extern const int32_t fmu_variable_count;
extern const fmu_variable fmu_time; /* defined in fmu_model.c */

/* For FMI 3.0: neighbouring outputs as an array, in addition to the scalar variables.
 * Value references: fmu_variables, then fmu_arrays, then fmu_time. An array has one unit,
 * so only the relative stiffness is one. The absolute one has N and N/rad. */
typedef struct fmu_array {
  fmu_variable of; /* first element; name, unit and description of the array; no range, no rate */
  int32_t count;   /* number of elements */
} fmu_array;
extern const fmu_array fmu_arrays[];
extern const int32_t fmu_array_count;

/* For FMI 3.0: a terminal, a group of variables to connect by one line. Its members are
 * the Real variables of this role with the name `prefix` + member name. Importers connect
 * members of the same name, between terminals of the same kind. */
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

/* List the codes of all enumeration types, type by type: call `row` for each code. */
typedef void fmu_code_row(void *to, const char *type, int32_t code, const char *name, const char *text);
void model_list_codes(fmu_code_row *row, void *to);

typedef enum fmu_result {
  FMU_OK,
  FMU_WARNING,
  FMU_ERROR,
} fmu_result;

/* Log categories: name and description in modelDescription.xml. Errors and warnings are
 * on, events off, until the importer changes that. */
#define FMU_LOG_CATEGORIES(X)                                                         \
  X("logStatusError", "a call was refused, and why; nothing has changed")             \
  X("logStatusWarning",                                                               \
    "the step was done, but an input is missing or out of range; said once while it lasts") \
  X("logEvents", "instantiated, initialized, terminated")

#define FMU_TEXT 256 /* bytes of a message */

/* Return the name of the parameter of a setting, for messages: "mass" -> "vehicle.mass",
 * "body_roll_gain" -> "effects.body_roll.gain". Return `setting` if no parameter
 * matches. */
const char *fmu_find_name(const char *setting);

/* Write the range of a variable, for messages: "50 .. 50000 kg".   Returned: text */
#define FMU_RANGE 80
const char *fmu_write_range(const fmu_variable *v, char text[FMU_RANGE]);

/* Initialise members that fmu_variables does not list. The start values are set after it.
 *   Given:  m  all bytes 0 */
void model_init(model *m);

/* Note that the importer has set a parameter, for models that distinguish parameters that
 * were set. The value is already in m. */
void model_note_set(model *m, const fmu_variable *v, double value);

/* Check the parameters, set the state to time `start` and compute all outputs from
 * parameters and inputs. May be called again with other parameters before the first step.
 *   Returned:  text  variable and reason, if FMU_ERROR */
fmu_result model_start(model *m, double start, char text[FMU_TEXT]);

/* Run a step from `time` to `time + step` [s], with the inputs at `time`.
 *   Updated:   m     unchanged, bit for bit, if FMU_ERROR
 *   Returned:  text  reason, unless FMU_OK */
fmu_result model_step(model *m, double time, double step, char text[FMU_TEXT]);

/* Return 1 if the model can continue from a deserialized state, whose bytes may be
 * forged.
 *   Given:  m        its parameters are within their ranges
 *           started  0: model_start() will be called before any other function */
int model_check(const model *m, int started);

#endif
