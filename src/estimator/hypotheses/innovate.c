/* estimator/hypotheses/innovate.c - (9), (22): forecast, innovation, its covariance. */
#include "estimator/hypotheses/innovate.h"

/* (2) knows tyres up to max_slip: beyond, stiffness is as uncertain from row to row as slip is large. Then nothing is learnt of
 * it, and the motion is what the accelerometers say, because what is uncertain is in both. */
static tse_real beyond(const tse_params *p, tse_real slip)
{
  return p->max_slip < TSE_R(1) ? r_max(r_div(r_abs(slip), p->max_slip) - TSE_R(1), TSE_R(0)) : TSE_R(0);
}

/* Slopes of the forces, column c, as those of the forecast: gain of accel_x, of accel_y per front and rear force. */
typedef struct reading { tse_real x, front, rear; } reading;

static void reading_column(reading g, const slopes *s, int c, tse_real *x, tse_real *y)
{
  *x = r_mul(g.x, s->dx[c]);
  *y = r_mul(g.front, s->dfront[c]) + r_mul(g.rear, s->drear[c]);
}

static void foretell(const tse_params *p, const tse_hypothesis *h, const sample *y, reading g, const slopes *s, innovation *o)
{
  const tse_real gyro = r_mul(y->use[2], p->inv_sd[2]);
  o->forecast[0] = r_mul(g.x, s->x);
  o->forecast[1] = r_mul(g.front, s->front) + r_mul(g.rear, s->rear);
  o->forecast[2] = r_mul(gyro, h->x[2]);
  for (int j = 0; j < 6; j++) {
    reading_column(g, s, j, &o->h[0][j], &o->h[1][j]);
    o->h[2][j] = TSE_R(0);
  }
  o->h[2][2] = gyro;
  for (int a = 0; a < 3; a++) {
#if defined(TSE_REAL_FIXED)
    o->coarser[a] = 0;
#endif
    o->use[a] = y->use[a];
    o->e[a] = r_mul(y->use[a], y->y[a] - h->x[X_BIAS + a] - h->x[X_SLOW + a]) - o->forecast[a];
    reading_column(g, s, BY_STEER + a, &o->unknown[0][a], &o->unknown[1][a]);
    o->unknown[2][a] = o->d[2][a] = TSE_R(0);
  }
  for (int a = 0; a < 3; a++) o->lag[a] = r_mul(o->unknown[a][0], y->late_steer - y->u.steer);
}

/* eps: the spread of each stiffness, wider where wheels slide, or what a fault leaves unknown; R. */
static void foretell_noise(const tse_params *p, const tse_hypothesis *h, const sample *y, const slopes *s, innovation *o)
{
  const tse_real front = beyond(p, s->s_front), rear = beyond(p, s->s_rear);
  const tse_real slide[3] = { r_max(front, rear), front, rear };
  o->slides = slide[0] > TSE_R(0);
  for (int a = 0; a < 3; a++) {
    const int unknown = unknown_in_place_of(h, a);
    o->d[0][a] = unknown < 0 ? o->h[0][3 + a] : o->unknown[0][unknown - BY_STEER];
    o->d[1][a] = unknown < 0 ? o->h[1][3 + a] : o->unknown[1][unknown - BY_STEER];
    o->eps_var[a] = unknown == BY_STEER ? r_sqr(FAULT_STEER_SD) : unknown > BY_STEER ? r_sqr(FAULT_WHEEL_SD)
                                        : r_mul(h->spread_var[a] + r_sqr(slide[a]), r_sqr(h->x[X_STIFFNESS + a]));
    o->noise[a] = y->use[a] > TSE_R(0) ? h->noise_var[a] : TSE_R(1);
    if (h->fault == FAULT_MEASURED + a) o->noise[a] = r_mul(FAULT_NOISE, o->noise[a]);
  }
}

/* accel_x goes by stiffness times slip: where both are unknown, so is their product, beyond what slopes say (second order: Jazwinski
 * 1970, 9.3). It is what a start at the wrong speed needs; afterwards it is nothing. */
static void foretell_product(const tse_hypothesis *h, innovation *o)
{
  const tse_real slope = r_div(o->h[0][0], h->x[X_STIFFNESS]);
  o->noise[0] += r_mul(r_sqr(slope), r_mul(h->cov[0][0], h->cov[X_STIFFNESS][X_STIFFNESS]));
}

/* Noise of a wheel speed is in accel_x as foretold. */
static void foretell_wheel_noise(const tse_params *p, innovation *o)
{
  o->noise[0] += r_mul(r_sqr(o->unknown[0][1]), p->wheel_var[0]) + r_mul(r_sqr(o->unknown[0][2]), p->wheel_var[1]);
}

