/* paper/learn.c - equations (25), (16), (17): draw w, the relative deviation of each
 * stiffness from its nominal value, given the measurements of the row; update the
 * statistics of w (gamma, nu, mu, Lambda); forget old rows in them. Particles are
 * processed in runs of RUN particles, so that their random numbers stay in the cache. */
#include "paper/paper.h"
#include "number/random.h"

#define RUN 64
#define MIN_NU TSE_R(6) /* min degrees of freedom. The scale of (22), (nut - 2)/nut with nut = nu - 2, and
                         * the covariance Lambda/(nu - 4) of w require nu > 4. The limit is reached only
                         * with a short memory and long time steps */
#define MIN_LOG2_KEPT TSE_R(-20) /* [log2] min forgetting factor per row: keeps at least 2^-20 of the past */
#define TINY TSE_R(1e-6 * 1e-6) /* min pivot of a Cholesky factor: rounding may give 0 or less */
#if defined(TSE_REAL_FIXED)
#undef TINY
#define TINY ((tse_real)16) /* [2^-32] the root of a smaller pivot has too few digits */
#endif

/* Constants of the adaptive forgetting. gamma is the ratio of the variance of the mean
 * stiffness to the variance of the stiffness about its mean. Forgetting divides gamma by
 * lambda_mu, so that a smaller lambda_mu forgets faster. The usual value of lambda_mu is
 * the setting `forgetting_mean` or, if this is at most 0.5, the setting `forgetting`.
 * lambda_mu decreases, but not below the setting `forgetting_change`, while the
 * low-passed innovations are larger than low-passed white noise would be, because the
 * mean stiffness is then probably wrong. If `forgetting_change` is not below the usual
 * value, lambda_mu is constant. */
#define SLOW_TIME TSE_R(0.1) /* [s] time constant of the low pass of the innovations */
#define USUAL_RATIO TSE_R(3) /* [1] ratio of the mean square of the low-passed innovations to that of
                              * low-passed white noise, up to which lambda_mu does not change */
#define LAMBDA_SLOPE TSE_R(0.05) /* [1] decrease of lambda_mu per unit of the ratio above USUAL_RATIO */

/* Draw three Student-t variates, t[0] .. t[2], for each of up to RUN particles. */
static void draw_student(
    const tse_params *p, uint32_t step, int32_t base, int32_t count, tse_real dof, tse_real t[3][RUN])
{
  uint32_t u[4][RUN];
  const tse_real minus_2_nu = r_div(TSE_R(-2), dof);
  const tse_real inv_nu2 = r_div(TSE_R(1), dof + TSE_R(2));
  const tse_real minus_2_nu2 = r_mul(TSE_R(-2), inv_nu2);
  for (int32_t i = 0; i < count; i++) {
    random_words(p->seed, step, RANDOM_DRAW_A, (uint32_t)(base + i), &u[0][i], &u[1][i]);
    random_words(p->seed, step, RANDOM_DRAW_B, (uint32_t)(base + i), &u[2][i], &u[3][i]);
  }
  for (int32_t i = 0; i < count; i++) {
    const uint32_t words[4] = { u[0][i], u[1][i], u[2][i], u[3][i] };
    random_student3(words, dof, minus_2_nu, minus_2_nu2, inv_nu2, &t[0][i], &t[1][i], &t[2][i]);
  }
}

/* Limit a drawn w, the relative deviation of a stiffness: reflect it at w_low, and clip
 * it at w_max. With the setting reflect_draws w_low is stiffness_min - 1, so that the
 * stiffness 1 + w stays positive. Without this setting w_low is min(-w_max, w_min), which
 * only prevents very large magnitudes: as in the paper, the stiffness may then be
 * negative. */
static inline tse_real bound_draw(const tse_params *p, tse_real w)
{
  return r_min(p->w_low + r_abs(w - p->w_low), p->w_max);
}

/* Draw w of one particle from the Student-t distribution of equation (25):
 *   mean          mu + A d' S^-1 z
 *   scale matrix  (nut + q)/(nut + d_y) (A - A d' S^-1 d A) = C C', C lower triangular,
 *                 q = z' S^-1 z
 * z is the innovation and S its scale matrix, d the derivative of the measurements with
 * respect to w, d_y the number of measurements, A the scale matrix of w before this
 * sample, and nut = nu - 2. compute_innovation() computes the products.
 *   Given:  ta, tb, tc  standard Student-t numbers, which are multiplied by C */
