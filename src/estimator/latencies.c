/* estimator/latencies.c - find the time to which a processed row refers. If channels
 * have latencies, it is earlier than the time of the newest row (align.c). */
#include "estimator/latencies.h"
#include "estimator/settings.h"

/* Number of rows stored in addition to the rows within the span of the latencies: one
 * before the span and one after it, for interpolation, and two because rows may be
 * closer together than the sample time. Example: at a sample time of 0.01 s a span of
 * 0.28 s has 28 rows. Two more rows suffice if rows are 7 % (2/28) closer together. */
#define ROWS_TO_SPARE 4

#if TSE_LATENCY_ROWS == 0
tse_status check_latencies(const tse_config *c, const char **wrong)
{
  for (int k = 0; k < COUNT_LATENCY; k++) {
    const tse_setting late = real_at(c, &setting_reals[FIRST_LATENCY + k]);
    if (!(late > 0 || late < 0)) continue;
    if (wrong) *wrong = setting_reals[FIRST_LATENCY + k].name;
    return TSE_E_CONFIG;
  }
  return TSE_OK;
}

void prepare_latencies(const tse_config *c, tse_params *p)
{
  p->velocity_late = real_of(c->velocity_latency);
}
#else
/* Read the latency [s] of each channel relative to the yaw rate. The yaw rate itself has
 * the latency 0. */
static void read_latencies(const tse_config *c, tse_setting latency[TSE_CHANNELS])
{
  for (int k = 0; k < COUNT_LATENCY; k++) latency[k] = real_at(c, &setting_reals[FIRST_LATENCY + k]);
  latency[TSE_CHANNEL_yaw_rate] = 0;
}

/* Time to which a processed row refers. The channels have different latencies, so their
 * values for this time were logged at different times.
 *   age       [s] the row refers to the time `age` before the newest row
 *   span      [s] the first of these values was logged `span` before the newest row
 *   earliest  channel with the smallest latency, whose value was logged first
 *   latest    channel with the largest latency */
typedef struct reading_time {
  tse_setting age, span;
  int earliest, latest;
} reading_time;

/* Compute the time to which a processed row refers. It is the newest time for which the
 * values of all channels have arrived, moved back to the last sample of accel_x before
 * it, so that accel_x is not interpolated. The time of this sample is computed from the
 * setting sample_time. If rows are not sample_time apart, accel_x is interpolated.
 *
 * Interpolation would correlate the noise of accel_x in successive rows, and v_x would
 * follow this noise. In a test, interpolation of accel_x by half a row biased the
 * longitudinal stiffness by 8 %, and the filter took the noise for a disturbance.
 * Interpolated noise of accel_y and of the gyro has no such effect
 * (tests/lab/test_latency.py). If accel_x, accel_y and yaw rate come from one IMU,
 * they have the same latency, and none of them is interpolated. */
static reading_time compute_reading_time(const tse_config *c, const tse_setting latency[TSE_CHANNELS])
{
  reading_time r = { 0, 0, (int)TSE_CHANNEL_yaw_rate, (int)TSE_CHANNEL_yaw_rate };
  for (int k = 0; k < (int)TSE_CHANNELS; k++) {
    if (latency[k] < latency[r.earliest]) r.earliest = k;
    if (latency[k] > latency[r.latest]) r.latest = k;
  }
  if (r.earliest == r.latest) return r;
  const tse_setting rows = r_div(latency[r.latest] - latency[TSE_CHANNEL_accel_x], c->sample_time);
  const int32_t whole = r_floor_to_int(rows + TSE_S(0.999)); /* round up; ignore fractions < 0.001 */
  r.age = latency[TSE_CHANNEL_accel_x] + r_mul(r_from_int(whole), c->sample_time);
  if (r.age < latency[r.latest]) r.age = latency[r.latest];
  r.span = r.age - latency[r.earliest];
  return r;
}

tse_status check_latencies(const tse_config *c, const char **wrong)
{
  const tse_setting max_span = r_mul(r_from_int(TSE_LATENCY_ROWS - ROWS_TO_SPARE), c->sample_time);
  tse_setting latency[TSE_CHANNELS];
  read_latencies(c, latency);
  const reading_time r = compute_reading_time(c, latency);
  if (!(r.span > r_mul(max_span, TSE_S(1.0001)))) return TSE_OK; /* tolerance for rounding */
  if (wrong)
    *wrong = setting_reals[FIRST_LATENCY + (latency[r.latest] > -latency[r.earliest] ? r.latest : r.earliest)]
                 .name;
  return TSE_E_CONFIG;
}

void prepare_latencies(const tse_config *c, tse_params *p)
{
  tse_setting latency[TSE_CHANNELS];
  read_latencies(c, latency);
  const reading_time r = compute_reading_time(c, latency);
  p->latency = real_of(r.age);
  /* In a composed row the velocities come from the newest row (align.c), whereas the
   * other values are `age` older. Relative to the other values, the velocities are
   * therefore late by velocity_latency - age, which may be negative. */
  p->velocity_late = real_of(c->velocity_latency - r.age);
  p->latency_span = real_of(r.span);
  p->latency_least = real_of(r_div(r.span, r_from_int(TSE_LATENCY_ROWS - 2)));
  for (int k = 0; k < (int)TSE_CHANNELS; k++) p->latency_age[k] = real_of(r.age - latency[k]);
}
#endif
