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
  tse_sim_input u;    /* inputs that the importer has set */
  tse_sim_input rate; /* [unit of the input / s] time derivatives of the inputs for the next step */
  int32_t ramp;       /* 1: inputs change linearly during a step; 0: they jump at its start */
  tse_sim_output y;   /* log row and true values at the last communication point */
  /* True stiffness at the row y. Order: TSE_CX_FRONT, TSE_CY_FRONT, TSE_CY_REAR */
  tse_setting mean_si[3];  /* [N, N/rad, N/rad] mean of the distribution of drawn_si */
  tse_setting drawn_si[3]; /* [N, N/rad, N/rad] stiffness that was drawn at random for this row */
  tse_sim sim;
} model;

#endif
