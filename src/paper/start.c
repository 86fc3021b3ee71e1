/* paper/start.c - line Initialize of Algorithm 1: particles from the settings and the
 * first sample. After a gap only their motion is initialised. */
#include "paper/paper.h"
#include "number/random.h"

/* Draw six standard normal numbers for a particle. They depend only on the seed, the step
 * and the index of the particle. */
static void draw_normals(const tse_params *p, uint32_t step, int32_t i, tse_real n[6])
{
  uint32_t a, b;
  for (uint32_t k = 0; k < 3; k++) {
    random_words(p->seed, step, RANDOM_START_A + k, (uint32_t)i, &a, &b);
    random_normal2(a, b, &n[2 * k], &n[2 * k + 1]);
  }
}

/* Return the stiffness deviation w, clipped to w_min .. w_max. */
static tse_real clip_stiffness(const tse_params *p, tse_real w) { return r_clamp(w, p->w_min, p->w_max); }

/* Return the mean of both wheel speeds [m/s]. */
static tse_real average_wheel_speed(const sample *y) { return r_mul(TSE_R(0.5), y->u.v_front + y->u.v_rear); }

/* Draw the initial motion of particle i from a normal distribution. Its mean is the
 * longitudinal speed vel_x, the lateral speed 0 and the yaw rate of the gyro. Its sds are
 * p->x_sd0.
 *   Given:  n  three standard normal numbers */
static void place_particle(
    const tse_params *p, tse_filter_paper *f, const sample *y, int32_t i, tse_real vel_x, const tse_real n[3])
{
  /* gyro less its bias; 0 if the gyro is missing */
  const tse_real yaw_rate = r_mul(y->use[2], r_mul(p->sd[2], y->y[2] - f->p.bias[2][i]));
  f->p.x[0][i] = vehicle_limit(vel_x + r_mul(p->x_sd0[0], n[0]), MAX_SPEED);
  f->p.x[1][i] = vehicle_limit(r_mul(p->x_sd0[1], n[1]), MAX_SPEED);
  f->p.x[2][i] = vehicle_limit(yaw_rate + r_mul(p->x_sd0[2], n[2]), MAX_YAW_RATE);
}

void paper_start(const tse_params *p, tse_filter_paper *f, const sample *y)
{
  const int32_t count = pad_count(p->particles);
  const tse_real vel_x = p->vel_x_from_wheels ? average_wheel_speed(y) : p->vel_x0;
  tse_start s = f->filter.start;
  if (!s.loaded) start_of_settings(p, &s);
  f->gamma = s.gamma;
  f->nu = s.nu;
  f->log_total = r_log2(r_from_int(p->particles));
  for (int a = 0; a < 3; a++) f->bias_var[a] = s.bias_var[a];
  for (int32_t i = 0; i < count; i++) {
    tse_real n[6];
    draw_normals(p, f->filter.step, i, n);
    for (int k = 0; k < 6; k++) f->p.lam[k][i] = s.lam[k];
    for (int a = 0; a < 3; a++) {
      f->p.mu[a][i] = f->p.w[a][i] = clip_stiffness(p, s.mu[a] + r_mul(s.mu_sd[a], n[3 + a]));
      f->p.bias[a][i] = s.bias[a];
    }
    place_particle(p, f, y, i, vel_x, n);
    f->p.logw[0][i] = TSE_R(0);
    f->weight[i] = i < p->particles ? TSE_R(1) : TSE_R(0);
  }
}

void paper_place(const tse_params *p, tse_filter_paper *f, const sample *y)
{
  const int32_t count = pad_count(p->particles);
  for (int32_t i = 0; i < count; i++) {
    tse_real n[6];
    draw_normals(p, f->filter.step, i, n);
    place_particle(p, f, y, i, average_wheel_speed(y), n);
  }
}