static void covariance_with_state(const tse_hypothesis *h, innovation *o)
{
  for (int i = 0; i < TSE_X; i++) {
    const tse_real *const row = h->cov[i];
    o->ph[0][i] = r_mul(o->use[0], row[X_BIAS] + row[X_SLOW]) + r_mul(o->h[0][0], row[0]) + r_mul(o->h[0][1], row[1]) +
                  r_mul(o->h[0][2], row[2]) + r_mul(o->h[0][3], row[3]) + r_mul(o->h[0][4], row[4]) +
                  r_mul(o->lag[0], row[X_LAG]);
    o->ph[1][i] = r_mul(o->use[1], row[X_BIAS + 1] + row[X_SLOW + 1]) + r_mul(o->h[1][0], row[0]) + r_mul(o->h[1][1], row[1]) +
                  r_mul(o->h[1][2], row[2]) + r_mul(o->h[1][3], row[3]) + r_mul(o->h[1][4], row[4]) + r_mul(o->h[1][5], row[5]) +
                  r_mul(o->lag[1], row[X_LAG]);
    o->ph[2][i] = r_mul(o->use[2], row[X_BIAS + 2] + row[X_SLOW + 2]) + r_mul(o->h[2][2], row[2]);
  }
}

static void covariance(innovation *o)
{
  for (int a = 0; a < 3; a++)
    for (int b = a; b < 3; b++) {
      tse_real sum = r_mul(o->use[a], r_add_sat(o->ph[b][X_BIAS + a], o->ph[b][X_SLOW + a])) + r_mul(o->lag[a], o->ph[b][X_LAG]);
      for (int k = 0; k < 6; k++) sum += r_mul(o->h[a][k], o->ph[b][k]);
      for (int k = 0; k < 3; k++) sum += r_mul(o->eps_var[k], r_mul(o->d[a][k], o->d[b][k]));
      o->s[a][b] = o->s[b][a] = a == b ? sum + o->noise[a] : sum;
    }
}

#if defined(TSE_REAL_FIXED)
#define MOST_S TSE_R(4096)  /* its inverse has 20 digits left, and what a sample leaves of eps is known to 0.4 % of the noise */
#define MOST_COARSER 13     /* a noise of one sigma squared keeps six digits                                              */

/* Wheels that slide by 100 % leave forces unknown by 1e4 sigma: S beyond the format, or with an inverse of no digits, where the speed
 * followed tyres that push no more. So channel a is measured in coarser units, where S is small; twice, if S had left the format. */
static void fit_units(innovation *o)
{
  for (int pass = 0; pass < 2; pass++) {
    int again = 0;
    for (int a = 0; a < 3; a++) {
      const int digits = 63 - FIXED_BITS - fixed_zeros((uint64_t)r_max(o->s[a][a], (tse_real)1)); /* before the point, less one */
      const int by = o->s[a][a] > MOST_S ? (digits - 2) / 2 : 0, most = MOST_COARSER - o->coarser[a];
      const int more = by < most ? by : most;
      if (more <= 0) continue;
      again = 1;
      o->coarser[a] += more;
      for (int k = 0; k < 6; k++) o->h[a][k] = fixed_coarser(o->h[a][k], more);
      for (int k = 0; k < 3; k++) o->d[a][k] = fixed_coarser(o->d[a][k], more);
      for (int k = 0; k < 3; k++) o->unknown[a][k] = fixed_coarser(o->unknown[a][k], more);
      for (int k = 0; k < TSE_X; k++) o->ph[a][k] = fixed_coarser(o->ph[a][k], more);
      o->lag[a] = fixed_coarser(o->lag[a], more);
      o->use[a] = fixed_coarser(o->use[a], more);
      o->e[a] = fixed_coarser(o->e[a], more);
      o->noise[a] = fixed_coarser(o->noise[a], 2 * more);
    }
    if (!again) return;
    covariance(o);
  }
}

/* S = L D L': its elements are at most S and at least the noise, where a determinant would be the cube of either, and one over it
 * would have no digits left. */
