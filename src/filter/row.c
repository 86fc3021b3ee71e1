/* filter/row.c - check a log row and convert it to `decoded`. */
#include "filter/row.h"
#include "tables/input.h"

/* Return the axle that rolls freely, according to brake switch and wheel torques.
 * ROLLS_NONE: no axle rolls freely. ROLLS_UNKNOWN: the row gives too little to decide. An
 * axle has no torque if the magnitude of its torque is below p->no_torque.
 *
 * If one axle is driven, only the undriven axle can roll freely. It does so if the brake
 * is off and this axle has no torque. If the row does not give one of the two (brake
 * switch, torque of the undriven axle), the other alone decides. If it gives neither, the
 * result is ROLLS_UNKNOWN.
 *
 * If both axles are driven, or if the driven axle is unknown, an axle rolls freely if the
 * brake is not on, this axle has no torque and the other axle has torque. The torques of
 * both axles must be given, otherwise the result is ROLLS_UNKNOWN. */
static int32_t find_free_axle(const tse_params *p, const decoded *z)
{
  const int32_t undriven = find_undriven_axle(&p->car);
  const int has_brake = (z->given & TSE_GIVEN_brake) != 0;
  const int known[2] = { (z->given & TSE_GIVEN_wheel_torque_front) != 0,
    (z->given & TSE_GIVEN_wheel_torque_rear) != 0 };
  const tse_real torque[2] = { r_abs(z->optional[TSE_OPTIONAL_wheel_torque_front]),
    r_abs(z->optional[TSE_OPTIONAL_wheel_torque_rear]) };
  const int less = torque[1] < torque[0];
  if (undriven == ROLLS_UNKNOWN && !(known[0] && known[1])) return ROLLS_UNKNOWN;
  if (has_brake && !(z->optional[TSE_OPTIONAL_brake] < BRAKE_ON)) return ROLLS_NONE;
  if (undriven == ROLLS_UNKNOWN)
    return torque[less] < p->no_torque && !(torque[!less] < p->no_torque) ? ROLLS_FRONT + less : ROLLS_NONE;
  if (known[undriven - ROLLS_FRONT])
    return torque[undriven - ROLLS_FRONT] < p->no_torque ? undriven : ROLLS_NONE;
  return has_brake ? undriven : ROLLS_UNKNOWN;
}

static int is_equal(tse_real front, tse_real rear)
{
  return r_abs(front - rear) <= r_mul(SAME_SPEED, r_abs(rear));
}

/* Return whether two wheel speeds [m/s] may be copies of one signal: they are equal, or
 * have the ratio of earlier rows (tse_filter.ratio). Copies may have a constant ratio
 * other than 1. This is so if the logged wheel speeds [rad/s] were computed from one
 * vehicle speed with wheel radii that differ from the settings, for example with rounded
 * radii. */
static int is_same(const tse_filter *f, tse_real front, tse_real rear)
{
  const tse_real off = r_abs(front - r_mul(f->ratio, rear));
  return is_equal(front, rear) || (f->ratio > TSE_R(0) && off <= r_mul(SAME_RATIO, r_abs(rear)));
}

/* Find whether the wheel speeds of both axles are copies of one signal. A copy may lag
 * behind the other by a row, or repeat a value. A new value therefore counts as a copy if
 * it matches the value of the other axle in this row or in the previous row (is_same()).
 * There are two signals if each axle has had a new value in the last USUAL_TIME that was
 * no copy, unless the setting wheel_signals is 1.
 *   Updated:  z  equal, same, off, one_speed and no_second, explained in types.h. If
 *                there is one signal, the front axle is not used, and the rear axle
 *                receives the newer value */
