/* tests/unit/paper_cases.h - the linear Gaussian part of the paper in dense matrices and
 * SI units: stiffness in N and N/rad, measurements in m/s2 and rad/s. Given the past, (w,
 * y) is jointly Student-t with nut = nu - 2 degrees of freedom and scale
 *     [ A     A d'                          ]        A = (1 + gamma)/nut Lambda
 *     [ d A   d A d' + (nut-2)/nut (R + P)  ]
 * so w given y is Student-t, too (Kotz and Nadarajah, Multivariate t Distributions, 2004,
 * section 1.11). The code under test whitens, and works in log2 and scalar steps. Numbers
 * have 24 bits, so they are exact in every format. Include it after unit_support.h. */
#ifndef PAPER_CASES_H
#define PAPER_CASES_H

#define PAPER_SETTINGS(X) \
  X(mass) X(lf) X(lr) X(wheel_radius_front) X(wheel_radius_rear) \
  X(longitudinal_stiffness_front) X(longitudinal_stiffness_rear) \
  X(cornering_stiffness_front) X(cornering_stiffness_rear) X(rear_longitudinal_follows_front) \
  X(accel_x_sd) X(accel_y_sd) X(yaw_rate_sd)

typedef struct paper_car {
#define X(name) double name;
  PAPER_SETTINGS(X)
#undef X
} paper_car;

typedef struct paper_particle {
  double x[3], mu[3], scale[6], bias[3]; /* scale: Lambda/nu, upper triangle */
} paper_particle;

typedef struct paper_prior {
  double nu, gamma, bias_var[3]; /* shared by all particles; bias_var in squared sensor sd */
} paper_prior;

static inline double any(uint32_t *seed, double lo, double hi) { return single(next_between(seed, lo, hi)); }

static inline paper_car any_car(uint32_t *seed)
{
  static const double range[13][2] = { { 900, 3000 }, { 1, 1.6 }, { 1, 1.8 }, { 0.28, 0.36 }, { 0.28, 0.36 },
    { 8e4, 2e5 }, { 8e4, 2e5 }, { 8e4, 2e5 }, { 8e4, 2e5 }, { 0, 1 }, { 0.05, 0.3 }, { 0.05, 0.3 },
    { 0.002, 0.01 } };
  double at[13];
  paper_car c;
  for (int k = 0; k < 13; k++) at[k] = any(seed, range[k][0], range[k][1]);
  memcpy(&c, at, sizeof c);
  return c;
}

static inline tse_config config_of(const paper_car *car, int32_t particles)
{
  tse_config c = config_by(tse_config_paper);
#define X(name) c.name = setting(car->name);
  PAPER_SETTINGS(X)
#undef X
  c.particles = particles;
  return c;
}

/* Draw a particle with speeds near those of the wheels and sds of the stiffness within
 * these limits. */
static inline paper_particle any_particle(
    uint32_t *seed, const paper_car *car, const double u[3], double low, double high)
{
  paper_particle q;
  const double v = 0.5 * (car->wheel_radius_front * u[1] + car->wheel_radius_rear * u[2]),
               sd = next_between(seed, low, high);
  double g[3][5];
  q.x[0] = single(v + 0.1 * next_normal(seed)), q.x[1] = single(0.2 * next_normal(seed));
  q.x[2] = single(0.1 * next_normal(seed));
  for (int a = 0; a < 3; a++) {
    q.mu[a] = single(0.15 * next_normal(seed));
    q.bias[a] = single((a < 2 ? 0.1 : 0.003) * next_normal(seed));
    for (int k = 0; k < 5; k++) g[a][k] = sd * next_normal(seed);
  }
  for (int a = 0, at = 0; a < 3; a++)
    for (int b = a; b < 3; b++, at++) {
      q.scale[at] = 0;
      for (int k = 0; k < 5; k++) q.scale[at] += g[a][k] * g[b][k];
      q.scale[at] = single(q.scale[at]);
    }
  return q;
}

