/* paper/resample.c - four schemes of resampling. Each chooses n ancestors, i.e. particles
 * that are copied, in proportion to the weights.
 *
 * Each scheme places n positions on the cumulative weights, scaled to 0 .. 1, and takes
 * the particles at these positions. The schemes differ in the positions (U: a uniform
 * random number; k = 0 .. n - 1; q: ratio of a weight to the sum of weights). The number
 * of a scheme is its value of the setting `resampling`:
 *   0 systematic   (k + U)/n, one U for all
 *   1 stratified   (k + U_k)/n, an independent U_k for each k
 *   2 residual     first floor(n q) copies of each particle. The remaining positions are
 *                  stratified on the cumulative remainders n q - floor(n q)
 *   3 multinomial  n sorted uniform numbers
 * See Douc, Cappe & Moulines, "Comparison of resampling schemes for particle filtering",
 * ISPA 2005. */
#include "paper/paper.h"
#include "number/random.h"

/* Return uniform random number k of a step. */
static tse_real draw_uniform(const uint32_t seed[2], uint32_t step, int32_t k)
{
  uint32_t a, b;
  random_words(seed, step, RANDOM_RESAMPLE, (uint32_t)k, &a, &b);
  return r_uniform(a);
}

/* Return position k of n positions on the cumulative weights, within [0, total):
 * (k + u) share, with u in (0, 1) and share = total/n. */
static tse_real compute_position(tse_real share, int32_t k, tse_real u)
{
  return r_add_sat(r_mul(share, r_from_int(k)), r_mul(share, u));
}

/* Choose ancestors by multinomial resampling: at n sorted uniform random positions on the
 * cumulative weights. */
static void choose_multinomial(const tse_real *weight, int32_t n, tse_real total, const uint32_t seed[2],
    uint32_t step, uint16_t *ancestor)
{
  /* sorted uniforms, the largest first: U_(k) = U_(k+1) U^(1/k), as logarithms */
  tse_real log2_u = TSE_R(0);
  tse_real above = total; /* cumulative weight of the particles up to i */
  int32_t i = n - 1;
  for (int32_t k = n; k >= 1; k--) {
    log2_u = log2_u + r_div(r_log2(draw_uniform(seed, step, k)), r_from_int(k));
    const tse_real at = r_mul(total, r_exp2(log2_u));
    while (i > 0 && !(above - weight[i] < at)) {
      above -= weight[i];
      i--;
    }
    ancestor[k - 1] = (uint16_t)i;
  }
}

/* Return floor(n q), q = weight/total: the number of copies of a particle that residual
 * resampling makes without a random number. */
static int32_t count_whole_copies(tse_real weight, int32_t n, tse_real total)
{
  return r_floor_to_int(r_div(r_mul(weight, r_from_int(n)), total));
}

/* Choose floor(n q) copies of each particle, and the remaining ancestors by stratified
 * resampling (q: weight / sum of the weights). */
static void choose_residual(const tse_real *weight, int32_t n, tse_real total, const uint32_t seed[2],
    uint32_t step, uint16_t *ancestor)
{
  int32_t filled = 0, k = 0;
  for (int32_t i = 0; i < n; i++) filled += count_whole_copies(weight[i], n, total);
  const int32_t rest = n - filled;          /* not negative, because copies are rounded down */
  const tse_real share = r_share(total, n); /* cumulative weight per copy */
  tse_real sum = TSE_R(0);
  int32_t j = 0;
  for (int32_t i = 0; i < n; i++) {
    int32_t copies = count_whole_copies(weight[i], n, total);
    sum = r_add_sat(sum, weight[i] - r_mul(share, r_from_int(copies)));
    while (k < rest && compute_position(share, k, draw_uniform(seed, step, k)) < sum) {
      copies++;
      k++;
    }
    for (; copies > 0 && j < n; copies--) ancestor[j++] = (uint16_t)i;
  }
  for (; j < n; j++)
    ancestor[j] = ancestor[j > 0 ? j - 1 : 0]; /* rounding may leave the last positions empty */
}

