/* tables/formula.h - a formula of the user is a term that is added to the vehicle model,
 * for example to a slip angle. This file lists the quantities of the model to which it
 * can be added (PLACE_...), and its operations, from formula.toml. Internal to the
 * sources. */
#ifndef TABLES_FORMULA_H
#define TABLES_FORMULA_H

#include <stdint.h>

enum {
  // clang-format off: table formula_places
  PLACE_front_angle = 0, PLACE_rear_angle = 1, PLACE_force_x = 2, PLACE_force_y = 3, PLACE_yaw_moment = 4,
  PLACE_stiffness_front = 5, PLACE_stiffness_rear = 6, PLACE_accel_x = 7, PLACE_accel_y = 8,
  PLACE_yaw_rate = 9,
  // clang-format on: end of table
};

/* List of all operations. The arguments are macros, one for each kind of operation. Each
 * has the arguments (name, code, number of operands, unit, text):
 *   NUMBER  one of the constants formula_a .. formula_h
 *   SIGNAL  a signal of the model in this step
 *   PLAIN   a function of the operands
 *   MEMORY  a function that also depends on earlier values of the operands */
// clang-format off: table formula_operations
#define FORMULA_OPERATIONS(NUMBER, SIGNAL, PLAIN, MEMORY) \
  NUMBER(a, 1, 0, "", "formula_a") \
  NUMBER(b, 2, 0, "", "formula_b") \
  NUMBER(c, 3, 0, "", "formula_c") \
  NUMBER(d, 4, 0, "", "formula_d") \
  NUMBER(e, 5, 0, "", "formula_e") \
  NUMBER(f, 6, 0, "", "formula_f") \
  NUMBER(g, 7, 0, "", "formula_g") \
  NUMBER(h, 8, 0, "", "formula_h") \
  PLAIN(one, 9, 0, "1", "the number 1") \
  PLAIN(two, 10, 0, "1", "the number 2") \
  SIGNAL(steer_angle, 16, 0, "rad", "road-wheel angle, after the effects of the catalogue") \
  SIGNAL(vel_x, 17, 0, "m/s", "longitudinal velocity") \
  SIGNAL(vel_y, 18, 0, "m/s", "lateral velocity") \
  SIGNAL(yaw_rate, 19, 0, "rad/s", "yaw rate of the car") \
  SIGNAL(accel_x, 20, 0, "m/s2", \
      "longitudinal specific force at the centre of gravity in the previous step") \
  SIGNAL(accel_y, 21, 0, "m/s2", "lateral specific force at the centre of gravity in the previous step") \
  SIGNAL(slip_angle_front, 22, 0, "rad", "slip angle of the front axle, before the formula is added") \
  SIGNAL(slip_angle_rear, 23, 0, "rad", "slip angle of the rear axle, before the formula is added") \
  SIGNAL(slip_front, 24, 0, "1", "longitudinal slip of the front axle") \
  SIGNAL(slip_rear, 25, 0, "1", "longitudinal slip of the rear axle") \
  SIGNAL(time, 26, 0, "s", "time since the start") \
  PLAIN(add, 32, 2, "same", "x + y") \
  PLAIN(sub, 33, 2, "same", "x - y") \
  PLAIN(mul, 34, 2, "product", "x y") \
  PLAIN(div, 35, 2, "quotient", "x/y; 0 if y is 0") \
  PLAIN(neg, 36, 1, "same", "-x") \
  PLAIN(abs, 37, 1, "same", "|x|") \
  PLAIN(max, 38, 2, "same", "the larger of x and y") \
  PLAIN(min, 39, 2, "same", "the smaller of x and y") \
  PLAIN(sqrt, 40, 1, "root", "square root of x; 0 if x is negative") \
  PLAIN(soft, 41, 1, "1", "smooth step x/sqrt(1 + x x) from -1 to 1; x has no unit") \
  MEMORY(lag, 48, 2, "first", "x after a first-order lag with time constant y s") \
  MEMORY(second, 49, 3, "first", \
      "x after a second-order lag with natural frequency y Hz and damping ratio z") \
  MEMORY(late, 50, 2, "first", "x with a delay of y s") \
  MEMORY(play, 51, 2, "first", "x after a play (hysteresis) of y to either side") \
  MEMORY(limit, 52, 2, "first", "x, with its rate of change limited to y per second") \
  MEMORY(rate, 53, 1, "rate", "time derivative of x, per second")
// clang-format on: end of table

#define FORMULA_CODE(name, code, takes, unit, text) FORMULA_OP_##name = code,
enum { FORMULA_OPERATIONS(FORMULA_CODE, FORMULA_CODE, FORMULA_CODE, FORMULA_CODE) };

#if !defined(TSE_FORMULA) && !defined(TSE_NO_EFFECTS)
/* For each operation: its code, the number of its operands, and 1 if it has memory. */
#define FORMULA_TAKES(name, code, takes, unit, text) { code, takes, 0 },
#define FORMULA_REMEMBERS(name, code, takes, unit, text) { code, takes, 1 },
static const struct {
  uint8_t code, takes, memory;
} formula_operations[] = {
  FORMULA_OPERATIONS(FORMULA_TAKES, FORMULA_TAKES, FORMULA_TAKES, FORMULA_REMEMBERS)
};
#endif

#endif
