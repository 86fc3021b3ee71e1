/* estimator/hypotheses/report.h - what the bank believes. Internal. */
#ifndef TSE_HYPOTHESES_REPORT_H
#define TSE_HYPOTHESES_REPORT_H

#include "estimator/stages.h"

#define bank_report        TSE_NAME(tse_bank_report)
#define bank_stiffness_var TSE_NAME(tse_bank_stiffness_var)
#define bank_doubts        TSE_NAME(tse_bank_doubts)

/* Estimates, probabilities of the regimes, the last change. Validity and status are the caller's. */
void bank_report(const tse_params *p, const tse_bank *b, tse_output *out);

/* Variance of the mean of a stiffness without what the levels of the slow disturbances add to it in a report. [1] */
tse_real bank_stiffness_var(const tse_params *p, const tse_bank *b, int a);

/* What of the variance of stiffness a, as `out` reports it, comes of what is told of the car, and of what the model does not explain. */
void bank_doubts(const tse_params *p, const tse_bank *b, const tse_output *out, int a, tse_real *by_what_is_told, tse_real *by_misfit);

#endif
