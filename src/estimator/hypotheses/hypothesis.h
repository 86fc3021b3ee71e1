/* estimator/hypotheses/hypothesis.h - what the stages of the default form share: names of the parts of X, of the births. Internal. */
#ifndef TSE_HYPOTHESIS_H
#define TSE_HYPOTHESIS_H

#include "estimator/stages.h"
#include "model/slopes.h"
#include "tse/constants.h"

#define LOG2_E TSE_R(1.4426950408889634)

/* X: vel_x, vel_y, yaw rate | stiffness over nominal | biases [sigma] | slow disturbances [sigma] | common rate of drift [1/s] |
 * lag of the steering [LAG_TIME] */
enum { X_STATE = 0, X_STIFFNESS = 3, X_BIAS = 6, X_SLOW = 9, X_RATE = 12, X_LAG = 13 };

/* Channels as tse_hypothesis.fault numbers them: 1 + place in tse/input.def. */
enum { FAULT_NONE, FAULT_STEER, FAULT_FRONT_WHEELS, FAULT_REAR_WHEELS, FAULT_MEASURED };

enum { STEADY, DRIFTS_SLOWLY, DRIFTS_FAST };
enum { LEVELS = 4 }; /* of the slow disturbance: none, and each three times the one before */

/* How a hypothesis is born: what it says has just happened. */
enum {
  KIND_ROAD, KIND_FRONT, KIND_REAR, KIND_DRIFT_SLOW, KIND_DRIFT_FAST, KIND_DRIFT_END, KIND_FAULT, KIND_FAULT_END = KIND_FAULT + 6,
  KIND_LEVEL_UP, KIND_LEVEL_DOWN = KIND_LEVEL_UP + 3, KIND_RESTART = KIND_LEVEL_DOWN + 3, KIND_LOST, KIND_HOLD
};

/* A fault leaves something unknown that takes the place of the spread of a stiffness. Returned: BY_STEER, BY_FRONT_WHEELS or
 * BY_REAR_WHEELS in place of stiffness a; -1: its spread. */
static inline int unknown_in_place_of(const tse_hypothesis *h, int a)
{
  if (h->fault == FAULT_STEER && a == TSE_CY_FRONT) return BY_STEER;
  if (h->fault == FAULT_FRONT_WHEELS && a == TSE_CX_FRONT) return BY_FRONT_WHEELS;
  return h->fault == FAULT_REAR_WHEELS && a == TSE_CX_FRONT ? BY_REAR_WHEELS : -1;
}

/* Slips for the slopes: smoothed where wheel speeds are noisy. */
static inline const tse_real *slips_for_slopes(const tse_params *p, const tse_hypothesis *h)
{
  return p->wheel_var[0] > TSE_R(0) ? h->slip : NULL;
}

/* Inputs as this hypothesis has them act. */
static inline inputs acting(const tse_hypothesis *h, course c)
{
  inputs u = c.now;
  u.steer += r_mul(h->x[X_LAG], c.late_steer - c.now.steer);
  return u;
}

/* What the model does not explain is the larger the more happens: a share of what is foretold, of any car that is no model and
 * beside it by level. [sigma^2] */
static inline tse_real disturbance_var(const tse_params *p, const tse_hypothesis *h, int channel, int32_t level)
{
  static const int32_t ninefold[LEVELS] = { 0, 1, 9, 81 };
  const tse_real known = r_mul(p->model_var, r_sqr(h->activity[channel]));
  return r_mul(r_sqr(r_mul(DISTURBANCE_SHARE, h->activity[channel])), r_from_int(ninefold[level])) + known;
}

/* What the model does not explain of the channels that show a stiffness may be what the stiffness is off by: sd of that, relative. */
static inline tse_real doubt_by_levels(const tse_params *p, const int32_t level[3], int a)
{
  static const int32_t threefold[LEVELS] = { 0, 1, 3, 9 };
  const int32_t lateral = level[1] > level[2] ? level[1] : level[2];
  return r_mul(p->doubt, r_from_int(threefold[a == TSE_CX_FRONT ? level[0] : lateral]));
}

#endif
