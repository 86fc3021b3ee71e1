/* tse/real.h - the one scalar type of the library, chosen when it is built.
 *
 *   TSE_REAL_DOUBLE   IEEE 754 binary64 (default)
 *   TSE_REAL_FLOAT    IEEE 754 binary32
 *   TSE_REAL_Q20      Q11.20 fixed point in int32_t: range [-2048, 2048), resolution 2^-20
 *
 * The CMake target and the pkg-config file hand the choice to every consumer; a program that is
 * compiled with another choice than the library does not link, because public names carry the
 * format as a suffix (TSE_NAME below).
 *
 * tse_real    what the filter computes with, every step
 * tse_setting what a human writes into the settings (SI units, kg m2 and N do not fit Q11.20);
 *             used once, in tse_prepare(), never in a step
 */
#ifndef TSE_REAL_H
#define TSE_REAL_H

#include <stdint.h>

#if !defined(TSE_REAL_DOUBLE) && !defined(TSE_REAL_FLOAT) && !defined(TSE_REAL_Q20)
#define TSE_REAL_DOUBLE 1
#endif

#if defined(TSE_REAL_STRONG)
/* A test compiles the core as C++ with a scalar class that has no * and no / (tests/unit/strong_real.hpp):
 * a product that does not go through src/number/real_ops.h is then a compile error. */
#include "strong_real.hpp"
typedef double tse_setting;
#define TSE_FORMAT_NAME "strong"
#define TSE_NAME(name) name##_strong

#elif defined(TSE_REAL_FLOAT)
typedef float tse_real;
typedef float tse_setting;
#define TSE_FORMAT_NAME "float"
#define TSE_NAME(name) name##_f32
#define TSE_R(x) ((tse_real)(x))

#elif defined(TSE_REAL_Q20)
typedef int32_t tse_real;
typedef double tse_setting;
#define TSE_FORMAT_NAME "q20"
#define TSE_NAME(name) name##_q20
/* For literals only: the compiler folds it, no floating-point code remains. Rounds to nearest. */
#define TSE_R(x) ((tse_real)((x) * 1048576.0 + ((x) < 0 ? -0.5 : 0.5)))

#else
typedef double tse_real;
typedef double tse_setting;
#define TSE_FORMAT_NAME "double"
#define TSE_NAME(name) name##_f64
#define TSE_R(x) ((tse_real)(x))
#endif

/* Particles a filter can hold: the size of tse_filter grows with it. In use at run time: 16 .. capacity. */
#ifndef TSE_MAX_PARTICLES
#define TSE_MAX_PARTICLES 512
#endif
#if TSE_MAX_PARTICLES < 16 || TSE_MAX_PARTICLES > 65535
#error "TSE_MAX_PARTICLES must lie in 16 .. 65535"
#endif

/* Rows that a filter keeps while it waits for channels that come later (tse/latency.def): from the earliest to the latest channel
 * there may lie TSE_LATENCY_ROWS - 4 sample times. A row is 6 tse_real, 1 more and a byte. */
#ifndef TSE_LATENCY_ROWS
#define TSE_LATENCY_ROWS 32
#endif
#if TSE_LATENCY_ROWS < 8 || TSE_LATENCY_ROWS > 1024
#error "TSE_LATENCY_ROWS must lie in 8 .. 1024"
#endif

#endif
