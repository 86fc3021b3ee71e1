/* src/bias.c - what time does to the statistics (17) and to the biases (18), and the gyro at standstill. */
#include "stages.h"

#define NU_LEAST TSE_R(6) /* A and Sigma need nu > 4; reached only with a short memory and long time steps */

/* (17) gamma /= lambda, nu *= lambda, Lambda *= lambda (lam = Lambda/nu stays), with lambda^(dt/sample_time). */
void forget(const tse_params *p, tse_filter *f, tse_real dt)
{
  const tse_real lambda = r_exp2(r_mul(p->log2_forgetting, r_mul(dt, p->inv_sample_time)));
  f->gamma = r_div(f->gamma, lambda);
  f->nu = r_max(r_mul(f->nu, lambda), NU_LEAST);
}

/* (18) P += Q dt, up to the variance that the biases started with or one sigma, whichever is larger. */
void bias_predict(const tse_params *p, tse_filter *f, tse_real dt)
{
  for (int a = 0; a < 3; a++)
    f->bias_var[a] = r_min(f->bias_var[a] + r_mul(p->bias_walk[a], dt), r_max(p->bias_var0[a], TSE_R(1)));
}

/* While the wheels stand still the yaw rate is zero, so the gyro reads its bias. The accelerometers are left alone:
 * what they read at standstill is bias plus the slope of the road. */
void bias_learn_still(const tse_params *p, tse_filter *f, const sample *y)
{
  const tse_real gain = r_mul(y->use[2], r_div(f->bias_var[2], f->bias_var[2] + TSE_R(1)));
  const int32_t count = padded(p->particles);
  for (int32_t i = 0; i < count; i++) f->p.bias[2][i] += r_mul(gain, y->y[2] - f->p.bias[2][i]);
  f->bias_var[2] = f->bias_var[2] - r_mul(gain, f->bias_var[2]);
}
