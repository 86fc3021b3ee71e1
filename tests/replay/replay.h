/* tests/replay/replay.h - a recorded drive through the filter, and what identifies the
 * result: for tests/unit/estimator/test_replay.c, which compares with the golden
 * estimates, and for update.c, which writes them. */
#ifndef REPLAY_H
#define REPLAY_H

#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "replay_hash.h"
#include "tse/tse.h"
#include "tse/convert.h"

enum {
  REPLAY_ROWS_MOST = 4000,
  REPLAY_EVERY = 25,
  REPLAY_PARTICLES = 150,
  REPLAY_SCHEMES = 4,
  REPLAY_COLUMNS = REPLAY_OUTPUTS
}; /* of the golden table */

/* Read drive.csv: dt, then the channels of tse_input; an empty field is missing.
 * Returned: rows, or 0. */
static inline int replay_read(const char *path, tse_input *rows)
{
  char line[256];
  int n = 0;
  FILE *const file = fopen(path, "r");
  if (!file) return 0;
  while (n < REPLAY_ROWS_MOST && fgets(line, sizeof line, file)) {
    tse_real value[1 + TSE_CHANNELS];
    char *at = line;
    if (line[0] < '0' || line[0] > '9') continue; /* comment, names */
    for (int k = 0; k < 1 + TSE_CHANNELS; k++) {
      char *end;
      const double x = strtod(at, &end);
      value[k] = tse_real_of(end == at ? (double)NAN : x);
      at = *end == ',' ? end + 1 : end;
    }
    memset(&rows[n], 0, sizeof rows[n]);
    int k = 0;
    rows[n].dt = value[k++];
    for (; k <= TSE_CHANNELS; k++) (&rows[n].steer_angle)[k - 1] = value[k]; /* one behind the other */
    n++;
  }
  (void)fclose(file);
  return n;
}

static inline void replay_columns(const tse_output *y, double column[])
{
  for (int k = 0; k < REPLAY_COLUMNS; k++) {
    const uint8_t *const at = (const uint8_t *)y + replay_outputs[k].at;
    int32_t whole;
    tse_real x;
    memcpy(&whole, at, sizeof whole);
    memcpy(&x, at, replay_outputs[k].whole ? sizeof whole : sizeof x);
    column[k] = replay_outputs[k].whole ? (double)whole : tse_double_of(x);
  }
}

/* The forms of the filter; the first one gives the golden table. */
static inline void replay_uncalibrated(tse_config *c)
{
  tse_config_default(c);
  c->mass = TSE_S(1900);
}

typedef struct replay_form {
  const char *name;
  void (*settings)(tse_config *c);
} replay_form;
static const replay_form replay_forms[] = {
  { "default", tse_config_exact },
  { "robust", tse_config_robust },
  { "paper", tse_config_paper },
  { "uncalibrated",
      replay_uncalibrated }, /* the default form, of a car that nobody has calibrated: all that is
                              * uncertain is considered */
};
enum { REPLAY_FORMS = 4, REPLAY_HASHES = REPLAY_FORMS * REPLAY_SCHEMES, REPLAY_STATUSES = 8 };

/* A form's settings, but fewer particles than a multiple of eight, so that padding takes
 * part. Returned: hash of every output of every row; table: each REPLAY_EVERY-th row,
 * unless NULL; met: rows by status, unless NULL. 0 if something was refused. */
static inline uint64_t replay_run(
    const tse_input *rows, int n, int form, int32_t scheme, double table[][REPLAY_COLUMNS], int *met)
{
  static tse_filter_paper memory; /* enough for every form */
  static tse_params p;
  tse_config config;
  tse_output y;
  uint64_t hash = REPLAY_HASH_EMPTY;
  replay_forms[form].settings(&config);
  config.particles = REPLAY_PARTICLES, config.resampling = scheme;
  if (tse_prepare(&config, &p, NULL) < 0 || tse_reset(&p, &memory.filter, sizeof memory) < 0) return 0;
  for (int i = 0; i < n; i++) {
    if (tse_step(&p, &memory.filter, &rows[i], &y) < 0) return 0;
    if (met && y.status < REPLAY_STATUSES) met[y.status]++;
    hash = replay_mix_output(hash, &y);
    if (table && i % REPLAY_EVERY == 0) replay_columns(&y, table[i / REPLAY_EVERY]);
  }
  return hash;
}

#endif
