/* estimator/hypotheses/repeats.c - noise does not repeat itself to the last bit; coarse steps do, and held values.
 *
 * How often each channel does is learnt. A repeated value is certain of a stuck channel, and as likely as usual of one that is not:
 * that ratio is evidence, in place of the density of a reading that tells nothing. */
#include "estimator/hypotheses/repeats.h"

#define LONGEST_RUN 20         /* rows: a channel that was stuck for long counts as so many repeats            */
#define MOST_READING TSE_R(400) /* of any channel (tse/input.def): beyond, it is missing                        */
#define FITTING TSE_R(0.72)    /* log2 of what a reading that fits costs: half of a squared sigma, on average  */

void watch_repeats(tse_repeats *r, const tse_real now[6], const int32_t there[6])
{
  for (int c = 0; c < 6; c++) {
    const int same = there[c] && now[c] == r->last[c], after = r->run[c] > 0 ? 1 : 0;
    const tse_real usual = r_div(r->repeats[c][after] + TSE_R(1), r->rows[c][after] + REPEAT_PRIOR);
    if (!after) { /* a new value: is it repeated? */
      r->rows[c][0] += TSE_R(1);
      r->repeats[c][0] += same ? TSE_R(1) : TSE_R(0);
    } else if (!same) { /* a run has ended */
      r->rows[c][1] += r_from_int(r->run[c] + 1);
      r->repeats[c][1] += r_from_int(r->run[c]);
    }
    for (int k = 0; k < 2; k++)
      if (r->rows[c][k] > REPEAT_ROWS) {
        r->rows[c][k] = r_mul(TSE_R(0.5), r->rows[c][k]);
        r->repeats[c][k] = r_mul(TSE_R(0.5), r->repeats[c][k]);
      }
    r->evidence[c] = same ? r_max(-r_log2(usual), TSE_R(1e-6)) : TSE_R(0);
    r->last[c] = r_abs(now[c]) <= MOST_READING ? now[c] : TSE_R(0); /* NaN, too */
    r->run[c] = !same ? 0 : r->run[c] < LONGEST_RUN ? r->run[c] + 1 : LONGEST_RUN;
  }
}

/* log2 of the evidence that a hypothesis pays for a variance q along v, which is part of its S. */
static tse_real price_of(const innovation *o, const tse_real v[3], tse_real q)
{
  return -r_mul(TSE_R(0.5), r_log2(r_max(TSE_R(1) - r_mul(q, quadratic(o, v)), TSE_R(1e-5))));
}

tse_real evidence_of_repeat(const tse_repeats *r, const tse_hypothesis *h, const innovation *o)
{
  tse_real v[3] = { TSE_R(0), TSE_R(0), TSE_R(0) };
  if (h->fault == FAULT_NONE || !(r->evidence[h->fault - 1] > TSE_R(0))) return TSE_R(0);
  tse_real q;
  if (h->fault >= FAULT_MEASURED) {
    const int c = h->fault - FAULT_MEASURED;
    v[c] = TSE_R(1);
    q = r_mul(o->noise[c], TSE_R(1) - r_div(TSE_R(1), FAULT_NOISE));
  } else {
    const int a = h->fault == FAULT_STEER ? TSE_CY_FRONT : TSE_CX_FRONT;
    for (int i = 0; i < 3; i++) v[i] = o->d[i][a];
    q = o->eps_var[a];
  }
  return r->evidence[h->fault - 1] - FITTING + price_of(o, v, q);
}

tse_real promise_of_repeat(const tse_repeats *r, const innovation *o, const tse_real v[3], tse_real q, int channel)
{
  if (!(r->evidence[channel] > TSE_R(0))) return TSE_R(0);
  return r->evidence[channel] - FITTING - price_of(o, v, -q);
}
