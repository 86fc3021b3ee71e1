/* estimator/align.c - align channels that have different latencies (settings
 * ..._latency): compose a row whose channels refer to the same time.
 *
 * L is the largest latency of all channels, or 0 if no channel is late. At the time `now`
 * the values of all channels have arrived for times up to now - L. The composed row
 * refers to the time of the last value of accel_x at or before now - L, so that accel_x
 * need not be interpolated (latencies.c). The value of channel c for this time was logged
 * latency_age[c] [s] before now. It is interpolated linearly between the stored rows. dt
 * of a composed row is the time since the previous composed row.
 *
 * Interpolation between two rows with the weights w and 1 - w multiplies the variance of
 * white noise by w^2 + (1 - w)^2, and correlates the noise of neighbouring rows. At low
 * frequencies, from which stiffness and biases are estimated, the noise stays the same.
 * The filters assume that the noise of different rows is independent. With the smaller
 * variance they would be overconfident, and take the correlated noise for a disturbance.
 * The particle filter therefore uses the noise sd of the settings also for interpolated
 * values. The default filter does not: it estimates the noise variance of each channel
 * from the composed rows. */
#include "estimator/stages.h"
#include "tables/input.h"

#if TSE_LATENCY_ROWS > 0

#define SAME_TIME TSE_R(2e-5) /* [s] times that differ by less count as equal: sums of dt and the
                              * times in logs are rounded. At a jerk of 50 m/s3, as in an
                              * emergency manoeuvre, accel_x and accel_y change by 0.001 m/s2
                              * in this time */

/* [s] If a channel is missing in some rows, it is interpolated between two of its
 * values that are at most this far apart. It is not interpolated between values that are
 * further apart. */
#define MAX_HOLE TSE_R(0.1)

/* Return the index in the ring of the row before or after the one at index `at`. */
static int32_t get_previous_index(int32_t at) { return at > 0 ? at - 1 : TSE_LATENCY_ROWS - 1; }
static int32_t get_next_index(int32_t at) { return at + 1 < TSE_LATENCY_ROWS ? at + 1 : 0; }

/* Append a row to the ring. A value out of range is stored as missing.
 *   Given:  before  [s] time since the row that is the newest in the ring so far */
static void store_row(tse_alignment *m, const tse_input *u, tse_real before)
{
  const int32_t at = m->count > 0 ? get_next_index(m->newest) : 0;
  uint32_t missing = 0;
  for (int k = 0; k < (int)TSE_CHANNELS; k++) {
    const tse_real x = channel_at(u, &channel_rows[k]);
    const int ok = (u->missing & 1u << k) == 0 && channel_holds(&channel_rows[k], x);
    m->value[at][k] = ok ? x : TSE_R(0);
    missing |= ok ? 0u : 1u << k;
  }
  m->missing[at] = (uint8_t)missing;
  m->before[at] = m->count > 0 ? before : TSE_R(0);
  m->newest = at;
  if (m->count < TSE_LATENCY_ROWS) m->count++;
}

/* Return whether the stored rows are enough to read all channels. The channel with the
 * smallest latency is read latency_span before the newest row. The rows must reach
 * back to this time. */
static int spans_latencies(const tse_params *p, const tse_alignment *m)
{
  tse_real age = TSE_R(0);
  int32_t at = m->newest;
  for (int32_t n = 1; n <= m->count; n++) {
    if (!(age + SAME_TIME < p->latency_span)) return 1;
    age += m->before[at];
    at = get_previous_index(at);
  }
  return 0;
}

/* Find the value of channel c that is nearest to row `at`, among older or newer rows. The
 * caller interpolates between this value and the value of a row R.
 *   Given:     at     index of the row next to which the search starts
 *              back   1: search older rows; 0: search newer rows
 *              rows   number of rows to search
 *   Updated:   apart  [s] before the call: time between R and row `at`; after the call:
 *                     time between R and the row of the value
 *   Returned:  1 and *value; 0 if no value is within MAX_HOLE of R */
static int find_value(
    const tse_alignment *m, int c, int32_t at, int back, int32_t rows, tse_real *apart, tse_real *value)
{
  for (int32_t n = 0; n < rows; n++) {
    const int32_t next = back ? get_previous_index(at) : get_next_index(at);
    *apart += m->before[back ? at : next];
    if (*apart > MAX_HOLE + SAME_TIME) return 0;
    at = next;
    if ((m->missing[at] & 1u << c) != 0) continue;
    *value = m->value[at][c];
    return 1;
  }
  return 0;
}

/* Interpolate channel c at a requested time between row `at`, the n-th newest, and the
 * row before it. One of these two rows is nearer to the requested time. There are three
 * cases.
 *   1. The nearer row has no value of the channel: the result is missing.
 *   2. Both rows have a value: interpolate between them.
 *   3. Only the farther row has no value: search beyond it for the next row with a value,
 *      and interpolate between that row and the nearer row. If no row within MAX_HOLE of
 *      the nearer row has a value, take the value of the nearer row.
 * Because of case 1, a channel that is logged in every second row is missing in every
 * second composed row.
 *   Given:     share  weight of row `at`
 *   Returned:  as read_channel() */
