/* estimator/input.c - a log row becomes a checked sample. Every refusal of a row happens here, before anything changes. */
#include "estimator/stages.h"

tse_status tse_input_check(const tse_input *u, const char **wrong)
{
  if (!u) return TSE_E_NULL;
  if (!(u->dt > TSE_R(0) && u->dt <= LONGEST_DT)) {
    if (wrong) *wrong = "dt";
    return TSE_E_TIME;
  }
#define CHECK_M(name, lo, hi) /* measured: out of range is missing, not refused */
#define CHECK_D(name, lo, hi)                                                                              \
  if (!is_missing(u, TSE_MISSING(name), u->name) && !(u->name >= TSE_R(lo) && u->name <= TSE_R(hi))) {        \
    if (wrong) *wrong = #name;                                                                             \
    return TSE_E_INPUT;                                                                                    \
  }
#define INPUT(name, lo, hi, unit, kind, text) CHECK_##kind(name, lo, hi)
#include "tse/input.def"
  return TSE_OK;
}

tse_status input_decode(const tse_params *p, const tse_filter *f, const tse_input *u, sample *y)
{
  tse_input row = *u;
  if (!f->started) row.dt = p->sample_time; /* the first row has no predecessor */
  const tse_status status = tse_input_check(&row, NULL);
  if (status < 0) return status;

  y->dt = row.dt;
  y->has_inputs = y->has_steer = 1;
  y->u.steer = row.steer_angle;
  y->u.v_front = r_mul(p->radius_front, row.wheel_speed_front);
  y->u.v_rear = r_mul(p->radius_rear, row.wheel_speed_rear);
  if (is_missing(&row, TSE_MISSING(steer_angle), row.steer_angle)) { y->u.steer = f->steer; y->has_inputs = y->has_steer = 0; }
  if (is_missing(&row, TSE_MISSING(wheel_speed_front), row.wheel_speed_front)) { y->u.v_front = f->v_front; y->has_inputs = 0; }
  if (is_missing(&row, TSE_MISSING(wheel_speed_rear), row.wheel_speed_rear)) { y->u.v_rear = f->v_rear; y->has_inputs = 0; }

  y->used = 0;
#define TAKE_D(name, lo, hi)
#define TAKE_M(name, lo, hi)                                                                                      \
  {                                                                                                               \
    const int i = (int)TSE_CHANNEL_##name - (int)TSE_CHANNEL_accel_x;                                             \
    const int ok = !is_missing(&row, TSE_MISSING(name), row.name) && row.name >= TSE_R(lo) && row.name <= TSE_R(hi); \
    y->lost[i] = f->waiting.lost[i];                                                                              \
    y->use[i] = ok ? TSE_R(1) : TSE_R(0);                                                                         \
    y->y[i] = ok ? r_mul(row.name, p->inv_sd[i]) : TSE_R(0);                                                      \
    y->used += ok;                                                                                                \
  }
#define INPUT(name, lo, hi, unit, kind, text) TAKE_##kind(name, lo, hi)
#include "tse/input.def"
  return TSE_OK;
}