void paper_choose_ancestors(int32_t scheme, const tse_real *weight, int32_t n, const uint32_t seed[2],
    uint32_t step, uint16_t *ancestor)
{
  tse_real total = TSE_R(0), sum = TSE_R(0);
  for (int32_t i = 0; i < n; i++) total = r_add_sat(total, weight[i]);
  ancestor[0] = 0;
  if (scheme == 2) {
    choose_residual(weight, n, total, seed, step, ancestor);
    return;
  }
  if (scheme == 3) {
    choose_multinomial(weight, n, total, seed, step, ancestor);
    return;
  }

  const tse_real share = r_share(total, n);
  const tse_real one = draw_uniform(seed, step, 0);
  int32_t k = 0;
  for (int32_t i = 0; i < n; i++) {
    sum = r_add_sat(sum, weight[i]);
    while (k < n && compute_position(share, k, scheme == 1 ? draw_uniform(seed, step, k) : one) < sum)
      ancestor[k++] = (uint16_t)i;
  }
  for (; k < n; k++) ancestor[k] = ancestor[k > 0 ? k - 1 : 0]; /* rounding, as in choose_residual() */
}

/* Reorder the list of ancestors, so that each survivor i, i.e. each particle that occurs
 * in the list, is its own ancestor: ancestor[i] = i. Survivors are then not overwritten,
 * and all other particles become copies of survivors. paper_copy_particles() therefore
 * needs no second buffer. */
void paper_keep_survivors(uint16_t *ancestor, uint16_t *copies, int32_t n)
{
  for (int32_t i = 0; i < n; i++) copies[i] = 0;
  for (int32_t i = 0; i < n; i++) copies[ancestor[i]]++;
  int32_t donor = 0;
  for (int32_t i = 0; i < n; i++) {
    ancestor[i] = (uint16_t)i;
    if (copies[i] > 0) continue;
    while (copies[donor] < 2) donor++;
    copies[donor]--;
    ancestor[i] = (uint16_t)donor;
  }
}

void paper_copy_particles(tse_particles *p, const uint16_t *ancestor, int32_t n)
{
  for (tse_real *row = p->x[0]; row <= p->logw[0]; row += TSE_STRIDE) /* all rows of all members */
    for (int32_t i = 0; i < n; i++) row[i] = row[ancestor[i]];
}

/* Multiply Lambda of every particle by a random factor of mean 1, so that copies of a
 * particle differ (regularised resampling). The factor is 2^(k n - k^2 ln 2/2). n is a
 * standard normal number, and k is p->kernel, the sd of the log2 of the factor. */
static void scatter_spreads(const tse_params *p, tse_filter_paper *f)
{
  const tse_real k = p->kernel, half = r_mul(TSE_R(0.34657359027997264), r_mul(k, k));
  for (int32_t i = 0; i < pad_count(p->particles); i++) {
    uint32_t a, b;
    tse_real n, unused;
    random_words(p->seed, f->filter.step, RANDOM_KERNEL, (uint32_t)i, &a, &b);
    random_normal2(a, b, &n, &unused);
    const tse_real scale = r_exp2(r_mul(k, n) - half);
    for (int j = 0; j < 6; j++) f->p.lam[j][i] = r_mul(scale, f->p.lam[j][i]);
  }
}

void paper_resample(const tse_params *p, tse_filter_paper *f)
{
  paper_choose_ancestors(p->resampling, f->weight, p->particles, p->seed, f->filter.step, f->ancestor);
  paper_keep_survivors(f->ancestor, f->copies, p->particles);
  paper_copy_particles(&f->p, f->ancestor, p->particles);
  for (int32_t i = 0; i < pad_count(p->particles); i++) {
    f->p.logw[0][i] = TSE_R(0);
    f->weight[i] = i < p->particles ? TSE_R(1) : TSE_R(0);
  }
  f->log_total = r_log2(r_from_int(p->particles));
  if (p->kernel > TSE_R(0)) scatter_spreads(p, f);
}
