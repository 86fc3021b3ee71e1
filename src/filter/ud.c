/* filter/ud.c - covariance as U D U': see ud.h. */
#include "filter/ud.h"
#include "filter/limits.h"

void ud_set(tse_ud *p, const tse_real variance[STATES])
{
  for (int i = 0; i < STATES * (STATES - 1) / 2; i++) p->u[i] = r_short(TSE_R(0));
  for (int i = 0; i < STATES; i++) p->d[i] = r_max(variance[i], MIN_D);
  p->extras = 0;
}

/* Multiply an element d of D by share^2, but leave it at least MIN_D.
 *   Returned:  share * (old d)/(new d): factor for the column u of U above d. If the
 *              caller multiplies u by it, the covariances u d are multiplied by share.
 *              The factor is 1/share unless MIN_D limits the new d. In fixed point it is
 *              always 1/share */
static tse_real fade_d(tse_real *d, tse_real share)
{
  const tse_real before = *d;
  *d = r_max(r_mul(before, r_mul(share, share)), MIN_D);
#if defined(TSE_REAL_FIXED)
  const int follows = 1; /* in fixed point, before/MIN_D is too inaccurate, and would saturate U */
#else
  const int follows = *d > MIN_D;
#endif
  return follows ? r_div(TSE_R(1), share) : r_div(r_mul(before, share), *d);
}

#if !defined(TSE_NO_VELOCITY)
void ud_open(tse_ud *p, const tse_real variance[TSE_EXTRAS])
{
  p->extras = TSE_EXTRAS;
  for (int e = 0; e < TSE_EXTRAS; e++) {
    p->e[e] = r_max(variance[e], MIN_D);
    for (int j = 0; j < TSE_ALL; j++) p->w[e][j] = r_short(TSE_R(0));
  }
}

void ud_tie(tse_ud *p, int i, tse_real share)
{
  p->w[0][i] = r_short(r_long(p->w[0][i]) + share);
  for (int j = i + 1; j < STATES; j++)
    p->w[0][j] = r_short(r_long(p->w[0][j]) + r_mul(share, r_long(p->u[ud_column(j) + i])));
}

void ud_fade_extra(tse_ud *p, int e, tse_real share)
{
  const tse_real over = fade_d(&p->e[e], share);
  for (int k = 0; k < e; k++) p->w[k][STATES + e] = r_short(r_mul(r_long(p->w[k][STATES + e]), over));
  for (int j = 0; j < TSE_ALL; j++) p->w[e][j] = r_short(r_mul(r_long(p->w[e][j]), share));
}

void ud_renew(tse_ud *p, tse_real variance)
{
  for (int j = 0; j < TSE_ALL; j++) p->w[0][j] = r_short(TSE_R(0));
  p->e[0] = r_max(variance, MIN_D);
}
#endif

/* Add c a a' to the covariance of the extra states (described in ud.h).
 *   Given:    up  the elements of a are stored times 2^up (fixed point only)
 *   Updated:  a   overwritten with intermediate results */
static void add_to_extras(tse_ud *p, tse_short *a, int up, tse_real c)
{
  for (int e = EXTRAS_IN_USE(p) - 1; e >= 0; e--) {
    const tse_real own = r_long_scaled(a[e], up);
    if (own == TSE_R(0)) continue;
    const tse_real ca = r_mul(c, own), more = r_mul(ca, own), d = r_max(p->e[e] + more, MIN_D);
    const r_divided over = r_divisor(d);
    const r_factored share = r_quotient(ca, over, -up), pull = r_factor(-own, up);
    for (int k = 0; k < e; k++) r_add_in_turn(&p->w[k][STATES + e], &a[k], share, pull, 1);
    c = r_left(c, p->e[e], more, over);
    p->e[e] = d;
  }
}

void ud_set_block(tse_ud *p, int first, tse_real cov[TSE_KEPT][TSE_KEPT])
{
  for (int j = TSE_KEPT - 1; j >= 0; j--) {
    tse_short *const column = &p->u[ud_column(first + j) + first];
    for (int i = j; i >= 0; i--) {
      /* left: covariance of states i and j. own: variance of state i. The loop subtracts
       * the terms of the columns k > j of U, which are done: d_k u_ik u_jk from the
       * covariance, and d_k u_ik^2 from the variance. */
      tse_real left = cov[i][j];
      tse_real own = cov[i][i];
      for (int k = j + 1; k < TSE_KEPT; k++) {
        const tse_short *const u = &p->u[ud_column(first + k) + first];
        const tse_real taken = r_mul(p->d[first + k], r_long(u[i]));
        left -= r_mul(taken, r_long(u[j]));
        own -= r_mul(taken, r_long(u[i]));
      }
      /* Limit the covariance. A covariance above the limit comes from correlations that
       * contradict each other, so that no random vector can have all of them. */
      const tse_real limit = r_mul(MAX_CORRELATION, r_sqrt(r_mul(r_max(own, TSE_R(0)), p->d[first + j])));
      if (i == j) p->d[first + j] = r_max(left, MIN_D);
      else column[i] = r_short(r_div(r_clamp(left, -limit, limit), p->d[first + j]));
    }
  }
}

