/* fmu/SingleTrackVehicle/model.c - the simulator of tse/simulate.h as a co-simulation
 * model. It takes the place of a real car. Its outputs are the readings of the sensors,
 * which are the inputs of the estimator, and the true values, with which the estimates
 * can be compared.
 *
 * A step simulates the car from t to t + h. The outputs at t + h are the row that the car
 * logs at t + h, and the true values at t + h.
 *
 * Before the step, the importer (the simulation tool) sets each input to a value u. It
 * may also set the time derivative d of the input; otherwise d is 0. During the step, the
 * input changes linearly to u + d h. If the parameter ramp is 1, the input starts from
 * its value at the end of the last step. If ramp is 0, it jumps to u at t, and starts
 * from u. With simulation.hold_inputs = 1, it keeps its start value until t + h. */
#include <stdio.h>
#include <string.h>

#include "fmu_model.h"
#include "tables/columns.h"
#include "tables/settings.h"

#define OUTPUT(name, kind, member, unit, text) \
  { name, kind, 'o', (int32_t)offsetof(model, member), FMU_NO_RATE, 0.0, 1.0, -1.0, unit, text },

/* Each of these macros expands to one entry of fmu_variables. The generated tables in
 * tables/columns.h and tables/settings.h call one macro for each of their rows. */
/* clang-format off */
#define DRIVES(name, def, lo, hi, unit, text) \
  { #name, 'r', 'i', (int32_t)offsetof(model, u.name), (int32_t)offsetof(model, rate.name), \
    def, lo, hi, unit, text },