/* h and d of (9), for speeds above 1 m/s. u: steering angle, wheel speeds. */
static inline void regressors(
    const paper_car *c, const double x[3], const double u[3], double h[3], double d[3][3])
{
  const double vf = c->wheel_radius_front * u[1], vr = c->wheel_radius_rear * u[2];
  const double fx_f = c->longitudinal_stiffness_front * (vf - x[0]) / fmax(x[0], vf),
               fx_r = c->longitudinal_stiffness_rear * (vr - x[0]) / fmax(x[0], vr);
  const double fy_f = c->cornering_stiffness_front * (u[0] - (x[1] + c->lf * x[2]) / x[0]),
               fy_r = c->cornering_stiffness_rear * (c->lr * x[2] - x[1]) / x[0];
  const double rows[3][3] = { { (fx_f + c->rear_longitudinal_follows_front * fx_r) / c->mass,
                                  -fy_f * u[0] / c->mass, 0 },
    { fx_f * u[0] / c->mass, fy_f / c->mass, fy_r / c->mass }, { 0, 0, 0 } };
  memcpy(d, rows, sizeof rows);
  h[0] = (fx_f + fx_r - fy_f * u[0]) / c->mass;
  h[1] = (fy_f + fy_r + fx_f * u[0]) / c->mass;
  h[2] = x[2];
}

/* Information of a sample about w under one particle: log density of the sample, and the
 * conditional of w: mean, degrees of freedom, inverse of the Cholesky factor of its
 * scale. */
typedef struct conditional {
  double log_density, mean[3], dof, white[3][3];
} conditional;

static inline conditional conditional_of(const paper_car *c, const paper_prior *prior,
    const paper_particle *q, const double u[3], const double y[3], int mask)
{
  static const int upper[3][3] = { { 0, 1, 2 }, { 1, 3, 4 }, { 2, 4, 5 } };
  const double sd[3] = { c->accel_x_sd, c->accel_y_sd, c->yaw_rate_sd }, nut = prior->nu - 2;
  double h[3], d[3][3], A[3][3], B[3][3] = { { 0 } }, s[3][3] = { { 0 } }, z[3], e[3], G[3][3], t, q2 = 0;
  int use[3], n = 0;
  conditional r;
  regressors(c, q->x, u, h, d);
  for (int a = 0; a < 3; a++)
    if (mask >> a & 1) use[n++] = a;
  for (int a = 0; a < 3; a++)
    for (int b = 0; b < 3; b++) A[a][b] = (1 + prior->gamma) / nut * prior->nu * q->scale[upper[a][b]];
  for (int i = 0; i < n; i++) {
    const int a = use[i];
    z[i] = y[a] - h[a] - q->bias[a];
    for (int b = 0; b < 3; b++) {
      z[i] -= d[a][b] * q->mu[b];
      for (int k = 0; k < 3; k++) B[i][b] += d[a][k] * A[k][b];
    }
    for (int j = 0; j < n; j++)
      for (int k = 0; k < 3; k++) s[i][j] += B[i][k] * d[use[j]][k];
    s[i][i] += (nut - 2) / nut * sd[a] * sd[a] * (1 + prior->bias_var[a]);
  }
  cholesky(s, n);
  forward(s, n, z, e);
  r.log_density = lgamma((nut + n) / 2) - lgamma(nut / 2) - n / 2.0 * log(nut * 3.141592653589793);
  for (int i = 0; i < n; i++) q2 += e[i] * e[i], r.log_density -= log(s[i][i]);
  r.log_density -= (nut + n) / 2 * log1p(q2 / nut);
  r.dof = nut + n;
  for (int b = 0; b < 3; b++) {
    const double column[3] = { B[0][b], B[1][b], B[2][b] };
    double g[3] = { 0, 0, 0 };
    forward(s, n, column, g);
    r.mean[b] = q->mu[b];
    for (int i = 0; i < 3; i++) G[i][b] = g[i];
    for (int i = 0; i < n; i++) r.mean[b] += g[i] * e[i];
  }
  for (int a = 0; a < 3; a++)
    for (int b = 0; b < 3; b++) {
      t = A[a][b];
      for (int i = 0; i < n; i++) t -= G[i][a] * G[i][b];
      s[a][b] = (nut + q2) / r.dof * t;
    }
  cholesky(s, 3);
  for (int b = 0; b < 3; b++) {
    double one[3] = { 0, 0, 0 }, x[3];
    one[b] = 1;
    forward(s, 3, one, x);
    for (int a = 0; a < 3; a++) r.white[a][b] = x[a];
  }
  return r;
}

/* Draw a sample that its particle could have produced, with a distance of two sds. */
static inline void any_sample(
    uint32_t *seed, const paper_car *c, const paper_particle *q, const double u[3], double y[3])
{
  const double sd[3] = { c->accel_x_sd, c->accel_y_sd, c->yaw_rate_sd };
  double h[3], d[3][3];
  regressors(c, q->x, u, h, d);
  for (int a = 0; a < 3; a++) {
    y[a] = h[a] + q->bias[a] + 2 * sd[a] * next_normal(seed);
    for (int b = 0; b < 3; b++) y[a] += d[a][b] * q->mu[b];
    y[a] = single(y[a]);
  }
}

#endif
