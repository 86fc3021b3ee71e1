/* estimator/hypotheses/bank.c - weights are evidence times prior rates; what has become the same is one. */
#include "estimator/hypotheses/bank.h"
#include "estimator/hypotheses/consider.h"
#include "estimator/hypotheses/regimes.h"
#include "estimator/hypotheses/update.h"

#define GAINED_TIME TSE_R(2) /* s over which what the samples tell of a stiffness is averaged */
#define LONGEST_AGE LONGEST_WAIT

void bank_start(const tse_params *p, tse_bank *b, const tse_start *s, const sample *y)
{
  static const int32_t held_of[6] = { 0, 0, 0, 1, 1, 1 };
  const tse_real noise_of[3] = { TSE_R(1), START_LOUD, r_div(TSE_R(1), START_LOUD) }; /* as told, louder, quieter */
  const uint32_t saturated = b->saturated;
  memset(b, 0, sizeof *b);
  b->saturated = saturated;
  start_hypothesis(p, &b->h[0], s, y);
  const tse_hypothesis *const first = &b->h[0];
  const tse_real noise[3] = { first->noise_var[0], first->noise_var[1], first->noise_var[2] };
  const int32_t held = first->held;
  for (int k = 0; k < 6; k++) {
    const int told = k % 3 == 0;
    if (b->count == p->hypotheses || (p->inputs_held < 2 && held_of[k]) || (!told && !(p->noise_max_var > START_LOUD))) continue;
    tse_hypothesis *const h = &b->h[b->count++];
    if (h != first) *h = *first;
    for (int a = 0; a < 3; a++) h->noise_var[a] = r_clamp(r_mul(noise[a], noise_of[k % 3]), LEAST_NOISE_VAR, p->noise_max_var);
    if (p->inputs_held == 2) h->held = held_of[k] != held;
    h->log_weight = k ? TSE_R(-2) : TSE_R(0);
    h->kind = held_of[k] ? KIND_HOLD : KIND_RESTART;
  }
}

void bank_restart_states(const tse_params *p, tse_bank *b, const sample *y)
{
  for (int32_t i = 0; i < b->count; i++) place_states(p, &b->h[i], y);
  consider_restart(b, 0);
}

void bank_predict(const tse_params *p, tse_bank *b, course from, course to, const tse_real push[3], tse_real dt)
{
  for (int32_t i = 0; i < b->count; i++) {
    transition t;
    const int considered = p->considers && i == b->likeliest;
    if (considered) consider_begin(p, b, acting(&b->h[i], from));
    predict(p, &b->h[i], from, to, push, dt, considered ? &t : NULL);
    if (considered) consider_passage(p, b, &t, acting(&b->h[i], to), dt);
  }
}

void bank_pass(const tse_params *p, tse_bank *b, tse_real dt)
{
  for (int k = 0; k < TSE_KINDS; k++) b->waited[k] = r_min(b->waited[k] + dt, LONGEST_WAIT);
  for (int32_t i = 0; i < b->count; i++) walk(p, &b->h[i], dt);
}

void bank_mean(const tse_bank *b, int with_eps, tse_real at[6])
{
  const tse_hypothesis *const h = &b->h[b->likeliest];
  for (int a = 0; a < 3; a++) {
    at[a] = h->x[a];
    at[3 + a] = h->x[X_STIFFNESS + a] - TSE_R(1) + (with_eps && unknown_in_place_of(h, a) < 0 ? h->eps[a] : TSE_R(0));
  }
}

/* ---- merging (as in Runnalls 2007: what would be lost by it is small) ------------------------------------------------ */

static int same_regime(const tse_hypothesis *g, const tse_hypothesis *h)
{
  return g->drift == h->drift && g->fault == h->fault && g->held == h->held && g->level[0] == h->level[0] && g->level[1] == h->level[1] &&
         g->level[2] == h->level[2];
}

static int are_one(const tse_hypothesis *g, const tse_hypothesis *h)
{
  if (!same_regime(g, h)) return 0;
  for (int a = X_STIFFNESS; a < X_BIAS; a++) {
    const tse_real vg = g->cov[a][a], vh = h->cov[a][a];
    if (r_sqr(g->x[a] - h->x[a]) > r_mul(MERGE_DISTANCE, vg + vh) || vg > r_mul(MERGE_RATIO, vh) || vh > r_mul(MERGE_RATIO, vg)) return 0;
  }
  return 1;
}

