/* estimator/paper/propagate.c - (7): every particle from the last row to this one, with the w it drew at the last row. */
#include "estimator/paper/particles.h"

static void step_all(const tse_params *p, tse_particles *q, int32_t n, inputs u0, inputs u1, tse_real h)
{
  for (int32_t i = 0; i < n; i++) {
    tse_real vx = q->x[0][i], vy = q->x[1][i], r = q->x[2][i];
    const stiffness k = vehicle_stiffness(p, q->w[0][i], q->w[1][i], q->w[2][i]);
    vehicle_step(p, &vx, &vy, &r, k, u0, u1, h);
    q->x[0][i] = vehicle_kept(vx, MOST_SPEED);
    q->x[1][i] = vehicle_kept(vy, MOST_SPEED);
    q->x[2][i] = vehicle_kept(r, MOST_YAW_RATE);
  }
}

void propagate(const tse_params *p, tse_filter_paper *f, inputs u, tse_real dt)
{
  const inputs last = { f->filter.steer, f->filter.v_front, f->filter.v_rear };
  const int32_t steps = vehicle_steps(p, dt, last, u);
  const tse_real h = steps > 1 ? r_div(dt, r_from_int(steps)) : dt;
  inputs from = last;
  for (int32_t k = 1; k <= steps; k++) { /* inputs are linear between rows */
    const inputs to = vehicle_between(last, u, k, steps);
    step_all(p, &f->p, padded(p->particles), from, to, h);
    from = to;
  }
}
