/* tse/real.h - the one scalar type of the library, chosen when it is built.
 *
 *   TSE_REAL_DOUBLE   IEEE 754 binary64 (default)
 *   TSE_REAL_FLOAT    IEEE 754 binary32
 *   TSE_REAL_FIXED    fixed point in int64_t, resolution 2^-TSE_FRACTION_BITS (32),
 *                     results up to
 *                     2^27, without any floating point
 *
 * The CMake target and the pkg-config file hand the choice to every consumer; a program
 * that is compiled with another choice than the library does not link, because public
 * names carry the format as a suffix (TSE_NAME below).
 *
 *   tse_real          type of the filter's numbers
 *   tse_setting       type of the settings; used in tse_prepare(), never in a step
 *
 * TSE_R(1.5) is a literal of tse_real, TSE_S(1650) of tse_setting. tse/convert.h converts
 * from and to double. / */
#ifndef TSE_REAL_H
#define TSE_REAL_H

#include <stdint.h>

#if defined(TSE_REAL)
#error "TSE_REAL is an option of CMake; a compiler is given -DTSE_REAL_FLOAT=1 or -DTSE_REAL_FIXED=1"
#endif
#if !defined(TSE_REAL_DOUBLE) && !defined(TSE_REAL_FLOAT) && !defined(TSE_REAL_FIXED)
#define TSE_REAL_DOUBLE 1
#endif

#if defined(TSE_REAL_STRONG)
/* A test compiles the core as C++ with a scalar class without * and /
 * (tests/unit/strong_real.hpp). A product that bypasses src/number/real_ops.h is then a
 * compile error. */
#include "strong_real.hpp"
#define TSE_FORMAT_NAME "strong"
#define TSE_NAME(name) name##_strong
#define TSE_S(x) ((tse_setting)(x))

#elif defined(TSE_REAL_FLOAT)
typedef float tse_real;
typedef float tse_setting;
#define TSE_FORMAT_NAME "float"
#define TSE_NAME(name) name##_f32
#define TSE_S(x) ((tse_setting)(x))
#define TSE_R(x) ((tse_real)(x))

#elif defined(TSE_REAL_FIXED)
typedef int64_t tse_real;
typedef int64_t tse_setting;
#define TSE_FORMAT_NAME "fixed"
#define TSE_NAME(name) name##_fix
#define TSE_FRACTION_BITS 32 /* behind the point */
/* For literals only, which the compiler folds into integers. Rounds to nearest. */
#define TSE_R(x) ((tse_real)((x) * (double)((int64_t)1 << TSE_FRACTION_BITS) + ((x) < 0 ? -0.5 : 0.5)))
/* Settings have single precision, so that the vehicle hash (tse/learnt.h) is the same in
 * every build. */
#define TSE_S(x) TSE_R((double)(float)(x))

#else
typedef double tse_real;
typedef double tse_setting;
#define TSE_FORMAT_NAME "double"
#define TSE_NAME(name) name##_f64
#define TSE_S(x) ((tse_setting)(x))
#define TSE_R(x) ((tse_real)(x))
#endif

/* Element type of the long vectors of number/vector.h. */
#if defined(TSE_REAL_FIXED)
typedef int32_t tse_short;
#else
typedef tse_real tse_short;
#endif

#endif
