/* src/consistency.c - is a sample as likely as it should be, and what to do when it is not (marginalised form).
 *
 * Per channel, with z the innovation of the weighted mean and S its variance as the filter believes it:
 *   stuck          repeats its last bit and is off by more than one sigma: taken as missing
 *   outlier        |z| beyond outlier_gate sqrt(S): its noise is taken as what brings it back there, so that it pulls the
 *                  less the further off it is
 *   noise          z^2 larger, for long, than even the widest spread explains: the sensor is noisier than told. Spread and
 *                  noise cannot be told apart while a force is constant, so the settings are believed until they cannot be
 *   colour         z smoothed over SMOOTH_TIME varies more than that of white noise: what disturbs is slow (road, pitch), and
 *                  a hundred samples of it are not a hundred pieces of evidence
 *   contradiction  smoothed z far from zero: stiffness has changed, or an input lies. The means are opened and learnt anew
 *                  for TRY_TIME; if they then explain the samples, it was the road; if not, what was believed before comes
 *                  back and is held until the contradiction ends. */
#include "stages.h"

#define NOISE_TIME TSE_R(5)       /* s: running means of squared innovations                              */
#define COLOUR_TIME TSE_R(10)     /* s                                                                    */
#define SMOOTH_TIME TSE_R(0.15)   /* s: long against a sample, short against a manoeuvre                  */
#define CONTRADICTED_TIME TSE_R(0.1) /* s: share of recent samples that contradict                        */
#define MOST_2 TSE_R(20.25)       /* z^2/S counts up to 4.5 sigma in the noise                            */
#define MOST_SMOOTH TSE_R(3)      /* z/sqrt(S) counts up to 3 sigma in the smoothed one: outliers are not a contradiction */
#define MOST_COLOUR TSE_R(25)     /* ... and up to 5 sigma in the colour                                  */
#define LOUD TSE_R(1.25)          /* z^2 over the widest spread's variance, plus 4 sigma of its mean      */
#define LEAST_SURPLUS TSE_R(1.2)  /* variance over told below which the settings are right                */
#define VERY_LOUD TSE_R(2)        /* ... beyond which all that was learnt was learnt wrongly              */
#define FEWEST_SAMPLES TSE_R(20)
#define TYPICAL_VAR TSE_R(0.0025) /* spread of 5 %, squared: what remains of it when noise explains the rest */
#define TRY_TIME TSE_R(1.5)       /* s                                                                    */
#define HOLD_TIME TSE_R(5)        /* s: then another try                                                  */
#define SAVE_TIME TSE_R(0.5)      /* s: the older of two memories is at least as old                      */
#define COMMON_VAR TSE_R(0.16)    /* a new road changes all stiffnesses together by 40 % ...              */
#define OWN_VAR TSE_R(0.01)       /* ... and each by 10 % of its own                                      */

enum { LEARN, TRY, HOLD };

void consistency_start(tse_filter *f)
{
  for (int a = 0; a < 3; a++) {
    f->noise[a] = f->misfit[a] = f->surprise[a] = f->colour[a] = TSE_R(1);
    f->foreseen[a] = f->smooth[a] = f->shows[a] = TSE_R(0);
  }
  f->fit_for = f->contradicted = f->stance_for = f->saved_for = TSE_R(0);
  f->stance = LEARN;
  f->saves = 0;
}

int is_trying(const tse_filter *f) { return f->stance != LEARN; }
int is_holding(const tse_filter *f) { return f->stance == HOLD; }

/* --- what was believed, and its return ---------------------------------------------------------------------------- */

static void remember(const tse_params *p, tse_filter *f)
{
  tse_memory m;
  const tse_particles *const q = &f->p;
  const tse_real *const rows[12] = { q->mu[0], q->mu[1], q->mu[2], q->bias[0], q->bias[1], q->bias[2],
                                     q->lam[0], q->lam[1], q->lam[2], q->lam[3], q->lam[4], q->lam[5] };
  tse_real mean[12];
  weighted_means(p, f, rows, 12, mean);
  for (int a = 0; a < 6; a++) {
    m.mean[a] = mean[a];
    m.lam[a] = mean[6 + a];
    for (int b = 0; b < 6; b++) {
      m.cov[a][b] = f->cov[3 + a][3 + b];
      m.err[a][b] = f->err[3 + a][3 + b];
    }
  }
  f->saved[1] = f->saves ? f->saved[0] : m; /* the first fills both places */
  f->saved[0] = m;
  f->saves = 1;
  f->saved_for = TSE_R(0);
}

static void shift_mean(const tse_params *p, tse_filter *f, tse_real *row, tse_real to)
{
  const tse_real *const rows[1] = { row };
  tse_real mean;
  weighted_means(p, f, rows, 1, &mean);
  for (int32_t i = 0; i < padded(p->particles); i++) row[i] += to - mean;
}

