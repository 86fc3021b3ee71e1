/* estimator/stages.h - stages that both filters share: checked row, start, effects.
 * Internal. */
#ifndef TSE_STAGES_H
#define TSE_STAGES_H

#include "model/vehicle.h"
#include "tse/tse.h"

#define MAX_DT TSE_R(TSE_LONGEST_DT) /* s: max time between two rows */

/* A checked row: missing values are marked, wheel speeds are in m/s. Read-only; effects
 * work on a copy. */
typedef struct sample {
  inputs u;
  tse_real dt;      /* [s]                                                            */
  tse_real y[3];    /* [sigma] accel_x, accel_y, yaw rate over their sd; 0 if unused */
  tse_real use[3];  /* 1 used, 0 missing */
  tse_real lost[3]; /* [1] share of the noise variance lost by interpolation (align.c) */
  int32_t used;     /* number of those used */
  int32_t has_inputs;
  int32_t has_steer;
} sample;

/* input.c: convert a row to a sample. Missing inputs keep their last value. f is
 * unchanged. */
tse_status input_decode(const tse_params *p, const tse_filter *f, const tse_input *u, sample *y);

/* align.c: compose the row of the newest time at which all channels are known.
 *   Updated:   f->waiting, unless the result is negative
 *              row         if the result is TSE_OK
 *   Returned:  TSE_OK; TSE_W_WAITING: no new row yet; negative: u is refused. row itself is
 *              never refused.
 *   O(TSE_LATENCY_ROWS) time. */
tse_status align_row(const tse_params *p, tse_filter *f, const tse_input *u, tse_input *row);

/* start.c: initial estimate of the particle filter from the settings; its estimates
 * before the first row. now must be 0. */
void start_of_settings(const tse_params *p, tse_start *s);
void report_start(const tse_params *p, const tse_filter *f, tse_output *now);

/* paper/row.c: step of the particle filter; f is part of a tse_filter_paper */
tse_status step_particles(const tse_params *p, tse_filter *f, const tse_input *u, tse_output *out);

/* paper/estimate.c: current estimates of the particle filter. Returned: lam  weighted
 * means of Lambda/nu */
void report_particles(
    const tse_params *p, const tse_filter *f, tse_output *now, tse_real lam[6], tse_real *nu);

/* learnt.c */
uint32_t crc32_of(const uint8_t *bytes, size_t count);

/* Return whether the channel is missing, by its bit or as NaN. */
static inline int is_missing(const tse_input *u, uint32_t bit, tse_real value)
{
  return (u->missing & bit) != 0 || r_is_nan(value);
}

/* Return whether the filter was reset with these parameters. */
static inline int params_match(const tse_params *p, const tse_filter *f)
{
  return p->magic == TSE_PARAMS_MAGIC && f->magic == TSE_FILTER_MAGIC && f->fingerprint == p->fingerprint;
}

/* Return the larger of two codes that are not negative. */
static inline tse_status worse(tse_status a, tse_status b) { return a > b ? a : b; }

#endif
