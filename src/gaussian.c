/* src/gaussian.c - what is Gaussian given a particle's path, and its covariance, common to all particles.
 *
 * In the paper that is the three sensor biases, (18) and (19). Marginalised, it is also the state and the mean stiffness:
 *     X = (x, mu, b),   x+ = f(x, mu + eps),   y = h(x) + d(x)(mu + eps) + b + e
 * where eps = w - mu is what a particle draws. Given its eps, X is the business of a Kalman filter; linearised at the
 * weighted mean, the covariance is the same for every particle, and only means are carried by each. The paper's form is
 * the special case in which the first six rows of the covariance are zero. */
#include "stages.h"

#define NU_LEAST TSE_R(6)     /* A and Sigma need nu > 4; reached only with a short memory and long time steps */
#define STEP TSE_R(0.0078125) /* 2^-7: differences for the linearisation, of states [m/s, rad/s] and of w [1]  */
#define PER_STEP TSE_R(64)    /* 1/(2 STEP)                                                                    */
#define UNDO_VAR TSE_R(0.01)  /* sd of 10 % of the mean: known well enough to undo the noise of the wheel speeds    */
#define MOST_VAR TSE_R(400)   /* 20 m/s squared: linear no more, the states start over                            */

static int first_row(const tse_params *p) { return p->marginalised ? 0 : 6; }

void gaussian_clear(tse_filter *f, int first, int last)
{
  for (int a = first; a <= last; a++) {
    for (int b = 0; b < TSE_GAUSS; b++) f->cov[a][b] = f->cov[b][a] = TSE_R(0);
    for (int b = 0; b < TSE_ERROR; b++) f->err[a][b] = f->err[b][a] = TSE_R(0);
  }
}

static void set_variance(tse_filter *f, int a, tse_real var) { f->cov[a][a] = f->err[a][a] = var; }

void gaussian_restart_states(const tse_params *p, tse_filter *f)
{
  gaussian_clear(f, 0, 2);
  if (p->marginalised)
    for (int a = 0; a < 3; a++) set_variance(f, a, r_mul(p->x_sd0[a], p->x_sd0[a]));
}

void gaussian_restart_means(const tse_params *p, tse_filter *f)
{
  gaussian_clear(f, 3, 5);
  if (p->marginalised)
    for (int a = 0; a < 3; a++) {
      set_variance(f, 3 + a, p->mean_var0);
      f->mean_var[a] = p->mean_var0;
    }
  for (int a = 0; a < 3; a++) f->level[a] = TSE_R(0); /* not known yet */
}

void gaussian_start(const tse_params *p, tse_filter *f)
{
  gaussian_clear(f, 0, TSE_GAUSS - 1);
  gaussian_restart_states(p, f);
  gaussian_restart_means(p, f);
  for (int a = 0; a < 3; a++) set_variance(f, 6 + a, p->bias_var0[a]);
}

/* x+ - x- over 2 STEP, by central differences of (7) at the mean, in the components of x (0..2) and w (3..5). */
static void linearise_motion(const tse_params *p, const tse_real at[6], inputs from, inputs to, tse_real dt, tse_real jac[3][6])
{
  for (int b = 0; b < 6; b++) {
    tse_real hi[6], lo[6];
    for (int a = 0; a < 6; a++) hi[a] = lo[a] = at[a];
    hi[b] = hi[b] + STEP;
    lo[b] = lo[b] - STEP;
    vehicle_advance(p, hi, vehicle_stiffness(p, hi[3], hi[4], hi[5]), from, to, dt);
    vehicle_advance(p, lo, vehicle_stiffness(p, lo[3], lo[4], lo[5]), from, to, dt);
    for (int a = 0; a < 3; a++) jac[a][b] = r_mul(PER_STEP, hi[a] - lo[a]);
  }
}

/* P = A P A' with A = [Fx Fw 0; 0 1 0; 0 0 1]: rows, then columns. */
static void carry(tse_real jac[3][6], tse_real P[TSE_GAUSS][TSE_GAUSS])
{
  tse_real row[3][TSE_GAUSS];
  for (int a = 0; a < 3; a++)
    for (int b = 0; b < TSE_GAUSS; b++) {
      row[a][b] = TSE_R(0);
      for (int k = 0; k < 6; k++) row[a][b] += r_mul(jac[a][k], P[k][b]);
    }
  for (int a = 0; a < 3; a++)
    for (int b = 3; b < TSE_GAUSS; b++) P[a][b] = P[b][a] = row[a][b];
  for (int a = 0; a < 3; a++)
    for (int b = a; b < 3; b++) {
      tse_real sum = TSE_R(0);
      for (int k = 0; k < 6; k++) sum += r_mul(row[a][k], jac[b][k]);
      P[a][b] = P[b][a] = a == b ? r_max(sum, STATE_VAR) : sum; /* rounding; and no denormal numbers */
    }
}

