/* tests/fuzz/fuzz_replay.c - tse_replay() with any log, car, start and profiles. It
 * refuses an existing row, or all results are finite. It does not write beyond the
 * arrays. The same input gives the same bits. */
#include "fuzz.h"
#include "tse/replay.h"

enum { ROWS = 48 };

static uint64_t run(const uint8_t *data, size_t size)
{
  static tse_real given[16][ROWS], made[16][ROWS + 1];
  bytes b = { data, size };
  tse_config c;
  tse_params p;
  tse_replay_log log = { 0 };
  tse_replay_start s;
  tse_replay_out out = { 0 };
  int32_t wrong = -1, arrays = 0;
  const uint32_t first = take(&b, 1), profiles = take(&b, 1), wanted = take(&b, 1);
  take_settings(&b, &c, 0);
  c.form = 0;
  if (tse_prepare(&c, &p, NULL) < 0) return 0;
  tse_replay_start_default(&s);
  for (uint32_t n = first & 3u; n > 0; n--) {
    const uint32_t which = take(&b, 1);
    (&s.cx_front)[which % (sizeof s / sizeof s.cx_front)] = real_of(
        which & 128u ? take_odd(&b) : take_between(&b, -100, 100));
  }
  road r = road_of(&b);
  const int32_t rows = (int32_t)(take(&b, 1) % (ROWS + 1));
  for (int32_t i = 0; i < ROWS; i++) {
    const uint32_t what = take(&b, 1);
    const tse_input u = what % 8 == 7
        ? wild_row(&b, 1.0)
        : road_row(&r, what % 8 == 6 ? take_between(&b, 0, 1.1) : tse_double_of_setting(c.sample_time));
    given[0][i] = u.dt;
    given[1][i] = u.steer_angle;
    given[2][i] = u.wheel_speed_front;
    given[3][i] = u.wheel_speed_rear;
    for (int k = 4; k < 11; k++)
      given[k][i] = real_of(what & 64u ? take_odd(&b) : 0.05 * sin(0.3 * i + k) * (what & 32u ? 100 : 1));
  }
  for (; arrays < (int32_t)(sizeof log / sizeof log.dt); arrays++) /* the first four are required */
    if (arrays < 4 || (profiles >> (arrays % 8) & 1u)) (&log.dt)[arrays] = given[arrays];
  memset(made, 0x5a, sizeof made);
  arrays = 0;
  for (; arrays < (int32_t)(sizeof out / sizeof out.accel_x); arrays++)
    if (wanted >> arrays & 1u) (&out.accel_x)[arrays] = made[arrays];
  const tse_status status = tse_replay(&p, &log, rows, &s, &out, &wrong);
  MUST(status == TSE_OK || status == TSE_E_TIME || status == TSE_E_INPUT, "status %d", (int)status);
  MUST(status == TSE_OK ? wrong == -1 : wrong >= 0 && wrong < rows, "row %d of %d", (int)wrong, (int)rows);
  tse_real pattern;
  memset(&pattern, 0x5a, sizeof pattern);
  for (int k = 0; k < 8; k++) {
    for (int32_t i = 0; i < ROWS + 1; i++) {
      const int untouched = memcmp(&made[k][i], &pattern, sizeof pattern) == 0;
      if (!(wanted >> k & 1u) || i >= rows)
        MUST(untouched, "array %d was written at %d of %d", k, (int)i, (int)rows);
      else if (status == TSE_OK || (i < wrong && !untouched))
        MUST(is_number(made[k][i]), "array %d at %d is %g", k, (int)i, number(made[k][i]));
      if (status == TSE_E_TIME) MUST(untouched, "a row is refused, and array %d has something", k);
    }
    if (status == TSE_OK && k == 5 && (wanted & 32u))
      for (int32_t i = 1; i < rows; i++)
        MUST(fabs(number(made[5][i])) <= FASTEST_TURN, "yaw rate %g", number(made[5][i]));
  }
  return mixed(mixed(FRESH, made, sizeof made), &status, sizeof status);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
  const uint64_t digest = run(data, size);
  if (size % 4 == 0) MUST(run(data, size) == digest, "another time, other bits");
  return 0;
}
