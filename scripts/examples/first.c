#include <stdio.h>
#include "tse/tse.h"

/* Read a log as CSV from standard input. Print the front cornering stiffness after the
 * last row. The first line is a header; the rows are 10 ms apart. Columns: see scanf()
 * below. SI units, axes of ISO 8855. */
int main(void)
{
  static tse_filter f; /* the caller provides all memory */
  tse_config c;
  tse_params p;
  tse_input u;
  tse_output y = { 0 };
  tse_setting k[3], sd[3];
  double time;
  int cells;
  int row = 2; /* row 1 is the header */
  /* Settings of an ordinary car that is not calibrated. On the simulated log.csv of the
   * README, the estimate is 132 +- 25 kN/rad (95 % interval). The true stiffness is
   * 120 kN/rad. tse.estimate() in Python first calibrates the car on this log, and then
   * estimates 114 +- 14 kN/rad. */
  tse_config_default(&c);
  c.mass = 1900;
  c.lf = 1.25;
  c.lr = 1.5;
  c.wheel_radius_front = c.wheel_radius_rear = 0.33;
  tse_input_default(&u);
  if (tse_prepare(&c, &p, NULL) < 0 || tse_reset(&p, &f, sizeof f) < 0) return 1;
  if (scanf("%*[^\n]") < 0) return 1; /* header */
  while ((cells = scanf("%lf,%lf,%lf,%lf,%lf,%lf,%lf%*[^\n]", &time, &u.steer_angle, &u.wheel_speed_front,
              &u.wheel_speed_rear, &u.accel_x, &u.accel_y, &u.yaw_rate))
      == 7) {
    /* < 0: row refused; > 0: warning. Check y.reason before you use an estimate */
    if (tse_step(&p, &f, &u, &y) < 0)
      return fprintf(stderr, "row %d: %s\n", row, tse_status_text(y.status)), 1;
    row++;
  }
  if (cells != EOF) return fprintf(stderr, "row %d, cell %d: empty, or no number\n", row, cells + 1), 1;
  tse_stiffness_si(&c, &y, k, sd, NULL);
  printf("front cornering stiffness %.0f +- %.0f N/rad (95 %%), %s%s\n", k[TSE_CY_FRONT],
      1.96 * sd[TSE_CY_FRONT],
      y.reason[TSE_CY_FRONT] == TSE_VALID ? "" : "do not use: ", tse_reason_text(y.reason[TSE_CY_FRONT]));
}
