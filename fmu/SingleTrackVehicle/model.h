/* fmu/SingleTrackVehicle/model.h - variables and state of the simulated vehicle. */
#ifndef MODEL_H
#define MODEL_H

#include "tse/simulate.h"

#if !defined(TSE_REAL_DOUBLE)
#error "SingleTrackVehicle is the reference of studies and needs double: build it with TSE_REAL=double"
#endif

typedef struct model {
  tse_config config;
  tse_sim_config sim_config;
  tse_sim_input u;         /* inputs that the importer has set */
  tse_sim_input rate;      /* [unit of the input / s] time derivatives of the inputs for the next step */
  int32_t ramp;            /* 1: inputs change linearly during a step; 0: they jump at its start */
  tse_sim_output y;        /* row at the last communication point */
  tse_setting mean_si[3];  /* [N, N/rad, N/rad] true mean stiffness at this row */
  tse_setting drawn_si[3]; /* [N, N/rad, N/rad] true stiffness of this row, drawn at random about mean_si */
  tse_sim sim;
} model;

#endif
