/* filter/slip_stiffness.h - estimate of the longitudinal stiffness. Internal. */
#ifndef TSE_FILTER_SLIP_STIFFNESS_H
#define TSE_FILTER_SLIP_STIFFNESS_H

#include "filter/types.h"

/* The state LCX is the logarithm of the longitudinal (slip) stiffness plus the error
 * of the longitudinal model, which for example the pitch and wrong rolling radii
 * cause. These functions estimate the logarithm of the slip stiffness alone
 * (tse_along). */

/* Start the estimate of the slip stiffness at the present value of LCX, with
 * the prior variance `var`. */
STAGE void along_start(tse_kalman *k, tse_real var);

/* Return w = P^2/(P^2 + B^2 (P - V)), the share of a change of LCX that is a change of
 * ln(slip stiffness). The rest, 1 - w, is a change of the model error. P is the prior
 * variance of ln(slip stiffness), V the present variance of LCX, and B the sd of the
 * model error. As long as nothing is learnt, V = P and w = 1. If V is near 0, w is near
 * P/(P + B^2).
 *   Given:     var_lcx  V, in squared units of the state (state_unit)
 *   Returned:  *var     posterior variance of ln(slip stiffness), P - w (P - V) */
STAGE tse_real along_share(const tse_params *p, const tse_kalman *k, tse_real var_lcx, tse_real *var);

/* Return the estimate of ln(slip stiffness). If the change that along_share() attributes
 * to the model error exceeds the sd B of this error, increase the variance of the result
 * by change^2 - B^2, because the tyres may have changed.
 *   Given:    shift  mean shift of LCX by events that are not accepted yet; it is added
 *                    to the result
 *   Updated:  var    in: variance of LCX, including the part due to the events that are
 *                    not accepted yet; out: variance of the result */
tse_real along_estimate(const tse_params *p, const tse_kalman *k, tse_real shift, tse_real *var);

/* Start a new estimate of ln(slip stiffness) at the present value of LCX, after an
 * accepted change of the road surface or of the tyres, because the model error after the
 * change is unknown. The variance of the new estimate is that of the old estimate plus
 * the increase of the variance of LCX by the change. If the change is a return to the
 * previous road (which = EVENT_ROAD_RETURN), restore the estimate for that road instead.
 *   Given:  which   kind of the event: EVENT_ROAD ...
 *           before  variance of LCX before the change, in squared units of the state */
void along_restart(const tse_params *p, tse_kalman *k, int32_t which, tse_real before);

#endif
