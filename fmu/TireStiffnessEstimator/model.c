/* fmu/TireStiffnessEstimator/model.c - the estimator as a co-simulation model.
 *
 * A step from t to t + h processes one sample: the values of the inputs at time t. The
 * outputs at t + h are the estimates after this sample. The dt of a sample is the time
 * since the previous sample. If the samples are the rows of a log, the outputs are equal,
 * bit for bit, to the estimates of tse_step() from the same rows. */
#include <stdio.h>
#include <string.h>

#include "fmu_model.h"
#include "tables/columns.h"
#include "tables/settings.h"
#include "tse/describe.h"

#define OUTPUT(name, kind, member, unit, text) \
  { name, kind, 'o', (int32_t)offsetof(model, member), FMU_NO_RATE, 0.0, 1.0, -1.0, unit, text },

/* Each of these macros expands to entries of fmu_variables. The generated tables in
 * tables/columns.h call one macro for each column. */
/* clang-format off */
#define CHANNEL(name, drives, lo, hi, unit, text) \
  INPUT(#name, name, lo, hi, unit, text "; NaN: missing")
#define VELOCITY(name, drives, lo, hi, unit, text) \
  INPUT("velocity." #name, name, lo, hi, unit, text USED_IF("velocity.given"))
#define PEDAL(name, drives, lo, hi, unit, text) \
  INPUT("pedals." #name, name, lo, hi, unit, text USED_IF("pedals.given"))
#define ROAD(name, drives, lo, hi, unit, text) \
  INPUT("road." #name, name, lo, hi, unit, text USED_IF("road.given"))
#define USED_IF(given) "; used if its bit in " given " is set"
#define INPUT(name, member, lo, hi, unit, text) \
  { name, 'r', 'i', (int32_t)offsetof(model, row.member), FMU_NO_RATE, 0.0, lo, hi, unit, text },
#define BITS(name, member, count, text) \
  { name, 'i', 'i', (int32_t)offsetof(model, member), FMU_NO_RATE, 0.0, 0.0, (1 << (count)) - 1, "", text },
#define ROADS_GIVEN (TSE_OPTIONALS - TSE_VELOCITIES - TSE_PEDALS)
#define NUMBER(name, member, unit, text) OUTPUT("estimate." #name, 'r', y.member, unit, text)
#define FLAG(name, member, text) OUTPUT("estimate." #name, 'b', y.member, "", text)
#define CODE(name, member, type, text) OUTPUT("estimate." #name, 'e', y.member, type, text)
#define STIFFNESS(name, member, si, unit, text) OUTPUT("estimate." #name, 'r', si, unit, text)
#define SHARE(name, member, si, unit, text) \
  OUTPUT("estimate.relative." #name, 'r', y.member, "1", text ", relative to nominal")
#define REASON(name, member, valid, what) \
  OUTPUT("estimate." #name "_valid", 'b', valid, "", what " may be used") \
  OUTPUT("estimate." #name "_reason", 'e', y.member, "Reason", REASONS)

/* All variables of the FMU, in the order of their value references. */
const fmu_variable fmu_variables[] = {
  CHANNELS(CHANNEL)
  BITS("missing", row.missing, TSE_CHANNELS,
    "missing channels, for importers that cannot send NaN: "
    "sum of 1 steer_angle, 2 wheel_speed_front, 4 wheel_speed_rear, 8 accel_x, 16 accel_y, 32 yaw_rate")
  BITS("velocity.given", row.given, TSE_VELOCITIES,
    "measured velocities: sum of 1 ins_vel_x, 2 ins_vel_y, 4 gnss_speed, 8 gnss_course; "
    "0: none, and no input velocity.* is used")
  VELOCITIES(VELOCITY)
  BITS("pedals.given", pedals_given, TSE_PEDALS,
    "known brake switch and wheel torques: sum of 1 brake, 2 wheel_torque_front, 4 wheel_torque_rear; "
    "0: none, and no input pedals.* is used")
  PEDALS(PEDAL)
  BITS("road.given", road_given, ROADS_GIVEN,
    "known angles of the road: sum of 1 bank, 2 grade; 0: none, and no input road.* is used")
  ROADS(ROAD)

  { "vehicle.exact", 'b', 'p', (int32_t)offsetof(model, exact), FMU_NO_RATE, 0.0, 1.0, -1.0, "",
    "false: an ordinary car, of which at least the mass must be set. true: a car that is known exactly; "
    "parameters that are not set are those of SingleTrackVehicle, and uncertainties are 0" },
  SETTINGS(PARAMETER, WHOLE_PARAMETER)

  OUTPUTS(NUMBER, FLAG, CODE, STIFFNESS, REASON)
  OUTPUT("estimate.nominal.cx_front", 'r', nominal[0], "N",
         "nominal longitudinal stiffness, front axle: estimate.cx_front / estimate.relative.cx_front")
  OUTPUT("estimate.nominal.cy_front", 'r', nominal[1], "N/rad",
         "nominal cornering stiffness, front axle: estimate.cy_front / estimate.relative.cy_front")
  OUTPUT("estimate.nominal.cy_rear", 'r', nominal[2], "N/rad",
         "nominal cornering stiffness, rear axle: estimate.cy_rear / estimate.relative.cy_rear")
  OUTPUT("estimate.valid", 'b', all_valid, "", "all three stiffnesses may be used")
  OUTPUTS(NO_COLUMN, NO_COLUMN, NO_COLUMN, SHARE, NO_COLUMN)
};
const int32_t fmu_variable_count = (int32_t)(sizeof fmu_variables / sizeof fmu_variables[0]);
/* clang-format on */

#define ORDER "; order: longitudinal front, cornering front, cornering rear"
#define ARRAY(name, kind, member, unit, text) \
  { OUTPUT(name, kind, member, unit, text) \
    (int32_t)(sizeof ((model *)0)->member / sizeof ((model *)0)->member[0]) }
const fmu_array fmu_arrays[] = {
  ARRAY("estimate.relative.stiffness", 'r', y.stiffness, "1", "mean stiffness, relative to nominal" ORDER),
  ARRAY("estimate.relative.stiffness_sd", 'r', y.stiffness_sd, "1",
      "sd of the mean stiffness, relative to nominal" ORDER),
  ARRAY("estimate.relative.stiffness_spread", 'r', y.stiffness_spread, "1",
      "spread of the stiffness, as estimate.cx_front_spread, relative to nominal" ORDER),
  ARRAY("estimate.stiffness_valid", 'b', valid, "", "the stiffness may be used" ORDER),
  ARRAY("estimate.stiffness_reason", 'e', y.reason, "Reason",
      "0: the stiffness is valid; else why it may not be used, coded as estimate.cx_front_reason" ORDER),
  ARRAY("estimate.change_stiffness", 'r', y.change_ratio, "1",
      "ratio of the stiffness now to the stiffness before the last change" ORDER),
  ARRAY("estimate.probability", 'r', y.regime, "1",
      "probabilities in the order of estimate.p_steady to estimate.p_restarted"),
  ARRAY("estimate.relative.stiffness_secant", 'r', y.stiffness_secant, "1",
      "secant stiffness at the slip and load of the sample, relative to nominal" ORDER),
};
const int32_t fmu_array_count = (int32_t)(sizeof fmu_arrays / sizeof fmu_arrays[0]);

const fmu_terminal fmu_terminals[] = {
  { "sensors", "_tse_sensors", 'i', "", "sensors, as the car logs them" },
  { "velocity", "_tse_velocity", 'i', "velocity.", "measured velocity" },
  { "pedals", "_tse_pedals", 'i', "pedals.", "brake switch and wheel torques" },
  { "road", "_tse_road", 'i', "road.", "bank and grade of a known road" },
  { "estimate", "_tse_estimate", 'o', "estimate.",
      "stiffness, velocities, biases, and probabilities of changes and faults" },
};
const int32_t fmu_terminal_count = (int32_t)(sizeof fmu_terminals / sizeof fmu_terminals[0]);

#if defined(TSE_REAL_DOUBLE)
#define IN_FORMAT ""
#else
#define IN_FORMAT "; computes in " TSE_FORMAT_NAME ", with the same results as on a controller"
#endif

const fmu_info fmu_about = {
  "TireStiffnessEstimator",
  "Tyre stiffness estimator",
  "Estimates longitudinal and cornering stiffness of a car's tyres, their grip, sideslip angle and the "
  "sensors' biases, each with its standard deviation, from steering angle, wheel speeds, accelerometers and "
  "gyro, and the probability that the road changed, a channel is faulty or wheels slide: a Kalman filter of "
  "a single-track car, or the marginalized adaptive particle filter of Berntorp and Di Cairano" IN_FORMAT,
  10.0,
  0.01,
  1e-4,
};

/* Pass the codes of an enumeration of the library to the function `row`, which prints
 * one code. Leave out negative status codes: they mean that a step was refused. A refused
 * step sets no outputs, so an output never has these codes.
 *   Given:  to     first argument of `row`
 *           type   name of the enumeration type in the model description
 *           which  the enumeration, for tse_describe() */
static void list_described_codes(fmu_code_row *row, void *to, const char *type, tse_struct which)
{
  int32_t count;
  const tse_field *const code = tse_describe(which, &count, NULL);
  for (int32_t i = 0; i < count; i++)
    if (code[i].offset >= 0) row(to, type, code[i].offset, code[i].name, code[i].text);
}

void model_list_codes(fmu_code_row *row, void *to)
{
  static const char *const changes[][2] = {
    // clang-format off: table changes
    { "none", "none yet" },
    { "road", "all tyres: a different road surface" },
    { "front axle", "the tyres of the front axle" },
    { "rear axle", "the tyres of the rear axle" },
    { "started over", "the filter started over" },
    // clang-format on: end of table
  };
#define FAULT(name, drives, lo, hi, unit, text) { #name, text },
  static const char *const faults[][2] = { { "none", "no channel is likely at fault, none is implausible" },
    CHANNELS(FAULT) VELOCITIES(FAULT) };
  list_described_codes(row, to, "Status", TSE_STRUCT_STATUS);
  list_described_codes(row, to, "Reason", TSE_STRUCT_REASON);
  for (int32_t i = 0; i < (int32_t)(sizeof changes / sizeof changes[0]); i++)
    row(to, "ChangeKind", i, changes[i][0], changes[i][1]);
  for (int32_t i = 0; i < (int32_t)(sizeof faults / sizeof faults[0]); i++)
    row(to, "FaultChannel", i, faults[i][0], faults[i][1]);
}

void model_init(model *m) { tse_config_default(&m->config); }

/* Return the index of a parameter in model.set, the record of the parameters that the
 * importer has set. Return -1 if the variable is not a member of model.config. */
static int find_set_index(const fmu_variable *v)
{
  const int32_t at = v->offset - (int32_t)offsetof(model, config);
  return v->role == 'p' && at >= 0 && at < (int32_t)sizeof(tse_config) ? (int)(at / (int32_t)sizeof(int32_t))
                                                                       : -1;
}

void model_note_set(model *m, const fmu_variable *v, double value)
{
  if (find_set_index(v) >= 0)
    m->set[find_set_index(v)] = value < v->start || value > v->start ? SET_TO_ANOTHER : SET_TO_START;
}

/* Compute the settings with which the filter runs. If m->exact is 0, the settings are the
 * values of the parameters. If m->exact is 1, a parameter that the importer has set keeps
 * its value, and every other parameter gets its value from tse_config_exact(): the car of
 * the FMU SingleTrackVehicle, with uncertainties of 0.
 *
 * Some importers set every parameter: those that the user has not changed are set to
 * their start values. It is then not known which parameters the user has set. If every
 * parameter has been set, a parameter with its start value therefore counts as not set.
 *
 * Finally, mass, yaw inertia and stiffnesses of 0 ("not set") are replaced by the values
 * of an ordinary car. */
static void compute_settings(const model *m, tse_config *used)
{
  int min_set = SET_TO_ANOTHER;
  for (int i = 0; i < fmu_variable_count; i++)
    if (find_set_index(&fmu_variables[i]) >= 0 && m->set[find_set_index(&fmu_variables[i])] == NOT_SET)
      min_set = SET_TO_START;
  memcpy(used, &m->config, sizeof *used);
  if (m->exact) tse_config_exact(used);
  for (int i = 0; m->exact && i < fmu_variable_count; i++) {
    const fmu_variable *const v = &fmu_variables[i];
    const size_t at = (size_t)v->offset - offsetof(model, config);
    if (find_set_index(v) >= 0 && m->set[find_set_index(v)] >= min_set)
      memcpy((uint8_t *)used + at, (const uint8_t *)&m->config + at,
          v->kind == 'r' ? sizeof(tse_setting) : sizeof(int32_t));
  }
  tse_config_complete(used);
}

/* Compute the outputs in SI units, and the valid flags of the stiffnesses and of the
 * grip. */
static void derive_outputs(model *m)
{
  tse_output secant = m->y;
  memcpy(secant.stiffness, m->y.stiffness_secant, sizeof secant.stiffness);
  tse_stiffness_si(&m->used, &secant, m->secant, NULL, NULL);
  tse_stiffness_si(&m->used, &m->y, m->mean, m->sd, m->spread);
  m->all_valid = 1;
  for (int a = 0; a < 3; a++) {
    m->valid[a] = m->y.reason[a] == TSE_VALID;
    m->all_valid = m->all_valid && m->valid[a];
  }
  m->grip_valid = m->y.grip_reason == TSE_VALID;
}

/* Set the outputs to the prior estimates, for the time before the first row. These
 * outputs are computed by a step with a row without measurements. Afterwards the filter
 * is reset, so that this row has no effect on the first real row. */
static void report_prior(model *m)
{
  static const tse_input nothing = { .missing = (1u << TSE_CHANNELS) - 1u };
  memset(&m->y, 0, sizeof m->y);
  (void)tse_reset(&m->params, &m->memory.filter, sizeof m->memory);
  (void)tse_step(&m->params, &m->memory.filter, &nothing, &m->y);
  (void)tse_reset(&m->params, &m->memory.filter, sizeof m->memory);
  m->y.status = TSE_W_STARTING;
  m->y.grip_reason = TSE_STARTING;
  for (int a = 0; a < 3; a++) m->y.reason[a] = TSE_STARTING;
}

fmu_result model_start(model *m, double start, char text[FMU_TEXT])
{
  const char *wrong = "";
  tse_config used; /* copied to m->used if it is accepted, so that a refused call changes nothing */
  (void)start;     /* not needed: the filter uses differences of time only */
  compute_settings(m, &used);
  const tse_status status = tse_prepare(&used, &m->params, &wrong);
  if (status < 0) {
    (void)snprintf(text, FMU_TEXT, "%s: %s (a parameter of 0 follows from vehicle.mass, lf and lr)",
        fmu_find_name(wrong), tse_status_text(status));
    return FMU_ERROR;
  }
  memcpy(&m->used, &used, sizeof used);
  m->rows = 0;
  m->nominal[0] = m->used.longitudinal_stiffness_front;
  m->nominal[1] = m->used.cornering_stiffness_front;
  m->nominal[2] = m->used.cornering_stiffness_rear;
  report_prior(m);
  derive_outputs(m);
  return FMU_OK;
}

/* Return the inputs as a sample. Mark a channel as missing if it is NaN or out of range:
 * tse_step() would refuse a steering angle or wheel speed out of range, and a sensor
 * fault must not end a co-simulation.
 *   Returned:  first  first missing channel; NULL if there is none */
static tse_input make_sample(const model *m, const fmu_variable **first)
{
  tse_input u = m->row;
  u.missing &= (1u << TSE_CHANNELS) - 1u;
  u.given = (u.given & TSE_GIVEN_VELOCITIES) | (m->pedals_given << TSE_VELOCITIES & TSE_GIVEN_PEDALS)
      | (m->road_given << (TSE_VELOCITIES + TSE_PEDALS) & TSE_GIVEN_ROAD);
  *first = NULL;
  for (int k = 0; k < TSE_CHANNELS; k++) { /* the channels are the first variables of fmu_variables */
    const fmu_variable *const v = &fmu_variables[k];
    const size_t at = (size_t)v->offset - offsetof(model, row);
    tse_real x;
    memcpy(&x, (const uint8_t *)&u + at, sizeof x);
    if (!(tse_double_of(x) >= v->lo && tse_double_of(x) <= v->hi)) {
      x = TSE_R(0.0);
      memcpy((uint8_t *)&u + at, &x, sizeof x);
      u.missing |= 1u << k;
    }
    if (!*first && (u.missing & 1u << k)) *first = v;
  }
  return u;
}

fmu_result model_step(model *m, double time, double step, char text[FMU_TEXT])
{
  const fmu_variable *first;
  tse_input u = make_sample(m, &first);
  /* The length of this step will be the dt of the next sample. If tse_step() would refuse
   * the next sample because of this dt, refuse this step instead. */
  if (!(time + step - time <= TSE_LONGEST_DT)) {
    (void)snprintf(text, FMU_TEXT, "communicationStepSize = %.10g is longer than %d s", step, TSE_LONGEST_DT);
    return FMU_ERROR;
  }
  u.dt = tse_real_of(m->rows > 0 ? time - m->time : 0.0);
  const tse_status status = tse_step(&m->params, &m->memory.filter, &u, &m->y);
  if (status < 0) {
    (void)snprintf(text, FMU_TEXT, "%s (dt %.10g s since the last sample)", tse_status_text(status),
        tse_double_of(u.dt));
    return FMU_ERROR;
  }
  /* Clear the padding bytes after spread_seen, the last member of m->y. A saved state of
   * the FMU contains them, and equal states must have equal bytes. */
  memset(m->y.spread_seen + 3, 0, sizeof m->y - offsetof(tse_output, spread_seen) - sizeof m->y.spread_seen);
  m->rows = 1;
  m->time = time;
  derive_outputs(m);
  /* Warn if a channel is missing, or if `status`, the largest warning code of the step,
   * is TSE_W_PREDICTED or larger. TSE_W_WAITING is no reason to warn: it is normal if a
   * channel has a latency. The text names the missing channel, unless `status` is
   * TSE_W_GAP or larger, which is more important. glue_step() logs a text only when it
   * changes. The name of the channel is therefore logged once, whereas the text of
   * `status` could change in every step, for example from that of TSE_W_MISSING_CHANNEL
   * to that of TSE_W_HELD. */
  if (first || status == TSE_W_MISSING_CHANNEL || (status >= TSE_W_PREDICTED && status != TSE_W_WAITING)) {
    char range[FMU_RANGE];
    if (first && status < TSE_W_GAP)
      (void)snprintf(text, FMU_TEXT, "%s is missing or outside its range %s", first->name,
          fmu_write_range(first, range));
    else (void)snprintf(text, FMU_TEXT, "%s", tse_status_text(status));
    return FMU_WARNING;
  }
  return FMU_OK;
}

int model_check(const model *m, int started)
{
  tse_config used;
  tse_params anew;
  for (int i = 0; i < SETTINGS; i++)
    if (m->set[i] > SET_TO_ANOTHER) return 0;
  if (!started) return 1;
  compute_settings(m, &used);
  if (memcmp(&used, &m->used, sizeof used) != 0) return 0;
  if (tse_prepare(&used, &anew, NULL) < 0 || memcmp(&anew, &m->params, sizeof anew) != 0) return 0;
  if (!(m->rows == 0 || m->rows == 1) || !(m->time - m->time == 0.0)) return 0;
  return tse_filter_check(&anew, &m->memory.filter, sizeof m->memory) == TSE_OK;
}
