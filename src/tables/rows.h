/* tables/rows.h - row types of the tables in this folder, and functions on rows. Internal to
 * the sources. */
#ifndef TABLES_ROWS_H
#define TABLES_ROWS_H

#include <string.h>

#include "tse/input.h"

/* A setting: name, offset in its struct, default and range. */
typedef struct real_row {
  const char *name;
  uint16_t at;
  tse_setting def, lo, hi;
} real_row;

typedef struct whole_row {
  const char *name;
  uint16_t at;
  int32_t def, lo, hi;
} whole_row;

/* A channel. A row with a value out of range is refused if drives is 1; if 0, the value is
 * missing. */
typedef struct channel_row {
  const char *name;
  uint16_t at;
  int drives;
  tse_real lo, hi;
} channel_row;

static inline tse_setting real_at(const void *settings, const real_row *row)
{
  tse_setting x;
  memcpy(&x, (const uint8_t *)settings + row->at, sizeof x);
  return x;
}

static inline int32_t whole_at(const void *settings, const whole_row *row)
{
  int32_t x;
  memcpy(&x, (const uint8_t *)settings + row->at, sizeof x);
  return x;
}

static inline void set_defaults(
    void *settings, const real_row *real, int reals, const whole_row *whole, int wholes)
{
  for (int i = 0; i < reals; i++) memcpy((uint8_t *)settings + real[i].at, &real[i].def, sizeof real[i].def);
  for (int i = 0; i < wholes; i++)
    memcpy((uint8_t *)settings + whole[i].at, &whole[i].def, sizeof whole[i].def);
}

/* Return whether a setting is within its range, or is the default, which may mean "not
 * set". NaN is out of range. */
static inline int real_holds(const real_row *row, tse_setting x)
{
  return (x >= row->lo && x <= row->hi) || x == row->def;
}

/* Return the name of the first setting out of range, in the order of the members, or NULL. */
static inline const char *first_outside(
    const void *settings, const real_row *real, int reals, const whole_row *whole, int wholes)
{
  int r = 0, w = 0;
  while (r < reals && real_holds(&real[r], real_at(settings, &real[r]))) r++;
  while (w < wholes && whole_at(settings, &whole[w]) >= whole[w].lo
      && whole_at(settings, &whole[w]) <= whole[w].hi)
    w++;
  if (r == reals) return w == wholes ? NULL : whole[w].name;
  return w == wholes || real[r].at < whole[w].at ? real[r].name : whole[w].name;
}

static inline tse_real channel_at(const void *row_of_log, const channel_row *row)
{
  tse_real x;
  memcpy(&x, (const uint8_t *)row_of_log + row->at, sizeof x);
  return x;
}

static inline int channel_holds(const channel_row *row, tse_real x) { return x >= row->lo && x <= row->hi; }

#endif
