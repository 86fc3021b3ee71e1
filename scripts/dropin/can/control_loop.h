/* control_loop.h - example: tse in a control unit that reads its sensors from a CAN bus.
 *
 *   interrupt of the CAN controller   loop_received(): read the channels of a frame
 *   interrupt of a timer, 10 ms       loop_period():   make a row of the last readings
 *   background                        loop_work():     run the filter on a new row
 *
 * A step of the filter may take a whole period, and no interrupt waits for it. To use
 * your own ids, signals and scales, change loop_received() in control_loop.c.
 * tests/embedded/can_board.c runs the loop with a recorded drive on an emulated
 * Cortex-M4F. */
#ifndef CONTROL_LOOP_H
#define CONTROL_LOOP_H

#include "tse.h"

enum { LOOP_MS = 10 };

/* Frames: two numbers of 24 bits, two's complement, low byte first. Byte 6: bit k is 1 if
 * number k is not valid. Byte 7: counter. */
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
  tse_output estimate;        /* after the last row */
  tse_input coming;           /* readings of this period */
  tse_input row;              /* next row of the filter */
  uint32_t periods;           /* periods since the last row */
  tse_real lost;              /* [s] time of a refused row, added to the next row */
  uint32_t rows;              /* number of rows given to the filter */
  uint32_t refused;           /* number of rows that it refused */
  uint32_t overruns;          /* periods in which the filter was still busy; 0 if the processor is
                               * fast enough */
  volatile uint32_t is_ready; /* 1: row is complete; loop_period() sets it, loop_work() clears it */
} control_loop;

/* Initialise, before interrupts are enabled.
 *   Returned:  TSE_OK; < 0 if the build or the settings are refused: *wrong names them */
tse_status loop_start(control_loop *loop, const tse_config *c, const char **wrong);

/* Read the channels of a frame. */
void loop_received(control_loop *loop, const can_frame *frame);

/* Make a row of the readings, every LOOP_MS. */
void loop_period(control_loop *loop);

/* Run the filter if a row is ready.   Returned: 1 if loop->estimate is new */
int loop_work(control_loop *loop);

#endif
