/* estimator/input.c - check a log row and convert it to a sample. If a value of a row is
 * not allowed, the row is refused here, before the filter changes. */
#include "estimator/stages.h"
#include "tables/input.h"

void tse_input_default(tse_input *u)
{
  if (!u) return;
  memset(u, 0, sizeof *u);
  u->dt = TSE_R(0.01);
}

tse_status tse_input_check(const tse_input *u, const char **wrong)
{
  if (!u) return TSE_E_NULL;
  if (!(u->dt > TSE_R(0) && u->dt <= MAX_DT)) {
    if (wrong) *wrong = "dt";
    return TSE_E_TIME;
  }
  /* a row is refused if an input (steering angle, wheel speed) is out of range; a
   * measurement out of range counts as missing */
  for (int k = 0; k < (int)TSE_CHANNELS; k++) {
    const channel_row *const row = &channel_rows[k];
    const tse_real x = channel_at(u, row);
    if (!row->drives || is_missing(u, 1u << k, x) || channel_holds(row, x)) continue;
    if (wrong) *wrong = row->name;
    return TSE_E_INPUT;
  }
  return TSE_OK;
}

tse_status input_decode(const tse_params *p, const tse_filter *f, const tse_input *u, sample *y)
{
  tse_input row = *u;
  if (!f->started) row.dt = p->sample_time; /* the first row has no predecessor */
  const tse_status status = tse_input_check(&row, NULL);
  if (status < 0) return status;

  y->dt = row.dt;
  y->u.steer = row.steer_angle;
  y->u.v_front = r_mul(p->radius_front, row.wheel_speed_front);
  y->u.v_rear = r_mul(p->radius_rear, row.wheel_speed_rear);
  const int no_steer = is_missing(&row, TSE_MISSING_steer_angle, row.steer_angle);
  const int no_front = is_missing(&row, TSE_MISSING_wheel_speed_front, row.wheel_speed_front);
  const int no_rear = is_missing(&row, TSE_MISSING_wheel_speed_rear, row.wheel_speed_rear);
  y->has_steer = !no_steer;
  y->has_inputs = !no_steer && !no_front && !no_rear;
  if (no_steer) y->u.steer = f->steer;
  if (no_front) y->u.v_front = f->v_front;
  if (no_rear) y->u.v_rear = f->v_rear;

  y->used = 0;
  for (int i = 0; i < 3; i++) {
    const int k = (int)TSE_CHANNEL_accel_x + i;
    const tse_real x = channel_at(&row, &channel_rows[k]);
    const int ok = !is_missing(&row, 1u << k, x) && channel_holds(&channel_rows[k], x);
    y->lost[i] = f->waiting.lost[i];
    y->use[i] = ok ? TSE_R(1) : TSE_R(0);
    y->y[i] = ok ? r_mul(x, p->inv_sd[i]) : TSE_R(0);
    y->used += ok;
  }
  return TSE_OK;
}
