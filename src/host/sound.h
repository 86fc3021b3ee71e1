/* host/sound.h - checks of a state of unknown origin, used by filter and simulator. A
 * state is sound if each number is in its range. Internal. */
#ifndef TSE_SOUND_H
#define TSE_SOUND_H

#include "model/state.h"
#include "number/vector.h"
#include "tse/tse.h"

/* Max magnitudes of the numbers of a sound state: small enough that no computation with
 * them overflows.
 *   MOST_REAL      all numbers but those named below
 *   MOST_SQUARE    squares and products, such as mean squares, covariances and the
 *                  variance of an innovation; numbers divided by the sd of a sensor (the
 *                  sd may be as small as 1e-5); stored samples of lags and delays
 *   MOST_VARIANCE  [squared unit of the state] elements of D in the covariance U D U',
 *                  and tse_kalman.moved. Even the variances of an unknown motion are
 *                  smaller
 *   MOST_U         elements u of U in U D U': sqrt(MOST_VARIANCE/MIN_D). In fixed point u
 *                  is limited by its type
 *   MOST_PART      d u^2, the part that an element u of U adds to a variance, d being the
 *                  element of D of the same column. A larger part could overflow
 *                  in float */
#if defined(TSE_REAL_FIXED)
#define MOST_REAL FIXED_MOST
#define MOST_SQUARE MOST_REAL
#define MOST_VARIANCE MOST_REAL
#else
#define MOST_REAL TSE_R(1e9)
#define MOST_SQUARE TSE_R(1e18)
#define MOST_VARIANCE TSE_R(1e13)
#define MOST_U TSE_R(1e14)
#define MOST_PART TSE_R(1e31)
#endif

/* Return whether lo <= x <= hi. */
static inline int sound_int(int32_t x, int32_t lo, int32_t hi) { return x >= lo && x <= hi; }

/* Return whether n numbers lie in lo .. hi; NaN does not. */
static inline int sound_reals(const tse_real *x, int n, tse_real lo, tse_real hi)
{
  int fine = 1;
  for (int i = 0; i < n; i++) fine = fine && x[i] >= lo && x[i] <= hi;
  return fine;
}

/* Return whether n numbers of type tse_short are in the range of a sound state. */
static inline int sound_shorts(const tse_short *x, int n)
{
  int fine = 1;
#if defined(TSE_REAL_FIXED)
  for (int i = 0; i < n; i++) fine = fine && x[i] >= -MAX_SHORT && x[i] < MAX_SHORT;
#else
  fine = sound_reals(x, n, -MOST_REAL, MOST_REAL);
#endif
  return fine;
}

#if !defined(TSE_NO_EFFECTS)
/* Return whether a delay line is sound: the ages of its samples increase. */
static inline int sound_delay(const tse_delay *d)
{
  int fine = sound_int(d->count, 0, TSE_DELAY_ROWS)
      && sound_reals(d->age, TSE_DELAY_ROWS, TSE_R(0), MOST_REAL);
  for (int i = 1; fine && i < d->count; i++) fine = d->age[i] > d->age[i - 1];
  return fine;
}
#endif

/* Return whether the memory of the effects is sound. */
static inline int sound_memory(const tse_effect_memory *m)
{
  int fine = sound_int(m->settled, 0, 1);
#if !defined(TSE_NO_EFFECTS)
  fine = fine && sound_int(m->steered, 0, 1) && sound_delay(&m->steer) && sound_delay(&m->imu);
  fine = fine && sound_reals(m->lag, 4, -MOST_REAL, MOST_REAL)
      && sound_reals(m->mode[0], 6, -MOST_SQUARE, MOST_SQUARE);
  fine = fine && sound_reals(m->steer_was[0], TSE_DELAY_ROWS, -MOST_REAL, MOST_REAL);
  fine = fine && sound_reals(m->imu_was[0], 3 * TSE_DELAY_ROWS, -MOST_SQUARE, MOST_SQUARE);
  fine = fine && sound_reals(&m->time, 1, -MOST_REAL, MOST_REAL)
      && sound_reals(&m->heading, 1, -MOST_REAL, MOST_REAL);
  fine = fine && sound_reals(m->steered_by, 3, -MOST_REAL, MOST_REAL);
  fine = fine && sound_delay(&m->formula_late)
      && sound_reals(m->formula_was[0], TSE_DELAY_ROWS, -MOST_REAL, MOST_REAL);
  fine = fine && sound_reals(m->formula[0], 3 * TSE_FORMULA_MEMORIES, -MOST_REAL, MOST_REAL)
      && sound_reals(m->formula_accel, 2, -MOST_REAL, MOST_REAL);
#endif
  return fine;
}

#endif