TSE_INLINE void draw_one(const tse_params *TSE_RESTRICT p, const common *TSE_RESTRICT c,
    const sample *TSE_RESTRICT y, tse_real inv_dof, tse_real ta, tse_real tb, tse_real tc, int32_t i,
    tse_particles *TSE_RESTRICT q)
{
  const innovation e = compute_innovation(p, c, y, q, i);
  const tse_real c11 = r_sqrt(r_max(e.a[0], TINY)), inv11 = r_div(TSE_R(1), c11);
  const tse_real c21 = r_mul(e.a[1], inv11), c31 = r_mul(e.a[2], inv11);
  const tse_real c22 = r_sqrt(r_max(e.a[3] - r_mul(c21, c21), TINY));
  const tse_real c32 = r_div(e.a[4] - r_mul(c31, c21), c22);
  const tse_real c33 = r_sqrt(r_max(e.a[5] - r_mul(c31, c31) - r_mul(c32, c32), TINY));
  const tse_real scale = r_sqrt(r_mul(c->nut + e.q, inv_dof));
  const tse_real t1 = r_mul(scale, ta), t2 = r_mul(scale, tb), t3 = r_mul(scale, tc);
  q->w[0][i] = bound_draw(p, q->mu[0][i] + e.m[0] + r_mul(c11, t1));
  q->w[1][i] = bound_draw(p, q->mu[1][i] + e.m[1] + r_mul(c21, t1) + r_mul(c22, t2));
  q->w[2][i] = bound_draw(p, q->mu[2][i] + e.m[2] + r_mul(c31, t1) + r_mul(c32, t2) + r_mul(c33, t3));
}

/* Draw w of a run of particles. */
static void draw_run(const tse_params *TSE_RESTRICT p, const common *TSE_RESTRICT c,
    const sample *TSE_RESTRICT y, tse_real inv_dof, tse_real t[3][RUN], int32_t base, int32_t count,
    tse_particles *TSE_RESTRICT q)
{
  for (int32_t j = 0; j < count; j++) draw_one(p, c, y, inv_dof, t[0][j], t[1][j], t[2][j], base + j, q);
}

void paper_draw_stiffness(const tse_params *p, tse_filter_paper *f, const sample *y, const common *c)
{
  const int32_t count = pad_count(p->particles);
  const tse_real dof = c->nut + r_from_int(y->used), inv_dof = r_div(TSE_R(1), dof);
  for (int32_t base = 0; base < count; base += RUN) {
    const int32_t run = count - base < RUN ? count - base : RUN;
    tse_real t[3][RUN];
    draw_student(p, f->filter.step, base, run, dof, t);
    draw_run(p, c, y, inv_dof, t, base, run, &f->p);
  }
}

/* Update the statistics, equation (16), with z = w - mu and lam = Lambda/nu. A + marks
 * the new value:
 *   gamma+ = gamma/(1 + gamma)
 *   nu+ = nu + 1
 *   mu+ = mu + gamma+ z
 *   Lambda+ = Lambda + z z'/(1 + gamma), thus
 *   lam+ = lam + (z z'/(1 + gamma) - lam)/(nu + 1)
 * `max` limits the diagonal elements of lam, so that the sd of each w, whose variance is
 * lam nu/(nu - 4), is at most the setting spread_max. If an element exceeds `max`, all
 * elements of lam are multiplied by the factor that makes the largest diagonal element
 * equal to `max`. */
static void learn_statistics(const tse_params *TSE_RESTRICT p, tse_real gamma, tse_real rate, tse_real shrink,
    tse_real max, tse_particles *TSE_RESTRICT q)
{
  for (int32_t i = 0; i < pad_count(p->particles); i++) {
    const tse_real z0 = q->w[0][i] - q->mu[0][i], z1 = q->w[1][i] - q->mu[1][i],
                   z2 = q->w[2][i] - q->mu[2][i];
    const tse_real l11 = q->lam[0][i] + r_mul(rate, r_mul(shrink, r_mul(z0, z0)) - q->lam[0][i]);
    const tse_real l12 = q->lam[1][i] + r_mul(rate, r_mul(shrink, r_mul(z0, z1)) - q->lam[1][i]);
    const tse_real l13 = q->lam[2][i] + r_mul(rate, r_mul(shrink, r_mul(z0, z2)) - q->lam[2][i]);
    const tse_real l22 = q->lam[3][i] + r_mul(rate, r_mul(shrink, r_mul(z1, z1)) - q->lam[3][i]);
    const tse_real l23 = q->lam[4][i] + r_mul(rate, r_mul(shrink, r_mul(z1, z2)) - q->lam[4][i]);
    const tse_real l33 = q->lam[5][i] + r_mul(rate, r_mul(shrink, r_mul(z2, z2)) - q->lam[5][i]);
    const tse_real scale = r_div(max, r_max(max, r_max(r_max(l11, l22), l33)));
    q->lam[0][i] = r_mul(scale, l11);
    q->lam[1][i] = r_mul(scale, l12);
    q->lam[2][i] = r_mul(scale, l13);
    q->lam[3][i] = r_mul(scale, l22);
    q->lam[4][i] = r_mul(scale, l23);
    q->lam[5][i] = r_mul(scale, l33);
    q->mu[0][i] += r_mul(gamma, z0);
    q->mu[1][i] += r_mul(gamma, z1);
    q->mu[2][i] += r_mul(gamma, z2);
  }
}

