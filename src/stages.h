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

#define input_decode      TSE_NAME(tse_input_decode)
#define initialise        TSE_NAME(tse_initialise)
#define restart_states    TSE_NAME(tse_restart_states)
#define redraw            TSE_NAME(tse_redraw)
#define propagate         TSE_NAME(tse_propagate)
#define weigh             TSE_NAME(tse_weigh)
#define normalise         TSE_NAME(tse_normalise)
#define estimate          TSE_NAME(tse_estimate)
#define excitation        TSE_NAME(tse_excitation)
#define resample          TSE_NAME(tse_resample)
#define keep_survivors    TSE_NAME(tse_keep_survivors)
#define copy_particles    TSE_NAME(tse_copy_particles)
#define draw_and_learn    TSE_NAME(tse_draw_and_learn)
#define forget            TSE_NAME(tse_forget)
#define bias_predict      TSE_NAME(tse_bias_predict)
#define bias_learn_still  TSE_NAME(tse_bias_learn_still)

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
} sample;

/* What (16), (22)-(25) have in common for all particles in one step. */
typedef struct niw_constants {
  tse_real nut;              /* nu - d_w + 1 = nu - 2, dof of (22)                             */
  tse_real a;                /* A = a lam: a = (1 + gamma) nu/nut                              */
  tse_real r[3];             /* (nut - 2)/nut (1 + P) per sensor, in sigma^2                   */
  tse_real half_dof;         /* (nut + d_y)/2                                                  */
  tse_real inv_nut;
} niw_constants;

static inline niw_constants niw_constants_of(const tse_filter *f, int32_t used)
{
  niw_constants n;
  n.nut = f->nu - TSE_R(2);
  n.inv_nut = r_div(TSE_R(1), n.nut);
  n.a = r_mul(TSE_R(1) + f->gamma, r_mul(f->nu, n.inv_nut));
  for (int i = 0; i < 3; i++)
    n.r[i] = r_mul(r_mul(n.nut - TSE_R(2), n.inv_nut), TSE_R(1) + f->bias_var[i]);
  n.half_dof = r_mul(TSE_R(0.5), n.nut + r_from_int(used));
  return n;
}

/* Innovation and its scale for one particle, (22): z = y - h - d mu - b,  S = d A d' + (nut - 2)/nut (R + P).
 * The third row of d is zero, so S is a 2x2 block and a scalar; the block is taken in two scalar steps, which is what a
 * Cholesky factor would do: channel 2 is weighed with the covariance of w that channel 1 leaves. */
typedef struct innovation {
  tse_real z1, z2, z3;          /* innovations, 0 where missing                                    */
  tse_real v1[3], v2[3];        /* A d1', A1 d2'  with A1 = A - v1 v1'/s1                          */
  tse_real s1, i1, s2, i2, i3;  /* scales of the two steps; their inverses, 0 where missing        */
  tse_real m[3];                /* A d' S^-1 z, the shift of w's mean given y, (25)                */
  tse_real a[6];                /* A1, upper triangle                                              */
  tse_real q;                   /* z' S^-1 z                                                       */
} innovation;

