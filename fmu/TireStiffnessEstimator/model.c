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

#define REAL(name, def, lo, hi, unit, text) PARAMETER("vehicle", 'r', name, def, lo, hi, unit, text)
#define INT(name, def, lo, hi, text) PARAMETER("vehicle", 'i', name, def, lo, hi, "", text)
#include "tse/vehicle.def"
#undef REAL
#undef INT
#define REAL(name, def, lo, hi, unit, text) PARAMETER("uncertainty", 'r', name, def, lo, hi, unit, text)
#include "tse/told.def"
#undef REAL
#define REAL(name, def, lo, hi, unit, text) PARAMETER("sensors", 'r', name, def, lo, hi, unit, text)
#define INT(name, def, lo, hi, text) PARAMETER("sensors", 'i', name, def, lo, hi, "", text)
#include "tse/sensors.def"
#undef REAL
#undef INT
#define REAL(name, def, lo, hi, unit, text) PARAMETER("latency", 'r', name, def, lo, hi, unit, text)
#include "tse/latency.def"
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
#define OUT_INT(name, member, text) OUTPUT("estimate." #name, 'i', y.member, "", text)
#define OUT_STIFFNESS(name, member, si, unit, text) OUTPUT("estimate." #name, 'r', si, unit, text)
#define OUT_FLAG(name, member, text) OUTPUT("estimate." #name, 'b', y.member, "", text)
#define OUT_REASON(stiffness, member, text)                                                                        \
  OUTPUT("estimate." #stiffness "_valid", 'b', valid[(offsetof(tse_output, member) - offsetof(tse_output, reason)) / sizeof(int32_t)], "", \
         "the stiffness may be used")                                                                              \
  OUTPUT("estimate." #stiffness "_reason", 'i', y.member, "", REASONS)
#include "tse/output.def"
#undef OUT_REAL
#undef OUT_INT
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
  "Estimates longitudinal and cornering stiffness of a car's tyres, their spread and the sensors' biases from steering angle, wheel "
  "speeds, accelerometers and gyro, and tells changes of the road, faults of a channel and sliding wheels: weighted hypotheses of what "
  "happened on a single-track model, or the marginalized adaptive particle filter of Berntorp and Di Cairano" IN_FORMAT,
  10.0, 0.01, 1e-4
};

void model_codes(fmu_code_row *row, void *to)
{
#define X(name, code, text) if ((code) >= 0) row(to, "estimate.status", code, #name, text);
  TSE_STATUS_TABLE(X)
#undef X
#define X(name, code, word, text) row(to, "estimate.cx_front_reason, estimate.cy_front_reason, estimate.cy_rear_reason", code, word, text);
  TSE_REASON_TABLE(X)
#undef X
}

void model_init(model *m) { tse_config_default(&m->config); }

static void derive_outputs(model *m)
{
  tse_stiffness_si(&m->config, &m->y, m->mean, m->sd, m->spread);
  m->all_valid = 1;
  for (int a = 0; a < 3; a++) {
    m->valid[a] = m->y.reason[a] == TSE_VALID;
    m->all_valid = m->all_valid && m->valid[a];
  }
}

fmu_result model_start(model *m, double start, char text[FMU_TEXT])
{
  const char *wrong = "";
  const tse_status status = tse_prepare(&m->config, &m->params, &wrong);
  (void)start; /* the first row's own time counts */
  if (status < 0) {
    (void)snprintf(text, FMU_TEXT, "%s: %s", fmu_name_of(wrong), tse_status_text(status));
    return FMU_ERROR;
  }
  (void)tse_reset(&m->params, &m->memory.filter, sizeof m->memory);
  m->rows = 0;
  memset(&m->y, 0, sizeof m->y); /* before the first row: what the settings say */
  m->y.stiffness[0] = (tse_real)m->config.initial_cx_front;
  m->y.stiffness[1] = (tse_real)m->config.initial_cy_front;
  m->y.stiffness[2] = (tse_real)m->config.initial_cy_rear;
  m->y.status = TSE_W_STARTING;
  m->y.estimate_age = m->params.latency;
  m->y.regime[TSE_REGIME_STEADY] = TSE_R(1.0);
  for (int a = 0; a < 3; a++) {
    m->y.stiffness_sd[a] = (tse_real)m->config.initial_mean_sd;
    m->y.stiffness_spread[a] = (tse_real)m->config.initial_spread;
    m->y.noise[a] = m->y.change_ratio[a] = TSE_R(1.0);
    m->y.reason[a] = TSE_STARTING;
  }
  derive_outputs(m);
  return FMU_OK;
}

/* A sample in which what is out of range is missing, and the name of the first channel that is. tse_step() would refuse a
 * steering angle or wheel speed out of range; a co-simulation is not to end for a sensor fault. */
static tse_input usable(const model *m, const char **first)
{
  tse_input u = m->row;
  u.missing &= (1u << TSE_CHANNELS) - 1u;
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
  tse_params anew;
  if (!started) return 1;
  if (tse_prepare(&m->config, &anew, NULL) < 0 || memcmp(&anew, &m->params, sizeof anew) != 0) return 0;
  if (!(m->rows == 0 || m->rows == 1) || !(m->time - m->time == 0.0)) return 0;
  return tse_filter_check(&anew, &m->memory.filter, sizeof m->memory) == TSE_OK;
}
