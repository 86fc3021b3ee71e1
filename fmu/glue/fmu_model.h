/* fmu/glue/fmu_model.h - what a model tells the generic glue (glue.c; fmi2.c and fmi3.c,
 * the functions of FMI 2.0 and 3.0) and the generator of its description (describe.c),
 * none of which knows anything of tyres.
 *
 * A model is a folder with model.h, which defines the complete type `model`, and model.c
 * with the functions and the table below. `model` holds all variables and all state and
 * no pointer: a copy of it is a snapshot. */
#ifndef FMU_MODEL_H
#define FMU_MODEL_H

#include <stddef.h>
#include <stdint.h>

#include "model.h"
#include "tse/convert.h"

#define FMU_NO_RATE (-1)

/* One variable. Its value reference is its place in the table. */
typedef struct fmu_variable {
  const char *name; /* structured, unique: vehicle.mass */
  char kind;        /* 'r' Real (tse_setting if a parameter, else tse_real), 'i' Integer, 'b' Boolean, 'e'
             * Enumeration (int32_t) */
  char role;        /* 'p' parameter, 'i' input, 'o' output; 't' time, which the glue has */
  int32_t offset;   /* of its place in `model` [bytes] */
  int32_t rate; /* of the place for its time derivative, which interpolates a Real input; FMU_NO_RATE: none */
  double start; /* parameters and inputs */
  double lo, hi;    /* range; hi < lo where there is none. A parameter that is neither within nor its start is
           * refused; an input is the model's to judge */
  const char *unit; /* as in the tables of include/tse; "" for what has none; of an Enumeration its type */
  const char *text;
} fmu_variable;

/* Of a list of settings (src/tables/settings.h), which stand in `config` of the model:
 * its parameters. */
#define PARAMETER(fmu, name, def, exact, lo, hi, unit, text) { fmu, 'r', 'p', (int32_t)offsetof(model, config.name), FMU_NO_RATE, def, lo, hi, unit, text },
#define WHOLE_PARAMETER(fmu, name, def, exact, lo, hi, unit, text) { fmu, 'i', 'p', (int32_t)offsetof(model, config.name), FMU_NO_RATE, def, lo, hi, "", text },

extern const fmu_variable fmu_variables[];
extern const int32_t fmu_variable_count;
extern const fmu_variable fmu_time; /* which the glue has */

/* For FMI 3.0: outputs that lie one behind the other, as one variable beside those that
 * name each of them. Their value references follow those of fmu_variables, and the time
 * follows them. One unit for all: stiffness itself, in N and N/rad, is no array. */
typedef struct fmu_array {
  fmu_variable of; /* the first, and what is said of all; no range, no rate */
  int32_t count;
} fmu_array;
extern const fmu_array fmu_arrays[];
extern const int32_t fmu_array_count;

/* For FMI 3.0: what is connected by one line. Its members are the Real variables of this
 * role whose names are `prefix` and one more part, which is the member's name: of two
 * terminals with the same kind, members of the same name belong together. */
typedef struct fmu_terminal {
  const char *name, *kind;
  char role; /* 'i' or 'o' */
  const char *prefix, *text;
} fmu_terminal;
extern const fmu_terminal fmu_terminals[];
extern const int32_t fmu_terminal_count;

/* What modelDescription.xml says of the whole. */
typedef struct fmu_info {
  const char *identifier; /* FMI modelIdentifier: name of the binary and of the .fmu          */
  const char *title, *description;
  double stop_time, step_size, tolerance; /* DefaultExperiment [s], [s], [1] */
} fmu_info;
extern const fmu_info fmu_about;

/* The codes of enumeration types, one type after the other: called once per code. */
typedef void fmu_code_row(void *to, const char *type, int32_t code, const char *name, const char *text);
void model_codes(fmu_code_row *row, void *to);

typedef enum fmu_result {
  FMU_OK,
  FMU_WARNING,
  FMU_ERROR,
} fmu_result;

/* Names that importers know, and what each is for. Errors and warnings are logged unless
 * switched off, events when asked for. */
#define FMU_LOG_CATEGORIES(X)                                                        \
  X("logStatusError", "a call was refused, and why; nothing has changed")            \
  X("logStatusWarning", "the step was done, but an input is missing or out of range; said once while it lasts") \
  X("logEvents", "instantiated, initialized, terminated")

#define FMU_TEXT 256

/* For messages: the parameter of a setting ("mass": "vehicle.mass", "body_roll_gain":
 * "effects.body_roll.gain"); `setting` itself if there is none. */
const char *fmu_name_of(const char *setting);

/* For messages: "50 .. 50000 kg". */
#define FMU_RANGE 80
const char *fmu_range(const fmu_variable *v, char text[FMU_RANGE]);

/* Defaults of what the table does not list. The variables' start values follow. `m` is
 * zero before. */
void model_init(model *m);

/* The importer has set parameter v to this value, which is in its place already. For
 * models that tell what was set from what was left. */
void model_was_set(model *m, const fmu_variable *v, double value);

/* Check parameters, set the state to time `start` and compute all outputs from parameters
 * and inputs. May be called again, with other parameters, before the first step.
 *   Returned:  text  why not, when FMU_ERROR: names the variable */
fmu_result model_start(model *m, double start, char text[FMU_TEXT]);

/* From the communication point `time` to `time + step`, with the inputs as they are at
 * `time`.
 *   Updated:   m     unchanged, bit for bit, when FMU_ERROR
 *   Returned:  text  what is wrong, when not FMU_OK */
fmu_result model_step(model *m, double time, double step, char text[FMU_TEXT]);

/* Is this model, of which nobody knows who wrote its bytes, one to go on with? Its
 * parameters are inside their ranges.
 *   Given:     started  0: model_start() comes before anything else is done with it */
int model_sound(const model *m, int started);

#endif
