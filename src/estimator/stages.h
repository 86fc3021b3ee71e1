/* estimator/stages.h - shared declarations: check of a row, alignment of channels with
 * different latencies, start and report of the particle filter. Internal. */
#ifndef TSE_STAGES_H
#define TSE_STAGES_H

#include "model/vehicle.h"
#include "tse/tse.h"

#define MAX_DT TSE_R(TSE_LONGEST_DT) /* [s] max time between two rows */

/* A checked row of the particle filter. Missing values are marked by `use`, `has_inputs`
 * and `has_steer`. Wheel speeds are in m/s. */
typedef struct sample {
  inputs u;           /* steering angle and wheel speeds, or their last values */
  tse_real dt;        /* [s] time since the previous row */
  tse_real y[3];      /* [sigma] accel_x, accel_y, yaw rate, divided by their noise sds; 0 if unused */
  tse_real use[3];    /* 1: used; 0: missing */
  tse_real lost[3];   /* [1] share by which interpolation (align.c) reduces the noise variance */
  int32_t used;       /* number of measurements used: 0 .. 3 */
  int32_t has_inputs; /* 1: the row gives steering angle and both wheel speeds */
  int32_t has_steer;  /* 1: the row gives the steering angle */
} sample;

/* input.c: check a row and convert it to a sample. Inputs that are missing keep their
 * last value. f does not change. */
tse_status input_decode(const tse_params *p, const tse_filter *f, const tse_input *u, sample *y);

/* align.c: store row u, and compose the row of the newest time for which the values of
 * all channels have arrived.
 *   Updated:   f->waiting, unless the result is negative
 *              row         if the result is TSE_OK. It is then a valid row for a step
 *   Returned:  TSE_OK, TSE_W_WAITING if there is no new row yet, or a negative status if
 *              u is refused
 *   O(TSE_LATENCY_ROWS) time. */
tse_status align_row(const tse_params *p, tse_filter *f, const tse_input *u, tse_input *row);

/* start.c: set the initial estimate of the particle filter from the settings. */
void start_of_settings(const tse_params *p, tse_start *s);

/* start.c: report the estimates of the particle filter before its first row. `now` must
 * be filled with 0 before the call. */
void report_start(const tse_params *p, const tse_filter *f, tse_output *now);

/* paper/row.c: process a row with the particle filter. f must be the first member of a
 * tse_filter_paper, because the function casts f to a pointer to that struct. */
tse_status step_particles(const tse_params *p, tse_filter *f, const tse_input *u, tse_output *out);

/* paper/estimate.c: report the present estimates of the particle filter.
 *   Returned:  lam  upper triangle, by rows, of the weighted mean of Lambda/nu over the
 *                   particles. Lambda is a symbol of the paper: scale matrix in the
 *                   distribution of the covariance of the stiffness
 *              nu   degrees of freedom of this distribution */
void report_particles(
    const tse_params *p, const tse_filter *f, tse_output *now, tse_real lam[6], tse_real *nu);

/* learnt.c: return the CRC-32 of `count` bytes. */
uint32_t crc32_of(const uint8_t *bytes, size_t count);

/* Return whether the channel is missing: its bit is set, or its value is NaN. */
static inline int is_missing(const tse_input *u, uint32_t bit, tse_real value)
{
  return (u->missing & bit) != 0 || r_is_nan(value);
}

/* Return whether the filter was reset with these parameters. */
static inline int params_match(const tse_params *p, const tse_filter *f)
{
  return p->magic == TSE_PARAMS_MAGIC && f->magic == TSE_FILTER_MAGIC && f->fingerprint == p->fingerprint;
}

/* Return the more severe of two warnings: the one with the larger code. Neither status
 * may be negative. */
static inline tse_status worse(tse_status a, tse_status b) { return a > b ? a : b; }

#endif
