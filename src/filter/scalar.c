/* filter/scalar.c - update of the filter with one scalar measurement. The gain is that of
 * Schmidt (1966) for consider parameters: uncertain parameters that are not estimated.
 * Their uncertainty increases the variance S of the innovation and changes the gain. For
 * an innovation above 3 sd the gain is reduced, because the errors of sensors have heavy
 * tails.
 *
 * Given are:
 *   h           partial derivatives of the measurement with respect to the state
 *   d           partial derivatives of the measurement with respect to the parameters,
 *               each multiplied by the sd of the parameter
 *   r           variance of noise and model discrepancy of the measurement
 *   A = U D U'  covariance that the state would have if the parameters were known
 *   V           sensitivities of the state to the parameters, per sd of each parameter
 *
 * The update computes:
 *   y = V' h + d                 shift of the innovation per sd of each parameter
 *   S = h' A h + y' y + r        variance of the innovation
 *   K = (A h + V y)/S            gain
 *   V = V - K y'
 * A is updated with the gain for known parameters, K0 = A h/S0, S0 = h' A h + r. Because
 * the state is updated with K instead, S0 (K - K0)(K - K0)' is then added to A (Joseph's
 * form of the scalar update). */
#include "filter/events.h"
#include "filter/scalar.h"

/* Update tse_kalman.usual of channel c, and return it. It is the mean over USUAL_TIME of
 * the ratio (squared low-passed innovation)/(its predicted variance), and is at least 1.
 * A constant model error increases this mean. In event tests the variance of the
 * innovation is multiplied by the mean, so that a constant model error does not look like
 * an event.
 *   Given:    e, s         innovation and its variance
 *   Updated:  k->slow      low-passed innovation
 *             k->slow_var  predicted variance of the low-passed innovation
 *             k->usual     the mean ratio */
static tse_real update_usual(tse_kalman *k, int c, tse_real e, tse_real s, tse_real dt)
{
  const tse_real g = r_div(dt, dt + MODEL_TIME);
  const tse_real gain = r_min(r_div(dt, USUAL_TIME), MAX_GAIN);
  const tse_real max_e = r_sqrt(r_mul(TAIL, s));
  k->slow[c] += r_mul(g, r_clamp(e, -max_e, max_e) - k->slow[c]);
  k->slow_var[c] = r_mul(r_sqr(TSE_R(1) - g), k->slow_var[c]) + r_mul(r_mul(g, g), s);
  const tse_real ratio = r_div(r_sqr(k->slow[c]), r_max(k->slow_var[c], MIN_SLOW_VAR));
  const tse_real counts = r_min(ratio, r_mul(MAX_GROWTH, k->usual[c]));
  k->usual[c] = r_clamp(k->usual[c] + r_mul(gain, counts - k->usual[c]), TSE_R(1), MAX_USUAL);
  return k->usual[c];
}

/* Number of consider parameters that the loops below process at once. */
enum { TOGETHER = R_TOGETHER(TSE_CONSIDERED) };

/* Compute y = V' h + d, the shift of the innovation of a measurement per sd of each
 * consider parameter.
 *   Given:  own  d: partial derivatives of the measurement with respect to the
 *                parameters, each multiplied by the sd of the parameter
 *           h    partial derivatives of the measurement with respect to the state */
static void compute_shifts(
    const tse_kalman *k, const tse_real own[TSE_CONSIDERED], const r_sparse *h, tse_real y[TSE_CONSIDERED])
{
  for (int q = 0; q < TSE_CONSIDERED; q += TOGETHER) {
    r_dot sum[TOGETHER];
    for (int b = 0; b < TOGETHER; b++) sum[b] = r_dot_start(own[q + b]);
    for (int i = 0; i < h->count; i++)
      for (int b = 0; b < TOGETHER; b++) sum[b] = r_dot_plus(sum[b], h->m[i], k->consider[q + b][h->at[i]]);
    for (int b = 0; b < TOGETHER; b++) y[q + b] = r_dot_end(own[q + b], sum[b], h->right);
  }
}