#define LOGGED(name, drives, lo, hi, unit, text) \
  OUTPUT("sensor." #name, 'r', y.row.name, unit, text ", as logged")
#define NUMBER(group, name, member, unit, text) \
  OUTPUT(#group "." #name, 'r', y.member, unit, text)
#define STIFFNESS(group, name, member, si, unit, text) \
  OUTPUT(#group "." #name, 'r', si, unit, text)
#define SHARE(group, name, member, si, unit, text) \
  OUTPUT(#group ".relative." #name, 'r', y.member, "1", text ", relative to nominal")
#define EXACT(fmu, name, def, exact, lo, hi, unit, text) \
  PARAMETER(fmu, name, exact, exact, lo, hi, unit, text)
#define SIM_PARAMETER(fmu, name, def, exact, lo, hi, unit, text) \
  { fmu, 'r', 'p', (int32_t)offsetof(model, sim_config.name), FMU_NO_RATE, def, lo, hi, unit, text },
#define WHOLE_SIM_PARAMETER(fmu, name, def, exact, lo, hi, unit, text) \
  { fmu, 'i', 'p', (int32_t)offsetof(model, sim_config.name), FMU_NO_RATE, def, lo, hi, "", text },

/* All variables of the FMU, in the order of their value references. */
const fmu_variable fmu_variables[] = {
  DRIVER(DRIVES)
  { "ramp", 'b', 'p', (int32_t)offsetof(model, ramp), FMU_NO_RATE, 1.0, 1.0, -1.0, "",
    "true: inputs change linearly during a step; false: they jump at its start to the values set for it" },

  SETTINGS_VEHICLE(EXACT, WHOLE_PARAMETER) SETTINGS_SENSORS(EXACT, WHOLE_PARAMETER)
  SETTINGS_EFFECTS(EXACT, WHOLE_PARAMETER) SETTINGS_FORMULA(EXACT, WHOLE_PARAMETER)
  SETTINGS_SIM(SIM_PARAMETER, WHOLE_SIM_PARAMETER)
  CHANNELS(LOGGED)
  TRUTHS(NUMBER, STIFFNESS)
  TRUTHS(NO_COLUMN, SHARE)
};
const int32_t fmu_variable_count = (int32_t)(sizeof fmu_variables / sizeof fmu_variables[0]);
/* clang-format on */

#define ORDER "; order: longitudinal front, cornering front, cornering rear"
const fmu_array fmu_arrays[] = {
  { OUTPUT("true.relative.stiffness", 'r', y.stiffness, "1", "mean stiffness, relative to nominal" ORDER) 3 },
  { OUTPUT("drawn.relative.stiffness", 'r', y.drawn, "1",
      "true stiffness, drawn at random for this row, relative to nominal" ORDER) 3 },
};
const int32_t fmu_array_count = (int32_t)(sizeof fmu_arrays / sizeof fmu_arrays[0]);

const fmu_terminal fmu_terminals[] = {
  { "driver", "_tse_driver", 'i', "", "inputs of the driver, and the road" },
  { "sensors", "_tse_sensors", 'o', "sensor.", "sensors, as the car logs them" },
  { "truth", "_tse_truth", 'o', "true.", "true values of the estimates" },
};
const int32_t fmu_terminal_count = (int32_t)(sizeof fmu_terminals / sizeof fmu_terminals[0]);

const fmu_info fmu_about = {
  "SingleTrackVehicle",
  "Single-track vehicle with tyres of random stiffness",
  "A car to test an estimator on: single-track model with wheel dynamics, tyre stiffness redrawn at every "
  "sample, sensors with noise and drifting bias; all true values are outputs",
  10.0,
  0.01,
  1e-4,
};

void model_list_codes(fmu_code_row *row, void *to)
{
  (void)row;
  (void)to;
}

void model_init(model *m) { tse_config_exact(&m->config); }

void model_note_set(model *m, const fmu_variable *v, double value)
{
  (void)m;
  (void)v;
  (void)value;
}

/* Compute the true stiffnesses [N, N/rad] from those relative to nominal: the mean
 * stiffness and the stiffness drawn for this row. */
static void derive_outputs(model *m)
{
  tse_output relative;
  memset(&relative, 0, sizeof relative);
  memcpy(relative.stiffness, m->y.stiffness, sizeof relative.stiffness);
  tse_stiffness_si(&m->config, &relative, m->mean_si, NULL, NULL);
  memcpy(relative.stiffness, m->y.drawn, sizeof relative.stiffness);
  tse_stiffness_si(&m->config, &relative, m->drawn_si, NULL, NULL);
}

/* Return the address of an input in `u`. */
static double *find_input(tse_sim_input *u, const fmu_variable *v)
{
  return (double *)((char *)u + v->offset - offsetof(model, u));
}

/* Return the first input outside its range; NULL if all are in range. All inputs precede
 * the other variables in fmu_variables, so the loop ends at the first variable that is no
 * input. */
static const fmu_variable *find_wrong_input(tse_sim_input u)
{
  for (const fmu_variable *v = fmu_variables; v->role == 'i'; v++)
    if (!(*find_input(&u, v) >= v->lo && *find_input(&u, v) <= v->hi)) return v;
  return NULL;
}

static fmu_result refuse_input(const fmu_variable *v, char text[FMU_TEXT])
{
  char range[FMU_RANGE];
  (void)snprintf(text, FMU_TEXT, "%s is NaN or outside its range %s", v->name, fmu_write_range(v, range));
  return FMU_ERROR;
}

/* Write the message that the motion diverged. Return FMU_ERROR. */
static fmu_result refuse_motion(char text[FMU_TEXT])
{
  (void)snprintf(text, FMU_TEXT,
      "the simulated motion diverged: speed above 1000 m/s, yaw rate above 200 rad/s, or a sensor value of "
      "NaN; parameters and inputs belong to no real car");
  return FMU_ERROR;
}

fmu_result model_start(model *m, double start, char text[FMU_TEXT])
{
  const fmu_variable *const wrong_one = find_wrong_input(m->u);
  const char *wrong = NULL;
  (void)start;
  if (wrong_one) return refuse_input(wrong_one, text);
  tse_sim begun;
  const tse_status status = tse_sim_reset(&begun, &m->config, &m->sim_config, &wrong);
  if (status < 0) {
    (void)snprintf(text, FMU_TEXT, "%s: %s", fmu_find_name(wrong ? wrong : ""), tse_status_text(status));
    return FMU_ERROR;
  }
  if (tse_sim_step(&begun, &m->u, &m->y) < 0) return refuse_motion(text); /* row at the start time */
  memcpy(&m->sim, &begun, sizeof begun);
  derive_outputs(m);
  return FMU_OK;
}

fmu_result model_step(model *m, double time, double step, char text[FMU_TEXT])
{
  tse_sim_input from = m->u, to = m->u;
  const fmu_variable *wrong;
  (void)time;
  from.dt = to.dt = step;
  for (const fmu_variable *v = fmu_variables; v->role == 'i'; v++)
    *find_input(&to, v) += step * *(const double *)((const char *)m + v->rate);
  wrong = find_wrong_input(from);
  if (!wrong) wrong = find_wrong_input(to);
  if (wrong) return refuse_input(wrong, text);
  if (!(step <= 1.0)) {
    (void)snprintf(text, FMU_TEXT, "communicationStepSize = %.10g is longer than 1 s", step);
    return FMU_ERROR;
  }
  const tse_sim_input last = m->sim.last;
  if (!m->ramp) {
    /* tse_sim_step() changes the inputs linearly from sim.last to `to`. Replace sim.last
     * by the new inputs, so that the inputs jump at the start of the step. Keep
     * road_level and road_friction of sim.last: those of a row apply until the next row,
     * and the stiffness of this step was drawn with this road_level. */
    from.road_level = m->sim.last.road_level;
    from.road_friction = m->sim.last.road_friction;
    m->sim.last = from;
  }
  if (tse_sim_step(&m->sim, &to, &m->y) < 0) {
    m->sim.last = last;
    return refuse_motion(text);
  }
  derive_outputs(m);
  return FMU_OK;
}

int model_check(const model *m, int started)
{
  if (!started) return 1;
  /* the time derivatives of all inputs must be finite: x - x is 0 only for a finite x */
  const double *const rate = &m->rate.dt, *const end = (const double *)(&m->rate + 1);
  for (const double *at = rate; at < end; at++)
    if (!(*at - *at == 0.0)) return 0;
  return tse_sim_check(&m->sim, &m->config, &m->sim_config) == TSE_OK;
}
