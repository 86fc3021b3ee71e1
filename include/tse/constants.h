/* tse/constants.h - the rows of tse/constants.def as constants of the library's number format. Internal to the sources. */
#ifndef TSE_CONSTANTS_H
#define TSE_CONSTANTS_H

#include "tse/real.h"

/* A build that sweeps one constant says which, and by what factor: -DTSE_SWEEP=RATE_ROAD -DTSE_SWEEP_BY=2 (scripts/sweep.py). */
#if defined(TSE_SWEEP)
enum { TSE_ROW_NONE_
#define CONSTANT(name, value, unit, why, test) , TSE_ROW_##name
#include "tse/constants.def"
};
#define TSE_PASTE_(a, b) a##b
#define TSE_PASTE(a, b) TSE_PASTE_(a, b)
#define CONSTANT(name, value, unit, why, test) \
  static const tse_real name = TSE_R((value) * ((int)TSE_ROW_##name == (int)TSE_PASTE(TSE_ROW_, TSE_SWEEP) ? (TSE_SWEEP_BY) : 1.0));
#else
#define CONSTANT(name, value, unit, why, test) static const tse_real name = TSE_R(value);
#endif
#include "tse/constants.def"

#endif
