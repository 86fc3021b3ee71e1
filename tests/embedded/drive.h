/* tests/embedded/drive.h - the recorded drive of tests/replay as a table, from rows.h,
 * which scripts/dev/machines.py writes. */
#ifndef DRIVE_H
#define DRIVE_H

#include "tse.h"

/* A number of the table. In fixed point an integer in units of 1e-5, to save flash. It is
 * exact: the numbers of the drive have up to five decimals. */
#if defined(TSE_REAL_FIXED)
typedef int32_t drive_number;
#define NUMBER(x) ((drive_number)((x) * 1e5 + ((x) < 0 ? -0.5 : 0.5)))
static tse_real drive_real(drive_number n)
{
  const uint64_t size = (uint64_t)(n < 0 ? -(int64_t)n : n) << TSE_FRACTION_BITS; /* fits beyond 100 */
  const tse_real x = (tse_real)((size + 50000u) / 100000u);
  return n < 0 ? -x : x;
}
#else
typedef tse_real drive_number;
#define NUMBER(x) TSE_R(x)
static tse_real drive_real(drive_number n) { return n; }
#endif

typedef struct drive_row {
  drive_number of[7];
  uint8_t missing;
} drive_row;

static const drive_row drive_table[] = {
#define ROW(dt, steer, front, rear, ax, ay, r, missing) \
  { { NUMBER(dt), NUMBER(steer), NUMBER(front), NUMBER(rear), NUMBER(ax), NUMBER(ay), NUMBER(r) }, missing },
#include "rows.h"
#undef ROW
};
enum { DRIVE_ROWS = sizeof drive_table / sizeof *drive_table };

/* Read row i. Missing channels are NaN as in the golden replay; in fixed point, bits of
 * u->missing. */
static void drive_at(int i, tse_input *u)
{
  static const volatile tse_real zero = 0;
  const drive_row *const from = &drive_table[i];
  const int is_integer = (tse_real)0.5 == 0;
  tse_real channel[7];
  for (int k = 0; k < 7; k++) channel[k] = drive_real(from->of[k]);
  tse_input_default(u); /* no velocity, no pedals */
  u->missing = is_integer ? from->missing : 0;
  if (!is_integer)
    for (int k = 0; k < 6; k++)
      if (from->missing >> k & 1) channel[1 + k] = zero / zero;
  u->dt = channel[0];
  u->steer_angle = channel[1 + TSE_CHANNEL_steer_angle];
  u->wheel_speed_front = channel[1 + TSE_CHANNEL_wheel_speed_front];
  u->wheel_speed_rear = channel[1 + TSE_CHANNEL_wheel_speed_rear];
  u->accel_x = channel[1 + TSE_CHANNEL_accel_x];
  u->accel_y = channel[1 + TSE_CHANNEL_accel_y];
  u->yaw_rate = channel[1 + TSE_CHANNEL_yaw_rate];
}

#endif
