/* filter/ud.h - a covariance as U D U': U unit upper triangular, D diagonal. Internal.
 *
 * D stays positive whatever is rounded, and U D U' symmetric: no inverse, no negative
 * variance, and half the digits of a covariance. Bierman, Factorization Methods for
 * Discrete Sequential Estimation (1977): V.3 measurement, VI.4 time; rank one: Agee &
 * Turner (1972). Columns of U above the diagonal lie one after the other. */
#ifndef TSE_UD_H
#define TSE_UD_H

#include "model/car.h"
#include "number/vector.h"

#if defined(TSE_NO_VELOCITY) /* known when it is compiled */
#define EXTRAS_IN_USE(p) 0
enum { MOST_EXTRAS = 0 };
#else
#define EXTRAS_IN_USE(p) ((p)->extras)
enum { MOST_EXTRAS = (int)TSE_EXTRAS };
#endif

/* Place in u of column j. */
static inline int ud_column(int j) { return j * (j - 1) / 2; }

/* Set a diagonal covariance, with no extra states. */
void ud_set(tse_ud *p, const tse_real variance[STATES]);

/* Set the covariance of TSE_KEPT states from `first` on, which have none with the others
 * yet. */
void ud_set_block(tse_ud *p, int first, tse_real cov[TSE_KEPT][TSE_KEPT]);

/* Return the variance of state i, the covariance of states i and k.    O(STATES) time */
tse_real ud_variance(const tse_ud *p, int i);
tse_real ud_covariance(const tse_ud *p, int i, int k);

/* Add c a a' to the covariance.
 *   Given:   a  STATES elements and those of the extra states in use      last  last
 *               element of the first STATES that is not 0; -1: none
 *   O(last^2) time */
void ud_add(tse_ud *p, const tse_real *a, int last, tse_real c);

/* Add `more` to the variance of state i. */
void ud_add_at(tse_ud *p, int i, tse_real more);

/* Set the variance of the states before `count`, with no covariance with any other; the
 * others keep theirs. */
void ud_forget(tse_ud *p, const tse_real *variance, int count);

/* Move the covariance to F P F' + Q.
 *   Given:   M  rows of F before MOTION (r_slope()), the others are those of the identity
 *               noise  diagonal of Q      O(MOTION STATES^2 / 2) time */
void ud_move(tse_ud *p, tse_short M[MOTION][PLACES], const tse_real noise[MOTION]);

/* Multiply state i by share, 0 < share <= 1. */
void ud_fade(tse_ud *p, int i, tse_real share);

/* Weigh a scalar measurement with slopes h. All vectors have STATES elements and those of
 * the extra states in use.
 *   Returned: f = U' h, v = D f; h' P h, the variance of the state in the innovation */
tse_real ud_measure(const tse_ud *p, const tse_real *h, tse_real *f, tse_real *v);
/* The same.   Given: own  the first STATES elements of h */
tse_real ud_measure_sparse(const tse_ud *p, const tse_real *h, const r_sparse *own, tse_real *f, tse_real *v);

/* Correct the covariance by that measurement, with noise of variance r; own: what
 * ud_measure() returned.   Returned: gain, as long as f */
void ud_correct(tse_ud *p, const tse_real *f, const tse_real *v, tse_real own, tse_real r, tse_real *gain);

/* Extra states, which no other depends on: they stand before the others, so that U has a
 * row for each above those of the others, and all others are as if there were none. In
 * vectors (a, h, f, v, gain) they follow the others; while extras is 0 nobody reads those
 * places.
 *   ud_open        bring all of them into use, with these variances and no covariance
 *   ud_tie         add share times state i to the first
 *   ud_fade_extra  multiply extra state e by share
 *   ud_renew       set the variance of the first, with no covariance with any other */
void ud_open(tse_ud *p, const tse_real variance[TSE_EXTRAS]);
void ud_tie(tse_ud *p, int i, tse_real share);
void ud_fade_extra(tse_ud *p, int e, tse_real share);
void ud_renew(tse_ud *p, tse_real variance);

#endif
