/* estimator/paper/estimate.c - (26), (27): what the weighted particles say; and which stiffness the recent inputs have excited. */
#include "estimator/paper/particles.h"

#define EXCITATION_TIME TSE_R(0.1) /* s */

/* Weighted mean and variance of n values; variance about the first value, then shifted, so that a spread of millimetres
 * a second on 20 m/s survives in single precision. Lanes as everywhere: fixed order of summation. */
static void moments(const tse_real *weight, const tse_real *value, int32_t count, tse_acc total, tse_real *mean, tse_real *var)
{
  const tse_real origin = value[0];
  tse_acc first[TSE_LANES], second[TSE_LANES], a = acc_zero(), b = acc_zero();
  for (int l = 0; l < TSE_LANES; l++) first[l] = second[l] = acc_zero();
  for (int32_t i = 0; i < count; i += TSE_LANES)
    for (int l = 0; l < TSE_LANES; l++) {
      const tse_real t = value[i + l] - origin, wt = r_mul(weight[i + l], t);
      first[l] = acc_add(first[l], wt);
      second[l] = acc_add_mul(second[l], wt, t);
    }
  for (int l = 0; l < TSE_LANES; l++) {
    a = acc_merge(a, first[l]);
    b = acc_merge(b, second[l]);
  }
  const tse_real shift = acc_div(a, total);
  *mean = origin + shift;
  *var = r_max(TSE_R(0), acc_div(b, total) - r_mul(shift, shift));
}

static tse_real mean_of(const tse_real *weight, const tse_real *value, int32_t count, tse_acc total)
{
  tse_acc sum[TSE_LANES], a = acc_zero();
  for (int l = 0; l < TSE_LANES; l++) sum[l] = acc_zero();
  for (int32_t i = 0; i < count; i += TSE_LANES)
    for (int l = 0; l < TSE_LANES; l++) sum[l] = acc_add_mul(sum[l], weight[i + l], value[i + l]);
  for (int l = 0; l < TSE_LANES; l++) a = acc_merge(a, sum[l]);
  return acc_div(a, total);
}

static tse_acc total_weight(const tse_filter_paper *f, int32_t count)
{
  tse_acc lanes[TSE_LANES], total = acc_zero();
  for (int l = 0; l < TSE_LANES; l++) lanes[l] = acc_zero();
  for (int32_t i = 0; i < count; i += TSE_LANES)
    for (int l = 0; l < TSE_LANES; l++) lanes[l] = acc_add(lanes[l], f->weight[i + l]);
  for (int l = 0; l < TSE_LANES; l++) total = acc_merge(total, lanes[l]);
  return total;
}

void weighted_means(const tse_params *p, const tse_filter_paper *f, const tse_real *const *rows, int n, tse_real *means)
{
  const int32_t count = padded(p->particles);
  const tse_acc total = total_weight(f, count);
  for (int k = 0; k < n; k++) means[k] = mean_of(f->weight, rows[k], count, total);
}

tse_real effective_size(const tse_params *p, const tse_filter_paper *f)
{
  const int32_t count = padded(p->particles);
  const tse_acc total = total_weight(f, count);
  tse_acc lanes[TSE_LANES], squares = acc_zero();
  for (int l = 0; l < TSE_LANES; l++) lanes[l] = acc_zero();
  for (int32_t i = 0; i < count; i += TSE_LANES)
    for (int l = 0; l < TSE_LANES; l++) lanes[l] = acc_add_mul(lanes[l], f->weight[i + l], f->weight[i + l]);
  for (int l = 0; l < TSE_LANES; l++) squares = acc_merge(squares, lanes[l]);
  return r_mul(acc_to_real(total), acc_div(total, squares));
}