tse_real ud_covariance(const tse_ud *p, int i, int k)
{
  const int low = i < k ? i : k, high = i < k ? k : i;
  tse_real sum = low == high ? p->d[low] : r_mul(r_long(p->u[ud_column(high) + low]), p->d[high]);
  for (int j = high + 1; j < STATES; j++)
    sum += r_mul(r_mul_short(p->u[ud_column(j) + low], p->u[ud_column(j) + high]), p->d[j]);
  return sum;
}

tse_real ud_variance(const tse_ud *p, int i) { return ud_covariance(p, i, i); }

/* Do step j of the rank-one update P + c a a' (Agee & Turner): update element j of D, and
 * column j of W (rows of the extra states, see ud.h). Then the caller must update column
 * j of U. For each element u of it, with the element b of a in the same row, this is
 * first b += pull u, then u += share b.
 *   Given:     up  the elements of a are stored times 2^up (fixed point only)
 *   Updated:   a      elements of the extra states: the same b += pull u
 *              c      replaced by the c of the next step, j - 1
 *   Returned:  pull   -a_j
 *              share  c a_j / (new element j of D)
 *              0 if a_j is 0, so that the step changes nothing; otherwise 1 */
static int take_part(tse_ud *p, tse_short *a, int up, int j, tse_real *c, r_factored *share, r_factored *pull)
{
  const tse_real own = r_long_scaled(a[j], up);
  if (own == TSE_R(0)) return 0;
  const tse_real ca = r_mul(*c, own), more = r_mul(ca, own), d = r_max(p->d[j] + more, MIN_D);
  const r_divided over = r_divisor(d);
  *share = r_quotient(ca, over, -up);
  *pull = r_factor(-own, up);
  for (int e = 0; e < EXTRAS_IN_USE(p); e++) r_add_in_turn(&p->w[e][j], &a[STATES + e], *share, *pull, 1);
  *c = r_left(*c, p->d[j], more, over);
  p->d[j] = d;
  return 1;
}

void ud_add(tse_ud *p, const tse_real *a, int last, tse_real c)
{
  tse_short row[TSE_ALL];
  if (c == TSE_R(0)) return;
  const int up = r_scale_of(a, last + 1, r_scale_of(a + STATES, EXTRAS_IN_USE(p), 64));
  for (int j = 0; j <= last; j++) row[j] = r_short_scaled(a[j], up);
  for (int j = STATES; j < STATES + EXTRAS_IN_USE(p); j++) row[j] = r_short_scaled(a[j], up);
  for (int j = last; j >= 0; j--) { /* take columns j and j - 1 together if a_j and a_(j-1) are not 0 */
    r_factored share[2], pull[2];
    if (!take_part(p, row, up, j, &c, &share[0], &pull[0]) || j == 0) continue;
    tse_short *const u[2] = { &p->u[ud_column(j)], &p->u[ud_column(j - 1)] };
    r_add_in_turn(&u[0][j - 1], &row[j - 1], share[0], pull[0], 1);
    if (take_part(p, row, up, j - 1, &c, &share[1], &pull[1])) r_add_in_turn_twice(u, row, share, pull, --j);
    else r_add_in_turn(u[0], row, share[0], pull[0], j - 1);
  }
  add_to_extras(p, row + STATES, up, c);
}

void ud_add_at(tse_ud *p, int i, tse_real more)
{
  tse_real a[TSE_ALL];
  for (int j = 0; j < i; j++) a[j] = TSE_R(0);
  for (int e = 0; e < EXTRAS_IN_USE(p); e++) a[STATES + e] = TSE_R(0);
  a[i] = TSE_R(1);
  ud_add(p, a, i, more);
}

