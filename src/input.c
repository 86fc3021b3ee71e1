/* src/input.c - a log row becomes a checked sample. Every refusal of a row happens here, before anything changes. */
#include "stages.h"

#define LONGEST_DT TSE_R(3600)
#if defined(TSE_REAL_Q20)
#undef LONGEST_DT
#define LONGEST_DT TSE_R(2047) /* what Q11.20 can say */
#endif

static int missing(const tse_input *u, uint32_t bit, tse_real value)
{
  return (u->missing & bit) != 0 || r_is_nan(value);
}

tse_status tse_input_check(const tse_input *u, const char **wrong)
{
  if (!u) return TSE_E_NULL;
  if (!(u->dt > TSE_R(0) && u->dt <= LONGEST_DT)) {
    if (wrong) *wrong = "dt";
    return TSE_E_TIME;
  }
#define CHECK_M(name, lo, hi) /* measured: out of range is missing, not refused */
#define CHECK_D(name, lo, hi)                                                                              \
  if (!missing(u, TSE_MISSING(name), u->name) && !(u->name >= TSE_R(lo) && u->name <= TSE_R(hi))) {        \
    if (wrong) *wrong = #name;                                                                             \
    return TSE_E_INPUT;                                                                                    \
  }
#define INPUT(name, lo, hi, unit, kind, text) CHECK_##kind(name, lo, hi)
#include "tse/input.def"
#undef INPUT
  return TSE_OK;
}

tse_status input_decode(const tse_params *p, const tse_filter *f, const tse_input *u, sample *y)
{
  tse_input row = *u;
  if (!f->started) row.dt = p->sample_time; /* the first row has no predecessor */
  const tse_status status = tse_input_check(&row, NULL);
  if (status < 0) return status;

  y->dt = row.dt;
  y->has_inputs = y->has_steer = 1;
  y->u.steer = row.steer_angle;
  y->u.v_front = r_mul(p->radius_front, row.wheel_speed_front);
  y->u.v_rear = r_mul(p->radius_rear, row.wheel_speed_rear);
  if (missing(&row, TSE_MISSING(steer_angle), row.steer_angle)) { y->u.steer = f->steer; y->has_inputs = y->has_steer = 0; }
  if (missing(&row, TSE_MISSING(wheel_speed_front), row.wheel_speed_front)) { y->u.v_front = f->v_front; y->has_inputs = 0; }
  if (missing(&row, TSE_MISSING(wheel_speed_rear), row.wheel_speed_rear)) { y->u.v_rear = f->v_rear; y->has_inputs = 0; }

  y->used = 0;
#define TAKE_D(name, lo, hi)
#define TAKE_M(name, lo, hi)                                                                                      \
  {                                                                                                               \
    const int i = (int)TSE_CHANNEL_##name - (int)TSE_CHANNEL_accel_x;                                             \
    const int ok = !missing(&row, TSE_MISSING(name), row.name) && row.name >= TSE_R(lo) && row.name <= TSE_R(hi); \
    y->use[i] = ok ? TSE_R(1) : TSE_R(0);                                                                         \
    y->y[i] = ok ? r_mul(row.name, p->inv_sd[i]) : TSE_R(0);                                                      \
    y->used += ok;                                                                                                \
  }
#define INPUT(name, lo, hi, unit, kind, text) TAKE_##kind(name, lo, hi)
#include "tse/input.def"
#undef INPUT
  return TSE_OK;
}

#define STUCK_TIME TSE_R(0.1)  /* s, and rows, for which a value must repeat to its last bit */
#define STUCK_ROWS 8
#define STUCK_OTHER TSE_R(0.1) /* m/s by which the other axle's speed has changed meanwhile ... */
#define STUCK_GAIN TSE_R(0.3)  /* m/s ... or the speed that accel_x has gained                   */
#define STANDING TSE_R(0.02)   /* m/s: a wheel that turns slower stands; it may be locked, or the car stands, on a slope */
#define LONGEST_LOCK TSE_R(4)  /* s for which a wheel may stand while the other axle turns             */
#define LONGEST_REPEAT TSE_R(10)

/* Noise does not repeat: a channel that does has stopped measuring, or its steps are coarse. So repeating alone is no fault.
 * A wheel speed is one when the other axle, or accel_x, says that the speed has changed; an inertial channel when it
 * contradicts the forecast (consistency.c). Steering may rest. A wheel that stands repeats itself by nature (slide.c). */
void watch_repeats(const tse_params *p, tse_filter *f, const tse_input *u, sample *y)
{
  const tse_real now[6] = { u->steer_angle, u->wheel_speed_front, u->wheel_speed_rear, u->accel_x, u->accel_y, u->yaw_rate };
  const tse_real other[2] = { y->u.v_rear, y->u.v_front };
  const tse_real gain = r_mul(r_mul(y->dt, p->sd[0]), r_mul(y->use[0], y->y[0] - f->bias_now[0]));
  for (int k = 0; k < 6; k++) {
    const int lost = missing(u, 1u << k, now[k]) || (k >= 3 && !(y->use[k - 3] > TSE_R(0)));
    const int same = f->started && !lost && now[k] == f->last[k];
    f->last[k] = lost ? TSE_R(0) : now[k]; /* however it is said that it is missing */
    f->repeats[k] = same ? f->repeats[k] + (f->repeats[k] < STUCK_ROWS) : 0;
    f->repeat_for[k] = same ? r_min(f->repeat_for[k] + y->dt, LONGEST_REPEAT) : TSE_R(0);
    const int repeats = f->repeats[k] >= STUCK_ROWS && f->repeat_for[k] > STUCK_TIME;
    if (k >= 3) f->stuck[k - 3] = repeats;
    if (k != 1 && k != 2) continue;
    const int w = k - 1;
    f->other_then[w] = same ? f->other_then[w] : other[w];
    f->gained[w] = same ? r_clamp(f->gained[w] + gain, -MOST_SPEED, MOST_SPEED) : TSE_R(0);
    const int stands = r_abs(other[1 - w]) < STANDING;
    const int stopped = stands && f->repeat_for[k] > LONGEST_LOCK && r_abs(other[w]) > STUCK_OTHER;
    const int moved = r_abs(other[w] - f->other_then[w]) > STUCK_OTHER || r_abs(f->gained[w]) > STUCK_GAIN;
    if (repeats && (stands ? stopped : moved)) y->has_inputs = 0;
  }
}
