/* control_loop.c - functions of the example that control_loop.h describes. */
#include "control_loop.h"

#include <string.h>

/* Mask of a row in which all channels are missing. */
#define NOTHING (TSE_MISSING_steer_angle | TSE_MISSING_wheel_speed_front | TSE_MISSING_wheel_speed_rear | \
                 TSE_MISSING_accel_x | TSE_MISSING_accel_y | TSE_MISSING_yaw_rate)

tse_status loop_start(control_loop *loop, const tse_config *c, const char **wrong)
{
  memset(loop, 0, sizeof *loop);
  loop->coming.missing = NOTHING;
  /* fails if this build rounds differently from the tested ones, e.g. by -ffast-math */
  tse_status status = tse_self_test(wrong);
  if (status >= 0) status = tse_prepare(c, &loop->params, wrong);
  if (status >= 0) status = tse_reset(&loop->params, &loop->filter, sizeof loop->filter);
  return status;
}

/* Return raw / per, rounded to the nearest tse_real. A product such as raw * 1e-5 would
 * not always be the nearest tse_real, because 1e-5 itself is rounded. */
static tse_real divide(int32_t raw, int32_t per)
{
#if defined(TSE_REAL_FIXED)
  const int64_t twice = (int64_t)raw * ((int64_t)1 << TSE_FRACTION_BITS) / (per / 2);
  const int64_t half = twice < 0 ? -1 : 1;
  return (twice + half) / 2;
#else
  return (tse_real)raw / (tse_real)per;
#endif
}

/* Read number k of a frame into the channel *to. The number is an integer in units of
 * 1/per of the SI unit. Clear the bit of the channel in u->missing. If the frame marks
 * the number as not valid, change nothing. */
static void decode(tse_input *u, const can_frame *f, int k, int32_t per, uint32_t bit, tse_real *to)
{
  const uint8_t *const b = &f->data[3 * k];
  const int32_t raw = (int32_t)((uint32_t)b[0] | (uint32_t)b[1] << 8 | (uint32_t)b[2] << 16);
  if (f->data[6] >> k & 1u) return;
  *to = divide(raw >= 1 << 23 ? raw - (1 << 24) : raw, per); /* raw is two's complement in 24 bits */
  u->missing &= ~bit;
}

void loop_received(control_loop *loop, const can_frame *f)
{
  tse_input *const u = &loop->coming;
  switch (f->id) {
    case CAN_STEERING: decode(u, f, 0, 100000, TSE_MISSING_steer_angle, &u->steer_angle); break;
    case CAN_WHEELS:
      decode(u, f, 0, 1000, TSE_MISSING_wheel_speed_front, &u->wheel_speed_front);
      decode(u, f, 1, 1000, TSE_MISSING_wheel_speed_rear, &u->wheel_speed_rear);
      break;
    case CAN_ACCEL:
      decode(u, f, 0, 1000, TSE_MISSING_accel_x, &u->accel_x);
      decode(u, f, 1, 1000, TSE_MISSING_accel_y, &u->accel_y);
      break;
    case CAN_GYRO: decode(u, f, 0, 100000, TSE_MISSING_yaw_rate, &u->yaw_rate); break;
    default: break; /* frames for other receivers */
  }
}

/* Make a row of the readings that came since the last row. The timer calls this function
 * at the end of each period of LOOP_MS. If no frame came in a period, there is no row.
 * The dt of the next row then includes this period. */
void loop_period(control_loop *loop)
{
  loop->periods++;
  if (loop->coming.missing == NOTHING) return;
  if (loop->is_ready) {
    /* The filter is still busy with the last row. Keep these readings for the next row,
     * whose dt then includes this period. */
    loop->overruns++;
    return;
  }
  loop->coming.dt = divide((int32_t)(loop->periods * LOOP_MS), 1000);
  loop->row = loop->coming;
  loop->coming.missing = NOTHING;
  loop->periods = 0;
  loop->is_ready = 1;
}

int loop_work(control_loop *loop)
{
  if (!loop->is_ready) return 0;
  loop->row.dt += loop->lost;
  const tse_status status = tse_step(&loop->params, &loop->filter, &loop->row, &loop->estimate);
  if (status < 0) loop->refused++; /* the estimate is unchanged */
  /* If an input of the row is out of range, the filter has refused the row and has not
   * advanced by its dt. This time is added to dt of the next row. */
  loop->lost = status == TSE_E_INPUT ? loop->row.dt : TSE_R(0);
  loop->rows++;
  loop->is_ready = 0;
  return 1;
}