static void find_one_speed(const tse_params *p, const tse_filter *f, decoded *z)
{
  const tse_real front = z->axle[0], rear = z->axle[1];
  const int both = z->use[WHEEL_FRONT] && z->use[WHEEL_REAR];
  const int moves = r_min(r_abs(front), r_abs(rear)) > p->hold_speed;
  const int front_new = front < f->v_front || front > f->v_front;
  const int rear_new = rear < f->v_rear || rear > f->v_rear;
  const int counts = both && moves && f->started && (f->ratio > TSE_R(0) || is_same(f, front, rear));
  z->equal = both && is_equal(front, rear);
  z->same = both && is_same(f, front, rear);
  z->off[0] = counts && !z->same && front_new && !is_same(f, front, f->v_rear);
  z->off[1] = counts && !z->same && rear_new && !is_same(f, f->v_front, rear);
  const int off_front = z->off[0] || f->off_for[0] > TSE_R(0);
  const int off_rear = z->off[1] || f->off_for[1] > TSE_R(0);
  const int one = p->wheel_signals < 2 || !(off_front && off_rear);
  const int has_velocity = f->k.ud.extras || (z->given & TSE_GIVEN_VELOCITIES);
  const int known = z->equal || (moves && f->ratio > TSE_R(0));
  z->one_speed = both && one && (p->wheel_signals < 2 || known);
  z->no_second = z->one_speed || (!both && one && !has_velocity);
  if (!z->one_speed) return;
  if (off_front && !off_rear) z->z[WHEEL_REAR] = f->ratio > TSE_R(0) ? r_div(front, f->ratio) : front;
  z->use[WHEEL_FRONT] = 0;
}

tse_status decode_row(const tse_params *p, const tse_filter *f, const tse_input *u, decoded *z)
{
  tse_input given = *u;
  if (!f->started) given.dt = p->sample_time; /* the first row has no predecessor */
  const tse_status status = tse_input_check(&given, NULL);
  if (status < 0) return status;
  z->dt = r_max(given.dt, MIN_DT);
  z->has_steer = !is_missing(u, TSE_MISSING_steer_angle, u->steer_angle);
  z->steer = z->has_steer ? u->steer_angle : f->k.steer[0];
  for (int i = 0; i < IMU_CHANNELS; i++) {
    const int k = (int)TSE_CHANNEL_accel_x + i;
    const tse_real x = channel_at(u, &channel_rows[k]);
    z->use[i] = !is_missing(u, 1u << k, x) && channel_holds(&channel_rows[k], x);
    z->z[i] = z->use[i] ? x : TSE_R(0);
  }
  z->use[WHEEL_FRONT] = !is_missing(u, TSE_MISSING_wheel_speed_front, u->wheel_speed_front);
  z->use[WHEEL_REAR] = !is_missing(u, TSE_MISSING_wheel_speed_rear, u->wheel_speed_rear);
  z->z[WHEEL_FRONT] = z->use[WHEEL_FRONT] ? r_mul(p->radius_front, u->wheel_speed_front) : TSE_R(0);
  z->z[WHEEL_REAR] = z->use[WHEEL_REAR] ? r_mul(p->radius_rear, u->wheel_speed_rear) : TSE_R(0);
  z->axle[0] = z->z[WHEEL_FRONT];
  z->axle[1] = z->z[WHEEL_REAR];
  z->given = 0;
  for (int k = 0; k < (int)TSE_OPTIONALS; k++) {
    const tse_real x = channel_at(u, &optional_rows[k]);
    const int ok = (u->given & 1u << k) != 0 && channel_holds(&optional_rows[k], x);
    z->optional[k] = ok ? x : TSE_R(0);
    z->given |= ok ? 1u << k : 0u;
  }
  find_one_speed(p, f, z);
  /* If no axle rolls freely, no wheel measures the speed of the car. To compute the slip,
   * the speed would have to be integrated from accel_x, which also measures gravity along
   * the road. The longitudinal stiffness is then not estimated, unless all roads are flat
   * according to the settings (grade_sd is 0). */
  z->rolls = z->given & TSE_GIVEN_PEDALS ? find_free_axle(p, z) : ROLLS_UNKNOWN;
  const int no_speed = z->rolls == ROLLS_NONE
      || (p->car.driven == 0 && z->rolls == ROLLS_UNKNOWN && !(z->given & TSE_GIVEN_VELOCITIES));
  z->no_slip = z->no_second || (no_speed && p->prior_sd[GX] > TSE_R(0));
  z->used = z->use[ACCEL_X] + z->use[ACCEL_Y] + z->use[YAW_RATE];
  return TSE_OK;
}
