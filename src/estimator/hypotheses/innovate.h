/* estimator/hypotheses/innovate.h - a sample as a hypothesis foretells it. Internal. */
#ifndef TSE_HYPOTHESES_INNOVATE_H
#define TSE_HYPOTHESES_INNOVATE_H

#include "estimator/hypotheses/hypothesis.h"

#define innovate TSE_NAME(tse_hypothesis_innovate)

/* Everything in sigma of the sensors, but in fixed point: there S may need more digits than there are, by wheels that lock, or a speed
 * that is not known, and what comes after the forecast is in units of 2^coarser sigma. A channel that is missing has zero rows and an
 * innovation of zero. */
typedef struct innovation {
  tse_real forecast[3];      /* without biases and disturbances, always in sigma       */
#if defined(TSE_REAL_FIXED)
  int32_t coarser[3];
#endif
  tse_real use[3];           /* one sigma, 0 where the channel is missing              */
  tse_real e[3];             /* sample less forecast                                   */
  tse_real h[3][6];          /* d(forecast)/d(states, stiffness)                       */
  tse_real lag[3];           /* d(forecast)/d(lag of the steering)                     */
  tse_real d[3][3];          /* d(forecast)/d(eps)                                     */
  tse_real unknown[3][3];    /* d(forecast)/d(steering angle, wheel speeds front, rear) */
  tse_real eps_var[3];       /* of the spread of each stiffness, or of what is at fault */
  tse_real noise[3];         /* R, by noise of the wheel speeds included               */
  tse_real ph[3][TSE_X];     /* (P H')'                                                */
  tse_real s[3][3], inv[3][3]; /* S = H P H' + D var D' + R, its inverse               */
  tse_real se[3];            /* S^-1 e                                                 */
  tse_real m2;               /* e' S^-1 e                                              */
  tse_real log2_det;         /* of S                                                   */
  tse_real half_dof;         /* (dof + channels)/2 of the evidence                     */
  int slides;                /* slip beyond what the model knows                       */
  int saturated;             /* S has left the range of the number format              */
} innovation;

/* A number of channel a in sigma as one in the units of the innovation, and back. */
static inline tse_real in_units(const innovation *o, int a, tse_real x)
{
#if defined(TSE_REAL_FIXED)
  return fixed_coarser(x, o->coarser[a]);
#else
  (void)o;
  (void)a;
  return x;
#endif
}

static inline tse_real in_sigma(const innovation *o, int a, tse_real x)
{
#if defined(TSE_REAL_FIXED)
  return r_mul(x, (tse_real)1 << (FIXED_BITS + o->coarser[a]));
#else
  (void)o;
  (void)a;
  return x;
#endif
}

void innovate(const tse_params *p, const tse_hypothesis *h, const sample *y, innovation *o);

/* How much of its gain a sample keeps: the less the further off it is; nothing where S is not one. */
static inline tse_real trust_of(const innovation *o)
{
  if (o->saturated) return TSE_R(0);
  return o->m2 > TRUST_FROM ? r_div(EVIDENCE_DOF + TRUST_FROM, EVIDENCE_DOF + o->m2) : TSE_R(1);
}

/* log2 of what an innovation of this size costs: Student-t. */
static inline tse_real student_cost(const innovation *o, tse_real m2)
{
  return r_mul(o->half_dof, r_log2(TSE_R(1) + r_div(m2, EVIDENCE_DOF)));
}

/* The same, and no more than what it costs that the sample is an outlier, so that one sample far off does not decide. */
static inline tse_real cost_of(const innovation *o, tse_real m2)
{
  return r_min(student_cost(o, m2), OUTLIER_COST);
}

/* log2 density of the sample but for a constant. */
static inline tse_real log2_density(const innovation *o)
{
  return -r_mul(TSE_R(0.5), o->log2_det) - cost_of(o, o->m2);
}

/* v' S^-1 v and v' S^-1 e */
static inline tse_real quadratic(const innovation *o, const tse_real v[3])
{
  tse_real g = TSE_R(0);
  for (int a = 0; a < 3; a++) g += r_mul(v[a], r_mul(o->inv[a][0], v[0]) + r_mul(o->inv[a][1], v[1]) + r_mul(o->inv[a][2], v[2]));
  return g;
}

static inline tse_real along(const innovation *o, const tse_real v[3])
{
  return r_mul(v[0], o->se[0]) + r_mul(v[1], o->se[1]) + r_mul(v[2], o->se[2]);
}

#endif
