/* estimator/paper/particles.h - the particle filter of the paper (form 1), and the same with limits (form 2): its stages, in the
 * order in which algorithm.c runs them. Internal. */
#ifndef TSE_PARTICLES_H
#define TSE_PARTICLES_H

#include "estimator/stages.h"

/* The loops over particles become vector code only if the compiler knows that constants and particles do not overlap. */
#if defined(__cplusplus)
#define TSE_RESTRICT __restrict
#elif defined(_MSC_VER) && !defined(__clang__)
#define TSE_RESTRICT __restrict
#else
#define TSE_RESTRICT restrict
#endif

/* What stands in two loops must still be inlined in both, or neither becomes vector code. */
#if defined(__GNUC__)
#define TSE_INLINE static inline __attribute__((always_inline))
#else
#define TSE_INLINE static inline
#endif

#define initialise        TSE_NAME(tse_initialise)
#define restart_states    TSE_NAME(tse_restart_states)
#define redraw            TSE_NAME(tse_redraw)
#define bias_predict      TSE_NAME(tse_bias_predict)
#define propagate         TSE_NAME(tse_propagate)
#define wheels_slide      TSE_NAME(tse_wheels_slide)
#define coast             TSE_NAME(tse_coast)
#define bias_observe      TSE_NAME(tse_bias_observe)
#define weigh             TSE_NAME(tse_weigh)
#define normalise         TSE_NAME(tse_normalise)
#define estimate          TSE_NAME(tse_estimate)
#define effective_size    TSE_NAME(tse_effective_size)
#define weighted_means    TSE_NAME(tse_weighted_means)
#define resample          TSE_NAME(tse_resample)
#define keep_survivors    TSE_NAME(tse_keep_survivors)
#define copy_particles    TSE_NAME(tse_copy_particles)
#define draw_and_learn    TSE_NAME(tse_draw_and_learn)
#define bias_update       TSE_NAME(tse_bias_update)
#define bias_learn_still  TSE_NAME(tse_bias_learn_still)
#define excitation        TSE_NAME(tse_excitation)
#define forget            TSE_NAME(tse_forget)