static int interpolate_rows(
    const tse_alignment *m, int c, int32_t at, int32_t n, tse_real share, tse_real *value, tse_real *lost)
{
  const int32_t from = get_previous_index(at), back = share > TSE_R(0.5), here = back ? at : from,
                there = back ? from : at;
  const int both = ((m->missing[from] | m->missing[at]) & 1u << c) == 0;
  tse_real a = m->value[from][c], b = m->value[at][c], apart = m->before[at];
  if (!both) {
    if ((m->missing[here] & 1u << c) != 0) return 0;
    share = back ? TSE_R(1) - share : share;
    a = b = m->value[here][c];
    share = find_value(m, c, there, back, back ? m->count - 1 - n : n - 1, &apart, &b)
        ? r_mul(share, r_div(m->before[at], apart))
        : TSE_R(0);
  }
  *lost = r_mul(r_mul(TSE_R(2), share), TSE_R(1) - share);
  *value = r_clamp(a + r_mul(share, b - a), r_min(a, b), r_max(a, b));
  return 1;
}

/* Interpolate channel c at the time `age` before the newest row.
 *   Returned:  1 if it is known; 0 if it is missing, *value is then 0
 *              *lost  share of the noise variance that interpolation removes */
static int read_channel(const tse_alignment *m, int c, tse_real age, tse_real *value, tse_real *lost)
{
  tse_real later = TSE_R(0);
  int32_t at = m->newest;
  *lost = *value = TSE_R(0);
  for (int32_t n = 1; n < m->count && later + SAME_TIME < age; n++) {
    const tse_real next = later + m->before[at];
    if (age + SAME_TIME < next)
      return interpolate_rows(m, c, at, n, r_div(next - age, m->before[at]), value, lost);
    later = next;
    at = get_previous_index(at);
  }
  *value = m->value[at][c];
  return (m->missing[at] & 1u << c) == 0;
}

/* Compose the row that a step processes: read each channel at its age p->latency_age, so
 * that all values refer to the same time.
 *   Updated:   m->lost, for each IMU channel the share of its noise variance that
 *              interpolation removes
 *   Returned:  row */
static void compose_row(const tse_params *p, tse_alignment *m, const tse_input *u, tse_input *row)
{
  tse_real lost[TSE_CHANNELS];
  row->dt = m->since > TSE_R(0) ? m->since : p->sample_time; /* the first step ignores dt */
  row->missing = 0;
  for (int k = 0; k < (int)TSE_CHANNELS; k++) {
    tse_real x;
    if (!read_channel(m, k, p->latency_age[k], &x, &lost[k])) row->missing |= 1u << k;
    memcpy((uint8_t *)row + channel_rows[k].at, &x, sizeof x);
  }
  for (int a = 0; a < 3; a++) m->lost[a] = lost[(int)TSE_CHANNEL_accel_x + a];
  /* copy the optional channels from the newest row, without interpolation. The filter
   * corrects measured velocities for the time from the composed row to the newest row
   * (tse_params.velocity_late). It uses pedals, grade and bank as if they belonged to the
   * composed row: grade and bank change little within 0.2 s, the max of the settings
   * ..._latency */
  row->given = u->given;
  for (int k = 0; k < (int)TSE_OPTIONALS; k++) {
    const tse_real x = channel_at(u, &optional_rows[k]);
    memcpy((uint8_t *)row + optional_rows[k].at, &x, sizeof x);
  }
}

tse_status align_row(const tse_params *p, tse_filter *f, const tse_input *u, tse_input *row)
{
  tse_alignment *const m = &f->waiting;
  const int first = m->count == 0;
  tse_input given = *u;
  if (first) given.dt = p->sample_time; /* the first row has no predecessor */
  const tse_status status = tse_input_check(&given, NULL);
  if (status < 0) return status;
  if (first) {
    for (int a = 0; a < 4; a++) m->reason[a] = (int32_t)TSE_STARTING;
  } else {
    m->since = r_min(r_add_sat(m->since, given.dt), MAX_DT);
    m->unkept = r_min(r_add_sat(m->unkept, given.dt), MAX_DT);
    if (given.dt > p->max_gap) { /* no interpolation across a gap: discard the rows before it */
      m->count = 0;
      for (int a = 0; a < 4 && f->step > 0; a++) m->reason[a] = (int32_t)TSE_INPUT_INVALID;
    } else if (m->unkept < p->latency_least) return TSE_W_WAITING;
  }
  store_row(m, &given, m->unkept);
  m->unkept = TSE_R(0);
  if (!spans_latencies(p, m)) return TSE_W_WAITING;
  compose_row(p, m, u, row);
  m->since = TSE_R(0);
  return TSE_OK;
}

#endif
