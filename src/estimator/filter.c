/* estimator/filter.c - reset and step of both filters.
 *
 * The setting `form` selects the filter:
 *   0  Kalman filter of the car      filter/step.c
 *   1  particle filter of the paper  paper/algorithm1.c, one file per stage
 * Both use align.c, which aligns channels of different latency. The particle filter also
 * uses input.c (check a row, convert it to a sample) and start.c (initial estimate). */
#include "filter/output.h"
#include "filter/start.h"
#include "filter/step.h"
#include "tables/columns.h"
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
#if !defined(TSE_NO_PARTICLES) /* otherwise tse_prepare() accepts only form 0, the Kalman filter */
  if (p->form != 0) return step_particles(p, f, u, out);
#endif
  return step_row(p, f, u, out);
}

#if TSE_LATENCY_ROWS > 0
/* Fill the output of a row that is stored without a step, because some channels are late
 * and their values for the time of this row have not arrived. Report the estimates of the
 * last step or, before the first step, the initial estimates. */
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
    if (f->step == 0) start_state(p, f); /* the first step does this again */
    report_row(p, &f->k, now);
  }
  for (int a = 0; a < 3; a++) now->reason[a] = f->waiting.reason[a];
  now->grip_reason = f->waiting.reason[3];
  now->status = (int32_t)TSE_W_WAITING;
}

/* Store the row. If the newest time at which all channels are known has
 * advanced, step to that time. */
static tse_status step_late(const tse_params *p, tse_filter *f, const tse_input *u, tse_output *out)
{
  tse_input row;
  tse_output now;
  tse_status status = align_row(p, f, u, &row);
  if (status < 0) return status; /* f is unchanged */
  memset(&now, 0, sizeof now);
  if (status == TSE_W_WAITING) report_waiting(p, f, &now);
  else {
    status = step_form(p, f, &row, &now); /* never negative: the row was checked */
    now.estimate_age = p->latency;
    for (int a = 0; a < 3; a++) f->waiting.reason[a] = now.reason[a];
    f->waiting.reason[3] = now.grip_reason;
  }
  if (out) *out = now;
  return status;
}
#endif

tse_status tse_step(const tse_params *p, tse_filter *f, const tse_input *u, tse_output *out)
{
  if (!p || !f || !u) return TSE_E_NULL;
  if (!params_match(p, f)) return TSE_E_STATE;
  if (p->form != 0 && u->given) return TSE_E_INPUT; /* the particle filter would ignore optional channels */
#if defined(TSE_NO_VELOCITY)
  if (u->given & TSE_GIVEN_VELOCITIES) return TSE_E_INPUT;
#endif
#if TSE_LATENCY_ROWS > 0
  if (p->latency_span > TSE_R(0)) return step_late(p, f, u, out);
#endif
  return step_form(p, f, u, out);
}

#define TEXT(name, word, text) case name: return text;
const char *tse_status_text(int32_t status)
{
  switch (status) {
    STATUSES(TEXT)
    default: return "unknown status";
  }
}

const char *tse_reason_text(int32_t reason)
{
  switch (reason) {
    REASON_CODES(TEXT)
    default: return "unknown reason";
  }
}
