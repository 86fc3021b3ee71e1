/* model/slopes.h - the forces of (1)-(4) at one point, and what small changes do to them: for covariances. */
#ifndef TSE_MODEL_SLOPES_H
#define TSE_MODEL_SLOPES_H

#include "model/vehicle.h"

/* What the forces are derived by: vel_x, vel_y, yaw rate; the three stiffnesses; and the inputs. */
enum { BY_STATE = 0, BY_STIFFNESS = 3, BY_STEER = 6, BY_FRONT_WHEELS, BY_REAR_WHEELS, SLOPES };

/* Forces over mass [m/s2]: longitudinal, lateral of the front axle, lateral of the rear axle; and their derivatives. */
typedef struct slopes {
  tse_real x, front, rear;
  tse_real s_front, s_rear; /* slips */
  tse_real dx[SLOPES], dfront[SLOPES], drear[SLOPES];
} slopes;

/* x: vel_x, vel_y, yaw rate, stiffnesses over nominal. slip: NULL, or smoothed slips of front and rear to take in the derivatives by
 * the longitudinal stiffness, where the wheel speeds' noise must not look like excitation. */
static inline void vehicle_slopes(const tse_params *p, const tse_real x[6], inputs u, const tse_real *slip, slopes *o)
{
  const tse_real zero = TSE_R(0), one = TSE_R(1);
  const slips s = vehicle_slips(p, x[0], x[1], x[2], u);
  const stiffness k = vehicle_stiffness(p, x[3] - one, x[4] - one, x[5] - one);
  const tse_real body = r_abs(x[0]), speed = r_max(body, LOW_SPEED), steer = u.steer;
  /* what a slip was taken over: the car's speed or the wheels' */
  const tse_real sign = x[0] < zero ? -one : one, moving = body > LOW_SPEED ? sign : zero;
  const tse_real front_leads = r_abs(u.v_front) > speed ? one : zero, rear_leads = r_abs(u.v_rear) > speed ? one : zero;
  const tse_real sf_vx = -r_mul(s.inv_front, one + r_mul(r_mul(moving, one - front_leads), s.s_front));
  const tse_real sr_vx = -r_mul(s.inv_rear, one + r_mul(r_mul(moving, one - rear_leads), s.s_rear));
  const tse_real af_vx = r_mul(s.inv_body, steer - r_mul(moving, s.a_front));
  const tse_real ar_vx = -r_mul(s.inv_body, r_mul(moving, s.a_rear));
  const tse_real yf = r_mul(k.y_front, s.inv_body), yr = r_mul(k.y_rear, s.inv_body);
  const tse_real fx_front = r_mul(k.x_front, s.s_front), fy_front = r_mul(k.y_front, s.a_front);
  const tse_real pull = r_mul(k.x_front, sf_vx), turn = r_mul(k.y_front, af_vx);
  const tse_real s_front = slip ? slip[0] : s.s_front, s_rear = slip ? slip[1] : s.s_rear;

  o->s_front = s.s_front;
  o->s_rear = s.s_rear;
  o->x = fx_front + r_mul(k.x_rear, s.s_rear) - r_mul(fy_front, steer);
  o->front = fy_front + r_mul(fx_front, steer);
  o->rear = r_mul(k.y_rear, s.a_rear);

  o->dx[0] = pull + r_mul(k.x_rear, sr_vx) - r_mul(steer, turn);
  o->dx[1] = r_mul(steer, yf);
  o->dx[2] = r_mul(p->lf, o->dx[1]);
  o->dx[3] = r_mul(p->kx_front, s_front) + r_mul(r_mul(p->kx_rear, p->follow), s_rear);
  o->dx[4] = -r_mul(r_mul(p->ky_front, s.a_front), steer);
  o->dx[5] = zero;
  o->dx[BY_STEER] = -fy_front - r_mul(r_mul(steer, yf), x[0]);
  o->dx[BY_FRONT_WHEELS] = r_mul(k.x_front, r_mul(s.inv_front, one - r_mul(front_leads, r_abs(s.s_front))));
  o->dx[BY_REAR_WHEELS] = r_mul(k.x_rear, r_mul(s.inv_rear, one - r_mul(rear_leads, r_abs(s.s_rear))));

  o->dfront[0] = turn + r_mul(steer, pull);
  o->dfront[1] = -yf;
  o->dfront[2] = -r_mul(p->lf, yf);
  o->dfront[3] = r_mul(r_mul(p->kx_front, s_front), steer);
  o->dfront[4] = r_mul(p->ky_front, s.a_front);
  o->dfront[5] = zero;
  o->dfront[BY_STEER] = r_mul(yf, x[0]) + fx_front;
  o->dfront[BY_FRONT_WHEELS] = r_mul(o->dx[BY_FRONT_WHEELS], steer);
  o->dfront[BY_REAR_WHEELS] = zero;

  for (int a = 3; a < SLOPES; a++) o->drear[a] = zero;
  o->drear[0] = r_mul(k.y_rear, ar_vx);
  o->drear[1] = -yr;
  o->drear[2] = r_mul(p->lr, yr);
  o->drear[5] = r_mul(p->ky_rear, s.a_rear);
}

#endif
