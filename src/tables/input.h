/* tables/input.h - one table row for each channel of a log, with its range, from
 * input.toml. Internal to the sources. */
#ifndef TABLES_INPUT_H
#define TABLES_INPUT_H

#include <stddef.h>

#include "tables/columns.h"
#include "tables/rows.h"

#define INPUT_ROW(name, drives, lo, hi, unit, text) \
  { #name, (uint16_t)offsetof(tse_input, name), drives, TSE_R(lo), TSE_R(hi) },
/* Channels, with TSE_CHANNEL_... as index. */
static const channel_row channel_rows[TSE_CHANNELS] = { CHANNELS(INPUT_ROW) };
/* Optional channels, with TSE_OPTIONAL_... as index. */
static const channel_row optional_rows[TSE_OPTIONALS] = {
  VELOCITIES(INPUT_ROW) PEDALS(INPUT_ROW) ROADS(INPUT_ROW)
};

#endif
