/* tests/replay/replay.h - run a recorded drive and hash the outputs.
 * tests/unit/estimator/test_replay.c compares them with the golden estimates, which
 * update.c writes. */
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
  REPLAY_ROWS_MOST = 4000,        /* max number of rows */
  REPLAY_EVERY = 25,              /* the golden table has every 25th row */
  REPLAY_PARTICLES = 150,         /* not a multiple of eight: includes padding */
  REPLAY_SCHEMES = 4,             /* methods of resampling */
  REPLAY_COLUMNS = REPLAY_OUTPUTS /* of the golden table */
};

/* Read drive.csv: dt, then the channels of tse_input. An empty field is a missing
 * channel.
 *   Returned:  number of rows; 0 if the file cannot be read */
static inline int replay_read(const char *path, tse_input *rows)
{
  char line[256];
  int n = 0;
  FILE *const file = fopen(path, "r");
  if (!file) return 0;
  while (n < REPLAY_ROWS_MOST && fgets(line, sizeof line, file)) {
    tse_real value[1 + TSE_CHANNELS];
    char *at = line;
    if (line[0] < '0' || line[0] > '9') continue; /* comment or header */
    for (int k = 0; k < 1 + TSE_CHANNELS; k++) {
      char *end;
      const double x = strtod(at, &end);
      value[k] = tse_real_of(end == at ? (double)NAN : x);
      at = *end == ',' ? end + 1 : end;
    }
    memset(&rows[n], 0, sizeof rows[n]);
    int k = 0;
    rows[n].dt = value[k++];
    for (; k <= TSE_CHANNELS; k++) (&rows[n].steer_angle)[k - 1] = value[k]; /* neighbouring members */
    n++;
  }
  (void)fclose(file);
  return n;
}

/* Write the outputs as a row of the golden table. */
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

/* Set an uncalibrated car: the Kalman filter considers all uncertain parameters. */
static inline void replay_uncalibrated(tse_config *c)
{
  tse_config_default(c);
  c->mass = TSE_S(1900);
}

/* Settings to replay. The first form gives the golden table. */
typedef struct replay_form {
  const char *name;
  void (*settings)(tse_config *c);
} replay_form;
static const replay_form replay_forms[] = {
  { "default", tse_config_exact },
  { "robust", tse_config_robust },
  { "paper", tse_config_paper },
  { "uncalibrated", replay_uncalibrated },
};
enum { REPLAY_FORMS = 4, REPLAY_HASHES = REPLAY_FORMS * REPLAY_SCHEMES, REPLAY_STATUSES = 8 };

/* Run the rows with the settings of a form and REPLAY_PARTICLES particles.
 *   Returned:  hash of all outputs of all rows; 0 if settings or a row are refused
 *              table  every REPLAY_EVERY-th row; may be NULL
 *              met    number of rows by status, added up; may be NULL */
static inline uint64_t replay_run(
    const tse_input *rows, int n, int form, int32_t scheme, double table[][REPLAY_COLUMNS], int *met)
{
  static tse_filter_paper memory; /* large enough for all filters */
  static tse_params p;
  tse_config config;
  tse_output y;
  uint64_t hash = REPLAY_HASH_EMPTY;
  replay_forms[form].settings(&config);
  config.particles = REPLAY_PARTICLES;
  config.resampling = scheme;
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
