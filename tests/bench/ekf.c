/* tests/bench/ekf.c - see ekf.h. */
#include "ekf.h"

#include <string.h>

static void read_inputs(const ekf *f, const tse_input *row, tse_real u[3])
{
  u[0] = row->steer_angle;
  u[1] = f->radius_front * row->wheel_speed_front;
  u[2] = f->radius_rear * row->wheel_speed_rear;
}

/* Return the slip of an axle and its derivative with respect to vel_x. */
static tse_real slip(tse_real roll, tse_real vx, tse_real *by_vx)
{
  if (roll > vx) {
    *by_vx = TSE_R(-1) / roll;
    return (roll - vx) / roll;
  }
  *by_vx = -roll / (vx * vx);
  return (roll - vx) / vx;
}

/* accel_x, accel_y, yaw acceleration at (x, stiffness), and their derivatives with
 * respect to these six. */
static void accelerations(
    const ekf *f, const tse_real x[9], const tse_real u[3], tse_real a[3], tse_real d[3][6])
{
  const tse_real inv = TSE_R(1) / x[0];
  tse_real sf_vx, sr_vx;
  const tse_real sf = slip(u[1], x[0], &sf_vx), sr = slip(u[2], x[0], &sr_vx);
  const tse_real tf = (x[1] + f->lf * x[2]) * inv,
                 tr = (x[1] - f->lr * x[2]) * inv; /* minus the rear slip angle */
  const tse_real kf = f->kx_front * x[3], kr = f->kx_rear * (TSE_R(1) + f->follows * (x[3] - TSE_R(1)));
  const tse_real cf = f->ky_front * x[4], cr = f->ky_rear * x[5];
  /* Force over mass: front and rear longitudinal, front and rear lateral; and its
   * derivatives. */
  const tse_real force[4] = { kf * sf, kr * sr, cf * (u[0] - tf), -cr * tr };
  const tse_real by[4][6] = {
    { kf * sf_vx, 0, 0, f->kx_front * sf, 0, 0 },
    { kr * sr_vx, 0, 0, f->kx_rear * f->follows * sr, 0, 0 },
    { cf * tf * inv, -cf * inv, -cf * f->lf * inv, 0, f->ky_front * (u[0] - tf), 0 },
    { cr * tr * inv, -cr * inv, cr * f->lr * inv, 0, 0, -f->ky_rear * tr },
  };
  const tse_real m[3][4] = {
    { 1, 1, -u[0], 0 },
    { u[0], 0, 1, 1 },
    { f->jf * u[0], 0, f->jf, -f->jr },
  };
  for (int i = 0; i < 3; i++) {
    a[i] = 0;
    for (int j = 0; j < 6; j++) d[i][j] = 0;
    for (int k = 0; k < 4; k++) {
      a[i] += m[i][k] * force[k];
      for (int j = 0; j < 6; j++) d[i][j] += m[i][k] * by[k][j];
    }
  }
}

/* x' and its derivatives with respect to (x, stiffness). */
static void rate(const ekf *f, const tse_real x[9], const tse_real u[3], tse_real dx[3], tse_real d[3][6])
{
  accelerations(f, x, u, dx, d);
  dx[0] += x[1] * x[2];
  dx[1] -= x[0] * x[2];
  d[0][1] += x[2];
  d[0][2] += x[1];
  d[1][0] -= x[2];
  d[1][2] -= x[0];
}

/* Midpoint rule with linear inputs between rows, and its exact derivative; P <- F P F' +
 * G spread^2 G' + walk. */
static void predict(ekf *f, const tse_real u[3], tse_real dt)
{
  const tse_real half = TSE_R(0.5) * dt;
  tse_real k[3], d0[3][6], d1[3][6], mid[9], between[3], t[9][9], fp[9][9];
  rate(f, f->x, f->u, k, d0);
  memcpy(mid, f->x, sizeof mid);
  for (int i = 0; i < 3; i++) {
    mid[i] += half * k[i];
    between[i] = TSE_R(0.5) * (f->u[i] + u[i]);
  }
  rate(f, mid, between, k, d1);
  memset(t, 0, sizeof t);
  for (int i = 0; i < 9; i++) t[i][i] = 1;
  for (int i = 0; i < 3; i++) {
    f->x[i] += dt * k[i];
    for (int j = 0; j < 6; j++) {
      tse_real sum = d1[i][j];
      for (int l = 0; l < 3; l++) sum += half * d1[i][l] * d0[l][j];
      t[i][j] += dt * sum;
    }
  }
  for (int i = 0; i < 9; i++)
    for (int j = 0; j < 9; j++) {
      fp[i][j] = 0;
      for (int l = 0; l < 9; l++) fp[i][j] += t[i][l] * f->p[l][j];
    }
  for (int i = 0; i < 9; i++)
    for (int j = 0; j < 9; j++) {
      f->p[i][j] = 0;
      for (int l = 0; l < 9; l++) f->p[i][j] += fp[i][l] * t[j][l];
    }
  for (int i = 0; i < 3; i++) {
    for (int j = 0; j < 3; j++)
      for (int l = 3; l < 6; l++) f->p[i][j] += f->spread_var * t[i][l] * t[j][l];
    f->p[6 + i][6 + i] += f->walk_var[i] * dt;
  }
}

