/* filter/sensitivities.c - sensitivities of the state, in units of the state: its shift
 * per unit of the amplitude of each event (tse_event.v), and per sd of each consider
 * parameter (tse_kalman.consider). */
#include "filter/sensitivities.h"

void sensitivities_clear(tse_kalman *k, int count)
{
  for (int n = 0; n < TSE_EVENTS; n++)
    for (int i = 0; i < count; i++) k->event[n].v[i] = r_short(TSE_R(0));
  for (int q = 0; q < TSE_CONSIDERED; q++)
    for (int i = 0; i < count; i++) k->consider[q][i] = r_short(TSE_R(0));
}

static tse_real sum_squares(const tse_short v[TSE_ALL])
{
  tse_real sum = TSE_R(0);
  for (int i = 0; i < MOTION; i++) sum += r_mul_short(v[i], v[i]);
  return sum;
}

int are_sensitivities_known(const tse_kalman *k)
{
  int known = 1;
  for (int n = 0; n < TSE_EVENTS; n++)
    known = known && (k->event[n].kind == EVENT_NONE || sum_squares(k->event[n].v) < MAX_D);
  for (int q = 0; q < TSE_CONSIDERED; q++) known = known && sum_squares(k->consider[q]) < MAX_D;
  return known;
}

static void fade_element(tse_short *v, tse_real left)
{
  if (*v != TSE_R(0)) *v = r_short(r_mul(left, r_long(*v))); /* most elements are 0 */
}

void sensitivities_fade(tse_kalman *k, int i, tse_real left)
{
  for (int q = 0; q < TSE_CONSIDERED; q++) fade_element(&k->consider[q][i], left);
  for (int n = 0; n < TSE_EVENTS; n++) fade_element(&k->event[n].v[i], left);
}

/* Number of sensitivity vectors (tse_event.v, tse_kalman.consider) that move_together()
 * propagates in one call. */
enum { MOVED = R_TOGETHER(3) };

/* Multiply MOVED sensitivity vectors v by the transition matrix M. M has only the rows of
 * the motion, and the other elements of v remain. */
static void move_together(tse_short *const v[MOVED], tse_short M[MOTION][PLACES])
{
  tse_short to[MOTION * MOVED];
  for (int i = 0; i < MOTION * MOVED; i++) to[i] = r_short(TSE_R(0));
  r_slope_sums(to, MOTION, M[0], PLACES, v, MOVED, STATES);
  for (int i = 0; i < MOTION; i++)
    for (int b = 0; b < MOVED; b++) v[b][i] = to[i * MOVED + b];
}

void sensitivities_move(const tse_params *p, tse_kalman *k, tse_short M[MOTION][PLACES], tse_real dt)
{
  tse_short *v[TSE_EVENTS + TSE_CONSIDERED + MOVED];
  int count = 0;
  for (int n = 0; n < TSE_EVENTS; n++) {
    tse_event *const e = &k->event[n];
    if (e->kind == EVENT_NONE) continue;
    v[count++] = e->v;
    e->age += dt;
  }
  for (int q = 0; q < TSE_CONSIDERED; q++)
    if (p->uncertain[q] > TSE_R(0)) v[count++] = k->consider[q];
  /* move_together() takes MOVED sensitivities. In the last call there may be fewer, so
   * that the last one is passed several times. All its results are then the same, because
   * move_together() computes them from the old values before it stores any of them. */
  for (int b = 0; b < MOVED && count; b++) v[count + b] = v[count - 1];
  for (int n = 0; n < count; n += MOVED) move_together(&v[n], M);
  for (int q = 0; q < COLUMNS - STATES; q++)
    for (int i = 0; i < MOTION && p->uncertain[q] > TSE_R(0); i++)
      k->consider[q][i] = r_short(
          r_long(k->consider[q][i]) + r_mul(r_long(M[i][STATES + q]), p->uncertain[q]));
}

tse_real compute_total_variance(const tse_kalman *k, int i)
{
  tse_real var = ud_variance(&k->ud, i);
  for (int q = 0; q < TSE_CONSIDERED; q++) var += r_mul_short(k->consider[q][i], k->consider[q][i]);
  return var;
}
