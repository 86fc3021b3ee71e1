/* fmu/SingleTrackVehicle/model.h - all variables and the state of one simulated vehicle. */
#ifndef MODEL_H
#define MODEL_H

#include "tse/simulate.h"

#if !defined(TSE_REAL_DOUBLE)
#error "the car is the truth for studies: it is built with TSE_REAL=double"
#endif

typedef struct model {
  tse_config config;
  tse_sim_config sim_config;
  tse_sim_input u, rate; /* inputs as set, and their time derivatives        */
  int32_t ramp;
  tse_sim_output y;
  tse_setting mean_si[3], drawn_si[3]; /* true stiffness, N and N/rad                      */
  tse_sim sim;
} model;

#endif