/* Variance that noise of the wheel speeds adds to vel_x in one row, because they drive (7). */
static tse_real shaken_by_wheels(const tse_params *p, const tse_real at[6], inputs u, tse_real dt)
{
  const slips s = vehicle_slips(p, at[0], at[1], at[2], u);
  const stiffness k = vehicle_stiffness(p, at[3], at[4], at[5]);
  const tse_real front = r_mul(dt, r_mul(k.x_front, s.inv_front)), rear = r_mul(dt, r_mul(k.x_rear, s.inv_rear));
  return r_mul(r_mul(front, front), p->wheel_var[0]) + r_mul(r_mul(rear, rear), p->wheel_var[1]);
}

void gaussian_predict(const tse_params *p, tse_filter *f, inputs to, tse_real dt)
{
  if (!p->marginalised) return;
  const inputs from = { f->steer, f->v_front, f->v_rear };
  tse_real at[6], jac[3][6];
  const tse_real *const rows[6] = { f->p.x[0], f->p.x[1], f->p.x[2], f->p.w[0], f->p.w[1], f->p.w[2] };
  weighted_means(p, f, rows, 6, at);
  linearise_motion(p, at, from, to, dt, jac);
  for (int a = 0; a < 3; a++)
    for (int k = 0; k < 6; k++)
      if (!r_is_finite(jac[a][k])) { /* a broken particle: the states start over, the rest stays */
        gaussian_restart_states(p, f);
        return;
      }
  carry(jac, f->cov);
  error_predict(f, jac);
  const tse_real shaken = shaken_by_wheels(p, at, to, dt);
  f->cov[0][0] += shaken;
  f->err[0][0] += shaken;
  for (int a = 0; a < 3; a++)
    if (!(f->cov[a][a] <= MOST_VAR)) {
      gaussian_restart_states(p, f);
      return;
    }
}

/* (18) P += Q dt, up to the variance that the biases started with or one sigma, whichever is larger. */
void bias_predict(const tse_params *p, tse_filter *f, tse_real dt)
{
  for (int a = 6; a < TSE_GAUSS; a++) {
    const tse_real walk = r_mul(p->bias_walk[a - 6], dt), most = r_max(p->bias_var0[a - 6], TSE_R(1));
    f->cov[a][a] = r_min(f->cov[a][a] + walk, most);
    f->err[a][a] = r_max(f->err[a][a], r_min(f->err[a][a] + walk, most)); /* an update may have left it larger */
  }
}

/* Foretold measurements at the mean x and mu, in sigma, without biases: h + d mu, and the third row: the yaw rate. */
static void foretell(const tse_params *p, const observation_gains *g, const sample *y, const tse_real at[6], tse_real out[3],
                     observation *o)
{
  *o = vehicle_observation(*g, vehicle_slips(p, at[0], at[1], at[2], y->u), y->u.steer);
  out[0] = o->h1 + r_mul(o->d11, at[3]) + r_mul(o->d12, at[4]);
  out[1] = o->h2 + r_mul(o->d21, at[3]) + r_mul(o->d22, at[4]) + r_mul(o->d23, at[5]);
  out[2] = r_mul(y->use[2], r_mul(at[2], p->inv_sd[2]));
}

/* d Sigma d' and its halves, with the mean of the particles' Sigma = Lambda/(nu - 4). */
static void foretell_spread(const tse_params *p, const tse_filter *f, forecast *c)
{
  const tse_real *const rows[6] = { f->p.lam[0], f->p.lam[1], f->p.lam[2], f->p.lam[3], f->p.lam[4], f->p.lam[5] };
  static const int of[3][3] = { { 0, 1, 2 }, { 1, 3, 4 }, { 2, 4, 5 } };
  const tse_real inv = r_div(f->nu, f->nu - TSE_R(4));
  tse_real lam[6];
  weighted_means(p, f, rows, 6, lam);
  for (int a = 0; a < 3; a++)
    for (int b = 0; b < 3; b++) c->sigma[a][b] = r_mul(inv, lam[of[a][b]]);
  for (int a = 0; a < 3; a++)
    for (int b = 0; b < 3; b++) {
      c->sigma_d[a][b] = TSE_R(0);
      for (int k = 0; k < 3; k++) c->sigma_d[a][b] += r_mul(c->sigma[a][k], c->h[b][3 + k]);
    }
  for (int a = 0; a < 3; a++)
    for (int b = 0; b < 3; b++) {
      c->spread[a][b] = TSE_R(0);
      for (int k = 0; k < 3; k++) c->spread[a][b] += r_mul(c->h[a][3 + k], c->sigma_d[k][b]);
    }
}

