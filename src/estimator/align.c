/* estimator/align.c - align channels with different latencies (settings ..._latency) to
 * one row of one time.
 *
 * L: latency of the latest channel, 0 if no channel is late. All channels are known up to
 * now - L. A row refers to that time, or to the row of accel_x before it (latencies.c).
 * Channel c is read from the rows kept, latency_age_c before now, by linear
 * interpolation. The time step is that of the rows.
 *
 * White noise interpolated between two rows with weights w and 1 - w has the variance w^2
 * + (1 - w)^2. The lost part, 2 w (1 - w), becomes correlation with the neighbours: at
 * the low frequencies from which stiffness and biases are learnt, the noise is as large
 * as before. The sd of a channel therefore stays the setting's. With the smaller
 * variance, a filter that assumes independent rows is overconfident and takes the
 * correlation for a disturbance. The default filter estimates the noise of a channel from
 * its rows and adds the lost part. */
#include "estimator/stages.h"
#include "tables/input.h"

#if TSE_LATENCY_ROWS > 0

#define SAME_TIME TSE_R(2e-5) /* s: tolerance of a row's time, because sums of dt and clocks are rounded. At
                               * 50 m/s3, the jerk of an emergency manoeuvre, a channel changes by 0.001
                               * m/s2 in it */

#define MAX_HOLE TSE_R(0.1) /* s: max time between two values of a channel logged in some rows only */

/* Return the index in the ring of the row before, or after, the one at `at`. */
static int32_t index_before(int32_t at) { return at > 0 ? at - 1 : TSE_LATENCY_ROWS - 1; }
static int32_t index_after(int32_t at) { return at + 1 < TSE_LATENCY_ROWS ? at + 1 : 0; }

/* Append a row to the ring, `before` seconds after the newest one. A value out of range
 * is stored as missing. */
static void store_row(tse_alignment *m, const tse_input *u, tse_real before)
{
  const int32_t at = m->count > 0 ? index_after(m->newest) : 0;
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

/* Return whether the stored rows span all latencies. */
static int spans_latencies(const tse_params *p, const tse_alignment *m)
{
  tse_real age = TSE_R(0);
  int32_t at = m->newest;
  for (int32_t n = 1; n <= m->count; n++) {
    if (!(age + SAME_TIME < p->latency_span)) return 1;
    age += m->before[at];
    at = index_before(at);
  }
  return 0;
}

/* Find the nearest value of channel c on one side of a row.
 *   Given:     at    the row
 *              back  1 older rows, 0 newer rows
 *              rows  number of rows on that side
 *   Updated:   apart  [s] distance to a row; on return that of the row found
 *   Returned:  1 and *value; 0 if there is no value within MAX_HOLE */
static int find_value(
    const tse_alignment *m, int c, int32_t at, int back, int32_t rows, tse_real *apart, tse_real *value)
{
  for (int32_t n = 0; n < rows; n++) {
    const int32_t next = back ? index_before(at) : index_after(at);
    *apart += m->before[back ? at : next];
    if (*apart > MAX_HOLE + SAME_TIME) return 0;
    at = next;
    if ((m->missing[at] & 1u << c) != 0) continue;
    *value = m->value[at][c];
    return 1;
  }
  return 0;
}

/* Interpolate channel c between row `at`, which is n - 1 older than the newest, and the
 * row before it. Where one of the two lacks it, the nearer one decides whether it is
 * known: a channel logged in every second row is then known as often, and at its time.
 *   Given:     share  weight of the newer row
 *   Returned:  as read_channel() */
static int interpolate_rows(
    const tse_alignment *m, int c, int32_t at, int32_t n, tse_real share, tse_real *value, tse_real *lost)
{
  const int32_t from = index_before(at), back = share > TSE_R(0.5), here = back ? at : from,
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

/* Interpolate channel c to `age` before the newest row.
 *   Returned:  1 known, 0 missing (*value is then 0)
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
    at = index_before(at);
  }
  *value = m->value[at][c];
  return (m->missing[at] & 1u << c) == 0;
}

/* Compose the row of the newest time at which all channels are known. Updated: m->lost */
static void compose_row(const tse_params *p, tse_alignment *m, const tse_input *u, tse_input *row)
{
  tse_real lost[TSE_CHANNELS];
  row->dt = m->since > TSE_R(0) ? m->since : p->sample_time; /* the first row does not use it */
  row->missing = 0;
  for (int k = 0; k < (int)TSE_CHANNELS; k++) {
    tse_real x;
    if (!read_channel(m, k, p->latency_age[k], &x, &lost[k])) row->missing |= 1u << k;
    memcpy((uint8_t *)row + channel_rows[k].at, &x, sizeof x);
  }
  for (int a = 0; a < 3; a++) m->lost[a] = lost[(int)TSE_CHANNEL_accel_x + a];
  /* these do not wait: the latency of a velocity is modelled (velocity_late), and a road
   * changes little within 0.2 s */
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
