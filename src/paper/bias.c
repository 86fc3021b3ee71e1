/* paper/bias.c - equations (18) and (19): sensor biases. Given the path of a particle,
 * the biases are Gaussian, with the same covariance P for all particles. The initial P,
 * the process noise Q and the sensor noise R are diagonal, and each bias affects one
 * channel. P therefore stays diagonal: one variance per channel. */
#include "paper/paper.h"
#include "tables/input.h"

#define MAX_BIAS TSE_R(2000) /* [sd of the sensor noise] max magnitude of a bias, to prevent overflow */
#define MAX_BIAS_VARIANCE TSE_R(16777216) /* [sd^2 of the sensor noise] 2^24: max variance of a bias */

/* Predict the biases, equation (18): P += Q dt. */
void paper_predict_bias(const tse_params *p, tse_filter_paper *f, tse_real dt)
{
  for (int a = 0; a < 3; a++)
    f->bias_var[a] = r_min(r_add_sat(f->bias_var[a], r_mul(p->bias_walk[a], dt)), MAX_BIAS_VARIANCE);
}

/* Return the max magnitude of the bias of a channel, in sds of the sensor noise: the
 * upper end of the channel's range, which no sensor error exceeds, but at most MAX_BIAS.
 * Without this limit, if the motion of a particle diverged, its bias would compensate for
 * this motion and reach thousands of m/s2. Motion diverges only if both settings and
 * inputs are unrealistic. */
static tse_real find_max_bias(const tse_params *p, int channel)
{
  const channel_row *const row = &channel_rows[(int)TSE_CHANNEL_accel_x + channel];
  return r_min(MAX_BIAS, r_mul(row->hi, p->inv_sd[channel]));
}

/* Compute the quantities of equations (19) and (22) to (25) that are common to all
 * particles. R is 1, because measurements are divided by the sds of their noise. */
common paper_compute_common(const tse_params *p, const tse_filter_paper *f, const sample *y)
{
  common c;
  c.g = particle_observation_gains(p, y->use[0], y->use[1]);
  for (int a = 0; a < 3; a++) {
    const tse_real ph = r_mul(f->bias_var[a], y->use[a]);
    c.l[a] = r_div(TSE_R(1), r_sqrt(ph + TSE_R(1)));
    c.gain[a] = r_mul(c.l[a], ph);
    c.max_bias[a] = find_max_bias(p, a);
  }
  c.nut = f->nu - TSE_R(2);
  c.inv_nut = r_div(TSE_R(1), c.nut);
  c.a = r_mul(TSE_R(1) + f->gamma, r_mul(f->nu, c.inv_nut));
  c.r = r_mul(c.nut - TSE_R(2), c.inv_nut);
  c.half_dof = r_mul(TSE_R(0.5), c.nut + r_from_int(y->used));
  return c;
}

static tse_real clip_bias(tse_real b, tse_real max) { return r_clamp(b, -max, max); }

/* Correct the biases of every particle. The correction is the bias gain times the
 * innovation given w: the difference between the measurement and its prediction with w,
 * the relative deviations of the stiffnesses that were drawn for the particle. */
static void update_biases(const tse_params *TSE_RESTRICT p, const common *TSE_RESTRICT c,
    const sample *TSE_RESTRICT y, tse_particles *TSE_RESTRICT q)
{
  for (int32_t i = 0; i < pad_count(p->particles); i++) {
    const slips s = vehicle_slips(p, q->x[0][i], q->x[1][i], q->x[2][i], y->u);
    const observation o = particle_observation(c->g, s, y->u.steer);
    const tse_real w0 = q->w[0][i], w1 = q->w[1][i], w2 = q->w[2][i];
    const tse_real e0 = y->y[0] - o.h1 - r_mul(o.d11, w0) - r_mul(o.d12, w1) - q->bias[0][i];
    const tse_real e1 = y->y[1] - o.h2 - r_mul(o.d21, w0) - r_mul(o.d22, w1) - r_mul(o.d23, w2)
        - q->bias[1][i];
    const tse_real e2 = y->y[2] - r_mul(q->x[2][i], p->inv_sd[2]) - q->bias[2][i];
    q->bias[0][i] = clip_bias(q->bias[0][i] + r_mul(c->gain[0], r_mul(c->l[0], e0)), c->max_bias[0]);
    q->bias[1][i] = clip_bias(q->bias[1][i] + r_mul(c->gain[1], r_mul(c->l[1], e1)), c->max_bias[1]);
    q->bias[2][i] = clip_bias(q->bias[2][i] + r_mul(c->gain[2], r_mul(c->l[2], e2)), c->max_bias[2]);
  }
}

/* Update the biases b, equation (19):
 *   b += K (y - h - d w - b),  P -= K S K',  K = P S^-1,  S = P + R
 * h + d w is the measurement predicted without a bias, w the drawn relative deviations of
 * the stiffnesses. */
void paper_update_bias(const tse_params *p, tse_filter_paper *f, const sample *y, const common *c)
{
  update_biases(p, c, y, &f->p);
  for (int a = 0; a < 3; a++)
    f->bias_var[a] = r_max(f->bias_var[a] - r_mul(c->gain[a], c->gain[a]), TSE_R(0));
}