void estimate(const tse_params *p, const tse_filter_paper *f, tse_output *y)
{
  const tse_particles *const q = &f->p;
  const int32_t count = padded(p->particles);
  static const int diagonal[3] = { 0, 3, 5 };
  const tse_acc total = total_weight(f, count);
  tse_real x[3], var;

  tse_real *const state[3] = { &y->vel_x, &y->vel_y, &y->yaw_rate };
  tse_real *const state_sd[3] = { &y->vel_x_sd, &y->vel_y_sd, &y->yaw_rate_sd };
  for (int a = 0; a < 3; a++) {
    moments(f->weight, q->x[a], count, total, &x[a], &var);
    *state[a] = x[a];
    *state_sd[a] = r_sqrt(var);
  }
  y->sideslip = r_max(r_abs(x[0]), r_abs(x[1])) < TSE_R(0.01) ? TSE_R(0) : r_atan2(x[1], x[0]);

  const tse_real inv = r_div(f->nu, f->nu - TSE_R(4)); /* Lambda/(nu - d_w - 1) = lam nu/(nu - 4) */
  for (int a = 0; a < 3; a++) {
    tse_real mean;
    moments(f->weight, q->mu[a], count, total, &mean, &var);
    const tse_real sigma = r_mul(inv, mean_of(f->weight, q->lam[diagonal[a]], count, total));
    y->stiffness[a] = TSE_R(1) + mean;
    y->stiffness_sd[a] = r_sqrt(r_mul(f->gamma, sigma) + var);
    y->stiffness_spread[a] = r_sqrt(sigma);
    moments(f->weight, q->bias[a], count, total, &mean, &var);
    y->bias[a] = r_mul(p->sd[a], mean);
    y->bias_sd[a] = r_mul(p->sd[a], r_sqrt(f->bias_var[a] + var));
  }
}

/* A stiffness shows only where its force changes: a constant slip (angle) is explained as well by another velocity and
 * another stiffness. So its regressor phi (a column of d, in sigma per unit of w) is judged by its variance over the
 * recent past. A mean over `memory` samples, each with noise 1 + phi^2 spread^2, then has the variance
 *     (1 + E[phi^2] spread^2) / (memory var(phi)),
 * which must be below valid_sd^2 for the stiffness to be valid, and below hold_sd^2 for it to be learnt at all: where nothing
 * shows it, the draws of (25) come from the prior, and learning from them would be a random walk of the filter's own making.
 * The past is two memories long: velocity, once settled by a change, is remembered longer than the stiffness is.
 * Regressors are smoothed first: noise of a wheel-speed sensor looks like slip, but moves no car. */
void excitation(const tse_params *p, tse_filter_paper *f, const sample *y, const tse_output *est, int32_t excited[3])
{
  const slips s = vehicle_slips(p, est->vel_x, est->vel_y, est->yaw_rate, y->u);
  const observation o = vehicle_observation(vehicle_observation_gains(p, TSE_R(1), TSE_R(1)), s, y->u.steer);
  const tse_real phi[3] = { o.d11, o.d22, o.d23 };
  const tse_real window = r_mul(TSE_R(2), p->memory), seen = f->filter.seen;
  const tse_real smooth = r_div(y->dt, y->dt + EXCITATION_TIME);
  const tse_real gain = r_div(TSE_R(1), r_min(window, seen + TSE_R(1)));
  for (int a = 0; a < 3; a++) {
    f->excite[a] += r_mul(smooth, phi[a] - f->excite[a]);
    f->excite_mean[a] += r_mul(gain, f->excite[a] - f->excite_mean[a]);
    f->excite_sq[a] += r_mul(gain, r_mul(f->excite[a], f->excite[a]) - f->excite_sq[a]);
    const tse_real var = f->excite_sq[a] - r_mul(f->excite_mean[a], f->excite_mean[a]);
    const tse_real spread_var = r_mul(est->stiffness_spread[a], est->stiffness_spread[a]);
    const tse_real noise = TSE_R(1) + r_mul(f->excite_sq[a], spread_var), signal = r_mul(p->memory, var);
    excited[a] = noise <= r_mul(p->valid_var, signal);
    const int always = seen < p->memory || !(p->hold_var > TSE_R(0));
    f->learn[a] = always || noise <= r_mul(p->hold_var, signal) ? TSE_R(1) : TSE_R(0);
  }
}

void report_particles(const tse_params *p, const tse_filter *filter, tse_output *now, tse_real lam[6], tse_real *nu)
{
  const tse_filter_paper *const f = (const tse_filter_paper *)filter;
  const tse_real *const rows[6] = { f->p.lam[0], f->p.lam[1], f->p.lam[2], f->p.lam[3], f->p.lam[4], f->p.lam[5] };
  estimate(p, f, now);
  weighted_means(p, f, rows, 6, lam);
  *nu = f->nu;
}
