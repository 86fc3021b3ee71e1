/* estimator/paper/update.c - what a particle learns from the sample: draws w given y (25), and with that w its statistics (16) and
 * its biases (19). One pass, because all three need the same slips and innovation; in short runs of particles, so that
 * the random numbers stay in the fastest memory. */
#include "estimator/paper/particles.h"
#include "number/random.h"

#define RUN 64
#define NU_LEAST TSE_R(6)     /* A and Sigma need nu > 4; reached only with a short memory and long time steps */
#define ALL_FORGOTTEN TSE_R(-20) /* log2 of the share that is left */
#define MOST_BIAS TSE_R(2000) /* sigma: stays a number whatever is measured */
#define TINY TSE_R(1e-6 * 1e-6) /* smallest pivot: rounding may leave a zero or negative one */
#if defined(TSE_REAL_FIXED)
#undef TINY
#define TINY ((tse_real)16)   /* steps of the format: less has no digit that means anything */
#endif

/* Stiffness stays positive by construction: a draw below w_min is reflected at it, one above w_max cut. */
static inline tse_real into_bounds(const tse_params *p, tse_real w)
{
  return r_min(p->w_min + r_abs(w - p->w_min), p->w_max);
}

static void draw_student(const tse_params *p, uint32_t step, int32_t base, int32_t count, tse_real dof, tse_real t[3][RUN])
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

/* Constants of one step that all particles share. */
typedef struct learning {
  niw_constants n;
  observation_gains g;
  tse_real gamma[3];             /* (16): gamma+, 0 where held                        */
  tse_real learn[3];             /* 1, 0 where held                                   */
  tse_real rate[6], rate_z[6];   /* (16): 1/(nu + 1), 1/((nu + 1)(1 + gamma)), likewise */
  bias_gains x;                  /* (19): gains                                       */
  tse_real lam_max, steep, steepest; /* where the spread is at its limit; slope of the fading above, its limit */
  tse_real dof, inv_dof;         /* (25): nut + d_y                                   */
} learning;

TSE_INLINE void learn_one(const tse_params *TSE_RESTRICT p, const learning *TSE_RESTRICT c,
                          const sample *TSE_RESTRICT y, tse_real ta, tse_real tb, tse_real tc, int32_t i,
                          tse_particles *TSE_RESTRICT q)
{
  const slips s = vehicle_slips(p, q->x[0][i], q->x[1][i], q->x[2][i], y->u);
  const observation o = vehicle_observation(c->g, s, y->u.steer);
  const tse_real l11 = q->lam[0][i], l12 = q->lam[1][i], l13 = q->lam[2][i];
  const tse_real l22 = q->lam[3][i], l23 = q->lam[4][i], l33 = q->lam[5][i];
  const innovation e = innovation_of(&c->n, &c->x, y, o, q->mu[0][i], q->mu[1][i], q->mu[2][i], l11, l12, l13, l22, l23, l33,
                                     q->bias[0][i], q->bias[1][i], q->bias[2][i], r_mul(q->x[2][i], p->inv_sd[2]));

  /* (25) covariance A - A d' S^-1 d A = C C', C lower triangular; scale (nut + q)/(nut + d_y) */
  const tse_real c11 = r_sqrt(r_max(e.a[0], TINY)), inv11 = r_div(TSE_R(1), c11);
  const tse_real c21 = r_mul(e.a[1], inv11), c31 = r_mul(e.a[2], inv11);
  const tse_real c22 = r_sqrt(r_max(e.a[3] - r_mul(c21, c21), TINY));
  const tse_real c32 = r_div(e.a[4] - r_mul(c31, c21), c22);
  const tse_real c33 = r_sqrt(r_max(e.a[5] - r_mul(c31, c31) - r_mul(c32, c32), TINY));
  const tse_real scale = r_sqrt(r_mul(c->n.nut + e.q, c->inv_dof));
  const tse_real t1 = r_mul(scale, ta), t2 = r_mul(scale, tb), t3 = r_mul(scale, tc);

  const tse_real mu0 = q->mu[0][i], mu1 = q->mu[1][i], mu2 = q->mu[2][i];
  const tse_real w0 = into_bounds(p, mu0 + e.m[0] + r_mul(c11, t1));
  const tse_real w1 = into_bounds(p, mu1 + e.m[1] + r_mul(c21, t1) + r_mul(c22, t2));
  const tse_real w2 = into_bounds(p, mu2 + e.m[2] + r_mul(c31, t1) + r_mul(c32, t2) + r_mul(c33, t3));
  const tse_real z0 = w0 - mu0, z1 = w1 - mu1, z2 = w2 - mu2;

  /* above the largest spread Lambda fades faster, up to a half per sample */
  const tse_real largest = r_max(r_max(r_mul(c->learn[0], l11), r_mul(c->learn[1], l22)), r_mul(c->learn[2], l33));
  const tse_real excess = largest - c->lam_max;
  const tse_real fade = TSE_R(1) + r_min(r_max(r_mul(excess, c->steep), TSE_R(0)), c->steepest);
  q->lam[0][i] = l11 + r_mul(c->rate_z[0], r_mul(z0, z0)) - r_mul(r_mul(c->rate[0], fade), l11);
  q->lam[1][i] = l12 + r_mul(c->rate_z[1], r_mul(z0, z1)) - r_mul(r_mul(c->rate[1], fade), l12);
  q->lam[2][i] = l13 + r_mul(c->rate_z[2], r_mul(z0, z2)) - r_mul(r_mul(c->rate[2], fade), l13);
  q->lam[3][i] = l22 + r_mul(c->rate_z[3], r_mul(z1, z1)) - r_mul(r_mul(c->rate[3], fade), l22);
  q->lam[4][i] = l23 + r_mul(c->rate_z[4], r_mul(z1, z2)) - r_mul(r_mul(c->rate[4], fade), l23);
  q->lam[5][i] = l33 + r_mul(c->rate_z[5], r_mul(z2, z2)) - r_mul(r_mul(c->rate[5], fade), l33);

  q->mu[0][i] = mu0 + r_mul(c->gamma[0], z0);
  q->mu[1][i] = mu1 + r_mul(c->gamma[1], z1);
  q->mu[2][i] = mu2 + r_mul(c->gamma[2], z2);
  q->w[0][i] = w0;
  q->w[1][i] = w1;
  q->w[2][i] = w2;

  /* (19): whitened innovation given w, y - h - d w - b */
  const tse_real e1 = e.z1 - r_mul(e.d1[0], z0) - r_mul(e.d1[1], z1);
  const tse_real e2 = e.z2 - r_mul(e.d2[0], z0) - r_mul(e.d2[1], z1) - r_mul(e.d2[2], z2);
  q->bias[0][i] = r_max(r_min(q->bias[0][i] + r_mul(c->x.gain[0], e1), MOST_BIAS), -MOST_BIAS);
  q->bias[1][i] = r_max(r_min(q->bias[1][i] + r_mul(c->x.gain[1], e2), MOST_BIAS), -MOST_BIAS);
  q->bias[2][i] = r_max(r_min(q->bias[2][i] + r_mul(c->x.gain[2], e.z3), MOST_BIAS), -MOST_BIAS);
}

