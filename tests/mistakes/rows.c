/* tests/mistakes/rows.c - run a log through the library, as a C program does.
 *   rows KNOWN MASS LF LR RADIUS_FRONT RADIUS_REAR DRIVEN_AXLE < log.csv
 *   log.csv: header, then time and six channels, a row each 10 ms
 * Prints for each row: status, reasons of the three stiffnesses, fault_channel,
 * fault_factor. */
#include <stdio.h>
#include <stdlib.h>
#include "tse/tse.h"

int main(int argc, char **argv)
{
  static tse_filter f;
  tse_config c;
  tse_params p;
  tse_input u;
  tse_output y = { 0 };
  if (argc != 8) return 2;
  if (atoi(argv[1])) tse_config_exact(&c);
  else tse_config_default(&c);
  c.mass = atof(argv[2]);
  c.lf = atof(argv[3]);
  c.lr = atof(argv[4]);
  c.wheel_radius_front = atof(argv[5]);
  c.wheel_radius_rear = atof(argv[6]);
  c.driven_axle = atoi(argv[7]);
  tse_input_default(&u);
  if (tse_prepare(&c, &p, NULL) < 0 || tse_reset(&p, &f, sizeof f) < 0 || scanf("%*[^\n]") < 0) return 1;
  while (scanf("%*f,%lf,%lf,%lf,%lf,%lf,%lf", &u.steer_angle, &u.wheel_speed_front, &u.wheel_speed_rear,
             &u.accel_x, &u.accel_y, &u.yaw_rate)
      == 6) {
    const tse_status status = tse_step(&p, &f, &u, &y);
    printf("%d %d %d %d %d %.9g\n", (int)status, (int)y.reason[0], (int)y.reason[1], (int)y.reason[2],
        (int)y.fault_channel, y.fault_factor);
  }
  return 0;
}
