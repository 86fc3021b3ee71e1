/* tables/rows.h - types of the rows of the tables of settings and channels, and functions
 * that read, check and set the setting or channel of a row. Internal to the sources. */
#ifndef TABLES_ROWS_H
#define TABLES_ROWS_H

#include <string.h>

#include "tse/input.h"

/* A setting of type tse_setting: its name, offset in its struct, default, min, max. */
typedef struct real_row {
  const char *name;
  uint16_t at;
  tse_setting def, lo, hi;
} real_row;

/* A setting of type int32_t, with the same members as a real_row. */
typedef struct whole_row {
  const char *name;
  uint16_t at;
  int32_t def, lo, hi;
} whole_row;

/* A channel: its name, offset in its struct, min, max. `drives` is 1 if the channel is an
 * input of the model of the car. If such a value is out of range, the row of the log is
 * refused. `drives` is 0 if the channel is a measurement. If a measurement is out of
 * range, it counts as missing. */
typedef struct channel_row {
  const char *name;
  uint16_t at;
  int drives;
  tse_real lo, hi;
} channel_row;

/* Return the value of a setting of a struct. */
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

/* Set all settings of a struct to their defaults.
 *   Given:  reals, wholes  number of rows of each type */
static inline void set_defaults(
    void *settings, const real_row *real, int reals, const whole_row *whole, int wholes)
{
  for (int i = 0; i < reals; i++) memcpy((uint8_t *)settings + real[i].at, &real[i].def, sizeof real[i].def);
  for (int i = 0; i < wholes; i++)
    memcpy((uint8_t *)settings + whole[i].at, &whole[i].def, sizeof whole[i].def);
}

/* Return whether a setting is within its range or equals its default: some settings have
 * a default of 0 that is out of range and means "not set". NaN is out of range. */
static inline int real_holds(const real_row *row, tse_setting x)
{
  return (x >= row->lo && x <= row->hi) || x == row->def;
}

/* Return the name of the first setting out of range, in the order of the members,
 * or NULL. */
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

/* Return the value of a channel of a log row. */
static inline tse_real channel_at(const void *row_of_log, const channel_row *row)
{
  tse_real x;
  memcpy(&x, (const uint8_t *)row_of_log + row->at, sizeof x);
  return x;
}

/* Return whether the value of a channel is within its range; NaN is not. */
static inline int channel_holds(const channel_row *row, tse_real x) { return x >= row->lo && x <= row->hi; }

#endif
