/* tse/learnt.h - the learnt state: stiffness, grip, steering, sensor biases and noise at
 * the end of a drive, with their covariance, in TSE_LEARNT_BYTES bytes. It is the prior
 * of the next drive.
 *
 *   tse_learnt_save(&p, &f, bytes);                      at the end of a drive; store the
 *                                                        bytes
 *   tse_reset(&p, &f, sizeof f);                         at the start of the next
 *   tse_learnt_load(&p, &f, bytes, sizeof bytes, age_s); if refused, the settings' prior
 *   is used
 *
 * The bytes are the same in every number format and on every machine: a PC reads what an
 * ECU wrote. Numbers are little-endian; `q24` is int32 in units of 2^-24:
 *
 *     0  "tsel"                      12  u32  bit a: stiffness a has been learnt
 *     4  u16  format, 3              16  u32  samples' worth of trust in the process sd
 *                                             (particles)
 *     6  u16  bytes in all           20  q24  x 11  means: bias of accel_x, accel_y
 *                                                   [m/s2],
 *     8  u32  vehicle                               yaw_rate [rad/s]; logarithm of
 *                                                   cx_front, cy_front,
 *                                                   cy_rear and grip over the settings';
 *                                                   steering
 *                                                   offset [rad], error of the steering
 *                                                   ratio [1],
 *                                                   latency of the steering [s], radius
 *                                                   front over
 *                                                   rear less 1
 *                                    64  q24  x 11  their sd; 0: not known
 *                                   108  i16  x 55  their correlations, 2^-14: 01 02 ..
 *                                                   12 13 ..
 *                                   220  q24  x 5   noise of accel_x, accel_y, yaw_rate,
 *                                                   wheel speeds:
 *                                                   sd over the setting's
 *                                   240  q24  x 3   process sd (particles)
 *                                   252  q24  x 3   their correlations 01, 02, 12
 *                                   264  u32  CRC-32 (IEEE 802.3, as zlib's) of all bytes
 *                                             before
 *
 * Later formats keep the first eight bytes and end in the CRC. A newer file therefore
 * differs from a damaged one.
 *
 * Values out of range are refused: a logarithm beyond 4, a bias beyond the range of its
 * channel, a negative sd, a correlation beyond 1. Formats 1 and 2 are refused with a
 * status of their own.
 *
 * `vehicle` is a hash of the vehicle settings, from the first row to
 * rear_longitudinal_follows_front, in single precision: relative stiffness refers to
 * them. Settings of sensors, filter, particles and seed may change, because biases are
 * kept in SI units.
 *
 * The learnt state is no snapshot: it leaves out velocities, particles and weights. A
 * snapshot within a drive is a copy of tse_filter. */
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

/* Save the learnt state. A stiffness counts as learnt if it has been valid since the last
 * restart, or was loaded. One that was loaded and not excited since keeps at least its
 * loaded variance.
 *   Returned:  out  unchanged if the result is negative
 *              TSE_OK, TSE_E_NULL or TSE_E_STATE: f was not reset with p, or had no row
 *              yet. Keep the
 *              older bytes then */
tse_status tse_learnt_save(const tse_params *p, const tse_filter *f, uint8_t out[TSE_LEARNT_BYTES]);

/* Load a learnt state as the prior of the next start: after tse_reset(), before the first
 * row.
 *   Given:     in, bytes  as saved; checked completely before use
 *              age_s      [s] since it was saved: the time the ignition was off.
 *                         0xffffffff if
 *                         unknown: then no sd is smaller than the settings'
 *   Updated:   f          bit for bit unchanged if the result is negative
 *   Returned:  TSE_OK, TSE_E_NULL, TSE_E_STATE (also after the first row), TSE_E_LEARNT,
 *              TSE_E_VERSION, TSE_E_OLD or TSE_E_VEHICLE
 *   Ageing:    variance of a mean    max(sd^2, learnt_floor^2) + learnt_walk_day^2 days,
 *                                    at most the
 *                                    settings' variance
 *              spread                as learnt, up to spread_max, with the weight of
 *                                    initial_spread.
 *                                    Paper's filter: widened by the uncertainty of the
 *                                    mean
 *              bias                  variance grows by *_bias_walk up to *_bias_sd^2. The
 *                                    bias decays
 *                                    to zero in proportion, because it contains the
 *                                    road's slope
 *              noise, correlations   as learnt
 *              steering, radius      sd at least a tenth of the prior's
 *   A stiffness that was never learnt starts from the settings. After a restart all do. */
tse_status tse_learnt_load(
    const tse_params *p, tse_filter *f, const uint8_t *in, size_t bytes, uint32_t age_s);

/* Check a learnt state as tse_learnt_load() does, without a filter.
 *   Returned:  TSE_OK, TSE_E_NULL, TSE_E_STATE (p not prepared), TSE_E_LEARNT,
 *              TSE_E_VERSION,
 *              TSE_E_OLD or TSE_E_VEHICLE. With the last four *wrong (if not NULL) names
 *              the part:
 *              "its checksum", "mean of cy_rear"; a string constant */
tse_status tse_learnt_check(const tse_params *p, const uint8_t *in, size_t bytes, const char **wrong);

#ifdef __cplusplus
}
#endif
#endif
