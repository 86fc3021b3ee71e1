/* paper/paper.h - the particle filter of the paper: stages of its Algorithm 1. Numbers in
 * parentheses are equations of the paper. Internal.
 *
 * Symbols are those of the paper. w is the relative deviation of each stiffness from its
 * nominal value. mu and lam are statistics of w (model/state.h). A measurement is
 * y = h + d w + b + noise (9), where b are the biases of the sensors. src/EQUATIONS.md
 * gives the units: forces are divided by the mass of the car, and each measurement by the
 * sd of its sensor. The recursions of gamma, of nu and of the covariance P of the biases
 * do not contain measurements. These quantities are therefore the same for all particles,
 * and are stored only once. */
#ifndef TSE_PAPER_H
#define TSE_PAPER_H

#include "estimator/stages.h"
#include "paper/particle.h"

/* Qualifier of pointers to the constants and to the particles: their memory does not
 * overlap. Without it the compiler does not vectorise loops over particles. */
#if defined(__cplusplus) || (defined(_MSC_VER) && !defined(__clang__))
#define TSE_RESTRICT __restrict
#else
#define TSE_RESTRICT restrict
#endif

/* Functions that several loops call are always inlined: otherwise no loop vectorises. */
#if defined(__GNUC__)
#define TSE_INLINE static inline __attribute__((always_inline))
#else
#define TSE_INLINE static inline
#endif

/* Quantities common to all particles at one row. d_w = 3 is the number of elements of w,
 * and d_y the number of measurements in the row. */
typedef struct common {
  observation_gains g;        /* gains of h and d of (9); 0 if the measurement is missing */
  tse_real l[3];              /* (P + R)^-1/2, R = 1: factor that whitens the innovation */
  tse_real gain[3];           /* K (P + R)^1/2, (19): bias correction per whitened y - h - d w - b */
  tse_real max_bias[3];       /* [sd of the sensor noise] max magnitude of a bias */
  tse_real nut;               /* nu - d_w + 1 = nu - 2 of (22): degrees of freedom */
  tse_real a;                 /* (1 + gamma) nu/nut: a times lam = Lambda/nu is the scale matrix of (22) */
  tse_real r;                 /* (nut - 2)/nut of (22): scale of the whitened noise */
  tse_real half_dof, inv_nut; /* (nut + d_y)/2 and 1/nut */
} common;

/* Innovation z = y - h - d mu - b of one particle, its scale S of (22), and the
 * distribution of w given y, (25). z and d are whitened, i.e. multiplied by (P + R)^-1/2,
 * so that the noise of all channels has the same scale. The channels are then processed
 * one after the other: the distribution of w is conditioned on accel_x, and the result on
 * accel_y. This gives the same result as a Cholesky factor of S. The yaw rate does not
 * depend on w, and contributes only to q and to the determinant of S. */
typedef struct innovation {
  tse_real z1, z2, z3;   /* whitened innovations; 0 if the measurement is missing */
  tse_real d1[2], d2[3]; /* whitened rows of d for accel_x, accel_y */
  tse_real s1, s2, s3;   /* scales of the whitened innovations */
  tse_real m[3];         /* A d' S^-1 z: shift of the mean of w by y, (25); A: scale matrix of w before y */
  tse_real a[6];         /* A - A d' S^-1 d A: scale matrix of w given y, upper triangle */
  tse_real q;            /* z' S^-1 z */
} innovation;

/* Condition the distribution of w, with mean mu + e->m and scale matrix e->a, on one
 * channel.
 *   Given:     d0, d1, d2  whitened row of d for this channel
 *              z           whitened innovation
 *              r           scale of its noise
 *   Returned:  *scale      scale of the whitened innovation: d a d' + r */
