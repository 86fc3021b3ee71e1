/* filter/ud.c - U D U': see ud.h. */
#include "filter/ud.h"
#include "filter/limits.h"

void ud_set(tse_ud *p, const tse_real variance[STATES])
{
  for (int i = 0; i < STATES * (STATES - 1) / 2; i++) p->u[i] = TSE_R(0);
  for (int i = 0; i < STATES; i++) p->d[i] = r_max(variance[i], LEAST_D);
  p->extras = 0;
}

#if !defined(TSE_NO_VELOCITY)
void ud_open(tse_ud *p, const tse_real variance[TSE_EXTRAS])
{
  p->extras = TSE_EXTRAS;
  for (int e = 0; e < TSE_EXTRAS; e++) {
    p->e[e] = r_max(variance[e], LEAST_D);
    for (int j = 0; j < TSE_ALL; j++) p->w[e][j] = TSE_R(0);
  }
}

void ud_tie(tse_ud *p, int i, tse_real share)
{
  p->w[0][i] += share;
  for (int j = i + 1; j < STATES; j++) p->w[0][j] += r_mul(share, p->u[ud_column(j) + i]);
}

void ud_fade_extra(tse_ud *p, int e, tse_real share)
{
  const tse_real over = r_div(TSE_R(1), share);
  for (int k = 0; k < e; k++) p->w[k][STATES + e] = r_mul(p->w[k][STATES + e], over);
  for (int j = 0; j < TSE_ALL; j++) p->w[e][j] = r_mul(p->w[e][j], share);
  p->e[e] = r_max(r_mul(p->e[e], r_mul(share, share)), LEAST_D);
}

void ud_renew(tse_ud *p, tse_real variance)
{
  for (int j = 0; j < TSE_ALL; j++) p->w[0][j] = TSE_R(0);
  p->e[0] = r_max(variance, LEAST_D);
}
#endif

/* Add c a a' to the covariance of the extra states alone.   Updated: a is used up */
static void extras_add(tse_ud *p, tse_real *a, tse_real c)
{
  for (int e = EXTRAS_IN_USE(p) - 1; e >= 0; e--) {
    if (a[e] == TSE_R(0)) continue;
    const tse_real ca = r_mul(c, a[e]), d = r_max(p->e[e] + r_mul(ca, a[e]), LEAST_D), share = r_div(ca, d);
    for (int k = 0; k < e; k++) {
      a[k] -= r_mul(a[e], p->w[k][STATES + e]);
      p->w[k][STATES + e] += r_mul(share, a[k]);
    }
    c = r_mul(c, r_div(p->e[e], d));
    p->e[e] = d;
  }
}

void ud_set_block(tse_ud *p, int first, tse_real cov[TSE_KEPT][TSE_KEPT])
{
  for (int j = TSE_KEPT - 1; j >= 0; j--) {
    tse_real *const column = &p->u[ud_column(first + j) + first];
    for (int i = j; i >= 0; i--) {
      tse_real left = cov[i][j], own = cov[i][i]; /* of the covariance, of the variance of i: what columns behind j have not taken */
      for (int k = j + 1; k < TSE_KEPT; k++) {
        const tse_real *const u = &p->u[ud_column(first + k) + first], taken = r_mul(p->d[first + k], u[i]);
        left -= r_mul(taken, u[j]);
        own -= r_mul(taken, u[i]);
      }
      const tse_real most = r_mul(LARGEST_CORRELATION, r_sqrt(r_mul(r_max(own, TSE_R(0)), p->d[first + j]))); /* correlations that contradict each other */
      if (i == j) p->d[first + j] = r_max(left, LEAST_D);
      else column[i] = r_div(r_clamp(left, -most, most), p->d[first + j]);
    }
  }
}

tse_real ud_common(const tse_ud *p, int i, int k)
{
  const int low = i < k ? i : k, high = i < k ? k : i;
  tse_real sum = low == high ? p->d[low] : r_mul(p->u[ud_column(high) + low], p->d[high]);
  for (int j = high + 1; j < STATES; j++) sum += r_mul(r_mul(p->u[ud_column(j) + low], p->u[ud_column(j) + high]), p->d[j]);
  return sum;
}

tse_real ud_variance(const tse_ud *p, int i) { return ud_common(p, i, i); }

