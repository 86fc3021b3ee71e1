/* tables/sim.h - default and range of the simulator's settings, range of what its driver does. Part of host/simulate.c. */
#include "tables/settings.h"
#define SIM_REAL(fmu, name, def, lo, hi, unit, text) { #name, (uint16_t)offsetof(tse_sim_config, name), TSE_S(def), TSE_S(lo), TSE_S(hi) },
#define SIM_WHOLE(fmu, name, def, lo, hi, unit, text) { #name, (uint16_t)offsetof(tse_sim_config, name), def, lo, hi },
#define INPUT(name, lo, hi) { #name, (uint16_t)offsetof(tse_sim_input, name), 1, TSE_R(lo), TSE_R(hi) }

static const real_row sim_reals[] = { SETTINGS_SIM(SIM_REAL, NO_ROW) };
static const whole_row sim_wholes[] = { SETTINGS_SIM(NO_ROW, SIM_WHOLE) };

static const channel_row sim_inputs[] = {
  /* table: sim_input_rows */
  INPUT(steer_angle, -1.2, 1.2), INPUT(wheel_torque_front, -100000.0, 100000.0), INPUT(wheel_torque_rear, -100000.0, 100000.0),
  INPUT(brake_torque_front, 0.0, 100000.0), INPUT(brake_torque_rear, 0.0, 100000.0), INPUT(road_level, 0.02, 10.0),
  INPUT(road_friction, 0.0, 2.0),
  /* end of table */
};

enum { SIM_REALS = sizeof sim_reals / sizeof sim_reals[0],
       SIM_WHOLES = sizeof sim_wholes / sizeof sim_wholes[0],
       SIM_INPUTS = sizeof sim_inputs / sizeof sim_inputs[0] };
#undef SIM_REAL
#undef SIM_WHOLE
#undef INPUT
