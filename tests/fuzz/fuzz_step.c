/* tests/fuzz/fuzz_step.c - any drives through both filters: gaps, random values, stuck
 * and missing channels, restarts, copies of the filter, learnt states. Refused rows
 * change nothing. Other rows give valid estimates and a state that tse_filter_check()
 * accepts. The same input gives the same bits. */
#include "model/state.h"
#include "fuzz.h"

#define MOST_ROWS 160 /* max rows of an input; with sanitizers a second has about 2000 rows */

typedef struct drive {
  tse_config c;
  tse_params p;
  tse_filter_paper f, before;
  size_t bytes;
  uint64_t digest;
  int rows;
} drive;
static drive d;

/* Run a row and check the results. */
static void step(const tse_input *u)
{
  tse_output y, untouched;
  if (d.rows++ >= MOST_ROWS) return;
  memset(&y, 0x5a, sizeof y);
  untouched = y;
  memcpy(&d.before, &d.f, d.bytes);
  const tse_status status = tse_step(&d.p, &d.f.filter, u, &y);
  d.digest = mixed(d.digest, &status, sizeof status);
  if (status < 0) {
    MUST(status == TSE_E_INPUT || status == TSE_E_TIME, "refused with %d", (int)status);
    MUST(memcmp(&d.before, &d.f, d.bytes) == 0, "a refused row changed the filter");
    MUST(memcmp(&untouched, &y, sizeof y) == 0, "a refused row changed the estimates");
    return;
  }
  MUST(
      tse_input_check(u, NULL) == TSE_OK || !d.before.filter.started, "a row that is not to be accepted was");
  must_be_estimates(&d.c, &y, (int)status);
  d.digest = mixed(d.digest, &y, offsetof(tse_output, grip_reason));
  MUST(tse_filter_check(&d.p, &d.f.filter, d.bytes) == TSE_OK, "its own state is refused, step %u",
      (unsigned)d.f.filter.step);
}

/* Check that the filter and a copy of it give the same result for the same row. */
static void go_on_from_a_copy(const tse_input *u)
{
  static tse_filter_paper copy;
  tse_output a, b;
  memset(&a, 0, sizeof a);
  memset(&b, 0, sizeof b);
  memcpy(&copy, &d.f, d.bytes);
  const tse_status first = tse_step(&d.p, &copy.filter, u, &a), second = tse_step(&d.p, &d.f.filter, u, &b);
  MUST(first == second && memcmp(&a, &b, sizeof a) == 0 && memcmp(&copy, &d.f, d.bytes) == 0,
      "a copy goes on otherwise");
  memcpy(&d.f, &copy, d.bytes);
}

/* Save the learnt state and load it into a new drive. */
static void to_the_next_drive(uint32_t age)
{
  uint8_t learnt[TSE_LEARNT_BYTES];
  const tse_status saved = tse_learnt_save(&d.p, &d.f.filter, learnt);
  MUST(saved == TSE_OK || (saved == TSE_E_STATE && !d.f.filter.started), "saved: %d", (int)saved);
  MUST(tse_reset(&d.p, &d.f.filter, d.bytes) == TSE_OK, "reset");
  if (saved != TSE_OK) return;
  const tse_status loaded = tse_learnt_load(&d.p, &d.f.filter, learnt, sizeof learnt, age);
  MUST(loaded == TSE_OK, "what was just saved is refused with %d", (int)loaded);
  MUST(tse_filter_check(&d.p, &d.f.filter, d.bytes) == TSE_OK, "refused after loading");
}

static uint64_t run(const uint8_t *data, size_t size)
{
  bytes b = { data, size };
  tse_input last;
  d.rows = 0;
  d.digest = FRESH;
  const uint32_t first = take(&b, 1);
  take_settings(&b, &d.c, 0);
  d.c.form = (int32_t)(first % 5 < 3 ? 0 : 1); /* more often the Kalman filter */
  if (d.c.form) d.c.particles = 16 + (int32_t)(first >> 3) % (TSE_MAX_PARTICLES - 15);
  if (tse_prepare(&d.c, &d.p, NULL) < 0) return 0; /* latencies, a formula: fuzz_settings.c */
  d.bytes = d.c.form ? sizeof(tse_filter_paper) : sizeof(tse_filter);
  MUST(tse_reset(&d.p, &d.f.filter, d.bytes) == TSE_OK, "reset");
  road r = road_of(&b);
  last = road_row(&r, 0.01);
  while (b.left > 0 && d.rows < MOST_ROWS) {
    const uint32_t what = take(&b, 1);
    tse_input u = road_row(&r, tse_double_of_setting(d.c.sample_time));
    switch (what & 15u) {
      case 0:
      case 1:
      case 2: /* undisturbed rows */
        for (uint32_t k = 0; k < 1 + (what >> 3); k++) {
          u = road_row(&r, tse_double_of_setting(d.c.sample_time));
          step(&u);
        }
        break;
      case 3:
        u = wild_row(&b, 1.0);
        step(&u);
        break;
      case 4:
        u = wild_row(&b, 1.1);
        u.dt = real_of(take_between(&b, 0, 0.2));
        step(&u);
        break;
      case 5:
        *channel_of(&u, take(&b, 1)) = real_of(take_odd(&b));
        step(&u);
        break;
      case 6:
        u.missing = take(&b, 1);
        step(&u);
        break;
      case 7:
        u.dt = real_of(what & 16u ? take_odd(&b) : pow(10, take_between(&b, -4, 3.6)));
        step(&u);
        break;
      case 8: /* one channel stuck, or all */
        for (uint32_t k = 0, which = take(&b, 1); k < 1 + (what >> 4); k++) {
          u = road_row(&r, tse_double_of_setting(d.c.sample_time));
          if (which & 8u) u = last;
          else *channel_of(&u, which) = *channel_of(&last, which);
          step(&u);
        }
        break;
      case 9: r = road_of(&b); break;
      case 10: r.yaw_offset = take_between(&b, -6, 6); break;
      case 11: MUST(tse_reset(&d.p, &d.f.filter, d.bytes) == TSE_OK, "reset"); break;
      case 12: go_on_from_a_copy(&u); break;
      case 13: to_the_next_drive(what & 16u ? 0xffffffffu : take(&b, 4)); break;
      case 14: /* a channel jumps between the limits of its range */
        for (uint32_t k = 0, which = take(&b, 1); k < 1 + (what >> 5); k++) {
          u = road_row(&r, tse_double_of_setting(d.c.sample_time));
          *channel_of(&u, which) = real_of((k & 1u ? -1 : 1)
              * (which % TSE_CHANNELS == 0       ? 1.2
                      : which % TSE_CHANNELS < 3 ? 400
                      : which % TSE_CHANNELS < 5 ? 50
                                                 : 6));
          step(&u);
        }
        break;
      default: /* no measurement, or standstill */
        for (uint32_t k = 0; k < 1 + (what >> 3); k++) {
          u = road_row(&r, tse_double_of_setting(d.c.sample_time));
          if (what & 16u) u.missing = 56;
          else u.wheel_speed_front = u.wheel_speed_rear = 0;
          step(&u);
        }
        break;
    }
    last = u;
  }
  return mixed(d.digest, &d.f, d.bytes);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
  const uint64_t digest = run(data, size);
  if (size % 4 == 0) MUST(run(data, size) == digest, "another time, other bits");
  return 0;
}
