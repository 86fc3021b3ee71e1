/* fmu/TireStiffnessEstimator/model.h - all variables and the state of an estimator. */
#ifndef MODEL_H
#define MODEL_H

#include "tse/tse.h"

enum { SETTINGS = sizeof(tse_config) / sizeof(int32_t) }; /* max number of settings */

/* Has the importer set a parameter, and to a value other than its start value? */
enum { NOT_SET, SET_TO_START, SET_TO_ANOTHER };

typedef struct model {
  tse_config config;      /* parameters as set and read */
  int32_t exact;          /* 1: parameters that are not set are those of tse_config_exact() */
  uint8_t set[SETTINGS];  /* NOT_SET .. SET_TO_ANOTHER, by place in config */
  tse_config used;        /* settings of the filter */
  tse_setting nominal[3]; /* [N, N/rad] nominal stiffness */
  tse_input row;          /* inputs as set */
  uint32_t pedals_given;  /* bits of row.given for the pedals, shifted to bit 0 */
  uint32_t road_given;    /* bits of row.given for the road, shifted to bit 0 */
  tse_output y;
  tse_setting mean[3];   /* [N, N/rad] mean stiffness */
  tse_setting sd[3];     /* [N, N/rad] its sd */
  tse_setting spread[3]; /* [N, N/rad] sample-to-sample sd */
  tse_setting secant[3]; /* [N, N/rad] stiffness in effect */
  int32_t valid[3];      /* 1: the stiffness is valid */
  int32_t all_valid;     /* 1: all three are valid */
  int32_t grip_valid;    /* 1: the grip is valid */
  int32_t rows;          /* 0: the next row is the first; else 1 */
  double time;           /* [s] time of the last row */
  tse_params params;
  tse_filter_paper memory; /* large enough for both filters */
} model;

#endif
