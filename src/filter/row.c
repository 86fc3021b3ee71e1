/* filter/row.c - a log row becomes a checked sample. */
#include "filter/filter.h"

#define LEAST_DT TSE_R(1e-4) /* s: rows that come closer are taken as that far apart: rates are what changes over it */

#define SAME_SPEED TSE_R(1e-5) /* of the speed: what six digits leave */

static int missing(const tse_input *u, uint32_t bit, tse_real value) { return (u->missing & bit) != 0 || r_is_nan(value); }

tse_status row_decode(const tse_params *p, const tse_filter *f, const tse_input *u, decoded *z)
{
  tse_input given = *u;
  if (!f->started) given.dt = p->sample_time; /* the first row has no predecessor */
  const tse_status status = tse_input_check(&given, NULL);
  if (status < 0) return status;
  const tse_real most[3] = { TSE_R(50), TSE_R(50), TSE_R(6) }, value[3] = { u->accel_x, u->accel_y, u->yaw_rate };
  const uint32_t bit[3] = { TSE_MISSING(accel_x), TSE_MISSING(accel_y), TSE_MISSING(yaw_rate) };
  z->dt = r_max(given.dt, LEAST_DT);
  z->has_steer = !missing(u, TSE_MISSING(steer_angle), u->steer_angle);
  z->steer = z->has_steer ? u->steer_angle : f->k.steer[0];
  for (int i = 0; i < 3; i++) {
    z->use[i] = !missing(u, bit[i], value[i]) && r_abs(value[i]) <= most[i];
    z->z[i] = z->use[i] ? value[i] : TSE_R(0);
  }
  z->use[3] = !missing(u, TSE_MISSING(wheel_speed_front), u->wheel_speed_front);
  z->use[4] = !missing(u, TSE_MISSING(wheel_speed_rear), u->wheel_speed_rear);
  z->z[3] = z->use[3] ? r_mul(p->radius_front, u->wheel_speed_front) : TSE_R(0);
  z->z[4] = z->use[4] ? r_mul(p->radius_rear, u->wheel_speed_rear) : TSE_R(0);
  /* both axles read the same: one signal, a vehicle speed, which says nothing of slip */
  z->one_speed = z->use[3] && z->use[4] && (p->wheel_signals < 2 || r_abs(z->z[3] - z->z[4]) <= r_mul(SAME_SPEED, r_abs(z->z[4])));
  if (z->one_speed) z->use[3] = 0;
  z->given = 0;
#define VELOCITY(name, lo, hi, unit, text)                                                                             \
  z->velocity[TSE_VELOCITY_##name] = TSE_R(0);                                                                         \
  if ((u->given & TSE_GIVEN(name)) != 0 && u->name >= TSE_R(lo) && u->name <= TSE_R(hi)) {                             \
    z->velocity[TSE_VELOCITY_##name] = u->name;                                                                        \
    z->given |= TSE_GIVEN(name);                                                                                       \
  }
#include "tse/velocity.def"
#undef VELOCITY
  z->used = z->use[0] + z->use[1] + z->use[2];
  return TSE_OK;
}
