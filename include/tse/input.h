/* tse/input.h - one row of a log. src/tables/input.toml defines its channels. */
#ifndef TSE_INPUT_H
#define TSE_INPUT_H

#include <stdint.h>

#include "tse/real.h"

/* One row. Fill it with tse_input_default() first. The comments give: [unit] range,
 * consequence of a value out of range; meaning. "refused": tse_step() refuses the row.
 * "missing": the channel counts as missing in this row. A channel whose value is NaN is
 * missing, too. One of the first six channels is also missing if its bit is set in
 * `missing`. The optional channels (velocities, brake and wheel torques, road angles) are
 * missing unless their bit is set in `given`. */
typedef struct tse_input {
  tse_real dt; /* [s] (0, 3600], else refused; time since the previous row. The filter starts at the first
                * row that has steering angle and wheel speeds, and ignores dt of the rows up to this one */
  // clang-format off: table input_channels
  tse_real steer_angle;        /* [rad] -1.2 .. 1.2, else refused; mean road-wheel angle of the front axle,
                                * positive left */
  tse_real wheel_speed_front;  /* [rad/s] -400 .. 400, else refused; mean rotation rate of the front
                                * wheels, positive forward */
  tse_real wheel_speed_rear;   /* [rad/s] -400 .. 400, else refused; mean rotation rate of the rear wheels,
                                * positive forward */
  tse_real accel_x;            /* [m/s2] -50 .. 50, else missing; specific force at the centre of gravity,
                                * positive forward */
  tse_real accel_y;            /* [m/s2] -50 .. 50, else missing; specific force at the centre of gravity,
                                * positive left */
  tse_real yaw_rate;           /* [rad/s] -6 .. 6, else missing; yaw rate, positive left (counter-clockwise
                                * from above) */
  // clang-format on: end of table
  uint32_t missing; /* bits TSE_MISSING_...: channels above that are not measured in this row */
  uint32_t given;   /* bits TSE_GIVEN_...: optional channels below that are measured in this row */
  // clang-format off: table input_optional
  tse_real ins_vel_x;          /* [m/s] -120 .. 120, otherwise missing; longitudinal velocity of the
                                * reference point of an INS or an optical sensor (settings
                                * velocity_lever_...) */
  tse_real ins_vel_y;          /* [m/s] -60 .. 60, otherwise missing; lateral velocity of the reference
                                * point of an INS or an optical sensor, positive left */
  tse_real gnss_speed;         /* [m/s] 0 .. 120, otherwise missing; speed over ground */
  tse_real gnss_course;        /* [rad] -7 .. 7, otherwise missing; direction of the motion over ground,
                                * positive left (counter-clockwise from above), relative to any fixed
                                * direction */
  tse_real brake;              /* [1] 0 .. 1, otherwise missing; 1: the car brakes, 0: it does not; a value
                                * counts as 1 from 0.5 on; if missing, accel_x decides whether the car
                                * brakes */
  tse_real wheel_torque_front; /* [Nm] -20000 .. 20000, otherwise missing; drive torque minus brake torque,
                                * sum of both front wheels */
  tse_real wheel_torque_rear;  /* [Nm] -20000 .. 20000, otherwise missing; drive torque minus brake torque,
                                * sum of both rear wheels */
  tse_real bank;               /* [rad] -0.35 .. 0.35, otherwise missing; bank of the road, positive if the
                                * left side is higher. It includes the superelevation of a curve, and is
                                * used in place of the settings bank_angle and bank_superelevation */
  tse_real grade;              /* [rad] -0.35 .. 0.35, otherwise missing; grade of the road, positive
                                * uphill, used in place of the setting grade_angle */
  // clang-format on: end of table
} tse_input;

/* Index of each channel: the number of its bit in tse_input.missing. */
enum {
  // clang-format off: table channel_places
  TSE_CHANNEL_steer_angle,
  TSE_CHANNEL_wheel_speed_front,
  TSE_CHANNEL_wheel_speed_rear,
  TSE_CHANNEL_accel_x,
  TSE_CHANNEL_accel_y,
  TSE_CHANNEL_yaw_rate,
  // clang-format on: end of table
  TSE_CHANNELS
};
// clang-format off: table missing_bits
#define TSE_MISSING_steer_angle (1u << TSE_CHANNEL_steer_angle)
#define TSE_MISSING_wheel_speed_front (1u << TSE_CHANNEL_wheel_speed_front)
#define TSE_MISSING_wheel_speed_rear (1u << TSE_CHANNEL_wheel_speed_rear)
#define TSE_MISSING_accel_x (1u << TSE_CHANNEL_accel_x)
#define TSE_MISSING_accel_y (1u << TSE_CHANNEL_accel_y)
#define TSE_MISSING_yaw_rate (1u << TSE_CHANNEL_yaw_rate)
// clang-format on: end of table

/* Index of each optional channel: the number of its bit in tse_input.given. */
enum {
  // clang-format off: table optional_places
  TSE_OPTIONAL_ins_vel_x,
  TSE_OPTIONAL_ins_vel_y,
  TSE_OPTIONAL_gnss_speed,
  TSE_OPTIONAL_gnss_course,
  TSE_OPTIONAL_brake,
  TSE_OPTIONAL_wheel_torque_front,
  TSE_OPTIONAL_wheel_torque_rear,
  TSE_OPTIONAL_bank,
  TSE_OPTIONAL_grade,
  // clang-format on: end of table
  TSE_OPTIONALS
};
// clang-format off: table given_bits
#define TSE_GIVEN_ins_vel_x (1u << TSE_OPTIONAL_ins_vel_x)
#define TSE_GIVEN_ins_vel_y (1u << TSE_OPTIONAL_ins_vel_y)
#define TSE_GIVEN_gnss_speed (1u << TSE_OPTIONAL_gnss_speed)
#define TSE_GIVEN_gnss_course (1u << TSE_OPTIONAL_gnss_course)
#define TSE_GIVEN_brake (1u << TSE_OPTIONAL_brake)
#define TSE_GIVEN_wheel_torque_front (1u << TSE_OPTIONAL_wheel_torque_front)
#define TSE_GIVEN_wheel_torque_rear (1u << TSE_OPTIONAL_wheel_torque_rear)
#define TSE_GIVEN_bank (1u << TSE_OPTIONAL_bank)
#define TSE_GIVEN_grade (1u << TSE_OPTIONAL_grade)
// clang-format on: end of table
#define TSE_VELOCITIES 4 /* number of velocities, which are the first optional channels */
#define TSE_PEDALS 3     /* number of pedals and wheel torques, which follow the velocities */
/* Masks of tse_input.given: the bits of all velocities, of all pedals and wheel torques,
 * and of both road angles. */
#define TSE_GIVEN_VELOCITIES ((1u << TSE_VELOCITIES) - 1u)
#define TSE_GIVEN_PEDALS (((1u << TSE_PEDALS) - 1u) << TSE_VELOCITIES)
#define TSE_GIVEN_ROAD (TSE_GIVEN_bank | TSE_GIVEN_grade)

#endif