/* Noise n of a wheel speed R omega is in accel_x as foretold (slope t) and in its derivative by mu (slope u):
 * variance t^2 var n, mean of the product of both t u var n, of the square of the derivative u^2 var n. */
static void foretell_wheel_noise(const tse_params *p, const observation_gains *g, const sample *y, const tse_real at[6], forecast *c)
{
  const slips s = vehicle_slips(p, at[0], at[1], at[2], y->u);
  const tse_real u_front = r_mul(g->xf1, s.inv_front), u_rear = r_mul(g->xr1_follow, s.inv_rear);
  const tse_real t_front = r_mul(u_front, TSE_R(1) + at[3]), t_rear = r_mul(g->xr1, s.inv_rear) + r_mul(u_rear, at[3]);
  c->input_var = r_mul(r_mul(t_front, t_front), p->wheel_var[0]) + r_mul(r_mul(t_rear, t_rear), p->wheel_var[1]);
  c->pull = r_mul(r_mul(t_front, u_front), p->wheel_var[0]) + r_mul(r_mul(t_rear, u_rear), p->wheel_var[1]);
  c->excess = r_mul(r_mul(u_front, u_front), p->wheel_var[0]) + r_mul(r_mul(u_rear, u_rear), p->wheel_var[1]);
}

void gaussian_foretell(const tse_params *p, const tse_filter *f, const sample *y, forecast *c)
{
  const observation_gains gains = vehicle_observation_gains(p, y->use[0], y->use[1]);
  tse_real at[6], foretold[3], bias[3];
  tse_real(*const H)[TSE_GAUSS] = c->h;
  observation o, unused;

  for (int a = 0; a < 3; a++)
    for (int b = 0; b < TSE_GAUSS; b++) H[a][b] = TSE_R(0);
  if (p->marginalised) {
    const tse_real *const rows[6] = { f->p.x[0], f->p.x[1], f->p.x[2], f->p.mu[0], f->p.mu[1], f->p.mu[2] };
    weighted_means(p, f, rows, 6, at);
    foretell(p, &gains, y, at, foretold, &o);
    for (int b = 0; b < 3; b++) {
      tse_real hi[3], lo[3];
      const tse_real was = at[b];
      at[b] = was + STEP;
      foretell(p, &gains, y, at, hi, &unused);
      at[b] = was - STEP;
      foretell(p, &gains, y, at, lo, &unused);
      at[b] = was;
      for (int a = 0; a < 3; a++) H[a][b] = r_mul(PER_STEP, hi[a] - lo[a]);
    }
    H[0][3] = o.d11;
    H[0][4] = o.d12;
    H[1][3] = o.d21;
    H[1][4] = o.d22;
    H[1][5] = o.d23;
    const tse_real *const biases[3] = { f->p.bias[0], f->p.bias[1], f->p.bias[2] };
    weighted_means(p, f, biases, 3, bias);
    for (int a = 0; a < 3; a++) c->z[a] = r_mul(y->use[a], y->y[a] - foretold[a] - bias[a]);
    c->o = o;
    for (int a = 0; a < 3; a++) c->level[a] = TSE_R(1) + at[3 + a];
    foretell_spread(p, f, c);
    foretell_wheel_noise(p, &gains, y, at, c);
  }
  for (int a = 0; a < 3; a++) H[a][6 + a] = y->use[a];

  /* H P H'; a missing channel's row of H is zero */
  const int first = first_row(p); /* rows before it are zero, and so is all that comes of them */
  for (int a = 0; a < TSE_GAUSS; a++)
    for (int b = 0; b < 3; b++) {
      c->ph[a][b] = TSE_R(0);
      for (int k = first; k < TSE_GAUSS && a >= first; k++) c->ph[a][b] += r_mul(f->cov[a][k], H[b][k]);
    }
  for (int a = 0; a < 3; a++)
    for (int b = 0; b < 3; b++) {
      c->hph[a][b] = TSE_R(0);
      for (int k = first; k < TSE_GAUSS; k++) c->hph[a][b] += r_mul(H[a][k], c->ph[k][b]);
    }
}

