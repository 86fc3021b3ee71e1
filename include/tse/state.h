/* tse/state.h - structs that the caller allocates: static, on the stack or in a linker
 * section. The caller needs their sizes, but not their members, which are internal
 * (src/model/state.h). The structs are therefore declared here as arrays of bytes with
 * exact sizes. They hold no pointers, so a copy of a struct tse_filter is a complete copy
 * of the filter. */
#ifndef TSE_STATE_H
#define TSE_STATE_H

#include "tse/limits.h"
#include "tse/real.h"

/* Sizes for the paper's filter, the particle filter of Berntorp & Di Cairano (2016).
 *   TSE_LANES   number of partial sums. Partial sum i of a sum over all particles adds
 *               the particles i, i + TSE_LANES ... The partial sums are then added in a
 *               fixed order. The rounding of the sum is therefore the same on machines
 *               with different vector widths.
 *   TSE_STRIDE  number of elements of an array with one element for each particle. It is
 *               the max number of particles, rounded up to a multiple of TSE_LANES, plus
 *               TSE_LANES. Without the extra TSE_LANES elements the size could be a power
 *               of two. Elements with the same index in all arrays would then compete for
 *               the same cache sets, and the filter would need up to 14 % more computing
 *               time. */
#define TSE_LANES 8
#define TSE_STRIDE ((TSE_MAX_PARTICLES + TSE_LANES - 1) / TSE_LANES * TSE_LANES + TSE_LANES)

/* Contents of the structs, from which their sizes in bytes are computed below. They
 * depend on the build options. A build with TSE_NO_VELOCITY refuses rows that give a
 * velocity. If tse_real is float, such a build needs 1.9 kB less RAM than one without
 * this option.
 *   TSE_FILTER_SHORTS     number of tse_short in tse_filter
 *   TSE_FILTER_NUMBERS    number of tse_real in tse_filter
 *   TSE_FILTER_WHOLE      number of bytes of the integers in tse_filter
 *   TSE_FILTER_PADDED     number of places in tse_filter where the compiler inserts
 *                         TSE_PADDING bytes
 *   TSE_CONSTANT_NUMBERS  number of tse_real in tse_params, without those of the effects
 *   TSE_PAPER_NUMBERS     number of tse_real in tse_filter_paper, without those of the
 *                         tse_filter at its start
 *   TSE_EFFECT_NUMBERS    number of tse_real in tse_params that belong to effects
 *   TSE_EFFECT_BYTES      number of bytes of the integers in tse_params that belong to
 *                         effects */
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
#define TSE_FILTER_WHOLE 160
#define TSE_FILTER_PADDED (19 + sizeof(tse_short) / sizeof(tse_real))
#endif
#define TSE_PAPER_NUMBERS (18 + 20 * TSE_STRIDE)
#if defined(TSE_NO_EFFECTS)
#define TSE_EFFECT_NUMBERS 0
#define TSE_EFFECT_BYTES 0
#else
// clang-format off: table effect_numbers
#define TSE_EFFECT_NUMBERS 67
// clang-format on: end of table
#define TSE_EFFECT_BYTES 40
#endif

/* Number of padding bytes that the compiler inserts between a 32-bit integer and a
 * tse_real: 0 or 4, depending on the alignment of tse_real on the target machine. */
struct tse_aligned {
  int32_t first;
  tse_real number;
};
#define TSE_PADDING (sizeof(struct tse_aligned) - sizeof(tse_real) - sizeof(int32_t))
/* Size in bytes of an array with one byte for each of TSE_LATENCY_KEPT stored rows,
 * rounded up to a multiple of 4 + TSE_PADDING, the alignment of tse_real. */
#define TSE_LATENCY_BYTES ((TSE_LATENCY_KEPT + 3 + TSE_PADDING) / (4 + TSE_PADDING) * (4 + TSE_PADDING))

/* Storage for private structs. src/model/state.h defines these structs, and checks at
 * compile time that the size of each equals the size of its storage. */
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

/* The default filter. */
typedef struct tse_filter tse_filter;

/* The paper's filter with its particles. A pointer to its first member, a tse_filter,
 * stands for the whole struct in tse_reset(), tse_step() and all other calls. */
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
