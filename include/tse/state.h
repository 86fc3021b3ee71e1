/* tse/state.h - sizes of the structs that the caller allocates: static, on the stack or
 * in a linker section. Their members are internal (src/model/state.h); the caller sees
 * bytes. They hold no pointers: copying the struct copies the filter. */
#ifndef TSE_STATE_H
#define TSE_STATE_H

#include "tse/limits.h"
#include "tse/real.h"

/* Paper's filter: sums over particles run in TSE_LANES interleaved partial sums, joined
 * in a fixed order, so that bits do not depend on the vector width. Rows are padded to
 * different cache sets: power-of-two strides cost up to 14 %. */
#define TSE_LANES 8
#define TSE_STRIDE ((TSE_MAX_PARTICLES + TSE_LANES - 1) / TSE_LANES * TSE_LANES + TSE_LANES)

/* Number of tse_real and tse_short in the structs. A build without measured velocities
 * needs 1.9 kB less RAM in float, and refuses rows that give one. */
#if defined(TSE_SMALL)
#define TSE_FILTER_SHORTS 196
#define TSE_FILTER_NUMBERS (364 + 7 * TSE_LATENCY_KEPT)
#define TSE_FILTER_WHOLE 108
#define TSE_FILTER_PADDED (7 + 2 * (1 - sizeof(tse_short) / sizeof(tse_real)))
#define TSE_CONSTANT_NUMBERS 213
#elif defined(TSE_NO_VELOCITY)
#define TSE_FILTER_SHORTS 877
#define TSE_FILTER_NUMBERS (509 + 7 * TSE_LATENCY_KEPT)
#define TSE_CONSTANT_NUMBERS 192
#else
#define TSE_FILTER_SHORTS 1213
#define TSE_FILTER_NUMBERS (556 + 7 * TSE_LATENCY_KEPT)
#define TSE_CONSTANT_NUMBERS 204
#endif
#if !defined(TSE_SMALL)
#define TSE_FILTER_WHOLE 160 /* bytes of whole numbers */
#define TSE_FILTER_PADDED (19 + sizeof(tse_short) / sizeof(tse_real))
#endif
#define TSE_PAPER_NUMBERS (18 + 20 * TSE_STRIDE) /* of the particles, beside tse_filter */
#if defined(TSE_NO_EFFECTS)
#define TSE_EFFECT_NUMBERS 0
#define TSE_EFFECT_BYTES 0
#else
// clang-format off: table effect_numbers
#define TSE_EFFECT_NUMBERS 67
// clang-format on: end of table
#define TSE_EFFECT_BYTES 40
#endif

/* Padding bytes between a 32-bit integer and a tse_real: 0 or 4, by the alignment of the machine. */
struct tse_aligned {
  int32_t first;
  tse_real number;
};
#define TSE_PADDING (sizeof(struct tse_aligned) - sizeof(tse_real) - sizeof(int32_t))
#define TSE_LATENCY_BYTES ((TSE_LATENCY_KEPT + 3 + TSE_PADDING) / (4 + TSE_PADDING) * (4 + TSE_PADDING))

/* Exact sizes of the structs. src/model/state.h does not compile if its members have other sizes. */
typedef union tse_effects_bytes {
  uint64_t first; /* aligns the struct */
  unsigned char all[sizeof(uint64_t) + TSE_EFFECT_NUMBERS * sizeof(tse_real) + TSE_EFFECT_BYTES];
} tse_effects_bytes;

typedef struct tse_params_bytes {
  unsigned char constants[TSE_CONSTANT_NUMBERS * sizeof(tse_real) + 48 + 2 * TSE_PADDING];
  tse_effects_bytes effects;
} tse_params_bytes;

typedef struct tse_filter_bytes {
  tse_real first;
  unsigned char rest[(TSE_FILTER_NUMBERS - 1) * sizeof(tse_real) + TSE_FILTER_SHORTS * sizeof(tse_short)
      + TSE_FILTER_WHOLE + TSE_LATENCY_BYTES + TSE_FILTER_PADDED * TSE_PADDING];
} tse_filter_bytes;

typedef struct tse_paper_bytes {
  tse_real first;
  unsigned char rest[(TSE_PAPER_NUMBERS - 1) * sizeof(tse_real) + 4 * TSE_STRIDE];
} tse_paper_bytes;

/* Constants of a filter, made by tse_prepare(). */
typedef struct tse_params tse_params;

/* A default filter. */
typedef struct tse_filter tse_filter;

/* A filter of the paper, with its particles. A pointer to its first member points to all of it. */
typedef struct tse_filter_paper tse_filter_paper;

#if !defined(TSE_INTERNALS)
struct tse_params {
  tse_params_bytes bytes;
};
struct tse_filter {
  tse_filter_bytes bytes;
};
struct tse_filter_paper {
  tse_filter filter;
  tse_paper_bytes bytes;
};
#endif

#endif