void ud_add(tse_ud *p, tse_real *a, int last, tse_real c)
{
  for (int j = last; j >= 0; j--) {
    tse_real *const u = &p->u[ud_column(j)];
    if (a[j] == TSE_R(0)) continue;
    const tse_real ca = r_mul(c, a[j]), d = r_max(p->d[j] + r_mul(ca, a[j]), LEAST_D), share = r_div(ca, d);
    for (int k = 0; k < j; k++) {
      a[k] -= r_mul(a[j], u[k]);
      u[k] += r_mul(share, a[k]);
    }
    for (int e = 0; e < EXTRAS_IN_USE(p); e++) {
      a[STATES + e] -= r_mul(a[j], p->w[e][j]);
      p->w[e][j] += r_mul(share, a[STATES + e]);
    }
    c = r_mul(c, r_div(p->d[j], d));
    p->d[j] = d;
  }
  extras_add(p, a + STATES, c);
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
    tse_real a[TSE_EXTRAS];
    for (int e = 0; e < TSE_EXTRAS; e++) {
      a[e] = p->w[e][j];
      p->w[e][j] = TSE_R(0);
    }
    extras_add(p, a, p->d[j]);
  }
  for (int j = 0; j < STATES; j++)
    for (int i = 0; i < count && i < j; i++) p->u[ud_column(j) + i] = TSE_R(0);
  for (int i = 0; i < count; i++) p->d[i] = r_max(variance[i], LEAST_D);
}

/* Rows of the motion before they are triangular again, as sums over independent errors: those of the states in motion, then their
 * noise. */
typedef struct sums {
  tse_real row[MOTION][2 * MOTION], extra[TSE_EXTRAS][2 * MOTION], variance[2 * MOTION];
} sums;

/* Multiply M by U.   Updated: columns of U behind the motion, which may be anything   Returned: w  columns of the motion */
static void transform(tse_ud *p, tse_real M[MOTION][COLUMNS], tse_real w[MOTION][2 * MOTION])
{
  tse_real sum[MOTION];
  for (int j = STATES - 1; j >= 0; j--) {
    tse_real *const u = &p->u[ud_column(j)];
    for (int i = 0; i < MOTION; i++) {
      sum[i] = M[i][j];
      for (int k = 0; k < j; k++) sum[i] += r_mul(M[i][k], u[k]);
    }
    for (int i = 0; i < MOTION; i++) {
      if (j < MOTION) w[i][j] = sum[i];
      else u[i] = sum[i];
    }
  }
}

/* Take state j, which all behind it have been taken from, out of the rows before it and of the extra states: weighted
 * Gram-Schmidt.
 *   Updated: s; column j of U and W, D of state j */
static void take_out(tse_ud *p, sums *s, int j)
{
  tse_real v[2 * MOTION], d = TSE_R(0);
  for (int k = 0; k < 2 * MOTION; k++) {
    v[k] = r_mul(s->row[j][k], s->variance[k]);
    d += r_mul(v[k], s->row[j][k]);
  }
  p->d[j] = r_max(d, LEAST_D);
  for (int i = 0; i < j; i++) {
    tse_real common = TSE_R(0);
    for (int k = 0; k < 2 * MOTION; k++) common += r_mul(s->row[i][k], v[k]);
    const tse_real share = r_div(common, p->d[j]);
    p->u[ud_column(j) + i] = share;
    for (int k = 0; k < 2 * MOTION; k++) s->row[i][k] -= r_mul(share, s->row[j][k]);
  }
  for (int e = 0; e < EXTRAS_IN_USE(p); e++) {
    tse_real common = TSE_R(0);
    for (int k = 0; k < 2 * MOTION; k++) common += r_mul(s->extra[e][k], v[k]);
    p->w[e][j] = r_div(common, p->d[j]);
    for (int k = 0; k < 2 * MOTION; k++) s->extra[e][k] -= r_mul(p->w[e][j], s->row[j][k]);
  }
}

