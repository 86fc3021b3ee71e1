/* paper/weigh.c - equations (22), (23): weight each particle by its likelihood. */
#include "paper/paper.h"

#define MIN_LOG2_WEIGHT TSE_R(-120) /* min log2(weight / largest weight); smaller weights are negligible */

/* Return g(x) = Gamma(x + 1/2)/Gamma(x), x >= 2. g(x + 4) is computed by the asymptotic
 * series for large arguments. The recursion g(x) = g(x + 1) x/(x + 1/2) then gives g(x).
 * The first neglected term of the series is 399/(262144 y^5) at y = x + 4 >= 6, so that
 * the relative error is below 2e-7 (6/y)^5. */
static tse_real compute_gamma_ratio(tse_real x)
{
  tse_real back = TSE_R(1);
  for (int i = 0; i < 4; i++) {
    back = r_mul(back, r_div(x, x + TSE_R(0.5)));
    x = x + TSE_R(1);
  }
  const tse_real t = r_div(TSE_R(1), x);
  const tse_real series = TSE_R(1)
      + r_mul(t,
          TSE_R(-0.125)
              + r_mul(
                  t, TSE_R(0.0078125) + r_mul(t, TSE_R(0.0048828125) + r_mul(t, TSE_R(-21.0 / 32768.0)))));
  return r_mul(r_mul(r_sqrt(x), series), back);
}

/* Return log2 of the factor of the Student-t density that is common to all particles. If
 * d_y channels are used, it is
 *   Gamma((nut + d_y)/2)/Gamma(nut/2) (pi nut)^(-d_y/2) |P + R|^(-1/2),
 * divided by the product of the sds of the sensors. The division converts the density
 * from measurements in sds of the sensors to measurements in SI units. */
static tse_real compute_log2_common(const tse_params *p, const common *n, const sample *y)
{
  const tse_real half = r_mul(TSE_R(0.5), n->nut);
  tse_real c = TSE_R(0);
  if (y->used == 1) c = r_log2(compute_gamma_ratio(half));
  if (y->used == 2) c = r_log2(half);
  if (y->used == 3) c = r_log2(compute_gamma_ratio(half)) + r_log2(half + TSE_R(0.5));
  c = c
      - r_mul(
          r_mul(TSE_R(0.5), r_from_int(y->used)), r_log2(n->nut) + TSE_R(1.6514961294723187)); /* log2 pi */
  for (int i = 0; i < 3; i++)
    if (y->use[i] > TSE_R(0)) c = c - p->log_sd[i];
  /* weigh_all() computes |S| from all three channels. S is the scale matrix of the
   * whitened innovation. For a missing channel the row of the matrix d of (9) is 0, so
   * that the channel contributes the factor n->r, the scale of the noise, to |S|. Remove
   * this factor. */
  c = c + r_mul(r_mul(TSE_R(0.5), r_from_int(3 - y->used)), r_log2(n->r));
  return c + r_log2(n->l[0]) + r_log2(n->l[1]) + r_log2(n->l[2]);
}

/* Add the log-likelihood of the sample to every log-weight, without the part that is
 * common to all particles (compute_log2_common()). */
static void weigh_all(const tse_params *TSE_RESTRICT p, const common *TSE_RESTRICT c,
    const sample *TSE_RESTRICT y, tse_particles *TSE_RESTRICT q)
{
  const int32_t count = pad_count(p->particles);
  for (int32_t i = 0; i < count; i++) {
    const innovation e = compute_innovation(p, c, y, q, i);
    /* add -log2|S|/2 - (nut + d_y)/2 log2(1 + e.q/nut), d_y: number of channels used,
     * e.q: innovation' S^-1 innovation */
    q->logw[0][i] = q->logw[0][i] - r_mul(TSE_R(0.5), r_log2_of_product(e.s1, e.s2, e.s3))
        - r_mul(c->half_dof, r_log2(TSE_R(1) + r_mul(e.q, c->inv_nut)));
  }
}

tse_real paper_update_weights(const tse_params *p, tse_filter_paper *f, const sample *y, const common *c)
{
  const tse_real before = f->log_total;
  weigh_all(p, c, y, &f->p);
  const tse_real largest = paper_normalise(p, f);
  return largest + f->log_total - before + compute_log2_common(p, c, y);
}

tse_real paper_normalise(const tse_params *p, tse_filter_paper *f)
{
  tse_real *const logw = f->p.logw[0];
  const int32_t n = p->particles;
  tse_real lane[TSE_LANES];
  for (int l = 0; l < TSE_LANES; l++) lane[l] = logw[l]; /* n >= 16 */
  for (int32_t i = 0; i + TSE_LANES <= n; i += TSE_LANES)
    for (int l = 0; l < TSE_LANES; l++) lane[l] = r_max(lane[l], logw[i + l]);
  for (int32_t i = n / TSE_LANES * TSE_LANES; i < n; i++) lane[0] = r_max(lane[0], logw[i]);
  tse_real largest = lane[0];
  for (int l = 1; l < TSE_LANES; l++) largest = r_max(largest, lane[l]);
  const int32_t count = pad_count(n);
  if (!r_is_finite(largest)) { /* no usable density: all weights become equal */
    for (int32_t i = 0; i < count; i++) logw[i] = TSE_R(0);
    largest = TSE_R(0);
  }
  for (int32_t i = 0; i < count; i++) {
    logw[i] = r_max(logw[i] - largest, MIN_LOG2_WEIGHT);
    f->weight[i] = r_exp2(logw[i]);
  }
  for (int32_t i = n; i < count; i++) f->weight[i] = TSE_R(0);
  f->log_total = r_log2(paper_total_weight(p, f));
  return largest;
}
