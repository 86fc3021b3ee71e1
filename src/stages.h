/* src/stages.h - the stages of one step, in the order in which filter.c runs them. Internal. */
#ifndef TSE_STAGES_H
#define TSE_STAGES_H

#include "tse/tse.h"
#include "vehicle.h"

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

#define input_decode      TSE_NAME(tse_input_decode)
#define watch_repeats     TSE_NAME(tse_watch_repeats)
#define start_of_settings TSE_NAME(tse_start_of_settings)
#define initialise        TSE_NAME(tse_initialise)
#define restart_states    TSE_NAME(tse_restart_states)
#define redraw            TSE_NAME(tse_redraw)
#define coast             TSE_NAME(tse_coast)
#define propagate         TSE_NAME(tse_propagate)
#define weigh             TSE_NAME(tse_weigh)
#define normalise         TSE_NAME(tse_normalise)
#define estimate          TSE_NAME(tse_estimate)
#define excitation        TSE_NAME(tse_excitation)
#define resample          TSE_NAME(tse_resample)
#define keep_survivors    TSE_NAME(tse_keep_survivors)
#define copy_particles    TSE_NAME(tse_copy_particles)
#define draw_and_learn    TSE_NAME(tse_draw_and_learn)
#define effective_size    TSE_NAME(tse_effective_size)
#define weighted_means    TSE_NAME(tse_weighted_means)
#define gaussian_start    TSE_NAME(tse_gaussian_start)
#define gaussian_restart_states TSE_NAME(tse_gaussian_restart_states)
#define gaussian_restart_means  TSE_NAME(tse_gaussian_restart_means)
#define gaussian_predict  TSE_NAME(tse_gaussian_predict)
#define gaussian_follow_level TSE_NAME(tse_gaussian_follow_level)
#define bias_predict      TSE_NAME(tse_bias_predict)
#define gaussian_foretell TSE_NAME(tse_gaussian_foretell)
#define gaussian_observe  TSE_NAME(tse_gaussian_observe)
#define consistency_start TSE_NAME(tse_consistency_start)
#define wheels_slide      TSE_NAME(tse_wheels_slide)
#define error_predict     TSE_NAME(tse_error_predict)
#define error_update      TSE_NAME(tse_error_update)
#define gaussian_clear    TSE_NAME(tse_gaussian_clear)
#define slow_factor       TSE_NAME(tse_slow_factor)
#define spread_is_seen    TSE_NAME(tse_spread_is_seen)
#define is_trying         TSE_NAME(tse_is_trying)
#define is_holding        TSE_NAME(tse_is_holding)
#define consistency       TSE_NAME(tse_consistency)
#define gaussian_update   TSE_NAME(tse_gaussian_update)
#define forget            TSE_NAME(tse_forget)
#define bias_learn_still  TSE_NAME(tse_bias_learn_still)
#define step_row          TSE_NAME(tse_step_row)
#define told_step         TSE_NAME(tse_told_step)
#define told_begin        TSE_NAME(tse_told_begin)
#define told_motion       TSE_NAME(tse_told_motion)
#define told_push         TSE_NAME(tse_told_push)
#define told_sample       TSE_NAME(tse_told_sample)
#define crc32_of          TSE_NAME(tse_crc32_of)

#define STATE_VAR TSE_R(1e-18) /* (1e-9 m/s)^2: no state is known better; and no denormal numbers */