/* C = H P H' + R = L L' with R = diag(noise), at least one sigma^2; g->l = L^-1, g->gain = P H' L'^-1. */
int gaussian_observe(const forecast *f, const tse_real noise[3], gaussian *g)
{
  tse_real c[3][3];
  for (int a = 0; a < 3; a++)
    for (int b = 0; b < 3; b++) c[a][b] = a == b ? f->hph[a][b] + noise[a] : f->hph[a][b];
  /* no pivot is below R but for rounding */
  const tse_real l11 = r_sqrt(c[0][0]), i11 = r_div(TSE_R(1), l11);
  const tse_real l21 = r_mul(c[1][0], i11), l31 = r_mul(c[2][0], i11);
  const tse_real l22 = r_sqrt(r_max(c[1][1] - r_mul(l21, l21), TSE_R(1))), i22 = r_div(TSE_R(1), l22);
  const tse_real l32 = r_mul(c[2][1] - r_mul(l31, l21), i22);
  const tse_real l33 = r_sqrt(r_max(c[2][2] - r_mul(l31, l31) - r_mul(l32, l32), TSE_R(1))), i33 = r_div(TSE_R(1), l33);
  g->l11 = i11;
  g->l22 = i22;
  g->l33 = i33;
  g->l21 = -r_mul(i22, r_mul(l21, i11));
  g->l32 = -r_mul(i33, r_mul(l32, i22));
  g->l31 = -r_mul(i33, r_mul(l31, i11) + r_mul(l32, g->l21));
  for (int a = 0; a < TSE_GAUSS; a++) {
    g->gain[a][0] = r_mul(g->l11, f->ph[a][0]);
    g->gain[a][1] = r_mul(g->l21, f->ph[a][0]) + r_mul(g->l22, f->ph[a][1]);
    g->gain[a][2] = r_mul(g->l31, f->ph[a][0]) + r_mul(g->l32, f->ph[a][1]) + r_mul(g->l33, f->ph[a][2]);
  }
  tse_real sum = g->l11 + g->l22 + g->l33;
  for (int a = 0; a < TSE_GAUSS; a++) sum += r_abs(g->gain[a][0]) + r_abs(g->gain[a][1]) + r_abs(g->gain[a][2]);
  return r_is_finite(sum);
}

/* Errors in variables: the gain and the innovation share the noise of the wheel speeds, so that each sample lowers the
 * longitudinal stiffness by P pull/S on average, and takes P excess/S P for knowledge. Both are given back, as long as the
 * stiffness is known to a tenth: beyond, what is given back would be of noise alone, and feed itself. */
static void undo_wheel_noise(const tse_params *p, tse_filter *f, const forecast *c, tse_real s)
{
  tse_real col[TSE_GAUSS];
  if (f->cov[3][3] > r_mul(UNDO_VAR, r_mul(c->level[0], c->level[0]))) return;
  const tse_real share = r_div(c->pull, s), back = r_div(c->excess, s);
  for (int a = 0; a < TSE_GAUSS; a++) col[a] = f->cov[a][3];
  for (int32_t i = 0; i < padded(p->particles); i++)
    for (int a = 0; a < 3; a++) {
      f->p.x[a][i] += r_mul(col[a], share);
      f->p.mu[a][i] = r_clamp(f->p.mu[a][i] + r_mul(col[3 + a], share), p->w_min, p->w_max);
      f->p.bias[a][i] += r_mul(col[6 + a], share);
    }
  for (int a = 0; a < TSE_GAUSS; a++)
    for (int b = 0; b < TSE_GAUSS; b++) f->cov[a][b] += r_mul(r_mul(col[a], back), col[b]);
}

