/* tse/state.h - structs that the caller allocates: static, on the stack or in a linker
 * section. Their members are internal (src/model/state.h), so the structs are declared
 * here as arrays of bytes with exact sizes. They hold no pointers: a copy of the struct
 * is a copy of the filter. */
#ifndef TSE_STATE_H
#define TSE_STATE_H

#include "tse/limits.h"
#include "tse/real.h"

/* Sizes for the paper's filter. A sum over all particles is computed as TSE_LANES
 * interleaved partial sums that are added in a fixed order, so that its bits do not
 * depend on the vector width of the machine. An array over all particles has TSE_STRIDE
 * elements, TSE_LANES more than needed. Otherwise its size could be a power of two.
 * Elements with the same index in all arrays would then compete for the same cache sets,
 * which costs up to 14 % of the time. */
#define TSE_LANES 8
#define TSE_STRIDE ((TSE_MAX_PARTICLES + TSE_LANES - 1) / TSE_LANES * TSE_LANES + TSE_LANES)

/* Number of members of each type in the structs, for each build. A build with
 * TSE_NO_VELOCITY refuses rows that give a velocity, and saves 1.9 kB of RAM in float.
 *   TSE_FILTER_SHORTS     tse_short in tse_filter
 *   TSE_FILTER_NUMBERS    tse_real in tse_filter
 *   TSE_FILTER_WHOLE      bytes of integers in tse_filter
 *   TSE_FILTER_PADDED     gaps of TSE_PADDING bytes in tse_filter
 *   TSE_CONSTANT_NUMBERS  tse_real in tse_params, without the effects
 *   TSE_PAPER_NUMBERS     tse_real in tse_filter_paper, without its tse_filter
 *   TSE_EFFECT_NUMBERS    tse_real in the effects of tse_params
 *   TSE_EFFECT_BYTES      bytes of integers in the effects of tse_params */
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

/* Number of padding bytes between a 32-bit integer and a tse_real: 0 or 4, depending on
 * the alignment on this machine. */
struct tse_aligned {
  int32_t first;
  tse_real number;
};
#define TSE_PADDING (sizeof(struct tse_aligned) - sizeof(tse_real) - sizeof(int32_t))
#define TSE_LATENCY_BYTES ((TSE_LATENCY_KEPT + 3 + TSE_PADDING) / (4 + TSE_PADDING) * (4 + TSE_PADDING))

/* Storage for private structs, each of exactly the size that is needed. src/model/state.h
 * defines these structs, and checks at compile time that their sizes are equal. */
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
