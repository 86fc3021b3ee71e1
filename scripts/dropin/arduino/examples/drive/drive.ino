/* A simulated car in place of a real one: steers and drives in square waves, and its tyres are estimated from what its sensors say.
 * On a car, fill a tse_input with what its sensors say; then no simulator is needed. */
#include <tse.h>

static tse_filter filter;
static tse_params params;
static tse_sim car;
static tse_sim_input drive;
static uint32_t row;

void setup()
{
  static tse_config config;
  static tse_sim_config truth;
  Serial.begin(115200);
  tse_config_default(&config);
  config.initial_cy_front = TSE_R(0.7);                /* start 30 % too low */
  tse_sim_config_default(&truth);
  if (tse_prepare(&config, &params, NULL) < 0 || tse_reset(&params, &filter, sizeof filter) < 0
      || tse_sim_reset(&car, &config, &truth, NULL) < 0) Serial.println("the settings are not accepted");
  drive.dt = TSE_R(0.01);
  drive.road_level = TSE_R(1);
}

void loop()
{
  static tse_sim_output log;
  static tse_output y;
  drive.steer_angle = row / 100 % 2 ? TSE_R(0.03) : TSE_R(-0.03);
  drive.wheel_torque_front = row / 150 % 2 ? TSE_R(-600) : TSE_R(700);
  if (tse_sim_step(&car, &drive, &log) < 0 || tse_step(&params, &filter, &log.row, &y) < 0) return;
  if (++row % 100 == 0) Serial.println((double)y.stiffness[TSE_CY_FRONT]);       /* goes to 1 */
}
