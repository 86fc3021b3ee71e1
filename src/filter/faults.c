/* filter/faults.c - find channels that are frozen, and measure the time for which a
 * faulty channel has agreed with the prediction again. */
#include "filter/exponential.h"
#include "filter/faults.h"

/* See faults.h. The evidence is -log2 of the probability that a working channel
 * repeats its value as many times as this channel has now repeated it. Each repeated
 * value adds -log2(probability of a repeat) min(nis, 1). The factor min(nis, 1) is
 * small if the repeated value agrees with the prediction. A new value resets the
 * evidence to 0. The probability of a repeat is the largest of three numbers: the
 * share of repeats among all values of about the last USUAL_TIME, their share among
 * the values that follow a repeat, and `least`. */
void watch_repeats(tse_kalman *k, int c, tse_real z, tse_real nis, tse_real least, tse_real dt)
{
  const int is_repeat = !(z < k->reading[c] || z > k->reading[c]);
  const int follows_repeat = k->frozen[c] > TSE_R(0);
  const tse_real g = r_min(r_div(dt, r_min(k->seen + TSE_R(1), USUAL_TIME)), MAX_GAIN);
  const tse_real now = is_repeat ? TSE_R(1) : TSE_R(0);
  const tse_real probability = r_max(r_max(k->repeats[c], k->repeats_again[c]), least);
  const tse_real evidence = r_mul(r_min(nis, TSE_R(1)), r_log2(r_min(probability, MAX_REPEATS)));
  k->reading[c] = z;
  k->frozen[c] = is_repeat ? r_min(k->frozen[c] - evidence, MAX_FROZEN) : TSE_R(0);
  if (follows_repeat) k->repeats_again[c] += r_mul(g, now - k->repeats_again[c]);
  k->repeats[c] += r_mul(g, now - k->repeats[c]);
}

int is_frozen(const tse_kalman *k, int channel) { return k->frozen[channel] > -r_log2(RATE_FAULT); }

int is_usable(const tse_kalman *k, int channel)
{
  return k->fault != fault_of(channel) && !is_frozen(k, channel);
}

/* See faults.h. The yaw rate contradicts the steering angle if the low-passed innovation
 * `slow` of the yaw rate was too large in the previous row: slow^2 > TAIL usual slow_var.
 * slow_var is the variance of slow, usual the recent mean of slow^2/slow_var. */
int watch_steering(tse_kalman *k, decoded *z)
{
  const tse_real usual = r_mul(r_mul(TAIL, k->usual[YAW_RATE]), r_max(k->slow_var[YAW_RATE], MIN_SLOW_VAR));
  const int was = is_frozen(k, STEERING);
  const int compared = k->innovation_var[YAW_RATE] > TSE_R(0) && is_usable(k, YAW_RATE);
  if (!z->has_steer) return 0;
  const tse_real contradicts = compared && r_sqr(k->slow[YAW_RATE]) > usual ? TSE_R(1) : TSE_R(0);
  watch_repeats(k, STEERING, z->steer, contradicts, compute_decay(z->dt, STEER_HOLD_TIME), z->dt);
  z->has_steer = !is_frozen(k, STEERING);
  return !was && !z->has_steer;
}

/* See faults.h. The channel agrees with the prediction if e^2 < TAIL S and the channel is
 * not frozen. e is the innovation, S its variance. S does not include the part due to
 * consider parameters here. */
void watch_fault(tse_kalman *k, int channel, const scalar *m)
{
  tse_real f[TSE_ALL], v[TSE_ALL];
  const tse_real s = r_add_sat(ud_measure(&k->ud, m->h, f, v), m->r);
  const int agrees = r_sqr(m->e) < r_mul(TAIL, s) && !is_frozen(k, channel);
  k->innovation[channel] = m->e;
  k->innovation_var[channel] = s;
  if (k->fault == fault_of(channel))
    k->agrees_for = agrees ? r_min(k->agrees_for + m->dt, MAX_AGE) : TSE_R(0);
}
