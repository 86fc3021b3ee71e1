#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include "tse/tse.h"

/* Read a log as CSV from standard input. Print the front cornering stiffness after the
 * last row, with its 95 % interval. Columns: time, then the channels in the order of the
 * array `channel`. SI units, axes of ISO 8855. */
int main(void)
{
  static tse_filter f;
  tse_config c;
  tse_params p;
  tse_input u;
  tse_output y = { 0 };
  const char *wrong;
  char line[512];
  double before = NAN;
  tse_config_default(&c); /* an ordinary car; include/tse/config.h lists all settings */
  c.mass = 1900;          /* set the data of your car; without a mass no stiffness is valid */
  c.lf = 1.25;
  c.lr = 1.5;
  c.wheel_radius_front = c.wheel_radius_rear = 0.33;
  c.driven_axle = 0; /* 1 front, 2 rear, 0 both or unknown */
  if (tse_prepare(&c, &p, &wrong) < 0) return fprintf(stderr, "%s is outside its range\n", wrong), 2;
  tse_reset(&p, &f, sizeof f); /* the caller provides all memory */
  tse_input_default(&u);
  double *const channel[] = { &u.steer_angle, &u.wheel_speed_front, &u.wheel_speed_rear, &u.accel_x,
    &u.accel_y, &u.yaw_rate };
  while (fgets(line, sizeof line, stdin)) {
    char *end, *cell = line;
    const double time = strtod(cell, &end);
    if (end == cell) continue; /* header */
    for (int i = 0; i < 6; i++) {
      cell = end + (*end == ',');
      *channel[i] = strtod(cell, &end);
      if (end == cell) *channel[i] = NAN; /* an empty cell is a missing value */
    }
    u.dt = isnan(before) ? c.sample_time : time - before;
    if (tse_step(&p, &f, &u, &y) >= 0) before = time;
    else fprintf(stderr, "row refused: %s", line);
  }
  if (isnan(before)) return fputs("no row was used\n", stderr), 2;
  tse_setting mean[3], sd[3];
  tse_stiffness_si(&c, &y, mean, sd, NULL);
  printf("%.0f +- %.0f N/rad: %s\n", mean[TSE_CY_FRONT], 1.96 * sd[TSE_CY_FRONT],
      tse_reason_text(y.reason[TSE_CY_FRONT]));
}
