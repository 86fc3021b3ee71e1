/* model/effects/exact_kinematics.h - what (1)-(4) take as small is not: velocity of the front wheel in its own axes
 *   v_x = vx cos d + (vy + lf r) sin d,  v_y = (vy + lf r) cos d - vx sin d
 *   slip (R omega - v_x)/max(..), slip angles atan(-v_y/|v_x|), atan((lr r - vy)/|vx|); forces turned by cos d, sin d.
 * share: 0 the plain model, 1 exact, between a mixture, so that a test for it has a slope at 0. */
static inline void exact_kinematics_slip(const tse_params *p, const tse_effect_memory *m, point *pt)
{
  const tse_real share = p->effects.exact_kinematics_share, side = pt->vy + r_mul(p->lf, pt->r);
  tse_real sine, cosine;
  (void)m;
  effects_sincos(pt->u.steer, &sine, &cosine);
  const tse_real along = r_mul(pt->vx, cosine) + r_mul(side, sine), across = r_mul(side, cosine) - r_mul(pt->vx, sine);
  const tse_real over = r_max(r_abs(along), LOW_SPEED);
  const tse_real s_front = r_div(pt->u.v_front - along, r_max(over, r_abs(pt->u.v_front)));
  const tse_real a_front = r_atan2(-across, over), a_rear = r_atan2(r_mul(p->lr, pt->r) - pt->vy, r_max(r_abs(pt->vx), LOW_SPEED));
  pt->s.s_front += r_mul(share, s_front - pt->s.s_front);
  pt->s.a_front += r_mul(share, a_front - pt->s.a_front);
  pt->s.a_rear += r_mul(share, a_rear - pt->s.a_rear);
  pt->sin_steer += r_mul(share, sine - pt->sin_steer);
  pt->cos_steer += r_mul(share, cosine - pt->cos_steer);
}
