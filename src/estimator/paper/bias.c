/* estimator/paper/bias.c - (18), (19): the sensor biases, Gaussian given a particle's path, with one covariance P for all
 * particles. P0, Q and R are diagonal and each bias is in one channel only, so P stays diagonal: a variance a channel. */
#include "estimator/paper/particles.h"

/* (18) P += Q dt, up to the variance that the biases started with or one sigma, whichever is larger. */
void bias_predict(const tse_params *p, tse_filter_paper *f, tse_real dt)
{
  for (int a = 0; a < 3; a++)
    f->bias_var[a] = r_min(r_add_sat(f->bias_var[a], r_mul(p->bias_walk[a], dt)), r_max(p->bias_var0[a], TSE_R(1)));
}

/* C = H P H' + R with R = 1 sigma^2. */
int bias_observe(const tse_filter_paper *f, const sample *y, bias_gains *c)
{
  tse_real sum = TSE_R(0);
  for (int a = 0; a < 3; a++) {
    const tse_real ph = r_mul(f->bias_var[a], y->use[a]);
    c->l[a] = r_div(TSE_R(1), r_sqrt(r_mul(y->use[a], ph) + TSE_R(1)));
    c->gain[a] = r_mul(c->l[a], ph);
    sum += c->l[a] + r_abs(c->gain[a]);
  }
  return r_is_finite(sum);
}

/* (19) of the variance: P - (P H' C^-1/2)^2; that of the means is in draw_and_learn(). */
void bias_update(tse_filter_paper *f, const bias_gains *c)
{
  for (int a = 0; a < 3; a++) f->bias_var[a] = r_max(f->bias_var[a] - r_mul(c->gain[a], c->gain[a]), TSE_R(0));
}

/* While the wheels stand still the yaw rate is zero, so the gyro reads its bias. The accelerometers are left alone:
 * what they read at standstill is bias plus the slope of the road. */
void bias_learn_still(const tse_params *p, tse_filter_paper *f, const sample *y)
{
  const tse_real var = f->bias_var[2];
  const tse_real gain = r_mul(y->use[2], r_div(var, var + TSE_R(1)));
  for (int32_t i = 0; i < padded(p->particles); i++) f->p.bias[2][i] += r_mul(gain, y->y[2] - f->p.bias[2][i]);
  f->bias_var[2] = var - r_mul(gain, var);
}
