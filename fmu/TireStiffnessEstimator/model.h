/* fmu/TireStiffnessEstimator/model.h - all variables and the state of one estimator. */
#ifndef MODEL_H
#define MODEL_H

#include "tse/tse.h"

typedef struct model {
  tse_config config;                   /* parameters as they are set and read                       */
  int32_t exact;                       /* 1: what is at its start value is that of tse_config_exact() */
  tse_config used;                     /* settings of the filter                                    */
  tse_setting nominal[3];              /* stiffness, N and N/rad                                    */
  tse_input row;                       /* inputs as set                                             */
  uint32_t pedals_given, road_given;   /* the bits of row.given that stand behind those of velocities, of pedals */
  tse_output y;
  tse_setting mean[3], sd[3], spread[3], secant[3]; /* of the stiffness, N and N/rad                           */
  int32_t valid[3], all_valid, grip_valid; /* stiffnesses, all three, grip                          */
  int32_t rows;                        /* 0: the next row is the first                              */
  double time;                         /* [s] of the last row                                       */
  tse_params params;
  tse_filter_paper memory;             /* enough for every form                                     */
} model;

#endif