void gaussian_update(const tse_params *p, tse_filter *f, const gaussian *g, const forecast *c, const tse_real noise[3])
{
  if (p->marginalised) {
    error_update(f, c, noise);
    if (c->pull > TSE_R(0)) undo_wheel_noise(p, f, c, c->hph[0][0] + c->spread[0][0] + noise[0]);
  }
  for (int a = 0; a < 3; a++) f->mean_var[a] = f->cov[3 + a][3 + a];
  for (int a = first_row(p); a < TSE_GAUSS; a++)
    for (int b = a; b < TSE_GAUSS; b++) {
      tse_real less = TSE_R(0);
      for (int k = 0; k < 3; k++) less += r_mul(g->gain[a][k], g->gain[b][k]);
      f->cov[a][b] = f->cov[b][a] = a == b ? r_max(f->cov[a][b] - less, TSE_R(0)) : f->cov[a][b] - less;
    }
}

/* (17) gamma /= lambda, nu *= lambda, Lambda *= lambda (lam = Lambda/nu stays), with lambda^(dt/sample_time).
 * Marginalised, the mean is forgotten as far as this sample taught it (no further: where nothing is excited nothing is
 * forgotten), and walks. */
void forget(const tse_params *p, tse_filter *f, tse_real dt)
{
  const tse_real lambda = r_exp2(r_mul(p->log2_forgetting, r_mul(dt, p->inv_sample_time)));
  f->gamma = r_div(f->gamma, lambda);
  f->nu = r_max(r_mul(f->nu, lambda), NU_LEAST);
  if (!p->marginalised) return;
  for (int a = 0; a < 3; a++) {
    const tse_real now = f->cov[3 + a][3 + a];
    if (!(now > TSE_R(0))) continue;
    const tse_real faded = r_max(now, r_min(r_div(now, lambda), f->mean_var[a])) + r_mul(p->mean_walk, dt);
    const tse_real factor = r_sqrt(r_div(r_max(now, r_min(faded, p->mean_var0)), now));
    for (int b = 0; b < TSE_GAUSS; b++) f->cov[3 + a][b] = r_mul(f->cov[3 + a][b], factor);
    for (int b = 0; b < TSE_GAUSS; b++) f->cov[b][3 + a] = r_mul(f->cov[b][3 + a], factor);
  }
}

/* What a sample says about a stiffness C is how large a force C times slip is: the relative error of C. The slip that goes
 * with a force is small where C is large, so it is the relative error, not the error, that keeps its variance when the mean
 * moves: as if log C were estimated. Without this a mean on its way up from a third believes itself three times too much. */
void gaussian_follow_level(const tse_params *p, tse_filter *f, const tse_output *est)
{
  for (int a = 0; a < 3; a++) {
    const int known = f->level[a] > TSE_R(0) && p->relative_covariance;
    const tse_real ratio = known ? r_clamp(r_div(est->stiffness[a], f->level[a]), TSE_R(0.5), TSE_R(2)) : TSE_R(1);
    f->level[a] = est->stiffness[a];
    for (int b = 0; b < TSE_GAUSS; b++) f->cov[3 + a][b] = r_mul(f->cov[3 + a][b], ratio);
    for (int b = 0; b < TSE_GAUSS; b++) f->cov[b][3 + a] = r_mul(f->cov[b][3 + a], ratio);
    for (int b = 0; b < TSE_ERROR; b++) f->err[3 + a][b] = r_mul(f->err[3 + a][b], ratio);
    for (int b = 0; b < TSE_ERROR; b++) f->err[b][3 + a] = r_mul(f->err[b][3 + a], ratio);
    f->mean_var[a] = r_mul(f->mean_var[a], r_mul(ratio, ratio));
  }
}

/* While the wheels stand still the yaw rate is zero, so the gyro reads its bias. The accelerometers are left alone:
 * what they read at standstill is bias plus the slope of the road. */
void bias_learn_still(const tse_params *p, tse_filter *f, const sample *y)
{
  const tse_real var = f->cov[8][8];
  const tse_real gain = r_mul(y->use[2], r_div(var, var + TSE_R(1)));
  const int32_t count = padded(p->particles);
  for (int32_t i = 0; i < count; i++) f->p.bias[2][i] += r_mul(gain, y->y[2] - f->p.bias[2][i]);
  for (int b = 0; b < 8; b++) f->cov[8][b] = f->cov[b][8] = f->cov[8][b] - r_mul(gain, f->cov[8][b]);
  f->cov[8][8] = var - r_mul(gain, var);
  const tse_real rest = TSE_R(1) - gain;
  const tse_real err = r_mul(r_mul(rest, rest), f->err[8][8]) + r_mul(gain, gain);
  for (int b = 0; b < TSE_ERROR; b++) f->err[8][b] = f->err[b][8] = r_mul(rest, f->err[8][b]);
  f->err[8][8] = err;
}
