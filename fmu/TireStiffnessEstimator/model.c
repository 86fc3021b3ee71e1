/* fmu/TireStiffnessEstimator/model.c - the estimator as a co-simulation model.
 *
 * A step from t to t + h takes the inputs as the sample of time t, as a log row of that time; outputs at t + h are the estimate
 * after that sample. dt of a sample is the time since the sample before, so that a log that is replayed gives the same bits
 * as through tse_step(). */
#include <stdio.h>
#include <string.h>

#include "fmu_model.h"

#define LONGEST_STEP 3600.0 /* s: dt of tse_step() is no longer (tse/tse.h) */

#define PARAMETER(group, kind, name, def, lo, hi, unit, text) \
  { group "." #name, kind, 'p', (int32_t)offsetof(model, config.name), FMU_NO_RATE, def, lo, hi, unit, text },
#define OUTPUT(name, kind, member, unit, text) { name, kind, 'o', (int32_t)offsetof(model, member), FMU_NO_RATE, 0.0, 1.0, -1.0, unit, text },

/* grip_valid is a reason, as those of the stiffnesses: it becomes a Boolean and a code, which a plain number of that name would be
 * taken for. SECOND(INT_<name>, AS_NUMBER, _) is AS_NUMBER unless INT_<name> is a macro with a second part. */
#define INT_grip_valid _, AS_GRIP
#define SECOND_(a, b, ...) b
#define SECOND(...) SECOND_(__VA_ARGS__)
#define CALL(macro, ...) CALL_(macro, __VA_ARGS__)
#define CALL_(macro, ...) macro(__VA_ARGS__)
#define AS_NUMBER(name, member, text) OUTPUT("estimate." #name, 'i', y.member, "", text)
#define AS_GRIP(name, member, text) OUTPUT("estimate.grip_valid", 'b', grip_valid, "", "the grip may be used") \
  OUTPUT("estimate.grip_reason", 'i', y.member, "", REASONS)

/* "0 valid, 1 starting, ..." */
#define X(name, code, word, text) #code " " word ", "
#define REASONS TSE_REASON_TABLE(X) "see documentation"

const fmu_variable fmu_variables[] = {
#define INPUT(name, lo, hi, unit, kind, text) \
  { #name, 'r', 'i', (int32_t)offsetof(model, row.name), FMU_NO_RATE, 0.0, lo, hi, unit, text "; not a number: missing" },
#include "tse/input.def"
#undef INPUT
  { "missing", 'i', 'i', (int32_t)offsetof(model, row.missing), FMU_NO_RATE, 0.0, 0.0, (1 << TSE_CHANNELS) - 1, "",
    "channels that are missing, for importers that cannot send NaN: sum of 1 steer_angle, 2 wheel_speed_front, 4 wheel_speed_rear, "
    "8 accel_x, 16 accel_y, 32 yaw_rate" },
  { "velocity.given", 'i', 'i', (int32_t)offsetof(model, row.given), FMU_NO_RATE, 0.0, 0.0, (1 << TSE_VELOCITIES) - 1, "",
    "velocities that are measured; 0: none, then they are not read: sum of 1 ins_vel_x, 2 ins_vel_y, 4 gnss_speed, 8 gnss_course" },
#define VELOCITY(name, lo, hi, unit, text) \
  { "velocity." #name, 'r', 'i', (int32_t)offsetof(model, row.name), FMU_NO_RATE, 0.0, lo, hi, unit, text "; counts where its bit of given is set" },
#include "tse/optional.def"
  { "pedals.given", 'i', 'i', (int32_t)offsetof(model, pedals_given), FMU_NO_RATE, 0.0, 0.0, (1 << (TSE_OPTIONALS - TSE_VELOCITIES)) - 1, "",
    "what of the pedals is known; 0: nothing, then they are not read: sum of 1 brake, 2 wheel_torque_front, 4 wheel_torque_rear" },
#define PEDAL(name, lo, hi, unit, text) \
  { "pedals." #name, 'r', 'i', (int32_t)offsetof(model, row.name), FMU_NO_RATE, 0.0, lo, hi, unit, text "; counts where its bit of given is set" },
#include "tse/optional.def"

  { "vehicle.calibrated", 'b', 'p', (int32_t)offsetof(model, calibrated), FMU_NO_RATE, 0.0, 1.0, -1.0, "",
    "false: an ordinary car of its class, and what is set of it wins: stiffness and yaw inertia that are not set follow from mass, lf "
    "and lr, with the uncertainties of such a car; true: every parameter as it is, an uncertainty of 0 is none" },
#define REAL(name, def, lo, hi, unit, text) PARAMETER("vehicle", 'r', name, def, lo, hi, unit, text)
#define INT(name, def, lo, hi, text) PARAMETER("vehicle", 'i', name, def, lo, hi, "", text)
#include "tse/vehicle.def"
#undef REAL
#undef INT
#define REAL(name, def, lo, hi, unit, text) PARAMETER("uncertainty", 'r', name, def, lo, hi, unit, text)
#include "tse/uncertainty.def"
#undef REAL
#define REAL(name, def, lo, hi, unit, text) PARAMETER("sensors", 'r', name, def, lo, hi, unit, text)
#define INT(name, def, lo, hi, text) PARAMETER("sensors", 'i', name, def, lo, hi, "", text)
#include "tse/sensors.def"
#undef REAL
#undef INT
#define REAL(name, def, lo, hi, unit, text) PARAMETER("latency", 'r', name, def, lo, hi, unit, text)
#include "tse/latency.def"
#undef REAL
#define REAL(name, def, lo, hi, unit, text) PARAMETER("velocity", 'r', name, def, lo, hi, unit, text)
#include "tse/velocity.def"
#undef REAL
#define REAL(name, def, lo, hi, unit, text) PARAMETER("pedals", 'r', name, def, lo, hi, unit, text)
#include "tse/pedals.def"
#undef REAL
#define EFFECT_PARAMETER(id, parameter, role, unit, def, lo, hi, typical_lo, typical_hi, negligible, sign, text) \
  { "effects." #id "." #parameter, 'r', 'p', (int32_t)offsetof(model, config.id##_##parameter), FMU_NO_RATE, def, lo, hi, unit, text },
#include "tse/effects.def"
#define REAL(name, def, lo, hi, unit, text) PARAMETER("effects", 'r', name, def, lo, hi, unit, text)
#define INT(name, def, lo, hi, text) PARAMETER("effects", 'i', name, def, lo, hi, "", text)
#include "tse/formula.def"
#undef REAL
#undef INT
#define REAL(name, def, lo, hi, unit, text) PARAMETER("filter", 'r', name, def, lo, hi, unit, text)
#define INT(name, def, lo, hi, text) PARAMETER("filter", 'i', name, (def) < (hi) ? (def) : (hi), lo, hi, "", text)
#include "tse/filter.def"
#undef REAL
#undef INT

#define OUT_REAL(name, member, unit, text) OUTPUT("estimate." #name, 'r', y.member, unit, text)
#define OUT_INT(name, member, text) CALL(SECOND(INT_##name, AS_NUMBER, _), name, member, text)
#define OUT_STIFFNESS(name, member, si, unit, text) OUTPUT("estimate." #name, 'r', si, unit, text)
#define OUT_FLAG(name, member, text) OUTPUT("estimate." #name, 'b', y.member, "", text)
#define OUT_REASON(stiffness, member, text)                                                                        \
  OUTPUT("estimate." #stiffness "_valid", 'b', valid[(offsetof(tse_output, member) - offsetof(tse_output, reason)) / sizeof(int32_t)], "", \
         "the stiffness may be used")                                                                              \
  OUTPUT("estimate." #stiffness "_reason", 'i', y.member, "", REASONS)
#include "tse/output.def"
#undef OUT_REAL
#undef OUT_INT
  OUTPUT("estimate.nominal.cx_front", 'r', nominal[0], "N",
         "nominal longitudinal stiffness of the front axle, of which estimate.relative.cx_front is a share")
  OUTPUT("estimate.nominal.cy_front", 'r', nominal[1], "N/rad",
         "nominal cornering stiffness of the front axle, of which estimate.relative.cy_front is a share")
  OUTPUT("estimate.nominal.cy_rear", 'r', nominal[2], "N/rad",
         "nominal cornering stiffness of the rear axle, of which estimate.relative.cy_rear is a share")
  OUTPUT("estimate.valid", 'b', all_valid, "", "all three stiffnesses may be used")
#define OUT_REAL(name, member, unit, text)
#define OUT_INT(name, member, text)
#define OUT_STIFFNESS(name, member, si, unit, text) OUTPUT("estimate.relative." #name, 'r', y.member, "1", text ", relative to nominal")
#include "tse/output.def"
#undef OUT_REAL
#undef OUT_INT
};
#undef X
const int32_t fmu_variable_count = (int32_t)(sizeof fmu_variables / sizeof fmu_variables[0]);

#define ORDER "; order: longitudinal front, cornering front, cornering rear"
#define ARRAY(name, kind, member, unit, text) \
  { OUTPUT(name, kind, member, unit, text) (int32_t)(sizeof ((model *)0)->member / sizeof ((model *)0)->member[0]) },
const fmu_array fmu_arrays[] = {
  ARRAY("estimate.relative.stiffness", 'r', y.stiffness, "1", "mean stiffness, relative to nominal" ORDER)
  ARRAY("estimate.relative.stiffness_sd", 'r', y.stiffness_sd, "1", "sd of that mean" ORDER)
  ARRAY("estimate.relative.stiffness_spread", 'r', y.stiffness_spread, "1", "sample-to-sample sd" ORDER)
  ARRAY("estimate.stiffness_valid", 'b', valid, "", "the stiffness may be used" ORDER)
  ARRAY("estimate.stiffness_reason", 'i', y.reason, "", "0 valid, else why it may not be used: codes as those of estimate.cx_front_reason" ORDER)
  ARRAY("estimate.change_stiffness", 'r', y.change_ratio, "1", "stiffness now over that before the last change" ORDER)
  ARRAY("estimate.probability", 'r', y.regime, "1", "probabilities in the order of estimate.p_steady to estimate.p_restarted")
};
const int32_t fmu_array_count = (int32_t)(sizeof fmu_arrays / sizeof fmu_arrays[0]);

const fmu_terminal fmu_terminals[] = {
  { "sensors", "_tse_sensors", 'i', "", "what the car logs" },
  { "velocity", "_tse_velocity", 'i', "velocity.", "a velocity that is measured" },
  { "pedals", "_tse_pedals", 'i', "pedals.", "brake switch and wheel torques" },
  { "estimate", "_tse_estimate", 'o', "estimate.", "stiffness, velocities, biases, and what the filter thinks of the road and its sensors" },
};
const int32_t fmu_terminal_count = (int32_t)(sizeof fmu_terminals / sizeof fmu_terminals[0]);

#if defined(TSE_REAL_DOUBLE)
#define IN_FORMAT ""
#else
#define IN_FORMAT "; computes in " TSE_FORMAT_NAME ", as a controller with that build"
#endif

const fmu_info fmu_about = {
  "TireStiffnessEstimator", "Tyre stiffness estimator",
  "Estimates longitudinal and cornering stiffness of a car's tyres, their grip, sideslip angle and the sensors' biases, each with its "
  "standard deviation, from steering angle, wheel speeds, accelerometers and gyro, and the probability that the road changed, a channel "
  "is faulty or wheels slide: a Kalman filter of a single-track car, or the marginalized adaptive particle filter of Berntorp and Di "
  "Cairano" IN_FORMAT,
  10.0, 0.01, 1e-4
};

void model_codes(fmu_code_row *row, void *to)
{
#define X(name, code, text) if ((code) >= 0) row(to, "estimate.status", code, #name, text);
  TSE_STATUS_TABLE(X)
#undef X
#define X(name, code, word, text) \
  row(to, "estimate.cx_front_reason, estimate.cy_front_reason, estimate.cy_rear_reason, estimate.grip_reason", code, word, text);
  TSE_REASON_TABLE(X)
#undef X
}

void model_init(model *m) { tse_config_default(&m->config); }

static const struct { int32_t at, size; } settings[SETTINGS] = {
#define REAL(name, def, lo, hi, unit, text) { (int32_t)offsetof(tse_config, name), (int32_t)sizeof(tse_setting) },
#define INT(name, def, lo, hi, text) { (int32_t)offsetof(tse_config, name), (int32_t)sizeof(int32_t) },
#include "tse/config.def"
#undef REAL
#undef INT
};

void model_was_set(model *m, const fmu_variable *v, double value)
{
  for (int i = 0; i < SETTINGS; i++)
    if (v->offset == (int32_t)offsetof(model, config) + settings[i].at)
      m->set[i] = value < v->start || value > v->start ? SET_TO_ANOTHER : SET_TO_START;
}

/* The settings of the filter: those of an ordinary car, and what the importer has set; calibrated: all as they are. Of an importer that
 * sets every parameter, as some do before anything, nobody knows which were meant: those that are not at their start. */
static void settings_used(const model *m, tse_config *used)
{
  const int least = memchr(m->set, NOT_SET, sizeof m->set) ? SET_TO_START : SET_TO_ANOTHER;
  memcpy(used, &m->config, sizeof *used);
  if (m->calibrated) return;
  tse_config_uncalibrated(used);
  for (int i = 0; i < SETTINGS; i++)
    if (m->set[i] >= least)
      memcpy((uint8_t *)used + settings[i].at, (const uint8_t *)&m->config + settings[i].at, (size_t)settings[i].size);
}

static void derive_outputs(model *m)
{
  tse_stiffness_si(&m->used, &m->y, m->mean, m->sd, m->spread);
  m->all_valid = 1;
  for (int a = 0; a < 3; a++) {
    m->valid[a] = m->y.reason[a] == TSE_VALID;
    m->all_valid = m->all_valid && m->valid[a];
  }
  m->grip_valid = m->y.grip_reason == TSE_VALID;
}

/* What the filter says before the first row: as after one in which nothing is measured. */
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
  tse_config used; /* not m->used: a call that is refused changes nothing */
  (void)start;     /* the first row's own time counts */
  settings_used(m, &used);
  const tse_status status = tse_prepare(&used, &m->params, &wrong);
  if (status < 0) {
    (void)snprintf(text, FMU_TEXT, "%s: %s%s", fmu_name_of(wrong), tse_status_text(status),
                   m->calibrated ? "" : " (vehicle.calibrated is false: what is not set follows from mass, lf and lr)");
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

/* A sample in which what is out of range is missing, and the name of the first channel that is. tse_step() would refuse a
 * steering angle or wheel speed out of range; a co-simulation is not to end for a sensor fault. */
static tse_input usable(const model *m, const char **first)
{
  tse_input u = m->row;
  u.missing &= (1u << TSE_CHANNELS) - 1u;
  u.given = (u.given & TSE_GIVEN_VELOCITIES) | (m->pedals_given << TSE_VELOCITIES & ((1u << TSE_OPTIONALS) - 1u));
  *first = NULL;
#define INPUT(name, lo, hi, unit, kind, text)                                                                     \
  if (!(u.name >= TSE_R(lo) && u.name <= TSE_R(hi))) {                                                            \
    u.name = TSE_R(0.0);                                                                                          \
    u.missing |= TSE_MISSING(name);                                                                               \
  }                                                                                                               \
  if (!*first && (u.missing & TSE_MISSING(name))) *first = #name " is missing or outside its range " #lo " .. " #hi " " unit;
#include "tse/input.def"
#undef INPUT
  return u;
}

fmu_result model_step(model *m, double time, double step, char text[FMU_TEXT])
{
  const char *first;
  tse_input u = usable(m, &first);
  if (!(time + step - time <= LONGEST_STEP)) { /* the sample at its end would be refused: better now, while the importer's own text names the step */
    (void)snprintf(text, FMU_TEXT, "communicationStepSize = %.10g is longer than %g s", step, LONGEST_STEP);
    return FMU_ERROR;
  }
  u.dt = tse_real_of(m->rows > 0 ? time - m->time : 0.0);
  const tse_status status = tse_step(&m->params, &m->memory.filter, &u, &m->y);
  if (status < 0) {
    (void)snprintf(text, FMU_TEXT, "%s (dt %.10g s since the last sample)", tse_status_text(status),
                   tse_double_of(u.dt));
    return FMU_ERROR;
  }
  memset(&m->y.status + 1, 0, sizeof m->y - offsetof(tse_output, status) - sizeof m->y.status); /* padding is part of a saved state */
  m->rows = 1;
  m->time = time;
  derive_outputs(m);
  /* `status` is the gravest only: a channel can be missing behind it. A channel's text is the same whatever the car does, so
   * that it is said once while it lasts. */
  if (first || status == TSE_W_MISSING_CHANNEL || (status >= TSE_W_PREDICTED && status != TSE_W_WAITING)) {
    (void)snprintf(text, FMU_TEXT, "%s", first && status < TSE_W_GAP ? first : tse_status_text(status));
    return FMU_WARNING;
  }
  return FMU_OK;
}

int model_sound(const model *m, int started)
{
  tse_config used;
  tse_params anew;
  for (int i = 0; i < SETTINGS; i++)
    if (m->set[i] > SET_TO_ANOTHER) return 0;
  if (!started) return 1;
  settings_used(m, &used);
  if (memcmp(&used, &m->used, sizeof used) != 0) return 0;
  if (tse_prepare(&used, &anew, NULL) < 0 || memcmp(&anew, &m->params, sizeof anew) != 0) return 0;
  if (!(m->rows == 0 || m->rows == 1) || !(m->time - m->time == 0.0)) return 0;
  return tse_filter_check(&anew, &m->memory.filter, sizeof m->memory) == TSE_OK;
}
