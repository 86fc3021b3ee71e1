/* src/propagate.c - (7): every particle from the last row to this one, with the w it drew at the last row. */
#include "stages.h"

/* No car is faster; a particle that would be (a wheel that jumps, tyres that grip like rails) stays a number. NaN too. */
#define MOST_SPEED TSE_R(200)   /* m/s */
#define MOST_YAW_RATE TSE_R(20) /* rad/s */

static void step_all(const tse_params *p, tse_particles *q, int32_t n, inputs u0, inputs u1, tse_real h)
{
  for (int32_t i = 0; i < n; i++) {
    tse_real vx = q->x[0][i], vy = q->x[1][i], r = q->x[2][i];
    const stiffness k = vehicle_stiffness(p, q->w[0][i], q->w[1][i], q->w[2][i]);
    vehicle_step(p, &vx, &vy, &r, k, u0, u1, h);
    q->x[0][i] = r_max(r_min(vx, MOST_SPEED), -MOST_SPEED);
    q->x[1][i] = r_max(r_min(vy, MOST_SPEED), -MOST_SPEED);
    q->x[2][i] = r_max(r_min(r, MOST_YAW_RATE), -MOST_YAW_RATE);
  }
}

void propagate(const tse_params *p, tse_filter *f, inputs u, tse_real dt)
{
  /* steps of at most 1.5 sample times; max_gap bounds their number: 1 s / 0.0015 s at the settings' extremes */
  const int32_t steps = -r_floor_to_int(-r_div(dt, p->max_step));
  const tse_real h = steps > 1 ? r_div(dt, r_from_int(steps)) : dt;
  inputs from = { f->steer, f->v_front, f->v_rear };
  for (int32_t k = 1; k <= steps; k++) { /* inputs are linear between rows */
    const tse_real share = r_div(r_from_int(k), r_from_int(steps));
    inputs to = u;
    if (k < steps) {
      to.steer = f->steer + r_mul(share, u.steer - f->steer);
      to.v_front = f->v_front + r_mul(share, u.v_front - f->v_front);
      to.v_rear = f->v_rear + r_mul(share, u.v_rear - f->v_rear);
    }
    step_all(p, &f->p, padded(p->particles), from, to, h);
    from = to;
  }
}
