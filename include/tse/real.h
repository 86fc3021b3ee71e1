/* tse/real.h - the number format of the library, which is chosen when it is compiled.
 *
 *   TSE_REAL_DOUBLE   IEEE 754 binary64 (default)
 *   TSE_REAL_FLOAT    IEEE 754 binary32
 *   TSE_REAL_FIXED    fixed point in int64_t, without floating-point operations.
 *                     Resolution 2^-32. A product or quotient beyond +-2^27 becomes
 *                     +-2^27, and then counts as infinite
 *
 * The CMake target and the pkg-config file define the same macro in every program that
 * uses the library. A program that is compiled for a different format does not link: the
 * name of each public function ends in the format, as in tse_step_f32 (TSE_NAME below).
 *
 *   tse_real          type of the numbers in a filter
 *   tse_setting       type of the settings; used in tse_prepare(), never in tse_step()
 *
 * TSE_R(1.5) is a literal of type tse_real, TSE_S(1650) of type tse_setting.
 * tse/convert.h converts from and to double. */
#ifndef TSE_REAL_H
#define TSE_REAL_H

#include <stdint.h>

#if defined(TSE_REAL)
#error "TSE_REAL is an option of CMake: pass -DTSE_REAL_FLOAT=1 or -DTSE_REAL_FIXED=1 to the compiler"
#endif
#if !defined(TSE_REAL_DOUBLE) && !defined(TSE_REAL_FLOAT) && !defined(TSE_REAL_FIXED)
#define TSE_REAL_DOUBLE 1
#endif

#if defined(TSE_REAL_STRONG)
/* For a test that compiles the core as C++. tse_real is then a class without the
 * operators * and / (tests/unit/strong_real.hpp). A product or quotient that is not
 * computed by a function of src/number/real_ops.h is therefore a compile error. */
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
#define TSE_FRACTION_BITS 32 /* bits after the binary point */
/* Convert a literal, rounded to nearest. Use it for literals only: the compiler then
 * evaluates the expression, so that the program has no floating-point operation. */
#define TSE_R(x) ((tse_real)((x) * (double)((int64_t)1 << TSE_FRACTION_BITS) + ((x) < 0 ? -0.5 : 0.5)))
/* Convert a literal of a setting. It is rounded to single precision first, so that the
 * hash of the vehicle (tse/learnt.h) is the same in every number format. */
#define TSE_S(x) TSE_R((double)(float)(x))

#else
typedef double tse_real;
typedef double tse_setting;
#define TSE_FORMAT_NAME "double"
#define TSE_NAME(name) name##_f64
#define TSE_S(x) ((tse_setting)(x))
#define TSE_R(x) ((tse_real)(x))
#endif

/* Type of the elements of long vectors (src/number/vector.h). In fixed point it has half
 * the size of tse_real. */
#if defined(TSE_REAL_FIXED)
typedef int32_t tse_short;
#else
typedef tse_real tse_short;
#endif

#endif
