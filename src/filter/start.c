/* filter/start.c - initial state: the prior, and the motion from wheel speed and gyro. */
#include "filter/exponential.h"
#include "filter/faults.h"
#include "filter/sensitivities.h"
#include "filter/slip_stiffness.h"
#include "filter/start.h"
#include "filter/units.h"

void start_state(const tse_params *p, tse_filter *f)
{
  tse_kalman *const k = &f->k;
  tse_real variance[STATES];
  for (int i = 0; i < TSE_VALUES; i++) k->x[i] = p->prior[i];
  for (int i = 0; i < STATES; i++) variance[i] = r_sqr(r_div(p->prior_sd[i], state_unit[i]));
  for (int c = 0; c <= STEERING; c++) k->repeats[c] = TSE_R(1);
  for (int c = 0; c < TSE_SENSORS; c++) {
    k->noise[c] = f->start.loaded ? f->start.noise[c] : TSE_R(1);
    k->usual[c] = TSE_R(1) + r_sqr(r_div(p->model_sd, USUAL_MODEL_SD));
  }
  for (int group = 0; group < TSE_GROUPS; group++) k->none[group] = TSE_R(1);
  ud_set(&k->ud, variance);
  along_start(k, r_sqr(p->prior_sd[LCX]));
  if (!f->start.loaded) return;
  for (int i = 0; i < TSE_KEPT; i++) k->x[FAST + i] = f->start.kept[i];
  ud_set_block(&k->ud, FAST, f->start.kept_cov);
  const int slip = HAS_SLIP ? LCX - FAST : 0;
  if (HAS_SLIP) along_start(k, r_mul(f->start.kept_cov[slip][slip], r_sqr(state_unit[LCX])));
}

void start_motion(const tse_params *p, tse_kalman *k, const decoded *z)
{
  const tse_car *const c = &p->car;
  tse_real *const x = k->x, variance[PLACED];
  const int rear = z->use[WHEEL_REAR] && (find_undriven_axle(c) != ROLLS_FRONT || !z->use[WHEEL_FRONT]);
  const int axle = rear ? WHEEL_REAR : WHEEL_FRONT;
  const int has_gyro = z->use[YAW_RATE] && is_usable(k, YAW_RATE);
  /* speed of the car / speed of a front wheel: cos(steer), to second order */
  const tse_real cos_d = r_max(TSE_R(1) - r_mul(TSE_R(0.5), r_sqr(z->steer)), TSE_R(0.5));
  const tse_real v = z->use[axle] ? r_mul(rear ? TSE_R(1) : cos_d, z->z[axle]) : x[VX];
  const tse_real r = has_gyro ? z->z[YAW_RATE] - x[BR] : TSE_R(0);
  /* Initial slip angles, from which the initial v_y follows below: those of a steady
   * turn. In it the force of each axle is its share of the mass (lr/wheelbase in front,
   * lf/wheelbase in the rear) times the lateral acceleration v r. */
  const tse_real across = r_mul(v, r);
  const tse_real wheelbase = c->lf + c->lr;
  const tse_real y_front = r_mul(across, r_div(c->lr, wheelbase));
  const tse_real y_rear = r_mul(across, r_div(c->lf, wheelbase));
  const tse_real a_front = r_div(y_front, r_mul(c->ky_front, compute_exponential(x[LCF])));
  const tse_real a_rear = r_div(y_rear, r_mul(c->ky_rear, compute_exponential(x[LCR])));
  for (int i = 0; i < PLACED; i++) x[i] = TSE_R(0);
  x[VX] = v;
  x[YAW] = r;
  x[AF] = r_clamp(a_front, -MAX_TURN_SLIP_ANGLE, MAX_TURN_SLIP_ANGLE);
  x[AR] = r_clamp(a_rear, -MAX_TURN_SLIP_ANGLE, MAX_TURN_SLIP_ANGLE);
  x[VY] = r_mul(c->lr, r) - r_mul(r_max(r_abs(v), TSE_R(1)), x[AR]);
  x[PHI] = r_mul(c->roll_gain, across);
  /* clang-format off */
  const tse_real sd[] = { /* in the order of the states; a TSE_SMALL build has no states from PHI on */
    TSE_R(0.1) + r_mul(TSE_R(0.02), r_abs(v)),                            /* VX: unknown slip */
    TSE_R(0.1) + r_abs(r_mul(v, x[AR])),                                  /* VY */
    (has_gyro ? TSE_R(0.02) : TSE_R(0.2)) + r_mul(TSE_R(0.05), r_abs(r)), /* YAW */
    TSE_R(0.01) + r_abs(x[AF]),                                           /* AF */
    TSE_R(0.01) + r_abs(x[AR]),                                           /* AR */
    TSE_R(0.01), TSE_R(0.05), TSE_R(0.02), TSE_R(0.02)                    /* PHI DPHI SF SR */
  };
  /* clang-format on */
  for (int i = 0; i < PLACED; i++) variance[i] = r_sqr(r_div(sd[i], state_unit[i]));
  ud_forget(&k->ud, variance, PLACED);
  sensitivities_clear(k, PLACED);
  k->steer[0] = k->steer[1] = k->steer[2] = z->steer;
  k->pitch[0] = k->pitch[1] = TSE_R(0);
  k->before[0] = TSE_R(0);
  k->before[1] = across;
  k->before[2] = v;
}
