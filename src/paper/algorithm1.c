/* paper/algorithm1.c - Algorithm 1 of the paper, line by line. The comments on the right
 * give its lines, and its equations in parentheses.
 *
 * The processing of a row begins with lines 17 and 18 of the previous row, because the
 * time step between the two rows was not known before. w is drawn (line 16) before the
 * statistics are updated with it (line 4). src/EQUATIONS.md lists every other deviation
 * from the paper, with its reason. */
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
