/* tests/embedded/drive.h - the recorded drive of tests/replay as a table, which scripts/machines.py writes: rows.h. */
#ifndef DRIVE_H
#define DRIVE_H

#include "tse.h"

typedef struct drive_row { tse_real of[7]; uint8_t missing; } drive_row;

static const drive_row drive_table[] = {
#define ROW(dt, steer, front, rear, ax, ay, r, missing) \
  { { TSE_R(dt), TSE_R(steer), TSE_R(front), TSE_R(rear), TSE_R(ax), TSE_R(ay), TSE_R(r) }, missing },
#include "rows.h"
#undef ROW
};
enum { DRIVE_ROWS = sizeof drive_table / sizeof *drive_table };

/* Row i. What is missing is NaN as in the golden replay; where there is none, a bit. */
static void drive_at(int i, tse_input *u)
{
  static const volatile tse_real zero = 0;
  const drive_row *const from = &drive_table[i];
  const int is_integer = (tse_real)0.5 == 0;
  tse_real channel[7];
  for (int k = 0; k < 7; k++) channel[k] = from->of[k];
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
