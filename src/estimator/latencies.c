/* estimator/latencies.c - time at which a row is processed, from the latencies of the
 * channels. */
#include "estimator/settings.h"

/* Rows kept beyond the span of the latencies: one on either side, and two so that rows up
 * to 7 % closer than the sample time are kept (28 of at most 30 rows). */
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
/* Read the latency of each channel. That of the yaw rate is 0: it defines the time. */
static void read_latencies(const tse_config *c, tse_setting latency[TSE_CHANNELS])
{
  for (int k = 0; k < COUNT_LATENCY; k++) latency[k] = real_at(c, &setting_reals[FIRST_LATENCY + k]);
  latency[TSE_CHANNEL_yaw_rate] = 0;
}

/* Time at which a row is processed: the row is `age` older than the newest row, its
 * earliest channel `span` older still. */
typedef struct reading_time {
  tse_setting age, span;
  int earliest, latest;
} reading_time;

/* Compute when a row is processed: when all channels are known, and then at a row of
 * accel_x if rows are sample_time apart. Interpolated noise is correlated with its
 * neighbours and vel_x follows it: half a row of it in accel_x biased the longitudinal
 * stiffness by 8 % and was taken for a disturbance. Noise of accel_y and gyro has no such
 * effect (tests/lab/test_latency.py). If all three come from one IMU, none is
 * interpolated. */
static reading_time compute_reading_time(const tse_config *c, const tse_setting latency[TSE_CHANNELS])
{
  reading_time r = { 0, 0, (int)TSE_CHANNEL_yaw_rate, (int)TSE_CHANNEL_yaw_rate };
  for (int k = 0; k < (int)TSE_CHANNELS; k++) {
    if (latency[k] < latency[r.earliest]) r.earliest = k;
    if (latency[k] > latency[r.latest]) r.latest = k;
  }
  if (r.earliest == r.latest) return r;
  const tse_setting rows = r_div(latency[r.latest] - latency[TSE_CHANNEL_accel_x], c->sample_time);
  const int32_t whole = r_floor_to_int(rows + TSE_S(0.999)); /* 3.001 counts as 3: rounding of decimals */
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
  if (!(r.span > r_mul(max_span, TSE_S(1.0001)))) return TSE_OK; /* 28 times 0.01 is rounded */
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
  p->velocity_late = real_of(c->velocity_latency - r.age); /* a velocity does not wait */
  p->latency_span = real_of(r.span);
  p->latency_least = real_of(r_div(r.span, r_from_int(TSE_LATENCY_ROWS - 2)));
  for (int k = 0; k < (int)TSE_CHANNELS; k++) p->latency_age[k] = real_of(r.age - latency[k]);
}
#endif
