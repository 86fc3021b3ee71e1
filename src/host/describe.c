/* host/describe.c - tse_describe() and related functions: names, units, ranges and
 * meanings of struct members and codes at run time. */
#include "model/state.h"
#include "tse/describe.h"
#include "tse/learnt.h"
#if !defined(TSE_NO_EFFECTS)
#include "tse/simulate.h"
#include "tse/replay.h"
#endif

#include <stddef.h>

#include "tables/described.h"

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

const tse_setting_row *tse_describe_settings(int32_t *count)
{
  if (count) *count = (int32_t)(sizeof setting_rows / sizeof setting_rows[0]);
  return setting_rows;
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
    ROWS(TSE_STRUCT_FORMULA_LIMIT, formula_limits, 0)
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