static void recall(const tse_params *p, tse_filter *f)
{
  const tse_memory *const m = &f->saved[1];
  for (int a = 0; a < 3; a++) {
    shift_mean(p, f, f->p.mu[a], m->mean[a]);
    shift_mean(p, f, f->p.bias[a], m->mean[3 + a]);
    f->level[a] = TSE_R(1) + m->mean[a];
  }
  gaussian_clear(f, 3, TSE_GAUSS - 1);
  for (int a = 0; a < 6; a++)
    for (int b = 0; b < 6; b++) {
      f->cov[3 + a][3 + b] = m->cov[a][b];
      f->err[3 + a][3 + b] = m->err[a][b];
    }
  for (int a = 0; a < 3; a++) f->mean_var[a] = f->cov[3 + a][3 + a];
  for (int k = 0; k < 6; k++)
    for (int32_t i = 0; i < padded(p->particles); i++) f->p.lam[k][i] = m->lam[k];
}

/* What was known about the means is doubted, and where the car is, because it was foretold with them. */
static void open_means(const tse_params *p, tse_filter *f)
{
  for (int a = 0; a < 3; a++)
    for (int b = 0; b < 3; b++) {
      const tse_real more = r_mul(r_mul(f->level[a], f->level[b]), a == b ? COMMON_VAR + OWN_VAR : COMMON_VAR);
      f->cov[3 + a][3 + b] += more;
      f->err[3 + a][3 + b] += more;
    }
  for (int a = 0; a < 3; a++) {
    const tse_real more = r_mul(p->x_sd0[a], p->x_sd0[a]);
    f->cov[a][a] += more;
    f->err[a][a] += more;
    f->mean_var[a] = f->cov[3 + a][3 + a];
  }
}

static void stand(tse_filter *f, int32_t stance)
{
  f->stance = stance;
  f->stance_for = TSE_R(0);
}

/* Learn, try anew or hold. Returned: 1 when means or covariance have changed. */
static int take_stance(const tse_params *p, tse_filter *f, int contradicted, tse_real dt)
{
  f->stance_for += dt;
  f->saved_for += dt;
  switch (f->stance) {
    case LEARN:
      if (contradicted && f->seen > p->memory && f->saves) { /* else there is nothing to return to */
        open_means(p, f);
        stand(f, TRY);
        return 1;
      }
      if (f->saved_for >= SAVE_TIME) remember(p, f);
      return 0;
    case TRY:
      if (f->stance_for <= TRY_TIME) return 0;
      if (f->contradicted < TSE_R(0.2)) {
        stand(f, LEARN);
        f->saved_for = TSE_R(0);
        return 0;
      }
      recall(p, f);
      stand(f, HOLD);
      return 1;
    default:
      if (f->contradicted < TSE_R(0.05)) stand(f, LEARN);
      else if (f->stance_for > HOLD_TIME) {
        open_means(p, f);
        stand(f, TRY);
        return 1;
      }
      return 0;
  }
}

/* --- noise -------------------------------------------------------------------------------------------------------- */

tse_real slow_factor(const tse_filter *f, int channel) { return r_max(TSE_R(1), f->colour[channel] - TSE_R(1)); }

/* The sensors are much noisier than told: the spread has been learnt from noise, everything else with too much trust. */
static void start_doubting(const tse_params *p, tse_filter *f)
{
  static const int axis[6] = { 0, -1, -1, 1, -1, 2 };
  const tse_real lam = r_mul(TYPICAL_VAR, r_div(f->nu - TSE_R(4), f->nu));
  for (int k = 0; k < 6; k++) {
    const tse_real level = axis[k] < 0 ? TSE_R(0) : f->level[axis[k]];
    for (int32_t i = 0; i < padded(p->particles); i++) f->p.lam[k][i] = r_mul(lam, r_mul(level, level));
  }
  gaussian_start(p, f);
}

/* Running means of z^2, and of what it should be at a typical spread (foreseen, less the noise) and at the widest.
 * Returned: 1 when the noise has just been found to be much more than told. */
static int learn_noise(const tse_params *p, tse_filter *f, int a, tse_real z2, tse_real told, tse_real typical, tse_real widest, tse_real dt)
{
  const tse_real time = r_min(f->fit_for, NOISE_TIME);
  const tse_real gain = r_div(dt, time + r_mul(TSE_R(10), p->sample_time)), samples = r_mul(time, p->inv_sample_time);
  f->misfit[a] += r_mul(gain, r_div(z2, f->noise[a] + told + widest) - f->misfit[a]);
  f->surprise[a] += r_mul(gain, z2 - f->surprise[a]);
  f->foreseen[a] += r_mul(gain, told + typical - f->foreseen[a]);
  const tse_real found = r_min(f->surprise[a] - f->foreseen[a], p->noise_max_var);
  const tse_real enough = found > LEAST_SURPLUS ? found : TSE_R(1);
  if (f->noise[a] > TSE_R(1)) {
    f->noise[a] = enough;
  } else if (samples > FEWEST_SAMPLES && f->misfit[a] > LOUD + r_div(TSE_R(4), r_sqrt(samples)) && enough > TSE_R(1)) {
    f->noise[a] = enough;
    f->misfit[a] = TSE_R(1);
    return found > VERY_LOUD;
  }
  return 0;
}

