/* tests/fuzz/fuzz_learnt.c - load any bytes as a learnt state. If they are refused, the
 * filter is unchanged. If they are accepted, a drive gives valid estimates, and its
 * learnt state can be saved and loaded. */
#include "estimator/stages.h"
#include "fuzz.h"

static tse_filter_paper f, before;
static tse_params p;

static void put(uint8_t *at, uint32_t word)
{
  for (int i = 0; i < 4; i++) at[i] = (uint8_t)(word >> (8 * i));
}

/* Make a learnt state with correct header and checksum and any content. */
static size_t made(bytes *b, uint8_t at[TSE_LEARNT_BYTES])
{
  memset(at, 0, TSE_LEARNT_BYTES);
  for (size_t i = 12; i < TSE_LEARNT_BYTES - 4; i++) at[i] = (uint8_t)take(b, 1);
  put(at, 0x6c657374u);
  put(at + 4, TSE_LEARNT_FORMAT | (uint32_t)TSE_LEARNT_BYTES << 16);
  put(at + 8, p.vehicle);
  put(at + TSE_LEARNT_BYTES - 4, crc32_of(at, TSE_LEARNT_BYTES - 4));
  return TSE_LEARNT_BYTES;
}

/* Make a learnt state by a drive, with a few numbers replaced. */
static size_t changed(bytes *b, uint8_t at[TSE_LEARNT_BYTES])
{
  static const uint32_t odd[] = { 0, 1, 0xffffffffu, 0x7fffffffu, 0x80000000u, 0x01000000u, 0xff000000u,
    0x7f };
  road r = road_of(b);
  for (int k = 0; k < 12; k++) {
    const tse_input u = road_row(&r, 0.01);
    (void)tse_step(&p, &f.filter, &u, NULL);
  }
  (void)tse_learnt_save(&p, &f.filter, at);
  for (uint32_t n = take(b, 1) & 7u; n > 0; n--) {
    const uint32_t where = 12 + 4 * (take(b, 1) % ((TSE_LEARNT_BYTES - 16) / 4)), how = take(b, 1);
    put(at + where, how & 8u ? odd[how & 7u] : take(b, 4) >> (how & 7u));
  }
  put(at + TSE_LEARNT_BYTES - 4, crc32_of(at, TSE_LEARNT_BYTES - 4));
  return TSE_LEARNT_BYTES;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
  bytes b = { data, size };
  tse_config c;
  uint8_t made_of[TSE_LEARNT_BYTES];
  const uint32_t first = take(&b, 1);
  take_settings(&b, &c, 0);
  c.form = (int32_t)(first & 1u ? 0 : 1);
  c.particles = 16;
  if (tse_prepare(&c, &p, NULL) < 0) return 0;
  MUST(tse_reset(&p, &f.filter, sizeof f) == TSE_OK, "reset");
  const uint32_t age = take(&b, 4);
  const uint8_t *in = b.at;
  size_t count = b.left;
  if (first & 4u) count = made(&b, made_of);
  else if (first & 8u) count = changed(&b, made_of);
  if (first & 12u) in = made_of;
  MUST(tse_reset(&p, &f.filter, sizeof f) == TSE_OK, "reset");
  memcpy(&before, &f, sizeof f);
  const tse_status status = tse_learnt_load(&p, &f.filter, in, count, first & 16u ? 0xffffffffu : age);
  if (status < 0) {
    MUST(status == TSE_E_LEARNT || status == TSE_E_VERSION || status == TSE_E_OLD || status == TSE_E_VEHICLE,
        "status %d", (int)status);
    MUST(memcmp(&f, &before, sizeof f) == 0, "a refused state changed the filter");
    return 0;
  }
  MUST(tse_filter_check(&p, &f.filter, sizeof f) == TSE_OK, "refused after loading");
  road r = road_of(&b);
  for (int k = 0; k < 30; k++) {
    const tse_input u = road_row(&r, tse_double_of_setting(c.sample_time));
    tse_output y;
    const tse_status done = tse_step(&p, &f.filter, &u, &y);
    if (done < 0) continue;
    must_be_estimates(&c, &y, (int)done);
    MUST(tse_filter_check(&p, &f.filter, sizeof f) == TSE_OK, "its own state is refused, row %d", k);
  }
  uint8_t again[TSE_LEARNT_BYTES];
  if (tse_learnt_save(&p, &f.filter, again) != TSE_OK) return 0; /* no row was accepted yet */
  MUST(tse_reset(&p, &f.filter, sizeof f) == TSE_OK, "reset");
  MUST(tse_learnt_load(&p, &f.filter, again, sizeof again, 0) == TSE_OK, "what was just saved is refused");
  return 0;
}