static void invert(tse_real s[3][3], tse_real inv[3][3])
{
  const tse_real a = s[1][1] * s[2][2] - s[1][2] * s[2][1], b = s[1][2] * s[2][0] - s[1][0] * s[2][2];
  const tse_real c = s[1][0] * s[2][1] - s[1][1] * s[2][0],
                 det = TSE_R(1) / (s[0][0] * a + s[0][1] * b + s[0][2] * c);
  inv[0][0] = det * a;
  inv[0][1] = inv[1][0] = det * b;
  inv[0][2] = inv[2][0] = det * c;
  inv[1][1] = det * (s[0][0] * s[2][2] - s[0][2] * s[2][0]);
  inv[1][2] = inv[2][1] = det * (s[0][2] * s[1][0] - s[0][0] * s[1][2]);
  inv[2][2] = det * (s[0][0] * s[1][1] - s[0][1] * s[1][0]);
}

/* S = H P H' + D spread^2 D' + R,  K = P H' S^-1,  x += K (y - h),  P -= K H P */
static void update(ekf *f, const tse_real u[3], const tse_input *row)
{
  const tse_real y[3] = { row->accel_x, row->accel_y, row->yaw_rate };
  tse_real a[3], d[3][6], h[3][9], hp[3][9], s[3][3], inv[3][3], k[9][3], e[3];
  accelerations(f, f->x, u, a, d);
  memset(h, 0, sizeof h);
  for (int j = 0; j < 6; j++) {
    h[0][j] = d[0][j];
    h[1][j] = d[1][j];
  }
  h[2][2] = 1;
  a[2] = f->x[2];
  for (int i = 0; i < 3; i++) {
    h[i][6 + i] = 1;
    e[i] = y[i] - a[i] - f->x[6 + i];
  }
  for (int i = 0; i < 3; i++)
    for (int j = 0; j < 9; j++) {
      hp[i][j] = 0;
      for (int l = 0; l < 9; l++) hp[i][j] += h[i][l] * f->p[l][j];
    }
  for (int i = 0; i < 3; i++)
    for (int j = 0; j < 3; j++) {
      s[i][j] = i == j ? f->noise_var[i] : 0;
      for (int l = 0; l < 9; l++) s[i][j] += hp[i][l] * h[j][l];
      for (int l = 3; l < 6; l++) s[i][j] += f->spread_var * h[i][l] * h[j][l];
    }
  invert(s, inv);
  for (int j = 0; j < 9; j++)
    for (int i = 0; i < 3; i++) k[j][i] = hp[0][j] * inv[0][i] + hp[1][j] * inv[1][i] + hp[2][j] * inv[2][i];
  for (int i = 0; i < 9; i++) {
    f->x[i] += k[i][0] * e[0] + k[i][1] * e[1] + k[i][2] * e[2];
    for (int j = 0; j < 9; j++) f->p[i][j] -= k[i][0] * hp[0][j] + k[i][1] * hp[1][j] + k[i][2] * hp[2][j];
  }
}

static tse_real squared(tse_setting x) { return (tse_real)(x * x); }

void ekf_start(ekf *f, const tse_config *c, tse_real spread, const tse_input *row)
{
  memset(f, 0, sizeof *f);
  f->kx_front = (tse_real)(c->longitudinal_stiffness_front / c->mass);
  f->kx_rear = (tse_real)(c->longitudinal_stiffness_rear / c->mass);
  f->ky_front = (tse_real)(c->cornering_stiffness_front / c->mass);
  f->ky_rear = (tse_real)(c->cornering_stiffness_rear / c->mass);
  f->follows = (tse_real)c->rear_longitudinal_follows_front, f->lf = (tse_real)c->lf, f->lr = (tse_real)c->lr;
  f->jf = (tse_real)(c->mass * c->lf / c->yaw_inertia), f->jr = (tse_real)(c->mass * c->lr / c->yaw_inertia);
  f->radius_front = (tse_real)c->wheel_radius_front, f->radius_rear = (tse_real)c->wheel_radius_rear;
  f->spread_var = spread * spread;
  const tse_setting noise[3] = { c->accel_x_sd, c->accel_y_sd, c->yaw_rate_sd };
  const tse_setting walk[3] = { c->accel_x_bias_walk, c->accel_y_bias_walk, c->yaw_rate_bias_walk };
  const tse_setting sd[9] = { c->initial_vel_x_sd, c->initial_vel_y_sd, c->initial_yaw_rate_sd,
    c->initial_mean_sd, c->initial_mean_sd, c->initial_mean_sd, c->accel_x_bias_sd, c->accel_y_bias_sd,
    c->yaw_rate_bias_sd };
  for (int i = 0; i < 3; i++) { f->noise_var[i] = squared(noise[i]), f->walk_var[i] = squared(walk[i]); }
  for (int i = 0; i < 9; i++) f->p[i][i] = squared(sd[i]);
  read_inputs(f, row, f->u);
  f->x[0] = TSE_R(0.5) * (f->u[1] + f->u[2]), f->x[3] = (tse_real)c->initial_cx_front;
  f->x[4] = (tse_real)c->initial_cy_front, f->x[5] = (tse_real)c->initial_cy_rear;
}

void ekf_step(ekf *f, const tse_input *row, int first)
{
  tse_real u[3];
  read_inputs(f, row, u);
  if (!first) predict(f, u, row->dt);
  update(f, u, row);
  memcpy(f->u, u, sizeof f->u);
}
