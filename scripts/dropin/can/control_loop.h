/* control_loop.h - example: tse in a control unit that reads its sensors from a CAN bus.
 *
 *   interrupt of the CAN controller   loop_received(): read the channels of a frame
 *   interrupt of a timer, 10 ms       loop_period():   make a row of the newest readings
 *   background                        loop_work():     run the filter on this row
 *
 * The interrupts do not wait for the filter, so a step of the filter may take up to the
 * whole period of the timer. To use other identifiers, signals and scales, change
 * loop_received() in control_loop.c. tests/embedded/can_board.c runs the loop with a
 * recorded drive on an emulated Cortex-M4F. */
#ifndef CONTROL_LOOP_H
#define CONTROL_LOOP_H

#include "tse.h"

enum { LOOP_MS = 10 }; /* [ms] period of the timer, and time between two rows */

/* Identifiers of the CAN frames, and the numbers in them.
 *   bytes 0 .. 5   number 0 and number 1: 24 bits each, two's complement, low byte first
 *   byte 6         bit k is 1 if number k is not valid
 *   byte 7         counter of the frames */
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
  tse_output estimate;        /* estimate after the last row */
  tse_input coming;           /* readings of the current period */
  tse_input row;              /* row that the filter reads next, if is_ready is 1 */
  uint32_t periods;           /* number of timer periods since loop_period() last made a row */
  tse_real lost;              /* [s] dt of the last row if it was refused, otherwise 0 */
  uint32_t rows;              /* number of rows that loop_work() has passed to the filter */
  uint32_t refused;           /* number of rows that the filter has refused */
  uint32_t overruns;          /* number of periods in which the filter was still busy. It stays 0
                               * if the processor is fast enough */
  volatile uint32_t is_ready; /* 1: `row` is complete. loop_period() sets it, loop_work() clears it */
} control_loop;

/* Initialise the loop. Call it before interrupts are enabled.
 *   Returned:  *wrong  name of the failed self-test or refused setting, if result < 0
 *              result  TSE_OK; < 0 if the self-test fails or a setting is refused */
tse_status loop_start(control_loop *loop, const tse_config *c, const char **wrong);

/* Decode a frame, and store its channels as readings of the current period. */
void loop_received(control_loop *loop, const can_frame *frame);

/* Make a row of the readings that came since the last row. Call it every LOOP_MS. */
void loop_period(control_loop *loop);

/* Run the filter if a row is ready.   Returned: 1 if it ran on a row, otherwise 0 */
int loop_work(control_loop *loop);

#endif