/* Moments of both; what is discrete, and the statistics, are those of g, the likelier. */
static void merge(tse_hypothesis *g, const tse_hypothesis *h)
{
#if defined(TSE_REAL_FIXED) /* in which both may be 0 */
  const tse_real most = r_max(g->log_weight, h->log_weight);
#else
  const tse_real most = TSE_R(0);
#endif
  const tse_real wg = r_exp2(g->log_weight - most), wh = r_exp2(h->log_weight - most), total = wg + wh;
  if (!(total > TSE_R(0))) return;
  const tse_real share = r_div(wh, total), rest = TSE_R(1) - share, both = r_mul(share, rest);
  tse_real off[TSE_X];
  for (int i = 0; i < TSE_X; i++) off[i] = h->x[i] - g->x[i];
  for (int i = 0; i < TSE_X; i++) {
    g->x[i] += r_mul(share, off[i]);
    for (int j = 0; j < TSE_X; j++)
      g->cov[i][j] = r_mul(rest, g->cov[i][j]) + r_mul(share, h->cov[i][j]) + r_mul(both, r_mul(off[i], off[j]));
  }
  g->log_weight = most + r_log2(total);
  g->age = r_max(g->age, h->age);
}

static void drop(tse_bank *b, int32_t i)
{
  b->count--;
  if (i != b->count) b->h[i] = b->h[b->count];
  if (b->likeliest == b->count) b->likeliest = i;
}

/* One pair a row at most: with the likeliest after the time that a birth needs to show, of one kind at once. */
static void merge_pair(tse_bank *b)
{
  for (int32_t i = 0; i < b->count; i++)
    for (int32_t j = 0; j < b->count; j++) {
      const tse_hypothesis *const g = &b->h[i], *const h = &b->h[j];
      const int ripe = i == b->likeliest ? h->age >= PROTECTED_TIME : h->kind == g->kind && h->age > TSE_R(0) && g->age > h->age;
      if (i == j || j == b->likeliest || !ripe || !are_one(g, h)) continue;
      merge(&b->h[i], h);
      drop(b, j);
      return;
    }
}

/* ---- a row ----------------------------------------------------------------------------------------------------------- */

static void grow_older(tse_bank *b, tse_real dt)
{
  b->seen = r_min(b->seen + dt, LONGEST_AGE);
  for (int32_t i = 0; i < b->count; i++) {
    tse_hypothesis *const h = &b->h[i];
    h->age = r_min(h->age + dt, LONGEST_AGE);
    h->log_weight -= r_mul(LOG2_E, r_mul(rate_of_end(h), r_min(dt, DRIFT_TIME)));
    h->change_age = h->change_kind == TSE_CHANGE_NONE ? TSE_R(0) : r_min(h->change_age + dt, LONGEST_AGE);
  }
}

/* Largest weight first: 0; what is not proper is worth nothing. Returned: log2 of the sum before. */
static tse_real normalise(tse_bank *b)
{
  const int32_t was = b->likeliest;
  tse_real sum = TSE_R(0);
  b->likeliest = 0;
  for (int32_t i = 0; i < b->count; i++) {
    if (!is_proper(&b->h[i]) || !r_is_finite(b->h[i].log_weight)) {
      b->saturated += in_range(&b->h[i]) ? 0u : 1u;
      b->h[i].log_weight = IMPOSSIBLE;
    }
    if (b->h[i].log_weight > b->h[b->likeliest].log_weight) b->likeliest = i;
  }
  if (b->likeliest != was) b->h[was].age = -COME_BACK_TIME; /* it may be right after all */
  const tse_real most = b->h[b->likeliest].log_weight;
  for (int32_t i = 0; i < b->count; i++) {
    b->h[i].log_weight = r_max(b->h[i].log_weight - most, LEAST_WEIGHT);
    sum += r_exp2(b->h[i].log_weight);
  }
  return most + r_log2(sum);
}

/* However little it weighs: what is not a number would be in every mean. */
static void drop_nonsense(tse_bank *b)
{
  for (int32_t i = b->count - 1; i >= 0; i--)
    if (i != b->likeliest && !is_proper(&b->h[i])) drop(b, i); /* counted where its weight was taken, or below */
}

/* What this sample has told the likeliest about each stiffness: inverse variance, relative, a second. */
static void learn_gained(tse_bank *b, const tse_real before[3], tse_real dt)
{
  const tse_hypothesis *const h = &b->h[b->likeliest];
  const tse_real g = r_div(dt, dt + GAINED_TIME);
  for (int a = 0; a < 3; a++) {
    const tse_real var = r_max(h->cov[X_STIFFNESS + a][X_STIFFNESS + a], TSE_R(1e-10));
    const tse_real more = r_mul(r_sqr(h->x[X_STIFFNESS + a]), r_div(TSE_R(1), var) - r_div(TSE_R(1), r_max(before[a], var)));
    const tse_real gained = b->gained[a] + r_mul(g, r_div(more, dt) - b->gained[a]);
    if (r_is_finite(gained)) b->gained[a] = gained; /* a dt of almost nothing */
  }
}

