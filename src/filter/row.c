/* filter/row.c - a log row becomes a checked sample. */
#include "filter/filter.h"
#include "tables/input.h"

/* Return the axle that rolls freely, by brake switch and wheel torques: the one that is not driven, unless they say that it
 * brakes; of two that are driven, which a switch does not show, one without torque beside one with. */
static int32_t rolls_by(const tse_params *p, const decoded *z)
{
  const int32_t undriven = not_driven(&p->car);
  const int has_brake = (z->given & TSE_GIVEN_brake) != 0;
  const int known[2] = { (z->given & TSE_GIVEN_wheel_torque_front) != 0, (z->given & TSE_GIVEN_wheel_torque_rear) != 0 };
  const tse_real torque[2] = { r_abs(z->optional[TSE_OPTIONAL_wheel_torque_front]), r_abs(z->optional[TSE_OPTIONAL_wheel_torque_rear]) };
  const int less = torque[1] < torque[0];
  if (undriven == ROLLS_UNKNOWN && !(known[0] && known[1])) return ROLLS_UNKNOWN;
  if (has_brake && !(z->optional[TSE_OPTIONAL_brake] < BRAKES)) return ROLLS_NONE;
  if (undriven == ROLLS_UNKNOWN) return torque[less] < p->no_torque && !(torque[!less] < p->no_torque) ? ROLLS_FRONT + less : ROLLS_NONE;
  if (known[undriven - ROLLS_FRONT]) return torque[undriven - ROLLS_FRONT] < p->no_torque ? undriven : ROLLS_NONE;
  return has_brake ? undriven : ROLLS_UNKNOWN;
}

tse_status row_decode(const tse_params *p, const tse_filter *f, const tse_input *u, decoded *z)
{
  tse_input given = *u;
  if (!f->started) given.dt = p->sample_time; /* the first row has no predecessor */
  const tse_status status = tse_input_check(&given, NULL);
  if (status < 0) return status;
  z->dt = r_max(given.dt, LEAST_DT);
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
  /* both axles have always read the same: one signal, a vehicle speed, which does not show slip; two that are quantised may for a while */
  z->same = r_abs(z->z[WHEEL_FRONT] - z->z[WHEEL_REAR]) <= r_mul(SAME_SPEED, r_abs(z->z[WHEEL_REAR]));
  z->one_speed = z->use[WHEEL_FRONT] && z->use[WHEEL_REAR] && (p->wheel_signals < 2 || (z->same && !(f->two_for > TSE_R(0))));
  if (z->one_speed) z->use[WHEEL_FRONT] = 0;
  z->given = 0;
  for (int k = 0; k < (int)TSE_OPTIONALS; k++) {
    const tse_real x = channel_at(u, &optional_rows[k]);
    const int ok = (u->given & 1u << k) != 0 && channel_holds(&optional_rows[k], x);
    z->optional[k] = ok ? x : TSE_R(0);
    z->given |= ok ? 1u << k : 0u;
  }
  /* where no axle shows the speed, slip is what accel_x adds up to, in which the grade of the road stands */
  z->rolls = z->given & TSE_GIVEN_PEDALS ? rolls_by(p, z) : ROLLS_UNKNOWN;
  const int no_speed = z->rolls == ROLLS_NONE || (p->car.driven == 0 && z->rolls == ROLLS_UNKNOWN && !(z->given & TSE_GIVEN_VELOCITIES));
  z->no_slip = z->one_speed || (no_speed && p->prior_sd[GX] > TSE_R(0));
  z->used = z->use[ACCEL_X] + z->use[ACCEL_Y] + z->use[YAW_RATE];
  return TSE_OK;
}
