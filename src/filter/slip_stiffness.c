/* filter/slip_stiffness.c - longitudinal (slip) stiffness without model error. The state
 * LCX is a sum: the logarithm of the slip stiffness, plus a longitudinal model error that
 * pitch, rolling radii and the form of the tyre curve cause. The model error is an
 * unknown constant with mean 0 and sd B. When LCX changes, along_share() attributes a
 * share of the change to the slip stiffness, and the rest to the model error. The share
 * follows from B, the prior variance P of the slip stiffness and the present variance V
 * of LCX. */
#include "filter/sensitivities.h"
#include "filter/slip_stiffness.h"
#include "filter/units.h"

void along_start(tse_kalman *k, tse_real var)
{
  k->along.mean = k->x[LCX];
  k->along.var = var;
}

/* Return B^2, the variance of the constant longitudinal model error. */
static tse_real compute_error_var(const tse_params *p) { return r_sqr(r_max(USUAL_MODEL_SD, p->model_sd)); }

tse_real along_share(const tse_params *p, const tse_kalman *k, tse_real var_lcx, tse_real *var)
{
  const tse_real before = r_max(k->along.var, MIN_ALONG_VAR);
  const tse_real now = r_min(r_mul(var_lcx, r_sqr(state_unit[LCX])), before);
  const tse_real learnt = before - now;
  const tse_real share = r_div(before, before + r_mul(compute_error_var(p), r_div(learnt, before)));
  *var = before - r_mul(share, learnt);
  return share;
}

tse_real along_estimate(const tse_params *p, const tse_kalman *k, tse_real shift, tse_real *var)
{
  const tse_real var_lcx = compute_total_variance(k, LCX);
  const tse_real moved = k->x[LCX] - k->along.mean;
  tse_real own_var;
  const tse_real own_move = r_mul(along_share(p, k, var_lcx, &own_var), moved);
  const tse_real by_events = r_max(*var - r_mul(var_lcx, r_sqr(state_unit[LCX])), TSE_R(0));
  const tse_real beyond_error = r_max(r_sqr(moved - own_move) - compute_error_var(p), TSE_R(0));
  *var = own_var + by_events + beyond_error;
  return k->along.mean + own_move + shift;
}

void along_restart(const tse_params *p, tse_kalman *k, int32_t which, tse_real before)
{
  tse_real var;
  if (which == EVENT_ROAD_RETURN) {
    k->along = k->along_from;
    return;
  }
  (void)along_share(p, k, before, &var);
  along_start(k, var + r_mul(r_max(ud_variance(&k->ud, LCX) - before, TSE_R(0)), r_sqr(state_unit[LCX])));
}
