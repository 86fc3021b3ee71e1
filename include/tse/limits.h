/* tse/limits.h - max time between rows, and sizes of the arrays in the structs. The
 * ranges of settings and channels are in tse/config.h and tse/input.h. */
#ifndef TSE_LIMITS_H
#define TSE_LIMITS_H

#define TSE_LONGEST_DT 3600 /* [s] max time between two rows */

/* Max value of the setting `particles`. The size of tse_filter_paper is
 * proportional to it. */
#ifndef TSE_MAX_PARTICLES
#define TSE_MAX_PARTICLES 512
#endif
#if TSE_MAX_PARTICLES < 16 || TSE_MAX_PARTICLES > 65535
#error "TSE_MAX_PARTICLES must lie in 16 .. 65535"
#endif

/* Number of rows that a filter stores while it waits for channels with a latency
 * (settings ..._latency). The latencies of two channels may differ by up to
 * (TSE_LATENCY_ROWS - 4) sample_time. The other four rows are: one before and one after
 * this time span, for interpolation, and two to spare, because rows may follow each other
 * a little faster than sample_time. A stored row takes 7 tse_real and one byte of
 * tse_filter. If TSE_LATENCY_ROWS is 0, tse_prepare() refuses settings with a latency. */
#ifndef TSE_LATENCY_ROWS
#define TSE_LATENCY_ROWS 32
#endif
#if (TSE_LATENCY_ROWS < 8 && TSE_LATENCY_ROWS != 0) || TSE_LATENCY_ROWS > 1024
#error "TSE_LATENCY_ROWS must be 0, or lie in 8 .. 1024"
#endif
/* Size of the arrays of stored rows: at least 1, because C has no arrays of size 0. */
#define TSE_LATENCY_KEPT (TSE_LATENCY_ROWS + (TSE_LATENCY_ROWS == 0))

#endif