void paper_update_statistics(const tse_params *p, tse_filter_paper *f)
{
  const tse_real shrink = r_div(TSE_R(1), TSE_R(1) + f->gamma), rate = r_div(TSE_R(1), f->nu + TSE_R(1));
  f->gamma = r_mul(f->gamma, shrink);
  f->nu = f->nu + TSE_R(1);
  learn_statistics(
      p, f->gamma, rate, shrink, r_mul(p->spread_max_var, r_div(f->nu - TSE_R(4), f->nu)), &f->p);
}

/* Low-pass the innovations, in sds of the sensor noise, with the time constant SLOW_TIME.
 * Return their mean square over the channels, divided by the mean square that white noise
 * of variance 1 would have after the same low pass. The ratio is large while successive
 * innovations are correlated. */
static tse_real compute_persistence(
    const tse_params *p, tse_filter_paper *f, const sample *y, const tse_output *now)
{
  const inputs u = y->u;
  const slips s = vehicle_slips(p, now->vel_x, now->vel_y, now->yaw_rate, u);
  const observation o = particle_observation(particle_observation_gains(p, y->use[0], y->use[1]), s, u.steer);
  tse_real w[3], b[3], sum = TSE_R(0);
  for (int a = 0; a < 3; a++) {
    w[a] = now->stiffness[a] - TSE_R(1);
    b[a] = r_mul(now->bias[a], p->inv_sd[a]);
  }
  const tse_real z[3] = { y->y[0] - o.h1 - r_mul(o.d11, w[0]) - r_mul(o.d12, w[1]) - b[0],
    y->y[1] - o.h2 - r_mul(o.d21, w[0]) - r_mul(o.d22, w[1]) - r_mul(o.d23, w[2]) - b[1],
    y->y[2] - r_mul(now->yaw_rate, p->inv_sd[2]) - b[2] };
  const tse_real gain = r_div(y->dt, y->dt + SLOW_TIME);
  for (int a = 0; a < 3; a++) {
    const tse_real inside = r_clamp(z[a], TSE_R(-1000), TSE_R(1000));
    f->slow[a] += r_mul(r_mul(gain, y->use[a]), inside - f->slow[a]);
    sum += r_mul(f->slow[a], f->slow[a]);
  }
  return r_div(r_mul(sum, TSE_R(2) - gain), r_mul(TSE_R(3), gain));
}

/* Forget old samples, equation (17): divide gamma by a forgetting factor lambda_mu, and
 * multiply nu and Lambda by a forgetting factor lambda (lam = Lambda/nu does not change).
 * Both factors apply to one sample. A row of dt seconds counts as dt/sample_time samples,
 * so that its factors are lambda_mu and lambda to the power dt/sample_time.
 *
 * Equation (16) adds gamma/(1 + gamma) of the difference w - mu to the mean mu. With a
 * larger gamma the mean therefore forgets faster. lambda_mu differs from lambda, because
 * it decreases while innovations are correlated. The variance of the mean is gamma times
 * the variance of w about the mean. To limit it, forgetting increases gamma at most to 1
 * or to the initial gamma, whichever is larger. */
void paper_forget(const tse_params *p, tse_filter_paper *f, const sample *y, const tse_output *now)
{
  const tse_real samples = r_mul(y->dt, p->inv_sample_time);
  tse_real log2_mean = p->log2_forgetting_mean;
  if (p->forgetting_change < p->forgetting_mean) {
    const tse_real beyond = r_max(compute_persistence(p, f, y, now) - USUAL_RATIO, TSE_R(0));
    log2_mean = r_log2(
        r_max(p->forgetting_mean - r_mul(LAMBDA_SLOPE, r_min(beyond, TSE_R(20))), p->forgetting_change));
  }
  const tse_real lambda = r_exp2(r_max(r_mul(p->log2_forgetting, samples), MIN_LOG2_KEPT));
  const tse_real max_gamma = r_max(f->gamma, r_max(p->gamma0, TSE_R(1)));
  f->gamma = r_min(r_div(f->gamma, r_exp2(r_max(r_mul(log2_mean, samples), MIN_LOG2_KEPT))), max_gamma);
  f->nu = r_max(r_mul(f->nu, lambda), MIN_NU);
}
