/* tables/input.h - the range of every channel of a log row, from input.toml. Internal to the sources. */
#ifndef TABLES_INPUT_H
#define TABLES_INPUT_H

#include <stddef.h>

#include "tables/rows.h"

static const channel_row channel_rows[TSE_CHANNELS] = { /* by TSE_CHANNEL_ */
  /* table: channel_rows */
  { "steer_angle", (uint16_t)offsetof(tse_input, steer_angle), 1, TSE_R(-1.2), TSE_R(1.2) },
  { "wheel_speed_front", (uint16_t)offsetof(tse_input, wheel_speed_front), 1, TSE_R(-400.0), TSE_R(400.0) },
  { "wheel_speed_rear", (uint16_t)offsetof(tse_input, wheel_speed_rear), 1, TSE_R(-400.0), TSE_R(400.0) },
  { "accel_x", (uint16_t)offsetof(tse_input, accel_x), 0, TSE_R(-50.0), TSE_R(50.0) },
  { "accel_y", (uint16_t)offsetof(tse_input, accel_y), 0, TSE_R(-50.0), TSE_R(50.0) },
  { "yaw_rate", (uint16_t)offsetof(tse_input, yaw_rate), 0, TSE_R(-6.0), TSE_R(6.0) },
  /* end of table */
};

static const channel_row optional_rows[TSE_OPTIONALS] = { /* by TSE_OPTIONAL_ */
  /* table: optional_rows */
  { "ins_vel_x", (uint16_t)offsetof(tse_input, ins_vel_x), 0, TSE_R(-120.0), TSE_R(120.0) },
  { "ins_vel_y", (uint16_t)offsetof(tse_input, ins_vel_y), 0, TSE_R(-60.0), TSE_R(60.0) },
  { "gnss_speed", (uint16_t)offsetof(tse_input, gnss_speed), 0, TSE_R(0.0), TSE_R(120.0) },
  { "gnss_course", (uint16_t)offsetof(tse_input, gnss_course), 0, TSE_R(-7.0), TSE_R(7.0) },
  { "brake", (uint16_t)offsetof(tse_input, brake), 0, TSE_R(0.0), TSE_R(1.0) },
  { "wheel_torque_front", (uint16_t)offsetof(tse_input, wheel_torque_front), 0, TSE_R(-20000.0), TSE_R(20000.0) },
  { "wheel_torque_rear", (uint16_t)offsetof(tse_input, wheel_torque_rear), 0, TSE_R(-20000.0), TSE_R(20000.0) },
  /* end of table */
};

#endif
