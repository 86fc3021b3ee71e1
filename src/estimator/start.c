/* estimator/start.c - where a filter starts that was loaded with nothing. */
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
    s->spread_var[a] = p->initial_spread_var;
    s->noise_var[a] = TSE_R(1);
  }
}
