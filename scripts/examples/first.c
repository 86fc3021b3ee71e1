#include <stdio.h>
#include "tse/tse.h"

int main(void)                                          /* rows of a log in, stiffness of the front tyres at their end out */
{
  static tse_filter f;  tse_config c;  tse_params p;  tse_output y;  tse_input u = { .dt = 0.01 };  const char *wrong;
  tse_config_default(&c);                               /* a mid-size car; every setting: include/tse/config.def */
  tse_config_uncalibrated(&c);                          /* which nobody has calibrated; without this line it is known exactly */
  c.mass = 1900;  c.lf = 1.25;  c.lr = 1.5;
  if (tse_prepare(&c, &p, &wrong) < 0) return fprintf(stderr, "%s is outside its range\n", wrong), 2;
  tse_reset(&p, &f, sizeof f);                          /* the caller owns all memory */
  while (scanf("%*f,%lf,%lf,%lf,%lf,%lf,%lf", &u.steer_angle, &u.wheel_speed_front, &u.wheel_speed_rear, &u.accel_x, &u.accel_y,
               &u.yaw_rate) == 6)                       /* SI units, ISO 8855; nan: missing */
    if (tse_step(&p, &f, &u, &y) < 0) fputs("row refused\n", stderr);
  printf("%.3f +- %.3f of nominal: %s\n", y.stiffness[TSE_CY_FRONT], 1.96 * y.stiffness_sd[TSE_CY_FRONT],
         tse_reason_text(y.reason[TSE_CY_FRONT]));
}
