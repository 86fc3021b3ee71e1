/* tests/fuzz/fuzz_state.c - a forged filter state. tse_filter_check() refuses it, or
 * tse_step() continues without memory errors and with finite estimates. */
#include "fuzz.h"

static tse_filter_paper f;

/* Replace a few members by any bytes or by a forged number. */
static void forge(bytes *b, uint8_t *at, size_t count)
{
  for (uint32_t n = 1 + (take(b, 1) & 7u); n > 0; n--) {
    const uint32_t how = take(b, 1);
    const size_t words = count / sizeof(tse_real);
    uint8_t *const where = at + (take(b, 4) % words) * sizeof(tse_real);
    tse_real x;
    int32_t whole = (int32_t)take(b, 1);
    memcpy(&x, where, sizeof x);
    switch (how & 7u) {
      case 0: memcpy(where, &whole, sizeof whole); break;
      case 1:
        whole = -whole;
        memcpy(where + (how & 8u ? sizeof(tse_real) - 4 : 0), &whole, sizeof whole);
        break;
      case 6:
        for (size_t i = 0; i < sizeof x; i++) where[i] = (uint8_t)take(b, 1);
        break;
      default: x = real_of(forged(b, how, number(x))); memcpy(where, &x, sizeof x);
    }
  }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
  bytes b = { data, size };
  tse_config c;
  tse_params p;
  const uint32_t first = take(&b, 1);
  take_settings(&b, &c, 0);
  c.form = (int32_t)(first % 5 < 3 ? 0 : 1);
  c.particles = 16;
  if (tse_prepare(&c, &p, NULL) < 0) return 0;
  const size_t count = c.form ? sizeof(tse_filter_paper) : sizeof(tse_filter);
  MUST(tse_reset(&p, &f.filter, count) == TSE_OK, "reset");
  road r = road_of(&b);
  for (uint32_t k = 0; k < first >> 3; k++) {
    const tse_input u = road_row(&r, tse_double_of_setting(c.sample_time));
    (void)tse_step(&p, &f.filter, &u, NULL);
  }
  forge(&b, (uint8_t *)&f, count);
  if (tse_filter_check(&p, &f.filter, count) != TSE_OK) return 0;
  for (int k = 0; k < 25; k++) {
    tse_input u = road_row(&r, tse_double_of_setting(c.sample_time));
    tse_output y;
    if (k % 8 == 7) u.missing = take(&b, 1);
    const tse_status status = tse_step(&p, &f.filter, &u, &y);
    if (status >= 0) must_be_estimates(&c, &y, (int)status);
    (void)tse_filter_check(&p, &f.filter, count); /* may refuse a state that a forged one led to */
  }
  return 0;
}
