#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include "tse/tse.h"

int main(void)                                          /* log.csv in, stiffness of the front tyres at its end out */
{
  static tse_filter f;  tse_config c;  tse_params p;  tse_output y = { 0 };  const char *wrong;  char line[512];  double before = NAN;
  tse_config_default(&c);                               /* every setting: include/tse/config.h */
  c.mass = 1900;  c.lf = 1.25;  c.lr = 1.5;             /* your car; driven_axle: 1 front, 2 rear, 0 both or unknown */
  c.wheel_radius_front = c.wheel_radius_rear = 0.33;  c.driven_axle = 0;
  tse_config_uncalibrated(&c);                          /* last: what such a car has by its mass and axles, and how uncertain that is */
  if (tse_prepare(&c, &p, &wrong) < 0) return fprintf(stderr, "%s is outside its range\n", wrong), 2;
  tse_reset(&p, &f, sizeof f);                          /* the caller owns all memory */
  while (fgets(line, sizeof line, stdin)) {             /* time, then the channels in this order; SI units, ISO 8855 */
    double v[7];  char *s = line, *end;
    for (int i = 0; i < 7; i++, s = end + (*end == ',')) {
      v[i] = strtod(s, &end);  if (end == s) v[i] = NAN;   /* an empty cell: missing */
    }
    const tse_input u = { .dt = isnan(before) ? c.sample_time : v[0] - before, .steer_angle = v[1], .wheel_speed_front = v[2],
                          .wheel_speed_rear = v[3], .accel_x = v[4], .accel_y = v[5], .yaw_rate = v[6] };
    if (isnan(v[0])) continue;                          /* the header */
    if (tse_step(&p, &f, &u, &y) >= 0) before = v[0];  else fprintf(stderr, "row refused: %s", line);
  }
  if (isnan(before)) return fputs("no row was used\n", stderr), 2;
  tse_setting mean[3], sd[3];  tse_stiffness_si(&c, &y, mean, sd, NULL);
  printf("%.0f +- %.0f N/rad: %s\n", mean[TSE_CY_FRONT], 1.96 * sd[TSE_CY_FRONT], tse_reason_text(y.reason[TSE_CY_FRONT]));
}