void ud_move(tse_ud *p, tse_real M[MOTION][COLUMNS], const tse_real noise[MOTION])
{
  sums s;
  transform(p, M, s.row);
  for (int k = 0; k < MOTION; k++) {
    s.variance[k] = p->d[k];
    s.variance[MOTION + k] = noise[k];
    for (int i = 0; i < MOTION; i++) s.row[i][MOTION + k] = i == k ? TSE_R(1) : TSE_R(0);
  }
  for (int e = 0; e < EXTRAS_IN_USE(p); e++)
    for (int k = 0; k < 2 * MOTION; k++) s.extra[e][k] = k < MOTION ? p->w[e][k] : TSE_R(0);
  for (int j = MOTION - 1; j >= 0; j--) take_out(p, &s, j);
  for (int k = 0; k < 2 * MOTION && EXTRAS_IN_USE(p); k++) { /* what the motion as it is now does not explain of them */
    tse_real a[TSE_EXTRAS];
    for (int e = 0; e < TSE_EXTRAS; e++) a[e] = s.extra[e][k];
    extras_add(p, a, s.variance[k]);
  }
}

void ud_fade(tse_ud *p, int i, tse_real share)
{
  const tse_real over = r_div(TSE_R(1), share);
  for (int k = 0; k < i; k++) p->u[ud_column(i) + k] = r_mul(p->u[ud_column(i) + k], over);
  for (int e = 0; e < EXTRAS_IN_USE(p); e++) p->w[e][i] = r_mul(p->w[e][i], over);
  p->d[i] = r_max(r_mul(p->d[i], r_mul(share, share)), LEAST_D);
  for (int j = i + 1; j < STATES; j++) p->u[ud_column(j) + i] = r_mul(p->u[ud_column(j) + i], share);
}

tse_real ud_measure(const tse_ud *p, const tse_real *h, tse_real *f, tse_real *v)
{
  tse_real sum = TSE_R(0);
  int at[STATES], count = 0;
  for (int j = 0; j < STATES; j++) {
    const tse_real *const u = &p->u[ud_column(j)];
    tse_real s = h[j];
    for (int k = 0; k < count; k++) s += r_mul(u[at[k]], h[at[k]]);
    if (h[j] != TSE_R(0)) at[count++] = j;
    for (int e = 0; e < EXTRAS_IN_USE(p); e++) s += r_mul(p->w[e][j], h[STATES + e]);
    f[j] = s;
    v[j] = r_mul(p->d[j], s);
    sum += r_mul(v[j], s);
  }
  for (int e = 0; e < EXTRAS_IN_USE(p); e++) {
    tse_real s = h[STATES + e];
    for (int k = 0; k < e; k++) s += r_mul(p->w[k][STATES + e], h[STATES + k]);
    f[STATES + e] = s;
    v[STATES + e] = r_mul(p->e[e], s);
    sum += r_mul(v[STATES + e], s);
  }
  return sum;
}

void ud_correct(tse_ud *p, const tse_real *f, const tse_real *v, tse_real r, tse_real *gain)
{
  tse_real s = r;
  for (int e = 0; e < EXTRAS_IN_USE(p); e++) {
    const tse_real before = s, own = v[STATES + e];
    s += r_mul(own, f[STATES + e]);
    const tse_real pull = -r_div(f[STATES + e], before);
    p->e[e] = r_max(r_mul(p->e[e], r_div(before, s)), LEAST_D);
    for (int k = 0; k < e; k++) {
      const tse_real was = p->w[k][STATES + e];
      p->w[k][STATES + e] = was + r_mul(gain[STATES + k], pull);
      gain[STATES + k] += r_mul(was, own);
    }
    gain[STATES + e] = own;
  }
  for (int j = 0; j < STATES; j++) {
    tse_real *const u = &p->u[ud_column(j)];
    const tse_real before = s;
    s += r_mul(v[j], f[j]);
    const tse_real pull = -r_div(f[j], before);
    p->d[j] = r_max(r_mul(p->d[j], r_div(before, s)), LEAST_D);
    for (int i = 0; i < j; i++) {
      const tse_real was = u[i];
      u[i] = was + r_mul(gain[i], pull);
      gain[i] += r_mul(was, v[j]);
    }
    for (int e = 0; e < EXTRAS_IN_USE(p); e++) {
      const tse_real was = p->w[e][j];
      p->w[e][j] = was + r_mul(gain[STATES + e], pull);
      gain[STATES + e] += r_mul(was, v[j]);
    }
    gain[j] = v[j];
  }
  const tse_real over = r_div(TSE_R(1), s);
  for (int i = 0; i < STATES + EXTRAS_IN_USE(p); i++) gain[i] = r_mul(gain[i], over);
}