#ifdef __cplusplus
extern "C" {
#endif

/* A checked row: what is missing is marked, wheel speeds are speeds. */
typedef struct sample {
  inputs u;
  tse_real dt;      /* [s]                                                            */
  tse_real y[3];    /* [sigma]  accel_x, accel_y, yaw rate over their sd; 0 if unused */
  tse_real use[3];  /* 1 used, 0 missing                                              */
  int32_t used;     /* how many of the three                                          */
  int32_t has_inputs;
  int32_t has_steer;
} sample;

/* The common Gaussian at this sample: C = H P H' + R = L L' is the covariance of the innovation without w's spread. */
typedef struct gaussian {
  tse_real l11, l21, l22, l31, l32, l33; /* L^-1, which makes innovations unit-free and independent          */
  tse_real gain[TSE_GAUSS][3];           /* P H' L'^-1: X moves by gain times the whitened innovation given w */
} gaussian;

/* The sample as the weighted mean foretells it. */
typedef struct forecast {
  tse_real ph[TSE_GAUSS][3]; /* P H'                                                    */
  tse_real hph[3][3];        /* H P H'                                                  */
  tse_real h[3][TSE_GAUSS];  /* H                                                       */
  tse_real sigma[3][3];      /* mean of Sigma                                           */
  tse_real sigma_d[3][3];    /* Sigma d'                                                */
  tse_real spread[3][3];     /* d Sigma d'                                              */
  tse_real level[3];         /* 1 + mean of mu                                          */
  tse_real z[3];             /* innovation, in sigma; 0 where missing (marginalised)    */
  observation o;             /* at the mean (marginalised)                              */
  tse_real input_var;        /* of accel_x through the noise of the wheel speeds        */
  tse_real pull, excess;     /* what that noise does to longitudinal stiffness, below   */
} forecast;

/* What (16), (22)-(25) have in common for all particles in one step. */
typedef struct niw_constants {
  tse_real nut;              /* nu - d_w + 1 = nu - 2, dof of (22)                             */
  tse_real a;                /* A = a lam: a = (1 + gamma) nu/nut                              */
  tse_real r;                /* (nut - 2)/nut: scale of the whitened noise in (22)             */
  tse_real half_dof;         /* (nut + d_y)/2                                                  */
  tse_real inv_nut;
} niw_constants;

static inline niw_constants niw_constants_of(const tse_filter *f, int32_t used)
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
 * L^-1, so that the noise is the same number in each channel. The three channels are taken one after the other, which is
 * what a Cholesky factor of S would do: each is weighed with the covariance of w that those before it leave. */
typedef struct innovation {
  tse_real z1, z2, z3;          /* whitened innovations, 0 where missing                           */
  tse_real d1[2], d2[3], d3[3]; /* whitened rows of d                                              */
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
  const tse_real s = r_mul(d0, v0) + r_mul(d1, v1) + r_mul(d2, v2) + r;
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

/* coupled: a literal 0 or 1, which the compiler folds. 0 where C is diagonal (the paper's form): the yaw rate then says
 * nothing about w. */
TSE_INLINE innovation innovation_of(int coupled, const niw_constants *n, const gaussian *c, const sample *y, observation o,
                                       tse_real mu0, tse_real mu1, tse_real mu2,
                                       tse_real l11, tse_real l12, tse_real l13, tse_real l22, tse_real l23, tse_real l33,
                                       tse_real b0, tse_real b1, tse_real b2, tse_real yaw)
{
  innovation e;
  const tse_real y1 = r_mul(y->use[0], y->y[0] - o.h1 - r_mul(o.d11, mu0) - r_mul(o.d12, mu1) - b0);
  const tse_real y2 = r_mul(y->use[1], y->y[1] - o.h2 - r_mul(o.d21, mu0) - r_mul(o.d22, mu1) - r_mul(o.d23, mu2) - b1);
  const tse_real y3 = r_mul(y->use[2], y->y[2] - yaw - b2);
  e.z1 = r_mul(c->l11, y1);
  e.z2 = r_mul(c->l21, y1) + r_mul(c->l22, y2);
  e.z3 = r_mul(c->l31, y1) + r_mul(c->l32, y2) + r_mul(c->l33, y3);
  e.d1[0] = r_mul(c->l11, o.d11);
  e.d1[1] = r_mul(c->l11, o.d12);
  e.d2[0] = r_mul(c->l21, o.d11) + r_mul(c->l22, o.d21);
  e.d2[1] = r_mul(c->l21, o.d12) + r_mul(c->l22, o.d22);
  e.d2[2] = r_mul(c->l22, o.d23);
  e.d3[0] = e.d3[1] = e.d3[2] = TSE_R(0);
  if (coupled) {
    e.d3[0] = r_mul(c->l31, o.d11) + r_mul(c->l32, o.d21);
    e.d3[1] = r_mul(c->l31, o.d12) + r_mul(c->l32, o.d22);
    e.d3[2] = r_mul(c->l32, o.d23);
  }

  e.a[0] = r_mul(n->a, l11);
  e.a[1] = r_mul(n->a, l12);
  e.a[2] = r_mul(n->a, l13);
  e.a[3] = r_mul(n->a, l22);
  e.a[4] = r_mul(n->a, l23);
  e.a[5] = r_mul(n->a, l33);
  e.m[0] = e.m[1] = e.m[2] = e.q = TSE_R(0);
  condition(&e, e.d1[0], e.d1[1], TSE_R(0), e.z1, n->r, &e.s1);
  condition(&e, e.d2[0], e.d2[1], e.d2[2], e.z2, n->r, &e.s2);
  if (coupled) {
    condition(&e, e.d3[0], e.d3[1], e.d3[2], e.z3, n->r, &e.s3);
  } else {
    e.s3 = n->r;
    e.q += r_mul(r_mul(e.z3, e.z3), r_div(TSE_R(1), n->r));
  }
  return e;
}

/* input.c     row -> sample; the filter supplies held inputs for missing ones. Nothing is changed. */
tse_status input_decode(const tse_params *p, const tse_filter *f, const tse_input *u, sample *y);

void watch_repeats(const tse_params *p, tse_filter *f, const tse_input *u, sample *y);

/* start.c     particles from the settings, or what was loaded, and the first sample / states only / statistics of some
 *             particles */
void start_of_settings(const tse_params *p, tse_start *s);
void initialise(const tse_params *p, tse_filter *f, const sample *y);
void restart_states(const tse_params *p, tse_filter *f, const sample *y);
void redraw(const tse_params *p, tse_filter *f, const sample *y, int32_t count);

/* propagate.c (7)  all particles from the last row's inputs to u, in steps of at most max_step */
void propagate(const tse_params *p, tse_filter *f, inputs u, tse_real dt);

/* weigh.c     (22), (23): log q += log St(z), normalised; log2 evidence of the sample in SI units, and the most that it
 *             could have been (every innovation zero, no spread). Returned: as normalise.
 *             normalise: logw -= largest, weight = 2^logw, log_total; returned: 0 when the weights are not finite */
int weigh(const tse_params *p, tse_filter *f, const sample *y, const gaussian *g, tse_real *log2_evidence, tse_real *log2_best);
int normalise(const tse_params *p, tse_filter *f, tse_real *log2_largest);

/* consistency.c  is the sample as likely as it should be?  noise: this sample's R, in sigma^2 */
void consistency_start(tse_filter *f);
int consistency(const tse_params *p, tse_filter *f, sample *y, const forecast *c, tse_real noise[3]);
tse_real slow_factor(const tse_filter *f, int channel);
int spread_is_seen(const tse_filter *f, int a, tse_real spread);
int is_trying(const tse_filter *f);
int is_holding(const tse_filter *f);

/* slide.c     wheels that lock or spin: are they; motion from the inertial sensors meanwhile */
int wheels_slide(const tse_params *p, tse_filter *f, const sample *y);
void coast(const tse_params *p, tse_filter *f, const sample *y);

/* error.c     covariance of the error of the mean: prediction with the same Jacobian as the common covariance, update */
void error_predict(tse_filter *f, tse_real jac[3][6]);
void error_update(tse_filter *f, const forecast *c, const tse_real noise[3]);

/* estimate.c  (26), (27) from the weighted set / running regressors, and what they tell about each stiffness */
void estimate(const tse_params *p, const tse_filter *f, tse_output *y);
tse_real effective_size(const tse_params *p, const tse_filter *f);
void weighted_means(const tse_params *p, const tse_filter *f, const tse_real *const *rows, int n, tse_real *means);
void excitation(const tse_params *p, tse_filter *f, const sample *y, const tse_output *est, int32_t excited[3]);

/* resample.c  ancestors (ascending) of n particles for weights whose largest is 1; then survivors keep their places */
void resample(int32_t scheme, const tse_real *weight, int32_t n, const uint32_t seed[2], uint32_t step, uint16_t *ancestor);
void keep_survivors(uint16_t *ancestor, uint16_t *copies, int32_t n);
void copy_particles(tse_particles *p, const uint16_t *ancestor, int32_t n);

/* update.c    (25) draw w given y; (16) statistics given w; (19) bias given w */
void draw_and_learn(const tse_params *p, tse_filter *f, const sample *y, const gaussian *g);

/* gaussian.c  the common covariance: start, prediction (7), (18), observation, update (19); forgetting (17);
 *             zero-rate update of the gyro's bias while the wheels stand still. gaussian_observe returns 0 when the
 *             covariance is not made of numbers any more. */
void gaussian_clear(tse_filter *f, int first, int last);
void gaussian_start(const tse_params *p, tse_filter *f);
void gaussian_restart_states(const tse_params *p, tse_filter *f);
void gaussian_restart_means(const tse_params *p, tse_filter *f);
void gaussian_predict(const tse_params *p, tse_filter *f, inputs to, tse_real dt);
void gaussian_follow_level(const tse_params *p, tse_filter *f, const tse_output *est);
void bias_predict(const tse_params *p, tse_filter *f, tse_real dt);
void gaussian_foretell(const tse_params *p, const tse_filter *f, const sample *y, forecast *c);
int gaussian_observe(const forecast *f, const tse_real noise[3], gaussian *g);
void gaussian_update(const tse_params *p, tse_filter *f, const gaussian *g, const forecast *c, const tse_real noise[3]);
void forget(const tse_params *p, tse_filter *f, tse_real dt);
void bias_learn_still(const tse_params *p, tse_filter *f, const sample *y);

/* filter.c    a row of tse_step(), Algorithm 1.   told: NULL, or where the parameters with this row's effects go */
tse_status step_row(const tse_params *own, tse_params *told, tse_filter *f, const tse_input *u, tse_output *out);

/* told.c      what the effects of tse/effects.def change in a row, when any is on. told_step: step_row() with a place for
 *             these parameters, so that a filter without effects needs no stack for them.
 *             told_begin: y->u is that of the wheels; row: p with the secant stiffness of the row before, returned
 *             told_motion: what the weighted mean moves more with the effects than without, before propagate(); told_push: so
 *             moves every particle.   told_sample: the row's stiffness; y->y without what the effects add. moved: by (7);
 *             known: the wheels roll and are heard of, else there is no correction */
tse_status told_step(const tse_params *p, tse_filter *f, const tse_input *u, tse_output *out);
const tse_params *told_begin(const tse_params *p, tse_filter *f, sample *y, tse_params *row);
void told_motion(const tse_params *p, const tse_params *row, tse_filter *f, const sample *y, tse_real push[3]);
void told_push(const tse_params *p, tse_filter *f, const tse_real push[3]);
void told_sample(const tse_params *p, tse_params *row, tse_filter *f, sample *y, int moved, int known);

/* learnt.c */
uint32_t crc32_of(const uint8_t *bytes, size_t count);

/* What limits on an sd are relative to, squared: the mean, or (sampled) the nominal value. */
static inline tse_real level_2(const tse_params *p, const tse_output *est, int a)
{
  return p->marginalised ? r_mul(est->stiffness[a], est->stiffness[a]) : TSE_R(1);
}

static inline int32_t padded(int32_t n) { return (n + TSE_LANES - 1) / TSE_LANES * TSE_LANES; }

#ifdef __cplusplus
}
#endif
#endif