#ifdef __cplusplus
extern "C" {
#endif

/* The biases at this sample, channel by channel, because P, H and R are diagonal. C = H P H' + R is the variance of the
 * innovation without w's spread. */
typedef struct bias_gains {
  tse_real l[3];    /* C^-1/2, which makes innovations unit-free                              */
  tse_real gain[3]; /* P H' C^-1/2: a bias moves by gain times the whitened innovation given w */
} bias_gains;

/* What (16), (22)-(25) have in common for all particles in one step. */
typedef struct niw_constants {
  tse_real nut;              /* nu - d_w + 1 = nu - 2, dof of (22)                             */
  tse_real a;                /* A = a lam: a = (1 + gamma) nu/nut                              */
  tse_real r;                /* (nut - 2)/nut: scale of the whitened noise in (22)             */
  tse_real half_dof;         /* (nut + d_y)/2                                                  */
  tse_real inv_nut;
} niw_constants;

static inline niw_constants niw_constants_of(const tse_filter_paper *f, int32_t used)
{
  niw_constants n;
  n.nut = f->nu - TSE_R(2);
  n.inv_nut = r_div(TSE_R(1), n.nut);
  n.a = r_mul(TSE_R(1) + f->gamma, r_mul(f->nu, n.inv_nut));
  n.r = r_mul(n.nut - TSE_R(2), n.inv_nut);
  n.half_dof = r_mul(TSE_R(0.5), n.nut + r_from_int(used));
  return n;
}

/* Innovation and its scale for one particle, (22): z = y - h - d mu - b,  S = d A d' + (nut - 2)/nut C, both whitened by
 * C^-1/2, so that the noise is the same number in each channel. The channels are taken one after the other, which is what
 * a Cholesky factor of S would do: each is weighed with the covariance of w that those before it leave. The yaw rate says
 * nothing about w. */
typedef struct innovation {
  tse_real z1, z2, z3;          /* whitened innovations, 0 where missing                           */
  tse_real d1[2], d2[3];        /* whitened rows of d                                              */
  tse_real s1, s2, s3;          /* scales of the three steps                                       */
  tse_real m[3];                /* A d' S^-1 z, the shift of w's mean given y, (25)                */
  tse_real a[6];                /* A - A d' S^-1 d A, upper triangle                               */
  tse_real q;                   /* z' S^-1 z                                                       */
} innovation;

/* One channel with row d (d0, d1, d2) and innovation z: condition mean m and covariance a of w on it. */
TSE_INLINE void condition(innovation *e, tse_real d0, tse_real d1, tse_real d2, tse_real z, tse_real r, tse_real *scale)
{
  const tse_real v0 = r_mul(e->a[0], d0) + r_mul(e->a[1], d1) + r_mul(e->a[2], d2);
  const tse_real v1 = r_mul(e->a[1], d0) + r_mul(e->a[3], d1) + r_mul(e->a[4], d2);
  const tse_real v2 = r_mul(e->a[2], d0) + r_mul(e->a[4], d1) + r_mul(e->a[5], d2);
#if defined(TSE_REAL_FIXED) /* a covariance that stopped at the end of the range is none; below r its density would beat all others */
  const tse_real s = r_max(r_mul(d0, v0) + r_mul(d1, v1) + r_mul(d2, v2) + r, r);
#else
  const tse_real s = r_mul(d0, v0) + r_mul(d1, v1) + r_mul(d2, v2) + r;
#endif
  const tse_real inv = r_div(TSE_R(1), s);
  const tse_real left = z - r_mul(d0, e->m[0]) - r_mul(d1, e->m[1]) - r_mul(d2, e->m[2]);
  const tse_real g = r_mul(inv, left);
  const tse_real k0 = r_mul(inv, v0), k1 = r_mul(inv, v1), k2 = r_mul(inv, v2);
  e->q += r_mul(g, left);
  e->m[0] += r_mul(v0, g);
  e->m[1] += r_mul(v1, g);
  e->m[2] += r_mul(v2, g);
  e->a[0] = e->a[0] - r_mul(k0, v0);
  e->a[1] = e->a[1] - r_mul(k0, v1);
  e->a[2] = e->a[2] - r_mul(k0, v2);
  e->a[3] = e->a[3] - r_mul(k1, v1);
  e->a[4] = e->a[4] - r_mul(k1, v2);
  e->a[5] = e->a[5] - r_mul(k2, v2);
  *scale = s;
}

TSE_INLINE innovation innovation_of(const niw_constants *n, const bias_gains *c, const sample *y, observation o,
                                    tse_real mu0, tse_real mu1, tse_real mu2,
                                    tse_real l11, tse_real l12, tse_real l13, tse_real l22, tse_real l23, tse_real l33,
                                    tse_real b0, tse_real b1, tse_real b2, tse_real yaw)
{
  innovation e;
  e.z1 = r_mul(c->l[0], r_mul(y->use[0], y->y[0] - o.h1 - r_mul(o.d11, mu0) - r_mul(o.d12, mu1) - b0));
  e.z2 = r_mul(c->l[1], r_mul(y->use[1], y->y[1] - o.h2 - r_mul(o.d21, mu0) - r_mul(o.d22, mu1) - r_mul(o.d23, mu2) - b1));
  e.z3 = r_mul(c->l[2], r_mul(y->use[2], y->y[2] - yaw - b2));
  e.d1[0] = r_mul(c->l[0], o.d11);
  e.d1[1] = r_mul(c->l[0], o.d12);
  e.d2[0] = r_mul(c->l[1], o.d21);
  e.d2[1] = r_mul(c->l[1], o.d22);
  e.d2[2] = r_mul(c->l[1], o.d23);

  e.a[0] = r_mul(n->a, l11);
  e.a[1] = r_mul(n->a, l12);
  e.a[2] = r_mul(n->a, l13);
  e.a[3] = r_mul(n->a, l22);
  e.a[4] = r_mul(n->a, l23);
  e.a[5] = r_mul(n->a, l33);
  e.m[0] = e.m[1] = e.m[2] = e.q = TSE_R(0);
  condition(&e, e.d1[0], e.d1[1], TSE_R(0), e.z1, n->r, &e.s1);
  condition(&e, e.d2[0], e.d2[1], e.d2[2], e.z2, n->r, &e.s2);
  e.s3 = n->r;
  e.q += r_mul(r_mul(e.z3, e.z3), r_div(TSE_R(1), n->r));
  return e;
}

/* start.c     particles from the settings, or what was loaded, and the first sample / states only / statistics of some
 *             particles */
void initialise(const tse_params *p, tse_filter_paper *f, const sample *y);
void restart_states(const tse_params *p, tse_filter_paper *f, const sample *y);
void redraw(const tse_params *p, tse_filter_paper *f, const sample *y, int32_t count);

/* propagate.c (7)  all particles from the last row's inputs to u, in steps of at most max_step */
void propagate(const tse_params *p, tse_filter_paper *f, inputs u, tse_real dt);

/* slide.c     wheels that lock or spin: are they; motion from the inertial sensors meanwhile */
int wheels_slide(const tse_params *p, tse_filter_paper *f, const sample *y);
void coast(const tse_params *p, tse_filter_paper *f, const sample *y);

/* bias.c      (18) / variance and gain of the innovation, 0 when they are no numbers / (19) of the variance / update of the
 *             gyro's bias while the wheels stand still */
void bias_predict(const tse_params *p, tse_filter_paper *f, tse_real dt);
int bias_observe(const tse_filter_paper *f, const sample *y, bias_gains *c);
void bias_update(tse_filter_paper *f, const bias_gains *c);
void bias_learn_still(const tse_params *p, tse_filter_paper *f, const sample *y);

/* weigh.c     (22), (23): log q += log St(z), normalised; log2 evidence of the sample in SI units, and the most that it
 *             could have been (every innovation zero, no spread). Returned: as normalise.
 *             normalise: logw -= largest, weight = 2^logw, log_total; returned: 0 when the weights are not finite */
int weigh(const tse_params *p, tse_filter_paper *f, const sample *y, const bias_gains *c, tse_real *log2_evidence,
          tse_real *log2_best);
int normalise(const tse_params *p, tse_filter_paper *f, tse_real *log2_largest);

/* estimate.c  (26), (27) from the weighted set / running regressors, and what they tell about each stiffness */
void estimate(const tse_params *p, const tse_filter_paper *f, tse_output *y);
tse_real effective_size(const tse_params *p, const tse_filter_paper *f);
void weighted_means(const tse_params *p, const tse_filter_paper *f, const tse_real *const *rows, int n, tse_real *means);
void excitation(const tse_params *p, tse_filter_paper *f, const sample *y, const tse_output *est, int32_t excited[3]);

/* resample.c  ancestors (ascending) of n particles for weights whose largest is 1; then survivors keep their places */
void resample(int32_t scheme, const tse_real *weight, int32_t n, const uint32_t seed[2], uint32_t step, uint16_t *ancestor);
void keep_survivors(uint16_t *ancestor, uint16_t *copies, int32_t n);
void copy_particles(tse_particles *p, const uint16_t *ancestor, int32_t n);

/* update.c    (25) draw w given y; (16) statistics given w; (19) means of the biases given w / (17) */
void draw_and_learn(const tse_params *p, tse_filter_paper *f, const sample *y, const bias_gains *c);
void forget(const tse_params *p, tse_filter_paper *f, tse_real dt);

static inline int32_t padded(int32_t n) { return (n + TSE_LANES - 1) / TSE_LANES * TSE_LANES; }

#ifdef __cplusplus
}
#endif
#endif
