/* estimator/filter.c - reset and step: the page to read first.
 *
 * Which form of the filter runs is a setting:
 *   0  hypotheses of what happened      step.c, regimes.c, hypothesis.c
 *   1  the paper's particle filter      paper/algorithm.c and the files it calls, one for each stage of Algorithm 1
 *   2  the same, with limits            likewise
 * Common to them: input.c (a row becomes a checked sample), told.c (effects that the plain model leaves out), start.c. */
#include "estimator/stages.h"

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

tse_status tse_step(const tse_params *p, tse_filter *f, const tse_input *u, tse_output *out)
{
  if (!p || !f || !u) return TSE_E_NULL;
  if (p->magic != TSE_PARAMS_MAGIC || f->magic != TSE_FILTER_MAGIC || f->fingerprint != p->fingerprint) return TSE_E_STATE;
  return p->form == 0 ? step_hypotheses(p, f, u, out) : step_particles(p, f, u, out);
}

const char *tse_status_text(int32_t status)
{
  switch (status) {
#define X(name, code, text) case code: return text;
    TSE_STATUS_TABLE(X)
#undef X
    default: return "unknown status";
  }
}

const char *tse_reason_text(int32_t reason)
{
  switch (reason) {
#define X(name, code, word, text) case code: return text;
    TSE_REASON_TABLE(X)
#undef X
    default: return "unknown reason";
  }
}
