/* filter/ud.h - a covariance P as U D U', U unit upper triangular, D diagonal. Internal.
 *
 * In this form rounding leaves D positive and P symmetric: variances are never negative,
 * no matrix is inverted, and half the number of digits is sufficient. References:
 * Bierman, Factorization Methods for Discrete Sequential Estimation (1977), V.3
 * (measurement) and VI.4 (time); Agee & Turner (1972), rank-one update. Only the elements
 * of U above the diagonal are stored, one column after the other (p->u).
 *
 * Extra states, for example the heading (velocity.c), exist only after a velocity has
 * been measured. No other state depends on them. They come first in U, where each adds a
 * row at the top and leaves the rows of the other states unchanged. The added rows are
 * called W and are stored in p->w. In vectors (a, h, f, v, gain), however, the extra
 * states come last. While p->extras is 0, no extra states are in use, and their elements
 * of these vectors are not read. */
#ifndef TSE_UD_H
#define TSE_UD_H

#include "model/car.h"
#include "number/vector.h"

/* Number of extra states in use. In a build without measured velocities it is the
 * constant 0, so that the compiler removes the code for extra states. */
#if defined(TSE_NO_VELOCITY)
#define EXTRAS_IN_USE(p) 0
enum { MAX_EXTRAS = 0 };
#else
#define EXTRAS_IN_USE(p) ((p)->extras)
enum { MAX_EXTRAS = (int)TSE_EXTRAS };
#endif

/* Return the index of the first element of column j in u. */
static inline int ud_column(int j) { return j * (j - 1) / 2; }

/* -------------------------------------------------------- set and read the covariance */

/* Set the covariance to the diagonal matrix of these variances. After the call, no extra
 * states are in use. */
void ud_set(tse_ud *p, const tse_real variance[STATES]);

/* Set the covariance of the TSE_KEPT states from state `first` on, which are the states
 * in a file of a learnt state. Before the call they must not correlate with other states.
 * Correlations are limited to MAX_CORRELATION. */
void ud_set_block(tse_ud *p, int first, tse_real cov[TSE_KEPT][TSE_KEPT]);

/* Return the variance of state i.    O(STATES) time */
tse_real ud_variance(const tse_ud *p, int i);

/* Return the covariance of states i and k.    O(STATES) time */
tse_real ud_covariance(const tse_ud *p, int i, int k);

/* -------------------------------------------------------------- change the covariance */

/* Add c a a' to the covariance.
 *   Given:   a     STATES elements, then one of each extra state in use
 *            last  index of the last nonzero one of the STATES elements; -1 if all are 0
 *   O(last^2) time */
void ud_add(tse_ud *p, const tse_real *a, int last, tse_real c);

/* Add `more` to the variance of state i. */
void ud_add_at(tse_ud *p, int i, tse_real more);

/* Multiply row and column i of the covariance by share, 0 < share <= 1. */
void ud_fade(tse_ud *p, int i, tse_real share);

/* Set the variances of the first `count` states, and remove all their correlations. The
 * covariance of the other states remains. */
void ud_forget(tse_ud *p, const tse_real *variance, int count);

/* Propagate the covariance to F P F' + Q.
 *   Given:   M      first MOTION rows of F, in the number format of r_slope()
 *                   (number/vector.h). The other rows of F equal those of the identity
 *                   matrix
 *            noise  diagonal of Q for the first MOTION states
 *   O(MOTION * STATES^2) time */
void ud_move(tse_ud *p, tse_short M[MOTION][PLACES], const tse_real noise[MOTION]);

/* ------------------------------------------- update the covariance with a measurement */

/* Return h' P h: the part of the variance of a scalar measurement
 * that is due to the state.
 *   Given:     h  partial derivatives of the measurement: STATES elements, then one per
 *                 extra state in use. The same holds for f, v and gain
 *   Returned:  f = U' h, v = D f, for ud_correct() */
tse_real ud_measure(const tse_ud *p, const tse_real *h, tse_real *f, tse_real *v);

/* Return the same as ud_measure(). This function is faster, because the caller has
 * already found the nonzero elements of h.
 *   Given:     sparse  nonzero elements among the first STATES of h */
tse_real ud_measure_sparse(
    const tse_ud *p, const tse_real *h, const r_sparse *sparse, tse_real *f, tse_real *v);

/* Update the covariance with a scalar measurement.
 *   Given:     f, v, h_P_h  from ud_measure()
 *              r            variance of the measurement noise
 *   Returned:  gain  P h/(h' P h + r) */
void ud_correct(tse_ud *p, const tse_real *f, const tse_real *v, tse_real h_P_h, tse_real r, tse_real *gain);

/* ----------------------------------------------------------------------- extra states */

/* Start to use all extra states, with these variances and no correlations. */
void ud_open(tse_ud *p, const tse_real variance[TSE_EXTRAS]);

/* Change the covariance as if state i times share were added to the first extra state. */
void ud_tie(tse_ud *p, int i, tse_real share);

/* Change the covariance as if extra state e were multiplied by share. */
void ud_fade_extra(tse_ud *p, int e, tse_real share);

/* Set the variance of the first extra state, and remove all its correlations. */
void ud_renew(tse_ud *p, tse_real variance);

#endif