static void invert(innovation *o)
{
  tse_real(*const s)[3] = o->s;
  const tse_real i0 = r_div(TSE_R(1), s[0][0]), l10 = r_div(s[0][1], s[0][0]), l20 = r_div(s[0][2], s[0][0]);
  const tse_real least = (tse_real)16, d1 = r_max(s[1][1] - r_mul(l10, s[0][1]), least), c21 = s[1][2] - r_mul(l10, s[0][2]);
  const tse_real i1 = r_div(TSE_R(1), d1), l21 = r_div(c21, d1);
  const tse_real d2 = r_max(s[2][2] - r_mul(l20, s[0][2]) - r_mul(l21, c21), least), i2 = r_div(TSE_R(1), d2);
  const tse_real m20 = r_mul(l21, l10) - l20; /* L^-1: -l10, m20, -l21 */
  o->inv[2][2] = i2;
  o->inv[1][2] = o->inv[2][1] = -r_mul(l21, i2);
  o->inv[0][2] = o->inv[2][0] = r_mul(m20, i2);
  o->inv[1][1] = i1 - r_mul(l21, o->inv[1][2]);
  o->inv[0][1] = o->inv[1][0] = -r_mul(l10, i1) - r_mul(l21, o->inv[0][2]);
  o->inv[0][0] = i0 + r_mul(r_mul(l10, l10), i1) + r_mul(m20, o->inv[0][2]);
  o->log2_det = r_log2(s[0][0]) + r_log2(d1) + r_log2(d2) + r_from_int(2 * (o->coarser[0] + o->coarser[1] + o->coarser[2]));
}
#else
/* By cofactors: well conditioned, noise on its diagonal. */
static void invert(innovation *o)
{
  tse_real(*const s)[3] = o->s;
  const tse_real c00 = r_mul(s[1][1], s[2][2]) - r_mul(s[1][2], s[1][2]);
  const tse_real c01 = r_mul(s[0][2], s[1][2]) - r_mul(s[0][1], s[2][2]);
  const tse_real c02 = r_mul(s[0][1], s[1][2]) - r_mul(s[0][2], s[1][1]);
  const tse_real det = r_mul(s[0][0], c00) + r_mul(s[0][1], c01) + r_mul(s[0][2], c02);
  const tse_real k = r_div(TSE_R(1), det);
  o->inv[0][0] = r_mul(k, c00);
  o->inv[0][1] = o->inv[1][0] = r_mul(k, c01);
  o->inv[0][2] = o->inv[2][0] = r_mul(k, c02);
  o->inv[1][1] = r_mul(k, r_mul(s[0][0], s[2][2]) - r_mul(s[0][2], s[0][2]));
  o->inv[1][2] = o->inv[2][1] = r_mul(k, r_mul(s[0][1], s[0][2]) - r_mul(s[0][0], s[1][2]));
  o->inv[2][2] = r_mul(k, r_mul(s[0][0], s[1][1]) - r_mul(s[0][1], s[0][1]));
  o->log2_det = r_log2(r_max(det, TSE_R(1e-12)));
}
#endif

/* Inverse of S, its determinant, and what follows from them. */
static void solve(innovation *o)
{
  o->saturated = 0;
  covariance(o);
#if defined(TSE_REAL_FIXED) /* in which S is no infinity, and nothing that follows from it NaN */
  for (int a = 0; a < 3; a++) {
    o->saturated = o->saturated || !r_is_finite(o->e[a]);
    for (int i = 0; i < TSE_X; i++) o->saturated = o->saturated || !r_is_finite(o->ph[a][i]);
  }
  fit_units(o);
  for (int a = 0; a < 3; a++) o->saturated = o->saturated || !r_is_finite(o->s[a][a]);
#endif
  invert(o);
  o->m2 = TSE_R(0);
  for (int a = 0; a < 3; a++) {
    o->se[a] = r_mul(o->inv[a][0], o->e[0]) + r_mul(o->inv[a][1], o->e[1]) + r_mul(o->inv[a][2], o->e[2]);
    o->m2 += r_mul(o->e[a], o->se[a]);
  }
  o->m2 = r_max(o->m2, TSE_R(0));
}

void innovate(const tse_params *p, const tse_hypothesis *h, const sample *y, innovation *o)
{
  const tse_real iy = r_mul(y->use[1], p->inv_sd[1]);
  const reading g = { r_mul(r_mul(y->use[0], p->inv_sd[0]), p->read_x), r_mul(iy, p->read_y_front), r_mul(iy, p->read_y_rear) };
  slopes s;
  const course c = { y->u, y->late_steer };
  vehicle_slopes(p, h->x, acting(h, c), slips_for_slopes(p, h), &s);
  foretell(p, h, y, g, &s, o);
  foretell_noise(p, h, y, &s, o);
  foretell_product(h, o);
  if (p->wheel_var[0] > TSE_R(0)) foretell_wheel_noise(p, o);
  covariance_with_state(h, o);
  solve(o);
  o->half_dof = r_mul(TSE_R(0.5), EVIDENCE_DOF + r_from_int(y->used));
}
