/* src/error.c - how far off the mean of all particles may be (marginalised form).
 *
 * What the particles do together to their mean is a linear filter with the gain K = P H' S^-1, S = H P H' + R + d Sigma d'.
 * Forgetting keeps P, and with it K, larger than a constant stiffness asks for: P says how fast to follow, not how far off
 * the mean is (for one constant and memory 1/(1 - lambda): half of P). The error of this filter, for constant means and with
 * eps beside X, has the covariance
 *     E+ = (1 - K H) E (1 - K H)' + K R K',  then  E = A E A',    E's rows: states, means, biases, eps of this sample
 * without forgetting. Its diagonal is what the outputs give as the sd of a mean. */
#include "stages.h"

static void clear_eps(tse_real E[TSE_ERROR][TSE_ERROR])
{
  for (int a = TSE_GAUSS; a < TSE_ERROR; a++)
    for (int b = 0; b < TSE_ERROR; b++) E[a][b] = E[b][a] = TSE_R(0);
}

/* A = [Fx Fw 0 Fw; 0 1 0 0; 0 0 1 0]: what w = mu + eps does to the state; the next eps is another one. */
void error_predict(tse_filter *f, tse_real jac[3][6])
{
  tse_real(*const E)[TSE_ERROR] = f->err;
  tse_real row[3][TSE_ERROR];
  for (int a = 0; a < 3; a++)
    for (int b = 0; b < TSE_ERROR; b++) {
      row[a][b] = TSE_R(0);
      for (int k = 0; k < 6; k++) row[a][b] += r_mul(jac[a][k], E[k][b]);
      for (int k = 0; k < 3; k++) row[a][b] += r_mul(jac[a][3 + k], E[TSE_GAUSS + k][b]);
    }
  for (int a = 0; a < 3; a++)
    for (int b = a; b < 3; b++) {
      tse_real sum = TSE_R(0);
      for (int k = 0; k < 6; k++) sum += r_mul(row[a][k], jac[b][k]);
      for (int k = 0; k < 3; k++) sum += r_mul(row[a][TSE_GAUSS + k], jac[b][3 + k]);
      E[a][b] = E[b][a] = a == b ? r_max(sum, STATE_VAR) : sum; /* no denormal numbers */
    }
  for (int a = 0; a < 3; a++)
    for (int b = 3; b < TSE_GAUSS; b++) E[a][b] = E[b][a] = row[a][b];
  clear_eps(E);
}

/* Inverse of a symmetric 3x3 by cofactors; well conditioned: noise on the diagonal. */
static void invert(tse_real s[3][3], tse_real inv[3][3])
{
  const tse_real c00 = r_mul(s[1][1], s[2][2]) - r_mul(s[1][2], s[1][2]);
  const tse_real c01 = r_mul(s[0][2], s[1][2]) - r_mul(s[0][1], s[2][2]);
  const tse_real c02 = r_mul(s[0][1], s[1][2]) - r_mul(s[0][2], s[1][1]);
  const tse_real k = r_div(TSE_R(1), r_mul(s[0][0], c00) + r_mul(s[0][1], c01) + r_mul(s[0][2], c02));
  inv[0][0] = r_mul(k, c00);
  inv[0][1] = inv[1][0] = r_mul(k, c01);
  inv[0][2] = inv[2][0] = r_mul(k, c02);
  inv[1][1] = r_mul(k, r_mul(s[0][0], s[2][2]) - r_mul(s[0][2], s[0][2]));
  inv[1][2] = inv[2][1] = r_mul(k, r_mul(s[0][1], s[0][2]) - r_mul(s[0][0], s[1][2]));
  inv[2][2] = r_mul(k, r_mul(s[0][0], s[1][1]) - r_mul(s[0][1], s[0][1]));
}

void error_update(tse_filter *f, const forecast *c, const tse_real noise[3])
{
  tse_real(*const E)[TSE_ERROR] = f->err;
  tse_real s[3][3], inv[3][3], H[3][TSE_ERROR], K[TSE_ERROR][3], HE[3][TSE_ERROR], M[3][3];

  clear_eps(E);
  for (int a = 0; a < 3; a++)
    for (int b = 0; b < 3; b++) {
      E[TSE_GAUSS + a][TSE_GAUSS + b] = c->sigma[a][b];
      s[a][b] = c->hph[a][b] + c->spread[a][b] + (a == b ? noise[a] : TSE_R(0));
    }
  invert(s, inv);
  for (int b = 0; b < 3; b++) {
    for (int a = 0; a < TSE_GAUSS; a++) {
      H[b][a] = c->h[b][a];
      K[a][b] = r_mul(c->ph[a][0], inv[0][b]) + r_mul(c->ph[a][1], inv[1][b]) + r_mul(c->ph[a][2], inv[2][b]);
    }
    for (int a = 0; a < 3; a++) { /* y shows eps as it shows mu */
      H[b][TSE_GAUSS + a] = c->h[b][3 + a];
      K[TSE_GAUSS + a][b] = r_mul(c->sigma_d[a][0], inv[0][b]) + r_mul(c->sigma_d[a][1], inv[1][b]) + r_mul(c->sigma_d[a][2], inv[2][b]);
    }
  }
  for (int a = 0; a < 3; a++)
    for (int b = 0; b < TSE_ERROR; b++) {
      HE[a][b] = TSE_R(0);
      for (int i = 0; i < TSE_ERROR; i++) HE[a][b] += r_mul(H[a][i], E[i][b]);
    }
  for (int a = 0; a < 3; a++)
    for (int b = 0; b < 3; b++) {
      M[a][b] = a == b ? noise[a] : TSE_R(0);
      for (int i = 0; i < TSE_ERROR; i++) M[a][b] += r_mul(HE[a][i], H[b][i]);
    }
  for (int a = 0; a < TSE_ERROR; a++)
    for (int b = a; b < TSE_ERROR; b++) {
      tse_real e = E[a][b];
      for (int i = 0; i < 3; i++) {
        e = e - r_mul(K[a][i], HE[i][b]) - r_mul(HE[i][a], K[b][i]);
        for (int j = 0; j < 3; j++) e += r_mul(r_mul(K[a][i], M[i][j]), K[b][j]);
      }
      E[a][b] = E[b][a] = a == b ? r_max(e, TSE_R(0)) : e;
    }

  tse_real sum = TSE_R(0);
  for (int a = 0; a < TSE_ERROR; a++)
    for (int b = 0; b < TSE_ERROR; b++) sum += r_abs(E[a][b]);
  if (r_is_finite(sum)) return;
  clear_eps(E); /* S overflows in float where settings are extreme: then what the gain's covariance says */
  for (int a = 0; a < TSE_GAUSS; a++)
    for (int b = 0; b < TSE_GAUSS; b++) E[a][b] = f->cov[a][b];
}