void ud_forget(tse_ud *p, const tse_real *variance, int count)
{
  for (int j = 0; j < count && EXTRAS_IN_USE(p); j++) { /* extra states keep their variance */
    tse_short a[TSE_EXTRAS];
    for (int e = 0; e < TSE_EXTRAS; e++) {
      a[e] = p->w[e][j];
      p->w[e][j] = r_short(TSE_R(0));
    }
    add_to_extras(p, a, 0, p->d[j]);
  }
  for (int j = 0; j < STATES; j++)
    for (int i = 0; i < count && i < j; i++) p->u[ud_column(j) + i] = r_short(TSE_R(0));
  for (int i = 0; i < count; i++) p->d[i] = r_max(variance[i], MIN_D);
}

/* Working matrix of the time update (Gram-Schmidt). It expresses the errors of the
 * predicted motion and of the extra states, one row each, as linear combinations of
 * independent errors, one column each, with their variances. The first MOTION columns are
 * the errors with the variances D of the motion, the others the process noise. The rows
 * of the motion are at first (F U, identity matrix), F being the transition matrix.
 * orthogonalise() makes them triangular, which gives the new columns of U. */
typedef struct sums {
  tse_short row[MOTION][2 * MOTION], extra[TSE_EXTRAS][2 * MOTION];
  tse_real variance[2 * MOTION];
} sums;

/* Compute the rows of the motion states (0 .. MOTION - 1) of the product F U. F is the
 * transition matrix.
 *   Given:     M  rows of F for the motion states
 *   Updated:   p  in these rows, columns MOTION .. STATES - 1 of U are replaced by F U
 *   Returned:  s  columns 0 .. MOTION - 1 of F U, which are not triangular */
static void multiply_by_u(tse_ud *p, tse_short M[MOTION][PLACES], sums *s)
{
  for (int j = STATES - 1; j >= 0; j--) {
    tse_short *const u = &p->u[ud_column(j)], sum[MOTION];
    for (int i = 0; i < MOTION; i++) sum[i] = M[i][j];
    r_slope_sums(sum, MOTION, M[0], PLACES, &u, 1, j);
    for (int i = 0; i < MOTION; i++) {
      if (j < MOTION) s->row[i][j] = sum[i];
      else u[i] = sum[i];
    }
  }
}

/* Orthogonalise the rows before j, and those of the extra states, with respect to row j
 * (weighted Gram-Schmidt). The rows after j are already done.
 *   Updated:  s
 *             p  column j of U and W, element j of D */
static void orthogonalise(tse_ud *p, sums *s, int j)
{
  tse_real v[2 * MOTION], d = TSE_R(0);
  tse_short room[2 * MOTION];
  int32_t right;
  for (int k = 0; k < 2 * MOTION; k++) {
    const tse_real own = r_long(s->row[j][k]);
    v[k] = r_mul(own, s->variance[k]);
    d += r_mul(v[k], own);
  }
  p->d[j] = r_max(d, MIN_D);
  const r_divided over = r_divisor(p->d[j]);
  const tse_short *const weighted = r_row(v, 2 * MOTION, room, &right);
  for (int i = 0; i < j; i++) {
    const tse_short share = r_short(r_by(r_sum(TSE_R(0), s->row[i], weighted, right, 2 * MOTION), over));
    p->u[ud_column(j) + i] = share;
    r_add_row(s->row[i], s->row[j], r_factor(-r_long(share), 0), 2 * MOTION);
  }
  for (int e = 0; e < EXTRAS_IN_USE(p); e++) {
    p->w[e][j] = r_short(r_by(r_sum(TSE_R(0), s->extra[e], weighted, right, 2 * MOTION), over));
    r_add_row(s->extra[e], s->row[j], r_factor(-r_long(p->w[e][j]), 0), 2 * MOTION);
  }
}

void ud_move(tse_ud *p, tse_short M[MOTION][PLACES], const tse_real noise[MOTION])
{
  sums s;
  multiply_by_u(p, M, &s);
  for (int k = 0; k < MOTION; k++) {
    s.variance[k] = p->d[k];
    s.variance[MOTION + k] = noise[k];
    for (int i = 0; i < MOTION; i++) s.row[i][MOTION + k] = r_short(i == k ? TSE_R(1) : TSE_R(0));
  }
  for (int e = 0; e < EXTRAS_IN_USE(p); e++)
    for (int k = 0; k < 2 * MOTION; k++) s.extra[e][k] = k < MOTION ? p->w[e][k] : r_short(TSE_R(0));
  for (int j = MOTION - 1; j >= 0; j--) orthogonalise(p, &s, j);
  /* add the part of the extra states that does not correlate with the motion */
  for (int k = 0; k < 2 * MOTION && EXTRAS_IN_USE(p); k++) {
    tse_short a[TSE_EXTRAS];
    for (int e = 0; e < TSE_EXTRAS; e++) a[e] = s.extra[e][k];
    add_to_extras(p, a, 0, s.variance[k]);
  }
}

