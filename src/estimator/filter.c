/* estimator/filter.c - reset and step of both filters: start here.
 *
 * Which form of the filter runs is a setting:
 *   0  the car's Kalman filter          filter/step.c
 *   1  the paper's particle filter      paper/algorithm1.c and the files it calls, one for each stage of Algorithm 1
 * Common to them: align.c (channels that are logged late), input.c (a row becomes a checked sample), start.c. */
#include "filter/filter.h"
#include "paper/paper.h"

tse_status tse_reset(const tse_params *p, tse_filter *f, size_t filter_bytes)
{
  if (!p || !f) return TSE_E_NULL;
  if (p->magic != TSE_PARAMS_MAGIC) return TSE_E_STATE;
  const int small = p->form == 0 && filter_bytes == sizeof(tse_filter);
  if (!small && filter_bytes != sizeof(tse_filter_paper)) return TSE_E_SIZE;
  memset(f, 0, filter_bytes);
  f->magic = TSE_FILTER_MAGIC;
  f->fingerprint = p->fingerprint;
  return TSE_OK;
}

static tse_status step_form(const tse_params *p, tse_filter *f, const tse_input *u, tse_output *out)
{
#if !defined(TSE_NO_PARTICLES) /* else tse_prepare() accepts form 0 alone */
  if (p->form != 0) return step_particles(p, f, u, out);
#endif
  return step_row(p, f, u, out);
}

/* What is known since the last step, where a row makes none. */
static void report_waiting(const tse_params *p, tse_filter *f, tse_output *now)
{
  now->estimate_age = f->step > 0 ? r_add_sat(p->latency, f->waiting.since) : p->latency;
#if !defined(TSE_NO_PARTICLES)
  if (p->form != 0 && !f->started) report_start(p, f, now);
  else if (p->form != 0) {
    tse_real lam[6], nu;
    report_particles(p, f, now, lam, &nu);
    now->n_eff = paper_effective_size(p, (const tse_filter_paper *)f);
    for (int a = 0; a < 3; a++) now->noise[a] = now->change_ratio[a] = TSE_R(1);
  }
#endif
  if (p->form == 0) {
    if (f->step == 0) start_all(p, f); /* again with the first step: nothing has happened yet */
    report_row(p, &f->k, now);
  }
  for (int a = 0; a < 3; a++) now->reason[a] = f->waiting.reason[a];
  now->grip_reason = f->waiting.reason[TSE_CY_FRONT];
  now->status = (int32_t)TSE_W_WAITING;
}

/* A row where channels are logged late: the step is that of an earlier time, when there is one. */
static tse_status step_late(const tse_params *p, tse_filter *f, const tse_input *u, tse_output *out)
{
  tse_input row;
  tse_output now;
  tse_status status = align_row(p, f, u, &row);
  if (status < 0) return status; /* nothing has changed yet */
  memset(&now, 0, sizeof now);
  if (status == TSE_W_WAITING) report_waiting(p, f, &now);
  else {
    status = step_form(p, f, &row, &now); /* never negative: of rows that were accepted */
    now.estimate_age = p->latency;
    for (int a = 0; a < 3; a++) f->waiting.reason[a] = now.reason[a];
  }
  if (out) *out = now;
  return status;
}

tse_status tse_step(const tse_params *p, tse_filter *f, const tse_input *u, tse_output *out)
{
  if (!p || !f || !u) return TSE_E_NULL;
  if (p->magic != TSE_PARAMS_MAGIC || f->magic != TSE_FILTER_MAGIC || f->fingerprint != p->fingerprint) return TSE_E_STATE;
  if (p->form != 0 && u->given) return TSE_E_INPUT; /* it would be without effect */
#if defined(TSE_NO_VELOCITY)
  if (u->given & TSE_GIVEN_VELOCITIES) return TSE_E_INPUT;
#endif
  return p->latency_span > TSE_R(0) ? step_late(p, f, u, out) : step_form(p, f, u, out);
}

const char *tse_status_text(int32_t status)
{
  switch (status) {
    /* table: status_texts */
    case TSE_E_BUILD: return "this build rounds otherwise than the library is tested for: compile with -ffp-contract=off, without -ffast-math";
    case TSE_E_FORMAT: return "a setting leads to numbers that do not fit the fixed-point format of this build; double and float hold them";
    case TSE_E_OLD: return "the learnt state was written by an older version of this library; learn anew";
    case TSE_E_VEHICLE: return "the learnt state belongs to another vehicle";
    case TSE_E_VERSION: return "the learnt state was written by a newer version of this library";
    case TSE_E_LEARNT: return "not a learnt state of this library, or damaged";
    case TSE_E_SIZE: return "the filter's memory has another size than the library expects (other capacity or format)";
    case TSE_E_STATE: return "the filter was not reset with these parameters, or is not a filter of this library";
    case TSE_E_TIME: return "time step not finite, not positive, or too long";
    case TSE_E_INPUT: return "an input that drives the model is outside its range";
    case TSE_E_CONFIG: return "a setting is outside its range";
    case TSE_E_NULL: return "a required argument is NULL";
    case TSE_OK: return "ok";
    case TSE_W_NOT_VALID: return "at least one stiffness is not valid; its reason says why";
    case TSE_W_STARTING: return "too little seen since the start; spread and validity are not settled";
    case TSE_W_MISSING_CHANNEL: return "a measurement was missing; the others were used";
    case TSE_W_HELD: return "standstill, low speed, reverse or large steering angle: nothing is learnt of the stiffness";
    case TSE_W_PREDICTED: return "no measurement, or inputs missing: predicted only";
    case TSE_W_GAP: return "time step too long to bridge: states restarted from the sensors, what was learnt is kept";
    case TSE_W_RECOVERED: return "the state was no finite number, by a fault of the memory or an overflow: started over";
    case TSE_W_WAITING: return "no step: channels that are logged later are awaited; estimates of the last step, or of the start";
    case TSE_W_RANGE: return "a number reached the end of the range of the number format: it stops there, or the sample was dropped";
    case TSE_W_IMPLAUSIBLE: return "the channels contradict each other: a wrong unit, sign or axle; fault_channel says which, fault_factor how many times too large it is";
    /* end of table */
    default: return "unknown status";
  }
}

const char *tse_reason_text(int32_t reason)
{
  switch (reason) {
    /* table: reason_texts */
    case TSE_VALID: return "usable";
    case TSE_STARTING: return "too little seen since the start";
    case TSE_NOT_EXCITED: return "the recent inputs do not show this stiffness";
    case TSE_UNCERTAIN: return "excited, but the sd of the mean is above the limit";
    case TSE_DIVERGING: return "a channel is probably at fault";
    case TSE_HELD: return "standstill, low speed, reverse, large steering angle or sliding wheels: value from before";
    case TSE_INPUT_INVALID: return "inputs or measurements are missing";
    case TSE_PARAMETERS_UNCERTAIN: return "the parameters of the car are too uncertain (settings mass_sd to grade_sd): calibrate, or state them better";
    case TSE_MISFIT: return "the sensors say what the model does not explain: calibrate, or look for what is missing";
    case TSE_IMPLAUSIBLE: return "the channels contradict each other: a wrong unit, sign or axle (fault_channel, fault_factor)";
    /* end of table */
    default: return "unknown reason";
  }
}
