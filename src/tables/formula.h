/* tables/formula.h - places and operations of a formula of the user, from formula.toml. Internal to the sources. */
#ifndef TABLES_FORMULA_H
#define TABLES_FORMULA_H

#include <stdint.h>

enum {
  /* table: formula_places */
  PLACE_front_angle = 0, PLACE_rear_angle = 1, PLACE_force_x = 2, PLACE_force_y = 3, PLACE_yaw_moment = 4,
  PLACE_stiffness_front = 5, PLACE_stiffness_rear = 6, PLACE_accel_x = 7, PLACE_accel_y = 8, PLACE_yaw_rate = 9,
  /* end of table */
};

enum {
  /* table: formula_operations */
  FORMULA_OP_a = 1, FORMULA_OP_b = 2, FORMULA_OP_c = 3, FORMULA_OP_d = 4, FORMULA_OP_e = 5, FORMULA_OP_f = 6, FORMULA_OP_g = 7,
  FORMULA_OP_h = 8, FORMULA_OP_one = 9, FORMULA_OP_two = 10, FORMULA_OP_steer_angle = 16, FORMULA_OP_vel_x = 17,
  FORMULA_OP_vel_y = 18, FORMULA_OP_yaw_rate = 19, FORMULA_OP_accel_x = 20, FORMULA_OP_accel_y = 21,
  FORMULA_OP_slip_angle_front = 22, FORMULA_OP_slip_angle_rear = 23, FORMULA_OP_slip_front = 24, FORMULA_OP_slip_rear = 25,
  FORMULA_OP_time = 26, FORMULA_OP_add = 32, FORMULA_OP_sub = 33, FORMULA_OP_mul = 34, FORMULA_OP_div = 35, FORMULA_OP_neg = 36,
  FORMULA_OP_abs = 37, FORMULA_OP_max = 38, FORMULA_OP_min = 39, FORMULA_OP_sqrt = 40, FORMULA_OP_soft = 41, FORMULA_OP_lag = 48,
  FORMULA_OP_second = 49, FORMULA_OP_late = 50, FORMULA_OP_play = 51, FORMULA_OP_limit = 52, FORMULA_OP_rate = 53,
  /* end of table */
};

#if !defined(TSE_FORMULA) && !defined(TSE_NO_EFFECTS)
/* Operands that each takes from the stack, and whether it remembers. */
static const struct {
  uint8_t code, takes, memory;
} formula_operations[] = {
  /* table: formula_takes */
  { FORMULA_OP_a, 0, 0 }, { FORMULA_OP_b, 0, 0 }, { FORMULA_OP_c, 0, 0 }, { FORMULA_OP_d, 0, 0 }, { FORMULA_OP_e, 0, 0 },
  { FORMULA_OP_f, 0, 0 }, { FORMULA_OP_g, 0, 0 }, { FORMULA_OP_h, 0, 0 }, { FORMULA_OP_one, 0, 0 }, { FORMULA_OP_two, 0, 0 },
  { FORMULA_OP_steer_angle, 0, 0 }, { FORMULA_OP_vel_x, 0, 0 }, { FORMULA_OP_vel_y, 0, 0 }, { FORMULA_OP_yaw_rate, 0, 0 },
  { FORMULA_OP_accel_x, 0, 0 }, { FORMULA_OP_accel_y, 0, 0 }, { FORMULA_OP_slip_angle_front, 0, 0 },
  { FORMULA_OP_slip_angle_rear, 0, 0 }, { FORMULA_OP_slip_front, 0, 0 }, { FORMULA_OP_slip_rear, 0, 0 },
  { FORMULA_OP_time, 0, 0 }, { FORMULA_OP_add, 2, 0 }, { FORMULA_OP_sub, 2, 0 }, { FORMULA_OP_mul, 2, 0 },
  { FORMULA_OP_div, 2, 0 }, { FORMULA_OP_neg, 1, 0 }, { FORMULA_OP_abs, 1, 0 }, { FORMULA_OP_max, 2, 0 },
  { FORMULA_OP_min, 2, 0 }, { FORMULA_OP_sqrt, 1, 0 }, { FORMULA_OP_soft, 1, 0 }, { FORMULA_OP_lag, 2, 1 },
  { FORMULA_OP_second, 3, 1 }, { FORMULA_OP_late, 2, 1 }, { FORMULA_OP_play, 2, 1 }, { FORMULA_OP_limit, 2, 1 },
  { FORMULA_OP_rate, 1, 1 },
  /* end of table */
};
#endif

#endif