TSE_INLINE void condition_on_channel(
    innovation *e, tse_real d0, tse_real d1, tse_real d2, tse_real z, tse_real r, tse_real *scale)
{
  const tse_real v0 = r_mul(e->a[0], d0) + r_mul(e->a[1], d1) + r_mul(e->a[2], d2);
  const tse_real v1 = r_mul(e->a[1], d0) + r_mul(e->a[3], d1) + r_mul(e->a[4], d2);
  const tse_real v2 = r_mul(e->a[2], d0) + r_mul(e->a[4], d1) + r_mul(e->a[5], d2);
#if defined(TSE_REAL_FIXED) /* saturation may make the sum less than r, and the weight too large */
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

/* Return the innovation of particle i, its scale, and the distribution of w given y. */
TSE_INLINE innovation compute_innovation(
    const tse_params *p, const common *c, const sample *y, const tse_particles *q, int32_t i)
{
  innovation e;
  const tse_real mu0 = q->mu[0][i], mu1 = q->mu[1][i], mu2 = q->mu[2][i];
  const slips s = vehicle_slips(p, q->x[0][i], q->x[1][i], q->x[2][i], y->u);
  const observation o = particle_observation(c->g, s, y->u.steer);
  e.z1 = r_mul(
      c->l[0], r_mul(y->use[0], y->y[0] - o.h1 - r_mul(o.d11, mu0) - r_mul(o.d12, mu1) - q->bias[0][i]));
  e.z2 = r_mul(c->l[1],
      r_mul(y->use[1],
          y->y[1] - o.h2 - r_mul(o.d21, mu0) - r_mul(o.d22, mu1) - r_mul(o.d23, mu2) - q->bias[1][i]));
  e.z3 = r_mul(c->l[2], r_mul(y->use[2], y->y[2] - r_mul(q->x[2][i], p->inv_sd[2]) - q->bias[2][i]));
  e.d1[0] = r_mul(c->l[0], o.d11);
  e.d1[1] = r_mul(c->l[0], o.d12);
  e.d2[0] = r_mul(c->l[1], o.d21);
  e.d2[1] = r_mul(c->l[1], o.d22);
  e.d2[2] = r_mul(c->l[1], o.d23);

  e.a[0] = r_mul(c->a, q->lam[0][i]);
  e.a[1] = r_mul(c->a, q->lam[1][i]);
  e.a[2] = r_mul(c->a, q->lam[2][i]);
  e.a[3] = r_mul(c->a, q->lam[3][i]);
  e.a[4] = r_mul(c->a, q->lam[4][i]);
  e.a[5] = r_mul(c->a, q->lam[5][i]);
  e.m[0] = e.m[1] = e.m[2] = e.q = TSE_R(0);
  condition_on_channel(&e, e.d1[0], e.d1[1], TSE_R(0), e.z1, c->r, &e.s1);
  condition_on_channel(&e, e.d2[0], e.d2[1], e.d2[2], e.z2, c->r, &e.s2);
  e.s3 = c->r;
  e.q += r_mul(r_mul(e.z3, e.z3), r_div(TSE_R(1), c->r));
  return e;
}

/* --------------------------------------------------- algorithm1.c: start reading here */

/* Advance the particles from the previous row to this one: lines
 * 17, 18 of Algorithm 1. */
void paper_predict(const tse_params *p, tse_filter_paper *f, const sample *y);

/* Update the particles with the sample of this row: lines 3 .. 16 of Algorithm 1.
 *   Returned:  now            estimates
 *              log2_evidence  log2 of the predicted density of the sample, SI units */
void paper_update(
    const tse_params *p, tse_filter_paper *f, const sample *y, tse_output *now, tse_real *log2_evidence);

/* ---------------------------------------------------------------------------- start.c */

/* Initialise all particles from the settings or from a learnt state: the line
 * Initialize of Algorithm 1. */
void paper_start(const tse_params *p, tse_filter_paper *f, const sample *y);

/* Initialise only the motion of all particles, from wheel speeds and gyro. */
void paper_place(const tse_params *p, tse_filter_paper *f, const sample *y);

/* ----------------------------------------------------------------------------- bias.c */

/* Predict the variances of the biases, (18). */
void paper_predict_bias(const tse_params *p, tse_filter_paper *f, tse_real dt);

/* Return the quantities of this row that are common to all particles, (19) and (22). */
common paper_compute_common(const tse_params *p, const tse_filter_paper *f, const sample *y);

/* Update the biases with the sample, given w, (19). */
void paper_update_bias(const tse_params *p, tse_filter_paper *f, const sample *y, const common *c);

/* ----------------------------------------------------------------------------- move.c */

/* Propagate all particles by (7), from the inputs of the previous row to those of y. */
void paper_predict_state(const tse_params *p, tse_filter_paper *f, const sample *y);

/* ---------------------------------------------------------------------------- weigh.c */

/* Update the weights with the sample and normalise them, (22), (23).
 *   Returned:  log2 of the evidence of the sample, i.e. of its density in SI units */
tse_real paper_update_weights(const tse_params *p, tse_filter_paper *f, const sample *y, const common *c);

/* Subtract the largest log-weight from all. Compute the weights 2^logw, and log_total,
 * log2 of the sum of the weights.
 *   Returned:  the largest log-weight */
tse_real paper_normalise(const tse_params *p, tse_filter_paper *f);

/* ------------------------------------------------------------------------- estimate.c */

/* Compute the estimates from the weighted particles, (26), (27). */
void paper_estimate(const tse_params *p, const tse_filter_paper *f, tse_output *now);

/* Return the effective number of particles, N_eff. */
tse_real paper_effective_size(const tse_params *p, const tse_filter_paper *f);

/* Return the sum of the weights. The largest weight is 1. */
tse_real paper_total_weight(const tse_params *p, const tse_filter_paper *f);

/* Compute the weighted mean, over all particles, of each of n quantities.
 *   Given:     rows   rows[k] has the values of quantity k, one for each particle
 *   Returned:  means  n elements */
void paper_weighted_means(
    const tse_params *p, const tse_filter_paper *f, const tse_real *const *rows, int n, tse_real *means);

/* ------------------------------------------------------------------------- resample.c */

/* Resample the particles in proportion to their weights, line 9 of Algorithm 1. All
 * weights are equal afterwards. */
void paper_resample(const tse_params *p, tse_filter_paper *f);

/* Choose, for each of n new particles, the old particle of which it becomes a copy (its
 * ancestor), in ascending order.
 *   Given:     scheme    setting `resampling`
 *              weight    weights, divided by the largest one
 *   Returned:  ancestor  index of the ancestor of each new particle */
void paper_choose_ancestors(int32_t scheme, const tse_real *weight, int32_t n, const uint32_t seed[2],
    uint32_t step, uint16_t *ancestor);

/* Reorder the list of ancestors. Particle i will be replaced by particle ancestor[i]. A
 * survivor is a particle that occurs in the list. After the call each survivor i is its
 * own ancestor, ancestor[i] = i, and stays unchanged. The ancestors of all other
 * particles are survivors.
 *   Given:  copies  memory for intermediate results, n elements */
void paper_keep_survivors(uint16_t *ancestor, uint16_t *copies, int32_t n);

/* Replace each of n particles by its ancestor. */
void paper_copy_particles(tse_particles *q, const uint16_t *ancestor, int32_t n);

/* ---------------------------------------------------------------------------- learn.c */

/* Draw w, the relative stiffness deviation, of each particle given the sample, (25). */
void paper_draw_stiffness(const tse_params *p, tse_filter_paper *f, const sample *y, const common *c);

/* Update the statistics gamma, nu, mu and Lambda with the drawn w, (16). */
void paper_update_statistics(const tse_params *p, tse_filter_paper *f);

/* Forget old samples in the statistics, (17). */
void paper_forget(const tse_params *p, tse_filter_paper *f, const sample *y, const tse_output *now);

/* ------------------------------------------------------------------------------ row.c */

/* Set excited[a] to 1 for each stiffness that can be estimated because recent inputs have
 * changed its force (see row.c), otherwise to 0. */
void paper_excitation(
    const tse_params *p, tse_filter_paper *f, const sample *y, const tse_output *est, int32_t excited[3]);

/* Return n rounded up to a multiple of TSE_LANES. */
static inline int32_t pad_count(int32_t n) { return (n + TSE_LANES - 1) / TSE_LANES * TSE_LANES; }

#endif
