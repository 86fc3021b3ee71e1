/* control_loop.c - see control_loop.h. */
#include "control_loop.h"

#include <string.h>

#define NOTHING (TSE_MISSING(steer_angle) | TSE_MISSING(wheel_speed_front) | TSE_MISSING(wheel_speed_rear) | \
                 TSE_MISSING(accel_x) | TSE_MISSING(accel_y) | TSE_MISSING(yaw_rate))

tse_status loop_start(control_loop *loop, const tse_config *c, const char **wrong)
{
  memset(loop, 0, sizeof *loop);
  loop->coming.missing = NOTHING;
  tse_status status = tse_self_test(wrong); /* does this compiler round as it should? */
  if (status >= 0) status = tse_prepare(c, &loop->params, wrong);
  if (status >= 0) status = tse_reset(&loop->params, &loop->filter, sizeof loop->filter);
  return status;
}

/* Number k of a frame, in `per` to the unit. A quotient of two whole numbers is the number nearest to what the sensor meant, which a
 * product with 1e-5 is not always; in fixed point TSE_R() of the scale and shifts take its place. */
static void decode(tse_input *u, const can_frame *f, int k, tse_real per, uint32_t bit, tse_real *to)
{
  const uint8_t *const b = &f->data[3 * k];
  const int32_t raw = (int32_t)((uint32_t)b[0] | (uint32_t)b[1] << 8 | (uint32_t)b[2] << 16);
  if (f->data[6] >> k & 1u) return;
  *to = (tse_real)(raw >= 1 << 23 ? raw - (1 << 24) : raw) / per;
  u->missing &= ~bit;
}

void loop_received(control_loop *loop, const can_frame *f)
{
  tse_input *const u = &loop->coming;
  switch (f->id) {
    case CAN_STEERING: decode(u, f, 0, TSE_R(100000), TSE_MISSING(steer_angle), &u->steer_angle); break;
    case CAN_WHEELS:
      decode(u, f, 0, TSE_R(1000), TSE_MISSING(wheel_speed_front), &u->wheel_speed_front);
      decode(u, f, 1, TSE_R(1000), TSE_MISSING(wheel_speed_rear), &u->wheel_speed_rear);
      break;
    case CAN_ACCEL:
      decode(u, f, 0, TSE_R(1000), TSE_MISSING(accel_x), &u->accel_x);
      decode(u, f, 1, TSE_R(1000), TSE_MISSING(accel_y), &u->accel_y);
      break;
    case CAN_GYRO: decode(u, f, 0, TSE_R(100000), TSE_MISSING(yaw_rate), &u->yaw_rate); break;
    default: break; /* others talk on this bus, too */
  }
}

/* A period in which nothing came makes no row: the next one says how long ago the last was. */
void loop_period(control_loop *loop)
{
  loop->periods++;
  if (loop->coming.missing == NOTHING) return;
  if (loop->is_ready) {
    loop->overruns++; /* what came is kept, and time goes on: the filter sees a longer step */
    return;
  }
  loop->coming.dt = (tse_real)(int32_t)(loop->periods * LOOP_MS) / TSE_R(1000);
  loop->row = loop->coming;
  loop->coming.missing = NOTHING;
  loop->periods = 0;
  loop->is_ready = 1;
}

int loop_work(control_loop *loop)
{
  if (!loop->is_ready) return 0;
  if (tse_step(&loop->params, &loop->filter, &loop->row, &loop->estimate) < 0) loop->refused++; /* the estimate stays */
  loop->rows++;
  loop->is_ready = 0;
  return 1;
}
