/* tse/learnt.h - what a drive taught, kept for the next: stiffness, grip, steering, sensor biases and noise, with their covariance,
 * in TSE_LEARNT_BYTES bytes. It is the prior of the next drive.
 *
 *   tse_learnt_save(&p, &f, bytes);                       at the end of a drive; write the bytes to non-volatile memory
 *   tse_reset(&p, &f, sizeof f);                          at the start of the next
 *   tse_learnt_load(&p, &f, bytes, sizeof bytes, age_s);  refused: the filter starts from its settings, as without
 *
 * The same bytes in every number format, on every machine (a PC reads what an ECU has written, and the reverse); all
 * numbers are little-endian, `q24` is int32 in units of 2^-24:
 *
 *     0  "tsel"                      12  u32  bit a: stiffness a has been learnt
 *     4  u16  format, 3              16  u32  samples' worth of trust in the process sd (particles)
 *     6  u16  bytes in all           20  q24  x 11  means: bias of accel_x, accel_y [m/s2], yaw_rate [rad/s]; logarithm of cx_front,
 *     8  u32  vehicle                               cy_front, cy_rear over nominal and of the grip over the setting's; steering offset
 *                                                   [rad], error of the steering ratio [1], lateness of the steering [s], radius front
 *                                                   over rear less 1
 *                                    64  q24  x 11  their sd; 0: not known
 *                                   108  i16  x 55  their correlations, 2^-14: 01 02 .. 12 13 ..
 *                                   220  q24  x 5   noise of accel_x, accel_y, yaw_rate, wheel speeds: sd as found over the setting
 *                                   240  q24  x 3   process sd; 252 q24 x 3 their correlations 01, 02, 12 (particles)
 *                                   264  u32  CRC-32 (IEEE 802.3, as zlib's) of all bytes before
 *
 * Later formats keep the first eight bytes and end in the CRC, so a newer file differs from a damaged one.
 *
 * What is out of range is refused, whoever wrote it: a logarithm beyond 4, a bias outside what its channel may read, a negative sd, a
 * correlation beyond 1. Formats 1 and 2 are refused with a status of their own.
 *
 * `vehicle` is made of the vehicle settings (from the first row to rear_longitudinal_follows_front), rounded to
 * single precision, because they give relative stiffness its meaning. Sensors, filter, particles and seed may change:
 * biases are kept in SI units.
 *
 * The state is not a snapshot: particles, velocities and weights are of no use to the next drive (a snapshot within a
 * drive is a copy of tse_filter). */
#ifndef TSE_LEARNT_H
#define TSE_LEARNT_H

#include "tse/tse.h"

#define TSE_LEARNT_BYTES 268
#define TSE_LEARNT_FORMAT 3

#define tse_learnt_save TSE_NAME(tse_learnt_save)
#define tse_learnt_load TSE_NAME(tse_learnt_load)
#define tse_learnt_check TSE_NAME(tse_learnt_check)

#ifdef __cplusplus
extern "C" {
#endif

/* Write down what the filter knows. A stiffness counts as learnt once it has been valid since the last recovery, or when it
 * was loaded; one that was loaded and not seen again keeps at least the variance it was loaded with.
 *   Returned:  out  unchanged when the result is negative
 *              TSE_OK, TSE_E_NULL or TSE_E_STATE: f was not reset with p, or has had no row yet. Keep the older bytes then. */
tse_status tse_learnt_save(const tse_params *p, const tse_filter *f, uint8_t out[TSE_LEARNT_BYTES]);

/* Let the next start begin from what an earlier drive taught. After tse_reset(), before the first row.
 *   Given:     in, bytes  as saved; read completely and checked before anything is used
 *              age_s      seconds since it was saved, from whatever clock the car has (the time the ignition was off);
 *                         0xffffffff when nobody knows: then nothing is trusted more than the settings' start
 *   Updated:   f          bit for bit unchanged when the result is negative
 *   Returned:  TSE_OK, TSE_E_NULL, TSE_E_STATE (also after the first row), TSE_E_LEARNT, TSE_E_VERSION,
 *              TSE_E_OLD or TSE_E_VEHICLE
 *   Ageing:    variance of a mean     max(sd^2, learnt_floor^2) + learnt_walk_day^2 days, at most that of the start
 *              spread                 as learnt, up to spread_max; trusted as little as initial_spread. With particles: widened by the
 *                                     doubt about the mean
 *              bias                   variance grows by *_bias_walk up to *_bias_sd^2, and as far as it has got there the
 *                                     bias goes back to zero: the slope of the road is in it, and another day it is another
 *              noise, correlations    as learnt; steering and radius: no better than a tenth of the prior's sd
 *   A stiffness that has never been learnt starts as the settings say. After a recovery everything does. */
tse_status tse_learnt_load(const tse_params *p, tse_filter *f, const uint8_t *in, size_t bytes, uint32_t age_s);

/* Say what tse_learnt_load() would refuse of these bytes, without a filter.
 *   Returned:  TSE_OK, TSE_E_NULL, TSE_E_STATE (p not prepared), TSE_E_LEARNT, TSE_E_VERSION, TSE_E_OLD or TSE_E_VEHICLE;
 *              with the last four *wrong (if not NULL) says what of them: "its checksum", "mean of cy_rear"; a string constant */
tse_status tse_learnt_check(const tse_params *p, const uint8_t *in, size_t bytes, const char **wrong);

#ifdef __cplusplus
}
#endif
#endif
