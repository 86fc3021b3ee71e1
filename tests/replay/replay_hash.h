/* tests/replay/replay_hash.h - one number for every bit of what the filter puts out. No more than the compiler brings along, so that
 * it runs on a machine without files and without a C library, too (tests/embedded). */
#ifndef REPLAY_HASH_H
#define REPLAY_HASH_H

#include <stdint.h>
#include <string.h>

#include "tse/tse.h"

#define REPLAY_HASH_EMPTY 14695981039346656037u

/* FNV-1a, 64 bits, over the values' bytes, low one first whatever the machine's order. */
static inline uint64_t replay_mix(uint64_t hash, uint64_t bits, int bytes)
{
  for (int i = 0; i < bytes; i++) hash = (hash ^ (bits >> (8 * i) & 255u)) * 1099511628211u;
  return hash;
}

static inline uint64_t replay_mix_real(uint64_t hash, tse_real x)
{
  uint64_t wide = 0;
  uint32_t narrow = 0;
  if (sizeof x == sizeof wide) {
    memcpy(&wide, &x, sizeof x);
    return replay_mix(hash, wide, 8);
  }
  memcpy(&narrow, &x, sizeof narrow);
  return replay_mix(hash, narrow, 4);
}

/* Of which time the estimates are is none of them: no channel is late in the recorded drive. */
static inline uint64_t replay_mix_output(uint64_t hash, const tse_output *y)
{
#define OUT_REAL(name, member, unit, text) hash = replay_mix_real(hash, y->member);
#define OUT_INT(name, member, text) hash = replay_mix(hash, (uint32_t)y->member, 4);
#define OUT_AGE(name, member, unit, text)
#include "tse/output.def"
#undef OUT_REAL
#undef OUT_INT
  return hash;
}

#endif
