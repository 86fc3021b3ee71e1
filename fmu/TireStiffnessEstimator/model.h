/* fmu/TireStiffnessEstimator/model.h - all variables and the state of one estimator. */
#ifndef MODEL_H
#define MODEL_H

#include "tse/tse.h"

typedef struct model {
  tse_config config;
  tse_input row;                       /* inputs as set                                             */
  tse_output y;
  tse_setting mean[3], sd[3], spread[3]; /* of the stiffness, N and N/rad                           */
  int32_t valid[3], all_valid;
  int32_t rows;                        /* 0: the next row is the first                              */
  double time;                         /* [s] of the last row                                       */
  tse_params params;
  tse_filter_paper memory;             /* enough for every form                                     */
} model;

#endif
