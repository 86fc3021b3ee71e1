/* estimator/start.c - initial estimate of the particle filter if no learnt state is
 * loaded, and its output before the first step. */
#include "estimator/stages.h"

void start_of_settings(const tse_params *p, tse_start *s)
{
  memset(s, 0, sizeof *s);
  s->gamma = p->gamma0;
  s->nu = p->nu0;
  s->lam[0] = s->lam[3] = s->lam[5] = p->lam0;
  for (int a = 0; a < 3; a++) {
    s->mu[a] = p->mu0[a];
    s->mean_var[a] = p->mean_var0;
    s->bias_var[a] = p->bias_var0[a];
  }
}

void report_start(const tse_params *p, const tse_filter *f, tse_output *now)
{
  static const int diagonal[3] = { 0, 3, 5 }; /* indices of the diagonal of lam */
  tse_real *const state_sd[3] = { &now->vel_x_sd, &now->vel_y_sd, &now->yaw_rate_sd };
  tse_start s = f->start;
  if (!s.loaded) start_of_settings(p, &s);
  now->vel_x = p->vel_x0;
  now->n_eff = r_from_int(p->particles);
  for (int a = 0; a < 3; a++) {
    const tse_real sigma = r_mul(s.lam[diagonal[a]], r_div(s.nu, s.nu - TSE_R(4)));
    now->stiffness[a] = now->stiffness_secant[a] = TSE_R(1)
        + r_clamp(s.mu[a], p->w_min, p->w_max); /* the first row clips the particles to this range */
    now->stiffness_sd[a] = r_sqrt(s.mean_var[a]);
    now->stiffness_spread[a] = r_sqrt(sigma);
    now->bias[a] = r_mul(p->sd[a], s.bias[a]);
    now->bias_sd[a] = r_mul(p->sd[a], r_sqrt(s.bias_var[a]));
    now->noise[a] = now->change_ratio[a] = TSE_R(1);
    *state_sd[a] = p->x_sd0[a];
  }
}
