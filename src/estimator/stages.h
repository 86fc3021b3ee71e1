/* estimator/stages.h - what the forms of the filter have in common: a checked row, the
 * start, the effects. Internal. */
#ifndef TSE_STAGES_H
#define TSE_STAGES_H

#include "model/vehicle.h"
#include "tse/tse.h"

#define LONGEST_DT TSE_R(TSE_LONGEST_DT) /* s */

/* A checked row: what is missing is marked, wheel speeds are speeds. Nobody changes one:
 * effects make a copy. */
typedef struct sample {
  inputs u;
  tse_real dt;      /* [s]                                                            */
  tse_real y[3];    /* [sigma]  accel_x, accel_y, yaw rate over their sd; 0 if unused */
  tse_real use[3];  /* 1 used, 0 missing                                              */
  tse_real lost[3]; /* [1] share of the noise's variance that interpolation took: align.c              */
  int32_t used;     /* how many of the three                                          */
  int32_t has_inputs;
  int32_t has_steer;
} sample;

/* input.c     row -> sample; the filter supplies held inputs for missing ones. Nothing is
 *             changed. */
tse_status input_decode(const tse_params *p, const tse_filter *f, const tse_input *u, sample *y);

/* align.c     with channels that are logged late: the row of the newest time at which all
 *             are known
 *             Updated:   f->waiting; nothing when the result is negative      row  when
 *                        the result is TSE_OK
 *             Returned:  TSE_OK, TSE_W_WAITING (there is no such row yet), or why u is
 *                        refused; row never is.
 *             O(TSE_LATENCY_ROWS) time. */
tse_status align_row(const tse_params *p, tse_filter *f, const tse_input *u, tse_input *row);

/* start.c     where the first row of a filter with particles starts when nothing was
 *             loaded; its estimates before that row, into an
 *             output that is 0 */
void start_of_settings(const tse_params *p, tse_start *s);
void report_start(const tse_params *p, const tse_filter *f, tse_output *now);

/* paper/row.c         a row of tse_step() in form 1, whose filter is a tse_filter_paper */
tse_status step_particles(const tse_params *p, tse_filter *f, const tse_input *u, tse_output *out);

/* paper/estimate.c            estimates of such a filter now; lam: weighted means of
 *                             Lambda/nu */
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
static inline int belong(const tse_params *p, const tse_filter *f)
{
  return p->magic == TSE_PARAMS_MAGIC && f->magic == TSE_FILTER_MAGIC && f->fingerprint == p->fingerprint;
}

/* Return the larger of two codes that are not negative. */
static inline tse_status worse(tse_status a, tse_status b) { return a > b ? a : b; }

#endif
