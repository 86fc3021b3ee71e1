/* filter/output.h - output of a row: estimates, and whether they are valid. Internal. */
#ifndef TSE_FILTER_OUTPUT_H
#define TSE_FILTER_OUTPUT_H

#include "filter/types.h"

/* Classification of a row. */
typedef struct row_class {
  int gap;       /* 1: the motion cannot be predicted from the previous row to this one */
  int sparse;    /* 1: gaps are more frequent than MAX_GAP_RATE, so that no estimate is valid */
  int held;      /* 1: no stiffness is updated: car slow, in reverse, or steering angle large */
  int predicted; /* 1: the row has no steering angle or no IMU channel, or the motion is unknown
                  * (tse_filter.lost) */
  int no_second; /* 1: the wheel speeds of the two axles cannot be compared (decoded.no_second) */
  int rolls;     /* freely rolling axle: ROLLS_* */
} row_class;

/* Write the estimates and the probabilities of this row to out. */
STAGE void report_row(const tse_params *p, const tse_kalman *k, tse_output *out);

/* Write to out, for each stiffness and the grip, whether it is valid or why it is not. */
void judge_row(const tse_params *p, const tse_kalman *k, const row_class *w, tse_output *out);

#endif
