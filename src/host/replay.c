/* host/replay.c - tse_replay(): run a whole log through the deterministic model of
 * integrator.c. */

#include "model/effects.h"
#include "tables/input.h"
#include "tse/replay.h"

#define BIT_GIVEN 63           /* bit of the effects mask that belongs to no effect. It is set if the log has
                                * disturbances (columns slip_front .. yaw_accel), which only the model
                                * with effects can use */

#define DEFAULT(name, def, unit, text) s->name = TSE_R(def);
void tse_replay_start_default(tse_replay_start *s)
{
  if (!s) return;
  REPLAY_START(DEFAULT)
}

/* Return element i of an array; 0 if there is no array. */
static tse_real get_value(const tse_real *array, int32_t i) { return array ? array[i] : TSE_R(0); }

/* Return road angles and disturbances of row i. */
static given read_given(const tse_replay_log *log, int32_t i)
{
  given g;
  g.grade = get_value(log->grade, i);
  g.bank = get_value(log->bank, i);
  g.slip_front = get_value(log->slip_front, i);
  g.slip_rear = get_value(log->slip_rear, i);
  g.x = get_value(log->force_x, i);
  g.y = get_value(log->force_y, i);
  g.yaw = get_value(log->yaw_accel, i);
  return g;
}

/* Return the mask of the effects that are on: those of the settings, and those that the
 * arrays of the log need. */
static uint64_t find_mask(const tse_params *p, const tse_replay_log *log)
{
  uint64_t mask = p->effects.mask;
  if (log->grade) mask |= (uint64_t)1 << TSE_EFFECT_grade;
  if (log->bank) mask |= (uint64_t)1 << TSE_EFFECT_bank;
  if (log->slip_front || log->slip_rear || log->force_x || log->force_y || log->yaw_accel)
    mask |= (uint64_t)1 << BIT_GIVEN;
  return mask;
}

/* Check the ranges of row i. */
static tse_status check_row(const tse_replay_log *log, int32_t i)
{
  if (i > 0 && !(log->dt[i] > TSE_R(0) && log->dt[i] <= TSE_R(1))) return TSE_E_TIME;
  if (!channel_holds(&channel_rows[TSE_CHANNEL_steer_angle], log->steer_angle[i])
      || !channel_holds(&channel_rows[TSE_CHANNEL_wheel_speed_front], log->wheel_speed_front[i])
      || !channel_holds(&channel_rows[TSE_CHANNEL_wheel_speed_rear], log->wheel_speed_rear[i]))
    return TSE_E_INPUT;
  const given g = read_given(log, i);
  const tse_real x[] = { g.grade, g.bank, g.slip_front, g.slip_rear, g.x, g.y, g.yaw };
  for (int k = 0; k < (int)(sizeof x / sizeof x[0]); k++)
    if (!r_is_finite(x[k])) return TSE_E_INPUT;
  return TSE_OK;
}

#define VALUE(name, def, unit, text) s->name,
/* Return whether all values of s are finite. */
static int is_start_finite(const tse_replay_start *s)
{
  const tse_real x[] = { REPLAY_START(VALUE) };
  int fine = 1;
  for (int i = 0; i < (int)(sizeof x / sizeof x[0]); i++) fine = fine && r_is_finite(x[i]);
  return fine;
}

/* Return the angular acceleration [rad/s2] of a wheel at row i: the difference quotient
 * of its speed between the previous and the next row. */
static tse_real compute_spin_up(const tse_real *omega, const tse_real *dt, int32_t i, int32_t rows)
{
  const int32_t a = i > 0 ? i - 1 : 0, b = i < rows - 1 ? i + 1 : i;
  tse_real time = TSE_R(0);
  for (int32_t k = a + 1; k <= b; k++) time += dt[k];
  return time > TSE_R(0) ? r_div(omega[b] - omega[a], time) : TSE_R(0);
}

/* Store x in element i of an array, if there is one.
 *   Returned:  1; 0 if x is stored and not finite */
static int write_value(tse_real *array, int32_t i, tse_real x)
{
  if (array) array[i] = x;
  return !array || r_is_finite(x);
}

/* Store the outputs of row i.
 *   Given:     z  IMU readings at row i without bias, and the state of the model (z.pt)
 *   Returned:  1; 0 if an output is not finite */