/* --- spread ------------------------------------------------------------------------------------------------------- */

/* z^2 of one sample tells Sigma with the variance 2 (S/d^2)^2. A spread is seen when it is 1.5 sd of n such samples from zero:
 *   Sigma > 1.5 sqrt(2/n)/rms(d^2/S),   n: five memories, because most of each sample's z is noise */
int spread_is_seen(const tse_filter *f, int a, tse_real spread)
{
  return r_mul(r_mul(spread, spread), r_sqrt(r_mul(f->shows[a], f->seen))) > TSE_R(1.5 * 1.4142135623730951);
}

static void learn_shows(tse_filter *f, int a, tse_real d, tse_real s)
{
  const tse_real told = r_div(r_mul(d, d), s);
  f->shows[a] += r_mul(r_div(TSE_R(1), f->seen + TSE_R(1)), r_mul(told, told) - f->shows[a]);
}

/* ------------------------------------------------------------------------------------------------------------------- */

int consistency(const tse_params *p, tse_filter *f, sample *y, const forecast *c, tse_real noise[3])
{
  const tse_real d[3][3] = { { c->o.d11, c->o.d12, TSE_R(0) }, { c->o.d21, c->o.d22, c->o.d23 }, { TSE_R(0), TSE_R(0), TSE_R(0) } };
  const tse_real g = r_div(y->dt, y->dt + SMOOTH_TIME), white_share = r_div(g, TSE_R(2) - g);
  const int calm = f->stance == LEARN && f->contradicted < TSE_R(0.3);
  int changed = 0, very_loud = 0;
  tse_real off = TSE_R(0);

  f->fit_for = r_min(f->fit_for + y->dt, COLOUR_TIME);
  for (int a = 0; a < 3; a++)
    if (!(f->level[a] > TSE_R(0))) f->level[a] = c->level[a];
  for (int a = 0; a < 3; a++) {
    noise[a] = TSE_R(1);
    if (!(y->use[a] > TSE_R(0))) continue;
    const tse_real told = a == 0 ? c->input_var : TSE_R(0), white = f->noise[a] + told;
    const tse_real s = white + c->hph[a][a] + c->spread[a][a], z2 = r_mul(c->z[a], c->z[a]);
    if (f->stuck[a] && z2 > s) {
      y->use[a] = y->y[a] = TSE_R(0);
      y->used--;
      changed = 1;
      continue;
    }
    noise[a] = r_mul(white, slow_factor(f, a));
    if (p->gate_var > TSE_R(0) && z2 > r_mul(p->gate_var, s)) noise[a] = r_max(noise[a], white + r_div(z2, p->gate_var) - s);

    const tse_real most = r_mul(MOST_SMOOTH, r_sqrt(s));
    f->smooth[a] += r_mul(g, r_clamp(c->z[a], -most, most) - f->smooth[a]);
    const tse_real ratio = r_div(r_mul(f->smooth[a], f->smooth[a]), r_mul(white_share, white + c->spread[a][a]) + c->hph[a][a]);
    off += r_div(ratio, r_max(f->colour[a], r_max(f->misfit[a], TSE_R(1))));
    if (a < 2) learn_shows(f, a, d[a][a], s);
    if (a == 1) learn_shows(f, 2, d[1][2], s);
    if (!calm || !(p->noise_max_var > TSE_R(1))) continue;

    tse_real force = TSE_R(0); /* variance of a spread of one: it is a share of the mean */
    for (int b = 0; b < 3; b++) force += r_mul(r_mul(f->level[b], f->level[b]), r_mul(d[a][b], d[a][b]));
    f->colour[a] += r_mul(r_div(y->dt, f->fit_for + TSE_R(2)), r_min(ratio, MOST_COLOUR) - f->colour[a]);
    if (learn_noise(p, f, a, r_min(z2, r_mul(MOST_2, s)), told, c->hph[a][a] + r_mul(TYPICAL_VAR, force),
                    c->hph[a][a] + r_max(c->spread[a][a], r_mul(p->spread_max_var, force)), y->dt))
      very_loud = 1;
  }
  if (very_loud) {
    start_doubting(p, f);
    changed = 1;
  }
  const int contradicted = p->contradiction_var > TSE_R(0) && off > p->contradiction_var;
  f->contradicted += r_mul(r_div(y->dt, y->dt + CONTRADICTED_TIME), (contradicted ? TSE_R(1) : TSE_R(0)) - f->contradicted);
  return take_stance(p, f, contradicted, y->dt) || changed;
}
