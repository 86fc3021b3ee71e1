/* tse/limits.h - what the library takes no more than. The range of each setting and channel is in tse/config.h and tse/input.h. */
#ifndef TSE_LIMITS_H
#define TSE_LIMITS_H

#define TSE_LONGEST_DT 3600 /* s, between two rows */

/* Particles a filter can hold: the size of tse_filter grows with it. In use at run time: 16 .. capacity. */
#ifndef TSE_MAX_PARTICLES
#define TSE_MAX_PARTICLES 512
#endif
#if TSE_MAX_PARTICLES < 16 || TSE_MAX_PARTICLES > 65535
#error "TSE_MAX_PARTICLES must lie in 16 .. 65535"
#endif

/* Rows that a filter keeps while it waits for channels that come later (settings ..._latency): from the earliest to the latest channel
 * there may lie TSE_LATENCY_ROWS - 4 sample times. A row is 6 tse_real, 1 more and a byte. 0: none comes later, such settings are refused. */
#ifndef TSE_LATENCY_ROWS
#define TSE_LATENCY_ROWS 32
#endif
#if (TSE_LATENCY_ROWS < 8 && TSE_LATENCY_ROWS != 0) || TSE_LATENCY_ROWS > 1024
#error "TSE_LATENCY_ROWS must be 0, or lie in 8 .. 1024"
#endif
#define TSE_LATENCY_KEPT (TSE_LATENCY_ROWS + (TSE_LATENCY_ROWS == 0)) /* C knows no empty array */

#endif
