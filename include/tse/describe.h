/* tse/describe.h - the tables of tse.h and simulate.h at run time, for hosts that bind to them (Python, FMU).
 * An embedded program that does not call these functions does not carry them. */
#ifndef TSE_DESCRIBE_H
#define TSE_DESCRIBE_H

#include "tse/tse.h"

#define tse_describe       TSE_NAME(tse_describe)
#define tse_describe_build TSE_NAME(tse_describe_build)

#ifdef __cplusplus
extern "C" {
#endif

typedef enum tse_struct {
  TSE_STRUCT_CONFIG, TSE_STRUCT_INPUT, TSE_STRUCT_OUTPUT,
  TSE_STRUCT_SIM_CONFIG, TSE_STRUCT_SIM_INPUT, TSE_STRUCT_SIM_OUTPUT, /* simulator: absent (NULL) in q20 builds */
  TSE_STRUCT_STATUS, TSE_STRUCT_REASON,  /* not structs: name, text, and the code in `offset` */
  TSE_STRUCTS
} tse_struct;

typedef struct tse_field {
  const char *name;
  char kind;            /* 's' tse_setting, 'r' tse_real, 'i' int32_t, 'u' uint32_t, 'c' code */
  int32_t offset;       /* bytes from the start of the struct */
  double def, lo, hi;   /* default and range; hi < lo where there is no range */
  const char *unit;
  const char *text;
} tse_field;

/* The rows of one struct.   Returned: first row; *count rows; *size bytes of the struct.   NULL if there is no such struct. */
const tse_field *tse_describe(tse_struct which, int32_t *count, int32_t *size);

/* The library as built: version, format name, capacity, sizeof(tse_filter), sizeof(tse_params), sizeof(tse_sim), bytes of a
 * learnt state. */
typedef struct tse_build {
  const char *version, *format;
  int32_t capacity, filter_bytes, params_bytes, sim_bytes, learnt_bytes;
} tse_build;
void tse_describe_build(tse_build *b);

#ifdef __cplusplus
}
#endif
#endif
