/* control_loop.h - an example: tse in a control unit that reads its sensors from a CAN
 * bus.
 *
 *   interrupt of the CAN controller   loop_received(): a frame becomes readings; a few
 *                                     instructions
 *   interrupt of a timer, 10 ms       loop_period():   what has come since the last time
 *                                                      becomes a row
 *   the rest of the time              loop_work():     the row through the filter, when
 *                                                      there is one
 *
 * So a row may take as long as until the next one, and no interrupt waits for the filter.
 * Bring your own ids, signals and scales: decode() of control_loop.c is the place.
 * tests/embedded/can_board.c runs it on an emulated Cortex-M4F with a recorded drive. */
#ifndef CONTROL_LOOP_H
#define CONTROL_LOOP_H

#include "tse.h"

enum { LOOP_MS = 10 };

/* Frames. Numbers are 24 bits, low byte first, two's complement; byte 6: bit k is 1 where
 * number k is not valid; byte 7 counts. */
enum {
  CAN_STEERING = 0x0c1, /* steer_angle [1e-5 rad]                            */
  CAN_WHEELS = 0x0c2,   /* wheel_speed_front, wheel_speed_rear [1e-3 rad/s]  */
  CAN_ACCEL = 0x0c3,    /* accel_x, accel_y [1e-3 m/s2]                      */
  CAN_GYRO = 0x0c4,     /* yaw_rate [1e-5 rad/s]                             */
};
typedef struct can_frame {
  uint16_t id;
  uint8_t data[8];
} can_frame;

typedef struct control_loop {
  tse_params params;
  tse_filter filter;
  tse_output estimate;    /* after the last row                                                     */
  tse_input coming, row;  /* what has come in this period; what the filter is given                 */
  uint32_t periods;       /* since the last row                                                     */
  tse_real lost;          /* [s] of a row that was refused: it belongs to the next                  */
  uint32_t rows, refused; /* rows that went through the filter; that it refused                     */
  uint32_t
      overruns; /* rows that were lost because the one before was not done: never, if the processor is fast
                 * enough */
  volatile uint32_t is_ready; /* row is complete: the timer sets it, loop_work() takes it away          */
} control_loop;

/* Before interrupts are on.   Returned: TSE_OK, or negative: the build or the settings
 * are refused; *wrong says what */
tse_status loop_start(control_loop *loop, const tse_config *c, const char **wrong);

void loop_received(control_loop *loop, const can_frame *frame);
void loop_period(control_loop *loop);

/* Returned: 1 when there was a row: loop->estimate is new. */
int loop_work(control_loop *loop);

#endif
