#include <math.h>
#include <stdio.h>
#include "tse/simulate.h" /* a car to estimate; with real sensors, tse/tse.h is enough */

int main(void)
{
  static tse_filter f;
  tse_config c;
  tse_params p;
  tse_output y; /* the caller owns all memory */
  tse_sim car;
  tse_sim_config truth;
  tse_sim_output log;
  tse_sim_input drive = { .dt = TSE_R(0.01), .road_level = TSE_R(1) };

  tse_config_exact(&c); /* the simulator's car; for a real one tse_config_default() and its mass */
  c.initial_cx_front = c.initial_cy_front = c.initial_cy_rear = 0.7; /* start 30 % too low */
  tse_sim_config_default(&truth);
  if (tse_prepare(&c, &p, NULL) < 0 || tse_reset(&p, &f, sizeof f) < 0
      || tse_sim_reset(&car, &c, &truth, NULL) < 0)
    return 1;

  for (int k = 0; k < 3000; k++) { /* 30 s: steer and drive in square waves */
    drive.steer_angle = k / 100 % 2 ? TSE_R(0.03) : TSE_R(-0.03);
    drive.wheel_torque_front = k / 150 % 2 ? TSE_R(-600) : TSE_R(700);
    if (tse_sim_step(&car, &drive, &log) < 0 || tse_step(&p, &f, &log.row, &y) < 0) return 1;
  }

  tse_setting mean[3], sd[3];
  tse_stiffness_si(&c, &y, mean, sd, NULL);
  printf(
      "front longitudinal %.0f +- %.0f N, front cornering %.0f +- %.0f, rear cornering %.0f +- %.0f N/rad\n",
      (double)mean[0], (double)sd[0], (double)mean[1], (double)sd[1], (double)mean[2], (double)sd[2]);
  return fabs((double)y.stiffness[1] - 1.0) < 0.1 ? 0 : 2; /* the true value is 1 */
}
