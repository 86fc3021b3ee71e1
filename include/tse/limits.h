/* tse/limits.h - capacities of the library. Ranges of settings and channels are in
 * tse/config.h and tse/input.h. */
#ifndef TSE_LIMITS_H
#define TSE_LIMITS_H

#define TSE_LONGEST_DT 3600 /* s, max time between two rows */

/* Max number of particles; tse_filter_paper grows with it. The setting `particles` is 16
 * .. this. */
#ifndef TSE_MAX_PARTICLES
#define TSE_MAX_PARTICLES 512
#endif
#if TSE_MAX_PARTICLES < 16 || TSE_MAX_PARTICLES > 65535
#error "TSE_MAX_PARTICLES must lie in 16 .. 65535"
#endif

/* Rows that a filter keeps while it waits for late channels (settings ..._latency). The
 * latencies may span TSE_LATENCY_ROWS - 4 sample times. A row takes 7 tse_real and a
 * byte. 0: late channels are refused. */
#ifndef TSE_LATENCY_ROWS
#define TSE_LATENCY_ROWS 32
#endif
#if (TSE_LATENCY_ROWS < 8 && TSE_LATENCY_ROWS != 0) || TSE_LATENCY_ROWS > 1024
#error "TSE_LATENCY_ROWS must be 0, or lie in 8 .. 1024"
#endif
#define TSE_LATENCY_KEPT (TSE_LATENCY_ROWS + (TSE_LATENCY_ROWS == 0)) /* C knows no empty array */

#endif
