/* fmu/TireStiffnessEstimator/model.h - all variables and the state of one estimator. */
#ifndef MODEL_H
#define MODEL_H

#include "tse/tse.h"

enum { SETTINGS = sizeof(tse_config) / sizeof(int32_t) }; /* places for a setting */

/* A parameter: has the importer set it, to its start value or to another one? */
enum { NOT_SET, SET_TO_START, SET_TO_ANOTHER };

typedef struct model {
  tse_config config;      /* parameters as they are set and read                       */
  int32_t exact;          /* 1: what is not set is that of tse_config_exact()          */
  uint8_t set[SETTINGS];  /* by place in config                                        */
  tse_config used;        /* settings of the filter                                    */
  tse_setting nominal[3]; /* stiffness, N and N/rad                                    */
  tse_input row;          /* inputs as set                                             */
  uint32_t pedals_given,
      road_given; /* the bits of row.given that stand behind those of velocities, of pedals */
  tse_output y;
  tse_setting mean[3], sd[3], spread[3],
      secant[3];                           /* of the stiffness, N and N/rad                           */
  int32_t valid[3], all_valid, grip_valid; /* stiffnesses, all three, grip                          */
  int32_t rows;                            /* 0: the next row is the first                              */
  double time;                             /* [s] of the last row                                       */
  tse_params params;
  tse_filter_paper memory; /* enough for every form                                     */
} model;

#endif