static int write_row(const tse_replay_log *log, const tse_replay_start *s, const tse_replay_out *out,
    int32_t i, int32_t rows, reading z)
{
  const point *const at = z.pt;
  const tse_params *const p = at->p;
  int fine = write_value(out->accel_x, i, z.y[0] + s->bias_accel_x);
  fine = write_value(out->accel_y, i, z.y[1] + s->bias_accel_y) && fine;
  fine = write_value(out->yaw_rate, i, z.y[2] + s->bias_yaw_rate) && fine;
  fine = write_value(out->vel_x, i, at->vx) && fine;
  fine = write_value(out->vel_y, i, at->vy) && fine;
  fine = write_value(out->true_yaw_rate, i, at->r) && fine;
  const tse_real slip_front = r_mul(p->radius_front, r_mul(p->effects.mass, at->fx_front)),
                 slip_rear = r_mul(p->radius_rear, r_mul(p->effects.mass, at->fx_rear));
  fine = write_value(out->wheel_torque_front, i,
             slip_front
                 + r_mul(s->wheel_inertia_front, compute_spin_up(log->wheel_speed_front, log->dt, i, rows)))
      && fine;
  return write_value(out->wheel_torque_rear, i,
             slip_rear
                 + r_mul(s->wheel_inertia_rear, compute_spin_up(log->wheel_speed_rear, log->dt, i, rows)))
      && fine;
}

/* Check the initial state and all rows, before the model processes the first row.
 *   Returned:  status; *wrong  index of the first wrong row, if wrong is not NULL */
static tse_status check_rows(
    const tse_replay_log *log, int32_t rows, const tse_replay_start *s, int32_t *wrong)
{
  for (int32_t i = 0; i < rows; i++) {
    const tse_status status = i == 0 && !is_start_finite(s) ? TSE_E_INPUT : check_row(log, i);
    if (status >= 0) continue;
    if (wrong) *wrong = i;
    return status;
  }
  return TSE_OK;
}

/* Return the inputs of row i. The steering angle is the logged angle after the effects
 * that act on it, for example a delay of the steering (effects_steer()).
 *   Updated:  m  memory of the effects */
static acting read_inputs(const tse_params *p, tse_effect_memory *m, const tse_replay_log *log, int32_t i)
{
  acting now;
  memset(&now, 0, sizeof now);
  now.u.steer = effects_steer(&p->effects, m, log->steer_angle[i], i > 0 ? log->dt[i] : TSE_R(1));
  now.u.v_front = r_mul(p->radius_front, log->wheel_speed_front[i]);
  now.u.v_rear = r_mul(p->radius_rear, log->wheel_speed_rear[i]);
  now.g = read_given(log, i);
  return now;
}

/* Return state and inputs of the model at the first row. The other members of `point` are
 * 0 until effects_settle() computes them. */
static point make_start_point(const tse_replay_start *s, const acting *first)
{
  const int from_wheels = s->vel_x_from_wheels < TSE_R(0) || s->vel_x_from_wheels > TSE_R(0);
  point at;
  memset(&at, 0, sizeof at);
  at.vx = from_wheels ? r_mul(TSE_R(0.5), first->u.v_front + first->u.v_rear) : s->vel_x;
  at.vy = s->vel_y;
  at.r = s->yaw_rate;
  at.u = first->u;
  at.g = first->g;
  return at;
}

tse_status tse_replay(const tse_params *p, const tse_replay_log *log, int32_t rows, const tse_replay_start *s,
    const tse_replay_out *out, int32_t *wrong)
{
  if (!p || !log || !s || !out) return TSE_E_NULL;
  if (!log->dt || !log->steer_angle || !log->wheel_speed_front || !log->wheel_speed_rear) return TSE_E_NULL;
  if (p->magic != TSE_PARAMS_MAGIC) return TSE_E_STATE;
  const tse_status refused = check_rows(log, rows, s, wrong);
  if (refused < 0 || rows <= 0) return refused; /* without rows, nothing is done and s is not checked */

  tse_params car = *p;
  tse_effect_memory m;
  point at;
  memset(&m, 0, sizeof m);
  car.effects.mask = find_mask(p, log);
  m.time = s->time;
  m.heading = r_mul(PER_TURN, s->heading);
  const stiffness k = vehicle_stiffness(
      &car, s->cx_front - TSE_R(1), s->cy_front - TSE_R(1), s->cy_rear - TSE_R(1));
  for (int32_t i = 0; i < rows; i++) {
    const tse_real dt = i > 0 ? log->dt[i] : TSE_R(1);
    const acting now = read_inputs(&car, &m, log, i);
    if (i == 0) {
      at = make_start_point(s, &now);
      effects_settle(&car, &m, k, &at);
    } else {
      effects_advance(&car, &m, k, &now, dt, vehicle_steps(&car, dt, at.u, now.u), &at);
      at.vx = vehicle_limit(at.vx, MAX_SPEED);
      at.vy = vehicle_limit(at.vy, MAX_SPEED);
      at.r = vehicle_limit(at.r, MAX_YAW_RATE);
    }
    if (!write_row(log, s, out, i, rows, effects_sense(&at, &m, dt))) {
      if (wrong) *wrong = i;
      return TSE_E_INPUT;
    }
  }
  return TSE_OK;
}