static void learn_run(const tse_params *TSE_RESTRICT p, const learning *TSE_RESTRICT c, const sample *TSE_RESTRICT y,
                      tse_real t[3][RUN], int32_t base, int32_t count, tse_particles *TSE_RESTRICT q)
{
  for (int32_t j = 0; j < count; j++) learn_one(p, c, y, t[0][j], t[1][j], t[2][j], base + j, q);
}

void draw_and_learn(const tse_params *p, tse_filter_paper *f, const sample *y, const bias_gains *x)
{
  const int32_t count = padded(p->particles);
  learning c;
  c.n = niw_constants_of(f, y->used);
  c.g = vehicle_observation_gains(p, y->use[0], y->use[1]);

  /* (16) gamma+ = gamma/(1 + gamma), nu+ = nu + 1, mu+ = mu + gamma+ z, Lambda+ = Lambda + z z'/(1 + gamma), z = w - mu;
   * with lam = Lambda/nu:  lam+ = lam + (z z'/(1 + gamma) - lam)/(nu + 1) */
  const tse_real shrink = r_div(TSE_R(1), TSE_R(1) + f->gamma);
  const tse_real gamma = r_mul(f->gamma, shrink), rate = r_div(TSE_R(1), f->nu + TSE_R(1));
  for (int a = 0, k = 0; a < 3; a++) {
    c.gamma[a] = r_mul(gamma, f->learn[a]);
    c.learn[a] = f->learn[a];
    for (int b = a; b < 3; b++, k++) {
      /* between a held and a learnt stiffness the covariance fades without news: Lambda stays positive definite */
      c.rate[k] = r_mul(rate, r_max(f->learn[a], f->learn[b]));
      c.rate_z[k] = r_mul(r_mul(rate, shrink), r_mul(f->learn[a], f->learn[b]));
    }
  }

  c.x = *x;
  c.lam_max = r_mul(p->spread_max_var, r_div(f->nu - TSE_R(4), f->nu));
  c.steep = r_div(TSE_R(50), c.lam_max);
  c.steepest = r_mul(TSE_R(0.5), f->nu) - TSE_R(1);
  c.dof = c.n.nut + r_from_int(y->used);
  c.inv_dof = r_div(TSE_R(1), c.dof);

  for (int32_t base = 0; base < count; base += RUN) {
    const int32_t run = count - base < RUN ? count - base : RUN;
    tse_real t[3][RUN];
    draw_student(p, f->filter.step, base, run, c.dof, t);
    learn_run(p, &c, y, t, base, run, &f->p);
  }

  f->gamma = gamma;
  f->nu = f->nu + TSE_R(1);
}

/* (17) gamma /= lambda, nu *= lambda, Lambda *= lambda (lam = Lambda/nu stays), with lambda^(dt/sample_time). However long that
 * takes, no less is known of the mean than gamma = 1 says, or the start: what is forgotten cannot be forgotten further. */
void forget(const tse_params *p, tse_filter_paper *f, tse_real dt)
{
  const tse_real lambda = r_exp2(r_max(r_mul(p->log2_forgetting, r_mul(dt, p->inv_sample_time)), ALL_FORGOTTEN));
  const tse_real most = r_max(f->gamma, r_max(p->gamma0, TSE_R(1)));
  f->gamma = r_min(r_div(f->gamma, lambda), most);
  f->nu = r_max(r_mul(f->nu, lambda), NU_LEAST);
}
