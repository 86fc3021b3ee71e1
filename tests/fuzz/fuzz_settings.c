/* tests/fuzz/fuzz_settings.c - any settings. They are refused with the name of a wrong
 * setting, and nothing changes; or they are accepted, and a drive gives valid
 * estimates. */
#include "fuzz.h"

static tse_filter_paper f;

static const setting *named(const char *name)
{
  uint32_t count;
  const setting *const settings = settings_of(&count);
  for (uint32_t i = 0; i < count; i++)
    if (strcmp(settings[i].name, name) == 0) return &settings[i];
  return NULL;
}

/* Return 1 if `wrong` is a stiffness that is not set. Its value follows from mass and
 * axles and may be outside its range. */
static int of_the_class(const tse_config *c, const char *wrong)
{
  return strstr(wrong, "_stiffness_") && !(get_setting(c, named(wrong)) > 0);
}

/* Check the setting that is named as wrong: the first outside its range; otherwise one
 * that depends on others: a latency, the formula, a stiffness of the class. */
static void must_be_wrong(const tse_config *c, const char *wrong)
{
  const setting *const s = named(wrong);
  MUST(s, "'%s' is no setting", wrong);
  uint32_t count;
  const setting *const settings = settings_of(&count);
  for (uint32_t i = 0; i < count; i++) {
    const double x = get_setting(c, &settings[i]);
    if (x >= tse_double_of_setting(tse_setting_of(settings[i].lo))
        && x <= tse_double_of_setting(tse_setting_of(settings[i].hi)))
      continue;
    MUST(&settings[i] == s, "%s = %g is outside its range, and %s is named", settings[i].name, x, wrong);
    return;
  }
  MUST(strstr(wrong, "_latency") || strcmp(wrong, "formula_code_1") == 0 || of_the_class(c, wrong),
      "%s is inside its range", wrong);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
  bytes b = { data, size };
  tse_config c;
  tse_params p, untouched;
  const char *wrong = "";
  const uint32_t first = take(&b, 1);
  take_settings(&b, &c, 1);
  if (first & 1u) take_settings(&b, &c, 0); /* all within their ranges, so that more are accepted */
  if (c.particles > 64 && c.particles <= TSE_MAX_PARTICLES) c.particles = 64; /* for speed */
  memset(&p, 0x5a, sizeof p);
  untouched = p;
  const tse_status status = tse_prepare(&c, &p, &wrong);
  MUST(status == TSE_E_FORMAT || tse_config_check(&c, NULL) == status, "checked and prepared differ");
  if (status < 0) {
    MUST(status == TSE_E_CONFIG || status == TSE_E_FORMAT, "status %d", (int)status);
    MUST(memcmp(&p, &untouched, sizeof p) == 0, "refused settings changed the parameters");
    if (status == TSE_E_CONFIG) must_be_wrong(&c, wrong);
    else
      MUST(named(wrong) && sizeof(tse_real) == 8 && strcmp(TSE_FORMAT_NAME, "fixed") == 0,
          "'%s' does not fit", wrong);
    return 0;
  }
  MUST(tse_reset(&p, &f.filter, sizeof f) == TSE_OK, "reset");
  road r = road_of(&b);
  for (int k = 0; k < 40; k++) {
    tse_input u = road_row(&r, tse_double_of_setting(c.sample_time));
    tse_output y;
    if (k == 30) u.dt = real_of(take_between(&b, 0.01, 3600));
    if (k % 8 == 5) u = wild_row(&b, 1.0);
    const tse_status done = tse_step(&p, &f.filter, &u, &y);
    if (done < 0) continue; /* a wheel speed out of range */
    must_be_estimates(&c, &y, (int)done);
    MUST(tse_filter_check(&p, &f.filter, sizeof f) == TSE_OK, "its own state is refused, row %d", k);
  }
  return 0;
}
