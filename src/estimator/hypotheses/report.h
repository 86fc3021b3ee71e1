/* estimator/hypotheses/report.h - what the bank believes. Internal. */
#ifndef TSE_HYPOTHESES_REPORT_H
#define TSE_HYPOTHESES_REPORT_H

#include "estimator/stages.h"

#define bank_report        TSE_NAME(tse_bank_report)
#define bank_stiffness_var TSE_NAME(tse_bank_stiffness_var)

/* Estimates, probabilities of the regimes, the last change. Validity and status are the caller's. */
void bank_report(const tse_params *p, const tse_bank *b, tse_output *out);

/* Variance of the mean of a stiffness without what the levels of the slow disturbances add to it in a report. [1] */
tse_real bank_stiffness_var(const tse_bank *b, int a);

#endif
