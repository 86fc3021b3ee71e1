/* tse/learnt.h - the learnt state: stiffness, grip, steering, sensor biases and noise at
 * the end of a drive, with their covariance, in TSE_LEARNT_BYTES bytes. It is the prior
 * of the next drive.
 *
 *   tse_learnt_save(&p, &f, bytes);                       at the end of a drive; then
 *                                                         store the bytes
 *   tse_reset(&p, &f, sizeof f);                          at the start of the next drive
 *   tse_learnt_load(&p, &f, bytes, sizeof bytes, age_s);  if this call fails, the filter
 *                                                         starts from the settings
 *
 * The bytes are the same in every number format and on every machine: a PC reads what an
 * ECU has written. Numbers are little-endian. `q24` is an int32 in units of 2^-24, `q14`
 * an int16 in units of 2^-14. "x 11" is an array of 11 numbers:
 *
 *     0  "tsel"
 *     4  u16       format: 3
 *     6  u16       size: 268 bytes
 *     8  u32       vehicle: hash of the vehicle settings
 *    12  u32       bits 0, 1, 2: 1 if cx_front, cy_front, cy_rear has been learnt
 *    16  u32       degrees of freedom nu of the process covariance; paper's filter only
 *    20  q24 x 11  means: biases of accel_x and accel_y [m/s2] and of yaw_rate [rad/s];
 *                  ln(x / value in the settings) for x = cx_front, cy_front, cy_rear and
 *                  grip; steering offset [rad]; (true / logged steering angle) - 1;
 *                  steering latency [s]; (front wheel radius in the settings / true) - 1
 *    64  q24 x 11  sd of each mean; 0: this mean has not been learnt
 *   108  q14 x 55  correlations of the means i and j > i, in the order 01 02 .. 12 13 ..;
 *                  then 2 bytes of zeros
 *   220  q24 x 5   noise sd of accel_x, accel_y, yaw_rate and both wheel speeds, each
 *                  divided by the sd in the settings
 *   240  q24 x 3   process sd of cx_front, cy_front and cy_rear, relative to nominal: sd
 *                  of the white noise about the mean; paper's filter only
 *   252  q24 x 3   correlations 01, 02, 12 of the process noise; paper's filter only
 *   264  u32       CRC-32 (IEEE 802.3, as in zlib) of all bytes before it
 *
 * In every format the first eight bytes are "tsel", format and size, and the last four
 * are the CRC. The library can therefore check the CRC of a later format that it does not
 * know, and so distinguishes a file of a later format from a damaged file.
 *
 * A file is refused if it has a value out of range: a logarithm above 4 in magnitude, a
 * bias outside the range of its channel, a negative sd, or a correlation above 1 in
 * magnitude. Formats 1 and 2 are refused with TSE_E_OLD.
 *
 * The hash `vehicle` is computed, in single precision, from the vehicle settings (mass to
 * rear_longitudinal_follows_front in tse_config), and from the parameters of all effects
 * that are switched on and of the formula. If one of these changes between drives, the
 * file is refused with TSE_E_VEHICLE: the saved stiffness is relative to its nominal
 * value in the settings, and was estimated with this model. Settings of sensors, filter,
 * particles and seed may change. The loaded biases do not depend on these settings,
 * because biases are stored in SI units. Noise and grip are stored as ratios to their
 * settings: if such a setting changes, the loaded noise or grip changes in proportion.
 *
 * The learnt state does not contain velocities, particles and weights, so that a drive
 * cannot be continued from it. To interrupt and continue a drive, copy the tse_filter. */
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

/* Save the learnt state. A stiffness counts as learnt if, since the last reset or restart
 * of the filter, it was loaded as learnt or was valid in at least one row (its reason was
 * TSE_VALID). In the paper's filter, a stiffness that was loaded and then valid in no row
 * is saved with at least the variance that it had after loading.
 *   Returned:  out  unchanged if the result is negative
 *              TSE_OK, TSE_E_NULL, or TSE_E_STATE: f was not reset with p, has not had a
 *              row with steering angle and wheel speeds, or holds a NaN. After
 *              TSE_E_STATE, keep the bytes of the earlier drive */
tse_status tse_learnt_save(const tse_params *p, const tse_filter *f, uint8_t out[TSE_LEARNT_BYTES]);

/* Load a learnt state as the prior of the next start. Call it after tse_reset() and
 * before the first row.
 *   Given:     in     the saved bytes. All of them are checked before any is used
 *              bytes  number of bytes at `in`
 *              age_s  [s] time since the state was saved, while the ignition was off. Use
 *                     0xffffffff (136 years) if this time is unknown: with the default
 *                     settings, the sd of each stiffness and bias is then that of the
 *                     settings
 *   Updated:   f      unchanged, bit for bit, if the result is negative
 *   Returned:  TSE_OK, TSE_E_NULL, TSE_E_STATE (f was not reset with p, or has had a
 *              row), TSE_E_LEARNT, TSE_E_VERSION, TSE_E_OLD or TSE_E_VEHICLE
 *   Ageing:    mean of a stiffness   Its variance becomes max(sd^2, learnt_floor^2) +
 *                                    learnt_walk_day^2 n, where sd is the saved sd and n
 *                                    is age_s in days. It is at most the variance in the
 *                                    settings
 *              process sd            Paper's filter only. The process variance becomes
 *                                    the square of the saved process sd plus the aged
 *                                    variance of the mean (above), at most spread_max^2.
 *                                    Reason: the road surface may be different now, and
 *                                    a larger process variance lets the particles follow
 *                                    the change. The degrees of freedom nu start at
 *                                    initial_dof, not at the saved nu, so that new
 *                                    samples weigh more
 *              bias                  Its variance grows at the rate of the random walk
 *                                    *_bias_walk, up to *_bias_sd^2. Meanwhile its mean
 *                                    decays, and is 0 when the variance reaches this
 *                                    limit. Reason: a part of the learnt bias is due to
 *                                    the slope of the last road
 *              noise                 As saved, at most noise_max times the setting
 *              correlations          The covariance of two values stays as saved: what
 *                                    ageing adds to their variances is uncorrelated
 *              grip, steering,       Their sd is the saved one, but at least a tenth of
 *              wheel radius          the sd in the settings and at most the sd in the
 *                                    settings
 *   A stiffness that has never been learnt starts from the settings. If the filter
 *   restarts because its state is not finite, each stiffness starts from the settings. */
tse_status tse_learnt_load(
    const tse_params *p, tse_filter *f, const uint8_t *in, size_t bytes, uint32_t age_s);

/* Check a learnt state as tse_learnt_load() does, without a filter.
 *   Returned:  TSE_OK, TSE_E_NULL, TSE_E_STATE (p is not from tse_prepare()),
 *              TSE_E_LEARNT, TSE_E_VERSION, TSE_E_OLD or TSE_E_VEHICLE. With one of the
 *              last four, *wrong (if wrong is not NULL) points to a string constant that
 *              names the wrong part of the file, such as "its checksum" or "mean of
 *              cy_rear". With any other result, *wrong is unchanged */
tse_status tse_learnt_check(const tse_params *p, const uint8_t *in, size_t bytes, const char **wrong);

#ifdef __cplusplus
}
#endif
#endif
