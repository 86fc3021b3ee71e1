/* fmu/TireStiffnessEstimator/model.h - variables and state of the estimator. */
#ifndef MODEL_H
#define MODEL_H

#include "tse/tse.h"

enum { SETTINGS = sizeof(tse_config) / sizeof(int32_t) }; /* max number of settings */

/* What the importer has done to a parameter: not set it, set it to its start value, or
 * set it to a different value. */
enum { NOT_SET, SET_TO_START, SET_TO_ANOTHER };

/* Arrays of three are in the order of TSE_CX_FRONT, TSE_CY_FRONT, TSE_CY_REAR. */
typedef struct model {
  tse_config config;      /* values of the parameters as the importer sees them */
  int32_t exact;          /* 1: in `used`, a parameter that the importer has not set has the value of
                           * tse_config_exact(). 0: it has its start value */
  uint8_t set[SETTINGS];  /* NOT_SET .. SET_TO_ANOTHER. Index: offset of the parameter in config / 4 */
  tse_config used;        /* settings with which the filter runs */
  tse_setting nominal[3]; /* [N, N/rad, N/rad] nominal stiffness */
  tse_input row;          /* inputs that the importer has set */
  uint32_t pedals_given;  /* input pedals.given: bit 0 brake, 1 wheel_torque_front, 2 wheel_torque_rear */
  uint32_t road_given;    /* input road.given: bit 0 bank, 1 grade */
  tse_output y;           /* outputs of the last row */
  tse_setting mean[3];    /* [N, N/rad, N/rad] estimated mean stiffness */
  tse_setting sd[3];      /* [N, N/rad, N/rad] sd of the mean stiffness */
  tse_setting spread[3];  /* [N, N/rad, N/rad] tse_output.stiffness_spread, converted from relative to SI */
  tse_setting secant[3];  /* [N, N/rad, N/rad] secant stiffness: force / slip, force / slip angle */
  int32_t valid[3];       /* 1: the stiffness is valid */
  int32_t all_valid;      /* 1: all three stiffnesses are valid */
  int32_t grip_valid;     /* 1: the grip is valid */
  int32_t rows;           /* 0: no row has been processed; 1: there has been a row */
  double time;            /* [s] time of the last row */
  tse_params params;
  tse_filter_paper memory; /* the particle filter; the Kalman filter uses only its first member */
} model;

#endif
