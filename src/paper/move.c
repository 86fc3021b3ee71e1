/* paper/move.c - equation (7): propagate every particle from the previous row to this
 * row, with the stiffness deviation w that was drawn at the previous row. */
#include "paper/paper.h"

/* Values of the setting `integration`. 0: Euler's method, as in the paper. 1: ROS2, a
 * method of second order, with inputs that change linearly between rows. 2: like 1, but
 * the steering angle keeps its value of the previous row until this row. */
#define EULER 0
#define HELD_STEER 2

/* Store the motion of particle i within the limits of vehicle.h. */
static void keep_motion(tse_particles *q, int32_t i, tse_real vx, tse_real vy, tse_real r)
{
  q->x[0][i] = vehicle_limit(vx, MAX_SPEED);
  q->x[1][i] = vehicle_limit(vy, MAX_SPEED);
  q->x[2][i] = vehicle_limit(r, MAX_YAW_RATE);
}

/* Propagate all particles over h seconds as in the paper: x+ = f(x, u) + g(x, u) w, with
 * the inputs u of the previous row. */
static void move_by_euler(const tse_params *p, tse_particles *q, inputs u, tse_real h)
{
  for (int32_t i = 0; i < pad_count(p->particles); i++) {
    const tse_real vx = q->x[0][i], vy = q->x[1][i], r = q->x[2][i];
    const stiffness k = vehicle_stiffness(p, q->w[0][i], q->w[1][i], q->w[2][i]);
    const accels a = vehicle_accels(p, k, vehicle_slips(p, vx, vy, r, u), u.steer);
    keep_motion(
        q, i, vx + r_mul(h, a.x + r_mul(vy, r)), vy + r_mul(h, a.y - r_mul(vx, r)), r + r_mul(h, a.yaw));
  }
}

/* Propagate all particles over h seconds by a method of second order (ROS2 of vehicle.h),
 * while the inputs change linearly from u0 to u1. */
static void move_by_ros2(const tse_params *p, tse_particles *q, inputs u0, inputs u1, tse_real h)
{
  for (int32_t i = 0; i < pad_count(p->particles); i++) {
    tse_real vx = q->x[0][i], vy = q->x[1][i], r = q->x[2][i];
    const stiffness k = vehicle_stiffness(p, q->w[0][i], q->w[1][i], q->w[2][i]);
    particle_step(p, &vx, &vy, &r, k, u0, u1, h);
    keep_motion(q, i, vx, vy, r);
  }
}

void paper_predict_state(const tse_params *p, tse_filter_paper *f, const sample *y)
{
  const inputs last = { f->filter.steer, f->filter.v_front, f->filter.v_rear };
  if (p->integration == EULER) {
    move_by_euler(p, &f->p, last, y->dt);
    return;
  }
  inputs from = last, end = y->u;
  if (p->integration == HELD_STEER) end.steer = last.steer;
  const int32_t steps = vehicle_steps(p, y->dt, last, end);
  const tse_real h = steps > 1 ? r_div(y->dt, r_from_int(steps)) : y->dt;
  for (int32_t k = 1; k <= steps; k++) { /* inputs are linear between the rows */
    const inputs to = vehicle_between(last, end, k, steps);
    move_by_ros2(p, &f->p, from, to, h);
    from = to;
  }
}
