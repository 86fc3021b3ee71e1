/* paper/algorithm1.c - Algorithm 1 of the paper, line by line. The comments on the right
 * give the line numbers of Algorithm 1 and, in parentheses, the equations of the paper.
 *
 * The order of the lines differs from Algorithm 1 in two places. Lines 17 and 18, the
 * prediction to the next row, are processed when the next row arrives, because the time
 * step is not known before. Line 4, which updates the statistics with the stiffness
 * deviation w of this row, follows line 16, which draws w. src/EQUATIONS.md lists all
 * other deviations from the paper, with the reasons. */
#include "paper/paper.h"

void paper_predict(const tse_params *p, tse_filter_paper *f, const sample *y)
{
  paper_predict_state(p, f, y);    /* 17      (7)        */
  paper_predict_bias(p, f, y->dt); /* 18      (18)       */
}

void paper_update(
    const tse_params *p, tse_filter_paper *f, const sample *y, tse_output *now, tse_real *log2_evidence)
{
  const common c = paper_compute_common(p, f, y);
  *log2_evidence = paper_update_weights(p, f, y, &c);     /* 3, 6    (22), (23) */
  now->n_eff = paper_effective_size(p, f);                /* 7                  */
  if (now->n_eff <= p->resample_at) paper_resample(p, f); /* 8 .. 10            */
  paper_draw_stiffness(p, f, y, &c);                      /* 16      (25)       */
  paper_update_statistics(p, f);                          /* 4       (16)       */
  paper_estimate(p, f, now);                              /* 11, 12  (26), (27) */
  paper_update_bias(p, f, y, &c);                         /* 14      (19)       */
  paper_forget(p, f, y, now);                             /* 15      (17)       */
}
