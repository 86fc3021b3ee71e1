/* fmu/SingleTrackVehicle/model.h - all variables and the state of a simulated vehicle. */
#ifndef MODEL_H
#define MODEL_H

#include "tse/simulate.h"

#if !defined(TSE_REAL_DOUBLE)
#error "the vehicle is the reference in studies: build it with TSE_REAL=double"
#endif

typedef struct model {
  tse_config config;
  tse_sim_config sim_config;
  tse_sim_input u;    /* inputs as set */
  tse_sim_input rate; /* their time derivatives, for the next step */
  int32_t ramp;       /* 1: inputs change linearly during a step; 0: they jump at its start */
  tse_sim_output y;
  tse_setting mean_si[3];  /* [N, N/rad] true mean stiffness */
  tse_setting drawn_si[3]; /* [N, N/rad] stiffness drawn for this row */
  tse_sim sim;
} model;

#endif
