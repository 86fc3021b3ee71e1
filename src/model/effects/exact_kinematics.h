/* model/effects/exact_kinematics.h - what (1)-(4) take as small is not: velocity of the front wheel in its own axes
 *   v_x = vx cos d + (vy + lf r) sin d,  v_y = (vy + lf r) cos d - vx sin d
 *   slip (R omega - v_x)/max(..), slip angles atan(-v_y/|v_x|), atan((lr r - vy)/|vx|); forces turned by cos d, sin d.
 * share: 0 the plain model, 1 exact, between a mixture, so that a test for it has a slope at 0. */
static inline void exact_kinematics_slip(point *pt)
{
  const tse_params *const p = pt->p;
  const tse_real share = p->effects.exact_kinematics_share;
  tse_real sine, cosine;
  sin_cos(pt->u.steer, &sine, &cosine);
  const planar wheel = turn_axes(pt->vx, pt->vy + r_mul(p->car.lf, pt->r), sine, cosine);
  const tse_real s_front = r_div(pt->u.v_front - wheel.x, r_max(rolling_speed(wheel.x), r_abs(pt->u.v_front)));
  const tse_real a_front = slip_angle(wheel.y, wheel.x), a_rear = slip_angle(pt->vy - r_mul(p->car.lr, pt->r), pt->vx);
  pt->s.s_front += r_mul(share, s_front - pt->s.s_front);
  pt->s.a_front += r_mul(share, a_front - pt->s.a_front);
  pt->s.a_rear += r_mul(share, a_rear - pt->s.a_rear);
  pt->sin_steer += r_mul(share, sine - pt->sin_steer);
  pt->cos_steer += r_mul(share, cosine - pt->cos_steer);
}
