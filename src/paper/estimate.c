/* paper/estimate.c - equations (26), (27): estimates from the moments of the
 * particles. */
#include "paper/paper.h"

/* Return the sum of weight times value, saturated in fixed point. It is computed as
 * TSE_LANES partial sums: the compiler vectorises this loop, and the order of summation
 * is the same on every machine. */
static tse_real sum_products(const tse_real *weight, const tse_real *value, int32_t count)
{
  tse_real lane[TSE_LANES], sum = TSE_R(0);
  for (int l = 0; l < TSE_LANES; l++) lane[l] = TSE_R(0);
  for (int32_t i = 0; i < count; i += TSE_LANES)
    for (int l = 0; l < TSE_LANES; l++) lane[l] = r_add_sat(lane[l], r_mul(weight[i + l], value[i + l]));
  for (int l = 0; l < TSE_LANES; l++) sum = r_add_sat(sum, lane[l]);
  return sum;
}

/* The sum never saturates: there are up to 2^16 weights, each at most 1. */
tse_real paper_total_weight(const tse_params *p, const tse_filter_paper *f)
{
  tse_real lane[TSE_LANES], total = TSE_R(0);
  for (int l = 0; l < TSE_LANES; l++) lane[l] = TSE_R(0);
  for (int32_t i = 0; i < pad_count(p->particles); i += TSE_LANES)
    for (int l = 0; l < TSE_LANES; l++) lane[l] = r_add_sat(lane[l], f->weight[i + l]);
  for (int l = 0; l < TSE_LANES; l++) total = r_add_sat(total, lane[l]);
  return total;
}

/* Compute the weighted mean and variance of `count` values. The sums use the differences
 * to the first value. Otherwise, in single precision, rounding would hide a spread of
 * mm/s at a speed of 20 m/s. */
static void compute_moments(const tse_real *weight, const tse_real *value, int32_t count, tse_real total,
    tse_real *mean, tse_real *var)
{
  const tse_real origin = value[0];
  tse_real first[TSE_LANES], second[TSE_LANES], a = TSE_R(0), b = TSE_R(0);
  for (int l = 0; l < TSE_LANES; l++) first[l] = second[l] = TSE_R(0);
  for (int32_t i = 0; i < count; i += TSE_LANES)
    for (int l = 0; l < TSE_LANES; l++) {
      const tse_real t = value[i + l] - origin, wt = r_mul(weight[i + l], t);
      first[l] = r_add_sat(first[l], wt);
      second[l] = r_add_sat(second[l], r_mul(wt, t));
    }
  for (int l = 0; l < TSE_LANES; l++) {
    a = r_add_sat(a, first[l]);
    b = r_add_sat(b, second[l]);
  }
  const tse_real shift = r_div(a, total);
  *mean = origin + shift;
  *var = r_max(TSE_R(0), r_div(b, total) - r_mul(shift, shift));
}

void paper_weighted_means(
    const tse_params *p, const tse_filter_paper *f, const tse_real *const *rows, int n, tse_real *means)
{
  const tse_real total = paper_total_weight(p, f);
  for (int k = 0; k < n; k++)
    means[k] = r_div(sum_products(f->weight, rows[k], pad_count(p->particles)), total);
}

tse_real paper_effective_size(const tse_params *p, const tse_filter_paper *f)
{
  const tse_real total = paper_total_weight(p, f);
  return r_mul(total, r_div(total, sum_products(f->weight, f->weight, pad_count(p->particles))));
}

void paper_estimate(const tse_params *p, const tse_filter_paper *f, tse_output *y)
{
  const tse_particles *const q = &f->p;
  const int32_t count = pad_count(p->particles);
  static const int diagonal[3] = { 0, 3, 5 };
  const tse_real total = paper_total_weight(p, f);
  tse_real x[3], var;

  tse_real *const state[3] = { &y->vel_x, &y->vel_y, &y->yaw_rate };
  tse_real *const state_sd[3] = { &y->vel_x_sd, &y->vel_y_sd, &y->yaw_rate_sd };
  for (int a = 0; a < 3; a++) {
    compute_moments(f->weight, q->x[a], count, total, &x[a], &var);
    *state[a] = x[a];
    *state_sd[a] = r_sqrt(var);
  }
  y->sideslip = r_max(r_abs(x[0]), r_abs(x[1])) < TSE_R(0.01) ? TSE_R(0) : r_atan2(x[1], x[0]);

  /* The mean of the inverse-Wishart covariance of w is Lambda/(nu - d_w - 1) = lam inv,
   * with Lambda = nu lam and the dimension d_w = 3 of w. */
  const tse_real inv = r_div(f->nu, f->nu - TSE_R(4));
  for (int a = 0; a < 3; a++) {
    tse_real mean;
    compute_moments(f->weight, q->mu[a], count, total, &mean, &var);
    const tse_real sigma = r_mul(inv, r_div(sum_products(f->weight, q->lam[diagonal[a]], count), total));
    y->stiffness[a] = y->stiffness_secant[a] = TSE_R(1) + mean; /* tyres are linear */
    y->stiffness_sd[a] = r_sqrt(r_mul(f->gamma, sigma) + var);
    y->stiffness_spread[a] = r_sqrt(sigma);
    compute_moments(f->weight, q->bias[a], count, total, &mean, &var);
    y->bias[a] = r_mul(p->sd[a], mean);
    y->bias_sd[a] = r_mul(p->sd[a], r_sqrt(f->bias_var[a] + var));
  }
}

void report_particles(
    const tse_params *p, const tse_filter *filter, tse_output *now, tse_real lam[6], tse_real *nu)
{
  const tse_filter_paper *const f = (const tse_filter_paper *)filter;
  const tse_real *const rows[6] = { f->p.lam[0], f->p.lam[1], f->p.lam[2], f->p.lam[3], f->p.lam[4],
    f->p.lam[5] };
  paper_estimate(p, f, now);
  paper_weighted_means(p, f, rows, 6, lam);
  *nu = f->nu;
}