/* The evidence's constants: Student-t of n channels at EVIDENCE_DOF = 8, log2 of Gamma((8+n)/2)/(Gamma(4) (8 pi)^(n/2)); and sigma. */
static tse_real log2_constant(const tse_params *p, const sample *y)
{
  static const tse_real of[4] = { TSE_R(0), TSE_R(-1.3707169830550334), TSE_R(-2.6514961294723207), TSE_R(-3.852288111085041) };
  tse_real sum = TSE_R(0);
  for (int a = 0; a < 3; a++) sum += r_mul(y->use[a], p->log_sd[a]);
  return of[y->used] - sum;
}

/* Nothing is left that makes sense. */
static void start_over(const tse_params *p, tse_bank *b, const sample *y)
{
  tse_start s;
  start_of_settings(p, &s);
  bank_start(p, b, &s, y);
  for (int32_t i = 0; i < b->count; i++) {
    b->h[i].change_kind = TSE_CHANGE_RESTART;
    for (int a = 0; a < 3; a++) b->h[i].before[a] = b->h[i].x[X_STIFFNESS + a]; /* what was before is not known any more */
  }
}

/* Hypothesis i, of a sample whose innovation is o. */
static void learn_sample(const tse_params *p, tse_bank *b, int32_t i, const sample *y, const innovation *o)
{
  tse_hypothesis *const h = &b->h[i];
  h->log_weight += log2_density(o) + evidence_of_repeat(&b->repeats, h, o);
  const int learnt = update(p, h, y, o);
  b->saturated += o->saturated || !learnt ? 1u : 0u;
}

tse_real bank_learn(const tse_params *p, tse_bank *b, const sample *y, const tse_real raw[6])
{
  /* steering may rest, and so do wheels that are locked, or all of them at constant speed */
  const tse_real *const last = b->repeats.last;
  const int32_t there[6] = { 0, r_abs(y->u.v_front) > p->hold_speed && raw[2] != last[2], r_abs(y->u.v_rear) > p->hold_speed && raw[1] != last[1],
                             y->use[0] > TSE_R(0), y->use[1] > TSE_R(0), y->use[2] > TSE_R(0) };
  innovation o; /* of one hypothesis at a time: it is large */
  tse_real before[3], was = TSE_R(0);
  watch_repeats(&b->repeats, raw, there);
  grow_older(b, y->dt);
  innovate(p, &b->h[b->likeliest], y, &o);
  births(p, b, y, &o);
  const int32_t parent = b->likeliest;
  if (p->considers) consider_sample(p, b, y, &o);
  for (int a = 0; a < 3; a++) before[a] = b->h[parent].cov[X_STIFFNESS + a][X_STIFFNESS + a];
  for (int32_t i = 0; i < b->count; i++) was += r_exp2(b->h[i].log_weight);
  learn_sample(p, b, parent, y, &o);
  for (int32_t i = 0; i < b->count; i++) {
    if (i == parent) continue;
    innovate(p, &b->h[i], y, &o);
    learn_sample(p, b, i, y, &o);
  }
  const tse_real evidence = normalise(b) - r_log2(was);
  if (!is_proper(&b->h[b->likeliest])) {
    start_over(p, b, y);
    return TSE_R(0);
  }
  if (b->likeliest == parent) learn_gained(b, before, y->dt);
  else if (b->h[b->likeliest].kind == KIND_RESTART || b->h[b->likeliest].kind == KIND_LOST)
    consider_restart(b, b->h[b->likeliest].kind == KIND_RESTART);
  drop_nonsense(b);
  merge_pair(b);
  return evidence + log2_constant(p, y);
}

/* Rows that teach drop what is not proper. Through others variances of the states could grow beyond all numbers (1e71 m2/s2 behind a
 * wild steering angle), and the next row that taught took all for lost, stiffness with it. */
void bank_mend(const tse_params *p, tse_bank *b, const sample *y)
{
  if (!is_proper(&b->h[b->likeliest])) {
    b->saturated += in_range(&b->h[b->likeliest]) ? 0u : 1u;
    place_states(p, &b->h[b->likeliest], y);
    consider_restart(b, 0);
    if (!is_proper(&b->h[b->likeliest])) start_over(p, b, y); /* it was not the states alone */
  }
  drop_nonsense(b);
}

void bank_still(tse_bank *b, const sample *y)
{
  const int c = X_BIAS + 2;
  for (int32_t i = 0; i < b->count; i++) {
    tse_hypothesis *const h = &b->h[i];
    const tse_real var = h->cov[c][c], gain = r_mul(y->use[2], r_div(var, var + TSE_R(1))), rest = TSE_R(1) - gain;
    h->x[c] += r_mul(gain, y->y[2] - h->x[c]);
    for (int a = 0; a < TSE_X; a++) h->cov[c][a] = h->cov[a][c] = r_mul(rest, h->cov[c][a]);
    h->cov[c][c] = r_mul(rest, var);
  }
}
