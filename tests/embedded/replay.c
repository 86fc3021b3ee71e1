/* tests/embedded/replay.c - run the recorded drive of tests/replay on any machine, with
 * tse.h and tse.c of scripts/dev/amalgamate.py, rows.h of scripts/dev/machines.py, and a
 * port.
 *
 * Prints a hash of all bits of all outputs after each PART rows, to locate differences
 * between machines, and after the whole drive, where it equals that of the golden replay.
 *   ALL_FORMS   also run an uncalibrated car, and the particle filter with each method of
 *               resampling. Otherwise the Kalman filter only, in a tse_filter, as on a
 *               microcontroller */
#include "drive.h"
#include "port.h"
#include "replay_hash.h"

enum { PART = 200, PARTICLES = 150, SCHEMES = 4 };

#if defined(ALL_FORMS)
static tse_filter_paper memory;
#define FILTER memory.filter
#else
static tse_filter memory;
#define FILTER memory
#endif

static int refused(const char *what, tse_status status, const char *wrong)
{
  port_say("refused ");
  port_say(what);
  port_say(": ");
  port_say(tse_status_text(status));
  if (wrong) {
    port_say(": ");
    port_say(wrong);
  }
  port_say("\n");
  return 1;
}

static int run(const char *form, void (*settings)(tse_config *c), int32_t scheme)
{
  static tse_params p;
  tse_config c;
  tse_input u;
  tse_output y;
  uint64_t hash = REPLAY_HASH_EMPTY;
  const char *wrong = NULL;
  settings(&c);
  c.particles = PARTICLES <= TSE_MAX_PARTICLES ? PARTICLES : TSE_MAX_PARTICLES;
  c.resampling = scheme;
  tse_status status = tse_prepare(&c, &p, &wrong);
  if (status < 0) return refused("tse_prepare", status, wrong);
  status = tse_reset(&p, &FILTER, sizeof memory);
  if (status < 0) return refused("tse_reset", status, NULL);
  for (int i = 0; i < DRIVE_ROWS; i++) {
    drive_at(i, &u);
    status = tse_step(&p, &FILTER, &u, &y);
    if (status < 0) {
      say_number("row ", (uint32_t)i);
      return refused(" tse_step", status, NULL);
    }
    hash = replay_mix_output(hash, &y);
    if ((i + 1) % PART == 0) {
      say_hash("part ", hash);
      say_number(" ", (uint32_t)i + 1);
      port_say("\n");
    }
  }
  say_hash("hash ", hash);
  port_say(" ");
  port_say(form);
  say_number(", scheme ", (uint32_t)scheme);
  port_say("\n");
  return 0;
}

#if defined(ALL_FORMS)
static void uncalibrated(tse_config *c)
{
  tse_config_default(c);
  c->mass = TSE_S(1900);
}
#endif

int program(void)
{
  const char *wrong = NULL;
  const tse_status status = tse_self_test(&wrong);
  if (status < 0) return refused("tse_self_test", status, wrong);
  if (run("default", tse_config_exact, 0)) return 1;
#if defined(ALL_FORMS)
#if !defined(TSE_NO_EFFECTS) /* such a car has effects */
  if (run("uncalibrated", uncalibrated, 0)) return 1;
#endif
  for (int32_t scheme = 0; scheme < SCHEMES; scheme++)
    if (run("robust", tse_config_robust, scheme) || run("paper", tse_config_paper, scheme)) return 1;
#endif
  return 0;
}
