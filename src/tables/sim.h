/* tables/sim.h - default and range of the simulator's settings, range of what its driver does. Part of host/simulate.c. */
#include "tables/columns.h"
#include "tables/settings.h"
#define SIM_REAL(fmu, name, def, lo, hi, unit, text) { #name, (uint16_t)offsetof(tse_sim_config, name), TSE_S(def), TSE_S(lo), TSE_S(hi) },
#define SIM_WHOLE(fmu, name, def, lo, hi, unit, text) { #name, (uint16_t)offsetof(tse_sim_config, name), def, lo, hi },

static const real_row sim_reals[] = { SETTINGS_SIM(SIM_REAL, NO_ROW) };
static const whole_row sim_wholes[] = { SETTINGS_SIM(NO_ROW, SIM_WHOLE) };

#define SIM_INPUT(name, def, lo, hi, unit, text) { #name, (uint16_t)offsetof(tse_sim_input, name), 1, TSE_R(lo), TSE_R(hi) },
static const channel_row sim_inputs[] = { DRIVER(SIM_INPUT) };

enum { SIM_REALS = sizeof sim_reals / sizeof sim_reals[0],
       SIM_WHOLES = sizeof sim_wholes / sizeof sim_wholes[0],
       SIM_INPUTS = sizeof sim_inputs / sizeof sim_inputs[0] };
#undef SIM_REAL
#undef SIM_WHOLE
#undef SIM_INPUT
