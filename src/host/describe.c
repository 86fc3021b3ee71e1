/* host/describe.c - the tables of the public headers, laid out for a host to read. */
#include "tse/describe.h"
#include "tse/learnt.h"
#if !defined(TSE_NO_EFFECTS)
#include "tse/simulate.h"
#include "tse/replay.h"
#endif

#include <stddef.h>

#include "tables/described.h"

/* 0/0 is not a constant expression everywhere; no range is written as an empty one instead. */
#define NO_RANGE 0.0, 1.0, -1.0

#if !defined(TSE_NO_EFFECTS)
static const tse_field sim_config_fields[] = {
#define REAL(name, def, lo, hi, unit, text) { #name, 's', (int32_t)offsetof(tse_sim_config, name), def, lo, hi, unit, text },
#define INT(name, def, lo, hi, text) { #name, 'i', (int32_t)offsetof(tse_sim_config, name), def, lo, hi, "1", text },
#include "tse/sim.def"
};

#define MEMBER(name, member, unit, text) { name, 'r', (int32_t)offsetof(tse_sim_output, member), NO_RANGE, unit, text },
static const tse_field sim_input_fields[] = {
  { "dt", 'r', (int32_t)offsetof(tse_sim_input, dt), 0.01, 0.0, 1.0, "s", "time since the previous row" },
#define SIM_INPUT(name, def, lo, hi, unit, text) { #name, 'r', (int32_t)offsetof(tse_sim_input, name), def, lo, hi, unit, text },
#include "tse/sim_input.def"
};
static const tse_field sim_output_fields[] = {
#define INPUT(name, lo, hi, unit, kind, text) MEMBER(#name, row.name, unit, text)
#include "tse/input.def"
#define SIM_OUTPUT(group, name, member, unit, text) MEMBER(#group "_" #name, member, unit, text)
#include "tse/sim_output.def"
};
#endif

#if !defined(TSE_NO_EFFECTS)
static const tse_field replay_log_fields[] = {
#define REPLAY_LOG(name, needed, unit, text) { #name, needed ? 'p' : 'o', (int32_t)offsetof(tse_replay_log, name), NO_RANGE, unit, text },
#include "tse/replay.def"
};
static const tse_field replay_start_fields[] = {
#define REPLAY_START(name, def, unit, text) { #name, 'r', (int32_t)offsetof(tse_replay_start, name), def, 1.0, -1.0, unit, text },
#include "tse/replay.def"
};
static const tse_field replay_out_fields[] = {
#define REPLAY_OUT(name, unit, text) { #name, 'o', (int32_t)offsetof(tse_replay_out, name), NO_RANGE, unit, text },
#include "tse/replay.def"
};
#endif

const tse_effect_row *tse_describe_effects(int32_t *count)
{
  if (count) *count = (int32_t)(sizeof effect_rows / sizeof effect_rows[0]);
  return effect_rows;
}

const tse_effect_parameter *tse_describe_effect_parameters(int32_t *count)
{
  if (count) *count = (int32_t)(sizeof effect_parameters / sizeof effect_parameters[0]);
  return effect_parameters;
}

#define ROWS(which, table, bytes)                              \
  case which:                                                  \
    if (count) *count = (int32_t)(sizeof table / sizeof table[0]); \
    if (size) *size = (int32_t)(bytes);                        \
    return table;

const tse_field *tse_describe(tse_struct which, int32_t *count, int32_t *size)
{
  switch (which) {
    ROWS(TSE_STRUCT_CONFIG, config_fields, sizeof(tse_config))
    ROWS(TSE_STRUCT_INPUT, input_fields, sizeof(tse_input))
    ROWS(TSE_STRUCT_OUTPUT, output_fields, sizeof(tse_output))
    ROWS(TSE_STRUCT_STATUS, status_fields, 0)
    ROWS(TSE_STRUCT_REASON, reason_fields, 0)
    ROWS(TSE_STRUCT_FORMULA_PLACE, formula_places, 0)
    ROWS(TSE_STRUCT_FORMULA_OP, formula_ops, 0)
#if !defined(TSE_NO_EFFECTS)
    ROWS(TSE_STRUCT_SIM_CONFIG, sim_config_fields, sizeof(tse_sim_config))
    ROWS(TSE_STRUCT_SIM_INPUT, sim_input_fields, sizeof(tse_sim_input))
    ROWS(TSE_STRUCT_SIM_OUTPUT, sim_output_fields, sizeof(tse_sim_output))
    ROWS(TSE_STRUCT_REPLAY_LOG, replay_log_fields, sizeof(tse_replay_log))
    ROWS(TSE_STRUCT_REPLAY_START, replay_start_fields, sizeof(tse_replay_start))
    ROWS(TSE_STRUCT_REPLAY_OUT, replay_out_fields, sizeof(tse_replay_out))
#endif
    default: break;
  }
  if (count) *count = 0;
  if (size) *size = 0;
  return NULL;
}

void tse_describe_build(tse_build *b)
{
  if (!b) return;
  b->version = TSE_VERSION;
  b->format = TSE_FORMAT_NAME;
  b->capacity = TSE_MAX_PARTICLES;
  b->filter_bytes = (int32_t)sizeof(tse_filter);
  b->filter_paper_bytes = (int32_t)sizeof(tse_filter_paper);
  b->params_bytes = (int32_t)sizeof(tse_params);
  b->learnt_bytes = TSE_LEARNT_BYTES;
#if defined(TSE_REAL_FIXED)
  b->fraction_bits = TSE_FRACTION_BITS;
#else
  b->fraction_bits = 0;
#endif
#if defined(TSE_NO_EFFECTS)
  b->sim_bytes = 0;
#else
  b->sim_bytes = (int32_t)sizeof(tse_sim);
#endif
}