/* Update V, the sensitivities of the state to the consider parameters, in an update:
 * V - K y'. K is the gain, and y the result of compute_shifts(). */
static void correct_shifts(tse_kalman *k, const tse_real y[TSE_CONSIDERED], const r_scaled *gain, int n)
{
  for (int q = 0; q < TSE_CONSIDERED; q += TOGETHER) {
    r_factored back[TOGETHER];
    for (int b = 0; b < TOGETHER; b++) back[b] = r_factor(-y[q + b], gain->up);
    for (int i = 0; i < n; i++)
      for (int b = 0; b < TOGETHER; b++)
        k->consider[q + b][i] = r_plus_times(k->consider[q + b][i], back[b], gain->m[i]);
  }
}

/* Change the gain from K0 to that of Schmidt, K = (A h + V y)/S. Add S0 (K - K0)(K - K0)'
 * to the covariance A, which was updated with K0.
 *   Given:    y, S   as at the top of this file
 *             S0     h' A h + r
 *             dgain  work space
 *   Updated:  gain   in: K0, out: K */
static void correct_gain(tse_kalman *k, const tse_real y[TSE_CONSIDERED], tse_real S, tse_real S0,
    tse_real gain[TSE_ALL], tse_real dgain[TSE_ALL])
{
  const tse_real share = r_div(S0, S), over = r_div(TSE_R(1), S);
  for (int i = 0; i < STATES + k->ud.extras; i++) {
    tse_real K = r_mul(gain[i], share);
    for (int q = 0; q < TSE_CONSIDERED; q++) K += r_mul(r_mul(r_long(k->consider[q][i]), y[q]), over);
    dgain[i] = K - gain[i];
    gain[i] = K;
  }
  ud_add(&k->ud, dgain, STATES - 1, S0);
}

tse_real use_scalar(
    tse_kalman *k, int channel, const scalar *m, tse_real sd, tse_real change[TSE_ALL], tse_real *state)
{
  tse_real f[TSE_ALL], v[TSE_ALL], gain[TSE_ALL], y[TSE_CONSIDERED];
  tse_short room[TSE_ALL];
  r_sparse h;
  const int n = STATES + k->ud.extras;
  r_sparse_of(m->h, STATES, &h);
  const tse_real h_A_h = ud_measure_sparse(&k->ud, m->h, &h, f, v);
  const tse_real e_squared = r_mul(m->e, m->e);
  if (n > STATES) r_sparse_of(m->h, n, &h);
  compute_shifts(k, m->consider, &h, y);
  tse_real consider_var = TSE_R(0);
  for (int q = 0; q < TSE_CONSIDERED; q++) consider_var += r_mul(y[q], y[q]);
  *state = h_A_h + consider_var;
  /* if |e| exceeds 3 sd of the innovation, increase r, which reduces the gain */
  const tse_real r = r_max(m->r, r_div(e_squared, TAIL) - *state);
  const tse_real S = *state + r;
  ud_correct(&k->ud, f, v, h_A_h, r, gain);
  if (consider_var > r_mul(NEGLIGIBLE, S)) correct_gain(k, y, S, h_A_h + r, gain, f);
  const tse_real s_event = *state + m->white + r_mul(EVENT_SHARE, m->r - m->white);
  const tse_real usual = channel >= 0 ? update_usual(k, channel, m->e, s_event, m->dt) : TSE_R(1);
  const r_scaled scaled = r_scaled_of(gain, n, room);
  events_learn(k, channel, channel >= 0 && m->along, &h, &scaled, m->e,
      r_max(r_mul(usual, s_event), r_div(e_squared, TAIL)), sd);
  for (int i = 0; i < n; i++) change[i] += r_mul(gain[i], m->e);
  correct_shifts(k, y, &scaled, n);
  return S;
}
