/* estimator/paper/slide.c - wheels that lock or spin: the tyres are beyond what (2) knows, and wheel speeds do not tell the car's. */
#include "estimator/paper/particles.h"

#define SLIDE_TIME TSE_R(0.1)  /* s: rolling for so long ends a slide                                 */
#define LONGEST_SLIDE TSE_R(5) /* s: integrated accelerometers drift; then the wheels are believed    */

/* Slip beyond max_slip against the speed as estimated begins a slide; half of that, for a while, ends it. */
int wheels_slide(const tse_params *p, tse_filter_paper *f, const sample *y)
{
  if (!(p->max_slip < TSE_R(1)) || !y->has_inputs) return f->sliding > TSE_R(0);
  const tse_real speed = r_max(r_abs(f->vel_x), p->hold_speed);
  const tse_real front = r_div(r_abs(y->u.v_front - f->vel_x), r_max(speed, r_abs(y->u.v_front)));
  const tse_real rear = r_div(r_abs(y->u.v_rear - f->vel_x), r_max(speed, r_abs(y->u.v_rear)));
  const int slid = f->sliding > TSE_R(0);
  const tse_real most = slid ? r_mul(TSE_R(0.5), p->max_slip) : p->max_slip;
  if (r_max(front, rear) > most && r_abs(f->vel_x) > p->hold_speed) f->sliding = SLIDE_TIME;
  else f->sliding = r_max(f->sliding - y->dt, TSE_R(0));

  if (f->sliding > TSE_R(0)) {
    f->sliding_for += y->dt;
    if (f->sliding_for < LONGEST_SLIDE) return 1;
    restart_states(p, f, y);
    f->sliding = TSE_R(0);
  }
  f->sliding_for = TSE_R(0);
  return 0;
}

/* The motion as accelerometers and gyro have it: vx' = ax + vy r, vy' = ay - vx r. */
void coast(const tse_params *p, tse_filter_paper *f, const sample *y)
{
  for (int32_t i = 0; i < padded(p->particles); i++) {
    const tse_real vx = f->p.x[0][i], vy = f->p.x[1][i];
    const tse_real r = y->use[2] > TSE_R(0) ? r_mul(p->sd[2], y->y[2] - f->p.bias[2][i]) : f->p.x[2][i];
    const tse_real ax = r_mul(r_mul(y->use[0], p->sd[0]), y->y[0] - f->p.bias[0][i]);
    const tse_real ay = r_mul(r_mul(y->use[1], p->sd[1]), y->y[1] - f->p.bias[1][i]);
    f->p.x[0][i] = vehicle_kept(vx + r_mul(y->dt, ax + r_mul(vy, r)), MOST_SPEED);
    f->p.x[1][i] = vehicle_kept(vy + r_mul(y->dt, ay - r_mul(vx, r)), MOST_SPEED);
    f->p.x[2][i] = vehicle_kept(r, MOST_YAW_RATE);
  }
}