void ud_fade(tse_ud *p, int i, tse_real share)
{
  const tse_real over = fade_d(&p->d[i], share);
  for (int k = 0; k < i; k++) p->u[ud_column(i) + k] = r_short(r_mul(r_long(p->u[ud_column(i) + k]), over));
  for (int e = 0; e < EXTRAS_IN_USE(p); e++) p->w[e][i] = r_short(r_mul(r_long(p->w[e][i]), over));
  for (int j = i + 1; j < STATES; j++)
    p->u[ud_column(j) + i] = r_short(r_mul(r_long(p->u[ud_column(j) + i]), share));
}

tse_real ud_measure_sparse(
    const tse_ud *p, const tse_real *h, const r_sparse *sparse, tse_real *f, tse_real *v)
{
  tse_real sum = TSE_R(0);
  int count = 0;
  for (int j = 0; j < STATES; j++) {
    tse_real s = r_sum_sparse(h[j], &p->u[ud_column(j)], sparse, count);
    if (count < sparse->count && sparse->at[count] == j) count++;
    for (int e = 0; e < EXTRAS_IN_USE(p); e++) s += r_mul(r_long(p->w[e][j]), h[STATES + e]);
    f[j] = s;
    v[j] = r_mul(p->d[j], s);
    sum += r_mul(v[j], s);
  }
  for (int e = 0; e < EXTRAS_IN_USE(p); e++) {
    tse_real s = h[STATES + e];
    for (int k = 0; k < e; k++) s += r_mul(r_long(p->w[k][STATES + e]), h[STATES + k]);
    f[STATES + e] = s;
    v[STATES + e] = r_mul(p->e[e], s);
    sum += r_mul(v[STATES + e], s);
  }
  return sum;
}

tse_real ud_measure(const tse_ud *p, const tse_real *h, tse_real *f, tse_real *v)
{
  r_sparse sparse;
  r_sparse_of(h, STATES, &sparse);
  return ud_measure_sparse(p, h, &sparse, f, v);
}

void ud_correct(tse_ud *p, const tse_real *f, const tse_real *v, tse_real h_P_h, tse_real r, tse_real *gain)
{
  tse_short g[TSE_ALL];
  const int up = r_scale_of_variance(h_P_h + r);
  tse_real s = r;
  r_divided over = r_divisor(s);
  for (int e = 0; e < EXTRAS_IN_USE(p); e++) {
    const tse_real before = s, more = r_mul(v[STATES + e], f[STATES + e]);
    const r_factored pull = r_quotient(-f[STATES + e], over, -up), push = r_factor(v[STATES + e], up);
    s += more;
    over = r_divisor(s);
    p->e[e] = r_max(r_left(p->e[e], before, more, over), MIN_D);
    for (int k = 0; k < e; k++) r_add_both(&p->w[k][STATES + e], &g[STATES + k], pull, push, 1);
    g[STATES + e] = r_short_of(push, v[STATES + e], up);
  }
  for (int j = 0; j < STATES; j += 2) { /* process two columns at once */
    const int columns = j + 1 < STATES ? 2 : 1;
    tse_short *const u[2] = { &p->u[ud_column(j)], &p->u[ud_column(j + 1)] };
    r_factored pull[2], push[2];
    for (int c = 0; c < columns; c++) {
      const tse_real before = s, more = r_mul(v[j + c], f[j + c]);
      pull[c] = r_quotient(-f[j + c], over, -up);
      push[c] = r_factor(v[j + c], up);
      s += more;
      over = r_divisor(s);
      p->d[j + c] = r_max(r_left(p->d[j + c], before, more, over), MIN_D);
      for (int e = 0; e < EXTRAS_IN_USE(p); e++)
        r_add_both(&p->w[e][j + c], &g[STATES + e], pull[c], push[c], 1);
      g[j + c] = r_short_of(push[c], v[j + c], up);
    }
    if (columns < 2) {
      r_add_both(u[0], g, pull[0], push[0], j);
      continue;
    }
    r_add_both_twice(u, g, pull, push, j);
    r_add_both(&u[1][j], &g[j], pull[1], push[1], 1);
  }
  const r_factored share = r_quotient(TSE_R(1), over, -up);
  for (int i = 0; i < STATES + EXTRAS_IN_USE(p); i++) gain[i] = r_times(g[i], share);
}
