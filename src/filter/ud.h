/* filter/ud.h - a covariance as U D U', U unit upper triangular, D diagonal. Internal.
 *
 * Rounding leaves D positive and U D U' symmetric: variances are never negative, no
 * matrix is inverted, and half the digits of a covariance are enough. References:
 * Bierman, Factorization Methods for Discrete Sequential Estimation (1977), V.3
 * (measurement) and VI.4 (time); Agee & Turner (1972), rank-one update. Columns of U
 * above the diagonal are stored one after the other.
 *
 * Extra states are those of a measured velocity. No other state depends on them, so they
 * stand before the others in U: each adds a row above those of the others, and leaves
 * them unchanged. In vectors (a, h, f, v, gain) they follow the others. While p->extras
 * is 0 these places are not read. */
#ifndef TSE_UD_H
#define TSE_UD_H

#include "model/car.h"
#include "number/vector.h"

/* Number of extra states in use: a constant in builds without velocities. */
#if defined(TSE_NO_VELOCITY)
#define EXTRAS_IN_USE(p) 0
enum { MAX_EXTRAS = 0 };
#else
#define EXTRAS_IN_USE(p) ((p)->extras)
enum { MAX_EXTRAS = (int)TSE_EXTRAS };
#endif

/* Return the place of column j in u. */
static inline int ud_column(int j) { return j * (j - 1) / 2; }

/* ----------------------------------------------------------------------- set and read */

/* Set a diagonal covariance without extra states. */
void ud_set(tse_ud *p, const tse_real variance[STATES]);

/* Set the covariance of the TSE_KEPT states from `first` on. They must not correlate with
 * other states yet. Correlations are limited to MAX_CORRELATION. */
void ud_set_block(tse_ud *p, int first, tse_real cov[TSE_KEPT][TSE_KEPT]);

/* Return the variance of state i.    O(STATES) time */
tse_real ud_variance(const tse_ud *p, int i);

/* Return the covariance of states i and k.    O(STATES) time */
tse_real ud_covariance(const tse_ud *p, int i, int k);

/* ----------------------------------------------------------------------------- change */

/* Add c a a' to the covariance.
 *   Given:   a     STATES elements, then those of the extra states in use
 *            last  last of the STATES elements that is not 0; -1 if all are 0
 *   O(last^2) time */
void ud_add(tse_ud *p, const tse_real *a, int last, tse_real c);

/* Add `more` to the variance of state i. */
void ud_add_at(tse_ud *p, int i, tse_real more);

/* Multiply state i by share, 0 < share <= 1: its row and column of the covariance. */
void ud_fade(tse_ud *p, int i, tse_real share);

/* Set the variances of the states before `count` and remove their correlations. The
 * covariance of the other states stays. */
void ud_forget(tse_ud *p, const tse_real *variance, int count);

/* Propagate the covariance to F P F' + Q.
 *   Given:   M      first MOTION rows of F (r_slope()), the others are the identity's
 *            noise  diagonal of Q
 *   O(MOTION STATES^2 / 2) time */
void ud_move(tse_ud *p, tse_short M[MOTION][PLACES], const tse_real noise[MOTION]);

/* ------------------------------------------------------------------------ measurement */

/* Compute h' P h, the variance by the state of a scalar measurement with slopes h.
 *   Given:     h  STATES elements, then the extra states in use; f, v, gain alike
 *   Returned:  f = U' h, v = D f, for ud_correct() */
tse_real ud_measure(const tse_ud *p, const tse_real *h, tse_real *f, tse_real *v);

/* Compute the same where the elements of h that are not 0 are known.
 *   Given:     sparse  the first STATES elements of h */
tse_real ud_measure_sparse(
    const tse_ud *p, const tse_real *h, const r_sparse *sparse, tse_real *f, tse_real *v);

/* Update the covariance with a scalar measurement.
 *   Given:     f, v, h_P_h  from ud_measure()      r  variance of the measurement noise
 *   Returned:  gain  P h/(h' P h + r) */
void ud_correct(tse_ud *p, const tse_real *f, const tse_real *v, tse_real h_P_h, tse_real r, tse_real *gain);

/* ----------------------------------------------------------------------- extra states */

/* Bring all extra states into use with these variances, uncorrelated. */
void ud_open(tse_ud *p, const tse_real variance[TSE_EXTRAS]);

/* Add share times state i to the first extra state. */
void ud_tie(tse_ud *p, int i, tse_real share);

/* Multiply extra state e by share. */
void ud_fade_extra(tse_ud *p, int e, tse_real share);

/* Set the variance of the first extra state and remove its correlations. */
void ud_renew(tse_ud *p, tse_real variance);

#endif