static inline innovation innovation_of(const niw_constants *n, const sample *y, observation o,
                                       tse_real mu0, tse_real mu1, tse_real mu2,
                                       tse_real l11, tse_real l12, tse_real l13, tse_real l22, tse_real l23, tse_real l33,
                                       tse_real b0, tse_real b1, tse_real b2, tse_real yaw)
{
  innovation e;
  const tse_real inv_r3 = r_div(TSE_R(1), n->r[2]); /* common to all particles: the compiler hoists it */
  const tse_real a11 = r_mul(n->a, l11), a12 = r_mul(n->a, l12), a13 = r_mul(n->a, l13);
  const tse_real a22 = r_mul(n->a, l22), a23 = r_mul(n->a, l23), a33 = r_mul(n->a, l33);

  e.z1 = r_mul(y->use[0], y->y[0] - o.h1 - r_mul(o.d11, mu0) - r_mul(o.d12, mu1) - b0);
  e.z2 = r_mul(y->use[1], y->y[1] - o.h2 - r_mul(o.d21, mu0) - r_mul(o.d22, mu1) - r_mul(o.d23, mu2) - b1);
  e.z3 = r_mul(y->use[2], y->y[2] - yaw - b2);

  e.v1[0] = r_mul(a11, o.d11) + r_mul(a12, o.d12);
  e.v1[1] = r_mul(a12, o.d11) + r_mul(a22, o.d12);
  e.v1[2] = r_mul(a13, o.d11) + r_mul(a23, o.d12);
  e.s1 = r_mul(o.d11, e.v1[0]) + r_mul(o.d12, e.v1[1]) + n->r[0];
  e.i1 = r_mul(y->use[0], r_div(TSE_R(1), e.s1));

  e.a[0] = a11 - r_mul(e.i1, r_mul(e.v1[0], e.v1[0]));
  e.a[1] = a12 - r_mul(e.i1, r_mul(e.v1[0], e.v1[1]));
  e.a[2] = a13 - r_mul(e.i1, r_mul(e.v1[0], e.v1[2]));
  e.a[3] = a22 - r_mul(e.i1, r_mul(e.v1[1], e.v1[1]));
  e.a[4] = a23 - r_mul(e.i1, r_mul(e.v1[1], e.v1[2]));
  e.a[5] = a33 - r_mul(e.i1, r_mul(e.v1[2], e.v1[2]));

  e.v2[0] = r_mul(e.a[0], o.d21) + r_mul(e.a[1], o.d22) + r_mul(e.a[2], o.d23);
  e.v2[1] = r_mul(e.a[1], o.d21) + r_mul(e.a[3], o.d22) + r_mul(e.a[4], o.d23);
  e.v2[2] = r_mul(e.a[2], o.d21) + r_mul(e.a[4], o.d22) + r_mul(e.a[5], o.d23);
  e.s2 = r_mul(o.d21, e.v2[0]) + r_mul(o.d22, e.v2[1]) + r_mul(o.d23, e.v2[2]) + n->r[1];
  e.i2 = r_mul(y->use[1], r_div(TSE_R(1), e.s2));
  e.i3 = inv_r3;

  const tse_real g1 = r_mul(e.i1, e.z1);
  e.m[0] = r_mul(e.v1[0], g1);
  e.m[1] = r_mul(e.v1[1], g1);
  e.m[2] = r_mul(e.v1[2], g1);
  const tse_real z2_given_1 = e.z2 - r_mul(y->use[1], r_mul(o.d21, e.m[0]) + r_mul(o.d22, e.m[1]) + r_mul(o.d23, e.m[2]));
  const tse_real g2 = r_mul(e.i2, z2_given_1);
  e.m[0] += r_mul(e.v2[0], g2);
  e.m[1] += r_mul(e.v2[1], g2);
  e.m[2] += r_mul(e.v2[2], g2);
  e.q = r_mul(g1, e.z1) + r_mul(g2, z2_given_1) + r_mul(r_mul(e.z3, e.z3), e.i3);
  return e;
}

/* input.c     row -> sample; the filter supplies held inputs for missing ones. Nothing is changed. */
tse_status input_decode(const tse_params *p, const tse_filter *f, const tse_input *u, sample *y);

/* start.c     particles from the settings and the first sample / states only / statistics of some particles */
void initialise(const tse_params *p, tse_filter *f, const sample *y);
void restart_states(const tse_params *p, tse_filter *f, const sample *y);
void redraw(const tse_params *p, tse_filter *f, const sample *y, int32_t count);

/* propagate.c (7)  all particles from the last row's inputs to u, in steps of at most max_step */
void propagate(const tse_params *p, tse_filter *f, inputs u, tse_real dt);

/* weigh.c     (22), (23): log q += log St(z), normalised; log2 evidence of the sample in SI units. Returned: as normalise.
 *             normalise: logw -= largest, weight = 2^logw, log_total; returned: 0 when the weights are not finite */
int weigh(const tse_params *p, tse_filter *f, const sample *y, tse_real *log2_evidence);
int normalise(const tse_params *p, tse_filter *f, tse_real *log2_largest);

/* estimate.c  (26), (27) from the weighted set / running regressors, and what they tell about each stiffness */
void estimate(const tse_params *p, const tse_filter *f, tse_output *y);
void excitation(const tse_params *p, tse_filter *f, const sample *y, const tse_output *est, int32_t excited[3]);

/* resample.c  ancestors (ascending) of n particles for weights whose largest is 1; then survivors keep their places */
void resample(int32_t scheme, const tse_real *weight, int32_t n, const uint32_t seed[2], uint32_t step, uint16_t *ancestor);
void keep_survivors(uint16_t *ancestor, uint16_t *copies, int32_t n);
void copy_particles(tse_particles *p, const uint16_t *ancestor, int32_t n);

/* update.c    (25) draw w given y; (16) statistics given w; (19) bias given w */
void draw_and_learn(const tse_params *p, tse_filter *f, const sample *y);

/* bias.c      (17) / (18) / zero-rate update of the gyro's bias while the wheels stand still */
void forget(const tse_params *p, tse_filter *f, tse_real dt);
void bias_predict(const tse_params *p, tse_filter *f, tse_real dt);
void bias_learn_still(const tse_params *p, tse_filter *f, const sample *y);

static inline int32_t padded(int32_t n) { return (n + TSE_LANES - 1) / TSE_LANES * TSE_LANES; }

#ifdef __cplusplus
}
#endif
#endif
